//! Fails or kills a small job at every operation on its disk, then runs it again.
//!
//! Whatever happened, the output is absent or complete, and the same command ends with the reference bytes.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

use std::path::Path;
use stonecut::Result;
use stonecut::config::{Attributes, Config, Target};
use stonecut::disk::{Disk, Loss};
use stonecut::pipeline;
use stonecut::progress::Progress;

fn config(folder: &Path, target: u64) -> Config {
    Config {
        input: folder.join("in.ply"),
        output: folder.join("out.ply"),
        target: Target::Triangles(target),
        memory_bytes: 256 << 20,
        threads: std::num::NonZeroUsize::MIN,
        cell_triangles: 1000,
        job_folder: folder.join("job"),
        keep_temp: false,
        until: None,
        force: false,
        restart: false,
        seams: None,
        verify: false,
        format: Default::default(),
        skip_bad: false,
        drop_texture: false,
        attributes: Attributes::default(),
        kernel: Default::default(),
    }
}

fn simplify(disk: &Disk, config: &Config) -> Result<()> {
    let prepared = pipeline::prepare(config)?;
    pipeline::simplify_on(disk, prepared, config, &Progress::default()).map(|_| ())
}

/// A fast folder where there is one: thousands of small jobs are written.
fn folder() -> tempfile::TempDir {
    let shm = Path::new("/dev/shm");
    if shm.is_dir()
        && let Ok(folder) = tempfile::tempdir_in(shm)
    {
        return folder;
    }
    tempfile::tempdir().unwrap()
}

fn input(folder: &Path, triangles: u32) {
    // A wavy height field, written by hand: n by n squares.
    let n = ((triangles / 2) as f64).sqrt() as u32;
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        (n + 1) * (n + 1),
        2 * n * n
    )
    .into_bytes();
    for y in 0..=n {
        for x in 0..=n {
            let z = (x as f32 * 0.7).sin() + (y as f32 * 0.31).cos() + (x * y % 7) as f32 * 0.01;
            [x as f32, y as f32, z].iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
        }
    }
    for y in 0..n {
        for x in 0..n {
            let a = y * (n + 1) + x;
            let (b, c, d) = (a + 1, a + n + 1, a + n + 2);
            for triangle in [[a, b, c], [b, d, c]] {
                bytes.push(3);
                triangle.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
            }
        }
    }
    std::fs::write(folder.join("in.ply"), bytes).unwrap();
}

/// Triangles in and out: one round and the finish; two rounds, the second exact; the finish alone.
const JOBS: [(u32, u64); 3] = [(6000, 400), (8500, 4400), (3000, 300)];

struct Bench {
    folder: tempfile::TempDir,
    config: Config,
    reference: Vec<u8>,
    operations: u64,
    changes: u64,
}

fn bench((triangles, target): (u32, u64)) -> Bench {
    let folder = folder();
    input(folder.path(), triangles);
    let config = config(folder.path(), target);
    let disk = Disk::for_crash_tests();
    simplify(&disk, &config).unwrap();
    let reference = std::fs::read(&config.output).unwrap();
    assert!(!config.job_folder.exists());
    std::fs::remove_file(&config.output).unwrap();
    Bench { folder, config, reference, operations: disk.operations(), changes: disk.changes() }
}

impl Bench {
    fn output_is_absent_or_whole(&self, what: &str) -> bool {
        match std::fs::read(&self.config.output) {
            Ok(bytes) => {
                assert!(bytes == self.reference, "{what}: another output");
                true
            }
            Err(_) => false,
        }
    }

    /// The same command, on a disk that works; afterwards the folder is as before the job.
    fn rerun(&self, what: &str) {
        let outcome = simplify(&Disk::for_crash_tests(), &self.config);
        // The job may have been complete but for nothing; then the command refuses to overwrite.
        if let Err(error) = outcome {
            let is_done = !self.config.job_folder.join("manifest.jsonl").exists();
            assert!(
                is_done && error.exit_code() == 2 && self.config.output.exists(),
                "{what}: {error}"
            );
        }
        assert!(self.output_is_absent_or_whole(what), "{what}: no output");
        std::fs::remove_file(&self.config.output).unwrap();
        let _ = std::fs::remove_dir_all(&self.config.job_folder);
        let left: Vec<_> = std::fs::read_dir(self.folder.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .filter(|name| name != "in.ply")
            .collect();
        assert!(left.is_empty(), "{what}: {left:?} is left");
    }
}

#[test]
fn an_operation_that_fails_once_costs_nothing() {
    for job in JOBS {
        let bench = bench(job);
        for k in 1..=bench.operations + 2 {
            let what = format!("{job:?}, operation {k} of {} fails", bench.operations);
            let disk = Disk::for_crash_tests();
            disk.fail_at(k);
            let outcome = simplify(&disk, &bench.config);
            let is_there = bench.output_is_absent_or_whole(&what);
            assert!(outcome.is_err() || is_there, "{what}: success without output");
            bench.rerun(&what);
        }
    }
}

#[test]
fn a_death_between_any_two_changes_costs_nothing() {
    for job in JOBS {
        let bench = bench(job);
        for k in 1..=bench.changes + 1 {
            for loss in [Loss::Nothing, Loss::Unsynced, Loss::UnsyncedData] {
                let what = format!("{job:?}, death at change {k} of {}, {loss:?}", bench.changes);
                let disk = Disk::for_crash_tests();
                disk.freeze_at(k);
                let _ = simplify(&disk, &bench.config);
                disk.lose(loss).unwrap();
                bench.output_is_absent_or_whole(&what);
                bench.rerun(&what);
            }
        }
    }
}

#[test]
fn deaths_one_after_the_other_cost_nothing() {
    let bench = bench(JOBS[1]);
    let mut k = 5;
    let mut random = 7u64;
    for round in 0..40 {
        let what = format!("series {round}");
        for _ in 0..6 {
            random = random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            k = random % (bench.changes / 2) + 1;
            let disk = Disk::for_crash_tests();
            disk.freeze_at(k);
            let loss = [Loss::Nothing, Loss::Unsynced, Loss::UnsyncedData];
            let _ = simplify(&disk, &bench.config);
            disk.lose(loss[(random >> 33) as usize % 3]).unwrap();
            bench.output_is_absent_or_whole(&what);
        }
        bench.rerun(&what);
    }
    assert!(k > 0);
}
