//! `fdm profile`: profile-likelihood confidence intervals.

use crate::deliver::{Asked, Output, Wanted};
use crate::failure::{Ending, ended};
use crate::job::Shared;
use crate::ownership::Overwriting;
use clap::Args;
use fdm_session::{Conduct, Verb, profile};
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

    fn wanted(&self) -> Wanted {
        Wanted { plot: self.plot.is_some(), files: self.report.is_some(), ..self.output.wanted() }
    }

    fn run(&self, asked: &Asked) -> Ending {
        let conduct = Conduct::shown(self.output.manner.quiet, self.wanted()).within(self.options.given().limit);
        let mut conduct = Conduct { done: asked.done.clone(), ..conduct };
        let session = self.options.session(&conduct)?;
        let answer = self.options.answer(&session, &mut conduct);
        conduct.progress.finish();
        let answer = answer?;
        let drawing = answer.plot.as_deref().map(str::as_bytes);
        let places = [(self.plot.as_ref(), drawing), (self.report.as_ref(), answer.file("page.html"))];
        ended(self.output.hand_over(&answer, places))
    }
}
