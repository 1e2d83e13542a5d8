//! What drives the model at the stages of every step and at every sample: inputs, and inputs delayed.
//!
//! [`Course`] shows the same to who integrates more than the states, as a filter does.

use super::delayed_inputs::{DelayFilter, Follower, ROUNDING, Rule, StageValues, TAPS, Weights};
use super::error::Unsuited;
use super::steps::{Grid, Steps};
use crate::dynamics::Layout;
use crate::record::{Cursor, Place, Run};
use fdm_grammar::graph::Signal;

/// Values of inputs and delayed inputs where the integrator needs them; delayed states are filled in elsewhere.
#[derive(Debug, Clone)]
pub(super) struct DriveTable {
    width: usize,
    inputs: usize,
    delayed: Vec<Signal>,
    rule: Rule,
    /// Steps by 3 by width: the stages of each step.
    stages: Vec<f64>,
    /// Steps by 3 by delayed signals: slopes of delayed inputs.
    stage_slopes: Vec<f64>,
    /// Samples by width.
    samples: Vec<f64>,
    /// Samples by delayed signals.
    sample_slopes: Vec<f64>,
    /// On an even grid, where every step sees the record through the same weights.
    filter: Option<DelayFilter>,
    /// Those weights where an interval is one step, for each delayed signal; whoever takes them needs no stages.
    taps: Vec<Weights>,
    /// Whether outputs show delayed signals.
    shown: bool,
    /// By input whether it is zero outside the record.
    vanishing: Vec<bool>,
    /// The record with zeros on both sides of such inputs, where steps are seen one by one and such an input is delayed.
    bounded: Option<Run>,
}

impl DriveTable {
    /// Fills in the inputs that are not delayed; they stay as they are for the whole fit.
    ///
    /// A recursion reads the samples where an interval is one step: then there are no stages.
    pub(super) fn new(layout: &Layout, run: &Run, grid: &Grid, steps: &Steps, recursion: bool) -> Self {
        let (width, inputs, delays, count) = (layout.drive(), layout.inputs, layout.delayed.len(), grid.steps());
        let mut table = Self {
            width,
            inputs,
            delayed: layout.delayed.clone(),
            rule: Rule::of(steps.scheme()),
            stages: Vec::new(),
            stage_slopes: Vec::new(),
            samples: vec![0.0; run.len() * width],
            sample_slopes: vec![0.0; run.len() * delays],
            filter: None,
            taps: Vec::new(),
            shown: !layout.patterns.outputs_by_delayed.columns.is_empty(),
            vanishing: (0..inputs as u32).map(|k| layout.vanishing.contains(&k)).collect(),
            bounded: None,
        };
        if layout.delayed.iter().any(|s| matches!(s, Signal::Input(_))) {
            let per = if count > 0 { grid.per_interval() } else { Some(1) };
            table.filter = per.and_then(|per| DelayFilter::new(&run.time, per, table.rule));
            if table.filter.is_some() && grid.per_interval() == Some(1) {
                table.taps = vec![Weights::default(); delays];
            }
        }
        let vanishes = |s: &Signal| matches!(s, Signal::Input(k) if layout.vanishing.contains(k));
        if table.filter.is_none() && layout.delayed.iter().any(vanishes) {
            table.bounded = Some(bounded(run, &table.vanishing));
        }
        for (sample, row) in run.inputs.chunks_exact(inputs.max(1)).enumerate().filter(|_| inputs > 0) {
            table.samples[sample * width..][..inputs].copy_from_slice(row);
        }
        if recursion && grid.per_interval() == Some(1) && (delays == 0 || table.has_taps()) {
            return table;
        }
        table.stages.resize(count * 3 * width, 0.0);
        table.stage_slopes.resize(count * 3 * delays, 0.0);
        let mut rows = table.stages.chunks_exact_mut((3 * width).max(1));
        for interval in (0..run.len().saturating_sub(1)).filter(|_| count > 0 && inputs > 0) {
            steps.each(interval, |begin, end| {
                if let Some(stages) = rows.next() {
                    inputs_of_step(run, interval, (begin, end), &table.rule, width, stages);
                }
            });
        }
        table
    }

