//! Sensitivities of one run: the states' Runge-Kutta steps one ahead of the sensitivities' steps.
//!
//! The state chain is bound by latency, the sensitivities by throughput; running the states one step ahead lets the
//! processor overlap both, and gives the scattered forcing terms time to reach the cache before they are read as vectors.

use super::history::History;
use super::simulator::{Divergence, Simulator, node, two_nodes};
use super::tangent::{Stages, TangentPlan};
use crate::dynamics::{Dynamics, Layout, Point, Step};
use fdm_grammar::graph::Signal;
use pulp::{Simd, WithSimd};

/// Doubles in the widest register, to which rows of lanes are padded.
const LANES: usize = 8;

/// Copies one number from a result to a lane.
#[derive(Debug, Clone, Copy)]
struct Scatter {
    from: u32,
    to: u32,
}

/// Adds `entry * -slope * tau_theta` to a lane: a delay's part in the forcing.
#[derive(Debug, Clone, Copy)]
struct DelayTerm {
    /// Position of f_delay or h_delay in the result.
    entry: u32,
    /// Which delayed signal.
    delayed: u32,
    /// Position of tau_theta in `known`.
    tau: u32,
    to: u32,
}

/// Plans and memory for one choice of columns.
pub(super) struct Sensitivity {
    columns: Vec<usize>,
    stride: usize,
    slots: usize,
    plan: TangentPlan,
    initial: Vec<Scatter>,
    rates_by_param: Vec<Scatter>,
    rates_by_delay: Vec<DelayTerm>,
    outputs_by_param: Vec<Scatter>,
    /// (position of tau_theta in known, delayed signal, lane)
    tau: Vec<(usize, usize, usize)>,
    /// Lanes that only delays reach: cleared before delay terms are added.
    cleared: Vec<u32>,
    s: Aligned,
    scratch: Aligned,
    partials: [Aligned; 2],
    forcing: [Aligned; 2],
    /// Result of `outputs_and_partials`, and sensitivities of the delayed signals.
    output: Vec<f64>,
    delayed: Vec<f64>,
    /// Result of `rates_and_partials` at the ends of a step, for the history.
    ends: Vec<f64>,
}

impl Sensitivity {
    pub(super) fn new(dynamics: &dyn Dynamics, columns: &[usize]) -> Self {
        let layout = dynamics.layout();
        let (n, p) = (layout.states, &layout.patterns);
        let stride = columns.len().div_ceil(LANES) * LANES;
        let mut lane = vec![None; layout.params];
        columns.iter().enumerate().for_each(|(l, c)| lane[*c] = Some(l));
        let scatter = |pattern: &fdm_grammar::Pattern, first: usize| -> Vec<Scatter> {
            let to = |row: usize, column: usize| lane[column].map(|l| (row * stride + l) as u32);
            let entries = pattern.entries();
            entries.filter_map(|(k, i, j)| to(i, j).map(|to| Scatter { from: (first + k) as u32, to })).collect()
        };
        let tau: Vec<_> = p
            .tau_by_param
            .entries()
            .filter_map(|(k, d, j)| Some((layout.tau_by_param.start + k, d, lane[j]?)))
            .collect();
        let first_delay = n + p.rates_by_state.len();
        let rates_by_param = scatter(&p.rates_by_param, first_delay + p.rates_by_delayed.len());
        let rates_by_delay: Vec<DelayTerm> = p
            .rates_by_delayed
            .entries()
            .flat_map(|(k, i, d)| {
                let of_delay = tau.iter().filter(move |(_, delayed, _)| *delayed == d);
                of_delay.map(move |(known, _, l)| DelayTerm {
                    entry: (first_delay + k) as u32,
                    delayed: d as u32,
                    tau: *known as u32,
                    to: (i * stride + l) as u32,
                })
            })
            .collect();
        let written: Vec<u32> = rates_by_param.iter().map(|s| s.to).collect();
        let cleared = rates_by_delay.iter().map(|d| d.to).filter(|to| !written.contains(to)).collect();
        let slots = layout.rate_slots();
        let plan = TangentPlan::new(n, &p.rates_by_state, slots, stride);
        Self {
            columns: columns.to_vec(),
            stride,
            slots,
            initial: scatter(&p.initial_by_param, layout.initial_by_param.start),
            rates_by_param,
            rates_by_delay,
            outputs_by_param: scatter(
                &p.outputs_by_param,
                layout.outputs + p.outputs_by_state.len() + p.outputs_by_delayed.len(),
            ),
            tau,
            cleared,
            s: Aligned::new(n * stride),
            scratch: Aligned::new(plan.scratch()),
            plan,
            partials: [Aligned::new(4 * slots), Aligned::new(4 * slots)],
            forcing: [Aligned::new(4 * n * stride), Aligned::new(4 * n * stride)],
            output: vec![0.0; layout.output_slots()],
            delayed: vec![0.0; layout.delayed.len() * stride],
            ends: vec![0.0; slots],
        }
    }

