//! What a reader must know who reads nothing else: how it ended, whether it can be trusted, and what speaks against it.

use super::number::{shown, text};
use super::progress;
use super::subject::{Content, Subject};
use crate::section::{Point, Trust, Verdict};
use crate::{diagnosis, regression, study};
use fdm_results::documents::{About, FitDocument, Remark, ResultDocument, Terminated};
use fdm_system::record::Assumptions;

/// What kind of result it is.
pub(crate) fn kind(subject: &Subject) -> &'static str {
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
pub(crate) fn doc(subject: &Subject) -> Option<&str> {
    Some(subject.tree.as_ref()?.doc.as_ref()?.text.as_str()).filter(|d| !d.is_empty())
}

/// The headline with what speaks for and against the result.
pub(crate) fn verdict(subject: &Subject) -> Verdict {
    let mut verdict = match &subject.content {
        Content::AtWork(told, silent) => progress::verdict(told, *silent),
        Content::Diagnosis(found) => diagnosis::verdict(found),
        Content::Result(ResultDocument::Regression(found)) => regression::verdict(found),
        Content::Result(ResultDocument::Fit(fit)) => {
            let mut verdict = fit.study.as_ref().map_or_else(|| of_fit(fit), study::verdict);
            verdict.points.extend(remarks(fit));
            verdict
        }
    };
    verdict.facts = facts(subject);
    with_records(verdict, subject)
}

/// What was found in the records stands before what is said of the fit, what was assumed about them behind it.
fn with_records(verdict: Verdict, subject: &Subject) -> Verdict {
    let judged = match &subject.content {
        Content::AtWork(..) => None,
        Content::Diagnosis(found) => found.records.as_ref(),
        Content::Result(result) => result.records(),
    };
    let Some(judged) = judged else { return verdict };
    let warnings: Vec<String> = judged.warnings().map(|w| capital(&w)).collect();
    let trust = if warnings.is_empty() || verdict.trust != Trust::Good { verdict.trust } else { Trust::Reserved };
    let Verdict { sentence, facts, points, .. } = verdict;
    let assumed = |r: &Assumptions| {
        let run = r.run.clone();
        r.sentences().into_iter().map(move |a| format!("Assumed of run `{run}`: {a}"))
    };
    let mut all = Verdict { trust, sentence, facts, points: Vec::new() }.with_points(warnings, "reproduction");
    all.points.extend(points);
    all.with_points(judged.assumed.iter().flat_map(assumed), "reproduction")
}

/// What speaks against a result, the heaviest first, each with the section that shows it.
fn remarks(fit: &FitDocument) -> Vec<Point> {
    let mut remarks: Vec<&Remark> = fit.remarks.iter().collect();
    remarks.sort_by_key(|r| r.about.rank());
    remarks.iter().map(|r| Point { sentence: capital(&r.sentence), anchor: place(r.about) }).collect()
}

/// How a fit ended and whether anything speaks against it, in a sentence.
pub fn fit_verdict(fit: &FitDocument) -> String {
    of_fit(fit).sentence
}

fn of_fit(fit: &FitDocument) -> Verdict {
    let what = if fit.validation.is_some() { "The validation" } else { "The fit" };
    if fit.termination != Terminated::Converged {
        return Verdict::new(Trust::Bad, format!("{what} did not end well: {}.", fit.message));
    }
    if let Some(first) = fit.remarks.iter().find(|r| r.about == About::Unexplained) {
        return Verdict::new(Trust::Bad, format!("{what} converged, but {}.", first.sentence));
    }
    if !fit.undetermined.is_empty() {
        let said = format!(
            "{what} converged, but the data do not determine every parameter: errors and values below hold only where they are shown."
        );
        return Verdict::new(Trust::Bad, said);
    }
    if fit.remarks.iter().any(|r| r.about == About::Likelihood) {
        let said =
            format!("{what} converged, but the likelihood has no maximum: values and errors below mean nothing.");
        return Verdict::new(Trust::Bad, said);
    }
    let bounds = fit.remarks.iter().filter(|r| r.about == About::Bound).count();
    let against = fit.remarks.iter().filter(|r| r.about.speaks_against()).count();
    let (trust, said) = match (bounds, against) {
        (0, 0) => (Trust::Good, format!("{what} converged, and nothing speaks against the result.")),
        (0, _) => (Trust::Reserved, format!("{what} converged; read the remarks below before the numbers are used.")),
        (1, _) => (Trust::Reserved, format!("{what} converged with a parameter at its bound.")),
        (n, _) => (Trust::Reserved, format!("{what} converged with {n} parameters at their bounds.")),
    };
    Verdict::new(trust, said)
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
pub(crate) fn capital(sentence: &str) -> String {
    // names of parameters begin sentences too, and stay what they are
    let word = sentence.split(' ').next().unwrap_or_default();
    let plain = word.chars().all(|c| c.is_ascii_lowercase() || c == ':') && word.len() > 3;
    let mut letters = sentence.chars();
    match letters.next() {
        Some(first) if plain => first.to_uppercase().chain(letters).collect(),
        _ => sentence.to_string(),
    }
}
