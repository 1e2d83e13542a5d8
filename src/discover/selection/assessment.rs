//! What speaks for a disturbance or an unknown cause, beside the effects that were accepted.
//!
//! What the accepted effects gain, run by run and output by output, by one noise.

use super::error::DiagnosisError;
use super::fitted_model::{FittedModel, records};
use super::forward_step::weigh;
use super::predictor::Predictor;
use super::runs::{Runs, at_rows, sampling};
use super::whitening::CommonNoise;
use crate::bins::{Record, Signals};
use crate::diagnosis::{Biased, OutputGain, Overlay, RunGain};
use crate::disturbance::{
    Attribution, Explained, FittedRun, ResidualEvidence, Suggestions, attribute, residual_evidence, suggestions,
};
use crate::lack_of_fit::{BinnedResidual, LackOfFit, RunResidual, lack_of_fit, lack_of_fit_of_bins};
use fdm_estimate::{OutputFit, ParameterEstimate};
use fdm_system::model::Model;
use fdm_system::record::Run;
use std::borrow::Cow;

/// A model at its fit with the records of its runs.
pub(super) struct ResidualRecords<'a> {
    current: &'a FittedModel,
    runs: Cow<'a, [Run]>,
    train: usize,
    predictors: Cow<'a, [Predictor]>,
    theta: &'a [Vec<f64>],
    records: Vec<Record>,
}

impl<'a> ResidualRecords<'a> {
    /// All runs at these values: what is left is asked of validation runs as well, the fitted parameters free in all of them.
    /// Its noise grows with the signals as this one does.
    pub(super) fn new(
        current: &'a FittedModel,
        runs: Runs<'a>,
        theta: &'a [Vec<f64>],
        noise: &CommonNoise,
    ) -> Result<Self, DiagnosisError> {
        let mut records = records(&current.model, runs.all, &current.predictors, theta)?;
        weigh(&mut records, runs.all, noise.growths());
        let (mut own, mut predictors) = (Cow::Borrowed(runs.all), Cow::Borrowed(&current.predictors[..]));
        // rows that are there for their inputs alone are no samples of a residual
        if records.iter().any(|record| record.rows.as_ref().is_some_and(|rows| rows.uneven().is_some())) {
            let of = |(run, record): (&Run, &mut Record)| match record.where_measured(current.outputs()) {
                Some(rows) => at_rows(run, &rows),
                None => run.clone(),
            };
            let measured: Vec<Run> = runs.all.iter().zip(&mut records).map(of).collect();
            predictors = Cow::Owned(Predictor::all(&current.model, Runs { all: &measured, ..runs }, theta)?);
            own = Cow::Owned(measured);
        }
        Ok(Self { current, runs: own, train: runs.train, predictors, theta, records })
    }

    fn passages<'b>(&'b self) -> Vec<FittedRun<'b>> {
        let parts = self.runs.iter().zip(&*self.predictors).zip(self.theta.iter().zip(&self.records));
        let of = |((run, predictor), (theta, record)): ((_, &'b Predictor), (&'b Vec<f64>, _))| {
            Some(FittedRun { run, steps: predictor.steps()?, theta, record })
        };
        parts.filter_map(of).collect()
    }

    /// What is wrong, in every output, on the training runs.
    pub(super) fn lack_of_fit(&self) -> Vec<LackOfFit> {
        let predictors = self.predictors.iter().zip(&self.records).take(self.train);
        let bins: Vec<BinnedResidual> =
            predictors.filter_map(|(predictor, record)| predictor.passage(record)).collect();
        if !bins.is_empty() {
            return lack_of_fit_of_bins(&self.current.model, &bins);
        }
        let mut left = Vec::new();
        for (run, record) in self.runs.iter().zip(&self.records).take(self.train) {
            left.push(RunResidual { run, residual: &record.residual, interval: record.interval });
        }
        lack_of_fit(&self.current.model, &left)
    }

    /// Where a disturbance would enter, and whether residuals are noise; none where that cannot be asked.
    pub(super) fn evidence(&self) -> Option<ResidualEvidence> {
        residual_evidence(&self.current.model, &self.passages()).ok()
    }

    /// Functions of states and inputs that the residuals look like.
    pub(super) fn suggestions(&self) -> Option<Suggestions> {
        suggestions(&self.current.model, &self.passages()).ok()
    }
}

