//! One self-contained HTML page that sets results side by side: pictures from one camera, error, time, memory, angles,
//! topology. For narrow screens too.

use super::page::{STYLE, bars, escape, histogram, show};
use super::pictures::pictures_of;
use crate::error::Result;
use crate::io::StageOptions;
use crate::io::ply::MeshSource;
use crate::measure::load;
use crate::mesh::Mesh;
use crate::mesh::vec3::{dot, length_sq, sub};
use crate::render::{Resources, Sphere, View};
use crate::system::progress::Progress;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Bins of smallest angles, 0 to 60 degrees.
const ANGLE_BINS: usize = 60;

/// A triangle with a smaller angle is a sliver, in degrees.
const SLIVER: f64 = 10.0;

/// Side of a close-up, as a share of the original's diagonal.
const CLOSE_UP: f64 = 0.05;

/// Style for pictures and tables of any number of columns; they wrap, or scroll within the page.
const WIDE: &str = "\
.row{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,17rem),1fr));gap:1rem}.row img{width:100%;\
border:1px solid #ddd}.scroll{overflow-x:auto}.scroll td,.scroll th{padding:.15rem .9rem .15rem 0;white-space:nowrap}\
.best{font-weight:700}thead th{text-align:right}@media(max-width:40rem){body{padding:.8rem}}";

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

/// Shapes of the triangles of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
struct Angles {
    /// Triangles by their smallest angle, in bins of one degree.
    counts: Vec<f64>,
    /// Median of the smallest angles, in degrees.
    median: f64,
    /// Share of slivers.
    slivers: f64,
}

impl Angles {
    fn of(mesh: &Mesh) -> Angles {
        let mut all: Vec<f64> =
            (0..mesh.triangles.len()).map(|t| smallest(mesh.corners(t))).collect();
        all.sort_by(f64::total_cmp);
        let mut counts = vec![0.0; ANGLE_BINS];
        all.iter().for_each(|angle| counts[(*angle as usize).min(ANGLE_BINS - 1)] += 1.0);
        let slivers = all.partition_point(|&angle| angle < SLIVER) as f64;
        let median = all.get(all.len() / 2).copied().unwrap_or(0.0);
        Angles { counts, median, slivers: slivers / all.len().max(1) as f64 }
    }
}

/// The smallest angle of a triangle, in degrees; 0 where an edge has no length.
fn smallest(corners: [[f64; 3]; 3]) -> f64 {
    let at = |i: usize| {
        let (p, q, r) = (corners[i], corners[(i + 1) % 3], corners[(i + 2) % 3]);
        let (u, v) = (sub(q, p), sub(r, p));
        let cosine = dot(u, v) / (length_sq(u) * length_sq(v)).sqrt();
        if cosine.is_finite() { cosine.clamp(-1.0, 1.0).acos().to_degrees() } else { 0.0 }
    };
    at(0).min(at(1)).min(at(2))
}

/// The whole page as text.
///
/// Memory: what pictures take, and one result at a time.
pub fn html(
    original: &Path,
    contenders: &[Contender],
    temp_dir: &Path,
    resources: Resources,
    progress: &Progress,
) -> Result<String> {
    let stage = StageOptions::new(temp_dir);
    let sources: Vec<MeshSource> = std::iter::once(original)
        .chain(contenders.iter().map(|contender| contender.mesh.as_path()))
        .map(|path| MeshSource::open_staged(path, &stage))
        .collect::<Result<_>>()?;
    let mut angles = Vec::new();
    for source in &sources[1..] {
        angles.push(Angles::of(&load::load(source, resources.threads, progress)?.mesh));
    }
    let title = format!("Methods on {}", original.display());
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
    table(contenders, &angles, &mut out);
    plots(contenders, &angles, &mut out);
    pictures(&sources, contenders, resources, &mut out, progress)?;
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

fn rows(contenders: &[Contender], angles: &[Angles]) -> Vec<Row> {
    let of = |name: &'static str, best: Best, value: &dyn Fn(&Contender) -> Value| Row {
        name,
        values: contenders.iter().map(value).collect(),
        best,
    };
    let topology = |c: &Contender, key: &str| c.measured["simplified"]["topology"][key].clone();
    let mebibytes = |value: &Value| json!(value.as_f64().unwrap_or(0.0).round() as u64 >> 20);
    let percent = |x: f64| json!((x * 1e4).round() / 100.0);
    vec![
        of("triangles", Best::None, &|c| c.run["output"]["triangles"].clone()),
        of("vertices", Best::None, &|c| c.run["output"]["vertices"].clone()),
        of("RMS distance, both ways", Best::Least, &|c| c.measured["rms"].clone()),
        of("… of the diagonal", Best::None, &|c| c.measured["relative_rms"].clone()),
        of("farthest, original to result", Best::Least, &|c| c.measured["forward"]["max"].clone()),
        of("farthest, result to original", Best::Least, &|c| c.measured["backward"]["max"].clone()),
        of("seconds", Best::Least, &|c| c.run["seconds"].clone()),
        of("peak memory, MiB", Best::Least, &|c| mebibytes(&c.run["peak_memory_bytes"])),
        of("peak disk, MiB", Best::Least, &|c| mebibytes(&c.run["peak_temp_bytes"])),
        Row {
            name: "median smallest angle, degrees",
            values: angles.iter().map(|angles| json!(angles.median)).collect(),
            best: Best::Most,
        },
        Row {
            name: "slivers below 10 degrees, %",
            values: angles.iter().map(|angles| percent(angles.slivers)).collect(),
            best: Best::Least,
        },
        of("components", Best::None, &|c| topology(c, "components")),
        of("Euler characteristic", Best::None, &|c| topology(c, "euler_characteristic")),
        of("boundary edges", Best::None, &|c| topology(c, "boundary_edges")),
        of("edges of more than two triangles", Best::Least, &|c| topology(c, "non_manifold_edges")),
        of("target met", Best::None, &|c| c.run["target_met"].clone()),
    ]
}

