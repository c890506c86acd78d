//! Triangles between the posts of a range grid.
//!
//! Four neighbouring posts are two triangles, split along the shorter diagonal; three are one. Where one surface ends before
//! another one, edges between them are long: a triangle with an edge of more than four times the spacing of the posts
//! around it is left out (Turk and Levoy 1994, "Tessellating range images").

use super::header::{Element, Encoding, Kind};
use super::layout::{explain, with_scan};
use super::lookup::Lookup;
use super::range_grid::RangeGrid;
use super::raw::{RawFile, Spool};
use super::rows::out_of_range;
use super::scan::{Fault, Scan, Scanned};
use super::source::MeshSource;
use super::writer::OutputHeader;
use stonecut_mesh::vec3::{length_sq, sub};
use stonecut_system::error::Result;

/// Edges of the surface, in spacings, at most.
const LONGEST: f64 = 4.0;

/// Columns on either side whose edges tell the spacing.
const AROUND: usize = 8;

/// The vertex of a post that has none.
const NONE: u64 = u64::MAX;

/// A row of posts.
#[derive(Default)]
struct Row {
    vertices: Vec<u64>,
    /// Places of the vertices; not numbers where there are none.
    places: Vec<[f64; 3]>,
    /// Lengths of the edges to the next post; not numbers where there are none.
    along: Vec<f64>,
}

/// Counts of edges by their length, in eighths of an octave.
struct Lengths(Vec<u64>);

impl Lengths {
    fn new() -> Lengths {
        Lengths(vec![0; 8 * 2200])
    }

    fn add(&mut self, length: f64) {
        if length > 0.0 && length.is_finite() {
            self.0[(8.0 * (length.log2() + 1100.0)) as usize] += 1;
        }
    }

    fn median(&self) -> Option<f64> {
        let mut half = self.0.iter().sum::<u64>().checked_sub(1)? / 2;
        for (k, &n) in self.0.iter().enumerate() {
            match half.checked_sub(n) {
                Some(left) => half = left,
                None => return Some(((k as f64 + 0.5) / 8.0 - 1100.0).exp2()),
            }
        }
        None
    }
}

impl MeshSource {
    /// The grid of posts of a file without faces.
    pub fn range_grid(&self) -> Option<RangeGrid> {
        self.layout.grid
    }

    /// Writes the same vertices with triangles between the posts as a PLY to `out`; gives back how many posts name no vertex,
    /// which only `skip_bad` allows. Memory: some 100 bytes for each column. `faces`: an empty spool.
    pub fn mesh_of_grid(
        &self,
        grid: RangeGrid,
        mut faces: Spool,
        mut out: Spool,
    ) -> Result<(RawFile, u64)> {
        let down_by_along = self.down_by_along(grid)?;
        let header = OutputHeader::new(self.schema().clone(), self.n_vertices(), 0);
        let index = header.index_type()?;
        let (mut n_faces, mut bytes) = (0u64, Vec::new());
        let n_bad = self.each_pair_of_rows(grid, |above, below| {
            triangles(above, below, down_by_along, |corners| {
                n_faces += 1;
                bytes.push(3);
                // Indices of 4 bytes, signed or not.
                corners.iter().for_each(|&v| bytes.extend_from_slice(&(v as u32).to_le_bytes()));
            });
            let written = faces.write(&bytes);
            bytes.clear();
            written
        })?;
        let header = OutputHeader {
            n_faces,
            comments: self.comments().to_vec(),
            obj_infos: self.obj_infos().to_vec(),
            ..header
        };
        out.write(header.text_signed(Encoding::BinaryLittleEndian, index, None).as_bytes())?;
        self.each_vertex_block(|block| out.write(&block.records))?;
        out.append_file(&faces.finish(self.path())?)?;
        Ok((out.finish(self.path())?, n_bad))
    }

    /// The usual length of an edge from row to row over that of one along a row.
    fn down_by_along(&self, grid: RangeGrid) -> Result<f64> {
        let (mut along, mut down) = (Lengths::new(), Lengths::new());
        self.each_pair_of_rows(grid, |above, below| {
            below.along.iter().for_each(|&length| along.add(length));
            for (&p, &q) in above.places.iter().zip(&below.places) {
                down.add(distance(p, q));
            }
            Ok(())
        })?;
        Ok(match (along.median(), down.median()) {
            (Some(along), Some(down)) => down / along,
            _ => 1.0,
        })
    }

