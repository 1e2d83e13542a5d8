//! Which effect to go on with: the best sets of two and three effects say what the best single one cannot.
//!
//! A flexible effect that stands for several causes is the best one alone, and its partners never come in. So every effect that is no
//! likeness of the best, and good enough, is a beginning. What its fit leaves is compared with the directions of all candidates beside its own
//! (their Gram matrix): the best partners, alone and in pairs, are fitted jointly with it. So are the best of all sets of two and three among the
//! forty best directions. The likeliest set says which of its effects is accepted. Whatever is accepted beside it is searched anew.

use super::acceptance::below_null;
use super::best_subsets::{Columns, Subset};
use super::candidate_model::{CandidateModel, Prediction};
use super::comparison::{ALIKE, Comparison, EQUAL};
use super::directions::TrialPoint;
use super::elimination::rebuilt;
use super::error::DiagnosisError;
use super::extended_model::{AttachedEffect, SignalScales, grown, new_values, written};
use super::fitted_model::{FittedModel, shared_from, split_fit_within};
use super::forward_selection::ForwardSelection;
use super::forward_step::ForwardStep;
use super::predictor::responses;
use super::projection::{Projection, cosine, dot};
use fdm_effects::{Candidate, Choice, NewParam};
use fdm_grammar::syntax::Class;
use fdm_numeric::parallel;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Effects beside the best one that sets begin with.
const BEGINNINGS: usize = 3;
/// Part of the best score that such a candidate model has.
const ALTERNATIVE: f64 = 0.25;
/// Cosine above which two of equal scores say the same.
const SAME: f64 = 0.9999;
/// Partners of a beginning that are fitted with it, and those among which the best two are looked for.
const PARTNERS: usize = 2;
const PAIRED: usize = 12;
/// Distinct directions among which all sets are tried, cosine above which two are one of them, and sets of these that are fitted.
const FORTY: usize = 40;
const ONE: f64 = 0.98;
const SETS: usize = 3;
/// Iterations of a set's fit, and what one of them must be predicted to gain: sets are compared, and nobody is told their estimates.
const ROUGHLY: (usize, f64) = (20, 0.1);
/// Part of its own energy that a direction must have beside others.
const DISTINCT: f64 = 1e-3;

/// The model with a candidate model in it.
pub(super) struct NextStep {
    /// The candidate model.
    pub(super) candidate: usize,
    pub(super) current: Arc<FittedModel>,
    /// The candidate model with which mechanisms alone would go on; none where there is none.
    pub(super) mechanism: Option<usize>,
}

/// Candidate models that may be accepted, the best first.
pub(super) struct Acceptable {
    /// Those that nothing speaks against.
    pub(super) alone: Vec<usize>,
    /// Mechanisms against which only the sign of their joint fit speaks: as long as its partner is missing, a friction may seem to be
    /// negative. They are accepted where a set with the signs of physics is the likeliest.
    pub(super) in_sets: Vec<usize>,
}

impl Acceptable {
    /// All that may be accepted; those first that nothing speaks against.
    pub(super) fn beginnings(&self) -> Vec<usize> {
        self.alone.iter().chain(&self.in_sets).copied().collect()
    }
}

/// What a set begins with.
struct Beginning<'c> {
    /// The candidate model, by its place.
    model: usize,
    own: &'c CandidateModel,
    /// What it leaves, and what it adds, beside what is fitted.
    left: Vec<f64>,
    added: Vec<f64>,
    /// Products of what it adds with itself and with what it leaves.
    size: f64,
    product: f64,
}

/// A direction beside a beginning.
#[derive(Clone, Copy)]
struct Partner {
    direction: usize,
    amount: f64,
    /// The gain that it predicts, less its penalty.
    score: f64,
}

/// Candidates that are fitted with a beginning.
struct EffectSet {
    /// The beginning, by its place in the comparison.
    model: usize,
    partners: Vec<(usize, f64)>,
}

