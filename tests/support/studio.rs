//! `fdm studio` over a folder, asked as its page asks, and killed at random moments while it writes.

use crate::command::Desk;
use fdm_numeric::random::SplitMix;
use fdm_results::store::{ResultFolder, whole_files};
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Stdio};
use std::thread;
use std::time::Duration;

const MODEL: &str = "model decay {
  state x = 2;
  param k = 0.5 in [0, 10] [1/s];
  der(x) = -k*x;
  output y = x;
}
";
/// A record long enough to be torn.
const ROWS: usize = 4000;
/// Records that are dropped in a round.
const DROPPED: usize = 8;
/// The latest moment of a kill: clicks go on until it comes.
const ROUND: Duration = Duration::from_millis(400);

/// The program at work.
pub struct Studio {
    child: Child,
    address: Address,
}

/// Where it is asked.
#[derive(Clone)]
struct Address {
    host: String,
    token: String,
}

impl Drop for Studio {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Studio {
    pub fn open(desk: &Desk) -> Self {
        let mut command = desk.command_of(["studio", "--no-browser"]);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let (host, token) = line.trim().trim_start_matches("http://").trim_end_matches('/').split_once('/').unwrap();
        let address = Address { host: host.into(), token: token.into() };
        Self { address, child }
    }
}

impl Address {
    /// The body of an answer that is good; none where it is not, or the program has gone.
    fn post(&self, path: &str, body: &[u8]) -> Option<String> {
        let mut stream = TcpStream::connect(&self.host).ok()?;
        let Self { host, token, .. } = self;
        let length = body.len();
        write!(stream, "POST /{token}/{path} HTTP/1.1\r\nHost: {host}\r\nContent-Length: {length}\r\n\r\n").ok()?;
        stream.write_all(body).ok()?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).ok()?;
        answer.starts_with("HTTP/1.1 200").then(|| answer.split_once("\r\n\r\n").map(|(_, body)| body.to_string()))?
    }
}

/// A text of a model with a number in it, as long as many blocks of a disk.
fn text(number: usize) -> String {
    format!("{MODEL}{}", format!("// {number}\n").repeat(3000))
}

fn record() -> String {
    let rows = (0..ROWS).map(|n| format!("{:.3},{:.6}\n", 0.001 * n as f64, 2.0 * (-0.0008 * n as f64).exp()));
    std::iter::once("t [s],y\n".to_string()).chain(rows).collect()
}

/// Kills the studio at random moments of clicks that write: a text, the project, a record that is dropped, a fit. What was answered stands
/// there afterwards, what was being written is the old or the new, and every result is whole. Says how often it was at work.
///
/// # Panics
/// When anything is lost or torn.
pub fn kills(count: usize, seed: u64) -> usize {
    let mut random = SplitMix(seed);
    let desk = Desk::with([("decay.fdm", text(0)), ("run.csv", record())]);
    desk.write("fdm.toml", "model = \"decay.fdm\"\ndata = [\"run.csv\"]\n");
    let (mut now, mut killed, mut dropped) = (0, 0, Vec::new());
    for round in 1..=count {
        let mut studio = Studio::open(&desk);
        let moment = ROUND.mul_f64(random.uniform());
        let address = studio.address.clone();
        let last = thread::scope(|scope| {
            let dropped = &mut dropped;
            let clicks = scope.spawn(move || clicks(&address, (now, round), dropped));
            thread::sleep(moment);
            studio.child.kill().unwrap();
            clicks.join().unwrap()
        });
        studio.child.wait().unwrap();
        killed += usize::from(last.next != now);
        let context = format!("a kill after {moment:.1?} (round {round})");
        let found = desk.text("decay.fdm");
        now = [last.next, last.written].into_iter().find(|n| text(*n) == found).unwrap_or_else(|| {
            panic!("{context}: the text is neither {} nor {}: {:.200}", last.written, last.next, found)
        });
        let project = desk.text("fdm.toml");
        let map = "model = \"decay.fdm\"\ndata = [\"run.csv\"]\n";
        assert!([map.to_string(), format!("{map}map = \"map.toml\"\n")].contains(&project), "{context}: {project}");
        for name in desk.names("").iter().filter(|name| name.starts_with("dropped") && name.ends_with(".csv")) {
            assert!(desk.text(name) == record(), "{context}: {name} is torn");
        }
        for name in &dropped {
            assert!(desk.path(name).is_file(), "{context}: {name} is lost");
        }
        let results = desk.path("results");
        for entry in fs::read_dir(&results).into_iter().flatten().map(|e| e.unwrap()) {
            // a program that was killed may leave a folder with a dot that it had not finished
            if !entry.file_name().to_string_lossy().starts_with('.') {
                assert!(ResultFolder::open(entry.path()).is_ok(), "{context}: {:?}", entry.path());
                whole_files(&entry.path()).unwrap_or_else(|e| panic!("{context}: {e}"));
            }
        }
    }
    killed
}

/// How far the clicks of a round came.
struct Came {
    /// The text that was answered for, and that which was asked for last.
    written: usize,
    next: usize,
}

fn clicks(studio: &Address, (before, round): (usize, usize), dropped: &mut Vec<String>) -> Came {
    let mut came = Came { written: before, next: before };
    let mut over = fdm_results::store::fingerprint(text(before).as_bytes());
    let fit = br#"{ "verb": "fit", "words": [] }"#;
    if studio.post("work", fit).is_none() {
        return came;
    }
    for k in 0.. {
        came.next = 10_000 * round + k;
        let body = serde_json::json!({ "path": "decay.fdm", "text": text(came.next), "over": over }).to_string();
        let Some(answer) = studio.post("text", body.as_bytes()) else { return came };
        (came.written, over) = (came.next, serde_json::from_str(&answer).unwrap());
        let values = if k % 2 == 0 { "[\"map.toml\"]" } else { "[]" };
        let set = format!("{{ \"key\": \"map\", \"values\": {values} }}");
        if studio.post("project", set.as_bytes()).is_none() {
            return came;
        }
        let name = format!("dropped_{round}_{k}.csv");
        // some are enough: each stays in the folder
        if k >= DROPPED {
            continue;
        }
        if studio.post(&format!("drop?name={name}"), record().as_bytes()).is_none() {
            return came;
        }
        dropped.push(name);
    }
    came
}
