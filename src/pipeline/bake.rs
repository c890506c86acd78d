//! Keeping the texture of the input or making a new one: decided and checked before any work.
//!
//! The decision depends on the input and the settings alone, so a resumed run comes to the same.

use crate::bake::{self, BasisCoding};
use crate::config::{BAKE_BELOW, Config, Normals, Target, Texture};
use crate::error::{Error, Result};
use crate::io::materials::stem;
use crate::io::ply::MeshSource;
use crate::io::{OutputKind, TextureMode};
use crate::mesh::codec::TEXTURE_NAMES;
use crate::store::job;
use crate::system::disk::folder_of;
use crate::system::memory::BASE_BYTES;
use std::path::Path;

/// Decides on the texture of an input that is open; never `Texture::Auto`.
///
/// Errors: a new texture that was asked for and cannot be made, with the reason.
pub(super) fn decide(source: &MeshSource, config: &Config) -> Result<Texture> {
    if config.bake.normals {
        return decide_with_normals(source, config);
    }
    if config.drop_texture && config.texture != Texture::Bake {
        return Ok(Texture::Keep);
    }
    match config.texture {
        Texture::Keep => Ok(Texture::Keep),
        Texture::Bake => match obstacle(source, config)? {
            None => Ok(Texture::Bake),
            Some(what) => Err(Error::Usage(format!("--texture bake: {what}"))),
        },
        Texture::Auto => {
            if let Some(mode) = config.textures.filter(|mode| mode.is_ktx2())
                && bake::has_images(source)
                && let Some(what) = obstacle(source, config)?
            {
                return Err(Error::Usage(format!("--textures {}: {what}", mode.name())));
            }
            let is_to_count = matches!(config.target, Target::Triangles(_) | Target::Ratio(_));
            let bakes = (is_strong(source, config) || has_begun(config))
                && is_to_count
                && bake::has_images(source)
                && obstacle(source, config)?.is_none();
            Ok(if bakes { Texture::Bake } else { Texture::Keep })
        }
    }
}

/// True if so few triangles are wanted that a new texture is better than the old one.
fn is_strong(source: &MeshSource, config: &Config) -> bool {
    let n = source.n_triangles();
    let fewest = config.targets().map(|target| target.triangles(n)).min().unwrap_or(n);
    (fewest as f64) < BAKE_BELOW * n as f64
}

/// Normal maps were asked for: there is a new texture, or an error that says why not.
fn decide_with_normals(source: &MeshSource, config: &Config) -> Result<Texture> {
    let kind = config.kind()?;
    let is_kept = config.texture == Texture::Auto
        && bake::has_images(source)
        && !is_strong(source, config)
        && !has_begun(config);
    let found = [
        (kind == OutputKind::Ply, "PLY has no place for normal maps; write .obj or .glb"),
        (kind == OutputKind::Stl, "STL has no place for normal maps; write .obj or .glb"),
        (config.drop_texture, "not with --texture none: a normal map is a texture"),
        (
            config.texture == Texture::Keep,
            "normal maps need charts made for the result; choose --texture bake",
        ),
        (
            is_kept,
            "the input's charts are kept where 30 % of the triangles or more are wanted; choose --texture bake",
        ),
        (
            config.attributes.normals == Normals::Drop,
            "not with --normals drop: a normal map leans on the result's normals",
        ),
    ];
    let found = found.into_iter().find(|(is_so, _)| *is_so).map(|(_, what)| what.to_owned());
    match found.map_or_else(|| obstacle(source, config), |what| Ok(Some(what)))? {
        None => Ok(Texture::Bake),
        Some(what) => Err(Error::Usage(format!("--bake-normals: {what}"))),
    }
}

/// True if an earlier run of the same command has begun with a new texture, after the old one left too much.
fn has_begun(config: &Config) -> bool {
    let is_baked = |view: job::ManifestView| {
        view.identity.settings.get("texture").is_some_and(|texture| texture == "bake")
    };
    !config.job.restart && job::view(&config.job_folder).is_ok_and(is_baked)
}

/// Refuses outputs whose new images would replace those of the input.
fn refuse_to_replace(source: &MeshSource, config: &Config) -> Result<()> {
    let (Some(materials), kind) = (source.materials(), config.kind()?) else { return Ok(()) };
    config.named_outputs().try_for_each(|output| materials.refuse_new_texture(output, kind))
}

/// True if a run whose charts left too many triangles could be made with a new texture.
pub(super) fn would_help(source: &MeshSource, config: &Config) -> bool {
    let is_possible = || {
        matches!(obstacle(source, config), Ok(None)) && refuse_to_replace(source, config).is_ok()
    };
    config.texture == Texture::Auto
        && !config.drop_texture
        && config.kernel.bound.is_none()
        && bake::has_images(source)
        && is_possible()
}

