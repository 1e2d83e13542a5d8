//! All parameters over all repeats.

use super::coverage::{Coverage, Interval, Kind, NOMINAL};
use super::disturbance::Colour;
use super::repeat::{Figure, Repeat, Subject};
use serde::Serialize;

/// What came of a series of repeats.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Study {
    /// The model or the system.
    pub name: String,
    /// The colour of the noise; none where it is as an experiment describes it.
    pub colour: Option<Colour>,
    /// Decides all noise.
    pub seed: u64,
    /// Repeats that were asked for.
    pub asked: usize,
    /// Repeats that are done; fewer when the series was interrupted.
    pub done: usize,
    /// Those of them that converged.
    pub converged: usize,
    /// Why the others have not, and how many of each.
    pub astray: Vec<(String, usize)>,
    /// Of each parameter.
    pub parameters: Vec<Coverage>,
    /// Of all parameters together, by kind of errors.
    pub pooled: Vec<Pooled>,
}

/// The errors of one kind over all parameters.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pooled {
    /// Which.
    pub kind: Kind,
    /// Nominal 95 % intervals that hold the truth, of all that were printed.
    pub coverage: f64,
    /// What chance leaves open: its interval of 95 %, by the scatter between repeats, whose parameters are not independent.
    pub interval: [f64; 2],
    /// The same share of all parameters of all repeats: one without an interval does not hold the truth.
    pub of_all: f64,
    /// The parameter whose coverage is furthest from 95 %, and its coverage.
    pub worst: (String, f64),
    /// Least and greatest scatter over printed error.
    pub ratios: [f64; 2],
}

/// Reasons that are told apart.
const REASONS: usize = 8;

impl Study {
    /// Of repeats; those that are missing were interrupted.
    pub fn of(
        name: impl Into<String>,
        (colour, seed): (Option<Colour>, u64),
        subjects: &[Subject],
        repeats: &[Option<Repeat>],
    ) -> Self {
        let done: Vec<&Repeat> = repeats.iter().flatten().collect();
        let converged = done.iter().filter(|r| r.is_good()).count();
        let column = |k: usize| done.iter().map(|r| r.figures[k]).collect::<Vec<Figure>>();
        let parameters: Vec<Coverage> = subjects.iter().enumerate().map(|(k, s)| Coverage::of(s, &column(k))).collect();
        let kinds = [Kind::CramerRao, Kind::Corrected].into_iter().enumerate();
        let pooled = kinds.filter_map(|(k, kind)| Pooled::of(kind, k, subjects, &parameters, &done)).collect();
        let astray = reasons(&done);
        Self {
            name: name.into(),
            colour,
            seed,
            asked: repeats.len(),
            done: done.len(),
            converged,
            astray,
            parameters,
            pooled,
        }
    }

    /// Whether all repeats that were asked for are there.
    pub fn is_whole(&self) -> bool {
        self.done == self.asked
    }

    /// The errors of all parameters that are to be trusted: corrected where there are any.
    pub fn trusted(&self) -> Option<&Pooled> {
        self.pooled.last()
    }
}

/// Why repeats went astray, the most frequent reason first.
fn reasons(done: &[&Repeat]) -> Vec<(String, usize)> {
    let mut counts: Vec<(String, usize)> = Vec::new();
    for (step, reason) in done.iter().flat_map(|r| &r.astray) {
        let said = if step.is_empty() { reason.clone() } else { format!("{step}: {reason}") };
        match counts.iter_mut().find(|(known, _)| *known == said) {
            Some((_, count)) => *count += 1,
            None => counts.push((said, 1)),
        }
    }
    counts.sort_by_key(|count| std::cmp::Reverse(count.1));
    if counts.len() > REASONS {
        let rest = counts.drain(REASONS - 1..).map(|(_, count)| count).sum();
        counts.push(("other reasons".into(), rest));
    }
    counts
}

impl Pooled {
    fn of(kind: Kind, k: usize, subjects: &[Subject], parameters: &[Coverage], done: &[&Repeat]) -> Option<Self> {
        let known: Vec<(&Coverage, &Interval)> =
            parameters.iter().filter_map(|p| Some((p, p.interval(kind)?))).collect();
        let off = |i: &Interval| (i.coverage.share - 0.95).abs();
        let worst = known.iter().max_by(|a, b| off(a.1).total_cmp(&off(b.1)))?;
        // hits and printed intervals of each repeat: ratio of two sums over independent repeats
        let counted = |repeat: &&Repeat| -> (f64, f64) {
            let figures = || repeat.figures.iter().zip(subjects).filter(|(f, _)| f.errors[k].is_finite());
            (figures().filter(|(f, s)| f.holds(k, s.truth)).count() as f64, figures().count() as f64)
        };
        let counts: Vec<(f64, f64)> = done.iter().map(counted).collect();
        let (hits, printed) = counts.iter().fold((0.0, 0.0), |(h, p), (a, b)| (h + a, p + b));
        let coverage = hits / printed;
        let spread = counts.iter().map(|(h, p)| (h - coverage * p).powi(2)).sum::<f64>().sqrt() / printed;
        let ratio = |pick: fn(f64, f64) -> f64| known.iter().map(|(_, i)| i.ratio).reduce(pick).unwrap_or(f64::NAN);
        Some(Self {
            kind,
            coverage,
            interval: [coverage - NOMINAL * spread, coverage + NOMINAL * spread].map(|c| c.clamp(0.0, 1.0)),
            of_all: hits / (done.len() * known.len()) as f64,
            worst: (worst.0.subject.label(), worst.1.coverage.share),
            ratios: [ratio(f64::min), ratio(f64::max)],
        })
    }
}

impl Subject {
    /// What it is called where several steps and runs stand together.
    pub fn label(&self) -> String {
        let of = |what: &str, name: &str| if name.is_empty() { String::new() } else { format!("{what}{name}") };
        let run = of(" of ", self.run.as_deref().unwrap_or_default());
        format!("{}{run}{}", self.name, of(", ", &self.step))
    }
}
