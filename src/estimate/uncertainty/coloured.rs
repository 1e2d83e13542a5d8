//! Errors of the estimates corrected for the colour of the residuals (Morelli and Klein 1997):
//! `D [sum_i S_i' R^-1 sum_j Rvv(i - j) R^-1 S_j] D`, Rvv an autoregression for each output whose innovations correlate.
//!
//! Fitting takes from the residuals what the parameters can imitate, so that their autocovariance is too small. The autoregression is the one that,
//! fitted, would leave the autocovariances that were found: the leverage correction is computed exactly and added until nothing changes.
//!
//! A corrected variance stands on estimated autoregressions. With b what each innovation does to an estimate, `V = s^2 sum_t b(t)^2`; the coefficients a have
//! the covariance `s^2/N G^-1` (G the autocovariances of the noise), `dV/da(m) = 2 s^2 sum_t b(t) u(t + m)`, u being b filtered once more. The variance of V
//! gives the degrees of freedom of the interval (Satterthwaite 1946).
//!
//! So for runs that are long and evenly sampled; the others are in [`super::model_averaged`].

use super::cramer_rao::CramerRao;
use super::model_averaged::ShortRuns;
use super::sandwich::{Corrected, Ended, NoiseColour, Sandwich, Uncorrected};
use super::sensitivity_rows::{Colour, Filtered, SensitivityRows, sampling};
use crate::problem::response::RunResponse;
use crate::problem::{Problem, ProblemRun};
use crate::residuals::autocovariance::Lagged;
use crate::residuals::autoregression::{self, AutoRegression, LevinsonDurbin};
use fdm_numeric::dense::multiply_add;
use fdm_numeric::statistics::chi_squared_tail;
use fdm_system::record::even_grid::EvenGrid;
use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

/// Rounds in which the orders may change.
const SETTLING: usize = 6;
/// Rounds in which the order rises by one after so many, where fitting took much from the residuals.
const CLIMBING: usize = 12;
const EACH: usize = 4;
/// Change of the autocovariances, relative to the variance, that ends the rounds.
const SETTLED: f64 = 1e-3;
/// Residuals are larger than their known noise below this probability.
const SIGNIFICANT: f64 = 0.01;
/// Moments whose innovations are followed to the estimates together.
const MOMENTS: usize = 64;

/// Corrects the covariance of a bound at `values`; and gives the sensitivities and residuals of all runs that this took.
///
/// # Errors
/// [`Uncorrected`] when that is not possible.
pub(super) fn corrected(
    problem: &mut Problem<'_>,
    ended: &Ended<'_>,
) -> Result<(Corrected, Vec<SensitivityRows>), Uncorrected> {
    let Ended { sandwich, noise, values, .. } = *ended;
    let bound = sandwich.bound;
    let runs = rows(problem, &sandwich, values)?;
    let inverse_noise = noise.inverse();
    let prior = ended.prior();
    let short = ShortRuns::of(&runs, &sandwich, noise, &prior)?;
    let mut long: Vec<LongRun> =
        (0..runs.len()).filter(|r| runs[*r].is_long()).map(|r| LongRun::new(r, &runs)).collect();
    let drained = long.iter().any(|l| l.is_drained_by(bound.inverse.chosen.len()));
    // simple colours first, until they settle: a band that is empty would be taken for one by a colour of high order
    let climbing = if drained { CLIMBING } else { 0 };
    for round in 0.. {
        // a band that many parameters imitate is empty in the residuals: their own colour would say that there was no noise to take
        if round == 0 && drained {
            long.iter_mut().for_each(LongRun::assume_white);
        }
        let filter = |l: &LongRun| runs[l.run].filter(&l.colour, &inverse_noise);
        let filtered: Vec<Filtered> = of_each(long.iter().collect(), filter);
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
        // rounds until the autoregression reproduces what was found
        let change = if round + 1 < climbing + 12 {
            let improve = |(l, f): (&mut LongRun, &Filtered)| {
                let rows = &runs[l.run];
                let most = if round < climbing { round.div_ceil(EACH) } else { usize::MAX };
                l.improve(
                    rows,
                    f,
                    &sandwich.of_run(l.run, &covariance, rows.width),
                    (round < climbing + SETTLING).then_some(most),
                )
            };
            long.iter_mut().zip(&filtered).map(improve).fold(0.0, f64::max)
        } else {
            0.0
        };
        if change < SETTLED && round >= climbing {
            let mut colours: Vec<NoiseColour> = long.iter().flat_map(|l| l.report(problem, &runs)).collect();
            if let Some(short) = &short {
                colours.extend(short.report(problem, &noise.covariance));
            }
            // the noise of a surcharge is one that is estimated
            let declared = !problem.runs.iter().any(|run| matches!(run.response, RunResponse::Standardised(_)));
            if declared && is_as_declared(&runs, bound, &colours) {
                let values = bound.inverse.values.clone();
                return Ok((Corrected { colours, ..Corrected::of(values) }, runs));
            }
            let mut freedom = known_by(&long, &runs, &sandwich, &inverse_noise, &covariance);
            if let Some(short) = &short {
                short.settle(&sandwich, &others, &mut covariance, &mut freedom)?;
            }
            return Ok((Corrected { colours, freedom, ..Corrected::of(covariance) }, runs));
        }
    }
    Err(Uncorrected::NotFinite)
}

