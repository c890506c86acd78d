//! Triangles into a buffer of samples: depth, normal, colour and edge lines; shading comes later.
//!
//! Large triangles are drawn as usual. Triangles of about one sample or less are averaged: every one of
//! them adds its normal and colour to the sample it falls on, as long as it lies on the front surface
//! there. A mesh of a billion triangles thus looks as smooth as the eye would see it, from one pass over
//! its faces and without vertex normals.

use super::camera::Camera;
use super::sample::Sample;
use super::turn::turn_of;
use super::vector::smoothstep;
use std::ops::Range;
use stonecut_mesh::steps::count;

/// Sides of the bounding box, in samples, up to which a triangle is averaged into its samples.
const SMALL: f32 = 2.0;
/// Ends of edges this near to a row, in samples, count as in it.
const LEVEL: f64 = 0.01;
/// Columns beside a triangle in which rounding may see it.
const BESIDE: f64 = 3.0;
/// Corners farther away may be seen by rounding anywhere in a row.
const FAR: f64 = 1e5;
/// Texels from sample to sample at most; more than any image has.
const WIDEST: f32 = 1e6;
/// Depths that differ by at most this many samples' width count as the same surface for averaging.
const SAME_SURFACE: f32 = 3.0;

/// A corner of a triangle in camera space.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Corner {
    /// Position relative to the camera's target.
    pub(super) place: [f32; 3],
    /// Unit normal on the front side.
    pub(super) normal: [f32; 3],
    /// sRGB values in [0, 1].
    pub(super) color: [f32; 3],
    /// Texture coordinates.
    pub(super) uv: [f32; 2],
    /// Direction of rising u, and the side of v: 1 or -1; zeros where no normal map is drawn.
    pub(super) tangent: [f32; 4],
}

/// Image that a triangle shows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shown {
    /// Number of the material.
    pub(super) material: u32,
    /// Texels for a length of 1 in each coordinate.
    pub(super) texels: [f32; 2],
    /// `Sample::WITHIN`.
    pub(super) within: u8,
}

/// Style in which triangles are drawn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Style {
    /// Half the width of edge lines in samples; 0: no lines.
    pub(super) line: f32,
    /// Samples along one side of a pixel.
    pub(super) samples: f32,
    /// The image in place of the corners' colours.
    pub(super) shown: Option<Shown>,
}

/// The samples of a picture, row by row.
pub(super) struct Frame {
    /// Samples in a row.
    pub(super) width: usize,
    /// Rows of samples.
    pub(super) height: usize,
    /// All samples.
    pub(super) samples: Vec<Sample>,
    /// For each sample the colour of vertices that its image is seen through, sRGB; empty where images hide these.
    pub(super) tints: Vec<[u8; 3]>,
    /// For each sample the nearness that only what is farther away is drawn at; empty: all is drawn.
    limits: Vec<f32>,
    focal: f32,
    centre: [f32; 2],
    distance: f32,
    near: f32,
}

/// A corner in the picture.
struct ProjectedCorner {
    x: f32,
    y: f32,
    nearness: f32,
}

impl Frame {
    /// An empty frame for a camera.
    pub(super) fn new(width: usize, height: usize, camera: &Camera) -> Self {
        Frame {
            width,
            height,
            samples: vec![Sample::NONE; width * height],
            tints: Vec::new(),
            limits: Vec::new(),
            focal: camera.focal as f32,
            centre: camera.centre.map(|x| x as f32),
            distance: camera.distance as f32,
            near: camera.near as f32,
        }
    }

    /// Opens these samples for what lies behind them, and closes all others.
    ///
    /// Surfaces less than three samples' width behind are taken as the same and are not seen.
    pub(super) fn open_behind(&mut self, cut: &[u32]) {
        self.limits.clear();
        self.limits.resize(self.samples.len(), 0.0);
        for &at in cut {
            let sample = &mut self.samples[at as usize];
            self.limits[at as usize] = sample.nearness * (1.0 - SAME_SURFACE / self.focal);
            *sample = Sample::NONE;
        }
    }

    /// Lets all be drawn again.
    pub(super) fn open_all(&mut self) {
        self.limits = Vec::new();
    }

    fn is_open(&self, at: usize, nearness: f32) -> bool {
        self.limits.get(at).is_none_or(|limit| nearness < *limit)
    }

    fn tint(&mut self, at: usize, color: [f32; 3]) {
        if let Some(tint) = self.tints.get_mut(at) {
            *tint = color.map(|x| (255.0 * x + 0.5) as u8);
        }
    }

