//! Sums of a scene before any of it is read: a mesh stands in a file once, and in its scene any number of times.
//!
//! A file of a megabyte can name one accessor twenty thousand times. What all of it takes on disk and in memory is added up
//! from the counts of the accessors, and refused while nothing has been written.

use super::json::{Document, Primitive};
use super::scene::Placed;
use crate::open_options::StageOptions;
use crate::ply::raw::RawFile;
use stonecut_system::error::{Error, Remedy, Result};
use stonecut_system::free_space::free_bytes;
use stonecut_system::units::{show_bytes, show_count};

/// Temporary bytes at peak of a vertex and of a corner; see `Joiner`.
const VERTEX_BYTES: u64 = 128;
const CORNER_BYTES: u64 = 40;

/// Memory of a primitive in its place: its accessors, its placement.
const PIECE_BYTES: u64 = 1024;

/// Sums over all primitives in their places.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Totals {
    pieces: u64,
    vertices: u64,
    triangles: u64,
}

impl Totals {
    fn of(document: &Document, placed: &[Placed]) -> Totals {
        // Of each mesh once; meshes that do not exist are reported elsewhere.
        let meshes: Vec<Totals> = document
            .meshes
            .iter()
            .map(|mesh| {
                let sum = |sum: Totals, primitive| sum.plus(Totals::of_one(document, primitive));
                mesh.primitives.iter().fold(Totals::default(), sum)
            })
            .collect();
        let in_place = placed.iter().filter_map(|placed| meshes.get(placed.mesh));
        in_place.fold(Totals::default(), |sum, mesh| sum.plus(*mesh))
    }

    fn of_one(document: &Document, primitive: &Primitive) -> Totals {
        let count = |number: Option<usize>| {
            let accessor = number.and_then(|number| document.accessors.get(number));
            accessor.map_or(0, |accessor| accessor.count)
        };
        let vertices = count(primitive.attributes.get("POSITION").copied());
        let indices = if primitive.indices.is_some() { count(primitive.indices) } else { vertices };
        match primitive.mode.unwrap_or(4) {
            mode @ 4..=6 => Totals { pieces: 1, vertices, triangles: n_triangles(mode, indices) },
            _ => Totals { pieces: 1, ..Totals::default() },
        }
    }

    fn plus(self, other: Totals) -> Totals {
        Totals {
            pieces: self.pieces.saturating_add(other.pieces),
            vertices: self.vertices.saturating_add(other.vertices),
            triangles: self.triangles.saturating_add(other.triangles),
        }
    }

    fn temp_bytes(self) -> u64 {
        let corners = self.triangles.saturating_mul(3 * CORNER_BYTES);
        self.vertices.saturating_mul(VERTEX_BYTES).saturating_add(corners)
    }
}

/// Refuses a scene that is larger than the memory, the disk, or what the command is ready to unpack.
pub(super) fn hold(
    file: &RawFile,
    document: &Document,
    placed: &[Placed],
    options: &StageOptions,
) -> Result<()> {
    let totals = Totals::of(document, placed);
    let sum = format!(
        "its scene has {} triangles and {} vertices in {} primitives",
        show_count(totals.triangles),
        show_count(totals.vertices),
        show_count(totals.pieces)
    );
    let needed = totals.pieces.saturating_mul(PIECE_BYTES);
    if needed > options.parse_bytes {
        return Err(Error::NoMemory(format!(
            "{}: {sum}; holding them takes {}; give --memory {}",
            file.path().display(),
            show_bytes(needed),
            StageOptions::memory_for(needed)
        )));
    }
    let needed = totals.temp_bytes();
    if let Some(most) = options.most_unpacked(file.len()).filter(|&most| needed > most) {
        return Err(file.bad(format!(
            "{sum}, {} of temporary data for a file of {}; a look at it ends at {}. Convert it to PLY first, where \
             there is room for that",
            show_bytes(needed),
            show_bytes(file.len()),
            show_bytes(most)
        )));
    }
    match free_bytes(&options.temp_dir) {
        Some(free) if needed > free => Err(Error::NoSpace {
            path: options.temp_dir.clone(),
            what: format!(
                "{} in {}: {sum}, {} of temporary data; {} are free",
                "cannot unpack the input",
                file.path().display(),
                show_bytes(needed),
                show_bytes(free)
            ),
            remedy: Remedy::MakeSpace,
        }),
        _ => Ok(()),
    }
}

/// Triangles of a list, or of a strip or fan.
pub(super) fn n_triangles(mode: u32, n_indices: u64) -> u64 {
    if mode == 4 { n_indices / 3 } else { n_indices.saturating_sub(2) }
}

/// Indices at the end of a primitive that make no triangle: all but the last one or two of a list make threes, and a strip
/// or fan begins with three.
pub(super) fn n_left_over(mode: u32, n_indices: u64) -> u64 {
    match mode {
        4 => n_indices % 3,
        _ if n_indices < 3 => n_indices,
        _ => 0,
    }
}
