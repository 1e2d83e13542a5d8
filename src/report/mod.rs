//! What people read: findings about models, tables of estimates, pictures of time histories.
//!
//! **In** finished values: sources and diagnostics, fits, time histories. **Out** text: lines, tables, JSON, SVG.
//! **Never** computes, and never prints: the command line does. **Start** at [`render`] and [`fit_table`].

mod comparison;
mod confidence;
mod design;
mod diagnosis_json;
mod diagnosis_table;
mod diagnostic;
mod filter;
mod fitted_responses;
mod history;
mod json;
mod modes;
mod outcomes;
mod overlay;
mod parameters;
mod plot;
mod profile;
mod recursive;
mod regression;
mod remarks;
mod residuals;
mod response;
mod spectral;
mod stages;
mod starts;
mod study;
mod summary;
mod table;
mod validation;

pub use comparison::{comparison_json, comparison_table};
pub use confidence::{confidence, way};
pub use design::{design_json, design_table};
pub use diagnosis_json::diagnosis_json;
pub use diagnosis_table::diagnosis_text;
pub use diagnostic::render;
pub use filter::{filter_json, filter_table};
pub use fitted_responses::{fitted_response_columns, fitted_response_json, fitted_response_table};
pub use history::history_table;
pub use json::{fit_json, quality_json, starts_json};
pub use modes::{modes_json, modes_table, trim_sentence};
pub use outcomes::{outcome_table, outcomes_json, outcomes_markdown, outcomes_table};
pub use overlay::{overlays, sparkline};
pub use plot::{PlotError, TimeHistory, svg};
pub use profile::{profile_json, profile_svg, profile_table};
pub use recursive::{recursive_histories, recursive_json, recursive_table, recursive_times};
pub use regression::{dependence_table, regression_json, regression_table, structure_table};
pub use remarks::{About, Remark, residual_remarks};
pub use residuals::residual_table;
pub use response::{ResponseNames, response_json, response_svg, response_table};
pub use spectral::{hidden_mode, prediction_table, spectral_json, spectral_table, spectrum_columns, time_json};
pub use stages::{Shown, Stage, dot, stage};
pub use starts::starts_table;
pub use study::{repeat_columns, studies_json, studies_markdown, studies_text, study_json, study_table};
pub use summary::{check_json, check_text};
pub(crate) use table::digits;
pub use table::{estimate_table, fit_table};
pub use validation::{validation_by_frequency, validation_by_time, validation_table};
