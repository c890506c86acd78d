//! The nearest places of the original for the points of a result's triangles, patch by patch.
//!
//! The points of a triangle lie close together, so the triangles of the original that any of them can be nearest to are few.
//! They are listed once, for all points of a patch: if the middle of the patch is `d` from the original and no point is
//! farther than `r` from the middle, every nearest place is within `d + 2 r` of it. Patches are halved while their lists
//! are long, by small squares of points that are never looked at one by one up to there. A point then tests the triangles of the list by a bound of nine products, and measures those that the bound
//! does not exclude. Points whose lists would be too long, or whose cells are not in memory, search the trees (`nearest`).
//! The answer is bit for bit that of the trees.

use super::candidates::{Candidate, LANES, Near, PointGroup, SLACK};
use super::nearest::{CellCache, Seekers, Subset};
use super::original::{Cell, Face, Hit, Original};
use super::side::Side;
use std::ops::Range;
use std::sync::Arc;
use stonecut_measure::tree::Nearest;
use stonecut_measure::triangle::{self, Vector};
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::length_sq;
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;

/// Points that a thread takes at a time, about.
const BLOCK: usize = 8192;

/// Fewer points than this are not halved, whatever the length of their list.
const FEW_POINTS: usize = 32;

/// Lists of so few triangles are not made shorter.
const FEW_TRIANGLES: usize = 5;

/// Triangles of a list for a point at most. With 0.5 the trees had 99 % of the points where a texel has half a triangle, in
/// 1.13 of the time of a bake; of 2, 4 and 8 none was faster than the others.
const TRIANGLES_PER_POINT: f64 = 4.0;

/// Boxes that are looked at for a triangle of a list, at most.
const BOXES: usize = 2;

/// Triangles of a list at most.
const MOST_TRIANGLES: usize = 256;

/// The same of the coordinates, which were rounded when they were subtracted.
const COORDINATE_SLACK: f64 = 1e-14;

/// Cells in memory, by number.
type Held = [Option<Arc<Cell>>];

impl Original {
    /// Finds a place for each point, as `nearest_any` and `turn` do; `patches` are the points of triangles, in order.
    /// Points of no patch keep the places that they have.
    pub fn nearest_by_patches(
        &self,
        seekers: &impl Seekers,
        patches: &[Range<usize>],
        cells: &mut CellCache,
        (threads, progress): (usize, &Progress),
        hits: &mut Vec<Hit>,
    ) -> Result<()> {
        let wanted = self.cells_around(seekers, patches);
        let held = cells.held_after(self, &wanted, (threads, progress))?;
        let mut blocks: Vec<Range<usize>> = Vec::new();
        let mut n_points = BLOCK;
        for (i, patch) in patches.iter().enumerate() {
            if n_points >= BLOCK {
                blocks.push(i..i);
                n_points = 0;
            }
            n_points += patch.len();
            if let Some(block) = blocks.last_mut() {
                block.end = i + 1;
            }
        }
        hits.resize(seekers.n(), Hit::NONE);
        in_order(
            blocks.len() as u64,
            threads,
            progress,
            |i, solver: &mut Solver| {
                let block = &patches[blocks[i as usize].clone()];
                solver.solve_all(self, &held, seekers, block);
                Ok(())
            },
            |i, solver| {
                let block = &patches[blocks[i as usize].clone()];
                let first = block.first().map_or(0, |patch| patch.start);
                for patch in block {
                    let own = patch.start - first..patch.end - first;
                    hits[patch.clone()].copy_from_slice(&solver.hits[own]);
                }
                Ok(())
            },
        )?;
        drop(held);
        let left: Vec<u32> = (0u32..)
            .zip(&*hits)
            .filter(|(_, hit)| hit.distance_sq.is_infinite())
            .map(|(i, _)| i)
            .collect();
        if !left.is_empty() {
            let some = Subset { of: seekers, numbers: &left };
            let found = self.nearest_any(&some, cells, (threads, progress))?;
            left.iter().zip(found).for_each(|(&i, hit)| hits[i as usize] = hit);
        }
        self.turn(seekers, hits, cells, (threads, progress))
    }
}