    /// Fills in the delayed inputs for new delays (one per delayed signal); without stages where they are seen by taps.
    pub(super) fn delay(&mut self, tau: &[f64], run: &Run, grid: &Grid, by_taps: bool) {
        for (d, tau) in tau.iter().enumerate() {
            let Signal::Input(input) = self.delayed[d] else { continue };
            let input = input as usize;
            match self.filter.take() {
                Some(filter) => {
                    if by_taps && self.has_taps() {
                        self.taps[d] = filter.step(*tau, 0, run.held[input]);
                    } else if grid.steps() > 0 {
                        self.delay_stages(&filter, (d, input), *tau, run);
                    }
                    if self.shown {
                        self.delay_samples(&filter, (d, input), *tau, run);
                    }
                    self.filter = Some(filter);
                }
                None => self.delay_by_steps((d, input), *tau, run, grid),
            }
        }
    }

    /// Every step for itself, whatever the grid.
    fn delay_by_steps(&mut self, (d, input): (usize, usize), tau: f64, run: &Run, grid: &Grid) {
        let run = if self.vanishing[input] { self.bounded.as_ref().unwrap_or(run) } else { run };
        let (delays, column) = (self.delayed.len(), self.inputs + d);
        let mut follower = Follower::default();
        for k in 0..grid.steps() {
            let (t, h) = grid.step(k);
            let StageValues { value, slope } = follower.step(run, input, (t - tau, h), &self.rule);
            for stage in 0..3 {
                self.stages[(3 * k + stage) * self.width + column] = value[stage];
                self.stage_slopes[(3 * k + stage) * delays + d] = slope[stage];
            }
        }
        let mut cursor = Cursor::default();
        for (sample, t) in grid.samples().iter().enumerate() {
            let (value, slope) = seen_at(run, input, cursor.at(&run.time, t - tau), t - tau);
            self.samples[sample * self.width + column] = value;
            self.sample_slopes[sample * delays + d] = slope;
        }
    }

    /// One set of weights for all intervals.
    fn delay_stages(&mut self, filter: &DelayFilter, (d, input): (usize, usize), tau: f64, run: &Run) {
        let (delays, column, held) = (self.delayed.len(), self.inputs + d, run.held[input]);
        for j in 0..filter.per {
            let weights = filter.step(tau, j, held);
            let mut seen = Seen::before(run, (input, self.vanishing[input]), weights.first);
            let rows = self.stages.chunks_exact_mut(3 * self.width).skip(j).step_by(filter.per);
            let slopes = self.stage_slopes.chunks_exact_mut(3 * delays).skip(j).step_by(filter.per);
            for (row, slopes) in rows.zip(slopes) {
                let samples = seen.next();
                for stage in 0..3 {
                    (row[stage * self.width + column], slopes[stage * delays + d]) = weights.at(stage, samples);
                }
            }
        }
    }

    /// Delayed inputs at the samples.
    fn delay_samples(&mut self, filter: &DelayFilter, (d, input): (usize, usize), tau: f64, run: &Run) {
        let (delays, column) = (self.delayed.len(), self.inputs + d);
        let weights = filter.sample(tau, run.held[input]);
        let mut seen = Seen::before(run, (input, self.vanishing[input]), weights.first);
        let rows = self.samples.chunks_exact_mut(self.width).zip(self.sample_slopes.chunks_exact_mut(delays));
        for (row, slopes) in rows {
            (row[column], slopes[d]) = weights.at(0, seen.next());
        }
    }

    /// Whether delayed inputs are seen by taps: the same weights of neighbouring samples in every step.
    pub(super) fn has_taps(&self) -> bool {
        !self.taps.is_empty()
    }

    /// The weights by which a delayed input is seen.
    #[inline(always)]
    pub(super) fn taps(&self, delayed: usize) -> &Weights {
        &self.taps[delayed]
    }

    /// An input at a sample; before the record and behind it its first and last one.
    #[inline(always)]
    pub(super) fn nearest(&self, sample: i64, input: usize) -> f64 {
        let last = (self.samples.len() / self.width) as i64 - 1;
        if self.vanishing[input] && !(0..last).contains(&sample) {
            return 0.0;
        }
        self.samples[sample.clamp(0, last) as usize * self.width + input]
    }

