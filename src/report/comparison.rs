//! One self-contained HTML page that sets results side by side: pictures from one camera, error, time, memory, angles,
//! topology. For narrow screens too.

use super::page::{STYLE, bars, brief, escape, show};
use super::pictures::pictures_of;
use crate::error::Result;
use crate::io::StageOptions;
use crate::io::ply::MeshSource;
use crate::measure::load;
use crate::measure::shapes::ShapeCounts;
use crate::render::{Resources, Sphere, View};
use crate::system::progress::Progress;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

const MEBIBYTE: f64 = 1048576.0;

/// Side of a close-up, as a share of the original's diagonal.
const CLOSE_UP: f64 = 0.05;

/// Style for pictures and tables of any number of columns; they wrap, or scroll within the page.
const WIDE: &str = "\
.row,.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,13rem),1fr));gap:1rem}.plots{gap:0 2rem}\
.row img{width:100%;border:1px solid #ddd;box-sizing:border-box}.scroll{overflow-x:auto}.best{font-weight:700}\
.scroll td,.scroll th{padding:.15rem 0 .15rem 1.6rem;border-bottom:1px solid #eee;white-space:nowrap}\
.scroll th:first-child{padding-left:0}thead th{text-align:right}h3{margin-bottom:.3rem}@media(max-width:40rem){\
.scroll{font-size:.8rem}.scroll td,.scroll th{padding-left:.7rem}.scroll th:first-child{white-space:normal;width:9rem}\
.row{grid-template-columns:1fr 1fr;gap:.5rem}h2{font-size:1.2rem}}";

/// A result on the page.
#[derive(Clone, Debug)]
pub struct Contender {
    /// Its name, for people.
    pub name: String,
    /// Its mesh.
    pub mesh: PathBuf,
    /// The JSON of `simplify --report`.
    pub run: Value,
    /// The JSON of `measure --report`.
    pub measured: Value,
}

/// A method that has no result.
#[derive(Clone, Debug)]
pub struct Absent {
    /// Its name, for people.
    pub name: String,
    /// The reason, for people.
    pub reason: String,
}

/// Columns for 0 to 60 degrees, with a line at the median; `most` is the share that is as high as the picture.
fn plot(shapes: &ShapeCounts, most: f64) -> String {
    let mut out = String::from(
        "<svg role=\"img\" aria-label=\"Triangles by their smallest angle\" viewBox=\"0 0 390 150\">",
    );
    let x = |degrees: f64| 10.0 + 6.0 * degrees;
    for (i, share) in shapes.shares().enumerate().filter(|(_, share)| *share > 0.0) {
        let height = 110.0 * share / most;
        // A String takes everything that is written to it.
        let _ = write!(
            out,
            "<rect x=\"{}\" y=\"{:.1}\" width=\"5.4\" height=\"{height:.1}\"/>",
            x(i as f64),
            120.0 - height
        );
    }
    for degrees in [0.0, 15.0, 30.0, 45.0, 60.0] {
        let _ = write!(
            out,
            "<text x=\"{}\" y=\"136\" text-anchor=\"middle\">{degrees}\u{b0}</text>",
            x(degrees)
        );
    }
    let (at, median) = (x(shapes.median), shapes.median);
    let (anchor, aside) = if median > 30.0 { ("end", -4.0) } else { ("start", 4.0) };
    let _ = write!(
        out,
        "<path d=\"M{at:.1} 0V120\" stroke=\"#b03a2e\"/><text x=\"{:.1}\" y=\"11\" text-anchor=\"{anchor}\">\
         median {median:.0}\u{b0}</text></svg>",
        at + aside
    );
    out
}

