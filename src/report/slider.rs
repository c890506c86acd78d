//! The page with a progressive mesh and a slider over its triangles, whole by itself.

use super::page::{STYLE, brief, escape, viewer_of};

/// A progressive mesh as a page shows it.
#[derive(Clone, Debug)]
pub struct Slider {
    /// Triangles of the coarsest and of the finest mesh.
    pub triangles: [u64; 2],
    /// The progressive mesh as `progressive::slides` tells it.
    pub slides: Vec<u8>,
}

/// The whole page as text, with a name above the picture.
pub fn slider_html(title: &str, slider: &Slider) -> String {
    let title = escape(title);
    format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><link rel=\"icon\" href=\"data:,\">\
         <title>{title}</title><style>{STYLE}</style></head><body><h1>{title}</h1>{}</body></html>\n",
        part(slider)
    )
}

/// The picture, the slider and the viewer, for any page with `STYLE`.
pub(super) fn part(slider: &Slider) -> String {
    let [coarsest, finest] = slider.triangles.map(|n| brief(n as f64));
    format!(
        "<canvas id=\"viewer\" aria-label=\"The mesh in 3D\"></canvas>\
         <p><label>{coarsest} to {finest} triangles\
         <input type=\"range\" id=\"viewer-slider\" min=\"0\" max=\"1000\" value=\"1000\"></label></p>\
         <p><b id=\"viewer-count\"></b> <label><input type=\"checkbox\" id=\"viewer-edges\"> edges</label> \
         <span id=\"viewer-note\"></span></p>{}",
        viewer_of("slides", &slider.slides)
    )
}
