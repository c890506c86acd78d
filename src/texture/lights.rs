//! Colours of many places: images one after the other, as many at a time as the cache holds.

use super::images::{Decoded, ImageCache, Light};
use super::palette::{MapUse, Paint, Palette};
use crate::error::Result;
use crate::system::parallel::in_order;
use crate::system::progress::Progress;
use std::sync::Arc;

/// Places that go to a thread together.
const BLOCK: usize = 4096;

/// A place on a surface that has materials.
#[derive(Clone, Copy)]
pub(crate) struct Spot {
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
        let width = spot.apart * map.texels_per_coordinate();
        let light = decoded.at(map, spot.uv, width as f32, &cache.table)?;
        Some(match self.role {
            Role::Base => light,
            Role::Opacity => [decoded.opacity_of(light); 4],
        })
    }
}

/// A colour multiplied by its opacity.
pub(crate) fn times_opacity([r, g, b, opacity]: Light) -> Light {
    [r * opacity, g * opacity, b * opacity, opacity]
}

/// Multiplies the light of each place, which is multiplied by its opacity, with what the images of its material say.
///
/// Memory: 8 bytes a place, and the images. The outcome depends on nothing but the arguments.
pub(crate) fn multiply(
    lights: &mut [Light],
    spots: &[Spot],
    (palette, cache): (&Palette, &ImageCache),
    threads: usize,
    progress: &Progress,
) -> Result<()> {
    let paint = |spot: &Spot| palette.paints.get(spot.material as usize);
    for role in [Role::Base, Role::Opacity] {
        let image = |spot: &Spot| role.map(paint(spot)?).map(|map| map.image);
        let mut wanted: Vec<(u32, u32)> = Vec::new();
        for (i, spot) in spots.iter().enumerate() {
            if let Some(image) = image(spot) {
                wanted.push((image as u32, i as u32));
            }
        }
        wanted.sort_unstable();
        let mut numbers: Vec<usize> = wanted.iter().map(|&(image, _)| image as usize).collect();
        numbers.dedup();
        let mut from = 0;
        while from < numbers.len() {
            let n = cache.fitting(&numbers[from..]);
            let group = &numbers[from..from + n];
            let images = cache.get(group, threads, progress)?;
            let begin = wanted.partition_point(|&(image, _)| (image as usize) < group[0]);
            let end = wanted.partition_point(|&(image, _)| image as usize <= group[n - 1]);
            let some = &wanted[begin..end];
            let look = Look { role, images: &images, group };
            in_order(
                some.len().div_ceil(BLOCK) as u64,
                threads,
                progress,
                |block, out: &mut Vec<(u32, Light)>| {
                    out.clear();
                    let first = block as usize * BLOCK;
                    for &(image, i) in &some[first..(first + BLOCK).min(some.len())] {
                        let spot = &spots[i as usize];
                        if let Some(light) = paint(spot)
                            .and_then(|paint| look.at(paint, image as usize, spot, cache))
                        {
                            out.push((i, light));
                        }
                    }
                    Ok(())
                },
                |_, found| {
                    for &(i, light) in found.iter() {
                        let own = &mut lights[i as usize];
                        *own = std::array::from_fn(|k| own[k] * light[k]);
                    }
                    Ok(())
                },
            )?;
            from += n;
        }
    }
    Ok(())
}
