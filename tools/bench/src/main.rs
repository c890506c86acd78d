//! The benchmark harness: stonecut and its peers side by side, scaling, a billion triangles.
//!
//! `cargo run --release -p stonecut-bench -- COMMAND`. docs/design/bench.md tells what the numbers mean.

mod bench;
mod billion;
mod child;
mod cluster;
mod colours;
mod compare;
mod forecast;
mod inside;
mod judge;
mod meshes;
mod optimum;
mod page;
mod peers;
mod plot;
mod record;
mod scaling;

use bench::{Reuse, Settings};
use clap::{Args, Parser, Subcommand};
use peers::Places;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stonecut::system::units::{parse_bytes, parse_count, parse_ratio};

/// What may fail here, fails with a sentence for people.
pub type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Runs stonecut and its peers side by side and writes tables and plots.
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Installs the peers, or lists them
    Peers {
        #[command(subcommand)]
        command: PeersCommand,
    },
    /// Runs stonecut and its peers side by side on meshes
    Compare(Comparing),
    /// Runs the kernel and its peers on meshes in memory, and writes the tables of docs/results/kernel.md
    KernelTables(Comparing),
    /// Runs stonecut on growing synthetic meshes at a fixed budget
    Scaling {
        /// terrain, statue, gyroid, scans
        #[arg(long, value_delimiter = ',', default_value = "statue,terrain")]
        kinds: Vec<String>,
        #[arg(long, value_delimiter = ',', default_value = "1M,4M,16M,64M")]
        sizes: Vec<String>,
        /// Numbers of threads, interleaved
        #[arg(long = "threads", value_delimiter = ',', default_value = "1,2")]
        counts: Vec<u64>,
        #[arg(long, value_parser = parse_ratio, default_value = "1%")]
        ratio: f64,
        /// Also with vertices and faces in random order
        #[arg(long)]
        shuffled: bool,
        /// Do not measure errors of larger inputs
        #[arg(long, value_parser = parse_count, default_value = "64M")]
        measure_up_to: u64,
        #[command(flatten)]
        common: Common,
    },
    /// Simplifies one huge synthetic mesh inside a memory cgroup and writes a page with log and report
    Billion {
        #[arg(long, default_value = "statue")]
        kind: String,
        #[arg(long, value_parser = parse_count, default_value = "1G")]
        triangles: u64,
        /// Targets, one run each
        #[arg(long, value_delimiter = ',', value_parser = parse_count, default_value = "10M,1M")]
        to: Vec<u64>,
        #[arg(long, value_parser = parse_bytes, default_value = "2GiB")]
        memory: u64,
        /// Limit of the cgroup, page cache included
        #[arg(long, value_parser = parse_size, default_value = "2.5GiB")]
        cgroup: u64,
        #[arg(long)]
        threads: Option<u64>,
        /// Samples a side for the error; 0: not measured
        #[arg(long, value_parser = parse_count, default_value = "0")]
        samples: u64,
        /// Keep the input
        #[arg(long)]
        keep: bool,
        /// Scratch space [default: target/bench/work]
        #[arg(long)]
        work: Option<PathBuf>,
        #[arg(long)]
        stonecut: Option<PathBuf>,
        /// The page
        #[arg(short, default_value = "docs/results/billion.md")]
        output: PathBuf,
    },
    /// Says what a job in units would take on other numbers of workers, from the records of one that was run
    Cluster {
        /// Folder of the finished job
        job: PathBuf,
        #[arg(long, value_delimiter = ',', default_value = "1,2,4,8,16")]
        workers: Vec<usize>,
        /// Threads of each worker
        #[arg(long, default_value = "1")]
        threads: f64,
        /// Gigabytes a second that a worker moves
        #[arg(long, default_value = "1.25")]
        link: f64,
        /// Gigabytes a second that the file system moves
        #[arg(long, default_value = "20")]
        files: f64,
        /// Seconds that starting and ending a unit takes
        #[arg(long, default_value = "0.04")]
        start: f64,
        /// Multiplies the work and the bytes of every unit
        #[arg(long, default_value = "1")]
        times: f64,
    },
    /// Says what 10 and 100 billion triangles would take, from the reports of runs that were made
    Forecast {
        /// Reports of `stonecut simplify --report`
        #[arg(required = true)]
        reports: Vec<PathBuf>,
        #[arg(long, value_delimiter = ',', value_parser = parse_count, default_value = "1G,10G,100G")]
        sizes: Vec<u64>,
        /// Cores of the machine to plan for
        #[arg(long, default_value = "32")]
        cores: u64,
        /// Cores the reports were made with
        #[arg(long, default_value = "2")]
        measured_cores: u64,
        /// Memory of the machine to plan for
        #[arg(long, value_parser = parse_bytes, default_value = "64GiB")]
        memory: u64,
        /// Gigabytes a second that its disks move
        #[arg(long, default_value = "4")]
        disk: f64,
    },
    /// Cuts about so many triangles out of the middle of a mesh
    Crop {
        input: PathBuf,
        output: PathBuf,
        #[arg(long, value_parser = parse_count)]
        triangles: u64,
    },
    /// Says how far results are from the least error that so many triangles can have on a smooth surface
    Optimum {
        /// A mesh without noise, as `stonecut synth --noise 0` makes it, much finer than its features
        surface: PathBuf,
        /// Simplified versions of it
        results: Vec<PathBuf>,
        #[command(flatten)]
        common: Common,
    },
    /// Draws the page and plots again from the JSON of an earlier session
    Redraw {
        /// compare.json or scaling.json
        record: PathBuf,
    },
    /// Runs one library on a raw mesh, in this process
    #[command(hide = true)]
    Peer { name: String, input: PathBuf, output: PathBuf, target: u64 },
    /// Simplifies a coloured PLY by meshopt or meshopt-update, colours in the error
    Colours {
        name: String,
        input: PathBuf,
        output: PathBuf,
        #[arg(value_parser = parse_count)]
        target: u64,
        /// What a colour difference of 1 counts, in sides of the bounding box
        #[arg(long, default_value = "0")]
        weight: f32,
    },
    /// Any mesh to a raw mesh
    #[command(hide = true)]
    ToRaw { input: PathBuf, output: PathBuf },
    /// A raw mesh to PLY
    #[command(hide = true)]
    ToPly { input: PathBuf, output: PathBuf },
    /// Counts triangles of a result that face against the original
    #[command(hide = true)]
    Facing { original: PathBuf, result: PathBuf },
}

