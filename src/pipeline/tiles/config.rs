//! Decided settings of a run of `tiles`: every value final.

use crate::bake::BasisCoding;
use crate::config::CHECKPOINT_EVERY;
use crate::io::ply::ReadOptions;
use crate::io::{InputPaths, NameUse, Weld};
use crate::mesh::placing::{Degrees, Placing};
use crate::system::memory;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Triangles of a tile, unless another number is asked for.
pub const TILE_TRIANGLES: u64 = 16_000;

/// Recorded in the job before the folder gets its name: the checksum of its first file of JSON.
pub(super) const NAMED: &str = "tiles named";

/// The finest level that is kept.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Finest {
    /// The input.
    #[default]
    Input,
    /// A share of its triangles.
    Ratio(f64),
    /// A number of triangles.
    Triangles(u64),
}

/// Look of tiles of an input with images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TileTexture {
    /// Pages where the input has images that can be used.
    #[default]
    Auto,
    /// A page for each tile.
    Bake,
    /// Colours of vertices.
    Colors,
}

/// A run of `tiles`.
#[derive(Clone, Debug)]
pub struct TilesConfig {
    /// The mesh: one file, or several that become one.
    pub input: InputPaths,
    /// The folder of the tree.
    pub output: PathBuf,
    /// Triangles of a tile, about.
    pub tile_triangles: u64,
    /// The finest level that is kept.
    pub finest: Finest,
    /// Look of tiles of an input with images.
    pub texture: TileTexture,
    /// KTX2 files with this coding as pages, instead of JPEG and PNG.
    pub coding: Option<BasisCoding>,
    /// Pixels that the distance from the input may have on the screen of a viewer with its defaults.
    pub pixels: f64,
    /// Packs tiles with EXT_meshopt_compression.
    pub packs: bool,
    /// True if z points upwards in the mesh, false if y does.
    pub is_z_up: bool,
    /// From the frame of the mesh, z upwards, to that of the world; by columns.
    pub transform: [f64; 16],
    /// The coordinate reference system of the mesh, which takes the place of `transform`: `EPSG:n`, or `ENU:LAT,LON` for east and
    /// north at a place. The offset that the mesh names is added to its coordinates.
    pub crs: Option<String>,
    /// Write a page that shows the tree.
    pub viewer: bool,
    /// Memory budget in bytes.
    pub memory_bytes: u64,
    /// Worker threads.
    pub threads: NonZeroUsize,
    /// Folder of the temporary data.
    pub job_folder: PathBuf,
    /// Leave the job folder in place after success.
    pub keep_temp: bool,
    /// Replace an earlier tree.
    pub force: bool,
    /// Throw away what an earlier run left.
    pub restart: bool,
    /// Drop and count broken faces and vertices instead of failing.
    pub skip_bad: bool,
    /// Map that is applied to the input before all else.
    pub placing: Placing,
    /// Copies of vertices that become one before everything else.
    pub weld: Weld,
    /// Progress within a stage is made durable so often; does not change the result.
    pub checkpoint_every: std::time::Duration,
}

impl TilesConfig {
    /// Settings of a run with the defaults of the command: all cores, the default budget, the job folder beside `output`.
    pub fn new(input: impl Into<InputPaths>, output: impl Into<PathBuf>) -> TilesConfig {
        let output = output.into();
        let mut job_folder = output.clone().into_os_string();
        job_folder.push(".stonecut-job");
        let mut placing = Placing::default();
        placing.turns_up = true;
        TilesConfig {
            input: input.into(),
            output,
            tile_triangles: TILE_TRIANGLES,
            finest: Finest::default(),
            texture: TileTexture::default(),
            coding: None,
            pixels: 1.0,
            packs: true,
            is_z_up: true,
            transform: [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.],
            crs: None,
            viewer: false,
            memory_bytes: memory::budget_bytes(None, memory::limit_bytes()),
            threads: NonZeroUsize::new(memory::cores()).unwrap_or(NonZeroUsize::MIN),
            job_folder: job_folder.into(),
            keep_temp: false,
            force: false,
            restart: false,
            skip_bad: false,
            placing,
            weld: Weld::Auto,
            checkpoint_every: CHECKPOINT_EVERY,
        }
    }

    /// Settings for reading the input.
    pub fn read_options(&self) -> ReadOptions {
        let mut placing = self.placing.clone();
        if placing.degrees == Degrees::Kept && self.crs.is_some() {
            let is_y_up = Some(!self.is_z_up);
            placing.degrees = Degrees::Metres { system: self.crs.clone(), is_y_up };
        }
        ReadOptions {
            skip_bad: self.skip_bad,
            placing,
            temp_dir: None,
            names: NameUse::GivenUp("not carried by tiles"),
        }
    }

    /// Every setting that changes the result, by name.
    pub fn settings(&self) -> BTreeMap<String, String> {
        let transform: Vec<String> = self.transform.iter().map(f64::to_string).collect();
        let mut settings = BTreeMap::from([
            ("command".to_owned(), "tiles".to_owned()),
            ("tile_triangles".to_owned(), self.tile_triangles.to_string()),
            ("pixels".to_owned(), self.pixels.to_string()),
            ("compress".to_owned(), if self.packs { "meshopt" } else { "none" }.to_owned()),
            ("up".to_owned(), if self.is_z_up { "z" } else { "y" }.to_owned()),
            ("transform".to_owned(), transform.join(",")),
            ("skip_bad".to_owned(), self.skip_bad.to_string()),
            ("viewer".to_owned(), self.viewer.to_string()),
        ]);
        // Left out where nothing was asked for, so that jobs of earlier builds are continued.
        if let Some(code) = &self.crs {
            settings.insert("crs".to_owned(), code.clone());
        }
        if !self.placing.is_none() {
            settings.insert("placing".to_owned(), self.placing.setting());
        }
        match self.finest {
            Finest::Input => None,
            Finest::Ratio(ratio) => settings.insert("finest".to_owned(), ratio.to_string()),
            Finest::Triangles(n) => settings.insert("finest".to_owned(), format!("{n} triangles")),
        };
        if let Some(coding) = self.coding {
            settings.insert("textures".to_owned(), format!("{coding:?}").to_lowercase());
        }
        if self.weld != Weld::Auto {
            settings.insert("weld".to_owned(), self.weld.to_string());
        }
        settings
    }

    /// The folder that is written before it gets its name.
    pub fn pending_output(&self) -> PathBuf {
        let mut name = std::ffi::OsString::from(".");
        name.push(self.output.file_name().unwrap_or_default());
        name.push(".stonecut-tiles");
        self.output.with_file_name(name)
    }
}
