//! Errors of the estimates corrected for the colour of the residuals (Morelli and Klein 1997):
//! `D [sum_i S_i' R^-1 sum_j Rvv(i - j) R^-1 S_j] D`, with Rvv an autoregression for each output whose innovations correlate.
//!
//! Fitting takes from the residuals what the parameters can imitate, most of it where the sensitivities are; an
//! autocovariance of fitted residuals is too small there. The autoregression is therefore the one that, fitted, would leave
//! the autocovariances that were found: what fitting takes off is computed exactly and added, until nothing changes.
//!
//! So for runs that are long and evenly sampled; what the others do is [`super::short_runs`].

use super::coloured_rows::{Colour, ColouredRows, Filtered, sampling};
use super::conclusion::Conclusion;
use super::freedom;
use super::noise_colour::{NoiseColour, Uncorrected};
use super::sandwich::Sandwich;
use super::short_runs::ShortRuns;
use crate::estimate::iteration::priors::PriorRow;
use crate::estimate::problem::{Problem, ProblemRun};
use crate::estimate::unknowns::Unknowns;
use crate::quality::autocovariance::Lagged;
use crate::quality::autoregression::AutoRegression;
use crate::quality::colour;
use crate::quality::ladder::Ladder;
use crate::quality::sampling::Sampling;
use rayon::prelude::*;

/// Rounds until the autoregression reproduces what was found.
const ROUNDS: usize = 12;
/// Rounds in which the orders may change.
const SETTLING: usize = 6;
/// Change of the autocovariances, relative to the variance, that ends the rounds.
const SETTLED: f64 = 1e-3;
/// Most numbers of all sensitivities together (half a gigabyte with what is made of them).
const MOST_NUMBERS: usize = 20_000_000;
/// Compared samples of a run for each output from which on it tells its colour alone.
const LONG: usize = 500;

/// The corrected covariance.
pub(in crate::estimate) struct Corrected {
    /// In scaled unknowns, chosen by chosen, as that of the conclusion.
    pub(in crate::estimate) values: Vec<f64>,
    /// What was found.
    pub(in crate::estimate) colours: Vec<NoiseColour>,
    /// Degrees of freedom of each variance; empty where they are not known.
    pub(in crate::estimate) freedom: Vec<f64>,
    /// All unknowns without what the noise of records in the equations has drawn them by; none where nothing has.
    pub(in crate::estimate) unbiased: Option<Vec<f64>>,
}

/// Corrects the covariance of a conclusion at `values`.
///
/// # Errors
/// [`Uncorrected`] when that is not possible.
pub(in crate::estimate) fn corrected(
    problem: &mut Problem<'_>,
    unknowns: &Unknowns,
    values: &[f64],
    conclusion: &Conclusion,
    priors: impl Iterator<Item = PriorRow>,
) -> Result<Corrected, Uncorrected> {
    let noise = conclusion.noise.as_ref().ok_or(Uncorrected::NoDegreesOfFreedom)?;
    if conclusion.inverse.chosen.is_empty() {
        // all at their bounds, or without any effect
        return Err(Uncorrected::NoDegreesOfFreedom);
    }
    let sandwich = Sandwich { unknowns, conclusion };
    let runs = rows(problem, &sandwich, values)?;
    let inverse_noise = noise.inverse();
    let prior = sandwich.prior(priors);
    let short = ShortRuns::of(&runs, &sandwich, noise, &prior)?;
    let mut long: Vec<LongRun> =
        (0..runs.len()).filter(|r| is_long(&runs[*r])).map(|r| LongRun::new(r, &runs)).collect();
    for round in 0.. {
        let filtered: Vec<Filtered> = long.par_iter().map(|l| runs[l.run].filter(&l.colour, &inverse_noise)).collect();
        let mut middles: Vec<Vec<f64>> = runs.iter().map(|r| vec![0.0; r.width * r.width]).collect();
        long.iter().zip(&filtered).for_each(|(l, f)| middles[l.run].clone_from(&f.middle));
        let others = sandwich.gather(&middles, &prior);
        let mut middle = others.clone();
        if let Some(short) = &short {
            middle.iter_mut().zip(&short.middle).for_each(|(m, own)| *m += own);
        }
        let mut covariance = sandwich.around(&middle);
        if !covariance.iter().all(|v| v.is_finite()) {
            return Err(Uncorrected::NotFinite);
        }
        let change = if round + 1 < ROUNDS {
            let improve = |(l, f): (&mut LongRun, &Filtered)| {
                let rows = &runs[l.run];
                l.improve(rows, f, &sandwich.of_run(l.run, &covariance, rows.width), round < SETTLING)
            };
            long.iter_mut().zip(&filtered).map(improve).fold(0.0, f64::max)
        } else {
            0.0
        };
        if change < SETTLED {
            let mut freedom = known_by(&long, &runs, &sandwich, &inverse_noise, &covariance);
            let mut colours: Vec<NoiseColour> = long.iter().flat_map(|l| l.report(problem, &runs)).collect();
            if let Some(short) = &short {
                short.settle(&sandwich, &others, &mut covariance, &mut freedom)?;
                colours.extend(short.report(problem, &noise.covariance));
            }
            return Ok(Corrected { values: covariance, colours, freedom, unbiased: None });
        }
    }
    Err(Uncorrected::NotFinite)
}

