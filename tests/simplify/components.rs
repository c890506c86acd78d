//! `--min-component`: small components go, whatever the order, the cells and the seams of the input.

use crate::common::{check, count, expect, one_in, report, scratch, write_ply};
use std::collections::HashMap;
use std::path::Path;
use stonecut::config::{Config, MinComponent, Target};
use stonecut::mesh::property::Scalar;
use stonecut::pipeline;
use stonecut::system::disk::{Disk, PowerLoss};
use stonecut::system::progress::Progress;

#[derive(Clone, Default)]
struct Scan {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

/// The same numbers in every run.
struct Random(u32);

impl Random {
    fn below(&mut self, n: u32) -> u32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        ((u64::from(self.0) * u64::from(n)) >> 32) as u32
    }
}

impl Scan {
    /// A strip of `n` triangles from a corner on, `step` wide.
    fn strip(&mut self, n: u32, at: [f32; 3], step: f32) {
        let first = self.positions.len() as u32;
        for i in 0..n + 2 {
            let along = (i / 2) as f32 * step;
            self.positions.push([
                at[0] + along,
                at[1] + (i % 2) as f32 * step,
                at[2] + along * 0.3,
            ]);
        }
        for i in 0..n {
            let (a, b, c) = (first + i, first + i + 1, first + i + 2);
            self.triangles.push(if i % 2 == 0 { [a, c, b] } else { [a, b, c] });
        }
    }

    /// A wavy sheet of `n` by `n` squares, cut into bands that only touch in places if `is_cut`.
    fn sheet(&mut self, n: u32, is_cut: bool) {
        let mut known = HashMap::new();
        for y in 0..n {
            for x in 0..n {
                let band = if is_cut { x / 7 } else { 0 };
                let mut at = |x: u32, y: u32| {
                    *known.entry((x, y, band)).or_insert_with(|| {
                        let z = (x as f32 * 0.7).sin() + (x * y % 7) as f32 * 0.01;
                        // One of the zeros is negative.
                        let zero = if band == 1 { -0.0 } else { 0.0 };
                        let y = if y == 0 { zero } else { y as f32 };
                        self.positions.push([x as f32, y, z]);
                        self.positions.len() as u32 - 1
                    })
                };
                let (a, b, c, d) = (at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1));
                self.triangles.extend([[a, b, c], [b, d, c]]);
            }
        }
    }

    /// A sheet with strips of 1 to 400 triangles above it, most of them across several cells.
    fn noisy(is_cut: bool) -> Scan {
        let mut scan = Scan::default();
        scan.sheet(60, is_cut);
        let mut random = Random(5);
        for i in 0..150 {
            let n = 1 + random.below(if i % 10 == 0 { 400 } else { 60 });
            let at = [random.below(60) as f32, random.below(60) as f32, 3.0 + i as f32];
            scan.strip(n, at, [0.05, 0.3, 1.0][i % 3]);
        }
        scan
    }

    /// Vertices and triangles in another order.
    fn shuffled(&self) -> Scan {
        let mut random = Random(11);
        let mut order = |n: usize| {
            let mut order: Vec<u32> = (0..n as u32).collect();
            (1..n).rev().for_each(|i| order.swap(i, random.below(i as u32 + 1) as usize));
            order
        };
        let (vertices, faces) = (order(self.positions.len()), order(self.triangles.len()));
        let mut place = vec![0; vertices.len()];
        vertices.iter().enumerate().for_each(|(to, &from)| place[from as usize] = to as u32);
        Scan {
            positions: vertices.iter().map(|&v| self.positions[v as usize]).collect(),
            triangles: faces
                .iter()
                .map(|&f| self.triangles[f as usize].map(|v| place[v as usize]))
                .collect(),
        }
    }

    fn write(&self, path: &Path) {
        let positions: Vec<[f64; 3]> = self.positions.iter().map(|p| p.map(f64::from)).collect();
        write_ply(path, Scalar::F32, &positions, &self.triangles);
    }

    /// A number of the component of each triangle, by brute force: labels spread until nothing changes.
    fn labels(&self) -> Vec<usize> {
        let mut first = HashMap::new();
        let mut label: Vec<usize> = (0..self.positions.len())
            .map(|v| *first.entry(self.positions[v].map(|x| (x + 0.0).to_bits())).or_insert(v))
            .collect();
        let same = label.clone();
        loop {
            let mut is_changed = false;
            for triangle in &self.triangles {
                let corners = triangle.map(|v| same[v as usize]);
                let least = corners.iter().map(|&v| label[v]).min().unwrap();
                for v in corners {
                    is_changed |= label[v] != least;
                    label[v] = least;
                }
            }
            if !is_changed {
                break;
            }
        }
        self.triangles.iter().map(|t| label[same[t[0] as usize]]).collect()
    }

    /// For each triangle how many its component has.
    fn sizes_of_each(&self) -> Vec<u64> {
        let labels = self.labels();
        let mut count: HashMap<usize, u64> = HashMap::new();
        labels.iter().for_each(|label| *count.entry(*label).or_default() += 1);
        labels.iter().map(|label| count[label]).collect()
    }

    /// Triangles and diagonal of every component.
    fn components(&self) -> Vec<(u64, f64)> {
        let labels = self.labels();
        let mut found: HashMap<usize, (u64, [f64; 3], [f64; 3])> = HashMap::new();
        for (triangle, of) in self.triangles.iter().zip(labels) {
            let part = found.entry(of).or_insert((0, [f64::MAX; 3], [f64::MIN; 3]));
            part.0 += 1;
            for &v in triangle {
                for k in 0..3 {
                    let x = f64::from(self.positions[v as usize][k]);
                    part.1[k] = part.1[k].min(x);
                    part.2[k] = part.2[k].max(x);
                }
            }
        }
        let size = |(n, low, high): (u64, [f64; 3], [f64; 3])| {
            (n, (0..3).map(|k| (high[k] - low[k]).powi(2)).sum::<f64>().sqrt())
        };
        found.into_values().map(size).collect()
    }
}

