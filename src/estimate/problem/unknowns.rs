//! The vector of unknowns: shared free parameters first, then for every run its own copies of the per-run ones.
//!
//! A search may take the logarithm of a positive parameter for its unknown ([`Unknowns::searched`]); what follows from the values
//! that were found (standard errors, bounds) is of the parameters themselves.
//!
//! Quantities that follow from the parameters, with standard errors by the delta method.
//!
//! What a user changes about a model's parameters before an estimation: start values, fixing, freeing.

use crate::problem::Problem;
use fdm_grammar::diagnostic::nearest;
use fdm_grammar::graph::Leaf;
use fdm_grammar::model::{Model, Param};
use fdm_numeric::elementary::{exp, log};
use fdm_system::dynamics::{Dynamics, Workspace};
use serde::Serialize;
use std::fmt;

/// What is estimated, as it is called while the estimation works.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnknownName {
    /// The parameter.
    pub name: String,
    /// The run that it belongs to; none when all runs share it.
    pub run: Option<String>,
    /// Its unit, as text.
    pub unit: Option<String>,
}

/// Which entry of the vector is which parameter of which run.
#[derive(Debug, Clone)]
pub(crate) struct Unknowns {
    /// Indices into theta of what every run depends on: shared ones, then its own.
    pub(crate) columns: Vec<usize>,
    /// How many of the columns are shared.
    pub(crate) shared: usize,
    /// Number of runs.
    pub(crate) runs: usize,
    /// Least admissible value of each unknown.
    pub(crate) lower: Vec<f64>,
    /// Greatest admissible value of each unknown.
    pub(crate) upper: Vec<f64>,
    /// Start value of each unknown.
    pub(crate) start: Vec<f64>,
    /// Unknowns in which all responses are jointly affine.
    pub(crate) affine: Vec<usize>,
    /// Unknowns that are held because nothing determines them.
    pub(crate) held: Vec<usize>,
    /// All parameters of each run at the start (runs by p).
    pub(crate) theta: Vec<Vec<f64>>,
    /// Bounds of the parameter behind each unknown that is its logarithm; empty where all unknowns are parameters.
    logarithms: Vec<Option<(f64, f64)>>,
}

impl Unknowns {
    pub(crate) fn new(problem: &Problem<'_>) -> Self {
        let pick = |per_run: bool| {
            let chosen = problem.params.iter().enumerate().filter(move |(_, p)| !p.fixed && p.per_run == per_run);
            chosen.map(|(k, _)| k)
        };
        let mut columns: Vec<usize> = pick(false).collect();
        let shared = columns.len();
        columns.extend(pick(true));
        let theta: Vec<Vec<f64>> = problem
            .runs
            .iter()
            .map(|run| {
                let own = |k: usize| run.start.get(k).copied();
                let params = problem.params.iter().enumerate();
                params.map(|(k, p)| own(k).filter(|_| p.per_run).unwrap_or(p.value)).collect()
            })
            .collect();
        let mut unknowns = Self {
            columns,
            shared,
            runs: problem.runs.len(),
            lower: Vec::new(),
            upper: Vec::new(),
            start: Vec::new(),
            affine: Vec::new(),
            held: Vec::new(),
            theta,
            logarithms: Vec::new(),
        };
        for g in 0..unknowns.len() {
            let (run, k) = unknowns.owner(g);
            unknowns.lower.push(problem.params[k].lower);
            unknowns.upper.push(problem.params[k].upper);
            if problem.affine.contains(&k) {
                unknowns.affine.push(g);
            }
            unknowns.start.push(unknowns.theta[run.unwrap_or(0)][k]);
        }
        unknowns
    }

    /// Holds an unknown at a value.
    pub(crate) fn pin(&mut self, unknown: usize, value: f64) {
        for of in [&mut self.start, &mut self.lower, &mut self.upper] {
            of[unknown] = value;
        }
        self.affine.retain(|g| *g != unknown);
        self.held.push(unknown);
    }

