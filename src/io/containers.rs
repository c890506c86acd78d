//! Files that are not a mesh of a format that is read: named for what they are, with the way out; and archives with
//! one mesh in them, which are read with the images, material libraries and buffers that it names.

use super::open_options::StageOptions;
use crate::ply::raw::RawFile;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Component, PathBuf};
use stonecut_system::disk::ScratchFolder;
use stonecut_system::error::{Error, Remedy, Result};
use stonecut_system::free_space::free_bytes;
use stonecut_system::units::show_bytes;
use zip::result::ZipError;
use zip::{SUPPORTED_COMPRESSION_METHODS, ZipArchive};

/// More files are not looked for in an archive: their list is kept in memory.
const MAX_ENTRIES: u16 = 65_534;

/// Bytes at the end of an archive that hold the number of its files.
const END_BYTES: u64 = 22 + (1 << 16);

/// Ways to a file that is read.
const EXPORT: &str =
    "open it in a program that reads it (Blender, MeshLab) and export PLY, OBJ, STL or GLB";
const MESH_POINTS: &str =
    "it has points and no faces; make a mesh of them first (CloudCompare, MeshLab, PoissonRecon)";
const TESSELLATE: &str =
    "it has curved surfaces; make a mesh of them first (FreeCAD, Gmsh) and export STL or OBJ";
const TILE: &str = "take the GLB out of it (npx 3d-tiles-tools b3dmToGlb, i3dmToGlb, splitCmpt)";
const UNPACK: &str = "unpack it first";
const FETCH: &str = "fetch the file itself";

/// Rows: bytes at the beginning, what they mean, the way out.
const BEGINNINGS: [(&[u8], &str, &str); 34] = [
    (b"Kaydara FBX Binary", "FBX", EXPORT),
    (b"; FBX", "FBX", EXPORT),
    (b"PXR-USDC", "USD", EXPORT),
    (b"#usda", "USD", EXPORT),
    (b"BLENDER", "a Blender file", EXPORT),
    (b"#VRML", "VRML", EXPORT),
    (b"xof ", "DirectX (.x)", EXPORT),
    (b"DRACO", "a bare Draco mesh", "export PLY, or GLB with Draco"),
    (b"# vtk DataFile", "VTK", "export PLY or STL from ParaView"),
    (b"$MeshFormat", "a Gmsh mesh", "export STL or PLY from Gmsh"),
    (b"b3dm", "a tile of 3D Tiles (b3dm)", TILE),
    (b"i3dm", "a tile of 3D Tiles (i3dm)", TILE),
    (b"cmpt", "a tile of 3D Tiles (cmpt)", TILE),
    (b"pnts", "a tile of points of 3D Tiles (pnts)", MESH_POINTS),
    (b"LASF", "a LAS or LAZ point cloud", MESH_POINTS),
    (b"ASTM-E57", "an E57 point cloud", MESH_POINTS),
    (b"# .PCD", "a PCD point cloud", MESH_POINTS),
    (b"ISO-10303-21", "STEP", TESSELLATE),
    (b"DBRep_DrawableShape", "a BREP shape", TESSELLATE),
    (b"CASCADE Topology", "a BREP shape", TESSELLATE),
    (b"AC10", "a DWG drawing", EXPORT),
    (b"\x89HDF", "HDF5", "export PLY from the program that made it"),
    (b"%PDF", "a PDF", "export PLY, OBJ, STL or GLB from the program that made it"),
    (b"Rar!", "a RAR archive", UNPACK),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK),
    (b"BZh", "compressed with bzip2", UNPACK),
    (b"\xfd7zXZ", "compressed with xz", UNPACK),
    (b"\x04\x22\x4d\x18", "compressed with lz4", UNPACK),
    (b"\x89PNG", "an image (PNG)", "give the mesh that it belongs to"),
    (b"\xff\xd8\xff", "an image (JPEG)", "give the mesh that it belongs to"),
    (b"DICM", "DICOM", "make a surface of it first (3D Slicer)"),
    (b"version https://git-lfs", "a pointer of Git LFS", FETCH),
    (b"<!DOCTYPE html", "a web page", FETCH),
    (b"<html", "a web page", FETCH),
];

/// Rows: words in the first bytes of XML, what they mean, the way out.
const IN_XML: [(&[u8], &str, &str); 8] = [
    (b"<COLLADA", "COLLADA (DAE)", EXPORT),
    (b"<amf", "AMF", EXPORT),
    (b"<X3D", "X3D", EXPORT),
    (b"<VTKFile", "VTK", "export PLY or STL from ParaView"),
    (b"<kml", "KML", "give the mesh that it names"),
    (b"CityModel", "CityGML", EXPORT),
    (b"<model", "3MF", EXPORT),
    (b"<html", "a web page", FETCH),
];

