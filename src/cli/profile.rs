//! `fdm profile`: profile-likelihood confidence intervals.

use crate::deliver::{Output, Places};
use crate::job::Shared;
use crate::ownership::Overwriting;
use clap::Args;
use fdm_session::{Verb, profile};
use std::path::PathBuf;

/// What `fdm profile` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: profile::Options,
    #[command(flatten)]
    output: Output,
    /// Draw the cost over each parameter to an SVG file
    #[arg(long, value_name = "FILE.svg", help_heading = "Result")]
    plot: Option<PathBuf>,
    /// Write one page for a browser: intervals, and the cost over each parameter
    #[arg(long, value_name = "FILE.html", help_heading = "Result")]
    report: Option<PathBuf>,
    /// Read by the rule for files that are written over others.
    #[command(flatten)]
    _overwriting: Overwriting,
}

impl Shared for Arguments {
    fn verb(&self) -> &dyn Verb {
        &self.options
    }

    fn places(&self) -> Places<'_> {
        Places { output: &self.output, plot: self.plot.as_deref(), out: None, report: self.report.as_deref() }
    }
}
