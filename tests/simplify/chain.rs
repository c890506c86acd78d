//! A chain of levels in one run: every file exact, as good as a run of its own, and found again after an interruption.

use crate::common::{check, count, expect, json, rms, scratch};
use std::path::Path;

fn statue(folder: &Path) {
    expect(folder, "synth statue in.ply --triangles 120k --seed 5", 0);
}

#[test]
fn every_level_is_exact_and_as_good_as_a_run_alone() {
    let at = &scratch();
    statue(at);
    // Too large for a finish, a finish, another from what the first took in.
    let common = "--cell-triangles 5k";
    expect(
        at,
        &format!(
            "simplify in.ply out.ply --triangles 1500,30k,3k {common} --report r.json --verify"
        ),
        0,
    );
    let report = json(at, "r.json");
    assert_eq!(report["settings"]["coarser"], "triangles=3000,triangles=1500");
    assert_eq!((count(&report["output"], "triangles"), count(&report, "target")), (1500, 1500));
    for (number, (word, n)) in [("30k", 30_000), ("3k", 3000), ("1500", 1500)].iter().enumerate() {
        let name = format!("out-{word}.ply");
        let found = check(at, &name);
        let triangles = count(&found, "triangles");
        assert!(triangles <= *n && triangles as f64 >= 0.995 * *n as f64, "{name}: {triangles}");
        assert_eq!(
            (count(&found, "boundary_edges"), count(&found, "components")),
            (0, 1),
            "{name}"
        );
        let level = &report["levels"][number];
        assert_eq!(level["path"].as_str(), Some(name.as_str()));
        assert_eq!((count(level, "target"), count(level, "triangles")), (*n, triangles));
        assert!(level["target_met"].as_bool().unwrap(), "{level}");

        expect(at, &format!("simplify in.ply alone.ply --triangles {n} {common} --force"), 0);
        let (chained, alone) = (rms(at, "in.ply", &name), rms(at, "in.ply", "alone.ply"));
        assert!(chained <= 1.03 * alone, "{name}: {chained} {alone}");
        let stated = level["rms"].as_f64().unwrap();
        assert!((stated / chained - 1.0).abs() < 0.05, "{name}: {stated} {chained}");
        assert!(level["hausdorff"]["upper"].as_f64().unwrap() >= stated, "{level}");
        if number == 0 {
            let same = std::fs::read(at.join(&name)).unwrap()
                == std::fs::read(at.join("alone.ply")).unwrap();
            assert!(same, "the finest level is the result of a run to it alone");
        }
    }
    // Another list with the same beginning: the same files.
    expect(
        at,
        &format!(
            "simplify in.ply {{}}.ply --triangles 30k,3k {common} --memory 200MiB --threads 1"
        ),
        0,
    );
    for word in ["30k", "3k"] {
        let (one, other) = (format!("out-{word}.ply"), format!("{word}.ply"));
        assert!(
            std::fs::read(at.join(&one)).unwrap() == std::fs::read(at.join(other)).unwrap(),
            "{one}"
        );
    }
}

#[test]
fn shares_and_obj_make_a_chain_too() {
    let at = &scratch();
    statue(at);
    expect(at, "simplify in.ply out.obj --ratio 10%,1%", 0);
    let n = count(&check(at, "in.ply"), "triangles") as f64;
    for (name, share) in [("out-10%.obj", 0.1), ("out-1%.obj", 0.01)] {
        let wanted = (n * share).round() as i64;
        assert!((wanted - 1..=wanted).contains(&count(&check(at, name), "triangles")), "{name}");
    }
    let said = expect(at, "simplify in.ply plan.ply --ratio 10%,1% --dry-run", 0);
    assert!(said.contains(" triangles, a file each"), "{said}");
}

#[test]
fn lists_that_make_no_sense_are_refused_before_the_first_byte() {
    let at = &scratch();
    statue(at);
    for (options, says) in [
        ("out.ply --triangles 3k,3000", "same level"),
        ("- --triangles 3k,2k", "a file for each level"),
        ("out.ply --triangles 3k,2k --max-error 1", "one target"),
        ("out.ply --triangles 3k,2k --method cluster", "a list of targets"),
        ("out.ply --ratio 1%,0.999999%", "fewer than the one before"),
        ("out.ply --ratio 1%,0.0001%", "less than one"),
        ("in.ply --triangles 3k,2k --report in-2k.ply", "same file"),
    ] {
        let said = expect(at, &format!("simplify in.ply {options}"), 2);
        assert!(said.contains(says), "{options}: {said}");
    }
    std::fs::write(at.join("out-2k.ply"), "mine").unwrap();
    let said = expect(at, "simplify in.ply out.ply --triangles 3k,2k", 2);
    assert!(said.contains("out-2k.ply") && said.contains("--force"), "{said}");
    let left: Vec<_> = std::fs::read_dir(at).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), 2, "{left:?}");
}
