//! A model over the frequency bins of spectra, for whoever judges them by a noise of its own: real and imaginary parts of all coefficients, scaled to one noise
//! density, and the end values and drifts of each run.
//!
//! A bin has the variance of one sample where the noise is white. Besides the end values of states, outputs have a *drift* in every run: what a
//! record begins with and ends with differ by slow noise, and that step is in all bins alike, as `1/(j w)`.
//!
//! The response at the frequencies of one run, as estimation asks for it: by parameters instead of coefficients.

use super::error::{SpectralError, Unanswered};
use super::options::SpectralOptions;
use super::setting::{Setting, band, is_linear, of_run, samples};
use crate::problem::response::{CoefficientResponse, Coefficients, PlanarResponse, Response, TimeResponse};
use crate::residuals::residuals;
use fdm_grammar::carried::CarriedTerm;
use fdm_grammar::graph::Leaf;
use fdm_grammar::model::{Output, Param, Quantity};
use fdm_system::frequency::{EndPoint, EndTerms, FrequencyError, FrequencyResponse, Plans};
use fdm_system::linear::{LinearModel, Values};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Block, Divergence, PlaneSink, RowLayout, Sink};
use fdm_system::spectrum::Spectrum;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use num_complex::Complex64;
use std::f64::consts::TAU;
use std::sync::{Arc, Mutex, PoisonError};

/// Rows that are handed over at once.
const BLOCK: usize = 64;
/// Eigenvalues below this part of the largest are nothing.
const NOTHING: f64 = 1e-12;

/// A model over the spectra of runs.
pub struct SpectralBins {
    setting: Setting,
    /// From coefficients to bins.
    scale: f64,
    /// What belongs to each run alone.
    own: Vec<OwnValue>,
}

/// A value of each run in which bins are linear.
#[derive(Debug, Clone, PartialEq)]
enum OwnValue {
    End { state: usize, point: EndPoint, name: String },
    Drift { name: String },
}

impl OwnValue {
    fn name(&self) -> &str {
        match self {
            Self::End { name, .. } | Self::Drift { name } => name,
        }
    }
}

impl SpectralBins {
    /// A model over runs; values of its parameters are those that it has.
    ///
    /// # Errors
    /// [`SpectralError`]: what the frequency domain has no answer to.
    pub fn new(model: &Model, runs: &[Run], options: &SpectralOptions) -> Result<Self, SpectralError> {
        let setting = Setting::new(model, runs, options)?;
        let longest = setting.spectra.iter().max_by(|a, b| a.duration().total_cmp(&b.duration()));
        let scale = longest.map_or(1.0, |s| (2.0 * s.samples as f64).sqrt());
        let first = setting.weighted.first().map(|s| setting.response(s)).transpose()?;
        let definition = setting.model.definition();
        let columns = first.iter().flat_map(|r| r.inner().end_columns());
        let ends = columns.zip(&setting.params[setting.own()..]).map(|(column, param)| OwnValue::End {
            state: column.state,
            point: column.point,
            name: param.quantity.name.clone(),
        });
        let drift = |name: &str| OwnValue::Drift { name: format!("drift({name})") };
        let own = ends.chain(definition.outputs.iter().map(|o| drift(&o.quantity.name))).collect();
        Ok(Self { setting, scale, own })
    }

    /// Whether a model is affine in states and inputs, as it stands.
    pub fn is_linear(model: &Model) -> bool {
        is_linear(model)
    }

    /// Nonlinear terms that are computed from records.
    pub fn measured_regressors(&self) -> &[CarriedTerm] {
        &self.setting.measured_regressors
    }

    /// Lowest and highest frequency, in cycles per unit of time.
    pub fn band(&self) -> (f64, f64) {
        band(&self.setting.spectra)
    }

    /// Whether a parameter moves any line.
    pub fn sees(&self, parameter: usize) -> bool {
        self.setting.seen.get(parameter).is_some_and(|seen| *seen)
    }

    /// Names of what belongs to each run alone: end values of states, then drifts of outputs.
    pub fn own(&self) -> impl Iterator<Item = &str> {
        self.own.iter().map(OwnValue::name)
    }

    /// The model's parameters as a fit of bins wants them: what no bin depends on is fixed, and what belongs to each run alone
    /// stands behind them.
    pub fn params(&self, mut params: Vec<Param>) -> Vec<Param> {
        params.iter_mut().zip(&self.setting.seen).filter(|(_, seen)| !**seen).for_each(|(p, _)| p.fixed = true);
        let quantity = |own: &OwnValue| Quantity { name: own.name().into(), doc: String::new(), unit: None };
        params.extend(self.own.iter().map(|own| of_run(quantity(own))));
        params
    }

