//! Errors where the size of the noise varies (heteroscedasticity; White 1980): `D S' R^-1 G C G R^-1 S D` with the deviation G of each sample over the mean one
//! ([`noise_variation`]) and the correlations C of the residuals over G. What G does to each error is a factor on the one that is corrected for colour.

use super::sandwich::{Corrected, Ended, PriorInformation, Sandwich, Uncorrected};
use super::sensitivity_rows::{Colour, SensitivityRows};
use super::spectra::{NoiseByFrequency, noise_by_frequency};
use crate::problem::noise::Weights;
use crate::problem::{Problem, ProblemRun};
use crate::residuals::NoiseVariation;
use crate::residuals::autoregression::{self, AutoRegression};
use crate::residuals::noise_variation::{self, OutputSeries};
use num_complex::Complex64;

/// Probability of chance, without leverage, above which noise is not looked at more closely.
const DOUBTFUL: f64 = 0.1;

/// Tests whether the noise of each output is of one size, given the responses of all runs (N by q each), their sensitivities and residuals. Where it is not, the
/// corrected errors allow for that; otherwise they stay as they are.
///
/// # Errors
/// [`Uncorrected`] when the errors would have to be changed and cannot.
pub(super) fn allow(
    problem: &Problem<'_>,
    ended: &Ended<'_>,
    runs: &[SensitivityRows],
    corrected: &mut Corrected,
) -> Result<Vec<NoiseVariation>, Uncorrected> {
    let Ended { sandwich, noise, responses, .. } = *ended;
    let bound = sandwich.bound;
    let mut outputs = series(problem, responses, runs);
    let found = noise_variation::test(&outputs);
    if found.iter().all(|v| v.p_value > DOUBTFUL) {
        return Ok(found);
    }
    let inverse_noise = noise.inverse();
    for (o, (_, series)) in outputs.iter_mut().enumerate() {
        for (r, series) in series.iter_mut().enumerate() {
            let [inverse, _] = sandwich.of_run(r, &bound.inverse.values, runs[r].width);
            series.left = runs[r].leverages(o, &inverse, inverse_noise[o * problem.outputs.len() + o]);
            series.left.iter_mut().for_each(|h| *h = 1.0 - *h);
        }
    }
    let mut found = noise_variation::test(&outputs);
    // deviation of each place over the mean one, by run and output
    let mut shapes: Vec<Vec<Vec<f64>>> =
        runs.iter().map(|r| r.residuals.iter().map(|v| vec![1.0; v.len()]).collect()).collect();
    for v in found.iter_mut().filter(|v| v.is_significant()) {
        let Some(o) = outputs.iter().position(|(name, _)| *name == v.output) else { continue };
        let shape = noise_variation::profile(v, &outputs[o].1);
        v.deviations = noise_variation::range(v.deviations[0], &outputs[o].1, &shape);
        for (to, shape) in shapes.iter_mut().zip(shape) {
            to[o] = shape.into_iter().map(f64::sqrt).collect();
        }
    }
    if found.iter().any(NoiseVariation::is_significant) {
        let prior = ended.prior();
        let [plain, varying] = variances(&sandwich, runs, &shapes, noise, &prior);
        multiply(corrected, &plain, &varying)?;
    }
    Ok(found)
}

/// Multiplies the corrected errors by what turns one variance of each into the other.
fn multiply(corrected: &mut Corrected, plain: &[f64], varying: &[f64]) -> Result<(), Uncorrected> {
    let factor = |(plain, varying): (&f64, &f64)| if *plain > 0.0 { (varying / plain).sqrt() } else { 1.0 };
    let factors: Vec<f64> = plain.iter().zip(varying).map(factor).collect();
    if !factors.iter().all(|f| f.is_finite()) {
        return Err(Uncorrected::NotFinite);
    }
    let n = factors.len();
    corrected.values.iter_mut().enumerate().for_each(|(k, c)| *c *= factors[k / n] * factors[k % n]);
    Ok(())
}

