//! A model at its fit: what candidates are compared with.
//!
//! A fitted model fitted by one noise: to the training runs, and to the validation runs with all that is shared as it is.

use super::error::DiagnosisError;
use super::fitting::{FitProblem, Fitting, NOTHING};
use super::predictor::Predictor;
use super::runs::{Runs, at_rows};
use super::whitening::CommonNoise;
use crate::bins::{MeasuredRows, Record, Signals};
use crate::diagnosis::FrequencyDomain;
use crate::noise::LogSpectrum;
use crate::screening::{
    Direction, Screening, ScreeningError, ScreeningOptions, screen, screen_bins, spectra, spectra_of_bins,
};
use fdm_effects::Subject;
use fdm_grammar::model::Param;
use fdm_system::model::Model;
use fdm_system::record::Run;

/// A model with its text, the values of its parameters, and its responses.
#[derive(Clone)]
pub(super) struct FittedModel {
    /// The model.
    pub(super) model: Model,
    /// Its text.
    pub(super) subject: Subject,
    /// All parameters (p) of each run.
    pub(super) theta: Vec<Vec<f64>>,
    /// How each run is answered.
    pub(super) predictors: Vec<Predictor>,
    /// Outputs of each run, N by q.
    pub(super) response: Vec<Signals>,
}

impl FittedModel {
    /// The model at `theta`; every run must have a response there.
    pub(super) fn new(model: Model, runs: Runs<'_>, theta: Vec<Vec<f64>>) -> Result<Self, DiagnosisError> {
        let subject = Subject::new(model.source(), model.definition()).map_err(DiagnosisError::Text)?;
        let predictors = Predictor::all(&model, runs, &theta)?;
        let of =
            |((run, theta), predictor): ((_, &Vec<f64>), &Predictor)| predictor.answer(model.dynamics(), run, theta);
        let response = runs.all.iter().zip(&theta).zip(&predictors).map(of).collect::<Result<_, _>>()?;
        Ok(Self { model, subject, theta, predictors, response })
    }

    /// The model at the rows at which something was measured, and these runs; none where all rows are such, or the others stand between
    /// even ones.
    pub(super) fn where_measured(&self, runs: Runs<'_>) -> Option<(Vec<Run>, Self)> {
        let q = self.outputs();
        let rows = |run: &Run| MeasuredRows::of(&run.measured, q, &run.time);
        let all: Vec<Option<MeasuredRows>> = runs.all.iter().map(rows).collect();
        if self.spectral().is_some() || !all.iter().flatten().any(|rows| rows.uneven().is_some()) {
            return None;
        }
        let few = |(run, rows): (&Run, &Option<MeasuredRows>)| match rows.as_ref().and_then(MeasuredRows::uneven) {
            Some((list, _)) => at_rows(run, list),
            None => run.clone(),
        };
        let some: Vec<Run> = runs.all.iter().zip(&all).map(few).collect();
        let mut found = Self::new(self.model.clone(), Runs { all: &some, ..runs }, self.theta.clone()).ok()?;
        for ((own, whole), rows) in found.response.iter_mut().zip(&self.response).zip(&all) {
            let rows = rows.as_ref().filter(|rows| rows.uneven().is_some());
            *own = MeasuredRows::taken(rows, whole.clone(), q);
        }
        Some((some, found))
    }

    /// Number of outputs.
    pub(super) fn outputs(&self) -> usize {
        self.model.layout().outputs
    }

    /// Its parameters.
    pub(super) fn params(&self) -> &[Param] {
        &self.model.definition().params
    }

    /// What is told of the frequency domain; none in time.
    pub(super) fn spectral(&self) -> Option<FrequencyDomain> {
        self.predictors.first().and_then(Predictor::told)
    }

    /// What the columns of its records are derivatives by: what all runs share, and what belongs to each run.
    pub(super) fn columns(&self, runs: Runs<'_>) -> (Vec<usize>, Vec<usize>) {
        let (shared, own) = free(self.params());
        let predictor = self.predictors.first().filter(|_| runs.train > 0);
        predictor
            .map_or((shared.clone(), own.clone()), |predictor| predictor.columns((shared, own), self.params().len()))
    }

    /// Spectra of the noise beside what records of its runs hold: what is fitted, and their directions.
    pub(super) fn noise(
        &self,
        records: &[Record],
        options: &ScreeningOptions,
    ) -> Result<Vec<LogSpectrum>, ScreeningError> {
        match self.frequencies(records.len()) {
            Some(frequencies) => spectra_of_bins(records, &frequencies, self.outputs(), options),
            None => spectra(records, self.outputs(), options),
        }
    }

