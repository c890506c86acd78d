//! Lines of a text file, with their numbers and byte offsets, at any size of file.

use crate::ply::header::BYTE_ORDER_MARK;
use crate::ply::raw::RawFile;
use crate::ply::scan::{Fault, Window, comma_advice, in_other_notation, plain_decimal};
use memchr::{memchr, memchr2};
use stonecut_system::error::Result;

/// A line longer than this is rejected (16 MiB: a polygon of a million corners).
const MAX_LINE_BYTES: usize = 16 << 20;

/// Reads a file line by line.
pub struct Lines<'a> {
    window: Window<'a>,
    /// Number of the line that was read last, from 1.
    pub number: u64,
    /// Byte offset of that line.
    pub offset: u64,
    /// True if the file ends within that line.
    pub has_no_end: bool,
    /// True if a line that ends in a backslash goes on in the next.
    goes_on: bool,
}

impl<'a> Lines<'a> {
    pub fn new(file: &'a RawFile) -> Self {
        let mut first = [0; BYTE_ORDER_MARK.len()];
        // A file that cannot be read says so with the first line.
        let is_marked = file.read_at_most(&mut first, 0).is_ok() && first == *BYTE_ORDER_MARK;
        let start = if is_marked { first.len() as u64 } else { 0 };
        let window = Window::new(file, start);
        Lines { window, number: 0, offset: 0, has_no_end: false, goes_on: false }
    }

    /// The lines of an OBJ file: one that ends in a backslash goes on in the next, unless it ends in a comment.
    pub fn of_obj(file: &'a RawFile) -> Self {
        Lines { goes_on: true, ..Lines::new(file) }
    }

    /// Replaces `line` by the next line without its end; `false` at the end of the file.
    pub fn next(&mut self, line: &mut Vec<u8>) -> Result<bool> {
        line.clear();
        self.offset = self.window.offset();
        self.number += 1;
        let mut any = false;
        loop {
            let rest = self.window.rest();
            if let Some(end) = memchr2(b'\n', b'\r', rest) {
                // The line feed behind a carriage return may be the first byte that is not at hand.
                if rest[end] == b'\r' && end + 1 == rest.len() && self.refill()? {
                    continue;
                }
                let rest = self.window.rest();
                line.extend_from_slice(&rest[..end]);
                let crlf = rest[end] == b'\r' && rest.get(end + 1) == Some(&b'\n');
                self.window.at += end + if crlf { 2 } else { 1 };
                // Blanks behind the backslash are not seen by those who write it.
                let written = line.trim_ascii_end().len();
                let is_open = self.goes_on && line[..written].ends_with(b"\\");
                if is_open && without_comment(line).len() == line.len() {
                    line.truncate(written - 1);
                    line.push(b' ');
                    self.number += 1;
                    any = true;
                    continue;
                }
                return Ok(true);
            }
            any |= !rest.is_empty();
            line.extend_from_slice(rest);
            self.window.at += rest.len();
            if line.len() > MAX_LINE_BYTES {
                return Err(self.bad("the line does not end; this is not a text file"));
            }
            if !self.refill()? {
                self.has_no_end = any;
                return Ok(any);
            }
        }
    }

    /// Reads on; `false` at the end of the file.
    fn refill(&mut self) -> Result<bool> {
        match self.window.refill() {
            Ok(is_more) => Ok(is_more),
            Err(Fault::Other(error)) => Err(error),
            Err(_) => Err(self.bad("the line cannot be read")),
        }
    }

    /// An error in the line that was read last.
    pub fn bad(&self, what: impl std::fmt::Display) -> stonecut_system::error::Error {
        self.window.file.bad(format!("line {} (byte offset {}): {what}", self.number, self.offset))
    }
}

/// A number as programs write it; NaN for the names that they give to what is not a number.
pub fn parse_number(token: &[u8]) -> Option<f64> {
    if let Some(value) = plain_decimal(token) {
        return Some(value);
    }
    let text = std::str::from_utf8(token).ok()?;
    text.parse().ok().or_else(|| in_other_notation(text))
}

