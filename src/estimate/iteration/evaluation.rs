//! All runs at one vector of unknowns: responses, moments of the residuals, sums of the sensitivities.
//!
//! Runs are worked off in parallel, each into memory of its own; what follows is summed in the order of the runs, so
//! that the number of threads does not change a bit.
//!
//! The second derivative of a response along a step comes from a difference against the exact first one. Along a curved
//! valley of the cost a straight step leaves the valley floor at once; a step that follows the curve can be many times
//! longer (geodesic acceleration: Transtrum and Sethna 2012). It needs one more simulation and one more sweep of
//! sensitivities, and is used only where full steps fail.
//!
//! The normal equations of a problem at given values: what one Gauss-Newton step is made of, for whoever iterates differently.

use super::sums::{Moments, Sums};
use crate::problem::response::RunResponse;
use crate::problem::unknowns::Unknowns;
use crate::problem::{Problem, ProblemRun};
use fdm_numeric::least_squares::AHEAD;
use fdm_system::simulate::{Block, Divergence, Planes};
use rayon::prelude::*;
use std::borrow::Cow;

/// Why a run could not be compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Failure {
    Diverged(Divergence),
    /// A compared output, or its sensitivity to a parameter, is not finite (or so large that its square is not).
    NotFinite {
        output: usize,
        sample: usize,
        param: Option<usize>,
    },
}

/// A failure and the run it happened in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RunFailure {
    pub(crate) run: usize,
    pub(crate) failure: Failure,
}

/// What to compute.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Want<'w> {
    /// Responses and moments.
    Response,
    /// Sensitivities too; outputs mixed by a whitener (q by q) when the noise is full.
    Sensitivities(Option<&'w [f64]>),
}

/// One run and its memory.
struct RunState<'e, 'a> {
    run: &'e mut ProblemRun<'a>,
    theta: Vec<f64>,
    y: Vec<f64>,
    kept: Vec<f64>,
    /// Responses a part of a step ahead; only curved problems need them.
    ahead: Vec<f64>,
    bend: Vec<f64>,
    moments: Moments,
    sums: Sums,
    /// The measured outputs in planes and whether there are gaps in them, for a response that comes so.
    planes: Option<(Vec<f64>, bool)>,
    failure: Option<Failure>,
}

/// Evaluates a problem.
pub(crate) struct Evaluator<'e, 'a> {
    states: Vec<RunState<'e, 'a>>,
    unknowns: Cow<'e, Unknowns>,
    outputs: usize,
    /// Sums of products of residuals over all runs, q by q, of the last evaluation.
    pub(crate) moments: Vec<f64>,
    /// What the cost has beside the squares, of the last evaluation; none where the squares are all of it.
    pub(crate) surcharge: Option<f64>,
    /// Evaluations with sensitivities so far, and without.
    pub(crate) evaluations: usize,
    pub(crate) simulations: usize,
}

impl<'e, 'a> Evaluator<'e, 'a> {
    pub(crate) fn new(problem: &'e mut Problem<'a>, unknowns: &'e Unknowns, full: bool) -> Self {
        Self::with(problem, Cow::Borrowed(unknowns), full)
    }

    /// With unknowns of its own, and outputs apart.
    pub(crate) fn owning(problem: &'e mut Problem<'a>, unknowns: Unknowns) -> Self {
        Self::with(problem, Cow::Owned(unknowns), false)
    }

    fn with(problem: &'e mut Problem<'a>, unknowns: Cow<'e, Unknowns>, full: bool) -> Self {
        let q = problem.outputs.len();
        let groups = if full { 1 } else { q };
        let states = problem.runs.iter_mut().zip(&unknowns.theta).map(|(run, theta)| {
            let cells = run.measured.len();
            let sums = Sums::new(unknowns.columns.len(), groups);
            let (theta, y, kept, moments) = (theta.clone(), vec![0.0; cells], vec![0.0; cells], Moments::new(q));
            let (measured, ahead, bend) = (&run.measured, Vec::new(), Vec::new());
            let planar = !full && run.response.planar().is_some();
            let planes = planar.then(|| (Planes::of_samples(measured, q), measured.iter().any(|z| z.is_nan())));
            RunState { run, theta, y, kept, ahead, bend, moments, sums, planes, failure: None }
        });
        let states = states.collect();
        let moments = vec![0.0; q * q];
        Self { states, unknowns, outputs: q, moments, surcharge: None, evaluations: 0, simulations: 0 }
    }

