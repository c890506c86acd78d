//! Coordinate reference systems: from map coordinates to the earth (WGS 84), by the code that EPSG gives them.
//!
//! Projections are those of `proj4rs`, definitions those of `crs-definitions`. Only methods that were compared with PROJ are taken
//! (`tools/epsg_codes.py`, docs/results/inputs.md). Shifts between datums have three or seven parameters; grids are not read.

use crate::heights::{Heights, unit_of_maps, value_in};
use proj4rs::Proj;
use proj4rs::transform::transform;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::{length_sq, sub};
use stonecut_system::losses::{Loss, LossKind};

/// Distances from the true place, in metres, that are not worth a line.
const SMALL_BEND: f64 = 0.01;

/// Methods of projection that agree with PROJ.
const METHODS: [&str; 11] = [
    "utm", "tmerc", "lcc", "somerc", "sterea", "stere", "merc", "laea", "aea", "longlat", "geocent",
];

/// Datums whose parameters in `crs-definitions` are rounded or older: what stands in a definition, and what EPSG has
/// (operations 1314 and 15934).
const SHIFTS: [(&str, &str); 2] = [
    ("+datum=OSGB36", "+ellps=airy +towgs84=446.448,-125.157,542.06,0.15,0.247,0.842,-20.489"),
    (
        "+towgs84=565.2369,50.0087,465.658,-0.406857,0.350733,-1.87035,4.0812",
        "+towgs84=565.4171,50.3319,465.5524,-0.398957388243134,0.343987817378283,-1.87740163998045,4.0725",
    ),
];

/// Methods whose unit is one on the earth within a share where they are meant for: zones of transverse Mercator are off by 0.005 at
/// twice their width, the conic of Canada by 0.08 in the north.
const SCALES: [(&str, f64); 5] =
    [("utm", 0.03), ("tmerc", 0.03), ("somerc", 0.03), ("sterea", 0.03), ("lcc", 0.1)];

/// Nothing that is scanned lies higher or deeper, in metres.
const HIGH: f64 = 100_000.0;

/// A coordinate reference system.
pub struct Crs {
    code: u16,
    /// The system of heights, if it is named.
    vertical: Option<u16>,
    heights: Heights,
    from: Proj,
    to: Proj,
    is_geocentric: bool,
    has_shift: bool,
    /// Metres of a unit of x and y, and by how much of them it may be off where the system is meant for, with y to the north.
    scale: Option<(f64, f64)>,
}

/// The map from a mesh to the earth near a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EarthFrame {
    /// From coordinates of the mesh to those of the earth's centre (EPSG:4978), by columns.
    pub map: [f64; 16],
    /// The largest distance between that map and the system itself in the box of the mesh, in metres: the earth is round.
    pub bend: f64,
    /// The middle as latitude and longitude, if the system is not meant for there.
    pub astray: Option<[f64; 2]>,
}

/// Metres east and north of the middle of a mesh in degrees.
#[derive(Clone, Debug, PartialEq)]
pub struct LocalMetres {
    /// Their place, `ENU:LAT,LON`.
    pub place: String,
    /// From coordinates of the mesh, which count from its offset, to them; by columns.
    pub map: [f64; 16],
    /// Remarks on the place.
    pub said: Vec<Loss>,
}

impl Crs {
    /// The system of a text: `EPSG:32633`, `32633`, or with a system of heights `EPSG:32633+5773`. Errors say what is wrong with it.
    pub fn of(text: &str) -> Result<Crs, String> {
        let (code, vertical) = codes_of(text).ok_or_else(|| {
            format!("'{text}': the code of a coordinate reference system is EPSG and a number, as in EPSG:32633")
        })?;
        let fail = |what: &str| {
            format!(
                "EPSG:{code}: {what}; reproject the mesh to UTM first, or give --geo or --transform"
            )
        };
        let known = crs_definitions::from_code(code);
        let mut definition = known.map(|known| known.proj4.to_owned()).unwrap_or_default();
        if definition.is_empty() {
            return Err(fail("no definition of this code is known"));
        }
        for (old, new) in SHIFTS {
            definition = definition.replace(old, new);
        }
        let value = |key: &str| value_in(&definition, key);
        let method = value("+proj=").unwrap_or_default();
        if !METHODS.contains(&method) {
            return Err(fail(&format!("its projection '{method}' is not read")));
        }
        if value("+nadgrids=").is_some_and(|grids| grids != "@null") {
            return Err(fail("its datum needs a grid of shifts, which is not read"));
        }
        let shift = value("+towgs84=").unwrap_or_default();
        let is_world = ["+datum=WGS84", "+datum=NAD83", "+nadgrids=@null"];
        let has_shift = match shift {
            "" => !is_world.iter().any(|word| definition.contains(word)),
            numbers => numbers.split(',').any(|n| n.parse() != Ok(0.0)),
        };
        let is_geocentric = method == "geocent";
        let heights = match vertical {
            Some(_) if is_geocentric => return Err(fail("it has no heights beside its places")),
            Some(vertical) => Heights::of_code(vertical)?,
            None => Heights::of_definition(&definition),
        };
        let parse = |text: &str| Proj::from_proj_string(text);
        let from =
            parse(&definition).map_err(|e| fail(&format!("its definition is not read ({e})")))?;
        let to = parse("+proj=longlat +datum=WGS84 +no_defs").map_err(|e| fail(&e.to_string()))?;
        let known =
            SCALES.iter().find(|(known, _)| *known == method && !definition.contains("+axis="));
        let scale = known.map(|(_, within)| (unit_of_maps(&definition), *within));
        Ok(Crs { code, vertical, heights, from, to, is_geocentric, has_shift, scale })
    }

