//! Why nothing can be diagnosed, in the words of whoever brought the records.

use fdm_estimate::{FitError, SpectralError};
use fdm_grammar::Diagnostic;
use fdm_system::model::ModelError;
use fdm_system::simulate::Unsuited;

/// Why nothing can be diagnosed.
#[derive(Debug, Clone, thiserror::Error)]
pub enum DiagnosisError {
    /// The base model cannot be fitted.
    #[error("{0}")]
    Fit(#[from] FitError),
    /// The base model has no response.
    #[error("the base model cannot be compared with the records: {0}")]
    NoFit(String),
    /// A run too short for a spectrum.
    #[error("run `{run}` has {samples} samples; {least} are needed to tell noise from an effect")]
    TooShort {
        /// The run.
        run: String,
        /// Its samples.
        samples: usize,
        /// The least number.
        least: usize,
    },
    /// Samples that are not evenly spaced.
    #[error(
        "run `{run}` is not sampled evenly, so that its noise has no spectrum; bring it to equal intervals first \
         (gaps may stay empty)"
    )]
    Uneven {
        /// The run.
        run: String,
    },
    /// A gap that is no part of a run any more.
    #[error(
        "run `{run}` has a gap of {intervals} sampling intervals; give what stands before and behind it as two runs"
    )]
    LongGap {
        /// The run.
        run: String,
        /// Its length.
        intervals: usize,
    },
    /// No spectrum, no response in the frequency domain.
    #[error("{0}")]
    Spectral(#[from] SpectralError),
    /// A model without a linear response.
    #[error(
        "the model is not linear: {0}; show what is missing by an output, say `--nonlinear linearise` for the model at its trim, or \
         diagnose in the time domain"
    )]
    NotLinear(String),
    /// A band with hardly a bin in it.
    #[error(
        "run `{run}` has {bins} bins between {low:.4} and {high:.4} cycles per unit of time; {least} are needed to tell noise \
         from an effect (two for each frequency): widen the band, or use longer runs"
    )]
    FewLines {
        /// The run.
        run: String,
        /// Its bins.
        bins: usize,
        /// The least number.
        least: usize,
        /// Lowest frequency.
        low: f64,
        /// Highest.
        high: f64,
    },
    /// Bins that repeat each other.
    #[error(
        "bins {spacing} apart repeat each other: run `{run}` tells those apart that are {least:.4} or more apart, and probabilities \
         would be wrong; leave `--df` out"
    )]
    TooClose {
        /// The run.
        run: String,
        /// What was asked for.
        spacing: f64,
        /// One over its length.
        least: f64,
    },
    /// A validation run that is one of the others.
    #[error("the validation run `{validation}` has the samples of the training run `{run}`; it would prove nothing")]
    ValidationTwice {
        /// The validation run.
        validation: String,
        /// The other.
        run: String,
    },
    /// Work was stopped while there was no result yet.
    #[error("stopped before the model was fitted: nothing was found yet")]
    Stopped,
    /// No output was measured.
    #[error("no run has a measured output to compare with")]
    NothingMeasured,
    /// Outputs that stand still show nothing of a model.
    #[error(
        "no output ever changes in any run: such records say nothing about what a model lacks; use runs in which something moves, or \
         look whether the channel was recorded"
    )]
    Still,
    /// No effect fits.
    #[error("no effect of the catalogue fits this model anywhere")]
    NoPlaces,
    /// The text cannot be extended.
    #[error("{}", first(.0))]
    Text(Vec<Diagnostic>),
    /// An extended model cannot be compiled.
    #[error("{0}")]
    Model(Box<ModelError>),
    /// A run that the model cannot be simulated over.
    #[error("run `{run}`: {reason}")]
    Unsuited {
        /// The run.
        run: String,
        /// Why.
        reason: Unsuited,
    },
}

impl From<ModelError> for DiagnosisError {
    fn from(error: ModelError) -> Self {
        Self::Model(Box::new(error))
    }
}

fn first(findings: &[Diagnostic]) -> String {
    findings.first().map_or_else(String::new, |f| f.message.clone())
}
