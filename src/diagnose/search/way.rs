//! The way from a model to what is compared with a run: its steps in time, or the lines of the run's spectrum.

use super::domain::Domain;
use super::evenly::interval;
use super::metric::Metric;
use super::round::Runs;
use super::search_error::SearchError;
use super::whitened::{Lens, Whitened};
use crate::diagnose::diagnosis::Spectral;
use crate::diagnose::misfit::SpectralPassage;
use crate::diagnose::screen::{Record, Signals};
use crate::dynamics::Dynamics;
use crate::estimate::{LineResponse, ProblemRun, Response, SpectralLines};
use crate::model::Model;
use crate::record::Run;
use crate::simulate::{Divergence, Scheme, Simulator, Steps, choose_steps_within};
use fdm_grammar::model::Param;
use std::sync::Arc;

/// Steps of an interval that are not halved for a fit: kinks want more of them than they are worth.
const ENOUGH: usize = 8;
/// Part of the noise's deviation that an integration error may have.
const HIDDEN: f64 = 0.02;
/// And of an output's range, at most.
const ROUGHEST: f64 = 1e-4;

/// How a model answers a run.
#[derive(Clone)]
pub(super) enum Way {
    /// Integrated so.
    Steps(Steps),
    /// At the frequencies of the run.
    Lines {
        /// The model over all runs.
        lines: Arc<SpectralLines>,
        /// Which of them.
        run: usize,
    },
}

impl Way {
    /// The ways of a model to all runs, at these values.
    pub(super) fn all(model: &Model, runs: Runs<'_>, theta: &[Vec<f64>]) -> Result<Vec<Self>, SearchError> {
        match runs.domain {
            Domain::Time => {
                let tolerance = tolerance(runs.all, model.layout().outputs);
                runs.all.iter().zip(theta).map(|(run, theta)| Self::in_time(model, (run, theta), tolerance)).collect()
            }
            Domain::Frequency(options) => {
                let lines = Arc::new(SpectralLines::new(model, runs.all, options)?);
                Ok(Self::of_lines(&lines, runs.all.len()))
            }
        }
    }

    /// Those of lines.
    pub(super) fn of_lines(lines: &Arc<SpectralLines>, runs: usize) -> Vec<Self> {
        (0..runs).map(|run| Self::Lines { lines: lines.clone(), run }).collect()
    }

    fn in_time(model: &Model, (run, theta): (&Run, &[f64]), tolerance: f64) -> Result<Self, SearchError> {
        let unsuited = |reason| SearchError::Unsuited { run: run.name.clone(), reason };
        let chosen = choose_steps_within(model.dynamics(), run, theta, tolerance).map_err(unsuited)?.steps;
        let mut simulator = Simulator::new(model.dynamics(), run, chosen.clone()).map_err(unsuited)?;
        simulator.suits(theta).map_err(unsuited)?;
        Ok(Self::Steps(chosen))
    }

    /// What is compared: measured samples or lines, N by q.
    pub(super) fn measured(&self, run: &Run) -> Signals {
        match self {
            Self::Steps(_) => run.measured.clone(),
            Self::Lines { lines, run } => lines.measured(*run),
        }
    }

    /// The frequency of every row; none for samples.
    pub(super) fn frequencies(&self) -> Option<Vec<f64>> {
        match self {
            Self::Steps(_) => None,
            Self::Lines { lines, run } => Some(lines.frequencies(*run)),
        }
    }

    /// What belongs to a run alone and is no parameter; nothing in time.
    pub(super) fn own(&self, theta: &[f64]) -> Result<Vec<f64>, SearchError> {
        match self {
            Self::Steps(_) => Ok(Vec::new()),
            Self::Lines { lines, run } => {
                let diverged = |_| SearchError::NoFit("it has no frequency response at the estimates".into());
                lines.settled(*run, &mut lines.response(*run)?, theta).map_err(diverged)
            }
        }
    }

