//! The disk that a run takes: what lies in the job folder from stage to stage, the most of it at one time, and
//! whether that is free.

use crate::error::{Error, Remedy, Result};
use crate::store::cells::{CellTally, Scatter, VertexLayout, store_row_bytes, survivor_bytes};
use crate::system::disk::folder_of;
use crate::system::paths::existing_parent;
use crate::system::units::show_bytes;
use std::path::Path;

/// Chunk headers, index and manifest on top of the rows of a pack.
const CHUNK_BYTES: f64 = 64.0;

/// Vertices that a cell shares with others, for the square root of its triangles (`stitch`: a sheet has about two).
/// Half of them are copies of another cell's.
const SHARED_PER_ROOT: f64 = 2.0;

/// Free inodes the job needs: packs, manifest, lock, output and their temporaries.
const INODES: u64 = 32;

/// Blocks of a file system: what of a chunk cannot be given back because it shares a block with others.
const BLOCK_BYTES: f64 = 4096.0;

/// Vertices that cells share with others, each counted in every cell that holds it.
pub(super) fn shared_vertices(triangles: u64, n_cells: f64) -> f64 {
    match n_cells > 1.0 {
        true => n_cells * SHARED_PER_ROOT * (triangles as f64 / n_cells).sqrt(),
        false => 0.0,
    }
}

/// A round, as the plan has it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Round {
    /// Triangles before and after it.
    pub(super) before: u64,
    pub(super) after: u64,
    /// True if sources of cells are given back as they are simplified.
    pub(super) frees: bool,
}

/// Input of the estimate of disk use.
pub(super) struct Job<'a> {
    pub(super) layout: &'a VertexLayout,
    pub(super) vertices_per_triangle: f64,
    pub(super) cell_triangles: u64,
    /// Bytes for each set of scatter buffers.
    pub(super) buffer_bytes: u64,
    /// The most that the table of cells takes of a file while the input is cut.
    pub(super) table_file_bytes: u64,
    pub(super) threads: u64,
    /// Survivors are synced, and sources given back, when they make this part of the store.
    pub(super) freed_at_a_time: u64,
}

impl Job<'_> {
    fn tally(&self, triangles: u64) -> CellTally {
        CellTally { vertices: (triangles as f64 * self.vertices_per_triangle) as u64, triangles }
    }

    fn n_cells(&self, triangles: u64) -> f64 {
        triangles.div_ceil(self.cell_triangles.max(1)).max(1) as f64
    }

    fn chunk_bytes(&self, triangles: u64) -> f64 {
        let n_cells = self.n_cells(triangles) as u32;
        Scatter::bytes(n_cells, self.buffer_bytes) as f64 / f64::from(n_cells)
    }

    /// Bytes of a store of cells.
    pub(super) fn store(&self, triangles: u64, has_channels: bool) -> f64 {
        let tally = self.tally(triangles);
        let (vertex, triangle) = store_row_bytes(self.layout, has_channels);
        let n_cells = self.n_cells(triangles);
        let rows = tally.vertices as f64 * vertex as f64 + triangles as f64 * triangle as f64;
        let shared = shared_vertices(triangles, n_cells);
        let seams = shared * (vertex as f64 / 2.0 + self.layout.ids.bytes as f64);
        let n_chunks = rows / self.chunk_bytes(triangles) + 3.0 * n_cells;
        rows + seams + n_chunks * CHUNK_BYTES
    }

    /// Bytes of survivors.
    pub(super) fn survivors(&self, triangles: u64) -> f64 {
        // Counts and statistics of each cell.
        survivor_bytes(self.tally(triangles), self.layout) as f64 + 512.0 * self.n_cells(triangles)
    }

    /// The most that lies in the job folder before the result is written, and what lies there then.
    pub(super) fn peak(
        &self,
        triangles_in: u64,
        rounds: &[Round],
        finishes_at: Option<u64>,
    ) -> (f64, f64) {
        let mut store = self.store(triangles_in, false);
        let mut most = store + self.table_file_bytes as f64;
        let mut left = None;
        for (number, round) in rounds.iter().enumerate() {
            if number > 0 {
                let survivors = self.survivors(round.before);
                store = self.store(round.before, true);
                most = most.max(survivors + store);
            }
            let survivors = self.survivors(round.after);
            let beside = match round.frees {
                true => self.beside(round, store, survivors),
                false => store + survivors,
            };
            most = most.max(beside);
            left = Some(survivors);
        }
        match finishes_at {
            None => (most, left.unwrap_or(store)),
            Some(target) => {
                let result = self.survivors(target);
                (most.max(left.unwrap_or(store) + result), result)
            }
        }
    }

    /// Store and survivors side by side while sources are given back.
    fn beside(&self, round: &Round, store: f64, survivors: f64) -> f64 {
        // What is synced at a time, and what cells under way have appended since.
        let cells = (self.threads as f64 + 1.0) / self.n_cells(round.before);
        let waiting = (1.0 / self.freed_at_a_time as f64 + cells).min(1.0);
        let stays = store * (BLOCK_BYTES / self.chunk_bytes(round.before)).min(1.0);
        (store + waiting * survivors)
            .max(survivors + stays + waiting * store)
            .min(store + survivors)
    }
}