/// Lets corrected errors of spectra allow for noise of varying size. An estimate is a sum `sum_t h(t) v(t)` over the
/// noise of the samples, h the inverse transform of `D S* R^-1` in units of the local noise; noise whose variance
/// varies by G^2 multiplies its variance by `sum h^2 G^2 / sum h^2`.
///
/// # Errors
/// As [`allow`].
pub(super) fn allow_spectra(
    problem: &mut Problem<'_>,
    ended: &Ended<'_>,
    corrected: &mut Corrected,
) -> Result<Vec<NoiseVariation>, Uncorrected> {
    let Ended { sandwich, noise, values, .. } = *ended;
    let Sandwich { unknowns, bound } = sandwich;
    let Some(in_time) = &problem.noise_in_time else { return Ok(Vec::new()) };
    let theta: Vec<Vec<f64>> = (0..problem.runs.len()).map(|r| unknowns.assembled(r, values)).collect();
    let Some(sizes) = in_time.sizes(&theta) else { return Ok(Vec::new()) };
    if !sizes.variation.iter().any(NoiseVariation::is_significant) {
        return Ok(sizes.variation);
    }
    let inverse_noise = noise.inverse();
    let NoiseByFrequency { runs, mut power, .. } = noise_by_frequency(problem, &sandwich, values)?;
    let (n, q) = (bound.inverse.chosen.len(), problem.outputs.len());
    power.settle(|o| 2.0 * noise.covariance[o * q + o]);
    let (mut plain, mut varying) = (vec![0.0; n], vec![0.0; n]);
    for ((r, run), shapes) in runs.iter().enumerate().zip(&sizes.shapes) {
        let places = sandwich.columns(r, run.width);
        // numbers of samples, frequencies and estimates together beyond which not every sample is looked at
        let stride = (run.samples * run.omega.len() * n * q).div_ceil(1 << 30).max(1);
        let turn: Vec<Complex64> = run.omega.iter().map(|w| Complex64::cis(-w * run.dt * stride as f64)).collect();
        for (o, shape) in shapes.iter().enumerate() {
            let influence = run.influence(o, &power, &inverse_noise, &places);
            // what stands before the first sample that was transformed
            let outer = shape.len().saturating_sub(run.samples) / 2;
            let mut phase = vec![Complex64::new(1.0, 0.0); run.omega.len()];
            for t in (0..run.samples).step_by(stride) {
                let size = shape.get(t + outer).copied().filter(|s| s.is_finite()).unwrap_or(1.0);
                for (i, of) in influence.chunks_exact(run.omega.len()).enumerate() {
                    let h: f64 = of.iter().zip(&phase).map(|(w, p)| w.re * p.re + w.im * p.im).sum();
                    let own = stride as f64 * h * h / run.samples as f64;
                    plain[i] += own;
                    varying[i] += own * size;
                }
                phase.iter_mut().zip(&turn).for_each(|(p, turn)| *p *= turn);
            }
        }
    }
    multiply(corrected, &plain, &varying)?;
    Ok(sizes.variation)
}

/// Every output in every run.
fn series(problem: &Problem<'_>, responses: &[Vec<f64>], runs: &[SensitivityRows]) -> Vec<(String, Vec<OutputSeries>)> {
    let q = problem.outputs.len();
    let of = |o: usize| {
        let one = |((run, response), rows): ((&ProblemRun<'_>, &Vec<f64>), &SensitivityRows)| {
            let grid = &rows.grid;
            let cells = || run.measured.iter().zip(response).skip(o).step_by(q);
            let time = run.response.time().map(|time| grid.spread(time.iter().map(|t| t - time[0])));
            OutputSeries {
                response: grid.spread(cells().map(|(_, y)| y.abs())),
                time: time.unwrap_or_default(),
                residuals: grid.spread(cells().map(|(z, y)| z - y)),
                left: Vec::new(),
            }
        };
        problem.runs.iter().zip(responses).zip(runs).map(one).collect()
    };
    problem.outputs.iter().enumerate().map(|(o, name)| (name.clone(), of(o))).collect()
}

/// Variances of all chosen unknowns under noise of one size, and under noise of these shapes.
fn variances(
    sandwich: &Sandwich<'_>,
    runs: &[SensitivityRows],
    shapes: &[Vec<Vec<f64>>],
    noise: &Weights,
    prior: &[PriorInformation],
) -> [Vec<f64>; 2] {
    let inverse_noise = noise.inverse();
    let mut middles: [Vec<Vec<f64>>; 2] = Default::default();
    for (rows, shape) in runs.iter().zip(shapes) {
        let colour = colour(rows, shape, &noise.covariance);
        // G R^-1 S, so that the filter takes the weights off what it is given
        let weighted = rows.weighted(&inverse_noise);
        let varying = weighted.scaled(shape);
        let one = identity(shape.len());
        middles[0].push(weighted.filter(&colour, &one).middle);
        middles[1].push(varying.filter(&colour, &one).middle);
    }
    let n = sandwich.bound.inverse.chosen.len();
    middles.map(|middles| {
        let covariance = sandwich.covariance(&middles, prior);
        (0..n).map(|j| covariance[j * n + j]).collect()
    })
}

/// The colour of the residuals over their shape; white where samples are not even.
fn colour(rows: &SensitivityRows, shape: &[Vec<f64>], covariance: &[f64]) -> Colour {
    let q = shape.len();
    let model = |(residuals, shape): (&Vec<f64>, &Vec<f64>)| {
        let standardised: Vec<f64> = residuals.iter().zip(shape).map(|(v, g)| v / g).collect();
        match rows.even {
            true => autoregression::of_series(&standardised),
            false => {
                let present = || standardised.iter().filter(|v| !v.is_nan());
                AutoRegression::white(present().map(|v| v * v).sum::<f64>() / present().count().max(1) as f64)
            }
        }
    };
    let models: Vec<AutoRegression> = rows.residuals.iter().zip(shape).map(model).collect();
    let entry = |(a, b): (usize, usize)| {
        let size = (covariance[a * q + a] * covariance[b * q + b]).sqrt();
        let correlation = if size > 0.0 { covariance[a * q + b] / size } else { f64::from(u8::from(a == b)) };
        correlation * (models[a].variance * models[b].variance).sqrt()
    };
    let innovations = (0..q * q).map(|k| entry((k / q, k % q))).collect();
    Colour { models, innovations }
}

fn identity(q: usize) -> Vec<f64> {
    (0..q * q).map(|k| f64::from(u8::from(k / q == k % q))).collect()
}
