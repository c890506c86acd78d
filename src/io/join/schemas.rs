//! The union of the properties of several meshes, and values of one written as those of the union.
//!
//! Properties are known by name. Types are the widest; colours keep their share of full intensity. What a mesh lacks is
//! neutral: white, no material, without a number (NaN), otherwise 0.

use crate::materials::NUMBER;
use std::collections::HashSet;
use stonecut_mesh::codec::{TEXTURE_NAMES, colour_groups};
use stonecut_mesh::property::{Property, Scalar, read_scalar, write_scalar};

/// Properties of several meshes.
#[derive(Debug, Default)]
pub(super) struct SchemaUnion {
    pub properties: Vec<Property>,
    /// Number of the meshes that have each, and a sum that shows whether they are the same ones.
    having: Vec<(u64, u64)>,
    n_meshes: u64,
    /// Names of components of colours.
    colours: HashSet<String>,
}

impl SchemaUnion {
    /// Takes in the properties of a mesh.
    pub fn add(&mut self, own: &[Property]) {
        self.n_meshes += 1;
        // Odd factor of splitmix64.
        let this = self.n_meshes.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let this = this ^ this >> 31;
        let colours = colour_groups(own).into_iter().flatten();
        self.colours.extend(colours.map(|i| plain_name(own, &own[i]).to_owned()));
        for property in own {
            let property = Property::new(plain_name(own, property), property.scalar);
            match self.properties.iter().position(|known| known.name == property.name) {
                Some(i) => {
                    let (n, sum) = self.having[i];
                    self.having[i] = (n + 1, sum.wrapping_add(this));
                    let wide = widest(self.properties[i].scalar, property.scalar);
                    self.properties[i].scalar = wide;
                }
                None => {
                    self.properties.push(property);
                    self.having.push((1, this));
                }
            }
        }
    }

    /// Adds a property where no mesh has it, or gives it another type.
    pub fn require(&mut self, name: &str, scalar: Scalar) {
        match self.properties.iter_mut().find(|known| known.name == name) {
            Some(known) => known.scalar = scalar,
            None => {
                self.properties.push(Property::new(name, scalar));
                self.having.push((self.n_meshes, 0));
            }
        }
    }

    /// Drops normals that only some of the meshes have, with a line: a normal of length 0 is black in viewers.
    pub fn drop_partial_normals(&mut self) -> Option<String> {
        let all = self.n_meshes;
        let mut both = self.properties.iter().zip(&self.having);
        let (_, (having, _)) = both.find(|(p, (having, _))| is_normal(&p.name) && *having < all)?;
        let lack = all - having;
        let both = std::mem::take(&mut self.properties).into_iter().zip(self.having.drain(..));
        (self.properties, self.having) = both.filter(|(p, _)| !is_normal(&p.name)).unzip();
        Some(format!(
            "normals of vertices: {lack} of {all} files are without, so no vertex keeps one"
        ))
    }

    /// A line for those that some meshes lack: their names and how many lack them.
    pub fn lacking(&self, whose: &str) -> Vec<String> {
        let mut out: Vec<((u64, u64), Vec<&str>)> = Vec::new();
        for (property, &having) in self.properties.iter().zip(&self.having) {
            if having.0 == self.n_meshes {
                continue;
            }
            match out.iter_mut().find(|(known, _)| *known == having) {
                Some((_, names)) => names.push(&property.name),
                None => out.push((having, vec![&property.name])),
            }
        }
        let line = |((n, _), names): ((u64, u64), Vec<&str>)| {
            let (lack, all, names) = (self.n_meshes - n, self.n_meshes, names.join(" "));
            format!("{names} of {whose}: {lack} of {all} files are without, and get neutral values")
        };
        out.into_iter().map(line).collect()
    }

    /// The way from the values of a mesh to those of the union; `None` where they are the same bytes.
    pub fn conversion(&self, own: &[Property]) -> Option<Conversion> {
        let mut fields = Vec::new();
        for to in &self.properties {
            let is_colour = self.colours.contains(&to.name);
            let mut at = 0;
            let mut source = None;
            for from in own {
                if plain_name(own, from) == to.name {
                    let is_scaled = is_colour && from.scalar != to.scalar;
                    let scale = if is_scaled { to.full() / from.full() } else { 1.0 };
                    source = Some(Source { scalar: from.scalar, at, scale });
                }
                at += from.scalar.bytes();
            }
            fields.push(Field { source, scalar: to.scalar, neutral: self.neutral(to) });
        }
        let types = |list: &[Property]| -> Vec<(String, Scalar)> {
            list.iter().map(|p| (p.name.clone(), p.scalar)).collect()
        };
        (types(own) != types(&self.properties)).then_some(Conversion { fields })
    }

    fn neutral(&self, property: &Property) -> f64 {
        let name = property.name.as_str();
        let is_texture = TEXTURE_NAMES.iter().any(|pair| pair.contains(&name));
        match property.scalar {
            _ if self.colours.contains(name) => property.full(),
            _ if name == NUMBER => -1.0,
            Scalar::F32 | Scalar::F64 if !is_normal(name) && !is_texture => f64::NAN,
            _ => 0.0,
        }
    }
}

