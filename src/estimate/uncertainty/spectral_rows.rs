//! Sensitivities and residuals of one run by frequency, and the local power of the noise: a mean of what is left over neighbouring frequencies.

use super::sandwich::{Sandwich, Uncorrected};
use crate::problem::ProblemRun;
use crate::problem::response::RunResponse;
use crate::problem::unknowns::Unknowns;
use fdm_system::simulate::Block;
use fdm_system::spectrum::Overlap;
use num_complex::Complex64;

/// One run at the estimates.
pub(super) struct SpectralRows {
    pub(super) omega: Vec<f64>,
    pub(super) samples: usize,
    pub(super) dt: f64,
    /// Columns, a multiple of 8.
    pub(super) width: usize,
    /// Scaled sensitivities: for each output and column a plane of M.
    pub(super) planes: Vec<Complex64>,
    /// Residuals, q by M; NaN where nothing is compared.
    pub(super) residuals: Vec<Complex64>,
}

impl SpectralRows {
    pub(super) fn new(
        run: &mut ProblemRun<'_>,
        unknowns: &Unknowns,
        theta: &[f64],
        scale: &[f64],
    ) -> Result<Self, Uncorrected> {
        let RunResponse::Coefficients(response) = &mut run.response else { return Err(Uncorrected::NotFinite) };
        let (n, q, width) = (response.samples(), response.outputs(), scale.len().next_multiple_of(8));
        let count = n / 2;
        let coefficients = response.coefficients();
        let mut rows = Self {
            omega: coefficients.omega.to_vec(),
            samples: coefficients.samples,
            dt: coefficients.dt,
            width,
            planes: vec![Complex64::ZERO; q * width * count],
            residuals: vec![Complex64::new(f64::NAN, f64::NAN); q * count],
        };
        let measured = &run.measured;
        let streamed = response.sensitivities(theta, &unknowns.columns, &mut |block: Block<'_>| {
            for (sample, o) in (0..block.samples()).flat_map(|s| (0..q).map(move |o| (s, o))) {
                let at = block.first + sample;
                let k = at / 2;
                if measured[at * q + o].is_nan() {
                    continue;
                }
                set(&mut rows.residuals[o * count + k], at, block.residual(measured, sample, o));
                for (c, value) in block.layout.outputs[o].columns.iter().zip(block.row(sample, o)) {
                    let c = *c as usize;
                    if scale[c] > 0.0 {
                        set(&mut rows.planes[(o * width + c) * count + k], at, value / scale[c]);
                    }
                }
            }
        });
        streamed.map_err(|_| Uncorrected::NotFinite)?;
        Ok(rows)
    }

    pub(super) fn plane(&self, output: usize, column: usize) -> &[Complex64] {
        &self.planes[(output * self.width + column) * self.omega.len()..][..self.omega.len()]
    }

    /// `S' R^-1` times a change of the residuals (2 M by q), for each column.
    pub(super) fn score(&self, change: &[f64], inverse_noise: &[f64]) -> Vec<f64> {
        let (count, q) = (self.omega.len(), self.residuals.len() / self.omega.len().max(1));
        let mut score = vec![0.0; self.width];
        for (a, k) in (0..q).flat_map(|a| (0..count).map(move |k| (a, k))) {
            let weighed = |part: usize| -> f64 {
                let each = (0..q).map(|b| inverse_noise[a * q + b] * change[(2 * k + part) * q + b]);
                each.filter(|v| v.is_finite()).sum()
            };
            let (re, im) = (weighed(0), weighed(1));
            for (c, sum) in score.iter_mut().enumerate() {
                let s = self.plane(a, c)[k];
                *sum += s.re * re + s.im * im;
            }
        }
        score
    }

    /// `S d` for a step d of the columns (2 M by q).
    pub(super) fn explained(&self, step: &[f64], q: usize) -> Vec<f64> {
        let count = self.omega.len();
        let mut explained = vec![0.0; 2 * count * q];
        for (o, (c, step)) in (0..q).flat_map(|o| step.iter().enumerate().map(move |column| (o, column))) {
            for (k, s) in self.plane(o, c).iter().enumerate().filter(|_| *step != 0.0) {
                explained[2 * k * q + o] += s.re * step;
                explained[(2 * k + 1) * q + o] += s.im * step;
            }
        }
        explained
    }

    /// The residuals (2 M by q); NaN where nothing is compared.
    pub(super) fn residuals(&self, q: usize) -> Vec<f64> {
        let count = self.omega.len();
        let value = |row: usize, o: usize| {
            let v = self.residuals[o * count + row / 2];
            if row.is_multiple_of(2) { v.re } else { v.im }
        };
        (0..2 * count * q).map(|k| value(k / q, k % q)).collect()
    }

    /// Leverage correction: what fitting takes off the products of the outputs' noise at each frequency, `Re S D S*` (q by q by M): more where the parameters show, and with the
    /// weights' sign between outputs that determine the same parameter.
    pub(super) fn taken(&self, sandwich: &Sandwich<'_>, run: usize, q: usize) -> Vec<f64> {
        let (count, inverse) = (self.omega.len(), &sandwich.bound.inverse);
        let n = inverse.chosen.len();
        let places = sandwich.places(run);
        let columns: Vec<(usize, usize)> = places.iter().enumerate().filter_map(|(c, p)| p.map(|p| (c, p))).collect();
        let mut taken = vec![0.0; q * q * count];
        for (k, b) in (0..count).flat_map(|k| (0..q).map(move |b| (k, b))) {
            let row = |i: usize| -> Complex64 {
                columns.iter().map(|(d, j)| self.plane(b, *d)[k] * inverse.values[i * n + j]).sum()
            };
            let spread: Vec<Complex64> = columns.iter().map(|(_, i)| row(*i)).collect();
            for a in 0..q {
                let parts = columns.iter().zip(&spread).map(|((c, _), s)| (self.plane(a, *c)[k], s));
                taken[(a * q + b) * count + k] = parts.map(|(s, t)| s.re * t.re + s.im * t.im).sum();
            }
        }
        taken
    }

    /// Adds, for each frequency, the share of an output's noise there in every variance.
    pub(super) fn add_shares(
        &self,
        output: usize,
        power: &Power,
        inverse_noise: &[f64],
        places: &[f64],
        shares: &mut Vec<(f64, Vec<f64>)>,
    ) {
        let (count, q) = (self.omega.len(), power.outputs.len());
        let n = places.len() / self.width.max(1);
        for (k, w) in self.omega.iter().enumerate().filter(|(k, _)| !self.residuals[output * count + k].is_nan()) {
            let mut sums = vec![Complex64::ZERO; n];
            for c in 0..self.width {
                let parts = (0..q).map(|b| inverse_noise[output * q + b] * self.plane(b, c)[k]);
                let value: Complex64 = parts.sum();
                if value != Complex64::ZERO {
                    sums.iter_mut().zip(&places[c * n..]).for_each(|(s, d)| *s += value * d);
                }
            }
            let local = 0.5 * power.at(output, *w);
            shares.push((*w, sums.iter().map(|s| local * s.norm_sqr()).collect()));
        }
    }

    /// What the noise of an output adds to each of n estimates, in units of the local noise: `D S* R^-1` (n by M). `places` are the columns of
    /// the Cramer-Rao covariance (width by n).
    pub(super) fn influence(
        &self,
        output: usize,
        power: &Power,
        inverse_noise: &[f64],
        places: &[f64],
    ) -> Vec<Complex64> {
        let (count, q) = (self.omega.len(), power.outputs.len());
        let n = places.len() / self.width.max(1);
        let mut all = vec![Complex64::ZERO; n * count];
        for (c, places) in places.chunks_exact(n.max(1)).enumerate() {
            for (k, w) in self.omega.iter().enumerate() {
                let weighed: Complex64 = (0..q).map(|b| inverse_noise[output * q + b] * self.plane(b, c)[k]).sum();
                if weighed != Complex64::ZERO {
                    let local = power.at(output, *w).sqrt() * weighed;
                    places.iter().enumerate().for_each(|(i, d)| all[i * count + k] += local * d);
                }
            }
        }
        all
    }

    /// Sum over all pairs of frequencies of `S* R^-1 Svv R^-1 S` (width by width).
    pub(super) fn middle(&self, power: &Power, inverse_noise: &[f64]) -> Result<Vec<f64>, Uncorrected> {
        let (count, width, q) = (self.omega.len(), self.width, power.outputs.len());
        let mut overlap = Overlap::new(&self.omega, self.samples, self.dt).ok_or(Uncorrected::TooLarge)?;
        let spread: Vec<Vec<f64>> =
            (0..q).map(|o| self.omega.iter().map(|w| power.at(o, *w).sqrt()).collect()).collect();
        // R^-1 S in units of the local noise, then what its neighbours make of it
        let mut weighed = vec![Complex64::ZERO; q * width * count];
        for (a, c) in (0..q).flat_map(|a| (0..width).map(move |c| (a, c))) {
            for b in (0..q).filter(|b| inverse_noise[a * q + b] != 0.0) {
                let (factor, from) = (inverse_noise[a * q + b], self.plane(b, c));
                let to = &mut weighed[(a * width + c) * count..][..count];
                to.iter_mut().zip(from).for_each(|(to, from)| *to += factor * from);
            }
            let to = &mut weighed[(a * width + c) * count..][..count];
            to.iter_mut().zip(&spread[a]).for_each(|(to, s)| *to *= s);
        }
        let mut gathered = weighed.clone();
        for (from, to) in weighed.chunks(count).zip(gathered.chunks_mut(count)) {
            if from.iter().any(|v| *v != Complex64::ZERO) {
                overlap.gather(from, to);
            }
        }
        let mut middle = vec![0.0; width * width];
        for (a, b) in (0..q).flat_map(|a| (0..q).map(move |b| (a, b))) {
            let correlation = 0.5 * power.correlations[a * q + b];
            for (i, j) in (0..width).flat_map(|i| (0..width).map(move |j| (i, j))).filter(|_| correlation != 0.0) {
                let (left, right) = (&weighed[(a * width + i) * count..], &gathered[(b * width + j) * count..]);
                let product = left[..count].iter().zip(right).map(|(l, r)| l.re * r.re + l.im * r.im);
                middle[i * width + j] += correlation * product.sum::<f64>();
            }
        }
        Ok(middle)
    }
}

