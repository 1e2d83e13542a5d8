//! The response at the frequencies of one run, as estimation asks for it: by parameters instead of coefficients.

use super::error::Unanswered;
use crate::problem::response::{CoefficientResponse, Coefficients, PlanarResponse, Response};
use fdm_system::frequency::{EndTerms, FrequencyError, FrequencyResponse, Plans};
use fdm_system::linear::{LinearModel, Values};
use fdm_system::simulate::{Divergence, PlaneSink, Sink};
use fdm_system::spectrum::Spectrum;
use std::sync::{Arc, Mutex, PoisonError};

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
