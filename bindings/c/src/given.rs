//! Arguments of C callers, checked: structures with their sizes, arrays with their numbers of elements, texts.
//!
//! Everything that is wrong is named as the caller wrote it: `mesh->positions`, `options->words`.

use crate::errors::text;
use std::ffi::{CStr, OsString, c_char, c_int, c_void};
use std::os::unix::ffi::OsStringExt;
use stonecut::mesh::property::{Property, Scalar};
use stonecut::pipeline::in_memory::attributes::{Attributes, Column};
use stonecut::pipeline::in_memory::{Input, given};
use stonecut::{Error, Moment, Result};

/// Sizes beyond this are not sizes of structures.
const LARGEST_STRUCTURE: usize = 4096;
/// More numbers of a vertex in one attribute, words, or attributes than that are a mistake.
const MOST: usize = 65_536;

/// `stonecut_attribute`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Attribute {
    /// Its name.
    pub name: *const c_char,
    /// Numbers of the first vertex.
    pub values: *const c_void,
    /// Bytes from one vertex to the next; 0: packed.
    pub stride: usize,
    /// Type of the numbers.
    pub scalar: u32,
    /// Numbers of a vertex.
    pub width: u32,
}

/// `stonecut_mesh`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)] // The header says it.
pub struct Mesh {
    pub size: usize,
    pub n_vertices: usize,
    pub positions: *const c_void,
    pub position_stride: usize,
    pub position_type: u32,
    pub reserved: u32,
    pub n_triangles: usize,
    pub triangles: *const u32,
    pub labels: *const u32,
    pub n_attributes: usize,
    pub attributes: *const Attribute,
    pub source: *const u32,
}

/// `stonecut_progress`.
#[repr(C)]
#[derive(Debug)]
#[allow(missing_docs)] // The header says it.
pub struct Progress {
    pub stage: *const c_char,
    pub number: u32,
    pub stages: u32,
    pub fraction: f64,
    pub seconds: f64,
    pub seconds_left: f64,
    pub memory_bytes: u64,
}

/// `stonecut_progress_function`.
pub type ProgressFunction = Option<unsafe extern "C" fn(*const Progress, *mut c_void) -> c_int>;

/// `stonecut_options`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)] // The header says it.
pub struct RawOptions {
    pub size: usize,
    pub triangles: u64,
    pub ratio: f64,
    pub memory_bytes: u64,
    pub threads: usize,
    pub samples: u64,
    pub words: *const *const c_char,
    pub n_words: usize,
    pub progress: ProgressFunction,
    pub user: *mut c_void,
}

/// Refuses a null pointer.
pub fn required<T>(name: &str, pointer: *const T) -> Result<()> {
    if pointer.is_null() { Err(Error::Usage(format!("{name} is null"))) } else { Ok(()) }
}

/// Reads a structure; of a newer version what this one does not have must be 0.
///
/// # Safety
///
/// `given` is null or points to as many bytes as its first member says.
unsafe fn sized<T: Copy>(name: &str, given: *const T) -> Result<T> {
    required(name, given)?;
    // SAFETY: every version begins with its size.
    let size = unsafe { given.cast::<usize>().read_unaligned() };
    let known = size_of::<T>();
    // There is one version so far.
    if !(known..=LARGEST_STRUCTURE).contains(&size) {
        let what = format!(
            "{name}->size is {size}, not {known}: call stonecut_init(&{name}, sizeof {name}) first"
        );
        return Err(Error::Usage(what));
    }
    // SAFETY: the caller says that there are `size` bytes, and every bit pattern of `T` is one: numbers and raw pointers.
    let (read, rest) = unsafe {
        let rest = std::slice::from_raw_parts(given.cast::<u8>().add(known), size - known);
        (given.read_unaligned(), rest)
    };
    if rest.iter().any(|&byte| byte != 0) {
        let what = format!(
            "{name} has members that this library ({}) does not have: it is older than the header",
            env!("CARGO_PKG_VERSION")
        );
        return Err(Error::Usage(what));
    }
    Ok(read)
}

