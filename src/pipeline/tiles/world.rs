//! The place of a tree on the earth: a transform that was given, or a coordinate reference system, whose map at the middle of
//! the mesh becomes the transform.

use super::TilesConfig;
use crate::error::{Error, Result};
use crate::io::globe::{Crs, east_north_up_of};
use crate::mesh::bounds::Bounds;
use crate::mesh::placing::Placing;
use crate::system::losses::{Loss, LossKind};

/// Distances from the true place, in metres, that are not worth a line.
const SMALL_BEND: f64 = 0.01;

/// From the mesh, z upwards, to the world, and what is to be said of it. `offset` was subtracted from the mesh's coordinates.
pub(super) fn world(
    config: &TilesConfig,
    bounds: &Bounds,
    offset: Option<[f64; 3]>,
) -> Result<([f64; 16], Vec<Loss>)> {
    let Some(code) = &config.crs else { return Ok((config.transform, Vec::new())) };
    let up = |[x, y, z]: [f64; 3]| if config.is_z_up { [x, y, z] } else { [x, -z, y] };
    let (bounds, offset) = (bounds.map(up), up(offset.unwrap_or_default()));
    if let Some(map) = east_north_up_of(code) {
        let mut placing = Placing::default();
        placing.shift(offset);
        placing.then(&map);
        return Ok((placing.columns(), Vec::new()));
    }
    let crs = Crs::of(code).map_err(Error::Usage)?;
    let frame = crs.frame(&bounds, offset).map_err(|what| {
        let advice = "give the code that its coordinates are of, and --translate or a file beside it for an offset";
        Error::bad_input(&config.input, format!("{what}; {advice}"))
    })?;
    let mut said = Vec::new();
    if let Some(note) = crs.heights_note() {
        said.push(Loss::new(LossKind::Precision, "heights", note).example(crs.name()).notice());
    }
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
