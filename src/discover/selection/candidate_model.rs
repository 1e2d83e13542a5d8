//! An effect fitted jointly with the model: from where such a fit begins, and what it comes to.

use super::directions::CandidateDirections;
use super::extended_model::new_values;
use super::fitted_model::shared_from;
use super::fitting::{FitProblem, Fitting};
use super::forward_step::{ForwardStep, PENALTY, prior};
use super::predictor::{Predictor, tolerance};
use super::projection::{Projected, Projection};
use super::whitening::CommonNoise;
use crate::screening::Shape;
use fdm_effects::Kind;
use fdm_grammar::syntax::Class;
use fdm_system::model::Model;
use fdm_system::simulate::{StepOptions, choose_steps, integration_error};

/// Points whose responses are looked at before a fit begins at any.
const LOOKED_AT: usize = 12;
/// The best of them that are corrected.
const FOLLOWED: usize = 3;
/// Part of the smallest trial at which an effect is hardly there.
const FAINT: f64 = 0.1;
/// Part of a predicted size that is tried where all of it is worse than nothing, and how often it is.
const PART: f64 = 0.3;
const NEARER: usize = 4;
/// Integration error, as a part of an output's range, from which steps are too coarse for a fit; that which others shall have, and
/// how many of them an interval may take on average.
const COARSE: f64 = 3e-3;
const ACCURATE: f64 = 1e-4;
const MOST_STEPS: usize = 40;
/// Of the others, those that are kept for a candidate model that comes near the best.
const SPARE: usize = 5;
/// Halvings by which the size is found from which a limit acts.
const HALVED: usize = 8;
/// Difference of two costs that is none, in parts of them.
const EQUAL: f64 = 1e-12;
/// Iterations of a first look, and what one of them must be predicted to gain.
const LOOK: usize = 3;
const ROUGH: f64 = 0.5;
/// Iterations where a candidate is only glanced at, and the points that it is glanced at.
const GLANCE: usize = 2;
const GLANCED_AT: usize = 2;
/// Ratio of values of what is fixed that are tried beside each other, and how often to each side.
const FACTOR: f64 = 1.5;
const STEPS: usize = 6;
/// Iterations of a fit, and what one of them must be predicted to gain.
const WHOLE: usize = 25;
pub(super) const FINE: f64 = 0.01;

/// An effect that was fitted jointly with the model.
pub(super) struct CandidateModel {
    /// Its trace.
    pub(super) candidate: usize,
    /// The extended model under the base model's text.
    pub(super) model: Model,
    /// How it answers all runs.
    pub(super) predictors: Vec<Predictor>,
    pub(super) fitting: Fitting,
    /// Gain in log-likelihood on the training runs.
    pub(super) gain: f64,
    /// And on those that are for validation, with what was fitted there.
    pub(super) validation: Option<(f64, Fitting)>,
    /// What screening predicted.
    pub(super) predicted: f64,
    /// What it adds beside what is fitted, in the metric.
    pub(super) direction: Vec<f64>,
    /// Parameters that it costs.
    pub(super) cost: usize,
    /// What kind of explanation it is.
    pub(super) class: Class,
    /// How simple it is: whether it has a limit or a width, and how many numbers, those that are fixed too.
    pub(super) form: (bool, usize),
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
    iterations: usize,
}

/// A start and its cost.
struct Look {
    cost: f64,
    /// Which predicted gain, and whether the effect is hardly there.
    point: (usize, bool),
    starts: Vec<Vec<f64>>,
}

/// A point from which a fit may begin.
pub(super) struct Prediction {
    /// The gain that it predicts.
    pub(super) gain: f64,
    /// The direction, by index, and the multiple of it that does.
    pub(super) direction: usize,
    pub(super) amount: f64,
    /// Which point.
    point: usize,
    pub(super) added: Projected,
}

impl CandidateModel {
    /// Gains less the penalty of the parameters.
    pub(super) fn score(&self) -> f64 {
        self.whole_gain() - self.penalty()
    }

    /// What its parameters and its kind cost.
    pub(super) fn penalty(&self) -> f64 {
        PENALTY * self.cost as f64 + prior(self.class)
    }

    /// The gain on all runs.
    pub(super) fn whole_gain(&self) -> f64 {
        self.gain + self.validation.as_ref().map_or(0.0, |(gain, _)| *gain)
    }

