//! Whether the noise of an output is everywhere of one size: the size of the residuals against the response, the time and the run (Glejser 1969), and how the
//! standard deviation varies where it is not.
//!
//! Squares of normal residuals to the power of one third are nearly normal (Wilson and Hilferty 1931); these sizes are a series with a colour of their own. A sum
//! over them is judged by the autoregression that they follow, or by the one that normal residuals of their colour would give, whichever varies more, so that
//! coloured noise of one size passes. What fitting took from the residuals at each sample (its leverage) is put back first.

use super::autocovariance::{add_lagged_products, centred, inner, total};
use super::autoregression;
use fdm_numeric::statistics::{Student, f_tail};
use fdm_system::record::even_grid::EvenGrid;
use serde::{Deserialize, Serialize};

/// Noise counts as varying below this probability that noise of one size looks so, all tests of all outputs together.
const SIGNIFICANT: f64 = 0.01;
/// Fewest residuals for a test.
const FEWEST: usize = 20;
/// Share of the mean variance below which no variance falls.
const LEAST: f64 = 1e-3;

/// How the size of an output's noise depends on something.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
pub struct Trend {
    /// Correlation of the sizes of the residuals with it: above 0 where the noise grows with it.
    pub correlation: f64,
    /// Probability of one as far from zero, were the noise of one size.
    pub p_value: f64,
}

/// Whether the noise of one output, in all runs, is of one size.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct NoiseVariation {
    /// Name of the output.
    pub output: String,
    /// Against the size of the response; none when that does not change.
    pub response: Option<Trend>,
    /// Against the time since the beginning of the run; none when only the order of the samples is known.
    pub time: Option<Trend>,
    /// Probability of runs that differ as much, were the noise of one size; none for one run.
    pub runs: Option<f64>,
    /// Probability of the clearest of all tests of all outputs, were all noise of one size (Bonferroni's bound).
    pub p_value: f64,
    /// Standard deviations that one sample of twenty is below, and one above; the same number twice unless the noise varies.
    pub deviations: [f64; 2],
}

impl NoiseVariation {
    /// Whether chance does not explain that the noise varies (at one percent, all outputs together).
    pub fn is_significant(&self) -> bool {
        self.p_value < SIGNIFICANT
    }

    /// What the noise varies with, the clearest first.
    pub fn causes(&self) -> Vec<Cause> {
        let trends = [(Cause::Response, self.response.map(|t| t.p_value)), (Cause::Time, self.time.map(|t| t.p_value))];
        let all = trends.into_iter().chain([(Cause::Run, self.runs)]);
        let mut found: Vec<(Cause, f64)> = all.filter_map(|(cause, p)| Some((cause, p?))).collect();
        found.retain(|(_, p)| *p < SIGNIFICANT);
        found.sort_by(|a, b| a.1.total_cmp(&b.1));
        found.into_iter().map(|(cause, _)| cause).collect()
    }
}

/// What the size of noise may depend on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// The size of the response.
    Response,
    /// The time since the run began.
    Time,
    /// The run.
    Run,
}

/// One output in one run, at places that are evenly spaced, or at its samples where these are not.
#[derive(Debug, Clone, Default)]
pub(crate) struct OutputSeries {
    /// Size of the response at each place.
    pub(crate) response: Vec<f64>,
    /// Time since the beginning; empty when only the order is known.
    pub(crate) time: Vec<f64>,
    /// Measured minus model; NaN where nothing is compared.
    pub(crate) residuals: Vec<f64>,
    /// Share of the residual's variance that fitting left (0 to 1); empty for all of it.
    pub(crate) left: Vec<f64>,
}

impl OutputSeries {
    /// An output of a run with these times, from responses and residuals (N by q each).
    pub(crate) fn of_run(time: &[f64], response: &[f64], residuals: &[f64], (output, q): (usize, usize)) -> Self {
        let compared = |k: usize| residuals[k * q..(k + 1) * q].iter().any(|e| !e.is_nan());
        let grid = EvenGrid::of_compared(time, compared).unwrap_or_else(|_| EvenGrid::counted(time.len()));
        Self {
            response: grid.spread(response.iter().skip(output).step_by(q).map(|y| y.abs())),
            time: grid.spread(time.iter().map(|t| t - time[0])),
            residuals: grid.spread(residuals.iter().skip(output).step_by(q).copied()),
            left: Vec::new(),
        }
    }

