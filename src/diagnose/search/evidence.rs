//! What speaks for a force or an unknown cause, beside the effects that were accepted.

use super::round::Runs;
use super::search_error::SearchError;
use super::stage::{Stage, records};
use super::way::Way;
use crate::diagnose::force::{Attribution, Explained, Heard, Passage, Suggestions, attribute, heard, suggestions};
use crate::diagnose::misfit::{Left, Misfit, SpectralPassage, misfit, misfit_of_lines};
use crate::diagnose::screen::Record;
use crate::model::Model;

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
        let records = records(&stage.model, runs.all, &stage.ways, theta)?;
        Ok(Self { stage, runs, theta, records })
    }

    fn passages<'b>(&'b self) -> Vec<Passage<'b>> {
        let parts = self.runs.all.iter().zip(&self.stage.ways).zip(self.theta.iter().zip(&self.records));
        let of = |((run, way), (theta, record)): ((_, &'b Way), (&'b Vec<f64>, _))| {
            Some(Passage { run, steps: way.steps()?, theta, record })
        };
        parts.filter_map(of).collect()
    }

    /// What is wrong, in every output, on the runs that are learned from.
    pub(super) fn misfit(&self) -> Vec<Misfit> {
        let ways = self.stage.ways.iter().zip(&self.records).take(self.runs.train);
        let lines: Vec<SpectralPassage> = ways.filter_map(|(way, record)| way.passage(record)).collect();
        if !lines.is_empty() {
            return misfit_of_lines(&self.stage.model, &lines);
        }
        let mut left = Vec::new();
        for (run, record) in self.runs.all.iter().zip(&self.records).take(self.runs.train) {
            left.push(Left { run, residual: &record.residual, interval: record.interval });
        }
        misfit(&self.stage.model, &left)
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
