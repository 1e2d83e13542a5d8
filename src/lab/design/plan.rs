//! What manoeuvres would tell, and the best of them one after the other.
//!
//! What is asked of a design: the model, what is known of it, and what the next run may be.
//!
//! The manoeuvres among which the best are sought, one input moved while the others stand, and the runs that they make.

use crate::experiment::{Amount, Law, Signal, Table};
use fdm_estimate::{Halt, Information, NoInformation};
use fdm_grammar::diagnostic::nearest;
use fdm_numeric::parallel;
use fdm_numeric::random::Stream;
use fdm_results::documents::design::{Design, Form, Gain, Manoeuvre, Outlook, Step};
use fdm_system::Model;
use fdm_system::record::Run;

/// Why a manoeuvre was not looked at.
pub(super) const STOPPED: &str = "the work was stopped before it was looked at";

/// A manoeuvre and what it tells.
struct Told {
    manoeuvre: Manoeuvre,
    information: Information,
    excursions: Vec<f64>,
}

/// Answers a question; manoeuvres that have not been looked at when the work is to end are left out.
///
/// # Errors
/// Everything that makes it impossible, one sentence each.
pub fn design(question: &Question<'_>, halt: &Halt) -> Result<Design, Vec<String>> {
    question.examine().map_err(|all| all.iter().map(ToString::to_string).collect::<Vec<_>>())?;
    let now = known(question).map_err(|e| vec![e.to_string()])?;
    let (mut told, mut lost) = (Vec::new(), Vec::new());
    let manoeuvres = survey(question);
    let one = |m: &Manoeuvre| match halt.goes_on() {
        true => within_limits(question, m, |m| tell(question, m)),
        false => Err(STOPPED.into()),
    };
    let answers: Vec<Result<Kept<Information>, String>> = parallel::map(manoeuvres.iter(), one);
    for (manoeuvre, answer) in manoeuvres.into_iter().zip(answers) {
        match answer {
            Ok(Kept { manoeuvre, told: information, excursions }) => {
                told.push(Told { manoeuvre, information, excursions });
            }
            Err(reason) => lost.push((manoeuvre, reason)),
        }
    }
    let sizes = sizes(question);
    let before = now.bits(&sizes);
    let gain = |t: &Told| {
        let then = now.plus(&t.information);
        let (bits, errors) = (then.bits(&sizes) - before, then.errors());
        Gain { manoeuvre: t.manoeuvre.clone(), bits, errors, excursions: t.excursions.clone() }
    };
    let mut gains: Vec<Gain> = parallel::map(told.iter(), gain);
    let (steps, after) = planned(&now, &told, &sizes, question.runs);
    let everything = told.iter().fold(now.clone(), |sum, t| sum.plus(&t.information));
    // equal gains stay in the order of the survey
    gains.sort_by(|a, b| b.bits.total_cmp(&a.bits));
    Ok(Design {
        outlook: outlook(question, &now, &after, &gains),
        undetermined_now: now.undetermined(),
        undetermined_then: everything.undetermined(),
        steps,
        gains,
        lost,
    })
}

/// What the runs so far tell.
pub(super) fn known(question: &Question<'_>) -> Result<Information, NoInformation> {
    let prior = Information::prior(question.model);
    if question.known.is_empty() {
        return Ok(prior);
    }
    let (runs, thetas): (Vec<_>, Vec<_>) = question.known.iter().cloned().unzip();
    Ok(prior.plus(&Information::of(question.model, &runs, &thetas, &question.deviations)?.0))
}

/// What a manoeuvre tells, and how far the outputs move.
fn tell(question: &Question<'_>, manoeuvre: &Manoeuvre) -> Result<(Information, Vec<f64>), String> {
    let run = run(question, manoeuvre).ok_or("it cannot be sampled")?;
    let theta = vec![question.theta.clone()];
    let told = Information::of(question.model, std::slice::from_ref(&run), &theta, &question.deviations);
    let (information, responses) = told.map_err(|e| e.to_string())?;
    Ok((information, excursions(&responses[0], question.deviations.len())))
}

pub(super) fn excursions(response: &[f64], q: usize) -> Vec<f64> {
    let from = |o: usize| response.iter().skip(o).step_by(q).map(move |v| (v - response[o]).abs());
    (0..q).map(|o| from(o).fold(0.0, f64::max)).collect()
}

