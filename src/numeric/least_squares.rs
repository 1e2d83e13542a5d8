//! The one bounded Gauss-Newton iteration: damped steps within bounds until none is worth making.
//!
//! A full step is tried first, so that well-behaved problems converge quadratically; when it is refused, damped steps (Levenberg,
//! Marquardt) that are bent along the curve of the response (geodesic acceleration: Transtrum and Sethna 2012). Bounds are kept by
//! an active set (`active_set`), what Gauss-Newton misses of the second derivative is learnt from the gradients where it is slow
//! (`secant`), and unknowns in which the response is affine may follow the others (variable projection: Golub and
//! Pereyra 1973, in the form of Ruhe and Wedin 1980).
//!
//! What a cost is made of is the [`Problem`]'s: measured minus simulated outputs, innovations of a filter, spectra in a frozen noise.

use crate::active_set::{StepBounds, constrained, constrained_among};
use crate::quadratic::Secant;
use crate::quadratic::{Inverse, Quadratic};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::ControlFlow;

/// Part of a step over which the second derivative of the response is measured.
pub const AHEAD: f64 = 0.1;
/// Condition up to which inverting products leaves eight digits for the standard errors.
pub const ACCURATE: f64 = 1e4;

/// Beyond this condition of the scaled Jacobian its products are too coarse and triangles are summed instead.
const PRODUCTS: f64 = 1e6;
/// Rate of convergence above which Gauss-Newton is called slow.
const SLOW: f64 = 0.1;
/// Predicted gain (of the logarithm of the likelihood) below which rates tell about the minimum, not about the way to it.
const NEAR: f64 = 1.0;
/// Part of the tolerance that may be left to go after the last step.
const REST: f64 = 1e-2;
/// Unknowns that make an iteration dearer than digits which no standard error measures. Convergence is then decided by a step, and by
/// what may be left to go behind it, of so many tolerances in standard errors: 1e-4 and 1e-6 by default.
const MANY: usize = 50;
const DECIDED: f64 = 1e5;
const DECIDED_REST: f64 = 1e3;
/// First damping after a full step was refused; columns have unit norm.
const DAMPING: f64 = 1e-3;
/// Damping that is as good as none.
const UNDAMPED: f64 = 1e-12;
/// Damping at which a step cannot be told from none.
const HOPELESS: f64 = 1e15;
/// Largest believable bend of a step, relative to the step.
const BELIEF: f64 = 0.75;
/// Part of its predicted gain that a shortened step must gain to be taken.
const WORTH: f64 = 0.25;
/// Part of its predicted gain that a long step must gain which lands on a bound: one that gains less went by a slope that does not
/// hold so far, and what stands on a bound seldom leaves it again.
const LANDING: f64 = 0.75;
/// How often a refused full step is halved before it is damped.
const HALVINGS: usize = 2;
/// Trials in a row after which damping rises faster, and steps are so short that they need no bending.
const PATIENCE: usize = 12;
/// One affine unknown in so many is worth an evaluation more for every trial.
const ENOUGH: usize = 4;
/// Damping that only keeps a singular block from failing.
const HARDLY: f64 = 1e-12;
/// What an unknown by itself may still gain at the end (of the logarithm of the likelihood): its slope is then a
/// hundredth of its standard error.
const NEGLIGIBLE: f64 = 1e-4;
/// Noise relative to the measurement below which the rounding of the simulation is all that is left.
const NOISE_FREE: f64 = 1e-9;
/// Part of itself by which an unknown may then want to move.
const ROUNDED: f64 = 1e-6;
/// Factors on all start values, in the order in which they are tried.
const FACTORS: [f64; 4] = [0.1, 10.0, 0.01, 100.0];
/// Costs that differ by less are those of the same end.
const SAME: f64 = 1e-6;
/// Changes with every change of what is kept or of what the iteration makes of it.
const VERSION: u16 = 3;

/// A cost that is a sum of weighted squares, near enough for its curvature to be that of its Jacobian.
pub trait Problem {
    /// Why values cannot be evaluated.
    type Failure;
    /// What belongs to a point besides its values: the cost, and the weights of the residuals.
    type Weights: Clone + Default;

    /// Minus the logarithm of the likelihood, without its constant.
    fn cost(&self, weights: &Self::Weights) -> f64;

    /// Changes of the cost below this are rounding.
    fn rounding(&self, weights: &Self::Weights) -> f64;

    /// Mean square of the residuals in units of the noise: 1 where that is estimated.
    fn scatter(&self, weights: &Self::Weights) -> f64 {
        let _ = weights;
        1.0
    }

    /// Size of the noise relative to what is measured.
    fn relative_noise(&self, weights: &Self::Weights) -> f64 {
        let _ = weights;
        1.0
    }

    /// Evaluates the residuals at `values`.
    ///
    /// # Errors
    /// Where the cost cannot be computed.
    fn evaluate(&mut self, values: &[f64]) -> Result<Self::Weights, Self::Failure>;

    /// Evaluates residuals and sensitivities at `values`; `known`: the weights there, if they have just been computed.
    ///
    /// # Errors
    /// As [`Problem::evaluate`].
    fn linearise(&mut self, values: &[f64], known: Option<Self::Weights>) -> Result<Self::Weights, Self::Failure>;

    /// The quadratic of the last linearisation, which was at `values`, priors included.
    fn gather(&mut self, values: &[f64], weights: &Self::Weights, quadratic: &mut Quadratic);

    /// The residuals of the last evaluation become those of the current point.
    fn keep(&mut self) {}

    /// Whether weights must be known before sensitivities can be summed.
    fn is_weighed_first(&self) -> bool {
        false
    }

    /// Sums triangles instead of products from now on; false where that is not possible.
    fn make_precise(&mut self) -> bool {
        false
    }

    /// Writes J'W times the second derivative of the response along `step` to `slope`, from `values` and `ahead`, which is
    /// [`AHEAD`] of the step further on; false where it cannot be computed, none where it is not offered.
    fn second_derivative(
        &mut self,
        values: &[f64],
        ahead: &[f64],
        step: &[f64],
        weights: &Self::Weights,
        slope: &mut [f64],
    ) -> Option<bool> {
        let _ = (values, ahead, step, weights, slope);
        None
    }

    /// An unknown with this value once what it stands for is `factor` times as large.
    fn scaled(&self, unknown: usize, value: f64, factor: f64) -> f64 {
        let _ = unknown;
        value * factor
    }

    /// Evaluations with sensitivities so far, and without.
    fn evaluations(&self) -> (usize, usize) {
        (0, 0)
    }

