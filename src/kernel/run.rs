//! Runs the kernel from mesh to mesh: builds the surface, repairs it, collapses, fits, and takes the mesh out.

use crate::bound::tracker::Tracker;
use crate::collapse::legality::Reject;
use crate::cost::labels::Labels;
use crate::crossing::Crossings;
use crate::earlier::EarlierRun;
use crate::fit;
use crate::fit::samples::Samples;
use crate::followed::Followed;
use crate::history::History;
use crate::options::{FitGoal, MAX_TRIANGLES, MAX_VERTICES, Options, Placement, Stop, Topology};
use crate::quality::{Probes, closed_volume, volume_of};
use crate::repair;
use crate::repair::clean::MayBeFlat;
use crate::schedule::driver::Driver;
use crate::simd::Simd;
use crate::state::MeshState;
use crate::state::validate::validate;
use crate::statistics::{Simplified, Statistics};
use crate::surface::Surface;
use crate::surface::class::Class;
use crate::vertex::GONE;
use stonecut_mesh::Mesh;
use stonecut_mesh::orient::{Oriented, orient, orient_all};
use stonecut_mesh::outward::turn_outward;
use stonecut_mesh::vec3::{length_sq, sub};

/// Simplifies a mesh by edge collapse; vertices with `locked[v]` stay exactly where they are.
///
/// `locked` has one entry a vertex; all of them `false` if nothing is shared with other cells. Panics above
/// `MAX_TRIANGLES` and `MAX_VERTICES`, and if a corner or a length does not fit the vertices. Memory: `peak_bytes`, and what the
/// options add (`fit_bytes`, `bound_bytes`).
pub fn simplify_mesh(mesh: Mesh, locked: &[bool], options: &Options) -> Simplified {
    run(mesh, locked, options, Simd::detect())
}

/// As `simplify_mesh`, without instructions that only some processors have: gives the same result, and is
/// there for tests that hold both against each other.
#[doc(hidden)]
pub fn simplify_mesh_portably(mesh: Mesh, locked: &[bool], options: &Options) -> Simplified {
    run(mesh, locked, options, Simd::Portable)
}

