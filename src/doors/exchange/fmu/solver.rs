//! The integration of a unit in co-simulation: steps as long as the tolerance allows, each compared with two of half its length (Hairer,
//! Norsett & Wanner, Solving ordinary differential equations I, II.4).
//!
//! Steps end where an input or its slope jumps, seen delayed too, and are no longer than the shortest delay of a state: what they see is
//! then known. Explicit steps are tried against implicit ones from time to time, and the method that comes further for its work is
//! kept: stiff models need no option.

use super::delays::{Now, Open, Past, bends};
use super::instance::{Instance, Moving, Refused};
use super::variables::Kind;
use fdm_grammar::graph::Signal;
use fdm_system::dynamics::{Dynamics, Point, Step};
use fdm_system::simulate::{Scheme, SingleStep, rests, shortened, step_factor, take_back};
use serde::{Deserialize, Serialize};

/// Most attempts in a communication step.
const MOST_STEPS: usize = 2_000_000;
/// Explicit steps before implicit ones are tried; steps of a trial, of which the first find their length; and implicit steps before
/// explicit ones are tried again.
const EXPLICIT: u32 = 50;
const TRIAL: u32 = 8;
const SETTLING: u32 = 4;
const IMPLICIT: u32 = 400;

/// How far the choice between the methods has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Phase {
    Explicit,
    TryImplicit,
    Implicit,
    TryExplicit,
}

/// What one step hands on to the next.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Pace {
    /// Length of the next step, where nothing stands in its way.
    wanted: f64,
    /// Largest magnitude of each state so far (n).
    pub(super) sizes: Vec<f64>,
    phase: Phase,
    /// Steps in this phase, time that they covered, and their work.
    steps: u32,
    span: f64,
    work: f64,
    /// Time for work of the other method.
    other: f64,
    /// Explicit steps before the next trial.
    wait: u32,
}

impl Pace {
    pub(super) fn new(states: usize) -> Self {
        Self {
            wanted: f64::INFINITY,
            sizes: vec![0.0; states],
            phase: Phase::Explicit,
            steps: 0,
            span: 0.0,
            work: 0.0,
            other: 0.0,
            wait: EXPLICIT,
        }
    }

    fn scheme(&self) -> Scheme {
        match self.phase {
            Phase::Explicit | Phase::TryExplicit => Scheme::RungeKutta,
            Phase::Implicit | Phase::TryImplicit => Scheme::Radau,
        }
    }

    /// Counts a step of length h, and changes the method where the other one comes further.
    fn count(&mut self, h: f64, may_be_implicit: bool) {
        self.steps += 1;
        if matches!(self.phase, Phase::TryImplicit | Phase::TryExplicit) && self.steps == SETTLING {
            (self.span, self.work) = (0.0, 0.0);
        } else {
            self.span += h;
        }
        let rate = self.span / self.work.max(1.0);
        let next = match self.phase {
            Phase::Explicit if may_be_implicit && self.steps >= self.wait => Phase::TryImplicit,
            Phase::TryImplicit if self.steps >= TRIAL && rate > self.other => Phase::Implicit,
            Phase::TryImplicit if self.steps >= TRIAL => {
                // longest time between two trials, in steps
                self.wait = (2 * self.wait).min(1 << 20);
                Phase::Explicit
            }
            Phase::Implicit if self.steps >= IMPLICIT => Phase::TryExplicit,
            Phase::TryExplicit if self.steps >= EXPLICIT && rate > self.other => {
                self.wait = EXPLICIT;
                Phase::Explicit
            }
            Phase::TryExplicit if self.steps >= EXPLICIT => Phase::Implicit,
            _ => return,
        };
        if matches!(next, Phase::TryImplicit | Phase::TryExplicit) {
            self.other = rate;
        }
        (self.phase, self.steps, self.span, self.work) = (next, 0, 0.0, 0.0);
    }
}

