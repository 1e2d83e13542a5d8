//! What a command shows of itself where it is cut into tasks.

use crate::failure::Failure;
use fdm_estimate::Halt;
use fdm_lab::job::{Kind, Tasks};
use fdm_results::store::Identity;

/// Sees the tasks of a command, ready to be done, and what their bits depend on.
pub(crate) type Visit<'v> = &'v mut (dyn FnMut(&dyn Tasks, &Identity) -> Result<(), Failure> + 'v);

/// Does a command as one task; none where it was interrupted.
pub(crate) type WholeResult = Result<Option<Vec<u8>>, Failure>;

/// A command that is one task.
pub(crate) struct WholeCommand<'c>(pub(crate) &'c (dyn Fn(&Halt) -> WholeResult + Sync));

impl Tasks for WholeCommand<'_> {
    fn kind(&self) -> Kind {
        Kind::Whole
    }

    fn count(&self) -> u64 {
        1
    }

    fn once(&self, _: u64, halt: &Halt) -> Result<Option<Vec<u8>>, String> {
        (self.0)(halt).map_err(|e| said(&e))
    }
}

/// A failure in a sentence or several.
pub(crate) fn said(failure: &Failure) -> String {
    match failure {
        Failure::Model(e) => e.to_string(),
        Failure::Records(errors) => errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "),
        Failure::Input(reasons) => reasons.join("; "),
        Failure::Numbers(reason) => reason.clone(),
        Failure::Strict => "the records have findings, and --strict refuses to go on".into(),
        Failure::Unwritten(file) => file.to_string(),
    }
}
