//! The report as one HTML page: text, tables and plots as inline SVG. Knows no files and no pictures.

use crate::system::json_keys::is_old_name;
use base64::Engine;
use serde_json::Value;
use std::fmt::Write;

/// The scripts of the viewer in 3D, in their order: three.js and ours (web/README.md).
const SCRIPTS: [&str; 2] =
    [include_str!("../../web/built/three.js"), include_str!("../../web/built/report.js")];

/// The data of a picture in 3D, as the element `id`, and the scripts that show it.
pub(super) fn viewer_of(id: &str, bytes: &[u8]) -> String {
    let data = base64::engine::general_purpose::STANDARD.encode(bytes);
    let [three, ours] = SCRIPTS;
    format!(
        "<script id=\"{id}\" type=\"text/plain\">{data}</script><script>{three}</script><script>{ours}</script>"
    )
}

/// Escapes text for HTML, attribute values included.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            _ => out.push(c),
        }
    }
    out
}

/// A JSON value as people read it: short numbers, nothing for null.
pub fn show(value: &Value) -> String {
    match value {
        Value::Null => "-".to_owned(),
        Value::Bool(flag) => (if *flag { "yes" } else { "no" }).to_owned(),
        Value::String(text) => text.clone(),
        Value::Array(items) if items.iter().all(Value::is_number) => {
            items.iter().map(show).collect::<Vec<_>>().join(", ")
        }
        Value::Number(number) => match (number.as_u64(), number.as_f64()) {
            (Some(count), _) => grouped(count),
            (None, Some(x)) if x < 0.0 && number.is_i64() => format!("-{}", grouped(-x as u64)),
            (None, Some(x)) if x == 0.0 || (1e-3..1e6).contains(&x.abs()) => format!("{x:.4}"),
            (None, Some(x)) => format!("{x:.4e}"),
            (None, None) => number.to_string(),
        },
        other => other.to_string(),
    }
}

/// A count with thin spaces between groups of three digits.
fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{2009}');
        }
        out.push(c);
    }
    out
}

/// A table of two columns from the entries of a JSON object; nothing for an empty or missing one.
pub fn table(object: &Value) -> String {
    let Some(entries) = object.as_object().filter(|entries| !entries.is_empty()) else {
        return String::new();
    };
    let mut out = String::from("<table>");
    for (name, value) in entries {
        let is_row = |list: &Vec<Value>| list.len() <= 8 && list.iter().all(Value::is_number);
        if is_old_name(name)
            || value.is_object()
            || value.as_array().is_some_and(|list| !is_row(list))
        {
            continue;
        }
        let name = escape(&name.replace('_', " "));
        // A String takes everything that is written to it.
        let _ = write!(out, "<tr><th>{name}</th><td>{}</td></tr>", escape(&show(value)));
    }
    out + "</table>"
}

/// Horizontal bars, the longest across the width that names and values leave; `unit` follows each value.
pub fn bars(title: &str, rows: &[(String, f64)], unit: &str) -> String {
    let top = rows.iter().map(|row| row.1).fold(0.0, f64::max);
    if top <= 0.0 {
        return String::new();
    }
    let mut out = format!("<div class=\"bars\" role=\"img\" aria-label=\"{}\">", escape(title));
    for (name, value) in rows {
        // A String takes everything that is written to it.
        let _ = write!(
            out,
            "<span>{}</span><div><i style=\"width:{:.1}%\"></i></div><span>{} {unit}</span>",
            escape(name),
            100.0 * value / top,
            brief(*value),
        );
    }
    out + "</div>"
}

/// A number of three digits, counts in full.
pub fn brief(x: f64) -> String {
    match x.abs() {
        _ if x.fract() == 0.0 && (0.0..1e15).contains(&x) => grouped(x as u64),
        _ if x.fract() == 0.0 && x.abs() < 1e15 => format!("-{}", grouped(-x as u64)),
        size if !(1e-3..1e6).contains(&size) => format!("{x:.2e}"),
        size if size < 0.1 => format!("{x:.4}"),
        size if size < 1.0 => format!("{x:.3}"),
        size if size < 10.0 => format!("{x:.2}"),
        size if size < 100.0 => format!("{x:.1}"),
        _ => format!("{x:.0}"),
    }
}

/// A distribution as columns; logarithmic in the count.
pub fn histogram(title: &str, counts: &[f64], top: f64) -> String {
    let most = counts.iter().copied().fold(0.0, f64::max);
    if most <= 0.0 {
        return String::new();
    }
    let width = 640.0 / counts.len() as f64;
    let mut out = format!(
        "<svg role=\"img\" aria-label=\"{0}\" viewBox=\"0 0 720 220\"><title>{0}</title>",
        escape(title)
    );
    for (i, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0.0) {
        let height = 170.0 * (1.0 + count).ln() / (1.0 + most).ln();
        let _ = write!(
            out,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{height:.1}\"/>",
            40.0 + width * i as f64,
            180.0 - height,
            width * 0.9
        );
    }
    let _ = write!(
        out,
        "<text x=\"40\" y=\"198\">0</text><text x=\"680\" y=\"198\" text-anchor=\"end\">{}</text>\
         <text x=\"360\" y=\"214\" text-anchor=\"middle\">{} (samples on a logarithmic scale)</text>",
        escape(&show(&serde_json::json!(top))),
        escape(title)
    );
    out + "</svg>"
}

/// The style of the page.
pub const STYLE: &str = "\
:root{color-scheme:light}body{font:16px/1.5 system-ui,sans-serif;margin:0 auto;max-width:76rem;padding:1.5rem;\
color:#222;background:#fff}h1{font-size:1.6rem}h2{margin-top:2.2rem;border-bottom:1px solid #ddd}\
table{border-collapse:collapse;margin:.6rem 0}th{text-align:left;font-weight:500;color:#555;padding:.1rem 1.5rem .1rem 0}\
td{text-align:right;font-variant-numeric:tabular-nums}svg{width:100%;max-width:46rem;display:block}\
svg rect{fill:#3b6ea5}svg text{font-size:13px;fill:#333}\
.bars{display:grid;grid-template-columns:auto 1fr auto;gap:.2rem .8rem;max-width:46rem;font-size:.9rem;align-items:center}\
.bars span:nth-child(3n+1){text-align:right}.bars i{display:block;height:1rem;background:#3b6ea5;min-width:1px}\
.pair{display:grid;grid-template-columns:1fr 1fr;gap:1rem}\
.pair img{width:100%;border:1px solid #ddd}figure{margin:0}figcaption{color:#555;font-size:.9rem}\
canvas{width:100%;max-width:60rem;aspect-ratio:4/3;display:block;border:1px solid #ddd}#viewer-slider{width:100%;max-width:60rem;display:block}.columns{display:flex;flex-wrap:wrap;gap:1rem 3rem}.columns section{max-width:100%;overflow-x:auto}\
.line{font-size:1.25rem}h1{overflow-wrap:anywhere}td{overflow-wrap:anywhere}@media(max-width:40rem){body{padding:.8rem}.pair{gap:.3rem}}";
