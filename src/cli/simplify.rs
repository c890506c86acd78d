//! `stonecut simplify`: the main job.

use super::answer::{Answer, json_of};
use super::arguments::{memory_budget, parse_memory};
use super::display::watch;
use super::faces::TypedFaces;
use super::job::{done_before, run_job, stages_done};
use super::levels::TypedTarget;
use super::log::{EXIT_SHORT, Log, Talk};
use super::method::{self, TypedMethod, Wishes};
use super::near::TypedNear;
use super::new_texture::TypedPages;
use super::outcome::{is_short, tell, write_early, write_report};
use super::placing::TypedPlacing;
use super::progressive::TypedProgressive;
use crate::config::{
    Attributes, Config, DEFAULT_CELL_TRIANGLES, FEATURE_ANGLE, Level, Method, MinComponent,
    Normals, Texture, Until,
};
use crate::error::{Error, Result};
use crate::io::{OutputFormat, TextureMode};
use crate::kernel;
use crate::mesh::attribute_weights::Weights;
use crate::pipeline;
use crate::pipeline::run_report::RunReport;
use crate::stages::stitch::MAX_CELL_TRIANGLES;
use crate::system::paths::{Kind, Paths, Role};
use crate::system::pending_file::Seen;
use crate::system::progress::Progress;
use serde_json::json;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Simplifies a mesh of any size; the cells that it is cut into leave no seams.
///
/// The same command continues after an interruption, whatever it was.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The mesh to simplify.
    pub input: PathBuf,
    /// File that the result is written to.
    pub output: PathBuf,
    #[command(flatten)]
    target: TypedTarget,
    #[command(flatten)]
    method: TypedMethod,
    #[command(flatten)]
    placing: TypedPlacing,
    /// Memory budget, everything included: 512MiB, 4GiB, 50% [default: 75 % of the tightest limit in force].
    #[arg(long, value_name = "SIZE", value_parser = parse_memory)]
    memory: Option<u64>,
    /// Worker threads [default: the cores this process may use].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Triangles per cell; smaller cells need less memory.
    #[arg(long, value_name = "N", value_parser = super::arguments::parse_cell, default_value_t = DEFAULT_CELL_TRIANGLES)]
    cell_triangles: u64,
    /// Folder in which the job folder is made [default: beside OUTPUT].
    #[arg(long, value_name = "DIR")]
    temp_dir: Option<PathBuf>,
    /// Keep the job folder after success.
    #[arg(long)]
    keep_temp: bool,
    /// Stop after this stage; the same command without it continues.
    #[arg(long, value_enum, value_name = "STAGE")]
    until: Option<Until>,
    /// Replace OUTPUT if it exists.
    #[arg(long)]
    force: bool,
    /// Throw away what an earlier run left and start over.
    #[arg(long)]
    restart: bool,
    /// Words joined by commas: ascii, binary_little_endian or binary_big_endian; float or double; int or
    /// uint; ply, stl, obj or glb [default: by OUTPUT's name, binary].
    #[arg(long, value_name = "FORMAT", default_value = "")]
    format: OutputFormat,
    /// Drop and count broken faces and vertices instead of failing.
    #[arg(long)]
    skip_bad: bool,
    /// Drop connected components below a count of triangles (300, 2k) or whose bounding box has a shorter
    /// diagonal (size=2.5 in input units, size=0.1% of the scan's diagonal); connected by vertices, or by
    /// vertices in exactly the same place (seams). --ratio still means the triangles of the whole input.
    #[arg(long, value_name = "N|SIZE")]
    min_component: Option<MinComponent>,
    /// Texture of the result: keep (the input's charts and images), bake (charts and images made for the result, filled
    /// from the input's), auto (bake below 30 % of the triangles, and where charts leave too many) or none.
    #[arg(long, value_enum, value_name = "WHAT", default_value = "auto")]
    texture: TypedTexture,
    #[command(flatten)]
    pages: TypedPages,
    /// With a new texture: bake the input's normals into normal maps, too (OBJ, GLB). An input without images gets charts
    /// for them.
    #[arg(long)]
    bake_normals: bool,
    /// Give up texture coordinates and materials of textured faces; the same as --texture none.
    #[arg(long)]
    drop_texture: bool,
    /// Texture images: copy (beside OUTPUT, unless they lie in its folder), link (named where they are), embed (GLB)
    /// or none [default: copy; embed for GLB].
    #[arg(long, value_name = "WHAT")]
    textures: Option<TextureMode>,
    #[command(flatten)]
    faces: TypedFaces,
    /// With --max-error: write the distance from the input, at most, with every vertex, as property `error` (PLY).
    #[arg(long, requires = "max_error")]
    error_field: bool,
    /// Weights of attributes against the shape: color=W,normal=W,uv=W,NAME=W; 0 rides along, 1 is
    /// sensible [default: color=1,normal=0,uv=1].
    #[arg(long, value_name = "NAME=W,...", default_value = "", hide_default_value = true)]
    weight: Weights,
    /// A property, of vertices or faces, whose values are chosen, never averaged; integers other than colours
    /// always are.
    #[arg(long, value_name = "NAME")]
    label: Vec<String>,
    /// Normals of the result: keep (those of the input, averaged), recompute (from the result's triangles) or
    /// drop.
    #[arg(long, value_enum, value_name = "WHAT", default_value = "keep")]
    normals: Normals,
    /// Fate of small components, three-edge holes and thin tubes below the error: removed (error) or left as they are
    /// (keep).
    #[arg(long, value_enum, value_name = "POLICY", default_value = "error")]
    topology: TypedTopology,
    /// Refuse what would make the surface pass through itself where it did not, for 3D printing and simulation: takes four to
    /// eight times as long.
    #[arg(long)]
    no_self_intersections: bool,
    /// Moves the vertices of the result to fit the original: less error for more time; auto does so
    /// where at most 1.1 % of the triangles are left, and up to 11 % of them where the result is too large for one finish.
    #[arg(long, value_enum, value_name = "WHEN", default_value = "auto")]
    fit: TypedFit,
    /// Position of the vertex that survives a collapse: optimal, subset (only vertices of the input) or
    /// midpoint.
    #[arg(long, value_enum, value_name = "PLACE", default_value = "optimal")]
    placement: TypedPlacement,
    #[command(flatten)]
    near: TypedNear,
    #[command(flatten)]
    progressive: TypedProgressive,
    /// Print the plan and stop.
    #[arg(long)]
    dry_run: bool,
    /// Write a report in JSON.
    #[arg(long, value_name = "FILE")]
    pub(super) report: Option<PathBuf>,
    /// Measure how far the result deviates from the input, and report it. The input is the whole one, with what
    /// --min-component drops; --max-error leaves that out.
    #[arg(long)]
    verify: bool,
    /// Write the vertices on the seams of the first round, as a point set.
    #[arg(long, value_name = "FILE")]
    seams: Option<PathBuf>,
}

