//! Sensitivities across events and kinks, and where states meet or leave their limits: the exact derivative of the discrete response.
//!
//! Let a part of a step lead from x to `Phi(x, sigma)`, where the guard g is zero, and let r be the values behind the event. Then
//! `sigma_theta = -(g_x S + g_theta)/(g_x Phi_sigma + g_t)` with S before the event at fixed sigma, and behind it
//! `S+ = r_x (S + Phi_sigma sigma_theta) + r_theta + r_t sigma_theta`. The rest of the step begins at the instant and is the shorter
//! the later that is. In the limit of short steps this is the saltation matrix (Leine & Nijmeijer, Dynamics and bifurcations
//! of non-smooth mechanical systems, 2004, chapter 7).

use super::blocks::Sink;
use super::cuts::Turn;
use super::cuts::take_back;
use super::error::Divergence;
use super::events::{EventEntries, Follower, Jump, Part, Stretch, by_time, guard_rate};
use super::tangent::Sensitivity;
use super::tangent::TangentPlan;
use super::trajectory::{Trajectory, finite, two_nodes};
use crate::dynamics::{Layout, Point, Step, Workspace};
use fdm_numeric::lanes::{Aligned, accumulate};

/// A guard that grows at its instant by less than this part of its growth over the step only touches zero, as far as rounding
/// tells: where it touches, an error of `eps` moves the instant by the root of that, and the slope is as small.
const TOUCHES: f64 = 1e-7;
/// A guard's rate below this part of the terms that cancel in it only touches zero.
const CANCELS: f64 = 1e-10;

/// A run of a model with events for which the trajectory is prepared.
pub(super) fn run(
    sensitivity: &mut Sensitivity,
    trajectory: &mut Trajectory<'_>,
    sink: &mut Sink<'_>,
) -> Result<(), Divergence> {
    let mut memory = Memory::new(trajectory.dynamics.layout());
    let steps = trajectory.grid.steps();
    for k in 0..=steps {
        if let Some(sample) = trajectory.grid.sample_at(k) {
            sensitivity.observe(trajectory, sample, k, sink)?;
        }
        if k < steps {
            advance(sensitivity, &mut memory, trajectory, k)?;
        }
    }
    sensitivity.flush(sink);
    Ok(())
}

/// One step of states and sensitivities.
fn advance(
    sensitivity: &mut Sensitivity,
    memory: &mut Memory,
    trajectory: &mut Trajectory<'_>,
    k: usize,
) -> Result<(), Divergence> {
    let Sensitivity { plan, s, scratch, lanes, .. } = sensitivity;
    let Trajectory { dynamics, grid, drive, known, nodes, work, .. } = &mut *trajectory;
    let (t, h) = grid.step(k);
    let (x, next) = two_nodes(nodes, k);
    let step = Step { t, h, x, drive: drive.stages(k), known };
    dynamics.step_with_partials(step, next, &mut memory.stages, work);
    memory.whole = true;
    let mut parts = Parts { plan, s, scratch, lanes: *lanes, memory };
    trajectory.cut(k, &mut parts);
    trajectory.hold(k);
    finite(&trajectory.grid, k, two_nodes(&mut trajectory.nodes, k).1)?;
    trajectory.across(k, &mut parts)?;
    if memory.whole {
        plan.advance(h, &memory.stages, s, scratch);
        trajectory.stops.follow(k, &trajectory.known, s);
    }
    Ok(())
}

/// Memory between the parts of a step.
struct Memory {
    /// Whether the step has no event.
    whole: bool,
    /// Partials at the four stages of a part.
    stages: Aligned,
    /// Derivative of the last instant by the parameters (lanes).
    instant: Aligned,
    /// Derivative of the end of a part by its length (n).
    by_length: Vec<f64>,
    /// Tangents at a stage and at its predecessor, the end's, the stage itself, f_t, entries of f_u and h_u.
    tangents: [Vec<f64>; 3],
    x: Vec<f64>,
    by_time: Vec<f64>,
    by_input: Vec<f64>,
    /// Partials at an instant; switching functions of the rates with theirs.
    partials: Aligned,
    switches: Vec<f64>,
    /// Drive at a stage, rows behind an event (n by lanes), states that are held at the end of a part with their limits.
    rows: Aligned,
    held: Vec<(usize, usize)>,
}

impl Memory {
    fn new(layout: &Layout) -> Self {
        let (n, lanes) = (layout.states, layout.stage.lanes);
        Self {
            whole: true,
            stages: Aligned::new(4 * layout.stage.width),
            instant: Aligned::new(lanes),
            partials: Aligned::new(layout.stage.width),
            switches: vec![0.0; if layout.kinks > 0 { layout.event_slots() } else { 0 }],
            by_length: vec![0.0; n],
            tangents: std::array::from_fn(|_| vec![0.0; n]),
            x: vec![0.0; n],
            by_time: vec![0.0; n],
            by_input: vec![0.0; layout.input_slots()],
            rows: Aligned::new(n * lanes),
            held: Vec::with_capacity(layout.limited.len()),
        }
    }

