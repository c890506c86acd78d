//! What `simplify_mesh` promises, asked of one case.

use super::Fault;
use super::case::Case;
use super::census::{Census, places};
use crate::crossing_pairs;
use stonecut::kernel::{self, MAX_SPECK, Placement, Simplified, Stop, Topology};
use stonecut::mesh::Mesh;

/// How much is asked.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// What one run shows.
    OneRun,
    /// Further runs too: again, on portable lanes, with fewer levels.
    AllRuns,
}

fn fault(kind: &str, detail: impl Into<String>) -> Result<(), Fault> {
    Err(Fault { kind: kind.to_owned(), detail: detail.into() })
}

/// Simplifies, and holds the result against the promises. Panics of the kernel go through.
pub fn judge(case: &Case, depth: Depth) -> Result<(), Fault> {
    let Case { mesh, locked, options } = case;
    let result = kernel::simplify_mesh(mesh.clone(), locked, options);
    shape(mesh, &result)?;
    numbers(case, &result)?;
    locks(case, &result)?;
    counts(case, &result)?;
    crossings(case, &result)?;
    topology(case, &result)?;
    if depth == Depth::AllRuns {
        let again = kernel::simplify_mesh(mesh.clone(), locked, options);
        if again != result {
            return fault("the same again", "");
        }
        let portable = kernel::simplify_mesh_portably(mesh.clone(), locked, options);
        if portable != result {
            return fault("the same on portable lanes", "");
        }
        levels(case, &result)?;
    }
    Ok(())
}

/// Indices, sources, lengths.
fn shape(mesh: &Mesh, result: &Simplified) -> Result<(), Fault> {
    let (out, source) = (&result.mesh, &result.source);
    let n = out.positions.len();
    if source.len() != n
        || out.channels.len() != n * out.n_channels
        || out.n_channels != mesh.n_channels
    {
        return fault("lengths agree", format!("{n} vertices, {} sources", source.len()));
    }
    if let Some(pair) = source.windows(2).find(|pair| pair[0] >= pair[1]) {
        return fault("sources ascend", format!("{pair:?}"));
    }
    if source.last().is_some_and(|&v| v as usize >= mesh.positions.len()) {
        return fault("sources exist", format!("{source:?}"));
    }
    let mut is_used = vec![false; n];
    for t in &out.triangles {
        if t.iter().any(|&v| v as usize >= n) || t[0] == t[1] || t[1] == t[2] || t[2] == t[0] {
            return fault("triangles are proper", format!("{t:?}"));
        }
        t.iter().for_each(|&v| is_used[v as usize] = true);
    }
    if is_used.contains(&false) {
        return fault("only what is used is kept", "");
    }
    Ok(())
}

/// Positions and channels.
fn numbers(case: &Case, result: &Simplified) -> Result<(), Fault> {
    let (mesh, out) = (&case.mesh, &result.mesh);
    if !out.positions.iter().flatten().all(|x| x.is_finite()) {
        return fault("positions are finite", format!("{:?}", out.positions));
    }
    if !out.channels.iter().all(|x| x.is_finite()) {
        return fault("channels are finite", format!("{:?}", out.channels));
    }
    if case.options.placement == Placement::Subset {
        let key = |p: &[f64; 3]| p.map(f64::to_bits);
        let mut known: Vec<_> = mesh.positions.iter().map(key).collect();
        known.sort_unstable();
        if out.positions.iter().any(|p| known.binary_search(&key(p)).is_err()) {
            return fault("a subset", "");
        }
    }
    for channel in (0..mesh.n_channels).filter(|&c| case.options.confined.get(c) == Some(&true)) {
        let values = |mesh: &Mesh| -> Vec<f32> {
            mesh.channels.iter().skip(channel).step_by(mesh.n_channels).copied().collect()
        };
        let (before, after) = (values(mesh), values(out));
        let low = before.iter().copied().fold(f32::INFINITY, f32::min);
        let high = before.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        // Interpolation rounds.
        let slack = 1e-5 * low.abs().max(high.abs());
        if let Some(x) = after.iter().find(|&&x| !(low - slack..=high + slack).contains(&x)) {
            return fault(
                "confined channels stay in range",
                format!("{channel}: {x} of {low} to {high}"),
            );
        }
    }
    Ok(())
}

