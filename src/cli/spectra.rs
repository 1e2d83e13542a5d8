//! `fdm spectra`: frequency responses estimated from records alone; the model only names the channels.

use crate::deliver::{Output, Places};
use crate::failure::{Ending, ended};
use crate::ownership::Overwriting;
use clap::Args;
use fdm_session::spectra;
use std::path::PathBuf;

/// What `fdm spectra` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: spectra::Options,
    #[command(flatten)]
    output: Output,
    /// Draw magnitude, phase and coherence to an SVG file
    #[arg(long, value_name = "FILE.svg", help_heading = "Result")]
    plot: Option<PathBuf>,
    /// Write one page for a browser: magnitude, phase and coherence of every pair
    #[arg(long, value_name = "FILE.html", help_heading = "Result")]
    report: Option<PathBuf>,
    /// Read by the rule for files that are written over others.
    #[command(flatten)]
    _overwriting: Overwriting,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let Arguments { options, output, plot, report, .. } = arguments;
    let places = Places { output, plot: plot.as_deref(), out: None, report: report.as_deref() };
    let session = options.session(output.manner.quiet)?;
    ended(places.hand_over(&spectra::answer(options, &session, places.wanted())?))
}