    /// What the end of a part gains, in `tangents[2]` (n), while its beginning moves by `begin` and its length by `length`, from the
    /// same states: the step of the classical method differentiated, stage by stage.
    fn moved(&mut self, stretch: &Stretch<'_>, part: &Part<'_>, (begin, length): (f64, f64), work: &mut Workspace) {
        let layout = stretch.dynamics.layout();
        let (n, width, drive) = (layout.states, layout.stage.width, layout.drive());
        let Step { t, h, x, .. } = part.step(stretch);
        let [slope, before, sum] = &mut self.tangents;
        sum.fill(0.0);
        for (stage, (row, reach, weight)) in
            [(0, 0.0, 1.0), (1, 0.5, 2.0), (1, 0.5, 2.0), (2, 1.0, 1.0)].into_iter().enumerate()
        {
            let partials = &self.stages[stage * width..][..width];
            let predecessor = stage.checked_sub(1).map(|p| &self.stages[p * width..][..n]);
            for i in 0..n {
                self.x[i] = x[i] + predecessor.map_or(0.0, |k| h * reach * k[i]);
            }
            let at = Point {
                t: t + h * reach,
                x: &self.x,
                drive: &part.drive[row * drive..][..drive],
                known: stretch.known,
            };
            self.by_time.fill(0.0);
            stretch.dynamics.rates_by_time(at, &mut self.by_time, work);
            stretch.dynamics.by_input(at, &mut self.by_input, work);
            for (k, i, j) in layout.patterns.rates_by_input.entries() {
                self.by_time[i] += self.by_input[k] * stretch.slope(j);
            }
            let moment = begin + reach * length;
            for (i, slope) in slope.iter_mut().enumerate() {
                *slope = self.by_time[i] * moment;
            }
            for (slot, (_, i, j)) in layout.stage.by_state.iter().zip(layout.patterns.rates_by_state.entries()) {
                let at_stage = predecessor.map_or(0.0, |k| reach * (length * k[j] + h * before[j]));
                slope[i] += partials[*slot as usize] * at_stage;
            }
            for i in 0..n {
                sum[i] += weight / 6.0 * (length * partials[i] + h * slope[i]);
            }
            std::mem::swap(slope, before);
        }
        self.held.iter().for_each(|(state, _)| sum[*state] = 0.0);
    }

    /// By how much the rate of a state grows in time behind a part, and in `instant` (lanes) by the parameters at that time.
    fn rate_grows(
        &mut self,
        stretch: &Stretch<'_>,
        (state, at): (usize, Point<'_>),
        s: &[f64],
        work: &mut Workspace,
    ) -> f64 {
        let (layout, dynamics) = (stretch.dynamics.layout(), stretch.dynamics);
        let (stage, lanes) = (&layout.stage, layout.stage.lanes);
        dynamics.rates_and_partials(at, &mut self.partials, work);
        self.by_time.fill(0.0);
        dynamics.rates_by_time(at, &mut self.by_time, work);
        dynamics.by_input(at, &mut self.by_input, work);
        let mut grows = self.by_time[state];
        for (k, j) in layout.patterns.rates_by_input.row(state) {
            grows += self.by_input[k] * stretch.slope(j);
        }
        self.instant.copy_from_slice(&self.partials[stage.forcing + state * lanes..][..lanes]);
        for (k, j) in layout.patterns.rates_by_state.row(state) {
            let partial = self.partials[stage.by_state[k] as usize];
            grows += partial * self.by_length[j];
            accumulate(partial, &s[j * lanes..][..lanes], &mut self.instant);
        }
        grows
    }
}

/// Gives a state, by index and row of its limit, the sensitivity of that limit.
fn hold(stretch: &Stretch<'_>, (state, row): (usize, usize), s: &mut [f64], lanes: usize) {
    let layout = stretch.dynamics.layout();
    let sensitivity = &mut s[state * lanes..][..lanes];
    sensitivity.fill(0.0);
    for (k, j) in layout.patterns.limits_by_param.row(row) {
        if let Some(lane) = layout.stage.lane[j] {
            sensitivity[lane as usize] = stretch.known[layout.limits_by_param.start + k];
        }
    }
}

/// A row of partials of `events_and_partials` times the sensitivities, and its own by the parameters (lanes).
fn along(layout: &Layout, partials: &[f64], row: usize, s: &[f64], to: &mut [f64]) {
    let (patterns, entries, lanes) = (&layout.patterns, EventEntries::new(layout), layout.stage.lanes);
    to.fill(0.0);
    for (k, j) in patterns.events_by_state.row(row) {
        accumulate(partials[entries.by_state + k], &s[j * lanes..][..lanes], to);
    }
    for (k, j) in patterns.events_by_param.row(row) {
        if let Some(lane) = layout.stage.lane[j] {
            to[lane as usize] += partials[entries.by_param + k];
        }
    }
}

/// The sensitivities of a step that events, limits or kinks cut.
struct Parts<'a> {
    plan: &'a TangentPlan,
    /// n by lanes.
    s: &'a mut Aligned,
    scratch: &'a mut Aligned,
    lanes: usize,
    memory: &'a mut Memory,
}

