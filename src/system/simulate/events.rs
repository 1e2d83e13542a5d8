//! Events (`when x > limit { v = -0.5*v; }`) in the middle of explicit steps.
//!
//! Steps stay frozen. Where a guard passes zero within a step of length h, parts of it of length sigma are taken until the guard is
//! zero there; the states get their new values, and another part of length h - sigma ends where the step did. So the grid does
//! not depend on parameters, and the response is continuous in them as long as no event passes a sample.
//!
//! Crossings are looked for at the end of a step, and before on its cubic interpolant (Hairer, Norsett & Wanner, Solving
//! ordinary differential equations I, II.6); the instant itself is a root of real steps, not of the interpolant.
//! An event is armed while its guard is not above zero, and happens only when it is.

use super::cuts::Turn;
use super::cuts::take_back;
use super::error::{EventFault, MOST_EVENTS};
use crate::dynamics::{Dynamics, Layout, Point, Step, Workspace};

/// Parts of a step at which the interpolant is looked at.
pub(super) const LOOKS: [f64; 3] = [0.25, 0.5, 0.75];

/// A whole step, with what drives it.
#[derive(Clone, Copy)]
pub(super) struct Stretch<'a> {
    pub(super) dynamics: &'a dyn Dynamics,
    /// Time at the beginning, and length.
    pub(super) t: f64,
    pub(super) h: f64,
    /// Drive at the beginning, in the middle and at the end (3 rows).
    pub(super) drive: &'a [f64],
    pub(super) known: &'a [f64],
}

impl<'a> Stretch<'a> {
    fn layout(&self) -> &Layout {
        self.dynamics.layout()
    }

    /// Drive at a time from the beginning of the step: within a step inputs are linear, or held.
    pub(super) fn drive_at(&self, from_begin: f64, row: &mut [f64]) {
        let (width, part) = (row.len(), from_begin / self.h);
        for (k, value) in row.iter_mut().enumerate() {
            let (a, b) = (self.drive[k], self.drive[2 * width + k]);
            *value = if part >= 1.0 { b } else { a + part * (b - a) };
        }
    }

    /// States at a time from the beginning of the step, with the drive there, for which `room` is.
    pub(super) fn point<'p>(&self, from_begin: f64, x: &'p [f64], room: &'p mut [f64]) -> Point<'p>
    where
        'a: 'p,
    {
        let drive = &mut room[..self.layout().drive()];
        self.drive_at(from_begin, drive);
        Point { t: self.t + from_begin, x, drive, known: self.known }
    }

    /// Drive at the beginning, in the middle and at the end (3 rows) of a part, given by its ends.
    pub(super) fn feed(&self, (begin, end): (f64, f64), drive: &mut [f64]) {
        let width = self.layout().drive();
        for (row, at) in drive.chunks_exact_mut(width.max(1)).zip([begin, begin + 0.5 * (end - begin), end]) {
            self.drive_at(at, row);
        }
    }

    /// Slope of a signal of the drive.
    pub(super) fn slope(&self, signal: usize) -> f64 {
        let width = self.layout().drive();
        (self.drive[2 * width + signal] - self.drive[signal]) / self.h
    }
}

/// A part of a step.
#[derive(Clone, Copy)]
pub(super) struct Part<'a> {
    /// Its beginning and its end, from the beginning of the step.
    pub(super) begin: f64,
    pub(super) end: f64,
    /// States at its beginning (n).
    pub(super) x: &'a [f64],
    /// Its drive (3 rows).
    pub(super) drive: &'a [f64],
    /// Whether an event stands at its beginning, at its end.
    pub(super) behind: bool,
    pub(super) before: bool,
}

impl<'a> Part<'a> {
    /// The part as a step.
    pub(super) fn step(&self, stretch: &Stretch<'a>) -> Step<'a> {
        let (t, h) = (stretch.t + self.begin, self.end - self.begin);
        Step { t, h, x: self.x, drive: self.drive, known: stretch.known }
    }
}

/// An event as the sensitivities see it.
#[derive(Clone, Copy)]
pub(super) struct Jump<'a> {
    /// Which event.
    pub(super) event: usize,
    /// Guards, values behind the events, and all their partials, just before it.
    pub(super) partials: &'a [f64],
    /// By how much its guard grows in a unit of time over the rest of the step, where it says itself when it happens; none where it
    /// follows another event at once.
    pub(super) growth: Option<f64>,
}

