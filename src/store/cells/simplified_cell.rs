//! Simplified cells: one chunk a cell, in the order they were finished.
//!
//! A chunk holds counts, the cell's statistics, ids, shared marks, vertex rows (record, channels) and local
//! triangles. Finished cells survive a crash; the writer continues behind the last whole chunk.

use super::cell_store::{CellTally, VertexLayout};
use super::group_record::GroupRecord;
use super::origins;
use super::pack::{Pack, PackWriter};
use crate::cell_id::CellId;
use crate::cells::cell_mesh::{CellMesh, Dropped};
use crate::pack_format::{Chunk, ChunkKind};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use stonecut_kernel::{FitStatistics, Quality, QualityAt, Simplified, Statistics};
use stonecut_mesh::Mesh;
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_system::disk::Disk;
use stonecut_system::error::{Error, Result};

/// A pack of survivors: some cells, one after the other by number.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SurvivorFile {
    /// File name of the pack in the job folder.
    pub pack: String,
    /// Sealed length of the pack.
    pub pack_bytes: u64,
    /// The first of its cells; the last is the one before the first of the next pack.
    pub first_cell: CellId,
}

/// The sealed description of survivors: of all cells of a round, or of a part of them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SurvivorInfo {
    /// The packs, by their cells; more than one if several processes have worked on the round.
    pub packs: Vec<SurvivorFile>,
    /// Per cell, from the first of the packs on: vertices and triangles left.
    pub cells: Vec<CellTally>,
    /// Triangles left in all cells.
    pub triangles: u64,
    /// Statistics of the kernel over all cells.
    pub statistics: CellStatistics,
}

impl SurvivorInfo {
    /// Joins the parts of a round, in the order of their cells.
    pub fn joined(parts: impl IntoIterator<Item = SurvivorInfo>) -> SurvivorInfo {
        let statistics = CellStatistics::of_none();
        let mut whole = SurvivorInfo { statistics, ..SurvivorInfo::default() };
        for part in parts {
            whole.packs.extend(part.packs);
            whole.cells.extend(part.cells);
            whole.triangles += part.triangles;
            whole.statistics.add(part.statistics);
        }
        whole
    }
}

/// One simplified cell.
#[derive(Clone, Debug, Default)]
pub struct Survivors {
    /// Input vertex index of each vertex.
    pub ids: Vec<GlobalVertex>,
    /// True if another cell of the same round holds the same vertex.
    pub shared: Vec<bool>,
    /// The record of each vertex with its present position; further properties as first read.
    pub records: Vec<u8>,
    /// Geometry and channels.
    pub mesh: Mesh,
    /// Statistics of the kernel.
    pub statistics: CellStatistics,
    /// For each vertex of the cell as it was loaded the vertex that it went into, with `kernel::Options::follow`; not
    /// on disk.
    pub followed: Vec<u32>,
    /// The origins of the vertices as rows on disk, if the layout has them; read back by `SurvivorPack::origins` alone.
    pub origins: Vec<u8>,
}

/// The kernel's statistics as they are kept with a cell, or the sum of several.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CellStatistics {
    /// Collapses carried out.
    pub collapses: u64,
    /// Refused collapses by reason.
    pub rejects: Vec<(String, u64)>,
    /// Counts of cleaning and of changes of the topology, by kind.
    #[serde(default)]
    pub changes: Vec<(String, u64)>,
    /// True if the stop was reached.
    pub reached: bool,
    /// Largest distance from the input as a bound saw it, in input units; 0 without one.
    #[serde(default)]
    pub reach: f64,
    /// Statistics of the fit, if there was one.
    #[serde(default)]
    pub fit: Option<FitStatistics>,
    /// Counts of what was left out of the cell before.
    #[serde(default)]
    pub dropped: Dropped,
    /// Charts of a texture that vanished.
    #[serde(default)]
    pub charts_vanished: u64,
    /// Estimated quality of the result.
    #[serde(default)]
    pub quality: Quality,
    /// The same on the way down; of a finish only, empty for cells.
    #[serde(default)]
    pub curve: Vec<QualityAt>,
    /// Vertices on attribute seams that are left; one that several cells hold counts in each.
    #[serde(default)]
    pub seam_vertices: u64,
    /// True if no triangle that is left has an area.
    #[serde(default)]
    pub is_flat: bool,
    /// Facts about the groups of a tree of tiles, a group for each cell; none in other jobs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<GroupRecord>,
    /// Digest of what the result of a cell depends on, for another attempt at a bound; empty in sums, and elsewhere.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub key: String,
}

