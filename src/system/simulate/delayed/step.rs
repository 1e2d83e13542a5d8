//! One step of a model whose rates see delayed states ([`DelayedStates`]), and each delayed state as that step sees it ([`Lag`]).
//!
//! With delays not shorter than the step the past determines the drive. With a shorter one the drive depends on the step's
//! own cubic, that is on x1, f0 and f1 of the delayed states, which depend on the drive: 3 equations for each such state,
//! solved by Newton's method with their exact Jacobian until only rounding is left. The discrete equations have the order
//! of the explicit ones and go over into them as the delay grows past the step, without a jump.
//!
//! Sensitivities of a run that sees delayed states: `S' = f_x S + f_theta + f_delay (S delayed - slope tau_theta)`.
//!
//! The delayed sensitivities enter a step by the weights of the delayed states. Where a step sees itself they satisfy
//! linear equations, those of the last Newton correction, which are solved for all parameters at once.

use super::history::{Four, History, Share, sum};
use crate::dynamics::{Dynamics, Layout, Point, Step};
use crate::simulate::blocks::Sink;
use crate::simulate::cuts::rests;
use crate::simulate::delayed_inputs::StageValues;
use crate::simulate::error::Divergence;
use crate::simulate::steps::Grid;
use crate::simulate::tangent::{Sensitivity, add_delays};
use crate::simulate::trajectory::{Trajectory, diverged, finite, node, two_nodes};
use fdm_grammar::graph::Signal;
use fdm_numeric::dense::lu::{Lu, Rounded};
use fdm_numeric::lanes::{Aligned, Simd, WithSimd, accumulate, dispatch};

/// An entry of f_delay.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    /// Its slot in a stage's row.
    pub(super) slot: usize,
    /// The state whose rate it belongs to.
    pub(super) row: usize,
    /// Which lag.
    pub(super) lag: usize,
}

/// The row of the drive that each Runge-Kutta stage sees.
pub(super) const DRIVE_ROW: [usize; 4] = [0, 1, 1, 2];

/// Steps through delayed states.
pub(in crate::simulate) struct DelayedStates {
    pub(super) lags: Vec<Lag>,
    pub(super) entries: Vec<Entry>,
    /// Entries of f_x: slot in a stage's row, row, column.
    f_x: Vec<(usize, usize, usize)>,
    /// States that a step can see of itself.
    pub(super) unknown: Vec<usize>,
    /// Whether the step that is being taken sees itself.
    pub(super) short: bool,
    /// x1, f0, f1 of each unknown state.
    own: Vec<[f64; 3]>,
    pub(super) lu: Lu<Rounded>,
    correction: Vec<f64>,
    /// Results of `step_with_partials`, and of `rates_and_partials` at the end of the step.
    pub(super) partials: Aligned,
    pub(super) ends: Vec<f64>,
    pub(super) width: usize,
    /// Rates at both ends.
    pub(super) rates: [Vec<f64>; 2],
    /// Tangents: slopes of the stage before and of this one, states, sum, first slope.
    tangent: [Vec<f64>; 5],
}

impl DelayedStates {
    pub(in crate::simulate) fn new(layout: &Layout, history: &History) -> Self {
        let (p, stage, n) = (&layout.patterns, &layout.stage, layout.states);
        let (mut lags, mut unknown): (Vec<Lag>, Vec<usize>) = (Vec::new(), Vec::new());
        let mut entries = Vec::new();
        for (k, row, d) in p.rates_by_delayed.entries() {
            let Signal::State(state) = layout.delayed[d] else { continue };
            let state = state as usize;
            let lag = lags.iter().position(|lag: &Lag| lag.delayed == d).unwrap_or_else(|| {
                let place = unknown.iter().position(|u| *u == state).unwrap_or_else(|| {
                    unknown.push(state);
                    unknown.len() - 1
                });
                lags.push(Lag::new(d, history.slot(state), place));
                lags.len() - 1
            });
            entries.push(Entry { slot: stage.by_delayed + k, row, lag });
        }
        let f_x = p.rates_by_state.entries().zip(&stage.by_state).map(|((_, i, j), slot)| (*slot as usize, i, j));
        Self {
            lags,
            entries,
            f_x: f_x.collect(),
            short: false,
            own: vec![[0.0; 3]; unknown.len()],
            lu: Lu::new(0),
            correction: vec![0.0; 3 * unknown.len()],
            partials: Aligned::new(4 * stage.width),
            ends: vec![0.0; stage.width],
            width: stage.width,
            rates: [vec![0.0; n], vec![0.0; n]],
            tangent: std::array::from_fn(|_| vec![0.0; n]),
            unknown,
        }
    }

