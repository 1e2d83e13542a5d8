//! A stage fitted by one noise: to the runs that are learned from, and to the held-out runs with all that is shared as it is.

use super::metric::Metric;
use super::refit::{Fitting, Posed};
use super::round::{Runs, shared_from};
use super::search_error::SearchError;
use super::stage::Stage;

/// A model fitted to the runs that are learned from, and what belongs to each held-out run.
#[derive(Clone)]
pub(super) struct Whole {
    pub(super) fitting: Fitting,
    /// All runs.
    pub(super) theta: Vec<Vec<f64>>,
    /// Cost on the held-out runs; 0 without any.
    held: f64,
}

impl Whole {
    /// Cost of all runs.
    pub(super) fn cost(&self) -> f64 {
        self.fitting.cost + self.held
    }
}

/// Fits a stage by a noise.
pub(super) fn whole_fit(stage: &Stage, runs: Runs<'_>, metric: &Metric) -> Result<Whole, SearchError> {
    const CORRECTIONS: usize = 60;
    let (params, dynamics) = (stage.params().to_vec(), stage.model.dynamics());
    let (train, held) = stage.ways.split_at(runs.train);
    let posed = Posed { params: params.clone(), dynamics, runs: runs.train(), ways: train, metric };
    let none = || SearchError::NoFit("it has no fit by the noise found".into());
    let fitting = posed.fit(&stage.theta[..runs.train], CORRECTIONS).ok_or_else(none)?;
    let mut theta = fitting.theta.clone();
    let mut cost = 0.0;
    if !held.is_empty() {
        let starts = shared_from(&params, &theta[0], &stage.theta[runs.train..]);
        let metric = metric.for_held();
        let posed = Posed { params, dynamics, runs: runs.held(), ways: held, metric }.held();
        let found = posed.fit(&starts, CORRECTIONS);
        cost = found.as_ref().map_or(f64::INFINITY, |f| f.cost);
        theta.extend(found.map_or(starts, |f| f.theta));
    }
    Ok(Whole { fitting, theta, held: cost })
}