    /// As [`Problem::evaluations`] from now on, where an iteration goes on.
    fn set_evaluations(&mut self, evaluations: (usize, usize)) {
        let _ = evaluations;
    }
}

/// Where the unknowns may be (P each).
#[derive(Debug, Clone, Copy)]
pub struct Space<'s> {
    /// Start values, within the bounds.
    pub start: &'s [f64],
    /// Least admissible values.
    pub lower: &'s [f64],
    /// Greatest admissible values.
    pub upper: &'s [f64],
    /// Unknowns (indices) in which the response is jointly affine, as far as that is known.
    pub affine: &'s [usize],
    /// Largest believable step of each unknown; empty for any.
    pub reach: &'s [f64],
}

/// How to iterate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Most iterations.
    pub iterations: usize,
    /// Largest step, relative to the unknown or its standard error, at which the values count as converged.
    pub tolerance: f64,
    /// Factor on every step.
    pub gain: f64,
    /// Predicted gain of a full step at which the values count as converged; 0 judges by the step alone.
    pub least_gain: f64,
    /// Damping of the first step.
    pub damping: f64,
    /// Steps that are refused in a row before the iteration ends.
    pub refusals: usize,
    /// Whether an iteration that ends at no determined minimum begins again from scaled start values.
    pub restarts: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            iterations: 100,
            tolerance: 1e-9,
            gain: 1.0,
            least_gain: 0.0,
            damping: 0.0,
            refusals: usize::MAX,
            restarts: true,
        }
    }
}

/// The state after one iteration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Iteration {
    /// Number of the iteration; 0 is the start.
    pub number: usize,
    /// Minus the logarithm of the likelihood, without its constant.
    pub cost: f64,
    /// What this iteration changed of the cost; 0 at the start.
    pub change: f64,
    /// Damping of the step, relative to the scaled information matrix; 0 is a full Gauss-Newton step.
    pub damping: f64,
    /// Largest part of the step, in standard errors; 0 at the start.
    pub step: f64,
    /// Steps that were tried and refused on the way.
    pub refused: usize,
}

/// Why no further step was needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// The last step is below the tolerance, or its predicted gain is.
    SmallStep,
    /// What a step could still gain is lost in the rounding of the cost.
    Rounding,
    /// No step lowers the cost, and the slope is a negligible part of a standard error.
    Stationary,
    /// Every unknown stands at a bound with the cost falling beyond it, or has no influence.
    AllHeld,
    /// No unknown is free.
    NothingToEstimate,
}

/// How an iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Summary {
    /// At a minimum of the cost.
    Converged(Reason),
    /// All iterations were used.
    IterationLimit,
    /// No step lowers the cost, though the slope says that one should.
    NoProgress,
    /// The monitor asked for the end.
    Interrupted,
}

impl Summary {
    /// Whether the values are at a minimum.
    pub fn is_good(self) -> bool {
        matches!(self, Self::Converged(_))
    }
}

/// Watches an iteration; `()` looks away.
pub trait Monitor {
    /// Called at the start and after every accepted step with the values as they stand; `state` makes the bytes from which
    /// [`Snapshot::read`] goes on with the same bits, where that is possible. [`ControlFlow::Break`] ends the iteration.
    fn iteration(
        &mut self,
        iteration: &Iteration,
        values: &[f64],
        state: Option<&dyn Fn() -> Vec<u8>>,
    ) -> ControlFlow<()>;

    /// Whether further steps are to be tried; asked before each, so that the end need not wait for one that is accepted.
    fn goes_on(&mut self) -> bool {
        true
    }
}

impl Monitor for () {
    fn iteration(&mut self, _: &Iteration, _: &[f64], _: Option<&dyn Fn() -> Vec<u8>>) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// What helped an iteration on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fallback {
    /// Unknowns in which the response is affine followed the others (variable projection).
    Projection,
    /// The start values once more, without projection.
    WithoutProjection,
    /// All start values times a factor.
    ScaledStart(f64),
}

impl fmt::Display for Fallback {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Projection => write!(f, "variable projection"),
            Self::WithoutProjection => write!(f, "a second try without projection"),
            Self::ScaledStart(factor) => write!(f, "start values times {factor}"),
        }
    }
}

/// An accepted step.
struct Step {
    /// Its largest part, in standard errors.
    size: f64,
    damping: f64,
    /// How many were refused before it.
    refused: usize,
    /// Which part of it was taken.
    part: f64,
}

/// The problem that is left when affine unknowns follow the others.
#[derive(Debug, Clone)]
struct Projected {
    quadratic: Quadratic,
    bounds: StepBounds,
}

/// Where one of several iterations ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct End {
    values: Vec<f64>,
    cost: f64,
    /// How many directions the data do not determine there.
    lost: usize,
    summary: Summary,
}

impl End {
    fn is_good(&self) -> bool {
        self.summary.is_good() && self.lost == 0
    }

    fn is_like(&self, other: &Self) -> bool {
        self.lost == other.lost && (self.cost - other.cost).abs() <= SAME * (1.0 + other.cost.abs())
    }

    /// Determined ends before others, then the lower cost; the earlier of two alike.
    fn beats(&self, other: &Self) -> bool {
        (self.is_good() && !other.is_good())
            || (self.is_good() == other.is_good() && self.cost < other.cost && !self.is_like(other))
    }
}

/// What has been tried so far: an iteration that ends nowhere, or where the data do not determine the unknowns any more
/// (an exponential that has died out, two rates that have become one), begins again without projection and from scaled
/// start values. The best end counts.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct Restarts {
    /// The best end so far.
    best: Option<End>,
    /// How many factors were used.
    factors: usize,
    /// Whether the current iteration does without projection.
    unprojected: bool,
    /// Whether the current iteration was projected at any time.
    projected: bool,
    /// What helped the current iteration.
    fallbacks: Vec<Fallback>,
    /// What helped that of the best end.
    best_fallbacks: Vec<Fallback>,
}

/// Everything that decides how an iteration goes on, so that one that was interrupted ends with the same bits. What follows from
/// the values (responses, weights, sums) is computed anew: the same values give the same bits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    version: u16,
    values: Vec<f64>,
    damping: f64,
    level: f64,
    precise: bool,
    projecting: bool,
    last: f64,
    predicted: f64,
    secant: Secant,
    restarts: Restarts,
    preliminary: Option<usize>,
    evaluations: (usize, usize),
    history: Vec<Iteration>,
}

