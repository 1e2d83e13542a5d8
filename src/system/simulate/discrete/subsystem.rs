//! One subsystem: its coefficients for every length of a step, and its states.

use super::equations::{Equations, Group, Part};
use super::feed::{Reading, Term, gather, gather_samples, output_terms, step_terms};
use super::map::{LinearMap, Response};
use super::transition::{Intervals, Jet, Method, Transition};
use crate::dynamics::Layout;
use crate::simulate::drive::DriveTable;
use fdm_numeric::lanes::{Aligned, Simd, VECTOR, WithSimd};
use std::ops::Range;

/// Steps that are worked off together: as many as leave room in the cache nearest to the processor.
pub(super) fn steps_of_a_block(numbers_per_step: usize) -> usize {
    (8192 / numbers_per_step.max(1)).clamp(16, 64)
}

/// A subsystem at work.
pub(super) struct Subsystem {
    pub(super) part: Part,
    /// For each lane of a parameter its position among the columns, and the parameter.
    pub(super) columns: Vec<(u32, usize)>,
    /// Lanes of a row, and the lane of the states themselves.
    pub(super) width: usize,
    pub(super) lane: usize,
    terms: Vec<Term>,
    output_terms: Vec<Term>,
    /// For each length of a step.
    steps: Vec<LinearMap>,
    observe: LinearMap,
    transition: Transition,
    a: Jet,
    /// Coefficients of the drives and the constant; of the states too for outputs.
    b: Jet,
    scaled: Jet,
    by_weight: [Jet; 3],
    /// Whether there are no constants: the last number of the feed is then not read.
    homogeneous: bool,
    /// Without parameters: the states stand in lanes themselves.
    response: Option<Response>,
    /// And so do the outputs that are not states.
    observed: Response,
    /// From one state of a slot to the next, and from slot to slot.
    apart: usize,
    size: usize,
    /// States with their sensitivities, rows of lanes: before the first of some steps, and after each.
    slots: Aligned,
    /// Which of the slots holds the present.
    present: usize,
    feed: Vec<f64>,
}

impl Subsystem {
    /// `held` tells of every input whether it is held between samples; `kinds` is the number of lengths, `per` that of steps
    /// between samples, `block` the most that are asked for at once.
    pub(super) fn new(
        layout: &Layout,
        part: Part,
        columns: &[usize],
        held: &[bool],
        (kinds, per, block): (usize, usize, usize),
        drive: &DriveTable,
    ) -> Self {
        let alone = columns.is_empty();
        let own = columns.iter().enumerate().filter(|(_, k)| part.params.contains(k));
        let columns: Vec<(u32, usize)> = own.map(|(c, k)| (c as u32, *k)).collect();
        let (n, rows, lane) = (part.states.len(), part.outputs.len(), columns.len());
        let (width, drives) = ((lane + 1).next_multiple_of(VECTOR), part.drive.len() + 1);
        let terms = step_terms(layout, &part, (held, per), drive);
        let output_terms = output_terms(layout, &part);
        let map = |rows: usize, terms: usize| LinearMap::new(rows, n, terms, (width, lane));
        let zero = || Jet::zero(n, drives, width);
        let response = alone.then(|| Response::new(n, n, terms.len(), kinds));
        let (apart, size) = response.as_ref().map_or((width, n * width), |r| (1, r.width));
        Self {
            steps: (0..kinds).map(|_| map(n, terms.len())).collect(),
            observe: map(rows, output_terms.len()),
            transition: Transition::new(n, width),
            a: Jet::zero(n, n, width),
            b: zero(),
            scaled: zero(),
            by_weight: [zero(), zero(), zero()],
            homogeneous: false,
            observed: Response::new(rows, n, output_terms.len(), 1),
            response,
            apart,
            size,
            slots: Aligned::new((block + 1) * size),
            present: 0,
            feed: vec![0.0; (block + 1) * terms.len().max(output_terms.len())],
            part,
            columns,
            width,
            lane,
            terms,
            output_terms,
        }
    }

    /// The states with their sensitivities, rows of lanes.
    #[inline(always)]
    pub(super) fn states(&self) -> &[f64] {
        self.slot(self.present)
    }

