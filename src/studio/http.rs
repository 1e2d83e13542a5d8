//! Requests of a browser, and answers to them: HTTP/1.1, a connection for each. `httparse` reads heads; bodies have a length and a limit.

use fdm_session::Failure;
use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// A head of more bytes than this is none of a browser's.
const MOST_HEAD: usize = 16 << 10;
/// More headers than this are none of a browser's.
const MOST_HEADERS: usize = 64;
/// Whoever says nothing for so long is not waited for.
const TIMEOUT: Duration = Duration::from_secs(10);
/// A head that takes longer than this is not waited for.
const HEAD_TIME: Duration = Duration::from_secs(10);

/// Connections that are answered at once: a window holds one for events, and asks by a few others.
const MOST_CONNECTIONS: usize = 64;
/// Bytes of what is told in JSON, and of a body that is read only so that a refusal is not lost.
pub(crate) const MOST_TOLD: u64 = 8 << 20;

/// What listens to this machine alone.
pub(crate) struct Listener {
    listener: TcpListener,
    pub(crate) address: SocketAddr,
}

impl Listener {
    /// Listens on a port; 0 is any that is free.
    pub(crate) fn bind(port: u16) -> Result<Self, Failure> {
        let refused = |e| Failure::input([format!("port {port} of this machine: {}", fdm_results::store::reason(&e))]);
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        Ok(Self { listener, address })
    }

    /// Answers until the program ends, each request in a thread; where nothing is answered, it has been already. A browser that goes away
    /// in the middle is no matter.
    pub(crate) fn run<A>(&self, answer: A)
    where
        A: Fn(Request, &mut TcpStream) -> Result<Option<Answer>, Refusal> + Send + Sync + 'static,
    {
        let (open, answer, own) = (Arc::new(AtomicUsize::new(0)), Arc::new(answer), self.address);
        for mut stream in self.listener.incoming().flatten() {
            let (answer, count) = (Arc::clone(&answer), Arc::clone(&open));
            if open.fetch_add(1, Ordering::Relaxed) >= MOST_CONNECTIONS {
                open.fetch_sub(1, Ordering::Relaxed);
                continue;
            }
            let answered = std::thread::Builder::new().name("request".into()).spawn(move || {
                let found = Request::read(&mut stream).and_then(|request| {
                    request.admit(own)?;
                    answer(request, &mut stream)
                });
                match found {
                    Ok(Some(answer)) => _ = answer.send(&mut stream),
                    Ok(None) => {}
                    Err(refusal) => {
                        let _ = Answer::refused(&refusal).send(&mut stream);
                        // what still comes is taken, so that the refusal is not lost with a reset connection
                        let _ = stream.shutdown(std::net::Shutdown::Write);
                        let _ = io::copy(&mut Read::take(&mut stream, MOST_TOLD), &mut io::sink());
                    }
                }
                count.fetch_sub(1, Ordering::Relaxed);
            });
            if answered.is_err() {
                open.fetch_sub(1, Ordering::Relaxed);
            }
        }
    }
}

/// What is asked for.
#[derive(Debug, Default)]
pub(crate) struct Request {
    pub(crate) method: String,
    /// Parts of the path, decoded.
    pub(crate) path: Vec<String>,
    query: Vec<(String, String)>,
    headers: Vec<(String, String)>,
    /// What of the body came together with the head.
    begun: Vec<u8>,
    pub(crate) body: Vec<u8>,
}

/// What is answered.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: Status,
    pub(crate) kind: &'static str,
    pub(crate) body: Vec<u8>,
}

/// How a request ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Status {
    Good,
    Wrong,
    Forbidden,
    NotFound,
    Method,
    Conflict,
    Length,
    TooLarge,
    Head,
    Busy,
}

impl Status {
    fn line(self) -> &'static str {
        match self {
            Self::Good => "200 OK",
            Self::Wrong => "400 Bad Request",
            Self::Forbidden => "403 Forbidden",
            Self::NotFound => "404 Not Found",
            Self::Method => "405 Method Not Allowed",
            Self::Conflict => "409 Conflict",
            Self::Length => "411 Length Required",
            Self::TooLarge => "413 Content Too Large",
            Self::Head => "431 Request Header Fields Too Large",
            Self::Busy => "503 Service Unavailable",
        }
    }
}

