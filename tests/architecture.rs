//! Holds the code against docs/ARCHITECTURE.md: circles of files, homes of crates, lengths of files.

#![allow(clippy::unwrap_used, clippy::panic)] // A test fails by panicking.

#[path = "architecture/imports.rs"]
mod imports;
#[path = "architecture/names.rs"]
mod names;
#[path = "architecture/prose.rs"]
mod prose;

use imports::{Imports, imports};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The rooms that are crates. Cargo.toml of each lists the others that it may use, and Cargo allows no circles.
const CRATES: [&str; 12] = [
    "mesh",
    "system",
    "kernel",
    "io",
    "progressive",
    "render",
    "store",
    "stages",
    "measure",
    "methods",
    "bake",
    "synth",
];

/// Homes of outside crates; those that are not listed may be used anywhere.
const HOMES: [(&str, &[&str]); 36] = [
    ("base64", &["io/gltf/buffers.rs", "report/"]),
    ("basis_universal", &["render/texture/ktx2_image.rs", "render/texture/ktx2_out.rs"]),
    ("bevy_mikktspace", &["render/texture/frames.rs"]),
    ("clap", &["cli/", "store/config.rs"]),
    ("clap_complete", &["cli/pages.rs"]),
    ("clap_mangen", &["cli/pages.rs"]),
    ("colorous", &["mesh/viridis.rs"]),
    ("crossbeam", &["system/parallel.rs"]),
    ("crs_definitions", &["io/globe.rs"]),
    ("draco_core", &["io/gltf/draco.rs"]),
    ("earcut", &["io/polygon.rs"]),
    ("encoding_rs", &["io/encodings.rs"]),
    ("flate2", &["io/open.rs"]),
    ("image", &["render/texture/images.rs", "render/texture/ktx2_image.rs"]),
    ("imagesize", &["io/materials/images.rs"]),
    ("indicatif", &["cli/display.rs"]),
    ("jpeg_decoder", &["render/texture/jpeg.rs"]),
    ("jpeg_encoder", &["bake/pages.rs"]),
    ("ktx2", &["render/texture/ktx2_image.rs"]),
    ("memchr", &["io/text_lines.rs"]),
    ("memmap2", &["system/mapped_file.rs"]),
    ("meshopt_rs", &["io/gltf/meshopt.rs", "io/gltf/meshopt_out.rs"]),
    ("minisign", &["receipt/signature.rs"]),
    ("noto_sans_mono_bitmap", &["render/picture.rs"]),
    ("png", &["bake/pages.rs", "render/picture.rs"]),
    ("proj4rs", &["io/globe.rs"]),
    ("rayon", &["system/parallel.rs"]),
    ("robust", &["measure/certify/sheet.rs", "mesh/meeting.rs"]),
    ("rustix", &["cli/mod.rs", "pipeline/plan/", "store/job/lock.rs", "system/"]),
    ("sha2", &["receipt/hashes.rs"]),
    ("signal_hook", &["cli/"]),
    ("thiserror", &["system/error.rs"]),
    ("unicode_normalization", &["io/materials/search.rs"]),
    ("zip", &["io/containers.rs"]),
    (
        "zstd",
        &[
            "io/open.rs",
            "progressive/columns.rs",
            "render/texture/ktx2_image.rs",
            "render/texture/ktx2_out.rs",
        ],
    ),
    ("zune_jpeg", &["render/texture/jpeg.rs"]),
];

/// The rooms and files of the kernel from top to bottom; each imports only those below it.
const KERNEL_ROOMS: [&str; 25] = [
    "tests",
    "mod",
    "stepwise",
    "run",
    "memory",
    "schedule",
    "repair",
    "topology",
    "collapse",
    "bound",
    "fit",
    "crossing",
    "statistics",
    "quality_curve",
    "quality",
    "history",
    "followed",
    "state",
    "cost",
    "surface",
    "simd",
    "vertex",
    "options",
    "earlier",
    "interrupt",
];

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
    let name = |path: &Path| path.strip_prefix(&root).unwrap().to_string_lossy().into_owned();
    files.iter().map(|path| (name(path), std::fs::read_to_string(path).unwrap())).collect()
}

