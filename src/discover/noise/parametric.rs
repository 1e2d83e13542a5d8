//! Spectra with few numbers: what most sensors' noise is, and what tells of the lowest bins where fit and candidates have eaten them.
//!
//! Autoregressive noise of order 0 (white), 1 (first-order Gauss-Markov) and 2 (a resonance), first-order Gauss-Markov noise beside white
//! noise, and a power of the frequency beside white noise. log S depends on one to three numbers, found by Whittle's likelihood with Fisher's scoring. Their
//! marginal likelihoods (Laplace) are comparable with those of smooth spectra, so that a family is believed as far as the bins speak for
//! it. A level at zero frequency is then known by all bins, not by the lowest three (Burg 1975; Beran 1994 for powers).

use super::added;
use super::residual_power::ResidualPower;
use fdm_estimate::LevinsonDurbin;
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use std::f64::consts::PI;

/// Most numbers of a family.
const MOST: usize = 3;
type Values = SVector<f64, MOST>;
type Square = SMatrix<f64, MOST, MOST>;

const ROUNDS: usize = 15;
const HALVINGS: usize = 5;
/// Decrease of the loss that is not worth another round.
const SETTLED: f64 = 1e-3;
/// Real numbers of residual power for each number of a family, at least.
const TOLD: f64 = 4.0;
/// Deviations of log S that is drawn or asked within a family: a linear law in its numbers goes no further.
const LARGEST: f64 = 6.0;
/// Deviations at which a normal approximation is held against the loss, and the parts of it that are tried.
const TAIL: f64 = 2.0;
const PARTS: [f64; 4] = [1.0, 0.8, 0.65, 0.5];
/// Prior of an exponent: between white and a random walk.
const EXPONENT: (f64, f64) = (1.0, 0.7);
/// Deviations of autoregressive coefficients, and of the level of what stands beside white noise (logarithm), before any bin is seen.
const COEFFICIENT: f64 = 1.0;
const BESIDE: f64 = 3.0;

/// What log S depends on.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Family {
    /// c - log |1 + a_1 e^-iw + ...|^2.
    Autoregressive(usize),
    /// Level, logarithm of the corner, log odds of its part (at low frequency) against white noise.
    GaussMarkov,
    /// Level, exponent, log odds of its part (at the middle frequency) against white noise.
    Power,
}

const FAMILIES: [Family; 5] = [
    Family::Autoregressive(0),
    Family::Autoregressive(1),
    Family::Autoregressive(2),
    Family::GaussMarkov,
    Family::Power,
];

/// A spectrum of a family at its fit.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Parametric {
    /// Logarithm of the marginal likelihood.
    pub(super) likelihood: f64,
    family: Family,
    numbers: Values,
    /// R with R R' the covariance of the numbers.
    root: Square,
    /// Logarithm of the highest frequency, that of the middle.
    highest: f64,
    middle: f64,
}

/// What one bin or band is asked with.
#[derive(Clone, Copy)]
struct Place {
    /// log f less that of the middle.
    along: f64,
    /// cos and sin of the phase from one sample to the next and to the one behind it, and sin^2 of its half.
    waves: [(f64, f64); MOST - 1],
    half: f64,
}

impl Place {
    fn new(log_frequency: f64, (highest, middle): (f64, f64)) -> Self {
        let phase = PI * (log_frequency - highest).min(0.0).exp();
        let (sin, cos) = phase.sin_cos();
        let (mut c, mut s) = (1.0, 0.0);
        let waves = [(); MOST - 1].map(|()| {
            (c, s) = (c * cos - s * sin, s * cos + c * sin);
            (c, s)
        });
        Self { along: log_frequency - middle, waves, half: (0.5 * phase).sin().powi(2) }
    }
}

impl Family {
    fn size(self) -> usize {
        match self {
            Self::Autoregressive(order) => 1 + order,
            Self::GaussMarkov | Self::Power => 3,
        }
    }

