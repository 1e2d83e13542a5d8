//! From a wiring to a program: equations solved symbolically, every derivative by structural nonzeros only.
//!
//! With W = C (j w - A)^-1 the derivative by a parameter is `W (dA x + dB u + ...) + dC x + dD u + ...`. Columns of W are found
//! for the equations that unknowns move, or rows for the outputs, whichever makes the shorter program.

use super::elimination::Elimination;
use super::elimination::{Expressions, Scalar, Scalars, Value};
use super::program::{Program, Results};
use super::wiring::{Influence, Source, Wiring};

/// Makes the program; `units` says which of the given numbers (terms, slopes, derivatives of delays, end values) count
/// as 1 or -1. Nothing when the equations are too full to be solved symbolically.
pub(super) fn plan(wiring: &Wiring, units: &[Option<i8>]) -> Option<Program> {
    // pivots that change more entries than this are left to the reduction by numbers
    if changes(wiring) > 20_000 {
        return None;
    }
    let planner = Planner::new(wiring, units.to_vec());
    if wiring.asked.is_empty() {
        return Some(planner.program(true));
    }
    let by_columns = planner.clone().program(true);
    let by_rows = planner.program(false);
    Some(if by_rows.ops.len() < by_columns.ops.len() { by_rows } else { by_columns })
}

/// How many entries the elimination changes.
fn changes(wiring: &Wiring) -> usize {
    let n = wiring.structure.states;
    if n > 400 {
        return usize::MAX;
    }
    let mut full = vec![false; n * n];
    for term in wiring.structure.terms.iter().filter(|t| (t.row as usize) < n) {
        if let Some(j) = wiring.state(wiring.source(term)) {
            full[term.row as usize * n + j] = true;
        }
    }
    let depends = (0..n).map(|i| (0..n).filter(|j| *j != i && full[i * n + j]).collect());
    let mut count = 0;
    for block in super::elimination::blocks(&depends.collect()) {
        for (position, k) in block.iter().enumerate() {
            let left = &block[position + 1..];
            for i in left.iter().filter(|i| full[**i * n + k]).copied().collect::<Vec<_>>() {
                for j in left.iter().filter(|j| full[k * n + **j]).copied().collect::<Vec<_>>() {
                    full[i * n + j] = true;
                    count += 1;
                }
            }
        }
    }
    count
}

#[derive(Clone)]
struct Planner<'w> {
    wiring: &'w Wiring,
    g: Expressions,
    elimination: Elimination,
    states: Vec<Option<Value>>,
    /// Terms of each derivative.
    planes: Vec<Vec<Value>>,
}

impl<'w> Planner<'w> {
    fn new(wiring: &'w Wiring, units: Vec<Option<i8>>) -> Self {
        let (s, n) = (&wiring.structure, wiring.structure.states);
        let mut g = Expressions::new(Scalars::new(units));
        let mut entries: Vec<Vec<Value>> = vec![Vec::new(); n * n];
        let mut right: Vec<Vec<Value>> = vec![Vec::new(); n];
        let mut diagonal = vec![Scalar::ZERO; n];
        for (k, term) in s.terms.iter().enumerate().filter(|(_, t)| (t.row as usize) < n) {
            let (row, source) = (term.row as usize, wiring.source(term));
            let coefficient = Value { factor: g.scalars.given(k), node: None };
            let Some(j) = wiring.state(source) else {
                let signal = signal(&mut g, wiring, source);
                right[row].push(g.product(coefficient, signal));
                continue;
            };
            let entry = match source {
                Source::Delayed(d, _) => {
                    let gap = gap(&mut g, wiring, d, j);
                    right[row].extend(gap.map(|gap| g.product(coefficient, gap)));
                    let delay = g.leaf(wiring.delay_leaf(d));
                    g.product(coefficient, delay)
                }
                _ => coefficient,
            };
            let entry = g.negative(entry);
            if row == j && entry.node.is_none() {
                diagonal[row] = entry.factor;
            }
            entries[row * n + j].push(entry);
        }
        for (state, right) in right.iter_mut().enumerate() {
            right.extend(end_terms(&mut g, wiring, state).into_iter().map(|end| g.negative(end)));
        }
        let entries = entries.iter().enumerate().map(|(at, e)| g.sum(at / n == at % n, e)).collect();
        let elimination = Elimination::new(&mut g, entries, &diagonal);
        let right: Vec<_> = right.iter().map(|r| g.sum(false, r)).collect();
        let states = elimination.solve(&mut g, &right);
        let planes = vec![Vec::new(); wiring.planes()];
        Self { wiring, g, elimination, states, planes }
    }

