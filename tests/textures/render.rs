//! The promises of `render`: what is in front is seen, streams give the picture of the mesh in memory,
//! nothing depends on threads or memory, and no input makes it panic.

use stonecut::Mesh;
use stonecut::io::OutputFormat;
use stonecut::io::ply::MeshSource;
use stonecut::render::{
    Coloring, Direction, Letters, Lighting, Picture, Resources, Scale, Sphere, View, aim_mesh,
    render_mesh, render_source, top_of,
};
use stonecut::synth::{Kind, Settings, Writing, mesh, write_ply};
use stonecut::system::progress::Progress;

const BOTH: Resources = Resources { memory_bytes: 4 << 30, threads: 2 };

fn settings(kind: Kind, n_triangles: u64) -> Settings {
    Settings { seed: 3, color: true, ..Settings::new(kind, n_triangles) }
}

fn small(view: View) -> View {
    View { width: 120, height: 90, ..view }
}

fn picture(mesh: &Mesh, view: &View) -> Picture {
    render_mesh(mesh, view, 2, &Progress::default()).expect("a picture of a fair size")
}

fn pixel(picture: &Picture, x: u32, y: u32) -> [u8; 3] {
    let at = (y * picture.width + x) as usize * 3;
    [picture.rgb[at], picture.rgb[at + 1], picture.rgb[at + 2]]
}

/// Two squares facing the viewer at +z, each of one colour:
///
/// ```text
///   back (z = 0): 4 x 4, blue        front (z = 1): 2 x 2 in its middle, red
/// ```
fn squares() -> Mesh {
    let mut mesh = Mesh { n_channels: 3, ..Mesh::default() };
    for (half, z, color) in [(2.0, 0.0, [0.0, 0.0, 255.0]), (1.0, 1.0, [255.0, 0.0, 0.0])] {
        let first = mesh.positions.len() as u32;
        for (x, y) in [(-half, -half), (half, -half), (half, half), (-half, half)] {
            mesh.positions.push([x, y, z]);
            mesh.channels.extend(color);
        }
        mesh.triangles.push([first, first + 1, first + 2]);
        mesh.triangles.push([first, first + 2, first + 3]);
    }
    mesh
}

#[test]
fn what_is_in_front_is_seen_whatever_the_order_of_faces() {
    let mut mesh = squares();
    let direction = Direction::From([0.0, 0.0, 1.0]);
    let view =
        small(View { direction, coloring: Coloring::Vertex { channel: 0 }, ..View::default() });
    for _ in 0..2 {
        let picture = picture(&mesh, &view);
        let [middle, side, corner] =
            [(60, 45), (60, 10), (2, 2)].map(|(x, y)| pixel(&picture, x, y));
        assert!(middle[0] > 120 && middle[2] < 90, "red in the middle: {middle:?}");
        assert!(side[2] > 120 && side[0] < 90, "blue around it: {side:?}");
        assert!(corner.iter().all(|c| *c > 200), "background beyond: {corner:?}");
        mesh.triangles.reverse();
    }
}

#[test]
fn a_mesh_fills_the_picture_and_stays_inside() {
    let statue = mesh(&settings(Kind::Statue, 5000)).unwrap();
    for direction in
        [Direction::Auto, Direction::From([1.0, 0.2, 0.1]), Direction::From([0.0, 0.0, 1.0])]
    {
        let view = small(View { direction, ..View::default() });
        let empty = picture(&Mesh::default(), &view);
        let picture = picture(&statue, &view);
        let differs = |x, y| pixel(&picture, x, y) != pixel(&empty, x, y);
        let rows = (0..90).filter(|&y| (0..120).any(|x| differs(x, y))).count();
        let columns = (0..120).filter(|&x| (0..90).any(|y| differs(x, y))).count();
        assert!(rows >= 80 || columns >= 108, "{rows} rows, {columns} columns");
        let border = (0..120).any(|x| differs(x, 0) || differs(x, 89))
            || (0..90).any(|y| differs(0, y) || differs(119, y));
        assert!(!border, "nothing is cut off");
    }
}

