//! Groups of options that several commands share: integration, fallback strategies, the frequency domain, Monte Carlo repeats.

use crate::checkpoint::Checkpoints;
use crate::methods::{Start, given};
use crate::value::{band, number};
use crate::word::one_of;
use clap::Args;
use fdm_estimate::{
    Changes, Continuation, FitOptions, FrequencyOptions, Noise, Nonlinear, Options, Shooting, SpectralOptions,
    StartValues,
};
use fdm_lab::study::Colour;
use fdm_system::frequency::EndTerms;
use fdm_system::simulate::{Accuracy, Scheme};
use fdm_system::spectrum::Frequencies;
use std::num::NonZeroUsize;

/// How a run is integrated.
#[derive(Debug, Args)]
#[command(next_help_heading = "Integration")]
pub struct Integration {
    /// Equal integration steps between samples [default: as many as accuracy needs]
    #[arg(long, value_name = "N", allow_negative_numbers = true, hide_short_help = true)]
    steps: Option<NonZeroUsize>,
    /// Integration scheme: `auto` takes Radau for stiff models
    #[arg(long, value_name = "SCHEME", value_parser = one_of(&INTEGRATORS), default_value = "auto", hide_short_help = true)]
    pub(crate) integrator: ChosenScheme,
    /// Integration error that is of no consequence, as a part of each output's range [default: 1e-8]
    #[arg(long, value_name = "A", value_parser = accuracy, allow_negative_numbers = true, conflicts_with = "steps", hide_short_help = true)]
    pub(crate) integration_accuracy: Option<f64>,
}

/// A part of an output's range.
fn accuracy(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if (1e-13..=1e-3).contains(&value) { Ok(value) } else { Err("expected a part from 1e-13 to 1e-3".into()) }
}

/// A scheme; none where accuracy and speed choose it. By this name the parser does not take the option for one that may be left out.
type ChosenScheme = Option<Scheme>;

/// What `--integrator` takes.
const INTEGRATORS: [(&str, ChosenScheme, &str); 3] = [
    ("auto", None, "The one that reaches the accuracy with less work"),
    ("runge-kutta", Some(Scheme::RungeKutta), "Classical Runge-Kutta, explicit"),
    ("radau", Some(Scheme::Radau), "Radau IIA of order 5, implicit, for stiff models"),
];

/// The integration error that chosen steps keep below, as a part of each output's range.
const NEGLIGIBLE: f64 = 1e-8;

impl Integration {
    /// The number of steps between samples that was asked for.
    pub fn per_interval(&self) -> Option<usize> {
        self.steps.map(NonZeroUsize::get)
    }

    /// The options of a fit with these among them.
    pub fn among(&self, options: FitOptions) -> FitOptions {
        let (scheme, accuracy) = (self.integrator, self.integration_accuracy);
        FitOptions { per_interval: self.per_interval(), scheme, accuracy, ..options }
    }

    /// The options of a plain fit with these changes and this noise.
    pub(crate) fn plain(&self, changes: Changes, noise: Noise) -> FitOptions {
        let options = Options { noise, ..Options::default() };
        self.among(FitOptions { changes, options, ..FitOptions::default() })
    }

    /// The options that were given.
    pub fn given(&self) -> Vec<&'static str> {
        given(&[
            ("--steps", self.steps.is_some()),
            ("--integration-accuracy", self.integration_accuracy.is_some()),
            ("--integrator runge-kutta", self.integrator == Some(Scheme::RungeKutta)),
            ("--integrator radau", self.integrator == Some(Scheme::Radau)),
        ])
    }

    /// Scheme, steps and integration error of a run, in words; a stiff model is called so where the scheme was chosen for it.
    pub fn said(&self, accuracy: &Accuracy) -> String {
        let said = integration(accuracy, self.steps.is_none() && self.integrator.is_none());
        match accuracy.error / NEGLIGIBLE {
            lost if self.steps.is_some() && lost.is_finite() && lost >= 10.0 => {
                format!("{said}: {lost:.0e} times what steps that are chosen (without --steps) keep to")
            }
            _ => said,
        }
    }
}

/// Scheme, steps and integration error of a run, in words; `chosen` when the user did not ask for the scheme.
pub fn integration(accuracy: &Accuracy, chosen: bool) -> String {
    let stiff = if chosen && accuracy.steps.scheme() == Scheme::Radau { " (stiff)" } else { "" };
    let error = match accuracy.error {
        // exact discretisation has none
        error if error.is_nan() || error == 0.0 => String::new(),
        error if error.is_infinite() => ", integration error not finite".into(),
        error => format!(", integration error {error:.0e} of the range"),
    };
    format!("{}{stiff}{error}", accuracy.steps)
}