/// Without the tests of a file.
fn without_tests(text: &str) -> &str {
    text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default()
}

/// The room of a file; none of `lib.rs` and `main.rs`.
fn room(file: &str) -> Option<&str> {
    let room = file.split(['/', '.']).next().unwrap_or_default();
    (room != "lib" && room != "main").then_some(room)
}

/// The sources as if all crates were one: `stonecut_io::ply` is `crate::io::ply`, and a crate's root a module.
fn as_one_crate() -> Vec<(String, String)> {
    let one = |(name, text): (String, String)| {
        let folder = name.split('/').next().unwrap_or_default().to_owned();
        if !CRATES.contains(&folder.as_str()) {
            return (name, with_crates_as_modules(&text));
        }
        let text = text.replace("crate::", &format!("crate::{folder}::"));
        let root = format!("{folder}/lib.rs");
        (
            if name == root { format!("{folder}/mod.rs") } else { name },
            with_crates_as_modules(&text),
        )
    };
    sources().into_iter().map(one).collect()
}

fn with_crates_as_modules(text: &str) -> String {
    CRATES.iter().fold(text.to_owned(), |text, krate| {
        text.replace(&format!("stonecut_{krate}"), &format!("crate::{krate}"))
    })
}

#[test]
fn the_program_does_not_know_what_is_above_it() {
    for (file, used) in &imports(&as_one_crate()).files {
        let above: &[&str] = match room(file) {
            Some("pipeline") => &["cli", "report"],
            Some("report") => &["cli", "pipeline"],
            _ => continue,
        };
        let wrong = used.iter().find(|other| room(other).is_some_and(|r| above.contains(&r)));
        assert_eq!(wrong, None, "src/{file}");
    }
}

#[test]
fn the_kernel_depends_on_the_mesh_alone() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let manifest = std::fs::read_to_string(root.join("src/kernel/Cargo.toml")).unwrap();
    let own = manifest.lines().filter(|line| line.starts_with("stonecut-"));
    assert_eq!(own.collect::<Vec<_>>(), ["stonecut-mesh.workspace = true"]);
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let found = circles(&imports(&as_one_crate()));
    assert_eq!(found, Vec::<Vec<String>>::new(), "circles of files");
}

#[test]
fn rooms_of_the_kernel_import_only_what_stands_below_them() {
    let place = |file: &str| {
        let room = file.strip_prefix("kernel/")?.split(['/', '.']).next()?;
        let place = KERNEL_ROOMS.iter().position(|known| *known == room);
        Some(place.unwrap_or_else(|| panic!("src/{file}: the kernel has no room '{room}'")))
    };
    let mut n = 0;
    for (file, used) in &imports(&as_one_crate()).files {
        for other in used {
            if let (Some(own), Some(theirs)) = (place(file), place(other)) {
                assert!(own <= theirs, "src/{file} imports src/{other}, which stands above it");
                n += 1;
            }
        }
    }
    assert!(n > 100, "{n} imports in the kernel");
}

/// Sets of files that can all be reached from each other.
fn circles(imports: &Imports) -> Vec<Vec<String>> {
    let reached = |from: &String| {
        let mut seen = BTreeSet::new();
        let mut open = vec![from];
        while let Some(file) = open.pop() {
            for next in imports.files.get(file).into_iter().flatten() {
                if seen.insert(next) {
                    open.push(next);
                }
            }
        }
        seen
    };
    let reach: BTreeMap<&String, BTreeSet<&String>> =
        imports.files.keys().map(|file| (file, reached(file))).collect();
    let mut out: BTreeSet<Vec<String>> = BTreeSet::new();
    for (file, seen) in reach.iter().filter(|(file, seen)| seen.contains(**file)) {
        let back = seen.iter().filter(|other| reach[**other].contains(*file));
        out.insert(back.map(|other| (**other).clone()).collect());
    }
    out.into_iter().collect()
}