/// The picture itself of 120 x 90 pixels takes 28.2 MiB.
const LEAST: u64 = 29 << 20;

#[test]
fn a_stream_gives_the_picture_of_the_mesh_in_any_memory_and_threads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("statue.ply");
    let settings = settings(Kind::Statue, 300_000);
    let writing = Writing { threads: 2, force: false, format: OutputFormat::default() };
    write_ply(&path, &settings, writing, &Progress::default()).unwrap();
    let source = MeshSource::open(&path).unwrap();
    let view = small(View { edges: true, smooth: false, ..View::default() });
    let whole = picture(&mesh(&settings).unwrap(), &view);
    for (memory_bytes, threads) in [(4 << 30, 1), (4 << 30, 3), (LEAST, 2)] {
        let resources = Resources { memory_bytes, threads };
        let streamed = render_source(&source, &view, resources, &Progress::default()).unwrap();
        assert!(streamed == whole, "{resources:?}");
    }
    let colored = View { coloring: Coloring::Vertex { channel: 0 }, ..view };
    let streamed = render_source(&source, &colored, BOTH, &Progress::default()).unwrap();
    assert!(streamed == picture(&mesh(&settings).unwrap(), &colored));
    assert!(streamed != whole, "colours are seen");
}

#[test]
fn vertices_that_do_not_fit_are_read_again_and_a_shuffled_mesh_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let view = small(View::default());
    let nothing = Resources { memory_bytes: LEAST, threads: 2 };
    for shuffle in [false, true] {
        let path = folder.path().join("terrain.ply");
        // 600,000 vertices are ten blocks; eight are held.
        let settings = Settings { shuffle, ..settings(Kind::Terrain, 1_200_000) };
        let writing = Writing { threads: 2, force: true, format: OutputFormat::default() };
        write_ply(&path, &settings, writing, &Progress::default()).unwrap();
        let source = MeshSource::open(&path).unwrap();
        let outcome = render_source(&source, &view, nothing, &Progress::default());
        if shuffle {
            assert_eq!(outcome.unwrap_err().exit_code(), 6);
        } else {
            // Vertex normals need all vertices at hand, so the comparison does without them.
            let flat = View { smooth: false, ..view.clone() };
            let whole = render_source(&source, &flat, BOTH, &Progress::default()).unwrap();
            assert!(outcome.unwrap() == whole);
        }
    }
}

#[test]
fn close_ups_quadrics_and_a_shared_aim_work() {
    let statue = mesh(&settings(Kind::Statue, 5000)).unwrap();
    let view = small(View::default());
    let whole = picture(&statue, &view);
    let centre = statue.positions[1234];
    let zoom = Some(Sphere { centre, radius: 100.0 });
    let close = picture(&statue, &View { zoom, edges: true, ..view.clone() });
    assert!(close != whole);
    let background = pixel(&picture(&Mesh::default(), &view), 60, 45);
    assert_ne!(pixel(&close, 60, 45), background, "the surface is looked at");
    let quadrics = picture(&statue, &View { n_quadrics: 30, ..view.clone() });
    let changed = quadrics.rgb.iter().zip(&whole.rgb).filter(|(a, b)| a != b).count();
    assert!(changed > 100 && changed < whole.rgb.len() / 2, "{changed} bytes");
    let coarse = mesh(&settings(Kind::Statue, 500)).unwrap();
    let aim = aim_mesh(&statue, &view, 2, &Progress::default()).unwrap();
    let aimed = View { aim: Some(aim), ..view };
    assert!(picture(&statue, &aimed) == whole);
    assert!(picture(&coarse, &aimed) != whole);
}

