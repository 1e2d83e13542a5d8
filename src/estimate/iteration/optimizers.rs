//! Other ways towards the minimum, by argmin: a simplex that asks for no derivatives, and a quasi-Newton method. They go
//! before the Gauss-Newton steps, which then end the estimation and give the standard errors.

use super::evaluation::RunFailure;
use super::likelihood::LikelihoodSteps;
use crate::problem::method::Optimizer;
use argmin::core::{
    CostFunction, Error, Executor, Gradient, IterState, KV, Problem, Solver, State, TerminationReason,
    TerminationStatus,
};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::neldermead::NelderMead;
use argmin::solver::quasinewton::LBFGS;
use fdm_numeric::least_squares::{Iteration, Monitor, Problem as _};
use std::cell::RefCell;
use std::f64::consts::FRAC_PI_2;

/// Iterations of a method for each unknown, at most.
const PATIENCE: u64 = 400;
/// Spread of the costs of a simplex, in units of the logarithm of the likelihood, at which Gauss-Newton steps take over.
const SPREAD: f64 = 1e-3;
/// First edges of the simplex, relative to the unknown.
const EDGE: f64 = 0.2;
/// Stands for a cost that is not finite: argmin leaves NaN and infinity to its callers.
const HOPELESS: f64 = 1e150;

/// Approaches the minimum by the optimizer that was chosen; true when the monitor asked for the end. What was reached
/// is the start of the steps. A search that was killed begins again: the same bits follow.
///
/// # Errors
/// The run that cannot be simulated at what was reached.
pub(crate) fn approach(
    optimizer: Optimizer,
    steps: &mut LikelihoodSteps<'_, '_, '_>,
    monitor: &mut dyn Monitor,
) -> Result<bool, RunFailure> {
    if optimizer == Optimizer::GaussNewton || steps.values.is_empty() {
        return Ok(false);
    }
    let coordinates = Coordinates::new(steps);
    let start = coordinates.inwards(&steps.values);
    let best = (steps.cost(), steps.values.clone());
    let cost = Cost { steps, coordinates, monitor, best, interrupted: false };
    let (steps, best, interrupted) = match optimizer {
        Optimizer::NelderMead => cost.simplex(start),
        _ => cost.quasi_newton(start),
    };
    steps.begin_at(best)?;
    Ok(interrupted)
}

/// Coordinates without bounds and of size one: a sine between two bounds, a hyperbola above or below one.
#[derive(Debug, Clone)]
struct Coordinates {
    lower: Vec<f64>,
    upper: Vec<f64>,
    size: Vec<f64>,
}

impl Coordinates {
    fn new(steps: &LikelihoodSteps<'_, '_, '_>) -> Self {
        let size = |v: &f64| if *v != 0.0 { v.abs() } else { 1.0 };
        let unknowns = steps.problem.unknowns;
        let size = steps.values.iter().map(size).collect();
        Self { lower: unknowns.lower.clone(), upper: unknowns.upper.clone(), size }
    }

    /// From values to coordinates. Values at a bound, where coordinates do not move them, are taken a little inside.
    fn inwards(&self, values: &[f64]) -> Vec<f64> {
        let one = |(j, v): (usize, &f64)| {
            let (lower, upper, size) = (self.lower[j], self.upper[j], self.size[j]);
            match (lower.is_finite(), upper.is_finite()) {
                (true, true) => (2.0 * ((v - lower) / (upper - lower)).clamp(1e-3, 1.0 - 1e-3) - 1.0).asin(),
                (true, false) => ((1.0 + ((v - lower) / size).max(1e-3)).powi(2) - 1.0).sqrt(),
                (false, true) => ((1.0 + ((upper - v) / size).max(1e-3)).powi(2) - 1.0).sqrt(),
                (false, false) => v / size,
            }
        };
        values.iter().enumerate().map(one).collect()
    }

    /// From coordinates to values, with the derivative of each value by its coordinate.
    fn outwards(&self, at: &[f64]) -> Vec<(f64, f64)> {
        let one = |(j, u): (usize, &f64)| {
            let (lower, upper, size) = (self.lower[j], self.upper[j], self.size[j]);
            let root = (u * u + 1.0).sqrt();
            match (lower.is_finite(), upper.is_finite()) {
                (true, true) => {
                    let half = 0.5 * (upper - lower);
                    ((lower + half * (u.sin() + 1.0)).clamp(lower, upper), half * u.cos())
                }
                (true, false) => ((lower + size * (root - 1.0)).max(lower), size * u / root),
                (false, true) => ((upper - size * (root - 1.0)).min(upper), -size * u / root),
                (false, false) => (size * u, size),
            }
        };
        at.iter().enumerate().map(one).collect()
    }

    /// How far a first step along a coordinate goes, not beyond what turns it round.
    fn edge(&self, j: usize, u: f64) -> f64 {
        match (self.lower[j].is_finite(), self.upper[j].is_finite()) {
            (true, true) => {
                if u > 0.0 {
                    -EDGE * FRAC_PI_2
                } else {
                    EDGE * FRAC_PI_2
                }
            }
            (false, false) => EDGE * u.abs().max(1.0),
            _ => EDGE * u.max(0.5),
        }
    }
}

/// The cost of a problem for argmin, and what has been seen of it.
struct Cost<'s, 'c, 'e, 'a> {
    steps: &'s mut LikelihoodSteps<'c, 'e, 'a>,
    coordinates: Coordinates,
    monitor: &'s mut dyn Monitor,
    best: (f64, Vec<f64>),
    interrupted: bool,
}

