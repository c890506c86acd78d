//! Settings of a run of `simplify`.

mod hole_size;
mod min_component;
mod target;

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use stonecut_io::ply::ReadOptions;
use stonecut_io::{InputPaths, Lock, NameUse, Weld};
use stonecut_kernel::{Fit, Placement, Topology};
use stonecut_mesh::placing::Placing;
use stonecut_system::memory;
use stonecut_system::units::parse_bytes;

pub use hole_size::HoleSize;
pub use min_component::MinComponent;
pub use target::{Level, Method, Target};

/// Default cell size. Cells of 128k-512k triangles are fastest (KERNEL experiments), and at this size a cell
/// on each of two cores and the finish fit into a budget of 256 MiB.
pub const DEFAULT_CELL_TRIANGLES: u64 = 256_000;

/// Default of the angle of feature edges, in degrees.
pub const FEATURE_ANGLE: f64 = 60.0;

/// Time between checkpoints, unless a test asks for another: a killed run loses well below a minute.
pub const CHECKPOINT_EVERY: std::time::Duration = std::time::Duration::from_secs(30);

/// Options of a run about its job folder and its output; final as they are typed.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub struct JobOptions {
    /// Keep the job folder after success.
    #[arg(long)]
    pub keep_temp: bool,
    /// Stop after this stage; the same command without it continues.
    #[arg(long, value_enum, value_name = "STAGE")]
    pub until: Option<Until>,
    /// Replace OUTPUT if it exists.
    #[arg(long)]
    pub force: bool,
    /// Throw away what an earlier run left and start over.
    #[arg(long)]
    pub restart: bool,
    /// Refuse a run that would leave less than this free on a disk that it writes to: 20GiB.
    #[arg(long = "min-free", value_name = "SIZE", value_parser = parse_bytes, default_value = "0", hide_default_value = true)]
    pub min_free_bytes: u64,
}

/// Options of a run that show what it has done; final as they are typed.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct CheckOptions {
    /// Measure how far the result deviates from the input, and report it. The input is the whole one, with what
    /// --min-component drops; --max-error leaves that out.
    #[arg(long)]
    pub verify: bool,
    /// Write the vertices on the seams of the first round, as a point set.
    #[arg(long, value_name = "FILE")]
    pub seams: Option<PathBuf>,
}

/// Fate of texture coordinates and images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Texture {
    /// Baked below `BAKE_BELOW` and where charts leave too many triangles, kept otherwise.
    #[default]
    Auto,
    /// The charts of the input stay, as far as triangles stay.
    Keep,
    /// The result gets charts and images made for it, filled from the input's.
    Bake,
}

/// Share of the input's triangles below which a new texture is made: of a scan reduced to 25 % its pictures are nearer to the
/// original than those of kept charts, to 50 % farther (docs/results/textures.md).
pub const BAKE_BELOW: f64 = 0.3;

/// Pages of a new texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BakeSettings {
    /// Side of a page in texels.
    pub page_size: u32,
    /// Pages at most.
    pub most_pages: Option<u32>,
    /// With normal maps.
    pub normals: bool,
}

/// Sides that pages can have.
pub const PAGE_SIZES: std::ops::RangeInclusive<u32> = 64..=16_384;

impl Default for BakeSettings {
    /// The longest side that every graphics card shows.
    fn default() -> Self {
        BakeSettings { page_size: 4096, most_pages: None, normals: false }
    }
}

/// The stage after which a run stops.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Until {
    /// Cells lie on disk.
    Partition,
    /// Cells lie on disk, and all that is to be known before they are simplified is known; for units of work.
    #[value(skip)]
    Cells,
    /// Every cell has been simplified once.
    Simplify,
    /// The result is final but not yet written.
    Stitch,
}

/// Treatment of normals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Normals {
    /// The input's, averaged and of length 1; none if it has none.
    #[default]
    Keep,
    /// Those of the result's own triangles, whether or not the input has any.
    Recompute,
    /// None.
    Drop,
}

impl Normals {
    /// The name in settings.
    fn name(self) -> &'static str {
        match self {
            Normals::Keep => "keep",
            Normals::Recompute => "recompute",
            Normals::Drop => "drop",
        }
    }
}