/// True if a new texture has normal maps: they were asked for, or the input has some and the output has a place for them.
pub(super) fn has_normals(source: &MeshSource, config: &Config) -> Result<bool> {
    let has_place = matches!(config.kind()?, OutputKind::Obj | OutputKind::Glb);
    let is_free = has_place && config.attributes.normals != Normals::Drop;
    Ok(config.bake.normals || (is_free && bake::has_normal_maps(source)))
}

/// Settings of the bake.
pub(super) fn options(config: &Config) -> Result<bake::Options> {
    Ok(bake::Options {
        page_size: config.bake.page_size,
        most_pages: config.bake.most_pages,
        cell_triangles: config.cell_triangles,
        normals: config.bake.normals,
        beside: bake::WantedMaps {
            normals: config.bake.normals,
            surface: matches!(config.kind()?, OutputKind::Obj | OutputKind::Glb),
            occlusion: config.kind()? == OutputKind::Glb,
        },
        coding: match config.textures {
            Some(TextureMode::Ktx2) => Some(BasisCoding::Uastc),
            Some(TextureMode::Etc1s) => Some(BasisCoding::Etc1s),
            _ => None,
        },
        colours_multiply: config.kind()? == OutputKind::Glb,
    })
}

/// The reason why no new texture can be made, if there is one.
pub(super) fn obstacle(source: &MeshSource, config: &Config) -> Result<Option<String>> {
    let stream = Path::new("-");
    let kind = config.kind()?;
    let wants_ktx2 = config.textures.is_some_and(TextureMode::is_ktx2);
    let has_own = |name: &&str| source.schema().own_property(name).is_some();
    let at_vertices = TEXTURE_NAMES.iter().any(|pair| pair.iter().all(has_own));
    let found = [
        (config.drop_texture, "not with --drop-texture"),
        (wants_ktx2 && kind != OutputKind::Glb, "only GLB holds KTX2; write a .glb"),
        (kind == OutputKind::Stl, "STL has no place for a texture; write .obj, .glb or .ply"),
        (config.input == stream, "standard input cannot be read again; give a file"),
        (
            config.output == stream,
            "beside standard output there is no place for images; give a file",
        ),
        (config.kernel.bound.is_some(), "not with --max-error; give --triangles or --ratio"),
        (
            matches!(config.textures, Some(TextureMode::Link | TextureMode::None)),
            "its images are new; choose --textures copy or embed",
        ),
        (wants_ktx2 && !BasisCoding::IS_MADE, "this build makes no KTX2 (feature 'ktx2')"),
        (
            wants_ktx2 && !config.bake.page_size.is_multiple_of(4),
            "pages as KTX2 have sides that are multiples of 4; give another --bake-size",
        ),
        (
            at_vertices,
            "the input has texture coordinates at vertices; convert it to OBJ and back to PLY first, or choose keep",
        ),
        (
            !config.bake.normals && !bake::has_looks(source),
            "the input has neither texture coordinates at the corners of faces nor colours of vertices",
        ),
    ];
    Ok(found.into_iter().find(|(is_so, _)| *is_so).map(|(_, what)| what.to_owned()))
}

/// Fails where a new texture would fail for want of memory or because of what lies beside the output; returns what it
/// needs beside the result.
///
/// `may_be_ours` if an earlier run of the same job may have written that.
pub(super) fn check(
    source: &MeshSource,
    config: &Config,
    may_be_ours: bool,
) -> Result<bake::BakeNeed> {
    refuse_to_replace(source, config)?;
    let n = source.n_triangles();
    let most = config.targets().map(|target| target.triangles(n)).max().unwrap_or(n);
    let usable = config.memory_bytes.saturating_sub(BASE_BYTES);
    let need = bake::check(source, most.min(n), &options(config)?, usable)?;
    let kind = config.kind()?;
    if kind == OutputKind::Glb || config.job.force || may_be_ours {
        return Ok(need);
    }
    for output in config.named_outputs() {
        let stem = stem(output);
        let folder = folder_of(output).join(format!("{stem}_textures"));
        let has_files = std::fs::read_dir(&folder).is_ok_and(|mut files| files.next().is_some());
        let library = output.with_file_name(format!("{stem}.mtl"));
        let found = match (has_files, kind == OutputKind::Obj && library.exists()) {
            (true, _) => &folder,
            (false, true) => &library,
            (false, false) => continue,
        };
        return Err(Error::Usage(format!(
            "{} is there already; give --force to replace what the new texture needs, or OUTPUT another name",
            found.display()
        )));
    }
    Ok(need)
}
