//! What an estimated model is used for: requirements on its modes, its frequency responses, its responses to standard inputs, each with its interval and
//! the probability that it holds.
//!
//! **In** a model at its estimates, their covariance, and the requirements of its text. **Out** an [`Assessment`] of each. **Never** estimates anything.
//! **Start** at [`assess`]: [`Plan`] prepares what is measured, [`Bench`] measures it with exact derivatives (`linear`: modes and frequency responses;
//! `standard` and `course`: responses over time), `assess` makes intervals of it, by the delta method and by draws; `found` takes
//! what is known of the parameters from a result, and judges the repeats of a study.

mod assess;
mod bench;
mod linear;
mod measured;
mod standard;
#[cfg(test)]
mod tests;

pub use assess::{Draws, Judge, Known, assess, assess_result, freedom, with_estimates};
pub use bench::{Bench, Plan};
pub use fdm_results::documents::requirement::{Assessment, By, Part};
pub use measured::{Measured, RequirementError};
