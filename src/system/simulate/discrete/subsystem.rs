//! One subsystem: its coefficients for every length of a step, and its states.
//!
//! What enters the steps and outputs of a subsystem beside its states: rows of numbers read from the drive.

use super::equations::{Equations, Group, Part};
use super::map::LinearMap;
use super::transition::{Intervals, Jet, Method, Transition};
use crate::dynamics::Layout;
use crate::simulate::delayed_inputs::TAPS;
use crate::simulate::drive::DriveTable;
use fdm_grammar::graph::Signal;
use fdm_numeric::lanes::{Aligned, Simd, VECTOR, WithSimd, copy_vectors};
use std::ops::Range;

/// Steps that are worked off together: as many as leave room in the cache nearest to the processor.
pub(super) fn steps_of_a_block(numbers_per_step: usize) -> usize {
    (8192 / numbers_per_step.max(1)).clamp(16, 64)
}

/// A subsystem at work.
pub(super) struct Subsystem {
    pub(super) part: Part,
    /// The first of its rows within those of a sample.
    pub(super) start: usize,
    /// For each lane of a parameter its position among the columns, and the parameter.
    pub(super) columns: Vec<(u32, usize)>,
    /// Lanes of a row, and the lane of the states themselves.
    pub(super) width: usize,
    pub(super) lane: usize,
    terms: Vec<Term>,
    output_terms: Vec<Term>,
    /// For each length of a step.
    pub(super) steps: Vec<LinearMap>,
    pub(super) observe: LinearMap,
    transition: Transition,
    a: Jet,
    /// Coefficients of the drives and the constant; of the states too for outputs.
    b: Jet,
    scaled: Jet,
    by_weight: [Jet; 3],
    /// Whether there are no constants: the last number of the feed is then not read.
    homogeneous: bool,
    /// Numbers of a slot.
    size: usize,
    /// States with their sensitivities, rows of lanes: before the first of some steps, and after each.
    slots: Aligned,
    /// Which of the slots holds the present.
    present: usize,
    feed: Vec<f64>,
}

impl Subsystem {
    /// `held` tells of every input whether it is held between samples; `kinds` is the number of lengths, `per` that of steps
    /// between samples.
    pub(super) fn new(
        layout: &Layout,
        part: Part,
        columns: &[usize],
        held: &[bool],
        (kinds, per): (usize, usize),
        drive: &DriveTable,
    ) -> Self {
        let own = columns.iter().enumerate().filter(|(_, k)| part.params.contains(k));
        let columns: Vec<(u32, usize)> = own.map(|(c, k)| (c as u32, *k)).collect();
        let (n, rows, lane) = (part.states.len(), part.outputs.len(), columns.len());
        let (width, drives) = ((lane + 1).next_multiple_of(VECTOR), part.drive.len() + 1);
        let terms = step_terms(layout, &part, (held, per), drive);
        let output_terms = output_terms(layout, &part);
        let map = |rows: usize, terms: usize| LinearMap::new(rows, n, terms, (width, lane));
        let zero = || Jet::zero(n, drives, width);
        Self {
            steps: (0..kinds).map(|_| map(n, terms.len())).collect(),
            observe: map(rows, output_terms.len()),
            transition: Transition::new(n, width),
            a: Jet::zero(n, n, width),
            b: zero(),
            scaled: zero(),
            by_weight: [zero(), zero(), zero()],
            homogeneous: false,
            size: n * width,
            slots: Aligned::default(),
            start: 0,
            present: 0,
            feed: Vec::new(),
            part,
            columns,
            width,
            lane,
            terms,
            output_terms,
        }
    }

    /// Makes room for the most steps that are asked for at once, and for those of them whose states are kept here.
    pub(super) fn make_room(&mut self, block: usize, kept: usize) {
        self.slots = Aligned::new((kept + 1) * self.size);
        self.feed = vec![0.0; (block + 1) * self.terms.len().max(self.output_terms.len())];
    }

    /// The states with their sensitivities, rows of lanes.
    #[inline(always)]
    pub(super) fn states(&self) -> &[f64] {
        self.slot(self.present)
    }

    /// Numbers of a slot.
    pub(super) fn size(&self) -> usize {
        self.size
    }

