//! What an effect would add to the responses: one direction for each value that its parameters are tried at.
//!
//! A smooth effect is differentiated at its null, exactly; a finite one is simulated at each trial and compared with the null. One
//! extended program serves all points of a candidate, and no text is written for any of them.

use super::attached::Attached;
use super::domain::Domain;
use super::measured::Measured;
use super::round::Runs;
use super::stage::Stage;
use super::transfer::transfers;
use super::way::Way;
use crate::code::{Engine, compile};
use crate::diagnose::screen::{Shape, Signals};
use crate::dynamics::Dynamics;
use crate::record::Run;
use crate::simulate::{Scheme, Simulator, Steps};
use fdm_grammar::Schedule;
use fdm_grammar::effect::{Candidate, Choice, Kind, NewParam};

/// Most points of a candidate.
const MOST_POINTS: usize = 120;
/// Part of a direction by which halving the steps may move it.
const ACCURATE: f64 = 0.02;
/// Times that steps are halved.
const MOST_HALVINGS: usize = 3;

/// A candidate's directions.
pub(super) struct Trace {
    /// The effect in the model.
    pub(super) attached: Attached,
    /// Where it was tried.
    pub(super) points: Vec<Point>,
    /// What it adds there to each run (points by runs).
    pub(super) signals: Vec<Vec<Signals>>,
    /// How each run was answered, those that are held out too.
    pub(super) ways: Vec<Way>,
}

/// Values of the new parameters.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Point {
    /// One for each new parameter.
    pub(super) values: Vec<f64>,
    /// The one that is the effect's size here.
    pub(super) lead: usize,
    /// How the direction scales.
    pub(super) shape: Shape,
}

impl Point {
    /// The unit of the direction: the derivative's, or how far the trial is from the null.
    pub(super) fn size(&self) -> f64 {
        if self.is_linear() { 1.0 } else { self.values[self.lead] }
    }

    /// Whether the direction is a derivative at the null.
    pub(super) fn is_linear(&self) -> bool {
        matches!(self.shape, Shape::Linear | Shape::Joint { .. })
    }

    /// Values at a multiple of the direction, within the bounds.
    pub(super) fn at(&self, amount: f64, params: &[NewParam]) -> Vec<f64> {
        let mut values = self.values.clone();
        let NewParam { null, lower, upper, .. } = params[self.lead];
        let value = values[self.lead];
        let moved = match self.shape {
            Shape::Linear | Shape::Joint { .. } => null + amount,
            _ if null.is_finite() => null + amount * (value - null),
            _ => value / amount.max(1e-3),
        };
        values[self.lead] = moved.clamp(lower, upper);
        values
    }
}

/// Simulates a candidate at all its points.
///
/// # Errors
/// Why it is left out, in words.
pub(super) fn trace(
    candidate: &Candidate,
    stage: &Stage,
    runs: Runs<'_>,
    measured: &Measured,
) -> Result<Trace, String> {
    let attached = Attached::new(candidate, stage, measured, &Choice::new())?;
    if !runs.train().iter().all(|run| attached.takes(run)) {
        return Err("it needs records that the runs do not have".into());
    }
    let points = points(&attached);
    if points.is_empty() {
        return Err("the records leave no value to try".into());
    }
    if let Domain::Frequency(options) = runs.domain {
        let (points, signals, ways) = transfers(&attached, points, stage, runs, options)?;
        return Ok(Trace { attached, points, signals, ways });
    }
    let mut definition = attached.definition.clone();
    let differentiated = |k: usize| points.iter().any(|p| p.is_linear() && p.lead == k);
    definition.params.iter_mut().for_each(|p| p.fixed = true);
    for (k, at) in attached.new.iter().enumerate() {
        definition.params[*at].fixed = !differentiated(k);
    }
    let dynamics = compile(&Schedule::new(&mut definition), Engine::Tape);
    let steps: Vec<Steps> = stage.ways.iter().filter_map(|way| way.steps().cloned()).collect();
    let bench = Bench { stage, own: &steps, runs: runs.train(), attached: &attached, dynamics: &*dynamics };
    let (points, signals, steps) = bench.signals(points)?;
    Ok(Trace { attached, points, signals, ways: steps.into_iter().map(Way::Steps).collect() })
}

