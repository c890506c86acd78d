//! Opens the input, checks it against what was asked for, and plans the run; nothing is written yet.

use super::concluded::{has_begun_to_write, refuse_to_overwrite};
use super::optimize::check::check as check_optimize;
use super::pairs::counts::check as check_pairs;
use super::plan::{Plan, check_split};
use super::{bake, verify};
use crate::bake::BakeNeed;
use crate::config::{Config, JobOptions, Method, Normals, Texture};
use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::io::{
    HardEdges, NUMBER, OutputKind, StageOptions, SurveyOptions, TexturePlan, TextureRequest, Weld,
    WeldOptions, check_range, faces_to_vertices, survey_faces, survey_labels,
};
use crate::render::texture::plan_textures as plan_with_png;
use crate::stages::write::REACH;
use crate::store::job::fingerprint::{input_marks, marks_beside, unchanged};
use crate::store::shape::NORMAL;
use crate::system::disk::folder_of;
use crate::system::pending_file::Seen;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// An input that has been opened and planned for; nothing has been written yet.
#[derive(Debug)]
pub struct Prepared {
    /// The open input.
    pub source: MeshSource,
    /// Plan of the run: work, memory, disk.
    pub plan: Plan,
    /// Materials and images of each output, if there are any; of a new texture, none yet.
    pub textures: Vec<TexturePlan>,
    /// The settings of the run, every value final: never `Texture::Auto`.
    pub config: Config,
    /// Settings of another run, with a new texture, for where the texture of the input leaves too many triangles.
    pub retry: Option<Box<Config>>,
    /// Fingerprint of the input, taken before it was opened.
    pub marks: BTreeMap<String, String>,
    /// The file for `--seams` as it was before the input was opened, which may take long.
    pub(super) seams: Option<Seen>,
}

impl Prepared {
    /// The reason why no new texture can be made, if there is one.
    pub fn texture_obstacle(&self) -> Option<String> {
        bake::obstacle(&self.source, &self.config).unwrap_or_default()
    }
}

/// The settings with everything decided that was left to the program: a new texture begins where the old one is given up.
///
/// `has_maps` if a new texture has normal maps, `has_normals` if the vertices have normals.
fn settled(config: &Config, texture: Texture, has_maps: bool, has_normals: bool) -> Config {
    let drop_texture = config.drop_texture || texture == Texture::Bake;
    let mut settled = Config { texture, drop_texture, ..config.clone() };
    if config.kernel.orient && has_normals && config.attributes.normals == Normals::Keep {
        // Those of what is turned over would point inwards.
        settled.attributes.normals = Normals::Recompute;
    }
    if texture == Texture::Bake && has_maps {
        settled.bake.normals = true;
        // Directions in a normal map lean on the normals that the result itself has.
        settled.attributes.normals = Normals::Recompute;
    }
    settled
}

