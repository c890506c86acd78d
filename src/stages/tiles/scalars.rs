//! Choice of the properties of vertices that tiles carry as attributes.

use stonecut_io::{NUMBER, TileScalar, find_texture, find3};
use stonecut_mesh::colours::ColourPlace;
use stonecut_mesh::property::{Origin, Property, Scalar, read_scalar};
use stonecut_mesh::record::VertexSchema;

/// Names that the colour of a tile gets in a mesh again.
const COLOUR: [&str; 3] = ["red", "green", "blue"];

/// The properties of vertices that tiles carry as attributes, and the names of those that they do not carry at all.
///
/// Position, normal and colour have attributes of glTF. Texture coordinates mean nothing without their images.
pub fn carried_scalars(schema: &VertexSchema) -> (Vec<TileScalar>, Vec<String>) {
    let (carried, lost) = split(schema);
    let names = lost.into_iter().map(|property| property.name.clone());
    (TileScalar::list(carried.iter().map(|(property, _)| *property)), names.collect())
}

/// Properties with their places in the record that become attributes, and those that do not appear in tiles.
fn split(schema: &VertexSchema) -> (Vec<(&Property, usize)>, Vec<&Property>) {
    let colour = ColourPlace::find(schema).map(|colour| colour.fields());
    let texture = find_texture(schema);
    let known = [colour, find3(schema, ["nx", "ny", "nz"])];
    let is_at = |at: usize| move |&(_, place): &(Scalar, usize)| place == at;
    let mut at = schema.position_bytes();
    let (mut carried, mut lost) = (Vec::new(), Vec::new());
    for property in &schema.properties {
        let place = at;
        at += property.scalar.bytes();
        let name = property.name.as_str();
        if property.origin != Origin::Vertex || known.iter().flatten().flatten().any(is_at(place)) {
            continue;
        }
        let is_texture =
            texture.iter().flatten().any(is_at(place)) || (texture.is_some() && name == NUMBER);
        match is_texture || (colour.is_some() && COLOUR.contains(&name)) {
            true => lost.push(property),
            false => carried.push((property, place)),
        }
    }
    (carried, lost)
}

/// Reads the values of the properties that tiles carry out of records.
pub(super) struct Columns {
    pub(super) scalars: Vec<TileScalar>,
    places: Vec<usize>,
}

impl Columns {
    pub(super) fn new(schema: &VertexSchema) -> Columns {
        let places = split(schema).0.into_iter().map(|(_, at)| at).collect();
        Columns { scalars: carried_scalars(schema).0, places }
    }

    /// Appends the values of a vertex to `columns`; returns how many of them a tile cannot hold exactly.
    pub(super) fn push(&self, record: &[u8], columns: &mut Vec<Vec<f64>>) -> u64 {
        columns.resize(self.places.len(), Vec::new());
        let mut inexact = 0;
        for ((scalar, &at), column) in self.scalars.iter().zip(&self.places).zip(columns) {
            let value = read_scalar(scalar.scalar, record, at);
            inexact += u64::from(!scalar.holds(value));
            column.push(TileScalar::held(value));
        }
        inexact
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_gltf_knows_is_not_carried_twice_and_what_is_lost_is_named() {
        let of = |names: &[&str]| {
            let properties = names.iter().map(|name| Property::new(name, Scalar::F32)).collect();
            let (carried, lost) =
                carried_scalars(&VertexSchema { coordinate: Scalar::F32, properties });
            (carried.into_iter().map(|s| s.name).collect::<Vec<_>>(), lost)
        };
        let all = ["red", "nx", "quality", "ny", "green", "nz", "blue", "alpha", "u", "class"];
        let expected = ["quality", "alpha", "u", "class"].map(str::to_owned).to_vec();
        assert_eq!(of(&all), (expected, vec![]));
        let (carried, lost) = of(&["s", "t", "nx", "red"]);
        assert_eq!(
            (carried, lost),
            (vec!["nx".to_owned(), "red".to_owned()], vec!["s".to_owned(), "t".to_owned()])
        );
        let (carried, lost) = of(&["r", "g", "b", "red"]);
        assert_eq!((carried, lost), (vec![], vec!["red".to_owned()]));
    }
}
