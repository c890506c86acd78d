//! Memory of a glTF document before it is parsed: `{},` is three bytes of a file and several hundred of a program.
//!
//! Counts objects and commas of the text by the list that they are in, without parsing it, and takes for each what it
//! comes to at most. The sizes are those of the types of `json` and of what is made of them.

use super::json::{Accessor, Buffer, Image, Material, Mesh, Node, Texture, View};
use super::scene::Placed;
use crate::materials;
use std::mem::size_of;

/// A list grows by doubling.
const GROWTH: u64 = 2;

/// An object inside of an element: a node of a map of strings, or the tree of an extension.
const INNER_BYTES: u64 = 704;

/// A number or a string in a list, with its share of the list.
const VALUE_BYTES: u64 = 64;

/// An element of a list of the document, with what is made of it.
fn element_bytes(list: &[u8]) -> u64 {
    let bytes = |parsed: usize, made: usize| GROWTH * (parsed + made) as u64;
    match list {
        b"accessors" => bytes(size_of::<Accessor>(), 0) + 32,
        b"buffers" => bytes(size_of::<Buffer>(), 256),
        b"bufferViews" => bytes(size_of::<View>(), 0),
        b"images" => bytes(size_of::<Image>(), size_of::<materials::Image>()) + 256,
        // Its name three times, and its place.
        b"materials" => bytes(size_of::<Material>(), size_of::<materials::Material>() + 256) + 256,
        b"meshes" => bytes(size_of::<Mesh>(), 24),
        b"nodes" => bytes(size_of::<Node>(), 2 * size_of::<Placed>()),
        b"textures" => bytes(size_of::<Texture>(), 0),
        _ => VALUE_BYTES,
    }
}

/// Bytes that a document takes once parsed, at most, its text included.
pub(super) fn parsed_bytes(text: &[u8]) -> u64 {
    let mut sum = 2 * text.len() as u64;
    let mut depth = 0u32;
    let (mut list, mut weight): (&[u8], u64) = (b"", VALUE_BYTES);
    let mut at = 0;
    while at < text.len() {
        match text[at] {
            b'"' => {
                let end = end_of_string(text, at + 1);
                if depth == 1 {
                    list = &text[at + 1..end];
                }
                at = end;
            }
            b'{' | b'[' => {
                depth += 1;
                sum += match depth {
                    1 => 0,
                    2 => {
                        weight = element_bytes(list);
                        0
                    }
                    3 => weight,
                    _ => INNER_BYTES,
                };
            }
            b'}' | b']' => depth = depth.saturating_sub(1),
            b',' => sum += VALUE_BYTES,
            _ => {}
        }
        at += 1;
    }
    sum
}

/// The place of the quote that ends a string which begins at `at`, or the end of the text.
fn end_of_string(text: &[u8], mut at: usize) -> usize {
    while at < text.len() && text[at] != b'"' {
        at += if text[at] == b'\\' { 2 } else { 1 };
    }
    at.min(text.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gltf::json::Document;

    #[test]
    fn lists_are_weighed_by_their_elements() {
        let plain = parsed_bytes(br#"{"asset":{"version":"2.0"},"nodes":[]}"#);
        let of = |text: String| parsed_bytes(text.as_bytes()) - plain;
        let n = 1000;
        let nodes = of(format!(r#"{{"nodes":[{}{{}}]}}"#, "{},".repeat(n - 1)));
        let materials = of(format!(r#"{{"materials":[{}{{}}]}}"#, "{},".repeat(n - 1)));
        assert!(nodes > (n * size_of::<Node>()) as u64, "{nodes}");
        assert!(materials > (n * (size_of::<Material>() + 200)) as u64, "{materials}");
        // Quotes, brackets and backslashes in strings count nothing.
        let string = |inner: &str| parsed_bytes(format!(r#"{{"a":"{inner}"}}"#).as_bytes());
        assert_eq!(string(r#"{{{{,,\"[[\\"#), string("xxxxxxxxxxxx"));
        assert!(parsed_bytes(b"{\"a\\") > 0);
    }

    /// The document itself, by the sizes of its types, is below its weight.
    #[test]
    fn a_map_takes_less_than_an_inner_object() {
        let node = 11 * (size_of::<String>() + size_of::<serde_json::Value>()) + 16;
        assert!(node as u64 <= INNER_BYTES, "{node}");
        let text = format!(r#"{{"extensionsRequired":["a"{}]}}"#, r#","a""#.repeat(1000));
        let parsed: Document = serde_json::from_str(&text).unwrap();
        let held = parsed.extensions_required.capacity() * size_of::<String>() + 1001 * 32;
        assert!(held as u64 <= parsed_bytes(text.as_bytes()));
    }
}
