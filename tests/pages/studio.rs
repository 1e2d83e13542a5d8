//! `fdm studio` in a browser: the roads from a record to a report by clicks. How fast it draws is measured by `studies/pages/studio_speed.py`.
//!
//! Needs Chromium and is left out by `cargo test`. The browser is steered by its own protocol, over its standard streams.
#![cfg(unix)]

use crate::browser::browser;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};
use support::{Desk, Normal, repository};
use tempfile::TempDir;

/// Longer than a diagnosis takes beside other tests.
const PATIENCE: Duration = Duration::from_secs(240);

/// The program at work, and a window on it.
struct Window {
    program: Child,
    browser: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    last: u64,
    session: Option<String>,
    complaints: Vec<String>,
    /// How often a page was there whole.
    loaded: usize,
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
        let (last, session, complaints, loaded) = (0, None, Vec::new(), 0);
        let mut window = Self { program, browser, to, from, last, session, complaints, loaded, _profile: profile };
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
            self.loaded += usize::from(heard["method"] == "Page.loadEventFired");
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
            assert!(begun.elapsed() < PATIENCE, "{expression}: {:?}", self.complaints);
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Loads the page anew, and waits for it: a script that is asked meanwhile would end with the old page.
    fn reload(&mut self) {
        let (before, begun) = (self.loaded, Instant::now());
        self.call("Page.reload", json!({}));
        while self.loaded == before {
            assert!(begun.elapsed() < PATIENCE, "the page is not there again");
            std::thread::sleep(Duration::from_millis(50));
            // an answer of the browser brings what happened before it
            self.call("Page.getNavigationHistory", json!({}));
        }
    }

    fn step(&mut self, number: usize) {
        let button = format!("document.querySelectorAll('#steps button')[{}]", number - 1);
        self.until(&button);
        self.run(&format!("{button}.click();"));
    }
}

impl Window {
    /// Clicks a button as soon as it can be clicked.
    fn click(&mut self, within: &str, text: &str) {
        let found = format!(
            "[...document.querySelectorAll('{within} button')].find((b) => b.textContent === '{text}' && !b.disabled && !b.hidden)"
        );
        self.until(&found);
        self.run(&format!("{found}.click();"));
    }

    /// Drags over a part of the record, from and to shares of its width.
    fn drag(&mut self, from: f64, to: f64) {
        self.run("document.querySelector('.record-view canvas').scrollIntoView({ block: 'center' });");
        // between the margins of the plot
        let place = "const r = document.querySelector('.record-view canvas').getBoundingClientRect(); return [r.left + 64, r.width - 76, r.top + 60];";
        let place = self.run(place);
        let [left, width, y] = [0, 1, 2].map(|k| place[k].as_f64().unwrap());
        for (kind, share, held) in [("mousePressed", from, 1), ("mouseMoved", to, 1), ("mouseReleased", to, 0)] {
            let mouse = json!({ "type": kind, "x": left + share * width, "y": y, "button": "left", "buttons": held, "clickCount": 1 });
            self.call("Input.dispatchMouseEvent", mouse);
        }
    }

