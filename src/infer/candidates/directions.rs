//! What an effect would add to the responses: one direction for each value that its parameters are tried at.
//!
//! A smooth effect is differentiated at its null, exactly; a finite one is simulated at each trial and compared with the null. One
//! extended program serves all points of a candidate, and no text is written for any of them.
//!
//! What an effect adds in the frequency domain: the derivative of the response at the null, or its difference from the null; exact, and
//! nothing is integrated.

use crate::bins::{MeasuredRows, Signals};
use crate::candidates::extended_model::{AttachedEffect, SignalScales};
use crate::candidates::fitted_model::FittedModel;
use crate::candidates::predictor::Predictor;
use crate::candidates::runs::{Domain, Runs};
use fdm_effects::{Candidate, Choice, Kind, NewParam};
use fdm_estimate::{BinResponse, Response, SpectralBins, SpectralOptions};
use fdm_grammar::Schedule;
use fdm_grammar::graph::Leaf;
use fdm_system::code::{Engine, compile};
use fdm_system::dynamics::Dynamics;
use fdm_system::record::Run;
use fdm_system::simulate::{Scheme, Simulator, Steps};
use std::sync::Arc;

/// How a direction depends on the size of its effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    /// In proportion, of either sign: a derivative at the null value.
    Linear,
    /// In proportion, where the null is the least value that there can be: a friction is none below zero.
    Rising,
    /// The whole difference that this size makes.
    Finite,
    /// Linear together with the candidate's other directions of the same group: two or more parameters at once.
    Joint {
        /// Which of the candidate's groups.
        group: usize,
    },
}

/// Most points of a candidate.
const MOST_POINTS: usize = 120;
/// Part of a direction by which halving the steps may move it.
pub(crate) const ACCURATE: f64 = 0.02;
/// Steps of all points over all runs from which machine code saves time.
const LONG: usize = 10_000;
/// Times that steps are halved.
pub(crate) const MOST_HALVINGS: usize = 3;

/// A candidate's directions.
pub(crate) struct CandidateDirections {
    /// The effect in the model.
    pub(crate) attached: AttachedEffect,
    /// Where it was tried.
    pub(crate) points: Vec<TrialPoint>,
    /// What it adds there to each run (points by runs), at the rows at which something was measured.
    pub(crate) signals: Vec<Vec<Signals>>,
    /// How each run was answered, those that are for validation too.
    pub(crate) predictors: Vec<Predictor>,
}

/// Values of the new parameters.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TrialPoint {
    /// One for each new parameter.
    pub(crate) values: Vec<f64>,
    /// The one that is the effect's size here.
    pub(crate) lead: usize,
    /// How the direction scales.
    pub(crate) shape: Shape,
}

impl TrialPoint {
    /// Whether the direction is a derivative at the null.
    pub(crate) fn is_linear(&self) -> bool {
        matches!(self.shape, Shape::Linear | Shape::Rising | Shape::Joint { .. })
    }
}

/// A candidate in the model, and all points at which it is tried.
///
/// # Errors
/// Why it is left out, in words.
pub(crate) fn attached(
    candidate: &Candidate,
    current: &FittedModel,
    runs: Runs<'_>,
    scales: &SignalScales,
) -> Result<(AttachedEffect, Vec<TrialPoint>), String> {
    let attached = AttachedEffect::new(candidate, current, scales, &Choice::new())?;
    if !runs.train().iter().all(|run| attached.takes(run)) {
        return Err("it needs records that the runs do not have".into());
    }
    let points = points(&attached);
    if points.is_empty() {
        return Err("the records leave no value to try".into());
    }
    Ok((attached, points))
}

