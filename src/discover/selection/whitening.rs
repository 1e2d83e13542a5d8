//! A run seen through its noise: bins of the cosine transform, divided by the noise's deviation, so that the estimator of
//! the time domain fits them as samples of unit noise.
//!
//! One noise by which models are compared: a spectrum for each output, found once and then kept.

use super::runs::interval;
use crate::bins::{MeasuredRows, ordinal};
use crate::noise::{Growth, LogSpectrum};
use fdm_estimate::{Response, TimeResponse};
use fdm_numeric::fourier::CosineTransform;
use fdm_system::record::Run;
use fdm_system::simulate::{Block, Divergence, RowLayout, Simulator, Sink};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// Samples that are handed over at once.
const BLOCK: usize = 64;

/// What turns signals of a run (N by q) into whitened bins (N by q): every output's measured samples, closed up, in bins; zeros
/// behind them.
pub(super) struct Whitener {
    outputs: usize,
    views: Vec<OutputWhitener>,
    bin: Vec<f64>,
}

/// One output.
struct OutputWhitener {
    /// None where signals are bins already.
    dct: Option<CosineTransform>,
    /// Samples that were measured.
    samples: Vec<usize>,
    /// Factor of every bin.
    weight: Vec<f64>,
    /// Logarithm of the frequency of every bin.
    log_frequency: Vec<f64>,
    /// Relative deviation of the noise at each sample; none where it is even.
    deviations: Option<Vec<f64>>,
}

impl OutputWhitener {
    fn new(run: &Run, rows: Option<&MeasuredRows>, (o, q): (usize, usize), noise: &CommonNoise) -> Self {
        let samples: Vec<usize> = (0..run.len()).filter(|k| !run.measured[k * q + o].is_nan()).collect();
        let n = samples.len();
        let dt = MeasuredRows::between(rows, &samples, interval(run));
        let orthonormal = |k: usize| if k == 0 { 1.0 / n as f64 } else { 2.0 / n as f64 };
        let deviations = noise.deviations(o, n, dt);
        let weight = deviations.iter().enumerate().map(|(k, deviation)| orthonormal(k).sqrt() / deviation).collect();
        let log_frequency = (0..n).map(|k| (ordinal(k) / (2.0 * n as f64 * dt)).ln()).collect();
        let deviations = noise.growth(o).map(|growth| growth.deviations(&run.measured, (o, q)));
        Self { dct: Some(CosineTransform::new(n.max(1))), samples, weight, log_frequency, deviations }
    }

    /// Of bins at these frequencies.
    fn of_lines(measured: &[f64], (o, q): (usize, usize), frequencies: &[f64], noise: &CommonNoise) -> Self {
        let samples: Vec<usize> = (0..frequencies.len()).filter(|k| !measured[k * q + o].is_nan()).collect();
        let weight = samples.iter().map(|k| 1.0 / noise.at(o, frequencies[*k])).collect();
        let log_frequency = samples.iter().map(|k| frequencies[*k].ln()).collect();
        Self { dct: None, samples, weight, log_frequency, deviations: None }
    }
}

impl Whitener {
    pub(super) fn new(run: &Run, outputs: usize, noise: &CommonNoise) -> Self {
        let rows = MeasuredRows::of(&run.measured, outputs, &run.time);
        let views = (0..outputs).map(|o| OutputWhitener::new(run, rows.as_ref(), (o, outputs), noise)).collect();
        Self { outputs, views, bin: vec![0.0; run.len()] }
    }

    /// For signals that are bins already, of a run that has these.
    pub(super) fn of_lines(measured: &[f64], outputs: usize, frequencies: &[f64], noise: &CommonNoise) -> Self {
        let views =
            (0..outputs).map(|o| OutputWhitener::of_lines(measured, (o, outputs), frequencies, noise)).collect();
        Self { outputs, views, bin: vec![0.0; frequencies.len()] }
    }

