//! The table of exit codes in docs/usage.md: each is provoked as it says, and there is no other.

use crate::common::{expect, stonecut};
use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Command, Stdio};
use stonecut::system::parallel::guarded;

const JOB: &str = "simplify in.ply out.ply --triangles 2500 --cell-triangles 1000";

/// The codes of the table, and their names.
fn table() -> Vec<(u8, Vec<String>)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = std::fs::read_to_string(root.join("docs/usage.md")).unwrap();
    let rows = page.split("## Exit codes").nth(1).unwrap().lines().filter_map(|line| {
        let (codes, rest) = line.strip_prefix("| ")?.split_once(" | ")?;
        let names = rest.split(" | ").next()?.split('`').skip(1).step_by(2).map(str::to_owned);
        let codes: Option<Vec<u8>> = codes.split(", ").map(|code| code.parse().ok()).collect();
        Some((codes?, names.collect::<Vec<_>>()))
    });
    rows.flat_map(|(codes, names)| codes.into_iter().map(move |code| (code, names.clone())))
        .collect()
}

/// Runs the command of the shell with `--progress json`; gives the exit code and the name in the last event.
fn run(at: &Path, command: &str) -> (u8, Option<String>) {
    let command =
        command.replace("stonecut", concat!(env!("CARGO_BIN_EXE_stonecut"), " --progress json"));
    let output = Command::new("sh").current_dir(at).args(["-c", &command]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    let end: serde_json::Value = said.lines().last().map_or(serde_json::Value::Null, |line| {
        serde_json::from_str(line).unwrap_or_else(|e| panic!("{command}: {e}: {said}"))
    });
    let code = output.status.code().unwrap_or_else(|| panic!("{command}: {said}"));
    (u8::try_from(code).unwrap(), end["code"].as_str().map(str::to_owned))
}

/// Brings about the exit code in a folder with `in.ply`.
fn provoked(code: u8, at: &Path) -> (u8, Option<String>) {
    let typed = |words: &str| run(at, &format!("stonecut {words}"));
    let job = at.join("out.ply.stonecut-job");
    let begin = || expect(at, &format!("{JOB} --until partition"), 0);
    match code {
        0 => typed("info in.ply"),
        1 => {
            begin();
            for entry in std::fs::read_dir(&job).unwrap().map(|entry| entry.unwrap().path()) {
                if entry.extension().is_some_and(|ending| ending == "cells") {
                    let mut bytes = std::fs::read(&entry).unwrap();
                    let middle = bytes.len() / 4..bytes.len() / 4 * 3;
                    bytes[middle].iter_mut().for_each(|byte| *byte ^= 0x55);
                    std::fs::write(&entry, bytes).unwrap();
                }
            }
            typed(JOB)
        }
        2 => typed("simplify in.ply out.ply"),
        3 => {
            std::fs::write(at.join("bad.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 9\n")
                .unwrap();
            typed("convert bad.obj out.ply --skip-bad")
        }
        4 => typed("info missing.ply"),
        5 => run(at, "ulimit -f 100; exec stonecut convert in.ply out.obj"),
        6 => typed("simplify in.ply out.ply --ratio 50% --memory 1MiB"),
        7 => {
            begin();
            let lock = std::fs::File::open(job.join("lock")).unwrap();
            rustix::fs::flock(&lock, rustix::fs::FlockOperation::NonBlockingLockExclusive).unwrap();
            typed(JOB)
        }
        8 => {
            begin();
            typed("simplify in.ply out.ply --triangles 3000 --cell-triangles 1000")
        }
        // No command does it: a panic is caught where every command runs.
        9 => {
            let error = guarded::<()>(|| panic!("a fault")).unwrap_err();
            (error.exit_code(), Some(error.code().to_owned()))
        }
        10 => typed("convert in.ply /proc/new.ply"),
        130 | 143 => {
            let mut child = stonecut();
            child.current_dir(at).args(["convert", "-", "out.ply", "--progress", "json"]);
            child.stdin(Stdio::piped()).stderr(Stdio::piped());
            let mut child = child.spawn().unwrap();
            // Open until the process has ended: it waits for more.
            let _input = child.stdin.take();
            super::stopping::wait_for_handler(&child);
            super::stopping::signal(&child, if code == 130 { "-INT" } else { "-TERM" });
            let ended = child.wait().unwrap().code().unwrap();
            (u8::try_from(ended).unwrap(), Some("interrupted".to_owned()))
        }
        141 => {
            let (reader, writer) = std::io::pipe().unwrap();
            drop(reader);
            let mut child = stonecut();
            child.current_dir(at).args(["convert", "in.ply", "-"]).stdout(writer);
            (u8::try_from(child.status().unwrap().code().unwrap()).unwrap(), None)
        }
        code => panic!("the table has {code}, and nothing here provokes it"),
    }
}

#[test]
fn every_exit_code_of_the_table_comes_as_it_says() {
    let table = table();
    let codes: BTreeSet<u8> = table.iter().map(|(code, _)| *code).collect();
    assert_eq!(codes.len(), 14, "{codes:?}");
    for (code, names) in table {
        let folder = tempfile::tempdir().unwrap();
        expect(folder.path(), "synth terrain in.ply --triangles 8500", 0);
        let (found, name) = provoked(code, folder.path());
        assert_eq!(found, code, "{name:?}");
        assert!(name.is_none_or(|name| names.contains(&name)), "{code}: not {names:?}");
    }
}
