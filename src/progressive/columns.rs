//! Columns of bytes: numbers of one kind together, each byte of them in its own column, each column compressed.

use stonecut_system::error::Result;

/// Strong enough: higher levels gain below 1 % on columns of small differences, and cost twice the time.
const LEVEL: i32 = 9;

/// No column of a block is longer, compressed or not: what a reader allocates for a block of unknown origin.
pub(super) const MOST_BYTES: usize = 64 << 20;

/// Puts small numbers of either sign into small ones without.
pub(super) fn zigzag(x: u64, bits: u32) -> u64 {
    let sign = x >> (bits - 1) & 1;
    let mask = u64::MAX >> (64 - bits);
    (x << 1 ^ (0u64.wrapping_sub(sign))) & mask
}

/// The inverse of `zigzag`, for numbers of `bits` bits.
pub(super) fn unzigzag(x: u64, bits: u32) -> u64 {
    let mask = u64::MAX >> (64 - bits);
    (x >> 1 ^ 0u64.wrapping_sub(x & 1)) & mask
}

/// Difference of two numbers of 32 bits, small ones for near numbers.
pub(super) fn apart(x: u32, from: u32) -> u32 {
    zigzag(u64::from(x.wrapping_sub(from)), 32) as u32
}

/// The inverse of `apart`.
pub(super) fn beside(difference: u32, from: u32) -> u32 {
    from.wrapping_add(unzigzag(u64::from(difference), 32) as u32)
}

/// Bytes of numbers of the same width, one column a byte.
#[derive(Default)]
pub(super) struct Planes(Vec<Vec<u8>>);

impl Planes {
    pub(super) fn new(width: usize) -> Planes {
        Planes(vec![Vec::new(); width])
    }

    /// Appends the low bytes of a number.
    pub(super) fn push(&mut self, x: u64) {
        for (plane, byte) in self.0.iter_mut().zip(x.to_le_bytes()) {
            plane.push(byte);
        }
    }

    /// Number `i`.
    pub(super) fn get(&self, i: usize) -> u64 {
        let bytes = self.0.iter().enumerate();
        bytes.fold(0, |x, (k, plane)| x | u64::from(plane[i]) << (8 * k))
    }

    /// Appends a number's bytes as they are.
    pub(super) fn push_bytes(&mut self, bytes: &[u8]) {
        for (plane, &byte) in self.0.iter_mut().zip(bytes) {
            plane.push(byte);
        }
    }

    /// Copies bytes of number `i`, from its byte `first` on.
    pub(super) fn get_bytes(&self, i: usize, first: usize, out: &mut [u8]) {
        for (byte, plane) in out.iter_mut().zip(&self.0[first..]) {
            *byte = plane[i];
        }
    }

    pub(super) fn write(&self, out: &mut Vec<u8>) {
        self.0.iter().for_each(|plane| write(plane, out));
    }

    /// The same without the lowest `skipped` bytes.
    pub(super) fn write_from(&self, skipped: usize, out: &mut Vec<u8>) {
        self.0.iter().skip(skipped).for_each(|plane| write(plane, out));
    }

    /// Reads `n` numbers of `width` bytes whose lowest `skipped` bytes were left out and are 0.
    pub(super) fn read_from(
        input: &mut &[u8],
        n: usize,
        skipped: usize,
        width: usize,
    ) -> Result<Planes, String> {
        let mut planes: Vec<Vec<u8>> = (0..skipped).map(|_| vec![0; n]).collect();
        for _ in skipped..width {
            planes.push(read_exactly(input, n)?);
        }
        Ok(Planes(planes))
    }

    /// Reads `n` numbers of `width` bytes.
    pub(super) fn read(input: &mut &[u8], n: usize, width: usize) -> Result<Planes, String> {
        (0..width).map(|_| read_exactly(input, n)).collect::<Result<_, _>>().map(Planes)
    }
}

/// Appends a column: its length, the bytes it takes and those bytes; none for zeros.
pub(super) fn write(column: &[u8], out: &mut Vec<u8>) {
    let packed = zstd::bulk::compress(column, LEVEL).unwrap_or_default();
    let is_smaller = !packed.is_empty() && packed.len() < column.len();
    let bytes = match is_smaller {
        _ if column.iter().all(|&byte| byte == 0) => &[],
        true => &packed[..],
        false => column,
    };
    out.extend((column.len() as u32).to_le_bytes());
    out.extend((bytes.len() as u32).to_le_bytes());
    out.extend_from_slice(bytes);
}

fn number(input: &mut &[u8]) -> Result<usize, String> {
    let (bytes, rest) = input.split_first_chunk::<4>().ok_or("a column is missing")?;
    *input = rest;
    Ok(u32::from_le_bytes(*bytes) as usize)
}

/// Reads a column of any length up to `MOST_BYTES`.
pub(super) fn read(input: &mut &[u8]) -> Result<Vec<u8>, String> {
    let (length, packed) = (number(input)?, number(input)?);
    if length > MOST_BYTES || packed > length {
        return Err(format!("a column of {length} bytes in {packed} cannot be"));
    }
    let (bytes, rest) = input.split_at_checked(packed).ok_or("a column ends early")?;
    *input = rest;
    if packed == length {
        return Ok(bytes.to_vec());
    }
    if packed == 0 {
        return Ok(vec![0; length]);
    }
    let column = zstd::bulk::decompress(bytes, length).map_err(|e| format!("a column: {e}"))?;
    match column.len() == length {
        true => Ok(column),
        false => Err(format!("a column has {} bytes, not {length}", column.len())),
    }
}

fn read_exactly(input: &mut &[u8], length: usize) -> Result<Vec<u8>, String> {
    let column = read(input)?;
    match column.len() == length {
        true => Ok(column),
        false => Err(format!("a column has {} numbers, not {length}", column.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_come_back() {
        for (x, from) in [(0, 0), (7, 9), (u32::MAX, 0), (0, u32::MAX), (1 << 31, 5)] {
            assert_eq!(beside(apart(x, from), from), x);
        }
        assert_eq!([apart(8, 9), apart(10, 9)], [1, 2]);
        for bits in [8, 16, 32, 64] {
            for x in [0u64, 1, 127, u64::MAX >> (64 - bits)] {
                assert_eq!(unzigzag(zigzag(x, bits), bits), x, "{bits}");
            }
        }
    }

    #[test]
    fn columns_come_back_and_damaged_ones_are_refused() {
        let mut planes = Planes::new(3);
        (0..1000u64).for_each(|x| planes.push(x * 77));
        let mut out = Vec::new();
        planes.write(&mut out);
        let found = Planes::read(&mut &out[..], 1000, 3).unwrap();
        assert!((0..1000).all(|i| found.get(i) == i as u64 * 77));
        for cut in [0, 5, 9, out.len() - 1] {
            assert!(Planes::read(&mut &out[..cut], 1000, 3).is_err(), "{cut}");
        }
        assert!(Planes::read(&mut &out[..], 999, 3).is_err());
    }
}
