//! Every format besides plain PLY: what comes in is staged as PLY, what goes out is written by a sink.
//!
//! In: STL, OBJ, gzip, zstd, standard input (`stage`). Out: PLY in any encoding, STL, OBJ, GLB (`sink`).
//! The rest of the program sees a `MeshSource` and a `MeshSink`.

mod duplicates;
mod expected;
mod face_survey;
mod glb_out;
mod lines;
mod obj;
mod obj_out;
mod obj_texture;
mod sink;
mod sort;
mod stage;
mod stl;
mod stl_out;
mod wedges;
mod weld;

pub use duplicates::{DuplicateFinder, Duplicates};
pub(crate) use expected::{Expected, expected_bytes};
pub use face_survey::{SurveyOptions, survey_faces};
pub use glb_out::GlbWriter;
pub use obj_out::ObjWriter;
pub use sink::{MeshSink, OutputFormat, OutputKind};
pub(crate) use sort::{ExternalSort, halves, whole};
pub use stage::StageOptions;
pub use stl_out::StlWriter;
pub use wedges::faces_to_vertices;