impl<'s, 'c, 'e, 'a> Cost<'s, 'c, 'e, 'a> {
    fn simplex(self, start: Vec<f64>) -> (&'s mut LikelihoodSteps<'c, 'e, 'a>, Vec<f64>, bool) {
        let mut corners = vec![start.clone()];
        for (j, u) in start.iter().enumerate() {
            let mut corner = start.clone();
            corner[j] += self.coordinates.edge(j, *u);
            corners.push(corner);
        }
        let seen = RefCell::new(self);
        if let Ok(solver) = NelderMead::new(corners).with_sd_tolerance(SPREAD) {
            let most = PATIENCE * start.len() as u64;
            // whatever ends the search, the best point that was seen counts
            let _ = Executor::new(Shared(&seen), Watched { solver, seen: &seen })
                .configure(|state: IterState<Vec<f64>, (), (), (), (), f64>| state.max_iters(most))
                .timer(false)
                .run();
        }
        seen.into_inner().end()
    }

    fn quasi_newton(self, start: Vec<f64>) -> (&'s mut LikelihoodSteps<'c, 'e, 'a>, Vec<f64>, bool) {
        let most = PATIENCE * start.len() as u64;
        let seen = RefCell::new(self);
        // steps that the quasi-Newton method remembers
        let solver: LBFGS<_, Vec<f64>, Vec<f64>, f64> = LBFGS::new(MoreThuenteLineSearch::new(), 10);
        let _ = Executor::new(Shared(&seen), Watched { solver, seen: &seen })
            .configure(|state: IterState<Vec<f64>, Vec<f64>, (), (), (), f64>| state.param(start).max_iters(most))
            .timer(false)
            .run();
        seen.into_inner().end()
    }

    fn end(self) -> (&'s mut LikelihoodSteps<'c, 'e, 'a>, Vec<f64>, bool) {
        (self.steps, self.best.1, self.interrupted)
    }

    fn cost(&mut self, at: &[f64]) -> f64 {
        let values: Vec<f64> = self.coordinates.outwards(at).into_iter().map(|(v, _)| v).collect();
        self.steps.fresh = false;
        let cost = self.steps.problem.evaluate(&values).map_or(f64::INFINITY, |weights| weights.cost);
        if cost < self.best.0 {
            self.best = (cost, values);
        }
        if cost.is_finite() { cost.min(HOPELESS) } else { HOPELESS }
    }

    /// The exact gradient of the cost by the coordinates; zero where the model has none.
    fn gradient(&mut self, at: &[f64]) -> Vec<f64> {
        let (values, slopes): (Vec<f64>, Vec<f64>) = self.coordinates.outwards(at).into_iter().unzip();
        let none = vec![0.0; at.len()];
        let Ok(weights) = self.steps.linearise(&values, None) else { return none };
        let Some(gradient) = self.steps.gradient(&values, &weights) else { return none };
        gradient.iter().zip(&slopes).map(|(g, s)| g * s).collect()
    }

    /// Records an iteration; true when the monitor asks for the end.
    fn record(&mut self) -> bool {
        let history = &mut self.steps.history;
        let before = history.last().map_or(self.best.0, |i| i.cost);
        let (number, cost) = (history.len(), self.best.0);
        let iteration = Iteration { number, cost, change: cost - before, damping: 0.0, step: 0.0, refused: 0 };
        history.push(iteration);
        self.interrupted = self.monitor.iteration(&iteration, &self.best.1, None).is_break();
        self.interrupted
    }
}

/// argmin asks through shared references.
struct Shared<'r, 's, 'c, 'e, 'a>(&'r RefCell<Cost<'s, 'c, 'e, 'a>>);

impl CostFunction for Shared<'_, '_, '_, '_, '_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, at: &Vec<f64>) -> Result<f64, Error> {
        Ok(self.0.borrow_mut().cost(at))
    }
}

impl Gradient for Shared<'_, '_, '_, '_, '_> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, at: &Vec<f64>) -> Result<Vec<f64>, Error> {
        Ok(self.0.borrow_mut().gradient(at))
    }
}

/// A solver of argmin whose iterations our monitor sees and can end.
struct Watched<'r, 's, 'c, 'e, 'a, S> {
    solver: S,
    /// Not asked of argmin's problem, which a line search that fails takes with it.
    seen: &'r RefCell<Cost<'s, 'c, 'e, 'a>>,
}

impl<O, S, I> Solver<O, I> for Watched<'_, '_, '_, '_, '_, S>
where
    S: Solver<O, I>,
    I: State<Float = f64>,
{
    fn name(&self) -> &str {
        self.solver.name()
    }

    fn init(&mut self, problem: &mut Problem<O>, state: I) -> Result<(I, Option<KV>), Error> {
        self.solver.init(problem, state)
    }

    fn next_iter(&mut self, problem: &mut Problem<O>, state: I) -> Result<(I, Option<KV>), Error> {
        let (state, kv) = self.solver.next_iter(problem, state)?;
        let stop = self.seen.borrow_mut().record();
        let state = if stop { state.terminate_with(TerminationReason::Interrupt) } else { state };
        Ok((state, kv))
    }

    fn terminate(&mut self, state: &I) -> TerminationStatus {
        self.solver.terminate(state)
    }
}
