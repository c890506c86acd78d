//! The promises of `synth`: topology of each kind, exact counts, same bytes however many threads, a
//! shuffled mesh is the same mesh.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

use std::collections::HashMap;
use stonecut::Mesh;
use stonecut::io::OutputFormat;
use stonecut::io::ply::MeshSource;
use stonecut::io::{OutputKind, StageOptions};
use stonecut::measure::load::load;
use stonecut::synth::{Cut, Kind, Rounding, Settings, Writing, mesh, write_ply, write_tiles};
use stonecut::system::progress::Progress;

const ALL: [Kind; 6] =
    [Kind::Terrain, Kind::Statue, Kind::Gyroid, Kind::Scans, Kind::Volume, Kind::Foam];

const KEEP: Writing = Writing { threads: 2, force: false, format: FORMAT };
const FORMAT: OutputFormat =
    OutputFormat { kind: None, encoding: None, coordinate: None, index: None };

fn settings(kind: Kind, n_triangles: u64) -> Settings {
    Settings { seed: 7, ..Settings::new(kind, n_triangles) }
}

/// What an edge's faces say about a mesh.
#[derive(Debug, Default, PartialEq)]
struct Topology {
    boundary_edges: usize,
    non_manifold_edges: usize,
    inconsistent_edges: usize,
    euler: i64,
    components: usize,
    unreferenced: usize,
    degenerate: usize,
}

fn topology(mesh: &Mesh) -> Topology {
    let mut edges: HashMap<(u32, u32), (u32, i32)> = HashMap::new();
    let mut parent: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    let mut used = vec![false; mesh.positions.len()];
    let mut out = Topology::default();
    for t in &mesh.triangles {
        if t[0] == t[1] || t[1] == t[2] || t[0] == t[2] {
            out.degenerate += 1;
        }
        for i in 0..3 {
            let (a, b) = (t[i], t[(i + 1) % 3]);
            used[a as usize] = true;
            let entry = edges.entry((a.min(b), a.max(b))).or_default();
            entry.0 += 1;
            entry.1 += if a < b { 1 } else { -1 };
            let (ra, rb) = (root(&mut parent, a), root(&mut parent, b));
            parent[ra as usize] = rb;
        }
    }
    for (faces, balance) in edges.values() {
        match faces {
            1 => out.boundary_edges += 1,
            2 => out.inconsistent_edges += usize::from(*balance != 0),
            _ => out.non_manifold_edges += 1,
        }
    }
    let n_used = used.iter().filter(|u| **u).count();
    out.unreferenced = used.len() - n_used;
    out.euler = n_used as i64 - edges.len() as i64 + mesh.triangles.len() as i64;
    out.components =
        (0..used.len() as u32).filter(|&v| used[v as usize] && root(&mut parent, v) == v).count();
    out
}

/// Six times the signed volume under the surface; positive when normals point outward.
fn volume6(mesh: &Mesh) -> f64 {
    (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t);
            a[0] * (b[1] * c[2] - b[2] * c[1])
                + a[1] * (b[2] * c[0] - b[0] * c[2])
                + a[2] * (b[0] * c[1] - b[1] * c[0])
        })
        .sum()
}

#[test]
fn a_statue_is_closed_of_genus_0_and_faces_outward() {
    for n in [1, 20, 80, 1000, 60_000] {
        let statue = mesh(&settings(Kind::Statue, n)).unwrap();
        assert!(statue.triangles.len() as u64 >= n);
        let expected = Topology { euler: 2, components: 1, ..Topology::default() };
        assert_eq!(topology(&statue), expected, "{n}");
        assert!(volume6(&statue) > 0.0);
    }
}