    /// Drive at the stages of a step (3 by width): with Runge-Kutta its beginning, middle and end.
    #[inline]
    pub(super) fn stages(&self, step: usize) -> &[f64] {
        &self.stages[step * 3 * self.width..][..3 * self.width]
    }

    /// Slopes of the delayed inputs at the same three stages (3 by delayed signals).
    #[inline]
    pub(super) fn stage_slopes(&self, step: usize) -> &[f64] {
        let delays = self.delayed.len();
        &self.stage_slopes[step * 3 * delays..][..3 * delays]
    }

    /// Puts a delayed state into the drive of a step.
    pub(super) fn place(&mut self, step: usize, delayed: usize, seen: StageValues) {
        let delays = self.delayed.len();
        for stage in 0..3 {
            self.stages[(3 * step + stage) * self.width + self.inputs + delayed] = seen.value[stage];
            self.stage_slopes[(3 * step + stage) * delays + delayed] = seen.slope[stage];
        }
    }

    /// Length of a row of the drive.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// Number of delayed signals.
    pub(super) fn delays(&self) -> usize {
        self.delayed.len()
    }

    /// Drive at the three stages of all steps (steps by 3 by width).
    #[inline]
    pub(super) fn all_stages(&self) -> &[f64] {
        &self.stages
    }

    /// Slopes at the same (steps by 3 by delayed signals).
    #[inline]
    pub(super) fn all_stage_slopes(&self) -> &[f64] {
        &self.stage_slopes
    }

    /// Drive at all samples (N by width).
    #[inline]
    pub(super) fn all_samples(&self) -> &[f64] {
        &self.samples
    }

    /// Drive at a sample (width), writable for the delayed states.
    #[inline]
    pub(super) fn sample(&mut self, sample: usize) -> &mut [f64] {
        &mut self.samples[sample * self.width..][..self.width]
    }

    /// Slopes of the delayed inputs at all samples (N by delayed signals).
    #[inline(always)]
    pub(super) fn all_sample_slopes(&self) -> &[f64] {
        &self.sample_slopes
    }

    /// Slopes of the delayed inputs at a sample.
    #[inline]
    pub(super) fn sample_slopes(&self, sample: usize) -> &[f64] {
        let delays = self.delayed.len();
        &self.sample_slopes[sample * delays..][..delays]
    }
}

/// Neighbouring samples of an input, from interval to interval.
struct Seen<'r> {
    run: &'r Run,
    input: usize,
    vanishing: bool,
    samples: [f64; TAPS],
    /// The sample behind them.
    next: i64,
}

impl<'r> Seen<'r> {
    /// Before the first interval; `first` is the first sample that this sees.
    fn before(run: &'r Run, (input, vanishing): (usize, bool), first: i64) -> Self {
        let mut seen = Self { run, input, vanishing, samples: [0.0; TAPS], next: first };
        (1..TAPS).for_each(|_| _ = seen.next());
        seen
    }

    /// Those of the next interval; before the record and behind it stand its first and last sample.
    #[inline(always)]
    fn next(&mut self) -> [f64; TAPS] {
        let last = self.run.len() as i64 - 1;
        let sample = match self.vanishing && !(0..last).contains(&self.next) {
            true => 0.0,
            false => self.run.inputs[self.next.clamp(0, last) as usize * self.run.held.len() + self.input],
        };
        self.samples = [self.samples[1], self.samples[2], sample];
        self.next += 1;
        self.samples
    }
}

/// Value and slope of an input at a time; on a sample the mean of the slopes on both sides.
fn seen_at(run: &Run, input: usize, place: Place, t: f64) -> (f64, f64) {
    let (value, slope) = run.input(input, place);
    let time = &run.time;
    let rounding = ROUNDING * time.last().copied().unwrap_or(0.0).abs().max(t.abs());
    let near = |k: &usize| (time[*k] - t).abs() <= rounding;
    let after = time.partition_point(|s| *s <= t);
    let Some(k) = [after.checked_sub(1), (after < time.len()).then_some(after)].into_iter().flatten().find(near) else {
        return (value, slope);
    };
    if run.held[input] {
        return (value, slope);
    }
    let at = |k: usize| run.inputs[k * run.held.len() + input];
    let side = |a: usize, b: usize| (at(b) - at(a)) / (time[b] - time[a]);
    let before = if k > 0 { side(k - 1, k) } else { 0.0 };
    let behind = if k + 1 < time.len() { side(k, k + 1) } else { 0.0 };
    (value, 0.5 * (before + behind))
}

