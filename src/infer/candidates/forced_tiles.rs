//! Directions of many candidates at once: smooth effects are columns of one program.
//!
//! What a smooth effect adds is, to first order, the response of the base model's tangent to the derivative of its equations by the effect's
//! parameter. So tiles of such columns are simulated together ([`fdm_effects::forced`]): the base model is integrated once for each tile,
//! not once for each candidate and value. A candidate that cannot stand in a tile is simulated by itself (`directions`): one with finite
//! values, with delays, of stiff models, or whose tile diverges.

use crate::bins::{MeasuredRows, Signals};
use crate::candidates::directions::{
    ACCURATE, CandidateDirections, MOST_HALVINGS, TrialPoint, attached, candidate_directions, difference, kept,
    steps_at,
};
use crate::candidates::extended_model::{AttachedEffect, SignalScales};
use crate::candidates::fitted_model::FittedModel;
use crate::candidates::predictor::Predictor;
use crate::candidates::runs::{Domain, Runs};
use fdm_effects::Candidate;
use fdm_effects::forced::Forced;
use fdm_estimate::Work;
use fdm_grammar::graph::Signal;
use fdm_grammar::schedule::Affine;
use fdm_numeric::parallel;
use fdm_system::code::{Engine, compile};
use fdm_system::dynamics::Dynamics;
use fdm_system::record::Run;
use fdm_system::simulate::{Scheme, Simulator, Steps};
use std::ops::Range;

/// Most columns of a tile, and most states that its effects bring.
const COLUMNS: usize = 64;
const STATES: usize = 24;
/// Numbers of a tile's Jacobian over a run that are kept at once.
const NUMBERS: usize = 1 << 24;
/// Steps of a run from which machine code saves time.
const LONG: usize = 1500;

/// A candidate in the model, and where it is tried.
type Attached = (AttachedEffect, Vec<TrialPoint>);

/// What all candidates add, each at all its points, in their order; why it is left out, in words. None where it was stopped.
pub(crate) fn all_directions(
    candidates: &[&Candidate],
    (current, runs, scales): (&FittedModel, Runs<'_>, &SignalScales),
    work: &Work<'_>,
) -> Option<Vec<Result<CandidateDirections, String>>> {
    let made = |candidate: &&Candidate| work.goes_on().then(|| attached(candidate, current, runs, scales));
    let mut waiting: Vec<Option<Result<Attached, String>>> =
        parallel::map(candidates.iter(), made).into_iter().collect::<Option<Vec<_>>>()?.into_iter().map(Some).collect();
    let mut found: Vec<Option<Result<CandidateDirections, String>>> = waiting.iter().map(|_| None).collect();
    if let Some(search) = Tiles::new(current, runs) {
        let list: Vec<(usize, &Attached)> =
            waiting.iter().enumerate().filter_map(|(k, a)| Some((k, a.as_ref()?.as_ref().ok()?))).collect();
        for (k, columns) in search.columns(&list, work)? {
            if let Some(Ok(own)) = waiting[k].take() {
                found[k] = Some(search.gathered(own, columns));
            }
        }
    }
    let alone = |(k, own): (usize, Option<Result<Attached, String>>)| match own {
        Some(Ok(own)) => work.goes_on().then(|| (k, candidate_directions(own, current, runs))),
        Some(Err(why)) => Some((k, Err(why))),
        None => Some((k, Err(String::new()))),
    };
    let open: Vec<_> = waiting.into_iter().enumerate().filter(|(_, own)| own.is_some()).collect();
    for (k, own) in parallel::map(open, alone).into_iter().collect::<Option<Vec<_>>>()? {
        found[k] = Some(own);
    }
    found.into_iter().collect()
}

/// Points of a candidate that differ in the size of its parameters only.
struct Unit<'a> {
    /// The candidate, by its place in the list.
    candidate: usize,
    attached: &'a AttachedEffect,
    /// Its points, and the new parameters that are their sizes.
    points: Range<usize>,
    leads: Vec<usize>,
    values: &'a [f64],
}

