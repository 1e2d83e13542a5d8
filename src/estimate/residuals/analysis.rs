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
        time => EvenGrid::of(time).map_err(Untested::from),
    };
    let judge = |(o, name): (usize, &String)| {
        let fit = OutputFit::new(name, signals.run, signals.measured, signals.response, o, q);
        let tests = sampling.as_ref().map_err(|e| *e).and_then(|sampling| tests(signals, o, sampling));
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

/// The same for a run of a model, given the model's outputs (N by q) at its samples.
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

fn tests(signals: &Signals<'_>, output: usize, sampling: &EvenGrid) -> Result<Tests, Untested> {
    let (q, m) = (signals.outputs.len(), signals.inputs.len());
    let cells = signals.measured.iter().zip(signals.response).skip(output).step_by(q);
    // a response that is not finite is as good as none
    let residual = |(z, y): (&f64, &f64)| if (z - y).is_finite() { z - y } else { f64::NAN };
    let residuals = sampling.spread(cells.map(residual));
    let whiteness = Whiteness::new(&residuals, sampling)?;
    let series = centred(residuals);
    let colour = autoregression::of_series(&series);
    let inputs = signals.inputs.iter().enumerate().filter_map(|(i, name)| {
        let input = sampling.spread(signals.input_values.iter().skip(i).step_by(m).copied());
        InputCorrelation::new(name, &series, &input, &colour, sampling.interval)
    });
    let inputs = inputs.collect();
    let spectrum = ResidualSpectrum::new(&series, sampling.interval);
    Ok(Tests { whiteness, spectrum, distribution: Distribution::new(&series), inputs })
}
