//! One step of a model whose rates see delayed states.
//!
//! With delays not shorter than the step the past determines the drive. With a shorter one the drive depends on the step's
//! own cubic, that is on x1, f0 and f1 of the delayed states, which depend on the drive: 3 equations for each such state,
//! solved by Newton's method with their exact Jacobian until only rounding is left. The discrete equations have the order
//! of the explicit ones and go over into them as the delay grows past the step, without a jump.

use super::super::grid::Grid;
use super::super::simulator::{Divergence, Simulator, diverged, finite, node, two_nodes};
use super::super::vectors::Aligned;
use super::History;
use super::hermite::Four;
use super::lag::Lag;
use super::lu::Lu;
use crate::dynamics::{Layout, Point, Step};
use fdm_grammar::graph::Signal;

/// Newton corrections of one step before it counts as failed.
const MOST_CORRECTIONS: usize = 40;
/// Corrections that are enough for all but noise, as a rule.
const USUAL_CORRECTIONS: usize = 6;

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
pub(in super::super) struct Retarded {
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
    pub(super) lu: Lu,
    correction: Vec<f64>,
    /// Results of `step_with_partials`, and of `rates_and_partials` at the end of the step.
    pub(super) partials: Aligned,
    pub(super) ends: Vec<f64>,
    pub(super) width: usize,
    /// Rates at both ends.
    rates: [Vec<f64>; 2],
    /// Tangents: slopes of the stage before and of this one, states, sum, first slope.
    tangent: [Vec<f64>; 5],
}

impl Retarded {
    /// Most states that a step can see of itself: their equations are dense, three for each.
    pub(in super::super) const MOST_AT_ONCE: usize = 200;

