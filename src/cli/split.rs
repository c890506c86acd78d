//! `convert --split`: a mesh for each label of faces, in one pass over the input and a sort of its faces on disk.
//!
//! A wall with `left` and `right` goes into the meshes of both regions, turned so that each is closed and faces outward. All
//! outputs are known, and checked as one table, before the first is written. Faces that repeat stay: two regions may have one each.
//! Memory: sorts, a bit and an eighth a vertex, and a spool of 16 MiB. Where a label's vertices lie all over the file, its blocks are
//! read again for each label.

use super::converted::{Converted, SplitFile, sort_bytes};
use super::used::Used;
use crate::error::{Error, Result};
use crate::io::ply::raw::Spool;
use crate::io::ply::{MeshSource, Place};
use crate::io::{ExternalSort, FaceLabels, InputPaths, MeshSink, OutputFormat, SIDES, halves};
use crate::system::losses::{Ledger, Loss, LossKind};
use crate::system::paths::{Kind, Paths, Role};
use crate::system::progress::Progress;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Most files of one conversion.
const MOST_FILES: usize = 4096;

/// The place of the label in the name of the output.
const MARK: &str = "{label}";

/// Bytes of a face on its way.
const FACE_BYTES: usize = 12;
/// Faces that are read back at a time.
const CHUNK: usize = 1 << 16;

/// An open input, and the words that were typed.
pub(super) struct Splitting<'a> {
    pub(super) source: &'a MeshSource,
    pub(super) input: &'a InputPaths,
    /// With the place for a label in its name.
    pub(super) output: &'a Path,
    pub(super) property: &'a str,
    pub(super) format: OutputFormat,
    pub(super) force: bool,
    pub(super) report: Option<&'a PathBuf>,
    pub(super) temp_dir: &'a Path,
    pub(super) memory_bytes: u64,
    /// Parts of the input that no output has.
    pub(super) losses: Ledger,
    /// True if faces have texture coordinates that were not given up.
    pub(super) texture: bool,
}

/// Refuses an output without the one place for a label.
pub(super) fn check(output: &Path) -> Result<()> {
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    let whole = output.to_string_lossy();
    if [&name, &whole].map(|s| s.matches(MARK).count()) == [1, 1] {
        return Ok(());
    }
    Err(Error::Usage(format!(
        "{}: --split writes a file for each label; name OUTPUT with {MARK} once, as out/{MARK}.stl",
        output.display()
    )))
}

fn path_of(output: &Path, label: i64) -> PathBuf {
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    output.with_file_name(name.replace(MARK, &label.to_string()))
}

/// The labels that were asked for.
fn labels_of(source: &MeshSource, property: &str) -> Result<FaceLabels> {
    let typed = match SIDES.contains(&property) {
        true => FaceLabels::named(source, &SIDES),
        false => FaceLabels::named(source, &[property]),
    };
    let usual = || if property == "label" { FaceLabels::of(source) } else { None };
    typed.or_else(usual).ok_or_else(|| {
        let names: Vec<String> = source.face_properties().into_iter().map(|p| p.name).collect();
        let have = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        Error::Usage(format!(
            "--split {property}: faces have no such labels in whole numbers; properties of faces: {have}"
        ))
    })
}

/// Writes all labels.
pub(super) fn split(how: &Splitting, progress: &Progress) -> Result<Converted> {
    let Splitting { source, property, .. } = *how;
    let labels = labels_of(source, property)?;
    if how.texture {
        let what = "--split carries no texture coordinates; give --drop-texture to go without";
        return Err(Error::Usage(what.to_owned()));
    }
    if source.n_vertices() > 1 << 32 {
        return Err(Error::Usage("--split: the mesh has more than 2^32 vertices".to_owned()));
    }
    let mut done = Converted {
        inputs: source.parts().to_vec(),
        weld: source.weld().cloned(),
        losses: how.losses.clone(),
        ..Converted::default()
    };
    let mut faces = ExternalSort::<6>::new(how.temp_dir, sort_bytes(how.memory_bytes));
    let mut numbers: HashMap<i64, u32> = HashMap::new();
    let mut files: Vec<SplitFile> = Vec::new();
    let (mut at, mut n_within) = (0, 0);
    progress.begin("survey", 1, 2, source.n_triangles());
    labels.each_block(source, |block, sides| {
        progress.check()?;
        progress.add(block.triangles.len() as u64);
        done.n_degenerate += block.n_degenerate;
        done.n_bad += block.n_bad;
        for (corners, &[behind, before]) in block.triangles.iter().zip(sides) {
            at += 1;
            if behind == before {
                n_within += u64::from(behind.is_some());
                continue;
            }
            let [a, b, c] = corners.map(|v| v as u32);
            let [high, low] = halves(at);
            for (label, [a, b, c]) in [(behind, [a, b, c]), (before, [a, c, b])] {
                let Some(label) = label else { continue };
                let next = files.len() as u32;
                let number = *numbers.entry(label).or_insert(next);
                if number == next {
                    files.push(SplitFile {
                        label,
                        path: path_of(how.output, label),
                        ..SplitFile::default()
                    });
                    if files.len() > MOST_FILES {
                        return Err(Error::Usage(format!(
                            "--split {property}: more than {MOST_FILES} labels; nothing was written"
                        )));
                    }
                }
                files[number as usize].triangles += 1;
                faces.push([number, high, low, a, b, c])?;
            }
        }
        Ok(())
    })?;
    if files.is_empty() {
        let what = "no face has a label; nothing was written";
        return Err(Error::bad_input(&**how.input, what));
    }
    check_paths(how, &files)?;
    lose_properties(&mut done, source, &labels, n_within);
    let all = files.iter().map(|file| file.triangles).sum();
    progress.begin("convert", 2, 2, all);
    let mut writer = LabelFiles { how, progress, done, files, open: None };
    faces.drain(|[number, _, _, a, b, c]| writer.take(number as usize, [a, b, c]))?;
    let LabelFiles { mut done, mut files, .. } = writer.close()?;
    progress.lose_all(&done.losses);
    let faults = source.faults();
    done.n_bad += faults.missing_faces + faults.missing_vertices + faults.bad_faces;
    files.sort_by_key(|file| file.label);
    done.files = files;
    Ok(done)
}