    /// The bins of output `o` of a signal whose sample `k` is `signal(k)`, N of them.
    fn bins(&mut self, o: usize, signal: impl Fn(usize) -> f64) -> &[f64] {
        let Self { views, bin, .. } = self;
        let view = &mut views[o];
        let (own, rest) = bin.split_at_mut(view.samples.len());
        rest.fill(0.0);
        if own.is_empty() {
            return bin;
        }
        own.iter_mut().zip(&view.samples).for_each(|(value, k)| *value = signal(*k));
        if let Some(deviations) = &view.deviations {
            own.iter_mut().zip(&view.samples).for_each(|(value, k)| *value /= deviations[*k]);
        }
        if let Some(dct) = &mut view.dct {
            dct.forward(own);
        }
        own.iter_mut().zip(&view.weight).for_each(|(value, weight)| *value *= weight);
        bin
    }

    /// A signal (N by q) in bins, in its place.
    pub(super) fn apply(&mut self, signal: &mut [f64]) {
        let q = self.outputs;
        for o in 0..q {
            let bins = self.bins(o, |k| signal[k * q + o]);
            // read before they are written
            let bins = bins.to_vec();
            bins.into_iter().enumerate().for_each(|(k, value)| signal[k * q + o] = value);
        }
    }

    /// Logarithm of the frequency and square of every bin of output `o` of a signal.
    pub(super) fn squares(&mut self, o: usize, signal: &[f64]) -> Vec<(f64, f64)> {
        let q = self.outputs;
        let bins = self.bins(o, |k| signal[k * q + o]).to_vec();
        self.views[o].log_frequency.iter().copied().zip(bins.into_iter().map(|bin| bin * bin)).collect()
    }

    /// A signal in bins.
    pub(super) fn whitened(&mut self, signal: &[f64]) -> Vec<f64> {
        let mut bins = signal.to_vec();
        self.apply(&mut bins);
        bins
    }
}

/// The response of a run, through a whitener.
pub(super) struct WhitenedResponse<'a> {
    simulator: Simulator<'a>,
    whitener: Whitener,
    y: Vec<f64>,
    jacobian: Vec<f64>,
    rows: Vec<f64>,
}

impl<'a> WhitenedResponse<'a> {
    pub(super) fn new(simulator: Simulator<'a>, whitener: Whitener) -> Self {
        let y = vec![0.0; simulator.samples() * simulator.outputs()];
        Self { simulator, whitener, y, jacobian: Vec::new(), rows: Vec::new() }
    }
}

impl Response for WhitenedResponse<'_> {
    fn samples(&self) -> usize {
        self.simulator.samples()
    }

    fn outputs(&self) -> usize {
        self.simulator.outputs()
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        self.simulator.simulate(theta, y)?;
        self.whitener.apply(y);
        Ok(())
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        let (n, q, p) = (self.simulator.samples(), self.simulator.outputs(), columns.len());
        let stride = p.next_multiple_of(8);
        self.jacobian.resize(n * q * stride, 0.0);
        self.simulator.sensitivities(theta, columns, &mut self.y, &mut self.jacobian)?;
        self.whitener.apply(&mut self.y);
        for o in 0..q {
            for c in 0..p {
                let jacobian = &mut self.jacobian;
                let column = self.whitener.bins(o, |k| jacobian[(k * q + o) * stride + c]);
                column.iter().enumerate().for_each(|(k, value)| jacobian[(k * q + o) * stride + c] = *value);
            }
        }
        let layout = RowLayout::full(q, p);
        self.rows.resize(BLOCK * layout.length, 0.0);
        for first in (0..n).step_by(BLOCK) {
            let samples = BLOCK.min(n - first);
            self.rows.fill(0.0);
            for k in 0..samples {
                for (o, row) in layout.outputs.iter().enumerate() {
                    let from = &self.jacobian[((first + k) * q + o) * stride..][..p];
                    self.rows[k * layout.length + row.start..][..p].copy_from_slice(from);
                }
            }
            let rows = &mut self.rows[..samples * layout.length];
            sink(Block { first, y: &self.y[first * q..][..samples * q], rows, layout: &layout });
        }
        Ok(())
    }
}

