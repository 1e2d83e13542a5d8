//! What is reported of each parameter: value, standard errors (Cramer-Rao and corrected), confidence interval by Student's law, status; errors of derived
//! quantities by the delta method; correlations.

use super::bounds::within;
use super::cramer_rao::CramerRao;
use super::identifiability::Lost;
use super::identifiability::{Direction, Reach, faint, undetermined};
use super::sandwich::Corrected;
use crate::problem::Problem;
use crate::problem::unknowns::Unknowns;
use fdm_grammar::model::TableNode;
use fdm_numeric::elementary::exp;
use fdm_numeric::statistics::Student;
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use std::fmt;

/// Whether and how a parameter was estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Estimated, with a standard error.
    Estimated,
    /// Held at its lower bound: not part of the covariance. Errors of the others allow for it where there is a [`ParameterEstimate::limit`].
    AtLowerBound,
    /// Held at its upper bound, likewise.
    AtUpperBound,
    /// The data do not determine it; see [`Estimate::undetermined`](crate::Estimate::undetermined).
    NotDetermined,
    /// A node of a smooth table that no run visited: its value follows from its neighbours and is not known.
    Unvisited,
    /// Known.
    Fixed,
    /// Follows from others.
    Derived,
    /// Follows from others as long as its tie is on.
    Tied,
    /// The start values could not be simulated.
    NotEstimated,
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Estimated => "estimated",
            Self::AtLowerBound => "at lower bound",
            Self::AtUpperBound => "at upper bound",
            Self::NotDetermined => "not determined",
            Self::Unvisited => "unvisited",
            Self::Fixed => "fixed",
            Self::Derived => "derived",
            Self::Tied => "tied",
            Self::NotEstimated => "not estimated",
        })
    }
}

/// A parameter, or a derived quantity, after the estimation.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct ParameterEstimate {
    /// Its name.
    pub name: String,
    /// The run that it belongs to; none when all runs share it.
    pub run: Option<String>,
    /// Its value.
    pub value: f64,
    /// Cramer-Rao standard error, by noise corrected for degrees of freedom; none when there is none to give.
    pub standard_error: Option<f64>,
    /// Standard error corrected for the colour of the residuals (Morelli and Klein); none where [`Estimate::uncorrected`](crate::Estimate::uncorrected)
    /// says why, and where there is no other either.
    pub corrected_error: Option<f64>,
    /// Degrees of freedom of the corrected error, which says how well the colour of the noise is known; none where that is not said.
    #[serde(rename = "freedom")]
    pub degrees_of_freedom: Option<f64>,
    /// Its unit, as text.
    pub unit: Option<String>,
    /// Whether and how it was estimated.
    pub status: Status,
    /// Where the estimation started; none for derived quantities.
    pub start: Option<f64>,
    /// Least admissible value.
    pub lower: Option<f64>,
    /// Greatest admissible value.
    pub upper: Option<f64>,
    /// Of a parameter at its bound: the value that it lies on this side of with 95 % probability. None where the data do not say, so that errors of
    /// the others hold for a value at the bound only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
    /// Whether it was searched by its logarithm, in which its interval is even.
    #[serde(rename = "log", default, skip_serializing_if = "std::ops::Not::not")]
    pub logarithmic: bool,
}

impl ParameterEstimate {
    /// The standard error to be trusted: corrected for the colour of the residuals where that was possible.
    pub fn error(&self) -> Option<f64> {
        self.corrected_error.or(self.standard_error)
    }

    /// The interval that holds the true value in 95 of 100 cases, by the error that is to be trusted and what is known of it: as many of
    /// these errors on both sides as Student's law says, in the logarithm where that was searched. From the bound to the limit for a
    /// parameter at its bound.
    pub fn interval(&self) -> Option<[f64; 2]> {
        if let Some(limit) = self.limit {
            return Some([self.value.min(limit), self.value.max(limit)]);
        }
        let half = self.error()? * quantile(self.degrees_of_freedom.filter(|_| self.corrected_error.is_some()));
        if self.logarithmic && self.value > 0.0 {
            let factor = exp(half / self.value);
            return Some([self.value / factor, self.value * factor]);
        }
        Some([self.value - half, self.value + half])
    }
}