/// Points of a patch that are neighbours: a range of them in the order of squares.
#[derive(Clone, Debug)]
struct Square {
    around: Bounds,
    points: Range<usize>,
}

impl Square {
    fn of(points: &Numbered, range: Range<usize>) -> Square {
        let mut around = Bounds::EMPTY;
        points[range.clone()].iter().for_each(|(at, _)| around.add(*at));
        Square { around, points: range }
    }
}

fn n_points(squares: &[Square]) -> usize {
    squares.iter().map(|square| square.points.len()).sum()
}

/// Points of a patch and how far they reach.
struct Ball {
    middle: Vector,
    radius: f64,
    /// The axis along which the points are farthest apart.
    axis: usize,
    /// Bound on what rounding makes of distances.
    slack: f64,
}

impl Ball {
    fn around(squares: &[Square]) -> Ball {
        let all = squares.iter().map(|square| square.around);
        let around = all.fold(Bounds::EMPTY, |all, own| all.joined(&own));
        let extent = [0, 1, 2].map(|k| around.high[k] - around.low[k]);
        let axis = (0..3).fold(0, |most, k| if extent[k] > extent[most] { k } else { most });
        let middle = around.middle();
        let radius = 0.5 * (1.0 + SLACK) * length_sq(extent).sqrt();
        let largest = |at: Vector| at.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        let largest = largest(around.low).max(largest(around.high));
        Ball { middle, radius, axis, slack: COORDINATE_SLACK * largest }
    }

    /// Distance within which all nearest places lie, if one is `nearest` from the middle.
    fn reach(&self, nearest: f64) -> f64 {
        (nearest + 2.0 * self.radius) * (1.0 + SLACK) + 4.0 * self.slack
    }
}

/// Finds the places of the points of patches, with what it needs again and again.
#[derive(Default)]
struct Solver {
    /// For each point of the block its place; `Hit::NONE` where the trees have to be searched.
    hits: Vec<Hit>,
    points: Vec<(Vector, u32)>,
    squares: Vec<Square>,
    /// Neighbouring points of a square, as they were given.
    runs: Vec<(u64, Range<usize>)>,
    candidates: Vec<Candidate>,
    /// The most of their slacks.
    slack: f64,
    /// Lists of candidates, that of a half behind that of the whole.
    near: Vec<Near>,
    group: PointGroup,
    slots: Vec<u32>,
    /// A triangle that may be nearest.
    guess: u32,
}

/// Inputs of a patch.
struct Patch<'a> {
    original: &'a Original,
    held: &'a Held,
    /// The triangle that the points are on.
    side: Side,
    /// All cells, the ones nearest to the patch and its neighbours first, with squared distances.
    cells: &'a [(f64, usize)],
}

impl Solver {
    fn solve_all(
        &mut self,
        original: &Original,
        held: &Held,
        seekers: &impl Seekers,
        patches: &[Range<usize>],
    ) {
        let first = patches.first().map_or(0, |patch| patch.start);
        let end = patches.last().map_or(0, |patch| patch.end);
        self.hits.clear();
        self.hits.resize(end - first, Hit::NONE);
        let mut points = std::mem::take(&mut self.points);
        let mut squares = std::mem::take(&mut self.squares);
        let mut around = Bounds::EMPTY;
        patches.iter().flat_map(Clone::clone).for_each(|i| around.add(seekers.point(i)));
        let gaps = original.boxes.iter().map(|own| own.gap_sq(&around));
        let mut cells: Vec<(f64, usize)> = gaps.zip(0..).collect();
        cells.sort_by(|a, b| a.0.total_cmp(&b.0));
        for range in patches.iter().filter(|range| !range.is_empty()) {
            self.part(seekers, range.clone(), first, (&mut points, &mut squares));
            let i = range.start;
            let side = Side { normal: seekers.normal(i), steps: seekers.steps(i) };
            let patch = Patch { original, held, side, cells: &cells };
            self.list(&patch, &mut points, &mut squares);
        }
        (self.points, self.squares) = (points, squares);
    }

