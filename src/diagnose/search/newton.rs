//! Short fits in one frozen noise: damped Gauss-Newton steps within bounds (Levenberg, Marquardt) that end where no step can
//! gain what anyone would be told. A search makes thousands of them, and many of its models have kinks, at which a fit that
//! wants its slope to vanish would go on for long.

use crate::estimate::{NormalEquations, ParameterEstimate, Problem, Status};
use fdm_grammar::model::{Param, Prior};
use nalgebra::{DMatrix, DVector};

/// Damping after a full step was refused; columns have unit norm.
const DAMPING: f64 = 1e-2;
/// What the damping is multiplied by when a step is refused, and divided by when one is taken.
const HARDER: f64 = 8.0;
const SOFTER: f64 = 10.0;
/// Damping that is as good as none.
const UNDAMPED: f64 = 1e-6;
/// Steps that are refused in a row before a fit ends: a kink.
const REFUSED: usize = 6;
/// Added to the scaled information, so that what the runs do not determine stays where it is.
const RIDGE: f64 = 1e-11;
/// Times that a step is solved for anew because something has reached its bound.
const BOUNDS: usize = 8;
/// Information of an unknown by itself, beside all others, below which it has no standard error.
const UNDETERMINED: f64 = 1e-9;

/// What may move, and how far.
struct Unknown {
    /// The parameter.
    param: usize,
    /// The run that it belongs to; none where all runs share it.
    run: Option<usize>,
    lower: f64,
    upper: f64,
    prior: Option<Prior>,
}

/// The road of a fit.
pub(super) struct Newton<'e, 'a> {
    equations: NormalEquations<'e, 'a>,
    unknowns: Vec<Unknown>,
    values: Vec<f64>,
    /// Minus the log-likelihood, without its constant.
    cost: f64,
    information: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Whether these belong to the values.
    fresh: bool,
    damping: f64,
}

impl<'e, 'a> Newton<'e, 'a> {
    /// At the problem's start values, which are within their bounds; its noise is that of unit numbers.
    pub(super) fn new(problem: &'e mut Problem<'a>) -> Self {
        let unknowns = unknowns(problem);
        let start = |u: &Unknown| match u.run {
            Some(run) => problem.runs[run].start.get(u.param).copied().unwrap_or(problem.params[u.param].value),
            None => problem.params[u.param].value,
        };
        let values: Vec<f64> = unknowns.iter().map(start).collect();
        let (size, outputs) = (unknowns.len(), problem.outputs.len());
        Self {
            equations: NormalEquations::new(problem, &vec![1.0; outputs]),
            unknowns,
            values,
            cost: f64::INFINITY,
            information: DMatrix::zeros(size, size),
            gradient: DVector::zeros(size),
            fresh: false,
            damping: 0.0,
        }
    }

    /// The cost at the values, by a simulation; none where there is no response.
    pub(super) fn look(&mut self) -> Option<f64> {
        let values = self.values.clone();
        self.cost = self.cost_at(&values)?;
        Some(self.cost)
    }

    /// Corrects the values at most so many times, as long as a step promises to gain more than `least`; none where there is no
    /// response at the start.
    pub(super) fn descend(&mut self, steps: usize, least: f64) -> Option<f64> {
        if !self.fresh {
            self.linearise(&self.values.clone())?;
        }
        for _ in 0..steps {
            if !self.fresh && self.linearise(&self.values.clone()).is_none() {
                break;
            }
            let Some((step, promise)) = self.step() else { break };
            // what a damped step does not promise a full one may
            if promise <= least && self.damping == 0.0 {
                break;
            }
            if !self.correct(&step, promise) {
                break;
            }
        }
        Some(self.cost)
    }

    /// Tries a step, and others with more damping until one gains; false where none does.
    fn correct(&mut self, step: &DVector<f64>, promise: f64) -> bool {
        let (mut step, mut promise) = (step.clone(), promise);
        for refused in 0..REFUSED {
            let trial = self.moved(&step);
            let before = self.cost;
            let better = if refused == 0 {
                let (information, gradient) = (self.information.clone(), self.gradient.clone());
                let better = self.linearise(&trial).is_some_and(|cost| cost < before);
                if !better {
                    (self.information, self.gradient) = (information, gradient);
                }
                better
            } else {
                self.fresh = false;
                self.cost_at(&trial).filter(|cost| *cost < before).inspect(|cost| self.cost = *cost).is_some()
            };
            if better {
                self.values = trial;
                let ratio = (before - self.cost) / promise.max(f64::MIN_POSITIVE);
                if ratio > 0.5 {
                    self.damping = if self.damping > UNDAMPED { self.damping / SOFTER } else { 0.0 };
                } else if ratio < 0.1 {
                    self.damping = (self.damping * 2.0).max(UNDAMPED);
                }
                return true;
            }
            (self.cost, self.fresh) = (before, true);
            self.damping = if self.damping > 0.0 { self.damping * HARDER } else { DAMPING };
            match self.step() {
                Some(next) => (step, promise) = next,
                None => return false,
            }
        }
        false
    }

