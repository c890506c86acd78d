//! Runs of `tiles` that are killed, lose power, meet a full disk or another run: the same bytes afterwards.

use crate::common::volume::Volume;
use crate::common::{expect, signal, stonecut};
use crate::tiles::{config, files, make, painted};
use rustix::process::Signal;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use stonecut::pipeline::tiles::{Finest, TileTexture, TilesConfig};
use stonecut::system::disk::{Disk, PowerLoss};

const OPTIONS: &str = "--tile-triangles 1000 --threads 1 --quiet";

/// Files of a run in the order in which they appear, below the folder of the output.
const STAGES: [&str; 8] = [
    "out.stonecut-job/round-0.cells",
    ".out.stonecut-tiles/tiles/0",
    "out.stonecut-job/round-1.survivors",
    "out.stonecut-job/round-2.cells",
    ".out.stonecut-tiles/tiles/1",
    "out.stonecut-job/round-2.survivors",
    ".out.stonecut-tiles/tiles/2",
    ".out.stonecut-tiles/tileset.json",
];

fn statue(triangles: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), &format!("synth statue in.ply --triangles {triangles}"), 0);
    folder
}

fn command(output: &Path) -> String {
    format!("tiles in.ply {} {OPTIONS}", output.display())
}

/// Starts a run and comes back when a file of it is there, or when it is over.
fn begun(input: &Path, output: &Path, file: &str) -> (Child, bool) {
    let mut run = stonecut()
        .current_dir(input)
        .args(command(output).split(' '))
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let file = output.parent().unwrap().join(file);
    while !file.exists() && run.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    let is_under_way = run.try_wait().unwrap().is_none();
    (run, is_under_way)
}

#[test]
fn a_run_that_is_killed_at_any_stage_is_continued_to_the_same_bytes() {
    let folder = statue("120k");
    let path = folder.path();
    expect(path, &command(&path.join("whole")), 0);
    let whole = files(&path.join("whole"));
    let output = path.join("out");
    let mut killed = 0;
    for stage in STAGES {
        let (mut run, is_under_way) = begun(path, &output, stage);
        if is_under_way {
            signal(&run, Signal::KILL);
            killed += 1;
        }
        run.wait().unwrap();
        if !output.exists() {
            expect(path, &command(&output), 0);
        }
        assert!(files(&output) == whole, "killed when {stage} was there");
        std::fs::remove_dir_all(&output).unwrap();
    }
    assert!(killed >= 6, "{killed} of {} runs were killed", STAGES.len());
}

#[test]
fn a_disk_that_fills_during_the_run_stops_it() {
    let Some(volume) = Volume::mount("size=96m") else { return };
    let folder = statue("120k");
    expect(folder.path(), &command(&folder.path().join("whole")), 0);
    let whole = files(&folder.path().join("whole"));
    let output = volume.path().join("out");
    let filler = volume.path().join("filler");
    let mut stopped = 0;
    for stage in STAGES {
        let (mut run, is_under_way) = begun(folder.path(), &output, stage);
        if is_under_way {
            signal(&run, Signal::STOP);
        }
        let mut file = std::fs::File::create(&filler).unwrap();
        while std::io::Write::write_all(&mut file, &[0; 1 << 16]).is_ok() {}
        drop(file);
        if is_under_way {
            signal(&run, Signal::CONT);
        }
        let code = run.wait().unwrap().code();
        assert!(matches!(code, Some(0 | 5)), "{stage}: {code:?}");
        assert_eq!(code == Some(0), output.exists(), "{stage}");
        std::fs::remove_file(&filler).unwrap();
        if code == Some(5) {
            stopped += 1;
            expect(folder.path(), &command(&output), 0);
        }
        assert!(files(&output) == whole, "full when {stage} was there");
        std::fs::remove_dir_all(&output).unwrap();
        assert_eq!(std::fs::read_dir(volume.path()).unwrap().count(), 0, "{stage}");
    }
    assert!(stopped >= 4, "{stopped} of {} runs met the full disk", STAGES.len());
}

