//! Colours of many places: images one after the other, as many at a time as the cache holds.

use super::images::{Decoded, ImageCache};
use super::light_table::Light;
use super::paint::Paint;
use super::palette::Palette;
use super::purpose::SEEN;
use std::ops::Range;
use std::sync::Arc;
use stonecut_io::materials::MapKind;
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;

/// Places that go to a thread together.
const BLOCK: usize = 4096;

/// A place on a surface that has materials.
#[derive(Clone, Copy)]
pub struct Spot {
    /// The number of its material.
    pub material: u32,
    /// Texture coordinates.
    pub uv: [f32; 2],
    /// True along each if its triangle lies within one repetition ([`UvBox::within_one`](super::UvBox::within_one)).
    pub within: [bool; 2],
    /// Length in texture coordinates that its colour stands for.
    pub apart: f64,
}

/// Some images that colours are looked up in.
struct Look<'a> {
    kind: MapKind,
    images: &'a [Option<Arc<Decoded>>],
    /// Their numbers, ascending.
    group: &'a [usize],
}

impl Look<'_> {
    /// The factor that an image gives at a place; `None` where it has nothing to say.
    fn at(&self, paint: &Paint, image: usize, spot: &Spot, cache: &ImageCache) -> Option<Light> {
        let map = paint.map(self.kind)?;
        let decoded = self.images[self.group.binary_search(&image).ok()?].as_ref()?;
        let width = spot.apart * map.texels_per_coordinate;
        let table = if self.kind.is_colour() { &cache.table } else { &cache.plain };
        let light = decoded.at(map, (spot.uv, spot.within), width as f32, table)?;
        Some(match self.kind {
            MapKind::Opacity => [decoded.opacity_of(light); 4],
            MapKind::Roughness | MapKind::Metallic => [light[map.channel]; 4],
            _ => light,
        })
    }
}

/// Runs in blocks of about `BLOCK` places.
fn blocks_of(runs: &[(usize, Range<usize>)]) -> Vec<&[(usize, Range<usize>)]> {
    let (mut blocks, mut start, mut n) = (Vec::new(), 0, 0);
    for (i, (_, run)) in runs.iter().enumerate() {
        n += run.len();
        if n >= BLOCK {
            blocks.push(&runs[start..=i]);
            (start, n) = (i + 1, 0);
        }
    }
    blocks.extend((start < runs.len()).then(|| &runs[start..]));
    blocks
}

/// A colour multiplied by its opacity.
pub fn times_opacity([r, g, b, opacity]: Light) -> Light {
    [r * opacity, g * opacity, b * opacity, opacity]
}

/// Multiplies the light of each place, which is multiplied by its opacity, with what the images of its material say.
pub fn multiply(
    lights: &mut [Light],
    spots: &[Spot],
    looks: (&Palette, &ImageCache),
    threads: usize,
    progress: &Progress,
) -> Result<()> {
    let is_there = |kind: &MapKind| looks.0.paints.iter().any(|paint| paint.map(*kind).is_some());
    SEEN.into_iter().filter(is_there).try_for_each(|kind| {
        look_up((kind, spots), looks, threads, progress, |i, light| {
            let own = &mut lights[i];
            *own = std::array::from_fn(|k| own[k] * light[k]);
        })
    })
}

/// Gives `put` what the images of one kind say at the places that have one: linear light and opacity, or the numbers
/// themselves.
///
/// Memory: 24 bytes a run of places with the same image, and the images. The outcome depends on nothing but the arguments.
pub fn look_up(
    (kind, spots): (MapKind, &[Spot]),
    (palette, cache): (&Palette, &ImageCache),
    threads: usize,
    progress: &Progress,
    mut put: impl FnMut(usize, Light),
) -> Result<()> {
    let paint = |spot: &Spot| palette.paints.get(spot.material as usize);
    let image = |spot: &Spot| paint(spot)?.map(kind).map(|map| map.image);
    // Neighbours mostly have the same image, so runs of them are sorted, not places.
    let mut runs: Vec<(usize, Range<usize>)> = Vec::new();
    for (i, spot) in spots.iter().enumerate() {
        let Some(image) = image(spot) else { continue };
        match runs.last_mut() {
            Some((own, run)) if *own == image && run.end == i && run.len() < BLOCK => {
                run.end += 1;
            }
            _ => runs.push((image, i..i + 1)),
        }
    }
    runs.sort_by_key(|(image, run)| (*image, run.start));
    let mut numbers: Vec<usize> = runs.iter().map(|(image, _)| *image).collect();
    numbers.dedup();
    let mut from = 0;
    while from < numbers.len() {
        let n = cache.fitting(&numbers[from..]);
        let group = &numbers[from..from + n];
        let images = cache.get(group, threads, progress)?;
        let begin = runs.partition_point(|(image, _)| *image < group[0]);
        let end = runs.partition_point(|(image, _)| *image <= group[n - 1]);
        let blocks = blocks_of(&runs[begin..end]);
        let look = Look { kind, images: &images, group };
        in_order(
            blocks.len() as u64,
            threads,
            progress,
            |block, out: &mut Vec<Option<Light>>| {
                out.clear();
                for (image, run) in blocks[block as usize] {
                    out.extend(spots[run.clone()].iter().map(|spot| {
                        paint(spot).and_then(|paint| look.at(paint, *image, spot, cache))
                    }));
                }
                Ok(())
            },
            |block, found| {
                let places = blocks[block as usize].iter().flat_map(|(_, run)| run.clone());
                for (i, light) in places.zip(found.iter()) {
                    if let Some(light) = light {
                        put(i, *light);
                    }
                }
                Ok(())
            },
        )?;
        from += n;
    }
    Ok(())
}
