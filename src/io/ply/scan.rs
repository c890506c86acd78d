//! Numbers one after another, whatever the encoding of the body.
//!
//! `Scan` is what binary and ASCII bodies have in common; rows of varying length, index passes and
//! triangle strips are written once against it. It knows neither elements nor rows: a `Fault` gets its
//! row from whoever was reading one.

use super::header::{HeaderProperty, Kind, Wire};
use super::raw::RawFile;
use std::fmt;
use stonecut_mesh::property::Scalar;
use stonecut_system::error::Error;

/// A place in the body from which reading can begin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mark {
    /// Byte offset in the file.
    pub offset: u64,
    /// Line of an ASCII body, from 1; 0 in a binary body.
    pub line: u64,
    /// Byte offset of that line's beginning.
    pub line_start: u64,
}

impl fmt::Display for Mark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.line > 0 {
            let column = self.offset.saturating_sub(self.line_start) + 1;
            write!(f, "line {}, column {column} (byte offset {})", self.line, self.offset)
        } else {
            write!(f, "byte offset {}", self.offset)
        }
    }
}

/// Reason why a number could not be read.
#[derive(Debug)]
pub enum Fault {
    /// The file ends.
    End,
    /// Text that is not what the header promises.
    Text(String),
    /// The system could not read, or the file changed.
    Other(Error),
}

/// The result of reading a number.
pub type Scanned<T> = Result<T, Fault>;

/// A body as a stream of numbers of given types.
pub trait Scan {
    /// The place of the next number; in ASCII, at the white space before it.
    fn mark(&self) -> Mark;
    /// The place of the last number that was read, for messages.
    fn last(&self) -> Mark;
    /// A vertex id; a negative number becomes `u64::MAX`, which no vertex has.
    fn index(&mut self, wire: Wire) -> Scanned<u64>;
    /// Writes the number to the beginning of `target` as a little-endian `scalar`.
    fn store(&mut self, wire: Wire, scalar: Scalar, target: &mut [u8]) -> Scanned<()>;
    /// Passes over `n` numbers.
    fn skip(&mut self, wire: Wire, n: u64) -> Scanned<()>;

    /// The count of a list; a negative one is a fault.
    fn count(&mut self, wire: Wire) -> Scanned<u64> {
        match self.index(wire)? {
            u64::MAX => Err(Fault::Text("a list has a negative count".to_owned())),
            count => Ok(count),
        }
    }

    /// Passes over one property.
    fn skip_property(&mut self, property: &HeaderProperty) -> Scanned<()> {
        match property.kind {
            Kind::Scalar(wire) => self.skip(wire, 1),
            Kind::List { count, item } => {
                let n = self.count(count)?;
                self.skip(item, n)
            }
        }
    }
}

/// A number of at most 15 digits without an exponent, as the nearest double: digits and power of ten are exact, so their
/// quotient is rounded once. Between 1e-15 and 1e15; `None` for any other text.
#[inline(always)]
pub fn plain_decimal(token: &[u8]) -> Option<f64> {
    const POWERS: [f64; 16] =
        [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];
    let is_negative = token.first() == Some(&b'-');
    let digits = &token[usize::from(is_negative)..];
    if digits.is_empty() || digits.len() > 16 {
        return None;
    }
    let (mut value, mut n_digits, mut n_before) = (0u64, 0usize, None);
    for &byte in digits {
        let digit = byte.wrapping_sub(b'0');
        match digit {
            0..=9 => {
                value = 10 * value + u64::from(digit);
                n_digits += 1;
            }
            _ if byte == b'.' && n_before.is_none() => n_before = Some(n_digits),
            _ => return None,
        }
    }
    if n_digits == 0 || n_digits > 15 {
        return None;
    }
    let value = value as f64 / POWERS[n_digits - n_before.unwrap_or(n_digits)];
    Some(if is_negative { -value } else { value })
}