    /// The spectrum of a family at these numbers: what is the same at all places is asked once.
    fn spectrum(self, numbers: &Values) -> Spectrum {
        let corner = if self == Self::GaussMarkov { (-2.0 * numbers[1]).exp() } else { 0.0 };
        Spectrum { family: self, numbers: *numbers, corner, beside: Beside::of(numbers[2]) }
    }

    /// Means and deviations of the numbers before any bin is seen: level by level of the whole.
    fn prior(self, (level, deviation): (f64, f64), lowest: f64) -> (Values, Values) {
        let (mut mean, mut own) = (Values::zeros(), Values::repeat(1.0));
        (mean[0], own[0]) = (level, deviation);
        match self {
            Self::Autoregressive(order) => (1..=order).for_each(|k| own[k] = COEFFICIENT),
            Self::GaussMarkov => (mean[1], own[1]) = (0.5 * lowest, (-0.5 * lowest).max(1.0)),
            Self::Power => (mean[1], own[1]) = EXPONENT,
        }
        if matches!(self, Self::GaussMarkov | Self::Power) {
            own[2] = BESIDE;
        }
        (mean, own)
    }

    /// Where the iteration begins.
    fn starts(self, left: &[ResidualPower], places: &[Place], level: f64) -> Vec<Values> {
        let own = |order: usize| autoregression(left, places, order);
        let mean = |range: std::ops::Range<usize>| {
            let (sum, freedom) = left[range]
                .iter()
                .fold((0.0, 0.0), |(sum, freedom), l| (sum + l.freedom * l.power, freedom + l.freedom));
            if freedom > 0.0 && sum > 0.0 { (sum / freedom).ln() } else { level }
        };
        let third = left.len().div_ceil(3);
        let (low, high) = (mean(0..third), mean(left.len() - third..left.len()));
        match self {
            Self::Autoregressive(order) => vec![own(order)],
            Self::GaussMarkov => {
                let first = own(1);
                let phi = (-first[1]).clamp(0.05, 0.995);
                let corner = ((1.0 - phi) / (2.0 * phi.sqrt())).ln();
                let markov = first[0] - 2.0 * (1.0 - phi).ln();
                let odds = |part: f64, white: f64| Values::new(added(part, white), corner, part - white);
                let slow = odds(low, high);
                vec![odds(markov, high - 1.0), Values::new(slow[0], corner - 1.5, slow[2])]
            }
            Self::Power => vec![Values::new(added(level, high - 0.5), 1.0, level - high + 0.5)],
        }
    }
}

/// A family at its numbers.
struct Spectrum {
    family: Family,
    numbers: Values,
    /// Gauss-Markov: the inverse square of its corner.
    corner: f64,
    beside: Beside,
}

/// How much of the level is of a shape, and how much white: its part, and the logarithms of both.
struct Beside {
    part: f64,
    shaped: f64,
    white: f64,
}

impl Beside {
    fn of(odds: f64) -> Self {
        let (against, of) = ((-odds).exp(), odds.exp());
        Self { part: 1.0 / (1.0 + against), shaped: -against.ln_1p(), white: -of.ln_1p() }
    }
}

impl Spectrum {
    /// log S and its derivatives.
    fn at(&self, place: &Place) -> (f64, Values) {
        let numbers = &self.numbers;
        match self.family {
            Family::Autoregressive(order) => {
                let mut slope = Values::zeros();
                let (mut re, mut im) = (1.0, 0.0);
                for k in 1..=order {
                    let (c, s) = place.waves[k - 1];
                    re += numbers[k] * c;
                    im -= numbers[k] * s;
                }
                let square = (re * re + im * im).max(1e-12);
                slope[0] = 1.0;
                for k in 1..=order {
                    let (c, s) = place.waves[k - 1];
                    slope[k] = -2.0 * (re * c - im * s) / square;
                }
                (numbers[0] - square.ln(), slope)
            }
            Family::GaussMarkov => {
                let ratio = place.half * self.corner;
                let corner = 2.0 * ratio / (1.0 + ratio);
                self.beside_white(-ratio.ln_1p(), corner)
            }
            Family::Power => self.beside_white(-numbers[1] * place.along, -place.along),
        }
    }

