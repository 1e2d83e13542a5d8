//! `fdm validate`: a result against runs that it was not fitted to.

use crate::deliver::Delivery;
use crate::failure::{Ending, ended};
use clap::Args;
use fdm_session::outcome::names;
use fdm_session::{Conduct, validate};

/// What `fdm validate` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: validate::Options,
    #[command(flatten)]
    delivery: Delivery,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let (places, options) = (arguments.delivery.places(), &arguments.options);
    let conduct = Conduct::shown(places.output.manner.quiet, places.wanted()).within(&options.limit);
    let (folder, session) = options.read(conduct.quiet)?;
    let names = names(&session.model, &session.runs);
    let mut prepared = places.prepared(conduct, session.of_command(crate::command_line()), &names)?;
    let answer = validate::answer(options, &folder, &prepared.session, &mut prepared.conduct)?;
    ended(prepared.hand_over(&answer))
}
