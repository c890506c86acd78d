//! Reads material libraries (MTL).
//!
//! Lines that the description has a place for become that; all others are kept as text for another library.

use super::description::{Image, ImageData, Map, MapKind, Material, Materials};
use super::search::{Search, plain};
use crate::encodings;
use crate::ply::raw::RawFile;
use crate::text_lines::{Lines, parse_number, words};
use stonecut_system::losses::{Loss, LossKind};

/// Words of lines that name an image, and its kind.
pub(super) const MAPS: [(&str, MapKind); 9] = [
    ("map_Kd", MapKind::Base),
    ("map_Ke", MapKind::Emissive),
    ("map_d", MapKind::Opacity),
    ("map_Ks", MapKind::Specular),
    ("map_Ka", MapKind::Ambient),
    ("map_Bump", MapKind::Bump),
    ("norm", MapKind::Normal),
    ("map_Pr", MapKind::Roughness),
    ("map_Pm", MapKind::Metallic),
];

/// Other words for the same.
const OTHER_MAPS: [(&str, MapKind); 3] =
    [("bump", MapKind::Bump), ("map_Norm", MapKind::Normal), ("map_opacity", MapKind::Opacity)];

/// Words of lines that name a file without a place in the description.
const LOST_FILES: [&str; 6] = ["map_Ns", "map_Ps", "disp", "decal", "refl", "map_refl"];

/// Lines of a material that are kept as text, at most.
const MAX_LINES: usize = 100;

/// Bytes of a name behind which options are looked for.
const MAX_NAME: usize = 4096;

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

/// Returns the bytes after a line's first word of `n` bytes.
pub fn after_word(n: usize, line: &[u8]) -> &[u8] {
    line.trim_ascii().get(n..).unwrap_or_default().trim_ascii()
}

/// Reads the materials of a library that `wanted` gives a number, as far as they are not known yet; `images` looks
/// for files. A material that is there twice is the first, with images of the others that it lacks, and a line. Words are
/// read in any case. Returns whether a line that names an image leads to none.
pub fn read_library(
    text: Vec<u8>,
    images: &mut Search,
    wanted: &dyn Fn(&[u8]) -> Option<usize>,
    known: &mut [bool],
    out: &mut Materials,
) -> bool {
    let (mut current, known_before) = (None, known.to_vec());
    let (mut is_begun, mut is_again, mut lacks_image) = (false, false, false);
    let file = RawFile::from_bytes("material library", text);
    let (mut lines, mut line) = (Lines::of_obj(&file), Vec::new());
    // What is in memory can be read; a line that is too long ends the library.
    while lines.next(&mut line).is_ok_and(|is_there| is_there) {
        let line = line.as_slice();
        let mut words = words(line);
        let Some(word) = words.next().and_then(|word| std::str::from_utf8(word).ok()) else {
            continue;
        };
        if word.eq_ignore_ascii_case("newmtl") {
            is_begun = true;
            current = wanted(after_word(word.len(), line)).filter(|&number| !known_before[number]);
            let Some(number) = current else { continue };
            is_again = std::mem::replace(&mut known[number], true);
            if is_again {
                let example = format!("'{}'", out.list[number].name);
                let what = "materials described again";
                let why = "the first description is taken, with images of the others that it lacks";
                out.lose(Loss::new(LossKind::Materials, what, why).example(example));
            }
            continue;
        }
        let is = |list: &[(&str, MapKind)]| {
            list.iter().find(|(w, _)| w.eq_ignore_ascii_case(word)).map(|(_, kind)| *kind)
        };
        let kind = is(&MAPS).or_else(|| is(&OTHER_MAPS));
        let Some(number) = current else {
            if kind.is_some() && !is_begun {
                lacks_image = true;
                let why = "they stand before the first 'newmtl': of no material";
                let loss = Loss::new(LossKind::Images, "images", why);
                out.lose(loss.example(format!("'{}'", encodings::name(line.trim_ascii()))));
            }
            continue;
        };
        if is_again && kind.is_none_or(|kind| out.list[number].map(kind).is_some()) {
            continue;
        }
        if let Some(kind) = kind {
            let (options, name) = options_and_name(after_word(word.len(), line));
            if name.is_empty() {
                lacks_image = true;
                let loss = Loss::new(LossKind::Images, "images", "their lines name no file");
                out.lose(loss.example(format!("'{}'", encodings::name(line.trim_ascii()))));
            } else if out.list[number].map(kind).is_some() {
                let what = format!("second {} of one material", kind.name());
                let loss = Loss::new(LossKind::Images, what, "the first is taken");
                out.lose(loss.example(format!("'{}'", encodings::name(name))));
            } else {
                let data = ImageData::File(images.find(name));
                let name = plain(&encodings::name(name));
                let image = out.add_image(Image { name, data });
                out.list[number].maps.push(Map::new(kind, image, options));
            }
        } else if let Some(lost) = LOST_FILES.iter().find(|lost| lost.eq_ignore_ascii_case(word)) {
            let what = format!("images of '{lost}' lines in the material library");
            out.lose(Loss::new(LossKind::Images, what, "not carried"));
        } else if !set(&mut out.list[number], word, words) && !word.starts_with('#') {
            let lines = &mut out.list[number].mtl_lines;
            if lines.len() < MAX_LINES {
                lines.push(encodings::name(line.trim_ascii()));
            }
        }
    }
    lacks_image
}

