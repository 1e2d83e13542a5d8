//! Responses at other values, as fast as a slider is moved: model, runs and simulators stay in a thread of their own between requests.

use crate::http::Refusal;
use fdm_session::failure::Failure;
use fdm_session::request::parsed;
use fdm_session::simulate::{Options, Repeated, Subject, respond};
use fdm_system::record::Run;
use serde::{Deserialize, Serialize};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Mutex, PoisonError};

/// What is asked for.
#[derive(Debug, Deserialize)]
pub(crate) struct Asked {
    /// The run, by its number.
    run: usize,
    /// Other values of parameters.
    set: Vec<(String, f64)>,
    /// Whether the numbers are those of `fdm simulate`; else steps are those of the first values, short enough for a drawing.
    #[serde(default)]
    exact: bool,
    /// Whether the samples of the run are wanted too.
    #[serde(default)]
    measured: bool,
}

/// What is told beside the numbers.
#[derive(Debug, Serialize, Default)]
pub(crate) struct Told {
    /// Names of all runs.
    runs: Vec<String>,
    /// The columns that follow, each of so many numbers.
    columns: Vec<Column>,
    params: Vec<Param>,
    /// Unit of time.
    time: String,
    /// What makes the numbers wrong.
    faults: Vec<String>,
}

#[derive(Debug, Serialize)]
struct Column {
    /// `t`, or the name of a signal.
    name: String,
    /// `time`, `input`, `measured` or `model`.
    kind: &'static str,
    unit: Option<String>,
    length: usize,
}

#[derive(Debug, Serialize)]
struct Param {
    name: String,
    doc: String,
    unit: Option<String>,
    value: f64,
    /// None where there is no bound.
    lower: Option<f64>,
    upper: Option<f64>,
    fixed: bool,
    per_run: bool,
    log: bool,
}

/// What is drawn is right to a thousandth of its range: no figure has more pixels for an output.
const DRAWN: &str = "--integration-accuracy=1e-3";

/// A question to the thread.
struct Question {
    /// The words of `fdm simulate` with what the project adds, behind the verb.
    words: Vec<String>,
    /// Changes when a file does.
    stamp: String,
    asked: Asked,
    answer: SyncSender<Result<Vec<u8>, String>>,
}

/// The thread.
#[derive(Default)]
pub(crate) struct Live(Mutex<Option<SyncSender<Question>>>);

impl Live {
    /// The response, as a document and the numbers behind it.
    pub(crate) fn respond(&self, words: Vec<String>, stamp: String, asked: Asked) -> Result<Vec<u8>, Refusal> {
        if asked.exact {
            return exact(&words, &asked).map_err(|e| Refusal::wrong(e.to_string()));
        }
        let gone = || Refusal::wrong("the simulation has ended");
        let (answer, heard) = sync_channel(1);
        let to = {
            let mut own = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            match &*own {
                Some(to) => to.clone(),
                None => {
                    let (to, from) = sync_channel(1);
                    std::thread::Builder::new().name("simulation".into()).spawn(move || serve(&from))?;
                    own.insert(to).clone()
                }
            }
        };
        to.send(Question { words, stamp, asked, answer }).map_err(|_| gone())?;
        heard.recv().map_err(|_| gone())?.map_err(Refusal::wrong)
    }
}

/// Answers as long as somebody may ask; what was made for one state of the files serves all questions about it.
fn serve(from: &Receiver<Question>) {
    let mut next = from.recv().ok();
    while let Some(question) = next.take() {
        let drawn = || parsed::<Options>(&[], &[&question.words[..], &[DRAWN.into()]].concat());
        // beside steps that were typed there is no other accuracy
        let options = drawn().or_else(|_| parsed::<Options>(&[], &question.words));
        let subject = options.and_then(|options| Ok((options.subject()?, options)));
        match subject {
            Ok((subject, options)) => next = serve_one(from, question, &subject, &options),
            Err(e) => {
                let _ = question.answer.send(Err(e.to_string()));
                next = from.recv().ok();
            }
        }
    }
}

/// Answers questions about one state of the files; gives back the first that is about another.
fn serve_one(from: &Receiver<Question>, first: Question, subject: &Subject, options: &Options) -> Option<Question> {
    let (words, stamp) = (first.words.clone(), first.stamp.clone());
    let mut simulators: Vec<Option<Repeated<'_>>> = subject.runs.iter().map(|_| None).collect();
    let mut next = Some(first);
    loop {
        let question = next.take().or_else(|| from.recv().ok())?;
        if question.words != words || question.stamp != stamp {
            return Some(question);
        }
        let found = answered(subject, options, &mut simulators, &question.asked);
        // a window that has gone hears nothing
        let _ = question.answer.send(found.map_err(|e| e.to_string()));
    }
}