#[test]
fn odd_meshes_and_views_give_pictures_or_errors_but_no_panics() {
    let flat = Mesh::new(vec![[1e9, 1e9, 1e9]; 3], vec![[0, 1, 2]]);
    let line = Mesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], vec![[0, 1, 2]]);
    let huge = Mesh::new(
        vec![[-1e30, 0.0, 0.0], [1e30, 0.0, 0.0], [0.0, 1e30, 0.0]],
        vec![[0, 1, 2], [0, 0, 1]],
    );
    let spike = Mesh::new(
        vec![[0.0; 3], [1e-30, 0.0, 0.0], [0.0, 1e-30, 1e6], [1.0, 1.0, 1.0]],
        vec![[0, 1, 2], [0, 1, 3]],
    );
    for mesh in [Mesh::default(), flat, line, huge, spike, squares()] {
        for direction in
            [Direction::Auto, Direction::From([0.0; 3]), Direction::From([0.0, 0.0, -1.0])]
        {
            for radius in [None, Some(0.0), Some(1e-20), Some(1e20)] {
                let zoom = radius.map(|radius| Sphere { centre: [0.0; 3], radius });
                let view =
                    View { direction, zoom, edges: true, n_quadrics: 3, ..small(View::default()) };
                assert_eq!(picture(&mesh, &view).rgb.len(), 120 * 90 * 3);
            }
        }
    }
    for (width, height) in [(0, 10), (10, 0), (1 << 20, 10)] {
        let view = View { width, height, ..View::default() };
        let error = render_mesh(&squares(), &view, 1, &Progress::default()).unwrap_err();
        assert_eq!(error.exit_code(), 2);
    }
    let stopped = Progress::default();
    stopped.request_stop(15);
    let view = small(View::default());
    let error = render_mesh(&squares(), &view, 1, &stopped).unwrap_err();
    assert_eq!(error.exit_code(), 143);
}

#[test]
fn pictures_become_png_files_and_stand_side_by_side() {
    let (red, blue) = (Picture::new(30, 20, [255, 0, 0]), Picture::new(40, 10, [0, 0, 255]));
    let both = Picture::side_by_side(&[(&red, "a"), (&blue, "b")]);
    assert_eq!((both.width, both.height), (72, 60));
    assert_eq!(pixel(&both, 15, 50), [255, 0, 0]);
    assert_eq!(pixel(&both, 50, 50), [0, 0, 255]);
    let caption = both.rgb[..30 * 72 * 3].iter().filter(|byte| **byte < 128).count();
    assert!(caption > 20, "letters are dark on white");
    let bare = Picture::side_by_side(&[(&red, ""), (&blue, "")]);
    assert_eq!(bare.height, 20);
    let mut text = Picture::new(10, 5, [255; 3]);
    text.write_text("\u{4e00}\u{fc} far too long", (3, 2), Letters::Small, [0; 3]);

    let reader =
        png::Decoder::new(std::io::Cursor::new(both.to_png().unwrap())).read_info().unwrap();
    let info = reader.info();
    assert_eq!((info.width, info.height), (72, 60));
    assert!(Picture::new(0, 0, [0; 3]).to_png().is_err());
}