#[test]
fn a_terrain_is_a_disc_whose_boundary_is_its_border() {
    for n in [1, 2, 7, 1000, 54_321] {
        let terrain = mesh(&settings(Kind::Terrain, n)).unwrap();
        let topology = topology(&terrain);
        assert_eq!(topology.euler, 1, "{n}");
        assert_eq!((topology.components, topology.unreferenced), (1, 0));
        assert_eq!((topology.non_manifold_edges, topology.inconsistent_edges), (0, 0));
        assert!(topology.boundary_edges >= 4);
        let up = |t: usize| {
            let [a, b, c] = terrain.corners(t);
            (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0
        };
        assert!((0..terrain.triangles.len()).all(up), "a height field folds nowhere");
    }
}

#[test]
fn a_gyroid_is_a_closed_manifold_of_high_genus() {
    for n in [1, 5000, 200_000] {
        let gyroid = mesh(&settings(Kind::Gyroid, n)).unwrap();
        assert!(gyroid.triangles.len() as u64 >= n);
        let topology = topology(&gyroid);
        println!("{n}: {} {topology:?}", gyroid.triangles.len());
        assert_eq!(topology.boundary_edges + topology.non_manifold_edges, 0, "{n}");
        assert_eq!(topology.inconsistent_edges + topology.degenerate + topology.unreferenced, 0);
        assert!(volume6(&gyroid) > 0.0);
        assert!(n < 200_000 || topology.euler < -80, "{topology:?}");
        assert!(gyroid.triangles.len() as u64 <= (n + n / 20).max(10_000), "{n}");
    }
}

#[test]
fn scans_are_open_patches_with_holes_and_specks() {
    for n in [1, 5000, 200_000] {
        let scans = mesh(&settings(Kind::Scans, n)).unwrap();
        assert!(scans.triangles.len() as u64 >= n);
        let topology = topology(&scans);
        println!("{n}: {} {topology:?}", scans.triangles.len());
        assert_eq!(topology.non_manifold_edges + topology.inconsistent_edges, 0, "{n}");
        assert_eq!(topology.degenerate, 0);
        assert_eq!(scans.n_channels, 3);
        if n == 200_000 {
            assert!(topology.components > 30, "patches and many specks");
            assert!(topology.boundary_edges > 5000 && topology.unreferenced > 0);
            assert!(scans.triangles.len() < 210_000);
        }
        let outward = (0..scans.triangles.len()).filter(|&t| {
            let [a, b, c] = scans.corners(t);
            let [u, v] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1], p[2] - a[2]]);
            let normal =
                [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            normal[0] * a[0] + normal[1] * a[1] + normal[2] * a[2] > 0.0
        });
        assert!(outward.count() > scans.triangles.len() * 9 / 10, "normals look at the scanner");
    }
}

/// Triangles of the largest component.
fn largest(mesh: &Mesh) -> Mesh {
    let mut parent: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    for t in &mesh.triangles {
        for i in 1..3 {
            let (a, b) = (root(&mut parent, t[0]), root(&mut parent, t[i]));
            parent[a as usize] = b;
        }
    }
    let roots: Vec<u32> = mesh.triangles.iter().map(|t| root(&mut parent, t[0])).collect();
    let mut sizes = HashMap::new();
    roots.iter().for_each(|root| *sizes.entry(*root).or_insert(0) += 1);
    let (main, _) = sizes.into_iter().max_by_key(|(root, size)| (*size, *root)).unwrap();
    let kept = mesh.triangles.iter().zip(&roots).filter(|(_, root)| **root == main);
    Mesh { triangles: kept.map(|(t, _)| *t).collect(), ..mesh.clone() }
}