    /// log S of a level times a part of this shape (logarithm, derivative by its number) and white noise, and its derivatives.
    fn beside_white(&self, shape: f64, by_number: f64) -> (f64, Values) {
        let Beside { part, shaped, white } = self.beside;
        let own = shape + shaped;
        let share = 1.0 / (1.0 + (white - own).exp());
        (self.numbers[0] + added(own, white), Values::new(1.0, share * by_number, share - part))
    }
}

/// Yule and Walker's coefficients from the power of bins.
fn autoregression(left: &[ResidualPower], places: &[Place], order: usize) -> Values {
    let freedom: f64 = left.iter().map(|l| l.freedom).sum();
    let mut lags = [0.0; MOST];
    for (cell, place) in left.iter().zip(places) {
        let cosines = std::iter::once(1.0).chain(place.waves.iter().map(|wave| wave.0));
        for (lag, cosine) in lags.iter_mut().take(order + 1).zip(cosines) {
            *lag += cell.freedom * cell.power * cosine / freedom.max(f64::MIN_POSITIVE);
        }
    }
    let model = LevinsonDurbin::of(&lags[..=order]).model(order);
    let mut found = Values::zeros();
    found[0] = model.variance.max(f64::MIN_POSITIVE).ln();
    found.iter_mut().skip(1).zip(&model.coefficients).for_each(|(own, a)| *own = -a);
    found
}

/// a_1 and a_2 of autoregressive noise of order 2 by the power of bands up to the Nyquist frequency.
pub(super) fn second_order(left: &[ResidualPower], highest: f64) -> (f64, f64) {
    let places: Vec<Place> = left.iter().map(|l| Place::new(l.log_frequency, (highest.ln(), 0.0))).collect();
    let found = autoregression(left, &places, 2);
    (found[1], found[2])
}

/// A loss with its gradient and information.
struct Scored {
    loss: f64,
    gradient: Values,
    information: Square,
}

/// All that a fit of one family is asked with.
struct Fit<'a> {
    family: Family,
    left: &'a [ResidualPower],
    places: &'a [Place],
    mean: Values,
    precision: Values,
}

impl Fit<'_> {
    fn scored(&self, numbers: &Values) -> Scored {
        let away = numbers - self.mean;
        let prior = self.precision.component_mul(&away);
        let mut found = Scored {
            loss: 0.5 * prior.dot(&away),
            gradient: prior,
            information: Square::from_diagonal(&self.precision),
        };
        let spectrum = self.family.spectrum(numbers);
        for (cell, place) in self.left.iter().zip(self.places).filter(|(cell, _)| cell.freedom > 0.0) {
            let (log, slope) = spectrum.at(place);
            let (weight, ratio) = (0.5 * cell.freedom, cell.power * (-log).exp());
            found.loss += weight * (log + ratio);
            found.gradient += slope * (weight * (1.0 - ratio));
            found.information.ger(weight, &slope, &slope, 1.0);
        }
        found
    }

    fn from(&self, mut numbers: Values) -> Option<(Values, Scored)> {
        let mut at = self.scored(&numbers);
        for _ in 0..ROUNDS {
            let mut step = at.information.cholesky()?.solve(&at.gradient);
            let promised = 0.5 * step.dot(&at.gradient);
            if !promised.is_finite() || promised < SETTLED {
                break;
            }
            let mut better = None;
            for _ in 0..HALVINGS {
                let next = numbers - step;
                let there = self.scored(&next);
                if there.loss < at.loss {
                    better = Some((next, there));
                    break;
                }
                step *= 0.4;
            }
            let Some((next, there)) = better else { break };
            (numbers, at) = (next, there);
        }
        at.loss.is_finite().then_some((numbers, at))
    }

    /// Part of the deviations of a normal approximation within which the loss rises as it says, in the direction that moves the lowest bin
    /// most, upwards: how much slow noise may hide below white noise is bounded more sharply than that.
    fn believed(&self, numbers: &Values, root: &Square, least: f64) -> f64 {
        let Some(place) = self.places.first().filter(|_| self.family.size() > 2) else { return 1.0 };
        let slope = root.tr_mul(&self.family.spectrum(numbers).at(place).1);
        let norm = slope.norm();
        if norm.is_nan() || norm <= 0.0 {
            return 1.0;
        }
        let direction = root * slope / norm;
        let rises = |part: &f64| self.scored(&(numbers + direction * (TAIL * part))).loss - least;
        let enough = |part: &f64| {
            let rise = rises(part);
            rise.is_finite() && rise < 0.5 * TAIL * TAIL
        };
        PARTS.into_iter().find(enough).unwrap_or(PARTS[PARTS.len() - 1])
    }
}

