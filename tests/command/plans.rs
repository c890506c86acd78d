//! Bytes that plans promise, against those of the run: within 15 %.

use crate::common::{expect, scratch};
use serde_json::Value;
use std::path::Path;

/// Bytes of a file, or of all files of a folder.
fn bytes(path: &Path) -> u64 {
    if !path.is_dir() {
        return std::fs::metadata(path).unwrap().len();
    }
    std::fs::read_dir(path).unwrap().map(|entry| bytes(&entry.unwrap().path())).sum()
}

#[test]
fn bytes_of_plans_are_those_of_the_runs() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 100k", 0);
    expect(at, "simplify in.ply half.ply --ratio 50%", 0);
    // The command, its outputs, and whether its report has what its temporary files took.
    for (command, outputs, has_temp) in [
        ("simplify in.ply o.ply --ratio 10%", "o.ply", true),
        ("simplify in.ply c.ply --ratio 40%,10%", "c-40%.ply c-10%.ply", true),
        ("simplify in.ply p.ply --ratio 5% --progressive p.pm", "p.ply p.pm", true),
        ("simplify in.ply m.ply --ratio 5% --method cluster", "m.ply", true),
        ("simplify half.ply d.ply --ratio 5% --method retile", "d.ply", true),
        ("simplify in.ply b.ply --max-error 0.5", "b.ply", true),
        ("convert in.ply v.obj", "v.obj", false),
        ("convert in.ply v.glb", "v.glb", false),
        ("convert in.ply v.stl", "v.stl", false),
        ("measure in.ply half.ply --samples 1k", "", true),
    ] {
        let said = expect(at, &format!("{command} --progress json"), 0);
        let events: Vec<Value> =
            said.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let plan = &events.iter().find(|event| event["event"] == "plan").unwrap()["plan"];
        let near = |what: &str, planned: &Value, found: u64| {
            let planned = planned.as_u64().unwrap_or(0);
            // A manifest is planned for by its largest size.
            let slack = if what == "temporary" { 64 << 10 } else { 0 };
            let (least, most) = (found * 85 / 100, found * 115 / 100 + slack);
            assert!((least..=most).contains(&planned), "{command}: {what} {planned}, not {found}");
        };
        let found: u64 = outputs.split_whitespace().map(|name| bytes(&at.join(name))).sum();
        near("output", &plan["output_bytes"], found);
        if has_temp {
            let report = &events.last().unwrap()["report"];
            near("temporary", &plan["temp_bytes"], report["peak_temp_bytes"].as_u64().unwrap());
        }
    }
}
