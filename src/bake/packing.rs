//! Charts on pages: the scale, the gutters and the places.
//!
//! Charts have no unit; the scale is looked for here, by packing again. A chart is placed by its outline: what it covers
//! from above and from below in each column. It goes between the charts that are there already, or drops onto them, as it is or turned
//! by 180 degrees, where it leaves least room below it. There is a place for every number of charts: where texels are fewer than charts, charts share them.

use super::flatten::Flat;
use super::horizon::{Filled, NOTHING, Outline, Place};
use super::settings::{NONE, padding};
use std::ops::Range;
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// Sides of cropped pages are multiples of this: halves of them down to 1/16 are whole, and so are compressed blocks.
const SIDE_STEP: u32 = 16;

/// Attempts to find the largest scale that fits.
const MOST_TRIES: u32 = 12;

/// A scale is not looked for between one that fits and another that is larger by no more than this factor.
const CLOSE_ENOUGH: f64 = 1.015;

/// Share of a page that charts with their gutters cover where they are packed well, for a first guess.
const COVERED: f64 = 0.88;

/// Texels that pages may have for the sake of wide gutters.
const FREE_TEXELS: f64 = (1u64 << 18) as f64;

/// Gutters make charts larger by this factor at most, or are made narrower, down to a texel on each side.
const MOST_GUTTER: f64 = 1.3;

/// Columns of a chart's outline, about, for charts of the mean size.
const COLUMNS: f64 = 24.0;

/// Widths that a page of any size is tried in.
const MOST_WIDTHS: u32 = 8;

/// Triangles on pages.
pub(super) struct Packed {
    /// Width and height of each page in texels.
    pub pages: Vec<[u32; 2]>,
    /// For each triangle its page.
    pub page: Vec<u32>,
    /// For each triangle its chart; `NONE` without an area.
    pub chart: Vec<u32>,
    /// For each triangle its corners in texels, from the upper left corner of its page.
    pub corners: Vec<[[f32; 2]; 3]>,
    pub n_charts: u64,
    pub texels_per_unit: f64,
}

/// Pages that are wanted.
#[derive(Clone, Copy)]
pub(super) struct Wanted {
    pub page_size: u32,
    pub most_pages: Option<u32>,
    /// Texels per unit of length at most.
    pub texels_per_unit: f64,
}

/// A chart, or a part of one that is wider than a page.
#[derive(Clone, Debug)]
struct Piece {
    /// Place of its triangles in the order by charts.
    triangles: Range<usize>,
    low: [f64; 2],
    /// In texels.
    size: [f64; 2],
    /// Texels per unit of length.
    scale: f64,
}

/// Pieces at a scale.
struct Pieces {
    /// Triangles, piece by piece.
    order: Vec<u32>,
    pieces: Vec<Piece>,
    gutter: u32,
}

/// Pages and the places of pieces on them.
struct Layout {
    pages: Vec<[u32; 2]>,
    /// For each piece its page and its place there.
    places: Vec<(u32, Place)>,
}

