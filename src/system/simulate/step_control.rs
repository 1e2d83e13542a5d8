//! Steps as long as accuracy allows: each is compared with two of half its length (Hairer, Norsett & Wanner, Solving ordinary
//! differential equations I, II.4).
//!
//! Embedded formulas would cost less, but the implicit method's is of order 3 only and would ask for many more steps than
//! the method of order 5 needs; and steps are chosen once for a whole fit. A [`Probe`] takes steps of any length anywhere in a run.

use super::delayed_inputs::{Follower, Rule, StageValues};
use super::drive::inputs_of_step;
use super::single_step::SingleStep;
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
/// Shortest step as a part of its interval.
const SHORTEST: f64 = 1e-14;
/// Shortest step as a part of its interval while sizes are measured.
const SHORTEST_MEASURING: f64 = 1e-6;
/// Differences below this part of a value are rounding.
const ROUNDING: f64 = 1e-14;

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
            let difference = (a - b).abs() - ROUNDING * b.abs();
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
                if length < SHORTEST_MEASURING {
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
            if ends.len() >= most || end - begin < SHORTEST || from + whole * begin + length <= from + whole * begin {
                return None;
            }
            let past = probe.past();
            let error = self.attempt(probe, interval, (begin, end));
            let after = probe.past();
            let Some(error) = error.filter(|e| *e <= self.tolerance) else {
                let factor = error.map_or(CUT, |e| self.factor(e).min(0.8));
                self.wanted = length * factor;
                resume(probe, past.as_ref());
                continue;
            };
            // what the frozen steps will give, and its collocation polynomial: the coarse step's
            resume(probe, after.as_ref());
            let longer = length * self.factor(error);
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

    fn factor(&self, error: f64) -> f64 {
        let exponent = 1.0 / f64::from(self.scheme.order() + 1);
        (SAFETY * (self.tolerance / error.max(f64::MIN_POSITIVE)).powf(exponent)).clamp(SHRINKING, GROWTH)
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