#[test]
fn stages_do_not_know_each_other_and_only_the_top_names_two() {
    let stage = |file: &str| {
        file.strip_prefix("stages/")
            .and_then(|rest| rest.split(['/', '.']).next().map(str::to_owned))
    };
    for (file, used) in &imports(&as_one_crate()).files {
        if file.starts_with("pipeline/") || file.starts_with("cli/") || file == "stages/mod.rs" {
            continue;
        }
        let own = stage(file);
        let named: BTreeSet<String> = used
            .iter()
            .filter_map(|other| stage(other))
            .filter(|s| Some(s) != own.as_ref())
            .collect();
        let allowed = usize::from(own.is_none());
        assert!(named.len() <= allowed, "src/{file} names the stages {named:?}");
    }
}

#[test]
fn the_kernel_knows_no_files_threads_clock_or_logging() {
    for (name, text) in sources().iter().filter(|(name, _)| name.starts_with("kernel/")) {
        for word in
            ["std::fs", "std::io", "std::thread", "std::time", "rayon", "tracing", "println!"]
        {
            assert!(!without_tests(text).contains(word), "src/{name} mentions {word}");
        }
    }
}

#[test]
fn outside_crates_have_one_home() {
    for (file, used) in &imports(&as_one_crate()).crates {
        for (krate, homes) in HOMES {
            if used.contains(krate) {
                assert!(homes.iter().any(|home| file.starts_with(home)), "src/{file} uses {krate}");
            }
        }
    }
}

#[test]
fn every_file_says_its_duty_and_none_is_too_long() {
    let sources = sources();
    for (name, text) in &sources {
        assert!(text.starts_with("//!"), "src/{name} does not begin with its duty");
        let n_lines = without_tests(text).lines().count();
        assert!(n_lines <= 500, "src/{name} has {n_lines} lines besides tests; split it by duty");
        let all = text.lines().count();
        assert!(all <= 800, "src/{name} has {all} lines; split it by duty");
    }
}

/// A crate's own tests compile it a second time, and the top one is the largest piece of a build: Cargo.toml turns them off there.
#[test]
fn the_top_crate_has_no_tests_within_it() {
    for (name, text) in sources() {
        let is_lower = name.split_once('/').is_some_and(|(folder, _)| CRATES.contains(&folder));
        assert!(is_lower || !text.contains("#[test]"), "src/{name} has tests, which never run");
    }
}

#[test]
fn library_code_does_not_print_or_exit() {
    for (name, text) in sources() {
        if name.starts_with("cli/") || name == "main.rs" || name.ends_with("/tests.rs") {
            continue;
        }
        for word in ["println!", "process::exit"] {
            assert!(!without_tests(&text).contains(word), "src/{name} uses {word}");
        }
    }
}

#[test]
fn the_map_names_every_room_and_nothing_that_is_not_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let document = std::fs::read_to_string(root.join("docs/ARCHITECTURE.md")).unwrap();
    let map = document.split("## The map").nth(1).unwrap().split("\n## ").next().unwrap();
    // The first column of the table: `places` in code.
    let places: Vec<&str> = map
        .lines()
        .filter_map(|line| line.strip_prefix("| `")?.split(" | ").next())
        .flat_map(|column| column.split('`').step_by(2))
        .collect();
    assert!(places.len() > CRATES.len(), "{places:?}");
    for place in &places {
        assert!(root.join("src").join(place).exists(), "the map names {place}, which is not there");
    }
    for (name, _) in sources() {
        if let Some((room, _)) = name.split_once('/') {
            assert!(places.contains(&format!("{room}/").as_str()), "src/{room} is not in the map");
        }
    }
}

/// Finds what `a.rs` uses, of the crate given as files.
fn used_by_a(files: &[(&str, &str)]) -> Imports {
    let own = |(name, text): &(&str, &str)| ((*name).to_owned(), (*text).to_owned());
    imports(&files.iter().map(own).collect::<Vec<_>>())
}