/// The name in settings.
fn placement_name(placement: Placement) -> &'static str {
    match placement {
        Placement::Optimal => "optimal",
        Placement::Subset => "subset",
        Placement::Midpoint => "midpoint",
    }
}

/// The name in settings.
fn topology_name(topology: Topology) -> &'static str {
    match topology {
        Topology::Keep => "keep",
        Topology::Error => "error",
    }
}

/// The name in settings.
fn fit_name(fit: Fit) -> &'static str {
    match fit {
        Fit::On => "on",
        Fit::Off => "off",
        Fit::Auto => "auto",
    }
}

/// Treatment of colours, normals and other properties.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Attributes {
    /// Weights in the error.
    pub weights: stonecut_mesh::attribute_weights::Weights,
    /// Properties that are chosen, not averaged.
    pub labels: Vec<String>,
    /// Normals are kept, computed again, or left out.
    pub normals: Normals,
}

/// Settings that mean something for methods other than the collapse.
const OF_ALL_METHODS: [&str; 5] = ["target", "skip_bad", "label", "normals", "placing"];

/// A progressive mesh beside the result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Progressive {
    /// Path of its file.
    pub path: PathBuf,
    /// Bits of coordinates and other floats; `None`: bit by bit.
    pub bits: Option<u32>,
}

/// Settings of a run of `simplify`, every value final; `Texture::Auto` alone is decided when the input is open.
#[derive(Clone, Debug)]
pub struct Config {
    /// The mesh to simplify: one file, or several that become one.
    pub input: InputPaths,
    /// Path of the result; of a chain, that of the finest level.
    pub output: PathBuf,
    /// Target of the simplification; of a chain, that of the finest level.
    pub target: Target,
    /// Further levels of a chain, each made from the one before and with fewer triangles.
    pub coarser: Vec<Level>,
    /// Method of simplification.
    pub method: Method,
    /// Contract pairs of vertices without an edge as well, at the end of the collapse.
    pub pairs: bool,
    /// Sweeps of optimisation after the method.
    pub optimize: Option<u32>,
    /// Memory budget in bytes.
    pub memory_bytes: u64,
    /// Worker threads.
    pub threads: NonZeroUsize,
    /// Triangles per cell.
    pub cell_triangles: u64,
    /// Folder of the temporary data.
    pub job_folder: PathBuf,
    /// Its end, and what may be replaced.
    pub job: JobOptions,
    /// The bound that was asked for, in input units, if this is a trial within a tighter one. A trial leaves what the first round
    /// has made, or the cells if there is none: another one begins from it.
    pub trial_of: Option<f64>,
    /// Files and measurements that show what the run has done.
    pub checks: CheckOptions,
    /// Format of the output.
    pub format: stonecut_io::OutputFormat,
    /// Drop and count broken faces and vertices instead of failing.
    pub skip_bad: bool,
    /// Give up texture coordinates at corners.
    pub drop_texture: bool,
    /// Fate of the texture if it is not given up.
    pub texture: Texture,
    /// Pages, if a new texture is made.
    pub bake: BakeSettings,
    /// Give up scalar properties of faces.
    pub drop_faces: bool,
    /// Fate of the names of objects and groups.
    pub names: NameUse,
    /// Map that is applied to the input before all else.
    pub placing: Placing,
    /// Treatment of images; by the kind of output if `None`.
    pub textures: Option<stonecut_io::TextureMode>,
    /// Path that files beside the output are named after and paths of images lead from: the output's final one.
    pub textures_beside: PathBuf,
    /// Write the distance from the input with every vertex; only with a bound on it.
    pub error_field: bool,
    /// Write a progressive mesh of the finish.
    pub progressive: Option<Progressive>,
    /// Write what became of every vertex of the input into this file.
    pub map: Option<PathBuf>,
    /// Leave out components below this.
    pub min_component: Option<MinComponent>,
    /// Fill holes up to this.
    pub close: Option<HoleSize>,
    /// Progress within a stage is made durable so often; does not change the result.
    pub checkpoint_every: std::time::Duration,
    /// Treatment of colours, normals and other properties.
    pub attributes: Attributes,
    /// Copies of vertices that become one before everything else.
    pub weld: Weld,
    /// Vertices that stay bit for bit.
    pub lock: Option<Lock>,
    /// Options of the kernel; the stop is set by the stages.
    pub kernel: stonecut_kernel::Options,
}

