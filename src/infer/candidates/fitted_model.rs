//! A model at its fit: what candidates are compared with.
//!
//! A fitted model fitted by one noise: to the training runs, and to the validation runs with all that is shared as it is.

use crate::bins::Signals;
use crate::candidates::error::DiagnosisError;
use crate::candidates::predictor::Predictor;
use crate::candidates::runs::Runs;
use crate::diagnosis::FrequencyDomain;
use fdm_effects::Subject;
use fdm_grammar::model::Param;
use fdm_system::model::Model;

/// A model with its text, the values of its parameters, and its responses.
#[derive(Clone)]
pub(crate) struct FittedModel {
    /// The model.
    pub(crate) model: Model,
    /// Its text.
    pub(crate) subject: Subject,
    /// All parameters (p) of each run.
    pub(crate) theta: Vec<Vec<f64>>,
    /// How each run is answered.
    pub(crate) predictors: Vec<Predictor>,
    /// Outputs of each run, N by q.
    pub(crate) response: Vec<Signals>,
}

impl FittedModel {
    /// The model at `theta`; every run must have a response there.
    pub(crate) fn new(model: Model, runs: Runs<'_>, theta: Vec<Vec<f64>>) -> Result<Self, DiagnosisError> {
        let subject = Subject::new(model.source(), model.definition()).map_err(DiagnosisError::Text)?;
        let predictors = Predictor::all(&model, runs, &theta)?;
        let of =
            |((run, theta), predictor): ((_, &Vec<f64>), &Predictor)| predictor.answer(model.dynamics(), run, theta);
        let response = runs.all.iter().zip(&theta).zip(&predictors).map(of).collect::<Result<_, _>>()?;
        Ok(Self { model, subject, theta, predictors, response })
    }

    /// Number of outputs.
    pub(crate) fn outputs(&self) -> usize {
        self.model.layout().outputs
    }

    /// Its parameters.
    pub(crate) fn params(&self) -> &[Param] {
        &self.model.definition().params
    }

    /// What is told of the frequency domain; none in time.
    pub(crate) fn spectral(&self) -> Option<FrequencyDomain> {
        self.predictors.first().and_then(Predictor::told)
    }
}

/// Parameters of each run with what all runs share from elsewhere.
pub(crate) fn shared_from(params: &[Param], shared: &[f64], own: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let of = |theta: &Vec<f64>| {
        let each = params.iter().zip(shared.iter().zip(theta));
        each.map(|(p, (shared, own))| if p.per_run { *own } else { *shared }).collect()
    };
    own.iter().map(of).collect()
}
