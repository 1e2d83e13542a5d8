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
use http::{Answer, Listener, MOST_TOLD, Refusal, Request, Status};
use serde::Serialize;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
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
    listener: Listener,
    studio: Arc<Studio>,
}

/// Bytes of a token.
const TOKEN: usize = 16;
/// Bytes of a record that is dropped on a window, which is held in memory.
const MOST_DROPPED: u64 = 1 << 30;

impl Server {
    /// Listens for a folder on a port of this machine; 0 is any that is free. The `folder` is empty for the working folder.
    ///
    /// # Errors
    /// [`Failure::Input`], for no folder, and a port that is taken.
    pub fn bind(folder: &Path, port: u16, doors: Doors) -> Result<Self, Failure> {
        let own = Folder::open(folder).map_err(|e| Failure::input([e.said]))?;
        let listener = Listener::bind(port)?;
        let mut random = [0_u8; TOKEN];
        getrandom::fill(&mut random).or_failure()?;
        let token = random.iter().map(|byte| format!("{byte:02x}")).collect();
        let studio = Studio {
            folder: own,
            doors,
            token,
            address: listener.address,
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
        let studio = Arc::clone(&self.studio);
        self.listener.run(move |mut request, stream| {
            studio.admit(&mut request)?;
            if request.method == "POST" {
                let most = if request.path == ["drop"] { MOST_DROPPED } else { MOST_TOLD };
                request.read_body(stream, most)?;
            }
            routes::answer(&studio, &request, stream)
        });
    }
}

/// Pages for browsers of this machine, which anybody on it may read.
pub struct Pages(Listener);

impl Pages {
    /// Listens on a port of this machine; 0 is any that is free.
    ///
    /// # Errors
    /// [`Failure::Input`], for a port that is taken.
    pub fn bind(port: u16) -> Result<Self, Failure> {
        Listener::bind(port).map(Self)
    }

    /// The address for a browser.
    pub fn address(&self) -> String {
        format!("http://{}/", self.0.address)
    }

    /// Answers until the program ends; `page` gives what stands at a path without its first `/`, its kind in front.
    pub fn run(&self, page: impl Fn(&str) -> Option<(&'static str, String)> + Send + Sync + 'static) {
        self.0.run(move |request, _| match request.method.as_str() {
            "GET" => {
                let found = page(&request.path.join("/")).map(|(kind, text)| Some(Answer::of(kind, text)));
                found.ok_or_else(|| Refusal::new(Status::NotFound, "there is nothing here"))
            }
            _ => Err(Refusal::new(Status::Method, "only GET is supported")),
        });
    }
}

impl Studio {
    /// Lets a request in that has the token, which is taken off its path.
    fn admit(&self, request: &mut Request) -> Result<(), Refusal> {
        let token = if request.path.is_empty() { String::new() } else { request.path.remove(0) };
        let differs = token.bytes().zip(self.token.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b));
        if token.len() != self.token.len() || differs != 0 {
            let said = "the address lacks its token: take the whole address that `fdm studio` printed";
            return Err(Refusal::new(Status::Forbidden, said));
        }
        Ok(())
    }
}
