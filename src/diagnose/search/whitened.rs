//! A run seen through its noise: lines of the cosine transform, divided by the noise's deviation, so that the estimator of
//! the time domain fits them as samples of unit noise.

use super::evenly::interval;
use super::metric::Metric;
use crate::estimate::Response;
use crate::record::Run;
use crate::simulate::{Block, Divergence, RowLayout, Simulator, Sink};
use rustdct::{DctPlanner, TransformType2And3};
use std::sync::Arc;

/// Samples that are handed over at once.
const BLOCK: usize = 64;

/// What turns signals of a run (N by q) into whitened lines (N by q).
pub(super) struct Lens {
    dct: Arc<dyn TransformType2And3<f64>>,
    outputs: usize,
    /// Factor of every line, N by q.
    weight: Vec<f64>,
    /// Whether a sample was measured, N by q.
    present: Vec<bool>,
    line: Vec<f64>,
    scratch: Vec<f64>,
}

impl Lens {
    pub(super) fn new(run: &Run, outputs: usize, metric: &Metric) -> Self {
        let n = run.len();
        let dct = DctPlanner::new().plan_dct2(n);
        let present: Vec<bool> = run.measured.iter().map(|z| !z.is_nan()).collect();
        let seen: Vec<bool> = (0..outputs).map(|o| present.iter().skip(o).step_by(outputs).any(|p| *p)).collect();
        let dt = interval(run);
        let weight = |at: usize| {
            let (k, o) = (at / outputs, at % outputs);
            let orthonormal = if k == 0 { 1.0 / n as f64 } else { 2.0 / n as f64 };
            if seen[o] { orthonormal.sqrt() / metric.deviation(o, k, n, dt) } else { 0.0 }
        };
        Self {
            scratch: vec![0.0; dct.get_scratch_len()],
            dct,
            outputs,
            weight: (0..n * outputs).map(weight).collect(),
            present,
            line: vec![0.0; n],
        }
    }

    /// The lines of output `o` of a signal whose sample `k` is `signal(k)`.
    fn lines(&mut self, o: usize, signal: impl Fn(usize) -> f64) -> impl Iterator<Item = f64> + '_ {
        let q = self.outputs;
        for (k, value) in self.line.iter_mut().enumerate() {
            // where nothing was measured, nothing is compared
            *value = if self.present[k * q + o] { signal(k) } else { 0.0 };
        }
        self.dct.process_dct2_with_scratch(&mut self.line, &mut self.scratch);
        self.line.iter().zip(self.weight.iter().skip(o).step_by(q)).map(|(value, weight)| value * weight)
    }

    /// A signal (N by q) in lines, in its place.
    pub(super) fn apply(&mut self, signal: &mut [f64]) {
        let q = self.outputs;
        for o in 0..q {
            let column: Vec<f64> = self.lines(o, |k| signal[k * q + o]).collect();
            column.into_iter().enumerate().for_each(|(k, value)| signal[k * q + o] = value);
        }
    }

    /// A signal in lines.
    pub(super) fn seen(&mut self, signal: &[f64]) -> Vec<f64> {
        let mut lines = signal.to_vec();
        self.apply(&mut lines);
        lines
    }
}

/// The response of a run, through a lens.
pub(super) struct Whitened<'a> {
    simulator: Simulator<'a>,
    lens: Lens,
    y: Vec<f64>,
    jacobian: Vec<f64>,
    rows: Vec<f64>,
}

impl<'a> Whitened<'a> {
    pub(super) fn new(simulator: Simulator<'a>, lens: Lens) -> Self {
        let y = vec![0.0; simulator.samples() * simulator.outputs()];
        Self { simulator, lens, y, jacobian: Vec::new(), rows: Vec::new() }
    }
}

impl Response for Whitened<'_> {
    fn samples(&self) -> usize {
        self.simulator.samples()
    }

    fn outputs(&self) -> usize {
        self.simulator.outputs()
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        self.simulator.simulate(theta, y)?;
        self.lens.apply(y);
        Ok(())
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        let (n, q, p) = (self.simulator.samples(), self.simulator.outputs(), columns.len());
        let stride = p.next_multiple_of(8);
        self.jacobian.resize(n * q * stride, 0.0);
        self.simulator.sensitivities(theta, columns, &mut self.y, &mut self.jacobian)?;
        self.lens.apply(&mut self.y);
        for o in 0..q {
            for c in 0..p {
                let jacobian = &mut self.jacobian;
                let column: Vec<f64> = self.lens.lines(o, |k| jacobian[(k * q + o) * stride + c]).collect();
                column.into_iter().enumerate().for_each(|(k, value)| jacobian[(k * q + o) * stride + c] = value);
            }
        }
        let layout = RowLayout::full(q, p);
        self.rows.resize(BLOCK * layout.length, 0.0);
        for first in (0..n).step_by(BLOCK) {
            let samples = BLOCK.min(n - first);
            self.rows.fill(0.0);
            for k in 0..samples {
                for (o, row) in layout.outputs.iter().enumerate() {
                    let from = &self.jacobian[((first + k) * q + o) * stride..][..p];
                    self.rows[k * layout.length + row.start..][..p].copy_from_slice(from);
                }
            }
            let rows = &mut self.rows[..samples * layout.length];
            sink(Block { first, y: &self.y[first * q..][..samples * q], rows, layout: &layout });
        }
        Ok(())
    }
}
