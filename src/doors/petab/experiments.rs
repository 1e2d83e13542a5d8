//! What was measured: under which conditions, when, what, and with which noise. Each pair of conditions (before the experiment, in it) is an
//! experiment; observables that measurements read with parameters of their own become outputs of their own.
//!
//! Values that depend on the experiment: what the table of conditions says of a name, before the experiment and in it.

use crate::expression::{Expr, Sign, binary, name};
use crate::formula::formula;
use crate::tables::{Problem, Row, number};
use std::collections::BTreeMap;

/// Conditions that are simulated together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Experiment {
    /// Row of the table of conditions that holds until time 0, where there is one.
    pub(crate) before: Option<usize>,
    /// Row that holds from time 0.
    pub(crate) condition: usize,
    pub(crate) name: String,
}

/// What an output of the model is.
#[derive(Debug)]
pub(crate) struct Output {
    pub(crate) name: String,
    pub(crate) observable: String,
    pub(crate) title: Option<String>,
    pub(crate) formula: Expr,
    pub(crate) noise: Expr,
    pub(crate) scale: Scale,
    /// Numbers that each measurement brings: a column of each record.
    pub(crate) columns: Vec<String>,
}

/// The scale on which numbers are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scale {
    Linear,
    Log,
    Log10,
}

impl Scale {
    /// By its name in PEtab.
    pub(crate) fn find(text: &str) -> Option<Self> {
        match text {
            "lin" => Some(Self::Linear),
            "log" => Some(Self::Log),
            "log10" => Some(Self::Log10),
            _ => None,
        }
    }

    /// A number on this scale.
    pub(crate) fn of(self, value: f64) -> f64 {
        match self {
            Self::Linear => value,
            Self::Log => value.ln(),
            Self::Log10 => value.log10(),
        }
    }

    /// The function of the language that leads to it.
    pub(crate) fn function(self) -> Option<&'static str> {
        match self {
            Self::Linear => None,
            Self::Log => Some("log"),
            Self::Log10 => Some("log10"),
        }
    }

    /// What a measured number adds to the log-likelihood because its density is meant on the linear scale.
    pub(crate) fn jacobian(self, value: f64) -> f64 {
        match self {
            Self::Linear => 0.0,
            Self::Log => -value.ln(),
            Self::Log10 => -(value * std::f64::consts::LN_10).ln(),
        }
    }
}

/// One measured number.
#[derive(Debug)]
pub(crate) struct Measurement {
    pub(crate) experiment: usize,
    pub(crate) output: usize,
    pub(crate) time: f64,
    /// On the scale of the output.
    pub(crate) value: f64,
    /// What stands in the columns of its output.
    pub(crate) brings: Vec<f64>,
}

/// All of it.
#[derive(Debug, Default)]
pub(crate) struct Measured {
    pub(crate) experiments: Vec<Experiment>,
    pub(crate) outputs: Vec<Output>,
    pub(crate) measurements: Vec<Measurement>,
    /// What is added to the log-likelihood of the outputs for that of the measured numbers.
    pub(crate) constant: f64,
}

/// A value that a measurement gives to a parameter of its observable.
#[derive(Debug, Clone, PartialEq)]
enum Override {
    Number(f64),
    Name(String),
}

/// An observable with the measurements that refer to it.
struct Observable<'a> {
    row: &'a Row,
    formula: Expr,
    noise: Expr,
    scale: Scale,
    /// Its parameters: those of the formula, those of the noise.
    parameters: Vec<String>,
}

/// A row of the table of measurements.
struct Read<'a> {
    row: &'a Row,
    experiment: usize,
    /// For each parameter of its observable.
    given: Vec<Override>,
}

/// Measurements of one output.
struct Group<'a> {
    observable: usize,
    /// Names that they give to the parameters of the observable.
    key: Vec<Option<String>>,
    /// In the order of the table.
    rows: Vec<Read<'a>>,
}

/// Splits what a measurement gives: `scale;0.3`.
fn overrides(row: &Row, column: &str) -> Vec<Override> {
    let text = row.get(column).unwrap_or_default();
    let parts = text.split([';', ',']).map(str::trim).filter(|p| !p.is_empty());
    parts.map(|p| number(p).map_or_else(|| Override::Name(p.into()), Override::Number)).collect()
}

