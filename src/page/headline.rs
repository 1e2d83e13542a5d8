//! What a reader must know who reads nothing else: how it ended, whether it can be trusted, and what speaks against it.

use super::number::{shown, text};
use super::subject::{Subject, list};
use super::{diagnosis, progress, regression, study};
use maud::{Markup, html};
use serde_json::Value;

/// Points that stand at the top.
const FIRST: usize = 4;

/// How far a result can be relied on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trust {
    Good,
    Reserved,
    Bad,
    /// Nobody knows yet.
    Open,
}

impl Trust {
    fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Reserved => "reserved",
            Self::Bad => "bad",
            Self::Open => "working",
        }
    }

    fn sign(self) -> &'static str {
        match self {
            Self::Good => "✓",
            Self::Reserved => "!",
            Self::Bad => "✗",
            Self::Open => "…",
        }
    }
}

/// What kind of result it is.
pub(super) fn kind(subject: &Subject) -> &'static str {
    let result = &subject.result;
    match () {
        () if subject.progress.is_some() => "at work",
        () if result["study"].is_object() => "study",
        () if subject.diagnosis.is_some() => "diagnosis",
        () if result["fits"].is_array() => "equation error",
        () if result["validation"].is_object() => "validation",
        () if result["frequency_domain"].is_object() => "fit of spectra",
        () if result["frequency_responses"].is_object() => "fit of frequency responses",
        () => "fit",
    }
}

/// What the model says of itself.
pub(super) fn doc(subject: &Subject) -> Option<&str> {
    Some(subject.tree.as_ref()?.doc.as_ref()?.text.as_str()).filter(|d| !d.is_empty())
}

/// The headline with what speaks against the result; links lead to the sections that the page has.
pub(super) fn verdict(subject: &Subject, anchors: &[&str]) -> Markup {
    let (trust, sentence, points) = match (&subject.progress, &subject.diagnosis) {
        (Some(told), _) => progress::verdict(told, &subject.result),
        (None, Some(found)) => diagnosis::verdict(found),
        (None, None) if subject.result["study"].is_object() => {
            let (trust, sentence, mut points) = study::verdict(&subject.result["study"]);
            points.extend(remarks(subject));
            (trust, sentence, points)
        }
        (None, None) if subject.result["fits"].is_array() => regression::verdict(&subject.result),
        (None, None) => {
            let (trust, sentence) = judged(subject);
            (trust, sentence, remarks(subject))
        }
    };
    let one = |(sentence, anchor): &(String, &'static str)| {
        html! { li { @if anchors.contains(anchor) { a href={ "#" (anchor) } { (quoted(sentence)) } } @else { (quoted(sentence)) } } }
    };
    html! {
        div class={ "verdict " (trust.word()) } role="status" {
            p.sentence { span.sign aria-hidden="true" { (trust.sign()) } (sentence) }
            @if let Some(facts) = facts(subject) { p.facts { (facts) } }
            @if !points.is_empty() {
                ol { @for point in points.iter().take(FIRST) { (one(point)) } }
            }
            @if points.len() > FIRST {
                details {
                    summary { (points.len() - FIRST) " more" }
                    ul { @for point in &points[FIRST..] { (one(point)) } }
                }
            }
        }
    }
}

/// What stands between backticks is a name.
pub(super) fn quoted(sentence: &str) -> Markup {
    html! { @for (k, part) in sentence.split('`').enumerate() { @if k % 2 == 1 { code { (part) } } @else { (part) } } }
}

/// What speaks against a result, the heaviest first, each with the section that shows it.
fn remarks(subject: &Subject) -> Vec<(String, &'static str)> {
    let mut remarks: Vec<&Value> = subject.list("remarks").iter().collect();
    remarks.sort_by_key(|r| weight(r["about"].as_str().unwrap_or_default()).0);
    let one = |r: &&Value| {
        (capital(r["sentence"].as_str().unwrap_or_default()), weight(r["about"].as_str().unwrap_or_default()).1)
    };
    remarks.iter().map(one).collect()
}