/// All combinations of trials.
fn points(attached: &Attached) -> Vec<Point> {
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
fn sizes(attached: &Attached, values: &[f64], group: usize) -> Vec<Point> {
    let params = attached.params();
    if attached.candidate.kind() == Kind::Smooth {
        let own: Vec<usize> = (0..params.len()).filter(|k| !params[*k].nuisance).collect();
        let shape = if own.len() > 1 { Shape::Joint { group } } else { Shape::Linear };
        return own.into_iter().map(|lead| Point { values: values.to_vec(), lead, shape }).collect();
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
    // on either side of the null
    let mut smaller = [false; 2];
    let mut shape = |v: f64| match std::mem::replace(&mut smaller[usize::from(v > null)], true) {
        false => Shape::Smallest,
        true => Shape::Finite,
    };
    tried.iter().map(|v| Point { values: others(*v), lead, shape: shape(*v) }).collect()
}

/// Simulates the points of one candidate.
struct Bench<'a> {
    stage: &'a Stage,
    /// The steps of the stage.
    own: &'a [Steps],
    runs: &'a [Run],
    attached: &'a Attached,
    dynamics: &'a dyn Dynamics,
}

type Found = (Vec<Point>, Vec<Vec<Signals>>, Vec<Steps>);

impl Bench<'_> {
    fn signals(&self, points: Vec<Point>) -> Result<Found, String> {
        let (level, first) =
            self.settled(&points).ok_or("the extended model has no response at any value that is tried")?;
        // those of held-out runs too, for the fits
        let steps: Vec<Steps> = (0..self.own.len()).map(|r| self.steps(r, level)).collect();
        let mut benches = vec![first];
        for (r, steps) in steps.iter().enumerate().take(self.runs.len()).skip(1) {
            benches.push(self.run(r, steps).ok_or("the extended model cannot be simulated over these runs")?);
        }
        let (kept, signals) = kept(points, |point| benches.iter_mut().map(|bench| bench.direction(point)).collect());
        if kept.is_empty() { Err("it changes nothing in these runs".into()) } else { Ok((kept, signals, steps)) }
    }

    /// How often steps are halved, by the first run: until that moves the outermost points no more. The first run with these steps, and
    /// what those points add to it.
    fn settled(&self, points: &[Point]) -> Option<(usize, RunBench<'_>)> {
        let outer = if points.len() > 1 { vec![&points[0], &points[points.len() - 1]] } else { vec![&points[0]] };
        let at = |level: usize| -> Option<RunBench<'_>> {
            let mut bench = self.run(0, &self.steps(0, level))?;
            bench.known = outer.iter().map(|p| ((*p).clone(), bench.direction(p))).collect();
            Some(bench)
        };
        let responds = |bench: &RunBench<'_>| bench.known.iter().any(|(_, found)| found.is_some());
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
        let recursive = |steps: &Steps| matches!(steps.scheme(), Scheme::Recursion { .. });
        (0..self.own.len()).all(|r| recursive(&self.steps(r, 0))) && self.dynamics.layout().delayed.is_empty()
    }

    /// The steps of a run at a level.
    fn steps(&self, run: usize, level: usize) -> Steps {
        let layout = self.dynamics.layout();
        let own = &self.own[run];
        match own.scheme() {
            // a program that is not linear is integrated
            Scheme::Recursion { .. } if !layout.affine.rates => Steps::equal(Scheme::RungeKutta, 1 << level),
            scheme @ Scheme::Recursion { .. } => Steps::equal(scheme, 1 << level),
            scheme @ Scheme::RungeKutta if own.per_interval().is_some() => Steps::equal(scheme, 1 << level),
            _ => (0..level).fold(own.clone(), |steps, _| steps.halved()),
        }
    }

    fn run(&self, r: usize, steps: &Steps) -> Option<RunBench<'_>> {
        let simulator = Simulator::new(self.dynamics, &self.runs[r], steps.clone()).ok()?;
        Some(RunBench { bench: self, r, steps: steps.clone(), simulator, null: None, known: Vec::new() })
    }
}