#[derive(Subcommand)]
enum PeersCommand {
    /// Makes a virtual environment and builds the C++ driver
    Install {
        /// Where to [default: target/bench]
        #[arg(long)]
        tools: Option<PathBuf>,
    },
    /// Lists what there is
    List {
        #[command(flatten)]
        common: Common,
    },
}

#[derive(Args)]
struct Comparing {
    /// Files, or KIND:TRIANGLES or KIND:TRIANGLES:shuffled to make one
    #[arg(required = true)]
    meshes: Vec<String>,
    /// Shares of the input's triangles
    #[arg(long, value_delimiter = ',', value_parser = parse_ratio, default_value = "10%,1%")]
    ratios: Vec<f64>,
    /// Names, as `bench peers list` shows them [default: all; kernel-tables: without stonecut and Python but pymeshlab]
    #[arg(long = "peers", value_delimiter = ',')]
    names: Vec<String>,
    /// Threads for stonecut [default: all cores]
    #[arg(long)]
    threads: Option<u64>,
    #[command(flatten)]
    common: Common,
}

#[derive(Args)]
struct Common {
    /// Runs of each tool; slow peers run once
    #[arg(long, default_value = "3")]
    runs: usize,
    /// Budget given to stonecut [default: its own]
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
    /// Memory limit of every process, page cache included; needs root
    #[arg(long, value_parser = parse_size)]
    limit: Option<u64>,
    /// Time limit of every process
    #[arg(long, default_value = "1800")]
    seconds: u64,
    /// Samples a side when errors are measured
    #[arg(long, value_parser = parse_count, default_value = "1M")]
    samples: u64,
    /// Whose results of earlier sessions stand
    #[arg(long, value_enum, default_value = "slow")]
    reuse: Reuse,
    /// A word for `stonecut simplify`; may be given several times
    #[arg(long, allow_hyphen_values = true)]
    extra: Vec<String>,
    /// The stonecut under test [default: the one beside this program]
    #[arg(long)]
    stonecut: Option<PathBuf>,
    /// Where peers are installed [default: target/bench]
    #[arg(long)]
    tools: Option<PathBuf>,
    /// Scratch space [default: target/bench/work]
    #[arg(long)]
    work: Option<PathBuf>,
    /// Results of peers [default: target/bench/cache]
    #[arg(long)]
    cache: Option<PathBuf>,
    /// Folder for tables and plots
    #[arg(short, default_value = "target/bench/results")]
    output: PathBuf,
}

impl Common {
    fn settings(&self, threads: Option<u64>) -> Outcome<Settings> {
        let places = Places::find(self.stonecut.as_deref(), self.tools.as_deref())?;
        Ok(Settings {
            work: folder(self.work.as_deref(), &places.tools.join("work"))?,
            cache: folder(self.cache.as_deref(), &places.tools.join("cache"))?,
            places,
            reuse: self.reuse,
            runs: self.runs.max(1),
            threads,
            memory_bytes: self.memory,
            limit_bytes: self.limit,
            seconds: self.seconds,
            samples: self.samples,
            reports: None,
            extra: self.extra.clone(),
        })
    }
}

/// The folder as given or by default, made and absolute: tools run in folders of their own.
fn folder(given: Option<&Path>, default: &Path) -> Outcome<PathBuf> {
    let folder = given.unwrap_or(default);
    std::fs::create_dir_all(folder)?;
    Ok(folder.canonicalize()?)
}

