//! Images on surfaces: samples have places in images while faces stream by, and get their colours here, image by image.
//!
//! So each image is decoded once a picture (once a layer, where images have holes), however faces and materials are
//! mixed, and no more images are in memory than the budget for them holds. Does not draw triangles.

use super::frames::bent;
use super::raster::Frame;
use super::sample::Sample;
use crate::texture::{Decoded, ImageCache, Light, MapUse, Paint, Palette, UvBox};
use std::collections::BTreeSet;
use std::sync::Arc;
use stonecut_mesh::oklab::srgb_of_linear;
use stonecut_system::error::Result;
use stonecut_system::parallel::in_blocks;
use stonecut_system::progress::Progress;

/// Samples that are coloured at a time, and by one thread.
const STRETCH: usize = 1 << 16;
const BLOCK: usize = 1 << 14;

/// Opacity from which on a material without a mask is drawn.
const HALF: f32 = 0.5;

/// A material as the rasteriser sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Skin {
    /// Texels of its image for a length of 1 in each coordinate; `None` without any image.
    pub(super) texels: Option<[f32; 2]>,
    /// Its own colour, sRGB values in [0, 1].
    pub(super) color: [f32; 3],
    /// True if it has a normal map.
    pub(super) is_bumped: bool,
}

/// Materials of a mesh with their images.
pub(super) struct Skins<'a> {
    palette: &'a Palette,
    images: &'a ImageCache<'a>,
    list: Vec<Skin>,
    /// The colour of everything, sRGB, where only normal maps are wanted.
    clay: Option<[f32; 3]>,
}

/// The image that leads the size of a material's texels.
fn first_map(paint: &Paint) -> Option<&MapUse> {
    paint.base.as_ref().or(paint.opacity.as_ref()).or(paint.normal.as_ref())
}

impl<'a> Skins<'a> {
    /// With `clay` everything has this colour, and only normal maps count.
    pub(super) fn new(
        palette: &'a Palette,
        images: &'a ImageCache<'a>,
        clay: Option<[f32; 3]>,
    ) -> Self {
        let skin = |paint: &Paint| {
            let [r, g, b, _] = paint.factor;
            let own = [r, g, b].map(|x| srgb_of_linear(f64::from(x)) as f32);
            Skin {
                texels: first_map(paint).map(MapUse::texels_along),
                color: clay.unwrap_or(own),
                is_bumped: paint.normal.is_some(),
            }
        };
        Skins { palette, images, list: palette.paints.iter().map(skin).collect(), clay }
    }

    /// True if any material has a normal map.
    pub(super) fn has_normal_maps(&self) -> bool {
        self.palette.has_normal_maps()
    }

    /// The material of this number.
    pub(super) fn get(&self, number: u32) -> Option<&Skin> {
        self.list.get(number as usize)
    }

    /// `Sample::WITHIN` of a triangle of this material.
    pub(super) fn within(&self, material: u32, uv_box: &UvBox) -> u8 {
        let Some(paint) = self.palette.paints.get(material as usize) else { return 0 };
        let is_within = |k: &usize| paint.maps().all(|map| map.within(uv_box)[*k]);
        [0, 1].into_iter().filter(is_within).map(|k| Sample::WITHIN[k]).sum()
    }

    /// Gives all samples that lie on images their colours; returns the places of those that are not there after all,
    /// since the image has a hole.
    ///
    /// Memory: images within the budget of the cache, 6 MiB, and 4 bytes for each of the places.
    pub(super) fn colour(
        &self,
        frame: &mut Frame,
        threads: usize,
        progress: &Progress,
    ) -> Result<Vec<u32>> {
        let mut cut = Vec::new();
        let mut is_used = vec![false; self.list.len()];
        for sample in &frame.samples {
            if let Some(is_used) = is_used.get_mut(sample.material as usize) {
                *is_used = true;
            }
        }
        let used: Vec<u32> = (0..).zip(is_used).filter(|(_, used)| *used).map(|(m, _)| m).collect();
        let mut from = 0;
        while from < used.len() {
            let (numbers, n) = self.fitting(&used[from..]);
            let decoded = self.images.get(&numbers, threads, progress)?;
            let group = Group { skins: self, materials: &used[from..from + n], numbers, decoded };
            group.colour(frame, &mut cut, threads, progress)?;
            from += n;
        }
        cut.sort_unstable();
        Ok(cut)
    }

