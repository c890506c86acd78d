//! Progressive meshes: every count is that of a direct run, files are read as far as needed, damaged ones are refused.

use crate::common::{check, count, expect, json, one_in, rms, run, scratch};
use std::path::Path;
use stonecut::progressive::Refiner;
use xxhash_rust::xxh3::xxh3_64;

/// Bytes of a block's head, and the kind of a block of steps.
const HEAD: usize = 48;
const STEPS: u32 = 3;

/// Numbers in a range, spread by a generator of Knuth's.
fn spread(n: u64, low: u64, high: u64) -> impl Iterator<Item = u64> {
    (0..n).scan(1u64, move |x, _| {
        *x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        Some(low + (*x >> 33) % (high - low))
    })
}

fn record(folder: &Path, input: &str, n: u64, name: &str, options: &str) {
    let line = format!(
        "simplify {input} {name}.ply --triangles {n} --progressive {name}.pm --force {options}"
    );
    let output = run(folder, &line);
    // Some counts are too few for the scan: exit code 3.
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{line}\n{said}");
}

/// Holds refined meshes against direct runs.
fn same_as_direct_runs(folder: &Path, input: &str, n: u64, range: (u64, u64), options: &str) {
    record(folder, input, range.0, "base", options);
    for target in spread(n, range.0, range.1).step_by(one_in(2)) {
        expect(folder, &format!("refine base.pm refined.ply --triangles {target} --force"), 0);
        record(folder, input, target, "direct", options);
        let [refined, direct] =
            ["refined.ply", "direct.ply"].map(|name| std::fs::read(folder.join(name)).unwrap());
        assert!(refined == direct, "{input} {options}: {target} triangles");
    }
}

#[test]
fn every_count_of_a_closed_surface_is_a_direct_run_byte_for_byte() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth statue in.ply --triangles 12000", 0);
    same_as_direct_runs(folder.path(), "in.ply", 40, (200, 12_000), "");
    // Small meshes have no levels: the order of runs without a record is the same.
    expect(folder.path(), "simplify in.ply plain.ply --triangles 3000 --fit off", 0);
    expect(folder.path(), "refine base.pm refined.ply --triangles 3000 --force", 0);
    let [a, b] = ["plain.ply", "refined.ply"].map(|name| {
        let bytes = std::fs::read(folder.path().join(name)).unwrap();
        let end = bytes.windows(11).position(|word| word == b"end_header\n").unwrap();
        bytes[end..].to_vec()
    });
    assert!(a == b);
}

/// Colours weigh, components vanish, handles are cut, boundaries and half-edge collapses.
#[test]
fn attributes_and_changes_of_the_topology_are_taken_back_byte_for_byte() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth scans scans.ply --triangles 12000", 0);
    expect(folder.path(), "synth gyroid gyroid.ply --triangles 12000", 0);
    expect(folder.path(), "synth terrain terrain.ply --triangles 12000", 0);
    same_as_direct_runs(folder.path(), "scans.ply", 16, (300, 12_000), "");
    same_as_direct_runs(folder.path(), "scans.ply", 8, (300, 12_000), "--placement subset");
    same_as_direct_runs(folder.path(), "gyroid.ply", 16, (100, 3000), "");
    same_as_direct_runs(folder.path(), "gyroid.ply", 12, (3000, 12_000), "");
    same_as_direct_runs(folder.path(), "terrain.ply", 8, (100, 12_000), "--normals drop");
}

