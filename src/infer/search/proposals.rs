//! What might be added to a state: every candidate at every value that is tried, ranked in closed form under several noises, the best judged to
//! first order by their own.

use super::state::{Ground, Judged, State, odds, sign};
use crate::candidates::directions::Shape;
use crate::candidates::directions::{CandidateDirections, TrialPoint};
use crate::candidates::extended_model::{SignalScales, place};
use crate::candidates::fitted_model::FittedModel;
use crate::candidates::forced_tiles::all_directions;
use crate::diagnosis::{EffectAt, LeftOut};
use crate::evidence::climb::Climb;
use crate::evidence::gram::{Border, Grams, products};
use crate::evidence::prior::{Sign, of_amount};
use crate::evidence::question::Question;
use crate::evidence::screen::{Beside, Screen};
use fdm_effects::{Candidate, Kind};
use fdm_numeric::parallel;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Candidates whose evidence is asked for in each round, pairs likewise, and how many candidates pairs are made of.
const SINGLES: usize = 12;
const PAIRS: usize = 16;
const PAIRED: usize = 100;
/// Rounds: by the noise that the state believes, by plain errors, by that of the best proposal.
const ROUNDS: usize = 4;
/// Part of an effect that is left beside the fitted parameters, below which it is called hidden.
const HIDDEN: f64 = 0.03;
/// Part of the squares of two columns that is left of their determinant, below which they are one.
const APART: f64 = 0.02;

/// The lesser part of a golden section, and steps: a limit is found to a part in 500 of where it may be.
const GOLDEN: f64 = 0.381_966;
const LIMIT_STEPS: usize = 12;

/// A candidate at one value of what is tried.
pub(crate) struct Spec {
    /// Which directions.
    pub(crate) direction: usize,
    /// Points, by their places there, and their columns.
    points: Vec<usize>,
    columns: Vec<usize>,
    /// Values that are tried of this candidate.
    tried: f64,
}

/// All that might be added to a state.
pub(crate) struct Proposals<'s> {
    ground: &'s Ground<'s>,
    state: &'s State,
    judged: &'s Judged,
    pub(crate) fitted: FittedModel,
    scales: SignalScales,
    pub(crate) directions: Vec<CandidateDirections>,
    pub(crate) left_out: Vec<LeftOut>,
    pub(crate) specs: Vec<Spec>,
    /// Bins of each column in each run, and its products with the state's columns.
    columns: Vec<Vec<Vec<f64>>>,
    borders: Vec<Border>,
}

/// Some specs, judged to first order.
#[derive(Clone)]
pub(crate) struct Proposal {
    pub(crate) specs: Vec<usize>,
    pub(crate) log: f64,
    /// Multiples of the columns of each spec.
    amounts: Vec<Vec<f64>>,
    pub(crate) weights: Vec<f64>,
}

/// A spec under some weights.
struct Scored {
    score: f64,
    /// Of a spec of one column.
    beside: Option<Beside>,
}

