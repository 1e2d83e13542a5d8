//! The values of the states and of linear outputs without sensitivities: the lanes hold the states of all subsystems together.
//!
//! Every lane adds the same terms in the same order as its subsystem's [`LinearMap`] does in the lane of the values, and further ones whose
//! coefficients are zero: a response has the same bits with and without its sensitivities.

use super::equations::Part;
use super::map::LinearMap;
use super::subsystem::Subsystem;
use super::subsystem::{Reading, Term, gather, gather_samples};
use super::transition::Intervals;
use crate::simulate::drive::DriveTable;
use fdm_numeric::lanes::{Aligned, Simd, VECTOR, WithSimd};
use std::collections::BTreeMap;
use std::ops::Range;

/// What all subsystems read beside constants, each number once, in the order in which every one of them adds it.
struct Readings {
    terms: Vec<Term>,
    /// For each subsystem where its terms stand among them.
    places: Vec<Vec<u32>>,
    /// Where each stands in a row of samples, if all do: nothing is gathered then.
    samples: Option<Vec<u32>>,
}

impl Readings {
    /// Of the terms of each subsystem, with the drives that these count.
    fn of<'s>(subsystems: impl Iterator<Item = (&'s [Term], &'s [usize])> + Clone) -> Self {
        // a drive is read in the same way by all subsystems
        let keys = |(terms, drives): (&'s [Term], &'s [usize])| {
            let first = |term: &Term| terms.iter().position(|other| other.drive == term.drive).unwrap_or(0);
            let read = terms.iter().enumerate().filter(|(_, term)| term.reading != Reading::One);
            read.map(|(m, term)| ((drives[term.drive], m - first(term)), *term)).collect::<Vec<_>>()
        };
        let mut all = BTreeMap::new();
        subsystems.clone().for_each(|subsystem| all.extend(keys(subsystem)));
        let sample = |term: &Term| if let Reading::Sample(at) = term.reading { Some(at) } else { None };
        let samples: Option<Vec<u32>> = all.values().map(sample).collect();
        let place =
            |(key, _): ((usize, usize), Term)| all.keys().position(|other| *other == key).map_or(0, |at| at as u32);
        let places = subsystems.map(|subsystem| keys(subsystem).into_iter().map(place).collect()).collect();
        Self { places, terms: all.into_values().collect(), samples }
    }

    /// The feed of some steps, in `room` where it must be gathered. Where nothing is read there are no rows: a model may have more steps
    /// than samples, and inputs that move none of its states.
    #[inline(always)]
    fn of_steps<'f>(&self, drive: &'f DriveTable, steps: Range<usize>, room: &'f mut [f64]) -> Feed<'f> {
        if self.terms.is_empty() {
            return Feed { numbers: &[], apart: 0, length: 0 };
        }
        if self.samples.is_some() {
            let width = drive.width();
            return Feed { numbers: &drive.all_samples()[steps.start * width..], apart: width, length: 2 * width };
        }
        gather(&self.terms, drive, steps, room);
        Feed { numbers: room, apart: self.terms.len(), length: self.terms.len() }
    }
}

/// What enters some steps: a row for each.
#[derive(Clone, Copy)]
struct Feed<'f> {
    numbers: &'f [f64],
    apart: usize,
    length: usize,
}

impl<'f> Feed<'f> {
    #[inline(always)]
    fn row(&self, k: usize) -> &'f [f64] {
        &self.numbers[k * self.apart..][..self.length]
    }
}

/// The map of all subsystems to the values of their states or outputs, which stand in lanes. Small subsystems share a vector.
#[derive(Default)]
struct Response {
    bundles: Vec<Bundle>,
    /// The terms of each vector by their places among the readings, rising, and where these stand in a row of the feed.
    places: Vec<u32>,
    reads: Vec<u32>,
    /// For each length of a step and each vector: coefficients of the feed, constants, coefficients of the states.
    columns: Vec<Aligned>,
}

/// One vector of values.
struct Bundle {
    /// Lanes of the states that enter, and whether they are those of the values themselves.
    states: Range<usize>,
    own: bool,
    terms: Range<usize>,
    /// Lanes in use.
    used: usize,
    /// Its first column.
    first: usize,
}