/// A request that comes to nothing, and why.
#[derive(Debug)]
pub(crate) struct Refusal {
    pub(crate) status: Status,
    pub(crate) said: String,
}

impl Refusal {
    pub(crate) fn new(status: Status, said: impl Into<String>) -> Self {
        Self { status, said: said.into() }
    }

    /// Something is wrong with what was sent.
    pub(crate) fn wrong(said: impl Into<String>) -> Self {
        Self::new(Status::Wrong, said)
    }
}

impl From<Failure> for Refusal {
    fn from(e: Failure) -> Self {
        Self::wrong(e.to_string())
    }
}

impl From<io::Error> for Refusal {
    fn from(e: io::Error) -> Self {
        Self::wrong(fdm_results::store::reason(&e))
    }
}

impl Answer {
    pub(crate) fn of(kind: &'static str, body: impl Into<Vec<u8>>) -> Self {
        Self { status: Status::Good, kind, body: body.into() }
    }

    pub(crate) fn text(body: impl Into<Vec<u8>>) -> Self {
        Self::of("text/plain", body)
    }

    /// A value as JSON.
    pub(crate) fn json(value: &impl serde::Serialize) -> Self {
        // keys are texts, so that there is always a text
        Self::of("application/json", serde_json::to_vec(value).unwrap_or_default())
    }

    pub(crate) fn refused(refusal: &Refusal) -> Self {
        Self { status: refusal.status, ..Self::text(format!("{}\n", refusal.said)) }
    }

    /// Sends it, and ends the connection.
    pub(crate) fn send(&self, stream: &mut TcpStream) -> io::Result<()> {
        let length = format!("Content-Length: {}\r\n", self.body.len());
        stream.write_all(&[head(self.status, self.kind, &length).as_bytes(), &self.body].concat())
    }
}

/// A head. Pages hold scripts and styles of this server only, and are framed by it alone.
pub(crate) fn head(status: Status, kind: &str, more: &str) -> String {
    let charset = if kind.starts_with("text/") || kind.ends_with("json") { "; charset=utf-8" } else { "" };
    format!(
        "HTTP/1.1 {}\r\nContent-Type: {kind}{charset}\r\n{more}Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\nCross-Origin-Resource-Policy: same-origin\r\nX-Frame-Options: SAMEORIGIN\r\nConnection: close\r\n\r\n",
        status.line()
    )
}

impl Request {
    /// Reads a head; the body waits until [`Self::read_body`].
    pub(crate) fn read(stream: &mut TcpStream) -> Result<Self, Refusal> {
        stream.set_read_timeout(Some(TIMEOUT))?;
        stream.set_write_timeout(Some(TIMEOUT))?;
        // a slider waits for each answer
        stream.set_nodelay(true)?;
        let (begun, mut bytes, mut part) = (Instant::now(), Vec::new(), [0_u8; 4096]);
        loop {
            let count = stream.read(&mut part)?;
            bytes.extend_from_slice(&part[..count]);
            let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
            let mut parsed = httparse::Request::new(&mut headers);
            match parsed.parse(&bytes) {
                Ok(httparse::Status::Complete(length)) if length <= MOST_HEAD => {
                    let mut request = Self::of(&parsed)?;
                    request.begun = bytes.split_off(length);
                    return Ok(request);
                }
                Ok(_) if bytes.len() > MOST_HEAD => {
                    return Err(Refusal::new(Status::Head, "the head of the request is too long"));
                }
                Ok(_) if count > 0 && begun.elapsed() < HEAD_TIME => {}
                Ok(_) => return Err(Refusal::wrong("the request ends within its head")),
                Err(httparse::Error::TooManyHeaders) => {
                    return Err(Refusal::new(Status::Head, "the request has too many headers"));
                }
                Err(e) => return Err(Refusal::wrong(format!("this is no request: {e}"))),
            }
        }
    }