/// Opens the input and plans the run. Files other than plain PLY, and range grids, are first unpacked beside the output.
///
/// Errors: `BadInput`, `Usage`, `Io`; `NoMemory` and `NoSpace` where the budget or the disk cannot hold the run.
pub fn prepare(config: &Config) -> Result<Prepared> {
    if config.method != Method::Collapse {
        let what =
            format!("--method {} has another way in: pipeline::methods", config.method.name());
        return Err(Error::Usage(what));
    }
    let seams = config.checks.seams.as_deref().map(Seen::new);
    let (mut marks, stage) = before_opening(config)?;
    let (mut texture, mut bake_need, mut retry) = (Texture::Keep, BakeNeed::default(), None);
    let (mut has_maps, mut has_normals) = (false, false);
    let mut bake_room = Ok(());
    let source = MeshSource::open_staged(&config.input, &stage).and_then(|source| {
        config.named_outputs().try_for_each(|output| source.refuse_output(output))?;
        texture = bake::decide(&source, config)?;
        if texture == Texture::Keep && bake::would_help(&source, config) {
            let job = JobOptions { restart: true, ..config.job };
            let config = config.clone();
            retry = Some(Box::new(Config { texture: Texture::Bake, job, ..config }));
        }
        has_maps = texture == Texture::Bake && bake::has_normals(&source, config)?;
        has_normals = NORMAL.iter().all(|name| source.schema().own_property(name).is_some());
        let config = &settled(config, texture, has_maps, has_normals);
        if texture == Texture::Bake {
            let is_ours =
                !config.job.restart && has_begun_to_write(&config.job_folder, &config.output);
            match bake::check(&source, config, is_ours) {
                Ok(need) => bake_need = need,
                // The plan may want more.
                Err(error @ Error::NoMemory(_)) => bake_room = Err(error),
                Err(error) => return Err(error),
            }
        }
        check_labels(&source, &config.attributes.labels)?;
        let survey = SurveyOptions {
            drop_texture: config.drop_texture,
            drop_properties: config.drop_faces,
            labels: &config.attributes.labels,
        };
        let mut carry = survey_faces(&source, &survey)?;
        if texture == Texture::Bake {
            carry.drop_property(NUMBER, "a new texture has its own");
        }
        if !config.drop_texture && !carry.texture {
            source.require_no_texture()?;
        }
        check_split(&source, &carry, config)?;
        let mut source = faces_to_vertices(source, carry, &stage)?;
        // A history takes its steps back without labels.
        if config.progressive.is_none() {
            survey_labels(&mut source, &config.attributes.labels)?;
        }
        Ok(source)
    });
    let source = unchanged(&config.input, &marks, source)?;
    marks.extend(marks_beside(&source));
    let config = settled(config, texture, has_maps, has_normals);
    config.targets().try_for_each(|target| target.check(source.n_triangles()))?;
    let codec = source.schema().kernel_codec(&config.attributes.labels);
    config.attributes.weights.check(&codec.channel_kinds(source.schema())).map_err(Error::Usage)?;
    check_error_field(&source, &config)?;
    check_range(&source, &config.output, config.format)?;
    let n = source.n_triangles();
    let target = config.targets().next().map_or(n, |target| target.triangles(n)).min(n);
    let (mut plan, mut planned) = (None, Ok(()));
    match Plan::new(&source, &config) {
        Ok(made) => plan = Some(made),
        Err(error) => planned = Err(error),
    }
    Error::first_of([
        planned,
        bake_room,
        check_optimize(&source, target, &config),
        check_pairs(&source, target, &config),
    ])?;
    let Some(mut plan) = plan else { unreachable!("a plan that failed is an error") };
    let textures = match texture {
        Texture::Bake => Vec::new(),
        Texture::Auto | Texture::Keep => plan_textures(&source, &config, &stage)?,
    };
    if config.map.is_some() {
        check_map(&source, &config)?;
    }
    if config.progressive.is_some() {
        check_recording(&source, &plan)?;
        plan.add_progressive(source.schema().record_bytes());
    }
    plan.add_output_bytes(textures.iter().map(|textures| textures.bytes).sum());
    if texture == Texture::Bake {
        plan.add_bake(bake_need, config.threads);
    }
    plan.check_disk(&config)?;
    Ok(Prepared { source, plan, textures, config, retry, marks, seams })
}

/// Checks what can be checked without the input; returns marks of the input, and how to open it.
pub(super) fn before_opening(config: &Config) -> Result<(BTreeMap<String, String>, StageOptions)> {
    refuse_to_overwrite(config)?;
    if config.checks.verify {
        verify::refuse_unreadable(config)?;
    }
    let marks = input_marks(&config.input)?;
    let read = config.read_options();
    let stage = StageOptions { read, ..StageOptions::new(folder_of(&config.job_folder)) };
    let mut stage = stage.within(config.memory_bytes);
    stage.threads = config.threads;
    stage.weld = Some(WeldOptions {
        how: match (config.weld, &config.lock) {
            // What must stay is moved only if that was asked for.
            (Weld::Auto, Some(_)) => Weld::Off,
            (how, _) => how,
        },
        exact_above: match config.method {
            Method::Collapse => config.cell_triangles,
            _ => u64::MAX,
        },
        labels: config.attributes.labels.clone(),
        keeps_numbers: config.map.is_some(),
    });
    stage.lock.clone_from(&config.lock);
    let is_unused = config.attributes.normals != Normals::Keep
        || config.kernel.orient
        || config.kind()? == OutputKind::Stl;
    stage.hard_edges = match is_unused {
        true => HardEdges::Unused,
        false => HardEdges::Averaged(
            "--normals drop leaves them to viewers, most of which shade each triangle as flat then",
        ),
    };
    stage.bare_as_material = config.kind()? == OutputKind::Ply;
    Ok((marks, stage))
}

