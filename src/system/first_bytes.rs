//! Kinds of files, told by their first bytes: earlier ones of stonecut, and texts that take lines more.

use std::io::Read;
use std::path::Path;

/// The kinds of files that are written beside a main output; an earlier one is known by its contents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// JSON of `simplify` or `measure`.
    Report,
    /// Points of `simplify --seams`.
    Seams,
    /// The receipt of `simplify --receipt`.
    Receipt,
    /// Its signature.
    Signature,
    /// The mesh of `measure --heatmap`; replaced with `--force` only.
    Heatmap,
    /// The file of `simplify --progressive`; replaced with `--force` only.
    Progressive,
    /// The file of `simplify --map`, or values of `transfer`; replaced with `--force` only.
    Map,
}

impl Kind {
    /// Returns whether the file is an earlier one of this kind.
    pub(crate) fn wrote(self, path: &Path) -> bool {
        let head = head(path);
        let has_line = |words: &str| {
            let head = String::from_utf8_lossy(&head);
            let is_own = |line: &str| line.starts_with("comment stonecut ") && line.contains(words);
            head.starts_with("ply\n")
                && head.lines().take_while(|line| *line != "end_header").any(is_own)
        };
        match self {
            Kind::Seams => has_line(SEAMS_SETTINGS),
            Kind::Heatmap => has_line(HEATMAP_SETTINGS),
            Kind::Progressive => head.starts_with(PROGRESSIVE_MAGIC),
            Kind::Map => head.starts_with(ARRAY_MAGIC),
            Kind::Receipt => head.starts_with(RECEIPT_BEGINS),
            Kind::Signature => head.starts_with(SIGNATURE_BEGINS),
            Kind::Report => {
                head.trim_ascii_start().starts_with(b"{")
                    && std::fs::metadata(path).is_ok_and(|meta| meta.len() <= MOST_REPORT_BYTES)
                    && std::fs::File::open(path)
                        .is_ok_and(|file| is_report(std::io::BufReader::new(file)))
            }
        }
    }
}

/// Settings in the header of a file of seams.
pub const SEAMS_SETTINGS: &str = "simplify --seams";
/// Settings in the header of a heatmap.
pub const HEATMAP_SETTINGS: &str = "measure --heatmap";

/// The first bytes of a progressive mesh.
pub const PROGRESSIVE_MAGIC: &[u8; 8] = b"stncutpm";

/// First bytes of an array of NumPy.
pub const ARRAY_MAGIC: &[u8] = b"\x93NUMPY";

/// The first bytes of a receipt, of any version.
pub const RECEIPT_BEGINS: &[u8] = b"{\"about\":\"stonecut receipt";

/// The first bytes of a signature of a receipt.
pub const SIGNATURE_BEGINS: &[u8] = b"untrusted comment: signature of a stonecut receipt";

/// No report comes near this.
pub const MOST_REPORT_BYTES: u64 = 16 << 20;

/// Length of the beginning of a file that is read to find its kind.
const HEAD_BYTES: u64 = 64 << 10;

fn head(path: &Path) -> Vec<u8> {
    let mut head = Vec::new();
    // What cannot be read is of no known kind.
    let _ = std::fs::File::open(path).and_then(|file| file.take(HEAD_BYTES).read_to_end(&mut head));
    head
}

/// A report of `simplify` names input and output, one of `measure` original and simplified mesh.
fn is_report(text: impl Read) -> bool {
    serde_json::from_reader(text).is_ok_and(|keys: ReportKeys| {
        keys.input.and(keys.output).or(keys.original.and(keys.simplified)).is_some()
    })
}

/// The objects of a report that tell it from other JSON; what they hold is passed over, so it takes no memory.
#[derive(serde::Deserialize)]
struct ReportKeys {
    input: Option<AnyObject>,
    output: Option<AnyObject>,
    original: Option<AnyObject>,
    simplified: Option<AnyObject>,
}

struct AnyObject;

impl<'de> serde::Deserialize<'de> for AnyObject {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Passes;
        impl<'de> serde::de::Visitor<'de> for Passes {
            type Value = AnyObject;

            fn expecting(&self, out: &mut std::fmt::Formatter) -> std::fmt::Result {
                out.write_str("an object")
            }

            fn visit_map<A: serde::de::MapAccess<'de>>(
                self,
                mut map: A,
            ) -> Result<AnyObject, A::Error> {
                use serde::de::IgnoredAny;
                while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
                Ok(AnyObject)
            }
        }
        deserializer.deserialize_map(Passes)
    }
}

/// Beginnings of texts that a line more would break: meshes, libraries, JSON, pages, scripts.
const NO_LOGS: [&[u8]; 10] =
    [b"ply", b"solid", b"# OBJ", b"v ", b"mtllib", b"newmtl", b"{", b"[", b"<", b"#!"];

/// A line of `--progress json`, which goes into a log, too.
fn is_event(line: &[u8]) -> bool {
    serde_json::from_slice(line).is_ok_and(|event: serde_json::Value| event["event"].is_string())
}

/// No mesh, nothing binary, and nothing that lines behind it would break.
pub(crate) fn is_text(path: &Path) -> bool {
    let head = head(path);
    let is_plain = |&b: &u8| b >= b' ' || matches!(b, b'\t' | b'\n' | b'\r' | 0x1b);
    let first = head.trim_ascii_start();
    let line = first.split(|&byte| byte == b'\n').next().unwrap_or_default();
    head.iter().all(is_plain)
        && (is_event(line) || !NO_LOGS.iter().any(|begin| first.starts_with(begin)))
}
