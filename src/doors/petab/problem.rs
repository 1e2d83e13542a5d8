//! A model with its records as a PEtab problem: the way back ([`problem`]).

use crate::records::File;
use crate::sbml_text::{Sbml, identifiers};
use fdm_grammar::Model;
use fdm_grammar::graph::Signal;
use fdm_grammar::model::{Origin, Param};
use std::fmt::Write;

/// A run of the model.
#[derive(Debug, Clone, Copy)]
pub struct Record<'a> {
    /// Its name.
    pub name: &'a str,
    /// Times of the samples (N), from 0 on.
    pub time: &'a [f64],
    /// Inputs at the samples (N by m), hidden ones included.
    pub inputs: &'a [f64],
    /// Whether an input holds between samples (m).
    pub held: &'a [bool],
    /// Measured outputs (N by q); NaN where there is nothing.
    pub measured: &'a [f64],
    /// Values of all parameters in this run (p).
    pub theta: &'a [f64],
}

/// The noise of an output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Deviation {
    /// What the model says, an expression.
    Stated,
    /// A number that was known.
    Known(f64),
    /// A number that was estimated: it becomes a parameter.
    Open(f64),
}

/// What a PEtab problem has no place for.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Unsuited {
    /// There is nothing to compare with.
    #[error("a problem of PEtab has measurements: give a result (`--from-result DIR`)")]
    NoRuns,
    /// A delay.
    #[error("the model delays `{0}`: PEtab's models are ordinary differential equations")]
    Delay(String),
    /// A hard limit.
    #[error("`{0}` has limits, which SBML has not: write `limit {0} in [a, b] smooth w;`")]
    Limit(String),
    /// Noise in an equation.
    #[error("noise enters `der({0})`, for which PEtab has no place")]
    ProcessNoise(String),
    /// An angle that wraps.
    #[error("`{0}` is compared the short way round, which PEtab does not")]
    Wrap(String),
    /// A parameter of a group of runs.
    #[error("`{0}` has a value for each group of runs: make it `per run`, or one for all")]
    Group(String),
    /// A function that MathML of SBML has not.
    #[error("`{0}` has no counterpart in SBML")]
    Function(&'static str),
    /// An input that is more than a few steps or slopes.
    #[error(
        "the input `{name}` has {pieces} steps or slopes in its records; up to {MOST_PIECES} are written as a choice by time"
    )]
    Input {
        /// The input.
        name: String,
        /// What would have to be written.
        pieces: usize,
    },
}

/// Most pieces of an input in all runs.
const MOST_PIECES: usize = 200;
/// A slope that changes by less than this part of the input's range is none.
const STRAIGHT: f64 = 1e-13;