fn is_normal(name: &str) -> bool {
    ["nx", "ny", "nz"].contains(&name)
}

/// The name of a property in the union: `red` for the `diffuse_red` of a mesh without `red`.
fn plain_name<'a>(own: &'a [Property], property: &'a Property) -> &'a str {
    match property.name.strip_prefix("diffuse_") {
        Some(plain) if !own.iter().any(|other| other.name == plain) => plain,
        _ => &property.name,
    }
}

/// The smallest type that holds the values of two.
pub(super) fn widest(a: Scalar, b: Scalar) -> Scalar {
    if a == b {
        return a;
    }
    let is_unsigned = |s: Scalar| matches!(s, Scalar::U8 | Scalar::U16 | Scalar::U32 | Scalar::U64);
    match (a.is_integer(), b.is_integer()) {
        (true, true) if is_unsigned(a) == is_unsigned(b) => {
            if a.bytes() >= b.bytes() {
                a
            } else {
                b
            }
        }
        (true, true) => {
            let (signed, unsigned) = if is_unsigned(a) { (b, a) } else { (a, b) };
            match unsigned.bytes() {
                n if signed.bytes() > n => signed,
                1 => Scalar::I16,
                2 => Scalar::I32,
                _ => Scalar::I64,
            }
        }
        (false, false) => Scalar::F64,
        (is_a, _) => {
            let (integer, float) = if is_a { (a, b) } else { (b, a) };
            if integer.bytes() > 2 { Scalar::F64 } else { float }
        }
    }
}

/// Values of one mesh as those of the union.
#[derive(Debug)]
pub(super) struct Conversion {
    fields: Vec<Field>,
}

#[derive(Debug)]
struct Field {
    /// `None` where the mesh lacks the property.
    source: Option<Source>,
    scalar: Scalar,
    neutral: f64,
}

#[derive(Debug)]
struct Source {
    scalar: Scalar,
    at: usize,
    scale: f64,
}

impl Conversion {
    /// Appends the values of a row.
    pub fn put(&self, row: &[u8], out: &mut Vec<u8>) {
        for Field { source, scalar, neutral } in &self.fields {
            let start = out.len();
            out.resize(start + scalar.bytes(), 0);
            let place = &mut out[start..];
            match source {
                None => write_scalar(*scalar, place, 0, *neutral),
                Some(from) if from.scalar == *scalar => {
                    place.copy_from_slice(&row[from.at..from.at + scalar.bytes()]);
                }
                // Doubles hold 53 bits of them.
                Some(Source { scalar: Scalar::U64, at, .. }) if *scalar == Scalar::I64 => {
                    let bytes = row[*at..].first_chunk().copied().unwrap_or_default();
                    let value = u64::from_le_bytes(bytes).min(i64::MAX as u64);
                    place.copy_from_slice(&value.to_le_bytes());
                }
                Some(from) => {
                    let value = read_scalar(from.scalar, row, from.at) * from.scale;
                    write_scalar(*scalar, place, 0, value);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_mesh_lacks_is_neutral_and_colours_keep_their_share() {
        let bytes = ["red", "green", "blue"].map(|name| Property::new(name, Scalar::U8));
        let mut floats =
            ["red", "green", "blue"].map(|name| Property::new(name, Scalar::F32)).to_vec();
        floats.push(Property::new("quality", Scalar::F32));
        let mut union = SchemaUnion::default();
        union.add(&bytes);
        union.add(&floats);
        let types: Vec<_> = union.properties.iter().map(|p| p.scalar).collect();
        assert_eq!(types, [Scalar::F32; 4]);
        let mut row = Vec::new();
        union.conversion(&bytes).unwrap().put(&[255, 51, 0], &mut row);
        let values: Vec<f64> = (0..4).map(|i| read_scalar(Scalar::F32, &row, 4 * i)).collect();
        assert_eq!(
            values[..3].iter().map(|x| (x * 10.0).round()).collect::<Vec<_>>(),
            [10.0, 2.0, 0.0]
        );
        assert!(values[3].is_nan());
        assert!(union.conversion(&floats).is_none());
        let diffuse = ["diffuse_red", "diffuse_green", "diffuse_blue"];
        let diffuse = diffuse.map(|name| Property::new(name, Scalar::U8));
        row.clear();
        union.conversion(&diffuse).unwrap().put(&[255, 51, 0], &mut row);
        assert_eq!(read_scalar(Scalar::F32, &row, 0), 1.0);
        let mut times = SchemaUnion::default();
        let unsigned = [Property::new("time", Scalar::U64)];
        times.add(&unsigned);
        times.add(&[Property::new("time", Scalar::I64)]);
        row.clear();
        let time = (1u64 << 62) + 1;
        times.conversion(&unsigned).unwrap().put(&time.to_le_bytes(), &mut row);
        assert_eq!(row, time.to_le_bytes());
        let line = "quality of vertices: 1 of 2 files are without, and get neutral values";
        assert_eq!(union.lacking("vertices"), [line]);
        assert_eq!(widest(Scalar::I32, Scalar::F32), Scalar::F64);
        assert_eq!(widest(Scalar::U8, Scalar::I8), Scalar::I16);
        assert_eq!(widest(Scalar::I32, Scalar::U8), Scalar::I32);
    }
}