    /// Calls `each` with every two rows that follow each other; gives back how many posts name no vertex.
    fn each_pair_of_rows(
        &self,
        grid: RangeGrid,
        mut each: impl FnMut(&Row, &Row) -> Result<()>,
    ) -> Result<u64> {
        let element = &self.header.elements[grid.element];
        let mut lookup = self.lookup()?;
        let (mut above, mut below, mut n_bad) = (Row::default(), Row::default(), 0);
        // The file ends within the grid, and what is there is wanted.
        let mut is_cut_off = false;
        with_scan!(&self.file, self.header.encoding, grid.mark, |scan| {
            for row in 0..grid.n_rows {
                below.vertices.clear();
                for column in 0..grid.n_columns {
                    let number = row * grid.n_columns + column;
                    let found = if is_cut_off { Ok(NONE) } else { post(&mut scan, element) };
                    let vertex = match found {
                        Ok(NONE) => NONE,
                        Ok(v) if v < self.n_vertices() && !self.bad_vertices.contains(v) => v,
                        Ok(_) if self.options.skip_bad => {
                            n_bad += 1;
                            NONE
                        }
                        Err(Fault::End) if self.options.skip_bad => {
                            is_cut_off = true;
                            n_bad += element.count - number;
                            NONE
                        }
                        found => {
                            let range = || Fault::Text(out_of_range(self.n_vertices()));
                            let fault = found.err().unwrap_or_else(range);
                            return Err(explain(&self.file, element, number, scan.last(), fault));
                        }
                    };
                    below.vertices.push(vertex);
                }
                below.find_places(&mut lookup)?;
                if row > 0 {
                    each(&above, &below)?;
                }
                std::mem::swap(&mut above, &mut below);
            }
            Ok(n_bad)
        })
    }
}

/// Reads a row of the element: the vertex of a post.
fn post<S: Scan>(scan: &mut S, element: &Element) -> Scanned<u64> {
    let list = element.index_list();
    let mut vertex = NONE;
    for (k, property) in element.properties.iter().enumerate() {
        match property.kind {
            Kind::List { count, item } if Some(k) == list => match scan.count(count)? {
                0 => {}
                // A number that no vertex has must not pass for none.
                1 => vertex = scan.index(item)?.min(NONE - 1),
                n => return Err(Fault::Text(format!("a post has {n} vertices (1 at most)"))),
            },
            _ => scan.skip_property(property)?,
        }
    }
    Ok(vertex)
}

impl Row {
    fn find_places(&mut self, lookup: &mut Lookup) -> Result<()> {
        self.places.clear();
        for &vertex in &self.vertices {
            let place = if vertex == NONE { [f64::NAN; 3] } else { lookup.position(vertex)? };
            self.places.push(place);
        }
        self.along.clear();
        self.along.extend(self.places.windows(2).map(|pair| distance(pair[0], pair[1])));
        Ok(())
    }
}

fn distance(p: [f64; 3], q: [f64; 3]) -> f64 {
    length_sq(sub(p, q)).sqrt()
}

/// Calls `emit` with the triangles between two rows, counter-clockwise where columns go to the right and rows up.
fn triangles(above: &Row, below: &Row, down_by_along: f64, mut emit: impl FnMut([u64; 3])) {
    let down: Vec<f64> =
        above.places.iter().zip(&below.places).map(|(&p, &q)| distance(p, q)).collect();
    let mut lengths = Vec::with_capacity(6 * AROUND + 8);
    for c in 0..down.len().saturating_sub(1) {
        // The four posts, around the square, and the lengths of its sides and diagonals.
        let corners = [(above, c), (above, c + 1), (below, c + 1), (below, c)];
        let vertices = corners.map(|(row, c)| row.vertices[c]);
        if vertices.iter().filter(|&&v| v == NONE).count() > 1 {
            continue;
        }
        let spacing = spacing_around(c, [above, below], (&down, down_by_along), &mut lengths);
        let places = corners.map(|(row, c)| row.places[c]);
        let (along, across) = (LONGEST * spacing, LONGEST * spacing * down_by_along);
        let is_short = [
            above.along[c] <= along,
            down[c + 1] <= across,
            below.along[c] <= along,
            down[c] <= across,
        ];
        let diagonals = [distance(places[0], places[2]), distance(places[1], places[3])];
        let longest = along.hypot(across);
        let mut corner = |k: usize| {
            // The triangle without the post opposite of `k`: its sides before and behind `k`.
            let (before, behind) = ((k + 3) % 4, (k + 1) % 4);
            let is_whole = [before, k, behind].iter().all(|&i| vertices[i] != NONE);
            if is_whole && is_short[before] && is_short[k] && diagonals[(k + 1) % 2] <= longest {
                emit([vertices[before], vertices[k], vertices[behind]]);
            }
        };
        let missing = vertices.iter().position(|&v| v == NONE);
        match missing {
            Some(k) => corner((k + 2) % 4),
            None if diagonals[0] <= diagonals[1] => [1, 3].into_iter().for_each(&mut corner),
            None => [0, 2].into_iter().for_each(&mut corner),
        }
    }
}

/// The usual length of an edge along a row around column `c`, from edges in both directions: where the surface ends before
/// another one, those of one direction are long.
fn spacing_around(
    c: usize,
    rows: [&Row; 2],
    (down, down_by_along): (&[f64], f64),
    lengths: &mut Vec<f64>,
) -> f64 {
    lengths.clear();
    let window = |n: usize| c.saturating_sub(AROUND)..(c + AROUND + 1).min(n);
    for row in rows {
        lengths.extend(&row.along[window(row.along.len())]);
    }
    lengths.extend(down[window(down.len())].iter().map(|length| length / down_by_along));
    lengths.retain(|length| length.is_finite());
    if lengths.is_empty() {
        return 0.0;
    }
    let half = lengths.len() / 2;
    *lengths.select_nth_unstable_by(half, f64::total_cmp).1
}