/// The choices of `--texture`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum TypedTexture {
    /// The charts and images of the input.
    Keep,
    /// Charts and images of the result's own.
    Bake,
    /// Whichever looks more like the input.
    Auto,
    /// None.
    None,
}

/// The choices of `--topology`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum TypedTopology {
    /// Components, holes and handles stay as they are.
    Keep,
    /// Details smaller than the error may be removed.
    Error,
}

/// The choices of `--fit`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum TypedFit {
    /// Always, and in every round: 1 to 2 % less error at 1 % of the triangles than auto, for a fifth more time.
    On,
    /// Never.
    Off,
    /// Only if it costs little time.
    Auto,
}

/// The choices of `--placement`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum TypedPlacement {
    /// The point of least error, the volume preserved.
    Optimal,
    /// At an end of the edge.
    Subset,
    /// In the middle of the edge.
    Midpoint,
}

impl Args {
    /// Turns the options that were typed into decided settings.
    pub fn config(&self) -> Result<Config> {
        self.check_method()?;
        self.pages.check(&[
            ("--texture keep", self.texture == TypedTexture::Keep),
            ("--texture none", self.texture == TypedTexture::None),
            ("--drop-texture", self.drop_texture),
            ("--progressive", self.progressive.progressive.is_some()),
        ])?;
        let max_error = self.target.max_error;
        let mut levels = self.levels()?;
        let Level { target, output } = levels.remove(0);
        if self.cell_triangles > MAX_CELL_TRIANGLES {
            return Err(Error::Usage(format!(
                "--cell-triangles {} is more than one cell can hold: at most {MAX_CELL_TRIANGLES}",
                self.cell_triangles
            )));
        }
        let keeps_topology = self.topology == TypedTopology::Keep;
        self.near.check(keeps_topology)?;
        if max_error.is_some() && self.seams.is_some() {
            let what = "--max-error may take several runs: not with --seams";
            return Err(Error::Usage(what.to_owned()));
        }
        let progressive = self.progressive.settings(&[
            ("--max-error", max_error.is_some()),
            ("--lock", self.near.lock().is_some()),
            ("a list of targets", !levels.is_empty()),
            ("--topology keep", self.topology == TypedTopology::Keep),
            ("--fit on", self.fit == TypedFit::On),
            ("--normals recompute", self.normals == Normals::Recompute),
            ("--texture bake", self.texture == TypedTexture::Bake),
            ("--bake-normals", self.bake_normals),
        ])?;
        let placing = self.placing.placing(self.format.kind_of(&output))?;
        Ok(Config {
            input: self.input.clone(),
            textures_beside: output.clone(),
            output,
            target,
            coarser: levels,
            method: self.method.method,
            feature_angle: self.method.feature_angle.unwrap_or(FEATURE_ANGLE),
            gradation: self.method.gradation.unwrap_or(0.0),
            manifold: self.method.manifold,
            optimize: self.method.optimize,
            weld: self.near.weld(),
            lock: self.near.lock(),
            pairs: self.method.pairs,
            memory_bytes: memory_budget(self.memory),
            threads: super::arguments::threads(self.threads),
            cell_triangles: self.cell_triangles,
            job_folder: self.job_folder()?,
            keep_temp: self.keep_temp,
            trial_of: None,
            until: self.until,
            force: self.force,
            restart: self.restart,
            seams: self.seams.clone(),
            verify: self.verify,
            format: self.format,
            skip_bad: self.skip_bad,
            drop_texture: self.drop_texture || self.texture == TypedTexture::None,
            texture: match self.texture {
                TypedTexture::Keep | TypedTexture::None => Texture::Keep,
                TypedTexture::Bake => Texture::Bake,
                TypedTexture::Auto if progressive.is_some() => Texture::Keep,
                TypedTexture::Auto => Texture::Auto,
            },
            bake: self.pages.settings(self.bake_normals),
            drop_faces: self.faces.drop_faces,
            names: self.faces.names(&self.method, progressive.is_some()),
            placing,
            textures: self.textures,
            error_field: self.error_field,
            progressive: progressive.clone(),
            min_component: self.min_component,
            checkpoint_every: crate::config::CHECKPOINT_EVERY,
            attributes: Attributes {
                weights: self.weight.clone(),
                labels: self.near.labels(&self.label),
                normals: self.normals,
            },
            kernel: kernel::Options {
                topology: match self.topology {
                    TypedTopology::Keep => kernel::Topology::Keep,
                    TypedTopology::Error => kernel::Topology::Error,
                },
                fit: match self.fit {
                    _ if progressive.is_some() => kernel::Fit::Off,
                    // The better the start, the better the end, at a small part of the time.
                    TypedFit::Auto if self.method.optimize.is_some() => kernel::Fit::On,
                    TypedFit::On => kernel::Fit::On,
                    TypedFit::Off => kernel::Fit::Off,
                    TypedFit::Auto => kernel::Fit::Auto,
                },
                placement: match self.placement {
                    TypedPlacement::Optimal => kernel::Placement::Optimal,
                    TypedPlacement::Subset => kernel::Placement::Subset,
                    TypedPlacement::Midpoint => kernel::Placement::Midpoint,
                },
                merge_distance: self.near.gap(keeps_topology),
                no_self_intersections: self.no_self_intersections,
                bound: max_error.map(|distance| kernel::Bound {
                    distance,
                    channel: None,
                    patience: 1.0,
                }),
                ..kernel::Options::default()
            },
        })
    }
}

