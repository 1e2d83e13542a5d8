//! The past of signals that are seen delayed ([`Past`]); part of a unit's state.
//!
//! Inputs are linear on each piece. States are cubic by their rates at both ends (Hermite), and of degree 5 where the middle of the
//! piece is known too. Before the start inputs have their first value
//! and states their initial one, as in a simulation of fdm.

use fdm_grammar::graph::Signal;
use fdm_system::dynamics::Layout;
use serde::{Deserialize, Serialize};

/// Pieces of the past, each a row of numbers: time at both ends, values of all signals at the beginning and at the end, and
/// for states their rates at both.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Track {
    /// Signals that are kept, rising.
    kept: Vec<usize>,
    /// Numbers of a row.
    width: usize,
    rows: Vec<f64>,
    /// The first row that is still needed.
    first: usize,
    /// Values before the start.
    before: Vec<f64>,
    /// Whether rows at the beginning were left out.
    left_out: bool,
}

impl Track {
    fn new(kept: Vec<usize>, values: usize) -> Self {
        let width = 2 + values * kept.len();
        Self { before: vec![0.0; kept.len()], kept, width, rows: Vec::new(), first: 0, left_out: false }
    }

    fn begin(&mut self, values: &[f64]) {
        self.rows.clear();
        (self.first, self.left_out) = (0, false);
        for (before, k) in self.before.iter_mut().zip(&self.kept) {
            *before = values[*k];
        }
    }

    fn count(&self) -> usize {
        self.rows.len() / self.width
    }

    fn row(&self, k: usize) -> &[f64] {
        &self.rows[k * self.width..][..self.width]
    }

    fn push(&mut self, (from, to): (f64, f64), parts: &[&[f64]]) {
        if self.kept.is_empty() || to <= from {
            return;
        }
        self.rows.extend([from, to]);
        for part in parts {
            self.rows.extend(self.kept.iter().map(|k| part[*k]));
        }
    }

    /// Leaves out what ended before a time; the memory is used again.
    fn forget(&mut self, before: f64) {
        while self.first + 1 < self.count() && self.row(self.first)[1] < before {
            self.first += 1;
            self.left_out = true;
        }
        if self.first > 64 && 2 * self.first > self.count() {
            self.rows.drain(..self.first * self.width);
            self.first = 0;
        }
    }

    /// The piece that holds a time; none where the values before the start count, or where that piece was left out.
    fn at(&self, s: f64) -> Option<&[f64]> {
        let (mut low, mut high) = (self.first, self.count());
        while low < high {
            let middle = usize::midpoint(low, high);
            if self.row(middle)[0] <= s { low = middle + 1 } else { high = middle }
        }
        (low > self.first).then(|| self.row(low - 1))
    }
}

/// Everything of the past that delays need.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Past {
    inputs: Track,
    states: Track,
    /// When the run began.
    start: f64,
    /// Times at which a signal that is seen delayed may jump or bend, and how often it was seen delayed by then: each time it is smoother.
    kinks: Vec<(f64, u8)>,
}

/// A piece that is not finished: values at its ends (all inputs, or all states).
#[derive(Debug, Clone, Copy)]
pub(super) struct Open<'a> {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) first: &'a [f64],
    pub(super) last: &'a [f64],
}

/// What is not finished when a signal is looked at.
#[derive(Debug, Clone, Copy)]
pub(super) struct Now<'a> {
    pub(super) inputs: Open<'a>,
    pub(super) states: Open<'a>,
    /// Rates at the beginning of the piece of the states (n).
    pub(super) rates: &'a [f64],
}

/// A delayed signal.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Seen {
    pub(super) value: f64,
    /// Its derivative by time.
    pub(super) slope: f64,
    /// Its derivative by the signal's value now.
    pub(super) now: f64,
}

impl Past {
    pub(super) fn new(layout: &Layout) -> Self {
        let kept = |of: &dyn Fn(&Signal) -> Option<u32>| {
            let mut kept: Vec<usize> = layout.delayed.iter().filter_map(of).map(|k| k as usize).collect();
            kept.sort_unstable();
            kept.dedup();
            kept
        };
        let inputs = kept(&|s| if let Signal::Input(k) = *s { Some(k) } else { None });
        let states = kept(&|s| if let Signal::State(k) = *s { Some(k) } else { None });
        Self { inputs: Track::new(inputs, 2), states: Track::new(states, 6), ..Self::default() }
    }

