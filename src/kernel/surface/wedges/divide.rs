//! Wedges at a cut of the surface: each side keeps what its triangles use, and the caps lie in one chart each.

use super::Wedges;
use crate::surface::Surface;

/// Triangles around the corners of a cut on one side, from corner to corner in their sense of rotation.
pub(crate) type Sectors = [Vec<u32>; 3];

/// The wedges of a cut that is about to be made.
pub(crate) struct Division {
    /// Wedges that both sides use, corner by corner, and what those of the right side become.
    copies: [Vec<(u32, u32)>; 3],
    /// Wedges of the corners of the left cap, in the order of the cycle.
    pub(crate) left_cap: [u32; 3],
    /// The same of the right cap, which lies between the new vertices.
    pub(crate) right_cap: [u32; 3],
    /// Sources of the new vertices.
    pub(crate) sources: [u32; 3],
}

/// A cap has at most one wedge that no triangle has used before.
const CAPS: usize = 2;

impl Wedges {
    /// Makes the wedges for a cut along `cycle`. `left` begins at each corner with the triangle over the edge to the next
    /// one, `right` ends with it. New wedges take their sources from the end of `spare`; `None`, and nothing done, if these are
    /// too few.
    pub(crate) fn divide(
        &mut self,
        surface: &Surface,
        cycle: [u32; 3],
        [left, right]: [&Sectors; 2],
        spare: &mut Vec<u32>,
    ) -> Option<Division> {
        let used = |i: usize, side: &Sectors| {
            let mut list: Vec<u32> = Vec::new();
            for &t in &side[i] {
                let wedge = self.at(surface, t, cycle[i]);
                if !list.contains(&wedge) {
                    list.push(wedge);
                }
            }
            list
        };
        let shared: [Vec<u32>; 3] = std::array::from_fn(|i| {
            let left = used(i, left);
            used(i, right).into_iter().filter(|wedge| left.contains(wedge)).collect()
        });
        if spare.len() < shared.iter().map(Vec::len).sum::<usize>() + CAPS {
            return None;
        }
        let over = |side: &Sectors, at: fn(&[u32]) -> Option<&u32>| {
            let mut ends = [[0; 2]; 3];
            for (i, end) in ends.iter_mut().enumerate() {
                let &t = at(&side[i])?;
                *end = [cycle[i], cycle[(i + 1) % 3]].map(|v| self.at(surface, t, v));
            }
            Some(ends)
        };
        let (over_left, over_right) = (over(left, <[u32]>::first)?, over(right, <[u32]>::last)?);
        let left_cap = self.cap(over_left, spare)?;
        let right_cap = self.cap(over_right, spare)?;
        let copies = shared.map(|list| {
            let copy = |wedge| Some((wedge, self.copy(wedge, spare.pop()?)));
            list.into_iter().filter_map(copy).collect::<Vec<_>>()
        });
        let source = |i: usize| {
            let wedge = right[i].first().map_or(0, |&t| self.at(surface, t, cycle[i]));
            self.source[new_of(&copies[i], wedge) as usize]
        };
        let sources = std::array::from_fn(source);
        let right_cap = std::array::from_fn(|i| new_of(&copies[i], right_cap[i]));
        Some(Division { copies, left_cap, right_cap, sources })
    }

    /// Takes over what was divided, after the surface has been cut: `right` have the vertices `new`, and the caps
    /// are its last two triangles.
    pub(crate) fn divided(
        &mut self,
        surface: &mut Surface,
        (cycle, new): ([u32; 3], [u32; 3]),
        right: &Sectors,
        division: &Division,
    ) {
        let [a, b, c] = division.left_cap;
        self.corner.extend([[b, a, c], division.right_cap]);
        self.is_seam.extend([true; 3]);
        for i in 0..3 {
            for &t in &right[i] {
                let corners = surface.triangles[t as usize];
                for (wedge, &v) in self.corner[t as usize].iter_mut().zip(&corners) {
                    if v == new[i] {
                        *wedge = new_of(&division.copies[i], *wedge);
                    }
                }
            }
        }
        for v in cycle.into_iter().chain(new) {
            self.is_seam[v as usize] = true;
            self.look_again(surface, v);
        }
    }

