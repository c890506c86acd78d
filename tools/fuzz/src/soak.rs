//! Judges millions of small nasty meshes: `soak FIRST LAST [THREADS]`, seeds from FIRST up to LAST.
//!
//! Prints each kind of fault once, with the smallest mesh found for it and how often it came up; ends with 1
//! if there was any. Progress goes to standard error.

#[path = "../kernel/mod.rs"]
mod kernel;

use kernel::case::Case;
use kernel::choices::Choices;
use kernel::judge::Depth;
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Seeds that a thread takes at a time.
const BATCH: u64 = 1000;
/// One mesh in so many is run again in other ways.
const DEEP: u64 = 8;

/// Pairs of triangles that meet where they should not.
fn crossing_pairs(mesh: &stonecut::Mesh) -> u64 {
    let found = stonecut::measure::intersections::in_memory(mesh, 1, &Default::default());
    found.map_or(0, |found| found.self_intersections)
}

fn main() {
    let numbers: Vec<u64> = std::env::args().skip(1).filter_map(|x| x.parse().ok()).collect();
    let [first, last, ref rest @ ..] = numbers[..] else {
        eprintln!("soak FIRST LAST [THREADS]: judge the meshes of these seeds");
        std::process::exit(2);
    };
    let next = AtomicU64::new(first);
    let n_triangles = AtomicU64::new(0);
    let faults: Mutex<BTreeMap<String, (u64, u64)>> = Mutex::default();
    let begun = std::time::Instant::now();
    std::thread::scope(|scope| {
        for _ in 0..rest.first().copied().unwrap_or(1) {
            scope.spawn(|| {
                loop {
                    let start = next.fetch_add(BATCH, Ordering::Relaxed);
                    if start >= last {
                        break;
                    }
                    let mut sum = 0;
                    for seed in start..(start + BATCH).min(last) {
                        let case = Case::new(&mut Choices::from_seed(seed));
                        sum += case.mesh.triangles.len() as u64;
                        let depth = if seed % DEEP == 0 { Depth::AllRuns } else { Depth::OneRun };
                        if let Err(fault) = kernel::verdict(&case, depth) {
                            let mut faults = faults.lock().expect("no thread panics");
                            let known = faults.entry(fault.kind.clone()).or_insert((seed, 0));
                            known.1 += 1;
                            if known.1 == 1 {
                                drop(faults);
                                report(seed, &case, &fault);
                            }
                        }
                    }
                    n_triangles.fetch_add(sum, Ordering::Relaxed);
                    if start / BATCH % 100 == 99 {
                        let done = start + BATCH - first;
                        let rate = done as f64 / begun.elapsed().as_secs_f64();
                        eprintln!("{done} meshes, {rate:.0} a second");
                    }
                }
            });
        }
    });
    let mean = n_triangles.into_inner() as f64 / (last - first).max(1) as f64;
    let faults = faults.into_inner().expect("no thread panics");
    println!(
        "{} meshes of {mean:.1} triangles on average, {} kinds of fault",
        last - first,
        faults.len()
    );
    for (kind, (seed, n)) in &faults {
        println!("{n} x {kind}, first at seed {seed}");
    }
    std::process::exit(i32::from(!faults.is_empty()));
}

fn report(seed: u64, case: &Case, fault: &kernel::Fault) {
    let least = kernel::shrink::shrink(case, &fault.kind);
    let detail = kernel::verdict(&least, Depth::AllRuns).err().map(|fault| fault.detail);
    println!("seed {seed}: {}\n{}\n{least:?}\n", fault.kind, detail.unwrap_or_default());
}