    /// Back to the beginning of a run with these delays.
    pub(in crate::simulate) fn begin(&mut self, tau: &[f64], grid: &Grid) {
        self.lags.iter_mut().for_each(Lag::begin);
        self.own.fill([0.0; 3]);
        let size = 3 * self.states_at_once(tau, grid);
        if self.lu.size() != size {
            self.lu = Lu::new(size);
        }
    }

    /// States that have to be found at once because a delay is shorter than a step.
    pub(in crate::simulate) fn states_at_once(&self, tau: &[f64], grid: &Grid) -> usize {
        let shortest = self.lags.iter().map(|lag| tau[lag.delayed]).fold(f64::INFINITY, f64::min);
        if (0..grid.steps()).any(|k| grid.step(k).1 > shortest) { self.unknown.len() } else { 0 }
    }

    /// Takes step k without sensitivities.
    pub(in crate::simulate) fn advance(&mut self, trajectory: &mut Trajectory<'_>, k: usize) -> Result<(), Divergence> {
        self.step(trajectory, k, &mut [], false)?;
        trajectory.hold(k);
        for (end, rates) in self.rates.iter_mut().enumerate() {
            rest(trajectory, k + end, rates, |_| {});
        }
        let Some(history) = &mut trajectory.history else { return Ok(()) };
        history.rates(0, &self.rates[0]);
        history.rates(1, &self.rates[1]);
        history.node(trajectory.grid.end(k), two_nodes(&mut trajectory.nodes, k).1, &[]);
        Ok(())
    }

    /// The states of node k + 1 and the rates at both ends of the step; sensitivities of what the step sees of the past go
    /// to `rows` (3 rows of lanes for each lag). `partials` and `ends` are filled when wanted, and when the step sees itself.
    #[inline(always)]
    pub(super) fn step(
        &mut self,
        trajectory: &mut Trajectory<'_>,
        k: usize,
        rows: &mut [f64],
        wanted: bool,
    ) -> Result<(), Divergence> {
        let (t, h) = trajectory.grid.step(k);
        self.short = false;
        if let Some(history) = &trajectory.history {
            let (tau, lanes) = (trajectory.dynamics.layout().tau.start, rows.len() / self.lags.len().max(1));
            for (k, lag) in self.lags.iter_mut().enumerate() {
                let tau = trajectory.known[tau + lag.delayed];
                self.short |= lag.look(history, (t, h), tau, &mut rows[k * lanes..][..lanes]);
            }
        }
        if self.short { self.implicit(trajectory, k) } else { self.explicit(trajectory, k, wanted) }
    }

    /// The drive is known.
    fn explicit(&mut self, trajectory: &mut Trajectory<'_>, k: usize, wanted: bool) -> Result<(), Divergence> {
        self.place(trajectory, k);
        if wanted {
            self.evaluate(trajectory, k);
            return finite(&trajectory.grid, k, two_nodes(&mut trajectory.nodes, k).1);
        }
        let Trajectory { dynamics, grid, drive, known, nodes, work, .. } = trajectory;
        let ((t, h), (x, next)) = (grid.step(k), two_nodes(nodes, k));
        let (stages, width) = (drive.stages(k), dynamics.layout().drive());
        dynamics.step(Step { t, h, x, drive: stages, known }, next, work);
        finite(grid, k, next)?;
        dynamics.rates(Point { t, x, drive: &stages[..width], known }, &mut self.rates[0], work);
        let at = Point { t: t + h, x: next, drive: &stages[2 * width..], known };
        dynamics.rates(at, &mut self.rates[1], work);
        Ok(())
    }

