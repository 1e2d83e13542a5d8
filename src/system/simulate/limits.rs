//! Hard limits in the middle of explicit steps: a step is cut where a state meets its limit, and where it leaves it.
//!
//! Rates see a state inside its limits (`fdm_grammar`). So a part of a step across which a state pushes outwards moves all others as if it
//! stood at its limit, and it is taken back there at the part's end. What is left are the instants: a state meets a limit where a part
//! ends there, and leaves it where its rate changes sign. Both are roots of real steps, as with events (`events.rs`), and the
//! sensitivities cross them in the same way (`event_steps.rs`). Which states may meet a limit is seen from the parabola through the
//! beginning, the rate there, and the end.

use super::events::{Follower, Part, Stretch, root};
use crate::dynamics::{Layout, Point, Step, Workspace};

/// Most cuts of one step; behind them the rest is one part.
const MOST_CUTS: usize = 100;

/// What a state does at an instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    /// The state, and the row of its limit: two for each limited state, the lower one first.
    pub(super) state: usize,
    pub(super) row: usize,
    /// Whether it leaves the limit; it meets it otherwise.
    pub(super) leaves: bool,
}

/// Memory of the search; allocates once.
pub(super) struct Limits {
    /// By limited state, whether it has just left its limit.
    left: Vec<bool>,
    /// States where the search begins, at the end of the step as if there were no limits, at the end of a part or a trial (n).
    start: Vec<f64>,
    end: Vec<f64>,
    at: Vec<f64>,
    /// Rates at the beginning and at another point (n).
    rates: [Vec<f64>; 2],
    /// Drive of a part (3 rows).
    drive: Vec<f64>,
}

impl Limits {
    /// Memory for a model; none where it has no hard limits. Beside events and delays a state is only taken back at the end of a step:
    /// the one has instants of its own, the others a past whose slopes a part does not know.
    pub(super) fn new(layout: &Layout) -> Option<Box<Self>> {
        let n = layout.states;
        (!layout.limited.is_empty() && layout.events.is_empty() && layout.delayed.is_empty()).then(|| {
            Box::new(Self {
                left: vec![false; layout.limited.len()],
                start: vec![0.0; n],
                end: vec![0.0; n],
                at: vec![0.0; n],
                rates: std::array::from_fn(|_| vec![0.0; n]),
                drive: vec![0.0; 3 * layout.drive()],
            })
        })
    }

    /// Cuts a step from x where states meet or leave their limits; `next` is its end as if there were none before, and the true one
    /// afterwards where it was cut.
    pub(super) fn across(
        &mut self,
        stretch: &Stretch<'_>,
        x: &[f64],
        next: &mut [f64],
        work: &mut Workspace,
        follower: &mut dyn Follower,
    ) {
        self.start.copy_from_slice(x);
        self.end.copy_from_slice(next);
        self.left.fill(false);
        let (mut begin, mut cuts) = (0.0, 0);
        while cuts < MOST_CUTS
            && let Some((at, turn)) = self.earliest(stretch, begin, work)
        {
            self.part(stretch, (begin, at), (cuts > 0, true), work, follower);
            if !turn.leaves {
                self.at[turn.state] = stretch.known[stretch.dynamics.layout().limits.start + turn.row];
            }
            self.left[turn.row / 2] = turn.leaves;
            let row = &mut self.drive[..stretch.dynamics.layout().drive()];
            stretch.drive_at(at, row);
            let point = Point { t: stretch.t + at, x: &self.at, drive: row, known: stretch.known };
            follower.turn(stretch, turn, point, work);
            self.start.copy_from_slice(&self.at);
            (begin, cuts) = (at, cuts + 1);
            self.trial(stretch, (begin, stretch.h), work);
            self.end.copy_from_slice(&self.at);
        }
        if cuts > 0 {
            self.part(stretch, (begin, stretch.h), (true, false), work, follower);
            next.copy_from_slice(&self.at);
        }
    }

    /// A part from where the search begins; its end goes to `at`.
    fn part(
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

    /// The end of a part from where the search begins, as if there were no limits, in `at`.
    fn trial(&mut self, stretch: &Stretch<'_>, (begin, end): (f64, f64), work: &mut Workspace) {
        stretch.feed((begin, end), &mut self.drive);
        let step =
            Step { t: stretch.t + begin, h: end - begin, x: &self.start, drive: &self.drive, known: stretch.known };
        stretch.dynamics.step(step, &mut self.at, work);
    }

    /// The rate of a state where a trial has ended.
    fn rate(&mut self, stretch: &Stretch<'_>, (at, state): (f64, usize), work: &mut Workspace) -> f64 {
        let row = &mut self.drive[..stretch.dynamics.layout().drive()];
        stretch.drive_at(at, row);
        let point = Point { t: stretch.t + at, x: &self.at, drive: row, known: stretch.known };
        stretch.dynamics.rates(point, &mut self.rates[1], work);
        self.rates[1][state]
    }

    /// The first instant behind `begin`.
    fn earliest(&mut self, stretch: &Stretch<'_>, begin: f64, work: &mut Workspace) -> Option<(f64, Turn)> {
        let layout = stretch.dynamics.layout();
        let row = &mut self.drive[..layout.drive()];
        stretch.drive_at(begin, row);
        let point = Point { t: stretch.t + begin, x: &self.start, drive: row, known: stretch.known };
        stretch.dynamics.rates(point, &mut self.rates[0], work);
        let mut found: Option<(f64, Turn)> = None;
        for row in 0..2 * layout.limited.len() {
            let (state, outward) = (layout.limited[row / 2] as usize, if row % 2 == 0 { -1.0 } else { 1.0 });
            let limit = stretch.known[layout.limits.start + row];
            // how far it is outside, at both ends, and by how much that grows over the step at its first rate
            let [from, to] = [self.start[state], self.end[state]].map(|x| outward * (x - limit));
            let growth = outward * self.rates[0][state] * (stretch.h - begin);
            let held = from >= 0.0 && !self.left[row / 2] && (growth > 0.0 || growth == 0.0 && to > 0.0);
            let turn = Turn { state, row, leaves: held };
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
        found
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
        let finest = 2.0 * f64::EPSILON * stretch.h;
        Some(root(inward, [begin, stretch.h], [under / length, over], finest).low)
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
            outward * (self.at[state] - limit)
        };
        let [low, high] = parts.map(|part| begin + part * (stretch.h - begin));
        let [under, over] = [outside(low), outside(high)];
        let crosses = under < 0.0 && over > 0.0;
        let finest = 2.0 * f64::EPSILON * stretch.h;
        crosses.then(|| root(outside, [low, high], [under, over], finest).low)
    }
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
