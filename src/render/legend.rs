//! The scale of a picture that is painted by a number of its vertices: where it ends, and how it is shown.

use super::picture::{Letters, Picture, text_width};
use super::scene::find;
use super::view::Scale;
use stonecut_io::ply::MeshSource;
use stonecut_mesh::property::{Origin, read_scalar};
use stonecut_mesh::viridis::viridis;
use stonecut_system::error::{Error, Result};
use stonecut_system::progress::Progress;

/// The share of vertices that the scale covers; the few beyond it have the colour of its end.
const COVERED: f64 = 0.999;

/// Upper bits of an `f32` that tell values apart when they are counted: to 0.8 %.
const COUNTED_BITS: u32 = 16;

/// Width of the bar in pixels, and the distance to the edges of the picture.
const BAR: (u32, u32) = (220, 12);
const MARGIN: u32 = 16;

/// Letters and frame, as those of captions.
const INK: [u8; 3] = [45, 50, 58];

/// Returns the upper end of a scale for a property of vertices: the value that 99.9 % of them do not exceed, rounded up to two
/// digits; 0 if all are 0. Values below 0 and those that are not numbers do not count.
///
/// Fails if there is no such property, naming those there are.
pub fn top_of(source: &MeshSource, property: &str, progress: &Progress) -> Result<f64> {
    let Some((at, scalar)) = find(source, property) else {
        let own = source.schema().properties.iter().filter(|p| p.origin == Origin::Vertex);
        let names: Vec<&str> = own.map(|p| p.name.as_str()).collect();
        let others = match names.is_empty() {
            true => "none besides the position".to_owned(),
            false => names.join(", "),
        };
        let what =
            format!("its vertices have no property '{property}' to paint by; they have {others}");
        return Err(Error::bad_input(source.path(), what));
    };
    let mut counts = vec![0u64; 1 << COUNTED_BITS];
    let (mut n, mut largest) = (0u64, 0f64);
    source.each_vertex_block(|block| {
        progress.check()?;
        for record in block.records.chunks_exact(source.schema().record_bytes()) {
            let value = read_scalar(scalar, record, at);
            if value >= 0.0 && value.is_finite() {
                counts[((value as f32).to_bits() >> (32 - COUNTED_BITS)) as usize] += 1;
                largest = largest.max(value);
                n += 1;
            }
        }
        Ok(())
    })?;
    let mut left = ((1.0 - COVERED) * n as f64) as u64;
    let mut last = 0;
    for (bits, &count) in counts.iter().enumerate().rev().filter(|(_, count)| **count > 0) {
        last = bits as u32;
        if count > left {
            break;
        }
        left -= count;
    }
    let end = f64::from(f32::from_bits(((last + 1) << (32 - COUNTED_BITS)) - 1));
    Ok(two_digits_up(end.min(largest)))
}

/// The least number of two digits that is not below `value`.
fn two_digits_up(value: f64) -> f64 {
    if !(value > 0.0 && value.is_finite()) {
        return 0.0;
    }
    let shown =
        |digits: f64, exponent: i32| format!("{digits}e{exponent}").parse().unwrap_or(value);
    let exponent = value.log10().floor() as i32 - 1;
    let digits = (value / 10f64.powi(exponent)).ceil();
    let rounded: f64 = shown(digits, exponent);
    if rounded >= value { rounded } else { shown(digits + 1.0, exponent) }
}

/// Draws the bar with its ends into the lower left corner, as far as there is room.
pub(super) fn draw(scale: &Scale, picture: &mut Picture) {
    let letters = Letters::Small;
    let (width, height) = (BAR.0.min(picture.width.saturating_sub(2 * MARGIN)), BAR.1);
    let line = letters.height() + 2;
    let Some(top) = picture.height.checked_sub(MARGIN + height + 2 * line) else { return };
    if width < 2 {
        return;
    }
    let (left, bar) = (MARGIN, top + line);
    for y in bar..bar + height {
        for x in left..left + width {
            let is_frame = y == bar || y + 1 == bar + height || x == left || x + 1 == left + width;
            let share = f64::from(x - left) / f64::from(width - 1);
            let color = if is_frame { INK } else { viridis(share, 1.0) };
            let at = (y * picture.width + x) as usize * 3;
            picture.rgb[at..at + 3].copy_from_slice(&color);
        }
    }
    let end = match scale.top {
        top if top != 0.0 && !(1e-3..1e5).contains(&top) => format!("{top:e}"),
        top => format!("{top}"),
    };
    picture.write_text(&scale.property, (left, top), letters, INK);
    picture.write_text("0", (left, bar + height + 2), letters, INK);
    let right = (left + width).saturating_sub(text_width(&end, letters));
    picture.write_text(&end, (right, bar + height + 2), letters, INK);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_of_scales_have_two_digits_and_are_not_below() {
        for (value, end) in [(0.0, 0.0), (1.0, 1.0), (0.1234, 0.13), (99.1, 100.0), (5e-8, 5e-8)] {
            assert_eq!(two_digits_up(value), end, "{value}");
        }
        for i in 1..2000 {
            let value = 1.0173f64.powi(i - 1000);
            let end = two_digits_up(value);
            assert!(end >= value && end <= 1.11 * value, "{value} {end}");
        }
    }
}