/// A unit by its place, its columns, and where what belongs to each run stands in it and in the tile.
type InTile = (usize, Vec<usize>, Vec<(usize, usize)>);

/// Units in one program.
struct Tile {
    dynamics: Box<dyn Dynamics>,
    units: Vec<InTile>,
    columns: Vec<usize>,
    params: usize,
}

/// How all of them are simulated.
struct Tiles<'a> {
    current: &'a FittedModel,
    runs: Runs<'a>,
    /// The steps of the base model.
    own: Vec<Steps>,
}

/// The columns of a candidate over all runs that are learned from, point by point, and how often steps were halved for them.
struct Columns {
    signals: Vec<Vec<Signals>>,
    level: usize,
}

impl<'a> Tiles<'a> {
    /// None where the base model has no tiles.
    fn new(current: &'a FittedModel, runs: Runs<'a>) -> Option<Self> {
        let own: Vec<Steps> = current.predictors.iter().filter_map(|p| p.steps().cloned()).collect();
        let explicit = own.iter().all(|steps| steps.scheme() != Scheme::Radau);
        let delayed = current.model.layout().delayed.iter().any(|s| matches!(s, Signal::State(_)));
        let fits = *runs.domain == Domain::Time && own.len() == runs.all.len() && explicit && !delayed;
        (fits && current.model.layout().states > 0).then_some(Self { current, runs, own })
    }

