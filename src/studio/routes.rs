//! What can be asked of the server, and who answers it.

use crate::folder::{Listed, PROJECT, Project, RESULTS, Setting, Written};
use crate::http::{Answer, Refusal, Request, Status, head};
use crate::jobs::{Asked, Jobs, Shown, completed, is_result, typed};
use crate::results::{MODEL, Seen, changes};
use crate::{Finding, Place, Studio, live};
use fdm_grammar::Source;
use fdm_report::page::{Subject, page, style, typeset};
use fdm_results::store::{fingerprint, whole_files};
use fdm_session::{NamedFile, request};
use fdm_system::Model;
use fdm_system::record::{Log, open_log};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::net::TcpStream;
use std::process::Command;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The page and its parts.
const PARTS: [(&str, &str, &str); 7] = [
    ("", "text/html", include_str!("page/index.html")),
    ("studio.css", "text/css", include_str!("page/studio.css")),
    ("studio.js", "text/javascript", include_str!("page/studio.js")),
    ("ask.js", "text/javascript", include_str!("page/ask.js")),
    ("plot.js", "text/javascript", include_str!("page/plot.js")),
    ("editor.js", "text/javascript", include_str!("page/editor.js")),
    ("views.js", "text/javascript", include_str!("page/views.js")),
];
/// Scripts, styles and connections of this server only.
const POLICY: &str = "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; img-src 'self' data:; font-src data:; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'\r\n";
/// Time between two looks at the folder for events, and at work that goes on.
const LOOK: Duration = Duration::from_millis(1000);
const LOOK_AT_WORK: Duration = Duration::from_millis(100);
/// A window that has gone is noticed by what is sent to it, at the latest after this time.
const ALIVE: Duration = Duration::from_secs(15);
/// Verbs that only print, or write where they are told.
const PRINTING: [&str; 10] =
    ["new", "compare", "report", "export", "extend", "validate", "spectra", "modes", "effects", "check"];
/// Options that are typed in a terminal only.
const TYPED_ONLY: [&str; 2] = ["--force", "--allow-units"];

/// Everything that windows show.
#[derive(Serialize)]
struct State {
    name: String,
    project: Project,
    files: Vec<Listed>,
    results: Vec<Seen>,
    jobs: Vec<Shown>,
    /// Whether commands are run.
    program: bool,
}

/// The record that was looked at last.
#[derive(Default)]
pub(crate) struct Records(Mutex<Option<(String, Arc<Opened>)>>);

/// A record, and what was assumed while it was read.
pub(crate) struct Opened {
    log: Log,
    notes: Vec<String>,
}

/// What is in a record.
#[derive(Serialize)]
struct Contents {
    topics: Vec<TopicSeen>,
    notes: Vec<String>,
}

#[derive(Serialize)]
struct TopicSeen {
    name: String,
    rows: usize,
    /// The field with the time.
    time: Option<usize>,
    fields: Vec<FieldSeen>,
}

#[derive(Serialize)]
struct FieldSeen {
    name: String,
    unit: Option<String>,
    /// Whether it holds texts.
    texts: bool,
}

#[derive(Deserialize)]
struct Checked {
    path: String,
    text: String,
}

/// What is said of a text.
#[derive(Serialize)]
struct Said {
    findings: Vec<Finding>,
    /// MathML; none while the text cannot be read.
    equations: Option<String>,
}

/// A text, and a place in it.
#[derive(Deserialize)]
struct Typed {
    text: String,
    place: Place,
}

#[derive(Deserialize)]
struct Accepted {
    path: String,
    /// The fingerprint of the text that it takes the place of.
    over: String,
    /// The diagnosis whose extended text is taken.
    result: Option<String>,
    /// An effect at its place.
    effect: Option<String>,
}

#[derive(Serialize)]
struct Ran {
    command: String,
    good: bool,
    text: String,
}