    /// The states in one of the slots.
    #[inline(always)]
    fn slot(&self, slot: usize) -> &[f64] {
        &self.slots[slot * self.size..][..self.size]
    }

    /// The present value of one of the states.
    pub(super) fn value(&self, state: usize) -> f64 {
        self.states()[state * self.width + self.lane]
    }

    /// What enters a step, and what enters the outputs that are not states.
    pub(super) fn terms(&self) -> &[Term] {
        &self.terms
    }

    pub(super) fn output_terms(&self) -> &[Term] {
        &self.output_terms
    }

    /// Goes back to states from before.
    pub(super) fn restore(&mut self, states: &[f64]) {
        self.present = 0;
        self.slots[..states.len()].copy_from_slice(states);
    }

    /// Coefficients for new parameters.
    #[inline(always)]
    pub(super) fn prepare(
        &mut self,
        layout: &Layout,
        equations: &Equations,
        (known, drive): (&[f64], &DriveTable),
        (method, lengths): (Method, &[f64]),
    ) {
        self.matrices(layout, equations);
        let last = self.part.drive.len();
        let none = |i: usize| {
            self.b.value[i * self.b.columns + last] == 0.0 && self.b.slope_of(i, last).iter().all(|s| *s == 0.0)
        };
        self.homogeneous = (0..self.part.states.len()).all(none);
        for (kind, h) in lengths.iter().enumerate() {
            self.transition.compute(method, &self.a, *h);
            self.scaled.scale_of(*h, &self.b);
            for (product, weight) in self.by_weight.iter_mut().zip(&self.transition.weights) {
                product.product_of(weight, &self.scaled);
            }
            self.fill_step(kind, layout, (known, drive));
        }
        self.fill_observe(layout, equations, known);
        self.present = 0;
        self.slots.fill(0.0);
        for (i, state) in self.part.states.iter().enumerate() {
            self.slots[i * self.width + self.lane] = known[layout.initial.start + state];
            for (k, param) in layout.patterns.initial_by_param.row(*state) {
                if let Some(lane) = self.columns.iter().position(|(_, p)| *p == param) {
                    self.slots[i * self.width + lane] = known[layout.initial_by_param.start + k];
                }
            }
        }
    }

