//! Images that glTF does not know, for a GLB that keeps the input's images: decoded one after the other and written as PNG.
//!
//! Values stay in their places, so this serves images of colours and of numbers; more than eight bits a channel are rounded.

use super::images::as_png;
use super::opacity::settle_opacity;
use std::path::Path;
use std::sync::Arc;
use stonecut_io::materials::{ImageData, Materials, Part, look_at_image};
use stonecut_io::ply::raw::Spool;
use stonecut_io::{OutputKind, StageOptions, TextureMode, TexturePlan, TextureRequest};
use stonecut_system::error::Result;
use stonecut_system::losses::{Ledger, Loss, LossKind};

/// Endings of these kinds. EXR is not one: it holds light, or numbers, of more than eight bits.
const KINDS: [&str; 4] = ["bmp", "gif", "tga", "tif"];

/// Decides for one output, as `TexturePlan::new`; a GLB has images of kinds that glTF does not know as PNG, and blends only where
/// texels let a share of the light through.
///
/// Memory: one image while it is decoded, within the bytes to parse in, and up to 16 MiB of PNG, further ones in a nameless
/// file. An image that they do not hold stays as it is, which is a loss.
pub fn plan_textures(
    materials: &Arc<Materials>,
    request: &TextureRequest,
    stage: &StageOptions,
) -> Result<TexturePlan> {
    let embeds = matches!(request.mode, None | Some(TextureMode::Embed));
    if request.kind != OutputKind::Glb || !embeds {
        return TexturePlan::new(materials.clone(), request);
    }
    let spool = Spool::new(&stage.temp_dir).within(stage.memory_bytes);
    let mut spool = spool.counted(&stage.disk);
    let (mut parts, mut most) = (Vec::new(), 0);
    for (number, image) in materials.images.iter().enumerate() {
        let facts = look_at_image(&image.data).ok();
        let facts = facts.filter(|facts| KINDS.contains(&facts.ending) && !facts.is_too_large);
        let Some((facts, size)) = facts.and_then(|facts| facts.size.map(|size| (facts, size)))
        else {
            continue;
        };
        // The file and what its decoder holds; pixels with and without opacity, and the PNG.
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let bytes = facts.n_bytes + (facts.decoder_pixel_bytes + 12) * pixels;
        if bytes > stage.parse_bytes {
            most = most.max(bytes);
            continue;
        }
        let Ok(png) = as_png(&image.data, size) else { continue };
        parts.push((number, spool.len(), png.len() as u64, facts.ending));
        spool.write(&png)?;
    }
    let file = Arc::new(spool.finish(Path::new("images as PNG"))?);
    let (mut out, losses) = settle_opacity(materials, stage.parse_bytes)
        .unwrap_or_else(|| (Materials::clone(materials), Ledger::default()));
    for &(number, offset, n_bytes, _) in &parts {
        out.images[number].data = ImageData::Inside(Part { file: file.clone(), offset, n_bytes });
    }
    let mut plan = TexturePlan::new(Arc::new(out), request)?;
    plan.losses.merge(&losses);
    for (number, _, _, ending) in parts {
        let reason = format!("as PNG, since glTF knows no {ending}");
        let loss = Loss::new(LossKind::Images, "image", reason).notice();
        plan.losses.lose(loss.example(format!("'{}'", materials.images[number].name)));
    }
    if most > 0 {
        let memory = StageOptions::memory_for(most);
        let what = format!(
            "an image takes more memory than there is to become PNG: give --memory {memory}"
        );
        plan.losses.lose(Loss::remark(what));
    }
    Ok(plan)
}