/// Locked vertices, and edges between them.
fn locks(case: &Case, result: &Simplified) -> Result<(), Fault> {
    let (mesh, out) = (&case.mesh, &result.mesh);
    if !case.locked.contains(&true) {
        return Ok(());
    }
    let is_proper = |t: &&[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    let mut is_used = vec![false; mesh.positions.len()];
    for t in mesh.triangles.iter().filter(is_proper) {
        t.iter().for_each(|&v| is_used[v as usize] = true);
    }
    for v in (0..mesh.positions.len()).filter(|&v| case.locked[v] && is_used[v]) {
        let Ok(at) = result.source.binary_search(&(v as u32)) else {
            return fault("locked vertices stay", format!("{v} is gone"));
        };
        let bits = |list: &[f32]| -> Vec<u32> { list.iter().map(|x| x.to_bits()).collect() };
        if out.positions[at].map(f64::to_bits) != mesh.positions[v].map(f64::to_bits)
            || bits(out.channels_of(at as u32)) != bits(mesh.channels_of(v as u32))
        {
            return fault("locked vertices stay as they are", format!("{v}"));
        }
    }
    let edges = |triangles: &[[u32; 3]], name: &dyn Fn(u32) -> u32| {
        let mut edges: Vec<[u32; 2]> = Vec::new();
        for t in triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                let (a, b) = (name(a), name(b));
                if a != b && case.locked[a as usize] && case.locked[b as usize] {
                    edges.push([a.min(b), a.max(b)]);
                }
            }
        }
        edges.sort_unstable();
        edges
    };
    let before = edges(&mesh.triangles, &|v| v);
    let after = edges(&out.triangles, &|v| result.source[v as usize]);
    if let Some(edge) = after.iter().find(|edge| before.binary_search(edge).is_err()) {
        return fault("no edge between locked vertices is made", format!("{edge:?}"));
    }
    Ok(())
}

fn change(result: &Simplified, name: &str) -> u64 {
    result.statistics.changes.iter().find(|(known, _)| *known == name).map_or(0, |(_, n)| *n)
}

/// Pairs of triangles that meet where they should not.
fn crossings(case: &Case, result: &Simplified) -> Result<(), Fault> {
    if !case.options.no_self_intersections || case.options.merge_distance != 0.0 {
        return Ok(());
    }
    // The two caps of a cut lie on each other until collapses take them apart.
    let (before, after) = (crossing_pairs(&case.mesh), crossing_pairs(&result.mesh));
    if after > before + change(result, "handles_cut") {
        return fault("no more pairs meet", format!("{before} became {after}"));
    }
    Ok(())
}