impl Follower for Parts<'_> {
    fn part(&mut self, stretch: &Stretch<'_>, part: Part<'_>, next: &mut [f64], work: &mut Workspace) {
        let Self { plan, s, scratch, lanes, memory } = self;
        let layout = stretch.dynamics.layout();
        let (step, lanes) = (part.step(stretch), *lanes);
        memory.whole = false;
        stretch.dynamics.step_with_partials(step, next, &mut memory.stages, work);
        plan.advance(step.h, &memory.stages, s, scratch);
        memory.held.clear();
        take_back(layout, stretch.known, next, |state, row| memory.held.push((state, row)));
        memory.held.iter().for_each(|held| hold(stretch, *held, s, lanes));
        if part.behind {
            // it begins later, and is as much shorter
            memory.moved(stretch, &part, (1.0, -1.0), work);
            for (moved, row) in memory.tangents[2].iter().zip(s.chunks_exact_mut(lanes.max(1))) {
                accumulate(*moved, &memory.instant, row);
            }
        }
        if part.before {
            memory.moved(stretch, &part, (0.0, 1.0), work);
            memory.by_length.copy_from_slice(&memory.tangents[2]);
        }
    }

    fn turn(&mut self, stretch: &Stretch<'_>, turn: Turn, at: Point<'_>, work: &mut Workspace) {
        let Self { s, lanes, memory, .. } = self;
        let (layout, lanes) = (stretch.dynamics.layout(), *lanes);
        let guard_grows = match turn {
            Turn::Limit { state, leaves: true, .. } => memory.rate_grows(stretch, (state, at), s, work),
            Turn::Kink { kink, growth } => {
                stretch.dynamics.events_and_partials(at, &mut memory.switches, work);
                along(layout, &memory.switches, kink, s, &mut memory.instant);
                let (rate, size) = guard_rate(stretch, &memory.switches, kink, &memory.by_length);
                let passes = rate.abs() > TOUCHES * growth && rate.abs() > CANCELS * size;
                if passes { rate } else { 0.0 }
            }
            Turn::Limit { state, row, leaves: false } => {
                memory.instant.copy_from_slice(&s[state * lanes..][..lanes]);
                for (k, j) in layout.patterns.limits_by_param.row(row) {
                    if let Some(lane) = layout.stage.lane[j] {
                        memory.instant[lane as usize] -= stretch.known[layout.limits_by_param.start + k];
                    }
                }
                memory.by_length[state]
            }
        };
        // what is only touched has no instant: nothing moves then
        let scale = if guard_grows == 0.0 { 0.0 } else { -1.0 / guard_grows };
        memory.instant.iter_mut().for_each(|lane| *lane *= scale);
        for (by_length, row) in memory.by_length.iter().zip(s.chunks_exact_mut(lanes.max(1))) {
            accumulate(*by_length, &memory.instant, row);
        }
        if let Turn::Limit { state, row, .. } = turn {
            hold(stretch, (state, row), s, lanes);
        }
    }

    fn event(&mut self, stretch: &Stretch<'_>, jump: Jump<'_>) -> bool {
        let Self { s, lanes, memory, .. } = self;
        let (layout, lanes) = (stretch.dynamics.layout(), *lanes);
        let partials = jump.partials;
        if let Some(growth) = jump.growth {
            let (rate, size) = guard_rate(stretch, partials, jump.event, &memory.by_length);
            let passes = rate > TOUCHES * growth && rate > CANCELS * size;
            if !passes {
                return false;
            }
            along(layout, partials, jump.event, s, &mut memory.instant);
            memory.instant.iter_mut().for_each(|lane| *lane /= -rate);
            for (by_length, row) in memory.by_length.iter().zip(s.chunks_exact_mut(lanes.max(1))) {
                accumulate(*by_length, &memory.instant, row);
            }
        }
        let sets = &layout.events[jump.event];
        for k in 0..sets.states.len() {
            let row = &mut memory.rows[k * lanes..][..lanes];
            along(layout, partials, sets.first + k, s, row);
            accumulate(by_time(stretch, partials, sets.first + k), &memory.instant, row);
        }
        for (k, state) in sets.states.iter().enumerate() {
            s[*state as usize * lanes..][..lanes].copy_from_slice(&memory.rows[k * lanes..][..lanes]);
        }
        true
    }
}
