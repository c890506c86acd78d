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

/// Coordinates of corners that are so near to a border of an image are on it: single precision, and a scale.
const ON_BORDER: f64 = 1e-6;

/// Box of texture coordinates: those of a triangle, whose places see nothing across a border that it does not cross.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UvBox {
    low: [f32; 2],
    high: [f32; 2],
}

/// Number of the repetition that coordinates between two ends lie within, borders included; the first one before others.
fn repetition_of((low, high): (f64, f64)) -> Option<i64> {
    let is_within = |n: &f64| low >= n - ON_BORDER && high <= n + 1.0 + ON_BORDER;
    [0.0, (0.5 * (low + high)).floor()].into_iter().find(is_within).map(|n| n as i64)
}

impl UvBox {
    /// Coordinates of a triangle with these corners.
    pub fn of(uv: [[f32; 2]; 3]) -> UvBox {
        let [a, b, c] = uv;
        let least = |k: usize| a[k].min(b[k]).min(c[k]);
        let most = |k: usize| a[k].max(b[k]).max(c[k]);
        UvBox { low: [least(0), least(1)], high: [most(0), most(1)] }
    }

    /// True along each coordinate if the box lies within one repetition of an image that is neither scaled nor moved.
    pub fn within_one(&self) -> [bool; 2] {
        let is_one =
            |k: usize| repetition_of((f64::from(self.low[k]), f64::from(self.high[k]))).is_some();
        [is_one(0), is_one(1)]
    }

