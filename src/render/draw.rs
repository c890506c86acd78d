//! From a scene and a view to samples: aims the camera, fetches vertices, draws faces as they stream by.

use super::camera::{Camera, Extent, Silhouette, nearest_axis};
use super::frames::{FRAME_BYTES, Frames, MOST_TRIANGLES};
use super::picture::Picture;
use super::quadrics::Facet;
use super::raster::{Corner, Frame, Shown, Style};
use super::sample::SAMPLE_BYTES;
use super::scene::{Faces, Points, Scene};
use super::shade;
use super::skin::Skins;
use super::vector::smoothstep;
use super::vertices::{PlacedVertex, Vertices, vertex_bytes};
use super::view::{Aim, Direction, Lighting, Resources, Sphere, View, per_pixel};
use crate::texture::UvBox;
use stonecut_io::ply::{BLOCK_ROWS, FaceLook};
use stonecut_mesh::oklab::{linear_of_srgb, srgb_of_linear};
use stonecut_mesh::vec3::unit;
use stonecut_mesh::vec3::{Vec3, add, dot, normal, scale};
use stonecut_system::error::{Error, Result};
use stonecut_system::losses::Loss;
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;
use stonecut_system::units::{memory_word, show_bytes};

/// Width of edge lines in pixels.
const LINE_WIDTH: f32 = 0.9;
/// The colour of a mesh without colours, sRGB: light clay.
pub(super) const CLAY: [f32; 3] = [0.83, 0.80, 0.755];
/// Meshes with more faces than this are lit by averaged face normals instead of vertex normals: their
/// triangles are about as small as the samples anyway.
const MOST_SMOOTH_FACES: u64 = 12_000_000;
/// Memory for whatever is neither vertices nor samples: blocks under way, the finished picture.
const SLACK_BYTES: u64 = 64 << 20;

/// Layers that are looked through where images have holes.
const LAYERS: usize = 8;

/// A scene in a frame of samples, not yet lit.
pub(super) struct Drawn {
    pub(super) frame: Frame,
    camera: Camera,
    per_pixel: usize,
}

impl Drawn {
    /// Lights the frame.
    pub(super) fn picture(
        &self,
        lighting: Lighting,
        threads: usize,
        progress: &Progress,
    ) -> Result<Picture> {
        match lighting {
            Lighting::Studio => {
                shade::shade(&self.frame, &self.camera, self.per_pixel, threads, progress)
            }
            Lighting::Unlit => shade::plain(&self.frame, self.per_pixel, threads, progress),
        }
    }

    /// For each pixel, row by row, whether any surface is seen there.
    pub(super) fn covered(&self) -> Vec<bool> {
        let (n, width) = (self.per_pixel, self.frame.width);
        let mut covered = vec![false; width / n * (self.frame.height / n)];
        for (row, samples) in self.frame.samples.chunks_exact(width).enumerate() {
            for (column, sample) in samples.iter().enumerate() {
                covered[row / n * (width / n) + column / n] |= sample.nearness > 0.0;
            }
        }
        covered
    }
}

/// Bytes of a pixel while it is lit, and of its finished copies: place, normal, openness twice and once more smoothed, and
/// four times its colour: as it is gathered, in the picture, beside others, as PNG.
const PIXEL_BYTES: u64 = 48;

/// Memory that no picture does without, beside its frame and its pixels.
const LEAST_BYTES: u64 = 24 << 20;

/// Memory that a picture takes at least, without its images.
pub(super) fn least_bytes(view: &View) -> Result<u64> {
    Ok(frame_bytes(view)? + LEAST_BYTES)
}

/// Bytes of the samples and pixels of a view.
fn frame_bytes(view: &View) -> Result<u64> {
    let per_pixel = per_pixel(view)?;
    let pixels = u64::from(view.width) * u64::from(view.height);
    Ok(pixels * ((per_pixel * per_pixel * SAMPLE_BYTES) as u64 + PIXEL_BYTES))
}

/// Memory for vertices and images beside the frame of a view; `looks_bytes` is what images take at least.
///
/// Errors: a frame that the memory does not hold with these, with the memory and the size that do.
pub(super) fn free_bytes(view: &View, looks_bytes: u64, resources: Resources) -> Result<u64> {
    let needed = least_bytes(view)? + looks_bytes;
    if needed <= resources.memory_bytes {
        return Ok(resources.memory_bytes.saturating_sub(frame_bytes(view)? + SLACK_BYTES));
    }
    // Nine samples are the most that a pixel takes, so a picture of this size is held.
    let most = 9 * SAMPLE_BYTES as u64 + PIXEL_BYTES;
    let left = resources.memory_bytes.saturating_sub(LEAST_BYTES + looks_bytes) / most;
    let pixels = f64::from(view.width) * f64::from(view.height);
    let share = (left as f64 / pixels).sqrt().min(1.0);
    let [width, height] = [view.width, view.height].map(|n| (f64::from(n) * share) as u32);
    let smaller = match width.min(height) {
        0 => String::new(),
        _ => format!(", or make it {width}x{height}"),
    };
    let looks = match looks_bytes {
        0 => String::new(),
        n => format!(", {} of it for an image while it is decoded", show_bytes(n)),
    };
    Err(Error::NoMemory(format!(
        "a picture of {}x{} pixels takes {}{looks}, the budget has {}; give --memory {}{smaller}",
        view.width,
        view.height,
        show_bytes(needed),
        show_bytes(resources.memory_bytes),
        memory_word(needed)
    )))
}

