//! One search for one more effect: directions of all candidates, their screening, and the best fitted jointly with the model.

use super::attached::Attached;
use super::beside::Beside;
use super::domain::Domain;
use super::measured::Measured;
use super::metric::Metric;
use super::options::{SearchOptions, Watcher};
use super::refit::{Fitting, Posed};
use super::search_error::SearchError;
use super::stage::{Stage, records};
use super::trace::{Trace, trace};
use super::way::Way;
use crate::diagnose::diagnosis::{EffectAt, LeftOut};
use crate::diagnose::screen::{Direction, Record, Screening, ScreeningOptions};
use crate::model::Model;
use crate::record::Run;
use fdm_grammar::effect::{Candidate, Kind};
use rayon::prelude::*;

/// Candidates that are refitted, at least.
const FEWEST: usize = 8;
/// And at most.
const MOST: usize = 24;
/// Part of the best promised gain from which a candidate is refitted in any case.
const REACH: f64 = 0.6;
/// Points from which a refit begins.
const STARTS: usize = 5;
/// Starts that are followed to their end.
const FOLLOWED: usize = 2;
/// Corrections of a first look, and of a fit.
const LOOK: usize = 3;
const WHOLE: usize = 25;
/// Contenders that stay this far behind the best, and below this part of its gain, are not judged by the second noise.
const BEHIND: f64 = 40.0;
const PART: f64 = 0.25;

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
    pub(super) stage: &'a Stage,
    pub(super) runs: Runs<'a>,
    pub(super) traces: Vec<Trace>,
    pub(super) left_out: Vec<LeftOut>,
    /// Trace and point of each direction.
    pub(super) owner: Vec<(usize, usize)>,
    pub(super) screening: Screening,
    records: Vec<Record>,
    directions: Vec<Direction>,
    options: ScreeningOptions,
}

/// An effect that was fitted jointly with the model.
pub(super) struct Contender {
    /// Its trace.
    pub(super) trace: usize,
    /// The extended model under the base model's text.
    pub(super) model: Model,
    /// How it answers all runs.
    pub(super) ways: Vec<Way>,
    pub(super) fitting: Fitting,
    /// Gain in log-likelihood on the runs that are learned from.
    pub(super) gain: f64,
    /// And on those that are held out, with what was fitted there.
    pub(super) held: Option<(f64, Fitting)>,
    /// What screening promised.
    pub(super) predicted: f64,
    /// What it adds beside what is fitted, in the metric.
    pub(super) direction: Vec<f64>,
    /// Parameters that it costs.
    pub(super) cost: usize,
}

/// The fits of a round, by one noise.
pub(super) struct Contest {
    pub(super) metric: Metric,
    /// The best score first.
    pub(super) contenders: Vec<Contender>,
    /// Those that stayed far behind, by the first noise.
    pub(super) far: Vec<Contender>,
}

/// The price of a parameter in log-likelihood.
pub(super) const PRICE: f64 = 3.0;

impl Contender {
    /// Gains less the price of the parameters.
    pub(super) fn score(&self) -> f64 {
        self.gain + self.held.as_ref().map_or(0.0, |(gain, _)| *gain) - PRICE * self.cost as f64
    }
}

/// The name under which results speak of a candidate.
pub(super) fn place(candidate: &Candidate) -> EffectAt {
    EffectAt { effect: candidate.effect().name().to_string(), targets: candidate.targets().to_vec() }
}

impl<'a> Round<'a> {
    /// Simulates and screens all candidates.
    pub(super) fn new(
        stage: &'a Stage,
        runs: Runs<'a>,
        candidates: &[Candidate],
        measured: &Measured,
        options: &SearchOptions,
    ) -> Result<Self, SearchError> {
        let scored: Vec<&Candidate> = candidates.iter().filter(|c| c.kind() != Kind::Variance).collect();
        let found: Vec<Result<Trace, String>> =
            scored.par_iter().map(|candidate| trace(candidate, stage, runs, measured)).collect();
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
        let mut records = records(&stage.model, runs, &stage.ways, &stage.theta)?;
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
        Ok(Self { stage, runs, traces, left_out, owner, screening, records, directions, options })
    }