impl Config {
    /// True if lengths are derived from the size of the mesh.
    pub fn needs_size(&self) -> bool {
        self.close.is_some() || self.min_component.is_some()
    }

    /// Settings for reading the input.
    pub fn read_options(&self) -> ReadOptions {
        let (skip_bad, placing) = (self.skip_bad, self.placing.clone());
        ReadOptions { skip_bad, placing, temp_dir: None, names: self.names }
    }

    /// Settings of a run with the defaults of the command: all cores, the default budget, the job folder beside `output`.
    ///
    /// ```no_run
    /// use stonecut_store::config::{Config, Target};
    ///
    /// let mut config = Config::new("scan.ply", "small.ply", Target::Ratio(0.01));
    /// config.memory_bytes = 4 << 30;
    /// ```
    pub fn new(input: impl Into<InputPaths>, output: impl Into<PathBuf>, target: Target) -> Config {
        let output = output.into();
        let mut job_folder = output.clone().into_os_string();
        job_folder.push(".stonecut-job");
        Config {
            input: input.into(),
            target,
            coarser: Vec::new(),
            method: Method::default(),
            pairs: false,
            optimize: None,
            memory_bytes: memory::budget_bytes(None, memory::limit_bytes()),
            threads: NonZeroUsize::new(memory::cores()).unwrap_or(NonZeroUsize::MIN),
            cell_triangles: DEFAULT_CELL_TRIANGLES,
            job_folder: job_folder.into(),
            job: JobOptions::default(),
            trial_of: None,
            checks: CheckOptions::default(),
            format: Default::default(),
            skip_bad: false,
            drop_texture: false,
            texture: Texture::default(),
            bake: BakeSettings::default(),
            drop_faces: false,
            names: NameUse::Carried,
            placing: Placing::default(),
            textures: None,
            textures_beside: output.clone(),
            error_field: false,
            progressive: None,
            map: None,
            min_component: None,
            close: None,
            checkpoint_every: CHECKPOINT_EVERY,
            attributes: Attributes::default(),
            weld: Weld::Auto,
            lock: None,
            kernel: Default::default(),
            output,
        }
    }

