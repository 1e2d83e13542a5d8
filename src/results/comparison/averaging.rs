//! Averages over models, so that intervals know that the structure was chosen.
//!
//! Weights are those of predictions of validation data: logarithms of predictive densities, summed over blocks of the runs, with the Bayesian bootstrap
//! over blocks (pseudo-BMA+; Yao, Vehtari, Simpson and Gelman, Bayesian Analysis 13, 2018). Without such data they follow Akaike's
//! criterion. An average has the mean of the models, and their scatter beside the errors of each (Buckland, Burnham and Augustin, Biometrics 53, 1997); its
//! interval is that of the mixture of normal laws. Weights by Schwarz's criterion leave out small terms more often, and averaged intervals then hold less often.
//!
//! Criteria of Akaike and Schwarz: cost against number of parameters.
//!
//! What results predict of runs that none of them was fitted to.

use super::Candidate;
use crate::store::ResultFolder;
use fdm_estimate::residuals::{Advantage, OutputFit, advantage};
use fdm_estimate::{Fit, FitError, Work, fit};
use fdm_numeric::random::Stream;
use fdm_numeric::statistics::{normal_cdf, normal_quantile};
use fdm_system::model::Model;
use fdm_system::record::Run;
use serde::{Deserialize, Serialize};

/// Draws of the bootstrap, and their seed.
const DRAWS: usize = 1000;
const SEED: u64 = 1;
/// Models below this weight are left out of averages.
const LEAST: f64 = 1e-6;

/// What weights rest on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum WeightedBy {
    /// Predictions of validation data.
    Validation,
    /// Akaike's criterion, that for coloured residuals where it is known.
    Criterion,
}

/// A parameter, averaged over the models that have it.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct AveragedParameter {
    /// Its name.
    pub name: String,
    /// The run that it belongs to; none when all share it.
    pub run: Option<String>,
    /// Its unit.
    pub unit: Option<String>,
    /// Mean over the models.
    pub value: f64,
    /// Standard error with the scatter between models.
    pub error: f64,
    /// 95 % interval of the mixture.
    pub interval: [f64; 2],
    /// Weight of the models that have it.
    pub weight: f64,
}

/// An output of a validation run, predicted by the average.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct AveragedOutput {
    /// The run.
    pub run: String,
    /// The output.
    pub name: String,
    /// Root mean square of what is left.
    pub rms: Option<f64>,
    /// Mean half width of the 95 % band of measurements.
    pub band: Option<f64>,
    /// Part of the measurements within it.
    pub within: Option<f64>,
}

/// Averages over the results of a comparison.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Averaged {
    /// What the weights rest on.
    pub by: WeightedBy,
    /// Of every result, in their order; they add up to one.
    pub weights: Vec<f64>,
    /// Parameters with an error in any model.
    pub parameters: Vec<AveragedParameter>,
    /// Outputs of validation runs; empty without such runs.
    pub outputs: Vec<AveragedOutput>,
}

impl Averaged {
    /// Of comparable results, with predictions where there are such; none where less than two have weights.
    pub(super) fn of(candidates: &[Candidate], predictions: &[Prediction], inflation: Option<f64>) -> Option<Self> {
        let by_validation = by_validation(predictions, inflation.unwrap_or(1.0));
        let (by, weights) = match by_validation {
            Some(weights) => (WeightedBy::Validation, weights),
            None => (WeightedBy::Criterion, by_criterion(candidates)?),
        };
        let outputs = if by == WeightedBy::Validation { outputs(predictions, &weights) } else { Vec::new() };
        Some(Self { by, parameters: parameters(candidates, &weights), outputs, weights })
    }
}

/// Weights by Akaike's criterion; results without one have none.
fn by_criterion(candidates: &[Candidate]) -> Option<Vec<f64>> {
    let of = |c: &Candidate| c.criteria.as_ref().map(|c| -0.5 * c.coloured_aic.unwrap_or(c.aic));
    let logs: Vec<f64> = candidates.iter().map(|c| of(c).unwrap_or(f64::NEG_INFINITY)).collect();
    let known = logs.iter().filter(|l| l.is_finite()).count();
    (known > 1).then(|| softmax(&logs))
}

