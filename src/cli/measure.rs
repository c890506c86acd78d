//! `stonecut measure`: its arguments, its table, its report.

use super::answer::CommandEnd;
use super::arguments::{memory_budget, parse_memory};
use super::inputs::InOut;
use super::session::{Command, Session};
use crate::error::{Error, Offers, Result};
use crate::io::ply::{MeshSource, Place};
use crate::measure::appearance::{
    self, Appearance, DEFAULT_VIEWS, Likeness, MOST_VIEWS, Settings, WorstView,
};
use crate::measure::compare::{self, CELL_TRIANGLES, Report, Request};
use crate::measure::plan::MeasurePlan;
use crate::measure::{
    self, Certificate, Certify, LEAST_TOLERANCE, On, Options, Region, Side, TriangleSizes, heatmap,
};
use crate::mesh::bounds::Bounds;
use crate::mesh::placing::Placing;
use crate::mesh::topology_counts::Topology;
use crate::mesh::vec3::{add, length_sq, sub};
use crate::render::{Picture, Resources};
use crate::system::disk::{Disk, folder_of};
use crate::system::made::Made;
use crate::system::paths::{Kind, Paths, Role};
use crate::system::pending_file::{Seen, write_whole};
use crate::system::progress::Progress;
use crate::system::units;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Measures how far a simplified mesh deviates from its original
#[derive(Clone, Debug, clap::Args)]
#[command(mut_arg("paths", |arg| {
    let help = "The original mesh (several files, folders and lists become one), and last the simplified mesh";
    arg.value_name("ORIGINAL>... <SIMPLIFIED").help(help)
}))]
pub struct Args {
    #[command(flatten)]
    meshes: InOut,
    /// Samples on each surface
    #[arg(long, value_name = "N", default_value = "1M", value_parser = parse_samples)]
    samples: u64,
    /// Chooses among equally good sets of samples
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Memory to use [default: 75 % of what there is]
    #[arg(long, value_name = "SIZE", value_parser = parse_memory)]
    memory: Option<u64>,
    /// Threads to use [default: all cores]
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Writes all numbers as JSON
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Writes a mesh coloured by its distance to the other one
    #[arg(long, value_name = "OUT.ply")]
    heatmap: Option<PathBuf>,
    /// Mesh that the heatmap shows
    #[arg(long, value_enum, value_name = "WHICH", default_value = "simplified")]
    heatmap_of: Which,
    /// Replaces the heatmap if it exists
    #[arg(long)]
    force: bool,
    /// Prints all numbers as JSON instead of the table
    #[arg(long)]
    json: bool,
    /// Folder for cells if the meshes exceed the memory [default: beside SIMPLIFIED]
    #[arg(long, value_name = "DIR")]
    temp_dir: Option<PathBuf>,
    /// Triangles per cell if the meshes exceed the memory
    #[arg(long, value_name = "N", value_parser = super::arguments::parse_cell, default_value_t = CELL_TRIANGLES)]
    cell_triangles: u64,
    /// Counts samples near the vertices of this mesh apart (to look for seams)
    #[arg(long, value_name = "FILE.ply", requires = "within")]
    near: Option<PathBuf>,
    /// Distance that counts as near, in input units
    #[arg(long, value_name = "D", requires = "near")]
    within: Option<f64>,
    /// Also encloses the largest distance either way (Hausdorff) in an interval that is proven, not sampled
    #[arg(long)]
    certify: bool,
    /// Width of that interval, relative to its upper end
    #[arg(long, value_name = "SHARE", requires = "certify", value_parser = parse_tolerance, default_value = "1%")]
    tolerance: f64,
    /// Also compares pictures of both, taken from all around: PSNR and SSIM over the silhouette
    #[arg(long)]
    appearance: bool,
    /// Pictures of each
    #[arg(long, value_name = "N", requires = "appearance", default_value_t = DEFAULT_VIEWS,
          value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_VIEWS)))]
    views: u32,
    /// Pictures with lamps and shade, though the original has colours
    #[arg(long, requires = "appearance")]
    lit: bool,
    /// Writes the pictures into a folder, both of a view side by side
    #[arg(long, value_name = "DIR", requires = "appearance")]
    pictures: Option<PathBuf>,
}

