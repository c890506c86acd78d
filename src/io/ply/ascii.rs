//! ASCII bodies as streams of numbers: tokens parted by any white space, lines only for messages.

use super::header::Wire;
use super::raw::RawFile;
use super::scan::{
    Fault, Mark, Scan, Scanned, Window, comma_advice, in_other_notation, plain_decimal,
};
use stonecut_mesh::property::Scalar;

/// No number is written with more characters than this.
const MAX_TOKEN_BYTES: usize = 512;

/// Reads decimal numbers.
pub struct AsciiScan<'a> {
    window: Window<'a>,
    line: u64,
    line_start: u64,
    last: Mark,
    /// True if the byte before the next was a CR, so that CRLF counts as one line.
    after_cr: bool,
}

/// Classes of bytes between and within numbers.
const SPACE: u8 = 1;
const LINE: u8 = 2;
const CLASS: [u8; 256] = {
    let mut class = [0u8; 256];
    class[b' ' as usize] = SPACE;
    class[b'\t' as usize] = SPACE;
    class[0x0b] = SPACE;
    class[0x0c] = SPACE;
    class[b'\n' as usize] = LINE;
    class[b'\r' as usize] = LINE;
    class
};

impl<'a> AsciiScan<'a> {
    pub fn new(file: &'a RawFile, mark: Mark) -> Self {
        let window = Window::new(file, mark.offset);
        let (line, line_start) = (mark.line, mark.line_start);
        AsciiScan { window, line, line_start, last: mark, after_cr: false }
    }

    /// Moves to the next number; `End` if there is none.
    #[inline(always)]
    fn skip_space(&mut self) -> Scanned<()> {
        loop {
            let rest = self.window.rest();
            let mut i = 0;
            while i < rest.len() {
                match CLASS[rest[i] as usize] {
                    0 => {
                        self.window.at += i;
                        self.after_cr = false;
                        return Ok(());
                    }
                    LINE => {
                        let offset = self.window.offset() + i as u64 + 1;
                        if !(rest[i] == b'\n' && self.after_cr) {
                            self.line += 1;
                        }
                        self.line_start = offset;
                        self.after_cr = rest[i] == b'\r';
                    }
                    _ => self.after_cr = false,
                }
                i += 1;
            }
            self.window.at += i;
            if !self.window.refill()? {
                self.last = self.mark();
                return Err(Fault::End);
            }
        }
    }

    /// Finds the next token and hands it to `parse`.
    #[inline(always)]
    fn token<T>(&mut self, parse: impl Fn(&[u8]) -> Option<T>, wanted: &str) -> Scanned<T> {
        self.skip_space()?;
        self.last = self.mark();
        let mut length = 0;
        loop {
            let rest = self.window.rest();
            while length < rest.len() && CLASS[rest[length] as usize] == 0 {
                length += 1;
            }
            if length > MAX_TOKEN_BYTES {
                return Err(Fault::Text("there is text where a number should be".to_owned()));
            }
            if length < rest.len() || !self.window.refill()? {
                break;
            }
        }
        let token = &self.window.rest()[..length];
        let value = parse(token);
        if value.is_none() {
            let text: String = token.iter().take(40).map(|&b| printable(b)).collect();
            let advice = comma_advice(token);
            return Err(Fault::Text(format!("'{text}' is not {wanted}{advice}")));
        }
        self.window.at += length;
        value.ok_or(Fault::End)
    }
}

fn printable(byte: u8) -> char {
    if byte.is_ascii_graphic() { char::from(byte) } else { '?' }
}