/// The files of a problem of version 1: YAML, SBML, and four tables.
///
/// `deviations` (q) are those of the outputs, by which the values of `runs` are judged. The name of the YAML is that of the model.
///
/// # Errors
/// [`Unsuited`].
pub fn problem(model: &Model, runs: &[Record<'_>], deviations: &[Deviation]) -> Result<Vec<File>, Unsuited> {
    suited(model)?;
    let first = *runs.first().ok_or(Unsuited::NoRuns)?;
    let ids = identifiers(model);
    let name = ids.model.clone();
    let mut sbml = Sbml::new(model, &ids);
    let conditions = unique(runs.iter().map(|r| r.name));
    let mut columns: Vec<(String, Vec<String>)> = Vec::new();
    let mut parameters = String::from(
        "parameterId\tparameterScale\tlowerBound\tupperBound\tnominalValue\testimate\tobjectivePriorType\tobjectivePriorParameters\n",
    );
    for (k, param) in model.params.iter().enumerate() {
        let id = &ids.params[k];
        let values: Vec<f64> = match param.origin {
            Origin::FirstSample(input) => {
                runs.iter().map(|r| r.inputs.get(input as usize).copied().unwrap_or(f64::NAN)).collect()
            }
            _ => runs.iter().map(|r| r.theta[k]).collect(),
        };
        let own = param.per_run && !matches!(param.origin, Origin::FirstSample(_));
        let varies = values.iter().any(|v| v.to_bits() != values[0].to_bits());
        sbml.constant(id, values[0]);
        if own && runs.len() > 1 && !param.fixed {
            let names: Vec<String> = conditions.iter().map(|c| ids.fresh(&format!("{id}_{c}"))).collect();
            names.iter().zip(&values).for_each(|(name, value)| row(&mut parameters, name, param, *value));
            columns.push((id.clone(), names));
        } else if varies {
            columns.push((id.clone(), values.iter().map(|v| number(*v)).collect()));
        } else if !param.is_recorded() {
            row(&mut parameters, id, param, values[0]);
        }
    }
    let inputs: Vec<usize> = (0..model.inputs.len()).filter(|k| ids.inputs[*k].is_some()).collect();
    if runs.len() > 1 && !inputs.is_empty() {
        sbml.constant(&ids.run, 1.0);
        columns.push((ids.run.clone(), (1..=runs.len()).map(|k| k.to_string()).collect()));
    }
    for k in inputs {
        let pieces: Vec<Vec<Piece>> = runs.iter().map(|run| pieces(run, k)).collect();
        let count = pieces.iter().map(Vec::len).sum();
        if count > MOST_PIECES {
            return Err(Unsuited::Input { name: model.inputs[k].quantity.name.clone(), pieces: count });
        }
        let id = ids.inputs[k].clone().unwrap_or_default();
        sbml.input(&id, &pieces, (runs.len() > 1).then_some(ids.run.as_str()));
    }
    let mut observables = String::from("observableId\tobservableFormula\tnoiseFormula\n");
    for o in 0..model.outputs.len() {
        let (id, formula) = (&ids.outputs[o], sbml.output(o)?);
        let noise = match deviations.get(o).copied().unwrap_or(Deviation::Stated) {
            Deviation::Known(value) => number(value),
            Deviation::Stated => sbml.noise(o)?,
            Deviation::Open(value) => {
                // a perfect match has no deviation, and still a logarithm
                let (own, value) = (ids.fresh(&format!("sd_{id}")), value.max(f64::MIN_POSITIVE.sqrt()));
                let _ = writeln!(
                    parameters,
                    "{own}\tlog10\t{}\t{}\t{}\t1\t\t",
                    number(1e-4 * value),
                    number(1e4 * value),
                    number(value)
                );
                own
            }
        };
        let _ = writeln!(observables, "{id}\t{formula}\t{noise}");
    }
    let mut measurements = String::from("observableId\tsimulationConditionId\tmeasurement\ttime\n");
    for (run, condition) in runs.iter().zip(&conditions) {
        let q = model.outputs.len().max(1);
        for (time, row) in run.time.iter().zip(run.measured.chunks_exact(q)) {
            for (value, id) in row.iter().zip(&ids.outputs).filter(|(value, _)| !value.is_nan()) {
                let _ =
                    writeln!(measurements, "{id}\t{condition}\t{}\t{}", number(*value), number(*time - first.time[0]));
            }
        }
    }
    let mut table = String::from("conditionId");
    columns.iter().for_each(|(id, _)| table.extend(["\t", id.as_str()]));
    table.push('\n');
    for (k, condition) in conditions.iter().enumerate() {
        table.push_str(condition);
        columns.iter().for_each(|(_, values)| table.extend(["\t", values[k].as_str()]));
        table.push('\n');
    }
    let yaml = "format_version: 1\nparameter_file: parameters.tsv\nproblems:\n- sbml_files: [model.xml]\n  condition_files: [conditions.tsv]\n  observable_files: [observables.tsv]\n  measurement_files: [measurements.tsv]\n";
    let file = |path: &str, text: String| File { path: path.into(), text };
    Ok(vec![
        file(&format!("{name}.yaml"), yaml.into()),
        file("model.xml", sbml.text()?),
        file("parameters.tsv", parameters),
        file("conditions.tsv", table),
        file("observables.tsv", observables),
        file("measurements.tsv", measurements),
    ])
}

/// A row of the table of parameters.
fn row(table: &mut String, id: &str, param: &Param, value: f64) {
    let scale = if param.logarithmic { "log10" } else { "lin" };
    let (mut lower, upper) = (param.lower, param.upper);
    if param.logarithmic && lower <= 0.0 {
        lower = f64::MIN_POSITIVE;
    }
    let (kind, prior) = match param.prior.filter(|_| !param.fixed) {
        Some(p) if param.logarithmic => ("normal", format!("{};{}", number(p.mean), number(p.deviation))),
        Some(p) => ("parameterScaleNormal", format!("{};{}", number(p.mean), number(p.deviation))),
        None => ("", String::new()),
    };
    let estimated = u8::from(!param.fixed);
    let _ = writeln!(
        table,
        "{id}\t{scale}\t{}\t{}\t{}\t{estimated}\t{kind}\t{prior}",
        number(lower),
        number(upper),
        number(value)
    );
}

/// What is refused whatever the records.
fn suited(model: &Model) -> Result<(), Unsuited> {
    let delayed = model.graph.delayed().first().map(|d| match d.signal {
        Signal::State(k) => model.states[k as usize].quantity.name.clone(),
        Signal::Input(k) => model.inputs[k as usize].quantity.name.clone(),
    });
    if let Some(name) = delayed {
        return Err(Unsuited::Delay(name));
    }
    let state = |found: Option<&fdm_grammar::model::State>| found.map(|s| s.quantity.name.clone());
    if let Some(name) = state(model.states.iter().find(|s| s.limits.is_some())) {
        return Err(Unsuited::Limit(name));
    }
    if let Some(name) = state(model.states.iter().find(|s| s.noise.is_some())) {
        return Err(Unsuited::ProcessNoise(name));
    }
    if let Some(output) = model.outputs.iter().find(|o| o.wrap.is_some()) {
        return Err(Unsuited::Wrap(output.quantity.name.clone()));
    }
    match model.params.iter().find(|p| p.group.is_some()) {
        Some(param) => Err(Unsuited::Group(param.quantity.name.clone())),
        None => Ok(()),
    }
}

/// An input from one time to the next: its value there, and its slope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Piece {
    pub(crate) from: f64,
    pub(crate) value: f64,
    pub(crate) slope: f64,
}

