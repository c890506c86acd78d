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
            match self.window.refill() {
                Ok(true) => {}
                Ok(false) => return Ok(any),
                Err(Fault::Other(error)) => return Err(error),
                Err(_) => return Err(self.bad("the line cannot be read")),
            }
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
