//! Steps that all starts of a multi-start have in common.

use crate::model::Model;
use crate::record::Run;
use crate::simulate::{Accuracy, Simulator, Steps};

/// Steps of each run that were chosen once for many starts: what they reach is then comparable, and wild start values do not
/// ask for wildly fine steps.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Footing {
    /// Empty when every start chooses its own.
    steps: Vec<Steps>,
    /// Whether steps count as good enough that a result must not be reported with.
    provisional: bool,
}

/// Integration errors at the estimates above this part of an output's range are worth another round with finer steps.
const COARSE: f64 = 1e-7;
/// The same where only the best of many starts is looked at once more.
const UNSOUND: f64 = 1e-3;

impl Footing {
    /// The steps that were chosen for the given start, unless it cannot be simulated.
    pub fn of(chosen: Vec<Accuracy>) -> Self {
        let usable = chosen.iter().all(|a| a.error.is_finite());
        let steps = if usable { chosen.into_iter().map(|a| a.steps).collect() } else { Vec::new() };
        Self { steps, provisional: false }
    }

    /// The same for starts of which only the best is looked at once more.
    pub(in crate::estimate) fn provisional(&self) -> Self {
        Self { steps: self.steps.clone(), provisional: !self.steps.is_empty() }
    }

    /// Whether only the best of many starts is looked at once more.
    pub(in crate::estimate) fn is_provisional(&self) -> bool {
        self.provisional
    }

    /// The integration error that calls for finer steps.
    pub(in crate::estimate) fn coarse(&self) -> f64 {
        if self.provisional { UNSOUND } else { COARSE }
    }

    /// The steps of these runs, or of parts of them from their beginnings; none where they cannot be simulated with them.
    pub(in crate::estimate) fn steps(&self, model: &Model, runs: &[Run], starts: &[Vec<f64>]) -> Option<Vec<Steps>> {
        if self.steps.len() != runs.len() || runs.is_empty() {
            return None;
        }
        let steps: Vec<Steps> = self.steps.iter().zip(runs).map(|(steps, run)| steps.part(0..run.len())).collect();
        let reached = |((run, theta), steps): ((&Run, &Vec<f64>), &Steps)| {
            let Ok(mut simulator) = Simulator::new(model.dynamics(), run, steps.clone()) else { return false };
            let mut y = vec![0.0; simulator.samples() * simulator.outputs()];
            simulator.suits(theta).is_ok() && simulator.simulate(theta, &mut y).is_ok()
        };
        runs.iter().zip(starts).zip(&steps).all(reached).then_some(steps)
    }
}
