//! The header of a PLY file, read by tokens.
//!
//! Tolerates what programs really write: LF, CRLF and CR line ends, padded counts, blank lines, trailing
//! blanks, every name of every type, text that is not UTF-8. Says nothing about the body beyond where it
//! begins; docs/design/formats.md tells why this is not `ply-rs-bw`.

use super::raw::RawFile;
use stonecut_mesh::property::Scalar;
use stonecut_system::error::Result;

/// A header longer than this is rejected (16 MiB; the longest seen in the wild has a few KiB).
const MAX_HEADER_BYTES: u64 = 16 << 20;

/// The mark that some editors put before text in UTF-8.
pub const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Encoding of the numbers in the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Encoding {
    /// Decimal numbers, separated by any white space.
    Ascii,
    /// Packed, least significant byte first.
    BinaryLittleEndian,
    /// Packed, most significant byte first.
    BinaryBigEndian,
}

impl Encoding {
    /// The name in the header.
    pub const fn name(self) -> &'static str {
        match self {
            Encoding::Ascii => "ascii",
            Encoding::BinaryLittleEndian => "binary_little_endian",
            Encoding::BinaryBigEndian => "binary_big_endian",
        }
    }
}

/// The type of a number in the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wire {
    /// A type that records know too.
    Plain(Scalar),
    /// A half-precision float (trimesh); becomes a float.
    F16,
}

impl Wire {
    /// Rows: the names of a type, and the type.
    const NAMES: [(&'static str, Wire); 23] = [
        ("char", Wire::Plain(Scalar::I8)),
        ("int8", Wire::Plain(Scalar::I8)),
        ("uchar", Wire::Plain(Scalar::U8)),
        ("uint8", Wire::Plain(Scalar::U8)),
        ("short", Wire::Plain(Scalar::I16)),
        ("int16", Wire::Plain(Scalar::I16)),
        ("ushort", Wire::Plain(Scalar::U16)),
        ("uint16", Wire::Plain(Scalar::U16)),
        ("int", Wire::Plain(Scalar::I32)),
        ("int32", Wire::Plain(Scalar::I32)),
        ("uint", Wire::Plain(Scalar::U32)),
        ("uint32", Wire::Plain(Scalar::U32)),
        ("int64", Wire::Plain(Scalar::I64)),
        ("longlong", Wire::Plain(Scalar::I64)),
        ("long", Wire::Plain(Scalar::I64)),
        ("uint64", Wire::Plain(Scalar::U64)),
        ("ulonglong", Wire::Plain(Scalar::U64)),
        ("float", Wire::Plain(Scalar::F32)),
        ("float32", Wire::Plain(Scalar::F32)),
        ("double", Wire::Plain(Scalar::F64)),
        ("float64", Wire::Plain(Scalar::F64)),
        ("float16", Wire::F16),
        ("half", Wire::F16),
    ];

    fn parse(name: &str) -> Option<Wire> {
        Self::NAMES.iter().find(|(n, _)| *n == name).map(|&(_, wire)| wire)
    }

    /// Size in a binary body.
    pub const fn bytes(self) -> u64 {
        match self {
            Wire::Plain(scalar) => scalar.bytes() as u64,
            Wire::F16 => 2,
        }
    }

    /// Returns whether this is an integer type.
    pub const fn is_integer(self) -> bool {
        match self {
            Wire::Plain(scalar) => scalar.is_integer(),
            Wire::F16 => false,
        }
    }

    /// The record type that holds every value of this one.
    pub const fn scalar(self) -> Scalar {
        match self {
            Wire::Plain(scalar) => scalar,
            Wire::F16 => Scalar::F32,
        }
    }
}

/// Type of a property.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One number.
    Scalar(Wire),
    /// A count, then that many numbers.
    List {
        /// Any type; as a rule an integer one.
        count: Wire,
        /// Any type.
        item: Wire,
    },
}

/// A property line.
#[derive(Clone, Debug)]
pub struct HeaderProperty {
    /// Name.
    pub name: String,
    /// Scalar or list, with its types.
    pub kind: Kind,
}

/// Names that programs give to the corners of a face.
const CORNER_NAMES: [&str; 6] =
    ["vertex_indices", "vertex_index", "vertex_indexes", "vertexindices", "indices", "vertices"];

/// An element line with its properties.
#[derive(Clone, Debug)]
pub struct Element {
    /// Name: `vertex`, `face`, ...
    pub name: String,
    /// Rows.
    pub count: u64,
    /// In the order of the file.
    pub properties: Vec<HeaderProperty>,
}

impl Element {
    /// Bytes of one row in a binary body, if no property is a list; `None` also if it overflows.
    pub fn fixed_bytes(&self) -> Option<u64> {
        self.properties.iter().try_fold(0u64, |sum, p| match p.kind {
            Kind::Scalar(wire) => sum.checked_add(wire.bytes()),
            Kind::List { .. } => None,
        })
    }

