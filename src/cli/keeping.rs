//! Keeping the state of a long fit, so that it can be interrupted.

use crate::failure::{Failure, remark};
use clap::Args;
use fdm::estimate::Keeper;
use fdm::store::{Checkpoint, Identity};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Where the state of a fit is kept.
#[derive(Debug, Args)]
#[command(next_help_heading = "Interruption")]
pub(crate) struct Keeping {
    /// Keep the state in a folder while working: the same command goes on where it was interrupted, and ends with the same
    /// numbers
    #[arg(long, value_name = "DIR")]
    checkpoint: Option<PathBuf>,
}

/// The open folder, or none.
pub(crate) struct Kept(Option<Told>);

/// Tells once when the state can no longer be kept.
struct Told {
    checkpoint: Checkpoint,
    failed: AtomicBool,
}

impl Keeping {
    /// Whether a folder was named.
    pub(crate) fn is_asked(&self) -> bool {
        self.checkpoint.is_some()
    }

    /// The folder.
    pub(crate) fn folder(&self) -> Option<&Path> {
        self.checkpoint.as_deref()
    }

    /// Opens the folder before any work is done.
    pub(crate) fn open(&self, identity: &Identity, quiet: bool) -> Result<Kept, Failure> {
        self.checkpoint.as_deref().map_or(Ok(Kept(None)), |folder| open(folder, identity, quiet))
    }

    /// Opens a folder in it: one of several that one command needs.
    pub(crate) fn open_within(&self, name: &str, identity: &Identity, quiet: bool) -> Result<Kept, Failure> {
        let folder = self.checkpoint.as_ref().map(|folder| folder.join(name));
        folder.map_or(Ok(Kept(None)), |folder| open(&folder, identity, quiet))
    }
}

fn open(folder: &Path, identity: &Identity, quiet: bool) -> Result<Kept, Failure> {
    let checkpoint = Checkpoint::open(folder, identity).map_err(|e| Failure::input([e]))?;
    if checkpoint.resumed() && !quiet {
        remark(format_args!("note: going on from the checkpoint in {}", folder.display()));
    }
    Ok(Kept(Some(Told { checkpoint, failed: AtomicBool::new(false) })))
}

impl Kept {
    pub(crate) fn keeper(&self) -> Option<&dyn Keeper> {
        self.0.as_ref().map(|k| k as &dyn Keeper)
    }

    /// Says at the end what was damaged and what could not be kept; whether the last state was kept.
    pub(crate) fn close(self) -> bool {
        let Some(Told { checkpoint, .. }) = self.0 else { return true };
        checkpoint.notes().iter().for_each(|n| remark(format_args!("note: {n}")));
        let Some(failure) = checkpoint.failure() else { return true };
        remark(format_args!(
            "warning: the checkpoint stopped before the fit ended ({failure}); nothing of the result is lost, but a \
             repetition would not go on from its end"
        ));
        false
    }
}

impl Keeper for Told {
    fn keep(&self, name: &str, state: &[u8]) -> Result<(), String> {
        let kept = self.checkpoint.keep(name, state);
        match &kept {
            Ok(()) => self.failed.store(false, Ordering::Relaxed),
            Err(failure) if !self.failed.swap(true, Ordering::Relaxed) => {
                remark(format_args!("warning: the checkpoint cannot be kept at present ({failure}); the fit goes on"));
            }
            Err(_) => {}
        }
        kept
    }

    fn find(&self, name: &str) -> Result<Option<Vec<u8>>, String> {
        self.checkpoint.find(name)
    }
}
