//! Runs tools on one mesh: makes inputs, starts processes, interleaves them, judges results, caches peers.

use crate::Outcome;
use crate::child::{self, Ending, Job};
use crate::judge::{self, judge};
use crate::peers::{Kind, PEERS, Peer, Places};
use crate::record::{Quality, Row, Run};
use std::path::{Path, PathBuf};
use std::process::Command;
use stonecut::pipeline::run_report::RunReport;
use stonecut::system::units::{parse_count, show_count};

/// Everything that decides how tools are run.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Programs.
    pub places: Places,
    /// Scratch space: inputs, outputs, temporary data.
    pub work: PathBuf,
    /// Results of peers from earlier sessions.
    pub cache: PathBuf,
    /// Which peers' results are taken from there.
    pub reuse: Reuse,
    /// Runs of each tool.
    pub runs: usize,
    /// Threads for stonecut; `None`: all cores.
    pub threads: Option<u64>,
    /// Budget given to stonecut; `None`: its default.
    pub memory_bytes: Option<u64>,
    /// Memory limit of every process.
    pub limit_bytes: Option<u64>,
    /// Time limit of every process in seconds.
    pub seconds: u64,
    /// Samples a side when results are judged.
    pub samples: u64,
    /// Where stonecut's reports are kept, for `bench forecast`; `None`: nowhere.
    pub reports: Option<PathBuf>,
    /// Further words for `stonecut simplify`.
    pub extra: Vec<String>,
}

/// Which results of earlier sessions stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Reuse {
    /// None: every peer runs anew.
    None,
    /// Those of slow peers.
    Slow,
    /// Those of all peers; never our own.
    All,
}

/// A mesh to work on.
#[derive(Clone, Debug)]
pub struct Input {
    /// Its name in tables: the file's stem, or kind and size.
    pub name: String,
    /// The file stonecut reads.
    pub file: PathBuf,
    /// The same for peers; `None` if only stonecut will run.
    pub raw: Option<PathBuf>,
    /// Triangles without degenerate ones, where `raw` exists; else faces.
    pub n_triangles: u64,
    /// Whether the file was made here and may be deleted.
    made: bool,
}

impl Input {
    /// Takes a file, or makes KIND:TRIANGLES or KIND:TRIANGLES:shuffled.
    pub fn get(spec: &str, with_raw: bool, settings: &Settings) -> Outcome<Input> {
        std::fs::create_dir_all(&settings.work)?;
        let path = Path::new(spec);
        let (name, file, made) = if path.is_file() {
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            (name, path.canonicalize()?, false)
        } else {
            let words: Vec<&str> = spec.split(':').collect();
            let (kind, count, shuffled) = match words[..] {
                [kind, count] => (kind, count, false),
                [kind, count, "shuffled"] => (kind, count, true),
                _ => {
                    return Err(
                        format!("{spec} is no file and no KIND:TRIANGLES[:shuffled]").into()
                    );
                }
            };
            parse_count(count)?;
            let name = spec.replace(':', "_");
            let file = settings.work.join(format!("{name}.ply"));
            let mut make = Command::new(&settings.places.stonecut);
            make.args(["synth", kind]).arg(&file).args(["--force", "-q", "--triangles", count]);
            if shuffled {
                make.arg("--shuffle");
            }
            if !make.status()?.success() {
                return Err(format!("{spec} could not be made").into());
            }
            // Or writing it back would go on during the first run.
            std::fs::File::open(&file)?.sync_all()?;
            (name, file, true)
        };
        let mut input = Input { name, file, raw: None, n_triangles: 0, made };
        if with_raw {
            let raw = settings.work.join(format!("{}.raw", input.name));
            let made = Command::new(&settings.places.bench)
                .arg("to-raw")
                .args([&input.file, &raw])
                .status()?;
            if !made.success() {
                return Err(format!("{} cannot be read", input.file.display()).into());
            }
            input.n_triangles = (raw_triangles(&raw)?).1;
            input.raw = Some(raw);
        } else {
            input.n_triangles = faces_of(&settings.places.stonecut, &input.file)?;
        }
        Ok(input)
    }