/// Draws a scene, and over it some facets given in object space; `budget` is the memory for vertices.
pub(super) fn draw(
    scene: &dyn Scene,
    view: &View,
    (skins, overlay): (Option<&Skins>, &[Facet]),
    (resources, budget): (Resources, u64),
    progress: &Progress,
) -> Result<Drawn> {
    let per_pixel = per_pixel(view)?;
    let camera = match &view.aim {
        Some(Aim(camera)) => camera.clone(),
        None => aim(scene, view, per_pixel, resources, progress)?,
    };
    let threads = resources.threads;
    let mut frame =
        Frame::new(view.width as usize * per_pixel, view.height as usize * per_pixel, &camera);
    if scene.is_tinted() && skins.is_some() {
        frame.tints = vec![[255; 3]; frame.samples.len()];
    }
    let budget = budget.saturating_sub(3 * frame.tints.len() as u64);
    let mut vertices = Vertices::new(scene, &camera, budget, threads, progress)?;
    let smooth_bytes = scene.n_vertices().saturating_mul(vertex_bytes(scene.is_colored(), true));
    let is_smooth = view.smooth && scene.n_triangles() <= MOST_SMOOTH_FACES;
    if is_smooth && smooth_bytes <= budget && vertices.all_held() {
        let by_area = skins.is_some_and(Skins::has_normal_maps);
        vertices.normals = vertex_normals(scene, &mut vertices, by_area, threads, progress)?;
    } else if is_smooth && !scene.has_normals() {
        let whole_blocks = scene.n_point_blocks() * BLOCK_ROWS;
        let needed = whole_blocks.saturating_mul(vertex_bytes(scene.is_colored(), true));
        progress.lose(Loss::remark(format!(
            "faces are shaded flat: normals for smooth shading take {}, more than there is left of the memory; give --memory {}",
            show_bytes(needed),
            memory_word(resources.memory_bytes + needed.saturating_sub(budget))
        )));
    }
    let style = Style {
        line: if view.edges { 0.5 * LINE_WIDTH * per_pixel as f32 } else { 0.0 },
        samples: per_pixel as f32,
        shown: None,
    };
    let frames = match skins.filter(|skins| skins.has_normal_maps()) {
        Some(_) => {
            let left = budget.saturating_sub(smooth_bytes);
            find_frames(scene, &mut vertices, left, threads, progress)?
        }
        None => Frames::default(),
    };
    for _ in 0..LAYERS {
        let mut number = 0;
        each_block(scene, threads, progress, |faces| {
            vertices.tick();
            for (i, ids) in faces.triangles.iter().enumerate() {
                let look = skins.zip(faces.looks.of(i));
                draw_face(ids, look, &mut vertices, (&frames, number), &mut frame, style)?;
                number += 1;
            }
            Ok(())
        })?;
        let Some(skins) = skins else { break };
        let cut = skins.colour(&mut frame, threads, progress)?;
        if cut.is_empty() {
            break;
        }
        frame.open_behind(&cut);
    }
    frame.open_all();
    drop(vertices);
    for facet in overlay {
        let corners = [0, 1, 2].map(|i| Corner {
            place: camera.place(facet.corners[i]).map(|x| x as f32),
            normal: camera.axes.map(|axis| dot(axis, facet.normals[i]) as f32),
            color: facet.color,
            ..Corner::default()
        });
        frame.triangle(&corners, Style { line: 0.0, ..style });
    }
    Ok(Drawn { frame, camera, per_pixel })
}

