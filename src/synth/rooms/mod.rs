//! `rooms`: an interior as photogrammetry delivers it.
//!
//! Panels (house.rs) are cut into ragged charts of some 250 triangles, each with its own vertices and a slot in
//! one of several textures (atlas.rs), whose images are painted from the same functions as the vertices' colours
//! (paint.rs). Noise, dents, doors and holes are functions of the place in the house.
//!
//! A block is a panel; vertices are numbered chart by chart.

mod atlas;
mod house;
mod images;
mod paint;
mod write;

use super::noise::{hash2, noise3, signed3};
use super::sliced::{BlockCounts, Sliced};
use super::surface::Vertex;
use atlas::{Atlas, CHART, Chart, REACH, STRAY};
use house::{House, Panel};
pub(super) use write::{faces, file_names, paint, texture, write};

/// A house and its atlas.
pub(super) struct Rooms {
    house: House,
    /// Number of each room's first chart, and of all charts.
    first_chart: Vec<u64>,
    pub(super) atlas: Atlas,
    seed: u64,
}

/// A panel as triangles.
#[derive(Default)]
pub(super) struct Piece {
    pub(super) vertices: Vec<Vertex>,
    pub(super) faces: Vec<[u32; 3]>,
    /// Number of each face's image.
    pub(super) pages: Vec<u32>,
}

impl Rooms {
    /// Rooms of about `n_triangles` times `scale`^3 triangles on `n_pages` images.
    pub(super) fn new(n_triangles: u64, scale: f64, n_pages: u64, seed: u64) -> Self {
        let house = House::new(n_triangles, scale, seed);
        let mut first_chart = vec![0];
        let mut n_charts = 0;
        for room in 0..house.n_rooms {
            n_charts += house.panels(room).iter().map(n_charts_of).sum::<u64>();
            first_chart.push(n_charts);
        }
        Rooms { house, first_chart, atlas: Atlas::new(n_charts, n_pages), seed }
    }

    /// The panel of a block and the number of its first chart.
    fn panel(&self, block: u64) -> (Panel, u64) {
        let (room, at) = (block / self.house.n_panels(), (block % self.house.n_panels()) as usize);
        let mut panels = self.house.panels(room);
        let before: u64 = panels[..at].iter().map(n_charts_of).sum();
        (panels.swap_remove(at), self.first_chart[room as usize] + before)
    }

    /// The panel of a chart, and the chart's place on it.
    fn chart(&self, number: u64) -> Option<(Panel, [usize; 2])> {
        let room = self.first_chart.partition_point(|first| *first <= number).checked_sub(1)?;
        let mut left = number - self.first_chart[room];
        if room as u64 >= self.house.n_rooms {
            return None;
        }
        for panel in self.house.panels(room as u64) {
            let [across, _] = charts_of(&panel);
            let n = n_charts_of(&panel);
            if left < n {
                return Some((panel, [left as usize % across, left as usize / across]));
            }
            left -= n;
        }
        None
    }

    /// Returns whether a place on a panel was never seen, or is a door.
    fn is_lost(&self, panel: &Panel, place: [f64; 2], point: [f64; 3]) -> bool {
        if panel.is_crumb {
            return false;
        }
        let seed = self.seed as u32;
        let fine = noise3(point.map(|x| 7.3 * x), seed ^ 42);
        if let Some(middle) = panel.door
            && (place[0] - middle).abs() < 0.5 + 0.05 * fine
            && place[1] < 2.1 + 0.05 * fine
        {
            return true;
        }
        noise3(point.map(|x| 1.9 * x), seed ^ 41) + 0.35 * fine > 0.74
    }

    /// A panel's triangles.
    pub(super) fn piece(&self, block: u64) -> Piece {
        let (panel, first_chart) = self.panel(block);
        let [wide, high] = panel.squares;
        let mut chart_of = Vec::with_capacity(wide * high);
        let [across, up] = charts_of(&panel);
        for j in 0..high {
            for i in 0..wide {
                let stray = |salt: f64| {
                    let limit = STRAY as f64;
                    let p = [i as f64 / 4.3, j as f64 / 4.3, salt];
                    (limit * noise3(p, panel.tag as u32)).clamp(-limit, limit) as isize
                };
                let number = |at: usize, salt: f64, n: usize| {
                    let at = at.saturating_add_signed(stray(salt));
                    (at / CHART).min(n - 1)
                };
                chart_of.push((number(j, 9.5, up) * across + number(i, 3.5, across)) as u32);
            }
        }
        let mut piece = Piece::default();
        for row in 0..up {
            for column in 0..across {
                let own = row * across + column;
                let chart = self.atlas.chart(first_chart + own as u64, self.seed);
                let at = [column, row];
                self.put_chart(
                    &panel,
                    at,
                    &chart,
                    |i, j| chart_of[j * wide + i] == own as u32,
                    &mut piece,
                );
            }
        }
        piece
    }

