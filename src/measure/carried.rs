//! Attributes of two surfaces, compared at nearest points: colour, texture coordinate, normal.
//!
//! Interpolates linearly within a triangle, as viewers do. Which channels these are is said by the vertex
//! schema.

use super::colour::ColourChannels;
use stonecut_mesh::Mesh;
use stonecut_mesh::codec::ChannelKind;
use stonecut_mesh::record::VertexSchema;

/// Channels of a mesh that are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Carried {
    /// Red, green and blue.
    pub colour: Option<ColourChannels>,
    /// Two texture coordinates.
    pub texture: Option<[usize; 2]>,
    /// The normal.
    pub normal: Option<[usize; 3]>,
}

/// Attributes of a surface at one point, as precise as channels are.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Values {
    /// CIELAB.
    pub lab: Option<[f32; 3]>,
    /// Texture coordinates.
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
    /// Finds the compared channels of a schema; `None` if there are none.
    pub fn of(schema: &VertexSchema) -> Option<Carried> {
        let channel_kinds = schema.codec().channel_kinds(schema);
        let mut channels = [Vec::new(), Vec::new()];
        for (channel, meaning) in channel_kinds.iter().enumerate() {
            match meaning {
                ChannelKind::Texture => channels[0].push(channel),
                ChannelKind::Normal => channels[1].push(channel),
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
    pub fn at(&self, mesh: &Mesh, corners: [u32; 3], weights: [f64; 3]) -> Values {
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