    fn project(&self, place: [f32; 3]) -> Option<ProjectedCorner> {
        let depth = self.distance - place[2];
        let nearness = 1.0 / depth;
        (depth > self.near).then(|| ProjectedCorner {
            x: self.centre[0] + self.focal * place[0] * nearness,
            y: self.centre[1] - self.focal * place[1] * nearness,
            nearness,
        })
    }

    /// Returns whether any part of a triangle may lie within the picture; cheap, for faces of huge meshes.
    pub(super) fn may_show(&self, corners: &[Corner; 3]) -> bool {
        let mut low = [f32::INFINITY; 2];
        let mut high = [f32::NEG_INFINITY; 2];
        for corner in corners {
            let Some(p) = self.project(corner.place) else { return false };
            low = [low[0].min(p.x), low[1].min(p.y)];
            high = [high[0].max(p.x), high[1].max(p.y)];
        }
        high[0] > 0.0 && high[1] > 0.0 && low[0] < self.width as f32 && low[1] < self.height as f32
    }

    /// Draws one triangle; one that reaches behind the near plane is left out.
    pub(super) fn triangle(&mut self, corners: &[Corner; 3], style: Style) {
        let (Some(a), Some(b), Some(c)) = (
            self.project(corners[0].place),
            self.project(corners[1].place),
            self.project(corners[2].place),
        ) else {
            return;
        };
        // Positive where the corners run counter-clockwise for the viewer; rows count downwards.
        let area = (c.x - a.x) * (b.y - a.y) - (b.x - a.x) * (c.y - a.y);
        let has_area = area.abs() > 0.0;
        let low = [a.x.min(b.x).min(c.x), a.y.min(b.y).min(c.y)];
        let high = [a.x.max(b.x).max(c.x), a.y.max(b.y).max(c.y)];
        let within = high[0] > 0.0
            && high[1] > 0.0
            && low[0] < self.width as f32
            && low[1] < self.height as f32;
        if !(has_area && within) {
            return;
        }
        if high[0] - low[0] < SMALL && high[1] - low[1] < SMALL {
            self.small(corners, &[a, b, c], area, style.shown);
        } else {
            self.large(corners, &[a, b, c], area, (low, high), style);
        }
    }

    /// Averages a small triangle into the sample under its centroid and those whose centres it covers.
    fn small(
        &mut self,
        corners: &[Corner; 3],
        p: &[ProjectedCorner; 3],
        area: f32,
        shown: Option<Shown>,
    ) {
        let third = 1.0 / 3.0;
        let x = (p[0].x + p[1].x + p[2].x) * third;
        let y = (p[0].y + p[1].y + p[2].y) * third;
        let nearness = (p[0].nearness + p[1].nearness + p[2].nearness) * third;
        let weight = 0.5 * area.abs();
        let mean = |field: fn(&Corner) -> [f32; 3]| {
            let [a, b, c] = [0, 1, 2].map(|i| field(&corners[i]));
            std::array::from_fn(|i| (a[i] + b[i] + c[i]) * third)
        };
        let side = area.signum();
        let normal: [f32; 3] = mean(|c| c.normal);
        let color: [f32; 3] = mean(|c| c.color);
        let found = Sample {
            nearness,
            normal: normal.map(|x| side * weight * x),
            color: match shown {
                Some(shown) => mean_place(corners, shown.texels, area),
                None => color.map(|x| weight * x),
            },
            weight,
            material: shown.map_or(Sample::PLAIN, |shown| shown.material),
            ink: 0,
            flags: flags_of(corners, shown, area),
            turn: match corners[0].tangent[3] != 0.0 {
                true => turn_of(normal.map(|x| side * x), mean(|c| first_three(c.tangent))),
                false => 0,
            },
        };
        let tolerance = SAME_SURFACE / self.focal;
        // A triangle wide enough to cover sample centres must reach them all, or holes would show.
        let (i, j) = (x as usize, y as usize);
        for dy in 0..3usize {
            for dx in 0..3usize {
                let (Some(col), Some(row)) = ((i + dx).checked_sub(1), (j + dy).checked_sub(1))
                else {
                    continue;
                };
                let own = dx == 1 && dy == 1;
                let covered = || inside(p, area, col as f32 + 0.5, row as f32 + 0.5);
                let at = row * self.width + col;
                if col < self.width
                    && row < self.height
                    && (own || covered())
                    && self.is_open(at, nearness)
                    && self.samples[at].average(&found, tolerance)
                {
                    self.tint(at, color);
                }
            }
        }
    }

