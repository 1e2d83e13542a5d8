//! The power of the noise over frequency, by local means of what is left.

use super::spectral_rows::SpectralRows;

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
    /// From the residuals and what fitting has taken off them in each run (q by q by M), put back where it was taken.
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