/// Weighs what was accepted, with so many parameters, against a disturbance and the unknown.
pub(super) fn against(
    model: &Model,
    base: &ResidualEvidence,
    accepted: Option<(&ResidualEvidence, usize)>,
) -> Attribution {
    attribute(model, base, accepted.map(|(evidence, params)| Explained { evidence, params }))
}

/// A gain in log-likelihood from one whitened residual to another, and its variance: that of r'd - d'd/2, with d what is between them and r
/// noise of what the second one leaves. (The spread over bins would be as large as the gain where a single bin, that of the mean, has it all.)
pub(super) struct LikelihoodGain {
    pub(super) gain: f64,
    pub(super) variance: f64,
}

impl LikelihoodGain {
    pub(super) fn new(before: &[f64], after: &[f64]) -> Self {
        let pairs = || before.iter().zip(after);
        let gain = pairs().map(|(a, b)| 0.5 * (a * a - b * b)).sum();
        let left = after.iter().map(|b| b * b).sum::<f64>() / after.len().max(1) as f64;
        Self { gain, variance: left.max(1.0) * pairs().map(|(a, b)| (a - b).powi(2)).sum::<f64>() }
    }
}

/// The gain in log-likelihood of each run from one response to another.
pub(super) fn run_gains(
    runs: &[Run],
    train: usize,
    predictors: &[Predictor],
    (before, after): (&[Signals], &[Signals]),
    noise: &CommonNoise,
) -> Vec<RunGain> {
    let of = |(r, run): (usize, &Run)| {
        let outputs = run.measured.len() / run.len().max(1);
        let noise = if r < train { noise } else { noise.for_validation() };
        let mut whitener = predictors[r].whitener(run, outputs, noise);
        let mut bins = |response: &[f64]| whitener.whitened(&predictors[r].left_by(run, response));
        let (a, b) = (bins(&before[r]), bins(&after[r]));
        let LikelihoodGain { gain, variance } = LikelihoodGain::new(&a, &b);
        RunGain { run: run.name.clone(), validation: r >= train, gain, deviation: variance.sqrt() }
    };
    runs.iter().enumerate().map(of).collect()
}

/// How each output of each run is matched by two responses; the noise was found in the samples of `told_by`.
pub(super) fn output_gains(
    model: &Model,
    (runs, train): (&[Run], usize),
    predictors: &[Predictor],
    (before, after): (&[Signals], &[Signals]),
    (noise, told_by): (&CommonNoise, &[Run]),
) -> Vec<OutputGain> {
    let outputs = &model.definition().outputs;
    let q = outputs.len();
    let mut found = Vec::with_capacity(runs.len() * q);
    for (r, run) in runs.iter().enumerate() {
        let (measured, frequencies) = (predictors[r].measured(run), predictors[r].frequencies());
        let noise = if r < train { noise } else { noise.for_validation() };
        // bins of a band: what they have together is spread over all samples
        let spread = frequencies.as_ref().map_or(1.0, |f| (f.len() as f64 / run.len() as f64).sqrt());
        for (o, output) in outputs.iter().enumerate() {
            let name = &output.quantity.name;
            let fit = |response: &[f64]| OutputFit::new(name, &run.name, &measured, response, o, q);
            let (a, b) = (fit(&before[r]), fit(&after[r]));
            found.push(OutputGain {
                run: run.name.clone(),
                validation: r >= train,
                output: name.clone(),
                unit: output.quantity.unit.as_ref().map(ToString::to_string),
                rms_before: a.rms.map(|rms| spread * rms),
                rms_after: b.rms.map(|rms| spread * rms),
                noise_level: match &frequencies {
                    Some(own) => spread * noise.floor_of(o, own),
                    None => {
                        let (n, interval) = sampling(&told_by[r], (o, q));
                        noise.floor(o, n, interval)
                    }
                },
                tic_before: a.tic,
                tic_after: b.tic,
                r2_before: a.r2,
                r2_after: b.r2,
            });
        }
    }
    found
}

/// How many times its noise an output's error over the training runs may be. The mean of 1/f noise that goes on for a thousand records has 7
/// times the power of the first bin, all other bins of 500 have 6.8 times as much together: the error is more than 2.6 times as large 1.7
/// times in a hundred.
const PLAIN: f64 = 2.6;

