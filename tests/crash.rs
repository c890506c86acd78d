//! Fails or kills a small job at every operation on its disk, then runs it again.
//!
//! Whatever happened, the output is absent or complete, and the same command ends with the reference bytes.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

use std::path::Path;
use stonecut::Result;
use stonecut::config::{Config, Target};
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
        format: Default::default(),
        skip_bad: false,
        drop_texture: false,
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

/// A panic in whatever thread is an error of its own class; what was sealed before it is used again.
#[test]
fn a_panic_at_any_operation_costs_nothing() {
    // Injected panics are told once, not some thousand times.
    let tell = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if !panic.to_string().contains("injected fault") {
            tell(panic);
        }
    }));
    for (job, threads) in [(JOBS[0], 1), (JOBS[1], 1), (JOBS[1], 2), (JOBS[2], 1)] {
        let mut bench = bench(job);
        bench.config.threads = std::num::NonZeroUsize::new(threads).unwrap();
        for k in 1..=bench.operations + 2 {
            let what = format!("{job:?}, a panic at operation {k} of {}", bench.operations);
            let disk = Disk::for_crash_tests();
            disk.watch(move |operation| assert!(operation != k, "injected fault at {k}"));
            let outcome = simplify(&disk, &bench.config);
            let is_there = bench.output_is_absent_or_whole(&what);
            if let Err(error) = outcome {
                assert_eq!(error.exit_code(), 9, "{what}: {error}");
                assert!(error.to_string().contains("injected fault"), "{what}: {error}");
            } else {
                assert!(is_there, "{what}: success without output");
            }
            disk.lose(Loss::Unsynced).unwrap();
            bench.rerun(&what);
        }
    }
}

/// What another program may do to the input while it is read.
const CHANGES: [fn(&Path); 4] = [
    |input| std::fs::File::options().write(true).open(input).unwrap().set_len(90_000).unwrap(),
    |input| overwrite(input, b"ply\nformat ascii 1.0\n", 0),
    |input| overwrite(input, &[0x7f; 64], 100_000),
    |input| {
        let other = input.with_file_name("other.ply");
        std::fs::copy(input, &other).unwrap();
        overwrite(&other, &[0; 16], 50_000);
        std::fs::rename(other, input).unwrap();
    },
];

fn overwrite(path: &Path, bytes: &[u8], at: u64) {
    use std::os::unix::fs::FileExt;
    std::fs::File::options().write(true).open(path).unwrap().write_all_at(bytes, at).unwrap();
}

/// The partition is the only stage that reads the input; after it a change no longer matters to the run.
#[test]
fn an_input_that_changes_while_it_is_read_is_named() {
    let bench = bench(JOBS[1]);
    let input = bench.config.input.clone();
    let sound = std::fs::read(&input).unwrap();
    for change in CHANGES {
        let mut refused = 0;
        for k in (1..=bench.operations).step_by(3) {
            // So that a change is later than the file's making by the clock's granularity, too.
            std::fs::write(&input, &sound).unwrap();
            let prepared = pipeline::prepare(&bench.config).unwrap();
            let disk = Disk::for_crash_tests();
            let path = input.clone();
            disk.watch(move |operation| {
                if operation == k {
                    change(&path);
                }
            });
            let outcome =
                pipeline::simplify_on(&disk, prepared, &bench.config, &Progress::default());
            match outcome {
                Ok(_) => {
                    assert!(bench.output_is_absent_or_whole("a later change"));
                    std::fs::remove_file(&bench.config.output).unwrap();
                }
                Err(error) => {
                    refused += 1;
                    assert_eq!(error.exit_code(), 4, "{error}");
                    let said = error.to_string();
                    assert!(said.contains("in.ply") && said.contains("changed during"), "{said}");
                    assert!(!bench.config.output.exists());
                    let error = simplify(&Disk::for_crash_tests(), &bench.config).unwrap_err();
                    assert!([4, 8].contains(&error.exit_code()), "{error}");
                    std::fs::remove_dir_all(&bench.config.job_folder).unwrap();
                }
            }
        }
        assert!(refused > 2, "{refused}");
    }
}