impl TimeResponse for WhitenedResponse<'_> {}

/// Least width of a band in log f, and the fewest bins in it.
const WIDTH: f64 = 0.3;

const FEWEST: usize = 6;

/// Deviations of the sum of squares beyond which it is no chance.
const CLEAR: f64 = 4.0;

/// By how much a validation output's noise is larger, band by band.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ExcessNoise {
    /// Upper end of each band in log f, and the factor of the variance there.
    bands: Vec<(f64, f64)>,
}

impl ExcessNoise {
    /// Of squares that should be one on average, of several models over the same bins.
    pub(super) fn of(models: &[Vec<(f64, f64)>]) -> Self {
        let Some(first) = models.first() else { return Self { bands: Vec::new() } };
        let mut order: Vec<usize> = (0..first.len()).collect();
        order.sort_by(|a, b| first[*a].0.total_cmp(&first[*b].0));
        let (mut bands, mut from) = (Vec::new(), 0);
        for to in 1..=order.len() {
            let (low, high) = (first[order[from]].0, first[order[to - 1]].0);
            let full = to - from >= FEWEST && high - low >= WIDTH;
            if !full && to < order.len() {
                continue;
            }
            let count = (to - from) as f64;
            let left = |model: &Vec<(f64, f64)>| order[from..to].iter().map(|k| model[*k].1).sum::<f64>();
            let least = models.iter().map(left).fold(f64::INFINITY, f64::min);
            let clear = least > count + CLEAR * (2.0 * count).sqrt();
            bands.push((high, if clear && least.is_finite() { least / count } else { 1.0 }));
            from = to;
        }
        Self { bands }
    }

    /// Whether there is none.
    pub(super) fn is_none(&self) -> bool {
        self.bands.iter().all(|(_, factor)| *factor == 1.0)
    }

    /// The factor at a frequency; that of the nearest band beyond them all.
    pub(super) fn at(&self, log_frequency: f64) -> f64 {
        let band = self.bands.partition_point(|(end, _)| *end < log_frequency);
        self.bands.get(band).or(self.bands.last()).map_or(1.0, |(_, factor)| *factor)
    }
}

/// The noise that all models of a comparison share.
#[derive(Debug, Clone)]
pub(super) struct CommonNoise {
    spectra: Vec<LogSpectrum>,
    /// What a model leaves, of which noise is a part: there is no more of it than that, by output; none where nothing is known.
    bounds: Vec<LogSpectrum>,
    /// Bins at the low end of which the screening knows nothing.
    dropped: usize,
    /// How much more than that the runs hold that these numbers are for, by output; none where they hold no more.
    excess: Vec<ExcessNoise>,
    /// What validation runs are judged by; none where it is the same.
    validation: Option<Arc<CommonNoise>>,
    /// How the noise of each output grows with its signal; empty where none does.
    growth: Arc<[Option<Growth>]>,
    known: KnownDeviations,
}

/// Deviations of bins, found once: every fit by a noise asks for them.
#[derive(Debug, Default)]
struct KnownDeviations(Mutex<BTreeMap<Bins, Arc<[f64]>>>);

/// Which bins: those of an output, in runs of so many samples at this interval (its bits).
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Bins {
    output: usize,
    samples: usize,
    interval: u64,
}