    /// Deletes what was made here.
    pub fn remove(&self) {
        let made = self.made.then_some(&self.file);
        for path in self.raw.iter().chain(made) {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Vertices and triangles in the head of a raw mesh.
fn raw_triangles(path: &Path) -> Outcome<(u64, u64)> {
    use std::io::Read;
    let mut counts = [0u64; 2];
    std::fs::File::open(path)?.read_exact(bytemuck::cast_slice_mut(&mut counts))?;
    Ok((counts[0], counts[1]))
}

fn faces_of(stonecut: &Path, file: &Path) -> Outcome<u64> {
    let output = Command::new(stonecut).args(["info", "--json"]).arg(file).output()?;
    let info: serde_json::Value = serde_json::from_slice(&output.stdout)?;
    info["faces"].as_u64().ok_or_else(|| format!("{} is no mesh", file.display()).into())
}

/// Runs all tools to one target, interleaved: one run of each, then the next run of each.
pub fn rows(input: &Input, target: u64, peers: &[Peer], settings: &Settings) -> Outcome<Vec<Row>> {
    let mut rows = Vec::new();
    for peer in peers {
        let row = new_row(input, target, peer, settings);
        rows.push(cached(&row, peer, settings).unwrap_or(row));
    }
    for run in 0..settings.runs {
        for (row, peer) in rows.iter_mut().zip(peers) {
            // What is missing, failed, or stands from earlier is not run; slow peers run once.
            if row.cached || !row.trouble.is_empty() || (peer.slow && run > 0) {
                continue;
            }
            if row.version.is_empty() {
                row.trouble = Ending::Missing.words();
                continue;
            }
            one_run(row, peer, input, settings)?;
        }
    }
    for (row, peer) in rows.iter_mut().zip(peers) {
        let result = result_of(row, peer, settings);
        if row.trouble.is_empty() && row.quality.is_none() {
            match quality(input, &result, settings) {
                Ok(quality) => row.quality = Some(quality),
                Err(error) => row.trouble = error.to_string(),
            }
        }
        if keeps(peer) && !row.version.is_empty() {
            let json = serde_json::to_string_pretty(row)?;
            std::fs::write(cache_name(row, settings, "json"), json)?;
        } else {
            let _ = std::fs::remove_file(result);
        }
    }
    Ok(rows)
}

/// Runs stonecut alone with several numbers of threads, interleaved; a row for each.
///
/// The result is judged only if `judged`, and once: whoever wrote other bytes than the first is in trouble.
pub fn thread_rows(
    input: &Input,
    target: u64,
    threads: &[u64],
    settings: &Settings,
    judged: bool,
) -> Outcome<Vec<Row>> {
    let own = PEERS[0];
    let settings: Vec<Settings> =
        threads.iter().map(|&n| Settings { threads: Some(n), ..settings.clone() }).collect();
    let mut rows: Vec<Row> =
        settings.iter().map(|settings| new_row(input, target, &own, settings)).collect();
    let mut first: Option<PathBuf> = None;
    for _ in 0..settings.first().map_or(0, |settings| settings.runs) {
        for (row, settings) in rows.iter_mut().zip(&settings) {
            if !row.trouble.is_empty() {
                continue;
            }
            one_run(row, &own, input, settings)?;
            if !row.trouble.is_empty() {
                continue;
            }
            let result = result_of(row, &own, settings);
            match &first {
                None => {
                    let kept = result.with_extension("first.ply");
                    std::fs::rename(result, &kept)?;
                    first = Some(kept);
                }
                Some(first) => {
                    if !same_bytes(first, &result)? {
                        row.trouble = "other bytes than the first run".to_owned();
                    }
                    std::fs::remove_file(result)?;
                }
            }
        }
    }
    if let (Some(first), Some(settings)) = (first, settings.first()) {
        if judged {
            let quality = quality(input, &first, settings)?;
            for row in &mut rows {
                row.quality = Some(quality.clone());
            }
        }
        std::fs::remove_file(first)?;
    }
    Ok(rows)
}

fn same_bytes(a: &Path, b: &Path) -> Outcome<bool> {
    Ok(Command::new("cmp").arg("-s").args([a, b]).status()?.success())
}

fn new_row(input: &Input, target: u64, peer: &Peer, settings: &Settings) -> Row {
    Row {
        mesh: input.name.clone(),
        peer: peer.name.to_owned(),
        version: settings.places.version(peer).unwrap_or_default(),
        triangles_in: input.n_triangles,
        target,
        threads: if peer.kind == Kind::Stonecut { settings.threads.unwrap_or(0) } else { 0 },
        ..Row::default()
    }
}

fn quality(input: &Input, result: &Path, settings: &Settings) -> Outcome<Quality> {
    let options = judge::Options {
        samples: settings.samples,
        memory_bytes: settings.memory_bytes.unwrap_or(stonecut::system::memory::limit_bytes() / 2),
        facing: true,
    };
    judge(&settings.places, &input.file, result, options)
}

/// Peers' results are kept; ours change with every build.
fn keeps(peer: &Peer) -> bool {
    peer.kind != Kind::Stonecut && !peer.name.starts_with("kernel") && peer.name != "reference"
}

fn cache_name(row: &Row, settings: &Settings, ending: &str) -> PathBuf {
    settings.cache.join(format!("{}_{}_{}.{ending}", row.mesh, row.target, row.peer))
}

fn result_of(row: &Row, peer: &Peer, settings: &Settings) -> PathBuf {
    if keeps(peer) {
        return cache_name(row, settings, "ply");
    }
    settings.work.join(format!("{}_{}_{}.ply", row.mesh, row.target, row.peer))
}

/// The row of an earlier session, if it is of the same version and mesh.
fn cached(row: &Row, peer: &Peer, settings: &Settings) -> Option<Row> {
    let reuse = match settings.reuse {
        Reuse::None => false,
        Reuse::Slow => peer.slow,
        Reuse::All => true,
    };
    if !reuse || !keeps(peer) {
        return None;
    }
    let mut found = earlier(row, settings)?;
    let whole = !found.trouble.is_empty()
        || found.quality.is_some()
        || cache_name(row, settings, "ply").is_file();
    found.cached = true;
    whole.then_some(found)
}

/// What the cache says of this tool's version, mesh and target; the quality only if as many samples were taken.
fn earlier(row: &Row, settings: &Settings) -> Option<Row> {
    let text = std::fs::read_to_string(cache_name(row, settings, "json")).ok()?;
    let mut found: Row = serde_json::from_str(&text).ok()?;
    found.quality = found.quality.filter(|quality| quality.samples == settings.samples);
    (found.version == row.version && found.triangles_in == row.triangles_in).then_some(found)
}

/// Runs one tool once and adds the run to its row.
fn one_run(row: &mut Row, peer: &Peer, input: &Input, settings: &Settings) -> Outcome<()> {
    std::fs::create_dir_all(&settings.cache)?;
    let folder = settings.work.join(format!("run-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder)?;
    let own = peer.kind == Kind::Stonecut;
    let output = folder.join(if own { "out.ply" } else { "out.raw" });
    let report = folder.join("report.json");
    let read = if own { Some(&input.file) } else { input.raw.as_ref() };
    let read = read.ok_or("peers need a raw mesh")?;
    let mut command = settings.places.command(peer, read, &output, row.target);
    if own {
        command.extend(own_options(settings, &report));
    }
    eprintln!("bench: {} to {}: {}", row.mesh, show_count(row.target), row.peer);
    let job = Job {
        command,
        folder: &folder,
        outputs: vec![output.clone(), report.clone()],
        seconds: settings.seconds,
        memory_bytes: settings.limit_bytes,
    };
    let (mut usage, said, complaint) = child::run(&job)?;
    let mut stages = Vec::new();
    if let Ok(text) = std::fs::read_to_string(&report) {
        let report: RunReport = serde_json::from_str(&text)?;
        keep_report(row, report.clone(), settings)?;
        // The program counts its own files exactly; looking now and then sees less.
        usage.temp_bytes = report.peak_temp_bytes;
        stages = report
            .stages
            .into_iter()
            .map(|stage| (stage.part().to_owned(), stage.seconds))
            .collect();
    }
    let ending = usage.ending.clone();
    let inner = serde_json::from_str(said.trim()).ok();
    row.runs.push(Run { usage, inner, stages });
    let short = own && ending == Ending::Exit(3);
    if ending != Ending::Exit(0) && !short {
        let last = complaint.lines().rfind(|line| !line.trim().is_empty()).unwrap_or_default();
        row.trouble = ending.words();
        if matches!(ending, Ending::Exit(_)) {
            row.trouble =
                format!("{}: {}", row.trouble, last.chars().take(120).collect::<String>());
        }
    } else if let Err(error) = keep_result(row, peer, &output, settings) {
        row.trouble = error.to_string();
    }
    std::fs::remove_dir_all(&folder)?;
    Ok(())
}

/// Keeps the last run's report of a mesh, target and number of threads, without the places of its files.
fn keep_report(row: &Row, mut report: RunReport, settings: &Settings) -> Outcome<()> {
    let Some(folder) = &settings.reports else { return Ok(()) };
    std::fs::create_dir_all(folder)?;
    report.input.path = row.mesh.clone();
    report.output.path.clear();
    let name = format!("{}_{}_{}.json", row.mesh, row.target, row.threads);
    std::fs::write(folder.join(name), serde_json::to_string_pretty(&report)?)?;
    Ok(())
}

fn keep_result(row: &mut Row, peer: &Peer, output: &Path, settings: &Settings) -> Outcome<()> {
    let result = result_of(row, peer, settings);
    if peer.kind == Kind::Stonecut {
        std::fs::rename(output, result)?;
        return Ok(());
    }
    let fresh = result.with_extension("new.ply");
    let done =
        Command::new(&settings.places.bench).arg("to-ply").args([output, &fresh]).output()?;
    if !done.status.success() {
        let said = String::from_utf8_lossy(&done.stderr);
        return Err(format!("unusable result: {}", said.trim()).into());
    }
    // The same bytes as in an earlier session need no further judgement.
    let same = result.is_file() && same_bytes(&result, &fresh)?;
    row.quality = if same { earlier(row, settings).and_then(|row| row.quality) } else { None };
    std::fs::rename(fresh, result)?;
    Ok(())
}

fn own_options(settings: &Settings, report: &Path) -> Vec<String> {
    let mut words = vec!["--report".to_owned(), report.display().to_string()];
    words.extend(["--progress", "none", "--force"].map(str::to_owned));
    let mut option = |name: &str, value: Option<u64>| {
        words.extend(value.into_iter().flat_map(|value| [name.to_owned(), value.to_string()]));
    };
    option("--threads", settings.threads);
    option("--memory", settings.memory_bytes);
    words.extend(settings.extra.iter().cloned());
    words
}