/// A count of samples, at least one.
pub(super) fn parse_samples(text: &str) -> std::result::Result<u64, String> {
    match units::parse_count(text)? {
        0 => Err("at least one sample is needed".to_owned()),
        n => Ok(n),
    }
}

/// A tolerance from a percentage or a share.
fn parse_tolerance(text: &str) -> std::result::Result<f64, String> {
    let tolerance = units::parse_ratio(text)?;
    match (LEAST_TOLERANCE..1.0).contains(&tolerance) {
        true => Ok(tolerance),
        false => {
            Err(format!("'{text}' is not a tolerance from {} to below 1: 1%", LEAST_TOLERANCE))
        }
    }
}

/// The choices of `--heatmap-of`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Which {
    /// The original, coloured by its distance to the simplified mesh.
    Original,
    /// The simplified mesh, coloured by its distance to the original.
    Simplified,
}

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        if let Some(heatmap) = &self.heatmap {
            super::arguments::require_ending("--heatmap", heatmap, &["ply"])?;
        }
        self.check_pictures()?;
        Ok(self
            .meshes
            .input
            .add_to(Paths::new(self.force), "ORIGINAL")?
            .with(Role::Input, "SIMPLIFIED", &self.meshes.output)
            .with_option(Role::Input, "--near", self.near.as_ref())
            .with_option(Role::Side(Kind::Report), "--report", self.report.as_ref())
            .with_option(Role::Side(Kind::Heatmap), "--heatmap", self.heatmap.as_ref())
            .with_option(Role::TempDir, "--temp-dir", self.temp_dir.as_ref()))
    }

    fn offers(&self) -> Offers {
        Offers { resumes: false, temp_dir: true }
    }

    /// The table or the JSON goes to standard output.
    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        super::arguments::warn_of_limit(self.memory, session.log);
        let report_to = self.report.as_deref().map(Seen::new);
        let report = report(self, session)?;
        let json = write_report(report_to.as_ref(), &report, session.progress)?;
        session.warn_of_notes();
        session.print(&if self.json { json + "\n" } else { table(&report) })?;
        CommandEnd::whole(&report)
    }
}

impl Args {
    /// Refuses pictures that could not be written after the measurement.
    fn check_pictures(&self) -> Result<()> {
        let Some(folder) = &self.pictures else { return Ok(()) };
        if folder.symlink_metadata().is_ok() && !folder.is_dir() {
            let what = format!("{}: --pictures is not a folder; name a folder", folder.display());
            return Err(Error::Usage(what));
        }
        let existing = (0..self.views).map(|number| picture(folder, number)).find(|p| p.exists());
        match existing.filter(|_| !self.force) {
            Some(path) => Err(Error::Usage(format!(
                "{} exists; give --force to replace it, or another folder to --pictures",
                path.display()
            ))),
            None => Ok(()),
        }
    }
}

/// The file of a view, both pictures side by side.
fn picture(folder: &Path, number: u32) -> PathBuf {
    folder.join(format!("view-{number:02}.png"))
}

/// Writes the report where that was asked for; gives it back as JSON.
fn write_report(
    to: Option<&Seen>,
    report: &impl serde::Serialize,
    progress: &Progress,
) -> Result<String> {
    let json = serde_json::to_string_pretty(report)
        .map_err(|e| Error::Usage(format!("the report cannot be written as JSON: {e}")))?;
    if let Some(to) = to {
        progress.check()?;
        write_whole(to.place(&Disk::default()), json.as_bytes())?;
    }
    Ok(json)
}

