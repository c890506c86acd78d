//! Writes a result with a new texture: its shape, the bake, and the output with the new pages.
//!
//! The shape is a PLY file in the job folder, as it would be written without a texture; the bake is sealed like any stage.
//! So a run that dies while it bakes, or after that, goes on from there.

use super::SimplifyRun;
use super::write::require_written;
use crate::bake::{self, BakeReport, Baked, Corner, NormalSource, TANGENT_BYTES};
use crate::error::{Error, Result};
use crate::io::materials::all_missing;
use crate::io::materials::{Alpha, Image, ImageData, Map, MapKind, Material, Materials, Part};
use crate::io::ply::raw::RawFile;
use crate::io::ply::row_window::RowWindow;
use crate::io::ply::{Encoding, MeshSource, OutputHeader, Place, ReadOptions, TexturedTriangle};
use crate::io::{
    MeshSink, NUMBER, NameUse, OutputFormat, OutputKind, StageOptions, TexturePlan, TextureRequest,
    hidden_colours,
};
use crate::mesh::colours::ColourPlace;
use crate::mesh::property::{Property, Scalar};
use crate::mesh::record::VertexSchema;
use crate::pipeline::run_report::TextureReport;
use crate::stages::write::{self, Written};
use crate::store::cells::SurvivorInfo;
use crate::store::job::fingerprint::unchanged;
use crate::system::losses::{Loss, LossKind};
use crate::system::units::{show_bytes, show_count};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Faces that go to the file together.
const CHUNK: usize = 65_536;

