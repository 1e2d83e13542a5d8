//! Prediction bands: how far the response of a run is known, by the errors of the parameters, and where a new measurement of it may lie.
//!
//! With S the sensitivities of the response and C the covariance of the parameters, the variance of a sample is the diagonal of `S C S'`. Parameters that
//! are estimated anew in the predicted run (biases, initial states) follow the others as that estimation does: `S - Sb K`, with `K` the regression of S
//! on their own sensitivities Sb; their own covariance is added.

use fdm_estimate::quantile;
use fdm_numeric::lanes::VECTOR;
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Block, Divergence, Simulator, Steps, Unsuited};
use nalgebra::DMatrix;

/// Why there is no band.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BandError {
    /// The run cannot be simulated.
    #[error(transparent)]
    Unsuited(#[from] Unsuited),
    /// The response diverges.
    #[error("the response diverges at time {}", .0.time)]
    Diverged(Divergence),
}

/// A covariance of parameters, and how well it is known.
#[derive(Debug, Clone, Copy)]
pub struct Errors<'a> {
    /// Parameters (indices into theta) that it is about (n).
    pub columns: &'a [usize],
    /// Their covariance (n by n).
    pub covariance: &'a [f64],
}

/// What is predicted.
#[derive(Debug, Clone)]
pub struct Predicted<'a> {
    /// The model; the parameters of both errors have derivatives in it.
    pub model: &'a Model,
    /// The run.
    pub run: &'a Run,
    /// Its steps.
    pub steps: Steps,
    /// All parameters (p).
    pub theta: &'a [f64],
    /// Errors of what the fit found.
    pub errors: Errors<'a>,
    /// Errors of what was estimated anew in this run.
    pub anew: Errors<'a>,
    /// Standard deviation of the measurement noise of each output (q); NaN where it is not known.
    pub noise: &'a [f64],
    /// The fewest degrees of freedom of the errors, where they are known.
    pub freedom: Option<f64>,
}

/// Half widths of 95 % bands, N by q.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Bands {
    /// Of the response itself, by the errors of the parameters.
    pub response: Vec<f64>,
    /// Of a new measurement: by the errors and by the noise, whose standard deviation is at each sample its own; NaN where it is not known.
    pub measurement: Vec<f64>,
}

