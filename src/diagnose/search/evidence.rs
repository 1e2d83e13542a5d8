//! What speaks for a force or an unknown cause, beside the effects that were accepted.

use super::round::Runs;
use super::search_error::SearchError;
use super::stage::{Stage, free, record};
use crate::diagnose::force::{Attribution, Explained, Heard, Passage, Suggestions, attribute, heard, suggestions};
use crate::diagnose::misfit::{Misfit, misfit};
use crate::diagnose::screen::Record;
use crate::model::Model;
use crate::record::Run;

/// A model at its fit with the records of its runs.
pub(super) struct Seen<'a> {
    stage: &'a Stage,
    runs: Runs<'a>,
    theta: &'a [Vec<f64>],
    records: Vec<Record>,
}

impl<'a> Seen<'a> {
    /// All runs at these values: what is left is asked of held-out runs as well, the fitted parameters free in all of them.
    pub(super) fn new(stage: &'a Stage, runs: Runs<'a>, theta: &'a [Vec<f64>]) -> Result<Self, SearchError> {
        let (shared, own) = free(stage.params());
        let of = |(r, run): (usize, &Run)| {
            let at = (&stage.steps[r], &theta[r][..]);
            Ok(record(stage.model.dynamics(), run, at, (&shared, &own), (r, runs.all.len()))?.0)
        };
        let records = runs.all.iter().enumerate().map(of).collect::<Result<_, SearchError>>()?;
        Ok(Self { stage, runs, theta, records })
    }

    fn passages(&self) -> Vec<Passage<'_>> {
        let parts = self.runs.all.iter().zip(&self.stage.steps).zip(self.theta.iter().zip(&self.records));
        parts.map(|((run, steps), (theta, record))| Passage { run, steps, theta, record }).collect()
    }

    /// What is wrong, in every output, on the runs that are learned from.
    pub(super) fn misfit(&self) -> Vec<Misfit> {
        misfit(&self.stage.model, &self.passages()[..self.runs.train])
    }

    /// Where a force would enter, and whether residuals are noise; none where that cannot be asked.
    pub(super) fn heard(&self) -> Option<Heard> {
        heard(&self.stage.model, &self.passages()).ok()
    }

    /// Functions of states and inputs that the residuals look like.
    pub(super) fn suggestions(&self) -> Option<Suggestions> {
        suggestions(&self.stage.model, &self.passages()).ok()
    }
}

/// Weighs what was accepted, with so many parameters, against a force and the unknown.
pub(super) fn against(model: &Model, base: &Heard, accepted: Option<(&Heard, usize)>) -> Attribution {
    attribute(model, base, accepted.map(|(evidence, params)| Explained { evidence, params }))
}
