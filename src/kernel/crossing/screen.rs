//! The new triangles around a vertex, with planes that part others from them: eight triangles at a time, a few bits a corner.
//!
//! They have to lie one beside the other, seen along the mean of their normals. Each then has four planes: its own, and walls along
//! that direction over its three edges. A triangle whose corners are all beyond one of these, but for corners that both
//! have, meets it nowhere else. Everything is relative to the new place, in f32; signs that rounding could turn say nothing.
//!
//! Lanes are used in loops and plain calls only: closures that others call are not compiled for them.

use crate::simd::Lanes;
use crate::simd::unchecked::prefetch;
use crate::surface::Surface;
use crate::vertex::Vertex;
use std::hint::select_unpredictable;
use stonecut_mesh::vec3::Vec3;

/// Most triangles around the vertex.
pub(super) const MOST: usize = 24;
/// Eights of them.
const EIGHTS: usize = MOST / 8;
/// Bounds the rounding of a height over a plane, as a share of the product of the lengths that it is made of: more than twice
/// what the sums can lose.
const ROUNDING: f32 = 16.0 * f32::EPSILON;
/// Lengths are taken for at least that, so that a bound does not vanish where products underflow.
const LEAST: f32 = 1e-10;
const LEAST_PRODUCT: f32 = 1e-25;
/// Triangles that are held against the new ones at once.
pub(super) const AT_ONCE: usize = 64;
/// Room for their corners, by the last bits of their numbers; a power of two.
const REMEMBERED: usize = 128;

/// Triangles around a vertex by their other corners; what is left of the last eight repeats the first one.
pub(super) struct Around {
    pub(super) b: [[u32; 8]; EIGHTS],
    pub(super) c: [[u32; 8]; EIGHTS],
    pub(super) n: usize,
}

impl Around {
    /// `None` for none and for more than `MOST`.
    #[inline(always)]
    pub(super) fn new((b, c): (&[u32], &[u32])) -> Option<Around> {
        let n = b.len();
        if n == 0 || n > MOST || c.len() != n {
            return None;
        }
        let mut around = Around { b: [[b[0]; 8]; EIGHTS], c: [[c[0]; 8]; EIGHTS], n };
        around.b.as_flattened_mut()[..n].copy_from_slice(b);
        around.c.as_flattened_mut()[..n].copy_from_slice(c);
        Some(around)
    }

    /// The corners of each eight.
    #[inline(always)]
    pub(super) fn eights(&self) -> impl Iterator<Item = (&[u32; 8], &[u32; 8])> {
        self.b.iter().zip(&self.c).take(self.n.div_ceil(8))
    }

    /// A bit for each.
    #[inline(always)]
    fn bits(&self) -> u32 {
        u32::MAX >> (32 - self.n)
    }
}

/// The vertices of eight ids.
#[inline(always)]
pub(super) fn eight<'a>(surface: &'a Surface, i: &[u32; 8]) -> [&'a Vertex; 8] {
    let all = &surface.vertices[..];
    let [a, b, c, d] = [i[0] as usize, i[1] as usize, i[2] as usize, i[3] as usize];
    let [e, f, g, h] = [i[4] as usize, i[5] as usize, i[6] as usize, i[7] as usize];
    [&all[a], &all[b], &all[c], &all[d], &all[e], &all[f], &all[g], &all[h]]
}

/// Of an eight of new triangles, a bit for each that a corner is below, one that it is above, and one for each wall that it is behind.
type Beyond = [u64; EIGHTS];

/// Triangles that are held against the new ones at once, and their corners, each once.
#[derive(Clone)]
pub(super) struct Seen {
    ids: [u32; REMEMBERED],
    places: [u8; REMEMBERED],
    corners: [u32; 3 * AT_ONCE + 8],
    of_triangles: [[u8; 3]; AT_ONCE],
    beyond: [Beyond; 3 * AT_ONCE + 8],
}

impl Default for Seen {
    fn default() -> Self {
        Seen {
            ids: [u32::MAX; REMEMBERED],
            places: [0; REMEMBERED],
            corners: [0; 3 * AT_ONCE + 8],
            of_triangles: [[0; 3]; AT_ONCE],
            beyond: [[0; EIGHTS]; 3 * AT_ONCE + 8],
        }
    }
}