    /// Which slot that is.
    pub(super) fn present(&self) -> usize {
        self.present
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

    /// The value of one of the states in a slot.
    #[inline(always)]
    pub(super) fn value(&self, slot: usize, state: usize) -> f64 {
        self.slots[slot * self.size + state * self.apart + self.lane]
    }

    /// All slots from one on.
    #[inline(always)]
    pub(super) fn slots_from(&self, slot: usize) -> &[f64] {
        &self.slots[slot * self.size..]
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
            if let Some(response) = &mut self.response {
                response.fill(kind, &mut self.steps[kind]);
            }
        }
        self.fill_observe(layout, equations, known);
        if self.response.is_some() {
            self.observed.fill(0, &mut self.observe);
        }
        self.present = 0;
        self.slots.fill(0.0);
        for (i, state) in self.part.states.iter().enumerate() {
            self.slots[i * self.apart + self.lane] = known[layout.initial.start + state];
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

    /// Advances by some steps, at most a block: the states before them are in slot 0, those after step k in slot k + 1.
    #[inline(always)]
    pub(super) fn advance<S: Simd>(&mut self, simd: S, drive: &DriveTable, intervals: &Intervals, steps: Range<usize>) {
        simd.vectorize(Advance { subsystem: self, drive, intervals, steps });
    }

    #[inline(always)]
    fn take_steps<S: Simd>(&mut self, simd: S, drive: &DriveTable, intervals: &Intervals, steps: Range<usize>) {
        let size = self.size;
        self.slots.copy_within(self.present * size..(self.present + 1) * size, 0);
        let (mut from, end) = (steps.start, steps.end);
        while from < end {
            let (kind, to) = intervals.alike(from, end);
            let (map, count) = (&self.steps[kind], to - from);
            gather(&self.terms[..map.terms], drive, from..to, &mut self.feed);
            let slots = &mut self.slots[(from - steps.start) * size..];
            match &self.response {
                Some(response) => {
                    response.begin(simd, kind, &mut slots[size..], (&self.feed, map.terms), count);
                    for k in 0..count {
                        response.step(simd, kind, &mut slots[k * size..(k + 2) * size], map.terms);
                    }
                }
                None => map.march(simd, slots, &self.feed, count),
            }
            from = to;
        }
        self.present = end - steps.start;
    }

    /// Reads what drives some steps of the response alone, at most a block, and begins their sums; the states before them go to slot 0.
    #[inline(always)]
    pub(super) fn begin<S: Simd>(&mut self, simd: S, drive: &DriveTable, intervals: &Intervals, steps: Range<usize>) {
        let Self { size, terms, slots, feed, .. } = self;
        let size = *size;
        slots.copy_within(self.present * size..(self.present + 1) * size, 0);
        self.present = steps.len();
        let Some(response) = &self.response else { return };
        let (mut from, end) = (steps.start, steps.end);
        while from < end {
            let (kind, to) = intervals.alike(from, end);
            let count = self.steps[kind].terms;
            gather(&terms[..count], drive, from..to, feed);
            response.begin(simd, kind, &mut slots[(from - steps.start + 1) * size..], (feed, count), to - from);
            from = to;
        }
    }

    /// One of these steps.
    #[inline(always)]
    pub(super) fn respond<S: Simd>(&mut self, simd: S, kind: usize, k: usize) {
        if let Some(response) = &self.response {
            let (terms, size) = (self.steps[kind].terms, self.size);
            response.step(simd, kind, &mut self.slots[k * size..(k + 2) * size], terms);
        }
    }

    /// Outputs that are not states, one row each, at some samples (at most one more than a block has) whose states stand in the
    /// slots from `slot` on.
    #[inline(always)]
    pub(super) fn observe<S: Simd>(
        &mut self,
        simd: S,
        drive: &DriveTable,
        (samples, slot): (Range<usize>, usize),
        out: &mut [f64],
    ) {
        simd.vectorize(Observe { subsystem: self, drive, samples, slot, out });
    }

    #[inline(always)]
    fn take_outputs<S: Simd>(
        &mut self,
        simd: S,
        drive: &DriveTable,
        (samples, slot): (Range<usize>, usize),
        out: &mut [f64],
    ) {
        let (terms, count) = (self.output_terms.len(), samples.len());
        gather_samples(&self.output_terms, drive, samples, &mut self.feed);
        let Self { observe, observed, slots, size, .. } = &*self;
        let slots = &slots[slot * size..];
        match &self.response {
            None => observe.sweep(simd, slots, &self.feed, out, count),
            Some(_) => {
                observed.begin(simd, 0, out, (&self.feed, terms), count);
                observed.observe(simd, (slots, *size), terms, out, count);
            }
        }
    }

    /// Numbers of the outputs of a sample that are not states, without sensitivities: a lane for each.
    #[inline(always)]
    pub(super) fn output_lanes(&self) -> usize {
        self.observed.width
    }
}

/// Some steps: one function for each set of instructions, however many call it, for it holds the kernels of all sizes.
struct Advance<'m> {
    subsystem: &'m mut Subsystem,
    drive: &'m DriveTable,
    intervals: &'m Intervals,
    steps: Range<usize>,
}

impl WithSimd for Advance<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.subsystem.take_steps(simd, self.drive, self.intervals, self.steps);
    }
}

/// Outputs of some samples, likewise.
struct Observe<'m> {
    subsystem: &'m mut Subsystem,
    drive: &'m DriveTable,
    samples: Range<usize>,
    slot: usize,
    out: &'m mut [f64],
}

impl WithSimd for Observe<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.subsystem.take_outputs(simd, self.drive, (self.samples, self.slot), self.out);
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