impl Response {
    /// Numbers of a row.
    fn width(&self) -> usize {
        self.bundles.len() * VECTOR
    }

    /// Takes up the values of a subsystem, `rows` lanes; gives the first of them. `states`: those that enter, none for its own values.
    fn take_up(&mut self, rows: usize, states: Option<Range<usize>>, places: &[u32]) -> usize {
        let (end, own) = (self.width(), states.is_none());
        let room = self.bundles.last().map_or(0, |last| VECTOR - last.used);
        let shared = self.bundles.last_mut().filter(|_| rows <= room);
        let (bundle, start) = match shared {
            Some(last) => {
                let start = end - room;
                last.used += rows;
                let entering = states.unwrap_or(start..start + rows);
                last.states = last.states.start.min(entering.start)..last.states.end.max(entering.end);
                (last, start)
            }
            None => {
                for first in (0..rows).step_by(VECTOR) {
                    let states = states.clone().unwrap_or(end..end + rows);
                    // nothing is put beside a subsystem that is larger than a vector
                    let used = if rows > VECTOR { VECTOR } else { rows - first };
                    let terms = self.places.len()..self.places.len() + places.len();
                    self.places.extend_from_slice(places);
                    self.bundles.push(Bundle { states, own, terms, used, first: 0 });
                }
                return end;
            }
        };
        let mut all: Vec<u32> = self.places[bundle.terms.clone()].iter().chain(places).copied().collect();
        all.sort_unstable();
        all.dedup();
        self.places.truncate(bundle.terms.start);
        self.places.extend(all);
        bundle.terms.end = self.places.len();
        start
    }

    /// Makes room for the coefficients, when all subsystems have been taken up.
    fn set_up(&mut self, kinds: usize, readings: &Readings) {
        let read = |place: &u32| readings.samples.as_ref().map_or(*place, |samples| samples[*place as usize]);
        self.reads = self.places.iter().map(read).collect();
        let mut first = 0;
        // few vectors of states in their own lanes have one number of them: the loops that are compiled for it need none over the states
        let own = |(b, bundle): (usize, &Bundle)| bundle.own && bundle.states.end <= (b + 1) * VECTOR;
        if self.bundles.len() <= 2 && self.bundles.iter().enumerate().all(own) {
            let most = self.bundles.iter().map(|bundle| bundle.states.len()).max().unwrap_or(0);
            let states = if self.bundles.len() == 1 { most.next_power_of_two() } else { VECTOR };
            for (b, bundle) in self.bundles.iter_mut().enumerate() {
                bundle.states = b * VECTOR..b * VECTOR + states;
            }
        }
        for bundle in &mut self.bundles {
            bundle.first = first;
            first += bundle.terms.len() + 1 + bundle.states.len();
        }
        self.columns = (0..kinds).map(|_| Aligned::new(first * VECTOR)).collect();
    }

    /// Takes over the values' coefficients of a subsystem from its map; its own lanes begin at `lane`, those of its states at `state`.
    fn fill(&mut self, kind: usize, map: &LinearMap, (lane, state): (usize, usize), places: &[u32]) {
        for row in 0..map.rows {
            let bundle = &self.bundles[(lane + row) / VECTOR];
            let own = (lane + row) % VECTOR;
            let known = &self.places[bundle.terms.clone()];
            let columns = &mut self.columns[kind][bundle.first * VECTOR..];
            for (m, place) in places.iter().enumerate() {
                let at = known.iter().position(|p| p == place).unwrap_or(0);
                columns[at * VECTOR + own] = map.value_of(m, row);
            }
            // constants that are none may be left out
            columns[known.len() * VECTOR + own] =
                if map.terms > places.len() { map.value_of(places.len(), row) } else { 0.0 };
            for j in 0..map.states {
                let at = known.len() + 1 + state + j - bundle.states.start;
                columns[at * VECTOR + own] = map.flow[j * map.rows + row];
            }
        }
    }