/// An error that names what the file is, if that is known and stonecut does not read it.
pub(super) fn refusal(file: &RawFile, first: &[u8]) -> Option<Error> {
    let text = first.strip_prefix(crate::ply::header::BYTE_ORDER_MARK).unwrap_or(first);
    let text = text.trim_ascii_start();
    let begins =
        |word: &[u8]| text.len() >= word.len() && text[..word.len()].eq_ignore_ascii_case(word);
    let holds = |word: &[u8]| text.windows(word.len()).any(|bytes| bytes == word);
    let mut found = BEGINNINGS.iter().find(|(word, ..)| begins(word));
    if found.is_none() && text.starts_with(b"<") {
        found = IN_XML.iter().find(|(word, ..)| holds(word));
    }
    let is_3ds = first.starts_with(b"MM")
        && first.get(2..6).is_some_and(|n| {
            u64::from(u32::from_le_bytes(n.try_into().expect("4 bytes"))) == file.len()
        });
    let (what, way) = match found {
        Some(&(_, what, way)) => (what, way),
        None if is_3ds => ("3DS", EXPORT),
        None if first.get(257..262) == Some(b"ustar") => ("a tar archive", UNPACK),
        None if is_off(text) => ("OFF", EXPORT),
        None if file.len() == 0 => return Some(file.bad("the file is empty; export it again")),
        None if is_points(text) => ("a list of points (XYZ, PTS, ASC)", MESH_POINTS),
        None => return None,
    };
    Some(file.bad(format!("this is {what}, which stonecut does not read: {way}")))
}

/// Returns whether the first word is that of OFF, with letters before it for what its vertices carry.
fn is_off(text: &[u8]) -> bool {
    let word = text.split(u8::is_ascii_whitespace).next().unwrap_or_default().to_ascii_uppercase();
    let carried = word.strip_suffix(b"OFF");
    carried
        .is_some_and(|letters| letters.len() <= 6 && letters.iter().all(|b| b"STCN4".contains(b)))
}

/// Returns whether all whole lines of a text, of which there are some, have three numbers or more and nothing else.
fn is_points(text: &[u8]) -> bool {
    let lines: Vec<&[u8]> = text.split(|&b| b == b'\n').collect();
    let is_row = |line: &&[u8]| {
        let is_break = |b: &u8| b.is_ascii_whitespace() || matches!(b, b',' | b';');
        let words = line.split(is_break).filter(|word| !word.is_empty());
        let numbers: Vec<bool> = words
            .map(|word| std::str::from_utf8(word).is_ok_and(|word| word.parse::<f64>().is_ok()))
            .collect();
        numbers.len() >= 3 && numbers.iter().all(|&is| is)
    };
    let whole = &lines[..lines.len() - 1];
    whole.len() >= 3 && whole[1..].iter().all(is_row)
}

/// Returns whether a file begins like a zip archive.
pub(super) fn is_zip(first: &[u8]) -> bool {
    first.starts_with(b"PK\x03\x04") || first.starts_with(b"PK\x05\x06")
}

/// Endings of what a mesh may name: libraries, buffers, images, also of kinds that are not read.
const COMPANIONS: [&str; 20] = [
    ".mtl", ".bin", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".tga", ".bmp", ".gif", ".webp",
    ".exr", ".dds", ".ktx2", ".avif", ".heic", ".jxl", ".jp2", ".psd", ".hdr",
];

