//! Reads material libraries (MTL).
//!
//! Lines that the description has a place for become that; all others are kept as text for another library.

use super::description::{Image, ImageData, Map, MapKind, Material, Materials};
use crate::io::text_lines::{parse_number, words};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Words of lines that name an image, and its kind.
pub(super) const MAPS: [(&str, MapKind); 7] = [
    ("map_Kd", MapKind::Base),
    ("map_Ke", MapKind::Emissive),
    ("map_d", MapKind::Opacity),
    ("map_Ks", MapKind::Specular),
    ("map_Ka", MapKind::Ambient),
    ("map_Bump", MapKind::Bump),
    ("norm", MapKind::Normal),
];

/// Other words for the same.
const OTHER_MAPS: [(&str, MapKind); 4] = [
    ("bump", MapKind::Bump),
    ("map_bump", MapKind::Bump),
    ("map_Norm", MapKind::Normal),
    ("map_opacity", MapKind::Opacity),
];

/// Words of lines that name a file without a place in the description.
const LOST_FILES: [&str; 8] =
    ["map_Ns", "map_Pr", "map_Pm", "map_Ps", "disp", "decal", "refl", "map_refl"];

/// Lines of a material that are kept as text, at most.
const MAX_LINES: usize = 100;

/// Options of an image's line with the number of their values; those of `-o`, `-s` and `-t` may be fewer.
const OPTIONS: [(&str, usize); 13] = [
    ("-blendu", 1),
    ("-blendv", 1),
    ("-boost", 1),
    ("-mm", 2),
    ("-o", 3),
    ("-s", 3),
    ("-t", 3),
    ("-texres", 1),
    ("-clamp", 1),
    ("-bm", 1),
    ("-imfchan", 1),
    ("-type", 1),
    ("-cc", 1),
];

/// Returns the text after a line's first word of `n` bytes.
pub(crate) fn after_word(n: usize, line: &[u8]) -> String {
    let name = line.trim_ascii().get(n..).unwrap_or_default().trim_ascii();
    String::from_utf8_lossy(name).into_owned()
}

/// Reads the materials of a library that `wanted` names, each with its number; files are named from the folder of
/// the library, or from `beside` if they are only there. Returns the numbers found; a material that is there twice is
/// the first.
pub(crate) fn read_library(
    text: &[u8],
    (folder, beside): (&Path, &Path),
    wanted: &HashMap<String, usize>,
    known: &mut [bool],
    out: &mut Materials,
) {
    let mut current = None;
    for line in text.split(|b| matches!(b, b'\n' | b'\r')) {
        let mut words = words(line);
        let Some(word) = words.next().and_then(|word| std::str::from_utf8(word).ok()) else {
            continue;
        };
        if word == "newmtl" {
            current = wanted.get(&after_word(6, line)).copied().filter(|&number| !known[number]);
            if let Some(number) = current {
                known[number] = true;
            }
            continue;
        }
        let Some(number) = current else { continue };
        let is =
            |list: &[(&str, MapKind)]| list.iter().find(|(w, _)| *w == word).map(|(_, kind)| *kind);
        if let Some(kind) = is(&MAPS).or_else(|| is(&OTHER_MAPS)) {
            let (options, name) = options_and_name(&after_word(word.len(), line));
            if !name.is_empty() && out.list[number].map(kind).is_none() {
                let data = ImageData::File(find(&name, folder, beside));
                let image = out.add_image(Image { name, data });
                out.list[number].maps.push(Map { kind, image, options, wrap: None });
            }
        } else if LOST_FILES.contains(&word) {
            out.note(format!("images of '{word}' lines in the material library: not carried"));
        } else if !set(&mut out.list[number], word, words) && !word.starts_with('#') {
            let lines = &mut out.list[number].mtl_lines;
            if lines.len() < MAX_LINES {
                lines.push(String::from_utf8_lossy(line.trim_ascii()).into_owned());
            }
        }
    }
}

/// Takes a line of numbers; false if it is another one.
fn set<'a>(material: &mut Material, word: &str, words: impl Iterator<Item = &'a [u8]>) -> bool {
    let numbers: Vec<f32> =
        words.map_while(parse_number).map(|x| x as f32).filter(|x| x.is_finite()).collect();
    let Some(&first) = numbers.first() else { return false };
    // One number stands for all three.
    let colour = [first, *numbers.get(1).unwrap_or(&first), *numbers.get(2).unwrap_or(&first)];
    match word {
        "Kd" => material.base[..3].copy_from_slice(&colour),
        "Ka" => material.ambient = Some(colour),
        "Ks" => material.specular = Some(colour),
        "Ke" => material.emissive = Some(colour),
        "Ns" => material.shininess = Some(first),
        "d" => material.base[3] = first,
        "Tr" => material.base[3] = 1.0 - first,
        "Pm" => material.metallic = Some(first),
        "Pr" => material.roughness = Some(first),
        _ => return false,
    }
    true
}

/// Parts the options of an image's line from the name, which may have blanks.
fn options_and_name(text: &str) -> (String, String) {
    let mut rest = text;
    let mut options = Vec::new();
    while let Some((_, n_values)) =
        OPTIONS.iter().find(|(option, _)| rest.split_whitespace().next() == Some(option))
    {
        for i in 0..=*n_values {
            let Some(word) = rest.split_whitespace().next() else { break };
            let is_number = word.parse::<f64>().is_ok();
            if i > 1 && *n_values == 3 && !is_number {
                break;
            }
            options.push(word);
            rest = rest[rest.find(word).unwrap_or(0) + word.len()..].trim_start();
        }
    }
    (options.join(" "), rest.trim().to_owned())
}

/// The file of a name in a library; the name as it stands if there is none.
fn find(name: &str, folder: &Path, beside: &Path) -> PathBuf {
    let forward = name.replace('\\', "/");
    let names = [name, forward.as_str()];
    let mut places = [folder, beside].into_iter().flat_map(|f| names.map(|name| f.join(name)));
    places.find(|path| path.is_file()).unwrap_or_else(|| folder.join(forward.as_str()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_stand_before_names_with_blanks() {
        for (text, options, name) in [
            ("a.png", "", "a.png"),
            ("-s 1 1 1 right side.png", "-s 1 1 1", "right side.png"),
            ("-clamp on -o 0.5 dir/my image.jpg", "-clamp on -o 0.5", "dir/my image.jpg"),
            ("-bm 0.2", "-bm 0.2", ""),
            ("-odd.png", "", "-odd.png"),
        ] {
            assert_eq!(options_and_name(text), (options.to_owned(), name.to_owned()), "{text}");
        }
    }

    #[test]
    fn what_has_no_place_stays_as_text() {
        let text = b"newmtl b\nKd 0.5\nnewmtl a\nKd 1 0 0.25\nTr 0.25\nillum 2\nNi 1.5\nmap_Kd x.png\nmap_Kd y.png\n\
            Kd spectral f.rfl\nnewmtl a\nKd 0 0 0\n";
        let wanted = HashMap::from([("a".to_owned(), 0)]);
        let mut out = Materials::default();
        out.list.push(Material::default());
        let mut known = [false];
        read_library(text, (Path::new("/f"), Path::new("/f")), &wanted, &mut known, &mut out);
        let material = &out.list[0];
        assert_eq!(material.base, [1.0, 0.0, 0.25, 0.75]);
        assert_eq!(material.mtl_lines, ["illum 2", "Ni 1.5", "Kd spectral f.rfl"]);
        assert_eq!((material.maps.len(), out.images[0].name.as_str()), (1, "x.png"));
        assert!(known[0]);
    }
}
