//! `volume`: an unfiltered isosurface of a noisy scan, as from an MRI or a CT.
//!
//! One folded main surface with thousands of handles, tens of thousands of specks around and within it, noise on
//! everything, open at the faces of the volume. Values are functions of a voxel's place (field.rs), polygonised by
//! marching cubes (cases.rs).
//!
//! A block is a band of rows of one slice, numbered as in gyroid.rs: every grid edge belongs to its lower end, a
//! crossed edge is a vertex, edges within the slice come before those towards the next one.

mod cases;
mod field;

use super::noise::noise3;
use super::sliced::{BlockCounts, Sliced};
use super::surface::Vertex;
use cases::Case;
use field::Field;

/// Rows of voxels in a band.
const BAND: usize = 32;
/// Triangles per cubed and per squared radius in voxel widths at `--noise 1`, measured at 3*10^5 and 5*10^6 triangles.
const TRIANGLES_PER_VOLUME: f64 = 0.974;
const TRIANGLES_PER_AREA: f64 = 30.2;
/// The least radius in voxel widths: smaller bodies have no folds.
const LEAST_RADIUS: f64 = 16.0;
/// Width of a voxel in millimetres, as MRI has it.
const VOXEL: f64 = 0.9375;
/// Without `--integer` vertices keep this distance from the ends of their grid edge, so that none coincide.
const MARGIN: f32 = 0.001;

/// A noisy volume's isosurface.
pub(super) struct Volume {
    field: Field,
    cases: Vec<Case>,
    margin: f32,
    seed: u64,
    colored: bool,
}

/// Settings of a volume besides its size.
#[derive(Clone, Copy)]
pub(super) struct Scanner {
    pub(super) seed: u64,
    /// Factor of the usual noise.
    pub(super) noise: f64,
    /// Whole voxel values.
    pub(super) integer: bool,
    pub(super) colored: bool,
}

/// Crossed edges of grid points: the number of a point's first one and a bit for each axis.
struct Numbers {
    first: Vec<u32>,
    mask: Vec<u8>,
    count: u64,
}

impl Volume {
    /// A volume of about `n_triangles` times `scale`^3 triangles.
    pub(super) fn new(n_triangles: u64, scale: f64, scanner: Scanner) -> Self {
        let Scanner { seed, noise, integer, colored } = scanner;
        let wanted = 1.006 * n_triangles as f64;
        let (mut low, mut high) = (0.0, 1e5);
        for _ in 0..60 {
            let r = 0.5 * (low + high);
            let triangles = r * r * (TRIANGLES_PER_VOLUME * r + TRIANGLES_PER_AREA);
            *(if triangles < wanted { &mut low } else { &mut high }) = r;
        }
        let radius = (scale * high).max(LEAST_RADIUS);
        Volume {
            field: Field::new(radius, seed, noise, integer),
            cases: cases::cases(),
            margin: if integer { 0.0 } else { MARGIN },
            seed,
            colored,
        }
    }

    fn n_bands(&self) -> u64 {
        self.field.voxels[1].div_ceil(BAND) as u64
    }

    /// The slice of a block and the rows it owns.
    fn extent(&self, block: u64) -> (usize, usize, usize) {
        let (slice, band) = ((block / self.n_bands()) as usize, (block % self.n_bands()) as usize);
        (slice, band * BAND, ((band + 1) * BAND).min(self.field.voxels[1]))
    }

    /// Numbers the crossed edges of the first `rows` rows of `low` along x and y, or along z into `high`.
    fn number(&self, low: &[f32], high: Option<&[f32]>, rows: usize) -> Numbers {
        let n = self.field.voxels[0];
        let rows = rows.min(low.len() / n);
        let mut numbers = Numbers {
            first: Vec::with_capacity(rows * n),
            mask: Vec::with_capacity(rows * n),
            count: 0,
        };
        let crosses =
            |at: usize, end: Option<&f32>| end.is_some_and(|v| (low[at] >= 0.0) != (*v >= 0.0));
        for at in 0..rows * n {
            let mask = match high {
                Some(high) => u8::from(crosses(at, high.get(at))) << 2,
                None => {
                    let x = (at + 1) % n != 0 && crosses(at, low.get(at + 1));
                    u8::from(x) | u8::from(crosses(at, low.get(at + n))) << 1
                }
            };
            numbers.first.push(numbers.count as u32);
            numbers.mask.push(mask);
            numbers.count += u64::from(mask.count_ones());
        }
        numbers
    }

