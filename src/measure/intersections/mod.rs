//! Counts the places where a surface passes through or lies on itself.
//!
//! Pairs of triangles whose boxes touch are found by trees of boxes (`boxes`), at corners of many by what these see (`hubs`), and
//! decided exactly (`mesh::meeting`). A mesh in memory is one soup of triangles; one of any size is gone through cell by cell (`cells`). The counts are those of
//! the surface alone: not of threads, memory or cells. Changes nothing. docs/design/self-intersections.md.

mod boxes;
mod cells;
mod hubs;

pub use cells::{in_store, job_bytes};

use super::Unit;
use boxes::{BoxTask, Boxes, Item};
use hubs::{Hub, take_hubs};
use std::borrow::Cow;
use std::sync::atomic::{AtomicU64, Ordering};
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::meeting::{self, Meeting};
use stonecut_system::error::Result;
use stonecut_system::parallel;
use stonecut_system::progress::Progress;

/// Parts that the search in one mesh is cut into; enough for the threads of any machine.
const TASKS: usize = 1024;

/// Triangles between two looks at the wish to stop.
const STOP_ROWS: usize = 1 << 14;

/// Self-intersections of a surface, as `info --check --self-intersections` reports them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct SelfIntersections {
    /// Pairs of triangles with a common point that is not a common corner or on a common edge.
    pub self_intersections: u64,
    /// Triangles in at least one such pair.
    pub self_intersecting_triangles: u64,
    /// Such pairs of triangles in one plane that have an area in common.
    pub coplanar_overlaps: u64,
    /// Triangles left out: all corners on one line or in one place; `info` shows those of `check`.
    #[serde(skip)]
    pub collinear_triangles: u64,
}

/// Bytes that `in_memory` takes for a mesh of `n` triangles besides the mesh itself.
pub fn bytes(n: u64) -> u64 {
    Boxes::bytes(n) + n / 8 + 8
}

/// Counts in a mesh in memory. Faces that name a vertex twice count as collinear.
///
/// Coordinates beyond 1e18 and below 1e-18 take a copy of the mesh. Fails only if `progress` asks to stop.
pub fn in_memory(mesh: &Mesh, threads: usize, progress: &Progress) -> Result<SelfIntersections> {
    let unit = Unit::around(&Bounds::of(mesh));
    let mut mesh = Cow::Borrowed(mesh);
    if !unit.is_own() {
        unit.turn(mesh.to_mut());
    }
    let n = mesh.triangles.len();
    let marks = Marks::new(n as u64);
    let (soup, n_flat) = Soup::of(mesh, Numbers::From(0), |_, _| true, progress)?;
    let tasks = soup.boxes.tasks(TASKS);
    let mut tally = Tally::default();
    parallel::in_order(
        tasks.len() as u64,
        threads,
        progress,
        |index, part: &mut Tally| {
            *part = Tally::default();
            soup.count(tasks[index as usize], &marks, part, progress)?;
            progress.add((n / tasks.len()) as u64);
            Ok(())
        },
        |_, part| {
            tally.add(*part);
            Ok(())
        },
    )?;
    soup.count_hubs(&marks, &mut tally, progress)?;
    Ok(tally.finish(&marks, n_flat))
}

/// Sums over pairs.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    pairs: u64,
    overlaps: u64,
}

impl Tally {
    fn add(&mut self, other: Tally) {
        self.pairs += other.pairs;
        self.overlaps += other.overlaps;
    }

    fn finish(self, marks: &Marks, n_flat: u64) -> SelfIntersections {
        SelfIntersections {
            self_intersections: self.pairs,
            self_intersecting_triangles: marks.count(),
            coplanar_overlaps: self.overlaps,
            collinear_triangles: n_flat,
        }
    }
}

/// A bit for every triangle of the surface: set if it is in a pair.
struct Marks(Vec<AtomicU64>);

impl Marks {
    fn new(n: u64) -> Marks {
        Marks((0..n / 64 + 1).map(|_| AtomicU64::new(0)).collect())
    }

    fn set(&self, number: u64) {
        self.0[(number / 64) as usize].fetch_or(1 << (number % 64), Ordering::Relaxed);
    }

    fn count(&self) -> u64 {
        self.0.iter().map(|word| u64::from(word.load(Ordering::Relaxed).count_ones())).sum()
    }
}

/// Numbers of a soup's triangles in the whole surface.
enum Numbers {
    /// They follow each other.
    From(u64),
    /// As listed.
    List(Vec<u64>),
}

/// Triangles among which pairs are looked for.
struct Soup<'a> {
    mesh: Cow<'a, Mesh>,
    numbers: Numbers,
    /// Of those that belong to no hub.
    boxes: Boxes,
    hubs: Vec<Hub>,
}

