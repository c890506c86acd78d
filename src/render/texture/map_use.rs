//! The way from texture coordinates to the texels of an image.

use stonecut_io::materials::Map;

/// An image with the way that coordinates lead to it.
#[derive(Clone, Debug, PartialEq)]
pub struct MapUse {
    /// Index of the image in the palette.
    pub image: usize,
    /// Width and height in pixels.
    pub size: [u32; 2],
    wrap: [Wrap; 2],
    scale: [f64; 2],
    offset: [f64; 2],
    /// Texels of the image for a length of 1 in its coordinates.
    pub texels_per_coordinate: f64,
    /// The channel that counts where only one does.
    pub channel: usize,
    /// Factor of slopes, share of shade.
    pub strength: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Wrap {
    Repeat,
    Mirror,
    Clamp,
}

impl Wrap {
    /// Tiling as glTF numbers it.
    fn of(number: u32) -> Wrap {
        match number {
            33071 => Wrap::Clamp,
            33648 => Wrap::Mirror,
            _ => Wrap::Repeat,
        }
    }

    /// The texel that stands for number `at` of a side of `n`.
    fn texel(self, at: i64, n: i64) -> usize {
        // Nearly all are, and a division takes longer than all else.
        if (0..n).contains(&at) {
            return at as usize;
        }
        let at = match self {
            Wrap::Repeat => at.rem_euclid(n),
            Wrap::Clamp => at.clamp(0, n - 1),
            Wrap::Mirror => {
                let at = at.rem_euclid(2 * n);
                at.min(2 * n - 1 - at)
            }
        };
        at as usize
    }
}

/// Coordinates that are larger come to nothing in single precision.
const FARTHEST: f64 = 1e7;

impl MapUse {
    pub(super) fn new(map: &Map, size: [u32; 2]) -> MapUse {
        let place = map.place();
        let wrap = map.wrap.map_or([Wrap::Repeat; 2], |wrap| wrap.map(Wrap::of));
        let wrap = if place.is_clamped { [Wrap::Clamp; 2] } else { wrap };
        let channel = match map.options.split_once("-imfchan ").map(|(_, behind)| behind.as_bytes())
        {
            Some([b'g', ..]) => 1,
            Some([b'b', ..]) => 2,
            _ => 0,
        };
        let scaled = MapUse::scaled(map.image, size, place.scale, place.offset);
        MapUse { wrap, channel, strength: map.strength, ..scaled }
    }

    /// An image that repeats.
    fn scaled(image: usize, size: [u32; 2], scale: [f64; 2], offset: [f64; 2]) -> MapUse {
        let [width, height] = size.map(f64::from);
        let texels_per_coordinate = (width * height * (scale[0] * scale[1]).abs()).sqrt();
        let wrap = [Wrap::Repeat; 2];
        MapUse {
            image,
            size,
            wrap,
            scale,
            offset,
            texels_per_coordinate,
            channel: 0,
            strength: 1.0,
        }
    }

    /// An image that does not repeat, with coordinates from 0 to 1 that lead to all of it.
    pub(super) fn whole(size: [u32; 2]) -> MapUse {
        MapUse { wrap: [Wrap::Clamp; 2], ..MapUse::scaled(0, size, [1.0; 2], [0.0; 2]) }
    }

    /// Place in an image of `size` at coordinates, v upwards: the four texels around it, and shares of the right and
    /// lower ones. `None` where coordinates are not numbers.
    pub fn texels(&self, uv: [f32; 2], size: [u32; 2]) -> Option<([[usize; 2]; 2], [f32; 2])> {
        let uv = [0, 1].map(|k| f64::from(uv[k]) * self.scale[k] + self.offset[k]);
        if !uv.iter().all(|x| x.abs() < FARTHEST) {
            return None;
        }
        let at = [uv[0], 1.0 - uv[1]];
        let at = [0, 1].map(|k| at[k] * f64::from(size[k]) - 0.5);
        // The floor, which is a call where processors of all ages are built for.
        let low = at.map(|x| x as i64 - i64::from((x as i64) as f64 > x));
        let texel =
            |k: usize, step: i64| self.wrap[k].texel(low[k] + step, i64::from(size[k].max(1)));
        let share = [0, 1].map(|k| (at[k] - low[k] as f64) as f32);
        Some(([[texel(0, 0), texel(0, 1)], [texel(1, 0), texel(1, 1)]], share))
    }

    /// True if coordinates are numbers that a texel can be found for.
    pub fn leads_to_texels(&self, uv: [f32; 2]) -> bool {
        self.texels(uv, self.size).is_some()
    }

    /// Texels of the image for a length of 1 along each of its coordinates.
    pub fn texels_along(&self) -> [f32; 2] {
        [0, 1].map(|k| (f64::from(self.size[k]) * self.scale[k].abs()) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stonecut_io::materials::MapKind;

    fn map(options: &str, wrap: Option<[u32; 2]>) -> MapUse {
        let map = Map { wrap, ..Map::new(MapKind::Base, 0, options.to_owned()) };
        MapUse::new(&map, [4, 2])
    }

    /// Texels of the upper left corner for coordinates at the middle of a texel.
    fn at(map: &MapUse, uv: [f32; 2]) -> Option<[usize; 2]> {
        map.texels(uv, [4, 2]).map(|(texels, _)| [texels[0][0], texels[1][0]])
    }

    #[test]
    fn coordinates_lead_to_texels_whatever_they_are() {
        let plain = map("", None);
        assert_eq!(at(&plain, [0.125, 0.75]), Some([0, 0]));
        assert_eq!(at(&plain, [0.875, 0.25]), Some([3, 1]));
        assert_eq!(at(&plain, [7.125, -1.25]), Some([0, 0]));
        assert_eq!(at(&plain, [f32::NAN, 0.0]), None);
        assert_eq!(at(&plain, [f32::INFINITY, 0.0]), None);
        assert_eq!(at(&plain, [3e38, 0.0]), None);
        let clamped = map("-clamp on", None);
        assert_eq!(at(&clamped, [7.125, -1.25]), Some([3, 1]));
        let mirrored = map("", Some([33648, 10497]));
        assert_eq!(at(&mirrored, [1.125, 0.75]), Some([3, 0]));
        let scaled = map("-s 2 1 1 -o 0.25 0", None);
        assert_eq!(at(&scaled, [0.0625, 0.75]), Some([1, 0]));
        assert_eq!(scaled.texels_per_coordinate, 4.0);
    }
}
