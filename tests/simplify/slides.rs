//! The progressive mesh of the page with a slider: every mesh of it, both ways, and the page.

#![allow(clippy::unwrap_used, clippy::print_stderr)] // A test fails by panicking, and says when it is skipped.

use crate::common::{expect, scratch};
use std::path::Path;
use std::process::Command;
use stonecut::progressive::{Refiner, slides};

/// A place and a colour, black where there is none.
type Spot = [u16; 6];

/// A triangle by the spots of its corners, which begin with the least.
type Placed = [Spot; 3];

/// The bytes of a page, read as its script does.
struct Read<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Read<'_> {
    fn u32(&mut self) -> u32 {
        let four = self.bytes[self.at..self.at + 4].try_into().unwrap();
        self.at += 4;
        u32::from_le_bytes(four)
    }

    fn next(&mut self) -> u32 {
        let (mut value, mut shift) = (0, 0);
        loop {
            let byte = self.bytes[self.at];
            self.at += 1;
            value |= u32::from(byte & 127) << shift;
            shift += 7;
            if byte < 128 {
                return value;
            }
        }
    }

    fn list(&mut self) -> Vec<u32> {
        let mut last = 0u32;
        (0..self.next())
            .map(|_| {
                last = last.wrapping_add(self.next());
                last
            })
            .collect()
    }
}

/// A mesh on the way.
struct Mesh {
    places: Vec<Spot>,
    triangles: Vec<Option<[u32; 3]>>,
}

impl Mesh {
    fn placed(&self) -> Vec<Placed> {
        let all = self.triangles.iter().flatten();
        let mut all: Vec<Placed> =
            all.map(|t| turned(t.map(|v| self.places[v as usize]))).collect();
        all.sort_unstable();
        all
    }

    fn add(&mut self, read: &mut Read) {
        for _ in 0..read.next() {
            let last = self.places.len() as u32 - 1;
            let corners = std::array::from_fn(|_| last - read.next());
            self.triangles.push(Some(corners));
        }
    }
}

fn turned(t: Placed) -> Placed {
    let least = (0..3).min_by_key(|&k| t[k]).unwrap();
    [t[least], t[(least + 1) % 3], t[(least + 2) % 3]]
}

/// All meshes of a page that have one of these counts, the last of each count.
fn meshes(bytes: &[u8], counts: &[usize]) -> Vec<Vec<Placed>> {
    assert_eq!(&bytes[..8], b"stncuts2");
    let mut read = Read { bytes, at: 8 };
    let [
        base_vertices,
        base_triangles,
        n_vertices,
        n_triangles,
        n_steps,
        n_positions,
        has_colours,
        _,
    ] = std::array::from_fn(|_| read.u32());
    let u16_at = |i: usize| u16::from_le_bytes(bytes[72 + 2 * i..74 + 2 * i].try_into().unwrap());
    let colours = 72 + (6 * n_positions as usize).next_multiple_of(4);
    let colour = |i: usize| if has_colours == 1 { u16::from(bytes[colours + i]) } else { 0 };
    let mut positions = (0..n_positions as usize).map(|i| {
        [0, 1, 2, 3, 4, 5].map(|k| if k < 3 { u16_at(3 * i + k) } else { colour(3 * i + k - 3) })
    });
    read.at = colours;
    read.at += (3 * has_colours as usize * n_positions as usize).next_multiple_of(4);
    let mut mesh = Mesh {
        places: positions.by_ref().take(base_vertices as usize).collect(),
        triangles: (0..base_triangles).map(|_| Some(std::array::from_fn(|_| read.u32()))).collect(),
    };
    let mut out = vec![Vec::new(); counts.len()];
    let mut look = |mesh: &Mesh| {
        let n = mesh.triangles.iter().flatten().count();
        for (out, &count) in out.iter_mut().zip(counts) {
            if n <= count && count < n + 2 {
                *out = mesh.placed();
            }
        }
    };
    look(&mesh);
    for _ in 0..n_steps {
        if read.next() == 0 {
            let kept = mesh.places.len() - read.next() as usize;
            let new = mesh.places.len() as u32;
            mesh.places.push(positions.next().unwrap());
            mesh.places[kept] = positions.next().unwrap();
            for corner in read.list() {
                let t = mesh.triangles[corner as usize / 3].as_mut().unwrap();
                assert_eq!(t[corner as usize % 3] as usize, kept);
                t[corner as usize % 3] = new;
            }
            mesh.add(&mut read);
        } else {
            let n_new = read.next() as usize;
            mesh.places.extend(positions.by_ref().take(n_new));
            mesh.add(&mut read);
            for t in read.list() {
                assert!(mesh.triangles[t as usize].take().is_some());
            }
            for _ in 0..read.next() {
                let to = read.next();
                for corner in read.list() {
                    mesh.triangles[corner as usize / 3].as_mut().unwrap()[corner as usize % 3] = to;
                }
            }
        }
        look(&mesh);
    }
    assert!(read.at == bytes.len() && positions.next().is_none());
    assert_eq!(
        (mesh.places.len(), mesh.triangles.len()),
        (n_vertices as usize, n_triangles as usize)
    );
    out
}