impl Parametric {
    /// All families that so many bins can tell of, by residual power in rising order; `deviation` is that of the level beforehand. Fits of
    /// families that are `known` of a residual that is like this one begin there.
    pub(super) fn all(left: &[ResidualPower], deviation: f64, known: &[&Self]) -> Vec<Self> {
        let (Some(first), Some(last)) = (left.first(), left.last()) else { return Vec::new() };
        let (lowest, highest) = (first.log_frequency, last.log_frequency);
        let middle = 0.5 * (lowest + highest);
        let places: Vec<Place> = left.iter().map(|l| Place::new(l.log_frequency, (highest, middle))).collect();
        let freedom: f64 = left.iter().map(|l| l.freedom).sum();
        let level = (left.iter().map(|l| l.freedom * l.power).sum::<f64>() / freedom).ln();
        let of = |family: Family| {
            let size = family.size();
            if freedom < TOLD * size as f64 || left.len() < 2 * size {
                return None;
            }
            let corner = 0.5 * places[0].half.max(f64::MIN_POSITIVE).ln();
            let (mean, deviation) = family.prior((level, deviation), corner);
            let fit = Fit { family, left, places: &places, mean, precision: deviation.map(|d| 1.0 / (d * d)) };
            let begun = known.iter().find(|known| known.family == family);
            let starts = begun.map_or_else(|| family.starts(left, &places, level), |known| vec![known.numbers]);
            let ends = starts.into_iter().filter_map(|start| fit.from(start));
            let (numbers, at) = ends.min_by(|a, b| a.1.loss.total_cmp(&b.1.loss))?;
            let factor = at.information.cholesky()?.unpack();
            let root = factor.transpose().solve_upper_triangular(&Square::identity())?;
            let root = root * fit.believed(&numbers, &root, at.loss);
            let priors: f64 = fit.precision.map(f64::ln).sum() / 2.0;
            let likelihood = priors - factor.diagonal().map(f64::ln).sum() - at.loss;
            likelihood.is_finite().then_some(Self { likelihood, family, numbers, root, highest, middle })
        };
        FAMILIES.into_iter().filter_map(of).collect()
    }

    /// log S at a frequency, and its derivatives by independent standard normal numbers.
    pub(super) fn at(&self, log_frequency: f64) -> (f64, Values) {
        let (log, slope) =
            self.family.spectrum(&self.numbers).at(&Place::new(log_frequency, (self.highest, self.middle)));
        let mut slope = self.root.tr_mul(&slope);
        let size = slope.norm();
        if size > LARGEST {
            slope *= LARGEST / size;
        }
        (log, slope)
    }