/// Weights by validation runs; none where less than two results predict with a known noise.
fn by_validation(predictions: &[Prediction], inflation: f64) -> Option<Vec<f64>> {
    let densities: Vec<Option<Vec<f64>>> =
        // blocks of a run over which densities are summed
        predictions.iter().map(|p| if p.converged { p.densities(20) } else { None }).collect();
    let blocks = densities.iter().flatten().map(Vec::len).min()?;
    let same = densities.iter().flatten().all(|d| d.len() == blocks);
    if blocks == 0 || !same || densities.iter().flatten().count() < 2 {
        return None;
    }
    let mut stream = Stream::named(SEED, &["averaging"]);
    let mut weights = vec![0.0; predictions.len()];
    for _ in 0..DRAWS {
        let shares: Vec<f64> = (0..blocks).map(|_| -(1.0 - stream.uniform()).ln()).collect();
        let each = blocks as f64 / shares.iter().sum::<f64>() / inflation.max(1.0);
        let sum = |d: &Vec<f64>| each * d.iter().zip(&shares).map(|(d, s)| d * s).sum::<f64>();
        let logs: Vec<f64> = densities.iter().map(|d| d.as_ref().map_or(f64::NEG_INFINITY, sum)).collect();
        weights.iter_mut().zip(softmax(&logs)).for_each(|(w, own)| *w += own / DRAWS as f64);
    }
    Some(weights)
}

fn softmax(logs: &[f64]) -> Vec<f64> {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let parts: Vec<f64> = logs.iter().map(|l| (l - largest).exp()).collect();
    let sum: f64 = parts.iter().sum();
    parts.iter().map(|p| p / sum).collect()
}

fn parameters(candidates: &[Candidate], weights: &[f64]) -> Vec<AveragedParameter> {
    let mut found: Vec<AveragedParameter> = Vec::new();
    let with = || candidates.iter().zip(weights).filter(|(_, w)| **w > LEAST);
    for (name, run, unit) in with().flat_map(|(c, _)| c.parameters.iter().map(|p| (&p.name, &p.run, &p.unit))) {
        if found.iter().any(|f| f.name == *name && f.run == *run) {
            continue;
        }
        let own = with().filter_map(|(c, w)| {
            let p = c.parameters.iter().find(|p| p.name == *name && p.run == *run)?;
            Some(Law { weight: *w, mean: p.value, deviation: p.error()? })
        });
        let laws: Vec<Law> = own.collect();
        let Some(Mixture { mean, deviation, interval, weight }) = Mixture::of(&laws) else { continue };
        let (name, run, unit) = (name.clone(), run.clone(), unit.clone());
        found.push(AveragedParameter { name, run, unit, value: mean, error: deviation, interval, weight });
    }
    found
}

fn outputs(predictions: &[Prediction], weights: &[f64]) -> Vec<AveragedOutput> {
    let with: Vec<(&Prediction, f64)> =
        predictions.iter().zip(weights.iter().copied()).filter(|(_, w)| *w > LEAST).collect();
    let Some((first, _)) = with.first() else { return Vec::new() };
    let wide = normal_quantile(0.975);
    let one = |place: usize| {
        let all: Vec<_> = with.iter().filter_map(|(p, w)| Some((p.predicted.get(place)?, *w))).collect();
        let (own, _) = all.first()?;
        if all.len() < with.len()
            || all.iter().any(|(p, _)| p.residual.len() != own.residual.len() || p.half.len() != own.residual.len())
        {
            return None;
        }
        let (mut squares, mut halves, mut inside, mut count) = (0.0, 0.0, 0.0, 0.0);
        for k in 0..own.residual.len() {
            // residuals differ as responses do
            let left: f64 = all.iter().map(|(p, w)| w * p.residual[k]).sum();
            if !left.is_finite() {
                continue;
            }
            let variance = |(p, w): &(&PredictedOutput, f64)| {
                w * (p.half[k].powi(2) / (wide * wide) + (p.residual[k] - left).powi(2))
            };
            let half = wide * all.iter().map(variance).sum::<f64>().sqrt();
            (squares, count) = (squares + left * left, count + 1.0);
            (halves, inside) = (halves + half, inside + f64::from(u8::from(left.abs() <= half)));
        }
        let finite = |v: f64| v.is_finite().then_some(v);
        let known = halves.is_finite() && count > 0.0;
        Some(AveragedOutput {
            run: own.run.clone(),
            name: own.name.clone(),
            rms: finite((squares / count).sqrt()),
            band: finite(halves / count),
            within: known.then_some(inside / count),
        })
    };
    (0..first.predicted.len()).filter_map(one).collect()
}

/// What one model says of a number.
#[derive(Debug, Clone, Copy)]
struct Law {
    weight: f64,
    mean: f64,
    deviation: f64,
}

/// What all say together.
#[derive(Debug, Clone, Copy)]
struct Mixture {
    mean: f64,
    deviation: f64,
    interval: [f64; 2],
    /// Sum of the weights.
    weight: f64,
}

