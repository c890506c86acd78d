//! Memory that this process may use, and memory that it has used.
//!
//! The default budget is a share of the tightest limit in force: physical memory, cgroup v1, cgroup v2.

use std::path::Path;

/// Share of the tightest limit that is taken when `--memory` is not given.
pub const DEFAULT_SHARE: f64 = 0.75;

/// Largest share of the tightest limit that `--memory` may ask for: what exceeds it is not given, since code, stacks
/// and the system's own tables need the rest.
pub const MOST_SHARE: f64 = 0.9;

/// Need of these in a container: all but this of its limit can be asked for.
const REST_BYTES: u64 = 64 << 20;

/// Limits above are those of machines, whose system needs more.
const CONTAINER_BYTES: u64 = 4 << 30;

/// Memory for code, stacks, allocator slack and small things, in bytes.
pub const BASE_BYTES: u64 = 40 << 20;

/// The budget that a wish comes to: no more than `MOST_SHARE` of `limit_bytes`, or in a container all but `REST_BYTES` of it;
/// `DEFAULT_SHARE` of it without a wish.
pub fn budget_bytes(wanted: Option<u64>, limit_bytes: u64) -> u64 {
    let share = |share: f64| (limit_bytes as f64 * share) as u64;
    let rest = match limit_bytes {
        0..CONTAINER_BYTES => limit_bytes.saturating_sub(REST_BYTES),
        _ => 0,
    };
    wanted.map_or(share(DEFAULT_SHARE), |bytes| bytes.min(share(MOST_SHARE).max(rest)))
}

/// The tightest memory limit in force for this process, in bytes.
pub fn limit_bytes() -> u64 {
    let info = rustix::system::sysinfo();
    let physical = info.totalram as u64 * u64::from(info.mem_unit.max(1));
    cgroup_limits("memory", "memory.limit_in_bytes", "memory.max")
        .into_iter()
        .fold(physical, u64::min)
}

/// The number of cores this process may use, CPU affinity and cgroup quota included.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Peak resident memory of this process so far, in bytes; 0 where the system does not tell.
pub fn peak_bytes() -> u64 {
    status_kib("VmHWM:") * 1024
}

/// Gives memory that was freed back to the system.
///
/// The allocator keeps an arena for each thread and holds on to what was freed in it. What eight threads have used, one
/// after the other, would stay resident eight times.
pub fn give_back() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        unsafe extern "C" {
            fn malloc_trim(pad: usize) -> std::ffi::c_int;
        }
        // SAFETY: the C library's own function; it locks what it changes, and changes nothing that is in use.
        unsafe { malloc_trim(0) };
    }
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn tune_allocator(parameter: std::ffi::c_int, value: std::ffi::c_int) {
    use std::ffi::c_int;
    unsafe extern "C" {
        fn mallopt(parameter: c_int, value: c_int) -> c_int;
    }
    // SAFETY: the C library's own function; it locks what it changes, which is a number for later allocations.
    unsafe { mallopt(parameter, value) };
}

/// Lets all threads of the process share one heap, from now on; before there are any.
///
/// With a heap for each, what threads that come and go leave behind is not used again by others: a bake of 5 million
/// triangles within 700 MiB was seen to have 844 MiB resident, 636 MiB with one heap, in the same time.
pub fn share_one_heap() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        const M_ARENA_MAX: std::ffi::c_int = -8;
        tune_allocator(M_ARENA_MAX, 1);
    }
}

/// Makes the allocator give every large piece back as soon as it is freed, from now on, at some cost in time.
///
/// Left to itself it keeps pieces of up to 32 MiB for later: a run whose live memory peaks at 98 MiB was seen to have
/// 150 MiB resident.
pub fn keep_nothing_back() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        const M_MMAP_THRESHOLD: std::ffi::c_int = -3;
        const LARGE_BYTES: std::ffi::c_int = 1 << 20;
        tune_allocator(M_MMAP_THRESHOLD, LARGE_BYTES);
    }
}

/// Resident memory of this process now, in bytes; 0 where the system does not tell.
pub fn resident_bytes() -> u64 {
    status_kib("VmRSS:") * 1024
}

fn status_kib(field: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with(field)).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kib| kib.parse().ok()).unwrap_or(0)
}

/// Limits of every cgroup from this process's own up to the root, v1 and v2.
fn cgroup_limits(controller: &str, v1_file: &str, v2_file: &str) -> Vec<u64> {
    let mut limits = Vec::new();
    for line in std::fs::read_to_string("/proc/self/cgroup").unwrap_or_default().lines() {
        let mut parts = line.splitn(3, ':');
        let (Some(_), Some(controllers), Some(path)) = (parts.next(), parts.next(), parts.next())
        else {
            continue;
        };
        let (root, file) = if controllers.is_empty() {
            ("/sys/fs/cgroup".to_owned(), v2_file)
        } else if controllers.split(',').any(|name| name == controller) {
            (format!("/sys/fs/cgroup/{controller}"), v1_file)
        } else {
            continue;
        };
        let mut folder = Path::new(path.trim_start_matches('/'));
        loop {
            let name = Path::new(&root).join(folder).join(file);
            if let Ok(text) = std::fs::read_to_string(name)
                && let Ok(limit) = text.trim().parse::<u64>()
            {
                limits.push(limit);
            }
            match folder.parent() {
                Some(parent) => folder = parent,
                None => break,
            }
        }
    }
    limits
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_budget_stays_within_the_limit() {
        assert_eq!(super::budget_bytes(None, 1000), 750);
        assert_eq!(super::budget_bytes(Some(300), 1000), 300);
        assert_eq!(super::budget_bytes(Some(1 << 40), 1000), 900);
        // What a refusal names is given in a container of that and 64 MiB.
        assert_eq!(super::budget_bytes(Some(1032 << 20), 1096 << 20), 1032 << 20);
        assert_eq!(super::budget_bytes(Some(1 << 40), 10_000_000_000), 9_000_000_000);
    }

    #[test]
    fn limits_and_peaks_are_plausible() {
        assert!(super::limit_bytes() > 1 << 20);
        assert!(super::cores() >= 1);
        if cfg!(target_os = "linux") {
            assert!(super::peak_bytes() >= super::resident_bytes() / 2);
        }
    }
}
