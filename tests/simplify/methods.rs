//! `simplify --method cluster` end to end: counts, bytes, attributes, refusals.

use crate::common::{check, count, expect, json, report, rms, run, scratch, write_ply};
use std::path::Path;
use stonecut::mesh::property::Scalar;

/// A flat square of `2 n^2` triangles with a side of `n`.
fn flat(n: u32) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nproperty uchar material\nend_header\n",
        (n + 1) * (n + 1),
        2 * n * n
    );
    for v in 0..(n + 1) * (n + 1) {
        text += &format!("{} {} 7.25\n", v % (n + 1), v / (n + 1));
    }
    for quad in 0..n * n {
        let a = quad / n * (n + 1) + quad % n;
        text += &format!("3 {a} {} {} 5\n3 {a} {} {} 6\n", a + 1, a + n + 2, a + n + 2, a + n + 1);
    }
    text
}

#[test]
fn clusters_meet_the_target_and_stay_near_the_surface() {
    let at = &scratch();
    for kind in ["statue", "terrain", "gyroid", "scans"] {
        expect(at, &format!("synth {kind} in.ply --triangles 30k --force"), 0);
        for target in [8_000, 2_000, 300] {
            let options = format!("--triangles {target} --force --report r.json");
            expect(at, &format!("simplify in.ply out.ply --method cluster {options}"), 0);
            let info = check(at, "out.ply");
            let n = count(&info, "triangles");
            assert!(n <= target && n >= target * 2 / 3, "{kind}: {n} of {target}");
            assert_eq!(count(&info, "degenerate_triangles"), 0, "{kind}");
            assert_eq!(count(&info, "duplicate_triangles"), 0, "{kind}");
            assert_eq!(count(&info, "unreferenced_vertices"), 0, "{kind}");
            let report = report(at);
            assert_eq!(
                (report["method"].as_str(), report["target_met"].as_bool()),
                (Some("cluster"), Some(true))
            );
            // No point is farther from the surface than the diagonal of the cells that a vertex can come from.
            let cell = report["grid"]["cell_size"].as_f64().unwrap();
            assert!(rms(at, "in.ply", "out.ply") < 0.5 * cell, "{kind} at {target}");
        }
        expect(at, "simplify in.ply best.ply --triangles 3k --force", 0);
        expect(at, "simplify in.ply out.ply --method cluster --triangles 3k --force", 0);
        let (best, found) = (rms(at, "in.ply", "best.ply"), rms(at, "in.ply", "out.ply"));
        assert!(found < 6.0 * best && found > best, "{kind}: {found} against {best}");
    }
}

/// Where the grid is coarser than the sheets are apart: no edge of three triangles is left, no triangle is lost, and what
/// was manifold has the bytes that it has without the option.
#[test]
fn clusters_come_apart_where_sheets_joined() {
    let at = &scratch();
    for (kind, is_joined) in [("flat", false), ("gyroid", true)] {
        match kind {
            "flat" => std::fs::write(at.join("in.ply"), flat(60)).unwrap(),
            _ => _ = expect(at, &format!("synth {kind} in.ply --triangles 60k --color --force"), 0),
        }
        let simplify = "simplify in.ply --method cluster --triangles 1500 --force";
        expect(at, &format!("{simplify} joined.ply"), 0);
        expect(at, &format!("{simplify} apart.ply --manifold --report r.json"), 0);
        let [joined, apart] = ["joined.ply", "apart.ply"].map(|file| check(at, file));
        assert_eq!(count(&joined, "non_manifold_edges") > 0, is_joined, "{kind}");
        assert_eq!(count(&apart, "non_manifold_edges"), 0, "{kind}");
        assert_eq!(count(&apart, "triangles"), count(&joined, "triangles"), "{kind}");
        let copied = report(at)["grid"]["copied_vertices"].as_i64().unwrap();
        assert_eq!(count(&joined, "vertices") + copied, count(&apart, "vertices"), "{kind}");
        assert_eq!(copied > 0, is_joined, "{kind}");
    }
    let said = expect(at, "simplify in.ply o.ply --ratio 10% --manifold", 2);
    assert!(said.contains("--manifold is for --method cluster"), "{said}");
}