/// Whether the noise of all outputs is known beforehand and nothing speaks against it: residuals are white, and not larger than such noise. The Cramer-Rao
/// bound is then the covariance, and estimates follow the normal law.
fn is_as_declared(runs: &[SensitivityRows], bound: &CramerRao, colours: &[NoiseColour]) -> bool {
    let Some(noise) = bound.noise.as_ref().filter(|_| bound.samples.iter().all(Option::is_none)) else { return false };
    let (q, mut square, mut count) = (bound.samples.len(), 0.0, 0.0);
    for (o, residuals) in runs.iter().flat_map(|run| run.residuals.iter().enumerate()) {
        let variance = noise.covariance[o * q + o];
        for v in residuals.iter().filter(|v| !v.is_nan()) {
            (square, count) = (square + v * v / variance, count + 1.0);
        }
    }
    let estimated = (bound.inverse.chosen.len() - bound.held.len()) as f64;
    let chance = chi_squared_tail(square, count - estimated);
    colours.iter().all(NoiseColour::is_white) && chance.is_some_and(|chance| chance >= SIGNIFICANT)
}

/// How well the corrected variances are known.
fn known_by(
    long: &[LongRun],
    runs: &[SensitivityRows],
    sandwich: &Sandwich<'_>,
    inverse_noise: &[f64],
    covariance: &[f64],
) -> Vec<f64> {
    let n = covariance.len().isqrt();
    let places: Vec<Vec<f64>> = long.iter().map(|l| sandwich.columns(l.run, runs[l.run].width)).collect();
    let pairs = |l: &LongRun| l.found.iter().map(|f| f.pairs[0] as f64).collect::<Vec<f64>>();
    let all: f64 = long.iter().flat_map(pairs).sum();
    // leverage: what fitting takes off the residuals says nothing of the noise
    let told = (1.0 - n as f64 / all).max(0.0);
    let mut known = Vec::with_capacity(long.len());
    for (l, places) in long.iter().zip(&places) {
        let samples = pairs(l).iter().map(|count| count * told).collect();
        known.push(EstimatedNoise { rows: &runs[l.run], places, colour: &l.colour, samples });
    }
    let variances: Vec<f64> = (0..n).map(|j| covariance[j * n + j]).collect();
    degrees_of_freedom(&known, inverse_noise, &variances)
}