    /// Parts the points of a patch into squares.
    fn part(
        &mut self,
        seekers: &impl Seekers,
        range: Range<usize>,
        first: usize,
        (points, squares): (&mut Vec<(Vector, u32)>, &mut Vec<Square>),
    ) {
        self.runs.clear();
        for i in range {
            let own = seekers.square(i);
            match self.runs.last_mut() {
                Some((square, run)) if *square == own => run.end = i + 1,
                _ => self.runs.push((own, i..i + 1)),
            }
        }
        // Stable, and quick: rows are in order.
        self.runs.sort_by_key(|(square, _)| *square);
        points.clear();
        squares.clear();
        for same in self.runs.chunk_by(|a, b| a.0 == b.0) {
            let start = points.len();
            let numbers = same.iter().flat_map(|(_, run)| run.clone());
            points.extend(numbers.map(|i| (seekers.point(i), (i - first) as u32)));
            squares.push(Square::of(points, start..points.len()));
        }
    }

    /// Calls `each` with two halves of some points along an axis.
    fn halve(
        &mut self,
        (points, squares): (&mut Numbered, &mut [Square]),
        axis: usize,
        mut each: impl FnMut(&mut Solver, &mut Numbered, &mut [Square]),
    ) {
        if let [square] = squares {
            let Range { start, end } = square.points;
            let middle = (end - start) / 2;
            points[start..end].select_nth_unstable_by(middle, |(a, i), (b, j)| {
                a[axis].total_cmp(&b[axis]).then(i.cmp(j))
            });
            for range in [start..start + middle, start + middle..end] {
                let mut half = [Square::of(points, range)];
                each(self, points, &mut half);
            }
            return;
        }
        let middle = squares.len() / 2;
        let at = |square: &Square| square.around.middle()[axis];
        squares.select_nth_unstable_by(middle, |a, b| {
            at(a).total_cmp(&at(b)).then(a.points.start.cmp(&b.points.start))
        });
        let (left, right) = squares.split_at_mut(middle);
        each(self, points, left);
        each(self, points, right);
    }

    /// Lists the candidates of some points and finds their places; halves the points if there are too many of them.
    fn list(&mut self, patch: &Patch, points: &mut Numbered, squares: &mut [Square]) {
        let ball = Ball::around(squares);
        let n = n_points(squares);
        let most = (n as f64 * TRIANGLES_PER_POINT) as usize;
        match self.listed(patch, &ball, most.clamp(FEW_TRIANGLES, MOST_TRIANGLES)) {
            Listed::All => self.narrow(patch, (points, squares), &ball, 0),
            Listed::TooMany if n >= FEW_POINTS => {
                self.halve((points, squares), ball.axis, |solver, points, half| {
                    solver.list(patch, points, half);
                });
            }
            Listed::TooMany | Listed::NotHere => {}
        }
    }

