//! W6: a chain of masses with springs that stiffen, three parameters a mass: what grows faster than the model does. Twenty masses
//! (40 states, 61 parameters) give one residual and Jacobian, fifty (100 states, 151 parameters) a fit.
//!
//! There is no hand-written limit; the derivatives are compared with central differences of the response.

use crate::clock::{Row, cpu_seconds, median_of_runs};
use fdm::Model;
use fdm::estimate::{FitOptions, Options, Work, fit};
use fdm::record::Run;
use fdm::simulate::{Block, Simulator};
use std::fmt::Write;

const SAMPLES: usize = 2000;
/// Runge-Kutta steps between samples.
const STEPS: usize = 8;
/// Noise as a part of the size of an output.
const NOISE: f64 = 0.01;

/// Uniform numbers between -1 and 1 (xorshift).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        2.0 * (self.0 >> 11) as f64 / (1_u64 << 53) as f64 - 1.0
    }
}

struct Chain {
    model: Model,
    run: Run,
    /// What the record was made with, in the model's order.
    truth: Vec<f64>,
    numbers: Numbers,
}

impl Chain {
    fn new(masses: usize) -> Self {
        let mut numbers = Numbers(88_172_645_463_325_252);
        let mut text = String::from("model chain { input u; param b = 3;\n");
        let mut add = |part: String| text.write_str(&part).expect("a string takes all");
        for i in 0..masses {
            let [k, c, q] = [50.0 + 10.0 * numbers.next(), 0.8 + 0.2 * numbers.next(), 80.0 + 20.0 * numbers.next()];
            add(format!("state x{i} = 0, v{i} = 0; param k{i} = {k}, c{i} = {c}, q{i} = {q};\n"));
        }
        for i in 0..masses {
            let before = i.checked_sub(1);
            let [d, e] = ["x", "v"].map(|s| before.map_or(format!("{s}{i}"), |j| format!("({s}{i} - {s}{j})")));
            add(format!("let f{i} = k{i}*{d} + c{i}*{e} + q{i}*{d}^3;\n"));
        }
        for i in 0..masses {
            let drive = if i == 0 { " + b*u" } else { "" };
            let next = if i + 1 < masses { format!(" + f{}", i + 1) } else { String::new() };
            add(format!("der(x{i}) = v{i}; der(v{i}) = -f{i}{next}{drive}; output y{i} = x{i};\n"));
        }
        text.push('}');
        let model = Model::from_text("chain.fdm", &text).expect("the model compiles");
        let mut level = 0.0;
        let mut drive = |k: usize| {
            if k.is_multiple_of(12) {
                level = 4.0 * numbers.next();
            }
            level
        };
        let run = Run {
            name: "chain".into(),
            time: (0..SAMPLES).map(|k| 0.1 * k as f64).collect(),
            inputs: (0..SAMPLES).map(&mut drive).collect(),
            held: vec![false],
            measured: vec![f64::NAN; SAMPLES * masses],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0; masses],
        };
        let truth = model.definition().start();
        Self { model, run, truth, numbers }
    }

    fn simulator(&self) -> Simulator<'_> {
        Simulator::new(self.model.dynamics(), &self.run, STEPS).expect("nothing is held and delayed")
    }

    fn response(&self, theta: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; self.run.measured.len()];
        self.simulator().simulate(theta, &mut y).expect("the chain stays finite");
        y
    }

    /// Largest difference of some columns from central differences, relative to the column.
    fn difference(&self) -> f64 {
        let columns: Vec<usize> = (0..self.truth.len()).collect();
        let stride = columns.len().next_multiple_of(8);
        let mut y = vec![0.0; self.run.measured.len()];
        let mut jacobian = vec![0.0; y.len() * stride];
        self.simulator().sensitivities(&self.truth, &columns, &mut y, &mut jacobian).expect("the chain stays finite");
        let off = |column: usize| {
            let step = 1e-5 * self.truth[column];
            let moved = |sign: f64| {
                let mut theta = self.truth.clone();
                theta[column] += sign * step;
                self.response(&theta)
            };
            let numeric: Vec<f64> = moved(1.0).iter().zip(moved(-1.0)).map(|(a, b)| (a - b) / (2.0 * step)).collect();
            let exact = jacobian.iter().skip(column).step_by(stride);
            let size = numeric.iter().fold(0.0_f64, |size, d| size.max(d.abs()));
            numeric.iter().zip(exact).fold(0.0_f64, |worst, (a, b)| worst.max((a - b).abs())) / size
        };
        [0, 1, columns.len() / 2, columns.len() - 1].map(off).into_iter().fold(0.0, f64::max)
    }

    /// The record with noise.
    fn measure(&mut self) {
        let (mut y, q) = (self.response(&self.truth), self.run.output_gaps.len());
        let size = |o: usize| (y.iter().skip(o).step_by(q).map(|y| y * y).sum::<f64>() / SAMPLES as f64).sqrt();
        let sizes: Vec<f64> = (0..q).map(size).collect();
        for (k, y) in y.iter_mut().enumerate() {
            // the sum of twelve has a variance of four
            let normal: f64 = 0.5 * (0..12).map(|_| self.numbers.next()).sum::<f64>();
            *y += NOISE * sizes[k % q] * normal;
        }
        self.run.measured = y;
    }
}

/// A of twenty masses, B of fifty from starts up to 15 % off.
pub(crate) fn run(limit: &[Row]) {
    let row = |what: &str, seconds: f64, difference: f64| {
        let (workload, tool, what) = ("w6".into(), "fdm (.fdm, machine code)".into(), what.into());
        Row { workload, tool, what, seconds, difference: Some(difference) }
    };
    let chain = Chain::new(20);
    let (columns, difference): (Vec<usize>, f64) = ((0..chain.truth.len()).collect(), chain.difference());
    let mut simulator = chain.simulator();
    let seconds = median_of_runs(|| {
        let mut sink = |block: Block<'_>| _ = std::hint::black_box(block.rows);
        let theta = std::hint::black_box(&chain.truth);
        simulator.stream(theta, &columns, &mut sink).expect("the chain stays finite");
    });
    row("A residual+jacobian (20)", seconds, difference).print(limit);

    let mut chain = Chain::new(50);
    chain.measure();
    let names = chain.model.definition().params.iter().map(|p| p.quantity.name.clone());
    let starts: Vec<f64> = chain.truth.iter().map(|value| value * (1.0 + 0.15 * chain.numbers.next())).collect();
    for bare in [true, false] {
        let options = FitOptions {
            changes: fdm::Changes { set: names.clone().zip(starts.iter().copied()).collect(), ..Default::default() },
            options: Options { colour: !bare, ..Options::default() },
            per_interval: Some(STEPS),
            bare,
            ..FitOptions::default()
        };
        let before = cpu_seconds();
        let found = fit(&chain.model, std::slice::from_ref(&chain.run), &options, &Work::default());
        let seconds = cpu_seconds() - before;
        let estimate = found.expect("the chain can be estimated").estimate;
        let what =
            format!("B fit (50{}), {} evaluations", if bare { "" } else { ", all judged" }, estimate.evaluations.0);
        row(&what, seconds, estimate.cost.unwrap_or(f64::NAN)).print(limit);
    }
}
