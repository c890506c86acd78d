//! Colours that programs put into the two bytes behind each facet of a binary STL.
//!
//! VisCAM and SolidView: bit 15 is set where a facet has a colour; blue is lowest. Materialise Magics: the header has
//! `COLOR=` and a colour for all; bit 15 is clear where a facet has its own, and red is lowest. Other values are not
//! colours: facets that have them beside some with a colour are white, and a note counts them. Written are those of VisCAM.

use crate::ply::raw::{RawFile, Spool};
use stonecut_system::error::Result;
use stonecut_system::losses::{Loss, LossKind};

/// Set where a facet has a colour (VisCAM), or where it has that of the header (Magics).
const FLAG: u16 = 1 << 15;

/// Colour of facets without one, beside others that have one.
const WHITE: [u8; 3] = [255; 3];

/// A colour as VisCAM has it: the flag, and 5 bits a channel.
pub(super) fn packed(rgb: [u8; 3]) -> u16 {
    let [red, green, blue] = rgb.map(|value| (u16::from(value) * 31 + 127) / 255);
    FLAG | red << 10 | green << 5 | blue
}

/// The colour of such a word.
pub(super) fn unpacked(word: u16) -> [u8; 3] {
    [10, 5, 0].map(|shift| ((u32::from(word >> shift & 31) * 255 + 15) / 31) as u8)
}

/// One of the STL files that lie one behind the other.
#[derive(Default)]
struct Part {
    /// The colour of the header.
    whole: Option<[u8; 3]>,
    n_facets: u64,
    /// Facets whose bytes are not 0, and those among them with the flag.
    n_marked: u64,
    n_flagged: u64,
}

/// Gathers the bytes of facets; nothing is kept as long as all are 0.
pub(super) struct FacetColours {
    parts: Vec<Part>,
    words: Spool,
    n_facets: u64,
}

impl FacetColours {
    pub(super) fn new(words: Spool) -> Self {
        FacetColours { parts: Vec::new(), words, n_facets: 0 }
    }

    /// Begins with a file that has this header.
    pub(super) fn begin(&mut self, header: &[u8]) {
        const WORD: &[u8] = b"COLOR=";
        let at = header.windows(WORD.len()).position(|word| word == WORD);
        let whole = at.and_then(|at| header.get(at + WORD.len()..at + WORD.len() + 3));
        let whole = whole.map(|rgb| [rgb[0], rgb[1], rgb[2]]);
        // Parts without colours need not be told apart.
        match self.parts.last_mut() {
            Some(last) if last.n_marked == 0 && last.whole.is_none() && whole.is_none() => {}
            _ => self.parts.push(Part { whole, ..Part::default() }),
        }
    }

    /// Takes the bytes of the next facet.
    pub(super) fn push(&mut self, word: u16) -> Result<()> {
        let Some(part) = self.parts.last_mut() else { return Ok(()) };
        part.n_facets += 1;
        self.n_facets += 1;
        if word == 0 {
            return Ok(());
        }
        part.n_marked += 1;
        part.n_flagged += u64::from(word & FLAG != 0);
        self.fill(self.n_facets - 1)?;
        self.words.write(&word.to_le_bytes())
    }

    /// Writes the zeros that were not written so far.
    fn fill(&mut self, n: u64) -> Result<()> {
        let zeros = [0u8; 1 << 12];
        while self.words.len() < 2 * n {
            let missing = 2 * n - self.words.len();
            self.words.write(&zeros[..missing.min(zeros.len() as u64) as usize])?;
        }
        Ok(())
    }

    /// Three bytes for each facet in `out`, if there are colours; and a line on facets without one, or on bytes that are none.
    pub(super) fn finish(
        mut self,
        file: &RawFile,
        mut out: Spool,
    ) -> Result<(Option<Spool>, Option<Loss>)> {
        let is_coloured = |part: &Part| part.whole.is_some() || part.is_viscam();
        if !self.parts.iter().any(is_coloured) {
            let n: u64 = self.parts.iter().map(|part| part.n_marked).sum();
            let note = format!("{n} facets have attribute bytes that are not colours: left out");
            let note = Loss { kind: LossKind::Attributes, ..Loss::remark(note) };
            return Ok((None, (n > 0).then_some(note)));
        }
        self.fill(self.n_facets)?;
        let words = self.words.finish(file.path())?;
        let mut left = self.parts.iter().map(|part| (part.n_facets, part));
        let mut current = left.next();
        words.each_piece(0..words.len(), 1 << 16, |bytes| {
            let mut colours = Vec::with_capacity(bytes.len() / 2 * 3);
            for word in bytes.chunks_exact(2) {
                while let Some((0, _)) = current {
                    current = left.next();
                }
                let Some((left_of_part, part)) = &mut current else { break };
                *left_of_part -= 1;
                colours.extend(part.colour(u16::from_le_bytes([word[0], word[1]])));
            }
            out.write(&colours)
        })?;
        let n_white: u64 = self.parts.iter().map(Part::n_white).sum();
        let loss = Loss::new(LossKind::Colors, "facets without colour", "others have one: white");
        Ok((Some(out), (n_white > 0).then(|| loss.count(n_white))))
    }
}

impl Part {
    /// Returns whether facets have colours as VisCAM has them.
    fn is_viscam(&self) -> bool {
        self.whole.is_none() && self.n_flagged > 0
    }

    /// Facets without a colour.
    fn n_white(&self) -> u64 {
        match self.whole {
            Some(_) => 0,
            None => self.n_facets - self.n_flagged,
        }
    }

    fn colour(&self, word: u16) -> [u8; 3] {
        let [high, middle, low] = unpacked(word);
        match self.whole {
            // Programs that write one colour for all leave the bytes of the facets 0, which would be black.
            Some(whole) if word & FLAG != 0 || self.n_marked == 0 => whole,
            Some(_) => [low, middle, high],
            None if word & FLAG != 0 => [high, middle, low],
            None => WHITE,
        }
    }
}