    /// The drive depends on the step.
    fn implicit(&mut self, trajectory: &mut Trajectory<'_>, k: usize) -> Result<(), Divergence> {
        let (h, failed) = (trajectory.grid.step(k).1, diverged(&trajectory.grid, k, None));
        self.predict(trajectory, k);
        let mut last = false;
        // newton iterations of one step before it counts as failed
        for count in 0..40 {
            self.place(trajectory, k);
            self.evaluate(trajectory, k);
            finite(&trajectory.grid, k, two_nodes(&mut trajectory.nodes, k).1)?;
            self.residual(trajectory, k);
            self.factor(h);
            let rounding = || self.size(trajectory, k) <= 2.0 * f64::EPSILON;
            // iterations that are enough for all but noise, as a rule
            if last || rounding() || (count > 6 && self.is_noise(trajectory, k)) {
                return Ok(());
            }
            self.lu.solve(&mut self.correction);
            let size = self.size(trajectory, k);
            if !size.is_finite() {
                return Err(failed);
            }
            // a correction this small leaves its square, which is nothing
            last = size < 1e-9;
            for (own, step) in self.own.iter_mut().zip(self.correction.as_chunks::<3>().0) {
                own.iter_mut().zip(step).for_each(|(own, step)| *own += step);
            }
        }
        Err(failed)
    }

    /// Goes on with the rates at the end of the step before.
    fn predict(&mut self, trajectory: &Trajectory<'_>, k: usize) {
        let h = trajectory.grid.step(k).1;
        let x = &trajectory.nodes[node(k)];
        for (state, own) in self.unknown.iter().zip(&mut self.own) {
            let rate = if k == 0 { 0.0 } else { self.rates[1][*state] };
            *own = [x[*state] + h * rate, rate, rate];
        }
    }

    /// Stage values and slopes of the delayed states to their places in the drive.
    fn place(&self, trajectory: &mut Trajectory<'_>, k: usize) {
        let x = &trajectory.nodes[node(k)];
        for lag in &self.lags {
            let [x1, f0, f1] = self.own[lag.unknown];
            let four: Four = [x[self.unknown[lag.unknown]], x1, f0, f1];
            trajectory.drive.place(k, lag.delayed, lag.seen(&four));
        }
    }

    /// The step with the drive in place, its partials, and the rates at both ends.
    fn evaluate(&mut self, trajectory: &mut Trajectory<'_>, k: usize) {
        let Trajectory { dynamics, grid, drive, known, nodes, work, .. } = trajectory;
        let ((t, h), (x, next)) = (grid.step(k), two_nodes(nodes, k));
        let (stages, width, n) = (drive.stages(k), dynamics.layout().drive(), x.len());
        dynamics.step_with_partials(Step { t, h, x, drive: stages, known }, next, &mut self.partials, work);
        let at = Point { t: t + h, x: next, drive: &stages[2 * width..], known };
        dynamics.rates_and_partials(at, &mut self.ends, work);
        self.rates[0].copy_from_slice(&self.partials[..n]);
        self.rates[1].copy_from_slice(&self.ends[..n]);
    }

    /// What the step gives for x1, f0 and f1, less what was assumed.
    fn residual(&mut self, trajectory: &mut Trajectory<'_>, k: usize) {
        let next = two_nodes(&mut trajectory.nodes, k).1;
        for ((state, own), r) in self.unknown.iter().zip(&self.own).zip(self.correction.as_chunks_mut::<3>().0) {
            *r = [next[*state] - own[0], self.rates[0][*state] - own[1], self.rates[1][*state] - own[2]];
        }
    }

    /// Largest correction as a part of the state and its motion over the step.
    fn size(&self, trajectory: &Trajectory<'_>, k: usize) -> f64 {
        let h = trajectory.grid.step(k).1;
        let x = &trajectory.nodes[node(k)];
        let mut worst = 0.0_f64;
        for ((state, own), r) in self.unknown.iter().zip(&self.own).zip(self.correction.as_chunks::<3>().0) {
            let size = r[0].abs() + h * (r[1].abs() + r[2].abs());
            // what is corrected counts, too: a state may leave zero in this step
            let scale = x[*state].abs() + own[0].abs() + h * (own[1].abs() + own[2].abs()) + size;
            if !scale.is_finite() {
                return f64::INFINITY;
            }
            if size > 0.0 {
                worst = worst.max(size / scale);
            }
        }
        worst
    }