/// Simulates a candidate at all its points.
///
/// # Errors
/// Why it is left out, in words.
pub(crate) fn candidate_directions(
    (attached, points): (AttachedEffect, Vec<TrialPoint>),
    current: &FittedModel,
    runs: Runs<'_>,
) -> Result<CandidateDirections, String> {
    if let Domain::Frequency(options) = runs.domain {
        let (points, signals, predictors) = directions_in_bins(&attached, points, current, runs, options)?;
        return Ok(CandidateDirections { attached, points, signals, predictors });
    }
    let mut definition = attached.definition.clone();
    let differentiated = |k: usize| points.iter().any(|p| p.is_linear() && p.lead == k);
    definition.params.iter_mut().for_each(|p| p.fixed = true);
    for (k, at) in attached.new.iter().enumerate() {
        definition.params[*at].fixed = !differentiated(k);
    }
    let steps: Vec<Steps> = current.predictors.iter().filter_map(|predictor| predictor.steps().cloned()).collect();
    let whole: usize = steps.iter().zip(runs.train()).map(|(steps, run)| steps.total(run.len())).sum();
    let engine = if whole * points.len() < LONG { Engine::Tape } else { Engine::Jit };
    let dynamics = compile(&Schedule::new(&mut definition), engine);
    let simulation =
        CandidateSimulation { current, own: &steps, runs: runs.train(), attached: &attached, dynamics: &*dynamics };
    let (points, signals, steps) = simulation.signals(points)?;
    Ok(CandidateDirections { attached, points, signals, predictors: steps.into_iter().map(Predictor::Steps).collect() })
}

/// All combinations of trials.
fn points(attached: &AttachedEffect) -> Vec<TrialPoint> {
    let params = attached.params();
    let nulls: Vec<f64> = params.iter().map(|p| p.null).collect();
    let mut grids = vec![nulls];
    for (k, param) in params.iter().enumerate().filter(|(_, p)| p.nuisance && p.begins_as.is_none()) {
        let tried: Vec<f64> =
            param.trials.iter().copied().filter(|v| (param.lower..=param.upper).contains(v)).collect();
        let with = |values: &Vec<f64>, v: f64| {
            let mut values = values.clone();
            values[k] = v;
            values
        };
        if !tried.is_empty() {
            grids = grids.iter().flat_map(|values| tried.iter().map(|v| with(values, *v))).collect();
        }
    }
    let mut points = Vec::new();
    for (group, values) in grids.iter().enumerate() {
        points.extend(sizes(attached, values, group));
    }
    points.truncate(MOST_POINTS);
    points
}

/// The points that share the values of the nuisances; several smooth parameters are scored together.
fn sizes(attached: &AttachedEffect, values: &[f64], group: usize) -> Vec<TrialPoint> {
    let params = attached.params();
    if attached.candidate.kind() == Kind::Smooth {
        let own: Vec<usize> = (0..params.len()).filter(|k| !params[*k].nuisance).collect();
        let shape = match own[..] {
            [only] if params[only].lower >= params[only].null => Shape::Rising,
            [_] => Shape::Linear,
            _ => Shape::Joint { group },
        };
        return own.into_iter().map(|lead| TrialPoint { values: values.to_vec(), lead, shape }).collect();
    }
    let lead = attached.size();
    let NewParam { null, lower, upper, ref trials, .. } = params[lead];
    let mut tried: Vec<f64> =
        trials.iter().copied().filter(|v| v.is_finite() && *v != null && (lower..=upper).contains(v)).collect();
    // the weakest first
    let strength = |v: f64| if null.is_finite() { (v - null).abs() } else { -v };
    tried.sort_by(|a, b| strength(*a).total_cmp(&strength(*b)));
    tried.dedup();
    let others = |v: f64| {
        let mut values = values.to_vec();
        // what else the effect has acts as in its text
        for (k, p) in params.iter().enumerate().filter(|(k, p)| *k != lead && !p.nuisance) {
            values[k] = p.start;
        }
        values[lead] = v;
        values
    };
    tried.iter().map(|v| TrialPoint { values: others(*v), lead, shape: Shape::Finite }).collect()
}

/// Simulates the points of one candidate.
struct CandidateSimulation<'a> {
    current: &'a FittedModel,
    /// The steps of the current model.
    own: &'a [Steps],
    runs: &'a [Run],
    attached: &'a AttachedEffect,
    dynamics: &'a dyn Dynamics,
}

type Found = (Vec<TrialPoint>, Vec<Vec<Signals>>, Vec<Steps>);