/// One run of a candidate.
struct RunBench<'a> {
    bench: &'a Bench<'a>,
    r: usize,
    steps: Steps,
    simulator: Simulator<'a>,
    /// The response at the null.
    null: Option<Signals>,
    /// Directions that have been found already.
    known: Vec<Known>,
}

/// A point and what the effect adds there.
type Known = (Point, Option<Signals>);

impl RunBench<'_> {
    /// What the effect adds at a point; none where that is not finite.
    fn direction(&mut self, point: &Point) -> Option<Signals> {
        if let Some(k) = self.known.iter().position(|(own, _)| own == point) {
            return self.known.swap_remove(k).1;
        }
        let attached = self.bench.attached;
        let theta = attached.theta(self.bench.stage, self.r, &point.values);
        if self.simulator.suits(&theta).is_err() {
            return None;
        }
        let cells = self.simulator.samples() * self.simulator.outputs();
        let mut y = vec![0.0; cells];
        if point.is_linear() {
            let (column, mut jacobian) = ([attached.new[point.lead]], vec![0.0; cells * 8]);
            self.simulator.sensitivities(&theta, &column, &mut y, &mut jacobian).ok()?;
            let found: Signals = jacobian.chunks_exact(8).map(|row| row[0]).collect();
            return found.iter().all(|v| v.is_finite()).then_some(found);
        }
        self.simulator.simulate(&theta, &mut y).ok()?;
        let null = self.null(point)?;
        y.iter_mut().zip(null).for_each(|(y, null)| *y -= null);
        y.iter().all(|v| v.is_finite()).then_some(y)
    }

    /// The response without the effect, by the same steps.
    fn null(&mut self, point: &Point) -> Option<&Signals> {
        if self.null.is_none() {
            self.null = Some(self.own_null(point).or_else(|| self.base())?);
        }
        self.null.as_ref()
    }

    /// By the extended model at the null, where that has a response.
    fn own_null(&mut self, point: &Point) -> Option<Signals> {
        let attached = self.bench.attached;
        let null = attached.params()[point.lead].null;
        if !null.is_finite() {
            return None;
        }
        let mut values = point.values.clone();
        values[point.lead] = null;
        let theta = attached.theta(self.bench.stage, self.r, &values);
        self.simulator.suits(&theta).ok()?;
        let mut y = vec![0.0; self.simulator.samples() * self.simulator.outputs()];
        self.simulator.simulate(&theta, &mut y).ok()?;
        y.iter().all(|v| v.is_finite()).then_some(y)
    }

    /// By the base model.
    fn base(&self) -> Option<Signals> {
        let stage = self.bench.stage;
        if self.steps == self.bench.own[self.r] {
            return Some(stage.response[self.r].clone());
        }
        let mut simulator =
            Simulator::new(stage.model.dynamics(), &self.bench.runs[self.r], self.steps.clone()).ok()?;
        let mut y = vec![0.0; stage.response[self.r].len()];
        simulator.simulate(&stage.theta[self.r], &mut y).ok()?;
        y.iter().all(|v| v.is_finite()).then_some(y)
    }
}

/// Points at which the effect adds something to some run, and what to each: `direction` is none where that is not finite.
pub(super) fn kept(
    points: Vec<Point>,
    mut direction: impl FnMut(&Point) -> Option<Vec<Signals>>,
) -> (Vec<Point>, Vec<Vec<Signals>>) {
    let mut found = |point: Point| direction(&point).map(|signals| (point, signals));
    let does_something = |(_, signals): &(Point, Vec<Signals>)| signals.iter().flatten().any(|v| *v != 0.0);
    points.into_iter().filter_map(&mut found).filter(does_something).unzip()
}

/// Root mean square difference of two directions, as a part of the second.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    let (apart, size) = a.iter().zip(b).fold((0.0, 0.0), |(d, s), (a, b)| (d + (a - b) * (a - b), s + b * b));
    if size > 0.0 { (apart / size).sqrt() } else { apart }
}
