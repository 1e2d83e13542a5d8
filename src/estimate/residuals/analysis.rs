//! The residuals of one run, output by output: size, kind, whiteness, correlation with every input.
//!
//! How residuals are distributed, beside the normal distribution with their variance.
//!
//! How well one output of one run is matched: size and kind of the mismatch.
//!
//! What a response leaves of a measurement.
//!
//! What predictions without any model miss by: a model that does no better than these says nothing of a run.

use super::autocovariance::centred;
use super::autoregression;
use super::whiteness::{InputCorrelation, ResidualSpectrum, Untested, Whiteness};
use fdm_numeric::statistics::normal_cdf;
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

/// Bins reach so many standard deviations to both sides.
const REACH: f64 = 4.0;
/// Fewest and most bins.
const FEWEST: f64 = 8.0;
const MOST: f64 = 64.0;
/// Residuals beyond so many standard deviations are counted.
const FAR: f64 = 3.0;

/// Residuals about their mean, counted in bins of equal width.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Distribution {
    /// Their standard deviation, in the output's unit.
    pub deviation: f64,
    /// Edges of the bins (K + 1), in standard deviations from the mean.
    pub edges: Vec<f64>,
    /// Residuals in each bin (K).
    pub counts: Vec<usize>,
    /// How many a normal distribution gives on the average (K).
    pub expected: Vec<f64>,
    /// Residuals below the first and above the last bin.
    pub beyond: [usize; 2],
    /// Residuals more than three standard deviations from the mean, and how many a normal distribution gives on the average.
    pub far: (usize, f64),
}

impl Distribution {
    /// Of residuals about their mean, NaN where there is none; none when they do not vary.
    pub(super) fn new(series: &[f64]) -> Option<Self> {
        let present: Vec<f64> = series.iter().copied().filter(|v| !v.is_nan()).collect();
        let n = present.len() as f64;
        let deviation = (present.iter().map(|v| v * v).sum::<f64>() / n).sqrt();
        if !(deviation > 0.0 && deviation.is_finite()) {
            return None;
        }
        // Scott's rule; an even number, so that zero is an edge
        let half = (REACH / (3.49 * n.powf(-1.0 / 3.0))).ceil().clamp(FEWEST / 2.0, MOST / 2.0);
        let width = REACH / half;
        let edges: Vec<f64> = (0..=2 * half as usize).map(|k| (k as f64 - half) * width).collect();
        let (mut counts, mut beyond) = (vec![0; edges.len() - 1], [0, 0]);
        for v in &present {
            let place = ((v / deviation + REACH) / width).floor();
            match place {
                p if p < 0.0 => beyond[0] += 1,
                p if p >= counts.len() as f64 => beyond[1] += 1,
                p => counts[p as usize] += 1,
            }
        }
        let expected = edges.windows(2).map(|e| n * (normal_cdf(e[1]) - normal_cdf(e[0]))).collect();
        let far = present.iter().filter(|v| v.abs() > FAR * deviation).count();
        Some(Self { deviation, edges, counts, expected, beyond, far: (far, 2.0 * n * normal_cdf(-FAR)) })
    }
}

/// How well one output of one run is matched.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct OutputFit {
    /// Name of the output.
    pub name: String,
    /// Name of the run.
    pub run: String,
    /// Compared samples.
    pub compared: usize,
    /// Samples of which only a limit is known that they lie below; they have no residuals.
    #[serde(default, skip_serializing_if = "is_none")]
    pub censored: usize,
    /// Root mean square of the residuals, in the output's unit; none when nothing was compared.
    pub rms: Option<f64>,
    /// Mean of the residuals (measured minus model), in the output's unit.
    pub bias: Option<f64>,
    /// Share of the measured variance that the model explains; none when the measurement does not vary.
    pub r2: Option<f64>,
    /// Theil's inequality coefficient: 0 for a perfect match, 1 for none.
    pub tic: Option<f64>,
    /// What the mismatch consists of; none when there is no mismatch.
    pub tic_parts: Option<TicParts>,
}

fn is_none(count: &usize) -> bool {
    *count == 0
}