/// Sets the real part at even samples, the imaginary part at odd ones.
fn set(to: &mut Complex64, sample: usize, value: f64) {
    if sample.is_multiple_of(2) {
        to.re = value;
    } else {
        to.im = value;
    }
}

/// Part of the band over which the power of the residuals is averaged, to each side.
const REACH: f64 = 0.08;
/// Fewest independent coefficients in such a mean.
const FEWEST: f64 = 12.0;

/// The power of the noise of each output over frequency, and how the outputs correlate.
pub(super) struct Power {
    /// For each output (frequency, smoothed power), rising.
    pub(super) outputs: Vec<Vec<(f64, f64)>>,
    /// q by q.
    pub(super) correlations: Vec<f64>,
}

impl Power {
    /// From the residuals and their leverage corrections in each run (q by q by M).
    pub(super) fn of(runs: &[SpectralRows], taken: &[Vec<f64>], q: usize) -> Self {
        let smooth = |o: usize| {
            let mut raw: Vec<(f64, f64)> = Vec::new();
            for (run, taken) in runs.iter().zip(taken) {
                let count = run.omega.len();
                let own = run.residuals[o * count..].iter().zip(&taken[(o * q + o) * count..]);
                let compared = run.omega.iter().zip(own).filter(|(_, (v, _))| !v.is_nan());
                raw.extend(compared.map(|(w, (v, taken))| (*w, v.norm_sqr() + taken)));
            }
            raw.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
            smoothed(&raw, independent(runs))
        };
        let mut power = Self { outputs: (0..q).map(smooth).collect(), correlations: vec![0.0; q * q] };
        let mut sums = vec![0.0; q * q];
        let pairs = |of| (0..q * q).map(move |k| (of, k / q, k % q));
        for ((run, taken), a, b) in runs.iter().zip(taken).flat_map(pairs) {
            let count = run.omega.len();
            for (k, w) in run.omega.iter().enumerate() {
                let [va, vb] = [a, b].map(|o| run.residuals[o * count + k]);
                let product = va.re * vb.re + va.im * vb.im + taken[(a * q + b) * count + k];
                let part = product / (power.at(a, *w) * power.at(b, *w)).sqrt();
                sums[a * q + b] += if part.is_nan() { 0.0 } else { part };
            }
        }
        for (a, b) in (0..q).flat_map(|a| (0..q).map(move |b| (a, b))) {
            let size = (sums[a * q + a] * sums[b * q + b]).sqrt();
            power.correlations[a * q + b] = match size {
                _ if a == b => 1.0,
                size if size > 0.0 => sums[a * q + b] / size,
                _ => 0.0,
            };
        }
        power
    }

