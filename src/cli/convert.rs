//! `stonecut convert`: any mesh in, any mesh out, nothing changed but the format.
//!
//! Scalar properties of faces go with them. Two passes over the faces: the first counts triangles and notes
//! which vertices they use, the second writes them. Degenerate faces and repeated ones are dropped,
//! vertices that no face uses vanish; the order of all others stays. Memory: sorts within that of the command, a bit and
//! an eighth a vertex, a bit a triangle if any repeat, and a few blocks.

use super::answer::CommandEnd;
pub use super::converted::Converted;
use super::converted::{hold, plan, say, sort_bytes, stage_seconds, write_report};
pub use super::inputs::InOut;
use super::log::{Said, Show};
use super::session::{Command, Session};
use super::split::{self, Splitting};
use super::used::Used;
use crate::error::{Error, Offers, Result};
use crate::io::ply::{FaceBlock, FaceSchema, MeshSource, Place, ReadOptions, TexturedTriangle};
use crate::io::{
    DuplicateFinder, Duplicates, HardEdges, MeshSink, NameUse, OutputFormat, OutputKind,
    StageOptions, TextureMode, TexturePlan, TextureRequest, Weld, WeldOptions, check_range,
};
use crate::render::texture::plan_textures as plan_with_png;
use crate::system::disk::folder_of;
use crate::system::losses::{Ledger, Loss, LossKind};
use crate::system::paths::{Kind, Paths, Role};
use crate::system::pending_file::Seen;
use crate::system::progress::Progress;
use std::io::IsTerminal;
use std::path::PathBuf;

/// Converts a mesh between formats: PLY, STL, OBJ, GLB and glTF.
#[derive(Debug, clap::Args)]
pub struct Args {
    // Its own lines are its documentation.
    #[command(flatten)]
    #[allow(missing_docs)]
    pub paths: InOut,
    /// Words joined by commas: ascii, binary_little_endian or binary_big_endian; float or double
    /// coordinates (GLB: float instead of 16 bits an axis); int or uint indices; ply, stl, obj or glb.
    #[arg(long, value_name = "FORMAT", default_value = "")]
    pub format: OutputFormat,
    /// Overwrite an existing file.
    #[arg(long)]
    pub force: bool,
    /// Drop and count broken faces and vertices instead of failing.
    #[arg(long)]
    pub skip_bad: bool,
    /// Give up texture coordinates and materials of textured faces.
    #[arg(long)]
    pub drop_texture: bool,
    /// Give up names of objects and groups.
    #[arg(long)]
    pub drop_names: bool,
    // Options of several commands; their own lines are their documentation.
    #[command(flatten)]
    #[allow(missing_docs)]
    pub placing: super::placing::TypedPlacing,
    /// Texture images: copy (beside OUTPUT, unless they lie in its folder), link (named where they are), embed (GLB)
    /// or none [default: copy; embed for GLB].
    #[arg(long, value_name = "WHAT")]
    pub textures: Option<TextureMode>,
    /// Keep faces that repeat an earlier one; saves a sort.
    #[arg(long)]
    pub keep_duplicates: bool,
    /// Keep vertices that no face uses.
    #[arg(long)]
    pub keep_unreferenced: bool,
    /// Copies of vertices that become one: off, auto (copies within rounding, where a sample shows that there are some), or a
    /// distance in input units. Only open edges are joined [default: off; auto between several files].
    #[arg(long, value_name = "WHAT")]
    pub weld: Option<Weld>,
    /// One file for each label of faces, whose place in the name of OUTPUT is {label}: label (left and right of a face, or label,
    /// region, material, segment), or the name of a property. Each region of left and right is closed and faces outward.
    #[arg(long, value_name = "PROPERTY")]
    pub split: Option<String>,
    /// Folder for temporary data [default: the output's folder].
    #[arg(long, value_name = "DIR")]
    pub temp_dir: Option<PathBuf>,
    /// Memory to use: 4GiB or 50% [default: 75 % of what this process may use].
    #[arg(long, value_name = "SIZE", value_parser = super::arguments::parse_memory)]
    pub memory: Option<u64>,
    /// Write a report in JSON.
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,
}

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        self.format.check(&self.paths.output)?;
        if self.split.is_some() {
            split::check(&self.paths.output)?;
        }
        Ok(self
            .paths
            .input
            .add_to(Paths::new(self.force), "INPUT")?
            .with(Role::Output, "OUTPUT", &self.paths.output)
            .with_option(Role::Side(Kind::Report), "--report", self.report.as_ref())
            .with_option(Role::TempDir, "--temp-dir", self.temp_dir.as_ref()))
    }

    fn offers(&self) -> Offers {
        Offers { resumes: false, temp_dir: true }
    }

    /// The exit code tells whether broken faces were dropped.
    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        let report_to = self.report.as_deref().map(Seen::new);
        // Lines only where they are asked for: most conversions are over in a moment.
        let shows = session.talk.progress != Show::Auto || std::io::stderr().is_terminal();
        let ready = match shows {
            true => session.watch_reading(self.paths.input.files(), || open(self)),
            false => open(self),
        }?;
        let plan = ready.plan(self)?;
        session.log.plan(Vec::new(), &plan);
        let progress = session.progress;
        progress.expect(stage_seconds(&ready.source, self.format.check(&self.paths.output)?));
        let work = || ready.convert(self, progress);
        let done = if shows { session.watch(work) } else { work() }?;
        say(&self.paths.output, &done, &mut Said(session.log));
        let report =
            write_report(report_to.as_ref(), [&*self.paths.input, &self.paths.output], &done)?;
        CommandEnd::of(&report, done.is_short())
    }
}

