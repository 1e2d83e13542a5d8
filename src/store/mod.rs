//! What outlives the program: crash-safe files, checkpoints of long fits, folders with results.
//!
//! **In** bytes under names, finished results, the identity of a fit. **Out** [`Checkpoint`], which keeps the state of an
//! estimation so that it is found again whenever the program ended; [`ResultFolder`], a result that is there whole or not
//! at all and that tells when something in it was changed. **Never** computes, prints, or overwrites what is not its own.
//! **Start** at [`Checkpoint::open`] and [`ResultFolder::open`]; `disk` (the few operations) -> `envelope` (header and
//! checksum) -> `generations` (the newest valid one) -> `checkpoint`.

mod checkpoint;
mod disk;
mod envelope;
#[cfg(test)]
mod faults;
mod fingerprint;
mod generations;
mod identity;

pub use checkpoint::{Checkpoint, CheckpointError};
pub use fingerprint::fingerprint;
pub use identity::{Difference, Identity};
