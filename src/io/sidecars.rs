//! The place of a mesh: files beside it, written by photogrammetry programs, and comments in it, which carry the place on.
//!
//! | program | file |
//! |---|---|
//! | ContextCapture, iTwin | `metadata.xml` beside the mesh or one or two folders above: `SRS`, `SRSOrigin` |
//! | OpenDroneMap | `odm_georeferencing_model_geo.txt` or `coords.txt` beside the mesh, or in `odm_georeferencing` beside its folder `odm_...`: zone and offset |
//! | Pix4D | `NAME_offset.xyz` and `NAME_wkt.prj` of the project, beside `NAME_simplified_3d_mesh...` or in its `1_initial/params` |
//! | Metashape, RealityCapture and others | `NAME.prj` (WKT), `NAME.xyz`, `NAME_offset.xyz` or `offset.xyz`: three numbers |
//!
//! | in the file | comment |
//! |---|---|
//! | stonecut | `crs EPSG:n` and `offset: X Y Z`; in GLB extras, in STL the header |
//! | QGIS and others | `crs WKT`, `crs: EPSG:n` |
//! | scanners | `epsg n`, `offsetx X`, `offsety Y`, `offsetz Z` |

use crate::encodings::text_of_file;
use crate::wkt::epsg;
use std::path::{Path, PathBuf};
use stonecut_mesh::placing::{offset_of, offset_words};
use stonecut_system::disk::read_regular;
use stonecut_system::losses::{Loss, LossKind};

/// A file beside a mesh is text of a few lines.
const MOST_BYTES: u64 = 256 << 10;

/// The place of a mesh as files beside it say.
#[derive(Clone, Debug, PartialEq)]
pub struct Georeference {
    /// `EPSG:n`, or `ENU:LAT,LON` for east and north at a place; empty if no file says it.
    pub crs: String,
    /// To be added to all coordinates.
    pub offset: [f64; 3],
    /// The files beside the mesh, if it was not the mesh itself.
    pub found_in: Vec<PathBuf>,
}

/// Begins the remark on a place.
pub const LIES_AT: &str = "lies at ";

/// Begins the comment on a system, as QGIS reads it.
pub(crate) const CRS: &str = "crs ";

/// The system where only an offset is known: the place of such a file is whole.
pub(crate) const UNKNOWN: &str = "unknown";

/// The system that comments name: empty if it is not understood.
pub fn crs_in(comments: &[String]) -> Option<String> {
    comments.iter().find_map(|comment| crs_of(comment))
}

/// The system that one comment names: empty if it is not understood.
pub(crate) fn crs_of(comment: &str) -> Option<String> {
    // The name of a solid of STL, which is its only comment.
    let comment = comment.strip_prefix("solid ").unwrap_or(comment);
    let (name, rest) = comment.split_once(' ')?;
    let (name, rest) = (name.trim_end_matches(':'), rest.trim());
    let first = rest.split(' ').next().unwrap_or_default();
    if name.eq_ignore_ascii_case("epsg") {
        return first.parse().ok().filter(|n: &u16| *n > 0).map(|n| format!("EPSG:{n}"));
    }
    let is_place = first.starts_with("ENU:");
    let named =
        || if is_place { first.to_owned() } else { epsg(first).or(epsg(rest)).unwrap_or_default() };
    name.eq_ignore_ascii_case("crs").then(named)
}

/// The loss of a place on a map, which has z upwards, where axes stay as they are between glTF, which has y, and other formats.
pub fn lost_axes(comments: &[String], is_y_up: bool, becomes_y_up: bool) -> Option<Loss> {
    let crs = crs_in(comments).filter(|crs| !crs.is_empty() && is_y_up != becomes_y_up)?;
    let (up, other) = if is_y_up { ('y', 'z') } else { ('z', 'y') };
    let what = format!("the place on the map ({crs})");
    let reason = format!("axes stay as they are, {up} upwards, where {other} should be");
    let loss = Loss::new(LossKind::Precision, what, reason);
    Some(loss.remedy(format!("convert with --up {up} turns them")))
}

