//! Noise of measured regressors and of recorded inputs, simulated: what other noise of the same size would do to the spectra, to the response and to its
//! sensitivities (for SIMEX, [`crate::uncertainty`]).
//!
//! Noise is AR(1), coloured as the record's uppermost quarter of frequencies says, where motion is slow and only noise is left: beside how strong the noise is
//! where the model is fitted (or how large it is in all, where that is known), that determines the correlation of neighbours. A record with steps, or with
//! gaps, does not determine it; its noise is white.
//!
//! Measured regressors between their samples.
//!
//! The transform of an input takes it for straight lines between samples. A product of an input and a state, or the square of a state, is
//! bent there, by `dt^2 f''/8` in the middle: enough to bias what little noise hides. What lies between two samples of what a term is made of
//! is known well, inputs straight and records smooth, and so is the term in the middle. Its samples are changed so that straight lines between
//! them have the area of parabolas through all three.

use super::error::SpectralError;
use super::options::SpectralOptions;
use super::setting::{Setting, samples, scaled, spectra, weight};
use crate::problem::response::Response;
use crate::problem::{NoiseShift, RegressorNoise, Slopes};
use fdm_grammar::diagnostic::nearest;
use fdm_grammar::{Model, math};
use fdm_numeric::fourier::RealFft;
use fdm_numeric::random::Stream;
use fdm_system::record::Run;
use fdm_system::simulate::Block;
use fdm_system::spectrum::{Frequencies, Spectrum, Window};
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use std::f64::consts::{LN_2, PI, TAU};

/// Simulations of the noise of an output.
const DRAWS: usize = 10;

/// The records of a setting, with simulated noise.
pub(super) struct SimulatedNoise<'s> {
    setting: &'s Setting,
    /// As they were measured.
    runs: &'s [Run],
    options: &'s SpectralOptions,
    /// Inputs whose noise is known, and its deviation.
    inputs: Vec<(Source, f64)>,
}

impl<'s> SimulatedNoise<'s> {
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
        let noiseless = setting.measured_regressors.is_empty() && inputs.iter().all(|(_, deviation)| *deviation == 0.0);
        Ok((!noiseless).then_some(Self { setting, runs, options, inputs }))
    }
}

impl RegressorNoise for SimulatedNoise<'_> {
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

/// A record whose noise is simulated.
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
        let measured = difference(&self.measured, &before.measured);
        let regressed = difference(&before.modelled, &self.modelled);
        let Some(Slopes { columns, weights }) = slopes else {
            return NoiseShift { measured, regressed, ..NoiseShift::default() };
        };
        let (rows, count) = (measured.len(), columns.len());
        let (q, residuals) = (weights.len().isqrt().max(1), difference(&before.measured, &before.modelled));
        // what is not compared has neither residuals nor slopes
        let there = |row: usize, value: f64| if residuals[row].is_nan() { 0.0 } else { value };
        let whole = DVector::from_fn(rows, |row, _| there(row, measured[row] + regressed[row]));
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
        NoiseShift { measured, regressed, pull, tilt, cross, added }
    }
}

impl SimulatedNoise<'_> {
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
            let mut chance = Stream::seeded(((run * sources + k) * DRAWS + draw) as u64);
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

/// Fewest samples that determine a colour.
const FEWEST: usize = 32;
/// Most that a sample has of its neighbour's noise: a sensor's filter takes the uppermost frequencies away, which is no sign of noise in the lowest.
const MOST_KEPT: f64 = 0.98;
/// Places in the uppermost quarter at which a density is averaged.
const PLACES: usize = 16;

/// An AR(1) process in its stationary state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RecordNoise {
    /// Of a sample.
    pub(super) deviation: f64,
    /// Correlation of neighbours, 0 for white noise.
    pub(super) kept: f64,
}

impl RecordNoise {
    /// Of a sensor whose deviation is known, and the power of its record in the uppermost frequencies.
    pub(super) fn of_deviation(deviation: f64, top: Option<f64>) -> Self {
        let wanted = top.map_or(1.0, |top| top / (deviation * deviation));
        Self { deviation, kept: kept(|kept| upper(kept) > wanted) }
    }

    /// Of noise that is as strong as white noise of variance `level` at these angles per sample, on the average.
    pub(super) fn of_level(level: f64, angles: &[f64], top: Option<f64>) -> Self {
        let wanted = top.map_or(1.0, |top| level / top);
        let here = |kept: f64| angles.iter().map(|w| density(kept, *w)).sum::<f64>() / angles.len().max(1) as f64;
        let kept = kept(|kept| here(kept) < wanted * upper(kept));
        Self { deviation: (level / here(kept)).sqrt(), kept }
    }

