//! The start of each of many fits: one that can be simulated and, where ranges span decades, the best of many that are only simulated.

use crate::derived::DerivedQuantities;
use crate::output_error::options::FitOptions;
use crate::output_error::single::chosen_steps;
use crate::problem::{Problem, ProblemRun};
use crate::recovery::spread::Spread;
use crate::solve::cost_at;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Scheme, Simulator, Steps};

/// Starts that are drawn in place of one that cannot be simulated, at most.
const REDRAWN: usize = 16;
/// Starts that are simulated for each parameter where ranges span decades, and at most.
const CANDIDATES: usize = 32;
const MOST_CANDIDATES: usize = 512;
/// Implicit steps between samples for a start that the steps of the given one do not suit.
const IMPLICIT: usize = 4;

/// The start with a number from 0; the same for every count of starts and of threads.
pub(crate) fn screened(
    model: &Model,
    runs: &[Run],
    spread: &Spread<'_>,
    number: usize,
    options: &FitOptions,
) -> Vec<Vec<f64>> {
    let own = spread.start(number);
    if number == 0 {
        return own;
    }
    if !spread.is_wide() {
        let usable = |start: &Vec<Vec<f64>>| cost_of(model, runs, start, options).is_finite();
        // the fit chooses steps with more care
        let chosen = || chosen_steps(model, runs, &own, options).is_ok_and(|c| c.iter().all(|a| a.error.is_finite()));
        if usable(&own) || chosen() {
            return own;
        }
        let others = (1..=REDRAWN).map(|attempt| spread.instead(number, attempt));
        return others.into_iter().find(usable).unwrap_or(own);
    }
    let count = (CANDIDATES * spread.dimensions()).min(MOST_CANDIDATES);
    let mut best = (cost_of(model, runs, &own, options), own);
    for attempt in 1..count {
        let start = spread.instead(number, attempt);
        let cost = cost_of(model, runs, &start, options);
        if cost < best.0 {
            best = (cost, start);
        }
    }
    best.1
}

/// The cost at a start; infinite where it cannot be simulated.
fn cost_of(model: &Model, runs: &[Run], start: &[Vec<f64>], options: &FitOptions) -> f64 {
    let given = || options.per_interval.map(|n| vec![Steps::equal(options.scheme.unwrap_or_default(), n); runs.len()]);
    let shared = || options.shared_steps.steps(model, runs, start);
    // a few implicit steps tell where a response runs away, and about how large it is
    let implicit = || vec![Steps::equal(Scheme::Radau, IMPLICIT); runs.len()];
    let steps = given().or_else(shared).unwrap_or_else(implicit);
    let mut prepared = Vec::with_capacity(runs.len());
    for ((run, theta), steps) in runs.iter().zip(start).zip(steps) {
        let Ok(simulator) = Simulator::new(model.dynamics(), run, steps) else { return f64::INFINITY };
        let (name, measured, start) = (run.name.clone(), run.measured.clone(), theta.clone());
        prepared.push(ProblemRun { name, response: Box::new(simulator), measured, start });
    }
    let derived = DerivedQuantities::of(model.definition(), model.dynamics());
    let mut problem = Problem::new(model.definition(), prepared, derived);
    cost_at(&mut problem, &options.options, start)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::changes::Changes;
    use crate::output_error::single::starts;
    use crate::recovery::multi_start;

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
            assert_eq!(screened(&model, &runs, &spread, 0, &options), given, "the given start stays");
            let mut lost = 0;
            for number in 1..7 {
                let own = cost_of(&model, &runs, &spread.start(number), &options);
                let found = screened(&model, &runs, &spread, number, &options);
                let cost = cost_of(&model, &runs, &found, &options);
                lost += usize::from(own.is_infinite());
                assert!(cost.is_finite() && cost <= own, "{number}: {cost} {own}");
                assert_eq!(found, screened(&model, &runs, &spread, number, &options));
            }
            assert!(lost > 1, "most draws run away: {lost}");
        }
    }

    #[test]
    fn fits_from_replaced_starts_end_in_the_same_minimum() {
        let (model, runs) = growth("log");
        let given = starts(&model, &runs, &Changes::default());
        let mut options = FitOptions::default().with_declared_noise(&model);
        (options.starts.count, options.starts.seed) = (6, 1);
        let ledger = crate::recovery::checkpoint::CheckpointWriter::new(None);
        let found = multi_start::many_starts(&model, &runs, &given, &options, &ledger, &mut ()).unwrap();
        let reached = found.summaries.iter().filter(|s| s.minimum == Some(1)).count();
        assert!(reached >= 5, "{reached}: {:?}", found.summaries);
    }
}
