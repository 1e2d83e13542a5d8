//! A model with some effects in its text, at values: linearised, judged, and refitted by its own noise.

use crate::candidates::directions::steps_at;
use crate::candidates::extended_model::{AttachedEffect, SignalScales, grown};
use crate::candidates::fitted_model::FittedModel;
use crate::candidates::predictor::Predictor;
use crate::candidates::runs::Runs;
use crate::evidence::binning::Binning;
use crate::evidence::climb::{Climb, Judgement, SETTLED};
use crate::evidence::gram::Grams;
use crate::evidence::parts::{Disagreement, Linearised};
use crate::evidence::prior::{Sign, of_amount, of_limit, precision_of_nuisance};
use crate::evidence::question::{Evidence, Question};
use fdm_effects::{Candidate, NewParam, Scales, Subject};
use fdm_estimate::Work;
use fdm_grammar::syntax::Class;
use fdm_numeric::parallel;
use fdm_system::model::Model;
use fdm_system::record::Run;
use std::sync::Arc;

/// Times that steps are chosen anew for the values of a refit.
const STEPPED: usize = 3;
/// How far one step may take what has a size: from a seventh to four times of it.
const SHRINKS: f64 = 0.85;
const GROWS: f64 = 3.0;

/// How far a state of an effect may begin from what it follows, in deviations of that, and the quantile that is one deviation above the middle.
const BEGINS: f64 = 0.3;
const UPPER: f64 = 0.84;

/// Log prior odds of a kind of cause against a mechanism. A sensor is believed later; what can stand in for many causes pays for each of its numbers.
const SENSOR: f64 = -1.0;
pub(crate) const STAND_IN: f64 = -4.0;
/// Of an effect of one field beside those of all, and of a number that is tried and not estimated.
const OF_FIELD: f64 = -1.0;
const TRIED: f64 = -0.3;

/// What everything is judged on.
#[derive(Clone)]
pub(crate) struct Ground<'a> {
    pub(crate) runs: Runs<'a>,
    pub(crate) binning: Binning,
    /// Candidates of the first search: as many places as an effect might have.
    pub(crate) candidates: usize,
    /// Standard deviation of what was measured of each output.
    pub(crate) deviations: Vec<f64>,
    pub(crate) work: &'a Work<'a>,
}

/// A text and its program.
#[derive(Clone)]
pub(crate) struct Text {
    pub(crate) model: Model,
    pub(crate) subject: Subject,
    pub(crate) predictors: Vec<Predictor>,
    /// Free parameters that all runs share, and those of each run, as columns.
    pub(crate) shared: Vec<usize>,
    pub(crate) own: Vec<usize>,
}

/// An effect in a text.
#[derive(Clone)]
pub(crate) struct Placed {
    pub(crate) candidate: Candidate,
    pub(crate) params: Vec<NewParam>,
    /// Whether each is estimated.
    estimated: Vec<bool>,
    /// How far the beginning of a state that follows a signal may be from that, before anything is seen; none of other parameters.
    begins: Vec<Option<f64>>,
    /// Where each stands among the model's parameters.
    pub(crate) at: Vec<usize>,
}

/// A text with effects, at values.
#[derive(Clone)]
pub(crate) struct State {
    pub(crate) text: Arc<Text>,
    /// All parameters of each run.
    pub(crate) theta: Vec<Vec<f64>>,
    pub(crate) effects: Vec<Placed>,
}

/// A state linearised.
pub(crate) struct Linear {
    pub(crate) grams: Grams,
    /// Of each run its own columns, the residual, the shared columns, in bins.
    pub(crate) columns: Vec<Vec<Vec<f64>>>,
}

/// A state judged.
pub(crate) struct Judged {
    pub(crate) linear: Linear,
    pub(crate) evidence: Evidence,
    /// Log evidence and log prior of the text as it stands: what another step would gain is not had yet.
    pub(crate) log: f64,
}

impl Placed {
    fn is_limit(&self, k: usize) -> bool {
        !self.params[k].null.is_finite()
    }

    /// Parameters that are estimated for all runs.
    pub(crate) fn numbers(&self) -> usize {
        self.estimated.iter().filter(|e| **e).count()
    }

