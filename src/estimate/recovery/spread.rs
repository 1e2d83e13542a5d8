//! Where many starts lie: the given one first, then a scrambled Sobol sequence (Owen scrambling after Burley 2020) over the
//! parameters' ranges.

use fdm_grammar::model::{Origin, Param};
use fdm_numeric::random::mixed;
use fdm_system::model::Model;
use sobol_burley::{NUM_DIMENSIONS, sample};

/// A bound this many times further from zero than the start value calls for logarithms.
const WIDE: f64 = 100.0;
/// A positive parameter without an upper bound starts within this factor of its given value.
const FACTOR: f64 = 10.0;
/// Standard deviations of a prior on each side.
const DEVIATIONS: f64 = 2.0;

/// Start vectors, made one by one.
pub(crate) struct Spread<'a> {
    params: &'a [Param],
    /// All parameters of each run as they were given.
    given: &'a [Vec<f64>],
    /// What varies: parameter, run (none when shared), range.
    varied: Vec<(usize, Option<usize>, Range)>,
    seed: u64,
}

/// Where one parameter may start.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Range {
    /// Evenly from the first to the second.
    Even(f64, f64),
    /// `origin + x` where x goes evenly in its logarithm from the first to the second, which have one sign.
    Logarithmic { origin: f64, from: f64, to: f64 },
}

impl<'a> Spread<'a> {
    /// Around `given` (all parameters of each run). Shared parameters vary, and per-run ones that are bounded on both sides
    /// or have a prior; free initial values stay where the data put them otherwise, and biases where they were set.
    pub(crate) fn new(model: &'a Model, given: &'a [Vec<f64>], seed: u64) -> Self {
        let params = &model.definition().params[..];
        let mut varied = Vec::new();
        for (k, p) in params.iter().enumerate().filter(|(_, p)| !p.fixed) {
            let known = p.prior.is_some() || (p.lower.is_finite() && p.upper.is_finite());
            if p.per_run && known {
                varied.extend(given.iter().enumerate().map(|(r, theta)| (k, Some(r), Range::of(p, theta[k]))));
            } else if !p.per_run && p.origin == Origin::Declared {
                varied.push((k, None, Range::of(p, given.first().map_or(p.value, |theta| theta[k]))));
            }
        }
        Self { params, given, varied, seed }
    }

    /// The start with a number from 0, which is the given one.
    pub(crate) fn start(&self, number: usize) -> Vec<Vec<f64>> {
        if number == 0 { self.given.to_vec() } else { self.drawn(number, self.seed) }
    }

    /// Another start in place of the one with this number, the `attempt`-th from 1.
    pub(crate) fn instead(&self, number: usize, attempt: usize) -> Vec<Vec<f64>> {
        self.drawn(attempt, mixed(self.seed ^ mixed(!(number as u64))))
    }

    /// How many parameters vary, those of each run counted for every run.
    pub(crate) fn dimensions(&self) -> usize {
        self.varied.len()
    }

    /// Whether the starts of some parameter lie decades apart, so that many of them are far from everything.
    pub(crate) fn is_wide(&self) -> bool {
        self.varied.iter().any(|(k, ..)| self.params[*k].logarithmic || self.params[*k].spans_decades())
    }

    fn drawn(&self, number: usize, seed: u64) -> Vec<Vec<f64>> {
        let mut starts = self.given.to_vec();
        for (d, (k, run, range)) in self.varied.iter().enumerate() {
            let p = &self.params[*k];
            let value = range.at(share(number, d, seed)).clamp(p.lower, p.upper);
            match run {
                Some(run) => starts[*run][*k] = value,
                None => starts.iter_mut().for_each(|theta| theta[*k] = value),
            }
        }
        starts
    }
}

/// A number between 0 and 1, its ends left out.
fn share(number: usize, dimension: usize, seed: u64) -> f64 {
    // the sequence has so many dimensions and 2^16 points; further ones come from other scramblings
    let (block, dimension) = (dimension / NUM_DIMENSIONS as usize, dimension % NUM_DIMENSIONS as usize);
    let (round, number) = (number >> 16, number & 0xffff);
    let seed = mixed(seed ^ mixed((block as u64) << 32 | round as u64)) as u32;
    f64::from(sample(number as u32, dimension as u32, seed)) + f64::from(f32::EPSILON) / 4.0
}

impl Range {
    fn of(p: &Param, value: f64) -> Self {
        let (lower, upper) = (p.lower, p.upper);
        if p.logarithmic {
            return Self::positive(p, value);
        }
        if let Some(prior) = p.prior {
            let reach = DEVIATIONS * prior.deviation;
            return Self::Even((prior.mean - reach).clamp(lower, upper), (prior.mean + reach).clamp(lower, upper));
        }
        match (lower.is_finite(), upper.is_finite()) {
            (true, true) if p.spans_decades() => Self::Logarithmic { origin: 0.0, from: lower, to: upper },
            (true, true) => Self::within(lower, upper, value),
            (true, false) if value > lower => {
                Self::Logarithmic { origin: lower, from: (value - lower) / FACTOR, to: (value - lower) * FACTOR }
            }
            (false, true) if value < upper => {
                Self::Logarithmic { origin: upper, from: (value - upper) / FACTOR, to: (value - upper) * FACTOR }
            }
            // at its only bound nothing tells a size but the bound itself
            (true, false) => Self::Even(lower, lower + size(value)),
            (false, true) => Self::Even(upper - size(value), upper),
            (false, false) => Self::Even(value - 2.0 * size(value), value + 2.0 * size(value)),
        }
    }