/// Standard errors on both sides that hold 95 % of Student's law with so many degrees of freedom; of the normal law without.
pub fn quantile(freedom: Option<f64>) -> f64 {
    const NORMAL: f64 = 1.959_963_984_540_054;
    let law = freedom.and_then(|f| Student::new(f.max(1.0)));
    law.map_or(NORMAL, |law| law.quantile(0.975).max(NORMAL))
}

/// A symmetric matrix.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, Serialize)]
pub struct Symmetric {
    /// Rows and columns.
    pub size: usize,
    /// Entries, row-major.
    pub values: Vec<f64>,
}

impl Symmetric {
    /// The entry in row i and column j.
    pub fn at(&self, i: usize, j: usize) -> f64 {
        self.values[i * self.size + j]
    }
}

/// Cramer-Rao standard error, and the one corrected for the colour of the residuals.
type Errors = [Option<f64>; 2];

/// What is known about the unknowns after an estimation.
pub(crate) struct Statistics {
    /// Status of each unknown.
    status: Vec<Status>,
    /// Covariance of all chosen unknowns in the parameters' units, row-major; empty without degrees of freedom.
    covariance: Vec<f64>,
    /// Covariance of all chosen unknowns, corrected for the colour of the residuals; empty when it was not.
    corrected: Vec<f64>,
    /// Degrees of freedom of each corrected variance; empty where they are not known.
    freedom: Vec<f64>,
    /// Position of an unknown in `covariance`.
    place: Vec<Option<usize>>,
    /// Of unknowns at their bounds how far inside they may be.
    limits: Vec<Option<f64>>,
    /// Undetermined directions over the chosen unknowns, per parameter unit.
    null: Vec<Vec<f64>>,
    /// Undetermined directions in words.
    pub(crate) directions: Vec<Direction>,
    /// Directions that priors determine and the data do not.
    pub(crate) by_prior: Vec<Direction>,
    /// Unknowns whose sensitivities are as good as zero, but not zero.
    faint: Vec<usize>,
}

