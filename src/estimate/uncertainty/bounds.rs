//! What is known beside parameters at their bounds.
//!
//! With a parameter b held at its bound L the others answer `theta(L) - theta0 = e + K (L - b0)`: e is their error were L the true value, K how they follow b.
//! The likelihood says how far inside the bound b0 may be: its parabola has its top m behind the bound, and with nothing known of b0 but the bound itself
//! `T = b0 - L` follows a normal law about m, cut off at the bound (and at the other one). So the mean square error of the others is `cov(e) + K E[T T'] K'`,
//! and what T stays below with 95 % probability is the limit of b. Of several bounds the moments are found by expectation propagation (Minka 2001).

use fdm_numeric::quadratic::{Inverse, Quadratic};
use fdm_numeric::statistics::normal_tail;
use nalgebra::{Cholesky, DMatrix, DVector};

/// Rounds of expectation propagation, and the change of a precision that ends them.
const ROUNDS: usize = 100;
const SETTLED: f64 = 1e-9;
/// Deviations behind the bound from which on the tail of the normal law is exponential.
const DEEP: f64 = 25.0;
/// Probability that a limit leaves outside.
pub(super) const OUTSIDE: f64 = 0.05;

/// A parameter at its bound.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Held {
    /// Its place among the chosen unknowns.
    pub(crate) place: usize,
    /// 1 at a lower bound, -1 at an upper one.
    side: f64,
    /// Scaled step to the top of the parabola.
    top: f64,
    /// Scaled distance to the other bound.
    room: f64,
}

/// The inverse information with those of `at` (unknown, side, room to the other bound) besides that it determines as well as all others.
pub(crate) fn opened(quadratic: &mut Quadratic, inverse: Inverse, at: &[(usize, f64, f64)]) -> (Inverse, Vec<Held>) {
    let at: Vec<&(usize, f64, f64)> = at.iter().filter(|(j, ..)| quadratic.scale[*j] > 0.0).collect();
    // most parameters at bounds that are looked behind
    if at.is_empty() || at.len() > 32 || inverse.chosen.is_empty() {
        return (inverse, Vec::new());
    }
    let mut with = |best: &Inverse, more: &[usize]| {
        let mut chosen = best.chosen.clone();
        chosen.extend(more);
        chosen.sort_unstable();
        let found = quadratic.invert(chosen, Inverse::default())?;
        (found.null.len() == inverse.null.len() && found.values.iter().all(|v| v.is_finite())).then_some(found)
    };
    let all: Vec<usize> = at.iter().map(|(j, ..)| *j).collect();
    let open = with(&inverse, &all)
        .unwrap_or_else(|| all.iter().fold(inverse.clone(), |best, j| with(&best, &[*j]).unwrap_or(best)));
    let n = open.chosen.len();
    let held = |(j, side, room): &&(usize, f64, f64)| {
        let place = open.chosen.binary_search(j).ok()?;
        let row = &open.values[place * n..][..n];
        let top = row.iter().zip(&open.chosen).map(|(d, other)| d * quadratic.rhs[*other]).sum();
        Some(Held { place, side: *side, top, room: room * quadratic.scale[*j] })
    };
    let held = at.iter().filter_map(held).collect();
    (open, held)
}

/// How all others follow those at bounds (n by h): `K = D_oh D_hh^-1`, the unit matrix in the rows of those themselves.
fn follow(inverse: &Inverse, held: &[Held]) -> Option<DMatrix<f64>> {
    let n = inverse.chosen.len();
    let known = DMatrix::from_row_slice(n, n, &inverse.values);
    let columns = DMatrix::from_fn(n, held.len(), |i, k| known[(i, held[k].place)]);
    let own = DMatrix::from_fn(held.len(), held.len(), |a, b| known[(held[a].place, held[b].place)]);
    Some(Cholesky::new(own)?.solve(&columns.transpose()).transpose())
}

/// A step of the chosen unknowns (n) with those at bounds staying there.
pub(crate) fn stay(inverse: &Inverse, held: &[Held], step: &mut [f64]) {
    let Some(follow) = Some(held).filter(|h| !h.is_empty()).and_then(|held| follow(inverse, held)) else { return };
    let moved = DVector::from_iterator(held.len(), held.iter().map(|h| step[h.place]));
    let taken = follow * moved;
    step.iter_mut().zip(taken.iter()).for_each(|(s, t)| *s -= t);
    held.iter().for_each(|h| step[h.place] = 0.0);
}

