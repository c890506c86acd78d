//! What surfaces carry, compared where they are next to each other: colour, texture coordinate, normal.
//!
//! Interpolates linearly within a triangle, as viewers do. Which channels these are is said by the vertex
//! schema.

use super::colour::ColourChannels;
use crate::mesh::Mesh;
use crate::mesh::codec::Meaning;
use crate::mesh::record::VertexSchema;

/// Where a mesh keeps what is compared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Carried {
    /// Red, green and blue.
    pub colour: Option<ColourChannels>,
    /// Two texture coordinates.
    pub texture: Option<[usize; 2]>,
    /// The normal.
    pub normal: Option<[usize; 3]>,
}

/// What a surface carries at one point of it, as precise as channels are.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub(crate) struct Values {
    /// CIELAB.
    pub lab: Option<[f32; 3]>,
    pub texture: Option<[f32; 2]>,
    /// Of any length.
    pub normal: Option<[f32; 3]>,
}

impl From<ColourChannels> for Carried {
    fn from(colour: ColourChannels) -> Self {
        Carried { colour: Some(colour), ..Carried::default() }
    }
}

impl Carried {
    /// What the vertices of a schema carry; `None` if it is nothing.
    pub fn of(schema: &VertexSchema) -> Option<Carried> {
        let meanings = schema.codec().meanings(schema);
        let mut channels = [Vec::new(), Vec::new()];
        for (channel, meaning) in meanings.iter().enumerate() {
            match meaning {
                Meaning::Texture => channels[0].push(channel),
                Meaning::Normal => channels[1].push(channel),
                _ => {}
            }
        }
        let carried = Carried {
            colour: ColourChannels::of(schema),
            texture: channels[0].first_chunk().copied(),
            normal: channels[1].first_chunk().copied(),
        };
        (carried != Carried::default()).then_some(carried)
    }

    /// The values at a point of a triangle.
    pub(crate) fn at(&self, mesh: &Mesh, corners: [u32; 3], weights: [f64; 3]) -> Values {
        let mixed = |channel: usize| -> f32 {
            let value = |i: usize| f64::from(mesh.channels_of(corners[i])[channel]);
            (0..3).map(|i| weights[i] * value(i)).sum::<f64>() as f32
        };
        Values {
            lab: self.colour.map(|colour| colour.lab(mesh, corners, weights).map(|x| x as f32)),
            texture: self.texture.map(|texture| texture.map(mixed)),
            normal: self.normal.map(|normal| normal.map(mixed)),
        }
    }
}
