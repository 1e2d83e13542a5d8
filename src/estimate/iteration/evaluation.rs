//! All runs at one vector of unknowns: responses, moments of the residuals, sums of the sensitivities.
//!
//! Runs are worked off in parallel, each into memory of its own; what follows is summed in the order of the runs, so
//! that the number of threads does not change a bit.

use super::bend;
use super::information::{Moments, Sums};
use crate::estimate::problem::{Problem, ProblemRun};
use crate::estimate::unknowns::Unknowns;
use crate::simulate::{Divergence, Planes};
use rayon::prelude::*;
use std::borrow::Cow;

/// Why a run could not be compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::estimate) enum Failure {
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
pub(in crate::estimate) struct RunFailure {
    pub(in crate::estimate) run: usize,
    pub(in crate::estimate) failure: Failure,
}

/// What to compute.
#[derive(Debug, Clone, Copy)]
pub(in crate::estimate) enum Want<'w> {
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
pub(in crate::estimate) struct Evaluator<'e, 'a> {
    states: Vec<RunState<'e, 'a>>,
    unknowns: Cow<'e, Unknowns>,
    outputs: usize,
    /// Sums of products of residuals over all runs, q by q, of the last evaluation.
    pub(in crate::estimate) moments: Vec<f64>,
    /// Evaluations with sensitivities so far, and without.
    pub(in crate::estimate) evaluations: usize,
    pub(in crate::estimate) simulations: usize,
}

impl<'e, 'a> Evaluator<'e, 'a> {
    pub(in crate::estimate) fn new(problem: &'e mut Problem<'a>, unknowns: &'e Unknowns, full: bool) -> Self {
        Self::with(problem, Cow::Borrowed(unknowns), full)
    }

    /// With unknowns of its own, and outputs apart.
    pub(in crate::estimate) fn owning(problem: &'e mut Problem<'a>, unknowns: Unknowns) -> Self {
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
            let planar = run.response.is_planar() && !full;
            let planes = planar.then(|| (Planes::of_samples(measured, q), measured.iter().any(|z| z.is_nan())));
            RunState { run, theta, y, kept, ahead, bend, moments, sums, planes, failure: None }
        });
        let states = states.collect();
        Self { states, unknowns, outputs: q, moments: vec![0.0; q * q], evaluations: 0, simulations: 0 }
    }

    /// Evaluates all runs.
    ///
    /// # Errors
    /// The first run that fails.
    pub(in crate::estimate) fn evaluate(&mut self, values: &[f64], want: Want<'_>) -> Result<(), RunFailure> {
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
        for (run, state) in self.states.iter().enumerate() {
            if let Some(failure) = state.failure {
                return Err(RunFailure { run, failure });
            }
            for (k, total) in self.moments.iter_mut().enumerate() {
                *total += state.moments.at(k / q, k % q);
            }
        }
        Ok(())
    }

    /// J' R^-1 times the second derivative of the response along `step`, from the kept responses at `values` and those
    /// `ahead`, which is [`bend::AHEAD`] of the step further on; written to `bend` (one number for each unknown).
    ///
    /// # Errors
    /// As [`Self::evaluate`].
    pub(in crate::estimate) fn bend(
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
        let work = |(r, state): (usize, &mut RunState<'_, '_>)| {
            std::mem::swap(&mut state.ahead, &mut state.y);
            state.y.resize(state.ahead.len(), 0.0);
            unknowns.assemble(r, values, &mut state.theta);
            let own: Vec<f64> = (0..unknowns.columns.len()).map(|c| step[unknowns.position(r, c)]).collect();
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
        Ok(())
    }

    /// What is unknown.
    pub(in crate::estimate) fn unknowns(&self) -> &Unknowns {
        &self.unknowns
    }

    /// Sums triangles instead of products from now on.
    pub(in crate::estimate) fn make_precise(&mut self) {
        self.states.iter_mut().for_each(|s| s.sums.precise = true);
    }

    /// The last responses become those of the current estimates.
    pub(in crate::estimate) fn keep(&mut self) {
        self.states.iter_mut().for_each(|s| std::mem::swap(&mut s.y, &mut s.kept));
    }

    /// The sums of all runs, of the last evaluation with sensitivities.
    pub(in crate::estimate) fn sums(&self) -> impl Iterator<Item = &Sums> {
        self.states.iter().map(|s| &s.sums)
    }

    /// The kept responses (N by q each), leaving nothing behind.
    pub(in crate::estimate) fn into_responses(self) -> Vec<Vec<f64>> {
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
        if let Some((measured, gaps)) = planes.as_ref().filter(|_| whitener.is_none() && !sums.precise) {
            let result = run.response.planes(theta, &unknowns.columns, &mut |mut block| {
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
            bend::project(&block, &measured[cells.clone()], &ahead[cells], step, inverse_noise, bend);
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
