//! The shapes of parallel work in this crate; the only place that knows threads.
//!
//! `both` does two things side by side, `in_order` maps numbered blocks and hands the results on in block order; `largest_first` runs
//! independent jobs under a memory budget. Neither lets the number of threads reach a result. A panic in
//! the work becomes an error here (`guarded`), so that a fault of ours ends a run like any other failure.

use crate::error::{Error, Result};
use crate::memory::give_back;
use crate::progress::Progress;
use crossbeam::channel::bounded;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Condvar, Mutex, PoisonError};

/// Stack of a worker, in bytes: that of the main thread, so that what returns there returns in a worker, too.
const STACK_BYTES: usize = 8 << 20;

fn no_thread(error: impl std::fmt::Display) -> Error {
    Error::NoMemory(format!(
        "cannot start a thread: {error}; raise the limit on processes (ulimit -u), or give --threads 1"
    ))
}

/// Runs `work`; a panic in it becomes `Error::Internal` with the panic's own words.
///
/// Whatever `work` was changing may be half changed: the caller must drop it, or know that it is append-only.
pub fn guarded<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let words = panic.downcast_ref::<&str>().map(|words| (*words).to_owned());
        let words = words.or_else(|| panic.downcast_ref::<String>().cloned());
        Err(Error::Internal(words.unwrap_or_else(|| "no message".to_owned())))
    })
}

/// Runs two things, side by side if there is a thread to spare; the error of `first` counts before that of `second`, and a panic
/// is an error as in `guarded`.
pub fn both<A: Send, B>(
    is_parallel: bool,
    first: impl FnOnce() -> Result<A> + Send,
    second: impl FnOnce() -> Result<B>,
) -> Result<(A, B)> {
    if !is_parallel {
        return Ok((guarded(first)?, guarded(second)?));
    }
    std::thread::scope(|scope| {
        let first = std::thread::Builder::new()
            .stack_size(STACK_BYTES)
            .spawn_scoped(scope, || guarded(first))
            .map_err(no_thread)?;
        let second = guarded(second);
        let first = first.join().unwrap_or_else(|_| Err(worker_died()));
        Ok((first?, second?))
    })
}

/// Blocks under way per thread in `in_order`; two keep a thread busy while the consumer works.
pub const BLOCKS_PER_THREAD: usize = 2;

/// Runs `produce` for blocks `0..n_blocks` on `threads` threads and `consume` on this thread, in block order.
///
/// At most `threads * 2` results exist at a time; each is re-used, so `produce` gets an old one to
/// overwrite. The first error, in block order, ends the run.
pub fn in_order<T: Default + Send>(
    n_blocks: u64,
    threads: usize,
    progress: &Progress,
    produce: impl Fn(u64, &mut T) -> Result<()> + Sync,
    mut consume: impl FnMut(u64, &mut T) -> Result<()>,
) -> Result<()> {
    let threads = threads.max(1).min(n_blocks.max(1) as usize);
    let slots: Vec<Mutex<T>> = (0..threads * BLOCKS_PER_THREAD).map(|_| Mutex::default()).collect();
    // A slot has one holder at a time: the lock is never waited for. After a panic in `produce` the block
    // counts as failed, and nothing reads its slot.
    let held = |slot: usize| slots[slot].lock().unwrap_or_else(PoisonError::into_inner);
    numbers_in_order(
        n_blocks,
        threads,
        &|index, slot| progress.check().and_then(|()| produce(index, &mut held(slot))),
        &mut |index, slot| consume(index, &mut held(slot)),
    )
}

/// Appends to a list what `fill` makes of `n` places, a range of at most `block` of them at a time; in their order.
pub fn in_blocks<T: Send>(
    (n, block): (usize, usize),
    (threads, progress): (usize, &Progress),
    all: &mut Vec<T>,
    fill: impl Fn(Range<usize>, &mut Vec<T>) -> Result<()> + Sync,
) -> Result<()> {
    in_order(
        n.div_ceil(block) as u64,
        threads,
        progress,
        |index, some: &mut Vec<T>| {
            some.clear();
            let first = index as usize * block;
            fill(first..n.min(first + block), some)
        },
        |_, some| {
            all.append(some);
            Ok(())
        },
    )
}