fn judged(subject: &Subject) -> (Trust, String) {
    let result = &subject.result;
    let what = if result["validation"].is_object() { "The validation" } else { "The fit" };
    let message = result["message"].as_str().unwrap_or("it is not said how it ended");
    let about = |word: &str| subject.list("remarks").iter().filter(|r| r["about"] == word).count();
    if result["termination"] != "converged" {
        return (Trust::Bad, format!("{what} did not end well: {message}."));
    }
    if !subject.list("undetermined").is_empty() {
        let said = format!(
            "{what} converged, but the data do not determine every parameter: errors and values below hold only where they are shown."
        );
        return (Trust::Bad, said);
    }
    match (about("bound"), subject.list("remarks").len()) {
        (0, 0) => (Trust::Good, format!("{what} converged, and nothing speaks against the result.")),
        (0, 1) => {
            (Trust::Reserved, format!("{what} converged. One thing should be known before the numbers are used:"))
        }
        (0, _) => (Trust::Reserved, format!("{what} converged. What should be known before the numbers are used:")),
        (1, _) => (Trust::Reserved, format!("{what} converged with a parameter at its bound.")),
        (n, _) => (Trust::Reserved, format!("{what} converged with {n} parameters at their bounds.")),
    }
}

/// How much was fitted to how much, and which output is matched worst.
fn facts(subject: &Subject) -> Option<String> {
    let estimated = |p: &&Value| p["standard_error"].is_number();
    let parameters = subject.list("parameters").iter().filter(estimated).count();
    let outputs = match list(&subject.result["time_domain"]["outputs"]) {
        [] => subject.list("outputs"),
        found => found,
    };
    let mut runs: Vec<&str> = outputs.iter().filter_map(|o| o["run"].as_str()).collect();
    runs.sort_unstable();
    runs.dedup();
    let compared: u64 = outputs.iter().filter_map(|o| o["compared"].as_u64()).sum();
    let worst = outputs.iter().filter(|o| o["r2"].is_number());
    let worst = worst.min_by(|a, b| number(&a["r2"]).total_cmp(&number(&b["r2"])))?;
    let place =
        if runs.len() > 1 { format!(" in {}", worst["run"].as_str().unwrap_or_default()) } else { String::new() };
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    Some(format!(
        "{} estimated from {} ({compared} measured values). Matched worst: {}{place}, of whose variance the model explains {} % (RMS of the residual {}{}).",
        count(parameters, "parameter"),
        count(runs.len(), "run"),
        worst["name"].as_str().unwrap_or_default(),
        text(100.0 * number(&worst["r2"]), 4),
        shown(&worst["rms"], 3),
        worst["unit"].as_str().map_or(String::new(), |u| format!(" {u}")),
    ))
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

/// How heavy a kind of remark weighs, and the section where it can be seen.
fn weight(about: &str) -> (usize, &'static str) {
    match about {
        "undetermined" => (0, "parameters"),
        "bound" => (1, "parameters"),
        "offset" => (2, "residuals"),
        "input" => (3, "residuals"),
        "colour" => (4, "residuals"),
        "drawn" => (5, "parameters"),
        "correlated" => (6, "correlations"),
        "prior" => (7, "parameters"),
        "iteration" => (8, "convergence"),
        _ => (9, "residuals"),
    }
}

fn capital(sentence: &str) -> String {
    // names of parameters begin sentences too, and stay what they are
    let word = sentence.split(' ').next().unwrap_or_default();
    let plain = word.chars().all(|c| c.is_ascii_lowercase() || c == ':') && word.len() > 3;
    let mut letters = sentence.chars();
    match letters.next() {
        Some(first) if plain => first.to_uppercase().chain(letters).collect(),
        _ => sentence.to_string(),
    }
}
