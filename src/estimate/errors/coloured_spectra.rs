//! Errors of estimates from spectra, corrected for noise that is not equally strong at all frequencies, and for frequencies closer than one
//! cycle in the record, whose coefficients repeat each other (Morelli and Klein 1997, in the frequency domain):
//! `D [sum_k sum_l S_k* R^-1 Svv(k, l) R^-1 S_l] D`, `Svv(k, l) = s(w_k)^(1/2) C s(w_l)^(1/2) rho(w_k - w_l)`.
//!
//! s is the local mean of the residuals' power over all runs, C the correlation of the outputs.

use super::carried::Carried;
use super::coloured::Corrected;
use super::conclusion::Conclusion;
use super::noise_colour::Uncorrected;
use super::sandwich::Sandwich;
use crate::estimate::iteration::priors::PriorRow;
use crate::estimate::problem::{Problem, ProblemRun};
use crate::estimate::unknowns::Unknowns;
use crate::simulate::Block;
use crate::spectrum::Overlap;
use num_complex::Complex64;
use rayon::prelude::*;

/// Part of the band over which the power of the residuals is averaged, to each side.
const REACH: f64 = 0.08;
/// Fewest independent coefficients in such a mean.
const FEWEST: f64 = 12.0;

/// Corrects the covariance of a conclusion at `values`; all responses are of coefficients.
///
/// # Errors
/// [`Uncorrected`] when that is not possible.
pub(in crate::estimate) fn corrected_spectra(
    problem: &mut Problem<'_>,
    unknowns: &Unknowns,
    values: &[f64],
    conclusion: &Conclusion,
    priors: impl Iterator<Item = PriorRow>,
) -> Result<Corrected, Uncorrected> {
    let noise = conclusion.noise.as_ref().ok_or(Uncorrected::NoDegreesOfFreedom)?;
    if conclusion.inverse.chosen.is_empty() {
        return Err(Uncorrected::NoDegreesOfFreedom);
    }
    let (q, inverse_noise) = (problem.outputs.len(), noise.inverse());
    let sandwich = Sandwich { unknowns, conclusion };
    let work = |(r, run): (usize, &mut ProblemRun<'_>)| {
        let mut theta = unknowns.theta[r].clone();
        unknowns.assemble(r, values, &mut theta);
        SpectralRows::new(run, unknowns, &theta, &sandwich.scale(r))
    };
    let runs: Vec<_> = problem.runs.par_iter_mut().enumerate().map(work).collect();
    let runs: Vec<SpectralRows> = runs.into_iter().collect::<Result<_, _>>()?;
    let mut power = Power::of(&runs, q);
    // where records stand in the equations part of their residuals is the noise of others
    let carried = Carried::of(problem, &runs, &sandwich, values, noise);
    let part = |o: usize| carried.as_ref().map_or(1.0, |c| c.parts[o]);
    power.settle(|o| 2.0 * part(o) * noise.covariance[o * q + o]);
    let middles: Result<Vec<_>, _> = runs.par_iter().map(|run| run.middle(&power, &inverse_noise)).collect();
    let mut middle = sandwich.gather(&middles?, &sandwich.prior(priors));
    if let Some(carried) = &carried {
        middle.iter_mut().zip(&carried.middle).for_each(|(m, c)| *m += c);
    }
    // what that noise has drawn the estimates by is taken off
    let mut unbiased = None;
    let mut without_noise = conclusion.clone();
    if let Some(undone) = carried.and_then(|carried| carried.undone) {
        let mut moved = values.to_vec();
        for (unknown, step) in conclusion.inverse.chosen.iter().zip(&undone.step) {
            let value = values[*unknown] + step / conclusion.scale[*unknown];
            moved[*unknown] = value.clamp(unknowns.lower[*unknown], unknowns.upper[*unknown]);
        }
        (unbiased, without_noise.inverse.values) = (Some(moved), undone.inverse);
    }
    let sandwich = Sandwich { unknowns, conclusion: &without_noise };
    let covariance = sandwich.around(&middle);
    if !covariance.iter().all(|v| v.is_finite()) {
        return Err(Uncorrected::NotFinite);
    }
    let places: Vec<Vec<f64>> = runs.iter().enumerate().map(|(r, run)| sandwich.columns(r, run.width)).collect();
    let freedom = freedom(&runs, &power, &inverse_noise, &places, covariance.len().isqrt());
    Ok(Corrected { values: covariance, colours: Vec::new(), freedom, unbiased })
}

