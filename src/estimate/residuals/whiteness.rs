//! Whether residuals are white: autocorrelation with bounds, the portmanteau test of Ljung and Box (1978), the statistic of Durbin and Watson (1950), the runs
//! test of Wald and Wolfowitz (1940), and their spectrum beside that of white noise with their variance.
//!
//! Whether residuals correlate with an input: then something that the input does is missing in the model.

use super::autocovariance::{Lagged, add_lagged_products, centred, inner};
use super::autoregression::AutoRegression;
use fdm_numeric::fourier::RealFft;
use fdm_numeric::statistics::{chi_squared_quantile, chi_squared_tail, normal_tail};
use fdm_system::record::even_grid::{EvenGrid, NotEven};
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::{LazyLock, Mutex, PoisonError};

/// Most lags that are tested.
const LAGS: usize = 25;
/// Fewest compared samples for a test.
const FEWEST: usize = 10;
/// Residuals count as coloured below this p-value.
pub(crate) const SIGNIFICANT: f64 = 0.01;

/// Autocorrelation of the residuals about their mean, and what it says.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Whiteness {
    /// Time between neighbouring samples.
    pub interval: f64,
    /// Autocorrelation at lags of 1, 2, ... samples; pairs with a missing value are left out.
    pub autocorrelation: Vec<f64>,
    /// Two standard deviations of each, were the residuals white.
    pub bounds: Vec<f64>,
    /// Lags beyond their bound; one of twenty is to be expected.
    pub outside: usize,
    /// Portmanteau statistic of Ljung and Box over these lags.
    pub ljung_box: f64,
    /// Its degrees of freedom: the number of lags. Parameters of a response take none off (no lagged residual enters it).
    pub degrees: usize,
    /// Probability of a larger statistic, were the residuals white.
    pub p_value: f64,
    /// Durbin and Watson's statistic: 2 for white residuals, towards 0 for slow ones, towards 4 for alternating ones.
    pub durbin_watson: Option<f64>,
    /// The test of Wald and Wolfowitz; none when all residuals are on one side.
    pub runs_test: Option<RunsTest>,
}

/// Stretches of residuals with one sign.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
pub struct RunsTest {
    /// Stretches that were counted.
    pub runs: usize,
    /// Stretches that white residuals would have on average.
    pub expected: f64,
    /// Probability of a number as far from that, were the residuals white.
    pub p_value: f64,
}

impl Whiteness {
    /// Tests residuals on an even grid, NaN where there is none.
    ///
    /// # Errors
    /// [`Untested`] when there are too few, or they do not vary.
    pub(super) fn new(residuals: &[f64], sampling: &EvenGrid) -> Result<Self, Untested> {
        let present = residuals.iter().filter(|v| !v.is_nan()).count();
        if present < FEWEST {
            return Err(Untested::TooFewSamples);
        }
        let series = centred(residuals.to_vec());
        let lagged = Lagged::of(&series, LAGS.min(present / 5));
        let size = residuals.iter().filter(|v| !v.is_nan()).fold(0.0_f64, |m, v| m.max(v.abs()));
        let varies = lagged.sums[0] > present as f64 * (4.0 * f64::EPSILON * size).powi(2);
        if !varies {
            return Err(Untested::NoResidual);
        }
        let n = present as f64;
        let autocorrelation: Vec<f64> = lagged.correlations().collect();
        // a sum over m pairs, relative to one over n squares, varies by m / n^2
        let bounds: Vec<f64> = lagged.pairs[1..].iter().map(|m| 2.0 * (*m as f64).sqrt() / n).collect();
        let tested = || autocorrelation.iter().zip(&lagged.pairs[1..]).filter(|(_, m)| **m > 0);
        let ljung_box = tested().map(|(r, m)| n * (n + 2.0) * r * r / *m as f64).sum();
        let degrees = tested().count();
        let outside = autocorrelation.iter().zip(&bounds).filter(|(r, b)| r.abs() > **b).count();
        Ok(Self {
            interval: sampling.interval,
            outside,
            ljung_box,
            degrees,
            p_value: chi_squared_above(ljung_box, degrees),
            durbin_watson: durbin_watson(residuals),
            runs_test: RunsTest::new(&series),
            autocorrelation,
            bounds,
        })
    }

