//! A coefficient that depends on a signal, as a smooth table in the model's text: "CLa*alpha is not linear above alpha = 0.19 rad".
//!
//! Every coefficient of the text is tried as a broken line over the signals that it is multiplied by, and over the others where these are few. All are
//! fitted by one noise; the chance of the best counts them all. What holds is fitted once more as a cubic table that is as smooth as the data want
//! it (marginal likelihood). Its effective number of parameters is what it costs; its nodes with their covariance say where the coefficient is no
//! constant any more. It is a stand-in: what bends there has no name yet.

use super::assessment::run_gains;
use super::coefficient_text::{CoefficientText, CurveNodes, Dependence, TextSignal, shown};
use super::elimination::Accepted;
use super::fitted_model::{FittedModel, shared_from, split_fit_within};
use super::forward_step::{PENALTY, prior};
use super::front::FrontProblem;
use super::initial_fit::{Thoroughness, plain_fit_told};
use super::law_curve::LawModel;
use super::written_model::at_values;
use crate::diagnosis::{CoefficientTable, EffectAt};
use fdm_effects::NewParam;
use fdm_estimate::{Estimate, ParameterEstimate};
use fdm_grammar::model::Param;
use fdm_grammar::syntax::Class;
use fdm_numeric::parallel;
use fdm_numeric::statistics::chi_squared_tail;
use fdm_system::model::Model;
use fdm_system::simulate::Simulator;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeSet;

/// Most dependences that are tried: as many places as an effect of another field may have.
const MOST: usize = 60;
/// Nodes of the broken line that is tried, and of the table that is written.
const TRIED: usize = 5;
const WRITTEN: usize = 17;
/// Iterations of a trial, and what one must gain in log-likelihood to be made.
const TRIAL: (usize, f64) = (20, 0.1);
/// Trials that are written as tables: at most so many, by no more than this far behind the best.
const LEADERS: usize = 3;
const BEHIND: f64 = 15.0;
/// Part of its largest magnitude by which a signal must move.
const STILL: f64 = 1e-6;
/// Least score, as of an effect.
const LEAST: f64 = 3.0;
/// Standard errors within which a node is no other than the mean of its neighbours, and the part of that mean which is of no consequence: a spline
/// through a bend is off by some per cent beside it, whatever the errors.
const ALIKE: (f64, f64) = (2.0, 0.05);
/// Points between nodes at which a curve is compared with a constant.
const BETWEEN: usize = 64;
/// Variance of a node that the data do not determine.
const UNKNOWN: f64 = 1e200;
/// Digits of a place in a sentence.
const DIGITS: usize = 3;

/// A table in a model's text, fitted.
pub(super) struct TableModel {
    /// As any curve of a front.
    pub(super) curve: LawModel,
    pub(super) found: CoefficientTable,
    /// Gains on all runs less penalties, beside the model that it was tried in.
    pub(super) score: f64,
    /// Estimates of its plain fit.
    estimates: Vec<ParameterEstimate>,
}

impl TableModel {
    /// That an effect beside which the table stands says nothing any more, in a sentence: the table has taken its place, and what is
    /// left of it may have any value.
    pub(super) fn superseded(&self, effect: &Accepted) -> Option<String> {
        let own = effect.params.iter().filter(|p| !p.fixed && !p.nuisance && p.begins_as.is_none());
        let of = |p: &NewParam| self.estimates.iter().find(|e| e.name == p.name).map(|e| (p.null, e));
        let (null, lost) = own
            .filter_map(of)
            .find(|(null, e)| e.error().is_none_or(|error| (e.value - null).abs() <= ALIKE.0 * error))?;
        let (place, name) = (&effect.cause.place, &lost.name);
        Some(format!(
            "beside the table {place} is not determined: {name} is within {:.0} standard errors of {null}",
            ALIKE.0
        ))
    }
}

/// A signal and its values in the training runs.
struct Moving {
    signal: TextSignal,
    /// Rising.
    values: Vec<f64>,
}

impl Moving {
    fn range(&self) -> (f64, f64) {
        (self.values.first().copied().unwrap_or(0.0), self.values.last().copied().unwrap_or(0.0))
    }

    /// Even places over all values.
    fn places(&self, count: usize) -> Vec<f64> {
        let (low, high) = self.range();
        (0..count).map(|k| low + (high - low) * k as f64 / (count - 1) as f64).collect()
    }

    /// Samples from one value to another.
    fn samples(&self, from: f64, to: f64) -> usize {
        self.values.partition_point(|v| *v <= to).saturating_sub(self.values.partition_point(|v| *v < from))
    }
}