/// Answers a request; none where the answer was sent already.
pub(crate) fn answer(
    studio: &Arc<Studio>,
    request: &Request,
    stream: &mut TcpStream,
) -> Result<Option<Answer>, Refusal> {
    let path: Vec<&str> = request.path.iter().map(String::as_str).collect();
    let answer = match (request.method.as_str(), &path[..]) {
        ("GET", ["events"]) => return events(studio, stream).map(|()| None),
        ("GET", ["state"]) => Answer::json(&state(studio)),
        ("GET", ["report.css"]) => Answer::of("text/css", style()),
        ("GET", ["text"]) => Answer::json(&studio.folder.text(request.asked("path")?)?),
        ("GET", ["record"]) => record(studio, request.asked("path")?)?,
        ("GET", ["samples"]) => samples(studio, request)?,
        ("GET", ["result"]) => result(studio, request.asked("path")?)?,
        ("GET", ["document"]) => document(studio, request)?,
        ("GET", ["page"]) => written_page(studio, request.asked("path")?)?,
        ("GET", ["changes"]) => {
            let place = |name| is_result(&studio.folder, request.asked(name)?);
            Answer::json(&changes(&place("then")?, &place("now")?).map_err(Refusal::wrong)?)
        }
        ("GET", ["doctor"]) => doctor(studio)?,
        ("GET", [part]) => {
            let found = PARTS.iter().find(|(name, ..)| name == part);
            let (_, kind, text) = found.ok_or_else(nothing)?;
            let body = text.as_bytes();
            let length = format!("{POLICY}Content-Length: {}\r\n", body.len());
            stream.write_all(&[head(Status::Good, kind, &length).as_bytes(), body].concat())?;
            return Ok(None);
        }
        ("POST", ["text"]) => Answer::json(&studio.folder.write(&request.told::<Written>()?)?),
        ("POST", ["drop"]) => {
            studio.folder.add(request.asked("name")?, &request.body)?;
            Answer::text("")
        }
        ("POST", ["project"]) => {
            studio.folder.set(&request.told::<Setting>()?)?;
            Answer::text("")
        }
        ("POST", ["check"]) => check(studio, &request.told()?)?,
        ("POST", ["suggestions"]) => {
            let Typed { text, place } = request.told()?;
            Answer::json(&(studio.doors.language.suggestions)(&text, place))
        }
        ("POST", ["explained"]) => {
            let Typed { text, place } = request.told()?;
            Answer::json(&(studio.doors.language.explained)(&text, place))
        }
        ("POST", ["work"]) => Answer::json(&Jobs::begin(studio, &request.told::<Asked>()?)?),
        ("POST", ["stop"]) => {
            studio.jobs.stop(request.told()?)?;
            Answer::text("")
        }
        ("POST", ["simulate"]) => simulate(studio, request.told()?)?,
        ("POST", ["repair"]) => repair(studio, &request.told::<Vec<usize>>()?)?,
        ("POST", ["accept"]) => accept(studio, &request.told()?)?,
        ("POST", ["command"]) => command(studio, &request.told::<Asked>()?)?,
        ("GET" | "POST", _) => return Err(nothing()),
        _ => return Err(Refusal::new(Status::Method, "GET and POST are answered")),
    };
    Ok(Some(answer))
}

fn nothing() -> Refusal {
    Refusal::new(Status::NotFound, "there is nothing here")
}

fn state(studio: &Studio) -> State {
    let files = studio.folder.files();
    State {
        name: studio.folder.name(),
        project: studio.folder.project(),
        results: studio.results.seen(&studio.folder, &files),
        files,
        jobs: studio.jobs.shown(),
        program: studio.doors.program.is_some(),
    }
}

/// Sends the state whenever it is another, until the window has gone: whoever comes late or again knows all.
fn events(studio: &Studio, stream: &mut TcpStream) -> Result<(), Refusal> {
    stream.write_all(head(Status::Good, "text/event-stream", "").as_bytes())?;
    let (mut sent, mut last, mut looked) = (String::new(), Instant::now(), None::<Instant>);
    let mut at_work = false;
    loop {
        if looked.is_none_or(|at| at.elapsed() >= LOOK) || at_work || studio.jobs.any_at_work() {
            at_work = studio.jobs.any_at_work();
            let now = serde_json::to_string(&state(studio)).unwrap_or_default();
            looked = Some(Instant::now());
            if now != sent {
                stream.write_all(format!("data: {now}\n\n").as_bytes())?;
                (sent, last) = (now, Instant::now());
            }
        }
        if last.elapsed() > ALIVE {
            stream.write_all(b": still here\n\n")?;
            last = Instant::now();
        }
        std::thread::sleep(LOOK_AT_WORK);
    }
}

