//! Runs one command in a process of its own and records what it took.
//!
//! Time and peak resident memory come from `wait4`, bytes read and written from `/proc/PID/io` after the
//! process ended and before it is reaped, temporary disk from looking at its folder every 50 ms. A limit
//! on memory is a cgroup (version 1 or 2) made for the run, where this process may make one. Knows nothing
//! of meshes.

use crate::Outcome;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How often temporary disk is looked at.
const LOOK: Duration = Duration::from_millis(50);

/// What to run, and within what.
#[derive(Clone, Debug)]
pub struct Job<'a> {
    /// Program and arguments.
    pub command: Vec<String>,
    /// Where it runs and everything it writes lies; disk use is counted here.
    pub folder: &'a Path,
    /// Files in `folder` that are no temporary data: the output.
    pub outputs: Vec<PathBuf>,
    /// Seconds after which it is killed.
    pub seconds: u64,
    /// Memory limit in bytes, page cache included.
    pub memory_bytes: Option<u64>,
}

/// How a process ended.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// By itself, with this code.
    Exit(i32),
    /// By a signal of its own or of somebody else's.
    Signal(i32),
    /// By the memory limit.
    OutOfMemory,
    /// By the time limit.
    OutOfTime,
    /// It could not be run.
    #[default]
    Missing,
}

impl Ending {
    /// In words for a table; empty if all is well.
    pub fn words(&self) -> String {
        match self {
            Ending::Exit(0) => String::new(),
            Ending::Exit(code) => format!("exit code {code}"),
            Ending::Signal(11) => "crashed (SIGSEGV)".to_owned(),
            Ending::Signal(6) => "crashed (SIGABRT)".to_owned(),
            Ending::Signal(signal) => format!("ended by signal {signal}"),
            Ending::OutOfMemory => "out of memory".to_owned(),
            Ending::OutOfTime => "out of time".to_owned(),
            Ending::Missing => "not installed".to_owned(),
        }
    }
}

/// What a process took. Times in seconds.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Usage {
    /// How it ended.
    pub ending: Ending,
    /// Wall time from start to end, loading of the program included.
    pub wall: f64,
    /// CPU time in user mode, all threads.
    pub user: f64,
    /// CPU time in the kernel, all threads.
    pub system: f64,
    /// Peak resident memory.
    pub rss_bytes: u64,
    /// Peak of the run's cgroup, page cache included; `None` without a cgroup.
    pub cgroup_bytes: Option<u64>,
    /// Bytes read by system calls, from disk or page cache.
    pub read_bytes: u64,
    /// Bytes written by system calls.
    pub written_bytes: u64,
    /// Bytes that had to come from the disk.
    pub disk_read_bytes: u64,
    /// Peak disk space in the run's folder besides the outputs.
    pub temp_bytes: u64,
}

