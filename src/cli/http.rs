//! HTTP/1.1 for `serve`: requests without bodies, answered from files, a thread for each connection.
//!
//! Connections stay open until the browser closes them or says nothing for a while. Encrypts nothing and compresses
//! nothing. What may be read is decided by `serve`.

use std::fs::File;
use std::io::{ErrorKind, Read, Take, Write};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

/// A request to stop, and one to connect, are looked for so often.
const STOP_WAIT: Duration = Duration::from_millis(200);
const ACCEPT_WAIT: Duration = Duration::from_millis(5);

/// A connection on which nothing moves for so long is closed.
const IDLE: Duration = Duration::from_secs(60);

/// Connections at a time; browsers open six a page.
const MOST_OPEN: usize = 256;

/// Bytes of the head of a request, at most; browsers send less than one thousand.
const MOST_HEAD: usize = 16 << 10;

/// The head of a request.
pub(super) struct Request {
    pub(super) method: String,
    pub(super) target: String,
    is_new: bool,
    headers: Vec<(String, String)>,
}

/// Answers a request with a code, headers and a part of a file, or the code alone.
pub(super) struct Response {
    pub(super) code: u16,
    pub(super) headers: Vec<(&'static str, String)>,
    pub(super) body: Option<Take<File>>,
}

impl Request {
    /// Reads the head, which ends with an empty line; `None` if it is none.
    fn parse(head: &[u8]) -> Option<Request> {
        let text = std::str::from_utf8(head).ok()?;
        let mut lines = text.split("\r\n");
        let mut words = lines.next()?.split(' ');
        let (method, target, version) = (words.next()?, words.next()?, words.next()?);
        if words.next().is_some() || !matches!(version, "HTTP/1.1" | "HTTP/1.0") {
            return None;
        }
        let header = |line: &str| {
            let (name, value) = line.split_once(':')?;
            let is_name = !name.is_empty() && !name.contains(char::is_whitespace);
            is_name.then(|| (name.to_ascii_lowercase(), value.trim().to_owned()))
        };
        let headers = lines.filter(|line| !line.is_empty()).map(header).collect::<Option<_>>()?;
        Some(Request {
            method: method.to_owned(),
            target: target.to_owned(),
            is_new: version == "HTTP/1.1",
            headers,
        })
    }

    /// The first value of a header, whose name is in small letters.
    pub(super) fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(own, _)| own == name).map(|(_, value)| value.as_str())
    }

    fn has_body(&self) -> bool {
        self.header("transfer-encoding").is_some()
            || self.header("content-length").is_some_and(|length| length != "0")
    }

    fn stays_open(&self) -> bool {
        let says = |word| self.header("connection").is_some_and(|c| c.eq_ignore_ascii_case(word));
        !says("close") && (self.is_new || says("keep-alive"))
    }
}

impl Response {
    pub(super) fn refused(code: u16) -> Response {
        Response { code, headers: Vec::new(), body: None }
    }

    fn reason(&self) -> &'static str {
        match self.code {
            200 => "OK",
            206 => "Partial Content",
            400 => "Bad Request",
            403 => "Forbidden",
            404 => "Not Found",
            405 => "Method Not Allowed",
            416 => "Range Not Satisfiable",
            431 => "Request Header Fields Too Large",
            _ => "Internal Server Error",
        }
    }
}

/// Answers every request until `is_over`.
///
/// Errors: those of the listener at the beginning. Connections that fail are closed.
pub(super) fn serve(
    listener: &TcpListener,
    is_over: &(dyn Fn() -> bool + Sync),
    answer: &(dyn Fn(&Request) -> Response + Sync),
) -> std::io::Result<()> {
    listener.set_nonblocking(true)?;
    let open = std::sync::atomic::AtomicUsize::new(0);
    let order = std::sync::atomic::Ordering::SeqCst;
    std::thread::scope(|scope| {
        while !is_over() {
            let Ok((stream, _)) = listener.accept() else {
                // Also for what ended before it was accepted.
                std::thread::sleep(ACCEPT_WAIT);
                continue;
            };
            if open.fetch_add(1, order) >= MOST_OPEN {
                open.fetch_sub(1, order);
                continue;
            }
            let open = &open;
            let talk = move || {
                // A browser that has gone away is not a fault.
                let _ = Connection::new(stream, is_over).and_then(|mut c| c.talk(answer));
                open.fetch_sub(1, order);
            };
            if std::thread::Builder::new().spawn_scoped(scope, talk).is_err() {
                open.fetch_sub(1, order);
            }
        }
    });
    Ok(())
}

struct Connection<'a> {
    stream: TcpStream,
    /// Bytes that were read and not yet used.
    read: Vec<u8>,
    is_over: &'a (dyn Fn() -> bool + Sync),
}