    /// These unknowns with the logarithms of the parameters that are declared so; none where there are none.
    pub(crate) fn searched(&self, problem: &Problem<'_>) -> Option<Self> {
        let is_log = |g: usize| problem.params[self.owner(g).1].logarithmic;
        if !(0..self.len()).any(is_log) {
            return None;
        }
        let mut searched = self.clone();
        searched.logarithms =
            (0..self.len()).map(|g| is_log(g).then(|| (self.lower[g].max(0.0), self.upper[g]))).collect();
        for g in (0..self.len()).filter(|g| is_log(*g)) {
            searched.lower[g] = log(self.lower[g].max(0.0));
            searched.upper[g] = log(self.upper[g]);
            searched.start[g] = log(self.start[g]).clamp(searched.lower[g], searched.upper[g]);
        }
        // a response that is affine in a parameter is not so in its logarithm
        searched.affine.retain(|g| !is_log(*g));
        Some(searched)
    }

    /// The parameter behind an unknown with this value.
    fn parameter(&self, unknown: usize, value: f64) -> f64 {
        match self.logarithms.get(unknown) {
            // the exponential of a bound's logarithm may lie beside the bound by rounding
            Some(Some((_, upper))) if value >= log(*upper) => *upper,
            Some(Some((lower, _))) if value <= log(*lower) => *lower,
            Some(Some((lower, upper))) => exp(value).clamp(*lower, *upper),
            _ => value,
        }
    }

    /// An unknown with this value once its parameter is `factor` times as large.
    pub(crate) fn scaled(&self, unknown: usize, value: f64, factor: f64) -> f64 {
        if matches!(self.logarithms.get(unknown), Some(Some(_))) { value + log(factor) } else { value * factor }
    }

    /// The parameters behind all unknowns.
    pub(crate) fn parameters(&self, values: &[f64]) -> Vec<f64> {
        values.iter().enumerate().map(|(g, value)| self.parameter(g, *value)).collect()
    }

    /// Derivative of each parameter by its unknown; empty where all are 1.
    pub(crate) fn slopes(&self, values: &[f64]) -> Vec<f64> {
        let slope = |(logarithm, value): (&Option<_>, &f64)| if logarithm.is_some() { exp(*value) } else { 1.0 };
        self.logarithms.iter().zip(values).map(slope).collect()
    }

    /// Number of unknowns.
    pub(crate) fn len(&self) -> usize {
        self.shared + self.runs * self.own()
    }

    /// How many unknowns each run has for itself.
    fn own(&self) -> usize {
        self.columns.len() - self.shared
    }

    /// The unknown behind a column of a run.
    pub(crate) fn position(&self, run: usize, column: usize) -> usize {
        if column < self.shared { column } else { column + run * self.own() }
    }

    /// The run that an unknown belongs to (none when shared) and its parameter.
    pub(crate) fn owner(&self, unknown: usize) -> (Option<usize>, usize) {
        match unknown.checked_sub(self.shared) {
            None => (None, self.columns[unknown]),
            Some(k) => (Some(k / self.own()), self.columns[self.shared + k % self.own()]),
        }
    }

    /// The unknown that holds a parameter of a run, when it is free.
    pub(crate) fn of(&self, run: usize, param: usize) -> Option<usize> {
        self.columns.iter().position(|k| *k == param).map(|c| self.position(run, c))
    }

    /// What each unknown is called.
    pub(crate) fn names(&self, problem: &Problem<'_>) -> Vec<UnknownName> {
        let one = |g: usize| {
            let (run, k) = self.owner(g);
            let quantity = &problem.params[k].quantity;
            UnknownName {
                name: quantity.name.clone(),
                run: run.map(|r| problem.runs[r].name.clone()),
                unit: quantity.unit.as_ref().map(ToString::to_string),
            }
        };
        (0..self.len()).map(one).collect()
    }

    /// All parameters of a run (p) at these values of the unknowns.
    pub(crate) fn assembled(&self, run: usize, values: &[f64]) -> Vec<f64> {
        let mut theta = self.theta[run].clone();
        self.assemble(run, values, &mut theta);
        theta
    }

    /// Writes the unknowns into the parameters of a run.
    pub(crate) fn assemble(&self, run: usize, values: &[f64], theta: &mut [f64]) {
        for (c, k) in self.columns.iter().enumerate() {
            let unknown = self.position(run, c);
            theta[*k] = self.parameter(unknown, values[unknown]);
        }
    }
}

