//! Holds the code against docs/ARCHITECTURE.md: what may import what, and where outside crates live.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

use std::path::{Path, PathBuf};

fn sources() -> Vec<(String, String)> {
    fn walk(folder: &Path, out: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap().flatten() {
            let path = entry.path();
            if path.is_dir() {
                walk(&path, out);
            } else if path.extension().is_some_and(|ext| ext == "rs") {
                out.push(path);
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    walk(&root, &mut files);
    files.sort();
    files
        .into_iter()
        .map(|path| {
            let name = path.strip_prefix(&root).unwrap().to_string_lossy().replace('\\', "/");
            // What tests need is no part of the architecture.
            let text = std::fs::read_to_string(&path).unwrap();
            let text = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default().to_owned();
            (name, text)
        })
        .collect()
}

fn imports(text: &str, module: &str) -> bool {
    [":", ";", " ", "\n"].iter().any(|end| text.contains(&format!("crate::{module}{end}")))
}

const STAGES: [&str; 5] = [
    "stages::partition",
    "stages::components",
    "stages::simplify",
    "stages::stitch",
    "stages::write",
];

#[test]
fn only_the_pipeline_and_its_plan_name_two_stages() {
    for (name, text) in sources() {
        if name.starts_with("pipeline/") || name.starts_with("cli/") {
            continue;
        }
        let own = name.split(['/', '.']).take(2).collect::<Vec<_>>().join("::");
        let named: Vec<_> =
            STAGES.iter().filter(|stage| **stage != own && imports(&text, stage)).collect();
        let allowed = usize::from(!STAGES.contains(&own.as_str()));
        assert!(named.len() <= allowed, "src/{name} names the stages {named:?}");
    }
}

#[test]
fn the_kernel_knows_no_files_threads_clock_or_logging() {
    for (name, text) in sources().into_iter().filter(|(name, _)| name.starts_with("kernel/")) {
        for word in
            ["std::fs", "std::io", "std::thread", "std::time", "rayon", "tracing", "println!"]
        {
            assert!(!text.contains(word), "src/{name} mentions {word}");
        }
        for module in ["cli", "config", "io", "store", "system", "error"] {
            assert!(!imports(&text, module), "src/{name} imports {module}");
        }
    }
}

#[test]
fn layers_below_the_stages_do_not_look_up() {
    for (name, text) in sources() {
        let below = ["store/", "io/", "kernel/", "mesh/", "system/"];
        if below.iter().any(|layer| name.starts_with(layer)) {
            for module in ["stages", "pipeline", "measure", "cli"] {
                assert!(!imports(&text, module), "src/{name} imports {module}");
            }
        }
    }
}

#[test]
fn outside_crates_have_one_home() {
    for (krate, homes) in [
        ("indicatif::", &["cli/"][..]),
        ("clap::", &["cli/", "config.rs", "synth/", "render/"][..]),
        ("crossbeam::", &["system/parallel.rs"][..]),
        ("rayon::", &["system/parallel.rs"][..]),
        ("signal_hook::", &["cli/"][..]),
    ] {
        for (name, text) in sources() {
            if text.contains(krate) {
                assert!(homes.iter().any(|home| name.starts_with(home)), "src/{name} uses {krate}");
            }
        }
    }
}

#[test]
fn every_file_says_its_duty_and_none_is_too_long() {
    for (name, text) in sources() {
        assert!(text.starts_with("//!"), "src/{name} does not begin with its duty");
        let n_lines = text.lines().count();
        assert!(n_lines <= 800, "src/{name} has {n_lines} lines; split it by duty");
    }
}

#[test]
fn library_code_does_not_print_or_exit() {
    for (name, text) in sources() {
        if name.starts_with("cli/") || name == "main.rs" {
            continue;
        }
        for word in ["println!", "process::exit"] {
            assert!(!text.contains(word), "src/{name} uses {word}");
        }
    }
}