impl Mixture {
    fn of(laws: &[Law]) -> Option<Self> {
        let weight: f64 = laws.iter().map(|l| l.weight).sum();
        let finite = laws.iter().all(|l| l.mean.is_finite() && l.deviation.is_finite() && l.deviation > 0.0);
        if weight <= 0.0 || !finite {
            return None;
        }
        let mean = laws.iter().map(|l| l.weight * l.mean).sum::<f64>() / weight;
        let square = |l: &Law| l.weight * (l.deviation.powi(2) + (l.mean - mean).powi(2));
        let deviation = (laws.iter().map(square).sum::<f64>() / weight).sqrt();
        let below =
            |x: f64| laws.iter().map(|l| l.weight * normal_cdf((x - l.mean) / l.deviation)).sum::<f64>() / weight;
        let at = |share: f64| {
            let edge = |sign: f64| laws.iter().map(move |l| l.mean + sign * 9.0 * l.deviation);
            let (mut low, mut high) =
                (edge(-1.0).fold(f64::INFINITY, f64::min), edge(1.0).fold(f64::NEG_INFINITY, f64::max));
            for _ in 0..100 {
                let middle = 0.5 * (low + high);
                if below(middle) < share { low = middle } else { high = middle }
            }
            0.5 * (low + high)
        };
        Some(Self { mean, deviation, interval: [at(0.025), at(0.975)], weight })
    }
}

/// Twice the cost and what parameters cost, each as its difference to the least of all that are comparable.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
pub struct Criteria {
    /// Akaike's: two for each parameter; as if residuals were white.
    pub aic: f64,
    /// Schwarz's: log N for each parameter; as if residuals were white.
    pub bic: f64,
    /// Akaike's with costs over the inflation of coloured residuals (quasi-AIC of Burnham and Anderson); none where that is not known.
    pub coloured_aic: Option<f64>,
    /// Schwarz's, with costs and N over the inflation.
    pub coloured_bic: Option<f64>,
}

/// Fills in what the costs say; returns the inflation, which is that of the richest model: what the poorer ones leave is partly their own
/// error, not noise.
pub(super) fn judge(candidates: &mut [Candidate]) -> Option<f64> {
    let inflation = {
        let comparable = || candidates.iter().filter(|c| c.incomparable.is_none());
        let richest = comparable().max_by_key(|c| c.unknowns)?;
        richest.inflation.map(|c| c.max(1.0))
    };
    for candidate in candidates.iter_mut().filter(|c| c.incomparable.is_none()) {
        let Some(cost) = candidate.cost else { continue };
        let (k, n) = (candidate.unknowns as f64, candidate.samples.max(1) as f64);
        candidate.criteria = Some(Criteria {
            aic: 2.0 * cost + 2.0 * k,
            bic: 2.0 * cost + k * n.ln(),
            coloured_aic: inflation.map(|c| 2.0 * cost / c + 2.0 * k),
            coloured_bic: inflation.map(|c| 2.0 * cost / c + k * (n / c).max(1.0).ln()),
        });
    }
    let all = || candidates.iter().filter_map(|c| c.criteria);
    let least = |of: &dyn Fn(Criteria) -> Option<f64>| all().filter_map(of).fold(f64::INFINITY, f64::min);
    let (aic, bic) = (least(&|c| Some(c.aic)), least(&|c| Some(c.bic)));
    let (coloured_aic, coloured_bic) = (least(&|c| c.coloured_aic), least(&|c| c.coloured_bic));
    for own in candidates.iter_mut().filter_map(|c| c.criteria.as_mut()) {
        (own.aic, own.bic) = (own.aic - aic, own.bic - bic);
        own.coloured_aic = own.coloured_aic.map(|v| v - coloured_aic);
        own.coloured_bic = own.coloured_bic.map(|v| v - coloured_bic);
    }
    inflation
}

/// What a result predicts of validation runs, initial states and biases found anew.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Prediction {
    /// The name of the result.
    pub name: String,
    /// How well each output of each run is met.
    pub outputs: Vec<OutputFit>,
    /// Parameters of runs that had to be found for it.
    pub own_parameters: usize,
    /// Whether these were found.
    pub converged: bool,
    /// Residuals by run and output.
    #[serde(skip)]
    residuals: Vec<(String, String, Vec<f64>)>,
    /// Residuals with their bands, as far as these are known.
    #[serde(skip)]
    pub(super) predicted: Vec<PredictedOutput>,
}

