//! Vertices that were made on the way, as copies of others: whose values and region they have.

use super::whole::{Left, WholeMesh};
use std::collections::HashMap;

/// For each vertex that was made in any round, by its id, the one that it is like.
#[derive(Default)]
pub(super) struct RowModels(HashMap<u32, u32>);

impl RowModels {
    /// Takes over what the kernel made in all cells of a round, or in the finish.
    pub(super) fn follow<'a>(&mut self, left: impl IntoIterator<Item = &'a Left>) {
        let mut made = Vec::new();
        for Left { ids, simplified } in left {
            for &source in &simplified.source {
                let like = simplified.models.of(source);
                if like != source {
                    let [source, like] = [source, like].map(|v| ids[v as usize].narrow());
                    // As it was before this round, in which its number may have gone to a copy.
                    made.push((source, self.of(like)));
                }
            }
        }
        self.0.extend(made);
    }

    fn of(&self, id: u32) -> u32 {
        self.0.get(&id).copied().unwrap_or(id)
    }

    /// The vertices in the order of those that they are like, and these.
    pub(super) fn by_model(&self, whole: WholeMesh) -> (WholeMesh, Vec<u32>) {
        let whole = whole.in_order(|id| self.of(id));
        let likes = whole.ids.iter().map(|&id| self.of(id)).collect();
        (whole, likes)
    }
}
