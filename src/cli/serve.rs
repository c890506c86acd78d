//! `stonecut serve`: a folder over HTTP, for viewers of tiles on this machine.
//!
//! Reads only, and only below the folder: an address is taken apart by its parts, and what it leads to must lie
//! below the folder after all links are followed. Does not list folders. `hyper` speaks HTTP/1.1, `tower-http` answers
//! from files: types, ranges, dates.

use super::answer::CommandEnd;
use super::session::{Command, Session};
use crate::error::{Error, Result};
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use http_body_util::{Either, Full};
use hyper::body::{Bytes, Incoming};
use hyper::header::{
    ALLOW, CACHE_CONTROL, CONNECTION, ETAG, HOST, HeaderValue, IF_RANGE, LAST_MODIFIED, LOCATION,
    RANGE, X_CONTENT_TYPE_OPTIONS,
};
use hyper::{Method, Request, Response, StatusCode, Uri};
use hyper_util::rt::{TokioIo, TokioTimer};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::time::Sleep;
use tower_http::services::ServeFile;
use tower_http::services::fs::ServeFileSystemResponseBody;

/// A request to stop is looked for so often; a connection that could not be accepted is tried again after it.
const STOP_WAIT: Duration = Duration::from_millis(200);

/// A connection on which no request comes for so long, or whose other end takes nothing for so long, is closed.
const IDLE: Duration = Duration::from_secs(60);

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

impl Command for Args {
    fn paths(&self) -> Result<Paths> {
        Ok(Paths::default().with(Role::InputFolder, "FOLDER", &self.folder))
    }

    fn run(&self, session: &mut Session) -> Result<CommandEnd> {
        let (progress, log) = (session.progress, &mut *session.log);
        let reading = |e| Error::reading(&self.folder, "cannot open", e);
        let root = self.folder.canonicalize().map_err(reading)?;
        let at = SocketAddr::new(self.address, self.port);
        let busy = |e| Error::Usage(format!("cannot listen at {at}: {e}; give another --port"));
        let listener = TcpListener::bind(at).map_err(busy)?;
        let at = listener.local_addr().unwrap_or(at);
        log.say(format!("http://{at}/ shows {}; stop with Ctrl-C", root.display()));
        if !at.ip().is_loopback() {
            log.say(format!(
            "warning: everyone who reaches port {} of this machine can read {}; 127.0.0.1 offers it only here",
            at.port(),
            root.display()
        ));
        }
        let offered = Arc::new(Offered { root, address: at.ip() });
        listener
            .set_nonblocking(true)
            .and_then(|()| tokio::runtime::Builder::new_current_thread().enable_all().build())
            .and_then(|runtime| runtime.block_on(listen(listener, offered, progress)))
            .map_err(busy)?;
        progress.check()?;
        Ok(CommandEnd::plain())
    }
}

/// Answers every connection until the progress is cancelled; those that are open then are dropped.
async fn listen(
    listener: TcpListener,
    offered: Arc<Offered>,
    progress: &Progress,
) -> std::io::Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    while progress.check().is_ok() {
        match tokio::time::timeout(STOP_WAIT, listener.accept()).await {
            Ok(Ok((stream, _))) => drop(tokio::spawn(talk(stream, Arc::clone(&offered), IDLE))),
            // Out of descriptors, or gone before it was accepted.
            Ok(Err(_)) => tokio::time::sleep(STOP_WAIT).await,
            Err(_) => {}
        }
    }
    Ok(())
}

/// A connection that fails once its other end has taken nothing for a while: an answer that is not read would keep its
/// file open for good.
struct Patient {
    stream: TcpStream,
    patience: Duration,
    /// Runs while nothing can be written.
    stalled: Option<Pin<Box<Sleep>>>,
}

impl Patient {
    /// Hands on an answer to a write, unless the end of patience comes first.
    fn or_too_late<T>(
        &mut self,
        answer: Poll<std::io::Result<T>>,
        context: &mut Context<'_>,
    ) -> Poll<std::io::Result<T>> {
        if answer.is_ready() {
            self.stalled = None;
            return answer;
        }
        let patience = self.patience;
        let stalled = self.stalled.get_or_insert_with(|| Box::pin(tokio::time::sleep(patience)));
        match stalled.as_mut().poll(context) {
            Poll::Ready(()) => Poll::Ready(Err(std::io::ErrorKind::TimedOut.into())),
            Poll::Pending => Poll::Pending,
        }
    }
}

impl AsyncRead for Patient {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        into: &mut ReadBuf<'_>,
    ) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, into)
    }
}

