//! Looks at what faces carry, once, and decides what becomes of each property (`mesh::face_properties::FacePolicy`).
//!
//! One pass over the faces, none where they carry nothing. What is constant is known exactly; how many
//! vertices a label would make of one is counted on a sample of 20,000 vertices. Changes nothing.

use crate::face_labels::{FaceLabels, SIDES, WallOrders};
use crate::materials::NUMBER;
use crate::ply::MeshSource;
use std::collections::HashMap;
use stonecut_mesh::codec::colour_groups;
use stonecut_mesh::face_properties::{
    FEW_FACES, FacePolicy, FaceProperty, FacePropertyPlan, MAX_COLOUR_VERTICES, MAX_LABEL_VERTICES,
};
use stonecut_mesh::patches::WholeValues;
use stonecut_mesh::property::{Property, Scalar, read_scalar};
use stonecut_system::error::Result;

/// Vertices around which faces are compared.
const SAMPLED_VERTICES: u64 = 20_000;

/// Different faces that are remembered around one vertex, and bytes for all of them together.
const MAX_AROUND: usize = 64;
const MAX_BYTES: usize = 32 << 20;

/// More bytes of properties than these do not go to vertices.
const MAX_VALUE_BYTES: usize = 128;

/// Properties to leave out, and properties that are labels whatever their type.
#[derive(Clone, Debug, Default)]
pub struct SurveyOptions<'a> {
    /// Texture coordinates at corners are left out.
    pub drop_texture: bool,
    /// Scalar properties are left out.
    pub drop_properties: bool,
    /// Names of properties that are chosen, never averaged.
    pub labels: &'a [String],
}

/// Surveys the faces of `source`: the properties that they carry and the fate of each.
///
/// Memory: some megabytes, 64 at most. Time: a pass over the faces if they have scalar properties.
pub fn survey_faces(source: &MeshSource, options: &SurveyOptions) -> Result<FacePropertyPlan> {
    let properties = source.face_properties();
    let texture = source.has_corner_texture() && !options.drop_texture;
    let lists = source.dropped_face_properties();
    let carry =
        |properties, turns_walls| FacePropertyPlan { texture, properties, lists, turns_walls };
    let with = |how: FacePolicy, property: &Property, constant: &[u8], reason| {
        let (property, constant) = (property.clone(), constant.to_vec());
        FaceProperty { property, how, constant, reason }
    };
    // The number of an image goes with the texture, whatever becomes of the rest.
    let has_images = source.has_corner_texture();
    let is_image = |p: &Property| p.name == NUMBER && (has_images || source.materials().is_some());
    let goes_with_texture = |p: &Property| has_images && is_image(p);
    let is_dropped = |p: &Property| match goes_with_texture(p) {
        true => !texture,
        false => options.drop_properties,
    };
    let why =
        |p: &Property| if goes_with_texture(p) { "goes with the texture" } else { "as asked" };
    if properties.iter().all(is_dropped) {
        let dropped = properties.iter().map(|p| with(FacePolicy::Dropped, p, &[], why(p)));
        return Ok(carry(dropped.collect(), false));
    }
    let found = SurveyFindings::look(source, &properties)?;
    let is_label = |p: &Property| options.labels.contains(&p.name);
    let has_walls = FaceLabels::named(source, &SIDES).is_some();
    let is_side = |p: &Property| has_walls && SIDES.contains(&p.name.as_str());
    let groups = colour_groups(&properties);
    let mut decided = Vec::new();
    let mut moved_bytes = 0;
    for (i, property) in properties.iter().enumerate() {
        // The components of a colour are one value.
        let group = groups.iter().find(|group| group.contains(&i)).cloned();
        let together = group.clone().unwrap_or_else(|| vec![i]);
        let each = match source.n_face_rows() < FEW_FACES {
            true => 1.0,
            false => found.vertices_each(&together),
        };
        let named = together.iter().any(|&i| is_label(&properties[i]));
        let is_float = matches!(property.scalar, Scalar::F32 | Scalar::F64);
        let mut reason = if is_dropped(property) { why(property) } else { "" };
        let mut how = match () {
            () if is_dropped(property) => FacePolicy::Dropped,
            () if together.iter().all(|&i| found.is_constant(i)) => FacePolicy::Constant,
            // Without their borders the regions would come out open.
            () if is_image(property) || is_side(property) => FacePolicy::Region,
            () if group.is_some() && !named => {
                if each <= MAX_COLOUR_VERTICES {
                    FacePolicy::Region
                } else {
                    FacePolicy::Averaged
                }
            }
            () if is_float && !named && !found.is_label(i) => FacePolicy::Averaged,
            () if each <= MAX_LABEL_VERTICES => FacePolicy::Region,
            () => FacePolicy::Chosen,
        };
        if !matches!(how, FacePolicy::Constant | FacePolicy::Dropped) {
            moved_bytes += property.scalar.bytes();
            if moved_bytes > MAX_VALUE_BYTES {
                (how, reason) = (FacePolicy::Dropped, "faces carry more than 128 bytes");
            }
        }
        let constant = if how == FacePolicy::Constant { found.first(i) } else { &[] };
        decided.push(with(how, property, constant, reason));
    }
    Ok(carry(decided, found.walls.is_some_and(|(_, orders)| orders.are_mixed)))
}