impl Args {
    /// The levels of the run, finest first; one, unless a chain was asked for.
    fn levels(&self) -> Result<Vec<Level>> {
        self.target.levels(&self.output, self.method.grid)
    }

    /// Refuses what the chosen method has no use for.
    fn check_method(&self) -> Result<()> {
        self.method.check_optimize(&[
            ("--max-error", self.target.max_error.is_some()),
            ("a list of targets", self.target.is_chain()),
            ("--until", self.until.is_some()),
            ("--lock", self.near.lock().is_some()),
            ("--seams", self.seams.is_some()),
            ("--progressive", self.progressive.progressive.is_some()),
            ("--no-self-intersections", self.no_self_intersections),
            ("--texture bake", self.texture == TypedTexture::Bake),
            ("--placement subset", self.placement == TypedPlacement::Subset),
        ])?;
        self.method.check_pairs(&[
            ("--max-error", self.target.max_error.is_some()),
            ("a list of targets", self.target.is_chain()),
            ("--topology keep", self.topology == TypedTopology::Keep),
            ("--placement subset", self.placement == TypedPlacement::Subset),
            ("--placement midpoint", self.placement == TypedPlacement::Midpoint),
            ("--fit on", self.fit == TypedFit::On),
            ("--until", self.until.is_some()),
            ("--lock", self.near.lock().is_some()),
            ("--seams", self.seams.is_some()),
            ("--progressive", self.progressive.progressive.is_some()),
            ("--no-self-intersections", self.no_self_intersections),
            ("--texture bake", self.texture == TypedTexture::Bake),
        ])?;
        self.method.check(&[
            ("--max-error", self.target.max_error.is_some()),
            ("a list of targets", self.target.is_chain()),
            ("--cell-triangles", self.cell_triangles != DEFAULT_CELL_TRIANGLES),
            ("--until", self.until.is_some()),
            ("--lock", self.near.lock().is_some()),
            ("--min-component", self.min_component.is_some()),
            ("--weight", self.weight != Weights::default()),
            ("--topology", self.topology != TypedTopology::Error),
            ("--fit", self.fit != TypedFit::Auto),
            ("--placement", self.placement != TypedPlacement::Optimal),
            ("--merge-distance", self.near.has_merge_distance()),
            ("--pairs", self.method.pairs),
            ("--no-self-intersections", self.no_self_intersections),
            ("--seams", self.seams.is_some()),
            ("--progressive", self.progressive.progressive.is_some()),
            ("--textures", self.textures.is_some()),
            ("--texture keep", self.texture == TypedTexture::Keep),
            ("--texture bake", self.texture == TypedTexture::Bake),
            ("--bake-size", self.pages.bake_size.is_some()),
            ("--bake-pages", self.pages.bake_pages.is_some()),
            ("--bake-normals", self.bake_normals),
        ])
    }

