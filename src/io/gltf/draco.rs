//! Meshes that Draco has compressed (`KHR_draco_mesh_compression`), unpacked into temporary data.
//!
//! A compressed mesh is decoded in memory, one at a time; behind that its numbers are elements of accessors like all others.

use super::buffers::Buffers;
use super::elements::Elements;
use super::json::{Document, Draco, Primitive};
use crate::open_options::StageOptions;
use crate::ply::raw::RawFile;
use std::collections::{BTreeMap, HashMap};
use stonecut_system::error::Result;

/// A primitive after it was unpacked.
#[derive(Clone)]
pub(super) struct Unpacked {
    pub(super) attributes: BTreeMap<String, Elements>,
    pub(super) indices: Elements,
}

/// Meshes that were unpacked, by their views.
#[derive(Default)]
pub(super) struct DracoMeshes {
    known: HashMap<usize, Unpacked>,
}

impl DracoMeshes {
    /// The numbers of a primitive, if it is compressed; each is unpacked once.
    pub(super) fn of(
        &mut self,
        (file, document): (&RawFile, &Document),
        primitive: &Primitive,
        (buffers, options): (&mut Buffers, &StageOptions),
    ) -> Result<Option<Unpacked>> {
        let Some(packed) = &primitive.extensions.draco else { return Ok(None) };
        if let Some(known) = self.known.get(&packed.buffer_view) {
            return Ok(Some(known.clone()));
        }
        let new = unpack((file, document), (primitive, packed), buffers, options)?;
        self.known.insert(packed.buffer_view, new.clone());
        Ok(Some(new))
    }
}

/// Unpacks the mesh of a primitive.
///
/// Memory: the decoded mesh, at most that of the stage. Errors: damaged data; a mesh that needs more.
#[cfg(feature = "draco")]
fn unpack(
    (file, document): (&RawFile, &Document),
    (primitive, draco): (&Primitive, &Draco),
    buffers: &mut Buffers,
    options: &StageOptions,
) -> Result<Unpacked> {
    use draco_core::{DecodeLimits, DecoderBuffer, ErrorKind, Mesh, MeshDecoder};
    use stonecut_system::parallel::guarded;
    use stonecut_system::units::show_bytes;

    let view = draco.buffer_view;
    let part = buffers.view(view)?;
    if part.n_bytes > options.parse_bytes {
        return Err(file.bad(format!(
            "bufferView {view} has {} of a mesh compressed with Draco, more than the {} that are unpacked at once; give more \
             --memory, or decompress it first (gltf-transform copy IN OUT)",
            show_bytes(part.n_bytes),
            show_bytes(options.parse_bytes)
        )));
    }
    let mut bytes = vec![0; part.n_bytes as usize];
    part.file.read_exact_at(&mut bytes, part.offset)?;
    // A corner takes 4 bytes of the mesh; what attributes take is counted by itself.
    let limits = DecodeLimits::default()
        .with_max_decoded_bytes(options.parse_bytes)
        .with_max_points(options.parse_bytes / 16)
        .with_max_faces(options.parse_bytes / 16);
    let decoded = guarded(|| {
        let mut mesh = Mesh::new();
        let mut buffer = DecoderBuffer::new(&bytes).with_limits(limits);
        Ok(MeshDecoder::new().decode(&mut buffer, &mut mesh).map(|()| mesh))
    });
    let mesh = match decoded {
        Ok(Ok(mesh)) => mesh,
        Ok(Err(error)) if error.kind() == ErrorKind::LimitExceeded => {
            return Err(file.bad(format!(
                "bufferView {view}: the mesh that Draco has compressed needs more than {} when it is unpacked; give more \
                 --memory, or decompress it first (gltf-transform copy IN OUT)",
                show_bytes(options.parse_bytes)
            )));
        }
        Ok(Err(error)) => {
            return Err(file.bad(format!(
                "bufferView {view}: its Draco data is damaged ({error}); fetch the file again"
            )));
        }
        Err(_) => {
            return Err(file.bad(format!(
                "bufferView {view}: its Draco data is damaged; fetch the file again"
            )));
        }
    };
    let n_points = mesh.num_points();
    let mut spool = options.spool();
    let mut places = Vec::new();
    for (name, &id) in &draco.attributes {
        let accessor = primitive.attributes.get(name).and_then(|&i| document.accessors.get(i));
        let (Some(attribute), Some(accessor)) = (mesh.attribute_by_unique_id(id), accessor) else {
            return Err(file.bad(format!(
                "bufferView {view}: the attribute {name} is not in its Draco data; export the file again"
            )));
        };
        let n_numbers = usize::from(attribute.num_components());
        // Integers stand for shares where the accessor says so.
        let most = match accessor.component_type {
            5120 if accessor.normalized => 127.0,
            5121 if accessor.normalized => 255.0,
            5122 if accessor.normalized => 32_767.0,
            5123 if accessor.normalized => 65_535.0,
            _ => 1.0,
        };
        let at = spool.len();
        for value in attribute.read_f32s(n_points, n_numbers) {
            spool.write(
                &(value / most).max(if most > 1.0 { -1.0 } else { f32::MIN }).to_le_bytes(),
            )?;
        }
        places.push((name.clone(), at, n_numbers));
    }
    let (at, n_corners) = (spool.len(), 3 * mesh.faces().len() as u64);
    for corner in mesh.faces().as_flattened() {
        spool.write(&corner.0.to_le_bytes())?;
    }
    let whole = std::sync::Arc::new(spool.finish(file.path())?);
    let attributes = places
        .into_iter()
        .map(|(name, at, n)| (name, Elements::of_floats(&whole, at, n, n_points as u64)))
        .collect();
    Ok(Unpacked { attributes, indices: Elements::of_indices(&whole, at, n_corners) })
}

/// Refuses the mesh of a primitive.
#[cfg(not(feature = "draco"))]
fn unpack(
    (file, _): (&RawFile, &Document),
    _: (&Primitive, &Draco),
    _: &mut Buffers,
    _: &StageOptions,
) -> Result<Unpacked> {
    Err(file.bad(
        "its meshes are compressed with Draco, which this build does not read; decompress it first (gltf-transform copy IN OUT), \
         or build with the feature 'draco'",
    ))
}