impl From<&Statistics> for CellStatistics {
    fn from(statistics: &Statistics) -> Self {
        let named = |counts: &[(&str, u64)]| {
            counts.iter().map(|(name, n)| ((*name).to_owned(), *n)).collect()
        };
        CellStatistics {
            collapses: statistics.collapses,
            rejects: named(&statistics.rejects),
            changes: named(&statistics.changes),
            reached: statistics.reached,
            reach: statistics.reach,
            fit: statistics.fit,
            charts_vanished: statistics.charts_vanished,
            quality: statistics.quality.unwrap_or_default(),
            curve: statistics.curve.clone(),
            seam_vertices: statistics.seam_vertices,
            ..CellStatistics::default()
        }
    }
}

impl CellStatistics {
    /// Those of no cell, to which others are added.
    fn of_none() -> CellStatistics {
        CellStatistics { reached: true, is_flat: true, ..CellStatistics::default() }
    }

    /// Adds those of another cell.
    fn add(&mut self, other: CellStatistics) {
        self.collapses += other.collapses;
        self.reached &= other.reached;
        self.reach = self.reach.max(other.reach);
        self.fit = match (self.fit, other.fit) {
            (Some(own), Some(other)) => Some(own.with(&other)),
            (own, other) => own.or(other),
        };
        self.dropped += other.dropped;
        self.charts_vanished += other.charts_vanished;
        self.quality.add(&other.quality);
        self.curve.extend(other.curve);
        self.seam_vertices += other.seam_vertices;
        self.is_flat &= other.is_flat;
        self.groups.extend(other.groups);
        add_named(&mut self.rejects, other.rejects);
        add_named(&mut self.changes, other.changes);
    }
}

impl Survivors {
    /// A cell as it was loaded.
    pub fn all_of(cell: CellMesh, layout: &VertexLayout) -> Survivors {
        let CellMesh { ids, records, shared, mesh, dropped } = cell;
        let is_flat = !mesh.has_area(layout.schema.rounding());
        let statistics =
            CellStatistics { reached: true, dropped, is_flat, ..CellStatistics::default() };
        let origins = origins::of_all(&ids, layout);
        Survivors { ids, shared, records, mesh, statistics, origins, ..Survivors::default() }
    }

    /// Turns the kernel's result for `cell` into rows; positions go back into the records, in the input's type.
    pub fn new(
        ids: &[GlobalVertex],
        shared: &[bool],
        records: &[u8],
        simplified: Simplified,
        layout: &VertexLayout,
    ) -> Survivors {
        let record_bytes = layout.schema.record_bytes();
        let position_bytes = layout.schema.position_bytes();
        let mut out = Survivors {
            statistics: CellStatistics::from(&simplified.statistics),
            ids: Vec::with_capacity(simplified.source.len()),
            shared: Vec::with_capacity(simplified.source.len()),
            records: Vec::with_capacity(simplified.source.len() * record_bytes),
            mesh: simplified.mesh,
            followed: simplified.followed,
            ..Survivors::default()
        };
        for (vertex, &source) in simplified.source.iter().enumerate() {
            out.ids.push(ids[source as usize]);
            out.shared.push(shared[source as usize]);
            let like = simplified.models.of(source) as usize;
            let record = &records[like * record_bytes..(like + 1) * record_bytes];
            layout.schema.encode_position(out.mesh.positions[vertex], &mut out.records);
            out.records.extend_from_slice(&record[position_bytes..]);
        }
        out.statistics.is_flat = !out.mesh.has_area(layout.schema.rounding());
        out.origins = origins::of((ids, records), &mut out.followed, &out.ids, layout);
        out
    }

