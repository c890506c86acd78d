//! Shading normals of the original: those of its vertices, or computed from its faces.
//!
//! A computed normal is the sum of the normals of all faces around a place, weighted by their angles there (Thürmer and
//! Wüthrich 1998), whatever charts and cells they are in: vertices in one place count as one, and places in several cells
//! are summed over all of these once. Sums are of integers, so no order of faces shows.

use stonecut_mesh::Mesh;
use stonecut_mesh::vec3::place_bits;
use stonecut_mesh::vec3::{Vec3, add, cross, dot, length_sq, scale, sub, unit};
use stonecut_render::texture::{FrameCorner, Tangent, tangents, unpacked};

/// Steps of a sum: 2^-40, so a place may have four million faces.
const STEPS: f64 = (1u64 << 40) as f64;

/// Bytes of a vertex while normals of a cell are computed, and of its normal.
pub(super) const VERTEX_BYTES: u64 = 44;

/// Bytes of a place that several cells have, while it is summed.
pub(super) const BORDER_BYTES: u64 = 160;

type Key = [u64; 3];
type Sum = [i64; 3];

/// Normals of the original, as far as no cell knows them alone.
pub(super) enum Normals {
    /// None are wanted.
    None,
    /// Of the vertices themselves, in these channels.
    Own([usize; 3]),
    /// Computed.
    Computed(Border),
}

impl Normals {
    /// Bytes of a vertex of a cell for its normal.
    pub fn vertex_bytes(&self) -> u64 {
        match self {
            Normals::Computed(_) => VERTEX_BYTES,
            Normals::None | Normals::Own(_) => 0,
        }
    }

    /// Normals of the vertices of a cell where they are computed; empty otherwise.
    pub fn of_cell(&self, mesh: &Mesh, shared: &[bool]) -> Vec<[f32; 3]> {
        match self {
            Normals::Computed(border) => border.normals(mesh, shared),
            Normals::None | Normals::Own(_) => Vec::new(),
        }
    }

    /// The normal at a point of a triangle, of length 1 (zeros without any); `of_cell` are those of its cell.
    pub fn at(&self, mesh: &Mesh, of_cell: &[[f32; 3]], t: usize, weights: [f64; 3]) -> [f32; 3] {
        let corner = |v: u32| match self {
            Normals::None => [0.0; 3],
            Normals::Own(channels) => channels.map(|channel| mesh.channels_of(v)[channel]),
            Normals::Computed(_) => of_cell[v as usize],
        };
        if matches!(self, Normals::None) {
            return [0.0; 3];
        }
        let terms = mesh.triangles[t].iter().zip(weights);
        let sum = terms
            .fold([0.0; 3], |sum, (&v, weight)| add(sum, scale(corner(v).map(f64::from), weight)));
        // Vertices without a direction leave it to the face.
        let direction = unit(sum).filter(|n| n.iter().all(|x| x.is_finite()));
        let direction = direction.or_else(|| unit(face_normal(mesh, t)));
        direction.unwrap_or_default().map(|x| x as f32)
    }
}

/// Tangents of the corners of a cell's triangles, in Mikkelsen's frames; `of_cell` are the normals of its vertices where they
/// are computed, `texture` the channels of their coordinates.
///
/// At a border of the cell they lean on its own triangles alone.
pub(super) fn corner_tangents(
    mesh: &Mesh,
    normals: &Normals,
    of_cell: &[[f32; 3]],
    texture: [usize; 2],
) -> Vec<[Tangent; 3]> {
    let origin = mesh.positions.first().copied().unwrap_or_default();
    tangents(mesh.triangles.len(), |t, k| {
        let v = mesh.triangles[t][k];
        let weights = [0, 1, 2].map(|other| if other == k { 1.0 } else { 0.0 });
        FrameCorner {
            position: sub(mesh.positions[v as usize], origin).map(|x| x as f32),
            normal: normals.at(mesh, of_cell, t, weights),
            uv: texture.map(|channel| mesh.channels_of(v)[channel]),
        }
    })
}

/// The tangent at a point of a triangle, and its side.
pub(super) fn mean_tangent(corners: &[Tangent; 3], weights: [f64; 3]) -> [f32; 4] {
    let terms = corners.iter().zip(weights);
    let sum = terms.fold([0.0; 3], |sum, (&own, w)| add(sum, scale(unpacked(own).0, w)));
    let [x, y, z] = unit(sum).unwrap_or_default().map(|x| x as f32);
    [x, y, z, unpacked(corners[0]).1 as f32]
}

/// Normals of the places that several cells have.
#[derive(Default)]
pub(super) struct Border(Vec<(Key, [f32; 3])>);

impl Border {
    /// Puts together what `border_sums` found in all cells.
    pub fn of(mut sums: Vec<(Key, Sum)>) -> Border {
        sums.sort_unstable();
        let same = sums.chunk_by(|a, b| a.0 == b.0);
        let normal = |group: &[(Key, Sum)]| {
            let sum = group.iter().fold([0; 3], |sum: Sum, (_, part)| add_sums(sum, *part));
            (group[0].0, direction(sum))
        };
        Border(same.map(normal).collect())
    }