impl CandidateSimulation<'_> {
    fn signals(&self, points: Vec<TrialPoint>) -> Result<Found, String> {
        let (level, first) =
            self.settled(&points).ok_or("the extended model has no response at any value that is tried")?;
        // those of validation runs too, for the fits
        let steps: Vec<Steps> = (0..self.own.len()).map(|r| self.steps(r, level)).collect();
        let mut simulations = vec![first];
        for (r, steps) in steps.iter().enumerate().take(self.runs.len()).skip(1) {
            simulations.push(self.run(r, steps).ok_or("the extended model cannot be simulated over these runs")?);
        }
        let (kept, signals) =
            kept(points, |point| simulations.iter_mut().map(|simulation| simulation.direction(point)).collect());
        if kept.is_empty() { Err("it changes nothing in these runs".into()) } else { Ok((kept, signals, steps)) }
    }

    /// How often steps are halved, by the first run: until that moves the outermost points no more. The first run with these steps, and
    /// what those points add to it.
    fn settled(&self, points: &[TrialPoint]) -> Option<(usize, RunSimulation<'_>)> {
        let outer = if points.len() > 1 { vec![&points[0], &points[points.len() - 1]] } else { vec![&points[0]] };
        let at = |level: usize| -> Option<RunSimulation<'_>> {
            let mut simulation = self.run(0, &self.steps(0, level))?;
            simulation.known = outer.iter().map(|p| ((*p).clone(), simulation.direction(p))).collect();
            Some(simulation)
        };
        let responds = |simulation: &RunSimulation<'_>| simulation.known.iter().any(|(_, found)| found.is_some());
        let mut coarse = at(0)?;
        if self.is_exact() {
            return responds(&coarse).then_some((0, coarse));
        }
        for level in 0..MOST_HALVINGS {
            let fine = at(level + 1)?;
            let settled = |((_, a), (_, b)): (&Known, &Known)| match (a, b) {
                (Some(a), Some(b)) => difference(a, b) <= ACCURATE,
                (None, None) => level > 1,
                _ => false,
            };
            if coarse.known.iter().zip(&fine.known).all(settled) {
                return responds(&fine).then_some((level, coarse));
            }
            coarse = fine;
        }
        responds(&coarse).then_some((MOST_HALVINGS, coarse))
    }

    /// Whether halving cannot move anything: a recursion is exact but for the moments of delayed signals.
    fn is_exact(&self) -> bool {
        let recursive = |steps: &Steps| matches!(steps.scheme(), Scheme::ExactDiscretisation { .. });
        (0..self.own.len()).all(|r| recursive(&self.steps(r, 0))) && self.dynamics.layout().delayed.is_empty()
    }

    /// The steps of a run at a level.
    fn steps(&self, run: usize, level: usize) -> Steps {
        steps_at(&self.own[run], level, self.dynamics.layout().affine.rates)
    }

    fn run(&self, r: usize, steps: &Steps) -> Option<RunSimulation<'_>> {
        let simulator = Simulator::new(self.dynamics, &self.runs[r], steps.clone()).ok()?;
        let run = &self.runs[r];
        let rows = MeasuredRows::of(&run.measured, simulator.outputs(), &run.time);
        Some(RunSimulation {
            simulation: self,
            r,
            steps: steps.clone(),
            simulator,
            rows,
            null: None,
            known: Vec::new(),
        })
    }
}

/// The steps of a program at a level, from those of the base model.
pub(crate) fn steps_at(own: &Steps, level: usize, affine: bool) -> Steps {
    match own.scheme() {
        // a program that is not linear is integrated
        Scheme::ExactDiscretisation { .. } if !affine => Steps::equal(Scheme::RungeKutta, 1 << level),
        scheme @ Scheme::ExactDiscretisation { .. } => Steps::equal(scheme, 1 << level),
        Scheme::RungeKutta if own.per_interval().is_some() => own.with_equal(1 << level),
        _ => (0..level).fold(own.clone(), |steps, _| steps.halved()),
    }
}

/// One run of a candidate.
struct RunSimulation<'a> {
    simulation: &'a CandidateSimulation<'a>,
    r: usize,
    steps: Steps,
    simulator: Simulator<'a>,
    /// Where something was measured; nothing else is kept.
    rows: Option<MeasuredRows>,
    /// The response at the null.
    null: Option<Signals>,
    /// Directions that have been found already.
    known: Vec<Known>,
}

/// A point and what the effect adds there.
type Known = (TrialPoint, Option<Signals>);

