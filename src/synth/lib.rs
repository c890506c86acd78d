//! Synthetic scans of any size: closed-form, seeded, streamed.
//!
//! `write_ply` is the way in for files, `mesh` for tests. A `Surface` says what vertex and face number i
//! are. `write` turns it into records; `shuffle` puts into random order what cannot be computed in one.
//! Nothing here simplifies, measures or reads a mesh.

mod foam;
mod gyroid;
mod noise;
mod permutation;
mod rooms;
mod scans;
mod sculpture;
mod shuffle;
mod sliced;
mod statue;
mod surface;
mod terrain;
mod tiles;
mod volume;
mod write;
mod write_shuffled;

use rooms::Rooms;
use sliced::CountedSurface;
use std::path::Path;
use stonecut_io::ply::{OutputHeader, Place};
use stonecut_io::{MeshSink, OutputFormat, OutputKind};
use stonecut_mesh::Mesh;
use stonecut_system::error::{Error, Result};
use stonecut_system::progress::Progress;
use surface::{InOrder, Indexed, Order, Shuffled, Surface};
pub use tiles::{Cut, Rounding, TileCounts};
use volume::{Scanner, Volume};
use write::{FileProperties, Stream, put_faces};
use write_shuffled::write_shuffled;

/// The synthetic meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Fractal height field with scan noise; open boundary.
    Terrain,
    /// A stone head with creases and fine chisel marks; closed, genus 0.
    Statue,
    /// An isosurface full of slivers; closed, of high genus.
    Gyroid,
    /// Overlapping, noisy, coloured range scans with holes and specks; open, in many pieces.
    Scans,
    /// The isosurface of a noisy volume: one folded surface, tens of thousands of specks, open at the volume's faces.
    Volume,
    /// An interior with thin walls, holes, crumbs, and a fragmented atlas on several written images; coloured.
    Rooms,
    /// Cells of a foam, each wall once with the regions on both sides as labels; three walls meet at an edge.
    Foam,
}

impl Kind {
    /// All kinds with their names, as they are typed and as they stand in the headers of what is made.
    const NAMED: [(Kind, &str); 7] = [
        (Kind::Terrain, "terrain"),
        (Kind::Statue, "statue"),
        (Kind::Gyroid, "gyroid"),
        (Kind::Scans, "scans"),
        (Kind::Volume, "volume"),
        (Kind::Rooms, "rooms"),
        (Kind::Foam, "foam"),
    ];

    /// The name.
    fn name(self) -> &'static str {
        let named = Kind::NAMED.iter().find(|(kind, _)| *kind == self);
        named.map_or("", |(_, name)| name)
    }
}

impl std::str::FromStr for Kind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let named = Kind::NAMED.iter().find(|(_, name)| *name == text);
        named.map(|(kind, _)| *kind).ok_or_else(|| {
            let names: Vec<&str> = Kind::NAMED.iter().map(|(_, name)| *name).collect();
            format!("unknown kind of mesh '{text}': use {}", names.join(", "))
        })
    }
}

/// Settings of a synthetic mesh; every value is final.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Kind of mesh.
    pub kind: Kind,
    /// Least number of triangles; each kind documents how many more it may get.
    pub n_triangles: u64,
    /// Another seed gives another mesh of the same kind and size.
    pub seed: u64,
    /// Random instead of natural order of vertices, faces and corners.
    pub shuffle: bool,
    /// With `red green blue`; `scans` and `rooms` always have them.
    pub color: bool,
    /// With texture coordinates `s t`.
    pub uv: bool,
    /// Factor of the scanner's noise; `terrain`, `statue` and `volume` alone have another than 1.
    pub noise: f64,
    /// Whole voxel values that meet the level exactly; `volume` alone has voxels.
    pub integer: bool,
    /// Water at a height of exactly 0; `terrain` alone has any.
    pub sea: bool,
    /// Largest number of texture images; `rooms` alone has any. One for 25,000 triangles, at most 1000, if `None`.
    pub pages: Option<u64>,
}

impl Settings {
    /// A plain mesh of a kind: seed 1, natural order, usual noise, nothing but positions.
    pub fn new(kind: Kind, n_triangles: u64) -> Self {
        Settings {
            kind,
            n_triangles,
            seed: 1,
            shuffle: false,
            color: false,
            uv: false,
            noise: 1.0,
            integer: false,
            sea: false,
            pages: None,
        }
    }
}

