//! Measured data: reading files into runs.
//!
//! **In** CSV files, the channels that a model asks for. **Out** [`Run`]s in the model's units, the drive between
//! their samples; errors that name file, line and column. **Never** simulates or judges the model.
//! **Start** at [`read()`]: `text` (bytes) -> `dialect` -> `table` -> `search` (which columns) -> `samples` -> [`Run`].

mod bridge;
mod cell;
mod channel;
mod computed;
mod dialect;
mod error;
pub(crate) mod even_grid;
mod fault;
mod input;
mod measured;
mod read;
mod run;
mod samples;
mod search;
mod slope;
mod summary;
mod table;
mod text;
mod write;

pub(crate) use bridge::bridge;
pub use channel::{Channel, Channels, Role, channels};
pub use dialect::{Delimiter, Dialect, Mark};
pub use error::{Names, Problem, RecordError};
pub use fault::Fault;
pub use input::{Cursor, Place};
pub use measured::Incomplete;
pub use read::{ReadOptions, read};
pub use run::Run;
pub use summary::{ChannelSource, Note, Sampling, Summary};
pub use write::{Column, write, write_to};

#[cfg(test)]
mod tests;