/// Triangles against the stop.
fn counts(case: &Case, result: &Simplified) -> Result<(), Fault> {
    let (n, before) = (result.mesh.triangles.len() as u64, case.mesh.triangles.len() as u64);
    // Bridges of a gap are new, and the caps of a tube.
    let caps = 2 * change(result, "handles_cut");
    if n > before + caps && case.options.merge_distance == 0.0 {
        return fault("no triangles are added", format!("{before} became {n}"));
    }
    let list = match &case.options.stop {
        Stop::Triangles(target) => {
            let reached = result.statistics.reached;
            if reached != (n <= *target) {
                return fault(
                    "reached means at most the target",
                    format!("{n} of {target}: {reached}"),
                );
            }
            let cleaned = change(result, "duplicate_triangles_removed")
                + change(result, "degenerate_triangles_removed");
            let improper = Census::of(&case.mesh.triangles, case.mesh.positions.len(), |v| v);
            let proper = improper.n_triangles as u64;
            // What collapses are stuck on vanishes whole, if it is more than a speck.
            let place = places(&case.mesh.positions);
            let named = Census::of(&case.mesh.triangles, place.len(), |v| place[v as usize]);
            let is_large = named.n_largest > MAX_SPECK
                || case.options.merge_distance > 0.0 && proper > MAX_SPECK as u64;
            let whole = is_large && change(result, "small_components_removed") > 0;
            let may_pass = match whole {
                true if case.options.merge_distance > 0.0 => proper,
                true => named.n_largest as u64,
                false => 0,
            };
            if n + 2 + cleaned + may_pass < proper.min(*target) {
                return fault("not far below the target", format!("{n} of {target} from {proper}"));
            }
            return Ok(());
        }
        Stop::Costs(levels) | Stop::CloseCosts(levels) => levels,
        Stop::Free { .. } => return Ok(()),
    };
    let counts = &result.statistics.level_counts;
    if counts.len() > list.len() || counts.last().is_some_and(|&last| last != n) {
        return fault("levels are counted", format!("{counts:?} for {n}"));
    }
    Ok(())
}

/// Manifold and closed surfaces stay so; under `Keep`, nothing changes.
fn topology(case: &Case, result: &Simplified) -> Result<(), Fault> {
    let (mesh, out, options) = (&case.mesh, &result.mesh, &case.options);
    // What lies in one place may be joined; what was joined is split again only where attributes differ.
    let by_place = (places(&mesh.positions), places(&out.positions));
    let before = Census::of(&mesh.triangles, mesh.positions.len(), |v| v);
    let after = Census::of(&out.triangles, out.positions.len(), |v| v);
    let has_doubles = by_place.0.iter().enumerate().any(|(v, &place)| v as u32 != place);
    if before.is_edge_manifold && !after.is_edge_manifold {
        return fault("edge-manifold stays so", format!("{before:?} {after:?}"));
    }
    // Charts are joined wherever they touch, if only in one place.
    let is_welded = options.topology == Topology::Keep || options.confined.contains(&true);
    // Taking what is pinched apart needs the source of a vertex that has gone, which there may not be.
    let is_short = change(result, "duplicate_triangles_removed") > 0;
    let may_pinch = is_short || is_welded && (has_doubles || options.merge_distance > 0.0);
    if before.is_vertex_manifold && !may_pinch && !after.is_vertex_manifold {
        return fault("vertex-manifold stays so", format!("{before:?} {after:?}"));
    }
    if before.is_edge_manifold && before.is_closed && !after.is_closed {
        return fault("closed stays closed", format!("{before:?} {after:?}"));
    }
    let cleaned = change(result, "duplicate_triangles_removed")
        + change(result, "degenerate_triangles_removed");
    let must_stay = options.topology == Topology::Keep && before.is_edge_manifold && !has_doubles;
    let stays = after.euler == before.euler && after.n_components == before.n_components;
    if must_stay && cleaned == 0 && !stays {
        return fault("keep keeps the topology", format!("{before:?} {after:?}"));
    }
    Ok(())
}

/// A run over a prefix of the levels is a longer run cut short.
fn levels(case: &Case, result: &Simplified) -> Result<(), Fault> {
    let counts = &result.statistics.level_counts;
    let n = counts.len() / 2;
    let stop = match &case.options.stop {
        Stop::Costs(levels) => Stop::Costs(levels[..n].to_vec()),
        Stop::CloseCosts(levels) => Stop::CloseCosts(levels[..n].to_vec()),
        Stop::Triangles(_) | Stop::Free { .. } => return Ok(()),
    };
    if n == 0 {
        return Ok(());
    }
    let options = kernel::Options { stop, ..case.options.clone() };
    let shorter = kernel::simplify_mesh(case.mesh.clone(), &case.locked, &options);
    if shorter.statistics.level_counts != counts[..n] {
        return fault(
            "a prefix of the levels gives the same counts",
            format!("{counts:?} {:?}", shorter.statistics.level_counts),
        );
    }
    Ok(())
}
