//! The filter-error method: maximum likelihood with a Kalman filter, for vehicles in turbulence and unstable ones.
//!
//! **In** a model whose equations carry noise (`noise der(x) = q;`) and its runs. **Out** a [`FilterFit`]: parameters, intensities and
//! measurement noise with their errors, one-step predictions and innovations. **Never** takes steps by itself or reads files.
//! **Start** at [`fit_filter()`]: `jacobians` (as outputs of a model, with their derivatives along the way) -> `kalman` (one run, the
//! likelihood and its gradient) -> `likelihood` (all runs) -> `scoring` (the minimum) -> `fit`.

mod fit;
mod jacobians;
mod kalman;
mod likelihood;
mod scoring;
#[cfg(test)]
mod tests;

pub use fit::{FilterError, FilterFit, fit_filter};