/// Runs with a target above the input: nothing but the small components may go.
fn check_drop(scan: &Scan, option: &str, goes: impl Fn(&(u64, f64)) -> bool) {
    let out = &scratch();
    scan.write(&out.join("in.ply"));
    let all = scan.components();
    let kept: Vec<_> = all.iter().filter(|component| !goes(component)).collect();
    let n_kept: u64 = kept.iter().map(|component| component.0).sum();
    let said = expect(
        out,
        &format!(
            "simplify in.ply out.ply --triangles 1M --cell-triangles 1k --min-component {option} --report r.json"
        ),
        0,
    );
    let report = report(out);
    let found = &report["components"];
    assert!(report["cells"].as_u64().unwrap() >= 6, "{report}");
    assert_eq!(found["found"], all.len() as u64, "{option}");
    assert_eq!(found["largest"], all.iter().map(|c| c.0).max().unwrap());
    assert_eq!(found["dropped"], (all.len() - kept.len()) as u64, "{option}");
    assert_eq!(found["dropped_triangles"], scan.triangles.len() as u64 - n_kept, "{option}");
    for below in found["below"].as_array().unwrap() {
        let limit = below["limit"].as_u64().unwrap();
        let small: Vec<u64> = all.iter().map(|c| c.0).filter(|&n| n < limit).collect();
        assert_eq!(below["components"], small.len() as u64, "{limit}");
        assert_eq!(below["triangles"], small.iter().sum::<u64>(), "{limit}");
    }
    let dropped = format!("{} of {} components dropped", all.len() - kept.len(), all.len());
    assert!(said.contains(&dropped), "{said}");
    let topology = check(out, "out.ply");
    assert_eq!(count(&topology, "triangles"), n_kept as i64, "{option}");
    // Nor does a vertex stay behind, in whichever cell.
    assert_eq!(count(&topology, "unreferenced_vertices"), 0, "{option}");
    assert_eq!(report["input"]["faults"]["unreferenced_vertices"], 0);
    let stages: Vec<_> = report["stages"].as_array().unwrap().iter().collect();
    assert_eq!(stages[1]["name"], "components");
    assert_eq!(stages[1]["triangles_out"], n_kept);
}

#[test]
fn what_goes_is_what_brute_force_says() {
    for is_cut in [false, true] {
        let scan = Scan::noisy(is_cut);
        for scan in [scan.shuffled(), scan] {
            check_drop(&scan, "0", |_| false);
            check_drop(&scan, "50", |c| c.0 < 50);
            check_drop(&scan, "size=2.5", |c| c.1 < 2.5);
        }
        let scan = Scan::noisy(is_cut);
        check_drop(&scan, "1k", |c| c.0 < 1000);
        let side = |k: usize| {
            let all = || scan.positions.iter().map(|p| f64::from(p[k]));
            all().fold(f64::MIN, f64::max) - all().fold(f64::MAX, f64::min)
        };
        let diagonal = (0..3).map(|k| side(k).powi(2)).sum::<f64>().sqrt();
        check_drop(&scan, "size=10%", |c| c.1 < 0.1 * diagonal);
    }
}