#[test]
fn a_volume_is_one_folded_surface_among_thousands_of_specks() {
    for n in [1, 5000, 200_000] {
        let volume = mesh(&settings(Kind::Volume, n)).unwrap();
        assert!(volume.triangles.len() as u64 >= n);
        assert!(volume.triangles.len() as u64 <= (n + n / 50).max(30_000), "{n}");
        let all = topology(&volume);
        assert_eq!(all.non_manifold_edges + all.inconsistent_edges, 0, "{n}: {all:?}");
        assert_eq!(all.degenerate + all.unreferenced, 0, "{n}: {all:?}");
        if n < 200_000 {
            continue;
        }
        let main = largest(&volume);
        let share = main.triangles.len() as f64 / volume.triangles.len() as f64;
        println!("{all:?} share {share} main {:?}", topology(&main));
        assert!((0.6..0.9).contains(&share), "{share}");
        assert!(all.components > 1200, "{all:?}");
        assert!(topology(&main).euler < -200, "hundreds of handles: {:?}", topology(&main));
        // Open where the volume ends and nowhere else.
        assert!(all.boundary_edges > 500, "{all:?}");
        let bounds = [0, 1, 2].map(|axis| {
            let range = volume.positions.iter().map(|p| p[axis]);
            [range.clone().fold(f64::MAX, f64::min), range.fold(f64::MIN, f64::max)]
        });
        let mut faces = HashMap::new();
        for t in &volume.triangles {
            for i in 0..3 {
                let (a, b) = (t[i], t[(i + 1) % 3]);
                *faces.entry((a.min(b), a.max(b))).or_insert(0) += 1;
            }
        }
        for ((a, b), _) in faces.into_iter().filter(|(_, n)| *n == 1) {
            let [a, b] = [a, b].map(|v| volume.positions[v as usize]);
            let on_a_face =
                |axis: usize| bounds[axis].iter().any(|x| a[axis] == *x && b[axis] == *x);
            assert!((0..3).any(on_a_face), "{a:?} {b:?}");
        }
    }
}

#[test]
fn terrain_and_statue_without_noise_are_smooth() {
    for kind in [Kind::Terrain, Kind::Statue] {
        let with = |noise| mesh(&Settings { noise, ..settings(kind, 20_000) }).unwrap();
        let [none, usual, twice] = [0.0, 1.0, 2.0].map(with);
        assert!(none.triangles == usual.triangles && none.positions != usual.positions);
        let off = |mesh: &Mesh| -> f64 {
            let pairs = mesh.positions.iter().zip(&none.positions);
            pairs.map(|(a, b)| (0..3).map(|k| (a[k] - b[k]).abs()).sum::<f64>()).sum()
        };
        let ratio = off(&twice) / off(&usual);
        assert!((1.9..2.1).contains(&ratio), "{ratio}");
    }
}

#[test]
fn noise_makes_the_specks_of_a_volume_and_whole_values_its_flat_triangles() {
    let volume = |noise, integer| {
        mesh(&Settings { noise, integer, ..settings(Kind::Volume, 200_000) }).unwrap()
    };
    let n_components = [0.0, 0.7, 1.0].map(|noise| topology(&volume(noise, false)).components);
    println!("{n_components:?}");
    assert!(n_components[0] < 200 && n_components[1] > 2 * n_components[0], "{n_components:?}");
    assert!(n_components[2] > 2 * n_components[1], "{n_components:?}");
    let flat = |mesh: &Mesh| {
        let coincide = |t: &usize| {
            let [a, b, c] = mesh.corners(*t);
            a == b || b == c || c == a
        };
        (0..mesh.triangles.len()).filter(coincide).count() as f64 / mesh.triangles.len() as f64
    };
    assert_eq!(flat(&volume(1.0, false)), 0.0);
    let whole = volume(1.0, true);
    println!("{}", flat(&whole));
    assert!((0.05..0.15).contains(&flat(&whole)), "{}", flat(&whole));
    let topology = topology(&whole);
    assert_eq!(topology.non_manifold_edges + topology.inconsistent_edges, 0, "{topology:?}");
    for refused in [
        Settings { noise: f64::NAN, ..settings(Kind::Volume, 1000) },
        Settings { noise: 0.5, ..settings(Kind::Gyroid, 1000) },
        Settings { integer: true, ..settings(Kind::Gyroid, 1000) },
        Settings { sea: true, ..settings(Kind::Statue, 1000) },
    ] {
        assert_eq!(mesh(&refused).unwrap_err().exit_code(), 2);
    }
}

