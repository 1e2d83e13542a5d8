//! Records as they would be with other noise, where records stand in the equations.
//!
//! A nonlinear term that is carried in is computed from measured records: their noise is in the output and in what moves the model, and both move the
//! estimates. Noise of a size that is asked about is added to the records, coloured as each record's uppermost frequencies say; what that does to outputs and to the
//! response and its sensitivities is kept apart. Recorded inputs of which the noise is known are drawn likewise.

use super::fault::SpectralError;
use super::options::SpectralOptions;
use super::record_noise::{RecordNoise, top};
use super::setting::{Setting, samples, spectra};
use super::weights::{scaled, weight};
use crate::estimate::problem::{CarriedNoise, NoiseShift, Response, Slopes};
use crate::record::Run;
use crate::simulate::Block;
use crate::spectrum::{Frequencies, Spectrum};
use fdm_grammar::diagnostic::nearest;
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// Times that the noise of an output is drawn.
const DRAWS: usize = 10;

/// The records of a setting, to be drawn again.
pub(super) struct Redrawn<'s> {
    setting: &'s Setting,
    /// As they were measured.
    runs: &'s [Run],
    options: &'s SpectralOptions,
    /// Inputs whose noise is known, and its deviation.
    inputs: Vec<(Source, f64)>,
}

impl<'s> Redrawn<'s> {
    /// None where nothing but what is compared has noise.
    ///
    /// # Errors
    /// [`SpectralError::UnknownInput`], [`SpectralError::NotADeviation`].
    pub(super) fn new(
        setting: &'s Setting,
        runs: &'s [Run],
        options: &'s SpectralOptions,
    ) -> Result<Option<Self>, SpectralError> {
        let names: Vec<&str> = setting.model.definition().inputs.iter().map(|i| i.quantity.name.as_str()).collect();
        let known = |(name, deviation): &(String, f64)| {
            if !(deviation.is_finite() && *deviation >= 0.0) {
                return Err(SpectralError::NotADeviation { input: name.clone(), deviation: *deviation });
            }
            let found = names.iter().position(|own| own == name).ok_or_else(|| SpectralError::UnknownInput {
                name: name.clone(),
                nearest: nearest(name, names.iter().copied()).map(String::from),
            })?;
            Ok((Source::Input(found), *deviation))
        };
        let inputs: Vec<(Source, f64)> = options.input_noise.iter().map(known).collect::<Result<_, _>>()?;
        let silent = setting.carried.is_empty() && inputs.iter().all(|(_, deviation)| *deviation == 0.0);
        Ok((!silent).then_some(Self { setting, runs, options, inputs }))
    }
}

impl CarriedNoise for Redrawn<'_> {
    fn shifts(
        &self,
        run: usize,
        theta: &[f64],
        levels: &[f64],
        slopes: Option<Slopes<'_>>,
    ) -> Option<Vec<Vec<NoiseShift>>> {
        let (record, spectrum) = (&self.runs[run], &self.setting.weighted[run]);
        let longest = self.setting.spectra.iter().map(|s| s.samples).max().unwrap_or(1) as f64;
        let interval = record.time.last().map_or(1.0, |last| last - record.time[0]) / (record.len().max(2) - 1) as f64;
        let angles: Vec<f64> = spectrum.omega.iter().map(|w| w * interval).collect();
        // a coefficient's real part has the variance of a sample over twice their number
        let of_output = |(o, level): (usize, &f64)| {
            let source = Source::Output(o);
            (source, RecordNoise::of_level(2.0 * longest * level, &angles, top(source.of(record))))
        };
        let of_input = |(source, deviation): &(Source, f64)| {
            (*source, RecordNoise::of_deviation(*deviation, top(source.of(record))))
        };
        let columns = slopes.map_or(&[][..], |slopes| slopes.columns);
        let base = self.answer(spectrum, theta, columns).ok()??;
        let sources = levels.iter().enumerate().map(of_output).chain(self.inputs.iter().map(of_input));
        sources.enumerate().map(|(k, source)| self.drawn(run, theta, (k, source), &base, slopes).ok()).collect()
    }
}

/// A record whose noise is drawn.
#[derive(Debug, Clone, Copy)]
enum Source {
    /// One that is compared.
    Output(usize),
    /// One that moves the model.
    Input(usize),
}

impl Source {
    /// Its samples in a record.
    fn of(self, run: &Run) -> impl ExactSizeIterator<Item = f64> + Clone {
        let (values, first, width) = match self {
            Self::Output(o) => (&run.measured, o, run.output_gaps.len()),
            Self::Input(i) => (&run.inputs, i, run.held.len()),
        };
        values.iter().skip(first).step_by(width).copied()
    }
}

