//! `fdm regress`: regression of measured rates; recursively with forgetting; and the search for the structure of a rate.

use crate::deliver::{Asked, Output, Places, Whole};
use crate::failure::Ending;
use clap::Args;
use fdm_session::methods::given;
use fdm_session::regress;

/// What `fdm regress` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: regress::Options,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    whole: Whole,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let Arguments { options, output, whole } = arguments;
    let places = [("--out", whole.out.is_some()), ("--report", whole.report.is_some())];
    options.refuse(given(&places))?;
    let plot = options.recursive.plot.as_deref();
    Places { plot, ..whole.places(output) }.deliver(options, &Asked::default())
}