/// Runs `in_order` on numbers of blocks and of slots for their results.
///
/// Compiled once for all types of results: threads and channels are much code for each.
fn numbers_in_order(
    n_blocks: u64,
    threads: usize,
    produce: &(dyn Fn(u64, usize) -> Result<()> + Sync),
    consume: &mut dyn FnMut(u64, usize) -> Result<()>,
) -> Result<()> {
    let window = threads * BLOCKS_PER_THREAD;
    let (give, spare) = bounded::<usize>(window);
    let (send, receive) = bounded::<(u64, usize, Result<()>)>(window);
    for slot in 0..window {
        give.send(slot).expect("the channel holds a whole window");
    }
    let next = Mutex::new(0u64);
    std::thread::scope(|scope| {
        for started in 0..threads {
            let (send, spare, next) = (send.clone(), spare.clone(), &next);
            let worker = move || {
                loop {
                    // Taking the spare slot under the lock keeps blocks in order of issue, so that
                    // the block the consumer waits for is always among those under way.
                    let (index, slot) = {
                        let mut next = next.lock().unwrap_or_else(PoisonError::into_inner);
                        if *next >= n_blocks {
                            return;
                        }
                        let Ok(slot) = spare.recv() else { return };
                        *next += 1;
                        (*next - 1, slot)
                    };
                    let outcome = guarded(|| produce(index, slot));
                    let failed = outcome.is_err();
                    if send.send((index, slot, outcome)).is_err() || failed {
                        return;
                    }
                }
            };
            match std::thread::Builder::new().stack_size(STACK_BYTES).spawn_scoped(scope, worker) {
                Ok(_) => {}
                // Fewer do the same work.
                Err(_) if started > 0 => break,
                Err(e) => return Err(no_thread(e)),
            }
        }
        drop(send);
        drop(spare);
        // Moved in, so that an early return hangs up both channels and the workers end.
        let (receive, give) = (receive, give);
        let mut waiting = BTreeMap::new();
        for index in 0..n_blocks {
            let (slot, outcome) = loop {
                if let Some(found) = waiting.remove(&index) {
                    break found;
                }
                match receive.recv() {
                    Ok((index, slot, outcome)) => {
                        waiting.insert(index, (slot, outcome));
                    }
                    Err(_) => {
                        // Every worker has ended without this block: one of them failed.
                        let failed =
                            std::mem::take(&mut waiting).into_values().find_map(|(_, o)| o.err());
                        return Err(failed.unwrap_or_else(worker_died));
                    }
                }
            };
            outcome?;
            consume(index, slot)?;
            // Workers that have ended no longer take spares; that is not a fault.
            let _ = give.send(slot);
        }
        Ok(())
    })
}

fn worker_died() -> Error {
    Error::Internal("a worker thread ended without a word".to_owned())
}

/// One job of `largest_first`.
#[derive(Clone, Copy, Debug)]
pub struct Weighted {
    /// The caller's number for this job.
    pub item: usize,
    /// Memory that the job takes while it runs.
    pub bytes: u64,
}

struct Queue {
    waiting: Vec<Weighted>,
    free_bytes: u64,
    running: usize,
    failed: Option<Error>,
}