    /// Whether the portmanteau test finds nothing against white residuals (at one percent).
    pub fn is_white(&self) -> bool {
        self.p_value >= SIGNIFICANT
    }
}

impl RunsTest {
    fn new(series: &[f64]) -> Option<Self> {
        let above: Vec<bool> = series.iter().filter(|v| !v.is_nan()).map(|v| *v > 0.0).collect();
        let high = above.iter().filter(|a| **a).count() as f64;
        let low = above.len() as f64 - high;
        let n = high + low;
        let expected = 1.0 + 2.0 * high * low / n;
        let variance = (expected - 1.0) * (expected - 2.0) / (n - 1.0);
        if variance.is_nan() || variance <= 0.0 {
            return None;
        }
        let runs = 1 + above.windows(2).filter(|w| w[0] != w[1]).count();
        let deviate = (runs as f64 - expected) / variance.sqrt();
        Some(Self { runs, expected, p_value: normal_beyond(deviate) })
    }
}

/// Sum of squared steps over sum of squares, both about zero; steps over a gap are left out, and made up for.
fn durbin_watson(residuals: &[f64]) -> Option<f64> {
    let lagged = Lagged::of(residuals, 1);
    let steps = residuals.windows(2).map(|w| (w[1] - w[0]) * (w[1] - w[0])).filter(|s| !s.is_nan());
    let (whole, pairs) = (lagged.pairs[0] as f64 - 1.0, *lagged.pairs.get(1)? as f64);
    let value = steps.sum::<f64>() / lagged.sums[0] * whole / pairs;
    value.is_finite().then_some(value)
}

/// Probability of a chi-squared variable above a value.
pub(super) fn chi_squared_above(value: f64, degrees: usize) -> f64 {
    match degrees {
        0 => 1.0,
        _ if value.is_finite() => chi_squared_tail(value, degrees as f64).unwrap_or(1.0),
        _ => 0.0,
    }
}

/// Probability of a standard normal deviate at least as far from zero.
pub(super) fn normal_beyond(deviate: f64) -> f64 {
    (2.0 * normal_tail(deviate.abs())).min(1.0)
}

/// Why residuals could not be tested.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Untested {
    /// Samples are not at equal intervals (even with gaps), so that there are no common lags.
    UnevenSampling,
    /// Too few samples are compared.
    TooFewSamples,
    /// The residuals do not vary.
    NoResidual,
    /// Of some samples only a limit is known, so that the residuals of the others are a part of the noise.
    BelowLimit,
}

impl fmt::Display for Untested {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::UnevenSampling => "the samples are not at equal intervals",
            Self::TooFewSamples => "too few samples are compared",
            Self::NoResidual => "the residuals do not vary",
            Self::BelowLimit => "samples below their limit have no residuals",
        })
    }
}

impl From<NotEven> for Untested {
    fn from(reason: NotEven) -> Self {
        match reason {
            NotEven::Uneven => Self::UnevenSampling,
            NotEven::TooFew => Self::TooFewSamples,
        }
    }
}

/// Bands of the whole range, about evenly spaced on a logarithmic axis.
const BANDS: f64 = 48.0;
/// Fewest frequencies of the record in a band.
const FEWEST_IN_BAND: usize = 3;
/// Probability on each side of the limits.
const TAIL: f64 = 0.025;

/// Mean power densities in bands.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct ResidualSpectrum {
    /// Middle of each band (K) in cycles per unit of time, rising.
    pub frequency: Vec<f64>,
    /// Density in it (K) over that of white noise with the variance of these residuals.
    pub density: Vec<f64>,
    /// Limits (K) within which 95 % of these densities lie for white noise.
    pub low: Vec<f64>,
    /// The upper ones.
    pub high: Vec<f64>,
    /// Bands beyond their limits; one of twenty is to be expected.
    pub outside: usize,
}

