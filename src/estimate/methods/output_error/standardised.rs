//! Outputs whose noise has a standard deviation s that is an expression: residuals v as e = v/s, and what s adds to the likelihood.
//!
//! What is simulated is p = 1/s, so that an infinite deviation, of a sample that says nothing, is a number. Minus the logarithm of the likelihood is the sum of `e^2/2 + log s`, with the gradient `-(dy/s) e - (ds/s)(e^2 - 1)` and Fisher's information
//! `(dy/s)(dy/s)' + 2 (ds/s)(ds/s)'` (Davidian and Carroll 1987). So two outputs of unit noise stand for one: the first has the residual e and the row dy/s, the
//! second the residual `(e^2 - 1)/sqrt 2` and the row `sqrt 2 ds/s`. Gradient and information are then those of least squares; the cost is not, and
//! [`Response::surcharge`] makes up for it.

use crate::problem::response::{Response, StandardisedResponse, TimeResponse};
use fdm_system::simulate::{Block, Divergence, RowLayout, Simulator, Sink};
use std::f64::consts::SQRT_2;

/// The response of a model that has one over its deviations as outputs behind its own.
pub(crate) struct Standardised<'a> {
    simulator: Simulator<'a>,
    /// Measured outputs of the model (N by q); NaN where nothing is compared.
    measured: Vec<f64>,
    /// For each output of the model (q) which of the simulated ones is one over its deviation.
    deviations: Vec<Option<usize>>,
    surcharge: f64,
}

/// An output of the standardised response.
#[derive(Debug, Clone, Copy)]
enum Part {
    /// As it was simulated.
    Plain(usize),
    /// Residual over deviation: output and p.
    Residual(usize, usize),
    /// The score of the deviation.
    Score(usize, usize),
}

impl<'a> Standardised<'a> {
    /// The run's outputs by `simulator`, q of the model and then p for each of `deviations` that has one.
    pub(crate) fn new(simulator: Simulator<'a>, measured: Vec<f64>, deviations: Vec<Option<usize>>) -> Self {
        Self { simulator, measured, deviations, surcharge: 0.0 }
    }

    /// The outputs one by one.
    fn parts(deviations: &[Option<usize>]) -> Vec<Part> {
        let of = |(o, deviation): (usize, &Option<usize>)| match deviation {
            Some(s) => vec![Part::Residual(o, *s), Part::Score(o, *s)],
            None => vec![Part::Plain(o)],
        };
        deviations.iter().enumerate().flat_map(of).collect()
    }

    /// What is compared with the outputs (N by their number): zero for residuals.
    pub(crate) fn targets(&self) -> Vec<f64> {
        let parts = Self::parts(&self.deviations);
        let target = |z: &[f64], part: &Part| match part {
            Part::Plain(o) => z[*o],
            Part::Residual(o, _) | Part::Score(o, _) if z[*o].is_nan() => f64::NAN,
            Part::Residual(..) | Part::Score(..) => 0.0,
        };
        let q = self.deviations.len();
        self.measured.chunks_exact(q).flat_map(|z| parts.iter().map(move |part| target(z, part))).collect()
    }

    /// Which output of the model each output stands for, and whether it is the one to be looked at.
    pub(crate) fn shown(deviations: &[Option<usize>]) -> Vec<Option<usize>> {
        let of = |part: Part| match part {
            Part::Plain(o) | Part::Residual(o, _) => Some(o),
            Part::Score(..) => None,
        };
        Self::parts(deviations).into_iter().map(of).collect()
    }
}

/// Adds to the cost what the squares do not say of it.
fn outputs_of(parts: &[Part], y: &[f64], z: &[f64], to: &mut [f64], surcharge: &mut f64) {
    for (to, part) in to.iter_mut().zip(parts) {
        *to = match *part {
            Part::Plain(o) => y[o],
            Part::Residual(o, s) => (y[o] - z[o]) * y[s],
            Part::Score(o, s) => {
                let e = (z[o] - y[o]) * y[s];
                let score = (e * e - 1.0) / SQRT_2;
                if !z[o].is_nan() {
                    *surcharge -= y[s].abs().ln() + 0.5 * score * score;
                }
                -score
            }
        };
    }
}

