//! What outlives the program: crash-safe files, checkpoints of long fits, folders with results.
//!
//! **In** bytes under names, finished results, the identity of a fit. **Out** [`Checkpoint`], which keeps the state of an
//! estimation so that it is found again whenever the program ended; [`ResultFolder`], a result that is there whole or not
//! at all and that tells when something in it was changed; [`ProgressFile`], what is told of work that goes on. **Never** computes, prints, or overwrites what is not its own.
//! **Start** at [`Checkpoint::open`] and [`ResultFolder::open`]; `disk` (the few operations) -> `envelope` (header and
//! checksum) -> `generations` (the newest valid one) -> `checkpoint`.

mod checkpoint;
mod comparison;
mod destination;
mod disk;
mod envelope;
#[cfg(test)]
mod faults;
mod fingerprint;
mod generations;
mod identity;
mod manifest;
mod progress;
mod result_folder;

pub use checkpoint::{Checkpoint, CheckpointError};
pub use comparison::differences;
pub use destination::{Destination, DestinationError};
pub use disk::reason;
pub use fingerprint::fingerprint;
pub use identity::{Difference, Identity};
pub use manifest::{DataFile, KeptFile, Manifest};
pub use progress::ProgressFile;
pub use result_folder::{Contents, ResultError, ResultFolder, whole_files};