/// Theil's proportions of inequality: parts of the mean square residual, which add up to 1.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
pub struct TicParts {
    /// The means differ: an offset.
    pub bias: f64,
    /// The standard deviations differ: the response is too large or too small.
    pub variance: f64,
    /// Measurement and response do not move together: what bias and variance leave. A good model leaves only this.
    pub covariance: f64,
}

impl OutputFit {
    /// Compares one output (index `o` of `q`) of `measured` and `modelled` (N by q); cells with NaN in `measured` are left out.
    pub fn new(name: &str, run: &str, measured: &[f64], modelled: &[f64], o: usize, q: usize) -> Self {
        let cells = || measured.chunks_exact(q).zip(modelled.chunks_exact(q)).map(|(z, y)| (z[o], y[o]));
        let cells = || cells().filter(|(z, _)| !z.is_nan());
        let (mut count, mut sums) = (0, [0.0; 6]);
        for (z, y) in cells() {
            count += 1;
            let v = z - y;
            sums.iter_mut().zip([v * v, z, y, z * z, y * y, v]).for_each(|(sum, part)| *sum += part);
        }
        let n = count as f64;
        let [square, middle, centre, measured_square, modelled_square, offset] = sums.map(|sum| sum / n);
        let (mut spread, mut width) = (0.0, 0.0);
        for (z, y) in cells() {
            spread += (z - middle) * (z - middle);
            width += (y - centre) * (y - centre);
        }
        let (spread, width) = (spread / n, width / n);
        let sizes = measured_square.sqrt() + modelled_square.sqrt();
        // a variance that is the rounding of a constant is none
        let varies = spread > (f64::EPSILON * middle).powi(2);
        let known = |value: f64, known: bool| (count > 0 && known && value.is_finite()).then_some(value);
        Self {
            name: name.into(),
            run: run.into(),
            compared: count,
            censored: 0,
            rms: known(square.sqrt(), true),
            bias: known(offset, true),
            r2: known(1.0 - square / spread, varies),
            tic: known(square.sqrt() / sizes, sizes > 0.0),
            tic_parts: known(square, square > 0.0).map(|_| TicParts::new(square, offset, spread.sqrt() - width.sqrt())),
        }
    }
}

impl TicParts {
    fn new(square: f64, offset: f64, spreads: f64) -> Self {
        let (bias, variance) = ((offset * offset / square).min(1.0), (spreads * spreads / square).min(1.0));
        // twice (1 - r) times both deviations; what rounding leaves below zero is zero
        Self { bias, variance, covariance: (1.0 - bias - variance).max(0.0) }
    }
}

/// Measured minus modelled, cell by cell; NaN where nothing was measured.
pub fn residuals(measured: &[f64], modelled: &[f64]) -> Vec<f64> {
    measured.iter().zip(modelled).map(|(z, y)| z - y).collect()
}

/// The residuals of what was measured, each with its cell.
pub fn compared(measured: &[f64], modelled: &[f64]) -> impl Iterator<Item = (usize, f64)> {
    let cells = measured.iter().zip(modelled).enumerate();
    cells.filter(|(_, (z, _))| !z.is_nan()).map(|(k, (z, y))| (k, z - y))
}

/// Adds the squares of the residuals of each output (q), and their number.
pub fn add_squares(sums: &mut [(f64, usize)], measured: &[f64], modelled: &[f64]) {
    let q = sums.len();
    for (k, residual) in compared(measured, modelled) {
        let (sum, count) = &mut sums[k % q];
        *sum += residual * residual;
        *count += 1;
    }
}

/// How far trivial predictions of an output of a run are off, beside that of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Baseline {
    /// The output.
    pub output: String,
    /// The run.
    pub run: String,
    /// Root mean square of the model's residual.
    pub rms: f64,
    /// Root mean square of the residual of the value measured last before the prediction begins, held to the end.
    pub last_value: f64,
    /// Root mean square of the residual of the straight line through the predicted samples themselves, by least
    /// squares.
    pub straight_line: f64,
}

