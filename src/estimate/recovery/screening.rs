//! The start of each of many fits: one that can be simulated and, where ranges span decades, the best of a crowd.
//!
//! A draw out of many decades is far from everything, and a fit from there ends where the response has died away. So many are drawn, compared by their
//! magnitudes, improved a little, thinned, improved more (successive halving: Jamieson and Talwalkar 2016); the last few go on by what is fitted.
//!
//! What is compared while starts are looked for that lie decades apart: magnitudes, `asinh(y / 2 s)` with a level s for each output, which are linear up to the
//! level and logarithms beyond it (Johnson 1949).
//!
//! Plain residuals see a response that has died away as one that is nearly right, and one that runs away as infinitely wrong: between the two there is no slope
//! to follow. Magnitudes are as far from what was measured on both sides, and grow by one for every factor of e.

use super::multi_start::Spread;
use crate::estimation::solve::{cost_at, estimate};
use crate::methods::output_error::options::{Attempt, FitOptions};
use crate::methods::output_error::single::{chosen_steps, single_fit};
use crate::problem::noise::Noise;
use crate::problem::response::{Response, RunResponse, TimeResponse};
use crate::problem::unknowns::DerivedQuantities;
use crate::problem::{Options, Problem, ProblemRun};
use crate::work::Work;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Block, Divergence, Scheme, Simulator, Sink, Steps};
use rayon::prelude::*;

/// Starts that are drawn in place of one that cannot be simulated, at most.
const REDRAWN: usize = 16;
/// Starts that are drawn for each parameter where ranges span decades, and at most.
const CANDIDATES: usize = 32;
const MOST_CANDIDATES: usize = 512;
/// One of so many candidates goes on, by so many iterations.
const ROUNDS: [(usize, usize); 3] = [(4, 8), (16, 16), (64, 60)];
/// Iterations by what is fitted, for those that are left.
const LAST: usize = 30;
/// Implicit steps between samples for a start that the steps of the given one do not suit, or that would take more of them.
const IMPLICIT: usize = 4;

/// The start with a number from 0; the same for every count of starts and of threads. A search that is stopped gives what it has.
pub(crate) fn screened(attempt: &Attempt<'_>, spread: &Spread<'_>, number: usize) -> Vec<Vec<f64>> {
    let Attempt { model, runs, options, work, .. } = *attempt;
    let own = spread.start(number);
    if number == 0 {
        return own;
    }
    if spread.is_wide() {
        let levels = levels(runs, model.definition().outputs.len());
        return Crowd { attempt: Attempt { work: &work.quiet(), ..*attempt }, levels }.best(spread, number);
    }
    let usable = |start: &Vec<Vec<f64>>| is_usable(model, runs, start, options);
    // the fit chooses steps with more care
    let chosen = || {
        let chosen = chosen_steps(&Attempt { starts: &own, work: &Work::default(), ..*attempt });
        chosen.is_ok_and(|c| c.iter().all(|a| a.error.is_finite()))
    };
    if usable(&own) || chosen() {
        return own;
    }
    let others = (1..=REDRAWN).map(|again| spread.instead(number, again));
    others.into_iter().find(usable).unwrap_or(own)
}

/// Many starts, of which one is wanted.
struct Crowd<'c> {
    attempt: Attempt<'c>,
    /// Of magnitudes (q).
    levels: Vec<f64>,
}

/// A start and its cost.
type Member = (f64, Vec<Vec<f64>>);