impl Snapshot {
    /// Reads what a [`Monitor`] was given for a problem with `unknowns` unknowns.
    ///
    /// # Errors
    /// The reason: bytes that were not written by this version, or for another problem.
    pub fn read(bytes: &[u8], unknowns: usize) -> Result<Self, &'static str> {
        let snapshot: Self = postcard::from_bytes(bytes).map_err(|_| "it is damaged")?;
        if snapshot.version != VERSION {
            return Err("it was kept by another version of this program");
        }
        if snapshot.values.len() != unknowns {
            return Err("it has another number of free parameters");
        }
        if snapshot.history.is_empty() || snapshot.values.iter().any(|v| !v.is_finite()) {
            return Err("it is damaged");
        }
        Ok(snapshot)
    }
}

/// The state of an iteration.
pub struct GaussNewton<'s, P: Problem> {
    /// What is minimised.
    pub problem: P,
    space: Space<'s>,
    options: Options,
    /// The current values.
    pub values: Vec<f64>,
    /// Weights and cost there.
    pub weights: P::Weights,
    /// The quadratic there.
    pub quadratic: Quadratic,
    /// The inverse of its information on what can move.
    pub inverse: Inverse,
    /// The state after each iteration, the start first.
    pub history: Vec<Iteration>,
    /// Whether the problem's sums belong to the current values.
    pub fresh: bool,
    /// The bounds as far as steps reach.
    near: (Vec<f64>, Vec<f64>),
    bounds: StepBounds,
    step: Vec<f64>,
    trial: Vec<f64>,
    damping: f64,
    /// The last damping above 0: where to go back to when a full step fails.
    level: f64,
    precise: bool,
    /// What the step before was predicted to gain, when the cost could not measure it; infinite otherwise.
    last: f64,
    /// What Gauss-Newton predicted before the last step: infinite at the start, NaN after a damped one.
    predicted: f64,
    secant: Secant,
    restarts: Restarts,
    /// Iterations of another method before the steps; none as long as it has not ended.
    preliminary: Option<usize>,
    /// Whether affine unknowns follow the others.
    projecting: bool,
    /// What is left to iterate then, at the current values.
    projected: Option<Projected>,
}

impl<'s, P: Problem> GaussNewton<'s, P> {
    /// At the start values; nothing is evaluated yet.
    pub fn new(problem: P, space: Space<'s>, options: Options) -> Self {
        Self {
            problem,
            space,
            options,
            values: space.start.to_vec(),
            weights: P::Weights::default(),
            quadratic: Quadratic::default(),
            inverse: Inverse::default(),
            history: Vec::new(),
            fresh: false,
            near: (space.lower.to_vec(), space.upper.to_vec()),
            bounds: StepBounds::default(),
            step: Vec::new(),
            trial: space.start.to_vec(),
            damping: options.damping,
            level: DAMPING,
            precise: false,
            last: f64::INFINITY,
            predicted: f64::INFINITY,
            secant: Secant::default(),
            restarts: Restarts::default(),
            preliminary: None,
            projecting: false,
            projected: None,
        }
    }

    /// Iterates from the start values, or from a state that was kept, until the end. `preliminary` may bring the values nearer
    /// before the first step (see [`Self::begin_at`]); it says whether the monitor asked for the end.
    ///
    /// # Errors
    /// The failure at the start values.
    pub fn run(
        &mut self,
        resume: Option<Snapshot>,
        preliminary: impl FnOnce(&mut Self, &mut dyn Monitor) -> Result<bool, P::Failure>,
        monitor: &mut dyn Monitor,
    ) -> Result<Summary, P::Failure> {
        let interrupted = match resume {
            Some(snapshot) => self.restore(snapshot).map(|()| false)?,
            None => {
                self.start()?;
                self.record_start(monitor)
            }
        };
        if self.values.is_empty() {
            return Ok(Summary::Converged(Reason::NothingToEstimate));
        }
        if interrupted {
            return Ok(Summary::Interrupted);
        }
        if self.preliminary.is_none() {
            self.preliminary = Some(0);
            if preliminary(self, monitor)? {
                return Ok(Summary::Interrupted);
            }
        }
        loop {
            let end = self.iterate(monitor);
            if let Some(end) = self.judge(end, monitor)? {
                return Ok(end);
            }
        }
    }

    /// Begins at other values, which a preliminary search has reached.
    ///
    /// # Errors
    /// The failure there.
    pub fn begin_at(&mut self, values: Vec<f64>) -> Result<(), P::Failure> {
        self.preliminary = Some(self.history.len() - 1);
        self.values = values;
        self.start()
    }

    /// What helped the iteration on that is reported.
    pub fn fallbacks(&mut self) -> Vec<Fallback> {
        std::mem::take(&mut self.restarts.fallbacks)
    }

    /// Takes steps from the current values until one iteration is over.
    fn iterate(&mut self, monitor: &mut dyn Monitor) -> Summary {
        loop {
            if !self.quadratic.is_finite() {
                return Summary::NoProgress;
            }
            let solved = self.full_step();
            if self.inverse.chosen.is_empty() {
                return Summary::Converged(Reason::AllHeld);
            }
            let rounding = self.problem.rounding(&self.weights);
            let straight = if solved { self.quadratic.reduction(&self.step) } else { f64::INFINITY };
            if self.options.least_gain > 0.0 && straight <= self.options.least_gain.max(rounding) {
                return Summary::Converged(Reason::SmallStep);
            }
            let rate = (straight / self.predicted).max(0.0).sqrt();
            if solved {
                self.learn(rate);
            }
            let promise = if solved { self.quadratic.reduction(&self.step) } else { f64::INFINITY };
            if solved && self.is_close(rate) {
                self.finish();
                return Summary::Converged(Reason::SmallStep);
            }
            // while steps shrink they are made, though the cost cannot measure them any more
            let unmeasurable = promise <= rounding;
            if unmeasurable && promise >= self.last {
                return Summary::Converged(Reason::Rounding);
            }
            self.last = if unmeasurable { promise } else { f64::INFINITY };
            if self.iterations() >= self.options.iterations {
                return Summary::IterationLimit;
            }
            let before = self.cost();
            let Some(step) = self.take_step(unmeasurable, monitor) else {
                return match unmeasurable {
                    true => Summary::Converged(Reason::Rounding),
                    false if monitor.goes_on() => self.stuck(),
                    false => Summary::Interrupted,
                };
            };
            self.predicted = if step.damping == 0.0 && step.part == 1.0 { straight } else { f64::NAN };
            if self.record(monitor, before, &step) {
                return Summary::Interrupted;
            }
        }
    }