#[test]
fn clusters_are_the_same_bytes_for_any_threads_and_memory() {
    let at = &scratch();
    // 20 blocks of vertices, 1.5 MiB each: more than the least budget holds.
    expect(at, "synth terrain in.ply --triangles 2600k --format double", 0);
    let simplify = "simplify in.ply out.ply --method cluster --triangles 3k --force";
    let mesh = |options: &str| {
        expect(at, &format!("{simplify} {options}"), 0);
        std::fs::read(at.join("out.ply")).unwrap()
    };
    let whole = mesh("--memory 1GiB --threads 1");
    assert!(whole == mesh("--memory 1GiB --threads 4"), "threads");
    let said = expect(at, &format!("{simplify} --memory 1MiB --threads 1"), 6);
    let least = said.split("give at least --memory ").nth(1).unwrap();
    let least: u64 = least.split("MiB").next().unwrap().parse().unwrap();
    assert!(least < 80, "{said}");
    let plan = expect(at, &format!("{simplify} --dry-run --memory {least}MiB --threads 1"), 0);
    assert!(plan.contains("read again as needed"), "{plan}");
    assert!(whole == mesh(&format!("--memory {least}MiB --threads 1")), "memory");
    expect(at, &format!("{simplify} --memory {}MiB --threads 1", least - 1), 6);
}

#[test]
fn a_plan_says_what_a_run_does_and_writes_nothing() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 100k", 0);
    let simplify = "simplify in.ply out.ply --method cluster";
    let plan = expect(at, &format!("{simplify} --ratio 5% --dry-run"), 0);
    assert!(plan.contains("5000 triangles, at most") && plan.contains("cluster: a grid"), "{plan}");
    assert_eq!(std::fs::read_dir(at).unwrap().count(), 1);
    expect(at, &format!("{simplify} --ratio 5% --report r.json"), 0);
    let first = report(at);
    let n = first["output"]["triangles"].as_f64().unwrap();
    let expected = first["grid"]["expected_triangles"].as_f64().unwrap();
    assert!((n / expected - 1.0).abs() < 0.1, "{n} of {expected}");
    assert!(!at.join("out.ply.stonecut-job").exists());
    let cell = first["grid"]["cell_size"].as_f64().unwrap();
    // The same grid by its cell size; a finer one has more triangles.
    let mut before = 0.0;
    for factor in [2.0, 1.0, 0.5] {
        let size = cell * factor;
        expect(at, &format!("{simplify} --grid {size} --force --report r.json"), 0);
        let report = report(at);
        let n = report["output"]["triangles"].as_f64().unwrap();
        assert!(n > 2.0 * before, "{n} after {before}");
        assert_eq!(report["stop_reason"], "the grid");
        assert_eq!(report["settings"]["target"], format!("grid={size}"));
        before = n;
    }
}

#[test]
fn a_flat_square_stays_flat_whole_and_the_right_way_up() {
    let at = &scratch();
    std::fs::write(at.join("in.ply"), flat(100)).unwrap();
    let said =
        expect(at, "simplify in.ply out.ply --method cluster --triangles 800 --format ascii", 0);
    assert!(said.contains("material") && said.contains("does not carry"), "{said}");
    let text = std::fs::read_to_string(at.join("out.ply")).unwrap();
    let mut rows = text.split_once("end_header\n").unwrap().1.lines();
    let n_vertices: usize = text
        .split("element vertex ")
        .nth(1)
        .unwrap()
        .split_whitespace()
        .next()
        .unwrap()
        .parse()
        .unwrap();
    let numbers = |row: &str| -> Vec<f64> { row.split(' ').map(|x| x.parse().unwrap()).collect() };
    let places: Vec<Vec<f64>> = rows.by_ref().take(n_vertices).map(numbers).collect();
    let mut area = 0.0;
    for row in rows {
        let corners: Vec<&Vec<f64>> =
            numbers(row)[1..].iter().map(|&v| &places[v as usize]).collect();
        let (a, b, c) = (corners[0], corners[1], corners[2]);
        let twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        assert!(twice > 0.0, "{row} faces down");
        area += twice / 2.0;
    }
    assert!(places.iter().all(|p| (p[2] - 7.25).abs() < 1e-6));
    // The boundary stays where it is but for the corners of cells across it.
    assert!(area > 0.97 * 1e4 && area <= 1e4 * 1.0001, "{area}");
}