impl Crowd<'_> {
    fn best(&self, spread: &Spread<'_>, number: usize) -> Vec<Vec<f64>> {
        let own = spread.start(number);
        let operations = self.operations(&own).max(1);
        let count = (CANDIDATES * spread.dimensions())
            .min(MOST_CANDIDATES)
            // steps of all runs, times states and sensitivities to each parameter, beyond which fewer candidates are
            // drawn
            .min(MOST_CANDIDATES * (1 << 20) / operations)
            .max(1);
        let drawn = |k: usize| if k == 0 { own.clone() } else { spread.instead(number, k) };
        let mut members: Vec<Member> = (0..count)
            .into_par_iter()
            .map(drawn)
            .map(|start| {
                (
                    self.problem(&start).map_or(f64::INFINITY, |mut p| cost_at(&mut p, &self.by_magnitude(0), &start)),
                    start,
                )
            })
            .collect();
        // iterations that were counted belong to the fits
        let rounds = if self.attempt.options.options.total.is_none() { &ROUNDS[..] } else { &[] };
        for (share, iterations) in rounds {
            keep(&mut members, count.div_ceil(*share));
            members = members.into_par_iter().map(|member| self.improved(member, *iterations)).collect();
        }
        if !rounds.is_empty() {
            members = members.into_par_iter().map(|member| self.fitted(member)).collect();
        }
        keep(&mut members, 1);
        members.pop().map_or(own, |(_, start)| start)
    }

    /// Numbers that one evaluation with sensitivities takes.
    fn operations(&self, start: &[Vec<f64>]) -> usize {
        let steps = self.steps(start);
        let total: usize = steps.iter().zip(self.attempt.runs).map(|(steps, run)| steps.total(run.len())).sum();
        let layout = self.attempt.model.layout();
        total * layout.states.max(1) * (1 + layout.params)
    }

    /// Steps that tell where a response runs away, and about how large it is.
    fn steps(&self, start: &[Vec<f64>]) -> Vec<Steps> {
        let FitOptions { per_interval, scheme, shared_steps, .. } = self.attempt.options;
        let implicit = || vec![Steps::equal(Scheme::Radau, IMPLICIT); self.attempt.runs.len()];
        let total =
            |steps: &[Steps]| steps.iter().zip(self.attempt.runs).map(|(s, run)| s.total(run.len())).sum::<usize>();
        let few = |steps: &Vec<Steps>| total(steps) <= total(&implicit());
        let given = || per_interval.map(|n| vec![Steps::equal(scheme.unwrap_or_default(), n); self.attempt.runs.len()]);
        given()
            .or_else(|| shared_steps.steps(self.attempt.model, self.attempt.runs, start).filter(few))
            .unwrap_or_else(implicit)
    }

    /// The problem of magnitudes; none where a run cannot be simulated.
    fn problem(&self, start: &[Vec<f64>]) -> Option<Problem<'_>> {
        let mut prepared = Vec::with_capacity(self.attempt.runs.len());
        for ((run, theta), steps) in self.attempt.runs.iter().zip(start).zip(self.steps(start)) {
            let mut simulator = Simulator::new(self.attempt.model.dynamics(), run, steps).ok()?;
            simulator.suits(theta).ok()?;
            let response = RunResponse::in_time(Magnitudes::new(simulator, &self.levels));
            let measured = of(&run.measured, &self.levels);
            prepared.push(ProblemRun { name: run.name.clone(), response, measured, start: theta.clone() });
        }
        let definition = self.attempt.model.definition();
        let derived = DerivedQuantities::of(definition, self.attempt.model.dynamics());
        let mut problem = Problem { affine: Vec::new(), ..Problem::new(definition, prepared, derived) };
        for (k, param) in problem.params.iter_mut().enumerate() {
            param.logarithmic |= param.lower > 0.0 && param.spans_decades();
            if let Some(first) = start.first().filter(|_| !param.per_run) {
                param.value = first[k];
            }
        }
        Some(problem)
    }

    /// Least squares of magnitudes.
    fn by_magnitude(&self, iterations: usize) -> Options {
        let noise = Noise::Given(vec![Some(1.0); self.levels.len()]);
        Options { noise, iterations, colour: false, ..Options::default() }
    }

    fn improved(&self, (cost, start): Member, iterations: usize) -> Member {
        let Some(mut problem) = self.problem(&start).filter(|_| self.attempt.work.goes_on() && cost.is_finite()) else {
            return (cost, start);
        };
        match estimate(&mut problem, &self.by_magnitude(iterations), self.attempt.work) {
            Ok(found) => match found.cost.filter(|found| *found < cost) {
                Some(reached) => (reached, Attempt { starts: &start, ..self.attempt }.reached(&found)),
                None => (cost, start),
            },
            Err(_) => (cost, start),
        }
    }

    /// By what is fitted; the cost is that.
    fn fitted(&self, (_, start): Member) -> Member {
        if !self.attempt.work.goes_on() {
            return (f64::INFINITY, start);
        }
        let iterations = self.attempt.options.options.iterations.min(LAST);
        let inner = Options { iterations, colour: false, ..self.attempt.options.options.clone() };
        let options = FitOptions { options: inner, ..self.attempt.options.clone() };
        match single_fit(&Attempt { starts: &start, options: &options, ..self.attempt }) {
            Ok(fit) => {
                let reached = Attempt { starts: &start, ..self.attempt }.reached(&fit.estimate);
                (fit.estimate.cost.unwrap_or(f64::INFINITY), reached)
            }
            Err(_) => (f64::INFINITY, start),
        }
    }
}