    /// Whether nothing is left but what rounding of other states leaves of a state that should be zero.
    fn is_noise(&self, trajectory: &Trajectory<'_>, k: usize) -> bool {
        let h = trajectory.grid.step(k).1;
        let largest = trajectory.nodes[node(k)].iter().fold(0.0_f64, |l, x| l.max(x.abs()));
        let parts = self.correction.as_chunks::<3>().0;
        parts.iter().all(|r| r[0].abs() + h * (r[1].abs() + r[2].abs()) <= 1e-13 * largest)
    }

    /// Factors identity less the derivative of what the step gives by what is assumed. A singular one has solutions that are no numbers.
    fn factor(&mut self, h: f64) {
        let m = 3 * self.unknown.len();
        self.lu.clear();
        for column in 0..m {
            self.column(h, column / 3, 1 + column % 3);
            let [first, end, _, sum, _] = &self.tangent;
            for (row, state) in self.unknown.iter().enumerate() {
                for (k, part) in [sum, first, end].into_iter().enumerate() {
                    let row = 3 * row + k;
                    *self.lu.entry_mut(row, column) = f64::from(u8::from(row == column)) - part[*state];
                }
            }
        }
        if !self.lu.factorise(0.0) {
            self.lu.clear();
            (0..m).for_each(|k| *self.lu.entry_mut(k, k) = f64::NAN);
        }
    }

    /// Derivative of one step by one of the four of an unknown state: of the first rates, the last rates, and the states.
    fn column(&mut self, h: f64, unknown: usize, which: usize) {
        let Self { lags, entries, f_x, partials, ends, width, tangent, .. } = self;
        let [first, slope, x, sum, before] = tangent;
        let seen = |e: &Entry, row: usize| {
            let lag = &lags[e.lag];
            if lag.unknown == unknown { lag.own.value[row][which] } else { 0.0 }
        };
        let apply = |row: &[f64], drive: usize, x: &[f64], slope: &mut [f64]| {
            slope.fill(0.0);
            entries.iter().for_each(|e| slope[e.row] += row[e.slot] * seen(e, drive));
            f_x.iter().for_each(|(slot, i, j)| slope[*i] += row[*slot] * x[*j]);
        };
        sum.fill(0.0);
        before.fill(0.0);
        let reach = [0.0, 0.5 * h, 0.5 * h, h];
        let weight = [h / 6.0, h / 3.0, h / 3.0, h / 6.0];
        for stage in 0..4 {
            x.iter_mut().zip(before.iter()).for_each(|(x, k)| *x = reach[stage] * k);
            apply(&partials[stage * *width..][..*width], DRIVE_ROW[stage], x, slope);
            sum.iter_mut().zip(slope.iter()).for_each(|(s, k)| *s += weight[stage] * k);
            before.copy_from_slice(slope);
            if stage == 0 {
                first.copy_from_slice(slope);
            }
        }
        apply(ends, 2, sum, slope);
    }
}

/// Rates at a node of limited states that stand at a limit and are pushed outwards are zero: what a delay sees of them; says which.
#[inline(always)]
pub(super) fn rest(trajectory: &Trajectory<'_>, node_of: usize, rates: &mut [f64], mut at: impl FnMut(usize)) {
    let (layout, x) = (trajectory.dynamics.layout(), &trajectory.nodes[node(node_of)]);
    for state in layout.limited.iter().map(|s| *s as usize) {
        if rests(layout, &trajectory.known, state, x[state], rates[state]) {
            rates[state] = 0.0;
            at(state);
        }
    }
}

impl DelayedStates {
    /// Clears the rows of f_theta to which delays add; the model writes only its own entries.
    pub(super) fn clear(&mut self, layout: &Layout) {
        let (lanes, forcing) = (layout.stage.lanes, layout.stage.forcing);
        let Self { entries, partials, ends, width, .. } = self;
        for row in partials.chunks_exact_mut(*width).chain([&mut ends[..]]) {
            entries.iter().for_each(|e| row[forcing + e.row * lanes..][..lanes].fill(0.0));
        }
    }
}

