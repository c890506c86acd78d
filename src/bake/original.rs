//! The original with its texture coordinates, in cells on disk: cut, surveyed, loaded; the looks of a place on it.
//!
//! Finding the nearest place is in `nearest`.

use super::cells::{Numbers, OriginalCells, PagedTile};
use super::density::{Densities, Density, ImageDensities};
use super::normals::{Border, Normals, border_sums, corner_tangents, mean_tangent};
use super::settings::{Means, NormalSource, Options};
use super::side::{Side, uv_at};
use std::sync::{Mutex, PoisonError};
use stonecut_io::ply::MeshSource;
use stonecut_io::{NUMBER, StageOptions, SurveyOptions, faces_to_vertices, survey_faces};
use stonecut_measure::sums::Sum;
use stonecut_measure::temp_store::{Cutting, Scratch};
use stonecut_measure::tree::Tree;
use stonecut_measure::triangle;
use stonecut_measure::{Carried, ColourChannels};
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::face_properties::FacePolicy;
use stonecut_mesh::property::read_scalar;
use stonecut_mesh::vec3::dot;
use stonecut_render::texture::{Palette, Tangent, UvBox};
use stonecut_store::cells::CellMesh;
use stonecut_system::error::{Error, Result};
use stonecut_system::losses::{Ledger, Loss, LossKind};
use stonecut_system::parallel::{Weighted, largest_first};
use stonecut_system::progress::Progress;

/// No material.
const NONE: u32 = u32::MAX;
/// The original in cells.
pub(super) struct Original {
    cells: OriginalCells,
    /// Diagonal of the box of all.
    diagonal: f64,
    colours: Option<ColourChannels>,
    /// For each material true if an image stands for the colours of vertices.
    has_image: Vec<bool>,
    texture: Option<[usize; 2]>,
    normals: Normals,
    /// True if normal maps of the original are looked up.
    has_frames: bool,
    /// Box of the triangles of each cell.
    pub boxes: Vec<Bounds>,
    area: f64,
    n_triangles: u64,
    /// Texels per unit of length of the images, by area; NaN without any.
    density: f64,
    /// Densities of each image.
    of_images: ImageDensities,
    /// Triangles whose coordinates are not numbers although their material has an image.
    n_lost: u64,
    /// True if images are seen through colours of vertices other than white.
    pub tints_images: bool,
    /// True if images are seen through the colours of vertices, as glTF has it; otherwise they hide these.
    pub is_seen_through: bool,
    /// True if white may stand for no colour of a vertex: without an image, its material's is seen.
    pub has_bare: bool,
}

/// A place on the original.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hit {
    pub distance_sq: f64,
    /// True if the surface there faces the side that the point's own surface does.
    pub faces: bool,
    /// Number of the material.
    pub material: u32,
    pub uv: [f32; 2],
    /// True along each texture coordinate if its triangle lies within one repetition.
    pub within: [bool; 2],
    /// Texture coordinates per unit of length.
    pub per_unit: f32,
    /// Ways in texture coordinates of the point's steps.
    pub along: [[f32; 2]; 2],
    /// Colour of the vertices around, sRGB; white where an image stands for it.
    pub colour: [u8; 3],
    /// Shading normal of length 1; zeros where none is wanted or there is none.
    pub normal: [f32; 3],
    /// Direction of rising u, and the side of the axis across it; zeros where no normal map is looked up.
    pub tangent: [f32; 4],
}

impl Hit {
    pub const NONE: Hit = Hit {
        distance_sq: f64::INFINITY,
        faces: false,
        material: NONE,
        uv: [f32::NAN; 2],
        within: [false; 2],
        per_unit: 0.0,
        along: [[0.0; 2]; 2],
        colour: [255; 3],
        normal: [0.0; 3],
        tangent: [0.0; 4],
    };

    /// True if this one stands for the point: it is nearer, or as near and first by its looks, which no cell changes.
    pub fn is_better(&self, other: &Hit) -> bool {
        let key = |hit: &Hit| {
            let (uv, normal) = (hit.uv.map(f32::to_bits), hit.normal.map(f32::to_bits));
            (
                !hit.faces,
                hit.material,
                uv,
                hit.within,
                hit.colour,
                normal,
                hit.tangent.map(f32::to_bits),
            )
        };
        self.distance_sq < other.distance_sq
            || (self.distance_sq == other.distance_sq && key(self) < key(other))
    }
}

