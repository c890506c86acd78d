//! `simplify --method retile` end to end: counts, angles, topology, attributes, bytes, refusals.

use crate::common::meshes::{ply_text, sheet_triangles};
use crate::common::{check, count, expect, report, rms, scratch};

#[test]
fn triangles_are_even_and_meet_the_count_on_a_surface_that_stays_one() {
    let at = &scratch();
    for (kind, genus_kept) in [("statue", true), ("terrain", true), ("gyroid", false)] {
        expect(at, &format!("synth {kind} in.ply --triangles 60k --force"), 0);
        let before = check(at, "in.ply");
        for target in [12_000, 3_000] {
            let options = format!("--triangles {target} --force --report r.json");
            expect(at, &format!("simplify in.ply out.ply --method retile {options}"), 0);
            let (info, report) = (check(at, "out.ply"), report(at));
            let n = count(&info, "triangles");
            assert!(n <= target && n + 60 >= target, "{kind}: {n} of {target}");
            for fault in ["degenerate_triangles", "duplicate_triangles", "non_manifold_edges"] {
                assert_eq!(count(&info, fault), 0, "{kind} at {target}: {fault}");
            }
            assert_eq!(count(&info, "unreferenced_vertices"), 0);
            assert_eq!(count(&info, "inconsistent_edges"), 0);
            let median = report["retiling"]["angles"]["median"].as_f64().unwrap();
            assert!(median >= 45.0, "{kind} at {target}: {median}");
            let [short, long] = ["median", "longest"]
                .map(|name| report["retiling"]["edges"][name].as_f64().unwrap());
            assert!(long < 4.0 * short, "{kind} at {target}: {short} to {long}");
            if genus_kept {
                let euler = |info: &serde_json::Value| info["euler_characteristic"].clone();
                assert_eq!(euler(&info), euler(&before), "{kind} at {target}");
            }
            // Vertices are on the surface, within a share of an edge.
            assert!(rms(at, "in.ply", "out.ply") < 0.2 * short, "{kind} at {target}");
        }
    }
}

/// A surface of tubes that are thinner than an edge of the result: the run ends, and what is left is a surface.
#[test]
fn tubes_thinner_than_an_edge_come_apart() {
    let at = &scratch();
    expect(at, "synth gyroid in.ply --triangles 60k", 0);
    // Of 300, a fifth of the volume is lost.
    for (target, code) in [(1_000, 0), (300, 3)] {
        let options = format!("--triangles {target} --force --report r.json");
        expect(at, &format!("simplify in.ply out.ply --method retile {options}"), code);
        let (info, report) = (check(at, "out.ply"), report(at));
        assert_eq!(count(&info, "non_manifold_edges"), 0, "{target}");
        assert!(count(&info, "triangles") > target / 2, "{target}: {info}");
        assert!(report["retiling"]["passes"].as_u64().unwrap() < 400, "{report}");
    }
}

/// A cube of 12 triangles is cut as finely as its clusters need it; corners and edges stay within a part of an edge.
#[test]
fn large_triangles_are_cut_first() {
    let at = &scratch();
    let corner = |i: u32| format!("v {} {} {}\n", i & 1, i >> 1 & 1, i >> 2);
    let mut text: String = (0..8).map(corner).collect();
    for [a, b, c, d] in
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    {
        text += &format!("f {} {} {}\nf {} {} {}\n", a + 1, b + 1, c + 1, a + 1, c + 1, d + 1);
    }
    std::fs::write(at.join("cube.obj"), text).unwrap();
    expect(at, "simplify cube.obj out.ply --method retile --triangles 12 --report r.json", 0);
    assert_eq!(report(at)["target_met"], true);
    let info = check(at, "out.ply");
    assert_eq!((count(&info, "boundary_edges"), &info["euler_characteristic"]), (0, &2.into()));
}

