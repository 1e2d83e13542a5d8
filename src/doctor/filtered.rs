//! A model's response behind first-order lags at its outputs: what a filter in a sensor makes of a motion. The noise of the record stays as
//! it is, as nothing that was measured is averaged.

use crate::hypothesis::lag_weights;
use fdm_estimate::{Response, TimeResponse};
use fdm_numeric::lanes::Aligned;
use fdm_system::simulate::{Block, Divergence, Simulator, Sink};

/// A simulated run whose outputs pass lags. Each lag begins as if its input had changed by the first interval's slope for ever.
pub(crate) struct Filtered<'a> {
    simulator: Simulator<'a>,
    /// Output and time constant of each lag, in their order.
    lags: Vec<(usize, f64)>,
    /// Weights of each lag over the interval before each sample; those of the first sample are not read.
    weights: Vec<Vec<Weights>>,
    /// What the lags remember, for the output and each column.
    memory: Vec<Memory>,
    y: Vec<f64>,
    rows: Aligned,
}

/// The answer of a lag over one interval: `own` of its own value, `first` and `second` of its input's values.
#[derive(Debug, Clone, Copy, Default)]
struct Weights {
    own: f64,
    first: f64,
    second: f64,
    /// Time constant over the interval.
    ratio: f64,
}

/// A lag's own value and its input's, at the sample before.
#[derive(Debug, Clone, Copy, Default)]
struct Memory {
    own: f64,
    input: f64,
}

impl Memory {
    /// Before the first sample, of which the next one is known too.
    fn begin(input: f64, next: f64, ratio: f64) -> Self {
        Self { own: input - ratio * (next - input), input }
    }

    fn step(&mut self, input: f64, weights: Weights) -> f64 {
        self.own = weights.own * self.own + weights.first * self.input + weights.second * input;
        self.input = input;
        self.own
    }
}

/// Weights of a lag over the interval before each of these times.
fn weights(time: &[f64], lag: f64) -> Vec<Weights> {
    let one = |k: usize| {
        let interval = time[k] - time[k - 1];
        let (own, c) = lag_weights(lag, interval);
        Weights { own, first: c - own, second: 1.0 - c, ratio: lag / interval }
    };
    (0..time.len()).map(|k| if k == 0 { Weights::default() } else { one(k) }).collect()
}

/// Sends one of `width` interleaved columns through a lag, in its place.
pub(crate) fn pass(time: &[f64], values: &mut [f64], (place, width): (usize, usize), lag: f64) {
    pass_weighted(&weights(time, lag), values, (place, width));
}

fn pass_weighted(weights: &[Weights], values: &mut [f64], (place, width): (usize, usize)) {
    if weights.len() < 2 {
        return;
    }
    let mut memory = Memory::begin(values[place], values[width + place], weights[1].ratio);
    values[place] = memory.own;
    for (k, weights) in weights.iter().enumerate().skip(1) {
        let value = &mut values[k * width + place];
        *value = memory.step(*value, *weights);
    }
}

impl<'a> Filtered<'a> {
    /// The outputs of a simulator behind lags: output and time constant of each.
    pub(crate) fn new(simulator: Simulator<'a>, lags: &[(usize, f64)]) -> Self {
        let weights = lags.iter().map(|(_, lag)| weights(&simulator.run().time, *lag)).collect();
        let (memory, y, rows) = (Vec::new(), Vec::new(), Aligned::new(0));
        Self { simulator, lags: lags.to_vec(), weights, memory, y, rows }
    }
}

impl Response for Filtered<'_> {
    fn samples(&self) -> usize {
        self.simulator.samples()
    }

    fn outputs(&self) -> usize {
        self.simulator.outputs()
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        self.simulator.simulate(theta, y)?;
        let q = self.simulator.outputs();
        for ((output, _), weights) in self.lags.iter().zip(&self.weights) {
            pass_weighted(weights, y, (*output, q));
        }
        Ok(())
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        let Self { simulator, lags, weights, memory, y, rows } = self;
        // a place for the output and one for each column, lag by lag
        let places = columns.len() + 1;
        memory.clear();
        memory.resize(lags.len() * places, Memory::default());
        simulator.stream(theta, columns, &mut |block| {
            y.clear();
            y.extend_from_slice(block.y);
            if rows.len() < block.rows.len() {
                *rows = Aligned::new(block.rows.len());
            }
            let rows = &mut rows[..block.rows.len()];
            rows.copy_from_slice(block.rows);
            let (count, q, length) = (block.samples(), block.layout.outputs.len(), block.layout.length);
            for (((output, _), weights), memory) in lags.iter().zip(weights.iter()).zip(memory.chunks_mut(places)) {
                let weights = &weights[block.first..][..count];
                let column = |values: &mut [f64], stride: usize, place: usize, memory: &mut Memory| {
                    let mut begin = 0;
                    if block.first == 0 {
                        let next = values.get(stride + place).copied().unwrap_or(values[place]);
                        let ratio = weights.get(1).map_or(0.0, |w| w.ratio);
                        *memory = Memory::begin(values[place], next, ratio);
                        values[place] = memory.own;
                        begin = 1;
                    }
                    for (k, weights) in weights.iter().enumerate().skip(begin) {
                        let value = &mut values[k * stride + place];
                        *value = memory.step(*value, *weights);
                    }
                };
                column(&mut y[..], q, *output, &mut memory[0]);
                let lanes = &block.layout.outputs[*output];
                for (lane, memory) in (0..lanes.columns.len()).zip(&mut memory[1..]) {
                    column(&mut rows[..], length, lanes.start + lane, memory);
                }
            }
            sink(Block { first: block.first, y: &y[..], rows, layout: block.layout });
        })
    }
}

impl TimeResponse for Filtered<'_> {
    fn time(&self) -> Option<&[f64]> {
        Some(&self.simulator.run().time)
    }
}