impl Scan for AsciiScan<'_> {
    fn mark(&self) -> Mark {
        Mark { offset: self.window.offset(), line: self.line, line_start: self.line_start }
    }

    fn last(&self) -> Mark {
        self.last
    }

    #[inline(always)]
    fn index(&mut self, _wire: Wire) -> Scanned<u64> {
        self.token(parse_index, "whole number")
    }

    fn store(&mut self, wire: Wire, scalar: Scalar, target: &mut [u8]) -> Scanned<()> {
        match scalar {
            Scalar::F32 => {
                let value = self.token(parse_float::<f32>, "number")?;
                target[..4].copy_from_slice(&value.to_le_bytes());
            }
            Scalar::F64 => {
                let value = self.token(parse_float::<f64>, "number")?;
                target[..8].copy_from_slice(&value.to_le_bytes());
            }
            _ => {
                let limits = integer_limits(scalar);
                let parse = |t: &[u8]| parse_integer(t).filter(|v| limits.contains(v));
                let value = self.token(parse, super::writer::type_name(wire.scalar()))?;
                let n = scalar.bytes();
                target[..n].copy_from_slice(&value.to_le_bytes()[..n]);
            }
        }
        Ok(())
    }

    fn skip(&mut self, _wire: Wire, mut n: u64) -> Scanned<()> {
        while n > 0 {
            self.skip_space()?;
            self.last = self.mark();
            loop {
                let rest = self.window.rest();
                let length = rest.iter().position(|&b| CLASS[b as usize] != 0);
                self.window.at += length.unwrap_or(rest.len());
                if length.is_some() || !self.window.refill()? {
                    break;
                }
            }
            n -= 1;
        }
        Ok(())
    }
}

fn integer_limits(scalar: Scalar) -> std::ops::RangeInclusive<i128> {
    let bits = 8 * scalar.bytes() as u32;
    match scalar {
        Scalar::I8 | Scalar::I16 | Scalar::I32 | Scalar::I64 => {
            -(1i128 << (bits - 1))..=(1i128 << (bits - 1)) - 1
        }
        _ => 0..=(1i128 << bits) - 1,
    }
}

/// A vertex id or a count; negative becomes `u64::MAX`.
#[inline(always)]
fn parse_index(token: &[u8]) -> Option<u64> {
    if token.len() <= 18 {
        let mut value = 0u64;
        let mut digits_only = true;
        for &b in token {
            let digit = b.wrapping_sub(b'0');
            digits_only &= digit < 10;
            value = value.wrapping_mul(10).wrapping_add(u64::from(digit));
        }
        if digits_only {
            return Some(value);
        }
    }
    let value = parse_integer(token)?;
    if value < 0 { Some(u64::MAX) } else { u64::try_from(value).ok() }
}

/// Whole numbers, also as some programs write them: `3.0`, `+3`, `3e0`.
fn parse_integer(token: &[u8]) -> Option<i128> {
    let text = std::str::from_utf8(token).ok()?;
    if let Ok(value) = text.parse::<i128>() {
        return Some(value);
    }
    let value = text.parse::<f64>().ok()?;
    // Beyond 2^53 a double does not say which whole number was meant.
    (value.fract() == 0.0 && value.abs() <= 9e15).then_some(value as i128)
}

/// Rounds a double that is the nearest to a decimal to the float that is the nearest to that decimal.
///
/// The two differ only where the double lies halfway between two floats: `None` then. For normal floats.
#[inline(always)]
fn float_of_nearest(value: f64) -> Option<f32> {
    // The 29 bits that a float does not have.
    (value.to_bits() & 0x1fff_ffff != 0x1000_0000).then_some(value as f32)
}

/// A number as `T`, bit for bit as the standard library reads it.
trait Decimal: std::str::FromStr + From<f32> {
    /// The number of a plain text; `None` where only the standard library knows.
    fn plain(token: &[u8]) -> Option<Self>;
}

impl Decimal for f32 {
    #[inline(always)]
    fn plain(token: &[u8]) -> Option<f32> {
        plain_decimal(token).and_then(float_of_nearest)
    }
}

impl Decimal for f64 {
    #[inline(always)]
    fn plain(token: &[u8]) -> Option<f64> {
        plain_decimal(token)
    }
}

/// Numbers as C and its libraries print them; the names that Windows gives to no-numbers count as NaN.
#[inline(always)]
fn parse_float<T: Decimal>(token: &[u8]) -> Option<T> {
    T::plain(token).or_else(|| parse_any_float(token))
}