impl<'a> Observable<'a> {
    /// Reads a row; `is_taken` says which names the model has.
    fn read(row: &'a Row, is_taken: &dyn Fn(&str) -> bool) -> Result<Self, Vec<String>> {
        let mut wrong = Vec::new();
        let mut read = |column: &str| match row.need(column).and_then(|t| formula(t).map_err(|e| row.says(column, &e)))
        {
            Ok(e) => e,
            Err(e) => {
                wrong.push(e);
                Expr::Number(1.0)
            }
        };
        let (of, noise) = (read("observableFormula"), read("noiseFormula"));
        let text = row.get("observableTransformation").unwrap_or("lin");
        let scale = Scale::find(text).unwrap_or_else(|| {
            wrong.push(row.says("observableTransformation", &format!("`{text}` is not known: lin, log, log10 are")));
            Scale::Linear
        });
        let distribution = row.get("noiseDistribution").unwrap_or("normal");
        if distribution != "normal" {
            let what = format!("noise of the distribution `{distribution}` is not estimated; normal noise is");
            wrong.push(row.says("noiseDistribution", &what));
        }
        let id = row.get("observableId").unwrap_or_default().to_string();
        // the noise may name the observable itself
        let noise = if is_taken(&id) { noise } else { noise.with(&BTreeMap::from([(id.clone(), of.clone())])) };
        let mut parameters = Vec::new();
        for (kind, e) in [("observableParameter", &of), ("noiseParameter", &noise)] {
            let mut count = 0;
            for found in e.names() {
                let place = found.strip_prefix(kind).and_then(|r| r.strip_suffix(&format!("_{id}")));
                count = count.max(place.and_then(|n| n.parse::<usize>().ok()).unwrap_or(0));
            }
            parameters.extend((1..=count.min(1000)).map(|n| format!("{kind}{n}_{id}")));
        }
        if wrong.is_empty() { Ok(Self { row, formula: of, noise, scale, parameters }) } else { Err(wrong) }
    }

    /// What a measurement gives to the parameters, in their order.
    fn given(&self, row: &Row) -> Result<Vec<Override>, String> {
        let mut found = Vec::new();
        for (kind, column) in [("observableParameter", "observableParameters"), ("noiseParameter", "noiseParameters")] {
            let wanted = self.parameters.iter().filter(|p| p.starts_with(kind)).count();
            let given = overrides(row, column);
            if given.len() < wanted {
                let what = format!("{wanted} values are needed for its observable, {} are given", given.len());
                return Err(row.says(column, &what));
            }
            found.extend(given.into_iter().take(wanted));
        }
        Ok(found)
    }

