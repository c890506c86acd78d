//! `stonecut serve`: types, parts of files, and no way out of the folder.

use crate::common::start;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{IpAddr, Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;
use std::process::Child;
use std::sync::Arc;
use std::time::Duration;
use stonecut::cli::serve::{Offered, talk};

struct Served {
    child: Child,
    address: String,
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn serve(folder: &Path) -> Served {
    let mut child = start(folder, &format!("serve {} --port 0", folder.display()));
    let mut line = String::new();
    BufReader::new(child.stderr.take().unwrap()).read_line(&mut line).unwrap();
    let address = line.split('/').nth(2).unwrap().to_owned();
    assert!(address.starts_with("127.0.0.1:"), "{line}");
    Served { child, address }
}

impl Served {
    /// Code, headers in small letters, body.
    fn ask(&self, method: &str, url: &str, more: &str) -> (u16, String, Vec<u8>) {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        let host = &self.address;
        let text =
            format!("{method} {url} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{more}\r\n");
        stream.write_all(text.as_bytes()).unwrap();
        let mut out = Vec::new();
        stream.read_to_end(&mut out).unwrap();
        let end = out.windows(4).position(|w| w == b"\r\n\r\n").unwrap();
        let head = String::from_utf8_lossy(&out[..end]).to_lowercase();
        let code = head.split(' ').nth(1).unwrap().parse().unwrap();
        (code, head, out[end + 4..].to_vec())
    }
}

#[test]
fn files_come_whole_and_in_parts_with_their_types() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("tiles")).unwrap();
    let data: Vec<u8> = (0..100_000u32).flat_map(u32::to_le_bytes).collect();
    std::fs::write(folder.path().join("tiles/0 1.glb"), &data).unwrap();
    std::fs::write(folder.path().join("index.html"), "<p>page").unwrap();
    std::fs::write(folder.path().join("tileset.json"), "{}").unwrap();
    let served = serve(folder.path());
    let (code, head, body) = served.ask("GET", "/", "");
    assert_eq!((code, &body[..]), (200, &b"<p>page"[..]));
    assert!(head.contains("content-type: text/html"), "{head}");
    let (code, head, body) = served.ask("GET", "/tiles/0%201.glb?x=1", "");
    assert!(code == 200 && body == data, "{head}");
    assert!(head.contains("model/gltf-binary") && head.contains("accept-ranges: bytes"), "{head}");
    for (range, first, end) in
        [("8-15", 8, 16), ("399990-", 399_990, 400_000), ("-4", 399_996, 400_000), ("0-0", 0, 1)]
    {
        let wanted = format!("Range: bytes={range}\r\n");
        let (code, head, body) = served.ask("GET", "/tiles/0%201.glb", &wanted);
        assert_eq!((code, &body[..]), (206, &data[first..end]), "{range}: {head}");
        let told = format!("content-range: bytes {first}-{}/400000", end - 1);
        assert!(head.contains(&told), "{head}");
    }
    let (code, head, _) = served.ask("GET", "/tileset.json", "Range: bytes=2-\r\n");
    assert!(code == 416 && head.contains("bytes */2"), "{head}");
    let (code, head, body) = served.ask("HEAD", "/tileset.json", "");
    assert!(code == 200 && body.is_empty() && head.contains("application/json"), "{head}");
    for (method, url, code) in
        [("GET", "/none", 404), ("GET", "/tiles", 404), ("POST", "/", 405), ("DELETE", "/", 405)]
    {
        assert_eq!(served.ask(method, url, "").0, code, "{method} {url}");
    }
}

#[test]
fn the_page_of_a_folder_is_found_with_what_it_names() {
    let folder = tempfile::tempdir().unwrap();
    let tree = folder.path().join("a tree");
    std::fs::create_dir(&tree).unwrap();
    std::fs::write(tree.join("index.html"), "<p>page").unwrap();
    let served = serve(folder.path());
    let (code, head, _) = served.ask("GET", "/a%20tree?x=1", "");
    assert!(code == 301 && head.contains("location: ./a%20tree/?x=1"), "{head}");
    for url in ["/a%20tree/", "/a%20tree/index.html"] {
        assert_eq!(served.ask("GET", url, "").0, 200, "{url}");
    }
    let (_, head, _) = served.ask("POST", "/", "");
    assert!(head.contains("allow: get, head"), "{head}");
}