    /// Log S and its slopes at all of these frequencies.
    pub(super) fn along(&self, log_frequencies: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
        let mut values = DVector::zeros(log_frequencies.len());
        let mut slopes = DMatrix::zeros(log_frequencies.len(), MOST);
        for (k, log_frequency) in log_frequencies.iter().enumerate() {
            let (value, slope) = self.at(*log_frequency);
            values[k] = value;
            slopes.row_mut(k).tr_copy_from(&slope);
        }
        (values, slopes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_numeric::random::Stream;

    /// Derivatives of log S against central differences, for all families.
    #[test]
    fn derivatives_are_those_of_differences() {
        let numbers = Values::new(0.3, -0.7, 0.45);
        for family in FAMILIES {
            for log_frequency in [-6.0, -3.0, -1.0, -0.1] {
                let place = Place::new(log_frequency, (0.0, -3.0));
                let (_, slope) = family.spectrum(&numbers).at(&place);
                for k in 0..MOST {
                    let moved = |step: f64| {
                        let mut moved = numbers;
                        moved[k] += step;
                        family.spectrum(&moved).at(&place).0
                    };
                    let difference = (moved(1e-5) - moved(-1e-5)) / 2e-5;
                    let expected = if k < family.size() { slope[k] } else { 0.0 };
                    assert!((difference - expected).abs() < 1e-8, "{family:?} {k}: {difference} {expected}");
                }
            }
        }
    }

    /// Gamma variates of mean S with so many degrees of freedom at every bin, but for the lowest, which were fitted away.
    fn left(seed: u64, eaten: usize, density: impl Fn(f64) -> f64) -> Vec<ResidualPower> {
        let mut normal = Stream::seeded(seed);
        let bin = |k: usize| {
            let f = k as f64 / 400.0;
            let power = (0..4).map(|_| normal.normal_of_pair().powi(2)).sum::<f64>() / 4.0;
            let freedom = if k <= eaten { 0.0 } else { 4.0 };
            ResidualPower { log_frequency: f.ln(), power: density(f) * power, freedom }
        };
        (1..400).map(bin).collect()
    }

    fn likeliest(left: &[ResidualPower]) -> Parametric {
        let all = Parametric::all(left, 100.0, &[]);
        all.into_iter().max_by(|a, b| a.likelihood.total_cmp(&b.likelihood)).expect("a family")
    }

    #[test]
    fn the_family_is_found_and_goes_on_below_what_was_fitted_away() {
        let markov = |f: f64| 1.0 / (1.0 - 1.8 * (PI * f).cos() + 0.81);
        let power = |f: f64| 0.5 + 0.02 / f;
        let resonance = |f: f64| {
            let (c, s) = ((PI * f).cos(), (PI * f).sin());
            let (re, im) = (1.0 - 1.6 * c + 0.9 * (2.0 * c * c - 1.0), 1.6 * s - 0.9 * 2.0 * s * c);
            1.0 / (re * re + im * im)
        };
        type Case<'a> = (&'a dyn Fn(f64) -> f64, Family, f64);
        let cases: [Case<'_>; 4] = [
            (&|_| 2.0, Family::Autoregressive(0), 0.2),
            (&markov, Family::Autoregressive(1), 1.2),
            (&resonance, Family::Autoregressive(2), 0.4),
            (&power, Family::Power, 2.0),
        ];
        for (density, family, off) in cases {
            let found: Vec<Parametric> = (0..20).map(|seed| likeliest(&left(seed, 6, density))).collect();
            let right = found.iter().filter(|own| own.family == family).count();
            assert!(right >= 15, "{family:?} {right}");
            let f = 1.0_f64 / 400.0;
            let truth = density(f).ln();
            let near = found.iter().filter(|own| (own.at(f.ln()).0 - truth).abs() < off).count();
            assert!(near >= 17, "{family:?} {near}");
            // as uncertain as it says
            let squares = found.iter().filter(|own| own.family == family).map(|own| {
                let (value, slope) = own.at(f.ln());
                ((value - truth) / slope.norm()).powi(2)
            });
            let mean = squares.sum::<f64>() / right as f64;
            assert!(mean < 4.0, "{family:?} {mean}");
        }
    }
}
