//! The states' recent past, dense by cubic Hermite interpolation, for outputs that show delayed states.
//!
//! A ring of nodes that reaches back as far as the longest delay. Between nodes the interpolant uses the rates at both
//! ends of the step, its error is of the order of the integrator's own, and its derivatives by parameters use the
//! sensitivities in the same way: they are the exact derivative of what is interpolated.

use super::grid::Grid;
use super::vectors::accumulate;

/// States, rates and their sensitivities at the nodes of the last steps.
#[derive(Debug, Clone, Default)]
pub(super) struct History {
    states: usize,
    /// Lanes per state: 0 when only values are kept.
    lanes: usize,
    capacity: usize,
    nodes: usize,
    time: Vec<f64>,
    x: Vec<f64>,
    s: Vec<f64>,
    /// Rates at the beginning and at the end of the step that starts at a node, and their sensitivities.
    rate: [Vec<f64>; 2],
    rate_s: [Vec<f64>; 2],
}

/// Weights of the two nodes' values and of the rates at both ends, for the value and for the slope.
struct Weights {
    value: [f64; 4],
    slope: [f64; 4],
}

impl History {
    /// Room for delays up to `longest` on this grid; allocates only when it must grow.
    pub(super) fn begin(&mut self, states: usize, lanes: usize, longest: f64, grid: &Grid) {
        self.capacity = grid.most_within(longest) + 3;
        (self.states, self.lanes, self.nodes) = (states, lanes, 0);
        let (values, rows) = (self.capacity * states, self.capacity * states * lanes);
        self.time.resize(self.capacity, 0.0);
        self.x.resize(values, 0.0);
        self.s.resize(rows, 0.0);
        self.rate.iter_mut().for_each(|r| r.resize(values, 0.0));
        self.rate_s.iter_mut().for_each(|r| r.resize(rows, 0.0));
    }

    /// Adds the next node.
    pub(super) fn push(&mut self, t: f64, x: &[f64], s: &[f64]) {
        let at = self.nodes % self.capacity;
        self.nodes += 1;
        self.time[at] = t;
        self.x[at * self.states..][..self.states].copy_from_slice(x);
        let rows = self.states * self.lanes;
        self.s[at * rows..][..rows].copy_from_slice(&s[..rows]);
    }

    /// Where to write rates and their sensitivities at an end (0 beginning, 1 end) of the step that starts `back`
    /// nodes before the newest one.
    pub(super) fn rates(&mut self, end: usize, back: usize) -> (&mut [f64], &mut [f64]) {
        let at = (self.nodes - 1 - back) % self.capacity;
        let rows = self.states * self.lanes;
        (&mut self.rate[end][at * self.states..][..self.states], &mut self.rate_s[end][at * rows..][..rows])
    }

    /// Value and slope of a state at a time not after the newest node; adds the sensitivity of the value to `lanes`.
    /// Before the first node of the run the initial value holds.
    #[inline(always)]
    pub(super) fn at(&self, t: f64, state: usize, lanes: &mut [f64]) -> (f64, f64) {
        let newest = self.nodes - 1;
        let oldest = self.nodes.saturating_sub(self.capacity);
        let index = |node: usize| (node % self.capacity) * self.states + state;
        if newest == 0 || t <= self.time[oldest % self.capacity] {
            let first = index(oldest);
            self.gather(lanes, [(1.0, &self.s, first)]);
            return (self.x[first], 0.0);
        }
        let (mut low, mut high) = (oldest, newest);
        while high - low > 1 {
            let middle = usize::midpoint(low, high);
            if self.time[middle % self.capacity] <= t { low = middle } else { high = middle }
        }
        let (from, to) = (self.time[low % self.capacity], self.time[high % self.capacity]);
        let w = Weights::new(t - from, to - from);
        let (a, b) = (index(low), index(high));
        let parts = [self.x[a], self.x[b], self.rate[0][a], self.rate[1][a]];
        let sum = |w: &[f64; 4]| w.iter().zip(parts).map(|(w, p)| w * p).sum::<f64>();
        let [wa, wb, ra, rb] = w.value;
        self.gather(lanes, [(wa, &self.s, a), (wb, &self.s, b), (ra, &self.rate_s[0], a), (rb, &self.rate_s[1], a)]);
        (sum(&w.value), sum(&w.slope))
    }

    #[inline(always)]
    fn gather<const K: usize>(&self, lanes: &mut [f64], terms: [(f64, &Vec<f64>, usize); K]) {
        for (weight, from, row) in terms {
            accumulate(weight, &from[row * self.lanes..][..self.lanes], lanes);
        }
    }
}

impl Weights {
    /// At a distance behind the beginning of a step of length h.
    fn new(distance: f64, h: f64) -> Self {
        let s = distance / h;
        let (q, c) = (s * s, s * s * s);
        Self {
            value: [2.0 * c - 3.0 * q + 1.0, 3.0 * q - 2.0 * c, h * (c - 2.0 * q + s), h * (c - q)],
            slope: [6.0 * (q - s) / h, 6.0 * (s - q) / h, 3.0 * q - 4.0 * s + 1.0, 3.0 * q - 2.0 * s],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubics_are_interpolated_exactly_and_slopes_are_derivatives() {
        let grid = Grid::new(&[0.0, 0.5, 1.0, 2.0], &1.into());
        let (f, g) = (|t: f64| 1.0 - t + t * t * t, |t: f64| 3.0 * t * t - 1.0);
        let mut history = History::default();
        history.begin(1, 0, 1.4, &grid);
        let nodes = [0.0, 0.5, 1.0, 2.0];
        for (k, t) in nodes.iter().enumerate() {
            history.push(*t, &[f(*t)], &[]);
            history.rates(0, 0).0[0] = g(*t);
            if k > 0 {
                history.rates(1, 1).0[0] = g(*t);
            }
        }
        for t in [0.61, 1.0, 1.37, 2.0] {
            let (value, slope) = history.at(t, 0, &mut []);
            assert!((value - f(t)).abs() < 1e-13 && (slope - g(t)).abs() < 1e-13, "{t}: {value} {slope}");
        }
    }

    #[test]
    fn the_ring_reaches_back_far_enough() {
        let times: Vec<f64> = (0..50).map(|k| 0.1 * f64::from(k)).collect();
        let grid = Grid::new(&times, &3.into());
        assert!(grid.most_within(0.35) >= 3 * 4);
        assert!(grid.most_within(1e9) >= 3 * 49);
    }
}
