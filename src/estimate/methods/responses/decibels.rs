//! Decibels and degrees of a model's responses with their derivatives, as estimation asks for them: one number after the other; with their random errors.
//!
//! `d dB = (20/ln 10) Re(dH/H)`, `d arg = (180/pi) Im(dH/H)`; degrees are those nearest to the measured ones, whole turns do not count. Costs are weighted
//! as by Tischler and Remple (Aircraft and Rotorcraft System Identification, 2012, chapter 11).

use super::measured::{Measured, cycles};
use crate::methods::spectra::Unanswered;
use crate::methods::spectra::bins::{Reason, failed};
use crate::problem::response::{KnownNoise, KnownNoiseResponse, Response};
use fdm_numeric::lanes::Aligned;
use fdm_system::frequency::{EndTerms, FrequencyResponse, Plans};
use fdm_system::linear::{LinearModel, Values};
use fdm_system::simulate::{Block, Divergence, RowLayout, Sink};
use fdm_system::spectrum::Spectrum;
use num_complex::Complex64;
use std::f64::consts::{LN_10, PI, TAU};
use std::sync::Arc;

/// Decibels of a factor e, and degrees of a radian.
pub(super) const SCALES: [f64; 2] = [20.0 / LN_10, 180.0 / PI];
/// What a squared decibel and a squared degree cost.
const COSTS: [f64; 2] = [1.0, 0.01745];
/// Factor on the mean of the costs.
const FACTOR: f64 = 20.0;
/// Correlation that is none.
const APART: f64 = 1e-3;

/// The weight that a coherence gives to a squared error.
pub(super) fn weight(coherence: f64) -> f64 {
    (1.58 * (1.0 - fdm_grammar::math::exp(-coherence * coherence))).powi(2)
}

/// The cost of errors in decibels and degrees at so many coherences; NaN of none.
pub(super) fn cost_of(errors: &[(f64, [f64; 2])]) -> f64 {
    let one = |(coherence, off): &(f64, [f64; 2])| {
        weight(*coherence) * off.iter().zip(COSTS).map(|(e, cost)| cost * e * e).sum::<f64>()
    };
    FACTOR * errors.iter().map(one).sum::<f64>() / errors.len() as f64
}

/// One output to one input at the frequencies that are coherent.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    pub(super) output: usize,
    pub(super) input: usize,
    /// Positions among all frequencies.
    pub(super) at: Vec<usize>,
    /// Measured decibels and degrees.
    pub(super) measured: Vec<[f64; 2]>,
    /// What they are multiplied with, so that their squares add up to the cost.
    factors: Vec<[f64; 2]>,
    /// Random error, as a part of the magnitude.
    error: Vec<f64>,
    /// First of its rows; two for each frequency.
    first: usize,
}

impl Pair {
    pub(super) fn new(measured: &Measured, output: usize, input: usize, at: Vec<usize>, first: usize) -> Self {
        let place = measured.estimate.pair(output, input).start;
        let each = FACTOR / at.len() as f64;
        let coherence = measured.coherence(output, input);
        let of = |k: &usize| COSTS.map(|cost| (each * cost * weight(coherence[*k])).sqrt());
        let shown = |k: &usize| decibels_and_degrees(measured.estimate.response[place + k]);
        Self {
            output,
            input,
            measured: at.iter().map(shown).collect(),
            factors: at.iter().map(of).collect(),
            error: at.iter().map(|k| measured.estimate.error[place + k]).collect(),
            first,
            at,
        }
    }

    /// Rows behind it.
    pub(super) fn end(&self) -> usize {
        self.first + 2 * self.at.len()
    }

    /// Measured decibels and degrees, weighted, one row after the other.
    fn rows(&self) -> impl Iterator<Item = f64> + '_ {
        self.measured.iter().zip(&self.factors).flat_map(|(m, f)| [m[0] * f[0], m[1] * f[1]])
    }

    /// Decibels and degrees of rows of the model.
    pub(super) fn modelled(&self, rows: &[f64]) -> Vec<[f64; 2]> {
        let own = rows[self.first..self.end()].chunks_exact(2);
        own.zip(&self.factors).map(|(y, f)| [y[0] / f[0], y[1] / f[1]]).collect()
    }

    /// The cost of its residuals.
    pub(super) fn cost(&self, residuals: &[f64]) -> f64 {
        residuals[self.first..self.end()].iter().map(|r| r * r).sum()
    }
}

/// Magnitude in decibels and phase in degrees, from -180 to 180.
pub(super) fn decibels_and_degrees(h: Complex64) -> [f64; 2] {
    [SCALES[0] * 0.5 * fdm_grammar::math::log(h.norm_sqr()), SCALES[1] * fdm_grammar::math::atan2(h.im, h.re)]
}