/// Memory of the integration of one model.
pub(super) struct Solver {
    explicit: SingleStep,
    implicit: Option<SingleStep>,
    may_be_implicit: bool,
    drive: Vec<f64>,
    coarse: Vec<f64>,
    middle: Vec<f64>,
    fine: Vec<f64>,
    /// Inputs at both ends of the communication step.
    inputs: [Vec<f64>; 2],
    /// Rates at the beginning, the end and the middle of a step, and how states bend between.
    rates: [Vec<f64>; 3],
    bends: [Vec<f64>; 2],
}

/// What a step needs to know of the communication step that it belongs to.
#[derive(Clone, Copy)]
struct Course<'a> {
    dynamics: &'a dyn Dynamics,
    past: &'a Past,
    known: &'a [f64],
    /// When the model's time is 0.
    start: f64,
    piece: Open<'a>,
}

impl Course<'_> {
    /// Inputs and delayed signals at a time of a step that began at `begin.0` with the states `begin.1`; just before or behind what may
    /// stand there as `side` says.
    fn fill(&self, (from, x): (f64, &[f64]), (t, side): (f64, f64), row: &mut [f64]) -> Result<(), usize> {
        let (layout, piece) = (self.dynamics.layout(), self.piece);
        let part = if t >= piece.to { 1.0 } else { (t - piece.from) / (piece.to - piece.from) };
        for (k, value) in row[..layout.inputs].iter_mut().enumerate() {
            let (a, b) = (piece.first[k], piece.last[k]);
            *value = if part == 1.0 { b } else { a + part * (b - a) };
        }
        let states = Open { from, to: from, first: x, last: x };
        let now = Now { inputs: piece, states, rates: x };
        for (d, signal) in layout.delayed.iter().enumerate() {
            let tau = self.known[layout.tau.start + d];
            let vanishing = matches!(signal, Signal::Input(k) if layout.vanishing.contains(k));
            let s = t - tau + side * 8.0 * f64::EPSILON * (t.abs() + tau);
            row[layout.inputs + d] = self.past.seen(*signal, vanishing, s, &now).ok_or(d)?.value;
        }
        Ok(())
    }

    /// Rates at an end of a step, of states that rest at a limit too; where a signal jumps just there, on this side of it.
    fn raw(
        &self,
        (t, side): (f64, f64),
        x: &[f64],
        row: &mut [f64],
        steps: &mut SingleStep,
        out: &mut [f64],
    ) -> Result<(), usize> {
        self.fill((t, x), (t, side), row)?;
        steps.rates(self.dynamics, Point { t: t - self.start, x, drive: row, known: self.known }, out);
        Ok(())
    }

    /// Rates at a point, 0 where a state rests.
    fn rates(
        &self,
        at: (f64, f64),
        x: &[f64],
        row: &mut [f64],
        steps: &mut SingleStep,
        out: &mut [f64],
    ) -> Result<(), usize> {
        self.raw(at, x, row, steps, out)?;
        let layout = self.dynamics.layout();
        for state in layout.limited.iter().map(|s| *s as usize) {
            if rests(layout, self.known, state, x[state], out[state]) {
                out[state] = 0.0;
            }
        }
        Ok(())
    }
}

/// Why a step was not taken.
enum Lost {
    /// Its end is not finite, or cannot be found.
    Unsolved,
    /// A delayed signal (by index) reaches further back than what was kept.
    Forgotten(usize),
}

impl Solver {
    pub(super) fn new(dynamics: &dyn Dynamics) -> Self {
        let layout = dynamics.layout();
        let states = || vec![0.0; layout.states];
        Self {
            explicit: SingleStep::new(dynamics, Scheme::RungeKutta),
            implicit: None,
            may_be_implicit: SingleStep::may_be_implicit(layout),
            drive: vec![0.0; 3 * layout.drive()],
            coarse: states(),
            middle: states(),
            fine: states(),
            inputs: [vec![0.0; layout.inputs], vec![0.0; layout.inputs]],
            rates: [states(), states(), states()],
            bends: [states(), states()],
        }
    }

