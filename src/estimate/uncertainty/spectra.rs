//! Errors of estimates from spectra, corrected for noise that is not equally strong at all frequencies, and for frequencies closer than one
//! cycle in the record, whose coefficients repeat each other (Morelli and Klein 1997, in the frequency domain):
//! `D [sum_k sum_l S_k* R^-1 Svv(k, l) R^-1 S_l] D`, `Svv(k, l) = s(w_k)^(1/2) C s(w_l)^(1/2) rho(w_k - w_l)`, s the local mean of the residuals' power
//! over all runs, C the correlation of the outputs, both with the leverage correction where fitting took from them.
//!
//! Weights that are estimated from few frequencies cost precision, and the information promises too much: the middle grows by
//! `2 sum_o 2/v(o) (A(o) - A(o) D A(o))`, A the information of one output, v the degrees of freedom of its noise (Kenward and Roger 1997).

use super::bounds::stay;
use super::measured_regressors::RegressorEffect;
use super::sandwich::{Corrected, Ended, Sandwich, Uncorrected};
use super::spectral_colour::SpectralColour;
use super::spectral_rows::{Power, SpectralRows, independent, reach};
use crate::problem::{Problem, ProblemRun};
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Corrects the Cramer-Rao bound at `values`; all responses are of coefficients.
///
/// # Errors
/// [`Uncorrected`] when that is not possible.
pub(super) fn corrected_spectra(problem: &mut Problem<'_>, ended: &Ended<'_>) -> Result<Corrected, Uncorrected> {
    let Ended { sandwich, noise, values, .. } = *ended;
    let Sandwich { unknowns, bound } = sandwich;
    let (q, inverse_noise) = (problem.outputs.len(), noise.inverse());
    let NoiseByFrequency { runs, taken, mut power } = noise_by_frequency(problem, &sandwich, values)?;
    let colour = |(o, name): (usize, &String)| SpectralColour::of(name, o, &runs, &taken);
    let spectral = problem.outputs.iter().enumerate().filter_map(colour).collect();
    // part of the residuals of measured regressors is the noise of others
    let regressors = RegressorEffect::of(problem, &runs, &sandwich, values, noise);
    let part = |o: usize| regressors.as_ref().map_or(1.0, |r| r.parts[o]);
    power.settle(|o| 2.0 * part(o) * noise.covariance[o * q + o]);
    let middles: Result<Vec<_>, _> = runs.par_iter().map(|run| run.middle(&power, &inverse_noise)).collect();
    let mut middle = sandwich.gather(&middles?, &ended.prior());
    let added = estimated_weights(&runs, &sandwich, &inverse_noise);
    middle.iter_mut().zip(&added).for_each(|(m, a)| *m += a);
    if let Some(regressors) = &regressors {
        middle.iter_mut().zip(&regressors.middle).for_each(|(m, c)| *m += c);
    }
    // the bias by that noise is removed
    let mut unbiased = None;
    let mut extrapolated = bound.clone();
    if let Some(mut simex) = regressors.and_then(|regressors| regressors.simex) {
        stay(&bound.inverse, &bound.held, &mut simex.step);
        let mut moved = values.to_vec();
        for (unknown, step) in bound.inverse.chosen.iter().zip(&simex.step) {
            let value = values[*unknown] + step / bound.scale[*unknown];
            moved[*unknown] = value.clamp(unknowns.lower[*unknown], unknowns.upper[*unknown]);
        }
        (unbiased, extrapolated.inverse.values) = (Some(moved), simex.inverse);
    }
    let sandwich = Sandwich { unknowns, bound: &extrapolated };
    let covariance = sandwich.around(&middle);
    if !covariance.iter().all(|v| v.is_finite()) {
        return Err(Uncorrected::NotFinite);
    }
    let places: Vec<Vec<f64>> = runs.iter().enumerate().map(|(r, run)| sandwich.columns(r, run.width)).collect();
    let freedom = freedom(&runs, &power, &inverse_noise, &places, covariance.len().isqrt());
    Ok(Corrected { spectral, freedom, unbiased, ..Corrected::of(covariance) })
}

