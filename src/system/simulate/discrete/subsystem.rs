//! One subsystem: its coefficients for every length of a step, and its states.

use super::equations::{Equations, Group, Part};
use super::feed::{Feed, Reading, Term, output_terms, step_terms};
use super::map::{LinearMap, Motion};
use super::response::{Response, Values};
use super::transition::{Intervals, Jet, Method, Transition};
use crate::dynamics::Layout;
use crate::simulate::drive::DriveTable;
use fdm_numeric::lanes::{Aligned, Simd, VECTOR, WithSimd};
use std::ops::Range;

/// Steps that are worked off together: as many as leave room in the cache nearest to the processor.
pub(super) fn steps_of_a_block(numbers_per_step: usize) -> usize {
    (8192 / numbers_per_step.max(1)).clamp(16, 64)
}

/// A subsystem at work: the sensitivities of its states, which stand where they are asked for.
pub(super) struct Subsystem {
    pub(super) part: Part,
    /// For each lane of a parameter its position among the columns, and the parameter.
    pub(super) columns: Vec<(u32, usize)>,
    /// Lanes of a row: one for each of the columns, and a free one.
    pub(super) width: usize,
    /// First number of its rows in those of a sample: states, then outputs that are none.
    pub(super) start: usize,
    /// The first of its states, and of its outputs that are none, among all values of them.
    pub(super) lane: usize,
    pub(super) output_lane: usize,
    pub(super) terms: Vec<Term>,
    pub(super) output_terms: Vec<Term>,
    /// Where these stand in the feed.
    places: Vec<u32>,
    output_places: Vec<u32>,
    /// For each length of a step.
    steps: Vec<LinearMap>,
    observe: LinearMap,
    transition: Transition,
    a: Jet,
    /// Coefficients of the drives and the constant; of the states too for outputs.
    b: Jet,
    scaled: Jet,
    by_weight: [Jet; 3],
    /// Rows of the states at present, and room for those after some steps, where they are not written to their places at once.
    rows: Aligned,
}

/// How many there are of what a subsystem keeps room for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Counts {
    /// Lengths of steps.
    pub(super) kinds: usize,
    /// Steps between samples.
    pub(super) per: usize,
    /// Steps whose rows stand here, at most.
    pub(super) kept: usize,
}

impl Subsystem {
    /// `held` tells of every input whether it is held between samples.
    pub(super) fn new(
        layout: &Layout,
        part: Part,
        columns: &[usize],
        held: &[bool],
        counts: Counts,
        drive: &DriveTable,
    ) -> Self {
        let own = columns.iter().enumerate().filter(|(_, k)| part.params.contains(k));
        let columns: Vec<(u32, usize)> = own.map(|(c, k)| (c as u32, *k)).collect();
        let (n, rows, drives) = (part.states.len(), part.outputs.len(), part.drive.len() + 1);
        let width = (columns.len() + 1).next_multiple_of(VECTOR);
        // nothing is differentiated without columns
        let lanes = if columns.is_empty() { 0 } else { width };
        let terms = step_terms(layout, &part, (held, counts.per), drive);
        let output_terms = output_terms(layout, &part);
        let zero = || Jet::zero(n, drives, lanes);
        Self {
            steps: (0..counts.kinds).map(|_| LinearMap::new(n, n, terms.len(), lanes)).collect(),
            observe: LinearMap::new(rows, n, output_terms.len(), lanes),
            transition: Transition::new(n, lanes),
            a: Jet::zero(n, n, lanes),
            b: zero(),
            scaled: zero(),
            by_weight: [zero(), zero(), zero()],
            rows: Aligned::new((counts.kept + 1) * n * lanes),
            part,
            columns,
            width,
            start: 0,
            lane: 0,
            output_lane: 0,
            terms,
            output_terms,
            places: Vec::new(),
            output_places: Vec::new(),
        }
    }

    /// Takes its place among the values of all states and outputs, whose feeds are known.
    pub(super) fn take_place(&mut self, values: &mut Values) {
        self.places = self.terms.iter().map(|term| values.steps.place(term.reading)).collect();
        self.output_places = self.output_terms.iter().map(|term| values.samples.place(term.reading)).collect();
        self.lane = values.response.take_up(self.part.states.len(), None, &self.places);
        let states = self.lane..self.lane + self.part.states.len();
        self.output_lane = values.outputs.take_up(self.part.outputs.len(), Some(states), &self.output_places);
    }

    /// Numbers of the states' rows.
    #[inline(always)]
    pub(super) fn size(&self) -> usize {
        self.part.states.len() * self.width
    }

    /// Rows of the states, where they are kept here; none without columns.
    #[inline(always)]
    pub(super) fn rows(&self) -> &[f64] {
        &self.rows[..if self.columns.is_empty() { 0 } else { self.size() }]
    }