/// What counts as knowing nothing but the size of a parameter: its value, or where that is 0 half its bounds, or 1.
pub(super) fn sizes(question: &Question<'_>) -> Vec<f64> {
    let params = question.model.definition().params.iter().zip(&question.theta);
    let size = |(p, value): (&fdm_grammar::model::Param, &f64)| {
        let width = 0.5 * (p.upper - p.lower);
        match value.abs() {
            0.0 if width.is_finite() => width,
            0.0 => 1.0,
            size => size,
        }
    };
    params.filter(|(p, _)| !p.fixed && !p.per_run).map(size).collect()
}

/// The most telling run, then the one that adds most to it, and so on; and what is known after each.
fn planned(now: &Information, told: &[Told], sizes: &[f64], runs: usize) -> (Vec<Step>, Vec<Information>) {
    let (mut steps, mut after, mut sum) = (Vec::new(), Vec::new(), now.clone());
    for _ in 0..runs {
        let before = sum.bits(sizes);
        let with: Vec<f64> = parallel::map(told.iter(), |t| sum.plus(&t.information).bits(sizes));
        let best = (0..told.len()).rev().max_by(|a, b| with[*a].total_cmp(&with[*b]));
        let Some(best) = best else { break };
        sum = sum.plus(&told[best].information);
        steps.push(Step { manoeuvre: told[best].manoeuvre.clone(), bits: with[best] - before });
        after.push(sum.clone());
    }
    (steps, after)
}

pub(super) fn outlook(
    question: &Question<'_>,
    now: &Information,
    after: &[Information],
    gains: &[Gain],
) -> Vec<Outlook> {
    let params = question.model.definition().params.iter().zip(&question.theta);
    let (errors, then) = (now.errors(), after.iter().map(Information::errors).collect::<Vec<_>>());
    let free = params.filter(|(p, _)| !p.fixed && !p.per_run).enumerate();
    let one = |(k, (p, value)): (usize, (&fdm_grammar::model::Param, &f64))| {
        let left = gains.iter().enumerate().filter_map(|(g, gain)| Some((g, gain.errors[k]?)));
        Outlook {
            parameter: p.quantity.name.clone(),
            value: *value,
            unit: p.quantity.unit.as_ref().map(ToString::to_string),
            now: errors[k],
            then: then.iter().map(|errors| errors[k]).collect(),
            best: left.min_by(|a, b| a.1.total_cmp(&b.1)),
        }
    };
    free.map(one).collect()
}

/// What is asked.
#[derive(Debug, Clone)]
pub struct Question<'a> {
    /// The model.
    pub model: &'a Model,
    /// All its parameters (p), as far as they are known; those of each run as the next run is expected to begin.
    pub theta: Vec<f64>,
    /// Standard deviation of the noise of each output (q).
    pub deviations: Vec<f64>,
    /// Runs that were made already, each with all its parameters.
    pub known: Vec<(Run, Vec<f64>)>,
    /// Where each input stands before it moves (m).
    pub rest: Vec<f64>,
    /// How far each input moves (m); none where it does not.
    pub heights: Vec<Option<f64>>,
    /// How fast each input may move (m), in its unit per unit of time; none where it may jump.
    pub rates: Vec<Option<f64>>,
    /// How far each output may move from where it begins (q); none where that does not matter.
    pub limits: Vec<Option<f64>>,
    /// Length of the next run.
    pub duration: f64,
    /// Time between its samples.
    pub dt: f64,
    /// How many runs are planned, one after the other.
    pub runs: usize,
}