fn draw_face(
    ids: &[u64; 3],
    look: Option<(&Skins, FaceLook)>,
    vertices: &mut Vertices,
    (frames, number): (&Frames, usize),
    frame: &mut Frame,
    mut style: Style,
) -> Result<()> {
    let is_tinted = !frame.tints.is_empty();
    let skin = look.and_then(|(skins, (_, material))| skins.get(material));
    let vertices_of_face = get_three(ids, vertices)?;
    let mut corners = vertices_of_face.each_ref().map(|vertex| {
        let own = vertex.color.map(|color| color.map(|c| f32::from(c) / 255.0));
        let color = match (own, skin) {
            (Some(own), Some(skin)) if is_tinted && skin.texels.is_none() => {
                product(own, skin.color)
            }
            (Some(own), _) => own,
            (None, Some(skin)) => skin.color,
            (None, None) => CLAY,
        };
        Corner { place: vertex.place, color, ..Corner::default() }
    });
    let image = skin.and_then(|skin| Some((skin, skin.texels?)));
    if let (Some((skins, (uv, material))), Some((_, texels))) = (look, image) {
        let within = skins.within(material, &UvBox::of(uv));
        style.shown = Some(Shown { material, texels, within });
        (0..3).for_each(|i| corners[i].uv = uv[i]);
    }
    if !frame.may_show(&corners) {
        return Ok(());
    }
    let is_bumped = image.is_some_and(|(skin, _)| skin.is_bumped);
    if !put_normals(&mut corners, ids, is_bumped.then_some(&vertices_of_face), vertices) {
        return Ok(());
    }
    if is_bumped {
        frames.put(number, &mut corners);
    }
    frame.triangle(&corners, style);
    Ok(())
}

/// The colour of a vertex times that of its material, both sRGB.
fn product(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    let light = |x: f32| linear_of_srgb(f64::from(x));
    [0, 1, 2].map(|k| srgb_of_linear(light(a[k]) * light(b[k])) as f32)
}

fn get_three(ids: &[u64; 3], vertices: &mut Vertices) -> Result<[PlacedVertex; 3]> {
    Ok([vertices.get(ids[0])?, vertices.get(ids[1])?, vertices.get(ids[2])?])
}

/// Gives the corners of a face their normals: those of the file if they are handed in and there, otherwise those found for
/// the vertices, or the face's. False if the face has no area.
fn put_normals(
    corners: &mut [Corner; 3],
    ids: &[u64; 3],
    own: Option<&[PlacedVertex; 3]>,
    vertices: &Vertices,
) -> bool {
    let places = [0, 1, 2].map(|i| corners[i].place.map(f64::from));
    let Some(flat) = unit(normal(places)) else { return false };
    let flat = flat.map(|x| x as f32);
    for (i, corner) in corners.iter_mut().enumerate() {
        let of_file = own.and_then(|own| own[i].normal).filter(|normal| *normal != [0.0; 3]);
        corner.normal = match (of_file, vertices.normals.get(ids[i] as usize)) {
            (Some(of_file), _) => of_file,
            // A normal map has the creases.
            (None, Some(smooth)) if own.is_some() => *smooth,
            (None, Some(smooth)) => creased(*smooth, flat),
            (None, None) => flat,
        };
    }
    true
}

/// Tangent frames of all faces, where they fit into `budget`; none otherwise.
fn find_frames(
    scene: &dyn Scene,
    vertices: &mut Vertices,
    budget: u64,
    threads: usize,
    progress: &Progress,
) -> Result<Frames> {
    let n = scene.n_triangles();
    if n > MOST_TRIANGLES || FRAME_BYTES * n > budget {
        return Ok(Frames::default());
    }
    let mut all = Vec::with_capacity(n as usize);
    each_block(scene, threads, progress, |faces| {
        vertices.tick();
        for (i, ids) in faces.triangles.iter().enumerate() {
            let own = get_three(ids, vertices)?;
            let mut corners =
                own.each_ref().map(|v| Corner { place: v.place, ..Corner::default() });
            if let Some((uv, _)) = faces.looks.of(i) {
                (0..3).for_each(|k| corners[k].uv = uv[k]);
            }
            put_normals(&mut corners, ids, Some(&own), vertices);
            all.push(corners);
        }
        Ok(())
    })?;
    Ok(Frames::of(&all))
}

/// The normal to light a corner by: the vertex's, unless the face turns so far away from it that there
/// must be a crease.
fn creased(smooth: [f32; 3], flat: [f32; 3]) -> [f32; 3] {
    let along = smooth[0] * flat[0] + smooth[1] * flat[1] + smooth[2] * flat[2];
    let share = smoothstep(0.45, 0.8, along);
    std::array::from_fn(|i| flat[i] + share * (smooth[i] - flat[i]))
}