    /// `EPSG:n`, or `EPSG:n+m` with a system of heights.
    pub fn name(&self) -> String {
        epsg_name(self.code, self.vertical)
    }

    /// True if x and y are degrees.
    pub fn is_geographic(&self) -> bool {
        self.from.is_latlong()
    }

    /// Remarks on a tree that a frame puts on the earth.
    pub fn remarks(&self, frame: &EarthFrame) -> Vec<Loss> {
        let say = |what: &str, why: &str| Loss::new(LossKind::Precision, what, why).notice();
        let mut said = Vec::new();
        said.extend(self.heights.note().map(|note| say("heights", note).example(self.name())));
        if let Some([latitude, longitude]) = frame.astray {
            let why = format!(
                "latitude {latitude:.2}, longitude {longitude:.2}, far from where {} is meant for: is it the system of these \
                 coordinates?",
                self.name()
            );
            said.push(say("places on the globe", &why));
        }
        if frame.bend > SMALL_BEND {
            let bend = frame.bend;
            let why =
                format!("the earth is round, the tree is not: up to {bend:.2} m at its corners");
            said.push(say("places on the globe", &why));
        }
        if self.has_shift {
            let why = format!(
                "the datum of {} is shifted without a grid: by a metre or some",
                self.name()
            );
            said.push(say("places on the globe", &why));
        }
        said
    }

    /// Degrees as metres: the map that fits best at the middle of a mesh, along its axes, whose coordinates count from `offset`.
    /// Heights stay above the ellipsoid, in metres.
    pub fn local(
        &self,
        bounds: &Bounds,
        offset: [f64; 3],
        is_y_up: bool,
    ) -> Result<LocalMetres, String> {
        let up = |[x, y, z]: [f64; 3]| if is_y_up { [x, 0.0 - z, y] } else { [x, y, z] };
        let (bounds, offset) = (bounds.map(up), up(offset));
        let frame = self.frame(&bounds, offset)?;
        let middle = bounds.middle();
        let at = [0, 1, 2].map(|k| middle[k] + offset[k]);
        let [latitude, longitude, _] = self.geographic(at).unwrap_or_default();
        let length = |axis: usize| {
            let column = &frame.map[4 * axis..4 * axis + 3];
            column.iter().map(|x| x * x).sum::<f64>().sqrt()
        };
        let metres = [0, 1, 2].map(length);
        let shift = [-middle[0], -middle[1], offset[2]];
        let mut map = [0.0; 16];
        map[15] = 1.0;
        for (k, axis) in (0..3).map(|k| (k, if is_y_up { [0, 2, 1][k] } else { k })) {
            let sign = if is_y_up && k == 1 { -1.0 } else { 1.0 };
            map[5 * axis] = metres[k];
            map[12 + axis] = sign * metres[k] * shift[k];
        }
        Ok(LocalMetres {
            place: format!("ENU:{latitude},{longitude}"),
            map,
            said: self.remarks(&frame),
        })
    }

    /// Latitude and longitude in degrees, and the height above the ellipsoid of WGS 84 (metres), of a place; x is east or
    /// longitude. Heights become metres, and stay what they are otherwise: those above the sea need the geoid first. `None` outside
    /// of the projection.
    pub fn geographic(&self, [x, y, z]: [f64; 3]) -> Option<[f64; 3]> {
        let z = z * self.heights.metres();
        let is_angle = self.is_geographic();
        if is_angle && !(x.abs() <= 360.0 && y.abs() <= 90.0) {
            return None;
        }
        let mut place = if is_angle { (x.to_radians(), y.to_radians(), z) } else { (x, y, z) };
        transform(&self.from, &self.to, &mut place).ok()?;
        let height = if self.is_geocentric { place.2 } else { z };
        let out = [place.1.to_degrees(), place.0.to_degrees(), height];
        out.iter().all(|x| x.is_finite()).then_some(out)
    }