    fn large(
        &mut self,
        corners: &[Corner; 3],
        p: &[ProjectedCorner; 3],
        area: f32,
        (low, high): ([f32; 2], [f32; 2]),
        style: Style,
    ) {
        // Doubles: a corner may lie far outside the picture.
        let q = [0, 1, 2].map(|i| (f64::from(p[i].x), f64::from(p[i].y)));
        let full = (q[2].0 - q[0].0) * (q[1].1 - q[0].1) - (q[1].0 - q[0].0) * (q[2].1 - q[0].1);
        let per_area = 1.0 / full;
        let heights = [0, 1, 2].map(|i| {
            let (a, b) = (q[(i + 1) % 3], q[(i + 2) % 3]);
            (full.abs() / ((a.0 - b.0).powi(2) + (a.1 - b.1).powi(2)).sqrt().max(1e-9)) as f32
        });
        // Lines fade out as triangles become too small to be told apart.
        let size = (0.5 * area.abs()).sqrt() / style.samples;
        let strength = if style.line > 0.0 { smoothstep(1.2, 6.0, size) } else { 0.0 };
        let side = area.signum();
        let first = |low: f32| (low - 0.5).ceil().max(0.0) as usize;
        let last = |high: f32, n: usize| ((high - 0.5).floor() + 1.0).clamp(0.0, n as f32) as usize;
        let reach = ((0.25 * full.abs().sqrt() / f64::from(style.samples)) as f32).clamp(0.4, 1.0);
        let line = style.line * reach;
        let (flags, has_frames) =
            (flags_of(corners, style.shown, area), corners[0].tangent[3] != 0.0);
        let slopes = style.shown.map(|shown| Slopes::new(corners, p, &q, per_area, shown.texels));
        let columns = first(low[0])..last(high[0], self.width);
        let is_tinted = !self.tints.is_empty();
        for row in first(low[1])..last(high[1], self.height) {
            let y = row as f64 + 0.5;
            let columns = across(&q, y, &columns);
            count(columns.len());
            for col in columns {
                let x = col as f64 + 0.5;
                let part = |i: usize| {
                    let (a, b) = (q[(i + 1) % 3], q[(i + 2) % 3]);
                    ((b.0 - x) * (a.1 - y) - (a.0 - x) * (b.1 - y)) * per_area
                };
                let (s, t) = (part(0), part(1));
                let r = 1.0 - s - t;
                if !(s >= 0.0 && t >= 0.0 && r >= -1e-12) {
                    continue;
                }
                let parts = [s as f32, t as f32, r as f32];
                let nearness = (0..3).map(|i| parts[i] * p[i].nearness).sum::<f32>();
                let at = row * self.width + col;
                let in_front = nearness > self.samples[at].nearness && self.is_open(at, nearness);
                if !in_front {
                    continue;
                }
                // Attributes are linear in space, not in the picture.
                let parts_in_space = [0, 1, 2].map(|i| parts[i] * p[i].nearness / nearness);
                let mix = |field: fn(&Corner) -> [f32; 3]| {
                    let [a, b, c] = [0, 1, 2].map(|i| field(&corners[i]));
                    let [s, t, r] = parts_in_space;
                    std::array::from_fn(|i| s * a[i] + t * b[i] + r * c[i])
                };
                let normal: [f32; 3] = mix(|c| c.normal);
                let to_edge = (0..3).map(|i| parts[i] * heights[i]).fold(f32::INFINITY, f32::min);
                let ink = strength * (line + 0.5 - to_edge).clamp(0.0, 1.0);
                self.samples[at] = Sample {
                    nearness,
                    normal: normal.map(|x| side * x),
                    color: match &slopes {
                        Some(slopes) => {
                            let [u, v, _] = mix(|c| [c.uv[0], c.uv[1], 0.0]);
                            [u, v, slopes.width([u, v], nearness)]
                        }
                        None => mix(|c| c.color),
                    },
                    weight: 1.0,
                    material: style.shown.map_or(Sample::PLAIN, |shown| shown.material),
                    ink: (255.0 * ink + 0.5) as u8,
                    flags,
                    turn: match has_frames {
                        true => turn_of(normal.map(|x| side * x), mix(|c| first_three(c.tangent))),
                        false => 0,
                    },
                };
                if is_tinted {
                    self.tint(at, mix(|c| c.color));
                }
            }
        }
    }
}

