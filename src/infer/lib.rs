//! What is wrong with a model, decided by one number: the log evidence of a written model on all its runs, plus its log prior odds.
//!
//! **In** a model with its text, measured runs, a catalogue of effects ([`fdm_effects::Catalogue`]). **Out** a [`Diagnosis`]: every kind of
//! explanation with its probability, the effects that explain the runs and what could stand in their place, where an unknown disturbance or law
//! enters, the extended text. Evidence is in nats, values are in the model's units. **Never** reads or writes files, or prints.
//!
//! **Start** at [`diagnose`]. `candidates` puts an effect into a text and finds what it adds to the responses; `evidence` is the number, of a
//! linearised model from products of its columns in bands of frequency; `search` goes from set to set, and weighs named causes, disturbances,
//! laws and nothing against each other. `lack_of_fit` describes residuals by frequency, time, amplitude, gain and phase.

mod bins;
mod candidates;
mod diagnosis;
mod evidence;
mod faults;
mod lack_of_fit;
mod search;

pub use candidates::{DiagnosisError, DiagnosisOptions, Domain, Place, PlaceKind};
pub use diagnosis::{
    Alternative, Biased, Cause, CorrelatedInput, Diagnosis, EffectAt, Explanation, Feedback, FrequencyDomain,
    FrontModel, FrontOutput, LeftOut, MendedOutput, MendedRecords, NewValue, OutputGain, Overlay, SearchStep, Tried,
    UnnamedCause, Verdict,
};
pub use faults::{BesideOptions, Examination, Weighed, examine_beside, first_cause};
pub use lack_of_fit::{AmplitudeBin, Band, Gain, LackOfFit, RunResidual, Window, lack_of_fit};
pub use search::diagnose;