    fn tally(&self) -> CellTally {
        CellTally { vertices: self.ids.len() as u64, triangles: self.mesh.triangles.len() as u64 }
    }

    /// Bytes on disk.
    pub fn encode(&self, layout: &VertexLayout) -> Vec<u8> {
        let statistics = serde_json::to_vec(&self.statistics).expect("plain data");
        let n_channels = layout.n_channels();
        let record_bytes = layout.schema.record_bytes();
        let rows = self.ids.len() * (9 + record_bytes + 4 * n_channels);
        let mut out = Vec::with_capacity(
            24 + statistics.len()
                + rows
                + layout.survivor_triangle_bytes() * self.mesh.triangles.len(),
        );
        for count in [self.ids.len(), self.mesh.triangles.len(), statistics.len()] {
            out.extend_from_slice(&(count as u64).to_le_bytes());
        }
        out.extend_from_slice(&statistics);
        self.ids.iter().for_each(|id| out.extend_from_slice(&id.0.to_le_bytes()));
        out.extend(self.shared.iter().map(|&shared| u8::from(shared)));
        out.extend_from_slice(&self.records);
        self.mesh.channels.iter().for_each(|value| out.extend_from_slice(&value.to_le_bytes()));
        for triangle in &self.mesh.triangles {
            triangle.iter().for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
        }
        for triangle in 0..self.mesh.triangles.len() {
            layout.push_original(&self.mesh, triangle, &mut out);
        }
        out
    }

    fn decode(bytes: &[u8], layout: &VertexLayout) -> Option<Survivors> {
        let mut rest = bytes;
        let mut take = |n: usize| -> Option<&[u8]> {
            let (head, tail) = rest.split_at_checked(n)?;
            rest = tail;
            Some(head)
        };
        let u64_of = |b: &[u8]| u64::from_le_bytes(b.try_into().expect("8 bytes"));
        let (n_vertices, n_triangles, n_statistics) =
            (u64_of(take(8)?) as usize, u64_of(take(8)?) as usize, u64_of(take(8)?) as usize);
        let statistics = serde_json::from_slice(take(n_statistics)?).ok()?;
        let n_channels = layout.n_channels();
        let ids = take(n_vertices.checked_mul(8)?)?.chunks_exact(8);
        let ids = ids.map(|id| GlobalVertex(u64_of(id))).collect();
        let shared = take(n_vertices)?.iter().map(|&b| b != 0).collect();
        let records = take(n_vertices.checked_mul(layout.schema.record_bytes())?)?.to_vec();
        let positions = records
            .chunks_exact(layout.schema.record_bytes())
            .map(|record| layout.schema.position(record))
            .collect();
        let channels = take(n_vertices.checked_mul(4 * n_channels)?)?
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect();
        let corner = |b: &[u8]| u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        let triangles: Vec<[u32; 3]> = take(n_triangles.checked_mul(12)?)?
            .chunks_exact(12)
            .map(|b| [corner(&b[0..4]), corner(&b[4..8]), corner(&b[8..12])])
            .collect();
        if triangles.as_flattened().iter().any(|&v| v as usize >= n_vertices) {
            return None;
        }
        let mut mesh = Mesh { positions, channels, n_channels, triangles, ..Mesh::default() };
        let original_bytes = layout.survivor_triangle_bytes() - 12;
        let original = take(n_triangles.checked_mul(original_bytes)?)?;
        for row in original.chunks_exact(original_bytes.max(1)) {
            layout.read_original(row, &mut mesh);
        }
        Some(Survivors { ids, shared, records, mesh, statistics, ..Survivors::default() })
    }
}

/// Bytes on disk of survivors, but for counts and statistics: id, mark, record and channels; three corners, relief.
pub fn survivor_bytes(tally: CellTally, layout: &VertexLayout) -> u64 {
    tally.vertices * (9 + layout.row_bytes(true)) as u64
        + layout.survivor_triangle_bytes() as u64 * tally.triangles
}

