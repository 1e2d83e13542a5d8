//! Outputs that the model does not explain, or explains with the wrong sign: what nobody should have to find in a table.
//!
//! Parameters that went far from where they started because of few samples: a stop that was touched once, a nonlinearity that one
//! peak reached.

use crate::estimation::{Estimate, Status};
use crate::methods::output_error::fit::Fit;
use fdm_grammar::model::Origin;
use fdm_system::record::Run;
use fdm_system::simulate::Simulator;
use serde::{Deserialize, Serialize};

/// R^2 over all runs below which an output counts as not explained.
const LITTLE: f64 = 0.2;
/// Correlation of record and response below which one is the mirror image of the other: the sign alone then explains a quarter and more.
const AGAINST: f64 = -0.5;
/// Correlation above which record and response are one motion, four fifths of whose variance a line explains.
const ALIKE: f64 = 0.9;
/// A correlation of n independent pairs scatters by `1/sqrt(n)`; so many deviations are exceeded by chance once in a thousand.
const NO_CHANCE: f64 = 3.09;

/// An output that the model does not explain.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Unexplained {
    /// Its name.
    pub output: String,
    /// Share of the variance that the model explains, over all runs; none where no run's record of it varies.
    pub r2: Option<f64>,
    /// Correlation of record and response, each about its mean in each run; none where one of them does not vary.
    pub correlation: Option<f64>,
    /// `record = factor*response + offset` by least squares, where the correlation is above 0.9 and that explains most of it.
    pub line: Option<(f64, f64)>,
}

impl Unexplained {
    /// Whether the record is the mirror image of the response.
    pub fn is_mirrored(&self) -> bool {
        self.correlation.is_some_and(|r| r < AGAINST)
    }

    /// Outputs of a fit in the time domain whose residuals are no noise, and of which the model explains less than a fifth or the mirror image.
    pub fn of(estimate: &Estimate) -> Vec<Self> {
        let Some(first) = estimate.runs.first() else { return Vec::new() };
        let names: Vec<&str> =
            estimate.outputs.iter().filter(|o| o.run == first.run).map(|o| o.name.as_str()).collect();
        let told = names.iter().enumerate().filter_map(|(o, name)| {
            let sums = Sums::of(estimate, o, names.len());
            let (r2, correlation) = (sums.r2(), sums.correlation());
            let line = correlation.filter(|r| *r > ALIKE).map(|_| sums.line());
            let found = Self { output: name.to_string(), r2, correlation, line };
            let little = found.r2.is_none_or(|r2| r2 < LITTLE);
            let sure = |correlation: f64| correlation * sums.count.sqrt() > NO_CHANCE;
            let mirrored = found.is_mirrored() && found.correlation.is_some_and(|r| sure(-r));
            (little && (mirrored || sure(sums.smoothness()))).then_some(found)
        });
        told.collect()
    }

    /// Outputs of a fit in the time domain whose record and response are not one motion (a correlation of 0.9), while their residuals are one: what is left is no noise.
    pub fn unlike(estimate: &Estimate) -> Vec<String> {
        let Some(first) = estimate.runs.first() else { return Vec::new() };
        let names: Vec<&str> =
            estimate.outputs.iter().filter(|o| o.run == first.run).map(|o| o.name.as_str()).collect();
        let is_unlike = |o: usize| {
            let sums = Sums::of(estimate, o, names.len());
            let residual = sums.smoothness();
            sums.correlation().is_some_and(|r| r < ALIKE)
                && residual > ALIKE
                && residual * sums.count.sqrt() > NO_CHANCE
        };
        names.iter().enumerate().filter(|(o, _)| is_unlike(*o)).map(|(_, name)| (*name).to_string()).collect()
    }
}