impl RunSimulation<'_> {
    /// What the effect adds at a point where something was measured; none where that is not finite.
    fn direction(&mut self, point: &TrialPoint) -> Option<Signals> {
        if let Some(k) = self.known.iter().position(|(own, _)| own == point) {
            return self.known.swap_remove(k).1;
        }
        let attached = self.simulation.attached;
        let theta = attached.theta(self.simulation.current, self.r, &point.values);
        if self.simulator.suits(&theta).is_err() {
            return None;
        }
        let cells = self.simulator.samples() * self.simulator.outputs();
        let mut y = vec![0.0; cells];
        if point.is_linear() {
            let (column, mut jacobian) = ([attached.new[point.lead]], vec![0.0; cells * 8]);
            self.simulator.sensitivities(&theta, &column, &mut y, &mut jacobian).ok()?;
            let found = self.kept(jacobian.chunks_exact(8).map(|row| row[0]).collect());
            return found.iter().all(|v| v.is_finite()).then_some(found);
        }
        self.simulator.simulate(&theta, &mut y).ok()?;
        let null = self.null(point)?;
        y.iter_mut().zip(null).for_each(|(y, null)| *y -= null);
        y.iter().all(|v| v.is_finite()).then(|| self.kept(y))
    }

    fn kept(&self, signal: Signals) -> Signals {
        MeasuredRows::taken(self.rows.as_ref(), signal, self.simulator.outputs())
    }

    /// The response without the effect, by the same steps.
    fn null(&mut self, point: &TrialPoint) -> Option<&Signals> {
        if self.null.is_none() {
            self.null = Some(self.own_null(point).or_else(|| self.base())?);
        }
        self.null.as_ref()
    }

    /// By the extended model at the null, where that has a response.
    fn own_null(&mut self, point: &TrialPoint) -> Option<Signals> {
        let attached = self.simulation.attached;
        let null = attached.params()[point.lead].null;
        if !null.is_finite() {
            return None;
        }
        let mut values = point.values.clone();
        values[point.lead] = null;
        let theta = attached.theta(self.simulation.current, self.r, &values);
        self.simulator.suits(&theta).ok()?;
        let mut y = vec![0.0; self.simulator.samples() * self.simulator.outputs()];
        self.simulator.simulate(&theta, &mut y).ok()?;
        y.iter().all(|v| v.is_finite()).then_some(y)
    }

    /// By the base model.
    fn base(&self) -> Option<Signals> {
        let current = self.simulation.current;
        if self.steps == self.simulation.own[self.r] {
            return Some(current.response[self.r].clone());
        }
        let mut simulator =
            Simulator::new(current.model.dynamics(), &self.simulation.runs[self.r], self.steps.clone()).ok()?;
        let mut y = vec![0.0; current.response[self.r].len()];
        simulator.simulate(&current.theta[self.r], &mut y).ok()?;
        y.iter().all(|v| v.is_finite()).then_some(y)
    }
}

/// Points at which the effect adds something to some run, and what to each: `direction` is none where that is not finite.
pub(crate) fn kept(
    points: Vec<TrialPoint>,
    mut direction: impl FnMut(&TrialPoint) -> Option<Vec<Signals>>,
) -> (Vec<TrialPoint>, Vec<Vec<Signals>>) {
    let mut found = |point: TrialPoint| direction(&point).map(|signals| (point, signals));
    let does_something = |(_, signals): &(TrialPoint, Vec<Signals>)| signals.iter().flatten().any(|v| *v != 0.0);
    points.into_iter().filter_map(&mut found).filter(does_something).unzip()
}

/// Root mean square difference of two directions, as a part of the second.
pub(crate) fn difference(a: &[f64], b: &[f64]) -> f64 {
    let (apart, size) = a.iter().zip(b).fold((0.0, 0.0), |(d, s), (a, b)| (d + (a - b) * (a - b), s + b * b));
    if size > 0.0 { (apart / size).sqrt() } else { apart }
}

/// Points, what is added there to each run that is learned from, and the predictors to all runs.
type FoundInBins = (Vec<TrialPoint>, Vec<Vec<Signals>>, Vec<Predictor>);