/// Angle-free vertex normals: face normals weighted by the root of their area, or by their area, as results have them that
/// normal maps were made for; in camera space.
fn vertex_normals(
    scene: &dyn Scene,
    vertices: &mut Vertices,
    by_area: bool,
    threads: usize,
    progress: &Progress,
) -> Result<Vec<[f32; 3]>> {
    let mut normals = vec![[0.0f32; 3]; scene.n_vertices() as usize];
    each_block(scene, threads, progress, |faces| {
        for ids in &faces.triangles {
            let mut places = [[0.0; 3]; 3];
            for (place, id) in places.iter_mut().zip(ids) {
                *place = vertices.get(*id)?.place.map(f64::from);
            }
            // Scaled by the root of its length: large faces count more, but do not swamp small ones.
            let area = normal(places);
            let Some(direction) = unit(area) else { continue };
            let length = dot(area, area).sqrt();
            let weight = if by_area { length } else { length.sqrt() };
            for id in ids {
                for (sum, x) in normals[*id as usize].iter_mut().zip(direction) {
                    *sum += (weight * x) as f32;
                }
            }
        }
        Ok(())
    })?;
    for normal in &mut normals {
        let direction = unit(normal.map(f64::from)).unwrap_or([0.0, 0.0, 1.0]);
        *normal = direction.map(|x| x as f32);
    }
    Ok(normals)
}

/// Places the camera for a view.
pub(super) fn aim(
    scene: &dyn Scene,
    view: &View,
    per_pixel: usize,
    resources: Resources,
    progress: &Progress,
) -> Result<Camera> {
    if let Some(Aim(camera)) = &view.aim {
        return Ok(camera.clone());
    }
    let size = [view.width as usize * per_pixel, view.height as usize * per_pixel];
    let threads = resources.threads;
    let extent = extent(scene, threads, progress)?;
    let (mut up, natural) = extent.natural_view();
    match view.direction {
        // Who names a direction thinks in axes; a flat thing that leans a little would roll the picture.
        Direction::From(_) => up = nearest_axis(up),
        Direction::Upright { up: given, .. } => up = given,
        Direction::Auto => {}
    }
    let direction = match (view.direction, &view.zoom) {
        (Direction::From(direction) | Direction::Upright { from: direction, .. }, _) => direction,
        (Direction::Auto, Some(sphere)) => {
            let outward = facing(scene, sphere, resources, progress)?;
            outward.map_or(natural, |n| add(add(n, scale(up, 0.35)), scale(natural, 0.25)))
        }
        (Direction::Auto, None) => natural,
    };
    if let Some(sphere) = &view.zoom {
        let mut camera = Camera::facing(sphere.centre, direction, up, size);
        camera.frame_sphere(sphere.radius.max(1e-9 * extent.radius()).max(f64::MIN_POSITIVE));
        return Ok(camera);
    }
    let mut camera = Camera::facing(extent.middle(), direction, up, size);
    let mut silhouette: Silhouette = camera.silhouette();
    each_point(scene, threads, progress, |points| {
        points.iter().for_each(|p| silhouette.add(camera.place(*p)));
    })?;
    camera.frame(&silhouette);
    Ok(camera)
}

/// Size, place and main directions of a scene.
pub(super) fn extent(scene: &dyn Scene, threads: usize, progress: &Progress) -> Result<Extent> {
    let mut extent = Extent::default();
    each_point(scene, threads, progress, |points| points.iter().for_each(|p| extent.add(*p)))?;
    Ok(extent)
}

/// Returns the mean normal of the surface inside a sphere; `None` if nothing is there.
fn facing(
    scene: &dyn Scene,
    sphere: &Sphere,
    resources: Resources,
    progress: &Progress,
) -> Result<Option<Vec3>> {
    let camera = Camera::upright(sphere.centre);
    let threads = resources.threads;
    let budget = resources.memory_bytes.saturating_sub(SLACK_BYTES);
    let mut vertices = Vertices::new(scene, &camera, budget, threads, progress)?;
    let mut sum = [0.0; 3];
    each_block(scene, threads, progress, |faces| {
        vertices.tick();
        for ids in &faces.triangles {
            let first = vertices.get(ids[0])?.place.map(f64::from);
            if dot(first, first) < sphere.radius * sphere.radius {
                let [_, b, c] = *ids;
                let (b, c) = (vertices.get(b)?.place, vertices.get(c)?.place);
                sum = add(sum, normal([first, b.map(f64::from), c.map(f64::from)]));
            }
        }
        Ok(())
    })?;
    Ok(unit(sum))
}

/// Reads all vertices in order, decoding on `threads` threads.
fn each_point(
    scene: &dyn Scene,
    threads: usize,
    progress: &Progress,
    mut visit: impl FnMut(&[Vec3]),
) -> Result<()> {
    let read = |block: u64, points: &mut Points| scene.points(block, points);
    in_order(scene.n_point_blocks(), threads, progress, read, |_, points| {
        visit(&points.positions);
        Ok(())
    })
}

/// Reads all faces in order, decoding on `threads` threads.
fn each_block(
    scene: &dyn Scene,
    threads: usize,
    progress: &Progress,
    mut visit: impl FnMut(&Faces) -> Result<()>,
) -> Result<()> {
    let read = |block: u64, faces: &mut Faces| scene.faces(block, faces);
    in_order(scene.n_face_blocks(), threads, progress, read, |_, faces| visit(faces))
}
