//! Records made by a model: its inputs move as described, its outputs get noise.
//!
//! A record as columns: what is written to a file, and what a model's runs are read from.

use super::closed_loop::{Loop, closed};
use super::description::{Experiment, Record};
use super::experiment_error::{ExperimentError, Fault};
use super::signal::Noise;
use super::signal::Signal;
use fdm_grammar::model::Quantity;
use fdm_numeric::random::Stream;
use fdm_results::store::{reason, write_file};
use fdm_system::Model;
use fdm_system::record::{Channel, Channels, Column, Dialect, ReadOptions, Run, read, write_to};
use fdm_system::simulate::{Simulator, StepOptions, choose_steps};
use std::path::{Path, PathBuf};

/// The tables of a record that is made: one, or one for each segment.
///
/// # Errors
/// [`ExperimentError`], for models, names and signals that do not fit, and for a truth that runs away.
pub(super) fn flown(experiment: &Experiment, record: &Record, truth: &str) -> Result<Vec<Table>, ExperimentError> {
    let Some(copies) = record.copies else { return once(experiment, record, truth) };
    let copy = |k: u32| {
        let name = format!("{}_{}", record.name, k + 1);
        let seed = record.seed.wrapping_mul(1 << 32).wrapping_add(u64::from(k));
        once(experiment, &Record { name, seed, ..record.clone() }, truth)
    };
    let copies: Result<Vec<Vec<Table>>, _> = (0..copies).map(copy).collect();
    Ok(copies?.into_iter().flatten().collect())
}

/// One flight.
fn once(experiment: &Experiment, record: &Record, truth: &str) -> Result<Vec<Table>, ExperimentError> {
    let truth = Model::from_file(experiment.folder.join(truth))?;
    let flight = Flight { experiment, record, truth: &truth };
    let whole = match &record.controller {
        None => flight.open()?,
        Some(controller) => {
            let controller = Model::from_file(experiment.folder.join(controller))?;
            flight.closed(&controller)?
        }
    };
    let Some(segments) = &record.segments else { return Ok(vec![whole]) };
    let count = (segments.length / record.dt).round() as usize + 1;
    let first = |begin: &f64| (begin / record.dt).round() as usize;
    let cut = |(k, begin): (usize, &f64)| whole.part(format!("{}_{}", record.name, k + 1), first(begin), count);
    Ok(segments.begin.iter().enumerate().map(cut).collect())
}

/// A record in the making.
pub(super) struct Flight<'a> {
    experiment: &'a Experiment,
    pub(super) record: &'a Record,
    pub(super) truth: &'a Model,
}