    /// Wedges for the corners of a cap; `ends` are those of the triangles over its edges. Where two of these lie in one chart,
    /// the cap does, too. Else it is the first one's, and its third corner lies between the other two in the image.
    fn cap(&mut self, ends: [[u32; 2]; 3], spare: &mut Vec<u32>) -> Option<[u32; 3]> {
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            if ends[i][1] == ends[j][0] {
                let mut cap = [0; 3];
                (cap[i], cap[j], cap[k]) = (ends[i][0], ends[i][1], ends[j][1]);
                return Some(cap);
            }
        }
        let [a, b] = ends[0];
        let third = self.copy(ends[1][1], spare.pop()?);
        self.chart[third as usize] = self.chart[a as usize];
        self.models.note(self.source[third as usize], self.source[a as usize]);
        for channel in 0..self.n_channels {
            let value = |wedge: u32| self.values_of(wedge)[channel];
            let between = match self.confined.get(channel) {
                _ if self.region == Some(channel) => value(a),
                Some(true) => 0.5 * (value(a) + value(b)),
                _ => continue,
            };
            self.values[third as usize * self.n_channels + channel] = between;
        }
        Some([a, b, third])
    }

    /// A new wedge with the values and the chart of another one.
    fn copy(&mut self, wedge: u32, source: u32) -> u32 {
        let values = wedge as usize * self.n_channels;
        self.values.extend_from_within(values..values + self.n_channels);
        self.models.note(source, self.source[wedge as usize]);
        self.source.push(source);
        self.chart.push(self.chart[wedge as usize]);
        (self.source.len() - 1) as u32
    }
}

/// The copy of a wedge, or itself if it has none.
fn new_of(copies: &[(u32, u32)], wedge: u32) -> u32 {
    copies.iter().find(|(old, _)| *old == wedge).map_or(wedge, |(_, new)| *new)
}

/// Corners that need a new wedge, since theirs would belong to several vertices.
pub(crate) struct Parting {
    /// Wedge, new vertex, and the corner (triangle, 0..3) that uses it, in this order; those that keep the wedge are not here.
    corners: Vec<(u32, u32, u32, u8)>,
    /// Wedges that have to be made.
    pub(crate) n_new: usize,
}

impl Wedges {
    /// Finds the wedges that `vertex`, the vertices for the corners of `triangles`, would take apart.
    pub(crate) fn part(&self, triangles: &[u32], vertex: &[u32]) -> Parting {
        let mut corners = Vec::with_capacity(vertex.len());
        for (&t, vertices) in triangles.iter().zip(vertex.as_chunks::<3>().0) {
            let list = self.corner[t as usize].iter().zip(vertices).zip(0..);
            corners.extend(list.map(|((&wedge, &v), k)| (wedge, v, t, k)));
        }
        corners.sort_unstable();
        let mut n_new = 0;
        let mut moved = Vec::new();
        for same in corners.chunk_by(|a, b| a.0 == b.0) {
            let others = &same[same.iter().take_while(|corner| corner.1 == same[0].1).count()..];
            n_new += others.chunk_by(|a, b| a.1 == b.1).count();
            moved.extend_from_slice(others);
        }
        Parting { corners: moved, n_new }
    }

    /// Makes these wedges, with sources from the end of `spare`, of which there are enough.
    pub(crate) fn parted(&mut self, parting: &Parting, spare: &mut Vec<u32>) {
        for same in parting.corners.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let Some(source) = spare.pop() else { return };
            let new = self.copy(same[0].0, source);
            for &(_, _, t, k) in same {
                self.corner[t as usize][usize::from(k)] = new;
            }
        }
    }

    /// Finds out which of these vertices are on seams, after triangles have changed hands between vertices.
    pub(crate) fn look_at(&mut self, surface: &mut Surface, vertices: &[u32]) {
        self.is_seam.resize(surface.vertices.len(), false);
        for &v in vertices {
            self.is_seam[v as usize] = surface.rings[v as usize].len > 0;
            self.look_again(surface, v);
        }
    }

    /// A source for a vertex that has these corners' wedges: that of the first.
    pub(crate) fn source_at(&self, t: u32, k: usize) -> u32 {
        self.source[self.corner[t as usize][k] as usize]
    }
}