/// What is to be known of the parts of a step with events, in their order; a step without events is one part, which it is not told of.
pub(super) trait Follower {
    /// Takes a part: its end goes to `next`.
    fn part(&mut self, stretch: &Stretch<'_>, part: Part<'_>, next: &mut [f64], work: &mut Workspace);

    /// What cuts the step at the end of the part before, behind which everything stands at this point.
    fn turn(&mut self, stretch: &Stretch<'_>, turn: Turn, at: Point<'_>, work: &mut Workspace);

    /// An event at the end of the part before; false where its instant has no derivative.
    fn event(&mut self, stretch: &Stretch<'_>, jump: Jump<'_>) -> bool;
}

/// A response without sensitivities.
pub(super) struct StatesAlone;

impl Follower for StatesAlone {
    fn part(&mut self, stretch: &Stretch<'_>, part: Part<'_>, next: &mut [f64], work: &mut Workspace) {
        stretch.dynamics.step(part.step(stretch), next, work);
        take_back(stretch.layout(), stretch.known, next, |_, _| {});
    }

    fn turn(&mut self, _: &Stretch<'_>, _: Turn, _: Point<'_>, _: &mut Workspace) {}

    fn event(&mut self, _: &Stretch<'_>, _: Jump<'_>) -> bool {
        true
    }
}

/// Where a search within a step begins and ends, and room for its parts.
pub(super) struct Search {
    /// States where it begins, at the end of the step as if nothing happened any more, at the end of a part (n).
    pub(super) start: Vec<f64>,
    pub(super) end: Vec<f64>,
    pub(super) at: Vec<f64>,
    /// Drive of a part (3 rows).
    pub(super) drive: Vec<f64>,
}

impl Search {
    pub(super) fn new(layout: &Layout) -> Self {
        let states = || vec![0.0; layout.states];
        Self { start: states(), end: states(), at: states(), drive: vec![0.0; 3 * layout.drive()] }
    }

    /// Begins with the step from x to `next`.
    pub(super) fn begin(&mut self, x: &[f64], next: &[f64]) {
        self.start.copy_from_slice(x);
        self.end.copy_from_slice(next);
    }

    /// The point at the end of a part, at a time from the beginning of the step.
    pub(super) fn point<'p>(&'p mut self, stretch: &Stretch<'p>, at: f64) -> Point<'p> {
        stretch.point(at, &self.at, &mut self.drive)
    }

    /// A step of any length from where the search begins, as if nothing happened within; its end goes to `x`.
    fn trial(&mut self, stretch: &Stretch<'_>, (begin, end): (f64, f64), x: &mut [f64], work: &mut Workspace) {
        stretch.feed((begin, end), &mut self.drive);
        let part = Part { begin, end, x: &self.start, drive: &self.drive, behind: false, before: false };
        StatesAlone.part(stretch, part, x, work);
    }

    /// A part from where the search begins; `behind` and `before` say whether something happens at its ends.
    pub(super) fn part(
        &mut self,
        stretch: &Stretch<'_>,
        (begin, end): (f64, f64),
        (behind, before): (bool, bool),
        work: &mut Workspace,
        follower: &mut dyn Follower,
    ) {
        stretch.feed((begin, end), &mut self.drive);
        let part = Part { begin, end, x: &self.start, drive: &self.drive, behind, before };
        follower.part(stretch, part, &mut self.at, work);
    }
}

/// Which events can happen, and memory; allocates once.
pub(super) struct Events {
    armed: Vec<bool>,
    /// Whether it has just happened, and its guard goes down from zero.
    rebounds: Vec<bool>,
    /// Guards where the search begins, and at the end of the step without a further event.
    guards: Vec<f64>,
    ends: Vec<f64>,
    /// During a search: whether each event is armed, where its guard was last not above zero, and between which times it passes zero.
    arming: Vec<bool>,
    below: Vec<f64>,
    brackets: Vec<Option<[f64; 2]>>,
    /// Results of `events` and `events_and_partials`.
    values: Vec<f64>,
    partials: Vec<f64>,
    search: Search,
    /// Rates at the beginning and the end.
    slopes: [Vec<f64>; 2],
    /// States at the end of a trial (n).
    trial: Vec<f64>,
}

/// An instant at which a guard is zero.
#[derive(Debug, Clone, Copy)]
struct Instant {
    event: usize,
    /// From the beginning of the step.
    at: f64,
    /// What is left of the guard on both sides.
    left: f64,
    /// It happened just before, and again before the time can tell.
    repeats: bool,
}