#[test]
fn what_vertices_carry_is_averaged() {
    let at = &scratch();
    expect(at, "synth scans in.ply --triangles 60k --color", 0);
    let simplify = "simplify in.ply out.ply --method cluster --triangles 5k --force";
    expect(at, simplify, 0);
    let said = expect(at, "measure in.ply out.ply --samples 20k --report m.json", 0);
    let measured = json(at, "m.json");
    let colour = measured["forward"]["color_delta_e"].as_f64().unwrap_or_else(|| panic!("{said}"));
    assert!(colour > 0.0 && colour < 20.0, "{colour}");
    for (normals, expected) in [("recompute", true), ("drop", false)] {
        expect(at, &format!("{simplify} --normals {normals}"), 0);
        let bytes = std::fs::read(at.join("out.ply")).unwrap();
        let header = String::from_utf8_lossy(&bytes[..2000.min(bytes.len())]).into_owned();
        assert_eq!(header.contains("property float nx"), expected, "{normals}");
        assert!(header.contains("property uchar red"));
    }
    // A constant survives the mean exactly, and a label is one of the input's.
    let labelled = flat(60).replace(
        "property float z\n",
        "property float z\nproperty uchar class\nproperty float heat\n",
    );
    let mut i = 0;
    let labelled: String = labelled
        .lines()
        .map(|line| {
            let is_vertex = line.ends_with("7.25");
            i += u32::from(is_vertex);
            if is_vertex {
                format!("{line} {} 0.1\n", 7 * (i % 2 + 1))
            } else {
                format!("{line}\n")
            }
        })
        .collect();
    std::fs::write(at.join("in.ply"), labelled).unwrap();
    expect(
        at,
        "simplify in.ply out.ply --method cluster --triangles 500 --force --format ascii",
        0,
    );
    let text = std::fs::read_to_string(at.join("out.ply")).unwrap();
    let rows = text.split_once("end_header\n").unwrap().1;
    let vertices: Vec<&str> = rows.lines().filter(|row| !row.starts_with("3 ")).collect();
    assert!(vertices.len() > 100);
    for row in vertices {
        assert!(row.ends_with(" 7 0.1") || row.ends_with(" 14 0.1"), "{row}");
    }
}

#[test]
fn options_that_mean_nothing_are_refused_by_name() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 5k", 0);
    for (option, named) in [
        ("--ratio 10% --cell-triangles 2k", "--cell-triangles"),
        ("--ratio 10% --fit on", "--fit"),
        ("--ratio 10% --until simplify", "--until"),
        ("--ratio 10% --topology keep", "--topology"),
        ("--ratio 10% --placement subset", "--placement"),
        ("--ratio 10% --min-component 5", "--min-component"),
        ("--ratio 10% --weight color=2", "--weight"),
        ("--ratio 10% --seams s.ply", "--seams"),
        ("--ratio 10% --textures none", "--textures"),
        ("--ratio 10% --merge-distance 1", "--merge-distance"),
        ("--max-error 1", "--max-error"),
        ("--grid 1 --ratio 10%", "--ratio"),
        ("--grid 0", "--grid"),
        ("--grid 1e-9", "2,097,151 cells"),
    ] {
        let said = expect(at, &format!("simplify in.ply out.ply --method cluster {option}"), 2);
        assert!(said.contains(named), "{option}: {said}");
        assert_eq!(std::fs::read_dir(at).unwrap().count(), 1, "{option}");
    }
    let said = expect(at, "simplify in.ply out.ply --grid 1", 2);
    assert!(said.contains("--method cluster"), "{said}");
    expect(at, "simplify in.ply out.ply --method cluster", 2);
    // A run in a folder of temporary data, measured.
    std::fs::create_dir(at.join("temp")).unwrap();
    let options = "--ratio 10% --temp-dir temp --verify --report r.json";
    expect(at, &format!("simplify in.ply out.ply --method cluster {options}"), 0);
    let report = report(at);
    assert!(report["hausdorff"]["upper"].as_f64().unwrap() > 0.0);
    assert!(report["measured"]["rms"].as_f64().unwrap() > 0.0);
    expect(at, "simplify in.ply out.ply --method cluster --ratio 10%", 2);
    expect(at, "synth rooms rooms.ply --triangles 3k", 0);
    expect(at, "simplify rooms.ply small.ply --method cluster --ratio 20%", 4);
    expect(at, "simplify rooms.ply small.ply --method cluster --ratio 20% --drop-texture", 0);
}