impl ForwardSelection<'_> {
    /// The candidate model to go on with.
    pub(super) fn best_next_step(
        &self,
        step: &ForwardStep<'_>,
        comparison: &Comparison,
        scales: &SignalScales,
        can: &Acceptable,
    ) -> Result<Option<NextStep>, DiagnosisError> {
        let (best, fit) = (can.alone.first().copied(), &can.alone[..]);
        // a stand-in must be better than the best pair of mechanisms
        let mut others = match best {
            Some(best) if comparison.models[best].class == Class::StandIn => mechanisms(comparison),
            _ => alternatives(comparison, fit),
        };
        others.extend(can.in_sets.iter().take(BEGINNINGS).filter(|k| !others.contains(k)).copied().collect::<Vec<_>>());
        let is_mechanism = |k: &usize| comparison.models[*k].class == Class::Mechanism;
        let (mut chosen, mut mechanism) = (best, fit.iter().copied().find(is_mechanism));
        if !others.is_empty() && self.accepted.len() + 2 <= self.options.most && self.work.goes_on() {
            self.work.stage(&format!(
                "fitting sets of effects that begin with {} of them",
                others.len() + usize::from(best.is_some())
            ));
            let totals = self.totals(step, comparison, can, &others);
            let least = |of: &dyn Fn(&usize) -> bool| {
                let finite = totals.iter().filter(|(k, total)| total.is_finite() && of(k));
                finite.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, _)| *k)
            };
            chosen = least(&|_| true).or(chosen);
            mechanism = least(&is_mechanism).or(mechanism);
        }
        let Some(chosen) = chosen.map(|k| simplest(comparison, fit, k)) else { return Ok(None) };
        let mechanism = mechanism.map(|k| simplest(comparison, fit, k));
        let current = Arc::new(self.with_candidate(step, &comparison.models[chosen], scales)?);
        Ok(Some(NextStep { candidate: chosen, current, mechanism }))
    }

    /// The cost of the likeliest set that begins with each of these, penalties included; the best first.
    fn totals(
        &self,
        step: &ForwardStep<'_>,
        comparison: &Comparison,
        can: &Acceptable,
        others: &[usize],
    ) -> Vec<(usize, f64)> {
        let fit = &can.alone[..];
        let sets = step.sets(comparison, &can.beginnings(), fit.first().into_iter().chain(others).copied().collect());
        let total = |set: &EffectSet| Some((set.model, self.total(step, comparison, (set, can))?));
        let totals: Vec<(usize, f64)> = parallel::filter_map(sets.iter(), total);
        let alone = |k: usize| {
            if can.in_sets.contains(&k) {
                return f64::INFINITY;
            }
            let own = &comparison.models[k];
            own.fitting.cost + own.validation.as_ref().map_or(0.0, |(_, v)| v.cost) + own.penalty()
        };
        let least = |k: usize| totals.iter().filter(|(m, _)| *m == k).map(|(_, t)| *t).fold(alone(k), f64::min);
        let mut begun: Vec<usize> = fit.first().into_iter().chain(others).copied().collect();
        begun.extend(sets.iter().map(|set| set.model));
        let mut seen = BTreeSet::new();
        begun.retain(|k| seen.insert(*k));
        begun.into_iter().map(|k| (k, least(k))).collect()
    }

    /// The cost of a set, fitted jointly by the noise of the comparison, with its penalties; none where it begins with what has the sign of
    /// physics in a set only, and has another in this one.
    fn total(
        &self,
        step: &ForwardStep<'_>,
        comparison: &Comparison,
        (set, can): (&EffectSet, &Acceptable),
    ) -> Option<f64> {
        if !self.work.goes_on() {
            return None;
        }
        let (own, current) = (&comparison.models[set.model], &step.current);
        let attached = &step.simulated[own.candidate].attached;
        let mut effects: Vec<(Candidate, Choice)> =
            vec![(attached.candidate.clone(), written(attached, own.fitting.theta.first()?))];
        let mut penalty = own.penalty();
        for (direction, amount) in &set.partners {
            let (t, point) = step.owner[*direction];
            let (trace, attached) = (&step.simulated[t], &step.simulated[t].attached);
            let values = trace.points[point].at(*amount, attached.params());
            let named = attached.params().iter().zip(values).filter(|(p, _)| p.begins_as.is_none());
            effects.push((attached.candidate.clone(), named.map(|(p, v)| (p.local.clone(), v)).collect()));
            penalty += step.penalty(t);
        }
        let mut theta: Vec<Vec<f64>> = own.fitting.theta.iter().map(|theta| attached.base(theta)).collect();
        theta.extend(shared_from(current.params(), theta.first()?, &current.theta[self.runs.train..]));
        let (model, params) = rebuilt(current, current, &theta, self.runs, &effects).ok()?;
        let fitted = split_fit_within(&model, self.runs, &comparison.noise, ROUGHLY).ok()?;
        let value = |p: &NewParam| fitted.fitting.shared(&p.name).map(|e| e.value);
        if can.in_sets.contains(&set.model) && params.iter().any(|params| below_null(params, value).is_some()) {
            return None;
        }
        fitted.cost().is_finite().then_some(fitted.cost() + penalty)
    }

    /// The model with a candidate model in its text, fitted jointly.
    pub(super) fn with_candidate(
        &self,
        step: &ForwardStep<'_>,
        candidate: &CandidateModel,
        scales: &SignalScales,
    ) -> Result<FittedModel, DiagnosisError> {
        let attached = &step.simulated[candidate.candidate].attached;
        let choice = written(attached, &candidate.fitting.theta[0]);
        let text =
            AttachedEffect::new(&attached.candidate, &step.current, scales, &choice).map_err(DiagnosisError::NoFit)?;
        let model = grown(&text, &step.current)?;
        let mut theta = candidate.fitting.theta.clone();
        match &candidate.validation {
            Some((_, validation)) => theta.extend(validation.theta.iter().cloned()),
            None => {
                let values = new_values(attached, &candidate.fitting.theta[0]);
                theta.extend((self.runs.train..self.runs.all.len()).map(|r| attached.theta(&step.current, r, &values)));
            }
        }
        FittedModel::new(model, self.runs, theta)
    }
}