    /// Fills the list of candidates of a ball.
    fn listed(&mut self, patch: &Patch, ball: &Ball, most: usize) -> Listed {
        let boxes = &patch.original.boxes;
        let off = |cell: usize| boxes[cell].distance_sq(ball.middle);
        let mut home = (f64::INFINITY, 0);
        for &(gap, cell) in patch.cells {
            if gap >= home.0 {
                break;
            }
            home = if off(cell) < home.0 { (off(cell), cell) } else { home };
        }
        let mut nearest_sq = f64::INFINITY;
        let others = patch.cells.iter().copied().filter(|(_, cell)| *cell != home.1);
        for (gap, cell) in std::iter::once(home).chain(others) {
            if gap >= nearest_sq {
                break;
            }
            if off(cell) < nearest_sq {
                let Some(held) = &patch.held[cell] else { return Listed::NotHere };
                // What was nearest to other points is not far from these.
                let guess = held.tree.guess(ball.middle, self.guess);
                let within = Nearest { distance_sq: nearest_sq, ..Nearest::NONE };
                let is_near = guess.distance_sq < nearest_sq;
                let found = held.tree.nearest(ball.middle, if is_near { guess } else { within });
                if found.is_found() {
                    (nearest_sq, self.guess) = (found.distance_sq, found.slot);
                }
            }
        }
        if nearest_sq.is_infinite() {
            return Listed::NotHere;
        }
        let reach = ball.reach(nearest_sq.sqrt());
        let reach_sq = reach * reach;
        self.candidates.clear();
        self.slack = 0.0;
        let within = patch.cells.iter().take_while(|(gap, _)| *gap <= reach_sq);
        let mut within: Vec<usize> =
            within.map(|(_, cell)| *cell).filter(|&cell| off(cell) <= reach_sq).collect();
        within.sort_unstable();
        for cell in within {
            let Some(held) = &patch.held[cell] else { return Listed::NotHere };
            self.slots.clear();
            if !held.tree.boxes_within(ball.middle, reach_sq, BOXES * most, &mut self.slots) {
                return Listed::TooMany;
            }
            for &slot in &self.slots {
                let candidate = Candidate::new((cell as u32, slot), held.tree.corners(slot));
                self.slack = candidate.slack.max(self.slack);
                self.candidates.push(candidate);
            }
        }
        self.near.clear();
        for (candidate, own) in (0..).zip(&self.candidates) {
            self.near.push(Near { candidate, bound_sq: own.bound_sq(ball.middle) });
        }
        self.shorten(0, reach);
        if self.near.len() <= most { Listed::All } else { Listed::TooMany }
    }

    /// Leaves those in the list from `begin` on that may be within `reach` of the points' middle.
    fn shorten(&mut self, begin: usize, reach: f64) {
        let limit_sq = (reach + self.slack) * (reach + self.slack);
        let mut kept = begin;
        for i in begin..self.near.len() {
            if self.near[i].bound_sq <= limit_sq {
                self.near[kept] = self.near[i];
                kept += 1;
            }
        }
        self.near.truncate(kept);
    }

    /// Halves the points while their list, which begins at `from`, is long; the shorter list of a half follows behind it.
    fn narrow(
        &mut self,
        patch: &Patch,
        (points, squares): (&mut Numbered, &mut [Square]),
        ball: &Ball,
        from: usize,
    ) {
        let n = self.near.len() - from;
        if n <= FEW_TRIANGLES || n_points(squares) < FEW_POINTS {
            for square in &*squares {
                self.measure(patch, &points[square.points.clone()], from);
            }
            return;
        }
        self.halve((points, squares), ball.axis, |solver, points, half| {
            let own = Ball::around(half);
            let begin = solver.near.len();
            let mut least = (f64::INFINITY, 0);
            for i in from..begin {
                let candidate = solver.near[i].candidate;
                let bound_sq = solver.candidates[candidate as usize].bound_sq(own.middle);
                if bound_sq < least.0 {
                    least = (bound_sq, candidate);
                }
                solver.near.push(Near { candidate, bound_sq });
            }
            let likeliest = &solver.candidates[least.1 as usize];
            let Some(cell) = &patch.held[likeliest.cell as usize] else { return };
            let nearest_sq = triangle::closest(own.middle, cell.tree.corners(likeliest.slot)).0;
            solver.shorten(begin, own.reach(nearest_sq.sqrt()));
            solver.narrow(patch, (points, half), &own, begin);
            solver.near.truncate(begin);
        });
    }

