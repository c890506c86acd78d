//! Cuts out what is wrong beyond mending and closes what that leaves: triangles that meet others, and the surroundings of holes whose
//! fillings would.
//!
//! Ring by ring, until every loop that is left has a filling that meets nothing; where a few rings do not do, or the filling lies far
//! from what was cut out, all stays as it was: two bodies that cross are not a slip of a scan, and cutting at them would take them away.

use super::rims::{self, Rim, parents};
use super::{FilledHoles, MOST_MOVED, bounds, fill};
use crate::crossing::Crossings;
use crate::simd::Simd;
use crate::state::MeshState;
use crate::state::recompute::recompute_vertices;
use crate::surface::class::Class;
use crate::surface::{MAX_VALENCE, Surface};
use crate::vertex::GONE;
use std::collections::{BTreeMap, BTreeSet};
use stonecut_mesh::corners::others;
use stonecut_mesh::vec3::{Vec3, add, cross, dot, length_sq, scale, sub, triangle_distance_sq};

/// Rings of triangles around what is wrong that are cut out at most, and triangles: one in a hundred between these numbers.
const MOST_RINGS: usize = 8;
const MOST_TRIANGLES: [u64; 2] = [400, 4000];
/// Places of either kind that could not be closed, after which no more are tried, and the fillings that count as one: each takes the
/// time of hundreds.
const MOST_LEFT: u64 = 200;
const FILLINGS: u64 = 50;
/// Distance between what is cut out and what it is closed with, at most, as a share of the surface's extent, where triangles meet and
/// around holes.
const MOST_LOST: [f64; 2] = [0.03, 0.08];
/// Volume that all cuts together may take or add, as a share of the volume or of the cube of the extent: within that distance, and
/// beyond it. A spike has none to speak of; scans lose 0.15 % at most.
const MOST_VOLUME: [f64; 2] = [0.01, 5e-5];
/// Loops of more edges are not local.
const MOST_EDGES: usize = 400;

/// Places that were cut out and closed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Excised {
    /// Pairs of triangles that met.
    pub(crate) pairs: u64,
    /// Holes that could not be filled as they were.
    pub(crate) holes: u64,
    /// Triangles that were cut out.
    pub(crate) triangles: u64,
}

impl Excised {
    /// Adds a later look.
    pub(crate) fn add(&mut self, later: Excised) {
        self.pairs += later.pairs;
        self.holes += later.holes;
        self.triangles += later.triangles;
    }
}

/// Volume between what all cuts of a run take out and what closes it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CutVolume {
    most: f64,
    /// With its sign, where both lie near each other.
    near: f64,
    /// Without, where they lie far apart.
    far: f64,
}

impl CutVolume {
    /// None so far of a surface.
    pub(crate) fn of(surface: &Surface) -> CutVolume {
        let around = bounds(surface);
        let all = surface.triangles.iter().filter(|t| t[0] != GONE);
        let places = all.map(|t| t.map(|v| rims::place(surface, v)));
        let volume = volume(places, around.middle()).abs();
        let most = (MOST_VOLUME[0] * volume).max(MOST_VOLUME[1] * around.diagonal().powi(3));
        CutVolume { most, near: 0.0, far: 0.0 }
    }

    /// Adds that of a cut, unless it would be too much.
    fn takes(&mut self, between: f64, is_near: bool) -> bool {
        let (near, far) = match is_near {
            true => (self.near + between, self.far),
            false => (self.near, self.far + between.abs()),
        };
        let is_little = near.abs() <= self.most && far <= self.most;
        if is_little {
            (self.near, self.far) = (near, far);
        }
        is_little
    }
}

