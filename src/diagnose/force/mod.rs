//! Where something unknown enters: an input, the equation of a state, or a sensor.
//!
//! **In** a fitted model and its runs with residuals and sensitivities. **Out** a [`Localisation`]: evidence for a random
//! force at every place with the force's course; [`Laws`]: the same for a force that is one function of states and inputs in all
//! runs; [`Leftover`]: whether residuals follow the inputs; an [`Attribution`]: an effect, a disturbance, an unknown cause, or
//! nothing, and the places that speak for it.
//! **Never** fits, and never a test on a noise that has swallowed what is looked for.
//! **Start** at [`heard()`]; its road is `sheet` (cosine transform) -> `ground` (noise alone; `mixing` where outputs share it) ->
//! `driven` (exact responses to forces) -> `hats` -> `likelihood` (noise and force found together) -> `localise`, beside it
//! `law` and `leftover` -> `attribution`.

mod attribution;
mod bands;
mod coherence;
mod driven;
mod ground;
mod hats;
mod heard;
mod law;
mod leftover;
mod library;
mod likelihood;
mod localise;
mod mixing;
mod modes;
mod place;
mod quadrature;
mod sheet;
mod signals;
mod spectra;
mod spectrum;
mod standing;
#[cfg(test)]
mod tests;

pub use attribution::{Attribution, Explained, Verdict, attribute};
pub use coherence::{Coherence, Partner};
pub use heard::{Heard, heard};
pub use law::{Law, Laws};
pub use leftover::Leftover;
pub use library::{Suggestion, SuggestionError, Suggestions, suggestions};
pub use localise::{Localisation, Ordinate, Site};
pub use place::{ForceError, Kind, Passage, Place, places};
pub(in crate::diagnose) use quadrature::late;
pub use signals::Function;
pub use spectrum::SmoothSpectrum;
pub use standing::Standing;