impl Baseline {
    /// Of every output (q names) of runs with these residuals (N by q each), over the samples later than `from` after the beginning of a run,
    /// in its unit of time.
    pub fn of(outputs: &[&str], runs: &[Run], residuals: &[&[f64]], from: f64) -> Vec<Self> {
        let mut found = Vec::new();
        for (run, residuals) in runs.iter().zip(residuals) {
            let own = outputs.iter().enumerate().filter_map(|(o, name)| Self::new(name, run, o, residuals, from));
            found.extend(own);
        }
        found
    }

    fn new(output: &str, run: &Run, o: usize, residuals: &[f64], from: f64) -> Option<Self> {
        let (q, begin) = (run.output_gaps.len(), run.time.first()? + from);
        let samples = run.time.iter().enumerate().map(|(k, t)| (*t, run.measured[k * q + o], residuals[k * q + o]));
        let all: Vec<(f64, f64, f64)> = samples.filter(|(_, z, _)| !z.is_nan()).collect();
        let (known, ahead) = all.split_at(all.partition_point(|(t, ..)| *t <= begin).max(1).min(all.len()));
        let (held, n) = (known.last()?.1, ahead.len() as f64);
        let mean = |of: &dyn Fn(&(f64, f64, f64)) -> f64| ahead.iter().map(of).sum::<f64>() / n;
        let (middle, centre) = (mean(&|(t, ..)| *t), mean(&|(_, z, _)| *z));
        let spread = mean(&|(t, ..)| (t - middle) * (t - middle));
        let slope = mean(&|(t, z, _)| (t - middle) * (z - centre)) / spread;
        let line = |t: f64, z: f64| z - centre - slope * (t - middle);
        let found = Self {
            output: output.into(),
            run: run.name.clone(),
            rms: mean(&|(.., e)| e * e).sqrt(),
            last_value: mean(&|(_, z, _)| (z - held) * (z - held)).sqrt(),
            straight_line: mean(&|(t, z, _)| line(*t, *z).powi(2)).sqrt(),
        };
        (ahead.len() > 2 && found.rms.is_finite()).then_some(found)
    }

    /// What the model does worse than, in words; none where it does better than both.
    pub fn beaten(&self) -> Option<String> {
        let by = match (self.rms >= self.last_value, self.rms >= self.straight_line) {
            (true, true) => "its last value held and a straight line",
            (true, false) => "its last value held",
            (false, true) => "a straight line",
            (false, false) => return None,
        };
        Some(format!("the prediction of `{}` in run `{}` is no better than {by}", self.output, self.run))
    }
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

#[cfg(test)]
mod distribution_tests {
    use super::*;

    #[test]
    fn every_residual_is_counted_once_and_the_normal_is_that_of_tables() {
        let mut series: Vec<f64> = (0..400).map(|k| ((f64::from(k) + 0.5) / 400.0 - 0.5) * 2.0).collect();
        (series[3], series[7]) = (f64::NAN, 40.0);
        let found = Distribution::new(&series).unwrap();
        assert_eq!(found.counts.iter().sum::<usize>() + found.beyond[0] + found.beyond[1], 399);
        assert_eq!((found.beyond, found.far.0), ([0, 1], 1));
        assert!((found.far.1 - 399.0 * 0.002_699_8).abs() < 1e-3, "{}", found.far.1);
        assert_eq!(found.edges.len(), found.counts.len() + 1);
        assert!((found.expected.iter().sum::<f64>() - 399.0 * 0.999_936_7).abs() < 1e-3);
        assert_eq!(Distribution::new(&[0.0; 9]), None);
    }
}

#[cfg(test)]
mod output_fit_tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_the_definitions() {
        let (z, y) = ([1.0, 9.0, 2.0, f64::NAN, 3.0, 9.0], [1.0, 9.0, 2.5, 0.0, 2.0, 9.0]);
        let fit = OutputFit::new("a", "r", &z, &y, 0, 2);
        assert_eq!(fit.compared, 3);
        assert!((fit.rms.expect("compared") - (1.25f64 / 3.0).sqrt()).abs() < 1e-15);
        assert!((fit.bias.expect("compared") - 0.5 / 3.0).abs() < 1e-15);
        assert!((fit.r2.expect("varies") - (1.0 - 1.25 / 2.0)).abs() < 1e-15);
        let tic = (1.25f64 / 3.0).sqrt() / ((14.0f64 / 3.0).sqrt() + (11.25f64 / 3.0).sqrt());
        assert!((fit.tic.expect("sizes") - tic).abs() < 1e-15);
        let constant = OutputFit::new("b", "r", &z, &y, 1, 2);
        assert_eq!((constant.compared, constant.rms, constant.r2, constant.tic_parts), (2, Some(0.0), None, None));
        let none = OutputFit::new("c", "r", &[f64::NAN], &[1.0], 0, 1);
        assert_eq!((none.compared, none.rms, none.tic, none.tic_parts), (0, None, None, None));
    }