/// Browsers open six connections a page and keep them: the last ones waited until the first ones were closed.
#[test]
fn connections_that_stay_open_do_not_hold_others_up() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.txt"), "all of it").unwrap();
    let served = serve(folder.path());
    let mut open: Vec<TcpStream> =
        (0..40).map(|_| TcpStream::connect(&served.address).unwrap()).collect();
    // Two requests at once on each, then a third one.
    let text = format!("GET /a.txt HTTP/1.1\r\nHost: {}\r\n\r\n", served.address);
    for (asked, times) in [(format!("{text}{text}"), 2), (text.clone(), 1)] {
        for stream in &mut open {
            stream.set_read_timeout(Some(std::time::Duration::from_secs(60))).unwrap();
            stream.write_all(asked.as_bytes()).unwrap();
        }
        for stream in &mut open {
            let mut found = Vec::new();
            while found.windows(9).filter(|w| w == b"all of it").count() < times {
                let mut some = [0; 500];
                let n = stream.read(&mut some).unwrap();
                assert!(n > 0, "closed after {}", String::from_utf8_lossy(&found));
                found.extend_from_slice(&some[..n]);
            }
        }
    }
    for bad in ["nonsense\r\n\r\n", "POST / HTTP/1.1\r\nContent-Length: 3\r\n\r\nabc"] {
        let mut stream = TcpStream::connect(&served.address).unwrap();
        stream.write_all(bad.as_bytes()).unwrap();
        let mut found = String::new();
        stream.read_to_string(&mut found).unwrap();
        assert!(found.starts_with("HTTP/1.1 40") && found.contains("connection: close"), "{found}");
    }
}

#[test]
fn nothing_outside_of_the_folder_is_served() {
    let above = tempfile::tempdir().unwrap();
    let folder = above.path().join("served");
    std::fs::create_dir_all(folder.join("a")).unwrap();
    std::fs::write(above.path().join("secret.txt"), "secret").unwrap();
    std::fs::write(folder.join("open.txt"), "open").unwrap();
    std::os::unix::fs::symlink("../secret.txt", folder.join("link.txt")).unwrap();
    std::os::unix::fs::symlink("..", folder.join("up")).unwrap();
    std::os::unix::fs::symlink("open.txt", folder.join("within.txt")).unwrap();
    std::os::unix::fs::symlink("/etc", folder.join("etc")).unwrap();
    for name in ["a/..c", "%2e%2e", "100%"] {
        std::fs::write(folder.join(name), "open").unwrap();
    }
    let served = serve(&folder);
    for url in ["/within.txt", "//open.txt", "/%61/..c", "/%252e%252e", "/100%"] {
        assert_eq!(served.ask("GET", url, "").2, b"open", "{url}");
    }
    let all = "/../secret.txt /a/../../secret.txt /%2e%2e/secret.txt /..%2fsecret.txt \
         /a/%2e%2e%2f%2e%2e/secret.txt /link.txt /up/secret.txt /etc/passwd //etc/passwd /%00 \
         /%2E%2e%2fsecret.txt /a%2f..%2f..%2fsecret.txt /..\\secret.txt /%5c..%5csecret.txt /open.txt%00b /%ff open.txt \
         /./open.txt /a/../open.txt /%2e/open.txt /a%2f..c";
    for url in all.split(' ') {
        let (code, head, body) = served.ask("GET", url, "");
        assert!(code >= 400, "{url}: {head}");
        assert!(!body.windows(6).any(|w| w == b"secret" || w == b"root:x"), "{url}");
    }
    let (code, ..) = served.ask("GET", "http://evil.example/open.txt", "");
    assert!(code >= 400);
}

#[test]
fn a_page_with_a_viewer_lies_beside_the_tiles() {
    let folder = tempfile::tempdir().unwrap();
    crate::common::expect(folder.path(), "synth statue in.ply --triangles 5k", 0);
    crate::common::expect(folder.path(), "tiles in.ply out --viewer", 0);
    let served = serve(&folder.path().join("out"));
    assert!(String::from_utf8_lossy(&served.ask("GET", "/", "").2).contains("viewer.js"));
    for name in ["/three.js", "/viewer.js", "/viewer-licences.txt", "/tileset.json"] {
        assert_eq!(served.ask("GET", name, "").0, 200, "{name}");
    }
}