/// Makes a surface of the mesh and mends it.
///
/// `goal` tells the result that it will be fitted for.
pub(crate) fn start(
    mut mesh: Mesh,
    locked: &[bool],
    options: &Options,
    goal: impl Fn(&Options, u64) -> Option<FitGoal>,
    simd: Simd,
) -> Driver {
    let (n, n_triangles) = (mesh.positions.len(), mesh.triangles.len());
    assert!(n_triangles as u64 <= MAX_TRIANGLES, "{n_triangles} triangles are too many at once");
    assert!(n as u64 <= MAX_VERTICES, "{n} vertices are too many at once");
    assert!(locked.len() == n && mesh.channels.len() == n * mesh.n_channels, "lengths agree");
    // What rides with the triangles of later rounds has a side.
    let is_first = mesh.relief.is_empty() && mesh.extremes.is_empty();
    let is_locked = |v: u32| locked[v as usize];
    let oriented = match options.orient {
        // Their labels say the side.
        _ if options.walls => Oriented::default(),
        true => {
            let (before, relief) = (mesh.triangles.clone(), &mut mesh.relief);
            let oriented = orient_all(&mut mesh.triangles, is_locked);
            let is_turned = before.iter().zip(&mesh.triangles).map(|(a, b)| a != b);
            // What is turned has the original on its other side.
            for (relief, _) in relief.iter_mut().zip(is_turned).filter(|(_, turned)| *turned) {
                *relief = relief.turned();
            }
            oriented
        }
        false if is_first => orient(&mut mesh.triangles, n, is_locked),
        false => Oriented::default(),
    };
    let scales = (&options.weights[..], &options.confined[..]);
    let (mut state, may_be_flat, original) = MeshState::new(mesh, locked, scales, simd);
    state.surface.placement = options.placement;
    state.surface.has_walls = options.walls;
    // Under a bound a triangle without area counts as the line that it is, and only a collapse may remove it.
    let flat = if options.bound.is_some() { &[][..] } else { &may_be_flat[..] };
    let flat = MayBeFlat { triangles: flat, may_touch: options.confined.contains(&true) };
    let cleaned = repair::clean::clean(&mut state, flat, simd);
    drop(may_be_flat);
    validate(&state);
    let mut approached = 0;
    if options.merge_distance > 0.0 && options.topology == Topology::Error {
        approached =
            repair::pair_boundaries::pair_boundaries(&mut state, options.merge_distance, simd);
    }
    repair::weld::coincident(&mut state, options.topology, &options.confined, simd);
    if let Some(wedges) = &mut state.wedges {
        wedges.region = options.region.filter(|&channel| channel < state.surface.n_channels);
        wedges.seam_share = f64::from(options.seam_share);
    }
    let label = options.label.filter(|&channel| channel < state.surface.n_channels);
    // With the distance itself a border keeps twice the triangles (docs/design/attributes.md).
    let reach =
        options.bound.map_or(f64::INFINITY, |bound| 2.0 * bound.distance * state.surface.scale);
    state.labels = label.map(|channel| Labels { channel, reach });
    let mut driver = Driver::new(state, simd, options.topology);
    driver.interrupt = options.interrupt.clone();
    driver.changes.add_cleaned(cleaned, approached);
    driver.changes.turned = oriented.turned;
    driver.changes.one_sided = options.orient.then_some(oriented.one_sided);
    if options.follow {
        driver.followed = Some(Followed::new(&driver.state.surface.source, n));
    }
    if options.record && driver.state.wedges.is_none() && options.bound.is_none() {
        driver.history = Some(Box::new(History::new(driver.state.surface.n_channels)));
    }
    // Steps that are recorded free one triangle or two.
    driver.collapser.may_go_along = driver.history.is_none();
    if options.estimate {
        driver.probes = Some(Probes::take(&driver.state.surface));
        // Within a bound the user has said what may go.
        driver.volume =
            options.bound.is_none().then(|| closed_volume(&driver.state.surface)).flatten();
    }
    if let Some(goal) = goal(options, driver.state.surface.n_alive) {
        driver.samples = Some(Samples::take(&driver.state.surface, goal, &original.relief));
    }
    let extremes = original.extremes;
    drop(original.relief);
    driver.mend();
    (driver.close_size, driver.crumb_size) = (options.close, options.crumbs);
    driver.close(false);
    driver.state.find_flats(options);
    if let Some(bound) = options.bound {
        driver.reach_channel = bound.channel;
        let surface = &driver.state.surface;
        let before = |v: u32| bound.channel.map_or(0.0, |channel| surface.channels_of(v)[channel]);
        let tracker =
            Tracker::new(surface, bound.distance, simd, &options.tight, (before, &extremes));
        driver.bound = Some(Box::new(tracker));
    }
    if options.no_self_intersections {
        let surface = &mut driver.state.surface;
        let is_single = |x: f64| f64::from(x as f32) == x;
        let are_single =
            surface.vertices.iter().all(|vertex| vertex.position.into_iter().all(is_single));
        // Where floats are coarse, one rounding after another would show.
        driver.settles = are_single && are_floats_coarse(surface);
        surface.rounds = are_single && !driver.settles;
        driver.crossings = Some(Box::new(Crossings::new(surface, simd)));
    }
    driver
}

pub(crate) fn run(mesh: Mesh, locked: &[bool], options: &Options, simd: Simd) -> Simplified {
    // What later rounds are given differs from run to run.
    let is_first = mesh.extremes.is_empty();
    let mut driver = start(mesh, locked, options, Options::fit_goal, simd);
    let mut statistics = Statistics::default();
    match &options.stop {
        Stop::Triangles(target) if options.bound.is_some() => {
            let earlier = options.earlier.as_ref().filter(|_| is_first);
            let repeated = earlier.and_then(EarlierRun::changes);
            driver.done = (earlier.is_some() && repeated.is_none()).then(Vec::new);
            statistics.reached = match repeated {
                Some(done) => driver.repeat_within_bound(done, *target),
                None => driver.reach_within_bound(*target),
            };
            if let (Some(earlier), Some(done), false) =
                (earlier, driver.done.take(), options.interrupt.is_raised())
            {
                earlier.fill(done);
            }
        }
        Stop::Triangles(target) => {
            statistics.reached = driver.reach(*target);
        }
        Stop::Costs(levels) => {
            for &level in levels.iter().take_while(|_| !options.interrupt.is_raised()) {
                let (before, refused) =
                    (driver.state.surface.n_alive, driver.rejects.of(Reject::Bound));
                driver.level(level);
                statistics.level_counts.push(driver.state.surface.n_alive);
                let refused = driver.rejects.of(Reject::Bound) - refused;
                let patience = options.bound.map_or(1.0, |bound| bound.patience);
                if patience < 1.0 && refused as f64 > patience * before as f64 {
                    break;
                }
            }
            statistics.reached = true;
        }
        Stop::CloseCosts(levels) => {
            statistics.level_counts = driver.close_levels(levels);
            statistics.reached = true;
        }
        Stop::Free { cost, triangles } => {
            driver.free_to(*cost, *triangles);
            statistics.reached = true;
        }
    }
    finish(driver, statistics, options.keeps_relief)
}

