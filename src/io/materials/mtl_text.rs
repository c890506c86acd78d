//! Material libraries (MTL) as text.

use super::description::{Alpha, MapKind, Materials};
use super::mtl::MAPS;
use std::fmt::Write;

/// The first line of every library that this program writes.
pub(super) fn first_line() -> String {
    format!("# stonecut {}", env!("CARGO_PKG_VERSION"))
}

/// The library of all materials; `names` has the path of each image that the output refers to.
pub(super) fn library(materials: &Materials, names: &[Option<String>]) -> String {
    let mut out = first_line();
    out.push('\n');
    // Writing into memory cannot fail.
    for material in &materials.list {
        let _ = write!(out, "\nnewmtl {}\n", material.name);
        let mut colour = |word: &str, colour: Option<[f32; 3]>| {
            if let Some([r, g, b]) = colour {
                let _ = writeln!(out, "{word} {r} {g} {b}");
            }
        };
        let [r, g, b, opacity] = material.base;
        colour("Ka", material.ambient);
        colour("Kd", Some([r, g, b]));
        colour("Ks", material.specular);
        colour("Ke", material.emissive);
        let opacity = Some(opacity).filter(|&d| d != 1.0);
        for (word, number) in [
            ("Ns", material.shininess),
            ("d", opacity),
            ("Pm", material.metallic),
            ("Pr", material.roughness),
        ] {
            if let Some(number) = number {
                let _ = writeln!(out, "{word} {}", number);
            }
        }
        if material.unlit {
            out.push_str("illum 0\n");
        }
        for line in &material.mtl_lines {
            let _ = writeln!(out, "{line}");
        }
        for (word, kind) in MAPS {
            let Some(map) = material.map(kind) else { continue };
            let Some(name) = &names[map.image] else { continue };
            let options = map.library_options();
            let gap = if options.is_empty() { "" } else { " " };
            let _ = writeln!(out, "{word}{gap}{options} {name}");
            let is_clear = matches!(material.alpha, Alpha::Blend | Alpha::Mask(_));
            if kind == MapKind::Base && is_clear && materials.has_clear_base(material) {
                // Programs that read no opacity out of the colour image read this.
                let _ = writeln!(out, "map_d{gap}{options} {name}");
            }
        }
    }
    out
}
