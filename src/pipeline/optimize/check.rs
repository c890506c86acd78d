//! `--optimize`: refused before any work where it does not go with what was asked for, or where memory is short.

use crate::config::{Config, Texture};
use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::optimize;
use crate::system::memory::BASE_BYTES;
use crate::system::units::{show_bytes, show_count};
use std::path::Path;

/// Bytes that the optimisation of `n_triangles` takes, everything included.
pub(super) fn needed_bytes(source: &MeshSource, n_triangles: u64) -> u64 {
    let schema = source.schema();
    // Values twice, since they are taken from the mesh as it was, and a record; half a vertex a triangle.
    let vertex_bytes = match schema.properties.is_empty() {
        true => 0,
        false => (8 * schema.n_channels() as u64 + 24 + 2 * schema.record_bytes() as u64) / 2 + 12,
    };
    BASE_BYTES + optimize::bytes(n_triangles, vertex_bytes)
}

/// Refuses an optimisation of a result of `n_triangles` that could not be made, if one was asked for.
pub(in crate::pipeline) fn check(
    source: &MeshSource,
    n_triangles: u64,
    config: &Config,
) -> Result<()> {
    if config.optimize.is_none() {
        return Ok(());
    }
    if config.input == Path::new("-") {
        let what = "--optimize: standard input cannot be read again for samples; give a file";
        return Err(Error::Usage(what.to_owned()));
    }
    let codec = source.schema().codec();
    let has_faces = source.carried().is_some_and(|carry| carry.is_moved());
    if has_faces || codec.has_seams(source.schema()) || config.texture == Texture::Bake {
        let what = "--optimize moves vertices and edges across seams, so texture coordinates and what faces carry cannot \
                    follow; give them up with --texture none and --drop-faces";
        return Err(Error::Usage(what.to_owned()));
    }
    let needed = needed_bytes(source, n_triangles);
    if needed > config.memory_bytes {
        return Err(Error::NoMemory(format!(
            "the budget of {} is too small for --optimize, which keeps the result of {} triangles and points of the \
             original in memory: give at least --memory {}MiB, or ask for fewer triangles",
            show_bytes(config.memory_bytes),
            show_count(n_triangles),
            needed.div_ceil(1 << 20),
        )));
    }
    Ok(())
}
