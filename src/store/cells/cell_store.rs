//! A store of cells: what partitioning (or recutting) leaves on disk for the next round.
//!
//! Every cell is self-contained: its triangles and all their vertices, those it shares with other cells
//! included and marked. Ids are the input's vertex indices, so cells join without comparing floats.

use super::cell_mesh::CellMesh;
use super::id_map::IdMap;
use super::pack::{Pack, PackFile};
use super::pieces::PieceSet;
use crate::cell_id::CellId;
use crate::pack_format::{Chunk, ChunkKind, IdWidth};
use serde::{Deserialize, Serialize};
use std::path::Path;
use stonecut_mesh::Mesh;
use stonecut_mesh::attribute_weights::Weights;
use stonecut_mesh::codec::VertexCodec;
use stonecut_mesh::extremes::Extremes;
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_mesh::property::{Scalar, read_scalar};
use stonecut_mesh::record::VertexSchema;
use stonecut_mesh::relief::Relief;
use stonecut_system::disk::Disk;
use stonecut_system::error::{Error, Result};
use stonecut_system::progress::Progress;

/// Rows of each kind in one cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CellTally {
    /// Vertex rows; a shared vertex may come more than once.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
}

/// The sealed description of a store: enough to open it again.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StoreInfo {
    /// The packs; the chunks of a cell are those of all packs, in this order. More than one if several processes have
    /// made the store.
    pub packs: Vec<PackFile>,
    /// Rows per cell.
    pub cells: Vec<CellTally>,
    /// Vertices used by more than one cell.
    pub shared_vertices: u64,
    /// Triangles in all cells.
    pub triangles: u64,
    /// True if vertex rows carry kernel channels behind the record (all rounds but the first).
    pub has_channels: bool,
    /// Cells that were split: their chunks before `split_at` count no more.
    #[serde(default)]
    pub split: Vec<CellId>,
    /// Place in the last of the packs at which the chunks of split cells begin.
    #[serde(default)]
    pub split_at: u64,
    /// The first of the cells that came behind the others by splitting.
    #[serde(default)]
    pub first_part: CellId,
    /// The pack that says which pieces of cells are left out, a set for each such cell; `cells` and `triangles` count
    /// without their triangles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdicts: Option<PackFile>,
}

impl StoreInfo {
    /// Bytes of all packs.
    pub fn pack_bytes(&self) -> u64 {
        self.packs.iter().map(|file| file.pack_bytes).sum()
    }
}

/// Layout of the vertex rows of a store: id, record as read, and in later rounds the kernel channels.
#[derive(Clone, Debug)]
pub struct VertexLayout {
    /// The input's record.
    pub schema: VertexSchema,
    /// Plan for turning records into channels and back.
    pub codec: VertexCodec,
    /// Width of ids.
    pub ids: IdWidth,
    /// Weight of each channel in the error; empty where nothing is simplified.
    pub weights: Vec<f64>,
    /// True if one more channel says how far the mesh is from the input around each vertex, at most.
    pub has_reach: bool,
    /// True if triangles carry their relief from round to round.
    pub has_relief: bool,
    /// True if cells are kept from passing through themselves while they are simplified.
    pub is_watched: bool,
    /// True if survivors are kept with the origins of their vertices.
    pub has_origins: bool,
    /// Type and place in a record of a property that is not 0 where a vertex must stay.
    pub lock: Option<(Scalar, usize)>,
}

impl VertexLayout {
    /// The layout for an input of `n_vertices` vertices.
    pub fn new(schema: &VertexSchema, n_vertices: u64) -> VertexLayout {
        VertexLayout {
            codec: schema.codec(),
            schema: schema.clone(),
            ids: IdWidth::for_vertices(n_vertices),
            weights: Vec::new(),
            has_reach: false,
            has_relief: false,
            is_watched: false,
            has_origins: false,
            lock: None,
        }
    }

