//! Pages: texels in memory, or in a file without a name, while they are filled, images when they are done.
//!
//! Colours grow beyond the borders of charts, so that neither filtering nor smaller sizes of an image mix what lies
//! between charts into them; what is then left has the mean colour of the page. Rows go through memory in bands.

use super::growth::{EMPTY, grow};
use super::page_kind::{Page, PageKind};
use super::settings::{Means, PADDING};
use std::cell::RefCell;
use std::io::{BufWriter, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use stonecut_render::texture::{BasisCoding, ktx2_file};
use stonecut_system::disk::{Disk, DiskFile, ScatteredFile};
use stonecut_system::error::{Error, Result};
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;

/// Bytes of a texel.
const BYTES: usize = 4;

/// Rows that are made at a time.
const BAND_ROWS: u32 = 128;

/// Steps by which colours grow: one more than the charts are apart from the middle between them.
const GROWTH: u32 = PADDING + 1;

/// Bytes of an image that are written together.
const OUT_BYTES: usize = 1 << 18;
/// Quality of JPEG pages, of 100.
const JPEG_QUALITY: u8 = 90;

/// A finished texel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Texel {
    pub row: u32,
    pub column: u32,
    pub pixel: [u8; 4],
}

/// Place of the texels of pages.
enum Store {
    Memory(Vec<u8>),
    File(ScatteredFile),
}

/// Pages while they are filled.
pub(super) struct Canvas {
    store: Store,
    folder: PathBuf,
    sizes: Vec<[u32; 2]>,
    /// Place of each page in the file.
    starts: Vec<u64>,
    /// For each page whether a texel lets light through.
    has_alpha: Vec<bool>,
    /// Holds the bytes of the file.
    account: Disk,
}

impl Canvas {
    /// Empty pages of given width and height. Memory, if that is not beyond `most_bytes`, otherwise disk: 4 bytes a texel, taken
    /// as they are filled.
    pub fn new(sizes: &[[u32; 2]], folder: &Path, disk: &Disk, most_bytes: u64) -> Result<Canvas> {
        let fail = |e| Error::io(folder, "cannot write temporary data", e);
        let (mut starts, mut end) = (Vec::new(), 0);
        for [width, height] in sizes {
            starts.push(end);
            end += BYTES as u64 * u64::from(*width) * u64::from(*height);
        }
        let store = if end <= most_bytes {
            Store::Memory(vec![0; end as usize])
        } else {
            Store::File(ScatteredFile::new(folder, end).map_err(fail)?)
        };
        let folder = folder.to_path_buf();
        let (sizes, account) = (sizes.to_vec(), disk.part());
        let has_alpha = vec![false; sizes.len()];
        Ok(Canvas { store, folder, sizes, starts, has_alpha, account })
    }

    /// Accounts for the disk that the pages take, once they are filled.
    pub fn count(&self) {
        use std::os::unix::fs::MetadataExt;
        if let Store::File(file) = &self.store {
            self.account.adopt(file.metadata().map_or(0, |meta| meta.blocks() * 512));
        }
    }

    /// True if a texel of a page lets light through.
    pub fn has_alpha(&self, page: usize) -> bool {
        self.has_alpha[page]
    }

    /// The kind of a page where `kind` is wanted: JPEG has no opacity.
    pub fn kind_of(&self, page: usize, kind: PageKind) -> PageKind {
        if kind == PageKind::Jpeg && self.has_alpha[page] { PageKind::Png } else { kind }
    }

    /// Writes texels of a page, given row by row.
    pub fn put(&mut self, page: u32, texels: &[Texel]) -> Result<()> {
        let (start, width) = (self.starts[page as usize], self.sizes[page as usize][0]);
        let follows = |a: &Texel, b: &Texel| a.row == b.row && a.column + 1 == b.column;
        let mut bytes = Vec::new();
        for run in texels.chunk_by(follows) {
            bytes.clear();
            for texel in run {
                self.has_alpha[page as usize] |= texel.pixel[3] < 255;
                // The colour of what cannot be seen tells it from what no chart covers.
                let pixel = if texel.pixel[3] == 0 { [0, 0, 1, 0] } else { texel.pixel };
                bytes.extend_from_slice(&pixel);
            }
            let at = u64::from(run[0].row) * u64::from(width) + u64::from(run[0].column);
            let at = start + BYTES as u64 * at;
            match &mut self.store {
                Store::Memory(all) => all[at as usize..][..bytes.len()].copy_from_slice(&bytes),
                Store::File(file) => file
                    .write_all_at(&bytes, at)
                    .map_err(|e| Error::io(&self.folder, "cannot write temporary data", e))?,
            }
        }
        Ok(())
    }

