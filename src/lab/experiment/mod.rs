//! Experiments: how records of a system are made, what is fitted to them, and what must come out.
//!
//! **In** a folder with models and a description of an experiment (`experiment.toml`). **Out** [`Outcome`]: every figure that was expected beside
//! the one that came out; records as tables. **Never** a number that is not made here or read from a record, and never prints.
//! **Start** at [`reproduce`]; its road is `catalogue` (which experiments there are) -> `description` (the file) -> `flight` (records made by a
//! model: `signal`, `noise`, `closed_loop`) -> `table` (columns, and runs from them) -> `stage` (a step of the evaluation: `method`) ->
//! `verdict` (what was expected of it). [`Rehearsal`] goes it again and again with other noise.

mod amount;
mod catalogue;
mod closed_loop;
mod description;
mod evaluation;
mod experiment_error;
mod flight;
mod method;
mod rehearsal;
mod setting;
mod signal;
#[cfg(test)]
mod tests;
mod verdict;

pub use amount::{Amount, Tolerance};
pub use catalogue::{Catalogue, UnknownName};
pub use description::{Answer, Expected, Experiment, Record, Says, Segments, Stage, Task};
pub use evaluation::{reproduce, tables};
pub use experiment_error::{ExperimentError, Fault};
pub use fdm_results::documents::reproduction::{Check, Outcome};
pub use flight::Table;
pub use rehearsal::{MeasuredStage, Rehearsal, StageAnswer, measured_stages};
pub use signal::{Colour, Law, Noise, Of, Phases, Signal};
