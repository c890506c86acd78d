//! The end of a run of `simplify` for people: what was done, what was lost, what is short.

use super::log::{Log, Talk};
use crate::config::Config;
use crate::error::Result;
use crate::measure::solid::Solid;
use crate::mesh::face_properties::FacePolicy;
use crate::pipeline::run_report::{
    BoundReport, FaceReport, GridReport, InputReport, LOST_ROWS, NO_PLACE, QualityReport,
    RunReport, StageReport, StopReason,
};
use crate::stages::components::ComponentSizes;
use crate::system::disk::Disk;
use crate::system::json_keys::SCHEMA_VERSION;
use crate::system::losses::{Loss, LossKind};
use crate::system::pending_file::Seen;
use crate::system::progress::Progress;
use crate::system::units::{show_bytes, show_count, show_length, show_outward};
use std::collections::BTreeMap;

/// Enters what faces have lost in the ledger, and the ledger in the report.
pub(super) fn close(report: &mut RunReport, config: &Config, progress: &Progress) {
    for property in &report.face_properties {
        let reason = property.reason.as_deref().unwrap_or_default();
        // The writer enters what its format has no place for, the reader enters lists.
        let is_new = property.scalar != "list" && !AS_ASKED.contains(&reason) && reason != NO_PLACE;
        if property.carried == FacePolicy::Dropped && is_new {
            let what = format!("property of faces '{}'", property.name);
            let loss = Loss::new(LossKind::Attributes, what, reason);
            // A method that carries nothing on faces was asked for; all else that vanishes whole is a surprise.
            let is_surprise = !reason.starts_with("--method");
            progress.lose(if is_surprise { loss.whole() } else { loss });
        }
    }
    // What is printed or computed with is wanted for its shape, as `--for` says.
    if config.close.is_some() && config.kernel.orient && config.kernel.no_self_intersections {
        progress.excuse(LossKind::Attributes);
    }
    report.losses = progress.losses();
}

/// Reasons for which properties of faces are dropped that the command line gave.
const AS_ASKED: [&str; 4] =
    ["as asked", "given up", "goes with the texture", "a new texture has its own"];

/// A result of cells with less than this share of the triangles that were asked for is named.
const FEWER_ARE_SAID: f64 = 0.98;

/// Says what a run has done.
pub(super) fn tell(report: &RunReport, talk: &Talk, log: &mut Log) {
    if log.summary(&report.written()) {
        return;
    }
    if talk.verbose {
        report.stages.iter().for_each(|stage| log.say(stage_line(stage)));
    }
    for level in &report.levels {
        log.say(format!(
            "{}: {} triangles, {} vertices, {}",
            level.path,
            level.triangles,
            level.vertices,
            show_bytes(level.bytes)
        ));
    }
    if report.output.triangles > 0 {
        log.say(format!(
        "{}: {} triangles, {} vertices in {:.1} s ({} triangles/s), {} cells, {} rounds, peak {} memory, {} temporary",
        report.output.path,
        report.output.triangles,
        report.output.vertices,
        report.seconds,
        show_count(report.triangles_per_second as u64),
        report.cells,
        report.rounds,
        show_bytes(report.peak_memory_bytes),
        show_bytes(report.peak_temp_bytes)
    ));
    }
    if let (true, Some(fit)) = (talk.verbose, &report.fit) {
        log.say(format!(
            "fit: {} samples, {} vertices moved, RMS {:.3e} -> {:.3e}",
            show_count(fit.samples),
            show_count(fit.moved),
            fit.rms_before,
            fit.rms_after
        ));
    }
    if let Some(done) = &report.pairs {
        log.say(format!(
            "pairs: {} triangles before; {} edges and {} pairs without one contracted, {} triangles went with their backs",
            show_count(done.triangles_before),
            show_count(done.contracted_edges),
            show_count(done.contracted_pairs),
            show_count(done.cancelled_triangles)
        ));
    }
    if let Some(done) = &report.optimization {
        log.say(format!(
            "optimized: RMS of {} points {:.4e} -> {:.4e}; {} swaps, {} pairs of collapse and split, {} relocations",
            show_count(done.samples - done.samples_apart),
            done.rms_before,
            done.rms_after,
            show_count(done.swaps),
            show_count(done.splits),
            show_count(done.relocations)
        ));
    }
    for line in report.input.weld.iter().flat_map(|weld| &weld.notes) {
        log.say(format!("  {line}"));
    }
    let is_entered = |p: &&FaceReport| {
        let reason = p.reason.as_deref().unwrap_or_default();
        p.carried == FacePolicy::Dropped && !AS_ASKED.contains(&reason)
    };
    for property in report.face_properties.iter().filter(|p| !is_entered(p)) {
        log.say(face_line(property));
    }
    if let Some(grid) = &report.grid {
        log.say(grid_line(grid));
    }
    if let Some(components) = &report.components {
        log.say(component_line(components));
    }
    solid_lines(&report.changes).into_iter().for_each(|line| log.say(line));
    say_faults(&report.input, log);
    if let Some(measured) = &report.measured {
        super::measure::table(measured).lines().for_each(|line| log.say(line));
    }
    if let (Some(BoundReport { bound, trials, .. }), Some(enclosed)) =
        (&report.max_error, &report.hausdorff)
    {
        let (bound, n) = (show_length(*bound), trials.len());
        let runs = if n == 1 { "1 run".to_owned() } else { format!("{n} runs") };
        log.say(format!(
            "at most {} from the input, proven; the bound is {bound}; {runs}",
            show_outward(enclosed.upper, 1, 4)
        ));
    }
    if !report.target_met {
        let why = match &report.max_error {
            Some(found) if report.stop_reason == StopReason::WithinBound.to_string() => {
                format!("the bound of {} ends it first", show_length(found.bound))
            }
            _ => match report.settings.get("lock") {
                Some(lock) if report.stop_reason == StopReason::Locked.to_string() => format!(
                    "--lock {lock} leaves room for no fewer than {} triangles; ask for that, or lock fewer vertices",
                    report.quality.sensible_triangles
                ),
                _ => report.stop_reason.clone(),
            },
        };
        log.say_reason(format!("short of the target of {} triangles: {why}", report.target));
    }
    let share = report.output.triangles as f64 / report.target.max(1) as f64;
    if report.rounds > 0 && report.max_error.is_none() && share < FEWER_ARE_SAID {
        log.say(format!(
            "{:.0} % fewer triangles than asked for; larger --cell-triangles come nearer to the count",
            100.0 * (1.0 - share)
        ));
    }
    if let Some(solid) = report.solid.filter(|solid| !solid.met) {
        log.say_reason(fault_line(&solid));
    }
    if report.opened_region_edges > 0 {
        log.say_reason(format!(
            "written, but regions that were closed are open at {} edges; ask for more triangles, or simplify each region alone \
             (convert --split)",
            show_count(report.opened_region_edges)
        ));
    }
    if report.regions_off_volume > 0 {
        log.say_reason(format!(
            "too few triangles for {} of the regions: their volume is off by more than 10 %; ask for more",
            show_count(report.regions_off_volume)
        ));
    }
    if !report.quality.bearable {
        log.say_reason(unbearable_line(&report.quality));
    }
}