    /// Log prior odds of the cause against a mechanism of all fields.
    pub(crate) fn odds(&self) -> f64 {
        odds(&self.candidate, &self.params, &self.estimated)
    }
}

/// Log prior odds of a candidate with these parameters against a mechanism of all fields.
pub(crate) fn odds(candidate: &Candidate, params: &[NewParam], estimated: &[bool]) -> f64 {
    let numbers = estimated.iter().filter(|e| **e).count().max(1) as f64;
    let class = match candidate.effect().class() {
        Class::Mechanism => 0.0,
        Class::Sensor => SENSOR,
        Class::StandIn => STAND_IN * numbers,
    };
    let tried = params.iter().filter(|p| p.fixed && p.begins_as.is_none()).count() as f64;
    let field = if candidate.effect().fields().is_empty() { 0.0 } else { OF_FIELD };
    class + field + TRIED * tried
}

/// What physics knows of the sign of an amount.
pub(crate) fn sign(param: &NewParam) -> Sign {
    if param.positive || param.lower.is_finite() && param.lower >= param.null { Sign::Positive } else { Sign::Either }
}

impl Text {
    fn new(model: Model, predictors: Vec<Predictor>, ground_runs: Runs<'_>) -> Option<Self> {
        let subject = Subject::new(model.source(), model.definition()).ok()?;
        Self::of(model, subject, predictors, ground_runs)
    }

    fn of(model: Model, subject: Subject, predictors: Vec<Predictor>, runs: Runs<'_>) -> Option<Self> {
        let pick = |own: bool| -> Vec<usize> {
            let params = model.definition().params.iter().enumerate();
            params.filter(|(_, p)| !p.fixed && p.per_run == own).map(|(k, _)| k).collect()
        };
        let free = (pick(false), pick(true));
        let predictor = predictors.first().filter(|_| !runs.all.is_empty())?;
        let (shared, own) = predictor.columns(free, model.definition().params.len());
        Some(Self { model, subject, predictors, shared, own })
    }
}

impl State {
    /// A model at its fit, without effects.
    pub(crate) fn base(fitted: &FittedModel, runs: Runs<'_>) -> Option<Self> {
        let (model, subject) = (fitted.model.clone(), fitted.subject.clone());
        let text = Arc::new(Text::of(model, subject, fitted.predictors.clone(), runs)?);
        Some(Self { text, theta: fitted.theta.clone(), effects: Vec::new() })
    }

    /// As candidates are attached to it; none where it has no response.
    pub(crate) fn fitted(&self, runs: Runs<'_>) -> Option<FittedModel> {
        let Text { model, subject, predictors, .. } = &*self.text;
        let response = crate::candidates::predictor::responses(model, runs.all, predictors, &self.theta)?;
        let (model, subject) = (model.clone(), subject.clone());
        Some(FittedModel { model, subject, theta: self.theta.clone(), predictors: predictors.clone(), response })
    }

    /// With one more effect at values of its parameters; `predictors` are those of its directions.
    pub(crate) fn with(
        &self,
        attached: &AttachedEffect,
        (fitted, scales): (&FittedModel, &SignalScales),
        values: &[f64],
        predictors: &[Predictor],
        runs: Runs<'_>,
    ) -> Option<Self> {
        let model = grown(attached, fitted).ok()?;
        let theta: Vec<Vec<f64>> =
            (0..runs.all.len()).map(|r| attached.theta_from(&self.theta[r], r, values)).collect();
        let affine = model.layout().affine.rates;
        let finer = |(a, b): (&Predictor, &Predictor)| {
            let (own, other) = (a.steps()?, b.steps()?);
            let steps = if own.most() >= other.most() { own } else { other };
            Some(Predictor::Steps(steps_at(steps, 0, affine)))
        };
        let of_both: Option<Vec<Predictor>> = self.text.predictors.iter().zip(predictors).map(finer).collect();
        // bins are those of the model itself
        let predictors = of_both.or_else(|| Predictor::all(&model, runs, &theta).ok())?;
        let text = Text::new(model, predictors, runs)?;
        let estimated = (0..attached.params().len()).map(|k| attached.is_estimated(k)).collect();
        let spread = |p: &NewParam| {
            let signal = p.begins_as.as_ref()?;
            let spread = scales.level(signal, UPPER) - scales.level(signal, 1.0 - UPPER);
            Some(BEGINS * 0.5 * spread).filter(|s| s.is_finite() && *s > 0.0)
        };
        let begins = attached.params().iter().map(spread).collect();
        let mut effects = self.effects.clone();
        let (candidate, params) = (attached.candidate.clone(), attached.params().to_vec());
        effects.push(Placed { candidate, params, estimated, begins, at: Vec::new() });
        for placed in &mut effects {
            let at = placed.params.iter().map(|p| text.model.definition().param(&p.name));
            placed.at = at.collect::<Option<_>>()?;
        }
        Some(Self { text: Arc::new(text), theta, effects })
    }

