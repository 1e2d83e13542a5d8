//! `fdm studio` in a browser: the road from a record to a fit by clicks, and how fast a long record is drawn.
//!
//! Needs Chromium and is left out by `cargo test`. The browser is steered by its own protocol, over its standard streams.
#![cfg(unix)]

use crate::browser::browser;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};
use support::{Desk, repository};
use tempfile::TempDir;

/// The program at work, and a window on it.
struct Window {
    program: Child,
    browser: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    last: u64,
    session: Option<String>,
    complaints: Vec<String>,
    _profile: TempDir,
}

impl Drop for Window {
    fn drop(&mut self) {
        for child in [&mut self.browser, &mut self.program] {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

impl Window {
    fn open(desk: &Desk) -> Self {
        let mut program = desk.command_of(["studio", "--no-browser"]).stdout(Stdio::piped()).spawn().unwrap();
        let mut address = String::new();
        BufReader::new(program.stdout.take().unwrap()).read_line(&mut address).unwrap();
        let profile = tempfile::tempdir().unwrap();
        // the protocol is spoken over the streams 3 and 4
        let mut browser = Command::new("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<&0 4>&1 >/dev/null 2>&1"])
            .arg(browser())
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", "--window-size=1280,800"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (to, from) = (browser.stdin.take().unwrap(), BufReader::new(browser.stdout.take().unwrap()));
        let (last, session, complaints) = (0, None, Vec::new());
        let mut window = Self { program, browser, to, from, last, session, complaints, _profile: profile };
        let targets = window.call("Target.getTargets", json!({}));
        let all = targets["targetInfos"].as_array().unwrap();
        let id = all.iter().find(|t| t["type"] == "page").unwrap()["targetId"].clone();
        let attached = window.call("Target.attachToTarget", json!({ "targetId": id, "flatten": true }));
        window.session = Some(attached["sessionId"].as_str().unwrap().into());
        for domain in ["Runtime.enable", "Log.enable", "Page.enable"] {
            window.call(domain, json!({}));
        }
        window.call("Page.navigate", json!({ "url": address.trim() }));
        window
    }

    fn call(&mut self, method: &str, params: Value) -> Value {
        self.last += 1;
        let mut message = json!({ "id": self.last, "method": method, "params": params });
        if let Some(session) = &self.session {
            message["sessionId"] = session.as_str().into();
        }
        write!(self.to, "{message}\0").unwrap();
        self.to.flush().unwrap();
        loop {
            let mut bytes = Vec::new();
            self.from.read_until(0, &mut bytes).unwrap();
            let heard: Value = serde_json::from_slice(&bytes[..bytes.len() - 1]).unwrap();
            if heard["id"] == self.last {
                assert!(heard["error"].is_null(), "{method}: {heard}");
                return heard["result"].clone();
            }
            if heard["method"] == "Runtime.exceptionThrown" || heard["method"] == "Log.entryAdded" {
                self.complaints.push(heard["params"].to_string());
            }
        }
    }

    /// The value of a script.
    fn run(&mut self, script: &str) -> Value {
        let expression = format!("(async () => {{ {script} }})()");
        let asked = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let found = self.call("Runtime.evaluate", asked);
        assert!(found["exceptionDetails"].is_null(), "{script}: {found}");
        found["result"]["value"].clone()
    }

    /// Waits until an expression holds.
    fn until(&mut self, expression: &str) {
        let begun = Instant::now();
        while self.run(&format!("return Boolean({expression});")) != true {
            assert!(begun.elapsed() < Duration::from_secs(60), "{expression}: {:?}", self.complaints);
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn step(&mut self, number: usize) {
        self.run(&format!("document.querySelectorAll('#steps button')[{}].click();", number - 1));
    }
}

fn tanker() -> Desk {
    let desk = Desk::new();
    for file in ["run.csv", "linear.fdm"] {
        std::fs::copy(repository().join("models/ship_roll_decay").join(file), desk.path(file)).unwrap();
    }
    desk.write("fdm.toml", "model = \"linear.fdm\"\ndata = [\"run.csv\"]\n\n[options]\nevery = 8\n");
    desk
}

#[test]
#[ignore = "needs Chromium"]
fn from_a_record_to_a_fit_by_clicks_in_a_browser() {
    let desk = tanker();
    let mut window = Window::open(&desk);
    window.until("document.querySelector('.record-view canvas')?.getAttribute('aria-label')?.includes('roll')");
    window.step(2);
    window.until("document.querySelectorAll('.beside math').length >= 3");
    window.until("document.querySelectorAll('.slider').length === 5");
    // a mistake is underlined, listed and saved; the browser's own undo takes it back
    window.run("const a = document.querySelector('.editor textarea'), at = a.value.indexOf('- d1*p;') + 6; a.focus(); a.setSelectionRange(at, at); document.execCommand('insertText', false, ' - k3*phi^3');");
    window.until("document.querySelector('.found')?.textContent.includes('`k3` is not declared')");
    window.until("document.querySelector('.marks u')?.textContent === 'k3'");
    window.run("document.execCommand('undo');");
    window.until("!document.querySelector('.found li')");
    window.run("const s = document.querySelector('.slider input[aria-label^=d1]'); s.value = 0.02; s.dispatchEvent(new Event('input')); s.dispatchEvent(new Event('change'));");
    window.until("document.querySelector('#command').textContent === 'fdm simulate --set=d1=0.02'");
    window.step(3);
    window.run("document.querySelector('.fit-view button.first').click();");
    window.until("document.querySelector('.history li .says')");
    window.until("document.querySelector('.fit-view iframe').contentDocument?.querySelector('h1')?.textContent === 'roll_decay_linear'");
    assert!(desk.path("results/fit-1/result.json").is_file());
    let unnamed = window.run("return [...document.querySelectorAll('button, input, select, textarea, iframe')].filter((e) => !(e.textContent.trim() || e.getAttribute('aria-label') || e.title || e.closest('label') || e.hidden)).map((e) => e.outerHTML);");
    assert_eq!(unnamed, json!([]), "what a screen reader has no name for");
    // a text that is broken has no response, which the browser notes
    window.complaints.retain(|said| !said.contains("/simulate"));
    assert!(window.complaints.is_empty(), "{:?}", window.complaints);
}

#[test]
#[ignore = "needs Chromium"]
fn a_million_samples_are_zoomed_in_a_browser_as_fast_as_they_are_seen() {
    let desk = Desk::new();
    let mut rows = String::from("t [s],a,b\n");
    (0..1_000_000).for_each(|k| {
        let t = 0.001 * f64::from(k);
        rows.push_str(&format!("{t:.3},{:.4},{:.4}\n", (0.3 * t).sin() + 0.1 * (61.0 * t).sin(), (0.7 * t).cos()));
    });
    desk.write("long.csv", rows);
    let mut window = Window::open(&desk);
    window.until("document.querySelector('.record-view canvas')?.getAttribute('aria-label')?.includes('b')");
    let drawn = window.run(
        "const c = document.querySelector('.record-view canvas'), box = c.getBoundingClientRect(), frame = () => new Promise(requestAnimationFrame), all = [];
        c.focus(); await frame();
        for (let k = 0; k < 60; k++) { c.dispatchEvent(new WheelEvent('wheel', { ctrlKey: true, deltaY: k < 30 ? -120 : 120, clientX: box.left + 400, clientY: box.top + 60, bubbles: true, cancelable: true })); await frame(); await frame(); all.push(Number(c.dataset.took)); }
        return all.sort((a, b) => a - b)[6];",
    );
    // where other work shares the processors most drawings wait for it
    println!("{drawn} ms a drawing");
    assert!(drawn.as_f64().unwrap() < 16.0, "{drawn} ms a drawing: 60 of them do not fit into a second");
}
