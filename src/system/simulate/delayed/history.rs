//! The states' recent past, dense by cubic Hermite interpolation: on a step the cubic takes the states and the rates at both ends.
//!
//! A ring of nodes that reaches back as far as the longest delay. Sums with the interpolant's weights are linear in states and rates, so
//! that sensitivities are interpolated by the same ones: they are the exact derivative of what is interpolated. Before the first
//! node the initial values hold.

use crate::dynamics::Layout;
use crate::simulate::delayed_inputs::{add, stages};
use crate::simulate::steps::Grid;
use fdm_grammar::graph::Signal;
use fdm_numeric::lanes::accumulate;

/// States, rates and their sensitivities at the nodes of the last steps, of the states that are seen delayed.
#[derive(Debug, Clone, Default)]
pub(in crate::simulate) struct History {
    /// States that are kept, ascending; a state's place here is its slot.
    kept: Vec<usize>,
    /// Lanes per state: 0 when only values are kept.
    lanes: usize,
    capacity: usize,
    nodes: usize,
    /// Time of the first node, which the ring may have dropped.
    first: f64,
    time: Vec<f64>,
    x: Vec<f64>,
    s: Vec<f64>,
    /// Rates at the beginning and at the end of the step that starts at a node, and their sensitivities.
    rate: [Vec<f64>; 2],
    rate_s: [Vec<f64>; 2],
}

impl History {
    /// Most numbers of a history (2 GiB).
    pub(in crate::simulate) const MOST: usize = 1 << 28;

    /// For the states that a model sees delayed; `None` when it sees none so.
    pub(in crate::simulate) fn new(layout: &Layout) -> Option<Self> {
        let mut kept: Vec<usize> = layout
            .delayed
            .iter()
            .filter_map(|s| if let Signal::State(k) = *s { Some(k as usize) } else { None })
            .collect();
        kept.sort_unstable();
        kept.dedup();
        (!kept.is_empty()).then(|| Self { kept, ..Self::default() })
    }

    /// Place of a state that is kept.
    pub(in crate::simulate) fn slot(&self, state: usize) -> usize {
        self.kept.partition_point(|k| *k < state)
    }

    /// Numbers that delays up to `longest` take on this grid.
    pub(in crate::simulate) fn numbers(&self, lanes: usize, longest: f64, grid: &Grid) -> usize {
        capacity(longest, grid).saturating_mul(self.numbers_per_node(lanes))
    }

    /// Numbers that a node takes.
    pub(in crate::simulate) fn numbers_per_node(&self, lanes: usize) -> usize {
        1 + 3 * self.kept.len() * (1 + lanes)
    }

    /// Room for delays up to `longest` on this grid; allocates only when it must grow.
    pub(in crate::simulate) fn begin(&mut self, lanes: usize, longest: f64, grid: &Grid) {
        self.capacity = capacity(longest, grid);
        (self.lanes, self.nodes) = (lanes, 0);
        let (values, rows) = (self.capacity * self.kept.len(), self.capacity * self.kept.len() * lanes);
        self.time.resize(self.capacity, 0.0);
        self.x.resize(values, 0.0);
        self.s.resize(rows, 0.0);
        self.rate.iter_mut().for_each(|r| r.resize(values, 0.0));
        self.rate_s.iter_mut().for_each(|r| r.resize(rows, 0.0));
    }

    /// Adds the next node: all states, and their sensitivities when they are kept.
    #[inline(always)]
    pub(in crate::simulate) fn node(&mut self, t: f64, x: &[f64], s: &[f64]) {
        let (at, slots, lanes) = (self.nodes % self.capacity, self.kept.len(), self.lanes);
        if self.nodes == 0 {
            self.first = t;
        }
        self.nodes += 1;
        self.time[at] = t;
        for (slot, state) in self.kept.iter().enumerate() {
            self.x[at * slots + slot] = x[*state];
            let to = (at * slots + slot) * lanes;
            self.s[to..to + lanes].copy_from_slice(&s[state * lanes..][..lanes]);
        }
    }

    /// Rates of all states at the beginning (0) or at the end (1) of the step that starts at the newest node; gives the
    /// states that are kept and the rows in which the sensitivities of their rates are wanted.
    #[inline(always)]
    pub(in crate::simulate) fn rates(&mut self, end: usize, f: &[f64]) -> (&[usize], &mut [f64]) {
        let (at, slots) = ((self.nodes - 1) % self.capacity, self.kept.len());
        for (slot, state) in self.kept.iter().enumerate() {
            self.rate[end][at * slots + slot] = f[*state];
        }
        (&self.kept, &mut self.rate_s[end][at * slots * self.lanes..][..slots * self.lanes])
    }

    /// Time of the first node of the run.
    pub(super) fn first(&self) -> f64 {
        self.first
    }