/// An output of a run that was predicted.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PredictedOutput {
    pub(super) run: String,
    pub(super) name: String,
    /// Measured less predicted (N).
    pub(super) residual: Vec<f64>,
    /// Half width of the 95 % band of measurements (N).
    pub(super) half: Vec<f64>,
}

/// The best prediction of an output beside another one.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Edge {
    /// The output.
    pub output: String,
    /// The result that meets it best, all runs together.
    pub best: String,
    /// The other result.
    pub other: String,
    /// By how much it is better, and whether that could be chance; none where too little is independent.
    pub advantage: Option<Advantage>,
}

/// Predicts runs by a result; the fit that was made for it, too.
///
/// # Errors
/// [`FitError`], as any fit in the time domain.
pub fn predict(
    name: &str,
    folder: &ResultFolder,
    model: &Model,
    runs: &[Run],
    work: &Work<'_>,
) -> Result<(Prediction, Fit), FitError> {
    let mut options = folder.validation(model);
    options.options.colour = false;
    let found = fit(model, runs, &options, work)?;
    let estimate = &found.estimate;
    let outputs = &found.model.definition().outputs;
    let q = outputs.len();
    let of_run = |run: &fdm_estimate::RunFit| {
        let column = |o: usize| run.residuals.iter().skip(o).step_by(q).copied().collect();
        let named = outputs.iter().enumerate();
        named.map(|(o, output)| (run.run.clone(), output.quantity.name.clone(), column(o))).collect::<Vec<_>>()
    };
    let prediction = Prediction {
        name: name.into(),
        own_parameters: estimate.covered.len(),
        converged: estimate.termination.is_good(),
        residuals: estimate.runs.iter().flat_map(of_run).collect(),
        outputs: estimate.outputs.clone(),
        predicted: Vec::new(),
    };
    Ok((prediction, found))
}

/// For every output of the first result the best prediction beside each other one.
pub(super) fn edges(predictions: &[Prediction]) -> Vec<Edge> {
    let Some(first) = predictions.first() else { return Vec::new() };
    let mut names: Vec<&String> = Vec::new();
    for (_, output, _) in &first.residuals {
        if !names.contains(&output) {
            names.push(output);
        }
    }
    let mut found = Vec::new();
    for output in names {
        let with: Vec<&Prediction> = predictions.iter().filter(|p| p.square(output).is_finite()).collect();
        let square = |p: &&Prediction| p.square(output);
        let Some(best) = with.iter().copied().min_by(|a, b| square(a).total_cmp(&square(b))) else { continue };
        for other in with.into_iter().filter(|p| p.name != best.name) {
            let advantage = advantage(&best.beside(other, output));
            let (best, other) = (best.name.clone(), other.name.clone());
            found.push(Edge { output: output.clone(), best, other, advantage });
        }
    }
    found
}

impl Prediction {
    /// Adds the half widths of the 95 % bands of measurements (N by q), run by run in the order of the runs; none of a run without.
    #[must_use]
    pub fn with_bands(mut self, bands: &[Option<Vec<f64>>]) -> Self {
        let outputs = self.residuals.len() / bands.len().max(1);
        let one = |(k, (run, name, residual)): (usize, &(String, String, Vec<f64>))| {
            let own = bands.get(k / outputs.max(1)).and_then(Option::as_ref);
            let half =
                own.map_or(Vec::new(), |b| b.iter().skip(k % outputs.max(1)).step_by(outputs).copied().collect());
            PredictedOutput { run: run.clone(), name: name.clone(), residual: residual.clone(), half }
        };
        self.predicted = self.residuals.iter().enumerate().map(one).collect();
        self
    }

    /// Logarithms of the densities of what was measured, summed over so many blocks of each run; none where a band is not known.
    pub(super) fn densities(&self, blocks: usize) -> Option<Vec<f64>> {
        let wide = normal_quantile(0.975);
        let mut runs: Vec<&str> = Vec::new();
        let mut sums: Vec<f64> = Vec::new();
        for output in self.predicted.iter().filter(|p| p.residual.iter().any(|v| !v.is_nan())) {
            let at = runs.iter().position(|run| *run == output.run).unwrap_or_else(|| {
                runs.push(&output.run);
                sums.resize(runs.len() * blocks, 0.0);
                runs.len() - 1
            });
            let n = output.residual.len();
            for (k, left) in output.residual.iter().enumerate().filter(|(_, v)| !v.is_nan()) {
                let deviation = output.half.get(k).filter(|h| h.is_finite() && **h > 0.0)? / wide;
                sums[at * blocks + k * blocks / n] -= deviation.ln() + 0.5 * (left / deviation).powi(2);
            }
        }
        (!sums.is_empty()).then_some(sums)
    }

