//! The noise of one output as a smooth logarithm of its spectrum, from cells of which a part has been fitted away.
//!
//! log S(f) is piecewise linear in log f between many knots, held by a prior: second differences are normal with a
//! deviation that the bins choose, so that without curvature the spectrum is a power of the frequency (white and 1/f
//! alike). What a projection of leverage h leaves of n bins has the mean S (n - h): the likelihood is that of gamma variates
//! (Whittle), solved by reweighted least squares; how smooth the spectrum is, is averaged over by Laplace's marginal
//! likelihood. What the bins do not tell (a band that was fitted away, whether a slope goes on) stays uncertain that way,
//! where a choice of the number of knots would call it known.
//!
//! Beside smooth spectra stand those with few numbers (autoregressive, Gauss-Markov, powers of the frequency): each family with the prior
//! probability of all smooth ones together, and believed by its marginal likelihood. Where the lowest bins were fitted away these say what all others tell
//! of them, and how surely.

use super::added;
use super::hat::Hat;
use super::parametric::Parametric;
use super::residual_power::ResidualPower;
use fdm_numeric::dense::{Factor, Pentadiagonal};
use fdm_numeric::random::Stream;
use nalgebra::{DMatrix, DVector};

/// Bins that are nearer in log f have one S.
const ALIKE: f64 = 0.02;
/// Distance of knots in log f.
const SPACING: f64 = 0.14;
/// Most knots.
const MOST: usize = 72;
/// Least and greatest distance of knots where bands are narrow, for a resonance: knots are as near as bands, within
/// these limits.
const NARROW: (f64, f64) = (0.03, 0.08);
const MOST_NARROW: usize = 240;
/// Deviations of second differences of knots at a distance of 0.3 that are weighed against each other; a resonance of quality 3 has
/// the last, a power of the frequency the first.
const CURVATURES: [f64; 5] = [0.008, 0.04, 0.18, 0.8, 3.2];
/// A resonance has at least half as many periods in a record (bin k has k / 2): below, where a bin or two tell all there is to
/// tell, the curvature is this at most.
const PERIODS: f64 = 10.0;
const GENTLE: f64 = 0.2;
/// Distance in log f of the means of records from their first bins, at least.
const APART: f64 = 1.2;
/// How much less likely than the likeliest so far a curvature is, in log-likelihood, beyond which rougher ones are not tried.
const HOPELESS: f64 = 4.0;
/// Prior probability of all smooth spectra together: as much as that of each of the five families with few numbers.
const SMOOTH: f64 = 1.0 / 6.0;
/// How much less likely than the likeliest a spectrum is, in log-likelihood, beyond which it is forgotten.
const NEGLIGIBLE: f64 = 12.0;
/// Deviation of the slope d log S / d log f.
const SLOPE: f64 = 1.0;
/// Deviation of the level: any.
const LEVEL: f64 = 1e3;
/// How much wider than the normal approximation spectra are drawn: where few bins tell, what is said of a spectrum was
/// measured to be too small by this much (lowest band beside a resonance).
const EXCESS: f64 = 1.2;
/// Knots at the usual distance over which the slope at the low end is taken, and the most by which S rises with falling frequency.
const NEAR: usize = 4;
const STEEPEST: f64 = 2.0;
/// Deviation of the slope below the lowest bin, at most: between 0 and the steepest all are alike.
const SLOPES: f64 = 0.6;
/// Prior probability that zeros wander from run to run, which is in no spectrum, and how far log S may be off then (deviation).
const WANDERING: f64 = 0.1;
const WANDER: f64 = 2.5;
const ROUNDS: usize = 40;
/// Change of the log-spectrum below which the iteration ends: the next would be about its square.
const SETTLED: f64 = 1e-3;
/// Least curvature of a cell's loss that is believed, as a share of what it is on average.
const LEAST_CURVATURE: f64 = 0.3;
/// The least density, as a part of its mean over the knots: forty decibels below it a record holds what its filters and its ends leave,
/// which no model is asked about, and a likelihood by such numbers would hear nothing else.
const DYNAMIC: f64 = 1e-4;
/// Variance of log S below which S is known well enough, and the most that is allowed for.
const KNOWN: f64 = 1.0;
const DOUBT: f64 = 12.0;
/// Bins without which not even a level is known.
const LEAST: f64 = 2.0;