/// Two hubs in one place, each with a fan of its own; the cell of the place is split by ids, so that no cell
/// holds both. And a fan that goes, whose hub is elsewhere.
#[test]
fn places_connect_across_the_parts_of_a_split_cell() {
    let mut scan =
        Scan { positions: vec![[0.0; 3], [-0.0; 3], [0.5, 9.0, 0.5]], triangles: Vec::new() };
    for i in 0..9000u32 {
        let hub = if i < 2100 { 2 } else { i % 2 };
        let [x, y, z] = scan.positions[hub as usize];
        let first = scan.positions.len() as u32;
        for angle in [i as f32, i as f32 + 0.4].map(|a| a * 7e-4) {
            scan.positions.push([x + angle.cos(), y + angle.sin(), z + i as f32 * 1e-5]);
        }
        scan.triangles.push([hub, first, first + 1]);
    }
    for scan in [scan.shuffled(), scan] {
        assert_eq!(scan.components().len(), 2);
        check_drop(&scan, "2101", |c| c.0 < 2101);
        check_drop(&scan, "2100", |c| c.0 < 2100);
    }
}

/// A triangle by its corners as they are written, the least first, and what else stands on it.
type Face = ([[String; 3]; 3], [[String; 2]; 3], String);

fn face(corners: [([String; 3], [String; 2]); 3], label: String) -> Face {
    let least = (0..3).min_by_key(|&k| &corners[k]).unwrap();
    let turned = [0, 1, 2].map(|k| corners[(k + least) % 3].clone());
    (turned.clone().map(|c| c.0), turned.map(|c| c.1), label)
}

/// As every writer of floats here does, with one zero.
fn place(p: [f32; 3]) -> [String; 3] {
    p.map(|x| (x + 0.0).to_string())
}

impl Scan {
    /// Texture coordinates of a vertex: unlike those of all others, so that vertices in one place are a seam.
    fn texture(&self, v: u32) -> [f32; 2] {
        [v as f32 / 65536.0, 0.25]
    }

    /// Material, or label, of a triangle: bands across the sheet, and of strips.
    fn label(&self, triangle: [u32; 3]) -> u32 {
        let [x, _, z] = self.positions[triangle[0] as usize];
        if z < 2.5 { (x / 20.0) as u32 } else { 3 + triangle[0] / 1000 % 4 }
    }

    /// Positions are written once a place: only the texture is cut.
    fn write_obj(&self, path: &Path) {
        let mut text = "mtllib scan.mtl\n".to_owned();
        let mut known = HashMap::new();
        for p in self.positions.iter().map(|&p| place(p)) {
            if !known.contains_key(&p) {
                text += &format!("v {}\n", p.join(" "));
                known.insert(p, known.len() + 1);
            }
        }
        for v in 0..self.positions.len() as u32 {
            let [s, t] = self.texture(v);
            text += &format!("vt {s} {t}\n");
        }
        for &triangle in &self.triangles {
            let corner =
                |v: u32| format!(" {}/{}", known[&place(self.positions[v as usize])], v + 1);
            let [a, b, c] = triangle.map(corner);
            text += &format!("usemtl m{}\nf{a}{b}{c}\n", self.label(triangle));
        }
        std::fs::write(path, text).unwrap();
    }

    fn write_labels(&self, path: &Path) {
        let mut text = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {}\nproperty list uchar int vertex_indices\nproperty int label\nend_header\n",
            self.positions.len(),
            self.triangles.len()
        );
        self.positions.iter().for_each(|&p| text += &format!("{}\n", place(p).join(" ")));
        for &t in &self.triangles {
            text += &format!("3 {} {} {} {}\n", t[0], t[1], t[2], self.label(t));
        }
        std::fs::write(path, text).unwrap();
    }

    /// Without the components of fewer than `least` triangles.
    fn faces(&self, least: u64, with_texture: bool, label: impl Fn(u32) -> String) -> Vec<Face> {
        let sizes = self.sizes_of_each();
        let corner = |v: u32| {
            let texture = match with_texture {
                true => self.texture(v).map(|x| x.to_string()),
                false => Default::default(),
            };
            (place(self.positions[v as usize]), texture)
        };
        let stays = self.triangles.iter().zip(sizes).filter(|(_, n)| *n >= least);
        let mut faces: Vec<Face> =
            stays.map(|(&t, _)| face(t.map(corner), label(self.label(t)))).collect();
        faces.sort_unstable();
        faces
    }
}

fn floats<const N: usize>(words: &[&str]) -> [String; N] {
    std::array::from_fn(|k| (words[k].parse::<f32>().unwrap() + 0.0).to_string())
}

