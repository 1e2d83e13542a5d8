//! Frequency responses between the channels of records, with coherence and random errors.

use super::cross_spectra::CrossSpectra;
use super::cross_spectra::{Segmentation, Window};
use super::frequencies::Frequencies;
use super::frequencies::SpectrumError;
use super::spectrum::SpectrumOptions;
use crate::record::Run;
use nalgebra::DMatrix;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Frequency responses of all outputs to all inputs as records show them, each input's with the others held (conditioned spectra; Bendat and
/// Piersol, Random Data, ch. 7), M numbers for every pair.
#[derive(Debug, Clone, PartialEq)]
pub struct FrequencyResponseEstimate {
    /// Angular frequencies (M), rising.
    pub omega: Vec<f64>,
    /// Number of inputs m.
    pub inputs: usize,
    /// Number of outputs q.
    pub outputs: usize,
    /// Independent averages (M): what the segments are worth.
    pub averages: Vec<f64>,
    /// Output by input, q by m by M; NaN where inputs cannot be told apart.
    pub response: Vec<Complex64>,
    /// Partial coherence of output and input, q by m by M: the part of the output's power, that of the other inputs taken out of both, that
    /// this input explains.
    pub partial_coherence: Vec<f64>,
    /// Multiple coherence, q by M: the part of the output's power that all inputs explain.
    pub coherence: Vec<f64>,
    /// Random error, q by m by M: standard deviation of the magnitude as a part of it, and of the phase in radians.
    pub error: Vec<f64>,
}

/// Part of an input's power that others must leave it to be told apart.
const OWN_PART: f64 = 1e-9;

impl FrequencyResponseEstimate {
    /// Conditions averaged spectra; names in `options` are for messages.
    ///
    /// # Errors
    /// [`SpectrumError::TooFewAverages`], [`SpectrumError::NoPower`], [`SpectrumError::Dependent`].
    pub fn of(spectra: &CrossSpectra, options: &SpectrumOptions) -> Result<Self, SpectrumError> {
        let (m, q, count) = (spectra.inputs, spectra.outputs, spectra.omega.len());
        if spectra.averages < m as f64 + 1.0 {
            let (segments, averages) = (spectra.segments, spectra.averages);
            return Err(SpectrumError::TooFewAverages { segments, averages, inputs: m });
        }
        if let Some(i) = (0..m).find(|i| !spectra.has_power(*i)) {
            let end = |w: Option<&f64>| w.map_or(0.0, |w| w / TAU);
            let (lowest, highest) = (end(spectra.omega.first()), end(spectra.omega.last()));
            return Err(SpectrumError::NoPower { channel: options.name(i, m), lowest, highest });
        }
        let mut found = Self {
            omega: spectra.omega.clone(),
            inputs: m,
            outputs: q,
            averages: vec![spectra.averages; count],
            response: vec![Complex64::new(f64::NAN, f64::NAN); q * m * count],
            partial_coherence: vec![0.0; q * m * count],
            coherence: vec![f64::NAN; q * count],
            error: vec![f64::INFINITY; q * m * count],
        };
        let mut dependent = vec![0; m];
        for k in 0..count {
            match Conditioned::at(spectra, k) {
                Ok(conditioned) => (0..q).for_each(|o| found.condition(spectra, &conditioned, o, k)),
                Err(input) => dependent[input] += 1,
            }
        }
        if m > 0 && dependent.iter().sum::<usize>() == count {
            let most = (0..m).max_by_key(|i| dependent[*i]).unwrap_or(0);
            return Err(SpectrumError::Dependent(options.name(most, m)));
        }
        Ok(found)
    }

    /// One output at one frequency.
    fn condition(&mut self, spectra: &CrossSpectra, conditioned: &Conditioned, output: usize, k: usize) {
        let (m, count) = (self.inputs, self.omega.len());
        let y = m + output;
        let cross: Vec<Complex64> = (0..m).map(|i| spectra.density(i, y, k)).collect();
        let power = spectra.density(y, y, k).re;
        let response: Vec<Complex64> =
            (0..m).map(|i| (0..m).map(|j| conditioned.inverse[(i, j)] * cross[j]).sum()).collect();
        let explained: f64 = response.iter().zip(&cross).map(|(h, c)| (h * c.conj()).re).sum();
        let rest = (power - explained).max(0.0);
        self.coherence[output * count + k] = if power > 0.0 { (1.0 - rest / power).clamp(0.0, 1.0) } else { 0.0 };
        let averages = spectra.averages;
        for (i, h) in response.into_iter().enumerate() {
            let at = (output * m + i) * count + k;
            let noise = rest * conditioned.inverse[(i, i)].re;
            let size = h.norm_sqr();
            self.response[at] = h;
            self.partial_coherence[at] = if size > 0.0 { size / (size + noise) } else { 0.0 };
            // a regression with complex numbers, m unknowns; half of the variance is across
            let variance = noise / (averages - m as f64).max(f64::MIN_POSITIVE);
            self.error[at] = if size > 0.0 { (0.5 * variance / size).sqrt() } else { f64::INFINITY };
        }
    }