    /// The cost at the current values.
    pub fn cost(&self) -> f64 {
        self.problem.cost(&self.weights)
    }

    /// Evaluates at the current values.
    ///
    /// # Errors
    /// The failure there.
    pub fn start(&mut self) -> Result<(), P::Failure> {
        let values = self.values.clone();
        self.weights = self.linearise(&values, None)?;
        self.problem.keep();
        self.settle();
        Ok(())
    }

    /// Evaluates response and sensitivities; returns cost and weights there.
    ///
    /// # Errors
    /// The failure there.
    pub fn linearise(&mut self, values: &[f64], known: Option<P::Weights>) -> Result<P::Weights, P::Failure> {
        self.fresh = false;
        self.problem.linearise(values, known)
    }

    /// Iterations made so far.
    fn iterations(&self) -> usize {
        self.history.len().saturating_sub(1 + self.preliminary.unwrap_or(0))
    }

    /// The gradient of the cost at `values`, which has just been linearised; none when it is not finite.
    pub fn gradient(&mut self, values: &[f64], weights: &P::Weights) -> Option<Vec<f64>> {
        self.problem.gather(values, weights, &mut self.quadratic);
        let parts = self.quadratic.rhs.iter().zip(&self.quadratic.scale);
        self.quadratic.is_finite().then(|| parts.map(|(r, s)| -r * s).collect())
    }

    /// The quadratic at the current values, from products or, when they are too coarse, from triangles.
    pub fn settle(&mut self) {
        self.fresh = true;
        self.gather();
        if self.inverse.condition > PRODUCTS {
            self.refine();
        }
    }

    /// Evaluates again, summing triangles from now on. The problem has just been evaluated at these values; should it
    /// fail now, the coarse quadratic stays.
    pub fn refine(&mut self) {
        if self.precise || !self.problem.make_precise() {
            return;
        }
        self.precise = true;
        let values = self.values.clone();
        if self.linearise(&values, Some(self.weights.clone())).is_ok() {
            self.fresh = true;
            self.gather();
        }
    }

    /// The quadratic of what was last linearised, and its inverse.
    pub fn gather(&mut self) {
        self.projected = None;
        self.problem.gather(&self.values, &self.weights, &mut self.quadratic);
        for (j, reach) in self.space.reach.iter().enumerate() {
            self.near.0[j] = self.space.lower[j].max(self.values[j] - reach);
            self.near.1[j] = self.space.upper[j].min(self.values[j] + reach);
        }
        self.bounds.measure(&self.values, &self.near.0, &self.near.1, &self.quadratic.scale);
        let movable = self.bounds.movable(&self.quadratic);
        let spent = std::mem::take(&mut self.inverse);
        self.inverse = self.quadratic.invert(movable, spent).unwrap_or_else(|| Inverse {
            chosen: self.bounds.movable(&self.quadratic),
            condition: f64::INFINITY,
            ..Inverse::default()
        });
    }

    /// The undamped step; false when it cannot be told.
    fn full_step(&mut self) -> bool {
        let solved = constrained(&self.quadratic, &self.bounds, 0.0, &mut self.step) && self.keeps_promise();
        if !solved && self.damping == 0.0 {
            self.damping = self.level;
        }
        solved
    }

    /// Learns the curvature that Gauss-Newton misses once it is slow, and takes it into account.
    fn learn(&mut self, rate: f64) {
        // noise that was stated far too large would make every place look near
        let near = self.quadratic.reduction(&self.step) <= NEAR * self.problem.scatter(&self.weights).min(1.0);
        let learn = near && (rate > SLOW || (self.secant.is_active() && !rate.is_nan()));
        self.secant.visit(&self.values, &self.quadratic, learn);
        if self.secant.is_active() {
            self.quadratic.curve(&self.secant.matrix);
            if !self.full_step() {
                self.straighten();
            }
        }
    }

    /// Goes back to the step of Gauss-Newton.
    fn straighten(&mut self) {
        self.secant.clear();
        self.quadratic.curve(&[]);
        self.full_step();
    }

    /// Whether no step is worth making after the one that is predicted: it is small, and by the rate at which
    /// steps shrink all that would follow are smaller still. Of many unknowns a small part of a standard error is enough.
    fn is_close(&self, rate: f64) -> bool {
        let size = self.relative_step();
        let rate = if rate.is_nan() { 0.5 } else { rate.min(0.99) };
        let tolerance = self.options.tolerance;
        if size <= tolerance && size * rate / (1.0 - rate) <= REST * tolerance {
            return true;
        }
        let errors = if self.values.len() >= MANY { self.largest_in_errors() } else { f64::INFINITY };
        errors <= DECIDED * tolerance && errors * rate / (1.0 - rate) <= DECIDED_REST * tolerance
    }

    /// Largest part of the step, relative to the unknown or its standard error, whichever is greater.
    fn relative_step(&self) -> f64 {
        self.parts().map(|(j, s, error)| s / self.values[j].abs().max(error)).fold(0.0, f64::max)
    }

    /// Largest part of the step in standard errors.
    fn largest_in_errors(&self) -> f64 {
        self.parts().map(|(_, s, error)| s / error).filter(|r| r.is_finite()).fold(0.0, f64::max)
    }

    /// Unknown, size of the step and standard error of everything that moves.
    fn parts(&self) -> impl Iterator<Item = (usize, f64, f64)> {
        let n = self.inverse.chosen.len();
        self.inverse.chosen.iter().enumerate().filter_map(move |(k, j)| {
            let scale = self.quadratic.scale[*j];
            let error = self.inverse.values.get(k * n + k).map_or(0.0, |v| v.max(0.0).sqrt() / scale);
            (self.step[*j] != 0.0).then(|| (*j, (self.step[*j] / scale).abs(), error))
        })
    }

    fn stuck(&mut self) -> Summary {
        self.straighten();
        let promise = self.quadratic.reduction(&self.step);
        if promise <= 1e-6 && self.largest_in_errors() <= 1e-3 {
            return Summary::Converged(Reason::Stationary);
        }
        // noise-free data: what is left is the rounding of the simulation, which no standard error measures
        let matched = self.problem.relative_noise(&self.weights) <= 1e-9 && self.relative_step() <= 1e-6;
        if matched { Summary::Converged(Reason::Rounding) } else { Summary::NoProgress }
    }

    fn record_start(&mut self, monitor: &mut dyn Monitor) -> bool {
        let start = Step { size: 0.0, damping: 0.0, refused: 0, part: 1.0 };
        self.record(monitor, self.cost(), &start)
    }