/// The record, read once as long as it stays the same.
fn opened(studio: &Studio, path: &str) -> Result<Arc<Opened>, Refusal> {
    let place = studio.folder.place(path)?;
    let about = std::fs::metadata(&place)?;
    let key = format!("{path} {} {:?}", about.len(), about.modified().ok());
    let mut kept = studio.records.0.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((own, opened)) = kept.as_ref().filter(|(own, _)| *own == key) {
        let _ = own;
        return Ok(Arc::clone(opened));
    }
    let (log, notes) = open_log(&place, true, None).map_err(|e| Refusal::wrong(e.to_string()))?;
    let opened = Arc::new(Opened { log, notes: notes.iter().map(ToString::to_string).collect() });
    *kept = Some((key, Arc::clone(&opened)));
    Ok(opened)
}

fn record(studio: &Studio, path: &str) -> Result<Answer, Refusal> {
    let opened = opened(studio, path)?;
    let topics = opened.log.topics.iter().map(|topic| TopicSeen {
        name: topic.name.clone(),
        rows: topic.rows(),
        time: topic.time,
        fields: topic
            .fields
            .iter()
            .map(|f| FieldSeen { name: f.name.clone(), unit: f.unit.clone(), texts: f.values.is_empty() })
            .collect(),
    });
    Ok(Answer::json(&Contents { topics: topics.collect(), notes: opened.notes.clone() }))
}

/// The numbers of one field, each as eight bytes, the lowest first.
fn samples(studio: &Studio, request: &Request) -> Result<Answer, Refusal> {
    let opened = opened(studio, request.asked("path")?)?;
    let number =
        |name| request.asked(name)?.parse::<usize>().map_err(|_| Refusal::wrong(format!("{name} is no number")));
    let topic = opened.log.topics.get(number("topic")?).ok_or_else(nothing)?;
    let field = topic.fields.get(number("field")?).ok_or_else(nothing)?;
    let bytes: Vec<u8> = field.values.iter().flat_map(|v| v.to_le_bytes()).collect();
    Ok(Answer::of("application/octet-stream", bytes))
}

/// The files of a result.
fn files_of(studio: &Studio, path: &str) -> Result<Vec<NamedFile>, Refusal> {
    whole_files(&is_result(&studio.folder, path)?).map_err(|e| Refusal::wrong(e.to_string()))
}

/// The page of a result, as `fdm report` writes it.
fn result(studio: &Studio, path: &str) -> Result<Answer, Refusal> {
    let files = files_of(studio, path)?;
    let subject = Subject::from_files(&files).map_err(|e| Refusal::wrong(e.to_string()))?;
    Ok(Answer::of("text/html", page(&subject)))
}

/// A document of a result, as its folder has it.
fn document(studio: &Studio, request: &Request) -> Result<Answer, Refusal> {
    let (files, name) = (files_of(studio, request.asked("path")?)?, request.asked("name")?);
    let found = files.into_iter().find(|(own, _)| own == name).ok_or_else(nothing)?;
    Ok(Answer::text(found.1))
}

/// A page that a command wrote.
fn written_page(studio: &Studio, path: &str) -> Result<Answer, Refusal> {
    let place = studio.folder.place(path)?;
    if !path.ends_with(".html") {
        return Err(Refusal::new(Status::Forbidden, "pages (.html) are shown here"));
    }
    Ok(Answer::of("text/html", std::fs::read(place)?))
}

/// What is wrong with a text, and its equations.
fn check(studio: &Studio, asked: &Checked) -> Result<Answer, Refusal> {
    let place = studio.folder.place(&asked.path)?.display().to_string();
    let findings = (studio.doors.language.findings)(&place, &asked.text);
    Ok(Answer::json(&Said { findings, equations: typeset(&Source::new(place, asked.text.as_str())) }))
}

