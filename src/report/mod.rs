//! What people read: findings about models, tables of estimates, pictures of time histories.
//!
//! **In** finished values: sources and diagnostics, fits, time histories. **Out** text: lines, tables, JSON, SVG.
//! **Never** computes, and never prints: the command line does. **Start** at [`render`] and [`estimate_table`].

mod confidence;
mod diagnostic;
mod json;
mod plot;
mod starts;
mod summary;
mod table;
mod validation;

pub use confidence::{confidence, way};
pub use diagnostic::render;
pub use json::fit_json;
pub use plot::{PlotError, TimeHistory, svg};
pub use starts::starts_table;
pub use summary::{check_json, check_text};
pub use table::estimate_table;
pub use validation::{quality_json, validation_table};
