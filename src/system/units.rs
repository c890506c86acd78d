//! Numbers as people type them: `4M` triangles, `512MiB` of memory, `1%`.

/// Parses a count: `4M`, `500k`, `1.5G`, `20000`. Powers of 1000; a fraction of one is refused.
pub fn parse_count(text: &str) -> Result<u64, String> {
    let (number, suffix) = split(text);
    // Some put a dot between thousands.
    if suffix.is_empty() && number.rsplit_once('.').is_some_and(|(_, end)| end.len() == 3) {
        return Err(format!("invalid count '{text}': write {}", number.replace('.', "")));
    }
    let factor = match suffix {
        "" => 1.0,
        "k" | "K" => 1e3,
        "m" | "M" => 1e6,
        "g" | "G" => 1e9,
        _ => return Err(format!("invalid count '{text}': write 20000, 500k, 4M or 1.5G")),
    };
    number_times(number, factor)
        .filter(|value| (value - value.round()).abs() <= 1e-9 * value)
        .map(|value| value.round() as u64)
        .ok_or_else(|| format!("invalid count '{text}': write 20000, 500k, 4M or 1.5G"))
}

/// Parses a size in bytes: `512MiB`, `4GiB`, `2G`, `100kB`. KiB/MiB/GiB/TiB are powers of 1024.
pub fn parse_bytes(text: &str) -> Result<u64, String> {
    let (number, suffix) = split(text);
    let factor = match suffix {
        "" | "B" => 1.0,
        "k" | "K" | "kB" | "KB" => 1e3,
        "M" | "MB" => 1e6,
        "G" | "GB" => 1e9,
        "T" | "TB" => 1e12,
        "KiB" | "Ki" => 1024.0,
        "MiB" | "Mi" => 1024.0 * 1024.0,
        "GiB" | "Gi" => 1024.0 * 1024.0 * 1024.0,
        "TiB" | "Ti" => 1024.0 * 1024.0 * 1024.0 * 1024.0,
        _ => return Err(format!("invalid size '{text}': write 512MiB, 4GiB or 2G")),
    };
    number_times(number, factor)
        // Half a byte is a slip; the rest of 0.1GiB is not.
        .filter(|value| factor > 1.0 || value.fract() == 0.0)
        .map(|value| value.round() as u64)
        .ok_or_else(|| format!("invalid size '{text}': write 512MiB, 4GiB or 2G"))
}

/// Parses a ratio in (0, 1]: `1%`, `0.01`.
pub fn parse_ratio(text: &str) -> Result<f64, String> {
    let complaint = || format!("invalid ratio '{text}': write 1% or 0.01 (above 0, at most 1)");
    let (number, factor) = match text.strip_suffix('%') {
        Some(number) => (number, 0.01),
        None => (text, 1.0),
    };
    let value = number.trim().parse::<f64>().map_err(|_| complaint())? * factor;
    match value {
        // 5 is meant to be 5 %.
        _ if value > 1.0 && factor == 1.0 => {
            Err(format!("{}; 1 is all, {text} % is {text}%", complaint()))
        }
        _ if value > 0.0 && value <= 1.0 => Ok(value),
        _ => Err(complaint()),
    }
}

/// A count for people: `34.6 M`.
pub fn show_count(count: u64) -> String {
    match count {
        0..10_000 => count.to_string(),
        10_000..1_000_000 => format!("{:.1} k", count as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.2} M", count as f64 / 1e6),
        _ => format!("{:.2} G", count as f64 / 1e9),
    }
}

/// A length with `digits` digits after the first, not above it (`direction` -1) or not below it (1).
pub fn show_outward(length: f64, direction: i64, digits: usize) -> String {
    let text = format!("{length:.digits$e}");
    let shown: f64 = text.parse().unwrap_or(length);
    if (shown - length) * direction as f64 >= 0.0 || length == 0.0 || !length.is_finite() {
        return text;
    }
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let one = 10i64.pow(digits as u32);
    let last = mantissa.replace('.', "").parse::<i64>().unwrap_or(0) + direction;
    let (last, exponent) = match (last, exponent.parse::<i64>().unwrap_or(0)) {
        (last, exponent) if last < one => (10 * one - 1, exponent - 1),
        (last, exponent) if last >= 10 * one => (one, exponent + 1),
        both => both,
    };
    format!("{}.{:0digits$}e{exponent}", last / one, last % one)
}

/// A length for people, in at most some twenty characters: `0.2`, `1e300`.
pub fn show_length(length: f64) -> String {
    if length == 0.0 || (1e-4..1e7).contains(&length.abs()) {
        format!("{length}")
    } else {
        format!("{length:e}")
    }
}