    /// The model over the training runs.
    pub(super) fn posed<'c>(&'c self, step: &ForwardStep<'c>, noise: &'c CommonNoise) -> FitProblem<'c> {
        FitProblem {
            params: self.model.definition().params.clone(),
            dynamics: self.model.dynamics(),
            runs: step.runs.train(),
            predictors: &self.predictors[..step.runs.train],
            noise,
        }
    }

    /// Fits to the end by a noise, from where it is.
    pub(super) fn finish(&mut self, step: &ForwardStep<'_>, noise: &CommonNoise, base: &Fitting) {
        if let Some(fitting) =
            self.posed(step, noise).prepared().and_then(|mut b| b.fit(&self.fitting.theta, WHOLE, FINE))
        {
            self.fitting = fitting;
        }
        self.gain = base.cost - self.fitting.cost;
    }

    /// Fits from starts that were not followed too, where there are such, and with other values of what is fixed; true when one of them ends
    /// better.
    pub(super) fn again(&mut self, step: &ForwardStep<'_>, noise: &CommonNoise, base: &Fitting) -> bool {
        let others = std::mem::take(&mut self.others);
        let before = self.fitting.cost;
        let Some(mut prepared) = self.posed(step, noise).prepared() else { return false };
        let ends = others.iter().filter_map(|starts| prepared.fit(starts, WHOLE, FINE));
        let mut best = ends.min_by(|a, b| a.cost.total_cmp(&b.cost)).filter(|f| f.cost < before - FINE);
        // trials stand far apart: a width that is half as large may be what another effect would make up for
        for k in self.fixed(step) {
            for factor in [FACTOR, 1.0 / FACTOR] {
                for _ in 0..STEPS {
                    let from = best.as_ref().unwrap_or(&self.fitting);
                    let mut starts = from.theta.clone();
                    starts.iter_mut().for_each(|theta| theta[k] *= factor);
                    let least = from.cost - FINE;
                    let Some(found) = prepared.fit(&starts, WHOLE, FINE).filter(|f| f.cost < least) else { break };
                    best = Some(found);
                }
            }
        }
        drop(prepared);
        let Some(fitting) = best else { return false };
        self.fitting = fitting;
        self.gain = base.cost - self.fitting.cost;
        true
    }

    /// Nuisances that stay as they were tried, by their places among all parameters.
    fn fixed(&self, step: &ForwardStep<'_>) -> Vec<usize> {
        let params = step.simulated[self.candidate].attached.params().iter();
        let fixed = params.filter(|p| p.nuisance && p.fixed && p.begins_as.is_none());
        fixed.filter_map(|p| self.model.definition().param(&p.name)).collect()
    }

    /// Compares with the base model on the validation runs.
    pub(super) fn compare(&mut self, step: &ForwardStep<'_>, noise: &CommonNoise, base: Option<&Fitting>) {
        let (params, runs, noise) =
            (self.model.definition().params.clone(), step.runs.validation(), noise.for_validation());
        let Some(base) = base.filter(|_| !runs.is_empty()) else { return };
        let attached = &step.simulated[self.candidate].attached;
        let values = new_values(attached, &self.fitting.theta[0]);
        let train = step.runs.train;
        let own = (train..step.runs.all.len()).map(|r| attached.theta(&step.current, r, &values));
        let starts = shared_from(&params, &self.fitting.theta[0], &own.collect::<Vec<_>>());
        let posed =
            FitProblem { params, dynamics: self.model.dynamics(), runs, predictors: &self.predictors[train..], noise };
        // a model that cannot follow a validation run at all gains less than nothing there
        self.validation = Some(match posed.validation().fit(&starts, WHOLE) {
            Some(fitting) => (base.cost - fitting.cost, fitting),
            None => (f64::NEG_INFINITY, Fitting { cost: f64::INFINITY, theta: starts, estimates: Vec::new() }),
        });
    }
}

