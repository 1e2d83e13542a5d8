//! What the next run would tell: which input, moved how, determines what the runs so far do not.
//!
//! **In** a model with its parameters' values, runs that were made, how far inputs may move. **Out** [`Design`]: what is known now, every
//! manoeuvre with the errors that it would leave, the best ones one after the other. **Never** fits, and never believes that the values
//! are exact: what is promised is Fisher's information at them. **Start** at [`design`]; `manoeuvre` (which there are, and
//! one of them as a run) -> `plan` (what they tell, and the best one after the other); [`experiments`] plans levels and sampling times.

mod between;
mod experiments;
mod plan;

pub use between::{Rivals, between};
pub use experiments::{Course, DesignSpace, Factor, Place, experiments, sheet};
pub use fdm_results::documents::design::{
    Design, Distinction, Experiment, Experiments, Gain, Level, Manoeuvre, Outlook, Separation, Step,
};
pub use plan::{Asked, Question, design, table};

#[cfg(test)]
mod tests;
