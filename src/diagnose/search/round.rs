//! One search for one more effect: directions of all candidates, and their screening.

use super::attached::Attached;
use super::measured::Measured;
use super::options::SearchOptions;
use super::search_error::SearchError;
use super::stage::{Stage, free, record};
use super::trace::{Trace, trace};
use crate::diagnose::diagnosis::{EffectAt, LeftOut};
use crate::diagnose::screen::{Direction, Record, Screening, ScreeningOptions, screen};
use crate::record::Run;
use crate::simulate::{Scheme, Steps};
use fdm_grammar::effect::{Candidate, Kind};
use rayon::prelude::*;
use std::sync::Arc;

/// Steps of an interval that are not halved for a fit: kinks want more of them than they are worth.
const ENOUGH: usize = 8;
/// The runs of a diagnosis: those that are learned from, then those that are held out.
#[derive(Clone, Copy)]
pub(super) struct Runs<'a> {
    /// All of them.
    pub(super) all: &'a [Run],
    /// How many are learned from.
    pub(super) train: usize,
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
    pub(super) directions: Vec<Direction>,
    pub(super) options: ScreeningOptions,
    /// Free parameters of the stage: those that all runs share, those of each run.
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
            scored.par_iter().map(|candidate| trace(candidate, &stage, runs.train(), measured)).collect();
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
        let (shared, own) = free(stage.params());
        let mut records = Vec::with_capacity(runs.train);
        for (r, run) in runs.train().iter().enumerate() {
            let at = (&stage.steps[r], &stage.theta[r][..]);
            records.push(record(stage.model.dynamics(), run, at, (&shared, &own), (r, runs.train))?.0);
        }
        let (mut directions, mut owner) = (Vec::new(), Vec::new());
        for (t, trace) in traces.iter_mut().enumerate() {
            for (k, (point, parts)) in trace.points.iter().zip(std::mem::take(&mut trace.signals)).enumerate() {
                directions.push(Direction { candidate: t, size: point.size(), shape: point.shape });
                owner.push((t, k));
                records.iter_mut().zip(parts).for_each(|(record, part)| record.directions.push(part));
            }
        }
        let screening = screen(&records, stage.outputs(), &directions, &options.screening)?;
        let options = options.screening;
        Ok(Self { stage, runs, traces, left_out, owner, screening, records, directions, options, free: (shared, own) })
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

/// Steps for a fit: half of those that were enough for a direction, unless the recursion is exact.
pub(super) fn finer(steps: &Steps) -> Steps {
    let enough = matches!(steps.scheme(), Scheme::Recursion { .. }) || steps.most() >= ENOUGH;
    if enough { steps.clone() } else { steps.halved() }
}
