//! Rows of OBJ files: numbers of vertices, corners of faces.

use crate::ply::rows::MAX_CORNERS;
use crate::text_lines::{not_a_number, parse_number, parse_whole};

/// A `v` line.
pub(super) struct Vertex {
    pub(super) position: [f64; 3],
    pub(super) colour: Option<[f64; 3]>,
    /// The number behind the colour.
    pub(super) opacity: Option<f64>,
    /// True if there are numbers that say something else: a weight, or of no known meaning.
    pub(super) has_more: bool,
}

impl Vertex {
    /// The same if the first of four numbers behind the coordinates is their weight, and the others are the colour.
    pub(super) fn weighted(self) -> Vertex {
        let colour = match (self.colour, self.opacity) {
            (Some([_, r, g]), Some(b)) => Some([r, g, b]),
            (colour, _) => colour,
        };
        Vertex { colour, opacity: None, ..self }
    }
}

/// With `skip_bad`, what is missing or not a number is NaN.
pub(super) fn vertex<'a>(
    mut words: impl Iterator<Item = &'a [u8]>,
    skip_bad: bool,
) -> Result<Vertex, String> {
    let mut values = [0.0; 7];
    let mut n = 0;
    for (place, word) in values.iter_mut().zip(words.by_ref()) {
        *place = match parse_number(word) {
            Some(value) => value,
            None if skip_bad => f64::NAN,
            None => {
                let remedy =
                    "repair the file, or drop such vertices and their faces with --skip-bad";
                return Err(not_a_number("a coordinate of a vertex", word, remedy));
            }
        };
        n += 1;
    }
    if n < 3 {
        if !skip_bad {
            let what = "a vertex has fewer than three coordinates; repair the file, or drop such vertices and their \
                        faces with --skip-bad";
            return Err(what.to_owned());
        }
        values[n..3].fill(f64::NAN);
    }
    let colour = (n >= 6).then(|| [values[3], values[4], values[5]]);
    let has_more = match n {
        4 => values[3] != 1.0,
        7 => words.next().is_some(),
        _ => n == 5,
    };
    let position = [values[0], values[1], values[2]];
    Ok(Vertex { position, colour, opacity: (n == 7).then_some(values[6]), has_more })
}

/// `7/3` and `7/3/1` have texture coordinates, `7` and `7//1` have none.
pub(super) fn has_texture(corner: &[u8]) -> bool {
    let mut parts = corner.split(|&b| b == b'/').skip(1);
    parts.next().is_some_and(|part| !part.is_empty())
}

/// The vertex of a corner: from 1 upwards, or from -1 downwards from the last vertex so far.
fn corner(word: &[u8], n_so_far: u64, n_vertices: u64) -> Option<u64> {
    let number = word.split(|&b| b == b'/').next()?;
    let number = parse_whole(number)?;
    let id = match number {
        0 => return None,
        1.. => number as u64 - 1,
        _ => n_so_far.checked_sub(number.unsigned_abs())?,
    };
    (id < n_vertices).then_some(id)
}

/// Puts the corners of an `f` line into `row`, after their count, which is returned.
pub(super) fn face<'a>(
    words: impl Iterator<Item = &'a [u8]>,
    n_so_far: u64,
    n_vertices: u64,
    row: &mut Vec<u8>,
) -> Result<usize, String> {
    row.clear();
    row.extend_from_slice(&[0; 4]);
    let mut n = 0u32;
    for word in words {
        let Some(id) = corner(word, n_so_far, n_vertices) else {
            let word: String = word
                .iter()
                .take(40)
                .map(|&b| if b.is_ascii_graphic() { b as char } else { '?' })
                .collect();
            return Err(format!(
                "the corner '{word}' names a vertex that does not exist (there are {n_vertices})"
            ));
        };
        if wide(n_vertices) {
            row.extend_from_slice(&id.to_le_bytes());
        } else {
            row.extend_from_slice(&(id as u32).to_le_bytes());
        }
        n += 1;
    }
    if u64::from(n) > MAX_CORNERS {
        return Err(format!("a face has {n} corners; at most {MAX_CORNERS} are supported"));
    }
    row[..4].copy_from_slice(&n.to_le_bytes());
    Ok(n as usize)
}

/// Returns whether ids need 8 bytes.
pub(super) fn wide(n_vertices: u64) -> bool {
    n_vertices > 1 << 32
}

/// Returns whether a face that the file ends with, without the end of a line, is not all there: it has fewer corners than
/// the one before, or its last corner has another form than its first.
pub(super) fn is_cut<'a>(words: impl Iterator<Item = &'a [u8]> + Clone, n_before: usize) -> bool {
    let form = |word: &[u8]| (word.iter().filter(|&&b| b == b'/').count(), word.ends_with(b"/"));
    let n = words.clone().count();
    n < n_before.max(3) || words.clone().next().map(form) != words.last().map(form)
}
