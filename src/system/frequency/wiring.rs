//! What drives what: equations, the unknowns that are asked for, and the planes from which they are fed.
//!
//! What programs read: frequencies, inputs, delay factors and end terms of one run, in planes; behind them their registers.

use super::end_points::{DelayedInput, EndColumn, Ends, turn};
use super::program::{BEHIND, BLOCK, INVERSE, OMEGA, PLANE};
use crate::linear::{Structure, Term};
use crate::simulate::RowLayout;
use fdm_grammar::graph::Signal;
use fdm_numeric::lanes::Aligned;
use num_complex::Complex64;
use std::sync::Arc;

/// Leaves of a delayed signal with ends.
const DELAYED: u32 = 4;

/// A signal of the equations, told apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    State(usize),
    /// An input, and whether an output shows it: outputs see samples, states what lies between them.
    Input(usize, bool),
    /// A delayed signal, by its position in [`Structure::delayed`], and whether an output shows it.
    Delayed(usize, bool),
}

/// An influence of an unknown on an equation: number `given` times a signal, or the coefficient `term` times the
/// derivative of a delay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Influence {
    /// A derivative of the coefficient of a signal, by its position in `slopes`.
    Slope(usize, Source),
    /// A coefficient (position in `terms`), the derivative of the delay of its signal (position in `tau_slopes`), the signal.
    Delay(usize, usize, Source),
    /// The factor of an unknown end value.
    End(usize),
    /// What that end value does through a coefficient (position in `terms`) of a delayed signal: the factor, the signal.
    DelayedEnd(usize, usize, usize),
    /// What it does to the rate of a delayed state, seen through a coefficient: that coefficient and the one in the state's equation
    /// (positions in `terms`), the factor, the delayed signal.
    DelayedRateEnd([usize; 2], usize, usize),
    /// What a derivative of a coefficient (position in `slopes`) of a signal does to the end of the rate of a delayed state, seen through
    /// a coefficient (position in `terms`): the delayed signal, the signal.
    RateSlope(usize, usize, usize, Source),
}

/// What an unknown does: influences by the equation, rising.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Column {
    pub(super) influences: Vec<(usize, Influence)>,
}

/// A structure with the unknowns that are asked for.
#[derive(Debug, Clone)]
pub(super) struct Wiring {
    pub(super) structure: Arc<Structure>,
    /// Unknowns asked for: below p parameters, then end values.
    pub(super) asked: Vec<usize>,
    pub(super) columns: Vec<Column>,
    /// States whose end terms have a plane.
    pub(super) known_ends: Vec<usize>,
    /// Unknown end values, and the factor of each.
    pub(super) unknown_ends: Vec<(EndColumn, usize)>,
    /// How many factors there are.
    pub(super) factors: usize,
    /// Whether delayed signals have ends.
    pub(super) ended: bool,
    /// Whether delayed states are among them, whose rates have ends.
    pub(super) bowed: bool,
    /// Whether inputs that outputs show have leaves of their own.
    pub(super) sampled: bool,
    /// Where the derivatives of each output go.
    pub(super) layout: RowLayout,
}

impl Wiring {
    /// `sampled`: inputs that outputs show have leaves of their own.
    pub(super) fn new(structure: &Arc<Structure>, ends: &Ends, sampled: bool, asked: &[usize]) -> Self {
        let unknown_ends = ends.unknown.iter().enumerate().map(|(k, e)| (*e, ends.factor(k))).collect();
        let mut wiring = Self {
            structure: structure.clone(),
            asked: asked.to_vec(),
            columns: Vec::new(),
            known_ends: ends.known.iter().map(|(state, _)| *state).collect(),
            unknown_ends,
            factors: ends.factors.len(),
            ended: ends.delayed,
            bowed: ends.delayed && structure.delayed.iter().any(|signal| matches!(signal, Signal::State(_))),
            sampled,
            layout: RowLayout::default(),
        };
        wiring.columns = asked.iter().map(|unknown| wiring.column(*unknown)).collect();
        wiring.layout = wiring.arranged();
        wiring
    }

    pub(super) fn source(&self, term: &Term) -> Source {
        let (n, m, signal) = (self.structure.states, self.structure.inputs, term.signal as usize);
        let shown = term.row as usize >= n;
        match signal {
            _ if signal < n => Source::State(signal),
            _ if signal < n + m => Source::Input(signal - n, shown),
            _ => Source::Delayed(signal - n - m, shown),
        }
    }

