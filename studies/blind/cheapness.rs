//! What screening costs beside refitting every candidate, and whether both point at the same one.

use crate::case::Case;
use crate::hidden::INSIDE;
use fdm::Model;
use fdm::diagnose::{DiagnosisOptions, diagnose};
use fdm::effect::{Candidate, Catalogue, Choice, Kind, Subject};
use fdm::estimate::{FitOptions, Observer, Work, fit};
use fdm::record::Run;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Prints the time from the first fit to the end of screening, and that of one fit of every candidate from its own start values.
pub(crate) fn compare(case: &Case) {
    let (learned, held) = case.runs.split_at(2);
    let (screening, named) = screened(case, learned, held);
    let refits = refitted(case, learned);
    let whole: Duration = refits.iter().map(|r| r.seconds).sum();
    println!(
        "screening: {:.2} s; a fit of each of {} candidates from its start values: {:.2} s, {:.0} times as long",
        screening.as_secs_f64(),
        refits.len(),
        whole.as_secs_f64(),
        whole.as_secs_f64() / screening.as_secs_f64()
    );
    let best = refits.iter().filter_map(|r| Some((r.cost?, &r.name))).min_by(|a, b| a.0.total_cmp(&b.0));
    println!("the best of the refits: {best:?}; named after screening: {named:?}; true: {:?}", case.truth.places);
}

/// When each stage of a diagnosis began.
#[derive(Default)]
struct Marks(Mutex<Vec<(String, Instant)>>);

impl Observer for Marks {
    fn stage(&self, what: &str) {
        self.0.lock().expect("no thread panicked").push((what.into(), Instant::now()));
    }
}

/// How long screening lasted, and what was named in the end.
fn screened(case: &Case, learned: &[Run], held: &[Run]) -> (Duration, Option<String>) {
    let marks = Marks::default();
    let work = Work::default().telling(&marks);
    let options = DiagnosisOptions { most: 1, ..DiagnosisOptions::default() };
    let found = diagnose(&case.base, learned, held, &Catalogue::standard(), &options, &work).expect("a diagnosis");
    let marks = marks.0.into_inner().expect("no thread panicked");
    let at = |start: &str| marks.iter().find(|(text, _)| text.starts_with(start)).map(|(_, at)| *at);
    let (begun, ended) = (at("search 1").expect("a search"), at("search 1: screened").expect("its end"));
    let fits = at("fitting the best").expect("fits after screening");
    println!(
        "from screening to the first fit to the end (what may be there, and short looks): {:.2} s",
        (fits - ended).as_secs_f64()
    );
    (ended - begun, found.causes.first().map(|cause| cause.place.to_string()))
}

struct Refit {
    name: String,
    seconds: Duration,
    /// Minus the log-likelihood; none where the fit did not end.
    cost: Option<f64>,
}

/// Every candidate as a user would try it: written into the text, and fitted by output error.
fn refitted(case: &Case, runs: &[Run]) -> Vec<Refit> {
    let subject = Subject::new(case.base.source(), case.base.definition()).expect("a text that compiles");
    let candidates = INSIDE.places(&subject).candidates;
    let scored = candidates.iter().filter(|c| c.kind() != Kind::Variance);
    scored.filter_map(|candidate| refit(case, runs, &subject, candidate)).collect()
}

fn refit(case: &Case, runs: &[Run], subject: &Subject, candidate: &Candidate) -> Option<Refit> {
    let extension = candidate.apply(subject, &case.known, &Choice::new()).ok()?;
    let begun = Instant::now();
    let cost = Model::compiled(extension.source().clone(), extension.compile()).ok().and_then(|model| {
        let fitted = fit(&model, runs, &FitOptions::default(), &Work::default()).ok()?;
        fitted.estimate.cost
    });
    Some(Refit {
        name: format!("{}({})", candidate.effect().name(), candidate.targets().join(", ")),
        seconds: begun.elapsed(),
        cost,
    })
}
