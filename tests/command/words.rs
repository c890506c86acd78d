//! Words of options: what is read of them, what is refused, and commands for callers in the same process.

use crate::common::{expect, scratch};
use std::ffi::OsString;
use std::path::Path;
use std::time::SystemTime;
use stonecut::cli::call::{call, config, picture, picture_file};
use stonecut::config::{Config, Target};
use stonecut::system::memory::limit_bytes;
use stonecut::{Error, Progress};

fn words(text: &str) -> Vec<OsString> {
    text.split_whitespace().map(OsString::from).collect()
}

/// The settings of a run from `in.obj` to `out.glb` but for what the options say.
fn settings(options: &str) -> Result<Config, Error> {
    config(&words(&format!("simplify in.obj out.glb {options}")))
}

/// The refusal of some words; none where only the mesh is missing.
fn refusal(words: &[OsString]) -> Option<String> {
    match call(words, &Progress::default()).unwrap_err() {
        Error::Usage(said) => Some(said),
        other => {
            assert_eq!(other.exit_code(), 4, "{words:?}: {other}");
            None
        }
    }
}

#[test]
fn values_are_read_or_refused_with_the_option() {
    for (command, option, good, bad) in [
        ("tiles no.ply out", "--geo", "90,0,0", "91,0,0 1,2"),
        ("tiles no.ply out", "--finest", "10% 0.25 4M", "0 -1 7 200% x"),
        (
            "tiles no.ply out",
            "--transform",
            "1,0,0,0,0,1,0,0,0,0,1,0,5,6,7,1",
            "1,0,0,1,0,1,0,0,0,0,1,0,5,6,7,1",
        ),
        (
            "extract no out.ply --max-error 2 --max-error-inside 1",
            "--inside",
            "-1,0,2,3,0,5",
            "1,2,3 1,0,0,0,1,1 1,2,3,4,5,nan 1,2,3,4,5,6,7",
        ),
        ("render no.ply -o p.png", "--size", "640x480", "640 -1x5"),
        ("render no.ply -o p.png", "--view", "1,-2,0.5 left", "0,0,0 up"),
        ("render no.ply -o p.png", "--zoom", "1,2,-3,0.5", "1,2,3,0 1,2,3,NaN"),
        ("render no.ply -o p.png", "--memory", "50% 2GiB", "half"),
        ("simplify no.ply o.ply", "--triangles", "500,100 900 5_,_4", "4M,4000k 4M, 0,5 1,x"),
        ("simplify no.ply o.ply", "--ratio", "10%,1%", "10%,0.1 7"),
    ] {
        let said = |value: &str| {
            let typed = format!("{option}={}", value.replace('_', " "));
            refusal(&[words(command), vec![typed.into()]].concat())
        };
        for value in good.split(' ') {
            assert_eq!(said(value), None, "{option} {value}");
        }
        for value in bad.split(' ').chain([""]) {
            let said = said(value).unwrap_or_else(|| panic!("{option} '{value}' is taken"));
            assert!(said.contains(option) && !said.contains("Usage:"), "{value}: {said}");
        }
    }
    for (bad, number) in [("10,000", "10000"), ("1,234,567", "1234567"), ("250,000", "250000")] {
        let said = settings(&format!("--triangles {bad}")).unwrap_err().to_string();
        assert!(said.ends_with(&format!(": {number}")), "{said}");
    }
    for (memory, bytes) in [("50%", (0.5 * limit_bytes() as f64) as u64), ("2GiB", 2 << 30)] {
        let found = settings(&format!("--ratio 5% --memory {memory}")).unwrap();
        assert_eq!(found.memory_bytes, bytes, "{memory}");
    }
}

#[test]
fn a_list_of_targets_is_sorted_and_names_the_files() {
    let levels = |output: &str| {
        let words = ["simplify", "in.ply", output, "--triangles", "400k, 40M,4M"];
        let config = config(&words.map(OsString::from))?;
        let first = (config.output.clone(), config.target);
        let coarser = config.coarser.into_iter().map(|level| (level.output, level.target));
        Ok::<_, Error>([first].into_iter().chain(coarser).collect::<Vec<_>>())
    };
    for (output, paths) in [
        ("a/b.c.ply", ["a/b.c-40M.ply", "a/b.c-4M.ply", "a/b.c-400k.ply"]),
        ("{}/b.obj", ["40M/b.obj", "4M/b.obj", "400k/b.obj"]),
    ] {
        let counts = [40_000_000, 4_000_000, 400_000].map(Target::Triangles);
        let wanted: Vec<_> = paths.map(Into::into).into_iter().zip(counts).collect();
        assert_eq!(levels(output).unwrap(), wanted);
    }
    assert!(levels("-").is_err());
}

#[test]
fn pages_are_refused_where_no_new_texture_is_made() {
    // The option that is named first; empty for what goes together.
    let said = |options: &str| match settings(&format!("--ratio 5% {options}")) {
        Ok(_) => String::new(),
        Err(error) => error.to_string(),
    };
    for page in ["--bake-size 512", "--bake-size 4096", "--bake-pages 2"] {
        for other in [
            "--texture keep",
            "--texture none",
            "--drop-texture",
            "--progressive out.pm",
            "--method cluster",
            "--method decimate",
            "--method retile",
        ] {
            let said = said(&format!("{page} {other}"));
            let option = page.split(' ').next().unwrap();
            assert!(said.starts_with(option), "{page} {other}: {said}");
        }
        for other in ["--texture auto", "--texture bake", "--bake-normals"] {
            assert_eq!(said(&format!("{page} {other}")), "");
        }
    }
    assert_eq!(settings("--ratio 5% --bake-size 512").unwrap().bake.page_size, 512);
    // Other methods give the texture up.
    for method in ["cluster", "decimate", "retile"] {
        let refused = said(&format!("--method {method} --texture keep"));
        assert!(refused.starts_with("--texture keep"), "{refused}");
        assert_eq!(said(&format!("--method {method} --texture none")), "");
    }
}

