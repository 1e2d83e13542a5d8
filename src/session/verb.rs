//! Verbs that work on a model and records, and how they are cut into tasks for many machines.

use crate::answer::Answer;
use crate::conduct::Conduct;
use crate::failure::{Failure, OrFailure};
use crate::halt::TimeLimit;
use crate::load::ModelFile;
use crate::progress_file::Course;
use crate::records::Records;
use crate::session::Session;
use fdm_estimate::{CheckpointStore, Halt};
use fdm_lab::job::{Kind, Tasks};
use fdm_results::store::Identity;

/// Sees the tasks of a verb, ready to be done, and what their bits depend on.
pub type Visit<'v> = &'v mut (dyn FnMut(&dyn Tasks, &Identity) -> Result<(), Failure> + 'v);

/// What every verb is given that works on a model and records.
pub struct Given<'o> {
    /// The model.
    pub model: &'o ModelFile,
    /// The records.
    pub records: &'o Records,
    /// How long it may work.
    pub limit: &'o TimeLimit,
}

/// The options of a verb that works on a model and records.
pub trait Verb: Sync {
    /// What every such verb is given.
    fn given(&self) -> Given<'_>;

    /// The model and the records that the options name.
    ///
    /// # Errors
    /// [`Failure`]
    fn session(&self, conduct: &Conduct) -> Result<Session, Failure>;

    /// Names of all files that its folder may hold; none of a verb without one.
    fn names(&self, _: &Session) -> Vec<String> {
        Vec::new()
    }

    /// What it works out.
    ///
    /// # Errors
    /// [`Failure`]
    fn answer(&self, session: &Session, conduct: &mut Conduct) -> Result<Answer, Failure>;

    /// Makes ready what its tasks have in common, and shows them; what they begin with is kept.
    ///
    /// # Errors
    /// [`Failure`]; of a verb that has no tasks in any case.
    fn tasks(&self, _: &Session, _: &Conduct, _: &dyn CheckpointStore, _: Visit<'_>) -> Result<(), Failure> {
        Err(Failure::input(["the command has no tasks"]))
    }
}

/// What a verb works out, here or as the one task that was done elsewhere.
///
/// # Errors
/// [`Failure`]
pub fn answered(verb: &dyn Verb, session: &Session, conduct: &mut Conduct) -> Result<Answer, Failure> {
    match conduct.done.as_deref().and_then(|done| Kind::whole(done)) {
        Some(whole) => postcard::from_bytes(&whole).or_failure(),
        None => verb.answer(session, conduct),
    }
}

/// Shows a verb as one task, with all that is wanted of its answer.
pub(crate) fn as_one_task(
    verb: &dyn Verb,
    session: &Session,
    conduct: &Conduct,
    identity: &Identity,
    visit: Visit<'_>,
) -> Result<(), Failure> {
    let wanted = conduct.wanted;
    let whole = |halt: &Halt| -> Bytes {
        let mut conduct = Conduct::hidden(halt.clone(), Course::default(), wanted);
        let answer = verb.answer(session, &mut conduct);
        if halt.goes_on() { postcard::to_allocvec(&answer?).or_failure().map(Some) } else { Ok(None) }
    };
    visit(&Whole(&whole), identity)
}

/// What one task works out; none where it was interrupted.
type Bytes = Result<Option<Vec<u8>>, Failure>;

/// A verb that is one task.
struct Whole<'c>(&'c (dyn Fn(&Halt) -> Bytes + Sync));

impl Tasks for Whole<'_> {
    fn kind(&self) -> Kind {
        Kind::Whole
    }

    fn count(&self) -> u64 {
        1
    }

    fn once(&self, _: u64, halt: &Halt) -> Result<Option<Vec<u8>>, String> {
        (self.0)(halt).map_err(|e| e.to_string())
    }
}