#[test]
fn a_part_of_a_file_that_has_changed_comes_as_the_whole_file() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.glb"), [7u8; 1000]).unwrap();
    let served = serve(folder.path());
    let (_, head, _) = served.ask("HEAD", "/a.glb", "");
    let date = head.lines().find_map(|line| line.strip_prefix("last-modified: ")).unwrap();
    // Dates are compared as they were sent.
    let (words, zone) = date.rsplit_once(' ').unwrap();
    let date: String = words
        .split(' ')
        .map(|word| word[..1].to_uppercase() + &word[1..] + " ")
        .chain([zone.to_uppercase()])
        .collect();
    let range = "Range: bytes=0-9\r\n";
    for (condition, code, n_bytes) in [
        (String::new(), 206, 10),
        (format!("If-Range: {date}\r\n"), 206, 10),
        ("If-Range: \"another\"\r\n".to_owned(), 200, 1000),
        ("If-Range: Mon, 01 Jan 2001 00:00:00 GMT\r\n".to_owned(), 200, 1000),
        ("If-Range: Fri, 01 Jan 2100 00:00:00 GMT\r\n".to_owned(), 200, 1000),
    ] {
        let (found, head, body) = served.ask("GET", "/a.glb", &format!("{range}{condition}"));
        assert_eq!((found, body.len()), (code, n_bytes), "{condition}{head}");
    }
}

/// The code of an answer to a request with these headers.
fn code(address: &str, headers: &str) -> u16 {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "GET /a.txt HTTP/1.1\r\nConnection: close\r\n{headers}\r\n").unwrap();
    let mut out = String::new();
    stream.read_to_string(&mut out).unwrap();
    out.split(' ').nth(1).unwrap().parse().unwrap()
}

#[test]
fn a_page_elsewhere_cannot_name_this_machine() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.txt"), "open").unwrap();
    let served = serve(folder.path());
    for host in "localhost:8080 127.0.0.1 127.0.0.1: [::1]:80 [::1] LOCALHOST".split(' ') {
        assert_eq!(code(&served.address, &format!("Host: {host}\r\n")), 200, "{host}");
    }
    let evil = "evil.example:8080 localhost.evil.example 10.0.0.1 [::1].evil.example [::1]evil.example:80 [127.0.0.1] [::1 ::1 \
         localhost:80.evil.example 127.0.0.1.evil.example 127.0.0.1:80@evil.example [::2]:80";
    for host in evil.split(' ').chain([""]) {
        assert_eq!(code(&served.address, &format!("Host: {host}\r\n")), 403, "{host}");
    }
    assert_eq!(code(&served.address, ""), 403);
}

#[test]
fn an_answer_that_is_not_read_ends_the_connection() {
    let folder = tempfile::tempdir().unwrap();
    // More than the buffers of a connection take.
    let file = std::fs::File::create(folder.path().join("large.glb")).unwrap();
    file.set_len(1 << 30).unwrap();
    let root = folder.path().canonicalize().unwrap();
    let offered = Arc::new(Offered { root, address: IpAddr::V4(Ipv4Addr::LOCALHOST) });
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let mut client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
    client.write_all(b"GET /large.glb HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    let (stream, _) = listener.accept().unwrap();
    stream.set_nonblocking(true).unwrap();
    // Returns, though the client neither reads nor goes away.
    runtime.block_on(async {
        let stream = tokio::net::TcpStream::from_std(stream).unwrap();
        talk(stream, offered, Duration::from_millis(100)).await;
    });
    drop(client);
}

#[test]
fn a_folder_that_the_network_can_read_is_announced_as_such() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = start(folder.path(), "serve . --port 0 --address 0.0.0.0");
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let said: Vec<String> = lines.by_ref().take(2).map(Result::unwrap).collect();
    let address = said[0].split('/').nth(2).unwrap().replace("0.0.0.0", "127.0.0.1");
    assert_eq!(code(&address, "Host: scanner.lan\r\n"), 404);
    let _ = child.kill();
    let _ = child.wait();
    assert!(said[1].starts_with("warning: everyone") && said[1].contains("127.0.0.1"), "{said:?}");
}
