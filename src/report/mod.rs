//! One self-contained HTML page from the JSON of `simplify --report` or `measure --report`.
//!
//! Numbers and plots come from the JSON (`page`), pictures from the meshes it names, as far as they are
//! still there. Nothing is measured here, and the page asks the network for nothing.

mod comparison;
mod page;
mod pictures;
mod slider;

pub use comparison::{Absent, Contender, html as comparison_html};
pub use slider::{Slider, slider_html};

use crate::error::{Error, Result};
use crate::io::ply::{MeshSource, OutputHeader};
use crate::io::{GlbWriter, StageOptions};
use crate::measure::load;
use crate::mesh::bounds::Bounds;
use crate::mesh::property::{Origin, Property, REACH, Scalar};
use crate::mesh::record::VertexSchema;
use crate::render::{Coloring, Resources, Scale, Sphere, View, has_images, hold_images, top_of};
use crate::system::json_keys::is_old_name;
use crate::system::progress::Progress;
use crate::system::units::show_outward;
use page::{bars, escape, histogram, show, table, viewer_of};
use pictures::pictures_of;
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// A larger mesh would make the page too heavy to open; 1 M triangles are about 20 MiB of it.
const MOST_EMBEDDED: u64 = 1_000_000;

/// Side of a close-up, as a share of the original's diagonal.
const CLOSE_UP: f64 = 0.03;

/// Material of the page.
#[derive(Clone, Debug)]
pub struct Material {
    /// The JSON of `simplify --report` or `measure --report`.
    pub report: Value,
    /// The JSON of `measure --report`, if `report` has no deviation.
    pub measured: Option<Value>,
    /// The progressive mesh of the run, shown with a slider instead of its result.
    pub progressive: Option<Slider>,
    /// Folder for the one temporary file.
    pub temp_dir: PathBuf,
    /// Resources that rendering may use.
    pub resources: Resources,
}