/// The spectrum of one output's noise.
#[derive(Debug, Clone, PartialEq)]
pub struct LogSpectrum {
    /// Logarithms of frequencies, evenly spaced.
    knots: Vec<f64>,
    /// log S at the knots.
    values: DVector<f64>,
    /// What it is made of.
    parts: Vec<Smooth>,
    /// Marginal log-likelihood of what was left.
    evidence: f64,
    /// Below the knots, where the means of records stand.
    mean: Continued,
}

/// A spectrum continued below its lowest bin, to the means of records.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Continued {
    /// Distance in log f of the means from the lowest bin; 0 where there is no mean.
    below: f64,
    /// log S there and its deviation.
    value: f64,
    deviation: f64,
    /// log S there by what all other bins say.
    unheard: f64,
}

/// The spectrum of one smoothness, or of one family.
#[derive(Debug, Clone, PartialEq)]
struct Smooth {
    weight: f64,
    values: DVector<f64>,
    spread: Spread,
    /// log S at the means and its deviation.
    mean: (f64, f64),
}

impl Smooth {
    /// The family, of those with few numbers.
    fn family(&self) -> Option<&Parametric> {
        match &self.spread {
            Spread::Few(family, _) => Some(family),
            Spread::Knots(..) => None,
        }
    }

    /// log S so far below the lowest knot as it continues, and its variance.
    fn continued(&self, knots: &[f64], below: f64) -> (f64, f64) {
        if let Some(family) = self.family() {
            let (value, slope) = family.at(knots[0] - below);
            return (value, slope.norm_squared());
        }
        let near = near(knots);
        let mut level = DVector::zeros(knots.len());
        level[0] = 1.0;
        let mut line = level.clone();
        let mut rise = 0.0;
        if near > 0 {
            let span = knots[near] - knots[0];
            line[0] += below / span;
            line[near] -= below / span;
            rise = ((self.values[0] - self.values[near]) / span).clamp(0.0, STEEPEST);
        }
        let (line, level) = (self.spread.variance(line), self.spread.variance(level));
        let variance = level + (line - level).clamp(0.0, (SLOPES * below).powi(2));
        (self.values[0] + rise * below, variance)
    }
}

/// The median over what the spectrum may be, at each knot: a family that is a little likely and far away moves it little.
fn medians(parts: &[Smooth], knots: usize) -> DVector<f64> {
    DVector::from_fn(knots, |k, _| median(parts.iter().map(|part| (part.values[k], part.weight)).collect()))
}

/// The median of values with weights: between the two around half of the weight, in proportion.
fn median(mut values: Vec<(f64, f64)>) -> f64 {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|v| v.1).sum::<f64>();
    let (mut below, mut last): (f64, Option<(f64, f64)>) = (0.0, None);
    for (value, weight) in values {
        // weight up to the middle of this one
        let middle = below + 0.5 * weight;
        if middle >= half {
            return last.map_or(value, |(other, at)| other + (value - other) * (half - at) / (middle - at));
        }
        (below, last) = (below + weight, Some((value, middle)));
    }
    last.map_or(0.0, |(value, _)| value)
}

/// How uncertain the values at the knots are.
#[derive(Debug, Clone, PartialEq)]
enum Spread {
    /// L of their precision L L', and the covariance of neighbours.
    Knots(Factor, Pentadiagonal),
    /// Of a family: derivatives of the values by independent standard normal numbers (knots by numbers).
    Few(Box<Parametric>, DMatrix<f64>),
}

impl Spread {
    /// Variance of a sum of the values with these weights.
    fn variance(&self, mut weights: DVector<f64>) -> f64 {
        match self {
            Self::Knots(precision, _) => {
                precision.solve_lower(&mut weights);
                weights.norm_squared()
            }
            Self::Few(_, slopes) => slopes.tr_mul(&weights).norm_squared(),
        }
    }

    /// Variance at one place.
    fn variance_at(&self, hat: Hat) -> f64 {
        match self {
            Self::Knots(_, covariance) if hat.above > 0.0 => {
                covariance.square(&[(hat.below, 1.0 - hat.above), (hat.below + 1, hat.above)])
            }
            Self::Knots(_, covariance) => covariance.square(&[(hat.below, 1.0)]),
            Self::Few(_, slopes) => {
                let along = |number: usize| hat.parts().map(|(k, part)| part * slopes[(k, number)]).sum::<f64>();
                (0..slopes.ncols()).map(|number| along(number).powi(2)).sum()
            }
        }
    }