    /// Calls `visit` for each cube that the surface crosses, with the place of its lowest corner and its case.
    fn cubes(&self, rows: usize, low: &[f32], high: &[f32], mut visit: impl FnMut(usize, &Case)) {
        let n = self.field.voxels[0];
        if high.is_empty() {
            return;
        }
        for j in 0..rows.min(low.len() / n - 1) {
            let column = |at: usize| {
                let bit = |value: f32, bit: usize| usize::from(value >= 0.0) << bit;
                bit(low[at], 0) | bit(low[at + n], 2) | bit(high[at], 4) | bit(high[at + n], 6)
            };
            let mut left = column(j * n);
            for at in j * n..(j + 1) * n - 1 {
                let right = column(at + 1);
                let inside = left | right << 1;
                if inside != 0 && inside != 255 {
                    visit(at, &self.cases[inside]);
                }
                left = right;
            }
        }
    }

    /// Appends the vertices on the numbered edges.
    fn place(
        &self,
        numbers: &Numbers,
        (k, from): (usize, usize),
        slices: [&[f32]; 2],
        out: &mut Vec<Vertex>,
    ) {
        let n = self.field.voxels[0];
        for (at, mask) in numbers.mask.iter().enumerate().filter(|(_, mask)| **mask != 0) {
            for axis in (0..3).filter(|axis| mask >> axis & 1 == 1) {
                let a = slices[0][at];
                let b = [slices[0], slices[0], slices[1]][axis][at + [1, n, 0][axis]];
                let t = (a / (a - b)).clamp(self.margin, 1.0 - self.margin);
                let mut voxel = [(at % n) as f64, (from + at / n) as f64, k as f64];
                voxel[axis] += f64::from(t);
                out.push(self.vertex(voxel));
            }
        }
    }

    fn vertex(&self, voxel: [f64; 3]) -> Vertex {
        let place = self.field.place(voxel);
        let position = place.map(|x| (VOXEL * x) as f32);
        let uv = [0, 1].map(|axis| ((voxel[axis] + 0.5) / self.field.voxels[axis] as f64) as f32);
        let color = if self.colored {
            let tone = 0.5 + 0.5 * noise3(place.map(|x| 0.04 * x), self.seed as u32);
            [0.88 - 0.2 * tone, 0.72 - 0.25 * tone, 0.62 - 0.3 * tone].map(|c| (255.0 * c) as u8)
        } else {
            [0; 3]
        };
        Vertex { position, color, uv }
    }
}

impl Sliced for Volume {
    fn n_blocks(&self) -> u64 {
        self.field.voxels[2] as u64 * self.n_bands()
    }

    fn count(&self, block: u64) -> BlockCounts {
        let (k, from, to) = self.extent(block);
        let [low, high] = [k, k + 1].map(|k| self.field.rows(k, from, to + 1));
        let rows = to - from;
        let within = self.number(&low, None, rows).count;
        let between = self.number(&low, Some(&high), rows).count;
        let mut faces = 0;
        self.cubes(rows, &low, &high, |_, case| faces += case.len() as u64);
        BlockCounts { vertices: [within, between], faces }
    }

    fn vertices(&self, block: u64, out: &mut Vec<Vertex>) {
        let (k, from, to) = self.extent(block);
        let [low, high] = [k, k + 1].map(|k| self.field.rows(k, from, to + 1));
        for above in [None, Some(&high[..])] {
            let numbers = self.number(&low, above, to - from);
            self.place(&numbers, (k, from), [&low, &high], out);
        }
    }

    fn faces(&self, block: u64, first: &[[u64; 2]], out: &mut Vec<[u64; 3]>) {
        let (k, from, to) = self.extent(block);
        let (n, rows) = (self.field.voxels[0], to - from);
        // The cubes' last row belongs to the next band, and the row behind it ends its edges.
        let [low, high] = [k, k + 1].map(|k| self.field.rows(k, from, to + 2));
        let numbers = [
            self.number(&low, None, rows + 1),
            self.number(&high, None, rows + 1),
            self.number(&low, Some(&high), rows + 1),
        ];
        // The next band's rows are numbered from its own first vertex, not on from this band's.
        let split = rows * n;
        let ends =
            [0, 1, 2].map(|s| numbers[s].first.get(split).map_or(0, |first| u64::from(*first)));
        let id = |at: usize, edge: cases::Edge| {
            let corner = usize::from(edge.corner);
            let (at, dk) = (at + (corner & 1) + (corner >> 1 & 1) * n, corner >> 2);
            let section = usize::from(edge.axis == 2);
            let which = if section == 1 { 2 } else { dk };
            let next_band = u64::from(at >= split);
            let owner = block + dk as u64 * self.n_bands() + next_band;
            let before = (numbers[which].mask[at] & ((1 << edge.axis) - 1)).count_ones();
            first[owner as usize][section] + u64::from(numbers[which].first[at] + before)
                - next_band * ends[which]
        };
        self.cubes(rows, &low, &high, |at, case| {
            out.extend(case.iter().map(|corners| corners.map(|edge| id(at, edge))));
        });
    }
}