/// Writes survivors as cells are finished, from several threads behind one lock.
#[derive(Debug)]
pub struct SurvivorWriter {
    name: String,
    pack: PackWriter,
    layout: VertexLayout,
    /// Tallies of the cells that were appended by this process.
    appended: BTreeMap<CellId, (CellTally, CellStatistics)>,
}

impl SurvivorWriter {
    /// Begins or continues the pack `name` in `folder`.
    pub fn open(disk: &Disk, folder: &Path, name: &str, layout: &VertexLayout) -> Result<Self> {
        let path = folder.join(name);
        let is_there = std::fs::metadata(&path).is_ok_and(|meta| meta.len() > 16);
        let pack = if is_there {
            PackWriter::reopen(disk, &path)?
        } else {
            PackWriter::create(disk, &path)?
        };
        let appended = BTreeMap::new();
        Ok(SurvivorWriter { name: name.to_owned(), pack, layout: layout.clone(), appended })
    }

    /// The cells that are already in the pack.
    pub fn finished(&self) -> Vec<CellId> {
        let whole = self.pack.chunks().iter().filter(|chunk| chunk.kind == ChunkKind::Survivors);
        whole.map(|chunk| chunk.cell).collect()
    }

    /// Opens the cells that are already in the pack, of `n_cells`, for reading.
    pub fn reader(&mut self, disk: &Disk, n_cells: usize) -> Result<SurvivorPack> {
        let packs = vec![self.pack.reader(disk, n_cells)?];
        let file = SurvivorFile { pack: self.name.clone(), ..SurvivorFile::default() };
        let info = SurvivorInfo { packs: vec![file], ..SurvivorInfo::default() };
        Ok(SurvivorPack { info, layout: self.layout.clone(), packs })
    }

    /// Appends one cell.
    pub fn append(&mut self, cell: CellId, survivors: &Survivors) -> Result<()> {
        self.append_encoded(cell, survivors, &survivors.encode(&self.layout))
    }

    /// Appends one cell that was encoded before, which needs no lock.
    pub fn append_encoded(
        &mut self,
        cell: CellId,
        survivors: &Survivors,
        encoded: &[u8],
    ) -> Result<()> {
        // The last chunk of a cell is that of its survivors: only with it the cell is done.
        if self.layout.has_origins {
            self.pack.append(cell, ChunkKind::Origins, &survivors.origins)?;
        }
        self.pack.append(cell, ChunkKind::Survivors, encoded)?;
        self.appended.insert(cell, (survivors.tally(), survivors.statistics.clone()));
        self.pack.flush()
    }

    /// Bytes in the pack so far.
    pub fn length(&self) -> u64 {
        self.pack.length()
    }

    /// Makes the cells appended so far durable.
    pub fn sync(&mut self) -> Result<()> {
        self.pack.sync()
    }

    /// Seals the pack; every one of `cells` must be in it.
    pub fn finish(
        mut self,
        disk: &Disk,
        folder: &Path,
        cells: Range<usize>,
    ) -> Result<SurvivorInfo> {
        self.pack.seal()?;
        disk.sync_folder_of(&folder.join(&self.name))?;
        let mut info = SurvivorInfo {
            packs: vec![SurvivorFile {
                pack: self.name,
                pack_bytes: self.pack.length(),
                first_cell: CellId::at(cells.start),
            }],
            cells: vec![CellTally::default(); cells.len()],
            statistics: CellStatistics::of_none(),
            ..SurvivorInfo::default()
        };
        drop(self.pack);
        let pack = SurvivorPack::open(disk, folder, info.clone(), self.layout)?;
        for (place, cell) in cells.map(CellId::at).enumerate() {
            let (tally, statistics) = match self.appended.remove(&cell) {
                Some(known) => known,
                None => {
                    let survivors = pack.load(cell)?;
                    (survivors.tally(), survivors.statistics)
                }
            };
            info.cells[place] = tally;
            info.triangles += tally.triangles;
            info.statistics.add(statistics);
        }
        Ok(info)
    }
}