#[test]
fn imports_are_found_however_they_are_written() {
    let others = [
        ("lib.rs", "mod a; mod b; mod c;"),
        ("b/mod.rs", "mod d; pub use d::{Deep, Deeper as Other}; pub fn f() {}"),
        ("b/d.rs", "pub struct Deep; pub struct Deeper;"),
        ("c.rs", "pub struct C;"),
    ];
    for (text, wanted) in [
        ("use crate::{b::Deep, c};", &["b/d.rs", "c.rs"][..]),
        ("use crate::b::Other;", &["b/d.rs"]),
        ("use super::b; fn g() { b::f() }", &["b/mod.rs"]),
        ("use super::b; fn g(_: b::Deep) {}", &["b/mod.rs", "b/d.rs"]),
        ("fn g() { assert!(crate::c::C == 1) }", &["c.rs"]),
        ("mod inner { fn g(_: super::super::c::C) {} }", &["c.rs"]),
        ("pub use crate::c::C;", &[]),
        ("pub use crate::c::C; fn g(_: C) {}", &["c.rs"]),
        ("#[cfg(test)] mod tests { use crate::c::C; }", &[]),
        ("pub(in crate::b) fn g() {} // crate::c::C", &[]),
    ] {
        let found = used_by_a(&[&others[..], &[("a.rs", text)]].concat());
        let wanted: BTreeSet<String> = wanted.iter().map(|&file| file.to_owned()).collect();
        assert_eq!(found.files["a.rs"], wanted, "{text}");
    }
}

#[test]
fn a_circle_is_found() {
    let found = used_by_a(&[
        ("lib.rs", "mod a; mod b; mod c;"),
        ("a.rs", "use crate::b::B; pub struct A;"),
        ("b.rs", "fn f(_: super::a::A) {} pub struct B;"),
        ("c.rs", "use crate::a::A;"),
    ]);
    assert_eq!(circles(&found), [["a.rs", "b.rs"]]);
}

#[test]
fn files_that_the_algorithm_names_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for page in ["docs/algorithm.md", "docs/references.md"] {
        let text = std::fs::read_to_string(root.join(page)).expect("the page");
        let named = text.split('`').skip(1).step_by(2);
        let is_path = |name: &&str| {
            let is_word = |b: u8| b.is_ascii_lowercase() || b == b'_' || b == b'/' || b == b'.';
            name.contains('/') && name.bytes().all(is_word)
        };
        let mut n = 0;
        for name in named.filter(is_path).map(|name| name.strip_prefix("src/").unwrap_or(name)) {
            let at = root.join("src").join(name);
            let file = at.with_extension("rs");
            assert!(at.exists() || file.exists(), "{page} names {name}, which is not in src/");
            n += 1;
        }
        assert!(n > 15, "{page} names {n} files");
    }
}

#[test]
fn prose_keeps_the_rules_that_can_be_counted() {
    let mut faults: Vec<String> =
        sources().iter().flat_map(|(name, text)| prose::faults_of_source(name, text)).collect();
    let pages = prose::pages(Path::new(env!("CARGO_MANIFEST_DIR")));
    assert!(pages.len() > 15, "{pages:?}");
    faults.extend(pages.iter().flat_map(|page| prose::faults_of_page(page)));
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults.join("\n"));
}

/// Names that the crate shows at its top: what is neither hidden nor private.
#[test]
fn the_crate_shows_few_names_at_its_top() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let file = syn::parse_file(&std::fs::read_to_string(root.join("src/lib.rs")).unwrap()).unwrap();
    fn leaves(tree: &syn::UseTree) -> usize {
        match tree {
            syn::UseTree::Path(path) => leaves(&path.tree),
            syn::UseTree::Group(group) => group.items.iter().map(leaves).sum(),
            syn::UseTree::Glob(_) => usize::MAX / 2,
            _ => 1,
        }
    }
    let is_hidden = |attributes: &[syn::Attribute]| {
        attributes.iter().any(|a| a.path().is_ident("doc") && matches!(a.meta, syn::Meta::List(_)))
    };
    let is_shown = |visibility: &syn::Visibility, attributes: &[syn::Attribute]| {
        matches!(visibility, syn::Visibility::Public(_)) && !is_hidden(attributes)
    };
    let shown = |item: &syn::Item| match item {
        syn::Item::Use(item) if is_shown(&item.vis, &item.attrs) => leaves(&item.tree),
        syn::Item::Mod(item) => usize::from(is_shown(&item.vis, &item.attrs)),
        _ => 0,
    };
    let n: usize = file.items.iter().map(shown).sum();
    assert!((20..=40).contains(&n), "{n} names at the top of the crate");
}