/// What `refine` makes of the same count, in the places of the page.
fn refined(pm: &Path, n: usize, bytes: &[u8]) -> Vec<Placed> {
    let f64_at = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    let (low, step) = ([40, 48, 56].map(f64_at), f64_at(64));
    let mut mesh = Refiner::open(pm, 1 << 30).unwrap();
    mesh.refine(n as u64, &|| Ok(())).unwrap();
    let schema = mesh.schema().clone();
    let colour = ["red", "green", "blue"].map(|name| {
        let mut at = schema.position_bytes();
        schema.properties.iter().find_map(|p| {
            at += p.scalar.bytes();
            (p.name == name).then(|| at - p.scalar.bytes())
        })
    });
    let (mut places, mut out) = (Vec::new(), Vec::new());
    let ordered = mesh.ordered();
    ordered
        .records(|records| {
            for record in records.chunks_exact(schema.record_bytes()) {
                let at = schema.position(record).map(|x| f64::from(x as f32));
                let place = |k: usize| ((at[k] - low[k]) / step).round() as u16;
                let [r, g, b] = colour.map(|at| at.map_or(0, |at| u16::from(record[at])));
                places.push([place(0), place(1), place(2), r, g, b]);
            }
            Ok(())
        })
        .unwrap();
    ordered
        .triangles(|some| {
            out.extend(some.iter().map(|t| turned(t.map(|v| places[v as usize]))));
            Ok(())
        })
        .unwrap();
    out.sort_unstable();
    out
}

#[test]
fn the_page_has_every_mesh_of_the_file() {
    let at = &scratch();
    for (kind, n, low, options) in [
        ("statue", 8_000, 300, ""),
        ("terrain", 8_000, 300, "--progressive-bits 12"),
        ("scans", 12_000, 400, ""),
        ("gyroid", 12_000, 300, ""),
    ] {
        expect(at, &format!("synth {kind} in.ply --triangles {n} --force -q"), 0);
        let simplify =
            format!("simplify in.ply o.ply --triangles {low} --force --progressive o.pm {options}");
        // Some counts are too few for the scan.
        let code = crate::common::run(at, &simplify).status.code();
        assert!(matches!(code, Some(0 | 3)), "{kind}: {code:?}");
        let pm = at.join("o.pm");
        let bytes = slides(Refiner::open(&pm, 1 << 30).unwrap(), &|| Ok(())).unwrap();
        let counts = [500, 1_234, 2_500, 5_001, n as usize];
        let found = meshes(&bytes, &counts);
        for (found, &count) in found.iter().zip(&counts) {
            if !found.is_empty() {
                assert!(*found == refined(&pm, count, &bytes), "{kind}: {count}");
            }
        }
        assert!(found.iter().filter(|found| !found.is_empty()).count() >= 3, "{kind}");
        in_node(at, &bytes, &counts, &found);
    }
}