    /// A change of the values that is as likely as any.
    fn drawn(&self, normal: &mut Stream, knots: usize) -> DVector<f64> {
        match self {
            Self::Knots(precision, _) => {
                let mut change = DVector::from_fn(knots, |_, _| EXCESS * normal.normal_of_pair());
                precision.solve_upper(&mut change);
                change
            }
            Self::Few(_, slopes) => slopes * DVector::from_fn(slopes.ncols(), |_, _| EXCESS * normal.normal_of_pair()),
        }
    }
}

impl LogSpectrum {
    /// Fits what is left of one output; `level` is taken where nothing is.
    pub fn fit(left: &[ResidualPower], level: f64) -> Self {
        Self::of_bands((left, level), false, None)
    }

    /// Fits bands of one output some of which may be narrow, for a resonance. The iterations begin at a spectrum of the
    /// same bands, where there is one that what is left may be like.
    pub(crate) fn of_bands((left, level): (&[ResidualPower], f64), narrow: bool, like: Option<&Self>) -> Self {
        let lowest = lowest(left);
        let (means, left): (Vec<ResidualPower>, Vec<ResidualPower>) =
            left.iter().partition(|l| l.log_frequency < lowest);
        let left = &gathered(left)[..];
        let freedom: f64 = left.iter().map(|l| l.freedom).sum();
        let power = left.iter().map(|l| l.freedom * l.power).sum::<f64>() / freedom;
        if !(freedom > LEAST && power > 0.0 && power.is_finite()) {
            return Self::flat(level);
        }
        let knots = knots(left, narrow);
        let hats: Vec<Hat> = left.iter().map(|l| Hat::at(&knots, l.log_frequency)).collect();
        let like = like.filter(|like| like.knots == knots && !like.parts.is_empty());
        let mut values = like.map(|like| like.values.clone());
        let mut parts = Vec::new();
        let mut best = f64::NEG_INFINITY;
        let equal = SMOOTH / CURVATURES.len() as f64;
        for curvature in &CURVATURES {
            let prior = prior(&knots, *curvature);
            let start = values.unwrap_or_else(|| start(left, &hats, &prior, power, knots.len()));
            let Some((likelihood, part)) = Smooth::fit(left, &hats, &prior, start) else { return Self::flat(power) };
            values = Some(part.values.clone());
            parts.push((likelihood + equal.ln(), part));
            best = best.max(likelihood);
            if likelihood < best - HOPELESS {
                break;
            }
        }
        let known: Vec<&Parametric> = like.iter().flat_map(|like| &like.parts).filter_map(Smooth::family).collect();
        let families = Parametric::all(left, LEVEL / (knots.len() as f64).sqrt(), &known);
        let equal = (1.0 - SMOOTH) / families.len().max(1) as f64;
        parts.extend(families.into_iter().map(|family| {
            let (values, slopes) = family.along(&knots);
            let likelihood = family.likelihood + equal.ln();
            (
                likelihood,
                Smooth { weight: 1.0, values, spread: Spread::Few(Box::new(family), slopes), mean: (0.0, 0.0) },
            )
        }));
        let best = parts.iter().map(|p| p.0).fold(f64::NEG_INFINITY, f64::max);
        parts.retain(|p| p.0 > best - NEGLIGIBLE);
        let total: f64 = parts.iter().map(|p| (p.0 - best).exp()).sum();
        let parts: Vec<Smooth> = parts
            .into_iter()
            .map(|(likelihood, part)| Smooth { weight: (likelihood - best).exp() / total, ..part })
            .collect();
        let values = medians(&parts, knots.len());
        let evidence = best + total.ln();
        Self { knots, values, parts, evidence, mean: Continued::default() }.raised().continued(&means)
    }

    /// Without what lies too far below the rest.
    fn raised(mut self) -> Self {
        let mean = self.values.map(f64::exp).mean();
        let least = (DYNAMIC * mean).ln();
        let raise = |values: &mut DVector<f64>| values.apply(|v| *v = v.max(least));
        raise(&mut self.values);
        self.parts.iter_mut().for_each(|part| raise(&mut part.values));
        self
    }