/// The whole page as text.
///
/// Memory: what pictures take, and one result at a time.
pub fn html(
    original: &Path,
    (contenders, absent): (&[Contender], &[Absent]),
    temp_dir: &Path,
    resources: Resources,
    progress: &Progress,
) -> Result<String> {
    let stage = StageOptions::new(temp_dir).within(resources.memory_bytes);
    let sources: Vec<MeshSource> = std::iter::once(original)
        .chain(contenders.iter().map(|contender| contender.mesh.as_path()))
        .map(|path| MeshSource::open_staged(path, &stage))
        .collect::<Result<_>>()?;
    let mut shapes = Vec::new();
    for source in &sources[1..] {
        shapes.push(ShapeCounts::of(&load::load(source, resources.threads, progress)?.mesh));
    }
    let name = original.file_name().unwrap_or(original.as_os_str());
    let title = format!("Methods on {}", name.to_string_lossy());
    let mut out = String::from("<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">");
    // A String takes everything that is written to it.
    let _ = write!(
        out,
        "<meta name=\"viewport\" content=\"width=device-width\"><link rel=\"icon\" href=\"data:,\">\
         <title>{0}</title><style>{STYLE}{WIDE}</style></head><body><h1>{0}</h1><p>{1} triangles, {2} vertices.</p>",
        escape(&title),
        show(&json!(sources[0].n_triangles())),
        show(&json!(sources[0].n_vertices())),
    );
    for Absent { name, reason } in absent {
        let (name, reason) = (escape(name), escape(reason));
        let _ = write!(out, "<p>No result of <b>{name}</b>: {reason}</p>");
    }
    table(contenders, &shapes, &mut out);
    pictures(&sources, contenders, resources, &mut out, progress)?;
    plots(contenders, &shapes, &mut out);
    out.push_str("</body></html>\n");
    Ok(out)
}

/// A row of the table: a value for each method.
struct Row {
    name: &'static str,
    values: Vec<Value>,
    /// The best value: the least, the largest, or none.
    best: Best,
}

#[derive(Clone, Copy, PartialEq)]
enum Best {
    Least,
    Most,
    None,
}

fn rows(contenders: &[Contender], shapes: &[ShapeCounts]) -> Vec<Row> {
    let of = |name: &'static str, best: Best, value: &dyn Fn(&Contender) -> Value| Row {
        name,
        values: contenders.iter().map(value).collect(),
        best,
    };
    let topology = |c: &Contender, key: &str| c.measured["simplified"]["topology"][key].clone();
    let mebibytes =
        |value: &Value| json!((value.as_f64().unwrap_or(0.0) / MEBIBYTE).round() as u64);
    let percent = |x: f64| json!((x * 1e4).round() / 100.0);
    // Near 100 the triangles are too few for the scan, whatever the count that was met.
    let error_per_edge = |(c, shapes): (&Contender, &ShapeCounts)| match c.measured["rms"].as_f64()
    {
        Some(rms) if shapes.mean_edge > 0.0 => percent(rms / shapes.mean_edge),
        _ => Value::Null,
    };
    vec![
        of("triangles", Best::None, &|c| c.run["output"]["triangles"].clone()),
        of("vertices", Best::None, &|c| c.run["output"]["vertices"].clone()),
        of("RMS distance, both ways", Best::Least, &|c| c.measured["rms"].clone()),
        of("… of the diagonal", Best::None, &|c| c.measured["relative_rms"].clone()),
        Row {
            name: "… of the mean edge, %",
            values: contenders.iter().zip(shapes).map(error_per_edge).collect(),
            best: Best::None,
        },
        of("farthest, original to result", Best::Least, &|c| c.measured["forward"]["max"].clone()),
        of("farthest, result to original", Best::Least, &|c| c.measured["backward"]["max"].clone()),
        of("seconds", Best::Least, &|c| c.run["seconds"].clone()),
        of("peak memory, MiB", Best::Least, &|c| mebibytes(&c.run["peak_memory_bytes"])),
        of("peak disk, MiB", Best::Least, &|c| mebibytes(&c.run["peak_temp_bytes"])),
        Row {
            name: "median smallest angle, degrees",
            values: shapes.iter().map(|shapes| json!(shapes.median)).collect(),
            best: Best::Most,
        },
        Row {
            name: "slivers below 10 degrees, %",
            values: shapes.iter().map(|shapes| percent(shapes.slivers)).collect(),
            best: Best::Least,
        },
        of("components", Best::None, &|c| topology(c, "components")),
        of("Euler characteristic", Best::None, &|c| topology(c, "euler_characteristic")),
        of("boundary edges", Best::None, &|c| topology(c, "boundary_edges")),
        of("edges of more than two triangles", Best::Least, &|c| topology(c, "non_manifold_edges")),
        of("target met", Best::None, &|c| c.run["target_met"].clone()),
    ]
}