    fn program(mut self, by_columns: bool) -> Program {
        let (n, q) = (self.wiring.structure.states, self.wiring.structure.outputs);
        let mut results = Results { outputs: Vec::new(), derivatives: Vec::new() };
        for o in 0..q {
            let sum = self.row(n + o, |p, source| p.value_of(source));
            results.outputs.push(sum.map(|y| self.g.materialised(y)));
        }
        let forces = self.forces();
        let outputs: Vec<Vec<Option<Value>>> = (0..q).map(|o| self.shows(o)).collect();
        for (column, rows) in forces.iter().enumerate() {
            for (row, force) in rows.iter().filter(|(row, _)| *row >= n) {
                self.add(row - n, column, *force);
            }
        }
        let last = |rows: &[(usize, Value)]| rows.iter().map(|r| r.0).filter(|r| *r < n).max();
        if by_columns {
            self.finish(&mut results, |_, column| last(&forces[column]).is_none());
            for state in (0..n).filter(|state| forces.iter().flatten().any(|(row, _)| row == state)) {
                let unit = |i| (i == state).then_some(Value { factor: Scalar::ONE, node: None });
                let unit: Vec<_> = (0..n).map(unit).collect();
                let column = self.elimination.solve(&mut self.g, &unit);
                for (o, shows) in outputs.iter().enumerate() {
                    let seen = |j: usize| Some(self.g.product(shows[j]?, column[j]?));
                    let seen: Vec<Value> = (0..n).filter_map(seen).collect();
                    let weight = self.g.sum(false, &seen);
                    self.spread(o, state, weight, &forces);
                }
                self.finish(&mut results, |_, column| last(&forces[column]) == Some(state));
            }
        } else {
            for (o, shows) in outputs.iter().enumerate() {
                let row = self.elimination.solve_left(&mut self.g, shows);
                for (state, weight) in row.iter().enumerate() {
                    self.spread(o, state, *weight, &forces);
                }
                self.finish(&mut results, |output, _| output == o);
            }
        }
        Program::new(self.g, &results)
    }

    /// Adds what the forces on a state do to an output that sees them with this weight.
    fn spread(&mut self, output: usize, state: usize, weight: Option<Value>, forces: &[Vec<(usize, Value)>]) {
        let Some(weight) = weight else { return };
        let mut signed = None;
        for (column, rows) in forces.iter().enumerate() {
            let Some((_, force)) = rows.iter().find(|(row, _)| *row == state) else { continue };
            let weight = *signed.get_or_insert_with(|| self.g.signed(weight));
            let product = self.g.product(weight, *force);
            self.add(output, column, product);
        }
    }

    fn add(&mut self, output: usize, column: usize, value: Value) {
        let mut outputs = self.wiring.layout.outputs.iter();
        let before: usize = outputs.by_ref().take(output).map(|o| o.columns.len() + 1).sum();
        let Some(row) = outputs.next() else { return };
        if let Ok(lane) = row.columns.binary_search(&(column as u32)) {
            self.planes[before + lane].push(value);
        }
    }

    /// Derivatives of which all terms are known become results.
    fn finish(&mut self, results: &mut Results, ready: impl Fn(usize, usize) -> bool) {
        let outputs = self.wiring.layout.outputs.iter().enumerate();
        let places = outputs.flat_map(|(o, row)| row.columns.iter().map(Some).chain([None]).map(move |c| (o, c)));
        for (at, (output, column)) in places.enumerate() {
            if !column.is_some_and(|c| ready(output, *c as usize)) {
                continue;
            }
            let zero = Value { factor: Scalar::ZERO, node: None };
            let sum = self.g.sum(false, &self.planes[at]).unwrap_or(zero);
            results.derivatives.push((self.g.materialised(sum), at as u32));
        }
    }

