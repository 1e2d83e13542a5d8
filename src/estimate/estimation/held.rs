//! What the data do not determine is held where it began.
//!
//! A parameter may be known a little at its start and not at all where a long step takes it: a stall that no run visits moves so far away that the branch
//! before it changes, and with it what all others mean. Such a parameter is held at its start and the others are fitted anew. That is the result unless what
//! moving it had gained is worth a parameter each in the logarithm of the likelihood (Akaike 1974); then it is held where it went, so that the errors of the
//! others are those given it.

use crate::estimation::estimate::Estimate;
use crate::estimation::solve::{Solved, solve};
use crate::problem::{Options, Problem, ProblemError};
use crate::uncertainty::lost_unknowns::Pin;
use crate::work::Work;

/// Rounds in which what is left may turn out not to be determined either.
const ROUNDS: usize = 3;

/// What a parameter must gain of the logarithm of the likelihood (Akaike 1974).
const WORTH: f64 = 1.0;

/// The estimate with what the data do not determine held.
///
/// # Errors
/// As the estimation itself.
pub(crate) fn with_undetermined_held(
    problem: &mut Problem<'_>,
    options: &Options,
    free: Solved,
    work: &Work<'_>,
) -> Result<Estimate, Vec<ProblemError>> {
    let mut best = free;
    let mut pins: Vec<Pin> = Vec::new();
    // of a bare estimation nobody reads errors, and one that was stopped has no time
    let worthwhile = |found: &Solved, work: &Work<'_>| {
        options.colour && found.estimate.termination.is_good() && work.stopped().is_none()
    };
    'rounds: for _ in 0..ROUNDS {
        if !best.lost.iter().any(|l| !l.bound) {
            break;
        }
        // what ran to a bound beside them may have taken their part
        let of =
            |bounds: bool| best.lost.iter().filter(move |l| l.moved() && (bounds || !l.bound)).map(|l| l.at(l.start));
        let mut sets: Vec<Vec<Pin>> = vec![of(true).collect(), of(false).collect()];
        sets.dedup();
        for new in sets.into_iter().filter(|new| !new.is_empty()) {
            if !worthwhile(&best, work) {
                break 'rounds;
            }
            let with: Vec<Pin> = pins.iter().chain(&new).copied().collect();
            let held = solve(problem, options, None, (&with, None), &work.quiet())?;
            let gained = held.estimate.cost.zip(best.estimate.cost).map_or(f64::INFINITY, |(held, free)| held - free);
            if held.estimate.termination.is_good() && gained <= WORTH * new.len() as f64 {
                (best, pins) = (merged(held, &best), with);
                continue 'rounds;
            }
        }
        break;
    }
    // what only shows beside all others would take part in their errors
    let new: Vec<Pin> = best.lost.iter().filter(|l| l.shows).map(|l| l.at(l.value)).collect();
    if !new.is_empty() && worthwhile(&best, work) {
        let with: Vec<Pin> = pins.iter().chain(&new).copied().collect();
        let values = best.values.clone();
        let held = solve(problem, options, None, (&with, Some(&values)), &work.quiet())?;
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
