//! `stonecut simplify`: the main job.

use super::answer::CommandEnd;
use super::arguments::{memory_budget, parse_memory};
use super::conflicts::{Mode, Row, check};
use super::faces::TypedFaces;
use super::inputs::InOut;
use super::job::{ReadyJob, done_before, prepare, run_job, stages_done};
use super::levels::TypedTarget;
use super::method::{MethodName, TypedMethod};
use super::near::TypedNear;
use super::new_texture::TypedPages;
use super::outcome::{tell, write_early, write_report};
use super::placing::TypedPlacing;
use super::progressive::TypedProgressive;
use super::receipt::{self, TypedReceipt};
use super::session::{Command, Session};
use super::solid::TypedSolid;
use crate::config::{
    Attributes, CheckOptions, Config, DEFAULT_CELL_TRIANGLES, JobOptions, Level, MinComponent,
    Normals, Texture,
};
use crate::error::{Error, Offers, Result};
use crate::io::{OutputFormat, TextureMode};
use crate::kernel;
use crate::mesh::attribute_weights::Weights;
use crate::pipeline;
use crate::stages::stitch::MAX_CELL_TRIANGLES;
use crate::store::job::remove_job;
use crate::system::paths::{Kind, Paths, Role};
use crate::system::pending_file::Seen;
use serde_json::json;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Simplifies a mesh of any size; the cells that it is cut into leave no seams.
///
/// The same command continues after an interruption, whatever it was.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    // Its own lines are its documentation.
    #[command(flatten)]
    #[allow(missing_docs)]
    pub paths: InOut,
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
    #[command(flatten)]
    job: JobOptions,
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
    /// or none; those of a new texture in a GLB: ktx2 (UASTC) or etc1s (KTX2, too, smaller) [default: copy; embed for GLB].
    #[arg(long, value_name = "WHAT")]
    textures: Option<TextureMode>,
    #[command(flatten)]
    faces: TypedFaces,
    /// With --max-error: write with every vertex its distance from the input, or that of the input around it from its triangles,
    /// whichever is larger, as property `error` (PLY).
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
    #[command(flatten)]
    solid: TypedSolid,
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
    /// Write a map of vertices, too: two arrays of NumPy in one file, for each vertex of the input the number of the one of the
    /// result that it became (-1: none), and for each of the result the nearest of these. 'stonecut transfer' carries values
    /// over by it.
    #[arg(long, value_name = "MAP.npy")]
    map: Option<PathBuf>,
    /// Print the plan and stop.
    #[arg(long)]
    dry_run: bool,
    /// Write a report in JSON.
    #[arg(long, value_name = "FILE")]
    pub(super) report: Option<PathBuf>,
    #[command(flatten)]
    pub(super) receipt: TypedReceipt,
    #[command(flatten)]
    checks: CheckOptions,
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
        self.method.check()?;
        self.check_conflicts()?;
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
        let progressive = self.progressive.settings();
        let placing = self.placing.placing(self.format.kind_of(&output))?;
        Ok(Config {
            coarser: levels,
            method: self.method.settings(),
            optimize: self.method.optimize,
            weld: self.near.weld(),
            lock: self.near.lock(),
            pairs: self.method.pairs,
            memory_bytes: memory_budget(self.memory),
            threads: super::arguments::threads(self.threads),
            cell_triangles: self.cell_triangles,
            job_folder: self.job_folder()?,
            job: JobOptions { restart: self.job.restart || self.is_stream(), ..self.job },
            checks: self.checks.clone(),
            format: self.solid.format(self.format, &output),
            skip_bad: self.skip_bad,
            drop_texture: self.drop_texture || self.texture == TypedTexture::None,
            texture: match self.texture {
                TypedTexture::Keep | TypedTexture::None => Texture::Keep,
                TypedTexture::Bake => Texture::Bake,
                TypedTexture::Auto if progressive.is_some() || self.map.is_some() => Texture::Keep,
                TypedTexture::Auto => Texture::Auto,
            },
            bake: self.pages.settings(self.bake_normals),
            drop_faces: self.faces.drop_faces,
            names: self.faces.names(&self.method, progressive.is_some()),
            placing,
            textures: self.textures,
            error_field: self.error_field,
            progressive: progressive.clone(),
            map: self.map.clone(),
            min_component: self.solid.min_component(self.min_component),
            close: self.solid.close(),
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
                placement: self.solid.placement(match self.placement {
                    TypedPlacement::Optimal => kernel::Placement::Optimal,
                    TypedPlacement::Subset => kernel::Placement::Subset,
                    TypedPlacement::Midpoint => kernel::Placement::Midpoint,
                }),
                merge_distance: self.near.gap(keeps_topology),
                no_self_intersections: self.solid.no_self_intersections(),
                orient: self.solid.orient(),
                bound: max_error.map(|distance| kernel::Bound {
                    distance,
                    channel: None,
                    patience: 1.0,
                }),
                ..kernel::Options::default()
            },
            ..Config::new(&self.paths.input, output, target)
        })
    }
}