/// Sums over the compared samples of an output, of all runs.
#[derive(Default)]
struct Sums {
    count: f64,
    /// Squares of the residuals, and products of neighbouring ones.
    left: f64,
    neighbours: f64,
    /// Squares of record and response about their means in each run, and their products.
    record: f64,
    response: f64,
    product: f64,
    /// Squares of record and response, and the sums of both.
    size: f64,
    totals: [f64; 2],
}

impl Sums {
    fn of(estimate: &Estimate, o: usize, q: usize) -> Self {
        let mut sums = Self::default();
        for run in &estimate.runs {
            let cells = run.residuals.iter().zip(&run.response).skip(o).step_by(q);
            let cells: Vec<(f64, f64)> =
                cells.filter(|(e, y)| e.is_finite() && y.is_finite()).map(|(e, y)| (*e, *y)).collect();
            let n = cells.len() as f64;
            let mean = |of: &dyn Fn(&(f64, f64)) -> f64| cells.iter().map(of).sum::<f64>() / n.max(1.0);
            let (z_mean, y_mean) = (mean(&|(e, y)| e + y), mean(&|(_, y)| *y));
            sums.count += n;
            sums.neighbours += cells.windows(2).map(|w| w[0].0 * w[1].0).sum::<f64>();
            for (e, y) in &cells {
                let (dz, dy) = (e + y - z_mean, y - y_mean);
                sums.left += e * e;
                sums.record += dz * dz;
                sums.response += dy * dy;
                sums.product += dz * dy;
                sums.size += (e + y).powi(2) + y * y;
                sums.totals[0] += e + y;
                sums.totals[1] += y;
            }
        }
        sums
    }

    /// The record over the response, and what is then left of their means.
    fn line(&self) -> (f64, f64) {
        let factor = self.product / self.response;
        (factor, (self.totals[0] - factor * self.totals[1]) / self.count)
    }

    /// A variance that is the rounding of a constant, in either of the two that it is made from, is none.
    fn varies(&self) -> bool {
        self.record > (8.0 * f64::EPSILON).powi(2) * self.count * self.size
    }

    fn r2(&self) -> Option<f64> {
        (self.count > 0.0 && self.varies()).then(|| 1.0 - self.left / self.record)
    }

    fn correlation(&self) -> Option<f64> {
        let size = (self.record * self.response).sqrt();
        (self.varies() && size > 0.0).then(|| self.product / size)
    }

    /// Correlation of neighbouring residuals about zero; that of residuals that are rounding is none.
    fn smoothness(&self) -> f64 {
        let rounding = 1e-20 * self.size;
        if self.left > rounding { self.neighbours / self.left } else { 0.0 }
    }
}

/// A parameter whose estimate is far from its start, and the samples that say so.
#[derive(Debug, Clone, PartialEq)]
pub struct FewSamples {
    /// Its name.
    pub parameter: String,
    /// Where the estimation started.
    pub start: f64,
    /// Where the estimation ended.
    pub value: f64,
    /// The effective number of samples that it moves: the square of the sum of their information over the sum of its squares.
    pub samples: f64,
    /// Samples of all runs.
    pub of: usize,
}

/// An estimate further from its start than this many times the start is far.
const FAR: f64 = 9.0;
/// Fewer samples than this are few: one that is wrong is then more than a tenth of what is known.
const FEW: f64 = 10.0;

