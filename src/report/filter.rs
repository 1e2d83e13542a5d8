//! What a Kalman filter's estimates say: parameters and intensities, measurement noise, innovations.

use super::json::fit_json;
use super::parameters::parameter_table;
use super::table::fit_table;
use crate::estimate::FilterFit;
use serde_json::{Value, json};

/// Parameters with standard errors, the measurement noise, the quality of the predictions, and what should not be overlooked.
pub fn filter_table(found: &FilterFit, intervals: bool) -> String {
    let mut text = fit_table(&found.fit, intervals);
    if !found.fit.quality.is_empty() {
        text.push_str("\nresiduals are innovations: measured minus predicted from the sample before");
    }
    if !found.deviations.is_empty() && !found.fit.quality.is_empty() {
        text.push_str(&format!("\n\n{}", parameter_table(&found.deviations, intervals).trim_end()));
    }
    for name in &found.silent {
        text.push_str(&format!("\n`{name}` stands at 0: the records show no noise there"));
    }
    text
}

/// The same for programs: as [`fit_json`], with the deviations of the measurement noise and the intensities that are not noticed.
pub fn filter_json(found: &FilterFit) -> Value {
    let mut document = fit_json(&found.fit);
    document["method"] = "filter error".into();
    document["deviations"] = json!(found.deviations);
    document["silent"] = json!(found.silent);
    document
}