    /// The response of a model.
    pub(super) fn answer(&self, dynamics: &dyn Dynamics, run: &Run, theta: &[f64]) -> Result<Signals, SearchError> {
        let mut y;
        let answered = match self {
            Self::Steps(steps) => {
                let unsuited = |reason| SearchError::Unsuited { run: run.name.clone(), reason };
                let mut simulator = Simulator::new(dynamics, run, steps.clone()).map_err(unsuited)?;
                y = vec![0.0; simulator.samples() * simulator.outputs()];
                simulator.simulate(theta, &mut y)
            }
            Self::Lines { lines, run } => {
                let mut response = lines.response(*run)?;
                y = vec![0.0; response.samples() * response.outputs()];
                let all = [theta, &self.own(theta)?].concat();
                response.simulate(&all, &mut y)
            }
        };
        let diverged = |d: Divergence| SearchError::NoFit(format!("run `{}` diverges at time {}", run.name, d.time));
        answered.map_err(diverged)?;
        Ok(y)
    }

    /// Residuals and sensitivities of a run as screening sees them, without directions.
    ///
    /// `shared` and `own` are the parameters that all runs share and those of each run, `place` is that of the run among so many.
    pub(super) fn record(
        &self,
        dynamics: &dyn Dynamics,
        (run, theta): (&Run, &[f64]),
        (shared, own): (&[usize], &[usize]),
        (place, runs): (usize, usize),
    ) -> Result<Record, SearchError> {
        let no = |_| SearchError::NoFit(format!("run `{}` has no derivatives at the estimates", run.name));
        let (mut shared, mut own) = (shared.to_vec(), own.to_vec());
        let (y, jacobian, stride);
        match self {
            Self::Steps(steps) => {
                let unsuited = |reason| SearchError::Unsuited { run: run.name.clone(), reason };
                let columns = [&shared[..], &own].concat();
                let mut simulator = Simulator::new(dynamics, run, steps.clone()).map_err(unsuited)?;
                stride = columns.len().next_multiple_of(8);
                let cells = simulator.samples() * simulator.outputs();
                let mut found = (vec![0.0; cells], vec![0.0; cells * stride]);
                simulator.sensitivities(theta, &columns, &mut found.0, &mut found.1).map_err(no)?;
                (y, jacobian) = found;
            }
            Self::Lines { lines, run } => {
                let alone = self.own(theta)?;
                (shared, own) = self.columns((shared, own), theta.len());
                let columns = [&shared[..], &own].concat();
                let mut response = lines.response(*run)?;
                stride = columns.len();
                let cells = response.samples() * response.outputs();
                let mut found = (vec![0.0; cells], vec![0.0; cells * stride]);
                let all = [theta, &alone].concat();
                response.columns(&all, &columns, &mut found.0, (&mut found.1, stride)).map_err(no)?;
                (y, jacobian) = found;
            }
        }
        let column = |c: usize| -> Signals { jacobian.chunks_exact(stride.max(1)).map(|row| row[c]).collect() };
        let mut fitted: Vec<Option<Signals>> = (0..shared.len()).map(|c| Some(column(c))).collect();
        for other in 0..runs {
            fitted.extend((0..own.len()).map(|c| (other == place).then(|| column(shared.len() + c))));
        }
        let residual = self.measured(run).iter().zip(&y).map(|(z, y)| z - y).collect();
        Ok(Record { interval: interval(run), residual, fitted, directions: Vec::new() })
    }

    /// Of free parameters (those that all runs share, those of each run) those that its responses show; behind the parameters (p) what
    /// belongs to a run alone.
    pub(super) fn columns(
        &self,
        (mut shared, mut own): (Vec<usize>, Vec<usize>),
        p: usize,
    ) -> (Vec<usize>, Vec<usize>) {
        if let Self::Lines { lines, .. } = self {
            shared.retain(|k| lines.sees(*k));
            own.retain(|k| lines.sees(*k));
            own.extend(p..p + lines.own().count());
        }
        (shared, own)
    }