#[test]
fn of_two_runs_at_once_one_is_refused_and_the_other_ends() {
    let folder = statue("120k");
    let path = folder.path();
    expect(path, &command(&path.join("whole")), 0);
    let output = path.join("out");
    let (mut first, is_under_way) = begun(path, &output, STAGES[2]);
    if is_under_way {
        signal(&first, Signal::STOP);
        expect(path, &command(&output), 7);
        expect(path, &format!("{} --temp-dir {}", command(&output), path.display()), 7);
        signal(&first, Signal::CONT);
    }
    assert_eq!(first.wait().unwrap().code(), Some(0));
    assert!(files(&output) == files(&path.join("whole")));
}

#[test]
fn a_power_loss_anywhere_costs_nothing() {
    let folder = statue("20k");
    let whole = Disk::default();
    make(&whole, &config(folder.path(), "whole")).unwrap();
    let n = whole.changes();
    let whole = files(&folder.path().join("whole"));
    let config = config(folder.path(), "out");
    for i in 0..16 {
        for loss in [PowerLoss::Unsynced, PowerLoss::UnsyncedData] {
            let disk = Disk::for_crash_tests();
            disk.freeze_at(1 + i * n / 16);
            let _ = make(&disk, &config);
            disk.lose(loss).unwrap();
            if !config.output.exists() {
                make(&Disk::default(), &config).unwrap();
            }
            assert!(files(&config.output) == whole, "{loss:?} at change {}", 1 + i * n / 16);
            std::fs::remove_dir_all(&config.output).unwrap();
            let _ = std::fs::remove_dir_all(&config.job_folder);
        }
    }
}

#[test]
fn a_run_that_stopped_anywhere_is_continued_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth statue in.ply --triangles 20k", 0);
    stopped_anywhere(&folder, config);
}

#[test]
fn a_run_over_images_that_stopped_anywhere_is_continued_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    painted(folder.path(), 100);
    expect(folder.path(), "convert in.obj in.ply", 0);
    // The faults of an image are named, wherever the run was stopped.
    let ramp = folder.path().join("ramp.png");
    let bytes = std::fs::read(&ramp).unwrap();
    std::fs::write(&ramp, &bytes[..bytes.len() / 2]).unwrap();
    for texture in [TileTexture::Bake, TileTexture::Colors] {
        stopped_anywhere(&folder, |folder, name| TilesConfig { texture, ..config(folder, name) });
        std::fs::remove_dir_all(folder.path().join("whole")).unwrap();
    }
}

#[test]
fn a_run_to_a_coarser_finest_level_that_stopped_anywhere_is_continued_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth statue in.ply --triangles 40k", 0);
    let finest = Finest::Ratio(0.1);
    stopped_anywhere(&folder, |folder, name| TilesConfig { finest, ..config(folder, name) });
}

fn stopped_anywhere(folder: &tempfile::TempDir, config: impl Fn(&Path, &str) -> TilesConfig) {
    let disk = Disk::default();
    let losses = make(&disk, &config(folder.path(), "whole")).unwrap().losses;
    let whole = files(&folder.path().join("whole"));
    let n = disk.changes();
    assert!(n > 60, "{n} changes");
    for i in 0..11 {
        let disk = Disk::default();
        disk.freeze_at(1 + i * n / 11);
        let config = config(folder.path(), "out");
        assert!(make(&disk, &config).is_err(), "{i}");
        if config.output.exists() {
            // Its last step came through.
            assert!(files(&config.output) == whole, "{i}");
            std::fs::remove_dir_all(&config.output).unwrap();
        }
        match make(&Disk::default(), &config) {
            Ok(report) => assert_eq!(report.losses, losses, "stopped at change {}", 1 + i * n / 11),
            Err(e) => {
                let ls = std::process::Command::new("find").arg(folder.path()).output().unwrap();
                panic!("{i} of {n}: {e} {}", String::from_utf8_lossy(&ls.stdout));
            }
        }
        assert!(files(&config.output) == whole, "stopped at change {}", 1 + i * n / 11);
        std::fs::remove_dir_all(&config.output).unwrap();
    }
}

