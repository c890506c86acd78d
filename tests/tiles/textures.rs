//! Tiles of textured scans: a page for each tile, with the colours of the images in their places.

use crate::common::{check, count, expect, json, scratch};
use crate::scalars::document;
use crate::tiles::{check_colours, config, files, painted};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use stonecut::io::{StoredTile, decode_tile};
use stonecut::pipeline::tiles::{TileTexture, TilesConfig, make_tiles_on, prepare_tiles};
use stonecut::system::disk::Disk;
use stonecut::system::progress::Progress;

/// The page of a tile.
fn page(bytes: &[u8]) -> image::RgbImage {
    let json = document(bytes);
    let view = &json["bufferViews"][json["images"][0]["bufferView"].as_u64().unwrap() as usize];
    let number = |key: &str| view[key].as_u64().unwrap() as usize;
    let binary = 28 + u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let file = &bytes[binary + number("byteOffset")..][..number("byteLength")];
    image::load_from_memory(file).unwrap().into_rgb8()
}

/// Tiles of a level.
fn tiles(folder: &Path, level: u32) -> Vec<Vec<u8>> {
    let is_tile = |path: &Path| path.extension().is_some_and(|ext| ext == "glb");
    let all = files(&folder.join(format!("tiles/{level}")));
    all.into_iter().filter(|(path, _)| is_tile(path)).map(|(_, bytes)| bytes).collect()
}

/// Calls `each` with place and colour in the middle of every triangle.
fn each_middle(bytes: &[u8], origin: [f64; 3], mut each: impl FnMut([f64; 3], [u8; 3])) {
    let StoredTile { mesh, step, .. } = decode_tile(bytes).unwrap();
    let page = page(bytes);
    let size = [page.width(), page.height()].map(f64::from);
    for t in &mesh.triangles {
        let mean =
            |k: usize| t.iter().map(|&v| f64::from(mesh.positions[v as usize][k])).sum::<f64>();
        let place = [0, 1, 2].map(|k| origin[k] + step * mean(k) / 3.0);
        let texel = |k: usize| {
            let sum: f64 = t.iter().map(|&v| f64::from(mesh.coordinates[v as usize][k])).sum();
            (sum / 3.0 / 65_535.0 * size[k]) as u32
        };
        each(place, page.get_pixel(texel(0), texel(1)).0);
    }
}

#[test]
fn every_tile_shows_the_images_at_their_places() {
    let path = &scratch();
    painted(path, 120);
    for options in ["", "--compress none --up y"] {
        expect(
            path,
            &format!("tiles in.obj out --force --tile-triangles 900 --report r.json {options}"),
            0,
        );
        let found = check(path, "out");
        assert_eq!(
            (count(&found, "n_faults"), count(&found, "boundary_edges")),
            (0, 480),
            "{found}"
        );
        assert_eq!(count(&found, "triangles"), 2 * 120 * 120);
        assert_eq!(found["gap_within"], serde_json::json!(0.0));
        let report = json(path, "r.json");
        assert_eq!(report["texture"]["pages"], report["tiles"]);
        let set = json(path, "out/tileset.json");
        let facts = &set["extras"]["stonecut"];
        let origin = [0, 1, 2].map(|k| facts["origin"][k].as_f64().unwrap());
        for level in 0..facts["levels"].as_u64().unwrap() as u32 {
            let tiles = tiles(&path.join("out"), level);
            assert!(!tiles.is_empty());
            for tile in &tiles {
                assert!(decode_tile(tile).unwrap().mesh.colours.is_empty());
                each_middle(tile, origin, |[x, y, _], [red, green, blue]| {
                    // A triangle of a coarse level may lie on both images.
                    let rim = 0.02 * f64::from(level + 1);
                    if y > 0.5 + rim {
                        assert_eq!([red, green, blue], [0, 200, 0], "level {level} at {x} {y}");
                    } else if y < 0.5 - rim && (rim..1.0 - rim).contains(&x) {
                        let off = (f64::from(blue) - 256.0 * x).abs();
                        let limit = 6.0 * f64::from(level + 1);
                        assert!(green == 0 && off < limit, "level {level}: {blue} at {x} {y}");
                    }
                });
            }
        }
    }
}