/// Behind the number of the duplicate faces that were backs of sheets.
const BACKS: &str = "of the faces were backs of two-sided sheets, which are one-sided now: show the result from both sides";

/// Says what was dropped of an input for its faults.
pub(super) fn say_faults(input: &InputReport, log: &mut Log) {
    for (name, n) in input.faults.iter().filter(|(_, n)| **n > 0) {
        let line = match name.as_str() {
            "back_faces" => format!("  {n} {BACKS}"),
            _ => format!("  {n} {} dropped", name.replace('_', " ")),
        };
        match LOST_ROWS.contains(&name.as_str()) {
            true => log.say_reason(line),
            false => log.say(line),
        }
    }
}

/// Shows the time and the counts of a stage.
pub(super) fn stage_line(stage: &StageReport) -> String {
    format!(
        "{:11} {:7.2} s  {} -> {} triangles, {} read, {} written",
        stage.name,
        stage.seconds,
        show_count(stage.triangles_in),
        show_count(stage.triangles_out),
        show_bytes(stage.bytes_read),
        show_bytes(stage.bytes_written)
    )
}

/// Explains a result that cannot stand for its input.
fn unbearable_line(quality: &QualityReport) -> String {
    let QualityReport { error_per_edge, share_against, sensible_triangles, .. } = quality;
    if let Some(kept) = quality.volume_kept.filter(|_| quality.is_volume_lost()) {
        return format!(
            "too few triangles for this scan: its closed bodies have {:.0} % of their volume; ask for at least {} triangles; \
             if --for simulation, --placement or --method is given, try without",
            100.0 * kept,
            show_count(*sensible_triangles)
        );
    }
    format!(
        "too few triangles for this scan: the error (about {:.2e}) is {:.0} % of the mean edge and {:.1} % of the size \
         (the root of the area), {:.0} % of the surface faces the wrong way; ask for at least {} triangles",
        quality.rms_estimate,
        100.0 * error_per_edge,
        100.0 * quality.error_of_size,
        100.0 * share_against,
        show_count(*sensible_triangles)
    )
}