    /// Scales the power of each output to this mean: what fitting took off is put back.
    pub(super) fn settle(&mut self, mean: impl Fn(usize) -> f64) {
        for (o, power) in self.outputs.iter_mut().enumerate() {
            let sum: f64 = power.iter().map(|(_, p)| p).sum();
            let factor = mean(o) * power.len() as f64 / sum;
            power.iter_mut().filter(|_| factor.is_finite()).for_each(|(_, p)| *p *= factor);
        }
    }

    /// The power at a frequency: on the line between neighbours.
    pub(super) fn at(&self, output: usize, w: f64) -> f64 {
        let power = &self.outputs[output];
        let behind = power.partition_point(|(v, _)| *v < w);
        match (behind.checked_sub(1).and_then(|k| power.get(k)), power.get(behind)) {
            (Some((v, p)), Some((u, r))) if u > v => p + (r - p) * (w - v) / (u - v),
            (_, Some((_, p))) | (Some((_, p)), None) => *p,
            (None, None) => 0.0,
        }
    }
}

/// Independent coefficients in all runs, per unit of angular frequency.
pub(super) fn independent(runs: &[SpectralRows]) -> f64 {
    runs.iter().map(|r| r.samples as f64 * r.dt / std::f64::consts::TAU).sum()
}

/// Local means over a triangle; `density` is the number of independent coefficients per unit of frequency.
fn smoothed(raw: &[(f64, f64)], density: f64) -> Vec<(f64, f64)> {
    let Some((first, last)) = raw.first().zip(raw.last()) else { return Vec::new() };
    let band = last.0 - first.0;
    let reach = reach(band, density);
    let mut result: Vec<(f64, f64)> = Vec::new();
    for (w, _) in raw {
        if result.last().is_some_and(|(v, _)| v == w) {
            continue;
        }
        let begin = raw.partition_point(|(v, _)| *v < w - reach);
        let near = raw[begin..].iter().take_while(|(v, _)| *v <= w + reach);
        let (mut sum, mut weights) = (0.0, 0.0);
        for (v, p) in near {
            let weight = 1.0 - (v - w).abs() / reach;
            (sum, weights) = (sum + weight * p, weights + weight);
        }
        result.push((*w, sum / weights));
    }
    result
}

/// How far a local mean reaches to each side.
pub(super) fn reach(band: f64, density: f64) -> f64 {
    (REACH * band).max(FEWEST / density).min(band.max(f64::MIN_POSITIVE))
}
