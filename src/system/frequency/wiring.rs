//! What drives what: equations, the unknowns that are asked for, and the planes from which they are fed.

use super::end_points::{EndColumn, Ends};
use super::program::BEHIND;
use crate::linear::{Structure, Term};
use crate::simulate::RowLayout;
use fdm_grammar::graph::Signal;
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