    pub(super) fn columns(&self) -> &[usize] {
        &self.columns
    }

    pub(super) fn stride(&self) -> usize {
        self.stride
    }

    pub(super) fn run(
        &mut self,
        simulator: &mut Simulator<'_>,
        y: &mut [f64],
        jacobian: &mut [f64],
    ) -> Result<(), Divergence> {
        self.s.fill(0.0);
        for c in &self.initial {
            self.s[c.to as usize] = simulator.known[c.from as usize];
        }
        pulp::Arch::new().dispatch(March { sensitivity: self, simulator, y, jacobian })
    }

    /// One step of the states; their partials go to the buffer of step k.
    #[inline(always)]
    fn advance(&mut self, simulator: &mut Simulator<'_>, k: usize) -> Result<(), Divergence> {
        let n = simulator.dynamics.layout().states;
        let (t, h) = simulator.grid.step(k);
        let mut nodes = std::mem::take(&mut simulator.nodes);
        let (x, next) = two_nodes(&mut nodes, k, n);
        let step = Step { t, h, x, drive: simulator.drive.stages(k), known: &simulator.known };
        simulator.dynamics.step_with_partials(step, next, &mut self.partials[k % 2], &mut simulator.work);
        let finite = simulator.check(k, next);
        simulator.nodes = nodes;
        self.scatter(simulator, k);
        finite
    }

    /// Forcing of the four stages of step k into lanes.
    #[inline(always)]
    fn scatter(&mut self, simulator: &Simulator<'_>, k: usize) {
        let block = simulator.dynamics.layout().states * self.stride;
        let slopes = simulator.drive.stage_slopes(k);
        let delays = slopes.len() / 3;
        let (partials, forcing) = (&self.partials[k % 2], &mut self.forcing[k % 2]);
        for (stage, row) in [0, 1, 1, 2].into_iter().enumerate() {
            let from = &partials[stage * self.slots..(stage + 1) * self.slots];
            let to = &mut forcing[stage * block..(stage + 1) * block];
            for c in &self.rates_by_param {
                to[c.to as usize] = from[c.from as usize];
            }
            if !self.rates_by_delay.is_empty() {
                let slopes = &slopes[row * delays..(row + 1) * delays];
                self.cleared.iter().for_each(|l| to[*l as usize] = 0.0);
                add_delays(&self.rates_by_delay, from, slopes, &simulator.known, to);
            }
        }
    }

    /// Outputs and their sensitivities at a sample; x is the offset of the states among the nodes.
    #[inline(always)]
    fn observe(
        &mut self,
        simulator: &mut Simulator<'_>,
        sample: usize,
        x: usize,
        y: &mut [f64],
        jacobian: &mut [f64],
    ) -> Result<(), Divergence> {
        let dynamics = simulator.dynamics;
        let layout = dynamics.layout();
        let (q, stride, t) = (layout.outputs, self.stride, simulator.run.time[sample]);
        let y = &mut y[sample * q..][..q];
        let rows = &mut jacobian[sample * q * stride..][..q * stride];
        let x = &simulator.nodes[x..x + layout.states];
        if layout.observed.iter().all(Option::is_some) {
            for ((state, y), row) in layout.observed.iter().flatten().zip(y).zip(rows.chunks_exact_mut(stride.max(1))) {
                *y = x[*state as usize];
                row.copy_from_slice(&self.s[*state as usize * stride..][..stride]);
            }
            return Ok(());
        }
        self.delay_signals(layout, simulator.history.as_ref(), sample, t, &simulator.known, &mut simulator.drive);
        let at = Point { t, x, drive: simulator.drive.sample(sample), known: &simulator.known };
        dynamics.outputs_and_partials(at, &mut self.output, &mut simulator.work);
        y.copy_from_slice(&self.output[..q]);
        rows.fill(0.0);
        for c in &self.outputs_by_param {
            rows[c.to as usize] = self.output[c.from as usize];
        }
        let patterns = &layout.patterns;
        let by_delayed = q + patterns.outputs_by_state.len();
        let terms = [
            (&patterns.outputs_by_state, &self.s[..], q),
            (&patterns.outputs_by_delayed, &self.delayed[..], by_delayed),
        ];
        for (pattern, from, first) in terms {
            for (k, i, j) in pattern.entries() {
                let (row, from, a) =
                    (&mut rows[i * stride..][..stride], &from[j * stride..][..stride], self.output[first + k]);
                row.iter_mut().zip(from).for_each(|(r, s)| *r = a.mul_add(*s, *r));
            }
        }
        if y.iter().all(|y| y.is_finite()) { Ok(()) } else { Err(Divergence { time: t, state: None, sample }) }
    }