    /// Finds the places of points among the candidates of the list that begins at `from`.
    fn measure(&mut self, patch: &Patch, points: &[(Vector, u32)], from: usize) {
        let (list, group) = (&self.near[from..], &mut self.group);
        let candidate_at = |i: usize| &self.candidates[list[i].candidate as usize];
        if list.is_empty() {
            return;
        }
        let cell = candidate_at(0).cell;
        let many_cells = (1..list.len()).any(|i| candidate_at(i).cell != cell);
        let largest = points
            .first()
            .map_or(0.0, |(at, _)| at.iter().fold(0.0, |most: f64, x| most.max(x.abs())));
        let slack = self.slack + 4.0 * COORDINATE_SLACK * largest;
        let limit_sq = |distance_sq: f64| {
            let limit = distance_sq.sqrt() * (1.0 + SLACK) + slack;
            limit * limit
        };
        let corners = |candidate: &Candidate| {
            let cell = patch.held[candidate.cell as usize].as_ref()?;
            Some((cell, cell.tree.corners(candidate.slot)))
        };
        let mut seen: Option<(u32, u32, Face)> = None;
        let mut likeliest = [(0.0, [0.0; 3]); LANES];
        for (at, &(point, number)) in points.iter().enumerate() {
            let lane = at % LANES;
            if lane == 0 {
                let points = &points[at..points.len().min(at + LANES)];
                group.begin(&self.candidates, list, points);
                let mut limits_sq = [-1.0; LANES];
                for lane in 0..points.len() {
                    let i = group.likeliest[lane] as usize;
                    let Some((_, t)) = corners(candidate_at(i)) else { return };
                    likeliest[lane] = group.closest(i, lane, t);
                    limits_sq[lane] = limit_sq(likeliest[lane].0);
                }
                group.open(&limits_sq);
            }
            let mut of_best = group.likeliest[lane] as usize;
            let (distance_sq, mut weights) = likeliest[lane];
            let mut best = Nearest { distance_sq, slot: candidate_at(of_best).slot };
            let mut limit = limit_sq(distance_sq);
            // Equally near ones in several cells.
            let mut ties = Vec::new();
            for k in 0..group.opened.len() {
                let i = group.opened[k] as usize;
                if i == group.likeliest[lane] as usize || group.bounds_sq[i][lane] > limit {
                    continue;
                }
                let candidate = candidate_at(i);
                let Some((cell, t)) = corners(candidate) else { continue };
                let (distance_sq, own) = group.closest(i, lane, t);
                if many_cells
                    && distance_sq == best.distance_sq
                    && candidate.cell != candidate_at(of_best).cell
                {
                    ties.push(i);
                    continue;
                }
                if cell.tree.is_better(distance_sq, candidate.slot, best) {
                    if distance_sq < best.distance_sq {
                        ties.clear();
                    }
                    best = Nearest { distance_sq, slot: candidate.slot };
                    (of_best, weights, limit) = (i, own, limit_sq(distance_sq));
                }
            }
            let candidate = candidate_at(of_best);
            let Some(cell) = &patch.held[candidate.cell as usize] else { continue };
            let face = match seen {
                Some((number, slot, face))
                    if (number, slot) == (candidate.cell, candidate.slot) =>
                {
                    face
                }
                _ => patch.original.face(cell, candidate.slot, &patch.side),
            };
            seen = Some((candidate.cell, candidate.slot, face));
            let mut hit = patch.original.hit(cell, &face, (best.distance_sq, weights));
            for candidate in ties.iter().map(|&i| candidate_at(i)) {
                let Some(cell) = &patch.held[candidate.cell as usize] else { continue };
                let face = patch.original.face(cell, candidate.slot, &patch.side);
                let found = triangle::closest(point, cell.tree.corners(candidate.slot));
                let other = patch.original.hit(cell, &face, found);
                if other.is_better(&hit) {
                    hit = other;
                }
            }
            self.hits[number as usize] = hit;
        }
    }
}

/// Outcome of listing candidates.
enum Listed {
    All,
    TooMany,
    /// A cell that it takes is not in memory.
    NotHere,
}

/// Points with their numbers.
type Numbered = [(Vector, u32)];

