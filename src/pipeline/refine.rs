//! The program of `refine`: a mesh of any count out of a progressive mesh.
//!
//! Reads only the blocks that the count needs. The result of an exact file is that of a direct run with the same settings,
//! byte for byte.

use crate::error::{Error, Result};
use crate::io::ply::{OutputHeader, Place};
use crate::io::{MeshSink, OutputFormat};
use crate::progressive::{Refiner, View, Viewed, refine_for_view, slides};
use crate::system::disk::Disk;
use crate::system::losses::Ledger;
use crate::system::memory::BASE_BYTES;
use crate::system::parallel::guarded;
use crate::system::progress::Progress;
use crate::system::units::{memory_word, show_bytes};
use std::path::{Path, PathBuf};

/// Fineness of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted {
    /// Triangles at most.
    Triangles(u64),
    /// As an eye sees it.
    View(View),
}

/// A run of `refine`.
#[derive(Clone, Debug)]
pub struct RefineConfig {
    /// The progressive mesh.
    pub input: PathBuf,
    /// The mesh.
    pub output: PathBuf,
    /// Its format.
    pub format: OutputFormat,
    /// Fineness.
    pub wanted: Wanted,
    /// Replace the output.
    pub force: bool,
    /// Memory budget in bytes.
    pub memory_bytes: u64,
}

/// Outcome of a run.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Refined {
    /// Raised when keys of the report change their meaning.
    pub schema_version: u32,
    /// Version of the program.
    pub version: String,
    /// The progressive mesh.
    pub input: RefinedInput,
    /// The mesh.
    pub output: RefinedOutput,
    /// Triangles wanted; none for a view.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<u64>,
    /// Steps that a view saw and took.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub view: Option<Viewed>,
    /// True if the mesh has at most as many triangles as were wanted.
    pub target_met: bool,
    /// Seconds.
    pub seconds: f64,
    /// Parts of the mesh that the output's format has no place for.
    pub losses: Ledger,
}

/// A progressive mesh in a report.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct RefinedInput {
    /// Its path.
    pub path: String,
    /// Bytes of it that were needed.
    pub bytes_read: u64,
    /// Triangles of its coarsest mesh.
    pub coarsest: u64,
    /// Triangles of its finest.
    pub finest: u64,
}

/// A refined mesh in a report.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct RefinedOutput {
    /// Its path.
    pub path: String,
    /// Its vertices.
    pub vertices: u64,
    /// Its triangles.
    pub triangles: u64,
    /// Its bytes.
    pub bytes: u64,
}

/// Refines a mesh.
///
/// Memory: values and 24 bytes a vertex, 36 bytes a triangle of the mesh. Errors: `BadInput` for a file that is not a
/// progressive mesh, or whose blocks are damaged or cut off before the count is reached; `NoMemory`; `Usage` for an output
/// that exists.
pub fn refine(config: &RefineConfig, progress: &Progress) -> Result<Refined> {
    guarded(|| run(config, progress))
}

/// Meshes of more triangles are too heavy for a page: its bytes are about 27 a triangle.
const MOST_ON_A_PAGE: u64 = 4_000_000;

/// A progressive mesh as a page shows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shown {
    /// Triangles of its coarsest mesh and of its finest.
    pub triangles: [u64; 2],
    /// The bytes for the page.
    pub slides: Vec<u8>,
}

/// Reads all of a progressive mesh for a page. Memory: that of the finest mesh, and 60 bytes a step.
///
/// Errors: as those of `refine`; `Usage` for a mesh that is too large for a page.
pub fn show(input: &Path, given: u64, progress: &Progress) -> Result<Shown> {
    guarded(|| {
        let memory_bytes = given.saturating_sub(BASE_BYTES) / 2;
        let mesh = Refiner::open(input, memory_bytes)?;
        hold(&mesh, mesh.head().finest_triangles, (given, [2, 1]))?;
        let triangles = [mesh.head().base_triangles, mesh.head().finest_triangles];
        if triangles[1] > MOST_ON_A_PAGE {
            return Err(Error::Usage(format!(
                "{}: its finest mesh of {} triangles is too large for a page, at most {MOST_ON_A_PAGE}; record a smaller \
                 mesh",
                input.display(),
                triangles[1]
            )));
        }
        progress.begin("page", 1, 1, triangles[1]);
        let slides = slides(mesh, &|| progress.check())?;
        Ok(Shown { triangles, slides })
    })
}