/// Runs a job; the second value is what it printed on standard output, the third the end of standard error.
pub fn run(job: &Job) -> Outcome<(Usage, String, String)> {
    let out_path = job.folder.join("stdout.txt");
    let err_path = job.folder.join("stderr.txt");
    let group = job.memory_bytes.and_then(Group::make);
    let mut command = match &group {
        // The process enters its group before it becomes the program.
        Some(group) => {
            let mut command = Command::new("/bin/sh");
            command
                .args(["-c", "echo $$ > \"$0\" && exec \"$@\""])
                .arg(group.folder.join("cgroup.procs"));
            command.args(&job.command);
            command
        }
        None => {
            let mut command = Command::new(&job.command[0]);
            command.args(&job.command[1..]);
            command
        }
    };
    command.current_dir(job.folder).stdin(Stdio::null());
    command.stdout(File::create(&out_path)?).stderr(File::create(&err_path)?);
    let begin = Instant::now();
    let Ok(child) = command.spawn() else {
        return Ok((Usage::default(), String::new(), String::new()));
    };
    let pid = child.id() as libc::pid_t;
    let (done, late) = (AtomicBool::new(false), AtomicBool::new(false));
    let mut usage = Usage::default();
    let no_data: Vec<PathBuf> = job.outputs.iter().chain([&out_path, &err_path]).cloned().collect();
    let ended = std::thread::scope(|scope| {
        let watcher = scope.spawn(|| {
            let mut peak = 0;
            while !done.load(Ordering::Acquire) {
                peak = peak.max(disk_bytes(job.folder, &no_data));
                if begin.elapsed().as_secs() >= job.seconds && !late.swap(true, Ordering::AcqRel) {
                    // SAFETY: the process is not reaped before `done`, so the id is still its own.
                    unsafe { libc::kill(pid, libc::SIGKILL) };
                }
                std::thread::park_timeout(LOOK);
            }
            peak
        });
        let ended = wait_without_reaping(pid);
        usage.wall = begin.elapsed().as_secs_f64();
        done.store(true, Ordering::Release);
        watcher.thread().unpark();
        usage.temp_bytes = watcher.join().unwrap_or(0);
        ended
    });
    ended?;
    let io = std::fs::read_to_string(format!("/proc/{pid}/io")).unwrap_or_default();
    let of = |name: &str| field(&io, name);
    usage.read_bytes = of("rchar:");
    usage.written_bytes = of("wchar:");
    usage.disk_read_bytes = of("read_bytes:");
    let status = reap(pid, &mut usage)?;
    usage.ending = ending(status, late.into_inner(), group.as_ref());
    usage.cgroup_bytes = group.as_ref().map(Group::peak_bytes);
    let said = std::fs::read_to_string(&out_path).unwrap_or_default();
    let complaint =
        String::from_utf8_lossy(&std::fs::read(&err_path).unwrap_or_default()).into_owned();
    Ok((usage, said, complaint))
}

fn ending(status: i32, late: bool, group: Option<&Group>) -> Ending {
    if libc::WIFEXITED(status) {
        match libc::WEXITSTATUS(status) {
            127 if group.is_some() => Ending::Missing,
            code => Ending::Exit(code),
        }
    } else if late {
        Ending::OutOfTime
    } else if libc::WTERMSIG(status) == libc::SIGKILL && group.is_some_and(Group::killed) {
        Ending::OutOfMemory
    } else {
        Ending::Signal(libc::WTERMSIG(status))
    }
}

fn wait_without_reaping(pid: libc::pid_t) -> std::io::Result<()> {
    loop {
        // SAFETY: zero bytes are a valid `siginfo_t`, which the call only writes to.
        let mut info: libc::siginfo_t = unsafe { std::mem::zeroed() };
        // SAFETY: `info` is valid for writing; the child is ours and not reaped yet.
        let code = unsafe {
            libc::waitid(libc::P_PID, pid as libc::id_t, &mut info, libc::WEXITED | libc::WNOWAIT)
        };
        let error = std::io::Error::last_os_error();
        match code {
            0 => return Ok(()),
            _ if error.kind() == std::io::ErrorKind::Interrupted => {}
            _ => return Err(error),
        }
    }
}

/// Takes the ended child's status and adds its resource usage to `usage`.
fn reap(pid: libc::pid_t, usage: &mut Usage) -> std::io::Result<i32> {
    let mut status = 0;
    // SAFETY: zero bytes are a valid `rusage`, which the call only writes to.
    let mut taken: libc::rusage = unsafe { std::mem::zeroed() };
    // SAFETY: both places are valid for writing; the child is ours, has ended and is not reaped yet.
    if unsafe { libc::wait4(pid, &mut status, 0, &mut taken) } != pid {
        return Err(std::io::Error::last_os_error());
    }
    let seconds = |time: libc::timeval| time.tv_sec as f64 + time.tv_usec as f64 * 1e-6;
    usage.user = seconds(taken.ru_utime);
    usage.system = seconds(taken.ru_stime);
    usage.rss_bytes = taken.ru_maxrss as u64 * 1024;
    Ok(status)
}

