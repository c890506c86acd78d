//! The place of a tree on the earth: a transform that was given, or a coordinate reference system, whose map at the middle of
//! the mesh becomes the transform.

use super::TilesConfig;
use crate::error::{Error, Result};
use crate::io::globe::Crs;
use crate::mesh::bounds::Bounds;
use crate::system::losses::{Loss, LossKind};

/// Distances from the true place, in metres, that are not worth a line.
const SMALL_BEND: f64 = 0.01;

/// From the mesh, z upwards, to the world, and what is to be said of it. `offset` was subtracted from the mesh's coordinates.
pub(super) fn world(
    config: &TilesConfig,
    bounds: &Bounds,
    offset: Option<[f64; 3]>,
) -> Result<([f64; 16], Vec<Loss>)> {
    let Some(place) = &config.crs else { return Ok((config.transform, Vec::new())) };
    let crs = Crs::of(&place.code).map_err(Error::Usage)?;
    let own = offset.unwrap_or_default();
    let offset = [0, 1, 2].map(|k| own[k] + place.offset[k]);
    let bounds = if config.is_z_up { *bounds } else { bounds.map(|[x, y, z]| [x, -z, y]) };
    let frame = crs.frame(&bounds, offset).map_err(|what| {
        let advice = "give the code that its coordinates are of, and --translate or a file beside it for an offset";
        Error::bad_input(&config.input, format!("{what}; {advice}"))
    })?;
    let mut said = Vec::new();
    if frame.bend > SMALL_BEND {
        let why = format!(
            "the earth is round, the tree is not: up to {:.2} m at its corners",
            frame.bend
        );
        said.push(Loss::new(LossKind::Precision, "places on the globe", why).notice());
    }
    if crs.has_shift() {
        let why =
            format!("the datum of {} is shifted without a grid: by a metre or some", crs.name());
        said.push(Loss::new(LossKind::Precision, "places on the globe", why).notice());
    }
    Ok((frame.map, said))
}
