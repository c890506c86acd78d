//! All paths of a command in one table, checked once before any work and before any byte is written.
//!
//! No two paths that name the same file, unless both are only read. Inputs are regular files that can be opened.
//! Outputs are new files, or take the place of a regular one: of any file for the main output of
//! a command, with `--force`; for everything else only of an earlier file of the same kind that this program
//! wrote. docs/design/paths.md gives the reasons. Nothing is created here but nameless files, to see whether a
//! folder takes files.

use crate::disk::{folder_of, kind_of, open_input, scratch_file};
use crate::error::{Error, Remedy, Result};
pub use crate::first_bytes::Kind;
use crate::first_bytes::is_text;
use crate::pending_file::refuse_irregular;
use std::ffi::OsString;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Role of a path in a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Read; `-` is standard input.
    Input,
    /// Read, and never from standard input.
    InputFile,
    /// A folder that is read.
    InputFolder,
    /// A folder whose meshes are read: a result in it would be one of them the next time.
    InputParts,
    /// The mesh, picture or page that the command is there for; `-` is standard output.
    Output,
    /// Written beside the main output.
    Side(Kind),
    /// Appended to.
    Log,
    /// A folder that is the main output; whoever writes it says when an earlier one may be replaced.
    OutputFolder,
    /// A folder for temporary data, made where it is missing.
    TempDir,
    /// The folder of a job, made where it is missing; no other path may lie in it, nor in an `OutputFolder`.
    JobFolder,
}

struct Row {
    role: Role,
    /// As people type it: `INPUT`, `--report`.
    name: &'static str,
    path: PathBuf,
}

/// Said of paths that no report or record of a job could name.
pub const NOT_UTF8: &str =
    "this path is not UTF-8; rename the file or folder, or link to it by another name";

/// True for a path that is UTF-8 once it is absolute.
pub fn is_utf8(path: &Path) -> bool {
    std::path::absolute(path).map_or(true, |path| path.to_str().is_some())
}

/// The paths of one command.
#[derive(Default)]
pub struct Paths {
    rows: Vec<Row>,
    force: bool,
}

/// Key that is equal for two paths to the same file.
#[derive(PartialEq, Eq)]
enum FileKey {
    /// There is a file: device and inode.
    File(u64, u64),
    /// There is none yet: device and inode of the folder, and the name.
    Name(u64, u64, OsString),
    /// Neither the file nor its folder are there; as typed, made absolute.
    Nowhere(PathBuf),
    /// `-`.
    Stream,
}

impl Paths {
    /// An empty table; `force` lets the main output be replaced.
    pub fn new(force: bool) -> Paths {
        Paths { rows: Vec::new(), force }
    }

    /// Adds a path under the name that people know it by.
    pub fn with(mut self, role: Role, name: &'static str, path: impl Into<PathBuf>) -> Paths {
        self.rows.push(Row { role, name, path: path.into() });
        self
    }

    /// Adds the path of an option, if it was given.
    pub fn with_option(self, role: Role, name: &'static str, path: Option<&PathBuf>) -> Paths {
        match path {
            Some(path) => self.with(role, name, path),
            None => self,
        }
    }

    /// The same paths as typed in another folder.
    pub fn typed_in(mut self, folder: &Path) -> Paths {
        for row in self.rows.iter_mut().filter(|row| !row.is_stream()) {
            row.path = folder.join(&row.path);
        }
        self
    }

    /// Refuses what cannot be meant or cannot succeed.
    ///
    /// Errors: `Usage` for paths that clash, may not be replaced or have no folder; `BadInput` for inputs;
    /// `Device` and `NoSpace` for folders that take no files.
    pub fn check(&self) -> Result<()> {
        for row in self.rows.iter().filter(|row| !row.is_stream()) {
            row.check_utf8()?;
        }
        self.check_clashes()?;
        for row in self.rows.iter().filter(|row| row.is_read()) {
            row.check_input()?;
        }
        for row in self.rows.iter().filter(|row| !row.is_read()) {
            row.check_written(self.force)?;
        }
        let mut probed: Vec<&Path> = Vec::new();
        for row in &self.rows {
            let Some(folder) = row.folder_written() else { continue };
            if !probed.contains(&folder) {
                probe(folder)?;
                probed.push(folder);
            }
        }
        Ok(())
    }