#[test]
fn rooms_are_charts_that_join_where_they_touch() {
    for n in [1, 60_000] {
        let rooms = mesh(&Settings { uv: true, ..settings(Kind::Rooms, n) }).unwrap();
        assert!(rooms.triangles.len() as u64 >= n);
        assert!(
            rooms.triangles.len() as u64 <= (n + n / 50).max(1500),
            "{}",
            rooms.triangles.len()
        );
        let apart = topology(&rooms);
        assert_eq!(apart.non_manifold_edges + apart.inconsistent_edges, 0, "{n}: {apart:?}");
        assert_eq!(apart.degenerate + apart.unreferenced, 0, "{n}: {apart:?}");
        assert_eq!(rooms.n_channels, 5);
        if n < 60_000 {
            continue;
        }
        let mut places = HashMap::new();
        let joined = Mesh {
            triangles: (0..rooms.triangles.len())
                .map(|t| {
                    rooms.corners(t).map(|p| {
                        let next = places.len() as u32;
                        *places.entry(p.map(f64::to_bits)).or_insert(next)
                    })
                })
                .collect(),
            positions: vec![[0.0; 3]; places.len()],
            ..Mesh::default()
        };
        let joined = topology(&joined);
        println!("{} {apart:?} {joined:?}", rooms.triangles.len());
        assert!(apart.components > 300, "several hundred charts in 100,000 triangles");
        assert!(joined.components < apart.components / 2, "{joined:?}: walls, furniture, crumbs");
        assert!(joined.boundary_edges > 300, "doors and holes");
        assert_eq!(joined.inconsistent_edges, 0);
    }
}

#[test]
fn every_region_of_a_foam_is_closed_and_has_its_volume() {
    for n in [1, 5000, 100_000] {
        for shuffle in [false, true] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("foam.ply");
            let settings = Settings { shuffle, ..settings(Kind::Foam, n) };
            let counts = write_ply(&path, &settings, KEEP, &Progress::default()).unwrap();
            assert!((n..n + n / 4 + 200).contains(&counts.n_triangles), "{n}: {counts:?}");
            let foam = mesh(&settings).unwrap();
            let stage = StageOptions::new(folder.path().to_path_buf());
            let source = MeshSource::open_staged(path, &stage).unwrap();
            let mut labels: Vec<[u32; 2]> = Vec::new();
            let mut add = |values: &[u8]| {
                let value = |at: usize| u32::from_le_bytes(values[at..at + 4].try_into().unwrap());
                labels.push([value(0), value(4)]);
            };
            source
                .each_full_face(|_, face| {
                    add(&face.values);
                    Ok(())
                })
                .unwrap();
            assert_eq!(labels.len(), foam.triangles.len());
            let whole = topology(&foam);
            assert_eq!((whole.boundary_edges, whole.inconsistent_edges), (0, 0), "{whole:?}");
            assert_eq!((whole.degenerate, whole.unreferenced, whole.components), (0, 0, 1));
            // Each wall once, its faces turned away from the outside.
            let mut faces: Vec<[u32; 3]> = foam.triangles.clone();
            faces.iter_mut().for_each(|face| face.sort_unstable());
            faces.sort_unstable();
            assert!(faces.windows(2).all(|pair| pair[0] != pair[1]));
            assert!(labels.iter().all(|[left, right]| *left != 0 && left != right));
            let n_regions = labels.iter().flatten().copied().max().unwrap();
            let mut three = 0;
            for region in 0..=n_regions {
                let mut own = Mesh { triangles: Vec::new(), ..foam.clone() };
                for (&[a, b, c], [left, right]) in foam.triangles.iter().zip(&labels) {
                    own.triangles.extend((*left == region).then_some([a, b, c]));
                    own.triangles.extend((*right == region).then_some([a, c, b]));
                }
                let found = topology(&own);
                let faults =
                    found.boundary_edges + found.non_manifold_edges + found.inconsistent_edges;
                assert_eq!((faults, found.euler, found.components), (0, 2, 1), "region {region}");
                let (volume, exact) = (volume6(&own) / 6.0, 4.0);
                let exact = if region == 0 { -exact * f64::from(n_regions) } else { exact };
                let tolerance = if n < 5000 { 0.3 } else { 0.02 };
                assert!((volume / exact - 1.0).abs() < tolerance, "region {region}: {volume}");
                three += own.triangles.len();
            }
            assert_eq!(three, 2 * foam.triangles.len());
            assert!(whole.non_manifold_edges > 5);
        }
    }
}

