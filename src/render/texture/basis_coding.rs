//! Codings of blocks in KTX2 files, for builds that make such files and for those that do not.

/// Coding of blocks in KTX2 files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BasisCoding {
    /// A byte a texel, near the original; in a graphics card as in the file.
    Uastc,
    /// Some bits a texel, as coarse as a small JPEG.
    Etc1s,
}

impl BasisCoding {
    /// True if this build makes such files.
    pub const IS_MADE: bool = cfg!(feature = "ktx2");

    /// Bytes of memory for a texel of an image while its file is made.
    pub fn work_bytes(self) -> u64 {
        match self {
            BasisCoding::Uastc => 9,
            BasisCoding::Etc1s => 90,
        }
    }
}

/// Makes nothing: `BasisCoding::IS_MADE` is false.
#[cfg(not(feature = "ktx2"))]
pub fn ktx2_file(_: Vec<[u8; 4]>, _: u32, _: BasisCoding, _: bool) -> Result<Vec<u8>, String> {
    Err("this build makes no KTX2".to_owned())
}