    /// Evaluates all runs.
    ///
    /// # Errors
    /// The first run that fails.
    pub(crate) fn evaluate(&mut self, values: &[f64], want: Want<'_>) -> Result<(), RunFailure> {
        let (unknowns, q) = (&*self.unknowns, self.outputs);
        let work = |(r, state): (usize, &mut RunState<'_, '_>)| {
            unknowns.assemble(r, values, &mut state.theta);
            state.failure = state.evaluate(unknowns, q, want).err();
        };
        each(&mut self.states, work);
        match want {
            Want::Response => self.simulations += 1,
            Want::Sensitivities(_) => self.evaluations += 1,
        }
        self.moments.fill(0.0);
        self.surcharge = None;
        for (run, state) in self.states.iter().enumerate() {
            if let Some(failure) = state.failure {
                return Err(RunFailure { run, failure });
            }
            if let RunResponse::Standardised(response) = &state.run.response {
                self.surcharge = Some(self.surcharge.unwrap_or(0.0) + response.surcharge());
            }
            for (k, total) in self.moments.iter_mut().enumerate() {
                *total += state.moments.at(k / q, k % q);
            }
        }
        Ok(())
    }

    /// J' R^-1 times the second derivative of the response along `step`, from the kept responses at `values` and those
    /// `ahead`, which is [`AHEAD`] of the step further on; written to `bend` (one number for each unknown).
    ///
    /// # Errors
    /// As [`Self::evaluate`].
    pub(crate) fn bend(
        &mut self,
        values: &[f64],
        ahead: &[f64],
        step: &[f64],
        inverse_noise: &[f64],
        bend: &mut [f64],
    ) -> Result<(), RunFailure> {
        self.evaluate(ahead, Want::Response)?;
        self.evaluations += 1;
        let (unknowns, q) = (&*self.unknowns, self.outputs);
        let slopes = unknowns.slopes(values);
        let work = |(r, state): (usize, &mut RunState<'_, '_>)| {
            std::mem::swap(&mut state.ahead, &mut state.y);
            state.y.resize(state.ahead.len(), 0.0);
            unknowns.assemble(r, values, &mut state.theta);
            let along = |g: usize| slopes.get(g).map_or(step[g], |slope| slope * step[g]);
            let own: Vec<f64> = (0..unknowns.columns.len()).map(|c| along(unknowns.position(r, c))).collect();
            state.failure = state.bend(unknowns, q, &own, inverse_noise).err();
        };
        each(&mut self.states, work);
        bend.fill(0.0);
        for (run, state) in self.states.iter().enumerate() {
            if let Some(failure) = state.failure {
                return Err(RunFailure { run, failure });
            }
            for (c, b) in state.bend.iter().enumerate() {
                bend[unknowns.position(run, c)] += b;
            }
        }
        bend.iter_mut().zip(&slopes).for_each(|(b, slope)| *b *= slope);
        Ok(())
    }

    /// Takes up other unknowns for the same parameters.
    pub(crate) fn set_unknowns(&mut self, unknowns: &'e Unknowns) {
        self.unknowns = Cow::Borrowed(unknowns);
    }

    /// What is unknown.
    pub(crate) fn unknowns(&self) -> &Unknowns {
        &self.unknowns
    }

    /// Sums triangles instead of products from now on.
    pub(crate) fn make_precise(&mut self) {
        self.states.iter_mut().for_each(|s| s.sums.precise = true);
    }

    /// The last responses become those of the current estimates.
    pub(crate) fn keep(&mut self) {
        self.states.iter_mut().for_each(|s| std::mem::swap(&mut s.y, &mut s.kept));
    }

    /// The sums of all runs, of the last evaluation with sensitivities.
    pub(crate) fn sums(&self) -> impl Iterator<Item = &Sums> {
        self.states.iter().map(|s| &s.sums)
    }

    /// The kept responses (N by q each), leaving nothing behind.
    pub(crate) fn into_responses(self) -> Vec<Vec<f64>> {
        self.states.into_iter().map(|s| s.kept).collect()
    }
}

/// Works on every run; where there is nothing to share, in this thread.
fn each<S: Send>(states: &mut [S], work: impl Fn((usize, &mut S)) + Send + Sync) {
    if states.len() == 1 || rayon::current_num_threads() == 1 {
        return states.iter_mut().enumerate().for_each(work);
    }
    states.par_iter_mut().enumerate().for_each(work);
}

