//! What a result folder holds as its result: a fit of any kind, or regressions.

use super::doctor::JudgedRecords;
use super::fit::{FitDocument, Matrix};
use super::frequency::Pair;
use super::json::{from_text, to_text};
use super::model::ModesDocument;
use super::regression::RegressionDocument;
use super::requirement::Assessment;
use fdm_estimate::{ParameterEstimate, Status};
use fdm_grammar::model::Param;
use fdm_system::model::Model;
use serde::{Deserialize, Serialize};

/// The result of a folder.
#[derive(Debug, Clone, PartialEq)]
pub enum ResultDocument {
    /// A fit.
    Fit(Box<FitDocument>),
    /// Regressions.
    Regression(Box<RegressionDocument>),
}

/// A parameter as it was found.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct KeptParameter {
    /// Its name.
    pub name: String,
    /// The run that it belongs to; none when all runs share it.
    pub run: Option<String>,
    /// Its value.
    pub value: f64,
    /// What was said about it, in one word.
    pub status: Status,
    /// Its unit, as text.
    #[serde(default)]
    pub unit: Option<String>,
    /// Cramer-Rao standard error.
    #[serde(default)]
    pub standard_error: Option<f64>,
    /// Standard error corrected for the colour of the residuals.
    #[serde(default)]
    pub corrected_error: Option<f64>,
}

impl KeptParameter {
    /// The error to be trusted.
    pub fn error(&self) -> Option<f64> {
        self.corrected_error.or(self.standard_error)
    }
}

impl From<&ParameterEstimate> for KeptParameter {
    fn from(p: &ParameterEstimate) -> Self {
        Self {
            name: p.name.clone(),
            run: p.run.clone(),
            value: p.value,
            status: p.status,
            unit: p.unit.clone(),
            standard_error: p.standard_error,
            corrected_error: p.corrected_error,
        }
    }
}

impl From<FitDocument> for ResultDocument {
    fn from(fit: FitDocument) -> Self {
        Self::Fit(Box::new(fit))
    }
}

impl From<RegressionDocument> for ResultDocument {
    fn from(regression: RegressionDocument) -> Self {
        Self::Regression(Box::new(regression))
    }
}

impl ResultDocument {
    /// Reads a result.
    ///
    /// # Errors
    /// [`serde_json::Error`] where the text is neither a fit nor regressions.
    pub fn read(text: &str) -> Result<Self, serde_json::Error> {
        /// What regressions have and fits have not.
        #[derive(Deserialize)]
        struct Kind {
            fits: Option<serde::de::IgnoredAny>,
        }
        let kind: Kind = serde_json::from_str(text)?;
        match kind.fits {
            Some(_) => from_text(text).map(Self::Regression),
            None => from_text(text).map(Self::Fit),
        }
    }

    /// The text of the result.
    ///
    /// # Errors
    /// As [`to_text`].
    pub fn text(&self) -> Result<String, serde_json::Error> {
        match self {
            Self::Fit(fit) => to_text(fit),
            Self::Regression(regression) => to_text(regression),
        }
    }

    /// The fit; none of regressions.
    pub fn fit(&self) -> Option<&FitDocument> {
        match self {
            Self::Fit(fit) => Some(fit),
            Self::Regression(_) => None,
        }
    }

    /// The regressions; none of a fit.
    pub fn regression(&self) -> Option<&RegressionDocument> {
        match self {
            Self::Fit(_) => None,
            Self::Regression(regression) => Some(regression),
        }
    }

    /// The model's name.
    pub fn model(&self) -> &str {
        match self {
            Self::Fit(fit) => &fit.model,
            Self::Regression(regression) => &regression.model,
        }
    }

    /// Every parameter, per-run ones once for every run, and derived quantities.
    pub fn parameters(&self) -> Vec<KeptParameter> {
        match self {
            Self::Fit(fit) => fit.parameters.iter().map(KeptParameter::from).collect(),
            Self::Regression(regression) => regression.parameters.clone(),
        }
    }

    /// The modes of the model as it was found.
    pub fn modes(&self) -> Option<&ModesDocument> {
        let modes = match self {
            Self::Fit(fit) => &fit.modes,
            Self::Regression(regression) => &regression.modes,
        };
        modes.as_ref()?.as_ref()
    }

    /// Adds the modes of the model as it was found; none where it has no states.
    pub fn set_modes(&mut self, modes: Option<ModesDocument>) {
        match self {
            Self::Fit(fit) => fit.modes = Some(modes),
            Self::Regression(regression) => regression.modes = Some(modes),
        }
    }

    /// Whether it is a fit in the time domain whose responses were simulated, not predicted from sample to sample.
    pub fn is_simulated(&self) -> bool {
        let elsewhere = |fit: &FitDocument| fit.frequency_domain.is_some() || fit.frequency_responses.is_some();
        self.fit().is_some_and(|fit| !elsewhere(fit) && fit.deviations.is_none())
    }

    /// Adds the requirements of the model as it was found, where it has such.
    pub fn set_requirements(&mut self, requirements: Option<Vec<Assessment>>) {
        if let Self::Fit(fit) = self {
            fit.requirements = requirements.unwrap_or_default();
        }
    }

    /// Adds the frequency responses that a fit in the time domain shows.
    pub fn set_bode(&mut self, bode: Vec<Pair>) {
        if let Self::Fit(fit) = self {
            fit.bode = bode;
        }
    }

    /// Adds what was assumed about the records and found in them.
    pub fn set_records(&mut self, records: Option<JudgedRecords>) {
        match self {
            Self::Fit(fit) => fit.records = records,
            Self::Regression(regression) => regression.records = records,
        }
    }

    /// What was assumed about the records and found in them.
    pub fn records(&self) -> Option<&JudgedRecords> {
        match self {
            Self::Fit(fit) => fit.records.as_ref(),
            Self::Regression(regression) => regression.records.as_ref(),
        }
    }

    /// Values of all parameters of `model` (p), as far as they were found; per-run ones those of `run`.
    pub fn theta(&self, model: &Model, run: &str) -> Vec<f64> {
        let parameters = self.parameters();
        let value = |p: &Param| {
            let owner = Some(run).filter(|_| p.per_run);
            let own = parameters.iter().find(|k| k.name == p.quantity.name && k.run.as_deref() == owner);
            own.map_or(p.value, |k| k.value)
        };
        model.definition().params.iter().map(value).collect()
    }

    /// The covariance of the parameters of `model` (p by p, row by row), of per-run ones those of `run`; corrected for coloured
    /// residuals where the fit did that. Zero for what was not estimated; none of regressions, which know none.
    pub fn covariance(&self, model: &Model, run: &str) -> Option<Vec<f64>> {
        let fit = self.fit()?;
        let params = &model.definition().params;
        let p = params.len();
        let mut covariance = vec![0.0; p * p];
        let Some(Matrix { parameters, values }) = fit.trusted_covariance() else { return Some(covariance) };
        let place = |k: &usize| {
            let found = fit.parameters.get(*k)?;
            let owner = found.run.as_deref();
            params.iter().position(|p| p.quantity.name == found.name && (owner.is_none() || owner == Some(run)))
        };
        let places: Vec<Option<usize>> = parameters.iter().map(place).collect();
        for (row, own) in places.iter().zip(values) {
            for (column, value) in places.iter().zip(own) {
                if let (Some(a), Some(b), true) = (row, column, value.is_finite()) {
                    covariance[a * p + b] = *value;
                }
            }
        }
        Some(covariance)
    }
}