    fn spectrum(&self, run: usize) -> &Spectrum {
        &self.setting.weighted[run]
    }

    /// Samples in time of a run.
    pub fn samples(&self, run: usize) -> usize {
        self.spectrum(run).samples
    }

    /// The frequency of every line of a run (2 M), in cycles per unit of time.
    pub fn frequencies(&self, run: usize) -> Vec<f64> {
        self.spectrum(run).omega.iter().flat_map(|w| [w / TAU; 2]).collect()
    }

    /// Measured bins of a run (2 M by q); NaN where nothing was measured.
    pub fn measured(&self, run: usize) -> Vec<f64> {
        let mut lines = samples(self.spectrum(run));
        lines.iter_mut().for_each(|v| *v *= self.scale);
        lines
    }

    /// The response of a run, in bins.
    ///
    /// # Errors
    /// [`SpectralError`]
    pub fn response(&self, run: usize) -> Result<BinResponse, SpectralError> {
        let spectrum = self.spectrum(run);
        let inner = self.setting.response(spectrum)?;
        let known = self.setting.params.len();
        // a line from -1/2 to 1/2: its rate is constant, and its ends are these
        let ramp = (0..spectrum.omega.len()).map(|k| {
            let [before, behind] = spectrum.end_factors(k);
            -0.5 * (before + behind) / Complex64::new(0.0, spectrum.omega[k])
        });
        let ramp = ramp.flat_map(|c| [c.re, c.im]).collect();
        Ok(BinResponse { outputs: inner.outputs(), inner, known, ramp, weights: Vec::new(), scale: self.scale })
    }

    /// What belongs to a run alone, so that its bins are met best: every output by its own deviation.
    ///
    /// # Errors
    /// [`Divergence`] where there is no response.
    pub fn settled(&self, run: usize, response: &mut BinResponse, theta: &[f64]) -> Result<Vec<f64>, Divergence> {
        let (measured, q) = (self.measured(run), response.outputs);
        let mut own = vec![0.0; self.own.len()];
        let mut rest = measured.clone();
        for _ in 0..2 {
            let sigma: Vec<f64> = (0..q).map(|o| deviation(rest.iter().skip(o).step_by(q))).collect();
            let weights: Vec<f64> = (0..rest.len()).map(|k| 1.0 / sigma[k % q]).collect();
            let weighted: Vec<f64> = measured.iter().zip(&weights).map(|(v, w)| v * w).collect();
            response.weigh(weights);
            own = response.settle(theta, &weighted)?;
            response.weigh(Vec::new());
            let all = [theta, &own].concat();
            let mut y = vec![0.0; rest.len()];
            response.simulate(&all, &mut y)?;
            rest = residuals(&measured, &y);
        }
        Ok(own)
    }

    /// What a signal of the model (a state, an input, an output) has at an end of a run, in the unit of own values: that of
    /// the named own value of another state; 0 where that is not known.
    pub fn end_like(&self, run: usize, theta: &[f64], own: &[f64], signal: &str, like: &str) -> f64 {
        let Some(point) = like.split('(').next() else { return 0.0 };
        let definition = self.setting.model.definition();
        let state = |k: usize| {
            let is = |o: &OwnValue| matches!(o, OwnValue::End { state, name, .. } if *state == k && name.split('(').next() == Some(point));
            self.own.iter().position(is).map_or(0.0, |at| own[at])
        };
        let input = |k: usize| {
            let ends = &self.spectrum(run).input_ends;
            let at = |end: usize| ends[end].get(k).copied().unwrap_or(0.0);
            match point {
                "first" => at(0),
                "last" => at(1),
                _ => at(1) - at(0),
            }
        };
        if let Some(k) = definition.states.iter().position(|s| s.quantity.name == signal) {
            return state(k);
        }
        if let Some(k) = definition.inputs.iter().position(|i| i.quantity.name == signal) {
            return input(k);
        }
        let Some(o) = definition.outputs.iter().position(|o| o.quantity.name == signal) else { return 0.0 };
        let (mut linear, mut values) = (self.setting.linear.clone(), Values::default());
        if linear.evaluate(theta, &mut values).is_err() {
            return 0.0;
        }
        let structure = linear.structure();
        let of = |term: &fdm_system::linear::Term| match term.signal as usize {
            k if k < structure.states => state(k),
            k if k < structure.states + structure.inputs => input(k - structure.states),
            _ => 0.0,
        };
        let terms = structure.terms.iter().zip(&values.terms);
        terms.filter(|(t, _)| t.row as usize == structure.states + o).map(|(t, c)| c * of(t)).sum()
    }

