//! Errors, in classes that scripts can tell apart by exit code.
//!
//! A message is one line: what, where (file, element, row, byte offset), and what to do next. What to do about a
//! fault of the machine depends on the command that meets it: the error carries the remedy as a type, and
//! `Error::advice` puts it into words for a command. Faults of our own making are `assert!`s; only where a run
//! would lose its end through one is it caught and becomes `Internal`.

use crate::memory::{budget_bytes, limit_bytes};
use crate::units::show_bytes;
use std::path::{Path, PathBuf};

/// The result of everything in this crate that can fail.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Every failure that a caller may meet; `exit_code` gives its class.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused to read, write, create or rename.
    #[error("{}: {action}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Action that failed, as a verb phrase: "cannot open".
        action: &'static str,
        /// The system's own words.
        source: std::io::Error,
    },
    /// The input breaks its format, or holds what no mesh may hold.
    #[error("{}: {what}", path.display())]
    BadInput {
        /// The input file.
        path: PathBuf,
        /// Element, row, byte offset and remedy.
        what: String,
    },
    /// The command line asks for something that makes no sense.
    #[error("{0}")]
    Usage(String),
    /// The run came to its end, but nothing would be left to write.
    #[error("{}: {what}", path.display())]
    Empty {
        /// The output that was not written.
        path: PathBuf,
        /// Reason why nothing is left, and the remedy.
        what: String,
    },
    /// The file system cannot hold what the run would write.
    #[error("{}: {what}", path.display())]
    NoSpace {
        /// The folder on that file system, or the file.
        path: PathBuf,
        /// Action that failed, needed and available bytes.
        what: String,
        /// Ways to make room.
        remedy: Remedy,
    },
    /// The file system does not take files, or its device fails.
    #[error("{}: {what}", path.display())]
    Device {
        /// The file or folder.
        path: PathBuf,
        /// Action that failed, and the system's own words.
        what: String,
        /// Advice against it.
        remedy: Remedy,
    },
    /// Whoever reads standard output has closed it; other commands die of SIGPIPE there, without a word.
    #[error("standard output was closed")]
    OutputClosed,
    /// The memory budget cannot hold one cell and the finish.
    #[error("{0}")]
    NoMemory(String),
    /// Another run holds the job.
    #[error("{}: {what}", path.display())]
    Locked {
        /// The job folder.
        path: PathBuf,
        /// Process that holds it.
        what: String,
    },
    /// The job folder belongs to another input, other settings or another format version.
    #[error("{}: {what}", path.display())]
    StateMismatch {
        /// The job folder.
        path: PathBuf,
        /// The difference, and the remedy.
        what: String,
    },
    /// A file of the job folder is not what was written there.
    #[error("{}: {what}", path.display())]
    Corrupt {
        /// The damaged file.
        path: PathBuf,
        /// The place, and the remedy.
        what: String,
    },
    /// A fault of our own (a panic) that was caught; what was sealed before it is kept.
    #[error("internal fault: {0}; please report it")]
    Internal(String),
    /// The user, or the system, asked to stop; everything sealed so far is kept.
    #[error("stopped by signal {signal}")]
    Interrupted {
        /// The signal's number: 2 (SIGINT) or 15 (SIGTERM).
        signal: i32,
    },
}

/// Advice against a fault of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remedy {
    /// Room on the file system.
    MakeSpace,
    /// Room on the file system of the output, which temporary data do not share.
    MakeSpaceForOutput,
    /// Fewer files on the file system.
    RemoveFiles,
    /// A higher limit on the size of a file (`ulimit -f`).
    RaiseFileLimit,
    /// A disk that takes files.
    MendDisk,
    /// Another place behind standard output.
    Redirect,
}

/// Options of a command that help against a failure; advice names no others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Offers {
    /// The same command continues where an earlier one stopped.
    pub resumes: bool,
    /// It has the option `--temp-dir`.
    pub temp_dir: bool,
}

const SIGPIPE: u8 = 13;

impl Error {
    /// Wraps a failure to write, create, rename or remove with the path and the action it belongs to.
    ///
    /// Running out of space or quota becomes `NoSpace`, whose exit code scripts wait for; a folder that takes
    /// no files, or a failing device, `Device`.
    pub fn io(path: impl AsRef<Path>, action: &'static str, source: std::io::Error) -> Self {
        use std::io::ErrorKind::{
            FileTooLarge, PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull,
        };
        let path = path.as_ref().to_path_buf();
        let what = || format!("{action}: {source}");
        match source.kind() {
            StorageFull | QuotaExceeded => {
                Error::NoSpace { path, what: what(), remedy: Remedy::MakeSpace }
            }
            FileTooLarge => Error::NoSpace { path, what: what(), remedy: Remedy::RaiseFileLimit },
            PermissionDenied | ReadOnlyFilesystem => {
                Error::Device { path, what: what(), remedy: Remedy::MendDisk }
            }
            _ if is_device_failure(&source) => {
                Error::Device { path, what: what(), remedy: Remedy::MendDisk }
            }
            _ => Error::Io { path, action, source },
        }
    }

