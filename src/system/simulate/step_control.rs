//! Steps as long as accuracy allows: each is compared with two of half its length (Hairer, Norsett & Wanner, Solving ordinary
//! differential equations I, II.4).
//!
//! Embedded formulas would cost less, but the implicit method's is of order 3 only and would ask for many more steps than
//! the method of order 5 needs; and steps are chosen once for a whole fit. A [`Probe`] takes steps of any length anywhere in a run.
//!
//! The integration error of a response: what halving its steps says.
//!
//! Halving the steps of a method of order p leaves `2^-p` of the error of a smooth response, and the differences of halved steps are a
//! geometric series of that ratio. Where a response is not smooth (a kink of `max`, a jump of `if`, a root at zero) the order is lost. So
//! the ratio is observed, from three or four grids, and bounds what is left (Roache, Verification and validation in computational
//! science and engineering, 1998, chapter 5; Hairer, Norsett & Wanner, Solving ordinary differential equations I, II.4).

use super::delayed_inputs::{Follower, Rule, StageValues};
use super::drive::inputs_of_step;
use super::error::{Divergence, Unsuited};
use super::simulator::Simulator;
use super::simulator::SingleStep;
use super::steps::{Scheme, Steps};
use super::stiff::Past;
use crate::dynamics::{Dynamics, Point, Step};
use crate::record::Run;
use fdm_grammar::graph::Signal;
use fdm_numeric::halt::Halt;

/// Sizes that errors are measured by: the magnitude of each state and the range of each output.
#[derive(Debug, Clone)]
pub(super) struct Scales {
    states: Vec<f64>,
    outputs: Vec<(f64, f64)>,
}

/// Longest and shortest next step, as multiples of the last one.
const GROWTH: f64 = 5.0;
const SHRINKING: f64 = 0.2;
const SAFETY: f64 = 0.9;
/// A step that has no solution is cut to this part.
const CUT: f64 = 0.25;

/// The next step, as a multiple of one with this error.
pub fn step_factor(scheme: Scheme, tolerance: f64, error: f64) -> f64 {
    let exponent = 1.0 / f64::from(scheme.order() + 1);
    (SAFETY * (tolerance / error.max(f64::MIN_POSITIVE)).powf(exponent)).clamp(SHRINKING, GROWTH)
}

/// What a step is shortened to whose error was too large, or that has no solution.
pub fn shortened(scheme: Scheme, tolerance: f64, error: Option<f64>) -> f64 {
    error.map_or(CUT, |error| step_factor(scheme, tolerance, error).min(0.8))
}

impl Scales {
    pub(super) fn new(states: usize, outputs: usize) -> Self {
        Self { states: vec![0.0; states], outputs: vec![(f64::INFINITY, f64::NEG_INFINITY); outputs] }
    }

    fn include(&mut self, x: &[f64], y: &[f64]) {
        for (scale, x) in self.states.iter_mut().zip(x) {
            *scale = scale.max(x.abs());
        }
        for ((low, high), y) in self.outputs.iter_mut().zip(y) {
            (*low, *high) = (low.min(*y), high.max(*y));
        }
    }

    /// Largest difference, as a part of its scale.
    fn error(&self, coarse: (&[f64], &[f64]), fine: (&[f64], &[f64])) -> f64 {
        let part = |scale: f64, a: f64, b: f64| {
            // differences below this part of a value are rounding
            let difference = (a - b).abs() - 1e-14 * b.abs();
            if difference > 0.0 {
                difference / scale.max(f64::MIN_POSITIVE)
            } else if difference.is_nan() {
                f64::INFINITY
            } else {
                0.0
            }
        };
        let mut worst = 0.0_f64;
        for (k, scale) in self.states.iter().enumerate() {
            let (a, b) = (coarse.0[k], fine.0[k]);
            worst = worst.max(part(scale.max(a.abs()).max(b.abs()), a, b));
        }
        for (k, (low, high)) in self.outputs.iter().enumerate() {
            if high > low {
                worst = worst.max(part(high - low, coarse.1[k], fine.1[k]));
            }
        }
        worst
    }
}

