//! LabelledRegions of a mesh whose faces have labels: volume, and edges at which the surface of a region is open.
//!
//! A pass over the faces and a sort of their edges on disk. An edge is open for a region by as much as the region's faces that
//! run along it one way outnumber those that run the other way. Reads the file as it is; no cells.

use std::collections::HashMap;
use std::path::Path;
use stonecut_io::ExternalSort;
use stonecut_io::FaceLabels;
use stonecut_io::ply::MeshSource;
use stonecut_mesh::property::Scalar;
use stonecut_mesh::vec3::{cross, dot, sub};
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// More regions are not told apart: labels like these are numbers of faces.
const MOST_REGIONS: usize = 1 << 20;
/// LabelledRegions in the answer.
const MOST_LISTED: usize = 10_000;
/// More memory makes no sort of edges faster.
const MOST_SORT_BYTES: u64 = 256 << 20;

/// LabelledRegions in numbers, as `info --check` reports them.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct LabelledRegions {
    /// Names of the properties that are the labels.
    pub properties: Vec<String>,
    /// Number of regions; the outside is not one.
    pub found: u64,
    /// Edges at which the surface of a region is open, summed over regions.
    pub open_edges: u64,
    /// Volume of all regions.
    pub volume: f64,
    /// The largest regions, by volume.
    pub largest: Vec<LabelledRegion>,
}

/// One region.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct LabelledRegion {
    /// Its label.
    pub label: i64,
    /// Triangles of its surface.
    pub triangles: u64,
    /// Volume within its surface, where that is closed; negative where it is turned inside out.
    pub volume: f64,
    /// Edges at which its surface is open.
    pub open_edges: u64,
}

/// Room for counting regions.
#[derive(Clone, Copy, Debug)]
pub struct RegionLimits<'a> {
    /// Folder for what does not fit into memory.
    pub temp_dir: &'a Path,
    /// Memory to use, in bytes.
    pub memory_bytes: u64,
}

/// Counts the regions of faces with labels; `None` without labels, or with more of them than regions can be.
///
/// Memory: that of the options, and 80 bytes a region. Disk: 48 bytes a triangle where the sort does not fit.
/// Faces with one label are the surface of one region; `left` and `right` are behind and in front of a face.
pub fn regions(
    source: &MeshSource,
    options: RegionLimits,
    progress: &Progress,
) -> Result<Option<LabelledRegions>> {
    let Some(labels) = FaceLabels::of(source) else { return Ok(None) };
    if u32::try_from(source.n_vertices()).is_err() {
        progress.note("regions: of more than 2^32 vertices they are not counted".to_owned());
        return Ok(None);
    }
    let sort_bytes = (options.memory_bytes / 4).min(MOST_SORT_BYTES);
    let mut edges = ExternalSort::<4>::new(options.temp_dir, sort_bytes as usize);
    let mut places = Places::new(source, options.memory_bytes / 2)?;
    let origin = if source.n_vertices() > 0 { places.of(0)? } else { [0.0; 3] };
    // Numbers from 1 on, by first use.
    let mut numbers: HashMap<i64, u32> = HashMap::new();
    let mut list: Vec<LabelledRegion> = Vec::new();
    progress.begin("regions", 1, 1, source.n_triangles());
    labels.each_block(source, |block, sides| {
        progress.check()?;
        progress.add(block.triangles.len() as u64);
        if list.len() > MOST_REGIONS {
            return Ok(());
        }
        for (&corners, sides) in block.triangles.iter().zip(sides) {
            let mut number = |side: Option<i64>| {
                let Some(label) = side else { return 0 };
                let next = list.len() as u32 + 1;
                let number = *numbers.entry(label).or_insert(next);
                if number == next {
                    list.push(LabelledRegion { label, ..LabelledRegion::default() });
                }
                number
            };
            let [behind, before] = sides.map(&mut number);
            if behind == before {
                // The same region on both sides: a face within it.
                continue;
            }
            let [a, b, c] =
                [places.of(corners[0])?, places.of(corners[1])?, places.of(corners[2])?]
                    .map(|place| sub(place, origin));
            let volume = dot(a, cross(b, c)) / 6.0;
            for (number, sign) in [(behind, 1.0), (before, -1.0)] {
                if let Some(region) = list.get_mut((number as usize).wrapping_sub(1)) {
                    region.triangles += 1;
                    region.volume += sign * volume;
                }
            }
            let [a, b, c] = corners.map(|v| v as u32);
            for (from, to) in [(a, b), (b, c), (c, a)] {
                edges.push(match from < to {
                    true => [from, to, behind, before],
                    false => [to, from, before, behind],
                })?;
            }
        }
        Ok(())
    })?;
    if list.len() > MOST_REGIONS {
        progress.note(format!(
            "regions: {} has more than {MOST_REGIONS} labels: they are not counted",
            labels.names.join(" and ")
        ));
        return Ok(None);
    }
    let mut edge = [0; 2];
    // LabelledRegions of one edge with the way in which a face of theirs runs along it.
    let mut ways: Vec<(u32, i64)> = Vec::new();
    let mut settle = |ways: &mut Vec<(u32, i64)>| {
        ways.sort_unstable();
        for run in ways.chunk_by(|a, b| a.0 == b.0) {
            let balance: i64 = run.iter().map(|(_, way)| way).sum();
            list[run[0].0 as usize - 1].open_edges += balance.unsigned_abs();
        }
        ways.clear();
    };
    edges.drain(|[from, to, ahead, back]| {
        if edge != [from, to] {
            settle(&mut ways);
            edge = [from, to];
        }
        ways.extend([(ahead, 1), (back, -1)].into_iter().filter(|(number, _)| *number > 0));
        Ok(())
    })?;
    settle(&mut ways);
    let mut found = LabelledRegions {
        properties: labels.names.clone(),
        found: list.len() as u64,
        open_edges: list.iter().map(|region| region.open_edges).sum(),
        volume: list.iter().map(|region| region.volume).sum(),
        largest: Vec::new(),
    };
    list.sort_by(|a, b| b.volume.total_cmp(&a.volume).then(a.label.cmp(&b.label)));
    list.truncate(MOST_LISTED);
    found.largest = list;
    Ok(Some(found))
}

/// Positions by the number of a vertex: in memory where they fit, else looked up in the file.
enum Places<'a> {
    Single(Vec<[f32; 3]>),
    Double(Vec<[f64; 3]>),
    File(stonecut_io::ply::lookup::Lookup<'a>),
}

impl<'a> Places<'a> {
    fn new(source: &'a MeshSource, memory_bytes: u64) -> Result<Places<'a>> {
        let is_single = source.schema().coordinate == Scalar::F32;
        let row_bytes = if is_single { 12 } else { 24 };
        if source.n_vertices().saturating_mul(row_bytes) > memory_bytes {
            return source.positions().map(Places::File);
        }
        let (mut single, mut double) = (Vec::new(), Vec::new());
        source.each_vertex(|_, record| {
            let place = source.schema().position(record);
            if is_single {
                single.push(place.map(|x| x as f32))
            } else {
                double.push(place)
            }
            Ok(())
        })?;
        Ok(if is_single { Places::Single(single) } else { Places::Double(double) })
    }

    fn of(&mut self, vertex: u64) -> Result<[f64; 3]> {
        match self {
            Places::Single(list) => Ok(list[vertex as usize].map(f64::from)),
            Places::Double(list) => Ok(list[vertex as usize]),
            Places::File(lookup) => lookup.position(vertex),
        }
    }
}