/// The names of the materials of a library, each once, and whether it names an image.
pub fn names_in_library(text: Vec<u8>) -> (Vec<Vec<u8>>, bool) {
    let (mut names, mut has_image) = (Vec::new(), false);
    let file = RawFile::from_bytes("material library", text);
    let (mut lines, mut line) = (Lines::of_obj(&file), Vec::new());
    while lines.next(&mut line).is_ok_and(|is_there| is_there) {
        let Some(word) = words(&line).next() else { continue };
        if word.eq_ignore_ascii_case(b"newmtl") {
            names.push(after_word(word.len(), &line).to_vec());
        }
        let mut maps = MAPS.iter().chain(&OTHER_MAPS);
        has_image |= maps.any(|(map, _)| word.eq_ignore_ascii_case(map.as_bytes()));
    }
    names.sort_unstable();
    names.dedup();
    (names, has_image)
}

/// Takes the image of ambient colour for the colour image where a material has no other: some programs write only that. Zeros
/// that leave nothing to be seen are what programs write where no value was chosen: white and opaque stand for them. Names images
/// of light that black leaves dark.
pub fn settle_images(out: &mut Materials) {
    let mut taken = Vec::new();
    for material in &mut out.list {
        if let (None, Some(ambient)) = (material.map(MapKind::Base), material.map(MapKind::Ambient))
        {
            let base = Map { kind: MapKind::Base, ..ambient.clone() };
            taken.push(format!("material '{}'", material.name));
            material.maps.push(base);
        }
    }
    for name in taken {
        let loss = Loss::new(LossKind::Images, "map_Ka", "taken for map_Kd, which is missing");
        out.lose(loss.example(name).notice());
    }
    let mut shown = Vec::new();
    for material in &mut out.list {
        if material.base[..3] == [0.0; 3] && material.map(MapKind::Base).is_some() {
            material.base[..3].fill(1.0);
            shown.push(("Kd 0 0 0", "would leave the image black: 1 1 1 is taken", &material.name));
        }
        if material.base[3] == 0.0 {
            material.base[3] = 1.0;
            shown.push((
                "d 0 (Tr 1)",
                "would leave the surface invisible: 1 is taken",
                &material.name,
            ));
        }
    }
    let shown = shown.into_iter().map(|(what, why, name)| {
        Loss::new(LossKind::Materials, what, why).example(format!("material '{name}'")).notice()
    });
    for loss in shown.collect::<Vec<_>>() {
        out.lose(loss);
    }
    let is_dark =
        |m: &&Material| m.emissive == Some([0.0; 3]) && m.map(MapKind::Emissive).is_some();
    let dark = out.list.iter().filter(is_dark).map(|m| format!("material '{}'", m.name));
    for name in dark.collect::<Vec<String>>() {
        let loss =
            Loss::new(LossKind::Images, "map_Ke", "Ke 0 0 0 leaves it dark: Ke 1 1 1 shows it");
        out.lose(loss.example(name).notice());
    }
}