/// How well the corrected variances are known.
fn known_by(
    long: &[LongRun],
    runs: &[ColouredRows],
    sandwich: &Sandwich<'_>,
    inverse_noise: &[f64],
    covariance: &[f64],
) -> Vec<f64> {
    let n = covariance.len().isqrt();
    let places: Vec<Vec<f64>> = long.iter().map(|l| sandwich.columns(l.run, runs[l.run].width)).collect();
    let pairs = |l: &LongRun| l.found.iter().map(|f| f.pairs[0] as f64).collect::<Vec<f64>>();
    let all: f64 = long.iter().flat_map(pairs).sum();
    // what fitting takes off tells nothing of the noise
    let told = (1.0 - n as f64 / all).max(0.0);
    let mut known = Vec::with_capacity(long.len());
    for (l, places) in long.iter().zip(&places) {
        let samples = pairs(l).iter().map(|count| count * told).collect();
        known.push(freedom::Known { rows: &runs[l.run], places, colour: &l.colour, samples });
    }
    let variances: Vec<f64> = (0..n).map(|j| covariance[j * n + j]).collect();
    freedom::freedom(&known, inverse_noise, &variances)
}

/// Sensitivities and residuals of all runs.
fn rows(problem: &mut Problem<'_>, sandwich: &Sandwich<'_>, values: &[f64]) -> Result<Vec<ColouredRows>, Uncorrected> {
    let unknowns = sandwich.unknowns;
    let width = unknowns.columns.len().next_multiple_of(8);
    let grids: Vec<_> = problem.runs.iter().map(sampling).collect();
    let length =
        |(r, g): (&ProblemRun<'_>, &Option<Sampling>)| g.as_ref().map_or(r.response.samples(), Sampling::length);
    let samples = problem.runs.iter().zip(&grids).map(|(r, g)| length((r, g)) * r.response.outputs());
    let numbers = samples.sum::<usize>() * width;
    if numbers > MOST_NUMBERS {
        return Err(Uncorrected::TooLarge);
    }
    let work = |(r, (run, grid)): (usize, (&mut ProblemRun<'_>, &Option<Sampling>))| {
        let theta = unknowns.assembled(r, values);
        ColouredRows::new(run, unknowns, &theta, &sandwich.scale(r), grid.as_ref()).map_err(|_| Uncorrected::NotFinite)
    };
    problem.runs.par_iter_mut().zip(&grids).enumerate().map(work).collect()
}

/// Whether a run tells the colour of its noise by itself.
pub(super) fn is_long(run: &ColouredRows) -> bool {
    let compared = |v: &Vec<f64>| v.iter().filter(|v| !v.is_nan()).count();
    run.even && run.residuals.iter().map(compared).filter(|n| *n > 0).min().is_some_and(|n| n >= LONG)
}

/// A run that tells the colour of its noise by itself.
struct LongRun {
    run: usize,
    /// Lagged products of the residuals of each output (q).
    found: Vec<Lagged>,
    /// Autocovariances of the noise of each output, as far as they are known.
    autocovariances: Vec<Vec<f64>>,
    colour: Colour,
}

impl LongRun {
    fn new(run: usize, runs: &[ColouredRows]) -> Self {
        let rows = &runs[run];
        let lagged = |v: &Vec<f64>| {
            let mut lagged = Lagged::none(colour::most_order(v.iter().filter(|v| !v.is_nan()).count()));
            lagged.add(v);
            lagged
        };
        let found: Vec<Lagged> = rows.residuals.iter().map(lagged).collect();
        // a taper makes the means over fewer pairs those of a stationary process
        let left = |k: usize| 1.0 - k as f64 / rows.length as f64;
        let tapered = |l: &Lagged| l.means().enumerate().map(|(k, m)| m * left(k)).collect();
        let autocovariances = found.iter().map(tapered).collect();
        let colour = Colour { models: Vec::new(), innovations: Vec::new() };
        let mut long = Self { run, found, autocovariances, colour };
        long.choose(rows, true);
        long
    }

    /// Chooses the models for the current autocovariances; with their old orders unless `free`.
    fn choose(&mut self, rows: &ColouredRows, free: bool) {
        let choose = |(o, r): (usize, &Vec<f64>)| match self.colour.models.get(o) {
            Some(old) if !free => {
                let order = old.coefficients.len().min(r.len() - 1);
                Ladder::of(&r[..=order]).model(order)
            }
            _ => colour::choose(r, self.found[o].pairs[0]),
        };
        self.colour.models = self.autocovariances.iter().enumerate().map(choose).collect();
        self.colour.innovations = self.innovations(rows);
    }

    /// Covariance of the innovations: variances from the models, correlations from the whitened residuals.
    fn innovations(&self, rows: &ColouredRows) -> Vec<f64> {
        let (models, q) = (&self.colour.models, self.colour.models.len());
        let mut sums = vec![0.0; q * q];
        if q > 1 {
            let series: Vec<_> = models.iter().zip(&rows.residuals).map(|(m, v)| m.innovations(v)).collect();
            for i in 0..rows.length {
                // only samples with all outputs: the correlations then belong together
                if series.iter().all(|s| !s[i].is_nan()) {
                    (0..q * q).for_each(|k| sums[k] += series[k / q][i] * series[k % q][i]);
                }
            }
        }
        let correlation = |a: usize, b: usize| match (sums[a * q + a] * sums[b * q + b]).sqrt() {
            _ if a == b => 1.0,
            size if size > 0.0 => sums[a * q + b] / size,
            _ => 0.0,
        };
        let entry = |(a, b): (usize, usize)| correlation(a, b) * (models[a].variance * models[b].variance).sqrt();
        (0..q * q).map(|k| entry((k / q, k % q))).collect()
    }

    /// Adds to what was found what fitting takes off under the current models; returns the largest relative change.
    fn improve(&mut self, rows: &ColouredRows, filtered: &Filtered, reduced: &[Vec<f64>; 2], free: bool) -> f64 {
        let mut change = 0.0_f64;
        for (o, found) in self.found.iter().enumerate() {
            let most = found.sums.len() - 1;
            let image = &filtered.images[o];
            if rows.bound(o, image, reduced) < SETTLED * found.sums[0] {
                continue;
            }
            let taken = rows.taken(o, image, reduced, most);
            let restored = |k: usize| (found.sums[k] + taken[k]) / found.pairs[k].max(1) as f64;
            let next: Vec<f64> = (0..=most).map(restored).collect();
            if !(next[0] > 0.0 && next.iter().all(|v| v.is_finite())) {
                continue;
            }
            let old = &self.autocovariances[o];
            let largest = next.iter().zip(old).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            change = change.max(largest / next[0]);
            self.autocovariances[o] = next;
        }
        self.choose(rows, free);
        change
    }

    fn report(&self, problem: &Problem<'_>, runs: &[ColouredRows]) -> Vec<NoiseColour> {
        let one = |(o, model): (usize, &AutoRegression)| {
            let names = vec![problem.runs[self.run].name.clone()];
            NoiseColour::new(problem.outputs[o].clone(), names, runs[self.run].interval, model)
        };
        let measured = |(o, _): &(usize, &AutoRegression)| self.found[*o].pairs[0] > 0;
        self.colour.models.iter().enumerate().filter(measured).map(one).collect()
    }
}