    /// Frequencies of the bins of so many runs; none in time.
    fn frequencies(&self, runs: usize) -> Option<Vec<Vec<f64>>> {
        self.predictors.iter().take(runs).map(Predictor::frequencies).collect()
    }

    /// Screens directions against records of its runs.
    pub(super) fn screened(
        &self,
        records: &[Record],
        directions: &[Direction],
        options: &ScreeningOptions,
    ) -> Result<Screening, ScreeningError> {
        match self.frequencies(records.len()) {
            Some(frequencies) => screen_bins(records, &frequencies, self.outputs(), directions, options),
            None => screen(records, self.outputs(), directions, options),
        }
    }
}

/// Residuals and sensitivities of runs, by a model on its ways, without directions.
pub(super) fn records(
    model: &Model,
    runs: &[Run],
    predictors: &[Predictor],
    theta: &[Vec<f64>],
) -> Result<Vec<Record>, DiagnosisError> {
    let (shared, own) = free(&model.definition().params);
    let of = |(place, ((run, theta), predictor)): (usize, ((_, &Vec<f64>), &Predictor))| {
        predictor.record(model.dynamics(), (run, theta), (&shared, &own), (place, runs.len()))
    };
    runs.iter().zip(theta).zip(predictors).enumerate().map(of).collect()
}

/// Free parameters (by index): those that all runs share, those of each run.
fn free(params: &[Param]) -> (Vec<usize>, Vec<usize>) {
    let pick = |own: bool| {
        let chosen = params.iter().enumerate().filter(move |(_, p)| !p.fixed && p.per_run == own);
        chosen.map(|(k, _)| k).collect()
    };
    (pick(false), pick(true))
}

/// A model fitted to the training runs, and what belongs to each validation run.
#[derive(Clone)]
pub(super) struct SplitFit {
    pub(super) fitting: Fitting,
    /// All runs.
    pub(super) theta: Vec<Vec<f64>>,
    /// Cost on the validation runs; 0 without any.
    validation: f64,
}

impl SplitFit {
    /// Cost of all runs.
    pub(super) fn cost(&self) -> f64 {
        self.fitting.cost + self.validation
    }
}

/// Fits a fitted model by a noise.
pub(super) fn split_fit(
    current: &FittedModel,
    runs: Runs<'_>,
    noise: &CommonNoise,
) -> Result<SplitFit, DiagnosisError> {
    split_fit_within(current, runs, noise, (60, NOTHING))
}

/// Fits a fitted model by a noise in so many iterations at most, as long as one predicts to gain so much.
pub(super) fn split_fit_within(
    current: &FittedModel,
    runs: Runs<'_>,
    noise: &CommonNoise,
    (iterations, least): (usize, f64),
) -> Result<SplitFit, DiagnosisError> {
    let (params, dynamics) = (current.params().to_vec(), current.model.dynamics());
    let (train, validation) = current.predictors.split_at(runs.train);
    let posed = FitProblem { params: params.clone(), dynamics, runs: runs.train(), predictors: train, noise };
    let none = || DiagnosisError::NoFit("it has no fit by the noise found".into());
    let fitting = posed
        .prepared()
        .and_then(|mut fit| fit.fit(&current.theta[..runs.train], iterations, least))
        .ok_or_else(none)?;
    let mut theta = fitting.theta.clone();
    let mut cost = 0.0;
    if !validation.is_empty() {
        let starts = shared_from(&params, &theta[0], &current.theta[runs.train..]);
        let noise = noise.for_validation();
        let posed =
            FitProblem { params, dynamics, runs: runs.validation(), predictors: validation, noise }.validation();
        let found = posed.prepared().and_then(|mut fit| fit.fit(&starts, iterations, least));
        cost = found.as_ref().map_or(f64::INFINITY, |f| f.cost);
        theta.extend(found.map_or(starts, |f| f.theta));
    }
    Ok(SplitFit { fitting, theta, validation: cost })
}

/// Parameters of each run with what all runs share from elsewhere.
pub(super) fn shared_from(params: &[Param], shared: &[f64], own: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let of = |theta: &Vec<f64>| {
        let each = params.iter().zip(shared.iter().zip(theta));
        each.map(|(p, (shared, own))| if p.per_run { *own } else { *shared }).collect()
    };
    own.iter().map(of).collect()
}
