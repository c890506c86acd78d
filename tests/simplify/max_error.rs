//! `--max-error`: the distance between input and result, both ways, stays within the bound.

use crate::common::{count, expect, json, meshes, run, scratch, write_ply};
use std::path::Path;
use stonecut::Mesh;
use stonecut::kernel::{Bound, EarlierRun, Options, Stop, Tight, simplify_mesh};
use stonecut::measure;
use stonecut::mesh::property::Scalar;
use stonecut::synth::{self, Kind, Settings};
use stonecut::system::progress::Progress;

/// The larger one of the two distances that `measure` finds.
fn measured(at: &Path, input: &str, output: &str) -> f64 {
    expect(at, &format!("measure {input} {output} --report m.json"), 0);
    let report = json(at, "m.json");
    let max = |side: &str| report[side]["max"].as_f64().unwrap();
    max("forward").max(max("backward"))
}

#[test]
fn the_result_stays_within_the_bound_and_goes_far() {
    let at = &scratch();
    for kind in ["statue", "terrain", "volume"] {
        expect(at, &format!("synth {kind} in.ply --triangles 4k --force"), 0);
        let diagonal = diagonal(at, "in.ply");
        let mut before = i64::MAX;
        for share in [1e-4, 1e-3, 1e-2] {
            let bound = share * diagonal;
            let in_cells = (share == 1e-3).then_some("--cell-triangles 1000");
            for cells in std::iter::once("").chain(in_cells) {
                let command = format!("simplify in.ply out.ply --max-error {bound} {cells}");
                expect(at, &format!("{command} --force --report r.json"), 0);
                let max = measured(at, "in.ply", "out.ply");
                assert!(max <= bound, "{kind} {bound} {cells}: {max}");
                let report = json(at, "r.json");
                let upper = report["hausdorff"]["upper"].as_f64().unwrap();
                assert!(upper <= bound && max <= upper, "{kind} {bound} {cells}: {upper} proven");
                let tracked = report["max_error"]["tracked_max"].as_f64().unwrap();
                assert!(tracked <= bound, "{kind} {bound} {cells}: {tracked}");
                let n = count(&report["output"], "triangles");
                if cells.is_empty() {
                    assert!(n < before, "{kind} {bound}: {n}");
                    before = n;
                }
            }
        }
        // The specks of a volume stay: four triangles each.
        assert!(before < 2_400, "{kind}: {before}");
    }
}

#[test]
fn holes_wider_than_the_bound_stay_open_and_cost_little() {
    const SIDE: u32 = 80;
    let at = &scratch();
    let holes = [(20.0, 20.0, 3.0), (60.0, 25.0, 2.5), (40.0, 60.0, 4.0), (10.0, 70.0, 2.5)];
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for (y, x) in (0..=SIDE).flat_map(|y| (0..=SIDE).map(move |x| (y, x))) {
        let (u, v) = (f64::from(x), f64::from(y));
        positions.push([u, v, 0.3 * (0.7 * u).sin() * (0.9 * v).cos()]);
        let is_in = |&(a, b, r): &(f64, f64, f64)| (u + 0.5 - a).hypot(v + 0.5 - b) < r;
        if x < SIDE && y < SIDE && !holes.iter().any(is_in) {
            let first = y * (SIDE + 1) + x;
            let above = first + SIDE + 1;
            triangles.extend([[first, first + 1, above + 1], [first, above + 1, above]]);
        }
    }
    write_ply(&at.join("in.ply"), Scalar::F32, &positions, &triangles);
    for bound in [0.5, 1.0, 1.5] {
        let command = format!("simplify in.ply o.ply --max-error {bound} --force --report r.json");
        expect(at, &command, 0);
        let report = json(at, "r.json");
        // Triangles that were turned over spanned a hole, and each further run left thousands.
        let n = count(&report["output"], "triangles");
        assert!(n < 100, "{bound}: {n}");
        assert_eq!(report["max_error"]["trials"].as_array().unwrap().len(), 1, "{bound}");
    }
}