/// An array of `n` elements, of which there may be none; checks that it is there and aligned.
///
/// # Safety
///
/// `array` is null or has `n` elements that nothing changes as long as the slice lives.
unsafe fn array<'a, T>(name: &str, array: *const T, n: usize) -> Result<&'a [T]> {
    if n == 0 {
        return Ok(&[]);
    }
    required(name, array)?;
    if !array.is_aligned() {
        return Err(Error::Usage(format!("{name} is not aligned to {} bytes", align_of::<T>())));
    }
    if n.checked_mul(size_of::<T>()).is_none_or(|bytes| bytes > isize::MAX as usize) {
        return Err(Error::Usage(format!("{name}: {n} elements are more than memory can hold")));
    }
    // SAFETY: it is neither null nor beyond the address space, and the caller says that the elements are there.
    Ok(unsafe { std::slice::from_raw_parts(array, n) })
}

/// The bytes of `n` rows of `row_bytes` that are `stride` apart.
///
/// # Safety
///
/// As of `array`.
unsafe fn rows<'a>(
    name: &str,
    first: *const c_void,
    (n, row_bytes, stride): (usize, usize, usize),
) -> Result<&'a [u8]> {
    if stride < row_bytes {
        let what =
            format!("{name}: a stride of {stride} bytes is less than the {row_bytes} of a row");
        return Err(Error::Usage(what));
    }
    let all = n.checked_sub(1).map_or(Some(0), |last| {
        last.checked_mul(stride).and_then(|bytes| bytes.checked_add(row_bytes))
    });
    let Some(all) = all else {
        let what = format!("{name}: {n} rows of {stride} bytes are more than memory can hold");
        return Err(Error::Usage(what));
    };
    // SAFETY: the caller keeps the contract.
    unsafe { array(name, first.cast(), all) }
}

/// Texts that end with a zero, as words of the command line.
///
/// # Safety
///
/// `list` is null or has `n` pointers, each null or to a text that ends with a zero.
pub unsafe fn texts(name: &str, list: *const *const c_char, n: usize) -> Result<Vec<OsString>> {
    if n > MOST {
        return Err(Error::Usage(format!("{name}: {n} are too many")));
    }
    // SAFETY: the caller keeps the contract.
    let list = unsafe { array(name, list, n) }?;
    let word = |(i, &text): (usize, &*const c_char)| {
        required(&format!("{name}[{i}]"), text)?;
        // SAFETY: it is not null, and the caller says that it ends with a zero.
        Ok(OsString::from_vec(unsafe { CStr::from_ptr(text) }.to_bytes().to_vec()))
    };
    list.iter().enumerate().map(word).collect()
}

/// The caller's function and what it gets.
#[derive(Clone, Copy, Debug)]
pub struct Watch {
    function: ProgressFunction,
    user: *mut c_void,
}

impl Watch {
    /// Calls the function; true if it wants the call to stop.
    pub fn wants_to_stop(&self, moment: &Moment) -> bool {
        let Some(function) = self.function else { return false };
        let stage = text(moment.stage);
        let progress = Progress {
            stage: stage.as_ptr(),
            number: moment.number,
            stages: moment.stages,
            fraction: moment.fraction,
            seconds: moment.seconds,
            seconds_left: moment.seconds_left,
            memory_bytes: moment.memory_bytes,
        };
        // SAFETY: the function is the caller's, and this is the thread of the call.
        unsafe { function(&raw const progress, self.user) != 0 }
    }
}

/// Options of a call.
#[derive(Debug)]
pub struct Options {
    /// Points on each surface; 0: the default.
    pub samples: u64,
    /// Threads; 0: the default.
    pub threads: usize,
    words: Vec<OsString>,
    watch: Watch,
}

impl Options {
    /// Reads them; all defaults without.
    ///
    /// # Safety
    ///
    /// `options` is null or points to what the header says.
    pub unsafe fn read(options: *const RawOptions) -> Result<Options> {
        let none = Watch { function: None, user: std::ptr::null_mut() };
        if options.is_null() {
            return Ok(Options { samples: 0, threads: 0, words: Vec::new(), watch: none });
        }
        // SAFETY: the caller keeps the contract.
        let raw = unsafe { sized("options", options) }?;
        let mut words: Vec<OsString> = Vec::new();
        for (option, value) in
            [("triangles", raw.triangles), ("memory", raw.memory_bytes), ("samples", raw.samples)]
        {
            if value != 0 {
                words.push(format!("--{option}={value}").into());
            }
        }
        if raw.threads != 0 {
            words.push(format!("--threads={}", raw.threads).into());
        }
        if raw.ratio != 0.0 {
            words.push(format!("--ratio={}", raw.ratio).into());
        }
        // SAFETY: as above.
        words.extend(unsafe { texts("options->words", raw.words, raw.n_words) }?);
        let watch = Watch { function: raw.progress, user: raw.user };
        Ok(Options { samples: raw.samples, threads: raw.threads, words, watch })
    }