/// Sizes as steps show them that are as long as the implicit method can take them: it is damped, and so they are about right
/// whatever their length. Beginning with nothing would not do: a state far down a chain grows from zero by a high power of time, and
/// no step is short enough for a part of that. After `most` steps it is left at what they have shown.
pub(super) fn measure(probe: &mut Probe<'_>, mut scales: Scales, most: usize) -> Scales {
    let (mut x, mut next) = (vec![0.0; scales.states.len()], vec![0.0; scales.states.len()]);
    let mut y = vec![0.0; scales.outputs.len()];
    if !probe.begin(&mut x) {
        return scales;
    }
    let mut left = most;
    for interval in 0..probe.run.len().saturating_sub(1) {
        let (from, to) = (probe.run.time[interval], probe.run.time[interval + 1]);
        let (mut begin, mut length) = (0.0, 1.0);
        while begin < 1.0 {
            if left == 0 {
                return scales;
            }
            left -= 1;
            let end = if begin + 1.5 * length > 1.0 { 1.0 } else { begin + length };
            if probe.step(interval, (begin, end), &x, &mut next) {
                std::mem::swap(&mut x, &mut next);
                probe.outputs(from + (to - from) * end, &x, &mut y);
                scales.include(&x, &y);
                begin = end;
            } else {
                length *= CUT;
                // shortest step as a part of its interval while sizes are measured
                if length < 1e-6 {
                    return scales;
                }
            }
        }
    }
    scales
}

/// Steps whose local errors are about `tolerance` of the scales (or of what is met, when that is more), and the scales that were
/// met; `None` when it takes more than `most` of them, or there is no step short enough.
pub(super) fn choose(
    probe: &mut Probe<'_>,
    scheme: Scheme,
    tolerance: f64,
    scales: &Scales,
    most: usize,
) -> Option<(Steps, Scales)> {
    let (n, q) = (scales.states.len(), scales.outputs.len());
    let mut march = March {
        scheme,
        tolerance,
        scales: scales.clone(),
        met: Scales::new(n, q),
        wanted: f64::INFINITY,
        attempts: most.saturating_mul(4).saturating_add(1000),
        x: vec![0.0; n],
        coarse: vec![0.0; n],
        middle: vec![0.0; n],
        fine: vec![0.0; n],
        y: vec![0.0; q],
        y_fine: vec![0.0; q],
    };
    if !probe.begin(&mut march.x) {
        return None;
    }
    let mut intervals: Vec<Vec<f64>> = Vec::with_capacity(probe.run.len());
    let mut total = 0;
    for interval in 0..probe.run.len().saturating_sub(1) {
        let ends = march.cross(probe, interval, most - total)?;
        total += ends.len();
        intervals.push(ends);
    }
    Some((Steps::uneven(scheme, intervals.iter().map(Vec::as_slice)), march.met))
}

/// Where the choice has come to.
struct March {
    scheme: Scheme,
    tolerance: f64,
    scales: Scales,
    met: Scales,
    /// Length of the next step, if nothing stands in its way.
    wanted: f64,
    attempts: usize,
    x: Vec<f64>,
    coarse: Vec<f64>,
    middle: Vec<f64>,
    fine: Vec<f64>,
    y: Vec<f64>,
    y_fine: Vec<f64>,
}

impl March {
    /// The ends of the steps across an interval.
    fn cross(&mut self, probe: &mut Probe<'_>, interval: usize, most: usize) -> Option<Vec<f64>> {
        let (from, to) = (probe.run.time[interval], probe.run.time[interval + 1]);
        let (whole, mut begin, mut ends) = (to - from, 0.0, Vec::new());
        while begin < 1.0 {
            let end = self.reach(begin, whole);
            let length = whole * (end - begin);
            self.attempts = self.attempts.checked_sub(1)?;
            // shortest step as a part of its interval
            if ends.len() >= most || end - begin < 1e-14 || from + whole * begin + length <= from + whole * begin {
                return None;
            }
            let past = probe.past();
            let error = self.attempt(probe, interval, (begin, end));
            let after = probe.past();
            let Some(error) = error.filter(|e| *e <= self.tolerance) else {
                let factor = shortened(self.scheme, self.tolerance, error);
                self.wanted = length * factor;
                resume(probe, past.as_ref());
                continue;
            };
            // what the frozen steps will give, and its collocation polynomial: the coarse step's
            resume(probe, after.as_ref());
            let longer = length * step_factor(self.scheme, self.tolerance, error);
            self.wanted = if length < self.wanted { self.wanted.max(longer) } else { longer };
            self.x.copy_from_slice(&self.coarse);
            self.scales.include(&self.x, &self.y);
            self.met.include(&self.x, &self.y);
            ends.push(end);
            begin = end;
        }
        Some(ends)
    }