/// A record whose vanishing inputs, which are held, are zero before the first sample and from the last one on.
fn bounded(run: &Run, vanishing: &[bool]) -> Run {
    let (m, n, first) = (vanishing.len(), run.len(), run.time.first().copied().unwrap_or(0.0));
    let mut wider = run.clone();
    wider.time.insert(0, first - 1.0);
    wider.inputs = [&run.inputs[..m], &run.inputs].concat();
    for k in (0..m).filter(|k| vanishing[*k]) {
        (wider.inputs[k], wider.inputs[n * m + k]) = (0.0, 0.0);
    }
    wider
}

/// Inputs at the stages (3 by width) of the step between two parts of an interval.
pub(super) fn inputs_of_step(
    run: &Run,
    interval: usize,
    (begin, end): (f64, f64),
    rule: &Rule,
    width: usize,
    stages: &mut [f64],
) {
    let inputs = run.held.len();
    for (stage, node) in stages.chunks_exact_mut(width).zip(rule.nodes()) {
        let part = if node == 1.0 { end } else { begin + node * (end - begin) };
        for (input, value) in stage[..inputs].iter_mut().enumerate() {
            let (a, b) = (run.inputs[interval * inputs + input], run.inputs[(interval + 1) * inputs + input]);
            *value = between(a, b, part, run.held[input]);
        }
    }
}

/// A part of the way from a to b, exact at both ends.
fn between(a: f64, b: f64, part: f64, held: bool) -> f64 {
    if held || part == 0.0 {
        a
    } else if part == 1.0 {
        b
    } else {
        a + part * (b - a)
    }
}

/// The grid of a run and what drives a model on it.
pub struct Course<'a> {
    run: &'a Run,
    grid: Grid,
    drive: DriveTable,
}

impl<'a> Course<'a> {
    /// For models of this layout, of any outputs; states are not delayed.
    ///
    /// # Errors
    /// [`Unsuited::OtherInputs`] for a run of another model.
    pub fn new(layout: &Layout, run: &'a Run, steps: &Steps) -> Result<Self, Unsuited> {
        if run.held.len() != layout.inputs || run.inputs.len() != run.len() * layout.inputs {
            return Err(Unsuited::OtherInputs { found: run.held.len(), expected: layout.inputs });
        }
        let grid = Grid::new(&run.time, steps);
        let drive = DriveTable::new(layout, run, &grid, steps, false);
        Ok(Self { run, grid, drive })
    }

    /// Moves the delayed inputs by these delays.
    pub fn delay(&mut self, tau: &[f64]) {
        self.drive.delay(tau, self.run, &self.grid, false);
    }

    /// The run.
    pub fn run(&self) -> &'a Run {
        self.run
    }

    /// Number of steps.
    pub fn steps(&self) -> usize {
        self.grid.steps()
    }

    /// The sample that stands at the beginning of step k, or at the end of the last one, if one does.
    pub fn sample_at(&self, node: usize) -> Option<usize> {
        self.grid.sample_at(node)
    }

    /// Beginning and length of a step.
    pub fn step(&self, k: usize) -> (f64, f64) {
        self.grid.step(k)
    }

    /// Drive at the beginning, in the middle and at the end of a step, and the slopes of the delayed inputs there.
    pub fn stage(&self, step: usize, stage: usize) -> (&[f64], &[f64]) {
        let (width, delays) = (self.drive.width(), self.drive.delays());
        (&self.drive.stages(step)[stage * width..][..width], &self.drive.stage_slopes(step)[stage * delays..][..delays])
    }

    /// Drive at a sample, and the slopes of the delayed inputs there.
    pub fn sample(&self, sample: usize) -> (&[f64], &[f64]) {
        let width = self.drive.width();
        (&self.drive.all_samples()[sample * width..][..width], self.drive.sample_slopes(sample))
    }
}