    /// Mean square of what is left of an output; NaN where there is none.
    fn square(&self, output: &str) -> f64 {
        let own = self.residuals.iter().filter(|(_, name, _)| name == output);
        let values = own.flat_map(|(_, _, values)| values).filter(|v| !v.is_nan());
        let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + v * v, count + 1.0));
        sum / count
    }

    /// Residuals of an output beside those of another prediction, run by run.
    fn beside(&self, other: &Self, output: &str) -> Vec<(Vec<f64>, Vec<f64>)> {
        let own = self.residuals.iter().filter(|(_, name, _)| name == output);
        let pair = |(run, name, values): &(String, String, Vec<f64>)| {
            let same = other.residuals.iter().find(|(r, n, v)| r == run && n == name && v.len() == values.len())?;
            Some((values.clone(), same.2.clone()))
        };
        own.filter_map(pair).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mixture_has_the_mean_scatter_and_quantiles_of_its_laws() {
        let one = Mixture::of(&[Law { weight: 0.4, mean: 2.0, deviation: 0.5 }]).unwrap();
        assert!((one.interval[1] - 2.0 - 0.979_982).abs() < 1e-5 && (one.deviation - 0.5).abs() < 1e-15);
        let both = [Law { weight: 0.5, mean: -3.0, deviation: 0.1 }, Law { weight: 0.5, mean: 3.0, deviation: 0.1 }];
        let both = Mixture::of(&both).unwrap();
        assert!(both.mean.abs() < 1e-12 && (both.deviation - (0.01f64 + 9.0).sqrt()).abs() < 1e-12);
        // the 5 % and 95 % quantiles of either
        assert!((both.interval[1] - 3.0 - 0.164_485).abs() < 1e-5, "{both:?}");
        assert!(Mixture::of(&[]).is_none());
    }

    /// Least squares of y on columns: estimates, their variances, sum of squares.
    fn regressed(columns: &[&[f64]], y: &[f64]) -> (f64, f64, f64) {
        let n = y.len() as f64;
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let u = columns[0];
        match columns.get(1) {
            None => {
                let a = dot(u, y) / dot(u, u);
                let left: f64 = u.iter().zip(y).map(|(u, y)| (y - a * u).powi(2)).sum();
                (a, (left / (n - 1.0) / dot(u, u)).sqrt(), left)
            }
            Some(v) => {
                let (uu, uv, vv) = (dot(u, u), dot(u, v), dot(v, v));
                let d = uu * vv - uv * uv;
                let (a, b) = ((vv * dot(u, y) - uv * dot(v, y)) / d, (uu * dot(v, y) - uv * dot(u, y)) / d);
                let left: f64 = (0..y.len()).map(|k| (y[k] - a * u[k] - b * v[k]).powi(2)).sum();
                (a, (left / (n - 2.0) * vv / d).sqrt(), left)
            }
        }
    }

    #[test]
    fn averaged_intervals_hold_where_those_of_the_chosen_model_do_not() {
        // y = u + b v with v much like u, and b so small that Akaike's criterion often leaves it out
        let mut stream = Stream::seeded(3);
        let n = 60;
        let (mut chosen, mut averaged) = (0, 0);
        for _ in 0..1000 {
            let u: Vec<f64> = (0..n).map(|_| stream.normal()).collect();
            let v: Vec<f64> = u.iter().map(|u| 0.8 * u + 0.6 * stream.normal()).collect();
            let y: Vec<f64> = u.iter().zip(&v).map(|(u, v)| u + 0.35 * v + stream.normal()).collect();
            let fits = [regressed(&[&u], &y), regressed(&[&u, &v], &y)];
            let criterion = |k: f64, left: f64| f64::from(n) * (left / f64::from(n)).ln() + 2.0 * k;
            let logs = [-0.5 * criterion(1.0, fits[0].2), -0.5 * criterion(2.0, fits[1].2)];
            let weights = softmax(&logs);
            let best = &fits[usize::from(logs[1] > logs[0])];
            chosen += u32::from((best.0 - 1.0).abs() <= 1.96 * best.1);
            let laws: Vec<Law> =
                fits.iter().zip(&weights).map(|(f, w)| Law { weight: *w, mean: f.0, deviation: f.1 }).collect();
            let [low, high] = Mixture::of(&laws).unwrap().interval;
            averaged += u32::from((low..=high).contains(&1.0));
        }
        assert!(
            averaged >= 900 && averaged > chosen + 100,
            "of 1000 averaged intervals {averaged} hold, of chosen ones {chosen}"
        );
    }
}