/// Packs charts at the scale that is wanted, or at about the largest that fits.
pub(super) fn pack(flat: &Flat, wanted: Wanted, progress: &Progress) -> Result<Packed> {
    let most = wanted.most_pages.map_or(usize::MAX, |most| most.max(1) as usize);
    let at = |scale: f64| -> Result<Option<(Pieces, Layout)>> {
        progress.check()?;
        let pieces = Pieces::cut(flat, scale, wanted.page_size);
        Ok(pieces.placed(flat, wanted.page_size, most).map(|layout| (pieces, layout)))
    };
    if let Some(found) = at(wanted.texels_per_unit)? {
        return Ok(found.0.packed(flat, found.1, wanted.texels_per_unit));
    }
    let area: f64 = flat.corners.iter().map(area).sum();
    let room = most as f64 * f64::from(wanted.page_size).powi(2);
    let guess = (COVERED * room / area).sqrt();
    let (mut fitting, mut too_large) = (None::<(f64, (Pieces, Layout))>, wanted.texels_per_unit);
    let mut scale = if guess < 0.98 * too_large { guess } else { 0.95 * too_large };
    let mut step = 0.9;
    for _ in 0..MOST_TRIES {
        match at(scale)? {
            Some(found) => fitting = Some((scale, found)),
            None => too_large = scale,
        }
        scale = match &fitting {
            Some((fitting, _)) if too_large <= CLOSE_ENOUGH * fitting => break,
            Some((fitting, _)) => (fitting * too_large).sqrt(),
            None => {
                // 0.9, 0.81, 0.66, 0.43, 0.19, ...: soon at charts of a texel.
                let next = scale * step;
                step *= step;
                next
            }
        };
    }
    if let Some((scale, found)) = fitting {
        return Ok(found.0.packed(flat, found.1, scale));
    }
    let pieces = Pieces::cut(flat, f64::MIN_POSITIVE.sqrt(), wanted.page_size);
    let layout = pieces.crowded(wanted.page_size, most);
    Ok(pieces.packed(flat, layout, scale))
}

fn area(t: &[[f32; 2]; 3]) -> f64 {
    super::grid::area(t)
}

impl Pieces {
    /// Charts at a scale; those that are wider than a page are cut, and what cannot be cut is made smaller.
    fn cut(flat: &Flat, scale: f64, page_size: u32) -> Pieces {
        let mut order: Vec<u32> =
            (0u32..).take(flat.chart.len()).filter(|&t| flat.chart[t as usize] != NONE).collect();
        order.sort_by_key(|&t| (flat.chart[t as usize], t));
        let most = f64::from(page_size - 2 * padding(page_size)) - 1.0;
        let mut pieces = Vec::with_capacity(flat.n_charts as usize);
        let mut start = 0;
        let mut open: Vec<Range<usize>> = Vec::new();
        while start < order.len() {
            let chart = flat.chart[order[start] as usize];
            let end = start + order[start..].partition_point(|&t| flat.chart[t as usize] == chart);
            open.push(start..end);
            while let Some(range) = open.pop() {
                let mut piece = Piece::of(flat, &order, range.clone(), scale);
                let wide = usize::from(piece.size[1] > piece.size[0]);
                if piece.size[wide] > most && range.len() > 1 {
                    // Halved by the middles of its triangles.
                    let middle = range.start + range.len() / 2;
                    let at = |t: u32| {
                        flat.corners[t as usize].iter().map(|p| f64::from(p[wide])).sum::<f64>()
                    };
                    order[range.clone()].select_nth_unstable_by(range.len() / 2, |&a, &b| {
                        at(a).total_cmp(&at(b)).then(a.cmp(&b))
                    });
                    order[range.start..middle].sort_unstable();
                    order[middle..range.end].sort_unstable();
                    open.push(middle..range.end);
                    open.push(range.start..middle);
                    continue;
                }
                if piece.size[wide] > most {
                    let smaller = most / piece.size[wide];
                    piece.scale *= smaller;
                    piece.size = piece.size.map(|side| side * smaller);
                }
                pieces.push(piece);
            }
            start = end;
        }
        let gutter = gutter(&pieces, page_size);
        Pieces { order, pieces, gutter }
    }