/// Fallback strategies for fits that go astray, and checks of their estimates.
#[derive(Debug, Args)]
#[command(next_help_heading = "Strategy")]
pub struct Strategies {
    /// Record-length continuation, short records first: `auto` (when the plain fit fails), `never`, a number of equal lengths, or
    /// rising times
    #[arg(
        long,
        value_name = "auto|never|N|T1,T2,..",
        default_value = "auto",
        allow_hyphen_values = true,
        hide_short_help = true
    )]
    continuation: Continuation,
    /// Fit first with these states replaced by their measured records
    #[arg(long, value_name = "STATE,..|all", value_delimiter = ',', hide_short_help = true)]
    substitute: Vec<String>,
    /// Multiple shooting, for unstable models: cut each record into N segments with initial states of their own
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=1_000_000), hide_short_help = true)]
    shooting: Option<u32>,
    /// Fit shorter records too, and list the parameters in order of confidence
    #[arg(long, hide_short_help = true)]
    confidence: bool,
    /// Fit with other weights of the outputs too, and show how far each parameter moves
    #[arg(long, hide_short_help = true)]
    weights: bool,
}

impl Strategies {
    /// The options that were given.
    pub fn given(&self) -> Vec<&'static str> {
        given(&[
            ("--continuation", self.continuation != Continuation::default()),
            ("--substitute", !self.substitute.is_empty()),
            ("--shooting", self.shooting.is_some()),
            ("--confidence", self.confidence),
            ("--weights", self.weights),
        ])
    }

    /// The options of a fit with these among them.
    pub fn among(&self, options: FitOptions) -> FitOptions {
        FitOptions {
            continuation: self.continuation.clone(),
            substitute: self.substitute.clone(),
            shooting: self.shooting.map(|n| Shooting::Segments(n as usize)),
            confidence: self.confidence,
            reweight: self.weights,
            ..options
        }
    }
}

/// Frequency bins, and how spectra are fitted.
#[derive(Debug, Args)]
#[command(next_help_heading = "Frequency domain")]
pub struct Spectra {
    /// Frequency band from LO to HI, in cycles per unit of time (Hz if that is the second) [default: where the inputs excite the
    /// model]
    #[arg(long, value_name = "LO:HI", value_parser = band, hide_short_help = true)]
    band: Option<(f64, f64)>,
    /// Frequency spacing, by zoom (chirp-z) transform [default: each record's own bins, i/T]
    #[arg(long, value_parser = number, value_name = "STEP", requires = "band", allow_negative_numbers = true, hide_short_help = true)]
    df: Option<f64>,
    /// End-point (leakage) corrections [default: free]
    #[arg(long, value_name = "HOW", value_parser = one_of(&END_POINTS), hide_short_help = true)]
    end_points: Option<EndTerms>,
    /// Nonlinear terms of a model in the frequency domain [default: auto]
    #[arg(long, value_name = "HOW", value_parser = one_of(&NONLINEAR), hide_short_help = true)]
    nonlinear: Option<Nonlinear>,
}

/// What `--end-points` takes.
static END_POINTS: [(&str, EndTerms, &str); 3] = [
    ("known", EndTerms::Known, "From the record, where outputs show the states"),
    ("free", EndTerms::Unknown, "Estimated in every run"),
    ("none", EndTerms::Omitted, "Left out: for records that begin and end at rest"),
];

/// What `--nonlinear` takes.
const NONLINEAR: [(&str, Nonlinear, &str); 3] = [
    ("auto", Nonlinear::Auto, "Measured regressors where the records allow it, else linearised"),
    (
        "measured-regressors",
        Nonlinear::MeasuredRegressors,
        "As measured regressors (pseudo-inputs) computed from the records",
    ),
    ("linearise", Nonlinear::Linearised, "Linearised at the trim"),
];

impl Spectra {
    /// The options that were given.
    pub fn given(&self) -> Vec<&'static str> {
        given(&[
            ("--band", self.band.is_some()),
            ("--df", self.df.is_some()),
            ("--end-points", self.end_points.is_some()),
            ("--nonlinear", self.nonlinear.is_some()),
        ])
    }

    /// The frequencies at which records and model are compared.
    pub fn frequencies(&self) -> Frequencies {
        match (self.band, self.df) {
            (Some((lowest, highest)), Some(df)) => Frequencies::Band { lowest, highest, spacing: Some(df) },
            (Some((low, high)), None) => Frequencies::Grid { lowest: Some(low), highest: Some(high) },
            (None, _) => Frequencies::Grid { lowest: None, highest: None },
        }
    }

    /// What is chosen of the frequency domain, where the iteration begins as it was said.
    pub fn options(&self, start: Option<StartValues>) -> FrequencyOptions {
        FrequencyOptions {
            frequencies: self.frequencies(),
            ends: self.end_points.clone().unwrap_or(EndTerms::Unknown),
            nonlinear: self.nonlinear.unwrap_or_default(),
            regressed: start != Some(StartValues::Model),
            ..FrequencyOptions::default()
        }
    }
}