impl Clone for KnownDeviations {
    /// Nothing: what is made from a noise may be another noise.
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl CommonNoise {
    pub(super) fn new(spectra: &[LogSpectrum], dropped: usize) -> Self {
        Self {
            spectra: spectra.to_vec(),
            bounds: Vec::new(),
            dropped,
            excess: Vec::new(),
            validation: None,
            growth: Arc::new([]),
            known: KnownDeviations::default(),
        }
    }

    /// This noise, whose deviation grows with the signals: the spectra are those of what is left of it then.
    pub(super) fn growing(&self, growth: &Arc<[Option<Growth>]>) -> Self {
        Self { growth: Arc::clone(growth), ..self.clone() }
    }

    /// How the noise of each output grows with its signal; empty where none does.
    pub(super) fn growths(&self) -> &Arc<[Option<Growth>]> {
        &self.growth
    }

    /// How the noise of an output grows with its signal.
    fn growth(&self, output: usize) -> Option<&Growth> {
        self.growth.get(output)?.as_ref()
    }

    /// This noise, but nowhere more than these bounds.
    pub(super) fn within(&self, bounds: Vec<LogSpectrum>) -> Self {
        Self { bounds, ..self.clone() }
    }

    /// The noise by which validation runs are judged.
    pub(super) fn for_validation(&self) -> &Self {
        self.validation.as_deref().unwrap_or(self)
    }

    /// This noise, with more of it in validation runs.
    pub(super) fn with_excess(&self, excess: Vec<ExcessNoise>) -> Self {
        let validation = excess.iter().any(|s| !s.is_none());
        let own = Self { validation: None, excess: Vec::new(), ..self.clone() };
        let validation = validation.then(|| Arc::new(Self { excess, ..own.clone() }));
        Self { validation, ..own }
    }

    /// This noise, with as much more of it in validation runs as another has there.
    pub(super) fn with_excess_of(&self, other: &Self) -> Self {
        self.with_excess(other.for_validation().excess.clone())
    }

    /// Variance of a bin, where bins tell of it.
    fn variance(&self, output: usize, log_frequency: f64) -> f64 {
        let inflated = self.spectra[output].inflated(log_frequency);
        let bound = self.bounds.get(output).map_or(f64::INFINITY, |b| b.inflated(log_frequency));
        inflated.min(bound) * self.factor(output, log_frequency)
    }

    fn factor(&self, output: usize, log_frequency: f64) -> f64 {
        self.excess.get(output).map_or(1.0, |s| s.at(log_frequency))
    }

    /// Standard deviations of the noise in all `n` bins of an output, with so much time between samples.
    fn deviations(&self, output: usize, n: usize, interval: f64) -> Arc<[f64]> {
        let find = || (0..n).map(|k| self.deviation(output, k, n, interval)).collect();
        match self.known.0.lock() {
            Ok(mut known) => {
                let bins = Bins { output, samples: n, interval: interval.to_bits() };
                known.entry(bins).or_insert_with(find).clone()
            }
            Err(_) => find(),
        }
    }

    /// Deviation of the noise in bin `k`.
    ///
    /// Bins that screening leaves out keep a small weight, as if the noise rose with the inverse square of the frequency.
    fn deviation(&self, output: usize, k: usize, n: usize, interval: f64) -> f64 {
        let known = ordinal(k.max(self.dropped));
        let frequency = known / (2.0 * n as f64 * interval);
        let rise = known / ordinal(k);
        self.variance(output, frequency.ln()).sqrt() * rise
    }

    /// Deviation of the noise in a bin at a frequency, which is taken as it is.
    pub(super) fn at(&self, output: usize, frequency: f64) -> f64 {
        self.variance(output, frequency.ln()).sqrt()
    }

    /// Root mean square of an output's noise in a run, in its unit.
    pub(super) fn floor(&self, output: usize, n: usize, interval: f64) -> f64 {
        let square = |k: usize| {
            let frequency = k.max(self.dropped).max(1) as f64 / (2.0 * n as f64 * interval);
            let bound = self.bounds.get(output).map_or(f64::INFINITY, |b| b.at(frequency.ln()));
            self.spectra[output].at(frequency.ln()).min(bound) * self.factor(output, frequency.ln())
        };
        ((0..n).map(square).sum::<f64>() / n.max(1) as f64).sqrt()
    }

    /// Root mean square of an output's noise over bins.
    pub(super) fn floor_of(&self, output: usize, frequencies: &[f64]) -> f64 {
        let sum: f64 = frequencies.iter().map(|f| self.at(output, *f).powi(2)).sum();
        (sum / frequencies.len().max(1) as f64).sqrt()
    }
}