#[test]
fn broken_inputs_are_errors_or_dropped_and_never_a_panic() {
    let at = &scratch();
    let head = |n_vertices: u32, n_faces: u32| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {n_vertices}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {n_faces}\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let cases = [
        (head(3, 1) + "1 1 1\n1 1 1\n1 1 1\n3 0 1 2\n", "", 4, "one place"),
        (head(3, 1) + "0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n", "", 4, "row 0"),
        (head(3, 1) + "0 0 0\n1 0 0\n0 nan 0\n3 0 1 2\n", "", 4, "finite"),
        (head(3, 0) + "0 0 0\n1 0 0\n0 1 0\n", "", 4, "no triangles"),
        (
            head(4, 2) + "0 0 0\n1 0 0\n0 1 0\n0 0 nan\n3 0 1 2\n3 0 1 3\n",
            "--skip-bad",
            3,
            "bad faces",
        ),
        (head(3, 1) + "-3e29 0 0\n3e29 0 0\n0 3e29 0\n3 0 1 2\n", "", 0, "1 triangles"),
        (head(3, 1) + "-3e38 0 0\n3e38 0 0\n0 3e38 0\n3 0 1 2\n", "", 4, "beyond 1e30"),
        (head(3, 1) + "0 0 0\n1e-30 0 0\n0 1e-30 0\n3 0 1 2\n", "", 0, "1 triangles"),
    ];
    for (mesh, options, code, said) in cases {
        std::fs::write(at.join("in.ply"), mesh).unwrap();
        let command =
            format!("simplify in.ply out.ply --method cluster --triangles 10 --force {options}");
        let output = run(at, &command);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{text}");
        assert!(text.contains(said), "{said}: {text}");
        assert!(!at.join("out.ply.stonecut-job").exists(), "{said}");
    }
    std::fs::write(at.join("in.ply"), flat(20)).unwrap();
    let said = expect(at, "simplify in.ply none.ply --method cluster --grid 100", 3);
    assert!(said.contains("smaller --grid") && !at.join("none.ply").exists(), "{said}");
}

/// The rows of positions of a binary PLY of floats without properties.
fn rows(path: &Path) -> Vec<[u8; 12]> {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let n = header.split("element vertex ").nth(1).unwrap();
    let n: usize = n.split_whitespace().next().unwrap().parse().unwrap();
    bytes[end..end + 12 * n].chunks_exact(12).map(|row| row.try_into().unwrap()).collect()
}

