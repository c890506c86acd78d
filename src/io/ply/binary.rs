//! Binary bodies as streams of numbers.

use super::fields::wire_value;
use super::fixed_faces::wire_index;
use super::header::{Encoding, Wire};
use super::raw::RawFile;
use super::scan::{Fault, Mark, Scan, Scanned, Window};
use stonecut_mesh::property::{Scalar, write_scalar};

/// Reads packed numbers of either byte order.
pub struct BinaryScan<'a> {
    window: Window<'a>,
    swap: bool,
    last: u64,
}

impl<'a> BinaryScan<'a> {
    pub fn new(file: &'a RawFile, encoding: Encoding, mark: Mark) -> Self {
        let swap = encoding == Encoding::BinaryBigEndian;
        BinaryScan { window: Window::new(file, mark.offset), swap, last: mark.offset }
    }

    /// The bytes of one number, least significant first, in the lower places.
    #[inline(always)]
    fn raw(&mut self, wire: Wire) -> Scanned<[u8; 8]> {
        self.last = self.window.offset();
        let mut little = [0u8; 8];
        match wire.bytes() {
            1 => little[..1].copy_from_slice(&self.window.take::<1>()?),
            2 => little[..2].copy_from_slice(&ordered(self.window.take::<2>()?, self.swap)),
            4 => little[..4].copy_from_slice(&ordered(self.window.take::<4>()?, self.swap)),
            _ => little = ordered(self.window.take::<8>()?, self.swap),
        }
        Ok(little)
    }
}

#[inline(always)]
fn ordered<const N: usize>(mut bytes: [u8; N], swap: bool) -> [u8; N] {
    if swap {
        bytes.reverse();
    }
    bytes
}

impl Scan for BinaryScan<'_> {
    fn mark(&self) -> Mark {
        Mark { offset: self.window.offset(), ..Mark::default() }
    }

    fn last(&self) -> Mark {
        Mark { offset: self.last, ..Mark::default() }
    }

    #[inline(always)]
    fn index(&mut self, wire: Wire) -> Scanned<u64> {
        let raw = self.raw(wire)?;
        Ok(wire_index(wire, &raw, false))
    }

    #[inline(always)]
    fn store(&mut self, wire: Wire, scalar: Scalar, target: &mut [u8]) -> Scanned<()> {
        let raw = self.raw(wire)?;
        if wire == Wire::Plain(scalar) {
            let n = scalar.bytes();
            target[..n].copy_from_slice(&raw[..n]);
        } else {
            write_scalar(scalar, target, 0, wire_value(wire, &raw, false));
        }
        Ok(())
    }

    #[inline(always)]
    fn skip(&mut self, wire: Wire, n: u64) -> Scanned<()> {
        self.last = self.window.offset();
        self.window.skip(n.checked_mul(wire.bytes()).ok_or(Fault::End)?)
    }
}