    /// Whether it is of the same signals, and whole.
    pub(super) fn fits(&self, other: &Self) -> bool {
        let same = |a: &Track, b: &Track| {
            a.kept == b.kept
                && a.width == b.width
                && a.before.len() == b.before.len()
                && a.rows.len().is_multiple_of(a.width.max(1))
                && a.first <= a.rows.len() / a.width.max(1)
        };
        same(&self.inputs, &other.inputs) && same(&self.states, &other.states)
    }

    /// Whether nothing is delayed.
    pub(super) fn is_empty(&self) -> bool {
        self.inputs.kept.is_empty() && self.states.kept.is_empty()
    }

    /// The run begins, with these inputs and states.
    pub(super) fn begin(&mut self, t: f64, inputs: &[f64], states: &[f64]) {
        self.inputs.begin(inputs);
        self.states.begin(states);
        self.start = t;
        self.kinks.clear();
        self.kinks.push((t, 0));
    }

    /// Adds a piece of the inputs.
    pub(super) fn inputs(&mut self, piece: Open<'_>) {
        self.inputs.push((piece.from, piece.to), &[piece.first, piece.last]);
    }

    /// Adds a piece of the states, with the rates at its ends, and how it bends away from their cubic ([`bends`]).
    pub(super) fn states(&mut self, piece: Open<'_>, rates: [&[f64]; 2], bends: [&[f64]; 2]) {
        self.states.push((piece.from, piece.to), &[piece.first, piece.last, rates[0], rates[1], bends[0], bends[1]]);
    }

    /// A signal may bend or jump here.
    pub(super) fn kink(&mut self, t: f64) {
        self.add_kink(t, 0);
    }

    fn add_kink(&mut self, t: f64, often: u8) {
        if self.is_empty() {
            return;
        }
        match self.kinks.last_mut() {
            Some(last) if last.0 >= t => last.1 = last.1.min(often),
            _ => self.kinks.push((t, often)),
        }
    }

    /// A step has ended where a kink is seen, delayed by one of these: the states bend there, and that will be seen delayed.
    pub(super) fn passed(&mut self, t: f64, tau: &[f64]) {
        let seen = self.kinks.iter().filter(|(kink, _)| tau.iter().any(|tau| kink + tau == t));
        // kinks that were seen delayed more often are smooth enough for the control of the steps
        if let Some(often) = seen.map(|(_, often)| often + 1).min().filter(|often| *often <= 2) {
            self.add_kink(t, often);
        }
    }

    /// The next time behind `t` at which a kink is seen, delayed by one of these.
    pub(super) fn next_kink(&self, t: f64, tau: &[f64]) -> Option<f64> {
        let seen = tau.iter().flat_map(|tau| self.kinks.iter().map(move |(kink, _)| kink + tau));
        seen.filter(|seen| *seen > t).min_by(f64::total_cmp)
    }

    /// Leaves out what is older.
    pub(super) fn forget(&mut self, before: f64) {
        self.inputs.forget(before);
        self.states.forget(before);
        self.kinks.retain(|(kink, _)| *kink >= before);
    }

    /// A signal at the time `s`; `vanishing` for an input that is zero before the start. None where that part of the past was left out.
    pub(super) fn seen(&self, signal: Signal, vanishing: bool, s: f64, now: &Now<'_>) -> Option<Seen> {
        match signal {
            Signal::Input(k) => self.input(k as usize, vanishing, s, &now.inputs),
            Signal::State(k) => self.state(k as usize, s, now),
        }
    }