fn simulate(studio: &Studio, asked: live::Asked) -> Result<Answer, Refusal> {
    let files = studio.folder.files();
    let stamp: String = files.iter().filter(|f| !f.path.starts_with(RESULTS)).map(|f| f.stamp.as_str()).collect();
    let words = {
        // a slider asks many times between two changes of the project
        let mut kept = studio.simulated.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.0 != stamp {
            let words = completed(&studio.doors.completed, &["fdm", "simulate"])?;
            *kept = (stamp.clone(), words.into_iter().skip(2).collect());
        }
        kept.1.clone()
    };
    Ok(Answer::of("application/octet-stream", studio.live.respond(words, stamp, asked)?))
}

/// What the doctor found last.
fn doctor(studio: &Studio) -> Result<Answer, Refusal> {
    let judged = studio.jobs.judged.lock().unwrap_or_else(PoisonError::into_inner);
    let (_, judged) = judged.as_ref().ok_or_else(nothing)?;
    let wanted = fdm_session::Wanted { json: true, ..Default::default() };
    Ok(Answer::of("application/json", judged.answer(wanted)?.json.unwrap_or_default()))
}

/// Puts repairs of what the doctor found last into the map of the project.
fn repair(studio: &Studio, chosen: &[usize]) -> Result<Answer, Refusal> {
    let judged = studio.jobs.judged.lock().unwrap_or_else(PoisonError::into_inner);
    let (options, judged) = judged.as_ref().ok_or_else(nothing)?;
    let text = options.map_of(judged, |k, _| chosen.contains(&k));
    let own = studio.folder.project().map.filter(|map| map.ends_with(".toml") && map != PROJECT);
    let path = own.unwrap_or_else(|| "map.toml".into());
    let over = studio.folder.text(&path).ok().map(|now| now.fingerprint);
    studio.folder.write(&Written { path: path.clone(), text, over })?;
    studio.folder.set(&Setting::of("map", &path))?;
    Ok(Answer::json(&path))
}

/// Writes what a diagnosis found, or one effect, into the text of the model.
fn accept(studio: &Studio, asked: &Accepted) -> Result<Answer, Refusal> {
    let before = studio.folder.text(&asked.path)?;
    let new = match (&asked.result, &asked.effect) {
        (_, Some(effect)) => {
            let place = studio.folder.place(&asked.path)?.display().to_string();
            let model = Model::from_text(place, before.text.as_str()).map_err(|e| Refusal::wrong(e.to_string()))?;
            request::extend(&model, &[format!("--effect={effect}")])?.0
        }
        (Some(result), None) => {
            let files = files_of(studio, result)?;
            let of = |name: &str| files.iter().find(|(own, _)| own == name).map(|(_, bytes)| bytes);
            if of(MODEL).map(|bytes| fingerprint(bytes)).as_ref() != Some(&before.fingerprint) {
                let said = "the model has changed since this diagnosis: diagnose it again";
                return Err(Refusal::new(Status::Conflict, said));
            }
            let extended = of("extended.fdm").ok_or_else(|| Refusal::wrong("the diagnosis accepted no effect"))?;
            String::from_utf8_lossy(extended).into_owned()
        }
        (None, None) => return Err(Refusal::wrong("say which diagnosis, or which effect")),
    };
    let written = Written { path: asked.path.clone(), text: new, over: Some(asked.over.clone()) };
    Ok(Answer::json(&studio.folder.write(&written)?))
}

/// Runs a command of the program that prints, or writes where it is told.
fn command(studio: &Studio, asked: &Asked) -> Result<Answer, Refusal> {
    let Asked { verb, words } = asked;
    studio.folder.refuse_outside(words)?;
    if !PRINTING.contains(&verb.as_str()) || words.iter().any(|w| TYPED_ONLY.iter().any(|o| w.starts_with(o))) {
        return Err(Refusal::wrong(format!("{verb}: this command is typed in a terminal")));
    }
    let none = || Refusal::wrong("there is no program that could run it");
    let program = studio.doors.program.as_ref().ok_or_else(none)?;
    let whole: Vec<String> = ["fdm", verb].iter().map(ToString::to_string).chain(words.iter().cloned()).collect();
    let with_project = (studio.doors.completed)(whole.clone())?;
    let mut command = Command::new(program);
    command.args(with_project.iter().skip(1)).arg("--no-project").current_dir(studio.folder.home());
    let output = command.output()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    Ok(Answer::json(&Ran { command: typed(&whole), good: output.status.success(), text }))
}