/// A delayed state that the rates see.
#[derive(Debug, Clone)]
pub(super) struct Lag {
    /// Which of the model's delayed signals it is.
    pub(super) delayed: usize,
    /// Its place in the history.
    pub(super) slot: usize,
    /// Its place among the states that a step can see of itself.
    pub(super) unknown: usize,
    /// What the past alone contributes.
    past: StageValues,
    /// The share of the step that is being taken; zero when the delay is not shorter.
    pub(super) own: Share,
    /// Where the window began last; windows only move forward.
    cursor: usize,
}

impl Lag {
    pub(super) fn new(delayed: usize, slot: usize, unknown: usize) -> Self {
        let past = StageValues { value: [0.0; 3], slope: [0.0; 3] };
        Self { delayed, slot, unknown, past, own: Share::default(), cursor: 0 }
    }

    /// Back to the beginning of a run.
    pub(super) fn begin(&mut self) {
        self.cursor = 0;
    }

    /// Looks through the window of the step from t to t + h, delayed by tau; writes the sensitivities of the three
    /// stage values to `rows` (3 rows of lanes), as far as they come from nodes up to t. Whether the window reaches into
    /// the step itself.
    #[inline(always)]
    pub(super) fn look(&mut self, history: &History, (t, h): (f64, f64), tau: f64, rows: &mut [f64]) -> bool {
        let window = (t - tau, h);
        let (newest, lanes) = (history.newest(), rows.len() / 3);
        rows.fill(0.0);
        self.past = StageValues { value: [0.0; 3], slope: [0.0; 3] };
        // the weights of values in each stage, which should sum to 1
        let mut total = [0.0; 3];
        let end = (window.0 + h).min(t);
        let mut from = window.0;
        let first = history.first();
        self.cursor = self.cursor.max(history.oldest());
        if from < first {
            let weights = Share::constant((from, end.min(first)), window);
            for (stage, weight) in weights.into_iter().enumerate() {
                self.past.value[stage] += weight * history.value(0, self.slot);
                total[stage] += weight;
                history.add_value(0, self.slot, weight, &mut rows[stage * lanes..][..lanes]);
            }
            from = first;
        }
        while self.cursor < newest && history.time(self.cursor + 1) <= from {
            self.cursor += 1;
        }
        let mut node = self.cursor;
        while from < end && node < newest {
            let (begin, next) = (history.time(node), history.time(node + 1));
            let to = next.min(end);
            let share = Share::new((begin, next - begin), (from, to), window);
            let four = history.four(node, self.slot);
            for stage in 0..3 {
                self.past.value[stage] += sum(&share.value[stage], &four);
                self.past.slope[stage] += sum(&share.slope[stage], &four);
                total[stage] += share.value[stage][0] + share.value[stage][1];
                history.add_four(node, self.slot, &share.value[stage], &mut rows[stage * lanes..][..lanes]);
            }
            (from, node) = (to, node + 1);
        }
        self.look_ahead(history, (t, h), window, total, rows)
    }

    /// The part of the window that lies in the step itself; what rounding of the times left of the whole weight goes to the newest
    /// node, so that a constant is seen as it is however short the step.
    #[inline(always)]
    fn look_ahead(
        &mut self,
        history: &History,
        (t, h): (f64, f64),
        window: (f64, f64),
        total: [f64; 3],
        rows: &mut [f64],
    ) -> bool {
        let end = window.0 + h;
        // what rounding alone moves across t is not worth an implicit step
        let short = end - t > 8.0 * f64::EPSILON * (t.abs() + h);
        self.own = if short { Share::new((t, h), (window.0.max(t), end), window) } else { Share::default() };
        let (newest, lanes) = (history.newest(), rows.len() / 3);
        for stage in 0..3 {
            let own = &mut self.own.value[stage];
            own[0] = 1.0 - total[stage] - own[1];
            history.add_value(newest, self.slot, own[0], &mut rows[stage * lanes..][..lanes]);
        }
        short
    }

    /// Stage values and slopes when the step's own cubic has these four.
    #[inline]
    pub(super) fn seen(&self, own: &Four) -> StageValues {
        let mut seen = self.past;
        for stage in 0..3 {
            seen.value[stage] += sum(&self.own.value[stage], own);
            seen.slope[stage] += sum(&self.own.slope[stage], own);
        }
        seen
    }
}

