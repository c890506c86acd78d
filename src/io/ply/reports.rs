//! Reports on how a mesh was made ready: the files that became it, and vertices that were joined.

/// Outcome of the weld.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct WeldReport {
    /// Vertices in the file.
    pub vertices: u64,
    /// Vertices that became one with another.
    pub joined: u64,
    /// Distance within which vertices were joined, in input units; 0 if none were.
    pub distance: f64,
    /// Observations, for people.
    pub notes: Vec<String>,
}

/// A file of several that became one mesh.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct PartReport {
    /// As given.
    pub path: String,
    /// Vertices in it.
    pub vertices: u64,
    /// Triangles in it.
    pub triangles: u64,
}