    /// Values of an effect's parameters (of the first run).
    pub(crate) fn values(&self, effect: usize) -> Vec<f64> {
        self.effects[effect].at.iter().map(|k| self.theta[0][*k]).collect()
    }

    /// The base with some of the effects of this state, at its values; none where that has no text.
    pub(crate) fn only(&self, base: &Self, kept: &[usize], ground: &Ground<'_>) -> Option<Self> {
        let runs = ground.runs;
        let mut state = base.clone();
        for k in kept {
            let fitted = state.fitted(runs)?;
            let scales = SignalScales::new(&fitted, runs);
            let placed = &self.effects[*k];
            let attached =
                AttachedEffect::new(&placed.candidate, &fitted, &scales, &fdm_effects::Choice::new()).ok()?;
            state = state.with(&attached, (&fitted, &scales), &self.values(*k), &self.text.predictors, runs)?;
        }
        // what it has in common with this one is as it is here
        let (from, to) = (self.text.model.definition(), state.text.model.definition());
        for (k, param) in to.params.iter().enumerate() {
            if let Some(own) = from.param(&param.quantity.name) {
                state.theta.iter_mut().zip(&self.theta).for_each(|(theta, from)| theta[k] = from[own]);
            }
        }
        Some(state)
    }

    /// A sign that physics does not have.
    pub(crate) fn is_physical(&self) -> bool {
        self.effects.iter().enumerate().all(|(e, placed)| {
            let values = self.values(e);
            placed.params.iter().zip(values).all(|(p, v)| !p.positive || p.nuisance || v >= p.null)
        })
    }
}