#[test]
fn both_ends_and_what_lies_beyond_them() {
    let folder = &scratch();
    expect(folder, "synth statue in.ply --triangles 8000", 0);
    record(folder, "in.ply", 1000, "base", "");
    let n = count(&check(folder, "in.ply"), "triangles");
    let said = expect(folder, "refine base.pm fine.ply --triangles 1M --report r.json", 0);
    assert!(said.contains("no finer mesh"), "{said}");
    assert_eq!(count(&check(folder, "fine.ply"), "triangles"), n);
    assert!(rms(folder, "in.ply", "fine.ply") < 1e-12);
    let report = json(folder, "r.json");
    assert_eq!(report["output"]["triangles"], n);
    assert_eq!(report["target_met"], true);
    let said = expect(folder, "refine base.pm coarse.ply --triangles 500", 3);
    assert!(said.contains("coarsest mesh of the file has 1000"), "{said}");
    expect(folder, "refine base.pm coarse.ply --triangles 1000", 2);
    expect(folder, "refine base.pm coarse.glb --triangles 2000", 0);
    expect(folder, "refine base.pm coarse.obj --triangles 2000", 0);
    assert_eq!(count(&check(folder, "coarse.obj"), "triangles"), 2000);
    let said = expect(folder, "refine in.ply x.ply --triangles 2000", 4);
    assert!(said.contains("not a progressive mesh"), "{said}");
}

#[test]
fn an_interrupted_run_continues_with_the_same_record() {
    let folder = &scratch();
    expect(folder, "synth statue in.ply --triangles 8000", 0);
    record(folder, "in.ply", 1000, "whole", "--cell-triangles 1000");
    let line =
        "simplify in.ply part.ply --triangles 1000 --progressive part.pm --cell-triangles 1000";
    expect(folder, &format!("{line} --until stitch"), 0);
    assert!(!folder.join("part.pm").exists());
    expect(folder, line, 0);
    for ending in ["ply", "pm"] {
        let [a, b] = ["whole", "part"]
            .map(|name| std::fs::read(folder.join(format!("{name}.{ending}"))).unwrap());
        assert!(a == b, "{ending}");
    }
}

#[test]
fn what_is_not_a_collapse_is_refused() {
    let folder = &scratch();
    expect(folder, "synth statue in.ply --triangles 2000", 0);
    let base = "simplify in.ply out.ply --progressive out.pm";
    for options in [
        "--triangles 500 --fit on",
        "--triangles 500 --topology keep",
        "--triangles 500 --normals recompute",
        "--triangles 500,100",
        "--max-error 0.1",
        "--triangles 1M",
        "--triangles 500 --method cluster",
        "--triangles 500 --progressive-bits 30",
    ] {
        let said = expect(folder, &format!("{base} {options}"), 2);
        assert!(said.contains("progressive"), "{options}: {said}");
    }
    assert!(!folder.join("out.pm").exists());
}

/// Where blocks begin, with their kinds.
fn blocks(bytes: &[u8]) -> Vec<(usize, u32)> {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let mut at = 24 + word(12) as usize;
    let mut found = Vec::new();
    while at < bytes.len() {
        found.push((at, word(at + 4)));
        at += HEAD + word(at + 12) as usize;
    }
    found
}

#[test]
fn a_prefix_is_a_mesh_and_what_is_missing_is_named() {
    let folder = &scratch();
    expect(folder, "synth statue in.ply --triangles 90000", 0);
    for options in ["", "--progressive-bits 16"] {
        record(folder, "in.ply", 1000, "base", options);
        let bytes = std::fs::read(folder.join("base.pm")).unwrap();
        let steps: Vec<usize> =
            blocks(&bytes).iter().filter(|block| block.1 == STEPS).map(|block| block.0).collect();
        assert!(steps.len() > 1);
        let last = steps[steps.len() - 1];
        let cut = last + (bytes.len() - last) / 2;
        std::fs::write(folder.join("cut.pm"), &bytes[..cut]).unwrap();
        let said = expect(folder, "refine cut.pm fine.ply --triangles 1M --force", 4);
        assert!(said.contains(&format!("byte offset {last}")), "{said}");
        assert!(said.contains("block"), "{said}");
        let n = said.split("--triangles ").nth(1).unwrap().split(' ').next().unwrap();
        expect(folder, &format!("refine cut.pm a.ply --triangles {n} --force"), 0);
        expect(folder, &format!("refine base.pm b.ply --triangles {n} --force"), 0);
        let [a, b] = ["a.ply", "b.ply"].map(|name| std::fs::read(folder.join(name)).unwrap());
        assert!(a == b);
        assert_eq!(count(&check(folder, "a.ply"), "boundary_edges"), 0);
        // The base alone is a mesh.
        std::fs::write(folder.join("cut.pm"), &bytes[..steps[0]]).unwrap();
        expect(folder, "refine cut.pm a.ply --triangles 1000 --force", 0);
        assert_eq!(count(&check(folder, "a.ply"), "triangles"), 1000);
    }
}