    /// The place counted from the earth's centre (EPSG:4978), in metres.
    pub fn geocentric(&self, place: [f64; 3]) -> Option<[f64; 3]> {
        if self.is_geocentric {
            return place.iter().all(|x| x.is_finite()).then_some(place);
        }
        self.geographic(place).map(from_centre)
    }

    /// The map to the earth that fits best at the middle of a mesh, whose coordinates count from `offset`.
    pub fn frame(&self, bounds: &Bounds, offset: [f64; 3]) -> Result<EarthFrame, String> {
        let middle = bounds.middle();
        let world = |p: [f64; 3]| -> Result<[f64; 3], String> {
            let place = [0, 1, 2].map(|k| p[k] + offset[k]);
            self.geocentric(place).ok_or_else(|| {
                let [x, y, z] = place;
                format!(
                    "{}: the place {x} {y} {z} of the mesh lies outside of this system{}",
                    self.name(),
                    if self.is_geographic() {
                        ", which has degrees: x is east, y north"
                    } else {
                        ""
                    }
                )
            })
        };
        let centre = world(middle)?;
        // A metre, or as many degrees: the second differences of every projection are far below rounding there.
        let step = if self.from.is_latlong() { 1e-5 } else { 1.0 };
        let mut map = [0.0; 16];
        map[15] = 1.0;
        for axis in 0..3 {
            let step = if axis == 2 { 1.0 } else { step };
            let beside = |by: f64| {
                let mut p = middle;
                p[axis] += by;
                world(p)
            };
            let (before, behind) = (beside(-step)?, beside(step)?);
            for k in 0..3 {
                map[4 * axis + k] = (behind[k] - before[k]) / (2.0 * step);
            }
        }
        for k in 0..3 {
            let turned: f64 = (0..3).map(|axis| map[4 * axis + k] * middle[axis]).sum();
            map[12 + k] = centre[k] - turned;
        }
        let mut bend: f64 = 0.0;
        for corner in 0..8 {
            let p = [0, 1, 2].map(|k| [bounds.low, bounds.high][corner >> k & 1][k]);
            let mapped = [0, 1, 2].map(|k| {
                centre[k] + (0..3).map(|a| map[4 * a + k] * (p[a] - middle[a])).sum::<f64>()
            });
            bend = bend.max(length_sq(sub(world(p)?, mapped)).sqrt());
        }
        let place = [0, 1, 2].map(|k| middle[k] + offset[k]);
        let [latitude, longitude, height] = self.geographic(place).unwrap_or_default();
        let north = &east_north_up([latitude, longitude, height])[4..7];
        let column = |axis: usize| &map[4 * axis..4 * axis + 3];
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let is_true = self.scale.is_none_or(|(unit, within)| {
            let off = |axis: usize| (dot(column(axis), column(axis)).sqrt() / unit - 1.0).abs();
            off(0) < within && off(1) < within && dot(column(1), north) > 0.0
        });
        let is_there = is_true && height.abs() < HIGH;
        Ok(EarthFrame { map, bend, astray: (!is_there).then_some([latitude, longitude]) })
    }
}

/// The number in `EPSG:32633`, `urn:ogc:def:crs:EPSG::32633` or `32633`, and that of a system of heights behind it, as in
/// `EPSG:32633+5773`.
pub(crate) fn codes_of(text: &str) -> Option<(u16, Option<u16>)> {
    let text = text.trim();
    let digits = match text.to_ascii_uppercase().rfind("EPSG") {
        Some(at) => {
            text[at + 4..].rsplit(':').next().filter(|_| text[at + 4..].starts_with(':'))?
        }
        None => text,
    };
    let code = |digits: &str| digits.trim().parse().ok();
    match digits.split_once('+') {
        Some((digits, heights)) => Some((code(digits)?, Some(code(heights)?))),
        None => Some((code(digits)?, None)),
    }
}

/// `EPSG:n`, or `EPSG:n+m` with a system of heights.
pub(crate) fn epsg_name(code: u16, vertical: Option<u16>) -> String {
    let vertical = vertical.map_or_else(String::new, |m| format!("+{m}"));
    format!("EPSG:{code}{vertical}")
}