/// Sensitivities and residuals of all runs.
fn rows(
    problem: &mut Problem<'_>,
    sandwich: &Sandwich<'_>,
    values: &[f64],
) -> Result<Vec<SensitivityRows>, Uncorrected> {
    let unknowns = sandwich.unknowns;
    let width = unknowns.columns.len().next_multiple_of(8);
    let grids: Vec<_> = problem.runs.iter().map(sampling).collect();
    let length =
        |(r, g): (&ProblemRun<'_>, &Option<EvenGrid>)| g.as_ref().map_or(r.response.samples(), EvenGrid::length);
    let samples = problem.runs.iter().zip(&grids).map(|(r, g)| length((r, g)) * r.response.outputs());
    let numbers = samples.sum::<usize>() * width;
    // most numbers of all sensitivities together (half a gigabyte with what is made of them)
    // most products of sensitivities in one round (a second on one processor)
    if numbers > 20_000_000 || numbers as f64 * width as f64 > 2e9 {
        return Err(Uncorrected::TooLarge);
    }
    let work = |(r, (run, grid)): (usize, (&mut ProblemRun<'_>, Option<EvenGrid>))| {
        let theta = unknowns.assembled(r, values);
        SensitivityRows::new(run, unknowns, &theta, &sandwich.scale(r), grid).map_err(|_| Uncorrected::NotFinite)
    };
    of_each(problem.runs.iter_mut().zip(grids).enumerate().collect(), work).into_iter().collect()
}

/// What is made of each; of one alone in this thread, as waking another takes longer than the work on a short run.
fn of_each<T: Send, R: Send>(mut all: Vec<T>, work: impl Fn(T) -> R + Send + Sync) -> Vec<R> {
    match all.pop() {
        Some(one) if all.is_empty() => vec![work(one)],
        last => all.into_par_iter().chain(last).map(work).collect(),
    }
}

/// A run that determines the colour of its noise by itself.
struct LongRun {
    run: usize,
    /// Lagged products of the residuals of each output (q).
    found: Vec<Lagged>,
    /// Autocovariances of the noise of each output, as far as they are known.
    autocovariances: Vec<Vec<f64>>,
    colour: Colour,
    /// Room for the rows of one output.
    room: Vec<f64>,
}

impl LongRun {
    fn new(run: usize, runs: &[SensitivityRows]) -> Self {
        let rows = &runs[run];
        let lagged = |v: &Vec<f64>| {
            let mut lagged = Lagged::none(autoregression::most_order(v.iter().filter(|v| !v.is_nan()).count()));
            lagged.add(v);
            lagged
        };
        let found: Vec<Lagged> = rows.residuals.iter().map(lagged).collect();
        // a taper makes the means over fewer pairs those of a stationary process
        let left = |k: usize| 1.0 - k as f64 / rows.length as f64;
        let tapered = |l: &Lagged| l.means().enumerate().map(|(k, m)| m * left(k)).collect();
        let autocovariances = found.iter().map(tapered).collect();
        let colour = Colour { models: Vec::new(), innovations: Vec::new() };
        let mut long = Self { run, found, autocovariances, colour, room: Vec::new() };
        long.choose(rows, Some(usize::MAX));
        long
    }

    /// Whether so many estimates take more from the autocovariances than chance moves them, `n/N` of the variance beside `1/sqrt N`.
    fn is_drained_by(&self, estimates: usize) -> bool {
        self.found.iter().any(|found| estimates * estimates > found.pairs[0])
    }

    /// White noise of the variance that was found, until more is known.
    fn assume_white(&mut self) {
        self.colour.models = self.autocovariances.iter().map(|r| AutoRegression::white(r[0])).collect();
        let (models, q) = (&self.colour.models, self.found.len());
        let variance = |k: usize| if k / q == k % q { models[k / q].variance } else { 0.0 };
        self.colour.innovations = (0..q * q).map(variance).collect();
    }

    /// Chooses the models for the current autocovariances, of an order up to `most`; without one with their old orders.
    fn choose(&mut self, rows: &SensitivityRows, most: Option<usize>) {
        let choose = |(o, r): (usize, &Vec<f64>)| match self.colour.models.get(o) {
            Some(old) if most.is_none() => {
                let order = old.coefficients.len().min(r.len() - 1);
                LevinsonDurbin::of(&r[..=order]).model(order)
            }
            _ => autoregression::choose(
                &r[..r.len().min(most.unwrap_or(usize::MAX).saturating_add(1))],
                self.found[o].pairs[0],
            ),
        };
        self.colour.models = self.autocovariances.iter().enumerate().map(choose).collect();
        self.colour.innovations = self.innovations(rows);
    }

    /// Covariance of the innovations: variances from the models, correlations from the whitened residuals.
    fn innovations(&self, rows: &SensitivityRows) -> Vec<f64> {
        let (models, q) = (&self.colour.models, self.colour.models.len());
        let mut sums = vec![0.0; q * q];
        if q > 1 {
            let mut series: Vec<_> = models.iter().zip(&rows.residuals).map(|(m, v)| m.innovations(v)).collect();
            // only samples with all outputs: the correlations then belong together
            for i in 0..rows.length {
                if series.iter().any(|s| s[i].is_nan()) {
                    series.iter_mut().for_each(|s| s[i] = 0.0);
                }
            }
            for (a, b) in (0..q).flat_map(|a| (0..=a).map(move |b| (a, b))) {
                let sum = series[a].iter().zip(&series[b]).map(|(a, b)| a * b).sum();
                (sums[a * q + b], sums[b * q + a]) = (sum, sum);
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

    /// Adds the leverage correction under the current models; returns the largest relative change.
    fn improve(
        &mut self,
        rows: &SensitivityRows,
        filtered: &Filtered,
        reduced: &[Vec<f64>; 2],
        most: Option<usize>,
    ) -> f64 {
        let mut change = 0.0_f64;
        for (o, found) in self.found.iter().enumerate() {
            let lags = found.sums.len() - 1;
            let image = &filtered.images[o];
            if rows.bound(o, image, reduced) < SETTLED * found.sums[0] {
                continue;
            }
            let taken = rows.taken(o, image, reduced, lags, &mut self.room);
            let restored = |k: usize| (found.sums[k] + taken[k]) / found.pairs[k].max(1) as f64;
            let next: Vec<f64> = (0..=lags).map(restored).collect();
            if !(next[0] > 0.0 && next.iter().all(|v| v.is_finite())) {
                continue;
            }
            let old = &self.autocovariances[o];
            let largest = next.iter().zip(old).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            change = change.max(largest / next[0]);
            self.autocovariances[o] = next;
        }
        self.choose(rows, most);
        change
    }

    fn report(&self, problem: &Problem<'_>, runs: &[SensitivityRows]) -> Vec<NoiseColour> {
        let one = |(o, model): (usize, &AutoRegression)| {
            let names = vec![problem.runs[self.run].name.clone()];
            NoiseColour::new(problem.outputs[o].clone(), names, runs[self.run].grid.interval, model)
        };
        let measured = |(o, _): &(usize, &AutoRegression)| self.found[*o].pairs[0] > 0;
        self.colour.models.iter().enumerate().filter(measured).map(one).collect()
    }
}

/// What is known of the noise of one output, from so many samples.
struct Contribution {
    /// By estimate: its share in the variance.
    size: Vec<f64>,
    /// By estimate: its derivatives by the coefficients.
    slopes: Vec<DVector<f64>>,
}

/// A run whose noise was estimated.
struct EstimatedNoise<'g> {
    rows: &'g SensitivityRows,
    /// The place of every estimate in its columns (width by n, row-major): the columns of the Cramer-Rao covariance.
    places: &'g [f64],
    colour: &'g Colour,
    /// Samples of each output.
    samples: Vec<f64>,
}

/// Degrees of freedom of the `n` corrected variances; infinite where nothing is uncertain.
fn degrees_of_freedom(runs: &[EstimatedNoise<'_>], inverse_noise: &[f64], variances: &[f64]) -> Vec<f64> {
    let mut spread = vec![0.0; variances.len()];
    for run in runs {
        for output in 0..run.colour.models.len() {
            if run.samples[output] > 0.0 {
                run.add_spread(output, inverse_noise, &mut spread);
            }
        }
    }
    spread.iter().zip(variances).map(|(spread, variance)| 2.0 * variance * variance / spread).collect()
}

impl EstimatedNoise<'_> {
    /// Adds the variance of what an output contributes to each corrected variance.
    fn add_spread(&self, output: usize, inverse_noise: &[f64], spread: &mut [f64]) {
        let model = &self.colour.models[output];
        let (order, n) = (model.coefficients.len(), spread.len());
        let mut part = Contribution { size: vec![0.0; n], slopes: vec![DVector::zeros(order); n] };
        part.add(self.rows, self.places, (self.colour, output), inverse_noise);
        let samples = self.samples[output];
        let r = model.autocovariances(order);
        let law = Cholesky::new(DMatrix::from_fn(order, order, |i, j| r[i.abs_diff(j)]));
        for (j, total) in spread.iter_mut().enumerate() {
            *total += 2.0 * part.size[j] * part.size[j] / samples;
            if let Some(law) = law.as_ref().filter(|_| order > 0) {
                *total += model.variance / samples * part.slopes[j].dot(&law.solve(&part.slopes[j]));
            }
        }
    }
}

impl Contribution {
    fn add(
        &mut self,
        rows: &SensitivityRows,
        places: &[f64],
        (colour, output): (&Colour, usize),
        inverse_noise: &[f64],
    ) {
        let (q, width, n) = (colour.models.len(), rows.width, self.size.len());
        let (model, weights) = (&colour.models[output], &inverse_noise[output * q..(output + 1) * q]);
        if model.coefficients.is_empty() {
            // innovations are the noise itself: the products of the rows say all
            let mut square = Vec::new();
            mapped(&rows.square_of(weights), width, places, n, &mut square);
            for (square, places) in square.chunks_exact(n).zip(places.chunks_exact(n)) {
                let shares = square.iter().zip(places).map(|(s, p)| model.variance * s * p);
                self.size.iter_mut().zip(shares).for_each(|(size, share)| *size += share);
            }
            return;
        }
        let memory = model.memory(rows.length);
        let mut effects = vec![0.0; (memory + rows.length) * width];
        rows.weigh(weights, &mut effects[memory * width..]);
        model.backward(&mut effects, width);
        let mut again = effects.clone();
        model.backward(&mut again, width);
        // what each innovation does to every estimate, some moments at a time
        let orders = model.coefficients.len();
        let (mut direct, mut filtered) = (Vec::new(), Vec::new());
        let length = memory + rows.length;
        for first in (0..length).step_by(MOMENTS) {
            let (end, beyond) = ((first + MOMENTS).min(length), (first + MOMENTS + orders).min(length));
            mapped(&effects[first * width..end * width], width, places, n, &mut direct);
            for row in direct.chunks_exact(n) {
                self.size.iter_mut().zip(row).for_each(|(size, b)| *size += model.variance * b * b);
            }
            mapped(&again[first * width..beyond * width], width, places, n, &mut filtered);
            for (t, row) in direct.chunks_exact(n).enumerate() {
                for m in 1..=orders.min(beyond - first - t - 1) {
                    let later = &filtered[(t + m) * n..(t + m + 1) * n];
                    for ((slopes, b), u) in self.slopes.iter_mut().zip(row).zip(later) {
                        slopes[m - 1] += 2.0 * model.variance * b * u;
                    }
                }
            }
        }
    }
}

/// Rows (by `width`) times the places of `n` estimates in them (width by n).
fn mapped(rows: &[f64], width: usize, places: &[f64], n: usize, to: &mut Vec<f64>) {
    to.clear();
    to.resize(rows.len() / width * n, 0.0);
    multiply_add(rows, width, places, n, to);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> SensitivityRows {
        let (length, width) = (60, 8);
        let mut rows = vec![vec![0.0; length * width]; 2];
        for (o, rows) in rows.iter_mut().enumerate() {
            for i in 0..length {
                rows[i * width] = (0.2 * i as f64 + o as f64).sin();
                rows[i * width + 1] = 1.0 / (1.0 + i as f64);
            }
        }
        SensitivityRows::of(EvenGrid::counted(length), width, rows.concat(), vec![vec![0.5; length]; 2])
    }

    fn part(rows: &SensitivityRows, model: &AutoRegression) -> Contribution {
        let order = model.coefficients.len();
        let colour = Colour { models: vec![AutoRegression::white(1.0), model.clone()], innovations: Vec::new() };
        let mut places = vec![0.0; rows.width * 2];
        places[..4].copy_from_slice(&[1.0, 0.3, -0.4, 2.0]);
        let mut part = Contribution { size: vec![0.0; 2], slopes: vec![DVector::zeros(order); 2] };
        part.add(rows, &places, (&colour, 1), &[1.0, 0.2, 0.2, 2.0]);
        part
    }

    #[test]
    fn slopes_are_those_of_the_variance() {
        let rows = rows();
        let model = LevinsonDurbin::of(&[2.0, 1.4, 0.6, 0.3]).model(3);
        let found = part(&rows, &model);
        for m in 0..3 {
            let at = |step: f64| {
                let mut moved = model.clone();
                moved.coefficients[m] += step;
                part(&rows, &moved).size
            };
            let (above, below) = (at(1e-5), at(-1e-5));
            for (slopes, (above, below)) in found.slopes.iter().zip(above.iter().zip(&below)) {
                let want = (above - below) / 2e-5;
                // the filters end where their influence has fallen to a thousandth
                assert!((slopes[m] / want - 1.0).abs() < 5e-3, "{m}: {} {want}", slopes[m]);
            }
        }
    }

    #[test]
    fn white_noise_is_known_by_its_samples() {
        let rows = rows();
        let colour =
            Colour { models: vec![AutoRegression::white(1.0), AutoRegression::white(1.0)], innovations: Vec::new() };
        let mut places = vec![0.0; rows.width];
        places[0] = 1.0;
        let run = |samples: Vec<f64>| EstimatedNoise { rows: &rows, places: &places, colour: &colour, samples };
        // the second output says nothing: its weight is nothing
        let known = |samples| {
            let mut size = Contribution { size: vec![0.0], slopes: vec![DVector::zeros(0)] };
            size.add(&rows, &places, (&colour, 0), &[1.0, 0.0, 0.0, 0.0]);
            degrees_of_freedom(&[run(samples)], &[1.0, 0.0, 0.0, 0.0], &size.size)[0]
        };
        assert!((known(vec![58.0, 58.0]) - 58.0).abs() < 1e-9);
        assert!((known(vec![58.0, 0.0]) - 58.0).abs() < 1e-9);
    }
}
