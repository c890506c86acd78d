//! The original with its texture coordinates, in cells on disk, and the nearest place of it for many points.
//!
//! A point looks in the cell whose box it is in, then in every cell whose box is not farther than what was found: the
//! answer is exact, whatever the cells. Where the nearest place faces away from the point's own side, as through a thin
//! wall, the nearest place that faces it is taken instead, if that is not much farther.

use super::paint::{MapUse, Palette};
use super::{Means, Options};
use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::io::{NUMBER, StageOptions, SurveyOptions, faces_to_vertices, survey_faces};
use crate::measure::sums::Sum;
use crate::measure::temp_store::{Cutting, Scratch};
use crate::measure::tree::{Nearest, Tree};
use crate::measure::triangle::{self, Vector};
use crate::measure::{Carried, ColourChannels};
use crate::mesh::Mesh;
use crate::mesh::bounds::Bounds;
use crate::mesh::face_properties::FacePolicy;
use crate::mesh::property::{Origin, Scalar, read_scalar};
use crate::mesh::record::VertexSchema;
use crate::mesh::vec3::dot;
use crate::store::cells::load_bytes;
use crate::system::parallel::{Weighted, in_order, largest_first};
use crate::system::progress::Progress;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Points that are held against the boxes together.
const RUN: usize = 256;

/// Points that a thread takes at a time.
const BLOCK: usize = 2048;

/// Texels of a triangle that count for the density.
const MOST_TEXELS: f64 = (1u64 << 40) as f64;

/// No material.
const NONE: u32 = u32::MAX;

/// The original in cells.
pub(super) struct Original {
    scratch: Scratch,
    numbers: Numbers,
    colours: Option<ColourChannels>,
    texture: Option<[usize; 2]>,
    /// Box of the triangles of each cell.
    boxes: Vec<Bounds>,
    area: f64,
    n_triangles: u64,
    /// Area with an image, and texels there.
    textured: [f64; 2],
    /// Triangles whose coordinates are not numbers although their material has an image.
    n_lost: u64,
}

/// Numbers of materials.
#[derive(Clone, Copy)]
enum Numbers {
    /// The same for all.
    Same(u32),
    /// At a byte of vertex records.
    At(Scalar, usize),
}

impl Numbers {
    fn of(value: f64) -> u32 {
        if (0.0..f64::from(NONE)).contains(&value) { value as u32 } else { NONE }
    }
}

/// Density of the texels of a bake.
#[derive(Clone, Copy, Debug)]
pub(super) struct Density {
    /// Texels per unit of length that a bake aims at.
    pub wanted: f64,
    /// Those of the original's images, by area.
    pub of_images: Option<f64>,
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
    /// Texture coordinates per unit of length.
    pub per_unit: f32,
    /// Colour of the vertices around, sRGB.
    pub colour: [u8; 3],
}

impl Hit {
    const NONE: Hit = Hit {
        distance_sq: f64::INFINITY,
        faces: false,
        material: NONE,
        uv: [f32::NAN; 2],
        per_unit: 0.0,
        colour: [255; 3],
    };

    /// Tells if this one stands for the point: it is nearer, or as near and first by its looks, which no cell changes.
    fn is_better(&self, other: &Hit) -> bool {
        let key = |hit: &Hit| (!hit.faces, hit.material, hit.uv.map(f32::to_bits), hit.colour);
        self.distance_sq < other.distance_sq
            || (self.distance_sq == other.distance_sq && key(self) < key(other))
    }
}

/// Points of the result that look for a place.
pub(super) trait Seekers: Sync {
    fn n(&self) -> usize;
    fn point(&self, i: usize) -> Vector;
    /// Normal of the surface that the point is on, of any length.
    fn normal(&self, i: usize) -> Vector;
    /// A place that faces the point may be this much farther than the nearest one.
    fn grace(&self, i: usize) -> f64;
}

/// A cell in memory.
struct Cell {
    mesh: Mesh,
    material: Vec<u32>,
    tree: Tree,
}