/// From latitude, longitude in degrees and height on WGS 84 to the earth's centre.
pub fn from_centre([latitude, longitude, height]: [f64; 3]) -> [f64; 3] {
    let (axis, flattening) = (6_378_137.0, 1.0 / 298.257_223_563);
    let (sin_lat, cos_lat) = f64::sin_cos(f64::to_radians(latitude));
    let (sin_lon, cos_lon) = f64::sin_cos(f64::to_radians(longitude));
    let off: f64 = flattening * (2.0 - flattening);
    let normal = axis / (1.0 - off * sin_lat * sin_lat).sqrt();
    let around = (normal + height) * cos_lat;
    [around * cos_lon, around * sin_lon, (normal * (1.0 - off) + height) * sin_lat]
}

/// From east, north and up at a place of the earth to its centre (WGS 84); by columns.
pub fn east_north_up(place: [f64; 3]) -> [f64; 16] {
    let [latitude, longitude, _] = place;
    let (sin_lat, cos_lat) = latitude.to_radians().sin_cos();
    let (sin_lon, cos_lon) = longitude.to_radians().sin_cos();
    let [x, y, z] = from_centre(place);
    let east = [-sin_lon, cos_lon, 0.0, 0.0];
    let north = [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat, 0.0];
    let up = [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat, 0.0];
    let columns = [east, north, up, [x, y, z, 1.0]];
    std::array::from_fn(|i| columns[i / 4][i % 4])
}