/// Converts; the library's own entry.
///
/// Errors: paths that clash or cannot be used, broken faces without `skip_bad`, a mesh of which no triangle is left.
pub fn convert(args: &Args) -> Result<Converted> {
    args.paths()?.check()?;
    open(args)?.convert(args, &Progress::default())
}

/// An input that is open, and what was decided about it.
struct Ready {
    source: MeshSource,
    texture: bool,
    textures: Option<TexturePlan>,
    temp_dir: PathBuf,
    memory_bytes: u64,
    recentres: bool,
}

fn open(args: &Args) -> Result<Ready> {
    let to_stdout = args.paths.output == std::path::Path::new("-");
    let folder = args.temp_dir.clone().unwrap_or_else(|| match to_stdout {
        true => std::env::temp_dir(),
        false => folder_of(&args.paths.output).to_path_buf(),
    });
    let placing = args.placing.placing(args.format.check(&args.paths.output)?)?;
    let recentres = placing.recentres;
    let names = if args.drop_names { NameUse::GivenUp("") } else { NameUse::Carried };
    let read = ReadOptions { skip_bad: args.skip_bad, placing, temp_dir: None, names };
    let memory_bytes = super::arguments::memory_budget(args.memory);
    let mut stage = StageOptions { read, ..StageOptions::new(folder) }.within(memory_bytes);
    let how = args.weld.unwrap_or(if args.paths.input.is_one() { Weld::Off } else { Weld::Auto });
    stage.weld =
        Some(WeldOptions { how, exact_above: 0, labels: Vec::new(), keeps_numbers: false });
    stage.hard_edges = match (how, args.format.check(&args.paths.output)?) {
        (_, OutputKind::Stl) => HardEdges::Unused,
        (Weld::Off, _) => HardEdges::Kept,
        _ => HardEdges::Averaged("--weld off keeps them apart"),
    };
    stage.bare_as_material = args.format.check(&args.paths.output)? == OutputKind::Ply;
    let source = MeshSource::open_staged(&args.paths.input, &stage)?;
    source.refuse_output(&args.paths.output)?;
    hold(&source, memory_bytes)?;
    let texture = !args.drop_texture && source.has_corner_texture();
    if !args.drop_texture && !texture {
        source.require_no_texture()?;
    }
    check_range(&source, &args.paths.output, args.format)?;
    let textures = plan_textures(&source, args, &stage)?;
    let temp_dir = stage.temp_dir;
    Ok(Ready { source, texture, textures, temp_dir, memory_bytes, recentres })
}

impl Ready {
    fn plan(&self, args: &Args) -> Result<serde_json::Value> {
        let properties = self.source.face_properties();
        let faces = FaceSchema { texture: self.texture, properties };
        let images = self.textures.as_ref().map_or(0, |textures| textures.bytes);
        let format = (args.format.check(&args.paths.output)?, args.format);
        Ok(plan(&self.source, &faces, images, format))
    }

