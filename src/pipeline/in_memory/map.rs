//! The vertex that every row of arrays became, round by round; as `--map` for files.

use super::weld::Welded;
use super::whole::Left;
use crate::store::cells::lead_copies;

/// Of a row that became no vertex.
pub const GONE: u32 = u32::MAX;

/// For each row the id of the vertex that it is now: 4 bytes a row, 24 for its position.
pub(super) struct RowMap {
    rows: Vec<u32>,
    positions: Vec<[f64; 3]>,
}

impl RowMap {
    /// Begins with the vertices that rows have become when copies were joined.
    pub(super) fn new(positions: Vec<[f64; 3]>, welded: &Welded) -> RowMap {
        let rows = match &welded.numbers {
            Some(numbers) => numbers.iter().map(|&v| welded.ids[v as usize]).collect(),
            None => (0..positions.len() as u32).collect(),
        };
        RowMap { rows, positions }
    }

    /// Takes over what the kernel did in all cells of a round, or in the finish.
    pub(super) fn follow<'a>(&mut self, left: impl IntoIterator<Item = &'a Left>) {
        let mut next = vec![GONE; self.rows.len()];
        for Left { ids, simplified } in left {
            for (id, &to) in ids.iter().zip(&simplified.followed) {
                if let Some(&source) = simplified.source.get(to as usize) {
                    next[id.narrow() as usize] = ids[source as usize].narrow();
                }
            }
        }
        self.rename(&next);
    }

    fn rename(&mut self, next: &[u32]) {
        for row in &mut self.rows {
            *row = next.get(*row as usize).copied().unwrap_or(GONE);
        }
    }

    /// For each row the vertex of the result, whose ids are `left`.
    pub(super) fn ended(mut self, left: &[u32]) -> Vec<u32> {
        let mut place = vec![GONE; self.rows.len()];
        (0u32..).zip(left).for_each(|(number, &id)| place[id as usize] = number);
        self.rename(&place);
        let positions = self.positions;
        lead_copies(&mut self.rows, |row| positions[row].map(f64::to_bits));
        self.rows
    }
}