impl Flight<'_> {
    /// Number of samples.
    pub(super) fn samples(&self) -> usize {
        (self.record.duration / self.record.dt).round() as usize + 1
    }

    pub(super) fn fault(&self, fault: Fault) -> ExperimentError {
        ExperimentError::Flight { record: self.record.name.clone(), fault }
    }

    /// Parameters of the truth.
    pub(super) fn theta(&self) -> Result<Vec<f64>, ExperimentError> {
        let definition = self.truth.definition();
        let mut theta = definition.start();
        for (name, value) in &self.record.values {
            let known = || definition.params.iter().map(|p| p.quantity.name.as_str());
            let place = definition.param(name);
            let k = place.ok_or_else(|| self.fault(Fault::unknown("`values`", "parameter", name, known())))?;
            theta[k] = *value;
        }
        Ok(theta)
    }

    /// What moves an input; `None` when nothing is said about it.
    pub(super) fn input(&self, quantity: &Quantity) -> Result<Option<Vec<f64>>, ExperimentError> {
        let Some(signals) = self.record.inputs.get(&quantity.name) else { return Ok(None) };
        let (n, dt) = (self.samples(), self.record.dt);
        let mut sum = vec![0.0; n];
        for (k, signal) in signals.iter().enumerate() {
            if let Signal::Record { file, column } = signal {
                let values = self.recorded(file, column, quantity)?;
                sum.iter_mut().zip(values).for_each(|(s, v)| *s += v);
                continue;
            }
            let number = k.to_string();
            let mut names: Vec<&str> = vec![&self.experiment.name, &self.record.name, &quantity.name, &number];
            // what is commanded is the same in all repeats
            names.extend(self.record.repeat.as_deref().filter(|_| matches!(signal, Signal::Chance { .. })));
            let mut chance = Stream::named(self.record.seed, &names);
            let time = &self.truth.definition().time;
            let values = signal.sampled(n, dt, quantity.unit.as_ref(), time, &mut chance);
            let wrong = || Fault::Unit { place: format!("input `{}`", quantity.name), what: "a signal" };
            let values = values.ok_or_else(|| self.fault(wrong()))?;
            sum.iter_mut().zip(values).for_each(|(s, v)| *s += v);
        }
        Ok(Some(sum))
    }

    /// A column of a record at the samples, in the unit of the input.
    fn recorded(&self, file: &str, column: &str, quantity: &Quantity) -> Result<Vec<f64>, ExperimentError> {
        let channel = Channel::new(quantity.name.clone(), quantity.unit.clone());
        let time = self.truth.definition().time.clone();
        let (inputs, none) = (vec![channel], Vec::new());
        let wanted = Channels {
            time,
            timed: true,
            samples: 2,
            inputs,
            outputs: none,
            driving: Vec::new(),
            slopes: Vec::new(),
            begins_anywhere: None,
        };
        let map = vec![(quantity.name.clone(), column.to_string())];
        let (run, _) =
            read(&self.experiment.folder.join(file), &wanted, &ReadOptions { map, ..ReadOptions::default() })?;
        Ok((0..self.samples()).map(|k| run.input_at(0, self.record.dt * k as f64).0).collect())
    }

    /// Every name under `inputs` and `noise` is one of these.
    pub(super) fn known(&self, inputs: &[&str], outputs: &[&str]) -> Result<(), ExperimentError> {
        for (place, what, names, known) in [
            ("`inputs`", "input", self.record.inputs.keys().collect::<Vec<_>>(), inputs),
            ("`noise`", "output", self.record.noise.keys().filter(|n| *n != "all").collect(), outputs),
        ] {
            if let Some(name) = names.into_iter().find(|n| !known.contains(&n.as_str())) {
                return Err(self.fault(Fault::unknown(place, what, name, known.iter().copied())));
            }
        }
        Ok(())
    }

    /// The noise of an output, and where it comes from.
    pub(super) fn noise(&self, output: &str) -> Option<(Noise, Stream)> {
        let noise = self.record.noise.get(output).or_else(|| self.record.noise.get("all"))?;
        let mut names = vec![self.experiment.name.as_str(), &self.record.name, output, "noise"];
        names.extend(self.record.repeat.as_deref());
        Some((*noise, Stream::named(self.record.seed, &names)))
    }

    fn open(&self) -> Result<Table, ExperimentError> {
        let definition = self.truth.definition();
        let (n, m, q) = (self.samples(), self.truth.layout().inputs, definition.outputs.len());
        let inputs: Vec<&Quantity> = definition.inputs.iter().map(|i| &i.quantity).collect();
        let outputs: Vec<&Quantity> = definition.outputs.iter().map(|o| &o.quantity).collect();
        self.known(&names(&inputs), &names(&outputs))?;
        if let Some(hidden) = definition.inputs.iter().find(|i| !i.is_declared()) {
            return Err(self.fault(Fault::NotInLoop { name: hidden.quantity.name.clone() }));
        }
        let mut moved = Vec::new();
        for input in &inputs {
            let values = self.input(input)?;
            moved.push(values.ok_or_else(|| self.fault(Fault::Unfed { input: input.name.clone() }))?);
        }
        let run = Run {
            name: self.record.name.clone(),
            time: (0..n).map(|k| self.record.dt * k as f64).collect(),
            inputs: (0..n).flat_map(|k| moved.iter().map(move |values| values[k])).collect(),
            held: vec![false; m],
            measured: vec![f64::NAN; n * q],
            input_gaps: vec![0; m],
            stated: Vec::new(),
            output_gaps: vec![0; q],
        };
        let response = self.response(&run)?;
        let mut table = self.table(run.time);
        for (input, values) in inputs.iter().zip(moved) {
            table.columns.push((input.name.clone(), unit(input), values));
        }
        for (o, output) in outputs.iter().enumerate() {
            let mut values: Vec<f64> = response.iter().skip(o).step_by(q).copied().collect();
            if let Some((noise, mut chance)) = self.noise(&output.name) {
                noise.add(&mut values, self.record.dt, &mut chance);
            }
            if let Some(digits) = self.record.digits {
                values.iter_mut().for_each(|v| *v = rounded(*v, digits));
            }
            table.columns.push((output.name.clone(), unit(output), values));
        }
        Ok(table)
    }

    fn response(&self, run: &Run) -> Result<Vec<f64>, ExperimentError> {
        let theta = self.theta()?;
        let name = || self.record.name.clone();
        let unsuited = |reason| ExperimentError::Unsuited { record: name(), reason };
        let dynamics = self.truth.dynamics();
        let steps = match self.record.steps {
            Some(steps) => steps.into(),
            None => choose_steps(dynamics, run, &theta, &StepOptions::default()).map_err(unsuited)?.steps,
        };
        let mut response = vec![0.0; run.measured.len()];
        let mut simulator = Simulator::new(dynamics, run, steps).map_err(unsuited)?;
        let simulated = simulator.simulate(&theta, &mut response);
        simulated.map_err(|reason| ExperimentError::Diverged { record: name(), reason })?;
        Ok(response)
    }

    fn closed(&self, controller: &Model) -> Result<Table, ExperimentError> {
        let Loop { time, columns } = closed(self, controller)?;
        let mut table = self.table(time);
        table.columns.extend(columns);
        Ok(table)
    }

    fn table(&self, time: Vec<f64>) -> Table {
        let clock = ("t".to_string(), Some(self.truth.definition().time.to_string()), time);
        Table { name: self.record.name.clone(), columns: vec![clock] }
    }
}

