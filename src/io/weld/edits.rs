//! Changes to faces while their corners get new numbers: those with vertices of other parts on their edges are split, those
//! that several parts hold stay once.

use super::overlaps::Overlap;
use super::splits::{Hit, Hits};
use crate::duplicates::{DuplicateFinder, Duplicates};
use crate::open_options::StageOptions;
use crate::ply::raw::{RawFile, Spool};
use crate::ply::{FaceSchema, MeshSource};
use crate::restaged::{FewRows, Numbers, RowLayout, corner, face_rows_with};
use stonecut_system::error::Result;
use stonecut_system::units::show_count;

/// Changes to faces.
pub(super) struct Edits {
    layout: RowLayout,
    splits: Option<Hits>,
    repeated: Duplicates,
    n_split: u64,
}

/// A corner of a face that is split.
#[derive(Clone, Copy)]
struct Corner {
    vertex: u32,
    texture: [f32; 2],
}

impl Edits {
    pub fn new(source: &MeshSource) -> Edits {
        let faces = FaceSchema {
            texture: source.has_corner_texture(),
            properties: source.face_properties(),
        };
        let layout = RowLayout::of(&faces);
        Edits { layout, splits: None, repeated: Duplicates::default(), n_split: 0 }
    }

    pub fn split(&mut self, hits: Hits) {
        self.splits = Some(hits).filter(|hits| hits.len() > 0);
    }

    /// Finds triangles that are there more than once, among those all of whose vertices several became.
    pub fn drop_repeated(
        &mut self,
        source: &MeshSource,
        (numbers, shared): (&RawFile, &[u64]),
        options: &StageOptions,
    ) -> Result<()> {
        let memory_bytes = (options.memory_bytes / 3) as usize;
        let finder = || DuplicateFinder::new(&options.temp_dir, memory_bytes);
        let (mut found, mut numbers) = (finder(), Numbers::new(numbers));
        let is_shared = |v: u64| {
            let word = shared.get((v / 64) as usize).copied().unwrap_or(0);
            shared.is_empty() || word >> (v % 64) & 1 == 1
        };
        face_rows_with(source, None, options, |first, rows, _| {
            if first == 0 {
                found = finder();
            }
            for (place, row) in (first..).zip(rows.each()).filter(|(_, row)| row[0] == 3) {
                let mut triangle = [0, 1, 2].map(|i| u64::from(corner(row, i)));
                if triangle.iter().all(|v| is_shared(*v)) {
                    for v in &mut triangle {
                        *v = u64::from(numbers.get(*v)?);
                    }
                    found.push_at(place, triangle)?;
                }
            }
            Ok(0)
        })?;
        self.repeated = found.finish()?;
        Ok(())
    }

    /// Writes what becomes of rows; they come in order, the first ones perhaps a second time.
    pub fn put(&mut self, first: u64, rows: FewRows, out: &mut Spool) -> Result<u64> {
        if first == 0 {
            self.n_split = 0;
            self.splits.iter_mut().try_for_each(Hits::restart)?;
        }
        // Rows between those that change are written at once.
        let (mut n, mut at, row_bytes) = (rows.n, 0, rows.row_bytes());
        for (i, row) in rows.each().enumerate() {
            let place = first + i as u64;
            let next = self.splits.as_ref().and_then(|hits| hits.next());
            if self.repeated.contains(place) || next.is_some_and(|record| record[0] <= place) {
                out.write(&rows.bytes[at..i * row_bytes])?;
                at = (i + 1) * row_bytes;
                n = n - 1 + self.put_row(place, row, out)?;
            }
        }
        out.write(&rows.bytes[at..])?;
        Ok(n)
    }

    fn put_row(&mut self, place: u64, row: &[u8], out: &mut Spool) -> Result<u64> {
        if self.repeated.contains(place) {
            return Ok(0);
        }
        let mut own = Vec::new();
        if let Some(hits) = &mut self.splits {
            while let Some(record) = hits.next().filter(|record| record[0] <= place) {
                if record[0] == place {
                    own.push(Hit::of(record));
                }
                hits.pass()?;
            }
        }
        if own.is_empty() {
            out.write(row)?;
            return Ok(1);
        }
        self.n_split += 1;
        self.put_split(row, &own, out)
    }