/// A scan without lamps: black, with its images in the emitted light.
#[test]
fn light_is_the_colour_of_what_is_black() {
    let path = &scratch();
    painted(path, 60);
    let pages = |name: &str, mesh: &str| {
        expect(path, &format!("tiles {mesh} {name} --tile-triangles 900"), 0);
        tiles(&path.join(name), 0).iter().map(|tile| page(tile)).collect::<Vec<_>>()
    };
    expect(path, "convert in.obj in.glb", 0);
    let wanted = [pages("colour", "in.obj"), pages("glb_colour", "in.glb")];
    let library = std::fs::read_to_string(path.join("in.mtl")).unwrap();
    let dark = library.replace("map_Kd", "Kd 0 0 0\nKe 1 1 1\nmap_Ke");
    std::fs::write(path.join("in.mtl"), dark).unwrap();
    expect(path, "convert in.obj in.glb --force", 0);
    assert!([pages("light", "in.obj"), pages("glb", "in.glb")] == wanted);
    assert_eq!(
        document(&tiles(&path.join("glb"), 0)[0])["extensionsUsed"]
            .to_string()
            .matches("unlit")
            .count(),
        1
    );
    expect(path, "tiles in.glb vertices --texture colors --tile-triangles 900", 0);
    expect(path, "extract vertices all.ply --max-error 0", 0);
    assert_eq!(check_colours(&path.join("all.ply"), (0.02, 6.0)), 61 * 61);
    // Of a surface that is not black the light is lost, and so are all images.
    std::fs::write(path.join("in.mtl"), library.replace("map_Kd", "Kd 0.5 0.5 0.5\nmap_Ke"))
        .unwrap();
    let said = expect(path, "tiles in.obj grey --tile-triangles 900", 3);
    assert!(
        said.contains("lost: image of emitted light of material 'ramp': not carried by tiles"),
        "{said}"
    );
    assert!(!said.contains("images: not carried: vertices"), "{said}");
}

#[test]
fn cuts_through_tiles_with_pages_are_one_mesh() {
    cuts_are_one_mesh("", 4);
    cuts_are_one_mesh("--textures ktx2", 1);
}

fn cuts_are_one_mesh(textures: &str, n_cuts: usize) {
    let path = &scratch();
    painted(path, 120);
    expect(path, &format!("tiles in.obj out --tile-triangles 900 {textures}"), 0);
    let tile = &tiles(&path.join("out"), 0)[0];
    let required = document(tile)["extensionsRequired"].to_string();
    assert_eq!(required.contains("KHR_texture_basisu"), !textures.is_empty(), "{required}");
    // The finest level, one in the middle, a fine box in a coarse mesh, and a number of triangles. The farther vertices are
    // apart, the larger is the part of an image that a vertex stands for.
    for (cut, colours) in [
        ("--max-error 0", (0.02, if textures.is_empty() { 4.0 } else { 24.0 })),
        ("--max-error 0.002", (0.1, 8.0)),
        ("--max-error 1 --inside 0.1,0.1,-1,0.4,0.4,1 --max-error-inside 0", (0.2, 12.0)),
        ("--triangles 20k", (0.05, 8.0)),
    ]
    .into_iter()
    .take(n_cuts)
    {
        expect(path, &format!("extract out cut.ply --force {cut}"), 0);
        let found = check(path, "cut.ply");
        assert_eq!(count(&found, "components"), 1, "{cut}: {found}");
        assert_eq!(count(&found, "non_manifold_edges"), 0, "{cut}: {found}");
        // A disc: a vertex that was parted would open it.
        let [v, t, b] = ["vertices", "triangles", "boundary_edges"].map(|key| count(&found, key));
        assert_eq!(2 * v, t + b + 2, "{cut}: {found}");
        assert_eq!(check_colours(&path.join("cut.ply"), colours) as i64, v);
        let read = || std::fs::read(path.join("cut.ply")).unwrap();
        let first = read();
        expect(path, &format!("extract out cut.ply --force {cut} --threads 3"), 0);
        assert!(first == read(), "{cut}: other bytes with other threads");
    }
}

