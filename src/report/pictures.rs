//! Pictures of several meshes side by side.

use super::page::{escape, show};
use crate::error::Result;
use crate::io::ply::MeshSource;
use crate::render::{Resources, View, aim_source, render_source};
use crate::system::progress::Progress;
use base64::Engine;
use std::fmt::Write;

/// Appends a row for each view: its name as a `heading` element, and a `class` of pictures, each above its caption.
pub(super) fn pictures_of(
    meshes: &[(&MeshSource, &str)],
    views: Vec<(&str, View)>,
    (heading, class): (&str, &str),
    resources: Resources,
    out: &mut String,
    progress: &Progress,
) -> Result<()> {
    for (name, view) in views {
        // One camera for all, or they could not be compared.
        let aim = aim_source(meshes[0].0, &view, resources, progress)?;
        let _ = write!(out, "<{heading}>{name}</{heading}><div class=\"{class}\">");
        for (mesh, caption) in meshes {
            let view = View { aim: Some(aim.clone()), ..view.clone() };
            let png = render_source(mesh, &view, resources, progress)?.to_png()?;
            let (caption, n) = (escape(caption), show(&mesh.n_triangles().into()));
            let _ = write!(
                out,
                "<figure><img alt=\"{name}, {caption}\" src=\"data:image/png;base64,{}\">\
                 <figcaption>{caption}: {n} triangles</figcaption></figure>",
                base64::engine::general_purpose::STANDARD.encode(png),
            );
        }
        out.push_str("</div>");
    }
    Ok(())
}