/// Says in what a result is not solid that was to be.
fn fault_line(solid: &Solid) -> String {
    let open_loops =
        solid.open_loops.map_or(String::new(), |n| format!(" in {} loops", show_count(n)));
    let faults = [
        (solid.open_edges, format!("open edges{open_loops}")),
        (solid.non_manifold_edges, "edges of three or more triangles".to_owned()),
        (solid.touching_vertices.unwrap_or(0), "vertices where sheets touch".to_owned()),
        (solid.inconsistent_edges, "edges whose triangles disagree".to_owned()),
        (
            solid.bodies_inside_out.unwrap_or(0),
            "closed bodies inside out (turned where the result fits into one cell: give a larger --cell-triangles)".to_owned(),
        ),
        (solid.self_intersections, "pairs of triangles that meet".to_owned()),
    ];
    let faults = faults.iter().filter(|(n, _)| *n > 0);
    let faults: Vec<String> =
        faults.map(|(n, what)| format!("{} {what}", show_count(*n))).collect();
    format!(
        "written, but not as sound as asked for: {}; ask for more triangles or mend the file in another program",
        faults.join(", ")
    )
}

fn grid_line(grid: &GridReport) -> String {
    let GridReport { cell_size, passes, cells, .. } = grid;
    let passes = if *passes == 1 { "1 pass".to_owned() } else { format!("{passes} passes") };
    format!("  cells of {}, {} occupied, {passes}", show_length(*cell_size), show_count(*cells))
}

/// Holes and senses of rotation, where that was asked for.
fn solid_lines(changes: &BTreeMap<String, u64>) -> Vec<String> {
    let count = |name: &str| changes.get(name).copied();
    let of = |name: &str| show_count(count(name).unwrap_or(0));
    let holes = count("holes_filled").map(|_| {
        let is_large = count("holes_left_large").is_some_and(|n| n > 0);
        let way_out = if is_large { "; give --close=all to fill them" } else { "" };
        format!(
            "  holes: {} filled with {} triangles, {} left ({} larger than --close), {} parts of others across cells{way_out}",
            of("holes_filled"),
            of("hole_triangles_added"),
            of("holes_left"),
            of("holes_left_large"),
            of("holes_left_parts")
        )
    });
    let cut = count("triangles_cut_out").map(|_| {
        format!(
            "  cut out and closed: {} places where triangles met, {} holes, with {} triangles",
            of("crossing_pairs_cut_out"),
            of("holes_cut_out"),
            of("triangles_cut_out")
        )
    });
    let crumbs = count("crumbs_removed").filter(|n| *n > 0).map(|_| {
        format!(
            "  crumbs: {} closed components dropped, {} triangles",
            of("crumbs_removed"),
            of("crumb_triangles_removed")
        )
    });
    let sides = count("components_left_one_sided").map(|_| {
        let bodies = count("bodies_turned");
        let bodies = bodies.map_or(String::new(), |n| format!(", {} bodies", show_count(n)));
        format!(
            "  orientation: {} triangles{bodies} turned over, {} components have one side only",
            of("triangles_turned"),
            of("components_left_one_sided")
        )
    });
    holes.into_iter().chain(cut).chain(crumbs).chain(sides).collect()
}

fn component_line(sizes: &ComponentSizes) -> String {
    format!(
        "  {} of {} components dropped, {} triangles; the largest has {}",
        sizes.dropped,
        sizes.found,
        show_count(sizes.dropped_triangles),
        show_count(sizes.largest)
    )
}

fn face_line(property: &FaceReport) -> String {
    let what = match property.carried {
        FacePolicy::Constant => "the same everywhere, kept",
        FacePolicy::Region => "kept as regions",
        FacePolicy::Chosen => "differs nearly everywhere, chosen from faces near by",
        FacePolicy::Averaged => "averaged",
        FacePolicy::Dropped => "dropped",
    };
    let reason = property.reason.as_ref().map_or(String::new(), |reason| format!(": {reason}"));
    format!("  faces' {} ({}): {what}{reason}", property.name, property.scalar)
}

/// Writes the report of a run that was only planned, or that ended early as asked: `end` says which.
pub(super) fn write_early(
    to: Option<&Seen>,
    config: &Config,
    end: serde_json::Value,
    progress: &Progress,
) -> Result<()> {
    let Some(to) = to else { return Ok(()) };
    let mut report = serde_json::json!({
        "schema_version": SCHEMA_VERSION,
        "version": env!("CARGO_PKG_VERSION"),
        "is_finished": false,
        "input": { "path": config.input },
        "output": { "path": config.output },
        "settings": config.settings(),
        "losses": progress.losses(),
    });
    if let (Some(report), serde_json::Value::Object(end)) = (report.as_object_mut(), end) {
        report.extend(end);
    }
    write_json(to, &report)
}

/// Writes the report in JSON.
pub(super) fn write_report(to: &Seen, report: &RunReport) -> Result<()> {
    write_json(to, &report.written())
}

/// Writes a report of any command in JSON.
pub(super) fn write_json(to: &Seen, report: &impl serde::Serialize) -> Result<()> {
    let mut json = serde_json::to_vec_pretty(report).expect("plain data");
    json.push(b'\n');
    crate::system::pending_file::write_whole(to.place(&Disk::default()), &json)
}
