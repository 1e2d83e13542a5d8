//! How likely a record is beside a model: the concentrated likelihood of independent Gaussian noise, less what the values of parameters
//! would have to be.

use crate::hypothesis::{Edit, Hypothesis, Slot, column, edited};
use fdm_estimate::{Continuation, Estimate, FitOptions, Options, fit};
use fdm_system::Model;
use fdm_system::record::Run;

/// A fit of the edited record.
#[derive(Debug, Clone)]
pub(crate) struct Trial {
    /// Sum of squares of each output (q), in the record's own numbers, over its count; NaN where nothing was measured.
    squares: Vec<f64>,
    /// Independent samples that the residuals are worth (q).
    independent: Vec<f64>,
    /// What the values of parameters cost, in nats.
    values: f64,
    /// None where nothing could be simulated.
    pub(crate) estimate: Option<Estimate>,
}

/// Gaussian-noise fit of the runs with some edits; none where nothing can be simulated.
pub(crate) fn trial(model: &Model, runs: &[Run], edits: &[Edit], iterations: usize) -> Option<Trial> {
    trial_from(model, model, runs, edits, iterations)
}

/// The same with start values of `begun`: the model with the estimates of a fit that is near.
pub(crate) fn trial_from(
    model: &Model,
    begun: &Model,
    runs: &[Run],
    edits: &[Edit],
    iterations: usize,
) -> Option<Trial> {
    let new = runs.iter().map(|run| edited(run, edits, model.definition())).collect::<Result<Vec<_>, _>>().ok()?;
    let options = FitOptions {
        options: Options {
            iterations,
            total: Some(2 * iterations),
            colour: false,
            tolerance: 1e-5,
            ..Options::default()
        },
        accuracy: Some(1e-5),
        continuation: Continuation::Never,
        bare: true,
        ..FitOptions::default()
    }
    .with_declared_noise(model);
    let found = fit(begun, &new, &options, &mut ()).ok()?;
    let estimate = found.estimate;
    let q = model.layout().outputs;
    if estimate.runs.iter().all(|r| r.residuals.is_empty()) {
        return None;
    }
    let (mut squares, mut independent) = (vec![f64::NAN; q], vec![0.0; q]);
    for output in 0..q {
        let (mut sum, mut count, mut worth) = (0.0, 0usize, 0.0);
        for run in &estimate.runs {
            let e: Vec<f64> = run.residuals.iter().skip(output).step_by(q).copied().filter(|v| !v.is_nan()).collect();
            sum += e.iter().map(|v| v * v).sum::<f64>();
            count += e.len();
            worth += independent_samples(&e);
        }
        if count > 0 {
            let (source, factor) = source_of(edits, output);
            squares[source] = sum / count as f64 / factor.powi(2);
            independent[source] = worth;
        }
    }
    let values = cost_of_values(model, &estimate);
    Some(Trial { squares, independent, values, estimate: Some(estimate) })
}

/// From which output of the record the numbers of an output come, and by how much they were multiplied: residuals are compared in the
/// record's own numbers, column by column.
fn source_of(edits: &[Edit], output: usize) -> (usize, f64) {
    let (mut at, mut factor) = (Slot::Output(output), 1.0);
    for edit in edits.iter().rev() {
        match *edit {
            Edit::Affine(slot, f, _) if at == slot => factor *= f.abs(),
            Edit::Swap(a, b) if at == a => at = b,
            Edit::Swap(a, b) if at == b => at = a,
            _ => {}
        }
    }
    (if let Slot::Output(k) = at { k } else { output }, factor)
}

/// Samples over the sum of autocorrelations up to the first that is not above chance: white residuals count in full.
fn independent_samples(e: &[f64]) -> f64 {
    const LONGEST: usize = 400;
    let n = e.len();
    let power: f64 = e.iter().map(|v| v * v).sum();
    if n < 4 || power <= 0.0 {
        return n as f64;
    }
    let chance = 2.0 / (n as f64).sqrt();
    let mut sum = 1.0;
    for lag in 1..LONGEST.min(n / 3 + 1) {
        let r: f64 = e.iter().zip(&e[lag..]).map(|(a, b)| a * b).sum::<f64>() / power;
        if r < chance {
            break;
        }
        sum += 2.0 * r;
    }
    n as f64 / sum
}

/// What it costs in nats that parameters are away from where the text says they start. A Cauchy law over the logarithm of the factor (half of
/// all within a factor of two), and one start in a thousand has the wrong sign.
fn cost_of_values(model: &Model, estimate: &Estimate) -> f64 {
    const USUAL: f64 = std::f64::consts::LN_2;
    let free = model.definition().params.iter().filter(|p| !p.fixed && p.value != 0.0 && !p.per_run);
    let cost = |p: &fdm_grammar::model::Param| {
        let Some(found) = estimate.parameter(&p.quantity.name, None) else { return 0.0 };
        // a value that the record hardly determines says nothing
        if found.standard_error.is_none_or(|e| 2.0 * e > found.value.abs().max(p.value.abs())) {
            return 0.0;
        }
        let ratio = found.value / p.value;
        let size = if ratio == 0.0 { 0.0 } else { (1.0 + (ratio.abs().ln() / USUAL).powi(2)).ln() };
        size + if ratio < 0.0 { 1000f64.ln() } else { 0.0 }
    };
    free.map(cost).sum()
}