/// What the residuals of spectra say of their noise.
pub(super) struct NoiseByFrequency {
    /// Sensitivities and residuals of each run.
    pub(super) runs: Vec<SpectralRows>,
    /// What fitting took off the residuals of each run (q by q by M).
    pub(super) taken: Vec<Vec<f64>>,
    /// The local power of the residuals.
    pub(super) power: Power,
}

/// The noise of all runs at these values.
///
/// # Errors
/// [`Uncorrected::NotFinite`]
pub(super) fn noise_by_frequency(
    problem: &mut Problem<'_>,
    sandwich: &Sandwich<'_>,
    values: &[f64],
) -> Result<NoiseByFrequency, Uncorrected> {
    let (q, unknowns) = (problem.outputs.len(), sandwich.unknowns);
    let work = |(r, run): (usize, &mut ProblemRun<'_>)| {
        SpectralRows::new(run, unknowns, &unknowns.assembled(r, values), &sandwich.scale(r))
    };
    let runs: Vec<_> = problem.runs.par_iter_mut().enumerate().map(work).collect();
    let runs: Vec<SpectralRows> = runs.into_iter().collect::<Result<_, _>>()?;
    let taken: Vec<_> = runs.iter().enumerate().map(|(r, run)| run.taken(sandwich, r, q)).collect();
    let power = Power::of(&runs, &taken, q);
    Ok(NoiseByFrequency { runs, taken, power })
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
    // leverage: what fitting takes off the residuals says nothing of the noise
    let told = (1.0 - n as f64 / all).max(0.0);
    sizes.iter().zip(spread).map(|(size, spread)| 2.0 * told * size * size / spread).collect()
}

/// Fewest degrees of freedom by which the noise of an output is known.
const FEWEST: f64 = 2.0;

/// What estimated weights add to the middle (n by n; Kenward and Roger 1997); one output alone needs no weights, and nothing is added.
fn estimated_weights(runs: &[SpectralRows], sandwich: &Sandwich<'_>, weights: &[f64]) -> Vec<f64> {
    let inverse = &sandwich.bound.inverse;
    let n = inverse.chosen.len();
    let known = DMatrix::from_row_slice(n, n, &inverse.values);
    let mut added = DMatrix::zeros(n, n);
    for (o, samples) in sandwich.bound.samples.iter().enumerate() {
        let Some(samples) = samples else { continue };
        let own = information(runs, sandwich, weights, o);
        // leverage: what fitting takes off the residuals
        let freedom = (samples - known.component_mul(&own).sum()).max(FEWEST);
        added += (4.0 / freedom) * (&own - &own * &known * &own);
    }
    added.as_slice().to_vec()
}

/// Fisher's information in one output (n by n).
fn information(runs: &[SpectralRows], sandwich: &Sandwich<'_>, weights: &[f64], output: usize) -> DMatrix<f64> {
    let (n, q) = (sandwich.bound.inverse.chosen.len(), weights.len().isqrt());
    let mut own = DMatrix::zeros(n, n);
    for (r, run) in runs.iter().enumerate() {
        let places = sandwich.places(r);
        let chosen = || places.iter().enumerate().filter_map(|(c, place)| place.map(|place| (c, place)));
        for b in (0..q).filter(|b| weights[output * q + b] != 0.0) {
            for ((c, i), (d, j)) in chosen().flat_map(|left| chosen().map(move |right| (left, right))) {
                let planes = run.plane(output, c).iter().zip(run.plane(b, d));
                let product: f64 = planes.map(|(s, t)| s.re * t.re + s.im * t.im).sum();
                // half of each order, so that it is symmetric
                own[(i, j)] += 0.5 * weights[output * q + b] * product;
                own[(j, i)] += 0.5 * weights[output * q + b] * product;
            }
        }
    }
    own
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_complex::Complex64;

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
        let power = Power::of(&runs, &[vec![0.0; count]], 1);
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
