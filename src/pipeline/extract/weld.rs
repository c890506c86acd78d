//! Joins the tiles of a cut into one mesh: what several of them have is one vertex by its number in the input.

use super::tree::{Tree, TreeCut};
use crate::error::{Error, Result};
use crate::io::tileset::{TileBorder, border_path, decode_borders, most_tile_bytes};
use crate::io::{StoredPage, StoredTile, TileMesh, TileScalar, decode_tile_within};
use crate::mesh::Mesh;
use crate::mesh::codec::VertexCodec;
use crate::mesh::global_vertex::GlobalVertex;
use crate::mesh::property::{Property, Scalar, write_scalar};
use crate::mesh::record::VertexSchema;
use crate::system::disk::read_regular;
use crate::system::losses::{Loss, LossKind};
use crate::system::memory::BASE_BYTES;
use crate::system::parallel::{guarded, in_order};
use crate::system::progress::Progress;
use crate::system::units::{memory_word, show_bytes};
use crate::texture::{Light, add_corners, corner_bytes};
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Vertices of a triangle that are planned for: half as many, some for borders, and some for edges of one triangle.
pub(super) const VERTICES_PER_TRIANGLE: f64 = 0.75;
/// Bytes of a vertex, of a triangle, and of a vertex that several tiles have, while tiles are joined; lists may be twice as
/// long as what is in them while they grow.
const VERTEX_BYTES: u64 = 2 * 24;
const CHANNEL_BYTES: u64 = 2 * 4;
const TRIANGLE_BYTES: u64 = 2 * 12;
const BORDER_BYTES: u64 = 48;

/// Linear light of vertices that only triangles without an area have: grey.
const NO_LIGHT: f32 = 0.45;

/// A tile with the numbers of its vertices.
#[derive(Default)]
struct Read {
    tile: Option<(StoredTile, TileBorder)>,
    /// Light of the page at its vertices, multiplied by opacity, summed over their corners; empty without a page.
    shown: Vec<Light>,
}

/// Channels of a mesh with colours.
pub(super) const COLOURS: usize = 3;

/// Memory for pages that are looked at.
struct TilePages {
    /// Bytes for all of them, and for one that others are looked at beside.
    free_bytes: u64,
    share_bytes: u64,
    large: Mutex<()>,
}

impl TilePages {
    /// Adds up what the page shows at the vertices of its tile; `bad` makes an error of what is wrong with it.
    fn shown(
        &self,
        page: &StoredPage,
        mesh: &TileMesh,
        sums: &mut Vec<Light>,
        bad: impl Fn(String) -> Error,
    ) -> Result<()> {
        let bytes = corner_bytes(page.size);
        if bytes > self.free_bytes / 2 {
            return Err(Error::NoMemory(format!(
                "a page of {} x {} texels needs {}, there are {} for it beside the mesh; give more --memory or a \
                 coarser cut",
                page.size[0],
                page.size[1],
                show_bytes(bytes),
                show_bytes(self.free_bytes / 2)
            )));
        }
        // One large page at a time, and small ones beside it.
        let _turn = (bytes > self.share_bytes)
            .then(|| self.large.lock().unwrap_or_else(PoisonError::into_inner));
        sums.resize(mesh.positions.len(), [0.0; 4]);
        let corner = |v: u32| mesh.coordinates[v as usize].map(|x| f32::from(x) / 65_535.0);
        if mesh.coordinates.len() != mesh.positions.len() {
            return Err(bad("it has a page, and no coordinates on it".to_owned()));
        }
        // A decoder that panics is a damaged image.
        guarded(|| {
            Ok(add_corners((&page.image, page.size), page.factor, &mesh.triangles, corner, sums))
        })
        .unwrap_or_else(|error| Err(error.to_string()))
        .map_err(|what| bad(format!("its image cannot be decoded ({what})")))
    }
}

/// Rows of the properties that tiles carry as attributes: records whose position is not used.
pub(super) struct Rows {
    pub(super) schema: VertexSchema,
    pub(super) codec: VertexCodec,
}

impl Rows {
    pub(super) fn new(scalars: &[TileScalar]) -> Rows {
        let properties = scalars.iter().map(|s| Property::new(&s.name, s.scalar)).collect();
        let schema = VertexSchema { coordinate: Scalar::F32, properties };
        Rows { codec: schema.codec(), schema }
    }