fn table(contenders: &[Contender], angles: &[Angles], out: &mut String) {
    out.push_str("<div class=\"scroll\"><table><thead><tr><th></th>");
    for contender in contenders {
        let _ = write!(out, "<th>{}</th>", escape(&contender.name));
    }
    out.push_str("</tr></thead>");
    for Row { name, values, best } in rows(contenders, angles) {
        let _ = write!(out, "<tr><th>{}</th>", escape(name));
        let numbers: Vec<f64> = values.iter().filter_map(Value::as_f64).collect();
        let winner = match best {
            Best::Least => numbers.iter().copied().reduce(f64::min),
            Best::Most => numbers.iter().copied().reduce(f64::max),
            Best::None => None,
        };
        for value in &values {
            let class = match winner.is_some() && value.as_f64() == winner {
                true => " class=\"best\"",
                false => "",
            };
            let _ = write!(out, "<td{class}>{}</td>", escape(&show(value)));
        }
        out.push_str("</tr>");
    }
    out.push_str("</table></div>");
}

fn plots(contenders: &[Contender], angles: &[Angles], out: &mut String) {
    let number = |value: &Value| value.as_f64().unwrap_or(0.0);
    let all = |value: &dyn Fn(&Contender) -> f64| -> Vec<(String, f64)> {
        contenders.iter().map(|c| (c.name.clone(), value(c))).collect()
    };
    for (title, rows, unit) in [
        ("RMS distance, both ways, in input units", all(&|c| number(&c.measured["rms"])), ""),
        ("Time", all(&|c| number(&c.run["seconds"])), "s"),
        (
            "Peak memory",
            all(&|c| (number(&c.run["peak_memory_bytes"]) / f64::from(1 << 20)).round()),
            "MiB",
        ),
    ] {
        let _ = write!(out, "<h2>{title}</h2>{}", bars(title, &rows, unit));
    }
    out.push_str("<h2>Smallest angles of triangles</h2><div class=\"row\">");
    for (contender, angles) in contenders.iter().zip(angles) {
        let title = format!("{}: smallest angle, degrees", contender.name);
        let _ = write!(out, "<div>{}</div>", histogram(&title, &angles.counts, ANGLE_BINS as f64));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_the_triangles() {
        let positions = vec![
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.5, 0.75f64.sqrt(), 0.0],
            [2.0, 0.0, 0.0],
        ];
        let mesh = Mesh::new(positions, vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]]);
        let angles = Angles::of(&mesh);
        assert!((angles.median - 45.0).abs() < 1e-9 && (angles.slivers - 1.0 / 3.0).abs() < 1e-9);
        assert_eq!((angles.counts[0], angles.counts.iter().sum::<f64>()), (1.0, 3.0));
        assert_eq!(smallest([[0.0; 3]; 3]), 0.0);
    }

    #[test]
    fn the_best_of_a_row_is_marked() {
        let contender = |name: &str, rms: f64| Contender {
            name: name.to_owned(),
            mesh: PathBuf::new(),
            run: json!({"seconds": 2.0, "output": {"triangles": 10}}),
            measured: json!({"rms": rms}),
        };
        let both = [contender("a<b", 0.5), contender("c", 0.25)];
        let mut out = String::new();
        table(&both, &[Angles::default(), Angles::default()], &mut out);
        assert!(out.contains("<td>0.5000</td><td class=\"best\">0.2500</td>"), "{out}");
        assert!(out.contains("a&lt;b") && !out.contains("a<b"));
        assert!(plots_of(&both).contains("Peak memory"));
    }

    fn plots_of(contenders: &[Contender]) -> String {
        let mut out = String::new();
        plots(contenders, &[], &mut out);
        out
    }
}