impl Ground<'_> {
    /// Residual and columns of all runs.
    fn linearise(&self, state: &State) -> Option<Linear> {
        let Text { model, predictors, shared, own, .. } = &*state.text;
        let bare = |k: &usize| *k < model.definition().params.len();
        let (asked, asked_own): (Vec<usize>, Vec<usize>) =
            (shared.iter().copied().filter(bare).collect(), own.iter().copied().filter(bare).collect());
        let of = |r: usize| -> Option<Vec<Vec<f64>>> {
            let run: &Run = &self.runs.all[r];
            let linear =
                predictors[r].linearised(model.dynamics(), (run, &state.theta[r]), (&asked, &asked_own)).ok()?;
            let bins = &self.binning.runs[r];
            let column = |signal: &Vec<f64>| bins.of(signal, false);
            let (common, mine) = linear.columns.split_at(shared.len());
            let mut columns: Vec<Vec<f64>> = mine.iter().map(column).collect();
            columns.push(bins.of(&linear.residual, false));
            columns.extend(common.iter().map(column));
            columns.iter().flatten().all(|v| v.is_finite()).then_some(columns)
        };
        let columns = parallel::map(0..self.runs.all.len(), of).into_iter().collect::<Option<Vec<_>>>()?;
        let mut grams = Grams::new(self.binning.outputs, self.binning.bands, shared.len());
        for (columns, bins) in columns.iter().zip(&self.binning.runs) {
            grams.add(own.len(), &bins.segments, columns);
        }
        Some(Linear { grams, columns })
    }

    /// How far the parts of the records are apart on an effect: on that of its numbers on which they are farthest.
    pub(crate) fn disagreement(&self, (state, judged): &(State, Judged), effect: usize) -> Option<Disagreement> {
        let (placed, own) = (&state.effects[effect], state.text.own.len());
        let linearised =
            Linearised { columns: &judged.linear.columns, own, evidence: &judged.evidence, binning: &self.binning };
        let numbers = placed.params.iter().zip(&placed.at).filter(|(param, _)| !param.nuisance);
        let of = |(param, at): (&NewParam, &usize)| {
            let column = state.text.shared.iter().position(|s| s == at)?;
            let parts = linearised.parts(column, state.theta[0][*at] - param.null)?;
            Some(parts.disagreement())
        };
        numbers.filter_map(of).max_by(|a, b| a.scatter.total_cmp(&b.scatter))
    }

    /// Precision of each shared unknown before anything is seen.
    pub(crate) fn precision(&self, state: &State) -> Vec<f64> {
        let mut precision = vec![0.0; state.text.shared.len()];
        for placed in &state.effects {
            for ((param, at), estimated) in placed.params.iter().zip(&placed.at).zip(&placed.estimated) {
                if let Some(k) = state.text.shared.iter().position(|s| s == at).filter(|_| param.nuisance && *estimated)
                {
                    precision[k] = precision_of_nuisance(state.theta[0][*at], param.lower, param.upper);
                }
            }
        }
        precision
    }

    /// Precision of each run's own unknowns before anything is seen; those of the model have none.
    pub(crate) fn own_precision(&self, state: &State) -> Vec<f64> {
        let of = |k: &usize| {
            let own = |p: &Placed| p.at.iter().zip(&p.begins).find(|(at, _)| *at == k).and_then(|(_, spread)| *spread);
            state.effects.iter().find_map(own).map_or(0.0, |spread| spread.powi(-2))
        };
        state.text.own.iter().map(of).collect()
    }

    /// Log prior of the effects of a state whose unknowns have moved by `mean` with this covariance (q by q, rows of `stride`).
    pub(crate) fn log_prior(&self, state: &State, mean: &[f64], covariance: &[f64], stride: usize) -> f64 {
        let mut sum = 0.0;
        for placed in &state.effects {
            sum += placed.odds() - (self.candidates as f64).ln();
            for (k, (param, at)) in placed.params.iter().zip(&placed.at).enumerate() {
                if param.fixed && param.begins_as.is_none() {
                    sum -= (param.trials.len().max(1) as f64).ln();
                }
                let Some(column) = state.text.shared.iter().position(|s| s == at) else { continue };
                if param.nuisance || !placed.estimated[k] {
                    continue;
                }
                let error = covariance[column * stride + column].max(0.0).sqrt();
                let value = state.theta[0][*at] + mean[column];
                sum += if placed.is_limit(k) {
                    of_limit(value, error)
                } else {
                    of_amount(value - param.null, error, sign(param))
                };
            }
        }
        sum
    }

    /// Weights of white noise as large as the residuals of each output are.
    pub(crate) fn plain_weights(&self, grams: &Grams) -> Vec<f64> {
        let of = |output: usize| {
            let power: f64 = grams.residual_powers(output).iter().sum();
            let own =
                self.binning.runs.iter().flat_map(|r| &r.segments).filter(|s| s.place / self.binning.bands == output);
            let bins: usize = own.map(|s| s.end - s.begin).sum();
            vec![bins as f64 / power.max(f64::MIN_POSITIVE); self.binning.bands]
        };
        (0..self.binning.outputs).flat_map(of).collect()
    }

    /// A state with steps that suit its values; none where those that it has do: halves of them would move its weighted squares by no more than is worth a
    /// step of a fit.
    fn with_own_steps(&self, state: &State, weights: &[f64]) -> Option<State> {
        let with = |predictors: Vec<Predictor>| State {
            text: Arc::new(Text { predictors, ..Text::clone(&state.text) }),
            ..state.clone()
        };
        let halved = state.text.predictors.iter().map(Predictor::halved).collect::<Option<Vec<_>>>()?;
        let moved = self.weighted(&with(halved), weights) - self.weighted(state, weights);
        if 0.5 * moved.abs() < SETTLED {
            return None;
        }
        Predictor::all(&state.text.model, self.runs, &state.theta).ok().map(with)
    }

    /// A state fitted by its own noise, with the greatest evidence on the way; none where it has no response. Where its values ask for other steps than those it
    /// began with, as a time constant does that has become short, it goes on with these.
    pub(crate) fn refit(&self, state: State, weights: Option<&[f64]>) -> Option<(State, Judged)> {
        let mut found = self.climbed(state, weights)?;
        for _ in 0..STEPPED {
            if !self.work.goes_on() {
                break;
            }
            let own = found.1.evidence.weights.clone();
            let Some(state) = self.with_own_steps(&found.0, &own) else { break };
            let Some(next) = self.climbed(state, Some(&own)) else { break };
            found = next;
        }
        Some(found)
    }
}