    /// A and B of this subsystem.
    fn matrices(&mut self, layout: &Layout, equations: &Equations) {
        let Self { part, columns, a, b, width, .. } = self;
        for (i, row) in part.states.iter().enumerate() {
            for (j, column) in part.states.iter().enumerate() {
                a.value[i * a.columns + j] = equations.by_state(layout, Group::Rates, *row, *column);
                let slopes = &mut a.slope[(i * a.columns + j) * *width..][..columns.len()];
                for (slope, (_, k)) in slopes.iter_mut().zip(columns.iter()) {
                    *slope = equations.slope(layout, Group::Rates, *row, *column, *k);
                }
            }
            for j in 0..b.columns {
                let slopes = &mut b.slope[(i * b.columns + j) * *width..][..columns.len()];
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
    fn fill_step(&mut self, kind: usize, layout: &Layout, (known, seen): (&[f64], &DriveTable)) {
        let Self { part, columns, terms, steps, transition, by_weight, lane, homogeneous, .. } = self;
        let (map, n) = (&mut steps[kind], part.states.len());
        map.terms = terms.len() - usize::from(*homogeneous);
        for (m, term) in terms[..map.terms].iter().enumerate() {
            for i in 0..n {
                let to = map.forcing_of(m, i);
                to.fill(0.0);
                let (values, delays) = term.weights(seen);
                for (stage, product) in by_weight.iter().enumerate() {
                    let value = product.value[i * product.columns + term.drive];
                    if delays[stage] != 0.0 {
                        let delayed = part.drive[term.drive] - layout.inputs;
                        add_delay(layout, known, delayed, delays[stage] * value, columns, to);
                    }
                    if values[stage] != 0.0 {
                        let slopes = product.slope_of(i, term.drive);
                        to.iter_mut().zip(slopes).for_each(|(t, s)| *t += values[stage] * s);
                        to[*lane] += values[stage] * value;
                    }
                }
            }
        }
        for j in 0..n {
            for i in 0..n {
                map.flow[j * n + i] = transition.flow.value[i * n + j];
                map.forcing_of(map.terms + j, i).copy_from_slice(transition.flow.slope_of(i, j));
            }
        }
    }

    /// Coefficients of the outputs that are not states.
    fn fill_observe(&mut self, layout: &Layout, equations: &Equations, known: &[f64]) {
        let Self { part, columns, output_terms, observe, lane, .. } = self;
        let rows = part.outputs.len();
        for (r, output) in part.outputs.iter().enumerate() {
            for (m, term) in output_terms.iter().enumerate() {
                let to = observe.forcing_of(m, r);
                to.fill(0.0);
                let drive = part.output_drive.get(term.drive);
                let value = match drive {
                    Some(d) => equations.by_drive(layout, Group::Outputs, *output, *d),
                    None => equations.constant(Group::Outputs, *output),
                };
                if let (Reading::Slope(_), Some(d)) = (term.reading, drive) {
                    add_delay(layout, known, d - layout.inputs, value, columns, to);
                    continue;
                }
                to[*lane] = value;
                for (slope, (_, k)) in to.iter_mut().zip(columns.iter()) {
                    *slope = match drive {
                        Some(d) => equations.slope(layout, Group::Outputs, *output, layout.states + d, *k),
                        None => equations.constant_slope(layout, Group::Outputs, *output, *k),
                    };
                }
            }
            for (j, state) in part.states.iter().enumerate() {
                observe.flow[j * rows + r] = equations.by_state(layout, Group::Outputs, *output, *state);
                let to = observe.forcing_of(output_terms.len() + j, r);
                for (slope, (_, k)) in to.iter_mut().zip(columns.iter()) {
                    *slope = equations.slope(layout, Group::Outputs, *output, *state, *k);
                }
            }
        }
    }

    /// Advances by some steps, at most a block. Where no other place is given, the states before them are in slot 0, those after step k in
    /// slot k + 1. A place is the rows of a sample before the steps and of one for each step, and how many numbers these are; the states
    /// after all steps are the present ones here as well.
    #[inline(always)]
    pub(super) fn advance<S: Simd>(
        &mut self,
        simd: S,
        drive: &DriveTable,
        (intervals, steps): (&Intervals, Range<usize>),
        place: Option<(&mut [f64], usize)>,
    ) {
        simd.vectorize(Advance { subsystem: self, drive, intervals, steps, place });
    }

    #[inline(always)]
    fn take_steps<S: Simd>(
        &mut self,
        simd: S,
        drive: &DriveTable,
        (intervals, steps): (&Intervals, Range<usize>),
        place: Option<(&mut [f64], usize)>,
    ) {
        let Self { terms, steps: maps, slots, feed, size, .. } = self;
        let (size, elsewhere) = (*size, place.is_some());
        slots.copy_within(self.present * size..(self.present + 1) * size, 0);
        self.present = if elsewhere { 0 } else { steps.len() };
        let mut own = if elsewhere { Aligned::default() } else { std::mem::take(slots) };
        let (rows, apart) = match place {
            None => (&mut own[..], size),
            Some((rows, apart)) => {
                let rows = &mut rows[self.start..];
                copy_vectors(&slots[..size], &mut rows[..size]);
                (rows, apart)
            }
        };
        let (mut from, end) = (steps.start, steps.end);
        while from < end {
            let (kind, to) = intervals.alike(from, end);
            let (map, count) = (&maps[kind], to - from);
            gather(&terms[..map.terms], drive, from..to, feed);
            let rows = &mut rows[(from - steps.start) * apart..];
            map.march(simd, rows, apart, feed, count);
            from = to;
        }
        if elsewhere {
            copy_vectors(&rows[(end - steps.start) * apart..][..size], &mut slots[..size]);
        } else {
            *slots = own;
        }
    }

    /// Rows of the outputs that are not states, at some samples (at most one more than a block has): behind those of the states, which
    /// stand in the rows of all that are given. These have so many numbers for each sample.
    #[inline(always)]
    pub(super) fn observe<S: Simd>(
        &mut self,
        simd: S,
        drive: &DriveTable,
        samples: Range<usize>,
        place: (&mut [f64], usize),
    ) {
        if !self.part.outputs.is_empty() {
            simd.vectorize(Observe { subsystem: self, drive, samples, place });
        }
    }

    #[inline(always)]
    fn take_outputs<S: Simd>(
        &mut self,
        simd: S,
        drive: &DriveTable,
        samples: Range<usize>,
        (rows, apart): (&mut [f64], usize),
    ) {
        let count = samples.len();
        gather_samples(&self.output_terms, drive, samples, &mut self.feed);
        self.observe.sweep(simd, &mut rows[self.start..], apart, &self.feed, count);
    }
}

/// Some steps: one function for each set of instructions, however many call it, for it holds the kernels of all sizes.
struct Advance<'m> {
    subsystem: &'m mut Subsystem,
    drive: &'m DriveTable,
    intervals: &'m Intervals,
    steps: Range<usize>,
    place: Option<(&'m mut [f64], usize)>,
}

impl WithSimd for Advance<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.subsystem.take_steps(simd, self.drive, (self.intervals, self.steps), self.place);
    }
}

/// Outputs of some samples, likewise.
struct Observe<'m> {
    subsystem: &'m mut Subsystem,
    drive: &'m DriveTable,
    samples: Range<usize>,
    place: (&'m mut [f64], usize),
}

impl WithSimd for Observe<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.subsystem.take_outputs(simd, self.drive, self.samples, self.place);
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

/// One number of the feed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reading {
    /// From the values of the drive, at this distance from those of the step or sample.
    Value(u32),
    /// From the samples, at this distance from the one at the beginning of the step: where every step is an interval, the
    /// inputs stand there closer together.
    Sample(u32),
    /// From the slopes of delayed signals, likewise.
    Slope(u32),
    /// One of the neighbouring samples of an input through which its delay is seen.
    Tap { input: u32, delayed: u32, tap: u32 },
    /// 1, for constants.
    One,
}