/// Findings of the pass over the faces.
struct SurveyFindings {
    /// Place of each property among a face's values.
    places: Vec<std::ops::Range<usize>>,
    first: Vec<u8>,
    constant: Vec<bool>,
    /// Values of floats that may be labels.
    whole: Vec<(Scalar, WholeValues)>,
    /// Values of the faces around sampled vertices, each once.
    around: HashMap<u64, Vec<Vec<u8>>>,
    /// The labels of walls, and the ways they are wound.
    walls: Option<(FaceLabels, WallOrders)>,
}

impl SurveyFindings {
    fn look(source: &MeshSource, properties: &[Property]) -> Result<SurveyFindings> {
        let mut at = 0;
        let place = |p: &Property| {
            at += p.scalar.bytes();
            at - p.scalar.bytes()..at
        };
        let mut found = SurveyFindings {
            places: properties.iter().map(place).collect(),
            first: Vec::new(),
            constant: vec![true; properties.len()],
            whole: properties.iter().map(|p| (p.scalar, WholeValues::default())).collect(),
            around: HashMap::new(),
            walls: FaceLabels::named(source, &SIDES).map(|labels| (labels, WallOrders::default())),
        };
        let mut room = MAX_BYTES;
        let every = source.n_vertices().div_ceil(SAMPLED_VERTICES).max(1);
        // Multiplying by the golden ratio scatters what is regular in a file.
        let sampled = |v: u64| (v.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32).is_multiple_of(every);
        source.each_full_face(|_, face| {
            if face.is_bad {
                return Ok(());
            }
            if found.first.is_empty() {
                found.first.clone_from(&face.values);
            }
            if face.values != found.first {
                for (constant, place) in found.constant.iter_mut().zip(&found.places) {
                    *constant &= face.values[place.clone()] == found.first[place.clone()];
                }
            }
            if let Some((labels, orders)) = &mut found.walls {
                orders.add(labels.sides(&face.values));
            }
            for ((scalar, whole), place) in found.whole.iter_mut().zip(&found.places) {
                if !scalar.is_integer() {
                    whole.add(read_scalar(*scalar, &face.values, place.start));
                }
            }
            for &v in face.corners.iter().filter(|v| sampled(**v)) {
                let around = found.around.entry(v).or_default();
                if around.len() < MAX_AROUND
                    && face.values.len() < room
                    && !around.contains(&face.values)
                {
                    room -= face.values.len();
                    around.push(face.values.clone());
                }
            }
            Ok(())
        })?;
        // A mesh without faces has values nowhere.
        let n_bytes = properties.iter().map(|p| p.scalar.bytes()).sum();
        found.first.resize(n_bytes, 0);
        Ok(found)
    }

    fn is_constant(&self, i: usize) -> bool {
        self.constant[i]
    }

    /// Returns whether a float is a label: whole numbers that make regions.
    fn is_label(&self, i: usize) -> bool {
        self.whole[i].1.are_labels() && self.vertices_each(&[i]) <= MAX_LABEL_VERTICES
    }

    fn first(&self, i: usize) -> &[u8] {
        &self.first[self.places[i].clone()]
    }

    /// Estimates how many vertices each vertex would become if these properties were a region's.
    fn vertices_each(&self, together: &[usize]) -> f64 {
        let mut sum = 0u64;
        for around in self.around.values() {
            let value = |values: &Vec<u8>| -> Vec<u8> {
                let bytes = together.iter().flat_map(|&i| &values[self.places[i].clone()]);
                bytes.copied().collect()
            };
            let mut different: Vec<Vec<u8>> = around.iter().map(value).collect();
            different.sort_unstable();
            different.dedup();
            sum += different.len() as u64;
        }
        sum as f64 / (self.around.len() as f64).max(1.0)
    }
}