    /// Makes images of all pages, durably, once for each of the `kinds` with the names of their files; returns them and the
    /// number of texels that charts cover.
    ///
    /// What lies far from all charts has the colour `rest`, or the mean. Memory: 160 rows of a page a thread.
    pub fn finish(
        self,
        kinds: &[(PageKind, String)],
        rest: Option<[u8; 4]>,
        place: &Path,
        means: Means,
    ) -> Result<(Vec<Vec<Page>>, u64)> {
        let (mut all, mut files, mut n_covered) = (Vec::new(), Vec::new(), 0);
        for (kind, name) in kinds {
            let mut pages = Vec::new();
            n_covered = 0;
            self.write((*kind, rest), (place, name), means, |page, file, covered| {
                pages.push(page);
                files.push(file);
                n_covered += covered;
            })?;
            all.push(pages);
        }
        // Texels that are still on their way to the disk would go there with the images: a sync waits for them.
        drop(self);
        files.iter_mut().try_for_each(DiskFile::sync)?;
        Ok((all, n_covered))
    }

    fn write(
        &self,
        (kind, rest): (PageKind, Option<[u8; 4]>),
        (place, name): (&Path, &str),
        means: Means,
        mut put: impl FnMut(Page, DiskFile, u64),
    ) -> Result<()> {
        let canvas = self;
        in_order(
            self.sizes.len() as u64,
            means.threads,
            means.progress,
            |number, out: &mut Option<(Page, DiskFile, u64)>| {
                let number = number as usize;
                let kind = canvas.kind_of(number, kind);
                let [width, height] = canvas.sizes[number];
                let path = place.join(format!("{name}-page-{number}.part"));
                let (mean, covered) = canvas.mean(number)?;
                let mean = rest.unwrap_or(mean);
                let rows = Rows { canvas, page: number, mean, progress: Some(means.progress) };
                let file = rows.write(kind, &path, means.disk)?;
                let bytes = file.length();
                *out = Some((Page { path, kind, width, height, bytes }, file, covered));
                Ok(())
            },
            |_, page| {
                if let Some((page, file, covered)) = page.take() {
                    put(page, file, covered);
                }
                Ok(())
            },
        )
    }

    /// The image of a page as a file in memory of the kind of the page, packed quickly, and the number of texels that charts cover.
    pub fn image(&self, page: usize, kind: PageKind) -> Result<(Vec<u8>, u64)> {
        let (mean, n_covered) = self.mean(page)?;
        let mut out = Vec::new();
        let kind = self.kind_of(page, kind);
        Rows { canvas: self, page, mean, progress: None }.encode(kind, &mut out)?;
        Ok((out, n_covered))
    }

    /// The mean of a page's texels, opaque, and their number.
    fn mean(&self, page: usize) -> Result<([u8; 4], u64)> {
        let (mut sums, mut n) = ([0u64; 4], 0);
        for first in (0..self.sizes[page][1]).step_by(BAND_ROWS as usize) {
            for pixel in self.read(page, first, first + BAND_ROWS)? {
                if pixel != EMPTY {
                    let weight = u64::from(pixel[3]);
                    (0..3).for_each(|k| sums[k] += weight * u64::from(pixel[k]));
                    sums[3] += weight;
                    n += 1;
                }
            }
        }
        let mean = |k: usize| (sums[k] / sums[3].max(1)) as u8;
        Ok(([mean(0), mean(1), mean(2), 255], n))
    }

    /// Rows of a page, as far as there are such.
    fn read(&self, page: usize, first: u32, end: u32) -> Result<Vec<[u8; 4]>> {
        let [width, height] = self.sizes[page];
        let end = end.min(height);
        let mut pixels = vec![EMPTY; width as usize * (end - first) as usize];
        let at = self.starts[page] + BYTES as u64 * u64::from(width) * u64::from(first);
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut pixels);
        match &self.store {
            Store::Memory(all) => bytes.copy_from_slice(&all[at as usize..][..bytes.len()]),
            Store::File(file) => file
                .read_exact_at(bytes, at)
                .map_err(|e| Error::reading(&self.folder, "cannot read temporary data", e))?,
        }
        Ok(pixels)
    }
}

/// The rows of a finished page.
struct Rows<'a> {
    canvas: &'a Canvas,
    page: usize,
    /// Colour of what is far from all charts.
    mean: [u8; 4],
    /// Counts the texels of bands; pages without it are those of tiles, whose PNG is packed quickly.
    progress: Option<&'a Progress>,
}