/// Name and kind of a derived quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct DerivedName {
    /// Its name.
    pub name: String,
    /// Its unit, as text.
    pub unit: Option<String>,
    /// Whether it depends on a per-run parameter and so has a value in every run.
    pub per_run: bool,
    /// Whether it is a declared parameter that is tied to others.
    pub tied: bool,
}

type Evaluate<'a> = Box<dyn FnMut(&[f64], &mut [f64]) + Send + 'a>;

/// The derived quantities of a model, as a function of all its parameters.
pub struct DerivedQuantities<'a> {
    /// What they are called.
    pub names: Vec<DerivedName>,
    /// Parameters (p) to values (one for each name).
    pub evaluate: Evaluate<'a>,
}

impl<'a> DerivedQuantities<'a> {
    /// No derived quantity.
    pub fn none() -> Self {
        Self { names: Vec::new(), evaluate: Box::new(|_, _| ()) }
    }

    /// Derived quantities that the model declares, computed by its programs.
    pub fn of(model: &Model, dynamics: &'a dyn Dynamics) -> Self {
        let per_run = model.graph.depends(|leaf| matches!(leaf, Leaf::Param(k) if model.params[k as usize].per_run));
        let name = |d: &fdm_grammar::model::Derived| DerivedName {
            name: d.quantity.name.clone(),
            unit: d.quantity.unit.as_ref().map(ToString::to_string),
            per_run: per_run[d.expr.index()],
            tied: d.tied,
        };
        let (mut work, mut known) = (Workspace::new(dynamics), vec![0.0; dynamics.layout().known]);
        let range = dynamics.layout().derived.clone();
        let evaluate = move |theta: &[f64], out: &mut [f64]| {
            dynamics.prepare(theta, &mut known, &mut work);
            out.copy_from_slice(&known[range.clone()]);
        };
        Self { names: model.derived.iter().map(name).collect(), evaluate: Box::new(evaluate) }
    }

    /// Values at `theta` and their gradients by the parameters `columns` (one row for each quantity), by central
    /// differences over a step that balances truncation against rounding (relative error about 1e-10); `size` is the
    /// size of a parameter whose value is zero.
    pub(crate) fn linearise(&mut self, theta: &[f64], columns: &[usize], size: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let count = self.names.len();
        let mut at = |theta: &[f64]| {
            let mut out = vec![0.0; count];
            (self.evaluate)(theta, &mut out);
            out
        };
        let values = at(theta);
        let mut gradients = vec![vec![0.0; columns.len()]; count];
        let mut moved = theta.to_vec();
        for (c, k) in columns.iter().enumerate() {
            let reach = theta[*k].abs().max(size[c]);
            let step = f64::EPSILON.cbrt() * if reach > 0.0 { reach } else { 1.0 };
            let (low, high) = (theta[*k] - step, theta[*k] + step);
            moved[*k] = high;
            let above = at(&moved);
            moved[*k] = low;
            let below = at(&moved);
            moved[*k] = theta[*k];
            for (i, row) in gradients.iter_mut().enumerate() {
                row[c] = (above[i] - below[i]) / (high - low);
            }
        }
        (values, gradients)
    }
}

/// Changes by name, applied in the order: set, fix, free.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Changes {
    /// New start values.
    pub set: Vec<(String, f64)>,
    /// Parameters that are not to be estimated.
    pub fix: Vec<String>,
    /// Parameters that are to be estimated although the model declares them `fixed`.
    pub free: Vec<String>,
}

