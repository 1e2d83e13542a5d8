//! The integration method ([`Scheme`]), its steps inside each interval between samples ([`Steps`]), and where these stand in one run
//! ([`Grid`]). Steps are chosen once for a fit and never cross a sample.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;

/// Stages of the three-stage Radau IIA method.
pub(super) const STAGES: usize = 3;

pub(super) const SQRT_6: f64 = 2.449_489_742_783_178;

/// Where its stages stand in a step; the last one is its end.
pub(super) const NODES: [f64; STAGES] = [(4.0 - SQRT_6) / 10.0, (4.0 + SQRT_6) / 10.0, 1.0];

/// The method and the steps of one run; they never cross a sample. The same steps fit every run of as many samples.
///
/// A whole number stands for as many equal Runge-Kutta steps in every interval.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Steps {
    scheme: Scheme,
    spacing: Spacing,
    /// Whether explicit steps are cut where `max`, `min`, `abs` or `if` change their branch.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    cut: bool,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Spacing {
    /// As many equal steps in every interval.
    Equal(usize),
    /// The end of each step as a part of its interval, and where each interval's steps begin and end in that list.
    Uneven { first: Vec<usize>, ends: Vec<f64> },
}

impl From<usize> for Steps {
    fn from(per_interval: usize) -> Self {
        Self::equal(Scheme::RungeKutta, per_interval)
    }
}

impl Steps {
    /// As many equal steps in every interval, at least one.
    pub fn equal(scheme: Scheme, per_interval: usize) -> Self {
        Self { scheme, spacing: Spacing::Equal(per_interval.max(1)), cut: false }
    }

    /// With cuts where rates have kinks: where `max`, `min`, `abs` or `if` change their branch, and at the knots of tables. Only
    /// explicit steps are cut, of models without events and delays.
    #[must_use]
    pub fn cut_at_kinks(self) -> Self {
        Self { cut: true, ..self }
    }

    /// Whether they are cut at kinks.
    pub fn are_cut(&self) -> bool {
        self.cut
    }

    /// As many equal steps in every interval instead.
    #[must_use]
    pub fn with_equal(&self, per_interval: usize) -> Self {
        Self { spacing: Spacing::Equal(per_interval.max(1)), ..self.clone() }
    }

    /// For each interval the ends of its steps, as parts of the interval: rising, the last one is taken as 1.
    pub fn uneven<'s>(scheme: Scheme, intervals: impl IntoIterator<Item = &'s [f64]>) -> Self {
        let (mut first, mut ends) = (vec![0], Vec::new());
        for interval in intervals {
            let inner = interval.split_last().map_or(&[][..], |(_, inner)| inner);
            let mut last = 0.0;
            for end in inner.iter().copied().filter(|e| *e < 1.0) {
                if end > last {
                    ends.push(end);
                    last = end;
                }
            }
            ends.push(1.0);
            first.push(ends.len());
        }
        Self { scheme, spacing: Spacing::Uneven { first, ends }, cut: false }
    }

    /// For each interval as many equal steps as asked for.
    pub fn counts(scheme: Scheme, counts: &[usize]) -> Self {
        let parts = |count: &usize| -> Vec<f64> {
            let count = (*count).max(1);
            (1..=count).map(|k| k as f64 / count as f64).collect()
        };
        let intervals: Vec<Vec<f64>> = counts.iter().map(parts).collect();
        Self::uneven(scheme, intervals.iter().map(Vec::as_slice))
    }

    /// The method.
    pub fn scheme(&self) -> Scheme {
        self.scheme
    }

    /// Steps in an interval; behind the last interval that is known, as many as there.
    pub fn within(&self, interval: usize) -> usize {
        match &self.spacing {
            Spacing::Equal(per_interval) => *per_interval,
            Spacing::Uneven { .. } => self.ends(interval).len().max(1),
        }
    }

    /// The number of equal steps in every interval, when it is one for all.
    pub fn per_interval(&self) -> Option<usize> {
        match self.spacing {
            Spacing::Equal(per_interval) => Some(per_interval),
            Spacing::Uneven { .. } => None,
        }
    }

    /// Steps of a run of so many samples.
    pub fn total(&self, samples: usize) -> usize {
        let intervals = samples.saturating_sub(1);
        match &self.spacing {
            Spacing::Equal(per_interval) => per_interval.saturating_mul(intervals),
            Spacing::Uneven { .. } => (0..intervals).map(|k| self.within(k)).sum(),
        }
    }

    /// Every step cut into two.
    #[must_use]
    pub fn halved(&self) -> Self {
        let spacing = match &self.spacing {
            Spacing::Equal(per_interval) => Spacing::Equal(per_interval.saturating_mul(2)),
            Spacing::Uneven { first, ends } => {
                let mut halves = Vec::with_capacity(2 * ends.len());
                for pair in first.windows(2) {
                    let mut begin = 0.0;
                    for end in &ends[pair[0]..pair[1]] {
                        halves.extend([0.5 * (begin + end), *end]);
                        begin = *end;
                    }
                }
                Spacing::Uneven { first: first.iter().map(|f| 2 * f).collect(), ends: halves }
            }
        };
        Self { spacing, ..self.clone() }
    }

    /// Steps of twice the length; none where their number in an interval is odd, or not that in every other.
    pub(super) fn joined(&self) -> Option<Self> {
        let per_interval = self.per_interval().filter(|per| per % 2 == 0)?;
        Some(self.with_equal(per_interval / 2))
    }

    /// The steps of a part of the run, given by its samples.
    #[must_use]
    pub fn part(&self, samples: Range<usize>) -> Self {
        match &self.spacing {
            Spacing::Equal(_) => self.clone(),
            Spacing::Uneven { .. } => {
                let intervals = samples.start..samples.end.saturating_sub(1).max(samples.start);
                Self { cut: self.cut, ..Self::uneven(self.scheme, intervals.map(|k| self.ends(k))) }
            }
        }
    }

    /// The greatest number of steps in any interval.
    pub fn most(&self) -> usize {
        match &self.spacing {
            Spacing::Equal(per_interval) => *per_interval,
            Spacing::Uneven { first, .. } => first.windows(2).map(|f| f[1] - f[0]).max().unwrap_or(1),
        }
    }

    /// Calls back with beginning and end of every step of an interval, as parts of the interval.
    pub(super) fn each(&self, interval: usize, mut visit: impl FnMut(f64, f64)) {
        match &self.spacing {
            Spacing::Equal(per) => {
                (0..*per).for_each(|k| visit(k as f64 / *per as f64, (k + 1) as f64 / *per as f64));
            }
            Spacing::Uneven { .. } => {
                let ends = self.ends(interval);
                let ends = if ends.is_empty() { &[1.0][..] } else { ends };
                let mut begin = 0.0;
                for end in ends {
                    visit(begin, *end);
                    begin = *end;
                }
            }
        }
    }

    fn ends(&self, interval: usize) -> &[f64] {
        let Spacing::Uneven { first, ends } = &self.spacing else { return &[] };
        let Some(last) = first.len().checked_sub(2) else { return &[] };
        let at = interval.min(last);
        &ends[first[at]..first[at + 1]]
    }
}