/// The mesh of an archive that has exactly one, unpacked. Where the archive has files that a mesh may name, they lie in the
/// folder for as long as that is held, and the mesh is named as if it was there.
///
/// Errors: another number of meshes; formats that are archives themselves (USDZ, 3MF), by name.
pub(super) fn unzip(
    file: &RawFile,
    options: &StageOptions,
) -> Result<(RawFile, Option<ScratchFolder>)> {
    let damaged = |error: &ZipError| {
        file.bad(format!("this is a zip archive that cannot be read ({error}): unpack it first"))
    };
    let mut end = vec![0; END_BYTES.min(file.len()) as usize];
    let n_end = end.len() as u64;
    file.read_exact_at(&mut end, file.len() - n_end)?;
    let at = end.windows(4).rposition(|bytes| bytes == b"PK\x05\x06");
    let Some(count) = at.and_then(|at| end.get(at + 10..at + 12)) else {
        return Err(file.bad("this is a zip archive that was cut off: fetch it again"));
    };
    let count = u16::from_le_bytes([count[0], count[1]]);
    if count > MAX_ENTRIES {
        return Err(file.bad("this is a zip archive of more than 65,534 files: unpack it first"));
    }
    let reader = BufReader::new(Positioned { file, at: 0 });
    let mut archive = ZipArchive::new(reader).map_err(|error| damaged(&error))?;
    let shown = |name: Result<std::borrow::Cow<str>, ZipError>| {
        name.map_or_else(|_| "?".to_owned(), std::borrow::Cow::into_owned)
    };
    let names: Vec<String> = archive.file_names().map(shown).collect();
    let ends = |name: &str, endings: &[&str]| {
        let name = name.to_ascii_lowercase();
        endings.iter().any(|ending| name.ends_with(ending))
    };
    let own =
        |what: &str| file.bad(format!("this is {what}, which stonecut does not read: {EXPORT}"));
    if names.iter().any(|name| ends(name, &["3d/3dmodel.model"])) {
        return Err(own("3MF"));
    }
    if names.first().is_some_and(|name| ends(name, &[".usdc", ".usda", ".usd"])) {
        return Err(own("USDZ"));
    }
    // What macOS adds to an archive, and what is hidden, is not a mesh.
    let is_hidden = |name: &str| {
        name.split('/')
            .any(|part| part == "__MACOSX" || part.starts_with('.') && !matches!(part, "." | ".."))
    };
    let is_mesh = |(_, name): &(usize, &String)| {
        ends(name, &[".ply", ".stl", ".obj", ".glb", ".gltf"]) && !is_hidden(name)
    };
    let mut meshes = names.iter().enumerate().filter(is_mesh);
    let (Some((index, name)), None) = (meshes.next(), meshes.next()) else {
        let n = names.iter().enumerate().filter(is_mesh).count();
        let what = format!("this is a zip archive of {} files", names.len());
        return Err(file.bad(match n {
            0 => format!("{what} without a mesh (looked for .ply, .stl, .obj, .glb and .gltf)"),
            _ => format!("{what}, {n} of them meshes: unpack it and give one of them"),
        }));
    };
    let is_companion =
        |other: &usize| ends(&names[*other], &COMPANIONS) && !is_hidden(&names[*other]);
    let companions: Vec<usize> = (0..names.len()).filter(is_companion).collect();
    let mut needed = 0u64;
    for &number in companions.iter().chain([&index]) {
        let entry = archive.by_index_raw(number).map_err(|error| damaged(&error))?;
        needed = needed.saturating_add(entry.size());
        let method = entry.compression();
        if !SUPPORTED_COMPRESSION_METHODS.contains(&method) {
            return Err(file.bad(format!(
                "'{}' in the zip archive is packed in a way that stonecut does not read ({method}): unpack it first",
                names[number].escape_default()
            )));
        }
    }
    if let Some(free) = free_bytes(&options.temp_dir).filter(|free| needed > *free) {
        let (archive, needed, free) = (file.path().display(), show_bytes(needed), show_bytes(free));
        return Err(Error::NoSpace {
            path: options.temp_dir.clone(),
            what: format!("cannot unpack {archive}: it holds {needed}; {free} are free"),
            remedy: Remedy::MakeSpace,
        });
    }
    let mut buffer = vec![0; 1 << 20];
    let mut unpack = |index: usize, put: &mut dyn FnMut(&[u8]) -> Result<()>| {
        let mut entry = archive.by_index(index).map_err(|error| damaged(&error))?;
        loop {
            match entry.read(&mut buffer) {
                Ok(0) => return Ok(()),
                Ok(n) => put(&buffer[..n])?,
                Err(error) => {
                    return Err(file.bad(format!(
                        "'{}' in the zip archive cannot be unpacked ({error}): fetch the archive again",
                        names[index].escape_default()
                    )));
                }
            }
        }
    };
    let mut spool = options.spool();
    unpack(index, &mut |bytes| spool.write(bytes))?;
    if companions.is_empty() {
        let base: String = name.rsplit('/').next().unwrap_or_default().escape_default().collect();
        return Ok((spool.finish(&file.path().join(base))?, None));
    }
    let io = |error| Error::io(&options.temp_dir, "cannot unpack an archive", error);
    let folder = ScratchFolder::new(&options.temp_dir).map_err(io)?;
    for other in companions {
        let path = folder.path().join(place_of(&names[other]));
        let made = std::fs::create_dir_all(path.parent().unwrap_or(folder.path()));
        let mut out = match made.and_then(|()| std::fs::File::create(&path)) {
            // A mesh that names it will say that it is missing.
            Err(error) if NO_NAMES.contains(&error.kind()) => continue,
            out => out.map_err(io)?,
        };
        unpack(other, &mut |bytes| out.write_all(bytes).map_err(io))?;
    }
    Ok((spool.finish(&folder.path().join(place_of(name)))?, Some(folder)))
}

/// Faults of names in archives that no file can have: too long, with a zero, or also the name of a folder.
const NO_NAMES: [ErrorKind; 5] = [
    ErrorKind::InvalidFilename,
    ErrorKind::InvalidInput,
    ErrorKind::IsADirectory,
    ErrorKind::NotADirectory,
    ErrorKind::AlreadyExists,
];

/// The place of a file of an archive in a folder, never outside of it; programs on Windows write backslashes.
fn place_of(name: &str) -> PathBuf {
    let name = PathBuf::from(name.replace('\\', "/"));
    name.components().filter(|part| matches!(part, Component::Normal(_))).collect()
}

/// A file that is read from a place on.
struct Positioned<'a> {
    file: &'a RawFile,
    at: u64,
}

impl Read for Positioned<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.file.read_at_most(buffer, self.at).map_err(std::io::Error::other)?;
        self.at += n as u64;
        Ok(n)
    }
}

impl Seek for Positioned<'_> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::End(by) => self.file.len().checked_add_signed(by),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
        };
        self.at = at.ok_or(std::io::ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}