/// Width and pixels of a PNG.
fn decode(path: &std::path::Path) -> (usize, Vec<u8>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!(info.width, info.height);
    (info.width as usize, pixels)
}

#[test]
fn images_of_rooms_show_what_vertices_show_in_both_formats() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let settings = Settings { pages: Some(3), ..settings(Kind::Rooms, 20_000) };
    let wanted = mesh(&settings).unwrap();
    for name in ["a.obj", "b.ply", "c.stl", "d.glb"] {
        let counts = write_ply(&path(name), &settings, KEEP, &Progress::default()).unwrap();
        assert_eq!(counts.n_triangles as usize, wanted.triangles.len());
        let n_images = if name < "c" { 3 } else { 0 };
        assert_eq!(counts.n_images, n_images, "{name}");
    }
    assert!(!path("c_000.png").exists() && !path("d_000.png").exists());
    let source = MeshSource::open(&path("b.ply")).unwrap();
    let read = load(&source, 1, &Progress::default()).unwrap().mesh;
    assert!(as_set(&read) == as_set(&wanted), "PLY");
    let header = std::fs::read(path("b.ply")).unwrap();
    let header = String::from_utf8_lossy(&header[..900]).into_owned();
    assert!(header.contains("comment TextureFile b_002.png"), "{header}");
    assert!(header.contains("list uchar float texcoord"), "{header}");
    let library = std::fs::read_to_string(path("a.mtl")).unwrap();
    let images: Vec<_> = (0..3)
        .map(|n| {
            assert!(library.contains(&format!("newmtl page_{n:03}\n")));
            assert!(library.contains(&format!("map_Kd a_{n:03}.png\n")));
            let bytes =
                ["a", "b"].map(|s| std::fs::read(path(&format!("{s}_{n:03}.png"))).unwrap());
            assert!(bytes[0] == bytes[1], "both formats have the same images");
            decode(&path(&format!("a_{n:03}.png")))
        })
        .collect();

    let obj = std::fs::read_to_string(path("a.obj")).unwrap();
    let numbers = |line: &str| -> Vec<f64> {
        line.split_whitespace().skip(1).map(|word| word.parse().unwrap()).collect()
    };
    let (mut vertices, mut texture, mut image) = (Vec::new(), Vec::new(), usize::MAX);
    let (mut near, mut n_corners) = (0, 0);
    let mut triangles = Vec::new();
    for line in obj.lines() {
        match line.split_whitespace().next() {
            Some("v") => vertices.push(numbers(line)),
            Some("vt") => texture.push(numbers(line)),
            Some("usemtl") => image = line.rsplit('_').next().unwrap().parse().unwrap(),
            Some("f") => {
                let (width, pixels) = &images[image];
                let mut ids = Vec::new();
                let corners = line.split_whitespace().skip(1).map(|corner| {
                    let (v, vt) = corner.split_once('/').unwrap();
                    let [v, vt] = [v, vt].map(|n| n.parse::<usize>().unwrap() - 1);
                    ids.push(v as u32);
                    let uv = &texture[vt];
                    assert!(uv.iter().all(|x| (0.0..=1.0).contains(x)), "{line}");
                    let at = [uv[0], 1.0 - uv[1]].map(|x| x * *width as f64);
                    let pixel = at.map(|x| (x as usize).min(width - 1));
                    let to = 3 * (pixel[1] * width + pixel[0]);
                    let seen =
                        (0..3).map(|n| f64::from(pixels[to + n]) / 255.0 - vertices[v][3 + n]);
                    near += usize::from(seen.fold(0.0, |most: f64, x| most.max(x.abs())) < 0.1);
                    n_corners += 1;
                    at.map(|x| (x / 72.0) as usize)
                });
                let slots: Vec<_> = corners.collect();
                assert!(slots.iter().all(|slot| *slot == slots[0]), "a triangle within one slot");
                triangles.push([ids[0], ids[1], ids[2]]);
            }
            _ => {}
        }
    }
    let positions = vertices.iter().map(|v| [0, 1, 2].map(|n| f64::from(v[n] as f32))).collect();
    let read = Mesh { positions, triangles, ..Mesh::default() };
    assert!(as_set(&read) == as_set(&wanted), "OBJ");
    assert!(near > n_corners / 2, "{near} of {n_corners} corners have their vertex's colour");

    // An image in the way is kept, and nothing else appears.
    std::fs::write(path("e_001.png"), b"precious").unwrap();
    let error = write_ply(&path("e.obj"), &settings, KEEP, &Progress::default()).unwrap_err();
    assert_eq!(error.exit_code(), 2, "{error}");
    assert!(!path("e_000.png").exists() && !path("e.mtl").exists());
    let forced = Writing { force: true, ..KEEP };
    let error = write_ply(&path("e.obj"), &settings, forced, &Progress::default()).unwrap_err();
    assert_eq!(error.exit_code(), 2, "{error}");
    assert_eq!(std::fs::read(path("e_001.png")).unwrap(), b"precious");
    // Earlier images and libraries of its own may be replaced.
    let error = write_ply(&path("a.obj"), &settings, KEEP, &Progress::default()).unwrap_err();
    assert_eq!(error.exit_code(), 2, "{error}");
    write_ply(&path("a.obj"), &settings, forced, &Progress::default()).unwrap();
    for refused in [
        Settings { pages: Some(0), ..settings.clone() },
        Settings { pages: Some(1), ..Settings::new(Kind::Statue, 100) },
    ] {
        assert_eq!(mesh(&refused).unwrap_err().exit_code(), 2);
    }
}