/// Keeps the best, the first of those that are equally good.
fn keep(members: &mut Vec<Member>, count: usize) {
    members.sort_by(|a, b| a.0.total_cmp(&b.0));
    members.truncate(count);
}

/// Whether a start can be simulated, by the steps of the fit.
fn is_usable(model: &Model, runs: &[Run], start: &[Vec<f64>], options: &FitOptions) -> bool {
    let given = || options.per_interval.map(|n| vec![Steps::equal(options.scheme.unwrap_or_default(), n); runs.len()]);
    let implicit = || vec![Steps::equal(Scheme::Radau, IMPLICIT); runs.len()];
    let steps = given().or_else(|| options.shared_steps.steps(model, runs, start)).unwrap_or_else(implicit);
    let reached = |((run, theta), steps): ((&Run, &Vec<f64>), Steps)| {
        let Ok(mut simulator) = Simulator::new(model.dynamics(), run, steps) else { return false };
        let mut y = vec![0.0; simulator.samples() * simulator.outputs()];
        simulator.simulate(theta, &mut y).is_ok() && y.iter().all(|y| y.is_finite())
    };
    runs.iter().zip(start).zip(steps).all(reached)
}

/// The level of an output, as a part of the median of what was measured.
const LEVEL: f64 = 0.1;

/// The response of a model by its magnitudes.
pub(crate) struct Magnitudes<'a> {
    simulator: Simulator<'a>,
    levels: &'a [f64],
}

impl<'a> Magnitudes<'a> {
    /// Magnitudes over these levels (q).
    pub(crate) fn new(simulator: Simulator<'a>, levels: &'a [f64]) -> Self {
        Self { simulator, levels }
    }
}

