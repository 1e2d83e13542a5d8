//! One search for one more effect: directions of all candidates, and their screening.

use super::attached::Attached;
use super::domain::Domain;
use super::measured::Measured;
use super::options::SearchOptions;
use super::search_error::SearchError;
use super::stage::{Stage, records};
use super::trace::{Trace, trace};
use crate::diagnose::diagnosis::{EffectAt, LeftOut};
use crate::diagnose::screen::{Direction, Record, Screening, ScreeningOptions};
use crate::record::Run;
use fdm_grammar::effect::{Candidate, Kind};
use rayon::prelude::*;
use std::sync::Arc;

/// The runs of a diagnosis: those that are learned from, then those that are held out.
#[derive(Clone, Copy)]
pub(super) struct Runs<'a> {
    /// All of them.
    pub(super) all: &'a [Run],
    /// How many are learned from.
    pub(super) train: usize,
    /// Where they are compared with models.
    pub(super) domain: &'a Domain,
}

impl<'a> Runs<'a> {
    pub(super) fn train(&self) -> &'a [Run] {
        &self.all[..self.train]
    }

    pub(super) fn held(&self) -> &'a [Run] {
        &self.all[self.train..]
    }
}

/// A search for one more effect.
pub(super) struct Round<'a> {
    pub(super) stage: Arc<Stage>,
    pub(super) runs: Runs<'a>,
    pub(super) traces: Vec<Trace>,
    pub(super) left_out: Vec<LeftOut>,
    /// Trace and point of each direction.
    pub(super) owner: Vec<(usize, usize)>,
    pub(super) screening: Screening,
    pub(super) records: Vec<Record>,
    pub(super) options: ScreeningOptions,
    /// What the columns of the records are derivatives by: what all runs share, what belongs to each run (behind the parameters stands
    /// what belongs to a run and is none).
    pub(super) free: (Vec<usize>, Vec<usize>),
}

/// The price of a parameter in log-likelihood.
pub(super) const PRICE: f64 = 3.0;

/// The name under which results speak of a candidate.
pub(super) fn place(candidate: &Candidate) -> EffectAt {
    EffectAt { effect: candidate.effect().name().to_string(), targets: candidate.targets().to_vec() }
}

impl<'a> Round<'a> {
    /// Simulates and screens all candidates.
    pub(super) fn new(
        stage: Arc<Stage>,
        runs: Runs<'a>,
        candidates: &[Candidate],
        measured: &Measured,
        options: &SearchOptions,
    ) -> Result<Self, SearchError> {
        let scored: Vec<&Candidate> = candidates.iter().filter(|c| c.kind() != Kind::Variance).collect();
        let found: Vec<Result<Trace, String>> =
            scored.par_iter().map(|candidate| trace(candidate, &stage, runs, measured)).collect();
        let (mut traces, mut left_out) = (Vec::new(), Vec::new());
        for (candidate, found) in scored.iter().zip(found) {
            match found {
                Ok(trace) => traces.push(trace),
                Err(reason) => left_out.push(LeftOut { place: place(candidate), reason }),
            }
        }
        if traces.is_empty() {
            return Err(SearchError::NoPlaces);
        }
        let free = stage.columns(runs);
        let mut records = records(&stage.model, runs.train(), &stage.ways, &stage.theta)?;
        let (mut directions, mut owner) = (Vec::new(), Vec::new());
        for (t, trace) in traces.iter_mut().enumerate() {
            for (k, (point, parts)) in trace.points.iter().zip(std::mem::take(&mut trace.signals)).enumerate() {
                directions.push(Direction { candidate: t, size: point.size(), shape: point.shape });
                owner.push((t, k));
                records.iter_mut().zip(parts).for_each(|(record, part)| record.directions.push(part));
            }
        }
        let screening = stage.screened(&records, &directions, &options.screening)?;
        let options = options.screening;
        Ok(Self { stage, runs, traces, left_out, owner, screening, records, options, free })
    }
}

/// Values of the new parameters in a vector of all.
pub(super) fn new_values(attached: &Attached, theta: &[f64]) -> Vec<f64> {
    attached.new.iter().map(|k| theta[*k]).collect()
}

/// Parameters of each run with what all runs share from elsewhere.
pub(super) fn shared_from(params: &[fdm_grammar::model::Param], shared: &[f64], own: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let of = |theta: &Vec<f64>| {
        let each = params.iter().zip(shared.iter().zip(theta));
        each.map(|(p, (shared, own))| if p.per_run { *own } else { *shared }).collect()
    };
    own.iter().map(of).collect()
}
