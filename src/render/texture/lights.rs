//! Colours of many places: images one after the other, as many at a time as the cache holds.

use super::images::{Decoded, ImageCache, Light};
use super::palette::{MapUse, Paint, Palette};
use std::ops::Range;
use std::sync::Arc;
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
    /// Length in texture coordinates that its colour stands for.
    pub apart: f64,
}

/// Role of an image at a place.
#[derive(Clone, Copy)]
enum Role {
    Base,
    Opacity,
}

impl Role {
    fn map(self, paint: &Paint) -> Option<&MapUse> {
        match self {
            Role::Base => paint.base.as_ref(),
            Role::Opacity => paint.opacity.as_ref(),
        }
    }
}

/// Some images that colours are looked up in.
struct Look<'a> {
    role: Role,
    images: &'a [Option<Arc<Decoded>>],
    /// Their numbers, ascending.
    group: &'a [usize],
}

impl Look<'_> {
    /// The factor that an image gives at a place; `None` where it has nothing to say.
    fn at(&self, paint: &Paint, image: usize, spot: &Spot, cache: &ImageCache) -> Option<Light> {
        let map = self.role.map(paint)?;
        let decoded = self.images[self.group.binary_search(&image).ok()?].as_ref()?;
        let width = spot.apart * map.texels_per_coordinate;
        let light = decoded.at(map, spot.uv, width as f32, &cache.table)?;
        Some(match self.role {
            Role::Base => light,
            Role::Opacity => [decoded.opacity_of(light); 4],
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
///
/// Memory: 24 bytes a run of places with the same image, and the images. The outcome depends on nothing but the arguments.
pub fn multiply(
    lights: &mut [Light],
    spots: &[Spot],
    (palette, cache): (&Palette, &ImageCache),
    threads: usize,
    progress: &Progress,
) -> Result<()> {
    let paint = |spot: &Spot| palette.paints.get(spot.material as usize);
    for role in [Role::Base, Role::Opacity] {
        let image = |spot: &Spot| role.map(paint(spot)?).map(|map| map.image);
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
            let look = Look { role, images: &images, group };
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
                            let own = &mut lights[i];
                            *own = std::array::from_fn(|k| own[k] * light[k]);
                        }
                    }
                    Ok(())
                },
            )?;
            from += n;
        }
    }
    Ok(())
}