/// Outputs whose plain error on the training runs is more than their noise allows, mean and slow part included, in sentences: what is beyond
/// is so slow that no spectrum tells it from noise. `residuals` are those of each run (N by q).
pub(super) fn beyond_noise(outputs: &[OutputGain], (residuals, q): (&[Vec<f64>], usize)) -> Vec<String> {
    let names: Vec<&str> = outputs.iter().take(q).map(|o| o.output.as_str()).collect();
    let of = |(o, name): (usize, &&str)| -> Option<String> {
        let own = outputs.iter().filter(|gain| gain.output == **name && !gain.validation);
        let squares = own.filter_map(|gain| Some((gain.rms_before?.powi(2), gain.noise_level.powi(2))));
        let (error, noise) = squares.fold((0.0, 0.0), |sum, own| (sum.0 + own.0, sum.1 + own.1));
        let times = (error / noise).sqrt();
        if times.is_nan() || times <= PLAIN {
            return None;
        }
        let values = residuals.iter().flat_map(|left| left.iter().skip(o).step_by(q)).filter(|r| !r.is_nan());
        let (sum, square, count) = values.fold((0.0_f64, 0.0_f64, 0.0_f64), |(s, w, n), r| (s + r, w + r * r, n + 1.0));
        let (mean, share) = (sum / count, sum * sum / (count * square));
        let unit = outputs.iter().find(|gain| gain.output == **name).and_then(|gain| gain.unit.as_deref());
        let unit = unit.map_or(String::new(), |unit| format!(" {unit}"));
        let steady = match share > 0.5 {
            true => format!(", and {:.0} % of its square are a steady {mean:.2e}{unit}", 100.0 * share),
            false => String::new(),
        };
        Some(format!(
            "{name}: the error is {times:.1} times the noise of the record{steady}. No candidate can be told from noise that is slower than these \
             runs; further ones would tell"
        ))
    };
    names.iter().enumerate().filter_map(of).collect()
}

/// Both responses of every run over time; none in the frequency domain.
pub(super) fn overlays(
    runs: &[Run],
    train: usize,
    predictors: &[Predictor],
    (before, after): (&[Signals], &[Signals]),
) -> Vec<Overlay> {
    let in_time = runs.iter().enumerate().filter(|(r, _)| predictors[*r].frequencies().is_none());
    let of = |(r, run): (usize, &Run)| Overlay {
        run: run.name.clone(),
        validation: r >= train,
        time: run.time.clone(),
        measured: run.measured.clone(),
        before: before[r].clone(),
        after: after[r].clone(),
    };
    in_time.map(of).collect()
}

/// Parameters of the base model before and after.
pub(super) fn biased(before: &[ParameterEstimate], after: &[ParameterEstimate]) -> Vec<Biased> {
    let of = |b: &ParameterEstimate| {
        let a = after.iter().find(|a| a.name == b.name && a.run == b.run)?;
        b.start?;
        Some(Biased {
            name: b.name.clone(),
            run: b.run.clone(),
            unit: b.unit.clone(),
            before: b.value,
            before_error: b.error(),
            after: a.value,
            after_error: a.error(),
            moved: b.error().filter(|e| *e > 0.0).map(|e| (a.value - b.value) / e),
        })
    };
    before.iter().filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_numeric::random::Stream;

    /// Over repeated noise, where every bin has a part of the gain and where that of the mean has it all.
    #[test]
    fn a_gain_scatters_as_its_deviation_says() {
        let draws = 4000;
        for effect in [vec![0.4; 200], [vec![0.0; 60], vec![6.0]].concat()] {
            let mut normal = Stream::seeded(1);
            let gains: Vec<LikelihoodGain> = (0..draws)
                .map(|_| {
                    let after: Vec<f64> = effect.iter().map(|_| normal.normal_of_pair()).collect();
                    let before: Vec<f64> = after.iter().zip(&effect).map(|(a, d)| a + d).collect();
                    LikelihoodGain::new(&before, &after)
                })
                .collect();
            let mean = gains.iter().map(|g| g.gain).sum::<f64>() / f64::from(draws);
            let scatter = gains.iter().map(|g| (g.gain - mean).powi(2)).sum::<f64>() / f64::from(draws);
            let told = gains.iter().map(|g| g.variance).sum::<f64>() / f64::from(draws);
            assert!((0.9..1.2).contains(&(told / scatter)), "{told} {scatter}");
        }
    }
}