    /// The residual as large as it was before fitting took its share.
    fn residual(&self, k: usize) -> f64 {
        self.residuals[k] / self.left.get(k).map_or(1.0, |left| left.max(0.1).sqrt())
    }

    fn present(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.residuals.len()).filter(|k| !self.residuals[*k].is_nan())
    }

    /// Sizes of the residuals over their mean, less 1; 0 where there is none.
    fn sizes(&self) -> Option<Sizes> {
        let mut values: Vec<f64> = (0..self.residuals.len()).map(|k| self.residual(k).powi(2)).collect();
        values.iter_mut().for_each(|v| *v = cube_root(*v));
        let (sum, count) = total(&values);
        let mean = sum / count.max(1) as f64;
        if count < 2 || !(mean > 0.0 && mean.is_finite()) {
            return None;
        }
        values.iter_mut().for_each(|size| *size = *size / mean - 1.0);
        let colour = autoregression::short_of_series(&self.without_trends(&values));
        let own = autoregression::of_series(&centred(self.residuals.clone()));
        values.iter_mut().filter(|size| size.is_nan()).for_each(|size| *size = 0.0);
        Some(Sizes { values, colour, of_normal: of_normal(&own, count), mean, count })
    }

    /// Values without what follows response and time: a trend is no colour.
    fn without_trends(&self, values: &[f64]) -> Vec<f64> {
        let places: Vec<usize> = self.present().collect();
        let centred = |x: &[f64]| {
            let mut own: Vec<f64> = places.iter().map(|k| x[*k]).collect();
            let mean = total(&own).0 / places.len() as f64;
            own.iter_mut().for_each(|x| *x -= mean);
            own
        };
        let mut left = centred(values);
        let mut bases: Vec<Vec<f64>> = Vec::new();
        for x in [&self.response, &self.time].into_iter().filter(|x| !x.is_empty()) {
            let mut basis = centred(x);
            let whole = inner(&basis, &basis);
            for other in &bases {
                let share = inner(&basis, other) / inner(other, other);
                basis.iter_mut().zip(other).for_each(|(a, b)| *a -= share * b);
            }
            let own = inner(&basis, &basis);
            if own > 1e-9 * whole && whole > 0.0 {
                let share = inner(&left, &basis) / own;
                left.iter_mut().zip(&basis).for_each(|(a, b)| *a -= share * b);
                bases.push(basis);
            }
        }
        // degrees of freedom that this took
        let taken = 1.0 + bases.len() as f64;
        let restored = (places.len() as f64 / (places.len() as f64 - taken).max(1.0)).sqrt();
        let mut all = vec![f64::NAN; values.len()];
        places.iter().zip(left).for_each(|(k, v)| all[*k] = restored * v);
        all
    }
}

/// The sizes of the residuals of one run.
struct Sizes {
    values: Vec<f64>,
    colour: autoregression::AutoRegression,
    /// Their correlations at lags 0, 1, .. that normal residuals of this colour would give.
    of_normal: Vec<f64>,
    mean: f64,
    count: usize,
}

impl Sizes {
    /// Degrees of freedom of what is known of the variance of sums: those of an autoregression of first order with the same spectrum at zero.
    fn freedom(&self) -> f64 {
        let growth = self.growth();
        self.count as f64 / if growth > 1.0 { 1.0 + 2.0 * growth } else { 1.0 }
    }

    /// How much larger the variance of a mean is than that of independent values: the larger of what the sizes and what the residuals say.
    fn growth(&self) -> f64 {
        let own = self.colour.long_run_variance() / self.colour.autocovariances(0)[0];
        own.max(2.0 * self.of_normal.iter().sum::<f64>() - 1.0)
    }

