//! The server as a browser meets it: by plain requests. What it answers is what `session` gives; what it refuses changes nothing.

use crate::{Doors, Finding, Language, Server, Suggestion};
use fdm_session::request::{Held, Watch, fit, read, simulate, sources};
use fdm_system::Model;
use std::collections::BTreeMap;
use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The tanker of the guide, as its first textbook model says it.
const MODEL: &str = "model tanker {
  state phi [rad] = free;
  state p [rad/s] = free;
  param omega2 = 6.0 in [0, 100] [1/s^2];
  param d1 = 0.05 [1/s];
  param bias = 0 [deg] per run;
  der(phi) = p;
  der(p) = -omega2*phi - d1*p;
  output roll [deg] = rad2deg(phi) + bias;
}
";
const PROJECT: &str = "model = \"tanker.fdm\"\ndata = [\"run.csv\"]\n";
/// Every eighth sample of its record is enough here.
const THINNED: &str = "--every=8";

/// A language that finds one thing; that of the command has tests of its own.
const LANGUAGE: Language = Language {
    findings: |_, text| {
        let found = text.lines().position(|line| line.contains("omega*phi")).map(|line| Finding {
            place: [(line as u32, 12), (line as u32, 17)],
            error: true,
            message: "`omega` is not declared".into(),
            code: "name",
        });
        found.into_iter().collect()
    },
    suggestions: |_, _| vec![Suggestion { label: "sin".into(), detail: None, declared: None, called: true }],
    explained: |text, (line, _)| text.lines().nth(line as usize).map(str::to_string),
};

/// A server over a folder of its own.
struct Desk {
    folder: TempDir,
    address: String,
    host: String,
}

/// A status, and a body.
type Answer = (u16, Vec<u8>);

impl Desk {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let record = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/ship_roll_decay/run.csv");
        fs::copy(record, folder.path().join("run.csv")).unwrap();
        fs::write(folder.path().join("tanker.fdm"), MODEL).unwrap();
        fs::write(folder.path().join("fdm.toml"), PROJECT).unwrap();
        // what the project file says, as the command adds it
        let home = folder.path().to_path_buf();
        let completed = move |mut words: Vec<String>| {
            let at = |name: &str| home.join(name).display().to_string();
            if !words.iter().any(|w| w.starts_with("--no-project")) {
                words.insert(2, at("tanker.fdm"));
                words.extend([format!("--data={}", at("run.csv")), THINNED.into()]);
            }
            words.retain(|w| w != "--no-project");
            Ok(words.into_iter().map(|w| w.replace("--data=run.csv", &format!("--data={}", at("run.csv")))).collect())
        };
        let doors = Doors { completed: Box::new(completed), language: LANGUAGE, program: None };
        let server = Server::bind(folder.path(), 0, doors).unwrap();
        let address = server.address();
        let host = address.trim_start_matches("http://").split('/').next().unwrap().to_string();
        std::thread::spawn(move || server.run());
        Self { folder, address, host }
    }

    fn token(&self) -> &str {
        self.address.trim_end_matches('/').rsplit('/').next().unwrap()
    }

    /// Sends bytes as they are.
    fn raw(&self, bytes: &[u8]) -> Answer {
        self.sent(bytes, false)
    }

    /// Sends bytes, and that there are no more.
    fn cut(&self, bytes: &[u8]) -> Answer {
        self.sent(bytes, true)
    }

    fn sent(&self, bytes: &[u8], ended: bool) -> Answer {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        // who is refused early may hear of it before all was sent
        let _ = stream.write_all(bytes);
        if ended {
            let _ = stream.shutdown(std::net::Shutdown::Write);
        }
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let text = String::from_utf8_lossy(&answer);
        let status = text.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or(0);
        let body = answer.windows(4).position(|w| w == b"\r\n\r\n").map_or(Vec::new(), |at| answer[at + 4..].to_vec());
        (status, body)
    }

    fn get(&self, path: &str) -> Answer {
        self.raw(format!("GET /{}/{path} HTTP/1.1\r\nHost: {}\r\n\r\n", self.token(), self.host).as_bytes())
    }

    fn post(&self, path: &str, body: &str) -> Answer {
        let head = format!(
            "POST /{}/{path} HTTP/1.1\r\nHost: {}\r\nOrigin: http://{}\r\nContent-Length: {}\r\n\r\n",
            self.token(),
            self.host,
            self.host,
            body.len()
        );
        self.raw(format!("{head}{body}").as_bytes())
    }

    fn good(&self, (status, body): Answer) -> String {
        let text = String::from_utf8_lossy(&body).into_owned();
        assert_eq!(status, 200, "{text}");
        text
    }

    /// Does work to its end, and gives what is said of it.
    fn work(&self, verb: &str, words: &[&str]) -> String {
        let asked = serde_json::json!({ "verb": verb, "words": words }).to_string();
        let id = self.good(self.post("work", &asked));
        let begun = Instant::now();
        loop {
            let state: serde_json::Value = serde_json::from_str(&self.good(self.get("state"))).unwrap();
            let job =
                state["jobs"].as_array().unwrap().iter().find(|j| j["id"].as_u64() == id.parse().ok()).unwrap().clone();
            if !job["ended"].is_null() {
                return job.to_string();
            }
            assert!(begun.elapsed() < Duration::from_secs(300), "{job}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn text(&self, path: &str) -> String {
        fs::read_to_string(self.folder.path().join(path)).unwrap()
    }

    /// Every file below the folder.
    fn all(&self) -> BTreeMap<String, Vec<u8>> {
        fn list(folder: &Path, found: &mut BTreeMap<String, Vec<u8>>) {
            for entry in fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
                match entry.is_dir() {
                    true => list(&entry, found),
                    false => _ = found.insert(entry.display().to_string(), fs::read(&entry).unwrap()),
                }
            }
        }
        let mut found = BTreeMap::new();
        list(self.folder.path(), &mut found);
        found
    }
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap()
}

