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
mod comparison;
mod destination;
mod disk;
mod envelope;
mod faults;
mod file;
mod fingerprint;
mod generations;
mod identity;
mod input;
mod manifest;
mod program;
mod progress;
mod result_folder;
mod task_results;
mod temporary;
mod work_folder;

pub use checkpoint::{Checkpoint, CheckpointError};
pub use comparison::differences;
pub use destination::{Destination, DestinationError, manifest_text, own_files};
pub use disk::reason;
#[doc(hidden)]
pub use faults::fail_at;
pub use file::{admits, clock_of, end_of_links, make_folder, write_file, write_new_file};
pub use fingerprint::fingerprint;
pub use identity::{Difference, Identity};
pub use input::{MOST_BYTES, read_input, read_input_text};
pub use manifest::{DataFile, KeptFile, Manifest};
pub use program::program_fingerprint;
pub use progress::ProgressFile;
pub use result_folder::{Contents, ResultError, ResultFolder, whole_files};
pub use task_results::{Gathered, Provenance, TaskError, TaskKey, TaskResults};
pub use work_folder::WorkFolder;