impl AsyncWrite for Patient {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<std::io::Result<usize>> {
        let answer = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.or_too_late(answer, context)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[std::io::IoSlice<'_>],
    ) -> Poll<std::io::Result<usize>> {
        let answer = Pin::new(&mut self.stream).poll_write_vectored(context, parts);
        self.or_too_late(answer, context)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

/// Answers the requests of a connection until it is closed.
pub async fn talk(stream: TcpStream, offered: Arc<Offered>, patience: Duration) {
    let _ = stream.set_nodelay(true);
    let stream = Patient { stream, patience, stalled: None };
    let answer = hyper::service::service_fn(move |request| {
        let offered = Arc::clone(&offered);
        async move { offered.answer(request).await }
    });
    let mut http = hyper::server::conn::http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(patience);
    // A browser that has gone away is not a fault.
    let _ = http.serve_connection(TokioIo::new(stream), answer).await;
}

/// A file, or a code in words.
type Body = Either<ServeFileSystemResponseBody, Full<Bytes>>;

/// A folder, and the address at which it is offered.
pub struct Offered {
    /// The folder.
    pub root: PathBuf,
    /// The address.
    pub address: IpAddr,
}

impl Offered {
    async fn answer(&self, mut request: Request<Incoming>) -> std::io::Result<Response<Body>> {
        let mut hosts = request.headers().get_all(HOST).iter();
        let host = match (hosts.next(), hosts.next()) {
            (Some(host), None) => host.to_str().ok(),
            _ => None,
        };
        if !matches!(*request.method(), Method::GET | Method::HEAD) {
            let mut response = refused(StatusCode::METHOD_NOT_ALLOWED);
            response.headers_mut().insert(ALLOW, HeaderValue::from_static("GET, HEAD"));
            return Ok(response);
        }
        if !is_meant(self.address, host) {
            return Ok(refused(StatusCode::FORBIDDEN));
        }
        let target = request.uri();
        let path =
            (target.authority().is_none()).then(|| find(&self.root, target.path())).flatten();
        let Some(path) = path else { return Ok(refused(StatusCode::NOT_FOUND)) };
        if let Some(place) = folder_of_page(&path, target) {
            return Ok(moved(&place));
        }
        let known = request.headers().get(IF_RANGE).cloned();
        if let Some(known) = known
            && !is_as_known(&path, &known).await?
        {
            request.headers_mut().remove(RANGE);
        }
        let mut response = ServeFile::new(path).try_call(request).await?.map(Either::Left);
        let headers = response.headers_mut();
        headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-cache"));
        headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
        Ok(response)
    }
}

/// Returns whether a file is still the one that a request for a part of it has the rest of.
async fn is_as_known(path: &Path, known: &HeaderValue) -> std::io::Result<bool> {
    let mut look = Request::new(());
    *look.method_mut() = Method::HEAD;
    let found = ServeFile::new(path).try_call(look).await?;
    Ok([ETAG, LAST_MODIFIED].iter().any(|mark| found.headers().get(mark) == Some(known)))
}

/// A code alone. The connection ends with it: what may follow a request that is refused is not read.
fn refused(code: StatusCode) -> Response<Body> {
    let mut response = Response::new(Either::Right(Full::from(format!("{code}\n"))));
    *response.status_mut() = code;
    response.headers_mut().insert(CONNECTION, HeaderValue::from_static("close"));
    response
}

/// Address of the page of a folder, for one that does not end as that of a folder: what the page names would be looked for beside
/// the folder. Relative, so that it leads nowhere else.
fn folder_of_page(path: &Path, target: &Uri) -> Option<HeaderValue> {
    let (_, last) = target.path().rsplit_once('/')?;
    let is_page = path.file_name().is_some_and(|name| name == PAGE);
    let named = percent_encoding::percent_decode_str(last).decode_utf8().ok()?;
    if !is_page || last.is_empty() || named == PAGE {
        return None;
    }
    let query = target.query().map_or_else(String::new, |query| format!("?{query}"));
    HeaderValue::from_str(&format!("./{last}/{query}")).ok()
}

fn moved(place: &HeaderValue) -> Response<Body> {
    let mut response = refused(StatusCode::MOVED_PERMANENTLY);
    response.headers_mut().insert(LOCATION, place.clone());
    response
}

/// The page of a folder.
const PAGE: &str = "index.html";

/// True if a request names this server. A page elsewhere could make its own name lead to this machine, and read
/// what is offered only here.
fn is_meant(own: IpAddr, host: Option<&str>) -> bool {
    if !own.is_loopback() {
        return true;
    }
    // Nothing may stand behind the name but a port: '[::1].evil.example' is another machine.
    let is_port =
        |rest: &str| rest.strip_prefix(':').is_some_and(|n| n.bytes().all(|b| b.is_ascii_digit()));
    let is_end = |rest: &str| rest.is_empty() || is_port(rest);
    let Some(host) = host else { return false };
    if let Some((ip, rest)) = host.strip_prefix('[').and_then(|host| host.split_once(']')) {
        return is_end(rest) && ip.parse().is_ok_and(|ip: Ipv6Addr| ip.is_loopback());
    }
    let (name, rest) = host.split_at(host.find(':').unwrap_or(host.len()));
    let is_here = |name: &str| name.parse().is_ok_and(|ip: Ipv4Addr| ip.is_loopback());
    is_end(rest) && (name.eq_ignore_ascii_case("localhost") || is_here(name))
}

/// Finds the file of an address.
fn find(root: &Path, address: &str) -> Option<PathBuf> {
    let mut path = path_of(root, address)?;
    if path.is_dir() {
        path.push(PAGE);
    }
    // Links are followed before the place is looked at, so none leads out.
    let path = path.canonicalize().ok()?;
    (path.starts_with(root) && path.is_file()).then_some(path)
}

/// The path below `root` that an address names; none if any of its parts is not a plain name.
fn path_of(root: &Path, address: &str) -> Option<PathBuf> {
    let mut path = root.to_path_buf();
    for part in address.strip_prefix('/')?.split('/') {
        // Taken apart first: an encoded slash is part of a name, and no file has such a name.
        let name = percent_encoding::percent_decode_str(part).decode_utf8().ok()?;
        if name.is_empty() {
            continue;
        }
        let is_plain = name != "." && name != ".." && !name.contains(['/', '\\', '\0']);
        is_plain.then_some(())?;
        path.push(name.as_ref());
    }
    Some(path)
}