/// A number of the feed and its coefficients: a combination of the weights at the beginning, in the middle and at the end
/// of a step (outputs: the first alone).
#[derive(Debug, Clone, Copy)]
pub(super) struct Term {
    pub(super) reading: Reading,
    /// Position among the drives of this group of equations; the constant stands behind them.
    pub(super) drive: usize,
    pub(super) weights: [f64; 3],
}

impl Term {
    /// Weights of the three stages: of the signal, and of its slope, which delays are seen by.
    pub(super) fn weights(&self, drive: &DriveTable) -> ([f64; 3], [f64; 3]) {
        match self.reading {
            Reading::Slope(_) => ([0.0; 3], self.weights),
            Reading::Tap { delayed, tap, .. } => {
                let weights = drive.taps(delayed as usize);
                let of = |rows: &[[f64; TAPS]; 3]| [0, 1, 2].map(|stage| rows[stage][tap as usize]);
                (of(&weights.value), of(&weights.slope))
            }
            _ => (self.weights, [0.0; 3]),
        }
    }
}

/// The feed of some steps, one row of numbers for each.
#[inline(always)]
pub(super) fn gather(terms: &[Term], drive: &DriveTable, steps: Range<usize>, feed: &mut [f64]) {
    let (width, count) = (terms.len(), steps.len());
    let feed = &mut feed[..width * count];
    for (m, term) in terms.iter().enumerate() {
        let (table, stride, from) = match term.reading {
            Reading::Value(at) => (drive.all_stages(), 3 * drive.width(), at as usize),
            Reading::Sample(at) => (drive.all_samples(), drive.width(), at as usize),
            Reading::Slope(at) => (drive.all_stage_slopes(), 3 * drive.delays(), at as usize),
            Reading::One => (&[1.0][..], 0, 0),
            Reading::Tap { input, delayed, tap } => {
                let first = drive.taps(delayed as usize).first + i64::from(tap);
                let (begin, end) = (first + steps.start as i64, first + steps.end as i64);
                if begin < 0 || end as usize * drive.width() > drive.all_samples().len() {
                    for (row, sample) in feed.chunks_exact_mut(width).zip(begin..) {
                        row[m] = drive.nearest(sample, input as usize);
                    }
                    continue;
                }
                for (row, sample) in feed
                    .chunks_exact_mut(width)
                    .zip(drive.all_samples()[begin as usize * drive.width()..].chunks_exact(drive.width()))
                {
                    row[m] = sample[input as usize];
                }
                continue;
            }
        };
        place(table, (from + steps.start * stride, stride), feed, (m, width));
    }
}