/// A triangle of a cell as a point of the result sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Face {
    /// Number of the triangle.
    triangle: usize,
    /// Its corner that comes first in canonical order.
    first: usize,
    /// Texture coordinates of its corners, where there are any: u, then v.
    uv: Option<[[f64; 3]; 2]>,
    /// True along each if they lie within one repetition.
    within: [bool; 2],
    /// Texture coordinates per unit of length.
    per_unit: f32,
    /// Ways in texture coordinates of the point's steps.
    along: [[f32; 2]; 2],
    /// True if it faces the side that the point's own surface does.
    faces: bool,
}

/// A cell in memory.
pub(super) struct Cell {
    mesh: Mesh,
    material: Vec<u32>,
    /// Texture coordinates per unit of length; 0 where that is not a number.
    per_unit: Vec<f32>,
    /// Of the vertices, where they are computed.
    normals: Vec<[f32; 3]>,
    /// Of the corners of triangles, where normal maps are looked up.
    tangents: Vec<[Tangent; 3]>,
    pub tree: Tree,
}

impl Original {
    /// Cuts the original into cells in the folder for temporary data.
    pub fn cut(
        source: MeshSource,
        palette: &Palette,
        options: &Options,
        means: Means,
    ) -> Result<Original> {
        // The number of the material goes with the texture; without one it would be dropped with the others.
        let drop_properties = source.has_corner_texture();
        let mut carry =
            survey_faces(&source, &SurveyOptions { drop_properties, ..SurveyOptions::default() })?;
        let others = carry.properties.iter().map(|p| p.property.name.clone());
        for name in others.filter(|name| name != NUMBER).collect::<Vec<_>>() {
            carry.drop_property(&name, "");
        }
        let number = carry.properties.iter().find(|p| p.property.name == NUMBER).cloned();
        let stage = StageOptions {
            memory_bytes: super::need::staging_bytes(means.memory_bytes),
            disk: means.disk.clone(),
            ..StageOptions::new(means.temp_dir)
        };
        let is_seen_through = !source.images_hide_colours();
        let has_bare = !is_seen_through && source.has_bare_vertices();
        let source = faces_to_vertices(source, carry, &stage)?;
        let schema = source.schema().clone();
        let carried = Carried::of(&schema);
        let texture = carried.and_then(|carried| carried.texture);
        let colours = carried.and_then(|carried| carried.colour);
        if texture.is_none() && colours.is_none() && !options.normals {
            return Err(Error::bad_input(
                source.path(),
                "there is nothing to bake: neither texture coordinates at the corners of faces nor colours of vertices",
            ));
        }
        let numbers = match number {
            Some(number) if number.how == FacePolicy::Constant => {
                Numbers::Same(Numbers::of(read_scalar(number.property.scalar, &number.constant, 0)))
            }
            Some(_) => Numbers::find(&schema),
            None => Numbers::Same(0),
        };
        let cutting = Cutting {
            cell_triangles: options.cell_triangles,
            temp_dir: means.temp_dir,
            threads: means.threads,
            memory_bytes: means.memory_bytes,
            disk: Some(means.disk),
        };
        let scratch = Scratch::cut(&source, cutting, means.progress)?;
        let n_cells = scratch.store().n_cells();
        let mut original = Original {
            diagonal: scratch.partition().bounds.diagonal(),
            boxes: vec![Bounds::EMPTY; n_cells],
            colours,
            has_image: palette.paints.iter().map(|paint| paint.base.is_some()).collect(),
            normals: match (options.normals, carried.and_then(|carried| carried.normal)) {
                (false, _) => Normals::None,
                (true, Some(channels)) => Normals::Own(channels),
                (true, None) => Normals::Computed(Border::default()),
            },
            has_frames: options.normals && palette.has_normal_maps(),
            is_seen_through,
            has_bare,
            ..Original::of(OriginalCells::Cut(Box::new(scratch), numbers), texture)
        };
        original.survey(palette, means)?;
        Ok(original)
    }

