//! Where something unknown enters: an input, the equation of a state, or a sensor.
//!
//! **In** a fitted model and its runs with residuals and sensitivities. **Out** a [`Localisation`]: evidence for a random
//! force at every place with the force's course; [`Leftover`]: whether residuals are noise; an [`Attribution`]: an
//! effect, a disturbance, an unknown cause, or nothing.
//! **Never** fits, and never a test on a noise that has swallowed what is looked for.
//! **Start** at [`localise`]; its road is `sheet` (cosine transform) -> `driven` (exact responses to forces) -> `hats` ->
//! `likelihood` (noise and force found together) -> `localise` -> `attribution`.

mod attribution;
mod driven;
mod hats;
mod leftover;
mod library;
mod likelihood;
mod localise;
mod place;
mod quadrature;
mod sheet;
mod signals;
mod spectra;
mod spectrum;
#[cfg(test)]
mod tests;

pub use attribution::{Attribution, Evidence, Explained, Verdict, attribute};
pub use leftover::{Coherence, Leftover, Partner, leftover};
pub use library::{Suggestion, SuggestionError, Suggestions, suggestions};
pub use localise::{Localisation, Ordinate, Site, localise, noise_alone};
pub use place::{ForceError, Kind, Passage, Place, places};
pub(in crate::diagnose) use quadrature::late;
pub use signals::Function;
pub use spectrum::SmoothSpectrum;