#[test]
fn what_others_stand_in_for_vanishes_and_what_is_far_stays() {
    const SIDE: u32 = 40;
    let at = &scratch();
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (y, x) in (0..=SIDE).flat_map(|y| (0..=SIDE).map(move |x| (y, x))) {
        let (u, v) = (f64::from(x), f64::from(y));
        positions.push([u, v, 0.05 * (0.7 * u).sin() * (0.9 * v).cos()]);
        if x < SIDE && y < SIDE {
            let first = y * (SIDE + 1) + x;
            let above = first + SIDE + 1;
            triangles.extend([[first, first + 1, above + 1], [first, above + 1, above]]);
        }
    }
    // Tetrahedra over the plane: twelve within the bound, three beyond it.
    for (i, height) in (0u32..).zip([0.5; 12].into_iter().chain([4.0; 3])) {
        let first = positions.len() as u32;
        let (u, v) = (5.0 + f64::from(i % 4) * 8.0, 5.0 + f64::from(i / 4) * 8.0);
        for [a, b, c] in [[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.2, 0.0], [0.1, 0.1, 0.2]] {
            positions.push([u + a, v + b, height + c]);
        }
        triangles
            .extend([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]].map(|t| t.map(|k| first + k)));
    }
    write_ply(&at.join("in.ply"), Scalar::F32, &positions, &triangles);
    for (options, n_gone) in [("", 12), ("--topology keep", 0)] {
        let command =
            format!("simplify in.ply o.ply --max-error 1 {options} --force --report r.json");
        let code = run(at, &command).status.code().unwrap();
        assert!(code == 0 || code == 3, "{options}: {code}");
        let report = json(at, "r.json");
        assert_eq!(count(&report["changes"], "small_components_removed"), n_gone, "{options}");
        assert!(report["hausdorff"]["upper"].as_f64().unwrap() <= 1.0, "{options}");
        // The plane has two triangles at least, each tetrahedron four.
        assert!(count(&report["output"], "triangles") >= 2 + 4 * (15 - n_gone), "{options}");
    }
}