/// Looks at every image and decides what becomes of it, for each output; empty where there are no materials.
fn plan_textures(
    source: &MeshSource,
    config: &Config,
    stage: &StageOptions,
) -> Result<Vec<TexturePlan>> {
    let is_given_up = config.drop_texture
        && source
            .carried()
            .is_none_or(|carry| !carry.written().any(|p| p.property.name == crate::io::NUMBER));
    let Some(materials) = source.materials().filter(|_| !is_given_up) else {
        return Ok(Vec::new());
    };
    let kind = config.kind()?;
    let plan_for = |output: &PathBuf| {
        let request =
            TextureRequest { output, kind, mode: config.textures, force: config.job.force };
        plan_with_png(materials, &request, stage)
    };
    config.named_outputs().map(plan_for).collect()
}

/// Refuses a distance with every vertex where it has no place.
fn check_error_field(source: &MeshSource, config: &Config) -> Result<()> {
    if !config.error_field {
        return Ok(());
    }
    let kind = config.kind()?;
    if kind != OutputKind::Ply {
        let what = "--error-field: only PLY holds a number with every vertex; give an output that ends with .ply";
        return Err(Error::Usage(what.to_owned()));
    }
    if source.schema().properties.iter().any(|p| p.name == REACH) {
        let what = format!(
            "--error-field: the vertices of {} already have a property '{REACH}'; rename it, or leave the option out",
            source.path().display()
        );
        return Err(Error::Usage(what));
    }
    Ok(())
}

/// Refuses a progressive mesh where collapses are more than that, or where there is no finish to record.
fn check_recording(source: &MeshSource, plan: &Plan) -> Result<()> {
    refuse_seams(
        source,
        "--progressive: texture coordinates and what faces carry are not recorded",
    )?;
    if !plan.finish || plan.target >= plan.triangles_in {
        let what = format!(
            "--progressive: {} of {} triangles are reached without a finish that could be recorded; ask for fewer triangles, or \
             give larger cells (--cell-triangles)",
            plan.target, plan.triangles_in
        );
        return Err(Error::Usage(what));
    }
    Ok(())
}

/// Refuses what splits the vertices of a mesh.
fn refuse_seams(source: &MeshSource, why: &str) -> Result<()> {
    let codec = source.schema().codec();
    if codec.has_seams(source.schema()) || source.carried().is_some_and(|carry| carry.is_moved()) {
        return Err(Error::Usage(format!(
            "{why}; give them up with --texture none and --drop-faces, or texture coordinates at vertices with 'convert'"
        )));
    }
    Ok(())
}

/// Refuses a map where vertices have no numbers that a reader of the files would find again.
fn check_map(source: &MeshSource, config: &Config) -> Result<()> {
    refuse_seams(
        source,
        "--map: texture coordinates and what faces carry split vertices, which have several numbers then",
    )?;
    let kind = config.kind()?;
    if !matches!(kind, OutputKind::Ply | OutputKind::Obj) {
        let what = "--map: only PLY and OBJ have a list of vertices as the map counts them; give an output that ends with .ply";
        return Err(Error::Usage(what.to_owned()));
    }
    if source.parts().len() > 1 {
        let what = "--map: vertices of several files have no common numbers; make one mesh of them first, with 'convert'";
        return Err(Error::Usage(what.to_owned()));
    }
    Ok(())
}

/// Refuses labels that name nothing.
pub(super) fn check_labels(source: &MeshSource, labels: &[String]) -> Result<()> {
    let vertices = source.schema().properties.iter().map(|p| p.name.clone());
    let known: Vec<String> =
        vertices.chain(source.face_properties().into_iter().map(|p| p.name)).collect();
    let Some(unknown) = labels.iter().find(|label| !known.contains(label)) else { return Ok(()) };
    Err(Error::Usage(format!(
        "--label {unknown}: neither vertices nor faces have such a property; they have {}",
        if known.is_empty() { "none".to_owned() } else { known.join(", ") }
    )))
}