    fn column(&self, unknown: usize) -> Column {
        let s = &self.structure;
        if let Some((end, factor)) = unknown.checked_sub(s.params).and_then(|k| self.unknown_ends.get(k)) {
            return self.end_column(end.state, *factor);
        }
        let mut influences = Vec::new();
        for (k, slope) in s.slopes.iter().enumerate().filter(|(_, slope)| slope.param as usize == unknown) {
            let term = &s.terms[slope.term as usize];
            let source = self.source(term);
            influences.push((term.row as usize, Influence::Slope(k, source)));
            for (t, row, d) in self.delayed_terms(term.row as usize) {
                influences.push((row, Influence::RateSlope(t, k, d, source)));
            }
        }
        for (k, slope) in s.tau_slopes.iter().enumerate().filter(|(_, slope)| slope.param as usize == unknown) {
            for (t, term) in s.terms.iter().enumerate() {
                let source = self.source(term);
                if matches!(source, Source::Delayed(d, _) if d == slope.delayed as usize) {
                    influences.push((term.row as usize, Influence::Delay(t, k, source)));
                }
            }
        }
        influences.sort_by_key(|(row, _)| *row);
        Column { influences }
    }

    /// An unknown end value of a state: in its own equation, and wherever the state is seen delayed.
    fn end_column(&self, state: usize, factor: usize) -> Column {
        let mut influences = vec![(state, Influence::End(factor))];
        for (t, row, d) in self.delayed_terms(state) {
            influences.push((row, Influence::DelayedEnd(t, factor, d)));
        }
        for (k, term) in self.structure.terms.iter().enumerate() {
            if self.state(self.source(term)) == Some(state) {
                for (t, row, d) in self.delayed_terms(term.row as usize) {
                    influences.push((row, Influence::DelayedRateEnd([t, k], factor, d)));
                }
            }
        }
        influences.sort_by_key(|(row, _)| *row);
        Column { influences }
    }

    /// Where a state is seen delayed, and its ends count: the position of the coefficient, its row, and the delayed signal.
    fn delayed_terms(&self, state: usize) -> impl Iterator<Item = (usize, usize, usize)> {
        let terms = self.structure.terms.iter().enumerate().filter(|_| self.bowed);
        terms.filter_map(move |(t, term)| match self.source(term) {
            source @ Source::Delayed(d, _) => (self.state(source) == Some(state)).then_some((t, term.row as usize, d)),
            _ => None,
        })
    }

    /// The input behind a signal, delayed or not.
    pub(super) fn input(&self, source: Source) -> Option<usize> {
        match source {
            Source::State(_) => None,
            Source::Input(j, _) => Some(j),
            Source::Delayed(d, _) => match self.structure.delayed[d] {
                Signal::State(_) => None,
                Signal::Input(j) => Some(j as usize),
            },
        }
    }

    /// The state behind a signal, delayed or not.
    pub(super) fn state(&self, source: Source) -> Option<usize> {
        match source {
            Source::State(j) => Some(j),
            Source::Input(..) => None,
            Source::Delayed(d, _) => match self.structure.delayed[d] {
                Signal::State(j) => Some(j as usize),
                Signal::Input(_) => None,
            },
        }
    }

    /// For each output the unknowns that it can depend on.
    fn arranged(&self) -> RowLayout {
        let n = self.structure.states;
        let mut needs: Vec<Vec<usize>> = vec![Vec::new(); n + self.structure.outputs];
        for term in &self.structure.terms {
            needs[term.row as usize].extend(self.state(self.source(term)));
        }
        let columns = (0..self.structure.outputs).map(|o| {
            let mut reached = vec![false; n];
            let mut path: Vec<usize> = needs[n + o].clone();
            while let Some(state) = path.pop() {
                if !std::mem::replace(&mut reached[state], true) {
                    path.extend(&needs[state]);
                }
            }
            let reaches = |(row, _): &(usize, Influence)| *row == n + o || *row < n && reached[*row];
            let columns = self.columns.iter().enumerate();
            columns.filter(|(_, c)| c.influences.iter().any(reaches)).map(|(k, _)| k as u32).collect()
        });
        RowLayout::new(columns.collect::<Vec<_>>())
    }

