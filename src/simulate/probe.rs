//! One step of any length anywhere in a run: what is tried while steps are chosen.

use super::drive::inputs_of_step;
use super::implicit::{Collocation, Interval};
use super::moments::{Follower, Rule, StageValues};
use super::scheme::Scheme;
use crate::dynamics::{Dynamics, Point, Step, Workspace};
use crate::record::Run;
use fdm_grammar::graph::Signal;

/// Takes steps of a model without delayed states.
pub(super) struct Probe<'a> {
    dynamics: &'a dyn Dynamics,
    pub(super) run: &'a Run,
    rule: Rule,
    known: Vec<f64>,
    followers: Vec<Follower>,
    drive: Vec<f64>,
    work: Workspace,
    /// The stage equations, when the method is implicit.
    pub(super) collocation: Option<Box<Collocation>>,
}

impl<'a> Probe<'a> {
    pub(super) fn new(dynamics: &'a dyn Dynamics, run: &'a Run, theta: &[f64], scheme: Scheme) -> Self {
        let (layout, mut work) = (dynamics.layout(), Workspace::new(dynamics));
        let mut known = vec![0.0; layout.known];
        dynamics.prepare(theta, &mut known, &mut work);
        Self {
            dynamics,
            run,
            rule: Rule::of(scheme),
            known,
            followers: layout.delayed.iter().map(|_| Follower::default()).collect(),
            drive: vec![0.0; 3 * layout.drive()],
            work,
            collocation: (scheme == Scheme::Radau).then(|| Box::new(Collocation::new(layout))),
        }
    }

    /// The states at the beginning of the run; `false` when they, or a delay, are not finite.
    pub(super) fn begin(&mut self, x: &mut [f64]) -> bool {
        let layout = self.dynamics.layout();
        x.copy_from_slice(&self.known[layout.initial.clone()]);
        if let Some(collocation) = &mut self.collocation {
            collocation.begin();
        }
        x.iter().chain(&self.known[layout.tau.clone()]).all(|v| v.is_finite())
    }

    /// The step from one part of an interval to another; `false` when its end is not finite or cannot be found.
    pub(super) fn step(&mut self, interval: usize, (begin, end): (f64, f64), x: &[f64], next: &mut [f64]) -> bool {
        let layout = self.dynamics.layout();
        let (from, to) = (self.run.time[interval], self.run.time[interval + 1]);
        let (t, h) = (from + (to - from) * begin, (to - from) * (end - begin));
        self.feed(interval, (begin, end), (t, h));
        let (drive, known) = (&self.drive[..], &self.known[..]);
        let solved = match &mut self.collocation {
            None => {
                self.dynamics.step(Step { t, h, x, drive, known }, next, &mut self.work);
                true
            }
            Some(collocation) => {
                let step = Interval { t, h, x, drive, slopes: &[], known };
                let (dynamics, work) = (self.dynamics, &mut self.work);
                pulp::Arch::new().dispatch(|| collocation.step(dynamics, step, next, work)).is_ok()
            }
        };
        debug_assert_eq!(next.len(), layout.states);
        solved && next.iter().all(|x| x.is_finite())
    }

    /// Outputs at the end of the step that was taken last.
    pub(super) fn outputs(&mut self, t: f64, x: &[f64], y: &mut [f64]) {
        let width = self.dynamics.layout().drive();
        let at = Point { t, x, drive: &self.drive[2 * width..], known: &self.known };
        self.dynamics.outputs(at, y, &mut self.work);
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
