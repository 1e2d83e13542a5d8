//! The likelihood of all runs at one vector of unknowns.

use super::kalman::{Kalman, Score};
use crate::estimate::unknowns::Unknowns;
use crate::simulate::Divergence;
use rayon::prelude::*;

/// The filters of all runs.
pub(super) struct Likelihood<'a> {
    filters: Vec<(Kalman<'a>, Memory)>,
    pub(super) unknowns: Unknowns,
    /// Number of parameters of the model; unknowns behind them are deviations of outputs.
    params: usize,
    /// For each output its known deviation, or the parameter that stands for it.
    noise: Vec<Deviation>,
    /// The sums over all runs.
    pub(super) score: Score,
    /// Passes with derivatives, and without.
    pub(super) passes: (usize, usize),
}

/// The deviation of an output.
#[derive(Debug, Clone, Copy)]
pub(super) enum Deviation {
    Known(f64),
    /// The parameter (index) behind the model's own.
    Unknown(usize),
}

/// All parameters of a run, deviations behind them, and how the last pass ended.
struct Memory {
    theta: Vec<f64>,
    deviations: Vec<f64>,
    failure: Option<Divergence>,
}

/// A run whose filter left the finite numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lost {
    pub(super) run: usize,
    pub(super) divergence: Divergence,
}

impl<'a> Likelihood<'a> {
    pub(super) fn new(filters: Vec<Kalman<'a>>, unknowns: Unknowns, params: usize, noise: Vec<Deviation>) -> Self {
        let size = unknowns.len();
        let memory =
            |theta: &Vec<f64>| Memory { theta: theta.clone(), deviations: vec![0.0; noise.len()], failure: None };
        let filters = filters.into_iter().zip(unknowns.theta.iter().map(memory)).collect();
        let score = Score { cost: 0.0, gradient: vec![0.0; size], information: vec![0.0; size * size] };
        Self { filters, unknowns, params, noise, score, passes: (0, 0) }
    }

    /// Evaluates at `values`; gradient and information too where these are wanted.
    ///
    /// # Errors
    /// The first run that fails.
    pub(super) fn evaluate(&mut self, values: &[f64], wanted: bool) -> Result<f64, Lost> {
        let (unknowns, params, noise) = (&self.unknowns, self.params, &self.noise);
        let work = |(run, (filter, memory)): (usize, &mut (Kalman<'a>, Memory))| {
            unknowns.assemble(run, values, &mut memory.theta);
            for (deviation, noise) in memory.deviations.iter_mut().zip(noise) {
                *deviation = match noise {
                    Deviation::Known(known) => *known,
                    Deviation::Unknown(k) => memory.theta[*k],
                };
            }
            memory.failure = filter.run(&memory.theta[..params], &memory.deviations, wanted).err();
        };
        match self.filters.len() == 1 || rayon::current_num_threads() == 1 {
            true => self.filters.iter_mut().enumerate().for_each(work),
            false => self.filters.par_iter_mut().enumerate().for_each(work),
        }
        if wanted {
            self.passes.0 += 1
        } else {
            self.passes.1 += 1
        }
        self.sum(wanted)
    }

    /// In the order of the runs, so that the number of threads does not change a bit.
    fn sum(&mut self, wanted: bool) -> Result<f64, Lost> {
        let (size, lanes) = (self.unknowns.len(), self.unknowns.columns.len());
        let mut cost = 0.0;
        if wanted {
            self.score.gradient.fill(0.0);
            self.score.information.fill(0.0);
        }
        for (run, (filter, memory)) in self.filters.iter().enumerate() {
            if let Some(divergence) = memory.failure {
                return Err(Lost { run, divergence });
            }
            cost += filter.score.cost;
            for i in (0..lanes).filter(|_| wanted) {
                let at = self.unknowns.position(run, i);
                self.score.gradient[at] += filter.score.gradient[i];
                for j in 0..lanes {
                    self.score.information[at * size + self.unknowns.position(run, j)] +=
                        filter.score.information[i * lanes + j];
                }
            }
        }
        self.score.cost = cost;
        Ok(cost)
    }

    /// One-step predictions of the last evaluation, run by run (N by q each).
    pub(super) fn predictions(&self) -> impl Iterator<Item = &Vec<f64>> {
        self.filters.iter().map(|(filter, _)| &filter.predicted)
    }
}