impl Events {
    /// Memory for a model; none where it has no events.
    pub(super) fn new(layout: &Layout) -> Option<Box<Self>> {
        let (n, count) = (layout.states, layout.events.len());
        (count > 0).then(|| {
            Box::new(Self {
                armed: vec![false; count],
                rebounds: vec![false; count],
                ends: vec![0.0; count],
                guards: vec![0.0; count],
                arming: vec![false; count],
                below: vec![0.0; count],
                brackets: vec![None; count],
                values: vec![0.0; layout.event_rows()],
                partials: vec![0.0; layout.event_slots()],
                search: Search::new(layout),
                slopes: std::array::from_fn(|_| vec![0.0; n]),
                trial: vec![0.0; n],
            })
        })
    }

    /// At the beginning of a run, whose first step this is: what is true already does not become true.
    pub(super) fn begin(&mut self, stretch: &Stretch<'_>, x: &[f64], work: &mut Workspace) {
        self.look(stretch, 0.0, Looked::At(x), work);
        for (k, armed) in self.armed.iter_mut().enumerate() {
            self.guards[k] = self.values[k];
            *armed = self.values[k] <= 0.0;
        }
    }

    /// The events of a step from x; `next` is its end, without them before and with them afterwards. An error has its time.
    pub(super) fn across(
        &mut self,
        stretch: &Stretch<'_>,
        x: &[f64],
        next: &mut [f64],
        work: &mut Workspace,
        follower: &mut dyn Follower,
    ) -> Result<(), (f64, EventFault)> {
        self.search.begin(x, next);
        self.rebounds.fill(false);
        let (mut begin, mut count) = (0.0, 0);
        while let Some(instant) = self.earliest(stretch, begin, work) {
            let time = stretch.t + instant.at;
            let growth = (self.guards[instant.event].abs() + self.ends[instant.event].abs()) / (stretch.h - begin);
            self.search.part(stretch, (begin, instant.at), (count > 0, true), work, follower);
            let mut next_fired = Some((instant.event, Some(growth)));
            while let Some((event, growth)) = next_fired {
                count += 1;
                if count > MOST_EVENTS || instant.repeats {
                    return Err((time, EventFault::Accumulates(event)));
                }
                if !self.happen(stretch, (event, instant.at, growth), work, follower) {
                    return Err((time, EventFault::Grazes(event)));
                }
                next_fired = self.rearm(stretch, (event, instant), work).map(|event| (event, None));
            }
            begin = instant.at;
            self.search.trial(stretch, (begin, stretch.h), &mut self.trial, work);
            self.search.end.copy_from_slice(&self.trial);
        }
        if count > 0 {
            self.search.part(stretch, (begin, stretch.h), (true, false), work, follower);
            next.copy_from_slice(&self.search.at);
        }
        for (k, armed) in self.armed.iter_mut().enumerate() {
            let guard = self.ends[k];
            *armed = guard < 0.0 || guard == 0.0 && *armed;
            self.guards[k] = guard;
        }
        Ok(())
    }

    /// Gives states their new values: from `at` to `start`. False where the instant has no derivative.
    fn happen(
        &mut self,
        stretch: &Stretch<'_>,
        (event, at, growth): (usize, f64, Option<f64>),
        work: &mut Workspace,
        follower: &mut dyn Follower,
    ) -> bool {
        let point = self.search.point(stretch, at);
        stretch.dynamics.events_and_partials(point, &mut self.partials, work);
        if !follower.event(stretch, Jump { event, partials: &self.partials, growth }) {
            return false;
        }
        let sets = &stretch.layout().events[event];
        self.search.start.copy_from_slice(&self.search.at);
        for (k, state) in sets.states.iter().enumerate() {
            self.search.start[*state as usize] = self.partials[sets.first + k];
        }
        self.search.at.copy_from_slice(&self.search.start);
        true
    }

    /// Which events can happen behind one that has happened; the first that does so at once, since its condition has become true by that.
    fn rearm(
        &mut self,
        stretch: &Stretch<'_>,
        (event, instant): (usize, Instant),
        work: &mut Workspace,
    ) -> Option<usize> {
        let point = stretch.point(instant.at, &self.search.start, &mut self.search.drive);
        stretch.dynamics.events_and_partials(point, &mut self.partials, work);
        stretch.dynamics.rates(point, &mut self.slopes[0], work);
        let rising = guard_rate(stretch, &self.partials, event, &self.slopes[0]).0 >= 0.0;
        let mut fired = None;
        for k in 0..self.armed.len() {
            let guard = self.partials[k];
            self.guards[k] = guard;
            if k == event {
                // what the search has left of it is zero, and its direction says to which side it goes
                let zero = guard.abs() <= 2.0 * instant.left;
                self.armed[k] = if zero { !rising } else { guard < 0.0 };
                self.rebounds[k] = zero && !rising;
                if zero {
                    self.guards[k] = 0.0;
                }
            } else if guard < 0.0 {
                self.armed[k] = true;
            } else if guard > 0.0 && self.armed[k] && fired.is_none() {
                fired = Some(k);
            }
        }
        if let Some(next) = fired {
            self.armed[next] = false;
        }
        fired
    }