#[cfg(test)]
mod tests {
    use super::super::same::Own;
    use super::super::settings::{Means, Options};
    use super::*;
    use std::fmt::Write;
    use stonecut_io::ply::{MeshSource, ReadOptions};
    use stonecut_render::texture::{Palette, Purpose, WantedMaps};
    use stonecut_system::disk::Disk;

    /// Two sheets of waves, one close above the other and upside down, with a colour for each vertex.
    fn sheets() -> Vec<u8> {
        let n = 24;
        let (mut rows, mut faces) = (String::new(), String::new());
        for sheet in 0..2 {
            for i in 0..=n {
                for j in 0..=n {
                    let (x, y) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                    let z = 0.05 * (9.0 * x).sin() * (7.0 * y).cos() + 0.03 * f64::from(sheet);
                    writeln!(rows, "{x} {y} {z} {} {} {}", 10 * i % 256, 10 * j % 256, 200 * sheet)
                        .unwrap();
                }
            }
            for i in 0..n {
                for j in 0..n {
                    let id = |i: i32, j: i32| (sheet * (n + 1) + i) * (n + 1) + j;
                    let (a, b, c, d) = (id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1));
                    match sheet {
                        0 => writeln!(faces, "3 {a} {b} {c}\n3 {a} {c} {d}").unwrap(),
                        _ => writeln!(faces, "3 {a} {c} {b}\n3 {a} {d} {c}").unwrap(),
                    }
                }
            }
        }
        format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             property uchar red\nproperty uchar green\nproperty uchar blue\nelement face {}\n\
             property list uchar int vertex_indices\nend_header\n{rows}{faces}",
            2 * (n + 1) * (n + 1),
            4 * n * n
        )
        .into_bytes()
    }

    /// Points on triangles: each with the number of its triangle.
    struct Points {
        corners: Vec<[Vector; 3]>,
        points: Vec<(Vector, usize)>,
    }

    impl Seekers for Points {
        fn n(&self) -> usize {
            self.points.len()
        }

        fn point(&self, i: usize) -> Vector {
            self.points[i].0
        }

        fn square(&self, i: usize) -> u64 {
            (i / 40) as u64
        }

        fn normal(&self, i: usize) -> Vector {
            triangle::area_normal(&self.corners[self.points[i].1])
        }

        // Half of the points whose nearest place faces away find another one.
        fn grace(&self, i: usize) -> f64 {
            if i.is_multiple_of(2) { 0.05 } else { 0.0 }
        }
    }

    impl Own for Points {
        fn corners(&self, i: usize) -> [Vector; 3] {
            self.corners[self.points[i].1]
        }

        // All points are in the middle.
        fn weights(&self, _i: usize) -> [f64; 3] {
            [1.0 / 3.0; 3]
        }
    }

    /// Calls `each` with both sheets in cells.
    fn with_original(each: impl FnOnce(&Original, (usize, &Progress))) {
        let folder = tempfile::tempdir().unwrap();
        let source = MeshSource::from_bytes("sheets", sheets(), ReadOptions::default()).unwrap();
        let (disk, progress) = (Disk::default(), Progress::default());
        let means = Means {
            memory_bytes: 1 << 30,
            threads: 2,
            temp_dir: folder.path(),
            disk: &disk,
            progress: &progress,
        };
        let beside = WantedMaps::default();
        let options = Options {
            coding: None,
            colours_multiply: false,
            page_size: 512,
            most_pages: None,
            cell_triangles: 300,
            normals: true,
            beside,
        };
        let palette = Palette::new(None, Purpose::Bake(beside));
        let original = Original::cut(source, &palette, &options, means).unwrap();
        assert!(original.boxes.len() > 3, "{}", original.boxes.len());
        each(&original, (2, &progress));
    }

    #[test]
    fn triangles_of_the_original_need_no_search() {
        with_original(|original, how| {
            let mut points = Points { corners: Vec::new(), points: Vec::new() };
            for cell in 0..original.boxes.len() {
                let tree = original.load(cell, how.1).unwrap().tree;
                for t in (0..tree.len()).step_by(7) {
                    // Rounded, and from another corner on; every third one is somewhere else.
                    let off = if t % 3 == 0 { 0.01 } else { 1e-5 };
                    let corners = triangle::rotate(*tree.corners(t as u32), t % 3);
                    let corners = corners.map(|p| [p[0] + off, p[1] - off, p[2] + off]);
                    let at = triangle::point_at(&corners, [1.0 / 3.0; 3]);
                    points.points.push((at, points.corners.len()));
                    points.corners.push(corners);
                }
            }
            let patches: Vec<Range<usize>> = (0..points.points.len()).map(|i| i..i + 1).collect();
            let mut all = Vec::new();
            for cell_bytes in [1 << 30, 1] {
                let mut cells = CellCache::new(cell_bytes);
                let mut hits = vec![Hit::NONE; patches.len()];
                let left =
                    original.same((&points, 3e-5), &patches, &mut cells, how, &mut hits).unwrap();
                assert!(left.len() > patches.len() / 5 && left.len() < patches.len() / 2);
                assert!(left.iter().all(|patch| hits[patch.start].distance_sq.is_infinite()));
                let found = hits.iter().filter(|hit| hit.distance_sq == 0.0 && hit.faces);
                assert_eq!(found.count(), patches.len() - left.len());
                original.nearest_by_patches(&points, &left, &mut cells, how, &mut hits).unwrap();
                // Colours of the nearest places, to rounding.
                let nearest = original.nearest_any(&points, &mut cells, how).unwrap();
                for (a, b) in hits.iter().zip(&nearest).filter(|(a, _)| a.distance_sq == 0.0) {
                    assert!(a.colour.iter().zip(b.colour).all(|(a, b)| a.abs_diff(b) <= 1));
                }
                let looks = |hit: &Hit| (hit.distance_sq.to_bits(), hit.colour);
                all.push(hits.iter().map(looks).collect::<Vec<_>>());
            }
            assert_eq!(all[0], all[1]);
        });
    }

    #[test]
    fn patches_find_what_trees_find() {
        with_original(compare_with_trees);
    }

    fn compare_with_trees(original: &Original, how: (usize, &Progress)) {
        // Triangles of a few edges of the sheets and of a tenth of one, on both sides of both sheets.
        let mut points = Points { corners: Vec::new(), points: Vec::new() };
        let mut patches = Vec::new();
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        for i in 0..40 {
            let at = [random(), random(), 0.1 * random() - 0.03];
            let size = if i % 2 == 0 { 0.2 } else { 0.004 };
            let corner = |a: f64, b: f64| [at[0] + size * a, at[1] + size * b, at[2]];
            let up = [corner(0.0, 0.0), corner(1.0, 0.1), corner(0.2, 1.0)];
            let t = if i % 3 == 0 { [up[0], up[2], up[1]] } else { up };
            let first = points.points.len();
            for _ in 0..150 {
                let (a, b) = (random(), random());
                let (v, w) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
                let at = triangle::point_at(&t, [1.0 - v - w, v, w]);
                points.points.push((at, points.corners.len()));
            }
            points.corners.push(t);
            patches.push(first..points.points.len());
        }
        // All cells in memory, and one at a time.
        for cell_bytes in [1 << 30, 1] {
            let mut cells = CellCache::new(cell_bytes);
            let mut by_trees = original.nearest_any(&points, &mut cells, how).unwrap();
            original.turn(&points, &mut by_trees, &mut cells, how).unwrap();
            let mut by_patches = Vec::new();
            let hits = &mut by_patches;
            original.nearest_by_patches(&points, &patches, &mut cells, how, hits).unwrap();
            assert!(by_trees.iter().any(|hit| !hit.faces) && by_trees.iter().any(|hit| hit.faces));
            for (i, (a, b)) in by_patches.iter().zip(&by_trees).enumerate() {
                let same = |hit: &Hit| (hit.distance_sq.to_bits(), hit.colour, hit.normal);
                assert_eq!(same(a), same(b), "point {i}");
            }
        }
    }
}