    /// Places all pieces; `None` if they take more than `most` pages.
    fn placed(&self, flat: &Flat, page_size: u32, most: usize) -> Option<Layout> {
        let gutter = f64::from(self.gutter);
        let boxes: f64 = self.pieces.iter().map(|piece| piece.n_texels(gutter)).sum();
        let covered = |piece: &Piece| -> f64 {
            let all: f64 = self.order[piece.triangles.clone()]
                .iter()
                .map(|&t| area(&flat.corners[t as usize]))
                .sum();
            all * piece.scale * piece.scale + 2.0 * gutter * (piece.size[0] + piece.size[1])
        };
        let room = (most as f64) * f64::from(page_size).powi(2);
        let filled: f64 = self.pieces.iter().map(covered).sum();
        if filled > room {
            return None;
        }
        let mean = (boxes / self.pieces.len().max(1) as f64).sqrt();
        let mut step = ((mean / COLUMNS).max(1.0) as u32).next_power_of_two().min(SIDE_STEP);
        while !page_size.is_multiple_of(step) {
            step /= 2;
        }
        let outlines: Vec<Outline> =
            self.pieces.iter().map(|piece| self.outline(flat, piece, step)).collect();
        let mut left: Vec<u32> = (0..self.pieces.len() as u32).collect();
        left.sort_by_key(|&i| {
            let outline = &outlines[i as usize];
            (std::cmp::Reverse((outline.height, outline.under.len())), i)
        });
        let mut out =
            Layout { pages: Vec::new(), places: vec![(0, Place::default()); self.pieces.len()] };
        let mut filled: f64 = left.iter().map(|&i| outlines[i as usize].filled(step)).sum();
        while !left.is_empty() {
            if out.pages.len() >= most {
                return None;
            }
            let number = out.pages.len() as u32;
            let widest = left
                .iter()
                .map(|&i| outlines[i as usize].under.len() as u32 * step)
                .max()
                .unwrap_or(0);
            // The last page is about as high as it is wide: of several widths that hold all, that of the smallest page.
            let side = (filled / COVERED).sqrt().min(f64::from(page_size)) as u32;
            let mut width = side.max(widest).next_multiple_of(SIDE_STEP).min(page_size);
            let mut best: Option<(u32, Filled)> = None;
            let mut n_tries = 0;
            loop {
                let found = Filled::new([width, page_size], step, &left, &outlines);
                let is_whole = found.missed.is_empty();
                let is_less = |(least, best): &(u32, Filled)| {
                    !best.missed.is_empty() || width * found.height < least * best.height
                };
                if best.as_ref().is_none_or(is_less) {
                    best = Some((width, found));
                }
                n_tries += u32::from(is_whole);
                let is_enough = is_whole && (most < usize::MAX || n_tries >= MOST_WIDTHS);
                if is_enough || width >= page_size {
                    break;
                }
                width = (width + width / 10).next_multiple_of(SIDE_STEP).min(page_size);
            }
            let (width, found) = best?;
            if found.missed.len() == left.len() {
                return None;
            }
            for (i, Place { corner, is_turned }) in found.places {
                let corner = match is_turned {
                    true => corner.map(|at| at - self.gutter),
                    false => corner.map(|at| at + self.gutter),
                };
                out.places[i as usize] = (number, Place { corner, is_turned });
            }
            out.pages.push([width, found.height.next_multiple_of(SIDE_STEP).min(page_size)]);
            left = found.missed;
            filled = left.iter().map(|&i| outlines[i as usize].filled(step)).sum();
        }
        if out.pages.is_empty() {
            out.pages.push([SIDE_STEP; 2]);
        }
        Some(out)
    }

