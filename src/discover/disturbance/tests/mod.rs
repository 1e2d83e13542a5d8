//! Gusts, coloured sensors and hidden effects, in an aeroplane's short period and in a ship: where they are found.
#![allow(clippy::unwrap_used)]

use super::place::{DisturbanceError, places};
use super::*;
use crate::bins::Record;
use fdm_estimate::{FitOptions, Work, fit};
use fdm_numeric::random::Stream;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, Steps};

mod found;
mod studies;
mod unknown;

/// An aeroplane's short period.
const SHORT_PERIOD: &str = "model short_period {
  input de;
  state al, q;
  param Za = -1.2, Zd = -0.15, Ma = -6, Mq = -1.8, Md = -9, ba = 0, bq = 0, bz = 0;
  der(al) = q + Za*al + Zd*de;
  der(q) = Ma*al + Mq*q + Md*de;
  output alm = al + ba;
  output qm = q + bq;
  output az = 6*(Za*al + Zd*de) + bz;
}";

/// A ship's steering.
const SHIP: &str = "model ship {
  input rud;
  state v, r, psi;
  param Yv = -0.04, Yr = -0.06, Yd = 0.012, Nv = -0.006, Nr = -0.06, Nd = -0.011, bv = 0, br = 0, bp = 0;
  der(v) = Yv*v + Yr*r + Yd*rud;
  der(r) = Nv*v + Nr*r + Nd*rud;
  der(psi) = r;
  output vm = v + bv;
  output rm = r + br;
  output pm = psi + bp;
}";

/// As cogging over an angle.
const RIPPLE: &str = "0.05*sin(150*al)";

struct Family {
    name: &'static str,
    text: &'static str,
    states: &'static [&'static str],
    interval: f64,
    scale: f64,
    /// Quadratic damping that matters: equation, term.
    effect: (&'static str, &'static str),
    /// Something that no catalogue has.
    strange: (&'static str, &'static str),
    /// Coefficients of a lightly damped mode between the input and the last but one output: rate of change, damping, strength.
    mode: (f64, f64, f64),
}

const FAMILIES: [Family; 2] = [
    Family {
        name: "short period",
        text: SHORT_PERIOD,
        states: &["al", "q"],
        interval: 0.05,
        scale: 1.0,
        effect: ("q", "-12*q*abs(q)"),
        strange: ("q", "-1.2*sin(25*al)*abs(q)"),
        mode: (12.0, 0.03, 0.3),
    },
    Family {
        name: "ship",
        text: SHIP,
        states: &["v", "r"],
        interval: 0.75,
        scale: 20.0,
        effect: ("r", "-8*r*abs(r)"),
        strange: ("r", "-0.05*r*abs(sin(200*v))"),
        mode: (0.8, 0.03, 0.01),
    },
];

struct Normal(Stream);