    /// Gives names that differ from known ones in case only their usual form, group by group.
    fn spell_as_known(&mut self) {
        const KNOWN: [&[&str]; 14] = [
            &["x", "y", "z"],
            &["nx", "ny", "nz"],
            &["red", "green", "blue"],
            &["diffuse_red", "diffuse_green", "diffuse_blue"],
            &["r", "g", "b", "a"],
            &["r", "g", "b"],
            &["alpha"],
            &["diffuse_alpha"],
            &["s", "t"],
            &["u", "v"],
            &["texture_u", "texture_v"],
            &["vertex_indices"],
            &["vertex_index"],
            &["texcoord"],
        ];
        if ["vertex", "face"].contains(&self.name.to_ascii_lowercase().as_str()) {
            self.name.make_ascii_lowercase();
        }
        for group in KNOWN {
            let place =
                |name: &str| self.properties.iter().position(|p| p.name.eq_ignore_ascii_case(name));
            let places: Vec<usize> = group.iter().filter_map(|name| place(name)).collect();
            if places.len() == group.len() {
                places.into_iter().for_each(|i| self.properties[i].name.make_ascii_lowercase());
            }
        }
    }

    /// Returns whether these are faces under another name.
    fn has_faces(&self) -> bool {
        const NAMES: [&str; 4] = ["faces", "triangle", "polygon", "facet"];
        let name = self.name.to_ascii_lowercase();
        let is_one = |known: &&str| name.strip_prefix(*known).is_some_and(|end| end.len() < 2);
        self.index_list().is_some() && NAMES.iter().any(is_one)
    }

    /// The corner list of a face or strip.
    pub fn index_list(&self) -> Option<usize> {
        self.properties.iter().position(|p| {
            matches!(p.kind, Kind::List { .. }) && CORNER_NAMES.contains(&p.name.as_str())
        })
    }
}

/// A header as it stands in the file.
#[derive(Clone, Debug)]
pub struct Header {
    /// Of the body.
    pub encoding: Encoding,
    /// The text of `comment` lines, in order.
    pub comments: Vec<String>,
    /// The text of `obj_info` lines, in order.
    pub obj_infos: Vec<String>,
    /// In the order of the file.
    pub elements: Vec<Element>,
    /// First byte of the body.
    pub body_offset: u64,
    /// Number of lines of the header; an ASCII body begins on the next.
    pub n_lines: u64,
}

/// End of a line, as line 1 has it.
#[derive(Clone, Copy, PartialEq)]
enum LineEnd {
    Lf,
    CrLf,
    Cr,
}

impl Header {
    /// Reads the header of `file`; the error names the header's line.
    pub fn read(file: &RawFile) -> Result<Self> {
        let mut bytes = Vec::new();
        let mut size = 4096;
        loop {
            bytes.resize(size.min(file.len()) as usize, 0);
            file.read_exact_at(&mut bytes, 0)?;
            match Parser::new(file, &bytes).parse()? {
                Some(header) => return Ok(header),
                None if size >= file.len() => {
                    return Err(
                        file.bad("the header has no 'end_header' line; the file is truncated")
                    );
                }
                None if size >= MAX_HEADER_BYTES => {
                    return Err(file.bad(format!(
                        "no 'end_header' within {MAX_HEADER_BYTES} bytes; this is not a PLY file"
                    )));
                }
                None => size *= 8,
            }
        }
    }

    /// Returns the names of the images that per-corner or per-vertex texture coordinates refer to.
    pub fn texture_files(&self) -> Vec<String> {
        let lines = self.comments.iter();
        lines.filter_map(|line| texture_file(line)).map(str::to_owned).collect()
    }
}

/// The name that a comment or a line `obj_info` gives to an image: `TextureFile NAME`, also in two words or joined otherwise,
/// with a colon or `=`, and `texture: NAME` with what looks like the name of a file.
pub fn texture_file(line: &str) -> Option<&str> {
    const WORDS: [&str; 5] =
        ["TextureFile", "Texture_File", "Texture-File", "Texture File", "Texture"];
    let line = line.trim_start();
    let begins =
        |word: &&str| line.get(..word.len()).is_some_and(|text| text.eq_ignore_ascii_case(word));
    let word = WORDS.iter().find(|word| begins(word))?;
    let rest = &line[word.len()..];
    let is_word = rest.starts_with([':', '=', ' ', '\t']) || rest.is_empty();
    let rest = rest.trim_start();
    let name = rest.strip_prefix([':', '=']);
    let is_file = |name: &str| {
        name.rsplit_once('.').is_some_and(|(_, end)| (3..=4).contains(&end.trim().len()))
    };
    let is_named = *word != "Texture" || name.is_some_and(is_file);
    (is_word && is_named).then(|| name.unwrap_or(rest).trim())
}