/// Takes a line of numbers; false if it is another one.
fn set<'a>(material: &mut Material, word: &str, words: impl Iterator<Item = &'a [u8]>) -> bool {
    let numbers: Vec<f32> =
        words.map_while(parse_number).map(|x| x as f32).filter(|x| x.is_finite()).collect();
    let Some(&first) = numbers.first() else { return false };
    // One number stands for all three.
    let colour = [first, *numbers.get(1).unwrap_or(&first), *numbers.get(2).unwrap_or(&first)];
    match word.to_ascii_lowercase().as_str() {
        "kd" => material.base[..3].copy_from_slice(&colour),
        "ka" => material.ambient = Some(colour),
        "ks" => material.specular = Some(colour),
        "ke" => material.emissive = Some(colour),
        "ns" => material.shininess = Some(first),
        "d" => material.base[3] = first,
        "tr" => material.base[3] = 1.0 - first,
        "pm" => material.metallic = Some(first),
        "pr" => material.roughness = Some(first),
        _ => return false,
    }
    true
}

/// Parts the options of an image's line from the name, which may have blanks. Some programs write them behind it.
fn options_and_name(text: &[u8]) -> (String, &[u8]) {
    /// The first word and what is behind it.
    fn split(text: &[u8]) -> (&[u8], &[u8]) {
        let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        (&text[..end], text[end..].trim_ascii_start())
    }
    let mut rest = text.trim_ascii();
    let mut options = Vec::new();
    let option_of = |word: &[u8]| {
        OPTIONS.iter().find(|(option, _)| option.as_bytes().eq_ignore_ascii_case(word))
    };
    while let Some((_, n_values)) = option_of(split(rest).0) {
        for i in 0..=*n_values {
            let (word, behind) = split(rest);
            let is_number = std::str::from_utf8(word).is_ok_and(|word| word.parse::<f64>().is_ok());
            if word.is_empty() || (i > 1 && *n_values == 3 && !is_number) {
                break;
            }
            options.push(encodings::name(word));
            rest = behind;
        }
    }
    let is_option = |at: &usize| {
        rest[*at - 1].is_ascii_whitespace() && option_of(split(&rest[*at..]).0).is_some()
    };
    let is_value = |word: &[u8]| {
        let text = std::str::from_utf8(word).unwrap_or_default();
        text.len() == 1 || ["on", "off"].contains(&text) || text.parse::<f64>().is_ok()
    };
    if let Some(at) = (1..rest.len().min(MAX_NAME)).find(is_option)
        && let (behind, []) = options_and_name(&rest[at..])
        && words(rest).last().is_some_and(is_value)
    {
        options.push(behind);
        rest = rest[..at].trim_ascii_end();
    }
    (options.join(" "), rest)
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
            ("a b.png -s 2 2 -clamp on", "-s 2 2 -clamp on", "a b.png"),
            ("-bm 1 a.png -s 2", "-bm 1 -s 2", "a.png"),
            ("a -s b.png", "", "a -s b.png"),
        ] {
            let expected = (options.to_owned(), name.as_bytes());
            assert_eq!(options_and_name(text.as_bytes()), expected, "{text}");
        }
    }

    #[test]
    fn what_has_no_place_stays_as_text() {
        let text = "newmtl b\nKd 0.5\nnewmtl a\nKd 1 0 0.25\nTr 0.25\nillum 2\nNi 1.5\nmap_Kd x.png\nmap_Kd y.png\n\
            Kd spectral f.rfl\nnewmtl a\nKd 0 0 0\nmap_Kd z.png\nmap_Ke light.png\n";
        let wanted = |name: &[u8]| (name == b"a").then_some(0);
        let mut out = Materials::default();
        out.list.push(Material::default());
        let mut known = [false];
        let mut images = Search::new("image", &[std::path::Path::new("/f")]);
        read_library(text.as_bytes().to_vec(), &mut images, &wanted, &mut known, &mut out);
        let material = &out.list[0];
        assert_eq!(material.base, [1.0, 0.0, 0.25, 0.75]);
        assert_eq!(material.mtl_lines, ["illum 2", "Ni 1.5", "Kd spectral f.rfl"]);
        let names: Vec<&str> = out.images.iter().map(|image| image.name.as_str()).collect();
        assert_eq!((material.maps.len(), names), (2, vec!["x.png", "light.png"]));
        assert!(known[0]);
    }
}