    /// States of a run in time (N by n): as an output shows them, else what their spectra make of them, without mean; zeros where that
    /// is not known.
    pub fn states(&self, run: usize, theta: &[f64], record: &Run) -> Vec<f64> {
        let definition = self.setting.model.definition();
        let n = definition.states.len();
        let mut states = vec![0.0; record.len() * n];
        let mut unknown = vec![true; n];
        let (mut linear, mut values) = (self.setting.linear.clone(), Values::default());
        if linear.evaluate(theta, &mut values).is_err() {
            return states;
        }
        let structure = linear.structure();
        let q = structure.outputs;
        for o in 0..q {
            let mut terms = structure.terms.iter().zip(&values.terms).filter(|(t, _)| t.row as usize == n + o);
            let (Some((term, factor)), None) = (terms.next(), terms.next()) else { continue };
            let state = term.signal as usize;
            if state < n && *factor != 0.0 && unknown[state] {
                unknown[state] = false;
                let shown = record.measured.iter().skip(o).step_by(q);
                states.iter_mut().skip(state).step_by(n).zip(shown).for_each(|(x, z)| *x = z / factor);
            }
        }
        if unknown.iter().any(|u| *u)
            && let Some(course) = self.transformed_states(run, theta)
        {
            for (to, from) in states.chunks_exact_mut(n).zip(course.chunks_exact(n)) {
                (0..n).filter(|k| unknown[*k]).for_each(|k| to[k] = from[k]);
            }
        }
        states
    }

    /// States in time by their spectra; none where these are not known.
    fn transformed_states(&self, run: usize, theta: &[f64]) -> Option<Vec<f64>> {
        let own = self.settled(run, &mut self.response(run).ok()?, theta).ok()?;
        let mut definition = self.setting.model.definition().clone();
        let states = definition.states.clone();
        definition.derived.clear();
        definition.outputs = states
            .iter()
            .enumerate()
            .map(|(k, state)| Output::new(state.quantity.clone(), definition.graph.leaf(Leaf::State(k as u32))))
            .collect();
        let model = self.setting.model.sketched(definition);
        let linear = LinearModel::new(&model).ok()?;
        let ends = self.setting.params.len() - self.setting.own();
        let mut response = self.setting.response_of(&linear, self.spectrum(run)).ok()?;
        if response.inner().end_columns().len() != ends {
            return None;
        }
        let mut lines = vec![0.0; response.samples() * states.len()];
        response.simulate(&[theta, &own[..ends]].concat(), &mut lines).ok()?;
        lines.iter_mut().for_each(|v| *v *= self.scale);
        Some(self.course(run, &lines, states.len()))
    }

    /// The course in time of what has these bins (2 M by q, N by q), but for its mean and what lies outside the band.
    pub fn course(&self, run: usize, lines: &[f64], q: usize) -> Vec<f64> {
        let spectrum = self.spectrum(run);
        let longest = self.setting.spectra.iter().map(Spectrum::duration).fold(0.0, f64::max);
        let factor = 2.0 / (self.scale * (spectrum.duration() / longest).sqrt());
        let mut course = vec![0.0; spectrum.samples * q];
        for (k, omega) in spectrum.omega.iter().enumerate() {
            let turn = Complex64::cis(omega * spectrum.dt);
            for o in 0..q {
                let mut at = Complex64::new(lines[2 * k * q + o], lines[(2 * k + 1) * q + o]) * factor;
                for row in course.chunks_exact_mut(q) {
                    row[o] += at.re;
                    at *= turn;
                }
            }
        }
        course
    }
}

fn deviation<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
    let (sum, count) = values.filter(|v| v.is_finite()).fold((0.0, 0), |(s, n), v| (s + v * v, n + 1));
    if sum > 0.0 { (sum / f64::from(count)).sqrt() } else { 1.0 }
}

/// The response of one run in bins. Parameters are the model's, then those that belong to the run alone.
pub struct BinResponse {
    inner: SpectralResponse,
    outputs: usize,
    /// Parameters and end values; drifts stand behind them.
    known: usize,
    /// Lines of a unit drift (2 M).
    ramp: Vec<f64>,
    /// What every line is multiplied with (2 M by q); nothing for 1.
    weights: Vec<f64>,
    scale: f64,
}

impl BinResponse {
    /// Multiplies every line of every output (2 M by q); nothing takes that back.
    pub fn weigh(&mut self, weights: Vec<f64>) {
        self.weights = weights;
    }

