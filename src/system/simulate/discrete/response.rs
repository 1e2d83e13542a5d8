//! The values of the states and of linear outputs, without their sensitivities: the lanes hold the states of all subsystems together.
//!
//! It is the same loop with and without sensitivities, and so are its bits.

use super::feed::{Feed, Readings};
use super::transition::Intervals;
use fdm_numeric::lanes::{Aligned, Simd, VECTOR, WithSimd, dispatch};
use std::ops::Range;

/// Sums that the states' terms are divided among: a step waits for the one before, and the shorter the chains of sums, the less long.
const PARTS: usize = 4;

/// The map of all subsystems to the values of their states or outputs, which stand in lanes.
///
/// Small subsystems share a vector: there the states of one meet coefficients of zero in the lanes of the others. That is no matter as long
/// as all are finite, and when one is not the run ends.
#[derive(Default)]
pub(super) struct Response {
    bundles: Vec<Bundle>,
    /// Where the terms of each vector stand in a row of the feed.
    places: Vec<u32>,
    /// Lanes, whole vectors.
    pub(super) width: usize,
    /// For each length of a step and each vector: constants, coefficients of the feed, coefficients of the states.
    columns: Vec<Aligned>,
}

/// One vector of values.
struct Bundle {
    /// States that enter, by fours: others among them have coefficients of zero.
    states: Range<usize>,
    terms: Range<usize>,
    /// Lanes in use.
    used: usize,
    /// Its constants among the vectors of the columns.
    first: usize,
}

impl Bundle {
    /// Vectors of its columns.
    fn columns(&self) -> usize {
        1 + self.terms.len() + self.states.len()
    }
}

impl Response {
    /// Takes up the values of a subsystem, `rows` lanes; gives the first of them. `states`: those that enter, none for its own values.
    pub(super) fn take_up(&mut self, rows: usize, states: Option<Range<usize>>, places: &[u32]) -> usize {
        let room = self.bundles.last().map_or(0, |last| VECTOR - last.used);
        if states.is_none() && rows <= room {
            if let Some(last) = self.bundles.last_mut() {
                let start = self.width - VECTOR + last.used;
                last.used += rows;
                let known = &self.places[last.terms.clone()];
                let others: Vec<u32> = places.iter().filter(|place| !known.contains(place)).copied().collect();
                self.places.extend(others);
                last.terms.end = self.places.len();
                return start;
            }
        }
        let start = self.width;
        for first in (0..rows).step_by(VECTOR) {
            // those of a vector for itself are all its lanes
            let own = if rows > VECTOR { rows } else { VECTOR };
            let states = states.clone().unwrap_or(start..start + own);
            let states = states.start / PARTS * PARTS..states.end.next_multiple_of(PARTS);
            let terms = self.places.len()..self.places.len() + places.len();
            self.places.extend_from_slice(places);
            // nothing is put beside a subsystem that is larger than a vector
            let used = if rows > VECTOR { VECTOR } else { rows - first };
            self.bundles.push(Bundle { states, terms, used, first: 0 });
            self.width += VECTOR;
        }
        start
    }

    /// Makes room for the coefficients, when all subsystems have been taken up.
    pub(super) fn set_up(&mut self, kinds: usize) {
        let mut first = 0;
        for bundle in &mut self.bundles {
            bundle.first = first;
            first += bundle.columns();
        }
        self.columns = (0..kinds).map(|_| Aligned::new(first * VECTOR)).collect();
    }

    /// The constant of a lane.
    pub(super) fn constant(&mut self, kind: usize, lane: usize) -> &mut f64 {
        let first = self.bundles[lane / VECTOR].first;
        &mut self.columns[kind][first * VECTOR + lane % VECTOR]
    }

    /// The coefficient in a lane of what stands at a place in the feed.
    pub(super) fn by_feed(&mut self, kind: usize, lane: usize, place: u32) -> &mut f64 {
        let bundle = &self.bundles[lane / VECTOR];
        let m = self.places[bundle.terms.clone()].iter().position(|p| *p == place).unwrap_or(0);
        &mut self.columns[kind][(bundle.first + 1 + m) * VECTOR + lane % VECTOR]
    }

    /// The coefficient in a lane of a state.
    pub(super) fn by_state(&mut self, kind: usize, lane: usize, state: usize) -> &mut f64 {
        let bundle = &self.bundles[lane / VECTOR];
        let column = bundle.first + 1 + bundle.terms.len() + state - bundle.states.start;
        &mut self.columns[kind][column * VECTOR + lane % VECTOR]
    }

