//! Fails or kills a small job at every operation on its disk, then runs it again.
//!
//! Whatever happened, the output is absent or complete, and the same command ends with the reference bytes.

use crate::common::one_in;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use stonecut::Result;
use stonecut::config::{Config, Level, Target, Until};
use stonecut::pipeline;
use stonecut::system::disk::{Disk, PowerLoss};
use stonecut::system::progress::Progress;

fn config(folder: &Path, targets: &[u64]) -> Config {
    let level = |n: &u64| Level {
        target: Target::Triangles(*n),
        output: folder.join(format!("out-{n}.ply")),
    };
    Config {
        coarser: targets[1..].iter().map(level).collect(),
        ..crate::common::config(folder, Target::Triangles(targets[0]))
    }
}

fn simplify(disk: &Disk, config: &Config) -> Result<()> {
    let prepared = pipeline::prepare(config)?;
    pipeline::simplify_on(disk, prepared, &Progress::default()).map(|_| ())
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

/// Triangles in and out.
type Job = (u32, &'static [u64]);

/// One round and the finish; two rounds, the second exact; the finish alone; a chain of an exact round, a round and a
/// finish, and a second finish from what the first took in.
const JOBS: [Job; 4] =
    [(6000, &[400]), (8500, &[4400]), (3000, &[300]), (8500, &[4400, 1000, 600])];

/// Numbers (from 1) of the operations to try: the first of every kind on every file, all that write to the manifest, which seals
/// stages, and every 24th of the others; and one behind the last. All of them at night.
fn sample(kinds: &[String]) -> Vec<u64> {
    let n = one_in(24);
    let is_tried = |&k: &usize| {
        let is_first = !kinds[..k].contains(&kinds[k]);
        k % n == 0 || is_first || kinds[k].contains("write manifest")
    };
    let tried = (0..kinds.len()).filter(is_tried).chain([kinds.len()]);
    tried.map(|k| k as u64 + 1).collect()
}

const LOSSES: [PowerLoss; 3] = [PowerLoss::Nothing, PowerLoss::Unsynced, PowerLoss::UnsyncedData];

/// Three blocks of vertices and three of faces, most of them unused or degenerate; a checkpoint after each.
const LONG_JOB: Job = (0, &[3000]);

/// A sheet of 60 x 60 squares with its vertices and faces spread over `LONG_JOB`'s blocks.
fn long_input(folder: &Path) {
    let (n, n_vertices, n_faces) = (60u32, 140_000u32, 144_000u32);
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {n_vertices}\nproperty float x\nproperty float y\n\
         property float z\nelement face {n_faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    let id = |x: u32, y: u32| (y * (n + 1) + x) * 37;
    for v in 0..n_vertices {
        let (x, y) = ((v / 37) % (n + 1), v / 37 / (n + 1));
        let z = (x as f32 * 0.7).sin() + (x * y % 7) as f32 * 0.01;
        [x as f32, y as f32, z].iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
    }
    for face in 0..n_faces {
        let (square, is_upper) = (face / 40, face % 40 == 20);
        let (x, y) = (square % n, square / n);
        let (a, b, c, d) = (id(x, y), id(x + 1, y), id(x, y + 1), id(x + 1, y + 1));
        let corners = match face % 20 {
            0 if is_upper => [b, d, c],
            0 => [a, b, c],
            _ => [a, a, b],
        };
        bytes.push(3);
        corners.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
    }
    std::fs::write(folder.join("in.ply"), bytes).unwrap();
}

struct Bench {
    folder: tempfile::TempDir,
    config: Config,
    /// Of each output.
    reference: Vec<Vec<u8>>,
    /// Action and file of every operation.
    operations: Vec<String>,
    /// Those of them that change something.
    changes: Vec<String>,
}

fn bench(job: Job) -> Bench {
    bench_with(job, stonecut::config::CHECKPOINT_EVERY)
}

fn bench_with((triangles, targets): Job, checkpoint_every: Duration) -> Bench {
    let folder = folder();
    let mut config = Config { checkpoint_every, ..config(folder.path(), targets) };
    match triangles {
        0 => {
            long_input(folder.path());
            config.cell_triangles = 20_000;
        }
        _ => input(folder.path(), triangles),
    }
    let disk = Disk::for_crash_tests();
    let seen = Arc::new(Mutex::new((Vec::new(), Vec::new())));
    let sees = Arc::clone(&seen);
    disk.watch(move |operation| {
        let name = operation.path.file_name().unwrap_or_default();
        let kind = format!("{} {}", operation.action, name.display());
        let (operations, changes) = &mut *sees.lock().unwrap();
        changes.extend(operation.change.map(|_| kind.clone()));
        operations.push(kind);
    });
    simplify(&disk, &config).unwrap();
    let reference = config.outputs().map(|output| std::fs::read(output).unwrap()).collect();
    assert!(!config.job_folder.exists());
    config.outputs().for_each(|output| std::fs::remove_file(output).unwrap());
    let (operations, changes) = std::mem::take(&mut *seen.lock().unwrap());
    Bench { folder, config, reference, operations, changes }
}

impl Bench {
    /// True if all outputs are there.
    fn output_is_absent_or_whole(&self, what: &str) -> bool {
        let is_there = |(output, reference): (&PathBuf, &Vec<u8>)| {
            let found = std::fs::read(output).ok();
            assert!(
                found.as_ref().is_none_or(|bytes| bytes == reference),
                "{what}: another output"
            );
            found.is_some()
        };
        self.config.outputs().zip(&self.reference).map(is_there).fold(true, |all, one| all & one)
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
        self.config.outputs().for_each(|output| std::fs::remove_file(output).unwrap());
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
        for k in sample(&bench.operations) {
            let what = format!("{job:?}, operation {k} of {} fails", bench.operations.len());
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
        for (i, k) in sample(&bench.changes).into_iter().enumerate() {
            // By day one of the three in turn.
            for loss in LOSSES.into_iter().skip(i % one_in(3)).step_by(one_in(3)) {
                let n = bench.changes.len();
                let what = format!("{job:?}, death at change {k} of {n}, {loss:?}");
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

/// Within a bound all cells of the first round take the same ladder of costs, which comes from one of them: it must be known when that
/// cell is done and its bytes are given back.
#[test]
fn a_death_in_a_bounded_round_costs_nothing() {
    let folder = folder();
    input(folder.path(), 6000);
    let bound = stonecut::kernel::Bound { distance: 0.05, channel: None, patience: 1.0 };
    let mut config = config(folder.path(), &[100]);
    config.checkpoint_every = Duration::ZERO;
    config.kernel.bound = Some(bound);
    config.target = Target::MaxError(0.05);
    let disk = Disk::for_crash_tests();
    simplify(&disk, &config).unwrap();
    let reference = std::fs::read(&config.output).unwrap();
    let changes = disk.changes();
    for k in (1..=changes).step_by(one_in(3)) {
        std::fs::remove_file(&config.output).unwrap();
        let disk = Disk::for_crash_tests();
        disk.freeze_at(k);
        let _ = simplify(&disk, &config);
        disk.lose(PowerLoss::Nothing).unwrap();
        // What a frozen run has left of its output is there already.
        if !config.output.exists() {
            let outcome = simplify(&Disk::for_crash_tests(), &config);
            assert!(outcome.is_ok(), "death at change {k} of {changes}: {outcome:?}");
        }
        assert!(std::fs::read(&config.output).unwrap() == reference, "death at change {k}");
        let _ = std::fs::remove_dir_all(&config.job_folder);
    }
}

/// Deaths within the passes of the partition, with a checkpoint after every block; runs with and without
/// checkpoints give the same bytes.
#[test]
fn a_death_between_checkpoints_costs_nothing() {
    for job in [JOBS[1], LONG_JOB] {
        let without = bench(job);
        let bench = bench_with(job, Duration::ZERO);
        assert!(bench.reference == without.reference, "checkpoints change the result");
        let n = bench.changes.len();
        assert!(n > without.changes.len() + 5, "{n} {}", without.changes.len());
        let mut taken_up = 0;
        for (i, k) in (1..=n as u64 + 1).step_by(one_in(4)).enumerate() {
            for loss in LOSSES.into_iter().skip(i % one_in(3)).step_by(one_in(3)) {
                let what = format!("{job:?}, death at change {k} of {n}, {loss:?}");
                let disk = Disk::for_crash_tests();
                disk.freeze_at(k);
                let _ = simplify(&disk, &bench.config);
                disk.lose(loss).unwrap();
                bench.output_is_absent_or_whole(&what);
                let manifest = bench.config.job_folder.join("manifest.jsonl");
                let manifest = std::fs::read_to_string(manifest).unwrap_or_default();
                taken_up += usize::from(manifest.contains("partition so far"));
                bench.rerun(&what);
            }
        }
        assert!(taken_up > 12, "{taken_up}");
    }
}

/// What a run reads again after a death within the partition: not what lies before the checkpoint.
#[test]
fn a_checkpoint_is_taken_up() {
    let bench = bench_with(LONG_JOB, Duration::ZERO);
    let mut config = bench.config.clone();
    config.job.until = Some(Until::Partition);
    let written = |freeze_at: u64| {
        let disk = Disk::for_crash_tests();
        disk.freeze_at(freeze_at);
        let _ = simplify(&disk, &config);
        disk.bytes_written()
    };
    let whole = written(0);
    let _ = std::fs::remove_dir_all(&bench.config.job_folder);
    let mut most = 0;
    for k in (10..bench.changes.len() as u64).step_by(one_in(4)) {
        let first = written(k);
        let second = written(0);
        if second > 0 {
            most = most.max((first + second) * 100 / whole);
        }
        let _ = std::fs::remove_dir_all(&bench.config.job_folder);
    }
    assert!(most < 150, "a death and a rerun write {most} % of an undisturbed run");
}

#[test]
fn deaths_one_after_the_other_cost_nothing() {
    let bench = bench(JOBS[1]);
    let mut random = 7u64;
    // How many runs died before their end: otherwise nothing was tried.
    let mut died = 0;
    for round in 0..40 {
        let what = format!("series {round}");
        for _ in 0..6 {
            random = random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let k = random % (bench.changes.len() as u64 / 2) + 1;
            let disk = Disk::for_crash_tests();
            disk.freeze_at(k);
            died += u32::from(simplify(&disk, &bench.config).is_err());
            disk.lose(LOSSES[(random >> 33) as usize % 3]).unwrap();
            bench.output_is_absent_or_whole(&what);
        }
        bench.rerun(&what);
    }
    assert!(died >= 120, "only {died} of 240 runs died");
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
        for k in sample(&bench.operations) {
            let what = format!("{job:?}, a panic at operation {k} of {}", bench.operations.len());
            let disk = Disk::for_crash_tests();
            disk.watch(move |operation| {
                assert!(operation.number != k, "injected fault at {k}");
            });
            let outcome = simplify(&disk, &bench.config);
            let is_there = bench.output_is_absent_or_whole(&what);
            if let Err(error) = outcome {
                assert_eq!(error.exit_code(), 9, "{what}: {error}");
                // Of two workers the one that finds the writer broken may be heard first.
                let said = error.to_string();
                let is_told = said.contains("injected fault") || said.contains("another worker");
                assert!(is_told, "{what}: {said}");
            } else {
                assert!(is_there, "{what}: success without output");
            }
            disk.lose(PowerLoss::Unsynced).unwrap();
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
    let bench = bench(JOBS[0]);
    let input = bench.config.input.clone();
    let sound = std::fs::read(&input).unwrap();
    for change in CHANGES {
        let mut refused = 0;
        for k in sample(&bench.operations) {
            // So that a change is later than the file's making by the clock's granularity, too.
            std::fs::write(&input, &sound).unwrap();
            let prepared = pipeline::prepare(&bench.config).unwrap();
            let disk = Disk::for_crash_tests();
            let path = input.clone();
            disk.watch(move |operation| {
                if operation.number == k {
                    change(&path);
                }
            });
            let outcome = pipeline::simplify_on(&disk, prepared, &Progress::default());
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
                    assert!(!bench.config.job_folder.exists(), "a bad input leaves no job");
                }
            }
        }
        assert!(refused > 2, "{refused}");
    }
}