    /// One vector of the values and its coefficients.
    #[inline(always)]
    fn view(&self, kind: usize, bundle: usize) -> View<'_> {
        let Bundle { states, terms, first, .. } = &self.bundles[bundle];
        let columns = &self.columns[kind].as_chunks::<VECTOR>().0[*first..][..terms.len() + 1 + states.len()];
        let (by_feed, columns) = columns.split_at(terms.len());
        let (constant, by_state) = columns.split_at(1);
        View { reads: &self.reads[terms.clone()], by_feed, constant: &constant[0], first: states.start, by_state }
    }
}

/// One vector of values with its coefficients: those of the feed and where that stands, constants, those of the states from `first` on.
#[derive(Clone, Copy)]
struct View<'c> {
    reads: &'c [u32],
    by_feed: &'c [[f64; VECTOR]],
    constant: &'c [f64; VECTOR],
    first: usize,
    by_state: &'c [[f64; VECTOR]],
}

impl View<'_> {
    /// The values from those of the states and a row of the feed.
    #[inline(always)]
    fn apply<S: Simd>(&self, simd: S, x: &[f64], feed: &[f64], out: &mut [f64; VECTOR]) {
        let x = &x[self.first..][..self.by_state.len()];
        for (v, out) in S::as_mut_simd_f64s(out).0.iter_mut().enumerate() {
            let mut sum = self.begin(simd, v, feed);
            for (x, column) in x.iter().zip(self.by_state) {
                sum = plus(simd, v, sum, *x, column);
            }
            *out = sum;
        }
    }

    /// What the feed gives to vector v of the registers that make up the lanes.
    #[inline(always)]
    fn begin<S: Simd>(&self, simd: S, v: usize, feed: &[f64]) -> S::f64s {
        let mut sum = simd.splat_f64s(0.0);
        for (at, column) in self.reads.iter().zip(self.by_feed) {
            sum = plus(simd, v, sum, feed[*at as usize], column);
        }
        simd.add_f64s(sum, S::as_simd_f64s(self.constant).0[v])
    }
}

/// `sum + x column`.
#[inline(always)]
fn plus<S: Simd>(simd: S, v: usize, sum: S::f64s, x: f64, column: &[f64; VECTOR]) -> S::f64s {
    simd.mul_add_f64s(simd.splat_f64s(x), S::as_simd_f64s(column).0[v], sum)
}

/// The values of all states, their maps, and what drives them.
pub(super) struct Values {
    steps: Readings,
    samples: Readings,
    response: Response,
    outputs: Response,
    /// First lane of the states and of the other outputs of each subsystem.
    lanes: Vec<(usize, usize)>,
    /// Outputs that are states by the lane of the state; others have lane 0.
    shown: Vec<u32>,
    /// Outputs that are not: each with its lane among them.
    others: Vec<(u32, u32)>,
    feed: Vec<f64>,
    /// Before the first of some steps, and after each.
    slots: Aligned,
    /// The slot of the present.
    present: usize,
    /// Values of other outputs at a sample.
    observed: Aligned,
}

impl Values {
    /// Of so many outputs; `kinds` is the number of lengths of steps, `block` the most steps that are asked for at once.
    pub(super) fn new(subsystems: &[Subsystem], outputs: usize, kinds: usize, block: usize) -> Self {
        let of = |terms: fn(&Subsystem) -> &[Term], drives: fn(&Part) -> &[usize]| {
            Readings::of(subsystems.iter().map(move |s| (terms(s), drives(&s.part))))
        };
        let (steps, samples) =
            (of(Subsystem::terms, |part| &part.drive), of(Subsystem::output_terms, |part| &part.output_drive));
        let mut values = Self {
            feed: vec![0.0; (block + 1) * steps.terms.len().max(samples.terms.len())],
            steps,
            samples,
            response: Response::default(),
            outputs: Response::default(),
            lanes: Vec::new(),
            shown: vec![0; outputs],
            others: Vec::new(),
            slots: Aligned::default(),
            present: 0,
            observed: Aligned::default(),
        };
        for (k, Subsystem { part, .. }) in subsystems.iter().enumerate() {
            let lane = values.response.take_up(part.states.len(), None, &values.steps.places[k]);
            let states = Some(lane..lane + part.states.len());
            let output = values.outputs.take_up(part.outputs.len(), states, &values.samples.places[k]);
            part.shown.iter().for_each(|(output, state)| values.shown[*output] = (lane + state) as u32);
            values.others.extend(part.outputs.iter().zip(output..).map(|(o, lane)| (*o as u32, lane as u32)));
            values.lanes.push((lane, output));
        }
        values.response.set_up(kinds, &values.steps);
        values.outputs.set_up(1, &values.samples);
        values.slots = Aligned::new((block + 1) * values.response.width());
        values.observed = Aligned::new(values.outputs.width());
        values
    }

