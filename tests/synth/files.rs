//! Files of synthetic scans: every format, images, the same bytes however many threads, a shuffled mesh is the same mesh.

use super::{ALL, KEEP, settings, write_ply};
use std::path::Path;
use stonecut::Mesh;
use stonecut::io::ply::MeshSource;
use stonecut::measure::load::load;
use stonecut::synth::{self, Kind, Settings, Writing, mesh};
use stonecut::system::progress::Progress;

/// Width and pixels of a PNG.
fn decode(path: &Path) -> (usize, Vec<u8>) {
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
        let counts = write_ply(&path(name), &settings, KEEP).unwrap();
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
    let error = write_ply(&path("e.obj"), &settings, KEEP).unwrap_err();
    assert_eq!(error.exit_code(), 2, "{error}");
    assert!(!path("e_000.png").exists() && !path("e.mtl").exists());
    let forced = Writing { force: true, ..KEEP };
    let error = write_ply(&path("e.obj"), &settings, forced).unwrap_err();
    assert_eq!(error.exit_code(), 2, "{error}");
    assert_eq!(std::fs::read(path("e_001.png")).unwrap(), b"precious");
    // Earlier images and libraries of its own may be replaced.
    let error = write_ply(&path("a.obj"), &settings, KEEP).unwrap_err();
    assert_eq!(error.exit_code(), 2, "{error}");
    write_ply(&path("a.obj"), &settings, forced).unwrap();
    for refused in [
        Settings { pages: Some(0), ..settings.clone() },
        Settings { pages: Some(1), ..Settings::new(Kind::Statue, 100) },
    ] {
        assert_eq!(mesh(&refused).unwrap_err().exit_code(), 2);
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
                write_ply(&path, &settings, writing).unwrap();
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
            write_ply(&path, &settings, writing).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            assert!(String::from_utf8_lossy(&bytes[..400]).contains(header), "{format}");
            let source = MeshSource::open(&path).unwrap();
            let read = load(&source, 1, &Progress::default()).unwrap().mesh;
            assert!(as_set(&read) == as_set(&wanted), "{format}");
            assert_eq!(read.channels, wanted.channels, "{format}");
        }
        for name in ["out.stl", "out.obj", "out.glb"] {
            write_ply(&folder.path().join(name), &settings, Writing { force: true, ..KEEP })
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
    let error = write_ply(&path, &settings, KEEP).unwrap_err();
    assert_eq!(error.exit_code(), 2);
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    write_ply(&path, &settings, Writing { force: true, ..KEEP }).unwrap();
    assert!(std::fs::read(&path).unwrap().starts_with(b"ply\n"));

    let nowhere = folder.path().join("missing").join("a.ply");
    let error = write_ply(&nowhere, &settings, KEEP).unwrap_err();
    assert_eq!(error.exit_code(), 1);
    assert!(error.to_string().contains("missing"), "{error}");
    let stopped = Progress::default();
    stopped.request_stop(2);
    let path = folder.path().join("stopped.ply");
    assert_eq!(synth::write_ply(&path, &settings, KEEP, &stopped).unwrap_err().exit_code(), 130);
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(left.len(), 1, "nothing half-made is left: {left:?}");
}