/// Planes of eight triangles.
#[derive(Clone, Copy)]
struct Eight<L> {
    b: [u32; 8],
    c: [u32; 8],
    face: [L; 3],
    wall_b: [L; 3],
    wall_c: [L; 3],
    rim: [L; 3],
    /// Height of the rim over its direction.
    rim_at: L,
    face_slack: L,
    wall_slack: L,
}

/// The new triangles.
pub(super) struct Screen<'a, L> {
    eights: [Eight<L>; EIGHTS],
    around: &'a Around,
    place: &'a Vec3,
    /// The farthest corner, in the sum of coordinates.
    far: f32,
}

#[inline(always)]
fn cross<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [
        a[1].times(b[2]).minus(a[2].times(b[1])),
        a[2].times(b[0]).minus(a[0].times(b[2])),
        a[0].times(b[1]).minus(a[1].times(b[0])),
    ]
}

#[inline(always)]
fn dot<L: Lanes>(a: [L; 3], b: [L; 3]) -> L {
    a[0].times(b[0]).plus(a[1].times(b[1])).plus(a[2].times(b[2]))
}

#[inline(always)]
fn negative<L: Lanes>(a: L) -> L {
    L::splat(0.0).minus(a)
}

#[inline(always)]
fn magnitude<L: Lanes>(a: L) -> L {
    a.greater(negative(a))
}

/// The sums of the sizes of coordinates.
#[inline(always)]
fn size<L: Lanes>(a: [L; 3]) -> L {
    magnitude(a[0]).plus(magnitude(a[1])).plus(magnitude(a[2]))
}

#[inline(always)]
pub(super) fn splat<L: Lanes>(a: [f32; 3]) -> [L; 3] {
    [L::splat(a[0]), L::splat(a[1]), L::splat(a[2])]
}

