//! `stonecut info`: what is in a mesh file.

use super::{Log, Talk};
use crate::error::{Error, Result};
use crate::ply::MeshSource;
use crate::progress::Progress;
use crate::units::show_bytes;
use std::io::Write;
use std::path::PathBuf;

/// Tells what is in a mesh file, and with --check whether it is sound.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The mesh.
    file: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Prints on standard output.
pub fn run(args: &Args, _talk: &Talk, _progress: &Progress, _log: &mut Log) -> Result<u8> {
    let source = MeshSource::open(&args.file)?;
    let names: Vec<&str> = source.schema().properties.iter().map(|p| p.name.as_str()).collect();
    let text = if args.json {
        let json = serde_json::json!({
            "path": args.file, "bytes": source.file_bytes(),
            "vertices": source.n_vertices(), "triangles": source.n_faces(), "properties": names,
        });
        format!("{json:#}\n")
    } else {
        format!(
            "{}: {} vertices, {} faces, {}\n",
            args.file.display(),
            source.n_vertices(),
            source.n_faces(),
            show_bytes(source.file_bytes())
        )
    };
    std::io::stdout()
        .write_all(text.as_bytes())
        .map_err(|e| Error::io("standard output", "cannot write", e))?;
    Ok(0)
}
