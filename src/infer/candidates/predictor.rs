//! The way from a model to what is compared with a run: its steps in time, or the bins of the run's spectrum.

use crate::bins::Signals;
use crate::candidates::error::DiagnosisError;
use crate::candidates::runs::{Domain, Runs};
use crate::diagnosis::FrequencyDomain;
use crate::lack_of_fit::BinnedResidual;
use fdm_estimate::residuals::residuals;
use fdm_estimate::{Response, SpectralBins};
use fdm_system::dynamics::Dynamics;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Divergence, Scheme, Simulator, StepOptions, Steps, choose_steps};
use std::sync::Arc;

/// Part of the noise's deviation that an integration error may have.
const HIDDEN: f64 = 0.02;
/// And of an output's range, at most.
const ROUGHEST: f64 = 1e-4;

/// A run linearised.
pub(crate) struct Linearised {
    /// Measured minus model (N by q); NaN where nothing was measured.
    pub(crate) residual: Signals,
    /// Derivatives of the response (N by q each).
    pub(crate) columns: Vec<Signals>,
}

/// How a model answers a run.
#[derive(Clone)]
pub(crate) enum Predictor {
    /// Integrated so.
    Steps(Steps),
    /// At the frequencies of the run.
    Bins {
        /// The model over all runs.
        bins: Arc<SpectralBins>,
        /// Which of them.
        run: usize,
    },
}

impl Predictor {
    /// The predictors of a model to all runs, at these values.
    pub(crate) fn all(model: &Model, runs: Runs<'_>, theta: &[Vec<f64>]) -> Result<Vec<Self>, DiagnosisError> {
        match runs.domain {
            Domain::Time => {
                let tolerance = tolerance(runs.all, model.layout().outputs);
                runs.all.iter().zip(theta).map(|(run, theta)| Self::in_time(model, (run, theta), tolerance)).collect()
            }
            Domain::Frequency(options) => {
                let bins = Arc::new(SpectralBins::new(model, runs.all, options)?);
                Ok(Self::of_lines(&bins, runs.all.len()))
            }
        }
    }

    /// Those of bins.
    pub(crate) fn of_lines(bins: &Arc<SpectralBins>, runs: usize) -> Vec<Self> {
        (0..runs).map(|run| Self::Bins { bins: bins.clone(), run }).collect()
    }

    fn in_time(model: &Model, (run, theta): (&Run, &[f64]), tolerance: f64) -> Result<Self, DiagnosisError> {
        let unsuited = |reason| DiagnosisError::Unsuited { run: run.name.clone(), reason };
        let chosen = choose_steps(model.dynamics(), run, theta, &StepOptions::default().to(Some(tolerance)))
            .map_err(unsuited)?
            .steps;
        let mut simulator = Simulator::new(model.dynamics(), run, chosen.clone()).map_err(unsuited)?;
        simulator.suits(theta).map_err(unsuited)?;
        Ok(Self::Steps(chosen))
    }

    /// With steps half as long; none where a response has no error of steps.
    pub(crate) fn halved(&self) -> Option<Self> {
        match self {
            Self::Steps(steps) if !matches!(steps.scheme(), Scheme::ExactDiscretisation { .. }) => {
                Some(Self::Steps(steps.halved()))
            }
            _ => None,
        }
    }

    /// What is compared: measured samples or bins, N by q.
    pub(crate) fn measured(&self, run: &Run) -> Signals {
        match self {
            Self::Steps(_) => run.measured.clone(),
            Self::Bins { bins, run } => bins.measured(*run),
        }
    }

    /// What a response leaves of that.
    pub(crate) fn left_by(&self, run: &Run, response: &[f64]) -> Signals {
        residuals(&self.measured(run), response)
    }

    /// The frequency of every row; none for samples.
    pub(crate) fn frequencies(&self) -> Option<Vec<f64>> {
        match self {
            Self::Steps(_) => None,
            Self::Bins { bins, run } => Some(bins.frequencies(*run)),
        }
    }

    /// What belongs to a run alone and is no parameter; nothing in time.
    pub(crate) fn own(&self, theta: &[f64]) -> Result<Vec<f64>, DiagnosisError> {
        match self {
            Self::Steps(_) => Ok(Vec::new()),
            Self::Bins { bins, run } => {
                let diverged = |_| DiagnosisError::NoFit("it has no frequency response at the estimates".into());
                bins.settled(*run, &mut bins.response(*run)?, theta).map_err(diverged)
            }
        }
    }

    /// The response of a model.
    pub(crate) fn answer(&self, dynamics: &dyn Dynamics, run: &Run, theta: &[f64]) -> Result<Signals, DiagnosisError> {
        let mut y;
        let answered = match self {
            Self::Steps(steps) => {
                let unsuited = |reason| DiagnosisError::Unsuited { run: run.name.clone(), reason };
                let mut simulator = Simulator::new(dynamics, run, steps.clone()).map_err(unsuited)?;
                y = vec![0.0; simulator.samples() * simulator.outputs()];
                simulator.simulate(theta, &mut y)
            }
            Self::Bins { bins, run } => {
                let mut response = bins.response(*run)?;
                y = vec![0.0; response.samples() * response.outputs()];
                let all = [theta, &self.own(theta)?].concat();
                response.simulate(&all, &mut y)
            }
        };
        let diverged = |d: Divergence| DiagnosisError::NoFit(format!("run `{}` diverges at time {}", run.name, d.time));
        answered.map_err(diverged)?;
        Ok(y)
    }

