//! What can go wrong, in classes that scripts can tell apart by exit code.
//!
//! A message is one line: what, where (file, element, row, byte offset), and what to do next. Faults of
//! our own making are `assert!`s; only where a run would lose its end through one is it caught and becomes
//! `Internal`.

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
        /// What was being done, as a verb phrase: "cannot open".
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
    /// The file system cannot hold what the run would write.
    #[error("{}: {what}", path.display())]
    NoSpace {
        /// The folder on that file system.
        path: PathBuf,
        /// Needed and available bytes, and the remedy.
        what: String,
    },
    /// The file system does not take files, or its device fails.
    #[error("{}: {what}", path.display())]
    Device {
        /// The file or folder.
        path: PathBuf,
        /// What was being done, the system's own words, and the remedy.
        what: String,
    },
    /// The memory budget cannot hold one cell and the finish.
    #[error("{0}")]
    NoMemory(String),
    /// Another run holds the job.
    #[error("{}: {what}", path.display())]
    Locked {
        /// The job folder.
        path: PathBuf,
        /// Who holds it.
        what: String,
    },
    /// The job folder belongs to another input, other settings or another format version.
    #[error("{}: {what}", path.display())]
    StateMismatch {
        /// The job folder.
        path: PathBuf,
        /// What differs, and the remedy.
        what: String,
    },
    /// A file of the job folder is not what was written there.
    #[error("{}: {what}", path.display())]
    Corrupt {
        /// The damaged file.
        path: PathBuf,
        /// Where, and the remedy.
        what: String,
    },
    /// A fault of our own (a panic) that was caught; what was sealed before it is kept.
    #[error(
        "internal fault: {0}; please report it. The state is kept: the same command continues from it"
    )]
    Internal(String),
    /// The user, or the system, asked to stop; everything sealed so far is kept.
    #[error("stopped by signal {signal}; run the same command to continue")]
    Interrupted {
        /// The signal's number: 2 (SIGINT) or 15 (SIGTERM).
        signal: i32,
    },
}

impl Error {
    /// Wraps an operating-system error with the path and the action it belongs to.
    ///
    /// Running out of space or quota becomes `NoSpace`, whose exit code scripts wait for; a folder that takes
    /// no files, or a failing device, `Device`.
    pub fn io(path: impl AsRef<Path>, action: &'static str, source: std::io::Error) -> Self {
        use std::io::ErrorKind::{
            PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull,
        };
        let path = path.as_ref().to_path_buf();
        if matches!(source.kind(), StorageFull | QuotaExceeded) {
            let what = format!(
                "{action}: {source}; make space and run the same command to continue, or move the \
                 temporary data with --temp-dir"
            );
            return Error::NoSpace { path, what };
        }
        // What fails while reading is the input's or the user's affair; the words say it all.
        let is_writing = !matches!(action, "cannot open" | "cannot read" | "cannot stat");
        let is_refused = matches!(source.kind(), ReadOnlyFilesystem | PermissionDenied);
        if source.raw_os_error() == Some(rustix::io::Errno::IO.raw_os_error())
            || is_refused && is_writing
        {
            let what = format!(
                "{action}: {source}; what was done is kept: run the same command once the disk takes files \
                 again, or move the output, or the temporary data with --temp-dir"
            );
            return Error::Device { path, what };
        }
        Error::Io { path, action, source }
    }

    /// A fault in the contents of the input file.
    pub fn bad_input(path: impl AsRef<Path>, what: impl Into<String>) -> Self {
        Error::BadInput { path: path.as_ref().to_path_buf(), what: what.into() }
    }

    /// A damaged file of our own.
    pub fn corrupt(path: impl AsRef<Path>, what: impl Into<String>) -> Self {
        Error::Corrupt { path: path.as_ref().to_path_buf(), what: what.into() }
    }

    /// The class of this failure, as documented in the README; never 124-127 or 137.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Io { .. } | Error::Corrupt { .. } => 1,
            Error::Usage(_) => 2,
            Error::BadInput { .. } => 4,
            Error::NoSpace { .. } => 5,
            Error::NoMemory(_) => 6,
            Error::Locked { .. } => 7,
            Error::StateMismatch { .. } => 8,
            Error::Internal(_) => 9,
            Error::Device { .. } => 10,
            Error::Interrupted { signal } => 128u8.saturating_add(*signal as u8),
        }
    }
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
        assert_eq!(Error::io("/x", "cannot open", denied()).exit_code(), 1);
        let read_only = std::io::Error::from_raw_os_error(30);
        assert_eq!(Error::io("/x", "cannot create", read_only).exit_code(), 10);
        let failing = std::io::Error::from_raw_os_error(5);
        let error = Error::io("/x", "cannot read", failing);
        assert_eq!(error.exit_code(), 10);
        assert!(error.to_string().contains("--temp-dir"), "{error}");
    }
}
