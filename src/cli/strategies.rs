//! What can be asked about the way to the estimates, and about the confidence in them.

use clap::Args;
use fdm::estimate::{Continuation, FitOptions, Shooting};

/// Ways to the estimates, and confidence in them.
#[derive(Debug, Args)]
#[command(next_help_heading = "Strategy")]
pub(crate) struct Strategies {
    /// Fit a short record first and lengthen it: `auto` (when the plain fit fails), `never`, a number of equal lengths, or
    /// rising times
    #[arg(long, value_name = "auto|never|N|T1,T2,..", default_value = "auto", allow_hyphen_values = true)]
    continuation: Continuation,
    /// Fit first with the measured records of these states in the equations
    #[arg(long, value_name = "STATE,..|all", value_delimiter = ',')]
    substitute: Vec<String>,
    /// Cut the record into N segments, or as many as its samples allow, with initial states of their own (multiple
    /// shooting), for unstable models
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    shooting: Option<u32>,
    /// Fit shorter records too, and list the parameters in order of confidence
    #[arg(long)]
    confidence: bool,
    /// Fit with other weights of the outputs too, and show how far each parameter moves
    #[arg(long)]
    weights: bool,
}

impl Strategies {
    /// The options that were given.
    pub(crate) fn given(&self) -> Vec<&'static str> {
        let given = [
            ("--continuation", self.continuation != Continuation::default()),
            ("--substitute", !self.substitute.is_empty()),
            ("--shooting", self.shooting.is_some()),
            ("--confidence", self.confidence),
            ("--weights", self.weights),
        ];
        given.into_iter().filter(|(_, given)| *given).map(|(name, _)| name).collect()
    }

    /// The options of a fit with these among them.
    pub(crate) fn among(&self, options: FitOptions) -> FitOptions {
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