/// Shared parameters of a fit that ended far from their starts and that few samples determine; `thetas` are all parameters of each run at
/// the estimates. A start of 0 has no size to be far from.
pub(crate) fn few_samples(fit: &Fit, runs: &[Run], thetas: &[Vec<f64>]) -> Vec<FewSamples> {
    let definition = fit.model.definition();
    let (q, mut far) = (definition.outputs.len(), Vec::new());
    for (k, param) in definition.params.iter().enumerate() {
        let open = !param.fixed && !param.per_run && param.origin == Origin::Declared && param.value != 0.0;
        let found = fit.estimate.parameter(&param.quantity.name, None).filter(|_| open);
        let Some(found) = found.filter(|p| p.status == Status::Estimated) else { continue };
        if (found.value - param.value).abs() > FAR * param.value.abs() {
            far.push((k, found.value));
        }
    }
    if far.is_empty() {
        return Vec::new();
    }
    let columns: Vec<usize> = far.iter().map(|(k, _)| *k).collect();
    let mut sums = vec![(0.0, 0.0); columns.len()];
    for (r, ((run, theta), accuracy)) in runs.iter().zip(thetas).zip(&fit.integration).enumerate() {
        let weights: Vec<f64> = (0..q)
            .map(|o| {
                let rms = fit.estimate.outputs.get(r * q + o).and_then(|m| m.rms).filter(|rms| *rms > 0.0);
                rms.map_or(0.0, |rms| 1.0 / (rms * rms))
            })
            .collect();
        let Ok(mut simulator) = Simulator::new(fit.model.dynamics(), run, accuracy.steps.clone()) else { continue };
        let streamed = simulator.stream(theta, &columns, &mut |block| {
            for sample in 0..block.samples() {
                let mut own = vec![0.0; columns.len()];
                for (o, weight) in weights.iter().enumerate() {
                    if run.measured[(block.first + sample) * q + o].is_nan() {
                        continue;
                    }
                    let lanes = block.layout.outputs[o].columns.iter().zip(block.row(sample, o));
                    lanes.for_each(|(column, s)| own[*column as usize] += weight * s * s);
                }
                for ((sum, squares), own) in sums.iter_mut().zip(own) {
                    *sum += own;
                    *squares += own * own;
                }
            }
        });
        if streamed.is_err() {
            return Vec::new();
        }
    }
    let of = runs.iter().map(Run::len).sum();
    let told = far.into_iter().zip(sums).filter_map(|((k, value), (sum, squares))| {
        let param = &definition.params[k];
        let samples = if squares > 0.0 { sum * sum / squares } else { 0.0 };
        (samples < FEW).then(|| FewSamples {
            parameter: param.quantity.name.clone(),
            start: param.value,
            value,
            samples,
            of,
        })
    });
    told.collect()
}

#[cfg(test)]
mod few_samples_tests {
    use crate::methods::output_error::options::FitOptions;
    use crate::methods::time_domain::fit;
    use crate::work::Work;
    use fdm_system::model::Model;
    use fdm_system::record::Run;

    /// A curve with a bend that `count` of 200 samples reach.
    fn found(count: usize) -> Vec<super::FewSamples> {
        let text = "model m { input u; param a = 1, k = 1; output y = a*u + k*max(u - 1, 0); }";
        let model = Model::from_text("m.fdm", text).unwrap();
        let time: Vec<f64> = (0..200).map(f64::from).collect();
        let inputs: Vec<f64> = (0..200).map(|k| if k < count { 1.1 } else { (k % 7) as f64 / 8.0 }).collect();
        let mut normal = fdm_numeric::random::Normal(5);
        let measured = inputs.iter().map(|u| 2.0 * u + 40.0 * (u - 1.0).max(0.0) + 0.01 * normal.next()).collect();
        let (name, held, gaps) = ("r".into(), vec![false], vec![0]);
        let run =
            Run { name, inputs, held, measured, input_gaps: gaps.clone(), stated: Vec::new(), output_gaps: gaps, time };
        fit(&model, &[run], &FitOptions::default(), &Work::default()).unwrap().few_samples
    }

    #[test]
    fn a_parameter_far_from_its_start_is_told_with_the_samples_that_say_so() {
        let told = found(4);
        assert!(told.len() == 1 && told[0].parameter == "k" && (told[0].samples - 4.0).abs() < 0.01, "{told:?}");
        assert!((told[0].value - 40.0).abs() < 2.0 && told[0].of == 200, "{told:?}");
        assert!(found(40).is_empty(), "many samples say it");
    }
}