impl<'a> Connection<'a> {
    fn new(stream: TcpStream, is_over: &'a (dyn Fn() -> bool + Sync)) -> std::io::Result<Self> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(STOP_WAIT))?;
        stream.set_write_timeout(Some(STOP_WAIT))?;
        Ok(Connection { stream, read: Vec::new(), is_over })
    }

    fn talk(&mut self, answer: &dyn Fn(&Request) -> Response) -> std::io::Result<()> {
        while let Some(end) = self.head()? {
            let head: Vec<u8> = self.read.drain(..end).collect();
            let request = Request::parse(&head);
            let (mut response, is_last, has_body) = match &request {
                _ if head.len() > MOST_HEAD => (Response::refused(431), true, true),
                None => (Response::refused(400), true, true),
                // What follows would have to be skipped.
                Some(request) if request.has_body() => (Response::refused(405), true, true),
                Some(request) => (answer(request), !request.stays_open(), request.method != "HEAD"),
            };
            self.respond(&mut response, is_last, has_body)?;
            if is_last {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Reads until a head is whole; where it ends, or `None` if nothing more comes.
    fn head(&mut self) -> std::io::Result<Option<usize>> {
        let since = Instant::now();
        loop {
            if let Some(at) = self.read.windows(4).position(|w| w == b"\r\n\r\n") {
                return Ok(Some(at + 4));
            }
            if self.read.len() > MOST_HEAD {
                return Ok(Some(self.read.len()));
            }
            let mut more = [0; 4096];
            match self.stream.read(&mut more) {
                Ok(0) => return Ok(None),
                Ok(n) => self.read.extend_from_slice(&more[..n]),
                Err(e) if is_wait(&e) && !(self.is_over)() && since.elapsed() < IDLE => {}
                Err(e) => return Err(e),
            }
        }
    }

    fn respond(
        &mut self,
        response: &mut Response,
        is_last: bool,
        has_body: bool,
    ) -> std::io::Result<()> {
        let text = format!("{}\n", response.code);
        let length = response.body.as_ref().map_or(text.len() as u64, Take::limit);
        let mut head = format!(
            "HTTP/1.1 {} {}\r\nContent-Length: {length}\r\n",
            response.code,
            response.reason()
        );
        for (name, value) in &response.headers {
            head += &format!("{name}: {value}\r\n");
        }
        head += if is_last { "Connection: close\r\n\r\n" } else { "\r\n" };
        if has_body && response.body.is_none() {
            head += &text;
        }
        self.send(head.as_bytes())?;
        let Some(body) = response.body.as_mut().filter(|_| has_body) else { return Ok(()) };
        let mut block = vec![0; 64 << 10];
        let mut left = length;
        while left > 0 {
            match body.read(&mut block)? {
                // The file has become shorter, so that what was promised cannot come.
                0 => return Err(ErrorKind::UnexpectedEof.into()),
                n => self.send(&block[..n])?,
            }
            left = body.limit();
        }
        Ok(())
    }

    fn send(&mut self, mut bytes: &[u8]) -> std::io::Result<()> {
        let mut since = Instant::now();
        while !bytes.is_empty() {
            match self.stream.write(bytes) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(n) => {
                    bytes = &bytes[n..];
                    since = Instant::now();
                }
                Err(e) if is_wait(&e) && !(self.is_over)() && since.elapsed() < IDLE => {}
                Err(e) => return Err(e),
            }
        }
        Ok(())
    }
}

/// Tells if nothing has happened yet.
fn is_wait(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_are_read_as_they_are_meant() {
        let parse = |text: &str| Request::parse(text.as_bytes());
        let request = parse("GET /a%20b HTTP/1.1\r\nHOST: x:1\r\nRange:bytes=1-2\r\n\r\n").unwrap();
        assert_eq!((request.method.as_str(), request.target.as_str()), ("GET", "/a%20b"));
        assert_eq!(
            (request.header("host"), request.header("range")),
            (Some("x:1"), Some("bytes=1-2"))
        );
        assert!(request.stays_open() && !request.has_body());
        assert!(!parse("GET / HTTP/1.1\r\nConnection: Close\r\n\r\n").unwrap().stays_open());
        assert!(!parse("GET / HTTP/1.0\r\n\r\n").unwrap().stays_open());
        assert!(parse("POST / HTTP/1.1\r\nContent-Length: 5\r\n\r\n").unwrap().has_body());
        for bad in [
            "",
            "GET /\r\n\r\n",
            "GET / HTTP/2\r\n\r\n",
            "GET / x HTTP/1.1\r\n\r\n",
            "GET / HTTP/1.1\r\nno\r\n\r\n",
        ] {
            assert!(parse(bad).is_none(), "{bad}");
        }
        assert!(Request::parse(b"GET /\xff HTTP/1.1\r\n\r\n").is_none());
    }
}