    /// Of a parameter that is estimated by its logarithm: between its bounds where they are positive, else around its value.
    fn positive(p: &Param, value: f64) -> Self {
        let reach = p.prior.map(|prior| DEVIATIONS * prior.deviation);
        let around = |center: f64| match reach {
            Some(reach) => ((center - reach).max(center / FACTOR), center + reach),
            None => (center / FACTOR, center * FACTOR),
        };
        let known = reach.is_none() && p.lower > 0.0 && p.upper.is_finite();
        let center = p.prior.map_or(value, |prior| prior.mean.max(f64::MIN_POSITIVE));
        let (from, to) = if known { (p.lower, p.upper) } else { around(center) };
        Self::Logarithmic { origin: 0.0, from: from.max(p.lower), to: to.min(p.upper) }
    }

    /// Between two finite bounds that are not decades apart.
    fn within(lower: f64, upper: f64, value: f64) -> Self {
        // a start value close to zero, seen from the far bound, tells the size
        if lower == 0.0 && value > 0.0 && upper >= WIDE * value {
            return Self::Logarithmic { origin: 0.0, from: value * (value / upper), to: upper };
        }
        if upper == 0.0 && value < 0.0 && lower <= WIDE * value {
            return Self::Logarithmic { origin: 0.0, from: value * (value / lower), to: lower };
        }
        Self::Even(lower, upper)
    }

    fn at(self, share: f64) -> f64 {
        match self {
            // halves first: bounds may be as far apart as numbers go
            Self::Even(from, to) => from * (1.0 - share) + to * share,
            Self::Logarithmic { origin, from, to } => origin + from * (to / from).powf(share),
        }
    }
}

fn size(value: f64) -> f64 {
    if value == 0.0 { 1.0 } else { value.abs() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "model a {
        state x = free;
        param even = 1 in [-2, 2], wide = 1 in [1e-3, 1e3], small = 0.01 in [0, 100], half = 5 in [1, inf],
              open = -3, zero = 0, known = 7 fixed, bias = 0 per run, own = 0 in [-1, 1] per run;
        der(x) = -even*x - wide - small - half - open - zero - known;
        output y = x + bias + own;
    }";

    fn column(spread: &Spread<'_>, name: &str, run: usize, count: usize) -> Vec<f64> {
        let k = spread.params.iter().position(|p| p.quantity.name == name).unwrap();
        (0..count).map(|n| spread.start(n)[run][k]).collect()
    }

    #[test]
    fn starts_lie_within_bounds_and_fill_them() {
        let model = Model::from_text("a.fdm", TEXT).unwrap();
        let theta = model.definition().start();
        let given = [theta.clone(), theta.clone()];
        let spread = Spread::new(&model, &given, 1);
        assert_eq!(spread.start(0), given);
        let count = 256;
        let inside = |name: &str, from: f64, to: f64| {
            let values = column(&spread, name, 0, count);
            assert!(values.iter().all(|v| (from..=to).contains(v)), "{name}: {values:?}");
            assert_eq!(values, column(&spread, name, 1, count), "{name} is shared");
            values
        };
        let even = inside("even", -2.0, 2.0);
        let quarters = (0..4).map(|q| even.iter().filter(|v| (**v + 2.0).floor() as i32 == q).count());
        assert!(quarters.clone().all(|n| (60..=68).contains(&n)), "{:?}", quarters.collect::<Vec<_>>());
        let decades = inside("wide", 1e-3, 1e3).iter().filter(|v| **v < 1.0).count();
        assert!((120..=136).contains(&decades), "as many below one as above: {decades}");
        let small = inside("small", 1e-6, 100.0);
        assert!(small.iter().filter(|v| **v < 0.01).count() > 100, "around the start value on a logarithmic scale");
        inside("half", 1.0 + 0.4, 41.0);
        inside("open", -9.0, 3.0);
        inside("zero", -2.0, 2.0);
        let own: Vec<f64> = column(&spread, "own", 0, count);
        assert!(own.iter().all(|v| v.abs() <= 1.0) && own != column(&spread, "own", 1, count), "each run its own");
        for name in ["known", "bias", "x(0)"] {
            let values = column(&spread, name, 0, count);
            assert!(values.iter().all(|v| v.to_bits() == values[0].to_bits()), "{name} stays");
        }
    }

    #[test]
    fn seeds_and_numbers_make_different_starts_and_the_same_ones_again() {
        let model = Model::from_text("a.fdm", TEXT).unwrap();
        let given = [model.definition().start()];
        let start = |seed: u64, number: usize| Spread::new(&model, &given, seed).start(number);
        assert_eq!(start(1, 5), start(1, 5));
        assert_ne!(start(1, 5), start(2, 5));
        assert_ne!(start(1, 5), start(1, 6));
        assert_ne!(start(1, 5), start(1, 5 + (1 << 16)), "beyond the length of the sequence");
    }
}