    /// Bytes of a row; none without properties.
    pub(super) fn row_bytes(&self) -> usize {
        if self.schema.properties.is_empty() { 0 } else { self.schema.record_bytes() }
    }

    /// The row of a vertex of a tile.
    fn put(&self, columns: &[Vec<f64>], vertex: usize, out: &mut Vec<u8>) {
        let first = out.len();
        out.resize(first + self.row_bytes(), 0);
        let mut at = first + self.schema.position_bytes();
        for (property, column) in self.schema.properties.iter().zip(columns) {
            write_scalar(property.scalar, out, at, column[vertex]);
            at += property.scalar.bytes();
        }
    }
}

/// The tiles of a cut as one mesh.
pub(super) struct JoinedTiles {
    /// Its channels are linear colours, if there are any, and those of the rows.
    pub(super) mesh: Mesh,
    pub(super) has_colours: bool,
    /// A row for each vertex.
    pub(super) records: Vec<u8>,
}

/// Bytes for joining vertices, with colours, and triangles.
pub(super) fn join_bytes(vertices: u64, triangles: u64, rows: &Rows) -> u64 {
    let channels = CHANNEL_BYTES * (COLOURS + rows.codec.n_channels()) as u64;
    let row = 2 * rows.row_bytes() as u64;
    vertices * (VERTEX_BYTES + channels + row) + triangles * TRIANGLE_BYTES
}

/// Reads the tiles of a cut and joins them.
///
/// Errors: `BadInput` for a tile that cannot be read, `NoMemory` if the mesh outgrows `memory_bytes`.
pub(super) fn join(
    folder: &Path,
    (tree, cut): (&Tree, &TreeCut),
    rows: &Rows,
    threads: usize,
    memory_bytes: u64,
    progress: &Progress,
) -> Result<JoinedTiles> {
    let mut joined = JoinedTiles { mesh: Mesh::default(), has_colours: false, records: Vec::new() };
    let mut known: HashMap<GlobalVertex, u32> = HashMap::new();
    joined.mesh.triangles.reserve_exact(cut.triangles as usize);
    let free_bytes = memory_bytes.saturating_sub(join_bytes(
        (cut.triangles as f64 * VERTICES_PER_TRIANGLE) as u64,
        cut.triangles,
        rows,
    ));
    let most_bytes = most_tile_bytes(memory_bytes, threads);
    let share_bytes = free_bytes / 2 / threads as u64;
    let pages = TilePages { free_bytes, share_bytes, large: Mutex::new(()) };
    let name = |index: u64| tree.nodes[cut.tiles[index as usize]].content.as_deref().unwrap_or("");
    in_order(
        cut.tiles.len() as u64,
        threads,
        progress,
        |index, out: &mut Read| {
            let bad = |what: String| {
                let what =
                    format!("{}: {what}; see what 'stonecut info --check' finds", name(index));
                Error::bad_input(folder, what)
            };
            let (tile, border) =
                read(folder, name(index), &tree.scalars, most_bytes).map_err(bad)?;
            out.shown.clear();
            if let Some(page) = &tile.page {
                pages.shown(page, &tile.mesh, &mut out.shown, bad)?;
            }
            out.tile = Some((tile, border));
            Ok(())
        },
        |index, out| {
            let Some((tile, border)) = out.tile.take() else { return Ok(()) };
            let has_colours = !tile.mesh.colours.is_empty() || !out.shown.is_empty();
            if joined.mesh.positions.is_empty() {
                joined.has_colours = has_colours;
                let colours = if has_colours { COLOURS } else { 0 };
                joined.mesh.n_channels = colours + rows.codec.n_channels();
                if !out.shown.is_empty() {
                    let why = "not carried: vertices have colours out of them instead";
                    progress.lose(Loss::new(
                        LossKind::Images,
                        "texture coordinates and images",
                        why,
                    ));
                }
            }
            if joined.has_colours != has_colours && !tile.mesh.positions.is_empty() {
                let what =
                    format!("{}: it differs from other tiles in having colours", name(index));
                return Err(Error::bad_input(folder, what));
            }
            add(&mut joined, rows, &mut known, (&tile, &border), &out.shown, tree.origin);
            let mesh = &joined.mesh;
            let (vertices, triangles) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
            let bytes = join_bytes(vertices, triangles, rows) + BORDER_BYTES * known.len() as u64;
            progress.add(tile.mesh.triangles.len() as u64);
            match bytes > memory_bytes || vertices >= u64::from(u32::MAX) {
                true => {
                    // The rest is like what was seen, about.
                    let all = 1.2 * bytes as f64 * cut.triangles as f64 / triangles.max(1) as f64;
                    Err(Error::NoMemory(format!(
                        "the mesh takes more than {} of memory after {triangles} of {} triangles; give --memory {} or a coarser cut",
                        show_bytes(memory_bytes),
                        cut.triangles,
                        memory_word(BASE_BYTES + all as u64)
                    )))
                }
                false => Ok(()),
            }
        },
    )?;
    Ok(joined)
}