    /// One vector of the values and its coefficients.
    #[inline(always)]
    fn view(&self, kind: usize, bundle: usize) -> View<'_> {
        let bundle = &self.bundles[bundle];
        let columns = &self.columns[kind].as_chunks::<VECTOR>().0[bundle.first..][..bundle.columns()];
        let (constant, columns) = columns.split_at(1);
        let (by_feed, by_state) = columns.split_at(bundle.terms.len());
        let places = &self.places[bundle.terms.clone()];
        View { constant: &constant[0], places, by_feed, first: bundle.states.start, by_state: by_state.as_chunks().0 }
    }

    /// The values from those of the states and a row of the feed.
    #[inline(always)]
    fn apply<S: Simd>(&self, simd: S, kind: usize, x: &[f64], feed: &[f64], out: &mut [f64]) {
        for (bundle, out) in out.as_chunks_mut::<VECTOR>().0.iter_mut().enumerate() {
            let view = self.view(kind, bundle);
            let x = x[view.first..][..PARTS * view.by_state.len()].as_chunks().0;
            for (v, out) in S::as_mut_simd_f64s(out).0.iter_mut().enumerate() {
                *out = view.sum(simd, v, x, feed);
            }
        }
    }
}

/// One vector of values with its coefficients: the constants, those of the feed and where that stands, those of the states from `first`
/// on.
#[derive(Clone, Copy)]
struct View<'c> {
    constant: &'c [f64; VECTOR],
    places: &'c [u32],
    by_feed: &'c [[f64; VECTOR]],
    first: usize,
    by_state: &'c [[[f64; VECTOR]; PARTS]],
}

impl View<'_> {
    /// Vector v of the registers that make up the lanes.
    #[inline(always)]
    fn sum<S: Simd>(&self, simd: S, v: usize, x: &[[f64; PARTS]], feed: &[f64]) -> S::f64s {
        let zero = simd.splat_f64s(0.0);
        let (mut a, mut b, mut c, mut d) = (S::as_simd_f64s(self.constant).0[v], zero, zero, zero);
        let ((fours, rest), (by_four, by_rest)) = (self.places.as_chunks::<PARTS>(), self.by_feed.as_chunks::<PARTS>());
        for (places, columns) in fours.iter().zip(by_four) {
            let x = places.map(|place| feed[place as usize]);
            (a, b) = (plus(simd, v, a, x[0], &columns[0]), plus(simd, v, b, x[1], &columns[1]));
            (c, d) = (plus(simd, v, c, x[2], &columns[2]), plus(simd, v, d, x[3], &columns[3]));
        }
        for (place, column) in rest.iter().zip(by_rest) {
            a = plus(simd, v, a, feed[*place as usize], column);
        }
        for (x, columns) in x.iter().zip(self.by_state) {
            (a, b) = (plus(simd, v, a, x[0], &columns[0]), plus(simd, v, b, x[1], &columns[1]));
            (c, d) = (plus(simd, v, c, x[2], &columns[2]), plus(simd, v, d, x[3], &columns[3]));
        }
        simd.add_f64s(simd.add_f64s(a, b), simd.add_f64s(c, d))
    }
}

/// `sum + x column`.
#[inline(always)]
fn plus<S: Simd>(simd: S, v: usize, sum: S::f64s, x: f64, column: &[f64; VECTOR]) -> S::f64s {
    simd.mul_add_f64s(simd.splat_f64s(x), S::as_simd_f64s(column).0[v], sum)
}

/// The values of all states, their maps, and what drives them.
pub(super) struct Values {
    /// What is read in a step, and at a sample.
    pub(super) steps: Readings,
    pub(super) samples: Readings,
    pub(super) response: Response,
    pub(super) outputs: Response,
    /// Outputs that are states by the lane of the state; others have lane 0.
    shown: Vec<u32>,
    /// Outputs that are not, by their lane among them.
    others: Vec<(u32, u32)>,
    /// Before the first of some steps, and after each.
    pub(super) slots: Aligned,
    /// The slot of the present.
    present: usize,
    /// Values of other outputs at a sample.
    observed: Aligned,
}

impl Values {
    pub(super) fn new(steps: Readings, samples: Readings) -> Self {
        Self {
            steps,
            samples,
            response: Response::default(),
            outputs: Response::default(),
            shown: Vec::new(),
            others: Vec::new(),
            slots: Aligned::default(),
            present: 0,
            observed: Aligned::default(),
        }
    }

    /// Makes room when all subsystems have taken their places: for so many lengths of steps, for a block of steps, for outputs that are
    /// states (by their lane) and others.
    pub(super) fn set_up(&mut self, kinds: usize, block: usize, shown: Vec<u32>, others: Vec<(u32, u32)>) {
        self.response.set_up(kinds);
        self.outputs.set_up(1);
        self.slots = Aligned::new((block + 1) * self.response.width);
        self.observed = Aligned::new(self.outputs.width);
        (self.shown, self.others) = (shown, others);
    }

    /// Begins a run.
    pub(super) fn begin(&mut self) {
        self.present = 0;
        self.slots.fill(0.0);
    }

    /// The present ones.
    #[inline(always)]
    pub(super) fn states(&self) -> &[f64] {
        &self.slots[self.present * self.response.width..][..self.response.width]
    }

    /// Which slot holds them.
    pub(super) fn present(&self) -> usize {
        self.present
    }

    /// Values from a slot and a lane on, and how far it is from slot to slot.
    #[inline(always)]
    pub(super) fn from(&self, slot: usize, lane: usize) -> (&[f64], usize) {
        (&self.slots[slot * self.response.width + lane..], self.response.width)
    }