    /// Adds to the history; true when the monitor asks for the end.
    fn record(&mut self, monitor: &mut dyn Monitor, before: f64, taken: &Step) -> bool {
        let (number, cost) = (self.history.len(), self.cost());
        let Step { size, damping, refused, .. } = *taken;
        let iteration = Iteration { number, cost, change: cost - before, damping, step: size, refused };
        self.history.push(iteration);
        monitor.iteration(&iteration, &self.values, Some(&|| self.snapshot())).is_break()
    }
}

/// Trials: a full step, halves of it, damped and bent ones.
impl<P: Problem> GaussNewton<'_, P> {
    /// Tries steps with rising damping until one is accepted; none when there is no hope left. A gain that is
    /// `unmeasurable` in the cost is tried once, undamped, and taken on trust.
    fn take_step(&mut self, unmeasurable: bool, monitor: &mut dyn Monitor) -> Option<Step> {
        if unmeasurable {
            self.damping = 0.0;
        }
        for refused in 0..self.options.refusals {
            if self.damping > HOPELESS || (unmeasurable && refused > 0) || !monitor.goes_on() {
                return None;
            }
            if !self.propose(refused) {
                continue;
            }
            if !self.set_trial() {
                return None;
            }
            let (promise, damping) = (self.quadratic.reduction(&self.step), self.damping);
            let size = self.largest_in_errors();
            if let Some(gain) = self.attempt(unmeasurable, refused == 0) {
                self.projecting &= damping > 0.0 || refused > 0;
                self.damp_less(gain / promise, unmeasurable);
                return Some(Step { size, damping, refused, part: 1.0 });
            }
            if self.damping == 0.0 && self.secant.is_active() {
                self.straighten();
                continue;
            }
            if refused == 0
                && !unmeasurable
                && let Some(part) = self.shorten(promise)
            {
                return Some(Step { size: part * size, damping, refused: 1, part });
            }
            if !unmeasurable && !self.projecting && self.can_project() {
                if let Some(step) = self.begin_projection(refused + 1) {
                    return Some(step);
                }
                if self.projecting {
                    continue;
                }
            }
            self.damp_more(if refused < PATIENCE { 2.0 } else { 8.0 });
        }
        None
    }

    /// Far from the minimum takes a part of the full step that was refused, where it gains what its length predicts: the direction is good then,
    /// and one response is cheaper than to find another. Gives the part.
    fn shorten(&mut self, promise: f64) -> Option<f64> {
        let far = promise > 1.0 && self.largest_in_errors() > 1.0;
        if self.damping > 0.0 || self.options.gain != 1.0 || self.projecting || !far {
            return None;
        }
        let (full, whole) = (self.step.clone(), self.cost());
        let mut part = 1.0;
        for _ in 0..HALVINGS {
            part *= 0.5;
            self.step.iter_mut().zip(&full).for_each(|(s, f)| *s = part * f);
            // what a quadratic cost would gain
            let least = WORTH * promise * part * (2.0 - part);
            if !self.set_trial() {
                break;
            }
            self.fresh = false;
            let there = self.problem.evaluate(&self.trial).ok().map(|weights| self.problem.cost(&weights));
            if there.is_some_and(|cost| whole - cost >= least) && self.attempt(false, true).is_some() {
                return Some(part);
            }
        }
        self.step = full;
        None
    }

    /// Computes the step under the current damping; false when it cannot be believed and damping was raised.
    fn propose(&mut self, refused: usize) -> bool {
        if self.damping == 0.0 {
            return true;
        }
        let bent = refused < PATIENCE;
        let bend = if self.projecting {
            self.projected_step(bent)
        } else if !constrained(&self.quadratic, &self.bounds, self.damping, &mut self.step) {
            self.damp_more(2.0);
            return false;
        } else if bent {
            self.bend()
        } else {
            0.0
        };
        let believed = bend <= BELIEF;
        if !believed {
            self.damp_more(if bend.is_nan() { 8.0 } else { (bend / BELIEF).clamp(2.0, 8.0) });
        }
        believed
    }

    /// Bends the damped step along the curve of the response; gives the bend relative to the step.
    fn bend(&mut self) -> f64 {
        match self.slope_of_bend() {
            None => 0.0,
            Some(None) => f64::INFINITY,
            Some(Some(slope)) => self.bounds.bend(&self.quadratic, self.damping, &slope, &mut self.step),
        }
    }

    /// The second derivative of the response along the step, as a (scaled) slope of the cost: none where the problem does not
    /// offer it, none within where it cannot be computed.
    fn slope_of_bend(&mut self) -> Option<Option<Vec<f64>>> {
        let step = self.unscaled(&self.step);
        let mut ahead: Vec<f64> = self.values.iter().zip(&step).map(|(v, s)| v + AHEAD * s).collect();
        self.fresh = false;
        if self.projecting && !self.follow_in_trial(&mut ahead) {
            return Some(None);
        }
        let mut slope = vec![0.0; step.len()];
        let computed = self.problem.second_derivative(&self.values, &ahead, &step, &self.weights, &mut slope)?;
        Some(computed.then(|| self.unscaled(&slope)))
    }

    fn unscaled(&self, scaled: &[f64]) -> Vec<f64> {
        let parts = scaled.iter().zip(&self.quadratic.scale);
        parts.map(|(v, d)| if *d > 0.0 { v / d } else { 0.0 }).collect()
    }

    /// Applies the scaled step, times the gain, to the current values; what reaches a bound stands on it to the bit; false when nothing changes.
    fn set_trial(&mut self) -> bool {
        let gain = self.options.gain;
        for (j, s) in self.step.iter_mut().enumerate() {
            let scale = self.quadratic.scale[j];
            let (lower, upper) = (self.near.0[j], self.near.1[j]);
            self.trial[j] = if *s < 0.0 && *s <= self.bounds.down[j] {
                lower
            } else if *s > 0.0 && *s >= self.bounds.up[j] {
                upper
            } else if scale > 0.0 {
                *s *= gain;
                (self.values[j] + *s / scale).max(lower).min(upper)
            } else {
                self.values[j]
            };
        }
        self.trial != self.values
    }

    /// Evaluates the trial; when it is better it becomes the current point, and what it gained is returned. The first
    /// trial is usually accepted and gets its sensitivities at once, later ones must show their cost first.
    fn attempt(&mut self, unmeasurable: bool, bold: bool) -> Option<f64> {
        let mut trial = std::mem::take(&mut self.trial);
        if self.projecting && !unmeasurable && !self.follow_in_trial(&mut trial) {
            self.trial = trial;
            return None;
        }
        let accepted = self.compare(&trial, unmeasurable, bold && !self.problem.is_weighed_first());
        let Some(weights) = accepted else {
            self.trial = trial;
            return None;
        };
        let gain = self.cost() - self.problem.cost(&weights);
        self.problem.keep();
        self.weights = weights;
        self.trial = std::mem::replace(&mut self.values, trial);
        self.settle();
        Some(gain)
    }

    fn compare(&mut self, trial: &[f64], unmeasurable: bool, bold: bool) -> Option<P::Weights> {
        let here = self.cost();
        let allowed = if unmeasurable { here + self.problem.rounding(&self.weights) } else { here };
        let allowed = allowed - if unmeasurable { 0.0 } else { self.least_gain(trial) };
        let better = |cost: f64| cost < allowed || (unmeasurable && cost == allowed);
        if bold {
            let weights = self.linearise(trial, None).ok()?;
            return better(self.problem.cost(&weights)).then_some(weights);
        }
        self.fresh = false;
        let weights = self.problem.evaluate(trial).ok()?;
        if !better(self.problem.cost(&weights)) {
            return None;
        }
        self.linearise(trial, Some(weights)).ok()
    }

    /// What a trial must gain at least.
    fn least_gain(&self, trial: &[f64]) -> f64 {
        let (lower, upper) = (self.space.lower, self.space.upper);
        let lands = |j: usize| trial[j] != self.values[j] && (trial[j] == lower[j] || trial[j] == upper[j]);
        if !(0..trial.len()).any(lands) || self.largest_in_errors() <= 1.0 {
            return 0.0;
        }
        let promise = self.quadratic.reduction(&self.step);
        if promise > 1.0 && promise.is_finite() { LANDING * promise } else { 0.0 }
    }

    fn damp_more(&mut self, factor: f64) {
        self.damping = if self.damping > 0.0 { self.damping * factor } else { self.level };
    }

    /// `ratio`: gain over what was predicted. Damping falls as long as steps succeed, though they gain little: along a curved
    /// valley it is better to be refused now and then than to crawl.
    fn damp_less(&mut self, ratio: f64, unmeasurable: bool) {
        if unmeasurable {
            self.damping = 0.0;
        } else if self.damping > 0.0 {
            self.level = (self.damping * 0.2).max(UNDAMPED);
            self.damping = if ratio > 0.9 || self.level == UNDAMPED { 0.0 } else { self.level };
        }
    }

    /// Makes the last, tiny step; its sensitivities are those of the point before.
    fn finish(&mut self) {
        if !self.set_trial() {
            return;
        }
        let Ok(weights) = self.problem.evaluate(&self.trial) else { return };
        if self.problem.cost(&weights) <= self.cost() + self.problem.rounding(&self.weights) {
            self.problem.keep();
            std::mem::swap(&mut self.values, &mut self.trial);
            self.weights = weights;
        }
    }
}

