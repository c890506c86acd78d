//! What Rust programs call does what the commands do, and the examples run.

#![allow(clippy::unwrap_used, dead_code)] // A test fails by panicking; examples have a `main`.

use crate::common::{expect, report};
use stonecut::{Error, Measure, Simplify, Tiles};

#[path = "../../examples/arrays.rs"]
mod arrays;
#[path = "../../examples/measure.rs"]
mod measure;
#[path = "../../examples/simplify_file.rs"]
mod simplify_file;

#[test]
fn a_builder_writes_what_the_command_writes() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    expect(folder.path(), "synth statue in.ply --triangles 6000", 0);
    expect(folder.path(), "simplify in.ply typed.ply --ratio 10% --report r.json", 0);
    let mut shares = Vec::new();
    let built = Simplify::new(path("in.ply"), path("built.ply"))
        .ratio(0.1)
        .memory(1 << 30)
        .threads(2.try_into().unwrap())
        .on_progress(|moment| shares.push(moment.fraction))
        .run()
        .unwrap();
    let written = |name: &str| std::fs::read(path(name)).unwrap();
    assert!(written("typed.ply") == written("built.ply") && !built.is_short());
    assert_eq!(report(folder.path())["output"]["triangles"], built.output.triangles);
    assert!(shares.is_sorted() && shares.iter().all(|share| (0.0..=1.0).contains(share)));

    let bounded = Simplify::new(path("in.ply"), path("bounded.ply")).max_error(0.05).run().unwrap();
    assert!(bounded.hausdorff.unwrap().upper <= 0.05);
    let apart = Measure::new(path("in.ply"), path("built.ply")).samples(5000).run().unwrap();
    assert!(apart.deviation.rms > 0.0 && apart.simplified.triangles == built.output.triangles);
    let tiles = Tiles::new(path("in.ply"), path("tiles")).finest_ratio(0.5).run().unwrap();
    assert!(tiles.tiles > 0 && path("tiles/tileset.json").exists());
}

#[test]
fn errors_of_builders_have_codes_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    expect(folder.path(), "synth statue in.ply --triangles 2000", 0);
    let code = |run: Simplify| run.run().map_err(|error| (error.exit_code(), error.code()));
    let run = |input: &str, output: &str| Simplify::new(path(input), path(output)).ratio(0.5);
    assert_eq!(code(run("missing.ply", "out.ply")).unwrap_err(), (4, "bad_input"));
    assert_eq!(code(run("in.ply", "in.ply")).unwrap_err(), (2, "usage"));
    assert_eq!(code(Simplify::new(path("in.ply"), path("o.ply"))).unwrap_err(), (2, "usage"));
    assert_eq!(code(run("in.ply", "out.ply").memory(1 << 20)).unwrap_err(), (6, "no_memory"));
    assert!(!path("out.ply").exists());
    // The larger, so that it is still at work at the first look.
    expect(folder.path(), "synth statue large.ply --triangles 300k", 0);
    let stopped = run("large.ply", "out.ply").threads(1.try_into().unwrap());
    let error = stopped.on_progress(|moment| moment.stop()).run().unwrap_err();
    assert!(matches!(error, Error::Interrupted { .. }) && error.remedy().unwrap().contains("same"));
    assert!(run("large.ply", "out.ply").run().is_ok());
}

#[test]
fn the_examples_run() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    expect(folder.path(), "synth statue in.ply --triangles 6000", 0);
    assert_eq!(simplify_file::simplify(&path("in.ply"), &path("out.ply"), "10%"), 0);
    assert_eq!(simplify_file::simplify(&path("no.ply"), &path("out.ply"), "10%"), 4);
    measure::measure(&path("in.ply"), &path("out.ply")).unwrap();
    arrays::main().unwrap();
}