    /// Appends the squares of one chart.
    fn put_chart(
        &self,
        panel: &Panel,
        at: [usize; 2],
        chart: &Chart,
        is_own: impl Fn(usize, usize) -> bool,
        piece: &mut Piece,
    ) {
        let from = at.map(|n| (n * CHART).saturating_sub(STRAY));
        let to = [0, 1].map(|n| ((at[n] + 1) * CHART + STRAY).min(panel.squares[n]));
        let mut ids = [[u32::MAX; REACH + 1]; REACH + 1];
        for j in from[1]..to[1] {
            for i in from[0]..to[0] {
                if !is_own(i, j) {
                    continue;
                }
                let diagonal = hash2((j * panel.squares[0] + i) as u64, panel.tag) & 1;
                let square = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
                for triangle in [[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [1, 3, 0]]][diagonal as usize]
                {
                    let corners = triangle.map(|n: usize| square[n]);
                    let middle =
                        [0, 1].map(|n| corners.iter().map(|c| c[n]).sum::<usize>() as f64 / 3.0);
                    let place = on_panel(panel, middle);
                    if self.is_lost(panel, place, in_house(panel, place)) {
                        continue;
                    }
                    let face = corners.map(|[i, j]| {
                        let id = &mut ids[j - from[1]][i - from[0]];
                        if *id == u32::MAX {
                            *id = piece.vertices.len() as u32;
                            let local = [i, j].map(|n| n as f64);
                            let local = [0, 1].map(|n| local[n] - chart_start(at)[n]);
                            piece.vertices.push(self.vertex(panel, [i, j], chart.uv(local)));
                        }
                        *id
                    });
                    piece.faces.push(face);
                    piece.pages.push(chart.page as u32);
                }
            }
        }
    }

    fn vertex(&self, panel: &Panel, [i, j]: [usize; 2], uv: [f32; 2]) -> Vertex {
        let place = on_panel(panel, [i as f64, j as f64]);
        let point = in_house(panel, place);
        // Panels that meet compute the same point along different sides: noise must not see the last digits.
        const FINE: f64 = 65_536.0;
        let grid = point.map(|x| (x * FINE + 0.5) as u64);
        let key = grid.iter().fold(self.seed, |key, x| hash2(*x, key));
        let point = grid.map(|x| x as f64 / FINE);
        let jitter = self.house.edge.min(0.05) * if panel.is_crumb { 0.35 } else { 0.08 };
        let rough = signed3(key).map(|x| jitter * x);
        let dent = [51, 52, 53]
            .map(|salt| 0.012 * noise3(point.map(|x| 1.1 * x), self.seed as u32 ^ salt));
        Vertex {
            position: [0, 1, 2].map(|n| (point[n] + rough[n] + dent[n]) as f32),
            color: panel.paint.color(place, panel.tag),
            uv,
        }
    }
}

/// Charts along each side of a panel.
fn charts_of(panel: &Panel) -> [usize; 2] {
    panel.squares.map(|n| n.div_ceil(CHART))
}

fn n_charts_of(panel: &Panel) -> u64 {
    charts_of(panel).iter().map(|n| *n as u64).product()
}

/// Lower corner of the box around a chart, in squares; may lie before the panel.
fn chart_start(at: [usize; 2]) -> [f64; 2] {
    at.map(|n| (n * CHART) as f64 - STRAY as f64)
}

/// Metres along both sides, of a place in squares.
fn on_panel(panel: &Panel, at: [f64; 2]) -> [f64; 2] {
    [0, 1].map(|n| at[n] * panel.size[n] / panel.squares[n] as f64)
}

fn in_house(panel: &Panel, place: [f64; 2]) -> [f64; 3] {
    let [a, b] = panel.sides;
    [0, 1, 2].map(|n| panel.origin[n] + place[0] * a[n] + place[1] * b[n])
}

impl Sliced for Rooms {
    fn n_blocks(&self) -> u64 {
        self.house.n_rooms * self.house.n_panels()
    }

    fn count(&self, block: u64) -> BlockCounts {
        let piece = self.piece(block);
        BlockCounts { vertices: [piece.vertices.len() as u64, 0], faces: piece.faces.len() as u64 }
    }

    fn vertices(&self, block: u64, out: &mut Vec<Vertex>) {
        out.append(&mut self.piece(block).vertices);
    }

    fn faces(&self, block: u64, first: &[[u64; 2]], out: &mut Vec<[u64; 3]>) {
        let start = first[block as usize][0];
        out.extend(self.piece(block).faces.iter().map(|face| face.map(|id| start + u64::from(id))));
    }
}