/// A model in which a coefficient is a table, at the values of the model without.
struct Tabulated {
    model: FittedModel,
    table: String,
    nodes: Vec<String>,
}

/// A dependence as a broken line, fitted.
struct Trial {
    pair: Dependence,
    /// In log-likelihood, on the training runs.
    gain: f64,
    line: Tabulated,
    /// All parameters of each run.
    theta: Vec<Vec<f64>>,
}

impl Trial {
    /// All parameters of each run of a model with more nodes, where the broken line is; what it does not know as it is there.
    fn starts(&self, other: &Tabulated) -> Vec<Vec<f64>> {
        let params = &self.line.model.model.definition().params;
        let place = |name: &str| params.iter().position(|p| p.quantity.name == name);
        let line: Vec<usize> = self.line.nodes.iter().filter_map(|node| place(node)).collect();
        let of = |(own, theirs): (&Vec<f64>, &Vec<f64>)| -> Vec<f64> {
            let along = |k: usize| {
                let at = k as f64 * (line.len() - 1) as f64 / (other.nodes.len() - 1) as f64;
                let cell = (at as usize).min(line.len() - 2);
                own[line[cell]] + (at - cell as f64) * (own[line[cell + 1]] - own[line[cell]])
            };
            let each = other.model.params().iter().zip(theirs);
            let one = |(p, theirs): (&Param, &f64)| {
                let name = &p.quantity.name;
                match other.nodes.iter().position(|node| node == name) {
                    Some(node) => along(node),
                    None => place(name).map_or(*theirs, |k| own[k]),
                }
            };
            each.map(one).collect()
        };
        self.theta.iter().zip(&other.model.theta).map(of).collect()
    }
}

