//! The misfit of spectra: how large, and in which bands; of time and amplitudes they say nothing.

use super::bands::{Band, MOST, Powers, UPPER, root_of_median, shares};
use super::gain::{Lines, gains_of};
use super::misfit::Misfit;
use super::sentences::sentences;
use crate::model::Model;
use crate::quality::OutputFit;

/// A run in lines of its spectrum: real and imaginary parts one after the other.
#[derive(Debug, Clone)]
pub struct SpectralPassage {
    /// Its frequencies (2 M, each twice), in cycles per unit of time.
    pub frequency: Vec<f64>,
    /// Measured lines (2 M by q), of the variance of samples; NaN where nothing was measured.
    pub measured: Vec<f64>,
    /// Those of the model.
    pub response: Vec<f64>,
    /// Samples in time.
    pub samples: usize,
}

/// One output of one run.
struct Column {
    frequency: Vec<f64>,
    measured: Vec<f64>,
    response: Vec<f64>,
    residual: Vec<f64>,
    samples: usize,
}

/// Describes what is wrong with every output that was measured, in the model's order; sizes are those in the band.
pub fn misfit_of_lines(model: &Model, passages: &[SpectralPassage]) -> Vec<Misfit> {
    let q = model.layout().outputs;
    (0..q).filter_map(|output| of_output(model, passages, output, q)).collect()
}

fn of_output(model: &Model, passages: &[SpectralPassage], output: usize, q: usize) -> Option<Misfit> {
    let columns: Vec<Column> = passages.iter().filter_map(|p| column(p, output, q)).collect();
    let definition = model.definition();
    let quantity = &definition.outputs[output].quantity;
    let join = |pick: fn(&Column) -> &Vec<f64>| -> Vec<f64> { columns.iter().flat_map(pick).copied().collect() };
    let fit = OutputFit::new(&quantity.name, "", &join(|c| &c.measured), &join(|c| &c.response), 0, 1);
    let (lines, samples) = columns.iter().fold((0, 0), |(l, s), c| (l + c.residual.len(), s + c.samples));
    // what lines have together is spread over all samples
    let spread = (lines as f64 / samples.max(1) as f64).sqrt();
    let upper = |c: &Column| c.residual[((1.0 - UPPER) * c.residual.len() as f64) as usize..].to_vec();
    let deviation = root_of_median(columns.iter().flat_map(upper).map(|r| r * r).collect());
    let (rms, floor) = (spread * fit.rms?, spread * deviation);
    let mut misfit = Misfit {
        output: quantity.name.clone(),
        unit: quantity.unit.as_ref().map(ToString::to_string),
        compared: fit.compared,
        rms,
        floor,
        above_floor: if rms > 0.0 { (1.0 - (floor / rms).powi(2)).max(0.0) } else { 0.0 },
        tic: fit.tic,
        bands: bands(&columns, deviation),
        windows: Vec::new(),
        amplitudes: Vec::new(),
        gains: gains_of(&columns.iter().map(lines_of).collect::<Vec<_>>()),
        sentences: Vec::new(),
    };
    misfit.sentences = sentences(&misfit, &definition.time.to_string(), passages.len());
    Some(misfit)
}

fn column(passage: &SpectralPassage, output: usize, q: usize) -> Option<Column> {
    let pick = |values: &[f64]| -> Vec<f64> { values.iter().skip(output).step_by(q).copied().collect() };
    let (measured, response) = (pick(&passage.measured), pick(&passage.response));
    let residual = measured.iter().zip(&response).map(|(z, y)| z - y).collect();
    let known = measured.iter().all(|z| z.is_finite()) && !measured.is_empty();
    let (frequency, samples) = (passage.frequency.clone(), passage.samples);
    known.then_some(Column { frequency, measured, response, residual, samples })
}

fn lines_of(column: &Column) -> Lines {
    // a quarter of a period late: times -j
    let late = column.response.chunks_exact(2).flat_map(|c| [c[1], -c[0]]).collect();
    Lines {
        frequency: column.frequency.clone(),
        measured: column.measured.clone(),
        response: column.response.clone(),
        late,
    }
}

/// The error in octaves of the band.
fn bands(columns: &[Column], deviation: f64) -> Vec<Band> {
    let all = || columns.iter().flat_map(|c| c.frequency.iter().zip(c.residual.iter().zip(&c.measured)));
    let highest = all().map(|(f, _)| *f).fold(0.0, f64::max);
    let lowest = all().map(|(f, _)| *f).fold(f64::INFINITY, f64::min);
    if highest <= 0.0 {
        return Vec::new();
    }
    let count = ((highest / lowest).log2().ceil().max(1.0) as usize).min(MOST);
    let edge = |k: usize| if k == 0 { 0.0 } else { highest * 0.5_f64.powi((count - k) as i32) };
    let mut sums = vec![Powers::default(); count];
    for (f, (r, z)) in all() {
        let band = &mut sums[(1..count).rev().find(|k| *f > edge(*k)).unwrap_or(0)];
        band.error += r * r;
        band.noise += deviation * deviation;
        band.moving += r * r;
        band.measured += z * z;
    }
    shares(&sums, edge)
}