/// What cannot be asked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Asked {
    /// A model without inputs.
    #[error("model `{model}` has no input that could be moved")]
    NoInput {
        /// The model.
        model: String,
    },
    /// An input that is a record's derivative or an output's measurement.
    #[error("`{input}` follows from a record: what it will do cannot be planned")]
    Hidden {
        /// The input.
        input: String,
    },
    /// Nothing moves.
    #[error("nothing says how far inputs may move: say it with --amplitude {input}=VALUE, or give a run with --data")]
    Still {
        /// An input.
        input: String,
    },
    /// A name that is none.
    #[error("the model has no input `{name}`{hint}")]
    Unknown {
        /// The name.
        name: String,
        /// What may have been meant.
        hint: String,
    },
    /// Times that make no run.
    #[error(
        "a run of {duration} with {dt} between samples has {samples} samples; from {FEWEST} to {MOST} are possible"
    )]
    Samples {
        /// Its length.
        duration: f64,
        /// Between samples.
        dt: f64,
        /// How many that makes.
        samples: f64,
    },
    /// Ends of a range that is none.
    #[error("the levels of `{name}` go from {from} to {to}: the first is to be the lower one")]
    Range {
        /// Of what.
        name: String,
        /// Its ends.
        from: f64,
        /// The upper one.
        to: f64,
    },
    /// More samples than there are times.
    #[error("{samples} samples are to be taken at {times} times: a smaller --dt makes more of them")]
    Taken {
        /// Samples.
        samples: usize,
        /// Times of the grid.
        times: usize,
    },
    /// A grid that is none, or too fine.
    #[error("times are sought among {times}; from 1 to {most} are possible: change --duration or --dt")]
    Grid {
        /// Times of the grid.
        times: f64,
        /// How many there may be.
        most: f64,
    },
    /// A height or deviation that is none.
    #[error("{what} is {value}; a finite number above 0 is needed")]
    Size {
        /// Of what.
        what: String,
        /// The number.
        value: f64,
    },
    /// An output whose noise is not known.
    #[error(
        "nothing says how large the noise of `{output}` is: say it with --noise {output}=DEVIATION, in the model \
         (`noise {output} = ...;`), or give a result with --from-result"
    )]
    Noise {
        /// The output.
        output: String,
    },
    /// A model all of whose shared parameters are fixed.
    #[error("model `{model}` has no free parameter that runs share: there is nothing to determine")]
    NothingFree {
        /// The model.
        model: String,
    },
}

/// Samples of a run.
const FEWEST: f64 = 20.0;
const MOST: f64 = 200_000.0;

impl Asked {
    /// An input that the model does not have.
    pub fn unknown(model: &Model, name: &str) -> Self {
        let names = model.definition().inputs.iter().map(|i| i.quantity.name.as_str());
        let hint = nearest(name, names).map_or(String::new(), |h| format!("; did you mean `{h}`?"));
        Self::Unknown { name: name.into(), hint }
    }
}

