//! Every format besides plain PLY: what comes in is staged as PLY, what goes out is written by a sink.
//!
//! In: STL, OBJ, gzip, zstd, standard input (`open`). Out: PLY in any encoding, STL, OBJ, GLB (`sink`).
//! The rest of the program sees a `MeshSource` and a `MeshSink`.

mod borders;
mod by_material;
mod containers;
mod degrees;
mod duplicates;
mod encodings;
mod expected_size;
mod extent;
mod external_sort;
mod face_labels;
mod face_survey;
mod front_door;
pub mod globe;
mod gltf;
mod hard_edges;
mod heights;
pub mod join;
mod label_survey;
mod lock;
pub mod materials;
mod names;
pub mod npy;
mod obj;
mod open;
mod open_edges;
mod open_options;
mod output_format;
pub mod ply;
mod polygon;
mod records;
mod restaged;
mod rounding;
pub mod sidecars;
mod sink;
mod stl;
mod text_lines;
pub mod tileset;
mod wedges;
mod weld;
mod wkt;

pub use degrees::degrees_remark;
pub use duplicates::{DuplicateFinder, Duplicates};
pub use expected_size::{Expected, expected_bytes, refuse_too_large};
pub use external_sort::{ExternalSort, halves, whole};
pub use face_labels::{FaceLabels, SIDES};
pub use face_survey::{SurveyOptions, survey_faces};
pub use gltf::{
    GlbWriter, StoredPage, StoredTile, TileForm, TileMesh, TilePage, TileScalar, decode_tile,
    decode_tile_within, encode_tile,
};
pub use join::{InputPaths, InputSet, MeshPart};
pub use label_survey::survey_labels;
pub use materials::NUMBER;
pub use materials::{TextureMode, TexturePlan, TextureRequest};
pub use names::{NameUse, OBJECT, lost_comments};
pub use obj::ObjWriter;
pub use obj::{find_texture, find3};
pub use open_options::{HardEdges, Lock, StageOptions, Weld, WeldOptions};
pub use output_format::{OutputFormat, OutputKind};
pub use records::NumberRecords;
pub use rounding::check_range;
pub use sink::{MeshSink, hidden_colours};
pub use stl::StlWriter;
pub use wedges::faces_to_vertices;
pub use weld::weld as weld_vertices;