/// Stationarity: what says that a step is the minimum of its quadratic and that the end is a minimum of the cost, without asking
/// the solver: no unknown by itself may be predicted to lower the cost.
impl<P: Problem> GaussNewton<'_, P> {
    /// Whether the step in hand gains at least what every unknown would gain by itself. A step that does not is no minimum,
    /// and the little it is predicted to gain says nothing about convergence.
    fn keeps_promise(&self) -> bool {
        let promise = self.quadratic.reduction(&self.step);
        let most = self.alone().map(|(_, _, gain)| gain).fold(0.0, f64::max);
        most <= 1.001 * promise + self.problem.rounding(&self.weights) + 1e-9
    }

    /// Whether the cost is flat at the current values, which have just been linearised, in every direction that the
    /// bounds leave open: flat beside a standard error, beside the rounding of the cost, or beside the tolerance.
    fn is_stationary(&self) -> bool {
        let noise_free = self.problem.relative_noise(&self.weights) <= NOISE_FREE;
        let tolerance = if noise_free { self.options.tolerance.max(ROUNDED) } else { self.options.tolerance };
        let least = NEGLIGIBLE.max(4.0 * self.problem.rounding(&self.weights));
        let flat = |(j, step, gain): (usize, f64, f64)| {
            gain <= least || (step / self.quadratic.scale[j]).abs() <= tolerance * self.values[j].abs()
        };
        self.alone().all(flat)
    }

    /// For every unknown with influence the (scaled) step down the slope that it can take by itself, and what that gains.
    fn alone(&self) -> impl Iterator<Item = (usize, f64, f64)> {
        let influential = (0..self.values.len()).filter(|j| self.quadratic.scale[*j] > 0.0);
        influential.map(|j| {
            let step = self.quadratic.rhs[j].max(self.bounds.down[j]).min(self.bounds.up[j]);
            (j, step, self.quadratic.reduction_along(j, step))
        })
    }
}

