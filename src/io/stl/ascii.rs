//! ASCII STL: a stream of words, read with the precision that it is written with.

use super::other_kind::{is_rest, refuse_other};
use super::weld::{DOUBLES, DOUBLES_BY_FIRST, FLOATS, FLOATS_BY_FIRST, Welder};
use crate::extent::Extent;
use crate::open_options::StageOptions;
use crate::ply::header::BYTE_ORDER_MARK;
use crate::ply::raw::RawFile;
use crate::ply::source::Staged;
use crate::polygon::PolygonCutter;
use crate::sidecars::comments_of;
use crate::text_lines::{Lines, not_a_number, parse_number, words};
use stonecut_mesh::property::Scalar;
use stonecut_system::error::Result;
use stonecut_system::losses::{Loss, LossKind};

/// Most corners of a facet.
const MAX_CORNERS: usize = 1 << 20;

/// Bytes of a triangle on its way to the welder.
const TRIANGLE_BYTES: usize = 72;

/// Returns whether the text begins like an ASCII STL.
pub fn is_ascii(first: &[u8]) -> bool {
    let text = first.strip_prefix(BYTE_ORDER_MARK).unwrap_or(first).trim_ascii_start();
    let begins =
        |word: &[u8]| text.len() >= word.len() && text[..word.len()].eq_ignore_ascii_case(word);
    // Some programs write another line first.
    let has_facet = || text.windows(12).any(|word| word.eq_ignore_ascii_case(b"facet normal"));
    !first.contains(&0) && (begins(b"solid") || has_facet())
}

/// Triangles of an ASCII STL before they are welded.
struct Facets<'a> {
    options: &'a StageOptions,
    extent: Extent,
    /// Corners of triangles as doubles.
    triangles: crate::ply::raw::Spool,
    cutter: PolygonCutter,
    n_crossing: u64,
}

impl Facets<'_> {
    /// Takes the corners of a facet.
    fn push(&mut self, corners: &[[f64; 3]]) -> Result<()> {
        if corners.len() == 3 {
            return self.put([corners[0], corners[1], corners[2]]);
        }
        self.n_crossing += u64::from(!self.cutter.cut(corners));
        let triangles = std::mem::take(&mut self.cutter.triangles);
        triangles.iter().try_for_each(|t| self.put(t.map(|i| corners[i])))?;
        self.cutter.triangles = triangles;
        Ok(())
    }

    fn put(&mut self, triangle: [[f64; 3]; 3]) -> Result<()> {
        triangle.into_iter().for_each(|corner| self.extent.add(corner));
        let bytes: Vec<u8> = triangle.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
        self.triangles.write(&bytes)
    }

    /// Joins equal corners, as floats where these keep what the text says.
    fn weld(self, file: &RawFile, comments: Vec<String>) -> Result<RawFile> {
        let options = self.options;
        let coordinate = self.extent.coordinate();
        let triangles = self.triangles.finish(file.path())?;
        if coordinate == Scalar::F64 {
            let mut welder = Welder::<DOUBLES, DOUBLES_BY_FIRST>::new(options);
            each_triangle(&triangles, |triangle| welder.push(triangle))?;
            return welder.finish(file.path(), comments, None);
        }
        let mut welder = Welder::<FLOATS, FLOATS_BY_FIRST>::new(options);
        each_triangle(&triangles, |triangle| welder.push(triangle))?;
        welder.finish(file.path(), comments, None)
    }
}

fn each_triangle(
    triangles: &RawFile,
    mut each: impl FnMut([[f64; 3]; 3]) -> Result<()>,
) -> Result<()> {
    triangles.each_piece(0..triangles.len(), 10_000 * TRIANGLE_BYTES, |bytes| {
        bytes.chunks_exact(TRIANGLE_BYTES).try_for_each(|bytes| {
            let value =
                |i: usize| f64::from_le_bytes(bytes[8 * i..8 * i + 8].try_into().expect("8 bytes"));
            each([0, 3, 6].map(|i| [value(i), value(i + 1), value(i + 2)]))
        })
    })
}