impl Original {
    /// Cuts the original into cells of its own folder for temporary data.
    pub fn cut(
        source: MeshSource,
        palette: &Palette,
        cell_triangles: u64,
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
            memory_bytes: (means.memory_bytes / 2).max(3 << 20),
            ..StageOptions::new(means.temp_dir)
        };
        let source = faces_to_vertices(source, carry, &stage)?;
        let schema = source.schema().clone();
        let carried = Carried::of(&schema);
        let texture = carried.and_then(|carried| carried.texture);
        let colours = carried.and_then(|carried| carried.colour);
        if texture.is_none() && colours.is_none() {
            return Err(Error::bad_input(
                source.path(),
                "there is nothing to bake: neither texture coordinates at the corners of faces nor colours of vertices",
            ));
        }
        let numbers = match number {
            Some(number) if number.how == FacePolicy::Constant => {
                Numbers::Same(Numbers::of(read_scalar(number.property.scalar, &number.constant, 0)))
            }
            Some(_) => find_numbers(&schema),
            None => Numbers::Same(0),
        };
        let cutting = Cutting {
            cell_triangles,
            temp_dir: means.temp_dir,
            threads: means.threads,
            memory_bytes: means.memory_bytes,
        };
        let scratch = Scratch::cut(&source, cutting, means.progress)?;
        let mut original = Original {
            scratch,
            numbers,
            colours,
            texture,
            boxes: Vec::new(),
            area: 0.0,
            n_triangles: 0,
            textured: [0.0; 2],
            n_lost: 0,
        };
        original.survey(palette, means)?;
        Ok(original)
    }

    /// Looks at every cell once.
    fn survey(&mut self, palette: &Palette, means: Means) -> Result<()> {
        struct Look {
            boxes: Vec<Bounds>,
            sums: [Sum; 3],
            n_triangles: u64,
            n_lost: u64,
        }
        let n_cells = self.scratch.store().n_cells();
        let diagonal = self.scratch.partition().bounds.diagonal();
        let area_sum = || Sum::new(diagonal * diagonal);
        let look = Mutex::new(Look {
            boxes: vec![Bounds::EMPTY; n_cells],
            sums: [area_sum(), area_sum(), Sum::new(MOST_TEXELS)],
            n_triangles: 0,
            n_lost: 0,
        });
        let jobs = (0..n_cells).map(|item| Weighted { item, bytes: self.bytes(item) }).collect();
        let soon = |cell: usize| self.scratch.store().expect(cell);
        largest_first(jobs, means.threads, means.memory_bytes, means.progress, soon, |number| {
            let (mesh, material) = self.load_mesh(number)?;
            let (mut sums, mut n_lost) = ([area_sum(), area_sum(), Sum::new(MOST_TEXELS)], 0);
            for (t, &material) in material.iter().enumerate() {
                let area = triangle::area(&mesh.corners(t));
                sums[0].add(area);
                let Some(map) = map_of(palette, material) else { continue };
                let per_unit = f64::from(self.per_unit(&mesh, t));
                let texels = area * (per_unit * map.texels_per_coordinate()).powi(2);
                if texels.is_finite() && self.uv(&mesh, t, [1.0, 0.0, 0.0])[0].is_finite() {
                    sums[1].add(area);
                    sums[2].add(texels.min(MOST_TEXELS));
                } else {
                    n_lost += 1;
                }
            }
            let mut look = look.lock().unwrap_or_else(PoisonError::into_inner);
            look.boxes[number] = Bounds::of(&mesh);
            look.n_triangles += mesh.triangles.len() as u64;
            look.n_lost += n_lost;
            look.sums.iter_mut().zip(&sums).for_each(|(all, sum)| all.merge(sum));
            Ok(())
        })?;
        let look = look.into_inner().unwrap_or_else(PoisonError::into_inner);
        self.boxes = look.boxes;
        (self.n_triangles, self.n_lost) = (look.n_triangles, look.n_lost);
        self.area = look.sums[0].value();
        self.textured = [look.sums[1].value(), look.sums[2].value()];
        Ok(())
    }

    /// The density of the original's images; where it has none, two texels for the side of a mean triangle.
    pub fn density(&self, options: &Options) -> Density {
        let of_images = self.density_of_images();
        let side = (2.0 * self.area / self.n_triangles.max(1) as f64).sqrt();
        let extent = self.scratch.partition().bounds.diagonal();
        let most = f64::from(options.page_size) / extent * 1e4;
        let wanted = of_images.unwrap_or(2.0 / side).min(most);
        let is_usable = wanted.is_finite() && wanted > 0.0;
        Density { wanted: if is_usable { wanted } else { most.min(1e30) }, of_images }
    }

    /// Texels per unit of length of the original's images, by area.
    pub fn density_of_images(&self) -> Option<f64> {
        let [area, texels] = self.textured;
        Some((texels / area).sqrt()).filter(|x| x.is_finite() && *x > 0.0)
    }

    /// Missing, damaged and lost parts, a line each.
    pub fn notes(&self, palette: &Palette) -> Vec<String> {
        let mut notes = palette.notes().to_vec();
        if self.n_lost > 0 {
            notes.push(format!(
                "texture coordinates of {} faces are not numbers or too large: their materials' colours stand for them",
                self.n_lost
            ));
        }
        notes
    }

    /// Bytes of a cell in memory with its tree.
    fn bytes(&self, cell: usize) -> u64 {
        let store = self.scratch.store();
        let tally = store.info().cells[cell];
        load_bytes(tally, store.layout()) + Tree::bytes(tally.triangles) + 4 * tally.triangles
    }

    fn load_mesh(&self, cell: usize) -> Result<(Mesh, Vec<u32>)> {
        let store = self.scratch.store();
        let loaded = store.load(cell)?;
        let record_bytes = store.layout().schema.record_bytes();
        let number = |t: &[u32; 3]| match self.numbers {
            Numbers::Same(number) => number,
            Numbers::At(scalar, at) => {
                Numbers::of(read_scalar(scalar, &loaded.records, t[0] as usize * record_bytes + at))
            }
        };
        let material = loaded.mesh.triangles.iter().map(number).collect();
        Ok((loaded.mesh, material))
    }

    fn load(&self, cell: usize, progress: &Progress) -> Result<Cell> {
        let (mesh, material) = self.load_mesh(cell)?;
        let tree = Tree::build_until(mesh.triangles.len(), |i| mesh.corners(i), progress)?;
        Ok(Cell { mesh, material, tree })
    }

    /// Texture coordinates at a point of a triangle.
    fn uv(&self, mesh: &Mesh, triangle: usize, weights: [f64; 3]) -> [f32; 2] {
        let Some(channels) = self.texture else { return [f32::NAN; 2] };
        channels.map(|channel| {
            let value = |v: u32| f64::from(mesh.channels_of(v)[channel]);
            let terms = mesh.triangles[triangle].iter().zip(weights);
            terms.map(|(&v, weight)| weight * value(v)).sum::<f64>() as f32
        })
    }

    /// Texture coordinates per unit of length on a triangle: the root of the ratio of areas.
    fn per_unit(&self, mesh: &Mesh, t: usize) -> f32 {
        let uv = |k: usize| {
            let mut weights = [0.0; 3];
            weights[k] = 1.0;
            self.uv(mesh, t, weights).map(f64::from)
        };
        let (a, b, c) = (uv(0), uv(1), uv(2));
        let cross = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        (0.5 * cross.abs() / triangle::area(&mesh.corners(t))).sqrt() as f32
    }

    /// The look of the place of a triangle that is nearest to a point.
    fn hit(&self, cell: &Cell, found: Nearest, point: Vector, normal: Vector) -> Hit {
        let corners = cell.tree.corners(found.slot);
        let (_, weights) = triangle::closest(point, corners);
        let t = cell.tree.id(found.slot) as usize;
        let first = triangle::rotation(&cell.mesh.corners(t));
        // Back to the order of the mesh.
        let weights = triangle::rotate(weights, (3 - first) % 3);
        let per_unit = self.per_unit(&cell.mesh, t);
        let colour = self.colours.map_or([255; 3], |colours| {
            colours.channels.map(|channel| {
                let value = |v: u32| f64::from(cell.mesh.channels_of(v)[channel]);
                let terms = cell.mesh.triangles[t].iter().zip(weights);
                let mixed: f64 = terms.map(|(&v, weight)| weight * value(v)).sum();
                (255.0 * (mixed / f64::from(colours.white)).clamp(0.0, 1.0)).round() as u8
            })
        });
        Hit {
            distance_sq: found.distance_sq,
            faces: dot(triangle::area_normal(corners), normal) > 0.0,
            material: cell.material[t],
            uv: self.uv(&cell.mesh, t, weights),
            per_unit: if per_unit.is_finite() { per_unit } else { 0.0 },
            colour,
        }
    }

    /// True if vertices have colours.
    pub fn has_colours(&self) -> bool {
        self.colours.is_some()
    }

    /// Finds a place for each point; best given in an order that keeps neighbours together.
    ///
    /// Memory: 80 bytes a point, and cells within `cell_bytes`, one at least.
    pub fn nearest(
        &self,
        seekers: &impl Seekers,
        cells: &mut CellCache,
        (threads, progress): (usize, &Progress),
    ) -> Result<Vec<Hit>> {
        let n = seekers.n();
        let mut hits = vec![Hit::NONE; n];
        let means = (threads, progress);
        let home = self.lists(n, |i| seekers.point(i), Reach::Home);
        self.visit(&home, seekers, Search::Any, &mut hits, cells, means)?;
        let mut others = self.lists(n, |i| seekers.point(i), Reach::Within(&|i| hits[i].distance_sq));
        for (list, done) in others.iter_mut().zip(&home) {
            let mut done = done.iter().peekable();
            list.retain(|query| {
                while done.next_if(|&&d| d < *query).is_some() {}
                done.peek() != Some(&query)
            });
        }
        drop(home);
        self.visit(&others, seekers, Search::Any, &mut hits, cells, means)?;
        drop(others);
        // Only those whose nearest place faces away look on.
        let turned: Vec<u32> = (0..n as u32).filter(|&i| !hits[i as usize].faces).collect();
        if turned.is_empty() {
            return Ok(hits);
        }
        let limit_sq = |i: usize| {
            let limit = hits[i].distance_sq.sqrt() + seekers.grace(i);
            limit * limit
        };
        let limits: Vec<f64> = turned.iter().map(|&i| limit_sq(i as usize)).collect();
        let point = |i: usize| seekers.point(turned[i] as usize);
        let mut lists = self.lists(turned.len(), point, Reach::Within(&|i| limits[i]));
        lists.iter_mut().flatten().for_each(|query| *query = turned[*query as usize]);
        let mut facing = vec![Hit::NONE; n];
        for (&i, &limit_sq) in turned.iter().zip(&limits) {
            facing[i as usize].distance_sq = limit_sq;
        }
        self.visit(&lists, seekers, Search::Facing, &mut facing, cells, means)?;
        for &i in &turned {
            let better = facing[i as usize];
            if better.faces {
                hits[i as usize] = better;
            }
        }
        Ok(hits)
    }

    /// Lets the listed points of each cell look into it.
    fn visit(
        &self,
        lists: &[Vec<u32>],
        seekers: &impl Seekers,
        search: Search,
        hits: &mut [Hit],
        cells: &mut CellCache,
        (threads, progress): (usize, &Progress),
    ) -> Result<()> {
        let busy: Vec<usize> = (0..lists.len()).filter(|&cell| !lists[cell].is_empty()).collect();
        let mut from = 0;
        while from < busy.len() {
            let loaded = cells.get(self, &busy[from..], threads, progress)?;
            for (cell, &number) in loaded.iter().zip(&busy[from..]) {
                let list = &lists[number];
                let mut found: Vec<(u32, Hit)> = Vec::new();
                let so_far = &*hits;
                in_order(
                    list.len().div_ceil(BLOCK) as u64,
                    threads,
                    progress,
                    |block, out: &mut Vec<(u32, Hit)>| {
                        out.clear();
                        let first = block as usize * BLOCK;
                        let mut slot = u32::MAX;
                        for &query in &list[first..(first + BLOCK).min(list.len())] {
                            let i = query as usize;
                            let (point, normal) = (seekers.point(i), seekers.normal(i));
                            let most = so_far[i].distance_sq;
                            let nearest = search.run(&cell.tree, point, normal, most, slot);
                            if nearest.is_found() {
                                slot = nearest.slot;
                                out.push((query, self.hit(cell, nearest, point, normal)));
                            }
                        }
                        Ok(())
                    },
                    |_, block| {
                        found.append(block);
                        Ok(())
                    },
                )?;
                for (query, hit) in found {
                    let best = &mut hits[query as usize];
                    if hit.is_better(best) {
                        *best = hit;
                    }
                }
            }
            from += loaded.len();
        }
        Ok(())
    }

    /// For each cell the points that may find their place there.
    fn lists(&self, n: usize, point: impl Fn(usize) -> Vector, reach: Reach) -> Vec<Vec<u32>> {
        let mut lists = vec![Vec::new(); self.boxes.len()];
        for first in (0..n).step_by(RUN) {
            let run = first..(first + RUN).min(n);
            let mut around = Bounds::EMPTY;
            run.clone().for_each(|i| around.add(point(i)));
            let gap = |cell: usize| self.boxes[cell].gap_sq(&around);
            match reach {
                Reach::Home => {
                    let least = (0..self.boxes.len()).map(gap).fold(f64::INFINITY, f64::min);
                    let near: Vec<usize> =
                        (0..self.boxes.len()).filter(|&cell| gap(cell) <= least).collect();
                    for i in run {
                        let at = point(i);
                        let off = |cell: &&usize| self.boxes[**cell].distance_sq(at);
                        let home = near.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
                        home.iter().for_each(|&&cell| lists[cell].push(i as u32));
                    }
                }
                Reach::Within(reach_sq) => {
                    let most = run.clone().map(reach_sq).fold(0.0, f64::max);
                    for (cell, list) in lists.iter_mut().enumerate() {
                        if gap(cell) <= most {
                            let is_near =
                                |&i: &usize| self.boxes[cell].distance_sq(point(i)) <= reach_sq(i);
                            list.extend(run.clone().filter(is_near).map(|i| i as u32));
                        }
                    }
                }
            }
        }
        lists
    }
}