    /// Moves an instance on by a communication step, its inputs by their slopes.
    pub(super) fn cross(&mut self, instance: &mut Instance, length: f64) -> Result<(), Refused> {
        let (from, to) = (instance.moving.time, instance.moving.time + length);
        if to <= from {
            return Ok(());
        }
        let Moving { inputs, slopes, .. } = &instance.moving;
        let mut ends = std::mem::take(&mut self.inputs);
        ends[0].copy_from_slice(inputs);
        ends[1].iter_mut().zip(inputs).zip(slopes).for_each(|((end, u), slope)| *end = u + slope * length);
        let piece = Open { from, to, first: &ends[0], last: &ends[1] };
        let crossed = match instance.states() {
            0 => Ok(()),
            _ => self.integrate(instance, piece),
        };
        if crossed.is_ok() {
            instance.moving.time = to;
        }
        let reached = instance.moving.time;
        if reached > from {
            let part = (reached - from) / (to - from);
            let moving = &mut instance.moving;
            for (k, u) in moving.inputs.iter_mut().enumerate() {
                *u = if part == 1.0 { ends[1][k] } else { ends[0][k] + part * (ends[1][k] - ends[0][k]) };
            }
            let last = &moving.inputs;
            moving.past.inputs(Open { from, to: reached, first: &ends[0], last });
            instance.forget();
        }
        self.inputs = ends;
        crossed
    }

    /// The shortest delay of a state.
    fn shortest(instance: &Instance) -> Result<f64, Refused> {
        let layout = instance.layout();
        let mut shortest = f64::INFINITY;
        for (d, signal) in layout.delayed.iter().enumerate() {
            let tau = instance.known[layout.tau.start + d];
            if tau < 0.0 || tau.is_nan() {
                return Err(Refused::Ahead { name: instance.delayed_name(d), tau });
            }
            if let Signal::State(_) = signal {
                if tau == 0.0 {
                    return Err(Refused::NoDelay(instance.delayed_name(d)));
                }
                shortest = shortest.min(tau);
            }
        }
        Ok(shortest)
    }

    fn integrate(&mut self, instance: &mut Instance, piece: Open<'_>) -> Result<(), Refused> {
        let reach = Self::shortest(instance)?;
        let delays_states = reach.is_finite();
        let (model, known) = (instance.model.clone(), std::mem::take(&mut instance.known));
        let layout = model.layout();
        let (tau, tolerance) = (&known[layout.tau.clone()], instance.moving.tolerance);
        let mut crossed = Ok(());
        let mut attempts = 0;
        while crossed.is_ok() && instance.moving.time < piece.to {
            let moving = &mut instance.moving;
            let Moving { time, x, past, pace, .. } = moving;
            let t = *time;
            let course = Course { dynamics: model.dynamics(), past, known: &known, start: moving.start, piece };
            if attempts == 0 {
                self.gauge(&course, pace, (t, x), (piece.to - t).min(reach));
            }
            let stop = past.next_kink(t, tau).map_or(piece.to, |kink| kink.min(piece.to));
            let (end, h) = reached(t, stop, pace.wanted.min(reach));
            attempts += 1;
            if attempts > MOST_STEPS {
                crossed = Err(Refused::TooManySteps(MOST_STEPS));
                break;
            }
            let scheme = pace.scheme();
            pace.work += if scheme == Scheme::Radau { 10.0 + 3.0 * layout.states as f64 } else { 1.0 };
            let tried = self.attempt(&course, scheme, (t, x), (end, h), &pace.sizes);
            let tried = tried.and_then(|error| {
                let kept = self.left_late(&course, (t, x), (end, h), &pace.sizes)?;
                Ok(error.max(kept))
            });
            let error = match tried {
                Ok(error) => error,
                Err(Lost::Forgotten(d)) => {
                    crossed = Err(Refused::Forgotten { name: instance.delayed_name(d), tau: tau[d] });
                    break;
                }
                Err(Lost::Unsolved) => f64::INFINITY,
            };
            if error > tolerance {
                let shorter = shortened(scheme, tolerance, error.is_finite().then_some(error));
                pace.wanted = h * shorter;
                // shortest step beside the time
                if pace.wanted <= (4.0 * f64::EPSILON) * t.abs().max(piece.to.abs()) {
                    let lost = self.coarse.iter().position(|x| !x.is_finite()).filter(|_| error.is_infinite());
                    crossed = Err(match lost {
                        Some(k) => Refused::Diverged { name: instance.name(Kind::State(k)), time: t },
                        None => Refused::NoStep { time: t, tolerance },
                    });
                }
                continue;
            }
            let longer = h * step_factor(scheme, tolerance, error);
            // a step that was cut by a stop says nothing against longer ones
            pace.wanted = if h < pace.wanted { pace.wanted.max(longer) } else { longer };
            if delays_states {
                let [first, last, between] = &mut self.rates;
                let row = &mut self.drive[..layout.drive()];
                let mut rates =
                    |at: (f64, f64), x: &[f64], out: &mut [f64]| course.rates(at, x, row, &mut self.explicit, out);
                let found = rates((t, 1.0), x, first)
                    .and_then(|()| rates((end, -1.0), &self.fine, last))
                    .and_then(|()| rates((t + 0.5 * h, 0.0), &self.middle, between));
                if let Err(d) = found {
                    crossed = Err(Refused::Forgotten { name: instance.delayed_name(d), tau: tau[d] });
                    break;
                }
                let [c0, c1] = &mut self.bends;
                for k in 0..layout.states {
                    let ends = [x[k], self.fine[k], first[k], last[k]];
                    [c0[k], c1[k]] = bends(h, ends, (self.middle[k], between[k]));
                }
                past.states(Open { from: t, to: end, first: x, last: &self.fine }, [first, last], [c0, c1]);
                past.passed(end, tau);
            }
            x.copy_from_slice(&self.fine);
            pace.sizes.iter_mut().zip(&*x).for_each(|(size, x)| *size = size.max(x.abs()));
            pace.count(h, self.may_be_implicit);
            *time = end;
        }
        instance.known = known;
        crossed
    }