    /// Fits the best candidates jointly with the model, all by one noise: first that of the saturated residual, then that of the best
    /// model's.
    pub(super) fn contest(&mut self, watcher: &Watcher<'_>) -> Result<Contest, SearchError> {
        let metric = Metric::new(&self.screening.spectra, self.options.dropped);
        let base = self.base(&metric, &self.stage.theta[..self.runs.train])?;
        let chosen = self.chosen();
        watcher(&format!("fitting the best {} of {} candidates", chosen.len(), self.traces.len()));
        let beside = Beside::new(&self.records, self.runs.train(), &self.stage.ways, self.stage.outputs(), &metric);
        let fitted = |t: &usize| self.contender(*t, &beside, &metric, &base);
        let mut contenders: Vec<Contender> = chosen.par_iter().filter_map(fitted).collect();
        drop(beside);
        sort(&mut contenders);
        let Some(best) = contenders.first() else {
            return Ok(Contest { metric, contenders, far: Vec::new() });
        };
        // the noise that the best model leaves judges all
        let metric = self.renewed(best).unwrap_or(metric);
        let base = self.base(&metric, &base.theta)?;
        let near = (contenders[0].gain - BEHIND).min(PART * contenders[0].gain);
        let (mut contenders, far): (Vec<_>, Vec<_>) = contenders.into_iter().partition(|c| c.gain >= near);
        let base_held = self.base_held(&metric, &base);
        contenders.par_iter_mut().for_each(|c| self.judge(c, &metric, &base, base_held.as_ref()));
        sort(&mut contenders);
        Ok(Contest { metric, contenders, far })
    }

    /// Candidates that are worth a fit: the best by lead, and all whose promise is within reach of the best.
    fn chosen(&self) -> Vec<usize> {
        let candidates = &self.screening.candidates;
        let usable = |t: &&usize| candidates[**t].direction.is_some() && candidates[**t].statistic > 0.0;
        let ranked: Vec<usize> = self.screening.ranking.iter().filter(usable).copied().collect();
        let best = ranked.iter().map(|t| candidates[*t].statistic).fold(0.0, f64::max);
        let near = |(k, t): (usize, usize)| (k < FEWEST || candidates[t].statistic > REACH * best).then_some(t);
        ranked.into_iter().enumerate().filter_map(near).take(MOST).collect()
    }

    /// The base model by a noise.
    fn base(&self, metric: &Metric, starts: &[Vec<f64>]) -> Result<Fitting, SearchError> {
        let stage = self.stage;
        let params = stage.params().to_vec();
        let ways = &stage.ways[..self.runs.train];
        let posed = Posed { params, dynamics: stage.model.dynamics(), runs: self.runs.train(), ways, metric };
        posed.fit(starts, WHOLE).ok_or_else(|| SearchError::NoFit("its fit by the noise found has no end".into()))
    }

    /// The base model on the held-out runs.
    fn base_held(&self, metric: &Metric, base: &Fitting) -> Option<Fitting> {
        let stage = self.stage;
        let starts = shared_from(stage.params(), base.theta.first()?, &stage.theta[self.runs.train..]);
        let (params, ways) = (stage.params().to_vec(), &stage.ways[self.runs.train..]);
        let runs = self.runs.held();
        Posed { params, dynamics: stage.model.dynamics(), runs, ways, metric }.held().fit(&starts, WHOLE)
    }