    fn input(&self, k: usize, vanishing: bool, s: f64, open: &Open<'_>) -> Option<Seen> {
        let (from, to) = (open.from, open.to);
        let (first, last) = (open.first[k], open.last[k]);
        let slope = if to > from { (last - first) / (to - from) } else { 0.0 };
        if s >= to {
            return Some(Seen { value: last, slope, now: 1.0 });
        }
        if s >= from {
            let part = (s - from) / (to - from);
            return Some(Seen { value: first + part * (last - first), slope, now: part });
        }
        let slot = self.inputs.kept.partition_point(|kept| *kept < k);
        let (count, before) = (self.inputs.kept.len(), self.inputs.before[slot]);
        if s < self.start {
            return Some(Seen { value: if vanishing { 0.0 } else { before }, ..Seen::default() });
        }
        let Some(row) = self.inputs.at(s) else {
            return (!self.inputs.left_out).then_some(Seen { value: before, ..Seen::default() });
        };
        let (length, a, b) = (row[1] - row[0], row[2 + slot], row[2 + count + slot]);
        let part = ((s - row[0]) / length).min(1.0);
        Some(Seen { value: a + part * (b - a), slope: (b - a) / length, now: 0.0 })
    }

    fn state(&self, k: usize, s: f64, now: &Now<'_>) -> Option<Seen> {
        let Open { from, to, first, last } = now.states;
        let (a, b) = (first[k], last[k]);
        if s >= to {
            return Some(Seen { value: b, slope: now.rates[k], now: 1.0 });
        }
        if s > from {
            // through both ends, with the rate at the beginning
            let (h, part, rate) = (to - from, (s - from) / (to - from), now.rates[k]);
            let bent = b - a - rate * h;
            let value = a + rate * (s - from) + bent * part * part;
            return Some(Seen { value, slope: rate + 2.0 * bent * part / h, now: part * part });
        }
        let slot = self.states.kept.partition_point(|kept| *kept < k);
        let (count, before) = (self.states.kept.len(), self.states.before[slot]);
        if s < self.start {
            return Some(Seen { value: before, ..Seen::default() });
        }
        let Some(row) = self.states.at(s) else {
            return (!self.states.left_out).then_some(Seen { value: before, ..Seen::default() });
        };
        let [a, b, f, g, c0, c1] = [0, 1, 2, 3, 4, 5].map(|part| row[2 + part * count + slot]);
        let h = row[1] - row[0];
        let p = ((s - row[0]) / h).min(1.0);
        let (q, c) = (p * p, p * p * p);
        let cubic = (2.0 * c - 3.0 * q + 1.0) * a + (3.0 * q - 2.0 * c) * b + h * ((c - 2.0 * q + p) * f + (c - q) * g);
        let along = 6.0 * (q - p) * (a - b) / h + (3.0 * q - 4.0 * p + 1.0) * f + (3.0 * q - 2.0 * p) * g;
        let (bump, beside) = (q * (1.0 - p) * (1.0 - p), c0 + c1 * (p - 0.5));
        let value = cubic + bump * beside;
        let slope = along + (2.0 * p * (1.0 - p) * (1.0 - 2.0 * p) * beside + bump * c1) / h;
        Some(Seen { value, slope, now: 0.0 })
    }
}