    /// The layout for simplifying: perceptual colours, chosen `labels`, channels with weights.
    pub fn for_kernel(
        schema: &VertexSchema,
        n_vertices: u64,
        labels: &[String],
        weights: &Weights,
    ) -> VertexLayout {
        let codec = schema.kernel_codec(labels);
        let weights = weights.of_channels(&codec.channel_kinds(schema));
        VertexLayout { codec, weights, ..VertexLayout::new(schema, n_vertices) }
    }

    /// Marks the vertices that must stay, by their records.
    pub fn mark_locked(&self, records: &[u8], locked: &mut [bool]) {
        let Some((scalar, at)) = self.lock else { return };
        for (record, locked) in records.chunks_exact(self.schema.record_bytes()).zip(locked) {
            // Written so that NaN locks.
            *locked |= read_scalar(scalar, record, at) != 0.0;
        }
    }

    /// Channels of a vertex: those of its record, and its reach.
    pub fn n_channels(&self) -> usize {
        self.codec.n_channels() + usize::from(self.has_reach)
    }

    /// The channel that says how far the mesh is from the input, if there is one.
    pub fn reach_channel(&self) -> Option<usize> {
        self.has_reach.then(|| self.codec.n_channels())
    }

    /// Returns the number of channels that count in the error.
    pub fn n_weighted(&self) -> usize {
        self.weights.iter().filter(|weight| **weight > 0.0).count()
    }

    /// Bytes of one vertex row without its id.
    pub fn row_bytes(&self, has_channels: bool) -> usize {
        self.schema.record_bytes() + if has_channels { 4 * self.n_channels() } else { 0 }
    }

    /// Bytes of one triangle row of a store: three ids, and what is known of the original in all rounds but the first.
    pub fn triangle_row_bytes(&self, is_later: bool) -> usize {
        3 * self.ids.bytes + if is_later { self.original_bytes() } else { 0 }
    }

    /// Bytes of one triangle among survivors.
    pub fn survivor_triangle_bytes(&self) -> usize {
        12 + self.original_bytes()
    }

    /// Bytes of what is known of the original over a triangle.
    fn original_bytes(&self) -> usize {
        let relief = if self.has_relief { Relief::BYTES } else { 0 };
        relief + if self.has_reach { Extremes::BYTES } else { 0 }
    }

    /// Appends what is known of the original over a triangle of a mesh; nothing, if it lies on it.
    pub fn push_original(&self, mesh: &Mesh, triangle: usize, out: &mut Vec<u8>) {
        if self.has_relief {
            mesh.relief.get(triangle).copied().unwrap_or_default().push(out);
        }
        if self.has_reach {
            mesh.extremes.get(triangle).copied().unwrap_or_default().push(out);
        }
    }

    /// Reads what `push_original` has written, for one more triangle of a mesh.
    pub fn read_original(&self, bytes: &[u8], mesh: &mut Mesh) {
        let mut rest = bytes;
        if self.has_relief {
            mesh.relief.push(Relief::read(rest));
            rest = rest.get(Relief::BYTES..).unwrap_or_default();
        }
        if self.has_reach {
            mesh.extremes.push(Extremes::read(rest));
        }
    }
}

/// A store opened for reading; cells load from any thread.
#[derive(Debug)]
pub struct CellStore {
    info: StoreInfo,
    layout: VertexLayout,
    pack: Pack,
    verdicts: Option<Pack>,
}

/// Peak bytes of loading a cell, beyond the mesh the kernel takes over (counted by the kernel).
pub fn load_bytes(tally: CellTally, layout: &VertexLayout) -> u64 {
    let per_vertex = 8 + 1 + layout.schema.record_bytes() + 24 + 4 * layout.n_channels();
    tally.vertices * per_vertex as u64
        + tally.triangles * layout.survivor_triangle_bytes() as u64
        + IdMap::bytes(tally.vertices)
}

/// Bytes on disk of a vertex row and of a triangle row of a store.
pub fn store_row_bytes(layout: &VertexLayout, has_channels: bool) -> (usize, usize) {
    (layout.ids.bytes + layout.row_bytes(has_channels), layout.triangle_row_bytes(has_channels))
}