/// The comments of the one text that an STL file has: its offset stands before its system, and behind it the words of this
/// program, as far as there was room.
pub(crate) fn comments_of(text: String) -> Vec<String> {
    let is_place = |text: &str| offset_of(text).is_some() || crs_of(text).is_some();
    let place = text.split(" stonecut ").next().filter(|place| is_place(place)).unwrap_or(&text);
    match place.split_once(" crs ").filter(|_| offset_of(place).is_some()) {
        Some((offset, crs)) => {
            let crs = crs.split(' ').next().unwrap_or_default();
            vec![offset.to_owned(), format!("{CRS}{crs}")]
        }
        None => vec![place.to_owned()],
    }
}

/// The comments on a place in one line, for the header of an STL file.
pub(crate) fn place_words(comments: &[String]) -> String {
    let offset = stonecut_mesh::placing::offset_in(comments).map(offset_words);
    let crs = crs_in(comments).map(|crs| match crs.as_str() {
        "" => format!("{CRS}{UNKNOWN}"),
        _ => format!("{CRS}{crs}"),
    });
    let words: Vec<String> = offset.into_iter().chain(crs).collect();
    words.join(" ")
}

impl Georeference {
    /// Looks beside a mesh. What is not understood is taken as absent.
    pub fn beside(mesh: &Path) -> Option<Georeference> {
        let [folder, above, higher] = &folders_of(mesh);
        let found = [folder, above, higher].iter().find_map(|at| of_context_capture(at));
        let is_odm = || {
            let name =
                std::fs::canonicalize(folder).ok()?.file_name()?.to_string_lossy().into_owned();
            name.starts_with("odm_").then(|| above.join("odm_georeferencing"))
        };
        let found = found.or_else(|| of_odm(folder)).or_else(|| of_odm(&is_odm()?));
        let found = found.or_else(|| of_name(mesh, folder));
        found.or_else(|| {
            [folder, &higher.join("1_initial/params")].into_iter().find_map(|at| of_pix4d(mesh, at))
        })
    }

    /// The loss of a place: a `metadata.xml` of a model beside a mesh or above it, a `.prj`, or a file of an offset beside it that is
    /// not understood.
    pub(crate) fn broken_beside(mesh: &Path) -> Option<Loss> {
        let broken = |path: PathBuf| {
            Loss::new(LossKind::Precision, "the place of the mesh", "is not understood")
                .example(path.display().to_string())
        };
        let paths = folders_of(mesh).map(|folder| folder.join("metadata.xml"));
        let is_broken = |path: &PathBuf| {
            text_of(path).is_some_and(|text| text.contains("<SRS"))
                && path
                    .parent()
                    .and_then(of_context_capture)
                    .is_none_or(|found| found.crs.is_empty())
        };
        let prj = mesh.with_extension("prj");
        let is_unknown = |text: String| !text.trim().is_empty() && epsg(&text).is_none();
        let is_broken_prj = |prj: &PathBuf| text_of(prj).is_some_and(is_unknown);
        let system = paths.into_iter().find(is_broken).or_else(|| Some(prj).filter(is_broken_prj));
        system.map(broken).or_else(|| {
            let (path, _) = offset_beside(mesh, &folders_of(mesh)[0]).filter(|(_, by)| by.is_none())?;
            let remedy = "an offset is three numbers with decimal points; mend the file, or give --translate";
            Some(broken(path).remedy(remedy))
        })
    }

    /// True for no offset without a system: coordinates as they are.
    pub(crate) fn is_nowhere(&self) -> bool {
        self.crs.is_empty() && self.offset == [0.0; 3]
    }

    /// The place in a few words.
    pub fn words(&self) -> String {
        let [x, y, z] = self.offset;
        let crs = if self.crs.is_empty() { String::new() } else { format!("{}, ", self.crs) };
        let files: Vec<String> = self
            .found_in
            .iter()
            .map(|file| match file.components().any(|part| part.as_os_str() == "..") {
                // Not beside the mesh.
                true => std::fs::canonicalize(file).unwrap_or(file.clone()).display().to_string(),
                false => file.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            })
            .collect();
        let files =
            if files.is_empty() { String::new() } else { format!(" ({})", files.join(", ")) };
        format!("{crs}offset {x} {y} {z}{files}")
    }

    /// Names of the files.
    pub(crate) fn names(&self) -> String {
        let names = self.found_in.iter().filter_map(|file| file.file_name());
        let shown = |name: &std::ffi::OsStr| name.to_string_lossy().replace(char::is_control, "?");
        names.map(shown).collect::<Vec<_>>().join(", ")
    }
}

