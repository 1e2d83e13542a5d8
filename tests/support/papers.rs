//! Flights of the reference systems: models simulated with their own values, hidden in noise, and read back from spectra.

pub mod bo105;
pub mod hfb320;
pub mod puma;

use crate::Normal;
use fdm::Model;
use fdm::estimate::{Changes, ParameterEstimate, SpectralFit, SpectralOptions, Work, fit_spectra};
use fdm::frequency::EndTerms;
use fdm::record::Run;
use fdm::simulate::Simulator;
use fdm::spectrum::Frequencies;

/// Runge-Kutta steps between samples with which flights are simulated.
const STEPS: usize = 8;

pub fn model(file: &str) -> Model {
    crate::shipped(file)
}

/// A model with other values of some parameters.
pub fn with_values(model: &Model, values: &[(&str, f64)]) -> Model {
    let mut params = model.definition().params.clone();
    for (name, value) in values {
        params[model.definition().param(name).unwrap()].value = *value;
    }
    model.with_params(params)
}

/// The record of a flight without noise: `samples` of them `dt` apart, inputs linear in between.
pub fn flown(model: &Model, name: &str, samples: usize, dt: f64, controls: impl Fn(f64) -> Vec<f64>) -> Run {
    let (m, q) = (model.layout().inputs, model.layout().outputs);
    let time: Vec<f64> = (0..samples).map(|k| dt * k as f64).collect();
    let mut run = Run {
        name: name.into(),
        inputs: time.iter().flat_map(|t| controls(*t)).collect(),
        time,
        held: vec![false; m],
        measured: vec![0.0; samples * q],
        input_gaps: vec![0; m],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    };
    let mut y = vec![0.0; samples * q];
    Simulator::new(model.dynamics(), &run, STEPS).unwrap().simulate(&model.definition().start(), &mut y).unwrap();
    run.measured = y;
    run
}

/// The samples from one on, with a clock of their own.
pub fn from_sample(run: &Run, first: usize) -> Run {
    let mut part = run.part(first..run.len());
    let start = part.time[0];
    part.time.iter_mut().for_each(|t| *t -= start);
    part
}

/// With white noise of these standard deviations on the outputs.
pub fn noisy(run: &Run, deviations: &[f64], seed: u64) -> Run {
    let name: u64 = run.name.bytes().fold(seed, |sum, b| sum.wrapping_mul(31).wrapping_add(u64::from(b)));
    let mut normal = Normal(name.wrapping_mul(0xD129_0D3B_3C86_5D21));
    let q = deviations.len();
    let measured = run.measured.iter().enumerate().map(|(k, y)| y + deviations[k % q] * normal.next()).collect();
    Run { measured, ..run.clone() }
}

/// Root mean square of every output about its mean.
pub fn sizes(run: &Run) -> Vec<f64> {
    let q = run.output_gaps.len();
    let n = run.len() as f64;
    let one = |o: usize| {
        let values = || run.measured.iter().skip(o).step_by(q);
        let mean = values().sum::<f64>() / n;
        (values().map(|y| (y - mean).powi(2)).sum::<f64>() / n).sqrt()
    };
    (0..q).map(one).collect()
}

/// Steps of these heights and durations one after the other.
pub fn steps(t: f64, start: f64, pattern: &[(f64, f64)]) -> f64 {
    let mut end = start;
    for (height, duration) in pattern {
        let begin = end;
        end += duration;
        if t >= begin - 1e-9 && t < end - 1e-9 {
            return *height;
        }
    }
    0.0
}

/// The DFVLR's input of 3, 2, 1 and 1 units of time.
pub fn three_two_one_one(t: f64, start: f64, height: f64, unit: f64) -> f64 {
    steps(t, start, &[(height, 3.0 * unit), (-height, 2.0 * unit), (height, unit), (-height, unit)])
}

/// Forth and back.
pub fn doublet(t: f64, start: f64, height: f64, half: f64) -> f64 {
    steps(t, start, &[(height, half), (-height, half)])
}

/// Sines of equal height at multiples of a frequency, with Schroeder's phases.
pub fn multisine(t: f64, base: f64, count: usize, shift: f64) -> f64 {
    let one = |k: usize| {
        let phase = -std::f64::consts::PI * (k * k) as f64 / count as f64;
        (std::f64::consts::TAU * base * k as f64 * t + phase + shift * k as f64).cos()
    };
    (1..=count).map(one).sum::<f64>() / (0.5 * count as f64).sqrt()
}

/// How spectra are fitted here: the records' own frequencies up to the highest.
pub fn up_to(highest: f64, ends: EndTerms) -> SpectralOptions {
    SpectralOptions {
        frequencies: Frequencies::Grid { lowest: None, highest: Some(highest) },
        ends,
        finish: false,
        ..SpectralOptions::default()
    }
}

/// Start values that are off by this part, up and down in turn.
pub fn off_by(model: &Model, part: f64) -> Changes {
    let free = model.definition().params.iter().filter(|p| !p.fixed).enumerate();
    let off = |k: usize| if k.is_multiple_of(2) { 1.0 + part } else { 1.0 - part };
    Changes { set: free.map(|(k, p)| (p.quantity.name.clone(), p.value * off(k))).collect(), ..Changes::default() }
}

pub fn fitted(model: &Model, runs: &[Run], options: &SpectralOptions) -> SpectralFit {
    let fit = fit_spectra(model, runs, options, &Work::default()).unwrap();
    assert!(fit.estimate.termination.is_good(), "{}: {}", model.name(), fit.estimate.termination);
    fit
}

pub fn found<'a>(fit: &'a SpectralFit, name: &str) -> &'a ParameterEstimate {
    fit.estimate.parameter(name, None).unwrap()
}

/// Names and values of a model's free parameters.
pub fn truth(model: &Model) -> Vec<(String, f64)> {
    let free = model.definition().params.iter().filter(|p| !p.fixed);
    free.map(|p| (p.quantity.name.clone(), p.value)).collect()
}

/// Relative error of every free parameter.
pub fn errors(model: &Model, fit: &SpectralFit) -> Vec<f64> {
    truth(model).iter().map(|(name, want)| (found(fit, name).value / want - 1.0).abs()).collect()
}

pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

pub fn deviation(values: &[f64]) -> f64 {
    let centre = mean(values);
    (values.iter().map(|v| (v - centre).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)).sqrt()
}
