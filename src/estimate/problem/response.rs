//! What a model answers in one run, and what its numbers are: samples in time, coefficients of a whole record, or numbers whose noise
//! is known.

use fdm_system::simulate::{Divergence, PlaneSink, Simulator, Sink};
use fdm_system::spectrum::independent;
use std::f64::consts::TAU;
use std::ops::{Deref, DerefMut};

/// One run's model response and its exact sensitivities.
///
/// Equal parameters must give equal bits, with and without sensitivities and in whatever order they are asked.
pub trait Response: Send {
    /// Number of samples N.
    fn samples(&self) -> usize;

    /// Number of outputs q.
    fn outputs(&self) -> usize;

    /// Outputs, N by q row-major, at the parameters `theta` (p, in the model's order).
    ///
    /// # Errors
    /// [`Divergence`] when the simulation cannot reach the end of the run; `y` is then of no use.
    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence>;

    /// Outputs and their partials by `theta[columns[j]]`, all samples in blocks to `sink`.
    ///
    /// # Errors
    /// As [`Response::simulate`]; blocks before the failure may have been handed over.
    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence>;

    /// The response in planes, where it is one of frequencies, of which real and imaginary part are two samples one after the other.
    fn planar(&mut self) -> Option<&mut dyn PlanarResponse> {
        None
    }
}

/// A response of frequencies that is handed over in planes.
pub trait PlanarResponse: Response {
    /// As [`Response::sensitivities`], in planes.
    ///
    /// # Errors
    /// As [`Response::simulate`].
    fn planes(&mut self, theta: &[f64], columns: &[usize], sink: &mut PlaneSink<'_>) -> Result<(), Divergence>;
}

/// A response of samples in time, whose noise is estimated.
pub trait TimeResponse: Response {
    /// Time of each sample (N), rising; none when only their order is known.
    fn time(&self) -> Option<&[f64]> {
        None
    }
}

/// A response of samples in time over the deviations that the model states for their noise.
pub trait StandardisedResponse: TimeResponse {
    /// What the last evaluation adds to the cost beside half the squares of the residuals: rows and residuals then give its gradient and
    /// its information.
    fn surcharge(&self) -> f64;
}

/// A response of Fourier coefficients of a whole record: sample 2 k is the real part at frequency k, 2 k + 1 the imaginary part.
pub trait CoefficientResponse: Response {
    /// What the samples are coefficients of.
    fn coefficients(&self) -> Coefficients<'_>;
}

/// A response with one output, of whose measured numbers the noise is known from another source than the residuals.
pub trait KnownNoiseResponse: Response {
    /// The noise of the measured numbers.
    fn noise(&self) -> &KnownNoise;

    /// The frequency, in cycles per unit of time, that a number belongs to.
    fn frequency(&self, sample: usize) -> Option<f64>;
}

/// The response of a run, by what its numbers are.
pub enum RunResponse<'a> {
    /// Samples in time.
    InTime(Box<dyn TimeResponse + 'a>),
    /// Samples in time over their stated deviations.
    Standardised(Box<dyn StandardisedResponse + 'a>),
    /// Coefficients of the whole record.
    Coefficients(Box<dyn CoefficientResponse + 'a>),
    /// Numbers of known noise.
    KnownNoise(Box<dyn KnownNoiseResponse + 'a>),
}

impl<'a> RunResponse<'a> {
    /// Of samples in time.
    pub fn in_time(response: impl TimeResponse + 'a) -> Self {
        Self::InTime(Box::new(response))
    }

    /// Time of each sample (N), rising; none when only their order is known, or they are no samples in time.
    pub(crate) fn time(&self) -> Option<&[f64]> {
        match self {
            Self::InTime(response) => response.time(),
            Self::Standardised(response) => response.time(),
            Self::Coefficients(_) | Self::KnownNoise(_) => None,
        }
    }

    /// The frequency, in cycles per unit of time, that a sample belongs to, when it is not one in time.
    pub(crate) fn frequency(&self, sample: usize) -> Option<f64> {
        match self {
            Self::InTime(_) | Self::Standardised(_) => None,
            Self::Coefficients(response) => Some(response.coefficients().omega.get(sample / 2)? / TAU),
            Self::KnownNoise(response) => response.frequency(sample),
        }
    }
}

impl<'a> Deref for RunResponse<'a> {
    type Target = dyn Response + 'a;

    fn deref(&self) -> &Self::Target {
        match self {
            Self::InTime(response) => &**response,
            Self::Standardised(response) => &**response,
            Self::Coefficients(response) => &**response,
            Self::KnownNoise(response) => &**response,
        }
    }
}

impl DerefMut for RunResponse<'_> {
    fn deref_mut(&mut self) -> &mut Self::Target {
        match self {
            Self::InTime(response) => &mut **response,
            Self::Standardised(response) => &mut **response,
            Self::Coefficients(response) => &mut **response,
            Self::KnownNoise(response) => &mut **response,
        }
    }
}

/// Noise that is known beforehand, from another source than the residuals.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct KnownNoise {
    /// Standard deviation of each number (N).
    pub deviations: Vec<f64>,
    /// Pairs of numbers (the first one before the second) whose noise correlates, with the correlation.
    pub correlations: Vec<(u32, u32, f64)>,
}

/// Fourier coefficients as the samples of a response.
#[derive(Debug, Clone, Copy)]
pub struct Coefficients<'a> {
    /// Angular frequencies (M), rising.
    pub omega: &'a [f64],
    /// Samples in time that were transformed.
    pub samples: usize,
    /// Time between them.
    pub dt: f64,
}

impl Coefficients<'_> {
    /// How many independent frequencies these are worth: closer than one cycle in the record they repeat each other.
    pub fn independent(&self) -> f64 {
        independent(self.omega, self.samples as f64 * self.dt)
    }
}

impl Response for Simulator<'_> {
    fn samples(&self) -> usize {
        self.samples()
    }

    fn outputs(&self) -> usize {
        self.outputs()
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        self.simulate(theta, y)
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        self.stream(theta, columns, sink)
    }
}

impl TimeResponse for Simulator<'_> {
    fn time(&self) -> Option<&[f64]> {
        Some(&self.run().time)
    }
}