    /// What a model leaves of a run, and its derivatives by parameters that all runs share, then by those of each run.
    pub(crate) fn linearised(
        &self,
        dynamics: &dyn Dynamics,
        (run, theta): (&Run, &[f64]),
        (shared, own): (&[usize], &[usize]),
    ) -> Result<Linearised, DiagnosisError> {
        let no = |_| DiagnosisError::NoFit(format!("run `{}` has no derivatives at the estimates", run.name));
        let (mut shared, mut own) = (shared.to_vec(), own.to_vec());
        let (y, jacobian, stride);
        match self {
            Self::Steps(steps) => {
                let unsuited = |reason| DiagnosisError::Unsuited { run: run.name.clone(), reason };
                let columns = [&shared[..], &own].concat();
                let mut simulator = Simulator::new(dynamics, run, steps.clone()).map_err(unsuited)?;
                stride = columns.len().next_multiple_of(8);
                let cells = simulator.samples() * simulator.outputs();
                let mut found = (vec![0.0; cells], vec![0.0; cells * stride]);
                simulator.sensitivities(theta, &columns, &mut found.0, &mut found.1).map_err(no)?;
                (y, jacobian) = found;
            }
            Self::Bins { bins, run } => {
                let alone = self.own(theta)?;
                (shared, own) = self.columns((shared, own), theta.len());
                let columns = [&shared[..], &own].concat();
                let mut response = bins.response(*run)?;
                stride = columns.len();
                let cells = response.samples() * response.outputs();
                let mut found = (vec![0.0; cells], vec![0.0; cells * stride]);
                let all = [theta, &alone].concat();
                response.columns(&all, &columns, &mut found.0, (&mut found.1, stride)).map_err(no)?;
                (y, jacobian) = found;
            }
        }
        let column = |c: usize| -> Signals { jacobian.chunks_exact(stride.max(1)).map(|row| row[c]).collect() };
        Ok(Linearised { residual: self.left_by(run, &y), columns: (0..shared.len() + own.len()).map(column).collect() })
    }

    /// Of free parameters (those that all runs share, those of each run) those that its responses show; behind the parameters (p) what
    /// belongs to a run alone.
    pub(crate) fn columns(
        &self,
        (mut shared, mut own): (Vec<usize>, Vec<usize>),
        p: usize,
    ) -> (Vec<usize>, Vec<usize>) {
        if let Self::Bins { bins, .. } = self {
            shared.retain(|k| bins.sees(*k));
            own.retain(|k| bins.sees(*k));
            own.extend(p..p + bins.own().count());
        }
        (shared, own)
    }

    /// A run and a response in bins; none in time.
    pub(crate) fn binned(&self, response: &[f64]) -> Option<BinnedResidual> {
        let Self::Bins { bins, run } = self else { return None };
        let (frequency, samples) = (bins.frequencies(*run), bins.samples(*run));
        Some(BinnedResidual { frequency, measured: bins.measured(*run), response: response.to_vec(), samples })
    }

    /// What is told of the frequency domain; none in time.
    pub(crate) fn told(&self) -> Option<FrequencyDomain> {
        let Self::Bins { bins, .. } = self else { return None };
        let mut notes = vec!["disturbances and laws are looked for in the time domain only".to_string()];
        let carried: Vec<&str> = bins.measured_regressors().iter().map(|term| term.text.as_str()).collect();
        if !carried.is_empty() {
            notes.push(format!("measured regressors, with their noise: {}", carried.join(", ")));
        }
        Some(FrequencyDomain { band: bins.band(), notes })
    }

    /// The steps in time.
    pub(crate) fn steps(&self) -> Option<&Steps> {
        match self {
            Self::Steps(steps) => Some(steps),
            Self::Bins { .. } => None,
        }
    }
}

/// Responses of a model to all runs; none where one diverges.
pub(crate) fn responses(
    model: &Model,
    runs: &[Run],
    predictors: &[Predictor],
    theta: &[Vec<f64>],
) -> Option<Vec<Signals>> {
    let of = |(run, (predictor, theta)): (&Run, (&Predictor, &Vec<f64>))| {
        predictor.answer(model.dynamics(), run, theta).ok()
    };
    runs.iter().zip(predictors.iter().zip(theta)).map(of).collect()
}

/// The integration error that noise hides, as a part of an output's range: by the second differences of what was measured.
pub(crate) fn tolerance(runs: &[Run], outputs: usize) -> f64 {
    let of = |run: &Run, o: usize| -> Option<f64> {
        let values: Vec<f64> = run.measured.iter().skip(o).step_by(outputs).copied().filter(|z| !z.is_nan()).collect();
        let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        let bends = values.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]);
        let square = bends.map(|b| b * b).sum::<f64>() / (6.0 * values.len().saturating_sub(2) as f64);
        (high > low && square.is_finite()).then(|| square.sqrt() / (high - low))
    };
    let each = runs.iter().flat_map(|run| (0..outputs).filter_map(move |o| of(run, o)));
    let least = each.fold(f64::INFINITY, f64::min);
    (HIDDEN * least).min(ROUGHEST)
}