    fn check_clashes(&self) -> Result<()> {
        let keys: Vec<FileKey> = self.rows.iter().map(|row| row.key()).collect();
        for (i, a) in self.rows.iter().enumerate() {
            for (j, b) in self.rows.iter().enumerate().skip(i + 1) {
                if a.is_read() && b.is_read() && !(a.is_stream() && b.is_stream()) {
                    continue;
                }
                let are_folders = a.role == Role::TempDir || b.role == Role::TempDir;
                // Standard input and standard output are two things, but each can be used only once.
                let is_once = keys[i] != FileKey::Stream || a.is_read() == b.is_read();
                if keys[i] == keys[j] && is_once && !are_folders {
                    return Err(Error::Usage(format!(
                        "{} and {} are the same file, {}; give each its own path",
                        a.name,
                        b.name,
                        b.path.display()
                    )));
                }
            }
        }
        for folder in self.rows.iter().filter(|row| row.role == Role::InputParts) {
            let is_result = |row: &&Row| matches!(row.role, Role::Output | Role::OutputFolder);
            for row in self.rows.iter().filter(is_result) {
                if !row.is_stream() && row.lies_in(folder) {
                    let (path, name, folder) =
                        (row.path.display(), row.name, folder.path.display());
                    return Err(Error::Usage(format!(
                        "{path}: {name} lies in {folder}, whose meshes are the input; put it elsewhere"
                    )));
                }
            }
        }
        for folder in self.rows.iter().filter(|row| row.is_made()) {
            for row in self.rows.iter().filter(|row| !std::ptr::eq(*row, folder)) {
                if !row.is_stream() && row.lies_in(folder) {
                    let why = match folder.role {
                        Role::JobFolder => ", whose files come and go; put it elsewhere",
                        _ => ", which is made as a whole; put it elsewhere",
                    };
                    let (path, name) = (row.path.display(), row.name);
                    let what = format!("{path}: {name} lies in {}{why}", folder.name);
                    return Err(Error::Usage(what));
                }
            }
        }
        Ok(())
    }
}

impl Row {
    fn is_read(&self) -> bool {
        matches!(self.role, Role::Input | Role::InputFile | Role::InputFolder | Role::InputParts)
    }

    /// True for a folder that comes as a whole, and may take the place of an earlier one.
    fn is_made(&self) -> bool {
        matches!(self.role, Role::JobFolder | Role::OutputFolder)
    }

    /// Returns whether a path lies in a folder, at any depth, or is that folder where it is one for temporary data.
    fn lies_in(&self, folder: &Row) -> bool {
        let (path, root) = (real(&self.path), real(&folder.path));
        let is_temp = self.role == Role::TempDir && folder.role == Role::OutputFolder;
        path.starts_with(&root) && (path != root || is_temp)
    }

    fn is_stream(&self) -> bool {
        matches!(self.role, Role::Input | Role::Output) && self.path == Path::new("-")
    }

    fn key(&self) -> FileKey {
        if self.is_stream() {
            return FileKey::Stream;
        }
        let identity = |path: &Path| std::fs::metadata(path).map(|m| (m.dev(), m.ino()));
        if let Ok((device, inode)) = identity(&self.path) {
            return FileKey::File(device, inode);
        }
        match (identity(folder_of(&self.path)), self.path.file_name()) {
            (Ok((device, inode)), Some(name)) => FileKey::Name(device, inode, name.to_owned()),
            _ => FileKey::Nowhere(std::path::absolute(&self.path).unwrap_or(self.path.clone())),
        }
    }

    fn check_utf8(&self) -> Result<()> {
        match (is_utf8(&self.path), self.is_read()) {
            (true, _) => Ok(()),
            (false, true) => Err(Error::bad_input(&self.path, NOT_UTF8)),
            (false, false) => {
                Err(Error::Usage(format!("{} ({}): {NOT_UTF8}", self.path.display(), self.name)))
            }
        }
    }

