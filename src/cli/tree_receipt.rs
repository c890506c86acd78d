//! Receipts of trees of tiles: what follows from their files, for the run that writes one and for `verify`.
//!
//! The errors of levels are those that the tiles state, which the run has proven; a second run proves them again (`verify --again`).

use super::receipt::{ReceiptWriter, Typed, companions, made_by, names_given, place_of};
use crate::error::{Error, Result};
use crate::io::StageOptions;
use crate::io::ply::MeshSource;
use crate::measure::tileset::check_tileset;
use crate::pipeline::tiles::TilesConfig;
use crate::pipeline::tiles::report::TilesReport;
use crate::receipt::hashes::Hashes;
use crate::receipt::{ABOUT, Receipt, ReceiptInput, ReceiptOutcome, ReceiptPlace, ReceiptTree};
use crate::store::job::fingerprint::unchanged;
use crate::system::disk::folder_of;
use crate::system::progress::Progress;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A run of `tiles` that is over; `marks` are those of its input.
pub(super) struct TilesRun<'a> {
    pub(super) config: &'a TilesConfig,
    pub(super) report: &'a TilesReport,
    pub(super) marks: BTreeMap<String, String>,
}

/// Hashes the files of a run, and writes its receipt.
pub(super) fn write(
    writer: &ReceiptWriter,
    typed: Typed,
    run: TilesRun,
    progress: &Progress,
) -> Result<()> {
    let TilesRun { config, report, marks } = run;
    let mut hashes = Hashes::beside(writer.path(), progress)?;
    let given = names_given(&config.input, &hashes)?;
    let mut taken = take(config, given, &mut hashes, progress)?;
    if let Some(fault) = taken.faults.first() {
        return Err(Error::bad_input(&config.output, format!("changed during the run: {fault}")));
    }
    for path in files_below(&config.output, &|_| true)? {
        progress.check()?;
        taken.tree.files.extend([hashes.entry(&path)?]);
    }
    // The hashes are of what the run has read, or of nothing.
    unchanged(&config.input, &marks, Ok(()))?;
    let receipt = Receipt {
        about: ABOUT.to_owned(),
        coordinates: taken.coordinates,
        input: taken.input,
        losses: report.losses.clone(),
        options: writer.options(&typed),
        outcome: outcome_of(report),
        output: hashes.name(typed.output)?,
        outputs: Vec::new(),
        program: made_by(&typed, progress)?,
        settings: report.settings.clone(),
        sha256: String::new(),
        tree: Some(taken.tree),
    };
    writer.seal(receipt, progress)
}

/// The end of a run.
pub(super) fn outcome_of(report: &TilesReport) -> ReceiptOutcome {
    ReceiptOutcome {
        faults: report.input.faults.clone(),
        stop_reason: "one tile holds all".to_owned(),
        target_met: !report.is_short(),
    }
}

/// The parts of a receipt that follow from the files; those of the tree are not hashed yet.
pub(super) struct TakenTree {
    pub(super) input: ReceiptInput,
    pub(super) coordinates: ReceiptPlace,
    pub(super) tree: ReceiptTree,
    /// Faults of the tree, in words.
    pub(super) faults: Vec<String>,
}

/// Hashes and counts the input, and checks the tree.
pub(super) fn take(
    config: &TilesConfig,
    given: Vec<String>,
    hashes: &mut Hashes,
    progress: &Progress,
) -> Result<TakenTree> {
    let mut input = ReceiptInput { given, ..ReceiptInput::default() };
    for path in config.input.files()? {
        input.files.extend([hashes.entry(&path)?]);
    }
    let read = config.read_options();
    let stage = StageOptions { read, ..StageOptions::new(folder_of(&config.job_folder)) };
    let source = MeshSource::open_staged(&config.input, &stage.within(config.memory_bytes))?;
    input.beside = companions(&source, hashes)?;
    input.beside.retain(|name, _| !input.files.contains_key(name));
    input.counts = counts([("triangles", source.n_triangles()), ("vertices", source.n_vertices())]);
    let means = (config.memory_bytes, config.threads.get());
    let found = check_tileset(&config.output, means, progress)?;
    let tree = ReceiptTree {
        counts: counts([
            ("groups", found.groups),
            ("levels", found.levels.into()),
            ("tiles", found.tiles),
            ("tilesets", found.tilesets),
            ("triangles", found.triangles),
            ("triangles_of_all_levels", found.triangles_of_all_levels),
        ]),
        errors: found.deviations,
        files: BTreeMap::new(),
    };
    let coordinates = place_of(&config.input, &source);
    Ok(TakenTree { input, coordinates, tree, faults: found.faults })
}

fn counts<const N: usize>(list: [(&str, u64); N]) -> BTreeMap<String, i64> {
    list.into_iter().map(|(name, n)| (name.to_owned(), n as i64)).collect()
}

/// The files below a folder, and the folders there that `enters` refuses.
pub(super) fn files_below(folder: &Path, enters: &dyn Fn(&Path) -> bool) -> Result<Vec<PathBuf>> {
    let (mut found, mut folders) = (Vec::new(), vec![folder.to_path_buf()]);
    while let Some(folder) = folders.pop() {
        let fail = |e| Error::reading(&folder, "cannot list", e);
        for entry in std::fs::read_dir(&folder).map_err(fail)? {
            let entry = entry.map_err(fail)?;
            let path = entry.path();
            match entry.file_type().map_err(fail)?.is_dir() && enters(&path) {
                true => folders.push(path),
                false => found.push(path),
            }
        }
    }
    Ok(found)
}
