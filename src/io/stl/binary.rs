//! Binary STL: facets of 50 bytes behind a header of 84, also several such files one behind the other.

use super::ascii::{is_ascii, not_finite};
use super::facet_colours::FacetColours;
use super::other_kind::{FACET_BYTES, HEADER_BYTES, refuse_other};
use super::weld::{FLOATS, FLOATS_BY_FIRST, Welder};
use crate::open_options::StageOptions;
use crate::ply::raw::RawFile;
use crate::ply::source::Staged;
use crate::sidecars::comments_of;
use stonecut_system::error::Result;
use stonecut_system::losses::{Loss, LossKind};

/// Files one behind the other that are looked for in a file of unknown format.
const MAX_PARTS: u64 = 10_000;

/// Facets that are read at once.
const CHUNK: u64 = 20_000;

/// Returns whether a file that begins with `first` and has `len` bytes is a binary STL.
///
/// Many binary files begin with `solid` too, so the length decides.
pub fn is_binary(first: &[u8], len: u64) -> bool {
    let Some(count) = first.get(80..84) else { return false };
    let n = u64::from(u32::from_le_bytes(count.try_into().expect("4 bytes")));
    len == HEADER_BYTES + n * FACET_BYTES || !is_ascii(first)
}

/// Returns whether a file is exactly as long as the counts in it say, with one header or several one behind the other.
pub fn has_fitting_length(file: &RawFile) -> Result<bool> {
    let mut at = 0u64;
    for _ in 0..MAX_PARTS {
        let mut count = [0; 4];
        if file.read_at_most(&mut count, at + 80)? < count.len() {
            return Ok(false);
        }
        let n = u64::from(u32::from_le_bytes(count));
        at += HEADER_BYTES + n * FACET_BYTES;
        if n == 0 || at >= file.len() {
            return Ok(n > 0 && at == file.len());
        }
    }
    Ok(false)
}

/// Reads a binary STL into a PLY.
pub fn read_binary(file: &RawFile, options: &StageOptions) -> Result<(RawFile, Staged)> {
    let mut reader = Reader {
        file,
        options,
        staged: Staged::default(),
        welder: Welder::new(options),
        colours: FacetColours::new(options.spool()),
        bytes: Vec::new(),
        comments: Vec::new(),
        n_facets: 0,
    };
    let (mut at, mut n_parts) = (0, 0u64);
    while let Some(n) = reader.part(at)? {
        at += HEADER_BYTES + n * FACET_BYTES;
        n_parts += 1;
    }
    if n_parts > 1 {
        let what = format!("{n_parts} STL files one behind the other: read as one");
        reader.staged.notes.push(Loss::remark(what));
    }
    let rest = file.len().saturating_sub(at);
    let mut first = [0; 4096];
    let n = if rest > 0 { file.read_at_most(&mut first, at)? } else { 0 };
    if is_ascii(&first[..n]) && n > 0 {
        let loss = refuse_other(file, (at, ["an ASCII STL file", "a binary one"]), options)?;
        reader.staged.losses.lose(loss);
    } else if rest > 0 {
        let what = format!(
            "byte offset {at}: the {rest} bytes behind the last facet are not an STL file: left out"
        );
        reader.staged.notes.push(Loss { kind: LossKind::Elements, ..Loss::remark(what) });
    }
    let Reader { mut staged, welder, colours, comments, .. } = reader;
    let (colours, note) = colours.finish(file, options.spool())?;
    staged.notes.extend(note);
    Ok((welder.finish(file.path(), comments, colours)?, staged))
}

struct Reader<'a> {
    file: &'a RawFile,
    options: &'a StageOptions,
    staged: Staged,
    welder: Welder<FLOATS, FLOATS_BY_FIRST>,
    colours: FacetColours,
    bytes: Vec<u8>,
    comments: Vec<String>,
    /// Facets of the parts before.
    n_facets: u64,
}

impl Reader<'_> {
    /// Reads the file that begins at byte `at`; its facets, or `None` if there is not another one.
    fn part(&mut self, at: u64) -> Result<Option<u64>> {
        let file = self.file;
        let mut header = [0u8; HEADER_BYTES as usize];
        if file.read_at_most(&mut header, at)? < header.len() {
            return match at {
                0 => {
                    let what = "the file is shorter than the header of an STL file (84 bytes)";
                    Err(file.bad(what))
                }
                _ => Ok(None),
            };
        }
        let held = (file.len() - at - HEADER_BYTES) / FACET_BYTES;
        let count = u64::from(u32::from_le_bytes([header[80], header[81], header[82], header[83]]));
        // Programs that write while they scan leave 0 for the count: then it is what there is.
        let promised = if count == 0 && at == 0 { held } else { count };
        if held < promised {
            if at > 0 {
                return Ok(None);
            }
            if !self.options.read.skip_bad {
                return Err(file.bad(format!(
                    "facet {held}, byte offset {}: the file ends here, but its header promises {promised} \
                     facets; copy or export it again, or read what is there with --skip-bad",
                    file.len()
                )));
            }
            self.staged.faults.bad_faces += promised - held;
        }
        let n = promised.min(held);
        self.colours.begin(&header[..80]);
        self.facets(at + HEADER_BYTES, n)?;
        self.n_facets += n;
        let text: String = header[..80]
            .iter()
            .take_while(|&&b| b != 0)
            .map(|&b| if (32..127).contains(&b) { char::from(b) } else { '?' })
            .collect();
        let text = text.trim();
        if !text.is_empty() && self.comments.len() < 1000 {
            self.comments.extend(comments_of(text.to_owned()));
        }
        Ok(Some(n))
    }

    /// Reads `n` facets from byte `start` on.
    fn facets(&mut self, start: u64, n: u64) -> Result<()> {
        let mut done = 0;
        while done < n {
            let count = (n - done).min(CHUNK);
            let at = start + done * FACET_BYTES;
            self.bytes.resize((count * FACET_BYTES) as usize, 0);
            self.file.read_exact_at(&mut self.bytes, at)?;
            for (i, facet) in self.bytes.chunks_exact(FACET_BYTES as usize).enumerate() {
                let float =
                    |at: usize| f32::from_le_bytes(facet[at..at + 4].try_into().expect("4 bytes"));
                let triangle = [12, 24, 36]
                    .map(|corner| [float(corner), float(corner + 4), float(corner + 8)]);
                if triangle.as_flattened().iter().all(|v| v.is_finite()) {
                    self.welder.push(triangle.map(|corner| corner.map(f64::from)))?;
                    self.colours.push(u16::from_le_bytes([facet[48], facet[49]]))?;
                } else if self.options.read.skip_bad {
                    self.staged.faults.bad_faces += 1;
                } else {
                    let facet = self.n_facets + done + i as u64;
                    let offset = at + i as u64 * FACET_BYTES;
                    let place = format!("facet {facet}, byte offset {offset}");
                    return Err(not_finite(self.file, &place));
                }
            }
            done += count;
        }
        Ok(())
    }
}