    /// Sizes of states that were 0 until now: those of one long step, which the damped implicit method takes whatever its length. A state
    /// far down a chain grows from zero by a high power of time, and no step is short enough for a part of that.
    fn gauge(&mut self, course: &Course<'_>, pace: &mut Pace, (t, x): (f64, &[f64]), h: f64) {
        pace.sizes.iter_mut().zip(x).for_each(|(size, x)| *size = size.max(x.abs()));
        if pace.sizes.iter().all(|size| *size > 0.0) {
            return;
        }
        let scheme = if self.may_be_implicit { Scheme::Radau } else { Scheme::RungeKutta };
        if self.take(course, scheme, (t, x), (t + h, h), Which::Coarse).is_ok() {
            pace.sizes.iter_mut().zip(&self.coarse).for_each(|(size, x)| *size = size.max(x.abs()));
        }
    }

    /// The error of a step, its end in `fine`.
    fn attempt(
        &mut self,
        course: &Course<'_>,
        scheme: Scheme,
        (t, x): (f64, &[f64]),
        (end, h): (f64, f64),
        sizes: &[f64],
    ) -> Result<f64, Lost> {
        let (half, middle) = (0.5 * h, t + 0.5 * h);
        self.take(course, scheme, (t, x), (end, h), Which::Coarse)?;
        self.take(course, scheme, (t, x), (middle, half), Which::Middle)?;
        let from = std::mem::take(&mut self.middle);
        let taken = self.take(course, scheme, (middle, &from), (end, h - half), Which::Fine);
        self.middle = from;
        taken?;
        let halving = f64::from((1_u32 << scheme.order()) - 1);
        let mut worst = 0.0_f64;
        for ((coarse, fine), size) in self.coarse.iter().zip(&mut self.fine).zip(sizes) {
            let size = size.max(fine.abs()).max(f64::MIN_POSITIVE);
            let difference = *fine - coarse;
            // differences below this part of a state's size are rounding
            let error = (difference.abs() - (4.0 * f64::EPSILON) * size).max(0.0) / halving / size;
            worst = if error > worst || error.is_nan() { error } else { worst };
            // Richardson's extrapolation; of the implicit method's result it would give up the damping
            if scheme == Scheme::RungeKutta {
                *fine += difference / halving;
            }
        }
        take_back(course.dynamics.layout(), course.known, &mut self.fine, |_, _| {});
        if worst.is_nan() { Err(Lost::Unsolved) } else { Ok(worst) }
    }