    pub fn bytes(&self) -> u64 {
        (self.0.len() * std::mem::size_of::<(Key, [f32; 3])>()) as u64
    }

    fn normals(&self, mesh: &Mesh, shared: &[bool]) -> Vec<[f32; 3]> {
        let places = Places::of(mesh);
        let sums = places.sums(mesh);
        let mut normals: Vec<[f32; 3]> = sums.into_iter().map(direction).collect();
        for (v, _) in shared.iter().enumerate().filter(|(_, shared)| **shared) {
            let key = place_bits(mesh.positions[v]);
            if let Ok(i) = self.0.binary_search_by_key(&key, |entry| entry.0) {
                normals[places.first[v] as usize] = self.0[i].1;
            }
        }
        for v in 0..normals.len() {
            normals[v] = normals[places.first[v] as usize];
        }
        normals
    }
}

/// Sums of a cell at the places that it shares with others.
pub(super) fn border_sums(mesh: &Mesh, shared: &[bool]) -> Vec<(Key, Sum)> {
    let places = Places::of(mesh);
    let sums = places.sums(mesh);
    let mut firsts: Vec<u32> =
        shared.iter().zip(&places.first).filter(|(shared, _)| **shared).map(|(_, v)| *v).collect();
    firsts.sort_unstable();
    firsts.dedup();
    let entry = |v: u32| (place_bits(mesh.positions[v as usize]), sums[v as usize]);
    firsts.into_iter().map(entry).collect()
}

/// Vertices in one place: for each the first of them.
struct Places {
    first: Vec<u32>,
}

impl Places {
    fn of(mesh: &Mesh) -> Places {
        let key = |v: u32| place_bits(mesh.positions[v as usize]);
        let mut order: Vec<u32> = (0..mesh.positions.len() as u32).collect();
        order.sort_unstable_by_key(|&v| (key(v), v));
        let mut first = vec![0; order.len()];
        for same in order.chunk_by(|&a, &b| key(a) == key(b)) {
            same.iter().for_each(|&v| first[v as usize] = same[0]);
        }
        Places { first }
    }

    /// Sums at the first vertex of each place.
    fn sums(&self, mesh: &Mesh) -> Vec<Sum> {
        let mut sums = vec![[0; 3]; self.first.len()];
        for (t, corners) in mesh.triangles.iter().enumerate() {
            let Some(normal) = unit(face_normal(mesh, t)) else { continue };
            let places = mesh.corners(t);
            for (k, &v) in corners.iter().enumerate() {
                let (a, b) = (places[(k + 1) % 3], places[(k + 2) % 3]);
                let angle = angle(sub(a, places[k]), sub(b, places[k]));
                let part = normal.map(|x| (STEPS * angle * x).round() as i64);
                let sum = &mut sums[self.first[v as usize] as usize];
                *sum = add_sums(*sum, part);
            }
        }
        sums
    }
}

fn add_sums(a: Sum, b: Sum) -> Sum {
    [0, 1, 2].map(|k| a[k].saturating_add(b[k]))
}

fn direction(sum: Sum) -> [f32; 3] {
    unit(sum.map(|x| x as f64)).unwrap_or_default().map(|x| x as f32)
}

fn face_normal(mesh: &Mesh, t: usize) -> Vec3 {
    stonecut_mesh::vec3::normal(mesh.corners(t))
}

fn angle(a: Vec3, b: Vec3) -> f64 {
    length_sq(cross(a, b)).sqrt().atan2(dot(a, b))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fan of faces over a cone, cut into two cells whose copies of the tip and of two rim vertices are shared.
    #[test]
    fn places_in_several_cells_have_the_normal_of_all_faces() {
        let n = 8;
        let rim = |i: usize| {
            let (sin, cos) = (i as f64 * std::f64::consts::TAU / n as f64).sin_cos();
            [cos, sin, 0.25 * cos]
        };
        let mut positions = vec![[0.0, 0.0, 1.0]];
        positions.extend((0..n).map(rim));
        let face = |i: usize| [0, 1 + i as u32, 1 + ((i + 1) % n) as u32];
        let whole = Mesh::new(positions.clone(), (0..n).map(face).collect());
        let alone = Border::default().normals(&whole, &[false; 9]);
        // Each cell has all vertices, some without faces; a seam doubles the tip in the second.
        let halves =
            [0..3, 3..n].map(|faces| Mesh::new(positions.clone(), faces.map(face).collect()));
        let [first, mut second] = halves;
        second.positions.push(positions[0]);
        second.triangles[2][0] = 9;
        let shared = |i: usize| [0, 1, 4].contains(&i);
        let marks: Vec<bool> = (0..10).map(shared).collect();
        let mut sums = border_sums(&second, &marks);
        sums.extend(border_sums(&first, &marks[..9]));
        let border = Border::of(sums);
        assert_eq!(border.0.len(), 3);
        let found = [border.normals(&first, &marks[..9]), border.normals(&second, &marks)];
        for v in [0, 1, 4] {
            assert_eq!([found[0][v], found[1][v]], [alone[v]; 2]);
        }
        assert_eq!((found[1][9], found[0][2], found[1][6]), (alone[0], alone[2], alone[6]));
    }
}