/// A number in the notation of Fortran (`1.5D+03`), or NaN for a name of C's libraries for what is not a number.
pub fn in_other_notation<T: std::str::FromStr + From<f32>>(text: &str) -> Option<T> {
    let is_number = |text: &&str| {
        text.starts_with(|c: char| c == '.' || c == '-' || c == '+' || c.is_ascii_digit())
    };
    let exponent = text.find(['d', 'D']).filter(|_| is_number(&text));
    let known = exponent.and_then(|at| format!("{}e{}", &text[..at], &text[at + 1..]).parse().ok());
    known.or_else(|| is_no_number(text).then(|| T::from(f32::NAN)))
}

/// Advice for a text that would be a number with a point for its comma; empty for any other.
pub fn comma_advice(token: &[u8]) -> &'static str {
    let text = String::from_utf8_lossy(token);
    match text.contains(',') && text.replacen(',', ".", 1).parse::<f64>().is_ok() {
        true => ": it has a decimal comma (write points, as with sed 's/,/./g')",
        false => "",
    }
}

/// Returns whether text is one of the names that libraries of C give to what is not a number: `-nan(ind)`, `1.#QNAN`,
/// `-1.#IND00`, `1.#J`.
fn is_no_number(text: &str) -> bool {
    let lower = text.to_ascii_lowercase();
    let bare = lower.trim_start_matches(['-', '+']);
    let is_named = ["nan", "qnan", "snan", "1.#i", "1.#q", "1.#s", "1.#j", "1.#r", "1.#n"];
    is_named.iter().any(|name| bare.starts_with(name))
}

/// A stretch of the file in memory that moves forward.
pub struct Window<'a> {
    /// The file that it lies over.
    pub file: &'a RawFile,
    /// Offset in the file of the first byte of `bytes`.
    base: u64,
    bytes: Vec<u8>,
    /// The next byte, counted from `base`.
    pub at: usize,
}

impl<'a> Window<'a> {
    /// Bytes that are read at a time.
    pub const BYTES: usize = 256 << 10;

    /// A window that begins at `offset`, still empty.
    pub fn new(file: &'a RawFile, offset: u64) -> Self {
        Window { file, base: offset, bytes: Vec::new(), at: 0 }
    }

    /// Offset in the file of the next byte.
    pub fn offset(&self) -> u64 {
        self.base + self.at as u64
    }

    /// The bytes at hand.
    #[inline(always)]
    pub fn rest(&self) -> &[u8] {
        &self.bytes[self.at..]
    }

    /// Reads on, keeping what was not consumed; `false` at the end of the file.
    #[cold]
    pub fn refill(&mut self) -> Scanned<bool> {
        self.bytes.drain(..self.at);
        self.base += self.at as u64;
        self.at = 0;
        let kept = self.bytes.len();
        let from = self.base + kept as u64;
        let left = self.file.len().saturating_sub(from);
        let n = left.min(Self::BYTES as u64) as usize;
        self.bytes.resize(kept + n, 0);
        self.file.read_exact_at(&mut self.bytes[kept..], from).map_err(Fault::Other)?;
        Ok(n > 0)
    }

    /// The next `N` bytes, consumed.
    #[inline(always)]
    pub fn take<const N: usize>(&mut self) -> Scanned<[u8; N]> {
        while self.bytes.len() - self.at < N {
            if !self.refill()? {
                return Err(Fault::End);
            }
        }
        let bytes = self.bytes[self.at..self.at + N].try_into();
        self.at += N;
        Ok(bytes.expect("N bytes"))
    }

    /// Passes over `n` bytes, without reading those not at hand.
    pub fn skip(&mut self, n: u64) -> Scanned<()> {
        let left = (self.bytes.len() - self.at) as u64;
        if n <= left {
            self.at += n as usize;
            return Ok(());
        }
        let to = self.offset().checked_add(n).filter(|&to| to <= self.file.len());
        let Some(to) = to else { return Err(Fault::End) };
        self.bytes.clear();
        (self.base, self.at) = (to, 0);
        Ok(())
    }
}
