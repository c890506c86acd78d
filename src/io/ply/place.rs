//! Places an open mesh: looks at all positions once, and notes what becomes of them as they leave the reader. Takes it out of a
//! folder that vanishes.

use super::placed::Placed;
use super::raw::Spool;
use super::source::MeshSource;
use super::{FaceBlock, VertexBlock};
use crate::globe::Crs;
use crate::sidecars::{CRS, Georeference, LIES_AT, UNKNOWN, crs_in, crs_of, lost_axes};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::placing::{Degrees, Placing, SUBTRACTED, offset_in, offset_of, offset_words};
use stonecut_system::error::Result;
use stonecut_system::losses::Loss;

/// Offsets of maps are larger, and meshes that count from them are smaller than this share of the offset.
const LEAST_FAR: f64 = 10_000.0;
const NEAR: f64 = 0.2;

impl MeshSource {
    /// A position of the file where it comes to lie.
    pub fn placed_point(&self, position: [f64; 3]) -> [f64; 3] {
        self.placed.as_ref().map_or(position, |placed| placed.point(position))
    }

    /// Places the mesh. Where the placing changes something, all vertices are read once for their bounds;
    /// to move the middle to the origin, all faces before them.
    ///
    /// Errors: those of reading; places that are not finite.
    pub fn place(&mut self, placing: &Placing) -> Result<()> {
        let placing = &placing.settled(self.file_format() == "glTF");
        self.note_axes(placing);
        let in_degrees = self.in_degrees(placing);
        if placing.is_none() && in_degrees.is_none() {
            return Ok(());
        }
        let schema = self.schema().clone();
        let needs_used = placing.recentres || in_degrees.is_some();
        let used = if needs_used { self.used_vertices()? } else { Vec::new() };
        let is_used =
            |v: u64| used.get((v / 64) as usize).is_none_or(|bits| bits >> (v % 64) & 1 == 1);
        let mut bounds = Bounds::EMPTY;
        self.each_vertex(|v, row| {
            if is_used(v) {
                bounds.add(placing.point(schema.position(row)));
            }
            Ok(())
        })?;
        let (mut placing, mut comments) = (placing.clone(), self.comments().to_vec());
        if let Some(crs) = self.degrees_named().filter(|_| !placing.keeps_lengths()) {
            comments.retain(|line| offset_of(line).is_none() && crs_of(line).is_none());
            self.note(Loss::remark(format!(
                "no longer degrees of {}: its name is left out",
                crs.name()
            )));
        }
        if let (Some((crs, is_y_up)), false) = (in_degrees, bounds.is_empty()) {
            let offset = offset_in(&comments).unwrap_or_default();
            let offset = placing.vector(offset).unwrap_or(offset);
            let found = crs.local(&bounds, offset, is_y_up).map_err(|what| {
                let advice = "give the code that its coordinates are of, and --translate or a file beside it for an offset";
                self.file.bad(format!("{what}; {advice}"))
            })?;
            placing.then(&found.map);
            let mut to_metres = Placing::default();
            to_metres.then(&found.map);
            bounds = bounds.map(|corner| to_metres.point(corner));
            comments.retain(|line| offset_of(line).is_none() && crs_of(line).is_none());
            comments.push(format!("{CRS}{}", found.place));
            let what =
                format!("degrees of {} become metres east and north of the middle", crs.name());
            self.note(Loss::remark(what));
            found.said.into_iter().for_each(|loss| self.staged.losses.lose(loss));
        }
        let placing = &placing;
        let Some(placed) = Placed::new(placing, schema, &bounds, &comments) else {
            return Err(self.file.bad(
                "its coordinates are not finite once it is placed; give a smaller --scale, --translate or --transform",
            ));
        };
        self.placed = Some(placed);
        Ok(())
    }

    /// The system of degrees that become metres, and whether y points upwards.
    fn in_degrees(&self, placing: &Placing) -> Option<(Crs, bool)> {
        let Degrees::Metres { system, is_y_up } = &placing.degrees else { return None };
        let crs = match system {
            Some(system) => Crs::of(system).ok().filter(Crs::is_geographic),
            None => self.degrees_named().filter(|_| placing.keeps_lengths()),
        }?;
        Some((crs, is_y_up.unwrap_or(self.file_format() == "glTF")))
    }

    /// The system of degrees that the mesh names.
    fn degrees_named(&self) -> Option<Crs> {
        crs_in(self.comments()).and_then(|system| Crs::of(&system).ok()).filter(Crs::is_geographic)
    }