impl<'a, L: Lanes> Screen<'a, L> {
    /// `None` where the triangles do not lie for certain one beside the other.
    #[inline(always)]
    pub(super) fn new(
        surface: &Surface,
        around: &'a Around,
        place: &'a Vec3,
    ) -> Option<Screen<'a, L>> {
        let none = L::splat(0.0);
        let empty = Eight {
            b: [0; 8],
            c: [0; 8],
            face: [none; 3],
            wall_b: [none; 3],
            wall_c: [none; 3],
            rim: [none; 3],
            rim_at: none,
            face_slack: none,
            wall_slack: none,
        };
        let mut screen = Screen { eights: [empty; EIGHTS], around, place, far: 0.0 };
        let mut mean = [0.0; 3];
        let mut ray = [0.0; 3];
        let mut left = around.n;
        // First the faces; the walls take the place of the corners.
        for (i, (own, (b_ids, c_ids))) in screen.eights.iter_mut().zip(around.eights()).enumerate()
        {
            let b = L::relative(eight(surface, b_ids), [place; 8], surface.scale);
            let c = L::relative(eight(surface, c_ids), [place; 8], surface.scale);
            let face = cross(b, c);
            let sizes = size(b).plus(size(c));
            let slack =
                size(b).times(size(c)).times(L::splat(ROUNDING)).plus(L::splat(LEAST_PRODUCT));
            let length = dot(face, face).root();
            let lanes = 0xFF >> (8 - left.min(8));
            if slack.below(length) & lanes != lanes {
                return None;
            }
            let in_use = L::load(&std::array::from_fn(|k| f32::from(u8::from(k < left))));
            let share = in_use.over(length);
            for k in 0..3 {
                mean[k] += face[k].times(share).sum();
                if i == 0 {
                    ray[k] = 0.5 * (b[k].store()[0] + c[k].store()[0]);
                }
            }
            screen.far = screen.far.max(-negative(sizes).least());
            *own = Eight {
                b: *b_ids,
                c: *c_ids,
                face,
                wall_b: b,
                wall_c: c,
                face_slack: slack,
                wall_slack: sizes,
                ..empty
            };
            left = left.saturating_sub(8);
        }
        let along: [L; 3] = splat(mean);
        let (along_size, ray): (L, [L; 3]) = (size(along), splat(ray));
        let rounding = L::splat(ROUNDING).times(along_size);
        let mut n_over_ray = 0;
        let mut left = around.n;
        for own in screen.eights.iter_mut().take(around.n.div_ceil(8)) {
            let (b, c) = (own.wall_b, own.wall_c);
            let lanes = 0xFF >> (8 - left.min(8));
            let slack = own.face_slack.times(along_size);
            if slack.below(dot(own.face, along)) & lanes != lanes {
                return None;
            }
            // A direction within the first triangle; seen along the mean it may lie in no other one.
            let (before, after) = (dot(cross(b, ray), along), dot(cross(ray, c), along));
            let slack =
                own.wall_slack.times(size(ray)).times(rounding).plus(L::splat(LEAST_PRODUCT));
            let minus = none.minus(slack);
            let (over_b, over_c) = (slack.below(before), slack.below(after));
            let (off_b, off_c) = (before.below(minus), after.below(minus));
            if (over_b | off_b) & (over_c | off_c) & lanes != lanes {
                return None;
            }
            n_over_ray += (over_b & over_c & lanes).count_ones();
            let edge = [c[0].minus(b[0]), c[1].minus(b[1]), c[2].minus(b[2])];
            own.wall_b = cross(along, b);
            own.wall_c = cross(c, along);
            own.rim = cross(edge, along);
            own.rim_at = dot(own.rim, b);
            own.wall_slack = own.wall_slack.times(rounding).plus(L::splat(LEAST_PRODUCT));
            left = left.saturating_sub(8);
        }
        (n_over_ray == 1).then_some(screen)
    }

    /// Takes up triangles, at most `AT_ONCE`: finds for each of their corners what it is beyond.
    #[inline(always)]
    pub(super) fn look(&self, surface: &Surface, triangles: &[[u32; 3]], seen: &mut Seen) {
        let mut n = 0;
        seen.ids.fill(u32::MAX);
        for (places, triangle) in seen.of_triangles.iter_mut().zip(triangles) {
            for (place, &v) in places.iter_mut().zip(triangle) {
                let slot = v as usize & (REMEMBERED - 1);
                let is_new = seen.ids[slot] != v;
                *place = select_unpredictable(is_new, n as u8, seen.places[slot]);
                (seen.ids[slot], seen.places[slot]) = (v, *place);
                seen.corners[n] = v;
                prefetch(&surface.vertices, v);
                n += usize::from(is_new);
            }
        }
        if n == 0 {
            return;
        }
        let last = seen.corners[0];
        seen.corners[n..n + 8].fill(last);
        let eights = seen.corners.as_chunks::<8>().0.iter().zip(seen.beyond.as_chunks_mut::<8>().0);
        for (corners, beyond) in eights.take(n.div_ceil(8)) {
            let off = L::relative(eight(surface, corners), [self.place; 8], surface.scale);
            let [x, y, z] = [off[0].store(), off[1].store(), off[2].store()];
            let reach = size(off).greater(L::splat(LEAST)).plus(L::splat(self.far)).store();
            for i in 0..8 {
                self.beyond(corners[i], ([x[i], y[i], z[i]], reach[i]), &mut beyond[i]);
            }
        }
    }

    /// Bits of the new triangles that a triangle is not parted from by one of their planes.
    #[inline(always)]
    pub(super) fn left(&self, triangle: usize, seen: &Seen) -> u32 {
        let [a, b, c] = seen.of_triangles[triangle].map(|place| &seen.beyond[place as usize]);
        let mut parted = 0;
        for i in 0..self.around.n.div_ceil(8) {
            let mut bits = a[i] & b[i] & c[i];
            bits |= bits >> 32;
            bits |= bits >> 16;
            bits |= bits >> 8;
            parted |= (bits as u32 & 0xFF) << (8 * i);
        }
        self.around.bits() & !parted
    }

    #[inline(always)]
    fn beyond(&self, v: u32, (off, reach): ([f32; 3], f32), beyond: &mut Beyond) {
        let (off, reach): ([L; 3], L) = (splat(off), L::splat(reach));
        let eights = self.eights.iter().zip(beyond);
        for (own, beyond) in eights.take(self.around.n.div_ceil(8)) {
            let (face, wall) = (own.face_slack.times(reach), own.wall_slack.times(reach));
            let height = dot(own.face, off);
            let rim = dot(own.rim, off).minus(own.rim_at);
            let (is_b, is_c) = (L::matches(&own.b, v), L::matches(&own.c, v));
            let bits = [
                height.below(negative(face)) | is_b | is_c,
                face.below(height) | is_b | is_c,
                dot(own.wall_b, off).below(negative(wall)) | is_b,
                dot(own.wall_c, off).below(negative(wall)) | is_c,
                wall.below(rim) | is_b | is_c,
            ];
            *beyond = u64::from(bits[0] | bits[1] << 8 | bits[2] << 16 | bits[3] << 24)
                | u64::from(bits[4]) << 32;
        }
    }
}