    /// The first event behind `begin`.
    fn earliest(&mut self, stretch: &Stretch<'_>, begin: f64, work: &mut Workspace) -> Option<Instant> {
        self.arming.copy_from_slice(&self.armed);
        self.below.fill(begin);
        self.brackets.fill(None);
        for (from_begin, ends) in [begin, stretch.h].into_iter().zip(0..2) {
            let x = if ends == 0 { &self.search.start } else { &self.search.end };
            let point = stretch.point(from_begin, x, &mut self.search.drive);
            stretch.dynamics.rates(point, &mut self.slopes[ends], work);
        }
        for look in LOOKS {
            self.look(stretch, begin + look * (stretch.h - begin), Looked::Between(begin, look), work);
            self.compare(begin + look * (stretch.h - begin));
        }
        self.look(stretch, stretch.h, Looked::End, work);
        self.compare(stretch.h);
        self.ends.copy_from_slice(&self.values[..self.armed.len()]);
        let mut found: Option<Instant> = None;
        for event in 0..self.armed.len() {
            let Some(bracket) = self.brackets[event] else { continue };
            let instant = self.instant(stretch, (event, begin), bracket, work);
            found = match (found, instant) {
                (Some(first), Some(other)) if other.at < first.at => Some(other),
                (None, other) => other,
                (first, _) => first,
            };
        }
        found
    }

    /// Guards at a time from the beginning of the step.
    fn look(&mut self, stretch: &Stretch<'_>, from_begin: f64, at: Looked<'_>, work: &mut Workspace) {
        let x: &[f64] = match at {
            Looked::At(x) => x,
            Looked::End => &self.search.end,
            Looked::Between(begin, part) => {
                let ([from, to], [first, last]) =
                    ([&self.search.start, &self.search.end], [&self.slopes[0], &self.slopes[1]]);
                between([from, to], [first, last], (part, stretch.h - begin), &mut self.trial);
                &self.trial
            }
        };
        let point = stretch.point(from_begin, x, &mut self.search.drive);
        stretch.dynamics.events(point, &mut self.values, work);
    }

    /// What guards that were just looked at mean.
    fn compare(&mut self, from_begin: f64) {
        for k in 0..self.armed.len() {
            let guard = self.values[k];
            match (self.brackets[k], self.arming[k]) {
                (None, true) if guard > 0.0 => self.brackets[k] = Some([self.below[k], from_begin]),
                (None, true) => self.below[k] = from_begin,
                (None, false) if guard < 0.0 => (self.arming[k], self.below[k]) = (true, from_begin),
                _ => {}
            }
        }
    }

    /// The root of a guard within a bracket, by real steps; none where these show that there is none.
    fn instant(
        &mut self,
        stretch: &Stretch<'_>,
        (event, begin): (usize, f64),
        [mut low, mut high]: [f64; 2],
        work: &mut Workspace,
    ) -> Option<Instant> {
        let end = stretch.h;
        let mut guard = |at: f64| {
            self.search.trial(stretch, (begin, at), &mut self.trial, work);
            let point = stretch.point(at, &self.trial, &mut self.search.drive);
            stretch.dynamics.events(point, &mut self.values, work);
            self.values[event]
        };
        let mut over = guard(high);
        if above(over).is_none() && high < end {
            (low, high) = (high, end);
            over = guard(high);
        }
        above(over)?;
        let finest = 2.0 * f64::EPSILON * stretch.h;
        let mut under = if low > begin { guard(low) } else { self.guards[event] };
        if above(-under).is_none() {
            if !self.armed[event] {
                return None;
            }
            // it begins at zero: it has been below where a short part ends below
            loop {
                if high - begin <= finest {
                    return Some(Instant { event, at: begin, left: over.abs(), repeats: self.rebounds[event] });
                }
                let middle = begin + 0.5 * (high - begin);
                let value = guard(middle);
                if value < 0.0 {
                    (low, under) = (middle, value);
                    break;
                }
                (high, over) = (middle, value);
            }
        }
        let Bracket { low, high, under, over } = root(guard, [low, high], [under, over], finest);
        let at = if under.abs() <= over.abs() { low } else { high };
        Some(Instant { event, at, left: under.abs() + over.abs(), repeats: false })
    }
}

