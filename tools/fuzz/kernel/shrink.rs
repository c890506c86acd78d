//! The smallest case that still breaks the same promise: fewer triangles, locks, channels and options, rounder
//! places.

use super::case::Case;
use super::judge::Depth;
use super::verdict;
use stonecut::kernel::{Options, Placement, Stop};

/// Shrinks a case whose verdict is a fault of this kind, for as long as something helps.
pub fn shrink(case: &Case, kind: &str) -> Case {
    let is_same =
        |case: &Case| matches!(verdict(case, Depth::AllRuns), Err(fault) if fault.kind == kind);
    let mut best = case.clone();
    let mut left = 20_000;
    let mut attempt = |best: &mut Case, next: Case| -> bool {
        left -= 1;
        let is_better = left > 0 && is_same(&next);
        if is_better {
            *best = next;
        }
        is_better
    };
    loop {
        let mut helped = false;
        for next in plainer_options(&best) {
            helped |= next.options != best.options && attempt(&mut best, next);
        }
        let mut size = best.mesh.triangles.len().div_ceil(2);
        while size > 0 {
            let mut first = 0;
            while first < best.mesh.triangles.len() {
                let mut next = best.clone();
                let end = (first + size).min(next.mesh.triangles.len());
                next.mesh.triangles.drain(first..end);
                if attempt(&mut best, next) { helped = true } else { first += size }
            }
            size /= 2;
        }
        for v in (0..best.mesh.positions.len()).rev() {
            if best.locked[v] {
                let mut next = best.clone();
                next.locked[v] = false;
                helped |= attempt(&mut best, next);
            }
            if !best.mesh.triangles.iter().flatten().any(|&x| x as usize == v) {
                let next = without_vertex(&best, v);
                helped |= attempt(&mut best, next);
            }
        }
        for channel in (0..best.mesh.n_channels).rev() {
            let next = without_channel(&best, channel);
            helped |= attempt(&mut best, next);
        }
        for i in 0..best.mesh.channels.len() {
            let x = best.mesh.channels[i];
            for round in [0.0, 1.0, x.round()] {
                if round.to_bits() != x.to_bits() && x != 0.0 && x != 1.0 {
                    let mut next = best.clone();
                    next.mesh.channels[i] = round;
                    helped |= attempt(&mut best, next);
                }
            }
        }
        for v in 0..best.mesh.positions.len() {
            for k in 0..3 {
                let x = best.mesh.positions[v][k];
                for round in
                    [0.0, x.round(), (x * 8.0).round() / 8.0, (x * 1024.0).round() / 1024.0]
                {
                    if x != 0.0 && round.to_bits() != x.to_bits() && best.mesh.positions[v][k] == x
                    {
                        let mut next = best.clone();
                        next.mesh.positions[v][k] = round;
                        helped |= attempt(&mut best, next);
                    }
                }
            }
        }
        if !helped {
            return best;
        }
    }
}

fn plainer_options(case: &Case) -> Vec<Case> {
    let plain = Options::default();
    let with = |change: &dyn Fn(&mut Options)| {
        let mut next = case.clone();
        change(&mut next.options);
        next
    };
    let mut list = vec![
        with(&|o| *o = Options { stop: o.stop.clone(), ..plain.clone() }),
        with(&|o| o.stop = plain.stop.clone()),
        with(&|o| o.stop = Stop::Triangles(0)),
        with(&|o| o.fit = stonecut::kernel::Fit::Off),
        with(&|o| o.placement = Placement::Optimal),
        with(&|o| o.merge_distance = 0.0),
        with(&|o| o.merge_distance = o.merge_distance.min(1.0)),
        with(&|o| o.weights.clear()),
        with(&|o| o.confined.clear()),
        with(&|o| o.region = None),
        with(&|o| o.seam_share = 0.0),
        with(&|o| o.topology = plain.topology),
        with(&|o| {
            if let Stop::Triangles(n) = &mut o.stop {
                *n = (*n).saturating_sub(1);
            }
        }),
        with(&|o| {
            if let Stop::Costs(levels) | Stop::CloseCosts(levels) = &mut o.stop {
                levels.pop();
            }
        }),
        with(&|o| {
            if let Stop::Costs(levels) | Stop::CloseCosts(levels) = &mut o.stop
                && levels.len() > 1
            {
                levels.remove(0);
            }
        }),
        with(&|o| o.weights.iter_mut().for_each(|w| *w = w.min(1.0))),
    ];
    for i in 0..case.options.weights.len() {
        list.push(with(&|o| o.weights[i] = 0.0));
    }
    for i in 0..case.options.confined.len() {
        list.push(with(&|o| o.confined[i] = false));
    }
    list
}

fn without_vertex(case: &Case, v: usize) -> Case {
    let mut next = case.clone();
    next.mesh.positions.remove(v);
    next.locked.remove(v);
    let n = next.mesh.n_channels;
    next.mesh.channels.drain(v * n..(v + 1) * n);
    next.mesh.triangles.iter_mut().flatten().filter(|x| **x as usize > v).for_each(|x| *x -= 1);
    next
}

fn without_channel(case: &Case, channel: usize) -> Case {
    let mut next = case.clone();
    let n = next.mesh.n_channels;
    let kept = case.mesh.channels.iter().enumerate().filter(|(i, _)| i % n != channel);
    next.mesh.channels = kept.map(|(_, &x)| x).collect();
    next.mesh.n_channels = n - 1;
    let Options { weights, confined, .. } = &mut next.options;
    if channel < weights.len() {
        weights.remove(channel);
    }
    if channel < confined.len() {
        confined.remove(channel);
    }
    next
}
