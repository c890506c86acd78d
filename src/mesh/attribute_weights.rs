//! Weights of attributes: from `--weight color=1,normal=0.5` to one length for each channel.
//!
//! A weight of 1 is what measurements showed to be sensible (docs/design/attributes.md): it relates a
//! channel's own range to the length of an edge of the result. Lengths depend on the input and the target,
//! so they are found once, before the first round, and hold for every cell. Does not touch vertices.

use crate::Mesh;
use crate::codec::ChannelKind;
use crate::vec3;

/// A perceptual colour difference of 1 (black to white) is worth this many edges of the result.
const COLOUR_EDGES: f64 = 0.3;
/// A normal that turns by a radian is worth this many edges of the result.
const NORMAL_EDGES: f64 = 0.1;
/// A scalar that goes through its whole range is worth this many edges of the result.
const SCALAR_EDGES: f64 = 0.1;
/// A shift of the texture on the surface is worth this share of its length.
const TEXTURE_LENGTHS: f64 = 0.02;

/// Moving a seam of the texture costs this share of what moving a boundary of the surface does.
const SEAM_SHARE: f64 = 0.002;

/// Stride over the triangles and vertices of a sampled piece of mesh.
const STRIDE: usize = 8;

/// Kinds of attributes, with the weight of each where none was typed; other properties are carried unweighted.
static KINDS: [(&str, ChannelKind, f64); 3] = [
    ("color", ChannelKind::Colour, 1.0),
    ("normal", ChannelKind::Normal, 0.0),
    ("uv", ChannelKind::Texture, 1.0),
];

/// Weights of kinds of attributes and of named properties, as they were typed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Weights(Vec<(String, f64)>);

/// The name of channels of a kind, if they can have a weight.
fn name_of(kind: &ChannelKind) -> Option<&str> {
    match kind {
        ChannelKind::Scalar(name) => Some(name),
        _ => KINDS.iter().find(|(_, known, _)| known == kind).map(|(name, ..)| *name),
    }
}

impl std::str::FromStr for Weights {
    type Err = String;

    /// Reads `color=W,normal=W,uv=W,NAME=W`; what is not mentioned keeps its default.
    fn from_str(text: &str) -> Result<Self, String> {
        let mut weights = Weights::default();
        for part in text.split(',').filter(|part| !part.trim().is_empty()) {
            let bad = || {
                format!(
                    "invalid weight '{part}': write NAME=W with W from 0 upwards, as in color=1,uv=0"
                )
            };
            let (name, weight) = part.split_once('=').ok_or_else(bad)?;
            let weight: f64 = weight.trim().parse().map_err(|_| bad())?;
            if !(0.0..=1e6).contains(&weight) {
                return Err(bad());
            }
            match name.trim() {
                "colour" => weights.0.push(("color".to_owned(), weight)),
                "" => return Err(bad()),
                name => weights.0.push((name.to_owned(), weight)),
            }
        }
        Ok(weights)
    }
}

impl std::fmt::Display for Weights {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [color, normal, uv] = KINDS.each_ref().map(|(name, ..)| self.of(name));
        write!(f, "color={color},normal={normal},uv={uv}")?;
        let is_kind = |name: &str| KINDS.iter().any(|(kind, ..)| *kind == name);
        let named = self.0.iter().filter(|(name, _)| !is_kind(name));
        named.into_iter().try_for_each(|(name, weight)| write!(f, ",{name}={weight}"))
    }
}

impl Weights {
    fn of(&self, name: &str) -> f64 {
        let kind = || KINDS.iter().find(|(kind, ..)| *kind == name).map_or(0.0, |kind| kind.2);
        self.0.iter().rev().find(|(typed, _)| typed == name).map_or_else(kind, |typed| typed.1)
    }

    /// The weight of each channel; 0 for one that rides along.
    pub fn of_channels(&self, channel_kinds: &[ChannelKind]) -> Vec<f64> {
        channel_kinds.iter().map(|kind| name_of(kind).map_or(0.0, |name| self.of(name))).collect()
    }

    /// Cost of moving a seam of the texture, as a share of that of moving a boundary of the surface.
    pub fn seam_share(&self) -> f32 {
        (SEAM_SHARE * self.of("uv")).min(1.0) as f32
    }

    /// Refuses a weight of what is not there, or is a label; colours, normals and texture coordinates that are not there may count
    /// nothing.
    pub fn check(&self, channel_kinds: &[ChannelKind]) -> Result<(), String> {
        let mut there: Vec<&str> = channel_kinds.iter().filter_map(name_of).collect();
        there.dedup();
        let is_nothing =
            |name: &str| KINDS.iter().any(|(kind, ..)| *kind == name) && self.of(name) == 0.0;
        let mut missing = self.0.iter().filter(|(name, _)| !there.contains(&name.as_str()));
        match missing.find(|(name, _)| !is_nothing(name)) {
            None => Ok(()),
            Some((name, _)) => Err(format!(
                "--weight {name}: the vertices have no such number that can be averaged; {}",
                match there.as_slice() {
                    [] => "they have positions alone: leave --weight out".to_owned(),
                    there => format!("they have {}", there.join(", ")),
                }
            )),
        }
    }
}