    pub(in super::super) fn new(layout: &Layout, history: &History) -> Self {
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
            lu: Lu::default(),
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
    pub(in super::super) fn begin(&mut self, tau: &[f64], grid: &Grid) {
        self.lags.iter_mut().for_each(Lag::begin);
        self.own.fill([0.0; 3]);
        self.lu.resize(3 * self.states_at_once(tau, grid));
    }

    /// States that have to be found at once because a delay is shorter than a step.
    pub(in super::super) fn states_at_once(&self, tau: &[f64], grid: &Grid) -> usize {
        let shortest = self.lags.iter().map(|lag| tau[lag.delayed]).fold(f64::INFINITY, f64::min);
        if (0..grid.steps()).any(|k| grid.step(k).1 > shortest) { self.unknown.len() } else { 0 }
    }

    /// Takes step k without sensitivities.
    pub(in super::super) fn advance(&mut self, simulator: &mut Simulator<'_>, k: usize) -> Result<(), Divergence> {
        self.step(simulator, k, &mut [], false)?;
        let Some(history) = &mut simulator.history else { return Ok(()) };
        history.rates(0, &self.rates[0]);
        history.rates(1, &self.rates[1]);
        history.node(simulator.grid.end(k), two_nodes(&mut simulator.nodes, k).1, &[]);
        Ok(())
    }

    /// The states of node k + 1 and the rates at both ends of the step; sensitivities of what the step sees of the past go
    /// to `rows` (3 rows of lanes for each lag). `partials` and `ends` are filled when wanted, and when the step sees itself.
    #[inline(always)]
    pub(super) fn step(
        &mut self,
        simulator: &mut Simulator<'_>,
        k: usize,
        rows: &mut [f64],
        wanted: bool,
    ) -> Result<(), Divergence> {
        let (t, h) = simulator.grid.step(k);
        self.short = false;
        if let Some(history) = &simulator.history {
            let (tau, lanes) = (simulator.dynamics.layout().tau.start, rows.len() / self.lags.len().max(1));
            for (k, lag) in self.lags.iter_mut().enumerate() {
                let tau = simulator.known[tau + lag.delayed];
                self.short |= lag.look(history, (t, h), tau, &mut rows[k * lanes..][..lanes]);
            }
        }
        if self.short { self.implicit(simulator, k) } else { self.explicit(simulator, k, wanted) }
    }

    /// The drive is known.
    fn explicit(&mut self, simulator: &mut Simulator<'_>, k: usize, wanted: bool) -> Result<(), Divergence> {
        self.place(simulator, k);
        if wanted {
            self.evaluate(simulator, k);
            return finite(&simulator.grid, k, two_nodes(&mut simulator.nodes, k).1);
        }
        let Simulator { dynamics, grid, drive, known, nodes, work, .. } = simulator;
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
    fn implicit(&mut self, simulator: &mut Simulator<'_>, k: usize) -> Result<(), Divergence> {
        let (h, failed) = (simulator.grid.step(k).1, diverged(&simulator.grid, k, None));
        self.predict(simulator, k);
        let mut last = false;
        for count in 0..MOST_CORRECTIONS {
            self.place(simulator, k);
            self.evaluate(simulator, k);
            finite(&simulator.grid, k, two_nodes(&mut simulator.nodes, k).1)?;
            self.residual(simulator, k);
            self.factor(h);
            let rounding = || self.size(simulator, k) <= 2.0 * f64::EPSILON;
            if last || rounding() || (count > USUAL_CORRECTIONS && self.is_noise(simulator, k)) {
                return Ok(());
            }
            self.lu.solve(&mut self.correction);
            let size = self.size(simulator, k);
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
    fn predict(&mut self, simulator: &Simulator<'_>, k: usize) {
        let h = simulator.grid.step(k).1;
        let x = &simulator.nodes[node(k)];
        for (state, own) in self.unknown.iter().zip(&mut self.own) {
            let rate = if k == 0 { 0.0 } else { self.rates[1][*state] };
            *own = [x[*state] + h * rate, rate, rate];
        }
    }

    /// Stage values and slopes of the delayed states to their places in the drive.
    fn place(&self, simulator: &mut Simulator<'_>, k: usize) {
        let x = &simulator.nodes[node(k)];
        for lag in &self.lags {
            let [x1, f0, f1] = self.own[lag.unknown];
            let four: Four = [x[self.unknown[lag.unknown]], x1, f0, f1];
            simulator.drive.place(k, lag.delayed, lag.seen(&four));
        }
    }

    /// The step with the drive in place, its partials, and the rates at both ends.
    fn evaluate(&mut self, simulator: &mut Simulator<'_>, k: usize) {
        let Simulator { dynamics, grid, drive, known, nodes, work, .. } = simulator;
        let ((t, h), (x, next)) = (grid.step(k), two_nodes(nodes, k));
        let (stages, width, n) = (drive.stages(k), dynamics.layout().drive(), x.len());
        dynamics.step_with_partials(Step { t, h, x, drive: stages, known }, next, &mut self.partials, work);
        let at = Point { t: t + h, x: next, drive: &stages[2 * width..], known };
        dynamics.rates_and_partials(at, &mut self.ends, work);
        self.rates[0].copy_from_slice(&self.partials[..n]);
        self.rates[1].copy_from_slice(&self.ends[..n]);
    }

    /// What the step gives for x1, f0 and f1, less what was assumed.
    fn residual(&mut self, simulator: &mut Simulator<'_>, k: usize) {
        let next = two_nodes(&mut simulator.nodes, k).1;
        for ((state, own), r) in self.unknown.iter().zip(&self.own).zip(self.correction.as_chunks_mut::<3>().0) {
            *r = [next[*state] - own[0], self.rates[0][*state] - own[1], self.rates[1][*state] - own[2]];
        }
    }

    /// Largest correction as a part of the state and its motion over the step.
    fn size(&self, simulator: &Simulator<'_>, k: usize) -> f64 {
        let h = simulator.grid.step(k).1;
        let x = &simulator.nodes[node(k)];
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
    fn is_noise(&self, simulator: &Simulator<'_>, k: usize) -> bool {
        let h = simulator.grid.step(k).1;
        let largest = simulator.nodes[node(k)].iter().fold(0.0_f64, |l, x| l.max(x.abs()));
        let parts = self.correction.as_chunks::<3>().0;
        parts.iter().all(|r| r[0].abs() + h * (r[1].abs() + r[2].abs()) <= 1e-13 * largest)
    }

    /// Factors identity less the derivative of what the step gives by what is assumed.
    fn factor(&mut self, h: f64) {
        let m = 3 * self.unknown.len();
        for column in 0..m {
            self.column(h, column / 3, 1 + column % 3);
            let [first, end, _, sum, _] = &self.tangent;
            for (row, state) in self.unknown.iter().enumerate() {
                for (k, part) in [sum, first, end].into_iter().enumerate() {
                    let row = 3 * row + k;
                    self.lu.a[row * m + column] = f64::from(u8::from(row == column)) - part[*state];
                }
            }
        }
        self.lu.factor();
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

impl Retarded {
    /// Clears the rows of f_theta to which delays add; the model writes only its own entries.
    pub(super) fn clear(&mut self, layout: &Layout) {
        let (lanes, forcing) = (layout.stage.lanes, layout.stage.forcing);
        let Self { entries, partials, ends, width, .. } = self;
        for row in partials.chunks_exact_mut(*width).chain([&mut ends[..]]) {
            entries.iter().for_each(|e| row[forcing + e.row * lanes..][..lanes].fill(0.0));
        }
    }
}