#[test]
fn thin_handles_are_cut_within_the_bound() {
    const AROUND: u32 = 240;
    const ACROSS: u32 = 12;
    let at = &scratch();
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (i, j) in (0..AROUND).flat_map(|i| (0..ACROSS).map(move |j| (i, j))) {
        let turn = |k: u32, n: u32| std::f64::consts::TAU * f64::from(k) / f64::from(n);
        let (long, short) = (turn(i, AROUND), turn(j, ACROSS));
        let radius = 10.0 + 0.3 * short.cos();
        positions.push([radius * long.cos(), radius * long.sin(), 0.3 * short.sin()]);
        let id = |i: u32, j: u32| (i % AROUND) * ACROSS + j % ACROSS;
        let [a, b] = [id(i, j), id(i + 1, j)];
        let [c, d] = [id(i + 1, j + 1), id(i, j + 1)];
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    write_ply(&at.join("in.ply"), Scalar::F32, &positions, &triangles);
    for (bound, may_cut) in [(2.0, true), (0.05, false)] {
        let command = format!("simplify in.ply o.ply --max-error {bound} --force --report r.json");
        // 3: the ring is thinner than the bound, so what is left of it is hardly a ring.
        let code = run(at, &command).status.code().unwrap();
        assert!(code == 0 || code == 3, "{bound}: {code}");
        let report = json(at, "r.json");
        assert_eq!(count(&report["changes"], "handles_cut") > 0, may_cut, "{bound}");
        assert!(report["hausdorff"]["upper"].as_f64().unwrap() <= bound, "{bound}");
    }
}

/// Diagonal of the input's box, from the report of a run.
fn diagonal(at: &Path, input: &str) -> f64 {
    expect(at, &format!("simplify {input} b.ply --ratio 50% --force --report b.json"), 0);
    let bounds = json(at, "b.json")["input"]["bounds"].clone();
    let end = |end: usize, axis: usize| bounds[end][axis].as_f64().unwrap();
    (0..3).map(|axis| (end(1, axis) - end(0, axis)).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn bytes_depend_on_neither_threads_nor_memory() {
    let at = &scratch();
    expect(at, "synth scans in.ply --triangles 60k --color", 0);
    let bytes = |options: &str| {
        let command = "simplify in.ply out.ply --max-error 0.004 --cell-triangles 3k --error-field";
        expect(at, &format!("{command} --force {options}"), 0);
        std::fs::read(at.join("out.ply")).unwrap()
    };
    let first = bytes("--threads 1");
    assert!(first == bytes("--threads 3 --memory 100MiB"), "threads and memory show");
    assert!(first != bytes("--threads 3 --topology keep --placement midpoint"), "options do not");
}

#[test]
fn whichever_comes_first_ends_it() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 30k", 0);
    let bound = 0.003 * diagonal(at, "in.ply");
    let triangles = |options: &str, code: i32| {
        expect(at, &format!("simplify in.ply o.ply {options} --force --report r.json"), code);
        count(&json(at, "r.json")["output"], "triangles")
    };
    let by_bound = triangles(&format!("--max-error {bound}"), 0);
    let by_count = by_bound + 2000;
    let both = triangles(&format!("--max-error {bound} --triangles {by_count}"), 0);
    assert!((by_count - 1..=by_count).contains(&both), "{both} for {by_count}");
    assert_eq!(triangles(&format!("--max-error {bound} --triangles 100"), 3), by_bound);
    assert_eq!(json(at, "r.json")["stop_reason"], "within the bound");
}

#[test]
fn a_bound_of_nothing_changes_nothing_and_a_huge_one_leaves_hardly_anything() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 8k", 0);
    for bound in ["0", "1e-30"] {
        expect(
            at,
            &format!("simplify in.ply o.ply --max-error {bound} --force --report r.json"),
            0,
        );
        let report = json(at, "r.json");
        assert_eq!(count(&report["output"], "triangles"), count(&report["input"], "triangles"));
        assert_eq!(report["hausdorff"]["upper"], 0.0, "{bound}");
    }
    // A vertex that no f32 stands for, written as one: the certificate sees the rounding.
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
                element face 4\nproperty list uchar int vertex_indices\nend_header\n\
                0.1 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 3 1\n3 0 2 3\n3 1 3 2\n";
    std::fs::write(at.join("f64.ply"), text).unwrap();
    let said = expect(at, "simplify f64.ply p.obj --max-error 0", 3);
    assert!(said.contains("no result keeps the bound") && !at.join("p.obj").exists(), "{said}");
    let output = run(at, "simplify in.ply o.ply --max-error 1000 --force --report r.json");
    // So few triangles stand for no statue, which exit code 3 says.
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    let n = count(&json(at, "r.json")["output"], "triangles");
    assert!((4..=400).contains(&n), "{n}");
    for wrong in ["NaN", "-1", "inf", "1mm"] {
        let output = run(at, &format!("simplify in.ply p.ply --max-error={wrong}"));
        assert_eq!(output.status.code(), Some(2), "{wrong}: {output:?}");
    }
}

#[test]
fn the_field_has_a_distance_for_every_vertex() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 20k", 0);
    expect(at, "simplify in.ply o.ply --max-error 0.5 --error-field --format ascii", 0);
    let text = std::fs::read_to_string(at.join("o.ply")).unwrap();
    let (header, body) = text.split_once("end_header\n").unwrap();
    assert!(header.contains("property float error\n"), "{header}");
    let n: usize =
        header.lines().find_map(|l| l.strip_prefix("element vertex ")).unwrap().parse().unwrap();
    let errors: Vec<f64> = body
        .lines()
        .take(n)
        .map(|row| row.split_whitespace().next_back().unwrap().parse().unwrap())
        .collect();
    assert!(errors.iter().all(|error| (0.0..=0.5).contains(error)), "within the bound");
    assert!(errors.iter().any(|error| *error > 0.25), "and not far below it everywhere");
    let output = run(at, "simplify o.ply p.ply --max-error 0.5 --error-field");
    assert_eq!(output.status.code(), Some(2), "the name is taken: {output:?}");
}