/// The simplest candidate model that says what this one says: a set holds but one of several that are alike, whichever that is.
fn simplest(comparison: &Comparison, fit: &[usize], chosen: usize) -> usize {
    let own = &comparison.models[chosen];
    let same = |k: &usize| {
        let other = &comparison.models[*k];
        (other.score() - own.score()).abs() <= EQUAL && cosine(&other.direction, &own.direction).abs() > SAME
    };
    // equals come in the order of how simple they are
    fit.iter().copied().find(same).unwrap_or(chosen)
}

impl ForwardStep<'_> {
    /// The sets of two and three effects that are worth a fit: of these beginnings, and the best of all that hold one of `begin`.
    fn sets(&self, comparison: &Comparison, begin: &[usize], beginnings: Vec<usize>) -> Vec<EffectSet> {
        let (runs, q) = (self.runs.train(), self.current.outputs());
        let projection = Projection::new(&self.records, runs, &self.current.predictors, q, &comparison.noise);
        let beginning = |k: &usize| -> Option<Beginning<'_>> {
            let own = &comparison.models[*k];
            let answers = responses(&own.model, runs, &own.predictors[..self.runs.train], &own.fitting.theta)?;
            let left = self.left_by(&own.predictors, &answers);
            let parts: Vec<&[f64]> = left.iter().map(Vec::as_slice).collect();
            let left = projection.added(&parts).direction;
            let added = self.predictions(own.candidate, &projection).into_iter().next()?.added.direction;
            let (size, product) = (dot(&added, &added), dot(&added, &left));
            Some(Beginning { model: *k, own, left, added, size, product })
        };
        let beginnings: Vec<Beginning<'_>> = parallel::filter_map(beginnings.iter(), beginning);
        let direction = |d: usize| -> Vec<f64> { self.with_direction(d, |parts| projection.added(parts).direction) };
        // what it predicts alone, and beside each beginning
        let scored = |d: usize| -> (f64, Vec<Option<Partner>>) {
            let own = self.prediction(d, &projection);
            (own.gain, beginnings.iter().map(|b| self.partner(b, d, &own.added.direction)).collect())
        };
        let all = parallel::map(0..self.owner.len(), scored);
        let (gains, all): (Vec<f64>, Vec<Vec<Option<Partner>>>) = all.into_iter().unzip();
        let mut sets = self.exact_sets(comparison, begin, (&projection, &gains));
        for (k, beginning) in beginnings.iter().enumerate() {
            let mut partners: Vec<Partner> = all.iter().filter_map(|own| own[k]).collect();
            partners.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.direction.cmp(&b.direction)));
            // the best direction of each candidate
            let mut seen: Vec<usize> = Vec::new();
            partners.retain(|p| {
                let candidate = self.owner[p.direction].0;
                let new = !seen.contains(&candidate);
                seen.push(candidate);
                new && p.score > 0.0
            });
            partners.truncate(PAIRED);
            let model = beginning.model;
            let single = partners.iter().take(PARTNERS);
            sets.extend(single.map(|p| EffectSet { model, partners: vec![(p.direction, p.amount)] }));
            sets.extend(self.best_pair(beginning, &partners, direction).map(|partners| EffectSet { model, partners }));
        }
        sets
    }

    /// The best sets of two and three among the best directions (with what each predicts alone), each beginning with the best of its effects
    /// that may be accepted.
    fn exact_sets(
        &self,
        comparison: &Comparison,
        begin: &[usize],
        (projection, gains): (&Projection, &[f64]),
    ) -> Vec<EffectSet> {
        // the best direction of each candidate
        let single = |t: usize| -> Option<(f64, Prediction)> {
            let own = (0..self.owner.len()).filter(|d| self.owner[*d].0 == t);
            let best = own.max_by(|a, b| gains[*a].total_cmp(&gains[*b]).then(b.cmp(a)))?;
            let best = self.prediction(best, projection);
            Some((best.gain - self.penalty(t), best))
        };
        let all = parallel::map(0..self.simulated.len(), |t| Some((t, single(t)?)));
        let mut ranked: Vec<(usize, (f64, Prediction))> = all.into_iter().flatten().collect();
        ranked.sort_by(|a, b| b.1.0.total_cmp(&a.1.0).then(a.0.cmp(&b.0)));
        let mut chosen: Vec<(usize, Prediction)> = Vec::new();
        for (t, (_, prediction)) in ranked {
            let direction = &prediction.added.direction;
            let alike = |(_, o): &(usize, Prediction)| cosine(direction, &o.added.direction).abs() > ONE;
            if chosen.len() < FORTY && dot(direction, direction) > 0.0 && !chosen.iter().any(alike) {
                chosen.push((t, prediction));
            }
        }
        let direction = |k: usize| -> &[f64] { &chosen[k].1.added.direction };
        let m = chosen.len();
        let row = |a: usize| -> Vec<f64> { (0..m).map(|b| dot(direction(a), direction(b))).collect() };
        let gram: Vec<f64> = parallel::map(0..m, row).into_iter().flatten().collect();
        let columns = Columns {
            gram,
            along: (0..m).map(|k| projection.along(direction(k))).collect(),
            penalty: chosen.iter().map(|(t, _)| self.penalty(*t)).collect(),
        };
        let point = |k: usize| {
            let (t, point) = self.owner[chosen[k].1.direction];
            &self.simulated[t].points[point]
        };
        let best = columns.best_subsets(SETS, |k, amount| point(k).multiple(amount));
        let begun = |subset: Subset| -> Option<EffectSet> {
            let candidates: Vec<usize> = subset.members.iter().map(|(k, _)| chosen[*k].0).collect();
            let model = *begin.iter().find(|o| candidates.contains(&comparison.models[**o].candidate))?;
            let others = subset.members.iter().filter(|(k, _)| chosen[*k].0 != comparison.models[model].candidate);
            Some(EffectSet { model, partners: others.map(|(k, amount)| (chosen[*k].1.direction, *amount)).collect() })
        };
        best.into_iter().filter_map(begun).collect()
    }

    /// A direction beside a beginning: what it predicts of what that leaves.
    fn partner(&self, beginning: &Beginning<'_>, direction: usize, own: &[f64]) -> Option<Partner> {
        let (t, point) = self.owner[direction];
        if t == beginning.own.candidate {
            return None;
        }
        let [z, g] = beside(beginning, own)?;
        let (amount, twice) = gain(&self.simulated[t].points[point], z, g);
        let score = 0.5 * twice - self.penalty(t);
        score.is_finite().then_some(Partner { direction, amount, score })
    }

    /// The two partners that predict most together, with their amounts; none where two are worth no more than one.
    fn best_pair(
        &self,
        beginning: &Beginning<'_>,
        partners: &[Partner],
        direction: impl Fn(usize) -> Vec<f64> + Sync,
    ) -> Option<Vec<(usize, f64)>> {
        let size = beginning.size;
        let left = |p: &Partner| -> Vec<f64> {
            let mut own = direction(p.direction);
            let share = if size > 0.0 { dot(&own, &beginning.added) / size } else { 0.0 };
            own.iter_mut().zip(&beginning.added).for_each(|(d, b)| *d -= share * b);
            own
        };
        let own: Vec<Vec<f64>> = parallel::map(partners.iter(), left);
        let z: Vec<f64> = own.iter().map(|d| dot(d, &beginning.left)).collect();
        let mut best: Option<(f64, Vec<(usize, f64)>)> = None;
        for a in 0..own.len() {
            for b in 0..a {
                let (aa, bb, ab) = (dot(&own[a], &own[a]), dot(&own[b], &own[b]), dot(&own[a], &own[b]));
                let determinant = aa * bb - ab * ab;
                if determinant <= DISTINCT * aa * bb {
                    continue;
                }
                let (x, y) = ((bb * z[a] - ab * z[b]) / determinant, (aa * z[b] - ab * z[a]) / determinant);
                let cost = |p: &Partner| self.penalty(self.owner[p.direction].0);
                let score = 0.5 * (x * z[a] + y * z[b]) - cost(&partners[a]) - cost(&partners[b]);
                if best.as_ref().is_none_or(|(least, _)| score > *least) {
                    best = Some((score, vec![(partners[a].direction, x), (partners[b].direction, y)]));
                }
            }
        }
        let (score, pair) = best?;
        (score > partners.first()?.score).then_some(pair)
    }
}