/// The limits for a band of so many frequencies. They are kept for the whole process: all outputs and runs have bands as wide, and a quantile
/// takes longer than all else about a band.
fn limits(count: usize) -> [f64; 2] {
    static KEPT: LazyLock<Mutex<BTreeMap<usize, [f64; 2]>>> = LazyLock::new(Mutex::default);
    let freedom = 2.0 * count as f64;
    let limit = |p: f64| chi_squared_quantile(p, freedom).map_or(f64::NAN, |value| value / freedom);
    let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    *kept.entry(count).or_insert_with(|| [limit(TAIL), limit(1.0 - TAIL)])
}

impl ResidualSpectrum {
    /// Of residuals about their mean on an even grid with this interval, NaN where there is none; none when there are too few.
    pub(super) fn new(series: &[f64], interval: f64) -> Option<Self> {
        let present = series.iter().filter(|v| !v.is_nan());
        let power: f64 = present.map(|v| v * v).sum();
        // the last one of an even number of samples has half the freedom of the others
        let last = series.len().saturating_sub(1) / 2;
        if last < 2 * FEWEST_IN_BAND || !(power > 0.0 && power.is_finite()) {
            return None;
        }
        let mut bins = vec![Complex64::ZERO; last];
        // the Fourier sum of what is there: gaps add nothing
        let filled = series.iter().map(|v| if v.is_nan() { 0.0 } else { *v });
        RealFft::new(series.len()).transform(filled, 1..last + 1, &mut bins);
        let (mut found, ratio) = (Self::empty(), (last as f64).powf(1.0 / BANDS));
        let mut from = 1;
        while from <= last {
            let wanted = ((from as f64 * ratio) as usize).max(from + FEWEST_IN_BAND);
            // what would be left over belongs to the last band
            let to = if wanted + FEWEST_IN_BAND > last + 1 { last + 1 } else { wanted };
            let own = &bins[from - 1..to - 1];
            let density = own.iter().map(|x| x.norm_sqr()).sum::<f64>() / (own.len() as f64 * power);
            let middle = (from as f64 * (to - 1) as f64).sqrt();
            found.push(middle / (series.len() as f64 * interval), density, own.len());
            from = to;
        }
        Some(found)
    }

    fn empty() -> Self {
        Self { frequency: Vec::new(), density: Vec::new(), low: Vec::new(), high: Vec::new(), outside: 0 }
    }

    fn push(&mut self, frequency: f64, density: f64, count: usize) {
        let [low, high] = limits(count);
        self.frequency.push(frequency);
        self.density.push(density);
        self.low.push(low);
        self.high.push(high);
        self.outside += usize::from(density < low || density > high);
    }
}

/// Lags on either side.
const INPUT_LAGS: usize = 50;
/// Part of the record up to which an input may act.
const REACH: usize = 10;
/// Part of the input's power that has to meet residuals at a lag.
const LEAST_PART: f64 = 0.2;

/// Correlation of the residuals of one output with one input, lag by lag.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct InputCorrelation {
    /// Name of the input.
    pub input: String,
    /// Time by which the residual follows the input; negative where it leads.
    pub lags: Vec<f64>,
    /// Correlation at each lag.
    pub correlation: Vec<f64>,
    /// Two standard deviations of each for residuals of the same colour that have nothing to do with this input.
    pub bounds: Vec<f64>,
    /// Lags beyond their bound.
    pub outside: usize,
    /// The lag that is furthest beyond what chance explains.
    pub largest_lag: f64,
    /// The correlation there.
    pub largest: f64,
    /// Probability of one as large at any of the lags by chance (Bonferroni's bound).
    pub p_value: f64,
}

impl InputCorrelation {
    /// Whether chance does not explain the largest correlation (at one percent).
    pub fn is_significant(&self) -> bool {
        self.p_value < SIGNIFICANT
    }

