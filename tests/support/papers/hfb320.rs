//! The in-flight simulator HFB 320 of Marchand and Fu (1985): a pitch model of low order with a delay.

use super::{flown, model, multisine, noisy, sizes, three_two_one_one, up_to};
use fdm::Model;
use fdm::estimate::SpectralOptions;
use fdm::frequency::EndTerms;
use fdm::record::Run;

const DT: f64 = 0.02;
/// What inputs move, in Hz.
pub const HIGHEST: f64 = 2.0;

pub fn hfb320() -> Model {
    model("hfb320/model.fdm")
}

/// A 3211 and a multisine, 60 s from trim, that ends at rest or in motion.
fn stick(t: f64, rest: bool, shift: f64) -> f64 {
    let sines = if t >= 12.0 && (!rest || t < 52.0) { multisine(t - 12.0, 0.05, 40, shift) } else { 0.0 };
    three_two_one_one(t, 2.0, 2.0, 0.8) + 0.8 * sines
}

pub fn run(model: &Model, rest: bool) -> Run {
    flown(model, "pitch", 3002, DT, |t| vec![stick(t, rest, 0.0)])
}

/// Both channels, each with a manoeuvre of its own.
pub fn two_channels(model: &Model, rest: bool) -> Run {
    flown(model, "pitch and roll", 3002, DT, |t| vec![stick(t, rest, 0.0), stick(t - 1.5, rest, 1.0)])
}

/// With noise of this part of the root mean square of each output.
pub fn with_noise(run: &Run, part: f64, seed: u64) -> Run {
    let deviations: Vec<f64> = sizes(run).iter().map(|s| part * s).collect();
    noisy(run, &deviations, seed)
}

pub fn options(ends: EndTerms) -> SpectralOptions {
    up_to(HIGHEST, ends)
}