/// Moves one of two meshes that count from different places, as they say themselves, unless that leads them apart.
fn count_from_one_place([a, b]: [&mut MeshSource; 2], progress: &Progress) -> Result<()> {
    let [of_a, of_b] = [&*a, &*b].map(|mesh| mesh.offset().unwrap_or([0.0; 3]));
    if of_a == of_b {
        return Ok(());
    }
    // Away from the origin, where floats are coarse, nothing is moved.
    let is_a = length_sq(of_a) <= length_sq(of_b);
    let (moved, fixed, shift) =
        if is_a { (a, b, sub(of_a, of_b)) } else { (b, a, sub(of_b, of_a)) };
    let bounds = |mesh: &MeshSource| {
        let mut bounds = Bounds::EMPTY;
        mesh.each_vertex(|_, row| {
            bounds.add(mesh.schema().position(row));
            Ok(())
        })?;
        Ok::<_, Error>(bounds)
    };
    let (before, other) = (bounds(moved)?, bounds(fixed)?);
    let after = Bounds { low: add(before.low, shift), high: add(before.high, shift) };
    if after.gap_sq(&other) > before.gap_sq(&other) {
        return Ok(());
    }
    let [x, y, z] = shift;
    progress.note(format!(
        "{} is moved by {x} {y} {z}, since the two count from different places",
        moved.path().display()
    ));
    let mut placing = Placing::default();
    placing.shift(shift);
    moved.place(&placing)
}

/// Measures, and writes the heatmap; the report is left to the caller.
fn report(args: &Args, session: &mut Session) -> Result<Report> {
    let progress = session.progress;
    let begin = std::time::Instant::now();
    let threads = super::arguments::threads(args.threads).get();
    let heat_to = args.heatmap.as_deref().map(Seen::new);
    let temp_dir = temp_dir(args);
    let files = args.meshes.input.files().map(|mut files| {
        files.push(args.meshes.output.clone());
        files
    });
    let opened = session.watch_reading(files, || -> Result<_> {
        let first = super::arguments::open_mesh(&args.meshes.input, &temp_dir, args.memory)?;
        Ok([first, super::arguments::open_mesh(&args.meshes.output, &temp_dir, args.memory)?])
    });
    let [mut original, mut simplified] = opened?;
    if let Some(folder) = &args.pictures {
        let pictures = (0..args.views).map(|number| picture(folder, number));
        pictures.into_iter().try_for_each(|path| {
            original.refuse_output(&path).and_then(|()| simplified.refuse_output(&path))
        })?;
    }
    count_from_one_place([&mut original, &mut simplified], progress)?;
    let memory_bytes = memory_budget(args.memory);
    let means = (memory_bytes, threads);
    if args.appearance {
        let settings = Settings { views: args.views, lit: args.lit };
        appearance::hold((&original, &simplified), settings, memory_bytes)?;
    }
    let region = match (&args.near, args.within) {
        (Some(path), Some(within)) => {
            let places = super::arguments::open_mesh(path, &temp_dir, args.memory)?;
            let near = (&places, args.samples);
            compare::hold_region([&original, &simplified], near, memory_bytes)?;
            Some(region(&places, within, means, progress)?)
        }
        _ => None,
    };
    let triangle_sizes = match &region {
        Some(region) => Some(TriangleSizes::of(&simplified, region, means, progress)?),
        None => None,
    };
    let mut request = Request {
        original: &original,
        simplified: &simplified,
        options: Options {
            samples: args.samples,
            seed: args.seed,
            threads,
            colours: None,
            region,
            certify: args.certify.then_some(Certify { tolerance: args.tolerance, bound: None }),
            distances_only: false,
        },
        memory_bytes,
        cell_triangles: args.cell_triangles,
        temp_dir: temp_dir.clone(),
        heat: args.heatmap.is_some() && args.heatmap_of == Which::Simplified,
    };
    let plan = MeasurePlan::new(&request);
    session.log.plan(Vec::new(), &plan);
    progress.expect(plan.stage_seconds.clone());
    let comparison = session.watch(|| compare::compare(&request, progress))?;
    // Its memory is for the heatmap and the pictures now.
    request.options.region = None;
    if let Some(to) = &heat_to {
        match args.heatmap_of {
            Which::Original => compare::heatmap_of_original(&request, to, progress)?,
            Which::Simplified => {
                heatmap::write(&simplified, &comparison.heat, to, threads, progress)?;
            }
        }
    }
    let appearance = match args.appearance {
        true => Some(appearance(args, [&original, &simplified], threads, progress)?),
        false => None,
    };
    Ok(Report {
        triangle_sizes,
        appearance,
        losses: progress.losses(),
        ..Report::new(&request, &comparison, begin.elapsed().as_secs_f64())
    })
}