    /// The columns of all candidates that stand in tiles, by their numbers. None where it was stopped.
    fn columns(&self, list: &[(usize, &'a Attached)], work: &Work<'_>) -> Option<Vec<(usize, Columns)>> {
        let smooth = |(_, own): &&(usize, &Attached)| own.1.iter().all(TrialPoint::is_linear);
        let chosen: Vec<(usize, &Attached)> = list.iter().filter(smooth).copied().collect();
        let units: Vec<Unit<'_>> = chosen.iter().enumerate().flat_map(|(c, (_, own))| units(c, own)).collect();
        // by the first run: how fine its steps must be
        let mut levels: Vec<Option<usize>> = vec![None; units.len()];
        let mut first: Vec<Option<Vec<Signals>>> = vec![None; units.len()];
        let mut open: Vec<usize> = (0..units.len()).collect();
        for level in 0..=MOST_HALVINGS {
            if level == 0 {
                self.run(&units, &open, (0, 0), &mut first, work)?;
            }
            open.retain(|u| first[*u].is_some());
            if level == MOST_HALVINGS {
                open.iter().for_each(|u| levels[*u] = Some(level));
                break;
            }
            let mut finer = vec![None; units.len()];
            self.run(&units, &open, (0, level + 1), &mut finer, work)?;
            open.retain(|u| {
                let settled = match (&first[*u], &finer[*u]) {
                    (Some(a), Some(b)) => a.iter().zip(b).all(|(a, b)| difference(a, b) <= ACCURATE),
                    _ => false,
                };
                // a mode that one run hardly moves may be moved by another: it keeps the finer steps
                let own_states = units[*u].attached.definition.states.len() > self.current.model.layout().states;
                if settled {
                    levels[*u] = Some(level + usize::from(own_states));
                }
                if !settled || own_states {
                    first[*u] = finer[*u].take();
                }
                !settled
            });
            if open.is_empty() {
                break;
            }
        }
        let mut all: Vec<Vec<Option<Vec<Signals>>>> = vec![first];
        for run in 1..self.runs.train {
            let mut own = vec![None; units.len()];
            for level in 0..=MOST_HALVINGS {
                let chosen: Vec<usize> = (0..units.len()).filter(|u| levels[*u] == Some(level)).collect();
                self.run(&units, &chosen, (run, level), &mut own, work)?;
            }
            all.push(own);
        }
        // a candidate with a unit that failed goes by itself
        let mut found = Vec::new();
        for (c, (k, own)) in chosen.iter().enumerate() {
            let mine: Vec<usize> = (0..units.len()).filter(|u| units[*u].candidate == c).collect();
            let level = mine.iter().map(|u| levels[*u]).try_fold(0, |most, level| Some(level?.max(most)));
            let complete = mine.iter().all(|u| all.iter().all(|run| run[*u].is_some()));
            let Some(level) = level.filter(|_| complete) else { continue };
            let mut signals: Vec<Vec<Signals>> = own.1.iter().map(|_| Vec::with_capacity(all.len())).collect();
            for run in &mut all {
                for u in &mine {
                    let parts = run[*u].take().unwrap_or_default();
                    units[*u].points.clone().zip(parts).for_each(|(point, part)| signals[point].push(part));
                }
            }
            found.push((*k, Columns { signals, level }));
        }
        Some(found)
    }

    /// Simulates these units over a run at a level; what diverges stays empty. None where it was stopped.
    fn run(
        &self,
        units: &[Unit<'_>],
        chosen: &[usize],
        (run, level): (usize, usize),
        into: &mut [Option<Vec<Signals>>],
        work: &Work<'_>,
    ) -> Option<()> {
        let record = &self.runs.all[run];
        // a recursion is exact: its place is taken by steps that are fine enough from the first
        let finer = usize::from(matches!(self.own[run].scheme(), Scheme::ExactDiscretisation { .. }));
        let steps = steps_at(&self.own[run], level + finer, false);
        let numbers = record.len() * self.current.outputs();
        let width = (NUMBERS / numbers.max(1) / 8 * 8).clamp(8, COLUMNS);
        let tiles = self.tiled(units, chosen, width, steps.total(record.len()));
        let simulated = |tile: &Tile| {
            let signals = work.goes_on().then(|| self.simulated(units, tile, (run, record), &steps))?;
            let mut signals = signals.unwrap_or_default().into_iter();
            let own = |(u, columns, _): &InTile| {
                let part: Vec<Signals> = signals.by_ref().take(columns.len()).collect();
                let whole = part.len() == columns.len() && part.iter().flatten().all(|v| v.is_finite());
                whole.then_some((*u, part))
            };
            Some(tile.units.iter().filter_map(own).collect::<Vec<_>>())
        };
        let found: Option<Vec<_>> = parallel::map(tiles.iter(), simulated).into_iter().collect();
        found?.into_iter().flatten().for_each(|(u, part)| into[u] = Some(part));
        Some(())
    }

    /// Units in tiles of so many columns.
    fn tiled(&self, units: &[Unit<'_>], chosen: &[usize], width: usize, steps: usize) -> Vec<Tile> {
        let base = self.current.model.definition();
        let count = |u: &usize| units[*u].leads.len();
        let states = |u: &usize| units[*u].attached.definition.states.len() - base.states.len();
        let mut parts: Vec<(Vec<usize>, usize, usize)> = Vec::new();
        for u in chosen {
            match parts.last_mut() {
                Some((list, columns, own)) if *columns + count(u) <= width && *own + states(u) <= STATES => {
                    list.push(*u);
                    (*columns, *own) = (*columns + count(u), *own + states(u));
                }
                _ => parts.push((vec![*u], count(u), states(u))),
            }
        }
        let tile = |(list, ..): &(Vec<usize>, usize, usize)| {
            let mut forced = Forced::new(base);
            let add = |u: &usize| {
                let unit = &units[*u];
                let roles = unit.attached.roles(unit.values, &unit.leads);
                let added = forced.add(&unit.attached.definition, &roles)?;
                let column = |lead: &usize| {
                    let wanted = unit.attached.new[*lead];
                    added.columns.iter().find(|(own, _)| *own == wanted).map(|(_, here)| *here)
                };
                Some((*u, unit.leads.iter().map(column).collect::<Option<Vec<_>>>()?, added.given))
            };
            let units: Vec<InTile> = list.iter().filter_map(add).collect();
            let (params, engine) = (forced.params(), if steps < LONG { Engine::Tape } else { Engine::Jit });
            let columns = units.iter().flat_map(|(_, columns, _)| columns.iter().copied()).collect();
            let mut schedule = forced.schedule();
            // equations may be linear and outputs states, what is added to them is neither
            let layout = &mut schedule.layout;
            layout.affine = Affine { rates: false, outputs: vec![false; layout.outputs] };
            layout.observed = vec![None; layout.outputs];
            Tile { dynamics: compile(&schedule, engine), units, columns, params }
        };
        parallel::map(parts.iter(), tile)
    }

    /// The columns of a tile over a run; none where it diverges.
    fn simulated(
        &self,
        units: &[Unit<'_>],
        tile: &Tile,
        (place, run): (usize, &Run),
        steps: &Steps,
    ) -> Option<Vec<Signals>> {
        let mut theta = self.current.theta[place].clone();
        theta.resize(tile.params, 0.0);
        for (u, _, given) in &tile.units {
            let own = units[*u].attached.theta(self.current, place, units[*u].values);
            given.iter().for_each(|(from, to)| theta[*to] = own[*from]);
        }
        let mut simulator = Simulator::new(&*tile.dynamics, run, steps.clone()).ok()?;
        simulator.suits(&theta).ok()?;
        let cells = simulator.samples() * simulator.outputs();
        let stride = tile.columns.len().next_multiple_of(8);
        let (mut y, mut jacobian) = (vec![0.0; cells], vec![0.0; cells * stride]);
        simulator.sensitivities(&theta, &tile.columns, &mut y, &mut jacobian).ok()?;
        let rows = MeasuredRows::of(&run.measured, simulator.outputs(), &run.time);
        let whole = |c: usize| jacobian.chunks_exact(stride).map(|row| row[c]).collect();
        let column = |c: usize| MeasuredRows::taken(rows.as_ref(), whole(c), simulator.outputs());
        Some((0..tile.columns.len()).map(column).collect())
    }

    /// A candidate with its columns as if it had been simulated by itself.
    fn gathered(
        &self,
        (attached, points): Attached,
        Columns { signals, level }: Columns,
    ) -> Result<CandidateDirections, String> {
        let affine = Affine::of(&attached.definition).rates;
        let of = |own: &Steps| match own.scheme() {
            // exact: nothing can be halved
            Scheme::ExactDiscretisation { .. } if affine => steps_at(own, 0, affine),
            _ => steps_at(own, level, affine),
        };
        let predictors = self.own.iter().map(|own| Predictor::Steps(of(own))).collect();
        let mut signals = signals.into_iter();
        let (points, signals) = kept(points, |_| signals.next());
        match points.is_empty() {
            true => Err("it changes nothing in these runs".into()),
            false => Ok(CandidateDirections { attached, points, signals, predictors }),
        }
    }
}

/// The units of a candidate: points that follow each other and share all values.
fn units<'a>(candidate: usize, (attached, points): &'a Attached) -> Vec<Unit<'a>> {
    let mut units: Vec<Unit<'a>> = Vec::new();
    for (k, point) in points.iter().enumerate() {
        match units.last_mut().filter(|unit| unit.values == point.values && !unit.leads.contains(&point.lead)) {
            Some(unit) => {
                unit.points.end = k + 1;
                unit.leads.push(point.lead);
            }
            None => units.push(Unit {
                candidate,
                attached,
                points: k..k + 1,
                leads: vec![point.lead],
                values: &point.values,
            }),
        }
    }
    units
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use fdm_effects::{Catalogue, Kind};
    use fdm_system::model::Model;

    const LINEAR: &str = "model m { input u; state x, z = free; param a = -1, b = 2, c = 0.4;
        der(x) = a*x + z + b*u; der(z) = c*x - z + 0.5*u; output x_m = x, z_m = z; }";
    const MODEL: &str = "model m { input u; state x, z = free; param a = -1, b = 2, c = 0.4, k = 0.3;
        der(x) = a*x + z + b*u - k*x^3; der(z) = c*x - z*abs(z) + 0.5*u; output x_m = x, z_m = z + 0.3*x*u; }";

    fn run(name: &str, phase: f64) -> Run {
        let (n, dt) = (120, 0.05);
        let time: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let wave = |t: f64, f: f64| (f * t + phase).sin() + 0.5 * (2.7 * f * t).cos();
        Run {
            name: name.into(),
            inputs: time.iter().map(|t| wave(*t, 1.3)).collect(),
            measured: time.iter().flat_map(|t| [wave(*t, 0.9), wave(*t, 1.1)]).collect(),
            time,
            held: vec![false],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0; 2],
        }
    }