/// The folder of a mesh, the one above and the one above that.
fn folders_of(mesh: &Path) -> [PathBuf; 3] {
    let folder = mesh.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new(".")).to_path_buf();
    let above = folder.join("..");
    let higher = above.join("..");
    [folder, above, higher]
}

fn text_of(path: &Path) -> Option<String> {
    let bytes = read_regular(path, MOST_BYTES).ok()?;
    Some(String::from_utf8_lossy(&text_of_file(bytes)).into_owned())
}

/// Numbers with blanks, commas or semicolons between them; none if anything else is there.
fn numbers(text: &str) -> Option<Vec<f64>> {
    let words = text.split(|c: char| c.is_whitespace() || matches!(c, ',' | ';'));
    words
        .filter(|word| !word.is_empty())
        .map(|word| word.parse().ok().filter(|x: &f64| x.is_finite()))
        .collect()
}

/// XML without its comments.
fn plain_xml(text: &str) -> String {
    let mut parts = text.split("<!--");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |all, part| all + part.split_once("-->").map_or("", |(_, rest)| rest))
}

/// Text of XML with its entities resolved.
fn unescaped(text: &str) -> String {
    let entities =
        [("&quot;", "\""), ("&apos;", "'"), ("&lt;", "<"), ("&gt;", ">"), ("&amp;", "&")];
    entities.iter().fold(text.to_owned(), |text, (name, sign)| text.replace(name, sign))
}

fn of_context_capture(folder: &Path) -> Option<Georeference> {
    let path = folder.join("metadata.xml");
    let text = plain_xml(&text_of(&path)?);
    let element = |name: &str| -> Option<String> {
        let begin = text.find(&format!("<{name}>"))? + name.len() + 2;
        let end = text[begin..].find("</")?;
        Some(unescaped(text[begin..begin + end].trim()))
    };
    let srs = element("SRS")?;
    let crs = match srs.strip_prefix("ENU:") {
        Some(place) if numbers(place)?.len() >= 2 => srs,
        _ => epsg(&srs).unwrap_or_default(),
    };
    let offset: [f64; 3] = match element("SRSOrigin") {
        Some(origin) => numbers(&origin)?.try_into().ok()?,
        // Cut off, it may have had one.
        None if !text.contains("</ModelMetadata>") => return None,
        None => [0.0; 3],
    };
    Some(Georeference { crs, offset, found_in: vec![path] })
}

fn of_pix4d(mesh: &Path, folder: &Path) -> Option<Georeference> {
    let stem = mesh.file_stem()?.to_str()?;
    let (project, _) = stem.split_once("_simplified_3d_mesh")?;
    let named = |end: &str| folder.join(format!("{project}{end}"));
    let (prj, shift) = (named("_wkt.prj"), named("_offset.xyz"));
    let offset = offset_in_text(&text_of(&shift)?)?;
    let crs = text_of(&prj).and_then(|text| epsg(text.trim()));
    let found_in = crs.iter().map(|_| prj.clone()).chain([shift]).collect();
    Some(Georeference { crs: crs.unwrap_or_default(), offset, found_in })
}

fn of_odm(folder: &Path) -> Option<Georeference> {
    ["odm_georeferencing_model_geo.txt", "coords.txt"].iter().find_map(|name| {
        let path = folder.join(name);
        let text = text_of(&path)?;
        let mut lines = text.lines();
        // WGS84 UTM 32N
        let zone = lines.next()?.trim().strip_prefix("WGS84 UTM ")?.trim().to_owned();
        let (number, half) = zone.split_at_checked(zone.len().checked_sub(1)?)?;
        let number: u16 = number.trim().parse().ok().filter(|n| (1..=60).contains(n))?;
        let code = if half.eq_ignore_ascii_case("S") { 32700 } else { 32600 } + number;
        let place = numbers(lines.next()?)?;
        let offset = [*place.first()?, *place.get(1)?, place.get(2).copied().unwrap_or(0.0)];
        Some(Georeference { crs: format!("EPSG:{code}"), offset, found_in: vec![path] })
    })
}

/// The file of an offset beside a mesh; its numbers, if it is understood.
fn offset_beside(mesh: &Path, folder: &Path) -> Option<(PathBuf, Option<[f64; 3]>)> {
    let stem = mesh.file_stem()?.to_string_lossy();
    let names = [format!("{stem}.xyz"), format!("{stem}_offset.xyz"), "offset.xyz".to_owned()];
    names.iter().enumerate().find_map(|(i, name)| {
        let path = folder.join(name);
        if !path.is_file() {
            return None;
        }
        let text = text_of(&path);
        let offset = text.as_deref().and_then(offset_in_text);
        // A cloud of points may have the name of the mesh.
        let is_cloud =
            i == 0 && offset.is_none() && text.is_none_or(|text| lines_of(&text).count() > 3);
        (!is_cloud).then_some((path, offset))
    })
}

