//! A small volume that runs full, runs out of inodes or turns read-only in the middle of a run.
//!
//! Needs the right to mount a tmpfs (root); says that it is skipped otherwise. Every stop is clean, has its own
//! exit code and names the remedy; once there is room again the same command ends with the reference bytes.

use crate::common::volume::Volume;
use crate::common::{expect, start};
use std::path::{Path, PathBuf};

struct Bench {
    folder: tempfile::TempDir,
    reference: Vec<u8>,
}

impl Bench {
    fn new() -> Bench {
        let folder = tempfile::tempdir().unwrap();
        expect(folder.path(), "synth terrain in.ply --triangles 300k", 0);
        expect(folder.path(), &command(Path::new("reference.ply")), 0);
        let reference = std::fs::read(folder.path().join("reference.ply")).unwrap();
        Bench { folder, reference }
    }

    /// Stops after the partition, so that what comes next needs room that is no longer there.
    fn partition(&self, output: &Path) {
        expect(self.folder.path(), &format!("{} --until partition", command(output)), 0);
    }

    fn stops(&self, output: &Path, code: i32, words: &[&str]) {
        let said = expect(self.folder.path(), &command(output), code);
        for word in words {
            assert!(said.contains(word), "no '{word}' in: {said}");
        }
        assert!(!said.contains("panicked"), "{said}");
        assert!(!output.exists(), "an output all the same");
    }

    fn completes(&self, output: &Path) {
        expect(self.folder.path(), &command(output), 0);
        assert!(std::fs::read(output).unwrap() == self.reference, "another mesh");
        let left: Vec<PathBuf> = std::fs::read_dir(output.parent().unwrap())
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path != output && !path.ends_with("filler"))
            .collect();
        assert!(left.is_empty(), "{left:?} is left");
    }
}

fn command(output: &Path) -> String {
    format!(
        "simplify in.ply {} --ratio 20% --cell-triangles 10k --threads 1 --quiet",
        output.display()
    )
}

#[test]
fn a_full_disk_stops_the_run_and_room_lets_it_go_on() {
    let Some(volume) = Volume::mount("size=64m") else { return };
    let bench = Bench::new();
    let output = volume.path().join("out.ply");
    let filler = volume.path().join("filler");
    // Room for nothing, and for a little: what the cells give back is enough from somewhere below 1 MiB on.
    for left in [0, 100 << 10] {
        bench.partition(&output);
        // The volume is full although the plan found room: another program was faster.
        let whole = vec![0u8; volume.free_bytes().saturating_sub(left) as usize];
        std::fs::write(&filler, whole).unwrap();
        bench.stops(&output, 5, &["--temp-dir", "make space"]);
        std::fs::remove_file(&filler).unwrap();
        bench.completes(&output);
        std::fs::remove_file(&output).unwrap();
    }
}

#[test]
fn a_disk_that_fills_during_the_run_stops_it() {
    let Some(volume) = Volume::mount("size=64m") else { return };
    let bench = Bench::new();
    let output = volume.path().join("out.ply");
    let filler = volume.path().join("filler");
    let mut stopped = 0;
    // The disk fills as soon as this file is there: at the start, while cells are written, and in the first round.
    for begun in ["manifest.jsonl", "round-0.cells", "round-0.survivors"] {
        let mut run = start(bench.folder.path(), &command(&output));
        let begun = volume.path().join("out.ply.stonecut-job").join(begun);
        while !begun.exists() && run.try_wait().unwrap().is_none() {
            std::thread::yield_now();
        }
        // It waits until the disk is full, however long that takes.
        let is_over = run.try_wait().unwrap().is_some();
        if !is_over {
            crate::common::signal(&run, rustix::process::Signal::STOP);
        }
        // Until nothing more goes in.
        let mut file = std::fs::File::create(&filler).unwrap();
        while std::io::Write::write_all(&mut file, &[0; 1 << 16]).is_ok() {}
        drop(file);
        if !is_over {
            crate::common::signal(&run, rustix::process::Signal::CONT);
        }
        let code = run.wait().unwrap().code();
        assert!(matches!(code, Some(0 | 5)), "{code:?}");
        std::fs::remove_file(&filler).unwrap();
        if code == Some(5) {
            stopped += 1;
            bench.completes(&output);
        }
        std::fs::remove_file(&output).unwrap();
    }
    assert!(stopped >= 2, "{stopped} of 3 runs met the full disk");
}

#[test]
fn without_inodes_the_plan_refuses_and_the_run_stops() {
    let Some(volume) = Volume::mount("size=64m,nr_inodes=60") else { return };
    let bench = Bench::new();
    let output = volume.path().join("out.ply");
    bench.partition(&output);
    let many = volume.path().join("many");
    std::fs::create_dir(&many).unwrap();
    let mut n = 0;
    while std::fs::write(many.join(n.to_string()), b"").is_ok() {
        n += 1;
    }
    bench.stops(&output, 5, &["inodes", "remove some files"]);
    std::fs::remove_dir_all(&many).unwrap();
    bench.completes(&output);
}

#[test]
fn a_read_only_volume_is_refused_with_its_name() {
    let Some(volume) = Volume::mount("size=64m") else { return };
    let bench = Bench::new();
    let output = volume.path().join("out.ply");
    bench.partition(&output);
    volume.remount("remount,ro");
    let name = volume.path().display().to_string();
    bench.stops(&output, 10, &[&name, "cannot write into this folder", "--temp-dir"]);
    volume.remount("remount,rw");
    bench.completes(&output);
}