    /// What turns signals of a run into lines of unit noise.
    pub(super) fn lens(&self, run: &Run, outputs: usize, metric: &Metric) -> Lens {
        match self {
            Self::Steps(_) => Lens::new(run, outputs, metric),
            Self::Lines { lines, run } => {
                Lens::of_lines(&lines.measured(*run), outputs, &lines.frequencies(*run), metric)
            }
        }
    }

    /// A model's parameters as fits want them.
    pub(super) fn params(&self, params: Vec<Param>) -> Vec<Param> {
        match self {
            Self::Steps(_) => params,
            Self::Lines { lines, .. } => lines.params(params),
        }
    }

    /// A run in the lines of a noise, without start values, and what settles those that are no parameters; none where there is no
    /// response.
    pub(super) fn posed<'a>(
        &self,
        dynamics: &'a dyn Dynamics,
        run: &'a Run,
        metric: &Metric,
    ) -> Option<(ProblemRun<'a>, Option<LineResponse>)> {
        let (name, start) = (run.name.clone(), Vec::new());
        match self {
            Self::Steps(steps) => {
                let simulator = Simulator::new(dynamics, run, steps.clone()).ok()?;
                let mut lens = Lens::new(run, dynamics.layout().outputs, metric);
                let measured = lens.seen(&run.measured);
                let response = Box::new(Whitened::new(simulator, lens));
                Some((ProblemRun { name, response, measured, start }, None))
            }
            Self::Lines { lines, run: place } => {
                let mut lens = self.lens(run, dynamics.layout().outputs, metric);
                let measured = lens.seen(&lines.measured(*place));
                let weights = lens.seen(&vec![1.0; measured.len()]);
                let weighed = || -> Option<LineResponse> {
                    let mut response = lines.response(*place).ok()?;
                    response.weigh(weights.clone());
                    Some(response)
                };
                let (response, settler) = (Box::new(weighed()?), weighed()?);
                Some((ProblemRun { name, response, measured, start }, Some(settler)))
            }
        }
    }

    /// The way of a fit: half of the steps that were enough for a direction, unless the recursion is exact.
    pub(super) fn finer(&self) -> Self {
        match self {
            Self::Steps(steps) => {
                let enough = matches!(steps.scheme(), Scheme::Recursion { .. }) || steps.most() >= ENOUGH;
                Self::Steps(if enough { steps.clone() } else { steps.halved() })
            }
            lines => lines.clone(),
        }
    }

    /// A run in lines; none in time.
    pub(super) fn passage(&self, record: &Record) -> Option<SpectralPassage> {
        let Self::Lines { lines, run } = self else { return None };
        let measured = lines.measured(*run);
        let response = measured.iter().zip(&record.residual).map(|(z, r)| z - r).collect();
        let (frequency, samples) = (lines.frequencies(*run), lines.samples(*run));
        Some(SpectralPassage { frequency, measured, response, samples })
    }

    /// What is told of the frequency domain; none in time.
    pub(super) fn told(&self) -> Option<Spectral> {
        let Self::Lines { lines, .. } = self else { return None };
        let mut notes = vec![
            "places of forces, and what an unknown cause looks like, are asked for in the time domain only".to_string(),
        ];
        let carried: Vec<&str> = lines.carried().iter().map(|term| term.text.as_str()).collect();
        if !carried.is_empty() {
            notes.push(format!("computed from records, with their noise: {}", carried.join(", ")));
        }
        Some(Spectral { band: lines.band(), notes })
    }

    /// The steps in time.
    pub(super) fn steps(&self) -> Option<&Steps> {
        match self {
            Self::Steps(steps) => Some(steps),
            Self::Lines { .. } => None,
        }
    }
}

/// The integration error that noise hides, as a part of an output's range: by the second differences of what was measured.
fn tolerance(runs: &[Run], outputs: usize) -> f64 {
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