/// Settings of writing a mesh.
#[derive(Clone, Copy, Debug)]
pub struct Writing {
    /// Threads to compute with; they change no byte.
    pub threads: usize,
    /// True if an existing file may be replaced.
    pub force: bool,
    /// As which kind of file; binary little-endian PLY by default.
    pub format: OutputFormat,
}

/// Sizes of the finished mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    /// Number of vertices.
    pub n_vertices: u64,
    /// Number of triangles.
    pub n_triangles: u64,
    /// Number of texture images beside the mesh.
    pub n_images: u64,
}

/// Writes a synthetic mesh.
///
/// `rooms` as PLY or OBJ writes its images beside the file, `STEM_000.png` and so on, and an OBJ's `STEM.mtl`; STL and
/// GLB get the mesh alone.
///
/// The bytes depend on `settings` and the format alone; memory is a few megabytes a thread, and some 100 MB when
/// anything but `terrain` and `statue` is shuffled. The file appears by rename.
/// Errors: an existing `path` without `force`, more than 2^32 vertices, whatever the system refuses.
pub fn write_ply(
    path: &Path,
    settings: &Settings,
    writing: Writing,
    progress: &Progress,
) -> Result<Counts> {
    check(settings)?;
    if path.exists() && !writing.force {
        let path = path.display();
        return Err(Error::Usage(format!("{path} exists; --force overwrites it")));
    }
    if settings.kind == Kind::Rooms && !rooms::file_names(path, 1, writing.format)?.0.is_empty() {
        let rooms = counted_rooms(settings, writing.threads, progress)?;
        return write_surface(path, settings, writing, progress, &rooms, Some(&rooms));
    }
    let surface = surface(settings, writing.threads, progress)?;
    write_surface(path, settings, writing, progress, &*surface, None)
}

/// Writes a surface; with `rooms`, which is the same surface, its textures too.
fn write_surface(
    path: &Path,
    settings: &Settings,
    writing: Writing,
    progress: &Progress,
    surface: &dyn Surface,
    rooms: Option<&CountedSurface<Rooms>>,
) -> Result<Counts> {
    let mut counts =
        Counts { n_vertices: surface.n_vertices(), n_triangles: surface.n_faces(), n_images: 0 };
    progress.begin("synth", 1, 1, counts.n_triangles);
    let layout = FileProperties { uv: settings.uv && rooms.is_none(), ..layout(settings) };
    let header = header(settings, layout, surface);
    let stream = Stream { surface, layout, threads: writing.threads, progress };
    if let Some(rooms) = rooms {
        let shuffle = settings.shuffle.then_some(settings.seed);
        let how = (writing.format, writing.force);
        counts.n_images = rooms::write(path, rooms, &stream, header, shuffle, how)?;
        return Ok(counts);
    }
    let place = Place { replace: writing.force, ..Place::from(path) };
    let mut file = MeshSink::create(place, header, writing.format)?;
    if settings.shuffle && !surface.is_shuffled() {
        write_shuffled(&mut file, path, &stream, settings.seed)?;
    } else {
        stream.vertices(|records| file.write_vertices(records))?;
        let put = |faces: &[_], labels: &[_]| put_faces(&mut file, faces, labels);
        stream.faces(|_, face| face, put)?;
    }
    file.finish()?;
    Ok(counts)
}

/// The header of a mesh that is written as one file.
fn header(settings: &Settings, layout: FileProperties, surface: &dyn Surface) -> OutputHeader {
    let (n_vertices, n_faces) = (surface.n_vertices(), surface.n_faces());
    let mut header = OutputHeader::new(layout.schema(), n_vertices, n_faces);
    header.faces = layout.faces();
    header.settings = format!(
        "synth {} --triangles {} --seed {}{}{}{}{}{}",
        settings.kind.name(),
        settings.n_triangles,
        settings.seed,
        if settings.shuffle { " --shuffle" } else { "" },
        if settings.noise == 1.0 { String::new() } else { format!(" --noise {}", settings.noise) },
        if settings.integer { " --integer" } else { "" },
        if settings.sea { " --sea" } else { "" },
        settings.pages.map_or_else(String::new, |pages| format!(" --pages {pages}")),
    );
    header
}

