//! `simplify --verify` and heatmaps: the numbers of `measure`, in any budget, and nothing left behind.

use crate::common::{count, expect, json, scratch};
use std::path::Path;
use stonecut::io::ply::{MeshSource, VertexBlock};

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap().flatten();
    let mut names: Vec<_> = entries.map(|e| e.file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn verified_in_the_run_is_what_measure_says_afterwards() {
    let out = &scratch();
    expect(out, "synth scans in.ply --triangles 300k", 0);
    let simplify = "simplify in.ply out.ply --ratio 5% --cell-triangles 20k --verify --force";
    // The second budget holds no mesh of this size together with its tree.
    for memory in ["2GiB", "96MiB"] {
        let said = expect(out, &format!("{simplify} --memory {memory} --report run.json"), 0);
        assert!(said.contains("rms both ways"), "{said}");
        assert!(said.contains("Hausdorff distance from "), "{said}");
        let run = json(out, "run.json");
        let verified = &run["measured"];
        assert_eq!(verified["cells"].as_u64().unwrap() > 0, memory == "96MiB", "{memory}");
        expect(out, "measure in.ply out.ply --report measured.json", 0);
        let measured = json(out, "measured.json");
        for key in ["forward", "backward", "rms", "diagonal", "relative_rms", "samples"] {
            assert_eq!(verified[key], measured[key], "{memory}: {key}");
        }
        for mesh in ["original", "simplified"] {
            assert_eq!(verified[mesh]["topology"], measured[mesh]["topology"], "{memory}: {mesh}");
        }
        assert!(verified["forward"]["rms"].as_f64().unwrap() > 0.0);
        let enclosed = &run["hausdorff"];
        assert_eq!(
            (enclosed, &enclosed["certified"]),
            (&verified["hausdorff"], &serde_json::Value::Bool(true))
        );
        let [lower, upper] = ["lower", "upper"].map(|end| enclosed[end].as_f64().unwrap());
        let max = |side: &str| verified[side]["max"].as_f64().unwrap();
        let sampled = max("forward").max(max("backward"));
        assert!(lower >= sampled * (1.0 - 1e-9) && upper >= lower, "{sampled} {enclosed}");
        assert!(upper - lower <= 0.01 * upper, "{enclosed}");
        let stages = run["stages"].as_array().unwrap();
        assert_eq!(stages.last().unwrap()["name"], "verify");
        assert!(
            count(&run, "peak_memory_bytes") < (if memory == "96MiB" { 96 } else { 2048 }) << 20
        );
        let left = ["in.ply", "measured.json", "out.ply", "run.json"];
        assert_eq!(names(out), left, "{memory}");
    }
}

#[test]
fn what_a_killed_verification_left_goes() {
    let out = &scratch();
    expect(out, "synth terrain in.ply --triangles 50k", 0);
    let simplify = "simplify in.ply out.ply --ratio 5% --cell-triangles 10k --verify";
    expect(out, &format!("{simplify} --until stitch"), 0);
    let left = out.join("out.ply.stonecut-job/in.ply.1-0.stonecut-scratch");
    std::fs::create_dir(&left).unwrap();
    std::fs::write(left.join("round-0.cells"), b"half of it").unwrap();
    expect(out, simplify, 0);
    assert_eq!(names(out), ["in.ply", "out.ply"]);
}

#[test]
fn what_cannot_be_read_again_is_refused_before_work() {
    let out = &scratch();
    expect(out, "synth terrain in.ply --triangles 20k", 0);
    for (files, word) in [("in.ply o.glb", "GLB"), ("in.ply -", "output"), ("- o.ply", "input")] {
        let said = expect(out, &format!("simplify {files} --ratio 5% --verify"), 2);
        assert!(said.contains("--verify") && said.contains(word), "{said}");
    }
    assert_eq!(names(out), ["in.ply"]);
}

/// Vertex records and the header's comments.
fn vertices(path: &Path) -> (Vec<u8>, Vec<String>) {
    let source = MeshSource::open(path).unwrap();
    let (mut block, mut records) = (VertexBlock::default(), Vec::new());
    for i in 0..source.n_vertex_blocks() {
        source.read_vertices(i, &mut block).unwrap();
        records.extend_from_slice(&block.records);
    }
    (records, source.comments().to_vec())
}

#[test]
fn either_mesh_is_coloured_by_its_distance_to_the_other() {
    let out = &scratch();
    expect(out, "synth terrain in.ply --triangles 300k", 0);
    expect(out, "simplify in.ply out.ply --ratio 2% --cell-triangles 40k", 0);
    for (which, mesh) in [("original", "in.ply"), ("simplified", "out.ply")] {
        let heat = |name: &str, memory: &str| {
            let options = "--samples 10k --cell-triangles 20k --force";
            let files = format!("in.ply out.ply --heatmap {name} --heatmap-of {which}");
            expect(out, &format!("measure {files} {options} --memory {memory}"), 0);
            std::fs::read(out.join(name)).unwrap()
        };
        let coloured = heat("a.ply", "2GiB");
        assert!(coloured == heat("b.ply", "72MiB"), "{which}: memory shows");
        let (records, comments) = vertices(&out.join("a.ply"));
        assert!(comments.iter().any(|line| line.starts_with("scale: 0 = dark violet")));
        // The same vertices, in the same order.
        let (plain, _) = vertices(&out.join(mesh));
        assert_eq!(records.len() / 15, plain.len() / 12, "{which}");
        let same = records.chunks_exact(15).zip(plain.chunks_exact(12)).all(|(a, b)| a[..12] == *b);
        assert!(same, "{which}");
        // Both ends of the scale are there: violet on the surface, yellow where it is far.
        let has = |rgb: [u8; 3]| records.chunks_exact(15).any(|record| record[12..] == rgb);
        assert!(has([253, 231, 37]), "{which}");
        assert!(
            records.chunks_exact(15).any(|record| record[14] > 80 && record[13] < 60),
            "{which}"
        );
    }
}

#[test]
fn meshes_that_lie_apart_are_named() {
    let out = &scratch();
    for (name, x) in [("a.obj", 0), ("b.obj", 100)] {
        let text = format!("v {x} 0 0\nv {} 0 0\nv {x} 1 0\nf 1 2 3\n", x + 1);
        std::fs::write(out.join(name), text).unwrap();
    }
    let said = expect(out, "measure a.obj b.obj --samples 100", 0);
    assert!(said.contains("the meshes lie 99 apart"), "{said}");
    assert!(!expect(out, "measure a.obj a.obj --samples 100", 0).contains("apart"));
}

#[test]
fn quiet_commands_say_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for command in [
        "synth terrain a.ply --triangles 2k -q",
        "convert a.ply b.obj -q",
        "simplify a.ply c.ply --ratio 50% --cell-triangles 1k -q",
        "render c.ply -o c.png --size 80x60 -q",
    ] {
        assert_eq!(expect(folder.path(), command, 0), "", "{command}");
    }
}
