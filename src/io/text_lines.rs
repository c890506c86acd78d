//! Lines of a text file, with their numbers and byte offsets, at any size of file.

use crate::error::Result;
use crate::io::ply::raw::RawFile;
use crate::io::ply::scan::{Fault, Window};

/// A line longer than this is rejected (16 MiB: a polygon of a million corners).
const MAX_LINE_BYTES: usize = 16 << 20;

/// Reads a file line by line.
pub(crate) struct Lines<'a> {
    window: Window<'a>,
    /// Number of the line that was read last, from 1.
    pub number: u64,
    /// Byte offset of that line.
    pub offset: u64,
}

impl<'a> Lines<'a> {
    pub fn new(file: &'a RawFile) -> Self {
        Lines { window: Window::new(file, 0), number: 0, offset: 0 }
    }

    /// Replaces `line` by the next line without its end; `false` at the end of the file. A line that ends
    /// in a backslash goes on in the next.
    pub fn next(&mut self, line: &mut Vec<u8>) -> Result<bool> {
        line.clear();
        self.offset = self.window.offset();
        self.number += 1;
        let mut any = false;
        loop {
            let rest = self.window.rest();
            if let Some(end) = rest.iter().position(|&b| b == b'\n' || b == b'\r') {
                // The line feed behind a carriage return may be the first byte that is not at hand.
                if rest[end] == b'\r' && end + 1 == rest.len() && self.refill()? {
                    continue;
                }
                let rest = self.window.rest();
                line.extend_from_slice(&rest[..end]);
                let crlf = rest[end] == b'\r' && rest.get(end + 1) == Some(&b'\n');
                self.window.at += end + if crlf { 2 } else { 1 };
                if line.last() == Some(&b'\\') {
                    line.pop();
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
    pub fn bad(&self, what: impl std::fmt::Display) -> crate::error::Error {
        self.window.file.bad(format!("line {} (byte offset {}): {what}", self.number, self.offset))
    }
}

/// A number as programs write it.
pub(crate) fn parse_number(token: &[u8]) -> Option<f64> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// The words of a line.
pub(crate) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> + Clone {
    line.split(|b| b.is_ascii_whitespace()).filter(|w| !w.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every byte of a line that goes on behind CR LF is once the last one of a window.
    #[test]
    fn a_line_goes_on_wherever_a_window_ends() {
        let tail = b"\nf 1 2\\\r\n3\r\nend\r";
        for padding in Window::BYTES - tail.len()..=Window::BYTES {
            let bytes = [vec![b'#'; padding], tail.to_vec()].concat();
            let file = RawFile::from_bytes("lines.obj", bytes);
            let (mut lines, mut line) = (Lines::new(&file), Vec::new());
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