    /// Finer tiles with their pages; the cells are the tiles.
    pub fn of_tiles(tiles: Vec<PagedTile>) -> Original {
        let boxes = tiles.iter().map(|tile| tile.bounds).collect();
        Original { boxes, ..Original::of(OriginalCells::Tiles(tiles), Some([0, 1])) }
    }

    fn of(cells: OriginalCells, texture: Option<[usize; 2]>) -> Original {
        Original {
            cells,
            diagonal: f64::NAN,
            colours: None,
            has_image: Vec::new(),
            texture,
            normals: Normals::None,
            has_frames: false,
            boxes: Vec::new(),
            area: 0.0,
            n_triangles: 0,
            density: f64::NAN,
            of_images: ImageDensities::default(),
            n_lost: 0,
            tints_images: false,
            is_seen_through: false,
            has_bare: false,
        }
    }

    /// Looks at every cell once.
    fn survey(&mut self, palette: &Palette, means: Means) -> Result<()> {
        struct Look {
            boxes: Vec<Bounds>,
            area: Sum,
            densities: Densities,
            of_images: ImageDensities,
            n_triangles: u64,
            n_lost: u64,
            tints: bool,
            border: Vec<([u64; 3], [i64; 3])>,
        }
        let (n_cells, diagonal) = (self.boxes.len(), self.diagonal);
        let area_sum = || Sum::new(diagonal * diagonal);
        let look = Mutex::new(Look {
            boxes: vec![Bounds::EMPTY; n_cells],
            area: area_sum(),
            densities: Densities::new(diagonal),
            of_images: ImageDensities::default(),
            n_triangles: 0,
            n_lost: 0,
            tints: false,
            border: Vec::new(),
        });
        let is_computed = matches!(self.normals, Normals::Computed(_));
        let jobs = (0..n_cells).map(|item| Weighted { item, bytes: self.bytes(item) }).collect();
        let soon = |cell: usize| self.cells.expect(cell);
        largest_first(jobs, means.threads, means.memory_bytes, means.progress, soon, |number| {
            let (cell, material) = self.cells.load(number)?;
            let border =
                if is_computed { border_sums(&cell.mesh, &cell.shared) } else { Vec::new() };
            let mesh = cell.mesh;
            let (mut sum, mut densities, mut n_lost) = (area_sum(), Densities::new(diagonal), 0);
            let (mut of_images, mut tints) = (ImageDensities::default(), false);
            for (t, &material) in material.iter().enumerate() {
                let area = triangle::area(&mesh.corners(t));
                sum.add(area);
                let Some(paint) = palette.paints.get(material as usize) else { continue };
                let Some(map) = paint.densest() else { continue };
                tints = tints || paint.base.is_some() && self.is_tinted(&mesh, t);
                let corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
                let uv = self.corner_uv(&mesh, t);
                let is_known =
                    corners.iter().all(|&weights| map.leads_to_texels(uv_at(uv, weights)));
                if !is_known {
                    n_lost += 1;
                    continue;
                }
                let per_unit = f64::from(self.per_unit(&mesh, t));
                densities.add(area, per_unit * map.texels_per_coordinate);
                for map in paint.maps() {
                    let per_unit = per_unit * map.texels_per_coordinate;
                    of_images.add(map.image, (area, diagonal * diagonal), per_unit);
                }
            }
            let mut look = look.lock().unwrap_or_else(PoisonError::into_inner);
            look.boxes[number] = Bounds::of(&mesh);
            look.n_triangles += mesh.triangles.len() as u64;
            look.n_lost += n_lost;
            look.tints |= tints;
            look.area.merge(&sum);
            look.densities.merge(&densities);
            look.of_images.merge(of_images);
            look.border.extend(border);
            Ok(())
        })?;
        let look = look.into_inner().unwrap_or_else(PoisonError::into_inner);
        self.boxes = look.boxes;
        (self.n_triangles, self.n_lost) = (look.n_triangles, look.n_lost);
        self.tints_images = look.tints;
        self.area = look.area.value();
        self.density = look.densities.mean(palette.n_pixels());
        self.of_images = look.of_images;
        if is_computed {
            self.normals = Normals::Computed(Border::of(look.border));
        }
        Ok(())
    }

