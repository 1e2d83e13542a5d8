//! Documents for tests of folders and comparisons.

use super::fit::FitDocument;
use super::json::from_text;
use fdm_estimate::{ParameterEstimate, Status};

/// A parameter that was estimated.
pub(crate) fn parameter(name: &str, run: Option<&str>, value: f64, errors: Option<[f64; 2]>) -> ParameterEstimate {
    ParameterEstimate {
        name: name.into(),
        run: run.map(str::to_string),
        value,
        standard_error: errors.map(|e| e[0]),
        corrected_error: errors.map(|e| e[1]),
        degrees_of_freedom: None,
        unit: None,
        status: Status::Estimated,
        start: None,
        lower: None,
        upper: None,
        limit: None,
        logarithmic: false,
    }
}

/// A fit of 100 samples that converged.
pub(crate) fn fit(parameters: Vec<ParameterEstimate>) -> FitDocument {
    const TEXT: &str = r#"{"model": "m", "parameters": [], "cost": null, "termination": "converged", "message": "converged", "iterations": 3,
        "outputs": [{"name": "y", "run": "one", "unit": null, "rms": 1.0, "mean": null, "r2": null, "tic": 0.1, "tic_parts": null, "compared": 100}],
        "iteration_fallbacks": [], "evaluations": {"with_sensitivities": 4, "without": 0}, "bias_corrections": [], "undetermined": [],
        "determined_by_prior": [], "covariance": {"parameters": [], "values": []}, "correlations": {"parameters": [], "values": []},
        "corrected_covariance": {"parameters": [], "values": []}, "noise_colour": [], "uncorrected": null, "noise_covariance": null,
        "condition": null, "history": [], "remarks": []}"#;
    FitDocument { parameters, ..from_text(TEXT).unwrap() }
}
