//! The promises of `synth`: topology of each kind, exact counts; `files`: formats, images and threads; `tiles`: many files.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

mod files;
mod tiles;

use std::collections::HashMap;
use std::path::Path;
use stonecut::Mesh;
use stonecut::io::ply::MeshSource;
use stonecut::io::{OutputFormat, StageOptions};
use stonecut::mesh::union_find::Union;
use stonecut::synth::{self, Kind, Settings, Writing, mesh};
use stonecut::system::progress::Progress;

const ALL: [Kind; 6] =
    [Kind::Terrain, Kind::Statue, Kind::Gyroid, Kind::Scans, Kind::Volume, Kind::Foam];

const KEEP: Writing = Writing { threads: 2, force: false, format: FORMAT };
const FORMAT: OutputFormat =
    OutputFormat { kind: None, encoding: None, coordinate: None, index: None };

fn settings(kind: Kind, n_triangles: u64) -> Settings {
    Settings { seed: 7, ..Settings::new(kind, n_triangles) }
}

/// Writes a mesh as a file.
fn write_ply(
    path: &Path,
    settings: &Settings,
    writing: Writing,
) -> stonecut::Result<synth::Counts> {
    synth::write_ply(path, settings, writing, &Progress::default())
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
    let mut union = Union::new(mesh.positions.len());
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
            union.join(a, b);
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
    let roots = union.into_roots();
    out.components = (0..used.len()).filter(|&v| used[v] && roots[v] as usize == v).count();
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
    let mut union = Union::new(mesh.positions.len());
    for t in &mesh.triangles {
        union.join(t[0], t[1]);
        union.join(t[0], t[2]);
    }
    let of_vertices = union.into_roots();
    let roots = mesh.triangles.iter().map(|t| of_vertices[t[0] as usize]);
    let roots: Vec<u32> = roots.collect();
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
            let counts = write_ply(&path, &settings, KEEP).unwrap();
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

#[test]
fn terrain_counts_are_nearly_those_asked_for() {
    for n in [1000, 12_345, 100_000, 1_000_003] {
        let terrain = mesh(&settings(Kind::Terrain, n)).unwrap();
        let got = terrain.triangles.len() as u64;
        assert!((n..n + 2 + n / 100).contains(&got), "{n} asked, {got} made");
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