    /// What each unknown adds to the right of each equation, rows rising; factors of state equations are computed before.
    fn forces(&mut self) -> Vec<Vec<(usize, Value)>> {
        let (s, n) = (self.wiring.structure.clone(), self.wiring.structure.states);
        let columns = &self.wiring.columns;
        let mut forces = Vec::with_capacity(columns.len());
        for column in columns {
            let mut rows: Vec<(usize, Vec<Value>)> = Vec::new();
            for (row, influence) in &column.influences {
                let value = match *influence {
                    Influence::Slope(slope, source) => {
                        let factor = self.g.scalars.given(s.terms.len() + slope);
                        self.value_of(source).map(|signal| self.g.scaled(factor, signal))
                    }
                    Influence::Delay(term, slope, source) => {
                        let (a, t) =
                            (self.g.scalars.given(term), self.g.scalars.given(s.terms.len() + s.slopes.len() + slope));
                        let factor = self.g.scalars.product(a, t);
                        self.moved(source).map(|moved| self.g.scaled(factor, moved))
                    }
                    Influence::DelayedEnd(term, factor, delayed) => {
                        let gap = self.g.leaf(self.wiring.gap_leaf(delayed));
                        let leaf = self.g.leaf(self.wiring.factor_leaf(factor));
                        let (a, product) = (self.g.scalars.given(term), self.g.product(gap, leaf));
                        Some(self.g.scaled(a, product))
                    }
                    Influence::DelayedRateEnd([seen, own], factor, delayed) => {
                        let bow = self.g.leaf(self.wiring.bow_leaf(delayed));
                        let leaf = self.g.leaf(self.wiring.factor_leaf(factor));
                        let (a, b) = (self.g.scalars.given(seen), self.g.scalars.given(own));
                        let (factor, product) = (self.g.scalars.product(a, b), self.g.product(bow, leaf));
                        Some(self.g.scaled(factor, product))
                    }
                    Influence::RateSlope(seen, slope, delayed, source) => {
                        let a = self.g.scalars.given(seen);
                        let slope = self.g.scalars.given(s.terms.len() + slope);
                        let (factor, bow) =
                            (self.g.scalars.product(a, slope), self.g.leaf(self.wiring.bow_leaf(delayed)));
                        let end = ends_of(&mut self.g, self.wiring, source);
                        self.g.sum(false, &end).map(|end| {
                            let product = self.g.product(bow, end);
                            self.g.scaled(factor, product)
                        })
                    }
                    Influence::End(factor) => {
                        let leaf = self.g.leaf(self.wiring.factor_leaf(factor));
                        Some(self.g.negative(leaf))
                    }
                };
                match rows.last_mut().filter(|(last, _)| last == row) {
                    Some((_, values)) => values.extend(value),
                    None => rows.push((*row, value.into_iter().collect())),
                }
            }
            let mut own = Vec::new();
            for (row, values) in rows {
                let Some(sum) = self.g.sum(false, &values) else { continue };
                own.push((row, if row < n { self.g.signed(sum) } else { sum }));
            }
            forces.push(own);
        }
        forces
    }

    /// The coefficients with which an output shows each state.
    fn shows(&mut self, output: usize) -> Vec<Option<Value>> {
        let n = self.wiring.structure.states;
        let mut sums: Vec<Vec<Value>> = vec![Vec::new(); n];
        let s = self.wiring.structure.clone();
        for (k, term) in s.terms.iter().enumerate().filter(|(_, t)| t.row as usize == n + output) {
            let source = self.wiring.source(term);
            let Some(j) = self.wiring.state(source) else { continue };
            let coefficient = Value { factor: self.g.scalars.given(k), node: None };
            let entry = match source {
                Source::Delayed(d, _) => {
                    let delay = self.g.leaf(self.wiring.delay_leaf(d));
                    self.g.product(coefficient, delay)
                }
                _ => coefficient,
            };
            sums[j].push(entry);
        }
        sums.iter().map(|s| self.g.sum(false, s)).collect()
    }

    /// The sum of an equation's coefficients times what `value` gives for their signals.
    fn row(&mut self, row: usize, value: impl Fn(&mut Self, Source) -> Option<Value>) -> Option<Value> {
        let s = self.wiring.structure.clone();
        let mut sum = Vec::new();
        for (k, term) in s.terms.iter().enumerate().filter(|(_, t)| t.row as usize == row) {
            let factor = self.g.scalars.given(k);
            if let Some(signal) = value(self, self.wiring.source(term)) {
                sum.push(self.g.scaled(factor, signal));
            }
        }
        self.g.sum(false, &sum)
    }

    /// A signal, delayed or not; nothing for a state that nothing drives.
    fn value_of(&mut self, source: Source) -> Option<Value> {
        let Some(state) = self.wiring.state(source) else { return Some(signal(&mut self.g, self.wiring, source)) };
        let value = self.states[state]?;
        match source {
            Source::Delayed(d, _) => {
                let delay = self.g.leaf(self.wiring.delay_leaf(d));
                let turned = self.g.product(delay, value);
                let gap = gap(&mut self.g, self.wiring, d, state);
                self.g.sum(false, &[Some(turned), gap].into_iter().flatten().collect::<Vec<_>>())
            }
            _ => Some(value),
        }
    }