impl Judgement for Judged {
    fn evidence(&self) -> &Evidence {
        &self.evidence
    }

    fn log(&self) -> f64 {
        self.log
    }
}

impl Climb for Ground<'_> {
    type Point = State;
    type Judged = Judged;

    fn judge(&self, state: &State, weights: Option<&[f64]>) -> Option<Judged> {
        let linear = self.linearise(state)?;
        let precision = self.precision(state);
        let own = self.own_precision(state);
        let question = Question { grams: &linear.grams, noise: &self.binning.noise, precision: &precision, own: &own };
        let evidence = question.answer(weights)?;
        let prior = self.log_prior(state, &evidence.mean, &evidence.covariance, evidence.mean.len());
        let log = evidence.log + prior - evidence.gain;
        log.is_finite().then_some(Judged { linear, evidence, log })
    }

    fn plain_step(&self, state: &State) -> Option<Evidence> {
        let linear = self.linearise(state)?;
        let (precision, own) = (self.precision(state), self.own_precision(state));
        let question = Question { grams: &linear.grams, noise: &self.binning.noise, precision: &precision, own: &own };
        question.step(&self.plain_weights(&linear.grams))
    }

    fn moved(&self, state: &State, evidence: &Evidence, part: f64) -> State {
        let mut moved = state.clone();
        let params = &state.text.model.definition().params;
        for (k, step) in state.text.shared.iter().zip(&evidence.mean) {
            if *k >= params.len() {
                continue;
            }
            let (value, mut step) = (state.theta[0][*k], part * step);
            let sized =
                |p: &Placed| p.at.iter().zip(&p.params).any(|(at, p)| at == k && (p.nuisance || !p.trials.is_empty()));
            if value != 0.0 && state.effects.iter().any(sized) {
                step = step.clamp(-SHRINKS * value.abs(), GROWS * value.abs());
            }
            let value = (value + step).clamp(params[*k].lower, params[*k].upper);
            moved.theta.iter_mut().for_each(|theta| theta[*k] = value);
        }
        for (theta, own) in moved.theta.iter_mut().zip(&evidence.own) {
            for (k, step) in state.text.own.iter().zip(own) {
                if *k < params.len() {
                    theta[*k] = (theta[*k] + part * step).clamp(params[*k].lower, params[*k].upper);
                }
            }
        }
        moved
    }

    fn weighted(&self, state: &State, weights: &[f64]) -> f64 {
        let Text { model, predictors, .. } = &*state.text;
        let of = |r: usize| -> f64 {
            let (run, bins): (&Run, _) = (&self.runs.all[r], &self.binning.runs[r]);
            let Ok(response) = predictors[r].answer(model.dynamics(), run, &state.theta[r]) else {
                return f64::INFINITY;
            };
            let left = bins.of(&predictors[r].left_by(run, &response), false);
            let sum: f64 = bins
                .segments
                .iter()
                .map(|s| weights[s.place] * left[s.begin..s.end].iter().map(|v| v * v).sum::<f64>())
                .sum();
            if sum.is_finite() { sum } else { f64::INFINITY }
        };
        parallel::map(0..self.runs.all.len(), of).into_iter().sum()
    }

    fn goes_on(&self) -> bool {
        self.work.goes_on()
    }
}
