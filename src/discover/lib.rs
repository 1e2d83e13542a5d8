//! What a fitted model lacks: how large its lack of fit is, which effect of a catalogue explains it, and what the effect gains.
//!
//! **In** a model with its text, measured runs, a catalogue of effects ([`fdm_effects::Catalogue`]). **Out** a [`Diagnosis`]:
//! the lack of fit of every output, the effects that explain it (or the groups of effects that these data cannot tell apart), where
//! an unknown disturbance enters, the extended text, and its gain on validation runs. Values are in the model's units, frequencies in
//! cycles per unit of time, gains in log-likelihood. **Never** reads or writes files, prints, or judges a model by a noise that was
//! estimated for that model alone.
//!
//! **Start** at [`diagnose`]. It goes through the modules in this order: `bins` (cosine transform of residuals and sensitivities),
//! `noise` (spectrum of each output), `screening` (score tests of all candidates, family-wise p-values), `selection` (forward
//! selection of effects that are fitted jointly with the model, backward elimination), `disturbance` (process noise and unmodelled
//! nonlinearities, residual analysis), `lack_of_fit` (description by frequency, time, amplitude, gain and phase).

mod bins;
mod diagnosis;
mod disturbance;
mod lack_of_fit;
mod noise;
pub mod screening;
mod selection;

pub use diagnosis::{
    Alternative, Biased, Cause, CoefficientTable, CorrelatedInput, Detectable, Diagnosis, EffectAt, Feedback,
    FrequencyDomain, FrontModel, FrontOutput, LeftOut, NewValue, OutputGain, Overlay, Rejected, RunGain, Screened,
    SelectionStep, Verdict,
};
pub use disturbance::{
    Attribution, Curve, CurvePoint, Localisation, NonlinearityCurve, Ordinate, Origin, Place, PlaceEvidence, PlaceKind,
    Site, Suggestion, Suggestions,
};
pub use lack_of_fit::{AmplitudeBin, Band, Gain, LackOfFit, RunResidual, Window, lack_of_fit};
pub use selection::{DiagnosisError, DiagnosisOptions, Domain, diagnose};
