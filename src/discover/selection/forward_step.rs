//! One search for one more effect: directions of all candidates, and their screening.
//!
//! What screening says of each candidate: its rank, and how small it could have been and still be seen.

use super::directions::{CandidateDirections, TrialPoint};
use super::error::DiagnosisError;
use super::extended_model::{SignalScales, place};
use super::fitted_model::{FittedModel, records};
use super::forced_tiles::all_directions;
use super::runs::{DiagnosisOptions, Domain, Runs};
use crate::bins::Record;
use crate::diagnosis::{Detectable, LeftOut, Screened};
use crate::noise::Growth;
use crate::screening::{Direction, Screening, ScreeningOptions};
use fdm_effects::{Candidate, Kind};
use fdm_estimate::Work;
use fdm_grammar::syntax::Class;
use fdm_system::record::Run;
use std::sync::Arc;

/// A search for one more effect.
pub(super) struct ForwardStep<'a> {
    pub(super) current: Arc<FittedModel>,
    pub(super) runs: Runs<'a>,
    pub(super) simulated: Vec<CandidateDirections>,
    pub(super) left_out: Vec<LeftOut>,
    /// CandidateDirections and point of each direction.
    pub(super) owner: Vec<(usize, usize)>,
    pub(super) screening: Screening,
    pub(super) records: Vec<Record>,
    pub(super) options: ScreeningOptions,
    /// How the noise of each output grows with its signal.
    pub(super) growth: Arc<[Option<Growth>]>,
    work: &'a Work<'a>,
    /// What the columns of the records are derivatives by: what all runs share, what belongs to each run (behind the parameters stands
    /// what belongs to a run and is none).
    pub(super) free: (Vec<usize>, Vec<usize>),
}

/// The penalty of a parameter in log-likelihood.
pub(super) const PENALTY: f64 = 3.0;

/// What an explanation costs beside its parameters, in log-likelihood: physics is believed first, what can take the place of many
/// causes last.
pub(super) fn prior(class: Class) -> f64 {
    match class {
        Class::Mechanism => 0.0,
        Class::Sensor => 1.0,
        Class::StandIn => 4.0,
    }
}

impl<'a> ForwardStep<'a> {
    /// Simulates and screens all candidates.
    pub(super) fn new(
        current: Arc<FittedModel>,
        runs: Runs<'a>,
        candidates: &[Candidate],
        scales: &SignalScales,
        (options, work): (&DiagnosisOptions, &'a Work<'a>),
    ) -> Result<Self, DiagnosisError> {
        let scored: Vec<&Candidate> = candidates.iter().filter(|c| c.kind() != Kind::Variance).collect();
        let found = all_directions(&scored, (&current, runs, scales), work);
        let found = found.ok_or(DiagnosisError::Stopped)?;
        let (mut simulated, mut left_out) = (Vec::new(), Vec::new());
        for (candidate, found) in scored.iter().zip(found) {
            match found {
                Ok(trace) => simulated.push(trace),
                Err(reason) => left_out.push(LeftOut { place: place(candidate), reason }),
            }
        }
        if simulated.is_empty() {
            return Err(DiagnosisError::NoPlaces);
        }
        let free = current.columns(runs);
        let mut records = records(&current.model, runs.train(), &current.predictors, &current.theta)?;
        let growth = growth(&records, runs, current.outputs());
        weigh(&mut records, runs.train(), &growth);
        let (mut directions, mut owner) = (Vec::new(), Vec::new());
        for (t, trace) in simulated.iter_mut().enumerate() {
            for (k, (point, parts)) in trace.points.iter().zip(std::mem::take(&mut trace.signals)).enumerate() {
                directions.push(Direction { candidate: t, size: point.size(), shape: point.shape });
                owner.push((t, k));
                records.iter_mut().zip(parts).for_each(|(record, part)| record.directions.push(part));
            }
        }
        let screening = current.screened(&records, &directions, &options.screening)?;
        let options = options.screening;
        Ok(Self { current, runs, simulated, left_out, owner, screening, records, options, growth, work, free })
    }
}

/// How the noise of each output grows with its signal; nothing in the frequency domain.
fn growth(records: &[Record], runs: Runs<'_>, q: usize) -> Arc<[Option<Growth>]> {
    if *runs.domain != Domain::Time {
        return Arc::new([]);
    }
    let train = runs.train().iter().map(|run| &run.measured[..]);
    let pairs: Vec<(&[f64], &[f64])> = records.iter().map(|r| &r.residual[..]).zip(train).collect();
    (0..q).map(|o| Growth::found(&pairs, (o, q))).collect()
}

