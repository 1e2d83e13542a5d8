//! What the accepted effects gain, run by run and output by output, by one noise.

use super::evenly::interval;
use super::metric::Metric;
use super::way::Way;
use crate::diagnose::diagnosis::{Biased, OutputGain, Overlay, RunGain};
use crate::diagnose::screen::Signals;
use crate::estimate::{OutputFit, ParameterEstimate};
use crate::model::Model;
use crate::record::Run;

/// Responses of a model to all runs; none where one diverges.
pub(super) fn responses(model: &Model, runs: &[Run], ways: &[Way], theta: &[Vec<f64>]) -> Option<Vec<Signals>> {
    let of = |(run, (way, theta)): (&Run, (&Way, &Vec<f64>))| way.answer(model.dynamics(), run, theta).ok();
    runs.iter().zip(ways.iter().zip(theta)).map(of).collect()
}

/// The gain in log-likelihood of each run from one response to another.
pub(super) fn run_gains(
    runs: &[Run],
    train: usize,
    ways: &[Way],
    (before, after): (&[Signals], &[Signals]),
    metric: &Metric,
) -> Vec<RunGain> {
    let of = |(r, run): (usize, &Run)| {
        let outputs = run.measured.len() / run.len().max(1);
        let metric = if r < train { metric } else { metric.for_held() };
        let (mut lens, measured) = (ways[r].lens(run, outputs, metric), ways[r].measured(run));
        let mut lines = |response: &[f64]| {
            let residual: Vec<f64> = measured.iter().zip(response).map(|(z, y)| z - y).collect();
            lens.seen(&residual)
        };
        let (a, b) = (lines(&before[r]), lines(&after[r]));
        let parts: Vec<f64> = a.iter().zip(&b).map(|(a, b)| 0.5 * (a * a - b * b)).collect();
        let gain: f64 = parts.iter().sum();
        let mean = gain / parts.len().max(1) as f64;
        let spread: f64 = parts.iter().map(|p| (p - mean) * (p - mean)).sum();
        RunGain { run: run.name.clone(), held_out: r >= train, gain, deviation: spread.sqrt() }
    };
    runs.iter().enumerate().map(of).collect()
}

/// How each output of each run is matched by two responses.
pub(super) fn output_gains(
    model: &Model,
    runs: &[Run],
    train: usize,
    ways: &[Way],
    (before, after): (&[Signals], &[Signals]),
    metric: &Metric,
) -> Vec<OutputGain> {
    let outputs = &model.definition().outputs;
    let q = outputs.len();
    let mut found = Vec::with_capacity(runs.len() * q);
    for (r, run) in runs.iter().enumerate() {
        let (measured, frequencies) = (ways[r].measured(run), ways[r].frequencies());
        let metric = if r < train { metric } else { metric.for_held() };
        // lines of a band: what they have together is spread over all samples
        let spread = frequencies.as_ref().map_or(1.0, |f| (f.len() as f64 / run.len() as f64).sqrt());
        for (o, output) in outputs.iter().enumerate() {
            let name = &output.quantity.name;
            let fit = |response: &[f64]| OutputFit::new(name, &run.name, &measured, response, o, q);
            let (a, b) = (fit(&before[r]), fit(&after[r]));
            found.push(OutputGain {
                run: run.name.clone(),
                held_out: r >= train,
                output: name.clone(),
                unit: output.quantity.unit.as_ref().map(ToString::to_string),
                rms_before: a.rms.map(|rms| spread * rms),
                rms_after: b.rms.map(|rms| spread * rms),
                noise_floor: match &frequencies {
                    Some(own) => spread * metric.floor_of(o, own),
                    None => metric.floor(o, run.len(), interval(run)),
                },
                tic_before: a.tic,
                tic_after: b.tic,
                r2_before: a.r2,
                r2_after: b.r2,
            });
        }
    }
    found
}

/// Both responses of every run over time; none in the frequency domain.
pub(super) fn overlays(
    runs: &[Run],
    train: usize,
    ways: &[Way],
    (before, after): (&[Signals], &[Signals]),
) -> Vec<Overlay> {
    let in_time = runs.iter().enumerate().filter(|(r, _)| ways[*r].frequencies().is_none());
    let of = |(r, run): (usize, &Run)| Overlay {
        run: run.name.clone(),
        held_out: r >= train,
        time: run.time.clone(),
        measured: run.measured.clone(),
        before: before[r].clone(),
        after: after[r].clone(),
    };
    in_time.map(of).collect()
}

/// Parameters of the base model before and after.
pub(super) fn biased(before: &[ParameterEstimate], after: &[ParameterEstimate]) -> Vec<Biased> {
    let of = |b: &ParameterEstimate| {
        let a = after.iter().find(|a| a.name == b.name && a.run == b.run)?;
        b.start?;
        Some(Biased {
            name: b.name.clone(),
            run: b.run.clone(),
            unit: b.unit.clone(),
            before: b.value,
            before_error: b.error(),
            after: a.value,
            after_error: a.error(),
            moved: b.error().filter(|e| *e > 0.0).map(|e| (a.value - b.value) / e),
        })
    };
    before.iter().filter_map(of).collect()
}
