//! Text that is not UTF-8: whole files in UTF-16, and names in the encodings of older systems.
//!
//! Decodes; does not decide what a text means.

use crate::ply::header::BYTE_ORDER_MARK;
use crate::ply::raw::{RawFile, Spool};
use encoding_rs::{
    BIG5, EUC_KR, Encoding, GBK, SHIFT_JIS, UTF_16BE, UTF_16LE, WINDOWS_1250, WINDOWS_1251,
    WINDOWS_1252,
};
use stonecut_system::error::Result;

/// Bytes that are decoded at once.
const CHUNK_BYTES: usize = 1 << 18;

/// The encoding of text in UTF-16 that begins with `first`: by its byte order mark, or by the zeros in its letters.
pub(super) fn utf16(first: &[u8]) -> Option<&'static Encoding> {
    match first {
        [0xff, 0xfe, ..] => return Some(UTF_16LE),
        [0xfe, 0xff, ..] => return Some(UTF_16BE),
        _ => {}
    }
    let first = first.get(..16)?;
    let is_letter = |b: &u8| matches!(b, b'\t' | b'\n' | b'\r' | b' '..=b'~');
    let has = |letters: usize, zeros: usize| {
        first.iter().skip(letters).step_by(2).all(is_letter)
            && first.iter().skip(zeros).step_by(2).all(|&b| b == 0)
    };
    match () {
        () if has(0, 1) => Some(UTF_16LE),
        () if has(1, 0) => Some(UTF_16BE),
        () => None,
    }
}

/// A copy of the file in UTF-8, in `spool`, without its byte order mark.
pub(super) fn to_utf8(
    file: &RawFile,
    encoding: &'static Encoding,
    mut spool: Spool,
) -> Result<RawFile> {
    let mut decoder = encoding.new_decoder_with_bom_removal();
    let (mut from, mut to) = (vec![0; CHUNK_BYTES], vec![0; 4 * CHUNK_BYTES]);
    let mut at = 0;
    loop {
        let n = file.read_at_most(&mut from, at)?;
        at += n as u64;
        let is_last = at >= file.len() || n == 0;
        let mut rest = &from[..n];
        loop {
            let (result, read, written, _) = decoder.decode_to_utf8(rest, &mut to, is_last);
            spool.write(&to[..written])?;
            rest = &rest[read..];
            if result == encoding_rs::CoderResult::InputEmpty {
                break;
            }
        }
        if is_last {
            return spool.finish(file.path());
        }
    }
}

/// The text of a whole file in memory: UTF-8 as it is, UTF-16 decoded, without its byte order mark.
pub(super) fn text_of_file(bytes: Vec<u8>) -> Vec<u8> {
    match utf16(&bytes) {
        Some(encoding) => encoding.decode(&bytes).0.into_owned().into_bytes(),
        None => match bytes.strip_prefix(BYTE_ORDER_MARK) {
            Some(rest) => rest.to_vec(),
            None => bytes,
        },
    }
}

/// A name of a text: UTF-8, or else Chinese (GBK) or Latin-1 as Windows has it.
///
/// Letters of GBK come in pairs of bytes beyond ASCII, which those of European words rarely do.
pub(super) fn name(bytes: &[u8]) -> String {
    if let Ok(text) = std::str::from_utf8(bytes) {
        return text.to_owned();
    }
    let mut pairs = bytes.chunk_by(|a, b| a.is_ascii() == b.is_ascii());
    let in_pairs = pairs.all(|run| run[0].is_ascii() || run.len() % 2 == 0);
    let (chinese, had_errors) = GBK.decode_without_bom_handling(bytes);
    match in_pairs && !had_errors {
        true => chinese.into_owned(),
        false => WINDOWS_1252.decode_without_bom_handling(bytes).0.into_owned(),
    }
}

/// The names that bytes may stand for, the likeliest first.
pub(super) fn names(bytes: &[u8]) -> Vec<String> {
    let mut out = vec![name(bytes)];
    if std::str::from_utf8(bytes).is_err() {
        let european = [WINDOWS_1252, WINDOWS_1250, WINDOWS_1251];
        for encoding in [GBK, SHIFT_JIS, BIG5, EUC_KR].into_iter().chain(european) {
            let (text, had_errors) = encoding.decode_without_bom_handling(bytes);
            if !had_errors && !out.iter().any(|known| *known == text) {
                out.push(text.into_owned());
            }
        }
    }
    out
}

/// The bytes of a text in which `%20` stands for a blank.
pub(super) fn unescaped(text: &str) -> Vec<u8> {
    let (bytes, mut out, mut i) = (text.as_bytes(), Vec::new(), 0);
    while i < bytes.len() {
        let hex = bytes.get(i + 1..i + 3).filter(|_| bytes[i] == b'%');
        let byte = hex.and_then(|hex| u8::from_str_radix(std::str::from_utf8(hex).ok()?, 16).ok());
        out.push(byte.unwrap_or(bytes[i]));
        i += if byte.is_some() { 3 } else { 1 };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn utf16_is_known_with_and_without_a_mark() {
        let text = "v 0 0 0\nv 1 0 0\n";
        let little: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let big: Vec<u8> = text.encode_utf16().flat_map(u16::to_be_bytes).collect();
        for (mark, bytes) in [(&[0xff, 0xfe][..], &little), (&[0xfe, 0xff], &big)] {
            assert_eq!(text_of_file([mark, bytes].concat()), text.as_bytes());
            assert_eq!(text_of_file(bytes.clone()), text.as_bytes());
        }
        assert_eq!(utf16(text.as_bytes()), None);
        assert_eq!(utf16(&[0; 84]), None);
    }

    #[test]
    fn names_of_older_systems_are_tried() {
        assert_eq!(names("stra\u{df}e".as_bytes()), ["stra\u{df}e"]);
        assert_eq!(names(b"stra\xdfe.png")[0], "stra\u{df}e.png");
        assert_eq!(names(b"\xce\xc6\xc0\xed.png")[0], "\u{7eb9}\u{7406}.png");
    }
}