    /// Lets a request in that comes from this machine's own page.
    fn admit(&self, own: SocketAddr) -> Result<(), Refusal> {
        let forbidden = |said: &str| Err(Refusal::new(Status::Forbidden, said));
        let own = [own.to_string(), format!("localhost:{}", own.port())];
        // a page from elsewhere that leads its own name to this machine asks under that name
        if !self.header("host").is_some_and(|host| own.iter().any(|o| o == host)) {
            return forbidden("this address is for this machine only");
        }
        let ours = |origin: &str| own.iter().any(|o| origin.strip_prefix("http://") == Some(o));
        if self.has("origin") && !self.header("origin").is_some_and(ours) {
            return forbidden("pages from elsewhere are not answered");
        }
        let site = self.header("sec-fetch-site").unwrap_or("none");
        if !["none", "same-origin"].contains(&site) {
            return forbidden("pages from elsewhere are not answered");
        }
        Ok(())
    }

    fn of(parsed: &httparse::Request<'_, '_>) -> Result<Self, Refusal> {
        let target = parsed.path.unwrap_or_default();
        let (path, query) = target.split_once('?').unwrap_or((target, ""));
        let path = path.strip_prefix('/').ok_or_else(|| Refusal::wrong("the path does not begin with /"))?;
        let decoded =
            |text: &str| decoded(text).ok_or_else(|| Refusal::wrong("the path is not encoded as it should be"));
        let pair = |pair: &str| {
            let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
            Ok((decoded(name)?, decoded(value)?))
        };
        let header =
            |h: &httparse::Header<'_>| (h.name.to_lowercase(), String::from_utf8_lossy(h.value).trim().to_string());
        Ok(Self {
            method: parsed.method.unwrap_or_default().to_string(),
            path: path.split('/').map(decoded).collect::<Result<_, _>>()?,
            query: query.split('&').filter(|p| !p.is_empty()).map(pair).collect::<Result<_, Refusal>>()?,
            headers: parsed.headers.iter().map(header).collect(),
            ..Self::default()
        })
    }

    /// Reads the body, which has at most so many bytes.
    pub(crate) fn read_body(&mut self, stream: &mut TcpStream, most: u64) -> Result<(), Refusal> {
        if self.header("transfer-encoding").is_some() {
            return Err(Refusal::new(Status::Length, "say Content-Length"));
        }
        let length = match self.header("content-length").map(str::parse::<u64>) {
            Some(Ok(length)) if length > most => {
                return Err(Refusal::new(Status::TooLarge, format!("at most {most} bytes can be sent here")));
            }
            Some(Ok(length)) => length,
            Some(Err(_)) => return Err(Refusal::wrong("Content-Length is no number of bytes")),
            None => return Err(Refusal::new(Status::Length, "say Content-Length")),
        };
        self.body = std::mem::take(&mut self.begun);
        let left = length.saturating_sub(self.body.len() as u64);
        // what was not sent is not made room for
        stream.take(left).read_to_end(&mut self.body)?;
        match self.body.len() as u64 == length {
            true => Ok(()),
            false => Err(Refusal::wrong("the body has another length than was said")),
        }
    }

    /// The only value of a header; none where it stands there twice.
    pub(crate) fn header(&self, name: &str) -> Option<&str> {
        let mut values = self.headers.iter().filter(|(own, _)| own == name).map(|(_, value)| value.as_str());
        values.next().filter(|_| values.next().is_none())
    }

    /// Whether a header stands there at all.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.headers.iter().any(|(own, _)| own == name)
    }

    /// A value of the query.
    pub(crate) fn asked(&self, name: &str) -> Result<&str, Refusal> {
        let found = self.query.iter().find(|(own, _)| own == name);
        found.map(|(_, value)| value.as_str()).ok_or_else(|| Refusal::wrong(format!("the query lacks `{name}`")))
    }

    /// The body as JSON.
    pub(crate) fn told<T: serde::de::DeserializeOwned>(&self) -> Result<T, Refusal> {
        serde_json::from_slice(&self.body).map_err(|e| Refusal::wrong(format!("the body: {e}")))
    }
}

/// RFC 3986, section 2.1; none for what is no UTF-8 or holds a zero byte.
fn decoded(text: &str) -> Option<String> {
    let (mut bytes, mut rest) = (Vec::new(), text.bytes());
    while let Some(byte) = rest.next() {
        let digit = |b: Option<u8>| b.and_then(|b| char::from(b).to_digit(16)).map(|d| d as u8);
        bytes.push(if byte == b'%' { digit(rest.next())? << 4 | digit(rest.next())? } else { byte });
    }
    String::from_utf8(bytes).ok().filter(|t| !t.contains('\0'))
}
