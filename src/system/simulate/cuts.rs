//! Kinks in the middle of explicit steps: a step is cut where a state meets its hard limit, where it leaves it, and, if that was chosen, where
//! `max`, `min`, `abs` or `if` change their branch.
//!
//! Rates see a state inside its limits (`fdm_grammar`). So a part of a step across which a state pushes outwards moves all others as if it
//! stood at its limit, and it is taken back there at the part's end. What is left are the instants: a state meets a limit where a part
//! ends there, and leaves it where its rate changes sign. Both are roots of real steps, as with events (`events.rs`), and the
//! sensitivities cross them in the same way (`event_steps.rs`). Which states may meet a limit is seen from the parabola through the
//! beginning, the rate there, and the end.
//!
//! A branch changes where a switching function passes zero (`a - b` of `max(a, b)`), looked for as the guards of events are. A part that
//! ends there has stages on both sides, as far apart as the method's inner error; so a kink costs no order then. A jump would cost one, and
//! halving would not show it, since the part behind it may stay as long: steps are not cut there.
//!
//! States with hard limits: at the end of every step they are taken back into them, with the sensitivity of the limit.
//!
//! The rates see such a state inside its limits (`fdm_grammar`), so that a step which reaches a limit ends exactly there, and the
//! discrete response is a continuous function of the parameters whose derivative this is. A kink inside a step would cost
//! an error of second order in its length, once for each time that a limit is reached or left: explicit steps are cut there (`cuts.rs`).

use super::events::{Follower, LOOKS, Search, Stretch, between, root};
use crate::dynamics::{Dynamics, Layout, Point, Step, Workspace};

/// How far from an instant it is looked for a jump there, as a part of the step: the root of rounding, where all conditions have changed.
const BESIDE: f64 = 1.5e-8;
/// Rates jump where they differ so near to each other by more than this part of their size over the step: without a jump that is about
/// `BESIDE`, and what a smaller jump costs is of no consequence.
const JUMPS: f64 = 1e-6;

/// Where switching functions are looked at: at the beginning, between, and at the end.
const PLACES: [f64; 5] = [0.0, LOOKS[0], LOOKS[1], LOOKS[2], 1.0];

/// What happens at an instant.
#[derive(Debug, Clone, Copy)]
pub(super) enum Turn {
    /// A state meets a limit, or leaves it; `row` is that of the limit: two for each limited state, the lower one first.
    Limit { state: usize, row: usize, leaves: bool },
    /// A switching function of the rates passes zero, and changes by `growth` in a unit of time thereabouts.
    Kink { kink: usize, growth: f64 },
}

/// Memory of the search; allocates once.
pub(super) struct Cuts {
    /// By limited state, whether it has just left its limit.
    left: Vec<bool>,
    /// Its states are also those at the end of a trial.
    search: Search,
    /// Rates at the beginning, at another point, and on both sides of an instant (n).
    rates: [Vec<f64>; 4],
    /// Switching functions at places of the step, in rows, and at a trial; none where steps are not cut at kinks.
    switches: Vec<f64>,
    switched: Vec<f64>,
    /// Which of them have passed zero where the search begins.
    passed: Vec<bool>,
}

impl Cuts {
    /// Memory for a model; none where it has no hard limits, and no kinks or none that steps are cut at. Beside events and delays a state is
    /// only taken back at the end of a step: the one has instants of its own, the others a past whose slopes a part does not know.
    pub(super) fn new(layout: &Layout, kinks: bool) -> Option<Box<Self>> {
        let (n, kinks) = (layout.states, if kinks { layout.kinks } else { 0 });
        let any = !layout.limited.is_empty() || kinks > 0;
        (any && layout.events.is_empty() && layout.delayed.is_empty()).then(|| {
            Box::new(Self {
                left: vec![false; layout.limited.len()],
                search: Search::new(layout),
                rates: std::array::from_fn(|_| vec![0.0; n]),
                switches: vec![0.0; PLACES.len() * kinks],
                switched: vec![0.0; kinks],
                passed: vec![false; kinks],
            })
        })
    }