    /// Coefficients for new parameters.
    #[inline(always)]
    pub(super) fn prepare(
        &mut self,
        layout: &Layout,
        equations: &Equations,
        (known, drive): (&[f64], &DriveTable),
        (method, lengths): (Method, &[f64]),
        values: &mut Values,
    ) {
        self.matrices(layout, equations);
        for (kind, h) in lengths.iter().enumerate() {
            self.transition.compute(method, &self.a, *h);
            self.scaled.scale_of(*h, &self.b);
            for (product, weight) in self.by_weight.iter_mut().zip(&self.transition.weights) {
                product.product_of(weight, &self.scaled);
            }
            self.fill_step(kind, layout, (known, drive), &mut values.response);
        }
        self.fill_observe(layout, equations, known, &mut values.outputs);
        self.rows.fill(0.0);
        for (i, state) in self.part.states.iter().enumerate() {
            values.slots[self.lane + i] = known[layout.initial.start + state];
            for (k, param) in layout.patterns.initial_by_param.row(*state) {
                if let Some(lane) = self.columns.iter().position(|(_, p)| *p == param) {
                    self.rows[i * self.width + lane] = known[layout.initial_by_param.start + k];
                }
            }
        }
    }

    /// A and B of this subsystem.
    fn matrices(&mut self, layout: &Layout, equations: &Equations) {
        let Self { part, columns, a, b, .. } = self;
        let lanes = a.lanes;
        for (i, row) in part.states.iter().enumerate() {
            for (j, column) in part.states.iter().enumerate() {
                a.value[i * a.columns + j] = equations.by_state(layout, Group::Rates, *row, *column);
                let slopes = &mut a.slope[(i * a.columns + j) * lanes..][..columns.len()];
                for (slope, (_, k)) in slopes.iter_mut().zip(columns.iter()) {
                    *slope = equations.slope(layout, Group::Rates, *row, *column, *k);
                }
            }
            for j in 0..b.columns {
                let slopes = &mut b.slope[(i * b.columns + j) * lanes..][..columns.len()];
                let drive = part.drive.get(j);
                b.value[i * b.columns + j] = match drive {
                    Some(d) => equations.by_drive(layout, Group::Rates, *row, *d),
                    None => equations.constant(Group::Rates, *row),
                };
                for (slope, (_, k)) in slopes.iter_mut().zip(columns.iter()) {
                    *slope = match drive {
                        Some(d) => equations.slope(layout, Group::Rates, *row, layout.states + d, *k),
                        None => equations.constant_slope(layout, Group::Rates, *row, *k),
                    };
                }
            }
        }
    }

    /// Coefficients of a step of one length.
    #[inline(always)]
    fn fill_step(
        &mut self,
        kind: usize,
        layout: &Layout,
        (known, seen): (&[f64], &DriveTable),
        response: &mut Response,
    ) {
        let Self { part, columns, terms, places, steps, transition, by_weight, lane, .. } = self;
        let (map, n, last) = (&mut steps[kind], part.states.len(), part.drive.len());
        for i in 0..n {
            for (m, term) in terms.iter().enumerate() {
                let (weights, delays) = term.weights(seen);
                let (to, mut sum) = (map.forcing_of(m, i), 0.0);
                to.fill(0.0);
                for (stage, product) in by_weight.iter().enumerate() {
                    let value = product.value[i * product.columns + term.drive];
                    if delays[stage] != 0.0 {
                        let delayed = part.drive[term.drive] - layout.inputs;
                        add_delay(layout, known, delayed, delays[stage] * value, columns, to);
                    }
                    if weights[stage] != 0.0 {
                        let slopes = product.slope_of(i, term.drive);
                        to.iter_mut().zip(slopes).for_each(|(t, s)| *t += weights[stage] * s);
                        sum += weights[stage] * value;
                    }
                }
                *response.by_feed(kind, *lane + i, places[m]) = sum;
            }
            for j in 0..n {
                let value = transition.flow.value[i * n + j];
                *response.by_state(kind, *lane + i, *lane + j) = value;
                map.flow[j * n + i] = value;
                map.forcing_of(terms.len() + j, i).copy_from_slice(transition.flow.slope_of(i, j));
            }
            let (to, mut constant) = (map.forcing_of(terms.len() + n, i), 0.0);
            to.fill(0.0);
            for product in by_weight.iter() {
                constant += product.value[i * product.columns + last];
                to.iter_mut().zip(product.slope_of(i, last)).for_each(|(t, s)| *t += s);
            }
            *response.constant(kind, *lane + i) = constant;
        }
    }