    /// Wraps a failure to open, look at or read: what is refused there is a matter of the file, not of the disk,
    /// unless the device fails.
    pub fn reading(path: impl AsRef<Path>, action: &'static str, source: std::io::Error) -> Self {
        let path = path.as_ref().to_path_buf();
        if is_device_failure(&source) {
            let what = format!("{action}: {source}");
            return Error::Device { path, what, remedy: Remedy::MendDisk };
        }
        Error::Io { path, action, source }
    }

    /// The same error about an input whose folder is known by another name.
    #[must_use]
    pub fn moved(self, from: &Path, to: &Path) -> Self {
        match self {
            Error::BadInput { path, what } => Error::BadInput {
                path: path.strip_prefix(from).map_or_else(|_| path.clone(), |rest| to.join(rest)),
                what: what.replace(&*from.to_string_lossy(), &to.to_string_lossy()),
            },
            other => other,
        }
    }

    /// Wraps a failure to write to standard output.
    pub fn stdout(source: std::io::Error) -> Self {
        if source.kind() == std::io::ErrorKind::BrokenPipe {
            return Error::OutputClosed;
        }
        match Error::io("standard output", "cannot write", source) {
            Error::NoSpace { path, what, .. } => {
                Error::NoSpace { path, what, remedy: Remedy::Redirect }
            }
            Error::Device { path, what, .. } => {
                Error::Device { path, what, remedy: Remedy::Redirect }
            }
            other => other,
        }
    }

    /// Returns advice that fits a command with these `offers`; `None` where the message itself
    /// says it all.
    pub fn advice(&self, offers: Offers) -> Option<String> {
        let again = if offers.resumes {
            "run the same command to continue"
        } else {
            "run the same command again"
        };
        let elsewhere =
            if offers.temp_dir { ", or move the temporary data with --temp-dir" } else { "" };
        match self {
            Error::NoSpace { remedy, .. } | Error::Device { remedy, .. } => Some(match remedy {
                Remedy::MakeSpace => format!("make space and {again}{elsewhere}"),
                Remedy::MakeSpaceForOutput => {
                    format!("make space and {again}, or write the output to another disk")
                }
                Remedy::RemoveFiles => format!("remove some files and {again}{elsewhere}"),
                Remedy::RaiseFileLimit => {
                    format!("raise the limit on the size of a file (ulimit -f) and {again}")
                }
                Remedy::MendDisk => {
                    format!("{again} once the disk takes files, or move the output{elsewhere}")
                }
                Remedy::Redirect => "send standard output where there is room".to_owned(),
            }),
            Error::Io { source, .. } if is_out_of_descriptors(source) => {
                Some(format!("raise the limit on open files (ulimit -n 256) and {again}"))
            }
            Error::NoMemory(_) => {
                let limit = limit_bytes();
                let most = budget_bytes(Some(u64::MAX), limit);
                let is_beyond = self.named_memory().is_some_and(|bytes| bytes > most);
                let [most, limit] = [most, limit].map(show_bytes);
                is_beyond.then(|| {
                    format!(
                        "no more than {most} can be given here, since the machine or the control group allows {limit}: \
                         raise that limit"
                    )
                })
            }
            Error::Interrupted { .. } | Error::Internal(_) if offers.resumes => {
                Some(format!("what is done is kept: {again}"))
            }
            _ => None,
        }
    }

    /// A stable name for the class, for programs: `no_space`, `bad_input`, ...
    pub fn code(&self) -> &'static str {
        match self {
            Error::Io { .. } => "io",
            Error::BadInput { .. } => "bad_input",
            Error::Usage(_) => "usage",
            Error::Empty { .. } => "empty",
            Error::NoSpace { .. } => "no_space",
            Error::Device { .. } => "device",
            Error::OutputClosed => "output_closed",
            Error::NoMemory(_) => "no_memory",
            Error::Locked { .. } => "locked",
            Error::StateMismatch { .. } => "state_mismatch",
            Error::Corrupt { .. } => "corrupt",
            Error::Internal(_) => "internal",
            Error::Interrupted { .. } => "interrupted",
        }
    }

    /// Advice for a program that can start the same run again; `None` where the message says it all.
    pub fn remedy(&self) -> Option<String> {
        self.advice(Offers { resumes: true, temp_dir: false })
    }

    /// The size in bytes that a refusal for want of memory names.
    fn named_memory(&self) -> Option<u64> {
        let Error::NoMemory(what) = self else { return None };
        let word = what.split("--memory ").nth(1)?.split([' ', ',', ';']).next()?;
        crate::units::parse_bytes(word).ok()
    }

    /// Returns the first error; of several for want of memory the one that names most, since that suffices for all.
    pub fn first_of(outcomes: impl IntoIterator<Item = Result<()>>) -> Result<()> {
        let mut first: Option<Error> = None;
        for error in outcomes.into_iter().filter_map(Result::err) {
            let is_more = |first: &Error| match (first.named_memory(), error.named_memory()) {
                (Some(first), Some(now)) => now > first,
                _ => false,
            };
            if first.as_ref().is_none_or(is_more) {
                first = Some(error);
            }
        }
        first.map_or(Ok(()), Err)
    }

    /// A fault in the contents of the input file.
    pub fn bad_input(path: impl AsRef<Path>, what: impl Into<String>) -> Self {
        Error::BadInput { path: path.as_ref().to_path_buf(), what: what.into() }
    }

    /// A damaged file of our own.
    pub fn corrupt(path: impl AsRef<Path>, what: impl Into<String>) -> Self {
        Error::Corrupt { path: path.as_ref().to_path_buf(), what: what.into() }
    }

    /// The class of this failure, as documented in docs/usage.md; never 124-127 or 137.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Io { .. } | Error::Corrupt { .. } => 1,
            Error::Usage(_) => 2,
            Error::Empty { .. } => 3,
            Error::BadInput { .. } => 4,
            Error::NoSpace { .. } => 5,
            Error::NoMemory(_) => 6,
            Error::Locked { .. } => 7,
            Error::StateMismatch { .. } => 8,
            Error::Internal(_) => 9,
            Error::Device { .. } => 10,
            Error::OutputClosed => 128 + SIGPIPE,
            Error::Interrupted { signal } => 128u8.saturating_add(*signal as u8),
        }
    }
}