    /// A spectrum of one level at all frequencies, which is known.
    pub fn flat(level: f64) -> Self {
        Self {
            knots: vec![0.0],
            values: DVector::from_element(1, level.max(1e-200).ln()),
            parts: Vec::new(),
            evidence: 0.0,
            mean: Continued::default(),
        }
    }

    /// Down to the means of records: what the bins say of them, and what the means themselves say beside all that explains them.
    fn continued(mut self, means: &[ResidualPower]) -> Self {
        let Some(first) = means.iter().map(|m| m.log_frequency).min_by(f64::total_cmp) else { return self };
        let below = self.knots[0] - first;
        let freedom: f64 = means.iter().map(|m| m.freedom).sum();
        let power: f64 = means.iter().map(|m| m.freedom * m.power).sum();
        let (knots, mut parts) = (std::mem::take(&mut self.knots), std::mem::take(&mut self.parts));
        let (mut likelihood, mut unheard) = (Vec::with_capacity(parts.len()), Vec::with_capacity(parts.len()));
        for part in &mut parts {
            let (value, variance) = part.continued(&knots, below);
            part.mean = (value, variance.sqrt());
            unheard.push((value, part.weight));
            let told =
                (freedom > 0.0).then(|| Told::of((value, variance), (freedom, power), part.values[0].min(value)));
            if let Some(told) = &told {
                part.mean = (told.value, told.variance.sqrt());
            }
            likelihood.push(told.map_or(0.0, |told| told.likelihood));
        }
        let best = likelihood.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if best.is_finite() {
            parts.iter_mut().zip(&likelihood).for_each(|(part, own)| part.weight *= (own - best).exp());
            let total: f64 = parts.iter().map(|part| part.weight).sum();
            parts.iter_mut().for_each(|part| part.weight /= total);
            self.evidence += best + total.ln();
            self.values = medians(&parts, knots.len());
        }
        let (value, unheard) = match parts.is_empty() {
            true => (self.values[0], self.values[0]),
            false => (median(parts.iter().map(|part| (part.mean.0, part.weight)).collect()), median(unheard)),
        };
        let deviation = parts.iter().map(|part| part.weight * part.mean.1.hypot(part.mean.0 - value)).sum();
        (self.knots, self.parts) = (knots, parts);
        self.mean = Continued { below, value, deviation, unheard };
        self
    }

    /// S at a frequency given by its logarithm. Below the lowest bin that was seen it goes on to that of the means, or as it rose there, if
    /// it did.
    pub fn at(&self, log_frequency: f64) -> f64 {
        self.with_means_at(self.mean.value, log_frequency)
    }

    /// S at a frequency where the means of records are heard of by all other bins alone. What the means hold may be an
    /// offset: noise that is told by them would hide it.
    pub(crate) fn without_means_at(&self, log_frequency: f64) -> f64 {
        self.with_means_at(self.mean.unheard, log_frequency)
    }

    fn with_means_at(&self, mean: f64, log_frequency: f64) -> f64 {
        let known = Hat::at(&self.knots, log_frequency).of(self.values.as_slice());
        let (below, near) = ((self.knots[0] - log_frequency).max(0.0), near(&self.knots));
        if below == 0.0 {
            return known.exp();
        }
        if self.mean.below > 0.0 {
            return (known + (mean - known) * (below / self.mean.below).min(1.0)).exp();
        }
        if near == 0 {
            return known.exp();
        }
        let rise = (self.values[0] - self.values[near]) / (self.knots[near] - self.knots[0]);
        (known + rise.clamp(0.0, STEEPEST) * below).exp()
    }

    /// S by which a bin is weighed: higher where the bins tell so little of S that its logarithm may be off by much. Otherwise bins
    /// whose noise was fitted away, and seems small for that, would speak the loudest.
    pub fn inflated(&self, log_frequency: f64) -> f64 {
        let doubt = self.uncertainty_at(log_frequency).powi(2);
        self.at(log_frequency) * (doubt - KNOWN).clamp(0.0, DOUBT).exp()
    }