#[test]
fn colours_are_means_and_labels_those_of_a_vertex() {
    let at = &scratch();
    let n = 60u32;
    let rows = (0..(n + 1) * (n + 1)).map(|v| {
        let (x, y) = (v % (n + 1), v / (n + 1));
        format!("{x} {y} 0 {} {} 40 {}", 4 * x, 4 * y, if x < 30 { 7 } else { 9 })
    });
    let rows = rows.collect::<Vec<_>>().into_iter();
    let properties = "uchar red, uchar green, uchar blue, int label";
    let text = ply_text(properties, rows, &sheet_triangles(n as usize));
    std::fs::write(at.join("in.ply"), text).unwrap();
    expect(at, "simplify in.ply out.ply --method retile --triangles 400 --format ascii", 0);
    let out = std::fs::read_to_string(at.join("out.ply")).unwrap();
    let header = out.split("end_header\n").next().unwrap();
    let names: Vec<&str> = header
        .lines()
        .filter(|line| line.starts_with("property") && !line.contains("list"))
        .map(|line| line.split(' ').next_back().unwrap())
        .collect();
    let place = |name: &str| names.iter().position(|n| *n == name).unwrap();
    let n_vertices: usize =
        header.split("element vertex ").nth(1).unwrap().lines().next().unwrap().parse().unwrap();
    let rows = out.split("end_header\n").nth(1).unwrap().lines().take(n_vertices);
    let (mut n_right, mut n_rim, mut n_on_rim) = (0, 0, 0);
    for row in rows {
        let row: Vec<f64> = row.split(' ').map(|x| x.parse().unwrap()).collect();
        let at = |name: &str| row[place(name)];
        // At the rim the mean of a cluster lies inside of it, by less than its radius.
        assert!((at("red") - 4.0 * at("x")).abs() < 4.0 * 4.0, "{row:?}");
        assert!((at("green") - 4.0 * at("y")).abs() < 4.0 * 4.0, "{row:?}");
        assert!((at("blue") - 40.0).abs() <= 1.0);
        assert!(at("label") == 7.0 || at("label") == 9.0);
        let own = if at("x") < 29.5 { 7.0 } else { 9.0 };
        n_right += usize::from(at("label") == own);
        // The rim stays where it is, and corners within a quarter of an edge (of 4.4).
        assert!((-1.1..=61.1).contains(&at("x")) && (-1.1..=61.1).contains(&at("y")), "{row:?}");
        let [x, y] = [at("x"), at("y")].map(|x| x.min(60.0 - x));
        if x.min(y) < 0.5 && x.max(y) > 4.0 {
            n_rim += 1;
            n_on_rim += usize::from(x.min(y).abs() < 0.05);
        }
    }
    assert!(n_right * 100 >= 97 * n_vertices);
    assert!(n_rim > 40 && n_on_rim * 10 > 8 * n_rim, "{n_on_rim} of {n_rim}");
}

#[test]
fn gradation_makes_bent_places_finer() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 60k", 0);
    let run = |options: &str| {
        let line = "simplify in.ply out.ply --method retile --triangles 3k --force --report r.json";
        expect(at, &format!("{line} {options}"), 0);
        let edges = report(at)["retiling"]["edges"].clone();
        let [short, long] = ["shortest", "longest"].map(|name| edges[name].as_f64().unwrap());
        (long / short, rms(at, "in.ply", "out.ply"))
    };
    let (even, graded) = (run(""), run("--gradation 1.5"));
    assert!(graded.1 < even.1, "{even:?} {graded:?}");
}

#[test]
fn bytes_are_the_same_for_any_threads_and_memory_and_too_little_is_refused() {
    let at = &scratch();
    expect(at, "synth scans in.ply --triangles 60k", 0);
    let simplify = "simplify in.ply out.ply --method retile --ratio 10% --force";
    let mesh = |options: &str| {
        expect(at, &format!("{simplify} {options}"), 0);
        std::fs::read(at.join("out.ply")).unwrap()
    };
    let whole = mesh("--memory 1GiB --threads 1");
    assert!(whole == mesh("--memory 300MiB --threads 3"));
    let said = expect(at, &format!("{simplify} --memory 33MiB"), 6);
    assert!(said.contains("give at least --memory"), "{said}");
    let said = expect(at, "simplify in.ply o.ply --ratio 10% --gradation 1.5", 2);
    assert!(said.contains("--gradation is for --method retile"), "{said}");
    expect(at, "simplify in.ply o.ply --ratio 10% --method retile --gradation nan", 2);
}