impl SimplifyRun<'_> {
    /// Makes a new texture for the result of the level at work, and writes both.
    pub(super) fn write_baked(&mut self, result: &SurvivorInfo) -> Result<Written> {
        let written_key = format!("written {}", self.level);
        let path = self.output().to_path_buf();
        if let Some(written) = self.run.job.outcome::<Written>(&written_key)? {
            require_written(&path, written, self.run.job.folder())?;
            return Ok(written);
        }
        let shape = self.run.job.path(&format!("shape-{}.part", self.level));
        let baked = self.bake(result, &shape)?;
        self.run.progress.lose_all(&baked.report.losses);
        let BakeReport { charts, pages, texel_density, original_texel_density, .. } = &baked.report;
        let of_original = original_texel_density
            .map_or_else(String::new, |density| format!("; the input has {density:.4}"));
        self.run.progress.note(format!(
            "texture {} charts on {pages} pages, {texel_density:.4} texels per unit of length{of_original}",
            show_count(*charts)
        ));
        if let Some(normals) = &baked.report.normals {
            let source = match normals.source {
                NormalSource::Input => "those of the input's vertices",
                NormalSource::Faces => "computed from the input's faces",
            };
            self.run.progress.note(format!(
                "normal maps of {}, {source}, {:.1} degrees from the result's own in the mean",
                show_bytes(normals.bytes),
                normals.mean_degrees
            ));
        }
        for bake::MapReport { kind, bytes } in &baked.report.maps {
            self.run.progress.note(format!("texture of {kind}, {}", show_bytes(*bytes)));
        }
        let (written, plan) = self
            .as_write_stage(result.triangles, |stages| stages.write_with_pages(&shape, &baked))?;
        if self.level < self.config.coarser.len() {
            self.run.job.record(&written_key, &written)?;
        }
        let mut textures = TextureReport::of(&plan);
        textures.notes.splice(0..0, baked.report.notes.iter().cloned());
        if self.prepared.source.materials().is_some_and(|materials| materials.lacks_images()) {
            textures.lacks_images = true;
            let n = textures.images as usize;
            self.run.progress.lose(all_missing(n));
        }
        (self.texture_report, self.bake_report) = (Some(textures), Some(baked.report));
        Ok(written)
    }

    /// The stage that makes the texture.
    fn bake(&mut self, result: &SurvivorInfo, shape: &Path) -> Result<Baked> {
        let (config, level, marks) = (self.config, self.level, &self.prepared.marks);
        let pack = self.survivors(result.clone())?;
        let options = crate::pipeline::bake::options(config)?;
        let kind = Some(OutputKind::Ply);
        let encoding = Some(Encoding::BinaryLittleEndian);
        let format = OutputFormat { kind, encoding, ..OutputFormat::default() };
        let (header, form) = self.form(format);
        let n = result.triangles;
        self.stages.stage(
            (&format!("bake {level}"), "bake"),
            n,
            |_| n,
            |run| {
                // What a bake that was killed has left.
                run.job.clear_scratch()?;
                let place =
                    Place { path: shape.to_path_buf(), disk: run.disk().clone(), replace: true };
                write::write(&pack, place, header, form, run)?;
                let shape = MeshSource::open(shape)?;
                // The shape has the names.
                let read = ReadOptions { names: NameUse::Ignored, ..config.read_options() };
                let stage = StageOptions {
                    read,
                    memory_bytes: run.memory_bytes / 2,
                    disk: run.disk().clone(),
                    ..StageOptions::new(run.job.folder())
                };
                let name = run.job.name(&format!("bake-{level}"));
                let baked = MeshSource::open_staged(&config.input, &stage).and_then(|original| {
                    bake::bake(&shape, original, &options, (run.job.folder(), &name), run.into())
                });
                unchanged(&config.input, marks, baked)
            },
        )
    }

    /// Writes the output: the shape with the new coordinates, materials and images.
    fn write_with_pages(&self, shape: &Path, baked: &Baked) -> Result<(Written, TexturePlan)> {
        let source = &self.prepared.source;
        let (path, config) = (self.output().to_path_buf(), self.config);
        let shape = MeshSource::open(shape)?;
        let beside = if self.level == 0 { &config.textures_beside } else { &path };
        let stem = beside.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let request = TextureRequest {
            output: beside,
            kind: self.config.kind()?,
            // KTX2 of a new texture is in the pages, which are GLB's then.
            mode: config.textures.filter(|mode| !mode.is_ktx2()),
            force: config.job.force,
        };
        let plan = TexturePlan::new(Arc::new(materials_of(baked, &stem)?), &request)?;
        if baked.holds_vertex_colours {
            source.clamped_colours().into_iter().for_each(|loss| self.run.progress.lose(loss));
        }
        let (is_glb, hides) =
            (self.config.kind()? == OutputKind::Glb, source.images_hide_colours());
        let is_doubled = match baked.holds_vertex_colours {
            true => is_glb || !hides,
            false => is_glb && hides,
        };
        if is_doubled && ColourPlace::find(shape.schema()).is_some() {
            if !baked.holds_vertex_colours {
                self.run.progress.lose(hidden_colours());
            } else if !is_glb {
                let loss = Loss::new(LossKind::Colors, "colours of vertices", bake::IN_TEXTURE);
                self.run.progress.lose(loss.notice());
            }
        }
        let (schema, kept) = written_properties(shape.schema(), is_doubled);
        let mut header = shape.kept_header(schema, shape.n_vertices(), shape.n_face_rows());
        header.comments.retain(|line| !line.starts_with("stonecut "));
        header.settings = OutputHeader::line_of(&config.settings_of_level(self.level));
        header.faces.texture = true;
        header.images_hide_colours = source.images_hide_colours();
        header.has_tangents = baked.tangents.is_some();
        header.faces.properties = shape.face_properties();
        header.faces.properties.push(Property::new(NUMBER, Scalar::I32));
        header.textures = Some(plan.clone());
        header.sort_memory_bytes = write::sort_memory_bytes(&self.run);
        let (disk, replace) = (self.run.disk().clone(), config.job.force);
        let format = OutputFormat { kind: Some(self.config.kind()?), ..config.format };
        let mut sink = MeshSink::create(Place { path, disk, replace }, header, format)?;
        shape.each_vertex_block(|block| {
            self.run.progress.check()?;
            let records = block.records.chunks_exact(shape.schema().record_bytes());
            let bytes =
                records.flat_map(|record| kept.iter().flat_map(|range| &record[range.clone()]));
            sink.write_vertices(&bytes.copied().collect::<Vec<u8>>())
        })?;
        let n_rows = shape.n_face_rows();
        let mut corners = records(&baked.corners, n_rows, Corner::BYTES)?;
        let mut tangents = match &baked.tangents {
            Some(path) => Some(records(path, n_rows, TANGENT_BYTES)?),
            None => None,
        };
        let (mut faces, mut values) = (Vec::new(), Vec::new());
        shape.each_full_face(|row, face| {
            let at = row as usize % CHUNK;
            if at == 0 {
                self.run.progress.check()?;
                sink.write_full_faces(&faces, &values)?;
                faces.clear();
                values.clear();
            }
            let corner = Corner::read(corners.get(row)?.try_into().expect("a whole record"));
            let tangents = match &mut tangents {
                Some(tangents) => tangents_of(tangents.get(row)?),
                None => [[0; 4]; 3],
            };
            let Some(&ids) = face.corners.first_chunk::<3>() else {
                return Err(Error::Internal("a face of a result is not a triangle".to_owned()));
            };
            faces.push(TexturedTriangle { corners: ids, texture: corner.uv, tangents });
            values.extend_from_slice(&face.values);
            values.extend_from_slice(&(corner.part as i32).to_le_bytes());
            Ok(())
        })?;
        sink.write_full_faces(&faces, &values)?;
        let (vertices, triangles) = (shape.n_vertices(), shape.n_face_rows());
        self.run.progress.lose_all(&sink.losses());
        Ok((Written { vertices, triangles, bytes: sink.finish()? }, plan))
    }
}

