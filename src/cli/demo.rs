//! `stonecut demo`: the whole way on a synthetic scan, told command by command.

use super::answer::CommandEnd;
use super::session::{Command, Session};
use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::measure::load;
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use std::path::{Path, PathBuf};

/// Makes a synthetic scan, simplifies it out of core, checks the result, and says where everything lies.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder for the demo's files (about 200 MB).
    #[arg(default_value = "stonecut-demo")]
    folder: PathBuf,
}

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        Ok(Paths::default().with(Role::TempDir, "DIR", &self.folder))
    }

    /// Fails if the result is not as closed as the scan it came from.
    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        show(&self.folder, session).map(|code| CommandEnd { code, ..CommandEnd::plain() })
    }
}

/// The commands, as a person would type them in the demo's folder.
const COMMANDS: [&str; 4] = [
    "synth statue statue.ply --triangles 4M --force",
    "simplify statue.ply small.ply --ratio 1% --cell-triangles 100k --memory 256MiB --report small.json \
     --force --restart",
    "measure statue.ply small.ply",
    "render statue.ply small.ply -o pictures.png --edges --caption before --caption after --force",
];

fn show(folder: &Path, session: &mut Session) -> Result<u8> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "cannot create", e))?;
    for line in COMMANDS {
        session.log.say("");
        session.log.say(format!("$ stonecut {line}"));
        let words = line.split_whitespace().map(|word| in_folder(folder, word));
        let words: Vec<String> = std::iter::once("stonecut".to_owned()).chain(words).collect();
        let code = (session.run_words)(&words, session)?;
        if code != 0 {
            return Ok(code);
        }
    }
    let small = folder.join("small.ply");
    let topology =
        load::topology_of(&load::load(&MeshSource::open(&small)?, 1, &Progress::default())?);
    let is_sound = topology.boundary_edges == 0
        && topology.non_manifold_edges == 0
        && topology.components == 1
        && topology.euler_characteristic == 2;
    if !is_sound {
        let what = format!("is not the closed surface that went in: {topology:?}");
        return Err(Error::bad_input(&small, what));
    }
    session.log.say("");
    session.log.say("checked: the scan was closed and in one piece, and so is the result.");
    session.log.say(format!(
        "scan {}, result {}, report {}, pictures {}",
        folder.join("statue.ply").display(),
        small.display(),
        folder.join("small.json").display(),
        folder.join("pictures.png").display()
    ));
    Ok(0)
}

/// File names of the demo lie in its folder.
fn in_folder(folder: &Path, word: &str) -> String {
    let is_file = [".ply", ".json", ".png"].iter().any(|ending| word.ends_with(ending));
    if is_file { folder.join(word).display().to_string() } else { word.to_owned() }
}