    /// The end of the next step: as far as wanted, and in equal parts when the rest is no more than two of that.
    fn reach(&self, begin: f64, whole: f64) -> f64 {
        let part = self.wanted / whole;
        let rest = 1.0 - begin;
        if part >= rest * (1.0 - 1e-9) {
            1.0
        } else if 2.0 * part >= rest {
            begin + 0.5 * rest
        } else {
            begin + part
        }
    }

    /// The error of a step, its end in `coarse`; none when one of the three steps cannot be taken. The probe's past is then that of
    /// the coarse step.
    fn attempt(&mut self, probe: &mut Probe<'_>, interval: usize, (begin, end): (f64, f64)) -> Option<f64> {
        let half = 0.5 * (begin + end);
        let before = probe.past();
        if !probe.step(interval, (begin, end), &self.x, &mut self.coarse) {
            return None;
        }
        let t = probe.run.time[interval] + (probe.run.time[interval + 1] - probe.run.time[interval]) * end;
        probe.outputs(t, &self.coarse, &mut self.y);
        let after = probe.past();
        resume(probe, before.as_ref());
        let halves = probe.step(interval, (begin, half), &self.x, &mut self.middle)
            && probe.step(interval, (half, end), &self.middle, &mut self.fine);
        if !halves {
            return None;
        }
        probe.outputs(t, &self.fine, &mut self.y_fine);
        resume(probe, after.as_ref());
        Some(
            self.scales.error((&self.coarse, &self.y), (&self.fine, &self.y_fine))
                * self.scheme.part_removed_by_halving(),
        )
    }
}

fn resume(probe: &mut Probe<'_>, past: Option<&Past>) {
    if let (Some(collocation), Some(past)) = (&mut probe.steps.collocation, past) {
        collocation.resume(past);
    }
}

/// Takes steps of a model without delayed states.
pub(super) struct Probe<'a> {
    dynamics: &'a dyn Dynamics,
    pub(super) run: &'a Run,
    rule: Rule,
    known: Vec<f64>,
    followers: Vec<Follower>,
    drive: Vec<f64>,
    steps: SingleStep,
    /// When there is no time for more steps; then none can be taken.
    halt: Option<&'a Halt>,
}

impl<'a> Probe<'a> {
    pub(super) fn new(dynamics: &'a dyn Dynamics, run: &'a Run, theta: &[f64], scheme: Scheme) -> Self {
        let (layout, mut steps) = (dynamics.layout(), SingleStep::new(dynamics, scheme));
        let mut known = vec![0.0; layout.known];
        dynamics.prepare(theta, &mut known, &mut steps.work);
        Self {
            dynamics,
            run,
            rule: Rule::of(scheme),
            known,
            followers: layout.delayed.iter().map(|_| Follower::default()).collect(),
            drive: vec![0.0; 3 * layout.drive()],
            steps,
            halt: None,
        }
    }

    /// Takes no more steps once this has ended.
    pub(super) fn until(self, halt: Option<&'a Halt>) -> Self {
        Self { halt, ..self }
    }

    /// What the implicit method takes over from the steps before.
    fn past(&self) -> Option<Past> {
        self.steps.collocation.as_ref().map(|c| c.past())
    }

    /// The states at the beginning of the run; `false` when they, or a delay, are not finite.
    pub(super) fn begin(&mut self, x: &mut [f64]) -> bool {
        let layout = self.dynamics.layout();
        x.copy_from_slice(&self.known[layout.initial.clone()]);
        self.steps.begin();
        x.iter().chain(&self.known[layout.tau.clone()]).all(|v| v.is_finite())
    }