    /// Chooses files, as by the dialog of the browser.
    fn choose(&mut self, files: &[&Path]) {
        self.until("document.querySelector('input[type=file]')");
        let document = self.call("DOM.getDocument", json!({}))["root"]["nodeId"].clone();
        let asked = json!({ "nodeId": document, "selector": "input[type=file]" });
        let input = self.call("DOM.querySelector", asked)["nodeId"].clone();
        self.call("DOM.setFileInputFiles", json!({ "nodeId": input, "files": files }));
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

/// The road of the guide on the tanker by clicks alone: record, segments to fit and to validate, model, fit, what is missing, accepted, fitted
/// and validated, reported. The command that the window names gives the same bits.
#[test]
#[ignore = "needs Chromium"]
fn the_tankers_road_by_clicks_in_a_browser() {
    let from = repository().join("models/ship_roll_decay");
    let desk = Desk::new();
    let mut window = Window::open(&desk);
    window.choose(&[&from.join("linear.fdm"), &from.join("run.csv")]);
    window.until("document.querySelector('.record-view canvas')?.getAttribute('aria-label')?.includes('roll')");
    window.click(".record-view", "Choose a segment");
    for (k, (share, button)) in [((0.0, 0.6), "Fit it"), ((0.6, 1.0), "Validate with it")].into_iter().enumerate() {
        window.drag(share.0, share.1);
        window.click(".segment", button);
        // a run stands in the list once the table of runs has it
        window.until(&format!(
            "document.querySelectorAll('.record-view aside .files button[aria-label^=take]').length === {}",
            k + 1
        ));
    }
    assert!(desk.text("runs.csv").contains("run.csv,run_2,validation"), "{}", desk.text("runs.csv"));
    window.step(2);
    window.until("document.querySelectorAll('.slider').length === 5");
    window.step(3);
    window.run("document.querySelectorAll('.fit-view .tools input')[2].value = '--every 16';");
    window.click(".fit-view", "Fit");
    window.until("document.querySelectorAll('.history li .says').length === 1");
    window.step(4);
    window.run(
        "const i = document.querySelectorAll('.missing-view input'); i[0].value = '900s'; i[1].value = '--every 16';",
    );
    window.click(".missing-view", "Find what is missing");
    window.until("document.querySelector('.card article code')");
    window.click(".card", "Accept all of it");
    window.until("[...document.querySelectorAll('.missing-view button')].some((b) => b.textContent === 'Undo')");
    window.step(3);
    window.click(".fit-view", "Fit");
    window.until("document.querySelectorAll('.history li .says').length === 2");
    // less than half of the errors are left, in the run that was not fitted too
    let errors = window.run("return [...document.querySelectorAll('.history li .note')].map((n) => n.textContent).filter((t) => t.includes('RMS'));");
    let left = |k: usize| errors[k].as_str().unwrap().split(' ').find_map(|word| word.parse::<f64>().ok()).unwrap();
    assert!(errors[1].as_str().unwrap().starts_with("validation") && errors.as_array().unwrap().len() == 4, "{errors}");
    assert!(left(0) < 0.5 * left(2) && left(1) < 0.5 * left(3), "{errors}");
    window.until("document.querySelector('.history li.at')?.textContent.startsWith('fit-2')");
    let command = window.run("return document.querySelector('#command').textContent;");
    let command = command.as_str().unwrap().strip_prefix("fdm ").unwrap().replace("results/fit-2", "again");
    desk.good(&format!("{command} -q --no-project"));
    assert_eq!(desk.text("again/result.json"), desk.text("results/fit-2/result.json"));
    window.step(5);
    window.click(".report-view", "Write the page");
    window.until("!document.querySelector('.report-view pre').hidden");
    assert!(desk.text("results/fit-2/report.html").contains("<h1>roll_decay_linear</h1>"));
    assert!(window.complaints.is_empty(), "{:?}", window.complaints);
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
    window.step(2);
    // what was typed stands in the file though the browser dies right afterwards
    window.run("const a = document.querySelector('.editor textarea'); a.focus(); a.setSelectionRange(0, 0); document.execCommand('insertText', false, '// the last word\\n');");
    std::thread::sleep(Duration::from_millis(100));
    window.browser.kill().unwrap();
    std::thread::sleep(Duration::from_millis(900));
    assert!(desk.text("linear.fdm").starts_with("// the last word\n"), "{:.200}", desk.text("linear.fdm"));
    // a text that is broken has no response, which the browser notes
    window.complaints.retain(|said| !said.contains("/simulate"));
    assert!(window.complaints.is_empty(), "{:?}", window.complaints);
}

/// A flight whose record states degrees and has two accelerometers exchanged, and a model without damping in pitch, by clicks alone: the
/// fault is found and repaired, what is missing is found, accepted, the next run designed, all undone in another window.
#[test]
#[ignore = "needs Chromium"]
fn a_newcomers_flight_is_repaired_fitted_extended_and_reported_by_clicks_in_a_browser() {
    let from = Desk::new();
    let flight = from.write("flight.csv", in_degrees_and_exchanged());
    let shipped = std::fs::read_to_string(repository().join("models/flight_path/joint.fdm")).unwrap();
    let undamped =
        shipped.replace(" + Cmq*q*c/(2*V)", "").replace(", Cmq = -12 [1]", "").replace("CLa = 4.5", "CLa = 5.1");
    let model = from.write("flight.fdm", &undamped);
    let desk = Desk::new();
    let mut window = Window::open(&desk);
    window.choose(&[&model, &flight]);
    window.until("document.querySelector('.record-view canvas')?.getAttribute('aria-label')?.includes('az_m')");
    window.click(".record-view", "Judge the record");
    window.until("document.querySelector('.findings .reason')?.textContent.includes('stands in the place of')");
    window.click(".findings", "Repair");
    window.until("document.querySelector('.findings button:disabled')?.textContent === 'in map.toml'");
    window.click(".record-view", "Judge the record");
    window.until("!/at work|stands in the place of/.test(document.querySelector('.findings').textContent)");
    assert!(desk.text("map.toml").contains("[channel.ax_m]\nfrom = \"az_m\""), "{}", desk.text("map.toml"));
    window.step(2);
    window.until("document.querySelectorAll('.slider').length > 15 && !document.querySelector('details.new').open");
    window.step(3);
    window.click(".fit-view", "Fit");
    window.until("document.querySelectorAll('.history li .says').length === 1");
    window.step(4);
    // a build for tests takes its time
    window.run("document.querySelector('.missing-view input').value = '900s';");
    window.click(".missing-view", "Find what is missing");
    window.until(
        "/^(missing_coupling|product_term)\\(q/.test(document.querySelector('.card article code')?.textContent)",
    );
    window.click(".card", "Accept all of it");
    window.until("[...document.querySelectorAll('.missing-view button')].some((b) => b.textContent === 'Undo')");
    assert_eq!(desk.text("flight.fdm"), desk.text("results/diagnose-1/extended.fdm"));
    window.step(3);
    window.click(".fit-view", "Fit");
    window.until("document.querySelector('.history li.at')?.textContent.startsWith('fit-2')");
    window.step(4);
    window.click(".missing-view", "Design the next run");
    window.until("document.querySelector('.missing-view .plotted canvas')?.getAttribute('aria-label')?.includes('elevator [rad]')");
    assert!(desk.text("results/design-1/run_1.csv").starts_with("t [s],elevator [rad]\n"));
    window.step(5);
    window.click(".report-view", "Write the page");
    window.until("!document.querySelector('.report-view pre').hidden");
    let reported = window.run("return document.querySelector('.report-view pre').textContent;");
    let newest = window.run("return document.querySelector('.report-view select').value;");
    assert_eq!(reported.as_str().unwrap().trim(), format!("{}/report.html", newest.as_str().unwrap()));
    // the window is closed and opened again: what was accepted is undone all the same
    window.reload();
    window.until("document.querySelector('.card article code')");
    window.step(4);
    window.click(".missing-view", "Undo");
    window.until("![...document.querySelectorAll('.missing-view button')].some((b) => b.textContent === 'Undo')");
    assert_eq!(desk.text("flight.fdm"), undamped);
    assert!(window.complaints.is_empty(), "{:?}", window.complaints);
}

/// The simulated flight that is shipped, in degrees, its accelerometers exchanged.
fn in_degrees_and_exchanged() -> String {
    let text = std::fs::read_to_string(repository().join("models/flight_path/run.csv")).unwrap();
    let (head, rows) = text.split_once('\n').unwrap();
    let angles: Vec<bool> = head.split(',').map(|title| title.contains("rad")).collect();
    let place = |name: &str| head.split(',').position(|title| title.starts_with(name)).unwrap();
    let (first, second) = (place("ax_m"), place("az_m"));
    let row = |line: &str| {
        let values = line.split(',').zip(&angles).map(|(value, angle)| {
            let value: f64 = value.parse().unwrap();
            format!("{:.6}", if *angle { value.to_degrees() } else { value })
        });
        let mut values: Vec<String> = values.collect();
        values.swap(first, second);
        values.join(",")
    };
    // the first 12 s hold all of its manoeuvres but one
    let rows: Vec<String> = rows.lines().take(241).map(row).collect();
    format!("{}\n{}\n", head.replace("rad", "deg"), rows.join("\n"))
}

/// A delay and a lag that one record cannot tell apart: the experiment that would is drawn, and is a table.
#[test]
#[ignore = "needs Chromium"]
fn causes_that_look_alike_are_told_apart_by_an_experiment_in_a_browser() {
    let desk = Desk::new();
    let servo = |drive: &str| {
        format!(
            "model servo {{
  input stick [deg];
  state y [deg], q [deg/s];
  param omega = 2 in [0.1, 20] [rad/s], zeta = 0.5 in [0, 2] [1];
  der(y) = q;
  der(q) = omega^2*({drive} - y) - 2*zeta*omega*q;
  output y_m [deg] = y;
}}
"
        )
    };
    desk.write("servo.fdm", servo("stick"));
    desk.write("truth.fdm", servo("delay(stick, 0.1)"));
    let stick = |k: usize| if (20..60).contains(&k) { 5.0 } else { f64::from(u8::from((60..80).contains(&k))) * -5.0 };
    let rows = (0..400).map(|k| format!("{:.2},{}\n", 0.05 * k as f64, stick(k)));
    desk.write("sticks.csv", format!("t [s],stick [deg]\n{}", rows.collect::<String>()));
    desk.good("simulate truth.fdm sticks.csv --output flown.csv -q");
    let mut normal = Normal(5);
    let row = |(k, line): (usize, &str)| {
        let y: f64 = line.split(',').nth(1).unwrap().parse().unwrap();
        format!("{:.2},{},{:.4}\n", 0.05 * k as f64, stick(k), y + 0.3 * normal.next())
    };
    let rows: String = desk.text("flown.csv").lines().skip(1).enumerate().map(row).collect();
    desk.write("record.csv", format!("t [s],stick [deg],y_m [deg]\n{rows}"));
    desk.write("fdm.toml", "model = \"servo.fdm\"\ndata = [\"record.csv\"]\n");
    let mut window = Window::open(&desk);
    window.step(4);
    window.run("document.querySelectorAll('.missing-view input')[1].value = '--only input_delay,actuator_lag';");
    window.click(".missing-view", "Find what is missing");
    window.click(".card", "Design the experiment that tells them apart");
    window.until(
        "document.querySelector('.missing-view .plotted canvas')?.getAttribute('aria-label')?.includes('stick [deg]')",
    );
    let command = window.run("return document.querySelector('#command').textContent;");
    assert_eq!(command, "fdm design --between=results/fit-1,results/fit-2 --runs=1 --records=results/design-1");
    assert_eq!(desk.text("results/design-1/run_1.csv").lines().count(), 401);
    assert!(window.complaints.is_empty(), "{:?}", window.complaints);
}