/// Refuses a mesh of `n` triangles whose bytes, by a factor, are more than the memory.
fn hold(mesh: &Refiner, n: u64, (memory_bytes, [times, of]): (u64, [u64; 2])) -> Result<()> {
    let needed = BASE_BYTES + mesh.expected_bytes(n).saturating_mul(times).div_ceil(of);
    if needed <= memory_bytes {
        return Ok(());
    }
    Err(Error::NoMemory(format!(
        "a mesh of {} triangles takes {} of memory, the budget is {}; ask for fewer triangles, or give --memory {}",
        n.min(mesh.head().finest_triangles),
        show_bytes(needed),
        show_bytes(memory_bytes),
        memory_word(needed)
    )))
}

fn run(config: &RefineConfig, progress: &Progress) -> Result<Refined> {
    let start = std::time::Instant::now();
    // What is written takes some more.
    let memory_bytes = config.memory_bytes.saturating_sub(BASE_BYTES) / 4 * 3;
    let mut mesh = Refiner::open(&config.input, memory_bytes)?;
    let (coarsest, finest) = (mesh.head().base_triangles, mesh.head().finest_triangles);
    let check = || progress.check();
    let mut settings = mesh.head().settings.clone();
    let (mut target, mut view) = (None, None);
    match config.wanted {
        Wanted::Triangles(n) => {
            hold(&mesh, n, (config.memory_bytes, [4, 3]))?;
            progress.begin("refine", 1, 2, n.min(finest));
            mesh.refine(n, &check)?;
            target = Some(n);
            settings.insert("target".to_owned(), format!("triangles={n}"));
        }
        Wanted::View(eye) => {
            hold(&mesh, finest, (config.memory_bytes, [10, 3]))?;
            progress.begin("refine", 1, 2, finest);
            // The whole mesh is there beside the part.
            let open = || Refiner::open(&config.input, memory_bytes / 5 * 2);
            let (refined, viewed) = refine_for_view(&open, &eye, &check)?;
            (mesh, view) = (refined, Some(viewed));
            let numbers =
                eye.eye.iter().chain(&eye.target).chain([&eye.degrees, &eye.pixels, &eye.height]);
            let numbers: Vec<String> = numbers.map(f64::to_string).collect();
            settings.insert("target".to_owned(), format!("view={}", numbers.join(",")));
        }
    }
    progress.begin("write", 2, 2, mesh.n_triangles());
    let head = mesh.head();
    let header = OutputHeader {
        comments: head.comments.clone(),
        obj_infos: head.obj_infos.clone(),
        settings: OutputHeader::line_of(&settings),
        ..OutputHeader::new(mesh.schema().clone(), 0, 0)
    };
    let place = Place { path: config.output.clone(), disk: Disk::default(), replace: config.force };
    let ordered = mesh.ordered();
    let (vertices, triangles) = (ordered.n_vertices(), ordered.n_triangles());
    let header = OutputHeader { n_vertices: vertices, n_faces: triangles, ..header };
    let mut sink = MeshSink::create(place, header, config.format)?;
    ordered.records(|records| sink.write_vertices(records))?;
    ordered.triangles(|block| {
        progress.check()?;
        progress.add(block.len() as u64);
        sink.write_faces_u32(block)
    })?;
    progress.lose_all(&sink.losses());
    let bytes_written = sink.finish()?;
    Ok(Refined {
        schema_version: crate::system::json_keys::SCHEMA_VERSION,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        input: RefinedInput {
            path: config.input.display().to_string(),
            bytes_read: mesh.bytes_read(),
            coarsest,
            finest,
        },
        output: RefinedOutput {
            path: config.output.display().to_string(),
            vertices,
            triangles,
            bytes: bytes_written,
        },
        target,
        view,
        target_met: target.is_none_or(|target| triangles <= target),
        seconds: start.elapsed().as_secs_f64(),
        losses: progress.losses(),
    })
}
