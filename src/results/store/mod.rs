//! What outlives the program: crash-safe files, checkpoints of long fits, folders with results.
//!
//! **In** bytes under names, finished results, the identity of a fit. **Out** [`write_file`], by which every file of the program
//! appears whole or not at all; [`Checkpoint`], which keeps the state of an
//! estimation so that it is found again whenever the program ended; [`ResultFolder`], a result that is there whole or not
//! at all and that says when something in it was changed; [`ProgressFile`], the report of work that goes on;
//! [`TaskResults`], to which many machines add at once. **Never** computes, prints, or overwrites what is not its own.
//! **Start** at [`Checkpoint::open`] and [`ResultFolder::open`]; `disk` (the few operations) -> `file` (one file)
//! and `destination` (a folder); `disk` -> `envelope` (header and checksum) -> `generations` (the newest valid one) -> `checkpoint`.

mod checkpoint;
mod destination;
mod disk;
mod faults;
mod file;
mod generations;
mod identity;
mod manifest;
mod result_folder;
mod task_results;
mod temporary;

pub use checkpoint::{Checkpoint, CheckpointError};
pub use destination::{Destination, DestinationError, manifest_text, own_files};
pub use disk::reason;
#[doc(hidden)]
pub use faults::fail_at;
pub use file::{
    MOST_BYTES, admits, clock_of, end_of_links, make_folder, read_input, read_input_text, write_file, write_new_file,
};
pub use identity::{Difference, Identity, differences, fingerprint, program_fingerprint};
pub use manifest::{DataFile, KeptFile, Manifest};
pub use result_folder::{Contents, ResultError, ResultFolder, whole_files};
pub use task_results::{Gathered, ProgressFile, Provenance, TaskError, TaskKey, TaskResults};
pub use temporary::WorkFolder;