/// Variable projection: affine unknowns are set to their best values for every trial of the others, and damping acts on the others
/// alone. What is left to iterate has fewer unknowns and a valley less curved.
impl<P: Problem> GaussNewton<'_, P> {
    /// Whether enough unknowns are affine to make the others' problem an easier one, but not all.
    fn can_project(&self) -> bool {
        let (affine, all) = (self.space.affine.len(), self.values.len());
        !self.restarts.unprojected && affine * ENOUGH >= all && affine < all
    }

    /// Begins to project: affine unknowns go to their best values here, which is a step by itself when it gains
    /// anything.
    fn begin_projection(&mut self, refused: usize) -> Option<Step> {
        self.refine();
        self.projecting = self.quadratic.is_precise();
        if !self.projecting {
            return None;
        }
        if !std::mem::replace(&mut self.restarts.projected, true) {
            self.restarts.fallbacks.push(Fallback::Projection);
        }
        self.step.fill(0.0);
        self.follow();
        if !self.set_trial() {
            return None;
        }
        let size = self.largest_in_errors();
        self.attempt(false, false)?;
        Some(Step { size, damping: self.level, refused, part: 1.0 })
    }

    /// Solves for the affine unknowns while the others keep their part of the step.
    fn follow(&mut self) {
        if !constrained_among(&self.quadratic, &self.bounds, self.space.affine, HARDLY, &mut self.step) {
            self.space.affine.iter().for_each(|j| self.step[*j] = 0.0);
        }
    }

    /// The damped and bent step of the others, with the affine unknowns following it. Gives the bend relative to the
    /// step, infinite when there is no step.
    fn projected_step(&mut self, bent: bool) -> f64 {
        let projected = self.projected.take().unwrap_or_else(|| self.project());
        let mut step = Vec::new();
        let mut bend = f64::INFINITY;
        if constrained(&projected.quadratic, &projected.bounds, self.damping, &mut step) {
            self.lift(&projected, &step);
            bend = if bent { self.bend_projected(&projected, &mut step) } else { 0.0 };
            self.lift(&projected, &step);
        }
        self.projected = Some(projected);
        bend
    }

    fn project(&self) -> Projected {
        let quadratic = self.quadratic.without(self.space.affine);
        let bounds = StepBounds::at(&self.values, &self.near.0, &self.near.1, &quadratic.scale);
        Projected { quadratic, bounds }
    }

    /// The step of all unknowns that belongs to a step of the others.
    fn lift(&mut self, projected: &Projected, step: &[f64]) {
        let scales = self.quadratic.scale.iter().zip(&projected.quadratic.scale);
        self.step =
            step.iter().zip(scales).map(|(s, (all, own))| if *own > 0.0 { s * all / own } else { 0.0 }).collect();
        self.follow();
    }

    /// As [`Self::bend`], seen by the others alone.
    fn bend_projected(&mut self, projected: &Projected, step: &mut [f64]) -> f64 {
        let slope = match self.slope_of_bend() {
            None => return 0.0,
            Some(None) => return f64::INFINITY,
            Some(Some(slope)) => slope,
        };
        let Some(taken) = self.quadratic.apply_inverse(self.space.affine, HARDLY, &slope) else {
            return f64::INFINITY;
        };
        let explained = self.quadratic.times_scaled(&taken);
        let scales = self.quadratic.scale.iter().zip(&projected.quadratic.scale);
        let rest = slope.iter().zip(&explained).zip(scales);
        let rest: Vec<f64> =
            rest.map(|((s, e), (all, own))| if *own > 0.0 { (s - e) * all / own } else { 0.0 }).collect();
        projected.bounds.bend(&projected.quadratic, self.damping, &rest, step)
    }

    /// Moves the affine unknowns of a trial to their best values there; false when the trial cannot be evaluated.
    fn follow_in_trial(&mut self, trial: &mut [f64]) -> bool {
        let Ok(weights) = self.linearise(trial, None) else { return false };
        let mut there = Quadratic::default();
        self.problem.gather(trial, &weights, &mut there);
        if !there.is_finite() || !self.problem.cost(&weights).is_finite() {
            return false;
        }
        let bounds = StepBounds::at(trial, self.space.lower, self.space.upper, &there.scale);
        let mut step = vec![0.0; trial.len()];
        if constrained_among(&there, &bounds, self.space.affine, 0.0, &mut step) {
            for (j, s) in step.iter().enumerate().filter(|(_, s)| **s != 0.0) {
                trial[j] = (trial[j] + s / there.scale[j]).max(self.space.lower[j]).min(self.space.upper[j]);
            }
        }
        true
    }
}