    /// Images of as many of the materials as fit together, at least of the first, and the number of these materials.
    fn fitting(&self, materials: &[u32]) -> (Vec<usize>, usize) {
        let mut numbers = BTreeSet::new();
        for (n, &material) in materials.iter().enumerate() {
            let paint = &self.palette.paints[material as usize];
            let mut more = numbers.clone();
            more.extend(paint.maps().map(|map| map.image));
            let list: Vec<usize> = more.iter().copied().collect();
            if n > 0 && self.images.fitting(&list) < list.len() {
                return (numbers.into_iter().collect(), n);
            }
            numbers = more;
        }
        (numbers.into_iter().collect(), materials.len())
    }
}

/// Materials whose images are decoded.
struct Group<'a> {
    skins: &'a Skins<'a>,
    /// Numbers of the materials, ascending.
    materials: &'a [u32],
    /// Numbers of the images, ascending.
    numbers: Vec<usize>,
    decoded: Vec<Option<Arc<Decoded>>>,
}

impl Group<'_> {
    fn colour(
        &self,
        frame: &mut Frame,
        cut: &mut Vec<u32>,
        threads: usize,
        progress: &Progress,
    ) -> Result<()> {
        let n = frame.samples.len();
        for start in (0..n).step_by(STRETCH) {
            let stretch = &frame.samples[start..(start + STRETCH).min(n)];
            let mut found: Vec<(u32, Option<Sample>)> = Vec::with_capacity(stretch.len());
            in_blocks((stretch.len(), BLOCK), (threads, progress), &mut found, |some, out| {
                for (at, sample) in (start + some.start..).zip(&stretch[some]) {
                    if self.materials.binary_search(&sample.material).is_ok() {
                        let tint = frame.tints.get(at).copied();
                        out.push((at as u32, self.coloured(sample, tint.unwrap_or([255; 3]))));
                    }
                }
                Ok(())
            })?;
            for (at, sample) in found {
                match sample {
                    Some(sample) => frame.samples[at as usize] = sample,
                    None => {
                        frame.samples[at as usize].material = Sample::PLAIN;
                        cut.push(at);
                    }
                }
            }
        }
        Ok(())
    }

    /// A sample with the colour of its place, seen through the colour of vertices; `None` where there is a hole.
    fn coloured(&self, sample: &Sample, [r, g, b]: [u8; 3]) -> Option<Sample> {
        let paint = &self.skins.palette.paints[sample.material as usize];
        let [u, v, width] = sample.color;
        let within = Sample::WITHIN.map(|flag| sample.flags & flag != 0);
        let scale = first_map(paint).map_or(1.0, |map| map.texels_per_coordinate);
        let look_in = |map: Option<&MapUse>| -> Option<(&Decoded, Light)> {
            let map = map?;
            let place = self.numbers.binary_search(&map.image).ok()?;
            let image: &Decoded = self.decoded[place].as_ref()?;
            let width = f64::from(width) * map.texels_per_coordinate / scale;
            let is_bumps = paint.normal.as_ref() == Some(map);
            let images = &self.skins.images;
            let table = if is_bumps { &images.plain } else { &images.table };
            Some((image, image.between(map, ([u, v], within), width as f32, table)?))
        };
        let look = |map: Option<&MapUse>| look_in(map).map(|(_, light)| light);
        let normal = match look(paint.normal.as_ref()) {
            Some([x, y, z, opacity]) if opacity > 0.0 => {
                let slope = paint.normal.as_ref().map_or(1.0, |map| map.strength);
                let [x, y, z] = [x, y, z].map(|x| 2.0 * x / opacity - 1.0);
                bent(sample, [slope * x, slope * y, z])
            }
            _ => sample.normal,
        };
        if let Some(clay) = self.skins.clay {
            let color = clay.map(|x| sample.weight * x);
            return Some(Sample { color, normal, material: Sample::PLAIN, ..*sample });
        }
        let (tint, own_opacity) = (self.skins.images.table.of([r, g, b, 255]), paint.factor[3]);
        let (mut color, mut opacity) = ([0, 1, 2].map(|i| tint[i] * paint.factor[i]), 1.0);
        if let Some([r, g, b, a]) = look(paint.base.as_ref()) {
            let image = [r, g, b].map(|x| if a > 0.0 { x / a } else { 0.0 });
            color = [0, 1, 2].map(|i| color[i] * image[i]);
            opacity = a;
        }
        if let Some((image, light)) = look_in(paint.opacity.as_ref()) {
            opacity *= image.opacity_of(light);
        }
        let is_there = match paint.mask {
            Some(from) => opacity * own_opacity >= from,
            None => opacity >= HALF,
        };
        let is_unlit = if paint.unlit { Sample::UNLIT } else { 0 };
        is_there.then(|| Sample {
            color: color.map(|x| sample.weight * x),
            material: Sample::LIGHT,
            flags: sample.flags | is_unlit,
            normal,
            ..*sample
        })
    }
}