    /// Variance of the sum of `x(k) values(k)`; x is zero where nothing is compared.
    fn variance(&self, x: &[f64]) -> f64 {
        let mut rows = vec![0.0; self.colour.memory(x.len())];
        rows.extend(x);
        self.colour.backward_series(&mut rows);
        let own = self.colour.variance * inner(&rows, &rows);
        let mut products = vec![0.0; self.of_normal.len()];
        add_lagged_products(x, x, 1, &mut products);
        let pairs: f64 = products.iter().zip(&self.of_normal).map(|(p, r)| p * r).sum();
        own.max(self.colour.autocovariances(0)[0] * (2.0 * pairs - products[0]))
    }
}

/// The cube root of a number that is not negative, to a few units in the last place; plain arithmetic, so that many are taken side by side with the same
/// bits everywhere. NaN stays.
fn cube_root(x: f64) -> f64 {
    // a third of the exponent is within a twentieth of the root; each step multiplies the digits by three
    let mut root = f64::from_bits(x.to_bits() / 3 + 0x2A9F_7893_0000_0000);
    for _ in 0..3 {
        let cube = root * root * root;
        root *= (cube + 2.0 * x) / (2.0 * cube + x);
    }
    if x < f64::MIN_POSITIVE { 0.0 } else { root }
}

/// Share of the variance of `(x^2)^(1/3)`, x normal, that its polynomial of second degree has; most of the rest is of the fourth.
const SECOND: f64 = 0.765;

/// Correlations of the sizes of normal residuals of this colour, as far as they matter: those of the residuals squared and to the fourth.
fn of_normal(colour: &autoregression::AutoRegression, count: usize) -> Vec<f64> {
    // most lags at which sizes of normal residuals are taken to correlate
    let most = colour.memory(count.min(1000)).min(count.saturating_sub(1));
    let r = colour.autocovariances(most);
    let one = |r: &f64| SECOND * r.powi(2) + (1.0 - SECOND) * r.powi(4);
    if r[0] > 0.0 { r.iter().map(|v| v / r[0]).map(|r| one(&r)).collect() } else { vec![1.0] }
}

/// Tests all outputs (by name, with their runs).
pub(crate) fn test(outputs: &[(String, Vec<OutputSeries>)]) -> Vec<NoiseVariation> {
    let mut found: Vec<NoiseVariation> = outputs.iter().filter_map(|(name, runs)| test_one(name, runs)).collect();
    let of = |v: &NoiseVariation| {
        let trends = [v.response.map(|t| t.p_value), v.time.map(|t| t.p_value), v.runs];
        trends.into_iter().flatten().collect::<Vec<f64>>()
    };
    let tests = found.iter().map(|v| of(v).len()).sum::<usize>() as f64;
    for v in &mut found {
        v.p_value = (of(v).into_iter().fold(1.0, f64::min) * tests).min(1.0);
    }
    found
}

fn test_one(name: &str, runs: &[OutputSeries]) -> Option<NoiseVariation> {
    let sizes: Vec<Option<Sizes>> = runs.iter().map(OutputSeries::sizes).collect();
    let known: Vec<(&OutputSeries, &Sizes)> =
        runs.iter().zip(&sizes).filter_map(|(run, sizes)| Some((run, sizes.as_ref()?))).collect();
    let count: usize = known.iter().map(|(_, s)| s.count).sum();
    if count < FEWEST {
        return None;
    }
    let squares = |r: &OutputSeries| total(&r.residuals.iter().map(|v| v * v).collect::<Vec<f64>>()).0;
    let squares: f64 = runs.iter().map(squares).sum();
    let deviation = (squares / count as f64).sqrt();
    Some(NoiseVariation {
        output: name.into(),
        response: trend(&known, |run| &run.response),
        time: trend(&known, |run| &run.time),
        runs: between_runs(&known),
        p_value: 1.0,
        deviations: [deviation; 2],
    })
}