    /// The damped step within the bounds, and what it promises.
    fn step(&self) -> Option<(DVector<f64>, f64)> {
        let size = self.values.len();
        let scale = self.information.diagonal().map(|v| if v > 0.0 { 1.0 / v.sqrt() } else { 0.0 });
        let mut step = DVector::zeros(size);
        let outward = |j: usize| {
            let (v, u, g) = (self.values[j], &self.unknowns[j], self.gradient[j]);
            (v <= u.lower && g < 0.0) || (v >= u.upper && g > 0.0)
        };
        let mut open: Vec<usize> = (0..size).filter(|j| scale[*j] > 0.0 && !outward(*j)).collect();
        for _ in 0..BOUNDS {
            let n = open.len();
            if n == 0 {
                break;
            }
            let reduced = DMatrix::from_fn(n, n, |a, b| {
                let own = if a == b { self.damping + RIDGE } else { 0.0 };
                self.information[(open[a], open[b])] * scale[open[a]] * scale[open[b]] + own
            });
            // what stands on its bound pulls at the others
            let pull = &self.information * &step;
            let held = |j: usize| pull[j] - open.iter().map(|k| self.information[(j, *k)] * step[*k]).sum::<f64>();
            let right = DVector::from_fn(n, |a, _| (self.gradient[open[a]] - held(open[a])) * scale[open[a]]);
            let solved = reduced.cholesky()?.solve(&right);
            open.iter().enumerate().for_each(|(a, j)| step[*j] = solved[a] * scale[*j]);
            let beyond = |j: &usize| {
                let (moved, u) = (self.values[*j] + step[*j], &self.unknowns[*j]);
                moved < u.lower || moved > u.upper
            };
            let stopped: Vec<usize> = open.iter().copied().filter(beyond).collect();
            if stopped.is_empty() {
                break;
            }
            for j in stopped {
                let u = &self.unknowns[j];
                step[j] = (self.values[j] + step[j]).clamp(u.lower, u.upper) - self.values[j];
                open.retain(|k| *k != j);
            }
        }
        let promise = self.gradient.dot(&step) - 0.5 * step.dot(&(&self.information * &step));
        (promise.is_finite() && step.iter().any(|s| *s != 0.0)).then_some((step, promise))
    }

    fn moved(&self, step: &DVector<f64>) -> Vec<f64> {
        let each = self.values.iter().zip(step.iter()).zip(&self.unknowns);
        each.map(|((v, s), u)| (v + s).max(u.lower).min(u.upper)).collect()
    }

    fn prior_cost(&self, values: &[f64]) -> f64 {
        let each = self.unknowns.iter().zip(values);
        each.filter_map(|(u, v)| u.prior.map(|p| 0.5 * ((p.mean - v) / p.deviation).powi(2))).sum()
    }

    fn cost_at(&mut self, values: &[f64]) -> Option<f64> {
        let squares = self.equations.squares_at(values).ok()?;
        Some(0.5 * squares + self.prior_cost(values)).filter(|c| c.is_finite())
    }

    /// Cost, information and gradient at some values.
    fn linearise(&mut self, values: &[f64]) -> Option<f64> {
        self.fresh = false;
        let size = values.len();
        if size == 0 {
            self.cost = self.cost_at(values)?;
            self.fresh = true;
            return Some(self.cost);
        }
        self.equations.evaluate(values).ok()?;
        let cost = 0.5 * self.equations.squares() + self.prior_cost(values);
        let finite = self.equations.information().iter().chain(self.equations.gradient()).all(|v| v.is_finite());
        if !(finite && cost.is_finite()) {
            return None;
        }
        self.information = DMatrix::from_row_slice(size, size, self.equations.information());
        self.gradient = DVector::from_column_slice(self.equations.gradient());
        for (j, u) in self.unknowns.iter().enumerate() {
            if let Some(prior) = u.prior {
                self.information[(j, j)] += prior.deviation.powi(-2);
                self.gradient[j] += (prior.mean - values[j]) / prior.deviation.powi(2);
            }
        }
        (self.cost, self.fresh) = (cost, true);
        Some(cost)
    }