/// States (n) at a part of a step of length h, by the cubic through both ends and the rates there.
pub(super) fn between([from, to]: [&[f64]; 2], rates: [&[f64]; 2], (part, h): (f64, f64), x: &mut [f64]) {
    let (a, b) = (part * part * (3.0 - 2.0 * part), part * (1.0 - part));
    for (i, x) in x.iter_mut().enumerate() {
        let slopes = (1.0 - part) * rates[0][i] - part * rates[1][i];
        *x = from[i] + a * (to[i] - from[i]) + h * b * slopes;
    }
}

/// Where a guard passes zero.
pub(super) struct Bracket {
    /// On both sides of the root.
    pub(super) low: f64,
    pub(super) high: f64,
    /// The guard there, not above zero and above it.
    pub(super) under: f64,
    pub(super) over: f64,
}

/// The root of a guard within a bracket, as near as `finest`.
pub(super) fn root(
    mut guard: impl FnMut(f64) -> f64,
    [mut low, mut high]: [f64; 2],
    [mut under, mut over]: [f64; 2],
    finest: f64,
) -> Bracket {
    // false position (Illinois), with a halving in every third trial
    let (mut side, mut weight) = (0, [under, over]);
    // most trials until an instant is found; each at least halves the bracket in two
    for trial in 0..200 {
        if high - low <= finest {
            break;
        }
        let secant = high - weight[1] * (high - low) / (weight[1] - weight[0]);
        let inside = secant > low && secant < high && trial % 3 != 2;
        // not nearer to an end than can be told apart; both ends then come near
        let middle = match inside {
            true => secant.max(low + finest).min(high - 0.5 * finest),
            false => low + 0.5 * (high - low),
        };
        if middle <= low || middle >= high {
            break;
        }
        let value = guard(middle);
        if value > 0.0 {
            (high, over, weight[1]) = (middle, value, value);
            if side == 1 {
                weight[0] *= 0.5;
            }
            side = 1;
        } else {
            (low, under, weight[0]) = (middle, value, value);
            if side == -1 {
                weight[1] *= 0.5;
            }
            side = -1;
            if value == 0.0 {
                break;
            }
        }
    }
    Bracket { low, high, under, over }
}

/// A number above zero; what is not a number is not.
fn above(value: f64) -> Option<f64> {
    (value > 0.0).then_some(value)
}

/// Where guards are looked at.
enum Looked<'a> {
    At(&'a [f64]),
    End,
    /// A part of the way from a time to the end of the step.
    Between(f64, f64),
}

/// By how much a guard grows in time while states move by `rates` (n), and how large the terms of that are.
pub(super) fn guard_rate(stretch: &Stretch<'_>, partials: &[f64], event: usize, rates: &[f64]) -> (f64, f64) {
    let (mut rate, mut size) = (0.0, 0.0);
    let mut add = |term: f64| {
        rate += term;
        size += f64::abs(term);
    };
    let layout = stretch.layout();
    let entries = EventEntries::new(layout);
    layout.patterns.events_by_state.row(event).for_each(|(k, j)| add(partials[entries.by_state + k] * rates[j]));
    add(by_time(stretch, partials, event));
    (rate, size)
}

/// By how much a guard, or a value behind an event, changes in time while the states stand still.
pub(super) fn by_time(stretch: &Stretch<'_>, partials: &[f64], row: usize) -> f64 {
    let layout = stretch.layout();
    let (patterns, entries) = (&layout.patterns, EventEntries::new(layout));
    let of_inputs = patterns.events_by_input.row(row).map(|(k, j)| partials[entries.by_input + k] * stretch.slope(j));
    let of_time = patterns.events_by_time.row(row).map(|(k, _)| partials[entries.by_time + k]);
    of_inputs.chain(of_time).sum()
}

/// Where the entries begin in the result of `events_and_partials`.
pub(super) struct EventEntries {
    pub(super) by_state: usize,
    by_input: usize,
    pub(super) by_param: usize,
    by_time: usize,
}

impl EventEntries {
    pub(super) fn new(layout: &Layout) -> Self {
        let p = &layout.patterns;
        let by_state = layout.event_rows();
        let by_input = by_state + p.events_by_state.len();
        let by_param = by_input + p.events_by_input.len();
        Self { by_state, by_input, by_param, by_time: by_param + p.events_by_param.len() }
    }
}