fn faces_of_obj(path: &Path) -> Vec<Face> {
    let (mut places, mut textures, mut faces) = (Vec::new(), Vec::new(), Vec::new());
    let mut material = String::new();
    for line in std::fs::read_to_string(path).unwrap().lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.first() {
            Some(&"v") => places.push(floats::<3>(&words[1..])),
            Some(&"vt") => textures.push(floats::<2>(&words[1..])),
            Some(&"usemtl") => material = words[1].to_owned(),
            Some(&"f") => {
                let corner = |k: usize| {
                    let mut numbers = words[k].split('/').map(|n| n.parse::<usize>().unwrap() - 1);
                    let (v, vt) = (numbers.next().unwrap(), numbers.next().unwrap());
                    (places[v].clone(), textures[vt].clone())
                };
                faces.push(face([1, 2, 3].map(corner), material.clone()));
            }
            _ => {}
        }
    }
    faces.sort_unstable();
    faces
}

fn faces_of_ply(path: &Path) -> Vec<Face> {
    let text = std::fs::read_to_string(path).unwrap();
    let (header, body) = text.split_once("end_header\n").unwrap();
    assert!(header.contains("property int label"), "{header}");
    let n = header.lines().find_map(|line| line.strip_prefix("element vertex ")).unwrap();
    let rows: Vec<Vec<&str>> = body.lines().map(|row| row.split_whitespace().collect()).collect();
    let (vertices, triangles) = rows.split_at(n.parse().unwrap());
    let corner =
        |v: &str| (floats::<3>(&vertices[v.parse::<usize>().unwrap()]), Default::default());
    let mut faces: Vec<Face> = triangles
        .iter()
        .map(|row| face([row[1], row[2], row[3]].map(corner), row[4].to_owned()))
        .collect();
    faces.sort_unstable();
    faces
}

/// What stays is the same to the last bit, with its texture or its labels; charts of a sheet, each below the
/// limit, stay together.
#[test]
fn texture_and_labels_stay_with_what_stays() {
    let out = &scratch();
    let scan = Scan::noisy(true);
    // A chart of the sheet has 840 triangles.
    let command = "--triangles 1M --cell-triangles 1k --min-component 1000 --report r.json";
    scan.write_obj(&out.join("in.obj"));
    expect(out, &format!("simplify in.obj out.obj {command}"), 0);
    assert_eq!(report(out)["components"]["found"], 151);
    assert!(report(out)["cells"].as_u64().unwrap() >= 6);
    let faces = faces_of_obj(&out.join("out.obj"));
    assert_eq!(faces.len(), 7200);
    assert!(faces == scan.faces(1000, true, |label| format!("m{label}")));

    let command = command.replace("1000", "100");
    scan.write_labels(&out.join("in.ply"));
    expect(out, &format!("simplify in.ply out.ply {command} --format ascii"), 0);
    let expected = scan.faces(100, false, |label| label.to_string());
    assert!(expected.len() > 7500, "strips are left");
    assert!(faces_of_ply(&out.join("out.ply")) == expected);
    assert_eq!(report(out)["face_properties"][0]["carried"], "region");
}

#[test]
fn threads_and_memory_do_not_show_and_a_ratio_means_the_whole_input() {
    let out = &scratch();
    let scan = Scan::noisy(true);
    scan.write(&out.join("in.ply"));
    let simplify = |name: &str, more: &str| {
        let common = "--ratio 20% --cell-triangles 1k --min-component 100 --report r.json";
        expect(out, &format!("simplify in.ply {name} {common} {more}"), 0);
        std::fs::read(out.join(name)).unwrap()
    };
    let one = simplify("a.ply", "--threads 1 --memory 4GiB");
    assert_eq!(one, simplify("b.ply", "--threads 2 --memory 64MiB"));
    assert_eq!(one, simplify("c.ply", "--threads 3 --memory 1GiB"));
    let report = report(out);
    assert_eq!(report["target"], (scan.triangles.len() as f64 * 0.2).round() as u64);
    assert_eq!(report["target_met"], true);
    assert!(report["settings"]["min_component"] == "100", "{report}");
}

#[test]
fn nothing_left_is_no_success() {
    let out = &scratch();
    Scan::noisy(false).write(&out.join("in.ply"));
    let command = "simplify in.ply out.ply --ratio 10% --cell-triangles 1k --min-component";
    let said = expect(out, &format!("{command} 1M"), 3);
    assert!(said.contains("all 151 components") && said.contains("7200"), "{said}");
    // A better value is not refused as other settings of that job.
    expect(out, &format!("{command} 300"), 0);
    let said = expect(out, "simplify in.ply b.ply --ratio 10% --min-component 2.5", 2);
    assert!(said.contains("size=2.5"), "{said}");
}