/// A share for people: `0.0001 %`, to six digits.
pub fn show_share(share: f64) -> String {
    let percent = 100.0 * share;
    format!("{} %", show_length(format!("{percent:.5e}").parse().unwrap_or(percent)))
}

/// A size as `--memory` takes it, not below it: `513MiB`. What is named so is enough when it is given back.
pub fn memory_word(bytes: u64) -> String {
    let mebibytes = bytes.div_ceil(1 << 20).max(1);
    match mebibytes {
        0..8192 => format!("{mebibytes}MiB"),
        _ => format!("{}GiB", mebibytes.div_ceil(1024)),
    }
}

/// A size for people: `512.0 MiB`.
pub fn show_bytes(bytes: u64) -> String {
    const UNITS: [&str; 5] = ["B", "KiB", "MiB", "GiB", "TiB"];
    let mut value = bytes as f64;
    let mut unit = 0;
    while value >= 1024.0 && unit + 1 < UNITS.len() {
        value /= 1024.0;
        unit += 1;
    }
    if unit == 0 { format!("{bytes} B") } else { format!("{value:.1} {}", UNITS[unit]) }
}

fn split(text: &str) -> (&str, &str) {
    let text = text.trim();
    let end = text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len());
    (text[..end].trim(), &text[end..])
}

fn number_times(number: &str, factor: f64) -> Option<f64> {
    let value = number.replace('_', "").parse::<f64>().ok()? * factor;
    (0.0..9.0e18).contains(&value).then_some(value)
}

/// A time in seconds since 1970 as date and hour, UTC.
///
/// Source: Hinnant, "chrono-compatible low-level date algorithms", `civil_from_days`.
pub fn show_time(seconds: u64) -> String {
    let (days, second) = (seconds / 86_400, seconds % 86_400);
    let shifted = days + 719_468;
    let (era, of_era) = (shifted / 146_097, shifted % 146_097);
    let year = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = year + era * 400 + u64::from(month <= 2);
    let (hour, minute) = (second / 3600, second / 60 % 60);
    format!("{year}-{month:02}-{day:02} {hour:02}:{minute:02}:{:02} UTC", second % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_shown_outward() {
        assert_eq!(show_outward(0.00123412, 1, 4), "1.2342e-3");
        assert_eq!(show_outward(0.00123412, -1, 4), "1.2341e-3");
        assert_eq!(show_outward(9.99999, 1, 3), "1.000e1");
        assert_eq!(show_outward(9.99999, -1, 3), "9.999e0");
        assert_eq!(show_outward(1.0000001, -1, 3), "1.000e0");
        assert_eq!(show_outward(0.0, 1, 3), "0.000e0");
        for k in 0..2000 {
            let length = 1.7f64.powi(k % 90 - 40) * (1.0 + f64::from(k) * 1e-7);
            let [low, high]: [f64; 2] =
                [-1, 1].map(|d| show_outward(length, d, 5).parse().unwrap());
            assert!(low <= length && length <= high && high - low <= 2e-5 * length, "{length}");
        }
    }

    #[test]
    fn counts_sizes_and_ratios_are_read_as_people_write_them() {
        assert_eq!(parse_count("4M"), Ok(4_000_000));
        assert_eq!(parse_count("1.5k"), Ok(1500));
        assert_eq!(parse_count("200_000"), Ok(200_000));
        assert_eq!(parse_bytes("512MiB"), Ok(512 << 20));
        assert_eq!(parse_bytes("2G"), Ok(2_000_000_000));
        assert_eq!(parse_ratio("1%"), Ok(0.01));
        assert_eq!(parse_ratio("1"), Ok(1.0));
        assert_eq!(parse_count("1.1k"), Ok(1100));
        assert_eq!(parse_bytes("0.1KiB"), Ok(102));
        assert_eq!(show_length(0.2), "0.2");
        assert_eq!(show_length(1e300), "1e300");
        for wrong in ["1.5", "0.3", "1.2345k", "1e-3", "10.000"] {
            assert!(parse_count(wrong).is_err(), "{wrong}");
        }
        assert!(parse_bytes("1.5").is_err());
        for wrong in ["", "-4", "4X", "NaN", "inf", "1e400"] {
            assert!(parse_count(wrong).is_err(), "{wrong}");
            assert!(parse_bytes(wrong).is_err(), "{wrong}");
        }
        for wrong in ["0", "101%", "NaN", "-1%", ""] {
            assert!(parse_ratio(wrong).is_err(), "{wrong}");
        }
    }
}
