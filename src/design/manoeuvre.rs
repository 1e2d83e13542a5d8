//! A manoeuvre that could be flown: one input moves, the others stand.

use super::question::Question;
use crate::experiment::{Amount, Law, Normal, Signal, Table};
use crate::record::Run;
use serde::Serialize;

/// One input, moved in one way.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Manoeuvre {
    /// The input's name.
    pub input: String,
    /// The form: `step`, `doublet`, `3211` or `sweep`.
    pub form: &'static str,
    /// Half of a doublet, or one of the 3211's units of time; none of the others.
    pub unit: Option<f64>,
    /// First and last frequency of a sweep.
    pub band: Option<[f64; 2]>,
    /// How far the input moves.
    pub height: f64,
    #[serde(skip)]
    pub(super) place: usize,
    #[serde(skip)]
    signal: Signal,
}

impl Manoeuvre {
    /// A step after `at`.
    pub(super) fn step(input: &str, place: usize, height: f64, at: f64) -> Self {
        let signal = Signal::Step { at, height: Amount { value: height, unit: None } };
        Self { input: input.into(), form: "step", unit: None, band: None, height, place, signal }
    }

    /// Up and down.
    pub(super) fn doublet(input: &str, place: usize, height: f64, at: f64, half: f64) -> Self {
        let signal = Signal::Doublet { at, height: Amount { value: height, unit: None }, half };
        Self { input: input.into(), form: "doublet", unit: Some(half), band: None, height, place, signal }
    }

    /// Three, two, one and one units, up and down in turn.
    pub(super) fn three_two_one_one(input: &str, place: usize, height: f64, at: f64, unit: f64) -> Self {
        let signal = Signal::ThreeTwoOneOne { at, height: Amount { value: height, unit: None }, unit };
        Self { input: input.into(), form: "3211", unit: Some(unit), band: None, height, place, signal }
    }

    /// A sine through a band.
    pub(super) fn sweep(input: &str, place: usize, height: f64, (at, length): (f64, f64), band: [f64; 2]) -> Self {
        let signal = Signal::Sweep { at, length, band, height: Amount { value: height, unit: None }, law: Law::Log };
        Self { input: input.into(), form: "sweep", unit: None, band: Some(band), height, place, signal }
    }

    /// In words; `time` is the unit of time.
    pub fn words(&self, time: &str) -> String {
        let short = |v: f64| format!("{:.3}", v).trim_end_matches('0').trim_end_matches('.').to_string();
        match (self.unit, self.band) {
            (Some(unit), _) => format!("{} of {} {time}", self.form, short(unit)),
            (_, Some([low, high])) => format!("{} {} to {} 1/{time}", self.form, short(low), short(high)),
            _ => self.form.into(),
        }
    }

    /// The run that it makes, without a measurement: every output counts at every sample.
    pub(super) fn run(&self, question: &Question<'_>) -> Option<Run> {
        let definition = question.model.definition();
        let (n, m, q) = (question.samples(), definition.inputs.len(), definition.outputs.len());
        // nothing here is by chance
        let mut chance = Normal::new(0, &[]);
        let moved = self.signal.sampled(n, question.dt, None, &definition.time, &mut chance)?;
        let mut inputs: Vec<f64> = (0..n).flat_map(|_| question.rest.iter().copied()).collect();
        for (k, v) in moved.iter().enumerate() {
            inputs[k * m + self.place] += v;
        }
        Some(Run {
            name: self.words("s"),
            time: (0..n).map(|k| question.dt * k as f64).collect(),
            inputs,
            held: question.known.first().map_or_else(|| vec![false; m], |(run, _)| run.held.clone()),
            measured: vec![0.0; n * q],
            input_gaps: vec![0; m],
            output_gaps: vec![0; q],
        })
    }

    /// The inputs of the run as columns, ready to be flown.
    pub fn table(&self, question: &Question<'_>, name: &str) -> Option<Table> {
        let definition = question.model.definition();
        let run = self.run(question)?;
        let m = definition.inputs.len();
        let mut columns = vec![("t".to_string(), Some(definition.time.to_string()), run.time)];
        for (k, input) in definition.inputs.iter().enumerate() {
            let unit = input.quantity.unit.as_ref().map(ToString::to_string);
            columns.push((input.quantity.name.clone(), unit, run.inputs.iter().skip(k).step_by(m).copied().collect()));
        }
        Some(Table { name: name.into(), columns })
    }
}