/// Writes a synthetic mesh in many files into a folder that is not there yet, or is empty; of a kind that
/// `writing.format` names, PLY without.
///
/// The bytes depend on `settings`, `cut` and the format alone. Memory: some 100 MB, and a tile of at most 4 M triangles on
/// average. Textured `rooms` keep their images, each tile naming those that it uses.
/// Errors: something in the way, settings that exclude each other, whatever the system refuses.
pub fn write_tiles(
    folder: &Path,
    settings: &Settings,
    cut: &Cut,
    writing: Writing,
    progress: &Progress,
) -> Result<TileCounts> {
    check(settings)?;
    check_cut(settings, cut)?;
    let kind = writing.format.kind.unwrap_or(OutputKind::Ply);
    let format = OutputFormat { kind: Some(kind), ..writing.format };
    let is_textured = matches!(kind, OutputKind::Ply | OutputKind::Obj);
    let cut_one = |surface: &dyn Surface, rooms: Option<&CountedSurface<Rooms>>| {
        progress.begin("synth", 1, 1, surface.n_faces());
        let layout = FileProperties { uv: settings.uv && rooms.is_none(), ..layout(settings) };
        let header = header(settings, layout, surface);
        let stream = Stream { surface, layout, threads: writing.threads, progress };
        tiles::write(folder, &tiles::WholeScan { stream, rooms, header }, cut, format)
    };
    if settings.kind == Kind::Rooms && is_textured {
        let rooms = counted_rooms(settings, writing.threads, progress)?;
        return cut_one(&rooms, Some(&rooms));
    }
    cut_one(&*surface(settings, writing.threads, progress)?, None)
}

fn check_cut(settings: &Settings, cut: &Cut) -> Result<()> {
    if !(1..=tiles::MOST_TILES).contains(&cut.n_tiles) {
        let (asked, most) = (cut.n_tiles, tiles::MOST_TILES);
        return Err(Error::Usage(format!("--tiles {asked}: a number from 1 to {most}")));
    }
    if settings.shuffle {
        return Err(Error::Usage("--shuffle: not with --tiles, which sorts by place".to_owned()));
    }
    if settings.kind == Kind::Foam {
        return Err(Error::Usage(
            "--tiles: not for foam, whose labels tiles do not carry".to_owned(),
        ));
    }
    if cut.t_junctions && cut.overlap > 0.0 {
        return Err(Error::Usage(
            "--t-junctions and --overlap: tiles that overlap have no common border; give one of them".to_owned(),
        ));
    }
    Ok(())
}

/// The same mesh in memory, for tests and small demonstrations; colours are three channels in [0, 255],
/// texture coordinates two more.
///
/// Errors: settings that `write_ply` refuses.
pub fn mesh(settings: &Settings) -> Result<Mesh> {
    check(settings)?;
    let surface = surface(settings, 1, &Progress::default())?;
    let layout = layout(settings);
    let mut mesh = Mesh {
        n_channels: if layout.color { 3 } else { 0 } + if layout.uv { 2 } else { 0 },
        ..Mesh::default()
    };
    let mut vertices = Vec::new();
    for block in 0..surface.n_vertex_blocks() {
        vertices.clear();
        surface.vertices(block, &mut vertices);
        for vertex in &vertices {
            mesh.positions.push(vertex.position.map(f64::from));
            if layout.color {
                mesh.channels.extend(vertex.color.map(f32::from));
            }
            if layout.uv {
                mesh.channels.extend(vertex.uv);
            }
        }
    }
    let mut faces = Vec::new();
    for block in 0..surface.n_face_blocks() {
        faces.clear();
        surface.faces(block, &mut faces);
        mesh.triangles.extend(faces.iter().map(|face| face.map(|id| id as u32)));
    }
    Ok(if settings.shuffle && !surface.is_shuffled() {
        reordered(&mesh, &Order::new(surface.n_vertices(), surface.n_faces(), settings.seed))
    } else {
        mesh
    })
}

/// A mesh in another order.
fn reordered(mesh: &Mesh, order: &Order) -> Mesh {
    let mut out = mesh.clone();
    for id in 0..mesh.positions.len() {
        let to = order.vertices.apply(id as u64) as usize;
        let n = mesh.n_channels;
        out.positions[to] = mesh.positions[id];
        out.channels[to * n..(to + 1) * n].copy_from_slice(&mesh.channels[id * n..(id + 1) * n]);
    }
    for (row, face) in mesh.triangles.iter().enumerate() {
        let face = order.renumber(row as u64, face.map(u64::from));
        out.triangles[order.faces.apply(row as u64) as usize] = face.map(|id| id as u32);
    }
    out
}

