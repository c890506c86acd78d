//! The tools that are compared: where they are, which version, how they are called.

use crate::Outcome;
use std::path::{Path, PathBuf};
use std::process::Command;

/// How a tool is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The program itself, from file to file.
    Stonecut,
    /// A Rust library, through a process of this harness.
    Inside,
    /// A Python package, through `peers/peer.py`.
    Python,
    /// The C++ driver.
    Cgal,
}

/// One tool.
#[derive(Clone, Copy, Debug)]
pub struct Peer {
    /// Its name in tables and options.
    pub name: &'static str,
    /// How it is called.
    pub kind: Kind,
    /// Whether its results are taken from the cache if they are there.
    pub slow: bool,
}

const fn peer(name: &'static str, kind: Kind, slow: bool) -> Peer {
    Peer { name, kind, slow }
}

/// All tools, ours first.
pub const PEERS: [Peer; 12] = [
    peer("stonecut", Kind::Stonecut, false),
    peer("kernel", Kind::Inside, false),
    peer("kernel-fit", Kind::Inside, false),
    peer("kernel-keep", Kind::Inside, false),
    peer("reference", Kind::Inside, true),
    peer("meshopt", Kind::Inside, false),
    peer("meshopt-update", Kind::Inside, false),
    peer("fast-simplification", Kind::Python, false),
    peer("meshlib", Kind::Python, false),
    peer("vtk", Kind::Python, true),
    peer("pymeshlab", Kind::Python, true),
    peer("cgal-lt", Kind::Cgal, true),
];

/// Python packages of the peers, as pip knows them.
const PACKAGES: [&str; 5] = ["numpy", "fast-simplification", "meshlib", "vtk", "pymeshlab"];

/// The crate version in `Cargo.toml`; part of the key of cached results.
const MESHOPT_VERSION: &str = "crate 0.7";

/// Where programs are.
#[derive(Clone, Debug)]
pub struct Places {
    /// The stonecut under test.
    pub stonecut: PathBuf,
    /// What `bench peers install` made.
    pub tools: PathBuf,
    /// This program.
    pub bench: PathBuf,
}

impl Places {
    /// Defaults: stonecut beside this program, tools in `target/bench`.
    pub fn find(stonecut: Option<&Path>, tools: Option<&Path>) -> Outcome<Places> {
        let bench = std::env::current_exe()?;
        let stonecut = stonecut.map_or_else(|| bench.with_file_name("stonecut"), Path::to_path_buf);
        if !stonecut.is_file() {
            let what = "is not there: build it (cargo build --release) or give --stonecut";
            return Err(format!("{} {what}", stonecut.display()).into());
        }
        let tools = tools.map_or_else(|| root().join("target/bench"), Path::to_path_buf);
        std::fs::create_dir_all(&tools)?;
        Ok(Places { stonecut: stonecut.canonicalize()?, tools: tools.canonicalize()?, bench })
    }

    fn python(&self) -> PathBuf {
        self.tools.join("venv/bin/python")
    }

    fn cgal(&self) -> PathBuf {
        self.tools.join("cgal_lt")
    }

    /// The command without arguments of its own.
    fn base(&self, peer: &Peer) -> Vec<String> {
        let words: Vec<PathBuf> = match peer.kind {
            Kind::Stonecut => vec![self.stonecut.clone()],
            Kind::Inside => vec![self.bench.clone(), "peer".into(), peer.name.into()],
            Kind::Python => vec![self.python(), sources().join("peer.py"), peer.name.into()],
            Kind::Cgal => vec![self.cgal()],
        };
        words.iter().map(|word| word.display().to_string()).collect()
    }

    /// The version of an installed tool; `None` if it is missing or does not start.
    pub fn version(&self, peer: &Peer) -> Option<String> {
        if peer.kind == Kind::Inside {
            let own = peer.name.starts_with("kernel") || peer.name == "reference";
            let version = if own { env!("CARGO_PKG_VERSION") } else { MESHOPT_VERSION };
            return Some(version.to_owned());
        }
        let mut words = self.base(peer);
        words.push("--version".to_owned());
        let output = Command::new(&words[0]).args(&words[1..]).output().ok()?;
        let said = String::from_utf8_lossy(&output.stdout);
        // «stonecut 0.1.0» and the like: the last word is the version.
        let said = said.split_whitespace().last().unwrap_or_default().to_owned();
        (output.status.success() && !said.is_empty()).then_some(said)
    }

    /// The command for one run; raw meshes, but for stonecut, which is given files of its own kind.
    pub fn command(&self, peer: &Peer, input: &Path, output: &Path, target: u64) -> Vec<String> {
        let mut words = self.base(peer);
        let (input, output) = (input.display().to_string(), output.display().to_string());
        let target = target.to_string();
        match peer.kind {
            Kind::Stonecut => {
                words.extend(["simplify".to_owned(), input, output, "--triangles".to_owned()]);
                words.push(target);
            }
            _ => words.extend([input, output, target]),
        }
        words
    }
}

/// The root of the working tree.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn sources() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("peers")
}

/// Looks names up; all tools if there are none.
pub fn named(names: &[String]) -> Outcome<Vec<Peer>> {
    if names.is_empty() {
        return Ok(PEERS.to_vec());
    }
    let find = |name: &String| {
        PEERS.iter().find(|peer| peer.name == name).copied().ok_or_else(|| {
            let known: Vec<_> = PEERS.iter().map(|peer| peer.name).collect();
            format!("no peer is named {name}; known are {}", known.join(", ")).into()
        })
    };
    names.iter().map(find).collect()
}

/// Makes the virtual environment and the C++ driver; what cannot be had is said and left out.
pub fn install(tools: Option<&Path>) -> Outcome<()> {
    let tools = tools.map_or_else(|| root().join("target/bench"), Path::to_path_buf);
    std::fs::create_dir_all(&tools)?;
    let python = tools.join("venv/bin/python");
    if !python.is_file() {
        step("python3", &["-m", "venv", &tools.join("venv").display().to_string()]);
    }
    // One by one: a package without a wheel for this machine must not keep out the others.
    for package in PACKAGES {
        step(&python.display().to_string(), &["-m", "pip", "install", "--quiet", package]);
    }
    let source = sources().join("cgal_lt.cpp").display().to_string();
    let program = tools.join("cgal_lt").display().to_string();
    let flags = ["-O3", "-DNDEBUG", "-march=native", &source, "-o", &program, "-lgmp", "-lmpfr"];
    if !step("g++", &flags) {
        eprintln!("bench: CGAL needs g++ and libcgal-dev");
    }
    Ok(())
}

fn step(program: &str, arguments: &[&str]) -> bool {
    eprintln!("bench: {program} {}", arguments.join(" "));
    let worked =
        Command::new(program).args(arguments).status().is_ok_and(|status| status.success());
    if !worked {
        eprintln!("bench: that failed; the peer will be missing");
    }
    worked
}

/// Prints which tools there are.
pub fn list(places: &Places) {
    for peer in &PEERS {
        let version = places.version(peer).unwrap_or_else(|| "not installed".to_owned());
        println!("{:<22}{version}", peer.name);
    }
}