impl ForwardStep<'_> {
    /// A candidate after a few iterations from the points that do best.
    pub(super) fn candidate(
        &self,
        t: usize,
        projection: &Projection,
        noise: &CommonNoise,
        base: &Fitting,
    ) -> Option<CandidateModel> {
        self.followed(
            t,
            (projection, noise, base),
            Effort { looked_at: LOOKED_AT, followed: FOLLOWED, iterations: LOOK },
        )
    }

    /// What a candidate gains by an iteration or two from the point that does best.
    pub(super) fn glance(&self, t: usize, projection: &Projection, noise: &CommonNoise, base: &Fitting) -> Option<f64> {
        let effort = Effort { looked_at: GLANCED_AT, followed: 1, iterations: GLANCE };
        self.followed(t, (projection, noise, base), effort).map(|candidate| candidate.gain)
    }

    fn followed(
        &self,
        t: usize,
        (projection, noise, base): (&Projection, &CommonNoise, &Fitting),
        effort: Effort,
    ) -> Option<CandidateModel> {
        let trace = &self.simulated[t];
        let attached = &trace.attached;
        let mut predictions = self.predictions(t, projection);
        let predicted = predictions.first()?.gain;
        predictions.truncate(effort.looked_at);
        let mut definition = attached.definition.clone();
        definition.params = attached.fitted_params(&self.current);
        let model = self.current.model.altered(definition);
        let predictors = self.predictors(t, &model, &predictions, base);
        let posed = FitProblem {
            params: model.definition().params.clone(),
            dynamics: model.dynamics(),
            runs: self.runs.train(),
            predictors: &predictors[..self.runs.train],
            noise,
        };
        let mut prepared = posed.prepared()?;
        let mut looks: Vec<Look> = Vec::new();
        for (k, prediction) in predictions.iter().enumerate() {
            self.look_around(trace, (prediction, k == 0), base, &mut |faint, starts| {
                let cost = prepared.look(&starts);
                looks.extend(cost.map(|cost| Look { cost, point: (k, faint), starts }));
                cost.unwrap_or(f64::INFINITY)
            });
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
            if let Some(fitting) = prepared.fit(&starts, effort.iterations, ROUGH)
                && best.as_ref().is_none_or(|(b, _)| fitting.cost < b.cost)
            {
                best = Some((fitting, point.0));
            }
        }
        others.truncate(SPARE);
        drop(prepared);
        let (fitting, k) = best?;
        let direction = predictions.swap_remove(k).added.direction;
        let (gain, cost) = (base.cost - fitting.cost, attached.cost());
        Some(CandidateModel {
            candidate: t,
            model,
            predictors,
            fitting,
            gain,
            validation: None,
            predicted,
            direction,
            cost,
            class: attached.candidate.effect().class(),
            form: (
                attached.candidate.kind() == Kind::Finite,
                attached.params().iter().filter(|p| p.begins_as.is_none()).count(),
            ),
            others,
        })
    }

    /// Looks at the starts that a prediction says, and at those beside it; `look` takes whether the effect is hardly there and a start, and
    /// gives the cost.
    fn look_around(
        &self,
        trace: &CandidateDirections,
        (prediction, best): (&Prediction, bool),
        base: &Fitting,
        look: &mut dyn FnMut(bool, Vec<Vec<f64>>) -> f64,
    ) {
        let attached = &trace.attached;
        let point = &trace.points[prediction.point];
        let values = point.at(prediction.amount, attached.params());
        // with what the fitted parameters had made up for, and without: a large effect is not linear
        let mut least = f64::INFINITY;
        for share in [prediction.amount, 0.0] {
            let starts = self.starts(attached, base, &values, (&prediction.added.compensation, share));
            least = least.min(look(false, starts));
        }
        // a derivative that says so much is believed less far: a model without the effect is never better than the best with it
        let mut amount = prediction.amount;
        for _ in 0..if point.is_linear() && least >= base.cost { NEARER } else { 0 } {
            amount *= PART;
            let values = point.at(amount, attached.params());
            let starts = self.starts(attached, base, &values, (&prediction.added.compensation, amount));
            if look(false, starts) < base.cost {
                break;
            }
        }
        // where it was simulated: a finite effect is not proportional, and less of a limit is not a limit that is further away
        if !point.is_linear() {
            for share in [1.0, 0.0] {
                let starts = self.starts(attached, base, &point.values, (&prediction.added.compensation, share));
                least = least.min(look(false, starts));
            }
        }
        // a limit that cuts so much is worse than none, and one that is nowhere reached has no derivative: between them is one that
        // cuts less
        if best && !point.is_linear() {
            let at = |values: &[f64]| self.starts(attached, base, values, (&prediction.added.compensation, 0.0));
            let (mut acts, mut rests) = (point.values.clone(), point.at(0.0, attached.params()));
            let nothing = look(false, at(&rests));
            let gain = EQUAL * nothing.abs();
            for _ in 0..if least < nothing - gain { 0 } else { HALVED } {
                let middle: Vec<f64> = acts.iter().zip(&rests).map(|(a, b)| 0.5 * (a + b)).collect();
                let cost = look(false, at(&middle));
                if cost < nothing - gain {
                    break;
                }
                if (cost - nothing).abs() <= gain {
                    rests = middle;
                } else {
                    acts = middle;
                }
            }
        }
        // hardly there: no worse than the base model
        if point.shape == Shape::Smallest {
            let values = point.at(FAINT, attached.params());
            look(true, self.starts(attached, base, &values, (&prediction.added.compensation, 0.0)));
        }
    }

    /// Ways for the fits of a candidate: those of its directions, where noise hides their error as fits begin; made finer otherwise, unless
    /// that is too coarse there. A direction is a derivative, and says little of how stiff the effect itself is. The smallest trial that a fit
    /// may begin at is looked at too: the shorter a lag, the stiffer.
    fn predictors(&self, t: usize, model: &Model, predictions: &[Prediction], base: &Fitting) -> Vec<Predictor> {
        let (trace, runs) = (&self.simulated[t], self.runs);
        let finer = || -> Vec<Predictor> { trace.predictors.iter().map(Predictor::finer).collect() };
        let of = |prediction: &Prediction, amount: f64| -> (Vec<f64>, Vec<Vec<f64>>) {
            let values = trace.points[prediction.point].at(amount, trace.attached.params());
            let starts = self.starts(&trace.attached, base, &values, (&prediction.added.compensation, amount));
            (values, starts)
        };
        let smallest = predictions.iter().find(|p| trace.points[p.point].shape == Shape::Smallest);
        let begun: Vec<(Vec<f64>, Vec<Vec<f64>>)> = predictions
            .first()
            .map(|first| of(first, first.amount))
            .into_iter()
            .chain(smallest.map(|smallest| of(smallest, FAINT)))
            .collect();
        // the largest error that fits begin with, and with which of the beginnings
        let error = |predictors: &[Predictor]| -> Option<(f64, usize)> {
            let steps = predictors[0].steps()?;
            let of = |(k, (_, starts)): (usize, &(Vec<f64>, Vec<Vec<f64>>))| {
                let error = integration_error(model.dynamics(), &runs.all[0], &starts[0], steps.clone());
                (error.unwrap_or(f64::INFINITY), k)
            };
            begun.iter().enumerate().map(of).max_by(|a, b| a.0.total_cmp(&b.0))
        };
        let Some((own, _)) = error(&trace.predictors) else { return finer() };
        if own < tolerance(runs.all, self.current.outputs()) {
            return trace.predictors.clone();
        }
        let predictors = finer();
        let too_coarse = |(error, _): &(f64, usize)| error.is_nan() || *error >= COARSE;
        let Some((_, worst)) = error(&predictors).filter(too_coarse) else { return predictors };
        let (values, starts) = &begun[worst];
        let own = |r: usize| {
            let theta = starts.get(r).cloned().unwrap_or_else(|| trace.attached.theta(&self.current, r, values));
            let chosen =
                choose_steps(model.dynamics(), &runs.all[r], &theta, &StepOptions::default().to(Some(ACCURATE)))
                    .ok()?;
            let most = MOST_STEPS * runs.all[r].len();
            (chosen.error < COARSE && chosen.steps.total(runs.all[r].len()) <= most).then_some(chosen.steps)
        };
        (0..runs.all.len()).map(|r| own(r).map_or_else(|| predictors[r].clone(), Predictor::Steps)).collect()
    }

    /// What a candidate's points predicted gain, the best first.
    pub(super) fn predictions(&self, t: usize, projection: &Projection) -> Vec<Prediction> {
        let own = (0..self.owner.len()).filter(|d| self.owner[*d].0 == t);
        let mut predictions: Vec<Prediction> = own.map(|d| self.prediction(d, projection)).collect();
        predictions.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        predictions
    }

    /// What a direction predicts.
    pub(super) fn prediction(&self, direction: usize, projection: &Projection) -> Prediction {
        let added = self.with_direction(direction, |parts| projection.added(parts));
        let (t, point) = self.owner[direction];
        let (twice, amount) = projection.predicted_gain(&added.direction, &self.simulated[t].points[point]);
        Prediction { gain: 0.5 * twice, direction, amount, point, added }
    }

    /// Parameters of each run with these values of the new ones, the others as the base model has them less a share of what
    /// they make up for.
    fn starts(
        &self,
        attached: &super::extended_model::AttachedEffect,
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
            let params = own.iter().enumerate().filter(|(_, k)| **k < self.current.params().len());
            params.for_each(|(c, k)| theta[*k] -= share * compensation[first + c]);
            attached.theta_from(&theta, r, values)
        };
        (0..self.runs.train).map(of).collect()
    }
}
