//! An effect fitted jointly with the model: from where such a fit begins, and what it comes to.

use super::beside::{Added, Beside};
use super::metric::Metric;
use super::refit::{Fitting, Posed};
use super::round::{PRICE, Round, new_values, shared_from};
use super::way::Way;
use crate::diagnose::screen::Shape;
use crate::model::Model;
use crate::simulate::{choose_steps_within, integration_error};

/// Points whose responses are looked at before a fit begins at any.
const LOOKED_AT: usize = 12;
/// The best of them that are corrected.
const FOLLOWED: usize = 3;
/// Part of the smallest trial at which an effect is hardly there.
const FAINT: f64 = 0.1;
/// Part of a promised size that is tried where all of it is worse than nothing, and how often it is.
const PART: f64 = 0.3;
const NEARER: usize = 4;
/// Integration error, as a part of an output's range, from which steps are too coarse for a fit; that which others shall have, and
/// how many of them an interval may take on average.
const COARSE: f64 = 3e-3;
const ACCURATE: f64 = 1e-4;
const MOST_STEPS: usize = 40;
/// Of the others, those that are kept for a contender that comes near the best.
const SPARE: usize = 5;
/// Corrections of a first look, and what one of them must promise.
const LOOK: usize = 3;
const ROUGH: f64 = 0.5;
/// The same where a candidate is only glanced at, and the points that it is glanced at.
const GLANCE: usize = 2;
const GLANCED_AT: usize = 2;
/// Corrections of a fit, and what one of them must promise.
const WHOLE: usize = 25;
const FINE: f64 = 0.01;

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
    /// Starts that were not followed, the best first.
    others: Vec<Vec<Vec<f64>>>,
}

/// How much is done for a first fit.
#[derive(Clone, Copy)]
struct Effort {
    /// Points that are looked at.
    looked_at: usize,
    /// Those of them that are corrected.
    followed: usize,
    /// How often.
    corrections: usize,
}

/// A start and its cost.
struct Look {
    cost: f64,
    /// Which promise, and whether the effect is hardly there.
    point: (usize, bool),
    starts: Vec<Vec<f64>>,
}

/// A point from which a fit may begin.
pub(super) struct Promise {
    /// The gain that it promises.
    pub(super) gain: f64,
    /// The direction, by index, and the multiple of it that does.
    pub(super) direction: usize,
    pub(super) amount: f64,
    /// Which point.
    point: usize,
    pub(super) added: Added,
}

impl Contender {
    /// Gains less the price of the parameters.
    pub(super) fn score(&self) -> f64 {
        self.whole_gain() - PRICE * self.cost as f64
    }

    /// The gain on all runs.
    pub(super) fn whole_gain(&self) -> f64 {
        self.gain + self.held.as_ref().map_or(0.0, |(gain, _)| *gain)
    }

    /// The model over the runs that are learned from.
    pub(super) fn posed<'c>(&'c self, round: &Round<'c>, metric: &'c Metric) -> Posed<'c> {
        Posed {
            params: self.model.definition().params.clone(),
            dynamics: self.model.dynamics(),
            runs: round.runs.train(),
            ways: &self.ways[..round.runs.train],
            metric,
        }
    }

    /// Fits to the end by a noise, from where it is.
    pub(super) fn finish(&mut self, round: &Round<'_>, metric: &Metric, base: &Fitting) {
        if let Some(fitting) =
            self.posed(round, metric).bench().and_then(|mut b| b.fit(&self.fitting.theta, WHOLE, FINE))
        {
            self.fitting = fitting;
        }
        self.gain = base.cost - self.fitting.cost;
    }

    /// Fits from starts that were not followed too, where there are such; true when one of them ends better.
    pub(super) fn again(&mut self, round: &Round<'_>, metric: &Metric, base: &Fitting) -> bool {
        let others = std::mem::take(&mut self.others);
        let before = self.fitting.cost;
        let Some(mut bench) = self.posed(round, metric).bench() else { return false };
        let ends = others.iter().filter_map(|starts| bench.fit(starts, WHOLE, FINE));
        let best = ends.min_by(|a, b| a.cost.total_cmp(&b.cost)).filter(|f| f.cost < before - FINE);
        drop(bench);
        let Some(fitting) = best else { return false };
        self.fitting = fitting;
        self.gain = base.cost - self.fitting.cost;
        true
    }

    /// Compares with the base model on the held-out runs.
    pub(super) fn compare(&mut self, round: &Round<'_>, metric: &Metric, base: Option<&Fitting>) {
        let (params, runs, metric) = (self.model.definition().params.clone(), round.runs.held(), metric.for_held());
        let Some(base) = base.filter(|_| !runs.is_empty()) else { return };
        let attached = &round.traces[self.trace].attached;
        let values = new_values(attached, &self.fitting.theta[0]);
        let train = round.runs.train;
        let own = (train..round.runs.all.len()).map(|r| attached.theta(&round.stage, r, &values));
        let starts = shared_from(&params, &self.fitting.theta[0], &own.collect::<Vec<_>>());
        let posed = Posed { params, dynamics: self.model.dynamics(), runs, ways: &self.ways[train..], metric };
        // a model that cannot follow a held-out run at all gains less than nothing there
        self.held = Some(match posed.held().fit(&starts, WHOLE) {
            Some(fitting) => (base.cost - fitting.cost, fitting),
            None => (f64::NEG_INFINITY, Fitting { cost: f64::INFINITY, theta: starts, estimates: Vec::new() }),
        });
    }
}