    /// The leaf of an input; behind 1/(j w) and j w.
    pub(super) fn input_leaf(&self, input: usize, shown: bool) -> u32 {
        let before = if shown && self.sampled { self.structure.inputs } else { 0 };
        BEHIND + (before + input) as u32
    }

    /// The leaf of exp(-j w tau).
    pub(super) fn delay_leaf(&self, delayed: usize) -> u32 {
        let inputs = self.structure.inputs * if self.sampled { 2 } else { 1 };
        self.input_leaf(inputs, false) + delayed as u32
    }

    /// Where delayed signals have ends: of a delayed state (exp(-j w tau) - 1)/(j w), what its end term is multiplied with.
    pub(super) fn gap_leaf(&self, delayed: usize) -> u32 {
        self.delay_leaf(self.structure.delayed.len()) + DELAYED * delayed as u32
    }

    /// Where delayed signals have ends: of a delayed state (exp(-j w tau) - 1 + j w tau)/(j w)^2, what the end term of its rate is
    /// multiplied with.
    pub(super) fn bow_leaf(&self, delayed: usize) -> u32 {
        self.gap_leaf(delayed) + 1
    }

    /// Where delayed signals have ends: of a delayed input the whole, as states and outputs see it.
    pub(super) fn delayed_leaf(&self, delayed: usize, shown: bool) -> u32 {
        self.gap_leaf(delayed) + 2 * u32::from(shown)
    }

    /// The derivative of that by the delay.
    pub(super) fn moved_leaf(&self, delayed: usize, shown: bool) -> u32 {
        self.delayed_leaf(delayed, shown) + 1
    }

    /// The leaf of the end term of an input, where rates of delayed states have ends.
    pub(super) fn input_end_leaf(&self, input: usize) -> u32 {
        self.gap_leaf(if self.ended { self.structure.delayed.len() } else { 0 }) + input as u32
    }

    /// The leaf of a known end term.
    pub(super) fn end_leaf(&self, known: usize) -> u32 {
        self.input_end_leaf(if self.bowed { self.structure.inputs } else { 0 }) + known as u32
    }

    /// The leaf of what one unit of an unknown end value adds.
    pub(super) fn factor_leaf(&self, factor: usize) -> u32 {
        self.end_leaf(self.known_ends.len()) + factor as u32
    }

    /// How many leaves there are.
    pub(super) fn leaves(&self) -> usize {
        self.factor_leaf(self.factors) as usize
    }

    /// Planes of derivatives: for each output its unknowns and one that is free.
    pub(super) fn planes(&self) -> usize {
        self.layout.outputs.iter().map(|o| o.columns.len() + 1).sum()
    }
}

/// The memory of one run, which all programs for it share.
pub(super) struct Leaves {
    /// The leaves of all blocks, then registers and planes of derivatives.
    pub(super) memory: Aligned,
    /// Leaves of a block.
    each: usize,
    blocks: usize,
    /// exp(-j w tau) of one delay.
    turned: Vec<Complex64>,
    /// The delays for which the leaves stand.
    tau: Vec<f64>,
}

impl Leaves {
    /// The leaves of a run; they are the same for all columns that a wiring may ask for.
    pub(super) fn new(wiring: &Wiring, omega: &[f64], inputs: &[Complex64], ends: &Ends) -> Self {
        let (each, blocks) = (wiring.leaves(), omega.len().div_ceil(BLOCK));
        let mut leaves = Self {
            memory: Aligned::new(blocks * each * PLANE),
            each,
            blocks,
            turned: Vec::new(),
            tau: vec![f64::NAN; wiring.structure.delayed.len()],
        };
        let last = omega.last().copied().unwrap_or(1.0);
        for k in 0..blocks * BLOCK {
            // lanes behind the last frequency repeat it, without inputs
            let w = omega.get(k).copied().unwrap_or(last);
            leaves.put(INVERSE, k, Complex64::new(0.0, -1.0 / w));
            leaves.put(OMEGA, k, Complex64::new(0.0, w));
        }
        for (j, plane) in inputs.chunks(omega.len().max(1)).enumerate() {
            leaves.put_all(wiring.input_leaf(j, false), plane);
        }
        for (known, (_, plane)) in ends.known.iter().enumerate() {
            leaves.put_all(wiring.end_leaf(known), plane);
        }
        for (input, plane) in ends.inputs.iter().enumerate() {
            leaves.put_all(wiring.input_end_leaf(input), plane);
        }
        for (factor, plane) in ends.factors.iter().enumerate() {
            leaves.put_all(wiring.factor_leaf(factor), plane);
        }
        leaves
    }

