//! Where models are compared with records: sample by sample in time, or line by line of their spectra.

use super::search_error::SearchError;
use crate::estimate::{Nonlinear, SpectralError, SpectralLines, SpectralOptions};
use crate::model::Model;
use crate::record::Run;
use crate::spectrum::Frequencies;

/// Part of the sampling frequency up to which lines are taken, where the inputs move less.
const UPPER: f64 = 0.45;
/// Fewest lines of a run by which noise is told from an effect.
const LEAST: usize = 32;

/// Where models are compared with records.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Domain {
    /// Responses are integrated.
    #[default]
    Time,
    /// Responses of linear models at the frequencies of the records.
    Frequency(Box<SpectralOptions>),
}

impl Domain {
    /// The same with everything chosen that was left open; `runs` are those that are learned from.
    ///
    /// # Errors
    /// [`SearchError`]: models without a linear response, bands without lines.
    pub(super) fn settled(&self, model: &Model, runs: &[Run]) -> Result<Self, SearchError> {
        let Self::Frequency(options) = self else { return Ok(Self::Time) };
        let mut options = options.clone();
        options.finish = false;
        options.nonlinear = nonlinear(model, options.nonlinear)?;
        let lines = SpectralLines::new(model, runs, &options)?;
        if let Frequencies::Grid { lowest: None, highest: None } = options.frequencies {
            let rates = runs.iter().map(|run| 1.0 / super::evenly::interval(run));
            let highest = rates.map(|rate| UPPER * rate).fold(f64::INFINITY, f64::min).max(lines.band().1);
            options.frequencies = Frequencies::Grid { lowest: None, highest: Some(highest) };
        }
        if let Frequencies::Band { spacing: Some(spacing), .. } = options.frequencies {
            let apart = |run: &&Run| spacing * super::evenly::interval(run) * (run.len() as f64) < 1.0 - 1e-9;
            if let Some(run) = runs.iter().find(apart) {
                let least = 1.0 / (super::evenly::interval(run) * run.len() as f64);
                return Err(SearchError::TooClose { run: run.name.clone(), spacing, least });
            }
        }
        let lines = SpectralLines::new(model, runs, &options)?;
        for (k, run) in runs.iter().enumerate() {
            let count = lines.frequencies(k).len();
            if count < LEAST {
                let (low, high) = lines.band();
                return Err(SearchError::FewLines { run: run.name.clone(), lines: count, least: LEAST, low, high });
            }
        }
        Ok(Self::Frequency(options))
    }
}

/// What is done about nonlinear terms: those of candidates must be known from records as those of the model are.
fn nonlinear(model: &Model, asked: Nonlinear) -> Result<Nonlinear, SearchError> {
    match asked {
        Nonlinear::Linearised if !SpectralLines::is_linear(model) => Ok(Nonlinear::Linearised),
        _ => match model.definition().carried() {
            Ok(_) => Ok(Nonlinear::Carried),
            Err(reason) => Err(SearchError::NotLinear(SpectralError::NotCarried(reason).to_string())),
        },
    }
}