/// A candidate at all its points.
///
/// # Errors
/// Why it is left out, in words.
pub(crate) fn directions_in_bins(
    attached: &AttachedEffect,
    mut points: Vec<TrialPoint>,
    current: &FittedModel,
    runs: Runs<'_>,
    options: &SpectralOptions,
) -> Result<FoundInBins, String> {
    let last = points.last().map_or_else(Vec::new, |p| p.values.clone());
    let mut definition = attached.definition.clone();
    definition.params = attached.fitted_params(current);
    // coefficients that nothing moves are those of a point that is tried
    let theta = attached.theta(current, 0, &last);
    definition.params.iter_mut().zip(&theta).for_each(|(p, v)| p.value = *v);
    let model = current.model.sketched(definition);
    let bins = SpectralBins::new(&model, runs.all, options).map_err(|e| e.to_string())?;
    if !bins.measured_regressors().is_empty() {
        // what terms are computed with is the same at all points
        let validation = |k: usize| attached.params()[k].nuisance && attached.params()[k].fixed;
        points.retain(|p| (0..last.len()).all(|k| !validation(k) || p.values[k] == last[k]));
    }
    let bins = Arc::new(bins);
    let mut simulations = Vec::new();
    for run in 0..runs.train {
        simulations
            .push(RunBins::new(attached, current, &bins, run).ok_or("the extended model has no frequency response")?);
    }
    let (kept, signals) =
        kept(points, |point| simulations.iter_mut().map(|simulation| simulation.direction(point)).collect());
    match kept.is_empty() {
        true => Err("it changes nothing in the frequency domain".into()),
        false => Ok((kept, signals, Predictor::of_lines(&bins, runs.all.len()))),
    }
}

/// One run of a candidate.
struct RunBins<'a> {
    attached: &'a AttachedEffect,
    current: &'a FittedModel,
    run: usize,
    response: BinResponse,
    /// What belongs to the run alone, of the extended model.
    own: Vec<f64>,
}

impl<'a> RunBins<'a> {
    fn new(attached: &'a AttachedEffect, current: &'a FittedModel, bins: &SpectralBins, run: usize) -> Option<Self> {
        let (Predictor::Bins { bins: base, .. }, theta) = (&current.predictors[run], &current.theta[run]) else {
            return None;
        };
        let known = current.predictors[run].own(theta).ok()?;
        let value = |name: &str| match base.own().position(|own| own == name) {
            Some(at) => known[at],
            // a state of the effect that follows a signal ends as that does
            None => followed(attached, name).map_or(0.0, |signal| base.end_like(run, theta, &known, signal, name)),
        };
        let own = bins.own().map(value).collect();
        Some(Self { attached, current, run, response: bins.response(run).ok()?, own })
    }

    /// What the effect adds at a point; none where that is not finite.
    fn direction(&mut self, point: &TrialPoint) -> Option<Signals> {
        if point.is_linear() {
            let theta = self.theta(&point.values);
            let cells = self.response.samples() * self.response.outputs();
            let (mut y, mut found) = (vec![0.0; cells], vec![0.0; cells]);
            let column = [self.attached.new[point.lead]];
            self.response.columns(&theta, &column, &mut y, (&mut found, 1)).ok()?;
            return found.iter().all(|v| v.is_finite()).then_some(found);
        }
        let mut y = self.answer(&point.values)?;
        let mut null = point.values.clone();
        null[point.lead] = self.attached.params()[point.lead].null;
        let null = Some(null).filter(|n| n.iter().all(|v| v.is_finite())).and_then(|null| self.answer(&null));
        let null = null.as_ref().unwrap_or(&self.current.response[self.run]);
        y.iter_mut().zip(null).for_each(|(y, null)| *y -= null);
        Some(y)
    }

    fn answer(&mut self, values: &[f64]) -> Option<Signals> {
        let theta = self.theta(values);
        let mut y = vec![0.0; self.response.samples() * self.response.outputs()];
        self.response.simulate(&theta, &mut y).ok()?;
        y.iter().all(|v| v.is_finite()).then_some(y)
    }

    fn theta(&self, values: &[f64]) -> Vec<f64> {
        [self.attached.theta(self.current, self.run, values), self.own.clone()].concat()
    }
}

