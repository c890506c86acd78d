//! The gate for everything that is read: a regular file, of a size that is known before a byte of it is read.
//!
//! FIFOs, sockets and devices, and links to them, are refused by name and never waited for. Decides nothing about formats.

use crate::error::{Error, Result};
use rustix::fs::OFlags;
use std::fs::{File, Metadata};
use std::io::Read;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

/// Opens an input for reading. What is not a regular file is refused, and never waited for: opening a FIFO that
/// is never written to would block, deaf to signals.
pub fn open_input(path: &Path) -> Result<File> {
    let bad = |e: std::io::Error| match e.kind() {
        std::io::ErrorKind::NotFound => Error::bad_input(path, "the file does not exist"),
        _ => match Error::reading(path, "cannot open", e) {
            Error::Io { action, source, .. } => {
                Error::bad_input(path, format!("{action}: {source}"))
            }
            device => device,
        },
    };
    refuse_irregular(path, &std::fs::metadata(path).map_err(bad)?)?;
    // Should a FIFO have taken its place meanwhile, it is not waited for either.
    let file = open_no_wait(path, OFlags::empty()).map_err(bad)?;
    refuse_irregular(path, &file.metadata().map_err(bad)?)?;
    Ok(file)
}

fn refuse_irregular(path: &Path, meta: &Metadata) -> Result<()> {
    if meta.is_file() {
        return Ok(());
    }
    let what = if meta.is_dir() {
        "this is a folder; name a file in it".to_owned()
    } else {
        let kind = kind_of(meta.file_type());
        format!("this is {kind}, not a regular file; name a file")
    };
    Err(Error::bad_input(path, what))
}

/// The kind of a file in words, for messages.
pub fn kind_of(kind: std::fs::FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match kind {
        kind if kind.is_file() => "a regular file",
        kind if kind.is_dir() => "a folder",
        kind if kind.is_symlink() => "a symbolic link",
        kind if kind.is_fifo() => "a FIFO",
        kind if kind.is_socket() => "a socket",
        _ => "a device",
    }
}

/// Reads a regular file of at most `most_bytes` whole. For messages that name the file themselves.
pub fn read_regular(path: &Path, most_bytes: u64) -> std::io::Result<Vec<u8>> {
    require_regular(&std::fs::metadata(path)?)?;
    read_opened(open_no_wait(path, OFlags::empty())?, most_bytes)
}

/// Reads a file of ours whole: a regular one that no link leads to.
pub fn read_own(path: &Path, most_bytes: u64) -> std::io::Result<Vec<u8>> {
    require_regular(&std::fs::symlink_metadata(path)?)?;
    read_opened(open_no_wait(path, OFlags::NOFOLLOW)?, most_bytes)
}

/// Should a FIFO have taken the place of a file, it is not waited for.
fn open_no_wait(path: &Path, more: OFlags) -> std::io::Result<File> {
    let flags = OFlags::NONBLOCK.union(more).bits() as i32;
    File::options().read(true).custom_flags(flags).open(path)
}

fn require_regular(meta: &Metadata) -> std::io::Result<()> {
    if meta.is_file() {
        return Ok(());
    }
    let kind = kind_of(meta.file_type());
    Err(std::io::Error::other(format!("this is {kind}, not a regular file")))
}

fn read_opened(file: File, most_bytes: u64) -> std::io::Result<Vec<u8>> {
    let meta = file.metadata()?;
    require_regular(&meta)?;
    if meta.len() > most_bytes {
        let what =
            format!("its {} bytes are more than the {most_bytes} that such a file has", meta.len());
        return Err(std::io::Error::other(what));
    }
    let mut bytes = Vec::with_capacity(meta.len() as usize);
    // A file that grows meanwhile is read as it was.
    file.take(meta.len()).read_to_end(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_of_a_known_size_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("a"), b"1234").unwrap();
        std::os::unix::fs::symlink("a", at("link")).unwrap();
        std::os::unix::fs::symlink("/dev/zero", at("zero")).unwrap();
        rustix::fs::mknodat(
            rustix::fs::CWD,
            at("fifo"),
            rustix::fs::FileType::Fifo,
            rustix::fs::Mode::from_raw_mode(0o600),
            0,
        )
        .unwrap();
        assert_eq!(read_regular(&at("a"), 4).unwrap(), b"1234");
        assert_eq!(read_regular(&at("link"), 4).unwrap(), b"1234");
        assert!(read_regular(&at("a"), 3).unwrap_err().to_string().contains("4 bytes"));
        assert!(read_own(&at("link"), 4).unwrap_err().to_string().contains("symbolic link"));
        assert!(read_regular(&at("zero"), 4).unwrap_err().to_string().contains("a device"));
        assert!(read_regular(&at("fifo"), 4).unwrap_err().to_string().contains("a FIFO"));
        assert!(read_regular(folder.path(), 4).unwrap_err().to_string().contains("a folder"));
    }
}