    /// Makes room for so many planes behind the leaves.
    pub(super) fn reserve(&mut self, planes: usize) {
        let wanted = (self.behind() + planes) * PLANE;
        if self.memory.len() < wanted {
            let mut larger = Aligned::new(wanted);
            larger[..self.memory.len()].copy_from_slice(&self.memory);
            self.memory = larger;
        }
    }

    /// The first plane behind the leaves.
    pub(super) fn behind(&self) -> usize {
        self.blocks * self.each
    }

    /// The first leaf of a block.
    pub(super) fn block(&self, block: usize) -> usize {
        block * self.each
    }

    /// Where a leaf stands for a frequency.
    fn place(&self, leaf: u32, k: usize) -> usize {
        (k / BLOCK * self.each + leaf as usize) * PLANE + k % BLOCK
    }

    fn put(&mut self, leaf: u32, k: usize, value: Complex64) {
        let place = self.place(leaf, k);
        (self.memory[place], self.memory[place + BLOCK]) = (value.re, value.im);
    }

    /// A leaf at a frequency.
    pub(super) fn get(&self, leaf: u32, k: usize) -> Complex64 {
        let place = self.place(leaf, k);
        Complex64::new(self.memory[place], self.memory[place + BLOCK])
    }

    fn put_all(&mut self, leaf: u32, plane: &[Complex64]) {
        plane.iter().enumerate().for_each(|(k, value)| self.put(leaf, k, *value));
    }

    /// Fills the leaves of delays that have changed.
    pub(super) fn delay(
        &mut self,
        wiring: &Wiring,
        tau: &[f64],
        (omega, spacing): (&[f64], Option<f64>),
        inputs: &mut [Option<DelayedInput>],
    ) {
        for (d, tau) in tau.iter().copied().enumerate() {
            if self.tau[d] == tau {
                continue;
            }
            self.tau[d] = tau;
            let leaf = wiring.delay_leaf(d);
            self.turn_by(leaf, tau, omega, spacing);
            if !wiring.ended {
                continue;
            }
            let Some(input) = &mut inputs[d] else {
                let over = |v: Complex64, w: f64| Complex64::new(v.im / w, -v.re / w);
                for (k, w) in omega.iter().enumerate() {
                    let gap = over(self.get(leaf, k) - 1.0, *w);
                    self.put(wiring.gap_leaf(d), k, gap);
                    self.put(wiring.bow_leaf(d), k, over(gap + tau, *w));
                }
                continue;
            };
            let mut turned = std::mem::take(&mut self.turned);
            turned.clear();
            turned.extend((0..omega.len()).map(|k| self.get(leaf, k)));
            let leaves = [false, true].map(|shown| [wiring.delayed_leaf(d, shown), wiring.moved_leaf(d, shown)]);
            input.at(tau, omega, &turned, |k, delayed| {
                leaves.iter().flatten().zip(delayed).for_each(|(leaf, value)| self.put(*leaf, k, value));
            });
            self.turned = turned;
        }
    }

    /// Fills the leaf exp(-j w tau). On even frequencies each block turns one table, which is off by a few roundings; errors
    /// do not add up from block to block.
    fn turn_by(&mut self, leaf: u32, tau: f64, omega: &[f64], spacing: Option<f64>) {
        let Some(step) = spacing.filter(|_| omega.len() > 8) else {
            return omega.iter().enumerate().for_each(|(k, w)| self.put(leaf, k, turn(-w * tau)));
        };
        let mut table = [Complex64::new(1.0, 0.0); BLOCK];
        let mut filled = 1;
        while filled < BLOCK.min(omega.len()) {
            let doubling = turn(-(filled as f64) * step * tau);
            let (known, next) = table.split_at_mut(filled);
            next.iter_mut().zip(known).for_each(|(next, known)| *next = doubling * *known);
            filled *= 2;
        }
        for (block, omega) in omega.chunks(BLOCK).enumerate() {
            let (first, place) = (turn(-omega[0] * tau), self.place(leaf, block * BLOCK));
            let (re, im) = self.memory[place..][..PLANE].split_at_mut(BLOCK);
            for (k, turned) in table.iter().take(omega.len()).enumerate() {
                let value = first * turned;
                (re[k], im[k]) = (value.re, value.im);
            }
        }
    }
}