    /// Outputs and dense columns (bins by q, by `stride`).
    ///
    /// # Errors
    /// [`Divergence`] where there is no response.
    pub fn columns(
        &mut self,
        theta: &[f64],
        columns: &[usize],
        y: &mut [f64],
        (jacobian, stride): (&mut [f64], usize),
    ) -> Result<(), Divergence> {
        let q = self.outputs;
        let mut order: Vec<usize> = (0..columns.len()).filter(|c| columns[*c] < self.known).collect();
        order.sort_by_key(|c| columns[*c]);
        let asked: Vec<usize> = order.iter().map(|c| columns[*c]).collect();
        jacobian.fill(0.0);
        let mut take = |block: Block<'_>| {
            y[block.first * q..][..block.y.len()].copy_from_slice(block.y);
            for sample in 0..block.y.len() / q {
                for (o, row) in block.layout.outputs.iter().enumerate() {
                    let from = &block.rows[sample * block.layout.length + row.start..];
                    let to = &mut jacobian[((block.first + sample) * q + o) * stride..][..columns.len()];
                    row.columns.iter().zip(from).for_each(|(column, v)| to[order[*column as usize]] = *v);
                }
            }
        };
        self.inner.sensitivities(&theta[..self.known], &asked, &mut take)?;
        for (c, column) in columns.iter().enumerate().filter(|(_, column)| **column >= self.known) {
            let o = column - self.known;
            self.ramp.iter().enumerate().for_each(|(k, v)| jacobian[(k * q + o) * stride + c] = *v);
        }
        for (cell, row) in jacobian.chunks_exact_mut(stride.max(1)).enumerate() {
            let weight = self.weight(cell);
            row.iter_mut().for_each(|v| *v *= weight);
        }
        self.finish(theta, y);
        Ok(())
    }

    fn weight(&self, cell: usize) -> f64 {
        self.scale * self.weights.get(cell).copied().unwrap_or(1.0)
    }

    /// Drifts and weights.
    fn finish(&self, theta: &[f64], y: &mut [f64]) {
        let (q, drift) = (self.outputs, &theta[self.known..]);
        for (k, v) in y.iter_mut().enumerate() {
            *v = (*v + drift[k % q] * self.ramp[k / q]) * self.weight(k);
        }
    }

    /// What belongs to the run alone, so that weighted measured bins are met best.
    ///
    /// # Errors
    /// [`Divergence`] where there is no response.
    pub fn settle(&mut self, theta: &[f64], measured: &[f64]) -> Result<Vec<f64>, Divergence> {
        let count = self.known - theta.len() + self.outputs;
        let columns: Vec<usize> = (theta.len()..theta.len() + count).collect();
        let all = [theta, &vec![0.0; count]].concat();
        let (mut y, mut jacobian) = (vec![0.0; measured.len()], vec![0.0; measured.len() * count]);
        self.columns(&all, &columns, &mut y, (&mut jacobian, count))?;
        let (mut information, mut gradient) = (DMatrix::zeros(count, count), DVector::zeros(count));
        for ((row, z), y) in jacobian.chunks_exact(count).zip(measured).zip(&y).filter(|((_, z), _)| z.is_finite()) {
            let row = DVector::from_column_slice(row);
            information.ger(1.0, &row, &row, 1.0);
            gradient.axpy(z - y, &row, 1.0);
        }
        if !information.iter().chain(&gradient).all(|v: &f64| v.is_finite()) {
            return Err(Divergence { time: 0.0, state: None, sample: 0, event: None });
        }
        Ok(solved(&information, &gradient))
    }
}

/// Least squares of columns that may be combinations of each other: the shortest solution, in units of the columns.
fn solved(information: &DMatrix<f64>, gradient: &DVector<f64>) -> Vec<f64> {
    let inverse = information.diagonal().map(|v| if v > 0.0 { 1.0 / v.sqrt() } else { 0.0 });
    let count = gradient.len();
    let eigen =
        SymmetricEigen::new(DMatrix::from_fn(count, count, |i, j| information[(i, j)] * inverse[i] * inverse[j]));
    let largest = eigen.eigenvalues.max();
    let along = eigen.eigenvectors.tr_mul(&gradient.component_mul(&inverse));
    let parts = along.zip_map(&eigen.eigenvalues, |a, l| if l > NOTHING * largest { a / l } else { 0.0 });
    (&eigen.eigenvectors * parts).component_mul(&inverse).iter().copied().collect()
}

impl Response for BinResponse {
    fn samples(&self) -> usize {
        self.inner.samples()
    }