/// Plans and memory for one choice of columns.
pub(in crate::simulate) struct DelayedSensitivity {
    /// S, its step, and how outputs are observed: as without delayed states.
    base: Sensitivity,
    forcing: usize,
    /// Entries of f_x of each state: slot in a stage's row, and column.
    f_x: Vec<Vec<(usize, usize)>>,
    trial: Aligned,
    /// Sensitivities of the stage values of each lag, 3 rows each.
    seen: Vec<f64>,
    /// Sensitivities of x1, f0 and f1 of the states that a step sees of itself.
    own: Vec<f64>,
    /// Limited states that rest at the beginning and at the end of the step.
    resting: [Vec<usize>; 2],
}

impl DelayedSensitivity {
    /// # Panics
    /// As [`Sensitivity::new`].
    pub(in crate::simulate) fn new(dynamics: &dyn Dynamics, columns: &[usize], delayed: &DelayedStates) -> Self {
        let (layout, base) = (dynamics.layout(), Sensitivity::new(dynamics, columns));
        let (n, lanes) = (layout.states, base.lanes);
        let f_x = &layout.patterns.rates_by_state;
        let row = |i: usize| f_x.row(i).map(|(k, j)| (layout.stage.by_state[k] as usize, j)).collect();
        Self {
            base,
            forcing: layout.stage.forcing,
            f_x: (0..n).map(row).collect(),
            trial: Aligned::new(n * lanes),
            seen: vec![0.0; 3 * lanes * delayed.lags.len()],
            own: vec![0.0; 3 * lanes * delayed.unknown.len()],
            resting: std::array::from_fn(|_| Vec::with_capacity(layout.limited.len())),
        }
    }

    pub(in crate::simulate) fn columns(&self) -> &[usize] {
        self.base.columns()
    }

    /// A whole run for which the trajectory is prepared.
    pub(in crate::simulate) fn run(
        &mut self,
        delayed: &mut DelayedStates,
        trajectory: &mut Trajectory<'_>,
        sink: &mut Sink<'_>,
    ) -> Result<(), Divergence> {
        self.base.begin(&trajectory.known);
        dispatch(March { sensitivity: self, delayed, trajectory, sink })
    }

    /// One step of states and sensitivities, and its memory.
    #[inline(always)]
    fn advance<S: Simd>(
        &mut self,
        simd: S,
        delayed: &mut DelayedStates,
        trajectory: &mut Trajectory<'_>,
        k: usize,
    ) -> Result<(), Divergence> {
        let layout = trajectory.dynamics.layout();
        delayed.clear(layout);
        delayed.step(trajectory, k, &mut self.seen, true)?;
        self.delays(layout, delayed, trajectory, k);
        self.force(delayed);
        let h = trajectory.grid.step(k).1;
        if delayed.short {
            self.close(simd, delayed, h);
        }
        trajectory.hold(k);
        for (end, resting) in self.resting.iter_mut().enumerate() {
            resting.clear();
            rest(trajectory, k + end, &mut delayed.rates[end], |state| resting.push(state));
        }
        let Trajectory { history: Some(history), known, stops, .. } = trajectory else { return Ok(()) };
        for end in 0..2 {
            if end == 1 {
                let Sensitivity { plan, s, scratch, .. } = &mut self.base;
                plan.step(simd, h, &delayed.partials, s, scratch);
                stops.follow(k, known, s);
            }
            let row = if end == 0 { &delayed.partials[..delayed.width] } else { &delayed.ends[..] };
            let (kept, rows) = history.rates(end, &delayed.rates[end]);
            for (state, to) in kept.iter().zip(rows.chunks_exact_mut(self.base.lanes.max(1))) {
                match self.resting[end].contains(state) {
                    true => to.fill(0.0),
                    false => self.slope(row, *state, &self.base.s, to),
                }
            }
        }
        history.node(trajectory.grid.end(k), &trajectory.nodes[node(k + 1)], &self.base.s);
        Ok(())
    }