/// Largest share by which a vertex is farther from the mesh than its `error` says.
fn beyond_field(mesh: &Mesh, path: &Path) -> f64 {
    let source = stonecut::io::ply::MeshSource::open(path).unwrap();
    let (mut places, mut errors) = (Vec::new(), Vec::new());
    source
        .each_vertex_block(|block| {
            for record in block.records.chunks_exact(source.schema().record_bytes()) {
                places.push(source.schema().position(record));
                let error = record.last_chunk().map(|bytes| f32::from_le_bytes(*bytes));
                errors.push(f64::from(error.unwrap()));
            }
            Ok(())
        })
        .unwrap();
    let target = measure::Parts::in_memory(mesh, None);
    let true_ones =
        measure::distances(&places, &target, 1, u64::MAX, &Progress::default()).unwrap();
    assert!(true_ones.len() > 40 && true_ones.iter().any(|distance| *distance > 0.0));
    let shares = true_ones.iter().zip(&errors).map(|(distance, error)| distance / error);
    shares.filter(|share| share.is_finite()).fold(0.0, f64::max)
}

#[test]
fn no_vertex_is_farther_than_its_field_says() {
    let at = &scratch();
    let mesh = meshes::torus(60, 40, |_, _| 0.4);
    write_ply(&at.join("in.ply"), Scalar::F64, &mesh.positions, &mesh.triangles);
    let faces = |name: &str| {
        let source = stonecut::io::ply::MeshSource::open(&at.join(name)).unwrap();
        let mut all = Vec::new();
        (0..source.n_face_blocks()).for_each(|index| {
            let mut block = stonecut::io::ply::FaceBlock::default();
            source.read_faces(index, &mut block).unwrap();
            all.extend(block.triangles);
        });
        all
    };
    for cells in ["", "--cell-triangles 1500"] {
        let bounded = format!("--max-error 0.01 {cells} --force");
        for format in ["", "--format ascii", "--format binary_big_endian"] {
            expect(at, &format!("simplify in.ply o.ply --error-field {format} {bounded}"), 0);
            let share = beyond_field(&mesh, &at.join("o.ply"));
            assert!(share <= 1.0 + 1e-9, "{cells} {format}: {share} times");
        }
        expect(at, &format!("simplify in.ply p.ply {bounded}"), 0);
        assert!(faces("o.ply") == faces("p.ply"), "{cells}: faces are as without");
    }
}

#[test]
fn stages_one_by_one_give_the_same_bytes() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 20k", 0);
    let bounded = "simplify in.ply out.ply --max-error 0.002 --cell-triangles 3k --memory 200MiB";
    expect(at, &bounded.replace("out.ply", "direct.ply"), 0);
    for stage in ["partition", "simplify", "stitch"] {
        expect(at, &format!("{bounded} --until {stage}"), 0);
        assert!(!at.join("out.ply").exists(), "{stage} is not the end");
    }
    expect(at, bounded, 0);
    let read = |name: &str| std::fs::read(at.join(name)).unwrap();
    assert!(read("out.ply") == read("direct.ply"));
}

/// Three rounds of one cell each within a bound; every one knows points of the original, if they are handed on.
fn through_rounds(mesh: &Mesh, distance: f64, hands_on: bool) -> Mesh {
    let mut now = mesh.clone();
    for share in [0.25, 0.5, 1.0] {
        let bound = Some(Bound { distance: share * distance, channel: Some(0), patience: 1.0 });
        let options = Options { stop: Stop::Triangles(0), bound, ..Options::default() };
        let locked = vec![false; now.positions.len()];
        now = simplify_mesh(now, &locked, &options).mesh;
        assert_eq!(now.extremes.len(), now.triangles.len());
        if !hands_on {
            now.extremes.clear();
        }
    }
    now
}