    /// Where it stands out most, as the logarithm of a frequency: by so much in log S of what lies on either side.
    pub(crate) fn peak(&self, prominence: f64) -> Option<f64> {
        let largest = |range: std::ops::Range<usize>| range.max_by(|a, b| self.values[*a].total_cmp(&self.values[*b]));
        let least = |range: std::ops::Range<usize>| range.map(|k| self.values[k]).fold(f64::INFINITY, f64::min);
        let size = self.size();
        // 1/f noise is higher still at its low end
        let valley = (0..size).min_by(|a, b| {
            let height = |k: usize| self.values[k] - largest(k..size).map_or(0.0, |top| self.values[top]);
            height(*a).total_cmp(&height(*b))
        })?;
        let top = largest(valley..size)?;
        let stands = |beside: f64| self.values[top] - beside > prominence;
        (stands(self.values[valley]) && stands(least(top..size))).then(|| self.knots[top])
    }

    /// How likely what was left is, whatever the spectrum: the logarithm, without constants that all that is left of as many bins shares.
    pub fn evidence(&self) -> f64 {
        self.evidence
    }

    /// Number of knots.
    pub fn size(&self) -> usize {
        self.knots.len()
    }

    /// Deviation of log S from what it would be, averaged over cells with these weights: the mean over what the spectrum may be.
    pub(crate) fn uncertainty(&self, weights: &[(f64, f64)]) -> f64 {
        // the means have a deviation of their own
        let beyond = |log_frequency: f64| (self.knots[0] - log_frequency).max(0.0) * f64::from(self.mean.below > 0.0);
        let share = |log_frequency: f64| (beyond(log_frequency) / self.mean.below).min(1.0);
        let means: f64 = weights.iter().filter(|w| beyond(w.0) > 0.0).map(|(f, weight)| weight * share(*f)).sum();
        let of = |part: &Smooth| {
            let mut mean = DVector::zeros(self.size());
            for (log_frequency, weight) in weights.iter().filter(|w| beyond(w.0) == 0.0) {
                Hat::at(&self.knots, *log_frequency).parts().for_each(|(k, hat)| mean[k] += hat * weight);
            }
            let shift = mean.dot(&(&part.values - &self.values));
            let at_means = means * part.mean.1.hypot(part.mean.0 - self.mean.value);
            part.weight * (part.spread.variance(mean) + shift * shift + at_means * at_means).sqrt()
        };
        self.parts.iter().map(of).sum()
    }

    /// Uncertainty of log S at one place.
    fn uncertainty_at(&self, log_frequency: f64) -> f64 {
        let below = (self.knots[0] - log_frequency).max(0.0);
        let hat = Hat::at(&self.knots, log_frequency);
        let value = hat.of(self.values.as_slice());
        let of = |part: &Smooth| {
            if below > 0.0 && self.mean.below > 0.0 {
                let share = (below / self.mean.below).min(1.0);
                return part.weight * share * part.mean.1.hypot(part.mean.0 - self.mean.value);
            }
            let shift = hat.of(part.values.as_slice()) - value;
            part.weight * (part.spread.variance_at(hat) + shift * shift).sqrt()
        };
        self.parts.iter().map(of).sum()
    }

    /// A spectrum as likely as this one.
    pub(crate) fn drawn(&self, normal: &mut Stream) -> Self {
        let mut place = normal.uniform();
        let chosen = self.parts.iter().find(|part| {
            place -= part.weight;
            place < 0.0
        });
        let Some(part) = chosen.or(self.parts.last()) else { return self.clone() };
        let values = &part.values + part.spread.drawn(normal, self.size());
        let mut mean = Continued { deviation: 0.0, ..self.mean };
        if mean.below > 0.0 {
            mean.value = part.mean.0 + EXCESS * part.mean.1 * normal.normal_of_pair();
        }
        Self { knots: self.knots.clone(), values, parts: Vec::new(), evidence: 0.0, mean }
    }
}

/// log S at the means, from what it would be and what they say of it themselves.
struct Told {
    value: f64,
    variance: f64,
    /// Logarithm of the marginal likelihood of what they say.
    likelihood: f64,
}

impl Told {
    /// Where zeros may wander from run to run, which is in no spectrum: what runs say of each other is believed. The means of few records
    /// may be near zero by chance: S is no lower than at the lowest bin, `least`.
    fn of((value, variance): (f64, f64), told: (f64, f64), least: f64) -> Self {
        let steady = Self::new((value, variance), told);
        let wandering = Self::new((value, variance + WANDER * WANDER), told);
        let (a, b) = (steady.likelihood + (1.0 - WANDERING).ln(), wandering.likelihood + WANDERING.ln());
        let share = 1.0 / (1.0 + (b - a).exp());
        let (first, second) = (steady.value.max(least), wandering.value.max(least));
        let value = share * first + (1.0 - share) * second;
        let apart = |own: f64, told: &Self| told.variance + (own - value).powi(2);
        let variance = share * apart(first, &steady) + (1.0 - share) * apart(second, &wandering);
        Self { value, variance, likelihood: added(a, b) }
    }