    /// The exit code of an earlier run that has done the same; its report proves it.
    pub(super) fn done_before(&self) -> Option<u8> {
        let report = self.report.as_ref().filter(|path| path.exists())?;
        if self.force || self.restart || self.dry_run || self.until.is_some() {
            return None;
        }
        done_before(&self.config().ok()?, report)
    }

    /// Wishes that are not settings of the run.
    fn wishes(&self) -> Wishes<'_> {
        Wishes { dry_run: self.dry_run, report: self.report.as_deref() }
    }

    /// The job folder, of the first level in a chain.
    fn job_folder(&self) -> Result<PathBuf> {
        let Level { output, .. } = self.levels()?.remove(0);
        super::arguments::job_folder(&output, self.temp_dir.as_deref())
    }

    /// Returns whether nothing is to be run.
    pub(super) fn is_plan_only(&self) -> bool {
        self.dry_run
    }

    /// The first option about the pages of a new texture that was given.
    pub(super) fn page_option(&self) -> Option<&'static str> {
        self.pages.given()
    }

    /// Returns whether a folder for the temporary data was given.
    pub(super) fn has_temp_dir(&self) -> bool {
        self.temp_dir.is_some()
    }

    pub(super) fn paths(&self) -> Result<Paths> {
        self.paths_in(&self.job_folder()?)
    }

    /// The paths of a job in this folder.
    pub(super) fn paths_in(&self, job_folder: &Path) -> Result<Paths> {
        self.format.check(&self.output)?;
        if let Some(seams) = &self.seams {
            super::arguments::require_ending("--seams", seams, &["ply"])?;
        }
        // What a killed run of the same command has written is found by the run itself.
        let may_be_ours = !self.restart && pipeline::has_begun_to_write(job_folder, &self.output);
        let outputs = self.levels()?.into_iter().map(|level| level.output);
        let paths = Paths::new(self.force || may_be_ours).with(Role::Input, "INPUT", &self.input);
        let paths = outputs.fold(paths, |paths, output| paths.with(Role::Output, "OUTPUT", output));
        Ok(paths
            .with_option(Role::Side(Kind::Report), "--report", self.report.as_ref())
            .with_option(Role::Side(Kind::Seams), "--seams", self.seams.as_ref())
            .with_option(Role::Side(Kind::Progressive), "--progressive", self.progressive.path())
            .with_option(Role::TempDir, "--temp-dir", self.temp_dir.as_ref())
            .with(Role::JobFolder, "the job folder", job_folder))
    }
}

