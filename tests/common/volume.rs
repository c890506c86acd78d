//! A small volume for tests: a tmpfs, where there is the right to mount one.

use std::path::Path;
use std::process::Command;

/// A mounted tmpfs, unmounted when dropped.
pub struct Volume {
    folder: tempfile::TempDir,
}

impl Volume {
    /// Mounts one; none, and a word about it, without the right to do so.
    pub fn mount(options: &str) -> Option<Volume> {
        let folder = tempfile::tempdir().unwrap();
        let mount = |options: &str| {
            Command::new("mount")
                .args(["-t", "tmpfs", "-o", options, "tmpfs"])
                .arg(folder.path())
                .output()
                .is_ok_and(|output| output.status.success())
        };
        if mount(options) {
            return Some(Volume { folder });
        }
        super::skipped("no right to mount a tmpfs here");
        None
    }

    /// Where it is mounted.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Bytes that still go in.
    pub fn free_bytes(&self) -> u64 {
        let stat = rustix::fs::statvfs(self.path()).unwrap();
        stat.f_bavail * stat.f_frsize
    }

    /// Mounts it again with other options.
    pub fn remount(&self, options: &str) {
        let status = Command::new("mount").args(["-o", options]).arg(self.path()).status().unwrap();
        assert!(status.success(), "mount -o {options}");
    }
}

impl Drop for Volume {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(self.path()).status();
    }
}
