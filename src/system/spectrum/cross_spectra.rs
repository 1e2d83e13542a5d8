//! Averaged power and cross spectra of the channels of records.

use super::error::SpectrumError;
use super::even_rows::EvenRows;
use super::frequencies::{Comb, Frequencies, MOST};
use super::held_edges::HeldEdge;
use super::segments::{Segmentation, Window};
use super::spectrum::SpectrumOptions;
use super::transform::Transform;
use crate::record::Run;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Part of an input's power below which a band holds none of it.
pub(super) const NO_POWER: f64 = 1e-12;

/// One-sided spectral densities of all pairs of channels, inputs before outputs, per cycle per unit of time.
#[derive(Debug, Clone, PartialEq)]
pub struct CrossSpectra {
    /// Angular frequencies (M), rising.
    pub omega: Vec<f64>,
    /// Number of inputs m.
    pub inputs: usize,
    /// Number of outputs q.
    pub outputs: usize,
    /// Segments that were averaged.
    pub segments: usize,
    /// How many independent segments they are worth: overlapping ones share samples.
    pub averages: f64,
    /// Length of the longest segment in time.
    pub length: f64,
    /// `conj(X_i) X_j` for i up to j, one pair after the other, M each.
    density: Vec<Complex64>,
    /// Mean squares of the channels in the segments, their means taken off.
    power: Vec<f64>,
}

impl CrossSpectra {
    /// Averages over the segments of all runs, which must have the same channels. Every segment loses its mean and is windowed; longer ones
    /// weigh more. Of inputs, what lies between the samples is transformed, as for [`Spectrum`](super::Spectrum).
    ///
    /// # Errors
    /// [`SpectrumError`]: runs that cannot be transformed, bands that the segments cannot show, no segment in any run.
    pub fn of(
        runs: &[Run],
        choice: &Frequencies,
        segmentation: &Segmentation,
        window: Window,
        options: &SpectrumOptions,
    ) -> Result<Self, SpectrumError> {
        let mut average: Option<Average> = None;
        for run in runs {
            let even = EvenRows::of(run).map_err(|e| e.in_run(&run.name))?;
            let inputs = run.inputs.len() / run.len();
            let average = match &mut average {
                Some(average) => average,
                None => average.insert(Average::new(&even, inputs, choice, segmentation)?),
            };
            let even = with_means(even, run, inputs, options);
            average.add(run, &even, segmentation, window, options).map_err(|e| e.in_run(&run.name))?;
        }
        let average = average.ok_or(SpectrumError::TooFewSamples { found: 0, needed: 8 })?;
        average.finish(segmentation)
    }

    /// The density of `conj(X_i) X_j` over all frequencies, for channels i up to j.
    fn pair(&self, i: usize, j: usize) -> &[Complex64] {
        let (n, count) = (self.inputs + self.outputs, self.omega.len());
        &self.density[pair_at(n, i, j) * count..][..count]
    }

    /// Cross density of two channels at frequency `k`: `conj(X_i) X_j`.
    pub fn density(&self, i: usize, j: usize, k: usize) -> Complex64 {
        if i <= j { self.pair(i, j)[k] } else { self.pair(j, i)[k].conj() }
    }

    /// Power density of a channel over all frequencies.
    pub fn power(&self, channel: usize) -> Vec<f64> {
        self.pair(channel, channel).iter().map(|d| d.re).collect()
    }

    /// Ordinary coherence of two channels over all frequencies, 0 where one has no power.
    pub fn coherence(&self, i: usize, j: usize) -> Vec<f64> {
        let of = |k: usize| {
            let powers = self.density(i, i, k).re * self.density(j, j, k).re;
            if powers > 0.0 { (self.density(i, j, k).norm_sqr() / powers).min(1.0) } else { 0.0 }
        };
        (0..self.omega.len()).map(of).collect()
    }

    /// Whether a channel has power at these frequencies, compared with all it has.
    pub(super) fn has_power(&self, channel: usize) -> bool {
        let power = self.pair(channel, channel);
        let resolution = 1.0 / self.length;
        let largest = power.iter().map(|d| d.re).fold(0.0, f64::max);
        largest * resolution > NO_POWER * self.power[channel]
    }
}

/// With the means of held inputs over intervals in the place of their samples, where edges are between these: alike up to (w dt)^2/8, beside a
/// window that changes little within an interval.
fn with_means(mut even: EvenRows, run: &Run, inputs: usize, options: &SpectrumOptions) -> EvenRows {
    for channel in 0..inputs {
        let edges = options.course(channel, inputs, &run.held).edges(even.edges_of(channel));
        for (place, area) in edges.iter().map(HeldEdge::area) {
            even.rows[place * even.width + channel] += area;
        }
    }
    even
}

/// Place of the pair i, j (i up to j) of n channels.
fn pair_at(n: usize, i: usize, j: usize) -> usize {
    i * n + j - i * (i + 1) / 2
}

/// Sums over segments.
struct Average {
    /// The choice with its spacing resolved, so that segments of all lengths have the same frequencies.
    choice: Frequencies,
    omega: Vec<f64>,
    inputs: usize,
    width: usize,
    density: Vec<Complex64>,
    power: Vec<f64>,
    /// Time in segments.
    weight: f64,
    segments: usize,
    averages: f64,
    /// Plans by length and sampling interval.
    plans: Vec<(usize, f64, Transform)>,
}