#[test]
fn decimation_meets_the_count_keeps_vertices_and_the_topology() {
    let at = &scratch();
    for kind in ["statue", "terrain", "gyroid"] {
        expect(at, &format!("synth {kind} in.ply --triangles 30k --force"), 0);
        let before = check(at, "in.ply");
        let known: std::collections::HashSet<[u8; 12]> =
            rows(&at.join("in.ply")).into_iter().collect();
        let mut errors = Vec::new();
        for target in [10_000, 4_000] {
            let options = format!("--triangles {target} --force --report r.json");
            expect(at, &format!("simplify in.ply out.ply --method decimate {options}"), 0);
            let after = check(at, "out.ply");
            let n = count(&after, "triangles");
            assert!(n == target || n == target - 1, "{kind}: {n} of {target}");
            for key in
                ["euler_characteristic", "components", "non_manifold_edges", "inconsistent_edges"]
            {
                assert_eq!(count(&after, key), count(&before, key), "{kind} at {target}: {key}");
            }
            assert_eq!(count(&after, "boundary_edges") > 0, count(&before, "boundary_edges") > 0);
            for key in ["degenerate_triangles", "duplicate_triangles", "unreferenced_vertices"] {
                assert_eq!(count(&after, key), 0, "{kind} at {target}: {key}");
            }
            assert!(rows(&at.join("out.ply")).iter().all(|row| known.contains(row)), "{kind}");
            let report = report(at);
            let removed = |name: &str| report["decimation"][name].as_u64().unwrap();
            assert!(
                removed("removed_simple") > 0
                    && report["decimation"]["farthest"].as_f64().unwrap() > 0.0
            );
            assert_eq!(removed("removed_boundary") > 0, kind == "terrain");
            errors.push(rms(at, "in.ply", "out.ply"));
        }
        expect(
            at,
            "simplify in.ply best.ply --triangles 4k --placement subset --topology keep --force",
            0,
        );
        let best = rms(at, "in.ply", "best.ply");
        assert!(errors[0] < errors[1] && errors[1] < 2.5 * best, "{kind}: {errors:?}, {best}");
    }
}

#[test]
fn decimation_keeps_creases_refuses_what_does_not_fit_and_carries_attributes() {
    let at = &scratch();
    // A roof of two planes with a ridge along x = 20.
    let roof: String = flat(40)
        .lines()
        .map(|line| match line.strip_suffix(" 7.25") {
            None => format!("{line}\n"),
            Some(place) => {
                let x: f64 = place.split(' ').next().unwrap().parse().unwrap();
                format!("{place} {}\n", 20.0 - (x - 20.0).abs())
            }
        })
        .collect();
    std::fs::write(at.join("in.ply"), roof).unwrap();
    expect(at, "simplify in.ply out.ply --method decimate --triangles 40 --format ascii", 0);
    // Planes are matched exactly: nothing of the ridge or of the rim is lost.
    assert!(rms(at, "in.ply", "out.ply") < 1e-9);
    let said = expect(at, "simplify in.ply few.ply --method decimate --triangles 100", 0);
    assert!(said.contains("material") && said.contains("does not carry"), "{said}");
    let said =
        expect(at, "simplify in.ply o.ply --method decimate --ratio 10% --feature-angle 200", 2);
    assert!(said.contains("0 to 180"), "{said}");
    let said =
        expect(at, "simplify in.ply o.ply --method cluster --ratio 10% --feature-angle 20", 2);
    assert!(said.contains("--method decimate"), "{said}");
    // Nothing closed has one triangle.
    expect(at, "synth statue closed.ply --triangles 2k", 0);
    let said = expect(at, "simplify closed.ply few.ply --method decimate --triangles 1 --force", 3);
    assert!(said.contains("no vertex is left that can be removed"), "{said}");
    expect(at, "synth statue big.ply --triangles 1M", 0);
    let said = expect(at, "simplify big.ply o.ply --method decimate --ratio 10% --memory 64MiB", 6);
    assert!(said.contains("works in memory") && said.contains("--placement subset"), "{said}");
    let least = said.split("give at least --memory ").nth(1).unwrap().split(',').next().unwrap();
    expect(
        at,
        &format!("simplify big.ply o.ply --method decimate --ratio 10% --memory {least} --dry-run"),
        0,
    );
    expect(at, "synth scans colour.ply --triangles 30k --color", 0);
    expect(at, "simplify colour.ply a.ply --method decimate --ratio 20% --threads 1", 0);
    expect(at, "simplify colour.ply b.ply --method decimate --ratio 20% --threads 3", 0);
    let bytes = |name: &str| std::fs::read(at.join(name)).unwrap();
    assert!(bytes("a.ply") == bytes("b.ply"));
    let header = bytes("a.ply");
    assert!(String::from_utf8_lossy(&header[..1500]).contains("property uchar red"));
}

