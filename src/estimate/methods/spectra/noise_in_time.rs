//! The noise behind spectra, in time: what the responses leave with initial states and biases of their own, and whether that is everywhere
//! of one size.

use super::initial_conditions::in_time;
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::Fit;
use crate::problem::{NoiseInTime, NoiseSizes};
use crate::residuals::noise_variation::{OutputSeries, profile, range, test};
use crate::work::Work;
use fdm_system::model::Model;
use fdm_system::record::Run;
use std::sync::{Arc, Mutex, PoisonError};

/// Values of all parameters, and the fit in time with these held.
type Finish = (Vec<f64>, Result<Fit, FitError>);

/// The last fit in time, for whoever needs it behind the estimation.
#[derive(Clone, Default)]
pub(super) struct LastFinish(Arc<Mutex<Option<Finish>>>);

impl LastFinish {
    /// The fit in time at these values, where it has been made.
    pub(super) fn at(&self, values: &[f64]) -> Option<Result<Fit, FitError>> {
        let last = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        last.filter(|(at, _)| at == values).map(|(_, found)| found)
    }
}

/// Fits in time what spectra do not show.
pub(super) struct FinishInTime<'a> {
    pub(super) model: &'a Model,
    pub(super) runs: &'a [Run],
    /// Parameters that the frequency domain does not see.
    pub(super) unseen: Vec<String>,
    pub(super) last: LastFinish,
    pub(super) work: &'a Work<'a>,
}

impl NoiseInTime for FinishInTime<'_> {
    fn sizes(&self, theta: &[Vec<f64>]) -> Option<NoiseSizes> {
        let values = &theta.first()?[..self.model.layout().params];
        let found = in_time(self.model, values, &self.unseen, self.runs, self.work);
        let sizes = found.as_ref().ok().and_then(|fit| self.judged(fit));
        *self.last.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((values.to_vec(), found));
        sizes
    }
}

impl FinishInTime<'_> {
    fn judged(&self, fit: &Fit) -> Option<NoiseSizes> {
        if !fit.estimate.termination.is_good() || fit.estimate.runs.len() != self.runs.len() {
            return None;
        }
        let outputs = &self.model.definition().outputs;
        let q = outputs.len();
        let of = |o: usize| -> Vec<OutputSeries> {
            let runs = self.runs.iter().zip(&fit.estimate.runs);
            runs.map(|(run, own)| OutputSeries::of_run(&run.time, &own.response, &own.residuals, (o, q))).collect()
        };
        let series: Vec<_> = outputs.iter().enumerate().map(|(o, out)| (out.quantity.name.clone(), of(o))).collect();
        let mut variation = test(&series);
        let one = |run: &OutputSeries| vec![1.0; run.residuals.len()];
        let mut shapes: Vec<Vec<Vec<f64>>> =
            (0..self.runs.len()).map(|r| series.iter().map(|(_, runs)| one(&runs[r])).collect()).collect();
        for v in variation.iter_mut().filter(|v| v.is_significant()) {
            let Some(o) = series.iter().position(|(name, _)| *name == v.output) else { continue };
            let shape = profile(v, &series[o].1);
            v.deviations = range(v.deviations[0], &series[o].1, &shape);
            shapes.iter_mut().zip(shape).for_each(|(to, shape)| to[o] = shape);
        }
        Some(NoiseSizes { variation, shapes })
    }
}