impl CellStore {
    /// Opens a sealed store in `folder`.
    pub fn open(
        disk: &Disk,
        folder: &Path,
        info: StoreInfo,
        layout: VertexLayout,
    ) -> Result<CellStore> {
        let n_cells = info.cells.len();
        let pack =
            Pack::open_all(disk, folder, &info.packs, n_cells)?.forget(&info.split, info.split_at);
        let verdicts = match &info.verdicts {
            Some(file) => Some(Pack::open_all(disk, folder, std::slice::from_ref(file), n_cells)?),
            None => None,
        };
        let store = CellStore { info, layout, pack, verdicts };
        store.check_rows(folder)?;
        Ok(store)
    }

    /// Refuses a record that says of a cell more rows than its chunks can have.
    fn check_rows(&self, folder: &Path) -> Result<()> {
        let layout = &self.layout;
        let vertex_bytes = layout.ids.bytes + layout.row_bytes(self.info.has_channels);
        let triangle_bytes = layout.triangle_row_bytes(self.info.has_channels);
        for cell in CellId::first(self.n_cells()) {
            let rows = |kind: ChunkKind, row_bytes: usize| -> u64 {
                let chunks = self.pack.chunks_of(cell).iter().filter(|chunk| chunk.kind == kind);
                chunks.map(|chunk| chunk.bytes / row_bytes as u64).sum()
            };
            let tally = self.info.cells[cell];
            if tally.vertices > rows(ChunkKind::Vertices, vertex_bytes)
                || tally.triangles > rows(ChunkKind::Triangles, triangle_bytes)
            {
                let what = format!(
                    "has fewer rows of cell {cell} than its record says; run again with --restart"
                );
                let pack = self.info.packs.first().map_or(String::new(), |file| file.pack.clone());
                return Err(Error::corrupt(folder.join(pack), what));
            }
        }
        Ok(())
    }

    /// The sealed description.
    pub fn info(&self) -> &StoreInfo {
        &self.info
    }

    /// Number of cells.
    pub fn n_cells(&self) -> usize {
        self.info.cells.len()
    }

    /// The row layout.
    pub fn layout(&self) -> &VertexLayout {
        &self.layout
    }

    /// Rows of a cell as they are loaded, what is left out afterwards included.
    pub fn rows(&self, cell: CellId) -> CellTally {
        let tally = self.info.cells[cell];
        if self.verdicts.is_none() {
            return tally;
        }
        let is_rows = |chunk: &&Chunk| chunk.kind == ChunkKind::Triangles;
        let bytes: u64 =
            self.pack.chunks_of(cell).iter().filter(is_rows).map(|chunk| chunk.bytes).sum();
        let row_bytes = self.layout.triangle_row_bytes(self.info.has_channels);
        CellTally { triangles: bytes / row_bytes as u64, ..tally }
    }

    /// Returns whether a cell is a part of one that was split: such cells do not hold all vertices of a place.
    pub fn is_part(&self, cell: CellId) -> bool {
        !self.info.split.is_empty()
            && (cell >= self.info.first_part || self.info.split.binary_search(&cell).is_ok())
    }

    /// Lets the system begin to read a cell that will soon be loaded.
    pub fn expect(&self, cell: CellId) {
        self.pack.expect(cell);
    }

    /// Gives a cell's bytes back to the file system once its survivors are durable.
    pub fn free(&self, cell: CellId) -> Result<()> {
        self.pack.free(cell)
    }

    /// Loads one cell for simplification: the first round's without repeated faces and idle vertices.
    pub fn load_tidy(&self, cell: CellId) -> Result<CellMesh> {
        let mut mesh = self.load(cell)?;
        if !self.info.has_channels {
            mesh.dropped = mesh.tidy(self.layout.schema.record_bytes());
        }
        Ok(mesh)
    }