/// The levels of all outputs (q) that suit what was measured in all runs.
pub(crate) fn levels(runs: &[Run], q: usize) -> Vec<f64> {
    let of = |o: usize| {
        let measured = runs.iter().flat_map(|run| run.measured.iter().skip(o).step_by(q));
        let mut sizes: Vec<f64> = measured.map(|z| z.abs()).filter(|z| *z > 0.0 && z.is_finite()).collect();
        let middle = sizes.len() / 2;
        if sizes.is_empty() { 1.0 } else { LEVEL * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    (0..q).map(of).collect()
}

/// The magnitudes of values, N by q.
pub(crate) fn of(values: &[f64], levels: &[f64]) -> Vec<f64> {
    values.iter().enumerate().map(|(k, y)| magnitude(*y, levels[k % levels.len()])).collect()
}

fn magnitude(y: f64, level: f64) -> f64 {
    (y / (2.0 * level)).asinh()
}

/// Its derivative by y.
fn slope(y: f64, level: f64) -> f64 {
    1.0 / y.hypot(2.0 * level)
}

impl Response for Magnitudes<'_> {
    fn samples(&self) -> usize {
        self.simulator.samples()
    }

    fn outputs(&self) -> usize {
        self.levels.len()
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        self.simulator.simulate(theta, y)?;
        y.iter_mut().enumerate().for_each(|(k, y)| *y = magnitude(*y, self.levels[k % self.levels.len()]));
        Ok(())
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        let levels = self.levels;
        self.simulator.stream(theta, columns, &mut |block| {
            for (row, y) in block.rows.chunks_exact_mut(block.layout.length).zip(block.y.chunks_exact(levels.len())) {
                for (place, (y, level)) in block.layout.outputs.iter().zip(y.iter().zip(levels)) {
                    let slope = slope(*y, *level);
                    row[place.start..][..place.columns.len()].iter_mut().for_each(|r| *r *= slope);
                }
            }
            let y = of(block.y, levels);
            sink(Block { y: &y, ..block });
        })
    }
}

impl TimeResponse for Magnitudes<'_> {
    fn time(&self) -> Option<&[f64]> {
        Some(&self.simulator.run().time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::output_error::single::starts;
    use crate::problem::unknowns::Changes;
    use crate::recovery::multi_start;
    use fdm_numeric::halt::Stop;

    /// Grows beyond all bounds within the record where `rho` is above 0.1.
    const GROWTH: &str = "model growth {
        state P = 1, N;
        param rho = 0.05 in [1e-4, 1e3] BY, mu = 0.5 in [1e-4, 1e3] BY;
        der(P) = rho*P^2;
        der(N) = P - mu*N;
        output p = P, n = N;
        noise p = 0.01, n = 0.01;
    }";

    fn growth(by: &str) -> (Model, Vec<Run>) {
        let model = Model::from_text("growth.fdm", GROWTH.replace("BY", by)).unwrap();
        let time: Vec<f64> = (0..21).map(|k| 0.5 * f64::from(k)).collect();
        let (held, gaps) = (Vec::new(), Vec::new());
        let measured = vec![0.0; 2 * time.len()];
        let mut run = Run {
            name: "r".into(),
            time,
            inputs: Vec::new(),
            held,
            measured,
            input_gaps: gaps,
            stated: Vec::new(),
            output_gaps: vec![0; 2],
        };
        let mut measured = run.measured.clone();
        let theta = model.definition().start();
        Simulator::new(model.dynamics(), &run, 8).unwrap().simulate(&theta, &mut measured).unwrap();
        run.measured = measured;
        (model, vec![run])
    }

    #[test]
    fn starts_that_run_away_are_replaced_by_better_ones() {
        for by in ["log", ""] {
            let (model, runs) = growth(by);
            let given = starts(&model, &runs, &Changes::default());
            let options = FitOptions::default().with_declared_noise(&model);
            let spread = Spread::new(&model, &given, 3);
            assert!(spread.is_wide(), "bounds that span decades are enough");
            let screened = |number: usize| {
                screened(
                    &Attempt { model: &model, runs: &runs, starts: &given, options: &options, work: &Work::default() },
                    &spread,
                    number,
                )
            };
            assert_eq!(screened(0), given, "the given start stays");
            let mut lost = 0;
            for number in 1..7 {
                lost += usize::from(!is_usable(&model, &runs, &spread.start(number), &options));
                let found = screened(number);
                let off = |k: usize| (found[0][k] / given[0][k] - 1.0).abs();
                assert!(off(0) < 0.01 && off(1) < 0.01, "{number}: {found:?}, truth {given:?}");
                assert_eq!(found, screened(number));
            }
            assert!(lost > 1, "most draws run away: {lost}");
        }
    }

    #[test]
    fn a_search_that_is_stopped_ends_with_what_it_has() {
        let (model, runs) = growth("log");
        let given = starts(&model, &runs, &Changes::default());
        let options = FitOptions::default().with_declared_noise(&model);
        let spread = Spread::new(&model, &given, 3);
        let found = screened(
            &Attempt {
                model: &model,
                runs: &runs,
                starts: &given,
                options: &options,
                work: &Work::ended(Stop::Interrupt),
            },
            &spread,
            1,
        );
        assert!(is_usable(&model, &runs, &found, &options));
    }

    #[test]
    fn fits_from_replaced_starts_end_in_the_same_minimum() {
        let (model, runs) = growth("log");
        let given = starts(&model, &runs, &Changes::default());
        let mut options = FitOptions::default().with_declared_noise(&model);
        (options.starts.count, options.starts.seed) = (6, 1);
        let ledger = crate::work::checkpoint::CheckpointWriter::new(None);
        let found = multi_start::many_starts(
            &Attempt { model: &model, runs: &runs, starts: &given, options: &options, work: &Work::default() },
            &model,
            &ledger,
        )
        .unwrap();
        let reached = found.summaries.iter().filter(|s| s.minimum == Some(1)).count();
        assert!(reached >= 5, "{reached}: {:?}", found.summaries);
    }
}

#[cfg(test)]
mod magnitudes_tests {
    use super::*;
    use fdm_system::model::Model;

    const DECAY: &str = "model decay {
        input u;
        state x = free, v = 0;
        param k = 0.7, g = 40, o = -3;
        der(x) = -k*x + u;
        der(v) = x - v^3;
        output y = g*x, z = v + o;
    }";

    #[test]
    fn slopes_of_magnitudes_are_their_central_differences() {
        let model = Model::from_text("decay.fdm", DECAY).unwrap();
        let time: Vec<f64> = (0..9).map(|k| 0.4 * f64::from(k)).collect();
        let inputs = time.iter().map(|t| (2.0 * t).sin()).collect();
        let (q, n) = (2, time.len());
        let run = Run {
            name: "r".into(),
            time,
            inputs,
            held: vec![false],
            measured: (0..q * n).map(|k| if k == 3 { f64::NAN } else { k as f64 - 4.0 }).collect(),
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0; q],
        };
        let levels = levels(std::slice::from_ref(&run), q);
        assert!(
            (levels[0] - 0.6).abs() < 1e-12 && (levels[1] - 0.7).abs() < 1e-12,
            "{levels:?}: of 2, 2, 4, 4, 6, .. and 1, 3, 3, 5, 7, .."
        );
        let mut response = Magnitudes::new(Simulator::new(model.dynamics(), &run, 3).unwrap(), &levels);
        let theta: Vec<f64> = model.definition().start().iter().map(|p| p + 0.3).collect();
        let columns: Vec<usize> = (0..theta.len()).collect();
        let mut exact = vec![0.0; n * q * theta.len()];
        let mut seen = vec![0.0; n * q];
        response
            .sensitivities(&theta, &columns, &mut |block| {
                for sample in 0..block.samples() {
                    for o in 0..q {
                        let at = (block.first + sample) * q + o;
                        seen[at] = block.y[sample * q + o];
                        let places = &block.layout.outputs[o].columns;
                        for (column, value) in places.iter().zip(block.row(sample, o)) {
                            exact[at * theta.len() + *column as usize] = *value;
                        }
                    }
                }
            })
            .unwrap();
        let mut plain = vec![0.0; n * q];
        response.simulate(&theta, &mut plain).unwrap();
        assert_eq!(plain, seen);
        for p in columns {
            let mut at = |change: f64| {
                let (mut moved, mut y) = (theta.clone(), vec![0.0; n * q]);
                moved[p] += change;
                response.simulate(&moved, &mut y).unwrap();
                y
            };
            let (up, down) = (at(1e-5), at(-1e-5));
            for k in 0..n * q {
                let difference = (up[k] - down[k]) / 2e-5;
                let slope = exact[k * theta.len() + p];
                assert!((difference - slope).abs() < 1e-7 * (1.0 + slope.abs()), "{p} {k}: {difference} {slope}");
            }
        }
    }
}
