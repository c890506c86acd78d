//! Pages of new textures: any number of any size has a result, filled well; the plan says what they take.

use crate::common::{expect, json, scratch};
use std::path::Path;

fn report(folder: &Path, how: &str) -> serde_json::Value {
    let command = format!(
        "simplify rooms.obj o.glb --ratio 10% --texture bake -q --force --report r.json {how}"
    );
    expect(folder, &command, 0);
    json(folder, "r.json")["bake"].clone()
}

#[test]
fn every_number_of_pages_of_every_size_has_a_result() {
    let folder = &scratch();
    expect(folder, "synth rooms rooms.obj --triangles 20k", 0);
    let mut densities = Vec::new();
    for (pages, size) in [(1, 64), (1, 300), (2, 512), (1, 1024)] {
        let bake = report(folder, &format!("--bake-pages {pages} --bake-size {size}"));
        let number = |name: &str| bake[name].as_f64().unwrap();
        assert!(number("pages") <= f64::from(pages), "{bake}");
        assert!(number("texels") <= f64::from(pages * size * size), "{bake}");
        densities.push(number("texel_density"));
        // Where there is no room to spare, most of it shows the surface.
        if size >= 512 {
            let share = number("covered_texels") / number("texels");
            assert!(share > 0.55, "{share} of {pages} pages of {size}");
        }
    }
    assert!(densities.is_sorted(), "{densities:?}");
}

/// The number before the unit of a count, in ones.
fn count(line: &str, before: &str) -> f64 {
    let words: Vec<&str> = line.split_whitespace().collect();
    let at = words.iter().position(|&word| word == before).unwrap();
    let (number, factor) = match words[at - 1] {
        "k" => (words[at - 2], 1e3),
        "M" => (words[at - 2], 1e6),
        number => (number, 1.0),
    };
    number.parse::<f64>().unwrap() * factor
}

#[test]
fn the_plan_names_texels_and_memory() {
    let folder = &scratch();
    expect(folder, "synth rooms rooms.obj --triangles 20k", 0);
    let said = expect(folder, "simplify rooms.obj o.glb --ratio 10% --texture bake --dry-run", 0);
    let line = said.lines().find(|line| line.starts_with("texture ")).unwrap_or(&said);
    assert!(line.contains("MiB of memory") && line.contains(" images"), "{said}");
    let planned = count(line, "texels");
    let found = report(folder, "")["covered_texels"].as_f64().unwrap();
    assert!((0.67..1.5).contains(&(planned / found)), "{planned} for {found}");
}