#[test]
fn a_second_run_with_the_same_output_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth statue in.ply --triangles 20k", 0);
    let first = config(folder.path(), "out");
    let pending = folder.path().join(".out.stonecut-tiles");
    std::fs::create_dir(&pending).unwrap();
    let held = std::fs::File::open(&pending).unwrap();
    held.try_lock().unwrap();
    // Whatever the job folder is.
    for job in ["out.stonecut-job", "other.stonecut-job"] {
        let second = TilesConfig { job_folder: folder.path().join(job), ..first.clone() };
        let error = make(&Disk::default(), &second).unwrap_err();
        assert_eq!(error.exit_code(), 7, "{job}: {error}");
    }
    drop(held);
    make(&Disk::default(), &first).unwrap();
}

#[test]
fn tiles_that_were_lost_while_a_run_was_stopped_are_written_again() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth statue in.ply --triangles 20k", 0);
    let disk = Disk::default();
    make(&disk, &config(folder.path(), "whole")).unwrap();
    let whole = files(&folder.path().join("whole"));
    let config = config(folder.path(), "out");
    for part in [6, 8, 11] {
        let stopped = Disk::default();
        stopped.freeze_at(part * disk.changes() / 20);
        assert!(make(&stopped, &config).is_err());
        // Of the round that was under way; a power loss may leave such files.
        let pending = folder.path().join(".out.stonecut-tiles");
        let is_tile = |name: &PathBuf| !name.starts_with(".stonecut-job");
        for (i, name) in files(&pending).into_keys().filter(is_tile).enumerate() {
            match i % 3 {
                0 => std::fs::write(pending.join(name), b"").unwrap(),
                _ => continue,
            }
        }
        let found = make(&Disk::default(), &config);
        let is_whole = found.is_ok() && files(&config.output) == whole;
        assert!(is_whole, "stopped after {part} twentieths: {found:?}");
        std::fs::remove_dir_all(&config.output).unwrap();
    }
}

#[test]
fn a_run_whose_finished_tiles_are_gone_says_so() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth statue in.ply --triangles 20k", 0);
    let disk = Disk::default();
    make(&disk, &config(folder.path(), "whole")).unwrap();
    let stop = |config: &TilesConfig| {
        let stopped = Disk::default();
        stopped.freeze_at(17 * disk.changes() / 20);
        assert!(make(&stopped, config).is_err());
    };
    let first = config(folder.path(), "out");
    let second = TilesConfig { job_folder: folder.path().join("other"), ..first.clone() };
    let refused = |config: &TilesConfig| {
        let error = make(&Disk::default(), config).unwrap_err();
        assert_eq!(error.exit_code(), 8, "{error}");
        assert!(error.to_string().contains("--restart"), "{error}");
    };
    stop(&first);
    std::fs::remove_dir_all(first.pending_output()).unwrap();
    refused(&first);
    let restart = |config: &TilesConfig| TilesConfig { restart: true, ..config.clone() };
    stop(&restart(&first));
    // Takes the folder of the first one, which is not at work.
    stop(&second);
    refused(&first);
    make(&Disk::default(), &second).unwrap();
    assert!(files(&second.output) == files(&folder.path().join("whole")));
}

#[test]
fn a_folder_that_a_tree_has_grown_in_goes_with_names_of_its_own_alone() {
    let folder = statue("2000");
    let path = folder.path();
    let left = path.join(".out.stonecut-tiles");
    let make = |name: &str| {
        std::fs::create_dir_all(left.join(name).parent().unwrap()).unwrap();
        std::fs::write(left.join(name), "").unwrap();
        std::fs::write(left.join(".stonecut-job"), "0123456789abcdef").unwrap();
    };
    let bad = "notes tiles/a/0/0-0.glb tiles/0/0/in.ply tiles/0/0/1-2-3.glb tiles tiles/0/12 shapes shapes/tiles/0 sets/0 \
         tiles/0/12/180-3.glb/x shapes/tiles/2/0/7.ids/x sets/0/17.json/x tileset.json/x";
    for name in bad.split(' ') {
        make(name);
        let said = expect(path, &command(&path.join("out")), 2);
        assert!(left.join(name).exists() && said.contains(".out.stonecut-tiles"), "{name}: {said}");
        std::fs::remove_dir_all(&left).unwrap();
    }
    ["tiles/0/12/180-3.glb", "shapes/tiles/2/0/7.ids", "sets/0/17.json"].into_iter().for_each(make);
    expect(path, &command(&path.join("out")), 0);
    assert!(!left.exists() && path.join("out/tileset.json").exists());
}