#[test]
fn pages_are_the_same_for_any_threads_and_memory() {
    let path = &scratch();
    painted(path, 120);
    let cut = |name: &str, options: &str| {
        expect(path, &format!("tiles in.obj {name} --tile-triangles 900 {options}"), 0);
        files(&path.join(name))
    };
    assert!(cut("one", "--threads 1 --memory 200MiB") == cut("two", "--threads 3 --memory 2GiB"));
}

#[test]
fn tiles_are_no_coarser_on_the_screen_than_their_pages() {
    let path = &scratch();
    painted(path, 120);
    expect(path, "tiles in.obj out --tile-triangles 900", 0);
    let set = json(path, "out/tileset.json");
    let texels = set["extras"]["stonecut"]["texels_per_unit"].as_f64().unwrap();
    let levels = set["extras"]["stonecut"]["levels"].as_f64().unwrap();
    let root = set["root"]["geometricError"].as_f64().unwrap();
    // At 16 pixels of error a texel is one pixel wide.
    assert!(root >= 16.0 * (levels - 1.0).exp2() / texels * 0.999, "{root} {texels} {levels}");
}

#[test]
fn a_page_that_is_damaged_is_found() {
    let path = &scratch();
    painted(path, 60);
    expect(path, "tiles in.obj out --tile-triangles 900", 0);
    let tile = path.join("out/tiles/0/0/0-0.glb");
    let bytes = std::fs::read(&tile).unwrap();
    // The view of the image lies at the end of the file.
    let end = bytes.len() - 64;
    let mut cut = bytes.clone();
    cut[end..].fill(0);
    std::fs::write(&tile, cut).unwrap();
    let found = check_faults(path);
    assert!(found.contains("image was cut off"), "{found}");
    let mut text = bytes;
    let at = text.windows(10).position(|w| w == b"TEXCOORD_0").unwrap();
    text[at..at + 10].copy_from_slice(b"TEXCOORD_1");
    std::fs::write(&tile, text).unwrap();
    let found = check_faults(path);
    assert!(found.contains("no page, or no coordinates"), "{found}");
}

fn check_faults(folder: &Path) -> String {
    let output = crate::common::run(folder, "info --check --json out");
    assert!(!output.status.success());
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn pages_are_asked_for_only_where_there_are_images() {
    let path = &scratch();
    expect(path, "synth scans in.ply --triangles 5k", 0);
    let said = expect(path, "tiles in.ply out --texture bake", 2);
    assert!(said.contains("no image"), "{said}");
    assert!(!path.join("out").exists());
    expect(path, "tiles in.ply out --texture colors", 0);
}

fn painted_config(folder: &Path, texture: TileTexture) -> TilesConfig {
    TilesConfig { input: folder.join("in.obj").into(), texture, ..config(folder, "out") }
}

#[test]
fn pages_have_their_share_of_the_plan() {
    let folder = tempfile::tempdir().unwrap();
    painted(folder.path(), 120);
    let plan = |texture| prepare_tiles(&painted_config(folder.path(), texture)).unwrap().plan;
    let (with, without) = (plan(TileTexture::Bake), plan(TileTexture::Colors));
    assert!(with.seconds > 1.5 * without.seconds, "{} {}", with.seconds, without.seconds);
    assert!(with.temp_bytes > without.temp_bytes);
    // A larger image takes longer.
    image::RgbImage::new(2048, 2048).save(folder.path().join("green.png")).unwrap();
    assert!(plan(TileTexture::Bake).seconds > 1.5 * with.seconds);
    assert_eq!(plan(TileTexture::Colors).seconds, without.seconds);
}

/// Bytes of the files of a folder, and of the files without a name in it that this process has open.
fn bytes_in(folder: &Path) -> (u64, u64) {
    let mut named = 0;
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let Ok(meta) = entry.metadata() else { continue };
        named += if meta.is_dir() { bytes_in(&entry.path()).0 } else { meta.len() };
    }
    let open = std::fs::read_dir("/proc/self/fd").into_iter().flatten().flatten();
    let nameless = open.filter_map(|entry| {
        let place = std::fs::read_link(entry.path()).ok()?;
        let meta = std::fs::metadata(entry.path()).ok()?;
        (place.starts_with(folder) && meta.nlink() == 0).then(|| (meta.ino(), meta.len()))
    });
    let nameless: std::collections::BTreeMap<u64, u64> = nameless.collect();
    (named, nameless.values().sum())
}