impl Average {
    fn new(
        even: &EvenRows,
        inputs: usize,
        choice: &Frequencies,
        segmentation: &Segmentation,
    ) -> Result<Self, SpectrumError> {
        let samples = (segmentation.longest() / even.dt).round().clamp(8.0, u32::MAX.into()) as usize;
        let pairs = even.width * (even.width + 1) / 2;
        let comb = choice.of(samples, even.dt, pairs).map_err(SpectrumError::of_segments)?;
        let spacing = 1.0 / (samples as f64 * even.dt);
        let resolved = match choice {
            Frequencies::Grid { .. } => {
                let bins = comb.bins.clone().unwrap_or(1..2);
                let at = |bin: usize| bin as f64 * spacing;
                Frequencies::Band { lowest: at(bins.start), highest: at(bins.end - 1), spacing: Some(spacing) }
            }
            Frequencies::Band { lowest, highest, spacing: given } => {
                Frequencies::Band { lowest: *lowest, highest: *highest, spacing: Some(given.unwrap_or(spacing)) }
            }
            Frequencies::List(list) => Frequencies::List(list.clone()),
        };
        debug_assert!(pairs * comb.len() <= MOST);
        Ok(Self {
            choice: resolved,
            inputs,
            width: even.width,
            density: vec![Complex64::ZERO; pairs * comb.len()],
            power: vec![0.0; even.width],
            weight: 0.0,
            segments: 0,
            averages: 0.0,
            plans: Vec::new(),
            omega: comb.omega,
        })
    }

    fn add(
        &mut self,
        run: &Run,
        even: &EvenRows,
        segmentation: &Segmentation,
        window: Window,
        options: &SpectrumOptions,
    ) -> Result<(), SpectrumError> {
        if even.width != self.width || run.inputs.len() / run.len() != self.inputs {
            return Err(SpectrumError::OtherChannels { run: run.name.clone() });
        }
        let highest = self.omega.last().map_or(0.0, |w| w / TAU);
        for c in 0..even.width {
            if even.never_measured(c) {
                return Err(SpectrumError::NeverMeasured(options.name(c, self.inputs)));
            }
            even.check_gap(c, highest, options.name(c, self.inputs))?;
        }
        let cut = segmentation.cut(even.places, even.dt, run.time[0], window)?;
        self.averages += cut.independent;
        for (first, samples) in cut.segments {
            let rows = &even.rows[first * even.width..][..samples * even.width];
            let factors: Vec<Vec<Complex64>> = self.factors(even.dt, run, options);
            self.segment(rows, samples, even.dt, window, &factors)?;
        }
        Ok(())
    }

    /// What the sums of each channel's samples are multiplied with to be transforms of what lies between them; none for 1.
    fn factors(&self, dt: f64, run: &Run, options: &SpectrumOptions) -> Vec<Vec<Complex64>> {
        let of = |c: usize| {
            let course = options.course(c, self.inputs, &run.held);
            self.omega.iter().map(|w| course.factor(w * dt)).collect()
        };
        (0..self.inputs).map(of).collect()
    }

    fn segment(
        &mut self,
        rows: &[f64],
        samples: usize,
        dt: f64,
        window: Window,
        factors: &[Vec<Complex64>],
    ) -> Result<(), SpectrumError> {
        let (width, count) = (self.width, self.omega.len());
        let weights = window.weights(samples);
        let energy: f64 = weights.iter().map(|w| w * w).sum();
        let mut windowed = rows.to_vec();
        for c in 0..width {
            let column = || rows.iter().skip(c).step_by(width);
            let mean = column().sum::<f64>() / samples as f64;
            self.power[c] += dt * column().map(|v| (v - mean).powi(2)).sum::<f64>();
            windowed.iter_mut().skip(c).step_by(width).zip(&weights).for_each(|(v, w)| *v = (*v - mean) * w);
        }
        let plan = match self.plans.iter().position(|p| p.0 == samples && p.1 == dt) {
            Some(k) => k,
            None => {
                let comb: Comb = self.choice.of(samples, dt, width)?;
                self.plans.push((samples, dt, Transform::new(samples, width, &comb)));
                self.plans.len() - 1
            }
        };
        let mut sums = self.plans[plan].2.apply(&windowed);
        for (sums, factors) in sums.chunks_exact_mut(count).zip(factors) {
            sums.iter_mut().zip(factors).for_each(|(sum, factor)| *sum *= factor);
        }
        // one-sided density 2 |X|^2 dt/sum of squared weights, averaged by length
        let scale = 2.0 * dt / energy * (samples as f64 * dt);
        let mut densities = self.density.chunks_exact_mut(count);
        for i in 0..width {
            for j in i..width {
                let (a, b) = (&sums[i * count..][..count], &sums[j * count..][..count]);
                let Some(density) = densities.next() else { return Ok(()) };
                density.iter_mut().zip(a).zip(b).for_each(|((d, a), b)| *d += a.conj() * b * scale);
            }
        }
        self.weight += samples as f64 * dt;
        self.segments += 1;
        Ok(())
    }

    fn finish(mut self, segmentation: &Segmentation) -> Result<CrossSpectra, SpectrumError> {
        if self.segments == 0 {
            return Err(SpectrumError::NoneFits { length: segmentation.longest() });
        }
        self.density.iter_mut().for_each(|d| *d /= self.weight);
        self.power.iter_mut().for_each(|p| *p /= self.weight);
        Ok(CrossSpectra {
            omega: self.omega,
            inputs: self.inputs,
            outputs: self.width - self.inputs,
            segments: self.segments,
            averages: self.averages,
            length: segmentation.longest(),
            density: self.density,
            power: self.power,
        })
    }
}