impl<'s> Proposals<'s> {
    /// None where it was stopped, or the state has no response.
    pub(crate) fn new(
        ground: &'s Ground<'s>,
        (state, judged): (&'s State, &'s Judged),
        candidates: &[Candidate],
    ) -> Option<Self> {
        let runs = ground.runs;
        let fitted = state.fitted(runs)?;
        let scales = SignalScales::new(&fitted, runs);
        let taken = |c: &&Candidate| state.effects.iter().any(|e| place(&e.candidate) == place(c));
        let scored: Vec<&Candidate> =
            candidates.iter().filter(|c| c.kind() != Kind::Variance).filter(|c| !taken(c)).collect();
        let found = all_directions(&scored, (&fitted, runs, &scales), ground.work)?;
        let (mut directions, mut left_out) = (Vec::new(), Vec::new());
        for (candidate, found) in scored.iter().zip(found) {
            match found {
                Ok(found) => directions.push(found),
                Err(reason) => left_out.push(LeftOut { place: place(candidate), reason }),
            }
        }
        let (mut specs, mut signals) = (Vec::new(), Vec::new());
        for (d, found) in directions.iter_mut().enumerate() {
            let first = specs.len();
            let mut groups: BTreeMap<usize, usize> = BTreeMap::new();
            for (p, (point, parts)) in found.points.iter().zip(std::mem::take(&mut found.signals)).enumerate() {
                let column = signals.len();
                signals.push(parts);
                let spec = match point.shape {
                    Shape::Joint { group } => *groups.entry(group).or_insert(specs.len()),
                    _ => specs.len(),
                };
                if spec == specs.len() {
                    specs.push(Spec { direction: d, points: Vec::new(), columns: Vec::new(), tried: 1.0 });
                }
                specs[spec].points.push(p);
                specs[spec].columns.push(column);
            }
            let tried = (specs.len() - first) as f64;
            specs[first..].iter_mut().for_each(|s: &mut Spec| s.tried = tried);
        }
        let bins = &ground.binning.runs;
        let binned = |parts: Vec<Vec<f64>>| -> Vec<Vec<f64>> {
            parts.iter().zip(bins).map(|(signal, bins)| bins.of(signal, true)).collect()
        };
        let columns = parallel::map(signals, binned);
        let Linearised { grams, own } = Linearised::of(judged);
        let border = |column: &Vec<Vec<f64>>| grams.border(bins.iter().map(|b| &b.segments[..]), own, column);
        let borders = parallel::map(columns.iter(), border);
        Some(Self { ground, state, judged, fitted, scales, directions, left_out, specs, columns, borders })
    }

    fn point(&self, spec: &Spec, k: usize) -> &TrialPoint {
        &self.directions[spec.direction].points[spec.points[k]]
    }

    /// Log prior of a spec whose columns have these multiples with these errors.
    fn log_prior(&self, spec: &Spec, amounts: &[f64], errors: &[f64]) -> f64 {
        let attached = &self.directions[spec.direction].attached;
        let params = attached.params();
        let estimated: Vec<bool> = (0..params.len()).map(|k| attached.is_estimated(k)).collect();
        let kind =
            odds(&attached.candidate, params, &estimated) - (self.ground.candidates as f64).ln() - spec.tried.ln();
        let amount = |(k, (amount, error)): (usize, (&f64, &f64))| {
            let point = self.point(spec, k);
            let sign = if point.is_linear() { sign(&params[point.lead]) } else { Sign::Positive };
            of_amount(*amount, *error, sign)
        };
        kind + amounts.iter().zip(errors).enumerate().map(amount).sum::<f64>()
    }

    /// Products of two columns in a run.
    fn cross(&self, run: usize, a: usize, b: usize) -> Vec<f64> {
        let binning = &self.ground.binning;
        let places = binning.outputs * binning.bands;
        products(&binning.runs[run].segments, places, &self.columns[a][run], &self.columns[b][run])
    }

    /// Products of two columns under weights, beside what the state's columns do.
    fn crossed(&self, weights: &[f64], (a, left): (usize, &Beside), (b, right): (usize, &Beside)) -> f64 {
        let whole: f64 = (0..self.ground.binning.runs.len())
            .map(|r| self.cross(r, a, b).iter().zip(weights).map(|(v, w)| v * w).sum::<f64>())
            .sum();
        whole - left.along.iter().zip(&right.along).map(|(x, y)| x * y).sum::<f64>()
    }