/// In memory and through cells; where no two vertices are in one place, what `components` counts.
#[test]
fn info_counts_the_same_sizes() {
    let out = &scratch();
    for is_cut in [false, true] {
        let scan = Scan::noisy(is_cut).shuffled();
        scan.write(&out.join("in.ply"));
        let all = scan.components();
        let small: Vec<u64> = all.iter().map(|c| c.0).filter(|&n| n < 100).collect();
        let cells = |memory: &str| {
            crate::common::printed(out, &format!("info --check --json in.ply --memory {memory}"))
        };
        for json in [cells("1GiB"), cells("300k")] {
            let sizes = &json["component_sizes"];
            assert_eq!(sizes["found"], all.len() as u64, "{json}");
            assert_eq!(sizes["below"][1]["components"], small.len() as u64);
            assert_eq!(sizes["below"][1]["triangles"], small.iter().sum::<u64>());
            let by_index = count(&json, "components");
            assert!(if is_cut { by_index > 151 } else { by_index == 151 }, "{json}");
        }
    }
}

/// A speck far away would make every bound unattainable; it goes, and what is left keeps the bound.
#[test]
fn a_bound_is_on_what_is_left() {
    let out = &scratch();
    let mut scan = Scan::default();
    scan.sheet(60, false);
    scan.strip(20, [500.0, 0.0, 0.0], 0.5);
    scan.write(&out.join("in.ply"));
    let command = "--max-error 0.2 --cell-triangles 1k --min-component 100 --report r.json";
    expect(out, &format!("simplify in.ply out.ply {command}"), 0);
    let report = report(out);
    assert_eq!(report["target_met"], true, "{report}");
    assert_eq!(report["components"]["dropped"], 1);
    let max = report["max_error"]["measured_max"].as_f64().unwrap();
    assert!(max > 0.0 && max <= 0.2, "{max}");
    let n = count(&check(out, "out.ply"), "triangles");
    assert!(n < 7200 / 2, "{n}");
    let left: Vec<_> = std::fs::read_dir(out).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), 3, "{left:?}");
    let command = command.replace("100", "1M");
    let said = expect(out, &format!("simplify in.ply b.ply {command}"), 3);
    assert!(said.contains("all 2 components"), "{said}");
    assert!(!out.join("b.ply.stonecut-job").exists());
}

fn config(folder: &Path) -> Config {
    Config {
        min_component: Some(MinComponent::Triangles(100)),
        checkpoint_every: std::time::Duration::ZERO,
        ..crate::common::config(folder, Target::Triangles(900))
    }
}

fn simplify(disk: &Disk, config: &Config) -> stonecut::Result<()> {
    let prepared = pipeline::prepare(config)?;
    pipeline::simplify_on(disk, prepared, &Progress::default()).map(|_| ())
}

/// Dies at every change of the disk, with what was not synced lost or not, then goes on.
#[test]
fn a_run_that_died_anywhere_ends_with_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let config = config(folder.path());
    let scan = Scan::noisy(false);
    scan.write(&config.input);
    let disk = Disk::for_crash_tests();
    simplify(&disk, &config).unwrap();
    let reference = std::fs::read(&config.output).unwrap();
    let changes = disk.changes();
    assert!(changes > 40, "{changes}");
    for k in (1..=changes).step_by(one_in(3)) {
        let loss = [PowerLoss::Nothing, PowerLoss::Unsynced][k as usize % 2];
        std::fs::remove_file(&config.output).unwrap();
        let disk = Disk::for_crash_tests();
        disk.freeze_at(k);
        assert!(simplify(&disk, &config).is_err(), "change {k}");
        disk.lose(loss).unwrap();
        let mut again = simplify(&Disk::for_crash_tests(), &config);
        // A child that another test has just forked holds the lock with us until it is another program.
        while again.as_ref().is_err_and(|error| error.exit_code() == 7) {
            std::thread::sleep(std::time::Duration::from_millis(5));
            again = simplify(&Disk::for_crash_tests(), &config);
        }
        if let Err(error) = again {
            // The job was complete but for its folder.
            let is_done = !config.job_folder.join("manifest.jsonl").exists();
            assert!(is_done && error.exit_code() == 2, "change {k}: {error}");
            let _ = std::fs::remove_dir_all(&config.job_folder);
        }
        assert!(std::fs::read(&config.output).unwrap() == reference, "change {k}, {loss:?}");
        assert!(!config.job_folder.exists());
    }
}
