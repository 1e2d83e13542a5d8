//! The Bo 105 of Marchand and Fu (1985), figure 2: four runs of 30 s, one control each, that end in motion.

use super::{fitted, flown, model, noisy, three_two_one_one, up_to};
use fdm::Model;
use fdm::estimate::{Nonlinear, SpectralFit, SpectralOptions};
use fdm::frequency::EndTerms;
use fdm::record::Run;

/// Transformed samples of a run, and their distance.
const SAMPLES: usize = 750;
const DT: f64 = 0.04;
/// The first eleven frequencies, in Hz.
const HIGHEST: f64 = 11.4 / (SAMPLES as f64 * DT);

/// Standard deviations of measured outputs: ax, ay, az, u, v, w, p, q, r, phi, theta.
const NOISE: [f64; 11] = [0.02, 0.02, 0.02, 0.05, 0.05, 0.05, 0.002, 0.002, 0.002, 0.001, 0.001];

pub fn bo105() -> Model {
    model("bo105/model.fdm")
}

/// One run for each control, without noise.
pub fn runs(model: &Model) -> Vec<Run> {
    let heights = [("collective", 0.05), ("longitudinal", 0.03), ("lateral", 0.03), ("tail rotor", 0.06)];
    let one = |(k, (name, height)): (usize, &(&str, f64))| {
        let control = move |t: f64| {
            let mut controls = vec![0.0; 4];
            controls[k] = three_two_one_one(t, 2.0, *height, 1.0) + three_two_one_one(t, 24.0, -height, 1.0);
            controls
        };
        flown(model, name, SAMPLES + 2, DT, control)
    };
    heights.iter().enumerate().map(one).collect()
}

pub fn with_noise(runs: &[Run], part: f64, seed: u64) -> Vec<Run> {
    runs.iter().map(|run| noisy(run, &NOISE.map(|n| part * n), seed)).collect()
}

pub fn fit(model: &Model, runs: &[Run], ends: EndTerms) -> SpectralFit {
    let options = SpectralOptions { nonlinear: Nonlinear::MeasuredRegressors, ..up_to(HIGHEST, ends) };
    fitted(model, runs, &options)
}
