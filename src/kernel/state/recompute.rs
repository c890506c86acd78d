//! Quadrics, classes and sums of attributes of vertices whose triangles changed other than by a collapse.

use crate::cost::fold_quadric;
use crate::cost::quadric::{Rows, Triangles};
use crate::simd::Simd;
use crate::state::MeshState;
use crate::surface::fan::Fan;
use crate::surface::wedges::Corners;
use crate::surface::{HUB, Surface};
use crate::vertex::GONE;

/// Quadrics and classes of vertices whose triangles changed; empties the list. Rings must be right.
pub(crate) fn recompute_vertices(state: &mut MeshState, touched: &mut Vec<u32>, simd: Simd) {
    let surface = &mut state.surface;
    touched.sort_unstable();
    touched.dedup();
    touched.retain(|&v| surface.rings[v as usize].len > 0);
    let mut fan = Fan::new();
    for &v in touched.iter() {
        if surface.ring(v).len() > HUB as usize {
            // It may still list triangles that are gone.
            let is_there = |&t: &u32| surface.triangles[t as usize][0] != GONE;
            let list: Vec<u32> = surface.ring(v).iter().copied().filter(is_there).collect();
            surface.set_ring(v, &list);
        }
        recompute_quadric(surface, v, simd);
        surface.classify(v, &mut fan);
    }
    if let Some(attributes) = &mut state.attributes {
        let corners = Corners { surface, wedges: state.wedges.as_deref() };
        touched.iter().for_each(|&v| attributes.refresh(corners, v));
    }
    touched.clear();
}

/// The quadric of a vertex from its triangles, with its folds, without its open edges.
pub(crate) fn recompute_quadric(surface: &mut Surface, v: u32, simd: Simd) {
    let mut quadric = [0.0; 9];
    let mut rows = Rows::ZERO;
    for eight in surface.ring(v).chunks(8) {
        let corner = |i: usize, k: usize| {
            let t = surface.triangles[eight[i.min(eight.len() - 1)] as usize];
            &surface.vertices[t[k] as usize]
        };
        simd.run(Triangles {
            a: std::array::from_fn(|i| corner(i, 0)),
            b: std::array::from_fn(|i| corner(i, 1)),
            c: std::array::from_fn(|i| corner(i, 2)),
            scale: surface.scale,
            out: &mut rows,
        });
        for i in 0..eight.len() {
            rows.add_to(i, &mut quadric);
        }
    }
    surface.vertices[v as usize].quadric = quadric;
    fold_quadric::hold(surface, v);
}