    /// Every setting that changes the result, by name.
    ///
    /// Names and values are stored: in job folders, which refuse to be continued with others, in headers of outputs and in reports
    /// (docs/report.md). A test holds them; whoever changes one raises `FORMAT_VERSION` of the manifest.
    pub fn settings(&self) -> BTreeMap<String, String> {
        let carried = |is_dropped: bool| if is_dropped { "drop" } else { "carry" }.to_owned();
        let is_baked = self.texture == Texture::Bake;
        let texture = if is_baked { "bake".to_owned() } else { carried(self.drop_texture) };
        let mut settings = BTreeMap::from([
            ("target".to_owned(), self.target.to_string()),
            ("cell_triangles".to_owned(), self.cell_triangles.to_string()),
            ("skip_bad".to_owned(), self.skip_bad.to_string()),
            ("placement".to_owned(), placement_name(self.kernel.placement).to_owned()),
            ("merge_distance".to_owned(), self.kernel.merge_distance.to_string()),
            ("weight".to_owned(), self.attributes.weights.to_string()),
            ("texture".to_owned(), texture),
            ("faces".to_owned(), carried(self.drop_faces)),
            ("label".to_owned(), self.attributes.labels.join(",")),
            ("normals".to_owned(), self.attributes.normals.name().to_owned()),
            ("topology".to_owned(), topology_name(self.kernel.topology).to_owned()),
            ("fit".to_owned(), fit_name(self.kernel.fit).to_owned()),
        ]);
        if let (Some(bound), Target::Triangles(_) | Target::Ratio(_)) =
            (self.kernel.bound, self.target)
        {
            let asked = self.trial_of.unwrap_or(bound.distance);
            settings.insert("max_error".to_owned(), asked.to_string());
        }
        if is_baked {
            settings.insert("bake_size".to_owned(), self.bake.page_size.to_string());
            if let Some(most) = self.bake.most_pages {
                settings.insert("bake_pages".to_owned(), most.to_string());
            }
            if self.bake.normals {
                settings.insert("bake_normals".to_owned(), "true".to_owned());
            }
        }
        if let Some(mode) = self.textures {
            settings.insert("textures".to_owned(), mode.name().to_owned());
        }
        if !self.coarser.is_empty() {
            settings.insert("coarser".to_owned(), list(self.coarser.iter().map(|l| l.target)));
        }
        if self.kernel.no_self_intersections {
            settings.insert("self_intersections".to_owned(), "refuse".to_owned());
        }
        if let Some(size) = self.close {
            settings.insert("close".to_owned(), size.to_string());
        }
        if self.kernel.orient {
            settings.insert("orient".to_owned(), "true".to_owned());
        }
        if !self.placing.is_none() {
            settings.insert("placing".to_owned(), self.placing.setting());
        }
        if self.names == NameUse::GivenUp("") && !self.drop_faces {
            settings.insert("names".to_owned(), carried(true));
        }
        if self.error_field {
            settings.insert("error_field".to_owned(), "true".to_owned());
        }
        if let Some(progressive) = &self.progressive {
            let bits = progressive.bits.map_or("exact".to_owned(), |bits| bits.to_string());
            settings.insert("progressive".to_owned(), bits);
        }
        if let Some(least) = self.min_component {
            settings.insert("min_component".to_owned(), least.to_string());
        }
        if self.method != Method::Collapse {
            settings.retain(|name, _| OF_ALL_METHODS.contains(&name.as_str()));
            settings.insert("method".to_owned(), self.method.name().to_owned());
            let own = match self.method {
                Method::Collapse | Method::Cluster { manifold: false } => None,
                Method::Cluster { manifold } => Some(("manifold", manifold.to_string())),
                Method::Decimate { feature_angle } => {
                    Some(("feature_angle", feature_angle.to_string()))
                }
                Method::Retile { gradation } => Some(("gradation", gradation.to_string())),
            };
            settings.extend(own.map(|(name, value)| (name.to_owned(), value)));
        }
        if self.weld != Weld::Auto {
            settings.insert("weld".to_owned(), self.weld.to_string());
        }
        if let Some(lock) = &self.lock {
            settings.insert("lock".to_owned(), lock.to_string());
        }
        if self.pairs {
            settings.insert("pairs".to_owned(), true.to_string());
        }
        if let Some(sweeps) = self.optimize {
            settings.insert("optimize".to_owned(), sweeps.to_string());
        }
        settings
    }

    /// Every setting that level `number` of a chain depends on: the first one is that of a run to its target alone.
    pub fn settings_of_level(&self, number: usize) -> BTreeMap<String, String> {
        let mut settings = self.settings();
        settings.remove("coarser");
        if let Some(level) = number.checked_sub(1).and_then(|k| self.coarser.get(k)) {
            let finer = self.coarser[..number - 1].iter().map(|level| level.target);
            settings.insert("finer".to_owned(), list(std::iter::once(self.target).chain(finer)));
            settings.insert("target".to_owned(), level.target.to_string());
        }
        settings
    }

    /// The kind of the outputs: as asked for, or by name.
    ///
    /// Errors: `Usage` for a name that is not that of a mesh.
    pub fn kind(&self) -> stonecut_system::Result<stonecut_io::OutputKind> {
        let kind = self.format.kind;
        kind.map_or_else(|| stonecut_io::OutputKind::of(&self.output), Ok)
    }

    /// The final paths of the outputs, which files beside them are named after.
    pub fn named_outputs(&self) -> impl Iterator<Item = &PathBuf> {
        std::iter::once(&self.textures_beside).chain(self.coarser.iter().map(|level| &level.output))
    }

    /// The outputs, finest first.
    pub fn outputs(&self) -> impl Iterator<Item = &PathBuf> {
        std::iter::once(&self.output).chain(self.coarser.iter().map(|level| &level.output))
    }

    /// The targets, finest first.
    pub fn targets(&self) -> impl Iterator<Item = Target> {
        std::iter::once(self.target).chain(self.coarser.iter().map(|level| level.target))
    }
}