#[test]
fn terrain_counts_are_nearly_those_asked_for() {
    for n in [1000, 12_345, 100_000, 1_000_003] {
        let terrain = mesh(&settings(Kind::Terrain, n)).unwrap();
        let got = terrain.triangles.len() as u64;
        assert!((n..n + 2 + n / 100).contains(&got), "{n} asked, {got} made");
    }
}

#[test]
fn the_bytes_do_not_depend_on_threads() {
    let folder = tempfile::tempdir().unwrap();
    for kind in ALL {
        for shuffle in [false, true] {
            // The images of rooms take their time; what is large is the same many times over.
            let n = if kind == Kind::Rooms { 20_000 } else { 300_000 };
            let settings = Settings { shuffle, color: true, uv: true, ..settings(kind, n) };
            let bytes = [1, 2, 3].map(|threads| {
                let path = folder.path().join(format!("{threads}.ply"));
                let writing = Writing { threads, force: true, ..KEEP };
                write_ply(&path, &settings, writing, &Progress::default()).unwrap();
                std::fs::read(path).unwrap()
            });
            assert!(bytes[0] == bytes[1] && bytes[0] == bytes[2], "{kind:?}");
        }
    }
}

/// Every triangle as its three corner positions (bits), turned so that the least comes first, sorted.
fn as_set(mesh: &Mesh) -> Vec<[[u64; 3]; 3]> {
    let mut all: Vec<_> = (0..mesh.triangles.len())
        .map(|t| {
            let mut corners = mesh.corners(t).map(|p| p.map(f64::to_bits));
            let least = (0..3).min_by_key(|&i| corners[i]).expect("three corners");
            corners.rotate_left(least);
            corners
        })
        .collect();
    all.sort_unstable();
    all
}

#[test]
fn shuffling_changes_the_order_and_nothing_else() {
    for kind in ALL {
        let plain = mesh(&settings(kind, 20_000)).unwrap();
        let shuffled = mesh(&Settings { shuffle: true, ..settings(kind, 20_000) }).unwrap();
        assert_ne!(plain.positions, shuffled.positions);
        let far = shuffled.triangles.windows(2).filter(|t| t[0][0].abs_diff(t[1][0]) > 1000);
        assert!(far.count() > shuffled.triangles.len() / 2, "neighbouring rows are strangers");
        let turned = plain.triangles.len();
        assert_eq!(turned, shuffled.triangles.len());
        assert!(as_set(&plain) == as_set(&shuffled), "{kind:?}");
    }
}

