//! Takes the simplified mesh out of its state.

use crate::state::MeshState;
use crate::surface::Surface;
use crate::surface::models::Models;
use crate::surface::wedges::Wedges;
use crate::vertex::GONE;
use stonecut_mesh::Mesh;

impl MeshState {
    /// The input vertices that those made on the way are like.
    pub(crate) fn take_models(&mut self) -> Models {
        let of_wedges = self.wedges.as_mut().map(|wedges| &mut wedges.models);
        std::mem::take(of_wedges.unwrap_or(&mut self.surface.models))
    }

    /// The mesh that is left, vertices in the order of their sources; seams are split again.
    pub(crate) fn into_mesh(self) -> (Mesh, Vec<u32>) {
        let MeshState { mut surface, wedges, .. } = self;
        if let Some(mut wedges) = wedges {
            wedges.retain(&surface.triangles);
            surface.triangles.retain(|t| t[0] != GONE);
            return split(&surface, &wedges);
        }
        surface.triangles.retain(|t| t[0] != GONE);
        let mut used: Vec<(u32, u32)> = Vec::new();
        let mut place = vec![GONE; surface.vertices.len()];
        for t in &surface.triangles {
            for &v in t {
                if place[v as usize] == GONE {
                    place[v as usize] = 0;
                    used.push((surface.source[v as usize], v));
                }
            }
        }
        used.sort_unstable();
        let n = surface.n_channels;
        let mut mesh = Mesh { n_channels: n, ..Mesh::default() };
        mesh.positions.reserve_exact(used.len());
        mesh.channels.reserve_exact(used.len() * n);
        for (new, &(_, v)) in used.iter().enumerate() {
            let v = v as usize;
            place[v] = new as u32;
            mesh.positions.push(surface.vertices[v].position);
            mesh.channels.extend_from_slice(&surface.channels[v * n..(v + 1) * n]);
        }
        for t in &mut surface.triangles {
            *t = t.map(|v| place[v as usize]);
        }
        mesh.triangles = surface.triangles;
        (mesh, used.into_iter().map(|(source, _)| source).collect())
    }
}

/// The mesh with a vertex for every wedge that is in use.
fn split(surface: &Surface, wedges: &Wedges) -> (Mesh, Vec<u32>) {
    let corners = wedges.corner.iter().flatten().zip(surface.triangles.iter().flatten());
    let mut used: Vec<(u32, u32, u32)> = corners.map(|(&w, &v)| (wedges.of(w).0, w, v)).collect();
    used.sort_unstable();
    used.dedup();
    let mut mesh = Mesh { n_channels: surface.n_channels, ..Mesh::default() };
    let n_wedges = used.iter().map(|&(_, w, _)| w as usize + 1).max().unwrap_or(0);
    let mut place = vec![GONE; n_wedges];
    for (new, &(_, w, v)) in used.iter().enumerate() {
        place[w as usize] = new as u32;
        mesh.positions.push(surface.vertices[v as usize].position);
        mesh.channels.extend_from_slice(wedges.of(w).1);
    }
    mesh.triangles = wedges.corner.iter().map(|t| t.map(|w| place[w as usize])).collect();
    (mesh, used.into_iter().map(|(source, ..)| source).collect())
}
