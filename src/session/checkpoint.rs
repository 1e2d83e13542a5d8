//! `--checkpoint`: the state of long work is kept, so that it can be interrupted.

use crate::failure::{Failure, OrFailure};
use crate::methods::given;
use crate::telling::remark;
use clap::Args;
use fdm_estimate::CheckpointStore;
use fdm_lab::job::Memory;
use fdm_results::store::{Checkpoint, Identity};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Where the state of long work is kept.
#[derive(Debug, Args)]
#[command(next_help_heading = "Interruption")]
pub struct Checkpoints {
    /// Keep a checkpoint in a folder: the same command resumes where it was interrupted, and ends with the same numbers
    #[arg(long, value_name = "DIR", hide_short_help = true)]
    checkpoint: Option<PathBuf>,
}

/// An open checkpoint, or none.
pub enum OpenCheckpoint {
    /// Nothing is kept.
    None,
    /// A folder.
    Folder(Watched),
    /// The results of tasks that were done elsewhere.
    Done(Arc<Memory>),
}

/// A checkpoint that says once when it can no longer be written.
pub struct Watched {
    checkpoint: Checkpoint,
    failed: AtomicBool,
}

impl Checkpoints {
    /// The options that were given.
    pub fn given(&self) -> Vec<&'static str> {
        given(&[("--checkpoint", self.checkpoint.is_some())])
    }

    /// The folder.
    pub fn folder(&self) -> Option<&Path> {
        self.checkpoint.as_deref()
    }

    /// Opens the folder before any work is done.
    pub(crate) fn open(&self, identity: &Identity, quiet: bool) -> Result<OpenCheckpoint, Failure> {
        self.checkpoint.as_deref().map_or(Ok(OpenCheckpoint::None), |folder| open(folder, identity, quiet))
    }

    /// Opens a folder in it: one of several that one command needs.
    ///
    /// # Errors
    /// [`Failure::Input`], for a folder that cannot be written, or that holds the state of other work.
    pub fn open_within(&self, name: &str, identity: &Identity, quiet: bool) -> Result<OpenCheckpoint, Failure> {
        let folder = self.checkpoint.as_ref().map(|folder| folder.join(name));
        folder.map_or(Ok(OpenCheckpoint::None), |folder| open(&folder, identity, quiet))
    }
}

fn open(folder: &Path, identity: &Identity, quiet: bool) -> Result<OpenCheckpoint, Failure> {
    let checkpoint = Checkpoint::open(folder, identity).or_failure()?;
    if checkpoint.resumed() && !quiet {
        remark(format_args!("note: resuming from the checkpoint in {}", folder.display()));
    }
    Ok(OpenCheckpoint::Folder(Watched { checkpoint, failed: AtomicBool::new(false) }))
}

impl OpenCheckpoint {
    /// What keeps the states, where something does.
    pub fn keeper(&self) -> Option<&dyn CheckpointStore> {
        match self {
            Self::None => None,
            Self::Folder(watched) => Some(watched),
            Self::Done(done) => Some(&**done),
        }
    }

    /// Whether the last state was kept; adds what was damaged and what could not be kept.
    pub fn close(self, said: &mut Vec<String>) -> bool {
        let Self::Folder(Watched { checkpoint, .. }) = self else { return true };
        said.extend(checkpoint.notes().iter().map(|n| format!("note: {n}")));
        let Some(failure) = checkpoint.failure() else { return true };
        said.push(format!(
            "warning: the checkpoint could not be written up to the end ({failure}); the result is complete, but the same \
             command would not resume from its end"
        ));
        false
    }
}

impl CheckpointStore for Watched {
    fn keep(&self, name: &str, state: &[u8]) -> Result<(), String> {
        let kept = self.checkpoint.keep(name, state);
        match &kept {
            Ok(()) => self.failed.store(false, Ordering::Relaxed),
            Err(failure) if !self.failed.swap(true, Ordering::Relaxed) => {
                remark(format_args!("warning: the checkpoint cannot be written ({failure}); the work goes on"));
            }
            Err(_) => {}
        }
        kept
    }

    fn find(&self, name: &str) -> Result<Option<Vec<u8>>, String> {
        self.checkpoint.find(name)
    }
}