    /// What was reached: cost, all parameters of each run, and estimates with standard errors by the last sensitivities.
    pub(super) fn reached(self, problem: &ProblemTable) -> (f64, Vec<Vec<f64>>, Vec<ParameterEstimate>) {
        let errors = self.errors();
        let mut theta = problem.theta.clone();
        for (u, v) in self.unknowns.iter().zip(&self.values) {
            match u.run {
                Some(run) => theta[run][u.param] = *v,
                None => theta.iter_mut().for_each(|own| own[u.param] = *v),
            }
        }
        let mut estimates = Vec::new();
        for (k, param) in problem.params.iter().enumerate() {
            let runs = if param.per_run { problem.names.len() } else { 1 };
            for run in 0..runs {
                let owner = param.per_run.then_some(run);
                let place = self.unknowns.iter().position(|u| u.param == k && u.run == owner);
                let start = problem.theta.get(run).map_or(param.value, |own| own[k]);
                let name = owner.map(|run| problem.names[run].clone());
                let value = theta.get(run).map_or(param.value, |own| own[k]);
                estimates.push(estimate(param, (name, value, start), place.map(|j| errors[j])));
            }
        }
        (self.cost, theta, estimates)
    }

    /// Standard errors of the unknowns; none at a bound, and where the runs do not determine one.
    fn errors(&self) -> Vec<Option<f64>> {
        let inside = |j: &usize| {
            let (v, u) = (self.values[*j], &self.unknowns[*j]);
            v > u.lower && v < u.upper && self.information[(*j, *j)] > 0.0
        };
        let open: Vec<usize> = (0..self.values.len()).filter(inside).collect();
        let scale: Vec<f64> = open.iter().map(|j| self.information[(*j, *j)].sqrt()).collect();
        let scaled = DMatrix::from_fn(open.len(), open.len(), |a, b| {
            let ridge = if a == b { RIDGE } else { 0.0 };
            self.information[(open[a], open[b])] / (scale[a] * scale[b]) + ridge
        });
        let mut errors = vec![None; self.values.len()];
        let Some(inverse) = scaled.cholesky().map(|c| c.inverse()) else { return errors };
        for (a, j) in open.iter().enumerate() {
            let variance = inverse[(a, a)];
            errors[*j] = (variance < 1.0 / UNDETERMINED).then(|| variance.sqrt() / scale[a]);
        }
        errors
    }
}

/// What a problem's parameters are called, and where they begin.
pub(super) struct ProblemTable {
    params: Vec<Param>,
    names: Vec<String>,
    /// All parameters of each run at the start.
    theta: Vec<Vec<f64>>,
}

impl ProblemTable {
    pub(super) fn of(problem: &Problem<'_>) -> Self {
        let own = |run: &crate::estimate::ProblemRun<'_>| {
            let each = problem.params.iter().enumerate();
            each.map(|(k, p)| run.start.get(k).copied().filter(|_| p.per_run).unwrap_or(p.value)).collect()
        };
        Self {
            params: problem.params.clone(),
            names: problem.runs.iter().map(|r| r.name.clone()).collect(),
            theta: problem.runs.iter().map(own).collect(),
        }
    }
}

/// Free parameters as the normal equations have them: those that runs share, then those of each run.
fn unknowns(problem: &Problem<'_>) -> Vec<Unknown> {
    let pick = |run: Option<usize>| {
        let free = problem.params.iter().enumerate().filter(move |(_, p)| !p.fixed && p.per_run == run.is_some());
        free.map(move |(param, p)| Unknown { param, run, lower: p.lower, upper: p.upper, prior: p.prior })
    };
    let mut unknowns: Vec<Unknown> = pick(None).collect();
    (0..problem.runs.len()).for_each(|run| unknowns.extend(pick(Some(run))));
    unknowns
}

