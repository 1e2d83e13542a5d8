//! Frequency responses measured in sweeps, and the model that matches their decibels and degrees (Tischler and Remple, Aircraft and Rotorcraft
//! System Identification, 2012): the way of CIFER.
//!
//! **In** a model, runs, [`ResponseOptions`]. **Out** a [`ResponseFit`]: estimates, the measured and modelled responses of all pairs, what each
//! costs. **Start** at [`fit_responses()`]: `measured` (responses with coherence, which pairs and frequencies count) -> `decibels` (the model's, with
//! derivatives, as a [`Response`](super::Response)) -> the estimation -> `fit`.

mod decibels;
mod fit;
mod measured;
mod options;
#[cfg(test)]
mod tests;

pub use fit::{PairFit, ResponseFit, Sensitivity, fit_responses};
pub use measured::responses_of_fit;
pub use options::{ResponseError, ResponseOptions};