    /// Cuts a step from x; `next` is its end as if there were nothing to cut it at before, and the true one afterwards where it was cut.
    pub(super) fn across(
        &mut self,
        stretch: &Stretch<'_>,
        x: &[f64],
        next: &mut [f64],
        work: &mut Workspace,
        follower: &mut dyn Follower,
    ) {
        self.search.begin(x, next);
        self.left.fill(false);
        self.passed.fill(false);
        let (mut begin, mut cuts) = (0.0, 0);
        // most cuts of one step; behind them the rest is one part
        while cuts < 100
            && let Some((at, turn)) = self.earliest(stretch, begin, work)
        {
            self.search.part(stretch, (begin, at), (cuts > 0, true), work, follower);
            self.passed.fill(false);
            match turn {
                Turn::Limit { state, row, leaves } => {
                    if !leaves {
                        self.search.at[state] = stretch.known[stretch.dynamics.layout().limits.start + row];
                    }
                    self.left[row / 2] = leaves;
                }
                Turn::Kink { kink, .. } => self.passed[kink] = true,
            }
            let point = self.search.point(stretch, at);
            follower.turn(stretch, turn, point, work);
            self.search.start.copy_from_slice(&self.search.at);
            (begin, cuts) = (at, cuts + 1);
            self.trial(stretch, (begin, stretch.h), work);
            self.search.end.copy_from_slice(&self.search.at);
        }
        if cuts > 0 {
            self.search.part(stretch, (begin, stretch.h), (true, false), work, follower);
            next.copy_from_slice(&self.search.at);
        }
    }

    /// The end of a part from where the search begins, as if there were no limits, in `at`.
    fn trial(&mut self, stretch: &Stretch<'_>, (begin, end): (f64, f64), work: &mut Workspace) {
        stretch.feed((begin, end), &mut self.search.drive);
        let step = Step {
            t: stretch.t + begin,
            h: end - begin,
            x: &self.search.start,
            drive: &self.search.drive,
            known: stretch.known,
        };
        stretch.dynamics.step(step, &mut self.search.at, work);
    }

    /// The rate of a state where a trial has ended.
    fn rate(&mut self, stretch: &Stretch<'_>, (at, state): (f64, usize), work: &mut Workspace) -> f64 {
        let point = self.search.point(stretch, at);
        stretch.dynamics.rates(point, &mut self.rates[1], work);
        self.rates[1][state]
    }

    /// The first instant behind `begin`.
    fn earliest(&mut self, stretch: &Stretch<'_>, begin: f64, work: &mut Workspace) -> Option<(f64, Turn)> {
        let layout = stretch.dynamics.layout();
        let point = stretch.point(begin, &self.search.start, &mut self.search.drive);
        stretch.dynamics.rates(point, &mut self.rates[0], work);
        let mut found: Option<(f64, Turn)> = None;
        for row in 0..2 * layout.limited.len() {
            let (state, outward) = (layout.limited[row / 2] as usize, if row % 2 == 0 { -1.0 } else { 1.0 });
            let limit = stretch.known[layout.limits.start + row];
            // how far it is outside, at both ends, and by how much that grows over the step at its first rate
            let [from, to] = [self.search.start[state], self.search.end[state]].map(|x| outward * (x - limit));
            let growth = outward * self.rates[0][state] * (stretch.h - begin);
            let held = from >= 0.0 && !self.left[row / 2] && (growth > 0.0 || growth == 0.0 && to > 0.0);
            let turn = Turn::Limit { state, row, leaves: held };
            let at = match held {
                true => self.leaves(stretch, (begin, -growth), (state, outward), work),
                false => {
                    let course = Course { from, growth, to };
                    course
                        .bracket(self.left[row / 2])
                        .and_then(|parts| self.meets(stretch, (begin, parts), (state, outward, limit), work))
                }
            };
            if let Some(at) = at
                && found.is_none_or(|(first, _)| at < first)
            {
                found = Some((at, turn));
            }
        }
        self.kink(stretch, begin, found, work)
    }

    /// The first change of a branch behind `begin`, where that is before what was found.
    fn kink(
        &mut self,
        stretch: &Stretch<'_>,
        begin: f64,
        mut found: Option<(f64, Turn)>,
        work: &mut Workspace,
    ) -> Option<(f64, Turn)> {
        self.look(stretch, begin, work);
        for kink in 0..self.passed.len() {
            let mut crossing = self.crossing(stretch, (begin, kink), found, work);
            // what changes its branch where the search begins needs no cut there
            if crossing.is_some_and(|(at, _)| at - begin <= finest(stretch)) {
                self.passed[kink] = true;
                crossing = self.crossing(stretch, (begin, kink), found, work);
            }
            if let Some((at, growth)) = crossing
                && found.is_none_or(|(first, _)| at < first)
            {
                found = Some((at, Turn::Kink { kink, growth }));
            }
        }
        found
    }