/// The pieces of an input of a run; neighbours in one line are one.
fn pieces(run: &Record<'_>, input: usize) -> Vec<Piece> {
    let m = run.held.len().max(1);
    let at = |k: usize| run.inputs[k * m + input];
    let range = (0..run.time.len())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), k| (low.min(at(k)), high.max(at(k))));
    let small = STRAIGHT * (range.1 - range.0).abs().max(f64::MIN_POSITIVE);
    let mut found: Vec<Piece> = Vec::new();
    for k in 0..run.time.len() {
        let (from, value) = (run.time[k], at(k));
        let slope = match run.time.get(k + 1) {
            Some(next) if !run.held[input] => (at(k + 1) - value) / (next - from),
            _ => 0.0,
        };
        let goes_on = found.last().is_some_and(|last| {
            let h = run.time.get(k + 1).map_or(1.0, |next| next - from);
            (last.value + last.slope * (from - last.from) - value).abs() <= small
                && (slope - last.slope).abs() * h <= small
        });
        // the last sample only ends a piece
        let ends = k + 1 == run.time.len() && !found.is_empty() && (!run.held[input] || goes_on);
        if !goes_on && !ends {
            found.push(Piece { from, value, slope });
        }
    }
    found
}

/// Names as PEtab's tables take them, each once.
fn unique<'a>(names: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut taken = crate::expression::Names::default();
    names.map(|name| taken.fresh(name)).collect()
}

/// A number that is read back to the bit.
pub(crate) fn number(value: f64) -> String {
    match value {
        f64::INFINITY => "inf".into(),
        f64::NEG_INFINITY => "-inf".into(),
        value => crate::expression::number(value),
    }
}
