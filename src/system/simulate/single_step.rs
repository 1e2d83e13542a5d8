//! Single steps of a model, of any length and anywhere, whose drive at the stages is known ([`SingleStep`]).

use super::error::MOST_IMPLICIT;
use super::steps::{NODES, Scheme};
use super::stiff::Collocation;
use super::stops::take_back;
use super::trajectory::Interval;
use crate::dynamics::{Dynamics, Layout, Point, Step, Workspace};

/// Takes single steps of one model: explicit, or implicit where the scheme is [`Scheme::Radau`]. Allocates once.
pub struct SingleStep {
    pub(super) work: Workspace,
    /// The stage equations, when the method is implicit.
    pub(super) collocation: Option<Box<Collocation>>,
}

impl SingleStep {
    /// For one model.
    pub fn new(dynamics: &dyn Dynamics, scheme: Scheme) -> Self {
        let collocation = (scheme == Scheme::Radau).then(|| Box::new(Collocation::new(dynamics.layout())));
        Self { work: Workspace::new(dynamics), collocation }
    }

    /// Whether implicit steps suit a model of this size.
    pub fn may_be_implicit(layout: &Layout) -> bool {
        layout.states > 0 && layout.states <= MOST_IMPLICIT
    }

    /// The parts of a step at which its three rows of the drive stand.
    pub fn nodes(scheme: Scheme) -> [f64; 3] {
        if scheme == Scheme::Radau { NODES } else { [0.0, 0.5, 1.0] }
    }

    /// Rates at a point (n), in the memory of the steps.
    pub fn rates(&mut self, dynamics: &dyn Dynamics, at: Point<'_>, out: &mut [f64]) {
        dynamics.rates(at, out, &mut self.work);
    }

    /// Forgets the steps before, so that the next one depends on nothing but its arguments.
    pub fn begin(&mut self) {
        if let Some(collocation) = &mut self.collocation {
            collocation.begin();
        }
    }

    /// Takes a step, limited states taken back into their limits; the rows of its drive stand at [`Self::nodes`]. `false` when the end
    /// (n) is not finite or cannot be found.
    pub fn take(&mut self, dynamics: &dyn Dynamics, step: Step<'_>, next: &mut [f64]) -> bool {
        let Step { t, h, x, drive, known } = step;
        let solved = match &mut self.collocation {
            None => {
                dynamics.step(step, next, &mut self.work);
                true
            }
            Some(collocation) => {
                let interval = Interval { t, h, x, drive, slopes: &[], known };
                collocation.step(dynamics, interval, next, &mut self.work).is_ok()
            }
        };
        take_back(dynamics.layout(), known, next, |_, _| {});
        solved && next.iter().all(|x| x.is_finite())
    }
}
