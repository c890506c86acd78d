//! The fuzz targets with a seeded generator: the same inputs in every run, a few seconds in all.
//!
//! `STONECUT_FUZZ=N` runs N executions a target, `STONECUT_FUZZ_SEED=S` others than the usual ones.

#[path = "../../tools/fuzz/fuzz_targets/targets.rs"]
mod targets;

/// xorshift64*: small, seeded, good enough to pick bytes.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() >> 33) as usize % n.max(1)
    }
}

/// Tokens that matter to one reader or another.
const TOKENS: [&str; 56] = [
    "ply\n",
    "format ascii 1.0\n",
    "format binary_little_endian 1.0\n",
    "element vertex 3\n",
    "element face 1\n",
    "element tristrips 1\n",
    "property float x\n",
    "property double y\n",
    "property uchar red\n",
    "property list uchar int vertex_indices\n",
    "end_header\n",
    "end_header\r",
    "comment TextureFile a\n",
    "obj_info a\n",
    "\r\n",
    "\r",
    "\n",
    " ",
    "-1",
    "0",
    "1",
    "2",
    "3 ",
    "4294967295",
    "18446744073709551615",
    "-9223372036854775808",
    "nan",
    "inf",
    "1e400",
    "0.5",
    "-1.#IND",
    "3 0 1 2\n",
    "4 0 1 2 3\n",
    "v 0 0 0\n",
    "v 1 0 0 1 1 1\n",
    "f 1 2 3\n",
    "f -1 -2 -3 -4\n",
    "f 1/1/1 2//2 3/\n",
    "\\\n",
    "solid a\n",
    "vertex 0 0 1\n",
    "endloop\n",
    "endsolid\n",
    "mtllib a\n",
    "property list uint64 double a\n",
    "element x 99999999999999999999\n",
    "\x03\x00\x00\x00\x01\x00\x00\x00\x02\x00\x00\x00",
    "\u{7f}",
    "glTF",
    "\"count\": 7",
    "\"byteOffset\": 18446744073709551615",
    "\"byteStride\": 3",
    "\"mode\": 5",
    "\"componentType\": 5121",
    "[0, 1, 2]",
    "{}",
];

fn mutate(random: &mut Random, bytes: &mut Vec<u8>) {
    for _ in 0..=random.below(6) {
        let at = random.below(bytes.len() + 1);
        match random.below(9) {
            0 if !bytes.is_empty() => {
                let at = random.below(bytes.len());
                bytes[at] ^= 1 << random.below(8);
            }
            1 if !bytes.is_empty() => {
                let at = random.below(bytes.len());
                bytes[at] = [0, 1, 3, 4, 0x7f, 0x80, 0xff, b' ', b'\n'][random.below(9)];
            }
            2 => bytes.truncate(at),
            3 => {
                let end = (at + random.below(12)).min(bytes.len());
                bytes.drain(at..end);
            }
            4 => {
                let end = (at + random.below(24)).min(bytes.len());
                let copy = bytes[at..end].to_vec();
                let to = random.below(bytes.len() + 1);
                bytes.splice(to..to, copy);
            }
            5 => {
                let n = random.below(9);
                let noise: Vec<u8> = (0..n).map(|_| random.next() as u8).collect();
                bytes.splice(at..at, noise);
            }
            _ => {
                let token = TOKENS[random.below(TOKENS.len())].as_bytes();
                bytes.splice(at..at, token.iter().copied());
            }
        }
    }
    bytes.truncate(4096);
}

/// The small files of the corpus of a target, and nothing.
fn seeds(target: &str) -> Vec<Vec<u8>> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/fuzz/corpus");
    let mut names: Vec<_> = std::fs::read_dir(folder.join(target))
        .map(|entries| entries.flatten().map(|e| e.path()).collect())
        .unwrap_or_default();
    names.sort();
    let mut seeds: Vec<_> = names.iter().map(|path| std::fs::read(path).unwrap()).collect();
    seeds.push(Vec::new());
    seeds
}

fn smoke(name: &str, target: fn(&[u8])) {
    let number = |name: &str| std::env::var(name).ok().and_then(|v| v.parse::<u64>().ok());
    let n = number("STONECUT_FUZZ").unwrap_or(20_000);
    let mut random = Random(0x9e37_79b9_7f4a_7c15 ^ number("STONECUT_FUZZ_SEED").unwrap_or(1));
    let mut seeds = seeds(name);
    seeds.iter().for_each(|seed| target(seed));
    for i in 0..n {
        let from = random.below(seeds.len());
        let mut bytes = seeds[from].clone();
        mutate(&mut random, &mut bytes);
        target(&bytes);
        // Some mutants become seeds in their turn, so that faults can add up.
        if i % 64 == 0 {
            let place = random.below(256);
            if seeds.len() < 256 { seeds.push(bytes) } else { seeds[place] = bytes }
        }
    }
}

#[test]
fn header() {
    smoke("header", targets::header);
}

#[test]
fn body_little_endian() {
    smoke("body_little_endian", targets::body_little_endian);
}

#[test]
fn body_big_endian() {
    smoke("body_big_endian", targets::body_big_endian);
}

#[test]
fn body_ascii() {
    smoke("body_ascii", targets::body_ascii);
}

#[test]
fn tristrips() {
    smoke("tristrips", targets::tristrips);
}

#[test]
fn stl() {
    smoke("stl", targets::stl);
}

#[test]
fn obj() {
    smoke("obj", targets::obj);
}

#[test]
fn gltf() {
    smoke("gltf", targets::gltf);
}

#[test]
fn compressed() {
    smoke("compressed", targets::compressed);
}
