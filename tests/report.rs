//! Pages of results without a browser: the same from memory and from the folder, figures by name, the server of one machine.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

const MODEL: &str = "model decay \"first order with an offset\" {
  input u [deg];
  state x = free;
  param k = 1 in [0, 50] [1/s] \"damping\", g_u = 1;
  param bias = 0 per run;
  der(x) = -k*x + g_u*u;
  output y = x + bias;
}
";

/// A folder with a model, two runs and a result.
struct Desk(TempDir);

impl Desk {
    fn new() -> Self {
        let desk = Self(tempfile::tempdir().unwrap());
        fs::write(desk.path("model.fdm"), MODEL).unwrap();
        fs::write(desk.path("one.csv"), record(0.7)).unwrap();
        fs::write(desk.path("two.csv"), record(-0.4)).unwrap();
        desk.good("fit model.fdm --data one.csv --hold u -q --out result --report page.html");
        desk
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    fn command(&self, words: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_fdm"));
        command.args(words.split_whitespace()).current_dir(self.0.path());
        command
    }

    fn run(&self, words: &str) -> Output {
        self.command(words).output().unwrap()
    }

    fn good(&self, words: &str) -> String {
        let output = self.run(words);
        assert_eq!(output.status.code(), Some(0), "{words}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }

    fn refused(&self, words: &str) -> String {
        let output = self.run(words);
        assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{words}");
        String::from_utf8(output.stderr).unwrap()
    }
}

/// x' = -2 x + 3 u under a held square wave, exactly, with a ripple that stands for noise.
fn record(start: f64) -> String {
    let (k, g, dt) = (2.0, 3.0, 0.05);
    let mut x: f64 = start;
    let mut rows = String::from("t [s],u [deg],y\n");
    for n in 0..160 {
        let u = if (0.11 * f64::from(n)).sin() > 0.0 { 1.0 } else { -1.0 };
        let ripple = 0.01 * (f64::from(n * n) * 0.7).sin();
        rows.push_str(&format!("{:.2},{u},{}\n", dt * f64::from(n), x + 0.3 + ripple));
        x = (x - g / k * u) * (-k * dt).exp() + g / k * u;
    }
    rows
}

#[test]
fn memory_and_folder_give_the_same_page() {
    let desk = Desk::new();
    assert!(desk.good("report result").ends_with("report.html\n"));
    let page = desk.text("page.html");
    assert!(page == desk.text("result/report.html") && page == desk.good("report result -o -"));
    for expected in
        ["<math ", "<msub><mi>g</mi>", "id=\"modes\"", "id=\"history-1-1\"", "damping", "result --report page.html"]
    {
        assert!(page.contains(expected), "{expected}");
    }
    // names of vocabularies, which no browser asks for
    assert_eq!(page.matches("http://").count(), page.matches("http://www.w3.org/").count());
    assert!(!page.contains("https://"));
    // a page in the folder does not make it another result, nor does it stand in the way of the next
    desk.good("fit model.fdm --data one.csv --hold u -q --out result");
    fs::write(desk.path("result/model.fdm"), "model other { output y = 1; }").unwrap();
    assert!(
        desk.refused("report result")
            .contains("changed or missing since it was written, and not to be trusted: model.fdm")
    );
    assert!(desk.refused("report none").contains("none"));
    assert!(desk.refused("fit model.fdm --data one.csv --report none/page.html -q").contains("none/page.html"));
}

#[test]
fn what_the_page_tells_the_result_has_for_programs_too() {
    let desk = Desk::new();
    let result: Value = serde_json::from_str(&desk.text("result/result.json")).unwrap();
    let mode = &result["modes"]["modes"][0];
    let k = result["parameters"].as_array().unwrap().iter().find(|p| p["name"] == "k").unwrap();
    let close = |a: &Value, b: f64| (a.as_f64().unwrap() - b).abs() < 1e-9 * b.abs();
    assert!(close(&mode["re"], -k["value"].as_f64().unwrap()), "{mode}");
    let error = k["corrected_error"].as_f64().or(k["standard_error"].as_f64()).unwrap();
    assert!(close(&mode["standard_errors"]["re"], error), "{mode} {error}");
    assert!(result["remarks"].as_array().unwrap().iter().all(|r| r["about"].is_string() && r["sentence"].is_string()));
}

#[test]
fn validations_have_pages_and_say_so() {
    let desk = Desk::new();
    desk.good("validate --from-result result --data two.csv --hold u -q --report valid.html");
    let page = desk.text("valid.html");
    assert!(page.contains("decay: validation") && page.contains("The validation converged") && page.contains("two"));
}

#[test]
fn figures_have_names_and_become_files() {
    let desk = Desk::new();
    let list = desk.good("plot result");
    assert!(list.lines().any(|l| l.starts_with("history-1-1 ")) && list.contains("autocorrelation-1"), "{list}");
    desk.good("plot result --figure history-1-1 -o y.svg");
    let svg = desk.text("y.svg");
    assert!(svg.starts_with("<svg xmlns=") && svg.trim_end().ends_with("</svg>") && svg.contains("measured"));
    assert_eq!(svg, desk.good("plot result --figure history-1-1"));
    assert!(desk.refused("plot result --figure history-1-2").contains("did you mean `history-1-1`?"));
    assert!(desk.refused("plot result --figure history-1-1 -o y.png").contains(".svg"));
}

#[test]
fn the_server_shows_the_page_to_this_machine_only() {
    let desk = Desk::new();
    let mut server = desk.command("serve result").stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let address = line.trim().trim_start_matches("http://").trim_end_matches('/').to_string();
    let asked = |path: &str, host: &str| {
        let mut stream = TcpStream::connect(&address).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    };
    let page = asked("/page", &address);
    let state = asked("/state", &address);
    let (watch, foreign, nothing) =
        (asked("/", &address), asked("/page", "elsewhere.example"), asked("/../model.fdm", &address));
    desk.good("fit model.fdm --data two.csv --hold u -q --out result");
    let later = asked("/state", &address);
    server.kill().unwrap();
    server.wait().unwrap();
    assert!(address.starts_with("127.0.0.1:"), "{line}");
    assert!(page.starts_with("HTTP/1.1 200") && page.ends_with(&desk.text("page.html")));
    assert!(watch.contains("iframe") && foreign.starts_with("HTTP/1.1 403") && nothing.starts_with("HTTP/1.1 404"));
    assert_ne!(state, later);
}