/// The frequency domain of `fdm diagnose`: spectra, and where their fits begin.
#[derive(Debug, Args)]
#[command(next_help_heading = "Frequency domain")]
pub struct DiagnosedSpectra {
    #[command(flatten)]
    spectra: Spectra,
    #[command(flatten)]
    start: Start,
}

impl DiagnosedSpectra {
    /// The options that were given.
    pub fn given(&self) -> Vec<&'static str> {
        self.spectra.given().into_iter().chain(self.start.given()).collect()
    }

    /// The options of the fits.
    pub fn options(&self) -> SpectralOptions {
        FitOptions { frequency: self.spectra.options(self.start.start_values), ..FitOptions::default() }.of_spectra()
    }
}

/// Everything that is particular to fits in the frequency domain.
#[derive(Debug, Args)]
#[command(next_help_heading = "Frequency domain")]
pub struct FrequencyDomain {
    /// The spectra.
    #[command(flatten)]
    pub spectra: Spectra,
    /// Known noise of a measured input, which biases estimates (errors in variables): the bias is removed, and standard errors
    /// include it; may be given several times
    #[arg(long = "input-noise", value_name = "INPUT=DEVIATION", value_parser = deviation, hide_short_help = true)]
    input_noise: Vec<(String, f64)>,
    /// Frequency responses: lengths of the averaged segments, in the model's time [default: two, the second half as long as the
    /// first]
    #[arg(long, value_parser = number, value_name = "L1,L2,..", value_delimiter = ',', allow_negative_numbers = true, hide_short_help = true)]
    segments: Vec<f64>,
    /// Frequency responses: a pair that is compared; may be given several times [default: all that the model connects]
    #[arg(long = "pair", value_name = "OUTPUT/INPUT", value_parser = pair, hide_short_help = true)]
    pairs: Vec<(String, String)>,
    /// Frequency responses: least coherence of a frequency that counts [default: 0.6]
    #[arg(long, value_parser = number, value_name = "C", allow_negative_numbers = true, hide_short_help = true)]
    coherence: Option<f64>,
}

impl FrequencyDomain {
    /// The options that were given.
    pub fn given(&self) -> Vec<&'static str> {
        let own = given(&[
            ("--input-noise", !self.input_noise.is_empty()),
            ("--segments", !self.segments.is_empty()),
            ("--pair", !self.pairs.is_empty()),
            ("--coherence", self.coherence.is_some()),
        ]);
        self.spectra.given().into_iter().chain(own).collect()
    }

    /// What is chosen of the frequency domain, where the iteration begins as it was said.
    pub fn options(&self, start: Option<StartValues>) -> FrequencyOptions {
        let usual = self.spectra.options(start);
        FrequencyOptions {
            input_noise: self.input_noise.clone(),
            segments: self.segments.clone(),
            pairs: self.pairs.clone(),
            coherence: self.coherence.unwrap_or(usual.coherence),
            ..usual
        }
    }
}

/// `INPUT=DEVIATION`
fn deviation(text: &str) -> Result<(String, f64), String> {
    let (input, deviation) = text.split_once('=').ok_or("expected INPUT=DEVIATION, such as p=0.002")?;
    Ok((input.trim().to_string(), number(deviation)?))
}

/// `OUTPUT/INPUT`
fn pair(text: &str) -> Result<(String, String), String> {
    let (output, input) = text.split_once('/').ok_or("expected OUTPUT/INPUT")?;
    Ok((output.trim().to_string(), input.trim().to_string()))
}

/// The noise of a Monte Carlo study, and where its repeats are kept.
#[derive(Debug, Args)]
#[command(next_help_heading = "Repeats")]
pub struct Repeats {
    /// Seed of the noise; the same seed gives the same repeats
    #[arg(long, value_name = "S", default_value_t = 0, allow_negative_numbers = true)]
    pub seed: u64,
    /// Colour of the noise in the repeats [default: white; for experiments as they describe it]
    #[arg(long, value_name = "COLOUR", value_parser = one_of(&COLOURS), value_delimiter = ',', hide_short_help = true)]
    pub noise_colour: Vec<Colour>,
    /// Where the repeats are kept.
    #[command(flatten)]
    pub checkpoints: Checkpoints,
}

/// What `--noise-colour` takes.
const COLOURS: [(&str, Colour, &str); 4] = [
    ("white", Colour::White, "White noise"),
    ("fitted", Colour::Fitted, "As in the residuals: the autoregressive model that corrects the standard errors"),
    ("ar1", Colour::Ar1, "AR(1) noise, rho = 0.9"),
    ("pink", Colour::Pink, "Pink noise: power falls as one over the frequency"),
];

impl Repeats {
    /// The options that were given.
    pub fn given(&self) -> Vec<&'static str> {
        let own = given(&[("--seed", self.seed != 0), ("--noise-colour", !self.noise_colour.is_empty())]);
        [own, self.checkpoints.given()].concat()
    }
}