impl Predicted<'_> {
    /// The bands.
    ///
    /// # Errors
    /// [`BandError`].
    pub fn bands(&self) -> Result<Bands, BandError> {
        let q = self.model.layout().outputs;
        let count = self.run.len() * q;
        let (own, anew) = (self.errors.columns.len(), self.anew.columns.len());
        let columns: Vec<usize> = self.errors.columns.iter().chain(self.anew.columns).copied().collect();
        let mut variance = vec![0.0; count];
        if own + anew > 0 {
            let follows = if own > 0 && anew > 0 { self.follows(&columns)? } else { DMatrix::zeros(anew, own) };
            let fixed = DMatrix::from_row_slice(own, own, self.errors.covariance);
            let free = DMatrix::from_row_slice(anew, anew, self.anew.covariance);
            // the columns of both: [C 0; 0 Cb] after the regression
            let mut moved = DMatrix::identity(own + anew, own + anew);
            moved.view_mut((own, 0), (anew, own)).copy_from(&-&follows);
            let mut both = DMatrix::zeros(own + anew, own + anew);
            both.view_mut((0, 0), (own, own)).copy_from(&fixed);
            both.view_mut((own, own), (anew, anew)).copy_from(&free);
            let all = &moved * both * moved.transpose();
            let n = own + anew;
            self.each(&columns, |sample, output, row| {
                let mut sum = 0.0;
                for (i, a) in row.iter().enumerate().filter(|(_, a)| **a != 0.0) {
                    sum += a * (0..n).map(|j| all[(i, j)] * row[j]).sum::<f64>();
                }
                variance[sample * q + output] = sum.max(0.0);
            })?;
        }
        let wide = quantile(self.freedom);
        let noise = self.noises()?;
        let response = variance.iter().map(|v| wide * v.sqrt()).collect();
        let measurement = variance.iter().zip(&noise).map(|(v, s)| wide * (v + s * s).sqrt()).collect();
        Ok(Bands { response, measurement })
    }

    /// The standard deviation of the noise at each sample (N by q): as it was estimated, or by its expression.
    fn noises(&self) -> Result<Vec<f64>, BandError> {
        let definition = self.model.definition();
        let q = definition.outputs.len();
        let mut all: Vec<f64> = (0..self.run.len()).flat_map(|_| self.noise.iter().copied()).collect();
        let Some(with) = definition.with_precisions() else { return Ok(all) };
        let with = self.model.sketched(with);
        let width = with.layout().outputs;
        let mut y = vec![f64::NAN; self.run.len() * width];
        let run = self.run.with_channels(&(0..self.run.held.len()).collect::<Vec<_>>(), &[]);
        let mut simulator = Simulator::new(with.dynamics(), &run, self.steps.clone())?;
        simulator.simulate(self.theta, &mut y).map_err(BandError::Diverged)?;
        let noisy = definition.outputs.iter().enumerate().filter(|(_, o)| o.noise_model.is_some());
        for (k, (output, _)) in noisy.enumerate() {
            for (own, row) in all.chunks_mut(q).zip(y.chunks(width)) {
                own[output] = (1.0 / row[q + k]).abs();
            }
        }
        Ok(all)
    }

    /// How the parameters that are estimated anew follow the others: by least squares over the compared samples.
    fn follows(&self, columns: &[usize]) -> Result<DMatrix<f64>, BandError> {
        let q = self.model.layout().outputs;
        let (own, anew) = (self.errors.columns.len(), self.anew.columns.len());
        let (mut normal, mut side) = (DMatrix::<f64>::zeros(anew, anew), DMatrix::<f64>::zeros(anew, own));
        let weights: Vec<f64> = self.noise.iter().map(|s| if *s > 0.0 { 1.0 / (s * s) } else { 1.0 }).collect();
        self.each(columns, |sample, output, row| {
            if self.run.measured[sample * q + output].is_nan() {
                return;
            }
            let weight = weights[output];
            for i in 0..anew {
                let a = weight * row[own + i];
                if a != 0.0 {
                    (0..anew).for_each(|j| normal[(i, j)] += a * row[own + j]);
                    (0..own).for_each(|j| side[(i, j)] += a * row[j]);
                }
            }
        })?;
        let scale: Vec<f64> = (0..anew).map(|i| normal[(i, i)].sqrt()).collect();
        let scaled = DMatrix::from_fn(anew, anew, |i, j| {
            let size = scale[i] * scale[j];
            if size > 0.0 { normal[(i, j)] / size } else { f64::from(u8::from(i == j)) }
        });
        let over = |i: usize| if scale[i] > 0.0 { 1.0 / scale[i] } else { 0.0 };
        let right = DMatrix::from_fn(anew, own, |i, j| side[(i, j)] * over(i));
        // what the record does not determine stays where it is
        let inverse = scaled.pseudo_inverse(1e-10).unwrap_or_else(|_| DMatrix::zeros(anew, anew));
        let found = inverse * right;
        Ok(DMatrix::from_fn(anew, own, |i, j| found[(i, j)] * over(i)))
    }

    /// Visits the derivatives of every sample and output by the columns.
    fn each(&self, columns: &[usize], mut visit: impl FnMut(usize, usize, &[f64])) -> Result<(), BandError> {
        let mut simulator = Simulator::new(self.model.dynamics(), self.run, self.steps.clone())?;
        let mut dense = vec![0.0; columns.len().next_multiple_of(VECTOR)];
        let sink = &mut |block: Block<'_>| {
            for sample in 0..block.samples() {
                for (output, own) in block.layout.outputs.iter().enumerate() {
                    dense.fill(0.0);
                    let row = block.row(sample, output);
                    own.columns.iter().zip(row).for_each(|(c, v)| dense[*c as usize] = *v);
                    visit(block.first + sample, output, &dense[..columns.len()]);
                }
            }
        };
        simulator.stream(self.theta, columns, sink).map_err(BandError::Diverged)
    }
}

impl Bands {
    /// Of the measured samples of an output (of q) the share that lies within the band of measurements; none where nothing was measured or the noise is
    /// not known.
    pub fn covered(&self, output: usize, q: usize, residuals: &[f64]) -> Option<f64> {
        let pairs = residuals.iter().zip(&self.measurement).skip(output).step_by(q);
        let (mut inside, mut all) = (0_usize, 0_usize);
        for (v, half) in pairs.filter(|(v, half)| v.is_finite() && half.is_finite()) {
            all += 1;
            inside += usize::from(v.abs() <= *half);
        }
        (all > 0).then(|| inside as f64 / all as f64)
    }
}