/// Sizes such as 2.5GiB.
fn parse_size(text: &str) -> Result<u64, String> {
    let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    match number.split_once('.') {
        None => parse_bytes(text),
        Some(_) => {
            let unit = parse_bytes(&format!("1{}", &text[number.len()..]))?;
            let value: f64 = number.parse().map_err(|_| format!("invalid size {text}"))?;
            Ok((value * unit as f64) as u64)
        }
    }
}

fn main() -> ExitCode {
    match run(Cli::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("bench: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> Outcome<()> {
    match command {
        Command::Peers { command: PeersCommand::Install { tools } } => {
            peers::install(tools.as_deref())
        }
        Command::Peers { command: PeersCommand::List { common } } => {
            peers::list(&common.settings(None)?.places);
            Ok(())
        }
        Command::Compare(comparing) => {
            let record = compare(&comparing, &[])?;
            compare::write_page(&record, &comparing.common.output)
        }
        Command::KernelTables(comparing) => {
            let names = [
                "kernel",
                "kernel-fit",
                "reference",
                "meshopt",
                "meshopt-update",
                "pymeshlab",
                "cgal-lt",
            ];
            let record = compare(&comparing, &names.map(str::to_owned))?;
            compare::write_page(&record, &comparing.common.output)?;
            compare::write_kernel_page(&record, "kernel", &comparing.common.output)
        }
        Command::Scaling { kinds, sizes, counts, ratio, shuffled, measure_up_to, common } => {
            let request =
                scaling::Request { kinds, sizes, threads: counts, ratio, shuffled, measure_up_to };
            let reports = Some(common.output.join("reports"));
            let settings = Settings { reports, ..common.settings(None)? };
            let record = scaling::run(&request, &settings, &common.output)?;
            scaling::write_page(&record, &common.output)
        }
        Command::Billion {
            kind,
            triangles,
            to,
            memory,
            cgroup,
            threads,
            samples,
            keep,
            work,
            stonecut,
            output,
        } => {
            let places = Places::find(stonecut.as_deref(), None)?;
            let work = folder(work.as_deref(), &places.tools.join("work"))?;
            let request = billion::Request {
                places,
                kind,
                n_triangles: triangles,
                targets: to,
                memory_bytes: memory,
                limit_bytes: cgroup,
                threads,
                work,
                samples,
                keep,
            };
            billion::run(&request, &output)
        }
        Command::Cluster { job, workers, threads, link, files, start, times } => {
            let machines =
                cluster::Machines { workers: 1, threads, link: link * 1e9, files: files * 1e9 };
            print!("{}", cluster::Job::read(&job, times, start)?.table(&workers, machines));
            Ok(())
        }
        Command::Forecast { reports, sizes, cores, measured_cores, memory, disk } => {
            let machine = forecast::Machine {
                cores,
                measured_cores,
                memory_bytes: memory,
                bytes_per_second: disk * 1e9,
            };
            print!("{}", forecast::tables(&reports, &sizes, machine)?);
            Ok(())
        }
        Command::Optimum { surface, results, common } => {
            optimum::compare(&surface, &results, &common.settings(None)?)
        }
        Command::Redraw { record } => redraw(&record),
        Command::Crop { input, output, triangles } => {
            meshes::write_ply(&output, &meshes::crop(&meshes::read_any(&input)?, triangles))
        }
        Command::Peer { name, input, output, target } => {
            let inner = inside::run(&name, &input, &output, target)?;
            println!("{}", serde_json::to_string(&inner)?);
            Ok(())
        }
        Command::Colours { name, input, output, target, weight } => {
            colours::run(&name, &input, &output, target, weight)
        }
        Command::ToRaw { input, output } => meshes::write_raw(&output, &meshes::read_any(&input)?),
        Command::ToPly { input, output } => meshes::write_ply(&output, &meshes::read_raw(&input)?),
        Command::Facing { original, result } => {
            println!("{}", judge::facing_against(&original, &result)?);
            Ok(())
        }
    }
}

fn compare(comparing: &Comparing, default: &[String]) -> Outcome<compare::Record> {
    let names = if comparing.names.is_empty() { default } else { &comparing.names[..] };
    let request = compare::Request {
        meshes: comparing.meshes.clone(),
        ratios: comparing.ratios.clone(),
        peers: peers::named(names)?,
    };
    let settings = comparing.common.settings(comparing.threads)?;
    compare::run(&request, &settings, &comparing.common.output)
}

fn redraw(path: &Path) -> Outcome<()> {
    let record: compare::Record = serde_json::from_str(&std::fs::read_to_string(path)?)?;
    let out = path.parent().unwrap_or(Path::new("."));
    if path.file_name().is_some_and(|name| name == "scaling.json") {
        return scaling::write_page(&record, out);
    }
    if record.rows.iter().any(|row| row.peer == "kernel") {
        compare::write_kernel_page(&record, "kernel", out)?;
    }
    compare::write_page(&record, out)
}