/// The whole page as text. Without a mesh that was removed, its pictures are left out.
pub fn html(material: &Material, progress: &Progress) -> Result<String> {
    let report = &material.report;
    // Measured apart, by `simplify --verify`, or the report is one of `measure`.
    let verified = Some(&report["measured"]).filter(|measured| measured.is_object());
    let deviation = material.measured.as_ref().or(verified).unwrap_or(report);
    let names = [("input", "original"), ("output", "simplified")]
        .map(|(run, measure)| text_at(report, run).or_else(|| text_at(report, measure)));
    let mut out = String::from("<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">");
    let title = names[1].clone().unwrap_or_else(|| "stonecut".to_owned());
    // A String takes everything that is written to it.
    let _ = write!(
        out,
        "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><link rel=\"icon\" href=\"data:,\">\
         <title>{0}</title><style>{1}</style></head><body><h1>{0}</h1>",
        escape(&title),
        page::STYLE
    );
    let stage = StageOptions::new(material.temp_dir.clone());
    let stage = stage.within(material.resources.memory_bytes);
    let open = |name: &Option<String>| -> Result<Option<MeshSource>> {
        let Some(name) = name else { return Ok(None) };
        match MeshSource::open_staged(Path::new(name), &stage) {
            Err(error @ Error::NoMemory(_)) => {
                Error::first_of([Err(error), hold(material.resources)]).map(|()| None)
            }
            opened => Ok(opened.ok()),
        }
    };
    let sources = [open(&names[0])?, open(&names[1])?];
    if let [Some(_), Some(_)] = &sources {
        hold_pictures(sources.iter().flatten(), material.resources)?;
    }
    let mut views = views(report, deviation);
    let rest = views.split_off(1);
    if let [Some(original), Some(simplified)] = &sources {
        pictures([original, simplified], views, material.resources, &mut out, progress)?;
    }
    line(report, deviation, &mut out);
    summary(report, deviation, &mut out);
    error(deviation, &mut out);
    run(report, &mut out);
    if let [Some(original), Some(simplified)] = &sources {
        out.push_str("<h2>Pictures</h2>");
        pictures([original, simplified], rest, material.resources, &mut out, progress)?;
    }
    if let [_, Some(simplified)] = &sources {
        error_field(simplified, material.resources, &mut out, progress)?;
    }
    match (&material.progressive, &sources) {
        (Some(slider), _) => {
            let _ = write!(out, "<h2>To turn around</h2>{}", slider::part(slider));
        }
        (None, [_, Some(simplified)]) => viewer(simplified, material, &mut out, progress)?,
        (None, _) => {}
    }
    out.push_str("</body></html>\n");
    Ok(out)
}

fn text_at(report: &Value, part: &str) -> Option<String> {
    report[part]["path"].as_str().map(str::to_owned)
}

/// The one line that matters: triangles, error, time.
fn line(report: &Value, deviation: &Value, out: &mut String) {
    let count = |run: &str, measure: &str| {
        let n = &report[run]["triangles"];
        if n.is_null() { deviation[measure]["triangles"].clone() } else { n.clone() }
    };
    let (before, after) = (count("input", "original"), count("output", "simplified"));
    let mut parts = vec![format!("{} triangles became <b>{}</b>", show(&before), show(&after))];
    if deviation["rms"].is_number() {
        parts.push(format!("RMS error <b>{}</b>", show(&deviation["rms"])));
    } else if report["quality"]["rms_estimate"].is_number() {
        parts.push(format!("RMS error about {}", show(&report["quality"]["rms_estimate"])));
    }
    let seen = &deviation["appearance"];
    if let (Some(psnr), Some(ssim)) = (seen["psnr"].as_f64(), seen["ssim"].as_f64()) {
        parts.push(format!("pictures alike to PSNR {psnr:.1} dB, SSIM {ssim:.3}"));
    }
    if let (true, Some(seconds)) = (report["output"].is_object(), report["seconds"].as_f64()) {
        parts.push(format!("{seconds:.0} s"));
    }
    let _ = write!(out, "<p class=\"line\">{}</p>", parts.join(" \u{b7} "));
}

fn summary(report: &Value, deviation: &Value, out: &mut String) {
    out.push_str("<h2>Asked and done</h2><div class=\"columns\">");
    for part in ["input", "output", "original", "simplified", "settings"] {
        let rows = table(&report[part]);
        if !rows.is_empty() {
            let _ = write!(out, "<section><h3>{part}</h3>{rows}</section>");
        }
    }
    let faults = table(&report["input"]["faults"]);
    if !faults.is_empty() {
        let _ = write!(out, "<section><h3>faults in the input</h3>{faults}</section>");
    }
    for part in ["original", "simplified"] {
        let rows = table(&deviation[part]["topology"]);
        if !rows.is_empty() {
            let _ = write!(out, "<section><h3>topology, {part}</h3>{rows}</section>");
        }
    }
    out.push_str("</div>");
}

fn error(deviation: &Value, out: &mut String) {
    if !deviation["forward"].is_object() {
        return;
    }
    out.push_str("<h2>Measured error</h2>");
    let _ = write!(
        out,
        "<p>RMS both ways <b>{}</b>, which is {} of the diagonal {}.</p>",
        show(&deviation["rms"]),
        show(&deviation["relative_rms"]),
        show(&deviation["diagonal"])
    );
    if let enclosed @ Value::Object(_) = &deviation["hausdorff"] {
        let outward = |end: &str, direction: i64| match enclosed[end].as_f64() {
            Some(length) => show_outward(length, direction, 4),
            None => show(&enclosed[end]),
        };
        let _ = write!(
            out,
            "<p>Largest distance (Hausdorff), proven: at least <b>{}</b>, at most <b>{}</b>.</p>",
            outward("lower", -1),
            outward("upper", 1)
        );
    }
    out.push_str("<div class=\"columns\">");
    for (side, name) in
        [("forward", "original to simplified"), ("backward", "simplified to original")]
    {
        let _ = write!(out, "<section><h3>{name}</h3>{}</section>", table(&deviation[side]));
    }
    out.push_str("</div>");
    for (side, name) in
        [("forward", "Original to simplified"), ("backward", "Simplified to original")]
    {
        let counts: Vec<f64> = deviation[side]["histogram"]
            .as_array()
            .map(|bins| bins.iter().filter_map(Value::as_f64).collect())
            .unwrap_or_default();
        let top = deviation[side]["max"].as_f64().unwrap_or(0.0);
        out.push_str(&histogram(&format!("{name}, distance in input units"), &counts, top));
    }
}

fn run(report: &Value, out: &mut String) {
    let stages = |key: &str, unit: f64| -> Vec<(String, f64)> {
        let stages = report["stages"].as_array().map(Vec::as_slice).unwrap_or_default();
        let row = |s: &Value| Some((s["name"].as_str()?.to_owned(), s[key].as_f64()? / unit));
        stages.iter().filter_map(row).collect()
    };
    out.push_str("<h2>The run</h2>");
    let picked: serde_json::Map<String, Value> = [
        "version",
        "seconds",
        "triangles_per_second",
        "peak_memory_bytes",
        "peak_temp_bytes",
        "cells",
        "rounds",
        "target",
        "target_met",
        "stop_reason",
    ]
    .iter()
    .filter(|key| !report[**key].is_null())
    .map(|key| ((*key).to_owned(), report[*key].clone()))
    .collect();
    out.push_str(&table(&Value::Object(picked)));
    out.push_str("<h3>Time by stage</h3>");
    out.push_str(&bars("Seconds by stage", &stages("seconds", 1.0), "s"));
    let memory = stages("peak_memory_bytes", f64::from(1 << 20));
    let memory: Vec<(String, f64)> = memory.into_iter().map(|(n, mib)| (n, mib.round())).collect();
    out.push_str("<h3>Peak memory up to the end of each stage</h3>");
    out.push_str(&bars("Peak memory up to the end of each stage", &memory, "MiB"));
    let rejects: Vec<(String, f64)> = report["rejects"]
        .as_object()
        .map(|all| {
            let new = all.iter().filter(|(key, _)| !is_old_name(key));
            new.filter_map(|(k, v)| Some((k.replace('_', " "), v.as_f64()?))).collect()
        })
        .unwrap_or_default();
    if !rejects.is_empty() {
        out.push_str("<h3>Refused collapses</h3>");
        out.push_str(&bars("Refused collapses by reason", &rejects, ""));
    }
    let seams = table(&report["seams"]);
    if !seams.is_empty() {
        let _ = write!(out, "<h3>Seams</h3>{seams}");
    }
}

/// The position of a shared vertex; reports of before schema version 1 have it under another name.
fn seam_position(report: &Value) -> &Value {
    let seams = &report["seams"];
    if seams["sample_position"].is_null() { &seams["place"] } else { &seams["sample_position"] }
}

/// Refuses the pictures of a page where the memory does not hold one; names the memory that does.
pub fn hold(resources: Resources) -> Result<()> {
    crate::render::hold(&View { width: 800, height: 600, ..View::default() }, resources)
}

/// The same with the images of meshes, before the first picture is drawn.
pub fn hold_pictures<'a>(
    sources: impl IntoIterator<Item = &'a MeshSource>,
    resources: Resources,
) -> Result<()> {
    let held = |source: &'a MeshSource| {
        let coloring = if has_images(source) { Coloring::Texture } else { Coloring::Plain };
        let view = View { width: 800, height: 600, coloring, ..View::default() };
        hold_images(source, &view, resources)
    };
    Error::first_of(sources.into_iter().map(held))
}