    /// All specs under some weights.
    fn scored(&self, weights: &[f64]) -> Option<Vec<Option<Scored>>> {
        let precision = self.ground.precision(self.state);
        let screen = Screen::new(&self.judged.linear.grams, weights, &precision)?;
        let beside = parallel::map(self.borders.iter(), |border| screen.beside(border));
        let of = |spec: &Spec| -> Option<Scored> {
            let own: Vec<&Beside> = spec.columns.iter().map(|c| beside[*c].as_ref()).collect::<Option<_>>()?;
            if let [only] = own[..] {
                let Beside { cross, square, .. } = only;
                let (amount, error) = (cross / square, 1.0 / square.sqrt());
                let fit = 0.5 * cross * amount + 0.5 * (2.0 * PI / square).ln();
                return Some(Scored {
                    score: fit + self.log_prior(spec, &[amount], &[error]),
                    beside: Some(only.clone()),
                });
            }
            let n = own.len();
            let mut matrix = nalgebra::DMatrix::zeros(n, n);
            for i in 0..n {
                matrix[(i, i)] = own[i].square * (1.0 + 1e-9);
                for j in 0..i {
                    let v = self.crossed(weights, (spec.columns[i], own[i]), (spec.columns[j], own[j]));
                    (matrix[(i, j)], matrix[(j, i)]) = (v, v);
                }
            }
            let right = nalgebra::DVector::from_iterator(n, own.iter().map(|b| b.cross));
            let factor = matrix.cholesky()?;
            let (amounts, inverse) = (factor.solve(&right), factor.inverse());
            let log_root: f64 = factor.l_dirty().diagonal().iter().map(|v| v.ln()).sum();
            let fit = 0.5 * right.dot(&amounts) + 0.5 * n as f64 * (2.0 * PI).ln() - log_root;
            let errors: Vec<f64> = (0..n).map(|i| inverse[(i, i)].sqrt()).collect();
            Some(Scored { score: fit + self.log_prior(spec, amounts.as_slice(), &errors), beside: None })
        };
        Some(parallel::map(self.specs.iter(), of))
    }

    /// The evidence of the state with some specs to first order, by its own noise.
    fn first_order(&self, specs: &[usize], weights: &[&[f64]]) -> Option<Proposal> {
        let columns: Vec<usize> = specs.iter().flat_map(|s| self.specs[*s].columns.iter().copied()).collect();
        let borders: Vec<&Border> = columns.iter().map(|c| &self.borders[*c]).collect();
        let grams = self.judged.linear.grams.bordered(&borders, &|run, a, b| self.cross(run, columns[a], columns[b]));
        let mut precision = self.ground.precision(self.state);
        let q = precision.len();
        precision.resize(q + columns.len(), 0.0);
        let own = self.ground.own_precision(self.state);
        let question = Question { grams: &grams, noise: &self.ground.binning.noise, precision: &precision, own: &own };
        let answers = weights.iter().filter_map(|w| question.answer(Some(w)));
        let found = answers.max_by(|a, b| a.log.total_cmp(&b.log))?;
        let stride = q + columns.len();
        let mut log = found.log + self.ground.log_prior(self.state, &found.mean[..q], &found.covariance, stride);
        let (mut at, mut amounts) = (q, Vec::new());
        for spec in specs.iter().map(|s| &self.specs[*s]) {
            let own = at..at + spec.columns.len();
            let errors: Vec<f64> = own.clone().map(|k| found.covariance[k * stride + k].max(0.0).sqrt()).collect();
            log += self.log_prior(spec, &found.mean[own.clone()], &errors);
            amounts.push(found.mean[own.clone()].to_vec());
            at = own.end;
        }
        log.is_finite().then_some(Proposal { specs: specs.to_vec(), log, amounts, weights: found.weights })
    }

    /// The likeliest sets of specs to first order, singles and (where asked for) pairs, the likeliest first.
    pub(crate) fn likeliest(&self, pairs: bool) -> Vec<Proposal> {
        let plain = self.ground.plain_weights(&self.judged.linear.grams);
        let mut weights = self.judged.evidence.weights.clone();
        let mut pool: BTreeMap<Vec<usize>, Option<Proposal>> = BTreeMap::new();
        for round in 0..ROUNDS {
            let by = if round == 1 { &plain } else { &weights };
            let Some(scored) = self.scored(by) else { break };
            let mut wanted = self.top(&scored);
            let few: Vec<usize> = wanted.iter().take(PAIRED).copied().collect();
            wanted.truncate(SINGLES);
            let mut sets: Vec<Vec<usize>> = wanted.into_iter().map(|s| vec![s]).collect();
            if pairs {
                sets.extend(self.pairs(&few, &scored, by));
            }
            sets.retain(|set| !pool.contains_key(set));
            let new = !sets.is_empty();
            let begun: [&[f64]; 2] = [&self.judged.evidence.weights, &plain];
            let asked = parallel::map(sets, |set| {
                let found = self.first_order(&set, &begun);
                (set, found)
            });
            pool.extend(asked);
            let best = pool.values().flatten().max_by(|a, b| a.log.total_cmp(&b.log));
            let Some(best) = best.filter(|_| new || round < 2) else { break };
            weights.clone_from(&best.weights);
        }
        let mut ranked: Vec<Proposal> = pool.into_values().flatten().collect();
        ranked.sort_by(|a, b| b.log.total_cmp(&a.log));
        ranked
    }