/// Cells that points look into.
#[derive(Clone, Copy)]
enum Reach<'a> {
    /// The one whose box is nearest.
    Home,
    /// All whose boxes are at most so far, squared.
    Within(&'a dyn Fn(usize) -> f64),
}

/// Places that points look for.
#[derive(Clone, Copy)]
enum Search {
    /// The nearest.
    Any,
    /// The nearest that faces the point's side.
    Facing,
}

impl Search {
    /// The nearest triangle at most `most_sq` away; `slot` is a guess.
    fn run(self, tree: &Tree, point: Vector, normal: Vector, most_sq: f64, slot: u32) -> Nearest {
        let within = Nearest { distance_sq: most_sq, ..Nearest::NONE };
        match self {
            Search::Any => {
                let guess = tree.guess(point, slot);
                tree.nearest(point, if guess.distance_sq <= most_sq { guess } else { within })
            }
            Search::Facing => tree.nearest_where(point, within, |corners| {
                dot(triangle::area_normal(corners), normal) > 0.0
            }),
        }
    }
}

/// The colour image of a material.
pub(super) fn map_of(palette: &Palette, material: u32) -> Option<&MapUse> {
    palette.paints.get(material as usize)?.base.as_ref()
}

/// Place of the number of the material in records.
fn find_numbers(schema: &VertexSchema) -> Numbers {
    let mut at = schema.position_bytes();
    for property in &schema.properties {
        if property.name == NUMBER && property.origin == Origin::FaceLabel {
            return Numbers::At(property.scalar, at);
        }
        at += property.scalar.bytes();
    }
    Numbers::Same(0)
}

