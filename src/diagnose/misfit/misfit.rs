//! The description of one output's misfit.

use super::bands::{Band, bands, floor};
use super::gain::{Gain, gains};
use super::moments::{AmplitudeBin, Window, by_amplitude, windows};
use super::sentences::sentences;
use crate::model::Model;
use crate::quality::OutputFit;
use crate::record::Run;
use serde::Serialize;

/// What is wrong with one output, all runs together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Misfit {
    /// The output.
    pub output: String,
    /// Its unit, as text.
    pub unit: Option<String>,
    /// Compared samples.
    pub compared: usize,
    /// Root mean square of the residuals.
    pub rms: f64,
    /// The noise of the record by its upper frequencies, as a root mean square over all of them.
    pub floor: f64,
    /// Share of the mean square that is above this floor.
    pub above_floor: f64,
    /// Theil's inequality coefficient; none where record and response are zero.
    pub tic: Option<f64>,
    /// Parts of the error by frequency, octaves from low to high.
    pub bands: Vec<Band>,
    /// Parts of the error by time, run by run.
    pub windows: Vec<Window>,
    /// The error by the size of the model's response and of the inputs.
    pub amplitudes: Vec<AmplitudeBin>,
    /// Gain and phase of the record against the model's response, where there is power and the difference is clear.
    pub gains: Vec<Gain>,
    /// All that stands out, in words.
    pub sentences: Vec<String>,
}

/// What a model left of a run.
#[derive(Debug, Clone, Copy)]
pub struct Left<'a> {
    /// The record (N samples of q outputs), evenly sampled.
    pub run: &'a Run,
    /// Measured less modelled (N by q); NaN where nothing was measured.
    pub residual: &'a [f64],
    /// Time between samples.
    pub interval: f64,
}

/// One output of one run.
pub(super) struct Channel<'a> {
    pub(super) run: &'a str,
    pub(super) time: &'a [f64],
    pub(super) interval: f64,
    /// Measured minus model; NaN where nothing was measured.
    pub(super) residual: Vec<f64>,
    pub(super) measured: Vec<f64>,
    pub(super) response: Vec<f64>,
}

impl Channel<'_> {
    /// The residual, zero where nothing was measured.
    pub(super) fn filled(&self) -> impl Iterator<Item = f64> + '_ {
        self.residual.iter().map(|r| if r.is_nan() { 0.0 } else { *r })
    }
}

/// Describes what is wrong with every output that was measured, in the model's order.
pub fn misfit(model: &Model, runs: &[Left<'_>]) -> Vec<Misfit> {
    let q = model.layout().outputs;
    (0..q).filter_map(|output| of_output(model, runs, output, q)).collect()
}

fn of_output(model: &Model, runs: &[Left<'_>], output: usize, q: usize) -> Option<Misfit> {
    let runs: Vec<Left<'_>> = runs.iter().copied().filter(|r| r.run.len() > 1).collect();
    let channels: Vec<Channel<'_>> = runs.iter().map(|r| channel(r, output, q)).collect();
    let definition = model.definition();
    let quantity = &definition.outputs[output].quantity;
    let cells = || channels.iter().flat_map(|c| c.residual.iter().zip(&c.response)).filter(|(r, _)| !r.is_nan());
    let (measured, modelled): (Vec<f64>, Vec<f64>) = cells().map(|(r, y)| (r + y, *y)).unzip();
    let fit = OutputFit::new(&quantity.name, "", &measured, &modelled, 0, 1);
    let rms = fit.rms?;
    let floor = floor(&channels);
    let inputs: Vec<(String, usize)> = definition
        .inputs
        .iter()
        .enumerate()
        .filter(|(_, i)| i.is_declared())
        .map(|(k, i)| (i.quantity.name.clone(), k))
        .collect();
    let mut misfit = Misfit {
        output: quantity.name.clone(),
        unit: quantity.unit.as_ref().map(ToString::to_string),
        compared: fit.compared,
        rms,
        floor,
        above_floor: if rms > 0.0 { (1.0 - (floor / rms).powi(2)).max(0.0) } else { 0.0 },
        tic: fit.tic,
        bands: bands(&channels, floor),
        windows: windows(&channels),
        amplitudes: by_amplitude(&quantity.name, &channels, &runs, &inputs),
        gains: gains(&channels),
        sentences: Vec::new(),
    };
    misfit.sentences = sentences(&misfit, &definition.time.to_string(), runs.len());
    Some(misfit)
}

fn channel<'a>(left: &Left<'a>, output: usize, q: usize) -> Channel<'a> {
    let column = |values: &[f64]| -> Vec<f64> { values.iter().skip(output).step_by(q).copied().collect() };
    let (residual, measured) = (column(left.residual), column(&left.run.measured));
    // where nothing was measured the response is not known here, and not compared
    let response = measured.iter().zip(&residual).map(|(z, r)| z - r).collect();
    Channel { run: &left.run.name, time: &left.run.time, interval: left.interval, residual, measured, response }
}