/// Models by kind and from the record, two fits compared, what other tools get, and what is told where there is no input to design.
#[test]
#[ignore = "needs Chromium"]
fn models_are_begun_compared_and_handed_on_by_clicks_in_a_browser() {
    let desk = Desk::new();
    let mut window = Window::open(&desk);
    window.step(2);
    window.until("document.querySelector('details.new').open");
    window.run("document.querySelector('details.new select').value = 'roll-decay';");
    window.click("details.new", "By kind");
    window.until("document.querySelectorAll('.slider').length > 3");
    assert_eq!(desk.text("fdm.toml"), "model = \"first.fdm\"\ndata = [\"first.csv\"]\n");
    window.step(3);
    for count in [1, 2] {
        window.click(".fit-view", "Fit");
        window.until(&format!("document.querySelectorAll('.history li .says').length === {count}"));
    }
    window.run("document.querySelectorAll('.history input').forEach((box) => box.click());");
    window.click(".fit-view", "Compare the two");
    window.until("document.querySelector('.fit-view iframe').contentDocument?.querySelector('h1')?.textContent.includes('fit-1')");
    window.step(4);
    window.click(".missing-view", "Design the next run");
    window.until("document.querySelector('#status').textContent.includes('no input')");
    window.step(5);
    for (button, file) in [
        ("C", "fit-2.c"),
        ("Rust", "fit-2.rs"),
        ("JSBSim", "fit-2.xml"),
        ("state space", "fit-2.json"),
        ("FMU", "fit-2.fmu"),
    ] {
        window.run("document.querySelector('.report-view pre').textContent = '';");
        window.click(".report-view", button);
        window.until("document.querySelector('.report-view pre').textContent");
        let said = window.run("return document.querySelector('.report-view pre').textContent;");
        // a ship that rolls is no aircraft, and the library of units need not stand beside the tests
        let refused = said.as_str().unwrap().contains(if file.ends_with("fmu") { "libfdm_fmu" } else { "JSBSim" });
        assert!(desk.path(file).is_file() || refused, "{button}: {said}");
    }
    window.step(2);
    window.run("document.querySelector('details.new').open = true; document.querySelector('details.new input').value = 'second.fdm';");
    window.click("details.new", "From the record");
    window.until("document.querySelector('.editor textarea').value.startsWith('// A first model of first.csv')");
    assert_eq!(desk.text("fdm.toml"), "model = \"second.fdm\"\ndata = [\"first.csv\"]\n");
    // a window that opens on the model has its sliders, though nothing else happens in the folder
    window.reload();
    window.until("document.querySelectorAll('.slider').length > 0");
    assert!(window.complaints.is_empty(), "{:?}", window.complaints);
}