impl Round<'_> {
    /// A candidate after a few corrections from the points that do best.
    pub(super) fn contender(&self, t: usize, beside: &Beside, metric: &Metric, base: &Fitting) -> Option<Contender> {
        self.followed(t, (beside, metric, base), Effort { looked_at: LOOKED_AT, followed: FOLLOWED, corrections: LOOK })
    }

    /// What a candidate gains by a correction or two from the point that does best.
    pub(super) fn glance(&self, t: usize, beside: &Beside, metric: &Metric, base: &Fitting) -> Option<f64> {
        let effort = Effort { looked_at: GLANCED_AT, followed: 1, corrections: GLANCE };
        self.followed(t, (beside, metric, base), effort).map(|contender| contender.gain)
    }

    fn followed(
        &self,
        t: usize,
        (beside, metric, base): (&Beside, &Metric, &Fitting),
        effort: Effort,
    ) -> Option<Contender> {
        let trace = &self.traces[t];
        let attached = &trace.attached;
        let mut promises = self.promises(t, beside);
        let predicted = promises.first()?.gain;
        promises.truncate(effort.looked_at);
        let mut definition = attached.definition.clone();
        definition.params = attached.fitted_params(&self.stage);
        let model = self.stage.model.altered(definition);
        let ways = self.ways(t, &model, &promises[0], base);
        let posed = Posed {
            params: model.definition().params.clone(),
            dynamics: model.dynamics(),
            runs: self.runs.train(),
            ways: &ways[..self.runs.train],
            metric,
        };
        let mut bench = posed.bench()?;
        let mut looks: Vec<Look> = Vec::new();
        // true when it is better than without the effect
        let mut look = |point: (usize, bool), starts: Vec<Vec<f64>>| {
            let cost = bench.look(&starts);
            looks.extend(cost.map(|cost| Look { cost, point, starts }));
            cost.is_some_and(|cost| cost < base.cost)
        };
        for (k, promise) in promises.iter().enumerate() {
            let point = &trace.points[promise.point];
            let values = point.at(promise.amount, attached.params());
            // with what the fitted parameters had made up for, and without: a large effect is not linear
            let mut gains = false;
            for share in [promise.amount, 0.0] {
                gains |= look((k, false), self.starts(attached, base, &values, (&promise.added.compensation, share)));
            }
            // a derivative that says so much is believed less far: a model without the effect is never better than the best with it
            let mut amount = promise.amount;
            for _ in 0..if point.is_linear() && !gains { NEARER } else { 0 } {
                amount *= PART;
                let values = point.at(amount, attached.params());
                if look((k, false), self.starts(attached, base, &values, (&promise.added.compensation, amount))) {
                    break;
                }
            }
            // where it was simulated: a finite effect is not proportional, and less of a limit is not a limit that is further away
            if !point.is_linear() {
                for share in [1.0, 0.0] {
                    look((k, false), self.starts(attached, base, &point.values, (&promise.added.compensation, share)));
                }
            }
            // hardly there: no worse than the base model
            if point.shape == Shape::Smallest {
                let values = point.at(FAINT, attached.params());
                look((k, true), self.starts(attached, base, &values, (&promise.added.compensation, 0.0)));
            }
        }
        looks.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut begun: Vec<(usize, bool)> = Vec::new();
        let mut best: Option<(Fitting, usize)> = None;
        let mut others = Vec::new();
        for Look { point, starts, .. } in looks {
            if begun.contains(&point) {
                continue;
            }
            begun.push(point);
            if begun.len() > effort.followed {
                others.push(starts);
                continue;
            }
            if let Some(fitting) = bench.fit(&starts, effort.corrections, ROUGH)
                && best.as_ref().is_none_or(|(b, _)| fitting.cost < b.cost)
            {
                best = Some((fitting, point.0));
            }
        }
        others.truncate(SPARE);
        drop(bench);
        let (fitting, k) = best?;
        let direction = promises.swap_remove(k).added.direction;
        let (gain, cost) = (base.cost - fitting.cost, attached.cost());
        Some(Contender { trace: t, model, ways, fitting, gain, held: None, predicted, direction, cost, others })
    }

    /// Ways for the fits of a candidate: those of its directions made finer, unless they are too coarse where the fit begins. A
    /// direction is a derivative, and says little of how stiff the effect itself is.
    fn ways(&self, t: usize, model: &Model, promise: &Promise, base: &Fitting) -> Vec<Way> {
        let (trace, runs) = (&self.traces[t], self.runs);
        let ways: Vec<Way> = trace.ways.iter().map(Way::finer).collect();
        let Some(steps) = ways[0].steps() else { return ways };
        let values = trace.points[promise.point].at(promise.amount, trace.attached.params());
        let compensation = (&promise.added.compensation[..], promise.amount);
        let starts = self.starts(&trace.attached, base, &values, compensation);
        let error = integration_error(model.dynamics(), &runs.all[0], &starts[0], steps.clone());
        if error.is_ok_and(|error| error < COARSE) {
            return ways;
        }
        let own = |r: usize| {
            let theta = starts.get(r).cloned().unwrap_or_else(|| trace.attached.theta(&self.stage, r, &values));
            let chosen = choose_steps_within(model.dynamics(), &runs.all[r], &theta, ACCURATE).ok()?;
            let most = MOST_STEPS * runs.all[r].len();
            (chosen.error < COARSE && chosen.steps.total(runs.all[r].len()) <= most).then_some(chosen.steps)
        };
        (0..runs.all.len()).map(|r| own(r).map_or_else(|| ways[r].clone(), Way::Steps)).collect()
    }

    /// What a candidate's points promise, the best first.
    pub(super) fn promises(&self, t: usize, beside: &Beside) -> Vec<Promise> {
        let own = (0..self.owner.len()).filter(|d| self.owner[*d].0 == t);
        let of = |d: usize| {
            let parts: Vec<&[f64]> = self.records.iter().map(|r| &r.directions[d][..]).collect();
            let (added, point) = (beside.added(&parts), self.owner[d].1);
            let (twice, amount) = beside.promise(&added.direction, &self.traces[t].points[point]);
            Promise { gain: 0.5 * twice, direction: d, amount, point, added }
        };
        let mut promises: Vec<Promise> = own.map(of).collect();
        promises.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        promises
    }

    /// Parameters of each run with these values of the new ones, the others as the base model has them less a share of what
    /// they make up for.
    fn starts(
        &self,
        attached: &super::attached::Attached,
        base: &Fitting,
        values: &[f64],
        (compensation, share): (&[f64], f64),
    ) -> Vec<Vec<f64>> {
        let (shared, own) = &self.free;
        let of = |r: usize| {
            let mut theta = base.theta[r].clone();
            shared.iter().enumerate().for_each(|(c, k)| theta[*k] -= share * compensation[c]);
            let first = shared.len() + r * own.len();
            // what belongs to the run and is no parameter is found anew for every start
            let params = own.iter().enumerate().filter(|(_, k)| **k < self.stage.params().len());
            params.for_each(|(c, k)| theta[*k] -= share * compensation[first + c]);
            attached.theta_from(&theta, r, values)
        };
        (0..self.runs.train).map(of).collect()
    }
}