    fn new((value, variance): (f64, f64), (freedom, power): (f64, f64)) -> Self {
        let mut shift = 0.0_f64;
        let ratio = |shift: f64| power * (-value - shift).exp();
        if variance > 0.0 {
            for _ in 0..ROUNDS {
                let slope = shift / variance + 0.5 * (freedom - ratio(shift));
                let curvature = 1.0 / variance + 0.5 * ratio(shift).max(LEAST_CURVATURE * freedom);
                let step = (slope / curvature).clamp(-2.0, 2.0);
                shift -= step;
                if step.abs() < SETTLED {
                    break;
                }
            }
        }
        let precision = 1.0 + 0.5 * freedom * variance;
        let prior = if variance > 0.0 { shift * shift / variance } else { 0.0 };
        let likelihood = -0.5 * (prior + freedom * (value + shift) + ratio(shift) + precision.ln());
        Self { value: value + shift, variance: variance / precision, likelihood }
    }
}

/// In the order of their frequencies, those together that no spectrum tells apart.
fn gathered(mut left: Vec<ResidualPower>) -> Vec<ResidualPower> {
    left.sort_by(|a, b| a.log_frequency.total_cmp(&b.log_frequency));
    let mut found: Vec<ResidualPower> = Vec::new();
    let mut begun = f64::NEG_INFINITY;
    for own in left {
        match found.last_mut() {
            Some(last) if own.log_frequency < begun + ALIKE => {
                let freedom = last.freedom + own.freedom;
                if freedom > 0.0 {
                    let share = own.freedom / freedom;
                    last.power += share * (own.power - last.power);
                    last.log_frequency += share * (own.log_frequency - last.log_frequency);
                }
                last.freedom = freedom;
            }
            _ => {
                begun = own.log_frequency;
                found.push(own);
            }
        }
    }
    found
}

/// Evenly from the lowest to the highest cell.
fn knots(left: &[ResidualPower], narrow: bool) -> Vec<f64> {
    let logs = || left.iter().map(|l| l.log_frequency);
    let (low, high) = (logs().fold(f64::INFINITY, f64::min), logs().fold(f64::NEG_INFINITY, f64::max));
    if high - low < SPACING {
        return vec![low];
    }
    let nearest =
        || left.windows(2).map(|pair| pair[1].log_frequency - pair[0].log_frequency).fold(f64::INFINITY, f64::min);
    let (spacing, most) = if narrow { (nearest().clamp(NARROW.0, NARROW.1), MOST_NARROW) } else { (SPACING, MOST) };
    let count = (((high - low) / spacing).round() as usize + 1).clamp(2, most);
    (0..count).map(|k| low + (high - low) * k as f64 / (count - 1) as f64).collect()
}

/// The knot up to which the slope at the low end is taken.
fn near(knots: &[f64]) -> usize {
    let step = if knots.len() > 1 { knots[1] - knots[0] } else { SPACING };
    let wanted = if step <= NARROW.1 { (NEAR as f64 * SPACING / step).round() as usize } else { NEAR };
    wanted.min(knots.len() - 1)
}

/// Logarithm of the lowest frequency above the means, which stand apart: bins follow each other by a factor of two at most.
fn lowest(left: &[ResidualPower]) -> f64 {
    let mut logs: Vec<f64> = left.iter().map(|l| l.log_frequency).collect();
    logs.sort_by(f64::total_cmp);
    let apart = logs.windows(2).rposition(|pair| pair[1] - pair[0] > APART);
    apart.map_or(f64::NEG_INFINITY, |k| logs[k + 1])
}

/// Precision of the values at the knots before any bin is seen.
fn prior(knots: &[f64], curvature: f64) -> Pentadiagonal {
    let size = knots.len();
    let mut precision = Pentadiagonal::diagonal(size, LEVEL.powi(-2));
    if size < 2 {
        return precision;
    }
    let (step, middle) = (knots[1] - knots[0], (size - 1) / 2);
    precision.add_square(&[(middle, -1.0), (middle + 1, 1.0)], (SLOPE * step).powi(-2));
    for k in 1..size - 1 {
        let own = if knots[k] < knots[0] + PERIODS.ln() { curvature.min(GENTLE) } else { curvature };
        // a walk of the slope: its deviation grows with the root of the distance
        let deviation = own * (step / 0.3).powf(1.5);
        precision.add_square(&[(k - 1, 1.0), (k, -2.0), (k + 1, 1.0)], deviation.powi(-2));
    }
    precision
}