/// Restarts and checkpoints.
impl<P: Problem> GaussNewton<'_, P> {
    /// Looks at the end of an iteration: none when another one has begun, else how the whole ends, with the best
    /// values in place.
    fn judge(&mut self, summary: Summary, monitor: &mut dyn Monitor) -> Result<Option<Summary>, P::Failure> {
        if !self.options.restarts {
            return Ok(Some(summary));
        }
        let interrupted = summary == Summary::Interrupted;
        let hopeless = matches!(summary, Summary::Interrupted | Summary::IterationLimit);
        let lost = self.lost();
        // a small step has been made since the slope was known, and was solved for to make it vanish
        let unproven = matches!(summary, Summary::Converged(reason) if reason != Reason::SmallStep);
        let summary = if unproven && !self.is_stationary() { Summary::NoProgress } else { summary };
        let end = End { values: self.values.clone(), cost: self.cost(), lost, summary };
        if (end.is_good() || hopeless) && self.restarts.best.is_none() {
            return Ok(Some(end.summary));
        }
        let repeated = self.restarts.best.as_ref().is_some_and(|best| end.is_like(best));
        let over = end.is_good() || hopeless || repeated;
        if self.restarts.best.as_ref().is_none_or(|best| end.beats(best)) {
            self.restarts.best = Some(end);
            self.restarts.best_fallbacks = self.restarts.fallbacks.clone();
        }
        if over || self.iterations() >= self.options.iterations || !self.begin_again() {
            let best = self.settle_for_best()?;
            return Ok(Some(if interrupted { Summary::Interrupted } else { best }));
        }
        Ok(self.record_start(monitor).then_some(Summary::Interrupted))
    }

    /// How many directions are not determined at the current values, as far as can be told.
    fn lost(&mut self) -> usize {
        let values = self.values.clone();
        if !self.fresh && self.linearise(&values, Some(self.weights.clone())).is_ok() {
            self.settle();
        }
        if self.inverse.condition > ACCURATE {
            self.refine();
        }
        let inside = |j: &usize| self.space.lower[*j] < values[*j] && values[*j] < self.space.upper[*j];
        let idle = (0..values.len()).filter(inside).filter(|j| self.quadratic.scale[*j] == 0.0).count();
        idle + self.inverse.null.len()
    }

    /// Goes to the next start that can be evaluated; false when there is none left.
    fn begin_again(&mut self) -> bool {
        loop {
            let projected = self.restarts.projected && !self.restarts.unprojected && self.restarts.factors == 0;
            let fallback = if projected {
                self.restarts.unprojected = true;
                Fallback::WithoutProjection
            } else {
                let Some(factor) = FACTORS.get(self.restarts.factors) else { return false };
                self.restarts.factors += 1;
                self.restarts.unprojected = false;
                Fallback::ScaledStart(*factor)
            };
            self.restarts.projected = false;
            self.restarts.fallbacks = vec![fallback];
            self.reset(if let Fallback::ScaledStart(factor) = fallback { factor } else { 1.0 });
            if self.start().is_ok() {
                return true;
            }
        }
    }

    fn reset(&mut self, factor: f64) {
        let bounds = self.space.lower.iter().zip(self.space.upper);
        let scaled = self.space.start.iter().zip(bounds).enumerate();
        let scaled = scaled.map(|(j, (v, (lower, upper)))| self.problem.scaled(j, *v, factor).max(*lower).min(*upper));
        self.values = scaled.collect();
        (self.damping, self.level) = (self.options.damping, DAMPING);
        (self.last, self.predicted) = (f64::INFINITY, f64::INFINITY);
        self.secant = Secant::default();
        self.projecting = false;
    }

    /// Puts the best values back in place.
    fn settle_for_best(&mut self) -> Result<Summary, P::Failure> {
        let Some(best) = self.restarts.best.clone() else { return Ok(Summary::NoProgress) };
        self.restarts.fallbacks = std::mem::take(&mut self.restarts.best_fallbacks);
        if best.values != self.values {
            self.values = best.values;
            self.secant = Secant::default();
            self.start()?;
        }
        Ok(best.summary)
    }

    /// The state after the last iteration that was recorded.
    fn snapshot(&self) -> Vec<u8> {
        let snapshot = Snapshot {
            version: VERSION,
            values: self.values.clone(),
            damping: self.damping,
            level: self.level,
            precise: self.precise,
            projecting: self.projecting,
            last: self.last,
            predicted: self.predicted,
            secant: self.secant.clone(),
            restarts: self.restarts.clone(),
            preliminary: self.preliminary,
            evaluations: self.problem.evaluations(),
            history: self.history.clone(),
        };
        // numbers and lists of numbers always have bytes; none would be refused as damaged
        postcard::to_stdvec(&snapshot).unwrap_or_default()
    }

    /// Goes back to a state and evaluates what follows from it, which is not counted.
    fn restore(&mut self, snapshot: Snapshot) -> Result<(), P::Failure> {
        let Snapshot { values, damping, level, precise, projecting, last, predicted, secant, restarts, .. } = snapshot;
        self.trial.clone_from(&values);
        (self.values, self.damping, self.level, self.last) = (values, damping, level, last);
        (self.predicted, self.secant, self.restarts, self.projecting) = (predicted, secant, restarts, projecting);
        (self.preliminary, self.history) = (snapshot.preliminary, snapshot.history);
        if precise {
            self.precise = true;
            self.problem.make_precise();
        }
        self.start()?;
        self.problem.set_evaluations(snapshot.evaluations);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// y = a exp(-b x) + c at 40 places, unit weights.
    struct Decay {
        measured: Vec<f64>,
        values: [f64; 3],
        counts: (usize, usize),
    }

    impl Decay {
        fn new() -> Self {
            let measured = (0..40).map(|k| {
                let x = 3.0 * f64::from(k) / 39.0;
                2.0 * (-1.5 * x).exp() + 0.1 + 1e-3 * (7.0 * f64::from(k)).sin()
            });
            Self { measured: measured.collect(), values: [0.0; 3], counts: (0, 0) }
        }

        fn row(k: usize, v: &[f64]) -> (f64, [f64; 3]) {
            let x = 3.0 * k as f64 / 39.0;
            let e = (-v[1] * x).exp();
            (v[0] * e + v[2], [e, -v[0] * x * e, 1.0])
        }
    }

    impl Problem for Decay {
        type Failure = ();
        type Weights = f64;

        fn cost(&self, weights: &f64) -> f64 {
            *weights
        }

        fn rounding(&self, weights: &f64) -> f64 {
            1e-15 * weights.abs()
        }

        fn evaluate(&mut self, values: &[f64]) -> Result<f64, ()> {
            self.counts.1 += 1;
            let square = |(k, z): (usize, &f64)| (z - Self::row(k, values).0).powi(2);
            let cost = 5e5 * self.measured.iter().enumerate().map(square).sum::<f64>();
            if cost.is_finite() { Ok(cost) } else { Err(()) }
        }

        fn linearise(&mut self, values: &[f64], _: Option<f64>) -> Result<f64, ()> {
            self.values.copy_from_slice(values);
            self.counts.0 += 1;
            self.evaluate(values)
        }

        fn gather(&mut self, _: &[f64], _: &f64, quadratic: &mut Quadratic) {
            quadratic.begin(3);
            let (hessian, rhs) = quadratic.products();
            for (k, z) in self.measured.iter().enumerate() {
                let (y, row) = Self::row(k, &self.values);
                for i in 0..3 {
                    (i..3).for_each(|j| hessian[3 * i + j] += 1e6 * row[i] * row[j]);
                    rhs[i] += 1e6 * row[i] * (z - y);
                }
            }
            quadratic.end();
        }

        fn evaluations(&self) -> (usize, usize) {
            self.counts
        }
    }

    fn run(lower: f64, options: Options) -> (Summary, Vec<f64>, usize) {
        let (start, lower, upper) = ([0.7, 0.4, 0.0], [0.0, lower, -1.0], [9.0; 3]);
        let space = Space { start: &start, lower: &lower, upper: &upper, affine: &[], reach: &[] };
        let mut newton = GaussNewton::new(Decay::new(), space, options);
        let end = newton.run(None, |_, _| Ok(false), &mut ()).expect("finite at the start");
        (end, newton.values, newton.history.len())
    }

    #[test]
    fn a_decay_is_found_by_steps_or_by_gain() {
        let (end, values, count) = run(0.0, Options::default());
        assert_eq!(end, Summary::Converged(Reason::SmallStep));
        assert!((values[0] - 2.0).abs() < 1e-2 && (values[1] - 1.5).abs() < 1e-2, "{values:?}");
        let (end, near, fewer) = run(0.0, Options { least_gain: 1e-3, restarts: false, ..Options::default() });
        assert!(end.is_good() && fewer <= count, "{end:?}");
        assert!((near[1] / values[1] - 1.0).abs() < 1e-3, "{near:?}");
    }

    #[test]
    fn steps_are_no_longer_than_they_reach() {
        let (start, lower, upper) = ([0.7, 0.4, 0.0], [f64::NEG_INFINITY; 3], [f64::INFINITY; 3]);
        let reach = [f64::INFINITY, 0.05, f64::INFINITY];
        let space = Space { start: &start, lower: &lower, upper: &upper, affine: &[], reach: &reach };
        let mut newton = GaussNewton::new(Decay::new(), space, Options { restarts: false, ..Options::default() });
        struct Watch(f64, f64);
        impl Monitor for Watch {
            fn iteration(&mut self, _: &Iteration, values: &[f64], _: Option<&dyn Fn() -> Vec<u8>>) -> ControlFlow<()> {
                self.1 = self.1.max((values[1] - self.0).abs());
                self.0 = values[1];
                ControlFlow::Continue(())
            }
        }
        let mut watch = Watch(0.4, 0.0);
        let end = newton.run(None, |_, _| Ok(false), &mut watch).expect("finite at the start");
        assert!(end.is_good() && (newton.values[1] - 1.5).abs() < 1e-2, "{end:?} {:?}", newton.values);
        assert!(watch.1 <= 0.05 * (1.0 + 1e-12), "{}", watch.1);
    }
}