/// Reads an ASCII STL into a PLY; several one behind the other are one.
///
/// `vertex x y z` gathers corners, `endloop` (or `end loop`) closes a facet. Everything else (normals, names) is
/// passed over. Disk: 72 bytes a triangle, beside what the welder needs.
pub fn read_ascii(file: &RawFile, options: &StageOptions) -> Result<(RawFile, Staged)> {
    let mut facets = Facets {
        options,
        extent: Extent::default(),
        triangles: options.spool(),
        cutter: PolygonCutter::default(),
        n_crossing: 0,
    };
    let mut staged = Staged::default();
    let mut lines = Lines::new(file);
    let mut line = Vec::new();
    let mut corners: Vec<[f64; 3]> = Vec::new();
    let mut finite = true;
    let mut ended = false;
    // Coordinates may stand on the next line, so what is awaited outlives the line.
    let mut awaited = 0;
    let mut position = [0f64; 3];
    let (mut comments, mut n_coloured) = (Vec::new(), 0);
    while lines.next(&mut line)? {
        if ended && line.contains(&0) {
            if is_rest(file, lines.offset)? {
                let parts = (lines.offset, ["a binary STL file", "an ASCII one"]);
                staged.losses.lose(refuse_other(file, parts, options)?);
                break;
            }
            let at = lines.number;
            let what = format!("line {at}: what is behind 'endsolid' is not text: left out");
            staged.notes.push(Loss { kind: LossKind::Elements, ..Loss::remark(what) });
            break;
        }
        let mut tokens = words(&line);
        while let Some(token) = tokens.next() {
            if awaited > 0 {
                position[3 - awaited] = match parse_number(token) {
                    Some(value) => value,
                    None if options.read.skip_bad => f64::NAN,
                    None => {
                        let remedy = "repair the file, or drop such facets with --skip-bad";
                        let what = "a coordinate of a vertex";
                        return Err(lines.bad(not_a_number(what, token, remedy)));
                    }
                };
                awaited -= 1;
                if awaited == 0 {
                    finite &= position.iter().all(|v| v.is_finite());
                    corners.push(position);
                }
                if corners.len() > MAX_CORNERS {
                    return Err(lines.bad("a facet has more than a million corners"));
                }
                continue;
            }
            // Some programs write `end loop` and `end solid`.
            let (token, is_end) = match token.eq_ignore_ascii_case(b"end") {
                true => (tokens.next().unwrap_or_default(), true),
                false if token.len() > 3 && token[..3].eq_ignore_ascii_case(b"end") => {
                    (&token[3..], true)
                }
                false => (token, false),
            };
            if token.eq_ignore_ascii_case(b"solid") {
                ended = is_end;
                // The name ends with the line, or with the first facet.
                let (mut name, mut goes_on) = (Vec::new(), false);
                for word in tokens.by_ref() {
                    let is_facet = |last: &&[u8]| last.eq_ignore_ascii_case(b"facet");
                    if word.eq_ignore_ascii_case(b"normal") && name.last().is_some_and(is_facet) {
                        name.pop();
                        goes_on = true;
                        break;
                    }
                    name.push(word);
                }
                ended &= !goes_on;
                let name: Vec<_> = name.into_iter().map(String::from_utf8_lossy).collect();
                let name = name.join(" ");
                if !ended && !name.is_empty() && comments.len() < 1000 {
                    comments.extend(comments_of(format!("solid {name}")));
                }
                if !goes_on {
                    break;
                }
            } else if token.eq_ignore_ascii_case(b"color") || token.eq_ignore_ascii_case(b"colour")
            {
                n_coloured += 1;
            } else if token.eq_ignore_ascii_case(b"vertex") && !is_end {
                awaited = 3;
            } else if token.eq_ignore_ascii_case(b"loop") && is_end {
                if !finite && !options.read.skip_bad {
                    return Err(not_finite(file, &format!("line {}", lines.number)));
                }
                if !finite {
                    staged.faults.bad_faces += 1;
                } else if corners.len() >= 3 {
                    facets.push(&corners)?;
                }
                corners.clear();
                finite = true;
            }
        }
    }
    if !ended && !options.read.skip_bad {
        return Err(file.bad(format!(
            "line {}, byte offset {}: the file ends without 'endsolid'; copy or export it again, or \
             read what is there with --skip-bad",
            lines.number,
            file.len()
        )));
    }
    if n_coloured > 0 {
        let loss = Loss::new(LossKind::Colors, "lines 'color' of facets", "not read").whole();
        staged
            .losses
            .lose(loss.count(n_coloured).remedy("export the mesh as PLY, which has colours"));
    }
    if facets.n_crossing > 0 {
        staged.notes.push(Loss::remark(crossing_note(facets.n_crossing)));
    }
    Ok((facets.weld(file, comments)?, staged))
}

/// The line for polygons that cross themselves.
fn crossing_note(n: u64) -> String {
    format!("{n} facets of more than three corners cross themselves: their triangles overlap")
}

/// The refusal of a facet whose place is not a number.
pub(super) fn not_finite(file: &RawFile, place: &str) -> stonecut_system::error::Error {
    file.bad(format!(
        "{place}: a corner's position is not finite; repair the file, or drop such facets with \
         --skip-bad"
    ))
}