impl Trial {
    /// The model with these estimates as start values; those of each run begin as the text says.
    pub(crate) fn begun(&self, model: &Model) -> Model {
        let Some(estimate) = &self.estimate else { return model.clone() };
        let mut params = model.definition().params.clone();
        for param in params.iter_mut().filter(|p| !p.fixed && !p.per_run) {
            let found = estimate.parameter(&param.quantity.name, None).map(|p| p.value);
            let found = found.filter(|v| v.is_finite() && *v >= param.lower && *v <= param.upper);
            param.value = found.filter(|v| !param.logarithmic || *v > 0.0).unwrap_or(param.value);
        }
        model.with_params(params)
    }

    /// The outputs about their means: what a model that explains nothing leaves. None where nothing was measured.
    pub(crate) fn unexplained(model: &Model, runs: &[Run]) -> Option<Self> {
        let q = model.layout().outputs;
        let (mut squares, mut independent) = (vec![f64::NAN; q], vec![0.0; q]);
        for output in 0..q {
            let values: Vec<f64> =
                runs.iter().flat_map(|r| column(r, Slot::Output(output))).filter(|v| v.is_finite()).collect();
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            let e: Vec<f64> = values.iter().map(|v| v - mean).collect();
            if !e.is_empty() {
                squares[output] = e.iter().map(|v| v * v).sum::<f64>() / e.len() as f64;
                independent[output] = independent_samples(&e);
            }
        }
        let measured = squares.iter().any(|s| !s.is_nan());
        measured.then_some(Self { squares, independent, values: 0.0, estimate: None })
    }

    /// Gain in log-likelihood over another trial of the same record, in nats. The sums of squares count by the independent samples of the fit
    /// with the smaller one: what the other leaves is its own error.
    pub(crate) fn gain_over(&self, other: &Self) -> f64 {
        let outputs = (0..self.squares.len()).map(|k| {
            let (own, others) = (self.squares[k], other.squares[k]);
            if own.is_nan() || others.is_nan() {
                return 0.0;
            }
            let worth = if own < others { self.independent[k] } else { other.independent[k] };
            let floor = f64::MIN_POSITIVE;
            0.5 * worth * (others.max(floor) / own.max(floor)).ln()
        });
        outputs.sum::<f64>() + other.values - self.values
    }

    /// Part of the sums of squares that is left of another's, the least over the outputs.
    pub(crate) fn least_left(&self, other: &Self) -> f64 {
        let parts = self.squares.iter().zip(&other.squares).map(|(own, other)| own / other);
        parts.filter(|p| p.is_finite()).fold(1.0, f64::min)
    }

    /// Independent samples of all outputs.
    pub(crate) fn worth(&self) -> f64 {
        self.independent.iter().sum()
    }
}

/// The best value of one number by fits at three places, then at the vertex of the parabola through their likelihoods, from where it goes on
/// while it gains: the edits that it makes, the value, its error and the trial.
pub(crate) struct Searched {
    pub(crate) value: f64,
    pub(crate) error: f64,
    pub(crate) trial: Trial,
}

pub(crate) fn search(
    start: f64,
    step: f64,
    base: &Trial,
    at: &(dyn Fn(f64) -> Option<Trial> + Sync),
) -> Option<Searched> {
    const ROUNDS: usize = 6;
    let (mut middle, mut width) = ((start, base.clone()), step);
    let mut error = f64::INFINITY;
    for _ in 0..ROUNDS {
        let (left, right) = (at(middle.0 - width), at(middle.0 + width));
        let gain = |t: &Option<Trial>| t.as_ref().map_or(f64::NEG_INFINITY, |t| t.gain_over(&middle.1));
        let (l, r) = (gain(&left), gain(&right));
        if l <= 0.0 && r <= 0.0 {
            // within the bracket: the vertex
            if !l.is_finite() || !r.is_finite() {
                break;
            }
            let curvature = -(l + r) / (width * width);
            if curvature <= 0.0 {
                break;
            }
            error = 1.0 / curvature.sqrt();
            let vertex = middle.0 + 0.5 * (r - l) / width / curvature;
            if let Some(better) = at(vertex).filter(|t| t.gain_over(&middle.1) > 0.0) {
                middle = (vertex, better);
            }
            if width < 2.0 * error {
                break;
            }
            width = (0.25 * width).max(error);
        } else {
            // downhill, with longer steps
            let side = if l > r { -width } else { width };
            if let Some(better) = if l > r { left } else { right } {
                middle = (middle.0 + side, better);
            }
            width *= 1.7;
        }
    }
    (middle.0 != start).then_some(Searched { value: middle.0, error, trial: middle.1 })
}

/// Hypotheses beside the edits that were accepted before.
pub(crate) fn with<'a>(accepted: &'a [Edit], hypothesis: &'a Hypothesis) -> Vec<Edit> {
    accepted.iter().chain(&hypothesis.edits).copied().collect()
}