    /// The step from one part of an interval to another; `false` when its end is not finite or cannot be found, or time is over.
    pub(super) fn step(&mut self, interval: usize, (begin, end): (f64, f64), x: &[f64], next: &mut [f64]) -> bool {
        if !self.halt.is_none_or(Halt::goes_on) {
            return false;
        }
        let (from, to) = (self.run.time[interval], self.run.time[interval + 1]);
        let (t, h) = (from + (to - from) * begin, (to - from) * (end - begin));
        self.feed(interval, (begin, end), (t, h));
        let step = Step { t, h, x, drive: &self.drive, known: &self.known };
        self.steps.take(self.dynamics, step, next)
    }

    /// Outputs at the end of the step that was taken last.
    pub(super) fn outputs(&mut self, t: f64, x: &[f64], y: &mut [f64]) {
        let width = self.dynamics.layout().drive();
        let at = Point { t, x, drive: &self.drive[2 * width..], known: &self.known };
        self.dynamics.outputs(at, y, &mut self.steps.work);
    }

    /// Drive at the stages.
    fn feed(&mut self, interval: usize, parts: (f64, f64), (t, h): (f64, f64)) {
        let layout = self.dynamics.layout();
        let width = layout.drive();
        if width == 0 {
            return;
        }
        inputs_of_step(self.run, interval, parts, &self.rule, width, &mut self.drive);
        for (d, signal) in layout.delayed.iter().enumerate() {
            let Signal::Input(input) = *signal else { continue };
            let from = t - self.known[layout.tau.start + d];
            let StageValues { value, .. } = self.followers[d].step(self.run, input as usize, (from, h), &self.rule);
            for (stage, value) in value.into_iter().enumerate() {
                self.drive[stage * width + layout.inputs + d] = value;
            }
        }
    }
}

/// Integration errors below this part of an output's range are of no consequence to any estimate.
pub(super) const TOLERANCE: f64 = 1e-8;
/// Integration error, as a part of an output's range, that is good enough for a response that is looked at only, and
/// for estimates from records with hardly any noise.
pub const SOUND: f64 = 1e-6;
/// A response with an integration error above this part of an output's range is none.
pub const UNSOUND: f64 = 1e-3;

/// The slowest ratio that is expected: first order, of jumps. It bounds kinks as well, although halving leaves a quarter of their error in
/// the mean: a kink at the part s of a step costs `s/6 - s^2/2` (Simpson's rule at `max(0, t - s)`), halving moves s, and the error is
/// at most twice the difference, where the kink stands next to a node.
const SLOWEST: f64 = 0.5;

/// The error of a response that is a difference away from that of half the steps; `ratios` are those of differences of halved steps that were
/// seen, of each to the one before. The largest counts: where kinks stand in their steps changes with every halving, and one ratio may
/// be small by chance.
pub(super) fn remaining(scheme: Scheme, difference: f64, ratios: &[f64]) -> f64 {
    let smooth = 1.0 / f64::from(1_u32 << scheme.order());
    difference / (1.0 - ratios.iter().fold(smooth, |ratio, seen| ratio.max(*seen)).min(SLOWEST))
}

/// Where a response is farthest from that with half of its steps.
#[derive(Debug, Clone, PartialEq)]
pub struct WorstError {
    /// The output, by its place.
    pub output: usize,
    /// The sample.
    pub sample: usize,
    /// The integration error there, in the output's unit.
    pub error: f64,
    /// The integration error there, as a part of the output's range.
    pub part: f64,
    /// Root of the sum of the squares of the errors at all samples, in the output's unit.
    pub norm: f64,
    /// The state that is farthest off at that sample beside its own size; none where that is not known.
    pub state: Option<usize>,
}

impl WorstError {
    /// Where two responses (N by q each) are farthest apart that were computed with these steps and with half of them, output by output
    /// as far as that is above `least` of their ranges; the worst first.
    pub fn between(coarse: &[f64], fine: &[f64], outputs: usize, steps: &Steps, least: f64) -> Vec<Self> {
        Self::apart((coarse, fine), outputs, remaining(steps.scheme(), 1.0, &[]), least)
    }

