//! The residuals of one run, output by output: size, kind, whiteness, correlation with every input.

use super::autocovariance::centred;
use super::autoregression;
use super::distribution::Distribution;
use super::input_correlation::InputCorrelation;
use super::output_fit::OutputFit;
use super::whiteness::{ResidualSpectrum, Untested, Whiteness};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::record::even_grid::EvenGrid;
use serde::{Deserialize, Serialize};

/// A run as it was measured and as the model answers it; needs no fit.
#[derive(Debug, Clone, Copy)]
pub struct Signals<'a> {
    /// Name of the run.
    pub run: &'a str,
    /// Time of each sample (N), rising; empty when only the order of the samples is known.
    pub time: &'a [f64],
    /// Names of the outputs (q).
    pub outputs: &'a [String],
    /// Measured outputs, N by q row-major; NaN where nothing is compared.
    pub measured: &'a [f64],
    /// The model's outputs, N by q row-major.
    pub response: &'a [f64],
    /// Names of the inputs (m).
    pub inputs: &'a [String],
    /// Inputs, N by m row-major.
    pub input_values: &'a [f64],
}

/// How well one output of one run is matched, and what its residuals say.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct OutputQuality {
    /// Size and kind of the mismatch.
    #[serde(flatten)]
    pub fit: OutputFit,
    /// Whether the residuals are white; none when they could not be tested.
    pub whiteness: Option<Whiteness>,
    /// Their spectrum beside that of white noise; none when they could not be tested.
    pub spectrum: Option<ResidualSpectrum>,
    /// Their distribution beside the normal one; none when they could not be tested.
    pub distribution: Option<Distribution>,
    /// Correlation with each input that moves; empty when it could not be tested.
    pub inputs: Vec<InputCorrelation>,
    /// Why there is no test.
    pub untested: Option<Untested>,
}

impl OutputQuality {
    /// Of an output with so many samples of which only a limit is known: the others are no sample of the noise, and nothing is tested.
    pub(crate) fn with_censored(mut self, censored: usize) -> Self {
        self.fit.censored = censored;
        match censored {
            0 => self,
            _ => Self {
                fit: self.fit,
                whiteness: None,
                spectrum: None,
                distribution: None,
                inputs: Vec::new(),
                untested: Some(Untested::BelowLimit),
            },
        }
    }
}

/// Judges the residuals of every output of a run.
///
/// # Panics
/// When the lengths of the signals do not belong together.
pub fn residual_quality(signals: &Signals<'_>) -> Vec<OutputQuality> {
    let (q, m) = (signals.outputs.len(), signals.inputs.len());
    let n = signals.measured.len() / q.max(1);
    assert_eq!(signals.measured.len(), signals.response.len(), "measurement and response of one length");
    assert_eq!(signals.input_values.len(), n * m, "inputs at every sample");
    assert!(signals.time.is_empty() || signals.time.len() == n, "a time for every sample");
    let sampling = match signals.time {
        [] => Ok(EvenGrid::counted(n)),
        time => {
            let compared = |k: usize| signals.measured[k * q..(k + 1) * q].iter().any(|z| !z.is_nan());
            EvenGrid::of_compared(time, compared).map_err(Untested::from)
        }
    };
    let judge = |(o, name): (usize, &String)| {
        let fit = OutputFit::new(name, signals.run, signals.measured, signals.response, o, q);
        let own = sampling.as_ref().map_err(|e| *e).map(|sampling| thinned(signals, o, sampling));
        let tests = own.and_then(|(own, sampling)| tests(&own, &sampling, signals, o));
        match tests {
            Ok(t) => {
                let (whiteness, inputs) = (Some(t.whiteness), t.inputs);
                OutputQuality {
                    fit,
                    whiteness,
                    spectrum: t.spectrum,
                    distribution: t.distribution,
                    inputs,
                    untested: None,
                }
            }
            Err(untested) => OutputQuality {
                fit,
                whiteness: None,
                spectrum: None,
                distribution: None,
                inputs: Vec::new(),
                untested: Some(untested),
            },
        }
    };
    signals.outputs.iter().enumerate().map(judge).collect()
}

/// Judges the residuals of a run of a model, given the model's outputs (N by q) at its samples.
///
/// # Panics
/// When the run or the response is not of this model.
pub fn run_quality(model: &Model, run: &Run, response: &[f64]) -> Vec<OutputQuality> {
    let definition = model.definition();
    let outputs: Vec<String> = definition.outputs.iter().map(|o| o.quantity.name.clone()).collect();
    let inputs: Vec<String> = definition.inputs.iter().map(|i| i.quantity.name.clone()).collect();
    residual_quality(&Signals {
        run: &run.name,
        time: &run.time,
        outputs: &outputs,
        measured: &run.measured,
        response,
        inputs: &inputs,
        input_values: &run.inputs,
    })
}

