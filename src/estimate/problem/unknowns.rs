//! The vector of unknowns: shared free parameters first, then for every run its own copies of the per-run ones.
//!
//! A search may take the logarithm of a positive parameter for its unknown ([`Unknowns::searched`]); what follows from the values
//! that were found (standard errors, bounds) is of the parameters themselves.

use crate::problem::Problem;
use fdm_numeric::elementary::{exp, log};

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
