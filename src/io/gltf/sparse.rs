//! Sparse accessors (glTF 2.0, section 3.6.2.3): a few elements that differ from others, or from zeros, put in their places
//! in temporary data. A block of elements in memory at a time.

use super::elements::{BLOCK, Elements};
use super::json::Sparse;
use crate::materials::Part;
use crate::ply::raw::{RawFile, Spool};
use std::sync::Arc;
use stonecut_system::error::Result;

/// The elements of `base` with some of them replaced, one behind the other; `indices` in rising order, `values` in theirs.
pub(super) fn filled_in(
    (file, number): (&RawFile, usize),
    base: &Elements,
    [indices, values]: [Elements; 2],
    mut out: Spool,
) -> Result<Part> {
    let size = base.element_bytes();
    let (mut block, mut changed) = (Vec::new(), Vec::new());
    let (mut raw, mut places) = (Vec::new(), Vec::new());
    // The next value, and the first one of those at hand.
    let (mut next, mut at_hand) = (0u64, 0u64);
    let mut last = None;
    for first in (0..base.count).step_by(BLOCK as usize) {
        base.read_bytes(first, &mut block)?;
        while next < indices.count {
            let i = (next - at_hand) as usize;
            if i == places.len() {
                at_hand = next;
                indices.read(next, &mut raw, &mut places)?;
                values.read_bytes(next, &mut changed)?;
                continue;
            }
            let place = places[i] as u64;
            if place >= base.count || last.is_some_and(|last| place <= last) {
                return Err(file.bad(format!(
                    "accessor {number}: its sparse index {place} is not above the one before and below {}; the file is \
                     damaged",
                    base.count
                )));
            }
            let offset = (place - first) as usize * size;
            if offset >= block.len() {
                break;
            }
            block[offset..offset + size].copy_from_slice(&changed[i * size..(i + 1) * size]);
            last = Some(place);
            next += 1;
        }
        out.write(&block)?;
    }
    let n_bytes = out.len();
    Ok(Part { file: Arc::new(out.finish(file.path())?), offset: 0, n_bytes })
}

impl Sparse {
    /// Returns whether its indices are of a type that counts.
    pub(super) fn has_unsigned_indices(&self) -> bool {
        matches!(self.indices.component_type, 5121 | 5123 | 5125)
    }
}