impl FrontProblem<'_> {
    /// The likeliest table in a model at its plain fit; none where no coefficient depends on anything.
    pub(super) fn table_in(&self, current: &FittedModel) -> Option<TableModel> {
        let text = CoefficientText::new(&current.subject)?;
        let moving = self.moving(current, &text);
        let names: Vec<String> = moving.iter().map(|m| m.signal.name.clone()).collect();
        let pairs = text.dependences(&free(current.params()), &names, MOST);
        let own = split_fit_within(current, self.runs, self.noise, TRIAL).ok()?.fitting.cost;
        let trial = |pair: Dependence| -> Option<Trial> {
            let signal = moving.iter().find(|m| m.signal.name == pair.signal).filter(|_| self.work.goes_on())?;
            let line = self.tabulated(current, (&text, &pair, signal), TRIED, "linear")?;
            let fit = split_fit_within(&line.model, self.runs, self.noise, TRIAL).ok()?;
            Some(Trial { pair, gain: own - fit.fitting.cost, line, theta: fit.theta })
        };
        let mut trials: Vec<Trial> = parallel::filter_map(pairs, trial);
        trials.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let (count, most) = (trials.len() as f64, trials.first()?.gain);
        let chance =
            |gain: f64| chi_squared_tail(2.0 * gain.max(0.0), (TRIED - 1) as f64).map(|p| (count * p).min(1.0));
        let leaders = trials.into_iter().filter(|t| t.gain > most - BEHIND).take(LEADERS);
        let tables = leaders.filter_map(|trial| {
            let p = chance(trial.gain).filter(|p| *p < self.options.alpha && self.work.goes_on())?;
            let signal = moving.iter().find(|m| m.signal.name == trial.pair.signal)?;
            self.table(current, (&text, &trial, signal), p)
        });
        tables.max_by(|a, b| a.score.total_cmp(&b.score))
    }

    /// Signals that move in the training runs, with their values.
    fn moving(&self, current: &FittedModel, text: &CoefficientText<'_>) -> Vec<Moving> {
        let signals = text.signals();
        let names: Vec<&str> = signals.iter().map(|s| s.name.as_str()).collect();
        let model = text.showing(&names).and_then(|source| Model::from_source(source).ok());
        let Some(model) = model.filter(|m| m.definition().params.len() == current.params().len()) else {
            return Vec::new();
        };
        let outputs: Vec<&str> = model.definition().outputs.iter().map(|o| o.quantity.name.as_str()).collect();
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); signals.len()];
        let runs = self.runs.train().iter().zip(current.theta.iter().zip(&current.predictors));
        for (run, (theta, predictor)) in runs {
            let Some(steps) = predictor.steps() else { continue };
            let Ok(mut simulator) = Simulator::new(model.dynamics(), run, steps.clone()) else { continue };
            let mut y = vec![f64::NAN; run.len() * outputs.len()];
            // what comes before a divergence is kept
            let _ = simulator.simulate(theta, &mut y);
            for (k, values) in values.iter_mut().enumerate() {
                let Some(column) = outputs.iter().position(|name| *name == shown(k)) else { continue };
                values.extend(y.iter().skip(column).step_by(outputs.len()).filter(|v| v.is_finite()));
            }
        }
        let of = |(signal, mut values): (TextSignal, Vec<f64>)| {
            values.sort_by(f64::total_cmp);
            let moving = Moving { signal, values };
            let (low, high) = moving.range();
            // nodes that no sample is near, as between the levels of an input, are left to chance, and their smoothness is sought for minutes
            let visited = |cell: &[f64]| moving.samples(cell[0], cell[1]) > 0;
            let moves = high - low > STILL * low.abs().max(high.abs());
            (moves && moving.places(WRITTEN).windows(2).all(visited)).then_some(moving)
        };
        signals.into_iter().zip(values).filter_map(of).collect()
    }

    /// The model with a table in its text, at its own values.
    fn tabulated(
        &self,
        current: &FittedModel,
        (text, pair, moving): (&CoefficientText<'_>, &Dependence, &Moving),
        count: usize,
        method: &str,
    ) -> Option<Tabulated> {
        let value = current.theta.first()?[current.model.definition().param(&pair.coefficient)?];
        let nodes = CurveNodes { at: moving.places(count), values: vec![value; count] };
        let written = text.tabulated(pair, &moving.signal, &nodes, method)?;
        let model = Model::from_source(written.source).ok()?;
        let known = |name: &str| current.model.definition().param(name);
        // what is free and fixed there is so here
        let of = |p: &Param| match known(&p.quantity.name) {
            Some(k) => Param { origin: p.origin, ..current.params()[k].clone() },
            None => p.clone(),
        };
        let params: Vec<Param> = model.definition().params.iter().map(of).collect();
        let at = |own: &Vec<f64>| -> Vec<f64> {
            let one = |p: &Param| match known(&p.quantity.name) {
                Some(k) => own[k],
                None if written.nodes.contains(&p.quantity.name) => value,
                None => p.value,
            };
            params.iter().map(one).collect()
        };
        let theta: Vec<Vec<f64>> = current.theta.iter().map(at).collect();
        let theta = shared_from(&params, &theta.first()?.clone(), &theta);
        let model = FittedModel::new(model.with_params(params), self.runs, theta).ok()?;
        Some(Tabulated { model, table: written.table, nodes: written.nodes })
    }

    /// The smooth table of a dependence, fitted plainly and written; none where it is worth less than it costs.
    fn table(
        &self,
        current: &FittedModel,
        (text, trial, moving): (&CoefficientText<'_>, &Trial, &Moving),
        p: f64,
    ) -> Option<TableModel> {
        let pair = &trial.pair;
        let tabulated = self.tabulated(current, (text, pair, moving), WRITTEN, "cubic")?;
        let starts = trial.starts(&tabulated);
        let asked = (self.options, self.work);
        // a table that is not found from the broken line's fit is worth no fallback strategies: they take minutes
        let (fitted, estimate) =
            plain_fit_told(&tabulated.model, &starts, self.runs, asked, Thoroughness::Once).ok()?;
        let written = at_values(&tabulated.model, &fitted.theta, &self.first.response, self.runs)?;
        let effective = estimate.smoothing.iter().find(|s| s.table == tabulated.table)?.effective_parameters;
        let (all, train) = (self.runs.all, self.runs.train);
        let responses = (&current.response[..], &written.fitted.response[..]);
        let gains = run_gains(all, train, &current.predictors, responses, self.noise);
        let gained =
            |validation: bool| gains.iter().filter(|g| g.validation == validation).map(|g| g.gain).sum::<f64>();
        let gain_validation = (train < all.len()).then(|| gained(true));
        let score = gained(false) + gain_validation.unwrap_or(0.0)
            - PENALTY * (effective - 1.0).max(0.0)
            - prior(Class::StandIn);
        if !(score > LEAST && gain_validation.is_none_or(|gain| gain > 0.0)) {
            return None;
        }
        let curve = Curve::new(&estimate, &tabulated.nodes, moving.places(WRITTEN))?;
        let constant = curve.constant(moving);
        let mut found = CoefficientTable {
            coefficient: pair.coefficient.clone(),
            signal: pair.signal.clone(),
            signal_unit: moving.signal.unit.clone(),
            constant_from: constant.and_then(|c| c.from),
            constant_to: constant.and_then(|c| c.to),
            effective_parameters: effective,
            gain_training: gained(false),
            gain_validation,
            p,
            sentence: String::new(),
        };
        found.sentence = sentence(&found, pair.is_product, &curve);
        let place = EffectAt {
            effect: "coefficient_table".into(),
            targets: vec![pair.coefficient.clone(), pair.signal.clone()],
        };
        let curve = LawModel { place, parameters: WRITTEN - 1, current: tabulated.model, written };
        Some(TableModel { curve, found, score, estimates: estimate.parameters })
    }
}

/// Names of params that are free and the same in all runs.
fn free(params: &[Param]) -> BTreeSet<String> {
    params.iter().filter(|p| !p.fixed && !p.per_run).map(|p| p.quantity.name.clone()).collect()
}

/// Nodes of a table at its estimates.
struct Curve {
    at: Vec<f64>,
    values: DVector<f64>,
    covariance: DMatrix<f64>,
}

/// From where to where a coefficient is constant; none where that is as far as it was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Constant {
    from: Option<f64>,
    to: Option<f64>,
}

