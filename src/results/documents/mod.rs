//! The documents that are the results: what is written, printed by `--json`, and read back with types.
//!
//! **In** finished estimates, studies, diagnoses. **Out** one document for each kind of result, made by its constructor (`of`), written by
//! [`to_text`], read by [`from_text`]: what was read is written again to the same bytes. **Never** computes what an estimate does not say.
//! **Start** at [`FitDocument`], which all fits share; [`ResultDocument`] is what a result folder holds.
//!
//! Values that a room below already keeps in the form of a document ([`fdm_estimate::ParameterEstimate`], [`fdm_estimate::residuals::Whiteness`],
//! [`fdm_infer::LackOfFit`]) are part of a document as they are.

mod diagnosis;
mod digits;
mod doctor;
mod fit;
mod frequency;
mod json;
mod log;
mod model;
mod progress;
mod regression;
mod remarks;
mod result;
#[cfg(test)]
pub(crate) mod specimen;
#[cfg(test)]
mod tests;

pub mod calibration;
pub mod design;
pub mod profile;
pub mod reproduction;
pub mod requirement;
pub mod sample;
pub mod stages;
pub mod study;

pub use diagnosis::DiagnosisDocument;
pub use digits::{digits, digits_by_error, digits_of_end, fixed, p_value};
pub use doctor::{DoctorDocument, JudgedRecords};
pub use fit::{
    BandCoverage, Evaluations, FitDocument, Integration, Matrix, OutputDocument, StartDocument, Terminated, Validation,
};
pub use frequency::{
    BridgeDocument, FrequencyDomain, FrequencyResponses, MeasuredRegressorDocument, MultipleCoherence, Pair,
    ResponseNames, SpectraDocument, SpectraPair, TimeDomain, TrimValues, UnobservableModeDocument,
};
pub use json::{from_text, to_text};
pub use log::{FieldDocument, LogDocument, TopicDocument};
pub use model::{
    CatalogueDocument, ChannelDocument, Component, Derivatives, Diverged, EffectDocument, EffectsDocument,
    InputDocument, ModeDocument, ModelDocument, ModesDocument, OutputDeclared, ParamDocument, PlaceDocument,
    PriorDocument, QuantityDocument, ResponseDocument, SlotDocument, StateDocument, TrimDocument, trim_sentence,
};
pub use progress::{
    AtWork, CommandStatus, CourseDocument, CourseParameter, JobStatus, ProgressDocument, ProgressManifest, ShardAtWork,
    ShardStatus,
};
pub use regression::{
    Iterates, RecursiveDocument, RecursiveValue, RefusalDocument, RegressionDocument, SimulatedError, StructureDocument,
};
pub use remarks::{
    About, CORRELATED, OFFSET, RELIABLE, Remark, estimate_remarks, fit_remarks, limit_within_bounds, residual_remarks,
    smoothness, spectral_remarks, with_run,
};
pub use result::{KeptParameter, ResultDocument};