/// Gives records the relative deviations of their noise.
pub(super) fn weigh(records: &mut [Record], runs: &[Run], growth: &[Option<Growth>]) {
    if growth.iter().all(Option::is_none) {
        return;
    }
    let q = growth.len();
    for (record, run) in records.iter_mut().zip(runs) {
        let mut all = vec![1.0; run.measured.len()];
        for (o, growth) in growth.iter().enumerate().filter_map(|(o, growth)| Some((o, growth.as_ref()?))) {
            let own = growth.deviations(&run.measured, (o, q));
            own.into_iter().enumerate().for_each(|(k, deviation)| all[k * q + o] = deviation);
        }
        record.deviations = Some(all);
    }
}

/// Normal quantile of the power with which an effect of the smallest size is seen: four times in five.
const POWER: f64 = 0.84;
/// What is left of a direction beside the fitted parameters below which nobody could see it.
const ABSORBED: f64 = 1e-3;
/// Of chi-square with one degree of freedom, once in a hundred times.
const SINGLE: f64 = 6.63;

impl ForwardStep<'_> {
    /// Whether work may go on.
    ///
    /// # Errors
    /// [`DiagnosisError::Stopped`] where it may not.
    pub(super) fn may_go_on(&self) -> Result<(), DiagnosisError> {
        if self.work.goes_on() { Ok(()) } else { Err(DiagnosisError::Stopped) }
    }

    /// Something of what a direction adds to each run (N by q).
    pub(super) fn with_direction<T>(&self, direction: usize, of: impl FnOnce(&[&[f64]]) -> T) -> T {
        let q = self.current.outputs();
        let whole: Vec<_> = self.records.iter().map(|record| record.direction(direction, q)).collect();
        of(&whole.iter().map(|part| &part[..]).collect::<Vec<_>>())
    }

    /// Candidates by rank.
    pub(super) fn ranking(&self) -> Vec<Screened> {
        self.screening.ranking.iter().map(|t| self.screened(*t)).collect()
    }

    fn screened(&self, t: usize) -> Screened {
        let (candidate, attached) = (&self.screening.candidates[t], &self.simulated[t].attached);
        let point = candidate.direction.map(|d| &self.simulated[t].points[self.owner[d].1]);
        let lead = point.map_or(attached.size(), |p| p.lead);
        let size = point.map(|p| p.at(candidate.amount, attached.params())[p.lead]);
        Screened {
            place: place(&attached.candidate),
            gain: 0.5 * candidate.statistic,
            chance: candidate.chance,
            distinct: candidate.distinct,
            size,
            parameter: attached.params().get(lead).map_or(String::new(), |p| p.name.clone()),
        }
    }

    /// The smallest sizes that would be found by a search of this kind at one in a hundred.
    pub(super) fn detectable(&self) -> Vec<Detectable> {
        let width = self.width();
        (0..self.simulated.len()).map(|t| self.smallest(t, width)).collect()
    }

    /// How many independent candidates the search is worth: from the chance of the best of all and that of the best alone.
    fn width(&self) -> f64 {
        let least = self.screening.candidates.iter().map(|c| c.chance).fold(1.0, f64::min);
        let all = self.screening.family_wise.clamp(1e-12, 0.999);
        let width = (-all).ln_1p() / (-least.clamp(1e-12, 0.999)).ln_1p();
        width.clamp(1.0, self.simulated.len() as f64)
    }

    fn smallest(&self, t: usize, width: f64) -> Detectable {
        let (candidate, trace) = (&self.screening.candidates[t], &self.simulated[t]);
        let own = (candidate.statistic - candidate.lead).max(SINGLE);
        let needed = (own + 2.0 * width.ln()).sqrt() + POWER;
        let directions = (0..self.owner.len()).filter(|d| self.owner[*d].0 == t);
        let sizes = directions.filter_map(|d| {
            let norm = self.screening.gram[(d, d)].max(0.0).sqrt();
            let point = &trace.points[self.owner[d].1];
            (norm > 0.0).then(|| (point, needed / norm))
        });
        let absorbed = candidate.direction.is_none() || candidate.distinct < ABSORBED;
        let lead = candidate.direction.map_or(trace.attached.size(), |d| trace.points[self.owner[d].1].lead);
        let param = &trace.attached.params()[lead];
        let reach = |(point, multiple): (&TrialPoint, f64)| {
            let value = if point.is_linear() {
                param.null + multiple
            } else if param.null.is_finite() {
                param.null + multiple * (point.values[lead] - param.null)
            } else {
                point.values[lead] / multiple
            };
            // a finite direction is believed near its own size: the trial that needs the least stretching speaks
            let stretch = if point.is_linear() { multiple } else { multiple.ln().abs() };
            (stretch, value)
        };
        let of_lead = sizes.filter(|(point, _)| point.lead == lead).map(reach);
        let best = of_lead.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, value)| value);
        Detectable {
            place: place(&trace.attached.candidate),
            parameter: param.name.clone(),
            smallest: best.filter(|v| v.is_finite() && !absorbed),
            unit: param.unit.as_ref().map(|u| u.text().to_string()),
            distinct: candidate.distinct,
        }
    }
}