    /// All of them as words of the command line.
    pub fn words(&self) -> Vec<OsString> {
        self.words.clone()
    }

    /// The caller's function.
    pub fn watch(&self) -> Watch {
        self.watch
    }
}

/// A mesh that C gives, with sizes and pointers checked.
#[derive(Debug)]
pub struct GivenMesh<'a> {
    name: &'static str,
    positions: &'a [u8],
    n_vertices: usize,
    stride: usize,
    /// True of single precision.
    pub is_single: bool,
    triangles: &'a [u32],
    labels: &'a [u32],
    /// Attributes of the vertices.
    pub attributes: Vec<GivenAttribute<'a>>,
}

/// An attribute that C gives.
#[derive(Debug)]
pub struct GivenAttribute<'a> {
    /// Its name.
    pub name: &'a CStr,
    /// Type of its numbers.
    pub scalar: Scalar,
    /// The type as the header has it.
    pub code: u32,
    /// Names of its columns as in a PLY file.
    pub columns: Vec<String>,
    bytes: &'a [u8],
    stride: usize,
}

impl<'a> GivenMesh<'a> {
    /// Checks what is given, without a look at the numbers.
    ///
    /// # Safety
    ///
    /// `mesh` is null or points to what the header says, which nothing changes as long as this lives.
    pub unsafe fn new(name: &'static str, mesh: *const Mesh) -> Result<GivenMesh<'a>> {
        // SAFETY: the caller keeps the contract.
        let mesh = unsafe { sized(name, mesh) }?;
        let Mesh { n_vertices, n_triangles, n_attributes, .. } = mesh;
        let member = |member: &str| format!("{name}->{member}");
        let is_single = match scalar(mesh.position_type) {
            Some(Scalar::F32) => true,
            Some(Scalar::F64) => false,
            _ => {
                let what = format!(
                    "{} is {}, not STONECUT_F32 or STONECUT_F64",
                    member("position_type"),
                    mesh.position_type
                );
                return Err(Error::Usage(what));
            }
        };
        if mesh.reserved != 0 {
            return Err(Error::Usage(format!("{} is not 0", member("reserved"))));
        }
        if n_attributes > MOST {
            return Err(Error::Usage(format!("{} is {n_attributes}", member("n_attributes"))));
        }
        let row_bytes = if is_single { 12 } else { 24 };
        let stride = if mesh.position_stride == 0 { row_bytes } else { mesh.position_stride };
        let n_corners = n_triangles.saturating_mul(3);
        let n_labels = if mesh.labels.is_null() { 0 } else { n_triangles };
        // SAFETY: the caller keeps the contract.
        unsafe {
            let positions = (n_vertices, row_bytes, stride);
            let attributes = array(&member("attributes"), mesh.attributes, n_attributes)?;
            let attribute = |(i, given): (usize, &Attribute)| {
                GivenAttribute::new(&format!("{name}->attributes[{i}]"), given, n_vertices)
            };
            Ok(GivenMesh {
                name,
                positions: rows(&member("positions"), mesh.positions, positions)?,
                n_vertices,
                stride,
                is_single,
                triangles: array(&member("triangles"), mesh.triangles, n_corners)?,
                labels: array(&member("labels"), mesh.labels, n_labels)?,
                attributes: attributes.iter().enumerate().map(attribute).collect::<Result<_>>()?,
            })
        }
    }

    fn positions(&self) -> Result<Vec<[f64; 3]>> {
        let name = format!("{}->positions", self.name);
        let rows = Rows { bytes: self.positions, stride: self.stride, n: self.n_vertices };
        if self.is_single {
            given::positions(&name, (0..self.n_vertices).map(|v| rows.row::<f32>(v)), f64::from)
        } else {
            given::positions(&name, (0..self.n_vertices).map(|v| rows.row::<f64>(v)), |x| x)
        }
    }

    fn triangles(&self) -> Result<Vec<[u32; 3]>> {
        let name = format!("{}->triangles", self.name);
        let rows = self.triangles.as_chunks::<3>().0.iter().copied();
        given::triangles(&name, rows, self.n_vertices, u64::from)
    }

    /// The mesh for a measurement.
    pub fn mesh(&self) -> Result<stonecut::Mesh> {
        Ok(stonecut::Mesh::new(self.positions()?, self.triangles()?))
    }

    /// The mesh for simplification; the values of the attributes are borrowed.
    pub fn input(&self, labels: &[String]) -> Result<Input<'a>> {
        let columns = self.attributes.iter().flat_map(GivenAttribute::columns).collect();
        Ok(Input {
            positions: self.positions()?,
            triangles: self.triangles()?,
            attributes: Attributes::new(columns, self.n_vertices, labels)?,
            labels: self.labels.to_vec(),
        })
    }
}