/// Runs the command and gives its exit code.
pub fn run(args: &Args, talk: &Talk, progress: &Progress, log: &mut Log) -> Result<u8> {
    match simplify(args, talk, progress, log)? {
        Some(report) if is_short(&report) => Ok(EXIT_SHORT),
        _ => Ok(0),
    }
}

/// Runs the job, or only plans it, without a word.
pub(super) fn call(args: &Args, progress: &Progress) -> Result<Answer> {
    let report_to = args.report.as_deref().map(Seen::new);
    let config = args.config()?;
    if config.method != Method::Collapse {
        return method::call(args.wishes(), &config, progress);
    }
    let prepared = pipeline::prepare(&config)?;
    if args.dry_run {
        let end = json!({ "dry_run": true, "plan": prepared.plan });
        write_early(report_to.as_ref(), &config, end, progress)?;
        return Ok(Answer { report: json_of(&prepared.plan)?, is_short: false });
    }
    let Some(report) = run_job(prepared, &config, progress)? else {
        return Ok(Answer { report: serde_json::Value::Null, is_short: false });
    };
    if let Some(to) = &report_to {
        write_report(to, &report)?;
    }
    Ok(Answer { report: json_of(&report.written())?, is_short: is_short(&report) })
}

/// Prints the plan, runs the job, prints and writes the report.
pub fn simplify(
    args: &Args,
    talk: &Talk,
    progress: &Progress,
    log: &mut Log,
) -> Result<Option<RunReport>> {
    let report_to = args.report.as_deref().map(Seen::new);
    let config = args.config()?;
    super::arguments::warn_of_limit(args.memory, log);
    args.target.warn_of_one(log);
    if config.method != Method::Collapse {
        return method::simplify(args.wishes(), &config, talk, progress, log);
    }
    let prepared = pipeline::prepare(&config)?;
    log.plan(prepared.plan.lines(&config), &prepared.plan);
    if prepared.texture == Texture::Keep {
        args.pages.notes(prepared.can_bake).into_iter().for_each(|line| log.say(line));
    }
    if args.dry_run {
        let end = json!({ "dry_run": true, "plan": prepared.plan });
        write_early(report_to.as_ref(), &config, end, progress)?;
        return Ok(None);
    }
    let outcome = watch(talk, progress, log, || run_job(prepared, &config, progress));
    let Some(report) = outcome? else {
        log.say(format!(
            "stopped as asked; the same command without --until continues. State: {}",
            config.job_folder.display()
        ));
        let end = json!({ "stages_done": stages_done(&config), "job_folder": config.job_folder });
        write_early(report_to.as_ref(), &config, end, progress)?;
        return Ok(None);
    };
    tell(&report, talk, log);
    if let Some(to) = &report_to {
        write_report(to, &report)?;
    }
    Ok(Some(report))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::pack_format::ALWAYS_WIDE;
    use clap::Parser;
    use std::path::Path;

    #[derive(Parser)]
    struct Typed {
        #[command(flatten)]
        args: Args,
    }

    fn simplify(folder: &Path, name: &str, options: &str) -> (Vec<u8>, u64) {
        let (input, output) = (folder.join("in.ply"), folder.join(name));
        let words = ["simplify".to_owned()]
            .into_iter()
            .chain([input, output.clone()].map(|path| path.display().to_string()));
        let words = words.chain(options.split_whitespace().map(str::to_owned));
        let config = Typed::parse_from(words).args.config().unwrap();
        let prepared = pipeline::prepare(&config).unwrap();
        let disk = crate::system::disk::Disk::default();
        pipeline::simplify_on(&disk, prepared, &config, &Progress::default()).unwrap();
        let mesh = std::fs::read(&output).unwrap();
        std::fs::remove_file(&output).unwrap();
        (mesh, disk.bytes_written())
    }

    /// Ids of 8 bytes, as for inputs of more than 2^32 vertices, change no byte of a result: through rounds, new
    /// cells, components, the finish and the writer.
    #[test]
    fn wide_ids_change_no_byte_of_a_result() {
        let folder = tempfile::tempdir().unwrap();
        let n = 130;
        let mut text = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             property uchar red\nproperty uchar green\nproperty uchar blue\n\
             element face {}\nproperty list uchar int vertex_indices\nend_header\n",
            (n + 1) * (n + 1),
            2 * n * n
        );
        for v in 0..(n + 1) * (n + 1) {
            let (x, y) = (f64::from(v % (n + 1)), f64::from(v / (n + 1)));
            let z = (x * 0.2).sin() * (y * 0.15).cos() * 4.0 + (x * 1.9 + y * 2.7).sin() * 0.1;
            text += &format!("{x} {y} {z} {} {} {}\n", v % 256, v / 7 % 256, v / 99 % 256);
        }
        for quad in 0..n * n {
            let a = quad / n * (n + 1) + quad % n;
            text += &format!("3 {a} {} {}\n3 {a} {} {}\n", a + 1, a + n + 2, a + n + 2, a + n + 1);
        }
        std::fs::write(folder.path().join("in.ply"), text).unwrap();
        for options in [
            "--ratio 60% --cell-triangles 1000",
            "--ratio 5% --cell-triangles 1000 --min-component 4",
            "--ratio 10%",
        ] {
            let (narrow, n_bytes) = simplify(folder.path(), "narrow.ply", options);
            ALWAYS_WIDE.set(true);
            let (wide, n_wide_bytes) = simplify(folder.path(), "wide.ply", options);
            ALWAYS_WIDE.set(false);
            assert!(n_wide_bytes > n_bytes, "{options}");
            assert!(narrow == wide, "{options}");
        }
    }
}