#[test]
fn points_of_the_original_ride_from_round_to_round() {
    let plain = synth::mesh(&Settings::new(Kind::Statue, 60_000)).unwrap();
    let channels = vec![0.0; plain.positions.len()];
    let mesh = Mesh { n_channels: 1, channels, ..plain };
    let distance = 2.0;
    let largest = |result: &Mesh| {
        let options = measure::Options { samples: 200_000, threads: 2, ..Default::default() };
        let found = measure::two_sided(&mesh, result, &options, &Progress::default()).unwrap();
        found.forward.distance.max.max(found.backward.distance.max)
    };
    let with = through_rounds(&mesh, distance, true);
    let without = through_rounds(&mesh, distance, false);
    let (n, n_without) = (with.triangles.len(), without.triangles.len());
    assert!(10 * n < 9 * n_without, "{n} {n_without}");
    let (off, off_without) = (largest(&with), largest(&without));
    assert!(off_without <= distance, "{off_without}");
    assert!(off <= 1.3 * distance, "{off}");
}

#[test]
fn a_bound_below_the_rounding_of_the_output_ends_with_a_word() {
    let at = &scratch();
    let mesh = synth::mesh(&Settings::new(Kind::Statue, 3_000)).unwrap();
    let far: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.map(|x| 0.1 * x + 4e6)).collect();
    write_ply(&at.join("in.ply"), Scalar::F64, &far, &mesh.triangles);
    for target in ["--ratio 10%", ""] {
        let command = format!("simplify in.ply out.ply {target} --max-error 0.001 --format float");
        let said = expect(at, &command, 3);
        assert!(said.contains("no result keeps the bound"), "{said}");
    }
}

#[test]
fn a_run_that_is_tighter_in_a_ball_repeats_the_first_one_elsewhere() {
    let mesh = synth::mesh(&Settings::new(Kind::Statue, 60_000)).unwrap();
    let locked = vec![false; mesh.positions.len()];
    let distance = 1.0;
    let earlier = EarlierRun::default();
    let run = |tight: &[Tight]| {
        let options = Options {
            stop: Stop::Triangles(0),
            bound: Some(Bound { distance, channel: None, patience: 1.0 }),
            tight: tight.into(),
            earlier: Some(earlier.clone()),
            ..Options::default()
        };
        simplify_mesh(mesh.clone(), &locked, &options).mesh
    };
    let corners = |of: &Mesh| {
        let mut all: Vec<_> = (0..of.triangles.len())
            .map(|t| {
                let mut places = of.corners(t).map(|p| p.map(f64::to_bits));
                places.sort_unstable();
                places
            })
            .collect();
        all.sort_unstable();
        all
    };
    let first = run(&[]);
    assert!(earlier.is_known());
    assert_eq!(corners(&run(&[])), corners(&first));
    // All of the bound is kept in hand around a vertex of the input: nothing goes there.
    let place = mesh.positions[mesh.positions.len() / 3];
    let off_sq = |p: &[f64; 3]| (0..3).map(|k| (p[k] - place[k]).powi(2)).sum::<f64>();
    let mut all: Vec<f64> = mesh.positions.iter().map(off_sq).collect();
    all.sort_unstable_by(f64::total_cmp);
    let ball = Tight { place, radius: all[60].sqrt(), margin: distance };
    let second = run(&[ball]);
    let is_in = |p: &&[f64; 3]| off_sq(p) < all[60];
    let n_in = |of: &Mesh| of.positions.iter().filter(is_in).count();
    assert!(n_in(&second) >= n_in(&mesh));
    assert!(n_in(&first) < n_in(&mesh) / 2);
    let (before, after) = (corners(&first), corners(&second));
    let n_common = after.iter().filter(|t| before.binary_search(t).is_ok()).count();
    assert!(20 * n_common > 19 * before.len(), "{n_common} of {}", before.len());
    let options = measure::Options { samples: 200_000, threads: 2, ..Default::default() };
    let found = measure::two_sided(&mesh, &second, &options, &Progress::default()).unwrap();
    let largest = found.forward.distance.max.max(found.backward.distance.max);
    assert!(largest <= 1.1 * distance, "{largest}");
}
