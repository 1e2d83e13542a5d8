//! `fdm studio`: the application in the browser, over a folder whose files stay plain files that the command line reads.
//!
//! **In** a folder, and what the command brings ([`Doors`]). **Out** a server on this machine for whoever knows its token: pages, events, and
//! verbs of `fdm_session` at work. **Never** computes a number: model, fits and diagnoses are those of `session`, pages those of `report`, and what
//! is shown of each click is the command that does the same. **Start** at [`Server::bind`]; `routes` has what can be asked, `folder` the borders of
//! what is read and written, `jobs` the work, `live` the responses that follow a slider.

mod folder;
mod http;
mod jobs;
mod live;
mod results;
mod routes;
#[cfg(test)]
mod tests;

use fdm_session::Failure;
use fdm_session::failure::OrFailure;
use folder::Folder;
use http::{Answer, Refusal, Request, Status};
use serde::Serialize;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

/// Words of a command, its name in front, with what the project file adds.
pub type Completed = Box<dyn Fn(Vec<String>) -> Result<Vec<String>, Failure> + Send + Sync>;
/// Line and column (UTF-16) from 0.
pub type Place = (u32, u32);

/// What the language says of a text in the editor.
#[derive(Clone, Copy)]
pub struct Language {
    /// Every mistake and warning of a text with this name.
    pub findings: fn(&str, &str) -> Vec<Finding>,
    /// What can be typed at a place.
    pub suggestions: fn(&str, Place) -> Vec<Suggestion>,
    /// What stands there, as Markdown.
    pub explained: fn(&str, Place) -> Option<String>,
}

/// A mistake or a warning.
#[derive(Debug, Serialize)]
pub struct Finding {
    /// Its beginning and its end.
    pub place: [Place; 2],
    /// Whether it is a mistake.
    pub error: bool,
    /// What is wrong, and the nearest fix.
    pub message: String,
    /// The code that `fdm explain` knows.
    pub code: &'static str,
}

/// What can be typed.
#[derive(Debug, Serialize)]
pub struct Suggestion {
    /// The word.
    pub label: String,
    /// What it is.
    pub detail: Option<String>,
    /// What is declared under a name.
    pub declared: Option<String>,
    /// Whether arguments follow in brackets.
    pub called: bool,
}

/// What the command brings.
pub struct Doors {
    /// Completes the words of a command.
    pub completed: Completed,
    /// What the language says of a text.
    pub language: Language,
    /// The program, for commands that only print or write files; none where there is none.
    pub program: Option<PathBuf>,
}

/// All that requests share.
pub(crate) struct Studio {
    folder: Folder,
    doors: Doors,
    token: String,
    address: SocketAddr,
    jobs: jobs::Jobs,
    live: live::Live,
    results: results::Results,
    records: routes::Records,
    /// A state of the folder, and the words of a simulation in it.
    simulated: Mutex<(String, Vec<String>)>,
}

/// A server that listens.
pub struct Server {
    listener: TcpListener,
    studio: Arc<Studio>,
}

/// Connections that are answered at once: a window holds one for events, and asks by a few others.
const MOST_CONNECTIONS: usize = 64;
/// Bytes of a token.
const TOKEN: usize = 16;
/// Bytes of what is told in JSON.
const MOST_TOLD: u64 = 8 << 20;
/// Bytes of a record that is dropped on a window, which is held in memory.
const MOST_DROPPED: u64 = 1 << 30;

impl Server {
    /// Listens for a folder on a port of this machine; 0 is any that is free. The `folder` is empty for the working folder.
    ///
    /// # Errors
    /// [`Failure::Input`], for no folder, and a port that is taken.
    pub fn bind(folder: &Path, port: u16, doors: Doors) -> Result<Self, Failure> {
        let own = Folder::open(folder).map_err(|e| Failure::input([e.said]))?;
        let refused = |e| Failure::input([format!("port {port} of this machine: {}", fdm_results::store::reason(&e))]);
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        let mut random = [0_u8; TOKEN];
        getrandom::fill(&mut random).or_failure()?;
        let token = random.iter().map(|byte| format!("{byte:02x}")).collect();
        let studio = Studio {
            folder: own,
            doors,
            token,
            address,
            jobs: jobs::Jobs::default(),
            live: live::Live::default(),
            results: results::Results::default(),
            records: routes::Records::default(),
            simulated: Mutex::default(),
        };
        Ok(Self { listener, studio: Arc::new(studio) })
    }

    /// The address for a browser, with the token.
    pub fn address(&self) -> String {
        format!("http://{}/{}/", self.studio.address, self.studio.token)
    }

    /// Answers until the program ends.
    pub fn run(&self) {
        let open = Arc::new(AtomicUsize::new(0));
        for stream in self.listener.incoming().flatten() {
            let (studio, open) = (Arc::clone(&self.studio), Arc::clone(&open));
            if open.fetch_add(1, Ordering::Relaxed) >= MOST_CONNECTIONS {
                open.fetch_sub(1, Ordering::Relaxed);
                continue;
            }
            let answered = std::thread::Builder::new().name("request".into()).spawn({
                let open = Arc::clone(&open);
                move || {
                    answer(&studio, stream);
                    open.fetch_sub(1, Ordering::Relaxed);
                }
            });
            if answered.is_err() {
                open.fetch_sub(1, Ordering::Relaxed);
            }
        }
    }
}

/// Answers one request; a browser that goes away in the middle is no matter.
fn answer(studio: &Arc<Studio>, mut stream: TcpStream) {
    let answer = Request::read(&mut stream).and_then(|mut request| {
        studio.admit(&mut request)?;
        if request.method == "POST" {
            let most = if request.path == ["drop"] { MOST_DROPPED } else { MOST_TOLD };
            request.read_body(&mut stream, most)?;
        }
        routes::answer(studio, &request, &mut stream)
    });
    match answer {
        Ok(Some(answer)) => _ = answer.send(&mut stream),
        Ok(None) => {}
        Err(refusal) => {
            let _ = Answer::refused(&refusal).send(&mut stream);
            // what still comes is taken, so that the refusal is not lost with a reset connection
            let _ = stream.shutdown(std::net::Shutdown::Write);
            let _ = std::io::copy(&mut std::io::Read::take(&mut stream, MOST_TOLD), &mut std::io::sink());
        }
    }
}

impl Studio {
    /// Lets a request in: from this machine's own page, with the token, which is taken off its path.
    fn admit(&self, request: &mut Request) -> Result<(), Refusal> {
        let forbidden = |said: &str| Err(Refusal::new(Status::Forbidden, said));
        let port = self.address.port();
        let own = [self.address.to_string(), format!("localhost:{port}")];
        // a page from elsewhere that leads its own name to this machine asks under that name
        if !request.header("host").is_some_and(|host| own.iter().any(|o| o == host)) {
            return forbidden("this address is for this machine only");
        }
        let ours = |origin: &str| own.iter().any(|o| origin.strip_prefix("http://") == Some(o));
        if request.has("origin") && !request.header("origin").is_some_and(ours) {
            return forbidden("pages from elsewhere are not answered");
        }
        let site = request.header("sec-fetch-site").unwrap_or("none");
        if !["none", "same-origin"].contains(&site) {
            return forbidden("pages from elsewhere are not answered");
        }
        let token = if request.path.is_empty() { String::new() } else { request.path.remove(0) };
        let differs = token.bytes().zip(self.token.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b));
        if token.len() != self.token.len() || differs != 0 {
            return forbidden("the address lacks its token: take the whole address that `fdm studio` printed");
        }
        Ok(())
    }
}