    fn convert(self, args: &Args, progress: &Progress) -> Result<Converted> {
        if let Some(property) = &args.split {
            let how = Splitting {
                source: &self.source,
                input: &args.paths.input,
                output: &args.paths.output,
                property,
                format: args.format,
                force: args.force,
                report: args.report.as_ref(),
                temp_dir: &self.temp_dir,
                memory_bytes: self.memory_bytes,
                losses: losses(&self.source, self.recentres)?,
                texture: self.texture,
            };
            return split::split(&how, progress);
        }
        let Ready { source, texture, textures, temp_dir, memory_bytes, recentres } = self;
        // Above 2^32 vertices no output can be written, so there is nothing to look for.
        let look = !args.keep_duplicates && source.n_vertices() <= 1 << 32;
        let mut finder = look.then(|| DuplicateFinder::new(&temp_dir, sort_bytes(memory_bytes)));
        let (inputs, weld) = (source.parts().to_vec(), source.weld().cloned());
        let mut done = Converted { inputs, weld, ..Converted::default() };
        let keeps_all = source.n_face_rows() == 0 || args.keep_unreferenced;
        let start = if keeps_all { Used::all } else { Used::none };
        let mut used = start(source.n_vertices());
        used.survey(&source, finder.as_mut(), &mut done, progress)?;
        let duplicates = match finder {
            Some(finder) => finder.finish()?,
            None => Duplicates::default(),
        };
        done.n_duplicate = duplicates.count();
        done.n_triangles -= done.n_duplicate;
        if done.n_triangles == 0 && source.n_face_rows() > 0 {
            let what = format!(
                "none of its {} faces has three different corners; nothing was written",
                source.n_face_rows()
            );
            return Err(Error::bad_input(&*args.paths.input, what));
        }
        if done.n_triangles == 0 && source.n_vertices() == 0 {
            let what = "it has neither faces nor vertices; nothing was written";
            return Err(Error::bad_input(&*args.paths.input, what));
        }
        done.losses = losses(&source, recentres)?;
        let input = ConvertInput {
            source: &source,
            duplicates: &duplicates,
            texture,
            textures,
            memory_bytes,
        };
        used.write(&input, args, &mut done, progress)?;
        let faults = source.faults();
        progress.lose_all(&done.losses);
        done.n_bad += faults.missing_faces + faults.missing_vertices + faults.bad_faces;
        Ok(done)
    }
}

/// Parts of the input that no output has, and remarks.
fn losses(source: &MeshSource, recentres: bool) -> Result<Ledger> {
    let mut losses = source.losses();
    source.remarks()?.into_iter().for_each(|remark| losses.lose(remark));
    if let Some([x, y, z]) = source.offset().filter(|_| recentres) {
        let why = format!("{x} {y} {z} was subtracted from all coordinates");
        losses.lose(Loss::new(LossKind::Precision, "places", why).notice());
    }
    Ok(losses)
}

/// Looks at every image and decides what becomes of it.
fn plan_textures(
    source: &MeshSource,
    args: &Args,
    stage: &StageOptions,
) -> Result<Option<TexturePlan>> {
    let is_given_up = args.drop_texture && source.has_corner_texture();
    let Some(materials) = source.materials().filter(|_| !is_given_up) else { return Ok(None) };
    let (output, kind) = (args.paths.output.as_path(), args.format.check(&args.paths.output)?);
    let request = TextureRequest { output, kind, mode: args.textures, force: args.force };
    plan_with_png(materials, &request, stage).map(Some)
}

/// The mesh that is written.
struct ConvertInput<'a> {
    source: &'a MeshSource,
    duplicates: &'a Duplicates,
    /// True if texture coordinates at corners are written.
    texture: bool,
    textures: Option<TexturePlan>,
    memory_bytes: u64,
}

impl Used {
    /// The first pass over the faces.
    fn survey(
        &mut self,
        source: &MeshSource,
        mut finder: Option<&mut DuplicateFinder>,
        done: &mut Converted,
        progress: &Progress,
    ) -> Result<()> {
        progress.begin("survey", 1, 2, source.n_triangles());
        source.each_face_block(|block| {
            progress.check()?;
            progress.add(block.triangles.len() as u64);
            done.n_triangles += block.triangles.len() as u64;
            done.n_degenerate += block.n_degenerate;
            done.n_bad += block.n_bad;
            if let Some(finder) = finder.as_deref_mut() {
                block.triangles.iter().try_for_each(|&t| finder.push(t))?;
            }
            block.triangles.as_flattened().iter().for_each(|&vertex| self.mark(vertex));
            Ok(())
        })?;
        done.n_vertices = self.count();
        done.n_unreferenced = self.n_vertices - done.n_vertices;
        Ok(())
    }

