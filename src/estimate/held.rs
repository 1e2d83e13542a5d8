//! What the data do not determine is held where it began.
//!
//! A parameter may be known a little at its start and not at all where a long step takes it: a stall that no run visits moves so far away that the branch
//! before it changes, and with it what all others mean. Such a parameter is held at its start and the others are fitted anew. That is the result unless what
//! moving it had gained is worth a parameter each in the logarithm of the likelihood (Akaike 1974); then it is held where it went, so that the errors of the
//! others are those given it.

use crate::estimate::Estimate;
use crate::observer::{Observer, Stop, UnknownName};
use crate::problem::{Options, Problem, ProblemError};
use crate::solve::{Solved, solve};
use fdm_numeric::least_squares::Iteration;
use std::ops::ControlFlow;

/// Rounds in which what is left may turn out not to be determined either.
const ROUNDS: usize = 3;

/// What a parameter must gain of the logarithm of the likelihood (Akaike 1974).
const WORTH: f64 = 1.0;

/// An unknown that is not estimated, and where it stays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pin {
    /// Its place in the vector of unknowns.
    pub(crate) unknown: usize,
    /// Its value.
    pub(crate) value: f64,
}

/// The same estimation with what it does not determine held.
///
/// # Errors
/// As the estimation itself.
pub(crate) fn with_undetermined_held(
    problem: &mut Problem<'_>,
    options: &Options,
    free: Solved,
    observer: &mut dyn Observer,
) -> Result<Estimate, Vec<ProblemError>> {
    let mut best = free;
    let mut pins: Vec<Pin> = Vec::new();
    // of a bare estimation nobody reads errors, and one that was stopped has no time
    let worthwhile = |found: &Solved, observer: &mut dyn Observer| {
        options.colour && found.estimate.termination.is_good() && observer.stopped().is_none()
    };
    for _ in 0..ROUNDS {
        let new: Vec<Pin> = best.lost.iter().filter(|l| l.moved()).map(|l| l.at(l.start)).collect();
        if new.is_empty() || !worthwhile(&best, observer) {
            break;
        }
        let with: Vec<Pin> = pins.iter().chain(&new).copied().collect();
        let held = solve(problem, options, None, (&with, None), &mut Quiet(observer))?;
        let gained = held.estimate.cost.zip(best.estimate.cost).map_or(f64::INFINITY, |(held, free)| held - free);
        if !held.estimate.termination.is_good() || gained > WORTH * new.len() as f64 {
            break;
        }
        (best, pins) = (merged(held, &best), with);
    }
    // what only shows beside all others would take part in their errors
    let new: Vec<Pin> = best.lost.iter().filter(|l| l.shows).map(|l| l.at(l.value)).collect();
    if !new.is_empty() && worthwhile(&best, observer) {
        let with: Vec<Pin> = pins.iter().chain(&new).copied().collect();
        let values = best.values.clone();
        let held = solve(problem, options, None, (&with, Some(&values)), &mut Quiet(observer))?;
        if held.estimate.termination.is_good() {
            best = merged(held, &best);
        }
    }
    Ok(best.estimate)
}

/// An estimation counts what was done before it.
fn merged(mut held: Solved, before: &Solved) -> Solved {
    held.estimate.evaluations.0 += before.estimate.evaluations.0;
    held.estimate.evaluations.1 += before.estimate.evaluations.1;
    held
}

/// An unknown that the data do not determine by itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lost {
    /// Its place in the vector of unknowns.
    pub(crate) unknown: usize,
    /// Where it began.
    pub(crate) start: f64,
    /// Where it ended.
    pub(crate) value: f64,
    /// Whether its sensitivities are small, but not zero.
    pub(crate) shows: bool,
}

impl Lost {
    fn moved(&self) -> bool {
        self.shows || self.value != self.start
    }

    fn at(&self, value: f64) -> Pin {
        Pin { unknown: self.unknown, value }
    }
}

/// Estimations whose iterations are nobody's business, but can be stopped.
struct Quiet<'o>(&'o mut dyn Observer);

impl Observer for Quiet<'_> {
    fn iteration(&mut self, _: &Iteration) -> ControlFlow<()> {
        if self.0.stopped().is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn begin(&mut self, _: &dyn Fn() -> Vec<UnknownName>) {}

    fn stopped(&mut self) -> Option<Stop> {
        self.0.stopped()
    }
}