#[test]
fn compact_files_hold_the_same_surface_within_their_steps() {
    let folder = &scratch();
    expect(folder, "synth scans in.ply --triangles 30000", 0);
    record(folder, "in.ply", 1000, "exact", "");
    record(folder, "in.ply", 1000, "compact", "--progressive-bits 16");
    let length = |name: &str| std::fs::metadata(folder.join(name)).unwrap().len();
    assert!(3 * length("compact.pm") < 2 * length("exact.pm"));
    for n in [1000, 2345, 10_000, 1_000_000] {
        for name in ["exact", "compact"] {
            let code = expect(
                folder,
                &format!("refine {name}.pm {name}-r.ply --triangles {n} --force"),
                0,
            );
            assert!(!code.is_empty());
        }
        let [a, b] = ["exact-r.ply", "compact-r.ply"].map(|name| check(folder, name));
        let apart = count(&a, "triangles") - count(&b, "triangles");
        assert!((-2..=2).contains(&apart), "{n}: {a} {b}");
        for key in ["non_manifold_edges", "duplicate_triangles", "inconsistent_edges"] {
            assert_eq!(count(&a, key), count(&b, key), "{n}: {key}");
        }
        let [a, b] = ["exact-r.ply", "compact-r.ply"].map(|name| rms(folder, "in.ply", name));
        // 16 bits of an extent of about 2,000; batches are not quite in the order of the run.
        assert!(b < 1.6 * a + 0.03, "{n}: {a} {b}");
    }
}

/// The eye looks at one side of a closed surface: there the mesh is fine, and nowhere does it have a crack.
#[test]
fn a_mesh_for_an_eye_is_fine_where_it_looks_and_has_no_cracks() {
    let folder = &scratch();
    for (kind, options) in [("statue", ""), ("gyroid", ""), ("statue", "--progressive-bits 16")] {
        expect(folder, &format!("synth {kind} in.ply --triangles 30000 --force"), 0);
        record(folder, "in.ply", 500, "base", options);
        let bounds = check(folder, "in.ply");
        let fine = count(&bounds, "triangles");
        expect(folder, "refine base.pm all.ply --triangles 1M --force", 0);
        let all = check(folder, "all.ply");
        let mut counts = Vec::new();
        for pixels in ["0", "0.3", "1", "4", "1000000"] {
            let line = format!(
                "refine base.pm eye.ply --view -3000,0,0,0,0,0,50 --pixels {pixels} --force --report r.json"
            );
            expect(folder, &line, 0);
            let found = check(folder, "eye.ply");
            for key in ["boundary_edges", "non_manifold_edges", "inconsistent_edges"] {
                assert_eq!(count(&found, key), count(&all, key), "{kind} {pixels}: {key}");
            }
            counts.push(count(&found, "triangles"));
        }
        assert!(counts.windows(2).all(|pair| pair[0] >= pair[1]), "{counts:?}");
        assert!(counts[0] < fine && counts[2] < counts[0], "{kind}: {counts:?} of {fine}");
        assert_eq!(counts[4], 500, "{counts:?}");
        // From far away, and looking elsewhere.
        expect(
            folder,
            "refine base.pm away.ply --view -3000,0,0,-6000,0,0,30 --pixels 0.1 --force",
            0,
        );
        assert_eq!(count(&check(folder, "away.ply"), "triangles"), 500);
    }
}