/// Fails where output or temporary data would not leave `free_bytes`, or their folders do not take files; `together_bytes`
/// where both share a disk.
pub(in crate::pipeline) fn check_space(
    (output, job_folder): (&Path, &Path),
    temp_bytes: u64,
    output_bytes: u64,
    together_bytes: u64,
    free_bytes: u64,
) -> Result<()> {
    let output_folder = folder_of(output);
    let temp_folder = existing_parent(job_folder);
    for folder in [output_folder, temp_folder] {
        use rustix::fs::{Access, access};
        access(folder, Access::EXISTS)
            .and_then(|()| access(folder, Access::WRITE_OK | Access::EXEC_OK))
            .map_err(|e| Error::io(folder, "cannot write into this folder", e.into()))?;
    }
    let same = device(output_folder)? == device(temp_folder)?;
    let needs = if same {
        vec![(temp_folder, together_bytes, Remedy::MakeSpace)]
    } else {
        vec![
            (temp_folder, temp_bytes, Remedy::MakeSpace),
            (output_folder, output_bytes, Remedy::MakeSpaceForOutput),
        ]
    };
    // What an earlier run of this job holds already is not needed again.
    let held = held_bytes(job_folder);
    for (folder, bytes, remedy) in needs {
        let stat = rustix::fs::statvfs(folder)
            .map_err(|e| Error::reading(folder, "cannot ask for free space", e.into()))?;
        let free = stat.f_bavail * stat.f_frsize + if folder == temp_folder { held } else { 0 };
        if bytes.saturating_add(free_bytes) > free {
            let stays = match free_bytes {
                0 => String::new(),
                stays => format!(", and --min-free keeps {}", show_bytes(stays)),
            };
            return Err(Error::NoSpace {
                path: folder.into(),
                what: format!(
                    "the run needs {} here, {} are free{stays}",
                    show_bytes(bytes),
                    show_bytes(free)
                ),
                remedy,
            });
        }
        // Some file systems have no inode count at all and say 0 of 0.
        if stat.f_files > 0 && stat.f_favail < INODES {
            let what = format!("{} inodes are free, the run needs {INODES}", stat.f_favail);
            let remedy = Remedy::RemoveFiles;
            return Err(Error::NoSpace { path: folder.into(), what, remedy });
        }
    }
    Ok(())
}

fn device(path: &Path) -> Result<u64> {
    use std::os::unix::fs::MetadataExt;
    std::fs::metadata(path)
        .map(|meta| meta.dev())
        .map_err(|e| Error::reading(path, "cannot stat", e))
}

fn held_bytes(folder: &Path) -> u64 {
    use std::os::unix::fs::MetadataExt;
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    entries
        .flatten()
        .filter_map(|entry| entry.metadata().ok())
        .map(|meta| meta.blocks() * 512)
        .sum()
}
