//! Outlines of charts, and a page that they drop onto: the rows that are taken in each column.
//!
//! A chart drops as it is or turned by 180 degrees, where it leaves least room below it. That room is kept: smaller charts, which
//! come later, go there first. Knows no triangles and no scale.

use std::collections::BTreeSet;

/// First row of a column that a chart does not cover.
pub(super) const NOTHING: i16 = i16::MAX / 2;

/// Charts that do not fit on a page, one after the other, before nothing more is put on top of it.
const MOST_MISSES: u32 = 48;

/// The same, before it is left.
const ALL_MISSED: u32 = 1024;

/// Rows, and columns, of room between charts that are worth keeping.
const LEAST_GAP: [usize; 2] = [8, 2];

/// Gaps that a chart is tried in, and those that are looked at for their size.
const MOST_TRIED: usize = 8;
const MOST_SEEN: usize = 128;

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
            if n_misses >= ALL_MISSED {
                missed.extend_from_slice(&pieces[at..]);
                break;
            }
            let outline = &outlines[i as usize];
            let ways = [outline, &outline.turned()];
            let mut place = page.put_in_gap(ways);
            if place.is_none() && !page.is_full {
                place = page.put_on_top(ways);
            }
            n_misses = if place.is_some() { 0 } else { n_misses + 1 };
            page.is_full |= n_misses >= MOST_MISSES;
            match place {
                Some(place) => places.push((i, place)),
                None => missed.push(i),
            }
        }
        Filled { places, missed, height: page.height() }
    }
}

/// Room between charts, in some columns of a page.
struct Gap {
    /// Its first column.
    x: usize,
    /// For each column its first row, and the row behind its last.
    rows: Vec<[i16; 2]>,
    /// Rows of the highest column.
    most: i16,
}

impl Gap {
    /// The rooms between rows that are taken from column `x` on and an outline above them.
    fn below(x: usize, taken: &[i16], outline: &Outline, top: i16) -> Vec<Gap> {
        let column = |((&under, &over), &row): ((&i16, &i16), &i16)| {
            [row, if over > 0 { (top + under).max(row) } else { row }]
        };
        let columns = outline.under.iter().zip(&outline.over).zip(taken).map(column);
        let columns: Vec<[i16; 2]> = columns.collect();
        let is_high = |rows: &[i16; 2]| rows[1] - rows[0] >= LEAST_GAP[0] as i16;
        let (mut gaps, mut at) = (Vec::new(), 0);
        for run in columns.chunk_by(|a, b| is_high(a) == is_high(b)) {
            if is_high(&run[0]) && run.len() >= LEAST_GAP[1] {
                gaps.push(Gap { x: x + at, rows: run.to_vec(), most: most_rows(run) });
            }
            at += run.len();
        }
        gaps
    }

    fn size(&self) -> i64 {
        self.rows.iter().map(|[low, high]| i64::from(high - low)).sum()
    }

    /// The first place for an outline: its column within the gap and its row.
    fn place(&self, outline: &Outline) -> Option<(usize, i16)> {
        let columns = || outline.under.iter().zip(&outline.over);
        let place = |(x, rows): (usize, &[[i16; 2]])| {
            let tops = columns().zip(rows).map(|((&under, _), [low, _])| low - under);
            let top = tops.fold(0, i16::max);
            let fits = |((_, &over), [_, high]): ((&i16, &i16), &[i16; 2])| {
                over == 0 || top + over <= *high
            };
            columns().zip(rows).all(fits).then_some((x, top))
        };
        self.rows.windows(outline.under.len()).enumerate().find_map(place)
    }
}

fn most_rows(columns: &[[i16; 2]]) -> i16 {
    columns.iter().map(|[low, high]| high - low).max().unwrap_or(0)
}

/// The rows of a page that are taken in each column.
struct Horizon {
    rows: Vec<i16>,
    most: i16,
    step: u32,
    tops: Vec<i16>,
    /// True if nothing more is put on top.
    is_full: bool,
    gaps: Vec<Gap>,
    /// The gaps by size.
    by_size: BTreeSet<(i64, usize)>,
}

