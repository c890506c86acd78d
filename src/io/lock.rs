//! Marks the vertices that must stay bit for bit: those on the boundary, or where a property is not 0.
//!
//! A property of vertices is enough as it is. For the boundary the mesh is written again with one more property of vertices,
//! which results leave out. Vertices in exactly one place count as one: seams of a texture do not count.

use super::open_edges::{each_edge, each_open, hash};
use super::open_options::{Lock, StageOptions};
use super::restaged::{face_rows, restage};
use crate::ply::{LockedBy, MeshSource};
use std::collections::HashMap;
use stonecut_mesh::property::{Property, Scalar};
use stonecut_system::error::{Error, Result};

/// Name of the property for the boundary, in staged files only.
const NAME: &str = "stonecut_lock";

/// Marks what `options.lock` says; otherwise the source as it is.
///
/// Memory for the boundary: 64 bytes for each of its vertices. Disk: the staged mesh.
pub(super) fn lock(mut source: MeshSource, options: &StageOptions) -> Result<MeshSource> {
    match &options.lock {
        None => Ok(source),
        Some(Lock::Property(name)) => {
            if source.schema().own_property(name).is_none() {
                let names: Vec<&str> =
                    source.schema().properties.iter().map(|p| p.name.as_str()).collect();
                return Err(Error::Usage(format!(
                    "--lock {name}: vertices of {} have no such property; they have {}; give one of them, or boundary",
                    source.path().display(),
                    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
                )));
            }
            source.note_lock(LockedBy { property: name.clone(), is_ours: false });
            Ok(source)
        }
        Some(Lock::Boundary) => with_boundary(source, options),
    }
}

fn with_boundary(source: MeshSource, options: &StageOptions) -> Result<MeshSource> {
    let locked = boundary(&source, options)?;
    let mut schema = source.schema().clone();
    let mut name = NAME.to_owned();
    while schema.own_property(&name).is_some() {
        name.push('_');
    }
    schema.properties.push(Property::new(&name, Scalar::U8));
    let mut locked = locked.into_iter().peekable();
    let mut vertices = options.spool();
    let mut row = Vec::new();
    source.each_vertex(|v, record| {
        row.clear();
        row.extend_from_slice(record);
        row.push(u8::from(locked.next_if_eq(&v).is_some()));
        vertices.write(&row)
    })?;
    let n_vertices = source.n_vertices();
    let vertices = vertices.finish(source.path())?;
    let Some(faces) = face_rows(&source, options)? else {
        let what = "--lock boundary: it has a face of more than 127 corners; triangulate it first";
        return Err(Error::bad_input(source.path(), what));
    };
    let lock = Some(LockedBy { property: name, is_ours: true });
    restage(source, schema, (n_vertices, vertices), faces, options, |staged| staged.lock = lock)
}

/// The vertices on the boundary, ascending.
fn boundary(source: &MeshSource, options: &StageOptions) -> Result<Vec<u64>> {
    let memory_bytes = (options.memory_bytes / 3) as usize;
    let mut open = Vec::new();
    each_open(source, memory_bytes, |v| {
        open.push(v);
        match 64 * open.len() <= options.memory_bytes as usize {
            true => Ok(()),
            false => Err(Error::Usage(format!(
                "--lock boundary: more than {} vertices of {} are at open edges, which {} bytes of memory do not hold; \
                 give a larger --memory, or a property of vertices",
                open.len(),
                source.path().display(),
                options.memory_bytes
            ))),
        }
    })?;
    // The first vertex in each place stands for all.
    let mut places = source.positions()?;
    let mut first_at: HashMap<[u64; 3], u32> = HashMap::with_capacity(open.len());
    let mut first = Vec::with_capacity(open.len());
    for (i, &v) in open.iter().enumerate() {
        // Adding 0 makes -0 and 0 the same place.
        let place = places.position(v)?.map(|x| (x + 0.0).to_bits());
        first.push(*first_at.entry(place).or_insert(i as u32));
    }
    if first_at.len() == open.len() {
        return Ok(open);
    }
    drop(first_at);
    let mut sums = vec![0u32; open.len()];
    let mut is_open = vec![0u64; source.n_vertices().div_ceil(64) as usize];
    open.iter().for_each(|&v| is_open[(v / 64) as usize] |= 1 << (v % 64));
    each_edge(source, |[a, b], _| {
        let may_be = |v: u64| is_open[(v / 64) as usize] >> (v % 64) & 1 == 1;
        if may_be(a)
            && may_be(b)
            && let (Ok(a), Ok(b)) = (open.binary_search(&a), open.binary_search(&b))
        {
            let (a, b) = (first[a], first[b]);
            let hash = hash(u64::from(a), u64::from(b));
            sums[a as usize] ^= hash;
            sums[b as usize] ^= hash;
        }
    })?;
    let stays = |&(i, _): &(usize, &u64)| sums[first[i] as usize] != 0;
    Ok(open.iter().enumerate().filter(stays).map(|(_, &v)| v).collect())
}
