//! `fdm validate`: a result against runs that it was not fitted to.

use crate::deliver::Delivered;
use crate::failure::{Ending, ended};
use fdm_session::outcome::names;
use fdm_session::validate;

/// What `fdm validate` takes.
pub(crate) type Arguments = Delivered<validate::Options>;

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let (places, options) = (arguments.places(), &arguments.options);
    let conduct = places.conduct(&options.limit);
    let (folder, session) = options.read(conduct.quiet)?;
    let names = names(&session.model, &session.runs);
    let mut prepared = places.prepared(conduct, session.of_command(crate::command_line()), &names)?;
    let answer = validate::answer(options, &folder, &prepared.session, &mut prepared.conduct)?;
    ended(prepared.hand_over(&answer))
}