impl Rows<'_> {
    fn size(&self) -> [u32; 2] {
        self.canvas.sizes[self.page]
    }

    /// Rows `first..first + BAND_ROWS`, as far as there are such, with colours beyond the borders of charts.
    fn band(&self, first: u32) -> Result<Vec<[u8; 4]>> {
        let width = self.size()[0] as usize;
        if let Some(progress) = self.progress {
            progress.check()?;
        }
        let above = first.min(GROWTH);
        let mut pixels = self.canvas.read(self.page, first - above, first + BAND_ROWS + GROWTH)?;
        grow(&mut pixels, width, GROWTH);
        let n = (self.size()[1] - first).min(BAND_ROWS) as usize * width;
        pixels.drain(..above as usize * width);
        pixels.truncate(n);
        for pixel in &mut pixels {
            if *pixel == EMPTY {
                *pixel = self.mean;
            } else if pixel[3] == 0 {
                *pixel = [self.mean[0], self.mean[1], self.mean[2], 0];
            }
        }
        if let Some(progress) = self.progress {
            progress.add(pixels.len() as u64);
        }
        Ok(pixels)
    }

    fn write(&self, kind: PageKind, path: &Path, disk: &Disk) -> Result<DiskFile> {
        // The encoder of JPEG writes some bytes at a time.
        let out = Out { file: disk.create(path)?, failed: None };
        let mut out = BufWriter::with_capacity(OUT_BYTES, out);
        let result = self.encode(kind, &mut out);
        let result = result.and_then(|()| out.flush().map_err(|error| not_encoded(&error)));
        out.into_parts().0.finish(result)
    }

    fn encode(&self, kind: PageKind, out: impl Write) -> Result<()> {
        match kind {
            PageKind::Jpeg | PageKind::JpegNumbers(_) => self.encode_jpeg(out, kind),
            PageKind::Png | PageKind::Numbers(_) => self.encode_png(out, kind),
            _ => self.encode_ktx2(out, kind),
        }
    }

    fn encode_ktx2(&self, mut out: impl Write, kind: PageKind) -> Result<()> {
        let [width, height] = self.size();
        let mut pixels = Vec::with_capacity((width * height) as usize);
        for first in (0..height).step_by(BAND_ROWS as usize) {
            pixels.extend(self.band(first)?);
        }
        let coding = if kind == PageKind::Etc1s { BasisCoding::Etc1s } else { BasisCoding::Uastc };
        let file = ktx2_file(pixels, width, coding, kind != PageKind::UastcNumbers)
            .map_err(std::io::Error::other);
        file.and_then(|file| out.write_all(&file)).map_err(|error| not_encoded(&error))
    }

    fn encode_png(&self, out: impl Write, kind: PageKind) -> Result<()> {
        let ([width, height], has_alpha) = (self.size(), self.canvas.has_alpha[self.page]);
        let result = (|| {
            let mut encoder = png::Encoder::new(out, width, height);
            let channel = kind.channel();
            encoder.set_color(match (channel, has_alpha) {
                (Some(_), _) => png::ColorType::Grayscale,
                (None, true) => png::ColorType::Rgba,
                (None, false) => png::ColorType::Rgb,
            });
            encoder.set_depth(png::BitDepth::Eight);
            self.progress.is_none().then(|| encoder.set_compression(png::Compression::Fast));
            if kind == PageKind::Png {
                encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
            }
            let mut writer = encoder.write_header()?;
            let mut stream = writer.stream_writer()?;
            for first in (0..height).step_by(BAND_ROWS as usize) {
                let band = self.band(first).map_err(std::io::Error::other)?;
                match (channel, has_alpha) {
                    (Some(k), _) => {
                        let grey: Vec<u8> = band.iter().map(|pixel| pixel[k]).collect();
                        stream.write_all(&grey)?;
                    }
                    (None, true) => stream.write_all(bytemuck::cast_slice(&band))?,
                    (None, false) => {
                        let rgb: Vec<u8> = band.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
                        stream.write_all(&rgb)?;
                    }
                }
            }
            stream.finish()
        })();
        result.map_err(|error: png::EncodingError| not_encoded(&error))
    }

    fn encode_jpeg(&self, out: impl Write, kind: PageKind) -> Result<()> {
        let image = JpegRows { rows: self, channel: kind.channel(), held: RefCell::default() };
        let mut encoder = jpeg_encoder::Encoder::new(out, JPEG_QUALITY);
        encoder.set_sampling_factor(match kind {
            // Half the colours, as photographs have them.
            PageKind::Jpeg => jpeg_encoder::SamplingFactor::F_2_2,
            _ => jpeg_encoder::SamplingFactor::F_1_1,
        });
        let result = encoder.encode_image(&image);
        match image.held.take().failed {
            Some(error) => Err(error),
            None => result.map_err(|error| not_encoded(&error)),
        }
    }
}