    /// The derivative of a delayed signal by its delay.
    fn moved(&mut self, source: Source) -> Option<Value> {
        let Source::Delayed(d, shown) = source else { return None };
        let delay = self.g.leaf(self.wiring.delay_leaf(d));
        let Some(state) = self.wiring.state(source) else {
            if self.wiring.ended {
                return Some(self.g.leaf(self.wiring.moved_leaf(d, shown)));
            }
            let signal = signal(&mut self.g, self.wiring, source);
            return Some(self.g.lag(signal));
        };
        // -exp(-j w tau) (j w x + E) - (exp(-j w tau) - 1)/(j w) S
        let turned = self.g.product(delay, self.states[state]?);
        let lag = self.g.lag(turned);
        let ends = if self.wiring.ended { end_terms(&mut self.g, self.wiring, state) } else { Vec::new() };
        let end = self.g.sum(false, &ends).map(|end| {
            let turned = self.g.product(delay, end);
            self.g.negative(turned)
        });
        let rate = if self.wiring.ended { rate_end(&mut self.g, self.wiring, state) } else { None };
        let bow = rate.map(|rate| {
            let gap = self.g.leaf(self.wiring.gap_leaf(d));
            let product = self.g.product(gap, rate);
            self.g.negative(product)
        });
        self.g.sum(false, &[Some(lag), end, bow].into_iter().flatten().collect::<Vec<_>>())
    }
}

/// The terms of a state's end term: known, or unknown values times their factors.
fn end_terms(g: &mut Expressions, wiring: &Wiring, state: usize) -> Vec<Value> {
    let s = &wiring.structure;
    let known = wiring.known_ends.iter().position(|known| *known == state);
    let mut terms: Vec<Value> = known.map(|known| g.leaf(wiring.end_leaf(known))).into_iter().collect();
    let first = s.terms.len() + s.slopes.len() + s.tau_slopes.len();
    for (k, (_, factor)) in wiring.unknown_ends.iter().enumerate().filter(|(_, (end, _))| end.state == state) {
        let (value, unit) = (g.scalars.given(first + k), g.leaf(wiring.factor_leaf(*factor)));
        terms.push(g.scaled(value, unit));
    }
    terms
}

/// The terms of the end term of a signal: those of a delayed one are those of the signal.
fn ends_of(g: &mut Expressions, wiring: &Wiring, source: Source) -> Vec<Value> {
    match (wiring.state(source), wiring.input(source)) {
        (Some(state), _) => end_terms(g, wiring, state),
        (None, Some(input)) => vec![g.leaf(wiring.input_end_leaf(input))],
        (None, None) => Vec::new(),
    }
}

/// The end term of the rate of a state, by its equation.
fn rate_end(g: &mut Expressions, wiring: &Wiring, state: usize) -> Option<Value> {
    let mut sum = Vec::new();
    for (k, term) in wiring.structure.terms.iter().enumerate().filter(|(_, t)| t.row as usize == state) {
        let (factor, ends) = (g.scalars.given(k), ends_of(g, wiring, wiring.source(term)));
        sum.extend(ends.into_iter().map(|end| g.scaled(factor, end)));
    }
    g.sum(false, &sum)
}

/// What a delayed state has besides the turned state: it goes straight on outside of the record.
fn gap(g: &mut Expressions, wiring: &Wiring, delayed: usize, state: usize) -> Option<Value> {
    if !wiring.ended {
        return None;
    }
    let ends = end_terms(g, wiring, state);
    let (end, rate) = (g.sum(false, &ends), rate_end(g, wiring, state));
    let (gap, bow) = (g.leaf(wiring.gap_leaf(delayed)), g.leaf(wiring.bow_leaf(delayed)));
    let parts = [end.map(|end| g.product(gap, end)), rate.map(|rate| g.product(bow, rate))];
    g.sum(false, &parts.into_iter().flatten().collect::<Vec<_>>())
}

/// An input, delayed or not.
fn signal(g: &mut Expressions, wiring: &Wiring, source: Source) -> Value {
    use fdm_grammar::graph::Signal;
    match source {
        Source::Input(j, shown) => g.leaf(wiring.input_leaf(j, shown)),
        Source::Delayed(d, shown) if wiring.ended => g.leaf(wiring.delayed_leaf(d, shown)),
        Source::Delayed(d, shown) => {
            let input = match wiring.structure.delayed[d] {
                Signal::Input(j) | Signal::State(j) => j as usize,
            };
            let (delay, input) = (g.leaf(wiring.delay_leaf(d)), g.leaf(wiring.input_leaf(input, shown)));
            g.product(delay, input)
        }
        Source::State(_) => Value { factor: Scalar::ZERO, node: None },
    }
}
