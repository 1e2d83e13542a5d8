//! The manoeuvres among which the best are sought, one input moved while the others stand, and the runs that they make.

use super::question::Question;
use crate::experiment::{Amount, Law, Signal, Table};
use fdm_numeric::random::Stream;
use fdm_results::documents::design::{Form, Manoeuvre};
use fdm_system::record::Run;

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

/// Parts of the height that are tried where a limit is in the way.
const SMALLER: [f64; 4] = [1.0, 0.5, 0.25, 0.125];

/// All of them, input by input.
pub(super) fn survey(question: &Question<'_>) -> Vec<Manoeuvre> {
    let left = question.duration - begin(question);
    let mut found = Vec::new();
    for (input, height) in question.model.definition().inputs.iter().zip(&question.heights) {
        let Some(height) = *height else { continue };
        let of = |form, unit, band| Manoeuvre { input: input.quantity.name.clone(), form, unit, band, height };
        found.push(of(Form::Step, None, None));
        found.extend(lengths(question, LONGEST_HALF).into_iter().map(|half| of(Form::Doublet, Some(half), None)));
        found
            .extend(lengths(question, LONGEST_UNIT).into_iter().map(|unit| of(Form::ThreeTwoOneOne, Some(unit), None)));
        let low = 2.0 / left;
        let highs = SWEEPS.map(|cycles| (cycles / left).min(HIGHEST / question.dt));
        let mut last = low;
        for high in highs {
            if high > 2.0 * last {
                found.push(of(Form::Sweep, None, Some([low, high])));
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

/// When an input begins to move.
fn begin(question: &Question<'_>) -> f64 {
    (LEAD * question.duration / question.dt).round() * question.dt
}

/// How the input moves over time.
fn signal(question: &Question<'_>, manoeuvre: &Manoeuvre) -> Option<Signal> {
    let (at, height) = (begin(question), Amount { value: manoeuvre.height, unit: None });
    let length = 0.9 * (question.duration - at);
    Some(match (manoeuvre.form, manoeuvre.unit, manoeuvre.band) {
        (Form::Step, ..) => Signal::Step { at, height },
        (Form::Doublet, Some(half), _) => Signal::Doublet { at, height, half },
        (Form::ThreeTwoOneOne, Some(unit), _) => Signal::ThreeTwoOneOne { at, height, unit },
        (Form::Sweep, _, Some(band)) => Signal::Sweep { at, length, band, height, law: Law::Log },
        _ => return None,
    })
}

/// The run that a manoeuvre makes, without a measurement: every output counts at every sample.
pub(super) fn run(question: &Question<'_>, manoeuvre: &Manoeuvre) -> Option<Run> {
    let definition = question.model.definition();
    let (n, m, q) = (question.samples(), definition.inputs.len(), definition.outputs.len());
    let place = definition.inputs.iter().position(|i| i.quantity.name == manoeuvre.input)?;
    // nothing here is by chance
    let mut chance = Stream::named(0, &[]);
    let mut moved = signal(question, manoeuvre)?.sampled(n, question.dt, None, &definition.time, &mut chance)?;
    if let Some(rate) = question.rates[place] {
        slew(&mut moved, rate * question.dt);
    }
    let mut inputs: Vec<f64> = (0..n).flat_map(|_| question.rest.iter().copied()).collect();
    for (k, v) in moved.iter().enumerate() {
        inputs[k * m + place] += v;
    }
    let known = question.known.first().map(|(run, _)| run);
    let run = Run {
        name: manoeuvre.words("s"),
        time: (0..n).map(|k| question.dt * k as f64).collect(),
        inputs,
        held: known.map_or_else(|| vec![false; m], |run| run.held.clone()),
        measured: vec![0.0; n * q],
        input_gaps: vec![0; m],
        stated: known.map_or_else(Vec::new, |run| run.stated.clone()),
        output_gaps: vec![0; q],
    };
    Some(run.with_moves_held())
}

/// Follows a signal from rest by at most so much from sample to sample.
fn slew(signal: &mut [f64], most: f64) {
    let mut at = 0.0;
    for value in signal {
        at += (*value - at).clamp(-most, most);
        *value = at;
    }
}

/// A manoeuvre that keeps all limits.
pub(super) struct Kept<T> {
    pub(super) manoeuvre: Manoeuvre,
    /// What it tells.
    pub(super) told: T,
    /// How far the outputs move (q).
    pub(super) excursions: Vec<f64>,
}

/// Of a manoeuvre and its halves, quarters and eighths the first that keeps all limits, with what `tell` says of it and of how far the
/// outputs move; or why none does.
pub(super) fn within_limits<T>(
    question: &Question<'_>,
    manoeuvre: &Manoeuvre,
    tell: impl Fn(&Manoeuvre) -> Result<(T, Vec<f64>), String>,
) -> Result<Kept<T>, String> {
    let mut reason = String::new();
    for part in SMALLER {
        let own = Manoeuvre { height: manoeuvre.height * part, ..manoeuvre.clone() };
        let (told, excursions) = tell(&own)?;
        let outputs = &question.model.definition().outputs;
        let over = outputs.iter().zip(&excursions).zip(&question.limits);
        match over
            .filter_map(|((o, moved), limit)| Some((o, moved, (*limit)?)))
            .find(|(_, moved, limit)| **moved > *limit)
        {
            None => return Ok(Kept { manoeuvre: own, told, excursions }),
            Some((o, moved, limit)) => {
                reason = format!("`{}` moves by {moved:.3}, and may by {limit}", o.quantity.name);
            }
        }
    }
    Err(reason)
}

/// The inputs of the run as columns, ready to be flown.
pub fn table(question: &Question<'_>, manoeuvre: &Manoeuvre, name: &str) -> Option<Table> {
    let definition = question.model.definition();
    let run = run(question, manoeuvre)?;
    let m = definition.inputs.len();
    let mut columns = vec![("t".to_string(), Some(definition.time.to_string()), run.time)];
    for (k, input) in definition.inputs.iter().enumerate() {
        let unit = input.quantity.unit.as_ref().map(ToString::to_string);
        columns.push((input.quantity.name.clone(), unit, run.inputs.iter().skip(k).step_by(m).copied().collect()));
    }
    Some(Table { name: name.into(), columns })
}