    /// Goes back to values from before.
    pub(super) fn restore(&mut self, states: &[f64]) {
        self.present = 0;
        self.slots[..states.len()].copy_from_slice(states);
    }

    /// Advances by some steps, at most a block: the values before them are in slot 0, those after step k in slot k + 1. Outputs that are
    /// states are shown in rows of `y`, one for each step, unless it is empty.
    pub(super) fn advance(&mut self, feed: Feed<'_>, (intervals, steps): (&Intervals, Range<usize>), y: &mut [f64]) {
        let width = self.response.width;
        self.slots.copy_within(self.present * width..(self.present + 1) * width, 0);
        self.present = steps.len();
        dispatch(Steps { values: self, feed, intervals, steps, y });
    }

    /// Outputs that are states at the present.
    pub(super) fn show(&self, y: &mut [f64]) {
        show(&self.shown, self.states(), y);
    }

    /// Outputs that are not states, at samples whose states' values stand from `slot` on.
    pub(super) fn observe(&mut self, feed: Feed<'_>, slot: usize, y: &mut [f64]) {
        if !self.others.is_empty() {
            dispatch(Outputs { values: self, feed, slot, y });
        }
    }
}

/// Outputs that are states.
#[inline(always)]
fn show(shown: &[u32], states: &[f64], y: &mut [f64]) {
    let ((fours, rest), (lanes_of_fours, lanes)) = (y.as_chunks_mut::<PARTS>(), shown.as_chunks::<PARTS>());
    for (y, lanes) in fours.iter_mut().zip(lanes_of_fours) {
        *y = lanes.map(|lane| states[lane as usize]);
    }
    rest.iter_mut().zip(lanes).for_each(|(y, lane)| *y = states[*lane as usize]);
}

struct Steps<'m> {
    values: &'m mut Values,
    feed: Feed<'m>,
    intervals: &'m Intervals,
    steps: Range<usize>,
    y: &'m mut [f64],
}

impl WithSimd for Steps<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let bundles = &self.values.response.bundles;
        let alone = bundles.iter().enumerate().all(|(b, bundle)| bundle.states == (b * VECTOR..(b + 1) * VECTOR));
        match bundles.len() {
            1 if alone => self.few::<S, 1>(simd),
            2 if alone => self.few::<S, 2>(simd),
            _ => self.many(simd),
        }
    }
}

impl Steps<'_> {
    /// B vectors of values, each of its own lanes alone: the chains of both pass through the processor together, and what they need is
    /// found before.
    #[inline(always)]
    fn few<S: Simd, const B: usize>(self, simd: S) {
        let Values { response, shown, slots, .. } = self.values;
        let (outputs, slots) = (shown.len(), slots.as_chunks_mut::<VECTOR>().0.as_chunks_mut::<B>().0);
        let (mut from, first) = (self.steps.start, self.steps.start);
        while from < self.steps.end {
            let (kind, to) = self.intervals.alike(from, self.steps.end);
            let mut views = [response.view(kind, 0); B];
            views.iter_mut().enumerate().for_each(|(bundle, view)| *view = response.view(kind, bundle));
            // values that go through memory from step to step come late
            let mut x = slots[from - first];
            for k in from - first..to - first {
                let (before, feed) = (x, self.feed.row(k));
                for b in 0..B {
                    // columns of known number need no loop
                    let Some(by_state) = views[b].by_state.first_chunk::<{ VECTOR / PARTS }>() else { return };
                    let view = View { by_state, ..views[b] };
                    for (v, out) in S::as_mut_simd_f64s(&mut x[b]).0.iter_mut().enumerate() {
                        *out = view.sum(simd, v, before[b].as_chunks().0, feed);
                    }
                }
                slots[k + 1] = x;
                if !self.y.is_empty() {
                    show(shown, slots[k + 1].as_flattened(), &mut self.y[k * outputs..][..outputs]);
                }
            }
            from = to;
        }
    }

    #[inline(always)]
    fn many<S: Simd>(self, simd: S) {
        let Values { response, shown, slots, .. } = self.values;
        let (width, outputs) = (response.width, shown.len());
        for (k, step) in self.steps.enumerate() {
            let (before, after) = slots[k * width..][..2 * width].split_at_mut(width);
            response.apply(simd, self.intervals.of_step(step), before, self.feed.row(k), after);
            if !self.y.is_empty() {
                show(shown, after, &mut self.y[k * outputs..][..outputs]);
            }
        }
    }
}

struct Outputs<'m> {
    values: &'m mut Values,
    feed: Feed<'m>,
    slot: usize,
    y: &'m mut [f64],
}

impl WithSimd for Outputs<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Values { response, outputs, shown, others, slots, observed, .. } = self.values;
        let samples = self.y.chunks_exact_mut(shown.len().max(1)).enumerate();
        for (k, y) in samples {
            let x = &slots[(self.slot + k) * response.width..][..response.width];
            outputs.apply(simd, 0, x, self.feed.row(k), observed);
            others.iter().for_each(|(output, lane)| y[*output as usize] = observed[*lane as usize]);
        }
    }
}
