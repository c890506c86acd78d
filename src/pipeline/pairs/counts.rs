//! `--pairs`: how many triangles there are on the way, what pairs cannot do, and what memory they need.

use crate::config::{Config, Texture};
use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::methods::pairs;
use crate::system::memory::BASE_BYTES;
use crate::system::units::{show_bytes, show_count};

/// Triangles of the first collapse, for each one that is wanted. Contracting from 8 to 4 times the target, then collapsing, left a
/// third less error than contracting down to the target (docs/design/methods.md).
const BEFORE: u64 = 8;

/// Triangles on the way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Counts {
    /// Of the first collapse.
    pub(super) before: u64,
    /// After the pairs.
    pub(super) joined: u64,
}

impl Counts {
    pub(super) fn new(n_input: u64, target: u64) -> Counts {
        let before = target.saturating_mul(BEFORE).clamp(1, n_input.max(1));
        Counts { before, joined: (before / 2).max(target) }
    }
}

/// Refuses pairs that could not be contracted, if they were asked for.
pub(in crate::pipeline) fn check(
    source: &MeshSource,
    n_triangles: u64,
    config: &Config,
) -> Result<()> {
    if !config.pairs {
        return Ok(());
    }
    let codec = source.schema().codec();
    let has_faces = source.carried().is_some_and(|carry| carry.is_moved());
    if has_faces || codec.has_seams(source.schema()) || config.texture == Texture::Bake {
        let what = "--pairs makes vertices of different charts and faces one, so texture coordinates and what faces carry \
                    cannot follow; give them up with --texture none and --drop-faces";
        return Err(Error::Usage(what.to_owned()));
    }
    let before = Counts::new(source.n_triangles(), n_triangles).before;
    let codec = source.schema().kernel_codec(&config.attributes.labels);
    let needed = BASE_BYTES + pairs::need(before, &codec, source.schema().record_bytes());
    if needed > config.memory_bytes {
        return Err(Error::NoMemory(format!(
            "the budget of {} is too small for --pairs, which begins with {} triangles in memory, {BEFORE} for each one \
             wanted: give at least --memory {}MiB, or ask for fewer triangles",
            show_bytes(config.memory_bytes),
            show_count(before),
            needed.div_ceil(1 << 20),
        )));
    }
    Ok(())
}