fn estimate(
    param: &Param,
    (run, value, start): (Option<String>, f64, f64),
    error: Option<Option<f64>>,
) -> ParameterEstimate {
    let status = match error {
        None => Status::Fixed,
        Some(Some(_)) => Status::Estimated,
        Some(None) if value <= param.lower => Status::AtLowerBound,
        Some(None) if value >= param.upper => Status::AtUpperBound,
        Some(None) => Status::NotDetermined,
    };
    ParameterEstimate {
        name: param.quantity.name.clone(),
        run,
        value,
        standard_error: error.flatten(),
        corrected_error: None,
        freedom: None,
        unit: param.quantity.unit.as_ref().map(ToString::to_string),
        status,
        start: Some(start),
        lower: param.lower.is_finite().then_some(param.lower),
        upper: param.upper.is_finite().then_some(param.upper),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::estimate::{DerivedQuantities, ProblemRun, Response};
    use crate::simulate::{Block, Divergence, RowLayout, Sink};
    use fdm_grammar::model::{Origin, Quantity};

    /// y = a exp(-b x) + c, limited by a kink at d.
    struct Limited {
        x: Vec<f64>,
    }

    impl Limited {
        fn at(x: f64, theta: &[f64]) -> (f64, [f64; 4]) {
            let e = (-theta[1] * x).exp();
            let y = theta[0] * e + theta[2];
            if y < theta[3] { (y, [e, -theta[0] * x * e, 1.0, 0.0]) } else { (theta[3], [0.0, 0.0, 0.0, 1.0]) }
        }
    }

    impl Response for Limited {
        fn samples(&self) -> usize {
            self.x.len()
        }

        fn outputs(&self) -> usize {
            1
        }

        fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
            y.iter_mut().zip(&self.x).for_each(|(y, x)| *y = Self::at(*x, theta).0);
            Ok(())
        }

        fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
            let layout = RowLayout::full(1, columns.len());
            for (k, x) in self.x.iter().enumerate() {
                let (y, all) = Self::at(*x, theta);
                let mut rows = vec![0.0; layout.length];
                columns.iter().enumerate().for_each(|(c, p)| rows[c] = all[*p]);
                sink(Block { first: k, y: &[y], rows: &mut rows, layout: &layout });
            }
            Ok(())
        }
    }

    fn param(name: &str, value: f64, (lower, upper): (f64, f64), per_run: bool) -> Param {
        let quantity = Quantity { name: name.into(), doc: String::new(), unit: None };
        Param { quantity, origin: Origin::Declared, value, lower, upper, fixed: false, per_run, prior: None }
    }

    /// Two runs with zeros of their own; the truth is a = 2, b = 0.7, c = 0.5 and -0.25, d = 1.8.
    fn problem(starts: [f64; 4], upper: f64) -> Problem<'static> {
        let free = (f64::NEG_INFINITY, f64::INFINITY);
        let params = vec![
            param("a", starts[0], free, false),
            param("b", starts[1], (0.0, upper), false),
            param("c", starts[2], free, true),
            param("d", starts[3], free, false),
        ];
        let run = |(k, c): (usize, f64)| {
            let x: Vec<f64> = (0..60).map(|i| 0.1 * f64::from(i)).collect();
            let noise = |i: usize| 0.01 * ((i * (7 + k)) as f64).sin();
            let measured =
                x.iter().enumerate().map(|(i, x)| 100.0 * (Limited::at(*x, &[2.0, 0.7, c, 1.8]).0 + noise(i)));
            let measured: Vec<f64> = measured.map(|z| z / 100.0).collect();
            ProblemRun { name: format!("run {k}"), response: Box::new(Limited { x }), measured, start: Vec::new() }
        };
        let runs = [(0, 0.5), (1, -0.25)].into_iter().map(run).collect();
        Problem {
            params,
            outputs: vec!["y".into()],
            runs,
            affine: Vec::new(),
            derived: DerivedQuantities::none(),
            carried_noise: None,
        }
    }

    #[test]
    fn a_kinked_response_is_fitted_with_a_zero_for_each_run() {
        let mut problem = problem([1.0, 0.3, 0.0, 1.5], f64::INFINITY);
        let table = ProblemTable::of(&problem);
        let mut newton = Newton::new(&mut problem);
        let begun = newton.look().unwrap();
        let cost = newton.descend(40, 1e-9).unwrap();
        let (told, theta, estimates) = newton.reached(&table);
        assert!(cost < 0.01 * begun && told == cost, "{begun} {cost}");
        for (found, truth) in theta[0].iter().zip([2.0, 0.7, 0.5, 1.8]) {
            assert!((found - truth).abs() < 0.03, "{theta:?}");
        }
        assert!((theta[1][2] + 0.25).abs() < 0.03 && theta[1][0] == theta[0][0], "{theta:?}");
        assert_eq!(estimates.iter().filter(|e| e.name == "c").count(), 2);
        assert!(estimates.iter().all(|e| e.standard_error.is_some_and(|s| s > 0.0 && s.is_finite())), "{estimates:?}");
    }

    /// At a bound the others are the best that they can be there.
    #[test]
    fn what_stands_at_its_bound_lets_the_others_go_on() {
        let mut first = problem([1.0, 0.3, 0.0, 9.0], 0.5);
        let mut newton = Newton::new(&mut first);
        let cost = newton.descend(60, 1e-10).unwrap();
        assert_eq!(newton.values[1], 0.5);
        let mut second = problem([1.0, 0.5, 0.0, 9.0], 0.5);
        second.params[1].fixed = true;
        let mut newton = Newton::new(&mut second);
        let alone = newton.descend(60, 1e-10).unwrap();
        assert!((cost - alone).abs() < 1e-6 * alone, "{cost} {alone}");
    }
}