    /// What the delays' own sensitivities add to f_theta: `-f_delay slope tau_theta`.
    #[inline(always)]
    fn delays(&mut self, layout: &Layout, delayed: &mut DelayedStates, trajectory: &Trajectory<'_>, k: usize) {
        let (slopes, delays) = (trajectory.drive.stage_slopes(k), layout.delayed.len());
        let DelayedStates { partials, ends, width, .. } = delayed;
        let rows = partials.chunks_exact_mut(*width).zip(DRIVE_ROW).chain([(&mut ends[..], 2)]);
        for (row, at) in rows {
            add_delays(&self.base.rates_by_delay, row, &slopes[at * delays..][..delays], &trajectory.known);
        }
    }

    /// Adds `f_delay S_delayed` to f_theta of the four stages and of the end.
    #[inline(always)]
    fn force(&self, delayed: &mut DelayedStates) {
        let (lanes, DelayedStates { partials, ends, width, entries, .. }) = (self.base.lanes, delayed);
        let rows = partials.chunks_exact_mut(*width).zip(DRIVE_ROW).chain([(&mut ends[..], 2)]);
        for (row, at) in rows {
            for e in entries.iter() {
                let seen = &self.seen[(3 * e.lag + at) * lanes..][..lanes];
                accumulate(row[e.slot], seen, &mut row[self.forcing + e.row * lanes..][..lanes]);
            }
        }
    }

    /// Solves for what the step sees of itself, and adds it to f_theta.
    #[inline(always)]
    fn close<S: Simd>(&mut self, simd: S, delayed: &mut DelayedStates, h: f64) {
        let lanes = self.base.lanes;
        let mut own = std::mem::take(&mut self.own);
        self.trial.copy_from_slice(&self.base.s);
        let Sensitivity { plan, scratch, .. } = &mut self.base;
        plan.step(simd, h, &delayed.partials, &mut self.trial, scratch);
        for (state, rows) in delayed.unknown.iter().zip(own.chunks_exact_mut(3 * lanes.max(1))) {
            let (x1, rates) = rows.split_at_mut(lanes);
            let (f0, f1) = rates.split_at_mut(lanes);
            x1.copy_from_slice(&self.trial[state * lanes..][..lanes]);
            self.slope(&delayed.partials[..delayed.width], *state, &self.base.s, f0);
            self.slope(&delayed.ends, *state, &self.trial, f1);
        }
        delayed.lu.solve_lanes(&mut own, lanes);
        self.seen.fill(0.0);
        for (k, lag) in delayed.lags.iter().enumerate() {
            for row in 0..3 {
                let to = &mut self.seen[(3 * k + row) * lanes..][..lanes];
                for which in 0..3 {
                    let weight = lag.own.value[row][1 + which];
                    let from = delayed.lu.row(3 * lag.unknown + which);
                    accumulate(weight, &own[from * lanes..][..lanes], to);
                }
            }
        }
        self.own = own;
        self.force(delayed);
    }

    /// One row of `f_x S + f_theta`.
    #[inline(always)]
    fn slope(&self, row: &[f64], state: usize, s: &[f64], to: &mut [f64]) {
        let lanes = self.base.lanes;
        to.copy_from_slice(&row[self.forcing + state * lanes..][..lanes]);
        for (slot, column) in &self.f_x[state] {
            accumulate(row[*slot], &s[column * lanes..][..lanes], to);
        }
    }
}

/// The loop over the steps, compiled for the machine's widest registers.
struct March<'m, 'a> {
    sensitivity: &'m mut DelayedSensitivity,
    delayed: &'m mut DelayedStates,
    trajectory: &'m mut Trajectory<'a>,
    sink: &'m mut Sink<'m>,
}

impl WithSimd for March<'_, '_> {
    type Output = Result<(), Divergence>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { sensitivity, delayed, trajectory, sink } = self;
        let steps = trajectory.grid.steps();
        if let Some(history) = &mut trajectory.history {
            history.node(trajectory.grid.samples()[0], &trajectory.nodes[0], &sensitivity.base.s);
        }
        for k in 0..=steps {
            if let Some(sample) = trajectory.grid.sample_at(k) {
                sensitivity.base.observe(trajectory, sample, k, sink)?;
            }
            if k < steps {
                sensitivity.advance(simd, delayed, trajectory, k)?;
            }
        }
        sensitivity.base.flush(sink);
        Ok(())
    }
}
