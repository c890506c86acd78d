//! `stonecut serve`: a folder over HTTP, for viewers of tiles on this machine.
//!
//! Reads only, and only below the folder: an address is taken apart by its parts, and what it leads to must lie
//! below the folder after all links are followed. Does not list folders and does not cache.

use super::http::{self, Request, Response};
use super::log::Log;
use crate::error::{Error, Result};
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::path::{Path, PathBuf};

/// Offers a folder to browsers on this machine
///
/// For the folders of `stonecut tiles --viewer`: open the address that is printed. Stop with Ctrl-C.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The folder
    folder: PathBuf,
    /// Address to listen at; 0.0.0.0 offers the folder to the whole network
    #[arg(long, value_name = "IP", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    address: IpAddr,
    /// Port to listen at; 0 takes a free one
    #[arg(long, value_name = "N", default_value_t = 8080)]
    port: u16,
}

impl Args {
    pub(super) fn paths(&self) -> Paths {
        Paths::default().with(Role::InputFolder, "FOLDER", &self.folder)
    }
}

/// Runs the command until it is stopped.
pub fn run(args: &Args, progress: &Progress, log: &mut Log) -> Result<()> {
    let reading = |e| Error::reading(&args.folder, "cannot open", e);
    let root = args.folder.canonicalize().map_err(reading)?;
    let at = SocketAddr::new(args.address, args.port);
    let busy = |e| Error::Usage(format!("cannot listen at {at}: {e}; give another --port"));
    let listener = TcpListener::bind(at).map_err(busy)?;
    let at = listener.local_addr().unwrap_or(at);
    log.say(format!("http://{at}/ shows {}; stop with Ctrl-C", root.display()));
    let is_over = || progress.check().is_err();
    http::serve(&listener, &is_over, &|request| answer(request, &root, at.ip())).map_err(busy)?;
    progress.check()
}

