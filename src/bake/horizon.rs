//! Outlines of charts, and a page that they drop onto: the rows that are taken in each column.
//!
//! A chart drops as it is or turned by 180 degrees, where it leaves least room below it. Knows no triangles and no scale.

/// First row of a column that a chart does not cover.
pub(super) const NOTHING: i16 = i16::MAX / 2;

/// Charts that do not fit on a page, one after the other, before it is left.
const MOST_MISSES: u32 = 48;

/// Place of a piece on a page.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Place {
    /// The texel of its upper left corner, or of the lower right one of a piece that is turned.
    pub corner: [u32; 2],
    /// True if it is turned by 180 degrees.
    pub is_turned: bool,
}

/// Rows that a chart covers in each column, from the upper edge of its box downwards.
pub(super) struct Outline {
    /// First row.
    pub under: Vec<i16>,
    /// Row behind the last.
    over: Vec<i16>,
    pub height: i16,
    /// Rows above it in its box, all columns together.
    above: i64,
}

impl Outline {
    pub fn new(under: Vec<i16>, over: Vec<i16>) -> Outline {
        let height = over.iter().copied().max().unwrap_or(0);
        let above = under.iter().map(|&under| i64::from(under.min(height))).sum();
        Outline { under, over, height, above }
    }

    /// The outline of the chart turned by 180 degrees.
    fn turned(&self) -> Outline {
        let columns = self.under.iter().zip(&self.over).rev();
        let turn = |(&under, &over): (&i16, &i16)| match under < over {
            true => (self.height - over, self.height - under),
            false => (NOTHING, 0),
        };
        let (under, over) = columns.map(turn).unzip();
        Outline::new(under, over)
    }

    /// Texels between the outlines.
    pub fn filled(&self, step: u32) -> f64 {
        let rows = self.under.iter().zip(&self.over).map(|(&under, &over)| i64::from(over - under));
        rows.map(|n| n.max(0)).sum::<i64>() as f64 * f64::from(step)
    }
}

/// A page with charts.
pub(super) struct Filled {
    /// Pieces and their places, gutters included.
    pub places: Vec<(u32, Place)>,
    /// Pieces that have no place, in order.
    pub missed: Vec<u32>,
    pub height: u32,
}

impl Filled {
    pub fn new(
        [width, height]: [u32; 2],
        step: u32,
        pieces: &[u32],
        outlines: &[Outline],
    ) -> Filled {
        let mut page = Horizon::new(width, height, step);
        let (mut places, mut missed, mut n_misses) = (Vec::new(), Vec::new(), 0);
        for (at, &i) in pieces.iter().enumerate() {
            if n_misses >= MOST_MISSES {
                missed.extend_from_slice(&pieces[at..]);
                break;
            }
            match page.put(&outlines[i as usize]) {
                Some(place) => {
                    places.push((i, place));
                    n_misses = 0;
                }
                None => {
                    missed.push(i);
                    n_misses += 1;
                }
            }
        }
        Filled { places, missed, height: page.height() }
    }
}

/// The rows of a page that are taken in each column.
struct Horizon {
    rows: Vec<i16>,
    most: i16,
    step: u32,
    tops: Vec<i16>,
}

impl Horizon {
    fn new(width: u32, most_height: u32, step: u32) -> Horizon {
        let n = (width / step) as usize;
        Horizon { rows: vec![0; n], most: most_height as i16, step, tops: Vec::new() }
    }

    fn height(&self) -> u32 {
        self.rows.iter().copied().max().unwrap_or(0) as u32
    }

    /// Puts a chart where it leaves least room below itself and is not high up, as it is or turned; `None` if it does not
    /// fit.
    fn put(&mut self, outline: &Outline) -> Option<Place> {
        let turned = outline.turned();
        let (own, other) = (self.best(outline), self.best(&turned));
        let is_turned = other.is_some_and(|other| own.is_none_or(|own| other.0 < own.0));
        let (outline, found) = if is_turned { (&turned, other) } else { (outline, own) };
        let (_, x, top) = found?;
        for (row, &over) in self.rows[x..].iter_mut().zip(&outline.over) {
            *row = if over > 0 { (*row).max(top + over) } else { *row };
        }
        let mut corner = [x as u32 * self.step, top as u32];
        if is_turned {
            let size = [outline.over.len() as u32 * self.step, outline.height as u32];
            corner = [0, 1].map(|k| corner[k] + size[k]);
        }
        Some(Place { corner, is_turned })
    }

    /// The best place for an outline: what it costs, its first column and its row.
    fn best(&mut self, outline: &Outline) -> Option<(i64, usize, i16)> {
        let n = outline.under.len();
        let n_places = (self.rows.len() + 1).checked_sub(n)?;
        // The row that the chart drops to at each place.
        self.tops.clear();
        self.tops.resize(n_places, 0);
        for (i, &under) in outline.under.iter().enumerate() {
            for (top, &row) in self.tops.iter_mut().zip(&self.rows[i..]) {
                *top = (*top).max(row - under);
            }
        }
        let mut below: i64 = self.rows[..n].iter().map(|&row| i64::from(row)).sum();
        let mut best: Option<(i64, usize)> = None;
        for (x, &top) in self.tops.iter().enumerate() {
            if top <= self.most - outline.height {
                // Room below, and the rows up to there once more.
                let cost = 2 * n as i64 * i64::from(top) + outline.above - below;
                if best.is_none_or(|(least, _)| cost < least) {
                    best = Some((cost, x));
                }
            }
            if x + n < self.rows.len() {
                below += i64::from(self.rows[x + n]) - i64::from(self.rows[x]);
            }
        }
        best.map(|(cost, x)| (cost, x, self.tops[x]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ```text
    ///  ____     turned, one lies beside the other:
    /// |   /      ____
    /// |  /      |   /|
    /// | /       |  / |
    /// |/        | /  |
    ///           |/___|
    /// ```
    #[test]
    fn a_chart_is_turned_where_that_leaves_less_room() {
        let triangle = || Outline::new(vec![0; 8], (1..=8).rev().map(|row| 4 * row).collect());
        let turned = triangle().turned();
        assert_eq!(turned.under, [28, 24, 20, 16, 12, 8, 4, 0]);
        assert_eq!(turned.over, [32; 8]);
        let page = Filled::new([8, 64], 1, &[0, 1], &[triangle(), triangle()]);
        assert!(page.missed.is_empty());
        assert_eq!(page.height, 36);
        let [(0, first), (1, second)] = page.places[..] else { panic!("{:?}", page.places) };
        assert_ne!(first.is_turned, second.is_turned);
    }
}