impl Curve {
    fn new(estimate: &Estimate, nodes: &[String], at: Vec<f64>) -> Option<Self> {
        let place = |name: &String| estimate.parameters.iter().position(|p| p.name == *name);
        let places: Vec<usize> = nodes.iter().map(place).collect::<Option<_>>()?;
        let values = DVector::from_iterator(nodes.len(), places.iter().map(|k| estimate.parameters[*k].value));
        let rows: Vec<Option<usize>> =
            places.iter().map(|k| estimate.covered.iter().position(|covered| covered == k)).collect();
        let covariance = DMatrix::from_fn(nodes.len(), nodes.len(), |i, j| match (rows[i], rows[j]) {
            (Some(a), Some(b)) => estimate.covariance.at(a, b),
            _ if i == j => UNKNOWN,
            _ => 0.0,
        });
        Some(Self { at, values, covariance })
    }

    /// Whether a straight line between nodes is another value than the mean of nodes `first` to `last`, at a part of the way behind a node.
    fn differs(&self, (first, last): (usize, usize), node: usize, part: f64) -> bool {
        let own = |k: usize| match (first..=last).contains(&k) {
            true => 1.0 / self.covariance[(k, k)].max(f64::MIN_POSITIVE),
            false => 0.0,
        };
        let sum: f64 = (first..=last).map(own).sum();
        let mean = (first..=last).map(|k| own(k) / sum * self.values[k]).sum::<f64>();
        let here = |k: usize| match k {
            k if k == node => 1.0 - part,
            k if k == node + 1 => part,
            _ => 0.0,
        };
        let contrast = DVector::from_fn(self.at.len(), |k, _| here(k) - own(k) / sum);
        let (off, variance) = (contrast.dot(&self.values), contrast.dot(&(&self.covariance * &contrast)));
        off.abs() > ALIKE.0 * variance.max(0.0).sqrt() && off.abs() > ALIKE.1 * mean.abs()
    }

    /// Of the neighbours that are alike those that hold most samples; none where these are fewer than half of all, or all nodes.
    fn constant(&self, moving: &Moving) -> Option<Constant> {
        let last = self.at.len() - 1;
        let alike = |run: (usize, usize)| (run.0..=run.1).all(|k| !self.differs(run, k, 0.0));
        let runs = (0..last).flat_map(|i| (i + 1..=last).map(move |j| (i, j))).filter(|run| alike(*run));
        let held = |run: &(usize, usize)| (moving.samples(self.at[run.0], self.at[run.1]), run.1 - run.0);
        let run = runs.max_by(|a, b| held(a).cmp(&held(b)).then(b.0.cmp(&a.0)))?;
        if run == (0, last) || 2 * held(&run).0 < moving.values.len() {
            return None;
        }
        // where the line to the first node that is another one leaves the constant
        let leaves = |node: usize, up: bool| {
            let part = |k: usize| k as f64 / BETWEEN as f64;
            let cell = if up { node } else { node - 1 };
            let along = |k: usize| if up { part(k) } else { 1.0 - part(k) };
            let found = (0..=BETWEEN).map(along).find(|part| self.differs(run, cell, *part));
            let part = found.unwrap_or(if up { 1.0 } else { 0.0 });
            self.at[cell] + part * (self.at[cell + 1] - self.at[cell])
        };
        let from = (run.0 > 0).then(|| leaves(run.0, false));
        let to = (run.1 < last).then(|| leaves(run.1, true));
        Some(Constant { from, to })
    }
}