/// Compares pictures, and writes them where that was asked for.
fn appearance(
    args: &Args,
    [original, simplified]: [&MeshSource; 2],
    threads: usize,
    progress: &Progress,
) -> Result<Appearance> {
    let mut made = Made::new(&Disk::default());
    if let Some(folder) = &args.pictures {
        made.folder(folder)?;
    }
    let resources = Resources { memory_bytes: memory_budget(args.memory), threads };
    let settings = Settings { views: args.views, lit: args.lit };
    let meshes = (original, simplified);
    let found =
        appearance::compare(meshes, settings, resources, progress, |number, [first, second]| {
            let Some(folder) = &args.pictures else { return Ok(()) };
            let both = Picture::side_by_side(&[(first, "original"), (second, "simplified")]);
            let path = picture(folder, number);
            let place = Place { replace: args.force, ..Place::from(&path) };
            let png = both.to_png()?;
            made.file(&path, || write_whole(place, &png))
        })?;
    made.keep();
    Ok(found)
}

/// Returns the folder for cells and unpacked meshes: beside the simplified mesh, unless another is given.
fn temp_dir(args: &Args) -> PathBuf {
    args.temp_dir.clone().unwrap_or_else(|| folder_of(&args.meshes.output).to_path_buf())
}

fn region(
    places: &MeshSource,
    within: f64,
    means: (u64, usize),
    progress: &Progress,
) -> Result<Region> {
    if !(within >= 0.0 && within.is_finite()) {
        return Err(Error::Usage(format!("invalid distance --within {within}")));
    }
    Region::around_vertices(places, within, means, progress)
}