impl Normal {
    fn next(&mut self) -> f64 {
        let (a, b) = (self.0.uniform(), self.0.uniform());
        (-2.0 * (1.0 - a).ln()).sqrt() * fdm_grammar::math::cos(std::f64::consts::TAU * b)
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Hidden {
    Nothing,
    /// First-order coloured disturbance in the equation of a state, by index among the family's.
    Gust(usize),
    /// A slow wandering of one output besides.
    Wander(usize),
    Effect,
    Strange,
    /// A moment that swings several times over the angle of attack.
    Ripple,
    /// A narrow mode in the sensor of the second output.
    Mode,
}

/// Most of the power in first-order noise of a corner far below the band, the rest white.
fn coloured(n: usize, normal: &mut Normal, pole: f64) -> Vec<f64> {
    let mut value = 0.0;
    (0..n + 500)
        .map(|_| {
            value = pole * value + (1.0 - pole * pole).sqrt() * normal.next();
            value
        })
        .skip(500)
        .collect()
}

/// 1/f noise as a sum of first-order ones, with a white part.
fn pink(n: usize, normal: &mut Normal) -> Vec<f64> {
    let mut sum: Vec<f64> = (0..n).map(|_| 0.3_f64.sqrt() * normal.next()).collect();
    for pole in [0.5, 0.8, 0.92, 0.97, 0.99, 0.997] {
        for (s, c) in sum.iter_mut().zip(coloured(n, normal, pole)) {
            *s += (0.7_f64 / 6.0).sqrt() * c;
        }
    }
    sum
}

/// A fitted model with all that is asked for.
struct Case {
    model: Model,
    runs: Vec<Run>,
    steps: Vec<Steps>,
    theta: Vec<f64>,
    records: Vec<Record>,
}

impl Case {
    fn new(family: &Family, hidden: Hidden, pinkish: bool, noise: f64, strength: f64, n: usize, seed: u64) -> Self {
        let mut normal = Normal(Stream::seeded(seed));
        let model = Model::from_text("nominal.fdm", family.text).unwrap();
        let mut text = family.text.replace("input ", "input gust, ");
        let place = match hidden {
            Hidden::Gust(k) => Some((family.states[k], "gust")),
            Hidden::Effect => Some(family.effect),
            Hidden::Strange => Some(family.strange),
            Hidden::Ripple => Some(("q", RIPPLE)),
            _ => None,
        };
        if let Some((state, term)) = place {
            text = text.replace(&format!("der({state}) = "), &format!("der({state}) = {term} + "));
        }
        if hidden == Hidden::Mode {
            let (omega, zeta, size) = family.mode;
            let name = family.text.split("input ").nth(1).unwrap().split(';').next().unwrap();
            text = text.replace("state ", "state mode, mode_rate, ");
            let equations = format!(
                "der(mode) = mode_rate; der(mode_rate) = {omega}^2*({name} - mode) - 2*{zeta}*{omega}*mode_rate; output "
            );
            text = text.replacen("output ", &equations, 1);
            let second = ["qm = q", "rm = r"].iter().find(|o| text.contains(**o)).unwrap();
            text = text.replace(*second, &format!("{second} + {size}*mode_rate/{omega}"));
        }
        let truth = Model::from_text("truth.fdm", text).unwrap();
        let q = model.layout().outputs;
        let mut runs = Vec::new();
        let mut clean = Vec::new();
        for run in 0..2 {
            let u = input(n, family.interval, 3 * run, family.scale);
            let gust = coloured(n, &mut normal, 0.8);
            let respond = |gust: &dyn Fn(usize) -> f64| {
                let inputs = (0..n).flat_map(|k| [gust(k), u[k]]).collect();
                let forced_response = record(run, n, family.interval, inputs, 2, q);
                let mut simulator = Simulator::new(truth.dynamics(), &forced_response, 4).unwrap();
                let mut y = vec![0.0; n * q];
                simulator.simulate(&truth.definition().start(), &mut y).unwrap();
                y
            };
            let still = respond(&|_| 0.0);
            let mut y = still.clone();
            let rms = |v: &[f64], c: usize| (v.iter().skip(c).step_by(q).map(|a| a * a).sum::<f64>() / n as f64).sqrt();
            if let Hidden::Gust(_) = hidden {
                // a share of the worst output's response
                let moved = respond(&|k| gust[k]);
                let difference: Vec<f64> = moved.iter().zip(&still).map(|(a, b)| a - b).collect();
                let worst = (0..q).map(|c| rms(&difference, c) / rms(&still, c)).fold(0.0, f64::max);
                y.iter_mut().zip(difference).for_each(|(y, d)| *y += strength / worst * d);
            }
            for c in 0..q {
                let size = rms(&still, c);
                let e: Vec<f64> = if pinkish { pink(n, &mut normal) } else { (0..n).map(|_| normal.next()).collect() };
                let drift = coloured(n, &mut normal, 0.97);
                for k in 0..n {
                    y[k * q + c] += noise * size * e[k];
                    if hidden == Hidden::Wander(c) {
                        y[k * q + c] += strength * size * drift[k];
                    }
                }
            }
            runs.push(record(run, n, family.interval, u, 1, q));
            clean.push(y);
        }
        runs.iter_mut().zip(clean).for_each(|(run, y)| run.measured = y);
        Self::fitted(&model, runs)
    }

    fn fitted(model: &Model, runs: Vec<Run>) -> Self {
        let options = FitOptions { bare: true, per_interval: Some(1), ..FitOptions::default() };
        let fitted = fit(model, &runs, &options, &Work::default()).unwrap();
        let theta: Vec<f64> = model
            .definition()
            .params
            .iter()
            .map(|p| fitted.estimate.parameter(&p.quantity.name, None).unwrap().value)
            .collect();
        let steps: Vec<Steps> = fitted.integration.iter().map(|a| a.steps.clone()).collect();
        let (p, q) = (theta.len(), model.layout().outputs);
        let columns: Vec<usize> = (0..p).collect();
        let stride = p.next_multiple_of(8);
        let records = runs
            .iter()
            .zip(&steps)
            .map(|(run, steps)| {
                let n = run.len();
                let mut simulator = Simulator::new(model.dynamics(), run, steps.clone()).unwrap();
                let (mut y, mut jacobian) = (vec![0.0; n * q], vec![0.0; n * q * stride]);
                simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).unwrap();
                let column = |c: usize| Some(jacobian.chunks_exact(stride).map(|row| row[c]).collect());
                Record {
                    interval: run.time[1] - run.time[0],
                    residual: run.measured.iter().zip(&y).map(|(z, y)| z - y).collect(),
                    fitted: columns.iter().map(|c| column(*c)).collect(),
                    directions: Vec::new(),
                    rows: None,
                    deviations: None,
                }
            })
            .collect();
        Self { model: model.clone(), runs, steps, theta, records }
    }

    /// These runs with another model.
    fn refitted(&self, text: String) -> Self {
        let model = Model::from_text("extended.fdm", text).unwrap();
        Self::fitted(&model, self.runs.clone())
    }

    fn fitted_runs(&self) -> Vec<FittedRun<'_>> {
        let all = self.runs.iter().zip(&self.steps).zip(&self.records);
        all.map(|((run, steps), record)| FittedRun { run, steps, theta: &self.theta, record }).collect()
    }
}

fn record(run: usize, n: usize, interval: f64, inputs: Vec<f64>, m: usize, q: usize) -> Run {
    Run {
        name: format!("run {run}"),
        time: (0..n).map(|k| k as f64 * interval).collect(),
        inputs,
        held: vec![false; m],
        measured: vec![0.0; n * q],
        input_gaps: vec![0; m],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    }
}

fn input(samples: usize, interval: f64, run: usize, scale: f64) -> Vec<f64> {
    let steps = [3.0, 2.0, 1.0, 1.0, 0.5, 2.5, 1.5];
    let mut u = Vec::new();
    let (mut k, mut sign) = (run, 1.0);
    while u.len() < samples {
        let width = (steps[k % steps.len()] * scale / interval) as usize;
        u.extend(std::iter::repeat_n(0.05 * sign, width));
        (k, sign) = (k + 1, -sign);
    }
    u.truncate(samples);
    u
}

/// Short records: these tests run without optimisation.
const SHORT: usize = 160;