fn not_encoded(error: &dyn std::error::Error) -> Error {
    Error::Internal(format!("cannot encode a page: {error}"))
}

/// A file that an encoder writes to, and the first error of the disk.
struct Out {
    file: DiskFile,
    failed: Option<Error>,
}

impl Write for Out {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if let Err(error) = self.file.append(bytes) {
            let words = error.to_string();
            self.failed.get_or_insert(error);
            return Err(std::io::Error::other(words));
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Out {
    fn finish(mut self, result: Result<()>) -> Result<DiskFile> {
        match self.failed.take() {
            Some(error) => Err(error),
            None => result.map(|()| self.file),
        }
    }
}

/// Rows for the encoder of JPEG, which takes them one by one.
struct JpegRows<'a> {
    rows: &'a Rows<'a>,
    /// The only channel that counts.
    channel: Option<usize>,
    held: RefCell<HeldBand>,
}

#[derive(Default)]
struct HeldBand {
    first: Option<u32>,
    pixels: Vec<[u8; 4]>,
    failed: Option<Error>,
}

impl jpeg_encoder::ImageBuffer for &JpegRows<'_> {
    fn get_jpeg_color_type(&self) -> jpeg_encoder::JpegColorType {
        match self.channel {
            Some(_) => jpeg_encoder::JpegColorType::Luma,
            None => jpeg_encoder::JpegColorType::Ycbcr,
        }
    }

    fn width(&self) -> u16 {
        self.rows.size()[0] as u16
    }

    fn height(&self) -> u16 {
        self.rows.size()[1] as u16
    }

    fn fill_buffers(&self, y: u16, buffers: &mut [Vec<u8>; 4]) {
        let mut held = self.held.borrow_mut();
        let first = u32::from(y) / BAND_ROWS * BAND_ROWS;
        let width = self.rows.size()[0] as usize;
        if held.first != Some(first) && held.failed.is_none() {
            match self.rows.band(first) {
                Ok(pixels) => (held.first, held.pixels) = (Some(first), pixels),
                Err(error) => held.failed = Some(error),
            }
        }
        let from = (u32::from(y) - first) as usize * width;
        if held.failed.is_some() {
            held.pixels.resize(from + width, EMPTY);
        }
        let row = &held.pixels[from..from + width];
        if let Some(k) = self.channel {
            buffers[0].extend(row.iter().map(|pixel| pixel[k]));
            return;
        }
        // One after the other: each is many pixels at once for the compiler.
        let values = |&[r, g, b, _]: &[u8; 4]| jpeg_encoder::rgb_to_ycbcr(r, g, b);
        buffers[0].extend(row.iter().map(|pixel| values(pixel).0));
        buffers[1].extend(row.iter().map(|pixel| values(pixel).1));
        buffers[2].extend(row.iter().map(|pixel| values(pixel).2));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_do_not_show() {
        let folder = tempfile::tempdir().unwrap();
        let size = [40, 200];
        let disk = Disk::default();
        let canvas =
            |bytes: u64| Canvas::new(&[[8, 8], size], folder.path(), &disk, bytes).unwrap();
        let (mut canvas, mut on_disk) = (canvas(1 << 20), canvas(0));
        let mut texels = Vec::new();
        for row in (5..190).step_by(17) {
            for column in 10..20 {
                texels.push(Texel { row, column, pixel: [row as u8, column as u8, 7, 255] });
            }
        }
        canvas.put(1, &texels).unwrap();
        on_disk.put(1, &texels).unwrap();
        assert_eq!(canvas.read(1, 0, 200).unwrap(), on_disk.read(1, 0, 200).unwrap());
        let (mean, n) = canvas.mean(1).unwrap();
        assert_eq!(n, texels.len() as u64);
        let rows = Rows { canvas: &canvas, page: 1, mean, progress: None };
        let bands = (0..200).step_by(BAND_ROWS as usize);
        let pixels: Vec<_> = bands.flat_map(|first| rows.band(first).unwrap()).collect();
        let mut whole = canvas.read(1, 0, 200).unwrap();
        grow(&mut whole, 40, GROWTH);
        whole.iter_mut().filter(|pixel| **pixel == EMPTY).for_each(|pixel| *pixel = mean);
        assert_eq!(pixels, whole);
    }
}