    /// Adds simulated noise to the samples of a record.
    pub(super) fn add<'v>(&self, samples: impl Iterator<Item = &'v mut f64>, chance: &mut Stream) {
        let (mut state, new) = (chance.normal_by_inversion(), (1.0 - self.kept * self.kept).sqrt());
        for value in samples {
            *value += self.deviation * state;
            state = self.kept * state + new * chance.normal_by_inversion();
        }
    }
}

/// Power of a record in the uppermost quarter of its frequencies, as the variance of white noise with as much: by the middle one, so that single
/// lines (a rotor's) do not count. None of a record that is short or has gaps.
pub(super) fn top(record: impl ExactSizeIterator<Item = f64> + Clone) -> Option<f64> {
    let n = record.len();
    if n < FEWEST || !record.clone().all(f64::is_finite) {
        return None;
    }
    let mean = record.clone().sum::<f64>() / n as f64;
    let weights = Window::Hann.weights(n);
    let energy: f64 = weights.iter().map(|w| w * w).sum();
    let bins = 3 * n / 8..n / 2;
    let mut own = vec![Complex64::ZERO; bins.len()];
    RealFft::new(n).transform(record.zip(&weights).map(|(v, w)| (v - mean) * w), bins, &mut own);
    let mut powers: Vec<f64> = own.iter().map(|x| x.norm_sqr() / energy).collect();
    powers.sort_by(f64::total_cmp);
    // the median of an exponential law is ln 2 of its mean
    Some(powers[powers.len() / 2] / LN_2).filter(|p| *p > 0.0)
}

/// Density of such noise of variance 1 at an angle per sample, 1 for white noise.
fn density(kept: f64, angle: f64) -> f64 {
    (1.0 - kept * kept) / (1.0 - 2.0 * kept * math::cos(angle) + kept * kept)
}

/// Its mean over the uppermost quarter.
fn upper(kept: f64) -> f64 {
    let angle = |k: usize| PI * (0.75 + 0.25 * (k as f64 + 0.5) / PLACES as f64);
    (0..PLACES).map(|k| density(kept, angle(k))).sum::<f64>() / PLACES as f64
}

/// The least that is not too little.
fn kept(too_little: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, MOST_KEPT);
    if !too_little(low) {
        return low;
    }
    // halvings of what is kept
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if too_little(middle) { low = middle } else { high = middle }
    }
    high
}

/// Part of an interval by which one may differ from the usual one.
const JITTER: f64 = 0.3;

/// A run, complete with its computed inputs, with these changed so; none when there is nothing to change.
pub(super) fn with_areas(run: &Run, model: &Model) -> Option<Run> {
    if run.held.len() != model.inputs.len() {
        return None;
    }
    let bent = |k: &usize| model.inputs[*k].computed.as_ref().is_some_and(|c| c.graph.delayed().is_empty());
    let bent: Vec<usize> = (0..model.inputs.len()).filter(bent).filter(|k| !run.held[*k]).collect();
    if bent.is_empty() || run.len() < 4 {
        return None;
    }
    let middles = middles(run).with_measured(model).ok()?;
    let usual = usual_intervals(run);
    let (mut changed, m) = (run.clone(), run.held.len());
    for k in bent {
        let bend = |i: usize| {
            let ends = 0.5 * (run.inputs[i * m + k] + run.inputs[(i + 1) * m + k]);
            let bend = middles.inputs[i * m + k] - ends;
            if usual[i] && bend.is_finite() { bend } else { 0.0 }
        };
        let last = run.len() - 1;
        for sample in 0..=last {
            // two thirds of the bend are its mean; each end of the interval takes half of that
            let (before, behind) = (bend(sample.max(1) - 1), bend(sample.min(last - 1)));
            changed.inputs[sample * m + k] += (before + behind) / 3.0;
        }
    }
    Some(changed)
}

/// The run halfway between its samples: inputs straight or held, records by the cubic through four samples.
fn middles(run: &Run) -> Run {
    let (n, m, q) = (run.len(), run.held.len(), run.output_gaps.len());
    let input = |(i, k): (usize, usize)| {
        let (a, b) = (run.inputs[i * m + k], run.inputs[(i + 1) * m + k]);
        if run.held[k] { a } else { 0.5 * (a + b) }
    };
    let record = |(i, o): (usize, usize)| {
        let at = |i: usize| run.measured[i * q + o];
        let straight = 0.5 * (at(i) + at(i + 1));
        let cubic = |i: usize| straight + (at(i) + at(i + 1) - at(i - 1) - at(i + 2)) / 16.0;
        Some(i).filter(|i| (1..n - 2).contains(i)).map(cubic).filter(|v| v.is_finite()).unwrap_or(straight)
    };
    let cells = |width: usize| (0..n - 1).flat_map(move |i| (0..width).map(move |k| (i, k)));
    Run {
        time: run.time.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect(),
        inputs: cells(m).map(input).collect(),
        measured: cells(q).map(record).collect(),
        ..run.clone()
    }
}