impl RunState<'_, '_> {
    fn evaluate(&mut self, unknowns: &Unknowns, q: usize, want: Want<'_>) -> Result<(), Failure> {
        let Want::Sensitivities(whitener) = want else {
            self.run.response.simulate(&self.theta, &mut self.y).map_err(Failure::Diverged)?;
            self.moments.begin();
            self.moments.add(&self.y, &self.run.measured);
            return self.comparable(q);
        };
        self.linearise(unknowns, q, whitener)
    }

    fn linearise(&mut self, unknowns: &Unknowns, q: usize, whitener: Option<&[f64]>) -> Result<(), Failure> {
        let Self { run, theta, y, moments, sums, planes, .. } = self;
        moments.begin();
        sums.begin();
        let wanted = planes.as_ref().filter(|_| whitener.is_none() && !sums.precise);
        if let Some(((measured, gaps), response)) = wanted.zip(run.response.planar()) {
            let result = response.planes(theta, &unknowns.columns, &mut |mut block| {
                block.copy_outputs(y);
                let first = block.first / Planes::HALF * q * Planes::LENGTH;
                sums.add_planes(&mut block, &measured[first..], *gaps);
            });
            result.map_err(Failure::Diverged)?;
            return self.linearised(unknowns, q, true);
        }
        let measured = &run.measured;
        // the squares are among the products
        let squares = whitener.is_none() && !sums.precise;
        let result = run.response.sensitivities(theta, &unknowns.columns, &mut |mut block| {
            let cells = block.first * q..block.first * q + block.y.len();
            y[cells.clone()].copy_from_slice(block.y);
            if !squares {
                moments.add(block.y, &measured[cells.clone()]);
            }
            sums.add(&mut block, &measured[cells], whitener);
        });
        result.map_err(Failure::Diverged)?;
        self.linearised(unknowns, q, squares)
    }

    /// Ends the sums and sees that they are finite; `squares`: those of the residuals are among them.
    fn linearised(&mut self, unknowns: &Unknowns, q: usize, squares: bool) -> Result<(), Failure> {
        self.sums.end();
        if squares {
            self.moments.take_squares(&self.sums);
        }
        self.comparable(q)?;
        if self.sums.is_finite() { Ok(()) } else { Err(self.worst_derivative(unknowns, q)) }
    }

    /// The first derivative that is not finite, else the largest one.
    fn worst_derivative(&mut self, unknowns: &Unknowns, q: usize) -> Failure {
        let (measured, mut worst) = (&self.run.measured, (0, None, 0.0));
        let size = |x: f64| if x.is_nan() { f64::INFINITY } else { x.abs() };
        // it has just been evaluated here
        let _ = self.run.response.sensitivities(&self.theta, &unknowns.columns, &mut |block| {
            for k in (0..block.y.len()).filter(|k| !measured[block.first * q + k].is_nan()) {
                for (column, x) in block.layout.outputs[k % q].columns.iter().zip(block.row(k / q, k % q)) {
                    if size(*x) <= worst.2 {
                        continue;
                    }
                    worst = (block.first * q + k, unknowns.columns.get(*column as usize).copied(), size(*x));
                }
            }
        });
        Failure::NotFinite { output: worst.0 % q, sample: worst.0 / q, param: worst.1 }
    }

    fn bend(&mut self, unknowns: &Unknowns, q: usize, step: &[f64], inverse_noise: &[f64]) -> Result<(), Failure> {
        self.bend.clear();
        self.bend.resize(step.len(), 0.0);
        let Self { run, theta, y, ahead, bend, .. } = self;
        let measured = &run.measured;
        let result = run.response.sensitivities(theta, &unknowns.columns, &mut |block| {
            let cells = block.first * q..block.first * q + block.y.len();
            y[cells.clone()].copy_from_slice(block.y);
            project_second_derivative(&block, &measured[cells.clone()], &ahead[cells], step, inverse_noise, bend);
        });
        result.map_err(Failure::Diverged)
    }

    /// Whether the moments are finite; tells the first residual that is not.
    fn comparable(&self, q: usize) -> Result<(), Failure> {
        if self.moments.is_finite() {
            return Ok(());
        }
        let residuals = self.y.iter().zip(&self.run.measured).map(|(y, z)| z - y).enumerate();
        let bad =
            residuals.filter(|(k, _)| !self.run.measured[*k].is_nan()).find(|(_, v)| v.is_nan() || v.abs() > 1e150);
        let k = bad.map_or(0, |(k, _)| k);
        Err(Failure::NotFinite { output: k % q, sample: k / q, param: None })
    }
}

