//! What is asked of a response over time. Between samples a response is the cubic through four neighbours; every answer is a function of the samples,
//! and its derivatives are those of that function.

use super::measured::Measured;
use fdm_grammar::requirement::OfCourse;

/// A signal at the samples, with its derivatives by some columns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Course<'a> {
    /// Times since the manoeuvre began (N), rising.
    pub(super) time: &'a [f64],
    /// Its values (N).
    pub(super) y: &'a [f64],
    /// Its derivatives, N rows; empty where they were not asked for.
    pub(super) slopes: &'a [f64],
    /// Length of a row.
    pub(super) columns: usize,
}

/// A time, with its derivatives.
#[derive(Debug, Clone)]
pub(super) struct Moment {
    pub(super) t: f64,
    pub(super) slopes: Vec<f64>,
}

/// Four neighbours and their weights in a value and in its derivative by time.
struct Weights {
    first: usize,
    value: [f64; 4],
    rate: [f64; 4],
}

impl<'a> Course<'a> {
    fn row(&self, k: usize) -> &'a [f64] {
        if self.columns == 0 { &[] } else { &self.slopes[k * self.columns..(k + 1) * self.columns] }
    }

    fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether all values are finite.
    pub(super) fn is_finite(&self) -> bool {
        self.y.iter().all(|v| v.is_finite())
    }

    /// Lagrange's weights of a time between samples k and k + 1.
    fn weights(&self, k: usize, t: f64) -> Weights {
        let count = self.len().min(4);
        let first = k.saturating_sub(1).min(self.len() - count);
        let nodes = &self.time[first..first + count];
        let mut weights = Weights { first, value: [0.0; 4], rate: [0.0; 4] };
        for i in 0..count {
            let (mut value, mut rate, mut below) = (1.0, 0.0, 1.0);
            for j in (0..count).filter(|j| *j != i) {
                rate = rate * (t - nodes[j]) + value;
                value *= t - nodes[j];
                below *= nodes[i] - nodes[j];
            }
            (weights.value[i], weights.rate[i]) = (value / below, rate / below);
        }
        weights
    }

    /// Value, rate and derivatives of the value at a time between samples k and k + 1.
    fn between(&self, k: usize, t: f64) -> (f64, f64, Vec<f64>) {
        let weights = self.weights(k, t);
        let (mut value, mut rate, mut slopes) = (0.0, 0.0, vec![0.0; self.columns]);
        for i in 0..self.len().min(4) {
            let at = weights.first + i;
            value += weights.value[i] * self.y[at];
            rate += weights.rate[i] * self.y[at];
            slopes.iter_mut().zip(self.row(at)).for_each(|(s, d)| *s += weights.value[i] * d);
        }
        (value, rate, slopes)
    }

    /// The sample in front of a time.
    fn before(&self, t: f64) -> usize {
        self.time.partition_point(|s| *s <= t).saturating_sub(1).min(self.len().saturating_sub(2))
    }

    /// The value at a moment: it moves with the moment, too.
    pub(super) fn at(&self, moment: &Moment) -> Measured {
        let (value, rate, mut slopes) = self.between(self.before(moment.t), moment.t);
        slopes.iter_mut().zip(&moment.slopes).for_each(|(s, d)| *s += rate * d);
        Measured::of(value, slopes)
    }

    /// The first moment from sample `from` on at which the signal passes a level that has derivatives of its own.
    pub(super) fn passes(&self, from: usize, level: f64, by: &[f64]) -> Option<Moment> {
        let side = |k: usize| (self.y[k] - level).partial_cmp(&0.0).filter(|o| o.is_ne());
        let begins = (from..self.len()).find_map(side)?;
        let k = (from + 1..self.len()).find(|k| side(*k) != Some(begins))? - 1;
        Some(self.crossing(k, level, by))
    }

    /// The first moment from sample `from` on at which the signal comes through a level with a rate of this sign.
    pub(super) fn passes_towards(&self, from: usize, level: f64, sign: f64) -> Option<Moment> {
        let off = |k: usize| sign * (self.y[k] - level);
        let k = (from..self.len().saturating_sub(1)).find(|k| off(*k) < 0.0 && off(*k + 1) >= 0.0)?;
        Some(self.crossing(k, level, &[]))
    }

    /// The moment between samples k and k + 1 at which the signal passes a level.
    fn crossing(&self, k: usize, level: f64, by: &[f64]) -> Moment {
        let (mut a, mut b) = (self.time[k], self.time[k + 1]);
        let above = self.y[k] > level;
        for _ in 0..200 {
            let t = 0.5 * (a + b);
            if t <= a || t >= b {
                break;
            }
            if (self.between(k, t).0 > level) == above { a = t } else { b = t }
        }
        let t = 0.5 * (a + b);
        let (_, rate, slopes) = self.between(k, t);
        let slopes = slopes.iter().enumerate().map(|(c, d)| (by.get(c).unwrap_or(&0.0) - d) / rate).collect();
        Moment { t, slopes }
    }

    /// The greatest value from sample `from` on: the vertex of the parabola through the greatest sample and its neighbours.
    pub(super) fn greatest(&self, from: usize, sign: f64) -> Measured {
        let better = |a: usize, b: usize| if sign * self.y[b] > sign * self.y[a] { b } else { a };
        let k = (from..self.len()).reduce(better).unwrap_or_default();
        let own = || Measured::of(self.y[k], self.row(k).to_vec());
        if k <= from || k + 1 >= self.len() {
            return own();
        }
        let t = [self.time[k - 1], self.time[k], self.time[k + 1]];
        let y = [self.y[k - 1], self.y[k], self.y[k + 1]];
        let (left, right) = ((y[1] - y[0]) / (t[1] - t[0]), (y[2] - y[1]) / (t[2] - t[1]));
        let bend = (right - left) / (t[2] - t[0]);
        let at = 0.5 * (t[0] + t[1]) - 0.5 * left / bend;
        if !(at > t[0] && at < t[2]) {
            return own();
        }
        let weight = |i: usize| {
            let others = (0..3).filter(|j| *j != i);
            others.map(|j| (at - t[j]) / (t[i] - t[j])).product::<f64>()
        };
        // at the vertex the value does not move with the time
        let (mut value, mut slopes) = (0.0, vec![0.0; self.columns]);
        for (i, y) in y.iter().enumerate() {
            value += weight(i) * y;
            slopes.iter_mut().zip(self.row(k - 1 + i)).for_each(|(s, d)| *s += weight(i) * d);
        }
        Measured::of(value, slopes)
    }

    /// The integral of the cubics between the samples: Gauss' rule of two points.
    fn integral(&self) -> Measured {
        let (mut value, mut slopes) = (0.0, vec![0.0; self.columns]);
        for k in 0..self.len() - 1 {
            let (a, b) = (self.time[k], self.time[k + 1]);
            let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
            for side in [-1.0, 1.0] {
                let (v, _, d) = self.between(k, middle + side * half / 3f64.sqrt());
                value += half * v;
                slopes.iter_mut().zip(&d).for_each(|(s, d)| *s += half * d);
            }
        }
        Measured::of(value, slopes)
    }

    /// What is asked; `other` is the signal that decides when, where one does.
    pub(super) fn of(&self, of: OfCourse, other: Option<&Course<'_>>) -> Measured {
        if !self.is_finite() || other.is_some_and(|o| !o.is_finite()) {
            return Measured::missing("the response diverges");
        }
        let last = self.len() - 1;
        let (start, end) = (self.y[0], self.y[last]);
        let change = end - start;
        let part = |share: f64| {
            let level = start + share * change;
            let by = self.row(0).iter().zip(self.row(last)).map(|(a, b)| a + share * (b - a)).collect::<Vec<f64>>();
            (level, by)
        };
        match of {
            OfCourse::At => Measured::of(end, self.row(last).to_vec()),
            OfCourse::Maximum => self.greatest(0, 1.0),
            OfCourse::Minimum => self.greatest(0, -1.0),
            OfCourse::Integral => self.integral(),
            OfCourse::When(level) => match self.passes(0, level, &[]) {
                Some(moment) => Measured::of(moment.t, moment.slopes),
                None => Measured::missing("the signal does not pass the level"),
            },
            OfCourse::Reached(_, level) => match other.and_then(|o| o.passes(0, level, &[])) {
                Some(moment) => self.at(&moment),
                None => Measured::missing("the signal does not pass the level"),
            },
            _ if change == 0.0 => Measured::missing("the response ends where it begins"),
            OfCourse::Overshoot => {
                let sign = change.signum();
                let peak = self.greatest(0, sign);
                let excess = sign * (peak.value - end);
                let size = change.abs();
                let slope = |(c, d): (usize, &f64)| {
                    let (a, b) = (self.row(0)[c], self.row(last)[c]);
                    sign * (d - b) / size - excess / (size * size) * sign * (b - a)
                };
                Measured::of(excess / size, peak.gradient.iter().enumerate().map(slope).collect())
            }
            OfCourse::RiseTime => {
                let [low, high] = [0.1, 0.9].map(|share| {
                    let (level, by) = part(share);
                    self.passes(0, level, &by)
                });
                match (low, high) {
                    (Some(low), Some(high)) => {
                        let slopes = high.slopes.iter().zip(&low.slopes).map(|(b, a)| b - a).collect();
                        Measured::of(high.t - low.t, slopes)
                    }
                    _ => Measured::missing("the response does not rise"),
                }
            }
            OfCourse::SettlingTime => {
                let off = |k: usize| (self.y[k] - end) / change.abs();
                match (0..last).rev().find(|k| off(*k).abs() > 0.05) {
                    Some(k) => {
                        let (level, by) = part(1.0 + 0.05 * off(k).signum() * change.signum());
                        let moment = self.crossing(k, level, &by);
                        Measured::of(moment.t, moment.slopes)
                    }
                    None => Measured::missing("the response is at its end all the time"),
                }
            }
        }
    }
}