/// The script of the page does the same, forwards and backwards, where there is node to run it.
fn in_node(at: &Path, bytes: &[u8], counts: &[usize], wanted: &[Vec<Placed>]) {
    if Command::new("node").arg("--version").output().is_err() {
        crate::common::skipped("no node on this machine");
        return;
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    std::fs::copy(root.join("web/slides.js"), at.join("slides.mjs")).unwrap();
    std::fs::write(at.join("slides.bin"), bytes).unwrap();
    let script = r#"
import { Slides } from "./slides.mjs";
import { readFileSync } from "node:fs";
const bytes = readFileSync("slides.bin");
const slides = new Slides(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
const counts = process.argv.slice(2).map(Number);
const place = (v) => [...slides.place.subarray(4 * v, 4 * v + 3), ...(slides.colour?.subarray(4 * v, 4 * v + 3) ?? [0, 0, 0])];
// What the graphics card has: only the ranges that are named.
const card = { index: slides.index.slice(), place: slides.place.slice() };
slides.corners.take(1);
slides.vertices.take(1);
const send = () => {
  for (const [from, n] of slides.corners.take(8)) card.index.set(slides.index.subarray(from, from + n), from);
  for (const [from, n] of slides.vertices.take(8)) card.place.set(slides.place.subarray(4 * from, 4 * (from + n)), 4 * from);
  const isSame = (a, b, n) => a.subarray(0, n).every((x, i) => x === b[i]);
  if (!isSame(card.index, slides.index, 3 * slides.drawn)) throw new Error("corners were not sent");
  if (!isSame(card.place, slides.place, 4 * slides.vertexEnd)) throw new Error("places were not sent");
};
const mesh = () => {
  const out = [];
  for (let t = 0; t < slides.drawn; t += 1) {
    const [a, b, c] = slides.index.subarray(3 * t, 3 * t + 3);
    if (a !== b) out.push([a, b, c].map(place));
  }
  if (out.length !== slides.triangles) throw new Error("another count");
  send();
  return out;
};
const step = counts.map((n) => slides.stepFor(n));
// To and fro, a little of the way at a time, then down and up.
for (const target of [step[0], step[4], 0, step[2], slides.nSteps, 0]) while (!slides.go(target, 0));
const up = step.map((s) => { slides.go(s); return mesh(); });
slides.go(slides.nSteps);
const down = [...step].reverse().map((s) => { slides.go(s); return mesh(); }).reverse();
// Frames with vertices that glide, some turning round half-way; the clock begins again in between.
let now = 1e6;
const glide = (wanted) => {
  for (const turn of [Math.round(slides.nSteps / 3), wanted, slides.nSteps, wanted]) {
    for (let frame = 0; frame < 5; frame += 1) {
      slides.advance(turn, now += 16, { milliseconds: 0, isGliding: true });
      send();
    }
  }
  while (!slides.advance(wanted, now += 16, { isGliding: true })) send();
  now += 3e5;
  if (slides.share(0) !== 1) throw new Error("a vertex is on its way");
  return mesh();
};
const glided = step.map(glide);
console.log(JSON.stringify([up, down, glided]));
"#;
    std::fs::write(at.join("try.mjs"), script).unwrap();
    let numbers = counts.iter().map(usize::to_string);
    let output =
        Command::new("node").arg("try.mjs").args(numbers).current_dir(at).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let ways: [Vec<Vec<Placed>>; 3] = serde_json::from_slice(&output.stdout).unwrap();
    for way in ways {
        for (found, wanted) in way.into_iter().zip(wanted).filter(|(_, wanted)| !wanted.is_empty())
        {
            let mut found: Vec<Placed> = found.into_iter().map(turned).collect();
            found.sort_unstable();
            assert!(found == *wanted);
        }
    }
}

#[test]
fn the_page_is_whole_by_itself() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 6000 -q", 0);
    expect(at, "simplify in.ply o.ply --triangles 300 --progressive o.pm -q", 0);
    expect(at, "refine o.pm --page o.html", 0);
    // The page of a run has the same slider, in place of the result alone.
    expect(at, "simplify in.ply p.ply --triangles 300 --report r.json -q", 0);
    expect(at, "report r.json -o r.html --progressive o.pm", 0);
    for page in ["o.html", "r.html"] {
        let text = std::fs::read_to_string(at.join(page)).unwrap();
        for part in [
            "id=\"viewer\"",
            "id=\"viewer-slider\"",
            "id=\"viewer-count\"",
            "id=\"slides\"",
            "three.js",
        ] {
            assert!(text.contains(part), "{page}: no {part}");
        }
        assert!(!text.contains("id=\"glb\""), "{page}: two meshes");
        for call in ["src=\"http", "href=\"http", "<link rel=\"stylesheet", "@import"] {
            assert!(!text.contains(call), "{page} loads {call}");
        }
    }
    expect(at, "report r.json -o q.html --progressive o.ply", 4);
    let said = expect(at, "refine o.pm --page o.html", 2);
    assert!(said.contains("--force"), "{said}");
    expect(at, "refine o.pm --page o.html --force", 0);
    expect(at, "refine o.pm", 2);
    expect(at, "refine o.pm out.ply --triangles 500 --page p.html", 2);
    expect(at, "refine o.ply --page p.html", 4);
}
