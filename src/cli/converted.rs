//! The outcome of a conversion, for people and for programs.

use super::log::Said;
use super::outcome::write_json;
use crate::error::{Error, Result};
use crate::io::ply::{FaceSchema, MeshSource, PartReport, VertexBlock, WeldReport};
use crate::io::{Expected, OutputFormat, OutputKind, expected_bytes};
use crate::system::losses::Ledger;
use crate::system::pending_file::Seen;
use crate::system::progress::StageSeconds;
use crate::system::units::{show_bytes, show_count};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Result of a conversion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Converted {
    /// Vertices written.
    pub n_vertices: u64,
    /// Triangles written.
    pub n_triangles: u64,
    /// Faces dropped because corners repeat or are fewer than three.
    pub n_degenerate: u64,
    /// Faces dropped because an earlier one has the same corners.
    pub n_duplicate: u64,
    /// Broken faces and missing rows dropped with `--skip-bad`.
    pub n_bad: u64,
    /// Vertices that no face uses.
    pub n_unreferenced: u64,
    /// Files that became the input, if they were several.
    pub inputs: Vec<PartReport>,
    /// Copies of vertices that became one.
    pub weld: Option<WeldReport>,
    /// Parts of the input that the output does not have.
    pub losses: Ledger,
    /// Length of the output.
    pub n_bytes: u64,
    /// Files of `--split`, whose sums the other counts are.
    pub files: Vec<SplitFile>,
}

/// One file of `--split`.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct SplitFile {
    /// Label of its faces.
    pub label: i64,
    /// Place of the file.
    pub path: PathBuf,
    /// Vertices written.
    pub vertices: u64,
    /// Triangles written.
    pub triangles: u64,
    /// Length of the file.
    pub bytes: u64,
}

impl Converted {
    /// Returns whether the output is not all that the input is.
    pub fn is_short(&self) -> bool {
        self.n_bad > 0 || self.losses.has_whole()
    }
}

/// Memory for blocks under way and buffers of files.
const BLOCKS_BYTES: u64 = 24 << 20;

/// Refuses a mesh whose tables of bits do not fit: a bit and an eighth a vertex, a bit a triangle.
pub(super) fn hold(source: &MeshSource, memory_bytes: u64) -> Result<()> {
    let bits = source.n_vertices() / 8 + source.n_vertices() / 64 + source.n_triangles() / 8;
    let needed = BLOCKS_BYTES + 2 * bits;
    if needed <= memory_bytes {
        return Ok(());
    }
    let (path, needed) = (source.path().display(), needed.div_ceil(1 << 20));
    Err(Error::NoMemory(format!(
        "{path}: converting its {} triangles takes {needed}MiB, the budget has {}; give --memory {needed}MiB",
        show_count(source.n_triangles()),
        show_bytes(memory_bytes)
    )))
}

/// More memory than this makes no sort of triangles faster.
const MOST_SORT_BYTES: u64 = 64 << 20;

/// Memory for one of the sorts, of which there are at most three at a time.
pub(super) fn sort_bytes(memory_bytes: u64) -> usize {
    (memory_bytes / 8).min(MOST_SORT_BYTES) as usize
}

/// Says what was done.
pub(super) fn say(output: &Path, done: &Converted, log: &mut Said) {
    // A closed standard error is not a reason to fail: the mesh is there.
    let _ = writeln!(
        log,
        "{}: {}{} vertices, {} triangles, {}",
        output.display(),
        match done.files.len() {
            0 => String::new(),
            n => format!("{n} files, "),
        },
        done.n_vertices,
        done.n_triangles,
        show_bytes(done.n_bytes)
    );
    for (count, what) in [
        (done.n_degenerate, "degenerate faces dropped"),
        (done.n_duplicate, "repeated faces dropped"),
        (done.n_unreferenced, "vertices without a face dropped"),
    ] {
        if count > 0 {
            let _ = writeln!(log, "  {count} {what}");
        }
    }
    if done.n_bad > 0 {
        log.0.say_reason(format!("  {} broken faces or rows dropped", done.n_bad));
    }
    for line in done.weld.iter().flat_map(|weld| &weld.notes) {
        let _ = writeln!(log, "  {line}");
    }
}

/// Seconds for a triangle: looked at before, and written as PLY or GLB, as STL, as OBJ.
const SURVEY_SECONDS: f64 = 0.1e-6;
const WRITE_SECONDS: [f64; 3] = [0.03e-6, 0.06e-6, 0.15e-6];

/// The stages of a conversion.
pub(super) fn stage_seconds(source: &MeshSource, kind: OutputKind) -> Vec<StageSeconds> {
    let n = source.n_triangles() as f64;
    let of_write = match kind {
        OutputKind::Ply | OutputKind::Glb => WRITE_SECONDS[0],
        OutputKind::Stl => WRITE_SECONDS[1],
        OutputKind::Obj => WRITE_SECONDS[2],
    };
    vec![("survey", SURVEY_SECONDS * n), ("convert", of_write * n)]
}

/// Forecast of a conversion that drops nothing, with images of this many bytes.
pub(super) fn plan(
    source: &MeshSource,
    faces: &FaceSchema,
    image_bytes: u64,
    (kind, format): (OutputKind, OutputFormat),
) -> serde_json::Value {
    let mut block = VertexBlock::default();
    // A fault is told when it is met on the way.
    if source.n_vertices() > 0
        && source.read_vertices(source.n_vertex_blocks() / 2, &mut block).is_err()
    {
        block = VertexBlock::default();
    }
    let expected = Expected {
        schema: source.schema(),
        faces,
        n_vertices: source.n_vertices(),
        n_faces: source.n_triangles(),
        sample: &block.records,
    };
    let (bytes, spool_bytes) = expected_bytes(&expected, kind, format);
    serde_json::json!({
        "triangles_in": source.n_triangles(),
        "output_bytes": bytes + image_bytes,
        "temp_bytes": spool_bytes,
        "seconds": stage_seconds(source, kind).iter().map(|(_, seconds)| seconds).sum::<f64>(),
    })
}

/// The report as JSON, written where that was asked for.
pub(super) fn write_report(
    to: Option<&Seen>,
    [input, output]: [&Path; 2],
    done: &Converted,
) -> Result<serde_json::Value> {
    let mut report = serde_json::json!({
        "schema_version": crate::system::json_keys::SCHEMA_VERSION,
        "version": env!("CARGO_PKG_VERSION"),
        "input": { "path": input },
        "output": {
            "path": output, "bytes": done.n_bytes,
            "vertices": done.n_vertices, "triangles": done.n_triangles,
        },
        "faults": {
            "degenerate_faces": done.n_degenerate, "duplicate_faces": done.n_duplicate,
            "bad_faces": done.n_bad, "unreferenced_vertices": done.n_unreferenced,
        },
        "losses": done.losses,
    });
    if !done.inputs.is_empty() {
        report["inputs"] = serde_json::json!(done.inputs);
    }
    if !done.files.is_empty() {
        report["output"]["files"] = serde_json::json!(done.files);
    }
    if let Some(weld) = &done.weld {
        report["input"]["weld"] = serde_json::json!(weld);
    }
    if let Some(to) = to {
        write_json(to, &report)?;
    }
    Ok(report)
}