#[test]
fn the_most_temporary_bytes_are_at_least_those_that_are_seen() {
    let folder = tempfile::tempdir().unwrap();
    painted(folder.path(), 120);
    let config = painted_config(folder.path(), TileTexture::Bake);
    let disk = Disk::default();
    let [all, nameless] = [(); 2].map(|()| Arc::new(AtomicU64::new(0)));
    let (most, most_nameless) = (Arc::clone(&all), Arc::clone(&nameless));
    let (job, pending) = (config.job_folder.clone(), config.pending_output());
    disk.watch(move |_| {
        let (job, shapes) = (bytes_in(&job), bytes_in(&pending.join("shapes")));
        most.fetch_max(job.0 + job.1 + shapes.0, Relaxed);
        most_nameless.fetch_max(job.1, Relaxed);
    });
    let prepared = prepare_tiles(&config).unwrap();
    let planned = prepared.plan.temp_bytes;
    let report = make_tiles_on(&disk, prepared, &config, &Progress::default()).unwrap();
    let [all, nameless] = [all, nameless].map(|n| n.load(Relaxed));
    assert!(nameless > 100_000, "{nameless}");
    let said = report.peak_temp_bytes;
    assert!((all..2 * all).contains(&said), "{said} said, {all} seen, {nameless} without a name");
    assert!((said..4 * said).contains(&planned), "{said} said, {planned} planned");
}

/// Three triangles apart: one with an image under colours that it hides, one with colours alone, one with a material's alone.
#[test]
fn images_hide_colours_and_bare_vertices_have_those_of_their_material() {
    let folder = &scratch();
    image::RgbImage::from_pixel(4, 4, image::Rgb([20, 200, 40]))
        .save(folder.join("t.png"))
        .unwrap();
    let library =
        "newmtl image\nKd 1 1 1\nmap_Kd t.png\nnewmtl plain\nKd 1 1 1\nnewmtl kd\nKd 0.8 0.3 0.1\n";
    std::fs::write(folder.join("in.mtl"), library).unwrap();
    let text = "mtllib in.mtl\nvt 0.5 0.5\nv 0 0 0 0.8 0.1 0.1\nv 1 0 0 0.8 0.1 0.1\nv 0 1 0 0.8 0.1 0.1\n\
        v 3 0 0 0 0 1\nv 4 0 0 0 0 1\nv 3 1 0 0 0 1\nv 6 0 0\nv 7 0 0\nv 6 1 0\n\
        usemtl image\nf 1/1 2/1 3/1\nusemtl plain\nf 4 5 6\nusemtl kd\nf 7 8 9\n";
    std::fs::write(folder.join("in.obj"), text).unwrap();
    let expected = [[20, 200, 40], [0, 0, 255], [204, 77, 26]];
    expect(folder, "tiles in.obj out --texture colors", 0);
    expect(folder, "extract out all.ply --max-error 0 --format ascii", 0);
    let text = std::fs::read_to_string(folder.join("all.ply")).unwrap();
    let header: Vec<&str> = text.lines().take_while(|line| *line != "end_header").collect();
    let names: Vec<&str> = header
        .iter()
        .filter_map(|line| line.strip_prefix("property ")?.split(' ').nth(1))
        .collect();
    let red = names.iter().position(|name| *name == "red").unwrap();
    for line in text.lines().skip(header.len() + 1).take(9) {
        let row: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
        let wanted: [i32; 3] = expected[(row[0] / 3.0 + 0.1) as usize];
        assert!((0..3).all(|k| (row[red + k] as i32 - wanted[k]).abs() <= 1), "{line}");
    }
    // The same in a new texture.
    expect(folder, "simplify in.obj out.ply --ratio 100% --texture bake -q", 0);
    let page = image::open(folder.join("out_textures/out_0.png")).unwrap().into_rgb8();
    for colour in expected {
        let is = |p: &image::Rgb<u8>| (0..3).all(|k| (i32::from(p.0[k]) - colour[k]).abs() <= 1);
        assert!(page.pixels().any(is), "{colour:?}");
    }
}
