//! Likeness of two meshes to the eye: pictures of both by the same cameras, compared pixel by pixel.
//!
//! Cameras stand evenly around the original and see all of its box. Only the silhouette counts: pixels where either mesh
//! is seen. `render` makes the pictures, `likeness` compares two of them. Does not measure shape.

mod likeness;

pub use likeness::Likeness;
use likeness::Sums;
use stonecut_io::ply::MeshSource;
use stonecut_render::{
    Aim, Coloring, Lighting, Picture, Resources, Shot, View, aims_around, has_looks, least_bytes,
    shots,
};
use stonecut_system::error::{Error, Result};
use stonecut_system::progress::Progress;
use stonecut_system::units::{memory_word, show_bytes};

/// Views by default.
pub const DEFAULT_VIEWS: u32 = 12;

/// Views at most: pictures of the original stay in memory, 2.3 MiB each.
pub const MOST_VIEWS: u32 = 240;

/// Pixels of a side of each picture.
const SIDE: u32 = 768;

/// Settings of a comparison.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Views, 1 to `MOST_VIEWS`.
    pub views: u32,
    /// With lamps and shade although the original has colours.
    pub lit: bool,
}

/// The view in which two meshes differ most.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct WorstView {
    /// Its number, from 0.
    pub view: u32,
    /// From the mesh to the viewer.
    pub direction: [f64; 3],
    /// Likeness there.
    #[serde(flatten)]
    pub likeness: Likeness,
}

/// Report of a comparison.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Appearance {
    /// Views.
    pub views: u32,
    /// Pixels of a side of each picture.
    pub pixels: u32,
    /// `unlit`: surfaces show their own colours; `studio`: they are lit.
    pub lighting: &'static str,
    /// Likeness over the silhouettes of all views.
    #[serde(flatten)]
    pub likeness: Likeness,
    /// The view of the lowest PSNR.
    pub worst: WorstView,
}

/// The view that pictures are taken in, but for its aim.
fn view(original: &MeshSource, lit: bool) -> View {
    let has_colours = has_looks(original);
    View {
        width: SIDE,
        height: SIDE,
        coloring: if has_colours { Coloring::Texture } else { Coloring::Plain },
        lighting: if has_colours && !lit { Lighting::Unlit } else { Lighting::Studio },
        ..View::default()
    }
}

/// Bytes of the pictures of the original, which stay in memory: three colours a pixel, and whether a surface is seen there.
fn kept_bytes(views: u32) -> u64 {
    u64::from(views) * u64::from(SIDE * SIDE) * 4
}

/// Refuses pictures that the memory does not hold, before any work; names the memory that does.
pub fn hold(
    (original, simplified): (&MeshSource, &MeshSource),
    settings: Settings,
    memory_bytes: u64,
) -> Result<()> {
    let view = view(original, settings.lit);
    let pictures = least_bytes(original, &view)?.max(least_bytes(simplified, &view)?);
    let needed = pictures + kept_bytes(settings.views);
    if needed <= memory_bytes {
        return Ok(());
    }
    Err(Error::NoMemory(format!(
        "pictures of {SIDE}x{SIDE} pixels in {} views take {}, the budget has {}; give --memory {}, or fewer --views",
        settings.views,
        show_bytes(needed),
        show_bytes(memory_bytes),
        memory_word(needed)
    )))
}

/// Compares the pictures of two meshes; `each` gets the number and both pictures of every view.
///
/// The lighting depends on the original: with images, materials or vertex colours it is unlit, otherwise (and with
/// `lit`) it is the studio of `render`. Source of SSIM: Wang et al. 2004 (docs/references.md).
///
/// Memory: as `render`, and 2.3 MiB a view. Time: a pass over both meshes a view.
///
/// Errors: those of `render`, and of `each`.
pub fn compare(
    (original, simplified): (&MeshSource, &MeshSource),
    settings: Settings,
    resources: Resources,
    progress: &Progress,
    mut each: impl FnMut(u32, [&Picture; 2]) -> Result<()>,
) -> Result<Appearance> {
    hold((original, simplified), settings, resources.memory_bytes)?;
    let left = resources.memory_bytes.saturating_sub(kept_bytes(settings.views));
    let resources = Resources { memory_bytes: left, ..resources };
    let view = view(original, settings.lit);
    let lighting = view.lighting;
    let aims = aims_around(original, &view, settings.views.max(1), resources, progress)?;
    let views: Vec<View> =
        aims.iter().map(|aim: &Aim| View { aim: Some(aim.clone()), ..view.clone() }).collect();
    let mut firsts: Vec<Shot> = Vec::new();
    shots(original, &views, resources, progress, |_, shot| {
        firsts.push(shot);
        Ok(())
    })?;
    let (mut all, mut worst) = (Sums::default(), None::<(f64, WorstView)>);
    shots(simplified, &views, resources, progress, |number, shot| {
        let first = &firsts[number];
        let silhouette: Vec<bool> =
            first.covered.iter().zip(&shot.covered).map(|(a, b)| *a || *b).collect();
        let pictures = [&first.picture, &shot.picture];
        each(number as u32, pictures)?;
        let sums = Sums::of(pictures, &silhouette);
        all.add(&sums);
        let error = sums.mean_square();
        if worst.as_ref().is_none_or(|(most, _)| error > *most) {
            let direction = aims[number].direction();
            let likeness = sums.likeness();
            worst = Some((error, WorstView { view: number as u32, direction, likeness }));
        }
        Ok(())
    })?;
    let none = WorstView { view: 0, direction: [0.0; 3], likeness: all.likeness() };
    Ok(Appearance {
        views: views.len() as u32,
        pixels: SIDE,
        lighting: match lighting {
            Lighting::Unlit => "unlit",
            Lighting::Studio => "studio",
        },
        likeness: all.likeness(),
        worst: worst.map_or(none, |(_, worst)| worst),
    })
}
