//! The place of a tree on the earth: a transform that was given, or a coordinate reference system, whose map at the middle of
//! the mesh becomes the transform.

use super::TilesConfig;
use crate::error::{Error, Result};
use crate::io::globe::{Crs, east_north_up_of};
use crate::io::ply::MeshSource;
use crate::io::sidecars::crs_in;
use crate::mesh::bounds::Bounds;
use crate::mesh::placing::Placing;
use crate::system::losses::Loss;

/// The system of a mesh that is open: a place on the earth where its degrees have become metres.
pub(super) fn system_of(config: &TilesConfig, source: &MeshSource) -> Option<String> {
    let code = config.crs.clone()?;
    let place = crs_in(source.comments()).filter(|place| place.starts_with("ENU:"));
    Some(place.filter(|_| Crs::of(&code).is_ok_and(|crs| crs.is_geographic())).unwrap_or(code))
}

/// From the mesh, z upwards, to the world, and what is to be said of it.
pub(super) fn world(
    config: &TilesConfig,
    bounds: &Bounds,
    source: &MeshSource,
) -> Result<([f64; 16], Vec<Loss>)> {
    let Some(code) = &system_of(config, source) else {
        return Ok((config.transform, Vec::new()));
    };
    let offset = source.offset();
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
    Ok((frame.map, crs.remarks(&frame)))
}