struct Parser<'a> {
    file: &'a RawFile,
    bytes: &'a [u8],
    at: usize,
    line: u64,
}

impl<'a> Parser<'a> {
    fn new(file: &'a RawFile, bytes: &'a [u8]) -> Self {
        Parser { file, bytes, at: 0, line: 0 }
    }

    /// The header, or `None` if it goes on beyond the bytes at hand.
    fn parse(mut self) -> Result<Option<Header>> {
        if self.bytes.starts_with(BYTE_ORDER_MARK) {
            self.at = BYTE_ORDER_MARK.len();
        }
        if !self.bytes[self.at..].starts_with(b"ply") {
            return Err(self.file.bad("this is not a PLY file: it does not begin with 'ply'"));
        }
        let Some(end) = self.line_end() else { return Ok(None) };
        let Some(first) = self.next_line(end) else { return Ok(None) };
        if !first.trim_ascii_end().eq(b"ply") {
            return Err(self.file.bad("this is not a PLY file: line 1 is not 'ply'"));
        }
        let mut encoding = None;
        let mut header = Header {
            encoding: Encoding::Ascii,
            comments: Vec::new(),
            obj_infos: Vec::new(),
            elements: Vec::new(),
            body_offset: 0,
            n_lines: 0,
        };
        loop {
            let Some(line) = self.next_line(end) else { return Ok(None) };
            let (keyword, rest) = split_word(line);
            match keyword {
                b"" => {}
                b"comment" => header.comments.push(text(rest)),
                // Wherever a name of an image stands, it is written as a comment.
                b"obj_info" if texture_file(&text(rest)).is_some() => {
                    header.comments.push(text(rest));
                }
                b"obj_info" => header.obj_infos.push(text(rest)),
                b"format" => encoding = Some(self.format(rest)?),
                b"element" => {
                    let element = self.element(rest)?;
                    header.elements.push(element);
                }
                b"property" => {
                    let property = self.property(rest)?;
                    match header.elements.last_mut() {
                        Some(element) => element.properties.push(property),
                        None => return Err(self.bad("a property before the first element")),
                    }
                }
                b"end_header" => break,
                _ => {
                    return Err(self.bad(format!(
                        "'{}' is not a keyword of a PLY header",
                        shorten(&text(keyword))
                    )));
                }
            }
        }
        header.elements.iter_mut().for_each(Element::spell_as_known);
        if !header.elements.iter().any(|element| ["face", "tristrips"].contains(&&*element.name))
            && let Some(element) = header.elements.iter_mut().find(|element| element.has_faces())
        {
            element.name = "face".to_owned();
        }
        header.encoding = encoding.ok_or_else(|| self.bad("the line 'format' is missing"))?;
        header.body_offset = self.at as u64;
        header.n_lines = self.line;
        Ok(Some(header))
    }

    fn bad(&self, what: impl std::fmt::Display) -> stonecut_system::error::Error {
        self.file.bad(format!("header line {}: {what}", self.line))
    }

    fn line_end(&self) -> Option<LineEnd> {
        let at = self.bytes.iter().position(|b| matches!(b, b'\n' | b'\r'))?;
        match (self.bytes[at], self.bytes.get(at + 1)) {
            (b'\n', _) => Some(LineEnd::Lf),
            (_, Some(b'\n')) => Some(LineEnd::CrLf),
            (_, Some(_)) => Some(LineEnd::Cr),
            (_, None) => None,
        }
    }

