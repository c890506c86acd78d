//! Joins the tiles of a cut into one mesh: what several of them have is one vertex by its number in the input.

use super::tree::{Cut, Tree};
use crate::error::{Error, Result};
use crate::io::tileset::{TileBorder, border_path, decode_borders};
use crate::io::{StoredTile, decode_tile};
use crate::mesh::Mesh;
use crate::mesh::global_vertex::GlobalVertex;
use crate::system::parallel::{guarded, in_order};
use crate::system::progress::Progress;
use crate::system::units::show_bytes;
use std::collections::HashMap;
use std::path::Path;

/// Bytes of a vertex, of a triangle, and of a vertex that several tiles have, while tiles are joined; lists may be twice as
/// long as what is in them while they grow.
const VERTEX_BYTES: u64 = 2 * 24;
const CHANNEL_BYTES: u64 = 2 * 12;
const TRIANGLE_BYTES: u64 = 2 * 12;
const BORDER_BYTES: u64 = 48;

/// A tile with the numbers of its vertices.
#[derive(Default)]
struct Read {
    tile: Option<(StoredTile, TileBorder)>,
}

/// Bytes for joining vertices and triangles.
pub(super) fn join_bytes(vertices: u64, triangles: u64, has_colours: bool) -> u64 {
    let channels = if has_colours { CHANNEL_BYTES } else { 0 };
    vertices * (VERTEX_BYTES + channels) + triangles * TRIANGLE_BYTES
}

/// Reads the tiles of a cut and joins them. Linear colours become three channels.
///
/// Errors: `BadInput` for a tile that cannot be read, `NoMemory` if the mesh outgrows `memory_bytes`.
pub(super) fn join(
    folder: &Path,
    (tree, cut): (&Tree, &Cut),
    threads: usize,
    memory_bytes: u64,
    progress: &Progress,
) -> Result<Mesh> {
    let mut mesh = Mesh::default();
    let mut known: HashMap<GlobalVertex, u32> = HashMap::new();
    mesh.triangles.reserve_exact(cut.triangles as usize);
    let name = |index: u64| tree.nodes[cut.tiles[index as usize]].content.as_deref().unwrap_or("");
    in_order(
        cut.tiles.len() as u64,
        threads,
        progress,
        |index, out: &mut Read| {
            out.tile = Some(read(folder, name(index)).map_err(|what| {
                let what =
                    format!("{}: {what}; see what 'stonecut info --check' finds", name(index));
                Error::bad_input(folder, what)
            })?);
            Ok(())
        },
        |index, out| {
            let Some((tile, border)) = out.tile.take() else { return Ok(()) };
            let first = mesh.positions.is_empty();
            if first && !tile.mesh.colours.is_empty() {
                mesh.n_channels = 3;
            }
            if (mesh.n_channels == 3) == tile.mesh.colours.is_empty()
                && !tile.mesh.positions.is_empty()
            {
                let what =
                    format!("{}: it differs from other tiles in having colours", name(index));
                return Err(Error::bad_input(folder, what));
            }
            add(&mut mesh, &mut known, &tile, &border, tree.origin);
            let (vertices, triangles) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
            let bytes = join_bytes(vertices, triangles, mesh.n_channels > 0)
                + BORDER_BYTES * known.len() as u64;
            progress.add(tile.mesh.triangles.len() as u64);
            match bytes > memory_bytes || vertices >= u64::from(u32::MAX) {
                true => Err(Error::NoMemory(format!(
                    "the mesh takes more than {} of memory after {triangles} of {} triangles; give more --memory or a coarser cut",
                    show_bytes(memory_bytes),
                    cut.triangles
                ))),
                false => Ok(()),
            }
        },
    )?;
    Ok(mesh)
}

fn add(
    mesh: &mut Mesh,
    known: &mut HashMap<GlobalVertex, u32>,
    tile: &StoredTile,
    border: &TileBorder,
    origin: [f64; 3],
) {
    let mut numbers = border.iter().copied().peekable();
    let mut place = Vec::with_capacity(tile.mesh.positions.len());
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
            }
        }
    }
    let triangles = tile.mesh.triangles.iter().map(|t| t.map(|v| place[v as usize]));
    mesh.triangles.extend(triangles);
}

fn read(folder: &Path, name: &str) -> std::result::Result<(StoredTile, TileBorder), String> {
    let bytes = std::fs::read(folder.join(name)).map_err(|e| format!("cannot be read: {e}"))?;
    // The decoder of compressed data checks by panicking in places.
    let tile =
        guarded(|| Ok(decode_tile(&bytes))).map_err(|_| "its data is damaged".to_owned())??;
    let (border, n) = border_path(name).ok_or("its name is not that of a tile")?;
    let bytes = std::fs::read(folder.join(&border)).map_err(|e| {
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
