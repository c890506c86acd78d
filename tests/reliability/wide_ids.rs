//! Ids of 8 bytes, as for inputs of more than 2^32 vertices.

use crate::common::meshes::{ply_text, sheet_triangles};
use crate::common::scratch;
use std::ffi::OsString;
use std::path::Path;
use stonecut::cli::call;
use stonecut::pipeline;
use stonecut::system::disk::Disk;
use stonecut::system::progress::Progress;
use stonecut_store::pack_format::ALWAYS_WIDE;

/// The bytes of a result, and the number of those that were written on the way.
fn simplify(at: &Path, options: &str) -> (Vec<u8>, u64) {
    let [input, output] = ["in.ply", "out.ply"].map(|name| at.join(name));
    let paths = [OsString::from("simplify"), input.into(), output.clone().into()];
    let options = options.split(' ').map(OsString::from);
    let config = call::config(&paths.into_iter().chain(options).collect::<Vec<_>>()).unwrap();
    let disk = Disk::default();
    let prepared = pipeline::prepare(&config).unwrap();
    pipeline::simplify_on(&disk, prepared, &Progress::default()).unwrap();
    let mesh = std::fs::read(&output).unwrap();
    std::fs::remove_file(&output).unwrap();
    (mesh, disk.bytes_written())
}

/// Through rounds, new cells, components, the finish and the writer.
#[test]
fn wide_ids_change_no_byte_of_a_result() {
    let at = &scratch();
    let n = 130;
    let row = |v: usize| {
        let (x, y) = ((v % (n + 1)) as f64, (v / (n + 1)) as f64);
        let z = (x * 0.2).sin() * (y * 0.15).cos() * 4.0 + (x * 1.9 + y * 2.7).sin() * 0.1;
        format!("{x} {y} {z} {} {} {}", v % 256, v / 7 % 256, v / 99 % 256)
    };
    let rows = (0..(n + 1) * (n + 1)).map(row);
    let colours = "uchar red, uchar green, uchar blue";
    std::fs::write(at.join("in.ply"), ply_text(colours, rows, &sheet_triangles(n))).unwrap();
    for options in [
        "--ratio 60% --cell-triangles 1000",
        "--ratio 5% --cell-triangles 1000 --min-component 4",
        "--ratio 10%",
    ] {
        let (narrow, n_bytes) = simplify(at, options);
        ALWAYS_WIDE.set(true);
        let (wide, n_wide_bytes) = simplify(at, options);
        ALWAYS_WIDE.set(false);
        assert!(n_wide_bytes > n_bytes, "{options}");
        assert!(narrow == wide, "{options}");
    }
}