    /// The density of the original's images; where it has none, two texels for the side of a mean triangle.
    pub fn density(&self, options: &Options) -> Density {
        let of_images = self.density_of_images();
        let side = (2.0 * self.area / self.n_triangles.max(1) as f64).sqrt();
        let most = f64::from(options.page_size) / self.diagonal * 1e4;
        let wanted = of_images.unwrap_or(2.0 / side).min(most);
        let is_usable = wanted.is_finite() && wanted > 0.0;
        Density { wanted: if is_usable { wanted } else { most.min(1e30) }, of_images }
    }

    /// Texels per unit of length of the original's images, by area.
    pub fn density_of_images(&self) -> Option<f64> {
        Some(self.density).filter(|x| x.is_finite() && *x > 0.0)
    }

    /// Halvings of an image with which nearly all of it is looked up at least, where `n` points a unit of length look.
    pub fn halvings(&self, image: usize, n: f64) -> u32 {
        self.of_images.halvings(image, n)
    }

    /// Missing, damaged and lost parts.
    pub fn losses(&self, palette: &Palette) -> Ledger {
        let mut losses = palette.losses().clone();
        if self.n_lost > 0 {
            let why = "not numbers or too large: their materials' colours stand for them";
            let loss = Loss::new(LossKind::TextureCoordinates, "texture coordinates of faces", why);
            losses.lose(loss.count(self.n_lost));
        }
        losses
    }

    /// Bytes of the largest cell in memory.
    pub fn largest_cell_bytes(&self) -> u64 {
        (0..self.boxes.len()).map(|cell| self.bytes(cell)).max().unwrap_or(0)
    }

    /// Bytes of all cells in memory.
    pub fn all_cells_bytes(&self) -> u64 {
        (0..self.boxes.len()).map(|cell| self.bytes(cell)).sum()
    }

    /// Bytes of a cell in memory with its tree.
    pub fn bytes(&self, cell: usize) -> u64 {
        let (bytes, [triangles, vertices]) = self.cells.size(cell);
        bytes
            + Tree::bytes(triangles)
            + 8 * triangles
            + self.normals.vertex_bytes() * vertices
            + if self.has_frames { super::need::FRAME_WORK_BYTES * triangles } else { 0 }
    }

    pub fn load(&self, cell: usize, progress: &Progress) -> Result<Cell> {
        let (CellMesh { mesh, shared, .. }, material) = self.cells.load(cell)?;
        let normals = self.normals.of_cell(&mesh, &shared);
        let tangents = match (self.has_frames, self.texture) {
            (true, Some(texture)) => corner_tangents(&mesh, &self.normals, &normals, texture),
            _ => Vec::new(),
        };
        let tree = Tree::build_until(mesh.triangles.len(), |i| mesh.corners(i), progress)?;
        let per_unit = (0..mesh.triangles.len()).map(|t| self.per_unit(&mesh, t));
        let per_unit = per_unit.map(|n| if n.is_finite() { n } else { 0.0 }).collect();
        Ok(Cell { mesh, material, per_unit, normals, tangents, tree })
    }

    /// Texture coordinates of a triangle's corners.
    fn corner_uv(&self, mesh: &Mesh, triangle: usize) -> Option<[[f64; 3]; 2]> {
        let corners = mesh.triangles[triangle];
        let of = |channel| corners.map(|v| f64::from(mesh.channels_of(v)[channel]));
        self.texture.map(|channels| channels.map(of))
    }

    /// Texture coordinates per unit of length on a triangle: the root of the ratio of areas.
    fn per_unit(&self, mesh: &Mesh, t: usize) -> f32 {
        let [u, v] = self.corner_uv(mesh, t).unwrap_or([[f64::NAN; 3]; 2]);
        let cross = (u[1] - u[0]) * (v[2] - v[0]) - (v[1] - v[0]) * (u[2] - u[0]);
        (0.5 * cross.abs() / triangle::area(&mesh.corners(t))).sqrt() as f32
    }