#[test]
fn options_without_effect_are_named() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 1000 -q", 0);
    expect(at, "synth rooms tex.obj --triangles 3k -q", 0);
    let pages = "--bake-size 512 --bake-pages 1";
    for (words, unless, options) in [
        ("tex.obj o.stl", ": STL has no place for a texture", &["--bake-size", "--bake-pages"][..]),
        (
            "in.ply o.glb --textures ktx2",
            ": the input has neither",
            &["--bake-size", "--bake-pages", "--textures ktx2"][..],
        ),
        (
            "tex.obj o.glb",
            " unless the input's charts leave too many triangles; --texture bake makes one",
            &["--bake-size", "--bake-pages"],
        ),
        ("tex.obj o.glb --texture bake", "", &[]),
    ] {
        let said = expect(at, &format!("simplify {words} --ratio 50% {pages} --dry-run"), 0);
        for option in options {
            let line = format!("{option} has no effect: no new texture is made{unless}");
            assert!(said.contains(&line), "{words}: {said}");
        }
        assert_eq!(said.matches("has no effect").count(), options.len(), "{words}: {said}");
    }
}

#[test]
fn settings_come_from_the_same_words_as_on_the_command_line() {
    let found = settings("--ratio 2% --topology keep --fit off").unwrap().settings();
    assert_eq!(found["target"], "ratio=0.02");
    assert_eq!((found["topology"].as_str(), found["fit"].as_str()), ("keep", "off"));
}

#[test]
fn what_a_caller_cannot_run_is_a_usage_error_in_one_line() {
    for (text, what) in [
        ("simplify a.ply b.ply", "required"),
        ("measure a.ply", "is missing"),
        ("x", "unrecognized"),
        ("demo", "command line only"),
        ("status folder", "command line only"),
        ("report a.json -o a.html", "command line only"),
    ] {
        let said = refusal(&words(text)).unwrap();
        assert!(said.contains(what) && !said.contains("Usage:"), "{text}: {said}");
    }
}

#[test]
fn a_mesh_is_made_looked_at_simplified_measured_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (made, small) = (path("a.ply"), path("b.ply"));
    let progress = Progress::default();
    let call = |text: String| call(&words(&text), &progress).unwrap();
    let answer = call(format!("synth statue {made} --triangles 5000"));
    let n = answer.report["output"]["triangles"].as_u64().unwrap();
    assert!(n >= 5000);
    assert_eq!(call(format!("info {made}")).report["triangles"], n);
    let plan = call(format!("simplify {made} {small} --triangles 500 --dry-run")).report;
    assert_eq!((plan["triangles_in"].as_u64(), plan["target"].as_u64()), (Some(n), Some(500)));
    let done = call(format!("simplify {made} {small} --triangles 500"));
    assert!(!done.is_short && done.report["output"]["triangles"].as_u64().unwrap() <= 500);
    let measured = call(format!("measure {made} {small} --samples 2000")).report;
    assert!(measured["rms"].as_f64().unwrap() > 0.0);
    let drawn = words(&format!("render {small} -o {} --size 64x48", path("c.png")));
    let from_file = picture(&drawn, None, &progress).unwrap();
    assert_eq!((from_file.width, from_file.height), (64, 48));
    assert!(!Path::new(&path("c.png")).exists());
    assert_eq!(picture_file(&drawn, None, &progress).unwrap(), from_file);
    assert!(Path::new(&path("c.png")).exists());
}

/// An input that changes between the run and its receipt would have the wrong hash.
#[test]
fn files_that_have_changed_since_the_run_get_no_receipt() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 30k -q", 0);
    let [input, output, receipt] = ["in.ply", "out.ply", "r.json"].map(|name| at.join(name));
    let text = format!(
        "simplify {} {} --ratio 10% --force --receipt {}",
        input.display(),
        output.display(),
        receipt.display()
    );
    call(&words(&text), &Progress::default()).unwrap();
    for changed in [&input, &output] {
        std::fs::remove_file(&receipt).unwrap_or_default();
        let progress = Progress::default();
        let again = words(&format!("{text} --restart"));
        let said = std::thread::scope(|scope| {
            let run = scope.spawn(|| call(&again, &progress));
            // Written and whole: the receipt takes its measure.
            while progress.read().0.name != "measure" && !run.is_finished() {
                std::thread::yield_now();
            }
            let file = std::fs::File::options().write(true).open(changed).unwrap();
            file.set_modified(SystemTime::UNIX_EPOCH).unwrap();
            run.join().unwrap().unwrap_err().to_string()
        });
        let name = changed.file_name().unwrap().to_str().unwrap();
        assert!(said.contains(name) && said.contains("changed during the run"), "{said}");
        assert!(!receipt.exists());
    }
}
