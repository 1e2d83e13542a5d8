//! What speaks for a force or an unknown cause, beside the effects that were accepted.

use super::round::Runs;
use super::search_error::SearchError;
use super::stage::{Stage, records};
use super::way::Way;
use crate::diagnose::force::{
    Attribution, Evidence, Explained, Leftover, Localisation, Passage, Suggestions, attribute, leftover, localise,
    suggestions,
};
use crate::diagnose::misfit::{Misfit, SpectralPassage, misfit, misfit_of_lines};
use crate::diagnose::screen::Record;

/// A model at its fit with the records of its runs.
pub(super) struct Seen<'a> {
    stage: &'a Stage,
    runs: Runs<'a>,
    theta: &'a [Vec<f64>],
    records: Vec<Record>,
}

/// What the residuals of a model say.
pub(super) struct Heard {
    pub(super) places: Localisation,
    pub(super) leftover: Leftover,
}

impl<'a> Seen<'a> {
    /// The runs that are learned from, at these values.
    pub(super) fn new(stage: &'a Stage, runs: Runs<'a>, theta: &'a [Vec<f64>]) -> Result<Self, SearchError> {
        let records = records(&stage.model, runs, &stage.ways, theta)?;
        Ok(Self { stage, runs, theta, records })
    }

    fn passages<'b>(&'b self) -> Vec<Passage<'b>> {
        let parts = self.runs.train().iter().zip(&self.stage.ways).zip(self.theta.iter().zip(&self.records));
        let of = |((run, way), (theta, record)): ((_, &'b Way), (&'b Vec<f64>, _))| {
            Some(Passage { run, steps: way.steps()?, theta, record })
        };
        parts.filter_map(of).collect()
    }

    /// What is wrong, in every output.
    pub(super) fn misfit(&self) -> Vec<Misfit> {
        let lines: Vec<SpectralPassage> =
            self.stage.ways.iter().zip(&self.records).filter_map(|(way, record)| way.passage(record)).collect();
        if !lines.is_empty() {
            return misfit_of_lines(&self.stage.model, &lines);
        }
        misfit(&self.stage.model, &self.passages())
    }

    /// Where a force would enter, and whether residuals are noise; none where that cannot be asked.
    pub(super) fn heard(&self) -> Option<Heard> {
        let passages = self.passages();
        let places = localise(&self.stage.model, &passages).ok()?;
        Some(Heard { places, leftover: leftover(&self.stage.model, &passages).ok()? })
    }

    /// Functions of states and inputs that the residuals look like.
    pub(super) fn suggestions(&self) -> Option<Suggestions> {
        suggestions(&self.stage.model, &self.passages()).ok()
    }
}

impl Heard {
    fn evidence(&self) -> Evidence<'_> {
        Evidence { places: &self.places, leftover: &self.leftover }
    }

    /// Weighs what was accepted, with so many parameters, against a force and the unknown.
    pub(super) fn against(&self, accepted: Option<(&Self, usize)>) -> Attribution {
        let explained = accepted.map(|(heard, params)| Explained { evidence: heard.evidence(), params });
        attribute(self.evidence(), explained)
    }
}