    /// The output that measurements of one kind read, and which parameters are numbers that each of them brings.
    fn output(
        &self,
        key: &[Option<String>],
        rows: &[Read<'_>],
        same: &[&Group<'_>],
        fresh: &mut dyn FnMut(&str) -> String,
    ) -> (Output, Vec<usize>) {
        let id = self.row.get("observableId").unwrap_or_default();
        let told: Vec<&str> = (0..key.len())
            .filter(|k| same.iter().any(|other| other.key[*k] != key[*k]))
            .map(|k| key[k].as_deref().unwrap_or("number"))
            .collect();
        let output_name = fresh(&if told.is_empty() { id.to_string() } else { format!("{id}_{}", told.join("_")) });
        let (mut by, mut columns, mut varying) = (BTreeMap::new(), Vec::new(), Vec::new());
        for (k, parameter) in self.parameters.iter().enumerate() {
            let value = match (&key[k], &rows[0].given[k]) {
                (Some(text), _) => formula(text).unwrap_or_else(|_| name(text)),
                (None, first @ Override::Number(v)) if rows.iter().all(|r| r.given[k] == *first) => Expr::Number(*v),
                (None, _) => {
                    let is_deviation = self.noise == name(parameter);
                    let stem = if is_deviation { "sd" } else { parameter.split('_').next().unwrap_or_default() };
                    let column = fresh(&format!("{stem}_{output_name}"));
                    varying.push(k);
                    columns.push(column.clone());
                    name(&column)
                }
            };
            by.insert(parameter.clone(), value);
        }
        let formula = self.formula.clone().with(&by);
        let formula = match self.scale.function() {
            // samples that nothing is compared with may be 0, and have no logarithm
            // the least number whose logarithm is taken
            Some(function) => Expr::Call(function, vec![Expr::Call("max", vec![formula, Expr::Number(1e-300)])]),
            None => formula,
        };
        let output = Output {
            name: output_name,
            observable: id.into(),
            title: self.row.get("observableName").map(String::from),
            formula,
            noise: self.noise.clone().with(&by),
            scale: self.scale,
            columns,
        };
        (output, varying)
    }
}

/// The part of what measurements give that makes an output of its own: names, not numbers.
fn key(given: &[Override]) -> Vec<Option<String>> {
    let name = |o: &Override| match o {
        Override::Name(name) => Some(name.clone()),
        Override::Number(_) => None,
    };
    given.iter().map(name).collect()
}

/// Reads observables and measurements. `is_taken` says which names the model has, `fresh` makes one out of a wanted one that it may declare.
///
/// # Errors
/// Every row that cannot be read, or means what is not estimated.
pub(crate) fn measured(
    problem: &Problem,
    is_taken: &dyn Fn(&str) -> bool,
    fresh: &mut dyn FnMut(&str) -> String,
) -> Result<Measured, Vec<String>> {
    let (mut all, mut wrong) = (Measured::default(), Vec::new());
    let mut observables: Vec<Observable<'_>> = Vec::new();
    for row in &problem.observables {
        match Observable::read(row, is_taken) {
            Ok(observable) => observables.push(observable),
            Err(e) => wrong.extend(e),
        }
    }
    let mut groups: Vec<Group<'_>> = Vec::new();
    for row in &problem.measurements {
        match placed(problem, row, &observables, &mut all.experiments) {
            Ok((observable, read)) => {
                let key = key(&read.given);
                match groups.iter_mut().find(|g| g.observable == observable && g.key == key) {
                    Some(group) => group.rows.push(read),
                    None => groups.push(Group { observable, key, rows: vec![read] }),
                }
            }
            Err(e) => wrong.push(e),
        }
    }
    // in the order of the table of observables
    groups.sort_by_key(|group| group.observable);
    for Group { observable: o, key, rows } in &groups {
        let Some(observable) = observables.get(*o) else { continue };
        let same: Vec<&Group<'_>> = groups.iter().filter(|other| other.observable == *o).collect();
        let (output, varying) = observable.output(key, rows, &same, fresh);
        let number = all.outputs.len();
        for Read { row, experiment, given } in rows {
            let brings: Vec<f64> = varying
                .iter()
                .map(|k| match given[*k] {
                    Override::Number(v) => v,
                    Override::Name(_) => f64::NAN,
                })
                .collect();
            match numbers(row, observable.scale) {
                Ok((time, value, jacobian)) => {
                    all.constant += jacobian;
                    all.measurements.push(Measurement { experiment: *experiment, output: number, time, value, brings });
                }
                Err(e) => wrong.push(e),
            }
        }
        all.outputs.push(output);
    }
    if problem.measurements.is_empty() && wrong.is_empty() {
        wrong.push("there are no measurements".into());
    }
    if wrong.is_empty() { Ok(all) } else { Err(wrong) }
}

/// Time, number on its scale, and what that scale adds to the log-likelihood.
fn numbers(row: &Row, scale: Scale) -> Result<(f64, f64, f64), String> {
    let (time, value) = (row.number("time")?, row.number("measurement")?);
    if time.is_nan() || time < 0.0 {
        return Err(row.says("time", "a time must be 0 or later"));
    }
    if scale != Scale::Linear && value <= 0.0 {
        return Err(row.says("measurement", &format!("{value} has no logarithm, which its observable asks for")));
    }
    Ok((time, scale.of(value), scale.jacobian(value)))
}

/// The observable of a measurement, its experiment, and what it gives.
fn placed<'a>(
    problem: &Problem,
    row: &'a Row,
    observables: &[Observable<'_>],
    experiments: &mut Vec<Experiment>,
) -> Result<(usize, Read<'a>), String> {
    let id = row.need("observableId")?;
    let observable = observables.iter().position(|o| o.row.get("observableId") == Some(id));
    let observable = observable.ok_or_else(|| row.says("observableId", &format!("there is no observable `{id}`")))?;
    let condition = |column: &str, id: &str| {
        let found = problem.conditions.iter().position(|c| c.get("conditionId") == Some(id));
        found.ok_or_else(|| row.says(column, &format!("there is no condition `{id}`")))
    };
    let id = row.need("simulationConditionId")?;
    let simulated = condition("simulationConditionId", id)?;
    let before = row.get("preequilibrationConditionId");
    let given = observables[observable].given(row)?;
    let name = before.map_or_else(|| id.to_string(), |b| format!("{b}_{id}"));
    let before = before.map(|b| condition("preequilibrationConditionId", b)).transpose()?;
    let same = |e: &Experiment| e.before == before && e.condition == simulated;
    let experiment = experiments.iter().position(same).unwrap_or_else(|| {
        experiments.push(Experiment { before, condition: simulated, name });
        experiments.len() - 1
    });
    Ok((observable, Read { row, experiment, given }))
}

/// A condition that compares time with an expression: the expression, and whether it holds from then on.
pub(crate) fn switch(e: &Expr) -> Option<(Expr, bool)> {
    let Expr::Binary(sign, a, b) = e else { return None };
    if !sign.is_order() {
        return None;
    }
    let later = matches!(sign, Sign::Greater | Sign::AtLeast);
    match (a.has_time(), b.has_time()) {
        (true, false) if **a == Expr::Time => Some(((**b).clone(), later)),
        (false, true) if **b == Expr::Time => Some(((**a).clone(), !later)),
        // t - t0 > 0
        (true, false) => match &**a {
            Expr::Binary(Sign::Subtract, time, from) if **time == Expr::Time => {
                let at = match &**b {
                    Expr::Number(0.0) => (**from).clone(),
                    more => binary(Sign::Add, (**from).clone(), more.clone()),
                };
                Some((at, later))
            }
            _ => None,
        },
        _ => None,
    }
}

/// A value for each experiment: before it, and in it.
pub(crate) type Phases<T> = Vec<[T; 2]>;

/// What a cell of the table of conditions says; nothing where it is empty or NaN.
pub(crate) fn cell(row: &Row, column: &str) -> Option<Expr> {
    let text = row.get(column)?;
    match number(text) {
        Some(value) => Some(Expr::Number(value)),
        None if text.eq_ignore_ascii_case("nan") => None,
        // tables are read with formulas that can be read
        None => Some(formula(text).unwrap_or_else(|_| name(text))),
    }
}

/// What the table says of a name in every experiment.
pub(crate) fn cells(conditions: &[Row], experiments: &[Experiment], column: &str) -> Phases<Option<Expr>> {
    let of = |k: usize| conditions.get(k).and_then(|row| cell(row, column));
    experiments.iter().map(|e| [of(e.before.unwrap_or(e.condition)), of(e.condition)]).collect()
}

/// A column that every run brings: one value, or one before the experiment and one in it.
#[derive(Debug)]
pub(crate) struct Channel {
    pub(crate) name: String,
    pub(crate) about: String,
    pub(crate) values: Phases<f64>,
}

impl Channel {
    /// Whether it changes during a run.
    pub(crate) fn is_input(&self) -> bool {
        self.values.iter().any(|[before, during]| before != during)
    }
}

/// A value that depends on the experiment, as the model writes it: an expression, and the channel that it needs. `fresh` makes the name of a
/// channel out of a wanted one.
pub(crate) fn written(
    id: &str,
    values: &Phases<Expr>,
    fresh: &mut dyn FnMut(&str) -> String,
) -> (Expr, Option<Channel>) {
    let mut distinct: Vec<&Expr> = Vec::new();
    for value in values.iter().flatten() {
        if !distinct.contains(&value) {
            distinct.push(value);
        }
    }
    if let [one] = distinct[..] {
        return (one.clone(), None);
    }
    let plain = |e: &Expr| match e {
        Expr::Number(v) => Some(*v),
        _ => None,
    };
    let numbers: Option<Vec<[f64; 2]>> = values.iter().map(|[a, b]| Some([plain(a)?, plain(b)?])).collect();
    if let Some(values) = numbers {
        let channel = Channel { name: fresh(id), about: String::new(), values };
        return (name(&channel.name), Some(channel));
    }
    let place = |e: &Expr| distinct.iter().position(|d| *d == e).map_or(0.0, |k| (k + 1) as f64);
    let values: Phases<f64> = values.iter().map(|[a, b]| [place(a), place(b)]).collect();
    let channel = fresh(&format!("{id}_choice"));
    let mut branches: Vec<(Expr, Expr)> = Vec::new();
    for (k, value) in distinct.iter().enumerate() {
        let is = binary(Sign::Equal, name(&channel), Expr::Number((k + 1) as f64));
        branches.push(((*value).clone(), is));
    }
    let otherwise = branches.pop().map_or(Expr::Number(0.0), |(value, _)| value);
    let about = format!("which of its values {id} has");
    (Expr::If(branches, Box::new(otherwise)), Some(Channel { name: channel, about, values }))
}