/// Bytes on disk of all files below `folder` but `outputs`.
fn disk_bytes(folder: &Path, outputs: &[PathBuf]) -> u64 {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    entries
        .flatten()
        .filter(|entry| !outputs.contains(&entry.path()))
        .map(|entry| match entry.metadata() {
            Ok(meta) if meta.is_dir() => disk_bytes(&entry.path(), outputs),
            Ok(meta) => meta.blocks() * 512,
            Err(_) => 0,
        })
        .sum()
}

fn field(text: &str, name: &str) -> u64 {
    let line = text.lines().find_map(|line| line.strip_prefix(name));
    line.and_then(|rest| rest.trim().parse().ok()).unwrap_or(0)
}

/// A memory cgroup that lives as long as one run.
struct Group {
    folder: PathBuf,
    limit: (&'static str, &'static str, &'static str),
}

/// Root of the hierarchy; its files for the limit, the peak and the kills.
const HIERARCHIES: [(&str, (&str, &str, &str)); 2] = [
    (
        "/sys/fs/cgroup/memory",
        ("memory.limit_in_bytes", "memory.max_usage_in_bytes", "memory.oom_control"),
    ),
    ("/sys/fs/cgroup", ("memory.max", "memory.peak", "memory.events")),
];

impl Group {
    /// `None` where cgroups cannot be made: no root, no memory controller.
    fn make(limit_bytes: u64) -> Option<Group> {
        HIERARCHIES.iter().find_map(|(root, files)| {
            let folder = Path::new(root).join(format!("stonecut-bench-{}", std::process::id()));
            std::fs::create_dir_all(&folder).ok()?;
            let group = Group { folder, limit: *files };
            std::fs::write(group.folder.join(files.0), limit_bytes.to_string()).ok()?;
            Some(group)
        })
    }

    fn peak_bytes(&self) -> u64 {
        let text = std::fs::read_to_string(self.folder.join(self.limit.1)).unwrap_or_default();
        text.trim().parse().unwrap_or(0)
    }

    fn killed(&self) -> bool {
        let text = std::fs::read_to_string(self.folder.join(self.limit.2)).unwrap_or_default();
        // The file may not count kills; then a kill that was not ours was the limit's.
        field(&text, "oom_kill ") > 0 || !text.contains("oom_kill ")
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir(&self.folder);
    }
}

/// Whether memory limits can be set here.
pub fn can_limit() -> bool {
    Group::make(1 << 30).is_some()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder =
            std::env::temp_dir().join(format!("stonecut-bench-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    fn job<'a>(folder: &'a Path, script: &str) -> Job<'a> {
        let command = ["/bin/sh", "-c", script].map(str::to_owned).to_vec();
        Job { command, folder, outputs: vec![folder.join("out")], seconds: 10, memory_bytes: None }
    }

    #[test]
    fn records_bytes_time_and_temporary_disk() {
        let folder = folder("records");
        let script =
            "head -c 300000 /dev/zero > temp; cp temp out; sleep 0.3; rm temp; echo said; exit 3";
        let (usage, said, _) = run(&job(&folder, script)).unwrap();
        assert_eq!(usage.ending, Ending::Exit(3));
        assert_eq!(said, "said\n");
        assert!(usage.wall >= 0.3 && usage.rss_bytes > 0);
        assert!((300_000..400_000).contains(&usage.temp_bytes), "{}", usage.temp_bytes);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_late_process_is_killed_and_said_to_be_late() {
        let folder = folder("late");
        let (usage, ..) = run(&Job { seconds: 0, ..job(&folder, "exec sleep 20") }).unwrap();
        assert_eq!(usage.ending, Ending::OutOfTime);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn what_cannot_be_run_is_missing() {
        let folder = folder("missing");
        let missing = Job { command: vec!["/no/such/program".to_owned()], ..job(&folder, "") };
        assert_eq!(run(&missing).unwrap().0.ending, Ending::Missing);
        std::fs::remove_dir_all(folder).unwrap();
    }
}
