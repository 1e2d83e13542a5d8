//! What a reader must know who reads nothing else: how it ended, whether it can be trusted, and what speaks against it.

use super::subject::{Content, Subject};
use crate::section::{Trust, Verdict, capital};
use crate::{diagnosis, fit, progress, regression, study};
use fdm_results::documents::ResultDocument;
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
        Content::AtWork(report, silent) => progress::verdict(report, *silent),
        Content::Diagnosis(found) => diagnosis::verdict(found),
        Content::Result(ResultDocument::Regression(found)) => regression::verdict(found),
        Content::Result(ResultDocument::Fit(fit)) => {
            let mut verdict = fit.study.as_ref().map_or_else(|| fit::verdict(fit), study::verdict);
            verdict.points.extend(fit::points(fit));
            verdict
        }
    };
    verdict.facts = subject.fit().and_then(fit::facts);
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