impl Args {
    /// Refuses options that do not go with each other.
    fn check_conflicts(&self) -> Result<()> {
        if self.is_stream() && self.job.until.is_some() {
            let what = "--until: a run to standard output is not continued; give OUTPUT the name of a file";
            return Err(Error::Usage(what.to_owned()));
        }
        use Mode::{
            Closing, Joining, Map, Method as Other, Optimize, Pages, Pairs, Progressive, Seams,
        };
        let (target, near, pages, texture) = (&self.target, &self.near, &self.pages, self.texture);
        let solid = &self.solid;
        let bakes = texture == TypedTexture::Bake;
        let keeps_topology = self.topology == TypedTopology::Keep;
        let places_subset = self.placement == TypedPlacement::Subset;
        let records = self.progressive.progressive.is_some();
        let is_other = self.method.method != MethodName::Collapse;
        let given = |is_given: bool| is_given.then_some("");
        let modes = [
            (Optimize, given(self.method.optimize.is_some())),
            (Pairs, given(self.method.pairs)),
            (Other, is_other.then(|| self.method.settings().name())),
            (Pages, pages.given()),
            (Joining, given(near.has_merge_distance())),
            (Seams, given(self.checks.seams.is_some())),
            (Progressive, given(records)),
            (Closing, given(solid.close().is_some())),
            (Map, given(self.map.is_some())),
        ];
        let options: [Row; 32] = [
            (
                "--max-error",
                target.max_error.is_some(),
                &[Optimize, Pairs, Other, Seams, Progressive, Closing, Map],
            ),
            ("--lock", near.lock().is_some(), &[Optimize, Pairs, Other, Progressive, Closing]),
            ("--for", solid.has_purpose(), &[Optimize, Pairs, Other, Progressive, Map]),
            ("--close", solid.close().is_some(), &[Optimize, Pairs, Other, Progressive, Map]),
            ("--orient", solid.orient(), &[Optimize, Pairs, Other, Map]),
            ("a list of targets", target.is_chain(), &[Optimize, Pairs, Other, Progressive, Map]),
            ("--topology keep", keeps_topology, &[Pairs, Joining, Progressive]),
            ("--placement subset", places_subset, &[Optimize, Pairs]),
            ("--placement midpoint", self.placement == TypedPlacement::Midpoint, &[Pairs]),
            ("--fit on", self.fit == TypedFit::On, &[Pairs, Progressive]),
            ("--normals recompute", self.normals == Normals::Recompute, &[Progressive]),
            ("--cell-triangles", self.cell_triangles != DEFAULT_CELL_TRIANGLES, &[Other]),
            ("--until", self.job.until.is_some(), &[Optimize, Pairs, Other]),
            ("--min-component", self.min_component.is_some(), &[Other]),
            ("--weight", self.weight != Weights::default(), &[Other]),
            ("--topology", keeps_topology, &[Other]),
            ("--fit", self.fit != TypedFit::Auto, &[Other]),
            ("--placement", self.placement != TypedPlacement::Optimal, &[Other]),
            ("--merge-distance", near.has_merge_distance(), &[Other, Map]),
            ("--pairs", self.method.pairs, &[Other]),
            ("--seams", self.checks.seams.is_some(), &[Optimize, Pairs, Other]),
            ("--progressive", records, &[Optimize, Pairs, Other, Pages, Map]),
            ("--map", self.map.is_some(), &[Optimize, Pairs, Other]),
            ("--no-self-intersections", solid.no_self_intersections(), &[Optimize, Pairs, Other]),
            ("--textures", self.textures.is_some(), &[Other]),
            ("--texture keep", texture == TypedTexture::Keep, &[Other, Pages]),
            ("--texture none", texture == TypedTexture::None, &[Pages]),
            ("--drop-texture", self.drop_texture, &[Pages]),
            ("--texture bake", bakes, &[Optimize, Pairs, Other, Progressive, Map]),
            ("--bake-size", pages.bake_size.is_some(), &[Other]),
            ("--bake-pages", pages.bake_pages.is_some(), &[Other]),
            ("--bake-normals", self.bake_normals, &[Other, Progressive]),
        ];
        check(&modes, &options)
    }

