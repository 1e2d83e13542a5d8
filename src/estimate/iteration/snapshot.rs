//! The state of an iteration as bytes, so that one that was interrupted goes on and ends with the same bits.
//!
//! What follows from the estimates (responses, weights, sums) is computed anew: the same values give the same bits.

use super::correction::Correction;
use super::evaluation::RunFailure;
use super::restart::Attempts;
use super::secant::Secant;
use crate::estimate::problem::ProblemError;
use crate::estimate::progress::Iteration;
use serde::{Deserialize, Serialize};

/// Changes with every change of what is kept or of what the iteration makes of it.
const VERSION: u16 = 2;

/// Everything that decides how an iteration goes on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(in crate::estimate) struct Snapshot {
    version: u16,
    /// The current estimates.
    values: Vec<f64>,
    damping: f64,
    level: f64,
    precise: bool,
    projecting: bool,
    /// What the correction before promised, when the cost could not measure it.
    last: f64,
    promised: f64,
    secant: Secant,
    attempts: Attempts,
    searched: Option<usize>,
    evaluations: (usize, usize),
    history: Vec<Iteration>,
}

impl Snapshot {
    /// Reads what [`Correction::snapshot`] wrote for a problem with `unknowns` unknowns.
    ///
    /// # Errors
    /// Bytes that were not written by this version, or for another problem.
    pub(in crate::estimate) fn read(bytes: &[u8], unknowns: usize) -> Result<Self, ProblemError> {
        let refused = |reason| ProblemError::ForeignState { reason };
        let snapshot: Self = postcard::from_bytes(bytes).map_err(|_| refused("it is damaged"))?;
        if snapshot.version != VERSION {
            return Err(refused("it was kept by another version of this program"));
        }
        if snapshot.values.len() != unknowns {
            return Err(refused("it has another number of free parameters"));
        }
        if snapshot.history.is_empty() || snapshot.values.iter().any(|v| !v.is_finite()) {
            return Err(refused("it is damaged"));
        }
        Ok(snapshot)
    }
}

impl Correction<'_, '_, '_> {
    /// The state after the last iteration that was recorded.
    pub(in crate::estimate) fn snapshot(&self) -> Vec<u8> {
        let snapshot = Snapshot {
            version: VERSION,
            values: self.values.clone(),
            damping: self.damping,
            level: self.level,
            precise: self.precise,
            projecting: self.projecting,
            last: self.last,
            promised: self.promised,
            secant: self.secant.clone(),
            attempts: self.attempts.clone(),
            searched: self.searched,
            evaluations: (self.evaluator.evaluations, self.evaluator.simulations),
            history: self.history.clone(),
        };
        // numbers and lists of numbers always have bytes; none would be refused as damaged
        postcard::to_stdvec(&snapshot).unwrap_or_default()
    }

    /// Goes back to a state and evaluates what follows from it, which is not counted.
    ///
    /// # Errors
    /// The run that cannot be simulated there.
    pub(in crate::estimate) fn restore(&mut self, snapshot: Snapshot) -> Result<(), RunFailure> {
        let Snapshot {
            values,
            damping,
            level,
            precise,
            projecting,
            last,
            promised,
            secant,
            attempts,
            searched,
            evaluations,
            history,
            ..
        } = snapshot;
        self.searched = searched;
        self.trial.clone_from(&values);
        (self.values, self.damping, self.level, self.last, self.history) = (values, damping, level, last, history);
        (self.promised, self.secant, self.attempts, self.projecting) = (promised, secant, attempts, projecting);
        if precise {
            self.precise = true;
            self.evaluator.make_precise();
        }
        self.start()?;
        (self.evaluator.evaluations, self.evaluator.simulations) = evaluations;
        Ok(())
    }
}
