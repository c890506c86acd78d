//! A mesh cut into cells for a look at it, in a file that vanishes afterwards.
//!
//! For commands that read a mesh larger than memory without changing it: `info --check`, `measure`. Nothing
//! here is resumable: the folder is removed as soon as its store is open, so that only a death during the cutting
//! leaves it, and the next cutting in the same place sweeps what the dead have left.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use stonecut_io::InputPaths;
use stonecut_io::ply::MeshSource;
use stonecut_stages::partition::{Partition, partition};
use stonecut_store::cells::{CellStore, VertexLayout};
use stonecut_store::job::fingerprint::{input_marks, unchanged};
use stonecut_store::job::{Identity, Job, SCRATCH_EXTENSION, sweep_scratch};
use stonecut_store::stage_context::StageContext;
use stonecut_system::disk::Disk;
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// Settings of a temporary store of cells.
#[derive(Clone, Copy, Debug)]
pub struct Cutting<'a> {
    /// Triangles per cell.
    pub cell_triangles: u64,
    /// The folder in which the scratch folder is made.
    pub temp_dir: &'a Path,
    /// Worker threads.
    pub threads: usize,
    /// Memory for tables and buffers, in bytes.
    pub memory_bytes: u64,
    /// The disk whose account the store is part of, if there is one.
    pub disk: Option<&'a Disk>,
}

/// A store of cells whose file has no name any more.
#[derive(Debug)]
pub struct Scratch {
    store: CellStore,
    partition: Partition,
}

impl Scratch {
    /// Partitions `source` into a new folder below `cutting.temp_dir`; takes about 20 bytes a triangle there.
    pub fn cut(source: &MeshSource, cutting: Cutting, progress: &Progress) -> Result<Scratch> {
        Self::cut_and_look(source, cutting, progress, |_, _| Ok(())).map(|(scratch, ())| scratch)
    }

    /// The same; `look` sees the store while there still is a folder for files.
    pub fn cut_and_look<T>(
        source: &MeshSource,
        cutting: Cutting,
        progress: &Progress,
        look: impl FnOnce(&CellStore, &StageContext) -> Result<T>,
    ) -> Result<(Scratch, T)> {
        let name = source.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
        sweep_scratch(cutting.temp_dir);
        let folder = new_folder(cutting.temp_dir, &name)?;
        progress.owe(&folder);
        let cut = || {
            let disk = cutting.disk.map(Disk::part).unwrap_or_default();
            let identity = Identity {
                input: source.path().display().to_string(),
                input_marks: BTreeMap::new(),
                settings: BTreeMap::new(),
            };
            let job = Job::open(&folder, &disk, &identity, true)?;
            let Cutting { threads, memory_bytes, .. } = cutting;
            // Nothing here is resumed, so nothing need be durable on the way.
            let checkpoint_every = std::time::Duration::MAX;
            let run = StageContext { job: &job, progress, threads, memory_bytes, checkpoint_every };
            // Standard input, and bytes in memory, have no marks.
            let input = InputPaths::from(source.path());
            let marks = input_marks(&input);
            let partition = partition(source, cutting.cell_triangles, &run);
            let partition = match marks {
                Ok(marks) => unchanged(&input, &marks, partition)?,
                Err(_) => partition?,
            };
            let layout = VertexLayout::new(source.schema(), source.n_vertices());
            let store = CellStore::open(&disk, &folder, partition.store.clone(), layout)?;
            let seen = look(&store, &run)?;
            Ok((store, partition, seen))
        };
        let cut = cut();
        progress.settle(&folder);
        cut.map(|(store, partition, seen)| (Scratch { store, partition }, seen))
    }

    /// The cells.
    pub fn store(&self) -> &CellStore {
        &self.store
    }

    /// Bounds and faults found on the way.
    pub fn partition(&self) -> &Partition {
        &self.partition
    }
}

/// Makes a folder of a name that nothing had. Two files of one name may be cut by one process.
fn new_folder(temp_dir: &Path, name: &str) -> Result<PathBuf> {
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    loop {
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let process = std::process::id();
        let folder = temp_dir.join(format!(".{name}.{process}-{number}.{SCRATCH_EXTENSION}"));
        if std::fs::symlink_metadata(&folder).is_err() && Disk::default().own_dir(&folder)? {
            return Ok(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::{BTreeMap, BTreeSet};
    use stonecut_mesh::vec3::place_bits;
    use stonecut_store::cell_id::CellId;

    /// A fan whose every triangle has its own texture coordinate at the hub, and at the rim: its cell is split by ids.
    #[test]
    fn wedges_of_one_place_in_several_cells_are_shared() {
        let n = 3000;
        let mut text = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             property float s\nproperty float t\nelement face {n}\nproperty list uchar int vertex_indices\nend_header\n",
            3 * n
        );
        (0..n).for_each(|i| text += &format!("0 0 0 {i} 0\n"));
        for i in 0..2 * n {
            let angle = ((i + 1) / 2 % n) as f64 * std::f64::consts::TAU / n as f64;
            text += &format!("{} {} 0 {i} 1\n", angle.cos() as f32, angle.sin() as f32);
        }
        (0..n).for_each(|i| text += &format!("3 {i} {} {}\n", n + 2 * i, n + 2 * i + 1));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("fan.ply");
        std::fs::write(&path, text).unwrap();
        let cutting = Cutting {
            cell_triangles: 500,
            temp_dir: folder.path(),
            threads: 1,
            memory_bytes: 1 << 30,
            disk: None,
        };
        let source = MeshSource::open(&path).unwrap();
        let scratch = Scratch::cut(&source, cutting, &Progress::default()).unwrap();
        let (mut cells_of, mut alone) = (BTreeMap::new(), Vec::new());
        let n_cells = scratch.store().n_cells();
        let mut most = 0;
        for cell in CellId::first(n_cells) {
            let loaded = scratch.store().load(cell).unwrap();
            most = most.max(loaded.mesh.triangles.len());
            for &v in loaded.mesh.triangles.as_flattened() {
                let place = place_bits(loaded.mesh.positions[v as usize]);
                cells_of.entry(place).or_insert_with(BTreeSet::new).insert(cell);
                if !loaded.shared[v as usize] {
                    alone.push((place, cell));
                }
            }
        }
        assert!(most <= 1000, "split: {most}");
        assert!(cells_of[&[0; 3]].len() > 2);
        let torn = alone.iter().filter(|(place, _)| cells_of[place].len() > 1).count();
        assert_eq!(torn, 0, "corners that are free although another cell has their place");
    }
}