    /// Where a switching function passes zero for the first time, and its growth there; none where that is behind what was found.
    fn crossing(
        &mut self,
        stretch: &Stretch<'_>,
        (begin, kink): (f64, usize),
        found: Option<(f64, Turn)>,
        work: &mut Workspace,
    ) -> Option<(f64, f64)> {
        let [low, high] = self.sides(kink)?;
        let place = |row: usize| begin + PLACES[row] * (stretch.h - begin);
        if found.is_some_and(|(first, _)| place(low) >= first) {
            return None;
        }
        let side = self.switches[high * self.passed.len() + kink].signum();
        let mut over = |at: f64| {
            self.trial(stretch, (begin, at), work);
            side * self.switch(stretch, (at, kink), work)
        };
        let (mut ends, mut values) = ([place(low), place(high)], [over(place(low)), over(place(high))]);
        // real steps may pass zero beside what the cubic says
        if values[0] >= 0.0 && low > 0 {
            (ends, values) = ([begin, ends[0]], [over(begin), values[0]]);
        } else if values[1] <= 0.0 {
            (ends, values) = ([ends[1], stretch.h], [values[1], over(stretch.h)]);
        }
        if !(values[0] < 0.0 && values[1] > 0.0) {
            return None;
        }
        let growth = (values[1] - values[0]) / (ends[1] - ends[0]);
        let (at, beside) = (root(over, ends, values, finest(stretch)).low, BESIDE * stretch.h);
        let sides = [(at - beside).max(begin), (at + beside).min(stretch.h)];
        (!self.jumps(stretch, (begin, sides), work)).then_some((at, growth))
    }

    /// Whether rates jump between two instants that are close to each other.
    fn jumps(&mut self, stretch: &Stretch<'_>, (begin, sides): (f64, [f64; 2]), work: &mut Workspace) -> bool {
        for (side, at) in sides.into_iter().enumerate() {
            self.trial(stretch, (begin, at), work);
            let point = self.search.point(stretch, at);
            stretch.dynamics.rates(point, &mut self.rates[2 + side], work);
        }
        let [first, last, before, behind] = &self.rates;
        (0..before.len()).any(|i| {
            let size = [first, last, before, behind].into_iter().map(|rates| rates[i].abs()).fold(0.0, f64::max);
            (behind[i] - before[i]).abs() > JUMPS * size
        })
    }

    /// Between which places a switching function passes zero for the first time. One that has just passed it is on the side to which it goes.
    fn sides(&self, kink: usize) -> Option<[usize; 2]> {
        let count = self.passed.len();
        let mut before: Option<(usize, f64)> = None;
        for row in usize::from(self.passed[kink])..PLACES.len() {
            let value = self.switches[row * count + kink];
            match before {
                Some((low, old)) if old * value < 0.0 => return Some([low, row]),
                _ if value != 0.0 => before = Some((row, value.signum())),
                _ => {}
            }
        }
        None
    }

    /// Switching functions at places between `begin` and the end of the step.
    fn look(&mut self, stretch: &Stretch<'_>, begin: f64, work: &mut Workspace) {
        let (count, length) = (self.switched.len(), stretch.h - begin);
        if count == 0 {
            return;
        }
        let point = stretch.point(stretch.h, &self.search.end, &mut self.search.drive);
        stretch.dynamics.rates(point, &mut self.rates[1], work);
        for (part, switches) in PLACES.into_iter().zip(self.switches.chunks_exact_mut(count)) {
            between(
                [&self.search.start, &self.search.end],
                [&self.rates[0], &self.rates[1]],
                (part, length),
                &mut self.search.at,
            );
            let row = &mut self.search.drive[..stretch.dynamics.layout().drive()];
            stretch.drive_at(begin + part * length, row);
            let point =
                Point { t: stretch.t + begin + part * length, x: &self.search.at, drive: row, known: stretch.known };
            stretch.dynamics.events(point, switches, work);
        }
    }

    /// A switching function where a trial has ended.
    fn switch(&mut self, stretch: &Stretch<'_>, (at, kink): (f64, usize), work: &mut Workspace) -> f64 {
        let point = self.search.point(stretch, at);
        stretch.dynamics.events(point, &mut self.switched, work);
        self.switched[kink]
    }

    /// Where the rate of a state that is held changes sign; `under` is it at the beginning, counted inwards, over the length of the step.
    fn leaves(
        &mut self,
        stretch: &Stretch<'_>,
        (begin, under): (f64, f64),
        (state, outward): (usize, f64),
        work: &mut Workspace,
    ) -> Option<f64> {
        let length = stretch.h - begin;
        let mut inward = |at: f64| {
            self.trial(stretch, (begin, at), work);
            -outward * self.rate(stretch, (at, state), work)
        };
        let over = inward(stretch.h);
        if over.is_nan() || over <= 0.0 {
            return None;
        }
        Some(root(inward, [begin, stretch.h], [under / length, over], finest(stretch)).low)
    }

    /// Where a state meets a limit between two parts of the rest of the step; its last instant inside.
    fn meets(
        &mut self,
        stretch: &Stretch<'_>,
        (begin, parts): (f64, [f64; 2]),
        (state, outward, limit): (usize, f64, f64),
        work: &mut Workspace,
    ) -> Option<f64> {
        let mut outside = |at: f64| {
            self.trial(stretch, (begin, at), work);
            outward * (self.search.at[state] - limit)
        };
        let [low, high] = parts.map(|part| begin + part * (stretch.h - begin));
        let [under, over] = [outside(low), outside(high)];
        let crosses = under < 0.0 && over > 0.0;
        crosses.then(|| root(outside, [low, high], [under, over], finest(stretch)).low)
    }
}

