//! The scene of a glTF file: which mesh stands where.

use super::json::{Document, Node};
use crate::ply::raw::RawFile;
use stonecut_system::error::Result;

/// Meshes in a scene, at most.
pub(super) const MAX_PLACED: usize = 1 << 20;

/// Linear part by rows, and translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct NodePlacement {
    pub(super) rows: [[f64; 3]; 3],
    pub(super) shift: [f64; 3],
}

/// A mesh in its place.
pub(super) struct Placed {
    pub(super) mesh: usize,
    /// The node that has it.
    pub(super) node: usize,
    pub(super) at: NodePlacement,
}

impl NodePlacement {
    const NONE: NodePlacement = NodePlacement {
        rows: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        shift: [0.0; 3],
    };

    /// The local placement of a node.
    fn of(node: &Node) -> NodePlacement {
        if let Some(m) = &node.matrix {
            return NodePlacement::of_matrix(m);
        }
        NodePlacement::new(
            node.translation.unwrap_or_default(),
            node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]),
            node.scale.unwrap_or([1.0; 3]),
        )
    }

    /// The placement of a matrix whose columns come one after another.
    pub(super) fn of_matrix(m: &[f64; 16]) -> NodePlacement {
        let rows = [0, 1, 2].map(|r| [0, 1, 2].map(|c| m[4 * c + r]));
        NodePlacement { rows, shift: [m[12], m[13], m[14]] }
    }

    /// Scaled, then turned by a quaternion, then shifted.
    pub(super) fn new(shift: [f64; 3], [x, y, z, w]: [f64; 4], scale: [f64; 3]) -> NodePlacement {
        let turn = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let rows = turn.map(|row| [0, 1, 2].map(|c| row[c] * scale[c]));
        NodePlacement { rows, shift }
    }

    /// The image of a point.
    pub(super) fn point(&self, p: [f64; 3]) -> [f64; 3] {
        let turned = self.direction(p);
        [0, 1, 2].map(|r| turned[r] + self.shift[r])
    }

    /// This one, shifted.
    pub(super) fn moved(&self, by: [f64; 3]) -> NodePlacement {
        NodePlacement { rows: self.rows, shift: [0, 1, 2].map(|r| self.shift[r] + by[r]) }
    }

    fn direction(&self, p: [f64; 3]) -> [f64; 3] {
        self.rows.map(|row| row[0] * p[0] + row[1] * p[1] + row[2] * p[2])
    }

    /// This one inside another.
    pub(super) fn inside(&self, outer: &NodePlacement) -> NodePlacement {
        let column =
            |c: usize| outer.direction([self.rows[0][c], self.rows[1][c], self.rows[2][c]]);
        let columns = [column(0), column(1), column(2)];
        let rows = [0, 1, 2].map(|r| [0, 1, 2].map(|c| columns[c][r]));
        NodePlacement { rows, shift: outer.point(self.shift) }
    }

    fn cofactors(&self) -> [[f64; 3]; 3] {
        let m = &self.rows;
        let minor = |r: usize, c: usize| {
            let [(r1, r2), (c1, c2)] = [r, c].map(|i| ((i + 1) % 3, (i + 2) % 3));
            m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
        };
        [0, 1, 2].map(|r| [0, 1, 2].map(|c| minor(r, c)))
    }

    /// Rows of the matrix that turns normals, up to their length. A mirror keeps them outside.
    pub(super) fn of_normals(&self) -> [[f64; 3]; 3] {
        let sign = if self.is_mirror() { -1.0 } else { 1.0 };
        self.cofactors().map(|row| row.map(|x| sign * x))
    }

    /// Returns whether it is a mirror, which turns faces around.
    pub(super) fn is_mirror(&self) -> bool {
        let cofactors = self.cofactors();
        (0..3).map(|c| self.rows[0][c] * cofactors[0][c]).sum::<f64>() < 0.0
    }
}

/// All meshes of the scene, in the order of the nodes; without scenes, all nodes that no node has as a child. And the places of all
/// nodes of the scene.
pub(super) fn placed(
    file: &RawFile,
    document: &Document,
) -> Result<(Vec<Placed>, Vec<Option<NodePlacement>>)> {
    let nodes = &document.nodes;
    let roots: Vec<usize> = match document.scenes.get(document.scene.unwrap_or(0)) {
        Some(scene) => scene.nodes.clone(),
        None => {
            let mut is_child = vec![false; nodes.len()];
            let children = nodes.iter().flat_map(|node| &node.children);
            children.for_each(|&child| {
                if let Some(mark) = is_child.get_mut(child) {
                    *mark = true;
                }
            });
            (0..nodes.len()).filter(|&i| !is_child[i]).collect()
        }
    };
    let mut places = vec![None; nodes.len()];
    let mut open: Vec<(usize, NodePlacement)> =
        roots.into_iter().rev().map(|root| (root, NodePlacement::NONE)).collect();
    let mut out = Vec::new();
    while let Some((number, outer)) = open.pop() {
        let Some(node) = nodes.get(number) else {
            return Err(file.bad(format!("node {number}, which the scene names, does not exist")));
        };
        let at = NodePlacement::of(node).inside(&outer);
        if places[number].replace(at).is_some() {
            return Err(file.bad(format!(
                "node {number} has two parents or is part of a circle; glTF wants a tree"
            )));
        }
        if let Some(mesh) = node.mesh {
            out.push(Placed { mesh, node: number, at });
        }
        if out.len() > MAX_PLACED {
            return Err(file.bad(format!("more than {MAX_PLACED} nodes have a mesh")));
        }
        open.extend(node.children.iter().rev().map(|&child| (child, at)));
    }
    Ok((out, places))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placements_nest() {
        let text = r#"{"nodes": [
            {"translation": [1, 0, 0], "children": [1]},
            {"rotation": [0, 0, 0.7071067811865476, 0.7071067811865476], "scale": [2, 2, -2], "mesh": 0}
        ]}"#;
        let document: Document = serde_json::from_str(text).unwrap();
        let file = RawFile::from_bytes("a.gltf", Vec::new());
        let (placed, _) = placed(&file, &document).unwrap();
        let point = placed[0].at.point([1.0, 0.0, 1.0]);
        let wanted = [1.0, 2.0, -2.0];
        assert!(point.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-12), "{point:?}");
        assert!(placed[0].at.is_mirror());
        // Upwards in the file, and so downwards behind the mirror.
        let normal = placed[0].at.of_normals().map(|row| row[2]);
        assert!(normal[2] < 0.0 && normal[0].abs() + normal[1].abs() < 1e-12, "{normal:?}");
    }

    #[test]
    fn circles_of_nodes_are_refused() {
        let file = RawFile::from_bytes("a.gltf", Vec::new());
        for text in [
            r#"{"scenes": [{"nodes": [0]}], "nodes": [{"children": [1]}, {"children": [0]}]}"#,
            r#"{"scenes": [{"nodes": [0]}], "nodes": [{"children": [7]}]}"#,
        ] {
            let document: Document = serde_json::from_str(text).unwrap();
            let error = placed(&file, &document).err().unwrap();
            assert!(error.to_string().contains("node "), "{error}");
        }
    }
}
