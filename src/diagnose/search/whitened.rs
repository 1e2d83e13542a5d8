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

/// What turns signals of a run (N by q) into whitened lines (N by q): every output's measured samples, closed up, in lines; zeros
/// behind them.
pub(super) struct Lens {
    outputs: usize,
    views: Vec<View>,
    line: Vec<f64>,
    scratch: Vec<f64>,
}

/// One output.
struct View {
    /// None where signals are lines already.
    dct: Option<Arc<dyn TransformType2And3<f64>>>,
    /// Samples that were measured.
    samples: Vec<usize>,
    /// Factor of every line.
    weight: Vec<f64>,
    /// Logarithm of the frequency of every line; that of the mean is minus infinity.
    log_frequency: Vec<f64>,
}

impl View {
    fn new(run: &Run, (o, q): (usize, usize), metric: &Metric, planner: &mut DctPlanner<f64>) -> Self {
        let samples: Vec<usize> = (0..run.len()).filter(|k| !run.measured[k * q + o].is_nan()).collect();
        let n = samples.len();
        let dt = interval(run) * spacing(&samples);
        let orthonormal = |k: usize| if k == 0 { 1.0 / n as f64 } else { 2.0 / n as f64 };
        let weight = (0..n).map(|k| orthonormal(k).sqrt() / metric.deviation(o, k, n, dt)).collect();
        let log_frequency = (0..n).map(|k| (k as f64 / (2.0 * n as f64 * dt)).ln()).collect();
        Self { dct: Some(planner.plan_dct2(n.max(1))), samples, weight, log_frequency }
    }

    /// Of lines at these frequencies.
    fn of_lines(measured: &[f64], (o, q): (usize, usize), frequencies: &[f64], metric: &Metric) -> Self {
        let samples: Vec<usize> = (0..frequencies.len()).filter(|k| !measured[k * q + o].is_nan()).collect();
        let weight = samples.iter().map(|k| 1.0 / metric.at(o, frequencies[*k])).collect();
        let log_frequency = samples.iter().map(|k| frequencies[*k].ln()).collect();
        Self { dct: None, samples, weight, log_frequency }
    }
}

impl View {
    fn scratch(&self) -> usize {
        self.dct.as_ref().map_or(0, |dct| dct.get_scratch_len())
    }
}

/// The usual distance between samples that follow each other.
fn spacing(samples: &[usize]) -> f64 {
    let mut steps: Vec<usize> = samples.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_unstable();
    steps.get(steps.len() / 2).map_or(1.0, |step| *step as f64)
}

impl Lens {
    pub(super) fn new(run: &Run, outputs: usize, metric: &Metric) -> Self {
        let mut planner = DctPlanner::new();
        let views: Vec<View> = (0..outputs).map(|o| View::new(run, (o, outputs), metric, &mut planner)).collect();
        let scratch = views.iter().map(View::scratch).max().unwrap_or(0);
        Self { outputs, views, line: vec![0.0; run.len()], scratch: vec![0.0; scratch] }
    }

    /// For signals that are lines already, of a run that has these.
    pub(super) fn of_lines(measured: &[f64], outputs: usize, frequencies: &[f64], metric: &Metric) -> Self {
        let views = (0..outputs).map(|o| View::of_lines(measured, (o, outputs), frequencies, metric)).collect();
        Self { outputs, views, line: vec![0.0; frequencies.len()], scratch: Vec::new() }
    }

    /// The lines of output `o` of a signal whose sample `k` is `signal(k)`, N of them.
    fn lines(&mut self, o: usize, signal: impl Fn(usize) -> f64) -> &[f64] {
        let Self { views, line, scratch, .. } = self;
        let view = &views[o];
        let (own, rest) = line.split_at_mut(view.samples.len());
        rest.fill(0.0);
        if own.is_empty() {
            return line;
        }
        own.iter_mut().zip(&view.samples).for_each(|(value, k)| *value = signal(*k));
        if let Some(dct) = &view.dct {
            dct.process_dct2_with_scratch(own, &mut scratch[..dct.get_scratch_len()]);
        }
        own.iter_mut().zip(&view.weight).for_each(|(value, weight)| *value *= weight);
        line
    }

    /// A signal (N by q) in lines, in its place.
    pub(super) fn apply(&mut self, signal: &mut [f64]) {
        let q = self.outputs;
        for o in 0..q {
            let lines = self.lines(o, |k| signal[k * q + o]);
            // read before they are written
            let lines = lines.to_vec();
            lines.into_iter().enumerate().for_each(|(k, value)| signal[k * q + o] = value);
        }
    }

    /// Logarithm of the frequency and square of every line of output `o` of a signal; all but the mean.
    pub(super) fn squares(&mut self, o: usize, signal: &[f64]) -> Vec<(f64, f64)> {
        let q = self.outputs;
        let lines = self.lines(o, |k| signal[k * q + o]).to_vec();
        let all = self.views[o].log_frequency.iter().copied().zip(lines.into_iter().map(|line| line * line));
        all.filter(|(log_frequency, _)| log_frequency.is_finite()).collect()
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
                let column = self.lens.lines(o, |k| jacobian[(k * q + o) * stride + c]);
                column.iter().enumerate().for_each(|(k, value)| jacobian[(k * q + o) * stride + c] = *value);
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