    /// Outline of a piece in columns of `step` texels, gutters included.
    fn outline(&self, flat: &Flat, piece: &Piece, step: u32) -> Outline {
        let gutter = f64::from(self.gutter);
        let [width, height] = piece.size.map(|side| side.ceil().max(1.0) as u32 + 2 * self.gutter);
        let n = width.div_ceil(step) as usize;
        let (mut under, mut over) = (vec![f64::from(height); n], vec![0.0f64; n]);
        let column = |x: f64| ((x / f64::from(step)).max(0.0) as usize).min(n - 1);
        for &t in &self.order[piece.triangles.clone()] {
            let t = flat.corners[t as usize]
                .map(|p| [0, 1].map(|k| piece.scale * (f64::from(p[k]) - piece.low[k]) + gutter));
            for k in 0..3 {
                let (a, b) = if t[k][0] <= t[(k + 1) % 3][0] {
                    (t[k], t[(k + 1) % 3])
                } else {
                    (t[(k + 1) % 3], t[k])
                };
                // All columns that the gutter beside the edge reaches, as far as the edge has a height there.
                for c in column(a[0] - gutter)..=column(b[0] + gutter) {
                    let from = (f64::from(step) * c as f64 - gutter).clamp(a[0], b[0]);
                    let to = (f64::from(step) * (c + 1) as f64 + gutter).clamp(a[0], b[0]);
                    let y = |x: f64| {
                        if b[0] > a[0] {
                            a[1] + (x - a[0]) / (b[0] - a[0]) * (b[1] - a[1])
                        } else {
                            a[1]
                        }
                    };
                    let (mut low, mut high) = (y(from).min(y(to)), y(from).max(y(to)));
                    if b[0] <= a[0] {
                        (low, high) = (a[1].min(b[1]), a[1].max(b[1]));
                    }
                    under[c] = under[c].min(low - gutter);
                    over[c] = over[c].max(high + gutter);
                }
            }
        }
        // A column that nothing covers is in the way of nothing.
        let whole = |y: f64| y.clamp(0.0, f64::from(height)) as i16;
        let outline = |under: f64, over: f64| match under < over {
            true => (whole(under.floor()), whole(over.ceil())),
            false => (NOTHING, 0),
        };
        let (under, over): (Vec<i16>, Vec<i16>) =
            under.into_iter().zip(over).map(|(under, over)| outline(under, over)).unzip();
        Outline::new(under, over)
    }

    /// Pages on which charts share texels, as many charts as it takes: neighbours first.
    fn crowded(&self, page_size: u32, most: usize) -> Layout {
        let room = most as u64 * u64::from(page_size).pow(2);
        let n = self.pieces.len() as u64;
        let shared = n.div_ceil(room.max(1)).max(1);
        let place = |i: u64| {
            let texel = i / shared;
            let (page, at) =
                (texel / u64::from(page_size).pow(2), texel % u64::from(page_size).pow(2));
            let corner = [at % u64::from(page_size), at / u64::from(page_size)].map(|x| x as u32);
            (page as u32, Place { corner, is_turned: false })
        };
        let places: Vec<_> = (0..n).map(place).collect();
        let n_pages = places.last().map_or(1, |(page, _)| page + 1);
        Layout { pages: vec![[page_size; 2]; n_pages as usize], places }
    }

    fn packed(self, flat: &Flat, layout: Layout, texels_per_unit: f64) -> Packed {
        let n = flat.chart.len();
        let mut out = Packed {
            pages: layout.pages,
            page: vec![0; n],
            chart: vec![NONE; n],
            corners: vec![[[0.0; 2]; 3]; n],
            n_charts: self.pieces.len() as u64,
            texels_per_unit,
        };
        for (number, (piece, (page, place))) in self.pieces.iter().zip(&layout.places).enumerate() {
            // What is smaller than a texel lies in its middle.
            let sign = if place.is_turned { -1.0 } else { 1.0 };
            let off = [0, 1].map(|k| {
                f64::from(place.corner[k]) + sign * ((1.0 - piece.size[k]) / 2.0).max(0.0)
            });
            for &t in &self.order[piece.triangles.clone()] {
                let t = t as usize;
                (out.page[t], out.chart[t]) = (*page, number as u32);
                out.corners[t] = flat.corners[t].map(|p| {
                    let at = |k: usize| sign * piece.scale * (f64::from(p[k]) - piece.low[k]);
                    [0, 1].map(|k| (off[k] + at(k)) as f32)
                });
            }
        }
        out
    }
}

impl Piece {
    fn of(flat: &Flat, order: &[u32], triangles: Range<usize>, scale: f64) -> Piece {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for p in order[triangles.clone()].iter().flat_map(|&t| flat.corners[t as usize]) {
            for k in 0..2 {
                (low[k], high[k]) = (low[k].min(f64::from(p[k])), high[k].max(f64::from(p[k])));
            }
        }
        Piece { triangles, low, size: [0, 1].map(|k| scale * (high[k] - low[k])), scale }
    }