impl<'a> Soup<'a> {
    /// The triangles of a mesh that `is_wanted` by number in the mesh and box; also counts those of them that have no
    /// area, which are left out.
    fn of(
        mesh: Cow<'a, Mesh>,
        numbers: Numbers,
        is_wanted: impl Fn(usize, &Bounds) -> bool,
        progress: &Progress,
    ) -> Result<(Soup<'a>, u64)> {
        // Growing by doubling would hold the list twice.
        let (mut items, mut n_flat) = (Vec::with_capacity(mesh.triangles.len()), 0);
        for i in 0..mesh.triangles.len() {
            if i % STOP_ROWS == 0 {
                progress.check()?;
            }
            let corners = mesh.corners(i);
            let bounds = Bounds::around(&corners);
            if !is_wanted(i, &bounds) {
                continue;
            }
            if meeting::is_flat(&corners) {
                n_flat += 1;
            } else {
                items.push(Item { bounds, id: i as u32 });
            }
        }
        let hubs = take_hubs(&mut items, |t| mesh.corners(t as usize));
        let boxes = Boxes::build(items, progress)?;
        Ok((Soup { mesh, numbers, boxes, hubs }, n_flat))
    }

    /// The box of all triangles.
    fn hull(&self) -> Bounds {
        self.hubs.iter().fold(*self.boxes.hull(), |hull, hub| hull.joined(&hub.hull))
    }

    fn corners(&self, t: u32) -> [[f64; 3]; 3] {
        self.mesh.corners(t as usize)
    }

    /// Triangles that belong to no hub, or to one from the hub of a number on.
    fn of_hub_on(&self, first: usize) -> impl Iterator<Item = (u32, [[f64; 3]; 3])> + '_ {
        let of_hubs = self.hubs[first..].iter().flat_map(|hub| hub.own.iter().copied());
        self.boxes.ids().chain(of_hubs).map(|t| (t, self.corners(t)))
    }

    fn number(&self, id: u32) -> u64 {
        match &self.numbers {
            Numbers::From(first) => first + u64::from(id),
            Numbers::List(list) => list[id as usize],
        }
    }

    /// Counts the pairs of a task.
    fn count(
        &self,
        task: BoxTask,
        marks: &Marks,
        tally: &mut Tally,
        progress: &Progress,
    ) -> Result<()> {
        self.boxes.pairs(task, progress, |i, j| self.decide(i, self, j, marks, tally))
    }

    /// Counts all pairs among these triangles, in this thread.
    fn count_all(&self, marks: &Marks, tally: &mut Tally, progress: &Progress) -> Result<()> {
        let tasks = self.boxes.tasks(1);
        tasks.into_iter().try_for_each(|task| self.count(task, marks, tally, progress))?;
        self.count_hubs(marks, tally, progress)
    }

    /// Counts the pairs of which at least one belongs to a hub.
    fn count_hubs(&self, marks: &Marks, tally: &mut Tally, progress: &Progress) -> Result<()> {
        for (n, hub) in self.hubs.iter().enumerate() {
            let mut visit = |i, j| self.decide(i, self, j, marks, tally);
            hub.pairs(|t| self.corners(t), progress, &mut visit)?;
            hub.pairs_with(|t| self.corners(t), self.of_hub_on(n + 1), progress, visit)?;
        }
        Ok(())
    }

    /// Counts the pairs of one of these triangles and one of the others.
    fn count_with(
        &self,
        other: &Soup,
        marks: &Marks,
        tally: &mut Tally,
        progress: &Progress,
    ) -> Result<()> {
        let visit = |i, j| self.decide(i, other, j, marks, tally);
        self.boxes.pairs_with(&other.boxes, progress, visit)?;
        for hub in &self.hubs {
            let visit = |i, j| self.decide(i, other, j, marks, tally);
            hub.pairs_with(|t| self.corners(t), other.of_hub_on(0), progress, visit)?;
        }
        for hub in &other.hubs {
            let own = self.boxes.ids().map(|t| (t, self.corners(t)));
            let visit = |i, j| other.decide(i, self, j, marks, tally);
            hub.pairs_with(|t| other.corners(t), own, progress, visit)?;
        }
        Ok(())
    }

    fn decide(&self, i: u32, other: &Soup, j: u32, marks: &Marks, tally: &mut Tally) {
        let (a, b) = (self.mesh.corners(i as usize), other.mesh.corners(j as usize));
        let meeting = meeting::meet(&a, &b);
        if meeting == Meeting::None {
            return;
        }
        tally.pairs += 1;
        tally.overlaps += u64::from(meeting == Meeting::Overlap);
        marks.set(self.number(i));
        marks.set(other.number(j));
    }
}