pub(super) fn names<'q>(quantities: &[&'q Quantity]) -> Vec<&'q str> {
    quantities.iter().map(|q| q.name.as_str()).collect()
}

pub(super) fn unit(quantity: &Quantity) -> Option<String> {
    quantity.unit.as_ref().map(ToString::to_string)
}

/// With so many significant digits.
pub(super) fn rounded(value: f64, digits: usize) -> f64 {
    format!("{value:.*e}", digits.clamp(1, 17) - 1).parse().unwrap_or(value)
}

/// The columns of a record that was made.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Name of the record, and of its file.
    pub name: String,
    /// Name, unit and values of each column; the time is the first.
    pub columns: Vec<(String, Option<String>, Vec<f64>)>,
}

impl Table {
    /// The samples `first..first + count`, with a clock of their own.
    #[must_use]
    pub fn part(&self, name: String, first: usize, count: usize) -> Self {
        let cut = |values: &[f64]| {
            let end = values.len().min(first + count);
            values[first.min(end)..end].to_vec()
        };
        let mut columns: Vec<_> = self.columns.iter().map(|(n, u, v)| (n.clone(), u.clone(), cut(v))).collect();
        if let Some((_, _, time)) = columns.first_mut()
            && let Some(begin) = time.first().copied()
        {
            time.iter_mut().for_each(|t| *t -= begin);
        }
        Self { name, columns }
    }

    /// The name of its file.
    pub fn file(&self) -> String {
        format!("{}.csv", self.name.replace([' ', '/'], "_"))
    }

    /// What its file holds.
    ///
    /// # Panics
    /// When columns differ in length.
    pub fn bytes(&self) -> Vec<u8> {
        let mut columns = Vec::with_capacity(self.columns.len());
        for (name, unit, values) in &self.columns {
            columns.push(Column { name, unit: unit.as_deref(), values });
        }
        let mut bytes = Vec::new();
        // memory takes everything that is written to it
        let _ = write_to(&mut bytes, Dialect::default(), &columns);
        bytes
    }

    /// Writes the record to a folder and says where.
    ///
    /// # Errors
    /// [`ExperimentError::Unwritable`]; a file that stood there before stands there still then.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, ExperimentError> {
        let path = folder.join(self.file());
        match write_file(&path, &self.bytes()) {
            Ok(()) => Ok(path),
            Err(e) => Err(ExperimentError::Unwritable { reason: reason(&e), file: path }),
        }
    }
}
