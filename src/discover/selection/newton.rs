//! Short fits in one frozen noise: Gauss-Newton steps within bounds that end where no step can gain what anyone would be told. A
//! search makes thousands of them, and many of its models have kinks, at which a fit that wants its slope to vanish would go
//! on for long.

use fdm_estimate::{NormalEquations, ParameterEstimate, Problem, Status};
use fdm_grammar::model::{Param, Prior};
use fdm_numeric::least_squares::{self, GaussNewton, Options, Problem as _, Space};
use fdm_numeric::quadratic::{Inverse, Quadratic};

/// Steps that are refused in a row before a fit ends: a kink.
const REFUSED: usize = 12;
/// Added to the scaled information, so that what the runs do not determine stays where it is.
const RIDGE: f64 = 1e-11;
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

/// A fit and where it has got to.
pub(super) struct Newton<'e, 'a> {
    equations: NormalEquations<'e, 'a>,
    unknowns: Vec<Unknown>,
    values: Vec<f64>,
    /// Minus the log-likelihood, without its constant.
    reached: f64,
    /// The quadratic at the values.
    quadratic: Quadratic,
}

/// Squares of residuals in the unit of a noise that is known, and priors.
struct FrozenCost<'n, 'e, 'a> {
    equations: &'n mut NormalEquations<'e, 'a>,
    unknowns: &'n [Unknown],
}

impl FrozenCost<'_, '_, '_> {
    fn prior_cost(&self, values: &[f64]) -> f64 {
        let each = self.unknowns.iter().zip(values);
        each.filter_map(|(u, v)| u.prior.map(|p| 0.5 * ((p.mean - v) / p.deviation).powi(2))).sum()
    }
}

impl least_squares::Problem for FrozenCost<'_, '_, '_> {
    type Failure = ();
    type Weights = f64;

    fn cost(&self, cost: &f64) -> f64 {
        *cost
    }

    fn rounding(&self, cost: &f64) -> f64 {
        4.0 * f64::EPSILON * cost.abs()
    }

    fn evaluate(&mut self, values: &[f64]) -> Result<f64, ()> {
        let squares = self.equations.squares_at(values).map_err(|_| ())?;
        Some(0.5 * squares + self.prior_cost(values)).filter(|c| c.is_finite()).ok_or(())
    }

    fn linearise(&mut self, values: &[f64], _: Option<f64>) -> Result<f64, ()> {
        if values.is_empty() {
            return self.evaluate(values);
        }
        self.equations.evaluate(values).map_err(|_| ())?;
        let cost = 0.5 * self.equations.squares() + self.prior_cost(values);
        let finite = self.equations.information().iter().chain(self.equations.gradient()).all(|v| v.is_finite());
        if finite && cost.is_finite() { Ok(cost) } else { Err(()) }
    }

    fn gather(&mut self, values: &[f64], _: &f64, quadratic: &mut Quadratic) {
        let size = values.len();
        let mut information = self.equations.information().to_vec();
        let mut descent = self.equations.gradient().to_vec();
        for (j, unknown) in self.unknowns.iter().enumerate() {
            if let Some(prior) = unknown.prior {
                information[j * size + j] += prior.deviation.powi(-2);
                descent[j] += (prior.mean - values[j]) / prior.deviation.powi(2);
            }
            information[j * size + j] *= 1.0 + RIDGE;
        }
        quadratic.set(&information, &descent);
    }
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
        let outputs = problem.outputs.len();
        let equations = NormalEquations::new(problem, &vec![1.0; outputs]);
        Self { equations, unknowns, values, reached: f64::INFINITY, quadratic: Quadratic::default() }
    }

    /// The cost at the values, by a simulation; none where there is no response.
    pub(super) fn look(&mut self) -> Option<f64> {
        let mut cost = FrozenCost { equations: &mut self.equations, unknowns: &self.unknowns };
        self.reached = cost.evaluate(&self.values).ok()?;
        Some(self.reached)
    }

    /// Makes at most so many steps, as long as one is predicted to gain more than `least`; none where there is no
    /// response at the start.
    pub(super) fn descend(&mut self, steps: usize, least: f64) -> Option<f64> {
        let Self { equations, unknowns, values, .. } = self;
        let (lower, upper): (Vec<f64>, Vec<f64>) = unknowns.iter().map(|u| (u.lower, u.upper)).unzip();
        let space = Space { start: values, lower: &lower, upper: &upper, affine: &[], reach: &[] };
        let options =
            Options { iterations: steps, least_gain: least, refusals: REFUSED, restarts: false, ..Options::default() };
        let mut newton = GaussNewton::new(FrozenCost { equations, unknowns }, space, options);
        newton.run(None, |_, _| Ok(false), &mut ()).ok()?;
        let reached = newton.cost();
        let GaussNewton { values, quadratic, .. } = newton;
        (self.reached, self.values, self.quadratic) = (reached, values, quadratic);
        Some(reached)
    }

    /// What was reached: cost, all parameters of each run, and estimates with standard errors by the last sensitivities.
    pub(super) fn reached(mut self, problem: &ProblemTable) -> (f64, Vec<Vec<f64>>, Vec<ParameterEstimate>) {
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
        (self.reached, theta, estimates)
    }

    /// Standard errors of the unknowns; none at a bound, and where the runs do not determine one.
    fn errors(&mut self) -> Vec<Option<f64>> {
        let mut errors = vec![None; self.values.len()];
        if errors.len() != self.quadratic.scale.len() {
            return errors;
        }
        let inside = |j: &usize| {
            let (v, u) = (self.values[*j], &self.unknowns[*j]);
            v > u.lower && v < u.upper && self.quadratic.scale[*j] > 0.0
        };
        let open: Vec<usize> = (0..self.values.len()).filter(inside).collect();
        let Some(inverse) = self.quadratic.invert(open, Inverse::default()) else { return errors };
        let n = inverse.chosen.len();
        for (a, j) in inverse.chosen.iter().enumerate() {
            let variance = inverse.values[a * n + a];
            errors[*j] = (variance < 1.0 / UNDETERMINED).then(|| variance.sqrt() / self.quadratic.scale[*j]);
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
        let own = |run: &fdm_estimate::ProblemRun<'_>| {
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
        degrees_of_freedom: None,
        unit: param.quantity.unit.as_ref().map(ToString::to_string),
        status,
        start: Some(start),
        lower: param.lower.is_finite().then_some(param.lower),
        upper: param.upper.is_finite().then_some(param.upper),
        limit: None,
        logarithmic: false,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use fdm_estimate::{DerivedQuantities, ProblemRun, Response, RunResponse, TimeResponse};
    use fdm_grammar::model::{Origin, Quantity};
    use fdm_system::simulate::{Block, Divergence, RowLayout, Sink};

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

    impl TimeResponse for Limited {}

    fn param(name: &str, value: f64, (lower, upper): (f64, f64), per_run: bool) -> Param {
        let quantity = Quantity { name: name.into(), doc: String::new(), unit: None };
        Param {
            quantity,
            origin: Origin::Declared,
            value,
            lower,
            upper,
            fixed: false,
            per_run,
            group: None,
            logarithmic: false,
            prior: None,
        }
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
            ProblemRun {
                name: format!("run {k}"),
                response: RunResponse::in_time(Limited { x }),
                measured,
                start: Vec::new(),
            }
        };
        let runs = [(0, 0.5), (1, -0.25)].into_iter().map(run).collect();
        Problem::of(params, vec!["y".into()], runs, DerivedQuantities::none())
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