/// How a state bends away from the cubic of its ends, as the polynomial of degree 5 that has this value and rate in the middle:
/// `p^2 (1 - p)^2 (c0 + c1 (p - 1/2))` is added at the part p of the piece. `ends` are the values and rates at both ends.
pub(super) fn bends(h: f64, ends: [f64; 4], (middle, rate): (f64, f64)) -> [f64; 2] {
    let [a, b, f, g] = ends;
    let value = 0.5 * (a + b) + 0.125 * h * (f - g);
    let slope = 1.5 * (b - a) - 0.25 * h * (f + g);
    [16.0 * (middle - value), 16.0 * (h * rate - slope)]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    fn still(t: f64, values: &[f64]) -> Open<'_> {
        Open { from: t, to: t, first: values, last: values }
    }

    #[test]
    fn cubics_and_lines_are_seen_as_they_are_and_what_was_left_out_is_told() {
        let (f, g) = (|t: f64| 1.0 - t + t * t * t, |t: f64| 3.0 * t * t - 1.0);
        let mut past = Past { inputs: Track::new(vec![1], 2), states: Track::new(vec![0], 6), ..Past::default() };
        past.begin(0.0, &[9.0, 5.0], &[f(0.0)]);
        for k in 0..200 {
            let (a, b) = (f64::from(k) * 0.5, f64::from(k + 1) * 0.5);
            past.inputs(Open { from: a, to: b, first: &[9.0, a], last: &[9.0, b] });
            past.states(Open { from: a, to: b, first: &[f(a)], last: &[f(b)] }, [&[g(a)], &[g(b)]], [&[0.0]; 2]);
        }
        let now =
            |x: &'static [f64]| Now { inputs: still(100.0, &[9.0, 100.0]), states: still(100.0, x), rates: &[0.0] };
        let at = |past: &Past, signal, s| past.seen(signal, false, s, &now(&[1.0]));
        for s in [0.3, 1.0, 41.7, 99.9] {
            let state = at(&past, Signal::State(0), s).unwrap();
            assert!(
                (state.value - f(s)).abs() < 1e-9 * f(s).abs().max(1.0)
                    && (state.slope - g(s)).abs() < 1e-8 * g(s).abs().max(1.0)
            );
            let input = at(&past, Signal::Input(1), s).unwrap();
            assert!((input.value - s).abs() < 1e-12 && (input.slope - 1.0).abs() < 1e-12, "{s}: {input:?}");
        }
        assert_eq!(at(&past, Signal::Input(1), -1.0).unwrap().value, 5.0);
        assert_eq!(past.seen(Signal::Input(1), true, -1.0, &now(&[1.0])).unwrap().value, 0.0);
        assert_eq!(at(&past, Signal::State(0), 100.0).unwrap(), Seen { value: 1.0, slope: 0.0, now: 1.0 });
        past.forget(70.0);
        assert!((at(&past, Signal::State(0), 70.2).unwrap().value - f(70.2)).abs() < 1e-6);
        assert_eq!(at(&past, Signal::State(0), 60.0), None);
        assert!(past.inputs.rows.len() < 4 * 100);
    }

    #[test]
    fn polynomials_of_degree_5_are_seen_as_they_are() {
        let f = |t: f64| 1.0 + t - t.powi(2) + 0.3 * t.powi(4) - 0.2 * t.powi(5);
        let g = |t: f64| 1.0 - 2.0 * t + 1.2 * t.powi(3) - t.powi(4);
        let (from, to) = (0.5, 2.1);
        let (h, middle) = (to - from, 0.5 * (from + to));
        let [c0, c1] = bends(h, [f(from), f(to), g(from), g(to)], (f(middle), g(middle)));
        let mut past = Past { inputs: Track::new(vec![], 2), states: Track::new(vec![0], 6), ..Past::default() };
        past.begin(from, &[], &[f(from)]);
        let piece = Open { from, to, first: &[f(from)], last: &[f(to)] };
        past.states(piece, [&[g(from)], &[g(to)]], [&[c0], &[c1]]);
        for t in [0.5, 0.7, 1.1, 1.3, 1.9] {
            let now = Now { inputs: still(to, &[]), states: still(to, &[0.0]), rates: &[0.0] };
            let seen = past.seen(Signal::State(0), false, t, &now).unwrap();
            assert!((seen.value - f(t)).abs() < 1e-12 && (seen.slope - g(t)).abs() < 1e-11, "{t}: {seen:?}");
        }
    }

    #[test]
    fn the_piece_that_is_not_finished_goes_through_its_ends() {
        let past = Past { inputs: Track::new(vec![0], 2), states: Track::new(vec![0], 6), ..Past::default() };
        let (first, last) = ([1.0], [2.0]);
        let open = Open { from: 1.0, to: 3.0, first: &first, last: &last };
        let now = Now { inputs: open, states: open, rates: &[0.5] };
        let input = past.seen(Signal::Input(0), false, 1.5, &now).unwrap();
        assert_eq!((input.value, input.slope, input.now), (1.25, 0.5, 0.25));
        // a line: the rate is that of both ends
        let state = past.seen(Signal::State(0), false, 1.5, &now).unwrap();
        assert!((state.value - 1.25).abs() < 1e-15 && (state.now - 0.0625).abs() < 1e-15);
    }
}
