//! `fdm regress --method rls`: recursive least squares with forgetting, and the best of its iterates.

use crate::failure::{Failure, NUMBERS, print};
use clap::{Args, ValueEnum};
use fdm::Model;
use fdm::estimate::{BestOptions, Criterion, best_iterate};
use fdm::record::Run;
use fdm::regression::{Detrend, Preprocessing, RecursiveOptions};
use fdm::report::{recursive_histories, recursive_json, recursive_table, recursive_times, svg};
use std::path::PathBuf;
use std::process::ExitCode;

/// What is particular to the recursion.
#[derive(Debug, Args)]
#[command(next_help_heading = "Recursive least squares (--method rls)")]
pub(crate) struct Recursive {
    /// Weight of a step relative to the one behind it, above 0, at most 1 [default: 0.99]
    #[arg(long, value_name = "G", allow_negative_numbers = true)]
    forgetting: Option<f64>,
    /// Filter all channels by a low-pass without phase, cut off at this frequency, in cycles per unit of time
    #[arg(long, value_name = "F", allow_negative_numbers = true)]
    lowpass: Option<f64>,
    /// Smooth all channels by polynomials of degree four through so many neighbours
    #[arg(long, value_name = "POINTS")]
    polynomial: Option<usize>,
    /// Which iterate is taken [default: simulation]
    #[arg(long, value_name = "CRITERION", value_enum)]
    best: Option<Best>,
    /// Simulate parts of this length, each from initial values of its own: for unstable vehicles
    #[arg(long, value_name = "LENGTH", allow_negative_numbers = true)]
    restart: Option<f64>,
    /// Draw the estimates along the record to an SVG file
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
}

/// What `--best` takes.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Best {
    /// The least error of a simulation of the whole record
    Simulation,
    /// The least error from each sample to the next
    OneStep,
    /// The last one
    Last,
}

impl Recursive {
    /// The options that were given.
    pub(crate) fn given(&self) -> Vec<&'static str> {
        let given = [
            ("--forgetting", self.forgetting.is_some()),
            ("--lowpass", self.lowpass.is_some()),
            ("--polynomial", self.polynomial.is_some()),
            ("--best", self.best.is_some()),
            ("--restart", self.restart.is_some()),
            ("--plot", self.plot.is_some()),
        ];
        given.into_iter().filter(|(_, given)| *given).map(|(name, _)| name).collect()
    }

    fn options(&self, detrend: Detrend) -> BestOptions {
        let preprocessing = Preprocessing { cutoff: self.lowpass, detrend, points: self.polynomial };
        let forgetting = self.forgetting.unwrap_or(RecursiveOptions::default().forgetting);
        let criterion = match self.best {
            None | Some(Best::Simulation) => Criterion::Simulation,
            Some(Best::OneStep) => Criterion::OneStep,
            Some(Best::Last) => Criterion::Last,
        };
        BestOptions { recursion: RecursiveOptions { forgetting, preprocessing }, criterion, restart: self.restart }
    }

    /// Follows the parameters, and prints the best iterate.
    pub(crate) fn run(&self, model: &Model, runs: &[Run], detrend: Detrend, json: bool) -> Result<ExitCode, Failure> {
        let found = best_iterate(model, runs, &self.options(detrend)).map_err(|e| Failure::input([e]))?;
        let text = if json { format!("{}\n", recursive_json(&found)) } else { recursive_table(&found) };
        let printed = print(&text);
        if let Some(path) = &self.plot {
            let told = |e: &dyn std::fmt::Display| Failure::input([format!("{}: {e}", path.display())]);
            let time = recursive_times(&found);
            let picture = svg(&recursive_histories(&found, &time)).map_err(|e| told(&e))?;
            std::fs::write(path, picture).map_err(|e| told(&e))?;
        }
        Ok(if printed { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
    }
}