#[test]
fn another_seed_is_another_mesh_and_the_same_seed_the_same() {
    for kind in ALL {
        let one = mesh(&settings(kind, 2000)).unwrap();
        assert_eq!(one, mesh(&settings(kind, 2000)).unwrap());
        let other = mesh(&Settings { seed: 8, ..settings(kind, 2000) }).unwrap();
        assert_ne!(one.positions, other.positions);
    }
}

#[test]
fn every_format_holds_the_same_mesh() {
    let folder = tempfile::tempdir().unwrap();
    for shuffle in [false, true] {
        let settings = Settings { shuffle, color: true, ..settings(Kind::Statue, 5000) };
        let wanted = mesh(&settings).unwrap();
        for (format, header) in [
            ("ascii", "format ascii"),
            ("binary_big_endian", "format binary_big_endian"),
            ("double,uint", "property double x"),
        ] {
            let path = folder.path().join("out.ply");
            let writing = Writing { force: true, format: format.parse().unwrap(), ..KEEP };
            write_ply(&path, &settings, writing, &Progress::default()).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            assert!(String::from_utf8_lossy(&bytes[..400]).contains(header), "{format}");
            let source = MeshSource::open(&path).unwrap();
            let read = load(&source, 1, &Progress::default()).unwrap().mesh;
            assert!(as_set(&read) == as_set(&wanted), "{format}");
            assert_eq!(read.channels, wanted.channels, "{format}");
        }
        for name in ["out.stl", "out.obj", "out.glb"] {
            write_ply(
                &folder.path().join(name),
                &settings,
                Writing { force: true, ..KEEP },
                &Progress::default(),
            )
            .unwrap();
        }
    }
}

#[test]
fn an_existing_file_is_kept_and_a_missing_folder_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("there.ply");
    std::fs::write(&path, b"precious").unwrap();
    let settings = settings(Kind::Terrain, 100);
    let error = write_ply(&path, &settings, KEEP, &Progress::default()).unwrap_err();
    assert_eq!(error.exit_code(), 2);
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    write_ply(&path, &settings, Writing { force: true, ..KEEP }, &Progress::default()).unwrap();
    assert!(std::fs::read(&path).unwrap().starts_with(b"ply\n"));

    let nowhere = folder.path().join("missing").join("a.ply");
    let error = write_ply(&nowhere, &settings, KEEP, &Progress::default()).unwrap_err();
    assert_eq!(error.exit_code(), 1);
    assert!(error.to_string().contains("missing"), "{error}");
    let stopped = Progress::default();
    stopped.request_stop(2);
    let path = folder.path().join("stopped.ply");
    assert_eq!(write_ply(&path, &settings, KEEP, &stopped).unwrap_err().exit_code(), 130);
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(left.len(), 1, "nothing half-made is left: {left:?}");
}

const PLAIN_CUT: Cut = Cut { n_tiles: 12, rounding: None, t_junctions: false, overlap: 0.0 };

/// Cuts a mesh into tiles of a kind; gives all files in order of their names.
fn tiles(
    folder: &std::path::Path,
    settings: &Settings,
    cut: Cut,
    (kind, threads): (OutputKind, usize),
) -> (stonecut::synth::TileCounts, Vec<std::path::PathBuf>) {
    let format = OutputFormat { kind: Some(kind), ..FORMAT };
    let writing = Writing { threads, force: false, format };
    let counts = write_tiles(folder, settings, &cut, writing, &Progress::default()).unwrap();
    let mut files: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    (counts, files)
}

/// All files as one mesh, copies of vertices at the same place joined.
fn joined(files: &[std::path::PathBuf]) -> Mesh {
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