#[test]
fn methods_are_compared_on_one_page() {
    let at = &scratch();
    expect(at, "synth statue a<b.ply --triangles 8k", 0);
    let said = expect(
        at,
        "compare collapse,cluster,decimate a<b.ply --triangles 1k -o page.html --samples 5k",
        0,
    );
    assert!(said.contains("decimate: 1000 triangles"), "{said}");
    let page = std::fs::read_to_string(at.join("page.html")).unwrap();
    for word in [
        "collapse",
        "cluster",
        "decimate",
        "RMS distance",
        "peak memory",
        "smallest angle",
        "Euler",
        "Methods on a&lt;b.ply",
        "Peak memory",
    ] {
        assert!(page.contains(word), "{word}");
    }
    assert!(!page.contains("a<b"));
    // The least error of a row is the best; no method is by its share of the mean edge.
    let row = |name: &str| {
        let row = page.split(&format!("<tr><th>{name}</th>")).nth(1).unwrap();
        let values = row.split("</tr>").next().unwrap().split("</td>").filter(|v| !v.is_empty());
        let value = |cell: &str| -> (f64, bool) {
            let text = cell.rsplit('>').next().unwrap();
            (text.parse().unwrap(), cell.contains("best"))
        };
        values.map(value).collect::<Vec<_>>()
    };
    let errors = row("RMS distance, both ways");
    let least = errors.iter().map(|error| error.0).fold(f64::INFINITY, f64::min);
    assert!(errors.iter().all(|&(error, is_best)| is_best == (error == least)), "{errors:?}");
    let shares = row("… of the mean edge, %");
    assert!(
        shares.len() == 3 && shares.iter().all(|share| share.0 > 0.0 && !share.1),
        "{shares:?}"
    );
    // The original and three results, from three cameras; nothing comes from elsewhere.
    assert_eq!(page.matches("data:image/png;base64,").count(), 12);
    assert!(
        !page.contains("http:") && !page.contains("https:") && page.contains("width=device-width")
    );
    assert_eq!(std::fs::read_dir(at).unwrap().count(), 2);
    let said = expect(at, "compare collapse a<b.ply --triangles 1k -o page.html", 2);
    assert!(said.contains("--force"), "{said}");
    expect(at, "compare tessellate a<b.ply --triangles 1k -o other.html", 2);
    let said =
        expect(at, "compare decimate,cluster a<b.ply --ratio 5% -o other.html --memory 1MiB", 6);
    assert!(said.contains("a picture of 800x600") && !at.join("other.html").exists(), "{said}");
    assert_eq!(std::fs::read_dir(at).unwrap().count(), 2);
    // A method without a result does not end the others.
    let words = "compare cluster,decimate a<b.ply --triangles 4 -o some.html --samples 5k";
    let said = expect(at, words, 0);
    assert!(said.contains("no result") && said.contains("decimate: 4 triangles"), "{said}");
    let page = std::fs::read_to_string(at.join("some.html")).unwrap();
    assert!(page.contains("No result of <b>cluster</b>") && page.contains("<th>decimate</th>"));
}