/// Runs independent jobs on `threads` threads, largest first, never more at once than `budget_bytes` hold.
///
/// A job that exceeds the budget alone still runs, alone: whether it may is decided by the plan. Every job is
/// announced when about one more round of jobs is to come before it, so that its bytes can be on their way
/// while others compute. The first failure lets running jobs end and begins no further ones. Freed memory goes back
/// to the system after each job that takes more than its thread's share of the budget, and in the end.
pub fn largest_first(
    mut jobs: Vec<Weighted>,
    threads: usize,
    budget_bytes: u64,
    progress: &Progress,
    announce: impl Fn(usize) + Sync,
    work: impl Fn(usize) -> Result<()> + Sync,
) -> Result<()> {
    let threads = threads.max(1);
    // Ascending, so that the largest is popped from the end; ties in descending item order.
    jobs.sort_by_key(|job| (job.bytes, std::cmp::Reverse(job.item)));
    let queue =
        Mutex::new(Queue { waiting: jobs, free_bytes: budget_bytes, running: 0, failed: None });
    let changed = Condvar::new();
    let lock = || queue.lock().unwrap_or_else(PoisonError::into_inner);
    let worker = || {
        loop {
            let (job, soon) = {
                let mut queue = lock();
                let job = loop {
                    if queue.failed.is_some() || queue.waiting.is_empty() {
                        return;
                    }
                    let fits = queue.waiting.iter().rposition(|job| job.bytes <= queue.free_bytes);
                    if let Some(at) =
                        fits.or_else(|| (queue.running == 0).then_some(queue.waiting.len() - 1))
                    {
                        let job = queue.waiting.remove(at);
                        queue.free_bytes = queue.free_bytes.saturating_sub(job.bytes);
                        queue.running += 1;
                        break job;
                    }
                    queue = changed.wait(queue).unwrap_or_else(PoisonError::into_inner);
                };
                let soon = queue.waiting.len().checked_sub(threads);
                (job, soon.map(|at| queue.waiting[at].item))
            };
            if let Some(item) = soon {
                announce(item);
            }
            let outcome = guarded(|| progress.check().and_then(|()| work(job.item)));
            if job.bytes > budget_bytes / threads as u64 {
                give_back();
            }
            let mut queue = lock();
            queue.running -= 1;
            queue.free_bytes = (queue.free_bytes + job.bytes).min(budget_bytes);
            if let Err(error) = outcome {
                queue.failed.get_or_insert(error);
            }
            drop(queue);
            changed.notify_all();
        }
    };
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .stack_size(STACK_BYTES)
        .build()
        .map_err(no_thread)?
        .broadcast(|_| worker());
    give_back();
    match queue.into_inner().unwrap_or_else(PoisonError::into_inner).failed {
        Some(error) => Err(error),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[test]
    fn of_two_things_the_first_error_counts_and_a_panic_is_one() {
        for is_parallel in [false, true] {
            assert_eq!(both(is_parallel, || Ok(1), || Ok("two")).unwrap(), (1, "two"));
            let fails = |words: &str| Err::<(), _>(Error::Internal(words.to_owned()));
            let words = |outcome: Result<((), ())>| outcome.unwrap_err().to_string();
            let first = words(both(is_parallel, || fails("one"), || fails("two")));
            assert!(first.contains("one") && !first.contains("two"), "{first}");
            assert!(words(both(is_parallel, || Ok(()), || fails("two"))).contains("two"));
            let panics = || -> Result<()> { panic!("injected fault") };
            assert!(words(both(is_parallel, panics, || Ok(()))).contains("injected fault"));
            assert!(words(both(is_parallel, || Ok(()), panics)).contains("injected fault"));
        }
    }

    /// A frame of 64 KiB for each step down.
    fn deep(left: u32) -> u8 {
        let frame = std::hint::black_box([left as u8; 64 << 10]);
        if left == 0 { frame[0] } else { deep(left - 1) | frame[7] }
    }

    /// A worker gets as deep as the main thread with its 8 MiB.
    #[test]
    fn workers_have_the_stack_of_the_main_thread() {
        let steps = 4 << 4;
        let progress = Progress::default();
        let work = || -> Result<()> {
            std::hint::black_box(deep(steps));
            Ok(())
        };
        both(true, work, || Ok(())).unwrap();
        let produce = |_: u64, _: &mut ()| work();
        in_order(2, 2, &progress, produce, |_, _| Ok(())).unwrap();
        let jobs = vec![Weighted { item: 0, bytes: 1 }];
        largest_first(jobs, 2, 1, &progress, |_| (), |_| work()).unwrap();
    }

    #[test]
    fn blocks_arrive_in_order_whatever_the_threads() {
        for threads in [1, 2, 5] {
            let mut seen = Vec::new();
            in_order(
                100,
                threads,
                &Progress::default(),
                |i, out: &mut u64| {
                    *out = i * i;
                    Ok(())
                },
                |i, value| {
                    assert_eq!(*value, i * i);
                    seen.push(i);
                    Ok(())
                },
            )
            .unwrap();
            assert_eq!(seen, (0..100).collect::<Vec<_>>());
        }
    }

    #[test]
    fn the_first_error_in_block_order_ends_the_run() {
        let fail = |i: u64, _: &mut ()| {
            if i >= 7 { Err(Error::Usage(format!("block {i}"))) } else { Ok(()) }
        };
        let outcome = in_order(1000, 3, &Progress::default(), fail, |_, _| Ok(()));
        assert_eq!(outcome.unwrap_err().to_string(), "block 7");
    }

    #[test]
    fn jobs_never_exceed_the_budget_and_all_run() {
        let (now, most, done) = (AtomicU64::new(0), AtomicU64::new(0), AtomicU64::new(0));
        let jobs = (0..50).map(|i| Weighted { item: i, bytes: 10 + i as u64 % 7 }).collect();
        let announced = Mutex::new(Vec::new());
        let announce = |i| announced.lock().unwrap().push(i);
        largest_first(jobs, 4, 33, &Progress::default(), announce, |i| {
            let bytes = 10 + i as u64 % 7;
            let held = now.fetch_add(bytes, Ordering::SeqCst) + bytes;
            most.fetch_max(held, Ordering::SeqCst);
            std::thread::yield_now();
            now.fetch_sub(bytes, Ordering::SeqCst);
            done.fetch_add(1, Ordering::SeqCst);
            Ok(())
        })
        .unwrap();
        assert_eq!(done.into_inner(), 50);
        let mut announced = announced.into_inner().unwrap();
        announced.sort_unstable();
        announced.dedup();
        // A job may begin before it could be announced: how many do depends on the machine.
        assert!(announced.len() >= 10 && announced.iter().all(|&i| i < 50), "{announced:?}");
        assert!(most.into_inner() <= 33);
    }

    /// Panics at 13, for every number of threads and in either half of the work.
    #[test]
    fn a_panic_is_an_error_with_its_words() {
        let fall = |i: u64| assert!(i != 13, "number {i} falls");
        let told = |outcome: Result<()>| {
            let error = outcome.unwrap_err();
            assert_eq!(error.exit_code(), 9);
            assert!(error.to_string().contains("number 13 falls"), "{error}");
        };
        let progress = Progress::default();
        for threads in [1, 2, 5] {
            let ok = |_: u64, _: &mut ()| Ok(());
            let produce = |i: u64, _: &mut ()| {
                fall(i);
                Ok(())
            };
            told(in_order(1000, threads, &progress, produce, ok));
            let consume = |i: u64, _: &mut ()| {
                fall(i);
                Ok(())
            };
            told(guarded(|| in_order(1000, threads, &progress, ok, consume)));
            let jobs = (0..50).map(|item| Weighted { item, bytes: 1 }).collect();
            told(largest_first(
                jobs,
                threads,
                3,
                &progress,
                |_| (),
                |item| {
                    fall(item as u64);
                    Ok(())
                },
            ));
        }
    }
}