#[cold]
fn parse_any_float<T: Decimal>(token: &[u8]) -> Option<T> {
    let text = std::str::from_utf8(token).ok()?;
    if let Ok(value) = text.parse::<T>() {
        return Some(value);
    }
    in_other_notation(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_as_programs_write_them() {
        assert_eq!(parse_index(b"12"), Some(12));
        assert_eq!(parse_index(b"-1"), Some(u64::MAX));
        assert_eq!(parse_index(b"+7"), Some(7));
        assert_eq!(parse_index(b"3.0"), Some(3));
        assert_eq!(parse_index(b"18446744073709551615"), Some(u64::MAX));
        for wrong in [&b"3.5"[..], b"x", b"", b"0x10", b"1e300", b"nan", b"--1"] {
            assert_eq!(parse_index(wrong).filter(|_| !wrong.is_empty()), None, "{wrong:?}");
        }
        assert_eq!(parse_float::<f32>(b"0.1"), Some(0.1));
        assert_eq!(parse_float::<f64>(b"-1.5e-3"), Some(-0.0015));
        assert!(parse_float::<f32>(b"-1.#IND00").is_some_and(f32::is_nan));
        assert!(parse_float::<f32>(b"-nan(ind)").is_some_and(f32::is_nan));
        assert_eq!(parse_float::<f32>(b"1,5"), None);
        assert_eq!(parse_float::<f32>(b"1.5D+03"), Some(1500.0));
        assert_eq!(parse_float::<f64>(b"-.5d-1"), Some(-0.05));
        for wrong in [&b"d3"[..], b"infd", b"1.5D", b"1D2D3"] {
            assert_eq!(parse_float::<f64>(wrong), None, "{wrong:?}");
        }
    }

    #[test]
    fn plain_decimals_are_those_of_the_standard_library() {
        let mut state = 7u64;
        let mut next = |n: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) % n
        };
        let check = |text: &str| {
            let bits = |x: Option<f32>| x.map(f32::to_bits);
            assert_eq!(bits(parse_float(text.as_bytes())), bits(text.parse().ok()), "{text}");
            let bits = |x: Option<f64>| x.map(f64::to_bits);
            assert_eq!(bits(parse_float(text.as_bytes())), bits(text.parse().ok()), "{text}");
        };
        for _ in 0..100_000 {
            let n_digits = next(18) as usize;
            let mut text: String =
                (0..n_digits).map(|_| char::from(b'0' + next(10) as u8)).collect();
            text.insert(next(n_digits as u64 + 1) as usize, '.');
            check(&text);
            check(&format!("-{text}"));
        }
        // Halves of steps between floats, and their neighbours in the last digit.
        for _ in 0..20_000 {
            let float = f32::from_bits(
                (next(1 << 30) as u32 % (1 << 23)) | ((120 + next(24) as u32) << 23),
            );
            let middle = (f64::from(float) + f64::from(f32::from_bits(float.to_bits() + 1))) / 2.0;
            check(&format!("{middle}"));
            (5..15).for_each(|places| check(&format!("{middle:.places$}")));
        }
        for text in
            ["0", "-0", ".", "-", "", "-.", "1.", ".5", "00012", "1.2.3", "123456789012345", "+1"]
        {
            check(text);
        }
    }

    #[test]
    fn tokens_keep_their_line_and_column_across_windows() {
        // 100,000 lines of "7\r\n" cross the window's edge at every phase of the pattern.
        let file = RawFile::from_bytes("t", b"7\r\n".repeat(300_000));
        let start = Mark { offset: 0, line: 1, line_start: 0 };
        let mut scan = AsciiScan::new(&file, start);
        let byte = Wire::Plain(Scalar::U8);
        for i in 0..300_000u64 {
            assert_eq!(scan.index(byte).ok(), Some(7));
            let expected = Mark { offset: 3 * i, line: i + 1, line_start: 3 * i };
            assert_eq!(scan.last(), expected);
        }
        assert!(matches!(scan.index(byte), Err(Fault::End)));
        let mut scan = AsciiScan::new(&file, start);
        assert!(scan.skip(byte, 299_999).is_ok());
        assert_eq!(scan.index(byte).ok(), Some(7));
        assert_eq!(scan.last().line, 300_000);
    }
}
