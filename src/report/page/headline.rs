//! What a reader must know who reads nothing else: how it ended, whether it can be trusted, and what speaks against it.

use super::number::{shown, text};
use super::section::{Trust, Verdict, quoted};
use super::subject::{Content, Subject};
use super::{diagnosis, progress, regression, study};
use fdm_results::documents::{About, FitDocument, Remark, ResultDocument, Terminated};
use maud::{Markup, html};

/// Points that stand at the top.
const FIRST: usize = 4;

/// What kind of result it is.
pub(super) fn kind(subject: &Subject) -> &'static str {
    match &subject.content {
        Content::AtWork(..) => "at work",
        Content::Diagnosis(_) => "diagnosis",
        Content::Result(ResultDocument::Regression(_)) => "equation error",
        Content::Result(ResultDocument::Fit(fit)) if fit.study.is_some() => "study",
        Content::Result(ResultDocument::Fit(fit)) if fit.validation.is_some() => "validation",
        Content::Result(ResultDocument::Fit(fit)) if fit.frequency_domain.is_some() => "fit of spectra",
        Content::Result(ResultDocument::Fit(fit)) if fit.frequency_responses.is_some() => "fit of frequency responses",
        Content::Result(ResultDocument::Fit(_)) => "fit",
    }
}

/// What the model says of itself.
pub(super) fn doc(subject: &Subject) -> Option<&str> {
    Some(subject.tree.as_ref()?.doc.as_ref()?.text.as_str()).filter(|d| !d.is_empty())
}

/// The headline with what speaks against the result; links lead to the sections that the page has.
pub(super) fn verdict(subject: &Subject, anchors: &[&str]) -> Markup {
    let (trust, sentence, points): Verdict = match &subject.content {
        Content::AtWork(told, silent) => progress::verdict(told, *silent),
        Content::Diagnosis(found) => diagnosis::verdict(found),
        Content::Result(ResultDocument::Regression(found)) => regression::verdict(found),
        Content::Result(ResultDocument::Fit(fit)) => {
            let (trust, sentence, mut points) = fit.study.as_ref().map_or_else(|| judged(fit), study::verdict);
            points.extend(remarks(fit));
            (trust, sentence, points)
        }
    };
    let (trust, points) = with_records(subject, (trust, points));
    judgement((trust, sentence, points), facts(subject), anchors)
}