    /// A bit for each vertex that a face uses; empty where there are no faces. Reads all faces.
    fn used_vertices(&self) -> Result<Vec<u64>> {
        if self.n_face_rows() == 0 {
            return Ok(Vec::new());
        }
        let mut used = vec![0u64; self.n_vertices().div_ceil(64) as usize];
        let mut faces = FaceBlock::default();
        for block in 0..self.n_face_blocks() {
            self.read_faces(block, &mut faces)?;
            for v in faces.triangles.iter().flatten() {
                if let Some(bits) = used.get_mut((v / 64) as usize) {
                    *bits |= 1 << (v % 64);
                }
            }
        }
        Ok(used)
    }

    /// Adds comments on the place of the mesh, out of files beside it.
    pub(crate) fn take_place(&mut self, comments: Vec<String>, files: &[PathBuf]) {
        self.header.comments.extend(comments);
        self.staged.beside.extend_from_slice(files);
    }

    /// The offset that was subtracted from the coordinates of the input, now or before, or that files beside it name.
    pub fn offset(&self) -> Option<[f64; 3]> {
        offset_in(self.comments())
    }

    /// Takes what the mesh names out of a folder that is going to vanish; `name` is what the folder is known by.
    ///
    /// Errors: an image that cannot be read, temporary data that cannot be written.
    pub(crate) fn leave_folder(&mut self, folder: &Path, name: &Path, spool: Spool) -> Result<()> {
        self.file.leave_folder(folder, name);
        self.staged.beside.clear();
        let (from, to) = (folder.to_string_lossy(), name.to_string_lossy());
        self.staged.losses.rename(&from, &to);
        self.staged.notes.iter_mut().for_each(|note| note.rename(&from, &to));
        if let Some(materials) = &mut self.staged.materials {
            Arc::make_mut(materials).leave_folder(folder, name, spool)?;
        }
        Ok(())
    }

    /// Takes the place that files beside a mesh name as if comments in it did, unless they do.
    pub(crate) fn locate(&mut self, mesh: &Path) -> Option<Georeference> {
        if crs_in(self.comments()).is_some() {
            return None;
        }
        let found = Georeference::beside(mesh);
        if found.as_ref().is_none_or(|found| found.crs.is_empty())
            && let Some(loss) = Georeference::broken_beside(mesh)
        {
            self.staged.losses.lose(loss);
        }
        let mut found = found?;
        if found.is_nowhere() {
            return Some(found);
        }
        let is_own = |line: &String| offset_of(line).is_some() && !line.contains(SUBTRACTED);
        if self.comments().iter().any(is_own) {
            found.offset = [0.0; 3];
        }
        // Maps have z upwards, glTF has y.
        let in_file = |[x, y, z]: [f64; 3]| match self.file_format() {
            "glTF" => [x, z, -y],
            _ => [x, y, z],
        };
        if self.lies_near(in_file(found.offset)) {
            found.offset = [0.0; 3];
        }
        let offset = in_file(found.offset);
        let crs = if found.crs.is_empty() { UNKNOWN } else { &found.crs };
        let mut comments = vec![format!("{CRS}{crs}")];
        if offset != [0.0; 3] {
            comments.push(format!("{} (of {})", offset_words(offset), found.names()));
        }
        self.take_place(comments, &found.found_in);
        Some(found)
    }

    /// Returns whether the mesh lies where an offset would take it: its coordinates have the offset already.
    fn lies_near(&self, offset: [f64; 3]) -> bool {
        let far = offset.into_iter().fold(0.0, |far: f64, x| far.max(x.abs()));
        let mut block = VertexBlock::default();
        if far < LEAST_FAR || self.n_vertices() == 0 || self.read_vertices(0, &mut block).is_err() {
            return false;
        }
        let schema = self.schema();
        let first = block.records.get(..schema.record_bytes()).map(|row| schema.position(row));
        first.is_some_and(|p| (0..3).all(|k| (p[k] - offset[k]).abs() <= NEAR * far))
    }

    /// Enters what becomes of the place on a map where axes stay as they are.
    fn note_axes(&mut self, placing: &Placing) {
        let lost = |is_glb| lost_axes(self.comments(), self.file_format() == "glTF", is_glb);
        if let Some(loss) = placing.keeps_axes.and_then(lost) {
            self.staged.losses.lose(loss);
        }
    }

    /// Adds the remark on the place that was found beside a mesh.
    pub(crate) fn note_place(&mut self, found: &Georeference) {
        if !found.is_nowhere() {
            self.note(Loss::remark(format!("{LIES_AT}{}", found.words())));
        }
    }

    /// The place that comments name, in the axes of the file.
    pub fn georeference(&self) -> Option<Georeference> {
        let (crs, offset) = (crs_in(self.comments()), self.offset());
        (crs.is_some() || offset.is_some()).then(|| Georeference {
            crs: crs.unwrap_or_default(),
            offset: offset.unwrap_or_default(),
            found_in: Vec::new(),
        })
    }
}