/// Cuts out pairs of triangles that meet and the surroundings of holes of at most this size, where what is left can be closed.
pub(crate) fn excise(
    state: &mut MeshState,
    crossings: &mut Crossings,
    (size, volume): (f64, &mut CutVolume),
    simd: Simd,
) -> Excised {
    let mut excised = Excised::default();
    let mut work = Work::new(state, crossings, (size, volume), simd);
    let mut n_left = 0;
    let (mut from, n) = (0, work.state.surface.triangles.len() as u32);
    while let Some(pair) = work.crossings.next_pair(&work.state.surface, from, simd)
        && pair[0] < n
    {
        let cut = work.cut_around(&pair);
        excised.pairs += u64::from(cut == Cut::Closed);
        n_left += work.weight(cut);
        if n_left >= MOST_LEFT {
            break;
        }
        from = pair[0] + 1;
    }
    n_left = 0;
    work.is_hole = true;
    let is_seam =
        |state: &MeshState, v: u32| state.wedges.as_ref().is_some_and(|wedges| wedges.is_seam(v));
    let (rims, _) = rims::find(work.state, |v| is_seam(work.state, v));
    for rim in rims.into_iter().filter(|rim| rim.size <= size && rim.ring.len() <= MOST_EDGES) {
        let surface = &work.state.surface;
        let is_open = |&v: &u32| surface.rings[v as usize].class == Some(Class::Boundary);
        // One before may have taken it along.
        if rim.ring.iter().all(is_open) && n_left < MOST_LEFT {
            let around: BTreeSet<u32> =
                rim.ring.iter().flat_map(|&v| surface.ring(v).iter().copied()).collect();
            let around: Vec<u32> = around.into_iter().collect();
            let cut = work.cut_around(&around);
            excised.holes += u64::from(cut == Cut::Closed);
            n_left += work.weight(cut);
        }
    }
    excised.triangles = work.n_cut;
    excised
}

/// Cuts out vertices that lie in the place of others or have several fans, each with the triangles around it; returns how many
/// triangles went.
pub(crate) fn cut_corners(
    state: &mut MeshState,
    crossings: &mut Crossings,
    (corners, volume): (&[u32], &mut CutVolume),
    simd: Simd,
) -> u64 {
    let mut work = Work::new(state, crossings, (f64::INFINITY, volume), simd);
    for &v in corners.iter().take(MOST_LEFT as usize) {
        let ring = work.state.surface.ring(v).to_vec();
        if !ring.is_empty() {
            work.cut_around(&ring);
        }
    }
    work.n_cut
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Cut {
    Closed,
    /// A loop has no filling that meets nothing.
    Open,
    /// The filling lies far from the part that was cut out.
    Far,
}

struct Work<'a> {
    state: &'a mut MeshState,
    crossings: &'a mut Crossings,
    size: f64,
    simd: Simd,
    /// Of the surface.
    extent: f64,
    volume: &'a mut CutVolume,
    /// A filling of a hole lies where nothing was.
    is_hole: bool,
    n_cut: u64,
    /// Fillings that were tried at the place.
    attempts: u64,
}

/// The surface around a cut before it was made.
struct Before {
    triangles: Vec<(u32, [u32; 3])>,
    rings: Vec<(u32, Vec<u32>)>,
    places: Vec<(u32, Vec3)>,
    n_triangles: u32,
    n_alive: u64,
}