    /// Errors of each output where the error is `grown` times the difference between both responses.
    fn apart((coarse, fine): (&[f64], &[f64]), outputs: usize, grown: f64, least: f64) -> Vec<Self> {
        let mut found = Vec::new();
        for output in 0..outputs {
            let range = output_range(fine.iter().skip(output).step_by(outputs));
            let pairs = coarse.iter().zip(fine).skip(output).step_by(outputs).map(|(a, b)| (a - b).abs());
            let worst = pairs.clone().enumerate().max_by(|(i, a), (j, b)| a.total_cmp(b).then(j.cmp(i)));
            let Some((sample, off)) = worst else { continue };
            let error = off * grown;
            if error > least * range {
                let norm = grown * pairs.map(|off| off * off).sum::<f64>().sqrt();
                found.push(Self { output, sample, error, part: error / range, norm, state: None });
            }
        }
        found.sort_by(|a, b| b.part.total_cmp(&a.part));
        found
    }

    /// Where the response with half of the steps is lost.
    fn lost(place: Divergence, outputs: usize) -> Vec<Self> {
        let Divergence { sample, state, .. } = place;
        let lost = Self { output: 0, sample, error: f64::INFINITY, part: f64::INFINITY, norm: f64::INFINITY, state };
        if outputs > 0 { vec![lost] } else { Vec::new() }
    }
}

/// Where the response (N by q) with these steps is farthest from that with half of them, output by output as far as they are
/// above `least` of their ranges; the worst first. Where the response with half of them is not finite, that place alone, with an
/// infinite error.
///
/// # Errors
/// [`Unsuited`] as for [`Simulator::new`].
pub fn worst_errors(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    steps: &Steps,
    least: f64,
) -> Result<Vec<WorstError>, Unsuited> {
    let (n, q) = (dynamics.layout().states, dynamics.layout().outputs);
    let finer = steps.halved();
    let Ok(coarse) = response(dynamics, run, theta, steps)? else { return Ok(Vec::new()) };
    let fine = match response(dynamics, run, theta, &finer)? {
        Ok(fine) => fine,
        Err(lost) => return Ok(WorstError::lost(lost, q)),
    };
    let states = |steps: &Steps| -> Result<Option<Vec<f64>>, Unsuited> {
        let mut x = vec![0.0; run.len() * n];
        let known = Simulator::new(dynamics, run, steps.clone())?.states(theta, &mut x);
        Ok((known == Ok(true)).then_some(x))
    };
    let ratios = ratios(dynamics, run, theta, steps, (&coarse, &fine))?;
    let mut found = WorstError::apart((&coarse, &fine), q, remaining(steps.scheme(), 1.0, &ratios), least);
    if !found.is_empty()
        && let (Some(a), Some(b)) = (states(steps)?, states(&finer)?)
    {
        let size = |j: usize| b.iter().skip(j).step_by(n).fold(f64::MIN_POSITIVE, |s, x| s.max(x.abs()));
        let sizes: Vec<f64> = (0..n).map(size).collect();
        for worst in &mut found {
            let off = |j: usize| (a[worst.sample * n + j] - b[worst.sample * n + j]).abs() / sizes[j];
            worst.state = (0..n).max_by(|i, j| off(*i).total_cmp(&off(*j)).then(j.cmp(i)));
        }
    }
    Ok(found)
}

/// Between the least and the greatest value of an output; of what does not move its size, or 1.
pub fn output_range<'v>(values: impl Iterator<Item = &'v f64> + Clone) -> f64 {
    let high = values.clone().copied().fold(f64::NEG_INFINITY, f64::max);
    let low = values.copied().fold(f64::INFINITY, f64::min);
    if high > low { high - low } else { high.abs().max(1.0) }
}

/// Integration error of a response with these steps, measured as in [`Accuracy::error`](crate::simulate::Accuracy::error); infinite when it, or that with half the
/// steps, is not finite.
///
/// # Errors
/// [`Unsuited`] as for [`Simulator::new`].
pub fn integration_error(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    steps: impl Into<Steps>,
) -> Result<f64, Unsuited> {
    let steps = steps.into();
    if is_exact(dynamics, run, &steps) {
        return Ok(0.0);
    }
    match response(dynamics, run, theta, &steps)? {
        Ok(coarse) => error_of(dynamics, run, theta, &steps, &coarse),
        Err(_) => Ok(f64::INFINITY),
    }
}

