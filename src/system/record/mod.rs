//! Measured data: CSV files to [`Run`]s in the model's units, with errors that name file, line and column.
//!
//! Start at [`read()`]: `text` (bytes, cells) or `log` (other formats, maps) -> `layout` (which lines are what) -> `table` (columns) -> `shape` (tables that do
//! not stand as others do) -> `search` and `times` (which columns) -> `samples` -> [`Run`]. Samples in memory
//! become one by [`RunBuilder`].

mod assumed;
mod beginning;
mod builder;
mod channel;
mod clock;
mod column;
mod derived;
mod doses;
mod error;
pub mod even_grid;
mod grid;
mod heading;
mod holds;
#[cfg(test)]
mod kinds_tests;
mod known;
mod layout;
mod log;
mod missing;
mod note;
mod options;
mod pauses;
mod read;
mod run;
mod samples;
mod search;
mod shape;
mod table;
#[cfg(test)]
mod tests;
mod text;
mod times;
mod write;

pub use assumed::{AssumedChannel, AssumedNote, Assumptions};
pub use beginning::questioned;
pub use builder::{ColumnView, RunBuilder, RunError, RunFault};
pub use channel::{Channel, Channels, Role, channels, stated};
pub use clock::Question as ClockQuestion;
pub use derived::Incomplete;
pub use derived::bridge;
pub use error::Fault;
pub use error::{Names, Problem, RecordError};
// What stands in files before it is a record of a model: of the readers only this package knows.
pub use even_grid::Sampling;
pub use fdm_readers::{ChannelMap, Field, Log, RecordMap, Topic, frame, open_input};
pub use grid::{Delimiter, Dialect, Mark};
pub use holds::moves_at_samples;
pub use log::open_log;
pub use note::Note;
pub use options::{BelowLimit, Censored, Known, Mask as SampleMask, ReadOptions};
pub use read::{ChannelSource, Summary, read, read_each};
pub use run::Run;
pub use run::{Cursor, Place};
pub use write::{Column, write, write_to};