impl Response for Standardised<'_> {
    fn samples(&self) -> usize {
        self.simulator.samples()
    }

    fn outputs(&self) -> usize {
        Self::parts(&self.deviations).len()
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        let (simulated, q) = (self.simulator.outputs(), self.deviations.len());
        let parts = Self::parts(&self.deviations);
        let mut all = vec![0.0; self.simulator.samples() * simulated];
        self.simulator.simulate(theta, &mut all)?;
        self.surcharge = 0.0;
        let negative = |(z, s): (&f64, &Option<usize>), all: &[f64]| !z.is_nan() && s.is_some_and(|s| all[s] < 0.0);
        let mut rows = all.chunks_exact(simulated).zip(self.measured.chunks_exact(q));
        // beyond zero the likelihood would be that of the absolute value, and the estimate no deviation
        if let Some(sample) = rows.position(|(all, z)| z.iter().zip(&self.deviations).any(|pair| negative(pair, all))) {
            let time = self.simulator.run().time[sample];
            return Err(Divergence { time, state: None, sample: sample.saturating_sub(1), event: None });
        }
        let samples = all.chunks_exact(simulated).zip(self.measured.chunks_exact(q));
        for ((all, z), y) in samples.zip(y.chunks_exact_mut(parts.len())) {
            outputs_of(&parts, all, z, y, &mut self.surcharge);
        }
        Ok(())
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        let Self { simulator, measured, deviations, surcharge } = self;
        let (simulated, q) = (simulator.outputs(), deviations.len());
        let parts = Self::parts(deviations);
        let (mut known, mut layout) = (RowLayout::default(), RowLayout::default());
        let (mut y, mut rows) = (Vec::new(), Vec::new());
        *surcharge = 0.0;
        simulator.stream(theta, columns, &mut |block| {
            if known != *block.layout {
                known = block.layout.clone();
                layout = RowLayout::new(parts.iter().map(|part| known.outputs[row_of(*part)].columns.clone()));
            }
            y.clear();
            y.resize(block.samples() * parts.len(), 0.0);
            rows.clear();
            rows.resize(block.samples() * layout.length, 0.0);
            for sample in 0..block.samples() {
                let all = &block.y[sample * simulated..][..simulated];
                let z = &measured[(block.first + sample) * q..][..q];
                outputs_of(&parts, all, z, &mut y[sample * parts.len()..][..parts.len()], surcharge);
                for (part, place) in parts.iter().zip(&layout.outputs) {
                    let factor = match *part {
                        Part::Plain(_) => 1.0,
                        Part::Residual(_, s) => all[s],
                        // ds/s is -dp/p
                        Part::Score(_, s) => -SQRT_2 / all[s],
                    };
                    let row = &mut rows[sample * layout.length + place.start..][..place.columns.len()];
                    let from = block.row(sample, row_of(*part));
                    row.iter_mut().zip(from).for_each(|(to, value)| *to = factor * value);
                }
            }
            sink(Block { first: block.first, y: &y, rows: &mut rows, layout: &layout });
        })
    }
}

impl StandardisedResponse for Standardised<'_> {
    fn surcharge(&self) -> f64 {
        self.surcharge
    }
}

impl TimeResponse for Standardised<'_> {
    fn time(&self) -> Option<&[f64]> {
        Some(&self.simulator.run().time)
    }
}

/// The simulated output whose row a part's row is a multiple of.
fn row_of(part: Part) -> usize {
    let (Part::Plain(k) | Part::Residual(k, _) | Part::Score(_, k)) = part;
    k
}