    /// The next line without its end. Exactly one line end of the kind of line 1 is consumed, so that a
    /// binary body that begins with the byte 0x0A stays whole. Where line 1 ends in CRLF, a lone LF
    /// ends a line too (headers patched by other programs).
    fn next_line(&mut self, end: LineEnd) -> Option<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let last = if end == LineEnd::Cr { b'\r' } else { b'\n' };
        let length = rest.iter().position(|&b| b == last)?;
        self.at += length + 1;
        self.line += 1;
        let line = &rest[..length];
        Some(line.strip_suffix(b"\r").unwrap_or(line))
    }

    fn format(&self, rest: &[u8]) -> Result<Encoding> {
        let word = split_word(rest).0;
        match word.to_ascii_lowercase().as_slice() {
            b"ascii" => Ok(Encoding::Ascii),
            b"binary_little_endian" => Ok(Encoding::BinaryLittleEndian),
            b"binary_big_endian" => Ok(Encoding::BinaryBigEndian),
            _ => Err(self.bad(format!(
                "format '{}' is none of ascii, binary_little_endian, binary_big_endian",
                shorten(&text(word))
            ))),
        }
    }

    fn element(&self, rest: &[u8]) -> Result<Element> {
        let (name, rest) = split_word(rest);
        let count = text(split_word(rest).0);
        let digits = !count.is_empty() && count.bytes().all(|b| b.is_ascii_digit());
        let parsed = if digits { count.parse::<u64>().ok() } else { None };
        match parsed {
            Some(count) if !name.is_empty() => {
                Ok(Element { name: text(name), count, properties: Vec::new() })
            }
            _ => Err(self.bad(format!(
                "element '{}' has the count '{}', which is not a number",
                shorten(&text(name)),
                shorten(&count)
            ))),
        }
    }

    fn property(&self, rest: &[u8]) -> Result<HeaderProperty> {
        let (first, rest) = split_word(rest);
        let (kind, name) = if first == b"list" {
            let (count, rest) = split_word(rest);
            let (item, rest) = split_word(rest);
            let (count, item) = (self.wire(count)?, self.wire(item)?);
            (Kind::List { count, item }, rest)
        } else {
            (Kind::Scalar(self.wire(first)?), rest)
        };
        // A name with blanks is kept as one word, so that our own header stays readable.
        let name = text(name).split_whitespace().collect::<Vec<_>>().join("_");
        if name.is_empty() {
            return Err(self.bad("a property without a name"));
        }
        Ok(HeaderProperty { name, kind })
    }

    fn wire(&self, name: &[u8]) -> Result<Wire> {
        let name = text(name);
        Wire::parse(&name)
            .ok_or_else(|| self.bad(format!("'{}' is not a type of PLY", shorten(&name))))
    }
}

/// The first word and what follows it, without the blanks before either.
fn split_word(line: &[u8]) -> (&[u8], &[u8]) {
    let start = line.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(line.len());
    let line = &line[start..];
    let end = line.iter().position(|b| b.is_ascii_whitespace()).unwrap_or(line.len());
    // Exactly one blank parts a keyword from its text; more of them belong to the text of a comment.
    (&line[..end], line.get(end + 1..).unwrap_or(&[]))
}

/// Bytes as text: UTF-8, or else Latin-1, which every byte is.
fn text(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
    }
}

/// At most 40 characters, for messages about hostile files.
fn shorten(text: &str) -> String {
    text.chars().take(40).map(|c| if c.is_control() { '?' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> Result<Header> {
        Header::read(&RawFile::from_bytes("test.ply", bytes.to_vec()))
    }

    #[test]
    fn one_line_end_of_the_kind_of_line_one_parts_header_and_body() {
        for end in ["\n", "\r\n", "\r"] {
            for body in [&b"\n\n"[..], b"\r\n", b"\x03", b""] {
                let mut bytes = ["ply", "format binary_little_endian 1.0", "end_header", ""]
                    .join(end)
                    .into_bytes();
                // A lone CR is told from CRLF by what follows line 1, so only there it is unambiguous.
                let offset = bytes.len() as u64;
                bytes.extend_from_slice(body);
                let header = read(&bytes).unwrap();
                assert_eq!(header.body_offset, offset, "{end:?} {body:?}");
            }
        }
    }

    #[test]
    fn oddities_of_real_headers_are_read() {
        let header = read(
            b"ply  \nformat ascii 1.0\ncomment  two blanks \ncomment\ncomment caf\xe9\n\nobj_info x\n\
              element  vertex\t0000123456  \nproperty float32 x\nproperty list uchar int a\n\
              comment TextureFile a b.png\nend_header \n",
        )
        .unwrap();
        assert_eq!(header.comments, [" two blanks ", "", "caf\u{e9}", "TextureFile a b.png"]);
        assert_eq!(header.obj_infos, ["x"]);
        assert_eq!(header.elements[0].count, 123_456);
        assert_eq!(header.elements[0].properties.len(), 2);
        assert_eq!(header.texture_files(), ["a b.png"]);
    }

    #[test]
    fn broken_headers_are_refused_with_their_line() {
        let cases: [(&str, &str); 8] = [
            ("plx\n", "not a PLY file"),
            ("ply\nformat ascii 1.0\n", "end_header"),
            ("ply\nend_header\n", "'format' is missing"),
            ("ply\nformat foo 1.0\nend_header\n", "line 2"),
            ("ply\nformat ascii 1.0\nelement vertex -1\nend_header\n", "line 3"),
            ("ply\nformat ascii 1.0\nelement vertex 99999999999999999999\nend_header\n", "line 3"),
            ("ply\nformat ascii 1.0\nproperty float x\nend_header\n", "before the first element"),
            (
                "ply\nformat ascii 1.0\nelement v 1\nproperty list real int x\nend_header\n",
                "'real' is not a type",
            ),
        ];
        for (bytes, wanted) in cases {
            let message = read(bytes.as_bytes()).unwrap_err().to_string();
            assert!(message.contains(wanted), "{message}");
        }
    }
}