/// Chooses the views of both meshes: the whole, and close-ups at the worst place and at a seam.
fn views(report: &Value, deviation: &Value) -> Vec<(&'static str, View)> {
    let whole = View { width: 800, height: 600, ..View::default() };
    let edges = View { edges: true, smooth: false, ..whole.clone() };
    let mut views = vec![("The whole", whole), ("With edges", edges.clone())];
    let bound = |corner: usize, k: usize| report["input"]["bounds"][corner][k].as_f64();
    let side_sq = |k: usize| Some((bound(1, k)? - bound(0, k)?).powi(2));
    let of_box = (0..3).map(side_sq).sum::<Option<f64>>().map(f64::sqrt);
    let diagonal = deviation["diagonal"].as_f64().or(of_box).unwrap_or(0.0);
    let places = [
        ("Close up, at the worst place", &deviation["forward"]["worst"]),
        ("Close up, at a seam of the first round", seam_position(report)),
    ];
    for (name, place) in places {
        let place: Vec<f64> = place
            .as_array()
            .map(|p| p.iter().filter_map(Value::as_f64).collect())
            .unwrap_or_default();
        if let [x, y, z] = place[..]
            && diagonal > 0.0
        {
            let zoom = Some(Sphere { centre: [x, y, z], radius: CLOSE_UP * diagonal });
            views.push((name, View { zoom, ..edges.clone() }));
        }
    }
    views
}