    /// Loads one cell without the pieces that are left out. Vertices are in the order of their first row. Triangles
    /// of the first round are in the order of their lowest vertex id, those of later rounds in the order of their
    /// rows.
    ///
    /// Triangles of the first round reach a cell window by window, so the order of their rows depends on how many
    /// vertices a window holds, and that on memory. All triangles of one lowest id come in one window, in the order
    /// of the file: an order by lowest id is the same for every window.
    ///
    /// Errors: `Corrupt` when a chunk is damaged or a triangle names a vertex the cell does not have.
    pub fn load(&self, cell: CellId) -> Result<CellMesh> {
        let mut mesh = self.load_rows(cell)?;
        let Some(verdicts) = &self.verdicts else { return Ok(mesh) };
        for chunk in verdicts.chunks_of(cell) {
            let mut pieces = PieceSet::default();
            verdicts.read(chunk, &mut pieces.0)?;
            if !mesh.leave_out(&pieces, self.layout.schema.record_bytes()) {
                let what = format!(
                    "byte {}: cell {cell} has other pieces; run again with --restart",
                    chunk.offset
                );
                return Err(Error::corrupt(verdicts.path_of(chunk), what));
            }
        }
        Ok(mesh)
    }

    /// True if any triangle has an area. Looks at the first few before it loads whole cells, one after the other.
    pub fn has_area(&self, progress: &Progress) -> Result<bool> {
        let rounding = self.layout.schema.rounding();
        let is_filled = |&cell: &CellId| self.info.cells[cell].triangles > 0;
        let mut filled = CellId::first(self.n_cells()).filter(is_filled).peekable();
        if let Some(&first) = filled.peek()
            && self.first_triangles(first)?.has_area(rounding)
        {
            return Ok(true);
        }
        for cell in filled {
            progress.check()?;
            if self.load(cell)?.mesh.has_area(rounding) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Some triangles of a cell, without channels. Those whose vertices are missing have none but NaN.
    fn first_triangles(&self, cell: CellId) -> Result<Mesh> {
        const MOST: usize = 256;
        let (layout, chunks) = (&self.layout, self.pack.chunks_of(cell));
        let (id_bytes, mut payload) = (layout.ids.bytes, Vec::new());
        if let Some(chunk) = chunks.iter().find(|chunk| chunk.kind == ChunkKind::Triangles) {
            self.pack.read(chunk, &mut payload)?;
        }
        let rows = payload.chunks_exact(layout.triangle_row_bytes(self.info.has_channels));
        let ids = rows.take(MOST).flat_map(|row| row[..3 * id_bytes].chunks_exact(id_bytes));
        let corners: Vec<GlobalVertex> = ids.map(|id| layout.ids.read(id)).collect();
        let mut ids = corners.clone();
        ids.sort_unstable();
        ids.dedup();
        let mut positions = vec![[f64::NAN; 3]; ids.len()];
        let row_bytes = id_bytes + layout.row_bytes(self.info.has_channels);
        for chunk in chunks.iter().filter(|chunk| chunk.kind == ChunkKind::Vertices) {
            self.pack.read(chunk, &mut payload)?;
            for row in payload.chunks_exact(row_bytes) {
                if let Ok(place) = ids.binary_search(&layout.ids.read(row)) {
                    positions[place] = layout.schema.position(&row[id_bytes..]);
                }
            }
        }
        let place = |id: &GlobalVertex| ids.binary_search(id).expect("collected above") as u32;
        let corners: Vec<u32> = corners.iter().map(place).collect();
        Ok(Mesh::new(positions, corners.as_chunks().0.to_vec()))
    }

    fn load_rows(&self, cell: CellId) -> Result<CellMesh> {
        let tally = self.rows(cell);
        let chunks = self.pack.chunks_of(cell);
        let mut map = IdMap::with_capacity(tally.vertices as usize);
        let mut payload = Vec::new();
        let mut out = CellMesh::default();
        out.mesh.n_channels = self.layout.n_channels();
        self.load_vertices(tally, chunks, &mut payload, &mut map, &mut out)?;
        out.shared = vec![false; out.ids.len()];
        self.layout.mark_locked(&out.records, &mut out.shared);
        out.mesh.triangles.reserve_exact(tally.triangles as usize);
        let id_bytes = self.layout.ids.bytes;
        let row_bytes = self.layout.triangle_row_bytes(self.info.has_channels);
        let has_original = row_bytes > 3 * id_bytes;
        for chunk in chunks {
            let missing = |id| {
                let what = format!("byte {}: no vertex {id} in cell {cell}", chunk.offset);
                Error::corrupt(self.pack.path_of(chunk), what)
            };
            let mut find = |row: &[u8]| {
                let id = self.layout.ids.read(row);
                map.get(id, &out.ids).ok_or_else(|| missing(id))
            };
            match chunk.kind {
                ChunkKind::Triangles => {
                    self.pack.read(chunk, &mut payload)?;
                    for row in payload.chunks_exact(row_bytes) {
                        let corners =
                            [find(row)?, find(&row[id_bytes..])?, find(&row[2 * id_bytes..])?];
                        out.mesh.triangles.push(corners);
                        if has_original {
                            self.layout.read_original(&row[3 * id_bytes..], &mut out.mesh);
                        }
                    }
                }
                ChunkKind::SharedIds => {
                    self.pack.read(chunk, &mut payload)?;
                    for row in payload.chunks_exact(id_bytes) {
                        out.shared[find(row)? as usize] = true;
                    }
                }
                ChunkKind::Vertices
                | ChunkKind::Survivors
                | ChunkKind::Foreign
                | ChunkKind::Index
                | ChunkKind::Found
                | ChunkKind::Samples
                | ChunkKind::Origins
                | ChunkKind::Verdict => {}
            }
        }
        drop((map, payload));
        if self.layout.codec.has_seams(&self.layout.schema) {
            out.share_places();
        }
        if !self.info.has_channels {
            out.order_by_lowest_id();
        }
        Ok(out)
    }

    fn load_vertices(
        &self,
        tally: CellTally,
        chunks: &[Chunk],
        payload: &mut Vec<u8>,
        map: &mut IdMap,
        out: &mut CellMesh,
    ) -> Result<()> {
        let layout = &self.layout;
        let record_bytes = layout.schema.record_bytes();
        let row_bytes = layout.ids.bytes + layout.row_bytes(self.info.has_channels);
        let n_channels = layout.n_channels();
        let n = tally.vertices as usize;
        out.ids.reserve_exact(n);
        out.records.reserve_exact(n * record_bytes);
        out.mesh.positions.reserve_exact(n);
        out.mesh.channels.reserve_exact(n * n_channels);
        for chunk in chunks.iter().filter(|chunk| chunk.kind == ChunkKind::Vertices) {
            self.pack.read(chunk, payload)?;
            for row in payload.chunks_exact(row_bytes) {
                let (index, is_new) = map.insert(layout.ids.read(row), &mut out.ids);
                if !is_new {
                    if let (true, Some(at)) = (self.info.has_channels, layout.reach_channel()) {
                        let bytes =
                            row[row_bytes - 4..].first_chunk().expect("a channel at the end");
                        let reach = &mut out.mesh.channels[index as usize * n_channels + at];
                        *reach = reach.max(f32::from_le_bytes(*bytes));
                    }
                    continue;
                }
                if out.ids.len() > n {
                    let cell = chunk.cell;
                    let what = format!(
                        "byte {}: more vertices of cell {cell} than its record says; run again with --restart",
                        chunk.offset
                    );
                    return Err(Error::corrupt(self.pack.path_of(chunk), what));
                }
                let (record, channels) = row[layout.ids.bytes..].split_at(record_bytes);
                out.records.extend_from_slice(record);
                out.mesh.positions.push(layout.schema.position(record));
                if self.info.has_channels {
                    let floats = channels.chunks_exact(4);
                    out.mesh
                        .channels
                        .extend(floats.map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])));
                } else if n_channels > 0 {
                    let start = out.mesh.channels.len();
                    out.mesh.channels.resize(start + n_channels, 0.0);
                    layout.codec.decode_channels(record, &mut out.mesh.channels[start..]);
                }
            }
        }
        Ok(())
    }
}
