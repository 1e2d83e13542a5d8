//! What people read: findings about models, tables of estimates, pictures of time histories.
//!
//! **In** finished values: sources and diagnostics, documents of results, time histories. **Out** text: lines, tables, SVG, PNG, pages.
//! **Never** simulates, fits or prints: the command line does. Only the stages of `fdm show` are made here: [`stage`]
//! parses, differentiates and linearises the model that it shows. **Start** at `section`, which says what reports are made of; `text` and
//! `html` print it, and every topic (parameters, residuals, modes, a study, a diagnosis, ...) is one file with its thresholds and sentences.

mod calibration;
mod comparison;
mod confidence;
mod convergence;
mod correlations;
mod design;
mod diagnosis;
mod diagnostic;
mod doctor;
mod equations;
mod fit;
mod fitted_responses;
mod histories;
mod html;
mod job;
mod log;
mod margins;
mod modes;
mod outcomes;
mod overlay;
mod parameters;
mod plot;
mod profile;
mod progress;
mod recursive;
mod regions;
mod regression;
mod remarks;
mod reproduction;
mod residuals;
mod response;
mod sample;
mod section;
mod shapes;
mod spectral;
mod stages;
mod starts;
mod study;
mod summary;
mod surfaces;
mod text;
mod validation;
mod verification;
mod visible;
mod words;
mod wrap;

pub use calibration::calibration_text;
pub use comparison::comparison_table;
pub use confidence::confidence;
pub use convergence::history_table;
pub use design::{Drawn, Planned, design_table, distinction_table, experiments_table};
pub use diagnosis::diagnosis_text;
pub use diagnostic::render;
pub use doctor::doctor_text;
pub use fit::{Detail, estimate_table, estimate_text, fit_table, way};
pub use fitted_responses::{fitted_response_columns, fitted_response_table};
pub use job::job_text;
pub use log::{log_fields, log_table};
pub use margins::margins_text;
pub use modes::modes_table;
pub use outcomes::{outcome_table, outcomes_markdown, outcomes_table};
pub use overlay::{overlays, sparkline};
pub use plot::{TimeHistory, svg};
pub use profile::{profile_svg, profile_table};
pub use recursive::{recursive_histories, recursive_table, recursive_times};
pub use regression::{dependence_table, regression_table, structure_table};
pub use residuals::prediction_table;
pub use response::{response_svg, response_table};
pub use sample::sample_text;
pub use spectral::{hidden_mode, spectral_table, spectrum_columns};
pub use stages::{Shown, Stage, dot, stage};
pub use starts::{starts_hint, starts_table};
pub use study::{repeat_columns, studies_markdown, studies_text, study_table};
pub use summary::check_text;
pub mod page;
pub use page::fit_verdict;
pub use validation::{band_verdict, baseline_table, validation_text};
pub use verification::verification_table;
pub use visible::visible;
pub use words::Words;
pub use wrap::wrapped;