impl Statistics {
    /// Statistics of an estimation at `values`; without a bound nothing was estimated.
    pub(crate) fn new(
        problem: &Problem<'_>,
        unknowns: &Unknowns,
        values: &[f64],
        bound: Option<&CramerRao>,
        corrected: Option<&Corrected>,
    ) -> Self {
        let Some(bound) = bound else {
            let (status, place) = (vec![Status::NotEstimated; values.len()], vec![None; values.len()]);
            let (covariance, corrected, freedom, limits) = Default::default();
            let (null, directions, by_prior, faint) = Default::default();
            return Self { status, covariance, corrected, freedom, place, limits, null, directions, by_prior, faint };
        };
        let inverse = &bound.inverse;
        let name = |j: usize| name_of(problem, unknowns, j);
        let CramerRao { scale, inside, without_priors, .. } = bound;
        let (mut determined, mut directions) = undetermined(scale, inside, inverse, name);
        let reach = |j: usize| Reach::new(values[j], unknowns.start[j], (unknowns.lower[j], unknowns.upper[j]));
        let told_apart = determined.clone();
        faint(scale, inverse, reach, &mut determined, &mut directions, name);
        let faint = (0..determined.len()).filter(|k| told_apart[*k] && !determined[*k]);
        let faint = faint.map(|k| inverse.chosen[k]).collect();
        directions.extend(unknowns.held.iter().map(|j| Direction::of_held(name(*j))));
        let by_prior = without_priors.as_ref().map(|(scale, inverse)| undetermined(scale, inside, inverse, name).1);
        let mut status: Vec<Status> = (0..values.len())
            .map(|j| match () {
                () if unknowns.held.contains(&j) => Status::NotDetermined,
                () if values[j] <= unknowns.lower[j] => Status::AtLowerBound,
                () if values[j] >= unknowns.upper[j] => Status::AtUpperBound,
                () => Status::NotDetermined,
            })
            .collect();
        let mut place = vec![None; values.len()];
        for (k, j) in inverse.chosen.iter().enumerate() {
            place[*j] = Some(k);
            if determined[k] && inside[*j] {
                status[*j] = Status::Estimated;
            }
        }
        let scale: Vec<f64> = inverse.chosen.iter().map(|j| bound.scale[*j]).collect();
        let entries = || scale.iter().flat_map(|a| scale.iter().map(move |b| a * b));
        let physical = |values: &[f64]| values.iter().zip(entries()).map(|(v, s)| v / s).collect::<Vec<f64>>();
        let mut about = inverse.values.clone();
        let mut reach = within(inverse, &bound.held, &mut about);
        let mut covariance = physical(&about);
        let freedom = corrected.map_or(Vec::new(), |c| c.freedom.clone());
        if let Some(corrected) = corrected {
            about.clone_from(&corrected.values);
            reach = within(inverse, &bound.held, &mut about);
        }
        let corrected = corrected.map_or(Vec::new(), |_| physical(&about));
        let mut limits = vec![None; values.len()];
        for (held, reach) in bound.held.iter().zip(reach).filter(|_| bound.noise.is_some()) {
            let wider = quantile(freedom.get(held.place).copied()) / quantile(None);
            limits[inverse.chosen[held.place]] = reach.map(|reach| reach * wider / scale[held.place]);
        }
        if bound.noise.is_none() {
            covariance.clear();
        }
        let null = inverse.null.iter().map(|v| v.iter().zip(&scale).map(|(x, s)| x / s).collect()).collect();
        let by_prior = by_prior.unwrap_or_default().into_iter().filter(|d| !directions.contains(d)).collect();
        Self { status, covariance, corrected, freedom, place, limits, null, directions, by_prior, faint }
    }

    /// Unknowns that are not determined by themselves, and those that went to a bound, from where they began to where they are; nodes of smooth tables follow their neighbours and do not
    /// count.
    pub(crate) fn lost(
        &self,
        problem: &Problem<'_>,
        unknowns: &Unknowns,
        (began, values): (&[f64], &[f64]),
    ) -> Vec<Lost> {
        let smooth = problem.tables.iter().filter(|t| t.smooth.is_some()).flat_map(|t| &t.nodes);
        let smooth: HashSet<&str> =
            smooth.filter_map(|n| if let TableNode::Param(name) = n { Some(name.as_str()) } else { None }).collect();
        let alone = |j: &usize| {
            let name = name_of(problem, unknowns, *j);
            self.directions.iter().any(|d| matches!(&d.moves[..], [(own, _)] if *own == name))
        };
        let by_itself = |j: &usize| !smooth.contains(problem.params[unknowns.owner(*j).1].quantity.name.as_str());
        let bound = |j: &usize| {
            let inside = unknowns.lower[*j] < began[*j] && began[*j] < unknowns.upper[*j];
            inside && matches!(self.status[*j], Status::AtLowerBound | Status::AtUpperBound)
        };
        (0..values.len())
            .filter(|j| !unknowns.held.contains(j) && by_itself(j))
            .filter(|j| bound(j) || self.status[*j] == Status::NotDetermined && alone(j))
            .map(|j| {
                let shows = self.faint.contains(&j);
                Lost { unknown: j, start: began[j], value: values[j], shows, bound: bound(&j) }
            })
            .collect()
    }

    /// An entry of one of the covariances.
    fn entry(&self, covariance: &[f64], i: usize, j: usize) -> Option<f64> {
        let n = covariance.len().isqrt();
        covariance.get(self.place[i]? * n + self.place[j]?).copied()
    }

    /// Standard errors of an unknown that is determined: Cramer-Rao, and corrected.
    fn errors(&self, unknown: usize) -> Errors {
        let error = |covariance: &[f64]| {
            let variance = self.entry(covariance, unknown, unknown);
            variance.filter(|_| self.status[unknown] == Status::Estimated).map(|v| v.max(0.0).sqrt())
        };
        [error(&self.covariance), error(&self.corrected)]
    }