    /// The levels of the run, finest first; one, unless a chain was asked for.
    fn levels(&self) -> Result<Vec<Level>> {
        self.target.levels(&self.paths.output, self.method.grid)
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

    /// The paths of a job in this folder.
    pub(super) fn paths_in(&self, job_folder: &Path) -> Result<Paths> {
        self.format.check(&self.paths.output)?;
        if let Some(seams) = &self.checks.seams {
            super::arguments::require_ending("--seams", seams, &["ply"])?;
        }
        // What a killed run of the same command has written is found by the run itself.
        let may_be_ours =
            !self.job.restart && pipeline::has_begun_to_write(job_folder, &self.paths.output);
        let outputs = self.levels()?.into_iter().map(|level| level.output);
        let paths = Paths::new(self.job.force || may_be_ours);
        let paths = self.paths.input.add_to(paths, "INPUT")?;
        let paths = outputs.fold(paths, |paths, output| paths.with(Role::Output, "OUTPUT", output));
        let paths = self.receipt.add_to(paths, [&self.paths.input, &self.paths.output])?;
        Ok(paths
            .with_option(Role::Side(Kind::Report), "--report", self.report.as_ref())
            .with_option(Role::Side(Kind::Seams), "--seams", self.checks.seams.as_ref())
            .with_option(
                Role::Side(Kind::Progressive),
                "--progressive",
                self.progressive.progressive.as_ref(),
            )
            .with_option(Role::Side(Kind::Map), "--map", self.map.as_ref())
            .with_option(Role::TempDir, "--temp-dir", self.temp_dir.as_ref())
            .with(Role::JobFolder, "the job folder", job_folder))
    }
}

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        self.paths_in(&self.job_folder()?)
    }

    fn offers(&self) -> Offers {
        Offers { resumes: !self.is_stream(), temp_dir: true }
    }

    fn done_before(&self) -> Option<(u8, String)> {
        let report = self.report.as_deref();
        let is_more = self.dry_run || self.job.until.is_some() || self.receipt.is_owed();
        if self.job.force || self.job.restart || is_more {
            return None;
        }
        let config = self.config().ok()?;
        let output = config.output.display();
        let line = format!("{output}: already done with the same settings; --force does it again");
        let code = done_before(&config, report)?;
        // Of a run that was killed, before another one with another folder did the work.
        remove_job(&config.job_folder, Some(&config.settings()));
        Some((code, line))
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        let end = self.simplify(session);
        if end.is_err() && self.is_stream() {
            remove_job(&self.job_folder()?, None);
        }
        end
    }
}

impl Args {
    /// True if the output is standard output: no other run goes on with its job.
    fn is_stream(&self) -> bool {
        self.paths.output == Path::new("-")
    }

    fn simplify(&self, session: &mut Session) -> Result<CommandEnd> {
        let report_to = self.report.as_deref().map(Seen::new);
        let receipt = self.receipt.begin()?;
        let config = self.config()?;
        super::arguments::warn_of_limit(self.memory, session.log);
        self.target.warn_of_one(session.log);
        let progress = session.progress;
        let ready = session.watch_reading(config.input.files(), || prepare(&config, progress))?;
        let (lines, plan) = ready.plan(&config);
        session.log.plan(lines, &plan);
        progress.expect(ready.expected());
        if let ReadyJob::Collapse(ready) = &ready
            && ready.config.texture == Texture::Keep
        {
            let ktx2 = self.textures.filter(|mode| mode.is_ktx2());
            let obstacle = ready.texture_obstacle();
            let notes = self.pages.notes(ktx2, ready.retry.is_some(), obstacle.as_deref());
            notes.into_iter().for_each(|line| session.log.say(line));
        }
        if self.dry_run {
            let end = json!({ "dry_run": true, "plan": plan });
            write_early(report_to.as_ref(), &config, end, progress)?;
            return CommandEnd::whole(&plan);
        }
        let Some(report) = session.watch(|| run_job(ready, &config, progress))? else {
            session.log.say(format!(
                "stopped as asked; the same command without --until continues. State: {}",
                config.job_folder.display()
            ));
            let stages_done = stages_done(&config);
            let end = json!({ "stages_done": stages_done, "job_folder": config.job_folder });
            write_early(report_to.as_ref(), &config, end, progress)?;
            return Ok(CommandEnd::plain());
        };
        tell(&report, session.talk, session.log);
        if let Some(to) = &report_to {
            write_report(to, &report)?;
        }
        if let Some(receipt) = &receipt {
            let (output, line) = (self.paths.output.as_path(), session.line);
            let typed = receipt::Typed { output, line, is_program: session.prints };
            session.watch(|| receipt.write(typed, (&config, &report), progress))?;
        }
        CommandEnd::of(&report.written(), report.is_short())
    }
}