/// What was measured, for all pairs.
pub(super) fn measured_rows(pairs: &[Pair]) -> Vec<f64> {
    pairs.iter().flat_map(Pair::rows).collect()
}

/// The random errors of the rows, and how neighbours share them.
pub(super) fn known_noise(measured: &Measured, pairs: &[Pair]) -> KnownNoise {
    let mut noise = KnownNoise::default();
    let frequency = cycles(&measured.estimate.omega);
    for pair in pairs {
        let both = pair.factors.iter().zip(&pair.error);
        noise.deviations.extend(both.flat_map(|(f, e)| [0, 1].map(|part| f[part] * SCALES[part] * e)));
        for (a, k) in pair.at.iter().enumerate() {
            for (b, l) in pair.at.iter().enumerate().skip(a + 1) {
                let length = measured.dominant[*k].max(measured.dominant[*l]);
                let correlation = shared(frequency[*l] - frequency[*k], length);
                if (frequency[*l] - frequency[*k]) * length > 8.0 {
                    break;
                }
                let rows = [0, 1].map(|part| (pair.first + 2 * a + part, pair.first + 2 * b + part));
                let near = rows.into_iter().filter(|_| correlation.abs() > APART);
                noise.correlations.extend(near.map(|(i, j)| (i as u32, j as u32, correlation)));
            }
        }
    }
    noise
}

/// All pairs as the response of one output.
pub(super) struct Decibels {
    linear: LinearModel,
    values: Values,
    /// The responses to one input each, with the pairs that want them.
    responses: Vec<(FrequencyResponse, Vec<usize>)>,
    pairs: Vec<Pair>,
    /// For each pair the row at each frequency, where there is one.
    places: Vec<Vec<Option<usize>>>,
    params: usize,
    omega: Vec<f64>,
    noise: KnownNoise,
    y: Vec<f64>,
    rows: Aligned,
    layout: RowLayout,
    reason: Reason,
}

impl Decibels {
    /// The responses of a model at the frequencies of its pairs, evaluated at `theta` (p).
    ///
    /// # Errors
    /// [`Unanswered`].
    pub(super) fn new(
        linear: &LinearModel,
        theta: &[f64],
        measured: &Measured,
        pairs: &[Pair],
        plans: &Arc<Plans>,
        reason: &Reason,
    ) -> Result<Self, Unanswered> {
        let (mut linear, mut values) = (linear.clone(), Values::default());
        linear.evaluate(theta, &mut values).map_err(Unanswered::Trim)?;
        let structure = linear.structure().clone();
        let (omega, mut responses) = (&measured.estimate.omega, Vec::new());
        for input in (0..structure.inputs).filter(|k| measured.slopes[*k].is_none()) {
            let wanted: Vec<usize> = (0..pairs.len()).filter(|p| pairs[*p].input == input).collect();
            if wanted.is_empty() {
                continue;
            }
            let spectrum = unit(&measured.slopes, structure.outputs, input, omega);
            let response = FrequencyResponse::new(&structure, &values, &spectrum, &EndTerms::Omitted, plans);
            responses.push((response.map_err(Unanswered::Frequency)?, wanted));
        }
        let place = |pair: &Pair| {
            let mut places = vec![None; omega.len()];
            pair.at.iter().enumerate().for_each(|(n, k)| places[*k] = Some(n));
            places
        };
        Ok(Self {
            params: structure.params,
            linear,
            values,
            responses,
            places: pairs.iter().map(place).collect(),
            pairs: pairs.to_vec(),
            omega: omega.clone(),
            noise: known_noise(measured, pairs),
            y: vec![0.0; pairs.last().map_or(0, Pair::end)],
            rows: Aligned::new(0),
            layout: RowLayout::default(),
            reason: reason.clone(),
        })
    }