/// The feed of the outputs at some samples, likewise.
#[inline(always)]
pub(super) fn gather_samples(terms: &[Term], drive: &DriveTable, samples: Range<usize>, feed: &mut [f64]) {
    let width = terms.len();
    for (m, term) in terms.iter().enumerate() {
        let (table, stride, at) = match term.reading {
            Reading::Value(at) | Reading::Sample(at) => (drive.all_samples(), drive.width(), at as usize),
            Reading::Slope(at) => (drive.all_sample_slopes(), drive.delays(), at as usize),
            Reading::One | Reading::Tap { .. } => (&[1.0][..], 0, 0),
        };
        place(table, (samples.start * stride + at, stride), &mut feed[..width * samples.len()], (m, width));
    }
}

/// Numbers of a table, `stride` apart, to column m of rows of `width`.
#[inline(always)]
fn place(table: &[f64], (mut from, stride): (usize, usize), feed: &mut [f64], (m, width): (usize, usize)) {
    for row in feed.chunks_exact_mut(width) {
        row[m] = table[from];
        from += stride;
    }
}

/// What enters a step: an input at its ends (held: at the beginning), a delayed one at three stages, with slopes where
/// the delay is estimated; then the constant.
pub(super) fn step_terms(layout: &Layout, part: &Part, (held, per): (&[bool], usize), table: &DriveTable) -> Vec<Term> {
    let (width, delays) = (layout.drive(), layout.delayed.len());
    let mut terms = Vec::new();
    for (drive, d) in part.drive.iter().enumerate() {
        let value = |stage: usize, weights: [f64; 3]| {
            let reading = Reading::Value((stage * width + d) as u32);
            Term { reading, drive, weights }
        };
        let end = |end: usize, weights: [f64; 3]| match per {
            1 => Term { reading: Reading::Sample((end * width + d) as u32), drive, weights },
            _ => value(2 * end, weights),
        };
        match d.checked_sub(layout.inputs) {
            None if held[*d] => terms.push(end(0, [1.0, 1.0, 1.0])),
            None => terms.extend([end(0, [1.0, 0.5, 0.0]), end(1, [0.0, 0.5, 1.0])]),
            Some(delayed) if table.has_taps() => {
                let Signal::Input(input) = layout.delayed[delayed] else { continue };
                let tap = |tap: u32| Reading::Tap { input, delayed: delayed as u32, tap };
                terms.extend([0, 1, 2].map(|k| Term { reading: tap(k), drive, weights: [0.0; 3] }));
            }
            Some(delayed) => {
                let unit = |stage: usize| [0, 1, 2].map(|s| f64::from(u8::from(s == stage)));
                terms.extend([0, 1, 2].map(|stage| value(stage, unit(stage))));
                if layout.patterns.tau_by_param.row(delayed).next().is_some() {
                    terms.extend([0, 1, 2].map(|stage| {
                        let reading = Reading::Slope((stage * delays + delayed) as u32);
                        Term { reading, drive, weights: unit(stage) }
                    }));
                }
            }
        }
    }
    terms.push(Term { reading: Reading::One, drive: part.drive.len(), weights: [1.0; 3] });
    terms
}

/// What enters outputs: the drive at the sample, slopes where delays are estimated, and the constant.
pub(super) fn output_terms(layout: &Layout, part: &Part) -> Vec<Term> {
    let (mut terms, weights) = (Vec::new(), [1.0, 0.0, 0.0]);
    for (drive, d) in part.output_drive.iter().enumerate() {
        terms.push(Term { reading: Reading::Value(*d as u32), drive, weights });
        if let Some(delayed) = d.checked_sub(layout.inputs)
            && layout.patterns.tau_by_param.row(delayed).next().is_some()
        {
            terms.push(Term { reading: Reading::Slope(delayed as u32), drive, weights });
        }
    }
    terms.push(Term { reading: Reading::One, drive: part.output_drive.len(), weights });
    terms
}