fn pictures(
    sources: [&MeshSource; 2],
    views: Vec<(&'static str, View)>,
    resources: Resources,
    out: &mut String,
    progress: &Progress,
) -> Result<()> {
    let is_textured = sources.iter().any(|source| has_images(source));
    let mut views = views;
    for (_, view) in views.iter_mut().filter(|(_, view)| is_textured && !view.edges) {
        view.coloring = Coloring::Texture;
    }
    let meshes: Vec<_> = sources.into_iter().zip(["original", "simplified"]).collect();
    pictures_of(&meshes, views, ("h3", "pair"), resources, out, progress)
}

/// The simplified mesh painted by the distance that `simplify --error-field` has written with its vertices, if it has.
fn error_field(
    source: &MeshSource,
    resources: Resources,
    out: &mut String,
    progress: &Progress,
) -> Result<()> {
    let is_field = |p: &Property| p.origin == Origin::Vertex && p.name == REACH;
    if !source.schema().properties.iter().any(is_field) {
        return Ok(());
    }
    let top = top_of(source, REACH, progress)?;
    let scale = Some(Scale { property: REACH.to_owned(), top });
    let view = View { width: 800, height: 600, scale, ..View::default() };
    let views = vec![("Where it is how far from the original, at most", view)];
    pictures_of(&[(source, "simplified")], views, ("h3", "pair"), resources, out, progress)
}

fn viewer(
    source: &MeshSource,
    material: &Material,
    out: &mut String,
    progress: &Progress,
) -> Result<()> {
    out.push_str("<h2>To turn around</h2>");
    if source.n_triangles() == 0 || source.n_triangles() > MOST_EMBEDDED {
        out.push_str("<p>The mesh is too large, or too empty, for a web page.</p>");
        return Ok(());
    }
    let glb = glb(source, material, progress)?;
    let _ = write!(
        out,
        "<canvas id=\"viewer\" aria-label=\"The simplified mesh in 3D\"></canvas>\
         <p><label><input type=\"checkbox\" id=\"viewer-edges\"> edges</label> <span id=\"viewer-note\"></span></p>{}",
        viewer_of("glb", &glb)
    );
    Ok(())
}

/// The mesh as GLB, about its own middle: browsers compute in single precision.
fn glb(source: &MeshSource, material: &Material, progress: &Progress) -> Result<Vec<u8>> {
    let mesh = load::load(source, material.resources.threads, progress)?.mesh;
    let bounds = Bounds::around(&mesh.positions);
    let schema = VertexSchema { coordinate: Scalar::F64, properties: Vec::new() };
    let header =
        OutputHeader::new(schema.clone(), mesh.positions.len() as u64, mesh.triangles.len() as u64);
    let mut writer = GlbWriter::create(material.temp_dir.join("viewer.glb").as_path(), header)?;
    let mut records = Vec::with_capacity(mesh.positions.len() * schema.record_bytes());
    for position in &mesh.positions {
        let about = [0, 1, 2].map(|k| position[k] - (bounds.low[k] + bounds.high[k]) / 2.0);
        schema.encode_position(about, &mut records);
    }
    writer.write_vertices(&records)?;
    let triangles: Vec<[u64; 3]> = mesh.triangles.iter().map(|t| t.map(u64::from)).collect();
    writer.write_faces(&triangles)?;
    writer.finish_bytes()
}