/// Any byte of a file may be another one: every answer is a mesh or an error about the input.
#[test]
fn flipped_bytes_never_panic() {
    let folder = &scratch();
    expect(folder, "synth gyroid in.ply --triangles 3000", 0);
    for options in ["", "--progressive-bits 12"] {
        record(folder, "in.ply", 100, "base", options);
        let bytes = std::fs::read(folder.join("base.pm")).unwrap();
        let n = bytes.len();
        let refine = |bytes: Vec<u8>, is_bad: bool, at: u64| {
            let ended = Refiner::of_bytes(bytes, 1 << 28).and_then(|mut mesh| {
                mesh.refine(u64::MAX, &|| Ok(()))?;
                let ordered = mesh.ordered();
                ordered.records(|_| Ok(()))?;
                ordered.triangles(|_| Ok(()))
            });
            match ended {
                Ok(_) => assert!(!is_bad, "byte {at} of {n} was not missed"),
                Err(error) => assert!([4, 6].contains(&error.exit_code()), "{error}"),
            }
        };
        refine(bytes.clone(), false, 0);
        for at in spread(400, 0, bytes.len() as u64) {
            let mut bad = bytes.clone();
            bad[at as usize] ^= 1 << (at % 8);
            refine(bad, true, at);
        }
        for at in spread(50, 0, bytes.len() as u64) {
            refine(bytes[..at as usize].to_vec(), true, at);
        }
        // With checksums that fit, and columns as they are: the numbers themselves are wrong.
        let plain = unpacked(&bytes);
        refine(plain.clone(), false, 0);
        let begin = blocks(&plain)[0].0 as u64;
        for (i, at) in spread(1500, begin, plain.len() as u64).enumerate() {
            let mut bad = plain.clone();
            bad[at as usize] = (i * 37 % 256) as u8;
            refine(resealed(bad, &plain), false, at);
        }
    }
}

/// The file with columns that are not compressed.
fn unpacked(bytes: &[u8]) -> Vec<u8> {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let found = blocks(bytes);
    let mut out = bytes[..found[0].0].to_vec();
    for &(start, _) in &found {
        let end = start + HEAD + word(start + 12) as usize;
        let mut payload = Vec::new();
        let mut at = start + HEAD;
        while at < end {
            let (length, packed) = (word(at) as usize, word(at + 4) as usize);
            let column = &bytes[at + 8..at + 8 + packed];
            payload.extend((length as u32).to_le_bytes());
            payload.extend((length as u32).to_le_bytes());
            match packed == length {
                true => payload.extend_from_slice(column),
                false => payload.extend(zstd::bulk::decompress(column, length).unwrap()),
            }
            at += 8 + packed;
        }
        let mut head = bytes[start..start + HEAD].to_vec();
        head[12..16].copy_from_slice(&(payload.len() as u32).to_le_bytes());
        out.extend(head);
        out.extend(payload);
    }
    resealed(out.clone(), &out)
}

/// The file with checksums that fit; blocks lie where those of `like` do.
fn resealed(mut bytes: Vec<u8>, like: &[u8]) -> Vec<u8> {
    let starts: Vec<usize> = blocks(like).iter().map(|block| block.0).collect();
    for (i, &start) in starts.iter().enumerate() {
        let end = starts.get(i + 1).copied().unwrap_or(bytes.len());
        let sum = xxh3_64(&bytes[start + HEAD..end]).to_le_bytes();
        bytes[start + 32..start + 40].copy_from_slice(&sum);
        let sum = xxh3_64(&bytes[start..start + 40]).to_le_bytes();
        bytes[start + 40..start + HEAD].copy_from_slice(&sum);
    }
    bytes
}
