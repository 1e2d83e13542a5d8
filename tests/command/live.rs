//! Work that tells how far it is: `fdm serve` beside a study and a fit that are at work, interrupted and killed.
#![cfg(unix)]

use rustix::process::{Pid, Signal, kill_process};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, SystemTime};
use support::Desk;

const MODEL: &str = "model decay \"first order\" {
  state x = free;
  param k = 0.5 in [0, 10] [1/s], c = 0.1;
  der(x) = -k*x;
  output y = x + c;
}
";
/// Longer than any machine takes to begin.
const PATIENCE: Duration = Duration::from_secs(120);

/// A folder with a model and a record, and a server beside it.
struct Served {
    desk: Desk,
    server: Child,
    address: String,
}

impl Served {
    fn new() -> Self {
        let desk = Desk::with([("decay.fdm", MODEL)]);
        let mut rows = String::from("t [s],y\n");
        for n in 0..60 {
            let (t, noise) = (0.1 * f64::from(n), 0.02 * (f64::from(n * n) * 0.7).sin());
            rows.push_str(&format!("{t},{}\n", 2.0 * (-0.8 * t).exp() + 0.2 + noise));
        }
        desk.write("run.csv", rows);
        let mut server = command(&desk, "serve result").stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.trim().trim_start_matches("http://").trim_end_matches('/').to_string();
        Self { desk, server, address }
    }

    fn begin(&self, words: &str) -> Child {
        command(&self.desk, words).spawn().unwrap()
    }

    fn asked(&self, path: &str) -> String {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {}\r\n\r\n", self.address).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer.split_once("\r\n\r\n").unwrap().1.to_string()
    }

    /// The page as soon as it says all of this.
    fn page_with(&self, words: &[&str]) -> String {
        let begun = Instant::now();
        loop {
            let page = self.asked("/page");
            let missing: Vec<&&str> = words.iter().filter(|w| !page.contains(**w)).collect();
            if missing.is_empty() {
                return page;
            }
            assert!(begun.elapsed() < PATIENCE, "{missing:?} is not in {page:.4000}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

fn command(desk: &Desk, words: &str) -> Command {
    let mut command = desk.command(words);
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command
}

fn interrupt(mut child: Child) {
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    child.wait().unwrap();
}

#[test]
fn a_study_is_seen_while_it_works_and_its_result_afterwards() {
    let served = Served::new();
    assert_eq!(served.asked("/state"), "none");
    assert!(served.asked("/page").contains("No result yet"));
    let study = served.begin("study decay.fdm --data run.csv --repeats 1000000 -q --out result --checkpoint kept");
    let page = served.page_with(&[
        "decay: at work",
        " of 1000000 repeats have ended",
        "time left",
        "id=\"coverage-1\"",
        "<progress",
    ]);
    assert!(page.contains("So far: Nominal 95 % intervals hold"), "{page:.4000}");
    // nothing but text stands where the result will be
    assert!(
        !served.desk.path("result").exists()
            && served.desk.path(".result.progress").exists()
            && served.desk.path(".kept.progress").exists()
    );
    let state = served.asked("/state");
    assert!(state.starts_with("work "), "{state}");
    let begun = Instant::now();
    while served.asked("/state") == state {
        assert!(begun.elapsed() < PATIENCE, "the page goes on");
        std::thread::sleep(Duration::from_millis(100));
    }
    interrupt(study);
    let page = served.asked("/page");
    assert!(
        page.contains("decay: study") && page.contains("Interrupted: ") && page.contains("id=\"estimates-1\""),
        "{page:.4000}"
    );
    assert!(!served.asked("/state").starts_with("work "));
    assert!(served.desk.names("").iter().all(|n| !n.ends_with(".progress")), "{:?}", served.desk.names(""));
}

#[test]
fn a_fit_from_many_starts_is_seen_and_a_dead_one_is_told() {
    let served = Served::new();
    let words = "fit decay.fdm --data run.csv --starts 1000000 -q --out result";
    let mut fit = served.begin(words);
    let page = served.page_with(&["decay: at work", " of 1000000 starts", "id=\"starts-1\""]);
    assert!(page.contains("cost above the best"), "{page:.4000}");
    fit.kill().unwrap();
    fit.wait().unwrap();
    // it died without a word, which is seen after a while
    assert!(served.asked("/state").starts_with("work "));
    let long_ago = SystemTime::now() - Duration::from_secs(300);
    File::options().append(true).open(served.desk.path(".result.progress")).unwrap().set_modified(long_ago).unwrap();
    assert!(served.asked("/state").starts_with("silent "));
    assert!(served.asked("/page").contains("Nothing was heard of this work for 5 min"));
    // what it left says nothing beside a result, and goes with the next work that is told
    assert!(command(&served.desk, "fit decay.fdm --data run.csv -q --out result").status().unwrap().success());
    assert!(served.asked("/page").contains("decay: fit"));
    assert!(served.desk.names("").iter().all(|n| !n.ends_with(".progress")), "{:?}", served.desk.names(""));
    let again = served.begin(words);
    served.page_with(&["decay: at work"]);
    interrupt(again);
    assert!(served.asked("/page").contains("decay: fit"));
}

#[test]
fn corrections_and_parameters_are_seen_while_a_fit_works() {
    let served = Served::new();
    // so many steps, and a way so slow, that it takes longer than a second on any machine
    let curved = MODEL.replace("-k*x", "-k*x*(1 + 0.01*x^2)");
    served.desk.write("curved.fdm", curved);
    let mut rows = String::from("t [s],y\n");
    for n in 0..2000 {
        let t = 3e-3 * f64::from(n);
        let ripple = 0.02 * (f64::from(n % 100) * 0.7).sin();
        rows.push_str(&format!("{t:.3},{:.6}\n", 2.0 * (-0.8 * t).exp() + 0.2 + ripple));
    }
    served.desk.write("long.csv", rows);
    let fit = served.begin(
        "fit curved.fdm --data long.csv --optimizer nelder-mead --integrator runge-kutta --steps 800 -q --out result",
    );
    let page = served.page_with(&["decay: at work", "id=\"convergence-1\"", "largest step", "id=\"parameters\""]);
    assert!(page.contains("At work: iteration ") && page.contains("so far "), "{page:.4000}");
    interrupt(fit);
    assert!(served.asked("/page").contains("decay: fit"));
}