    fn outputs(&self) -> usize {
        self.outputs
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        self.inner.simulate(&theta[..self.known], y)?;
        self.finish(theta, y);
        Ok(())
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        let (n, q, p) = (self.samples(), self.outputs, columns.len());
        let stride = p.max(1);
        let (mut y, mut jacobian) = (vec![0.0; n * q], vec![0.0; n * q * stride]);
        self.columns(theta, columns, &mut y, (&mut jacobian, stride))?;
        let layout = RowLayout::full(q, p);
        let mut rows = vec![0.0; BLOCK * layout.length];
        for first in (0..n).step_by(BLOCK) {
            let samples = BLOCK.min(n - first);
            rows.fill(0.0);
            for k in 0..samples {
                for (o, row) in layout.outputs.iter().enumerate() {
                    let from = &jacobian[((first + k) * q + o) * stride..][..p];
                    rows[k * layout.length + row.start..][..p].copy_from_slice(from);
                }
            }
            let rows = &mut rows[..samples * layout.length];
            sink(Block { first, y: &y[first * q..][..samples * q], rows, layout: &layout });
        }
        Ok(())
    }
}

// whitened, its bins are what samples in time are
impl TimeResponse for BinResponse {}

/// The first reason why a response failed, for whoever asks behind the estimation.
pub(crate) type Reason = Arc<Mutex<Option<Unanswered>>>;

/// One run. Parameters are the model's, then the unknown end values.
pub(super) struct SpectralResponse {
    linear: LinearModel,
    values: Values,
    response: FrequencyResponse,
    params: usize,
    omega: Vec<f64>,
    samples: usize,
    dt: f64,
    reason: Reason,
}

impl SpectralResponse {
    /// The response to the inputs of a spectrum, for a model evaluated at `theta` (p).
    ///
    /// # Errors
    /// [`Unanswered`].
    pub(super) fn new(
        linear: &LinearModel,
        theta: &[f64],
        spectrum: &Spectrum,
        ends: &EndTerms,
        plans: &Arc<Plans>,
        reason: &Reason,
    ) -> Result<Self, Unanswered> {
        let (mut linear, mut values) = (linear.clone(), Values::default());
        linear.evaluate(theta, &mut values).map_err(Unanswered::Trim)?;
        let structure = linear.structure().clone();
        let response =
            FrequencyResponse::new(&structure, &values, spectrum, ends, plans).map_err(Unanswered::Frequency)?;
        Ok(Self {
            params: structure.params,
            linear,
            values,
            response,
            omega: spectrum.omega.clone(),
            samples: spectrum.samples,
            dt: spectrum.dt,
            reason: reason.clone(),
        })
    }

    /// The response itself.
    pub(super) fn inner(&self) -> &FrequencyResponse {
        &self.response
    }

    fn evaluate(&mut self, theta: &[f64]) -> Result<(), Divergence> {
        let at = self.linear.evaluate(&theta[..self.params], &mut self.values);
        at.map_err(|e| failed(&self.reason, Unanswered::Trim(e)))
    }
}

/// Keeps the reason; what estimation sees is that there is no response.
pub(crate) fn failed(reason: &Reason, why: Unanswered) -> Divergence {
    let sample = match &why {
        Unanswered::Frequency(FrequencyError::Singular { frequency, .. }) => 2 * frequency,
        _ => 0,
    };
    reason.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(why);
    Divergence { time: 0.0, state: None, sample, event: None }
}

impl Response for SpectralResponse {
    fn samples(&self) -> usize {
        2 * self.response.frequencies()
    }

    fn outputs(&self) -> usize {
        self.response.outputs()
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        self.evaluate(theta)?;
        let Self { response, values, params, reason, .. } = self;
        response.simulate(values, &theta[*params..], y).map_err(|e| failed(reason, Unanswered::Frequency(e)))
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        self.evaluate(theta)?;
        let Self { response, values, params, reason, .. } = self;
        let done = response.sensitivities(values, &theta[*params..], columns, sink);
        done.map_err(|e| failed(reason, Unanswered::Frequency(e)))
    }

    fn planar(&mut self) -> Option<&mut dyn PlanarResponse> {
        Some(self)
    }
}

impl PlanarResponse for SpectralResponse {
    fn planes(&mut self, theta: &[f64], columns: &[usize], sink: &mut PlaneSink<'_>) -> Result<(), Divergence> {
        self.evaluate(theta)?;
        let Self { response, values, params, reason, .. } = self;
        let done = response.planes(values, &theta[*params..], columns, sink);
        done.map_err(|e| failed(reason, Unanswered::Frequency(e)))
    }
}

impl CoefficientResponse for SpectralResponse {
    fn coefficients(&self) -> Coefficients<'_> {
        Coefficients { omega: &self.omega, samples: self.samples, dt: self.dt }
    }
}