/// Adds J' R^-1 y'' of a block to `bend` (one number for each column), where y'' is the second derivative along `step` (by
/// columns) seen in the responses `ahead`, a part of the step further on. `measured` and `ahead` belong to the samples of the
/// block (by q). A difference that rounding explains is none.
fn project_second_derivative(
    block: &Block<'_>,
    measured: &[f64],
    ahead: &[f64],
    step: &[f64],
    inverse_noise: &[f64],
    bend: &mut [f64],
) {
    let q = block.layout.outputs.len();
    for (k, _) in measured.iter().enumerate().filter(|(_, z)| !z.is_nan()) {
        let (sample, output) = (k / q, k % q);
        // R^-1 mixes the outputs of a sample when the noise is full; elsewhere only the diagonal is other than zero
        let weights = inverse_noise[output * q..(output + 1) * q].iter().enumerate();
        let outputs = weights.filter(|(o, w)| **w != 0.0 && !measured[sample * q + o].is_nan());
        let weighted: f64 = outputs.map(|(o, w)| w * second_derivative(block, ahead, step, (sample, o))).sum();
        for (column, j) in block.layout.outputs[output].columns.iter().zip(block.row(sample, output)) {
            bend[*column as usize] += weighted * j;
        }
    }
}

fn second_derivative(block: &Block<'_>, ahead: &[f64], step: &[f64], (sample, output): (usize, usize)) -> f64 {
    let row = block.layout.outputs[output].columns.iter().zip(block.row(sample, output));
    let slope: f64 = row.map(|(column, j)| j * step[*column as usize]).sum();
    let k = sample * block.layout.outputs.len() + output;
    let difference = (ahead[k] - block.y[k]) / AHEAD - slope;
    let rounding = 64.0 * f64::EPSILON * block.y[k].abs() / AHEAD;
    if difference.abs() > rounding { 2.0 / AHEAD * difference } else { 0.0 }
}

/// J'R^-1 J and J'R^-1 v of all runs, for known noise; the Jacobian itself is never stored.
pub struct NormalEquations<'e, 'a> {
    evaluator: Evaluator<'e, 'a>,
    /// 1 over the variance of each output.
    weights: Vec<f64>,
    information: Vec<f64>,
    gradient: Vec<f64>,
    squares: f64,
}

/// A run that has no finite response, or no finite sensitivities, at the given values.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("run {} is not finite at these values", run + 1)]
pub struct NotFinite {
    /// Index of the run.
    pub run: usize,
}

impl<'e, 'a> NormalEquations<'e, 'a> {
    /// Prepares; `deviations` are the standard deviations of the outputs' noise (q).
    pub fn new(problem: &'e mut Problem<'a>, deviations: &[f64]) -> Self {
        let unknowns = Unknowns::new(problem);
        let size = unknowns.len();
        Self {
            evaluator: Evaluator::owning(problem, unknowns),
            weights: deviations.iter().map(|s| 1.0 / (s * s)).collect(),
            information: vec![0.0; size * size],
            gradient: vec![0.0; size],
            squares: 0.0,
        }
    }

    /// Evaluates at `values`: shared free parameters in the model's order, then for every run its own (P).
    ///
    /// # Errors
    /// [`NotFinite`] for the first run that fails.
    pub fn evaluate(&mut self, values: &[f64]) -> Result<(), NotFinite> {
        self.evaluator.evaluate(values, Want::Sensitivities(None)).map_err(|f| NotFinite { run: f.run })?;
        self.information.fill(0.0);
        self.gradient.fill(0.0);
        self.squares = 0.0;
        let (unknowns, size) = (self.evaluator.unknowns(), self.gradient.len());
        for (run, sums) in self.evaluator.sums().enumerate() {
            for (group, weight) in sums.groups.iter().zip(&self.weights) {
                for (column, others, products, with_residual) in group.rows() {
                    let i = unknowns.position(run, column);
                    let information = &mut self.information[i * size..][..size];
                    for (other, product) in others.iter().zip(products) {
                        information[unknowns.position(run, *other as usize)] += weight * product;
                    }
                    self.gradient[i] += weight * with_residual;
                }
                self.squares += weight * group.square();
            }
        }
        for i in 0..size {
            for j in 0..i {
                self.information[i * size + j] = self.information[j * size + i];
            }
        }
        Ok(())
    }

    /// J'R^-1 J (P by P), of the last evaluation.
    pub fn information(&self) -> &[f64] {
        &self.information
    }

    /// J'R^-1 v with the residuals v = measured - response (P).
    pub fn gradient(&self) -> &[f64] {
        &self.gradient
    }

    /// v'R^-1 v.
    pub fn squares(&self) -> f64 {
        self.squares
    }
}
