//! A scan in many files.

use super::{FORMAT, Topology, settings, topology};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use stonecut::Mesh;
use stonecut::io::ply::MeshSource;
use stonecut::io::{OutputFormat, OutputKind, StageOptions};
use stonecut::measure::load::load;
use stonecut::synth::{Cut, Kind, Rounding, Settings, TileCounts, Writing, mesh, write_tiles};
use stonecut::system::progress::Progress;

const PLAIN_CUT: Cut = Cut { n_tiles: 12, rounding: None, t_junctions: false, overlap: 0.0 };

/// Cuts a mesh into tiles of a kind; gives all files in order of their names.
fn tiles(
    folder: &Path,
    settings: &Settings,
    cut: Cut,
    (kind, threads): (OutputKind, usize),
) -> (TileCounts, Vec<PathBuf>) {
    let format = OutputFormat { kind: Some(kind), ..FORMAT };
    let writing = Writing { threads, force: false, format };
    let counts = write_tiles(folder, settings, &cut, writing, &Progress::default()).unwrap();
    let mut files: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    (counts, files)
}

/// All files as one mesh, copies of vertices at the same place joined.
fn joined(files: &[PathBuf]) -> Mesh {
    let mut all = Mesh::default();
    let mut ids: HashMap<[u64; 3], u32> = HashMap::new();
    for file in files {
        let options = StageOptions::new(file.parent().unwrap());
        let source = MeshSource::open_staged(file, &options).unwrap();
        let tile = load(&source, 1, &Progress::default()).unwrap().mesh;
        for t in 0..tile.triangles.len() {
            all.triangles.push(tile.corners(t).map(|p| {
                *ids.entry(p.map(f64::to_bits)).or_insert_with(|| {
                    all.positions.push(p);
                    all.positions.len() as u32 - 1
                })
            }));
        }
    }
    all
}

#[test]
fn tiles_are_the_scan_in_many_files() {
    let folder = tempfile::tempdir().unwrap();
    let settings = settings(Kind::Statue, 20_000);
    let whole = mesh(&settings).unwrap();
    let closed = Topology { euler: 2, components: 1, ..Topology::default() };
    let mut bytes = Vec::new();
    for threads in [1, 3] {
        let to = folder.path().join(format!("tiles{threads}"));
        let (counts, files) = tiles(&to, &settings, PLAIN_CUT, (OutputKind::Ply, threads));
        assert_eq!((counts.n_tiles, files.len()), (12, 12));
        assert_eq!(counts.n_triangles, whole.triangles.len() as u64);
        bytes.push(files.iter().map(|file| std::fs::read(file).unwrap()).collect::<Vec<_>>());
        let joined = joined(&files);
        assert_eq!(topology(&joined), closed);
        assert_eq!(joined.positions.len(), whole.positions.len());
        let sizes: Vec<u64> =
            files.iter().map(|file| MeshSource::open(file).unwrap().n_triangles()).collect();
        assert!(sizes.iter().all(|n| (1200..2200).contains(n)), "{sizes:?}");
        let again = Writing { threads, force: true, format: FORMAT };
        let error = write_tiles(&to, &settings, &PLAIN_CUT, again, &Progress::default());
        assert!(error.unwrap_err().to_string().contains("already"), "what is there stays");
    }
    assert!(bytes[0] == bytes[1], "threads change no byte");
}

#[test]
fn tiles_round_and_split_and_overlap_as_programs_do() {
    let folder = tempfile::tempdir().unwrap();
    let settings = settings(Kind::Statue, 6_000);
    let n_whole = mesh(&settings).unwrap().triangles.len() as u64;
    let to = |name: &str| folder.path().join(name);
    // Copies of a border vertex differ by at most a step, and are apart.
    let rounded = Cut { rounding: Some(Rounding::Digits(4)), ..PLAIN_CUT };
    let (_, files) = tiles(&to("digits"), &settings, rounded, (OutputKind::Obj, 2));
    let apart = topology(&joined(&files));
    assert_eq!(apart.components, 12);
    assert!(apart.boundary_edges > 500, "{apart:?}");
    let text = std::fs::read_to_string(&files[3]).unwrap();
    let vertices: Vec<&str> = text.lines().filter(|line| line.starts_with("v ")).collect();
    let digits = |word: &str| word.split_once('.').map_or(0, |(_, digits)| digits.len());
    assert!(vertices.iter().all(|line| line.split(' ').skip(1).all(|word| digits(word) <= 6)));
    // A vertex more on one side of the border: every one of them opens three edges.
    let split = Cut { t_junctions: true, ..PLAIN_CUT };
    let (counts, files) = tiles(&to("split"), &settings, split, (OutputKind::Ply, 2));
    assert!(counts.n_split > 50, "{counts:?}");
    assert_eq!(counts.n_triangles, n_whole + counts.n_split);
    let open = topology(&joined(&files));
    assert_eq!(open.boundary_edges as u64, 3 * counts.n_split);
    // Faces near a border belong to both.
    let overlap = Cut { overlap: 0.05, ..PLAIN_CUT };
    let (counts, _) = tiles(&to("overlap"), &settings, overlap, (OutputKind::Glb, 2));
    let more = counts.n_triangles as f64 / n_whole as f64;
    assert!((1.05..1.8).contains(&more), "{more}");
    let both = Cut { t_junctions: true, ..overlap };
    let writing = Writing { threads: 1, force: false, format: FORMAT };
    assert!(write_tiles(&to("both"), &settings, &both, writing, &Progress::default()).is_err());
}

#[test]
fn tiles_of_rooms_name_the_images_that_they_use() {
    let folder = tempfile::tempdir().unwrap();
    let settings = Settings { pages: Some(3), ..settings(Kind::Rooms, 6_000) };
    let to = folder.path().join("rooms");
    let cut = Cut { n_tiles: 5, ..PLAIN_CUT };
    let (counts, files) = tiles(&to, &settings, cut, (OutputKind::Obj, 2));
    assert_eq!((counts.n_tiles, counts.n_images), (5, 3));
    assert_eq!(files.len(), 5 + 5 + 3, "{files:?}");
    for file in files.iter().filter(|file| file.extension().is_some_and(|e| e == "obj")) {
        let text = std::fs::read_to_string(file).unwrap();
        let library = std::fs::read_to_string(file.with_extension("mtl")).unwrap();
        let used = text.lines().filter_map(|line| line.strip_prefix("usemtl "));
        assert!(used.clone().count() > 0);
        for name in used {
            assert!(library.contains(&format!("newmtl {name}")), "{name}: {library}");
        }
        let images: Vec<&str> =
            library.lines().filter_map(|line| line.strip_prefix("map_Kd ")).collect();
        assert!(!images.is_empty() && images.iter().all(|name| to.join(name).is_file()));
    }
}