/// What residuals on an even grid say.
struct Tests {
    whiteness: Whiteness,
    spectrum: Option<ResidualSpectrum>,
    distribution: Option<Distribution>,
    inputs: Vec<InputCorrelation>,
}

/// The samples at which an output is compared, as far as they have a step in common that is more than one place, on a grid of their own: an output of every
/// tenth row has its neighbours ten places away. All samples where there is no such step.
fn thinned(signals: &Signals<'_>, output: usize, sampling: &EvenGrid) -> (Vec<usize>, EvenGrid) {
    let q = signals.outputs.len();
    let compared = |k: &usize| !signals.measured[k * q + output].is_nan();
    let kept: Vec<usize> = (0..sampling.place.len()).filter(compared).collect();
    let places: Vec<usize> = kept.iter().map(|k| sampling.place[*k]).collect();
    // of most outputs the first two samples are neighbours, and no other need be looked at
    let gaps = || places.windows(2).map(|pair| pair[1] - pair[0]);
    let step = if gaps().any(|gap| gap == 1) { 1 } else { gaps().fold(0, divisor) };
    if step < 2 {
        return ((0..sampling.place.len()).collect(), sampling.clone());
    }
    let place = places.iter().map(|place| (place - places[0]) / step).collect();
    (kept, EvenGrid { interval: sampling.interval * step as f64, place })
}

/// The greatest common divisor.
fn divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { divisor(b, a % b) }
}

/// Of the samples `kept`, at their places.
fn tests(kept: &[usize], sampling: &EvenGrid, signals: &Signals<'_>, output: usize) -> Result<Tests, Untested> {
    let (q, m) = (signals.outputs.len(), signals.inputs.len());
    // a response that is not finite is as good as none
    let residual = |k: &usize| {
        let v = signals.measured[k * q + output] - signals.response[k * q + output];
        if v.is_finite() { v } else { f64::NAN }
    };
    let residuals = sampling.spread(kept.iter().map(residual));
    let whiteness = Whiteness::new(&residuals, sampling)?;
    let series = centred(residuals);
    let colour = autoregression::of_series(&series);
    let inputs = signals.inputs.iter().enumerate().filter_map(|(i, name)| {
        let input = sampling.spread(kept.iter().map(|k| signals.input_values[k * m + i]));
        InputCorrelation::new(name, &series, &input, &colour, sampling.interval)
    });
    let inputs = inputs.collect();
    let spectrum = ResidualSpectrum::new(&series, sampling.interval);
    Ok(Tests { whiteness, spectrum, distribution: Distribution::new(&series), inputs })
}

#[cfg(test)]
mod tests_of_thinned_records {
    use super::*;
    use fdm_numeric::random::Stream;

    /// Residuals of every tenth row, AR(1) from one to the next, which have nothing to do with the input.
    fn every_tenth(seed: u64, keep: f64) -> OutputQuality {
        let (mut random, mut v) = (Stream::seeded(seed), 0.0);
        let n = 800;
        let mut noise = |k: usize| {
            v = keep * v + random.normal_by_inversion();
            if k % 10 == 3 { v } else { f64::NAN }
        };
        let measured: Vec<f64> = (0..n).map(|k| if k % 10 == 3 { noise(k) } else { f64::NAN }).collect();
        let input_values: Vec<f64> = (0..n).map(|k| f64::from(u8::from(k / 60 % 3 == 1))).collect();
        let time: Vec<f64> = (0..n).map(|k| 0.1 * k as f64).collect();
        let (outputs, inputs) = (["y".to_string()], ["u".to_string()]);
        let signals = Signals {
            run: "r",
            time: &time,
            outputs: &outputs,
            measured: &measured,
            response: &vec![0.0; n],
            inputs: &inputs,
            input_values: &input_values,
        };
        residual_quality(&signals).remove(0)
    }

    #[test]
    fn an_output_of_every_tenth_row_is_tested_on_its_own_grid() {
        for keep in [0.0, 0.8] {
            let all: Vec<OutputQuality> = (0..200).map(|seed| every_tenth(seed, keep)).collect();
            let said = all.iter().filter(|q| q.inputs[0].is_significant()).count();
            assert!(said <= 8, "{said} of 200 at one percent");
            let whiteness = all[0].whiteness.as_ref().expect("enough");
            assert!((whiteness.interval - 1.0).abs() < 1e-9 && whiteness.degrees == 16, "{whiteness:?}");
            let coloured = all.iter().filter(|q| !q.whiteness.as_ref().expect("enough").is_white()).count();
            assert!(if keep > 0.0 { coloured > 190 } else { coloured <= 8 }, "{coloured} of 200");
        }
    }
}