    #[test]
    fn the_parts_are_offset_size_and_the_rest() {
        let parts = |y: &dyn Fn(f64) -> f64| {
            let z: Vec<f64> = (0..64).map(|k| (0.3 * k as f64).sin()).collect();
            let y: Vec<f64> = z.iter().map(|z| y(*z)).collect();
            OutputFit::new("a", "r", &z, &y, 0, 1).tic_parts.expect("a mismatch")
        };
        assert!((parts(&|z| z + 0.1).bias - 1.0).abs() < 1e-12, "{:?}", parts(&|z| z + 0.1));
        let (z, y) = ([1.0, -1.0, 1.0, -1.0], [2.0, -2.0, 2.0, -2.0]);
        let larger = OutputFit::new("a", "r", &z, &y, 0, 1).tic_parts.expect("a mismatch");
        assert_eq!(larger, TicParts { bias: 0.0, variance: 1.0, covariance: 0.0 });
        // the textbook form of the rest: 2 (1 - r) times both deviations
        let (z, y) = ([1.0, 3.0, 2.0, 5.0], [1.5, 2.0, 2.5, 4.0]);
        let moment = |a: &[f64; 4], b: &[f64; 4]| {
            let (ma, mb) = (a.iter().sum::<f64>() / 4.0, b.iter().sum::<f64>() / 4.0);
            a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>() / 4.0
        };
        let (sz, sy) = (moment(&z, &z).sqrt(), moment(&y, &y).sqrt());
        let square = z.iter().zip(&y).map(|(z, y)| (z - y) * (z - y)).sum::<f64>() / 4.0;
        let found = OutputFit::new("a", "r", &z, &y, 0, 1).tic_parts.expect("a mismatch");
        assert!((found.covariance - 2.0 * (sz * sy - moment(&z, &y)) / square).abs() < 1e-12);
        assert!((found.bias + found.variance + found.covariance - 1.0).abs() < 1e-12);
    }
}

#[cfg(test)]
mod baseline_tests {
    use super::*;

    #[test]
    fn trivial_predictions_of_a_ramp_with_a_bump() {
        let time: Vec<f64> = (0..5).map(f64::from).collect();
        // 1 + 2 t, and 3 more in the middle
        let measured = vec![1.0, 3.0, 8.0, 7.0, 9.0];
        let (name, held, gaps) = ("r".into(), Vec::new(), vec![0]);
        let run = Run {
            name,
            inputs: Vec::new(),
            held,
            measured,
            input_gaps: Vec::new(),
            stated: Vec::new(),
            output_gaps: gaps,
            time,
        };
        let found = &Baseline::of(&["y"], &[run], &[&[0.0, 0.0, 3.0, 0.0, 0.0]], 0.0)[0];
        assert!((found.last_value - ((4.0 + 49.0 + 36.0 + 64.0) / 4.0_f64).sqrt()).abs() < 1e-12, "{found:?}");
        // the line through (1, 3), (2, 8), (3, 7), (4, 9) is 2.5 + 1.7 t
        let off: [f64; 4] = [3.0 - 4.2, 8.0 - 5.9, 7.0 - 7.6, 9.0 - 9.3];
        let line = (off.iter().map(|e| e * e).sum::<f64>() / 4.0).sqrt();
        assert!((found.straight_line - line).abs() < 1e-12, "{found:?}");
        assert!((found.rms - 1.5).abs() < 1e-12);
        assert_eq!(
            found.beaten().as_deref(),
            Some("the prediction of `y` in run `r` is no better than a straight line")
        );
    }
}