/// The columns of a row that a triangle may cover, and a few beside them: needles cover next to nothing of their boxes.
fn across(q: &[(f64, f64); 3], y: f64, columns: &Range<usize>) -> Range<usize> {
    if q.iter().any(|(x, y)| x.abs().max(y.abs()) > FAR) {
        return columns.clone();
    }
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for i in 0..3 {
        let (a, b) = (q[i], q[(i + 1) % 3]);
        let (below_a, below_b) = (y - a.1, y - b.1);
        // Edges that are level, or end nearly in the row, as far as they go.
        let [from, to] = if below_a.abs().min(below_b.abs()) <= LEVEL {
            [a.0, b.0]
        } else if below_a * below_b < 0.0 {
            [a.0 + below_a / (b.1 - a.1) * (b.0 - a.0); 2]
        } else {
            continue;
        };
        (low, high) = (low.min(from).min(to), high.max(from).max(to));
    }
    let start = (low - BESIDE).clamp(columns.start as f64, columns.end as f64) as usize;
    let end = (high + BESIDE).clamp(start as f64, columns.end as f64) as usize;
    start..end
}

/// Sides of a triangle that is drawn with this area.
fn flags_of(corners: &[Corner; 3], shown: Option<Shown>, area: f32) -> u8 {
    let back = if area < 0.0 { Sample::BACK } else { 0 };
    shown.map_or(0, |shown| shown.within)
        | back
        | if corners[0].tangent[3] < 0.0 { Sample::MIRRORED } else { 0 }
}

fn first_three([x, y, z, _]: [f32; 4]) -> [f32; 3] {
    [x, y, z]
}

/// The place in an image of a small triangle, and texels from sample to sample: the root of the ratio of areas.
fn mean_place(corners: &[Corner; 3], texels: [f32; 2], area: f32) -> [f32; 3] {
    let [a, b, c] = [0, 1, 2].map(|i| corners[i].uv);
    let cross = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let width = (cross * texels[0] * texels[1] / area).abs().sqrt();
    let third = 1.0 / 3.0;
    [third * (a[0] + b[0] + c[0]), third * (a[1] + b[1] + c[1]), width.min(WIDEST)]
}

/// Change of texture coordinates over a large triangle. Divided by distance, they are linear in the picture.
struct Slopes {
    /// Of nearness, along a row and down a column.
    nearness: [f32; 2],
    /// Of each texture coordinate times nearness.
    uv: [[f32; 2]; 2],
    texels: [f32; 2],
}

impl Slopes {
    fn new(
        corners: &[Corner; 3],
        p: &[ProjectedCorner; 3],
        q: &[(f64, f64); 3],
        per_area: f64,
        texels: [f32; 2],
    ) -> Slopes {
        let slope = |value: &dyn Fn(usize) -> f32| {
            let mut sum = [0.0; 2];
            for i in 0..3 {
                let (a, b) = (q[(i + 1) % 3], q[(i + 2) % 3]);
                let by_part = f64::from(value(i)) * per_area;
                sum[0] += by_part * (b.1 - a.1);
                sum[1] += by_part * (a.0 - b.0);
            }
            sum.map(|x| x as f32)
        };
        Slopes {
            nearness: slope(&|i| p[i].nearness),
            uv: [0, 1].map(|k| slope(&|i| p[i].nearness * corners[i].uv[k])),
            texels,
        }
    }

    /// Texels from sample to sample. At a slant it is more one way than the other; half of the larger one is taken, as
    /// four texels are mixed anyway.
    fn width(&self, uv: [f32; 2], nearness: f32) -> f32 {
        let step = |way: usize| {
            let change = |k: usize| {
                self.texels[k] * (self.uv[k][way] - uv[k] * self.nearness[way]) / nearness
            };
            change(0).hypot(change(1))
        };
        let (row, column) = (step(0), step(1));
        row.min(column).max(0.5 * row.max(column)).min(WIDEST)
    }
}

/// Returns whether a triangle covers a point of the picture.
fn inside(p: &[ProjectedCorner; 3], area: f32, x: f32, y: f32) -> bool {
    (0..3).all(|i| {
        let (a, b) = (&p[(i + 1) % 3], &p[(i + 2) % 3]);
        ((b.x - x) * (a.y - y) - (a.x - x) * (b.y - y)) * area.signum() >= 0.0
    })
}