/// The road of the guide: record, model, response, fit, diagnosis, acceptance, undo, report; each with the bits of `session`.
#[test]
fn the_road_from_a_record_to_a_report_has_the_bits_of_session() {
    let desk = Desk::new();
    let model = Model::from_text("tanker.fdm", MODEL).unwrap();
    let words = vec![THINNED.to_string()];
    let from = sources(&model, &[desk.folder.path().join("run.csv")], &words, false).unwrap();
    let records = || read(&model, &from, &[]).unwrap().into_iter().map(|(record, _)| record).collect::<Vec<_>>();

    let contents = json(&desk.good(desk.get("record?path=run.csv")));
    assert_eq!(
        (&contents["topics"][0]["rows"], &contents["topics"][0]["fields"][1]["name"]),
        (&6674.into(), &"roll".into())
    );
    let (status, samples) = desk.get("samples?path=run.csv&topic=0&field=1");
    assert_eq!((status, samples.len()), (200, 8 * 6674));
    assert_eq!(f64::from_le_bytes(samples[..8].try_into().unwrap()).to_bits(), (-0.1668535_f64).to_bits());

    let broken = MODEL.replace("-omega2*phi", "-omega*phi");
    let said =
        json(&desk.good(desk.post("check", &serde_json::json!({ "path": "tanker.fdm", "text": broken }).to_string())));
    assert_eq!(said["findings"][0]["place"], serde_json::json!([[7, 12], [7, 17]]), "{said}");
    assert!(said["equations"].as_str().unwrap().contains("<math"), "{said}");
    let typed = serde_json::json!({ "text": MODEL, "place": [7, 12] }).to_string();
    assert_eq!(json(&desk.good(desk.post("suggestions", &typed)))[0]["label"], "sin");
    assert_eq!(json(&desk.good(desk.post("explained", &typed))), MODEL.lines().nth(7).unwrap());

    let (status, bytes) =
        desk.post("simulate", r#"{ "run": 0, "set": [["d1", 0.02]], "exact": true, "measured": true }"#);
    let own = simulate(&model, &records()[0].run, &["--set=d1=0.02".to_string()]).unwrap().response;
    let begins = 4 + u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
    let response: Vec<u64> =
        bytes[begins..].chunks_exact(8).take(own.len()).map(|b| u64::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!((status, response), (200, own.iter().map(|v| v.to_bits()).collect::<Vec<_>>()));

    let job = json(&desk.work("fit", &[]));
    assert_eq!((&job["place"], &job["ended"]["kept"]), (&"results/fit-1".into(), &true.into()), "{job}");
    let held = Held { model: &model, records: records(), validation: Vec::new(), words: &words };
    let fitted = fit(held, &Watch::default()).unwrap();
    let result = String::from_utf8(fitted.answer.file("result.json").unwrap().to_vec()).unwrap();
    assert_eq!(desk.text("results/fit-1/result.json"), result);

    let job = json(&desk.work("diagnose", &["--only=cubic_stiffness,quadratic_damping", "--time-limit=120s"]));
    assert_eq!(job["ended"]["kept"], true, "{job}");
    let over = json(&desk.good(desk.get("text?path=tanker.fdm")))["fingerprint"].clone();
    let asked = serde_json::json!({ "path": "tanker.fdm", "over": over, "result": "results/diagnose-1" });
    let done = json(&desk.good(desk.post("accept", &asked.to_string())));
    assert_eq!(desk.text("tanker.fdm"), desk.text("results/diagnose-1/extended.fdm"));
    assert!(desk.text("tanker.fdm").contains("phi^3"), "{}", desk.text("tanker.fdm"));
    // what was accepted once is not accepted over a text that has changed since
    assert_eq!(desk.post("accept", &asked.to_string()).0, 409);
    // the text that was diagnosed stands in the result: what was accepted is undone in any window, on any day
    let before = desk.good(desk.get("document?path=results/diagnose-1&name=model.fdm"));
    let back = serde_json::json!({ "path": "tanker.fdm", "text": before, "over": done });
    desk.good(desk.post("text", &back.to_string()));
    assert_eq!(desk.text("tanker.fdm"), MODEL);
    let page = desk.good(desk.get("result?path=results/diagnose-1"));
    assert!(page.starts_with("<!DOCTYPE html>") && page.contains("tanker"));
    let results = json(&desk.good(desk.get("state")))["results"].clone();
    assert_eq!((results.as_array().unwrap().len(), &results[0]["kind"]), (2, &"diagnosis".into()), "{results}");
}

/// Work that is stopped keeps the best so far.
#[test]
fn a_fit_that_is_stopped_keeps_the_best_so_far() {
    let desk = Desk::new();
    let id = desk.good(desk.post("work", r#"{ "verb": "fit", "words": ["--starts=500"] }"#));
    desk.good(desk.post("stop", &id));
    let begun = Instant::now();
    let job = loop {
        let job = json(&desk.good(desk.get("state")))["jobs"][0].clone();
        if !job["ended"].is_null() || begun.elapsed() > Duration::from_secs(60) {
            break job;
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    assert_eq!((&job["ended"]["good"], &job["ended"]["kept"]), (&false.into(), &true.into()), "{job}");
    assert!(desk.text("results/fit-1/result.json").contains("omega2"));
}

/// A repair of the doctor goes into the map, and the map into the project.
#[test]
fn a_repair_goes_into_the_map_of_the_project() {
    let desk = Desk::new();
    let mut rows = String::from("t [s],roll [deg]\n");
    (0..400).for_each(|k| {
        let angle = 200.0 * (0.02 * f64::from(k)).sin() + 170.0;
        rows.push_str(&format!("{:.2},{:.4}\n", 0.05 * f64::from(k), (angle + 180.0).rem_euclid(360.0) - 180.0));
    });
    fs::write(desk.folder.path().join("run.csv"), rows).unwrap();
    desk.work("doctor", &["--no-project", "--data=run.csv"]);
    let found = json(&desk.good(desk.get("doctor")));
    let findings = found["findings"].as_array().unwrap();
    let wrapped = findings.iter().position(|f| f["fault"] == "wrapped").unwrap_or_else(|| panic!("{found}"));
    assert_eq!(desk.good(desk.post("repair", &format!("[{wrapped}]"))), "\"map.toml\"");
    assert!(desk.text("map.toml").contains("wrap = 360"), "{}", desk.text("map.toml"));
    assert_eq!(desk.text("fdm.toml"), format!("{PROJECT}map = \"map.toml\"\n"));
}

/// Nobody without the token, from elsewhere, or with what is no request of a browser is answered, and no file changes.
#[test]
fn hostile_requests_are_refused_and_write_nothing() {
    let desk = Desk::new();
    let before = desk.all();
    let (token, host) = (desk.token().to_string(), desk.host.clone());
    let outside = desk.folder.path().parent().unwrap().join("fdm-studio-outside.fdm");
    let get = |path: &str, host: &str, more: &str| {
        desk.raw(format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n{more}\r\n").as_bytes()).0
    };
    let own = format!("/{token}/state");
    assert_eq!(get(&own, &host, ""), 200);
    for (path, of, more) in [
        ("/state", host.as_str(), ""),
        ("/", host.as_str(), ""),
        (&format!("/{}/state", "0".repeat(token.len())), host.as_str(), ""),
        (&own, "evil.example", ""),
        (&own, "evil.example:80", ""),
        (&own, host.as_str(), "Origin: http://evil.example\r\n"),
        (&own, host.as_str(), "Origin: null\r\n"),
        (&own, host.as_str(), "Sec-Fetch-Site: cross-site\r\n"),
        (&own, host.as_str(), &format!("Host: {host}\r\n")),
    ] {
        assert_eq!(get(path, of, more), 403, "{path} {of} {more}");
    }
    for path in [
        "../fdm-studio-outside.fdm",
        "/etc/passwd",
        "%2e%2e/x.fdm",
        "..%2fx",
        ".git/config",
        "a/../../x",
        "C:x",
        "a%5cb",
        "%00",
        "%ff",
    ] {
        for what in ["text", "record", "page", "result"] {
            let (status, body) = desk.get(&format!("{what}?path={path}"));
            assert!([400, 403, 404].contains(&status), "{what} {path}: {status} {}", String::from_utf8_lossy(&body));
        }
    }
    let text = |path: &str, over: &str| format!(r#"{{ "path": "{path}", "text": "x", "over": {over} }}"#);
    for (path, body, statuses) in [
        ("text", text("../fdm-studio-outside.fdm", "null"), &[403][..]),
        ("text", text("tanker.fdm", "null"), &[409]),
        ("text", text("tanker.fdm", "\"0\""), &[409]),
        ("text", text("new.sh", "null"), &[403]),
        ("text", "{".into(), &[400]),
        ("text", "[1, 2]".into(), &[400]),
        ("text", "\u{0}".into(), &[400]),
        ("drop?name=run.csv", "t,y\n0,1\n".into(), &[409]),
        ("drop?name=../fdm-studio-outside.fdm", "x".into(), &[403]),
        ("drop?name=run.exe", "x".into(), &[403]),
        ("project", r#"{ "key": "options", "values": ["x"] }"#.into(), &[400]),
        ("project", r#"{ "key": "data", "values": ["../../x.csv"] }"#.into(), &[403]),
        ("work", r#"{ "verb": "fit", "words": ["--checkpoint=x"] }"#.into(), &[400]),
        ("work", r#"{ "verb": "fit", "words": ["--data=/etc/passwd"] }"#.into(), &[403]),
        ("work", r#"{ "verb": "diagnose", "words": ["--out=../x"] }"#.into(), &[403]),
        ("work", r#"{ "verb": "job", "words": [] }"#.into(), &[400]),
        ("command", r#"{ "verb": "export", "words": ["--output=../x.c"] }"#.into(), &[403]),
        ("command", r#"{ "verb": "export", "words": ["--force"] }"#.into(), &[400]),
        ("command", r#"{ "verb": "fmt", "words": ["tanker.fdm"] }"#.into(), &[400]),
        ("repair", "[0]".into(), &[404]),
        ("stop", "99".into(), &[404]),
        ("nothing", "{}".into(), &[404]),
    ] {
        let (status, said) = desk.post(path, &body);
        assert!(statuses.contains(&status), "{path} {body}: {status} {}", String::from_utf8_lossy(&said));
    }
    let head = |method: &str, more: &str| format!("{method} /{token}/text HTTP/1.1\r\nHost: {host}\r\n{more}\r\n");
    for (bytes, status) in [
        (head("POST", "Content-Length: 99999999999\r\n"), 413),
        (head("POST", "Content-Length: -1\r\n"), 400),
        (head("POST", ""), 411),
        (head("POST", "Transfer-Encoding: chunked\r\nContent-Length: 3\r\n"), 411),
        (head("PUT", "Content-Length: 0\r\n"), 405),
        (head("DELETE", ""), 405),
        (head("GET", &format!("X: {}\r\n", "a".repeat(20_000))), 431),
        (head("GET", &"X: a\r\n".repeat(100)), 431),
        ("hello\r\n\r\n".into(), 400),
        (format!("GET {own} HTTP/1.1\r\n\r\n"), 403),
    ] {
        assert_eq!(desk.raw(bytes.as_bytes()).0, status, "{bytes:.200}");
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("/etc", desk.folder.path().join("etc")).unwrap();
        assert_eq!(desk.get("text?path=etc/passwd").0, 403);
        assert_eq!(desk.post("text", &text("etc/x.fdm", "null")).0, 403);
        fs::remove_file(desk.folder.path().join("etc")).unwrap();
    }
    assert!(desk.all() == before && !outside.exists());
}

/// 500 requests from tables: paths that lead out, methods, names of this machine, heads and bodies that are too long, cut off, or slow.
#[test]
fn five_hundred_hostile_requests_are_refused_and_write_nothing() {
    let desk = Desk::new();
    let (token, host) = (desk.token().to_string(), desk.host.clone());
    let before = desk.all();
    let good = |method: &str, path: &str, body: &str| {
        format!("{method} /{token}/{path} HTTP/1.1\r\nHost: {host}\r\nContent-Length: {}\r\n\r\n{body}", body.len())
    };
    let mut requests: Vec<Vec<u8>> = Vec::new();
    let mut add = |request: String| requests.push(request.into_bytes());
    let outside = [
        "..",
        "../x.fdm",
        "../../../etc/passwd",
        "a/../../x.fdm",
        "./../x.fdm",
        "/etc/passwd",
        "/tmp/x.fdm",
        "//etc/passwd",
        "\\\\x",
        "C:x.fdm",
        "C:/x.fdm",
        ".git/config",
        ".x.fdm",
        "a/.x/y.fdm",
        "~/x.fdm:",
        "x.fdm\u{0}.csv",
        "..\\x.fdm",
        "results/../../x.fdm",
        "\u{0}",
        "....//x.sh",
        "x.sh",
        "x",
        "",
    ];
    let encoded = |text: &str| text.bytes().map(|b| format!("%{b:02x}")).collect::<String>();
    for path in outside {
        for what in ["text", "record", "page", "result", "document", "samples", "changes"] {
            add(good("GET", &format!("{what}?path={}&name=x&topic=0&field=0&then=x&now=x", encoded(path)), ""));
            add(good("GET", &format!("{what}/{}", encoded(path)), ""));
        }
        let told =
            |key: &str| serde_json::json!({ "key": "model", "values": [path], key: path, "text": "x", "over": null });
        add(good("POST", &format!("drop?name={}", encoded(path)), "x"));
        for (what, key) in [("text", "path"), ("accept", "path"), ("work", "verb"), ("command", "verb")] {
            add(good("POST", what, &told(key).to_string()));
        }
    }
    let leads_out = |path: &&str| path.starts_with('/') || path.split(['/', '\\']).any(|part| part == "..");
    for path in outside.into_iter().filter(leads_out) {
        add(good("POST", "work", &serde_json::json!({ "verb": "fit", "words": [path] }).to_string()));
        add(good(
            "POST",
            "command",
            &serde_json::json!({ "verb": "export", "words": [format!("--output={path}")] }).to_string(),
        ));
    }
    for method in ["PUT", "DELETE", "PATCH", "OPTIONS", "HEAD", "TRACE", "CONNECT", "get", "GETT", "PROPFIND"] {
        for path in ["", "state", "text", "events", "studio.js"] {
            add(good(method, path, ""));
        }
    }
    let state = format!("GET /{token}/state HTTP/1.1\r\n");
    for name in ["evil.example", "0.0.0.0", "[::1]", "127.0.0.1", "localhost", "127.0.0.1:1", "user@127.0.0.1", ""] {
        add(format!("{state}Host: {name}\r\n\r\n"));
        for more in [
            format!("Origin: http://{name}"),
            format!("Origin: https://{host}{name}x"),
            "Sec-Fetch-Site: same-site".into(),
        ] {
            add(format!("{state}Host: {host}\r\n{more}\r\n\r\n"));
        }
    }
    for k in 0..token.len() {
        add(good("GET", "state", "").replacen(&token, &token[..k], 1));
        let other = if token.as_bytes()[k] == b'0' { "1" } else { "0" };
        add(good("GET", "state", "").replacen(&token, &format!("{}{other}{}", &token[..k], &token[k + 1..]), 1));
    }
    for length in ["99999999999", "18446744073709551616", "-1", "1e3", "0x10", "", "1, 1"] {
        add(format!("POST /{token}/text HTTP/1.1\r\nHost: {host}\r\nContent-Length: {length}\r\n\r\n"));
    }
    let whole = good("POST", "project", r#"{ "key": "map", "values": ["map.toml"] }"#);
    (1..whole.len()).step_by(2).for_each(|k| add(whole[..k].to_string()));
    add(format!("{state}Host: {host}\r\nX: {}\r\n\r\n", "a".repeat(100_000)));
    add(format!("{state}Host: {host}\r\n{}\r\n", "X: a\r\n".repeat(1000)));
    add("\u{0}".repeat(1000));
    // whoever says a byte and no more is not waited for, and keeps nobody waiting
    let mut slow: Vec<TcpStream> = (0..20).map(|_| TcpStream::connect(&desk.host).unwrap()).collect();
    slow.iter_mut().for_each(|stream| stream.write_all(b"G").unwrap());
    for request in &requests {
        let (status, said) = desk.cut(request);
        let what = String::from_utf8_lossy(&request[..request.len().min(300)]).into_owned();
        assert!((400..500).contains(&status), "{what}: {status} {:.300}", String::from_utf8_lossy(&said));
    }
    for mut stream in slow {
        let mut answer = String::new();
        let _ = stream.read_to_string(&mut answer);
        assert!(!answer.contains(" 200 "), "{answer}");
    }
    assert!(requests.len() >= 500, "{} requests", requests.len());
    assert!(desk.all() == before);
}

/// A second window hears what the first one does.
#[test]
fn a_second_window_follows() {
    let desk = Desk::new();
    let mut stream = TcpStream::connect(&desk.host).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    write!(stream, "GET /{}/events HTTP/1.1\r\nHost: {}\r\n\r\n", desk.token(), desk.host).unwrap();
    let mut heard = String::new();
    let mut until = |what: &str| {
        let mut part = [0; 4096];
        while !heard.contains(what) {
            let count = stream.read(&mut part).unwrap();
            assert!(count > 0, "{what} is missing in {heard}");
            heard.push_str(&String::from_utf8_lossy(&part[..count]));
        }
    };
    until("\"model\":\"tanker.fdm\"");
    desk.good(desk.post("project", r#"{ "key": "model", "values": ["other.fdm"] }"#));
    until("\"model\":\"other.fdm\"");
    fs::write(desk.folder.path().join("other.fdm"), "model m { }").unwrap();
    until("\"path\":\"other.fdm\"");
}