impl fmt::Display for Steps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (count, place) = match &self.spacing {
            Spacing::Equal(per_interval) => (*per_interval, " between samples"),
            Spacing::Uneven { ends, .. } => (ends.len(), ""),
        };
        let plural = if count == 1 { "" } else { "s" };
        match self.scheme {
            Scheme::ExactDiscretisation { .. } if count == 1 => write!(f, "{}", self.scheme),
            Scheme::ExactDiscretisation { .. } => {
                write!(f, "{}, {count} step{plural}{place} for delayed inputs", self.scheme)
            }
            _ if self.cut => write!(f, "{count} {} step{plural}{place}, cut at kinks", self.scheme),
            _ => write!(f, "{count} {} step{plural}{place}", self.scheme),
        }
    }
}

/// How a run is integrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scheme {
    /// The classical Runge-Kutta method of order 4, explicit.
    #[default]
    RungeKutta,
    /// The exact solution of a linear model from node to node, as a recursion. A delayed input enters each step by its first
    /// three moments, so that several steps between samples can be worthwhile.
    ExactDiscretisation {
        /// Subsystems that do not influence each other.
        subsystems: usize,
    },
    /// Three-stage Radau IIA of order 5, implicit: for stiff models.
    Radau,
}

impl Scheme {
    /// Order of convergence; that of a recursion is about its delayed inputs, all else is exact.
    pub fn order(self) -> u32 {
        match self {
            Self::RungeKutta | Self::ExactDiscretisation { .. } => 4,
            Self::Radau => 5,
        }
    }

    /// One over the part of the error that halving all steps removes.
    pub(super) fn part_removed_by_halving(self) -> f64 {
        let power = f64::from(1_u32 << self.order());
        power / (power - 1.0)
    }
}

impl fmt::Display for Scheme {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::RungeKutta => write!(f, "Runge-Kutta"),
            Self::Radau => write!(f, "Radau IIA"),
            Self::ExactDiscretisation { subsystems: 1 } => write!(f, "exact discretisation (linear model)"),
            Self::ExactDiscretisation { subsystems } => {
                write!(f, "exact discretisation (linear model, {subsystems} subsystems)")
            }
        }
    }
}

/// The steps of one run; chosen once per fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Time of each sample (N).
    samples: Vec<f64>,
    /// Beginning and length of each step.
    steps: Vec<(f64, f64)>,
    /// The sample at or before each node: the beginnings of the steps, and the end of the last.
    before: Vec<u32>,
    /// Steps in every interval, when they are as many and equal in all.
    per_interval: Option<usize>,
}