    /// Begins a run: takes over coefficients and states of all subsystems.
    pub(super) fn begin(&mut self, subsystems: &[Subsystem]) {
        self.present = 0;
        self.slots.fill(0.0);
        for (k, (subsystem, (lane, output))) in subsystems.iter().zip(&self.lanes).enumerate() {
            for (kind, map) in subsystem.steps.iter().enumerate() {
                self.response.fill(kind, map, (*lane, *lane), &self.steps.places[k]);
            }
            self.outputs.fill(0, &subsystem.observe, (*output, *lane), &self.samples.places[k]);
            for i in 0..subsystem.part.states.len() {
                self.slots[lane + i] = subsystem.value(i);
            }
        }
    }

    /// The present ones.
    pub(super) fn states(&self) -> &[f64] {
        &self.slots[self.present * self.response.width()..][..self.response.width()]
    }

    /// Those of one of the subsystems.
    pub(super) fn of_subsystem(&self, k: usize) -> &[f64] {
        &self.states()[self.lanes[k].0..]
    }

    /// Goes back to values from before.
    pub(super) fn restore(&mut self, states: &[f64]) {
        self.present = 0;
        self.slots[..states.len()].copy_from_slice(states);
    }

    /// Advances by some steps, at most a block: the values before them are in slot 0, those after step k in slot k + 1. Outputs that are
    /// states are shown in rows of `y`, one for each step, unless it is empty.
    #[inline(always)]
    pub(super) fn advance<S: Simd>(
        &mut self,
        simd: S,
        drive: &DriveTable,
        (intervals, steps): (&Intervals, Range<usize>),
        y: &mut [f64],
    ) {
        simd.vectorize(Steps { values: self, drive, intervals, steps, y });
    }

    /// Outputs that are states at the present.
    pub(super) fn show(&self, y: &mut [f64]) {
        show(&self.shown, self.states(), y);
    }

    /// Outputs that are not states, of samples (rows of `y`) whose states stand in the slots from `slot` on, or at the present.
    #[inline(always)]
    pub(super) fn observe<S: Simd>(
        &mut self,
        simd: S,
        drive: &DriveTable,
        samples: Range<usize>,
        slot: Option<usize>,
        y: &mut [f64],
    ) {
        if !self.others.is_empty() {
            let slot = slot.unwrap_or(self.present);
            simd.vectorize(Outputs { values: self, drive, samples, slot, y });
        }
    }
}

/// Outputs that are states.
#[inline(always)]
fn show(shown: &[u32], states: &[f64], y: &mut [f64]) {
    y.iter_mut().zip(shown).for_each(|(y, lane)| *y = states[*lane as usize]);
}

struct Steps<'m> {
    values: &'m mut Values,
    drive: &'m DriveTable,
    intervals: &'m Intervals,
    steps: Range<usize>,
    y: &'m mut [f64],
}