/// Checks all outputs as if they had been typed.
fn check_paths(how: &Splitting, files: &[SplitFile]) -> Result<()> {
    let mut paths = how.input.add_to(Paths::new(how.force), "INPUT")?.with_option(
        Role::Side(Kind::Report),
        "--report",
        how.report,
    );
    for file in files {
        paths = paths.with(Role::Output, "OUTPUT", &file.path);
    }
    paths.check()
}

/// Names what faces had besides their labels.
fn lose_properties(done: &mut Converted, source: &MeshSource, labels: &FaceLabels, n_within: u64) {
    let names: Vec<String> = source.face_properties().into_iter().map(|p| p.name).collect();
    let lost: Vec<&str> =
        names.iter().filter(|name| !labels.names.contains(name)).map(String::as_str).collect();
    if !lost.is_empty() {
        let what = format!("properties of faces ({})", lost.join(", "));
        done.losses.lose(Loss::new(LossKind::Attributes, what, "not carried by --split"));
    }
    if n_within > 0 {
        let what = "faces with the same region on both sides";
        let loss = Loss::new(LossKind::Geometry, what, "they bound no region");
        done.losses.lose(loss.count(n_within));
    }
}

/// The file under way: its number, its vertices and its faces.
struct OpenFile {
    number: usize,
    used: Used,
    corners: Spool,
}

/// Writes one file after the other.
struct LabelFiles<'a> {
    how: &'a Splitting<'a>,
    progress: &'a Progress,
    done: Converted,
    files: Vec<SplitFile>,
    open: Option<OpenFile>,
}

impl LabelFiles<'_> {
    /// Adds a face of a file; those of one file come one after the other.
    fn take(&mut self, number: usize, corners: [u32; 3]) -> Result<()> {
        if self.open.as_ref().is_none_or(|open| open.number != number) {
            self.finish()?;
        }
        let open = self.open.get_or_insert_with(|| OpenFile {
            number,
            used: Used::none(self.how.source.n_vertices()),
            corners: Spool::new(self.how.temp_dir),
        });
        corners.iter().for_each(|&v| open.used.mark(u64::from(v)));
        corners.iter().try_for_each(|v| open.corners.write(&v.to_le_bytes()))
    }

    /// Writes the last file.
    fn close(mut self) -> Result<Self> {
        self.finish()?;
        Ok(self)
    }

    fn finish(&mut self) -> Result<()> {
        let Some(OpenFile { number, mut used, corners }) = self.open.take() else { return Ok(()) };
        let source = self.how.source;
        let file = &mut self.files[number];
        file.vertices = used.count();
        let mut header = source.kept_header(source.schema().clone(), file.vertices, file.triangles);
        header.settings = "convert --split".to_owned();
        header.sort_memory_bytes = header.sort_memory_bytes.min(sort_bytes(self.how.memory_bytes));
        let place = Place { replace: self.how.force, ..Place::from(&file.path) };
        let mut sink = MeshSink::create(place, header, self.how.format)?;
        used.write_vertices(source, false, &mut sink, || self.progress.check())?;
        let corners = corners.finish(self.how.temp_dir)?;
        corners.each_piece(0..corners.len(), CHUNK * FACE_BYTES, |bytes| {
            self.progress.check()?;
            let number =
                |bytes: &[u8]| bytes.iter().rev().fold(0, |v, byte| v << 8 | u64::from(*byte));
            let faces = bytes.chunks_exact(FACE_BYTES);
            let faces: Vec<[u64; 3]> = faces
                .map(|face| [0, 4, 8].map(|at| used.new_id(number(&face[at..at + 4]))))
                .collect();
            sink.write_faces(&faces)?;
            self.progress.add(faces.len() as u64);
            Ok(())
        })?;
        self.done.losses.merge(&sink.losses());
        file.bytes = sink.finish()?;
        self.done.n_vertices += file.vertices;
        self.done.n_triangles += file.triangles;
        self.done.n_bytes += file.bytes;
        Ok(())
    }
}
