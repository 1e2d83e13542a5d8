//! Frequency responses measured in sweeps, and the model that matches their decibels and degrees (Tischler and Remple, Aircraft and Rotorcraft
//! System Identification): the road that CIFER's users know.
//!
//! **In** a model, runs, [`ResponseOptions`]. **Out** a [`ResponseFit`]: estimates, the measured and modelled responses of all pairs, what each
//! costs. **Never** fits spectra or samples: its neighbours do. **Start** at [`fit_responses()`]:
//!
//! `measured` (responses with coherence, which pairs and frequencies count) -> `decibels` (the model's, with derivatives, as a
//! [`Response`](super::Response)) -> `estimate` -> `figures` (costs, bounds of Cramer and Rao) -> `fit`.

mod correlation;
mod decibels;
mod fault;
mod figures;
mod fit;
mod measured;
mod options;
#[cfg(test)]
mod tests;

pub use fault::ResponseError;
pub use figures::Sensitivity;
pub use fit::{PairFit, ResponseFit, fit_responses};
pub use options::ResponseOptions;
