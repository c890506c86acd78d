//! Decides for two triangles if they meet where they should not; exact for the coordinates as they are.
//!
//! All decisions are signs of determinants, by the adaptive predicates of Shewchuk 1997 (crate `robust`). Corners are
//! compared by place, never by index. Takes triangles whose corners are not on one line (`is_flat`).

use crate::vec3::Vec3;
use robust::{Coord, Coord3D, orient2d, orient3d};
use std::cmp::Ordering::{self, Equal, Greater, Less};

/// Corners of a triangle, in any order.
pub type Corners = [Vec3; 3];

/// Relation of two triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meeting {
    /// No common point but corners and edges that both have.
    None,
    /// A common point besides these.
    Crossing,
    /// A common area: both are in one plane.
    Overlap,
}

/// Side of the plane through a triangle on which `d` is.
fn side([a, b, c]: &Corners, d: &Vec3) -> Ordering {
    side_of(a, b, c, d)
}

fn side_of(a: &Vec3, b: &Vec3, c: &Vec3, d: &Vec3) -> Ordering {
    let place = |p: &Vec3| Coord3D { x: p[0], y: p[1], z: p[2] };
    sign(orient3d(place(a), place(b), place(c), place(d)))
}

fn sign(x: f64) -> Ordering {
    x.partial_cmp(&0.0).unwrap_or(Equal)
}

/// The two coordinates that are left when a plane is seen along an axis.
#[derive(Clone, Copy)]
struct View(usize, usize);

impl View {
    const ALL: [View; 3] = [View(0, 1), View(1, 2), View(2, 0)];

    /// A view in which a triangle has an area, and its sense there; `None` for corners on one line.
    fn of([a, b, c]: &Corners) -> Option<(View, Ordering)> {
        let turns = View::ALL.into_iter().map(|view| (view, view.turn(a, b, c)));
        turns.into_iter().find(|(_, turn)| *turn != Equal)
    }

    /// Sense of three points.
    fn turn(self, a: &Vec3, b: &Vec3, c: &Vec3) -> Ordering {
        let place = |p: &Vec3| Coord { x: p[self.0], y: p[self.1] };
        sign(orient2d(place(a), place(b), place(c)))
    }
}

/// Returns whether the corners of a triangle are on one line.
pub fn is_flat(t: &Corners) -> bool {
    View::of(t).is_none()
}

/// Decides how two triangles meet.
pub fn meet(a: &Corners, b: &Corners) -> Meeting {
    let mut shared = [(0, 0); 3];
    let mut n = 0;
    for (i, own) in a.iter().enumerate() {
        for (j, other) in b.iter().enumerate() {
            if own == other {
                shared[n.min(2)] = (i, j);
                n += 1;
            }
        }
    }
    match n {
        0 => apart(a, b),
        1 => at_corner(&from(a, shared[0].0), &from(b, shared[0].1)),
        // The corners beside the common edge: indices of a triangle add up to 3.
        2 => at_edge(
            a,
            &a[3 - shared[0].0 - shared[1].0],
            &b[3 - shared[0].1 - shared[1].1],
            [&a[shared[0].0], &a[shared[1].0]],
        ),
        _ => Meeting::Overlap,
    }
}

/// A triangle that begins at its corner `first`.
fn from(t: &Corners, first: usize) -> Corners {
    [t[first], t[(first + 1) % 3], t[(first + 2) % 3]]
}

/// Triangles with a common edge meet elsewhere only if one is folded onto the other. Seen along an axis they are then on
/// the same side of the edge, which hardly any neighbours are: the plane comes last.
fn at_edge(a: &Corners, own: &Vec3, other: &Vec3, [p, q]: [&Vec3; 2]) -> Meeting {
    let is_same_side = |(view, _): (View, Ordering)| view.turn(p, q, own) == view.turn(p, q, other);
    match View::of(a).is_some_and(is_same_side) && side(a, other) == Equal {
        true => Meeting::Overlap,
        false => Meeting::None,
    }
}

/// Both begin at their common corner. Their planes meet in a line through it, of which each triangle holds a segment
/// that begins there: they meet elsewhere if the edge opposite of one meets the other.
fn at_corner(a: &Corners, b: &Corners) -> Meeting {
    if is_parted_at_corner(a, b) {
        return Meeting::None;
    }
    let of_b = [side(a, &b[1]), side(a, &b[2])];
    if of_b == [Equal; 2] {
        return in_plane_at_corner(a, b);
    }
    if is_off(&of_b) {
        return Meeting::None;
    }
    let of_a = [side(b, &a[1]), side(b, &a[2])];
    if is_off(&of_a) {
        return Meeting::None;
    }
    let is_crossing =
        segment_meets([&b[1], &b[2]], of_b, a) || segment_meets([&a[1], &a[2]], of_a, b);
    if is_crossing { Meeting::Crossing } else { Meeting::None }
}