impl Horizon {
    fn new(width: u32, most_height: u32, step: u32) -> Horizon {
        let rows = vec![0; (width / step) as usize];
        let (gaps, by_size) = (Vec::new(), BTreeSet::new());
        let (most, tops) = (most_height as i16, Vec::new());
        Horizon { rows, most, step, tops, is_full: false, gaps, by_size }
    }

    fn height(&self) -> u32 {
        self.rows.iter().copied().max().unwrap_or(0) as u32
    }

    /// The place of a chart, as it is or turned, at a column and a row.
    fn place(&self, outline: &Outline, is_turned: bool, (x, top): (usize, i16)) -> Place {
        let mut corner = [x as u32 * self.step, top as u32];
        if is_turned {
            let size = [outline.over.len() as u32 * self.step, outline.height as u32];
            corner = [0, 1].map(|k| corner[k] + size[k]);
        }
        Place { corner, is_turned }
    }

    fn keep(&mut self, gaps: Vec<Gap>) {
        for gap in gaps {
            self.by_size.insert((gap.size(), self.gaps.len()));
            self.gaps.push(gap);
        }
    }

    /// Puts a chart between others, into the largest gap that it fits into as it is or turned.
    fn put_in_gap(&mut self, ways: [&Outline; 2]) -> Option<Place> {
        let (n, height) = (ways[0].under.len(), ways[0].height);
        let is_wide =
            |&&(_, i): &&(i64, usize)| self.gaps[i].rows.len() >= n && self.gaps[i].most >= height;
        let tried = self.by_size.iter().rev().take(MOST_SEEN).filter(is_wide).take(MOST_TRIED);
        let found = |&(size, i): &(i64, usize)| {
            let way = |way: usize| Some((way, self.gaps[i].place(ways[way])?));
            Some((size, i, way(0).or_else(|| way(1))?))
        };
        let (size, i, (way, (column, top))) = tried.into_iter().find_map(found)?;
        self.by_size.remove(&(size, i));
        let gap = &mut self.gaps[i];
        let x = gap.x + column;
        let outline = ways[way];
        let columns = &mut gap.rows[column..column + n];
        let taken: Vec<i16> = columns.iter().map(|[low, _]| *low).collect();
        for ([low, _], &over) in columns.iter_mut().zip(&outline.over) {
            *low = if over > 0 { (*low).max(top + over) } else { *low };
        }
        gap.most = most_rows(&gap.rows);
        self.by_size.insert((gap.size(), i));
        self.keep(Gap::below(x, &taken, outline, top));
        Some(self.place(outline, way == 1, (x, top)))
    }

    /// Puts a chart on top where it leaves least room below itself and is not high up, as it is or turned; `None` if it does not
    /// fit.
    fn put_on_top(&mut self, ways: [&Outline; 2]) -> Option<Place> {
        let (own, other) = (self.best(ways[0]), self.best(ways[1]));
        let is_turned = other.is_some_and(|other| own.is_none_or(|own| other.0 < own.0));
        let (_, x, top) = if is_turned { other? } else { own? };
        let outline = ways[usize::from(is_turned)];
        let gaps = Gap::below(x, &self.rows[x..], outline, top);
        self.keep(gaps);
        for (row, &over) in self.rows[x..].iter_mut().zip(&outline.over) {
            *row = if over > 0 { (*row).max(top + over) } else { *row };
        }
        Some(self.place(outline, is_turned, (x, top)))
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
                // Room below, and the rows up to there twice more.
                let cost = 3 * n as i64 * i64::from(top) + outline.above - below;
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

    /// ```text
    ///  ________
    /// |________|   the wide one lies on the high one, and leaves room
    /// |  |  ___    beside it: two small ones lie there
    /// |  | |___|
    /// |__| |___|
    /// ```
    #[test]
    fn small_charts_go_below_wide_ones() {
        let chart = |n: usize, rows: i16| Outline::new(vec![0; n], vec![rows; n]);
        let charts = [chart(4, 30), chart(16, 29), chart(10, 14), chart(10, 14), chart(10, 14)];
        let page = Filled::new([16, 64], 1, &[0, 1, 2, 3, 4], &charts);
        let corners = page.places.iter().map(|(_, place)| place.corner);
        assert_eq!(corners.collect::<Vec<_>>(), [[0, 0], [0, 30], [4, 0], [4, 14]]);
        assert_eq!((page.missed, page.height), (vec![4], 59));
    }
}
