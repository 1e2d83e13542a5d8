//! Whether inputs were held between samples: of an input about which nobody said it, the likelihood compares both.
//!
//! A Gauss-Newton step or two lead from the estimates to those with the input the other way. The two fits are no special cases of each other and have as many
//! parameters, so that their likelihoods compare as they are. With e the residuals of one, e - d those of the other and white noise of variance s^2,
//! the logarithm of their ratio is normal with mean `+-|d|^2/2s^2` and variance `|d|^2/s^2`. Coloured noise leaves the mean and makes the variance
//! `d'R d/s^4`, R its autocovariances: what the same difference then says is its likelihood ratio under these two normal laws, the white
//! one divided by `d'R d/(s^2 d'd)` (the power of the noise where the responses differ, beside its mean power).

use crate::estimation::ParameterEstimate;
use crate::estimation::solve::{NearMaximum, near_maximum};
use crate::examined::input_interpolation::{EstimateMove, InputInterpolation};
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::options::Attempt;
use crate::methods::output_error::options::FitOptions;
use crate::methods::output_error::single::weights;
use crate::problem::Problem;
use crate::residuals::autoregression::of_series;
use crate::residuals::residuals;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::record::even_grid::EvenGrid;
use fdm_system::simulate::{Simulator, Steps};

/// Standard errors that no estimate can move by, below which both ways are the same.
const NEGLIGIBLE: f64 = 0.1;
/// What a further step must promise to gain, in nats: the remark begins at 4.6 of them, and what is left to go is then a fifth of a standard error at most.
const LEAST_GAIN: f64 = 0.02;
/// Standard errors from which the residuals are said to ask for more than twice the difference.
const SIGNIFICANT: f64 = 3.0;

/// Compares both ways of every input that nobody stated, of a converged fit of plain squares; `reached` begins at the
/// estimates. Less than all where the work is to end.
pub(crate) fn compare(fit: &Fit, reached: &Attempt<'_>) -> Vec<InputInterpolation> {
    let Attempt { runs, starts: thetas, options, work, .. } = *reached;
    let mut found = Vec::new();
    for input in unknown(&fit.model, runs) {
        if !work.goes_on() {
            break;
        }
        let held = runs.iter().any(|run| run.held[input] && !run.is_stated(input));
        let Some(others) = otherwise(&fit.model, runs, input, !held) else { continue };
        if !differs(fit, &others, thetas) {
            continue;
        }
        let name = &fit.model.definition().inputs[input].quantity.name;
        work.doing(&format!("comparing `{name}` {}", if held { "in straight lines" } else { "held between samples" }));
        let options = FitOptions { bare: true, ..options.clone() };
        let steps: Vec<Steps> = fit.integration.iter().map(|a| a.steps.clone()).collect();
        let Ok(problem) = (Attempt { runs: &others, options: &options, ..*reached }).problem(&steps) else { continue };
        let mut problem = Problem { smoothness: weights(&fit.estimate), ..problem };
        let Some(other) = near_maximum(&mut problem, &options.options, LEAST_GAIN) else { continue };
        found.extend(judged(name, held, (fit, &other), runs));
    }
    found
}

/// The names of these inputs, of a fit that does not compare both ways.
pub(crate) fn uncompared(model: &Model, runs: &[Run]) -> Vec<String> {
    unknown(model, runs).into_iter().map(|k| model.definition().inputs[k].quantity.name.clone()).collect()
}

/// Declared inputs that move and of which nobody said how, in some run.
fn unknown(model: &Model, runs: &[Run]) -> Vec<usize> {
    let inputs = &model.definition().inputs;
    let asked = |k: &usize| {
        let jumps = |i: &fdm_grammar::model::Input| i.slope.is_some_and(|s| s.of as usize == *k);
        let moves = |run: &&Run| {
            let mut values = run.inputs.iter().skip(*k).step_by(run.held.len().max(1));
            let first = values.next();
            values.any(|v| Some(v) != first)
        };
        // an input that jumps has no derivative
        !inputs.iter().any(jumps) && runs.iter().filter(|run| !run.is_stated(*k)).any(|run| moves(&run))
    };
    (0..inputs.len()).filter(|k| inputs[*k].is_declared() && !inputs[*k].known).filter(asked).collect()
}

/// The runs with an input held or not where nobody said it; none where they then cannot drive the model.
fn otherwise(model: &Model, runs: &[Run], input: usize, held: bool) -> Option<Vec<Run>> {
    let change = |run: &Run| {
        let mut other = run.clone();
        if !run.is_stated(input) {
            other.held[input] = held;
        }
        other.with_measured(model.definition()).ok()
    };
    runs.iter().map(change).collect()
}