impl WithSimd for Steps<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Values { steps: readings, response, shown, feed, slots, present, .. } = self.values;
        let (width, outputs) = (response.width(), if self.y.is_empty() { 0 } else { shown.len() });
        slots.copy_within(*present * width..(*present + 1) * width, 0);
        *present = self.steps.len();
        let (response, feed) = (&*response, readings.of_steps(self.drive, self.steps.clone(), feed));
        let states = response.bundles.iter().map(|bundle| bundle.states.len()).max().unwrap_or(0);
        let (mut from, first) = (self.steps.start, self.steps.start);
        while from < self.steps.end {
            let (kind, to) = self.intervals.alike(from, self.steps.end);
            let at = from - first;
            let slots = &mut slots[at * width..][..(to - from + 1) * width];
            let y = &mut self.y[at * outputs..][..(to - from) * outputs];
            let moves =
                Moves { response, kind, feed: Feed { numbers: &feed.numbers[at * feed.apart..], ..feed }, shown };
            match (response.bundles.len(), states) {
                (1, 1) => moves.march::<S, 1, 1>(simd, slots, y),
                (1, 2) => moves.march::<S, 1, 2>(simd, slots, y),
                (1, 4) => moves.march::<S, 1, 4>(simd, slots, y),
                (1, 8) => moves.march::<S, 1, 8>(simd, slots, y),
                (2, 8) => moves.march::<S, 2, 8>(simd, slots, y),
                _ => moves.march_of_any(simd, slots, y),
            }
            from = to;
        }
    }
}

/// Some steps of one length.
struct Moves<'m> {
    response: &'m Response,
    kind: usize,
    feed: Feed<'m>,
    shown: &'m [u32],
}

impl Moves<'_> {
    /// B vectors, which pass through the processor together, each of N states in its own lanes. Where their coefficients stand is found
    /// before, and the values stay in registers: those that go through memory from step to step come late.
    #[inline(always)]
    fn march<S: Simd, const B: usize, const N: usize>(&self, simd: S, slots: &mut [f64], y: &mut [f64]) {
        let Self { response, kind, feed, shown } = self;
        let mut views = [response.view(*kind, 0); B];
        views.iter_mut().enumerate().for_each(|(bundle, view)| *view = response.view(*kind, bundle));
        let slots = slots.as_chunks_mut::<VECTOR>().0.as_chunks_mut::<B>().0;
        let Some((first, slots)) = slots.split_first_mut() else { return };
        let (mut x, mut y) = (*first, y.chunks_exact_mut(shown.len().max(1)));
        for (k, slot) in slots.iter_mut().enumerate() {
            let feed = feed.row(k);
            for b in 0..B {
                let Some(by_state) = views[b].by_state.first_chunk::<N>() else { return };
                let before = x[b];
                for (v, out) in S::as_mut_simd_f64s(&mut x[b]).0.iter_mut().enumerate() {
                    let mut sum = views[b].begin(simd, v, feed);
                    for j in 0..N {
                        sum = plus(simd, v, sum, before[j], &by_state[j]);
                    }
                    *out = sum;
                }
            }
            *slot = x;
            if let Some(y) = y.next() {
                show(shown, slot.as_flattened(), y);
            }
        }
    }

    #[inline(always)]
    fn march_of_any<S: Simd>(&self, simd: S, slots: &mut [f64], y: &mut [f64]) {
        let (width, mut y) = (self.response.width(), y.chunks_exact_mut(self.shown.len().max(1)));
        for k in 0..slots.len() / width - 1 {
            let (before, after) = slots[k * width..(k + 2) * width].split_at_mut(width);
            for (bundle, out) in after.as_chunks_mut().0.iter_mut().enumerate() {
                self.response.view(self.kind, bundle).apply(simd, before, self.feed.row(k), out);
            }
            if let Some(y) = y.next() {
                show(self.shown, after, y);
            }
        }
    }
}

struct Outputs<'m> {
    values: &'m mut Values,
    drive: &'m DriveTable,
    samples: Range<usize>,
    slot: usize,
    y: &'m mut [f64],
}

impl WithSimd for Outputs<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Values { samples: readings, response, outputs, shown, others, feed, slots, observed, .. } = self.values;
        let (width, across) = (response.width(), readings.terms.len());
        gather_samples(&readings.terms, self.drive, self.samples, feed);
        let rows = self.y.chunks_exact_mut(shown.len()).zip(slots[self.slot * width..].chunks_exact(width));
        for (k, (y, x)) in rows.enumerate() {
            let feed = &feed[k * across..][..across];
            for (bundle, out) in observed.as_chunks_mut().0.iter_mut().enumerate() {
                outputs.view(0, bundle).apply(simd, x, feed, out);
            }
            others.iter().for_each(|(output, lane)| y[*output as usize] = observed[*lane as usize]);
        }
    }
}
