//! STL, binary and ASCII: loose triangles, welded while they are read.

use super::weld::Welder;
use crate::error::Result;
use crate::io::open_options::StageOptions;
use crate::io::ply::raw::RawFile;
use crate::io::ply::source::Staged;
use crate::io::text_lines::{Lines, parse_number, words};

const HEADER_BYTES: u64 = 84;
const FACET_BYTES: u64 = 50;

/// Returns whether a file that begins with `first` and has `len` bytes is a binary STL.
///
/// Many binary files begin with `solid` too, so the length decides.
pub(crate) fn is_binary(first: &[u8], len: u64) -> bool {
    let Some(count) = first.get(80..84) else { return false };
    let n = u64::from(u32::from_le_bytes(count.try_into().expect("4 bytes")));
    len == HEADER_BYTES + n * FACET_BYTES || !is_ascii(first)
}

/// Returns whether the text begins like an ASCII STL.
pub(crate) fn is_ascii(first: &[u8]) -> bool {
    let text = first.trim_ascii_start();
    text.len() >= 5 && text[..5].eq_ignore_ascii_case(b"solid") && !first.contains(&0)
}

/// Reads a binary STL into a PLY.
pub(crate) fn read_binary(file: &RawFile, options: &StageOptions) -> Result<(RawFile, Staged)> {
    let mut header = [0u8; HEADER_BYTES as usize];
    if file.read_at_most(&mut header, 0)? < header.len() {
        return Err(file.bad("the file is shorter than the header of an STL file (84 bytes)"));
    }
    let held = (file.len() - HEADER_BYTES) / FACET_BYTES;
    // Programs that write while they scan leave 0 for the count: then it is what there is.
    let promised = match u32::from_le_bytes([header[80], header[81], header[82], header[83]]) {
        0 => held,
        n => u64::from(n),
    };
    let mut staged = Staged::default();
    if held < promised {
        if !options.read.skip_bad {
            return Err(file.bad(format!(
                "facet {held}, byte offset {}: the file ends here, but its header promises {promised} \
                 facets; copy or export it again, or read what is there with --skip-bad",
                file.len()
            )));
        }
        staged.faults.bad_faces += promised - held;
    }
    let n = promised.min(held);
    let mut welder = Welder::new(options);
    let mut bytes = vec![0u8; 20_000 * FACET_BYTES as usize];
    let mut done = 0;
    while done < n {
        let count = (n - done).min(20_000);
        let at = HEADER_BYTES + done * FACET_BYTES;
        let chunk = &mut bytes[..(count * FACET_BYTES) as usize];
        file.read_exact_at(chunk, at)?;
        for (i, facet) in chunk.chunks_exact(FACET_BYTES as usize).enumerate() {
            let float =
                |at: usize| f32::from_le_bytes(facet[at..at + 4].try_into().expect("4 bytes"));
            let triangle =
                [12, 24, 36].map(|corner| [float(corner), float(corner + 4), float(corner + 8)]);
            if triangle.as_flattened().iter().all(|v| v.is_finite()) {
                welder.push(triangle)?;
            } else if options.read.skip_bad {
                staged.faults.bad_faces += 1;
            } else {
                let facet = done + i as u64;
                let offset = at + i as u64 * FACET_BYTES;
                return Err(not_finite(file, &format!("facet {facet}, byte offset {offset}")));
            }
        }
        done += count;
    }
    let text: String = header[..80]
        .iter()
        .take_while(|&&b| b != 0)
        .map(|&b| if (32..127).contains(&b) { char::from(b) } else { '?' })
        .collect();
    let comments = Some(text.trim().to_owned()).filter(|t| !t.is_empty());
    Ok((welder.finish(file.path(), comments.into_iter().collect())?, staged))
}

/// Reads an ASCII STL into a PLY.
///
/// A stream of words: `vertex x y z` gathers corners, `endloop` closes a facet. Everything else (normals,
/// names) is passed over.
pub(crate) fn read_ascii(file: &RawFile, options: &StageOptions) -> Result<(RawFile, Staged)> {
    let mut welder = Welder::new(options);
    let mut staged = Staged::default();
    let mut lines = Lines::new(file);
    let mut line = Vec::new();
    let mut corners: Vec<[f32; 3]> = Vec::new();
    let mut finite = true;
    let mut ended = false;
    // Coordinates may stand on the next line, so what is awaited outlives the line.
    let mut awaited = 0;
    let mut position = [0f32; 3];
    let mut comments = Vec::new();
    while lines.next(&mut line)? {
        let mut tokens = words(&line);
        while let Some(token) = tokens.next() {
            if awaited > 0 {
                let Some(value) = parse_number(token) else {
                    return Err(lines.bad("a coordinate of a vertex is not a number"));
                };
                position[3 - awaited] = value as f32;
                awaited -= 1;
                if awaited == 0 {
                    finite &= position.iter().all(|v| v.is_finite());
                    corners.push(position);
                }
                if corners.len() > 1 << 20 {
                    return Err(lines.bad("a facet has more than a million corners"));
                }
            } else if token.eq_ignore_ascii_case(b"solid")
                || token.eq_ignore_ascii_case(b"endsolid")
            {
                ended = token.len() > 5;
                let name = tokens.map(String::from_utf8_lossy).collect::<Vec<_>>().join(" ");
                if !ended && !name.is_empty() && comments.len() < 1000 {
                    comments.push(format!("solid {name}"));
                }
                break;
            } else if token.eq_ignore_ascii_case(b"vertex") {
                awaited = 3;
            } else if token.eq_ignore_ascii_case(b"endloop") {
                if !finite && !options.read.skip_bad {
                    return Err(not_finite(file, &format!("line {}", lines.number)));
                }
                if finite {
                    for i in 2..corners.len() {
                        welder.push([corners[0], corners[i - 1], corners[i]])?;
                    }
                } else {
                    staged.faults.bad_faces += 1;
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
    Ok((welder.finish(file.path(), comments)?, staged))
}

fn not_finite(file: &RawFile, place: &str) -> crate::error::Error {
    file.bad(format!(
        "{place}: a corner's position is not finite; repair the file, or drop such facets with \
         --skip-bad"
    ))
}
