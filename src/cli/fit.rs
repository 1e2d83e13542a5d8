//! `fdm fit`: parameters, their standard errors and the quality of the match, from one or several runs, by any method.

use crate::deliver::{Asked, Delivery, Places, Wanted};
use crate::failure::Ending;
use crate::job::Shared;
use clap::Args;
use fdm_session::{Verb, fit};

/// What `fdm fit` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: fit::Options,
    #[command(flatten)]
    delivery: Delivery,
}

impl Arguments {
    fn places(&self) -> Places<'_> {
        self.delivery.places()
    }
}

impl Shared for Arguments {
    fn verb(&self) -> &dyn Verb {
        &self.options
    }

    fn wanted(&self) -> Wanted {
        self.places().wanted()
    }

    fn run(&self, asked: &Asked) -> Ending {
        self.places().deliver(&self.options, asked)
    }
}
