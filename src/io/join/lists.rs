//! Lists of files (`@list.txt`), one path a line, as editors and shells of any system write them; the order of names.

use super::limits::{PART_BYTES, hold};
use crate::encodings::text_of_file;
use std::borrow::Cow;
use std::cmp::Ordering;
use std::path::{Path, PathBuf};
use stonecut_system::disk::{open_input, read_regular};
use stonecut_system::error::{Error, Result};

/// Bytes of a list at most.
const MOST_LIST_BYTES: u64 = 64 << 20;

/// The file of a list `@list.txt`.
pub(super) fn list_of(path: &Path) -> Option<Cow<'_, Path>> {
    let name = path.to_str()?.strip_prefix('@').filter(|name| !name.is_empty())?;
    (!path.exists()).then_some(Cow::Borrowed(Path::new(name)))
}

/// The paths of a list, from its folder on; `limit` is the memory for them.
pub(super) fn paths_of(list: &Path, limit: u64) -> Result<Vec<PathBuf>> {
    // Says by itself what is not a file.
    open_input(list)?;
    let text =
        read_regular(list, MOST_LIST_BYTES).map_err(|e| Error::reading(list, "cannot read", e))?;
    let text = String::from_utf8(text_of_file(text))
        .map_err(|_| Error::bad_input(list, "a list of files is text in UTF-8 or UTF-16"))?;
    let folder = list.parent().unwrap_or(Path::new(""));
    let lines = text.split(['\n', '\r']).map(str::trim);
    let lines = lines.filter(|line| !line.is_empty() && !line.starts_with('#'));
    let needed = lines.clone().map(|line| PART_BYTES + 3 * line.len() as u64).sum();
    hold(list, "this list", needed, limit)?;
    if let Some(line) = lines.clone().find(|line| list_of(Path::new(line)).is_some()) {
        return Err(Error::bad_input(list, format!("{line}: a list in a list")));
    }
    Ok(lines.map(|line| path_of(folder, line)).collect())
}

/// The path of a line: as written, or else without quotes around it and with slashes for backslashes.
fn path_of(folder: &Path, line: &str) -> PathBuf {
    let written = folder.join(line);
    let is_quote = |c: char| matches!(c, '"' | '\'');
    let bare = line.trim_matches(is_quote);
    let other = |name: &str| Some(folder.join(name)).filter(|path| path.exists());
    match written.exists() {
        true => written,
        false => other(bare).or_else(|| other(&bare.replace('\\', "/"))).unwrap_or(written),
    }
}

/// Orders names as people do: `tile_9` before `tile_10`.
pub(super) fn by_name(a: &Path, b: &Path) -> Ordering {
    let (full_a, full_b) = (a.to_string_lossy(), b.to_string_lossy());
    let (mut a, mut b) = (full_a.as_bytes(), full_b.as_bytes());
    loop {
        let digits = |text: &[u8]| text.iter().take_while(|c| c.is_ascii_digit()).count();
        let (n, m) = (digits(a), digits(b));
        if n > 0 && m > 0 {
            let number = |text: &[u8]| -> Vec<u8> {
                text.iter().copied().skip_while(|&c| c == b'0').collect()
            };
            let (x, y) = (number(&a[..n]), number(&b[..m]));
            match x.len().cmp(&y.len()).then_with(|| x.cmp(&y)) {
                Ordering::Equal => (a, b) = (&a[n..], &b[m..]),
                other => return other,
            }
            continue;
        }
        match (a.first(), b.first()) {
            (Some(x), Some(y)) if x == y => (a, b) = (&a[1..], &b[1..]),
            (Some(x), Some(y)) => return x.cmp(y),
            // Names that differ by zeros before a number only.
            (None, None) => return full_a.cmp(&full_b),
            (x, y) => return x.is_some().cmp(&y.is_some()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_any_system_name_the_same_files() {
        let home = tempfile::tempdir().unwrap();
        let at = |name: &str| home.path().join(name);
        std::fs::create_dir(at("sub")).unwrap();
        for name in ["sub/a.ply", "my b.ply"] {
            std::fs::write(at(name), "ply").unwrap();
        }
        let text = "# all\r\nsub\\a.ply\r\n\r\n \"my b.ply\" \r\ngone\\c.ply\r\n";
        let utf16 = |text: &str| text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        for bytes in [
            text.as_bytes().to_vec(),
            format!("\u{feff}{text}").into_bytes(),
            text.replace("\r\n", "\r").into_bytes(),
            utf16(text),
            utf16(&format!("\u{feff}{text}")),
        ] {
            std::fs::write(at("list.txt"), bytes).unwrap();
            let found = paths_of(&at("list.txt"), 1 << 20).unwrap();
            assert_eq!(found, [at("sub/a.ply"), at("my b.ply"), at("gone\\c.ply")]);
        }
    }
}