    /// A candidate, fitted from the points that promise most.
    fn contender(&self, t: usize, beside: &Beside, metric: &Metric, base: &Fitting) -> Option<Contender> {
        let trace = &self.traces[t];
        let attached = &trace.attached;
        let own = (0..self.owner.len()).filter(|d| self.owner[*d].0 == t);
        let mut promised: Vec<(f64, f64, usize, Vec<f64>)> = own
            .map(|d| {
                let parts: Vec<&[f64]> = self.records.iter().map(|r| &r.directions[d][..]).collect();
                let direction = beside.direction(&parts);
                let (twice, amount) = beside.promise(&direction, &trace.points[self.owner[d].1]);
                (0.5 * twice, amount, self.owner[d].1, direction)
            })
            .collect();
        promised.sort_by(|a, b| b.0.total_cmp(&a.0));
        promised.truncate(STARTS);
        let mut definition = attached.definition.clone();
        definition.params = attached.fitted_params(self.stage);
        let model = self.stage.model.altered(definition);
        let ways: Vec<Way> = trace.ways.iter().map(Way::finer).collect();
        let posed = Posed {
            params: model.definition().params.clone(),
            dynamics: model.dynamics(),
            runs: self.runs.train(),
            ways: &ways[..self.runs.train],
            metric,
        };
        let look = |(k, (_, amount, point, _)): (usize, &(f64, f64, usize, Vec<f64>))| {
            let values = trace.points[*point].at(*amount, attached.params());
            let starts: Vec<Vec<f64>> = (0..self.runs.train).map(|r| attached.theta(self.stage, r, &values)).collect();
            Some((posed.fit(&starts, LOOK)?, k))
        };
        let mut looks: Vec<(Fitting, usize)> = promised.iter().enumerate().filter_map(look).collect();
        looks.sort_by(|a, b| a.0.cost.total_cmp(&b.0.cost));
        looks.truncate(FOLLOWED);
        let whole = |(fitting, k): (Fitting, usize)| {
            let end = posed.fit(&fitting.theta, WHOLE);
            (end.unwrap_or(fitting), k)
        };
        let best = looks.into_iter().map(whole).min_by(|a, b| a.0.cost.total_cmp(&b.0.cost));
        let (fitting, k) = best?;
        let predicted = promised.first()?.0;
        let direction = promised.swap_remove(k).3;
        let (gain, cost) = (base.cost - fitting.cost, attached.cost());
        Some(Contender { trace: t, model, ways, fitting, gain, held: None, predicted, direction, cost })
    }

    /// The noise that is left by a contender, all directions taken out.
    fn renewed(&mut self, best: &Contender) -> Option<Metric> {
        let mut records = records(&best.model, self.runs, &best.ways, &best.fitting.theta).ok()?;
        // directions are large: they are lent
        let lend = |a: &mut [Record], b: &mut [Record]| {
            a.iter_mut().zip(b).for_each(|(a, b)| std::mem::swap(&mut a.directions, &mut b.directions));
        };
        lend(&mut records, &mut self.records);
        let options = ScreeningOptions { draws: 20, ..self.options };
        let screening = self.stage.screened(&records, &self.directions, &options);
        lend(&mut records, &mut self.records);
        Some(Metric::new(&screening.ok()?.spectra, self.options.dropped))
    }

    /// Fits a contender by the second noise, and compares it on the held-out runs.
    fn judge(&self, contender: &mut Contender, metric: &Metric, base: &Fitting, base_held: Option<&Fitting>) {
        let params = contender.model.definition().params.clone();
        let (train, held) = contender.ways.split_at(self.runs.train);
        let dynamics = contender.model.dynamics();
        let posed = Posed { params: params.clone(), dynamics, runs: self.runs.train(), ways: train, metric };
        if let Some(fitting) = posed.fit(&contender.fitting.theta, WHOLE) {
            contender.fitting = fitting;
        }
        contender.gain = base.cost - contender.fitting.cost;
        let Some(base_held) = base_held.filter(|_| !held.is_empty()) else { return };
        let attached = &self.traces[contender.trace].attached;
        let values = new_values(attached, &contender.fitting.theta[0]);
        let own = (self.runs.train..self.runs.all.len()).map(|r| attached.theta(self.stage, r, &values));
        let starts = shared_from(&params, &contender.fitting.theta[0], &own.collect::<Vec<_>>());
        let posed = Posed { params, dynamics, runs: self.runs.held(), ways: held, metric };
        // a model that cannot follow a held-out run at all gains less than nothing there
        let found = posed.held().fit(&starts, WHOLE);
        contender.held = Some(match found {
            Some(fitting) => (base_held.cost - fitting.cost, fitting),
            None => (f64::NEG_INFINITY, Fitting { cost: f64::INFINITY, theta: starts, estimates: Vec::new() }),
        });
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

fn sort(contenders: &mut [Contender]) {
    contenders.sort_by(|a, b| b.score().total_cmp(&a.score()).then(a.trace.cmp(&b.trace)));
}
