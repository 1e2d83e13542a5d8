//! `fdm diagnose`: lack of fit of a model, its cause, the extended model, and the gain.

use crate::deliver::{Asked, Output, Places, Whole, write};
use crate::failure::{Ending, ended, remark};
use crate::job::Shared;
use clap::Args;
use fdm_session::{Verb, diagnose};

/// What `fdm diagnose` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: diagnose::Options,
    #[command(flatten)]
    whole: Whole,
    #[command(flatten)]
    output: Output,
}

impl Shared for Arguments {
    fn verb(&self) -> &dyn Verb {
        &self.options
    }

    fn places(&self) -> Places<'_> {
        self.whole.places(&self.output)
    }

    /// The extended text is written first: the answer tells where it is.
    fn run(&self, asked: &Asked) -> Ending {
        let Some(file) = &self.options.write else { return self.places().deliver(&self.options, asked) };
        let mut prepared = self.places().prepare(&self.options, asked)?;
        let diagnosed = diagnose::diagnose(&self.options, &prepared.session, &mut prepared.conduct)?;
        let written = diagnosed.found.extended.as_ref().map(|text| write(file, text));
        let place = matches!(written, Some(Ok(()))).then(|| file.display().to_string());
        let answer = diagnosed.answer(place.as_deref(), prepared.conduct.wanted)?;
        let whole = prepared.hand_over(&answer);
        let failed = written.and_then(Result::err);
        failed.iter().for_each(|failure| remark(format_args!("error: {failure}")));
        ended(whole && failed.is_none())
    }
}