/// Instants nearer to each other cannot be told apart.
fn finest(stretch: &Stretch<'_>) -> f64 {
    2.0 * f64::EPSILON * stretch.h
}

/// How far a state is outside a limit over a step: a parabola.
struct Course {
    from: f64,
    /// Its slope at the beginning.
    growth: f64,
    to: f64,
}

impl Course {
    /// Parts of the step between which it passes zero upwards; none where it does not. A state that has just left its limit is inside
    /// first.
    fn bracket(&self, left: bool) -> Option<[f64; 2]> {
        let Self { from, growth, to } = *self;
        let bend = to - from - growth;
        let turns = -growth / (2.0 * bend);
        let value = |part: f64| from + part * (growth + part * bend);
        let turns = (turns > 0.0 && turns < 1.0).then_some(turns);
        if from < 0.0 && !left {
            return match turns {
                _ if to > 0.0 => Some([0.0, 1.0]),
                Some(part) if bend < 0.0 && value(part) > 0.0 => Some([0.0, part]),
                _ => None,
            };
        }
        turns.filter(|part| bend > 0.0 && to > 0.0 && value(*part) < 0.0).map(|part| [part, 1.0])
    }
}

/// Which limited states were taken back at the ends of the last steps; allocates once.
#[derive(Debug, Clone, Default)]
pub(super) struct Stops {
    /// Of the last two steps: state, and row of its limit. The states may run one step ahead of their sensitivities.
    held: [Vec<(usize, usize)>; 2],
    /// By row of a limit: position of its derivative in `known`, and lane.
    terms: Vec<Vec<(usize, usize)>>,
    lanes: usize,
    /// Whether the model has limited states: asked in every step.
    any: bool,
}

impl Stops {
    pub(super) fn new(layout: &Layout) -> Self {
        let (stage, first) = (&layout.stage, layout.limits_by_param.start);
        let lane = |j: usize| stage.lane.get(j).copied().flatten().map(|lane| lane as usize);
        let pattern = &layout.patterns.limits_by_param;
        let row = |r: usize| pattern.row(r).filter_map(|(k, j)| Some((first + k, lane(j)?))).collect();
        Self {
            held: std::array::from_fn(|_| Vec::with_capacity(layout.limited.len())),
            terms: (0..layout.limits.len()).map(row).collect(),
            lanes: stage.lanes,
            any: !layout.limited.is_empty(),
        }
    }

    /// Takes the states at the end of step k back into their limits.
    #[inline(always)]
    pub(super) fn hold(&mut self, k: usize, dynamics: &dyn Dynamics, known: &[f64], x: &mut [f64]) {
        if self.any {
            let held = &mut self.held[k % 2];
            held.clear();
            take_back(dynamics.layout(), known, x, |state, row| held.push((state, row)));
        }
    }

    /// The sensitivities (n by lanes) of the states that were held at the end of step k become those of their limits.
    #[inline(always)]
    pub(super) fn follow(&self, k: usize, known: &[f64], s: &mut [f64]) {
        if !self.any {
            return;
        }
        for (state, row) in &self.held[k % 2] {
            let lanes = &mut s[state * self.lanes..][..self.lanes];
            lanes.fill(0.0);
            self.terms[*row].iter().for_each(|(from, lane)| lanes[*lane] = known[*from]);
        }
    }
}

/// Takes states (n) back into their limits, and says which by state and row of the limit; `known` is what `prepare` computed.
#[inline(always)]
pub fn take_back(layout: &Layout, known: &[f64], x: &mut [f64], mut held: impl FnMut(usize, usize)) {
    for (k, state) in layout.limited.iter().enumerate() {
        let (at, row) = (*state as usize, 2 * k);
        let [lower, upper] = [0, 1].map(|side| known[layout.limits.start + row + side]);
        // what is not a number stays that, and is told
        if x[at] < lower {
            x[at] = lower;
            held(at, row);
        } else if x[at] > upper {
            x[at] = upper;
            held(at, row + 1);
        }
    }
}

/// Whether a state (by index, with its value and rate) stands at a limit and its rate pushes outwards: its derivative is zero.
pub fn rests(layout: &Layout, known: &[f64], state: usize, x: f64, rate: f64) -> bool {
    let Some(k) = layout.limited.iter().position(|s| *s as usize == state) else { return false };
    let [lower, upper] = [0, 1].map(|side| known[layout.limits.start + 2 * k + side]);
    x <= lower && rate < 0.0 || x >= upper && rate > 0.0
}