    /// The value that an unknown at its bound lies on this side of.
    fn limit(&self, unknown: usize, value: f64) -> Option<f64> {
        let reach = self.limits.get(unknown).copied().flatten()?;
        Some(if self.status[unknown] == Status::AtLowerBound { value + reach } else { value - reach })
    }

    /// Degrees of freedom of an unknown's corrected error.
    fn freedom(&self, unknown: usize) -> Option<f64> {
        self.freedom.get(self.place[unknown]?).copied().filter(|f| f.is_finite())
    }

    /// Standard errors of a quantity with the given gradient (unknown, partial); none when it moves along an
    /// undetermined direction, when an unknown without influence moves it, or when nothing estimated does.
    fn delta(&self, gradient: &[(usize, f64)]) -> Errors {
        /// Share of a move that the differences behind the gradient may leave over.
        const REST: f64 = 1e-6;
        if gradient.iter().any(|(_, g)| !g.is_finite()) {
            return [None; 2];
        }
        let lost = |j: &usize| self.status[*j] == Status::NotDetermined && self.place[*j].is_none();
        if gradient.iter().any(|(j, g)| *g != 0.0 && lost(j)) {
            return [None; 2];
        }
        for v in &self.null {
            let parts = || gradient.iter().filter_map(|(j, g)| Some(g * v[self.place[*j]?]));
            let (sum, sizes) = (parts().sum::<f64>(), parts().map(f64::abs).sum::<f64>());
            if sum.abs() > REST * sizes {
                return [None; 2];
            }
        }
        [&self.covariance, &self.corrected].map(|covariance| {
            let inner = |(i, a): &(usize, f64)| {
                let parts = gradient.iter().filter_map(|(j, b)| Some(a * b * self.entry(covariance, *i, *j)?));
                parts.sum::<f64>()
            };
            let variance: f64 = gradient.iter().map(inner).sum();
            (variance > 0.0).then(|| variance.sqrt())
        })
    }

    /// Every parameter, per-run ones once for every run, and the entries that the covariance covers.
    pub(crate) fn parameters(
        &self,
        problem: &Problem<'_>,
        unknowns: &Unknowns,
        values: &[f64],
    ) -> (Vec<ParameterEstimate>, Vec<usize>, Vec<usize>) {
        let (mut table, mut covered, mut members) = (Vec::new(), Vec::new(), Vec::new());
        for (k, param) in problem.params.iter().enumerate().filter(|(_, p)| !p.is_recorded()) {
            let copies = if param.per_run { problem.runs.len() } else { 1 };
            for run in 0..copies {
                let unknown = unknowns.of(run, k);
                let status = unknown.map_or(Status::Fixed, |j| self.status[j]);
                let [standard_error, corrected_error] = unknown.map_or([None; 2], |j| self.errors(j));
                if let (Some(j), Some(_)) = (unknown, standard_error) {
                    covered.push(table.len());
                    members.push(j);
                }
                let start = unknowns.theta[run][k];
                let bound = |value: f64| value.is_finite().then_some(value);
                let freedom = unknown.and_then(|j| self.freedom(j)).filter(|_| corrected_error.is_some());
                table.push(ParameterEstimate {
                    name: param.quantity.name.clone(),
                    run: param.per_run.then(|| problem.runs[run].name.clone()),
                    value: unknown.map_or(start, |j| values[j]),
                    standard_error,
                    corrected_error,
                    degrees_of_freedom: freedom,
                    unit: param.quantity.unit.as_ref().map(ToString::to_string),
                    status,
                    start: Some(start),
                    lower: bound(param.lower),
                    upper: bound(param.upper),
                    limit: unknown.and_then(|j| self.limit(j, values[j])),
                    logarithmic: param.logarithmic,
                });
            }
        }
        (table, covered, members)
    }