/// Lines with anything but a comment in them.
fn lines_of(text: &str) -> impl Iterator<Item = &str> {
    let lines = text.lines().map(str::trim);
    lines.filter(|line| {
        !line.is_empty() && !["#", "//", "%"].iter().any(|sign| line.starts_with(sign))
    })
}

/// The three numbers of a file of an offset.
fn offset_in_text(text: &str) -> Option<[f64; 3]> {
    let text = lines_of(text).collect::<Vec<_>>().join("\n");
    // Between numbers with other signs between them, a comma is one of decimals or of thousands.
    let mut words =
        text.split(|c: char| c.is_whitespace() || c == ';').filter(|word| !word.is_empty());
    let is_doubtful = |word: &str| word.trim_matches(',').contains(',');
    if words.clone().count() > 1 && words.any(is_doubtful) {
        return None;
    }
    numbers(&text)?.try_into().ok()
}

fn of_name(mesh: &Path, folder: &Path) -> Option<Georeference> {
    let prj = mesh.with_extension("prj");
    let crs = text_of(&prj).and_then(|text| epsg(text.trim()));
    let shift = offset_beside(mesh, folder);
    if crs.is_none() && shift.is_none() {
        return None;
    }
    let (offset, file) = match shift {
        // A system without its offset would be another place.
        Some((_, None)) => return None,
        Some((path, Some(offset))) => (offset, Some(path)),
        None => ([0.0; 3], None),
    };
    let found_in = crs.iter().map(|_| prj.clone()).chain(file).collect();
    Some(Georeference { crs: crs.unwrap_or_default(), offset, found_in })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_photogrammetry_programs_say_where_a_mesh_lies() {
        let wkt = r#"PROJCS["WGS 84 / UTM zone 33N",GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]],AUTHORITY["EPSG","32633"]]"#;
        let xml = |srs: &str| {
            format!(
                "<?xml version=\"1.0\"?>\n<ModelMetadata version=\"1\">\n<SRS>{srs}</SRS>\n\
                 <SRSOrigin>500400,4600200,100</SRSOrigin>\n</ModelMetadata>"
            )
        };
        let offset = [500_400.0, 4_600_200.0, 100.0];
        let flat = [500_400.0, 4_600_200.0, 0.0];
        let escaped = wkt.replace('"', "&quot;");
        let rows: [(&str, String, &str, [f64; 3]); 12] = [
            ("metadata.xml", xml("EPSG:32633"), "EPSG:32633", offset),
            ("../metadata.xml", xml(wkt), "EPSG:32633", offset),
            ("metadata.xml", xml("ENU:41.5,15.0"), "ENU:41.5,15.0", offset),
            ("coords.txt", "WGS84 UTM 33N\n500400 4600200\n0 0 0\n".into(), "EPSG:32633", flat),
            (
                "../odm_georeferencing/odm_georeferencing_model_geo.txt",
                "WGS84 UTM 56S\n500400 4600200\n".into(),
                "EPSG:32756",
                flat,
            ),
            ("tile.prj", wkt.into(), "EPSG:32633", [0.0; 3]),
            ("metadata.xml", xml("EPSG:25832+7837"), "EPSG:25832+7837", offset),
            ("tile.xyz", "500400.000 4600200.000 100.000\n".into(), "", offset),
            ("offset.xyz", "500400, 4600200, 100".into(), "", offset),
            ("metadata.xml", xml(&escaped), "EPSG:32633", offset),
            (
                "metadata.xml",
                xml("EPSG:32633").replace("<SRS>", "<!-- <SRS>EPSG:1</SRS> --><SRS>"),
                "EPSG:32633",
                offset,
            ),
            ("../../1_initial/params/p_offset.xyz", "500400 4600200 100".into(), "", offset),
        ];
        for (name, text, crs, offset) in rows {
            let home = tempfile::tempdir().unwrap();
            let folder = home.path().join("a/odm_texturing");
            std::fs::create_dir_all(folder.join("../odm_georeferencing")).unwrap();
            std::fs::create_dir_all(folder.join("../../1_initial/params")).unwrap();
            std::fs::write(folder.join(name), text).unwrap();
            let mesh =
                if name.contains("p_offset") { "p_simplified_3d_mesh.obj" } else { "tile.obj" };
            let found = Georeference::beside(&folder.join(mesh)).unwrap();
            assert_eq!((found.crs.as_str(), found.offset), (crs, offset), "{name}");
            assert_eq!(found.found_in.len(), 1);
            let named = name.rsplit_once("../").map_or(name, |(_, name)| name);
            let words = found.words();
            assert!(words.contains("offset") && words.contains(named), "{words}");
            assert_eq!(words.contains('/'), name.starts_with(".."), "{words}");
        }
        let home = tempfile::tempdir().unwrap();
        assert_eq!(Georeference::beside(&home.path().join("a/b/tile.obj")), None);
        let text = "offset: 500000 5400000 250 crs EPSG:32633 stonecut 1.0 ratio 5% st".to_owned();
        assert_eq!(comments_of(text), ["offset: 500000 5400000 250", "crs EPSG:32633"]);
        assert_eq!(comments_of("crs EPSG:32633 stonecut 1.0".to_owned()), ["crs EPSG:32633"]);
        assert_eq!(comments_of("solid made of stonecut ".to_owned()), ["solid made of stonecut "]);
        // A system that is not understood is named.
        let mesh = home.path().join("a/b/c/tile.obj");
        std::fs::create_dir_all(home.path().join("a/b/c")).unwrap();
        assert_eq!(Georeference::broken_beside(&mesh), None);
        std::fs::write(mesh.with_extension("prj"), r#"PROJCS["Mine",GEOGCS["GCS_Mine"]]"#).unwrap();
        let named = Georeference::broken_beside(&mesh).unwrap();
        assert_eq!(named.example, mesh.with_extension("prj").display().to_string());
        let utf16: Vec<u8> = xml("EPSG:32633").encode_utf16().flat_map(u16::to_le_bytes).collect();
        std::fs::write(home.path().join("a/b/c/metadata.xml"), utf16).unwrap();
        let found = Georeference::beside(&mesh).unwrap();
        assert_eq!((found.crs.as_str(), found.offset), ("EPSG:32633", offset));
        // A cloud of points of the same name is not an offset.
        let cloud = "1 2 3\n4 5 6\n7 8 9\n1 1 1\n";
        std::fs::write(home.path().join("tile.xyz"), cloud).unwrap();
        assert_eq!(Georeference::beside(&home.path().join("tile.obj")), None);
        assert_eq!(Georeference::broken_beside(&home.path().join("tile.obj")), None);
    }

    #[test]
    fn offsets_are_read_or_named_never_guessed() {
        let offset = Some([412_000.5, 5_621_000.0, 50.0]);
        for (text, wanted) in [
            ("412000.5 5621000 50", offset),
            ("412000.5, 5621000, 50\n", offset),
            ("412000.5;5621000;50", offset),
            ("412000.5,5621000,50\r\n", offset),
            ("412000.5\n5621000\n50\n", offset),
            ("# off, 3\n// set\n\n412000.5 5621000 50\n", offset),
            ("412000,5 5621000 50", None),
            ("412000,5 5621000", None),
            ("412000,5;5621000", None),
            ("412,000.5 5,621,000 50", None),
            ("412000.5 5621000", None),
            ("X=412000.5\nY=5621000\nZ=50", None),
            ("", None),
        ] {
            assert_eq!(offset_in_text(text), wanted, "{text}");
            let home = tempfile::tempdir().unwrap();
            let mesh = home.path().join("tile.obj");
            for name in ["tile.xyz", "tile_offset.xyz", "offset.xyz"] {
                let path = home.path().join(name);
                std::fs::write(&path, text).unwrap();
                std::fs::write(mesh.with_extension("prj"), "EPSG:25832").unwrap();
                let found = Georeference::beside(&mesh);
                assert_eq!(found.map(|found| found.offset), wanted, "{name} {text}");
                let named = Georeference::broken_beside(&mesh).map(|loss| loss.to_string());
                assert_eq!(named.is_none(), wanted.is_some(), "{name} {text}");
                assert!(named.is_none_or(|line| line.contains(name)), "{name} {text}");
                std::fs::remove_file(path).unwrap();
            }
        }
    }
}