/// Mean square errors of all chosen unknowns (n by n) about the estimates, of the covariance (n by n) that they would have without bounds; and the limit of
/// each parameter at its bound: how far inside it may be (scaled, 95 %). Nothing changes where numbers are not finite.
pub(crate) fn within(inverse: &Inverse, held: &[Held], covariance: &mut [f64]) -> Vec<Option<f64>> {
    let none = vec![None; held.len()];
    let n = inverse.chosen.len();
    if held.is_empty() || covariance.len() != n * n {
        return none;
    }
    let Some(follow) = follow(inverse, held) else { return none };
    let free = DMatrix::from_row_slice(n, n, covariance);
    let h = held.len();
    let own = DMatrix::from_fn(h, h, |a, b| held[a].side * held[b].side * free[(held[a].place, held[b].place)]);
    let top = DVector::from_fn(h, |k, _| held[k].side * held[k].top);
    let room: Vec<f64> = held.iter().map(|k| k.room).collect();
    let Some(inside) = Inside::new(&top, &own, &room) else { return none };
    // e = x - K x_h, without the error of those at bounds
    let mut keep: DMatrix<f64> = DMatrix::identity(n, n);
    for (k, held) in held.iter().enumerate() {
        for i in 0..n {
            keep[(i, held.place)] -= follow[(i, k)];
        }
    }
    let squares = DMatrix::from_fn(h, h, |a, b| held[a].side * held[b].side * inside.squares[(a, b)]);
    let errors: DMatrix<f64> = &keep * free * keep.transpose() + &follow * squares * follow.transpose();
    if errors.iter().all(|v| v.is_finite()) {
        let symmetric: DMatrix<f64> = 0.5 * (&errors + errors.transpose());
        covariance.copy_from_slice(symmetric.as_slice());
    }
    inside.limits.into_iter().map(|limit| Some(limit).filter(|l| l.is_finite())).collect()
}

/// Numbers of a normal law, each known to be between 0 and its room.
struct Inside {
    /// Mean products.
    squares: DMatrix<f64>,
    /// What each stays below with 95 % probability.
    limits: Vec<f64>,
}

impl Inside {
    /// Of the mean and covariance without that knowledge. None where numbers are not finite.
    fn new(mean: &DVector<f64>, covariance: &DMatrix<f64>, room: &[f64]) -> Option<Self> {
        let h = mean.len();
        let precision = Cholesky::new(covariance.clone())?.inverse();
        let shift = &precision * mean;
        // what each bound says, as a normal factor: precision, and precision times mean
        let mut sites = vec![(0.0, 0.0); h];
        let mut cut = vec![Cut { mean: 0.0, variance: 0.0, limit: f64::NAN }; h];
        let (mut now, mut spread) = (mean.clone(), covariance.clone());
        for _ in 0..ROUNDS {
            let mut change = 0.0_f64;
            for k in 0..h {
                let (site, weight) = (sites[k], 1.0 / spread[(k, k)]);
                let cavity = weight - site.0;
                if cavity.is_nan() || cavity <= 0.0 {
                    continue;
                }
                let centre = (weight * now[k] - site.1) / cavity;
                cut[k] = Cut::of(centre, cavity.recip().sqrt(), room[k])?;
                let told = (1.0 / cut[k].variance - cavity).max(0.0);
                change = change.max((told - site.0).abs() / (told + cavity));
                sites[k] = (told, cut[k].mean / cut[k].variance - cavity * centre);
                let diagonal = DVector::from_iterator(h, sites.iter().map(|s| s.0));
                spread = Cholesky::new(&precision + DMatrix::from_diagonal(&diagonal))?.inverse();
                now = &spread * (&shift + DVector::from_iterator(h, sites.iter().map(|s| s.1)));
            }
            if change < SETTLED {
                break;
            }
        }
        let limits = cut.iter().map(|c| c.limit).collect();
        Some(Self { squares: &spread + &now * now.transpose(), limits })
    }
}

/// A normal law between 0 and a limit.
#[derive(Debug, Clone, Copy)]
struct Cut {
    mean: f64,
    variance: f64,
    /// What it stays below with 95 % probability.
    limit: f64,
}