/// EMFILE of the process, or ENFILE of the system.
fn is_out_of_descriptors(source: &std::io::Error) -> bool {
    let codes = [rustix::io::Errno::MFILE, rustix::io::Errno::NFILE];
    codes.iter().any(|code| source.raw_os_error() == Some(code.raw_os_error()))
}

/// EIO, in reading or writing.
fn is_device_failure(source: &std::io::Error) -> bool {
    source.raw_os_error() == Some(rustix::io::Errno::IO.raw_os_error())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_has_its_own_exit_code() {
        let full = std::io::Error::from(std::io::ErrorKind::StorageFull);
        assert_eq!(Error::io("/x", "cannot write", full).exit_code(), 5);
        let quota = std::io::Error::from(std::io::ErrorKind::QuotaExceeded);
        assert_eq!(Error::io("/x", "cannot sync", quota).exit_code(), 5);
    }

    #[test]
    fn a_disk_that_takes_no_files_has_its_own_exit_code() {
        let denied = || std::io::Error::from(std::io::ErrorKind::PermissionDenied);
        assert_eq!(Error::io("/x", "cannot write", denied()).exit_code(), 10);
        assert_eq!(Error::reading("/x", "cannot list", denied()).exit_code(), 1);
        let read_only = std::io::Error::from_raw_os_error(30);
        assert_eq!(Error::io("/x", "cannot open", read_only).exit_code(), 10);
        let failing = std::io::Error::from_raw_os_error(5);
        assert_eq!(Error::reading("/x", "cannot read", failing).exit_code(), 10);
    }

    #[test]
    fn of_refusals_the_one_that_names_most_counts() {
        let no_memory =
            |size: &str| Err(Error::NoMemory(format!("x: give at least --memory {size}, or y")));
        let said = |outcomes: Vec<Result<()>>| Error::first_of(outcomes).unwrap_err().to_string();
        assert!(
            said(vec![no_memory("167MiB"), Ok(()), no_memory("1GiB"), no_memory("230MiB")])
                .contains("1GiB")
        );
        let usage = || Err(Error::Usage("first".to_owned()));
        assert_eq!(said(vec![usage(), no_memory("1GiB")]), "first");
        assert!(said(vec![no_memory("1GiB"), usage()]).contains("1GiB"));
        assert!(Error::first_of([Ok(()), Ok(())]).is_ok());
        let advice = |size: &str| no_memory(size).unwrap_err().remedy();
        assert!(advice("1000TiB").unwrap().contains("raise that limit"));
        assert_eq!(advice("1MiB"), None);
    }

    #[test]
    fn too_few_descriptors_are_named_with_what_helps() {
        let error = Error::io("/x", "cannot create", std::io::Error::from_raw_os_error(24));
        assert!(error.advice(Offers::default()).unwrap().contains("ulimit -n"));
    }

    #[test]
    fn advice_names_only_what_the_command_offers() {
        let full = || std::io::Error::from(std::io::ErrorKind::StorageFull);
        let all = Offers { resumes: true, temp_dir: true };
        let errors = [
            Error::io("/x", "cannot write", full()),
            Error::io("/x", "cannot write", std::io::ErrorKind::FileTooLarge.into()),
            Error::io("/x", "cannot write", std::io::ErrorKind::PermissionDenied.into()),
            Error::stdout(full()),
            Error::Interrupted { signal: 2 },
            Error::Internal("x".to_owned()),
        ];
        for error in errors {
            let bare = error.advice(Offers::default()).unwrap_or_default();
            assert!(!bare.contains("continue") && !bare.contains("--temp-dir"), "{bare}");
            assert!(error.advice(all).is_some(), "{error}");
        }
        let said = Error::io("/x", "cannot write", full()).advice(all).unwrap();
        assert!(said.contains("--temp-dir") && said.contains("continue"), "{said}");
        let closed = Error::stdout(std::io::ErrorKind::BrokenPipe.into());
        assert_eq!((closed.exit_code(), closed.advice(all)), (141, None));
    }
}