impl Changes {
    /// Changes the parameters. Says whether one that was `fixed` is now free: the model's programs hold no partials
    /// by fixed parameters, so that its schedule must then be made anew.
    ///
    /// # Errors
    /// All mistakes at once; the parameters are then unchanged.
    pub fn apply(&self, params: &mut [Param]) -> Result<bool, Vec<ChangeError>> {
        let mut mistakes = Vec::new();
        let mut changed = params.to_vec();
        let find = |name: &String, mistakes: &mut Vec<ChangeError>| {
            let place = params.iter().position(|p| p.quantity.name == *name && !p.is_recorded());
            if place.is_none() {
                let known = params.iter().filter(|p| !p.is_recorded()).map(|p| p.quantity.name.as_str());
                let hint = nearest(name, known).map(String::from);
                mistakes.push(ChangeError::Unknown { name: name.clone(), nearest: hint });
            }
            place
        };
        for (name, value) in &self.set {
            let Some(k) = find(name, &mut mistakes) else { continue };
            let others = self.set.iter().filter(|(other, _)| other == name);
            if let Some((_, other)) = others.clone().next_back().filter(|(_, other)| other != value) {
                mistakes.push(ChangeError::SetTwice { name: name.clone(), values: [*value, *other] });
            }
            let (name, value) = (name.clone(), *value);
            let Param { lower, upper, .. } = changed[k];
            if !value.is_finite() {
                mistakes.push(ChangeError::NotFinite { name, value });
            } else if !(lower <= value && value <= upper) {
                mistakes.push(ChangeError::OutsideBounds { name, value, lower, upper });
            }
            changed[k].value = value;
        }
        for name in &self.fix {
            if let Some(k) = find(name, &mut mistakes) {
                changed[k].fixed = true;
            }
            if self.free.contains(name) {
                mistakes.push(ChangeError::FixedAndFree { name: name.clone() });
            }
        }
        let mut freed = false;
        for name in &self.free {
            if let Some(k) = find(name, &mut mistakes) {
                freed |= std::mem::replace(&mut changed[k].fixed, false);
            }
        }
        if !mistakes.is_empty() {
            return Err(mistakes);
        }
        params.clone_from_slice(&changed);
        Ok(freed)
    }
}

/// A change that cannot be made.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs, reason = "the message below each variant says what its fields are")]
pub enum ChangeError {
    Unknown { name: String, nearest: Option<String> },
    NotFinite { name: String, value: f64 },
    OutsideBounds { name: String, value: f64, lower: f64, upper: f64 },
    FixedAndFree { name: String },
    SetTwice { name: String, values: [f64; 2] },
}

impl fmt::Display for ChangeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown { name, nearest: Some(hint) } => {
                write!(f, "the model has no parameter `{name}`; did you mean `{hint}`?")
            }
            Self::Unknown { name, nearest: None } => write!(f, "the model has no parameter `{name}`"),
            Self::NotFinite { name, value } => write!(f, "`{name}` cannot start at {value}"),
            Self::OutsideBounds { name, value, lower, upper } => {
                write!(f, "`{name}` cannot start at {value}: its bounds are [{lower}, {upper}]")
            }
            Self::SetTwice { name, values: [one, other] } => {
                write!(f, "`{name}` is set to {one} and to {other}: give one value")
            }
            Self::FixedAndFree { name } => write!(f, "`{name}` is both to be fixed and to be free"),
        }
    }
}

impl std::error::Error for ChangeError {}

#[cfg(test)]
mod changes_tests {
    use super::*;
    use crate::specimen::param;

    #[test]
    fn changes_are_made_by_name_and_freeing_is_told() {
        let mut params = vec![param("a", 1.0), param("b", 2.0)];
        params[1].fixed = true;
        let set = Changes { set: vec![("a".into(), 3.0)], fix: vec!["a".into()], free: vec![] };
        assert_eq!(set.apply(&mut params), Ok(false));
        assert_eq!((params[0].value, params[0].fixed), (3.0, true));
        let free = Changes { free: vec!["b".into()], ..Changes::default() };
        assert_eq!(free.apply(&mut params), Ok(true));
        assert!(!params[1].fixed);
    }

    #[test]
    fn all_mistakes_are_told_at_once_and_nothing_is_changed() {
        let mut params = vec![param("alpha", 1.0)];
        params[0].upper = 2.0;
        let changes = Changes {
            set: vec![("alpha".into(), 5.0), ("alhpa".into(), 1.0)],
            fix: vec!["alpha".into()],
            free: vec!["alpha".into()],
        };
        let texts: Vec<String> =
            changes.apply(&mut params).expect_err("three mistakes").iter().map(ToString::to_string).collect();
        assert_eq!(texts.len(), 3);
        assert!(texts[1].contains("did you mean `alpha`"), "{texts:?}");
        assert_eq!((params[0].value, params[0].fixed), (1.0, false));
    }
}