impl Question<'_> {
    /// Number of samples of the next run.
    pub(super) fn samples(&self) -> usize {
        (self.duration / self.dt).round() as usize + 1
    }

    /// Everything that makes it impossible to answer.
    ///
    /// # Errors
    /// All of [`Asked`] that holds.
    pub(super) fn examine(&self) -> Result<(), Vec<Asked>> {
        let definition = self.model.definition();
        let mut found = Vec::new();
        // what a run brings stays as it is
        let mut moved = definition.inputs.iter().filter(|i| !i.known);
        match moved.next() {
            None => found.push(Asked::NoInput { model: definition.name.clone() }),
            Some(first) if self.heights.iter().all(Option::is_none) => {
                found.push(Asked::Still { input: first.quantity.name.clone() });
            }
            Some(_) => {}
        }
        let samples = self.duration / self.dt + 1.0;
        if !(FEWEST..=MOST).contains(&samples) {
            found.push(Asked::Samples { duration: self.duration, dt: self.dt, samples: samples.round() });
        }
        let bad = |v: f64| !(v.is_finite() && v > 0.0);
        for (input, rate) in definition.inputs.iter().zip(&self.rates) {
            let what = format!("the fastest motion of `{}`", input.quantity.name);
            found.extend(rate.filter(|v| bad(*v)).map(|value| Asked::Size { what, value }));
        }
        for (input, height) in definition.inputs.iter().zip(&self.heights) {
            let value = height.unwrap_or(1.0).abs();
            let what = format!("the height of `{}`", input.quantity.name);
            found.extend(bad(value).then_some(Asked::Size { what, value }));
        }
        found.extend(self.examine_parts());
        if found.is_empty() { Ok(()) } else { Err(found) }
    }

    /// What is wrong whatever is planned.
    pub(super) fn examine_parts(&self) -> Vec<Asked> {
        let definition = self.model.definition();
        let hidden = definition.inputs.iter().filter(|i| !i.is_declared());
        let mut found: Vec<Asked> = hidden.map(|i| Asked::Hidden { input: i.quantity.name.clone() }).collect();
        let bad = |v: f64| !(v.is_finite() && v > 0.0);
        for (output, limit) in definition.outputs.iter().zip(&self.limits) {
            let what = format!("the limit of `{}`", output.quantity.name);
            found.extend(limit.filter(|v| bad(*v)).map(|value| Asked::Size { what, value }));
        }
        for (output, value) in definition.outputs.iter().zip(&self.deviations) {
            let what = format!("the noise of `{}`", output.quantity.name);
            found.extend(bad(*value).then_some(Asked::Size { what, value: *value }));
        }
        if !definition.params.iter().any(|p| !p.fixed && !p.per_run) {
            found.push(Asked::NothingFree { model: definition.name.clone() });
        }
        found
    }

    /// A run whose inputs stay where they are (m), without a measurement: every output counts at every sample.
    pub(super) fn resting(&self, name: &str, inputs: &[f64]) -> Run {
        let definition = self.model.definition();
        let (n, m, q) = (self.samples(), definition.inputs.len(), definition.outputs.len());
        let known = self.known.first().map(|(run, _)| run);
        Run {
            name: name.into(),
            time: (0..n).map(|k| self.dt * k as f64).collect(),
            inputs: inputs.repeat(n),
            held: known.map_or_else(|| vec![false; m], |run| run.held.clone()),
            measured: vec![0.0; n * q],
            input_gaps: vec![0; m],
            stated: known.map_or_else(Vec::new, |run| run.stated.clone()),
            output_gaps: vec![0; q],
        }
    }

    /// Times and inputs of a run as columns.
    pub(super) fn columns(&self, run: &Run, name: &str) -> Table {
        let definition = self.model.definition();
        let m = definition.inputs.len();
        let mut columns = vec![("t".to_string(), Some(definition.time.to_string()), run.time.clone())];
        for (k, input) in definition.inputs.iter().enumerate() {
            let unit = input.quantity.unit.as_ref().map(ToString::to_string);
            columns.push((input.quantity.name.clone(), unit, run.inputs.iter().skip(k).step_by(m).copied().collect()));
        }
        Table { name: name.into(), columns }
    }
}

/// Part of the run before anything moves.
const LEAD: f64 = 0.05;
/// Lengths of each form, by equal factors.
const LENGTHS: usize = 8;
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
    // samples of the shortest unit
    let (first, last) = (2.0, longest * question.duration / question.dt);
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
    let (n, m) = (question.samples(), definition.inputs.len());
    let place = definition.inputs.iter().position(|i| i.quantity.name == manoeuvre.input)?;
    // nothing here is by chance
    let mut chance = Stream::named(0, &[]);
    let mut moved = signal(question, manoeuvre)?.sampled(n, question.dt, None, &definition.time, &mut chance)?;
    if let Some(rate) = question.rates[place] {
        slew(&mut moved, rate * question.dt);
    }
    let mut run = question.resting(&manoeuvre.words("s"), &question.rest);
    for (k, v) in moved.iter().enumerate() {
        run.inputs[k * m + place] += v;
    }
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
        match exceeded(question, &excursions) {
            None => return Ok(Kept { manoeuvre: own, told, excursions }),
            Some(over) => reason = over,
        }
    }
    Err(reason)
}

/// The limit that outputs leave when they move so far (q), in words.
pub(super) fn exceeded(question: &Question<'_>, excursions: &[f64]) -> Option<String> {
    let outputs = question.model.definition().outputs.iter().zip(excursions).zip(&question.limits);
    let (o, moved, limit) = outputs
        .filter_map(|((o, moved), limit)| Some((o, moved, (*limit)?)))
        .find(|(_, moved, limit)| **moved > *limit)?;
    Some(format!("`{}` moves by {moved:.3}, and may by {limit}", o.quantity.name))
}

/// The inputs of the run as columns, ready to be flown.
pub fn table(question: &Question<'_>, manoeuvre: &Manoeuvre, name: &str) -> Option<Table> {
    Some(question.columns(&run(question, manoeuvre)?, name))
}