/// Correlation of the sizes with `x`, within runs.
fn trend(runs: &[(&OutputSeries, &Sizes)], x: impl Fn(&OutputSeries) -> &[f64]) -> Option<Trend> {
    let (mut sum, mut variance, mut squares, mut spread, mut count, mut freedom) = (0.0, 0.0, 0.0, 0.0, 0usize, -2.0);
    for (run, sizes) in runs {
        let x = x(run);
        if x.is_empty() {
            return None;
        }
        let there = |(x, v): (&f64, &f64)| if v.is_nan() { f64::NAN } else { *x };
        let mut centred: Vec<f64> = x.iter().zip(&run.residuals).map(there).collect();
        let mean = total(&centred).0 / sizes.count as f64;
        let largest = centred.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
        centred.iter_mut().for_each(|x| *x = if x.is_nan() { 0.0 } else { *x - mean });
        let own = inner(&centred, &centred);
        if own.is_nan() || own <= sizes.count as f64 * (1e-9 * largest).powi(2) {
            continue;
        }
        sum += inner(&centred, &sizes.values);
        variance += sizes.variance(&centred);
        squares += inner(&sizes.values, &sizes.values);
        (spread, count, freedom) = (spread + own, count + sizes.count, freedom + sizes.freedom());
    }
    let law = Student::new(freedom.max(1.0)).filter(|_| variance > 0.0 && variance.is_finite() && count >= FEWEST)?;
    let p_value = (2.0 * law.tail((sum / variance.sqrt()).abs())).min(1.0);
    Some(Trend { correlation: sum / (spread * squares).sqrt(), p_value })
}

/// Whether the mean sizes of runs differ.
fn between_runs(runs: &[(&OutputSeries, &Sizes)]) -> Option<f64> {
    let long: Vec<&Sizes> = runs.iter().map(|(_, sizes)| *sizes).filter(|s| s.count >= FEWEST).collect();
    if long.len() < 2 {
        return None;
    }
    // one colour for all, which many samples tell
    let pooled = long.iter().map(|s| s.count as f64 * s.growth() * s.colour.autocovariances(0)[0]).sum::<f64>();
    let pooled = pooled / long.iter().map(|s| s.count as f64).sum::<f64>();
    let all: f64 = long.iter().map(|s| s.count as f64).sum();
    let mean = long.iter().map(|s| s.count as f64 * s.mean.ln()).sum::<f64>() / all;
    let statistic = long.iter().map(|s| s.count as f64 * (s.mean.ln() - mean).powi(2)).sum::<f64>() / pooled;
    let (between, within) = (long.len() as f64 - 1.0, long.iter().map(|s| s.freedom()).sum::<f64>() - 2.0);
    f_tail(statistic / between, [between, within.max(1.0)]).filter(|_| statistic.is_finite())
}

/// The variance of an output's noise at each place of each run over its mean: what it varies with, one after the other, the clearest first.
pub(crate) fn profile(variation: &NoiseVariation, runs: &[OutputSeries]) -> Vec<Vec<f64>> {
    let mut shape: Vec<Vec<f64>> = runs.iter().map(|r| vec![1.0; r.residuals.len()]).collect();
    for cause in variation.causes() {
        let places = |r: usize| runs[r].present().map(move |k| (r, k));
        let all: Vec<(usize, usize)> = (0..runs.len()).flat_map(places).collect();
        let square = |(r, k): &(usize, usize)| runs[*r].residual(*k).powi(2) / shape[*r][*k];
        let squares: Vec<f64> = all.iter().map(square).collect();
        if cause == Cause::Run {
            for (r, shape) in shape.iter_mut().enumerate() {
                let own: Vec<f64> = all.iter().zip(&squares).filter(|((s, _), _)| *s == r).map(|(_, v)| *v).collect();
                let mean = own.iter().sum::<f64>() / own.len().max(1) as f64;
                if mean > 0.0 {
                    shape.iter_mut().for_each(|s| *s *= mean);
                }
            }
            continue;
        }
        let x = |r: usize, k: usize| if cause == Cause::Response { runs[r].response[k] } else { runs[r].time[k] };
        let abscissae: Vec<f64> = all.iter().map(|(r, k)| x(*r, *k)).collect();
        let Some(curve) = Curve::best(&abscissae, &squares) else { continue };
        for (r, shape) in shape.iter_mut().enumerate() {
            shape.iter_mut().enumerate().for_each(|(k, s)| *s *= curve.at(x(r, k)));
        }
    }
    let present = || runs.iter().zip(&shape).flat_map(|(run, shape)| run.present().map(|k| shape[k]));
    let mean = present().sum::<f64>() / present().count().max(1) as f64;
    shape.iter_mut().flatten().for_each(|s| *s /= mean);
    shape
}