    /// The oldest node that is still kept.
    #[inline(always)]
    pub(super) fn oldest(&self) -> usize {
        self.nodes.saturating_sub(self.capacity)
    }

    /// The newest node.
    pub(super) fn newest(&self) -> usize {
        self.nodes - 1
    }

    /// Time of a node that is still kept.
    #[inline(always)]
    pub(super) fn time(&self, node: usize) -> f64 {
        self.time[node % self.capacity]
    }

    /// The last node not after t, or the oldest one.
    fn before(&self, t: f64) -> usize {
        let (mut low, mut high) = (self.oldest(), self.nodes - 1);
        while high - low > 1 {
            let middle = usize::midpoint(low, high);
            if self.time(middle) <= t { low = middle } else { high = middle }
        }
        low
    }

    /// Value of a slot at a node.
    #[inline(always)]
    pub(super) fn value(&self, node: usize, slot: usize) -> f64 {
        self.x[node % self.capacity * self.kept.len() + slot]
    }

    /// x0, x1, f0 and f1 of the step between a node and the next.
    #[inline(always)]
    pub(super) fn four(&self, node: usize, slot: usize) -> Four {
        let [a, b] = [node, node + 1].map(|n| n % self.capacity * self.kept.len() + slot);
        [self.x[a], self.x[b], self.rate[0][a], self.rate[1][a]]
    }

    /// Adds the sensitivity of a value at a node, weighed.
    #[inline(always)]
    pub(super) fn add_value(&self, node: usize, slot: usize, weight: f64, to: &mut [f64]) {
        let row = (node % self.capacity * self.kept.len() + slot) * self.lanes;
        accumulate(weight, &self.s[row..row + self.lanes], to);
    }

    /// Adds the sensitivities of the four, weighed.
    #[inline(always)]
    pub(super) fn add_four(&self, node: usize, slot: usize, weights: &Four, to: &mut [f64]) {
        self.add_value(node, slot, weights[0], to);
        self.add_value(node + 1, slot, weights[1], to);
        let row = (node % self.capacity * self.kept.len() + slot) * self.lanes;
        accumulate(weights[2], &self.rate_s[0][row..row + self.lanes], to);
        accumulate(weights[3], &self.rate_s[1][row..row + self.lanes], to);
    }

    /// Value and slope of a state at a time not after the newest node; adds the sensitivity of the value to `lanes`.
    #[inline(always)]
    pub(in crate::simulate) fn at(&self, t: f64, state: usize, lanes: &mut [f64]) -> (f64, f64) {
        let (slot, oldest) = (self.slot(state), self.oldest());
        if self.nodes == 1 || t <= self.time(oldest) {
            self.add_value(oldest, slot, 1.0, lanes);
            return (self.value(oldest, slot), 0.0);
        }
        let node = self.before(t);
        let (from, to) = (self.time(node), self.time(node + 1));
        let (weights, four) = (Weights::new(t - from, to - from), self.four(node, slot));
        self.add_four(node, slot, &weights.value, lanes);
        (sum(&weights.value, &four), sum(&weights.slope, &four))
    }
}

/// Nodes of a ring for delays up to `longest`: the greatest number of steps in any window of this length, with those around it.
fn capacity(longest: f64, grid: &Grid) -> usize {
    (grid.most_within(longest) + 2).min(grid.steps()) + 3
}

/// Weights of x0, x1, f0 and f1.
pub(in crate::simulate) type Four = [f64; 4];

/// Weights for the value and for the slope at one place.
#[derive(Debug, Clone, Copy)]
pub(in crate::simulate) struct Weights {
    pub(in crate::simulate) value: Four,
    pub(in crate::simulate) slope: Four,
}

/// What a part of a step contributes to the three stage values of a later step that sees it delayed, and to the
/// three slopes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Share {
    pub(super) value: [Four; 3],
    pub(super) slope: [Four; 3],
}

/// The three-point Gauss rule on [0, 1]: exact for a cubic times a moment's weight.
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

impl Weights {
    /// At a distance behind the beginning of a step of length h.
    #[inline]
    pub(in crate::simulate) fn new(distance: f64, h: f64) -> Self {
        let s = distance / h;
        let (q, c) = (s * s, s * s * s);
        Self {
            value: [2.0 * c - 3.0 * q + 1.0, 3.0 * q - 2.0 * c, h * (c - 2.0 * q + s), h * (c - q)],
            slope: [6.0 * (q - s) / h, 6.0 * (s - q) / h, 3.0 * q - 4.0 * s + 1.0, 3.0 * q - 2.0 * s],
        }
    }
}