    /// Coordinates of a corner, moved inwards so far that they do not lie on a border.
    pub fn inside(&self, uv: [f32; 2]) -> [f32; 2] {
        [0, 1].map(|k| {
            let (low, high) = (self.low[k], self.high[k]);
            let margin = 2.0 * ON_BORDER as f32 * low.abs().max(high.abs()).max(1.0);
            match high - low > 2.0 * margin {
                true => uv[k].clamp(low + margin, high - margin),
                false => uv[k],
            }
        })
    }
}

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

    /// Coordinate in the repetitions of the image, from its upper left corner.
    #[inline]
    fn place(&self, uv: [f32; 2], k: usize) -> f64 {
        let at = f64::from(uv[k]) * self.scale[k] + self.offset[k];
        if k == 0 { at } else { 1.0 - at }
    }

    /// Number of the repetition of the image that coordinates lie within, borders included: the image itself, if that is
    /// one of two; `None` if they cross a border.
    fn repetition(&self, uv_box: &UvBox, k: usize) -> Option<i64> {
        let [a, b] = [uv_box.low, uv_box.high].map(|end| self.place(end, k));
        repetition_of((a.min(b), a.max(b)))
    }

    /// True along each coordinate if nothing across a border of the image is seen between these corners.
    pub fn within(&self, uv_box: &UvBox) -> [bool; 2] {
        [0, 1].map(|k| self.wrap[k] != Wrap::Repeat || self.repetition(uv_box, k).is_some())
    }

    /// Place in an image of `size` at coordinates, v upwards: the four texels around it, and shares of the right and lower
    /// ones. `None` where coordinates are not numbers. Along those whose triangle lies `within` one repetition nothing is seen across a border.
    pub fn texels(
        &self,
        (uv, within): ([f32; 2], [bool; 2]),
        size: [u32; 2],
    ) -> Option<([[usize; 2]; 2], [f32; 2])> {
        let (u, v) = (self.place(uv, 0), self.place(uv, 1));
        if !(u.abs() < FARTHEST && v.abs() < FARTHEST) {
            return None;
        }
        let (x, y) = (u * f64::from(size[0]) - 0.5, v * f64::from(size[1]) - 0.5);
        // The floor, which is a call where processors of all ages are built for.
        let floor = |x: f64| x as i64 - i64::from((x as i64) as f64 > x);
        let (left, top) = (floor(x), floor(y));
        let columns = self.pair((0, size[0]), left, (u, within[0]));
        let rows = self.pair((1, size[1]), top, (v, within[1]));
        Some(([columns, rows], [(x - left as f64) as f32, (y - top as f64) as f32]))
    }

    /// The texels `low` and the next along a side of `n`.
    #[inline]
    fn pair(&self, (k, n): (usize, u32), low: i64, place: (f64, bool)) -> [usize; 2] {
        // Nearly all are.
        if low >= 0 && low + 1 < i64::from(n) {
            return [low as usize, low as usize + 1];
        }
        self.pair_at_border((k, i64::from(n.max(1))), low, place)
    }

    #[cold]
    fn pair_at_border(
        &self,
        (k, n): (usize, i64),
        low: i64,
        (place, is_within): (f64, bool),
    ) -> [usize; 2] {
        let pair = [low, low + 1].map(|at| self.wrap[k].texel(at, n));
        let is_across = self.wrap[k] == Wrap::Repeat && pair[0] as i64 == n - 1;
        match if is_across && is_within { repetition_of((place, place)) } else { None } {
            Some(own) if own <= low.div_euclid(n) => [pair[0]; 2],
            Some(_) => [pair[1]; 2],
            None => pair,
        }
    }

    /// True if coordinates are numbers that a texel can be found for.
    pub fn leads_to_texels(&self, uv: [f32; 2]) -> bool {
        self.texels((uv, [false; 2]), self.size).is_some()
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
        map.texels((uv, [false; 2]), [4, 2]).map(|(texels, _)| [texels[0][0], texels[1][0]])
    }

    /// An image of 4 x 2 texels along u:
    ///
    /// ```text
    ///   2   3 | 0   1   2   3 | 0   1   2   3 | 0
    ///        0.0             1.0             2.0
    /// ```
    #[test]
    fn triangles_see_nothing_across_a_border_that_they_do_not_cross() {
        let (plain, clamped) = (map("", None), map("-clamp on", None));
        let columns = |map: &MapUse, u: f32, ends: [f32; 2], size: [u32; 2]| {
            let uv_box = UvBox::of([[ends[0], 0.1], [ends[1], 0.1], [ends[0], 0.2]]);
            let at = (uv_box.inside([u, 0.1]), map.within(&uv_box));
            map.texels(at, size).unwrap().0[0]
        };
        for (u, ends, seen) in [
            (0.0, [0.0, 1.0], [0, 0]),
            (1.0, [0.0, 1.0], [3, 3]),
            (1.0, [0.5, 1.000_000_1], [3, 3]),
            (1.0, [1.0, 2.0], [0, 0]),
            (0.95, [1.0, 2.0], [0, 0]),
            (2.0, [1.0, 2.0], [3, 3]),
            (-1.0, [-1.0, -0.5], [0, 0]),
            (0.0, [-1.0, 0.0], [3, 3]),
            // All at one border of the image.
            (0.0, [0.0, 0.0], [0, 0]),
            (1.0, [1.0, 1.0], [3, 3]),
            // Those that cross one.
            (1.0, [0.5, 1.5], [3, 0]),
            (0.0, [-0.1, 1.0], [3, 0]),
            (1.0, [0.0, 2.0], [3, 0]),
            (0.5, [0.0, 1.0], [1, 2]),
            (1.5, [1.0, 2.0], [1, 2]),
        ] {
            assert_eq!(columns(&plain, u, ends, [4, 2]), seen, "{u} of {ends:?}");
            let halved = columns(&plain, u, ends, [2, 1]);
            assert_eq!(halved, seen.map(|column| column / 2), "{u} of {ends:?}");
            assert_eq!(
                columns(&clamped, u, [0.0, 1.0], [4, 2]),
                columns(&clamped, u, ends, [4, 2])
            );
        }
        // The other coordinate, whose rows count downwards, and a scale.
        let uv_box = UvBox::of([[0.0, 0.0], [3.5, 0.0], [0.0, 1.0]]);
        let rows = |v: f32| plain.texels(([0.5, v], plain.within(&uv_box)), [4, 2]).unwrap().0[1];
        assert_eq!((rows(0.0), rows(1.0)), ([1, 1], [0, 0]));
        assert_eq!(plain.within(&uv_box), [false, true]);
        let doubled = map("-s 2 1 1", None);
        assert_eq!(columns(&doubled, 0.5, [0.0, 0.5], [4, 2]), [3, 3]);
        assert_eq!(columns(&doubled, 0.5, [0.0, 1.0], [4, 2]), [3, 0]);
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
