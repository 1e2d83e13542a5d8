//! Errors of the estimates corrected for the colour of the residuals (Morelli and Klein 1997):
//! `D [sum_i S_i' R^-1 sum_j Rvv(i - j) R^-1 S_j] D`, with Rvv an autoregression for each output whose innovations correlate.
//!
//! Fitting takes from the residuals what the parameters can imitate, most of it where the sensitivities are; an
//! autocovariance of fitted residuals is too small there. The autoregression is therefore the one that, fitted, would leave
//! the autocovariances that were found: what fitting takes off is computed exactly and added, until nothing changes.

use super::coloured_rows::{Colour, ColouredRows, Filtered, sampling};
use super::conclusion::Conclusion;
use super::freedom;
use super::noise_colour::{NoiseColour, Uncorrected};
use super::sandwich::Sandwich;
use crate::estimate::iteration::priors::PriorRow;
use crate::estimate::problem::Problem;
use crate::estimate::unknowns::Unknowns;
use crate::quality::autocovariance::Lagged;
use crate::quality::autoregression::AutoRegression;
use crate::quality::colour;
use crate::quality::ladder::Ladder;
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
const LONG: usize = 200;

/// The corrected covariance.
pub(in crate::estimate) struct Corrected {
    /// In scaled unknowns, chosen by chosen, as that of the conclusion.
    pub(in crate::estimate) values: Vec<f64>,
    /// What was found.
    pub(in crate::estimate) colours: Vec<NoiseColour>,
    /// Degrees of freedom of each variance; empty where they are not known.
    pub(in crate::estimate) freedom: Vec<f64>,
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
    let mut groups = Group::all(&runs, problem.outputs.len());
    let prior = sandwich.prior(priors);
    for round in 0.. {
        let filtered = filter(&runs, &groups, &inverse_noise);
        let middles: Vec<&[f64]> = filtered.iter().map(|f| &f.middle[..]).collect();
        let covariance = sandwich.covariance(&middles, &prior);
        if !covariance.iter().all(|v| v.is_finite()) {
            return Err(Uncorrected::NotFinite);
        }
        let change = if round + 1 < ROUNDS {
            let reduced: Vec<_> = (0..runs.len()).map(|r| sandwich.of_run(r, &covariance, runs[r].width)).collect();
            groups.iter_mut().map(|g| g.improve(&runs, &filtered, &reduced, round < SETTLING)).fold(0.0, f64::max)
        } else {
            0.0
        };
        if change < SETTLED {
            let colours = groups.iter().flat_map(|g| g.report(problem, &runs)).collect();
            let freedom = known_by(&groups, &runs, &sandwich, &inverse_noise, &covariance);
            return Ok(Corrected { values: covariance, colours, freedom });
        }
    }
    Err(Uncorrected::NotFinite)
}

/// How well the corrected variances are known.
fn known_by(
    groups: &[Group],
    runs: &[ColouredRows],
    sandwich: &Sandwich<'_>,
    inverse_noise: &[f64],
    covariance: &[f64],
) -> Vec<f64> {
    let n = covariance.len().isqrt();
    let places: Vec<Vec<f64>> = runs.iter().enumerate().map(|(r, run)| sandwich.columns(r, run.width)).collect();
    let pairs = |g: &Group| g.found.iter().map(|f| f.pairs[0] as f64).collect::<Vec<f64>>();
    let all: f64 = groups.iter().flat_map(pairs).sum();
    // what fitting takes off tells nothing of the noise
    let told = (1.0 - n as f64 / all).max(0.0);
    let mut known = Vec::with_capacity(groups.len());
    for g in groups {
        let own = g.runs.iter().map(|r| (&runs[*r], &places[*r][..])).collect();
        let samples = pairs(g).iter().map(|count| count * told).collect();
        known.push(freedom::Group { runs: own, colour: &g.colour, samples });
    }
    let variances: Vec<f64> = (0..n).map(|j| covariance[j * n + j]).collect();
    freedom::freedom(&known, inverse_noise, &variances)
}