/// A wavy sheet with a part of it twice, the same way round or turned over, or all of it twice.
#[test]
fn faces_that_are_there_twice_are_dropped_by_every_method() {
    let n = 40u32;
    let place = |i: u32| {
        let (x, y) = (f64::from(i % n) / 39.0, f64::from(i / n) / 39.0);
        [x, y, 0.1 * (6.0 * x).sin() * (5.0 * y).cos()]
    };
    let positions: Vec<[f64; 3]> = (0..n * n).map(place).collect();
    let squares = (0..n * n).filter(|v| v % n + 1 < n && v / n + 1 < n);
    let clean: Vec<[u32; 3]> =
        squares.flat_map(|v| [[v, v + 1, v + n + 1], [v, v + n + 1, v + n]]).collect();
    let part: Vec<[u32; 3]> = clean.iter().copied().skip(1000).take(300).collect();
    let back = |t: &[u32; 3]| [t[0], t[2], t[1]];
    let doubled = [
        ("same", part.clone()),
        ("turned", part.iter().map(back).collect()),
        ("two-sided", clean.iter().map(back).collect::<Vec<_>>()),
    ];
    let at = &scratch();
    write_ply(&at.join("clean.ply"), Scalar::F64, &positions, &clean);
    for (name, more) in doubled {
        let all: Vec<[u32; 3]> = clean.iter().chain(&more).copied().collect();
        write_ply(&at.join("in.ply"), Scalar::F64, &positions, &all);
        for method in ["collapse", "decimate", "retile"] {
            let simplify = "out.ply --triangles 600 --force --report r.json";
            expect(at, &format!("simplify in.ply {simplify} --method {method}"), 0);
            let report = report(at);
            let n_dropped = report["input"]["faults"]["duplicate_faces"].as_u64();
            assert_eq!(n_dropped, Some(more.len() as u64), "{method}, {name}: {report}");
            let n_left = report["output"]["triangles"].as_u64().unwrap();
            assert!((540..=600).contains(&n_left), "{method}, {name}: {n_left}");
            let to = format!("{method}-{name}.json");
            expect(at, &format!("measure clean.ply out.ply --samples 20k --report {to}"), 0);
            let measured = json(at, &to);
            let side = |side: &str| measured[side]["max"].as_f64().unwrap();
            let most = side("forward").max(side("backward"));
            assert!(most < 0.03, "{method}, {name}: {most} away");
        }
    }
}

#[test]
fn missing_values_do_not_spread_by_any_method() {
    const SIDE: u32 = 90;
    let at = &scratch();
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property float quality\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        SIDE * SIDE,
        2 * (SIDE - 1) * (SIDE - 1)
    );
    for v in 0..SIDE * SIDE {
        let (x, y) = (v % SIDE, v / SIDE);
        let z = (0.1 * f64::from(x)).sin() * (0.07 * f64::from(y)).cos();
        let quality = if v % 41 == 7 { "nan".to_owned() } else { (x + y).to_string() };
        text.push_str(&format!("{x} {y} {z} {quality}\n"));
    }
    for v in (0..SIDE * (SIDE - 1)).filter(|v| v % SIDE < SIDE - 1) {
        let (right, above) = (v + 1, v + SIDE);
        text.push_str(&format!("3 {v} {right} {above}\n3 {right} {} {above}\n", above + 1));
    }
    std::fs::write(at.join("in.ply"), text).unwrap();
    for options in [
        "",
        "--weight quality=0.1",
        "--pairs",
        "--optimize 1",
        "--method cluster",
        "--method retile",
        "--cell-triangles 3000",
    ] {
        expect(
            at,
            &format!("simplify in.ply o.ply --triangles 300 {options} --format ascii --force"),
            0,
        );
        let result = std::fs::read_to_string(at.join("o.ply")).unwrap();
        let (head, body) = result.split_once("end_header\n").unwrap();
        let n = head.lines().find_map(|line| line.strip_prefix("element vertex ")).unwrap();
        let numbers = |line: &str| -> Vec<f64> {
            line.split_whitespace().map(|word| word.parse().unwrap()).collect()
        };
        let rows: Vec<_> = body.lines().take(n.parse().unwrap()).map(numbers).collect();
        let n_missing = rows.iter().filter(|row| row[3].is_nan()).count();
        assert!(
            rows.len() > 100 && 12 * n_missing <= rows.len(),
            "{options}: {n_missing} of {}",
            rows.len()
        );
        for row in rows.iter().filter(|row| !row[3].is_nan()) {
            assert!((row[3] - row[0] - row[1]).abs() < 12.0, "{options}: {row:?}");
        }
    }
}