    /// The best spec of each candidate, the best candidate first.
    fn top(&self, scored: &[Option<Scored>]) -> Vec<usize> {
        let mut order: Vec<usize> =
            (0..scored.len()).filter(|s| scored[*s].as_ref().is_some_and(|s| s.score.is_finite())).collect();
        let score = |s: usize| scored[s].as_ref().map_or(f64::NEG_INFINITY, |s| s.score);
        order.sort_by(|a, b| score(*b).total_cmp(&score(*a)).then(a.cmp(b)));
        let mut seen = Vec::new();
        order.retain(|s| {
            let own = self.specs[*s].direction;
            let new = !seen.contains(&own);
            seen.push(own);
            new
        });
        order
    }

    /// The best pairs of some specs of one column.
    fn pairs(&self, few: &[usize], scored: &[Option<Scored>], weights: &[f64]) -> Vec<Vec<usize>> {
        let single = |s: &usize| Some((*s, scored[*s].as_ref()?.score, scored[*s].as_ref()?.beside.as_ref()?));
        let few: Vec<(usize, f64, &Beside)> = few.iter().filter_map(single).collect();
        let list: Vec<(usize, usize)> = (0..few.len()).flat_map(|i| (0..i).map(move |j| (i, j))).collect();
        let of = |(i, j): (usize, usize)| -> Option<(f64, Vec<usize>)> {
            let ((s, score, a), (t, other, b)) = (few[i], few[j]);
            let h = self.crossed(weights, (self.specs[s].columns[0], a), (self.specs[t].columns[0], b));
            let determinant = a.square * b.square - h * h;
            if determinant <= APART * a.square * b.square {
                return None;
            }
            let (g, k) = (a.cross, b.cross);
            let gain = 0.5 * (g * g * b.square + k * k * a.square - 2.0 * g * k * h) / determinant;
            let base = score - 0.5 * g * g / a.square + other - 0.5 * k * k / b.square;
            Some((gain + base, vec![s.min(t), s.max(t)]))
        };
        let mut found: Vec<(f64, Vec<usize>)> = parallel::map(list, of).into_iter().flatten().collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        found.into_iter().take(PAIRS).map(|(_, set)| set).collect()
    }

