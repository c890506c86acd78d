//! `stonecut completions` and `stonecut man`: what shells and `man` know of the command line, made from itself.

use super::answer::CommandEnd;
use super::session::{Command, Session};
use crate::error::{Error, Result};
use crate::system::paths::{Paths, Role};
use clap_complete::Shell;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Prints completions of this command line for a shell.
///
/// bash: source <(stonecut completions bash); zsh: into a file _stonecut on $fpath; fish: into
/// ~/.config/fish/completions/stonecut.fish.
#[derive(Debug, clap::Args)]
pub struct Completions {
    /// The shell.
    #[arg(value_enum)]
    shell: Shell,
}

/// Writes the manual pages, one for each command, into a folder.
#[derive(Debug, clap::Args)]
pub struct Man {
    /// The folder; made where it is missing. Pages of these names that lie there are replaced.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

impl Command for Completions {
    fn paths(&self) -> Result<Paths> {
        Ok(Paths::default())
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        let mut text = Vec::new();
        clap_complete::generate(self.shell, &mut (session.line)(), "stonecut", &mut text);
        std::io::stdout().write_all(&text).map_err(Error::stdout)?;
        Ok(CommandEnd::plain())
    }
}

impl Command for Man {
    fn paths(&self) -> Result<Paths> {
        Ok(Paths::default().with(Role::TempDir, "DIR", &self.folder))
    }

    /// Writes `stonecut.1`, `stonecut-simplify.1`, ...
    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        let (folder, mut line) = (&self.folder, (session.line)());
        std::fs::create_dir_all(folder)
            .map_err(|e| Error::io(folder, "cannot create folder", e))?;
        line.build();
        write_page(folder, "stonecut", line.clone())?;
        for sub in line.get_subcommands().filter(|sub| sub.get_name() != "help") {
            let name = format!("stonecut-{}", sub.get_name());
            write_page(folder, &name, sub.clone())?;
        }
        Ok(CommandEnd::plain())
    }
}

fn write_page(folder: &Path, name: &str, command: clap::Command) -> Result<()> {
    // Pages are found by their names; a leak of a few words, once.
    let shown: &'static str = Box::leak(name.to_owned().into_boxed_str());
    let path = folder.join(format!("{name}.1"));
    let mut page = Vec::new();
    clap_mangen::Man::new(command.name(shown))
        .render(&mut page)
        .and_then(|()| std::fs::write(&path, &page))
        .map_err(|e| Error::io(&path, "cannot write", e))
}
