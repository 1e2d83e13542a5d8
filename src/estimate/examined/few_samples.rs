//! Parameters that went far from where they started because of few samples: a stop that was touched once, a nonlinearity that one
//! peak reached.

use crate::estimation::estimate::Status;
use crate::methods::output_error::fit::Fit;
use fdm_grammar::model::Origin;
use fdm_system::record::Run;
use fdm_system::simulate::Simulator;

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
mod tests {
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