    /// Fills `y`, and rows for these columns.
    fn fill(&mut self, theta: &[f64], columns: &[usize]) -> Result<(), Divergence> {
        let Self { linear, values, responses, pairs, places, params, y, rows, layout, reason, .. } = self;
        linear.evaluate(&theta[..*params], values).map_err(|e| failed(reason, Unanswered::Trim(e)))?;
        if layout.outputs.len() != 1 || layout.outputs[0].columns.len() != columns.len() {
            *layout = RowLayout::full(1, columns.len());
            *rows = Aligned::new(layout.length * y.len());
        }
        rows.iter_mut().for_each(|v| *v = 0.0);
        let stride = layout.length;
        for (response, wanted) in responses {
            let taken = response.sensitivities(values, &[], columns, &mut |block: Block<'_>| {
                let q = block.layout.outputs.len();
                for p in wanted.iter() {
                    let pair = &pairs[*p];
                    for sample in (0..block.samples()).step_by(2) {
                        let Some(n) = places[*p][(block.first + sample) / 2] else { continue };
                        let of = |s: usize| block.y[s * q + pair.output];
                        let h = Complex64::new(of(sample), of(sample + 1));
                        let (row, factors) = (pair.first + 2 * n, pair.factors[n]);
                        let [size, angle] = decibels_and_degrees(h);
                        let turned = angle + 360.0 * ((pair.measured[n][1] - angle) / 360.0).round();
                        (y[row], y[row + 1]) = (factors[0] * size, factors[1] * turned);
                        let [re, im] = [0, 1].map(|part| block.row(sample + part, pair.output));
                        let own = &block.layout.outputs[pair.output].columns;
                        for (c, (re, im)) in own.iter().zip(re.iter().zip(im)) {
                            let part = Complex64::new(*re, *im) / h;
                            rows[row * stride + *c as usize] = factors[0] * SCALES[0] * part.re;
                            rows[(row + 1) * stride + *c as usize] = factors[1] * SCALES[1] * part.im;
                        }
                    }
                }
            });
            taken.map_err(|e| failed(reason, Unanswered::Frequency(e)))?;
        }
        Ok(())
    }
}

impl Response for Decibels {
    fn samples(&self) -> usize {
        self.y.len()
    }

    fn outputs(&self) -> usize {
        1
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        self.fill(theta, &[])?;
        y.copy_from_slice(&self.y);
        Ok(())
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        self.fill(theta, columns)?;
        sink(Block { first: 0, y: &self.y, rows: &mut self.rows, layout: &self.layout });
        Ok(())
    }
}

impl KnownNoiseResponse for Decibels {
    fn noise(&self) -> &KnownNoise {
        &self.noise
    }

    fn frequency(&self, sample: usize) -> Option<f64> {
        let pair = self.pairs.iter().find(|p| sample < p.end())?;
        Some(self.omega[pair.at[(sample - pair.first) / 2]] / TAU)
    }
}

/// One input that is 1 at all frequencies, its derivative `j w`.
fn unit(slopes: &[Option<usize>], outputs: usize, input: usize, omega: &[f64]) -> Spectrum {
    let (inputs, count) = (slopes.len(), omega.len());
    let mut given = vec![Complex64::ZERO; inputs * count];
    given[input * count..][..count].fill(Complex64::ONE);
    for k in (0..inputs).filter(|k| slopes[*k] == Some(input)) {
        given[k * count..][..count].iter_mut().zip(omega).for_each(|(d, w)| *d = Complex64::new(0.0, *w));
    }
    Spectrum {
        name: "frequency responses".into(),
        omega: omega.to_vec(),
        dt: 1.0,
        samples: 1,
        sampled_inputs: given.clone(),
        inputs: given,
        input_power: vec![1.0; inputs],
        input_ends: [vec![0.0; inputs], vec![0.0; inputs]],
        output_ends: [vec![0.0; outputs], vec![0.0; outputs]],
        ..Spectrum::default()
    }
}

/// Correlation of the noise of windowed segments `length` long at frequencies (in cycles) `distance` apart: the transform of the square of
/// Hann's window, on which segments that follow each other agree.
pub(super) fn shared(distance: f64, length: f64) -> f64 {
    let u = distance.abs() * length;
    let whole = 0.375 * sinc(u);
    let near = 0.25 * (sinc(u - 1.0) + sinc(u + 1.0));
    let far = 0.0625 * (sinc(u - 2.0) + sinc(u + 2.0));
    (whole + near + far) / 0.375
}

fn sinc(u: f64) -> f64 {
    if u.abs() < 1e-9 { 1.0 } else { fdm_grammar::math::sin(PI * u) / (PI * u) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_transform_of_the_squared_window() {
        let n = 4096;
        for (u, length) in [(0.0, 1.0), (0.4, 3.0), (1.0, 2.0), (1.7, 0.5), (2.5, 1.0), (6.3, 1.0)] {
            let at = |k: usize| (k as f64 + 0.5) / n as f64;
            let weight = |x: f64| (0.5 - 0.5 * (2.0 * PI * x).cos()).powi(2);
            let turn = |x: f64| (2.0 * PI * u * (x - 0.5)).cos();
            let sum: f64 = (0..n).map(at).map(|x| weight(x) * turn(x)).sum();
            let total: f64 = (0..n).map(at).map(weight).sum();
            assert!((shared(u / length, length) - sum / total).abs() < 1e-6, "{u}");
        }
        assert!(shared(3.0, 1.0).abs() < 1e-12, "three resolved frequencies apart nothing is shared");
    }
}
