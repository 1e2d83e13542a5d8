//! `fdm study`: Monte Carlo study of a fit: bias and scatter of its estimates, coverage of their intervals.

use crate::deliver::{Asked, Delivery, Places, Wanted};
use crate::failure::{Ending, Failure, ended};
use crate::job::Shared;
use clap::Args;
use fdm_session::{Conduct, Verb, study};

/// What `fdm study` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: study::Options,
    #[command(flatten)]
    delivery: Delivery,
}

impl Shared for Arguments {
    fn verb(&self) -> &dyn Verb {
        &self.options
    }

    fn wanted(&self) -> Wanted {
        self.places().wanted()
    }

    fn run(&self, asked: &Asked) -> Ending {
        if self.options.calibration { self.calibrate() } else { self.places().deliver(&self.options, asked) }
    }
}

impl Arguments {
    fn places(&self) -> Places<'_> {
        self.delivery.places()
    }

    /// A calibration, which has a page but no folder.
    fn calibrate(&self) -> Ending {
        let Delivery { output, plot, whole } = &self.delivery;
        if whole.out.is_some() || plot.is_some() || !self.options.repetition.checkpoints.given().is_empty() {
            return Err(Failure::input([
                "--calibration has no folder, drawing or checkpoint; --report and --json keep it",
            ]));
        }
        let wanted = Wanted { files: whole.report.is_some(), ..output.wanted() };
        let mut conduct = Conduct::shown(output.manner.quiet, wanted).within(self.options.given().limit);
        let session = self.options.session(&conduct)?;
        let answer = study::calibrate(&self.options, &session, &mut conduct)?;
        ended(output.hand_over(&answer, [(whole.report.as_ref(), answer.file("page.html"))]))
    }
}