/// The file at an address, or a refusal.
enum Found {
    File { file: File, kind: &'static str, range: Option<(u64, u64)>, length: u64 },
    Refused(u16, Option<u64>),
}

fn answer(request: &Request, root: &Path, own: IpAddr) -> Response {
    let is_read = matches!(request.method.as_str(), "GET" | "HEAD");
    let found = match (is_read, is_meant(own, request.header("host"))) {
        (false, _) => Found::Refused(405, None),
        (_, false) => Found::Refused(403, None),
        _ => find(root, &request.target, request.header("range")),
    };
    let (mut file, kind, range, length) = match found {
        Found::File { file, kind, range, length } => (file, kind, range, length),
        Found::Refused(code, length) => {
            let of = length.map(|length| ("Content-Range", format!("bytes */{length}")));
            return Response { headers: of.into_iter().collect(), ..Response::refused(code) };
        }
    };
    let (first, end) = range.unwrap_or((0, length));
    if file.seek(SeekFrom::Start(first)).is_err() {
        return Response::refused(500);
    }
    let mut headers = vec![
        ("Content-Type", kind.to_owned()),
        ("Accept-Ranges", "bytes".to_owned()),
        ("X-Content-Type-Options", "nosniff".to_owned()),
        ("Cache-Control", "no-cache".to_owned()),
    ];
    if range.is_some() {
        headers.push(("Content-Range", format!("bytes {first}-{}/{length}", end - 1)));
    }
    let code = if range.is_some() { 206 } else { 200 };
    Response { code, headers, body: Some(file.take(end - first)) }
}

/// Tells if a request names this server. A page elsewhere could make its own name lead to this machine, and read
/// what is offered only here.
fn is_meant(own: IpAddr, host: Option<&str>) -> bool {
    if !own.is_loopback() {
        return true;
    }
    let Some(host) = host else { return false };
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

/// Finds the file of an address.
fn find(root: &Path, url: &str, range: Option<&str>) -> Found {
    let missing = || Found::Refused(404, None);
    let Some(mut path) = path_of(root, url) else { return missing() };
    if path.is_dir() {
        path.push("index.html");
    }
    // Links are followed before the place is looked at, so none leads out.
    let Ok(path) = path.canonicalize() else { return missing() };
    if !path.starts_with(root) {
        return missing();
    }
    let Ok(file) = crate::system::disk::open_input(&path) else { return missing() };
    let Ok(length) = file.metadata().map(|meta| meta.len()) else { return missing() };
    let kind = kind_of(&path);
    match range.map(|range| wanted(range, length)) {
        None | Some(Wanted::Whole) => Found::File { file, kind, range: None, length },
        Some(Wanted::Part(first, end)) => {
            Found::File { file, kind, range: Some((first, end)), length }
        }
        Some(Wanted::Beyond) => Found::Refused(416, Some(length)),
    }
}

/// The path below `root` that an address names; none if any of its parts is not a plain name.
fn path_of(root: &Path, url: &str) -> Option<PathBuf> {
    let address = url.split(['?', '#']).next()?;
    let mut path = root.to_path_buf();
    for part in address.strip_prefix('/')?.split('/') {
        // Taken apart first: an encoded slash is part of a name, and no file has such a name.
        let name = decoded(part)?;
        if name.is_empty() {
            continue;
        }
        let is_plain = name != "." && name != ".." && !name.contains(['/', '\\', '\0']);
        is_plain.then_some(())?;
        path.push(name);
    }
    Some(path)
}

/// Text in which `%20` stands for a blank.
fn decoded(text: &str) -> Option<String> {
    let (bytes, mut out, mut i) = (text.as_bytes(), Vec::new(), 0);
    while i < bytes.len() {
        if bytes[i] == b'%' {
            let hex = std::str::from_utf8(bytes.get(i + 1..i + 3)?).ok()?;
            hex.bytes().all(|b| b.is_ascii_hexdigit()).then_some(())?;
            out.push(u8::from_str_radix(hex, 16).ok()?);
            i += 3;
        } else {
            out.push(bytes[i]);
            i += 1;
        }
    }
    String::from_utf8(out).ok()
}

/// The part of a file that a request wants.
#[derive(Debug, PartialEq)]
enum Wanted {
    Whole,
    /// First byte and the one behind the last.
    Part(u64, u64),
    Beyond,
}

/// Reads `bytes=5-9`, `bytes=5-` and `bytes=-5` (RFC 9110); anything else is ignored, as it allows.
fn wanted(range: &str, length: u64) -> Wanted {
    let Some((first, last)) = range.strip_prefix("bytes=").and_then(|r| r.split_once('-')) else {
        return Wanted::Whole;
    };
    let parse = |text: &str| text.trim().parse::<u64>().ok();
    let (first, end) = match (parse(first), parse(last)) {
        (Some(first), Some(last)) if last >= first => (first, last.saturating_add(1).min(length)),
        (Some(first), None) if last.trim().is_empty() => (first, length),
        (None, Some(n)) if first.trim().is_empty() && n > 0 => (length.saturating_sub(n), length),
        _ => return Wanted::Whole,
    };
    if first < end { Wanted::Part(first, end) } else { Wanted::Beyond }
}

fn kind_of(path: &Path) -> &'static str {
    match path.extension().and_then(|ext| ext.to_str()) {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("json") => "application/json",
        Some("glb") => "model/gltf-binary",
        Some("txt") => "text/plain; charset=utf-8",
        Some("png") => "image/png",
        Some("jpg" | "jpeg") => "image/jpeg",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_spelling_leads_out_of_the_folder() {
        let root = Path::new("/srv/tiles");
        for url in [
            "/../x",
            "/a/../../x",
            "/%2e%2e/x",
            "/%2E%2e%2fx",
            "/..%2fx",
            "/a%2f..%2f..%2fx",
            "/..\\x",
            "/%5c..%5cx",
            "/a%00b",
            "/%",
            "/%4",
            "/%zz",
            "/%+1",
            "http://host/x",
            "x",
            "/./x",
            "/%ff",
        ] {
            assert_eq!(path_of(root, url), None, "{url}");
        }
        for (url, path) in [
            ("/", "/srv/tiles"),
            ("/tileset.json?v=../..", "/srv/tiles/tileset.json"),
            ("//etc/passwd", "/srv/tiles/etc/passwd"),
            ("/a%20b/..c", "/srv/tiles/a b/..c"),
            ("/%252e%252e/x", "/srv/tiles/%2e%2e/x"),
        ] {
            assert_eq!(path_of(root, url).as_deref(), Some(Path::new(path)), "{url}");
        }
    }

    #[test]
    fn parts_of_files_are_those_that_were_asked_for() {
        use Wanted::{Beyond, Part, Whole};
        for (range, found) in [
            ("bytes=0-0", Part(0, 1)),
            ("bytes=5-", Part(5, 10)),
            ("bytes=-3", Part(7, 10)),
            ("bytes=-30", Part(0, 10)),
            ("bytes=8-99", Part(8, 10)),
            ("bytes=10-", Beyond),
            ("bytes=18446744073709551615-18446744073709551615", Beyond),
            ("bytes=5-4", Whole),
            ("bytes=-0", Whole),
            ("bytes=1-2,4-5", Whole),
            ("lines=1-2", Whole),
            ("bytes=", Whole),
        ] {
            assert_eq!(wanted(range, 10), found, "{range}");
        }
    }

    #[test]
    fn a_page_elsewhere_cannot_name_this_machine() {
        let own = IpAddr::V4(Ipv4Addr::LOCALHOST);
        for host in ["localhost:8080", "127.0.0.1", "[::1]:80", "LOCALHOST"] {
            assert!(is_meant(own, Some(host)), "{host}");
        }
        for host in ["evil.example:8080", "localhost.evil.example", "10.0.0.1", ""] {
            assert!(!is_meant(own, Some(host)), "{host}");
        }
        assert!(!is_meant(own, None));
        assert!(is_meant(IpAddr::V4(Ipv4Addr::UNSPECIFIED), Some("scanner.lan")));
    }
}