/// Sensitivities and residuals of all runs.
fn rows(problem: &mut Problem<'_>, sandwich: &Sandwich<'_>, values: &[f64]) -> Result<Vec<ColouredRows>, Uncorrected> {
    let unknowns = sandwich.unknowns;
    let width = unknowns.columns.len().next_multiple_of(8);
    let mut grids = Vec::with_capacity(problem.runs.len());
    for run in &problem.runs {
        grids.push(sampling(run).map_err(|_| Uncorrected::UnevenSampling { run: run.name.clone() })?);
    }
    let numbers: usize = problem.runs.iter().zip(&grids).map(|(r, g)| g.length() * r.response.outputs() * width).sum();
    if numbers > MOST_NUMBERS {
        return Err(Uncorrected::TooLarge);
    }
    let work = |(r, (run, grid)): (usize, (&mut crate::estimate::problem::ProblemRun<'_>, _))| {
        let mut theta = unknowns.theta[r].clone();
        unknowns.assemble(r, values, &mut theta);
        ColouredRows::new(run, unknowns, &theta, &sandwich.scale(r), grid).map_err(|_| Uncorrected::NotFinite)
    };
    problem.runs.par_iter_mut().zip(&grids).enumerate().map(work).collect()
}

fn filter(runs: &[ColouredRows], groups: &[Group], inverse_noise: &[f64]) -> Vec<Filtered> {
    let group = |r: usize| groups.iter().find(|g| g.runs.contains(&r)).unwrap_or(&groups[0]);
    runs.par_iter().enumerate().map(|(r, rows)| rows.filter(&group(r).colour, inverse_noise)).collect()
}

/// Runs that share the colour of their noise.
struct Group {
    runs: Vec<usize>,
    /// Lagged products of the residuals of each output (q).
    found: Vec<Lagged>,
    /// Autocovariances of the noise of each output, as far as they are known.
    autocovariances: Vec<Vec<f64>>,
    colour: Colour,
}

impl Group {
    /// Long runs tell their colour each by itself, short ones together with those of the same interval.
    fn all(runs: &[ColouredRows], outputs: usize) -> Vec<Self> {
        let compared = |v: &Vec<f64>| v.iter().filter(|v| !v.is_nan()).count();
        let fewest = |r: &ColouredRows| r.residuals.iter().map(compared).filter(|n| *n > 0).min();
        let long = |r: &ColouredRows| fewest(r).is_some_and(|n| n >= LONG);
        let mut groups: Vec<(bool, f64, Vec<usize>)> = Vec::new();
        for (k, run) in runs.iter().enumerate() {
            let same = |i: f64| (i / run.interval - 1.0).abs() < 0.01;
            match groups.iter_mut().find(|(alone, interval, _)| !alone && !long(run) && same(*interval)) {
                Some(group) => group.2.push(k),
                None => groups.push((long(run), run.interval, vec![k])),
            }
        }
        groups.into_iter().map(|(_, _, members)| Self::new(members, runs, outputs)).collect()
    }

    fn new(members: Vec<usize>, runs: &[ColouredRows], outputs: usize) -> Self {
        let series = |o: usize| members.iter().map(move |r| &runs[*r].residuals[o]);
        let compared = |v: &Vec<f64>| v.iter().filter(|v| !v.is_nan()).count();
        let found: Vec<Lagged> = (0..outputs)
            .map(|o| {
                // lags that are long for each run have few pairs, however many runs there are
                let most = series(o).map(compared).max().unwrap_or(0);
                let mut lagged = Lagged::none(colour::most_order(most));
                series(o).for_each(|v| lagged.add(v));
                lagged
            })
            .collect();
        let longest = members.iter().map(|r| runs[*r].length).max().unwrap_or(1) as f64;
        // a taper makes the means over fewer pairs those of a stationary process
        let tapered = |l: &Lagged| l.means().enumerate().map(|(k, m)| m * (1.0 - k as f64 / longest)).collect();
        let autocovariances = found.iter().map(tapered).collect();
        let colour = Colour { models: Vec::new(), innovations: Vec::new() };
        let mut group = Self { runs: members, found, autocovariances, colour };
        group.choose(runs, true);
        group
    }

    /// Chooses the models for the current autocovariances; with their old orders unless `free`.
    fn choose(&mut self, runs: &[ColouredRows], free: bool) {
        let choose = |(o, r): (usize, &Vec<f64>)| match self.colour.models.get(o) {
            Some(old) if !free => {
                let order = old.coefficients.len().min(r.len() - 1);
                Ladder::of(&r[..=order]).model(order)
            }
            _ => colour::choose(r, self.found[o].pairs[0]),
        };
        self.colour.models = self.autocovariances.iter().enumerate().map(choose).collect();
        self.colour.innovations = self.innovations(runs);
    }

    /// Covariance of the innovations: variances from the models, correlations from the whitened residuals.
    fn innovations(&self, runs: &[ColouredRows]) -> Vec<f64> {
        let (models, q) = (&self.colour.models, self.colour.models.len());
        let mut sums = vec![0.0; q * q];
        if q > 1 {
            for run in self.runs.iter().map(|r| &runs[*r]) {
                let series: Vec<_> = models.iter().zip(&run.residuals).map(|(m, v)| m.innovations(v)).collect();
                for i in 0..run.length {
                    // only samples with all outputs: the correlations then belong together
                    if series.iter().all(|s| !s[i].is_nan()) {
                        (0..q * q).for_each(|k| sums[k] += series[k / q][i] * series[k % q][i]);
                    }
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
    fn improve(&mut self, runs: &[ColouredRows], filtered: &[Filtered], reduced: &[[Vec<f64>; 2]], free: bool) -> f64 {
        let mut change = 0.0_f64;
        for (o, found) in self.found.iter().enumerate() {
            let most = found.sums.len() - 1;
            let bound = |r: &usize| runs[*r].bound(o, &filtered[*r].images[o], &reduced[*r]);
            if self.runs.iter().map(bound).sum::<f64>() < SETTLED * found.sums[0] {
                continue;
            }
            let mut taken = vec![0.0; most + 1];
            for r in &self.runs {
                let part = runs[*r].taken(o, &filtered[*r].images[o], &reduced[*r], most);
                taken.iter_mut().zip(part).for_each(|(t, p)| *t += p);
            }
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
        self.choose(runs, free);
        change
    }

    fn report(&self, problem: &Problem<'_>, runs: &[ColouredRows]) -> Vec<NoiseColour> {
        let names: Vec<String> = self.runs.iter().map(|r| problem.runs[*r].name.clone()).collect();
        let interval = runs[self.runs[0]].interval;
        let one = |(o, model): (usize, &AutoRegression)| {
            NoiseColour::new(problem.outputs[o].clone(), names.clone(), interval, model)
        };
        let measured = |(o, _): &(usize, &AutoRegression)| self.found[*o].pairs[0] > 0;
        self.colour.models.iter().enumerate().filter(measured).map(one).collect()
    }
}