    /// Derived quantities, per-run ones once for every run.
    pub(crate) fn derived(
        &self,
        problem: &mut Problem<'_>,
        unknowns: &Unknowns,
        values: &[f64],
    ) -> Vec<ParameterEstimate> {
        let mut table = Vec::new();
        let names = problem.derived.names.clone();
        if names.is_empty() {
            return table;
        }
        let rows: Vec<_> = (0..unknowns.runs).map(|run| self.derived_in(problem, unknowns, values, run)).collect();
        for (i, derived) in names.iter().enumerate() {
            let copies = if derived.per_run { problem.runs.len() } else { 1 };
            for (run, row) in rows.iter().enumerate().take(copies) {
                let (value, [standard_error, corrected_error], freedom) = row[i];
                table.push(ParameterEstimate {
                    name: derived.name.clone(),
                    run: derived.per_run.then(|| problem.runs[run].name.clone()),
                    value,
                    standard_error,
                    corrected_error,
                    degrees_of_freedom: freedom.filter(|_| corrected_error.is_some()),
                    unit: derived.unit.clone(),
                    status: if derived.tied { Status::Tied } else { Status::Derived },
                    start: None,
                    lower: None,
                    upper: None,
                    limit: None,
                    logarithmic: false,
                });
            }
        }
        table
    }

    /// Values, standard errors and degrees of freedom (the fewest of what moves them) of the derived quantities in one run.
    fn derived_in(
        &self,
        problem: &mut Problem<'_>,
        unknowns: &Unknowns,
        values: &[f64],
        run: usize,
    ) -> Vec<(f64, Errors, Option<f64>)> {
        let theta = unknowns.assembled(run, values);
        let places: Vec<usize> = (0..unknowns.columns.len()).map(|c| unknowns.position(run, c)).collect();
        let size: Vec<f64> = places.iter().map(|j| self.errors(*j)[0].unwrap_or(0.0)).collect();
        let (derived, gradients) = problem.derived.linearise(&theta, &unknowns.columns, &size);
        let error = |row: &Vec<f64>| {
            let gradient: Vec<(usize, f64)> = places.iter().copied().zip(row.iter().copied()).collect();
            let moving = gradient.iter().filter(|(_, g)| *g != 0.0);
            (self.delta(&gradient), moving.filter_map(|(j, _)| self.freedom(*j)).reduce(f64::min))
        };
        derived
            .into_iter()
            .zip(gradients.iter().map(error))
            .map(|(v, (errors, freedom))| (v, errors, freedom))
            .collect()
    }

    /// Covariance, correlations and corrected covariance of the given unknowns.
    pub(crate) fn matrices(&self, members: &[usize]) -> (Symmetric, Symmetric, Symmetric) {
        let size = members.len();
        let entry = |i: usize, j: usize| self.entry(&self.covariance, i, j).unwrap_or(f64::NAN);
        let pairs = || members.iter().flat_map(|i| members.iter().map(move |j| (*i, *j)));
        let covariance = pairs().map(|(i, j)| entry(i, j)).collect();
        let correlation = |(i, j): (usize, usize)| match i == j {
            true => 1.0,
            false => (entry(i, j) / (entry(i, i) * entry(j, j)).sqrt()).clamp(-1.0, 1.0),
        };
        let correlations = pairs().map(correlation).collect();
        let corrected: Vec<f64> = pairs().filter_map(|(i, j)| self.entry(&self.corrected, i, j)).collect();
        let symmetric = |values: Vec<f64>| Symmetric { size: values.len().isqrt(), values };
        (Symmetric { size, values: covariance }, Symmetric { size, values: correlations }, symmetric(corrected))
    }
}

/// What an unknown is called: its parameter, and its run when it has one.
fn name_of(problem: &Problem<'_>, unknowns: &Unknowns, unknown: usize) -> String {
    let (run, param) = unknowns.owner(unknown);
    let name = &problem.params[param].quantity.name;
    run.map_or_else(|| name.clone(), |r| format!("{name} of run {}", problem.runs[r].name))
}