/// The table for people.
pub(super) fn table(report: &Report) -> String {
    let mut text = String::new();
    let mut line = |cells: [&str; 3]| {
        text.push_str(format!("{:<22}{:>16}{:>16}", cells[0], cells[1], cells[2]).trim_end());
        text.push('\n');
    };
    let files = [&report.original, &report.simplified];
    let sides = [&report.deviation.forward, &report.deviation.backward];
    line(["", "original", "simplified"]);
    let mut pair = |name: &str, values: [String; 2]| line([name, &values[0], &values[1]]);
    pair("triangles", files.map(|f| units::show_count(f.triangles)));
    pair("vertices", files.map(|f| units::show_count(f.vertices)));
    let mut count = |name: &str, pick: fn(&Topology) -> i64| {
        pair(name, files.map(|f| pick(&f.topology).to_string()));
    };
    count("components", |t| t.components as i64);
    count("Euler characteristic", |t| t.euler_characteristic);
    count("boundary edges", |t| t.boundary_edges as i64);
    count("non-manifold edges", |t| t.non_manifold_edges as i64);
    count("inconsistent edges", |t| t.inconsistent_edges as i64);
    count("duplicate triangles", |t| t.duplicate_triangles as i64);
    count("degenerate triangles", |t| t.degenerate_triangles as i64);
    pair("", [String::new(), String::new()]);
    pair("distance", ["to simplified".into(), "to original".into()]);
    let number =
        |value: f64| if value.is_finite() { format!("{value:.6e}") } else { "no surface".into() };
    let mut row = |name: &str, pick: &dyn Fn(&Side) -> Option<f64>| {
        let values = sides.map(pick);
        if values.iter().any(Option::is_some) {
            pair(name, values.map(|v| v.map_or("-".to_owned(), number)));
        }
    };
    row("mean", &|s| Some(s.distance.mean));
    row("rms", &|s| Some(s.distance.rms));
    row("99.9 %", &|s| Some(s.distance.p999));
    row("max", &|s| Some(s.distance.max));
    row("normals, mean degrees", &|s| s.normal_degrees);
    row("colour, mean delta E", &|s| s.color_delta_e);
    row("colour, rms delta E", &|s| s.color_rms_delta_e);
    row("carried normals, deg.", &|s| s.carried_normal_degrees);
    row("texture, mean", &|s| s.texture_mean);
    row("texture, rms", &|s| s.texture_rms);
    for (name, pick) in [("near", near as fn(&Side) -> Option<&measure::Spread>), ("far", far)] {
        row(&format!("{name}: mean"), &|s| pick(s).map(|d| d.mean));
        row(&format!("{name}: rms"), &|s| pick(s).map(|d| d.rms));
        row(&format!("{name}: max"), &|s| pick(s).map(|d| d.max));
    }
    pair("samples", sides.map(|s| units::show_count(s.distance.samples)));
    pair("vertices checked", sides.map(|s| units::show_count(s.vertices)));
    let deviation = &report.deviation;
    text.push_str(&format!(
        "\nrms both ways {} = {} of the diagonal {:.6e}\n",
        number(deviation.rms),
        number(deviation.relative_rms),
        deviation.diagonal
    ));
    if let Some(certificate) = &report.hausdorff {
        text.push_str(&certificate_line(certificate));
        text.push('\n');
    }
    if let Some(appearance) = &report.appearance {
        text.push_str(&appearance_line(appearance));
        text.push('\n');
    }
    if let Some(sizes) = &report.triangle_sizes {
        text.push_str(&format!(
            "mean area of simplified triangles: near {:.6e} ({}), far {:.6e} ({})\n",
            sizes.near_mean_area, sizes.near_triangles, sizes.far_mean_area, sizes.far_triangles
        ));
    }
    text
}

/// The line for people about pictures.
fn appearance_line(appearance: &Appearance) -> String {
    let show = |likeness: &Likeness| {
        let psnr =
            likeness.psnr.map_or("no difference".to_owned(), |psnr| format!("PSNR {psnr:.2} dB"));
        let ssim =
            likeness.ssim.map_or("nothing seen".to_owned(), |ssim| format!("SSIM {ssim:.4}"));
        format!("{psnr}, {ssim}")
    };
    let WorstView { view, direction: [x, y, z], likeness } = &appearance.worst;
    format!(
        "appearance in {} views ({}): {}; worst view {view} (--view {x:.3},{y:.3},{z:.3}): {}",
        appearance.views,
        appearance.lighting,
        show(&appearance.likeness),
        show(likeness)
    )
}

/// The line for people about a certificate; digits are cut off away from the distance.
fn certificate_line(certificate: &Certificate) -> String {
    let Certificate { lower, upper, tolerance, certified, .. } = certificate;
    if !upper.is_finite() {
        return "Hausdorff distance: no surface on one side".to_owned();
    }
    let on = match certificate.witness_on {
        Some(On::Original) => ", reached on the original",
        Some(On::Simplified) => ", reached on the simplified mesh",
        None => "",
    };
    let short = if *certified { "" } else { "; wider than the tolerance" };
    format!(
        "Hausdorff distance from {} to {}, proven (tolerance {} %){on}{short}",
        units::show_outward(*lower, -1, 6),
        units::show_outward(*upper, 1, 6),
        100.0 * tolerance,
    )
}

fn near(side: &Side) -> Option<&measure::Spread> {
    side.near.as_ref()
}

fn far(side: &Side) -> Option<&measure::Spread> {
    side.far.as_ref()
}