/// Degrees of freedom of the `n` corrected variances (Satterthwaite): each is a sum over frequencies of local means of the residuals' power,
/// and the power of one coefficient scatters as much as it is large. `places` are the columns of the Cramer-Rao covariance (width by n).
fn freedom(runs: &[SpectralRows], power: &Power, inverse_noise: &[f64], places: &[Vec<f64>], n: usize) -> Vec<f64> {
    let density = independent(runs);
    let (mut sizes, mut spread, mut all) = (vec![0.0; n], vec![0.0; n], 0.0);
    for o in 0..power.outputs.len() {
        let mut shares: Vec<(f64, Vec<f64>)> = Vec::new();
        for (run, places) in runs.iter().zip(places) {
            run.add_shares(o, power, inverse_noise, places, &mut shares);
        }
        shares.sort_by(|a, b| a.0.total_cmp(&b.0));
        let Some((first, last)) = shares.first().zip(shares.last()) else { continue };
        let band = last.0 - first.0;
        let reach = reach(band, density);
        // closer than one cycle in the record they repeat each other
        let worth = ((density * band + 1.0) / shares.len() as f64).min(1.0);
        all += 2.0 * worth * shares.len() as f64;
        // what each coefficient adds through the local means in which it stands
        let mut through = vec![0.0; shares.len() * n];
        for (w, own) in &shares {
            let begin = shares.partition_point(|(v, _)| *v < w - reach);
            let near = shares[begin..].iter().take_while(|(v, _)| *v <= w + reach);
            let weights: Vec<f64> = near.map(|(v, _)| 1.0 - (v - w).abs() / reach).collect();
            let total: f64 = weights.iter().sum();
            for (k, weight) in weights.iter().enumerate() {
                let to = &mut through[(begin + k) * n..][..n];
                to.iter_mut().zip(own).for_each(|(to, own)| *to += own * weight / total);
            }
        }
        for (k, part) in through.iter().enumerate() {
            sizes[k % n] += part;
            spread[k % n] += part * part / worth;
        }
    }
    // what fitting takes off tells nothing of the noise
    let told = (1.0 - n as f64 / all).max(0.0);
    sizes.iter().zip(spread).map(|(size, spread)| 2.0 * told * size * size / spread).collect()
}

/// How far a local mean reaches to each side.
fn reach(band: f64, density: f64) -> f64 {
    (REACH * band).max(FEWEST / density).min(band.max(f64::MIN_POSITIVE))
}

/// One run at the estimates.
pub(super) struct SpectralRows {
    pub(super) omega: Vec<f64>,
    samples: usize,
    dt: f64,
    /// Columns, a multiple of 8.
    width: usize,
    /// Scaled sensitivities: for each output and column a plane of M.
    planes: Vec<Complex64>,
    /// Residuals, q by M; NaN where nothing is compared.
    residuals: Vec<Complex64>,
}