fn table(contenders: &[Contender], shapes: &[ShapeCounts], out: &mut String) {
    out.push_str("<div class=\"scroll\"><table><thead><tr><th></th>");
    for contender in contenders {
        let _ = write!(out, "<th>{}</th>", escape(&contender.name));
    }
    out.push_str("</tr></thead>");
    for Row { name, values, best } in rows(contenders, shapes) {
        let _ = write!(out, "<tr><th>{}</th>", escape(name));
        let numbers: Vec<f64> = values.iter().filter_map(Value::as_f64).collect();
        let winner = match best {
            Best::Least => numbers.iter().copied().reduce(f64::min),
            Best::Most => numbers.iter().copied().reduce(f64::max),
            Best::None => None,
        };
        let is_small = numbers.iter().any(|x| *x != 0.0 && x.abs() < 1e-3);
        for value in &values {
            let class = match winner.is_some() && value.as_f64() == winner {
                true => " class=\"best\"",
                false => "",
            };
            // One notation for a row.
            let text = match value.as_f64() {
                Some(x) if is_small => format!("{x:.2e}"),
                Some(x) => brief(x),
                None => show(value),
            };
            let _ = write!(out, "<td{class}>{}</td>", escape(&text));
        }
        out.push_str("</tr>");
    }
    out.push_str("</table></div>");
}

fn plots(contenders: &[Contender], shapes: &[ShapeCounts], out: &mut String) {
    let number = |value: &Value| value.as_f64().unwrap_or(0.0);
    let all = |value: &dyn Fn(&Contender) -> f64| -> Vec<(String, f64)> {
        contenders.iter().map(|c| (c.name.clone(), value(c))).collect()
    };
    out.push_str("<h2>Error, time, memory</h2><div class=\"plots\">");
    for (title, rows, unit) in [
        ("RMS distance, input units", all(&|c| number(&c.measured["rms"])), ""),
        ("Time", all(&|c| number(&c.run["seconds"])), "s"),
        ("Peak memory", all(&|c| (number(&c.run["peak_memory_bytes"]) / MEBIBYTE).round()), "MiB"),
    ] {
        let _ = write!(out, "<section><h3>{title}</h3>{}</section>", bars(title, &rows, unit));
    }
    out.push_str("</div><h2>Smallest angles of triangles</h2><div class=\"plots\">");
    let most = shapes.iter().flat_map(ShapeCounts::shares).fold(0.0, f64::max);
    for (contender, shapes) in contenders.iter().zip(shapes) {
        let name = escape(&contender.name);
        let _ = write!(out, "<section><h3>{name}</h3>{}</section>", plot(shapes, most));
    }
    out.push_str("</div>");
}

fn pictures(
    sources: &[MeshSource],
    contenders: &[Contender],
    resources: Resources,
    out: &mut String,
    progress: &Progress,
) -> Result<()> {
    let whole = View { width: 800, height: 600, ..View::default() };
    let edges = View { edges: true, smooth: false, ..whole.clone() };
    let mut views = vec![("The whole", whole), ("With edges", edges.clone())];
    let worst = contenders.iter().find_map(|c| place(&c.measured["forward"]["worst"]));
    let diagonal = contenders.iter().find_map(|c| c.measured["diagonal"].as_f64()).unwrap_or(0.0);
    if let (Some(centre), true) = (worst, diagonal > 0.0) {
        let zoom = Some(Sphere { centre, radius: CLOSE_UP * diagonal });
        views.push((
            "Close up, where the first is farthest from the original",
            View { zoom, ..edges },
        ));
    }
    let names = std::iter::once("original").chain(contenders.iter().map(|c| c.name.as_str()));
    let meshes: Vec<_> = sources.iter().zip(names).collect();
    pictures_of(&meshes, views, ("h2", "row"), resources, out, progress)
}

fn place(value: &Value) -> Option<[f64; 3]> {
    let numbers: Vec<f64> = value.as_array()?.iter().filter_map(Value::as_f64).collect();
    numbers.try_into().ok()
}