/// The standard deviations that one sample of twenty is below, and one above, by a profile.
pub(crate) fn range(deviation: f64, runs: &[OutputSeries], shape: &[Vec<f64>]) -> [f64; 2] {
    let mut all: Vec<f64> = runs.iter().zip(shape).flat_map(|(run, shape)| run.present().map(|k| shape[k])).collect();
    all.sort_by(f64::total_cmp);
    let at = |part: f64| all.get((part * (all.len().max(1) - 1) as f64).round() as usize).map_or(1.0, |v| v.sqrt());
    [deviation * at(0.05), deviation * at(0.95)]
}

/// Variance as a function of one variable.
#[derive(Debug, Clone, Copy)]
struct Curve {
    kind: Kind,
    /// Place and size of the variable: `(x - first) / size` is 0 to 1.
    first: f64,
    size: f64,
    coefficients: [f64; 2],
    least: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    /// a + b x
    Linear,
    /// a + b x^2
    Square,
    /// exp(a + b x)
    Exponential,
}

impl Curve {
    /// The likeliest curve for squares of normal noise at `x`; none when the variable does not change.
    fn best(x: &[f64], squares: &[f64]) -> Option<Self> {
        let (low, high) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
        if !(high > low && mean > 0.0 && mean.is_finite()) {
            return None;
        }
        let start = |kind: Kind| {
            let coefficients = if kind == Kind::Exponential { [mean.ln(), 0.0] } else { [mean, 0.0] };
            Self { kind, first: low, size: high - low, coefficients, least: LEAST * mean }
        };
        let fitted = [Kind::Linear, Kind::Square, Kind::Exponential].map(|kind| start(kind).fitted(x, squares));
        fitted.into_iter().min_by(|a, b| a.cost(x, squares).total_cmp(&b.cost(x, squares)))
    }

    fn basis(&self, x: f64) -> f64 {
        let x = (x - self.first) / self.size;
        if self.kind == Kind::Square { x * x } else { x }
    }

    fn at(&self, x: f64) -> f64 {
        let sum = self.coefficients[0] + self.coefficients[1] * self.basis(x);
        if self.kind == Kind::Exponential { sum.exp() } else { sum.max(self.least) }
    }

    /// Minus twice the logarithm of the likelihood.
    fn cost(&self, x: &[f64], squares: &[f64]) -> f64 {
        x.iter().zip(squares).map(|(x, s)| (self.at(*x).ln(), s / self.at(*x))).map(|(l, e)| l + e).sum()
    }

