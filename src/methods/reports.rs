//! Reports of methods other than the collapse.

use serde::{Deserialize, Serialize};

/// The part of a report that one method has.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum MethodReport {
    /// Nothing but the mesh.
    #[default]
    None,
    /// Of clustering.
    Grid(GridReport),
    /// Of removing vertices.
    Decimation(DecimationReport),
    /// Of spreading vertices evenly.
    Retiling(RetilingReport),
    /// Of contracting pairs.
    Pairs(PairsReport),
}

/// Shapes of evenly spread triangles, and the way to them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RetilingReport {
    /// The smallest angle of each triangle.
    pub angles: SpreadReport,
    /// Lengths of edges.
    pub edges: EdgesReport,
    /// Vertices of the surface after long edges were halved: those that were clustered.
    pub surface_vertices: u64,
    /// Passes over the borders of clusters.
    pub passes: u64,
    /// Clusters made two, since what they gave was no surface.
    pub split_for_topology: u64,
    /// Triangles left out at the end together with their backs.
    pub dropped_triangles: u64,
    /// Vertices added where sheets shared one.
    pub copied_vertices: u64,
}

/// Angles in degrees.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SpreadReport {
    /// The smallest.
    pub smallest: f64,
    /// The one that 1 % are below.
    pub p01: f64,
    /// The one that half are below.
    pub median: f64,
}

/// Lengths in input units.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EdgesReport {
    /// The shortest.
    pub shortest: f64,
    /// The one that half are below.
    pub median: f64,
    /// The longest.
    pub longest: f64,
}

/// Vertices that were removed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DecimationReport {
    /// Vertices without a feature edge.
    pub removed_simple: u64,
    /// Vertices on a boundary.
    pub removed_boundary: u64,
    /// Vertices between two feature edges.
    pub removed_interior_edge: u64,
    /// Corners, which only go once nothing else can.
    pub removed_corner: u64,
    /// Vertices that were removed after the first corner had to be.
    pub removed_beyond_features: u64,
    /// Removals refused because no splits filled the hole; a vertex that is tried again counts again.
    pub refused_split: u64,
    /// Removals refused because the topology would change.
    pub refused_topology: u64,
    /// Largest distance of a removed vertex, with what its neighbours had handed on to it, in input units.
    pub farthest: f64,
}

/// The grid on which vertices were clustered.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GridReport {
    /// Length of a cell, in input units.
    pub cell_size: f64,
    /// Passes over the faces, each on another grid; the last one made the result.
    pub passes: u64,
    /// Occupied cells.
    pub cells: u64,
    /// Triangles that were expected on the first grid.
    pub expected_triangles: u64,
    /// Triangles of the input that lay in one or two cells.
    pub collapsed_triangles: u64,
    /// Triangles of the input that fell on another one.
    pub repeated_triangles: u64,
    /// Triangles on which as many fell in one orientation as in the other.
    pub folded_triangles: u64,
    /// Those of them that hung on one edge alone, and were left out.
    pub fins_dropped: u64,
    /// With `--manifold`, vertices added where sheets shared one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub copied_vertices: Option<u64>,
}

/// Contractions of pairs of vertices.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PairsReport {
    /// Triangles that the collapse left for it.
    pub triangles_before: u64,
    /// Triangles that it left for the last collapse.
    pub triangles_after: u64,
    /// Pairs without an edge that were found; one that is found again counts again.
    pub virtual_pairs: u64,
    /// Edges that were contracted.
    pub contracted_edges: u64,
    /// Pairs without an edge that were.
    pub contracted_pairs: u64,
    /// Triangles that went because they came to lie on each other's backs.
    pub cancelled_triangles: u64,
    /// Contractions that would have turned a triangle over, laid it on another one, or taken a tube or a component along; a pair that is tried again counts again.
    pub refused: u64,
    /// Vertices added at the end where sheets shared one.
    pub copied_vertices: u64,
}
