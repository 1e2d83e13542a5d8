//! Models in closed form for tests, and reproducible noise.

use crate::problem::response::{Response, RunResponse, TimeResponse};
use crate::problem::unknowns::DerivedQuantities;
use crate::problem::{Problem, ProblemRun};
use fdm_grammar::model::{Origin, Param, Quantity};
pub(super) use fdm_numeric::random::Normal;
use fdm_system::simulate::{Block, Divergence, RowLayout, Sink};

/// A free, unbounded, shared parameter.
pub(super) fn param(name: &str, value: f64) -> Param {
    let quantity = Quantity { name: name.into(), doc: String::new(), unit: None };
    let (lower, upper) = (f64::NEG_INFINITY, f64::INFINITY);
    Param {
        quantity,
        origin: Origin::Declared,
        value,
        lower,
        upper,
        fixed: false,
        per_run: false,
        group: None,
        logarithmic: false,
        prior: None,
    }
}

/// Outputs (q) and their partials (q by p) at a sample.
pub(super) type Sample = fn(x: f64, theta: &[f64], y: &mut [f64], partials: &mut [f64]);

/// A response in closed form; it diverges when an output is not finite.
pub(super) struct Closed {
    pub(super) x: Vec<f64>,
    pub(super) q: usize,
    pub(super) sample: Sample,
}

impl Response for Closed {
    fn samples(&self) -> usize {
        self.x.len()
    }

    fn outputs(&self) -> usize {
        self.q
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        let mut partials = vec![0.0; self.q * theta.len()];
        for (k, x) in self.x.iter().enumerate() {
            let y = &mut y[k * self.q..(k + 1) * self.q];
            (self.sample)(*x, theta, y, &mut partials);
            if y.iter().any(|v| v.is_infinite()) {
                return Err(Divergence { time: *x, state: Some(0), sample: k, event: None });
            }
        }
        Ok(())
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        let p = theta.len();
        let layout = RowLayout::full(self.q, columns.len());
        let (mut partials, mut y, mut rows) = (vec![0.0; self.q * p], vec![0.0; self.q], vec![0.0; layout.length]);
        let mut plain = vec![0.0; self.x.len() * self.q];
        self.simulate(theta, &mut plain)?;
        for (first, x) in self.x.iter().enumerate() {
            (self.sample)(*x, theta, &mut y, &mut partials);
            for (o, output) in layout.outputs.iter().enumerate() {
                for (c, column) in columns.iter().enumerate() {
                    rows[output.start + c] = partials[o * p + column];
                }
            }
            sink(Block { first, y: &y, rows: &mut rows, layout: &layout });
        }
        Ok(())
    }
}

impl TimeResponse for Closed {
    fn time(&self) -> Option<&[f64]> {
        Some(&self.x)
    }
}

/// A run whose measurement is the model at `truth` plus noise (by sample and output).
pub(super) fn run(
    name: &str,
    x: Vec<f64>,
    q: usize,
    sample: Sample,
    truth: &[f64],
    mut noise: impl FnMut(usize, usize) -> f64,
) -> ProblemRun<'static> {
    let mut response = Closed { x, q, sample };
    let mut measured = vec![0.0; response.samples() * q];
    let _ = response.simulate(truth, &mut measured);
    measured.iter_mut().enumerate().for_each(|(k, z)| *z += noise(k / q, k % q));
    ProblemRun { name: name.into(), response: RunResponse::in_time(response), measured, start: Vec::new() }
}

/// A problem with outputs `y0`, `y1`, ...
pub(super) fn problem(params: Vec<Param>, runs: Vec<ProblemRun<'static>>) -> Problem<'static> {
    let q = runs.first().map_or(1, |r| r.response.outputs());
    let outputs = (0..q).map(|o| format!("y{o}")).collect();
    Problem::of(params, outputs, runs, DerivedQuantities::none())
}

/// `count` abscissae from 0 to `end`.
pub(super) fn grid(count: usize, end: f64) -> Vec<f64> {
    (0..count).map(|k| end * k as f64 / (count - 1) as f64).collect()
}
