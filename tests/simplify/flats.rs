//! What lies in a plane exactly stays there: designed parts come back with their corners, a sea at its height.

use crate::common::{check, count, expect, scratch, write_ply};
use std::collections::HashMap;
use std::path::Path;
use stonecut::mesh::property::Scalar;

type Place = [f64; 3];

/// A surface of unit squares, `n` by `n` squares of two triangles each, joined where they meet.
#[derive(Default)]
struct Squares {
    known: HashMap<[i64; 3], u32>,
    places: Vec<Place>,
    triangles: Vec<[u32; 3]>,
}

impl Squares {
    /// A parallelogram over `u` and `v`, seen from where they turn to the left.
    fn add(&mut self, origin: Place, (u, n): (Place, usize), (v, m): (Place, usize)) {
        let mut vertex = |i: usize, j: usize| {
            let (s, t) = (i as f64 / n as f64, j as f64 / m as f64);
            let place: Place = std::array::from_fn(|k| origin[k] + s * u[k] + t * v[k]);
            let key = place.map(|x| (x * 1e6).round() as i64);
            *self.known.entry(key).or_insert_with(|| {
                self.places.push(place);
                self.places.len() as u32 - 1
            })
        };
        for i in 0..n {
            for j in 0..m {
                let [a, b, c, d] =
                    [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
                self.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }

    fn write(&self, path: &Path, place: impl Fn(Place) -> Place) {
        let places: Vec<Place> = self.places.iter().map(|p| place(*p)).collect();
        write_ply(path, Scalar::F32, &places, &self.triangles);
    }
}

/// A box with one corner at the origin; `n` squares along each axis.
fn cuboid(size: Place, n: [usize; 3]) -> Squares {
    let mut out = Squares::default();
    let axis = |k: usize| -> (Place, usize) {
        (std::array::from_fn(|i| if i == k { size[k] } else { 0.0 }), n[k])
    };
    for k in 0..3 {
        let (u, v) = (axis((k + 1) % 3), axis((k + 2) % 3));
        out.add([0.0; 3], v, u);
        out.add(axis(k).0, u, v);
    }
    out
}

/// Stairs of `steps` steps of unit squares, `steps` wide, each square of `n` by `n`.
fn stairs(steps: usize, n: usize) -> Squares {
    let mut out = Squares::default();
    let s = steps as f64;
    let along = |k: usize, length: usize| -> (Place, usize) {
        (std::array::from_fn(|i| if i == k { length as f64 } else { 0.0 }), n * length)
    };
    for step in 0..steps {
        let (x, height) = (step as f64, steps - step);
        let z = height as f64;
        out.add([x, 0.0, z], along(0, 1), along(1, steps));
        out.add([x + 1.0, 0.0, z - 1.0], along(1, steps), along(2, 1));
        out.add([x, 0.0, 0.0], along(0, 1), along(2, height));
        out.add([x, s, 0.0], along(2, height), along(0, 1));
    }
    out.add([0.0; 3], along(1, steps), along(0, steps));
    out.add([0.0; 3], along(2, steps), along(1, steps));
    out
}

/// The vertices of an ASCII copy of a result.
fn vertices(folder: &Path, name: &str) -> Vec<Place> {
    expect(folder, &format!("convert {name} text.ply --format ascii --force"), 0);
    let text = std::fs::read_to_string(folder.join("text.ply")).unwrap();
    let n = count(&check(folder, name), "vertices") as usize;
    let rows = text.split_once("end_header\n").unwrap().1.lines().take(n);
    let place = |row: &str| -> Place {
        let numbers: Vec<f64> = row.split(' ').take(3).map(|x| x.parse().unwrap()).collect();
        numbers.try_into().unwrap()
    };
    rows.map(place).collect()
}

fn turn([x, y, z]: Place) -> Place {
    // Two turns of 3-4-5 triangles.
    let (x, y) = (0.6 * x - 0.8 * y, 0.8 * x + 0.6 * y);
    let (y, z) = (0.6 * y - 0.8 * z, 0.8 * y + 0.6 * z);
    [7.0 * x + 3.0, 7.0 * y - 1.0, 7.0 * z + 2.0]
}

fn turn_back([x, y, z]: Place) -> Place {
    let (x, y, z) = ((x - 3.0) / 7.0, (y + 1.0) / 7.0, (z - 2.0) / 7.0);
    let (y, z) = (0.6 * y + 0.8 * z, -0.8 * y + 0.6 * z);
    [0.6 * x + 0.8 * y, -0.8 * x + 0.6 * y, z]
}

#[test]
fn designed_parts_come_back_with_their_corners() {
    let at = &scratch();
    let thin = [10.0, 6.0, 0.05];
    let parts = [
        ("cube", cuboid([1.0; 3], [40; 3]), [1.0; 3], 12),
        ("thin", cuboid(thin, [100, 60, 4]), thin, 12),
        ("stairs", stairs(3, 14), [1.0; 3], 28),
    ];
    for (name, part, unit, n) in &parts {
        for is_turned in [false, true] {
            match is_turned {
                false => part.write(&at.join("in.ply"), |p| p),
                true => part.write(&at.join("in.ply"), turn),
            }
            for options in ["", "--cell-triangles 4k"] {
                let what = format!("{name}, turned: {is_turned}, {options}");
                let command = format!("simplify in.ply out.ply --triangles {n} {options} --force");
                expect(at, &command, 0);
                let found = vertices(at, "out.ply");
                assert_eq!(found.len(), n / 2 + 2, "{what}");
                let size = unit.iter().fold(0.0f64, |most, &x| most.max(x));
                for place in found {
                    let place = if is_turned { turn_back(place) } else { place };
                    for k in 0..3 {
                        let off = place[k] - (place[k] / unit[k]).round() * unit[k];
                        assert!(off.abs() <= 1e-6 * size, "{what}: {place:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_sea_stays_flat() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 200k --sea", 0);
    let flat_area = |name: &str| {
        let places = vertices(at, name);
        let text = std::fs::read_to_string(at.join("text.ply")).unwrap();
        let rows = text.split_once("end_header\n").unwrap().1.lines().skip(places.len());
        let mut area = 0.0;
        for row in rows {
            let corners: Vec<usize> = row.split(' ').map(|x| x.parse().unwrap()).collect();
            let [a, b, c] = [1, 2, 3].map(|k| places[corners[k]]);
            if [a, b, c].iter().all(|p| p[2] == 0.0) {
                let (ux, uy, vx, vy) = (b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]);
                area += 0.5 * (ux * vy - uy * vx).abs();
            }
        }
        area
    };
    let sea = flat_area("in.ply");
    assert!(sea > 1e7, "{sea}");
    for options in ["--ratio 10%", "--ratio 2%", "--ratio 5% --cell-triangles 10k"] {
        expect(at, &format!("simplify in.ply out.ply {options} --force"), 0);
        let left = flat_area("out.ply") / sea;
        assert!((0.99..1.05).contains(&left), "{options}: {left}");
    }
}