/// Statistics of the channels over a sample of the mesh.
#[derive(Clone, Debug, Default)]
pub struct ChannelSample {
    n_triangles: u64,
    area: f64,
    /// Least and greatest of each channel.
    ranges: Vec<[f32; 2]>,
    /// Root of the product of a triangle's areas in texture space and on the surface, summed up, and the
    /// latter. The few triangles over the edge of a texture, huge there, are left out of that.
    texture_area: [f64; 2],
}

impl ChannelSample {
    /// Takes a piece of the mesh into the sample: every eighth triangle and vertex of it.
    pub fn add(&mut self, mesh: &Mesh, channel_kinds: &[ChannelKind]) {
        self.ranges.resize(mesh.n_channels, [f32::INFINITY, f32::NEG_INFINITY]);
        for values in mesh.channels.chunks_exact(mesh.n_channels.max(1)).step_by(STRIDE) {
            for (range, &value) in self.ranges.iter_mut().zip(values) {
                *range = [range[0].min(value), range[1].max(value)];
            }
        }
        let texture: Vec<usize> = (0..channel_kinds.len())
            .filter(|&i| channel_kinds[i] == ChannelKind::Texture)
            .take(2)
            .collect();
        for (t, corners) in mesh.triangles.iter().enumerate().step_by(STRIDE) {
            let area = area(mesh.corners(t));
            self.n_triangles += 1;
            self.area += area;
            if let [s, t] = texture[..] {
                let at = |v: u32| mesh.channels_of(v);
                let place = corners.map(|v| [f64::from(at(v)[s]), f64::from(at(v)[t]), 0.0]);
                let flat = self::area(place);
                if flat.is_finite() {
                    self.texture_area[0] += (flat * area).sqrt();
                    self.texture_area[1] += area;
                }
            }
        }
    }

    /// For each channel the length in input units that a difference of 1 is worth, where the whole mesh of
    /// `n_triangles` is to become `target`.
    pub fn lengths(
        &self,
        weights: &[f64],
        channel_kinds: &[ChannelKind],
        n_triangles: u64,
        target: u64,
    ) -> Vec<f32> {
        let mean_area = self.area / self.n_triangles.max(1) as f64;
        let edge = (mean_area * n_triangles as f64 / target.max(1) as f64).sqrt();
        let [both, curved] = self.texture_area;
        let per_texture = if both > 0.0 { curved / both } else { 0.0 };
        let unit = |i: usize| match &channel_kinds[i] {
            ChannelKind::Colour => COLOUR_EDGES * edge,
            ChannelKind::Normal => NORMAL_EDGES * edge,
            ChannelKind::Texture => TEXTURE_LENGTHS * per_texture,
            ChannelKind::Scalar(_) => match self.ranges.get(i) {
                Some([low, high]) if high > low && (high - low).is_finite() => {
                    SCALAR_EDGES * edge / f64::from(high - low)
                }
                _ => 0.0,
            },
            ChannelKind::Region | ChannelKind::Label | ChannelKind::LowBits => 0.0,
        };
        weights.iter().enumerate().map(|(i, weight)| (weight * unit(i)) as f32).collect()
    }
}

fn area(corners: [[f64; 3]; 3]) -> f64 {
    0.5 * vec3::length_sq(vec3::normal(corners)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_read_shown_and_refused() {
        let weights: Weights = "color=0.5, quality=2,uv=0".parse().expect("well written");
        assert_eq!(weights.to_string(), "color=0.5,normal=0,uv=0,quality=2");
        let channel_kinds =
            [ChannelKind::Colour, ChannelKind::Scalar("quality".into()), ChannelKind::LowBits];
        assert_eq!(weights.of_channels(&channel_kinds), [0.5, 2.0, 0.0]);
        assert!(weights.check(&channel_kinds).is_ok());
        let said = weights.check(&channel_kinds[..1]).expect_err("no quality");
        assert!(
            said.starts_with("--weight quality:") && said.ends_with("they have color"),
            "{said}"
        );
        let said = weights.check(&[]).expect_err("no colours");
        assert!(said.starts_with("--weight color:"), "{said}");
        assert!(Weights::default().check(&[]).is_ok());
        for bad in ["color", "color=-1", "=1", "color=NaN", "color=x"] {
            assert!(bad.parse::<Weights>().is_err(), "{bad}");
        }
        assert_eq!("".parse::<Weights>().expect("nothing said"), Weights::default());
    }
}
