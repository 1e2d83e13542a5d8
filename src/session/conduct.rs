//! How work is done: how it is watched and stopped, what is wanted of it, and what was done before.

use crate::answer::{Answer, Wanted};
use crate::checkpoint::{Checkpoints, OpenCheckpoint};
use crate::failure::Failure;
use crate::halt::TimeLimit;
use crate::progress::Progress;
use crate::progress_file::{Course, CourseWriter};
use crate::session::Session;
use fdm_estimate::Halt;
use fdm_lab::job::Memory;
use fdm_results::store::Identity;
use std::path::PathBuf;
use std::sync::Arc;

/// How work is done.
pub struct Conduct {
    /// Shows how far it is, and stops it.
    pub progress: Progress,
    /// What is wanted of its answer.
    pub wanted: Wanted,
    /// Whether nothing is told of it.
    pub quiet: bool,
    /// Folders beside which is written how far it is.
    pub beside: Vec<PathBuf>,
    /// What was done elsewhere, where this is the end of a job.
    pub done: Option<Arc<Memory>>,
}

impl Conduct {
    /// Work that is shown on the terminal unless it is to be `quiet`; an interrupt ends it after what is in hand.
    pub fn shown(quiet: bool, wanted: Wanted) -> Self {
        Self { progress: Progress::new(quiet), wanted, quiet, beside: Vec::new(), done: None }
    }

    /// Work that shows nothing, and ends when `halt` says so.
    pub fn hidden(halt: Halt, course: Course, wanted: Wanted) -> Self {
        let progress = Progress::hidden(halt, course);
        Self { progress, wanted, quiet: true, beside: Vec::new(), done: None }
    }

    /// Work that ends when the time is over, too.
    pub fn within(self, limit: &TimeLimit) -> Self {
        Self { progress: self.progress.within(limit), ..self }
    }

    /// For a part of the work that shows nothing, and ends with it.
    pub(crate) fn aside(&self) -> Progress {
        Progress::hidden(self.progress.halt().clone(), Course::default())
    }

    /// With what is said where the work was stopped, by the time or by an interrupt.
    pub(crate) fn ended(&self, answer: Answer) -> Answer {
        let mut answer = self.in_time(answer, "the result is the best so far");
        if self.progress.halt().is_interrupted() {
            answer.closing.push("interrupted: the result is the best so far".into());
            answer.good = false;
        }
        answer
    }

    /// With what is said where there was too little time: `late` is what that means for the result.
    pub(crate) fn in_time(&self, mut answer: Answer, late: &str) -> Answer {
        let late = self.progress.late(late);
        answer.good &= late.is_none();
        answer.closing.extend(late);
        answer
    }

    /// Closes the checkpoint, and says what could not be kept.
    pub(crate) fn kept(&self, mut answer: Answer, checkpoint: OpenCheckpoint) -> Answer {
        answer.good &= checkpoint.close(&mut answer.closing);
        answer
    }

    /// Opens the checkpoint, or what was done elsewhere in its place.
    pub(crate) fn checkpoint(&self, asked: &Checkpoints, identity: &Identity) -> Result<OpenCheckpoint, Failure> {
        match &self.done {
            Some(done) => Ok(OpenCheckpoint::Done(Arc::clone(done))),
            None => asked.open(identity, self.quiet),
        }
    }

    /// Writes down how far the work is, beside the places of its result and of its checkpoint, as long as the writer lives.
    pub(crate) fn follow(&mut self, session: &Session, checkpoints: Option<&Checkpoints>) -> CourseWriter {
        let checkpoint = checkpoints.and_then(Checkpoints::folder);
        let folders = self.beside.iter().cloned().chain(checkpoint.map(Into::into)).collect();
        self.progress.follow(folders, session)
    }
}
