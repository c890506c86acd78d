//! Colours of a length on a scale: viridis, even in lightness to every kind of eye.

/// The colour of a value on a scale from 0 to `top`; what is beyond has the colour of the end.
pub fn viridis(value: f64, top: f64) -> [u8; 3] {
    let share = if top > 0.0 { (value / top).clamp(0.0, 1.0) } else { 0.0 };
    let share = if share.is_finite() { share } else { 1.0 };
    let colour = colorous::VIRIDIS.eval_continuous(share);
    [colour.r, colour.g, colour.b]
}
