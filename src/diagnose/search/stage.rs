//! A model at its fit: what candidates are compared with.

use super::round::Runs;
use super::search_error::SearchError;
use super::way::Way;
use crate::diagnose::diagnosis::Spectral;
use crate::diagnose::screen::{
    Direction, LogSpectrum, Record, Screening, ScreeningError, ScreeningOptions, Signals, screen, screen_lines,
    spectra, spectra_of_lines,
};
use crate::model::Model;
use crate::record::Run;
use fdm_grammar::effect::Subject;
use fdm_grammar::model::Param;

/// A model with its text, the values of its parameters, and its responses.
pub(super) struct Stage {
    /// The model.
    pub(super) model: Model,
    /// Its text.
    pub(super) subject: Subject,
    /// All parameters (p) of each run.
    pub(super) theta: Vec<Vec<f64>>,
    /// How each run is answered.
    pub(super) ways: Vec<Way>,
    /// Outputs of each run, N by q.
    pub(super) response: Vec<Signals>,
}

impl Stage {
    /// The model at `theta`; every run must have a response there.
    pub(super) fn new(model: Model, runs: Runs<'_>, theta: Vec<Vec<f64>>) -> Result<Self, SearchError> {
        let subject = Subject::new(model.source(), model.definition()).map_err(SearchError::Text)?;
        let ways = Way::all(&model, runs, &theta)?;
        let of = |((run, theta), way): ((_, &Vec<f64>), &Way)| way.answer(model.dynamics(), run, theta);
        let response = runs.all.iter().zip(&theta).zip(&ways).map(of).collect::<Result<_, _>>()?;
        Ok(Self { model, subject, theta, ways, response })
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
    pub(super) fn spectral(&self) -> Option<Spectral> {
        self.ways.first().and_then(Way::told)
    }

    /// What the columns of its records are derivatives by: what all runs share, and what belongs to each run.
    pub(super) fn columns(&self, runs: Runs<'_>) -> (Vec<usize>, Vec<usize>) {
        let (shared, own) = free(self.params());
        let way = self.ways.first().filter(|_| runs.train > 0);
        way.map_or((shared.clone(), own.clone()), |way| way.columns((shared, own), self.params().len()))
    }

    /// Spectra of the noise beside what records of its runs hold: what is fitted, and their directions.
    pub(super) fn noise(
        &self,
        records: &[Record],
        options: &ScreeningOptions,
    ) -> Result<Vec<LogSpectrum>, ScreeningError> {
        match self.frequencies(records.len()) {
            Some(frequencies) => spectra_of_lines(records, &frequencies, self.outputs(), options),
            None => spectra(records, self.outputs(), options),
        }
    }

    /// Frequencies of the lines of so many runs; none in time.
    fn frequencies(&self, runs: usize) -> Option<Vec<Vec<f64>>> {
        self.ways.iter().take(runs).map(Way::frequencies).collect()
    }

    /// Screens directions against records of its runs.
    pub(super) fn screened(
        &self,
        records: &[Record],
        directions: &[Direction],
        options: &ScreeningOptions,
    ) -> Result<Screening, ScreeningError> {
        match self.frequencies(records.len()) {
            Some(frequencies) => screen_lines(records, &frequencies, self.outputs(), directions, options),
            None => screen(records, self.outputs(), directions, options),
        }
    }
}

/// Residuals and sensitivities of runs, by a model on its ways, without directions.
pub(super) fn records(
    model: &Model,
    runs: &[Run],
    ways: &[Way],
    theta: &[Vec<f64>],
) -> Result<Vec<Record>, SearchError> {
    let (shared, own) = free(&model.definition().params);
    let of = |(place, ((run, theta), way)): (usize, ((_, &Vec<f64>), &Way))| {
        way.record(model.dynamics(), (run, theta), (&shared, &own), (place, runs.len()))
    };
    runs.iter().zip(theta).zip(ways).enumerate().map(of).collect()
}

/// Free parameters (by index): those that all runs share, those of each run.
fn free(params: &[Param]) -> (Vec<usize>, Vec<usize>) {
    let pick = |own: bool| {
        let chosen = params.iter().enumerate().filter(move |(_, p)| !p.fixed && p.per_run == own);
        chosen.map(|(k, _)| k).collect()
    };
    (pick(false), pick(true))
}