/// Cells in memory; the longest unused goes first.
pub(super) struct CellCache {
    budget_bytes: u64,
    uses: u64,
    held: BTreeMap<usize, (u64, Arc<Cell>)>,
}

impl CellCache {
    pub fn new(budget_bytes: u64) -> Self {
        CellCache { budget_bytes, uses: 0, held: BTreeMap::new() }
    }

    /// As many of the cells from the first on as the budget holds together, at least one.
    fn get(
        &mut self,
        original: &Original,
        cells: &[usize],
        threads: usize,
        progress: &Progress,
    ) -> Result<Vec<Arc<Cell>>> {
        let mut sum = 0;
        let fits = |&&cell: &&usize| {
            sum += original.bytes(cell);
            sum <= self.budget_bytes
        };
        let n = cells.iter().take_while(fits).count().max(1).min(cells.len());
        let cells = &cells[..n];
        self.uses += 1;
        let mut missing = Vec::new();
        for cell in cells {
            match self.held.get_mut(cell) {
                Some((used, _)) => *used = self.uses,
                None => missing.push(*cell),
            }
        }
        let wanted: u64 = missing.iter().map(|&cell| original.bytes(cell)).sum();
        let mut there: u64 = self.held.keys().map(|&cell| original.bytes(cell)).sum();
        while there + wanted > self.budget_bytes {
            let idle = self.held.iter().filter(|(_, (used, _))| *used < self.uses);
            let Some((&cell, _)) = idle.min_by_key(|(cell, (used, _))| (*used, **cell)) else { break };
            self.held.remove(&cell);
            there -= original.bytes(cell);
        }
        in_order(
            missing.len() as u64,
            threads,
            progress,
            |i, out: &mut Option<Cell>| {
                *out = Some(original.load(missing[i as usize], progress)?);
                Ok(())
            },
            |i, cell| {
                if let Some(cell) = cell.take() {
                    self.held.insert(missing[i as usize], (self.uses, Arc::new(cell)));
                }
                Ok(())
            },
        )?;
        Ok(cells.iter().filter_map(|cell| self.held.get(cell)).map(|(_, c)| c.clone()).collect())
    }
}