/// Rows of numbers at any distance.
struct Rows<'a> {
    bytes: &'a [u8],
    stride: usize,
    n: usize,
}

impl Rows<'_> {
    fn row<T: bytemuck::Pod>(&self, row: usize) -> [T; 3] {
        debug_assert!(row < self.n);
        let at = row * self.stride;
        bytemuck::pod_read_unaligned(&self.bytes[at..at + 3 * size_of::<T>()])
    }
}

impl<'a> GivenAttribute<'a> {
    /// Checks one of the attributes.
    ///
    /// # Safety
    ///
    /// `given` points to what the header says, for `n_vertices` vertices.
    unsafe fn new(place: &str, given: &Attribute, n_vertices: usize) -> Result<Self> {
        required(&format!("{place}.name"), given.name)?;
        // SAFETY: it is not null, and the caller says that it ends with a zero.
        let name = unsafe { CStr::from_ptr(given.name) };
        let shown = name.to_string_lossy();
        let Some(scalar) = scalar(given.scalar) else {
            let what =
                format!("{place}.type is {}, not one of STONECUT_I8 to STONECUT_F64", given.scalar);
            return Err(Error::Usage(what));
        };
        let width = given.width as usize;
        if !(1..=MOST).contains(&width) {
            return Err(Error::Usage(format!("{place}.width is {width}")));
        }
        let columns = columns(&shown, scalar, width).ok_or_else(|| {
            let wanted = "\"color\" is 3 or 4 of U8, U16, F32 or F64, \"normal\" 3 and \"uv\" 2 of F32 or F64, \
                          \"material\" 1 of I32";
            Error::Usage(format!("{place}: {width} of {scalar:?} are no \"{shown}\": {wanted}"))
        })?;
        let row_bytes = width * scalar.bytes();
        let stride = if given.stride == 0 { row_bytes } else { given.stride };
        // SAFETY: the caller keeps the contract.
        let bytes = unsafe {
            rows(&format!("{place}.values"), given.values, (n_vertices, row_bytes, stride))
        }?;
        Ok(GivenAttribute { name, scalar, code: given.scalar, columns, bytes, stride })
    }

    fn columns(&self) -> impl Iterator<Item = Column<'a>> {
        let (bytes, stride, scalar) = (self.bytes, self.stride, self.scalar);
        self.columns.iter().enumerate().map(move |(i, name)| Column {
            property: Property::new(name, scalar),
            bytes,
            offset: i * scalar.bytes(),
            stride,
        })
    }
}

/// Names of the columns of an attribute as in a PLY file; none of a known name with other numbers.
fn columns(name: &str, scalar: Scalar, width: usize) -> Option<Vec<String>> {
    let is_float = !scalar.is_integer();
    let (known, fits): (&[&str], bool) = match name {
        "color" => (
            &["red", "green", "blue", "alpha"],
            (3..=4).contains(&width) && (is_float || matches!(scalar, Scalar::U8 | Scalar::U16)),
        ),
        "normal" => (&["nx", "ny", "nz"], width == 3 && is_float),
        "uv" => (&["s", "t"], width == 2 && is_float),
        "material" => (&["texnumber"], width == 1 && scalar == Scalar::I32),
        _ if width == 1 => (&[], true),
        _ => return Some((0..width).map(|i| format!("{name}_{i}")).collect()),
    };
    let own = || vec![name.to_owned()];
    let names = || known[..width].iter().map(|&name| name.to_owned()).collect();
    fits.then(|| if known.is_empty() { own() } else { names() })
}

/// A type of numbers as the header has it.
fn scalar(code: u32) -> Option<Scalar> {
    Some(match code {
        1 => Scalar::I8,
        2 => Scalar::U8,
        3 => Scalar::I16,
        4 => Scalar::U16,
        5 => Scalar::I32,
        6 => Scalar::U32,
        7 => Scalar::I64,
        8 => Scalar::U64,
        9 => Scalar::F32,
        10 => Scalar::F64,
        _ => return None,
    })
}
