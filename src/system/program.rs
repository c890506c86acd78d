//! This program as a process: its code, its host, its parent, the time it has used.

use crate::error::{Error, Result};
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};
use xxhash_rust::xxh3::xxh3_64;

/// The file that this code was loaded from: the program, or an extension of another one.
fn file() -> PathBuf {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let here = checksum as fn() -> Result<String> as usize;
    let holds = |line: &&str| {
        let ends = line.split(' ').next().and_then(|range| range.split_once('-'));
        let ends = ends.map(|(a, b)| (usize::from_str_radix(a, 16), usize::from_str_radix(b, 16)));
        matches!(ends, Some((Ok(first), Ok(end))) if (first..end).contains(&here))
    };
    let mapped = maps.lines().find(holds).and_then(|line| line.find('/').map(|at| &line[at..]));
    mapped.map_or_else(|| PathBuf::from("/proc/self/exe"), PathBuf::from)
}

/// Checksum of the file that this code was loaded from.
pub fn checksum() -> Result<String> {
    let path = file();
    let bytes = std::fs::read(&path).map_err(|e| Error::reading(&path, "cannot read", e))?;
    Ok(format!("{:016x}", xxh3_64(&bytes)))
}

/// A mark of that file which is found without reading it: its path, inode and length, and the times of its last changes.
/// Two files with one mark have the same bytes, since the time of the last change of an inode cannot be set; the same file
/// has it on all machines that share it. `None` where the file is gone.
pub fn mark() -> Option<String> {
    let path = file();
    let meta = std::fs::metadata(&path).ok()?;
    let times = [meta.mtime(), meta.mtime_nsec(), meta.ctime(), meta.ctime_nsec()];
    Some(format!("{} {} {} {times:?}", path.display(), meta.ino(), meta.len()))
}

/// The name of this machine, letters and digits only.
pub fn host() -> String {
    let name = rustix::system::uname().nodename().to_string_lossy().into_owned();
    name.chars().filter(char::is_ascii_alphanumeric).take(24).collect()
}

/// A name that no other process has or will have: host, number of the process, and a checksum of the moment.
pub fn unique_name() -> String {
    let (host, process) = (host(), std::process::id());
    let moment = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
    let mark = xxh3_64(format!("{host} {process} {moment}").as_bytes()) as u32;
    format!("{host}-{process}-{mark:08x}")
}

/// Seconds since 1970, by the clock of this machine.
pub fn now() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

/// Lets the system kill this process as soon as its parent ends, however that happens.
pub fn end_with_parent() -> Result<()> {
    use rustix::process::{Signal, getppid, set_parent_process_death_signal};
    let parent = getppid();
    set_parent_process_death_signal(Some(Signal::KILL))
        .map_err(|e| Error::reading("/proc/self", "cannot end with the parent", e.into()))?;
    // It may have ended before that.
    if getppid() != parent {
        return Err(Error::Interrupted { signal: 15 });
    }
    Ok(())
}

/// Processor time that this process has used, in seconds; 0 where the system does not tell.
pub fn processor_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name of the program, in parentheses, may hold blanks.
    let rest = text.rsplit_once(')').map_or("", |(_, rest)| rest);
    let ticks = rest.split_whitespace().skip(11).take(2).filter_map(|n| n.parse::<u64>().ok());
    ticks.sum::<u64>() as f64 / rustix::param::clock_ticks_per_second() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_knows_itself() {
        let exe = std::fs::read("/proc/self/exe").unwrap();
        assert_eq!(checksum().unwrap(), format!("{:016x}", xxh3_64(&exe)));
        assert_eq!(mark(), mark());
        assert!(mark().is_some_and(|mark| mark.contains(&format!(" {} ", exe.len()))));
        assert_ne!(unique_name(), unique_name());
        assert!(processor_seconds() >= 0.0 && !host().is_empty());
    }
}