    /// Place of a pair's M numbers.
    pub fn pair(&self, output: usize, input: usize) -> std::ops::Range<usize> {
        let at = (output * self.inputs + input) * self.omega.len();
        at..at + self.omega.len()
    }

    /// The best of several segment lengths: long ones see low frequencies, short ones average more. Responses and coherences are weighted by the
    /// fourth power of the inverse random error (Tischler and Remple); lengths that hold less than two periods of a frequency do not count there.
    /// Errors are averaged in the same way, not lessened: all lengths see the same samples.
    ///
    /// # Errors
    /// What [`CrossSpectra::of`] and [`Self::of`] say of the longest segments; shorter ones that cannot be used are left out.
    pub fn composite(
        runs: &[Run],
        choice: &Frequencies,
        lengths: &[f64],
        overlap: f64,
        window: Window,
        options: &SpectrumOptions,
    ) -> Result<Self, SpectrumError> {
        let mut lengths = lengths.to_vec();
        lengths.sort_by(|a, b| b.total_cmp(a));
        let estimate = |choice: &Frequencies, length: f64| {
            let spectra = CrossSpectra::of(runs, choice, &Segmentation::Equal { length, overlap }, window, options)?;
            Self::of(&spectra, options)
        };
        let mut parts = vec![estimate(choice, lengths.first().copied().unwrap_or(f64::NAN))?];
        for length in lengths.into_iter().skip(1) {
            let seen: Vec<f64> = parts[0].omega.iter().map(|w| w / TAU).filter(|f| f * length >= 2.0).collect();
            match estimate(&Frequencies::List(seen), length) {
                Ok(part) => parts.push(part),
                Err(SpectrumError::NoList(_) | SpectrumError::TooFewAverages { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(Self::weighted(&parts))
    }

    /// Averages estimates of which every one has the last frequencies of the first.
    fn weighted(parts: &[Self]) -> Self {
        let mut whole = parts[0].clone();
        let (m, count) = (whole.inputs, whole.omega.len());
        for k in 0..count {
            // the same frequency in every part that has it
            let shared = || parts.iter().filter_map(move |p| Some((p, (k + p.omega.len()).checked_sub(count)?)));
            for output in 0..whole.outputs {
                let mut total = 0.0;
                for input in 0..m {
                    let at = |p: &Self, k: usize| p.pair(output, input).start + k;
                    let least = shared().map(|(p, k)| p.error[at(p, k)]).fold(f64::INFINITY, f64::min);
                    if !least.is_finite() {
                        continue;
                    }
                    // errors of nothing are all alike
                    let floor = least.max(1e-12);
                    let weight = |p: &Self, k: usize| (floor / p.error[at(p, k)].max(floor)).powi(4);
                    let sum: f64 = shared().map(|(p, k)| weight(p, k)).sum();
                    let mean = |value: &dyn Fn(&Self, usize) -> f64| {
                        let used = shared().filter(|(p, k)| weight(p, *k) > 0.0);
                        used.map(|(p, k)| weight(p, k) * value(p, k)).sum::<f64>() / sum
                    };
                    let to = whole.pair(output, input).start + k;
                    whole.response[to] =
                        Complex64::new(mean(&|p, k| p.response[at(p, k)].re), mean(&|p, k| p.response[at(p, k)].im));
                    whole.partial_coherence[to] = mean(&|p, k| p.partial_coherence[at(p, k)]);
                    whole.error[to] = mean(&|p, k| p.error[at(p, k)].powi(2)).sqrt();
                    whole.averages[k] = mean(&|p, k| p.averages[k]);
                    let coherence = mean(&|p, k| p.coherence[output * p.omega.len() + k]);
                    // of all inputs the one that is known best speaks for the output
                    if floor > 0.0 && 1.0 / floor > total {
                        total = 1.0 / floor;
                        whole.coherence[output * count + k] = coherence;
                    }
                }
            }
        }
        whole
    }
}

/// The inverse of the inputs' densities at one frequency.
struct Conditioned {
    inverse: DMatrix<Complex64>,
}

impl Conditioned {
    /// The number of an input that the others make up, where there is one.
    fn at(spectra: &CrossSpectra, k: usize) -> Result<Self, usize> {
        let m = spectra.inputs;
        let size: Vec<f64> = (0..m).map(|i| spectra.density(i, i, k).re.sqrt()).collect();
        if let Some(none) = size.iter().position(|s| s.is_nan() || *s <= 0.0) {
            return Err(none);
        }
        let scaled = DMatrix::from_fn(m, m, |i, j| spectra.density(i, j, k) / (size[i] * size[j]));
        let Some(factor) = scaled.cholesky() else { return Err(m - 1) };
        let own = |i: usize| factor.l_dirty()[(i, i)].norm_sqr();
        if let Some(dependent) = (0..m).find(|i| own(*i).is_nan() || own(*i) <= OWN_PART) {
            return Err(dependent);
        }
        let mut inverse = factor.inverse();
        for i in 0..m {
            for j in 0..m {
                inverse[(i, j)] /= size[i] * size[j];
            }
        }
        Ok(Self { inverse })
    }
}