/// A square in binary PLY whose vertices have one colour, each component of its type.
fn painted_square(path: &std::path::Path, components: [(&str, &[u8]); 3]) {
    let [r, g, b] = components.map(|(scalar, _)| scalar);
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
         property float z\nproperty {r} red\nproperty {g} green\nproperty {b} blue\nelement face 2\n\
         property list uchar int vertex_indices\nend_header\n"
    );
    let mut bytes = header.into_bytes();
    for [x, y] in [[0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
        bytes.extend([x, y, 0.0].map(f32::to_le_bytes).as_flattened());
        components.iter().for_each(|(_, value)| bytes.extend(*value));
    }
    for corners in [[0i32, 1, 2], [0, 2, 3]] {
        bytes.push(3);
        bytes.extend(corners.map(i32::to_le_bytes).as_flattened());
    }
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn colours_of_vertices_are_read_by_the_type_of_each_component() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("square.ply");
    let direction = Direction::From([0.0, 0.0, 1.0]);
    let coloring = Coloring::Vertex { channel: 0 };
    let view = small(View { direction, coloring, lighting: Lighting::Unlit, ..View::default() });
    let shown = |components: [(&str, &[u8]); 3]| {
        painted_square(&path, components);
        let source = MeshSource::open(&path).unwrap();
        let seen = render_source(&source, &view, BOTH, &Progress::default()).unwrap();
        pixel(&seen, 60, 45)
    };
    let bytes = shown([("uchar", &[200]), ("uchar", &[128]), ("uchar", &[30])]);
    // A share of 1 is between two bytes, so that it is rounded.
    let [red, blue] = [199.6f32, 29.7].map(|value| (value / 255.0).to_le_bytes());
    let double = (128.0f64 / 255.0).to_le_bytes();
    let short = (128 * 257u16).to_le_bytes();
    for components in [
        [("float", &red[..]), ("uchar", &[128]), ("uchar", &[30])],
        [("float", &red), ("ushort", &short), ("float", &blue)],
        [("uchar", &[200]), ("double", &double), ("float", &blue)],
        [("ushort", &(200 * 257u16).to_le_bytes()), ("double", &double), ("uchar", &[30])],
    ] {
        let types = components.map(|(scalar, _)| scalar);
        assert_eq!(shown(components), bytes, "{types:?}");
    }
    let double = |value: f64| (value / 255.0).to_le_bytes();
    let [r, g, b] = [200.0, 128.0, 30.0].map(double);
    assert_eq!(shown([("double", &r), ("double", &g), ("double", &b)]), bytes);
}

/// A square whose left side carries 0 and whose right side carries `right`.
fn scalar_square(path: &std::path::Path, right: &str) {
    let text = format!(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         property float error\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n\
         0 0 0 0\n1 0 0 {right}\n1 1 0 {right}\n0 1 0 0\n3 0 1 2\n3 0 2 3\n"
    );
    std::fs::write(path, text).unwrap();
}

#[test]
fn a_number_of_vertices_paints_with_a_legend() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field.ply");
    scalar_square(&path, "0.123");
    let source = MeshSource::open(&path).unwrap();
    let progress = Progress::default();
    let top = top_of(&source, "error", &progress).unwrap();
    assert_eq!(top, 0.13);
    let missing = top_of(&source, "quality", &progress).unwrap_err().to_string();
    assert!(missing.contains("no property 'quality'") && missing.contains("error"), "{missing}");
    let direction = Direction::From([0.0, 0.0, 1.0]);
    let plain = View { width: 300, height: 240, direction, ..View::default() };
    let scale = Some(Scale { property: "error".to_owned(), top });
    let painted = View { scale, ..plain.clone() };
    let draw = |view: &View| render_source(&source, view, BOTH, &progress).unwrap();
    let (clay, field) = (draw(&plain), draw(&painted));
    // Viridis: dark violet where there is no error, yellow where there is most; clay is grey.
    let (left, right) = (pixel(&field, 100, 120), pixel(&field, 200, 120));
    assert!(left[2] > left[1] && right[1] > right[2], "{left:?} {right:?}");
    assert!(i32::from(right[1]) > i32::from(left[1]) + 60, "{left:?} {right:?}");
    // The legend stands where clay has nothing but the background.
    let corner = |picture: &Picture| -> Vec<[u8; 3]> {
        (20..230).map(|x| pixel(picture, x, picture.height - 16 - 18 - 6)).collect()
    };
    assert!(corner(&field) != corner(&clay));
    let bar = corner(&field);
    assert!(bar[2][2] > bar[2][1] && bar[205][1] > bar[205][2], "{:?} {:?}", bar[2], bar[205]);
    // A scale of its own, and values that are all 0: nothing divides by it.
    scalar_square(&path, "0");
    let source = MeshSource::open(&path).unwrap();
    assert_eq!(top_of(&source, "error", &progress).unwrap(), 0.0);
    let scale = Some(Scale { property: "error".to_owned(), top: 0.0 });
    let dark = render_source(&source, &View { scale, ..plain }, BOTH, &progress).unwrap();
    assert!(pixel(&dark, 200, 120)[2] > pixel(&dark, 200, 120)[1]);
}