/// Products of a direction with what a beginning leaves and with itself, beside what the beginning adds; none where nothing is left of it.
fn beside(beginning: &Beginning<'_>, own: &[f64]) -> Option<[f64; 2]> {
    let size = beginning.size;
    let along = dot(own, &beginning.added);
    let share = if size > 0.0 { along / size } else { 0.0 };
    let whole = dot(own, own);
    let g = whole - share * along;
    let z = dot(own, &beginning.left) - share * beginning.product;
    (g > DISTINCT * whole).then_some([z, g])
}

/// The multiple of a direction that predicts most, and twice its gain.
fn gain(point: &TrialPoint, z: f64, g: f64) -> (f64, f64) {
    let amount = point.multiple(z / g);
    (amount, 2.0 * amount * z - amount * amount * g)
}

/// The best mechanisms that are no likeness of each other, whatever they gain alone: as long as its partner is missing, a friction may
/// even seem to be negative.
fn mechanisms(comparison: &Comparison) -> Vec<usize> {
    let mut chosen: Vec<usize> = Vec::new();
    let all = 0..comparison.models.len();
    for k in all.filter(|k| comparison.models[*k].class == Class::Mechanism && comparison.models[*k].gain > 0.0) {
        let own = &comparison.models[k];
        let alike = |o: &usize| cosine(&own.direction, &comparison.models[*o].direction).abs() > ALIKE;
        if chosen.len() < BEGINNINGS && !chosen.iter().any(alike) {
            chosen.push(k);
        }
    }
    chosen
}

/// Candidate models that are no likeness of the best or of each other, and good enough to begin with.
fn alternatives(comparison: &Comparison, fit: &[usize]) -> Vec<usize> {
    let Some(best) = fit.first().copied() else { return Vec::new() };
    let score = comparison.models[best].score();
    let mut others: Vec<usize> = Vec::new();
    for k in fit.iter().skip(1).copied() {
        let own = &comparison.models[k];
        let alike = |o: &usize| cosine(&own.direction, &comparison.models[*o].direction).abs() > ALIKE;
        let enough = own.score() > ALTERNATIVE * score && others.len() + 1 < BEGINNINGS;
        if enough && !alike(&best) && !others.iter().any(alike) {
            others.push(k);
        }
    }
    others
}