/// The same for `ENU:LAT,LON` or `ENU:LAT,LON,HEIGHT`; `None` for another text.
pub fn east_north_up_of(text: &str) -> Option<[f64; 16]> {
    let words = text.strip_prefix("ENU:")?.split(',');
    let numbers: Option<Vec<f64>> = words.map(|word| word.trim().parse().ok()).collect();
    match numbers?[..] {
        [latitude, longitude] => Some(east_north_up([latitude, longitude, 0.0])),
        [latitude, longitude, height] => Some(east_north_up([latitude, longitude, height])),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Code, place, and latitude, longitude and height of PROJ 9.5.1 (pyproj 3.7.2, always_xy), as `tools/epsg_codes.py`
    /// prints them.
    const OF_PROJ: [(&str, [f64; 3], [f64; 3]); 10] = [
        (
            "EPSG:32633",
            [500_400.0, 4_600_200.0, 100.0],
            [41.553_465_896_705_05, 15.004_796_503_111_665, 100.0],
        ),
        (
            "EPSG:32756",
            [334_000.0, 6_252_000.0, 30.0],
            [-33.859_261_704_504_05, 151.205_514_686_936_37, 30.0],
        ),
        (
            "EPSG:25832",
            [691_000.0, 5_335_000.0, 520.0],
            [48.139_558_349_867_734, 11.567_501_229_235_19, 520.0],
        ),
        (
            "EPSG:2056",
            [2_683_000.0, 1_247_000.0, 408.0],
            [47.368_613_926_079_945, 8.537_504_949_270_71, 408.0],
        ),
        (
            "EPSG:2154",
            [652_000.0, 6_862_000.0, 35.0],
            [48.856_248_140_962_73, 2.345_811_958_680_679, 35.0],
        ),
        (
            "EPSG:27700",
            [530_000.0, 180_000.0, 10.0],
            [51.503_990_826_724_76, -0.128_353_937_682_018_78, 10.0],
        ),
        (
            "EPSG:28992",
            [121_000.0, 487_000.0, 2.0],
            [52.369_826_210_117_87, 4.887_970_764_823_003, 2.0],
        ),
        (
            "EPSG:3067",
            [385_000.0, 6_672_000.0, 15.0],
            [60.168_665_999_849_87, 24.927_457_713_312_172, 15.0],
        ),
        (
            "EPSG:3857",
            [950_000.0, 6_000_000.0, 50.0],
            [47.353_704_702_433_106, 8.533_995_199_135_454, 50.0],
        ),
        ("EPSG:4326", [8.5417, 47.3769, 408.0], [47.3769, 8.5417, 408.0]),
    ];

    #[test]
    fn ten_systems_agree_with_proj_within_a_millimetre() {
        for (code, place, wanted) in OF_PROJ {
            let crs = Crs::of(code).unwrap();
            let found = crs.geocentric(place).unwrap();
            let off = length_sq(sub(found, from_centre(wanted))).sqrt();
            assert!(off < 1e-3, "{code}: {off} m");
        }
    }

    /// PROJ 9.5.1 has 40.71562947724367, -74.01533101531926, 3.048 m for EPSG:2263+6360.
    #[test]
    fn heights_have_the_unit_of_their_system() {
        for (code, height) in [
            ("EPSG:2263+6360", 10.0 * 1200.0 / 3937.0),
            ("EPSG:2263+8228", 3.048),
            ("EPSG:2263+5703", 10.0),
            ("EPSG:2263", 10.0),
        ] {
            let crs = Crs::of(code).unwrap();
            assert_eq!(crs.name(), code);
            let found = crs.geographic([980_000.0, 200_000.0, 10.0]).unwrap();
            assert!((found[0] - 40.715_629_477_243_67).abs() < 1e-8, "{found:?}");
            assert!((found[2] - height).abs() < 1e-9, "{code} {found:?}");
            assert!(crs.heights.note().is_some(), "{code}");
        }
        assert!(Crs::of("EPSG:32633").unwrap().heights.note().is_none());
        assert!(Crs::of("EPSG:5555").unwrap().heights.note().is_some());
    }

    #[test]
    fn a_frame_is_the_system_near_its_middle_and_says_how_far_it_bends() {
        let crs = Crs::of("epsg:32633").unwrap();
        let offset = [500_000.0, 4_600_000.0, 100.0];
        let bounds = Bounds { low: [0.0; 3], high: [1000.0, 800.0, 50.0] };
        let frame = crs.frame(&bounds, offset).unwrap();
        let at = |p: [f64; 3]| {
            let m = &frame.map;
            [0, 1, 2].map(|r| m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r])
        };
        let true_place = |p: [f64; 3]| crs.geocentric([0, 1, 2].map(|k| p[k] + offset[k])).unwrap();
        let off = |p: [f64; 3]| length_sq(sub(at(p), true_place(p))).sqrt();
        assert!(off([500.0, 400.0, 25.0]) < 1e-6);
        // Half the square of the distance over the radius.
        let bend = (500f64.powi(2) + 400f64.powi(2)) / 2.0 / 6.37e6;
        assert!((frame.bend / bend - 1.0).abs() < 0.1, "{} {bend}", frame.bend);
        assert!(off([0.0; 3]) <= frame.bend * 1.000_001);
    }

    #[test]
    fn coordinates_of_another_system_are_noticed() {
        let astray = |code: &str, place: [f64; 3]| {
            let bounds = Bounds { low: place, high: place.map(|x| x + 10.0) };
            Crs::of(code).unwrap().frame(&bounds, [0.0; 3]).unwrap().astray.is_some()
        };
        let in_utm = [500_250.0, 5_200_200.0, 400.0];
        for code in ["EPSG:2056", "EPSG:27700", "EPSG:28992", "EPSG:4978"] {
            assert!(astray(code, in_utm), "{code}");
        }
        assert!(astray("EPSG:25832", [2_600_000.0, 1_200_000.0, 400.0]));
        assert!(!astray("EPSG:4978", from_centre([47.0, 9.0, 400.0])));
        for (code, place, _) in OF_PROJ {
            assert!(!astray(code, place), "{code}");
        }
        assert!(!astray("EPSG:2263+6360", [980_000.0, 200_000.0, 10.0]));
        assert!(!astray("EPSG:3413", [-500_000.0, -2_000_000.0, 0.0]));
    }

    #[test]
    fn what_is_not_known_is_refused_with_the_way_out() {
        for (code, words) in [
            ("WGS84", "EPSG and a number"),
            ("EPSG:1", "no definition"),
            ("EPSG:99999", "EPSG and a number"),
            ("EPSG:5514", "krovak"),
            ("EPSG:32633+5715", "EPSG:5715 is not a system of heights"),
            ("EPSG:32633+4326", "EPSG:4326 is not a system of heights"),
            ("EPSG:4978+5773", "no heights beside its places"),
        ] {
            let error = Crs::of(code).err().unwrap();
            assert!(error.contains(words), "{code}: {error}");
        }
        assert_eq!(codes_of("urn:ogc:def:crs:EPSG::25832"), Some((25832, None)));
        assert_eq!(codes_of("EPSG:25832+7837"), Some((25832, Some(7837))));
        assert_eq!(codes_of("EPSG:25832+x"), None);
        assert!(Crs::of("EPSG:27700").unwrap().has_shift);
        assert!(!Crs::of("EPSG:25832").unwrap().has_shift);
    }

    #[test]
    fn places_on_the_earth_have_their_axes() {
        let m = east_north_up([0.0, 90.0, 10.0]);
        let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
        // East is -x there, north is z, up is y.
        assert!(near(m[0], -1.0) && near(m[6], 1.0) && near(m[9], 1.0));
        assert!(near(m[12], 0.0) && near(m[13], 6_378_147.0) && near(m[14], 0.0));
        assert!(near(east_north_up([90.0, 0.0, 0.0])[14], 6_356_752.314_245_179));
    }
}