fn surface(settings: &Settings, threads: usize, progress: &Progress) -> Result<Box<dyn Surface>> {
    let Settings { n_triangles, seed, color, .. } = *settings;
    Ok(match settings.kind {
        Kind::Terrain => {
            let ground = (settings.sea, settings.noise);
            ordered(terrain::Terrain::new(n_triangles, seed, color, ground), settings)
        }
        Kind::Statue => {
            ordered(statue::Statue::new(n_triangles, seed, color, settings.noise), settings)
        }
        Kind::Gyroid => {
            Box::new(CountedSurface::at_least(n_triangles, threads, progress, |scale| {
                gyroid::Gyroid::new(n_triangles, scale, seed, color)
            })?)
        }
        Kind::Scans => {
            Box::new(CountedSurface::at_least(n_triangles, threads, progress, |scale| {
                scans::Scans::new(n_triangles, scale, seed)
            })?)
        }
        Kind::Rooms => Box::new(counted_rooms(settings, threads, progress)?),
        Kind::Foam => {
            let foam = foam::Foam::new(n_triangles, seed, color);
            Box::new(CountedSurface::new(foam, threads, progress)?)
        }
        Kind::Volume => {
            let scanner =
                Scanner { seed, noise: settings.noise, integer: settings.integer, colored: color };
            Box::new(CountedSurface::near(n_triangles, threads, progress, |scale| {
                Volume::new(n_triangles, scale, scanner)
            })?)
        }
    })
}

fn counted_rooms(
    settings: &Settings,
    threads: usize,
    progress: &Progress,
) -> Result<CountedSurface<Rooms>> {
    let Settings { n_triangles, seed, .. } = *settings;
    let n_pages = settings.pages.unwrap_or((n_triangles / 25_000).clamp(1, 1000));
    CountedSurface::near(n_triangles, threads, progress, |scale| {
        Rooms::new(n_triangles, scale, n_pages, seed)
    })
}

fn ordered(surface: impl Indexed + 'static, settings: &Settings) -> Box<dyn Surface> {
    if settings.shuffle {
        Box::new(Shuffled::new(surface, settings.seed))
    } else {
        Box::new(InOrder(surface))
    }
}

fn layout(settings: &Settings) -> FileProperties {
    let color = settings.color || matches!(settings.kind, Kind::Scans | Kind::Rooms);
    FileProperties { color, uv: settings.uv, labels: settings.kind == Kind::Foam }
}

fn check(settings: &Settings) -> Result<()> {
    const MOST: u64 = 7_000_000_000;
    if settings.n_triangles == 0 || settings.n_triangles > MOST {
        let asked = settings.n_triangles;
        return Err(Error::Usage(format!(
            "--triangles {asked}: a synthetic mesh has 1 to {MOST} triangles (its vertices are numbered \
             in 32 bits)"
        )));
    }
    if settings.kind != Kind::Volume && settings.integer {
        return Err(Error::Usage(
            "--integer is a property of a scanned volume: only `synth volume` has it".to_owned(),
        ));
    }
    let has_noise = matches!(settings.kind, Kind::Terrain | Kind::Statue | Kind::Volume);
    if !has_noise && settings.noise != 1.0 {
        return Err(Error::Usage(
            "--noise: only `synth terrain`, `statue` and `volume` have a factor for it".to_owned(),
        ));
    }
    if settings.kind != Kind::Terrain && settings.sea {
        return Err(Error::Usage("--sea: only `synth terrain` has a sea".to_owned()));
    }
    if settings.kind != Kind::Rooms && settings.pages.is_some() {
        return Err(Error::Usage("--pages: only `synth rooms` has texture images".to_owned()));
    }
    if settings.pages == Some(0) {
        return Err(Error::Usage("--pages 0: textures need at least one image".to_owned()));
    }
    if !(0.0..=4.0).contains(&settings.noise) {
        let noise = settings.noise;
        return Err(Error::Usage(format!(
            "--noise {noise}: the factor of the usual noise is a number from 0 to 4"
        )));
    }
    Ok(())
}