    /// Texels of its box with a gutter around.
    fn n_texels(&self, gutter: f64) -> f64 {
        let [width, height] = self.size.map(|side| side.ceil().max(1.0) + 2.0 * gutter);
        width * height
    }
}

/// The gutter of charts: wide where that costs little.
fn gutter(pieces: &[Piece], page_size: u32) -> u32 {
    let all =
        |gutter: u32| pieces.iter().map(|piece| piece.n_texels(f64::from(gutter))).sum::<f64>();
    let most = (MOST_GUTTER * all(0)).max(FREE_TEXELS.min(f64::from(page_size).powi(2) / 4.0));
    let mut gutter = padding(page_size).max(1);
    while gutter > 1 && all(gutter) > most {
        gutter /= 2;
    }
    gutter
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::each_point;
    use std::collections::BTreeMap;

    /// Charts of one triangle each, of many sizes and shapes.
    fn triangles(n: u32) -> Flat {
        let side = |i: u32| 1.0 + (i.wrapping_mul(2_654_435_761) >> 20) as f32 / 256.0;
        let corners = (0..n)
            .map(|i| [[0.0, 0.0], [side(i), 0.3], [0.4 * side(i + 7), side(i + n)]])
            .collect();
        Flat { chart: (0..n).collect(), corners, n_charts: n }
    }

    fn wanted(page_size: u32, most_pages: Option<u32>, texels_per_unit: f64) -> Wanted {
        Wanted { page_size, most_pages, texels_per_unit }
    }

    /// No texel belongs to two charts, and none lies outside of its page.
    fn check(packed: &Packed) -> u64 {
        let mut owner: BTreeMap<(u32, u32, u32), u32> = BTreeMap::new();
        for (t, corners) in packed.corners.iter().enumerate() {
            let [width, height] = packed.pages[packed.page[t] as usize].map(|side| side as f32);
            assert!(
                corners.iter().all(|&[x, y]| x >= 0.0 && x <= width && y >= 0.0 && y <= height)
            );
            each_point(&corners.map(|p| p.map(f64::from)), 2, 0..u32::MAX, |x, y, _| {
                let place = (packed.page[t], y as u32, x as u32);
                assert_eq!(*owner.entry(place).or_insert(packed.chart[t]), packed.chart[t]);
            });
        }
        owner.len() as u64
    }

    #[test]
    fn charts_share_no_texel_at_any_size() {
        for (page_size, most) in [(512, None), (512, Some(1)), (256, Some(2)), (64, Some(3))] {
            let packed =
                pack(&triangles(300), wanted(page_size, most, 12.0), &Progress::default()).unwrap();
            assert!(packed.pages.len() <= most.unwrap_or(u32::MAX) as usize);
            assert!(packed.texels_per_unit <= 12.0);
            let n = check(&packed);
            assert!(n > 300, "{n}");
        }
    }

    #[test]
    fn more_charts_than_texels_share_them() {
        let packed =
            pack(&triangles(9000), wanted(64, Some(1), 50.0), &Progress::default()).unwrap();
        assert_eq!(packed.pages, [[64, 64]]);
        for corners in &packed.corners {
            assert!(corners.as_flattened().iter().all(|x| (0.0..=64.0).contains(x)));
        }
    }

    #[test]
    fn a_chart_that_is_wider_than_a_page_is_cut() {
        let corners = (0..400).map(|i| {
            let x = i as f32;
            [[x, 0.0], [x + 1.0, 0.0], [x, 3.0]]
        });
        let flat = Flat { chart: vec![0; 400], corners: corners.collect(), n_charts: 1 };
        let packed = pack(&flat, wanted(256, None, 4.0), &Progress::default()).unwrap();
        assert_eq!(packed.texels_per_unit, 4.0);
        assert!(packed.n_charts >= 7, "{}", packed.n_charts);
        check(&packed);
    }
}
