//! What results predict of runs that none of them was fitted to.

use crate::store::ResultFolder;
use fdm_estimate::residuals::{Advantage, OutputFit, advantage};
use fdm_estimate::{Fit, FitError, Work, fit};
use fdm_numeric::statistics::normal_quantile;
use fdm_system::model::Model;
use fdm_system::record::Run;
use serde::{Deserialize, Serialize};

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