    fn write(
        &self,
        input: &ConvertInput,
        args: &Args,
        done: &mut Converted,
        progress: &Progress,
    ) -> Result<()> {
        let ConvertInput { source, duplicates, .. } = *input;
        let mut header =
            source.kept_header(source.schema().clone(), done.n_vertices, done.n_triangles);
        header.settings = "convert".to_owned();
        header.sort_memory_bytes = header.sort_memory_bytes.min(sort_bytes(input.memory_bytes));
        header.faces = FaceSchema { texture: input.texture, properties: source.face_properties() };
        header.textures.clone_from(&input.textures);
        let is_full = !header.faces.is_empty();
        let place = Place { replace: args.force, ..Place::from(&args.paths.output) };
        let mut sink = MeshSink::create(place, header, args.format)?;
        let all = done.n_unreferenced == 0;
        progress.begin("convert", 2, 2, done.n_triangles);
        // Vertices are half of it.
        let half = done.n_triangles / 2;
        let n_blocks = source.n_vertex_blocks().max(1);
        self.write_vertices(source, all, &mut sink, || {
            progress.add(half / n_blocks);
            progress.check()
        })?;
        if is_full {
            return self.write_full_faces(input, sink, done, progress);
        }
        let mut place = 0;
        source.each_face_block(|block| {
            progress.check()?;
            progress.add(block.triangles.len() as u64 / 2);
            if duplicates.count() > 0 {
                block.triangles.retain(|_| {
                    place += 1;
                    !duplicates.contains(place - 1)
                });
            }
            if !all {
                for vertex in block.triangles.as_flattened_mut() {
                    *vertex = self.new_id(*vertex);
                }
            }
            sink.write_faces(&block.triangles)
        })?;
        progress.check()?;
        done.losses.merge(&sink.losses());
        done.n_bytes = sink.finish()?;
        Ok(())
    }

    /// The second pass over faces with properties: their rows beside their triangles, block by block.
    fn write_full_faces(
        &self,
        input: &ConvertInput,
        mut sink: MeshSink,
        done: &mut Converted,
        progress: &Progress,
    ) -> Result<()> {
        let source = input.source;
        let value_bytes: usize = source.face_properties().iter().map(|p| p.scalar.bytes()).sum();
        let mut blocks = FullBlocks {
            used: self,
            input,
            value_bytes,
            place: 0,
            index: 0,
            values: Vec::new(),
            corners: Vec::new(),
            ends: Vec::new(),
        };
        source.each_full_face(|row, face| {
            while blocks.index + 1 < source.n_face_blocks()
                && row >= source.first_row(blocks.index + 1)
            {
                progress.check()?;
                blocks.write(&mut sink)?;
            }
            // Rows without a face keep their place.
            let place = (row - source.first_row(blocks.index)) as usize;
            blocks.values.resize(place * value_bytes, 0);
            blocks.values.extend_from_slice(&face.values);
            if input.texture {
                blocks.ends.resize(place, blocks.corners.len());
                blocks
                    .corners
                    .extend(face.corners.iter().copied().zip(face.texture.iter().copied()));
                blocks.ends.push(blocks.corners.len());
            }
            Ok(())
        })?;
        while blocks.index < source.n_face_blocks() {
            progress.check()?;
            blocks.write(&mut sink)?;
        }
        done.losses.merge(&sink.losses());
        done.n_bytes = sink.finish()?;
        Ok(())
    }
}

/// Blocks of faces on their way to the output, with what their rows carry.
struct FullBlocks<'a> {
    used: &'a Used,
    input: &'a ConvertInput<'a>,
    value_bytes: usize,
    /// Triangles so far, dropped ones included.
    place: u64,
    index: u64,
    /// Of the rows of block `index`.
    values: Vec<u8>,
    /// Corners of these rows with their coordinates, and the end of each row's.
    corners: Vec<(u64, [f32; 2])>,
    ends: Vec<usize>,
}

impl FullBlocks<'_> {
    fn write(&mut self, sink: &mut MeshSink) -> Result<()> {
        let mut block = FaceBlock::default();
        let ConvertInput { source, duplicates, texture: has_texture, .. } = *self.input;
        source.read_faces_with_rows(self.index, &mut block)?;
        let (mut triangles, mut values) = (Vec::new(), Vec::new());
        for (triangle, &row) in block.triangles.iter().zip(&block.rows) {
            self.place += 1;
            if duplicates.count() > 0 && duplicates.contains(self.place - 1) {
                continue;
            }
            let texture = if has_texture {
                self.texture(*triangle, row as usize)
            } else {
                Default::default()
            };
            let corners = triangle.map(|v| self.used.new_id(v));
            triangles.push(TexturedTriangle { corners, texture, ..TexturedTriangle::default() });
            let at = row as usize * self.value_bytes;
            values.extend_from_slice(&self.values[at..at + self.value_bytes]);
        }
        self.values.clear();
        self.corners.clear();
        self.ends.clear();
        self.index += 1;
        sink.write_full_faces(&triangles, &values)
    }

    /// The coordinates of a triangle of a row: each corner has those of the row's corner at the same vertex.
    fn texture(&self, triangle: [u64; 3], row: usize) -> [[f32; 2]; 3] {
        let start = if row == 0 { 0 } else { self.ends[row - 1] };
        let own = &self.corners[start..self.ends[row]];
        triangle.map(|v| own.iter().find(|(id, _)| *id == v).map_or([0.0; 2], |(_, uv)| *uv))
    }
}