/// The message for text where a number should be.
pub fn not_a_number(what: &str, token: &[u8], remedy: &str) -> String {
    format!("{what} is not a number{}; {remedy}", comma_advice(token))
}

/// A whole number as programs write it.
pub fn parse_whole(token: &[u8]) -> Option<i64> {
    if token.is_empty() || token.len() > 18 || !token.iter().all(u8::is_ascii_digit) {
        return std::str::from_utf8(token).ok()?.parse().ok();
    }
    Some(token.iter().fold(0, |sum, &byte| 10 * sum + i64::from(byte - b'0')))
}

/// A line up to its comment. The sign in `1.#QNAN` is not the beginning of one.
pub fn without_comment(line: &[u8]) -> &[u8] {
    let mut from = 0;
    while let Some(at) = memchr(b'#', &line[from..]).map(|at| from + at) {
        let is_number = line[..at].ends_with(b"1.")
            && line.get(at + 1).is_some_and(|b| b"IQSJRN".contains(&b.to_ascii_uppercase()));
        if !is_number {
            return &line[..at];
        }
        from = at + 1;
    }
    line
}

/// The words of a line.
pub fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> + Clone {
    line.split(|b| b.is_ascii_whitespace()).filter(|w| !w.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_the_standard_library() {
        let mut state = 1u64;
        for n_digits in 0..=18 {
            for point in 0..=n_digits + 1 {
                for sign in ["", "-", "+"] {
                    let mut text = sign.to_owned();
                    for place in 0..n_digits {
                        state = state.wrapping_mul(6364136223846793005).wrapping_add(99);
                        text.push_str(if place == point { "." } else { "" });
                        text.push(char::from(b'0' + (state >> 33) as u8 % 10));
                    }
                    text.push_str(if point == n_digits { "." } else { "" });
                    let wanted: Option<f64> = text.parse().ok();
                    let found = parse_number(text.as_bytes());
                    assert_eq!(found.map(f64::to_bits), wanted.map(f64::to_bits), "{text}");
                    assert_eq!(parse_whole(text.as_bytes()), text.parse().ok(), "{text}");
                }
            }
        }
    }

    #[test]
    fn comments_end_lines_and_numbers_do_not() {
        for (line, wanted) in [
            ("v 0 0 0#x", "v 0 0 0"),
            ("# all of it", ""),
            ("v 1.#QNAN -1.#IND00 1.#inf # x", "v 1.#QNAN -1.#IND00 1.#inf "),
            ("v 0 0 1.# x", "v 0 0 1."),
            ("f 1 2 3", "f 1 2 3"),
        ] {
            assert_eq!(without_comment(line.as_bytes()), wanted.as_bytes(), "{line}");
        }
    }

    /// Every byte of a line that goes on behind CR LF is once the last one of a window.
    #[test]
    fn a_line_goes_on_wherever_a_window_ends() {
        let tail = b"\nf 1 2\\ \r\n3\r\nend\r";
        for padding in Window::BYTES - tail.len()..=Window::BYTES {
            let bytes = [vec![b'x'; padding], tail.to_vec()].concat();
            let file = RawFile::from_bytes("lines.obj", bytes);
            let (mut lines, mut line) = (Lines::of_obj(&file), Vec::new());
            let mut found = Vec::new();
            while lines.next(&mut line).unwrap() {
                found.push((String::from_utf8(line.clone()).unwrap(), lines.number));
            }
            let texts: Vec<&str> = found[1..].iter().map(|(text, _)| text.as_str()).collect();
            assert_eq!(texts, ["f 1 2 3", "end"], "{padding}");
            let numbers: Vec<u64> = found.iter().map(|(_, number)| *number).collect();
            assert_eq!(numbers, [1, 3, 4], "{padding}");
        }
    }
}