    fn check_input(&self) -> Result<()> {
        if self.is_stream() {
            return Ok(());
        }
        if matches!(self.role, Role::InputFolder | Role::InputParts) {
            return match std::fs::metadata(&self.path) {
                Ok(meta) if meta.is_dir() => Ok(()),
                Ok(meta) => {
                    let what = format!("this is {}, not a folder", kind_of(meta.file_type()));
                    Err(Error::bad_input(&self.path, what))
                }
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                    Err(Error::bad_input(&self.path, "the folder does not exist"))
                }
                Err(e) => Err(Error::bad_input(&self.path, format!("cannot open: {e}"))),
            };
        }
        if let Ok(meta) = std::fs::metadata(&self.path)
            && self.role == Role::Input
            && !meta.is_file()
            && !meta.is_dir()
        {
            let kind = kind_of(meta.file_type());
            let what =
                format!("this is {kind}, not a regular file; pipe it in with '-' as the input");
            return Err(Error::bad_input(&self.path, what));
        }
        open_input(&self.path).map(drop)
    }

    fn check_written(&self, force: bool) -> Result<()> {
        let path = self.path.as_path();
        if self.is_stream() {
            return Ok(());
        }
        if self.role == Role::OutputFolder && !folder_of(path).is_dir() {
            return Err(Error::Usage(format!(
                "{}: the folder of {} does not exist; make it first",
                path.display(),
                self.name
            )));
        }
        if matches!(self.role, Role::TempDir | Role::JobFolder | Role::OutputFolder) {
            // A link to nothing is in the way, too; so is a file where a folder above should be.
            let is_there = path.symlink_metadata().is_ok();
            let path = if is_there { path } else { existing_parent(path) };
            let found = std::fs::metadata(path).or_else(|_| path.symlink_metadata());
            return match found {
                Ok(meta) if !meta.is_dir() => Err(Error::Usage(format!(
                    "{}: {} is {}, not a folder",
                    path.display(),
                    self.name,
                    kind_of(meta.file_type())
                ))),
                _ => Ok(()),
            };
        }
        if path.file_name().is_none() || ends_in_slash(path) {
            return Err(Error::Usage(format!(
                "{}: {} names a folder; name a file in it",
                path.display(),
                self.name
            )));
        }
        refuse_irregular(path)?;
        if !folder_of(path).is_dir() {
            return Err(Error::Usage(format!(
                "{}: the folder of {} does not exist; make it first",
                path.display(),
                self.name
            )));
        }
        let Ok(meta) = std::fs::metadata(path) else { return Ok(()) };
        let refused = |why: &str| {
            Err(Error::Usage(format!("{} ({}) exists{why}", path.display(), self.name)))
        };
        match self.role {
            Role::Output if !force => refused("; give --force to replace it"),
            Role::Side(Kind::Heatmap | Kind::Progressive | Kind::Map) if !force => {
                refused("; give --force to replace it")
            }
            // A script may have made the file for us (mktemp): nothing is lost with it.
            Role::Side(_) | Role::Log if meta.len() == 0 => Ok(()),
            Role::Side(kind) if !kind.wrote(path) => {
                refused(" and is not an earlier one of stonecut; name another file or remove it")
            }
            Role::Log if !is_text(path) => {
                refused(" and is not a text to append to; name another file or remove it")
            }
            _ => Ok(()),
        }
    }

    /// The folder that must take files.
    fn folder_written(&self) -> Option<&Path> {
        match self.role {
            Role::Input | Role::InputFile | Role::InputFolder => None,
            _ if self.is_stream() => None,
            // What is there needs no room in its folder to be appended to.
            Role::Log if self.path.exists() => None,
            Role::TempDir | Role::JobFolder => Some(existing_parent(&self.path)),
            _ => Some(folder_of(&self.path)),
        }
    }
}

fn ends_in_slash(path: &Path) -> bool {
    path.as_os_str().as_encoded_bytes().ends_with(b"/")
}

/// A path without links and dots, as far as it is there.
pub fn real(path: &Path) -> PathBuf {
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let mut above = whole.as_path();
    loop {
        match (above.canonicalize(), above.parent()) {
            (Ok(found), _) => return found.join(whole.strip_prefix(above).unwrap_or(above)),
            (Err(_), Some(parent)) => above = parent,
            (Err(_), None) => return whole,
        }
    }
}

/// The nearest folder above a path, or itself, that is there.
pub fn existing_parent(path: &Path) -> &Path {
    let mut folder = path;
    while !folder.exists() {
        match folder.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => folder = parent,
            _ => return Path::new("."),
        }
    }
    folder
}

/// Makes a nameless file, which is the only sure way to know that a folder takes files.
fn probe(folder: &Path) -> Result<()> {
    match scratch_file(folder) {
        Ok(_) => Ok(()),
        Err(e) if e.kind() == std::io::ErrorKind::StorageFull => {
            let inodes = rustix::fs::statvfs(folder).map(|stat| (stat.f_files, stat.f_favail));
            if inodes.is_ok_and(|(all, free)| all > 0 && free == 0) {
                let what = "no inodes are free".to_owned();
                return Err(Error::NoSpace {
                    path: folder.into(),
                    what,
                    remedy: Remedy::RemoveFiles,
                });
            }
            Err(Error::io(folder, "cannot create files in this folder", e))
        }
        Err(e) => Err(match Error::io(folder, "cannot write into this folder", e) {
            Error::Io { path, action, source } => {
                let what = format!("{action}: {source}");
                Error::Device { path, what, remedy: Remedy::MendDisk }
            }
            other => other,
        }),
    }
}