    /// Each column is the central difference of the responses of the candidate's own program.
    #[test]
    fn columns_are_central_differences() {
        [MODEL, LINEAR].into_iter().for_each(compared_with_differences);
    }

    fn compared_with_differences(text: &str) {
        let model = Model::from_text("m.fdm", text).unwrap();
        let all = [run("a", 0.3), run("b", 1.1)];
        let runs = Runs { all: &all, train: 2, domain: &Domain::Time };
        let mut start = vec![model.definition().start(); 2];
        start[1][model.definition().param("z(0)").unwrap()] = 0.4;
        let current = FittedModel::new(model, runs, start).unwrap();
        let scales = SignalScales::new(&current, runs);
        let places = Catalogue::standard().places(&current.subject).candidates;
        let scored: Vec<&Candidate> = places.iter().filter(|c| c.kind() != Kind::Variance).collect();
        let found = all_directions(&scored, (&current, runs, &scales), &Work::default()).unwrap();
        let (mut compared, mut with_states) = (0, 0);
        for (candidate, together) in scored.iter().zip(found) {
            let alone = attached(candidate, &current, runs, &scales);
            let alone = alone.and_then(|own| candidate_directions(own, &current, runs));
            let (together, alone) = match (together, alone) {
                (Ok(together), Ok(alone)) => (together, alone),
                (together, alone) => {
                    assert_eq!(together.err(), alone.err(), "{candidate}");
                    continue;
                }
            };
            assert_eq!(together.points, alone.points, "{candidate}");
            for ((point, a), b) in together.points.iter().zip(&together.signals).zip(&alone.signals) {
                if !point.is_linear() {
                    assert_eq!(a, b, "{candidate} {point:?}");
                    continue;
                }
                compared += 1;
                let own = &together.attached;
                with_states += usize::from(own.definition.states.len() > 2);
                let mut definition = own.definition.clone();
                definition.params.iter_mut().for_each(|p| p.fixed = true);
                let dynamics = compile(&fdm_grammar::Schedule::new(&mut definition), Engine::Tape);
                let answer = |size: f64, r: usize| {
                    let mut values = point.values.clone();
                    values[point.lead] += size;
                    let theta = own.theta(&current, r, &values);
                    let steps = Steps::equal(Scheme::RungeKutta, 8);
                    let mut simulator = Simulator::new(&*dynamics, &all[r], steps).unwrap();
                    let mut y = vec![0.0; 240];
                    simulator.simulate(&theta, &mut y).unwrap();
                    y
                };
                for r in 0..2 {
                    let h = 1e-5;
                    let central: Vec<f64> =
                        answer(h, r).iter().zip(answer(-h, r)).map(|(a, b)| (a - b) / (2.0 * h)).collect();
                    let off = difference(&a[r], &central);
                    // by the steps of the tile: a mode near the sampling rate is the worst
                    assert!(off <= 2.5 * ACCURATE, "{candidate} {point:?} run {r}: {off}");
                }
            }
        }
        assert!(compared > 30 && with_states > 3, "{compared} {with_states}");
    }
}