/// Adds counts to those of the same names.
fn add_named(sums: &mut Vec<(String, u64)>, counts: Vec<(String, u64)>) {
    for (name, n) in counts {
        match sums.iter_mut().find(|(known, _)| *known == name) {
            Some((_, sum)) => *sum += n,
            None => sums.push((name, n)),
        }
    }
}

/// Survivors opened for reading.
#[derive(Debug)]
pub struct SurvivorPack {
    info: SurvivorInfo,
    layout: VertexLayout,
    packs: Vec<Pack>,
}

impl SurvivorPack {
    /// Opens sealed packs of survivors.
    pub fn open(
        disk: &Disk,
        folder: &Path,
        info: SurvivorInfo,
        layout: VertexLayout,
    ) -> Result<Self> {
        let first = info.packs.first().map_or(0, |file| file.first_cell.index());
        let ends = info.packs.iter().skip(1).map(|file| file.first_cell);
        let ends = ends.chain(std::iter::once(CellId::at(first + info.cells.len())));
        let n_triangles = info.cells.iter().try_fold(0u64, |sum, t| sum.checked_add(t.triangles));
        if n_triangles != Some(info.triangles) && info.triangles > 0 {
            let name = info.packs.first().map_or("the survivors", |file| file.pack.as_str());
            let what =
                "has another number of triangles than its record says; run again with --restart";
            return Err(Error::corrupt(folder.join(name), what));
        }
        let open = |(file, end): (&SurvivorFile, CellId)| {
            Pack::open_some(disk, &folder.join(&file.pack), file.first_cell..end, file.pack_bytes)
        };
        let packs = info.packs.iter().zip(ends).map(open).collect::<Result<_>>()?;
        Ok(SurvivorPack { info, layout, packs })
    }

    /// The sealed description.
    pub fn info(&self) -> &SurvivorInfo {
        &self.info
    }

    /// The row layout.
    pub fn layout(&self) -> &VertexLayout {
        &self.layout
    }

    /// Loads what is left of one cell, which is to have as many triangles as was recorded.
    pub fn load_recorded(&self, cell: CellId) -> Result<Survivors> {
        let survivors = self.load(cell)?;
        if self.info.cells.get(cell.index()) == Some(&survivors.tally()) {
            return Ok(survivors);
        }
        let pack = self.info.packs.first().map_or("the survivors", |file| file.pack.as_str());
        let what =
            format!("cell {cell} has other rows than its record says; run again with --restart");
        Err(Error::corrupt(Path::new(pack), what))
    }

    /// Loads what is left of one cell.
    pub fn load(&self, cell: CellId) -> Result<Survivors> {
        let (file, offset, payload) = self.read(cell, ChunkKind::Survivors)?;
        Survivors::decode(&payload, &self.layout).ok_or_else(|| {
            let what =
                format!("byte {offset}: cell {cell} makes no sense; run again with --restart");
            Error::corrupt(Path::new(&file.pack), what)
        })
    }

    /// Loads the origins of one cell: each vertex that became one of its survivors, and that one.
    pub fn origins(&self, cell: CellId) -> Result<Vec<[GlobalVertex; 2]>> {
        let (_, _, payload) = self.read(cell, ChunkKind::Origins)?;
        Ok(origins::read(&payload, &self.layout))
    }

    /// Reads the last chunk of a kind that a cell has; gives its file and place as well.
    fn read(&self, cell: CellId, kind: ChunkKind) -> Result<(&SurvivorFile, u64, Vec<u8>)> {
        let at = self.info.packs.partition_point(|file| file.first_cell <= cell);
        let at = at
            .checked_sub(1)
            .ok_or_else(|| Error::corrupt("the survivors", format!("begin after cell {cell}")))?;
        let (file, pack) = (&self.info.packs[at], &self.packs[at]);
        let of_kind = |chunk: &&Chunk| chunk.kind == kind;
        let chunk = pack.chunks_of(cell).iter().rfind(of_kind).ok_or_else(|| {
            let what = format!("cell {cell} is missing; run again with --restart");
            Error::corrupt(Path::new(&file.pack), what)
        })?;
        let mut payload = Vec::new();
        pack.read(chunk, &mut payload)?;
        Ok((file, chunk.offset, payload))
    }
}