/// What was found in the records stands before what is said of the fit.
fn with_records(
    subject: &Subject,
    (trust, points): (Trust, Vec<(String, &'static str)>),
) -> (Trust, Vec<(String, &'static str)>) {
    let judged = match &subject.content {
        Content::AtWork(..) => None,
        Content::Diagnosis(found) => found.records.as_ref(),
        Content::Result(result) => result.records(),
    };
    let Some(judged) = judged else { return (trust, points) };
    let mut all: Vec<(String, &'static str)> = judged.warnings().map(|w| (capital(&w), "reproduction")).collect();
    let trust = if all.is_empty() || trust != Trust::Good { trust } else { Trust::Reserved };
    all.extend(points);
    all.extend(
        judged.assumed.iter().flat_map(|r| {
            r.sentences().into_iter().map(|a| (format!("Assumed of run `{}`: {a}", r.run), "reproduction"))
        }),
    );
    (trust, all)
}

/// A verdict as it stands on a page.
pub(super) fn judgement((trust, sentence, points): Verdict, facts: Option<String>, anchors: &[&str]) -> Markup {
    let one = |(sentence, anchor): &(String, &'static str)| {
        html! { li { @if anchors.contains(anchor) { a href={ "#" (anchor) } { (quoted(sentence)) } } @else { (quoted(sentence)) } } }
    };
    html! {
        div class={ "verdict " (trust.word()) } role="status" {
            p.sentence { span.sign aria-hidden="true" { (trust.sign()) } (sentence) }
            @if let Some(facts) = facts { p.facts { (facts) } }
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

/// What speaks against a result, the heaviest first, each with the section that shows it.
fn remarks(fit: &FitDocument) -> Vec<(String, &'static str)> {
    let mut remarks: Vec<&Remark> = fit.remarks.iter().collect();
    remarks.sort_by_key(|r| r.about.rank());
    remarks.iter().map(|r| (capital(&r.sentence), place(r.about))).collect()
}

fn judged(fit: &FitDocument) -> Verdict {
    let (trust, sentence) = of_fit(fit);
    (trust, sentence, Vec::new())
}

/// How a fit ended and whether anything speaks against it, in a sentence.
pub fn fit_verdict(fit: &FitDocument) -> String {
    of_fit(fit).1
}

fn of_fit(fit: &FitDocument) -> (Trust, String) {
    let what = if fit.validation.is_some() { "The validation" } else { "The fit" };
    if fit.termination != Terminated::Converged {
        return (Trust::Bad, format!("{what} did not end well: {}.", fit.message));
    }
    if let Some(first) = fit.remarks.iter().find(|r| r.about == About::Unexplained) {
        return (Trust::Bad, format!("{what} converged, but {}.", first.sentence));
    }
    if !fit.undetermined.is_empty() {
        let said = format!(
            "{what} converged, but the data do not determine every parameter: errors and values below hold only where they are shown."
        );
        return (Trust::Bad, said);
    }
    if fit.remarks.iter().any(|r| r.about == About::Likelihood) {
        let said =
            format!("{what} converged, but the likelihood has no maximum: values and errors below mean nothing.");
        return (Trust::Bad, said);
    }
    let bounds = fit.remarks.iter().filter(|r| r.about == About::Bound).count();
    let against = fit.remarks.iter().filter(|r| r.about.speaks_against()).count();
    match (bounds, against) {
        (0, 0) => (Trust::Good, format!("{what} converged, and nothing speaks against the result.")),
        (0, _) => (Trust::Reserved, format!("{what} converged; read the remarks below before the numbers are used.")),
        (1, _) => (Trust::Reserved, format!("{what} converged with a parameter at its bound.")),
        (n, _) => (Trust::Reserved, format!("{what} converged with {n} parameters at their bounds.")),
    }
}

/// How much was fitted to how much, and which output is matched worst.
fn facts(subject: &Subject) -> Option<String> {
    let outputs = subject.outputs();
    let parameters = subject.fit()?.parameters.iter().filter(|p| p.standard_error.is_some()).count();
    let mut runs: Vec<&str> = outputs.iter().map(|o| o.run.as_str()).collect();
    runs.sort_unstable();
    runs.dedup();
    let compared: usize = outputs.iter().map(|o| o.compared).sum();
    let explained = outputs.iter().filter_map(|o| Some((o, o.r2?)));
    let (worst, r2) = explained.min_by(|a, b| a.1.total_cmp(&b.1))?;
    let place = if runs.len() > 1 { format!(" in {}", worst.run) } else { String::new() };
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    Some(format!(
        "{} estimated from {} ({compared} measured values). Matched worst: {}{place}, of whose variance the model explains {} % (RMS of the residual {}{}).",
        count(parameters, "parameter"),
        count(runs.len(), "run"),
        worst.name,
        text(100.0 * r2, 4),
        shown(worst.rms, 3),
        worst.unit.as_ref().map_or(String::new(), |u| format!(" {u}")),
    ))
}

/// The section where what a remark is about can be seen.
fn place(about: About) -> &'static str {
    match about {
        About::Initial
        | About::Undetermined
        | About::Likelihood
        | About::Minima
        | About::Bound
        | About::Few
        | About::Short
        | About::Biased
        | About::Intervals
        | About::Prior => "parameters",
        About::Correlated => "correlations",
        About::Table => "tables",
        About::Iteration => "convergence",
        About::Unexplained
        | About::Offset
        | About::Input
        | About::Interpolation
        | About::InterpolationUnknown
        | About::Colour
        | About::Noise
        | About::NoNoise
        | About::Untested
        | About::NotMeasured
        | About::Bridged
        | About::Regressors => "residuals",
    }
}

/// A sentence with its first letter large.
pub(super) fn capital(sentence: &str) -> String {
    // names of parameters begin sentences too, and stay what they are
    let word = sentence.split(' ').next().unwrap_or_default();
    let plain = word.chars().all(|c| c.is_ascii_lowercase() || c == ':') && word.len() > 3;
    let mut letters = sentence.chars();
    match letters.next() {
        Some(first) if plain => first.to_uppercase().chain(letters).collect(),
        _ => sentence.to_string(),
    }
}