    /// Correlates residuals (about their mean, NaN where there is none) of known colour with an input, both on one even grid;
    /// none when the input does not move.
    ///
    /// The input is known, so the bounds are those of the sum of `u(i - lag) v(i)` under the autocovariance of v: its
    /// innovations, one by one, through the autoregression run backward over the input.
    pub(super) fn new(
        name: &str,
        residuals: &[f64],
        input: &[f64],
        colour: &AutoRegression,
        interval: f64,
    ) -> Option<Self> {
        let filled = filled(residuals);
        let input = moving(input)?;
        let n = filled.len();
        let furthest = (n / REACH).max(1);
        let step = furthest.div_ceil(INPUT_LAGS).max(1);
        let places = (furthest / step) as i64;
        let norm = (square(&filled) * square(&input)).sqrt();
        let spread = spread(residuals, &input, colour) / norm;
        // what of the input meets a residual at each lag
        let met: Vec<f64> = residuals.iter().map(|v| if v.is_nan() { 0.0 } else { 1.0 }).collect();
        let power: Vec<f64> = input.iter().map(|u| u * u).collect();
        let [mut before, mut behind] = [vec![0.0; places as usize + 1], vec![0.0; places as usize + 1]];
        add_lagged_products(&power, &met, step, &mut before);
        add_lagged_products(&met, &power, step, &mut behind);
        let whole = before[0];
        let mut found = Self::empty(name);
        let mut largest_ratio = -1.0;
        let [mut following, mut leading] = [vec![0.0; places as usize + 1], vec![0.0; places as usize + 1]];
        add_lagged_products(&input, &filled, step, &mut following);
        add_lagged_products(&filled, &input, step, &mut leading);
        for place in -places..=places {
            let lag = place * step as i64;
            let r = if place >= 0 { &following } else { &leading }[place.unsigned_abs() as usize] / norm;
            let part = if place >= 0 { &before } else { &behind }[place.unsigned_abs() as usize] / whole;
            if part.is_nan() || part < LEAST_PART {
                continue;
            }
            let deviation = spread * part.sqrt();
            let time = lag as f64 * interval;
            if r.abs() / deviation > largest_ratio {
                (largest_ratio, found.largest_lag, found.largest) = (r.abs() / deviation, time, r);
            }
            found.outside += usize::from(r.abs() > 2.0 * deviation);
            found.lags.push(time);
            found.correlation.push(r);
            found.bounds.push(2.0 * deviation);
        }
        if !(spread > 0.0 && largest_ratio.is_finite()) {
            return None;
        }
        found.p_value = (normal_beyond(largest_ratio) * found.lags.len() as f64).min(1.0);
        Some(found)
    }

    fn empty(name: &str) -> Self {
        let none = Vec::new;
        let (lags, correlation, bounds) = (none(), none(), none());
        Self { input: name.into(), lags, correlation, bounds, outside: 0, largest_lag: 0.0, largest: 0.0, p_value: 1.0 }
    }
}

/// Standard deviation of the sum of `u(i) v(i)` over the places where v is present.
fn spread(residuals: &[f64], input: &[f64], colour: &AutoRegression) -> f64 {
    let memory = colour.memory(residuals.len());
    let mut rows = vec![0.0; memory];
    rows.extend(residuals.iter().zip(input).map(|(v, u)| if v.is_nan() { 0.0 } else { *u }));
    colour.backward_series(&mut rows);
    (colour.variance * square(&rows)).sqrt()
}

/// Zeros for what is missing.
fn filled(series: &[f64]) -> Vec<f64> {
    series.iter().map(|v| if v.is_nan() { 0.0 } else { *v }).collect()
}

/// The input about its mean, zero where it is not known; none when it does not move.
fn moving(input: &[f64]) -> Option<Vec<f64>> {
    let known = || input.iter().filter(|u| u.is_finite());
    let count = known().count().max(1) as f64;
    let mean = known().sum::<f64>() / count;
    let size = known().fold(0.0_f64, |m, u| m.max(u.abs()));
    let moved: Vec<f64> = input.iter().map(|u| if u.is_finite() { u - mean } else { 0.0 }).collect();
    (square(&moved) > count * (4.0 * f64::EPSILON * size).powi(2)).then_some(moved)
}