/// Whether the responses differ so far that an estimate could move: none does by more standard errors than the norm of the difference in
/// deviations of the noise.
fn differs(fit: &Fit, others: &[Run], thetas: &[Vec<f64>]) -> bool {
    let q = fit.model.layout().outputs;
    let Some(noise) = fit.estimate.noise.as_ref().filter(|noise| noise.size == q) else { return false };
    let mut square = 0.0;
    for (((run, theta), result), accuracy) in others.iter().zip(thetas).zip(&fit.estimate.runs).zip(&fit.integration) {
        let Ok(mut simulator) = Simulator::new(fit.model.dynamics(), run, accuracy.steps.clone()) else { return false };
        let mut y = vec![0.0; result.response.len()];
        if simulator.simulate(theta, &mut y).is_err() {
            return false;
        }
        for (cell, (y, was)) in y.iter().zip(&result.response).enumerate().filter(|(k, _)| !run.measured[*k].is_nan()) {
            let variance = noise.at(cell % q, cell % q);
            square += if variance > 0.0 { (y - was).powi(2) / variance } else { 0.0 };
        }
    }
    square.sqrt() > NEGLIGIBLE
}

/// What two fits of the same samples say.
fn judged(input: &str, held: bool, (fit, other): (&Fit, &NearMaximum), runs: &[Run]) -> Option<InputInterpolation> {
    let now = &fit.estimate;
    let white = now.cost? - other.cost;
    let of = |r: usize| residuals(&runs[r].measured, &other.responses[r]);
    let others: Vec<Vec<f64>> = (0..runs.len()).map(of).collect();
    let own: Vec<&[f64]> = now.runs.iter().map(|r| &r.residuals[..]).collect();
    let better: Vec<&[f64]> = if white > 0.0 { others.iter().map(|r| &r[..]).collect() } else { own.clone() };
    let q = fit.model.layout().outputs;
    let (mut size, mut spread, mut asked) = (0.0, 0.0, 0.0);
    for o in 0..q {
        let column = |residuals: &[f64]| residuals.iter().skip(o).step_by(q).copied().collect::<Vec<f64>>();
        let (mut sum, mut count) = (0.0, 0.0);
        for e in better.iter().flat_map(|r| column(r)).filter(|e| !e.is_nan()) {
            (sum, count) = (sum + e * e, count + 1.0);
        }
        let variance: f64 = sum / count;
        if variance.is_nan() || variance <= 0.0 {
            continue;
        }
        for (r, run) in runs.iter().enumerate() {
            let (from, to) = (column(own[r]), column(&others[r]));
            let difference: Vec<f64> =
                from.iter().zip(&to).map(|(a, b)| if (a - b).is_nan() { 0.0 } else { a - b }).collect();
            let grid = EvenGrid::of_compared(&run.time, |k| run.is_compared(k))
                .unwrap_or_else(|_| EvenGrid::counted(run.len()));
            let colour = of_series(&grid.spread(column(better[r]).into_iter()));
            let mut filtered: Vec<f64> = grid.spread(difference.iter().copied());
            filtered.iter_mut().filter(|v| v.is_nan()).for_each(|v| *v = 0.0);
            colour.backward_series(&mut filtered);
            size += difference.iter().map(|d| d * d).sum::<f64>() / variance;
            spread += colour.variance * filtered.iter().map(|b| b * b).sum::<f64>() / (variance * variance);
            asked +=
                from.iter().zip(&difference).filter(|(e, _)| !e.is_nan()).map(|(e, d)| e * d).sum::<f64>() / variance;
        }
    }
    let counts = if spread > size && size > 0.0 { size / spread } else { 1.0 };
    let (asked, error) = (asked / size, spread.max(size).sqrt() / size);
    Some(InputInterpolation {
        input: input.into(),
        held,
        evidence: white * counts,
        white,
        moves: largest_move(fit, other, runs),
        asked: (asked - 2.0 > SIGNIFICANT * error).then_some(asked),
    })
}

/// The estimate that moves furthest in its standard errors.
fn largest_move(fit: &Fit, other: &NearMaximum, runs: &[Run]) -> Option<EstimateMove> {
    let definition = fit.model.definition();
    let moved = |p: &ParameterEstimate| {
        let error = p.corrected_error.or(p.standard_error).filter(|error| *error > 0.0)?;
        let run = p.run.as_ref().map_or(Some(0), |name| runs.iter().position(|run| run.name == *name))?;
        let value = other.theta.get(run)?[definition.param(&p.name)?];
        let standard_errors = (value - p.value) / error;
        standard_errors.is_finite().then(|| EstimateMove {
            parameter: p.name.clone(),
            run: p.run.clone(),
            value,
            standard_errors,
        })
    };
    let size = |m: &EstimateMove| m.standard_errors.abs();
    fit.estimate.parameters.iter().filter_map(moved).max_by(|a, b| size(a).total_cmp(&size(b)))
}