impl Grid {
    /// Steps between samples.
    pub fn new(samples: &[f64], steps: &Steps) -> Self {
        let mut grid = Self { per_interval: steps.per_interval(), ..Self::without_steps(samples) };
        let total = steps.total(samples.len());
        grid.steps.reserve_exact(total);
        grid.before.reserve_exact(total + 1);
        for (interval, pair) in samples.windows(2).enumerate() {
            let whole = pair[1] - pair[0];
            steps.each(interval, |begin, end| {
                grid.steps.push((pair[0] + whole * begin, whole * (end - begin)));
                grid.before.push(interval as u32);
            });
        }
        grid.before.push(samples.len().saturating_sub(1) as u32);
        grid
    }

    /// Samples of a model without states: there is nothing to integrate.
    pub fn without_steps(samples: &[f64]) -> Self {
        Self { samples: samples.to_vec(), steps: Vec::new(), before: Vec::new(), per_interval: None }
    }

    /// Steps in every interval, when they are as many and equal in all.
    #[inline]
    pub fn per_interval(&self) -> Option<usize> {
        self.per_interval
    }

    /// Times of the samples.
    pub fn samples(&self) -> &[f64] {
        &self.samples
    }

    /// Number of steps.
    #[inline]
    pub fn steps(&self) -> usize {
        self.steps.len()
    }

    /// The sample that stands at node k, the beginning of step k or the end of the last step, if one does.
    #[inline]
    pub fn sample_at(&self, node: usize) -> Option<usize> {
        if node == 0 {
            return Some(0);
        }
        let sample = self.before[node];
        (sample != self.before[node - 1]).then_some(sample as usize)
    }

    /// Time at the end of a step: to the bit the beginning of the next.
    pub(super) fn end(&self, k: usize) -> f64 {
        self.steps.get(k + 1).map_or_else(|| self.samples[self.samples.len() - 1], |(t, _)| *t)
    }

    /// Beginning and length of a step.
    #[inline]
    pub fn step(&self, k: usize) -> (f64, f64) {
        self.steps[k]
    }

    /// The sample at or before a step.
    #[inline]
    pub fn sample_before(&self, step: usize) -> usize {
        self.before[step] as usize
    }

    /// The greatest number of steps that touch any stretch of this length.
    pub(super) fn most_within(&self, length: f64) -> usize {
        let (mut first, mut most) = (0, 0);
        for (k, (t, _)) in self.steps.iter().enumerate() {
            while self.steps[first].0 + self.steps[first].1 < t - length {
                first += 1;
            }
            most = most.max(k - first + 1);
        }
        most
    }
}

#[cfg(test)]
mod tests {
    use super::{Scheme, *};

    #[test]
    fn uneven_steps_are_counted_halved_and_cut() {
        let steps = Steps::uneven(Scheme::Radau, [&[0.1, 1.0][..], &[1.0], &[0.25, 0.5, 1.0]]);
        assert_eq!((steps.total(4), steps.within(0), steps.within(2)), (6, 2, 3));
        let mut halves = Vec::new();
        steps.halved().each(0, |a, b| halves.push((a, b)));
        assert_eq!(halves, [(0.0, 0.05), (0.05, 0.1), (0.1, 0.55), (0.55, 1.0)]);
        assert_eq!(steps.part(1..4).total(3), 4);
        assert_eq!(Steps::counts(Scheme::RungeKutta, &[1, 3]).total(3), 4);
        assert_eq!(Steps::from(4).total(3), 8);
    }

    /// A list that is empty or does not rise is not a reason to panic.
    #[test]
    fn broken_lists_are_one_step() {
        let steps = Steps::uneven(Scheme::Radau, [&[][..], &[0.5, 0.2, 7.0]]);
        assert_eq!((steps.within(0), steps.within(1)), (1, 2));
        let none = Steps::uneven(Scheme::Radau, []);
        assert_eq!((none.total(1), none.total(3), none.halved().total(3)), (0, 2, 2));
    }

    #[test]
    fn steps_fill_uneven_intervals() {
        let g = Grid::new(&[0.0, 1.0, 4.0], &Steps::from(3));
        assert_eq!(g.steps(), 6);
        assert_eq!((g.step(0), g.step(3)), ((0.0, 1.0 / 3.0), (1.0, 1.0)));
        assert_eq!([0, 1, 3, 4, 6].map(|k| g.sample_at(k)), [Some(0), None, Some(1), None, Some(2)]);
        assert_eq!(Grid::without_steps(&[0.0, 1.0]).sample_at(0), Some(0));
    }

    #[test]
    fn uneven_steps_end_on_samples() {
        let steps = Steps::uneven(Scheme::Radau, [&[0.25, 1.0][..], &[1.0]]);
        let g = Grid::new(&[0.0, 2.0, 3.0], &steps);
        assert_eq!((0..3).map(|k| g.step(k)).collect::<Vec<_>>(), [(0.0, 0.5), (0.5, 1.5), (2.0, 1.0)]);
        assert_eq!([0, 1, 2, 3].map(|k| g.sample_at(k)), [Some(0), None, Some(1), Some(2)]);
        assert_eq!((g.sample_before(1), g.sample_before(2)), (0, 1));
        assert!(g.most_within(1.5) == 3 && g.most_within(0.1) == 2);
    }
}