/// The signal that a state of an effect begins as, by the name of the state's end value.
fn followed<'a>(attached: &'a AttachedEffect, end: &str) -> Option<&'a str> {
    let name = end.split_once('(')?.1.strip_suffix(')')?;
    let definition = &attached.definition;
    let state = definition.states.iter().find(|s| s.quantity.name == name)?;
    let begins = |at: usize| definition.graph.depends(|leaf| leaf == Leaf::Param(at as u32))[state.initial.index()];
    let k = attached.new.iter().position(|at| begins(*at))?;
    attached.params()[k].begins_as.as_deref()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::candidates::extended_model::SignalScales;
    use crate::candidates::runs::Domain;
    use fdm_effects::{Catalogue, Kind};
    use fdm_system::model::Model;
    use fdm_system::record::Run;

    const MODEL: &str = "model m { input u; state x, z, w; param a = -1, b = 2, c = 0.4, d = -0.7;
        der(x) = a*x + z + b*u; der(z) = c*x - z + 0.5*u; der(w) = d*w + z; output x_m = x, z_m = z + 0.3*w, w_m = w; }";

    fn run() -> Run {
        let (n, dt) = (160, 0.05);
        let time: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let wave = |t: f64, f: f64| (f * t + 0.3).sin() + 0.5 * (2.7 * f * t).cos();
        Run {
            name: "r".into(),
            inputs: time.iter().map(|t| wave(*t, 1.3)).collect(),
            measured: time.iter().flat_map(|t| [wave(*t, 0.9), wave(*t, 1.1), wave(*t, 1.7)]).collect(),
            time,
            held: vec![false],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0; 3],
        }
    }

    #[test]
    fn derivatives_are_those_of_central_differences() {
        let model = Model::from_text("m.fdm", MODEL).unwrap();
        let all = [run()];
        let domain = Domain::Frequency(Box::default()).settled(&model, &all).unwrap();
        let runs = Runs { all: &all, train: 1, domain: &domain };
        let current = FittedModel::new(model.clone(), runs, vec![model.definition().start()]).unwrap();
        let scales = SignalScales::new(&current, runs);
        let (mut compared, mut finite, mut tried, mut left_out) = (0, 0, Vec::new(), Vec::new());
        for candidate in Catalogue::standard().places(&current.subject).candidates {
            if candidate.kind() == Kind::Variance {
                continue;
            }
            let own = attached(&candidate, &current, runs, &scales);
            let trace = match own.and_then(|own| candidate_directions(own, &current, runs)) {
                Ok(trace) => trace,
                Err(reason) => {
                    left_out.push((crate::candidates::extended_model::place(&candidate).to_string(), reason));
                    continue;
                }
            };
            tried.push(crate::candidates::extended_model::place(&candidate).to_string());
            let Predictor::Bins { bins, .. } = &trace.predictors[0] else { panic!("lines") };
            let mut simulation = RunBins::new(&trace.attached, &current, bins, 0).unwrap();
            for (point, found) in trace.points.iter().zip(&trace.signals) {
                if !point.is_linear() {
                    finite += 1;
                    // a whole step is the sum of its halves
                    let null = trace.attached.params()[point.lead].null;
                    let at = |part: f64, values: &mut Vec<f64>| {
                        values[point.lead] = null + part * (values[point.lead] - null)
                    };
                    let mut values = point.values.clone();
                    at(0.5, &mut values);
                    let (half, whole) =
                        (simulation.answer(&values).unwrap(), simulation.answer(&point.values).unwrap());
                    let base = &current.response[0];
                    let off = |k: usize| (half[k] - base[k]) + (whole[k] - half[k]) - found[0][k];
                    let size = found[0].iter().fold(0.0_f64, |a, v| a.max(v.abs()));
                    assert!(
                        (0..half.len()).all(|k| off(k).abs() < 1e-6 * size),
                        "{} {:?}",
                        trace.attached.candidate.effect().name(),
                        point
                    );
                    continue;
                }
                compared += 1;
                let (h, mut values) = (1e-4, point.values.clone());
                let null = values[point.lead];
                let mut at = |value: f64| {
                    values[point.lead] = value;
                    simulation.answer(&values).unwrap()
                };
                let (above, below) = (at(null + h), at(null - h));
                let size = found[0].iter().fold(0.0_f64, |a, v| a.max(v.abs()));
                for (k, v) in found[0].iter().enumerate() {
                    let central = (above[k] - below[k]) / (2.0 * h);
                    let place = crate::candidates::extended_model::place(&trace.attached.candidate);
                    assert!((central - v).abs() < 1e-5 * size, "{place} {point:?} line {k}: {v} instead of {central}");
                }
            }
        }
        assert!(compared > 20 && finite > 10, "{compared} {finite}");
        let reason = |place: &str| left_out.iter().find(|(name, _)| name == place).map_or("", |(_, why)| why);
        assert!(reason("constant_force(x)").contains("changes nothing"), "{left_out:?}");
        assert!(reason("input_dead_zone(u)").contains("not linear"), "{left_out:?}");
        // z is shown together with w only
        assert!(reason("quadratic_damping(z)").contains("not linear"), "{left_out:?}");
        for carried in ["quadratic_damping(x)", "product_term(x, u, w)", "output_bias_drift(x_m)"] {
            assert!(tried.iter().any(|place| place == carried), "{tried:?}");
        }
    }
}