impl SpectralRows {
    fn new(run: &mut ProblemRun<'_>, unknowns: &Unknowns, theta: &[f64], scale: &[f64]) -> Result<Self, Uncorrected> {
        let (n, q, width) = (run.response.samples(), run.response.outputs(), scale.len().next_multiple_of(8));
        let count = n / 2;
        let mut rows = Self {
            omega: Vec::new(),
            samples: 0,
            dt: 0.0,
            width,
            planes: vec![Complex64::ZERO; q * width * count],
            residuals: vec![Complex64::new(f64::NAN, f64::NAN); q * count],
        };
        let measured = &run.measured;
        let streamed = run.response.sensitivities(theta, &unknowns.columns, &mut |block: Block<'_>| {
            for (sample, o) in (0..block.samples()).flat_map(|s| (0..q).map(move |o| (s, o))) {
                let at = block.first + sample;
                let (k, z) = (at / 2, measured[at * q + o]);
                if z.is_nan() {
                    continue;
                }
                set(&mut rows.residuals[o * count + k], at, z - block.y[sample * q + o]);
                for (c, value) in block.layout.outputs[o].columns.iter().zip(block.row(sample, o)) {
                    let c = *c as usize;
                    if scale[c] > 0.0 {
                        set(&mut rows.planes[(o * width + c) * count + k], at, value / scale[c]);
                    }
                }
            }
        });
        streamed.map_err(|_| Uncorrected::NotFinite)?;
        let coefficients = run.response.coefficients().ok_or(Uncorrected::NotFinite)?;
        (rows.omega, rows.samples, rows.dt) = (coefficients.omega.to_vec(), coefficients.samples, coefficients.dt);
        Ok(rows)
    }

    fn plane(&self, output: usize, column: usize) -> &[Complex64] {
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

    /// Adds, for each frequency, the share of an output's noise there in every variance.
    fn add_shares(
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

    /// Sum over all pairs of frequencies of `S* R^-1 Svv R^-1 S` (width by width).
    fn middle(&self, power: &Power, inverse_noise: &[f64]) -> Result<Vec<f64>, Uncorrected> {
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

/// The power of the noise of each output over frequency, and how the outputs correlate.
struct Power {
    /// For each output (frequency, smoothed power), rising.
    outputs: Vec<Vec<(f64, f64)>>,
    /// q by q.
    correlations: Vec<f64>,
}

impl Power {
    fn of(runs: &[SpectralRows], q: usize) -> Self {
        let smooth = |o: usize| {
            let mut raw: Vec<(f64, f64)> = Vec::new();
            for run in runs {
                let residuals = &run.residuals[o * run.omega.len()..][..run.omega.len()];
                let compared = run.omega.iter().zip(residuals).filter(|(_, v)| !v.is_nan());
                raw.extend(compared.map(|(w, v)| (*w, v.norm_sqr())));
            }
            raw.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
            smoothed(&raw, independent(runs))
        };
        let mut power = Self { outputs: (0..q).map(smooth).collect(), correlations: vec![0.0; q * q] };
        let mut sums = vec![0.0; q * q];
        for (run, a, b) in runs.iter().flat_map(|r| (0..q * q).map(move |k| (r, k / q, k % q))) {
            for (k, w) in run.omega.iter().enumerate() {
                let [va, vb] = [a, b].map(|o| run.residuals[o * run.omega.len() + k] / power.at(o, *w).sqrt());
                let product = va.re * vb.re + va.im * vb.im;
                sums[a * q + b] += if product.is_nan() { 0.0 } else { product };
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
    fn settle(&mut self, mean: impl Fn(usize) -> f64) {
        for (o, power) in self.outputs.iter_mut().enumerate() {
            let sum: f64 = power.iter().map(|(_, p)| p).sum();
            let factor = mean(o) * power.len() as f64 / sum;
            power.iter_mut().filter(|_| factor.is_finite()).for_each(|(_, p)| *p *= factor);
        }
    }

    /// The power at a frequency: on the line between neighbours.
    fn at(&self, output: usize, w: f64) -> f64 {
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
fn independent(runs: &[SpectralRows]) -> f64 {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// One output at `count` frequencies, a cycle in the record apart, one column that is `size` there.
    fn known(count: usize, size: impl Fn(usize) -> f64) -> f64 {
        let (samples, dt) = (4 * count, 0.1);
        let spacing = std::f64::consts::TAU / (samples as f64 * dt);
        let mut planes = vec![Complex64::ZERO; 8 * count];
        (0..count).for_each(|k| planes[k].re = size(k));
        let omega: Vec<f64> = (1..=count).map(|k| spacing * k as f64).collect();
        let residuals = vec![Complex64::new(1.0, 0.0); count];
        let run = SpectralRows { omega, samples, dt, width: 8, planes, residuals };
        let runs = [run];
        let power = Power::of(&runs, 1);
        let mut places = vec![0.0; 8];
        places[0] = 1.0;
        freedom(&runs, &power, &[1.0], &[places], 1)[0]
    }

    #[test]
    fn noise_at_all_frequencies_is_known_by_all_and_at_few_by_their_neighbours() {
        let all = known(400, |_| 1.0);
        assert!((all / 799.0 - 1.0).abs() < 0.03, "{all}");
        // a triangle of 32 to each side has the spread of a mean over 48
        let few = known(400, |k| if k == 200 { 1.0 } else { 0.0 });
        assert!((few / 96.0 - 1.0).abs() < 0.05, "{few}");
        // what a short record has are the 12 frequencies on each side
        let short = known(10, |_| 1.0);
        assert!(short > 10.0 && short < 20.0, "{short}");
    }
}