fn add(
    joined: &mut JoinedTiles,
    rows: &Rows,
    known: &mut HashMap<GlobalVertex, u32>,
    (tile, border): (&StoredTile, &TileBorder),
    shown: &[Light],
    origin: [f64; 3],
) {
    let JoinedTiles { mesh, records, has_colours } = joined;
    let mut numbers = border.iter().copied().peekable();
    let mut place = Vec::with_capacity(tile.mesh.positions.len());
    let first = mesh.positions.len();
    // Of the vertices that this tile is the first to have: those that charts have parted are several in the tile.
    let mut lights: Vec<Light> = Vec::new();
    for (v, position) in (0u32..).zip(&tile.mesh.positions) {
        let next = mesh.positions.len() as u32;
        let id = numbers.next_if(|(at, _)| *at == v).map(|(_, id)| id);
        let number = id.map_or(next, |id| *known.entry(id).or_insert(next));
        place.push(number);
        if number == next {
            let at = [0, 1, 2].map(|k| origin[k] + f64::from(position[k]) * tile.step);
            mesh.positions.push(at);
            if let Some(colour) = tile.mesh.colours.get(v as usize) {
                mesh.channels.extend(colour.map(|x| f32::from(x) / 65_535.0));
            } else if *has_colours {
                mesh.channels.extend([0.0; COLOURS]);
                lights.push([0.0; 4]);
            }
            if rows.row_bytes() > 0 {
                let first = records.len();
                rows.put(&tile.mesh.scalars, v as usize, records);
                let place = mesh.channels.len();
                mesh.channels.resize(place + rows.codec.n_channels(), 0.0);
                rows.codec.decode_channels(&records[first..], &mut mesh.channels[place..]);
            }
        }
        if let (Some(own), Some(light)) =
            ((number as usize).checked_sub(first), shown.get(v as usize))
        {
            lights[own] = std::array::from_fn(|i| lights[own][i] + light[i]);
        }
    }
    for (v, [r, g, b, opacity]) in (first..).zip(lights) {
        let colour = match opacity > 0.0 {
            true => [r, g, b].map(|light| (light / opacity).clamp(0.0, 1.0)),
            false => [NO_LIGHT; COLOURS],
        };
        mesh.channels[v * mesh.n_channels..][..COLOURS].copy_from_slice(&colour);
    }
    let triangles = tile.mesh.triangles.iter().map(|t| t.map(|v| place[v as usize]));
    mesh.triangles.extend(triangles);
}

fn read(
    folder: &Path,
    name: &str,
    scalars: &[TileScalar],
    most_bytes: u64,
) -> std::result::Result<(StoredTile, TileBorder), String> {
    let bytes =
        read_regular(&folder.join(name), most_bytes).map_err(|e| format!("cannot be read: {e}"))?;
    // The decoder of compressed data checks by panicking in places.
    let mut tile = guarded(|| Ok(decode_tile_within(&bytes, most_bytes)))
        .map_err(|_| "its data is damaged".to_owned())??;
    tile.take_scalars(scalars)?;
    let (border, n) = border_path(name).ok_or("its name is not that of a tile")?;
    let bytes = read_regular(&folder.join(&border), most_bytes / 16).map_err(|e| {
        format!(
            "{border}, the numbers of its vertices, cannot be read: {e} (copy the folder whole)"
        )
    })?;
    let mut tiles = decode_borders(&bytes).map_err(|what| format!("{border}: {what}"))?;
    if n >= tiles.len() {
        return Err(format!("{border} has {} tiles, this is number {n}", tiles.len()));
    }
    Ok((tile, tiles.swap_remove(n)))
}