    /// The error of a step in which a state leaves its limit, or comes to rest there and should have left it again: comparing steps is
    /// blind to that where both end at the limit.
    fn left_late(
        &mut self,
        course: &Course<'_>,
        (t, x): (f64, &[f64]),
        (end, h): (f64, f64),
        sizes: &[f64],
    ) -> Result<f64, Lost> {
        let layout = course.dynamics.layout();
        if layout.limited.is_empty() {
            return Ok(0.0);
        }
        let [first, last, _] = &mut self.rates;
        let row = &mut self.drive[..layout.drive()];
        course.raw((t, 1.0), x, row, &mut self.explicit, first).map_err(Lost::Forgotten)?;
        course.raw((end, -1.0), &self.fine, row, &mut self.explicit, last).map_err(Lost::Forgotten)?;
        let mut worst = 0.0_f64;
        for (k, state) in layout.limited.iter().map(|s| *s as usize).enumerate() {
            let (a, b) = (x[state], self.fine[state]);
            let size = sizes[state].max(b.abs()).max(f64::MIN_POSITIVE);
            for (side, outwards) in [-1.0, 1.0].into_iter().enumerate() {
                let limit = course.known[layout.limits.start + 2 * k + side];
                // what the state has moved too little or too much is at most the rate that should not have counted, for the whole step
                if b == limit && outwards * last[state] < 0.0 {
                    worst = worst.max(last[state].abs() * h / size);
                }
                if a == limit && b != limit && outwards * first[state] > 0.0 {
                    worst = worst.max(first[state].abs() * h / size);
                }
            }
        }
        Ok(worst)
    }

    fn take(
        &mut self,
        course: &Course<'_>,
        scheme: Scheme,
        (t, x): (f64, &[f64]),
        (end, h): (f64, f64),
        which: Which,
    ) -> Result<(), Lost> {
        let width = course.dynamics.layout().drive();
        let nodes = SingleStep::nodes(scheme);
        for (row, node) in self.drive.chunks_exact_mut(width.max(1)).zip(nodes).filter(|_| width > 0) {
            let (at, side) =
                if node == 1.0 { (end, -1.0) } else { (t + node * h, if node == 0.0 { 1.0 } else { 0.0 }) };
            course.fill((t, x), (at, side), row).map_err(Lost::Forgotten)?;
        }
        let steps = match scheme {
            Scheme::Radau => self.implicit.get_or_insert_with(|| SingleStep::new(course.dynamics, Scheme::Radau)),
            _ => &mut self.explicit,
        };
        // a step depends on nothing but its arguments, so that a restored state goes on with the same bits
        steps.begin();
        let next = match which {
            Which::Coarse => &mut self.coarse,
            Which::Middle => &mut self.middle,
            Which::Fine => &mut self.fine,
        };
        let step = Step { t: t - course.start, h, x, drive: &self.drive, known: course.known };
        if steps.take(course.dynamics, step, next) { Ok(()) } else { Err(Lost::Unsolved) }
    }
}

/// Where a step's end goes.
#[derive(Clone, Copy)]
enum Which {
    Coarse,
    Middle,
    Fine,
}

/// End and length of the next step: as long as wanted, and in equal parts when the rest is no more than two of that.
fn reached(t: f64, stop: f64, wanted: f64) -> (f64, f64) {
    let rest = stop - t;
    if wanted >= rest * (1.0 - 1e-9) {
        (stop, rest)
    } else {
        let h = if 2.0 * wanted >= rest { 0.5 * rest } else { wanted };
        (t + h, h)
    }
}