/// The properties of vertices that are written, and their places in records of `schema`.
///
/// Some viewers, and all of glTF, multiply colours of vertices with images: colours that the pages hold or hide leave their vertices (`is_doubled`).
fn written_properties(
    schema: &VertexSchema,
    is_doubled: bool,
) -> (VertexSchema, Vec<Range<usize>>) {
    const COLOURS: [[&str; 3]; 3] = [
        ["red", "green", "blue"],
        ["diffuse_red", "diffuse_green", "diffuse_blue"],
        ["r", "g", "b"],
    ];
    let has_all = |names: &&[&str; 3]| names.iter().all(|name| schema.own_property(name).is_some());
    let dropped = COLOURS.iter().find(has_all).filter(|_| is_doubled);
    let mut out = VertexSchema { coordinate: schema.coordinate, properties: Vec::new() };
    let mut at = schema.position_bytes();
    let mut kept: Vec<_> = std::iter::once(0..at).collect();
    for property in &schema.properties {
        let end = at + property.scalar.bytes();
        if !dropped.is_some_and(|names| names.contains(&property.name.as_str())) {
            kept.push(at..end);
            out.properties.push(property.clone());
        }
        at = end;
    }
    (out, kept)
}

/// Records of `n_bytes` in a file, one a triangle.
fn records(path: &Path, n_rows: u64, n_bytes: usize) -> Result<RowWindow> {
    let file = RawFile::open(path)?;
    if file.len() != n_rows * n_bytes as u64 {
        return Err(Error::corrupt(path, "has another length; run again with --restart"));
    }
    Ok(RowWindow::new(file, n_bytes))
}

fn tangents_of(bytes: &[u8]) -> [[i16; 4]; 3] {
    let number = |i: usize| i16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]);
    [0, 4, 8].map(|i| [number(i), number(i + 1), number(i + 2), number(i + 3)])
}

/// A material for each part of a page.
fn materials_of(baked: &Baked, stem: &str) -> Result<Materials> {
    let mut out = Materials::default();
    let finish = &baked.finish;
    let mut images = BTreeMap::new();
    for part in &baked.parts {
        let number = part.page as usize;
        let name = format!("{stem}_{number}");
        let mut maps = Vec::new();
        let first: [(_, &[MapKind], _); 2] =
            [(&baked.pages, &[MapKind::Base], ""), (&baked.normals, &[MapKind::Normal], "_normal")];
        let others = baked.maps.iter();
        let others = others.map(|map| (&map.pages, map.sheet.roles(), map.sheet.suffix()));
        for (pages, roles, suffix) in first.into_iter().chain(others) {
            let Some(page) = pages.get(number) else { continue };
            let file = Arc::new(RawFile::open(&page.path)?);
            if file.len() != page.bytes {
                let what = "has another length; run again with --restart";
                return Err(Error::corrupt(&page.path, what));
            }
            let name = format!("{name}{suffix}.{}", page.kind.ending());
            // A part of a file, so that it is copied although it lies below the output's folder for now.
            let data = ImageData::Inside(Part { n_bytes: file.len(), file, offset: 0 });
            let added = || out.add_image(Image { name, data });
            let image = *images.entry(&page.path).or_insert_with(added);
            let of = |&kind: &MapKind| Map::new(kind, image, String::new());
            maps.extend(roles.iter().map(of));
        }
        let is_beside = baked.parts.iter().any(|other| other.page == part.page && !other.blends);
        out.list.push(Material {
            name: if part.blends && is_beside { format!("{name}_clear") } else { name },
            base: finish.base,
            metallic: finish.metallic,
            roughness: finish.roughness,
            emissive: finish.emissive,
            emissive_strength: finish.emissive_strength,
            alpha: match (part.blends, finish.mask, finish.blends) {
                (true, ..) => Alpha::Blend,
                (false, Some(from), _) => Alpha::Mask(from),
                // Of the texels that these triangles share with others, the opacity does not count.
                (false, None, true) => Alpha::Opaque,
                (false, None, false) => Alpha::Plain,
            },
            two_sided: finish.two_sided,
            unlit: finish.unlit,
            maps,
            ..Material::default()
        });
    }
    Ok(out)
}
