//! Job files with right checksums and wrong contents: records of the manifest and chunks of packs. No run may panic, hang, or take
//! memory that its files are not worth; a wrong mesh cannot be told from a right one and is nobody's promise.
//!
//! `STONECUT_FORGED=N` forges N files at each of three stages and `STONECUT_FUZZ_SEED=S` others than the usual ones.

#![allow(clippy::print_stdout)] // The figures of a long run.

use crate::common::{expect, scratch};
use crate::spoiled::{Random, judge_codes, number};
use serde_json::Value;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

const COMMAND: &str =
    "simplify in.ply out.ply --triangles 4400 --cell-triangles 1000 --threads 1 -q";
/// Bytes before the first chunk of a pack, and of the head of a chunk (docs/format.md).
const PACK_HEAD: usize = 16;
const CHUNK_HEAD: usize = 32;

/// Numbers that arithmetic stumbles over.
const WRONG: [u64; 8] = [0, 1, 3, 255, 0xffff_ffff, 1 << 32, i64::MAX as u64, u64::MAX];

/// All values of a JSON text that are no list and no object.
fn leaves<'a>(value: &'a mut Value, out: &mut Vec<&'a mut Value>) {
    match value {
        Value::Array(list) => list.iter_mut().for_each(|value| leaves(value, out)),
        Value::Object(map) => map.values_mut().for_each(|value| leaves(value, out)),
        _ => out.push(value),
    }
}

/// Another number, no value, a longer or a shorter list: anywhere in a line.
fn forge_json(line: &mut Value, random: &mut Random) {
    let mut all = Vec::new();
    leaves(line, &mut all);
    let n = all.len();
    if let Some(leaf) = all.into_iter().nth(random.below(n)) {
        *leaf = match (random.below(8), &leaf) {
            (0, _) => Value::Null,
            (1, _) => Value::from("x"),
            (2, _) => Value::from(-1),
            (3, _) => Value::from(1e308),
            (4, Value::Number(old)) => Value::from(old.as_f64().unwrap_or(0.0) * 2.0 + 1.0),
            (5, Value::Number(old)) => {
                Value::from(old.as_u64().unwrap_or(7) ^ 1 << random.below(40))
            }
            _ => Value::from(random.of(&WRONG)),
        };
    }
}

/// Forges a line of a text of lines with checksums.
fn forge_lines(text: &[u8], random: &mut Random) -> Vec<u8> {
    let text = String::from_utf8_lossy(text).into_owned();
    let lines: Vec<&str> = text.lines().collect();
    let chosen = random.below(lines.len());
    let forged = |(i, line): (usize, &&str)| {
        let (json, _) = line.split_once('\t').unwrap();
        let mut value: Value = serde_json::from_str(json).unwrap();
        if i == chosen {
            forge_json(&mut value, random);
        }
        let json = value.to_string();
        format!("{json}\t{:016x}\n", xxh3_64(json.as_bytes()))
    };
    lines.iter().enumerate().map(forged).collect::<String>().into_bytes()
}

fn word(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// Writes the checksums of the chunk whose head is at `at` anew; returns those of its payload, old and new.
fn seal(pack: &mut [u8], at: usize) -> [u64; 2] {
    let n = word(pack, at + 8) as usize;
    let old = word(pack, at + 16);
    let new = xxh3_64(&pack[at + CHUNK_HEAD..at + CHUNK_HEAD + n]);
    pack[at + 16..at + 24].copy_from_slice(&new.to_le_bytes());
    let head = xxh3_64(&pack[at..at + 24]);
    pack[at + 24..at + 32].copy_from_slice(&head.to_le_bytes());
    [old, new]
}

/// Forges the payload of a chunk, and its checksum wherever it stands.
fn forge_pack(pack: &[u8], random: &mut Random) -> Vec<u8> {
    let mut pack = pack.to_vec();
    let (mut chunks, mut at) = (Vec::new(), PACK_HEAD);
    while at + CHUNK_HEAD <= pack.len() {
        chunks.push(at);
        at += CHUNK_HEAD + word(&pack, at + 8) as usize;
    }
    let full: Vec<usize> = chunks.iter().copied().filter(|&at| word(&pack, at + 8) > 0).collect();
    let Some(&chosen) = full.get(random.below(full.len())) else { return pack };
    let n = word(&pack, chosen + 8) as usize;
    let place = chosen + CHUNK_HEAD + random.below(n);
    match random.below(3) {
        0 => pack[place] ^= 1 << random.below(8),
        _ => {
            let end = (chosen + CHUNK_HEAD + n).min(place + [1, 4, 8][random.below(3)]);
            pack[place..end].copy_from_slice(&random.of(&WRONG).to_le_bytes()[..end - place]);
        }
    }
    let [old, new] = seal(&mut pack, chosen);
    if let Some(&index) = chunks.last().filter(|&&index| index != chosen) {
        for at in index + CHUNK_HEAD..pack.len().saturating_sub(7) {
            if word(&pack, at) == old {
                pack[at..at + 8].copy_from_slice(&new.to_le_bytes());
            }
        }
        seal(&mut pack, index);
    }
    pack
}

fn files(job: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(job)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.is_file())
        .map(|path| (path.clone(), std::fs::read(path).unwrap()))
        .collect();
    files.sort();
    files
}