    fn put_split(&self, row: &[u8], hits: &[Hit], out: &mut Spool) -> Result<u64> {
        let n = usize::from(row[0]);
        let [corners_end, texture_end, _] = self.layout.ends(row[0]);
        let corners: Vec<Corner> = (0..n)
            .map(|i| {
                let at = corners_end + 1 + 8 * i;
                let float = |at: usize| {
                    let bytes = row.get(at..at + 4).and_then(|bytes| bytes.try_into().ok());
                    f32::from_le_bytes(bytes.unwrap_or_default())
                };
                let has_texture = self.layout.has_texture;
                let texture = if has_texture { [float(at), float(at + 4)] } else { [0.0; 2] };
                Corner { vertex: corner(row, i), texture }
            })
            .collect();
        // Behind each corner those that lie on the way to the next.
        let mut between = vec![Vec::new(); n];
        for (i, list) in between.iter_mut().enumerate() {
            let (a, b) = (corners[i], corners[(i + 1) % n]);
            let mut own: Vec<(f64, u32)> = hits
                .iter()
                .filter(|hit| corners.iter().all(|corner| corner.vertex != hit.vertex))
                .filter_map(|hit| match hit.ends {
                    [p, q] if (p, q) == (a.vertex, b.vertex) => Some((hit.share, hit.vertex)),
                    [p, q] if (q, p) == (a.vertex, b.vertex) => Some((1.0 - hit.share, hit.vertex)),
                    _ => None,
                })
                .collect();
            own.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
            for (share, vertex) in own {
                let mix = |k: usize| {
                    let (from, to) = (f64::from(a.texture[k]), f64::from(b.texture[k]));
                    (from + share * (to - from)) as f32
                };
                if list.iter().all(|known: &Corner| known.vertex != vertex) {
                    list.push(Corner { vertex, texture: [mix(0), mix(1)] });
                }
            }
        }
        let mut faces = Vec::new();
        match (corners.as_slice(), between.as_slice()) {
            (&[a, b, c], [ab, bc, ca]) => cut([a, b, c], [ab, bc, ca], &mut faces),
            _ => {
                let all = corners.iter().zip(&between);
                let face: Vec<Corner> = all
                    .flat_map(|(a, list)| [*a].into_iter().chain(list.iter().copied()))
                    .collect();
                faces.push(if face.len() > 127 { corners } else { face });
            }
        }
        let mut bytes = Vec::new();
        for face in &faces {
            bytes.push(face.len() as u8);
            face.iter().for_each(|corner| bytes.extend_from_slice(&corner.vertex.to_le_bytes()));
            if self.layout.has_texture {
                bytes.push(2 * face.len() as u8);
                let values = face.iter().flat_map(|corner| corner.texture);
                values.for_each(|x| bytes.extend_from_slice(&x.to_le_bytes()));
            }
            bytes.extend_from_slice(&row[texture_end..]);
        }
        out.write(&bytes)?;
        Ok(faces.len() as u64)
    }

    /// Lines on what was done, and on what was left.
    pub fn notes(&self, overlap: Overlap) -> Vec<String> {
        let mut lines = Vec::new();
        if self.n_split > 0 {
            let n = show_count(self.n_split);
            lines.push(format!(
                "{n} triangles were split where vertices of another file lie on their edges"
            ));
        }
        if self.repeated.count() > 0 {
            let n = show_count(self.repeated.count());
            lines.push(format!("files overlap: {n} triangles that several hold were taken once"));
        }
        if let Overlap::Other { n_inside, n_border } = overlap {
            let left = n_inside.saturating_sub(self.n_split);
            if left as f64 >= Overlap::WORTH_A_LINE * n_border as f64 {
                let share = 100.0 * left as f64 / n_border as f64;
                lines.push(format!(
                    "files may overlap with different triangles or leave gaps: {share:.0} % of the vertices on their borders lie in the \
                     boxes of others and on none of their edges; give --weld the width of the gaps; surfaces that overlap stay double, so \
                     cut the files at a common border"
                ));
            }
        }
        lines
    }
}

/// Cuts a triangle at the corners that lie between its corners.
fn cut([a, b, c]: [Corner; 3], [ab, bc, ca]: [&Vec<Corner>; 3], out: &mut Vec<Vec<Corner>>) {
    let none = Vec::new();
    if ab.is_empty() {
        if bc.is_empty() && ca.is_empty() {
            out.push(vec![a, b, c]);
        } else {
            cut([b, c, a], [bc, ca, ab], out);
        }
        return;
    }
    let chain: Vec<Corner> = [a].into_iter().chain(ab.iter().copied()).chain([b]).collect();
    for (i, pair) in chain.windows(2).enumerate() {
        let bc = if i + 2 == chain.len() { bc } else { &none };
        let ca = if i == 0 { ca } else { &none };
        cut([pair[0], pair[1], c], [&none, bc, ca], out);
    }
}