fn square(values: &[f64]) -> f64 {
    inner(values, values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_numeric::random::Normal;

    fn tested(values: &[f64]) -> Whiteness {
        Whiteness::new(values, &EvenGrid::counted(values.len())).expect("enough")
    }

    #[test]
    fn statistics_are_those_of_the_textbook() {
        // fifteen squares would be too regular; their remainders are not
        let v: Vec<f64> = (0..12).map(|k| f64::from(k * k % 13)).collect();
        let mean = v.iter().sum::<f64>() / 12.0;
        let c = |k: usize| (0..12 - k).map(|i| (v[i] - mean) * (v[i + k] - mean)).sum::<f64>();
        let found = tested(&v);
        assert_eq!(found.degrees, 2);
        let q = 12.0 * 14.0 * ((c(1) / c(0)).powi(2) / 11.0 + (c(2) / c(0)).powi(2) / 10.0);
        assert!((found.ljung_box - q).abs() < 1e-12 && (found.p_value - (-q / 2.0).exp()).abs() < 1e-12);
        let steps: f64 = v.windows(2).map(|w| (w[1] - w[0]).powi(2)).sum();
        let squares: f64 = v.iter().map(|v| v * v).sum();
        assert!((found.durbin_watson.expect("varies") - steps / squares).abs() < 1e-12);
        assert!((found.bounds[0] - 2.0 * 11f64.sqrt() / 12.0).abs() < 1e-15);
        let runs = found.runs_test.expect("both signs");
        assert_eq!(runs.runs, 1 + v.windows(2).filter(|w| (w[0] > mean) != (w[1] > mean)).count());
    }

    #[test]
    fn white_residuals_are_refused_as_often_as_promised_with_and_without_gaps() {
        for gap in [0, 7] {
            let (mut low, mut outside, mut lags) = (0, 0, 0);
            for seed in 0..400 {
                let mut normal = Normal(seed * 7919 + 3);
                let mut v: Vec<f64> = (0..150).map(|_| 2.0 + normal.next()).collect();
                (0..150).filter(|k| gap > 0 && k % gap == 0).for_each(|k| v[k] = f64::NAN);
                let found = tested(&v);
                low += usize::from(found.p_value < 0.05);
                (outside, lags) = (outside + found.outside, lags + found.degrees);
            }
            // 20 of 400 are expected, with a standard deviation of 4.4
            assert!((6..=36).contains(&low), "{low} of 400, gap {gap}");
            let share = outside as f64 / lags as f64;
            assert!((0.03..0.06).contains(&share), "{share} beyond two sigma, gap {gap}");
        }
    }

    #[test]
    fn slow_and_alternating_residuals_are_told() {
        let slow: Vec<f64> = (0..200).map(|k| (0.1 * f64::from(k)).sin()).collect();
        let found = tested(&slow);
        assert!(!found.is_white() && found.durbin_watson.expect("varies") < 0.1 && found.outside > 10);
        assert!(found.runs_test.expect("both signs").p_value < 1e-6);
        let alternating: Vec<f64> = (0..200).map(|k| if k % 2 == 0 { 1.0 } else { -1.0 }).collect();
        assert!(tested(&alternating).durbin_watson.expect("varies") > 3.9);
        let none = Whiteness::new(&[1.0; 50], &EvenGrid::counted(50));
        assert_eq!(none, Err(Untested::NoResidual));
        assert_eq!(Whiteness::new(&[1.0, f64::NAN], &EvenGrid::counted(2)), Err(Untested::TooFewSamples));
    }
}

#[cfg(test)]
mod spectrum_tests {
    use super::*;
    use fdm_numeric::random::Stream;

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut random = Stream::seeded(seed);
        (0..n).map(|_| (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0).collect()
    }

    #[test]
    fn white_noise_stays_within_its_limits_and_a_line_does_not() {
        let (mut beyond, mut all) = (0, 0);
        for seed in 0..40 {
            let found = ResidualSpectrum::new(&centred(noise(1001, seed)), 0.1).unwrap();
            assert!(found.frequency.windows(2).all(|w| w[0] < w[1]) && found.frequency.last().unwrap() < &5.0);
            (beyond, all) = (beyond + found.outside, all + found.density.len());
        }
        let share = beyond as f64 / all as f64;
        assert!((0.03..0.07).contains(&share), "{share} of {all} bands");

        let line = |k: usize| 2.0 * (std::f64::consts::TAU * 0.7 * 0.1 * k as f64).sin();
        let series: Vec<f64> = noise(1000, 1).iter().enumerate().map(|(k, v)| v + line(k)).collect();
        let found = ResidualSpectrum::new(&centred(series), 0.1).unwrap();
        let peak = (0..found.density.len()).max_by(|a, b| found.density[*a].total_cmp(&found.density[*b])).unwrap();
        assert!((found.frequency[peak] - 0.7).abs() < 0.05 && found.density[peak] > 5.0 * found.high[peak]);
    }

    #[test]
    fn limits_are_those_of_chi_squared_and_densities_average_to_one() {
        let mut found = ResidualSpectrum::empty();
        found.push(1.0, 1.0, 1);
        // with two degrees of freedom the distribution is the exponential one
        assert!((found.low[0] + 0.975_f64.ln()).abs() < 1e-6 && (found.high[0] + 0.025_f64.ln()).abs() < 1e-6);
        // a seventh of the samples is missing
        let mut series = noise(7000, 3);
        series.iter_mut().step_by(7).for_each(|v| *v = f64::NAN);
        let found = ResidualSpectrum::new(&centred(series), 1.0).unwrap();
        let high = &found.density[found.density.len() / 2..];
        let mean = high.iter().sum::<f64>() / high.len() as f64;
        assert!((mean - 1.0).abs() < 0.05, "{mean}");
        assert_eq!(ResidualSpectrum::new(&[1.0, -1.0, 1.0], 1.0), None);
        assert_eq!(ResidualSpectrum::new(&[0.0; 40], 1.0), None);
    }
}

#[cfg(test)]
mod input_correlation_tests {
    use super::*;
    use crate::residuals::autoregression;
    use fdm_numeric::random::Normal;

    /// An input of slow steps, as pilots fly them.
    fn steps(n: usize) -> Vec<f64> {
        (0..n).map(|k| f64::from(u8::from(k / 40 % 3 == 1)) - f64::from(u8::from(k / 40 % 3 == 2))).collect()
    }

    /// Noise of a colour: v(i) = keep v(i-1) + e(i).
    fn coloured(n: usize, keep: f64, seed: u64) -> Vec<f64> {
        let (mut normal, mut v) = (Normal(seed), 0.0);
        (0..n + 100).map(|_| (v, v = keep * v + normal.next()).0).skip(100).collect()
    }

    #[test]
    fn coloured_residuals_that_have_nothing_to_do_with_the_input_pass() {
        // with bounds for white residuals nearly all of these would be significant
        let (mut significant, mut outside, mut lags) = (0, 0, 0);
        for seed in 0..200 {
            let v = coloured(600, 0.9, 1 + seed * 104_729);
            let found =
                InputCorrelation::new("u", &v, &steps(600), &autoregression::of_series(&v), 0.1).expect("moves");
            significant += usize::from(found.is_significant());
            (outside, lags) = (outside + found.outside, lags + found.lags.len());
        }
        let share = outside as f64 / lags as f64;
        assert!(significant <= 6, "{significant} of 200 at one percent");
        assert!((0.02..0.09).contains(&share), "{share} beyond two sigma");
    }

    #[test]
    fn what_the_input_does_too_late_is_found_at_its_lag() {
        let u = steps(600);
        let mut v = coloured(600, 0.5, 5);
        (12..600).for_each(|k| v[k] += u[k - 12]);
        let found = InputCorrelation::new("u", &v, &u, &autoregression::of_series(&v), 0.1).expect("moves");
        assert!(found.is_significant() && (found.largest_lag - 1.2).abs() < 0.25, "{}", found.largest_lag);
        assert!(found.largest > 0.3);
        assert_eq!(InputCorrelation::new("u", &v, &[3.0; 600], &autoregression::of_series(&v), 0.1), None);
    }
}