    /// Coefficients of the outputs that are not states.
    fn fill_observe(&mut self, layout: &Layout, equations: &Equations, known: &[f64], outputs: &mut Response) {
        let Self { part, columns, output_terms, output_places, observe, lane, output_lane, .. } = self;
        let (rows, n) = (part.outputs.len(), part.states.len());
        for (r, output) in part.outputs.iter().enumerate() {
            let own = *output_lane + r;
            for (m, term) in output_terms.iter().enumerate() {
                let (to, d) = (observe.forcing_of(m, r), part.output_drive[term.drive]);
                to.fill(0.0);
                let value = equations.by_drive(layout, Group::Outputs, *output, d);
                if let Reading::Slope(_) = term.reading {
                    add_delay(layout, known, d - layout.inputs, value, columns, to);
                    continue;
                }
                *outputs.by_feed(0, own, output_places[m]) = value;
                for (slope, (_, k)) in to.iter_mut().zip(columns.iter()) {
                    *slope = equations.slope(layout, Group::Outputs, *output, layout.states + d, *k);
                }
            }
            for (j, state) in part.states.iter().enumerate() {
                let value = equations.by_state(layout, Group::Outputs, *output, *state);
                *outputs.by_state(0, own, *lane + j) = value;
                observe.flow[j * rows + r] = value;
                let to = observe.forcing_of(output_terms.len() + j, r);
                for (slope, (_, k)) in to.iter_mut().zip(columns.iter()) {
                    *slope = equations.slope(layout, Group::Outputs, *output, *state, *k);
                }
            }
            *outputs.constant(0, own) = equations.constant(Group::Outputs, *output);
            let to = observe.forcing_of(output_terms.len() + n, r);
            for (slope, (_, k)) in to.iter_mut().zip(columns.iter()) {
                *slope = equations.constant_slope(layout, Group::Outputs, *output, *k);
            }
        }
    }

    /// The rows of the states after some steps, from the values before each and the feed. Their place is given by the numbers of all
    /// rows and how far it is from step to step; they begin with those before the first step.
    #[inline(always)]
    pub(super) fn march<S: Simd>(
        &self,
        simd: S,
        moves: (Feed<'_>, &Values),
        steps: (&Intervals, Range<usize>),
        place: (&mut [f64], usize),
    ) {
        simd.vectorize(Advance { subsystem: self, moves, steps, place });
    }

    /// The same where the rows stand here.
    #[inline(always)]
    pub(super) fn march_here<S: Simd>(
        &mut self,
        simd: S,
        moves: (Feed<'_>, &Values),
        steps: (&Intervals, Range<usize>),
    ) {
        let (mut rows, size, count) = (std::mem::take(&mut self.rows), self.size(), steps.1.len());
        self.march(simd, moves, steps, (&mut rows, size));
        rows.copy_within(count * size..(count + 1) * size, 0);
        self.rows = rows;
    }

    #[inline(always)]
    fn take_steps<S: Simd>(
        &self,
        simd: S,
        (feed, values): (Feed<'_>, &Values),
        (intervals, steps): (&Intervals, Range<usize>),
        (rows, apart): (&mut [f64], usize),
    ) {
        let (mut from, end) = (steps.start, steps.end);
        while from < end {
            let (kind, to) = intervals.alike(from, end);
            let at = from - steps.start;
            let (values, size) = values.from(at, self.lane);
            let motion = Motion { feed: feed.from(at), places: &self.places, values, apart: size };
            self.steps[kind].march(simd, &mut rows[at * apart..], apart, motion, to - from);
            from = to;
        }
    }

    /// The rows of outputs that are not states, of `count` samples whose values of the states stand from `slot` on. They go behind
    /// those of the states, `apart` from sample to sample.
    #[inline(always)]
    pub(super) fn observe<S: Simd>(
        &self,
        simd: S,
        (feed, values, slot): (Feed<'_>, &Values, usize),
        (rows, apart): (&mut [f64], usize),
        count: usize,
    ) {
        let (values, size) = values.from(slot, self.lane);
        let motion = Motion { feed, places: &self.output_places, values, apart: size };
        simd.vectorize(Observe { map: &self.observe, motion, rows, apart, count });
    }
}

/// Some steps of the rows: one function for each set of instructions, however many call it, for it holds the kernels of all sizes.
struct Advance<'m> {
    subsystem: &'m Subsystem,
    moves: (Feed<'m>, &'m Values),
    steps: (&'m Intervals, Range<usize>),
    place: (&'m mut [f64], usize),
}

impl WithSimd for Advance<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.subsystem.take_steps(simd, self.moves, self.steps, self.place);
    }
}

/// Rows of outputs of some samples, likewise.
struct Observe<'m> {
    map: &'m LinearMap,
    motion: Motion<'m>,
    rows: &'m mut [f64],
    apart: usize,
    count: usize,
}

impl WithSimd for Observe<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.map.sweep(simd, self.rows, self.apart, self.motion, self.count);
    }
}

/// Adds the derivatives of a delayed signal by the parameters of its delay: `-slope tau_theta` times its coefficient.
fn add_delay(layout: &Layout, known: &[f64], delayed: usize, value: f64, columns: &[(u32, usize)], to: &mut [f64]) {
    for (entry, param) in layout.patterns.tau_by_param.row(delayed) {
        if let Some(lane) = columns.iter().position(|(_, k)| *k == param) {
            to[lane] -= value * known[layout.tau_by_param.start + entry];
        }
    }
}