impl Cut {
    /// None where numbers are not finite.
    fn of(centre: f64, deviation: f64, room: f64) -> Option<Self> {
        if !(centre.is_finite() && deviation > 0.0 && deviation.is_finite()) {
            return None;
        }
        let (low, high) = (-centre / deviation, (room - centre) / deviation);
        let (mean, variance, limit) = match low {
            low if low > DEEP => exponential(low, high - low),
            // from the other side: the bound lies deep below the top, and the other one does not
            low if low < -DEEP && high < -DEEP => {
                let (mean, variance, _) = exponential(-high, high - low);
                (high - low - mean, variance, high - low)
            }
            low => {
                let (left, right) = (density(low), density(high));
                let all = normal_tail(low) - normal_tail(high);
                let about = (left - right) / all;
                let edge = |z: f64, d: f64| if z.is_finite() { z * d } else { 0.0 };
                let variance = 1.0 + (edge(low, left) - edge(high, right)) / all - about * about;
                let (mut from, mut to) = (low.max(-DEEP), high.min(low.max(0.0) + 2.0 * DEEP));
                // halvings of an interval in which a number is sought
                for _ in 0..60 {
                    let middle = 0.5 * (from + to);
                    let beyond = (normal_tail(middle) - normal_tail(high)) / all;
                    (from, to) = if beyond > OUTSIDE { (middle, to) } else { (from, middle) };
                }
                (about - low, variance, 0.5 * (from + to) - low)
            }
        };
        let variance = variance.max(1e-12) * deviation * deviation;
        Some(Self { mean: mean * deviation, variance, limit: limit * deviation }).filter(|c| c.mean.is_finite())
    }
}

/// Mean, variance and limit of what lies beyond `rate` deviations of a normal law, and not beyond its room.
fn exponential(rate: f64, room: f64) -> (f64, f64, f64) {
    let left = (-rate * room).exp();
    let limit = -(OUTSIDE + (1.0 - OUTSIDE) * left).ln() / rate;
    if left == 0.0 {
        return (1.0 / rate, 1.0 / (rate * rate), limit);
    }
    let lost = room * left / (1.0 - left);
    let mean = 1.0 / rate - lost;
    let square = 2.0 / (rate * rate) - lost * (room + 2.0 / rate);
    (mean, square - mean * mean, limit)
}

fn density(z: f64) -> f64 {
    (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_numeric::random::Stream;

    /// Draws of a normal law that are inside: means, mean products, limits.
    fn drawn(mean: [f64; 2], factor: [f64; 3], room: [f64; 2]) -> ([f64; 3], [f64; 2]) {
        let mut random = Stream::seeded(7);
        let (mut sums, mut all) = ([0.0; 3], [Vec::new(), Vec::new()]);
        for _ in 0..400_000 {
            let (a, b) = (random.normal_by_inversion(), random.normal_by_inversion());
            let x = [mean[0] + factor[0] * a, mean[1] + factor[1] * a + factor[2] * b];
            if (0..2).all(|k| x[k] > 0.0 && x[k] < room[k]) {
                sums.iter_mut().zip([x[0] * x[0], x[0] * x[1], x[1] * x[1]]).for_each(|(s, v)| *s += v);
                (0..2).for_each(|k| all[k].push(x[k]));
            }
        }
        let count = all[0].len() as f64;
        let limit = |mut of: Vec<f64>| {
            of.sort_by(f64::total_cmp);
            of[(0.95 * count) as usize]
        };
        (sums.map(|s| s / count), all.map(limit))
    }

    #[test]
    fn moments_are_those_of_draws() {
        for (mean, factor, room) in [
            ([-0.5, -1.0], [1.0, 0.5, 1.0], [f64::INFINITY, f64::INFINITY]),
            ([0.3, -0.4], [1.0, -0.6, 0.8], [2.0, f64::INFINITY]),
            ([-1.5, 0.0], [1.0, 0.0, 3.0], [f64::INFINITY, 1.0]),
        ] {
            let (squares, limits) = drawn(mean, factor, room);
            let root = DMatrix::from_row_slice(2, 2, &[factor[0], 0.0, factor[1], factor[2]]);
            let found = Inside::new(&DVector::from_column_slice(&mean), &(&root * root.transpose()), &room).unwrap();
            let got = [found.squares[(0, 0)], found.squares[(0, 1)], found.squares[(1, 1)]];
            for (got, want) in got.iter().chain(&found.limits).zip(squares.iter().chain(&limits)) {
                assert!((got / want - 1.0).abs() < 0.04, "{mean:?}: {got} {want}");
            }
        }
    }

    #[test]
    fn far_behind_a_bound_the_law_is_exponential() {
        for room in [f64::INFINITY, 0.05] {
            let [near, far] = [0.999, 1.001].map(|k| Cut::of(-k * DEEP, 1.0, room).unwrap());
            assert!((near.mean / far.mean - 1.0).abs() < 0.01 && (near.limit / far.limit - 1.0).abs() < 0.01);
            assert!((near.variance / far.variance - 1.0).abs() < 0.02, "{near:?} {far:?}");
        }
        let from_above = Cut::of(40.0, 1.0, 1.0).unwrap();
        assert!((from_above.mean - (1.0 - 1.0 / 39.0)).abs() < 1e-3, "{from_above:?}");
    }
}