/// Fits the surface, sums up what was done and takes the mesh out of the surface.
pub(crate) fn finish(
    mut driver: Driver,
    mut statistics: Statistics,
    keeps_relief: bool,
) -> Simplified {
    let (mut relief, mut extremes) = (Vec::new(), Vec::new());
    let may_move = driver.state.surface.placement != Placement::Subset;
    let has_caps = driver.changes.cuts > 0 && driver.history.is_none();
    if let Some(crossings) = driver.crossings.as_mut().filter(|_| may_move && has_caps) {
        crossings.part(&mut driver.state.surface);
    }
    if let Some(samples) = driver.samples.take().filter(|_| !driver.interrupt.is_raised()) {
        let (fitted, found) = fit::fit(
            &mut driver.state,
            samples,
            driver.crossings.as_deref_mut(),
            keeps_relief,
            driver.simd,
        );
        statistics.fit = Some(fitted);
        relief = found;
    }
    if let Some(crossings) = driver.crossings.as_mut().filter(|_| driver.settles) {
        crossings.settle(&mut driver.state.surface);
        driver.state.surface.rounds = true;
    }
    if let Some(mut probes) = driver.probes.take() {
        let removed_error = driver.changes.removed_error;
        let mut quality = probes.sum_up(&driver.state.surface, removed_error, 1);
        if let Some(before) = driver.volume {
            quality.volume = [before, volume_of(&driver.state.surface)];
        }
        statistics.quality = Some(quality);
        statistics.curve = std::mem::take(&mut driver.curve);
    }
    statistics.interrupted = driver.interrupt.is_raised();
    statistics.reached &= !statistics.interrupted;
    statistics.collapses = driver.total_collapses();
    statistics.rejects = driver.rejects.named();
    if may_move && driver.history.is_none() && relief.is_empty() {
        driver.part_sheets();
    }
    driver.count_open();
    statistics.changes = driver.changes.named();
    if let Some(wedges) = &driver.state.wedges {
        statistics.charts_vanished = wedges.n_charts_vanished(&driver.state.surface.triangles);
        statistics.seam_vertices = wedges.n_seam_vertices(&driver.state.surface);
    }
    validate(&driver.state);
    if let Some(tracker) = driver.bound.take() {
        let reach = tracker.reach(&driver.state.surface);
        statistics.reach = reach.iter().fold(0.0, |most, &reach| most.max(f64::from(reach)));
        if let Some(channel) = driver.reach_channel {
            driver.state.set_channel(channel, &reach);
            extremes = tracker.extremes(&driver.state.surface);
        }
    }
    let surface = &driver.state.surface;
    let followed =
        driver.followed.take().map(|followed| followed.by_source(&surface.rings, &surface.source));
    let mut history = driver.history.take();
    if let Some(history) = &mut history {
        history.end(surface);
    }
    // The inside of a part of a surface is not known.
    let is_whole = || surface.rings.iter().all(|ring| ring.class != Some(Class::Locked));
    let may_turn = driver.changes.one_sided.is_some() && !surface.has_walls;
    let turns = may_turn && relief.is_empty() && is_whole();
    if let (Placement::Subset, Some(wedges)) = (surface.placement, &mut driver.state.wedges) {
        wedges.note_places(surface);
    }
    let models = driver.state.take_models();
    let (mut mesh, source) = driver.state.into_mesh();
    if turns {
        let (_, n_bodies) = turn_outward(&mut mesh);
        statistics.changes.push(("bodies_turned", n_bodies));
    }
    (mesh.relief, mesh.extremes) = (relief, extremes);
    let followed = followed.map_or(Vec::new(), |followed| followed.into_result(&source));
    Simplified { mesh, source, models, followed, history, statistics }
}

/// Steps between floats are coarse if they are more than this share of the mean edge. (At 5 % the largest error of a ball to 10 % is
/// 3.7 times that without rounding.)
const COARSE: f64 = 0.01;
/// Triangles whose edges are measured.
const MOST_SAMPLES: usize = 1 << 16;

/// Returns whether the steps between floats are coarse where the surface lies.
fn are_floats_coarse(surface: &Surface) -> bool {
    let coordinates = surface.vertices.iter().flat_map(|vertex| vertex.position);
    let far = coordinates.fold(0.0, |far: f64, x| far.max(x.abs())) as f32;
    let step = surface.triangles.len().div_ceil(MOST_SAMPLES).max(1);
    let (mut sum, mut n) = (0.0, 0.0);
    for t in surface.triangles.iter().step_by(step).filter(|t| t[0] != GONE) {
        let [a, b] = [t[0], t[1]].map(|v| surface.vertices[v as usize].position);
        (sum, n) = (sum + length_sq(sub(b, a)).sqrt(), n + 1.0);
    }
    f64::from(far.next_up() - far) * n > COARSE * sum
}