/// What is compared at some parameters.
struct Answer {
    /// Measured coefficients (2 M by q).
    measured: Vec<f64>,
    /// Those of the model.
    modelled: Vec<f64>,
    /// Their sensitivities (2 M by q by C).
    slopes: Vec<f64>,
}

impl Answer {
    /// How this differs from what was answered before.
    fn shift(&self, before: &Self, slopes: Option<Slopes<'_>>) -> NoiseShift {
        let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
        let seen = difference(&self.measured, &before.measured);
        let carried = difference(&before.modelled, &self.modelled);
        let Some(Slopes { columns, weights }) = slopes else {
            return NoiseShift { seen, carried, ..NoiseShift::default() };
        };
        let (rows, count) = (seen.len(), columns.len());
        let (q, residuals) = (weights.len().isqrt().max(1), difference(&before.measured, &before.modelled));
        // what is not compared has neither residuals nor slopes
        let there = |row: usize, value: f64| if residuals[row].is_nan() { 0.0 } else { value };
        let whole = DVector::from_fn(rows, |row, _| there(row, seen[row] + carried[row]));
        let left = DVector::from_fn(rows, |row, _| there(row, residuals[row]));
        let at = DMatrix::from_fn(rows, count, |row, c| there(row, before.slopes[row * count + c]));
        let moved = DMatrix::from_fn(rows, count, |row, c| there(row, self.slopes[row * count + c]) - at[(row, c)]);
        let weigh = |row: usize, c: usize| {
            let (first, o) = (row / q * q, row % q);
            let parts = (0..q).filter(|b| weights[o * q + b] != 0.0);
            parts.map(|b| weights[o * q + b] * moved[(first + b, c)]).sum::<f64>()
        };
        let weighed = DMatrix::from_fn(rows, count, weigh);
        let [pull, tilt] = [whole, left].map(|of| weighed.tr_mul(&of).as_slice().to_vec());
        // rows of the one for columns of the other
        let [cross, added] = [at, moved].map(|of| weighed.tr_mul(&of).as_slice().to_vec());
        NoiseShift { seen, carried, pull, tilt, cross, added }
    }
}

impl Redrawn<'_> {
    /// None where the model does not answer.
    fn answer(&self, spectrum: &Spectrum, theta: &[f64], columns: &[usize]) -> Result<Option<Answer>, SpectralError> {
        let mut response = self.setting.response(spectrum)?;
        let (q, count) = (response.outputs(), columns.len());
        let mut modelled = vec![0.0; response.samples() * q];
        let mut slopes = vec![0.0; modelled.len() * count];
        let done = match columns {
            [] => response.simulate(theta, &mut modelled),
            columns => response.sensitivities(theta, columns, &mut |block: Block<'_>| {
                for (sample, o) in (0..block.samples()).flat_map(|s| (0..q).map(move |o| (s, o))) {
                    let at = (block.first + sample) * q + o;
                    modelled[at] = block.y[sample * q + o];
                    for (c, slope) in block.layout.outputs[o].columns.iter().zip(block.row(sample, o)) {
                        slopes[at * count + *c as usize] = *slope;
                    }
                }
            }),
        };
        Ok(done.is_ok().then_some(Answer { measured: samples(spectrum), modelled, slopes }))
    }

    /// Draws of the noise of one record, the k-th.
    fn drawn(
        &self,
        run: usize,
        theta: &[f64],
        (k, (source, noise)): (usize, (Source, RecordNoise)),
        before: &Answer,
        slopes: Option<Slopes<'_>>,
    ) -> Result<Vec<NoiseShift>, SpectralError> {
        let setting = self.setting;
        let frequencies = Frequencies::List(setting.weighted[run].omega.iter().map(|w| w / TAU).collect());
        let options = SpectralOptions { frequencies, ..self.options.clone() };
        let q = setting.linear.structure().outputs;
        let sources = q + self.inputs.len();
        let mut shifts = Vec::with_capacity(DRAWS);
        for draw in 0..DRAWS {
            let mut chance = ChaCha8Rng::seed_from_u64(((run * sources + k) * DRAWS + draw) as u64);
            let mut noisy = self.runs[run].clone();
            match source {
                Source::Output(o) => noise.add(noisy.measured.iter_mut().skip(o).step_by(q), &mut chance),
                Source::Input(i) => noise.add(noisy.inputs.iter_mut().skip(i).step_by(noisy.held.len()), &mut chance),
            }
            let noisy = noisy.with_measured(setting.model.definition()).map_err(SpectralError::Incomplete)?;
            let drawn = spectra(&setting.model, &[noisy], &options)?;
            let drawn = scaled(&drawn[0], weight(&setting.spectra, run));
            let columns = slopes.map_or(&[][..], |slopes| slopes.columns);
            shifts.extend(self.answer(&drawn, theta, columns)?.map(|answer| answer.shift(before, slopes)));
        }
        Ok(shifts)
    }
}