    /// Properties that all places on the triangle at a slot of a cell's tree share, seen from a side.
    pub fn face(&self, cell: &Cell, slot: u32, side: &Side) -> Face {
        let triangle = cell.tree.id(slot) as usize;
        let corners = cell.mesh.corners(triangle);
        let (uv, per_unit) = (self.corner_uv(&cell.mesh, triangle), cell.per_unit[triangle]);
        Face {
            triangle,
            first: triangle::rotation(&corners),
            along: side.along(&corners, uv, per_unit),
            within: uv.map_or([false; 2], |[u, v]| {
                UvBox::of([0, 1, 2].map(|k| [u[k] as f32, v[k] as f32])).within_one()
            }),
            faces: dot(triangle::area_normal(cell.tree.corners(slot)), side.normal) > 0.0,
            uv,
            per_unit,
        }
    }

    /// The look of the place of a triangle that is nearest to a point; `found` has the squared distance and the weights of
    /// the triangle's canonical corners.
    pub fn hit(&self, cell: &Cell, face: &Face, (distance_sq, weights): (f64, [f64; 3])) -> Hit {
        let t = face.triangle;
        // Back to the order of the mesh.
        let weights = triangle::rotate(weights, (3 - face.first) % 3);
        let has_image = self.has_image.get(cell.material[t] as usize).is_some_and(|has| *has);
        let is_shown = self.is_seen_through || !has_image;
        let colour = self.colours.filter(|_| is_shown).map_or([255; 3], |colours| {
            colours.channels.map(|channel| {
                let value = |v: u32| f64::from(cell.mesh.channels_of(v)[channel]);
                let terms = cell.mesh.triangles[t].iter().zip(weights);
                let mixed: f64 = terms.map(|(&v, weight)| weight * value(v)).sum();
                (255.0 * (mixed / f64::from(colours.white)).clamp(0.0, 1.0)).round() as u8
            })
        });
        Hit {
            distance_sq,
            faces: face.faces,
            material: cell.material[t],
            uv: uv_at(face.uv, weights),
            within: face.within,
            per_unit: face.per_unit,
            along: face.along,
            colour,
            normal: self.normals.at(&cell.mesh, &cell.normals, t, weights),
            tangent: cell.tangents.get(t).map_or([0.0; 4], |own| mean_tangent(own, weights)),
        }
    }

    /// True if a corner of a triangle has another colour than white.
    fn is_tinted(&self, mesh: &Mesh, t: usize) -> bool {
        let Some(colours) = self.colours else { return false };
        let white = colours.white;
        let is_white = |v: u32| colours.channels.iter().all(|&i| mesh.channels_of(v)[i] >= white);
        !mesh.triangles[t].iter().all(|&v| is_white(v))
    }

    /// Leaves the colours of vertices to viewers if images are seen through some of them.
    pub fn leave_tints(&mut self) {
        self.colours = self.colours.filter(|_| !(self.is_seen_through && self.tints_images));
    }

    /// True if pages hold all colours of vertices: no image is seen through them, or they are a part of it.
    pub fn gives_all_colours(&self) -> bool {
        self.has_colours() && (self.is_seen_through || !self.tints_images)
    }

    /// True if vertices have colours.
    pub fn has_colours(&self) -> bool {
        self.colours.is_some()
    }

    /// Source of the normals; `None` where none are wanted.
    pub fn normal_source(&self) -> Option<NormalSource> {
        match &self.normals {
            Normals::None => None,
            Normals::Own(_) => Some(NormalSource::Input),
            Normals::Computed(_) => Some(NormalSource::Faces),
        }
    }

    /// Bytes of the normals of places that several cells share.
    pub fn border_bytes(&self) -> u64 {
        match &self.normals {
            Normals::Computed(border) => border.bytes(),
            Normals::None | Normals::Own(_) => 0,
        }
    }

    /// True if there are colours to bake: of vertices, or of images.
    pub fn has_looks(&self) -> bool {
        self.has_colours() || self.texture.is_some()
    }
}
