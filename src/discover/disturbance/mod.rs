//! Where something unknown enters: an input, the equation of a state, or a sensor.
//!
//! **In** a fitted model and its runs with residuals and sensitivities. **Out** a [`Localisation`]: evidence for a disturbance
//! (process noise) at every place, with its course; [`Nonlinearities`]: the same for an unmodelled function of states and inputs that
//! is alike in all runs; [`ResidualAnalysis`]: whether residuals follow the inputs; an [`Attribution`]: an effect, a disturbance, an
//! unknown cause, or nothing, and the places that speak for it. **Never** fits, and never tests against a noise that has absorbed
//! what is looked for. **Start** at [`residual_evidence`]. Its order is `binned_run` (cosine transform) -> `null_model` (noise alone,
//! correlated between outputs) -> `forced_response` (exact responses to disturbances) -> `likelihood` (noise and disturbance together)
//! -> `localisation`, beside it `nonlinearity` and `residual_analysis` -> `attribution`.

mod attribution;
mod binned_run;
mod forced_response;
mod likelihood;
mod localisation;
mod nonlinearity;
mod null_model;
mod place;
mod residual_analysis;
mod suggestions;
#[cfg(test)]
mod tests;

pub use attribution::{Attribution, NonlinearityCurve, Origin};
pub(crate) use attribution::{Explained, ResidualEvidence, attribute, residual_evidence};
pub use localisation::{Localisation, Ordinate, Site};
pub use nonlinearity::{Curve, CurvePoint};
pub(crate) use forced_response::ForcedResponse;
pub(crate) use place::{BELIEVED, FittedRun, places};
pub use place::{Place, PlaceEvidence, PlaceKind};
pub(crate) use suggestions::suggestions;
pub use suggestions::{Suggestion, Suggestions};