    /// Delayed signals at a sample with their sensitivities: the signal's own, and -slope times tau_theta.
    fn delay_signals(
        &mut self,
        layout: &Layout,
        history: Option<&History>,
        sample: usize,
        t: f64,
        known: &[f64],
        drive: &mut super::drive::DriveTable,
    ) {
        let stride = self.stride;
        self.delayed.fill(0.0);
        for (d, signal) in layout.delayed.iter().enumerate() {
            let lanes = &mut self.delayed[d * stride..][..stride];
            let slope = match (*signal, history) {
                (Signal::State(state), Some(history)) => {
                    let (value, slope) = history.at(t - known[layout.tau.start + d], state as usize, lanes);
                    drive.sample(sample)[layout.inputs + d] = value;
                    slope
                }
                _ => drive.sample_slopes(sample)[d],
            };
            for (at, _, lane) in self.tau.iter().filter(|(_, delayed, _)| *delayed == d) {
                lanes[*lane] -= slope * known[*at];
            }
        }
    }

    /// Adds node k to the history with rates and their sensitivities on both sides.
    fn remember(&mut self, simulator: &mut Simulator<'_>, k: usize) {
        let Some(mut history) = simulator.history.take() else { return };
        let dynamics = simulator.dynamics;
        let layout = dynamics.layout();
        let (n, width, steps) = (layout.states, layout.drive(), simulator.grid.steps());
        let x = &simulator.nodes[node(k) * n..][..n];
        let t = if k < steps { simulator.grid.step(k).0 } else { simulator.run.time[simulator.run.len() - 1] };
        history.push(t, x, &self.s);
        for (end, step, row) in [(1, k.checked_sub(1), 2), (0, (k < steps).then_some(k), 0)] {
            let Some(step) = step else { continue };
            let drive = &simulator.drive.stages(step)[row * width..][..width];
            dynamics.rates_and_partials(
                Point { t, x, drive, known: &simulator.known },
                &mut self.ends,
                &mut simulator.work,
            );
            let (rates, lanes) = history.rates(end, end);
            rates.copy_from_slice(&self.ends[..n]);
            lanes.fill(0.0);
            for c in &self.rates_by_param {
                lanes[c.to as usize] = self.ends[c.from as usize];
            }
            let delays = layout.delayed.len();
            let slopes = &simulator.drive.stage_slopes(step)[row * delays..][..delays];
            add_delays(&self.rates_by_delay, &self.ends, slopes, &simulator.known, lanes);
            for (entry, i, j) in layout.patterns.rates_by_state.entries() {
                let (a, from) = (self.ends[n + entry], &self.s[j * self.stride..][..self.stride]);
                lanes[i * self.stride..][..self.stride].iter_mut().zip(from).for_each(|(l, s)| *l = a.mul_add(*s, *l));
            }
        }
        simulator.history = Some(history);
    }
}

fn add_delays(terms: &[DelayTerm], from: &[f64], slopes: &[f64], known: &[f64], to: &mut [f64]) {
    for d in terms {
        to[d.to as usize] -= from[d.entry as usize] * slopes[d.delayed as usize] * known[d.tau as usize];
    }
}

/// The loop over the steps, compiled for the machine's widest registers.
struct March<'m, 'a> {
    sensitivity: &'m mut Sensitivity,
    simulator: &'m mut Simulator<'a>,
    y: &'m mut [f64],
    jacobian: &'m mut [f64],
}

impl WithSimd for March<'_, '_> {
    type Output = Result<(), Divergence>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { sensitivity, simulator, y, jacobian } = self;
        let (n, steps) = (simulator.dynamics.layout().states, simulator.grid.steps());
        if steps > 0 {
            sensitivity.advance(simulator, 0)?;
        }
        for k in 0..=steps {
            if simulator.history.is_some() {
                sensitivity.remember(simulator, k);
            }
            if let Some(sample) = simulator.grid.sample_at(k) {
                sensitivity.observe(simulator, sample, node(k) * n, y, jacobian)?;
            }
            if k + 1 < steps {
                sensitivity.advance(simulator, k + 1)?;
            }
            if k < steps {
                let Sensitivity { plan, partials, forcing, s, scratch, .. } = &mut *sensitivity;
                let h = simulator.grid.step(k).1;
                let stages = Stages { h, partials: &partials[k % 2], forcing: &forcing[k % 2] };
                plan.step(simd, &stages, s, scratch);
            }
        }
        simulator.stateless(|simulator, sample| sensitivity.observe(simulator, sample, 0, y, jacobian))
    }
}

/// Numbers that begin on a cache line, so that no vector straddles two.
struct Aligned {
    numbers: Vec<f64>,
    start: usize,
    len: usize,
}

impl Aligned {
    fn new(len: usize) -> Self {
        let numbers = vec![0.0; len + LANES];
        // 64 bytes; an address that cannot be aligned only costs speed
        let start = numbers.as_ptr().align_offset(64);
        Self { numbers, start: if start < LANES { start } else { 0 }, len }
    }
}

impl std::ops::Deref for Aligned {
    type Target = [f64];

    #[inline(always)]
    fn deref(&self) -> &[f64] {
        &self.numbers[self.start..self.start + self.len]
    }
}

impl std::ops::DerefMut for Aligned {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.numbers[self.start..self.start + self.len]
    }
}
