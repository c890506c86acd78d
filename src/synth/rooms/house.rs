//! A house of rooms as a list of panels: floors, ceilings, walls, furniture, columns, crumbs.
//!
//! A room is a function of its number. Panels that meet have their lattice points in the same places, so a
//! weld by position joins what the atlas keeps apart. Walls between rooms are two sheets, a hand's breadth apart.

use super::paint::Paint;
use crate::noise::{hash2, signed3};
use crate::surface::unit_vector;
use stonecut_mesh::scatter::unit;
use stonecut_mesh::vec3::cross;

/// Width, depth and height of a room in metres.
const ROOM: [f64; 3] = [6.0, 5.0, 3.0];
/// Space between the sheets of a wall.
const WALL: f64 = 0.08;
/// Area of all panels of a room, on average.
const ROOM_AREA: f64 = 172.0;
/// Triangles for each floating crumb.
const TRIANGLES_PER_CRUMB: u64 = 2500;

/// A rectangle of surface.
#[derive(Clone, Debug)]
pub(super) struct Panel {
    pub(super) origin: [f64; 3],
    /// Two sides; their cross product looks to where the camera was.
    pub(super) sides: [[f64; 3]; 2],
    /// Lengths of the sides in metres.
    pub(super) size: [f64; 2],
    /// Squares along each side.
    pub(super) squares: [usize; 2],
    pub(super) paint: Paint,
    /// Distinguishes panels of one paint.
    pub(super) tag: u64,
    /// Middle of the door along the first side.
    pub(super) door: Option<f64>,
    pub(super) is_crumb: bool,
}

/// All rooms.
pub(super) struct House {
    pub(super) n_rooms: u64,
    rooms_in_row: u64,
    n_crumbs: u64,
    /// Length of a triangle's short edges in metres.
    pub(super) edge: f64,
    seed: u64,
}

impl House {
    /// A house of about `n_triangles` times `scale`^3.
    pub(super) fn new(n_triangles: u64, scale: f64, seed: u64) -> Self {
        let n_rooms = (n_triangles / 400_000).max(6);
        let rooms_in_row = (n_rooms as f64).sqrt().ceil() as u64;
        // Two triangles a square, a tenth of it lost in holes and doors.
        let quads = n_triangles as f64 / 1.8 * (scale * scale * scale);
        let edge = (n_rooms as f64 * ROOM_AREA / quads).sqrt();
        let n_crumbs = (n_triangles / n_rooms / TRIANGLES_PER_CRUMB).max(2);
        House { n_rooms, rooms_in_row, n_crumbs, edge, seed }
    }

    /// Panels of a room; all rooms have equally many.
    pub(super) fn n_panels(&self) -> u64 {
        6 + 3 * 5 + 2 * 4 + self.n_crumbs
    }

    /// The panels of a room.
    pub(super) fn panels(&self, room: u64) -> Vec<Panel> {
        let key = hash2(room, self.seed ^ 0x526F_6F6D);
        let corner = [
            (room % self.rooms_in_row) as f64 * (ROOM[0] + WALL) + 1.0,
            (room / self.rooms_in_row) as f64 * (ROOM[1] + WALL) + 1.0,
            1.0,
        ];
        let mut panels = Vec::with_capacity(self.n_panels() as usize);
        let [w, d, h] = ROOM;
        let floor = if key & 1 == 0 { Paint::Boards } else { Paint::Tiles };
        let wall = |n: u64| if hash2(n, key) & 1 == 0 { Paint::Bricks } else { Paint::Gallery };
        // Rooms are entered through all four walls, doors face each other.
        let door = |turned: bool, length: f64| {
            let at = 0.35 * length;
            Some(if turned { length - at } else { at })
        };
        let mut inside = |from: [f64; 3], sides: [[f64; 3]; 2], size: [f64; 2], paint, door| {
            let tag = hash2(panels.len() as u64, key);
            let origin = [0, 1, 2].map(|n| corner[n] + from[n]);
            let squares = size.map(|s| ((s / self.edge + 0.5) as usize).max(1));
            panels.push(Panel { origin, sides, size, squares, paint, tag, door, is_crumb: false });
        };
        inside([0.0; 3], [X, Y], [w, d], floor, None);
        inside([0.0, 0.0, h], [Y, X], [d, w], Paint::Ceiling, None);
        inside([w, 0.0, 0.0], [BACK_X, Z], [w, h], wall(0), door(true, w));
        inside([0.0, d, 0.0], [X, Z], [w, h], wall(1), door(false, w));
        inside([0.0, 0.0, 0.0], [Y, Z], [d, h], wall(2), door(false, d));
        inside([w, d, 0.0], [BACK_Y, Z], [d, h], wall(3), door(true, d));
        for n in 0..5u64 {
            let [a, b, c] = signed3(hash2(100 + n, key)).map(|x| 0.5 + 0.5 * x);
            let is_column = n > 2;
            let size =
                if is_column { [0.4, 0.4, h] } else { [0.6 + a, 0.5 + 0.6 * b, 0.45 + 0.8 * c] };
            let x = 0.7 + 1.7 * (n % 3) as f64 + 0.3 * b;
            let y = if is_column { 3.6 } else { 0.6 + 1.1 * c };
            let (p, q) = ([x, y, 0.0], [x + size[0], y + size[1], size[2]]);
            let paint = if is_column {
                Paint::Bricks
            } else {
                [Paint::Cloth, Paint::Boards][(n & 1) as usize]
            };
            inside(p, [X, Z], [size[0], size[2]], paint, None);
            inside([q[0], q[1], 0.0], [BACK_X, Z], [size[0], size[2]], paint, None);
            inside([p[0], q[1], 0.0], [BACK_Y, Z], [size[1], size[2]], paint, None);
            inside([q[0], p[1], 0.0], [Y, Z], [size[1], size[2]], paint, None);
            if !is_column {
                inside([p[0], p[1], q[2]], [X, Y], [size[0], size[1]], paint, None);
            }
        }
        for n in 0..self.n_crumbs {
            panels.push(self.crumb(hash2(1000 + n, key), corner));
        }
        panels
    }

    /// A flake in the air.
    fn crumb(&self, key: u64, corner: [f64; 3]) -> Panel {
        let place = signed3(key).map(|x| 0.5 + 0.48 * x);
        let first = unit_vector(signed3(hash2(key, 1)));
        let second = unit_vector(cross(first, signed3(hash2(key, 2))));
        let squares = [1 + (hash2(key, 3) % 5) as usize, 1 + (hash2(key, 4) % 4) as usize];
        Panel {
            origin: [0, 1, 2].map(|n| corner[n] + place[n] * ROOM[n]),
            sides: [first, second],
            size: squares.map(|n| n as f64 * self.edge),
            squares,
            paint: if unit(key) < 0.5 { Paint::Ceiling } else { Paint::Cloth },
            tag: key,
            door: None,
            is_crumb: true,
        }
    }
}

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];
const BACK_X: [f64; 3] = [-1.0, 0.0, 0.0];
const BACK_Y: [f64; 3] = [0.0, -1.0, 0.0];