impl<'a> Work<'a> {
    fn new(
        state: &'a mut MeshState,
        crossings: &'a mut Crossings,
        (size, volume): (f64, &'a mut CutVolume),
        simd: Simd,
    ) -> Self {
        let extent = bounds(&state.surface).diagonal();
        Work { state, crossings, size, simd, extent, volume, is_hole: false, n_cut: 0, attempts: 0 }
    }

    /// Of a place, towards [`MOST_LEFT`]: bodies that cross have many such places.
    fn weight(&self, cut: Cut) -> u64 {
        match cut {
            Cut::Closed => 0,
            Cut::Open => (self.attempts / FILLINGS).max(1),
            Cut::Far => 20,
        }
    }

    /// Cuts out triangles and rings around them until what is left can be closed.
    fn cut_around(&mut self, seeds: &[u32]) -> Cut {
        self.attempts = 0;
        // Rings of hubs hold triangles that are gone.
        let is_there = |surface: &Surface, t: u32| surface.triangles[t as usize][0] != GONE;
        let mut part: BTreeSet<u32> =
            seeds.iter().copied().filter(|&t| is_there(&self.state.surface, t)).collect();
        for _ in 0..MOST_RINGS {
            self.crossings.take_met();
            self.round_off(&mut part);
            let cut = self.cut(&part);
            if cut != Cut::Open {
                return cut;
            }
            // What a filling met goes as well.
            let surface = &self.state.surface;
            part.extend(self.crossings.take_met().filter(|&t| is_there(surface, t)));
            let corners: BTreeSet<u32> =
                part.iter().flat_map(|&t| surface.triangles[t as usize]).collect();
            let rings = corners.iter().flat_map(|&v| surface.ring(v).iter().copied());
            part.extend(rings.filter(|&t| is_there(surface, t)));
            let [low, high] = MOST_TRIANGLES;
            if part.len() as u64 > (surface.n_alive / 100).clamp(low, high) {
                return Cut::Open;
            }
        }
        self.cut(&part)
    }

    /// Takes in what is left around vertices where it would hang together in a corner alone: a loop that comes by twice has no filling.
    fn round_off(&self, part: &mut BTreeSet<u32>) {
        let surface = &self.state.surface;
        let mut corners: Vec<u32> =
            part.iter().flat_map(|&t| surface.triangles[t as usize]).collect();
        while let Some(v) = corners.pop().filter(|_| part.len() as u64 <= MOST_TRIANGLES[1]) {
            if surface.rings[v as usize].len > MAX_VALENCE {
                continue;
            }
            let left = || surface.ring(v).iter().filter(|t| !part.contains(t));
            let around = || left().map(|&t| others(surface.triangles[t as usize], v));
            let n_fans = around().filter(|&(b, _)| around().all(|(_, c)| b != c)).count();
            if n_fans > 1 {
                let left: Vec<u32> = left().copied().collect();
                corners.extend(left.iter().flat_map(|&t| surface.triangles[t as usize]));
                part.extend(left);
            }
        }
    }

    /// Cuts out triangles and closes the loops that are left; nothing is changed if one cannot be, or only by a filling far away.
    fn cut(&mut self, part: &BTreeSet<u32>) -> Cut {
        let surface = &mut self.state.surface;
        let corners: BTreeSet<u32> =
            part.iter().flat_map(|&t| surface.triangles[t as usize]).collect();
        let is_free = |&v: &u32| {
            let ring = &surface.rings[v as usize];
            let is_seam = self.state.wedges.as_ref().is_some_and(|wedges| wedges.is_seam(v));
            ring.class != Some(Class::Locked) && ring.len <= MAX_VALENCE && !is_seam
        };
        if !corners.iter().all(is_free) {
            return Cut::Open;
        }
        let mut before = Before {
            triangles: part.iter().map(|&t| (t, surface.triangles[t as usize])).collect(),
            rings: corners.iter().map(|&v| (v, surface.ring(v).to_vec())).collect(),
            places: corners.iter().map(|&v| (v, rims::place(surface, v))).collect(),
            n_triangles: surface.triangles.len() as u32,
            n_alive: surface.n_alive,
        };
        for &t in part {
            surface.triangles[t as usize][0] = GONE;
        }
        surface.n_alive -= part.len() as u64;
        for (v, ring) in &before.rings {
            let left: Vec<u32> = ring.iter().copied().filter(|t| !part.contains(t)).collect();
            surface.set_ring(*v, &left);
        }
        let gone: Vec<u32> = part.iter().copied().collect();
        self.crossings.moved(surface, &gone);
        let rims = loops(surface, &corners);
        let others = rims.iter().flatten().flat_map(|rim| &rim.ring);
        let others: BTreeSet<u32> = others.copied().filter(|v| !corners.contains(v)).collect();
        before.rings.extend(others.iter().map(|&v| (v, surface.ring(v).to_vec())));
        before.places.extend(others.iter().map(|&v| (v, rims::place(surface, v))));
        let is_closed = rims.is_some_and(|rims| self.close(rims));
        let is_like = is_closed && self.is_like(&before);
        if !is_like {
            self.take_back(&before);
            return if is_closed { Cut::Far } else { Cut::Open };
        }
        self.n_cut += part.len() as u64;
        let mut touched: Vec<u32> = before.rings.into_iter().map(|(v, _)| v).collect();
        touched.retain(|&v| self.state.surface.rings[v as usize].len > 0);
        if let Some(wedges) = &mut self.state.wedges {
            wedges.look_at(&mut self.state.surface, &touched);
        }
        recompute_vertices(self.state, &mut touched, self.simd);
        Cut::Closed
    }

    /// Returns whether what was cut out and what closes it are like each other: near, at corners and middles of their triangles, and
    /// with little volume between all of it, or with next to none.
    fn is_like(&mut self, before: &Before) -> bool {
        let surface = &self.state.surface;
        let places: BTreeMap<u32, Vec3> = before.places.iter().copied().collect();
        let old: Vec<[Vec3; 3]> =
            before.triangles.iter().map(|(_, corners)| corners.map(|v| places[&v])).collect();
        let added = &surface.triangles[before.n_triangles as usize..];
        let new: Vec<[Vec3; 3]> = added
            .iter()
            .filter(|t| t[0] != GONE)
            .map(|t| t.map(|v| rims::place(surface, v)))
            .collect();
        let most = MOST_LOST[usize::from(self.is_hole)] * self.extent;
        let near = |from: &[[Vec3; 3]], to: &[[Vec3; 3]]| {
            let is_near = |p: Vec3| to.iter().any(|&t| triangle_distance_sq(p, t) <= most * most);
            from.iter().all(|&[a, b, c]| {
                let middle = scale(add(a, add(b, c)), 1.0 / 3.0);
                [a, b, c, middle].into_iter().all(is_near)
            })
        };
        let Some(&[origin, ..]) = old.first() else { return true };
        if new.is_empty() {
            return old.iter().flatten().all(|&p| length_sq(sub(p, origin)) <= most * most);
        }
        let between = volume(old.iter().copied(), origin) - volume(new.iter().copied(), origin);
        let is_near = near(&old, &new) && (self.is_hole || near(&new, &old));
        // What fills a hole has nothing to be compared with.
        (is_near && self.is_hole) || self.volume.takes(between, is_near)
    }

    /// Fills loops; false if one of them cannot be.
    fn close(&mut self, mut rims: Vec<Rim>) -> bool {
        if rims.iter().any(|rim| rim.size > self.size) {
            return false;
        }
        rims.sort_by(|a, b| b.area().total_cmp(&a.area()).then(a.ring.cmp(&b.ring)));
        let parent = parents(&self.state.surface, &rims);
        let mut filled = FilledHoles::default();
        let is_closed = (0..rims.len()).filter(|&i| parent[i].is_none()).all(|i| {
            let inner: Vec<&Rim> =
                (i + 1..rims.len()).filter(|&k| parent[k] == Some(i)).map(|k| &rims[k]).collect();
            let most = MOST_MOVED * self.extent;
            fill(self.state, self.crossings, (&rims[i], &inner), most, &mut filled)
        });
        self.attempts += filled.attempts;
        is_closed
    }

    /// Puts everything back to where it was.
    fn take_back(&mut self, before: &Before) {
        let surface = &mut self.state.surface;
        let added: Vec<u32> = (before.n_triangles..surface.triangles.len() as u32).collect();
        for &t in &added {
            surface.triangles[t as usize][0] = GONE;
        }
        for &(t, corners) in &before.triangles {
            surface.triangles[t as usize] = corners;
        }
        for (v, ring) in &before.rings {
            surface.set_ring(*v, ring);
        }
        for &(v, place) in &before.places {
            surface.vertices[v as usize].position = place;
        }
        surface.n_alive = before.n_alive;
        let mut back: Vec<u32> = before.triangles.iter().map(|&(t, _)| t).chain(added).collect();
        back.extend(before.rings.iter().flat_map(|(_, ring)| ring));
        self.crossings.moved(surface, &back);
    }
}

/// The signed volume between triangles and a point.
fn volume(triangles: impl Iterator<Item = [Vec3; 3]>, from: Vec3) -> f64 {
    let of = |t: [Vec3; 3]| {
        let [a, b, c] = t.map(|p| sub(p, from));
        dot(a, cross(b, c)) / 6.0
    };
    triangles.map(of).sum()
}

/// The loops through vertices that are left of a cut; `None` where sheets only touch.
fn loops(surface: &Surface, corners: &BTreeSet<u32>) -> Option<Vec<Rim>> {
    // Against the sense of the triangle that is there.
    let next = |v: u32| {
        let around = || surface.ring(v).iter().map(|&t| others(surface.triangles[t as usize], v));
        let mut open = around().map(|(_, c)| c).filter(|&c| around().all(|(b, _)| b != c));
        let n_in = around().filter(|&(b, _)| around().all(|(_, c)| b != c)).count();
        let first = open.next();
        (n_in == 1 && open.next().is_none()).then_some(first).flatten()
    };
    let mut seen = BTreeSet::new();
    let mut rims = Vec::new();
    for &start in corners.iter().filter(|&&v| !surface.ring(v).is_empty()) {
        let mut ring = Vec::new();
        let mut at = start;
        while seen.insert(at) {
            ring.push(at);
            at = next(at)?;
            if ring.len() > MOST_EDGES {
                return None;
            }
        }
        match ring.first() {
            None => {}
            Some(&first) if first == at && ring.len() > 2 => rims.push(Rim::new(surface, ring)),
            Some(_) => return None,
        }
    }
    Some(rims)
}
