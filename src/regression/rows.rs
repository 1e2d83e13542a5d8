//! The rows of a regression: rate and columns of one equation in one run, at samples or at frequencies.

use super::detrend::detrend;
use super::options::{Domain, RegressionOptions};
use super::refusal::RegressionError;
use crate::record::Run;
use crate::spectrum::{Frequencies, Spectrum, SpectrumOptions};
use num_complex::Complex64;
use std::f64::consts::TAU;

/// One equation in one run. At frequencies every coefficient is two rows, all real parts in front.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    /// Measured rate less what is known of it.
    pub(super) left: Vec<f64>,
    /// The measured rate.
    pub(super) rate: Vec<f64>,
    pub(super) columns: Vec<Vec<f64>>,
    /// Part of the rows that are independent: frequencies nearer than one over the record's length repeat each other.
    pub(super) independent: f64,
}

/// Series over the samples of a run that make an equation.
pub(super) struct Series<'a> {
    pub(super) state: &'a [f64],
    /// Its rate; not read in the frequency domain.
    pub(super) rate: &'a [f64],
    pub(super) known: &'a [f64],
    pub(super) columns: &'a [Vec<f64>],
}

/// Makes the rows as the options say.
pub(super) fn rows(run: &Run, series: &Series<'_>, options: &RegressionOptions) -> Result<Rows, RegressionError> {
    match &options.domain {
        Domain::Time => Ok(at_samples(run, series, options)),
        Domain::Frequency(choice) => at_frequencies(run, series, choice),
    }
}

fn at_samples(run: &Run, series: &Series<'_>, options: &RegressionOptions) -> Rows {
    let whole = |k: &usize| {
        let own = [series.rate[*k], series.known[*k]];
        own.iter().all(|v| !v.is_nan()) && series.columns.iter().all(|c| !c[*k].is_nan())
    };
    let used: Vec<usize> = (0..run.len()).filter(whole).collect();
    let time: Vec<f64> = used.iter().map(|k| run.time[*k]).collect();
    let pick = |value: &dyn Fn(usize) -> f64| {
        let mut values: Vec<f64> = used.iter().map(|k| value(*k)).collect();
        detrend(&time, &mut values, options.detrend);
        values
    };
    Rows {
        left: pick(&|k| series.rate[k] - series.known[k]),
        rate: pick(&|k| series.rate[k]),
        columns: series.columns.iter().map(|c| pick(&|k| c[k])).collect(),
        independent: 1.0,
    }
}

fn at_frequencies(run: &Run, series: &Series<'_>, choice: &Frequencies) -> Result<Rows, RegressionError> {
    let spectrum = transformed(run, series, choice)?;
    let count = spectrum.omega.len();
    let channel = |k: usize| &spectrum.outputs[k * count..(k + 1) * count];
    // x'(w) = j w x(w) + e1 x(T - dt/2) - e0 x(-dt/2)
    let ends = [spectrum.output_ends[0][0], spectrum.output_ends[1][0]];
    let rate: Vec<Complex64> = (0..count)
        .map(|k| {
            let [before, behind] = spectrum.end_factors(k);
            Complex64::new(0.0, spectrum.omega[k]) * channel(0)[k] + behind * ends[1] - before * ends[0]
        })
        .collect();
    let left: Vec<Complex64> = rate.iter().zip(channel(1)).map(|(rate, known)| rate - known).collect();
    let stacked = |c: &[Complex64]| c.iter().map(|c| c.re).chain(c.iter().map(|c| c.im)).collect::<Vec<f64>>();
    let spacing = match spectrum.omega[..] {
        [first, .., last] => (last - first) / (count - 1) as f64,
        _ => f64::INFINITY,
    };
    Ok(Rows {
        left: stacked(&left),
        rate: stacked(&rate),
        columns: (0..series.columns.len()).map(|c| stacked(channel(c + 2))).collect(),
        independent: (spacing * spectrum.duration() / TAU).min(1.0),
    })
}

/// State, known part and columns as channels of one spectrum.
fn transformed(run: &Run, series: &Series<'_>, choice: &Frequencies) -> Result<Spectrum, RegressionError> {
    let width = 2 + series.columns.len();
    let mut measured = Vec::with_capacity(run.len() * width);
    for k in 0..run.len() {
        measured.extend([series.state[k], series.known[k]]);
        measured.extend(series.columns.iter().map(|c| c[k]));
    }
    let channels = Run {
        name: run.name.clone(),
        time: run.time.clone(),
        inputs: Vec::new(),
        held: Vec::new(),
        measured,
        input_gaps: Vec::new(),
        output_gaps: vec![0; width],
    };
    let options = SpectrumOptions::default();
    Spectrum::of(&channels, choice, &options)
        .map_err(|error| RegressionError::Spectrum { run: run.name.clone(), error })
}
