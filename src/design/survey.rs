//! The manoeuvres among which the best are sought.

use super::manoeuvre::Manoeuvre;
use super::question::Question;

/// Part of the run before anything moves.
const LEAD: f64 = 0.05;
/// Lengths of each form, by equal factors.
const LENGTHS: usize = 8;
/// Samples of the shortest unit.
const SHORTEST: f64 = 2.0;
/// Part of the run that the longest doublet's half and 3211's unit take: what follows shows how the vehicle settles.
const LONGEST_HALF: f64 = 0.25;
const LONGEST_UNIT: f64 = 0.11;
/// Last frequency of sweeps in cycles per run.
const SWEEPS: [f64; 3] = [8.0, 25.0, 80.0];
/// Highest frequency in cycles per sample.
const HIGHEST: f64 = 0.2;

/// All of them, input by input.
pub(super) fn survey(question: &Question<'_>) -> Vec<Manoeuvre> {
    let at = (LEAD * question.duration / question.dt).round() * question.dt;
    let left = question.duration - at;
    let mut found = Vec::new();
    let inputs = question.model.definition().inputs.iter().zip(&question.heights).enumerate();
    for (place, (input, height)) in inputs {
        let (Some(height), name) = (*height, input.quantity.name.as_str()) else { continue };
        found.push(Manoeuvre::step(name, place, height, at));
        let halves = lengths(question, LONGEST_HALF).into_iter();
        found.extend(halves.map(|half| Manoeuvre::doublet(name, place, height, at, half)));
        let units = lengths(question, LONGEST_UNIT).into_iter();
        found.extend(units.map(|unit| Manoeuvre::three_two_one_one(name, place, height, at, unit)));
        let low = 2.0 / left;
        let highs = SWEEPS.map(|cycles| (cycles / left).min(HIGHEST / question.dt));
        let mut last = low;
        for high in highs {
            if high > 2.0 * last {
                found.push(Manoeuvre::sweep(name, place, height, (at, 0.9 * left), [low, high]));
                last = high;
            }
        }
    }
    found
}

/// Units of time from the shortest to a part of the run, in whole samples, each once.
fn lengths(question: &Question<'_>, longest: f64) -> Vec<f64> {
    let (first, last) = (SHORTEST, longest * question.duration / question.dt);
    let ratio = (last / first).max(1.0);
    let mut samples: Vec<f64> =
        (0..LENGTHS).map(|k| (first * ratio.powf(k as f64 / (LENGTHS - 1) as f64)).round()).collect();
    samples.dedup();
    samples.into_iter().map(|n| n * question.dt).collect()
}