/// For each interval whether it is as long as most are.
fn usual_intervals(run: &Run) -> Vec<bool> {
    let each: Vec<f64> = run.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut sorted = each.clone();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted[sorted.len() / 2];
    each.iter().map(|dt| (dt - middle).abs() <= JITTER * middle).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(deviation: f64, kept: f64, seed: u64) -> Vec<f64> {
        let motion = |k: usize| (0.02 * k as f64).sin() + 0.5 * (0.05 * k as f64 + 1.0).sin();
        let mut record: Vec<f64> = (0..6000).map(motion).collect();
        RecordNoise { deviation, kept }.add(record.iter_mut(), &mut Stream::seeded(seed));
        record
    }

    #[test]
    fn a_records_upper_frequencies_tell_the_colour_of_its_noise() {
        for (seed, truth) in [(1, 0.0), (2, 0.5), (3, 0.9), (4, 0.95)] {
            let noisy = record(0.03, truth, seed);
            let top = top(noisy.iter().copied());
            let known = RecordNoise::of_deviation(0.03, top);
            assert!((known.kept - truth).abs() < 0.1 * (1.0 - truth) + 0.03, "{truth}: {known:?}");
            // by what it is at low frequencies
            let angles = [0.05, 0.1, 0.2];
            let level = angles.iter().map(|w| density(truth, *w)).sum::<f64>() / 3.0 * 0.03 * 0.03;
            let found = RecordNoise::of_level(level, &angles, top);
            assert!((found.deviation / 0.03 - 1.0).abs() < 0.3 && (found.kept - truth).abs() < 0.1, "{found:?}");
        }
    }

    #[test]
    fn noise_is_white_where_the_record_does_not_tell() {
        let noisy = &record(0.03, 0.9, 5)[..1000];
        assert_eq!(top(noisy[..20].iter().copied()), None);
        assert_eq!(top(noisy.iter().map(|v| if *v > 1.4 { f64::NAN } else { *v })), None);
        assert_eq!(top([1.0; 100].into_iter()), None);
        assert_eq!(RecordNoise::of_deviation(0.1, None), RecordNoise { deviation: 0.1, kept: 0.0 });
        assert_eq!(RecordNoise::of_level(0.04, &[0.1], None), RecordNoise { deviation: 0.2, kept: 0.0 });
        // steps are in all frequencies: more than the noise could have there
        let stepped: Vec<f64> = (0..400)
            .map(|k| f64::from(u8::from([40, 130, 213, 255].iter().filter(|at| k > **at).count() % 2 == 1)))
            .collect();
        assert_eq!(RecordNoise::of_deviation(0.01, top(stepped.iter().copied())).kept, 0.0);
    }
}

#[cfg(test)]
mod intersample_tests {
    use super::*;
    use fdm_system::model::Model;

    /// Areas under straight lines between changed samples are those under the curve.
    #[test]
    fn straight_lines_have_the_area_of_what_is_bent() {
        let text = "model m { input u; state x; param a = 1; der(x) = a*x*x*u - x; output x_m = x; }";
        let model = Model::from_text("m.fdm", text).expect("a model");
        let carried = model.definition().carried().expect("carried").model;
        let (dt, n) = (0.1, 200);
        let x = |t: f64| 2.0 + (1.1 * t).sin();
        // up and down with kinks at samples
        let u = |t: f64| (3.0 - (t - 8.0).abs()).max(0.0);
        let time: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let run = Run {
            name: "r".into(),
            inputs: time.iter().map(|t| u(*t)).collect(),
            measured: time.iter().map(|t| x(*t)).collect(),
            time,
            held: vec![false],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0],
        };
        let run = run.with_measured(&carried).expect("complete");
        let m = carried.inputs.len();
        let changed = with_areas(&run, &carried).expect("something is bent");
        let exact = |from: usize, to: usize| -> f64 {
            let fine = 4000;
            let h = (to - from) as f64 * dt / fine as f64;
            (0..fine).map(|k| from as f64 * dt + (k as f64 + 0.5) * h).map(|t| h * x(t).powi(2) * u(t)).sum()
        };
        let straight = |run: &Run, from: usize, to: usize| -> f64 {
            let at = |k: usize| run.inputs[k * m + m - 1];
            (from..to).map(|k| 0.5 * dt * (at(k) + at(k + 1))).sum()
        };
        let [before, after] = [&run, &changed].map(|run| (straight(run, 20, 130) - exact(20, 130)).abs());
        assert!(before > 3e-4 && after < 0.03 * before, "{before:e} {after:e}");
    }
}