fn answered<'s>(
    subject: &'s Subject,
    options: &Options,
    simulators: &mut [Option<Repeated<'s>>],
    asked: &Asked,
) -> Result<Vec<u8>, Failure> {
    let Subject { model, folder, .. } = subject;
    let (run, kept) = (run(subject, asked)?, &mut simulators[asked.run]);
    let kept = match kept {
        Some(kept) => kept,
        None => kept.insert(Repeated::new(model, run, folder.as_ref(), options)?),
    };
    let (mut y, mut faults) = (Vec::new(), Vec::new());
    if let Err(d) = kept.respond(&asked.set, &mut y) {
        faults.push(format!("the response diverges at time {}", d.time));
    }
    Ok(told((subject, run), (&y, faults), kept.theta(), asked))
}

/// As the command says it.
fn exact(words: &[String], asked: &Asked) -> Result<Vec<u8>, Failure> {
    let subject = parsed::<Options>(&[], words)?.subject()?;
    let run = run(&subject, asked)?;
    let set = asked.set.iter().map(|(name, value)| format!("--set={name}={value}"));
    let options: Options = parsed(&[], &words.iter().cloned().chain(set).collect::<Vec<_>>())?;
    let model = options.model.changed(&subject.model)?;
    let response = respond(&model, run, subject.folder.as_ref(), &options)?;
    let faults = response.faults(&model);
    Ok(told((&subject, run), (&response.y, faults), &[], asked))
}

fn run<'s>(subject: &'s Subject, asked: &Asked) -> Result<&'s Run, Failure> {
    subject.runs.get(asked.run).ok_or_else(|| Failure::input([format!("there is no run {}", asked.run + 1)]))
}

/// A response (N by q) as it goes to the page, beside the record and the parameters at these values where they are wanted.
fn told((subject, run): (&Subject, &Run), (y, faults): (&[f64], Vec<String>), theta: &[f64], asked: &Asked) -> Vec<u8> {
    let Subject { model, runs, .. } = subject;
    let definition = model.definition();
    let mut told = Told { runs: runs.iter().map(|r| r.name.clone()).collect(), faults, ..Told::default() };
    told.time = definition.time.to_string();
    let mut numbers: Vec<f64> = Vec::new();
    let outputs: Vec<_> = definition.outputs.iter().map(|o| &o.quantity).collect();
    let mut put = |kind, quantities: &[&fdm_grammar::model::Quantity], rows: &[f64], told: &mut Told| {
        for (k, quantity) in quantities.iter().enumerate() {
            let unit = quantity.unit.as_ref().map(ToString::to_string);
            let before = numbers.len();
            numbers.extend(rows.iter().skip(k).step_by(width(rows, run)));
            told.columns.push(Column { name: quantity.name.clone(), kind, unit, length: numbers.len() - before });
        }
    };
    put("model", &outputs, y, &mut told);
    if asked.measured {
        put("measured", &outputs, &run.measured, &mut told);
        let inputs: Vec<_> = definition.inputs.iter().map(|i| &i.quantity).collect();
        put("input", &inputs[..inputs.len().min(run.held.len())], &run.inputs, &mut told);
        numbers.extend(&run.time);
        let unit = Some(told.time.clone());
        told.columns.push(Column { name: "t".into(), kind: "time", unit, length: run.len() });
        let all = definition.params.iter().zip(theta).filter(|(p, _)| !p.is_recorded());
        told.params = all.map(|(p, value)| param(p, *value)).collect();
    }
    packed(&told, &numbers)
}

/// Signals in a row of samples.
fn width(rows: &[f64], run: &Run) -> usize {
    (rows.len() / run.len().max(1)).max(1)
}

/// A parameter, and its value where nothing else is asked for.
fn param(p: &fdm_grammar::model::Param, value: f64) -> Param {
    let finite = |v: f64| v.is_finite().then_some(v);
    Param {
        name: p.quantity.name.clone(),
        doc: p.quantity.doc.clone(),
        unit: p.quantity.unit.as_ref().map(ToString::to_string),
        value,
        lower: finite(p.lower),
        upper: finite(p.upper),
        fixed: p.fixed,
        per_run: p.per_run,
        log: p.logarithmic,
    }
}

/// A document and numbers: the length of the document in bytes as four bytes, the document, spaces up to a multiple of eight bytes, the
/// numbers; all with the lowest byte first.
fn packed(document: &impl Serialize, numbers: &[f64]) -> Vec<u8> {
    let mut text = serde_json::to_vec(document).unwrap_or_default();
    text.resize((text.len() + 4).next_multiple_of(8) - 4, b' ');
    let mut bytes = (text.len() as u32).to_le_bytes().to_vec();
    bytes.append(&mut text);
    bytes.extend(numbers.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}