/// Estimated integration error of a response (N by q) that is known.
///
/// # Errors
/// As [`integration_error`].
pub fn error_of(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    steps: &Steps,
    coarse: &[f64],
) -> Result<f64, Unsuited> {
    if is_exact(dynamics, run, steps) {
        return Ok(0.0);
    }
    let Ok(fine) = response(dynamics, run, theta, &steps.halved())? else { return Ok(f64::INFINITY) };
    let off = difference(coarse, &fine, dynamics.layout().outputs);
    // of no consequence whatever the order is
    let ratios = if off > (1.0 - SLOWEST) * TOLERANCE {
        ratios(dynamics, run, theta, steps, (coarse, &fine))?
    } else {
        Vec::new()
    };
    Ok(remaining(steps.scheme(), off, &ratios))
}

/// Ratios of the differences of halved steps about these, of which two responses are known: by steps of twice and four times their length
/// where these can be joined, and by a quarter elsewhere.
fn ratios(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    steps: &Steps,
    (coarse, fine): (&[f64], &[f64]),
) -> Result<Vec<f64>, Unsuited> {
    let apart = |a: &[f64], b: &[f64]| difference(a, b, dynamics.layout().outputs);
    let off = apart(coarse, fine);
    if let Some(twice) = steps.joined()
        && let Some(fourfold) = twice.joined()
        && let Ok(first) = response(dynamics, run, theta, &fourfold)?
        && let Ok(second) = response(dynamics, run, theta, &twice)?
    {
        let before = apart(&second, coarse);
        return Ok(vec![before / apart(&first, &second), off / before]);
    }
    let finest = response(dynamics, run, theta, &steps.halved().halved())?;
    Ok(vec![finest.map_or(SLOWEST, |finest| apart(fine, &finest) / off)])
}

/// Whether halving the steps changes nothing.
fn is_exact(dynamics: &dyn Dynamics, run: &Run, steps: &Steps) -> bool {
    let layout = dynamics.layout();
    let exact = matches!(steps.scheme(), Scheme::ExactDiscretisation { .. }) && layout.delayed.is_empty();
    exact || layout.states == 0 || run.len() < 2
}

/// The response (N by q), or where it is lost.
pub(super) fn response(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    steps: &Steps,
) -> Result<Result<Vec<f64>, Divergence>, Unsuited> {
    let mut simulator = Simulator::new(dynamics, run, steps.clone())?;
    simulator.suits(theta)?;
    let mut y = vec![0.0; simulator.samples() * simulator.outputs()];
    Ok(simulator.simulate(theta, &mut y).map(|()| y))
}

/// Largest difference of two responses, each output as a part of its range.
pub(super) fn difference(a: &[f64], b: &[f64], outputs: usize) -> f64 {
    let mut worst = 0.0_f64;
    for i in 0..outputs {
        let column = |y: &'_ [f64]| y.iter().skip(i).step_by(outputs).copied().collect::<Vec<f64>>();
        let (a, b) = (column(a), column(b));
        let range = output_range(b.iter());
        worst = a.iter().zip(&b).map(|(a, b)| (a - b).abs() / range).fold(worst, f64::max);
    }
    worst
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::model::Model;
    use crate::record::Run;

    /// A model whose every interval asks for very short steps would be measured for hours.
    #[test]
    fn sizes_are_measured_in_so_many_steps() {
        let model =
            Model::from_text("clock.fdm", "model clock { state x = 0; der(x) = 1 + 0*x; output y = -x; }").unwrap();
        let time: Vec<f64> = (0..50).map(f64::from).collect();
        let (measured, output_gaps) = (vec![0.0; time.len()], vec![0]);
        let (name, inputs, held, input_gaps) = ("a".into(), Vec::new(), Vec::new(), Vec::new());
        let run = Run { name, inputs, held, measured, input_gaps, stated: Vec::new(), output_gaps, time };
        let theta = model.definition().start();
        let largest = |most: usize| {
            let mut probe = Probe::new(model.dynamics(), &run, &theta, Scheme::Radau);
            measure(&mut probe, Scales::new(1, 1), most).states[0]
        };
        assert!((largest(10) - 10.0).abs() < 1e-9 && (largest(1000) - 49.0).abs() < 1e-9);
    }
}
