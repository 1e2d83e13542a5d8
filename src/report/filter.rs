//! What a Kalman filter's estimates say: parameters and intensities, measurement noise, innovations.

use super::estimate::{Detail, fit_table, parameter_table};
use fdm_estimate::FilterFit;

/// Parameters with standard errors, the measurement noise, the quality of the predictions, and what should not be overlooked.
pub fn filter_table(found: &FilterFit, detail: Detail) -> String {
    let mut text = fit_table(&found.fit, detail);
    if !found.fit.quality.is_empty() {
        text.push_str("\nresiduals are innovations: measured minus predicted from the sample before");
    }
    if !found.deviations.is_empty() && !found.fit.quality.is_empty() {
        text.push_str(&format!("\n\n{}", parameter_table(&found.deviations, detail.intervals).trim_end()));
    }
    for name in &found.not_identifiable {
        text.push_str(&format!("\n`{name}` stands at 0: the records show no noise there"));
    }
    text
}