#[test]
fn forged_job_files_are_refused_or_read() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 8500", 0);
    let (job, output) = (at.join("out.ply.stonecut-job"), at.join("out.ply"));
    let mut random = Random::new(123);
    let n = number("STONECUT_FORGED").unwrap_or(12);
    let arguments: Vec<&str> = COMMAND.split(' ').collect();
    for until in ["partition", "simplify", "stitch"] {
        expect(at, &format!("{COMMAND} --until {until}"), 0);
        let sound = files(&job);
        for _ in 0..n {
            let of_kind = |wanted: bool| {
                let is_lines = |path: &Path| path.ends_with("manifest.jsonl");
                let is_pack = |bytes: &[u8]| bytes.starts_with(b"stonecut pack");
                let fits = |(path, bytes): &&(PathBuf, Vec<u8>)| {
                    if wanted { is_lines(path) } else { is_pack(bytes) }
                };
                sound.iter().filter(fits).collect::<Vec<_>>()
            };
            let is_lines = random.below(2) == 0;
            let list = of_kind(is_lines);
            let (path, bytes) = list[random.below(list.len())];
            let forge = if is_lines { forge_lines } else { forge_pack };
            let forged = forge(bytes, &mut random);
            std::fs::write(path, &forged).unwrap();
            std::fs::write(at.join("forged"), forged).unwrap();
            judge_codes(at, &arguments, "forged", |code| matches!(code, 0..=8));
            let _ = std::fs::remove_file(&output);
            let _ = std::fs::remove_dir_all(&job);
            std::fs::create_dir(&job).unwrap();
            sound.iter().for_each(|(path, bytes)| std::fs::write(path, bytes).unwrap());
        }
        println!("{until}: {n} files forged, no fault");
    }
}

#[test]
fn fewer_vertices_than_there_are_rows_are_found() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 8500", 0);
    expect(at, &format!("{COMMAND} --until partition"), 0);
    let path = at.join("out.ply.stonecut-job/manifest.jsonl");
    let forge = |line: &str| {
        let mut value: Value = serde_json::from_str(line.split('\t').next().unwrap()).unwrap();
        if let Some(n) = value.pointer_mut("/outcome/0/store/cells/2/vertices") {
            *n = Value::from(1);
        }
        let json = value.to_string();
        format!("{json}\t{:016x}\n", xxh3_64(json.as_bytes()))
    };
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.lines().map(forge).collect::<String>()).unwrap();
    let said = expect(at, COMMAND, 1);
    assert!(said.contains("more vertices of cell 2") && said.contains("--restart"), "{said}");
}

/// A note of a part of the partition, on a vertex that a cell uses which is not there.
#[test]
fn a_note_on_a_cell_that_is_not_there_is_found() {
    const FOREIGN: u32 = 5;
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 8500", 0);
    expect(
        at,
        "plan job in.ply out.ply --triangles 4400 --cell-triangles 1000 --units 2 --parts 2",
        0,
    );
    for unit in ["scan/0", "scan/1", "tree/0", "scatter/0", "scatter/1"] {
        expect(at, &format!("work job {unit} -q"), 0);
    }
    let mut n_forged = 0;
    for (path, mut pack) in files(&at.join("job/units")) {
        let mut place = PACK_HEAD;
        let mut chunks = Vec::new();
        while pack.starts_with(b"stonecut pack") && place + CHUNK_HEAD <= pack.len() {
            chunks.push(place);
            place += CHUNK_HEAD + word(&pack, place + 8) as usize;
        }
        let is_note = |at: &usize| pack[at + 4..at + 8] == FOREIGN.to_le_bytes();
        for at in chunks.iter().copied().filter(is_note).collect::<Vec<_>>() {
            let (begin, n) = (at + CHUNK_HEAD, word(&pack, at + 8) as usize);
            for row in pack[begin..begin + n].chunks_exact_mut(12) {
                row[8..].fill(99);
            }
            let [old, new] = seal(&mut pack, at);
            let index = *chunks.last().unwrap();
            for at in index + CHUNK_HEAD..pack.len() - 7 {
                if word(&pack, at) == old {
                    pack[at..at + 8].copy_from_slice(&new.to_le_bytes());
                }
            }
            seal(&mut pack, index);
            n_forged += 1;
        }
        std::fs::write(path, pack).unwrap();
    }
    assert!(n_forged > 0);
    // Either part may have taken the note up.
    let said = ["share/0", "share/1"].map(|unit| {
        let output = crate::common::run(at, &format!("work job {unit} -q --wait 0"));
        assert!(matches!(output.status.code(), Some(0 | 1)), "{unit}: {:?}", output.status);
        String::from_utf8_lossy(&output.stderr).into_owned()
    });
    assert!(said.concat().contains("cell 1667457891"), "{said:?}");
}