/// Targets as they are stored in settings.
fn list(targets: impl Iterator<Item = Target>) -> String {
    targets.map(|target| target.to_string()).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config() -> Config {
        Config {
            texture: Texture::Keep,
            ..Config::new("in.ply", "out.ply", Target::Triangles(10_035))
        }
    }

    /// Stored in job folders and outputs: see `Config::settings` before you change a line.
    #[test]
    fn settings_have_the_names_that_are_stored() {
        let lines = |config: &Config| -> Vec<String> {
            config.settings().iter().map(|(name, value)| format!("{name}={value}")).collect()
        };
        let expected = [
            "cell_triangles=256000",
            "faces=carry",
            "fit=auto",
            "label=",
            "merge_distance=0",
            "normals=keep",
            "placement=optimal",
            "skip_bad=false",
            "target=triangles=10035",
            "texture=carry",
            "topology=error",
            "weight=color=1,normal=0,uv=1",
        ];
        assert_eq!(lines(&config()), expected);
        let mut other = config();
        other.target = Target::Ratio(0.01);
        (other.skip_bad, other.drop_texture, other.drop_faces) = (true, true, true);
        other.min_component = Some(MinComponent::Share(0.001));
        other.attributes.normals = Normals::Recompute;
        other.attributes.labels = vec!["class".to_owned(), "part".to_owned()];
        other.kernel.placement = Placement::Subset;
        other.kernel.topology = Topology::Keep;
        other.kernel.fit = Fit::Off;
        let expected = [
            "cell_triangles=256000",
            "faces=drop",
            "fit=off",
            "label=class,part",
            "merge_distance=0",
            "min_component=size=0.1%",
            "normals=recompute",
            "placement=subset",
            "skip_bad=true",
            "target=ratio=0.01",
            "texture=drop",
            "topology=keep",
            "weight=color=1,normal=0,uv=1",
        ];
        assert_eq!(lines(&other), expected);
        assert_eq!(Target::MaxError(0.5).to_string(), "max_error=0.5");
        other.textures = Some(stonecut_io::TextureMode::Link);
        assert_eq!(other.settings()["textures"], "link");
        other.texture = Texture::Bake;
        (other.bake.most_pages, other.bake.normals) = (Some(3), true);
        let settings = other.settings();
        let names = ["texture", "bake_size", "bake_pages", "bake_normals"];
        assert_eq!(names.map(|name| settings[name].as_str()), ["bake", "4096", "3", "true"]);
        other.texture = Texture::Keep;
        let clusters = Config {
            method: Method::Cluster { manifold: false },
            target: Target::CellSize(2.5),
            ..config()
        };
        let expected =
            ["label=", "method=cluster", "normals=keep", "skip_bad=false", "target=grid=2.5"];
        assert_eq!(lines(&clusters), expected);
        let decimates =
            Config { method: Method::Decimate { feature_angle: FEATURE_ANGLE }, ..config() };
        assert!(lines(&decimates).contains(&"feature_angle=60".to_owned()));
        other.attributes.normals = Normals::Drop;
        other.kernel.placement = Placement::Midpoint;
        other.kernel.fit = Fit::On;
        let settings = other.settings();
        let named = ["normals", "placement", "fit"].map(|name| settings[name].as_str());
        assert_eq!(named, ["drop", "midpoint", "on"]);
    }

    #[test]
    fn counts_and_sizes_of_components_cannot_be_confused() {
        let parse = |text: &str| text.parse::<MinComponent>();
        assert_eq!(parse("300"), Ok(MinComponent::Triangles(300)));
        assert_eq!(parse("1.5k"), Ok(MinComponent::Triangles(1500)));
        assert_eq!(parse("size=300"), Ok(MinComponent::Size(300.0)));
        assert_eq!(parse("size=2.5e-3"), Ok(MinComponent::Size(0.0025)));
        assert_eq!(parse("size=0.5%"), Ok(MinComponent::Share(0.005)));
        for wrong in
            ["", "2.5", "0.1%", "2.5mm", "size=", "size=-1", "size=NaN", "size=2k", "size=200%"]
        {
            let error = parse(wrong).unwrap_err();
            assert!(error.contains("size=2.5"), "{wrong}: {error}");
        }
        for text in ["300", "size=0.1", "size=12.5%"] {
            assert_eq!(parse(text).unwrap().to_string(), text);
        }
    }
}
