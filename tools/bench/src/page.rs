//! Markdown: tables and the words for numbers in them.

use crate::record::{Row, Spread};
use std::fmt::Write;

/// A table; cells may be empty.
pub fn table(headers: &[&str], rows: &[Vec<String>]) -> String {
    let mut text = format!("| {} |\n|{}\n", headers.join(" | "), "---|".repeat(headers.len()));
    for row in rows {
        let _ = writeln!(text, "| {} |", row.join(" | "));
    }
    text
}

/// A number with three significant digits or so; `-` for none.
pub fn number(value: Option<f64>) -> String {
    match value {
        None => "-".to_owned(),
        Some(v) if !v.is_finite() => "-".to_owned(),
        Some(0.0) => "0".to_owned(),
        Some(v) if v.abs() >= 100.0 => format!("{v:.0}"),
        Some(v) if v.abs() >= 10.0 => format!("{v:.1}"),
        Some(v) if v.abs() >= 0.01 => format!("{v:.3}"),
        Some(v) => format!("{v:.3e}"),
    }
}

/// A median, with its ends where there were several runs.
pub fn spread(value: Option<Spread>) -> String {
    match value {
        None => "-".to_owned(),
        Some(s) if s.min == s.max => number(Some(s.median)),
        Some(s) => {
            let all = [s.median, s.min, s.max].map(|v| number(Some(v)));
            format!("{} ({} to {})", all[0], all[1], all[2])
        }
    }
}

/// Bytes in MiB.
pub fn mib(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |bytes| format!("{:.0}", bytes / f64::from(1 << 20)))
}

/// A count with commas.
pub fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// What each tool took: one row a tool and target.
pub fn cost_table(rows: &[&Row]) -> String {
    let headers = [
        "tool",
        "version",
        "target",
        "triangles",
        "wall s",
        "user s",
        "system s",
        "M tri/s, end to end",
        "M tri/s a core, alone",
        "peak MiB",
        "B/tri beyond input",
        "read MiB",
        "written MiB",
        "temp B/tri",
    ];
    let cells = rows.iter().map(|row| {
        let mut cells = vec![label(row), row.version.clone(), count(row.target)];
        if !row.trouble.is_empty() {
            cells.push(row.trouble.clone());
            cells.resize(headers.len(), String::new());
            return cells;
        }
        let n = row.triangles_in as f64;
        cells.extend([
            row.quality.as_ref().map_or_else(|| "-".to_owned(), |q| count(q.after.triangles)),
            spread(row.spread(|r| r.usage.wall)),
            spread(row.spread(|r| r.usage.user)),
            spread(row.spread(|r| r.usage.system)),
            number(row.triangles_per_second().map(|v| v / 1e6)),
            number(row.core_seconds().map(|s| n / s.median / 1e6)),
            mib(row.spread(|r| r.usage.rss_bytes as f64).map(|s| s.median)),
            number(extra_bytes(row)),
            mib(row.spread(|r| r.usage.read_bytes as f64).map(|s| s.median)),
            mib(row.spread(|r| r.usage.written_bytes as f64).map(|s| s.median)),
            number(row.spread(|r| r.usage.temp_bytes as f64 / n).map(|s| s.median)),
        ]);
        cells
    });
    table(&headers, &cells.collect::<Vec<_>>())
}

/// How good each tool's result is: one row a tool and target.
pub fn quality_table(rows: &[&Row]) -> String {
    let headers = [
        "tool",
        "target",
        "triangles",
        "RMS / diagonal",
        "p99.9 / diagonal",
        "max / diagonal",
        "facing against",
        "non-manifold",
        "inconsistent",
        "open edges",
        "components",
        "Euler",
    ];
    let mut cells: Vec<Vec<String>> = Vec::new();
    if let Some(before) = rows.iter().find_map(|row| row.quality.as_ref()).map(|q| &q.before) {
        let mut row = vec!["input".to_owned(), String::new(), count(before.triangles)];
        row.resize(7, String::new());
        row.extend([
            count(before.non_manifold_edges),
            count(before.inconsistent_edges),
            count(before.boundary_edges),
            count(before.components),
            before.euler_characteristic.to_string(),
        ]);
        cells.push(row);
    }
    cells.extend(rows.iter().map(|row| {
        let mut cells = vec![label(row), count(row.target)];
        let Some(q) = &row.quality else {
            cells.push(row.trouble.clone());
            cells.resize(headers.len(), String::new());
            return cells;
        };
        cells.extend([
            count(q.after.triangles),
            format!("{:.3e}", q.rms / q.diagonal),
            format!("{:.3e}", q.p999 / q.diagonal),
            format!("{:.3e}", q.max / q.diagonal),
            q.facing_against.map_or_else(|| "-".to_owned(), count),
            count(q.after.non_manifold_edges),
            count(q.after.inconsistent_edges),
            count(q.after.boundary_edges),
            count(q.after.components),
            q.after.euler_characteristic.to_string(),
        ]);
        cells
    }));
    table(&headers, &cells)
}

/// The tool's name, marked if its runs are from the cache.
pub fn label(row: &Row) -> String {
    let threads =
        if row.threads > 0 { format!(", {} threads", row.threads) } else { String::new() };
    format!("{}{threads}{}", row.peer, if row.cached { " \\*" } else { "" })
}

/// Peak memory of the simplification alone beyond the input arrays, in bytes an input triangle.
pub fn extra_bytes(row: &Row) -> Option<f64> {
    let of = |r: &crate::record::Run| r.inner.as_ref().map(|i| i.extra_bytes as f64);
    Spread::of(row.good().filter_map(of).collect()).map(|s| s.median / row.triangles_in as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_words() {
        assert_eq!(count(1_234_567), "1,234,567");
        assert_eq!(count(12), "12");
        assert_eq!(number(Some(0.001_234)), "1.234e-3");
        assert_eq!(number(None), "-");
        assert_eq!(
            table(&["a", "b"], &[vec!["1".into(), "2".into()]]),
            "| a | b |\n|---|---|\n| 1 | 2 |\n"
        );
    }
}
