//! Values between two, of which one may be missing: NaN or infinite.

/// The value at the share `t` of the way from `a` to `b`; where one of them is missing, the other one.
#[inline(always)]
pub fn between(a: f32, b: f32, t: f32) -> f32 {
    let value = a + t * (b - a);
    if value.is_finite() { value } else { of_ends(a, b, t) }
}

/// The same where the value between is not finite.
#[cold]
pub fn of_ends(a: f32, b: f32, t: f32) -> f32 {
    let is_inside = t > 0.0 && t < 1.0;
    match (a.is_finite(), b.is_finite()) {
        (true, false) if is_inside => a,
        (false, true) if is_inside => b,
        _ if t < 0.5 => a,
        _ => b,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_takes_the_other_value() {
        assert_eq!(between(1.0, 3.0, 0.25), 1.5);
        for missing in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(between(missing, 3.0, 0.25), 3.0);
            assert_eq!(between(1.0, missing, 0.75), 1.0);
            assert_eq!(between(1.0, missing, 0.0), 1.0);
            assert!(
                !between(missing, 3.0, 0.0).is_finite() && !between(3.0, missing, 1.0).is_finite()
            );
            assert!(!between(missing, missing, 0.5).is_finite());
        }
        assert_eq!(between(f32::MIN, f32::MAX, 0.75), f32::MAX);
    }
}