impl Share {
    /// The share of `part` (from, to) of the step `piece` (beginning, length), all seen through the window (beginning,
    /// length); times are the delayed signal's own.
    pub(super) fn new(piece: (f64, f64), part: (f64, f64), window: (f64, f64)) -> Self {
        let (mut value, mut slope) = ([[0.0; 3]; 4], [[0.0; 3]; 4]);
        let length = part.1 - part.0;
        for (abscissa, weight) in GAUSS {
            let t = part.0 + abscissa * length;
            let (s, amount) = ((t - window.0) / window.1, weight * length / window.1);
            let at = Weights::new(t - piece.0, piece.1);
            for k in 0..4 {
                add(&mut value[k], s, amount * at.value[k]);
                add(&mut slope[k], s, amount * at.slope[k]);
            }
        }
        Self { value: by_stage(value), slope: by_stage(slope) }
    }

    /// The share of a part in which the signal stands still: the weight of its value in each stage value.
    pub(super) fn constant(part: (f64, f64), window: (f64, f64)) -> [f64; 3] {
        let (mut moments, length) = ([0.0; 3], part.1 - part.0);
        for (abscissa, weight) in GAUSS {
            let t = part.0 + abscissa * length;
            add(&mut moments, (t - window.0) / window.1, weight * length / window.1);
        }
        stages(moments)
    }
}

/// From the moments of each weight to the weights of each stage value.
fn by_stage(moments: [[f64; 3]; 4]) -> [Four; 3] {
    let mut weights = [[0.0; 4]; 3];
    for (k, moments) in moments.into_iter().enumerate() {
        for (stage, value) in stages(moments).into_iter().enumerate() {
            weights[stage][k] = value;
        }
    }
    weights
}

/// A weighted sum of the four.
#[inline(always)]
pub(in crate::simulate) fn sum(weights: &Four, of: &Four) -> f64 {
    ((weights[0] * of[0] + weights[1] * of[1]) + weights[2] * of[2]) + weights[3] * of[3]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubics_are_interpolated_exactly_and_slopes_are_derivatives() {
        let grid = Grid::new(&[0.0, 0.5, 1.0, 2.0], &1.into());
        let (f, g) = (|t: f64| 1.0 - t + t * t * t, |t: f64| 3.0 * t * t - 1.0);
        let mut history = History { kept: vec![1], ..History::default() };
        history.begin(0, 1.4, &grid);
        history.node(0.0, &[f64::NAN, f(0.0)], &[]);
        for pair in [0.0, 0.5, 1.0, 2.0].windows(2) {
            history.rates(0, &[f64::NAN, g(pair[0])]);
            history.rates(1, &[f64::NAN, g(pair[1])]);
            history.node(pair[1], &[f64::NAN, f(pair[1])], &[]);
        }
        for t in [0.61, 1.0, 1.37, 2.0] {
            let (value, slope) = history.at(t, 1, &mut []);
            assert!((value - f(t)).abs() < 1e-13 && (slope - g(t)).abs() < 1e-13, "{t}: {value} {slope}");
        }
    }

    #[test]
    fn the_ring_reaches_back_far_enough() {
        let times: Vec<f64> = (0..50).map(|k| 0.1 * f64::from(k)).collect();
        let grid = Grid::new(&times, &3.into());
        assert!(capacity(0.35, &grid) >= 3 * 4);
        assert!((150..=151).contains(&capacity(1e9, &grid)));
    }

    #[test]
    fn a_line_seen_without_delay_has_its_own_values() {
        let f = |t: f64| 1.0 - 2.0 * t;
        let of = [f(1.0), f(3.0), -2.0, -2.0];
        let whole = Share::new((1.0, 2.0), (1.0, 3.0), (1.0, 2.0));
        for (stage, t) in [1.0, 2.0, 3.0].into_iter().enumerate() {
            assert!((sum(&whole.value[stage], &of) - f(t)).abs() < 1e-12, "stage {stage}");
            assert!((sum(&whole.slope[stage], &of) + 2.0).abs() < 1e-11, "slope {stage}");
        }
    }

    #[test]
    fn parts_add_up_and_slopes_are_derivatives_by_the_shift() {
        let of = [0.3, -1.2, 2.0, -0.7];
        let at = |begin: f64| -> [f64; 3] {
            let window = (begin, 1.5);
            let before = Share::constant((begin, 0.0), window);
            let cut = 0.4;
            let [first, second] = [(0.0, cut), (cut, begin + 1.5)].map(|part| Share::new((0.0, 2.0), part, window));
            std::array::from_fn(|k| of[0] * before[k] + sum(&first.value[k], &of) + sum(&second.value[k], &of))
        };
        let (begin, step) = (-0.6, 1e-6);
        let whole = Share::new((0.0, 2.0), (0.0, 0.9), (begin, 1.5));
        let (low, high) = (at(begin - step), at(begin + step));
        for stage in 0..3 {
            let difference = (high[stage] - low[stage]) / (2.0 * step);
            assert!((difference - sum(&whole.slope[stage], &of)).abs() < 1e-7, "stage {stage}");
        }
    }
}
