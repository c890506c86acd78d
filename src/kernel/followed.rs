//! Follows every vertex of the input from merger to merger, so that its foot on the result is found beside it.
//!
//! Decides nothing; `measure/step` looks for the feet.

use crate::surface::Ring;
use crate::vertex::GONE;

/// Mergers in a row that are followed before a vertex is given up; those of a removed speck lead nowhere.
const LONGEST_WAY: usize = 4096;

/// For each vertex of the input the vertex of the surface that it is in now, or `GONE`: 4 bytes each.
#[derive(Clone)]
pub(crate) struct Followed(Vec<u32>);

impl Followed {
    /// Begins with a surface whose vertices come from `source`, out of `n` vertices of the input.
    pub(crate) fn new(source: &[u32], n: usize) -> Followed {
        Followed(inverse(source, n))
    }

    /// Memory in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        size_of_val(self.0.as_slice()) as u64
    }

    /// Follows to vertices that are still there.
    pub(crate) fn follow(&mut self, rings: &[Ring]) {
        for at in &mut self.0 {
            for _ in 0..LONGEST_WAY {
                match rings.get(*at as usize) {
                    Some(ring) if ring.class.is_none() => *at = ring.start,
                    _ => break,
                }
            }
            if rings.get(*at as usize).is_none_or(|ring| ring.class.is_none()) {
                *at = GONE;
            }
        }
    }

    /// Takes over new numbers of the vertices; `place` is `GONE` for those that are gone.
    pub(crate) fn renumber(&mut self, place: &[u32]) {
        for at in &mut self.0 {
            *at = place.get(*at as usize).copied().unwrap_or(GONE);
        }
    }

    /// Names the sources of the vertices that are left instead of themselves; `source` is that of the surface's vertices.
    pub(crate) fn by_source(mut self, rings: &[Ring], source: &[u32]) -> Followed {
        self.follow(rings);
        // The source of a vertex that others took over may be that of a new one by now.
        for at in &mut self.0 {
            if rings.get(*at as usize).is_some_and(|ring| ring.len == 0) {
                *at = GONE;
            }
        }
        self.renumber(source);
        self
    }

    /// After `by_source`: for each vertex of the input the vertex of the result, whose sources are `left`, or `GONE`.
    pub(crate) fn into_result(mut self, left: &[u32]) -> Vec<u32> {
        let place = inverse(left, self.0.len());
        self.renumber(&place);
        self.0
    }
}

/// For each of `n` sources its place in a list; `GONE` if it is not there.
fn inverse(source: &[u32], n: usize) -> Vec<u32> {
    let mut place = vec![GONE; n];
    for (at, &source) in (0u32..).zip(source) {
        if let Some(place) = place.get_mut(source as usize) {
            *place = at;
        }
    }
    place
}