/// Returns whether a plane across an axis through the common corner parts the triangles, and one of them meets it there
/// only. True for half of all neighbours.
fn is_parted_at_corner(a: &Corners, b: &Corners) -> bool {
    (0..3).any(|k| {
        let p = a[0][k];
        let (a, b) = ([a[1][k], a[2][k]], [b[1][k], b[2][k]]);
        let above = |ends: [f64; 2]| ends[0] > p && ends[1] > p;
        let below = |ends: [f64; 2]| ends[0] < p && ends[1] < p;
        let reaches = |ends: [f64; 2]| (ends[0].min(ends[1]) >= p, ends[0].max(ends[1]) <= p);
        let (from_a, from_b) = (reaches(a), reaches(b));
        (above(a) && from_b.1)
            || (below(a) && from_b.0)
            || (above(b) && from_a.1)
            || (below(b) && from_a.0)
    })
}

/// Triangles without a common corner.
fn apart(a: &Corners, b: &Corners) -> Meeting {
    let of_b = [0, 1, 2].map(|k| side(a, &b[k]));
    if is_off(&of_b) {
        return Meeting::None;
    }
    if of_b == [Equal; 3] {
        return in_plane(a, b);
    }
    let of_a = [0, 1, 2].map(|k| side(b, &a[k]));
    if is_off(&of_a) {
        return Meeting::None;
    }
    let meets = |t: &Corners, sides: [Ordering; 3], other: &Corners| {
        let edges = [(0, 1), (1, 2), (2, 0)];
        edges.iter().any(|&(i, j)| segment_meets([&t[i], &t[j]], [sides[i], sides[j]], other))
    };
    if meets(b, of_b, a) || meets(a, of_a, b) { Meeting::Crossing } else { Meeting::None }
}

/// Returns whether all are strictly on one side.
fn is_off(sides: &[Ordering]) -> bool {
    sides.iter().all(|&s| s == Less) || sides.iter().all(|&s| s == Greater)
}

/// Returns whether a segment and a triangle have a common point; `sides` are those of its ends.
fn segment_meets([s, e]: [&Vec3; 2], sides: [Ordering; 2], t: &Corners) -> bool {
    if sides == [Equal; 2] {
        return segment_meets_in_plane([s, e], t);
    }
    if is_off(&sides) {
        return false;
    }
    // The line of the segment meets the plane in one point: it turns about all edges the same way.
    let turns = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| side_of(s, e, &t[i], &t[j]));
    turns.iter().all(|&turn| turn != Less) || turns.iter().all(|&turn| turn != Greater)
}

/// The same in the plane of the triangle: a line along an edge or along the segment parts the two, or they meet.
fn segment_meets_in_plane([s, e]: [&Vec3; 2], t: &Corners) -> bool {
    let Some((view, sense)) = View::of(t) else { return false };
    let outside = sense.reverse();
    let is_parted = |i: usize| {
        let turn = |p| view.turn(&t[i], &t[(i + 1) % 3], p);
        turn(s) == outside && turn(e) == outside
    };
    let off = [0, 1, 2].map(|k| view.turn(s, e, &t[k]));
    !(is_off(&off) || (0..3).any(is_parted))
}

/// Triangles in one plane.
fn in_plane(a: &Corners, b: &Corners) -> Meeting {
    let mut found = Meeting::Overlap;
    for (t, other) in [(a, b), (b, a)] {
        let Some((view, sense)) = View::of(t) else { return Meeting::None };
        for i in 0..3 {
            let turns = other.map(|p| view.turn(&t[i], &t[(i + 1) % 3], &p));
            if turns == [sense.reverse(); 3] {
                return Meeting::None;
            }
            if turns.iter().all(|&turn| turn != sense) {
                found = Meeting::Crossing;
            }
        }
    }
    found
}

/// Triangles in one plane that begin at their common corner.
fn in_plane_at_corner(a: &Corners, b: &Corners) -> Meeting {
    if in_plane(a, b) == Meeting::Overlap {
        return Meeting::Overlap;
    }
    // No common area: they meet elsewhere only along edges that leave the corner in the same direction.
    let Some((view, _)) = View::of(a) else { return Meeting::None };
    let is_along = |p: &Vec3, q: &Vec3| {
        view.turn(&a[0], p, q) == Equal
            && (0..3).all(|k| p[k].partial_cmp(&a[0][k]) == q[k].partial_cmp(&a[0][k]))
    };
    let mut ends = [(1, 1), (1, 2), (2, 1), (2, 2)].into_iter();
    match ends.any(|(i, j)| is_along(&a[i], &b[j])) {
        true => Meeting::Crossing,
        false => Meeting::None,
    }
}