/// What was found, in words.
fn sentence(found: &CoefficientTable, is_product: bool, curve: &Curve) -> String {
    let CoefficientTable { coefficient, signal, signal_unit, .. } = found;
    let short = |v: f64| super::law_curve::number(v, DIGITS);
    let place = |v: f64| match signal_unit.as_deref() {
        Some("rad") => format!("{} rad ({} deg)", short(v), short(v.to_degrees())),
        Some(unit) if unit != "1" => format!("{} {unit}", short(v)),
        _ => short(v),
    };
    let what = if is_product {
        format!("{coefficient}*{signal} is not linear")
    } else {
        format!("{coefficient} is not constant")
    };
    let last = curve.at.len() - 1;
    let what = match (found.constant_from, found.constant_to) {
        (Some(from), None) => format!("{what} below {signal} = {}", place(from)),
        (None, Some(to)) => format!("{what} above {signal} = {}", place(to)),
        (Some(from), Some(to)) => format!("{what} outside of {signal} = {} to {}", place(from), place(to)),
        (None, None) => {
            let (low, high) = (short(curve.values[0]), short(curve.values[last]));
            format!(
                "{coefficient} depends on {signal}: it goes from {low} at {} to {high} at {}",
                place(curve.at[0]),
                place(curve.at[last])
            )
        }
    };
    let validation = found.gain_validation.map_or(String::new(), |g| format!(", {g:.1} on the validation runs"));
    format!(
        "{what}: table with {:.1} effective parameters, gain in log-likelihood {:.1} on the fitted runs{validation}",
        found.effective_parameters, found.gain_training
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(values: &[f64], deviation: f64) -> Curve {
        let count = values.len();
        let at = (0..count).map(|k| k as f64).collect();
        let covariance = DMatrix::from_diagonal_element(count, count, deviation * deviation);
        Curve { at, values: DVector::from_row_slice(values), covariance }
    }

    fn moving(from: f64, to: f64) -> Moving {
        let values = (0..1001).map(|k| from + (to - from) * f64::from(k) / 1000.0).collect();
        Moving { signal: TextSignal { name: "z".into(), unit: None }, values }
    }

    #[test]
    fn a_curve_leaves_its_constant_where_the_errors_say_so() {
        let all = moving(0.0, 5.0);
        let bent = curve(&[1.0, 1.01, 0.99, 1.0, 0.5, 0.0], 0.02).constant(&all).unwrap();
        assert_eq!(bent.from, None);
        // a twentieth of 1, of 0.5 from node to node
        let to = bent.to.unwrap();
        assert!((3.0..3.15).contains(&to), "{to}");
        let both = curve(&[3.0, 1.0, 1.0, 1.0, 1.0, 0.0], 0.02).constant(&all).unwrap();
        assert!((0.95..1.0).contains(&both.from.unwrap()) && (4.0..4.1).contains(&both.to.unwrap()), "{both:?}");
        // two nodes of a ripple that are alike by chance
        assert_eq!(curve(&[0.0, 1.0, 0.2, 0.21, 1.0, 0.0], 0.02).constant(&all), None);
        assert_eq!(curve(&[0.0, 1.0, 2.0, 3.0], 0.02).constant(&moving(0.0, 3.0)), None);
        assert_eq!(curve(&[1.0, 1.01, 0.99], 0.1).constant(&moving(0.0, 2.0)), None);
        // what few samples have seen decides least
        let seen = curve(&[1.0, 1.0, 1.0, 0.0, 0.0], 0.02).constant(&moving(2.8, 4.0)).unwrap();
        assert!(seen.from.is_some() && seen.to.is_none(), "{seen:?}");
    }

    #[test]
    fn places_are_told_in_degrees_too() {
        let mut found = CoefficientTable {
            coefficient: "CLa".into(),
            signal: "alpha".into(),
            signal_unit: Some("rad".into()),
            constant_from: None,
            constant_to: Some(0.192),
            effective_parameters: 4.2,
            gain_training: 120.3,
            gain_validation: Some(38.0),
            p: 1e-9,
            sentence: String::new(),
        };
        let curve = curve(&[5.0, 2.0], 0.1);
        assert_eq!(
            sentence(&found, true, &curve),
            "CLa*alpha is not linear above alpha = 0.192 rad (11 deg): table with 4.2 effective parameters, gain in log-likelihood 120.3 \
             on the fitted runs, 38.0 on the validation runs"
        );
        (found.constant_to, found.signal_unit, found.gain_validation) = (None, None, None);
        assert!(
            sentence(&found, false, &curve).starts_with("CLa depends on alpha: it goes from 5 at 0 to 2 at 1: table")
        );
    }
}
