//! Why an equation is no regression, and why there is none at all.

use fdm_grammar::model::reading::Unsettled;
use fdm_system::record::Incomplete;
use fdm_system::spectrum::SpectrumError;
use std::fmt;

/// An equation that is left out, and why.
#[derive(Debug, Clone, PartialEq, Eq)]
#[allow(missing_docs, reason = "the message below each variant says what its fields are")]
pub enum Refusal {
    RateUnmeasured { equation: String, state: String, unsettled: Option<Box<Unsettled>> },
    SignalUnmeasured { equation: String, state: String, term: String, unsettled: Option<Box<Unsettled>> },
    Inside { equation: String, term: String, parameters: Vec<String> },
    NotAffine { equation: String, coefficient: String, term: String },
    FreeDelay { equation: String, term: String, parameters: Vec<String> },
}

fn quoted(names: &[String]) -> String {
    names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ")
}

impl Refusal {
    /// The equation, `der(x)`.
    pub fn equation(&self) -> &str {
        match self {
            Self::RateUnmeasured { equation, .. }
            | Self::SignalUnmeasured { equation, .. }
            | Self::Inside { equation, .. }
            | Self::NotAffine { equation, .. }
            | Self::FreeDelay { equation, .. } => equation,
        }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::RateUnmeasured { equation, unsettled: Some(unsettled), .. } => {
                write!(f, "`{equation}`: its rate is not known, since {unsettled}")
            }
            Self::RateUnmeasured { equation, state, unsettled: None } => {
                write!(f, "`{equation}`: no output shows the state `{state}`, so that its rate is not known")
            }
            Self::SignalUnmeasured { equation, term, unsettled: Some(unsettled), .. } => {
                write!(f, "`{equation}`: the term `{term}` is not known, since {unsettled}")
            }
            Self::SignalUnmeasured { equation, state, term, unsettled: None } => {
                write!(f, "`{equation}`: the state `{state}` in the term `{term}` is not shown by any output")
            }
            Self::Inside { equation, term, parameters } => write!(
                f,
                "`{equation}` is not linear in its parameters: {} inside the term `{term}`; fix it to estimate the rest",
                quoted(parameters)
            ),
            Self::NotAffine { equation, coefficient, term } => write!(
                f,
                "`{equation}` is not linear in its parameters: the factor `{coefficient}` of `{term}`; fix all but one of its \
                 parameters, or declare the product as one"
            ),
            Self::FreeDelay { equation, term, parameters } => write!(
                f,
                "`{equation}`: the term `{term}` is delayed by {}, in which it is not linear; fix the delay to estimate the rest",
                quoted(parameters)
            ),
        }
    }
}

/// Why there is no regression.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of each variant says what its fields are")]
pub enum RegressionError {
    #[error("there is no run to estimate from")]
    NoRuns,
    #[error("the model has events (`when`): at these a state has no rate; fit with `--method output-error`")]
    Events,
    #[error("no equation of the model is a regression:\n{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    NoEquation(Vec<Refusal>),
    #[error("{0}")]
    Incomplete(Incomplete),
    #[error("run `{run}`: {error}")]
    Spectrum { run: String, error: SpectrumError },
    #[error("run `{run}`: smoothing by a sine series needs equal intervals; use the local polynomial, which takes any")]
    Uneven { run: String },
    #[error("a window of {0} samples holds no polynomial of degree four; take an odd number from 5 on")]
    Window(usize),
    #[error("a cut-off of {0} cycles per unit of time is not above zero, or not below half the sampling rate")]
    Cutoff(f64),
    #[error(
        "run `{run}`: a cut-off of {cutoff} cycles per unit of time is not between {least:.4} (half a cycle in the record) and \
         {most:.4} (half the sampling rate); give one between them"
    )]
    CutoffOutside { run: String, cutoff: f64, least: f64, most: f64 },
    #[error(
        "run `{run}`: `{state}` has values at {present} of {samples} samples; a sine series needs them at half of the samples, and at \
         {least} at least: take every so many samples with --every, or a record with fewer gaps"
    )]
    Gaps { run: String, state: String, present: usize, samples: usize, least: usize },
    #[error("run `{run}`: the low-pass filter needs equal intervals; smooth by a polynomial, which takes any")]
    UnevenFilter { run: String },
    #[error(
        "a forgetting factor of {0} is not above 0 and at most 1; 1 forgets nothing, 0.99 most of what is some hundred samples old"
    )]
    Forgetting(f64),
    #[error("parts of {0} units of time are no parts of a record; give a length above 0")]
    Restart(f64),
    #[error("a solution has at least one component")]
    NoComponent,
    #[error(
        "a solution of {asked} components is not possible: {equations} has {most} parameters, so that {most} are the most"
    )]
    TooManyComponents { equations: String, asked: usize, most: usize },
    #[error(
        "{equations}: no sample has all values that the equation needs, its rate among them, which takes the neighbours of a sample; use a \
         record with fewer gaps, or take every so many samples with --every"
    )]
    NoRows { equations: String },
    #[error("{equations}: {rows} rows are too few for {parameters} parameters; use a longer record or a wider band")]
    TooFewRows { equations: String, rows: usize, parameters: usize },
    #[error("{equations}: the values are not finite or too large to be squared; look at the records and at the units")]
    NotFinite { equations: String },
    #[error("no output shows a state, so that there is no rate to explain")]
    NothingMeasured,
}