    /// Fisher's scoring, halved where it does not lead downhill.
    fn fitted(mut self, x: &[f64], squares: &[f64]) -> Self {
        let mut cost = self.cost(x, squares);
        // rounds of the iteration for a curve
        for _ in 0..25 {
            let (mut normal, mut right) = ([0.0; 3], [0.0; 2]);
            for (x, s) in x.iter().zip(squares) {
                let (variance, basis) = (self.at(*x), self.basis(*x));
                let slope = if self.kind == Kind::Exponential { 1.0 } else { 1.0 / variance };
                let (row, residual) = ([slope, slope * basis], s / variance - 1.0);
                for (sum, term) in normal.iter_mut().zip([row[0] * row[0], row[0] * row[1], row[1] * row[1]]) {
                    *sum += term;
                }
                right.iter_mut().zip(row).for_each(|(sum, r)| *sum += r * residual);
            }
            let determinant = normal[0] * normal[2] - normal[1] * normal[1];
            let step = [
                (normal[2] * right[0] - normal[1] * right[1]) / determinant,
                (normal[0] * right[1] - normal[1] * right[0]) / determinant,
            ];
            let (mut part, before) = (1.0, cost);
            while part > 1e-3 {
                let coefficients = [0, 1].map(|k| self.coefficients[k] + part * step[k]);
                let next = Self { coefficients, ..self };
                let reached = next.cost(x, squares);
                if reached < cost {
                    (self, cost) = (next, reached);
                    break;
                }
                part *= 0.5;
            }
            if before - cost < 1e-9 * x.len() as f64 {
                break;
            }
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_numeric::random::Normal;

    /// A swing that dies out, in two runs.
    fn swings(n: usize, mut noise: impl FnMut(f64, f64) -> f64) -> Vec<(String, Vec<OutputSeries>)> {
        let mut run = || {
            let time: Vec<f64> = (0..n).map(|k| 10.0 * k as f64 / n as f64).collect();
            let response: Vec<f64> = time.iter().map(|t| (3.0 * (-0.2 * t).exp() * (2.0 * t).cos()).abs()).collect();
            let residuals = response.iter().zip(&time).map(|(y, t)| noise(*y, *t)).collect();
            OutputSeries { response, time, residuals, left: Vec::new() }
        };
        vec![("y".into(), vec![run(), run()])]
    }

    #[test]
    fn noise_of_one_size_passes_whatever_its_colour_and_law() {
        for (n, keep, tails) in
            [(40, 0.0, false), (200, 0.0, false), (200, 0.8, false), (1000, 0.95, false), (200, 0.0, true)]
        {
            let mut alarms = 0;
            for seed in 0..100 {
                let (mut normal, mut v) = (Normal(1 + 7919 * seed), 0.0);
                (0..200).for_each(|_| v = keep * v + normal.next());
                let outputs = swings(n, |_, _| {
                    v = keep * v + normal.next();
                    let chi = (0..4).map(|_| normal.next().powi(2)).sum::<f64>() / 4.0;
                    if tails { v / chi.sqrt() } else { v }
                });
                alarms += usize::from(test(&outputs)[0].is_significant());
            }
            assert!(alarms <= 4, "{alarms} of 100 at one percent, {n} samples, colour {keep}, tails {tails}");
        }
    }

    #[test]
    fn what_the_noise_follows_is_found_and_how() {
        let mut normal = Normal(3);
        let outputs = swings(300, |y, _| (0.02 + 0.1 * y) * normal.next());
        let found = &test(&outputs)[0];
        assert!(found.is_significant() && found.causes().contains(&Cause::Response), "{found:?}");
        assert!(found.response.is_some_and(|t| t.correlation > 0.3), "{found:?}");
        let shape = profile(found, &outputs[0].1);
        let (series, shape) = (&outputs[0].1[0], &shape[0]);
        let mean = |f: &dyn Fn(usize) -> bool| {
            let chosen = || (0..300).filter(|k| f(*k));
            chosen().map(|k| (shape[k].sqrt() / (0.02 + 0.1 * series.response[k])).ln()).sum::<f64>()
                / chosen().count() as f64
        };
        let (small, large) = (mean(&|k| series.response[k] < 0.3), mean(&|k| series.response[k] > 1.0));
        assert!((small - large).abs() < 0.35, "{small} {large}");

        let mut normal = Normal(4);
        let outputs = swings(300, |_, t| (0.1 + 0.03 * t) * normal.next());
        assert_eq!(test(&outputs)[0].causes().first(), Some(&Cause::Time));
        let mut calls = 0;
        let outputs = swings(300, |_, _| {
            calls += 1;
            if calls > 300 { 2.0 * normal.next() } else { normal.next() }
        });
        assert_eq!(test(&outputs)[0].causes().first(), Some(&Cause::Run));
    }

    #[test]
    fn cube_roots_are_exact_to_rounding() {
        for x in [1e-300, 3.7e-41, 0.02, 0.999, 1.0, 7.3, 8.0, 4.4e90, 1e300] {
            assert!((cube_root(x) / x.cbrt() - 1.0).abs() < 1e-15, "{x}");
        }
        assert!(cube_root(0.0) == 0.0 && cube_root(f64::NAN).is_nan());
    }

    #[test]
    fn too_few_residuals_are_not_tested() {
        assert!(test(&swings(8, |y, _| y)).is_empty());
    }
}
