//! One noise by which models are compared: a spectrum for each output, found once and then kept.

use super::held_noise::Surplus;
use crate::diagnose::screen::LogSpectrum;
use std::sync::Arc;

/// The noise that all models of a comparison share.
#[derive(Debug, Clone)]
pub(super) struct Metric {
    spectra: Vec<LogSpectrum>,
    /// What a model leaves, of which noise is a part: there is no more of it than that, by output; none where nothing is known.
    bounds: Vec<LogSpectrum>,
    /// Lines at the low end of which the screening knows nothing.
    dropped: usize,
    /// How much more than that the runs hold that these numbers are for, by output; none where they hold no more.
    surplus: Vec<Surplus>,
    /// What held-out runs are judged by; none where it is the same.
    held: Option<Arc<Metric>>,
}

impl Metric {
    pub(super) fn new(spectra: &[LogSpectrum], dropped: usize) -> Self {
        Self { spectra: spectra.to_vec(), bounds: Vec::new(), dropped, surplus: Vec::new(), held: None }
    }

    /// The same noise, but nowhere more than this.
    pub(super) fn within(&self, bounds: Vec<LogSpectrum>) -> Self {
        Self { bounds, ..self.clone() }
    }

    /// The noise by which held-out runs are judged.
    pub(super) fn for_held(&self) -> &Self {
        self.held.as_deref().unwrap_or(self)
    }

    /// The same noise, with more of it in held-out runs.
    pub(super) fn with_surplus(&self, surplus: Vec<Surplus>) -> Self {
        let held = surplus.iter().any(|s| !s.is_none());
        let own = Self { held: None, surplus: Vec::new(), ..self.clone() };
        let held = held.then(|| Arc::new(Self { surplus, ..own.clone() }));
        Self { held, ..own }
    }

    /// The same noise, with as much more of it in held-out runs as another has there.
    pub(super) fn with_surplus_of(&self, other: &Self) -> Self {
        self.with_surplus(other.for_held().surplus.clone())
    }

    /// Variance of a line, where lines tell of it.
    fn variance(&self, output: usize, log_frequency: f64) -> f64 {
        let believed = self.spectra[output].believed(log_frequency);
        let bound = self.bounds.get(output).map_or(f64::INFINITY, |b| b.believed(log_frequency));
        believed.min(bound) * self.factor(output, log_frequency)
    }

    fn factor(&self, output: usize, log_frequency: f64) -> f64 {
        self.surplus.get(output).map_or(1.0, |s| s.at(log_frequency))
    }

    /// Standard deviation of the noise in line `k` of `n` of an output, with so much time between samples.
    ///
    /// Lines that screening leaves out, the mean first, carry biases and trims that a fit needs, and whatever the noise remembers from
    /// before the record: they keep a small weight, as if the noise rose with the inverse square of the frequency, and the mean
    /// were an eighth of the first line.
    pub(super) fn deviation(&self, output: usize, k: usize, n: usize, interval: f64) -> f64 {
        let known = k.max(self.dropped).max(1) as f64;
        let frequency = known / (2.0 * n as f64 * interval);
        let rise = (known / (k as f64).max(0.125)).max(1.0);
        self.variance(output, frequency.ln()).sqrt() * rise
    }

    /// The same of a line at a frequency, which is taken as it is.
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

    /// Root mean square of an output's noise over lines.
    pub(super) fn floor_of(&self, output: usize, frequencies: &[f64]) -> f64 {
        let sum: f64 = frequencies.iter().map(|f| self.at(output, *f).powi(2)).sum();
        (sum / frequencies.len().max(1) as f64).sqrt()
    }
}