    /// A state with the specs of a proposal at the amounts that the first order says, or at less where that fits worse.
    pub(crate) fn begun(&self, proposal: &Proposal) -> Option<State> {
        let mut best: Option<(f64, State)> = None;
        for part in [1.0, 0.4, 0.1, 0.0] {
            let Some(state) = self.at(proposal, part) else { continue };
            // a limit begins where it is, whatever the part
            if best.as_ref().is_some_and(|(_, best)| best.theta == state.theta) {
                continue;
            }
            let cost = self.ground.weighted(&state, &proposal.weights);
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, state));
            }
        }
        let (_, mut state) = best.filter(|(cost, _)| cost.is_finite())?;
        let added = state.effects.len() - proposal.specs.len();
        for (k, spec) in proposal.specs.iter().enumerate() {
            let point = self.point(&self.specs[*spec], 0);
            if !self.directions[self.specs[*spec].direction].attached.params()[point.lead].null.is_finite() {
                self.limit(&mut state, (added + k, point.lead), &proposal.weights);
            }
        }
        Some(state)
    }

    /// Sets a limit where errors are least (golden section): from below, as nothing changes any more where it is too wide.
    fn limit(&self, state: &mut State, (effect, param): (usize, usize), weights: &[f64]) {
        let at = state.effects[effect].at[param];
        let (begun, upper) = (state.theta[0][at], state.text.model.definition().params[at].upper);
        let mut cost = |value: f64| {
            state.theta.iter_mut().for_each(|theta| theta[at] = value);
            self.ground.weighted(state, weights)
        };
        let mut best = (cost(begun), begun);
        let (mut low, mut high) = (0.5 * begun, upper.min(4.0 * begun));
        let inner = |low: f64, high: f64| (low + GOLDEN * (high - low), high - GOLDEN * (high - low));
        let (a, b) = inner(low, high);
        let (mut a, mut b) = ((cost(a), a), (cost(b), b));
        for _ in 0..LIMIT_STEPS {
            best = [best, a, b].into_iter().min_by(|x, y| x.0.total_cmp(&y.0)).unwrap_or(best);
            if a.0 <= b.0 {
                high = b.1;
                b = a;
                let next = inner(low, high).0;
                a = (cost(next), next);
            } else {
                low = a.1;
                a = b;
                let next = inner(low, high).1;
                b = (cost(next), next);
            }
        }
        cost(best.1);
    }

    fn at(&self, proposal: &Proposal, part: f64) -> Option<State> {
        let runs = self.ground.runs;
        let mut state: Option<(State, FittedModel)> = None;
        for (s, amounts) in proposal.specs.iter().zip(&proposal.amounts) {
            let spec = &self.specs[*s];
            let found = &self.directions[spec.direction];
            let params = found.attached.params();
            let mut values = self.point(spec, 0).values.clone();
            for (k, amount) in amounts.iter().enumerate() {
                let point = self.point(spec, k);
                let lead = point.lead;
                let value = if point.is_linear() {
                    params[lead].null + part * amount
                } else if params[lead].null.is_finite() {
                    let multiple = if part == 1.0 {
                        *amount
                    } else if part == 0.4 {
                        1.0
                    } else {
                        (part * 3.0 * amount).max(0.1)
                    };
                    params[lead].null + multiple * (point.values[lead] - params[lead].null)
                } else {
                    point.values[lead]
                };
                values[lead] = value.clamp(params[lead].lower, params[lead].upper);
            }
            let next = match &state {
                None => {
                    self.state.with(&found.attached, (&self.fitted, &self.scales), &values, &found.predictors, runs)?
                }
                Some((before, fitted)) => {
                    let scales = SignalScales::new(fitted, runs);
                    let choice = fdm_effects::Choice::new();
                    let candidate = &found.attached.candidate;
                    let attached =
                        crate::candidates::extended_model::AttachedEffect::new(candidate, fitted, &scales, &choice)
                            .ok()?;
                    before.with(&attached, (fitted, &scales), &values, &found.predictors, runs)?
                }
            };
            let fitted = if proposal.specs.len() > 1 { next.fitted(runs)? } else { self.fitted.clone() };
            state = Some((next, fitted));
        }
        state.map(|(state, _)| state)
    }

    /// Candidates of which hardly anything is left beside what is fitted: they may be there, and nobody would see them.
    pub(crate) fn hidden(&self) -> Vec<EffectAt> {
        let precision = self.ground.precision(self.state);
        let weights = &self.judged.evidence.weights;
        let Some(screen) = Screen::new(&self.judged.linear.grams, weights, &precision) else { return Vec::new() };
        let left = parallel::map(self.borders.iter(), |border| screen.beside(border).map_or(0.0, |b| b.left));
        let mut most = vec![0.0_f64; self.directions.len()];
        for spec in &self.specs {
            let own = spec.columns.iter().map(|c| left[*c]).fold(0.0, f64::max);
            most[spec.direction] = most[spec.direction].max(own);
        }
        let hidden = self.directions.iter().zip(most).filter(|(_, left)| *left < HIDDEN);
        hidden.map(|(d, _)| place(&d.attached.candidate)).collect()
    }

    /// The candidate of a spec, by its directions, and whether it is finite.
    pub(crate) fn candidate(&self, spec: usize) -> (usize, bool) {
        let spec = &self.specs[spec];
        (spec.direction, !self.point(spec, 0).is_linear())
    }
}

struct Linearised<'j> {
    grams: &'j Grams,
    own: &'j [Vec<Vec<f64>>],
}

impl<'j> Linearised<'j> {
    fn of(judged: &'j Judged) -> Self {
        Self { grams: &judged.linear.grams, own: &judged.linear.columns }
    }
}