/// Where the iteration begins: least squares through the logarithms.
fn start(left: &[ResidualPower], hats: &[Hat], prior: &Pentadiagonal, power: f64, size: usize) -> DVector<f64> {
    let (mut information, mut gradient) = (prior.clone(), DVector::zeros(size));
    for (cell, hat) in left.iter().zip(hats) {
        let weight = cell.freedom / 2.0;
        hat.add(weight, weight * cell.power.max(1e-6 * power).ln(), &mut information, &mut gradient);
    }
    match information.factor() {
        Some(factor) => {
            factor.solve(&mut gradient);
            gradient
        }
        None => DVector::from_element(size, power.ln()),
    }
}

impl Smooth {
    /// Marginal log-likelihood and what is likeliest under a prior.
    fn fit(
        left: &[ResidualPower],
        hats: &[Hat],
        prior: &Pentadiagonal,
        mut values: DVector<f64>,
    ) -> Option<(f64, Self)> {
        let mut information = prior.clone();
        for _ in 0..ROUNDS {
            information.clone_from(prior);
            let mut change = -prior.times(&values);
            for (cell, hat) in left.iter().zip(hats) {
                let weight = cell.freedom / 2.0;
                let ratio = cell.power * (-hat.of(values.as_slice())).exp();
                // Newton's step, but not where S is far too high and the curvature tells nothing
                hat.add(weight * ratio.max(LEAST_CURVATURE), weight * (ratio - 1.0), &mut information, &mut change);
            }
            information.factor()?.solve(&mut change);
            // a knot that starts far too low overshoots: at most this step in the logarithm at once
            let largest = change.amax();
            if largest > 2.0 {
                change *= 2.0 / largest;
            }
            values += &change;
            if largest < SETTLED {
                break;
            }
        }
        information.clone_from(prior);
        left.iter().zip(hats).for_each(|(cell, hat)| hat.add_weight(cell.freedom / 2.0, &mut information));
        let loss = |(cell, hat): (&ResidualPower, &Hat)| {
            let log = hat.of(values.as_slice());
            cell.freedom / 2.0 * (log + cell.power * (-log).exp())
        };
        let loss: f64 = left.iter().zip(hats).map(loss).sum::<f64>() + prior.times(&values).dot(&values) / 2.0;
        let precision = information.factor()?;
        let likelihood = prior.factor()?.log_root() - precision.log_root() - loss;
        let near = precision.inverse_near();
        let spread = Spread::Knots(precision, near);
        likelihood.is_finite().then_some((likelihood, Self { weight: 1.0, values, spread, mean: (0.0, 0.0) }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(density: impl Fn(f64) -> f64) -> LogSpectrum {
        let left = |k: usize| {
            let log_frequency = k as f64 * 0.2;
            ResidualPower { log_frequency, power: density(log_frequency.exp()), freedom: 20.0 }
        };
        LogSpectrum::fit(&(0..25).map(left).collect::<Vec<_>>(), 1.0)
    }

    #[test]
    fn only_a_resonance_stands_out() {
        assert_eq!(of(|_| 3.0).peak(1.5), None);
        assert_eq!(of(|f| 1.0 / f).peak(1.5), None);
        assert_eq!(of(|f| f).peak(1.5), None);
        let resonance = |f: f64| 1.0 / ((1.0 - f * f / 400.0).powi(2) + 0.04);
        assert!((of(resonance).peak(1.5).unwrap() - 20.0_f64.ln()).abs() < 0.3);
        // beside 1/f noise
        assert!(of(|f| resonance(f) + 20.0 / f).peak(1.0).is_some());
    }

    #[test]
    fn below_its_lines_a_spectrum_goes_on_as_it_rises() {
        let pink = of(|f| 5.0 / f);
        assert!((pink.at(-2.0) / (5.0 * 2.0_f64.exp()) - 1.0).abs() < 0.05);
        assert!((of(|f| f).at(-2.0) / of(|f| f).at(0.0) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_drift_is_unlikely_as_noise_of_a_smooth_spectrum() {
        // the cosine transform of a drift is in every other bin, falling with the square of the frequency
        let likelihood = |drift: f64| -> f64 {
            let bin = |k: usize| {
                let f = k as f64;
                let own = if k % 2 == 1 { drift / f.powi(4) } else { 0.0 };
                ResidualPower { log_frequency: f.ln(), power: 1.0 / f + own, freedom: 2.0 }
            };
            LogSpectrum::fit(&(1..300).map(bin).collect::<Vec<_>>(), 1.0).evidence()
        };
        let nats = likelihood(0.0) - likelihood(600.0);
        // a known spectrum would make it 300; one that may be anything, but smooth, a few for each bin in which the drift stands out
        assert!((8.0..60.0).contains(&nats), "{nats}");
        // what a smooth spectrum takes in is no less likely for its size
        assert!((likelihood(0.0) - likelihood(0.1)).abs() < 1.0);
    }

    /// Bins of so many samples and runs, one by one, and the means of the runs, which are all alike.
    fn with_means(samples: usize, runs: usize, density: impl Fn(f64) -> f64, mean: f64) -> LogSpectrum {
        let bin = |k: usize| {
            let f = k as f64;
            ResidualPower { log_frequency: f.ln(), power: density(f), freedom: runs as f64 }
        };
        let beside = runs as f64 - 1.0;
        let means = ResidualPower { log_frequency: 0.125_f64.ln(), power: mean, freedom: beside };
        let left: Vec<ResidualPower> = std::iter::once(means).chain((1..samples).map(bin)).collect();
        LogSpectrum::fit(&left, 1.0)
    }

    #[test]
    fn the_variance_of_a_mean_is_what_the_spectrum_continues_to() {
        let place = 0.125_f64.ln();
        let white = with_means(500, 1, |_| 2.0, 1.0);
        assert!((white.at(place) / 2.0).ln().abs() < 0.2, "{}", white.at(place));
        let doubt = |runs: usize| with_means(500, runs, |_| 2.0, 2.0).uncertainty(&[(place, 1.0)]);
        assert!(doubt(1) < 1.2 && doubt(2) < 0.9 && doubt(4) < 0.7, "{} {} {}", doubt(1), doubt(2), doubt(4));
        // 1/f noise: eight times its first bin
        let pink = with_means(500, 1, |f| 3.0 / f, 1.0);
        assert!((pink.at(place) / 24.0).ln().abs() < 0.3, "{}", pink.at(place));
        // means that differ from run to run are noise; such that are near zero by chance make no spectrum fall
        assert!(with_means(500, 4, |_| 2.0, 400.0).at(place) > 20.0);
        assert!(with_means(500, 4, |_| 2.0, 1e-6).at(place) > 1.9);
        // they may be an offset that nothing has taken out yet: the others do not hear of it
        let off = with_means(500, 3, |_| 2.0, 400.0);
        assert!((off.without_means_at(place) / 2.0).ln().abs() < 0.2, "{}", off.without_means_at(place));
        assert_eq!(off.without_means_at(2.0), off.at(2.0));
    }

    #[test]
    fn what_no_line_tells_is_uncertain() {
        let left = |k: usize| ResidualPower {
            log_frequency: k as f64 * 0.2,
            power: 1.0,
            freedom: if k < 6 { 0.0 } else { 20.0 },
        };
        let spectrum = LogSpectrum::fit(&(0..25).map(left).collect::<Vec<_>>(), 1.0);
        let uncertainty = |log: f64| spectrum.uncertainty(&[(log, 1.0)]);
        assert!((spectrum.at(0.0) - 1.0).abs() < 0.05);
        assert!(uncertainty(0.0) > 1.5 * uncertainty(1.2) && uncertainty(1.2) > uncertainty(3.0));
        let means = with_means(500, 2, |f| 3.0 / f, 1.0);
        for (own, log) in
            [(&spectrum, -1.0), (&spectrum, 0.07), (&spectrum, 3.3), (&means, -2.2), (&means, -1.0), (&means, 2.0)]
        {
            let (alone, among) = (own.uncertainty_at(log), own.uncertainty(&[(log, 1.0)]));
            assert!((alone / among - 1.0).abs() < 1e-6, "{log}: {alone} {among}");
        }
    }
}
