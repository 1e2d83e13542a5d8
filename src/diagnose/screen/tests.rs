//! What the screening says of noise alone, and of effects that are there; directions come from models whose parameters
//! at zero are the effects.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use super::calibration::Normal;
use super::*;
use crate::model::Model;
use crate::record::Run;
use crate::simulate::Simulator;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

/// An aeroplane's short period; the parameters c.. at zero are effects.
const SHORT_PERIOD: &str = "model short_period {
  input de;
  state al, q, s;
  param Za = -1.2, Zd = -0.15, Ma = -6, Mq = -1.8, Md = -9, ba = 0, bq = 0, bz = 0;
  param c1 = 0, c2 = 0, c3 = 0, c4 = 0, c5 = 0, c6 = 0, c7 = 0, c8 = 0, c9 = 0, c10 = 0, c11 = 0, c12 = 0, c13 = 0;
  param tau = 0 in [0, 1], lag = 0.05 in [0.01, 3], k = 0;
  let d = delay(de, tau);
  der(al) = q + Za*al + Zd*d + c1*al^3 + c2*al*abs(al) + c3;
  der(q) = Ma*al + Mq*q + Md*d + c4*q*abs(q) + c5*al^3 + c6*al*q + c7*tanh(q/0.02) + c8*d^3 + c9*d*abs(d) + k*s;
  der(s) = (al - s)/lag;
  output alm = (1 + c10)*al + ba + c12*(t/20 - 0.5);
  output qm = (1 + c11)*q + bq + c13*(t/20 - 0.5);
  output az = 6*(Za*al + Zd*d) + bz;
}";

/// A ship's steering and surge: slow beside its record.
const SHIP: &str = "model ship {
  input rud;
  state v, r, psi;
  param Yv = -0.04, Yr = -0.06, Yd = 0.012, Nv = -0.006, Nr = -0.06, Nd = -0.011, bv = 0, br = 0, bp = 0;
  param c1 = 0, c2 = 0, c3 = 0, c4 = 0, c5 = 0, c6 = 0, c7 = 0, c8 = 0, c9 = 0, c10 = 0, c11 = 0, c12 = 0, c13 = 0;
  param tau = 0 in [0, 20];
  let d = delay(rud, tau);
  der(v) = Yv*v + Yr*r + Yd*d + c1*v*abs(v) + c2*v^3 + c3;
  der(r) = Nv*v + Nr*r + Nd*d + c4*r*abs(r) + c5*r^3 + c6*v*r + c7 + c8*d^3 + c9*d*abs(d);
  der(psi) = r;
  output vm = (1 + c10)*v + bv + c12*(t/300 - 0.5);
  output rm = (1 + c11)*r + br + c13*(t/300 - 0.5);
  output pm = psi + bp;
}";

/// Runs of a family, its directions, and where noise is added.
struct Family {
    records: Vec<Record>,
    directions: Vec<Direction>,
    channels: usize,
    /// Root mean square of each output's response.
    size: Vec<f64>,
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

impl Family {
    fn new(text: &str, effects: usize, finite: &[(&str, &[f64])], interval: f64, scale: f64) -> Self {
        let model = Model::from_text("family.fdm", text).unwrap();
        let samples = 400;
        let q = model.layout().outputs;
        let first = model.definition().param("c1").unwrap();
        let theta = model.definition().start();
        let columns: Vec<usize> = (0..first + effects).collect();
        let mut family = Self { records: Vec::new(), directions: Vec::new(), channels: q, size: vec![0.0; q] };
        for k in 0..effects {
            family.directions.push(Direction { candidate: k, size: 1.0, shape: Shape::Linear });
        }
        for (k, (_, sizes)) in finite.iter().enumerate() {
            for (i, size) in sizes.iter().enumerate() {
                let shape = if i == 0 { Shape::Smallest } else { Shape::Finite };
                family.directions.push(Direction { candidate: effects + k, size: *size, shape });
            }
        }
        for run in 0..2 {
            let time: Vec<f64> = (0..samples).map(|k| k as f64 * interval).collect();
            let record = Run {
                name: format!("run {run}"),
                time,
                inputs: input(samples, interval, 3 * run, scale),
                held: vec![false],
                measured: vec![0.0; samples * q],
                input_gaps: vec![0],
                output_gaps: vec![0; q],
            };
            let mut simulator = Simulator::new(model.dynamics(), &record, 4).unwrap();
            let stride = columns.len().next_multiple_of(8);
            let (mut y, mut jacobian) = (vec![0.0; samples * q], vec![0.0; samples * q * stride]);
            simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).unwrap();
            let column = |c: usize| -> Vec<f64> { jacobian.chunks_exact(stride).map(|row| row[c]).collect() };
            let mut directions: Vec<Signals> = (first..first + effects).map(column).collect();
            for (name, sizes) in finite {
                let p = model.definition().param(name).unwrap();
                for size in *sizes {
                    let mut moved = theta.clone();
                    moved[p] = *size;
                    if *name == "lag" {
                        moved[p + 1] = 1.0;
                    }
                    let mut with = vec![0.0; samples * q];
                    simulator.simulate(&moved, &mut with).unwrap();
                    directions.push(with.iter().zip(&y).map(|(a, b)| a - b).collect());
                }
            }
            for (k, value) in y.iter().enumerate() {
                family.size[k % q] += value * value / (2 * samples) as f64;
            }
            let fitted = (0..first).map(|c| Some(column(c))).collect();
            family.records.push(Record { interval, residual: y, fitted, directions });
        }
        family.size.iter_mut().for_each(|s| *s = s.sqrt());
        family
    }

    /// The runs with noise in the place of residuals.
    fn noisy(&self, colour: Colour, share: f64, normal: &mut Normal) -> Vec<Record> {
        let mut records = self.records.clone();
        for record in &mut records {
            let n = record.residual.len() / self.channels;
            for c in 0..self.channels {
                for (k, e) in colour.noise(n, normal).into_iter().enumerate() {
                    record.residual[k * self.channels + c] = share * self.size[c] * e;
                }
            }
        }
        records
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Colour {
    White,
    /// 70 % of the power in 1/f, the rest white.
    Pink,
    /// A resonance.
    Resonant,
}

impl Colour {
    fn noise(self, n: usize, normal: &mut Normal) -> Vec<f64> {
        let white: Vec<f64> = (0..n).map(|_| normal.next()).collect();
        match self {
            Self::White => white,
            Self::Pink => {
                let pink = pink(n, normal);
                white.iter().zip(pink).map(|(w, p)| 0.3_f64.sqrt() * w + 0.7_f64.sqrt() * p).collect()
            }
            Self::Resonant => {
                let (mut a, mut b) = (0.0, 0.0);
                let mut next = || {
                    let e = 1.6 * a - 0.85 * b + normal.next();
                    (b, a) = (a, e);
                    e / 4.2
                };
                (0..50).for_each(|_| drop(next()));
                (0..n).map(|_| next()).collect()
            }
        }
    }
}

/// 1/f noise of unit variance, cut out of a longer record.
fn pink(n: usize, normal: &mut Normal) -> Vec<f64> {
    let long = 4 * n;
    let mut lines: Vec<Complex<f64>> = (0..long)
        .map(|k| {
            let f = k.min(long - k).max(1) as f64;
            Complex::new(normal.next(), normal.next()) / f.sqrt()
        })
        .collect();
    lines[0] = Complex::default();
    FftPlanner::new().plan_fft_forward(long).process(&mut lines);
    let part: Vec<f64> = lines[n..2 * n].iter().map(|c| c.re).collect();
    let size = (lines.iter().map(|c| c.re * c.re).sum::<f64>() / long as f64).sqrt();
    part.into_iter().map(|v| v / size).collect()
}

fn families() -> [(&'static str, Family); 2] {
    let sizes: &[f64] = &[0.025, 0.075, 0.2, 0.5];
    let slow: &[f64] = &[0.5, 1.5, 4.0, 10.0];
    [
        ("short period", Family::new(SHORT_PERIOD, 13, &[("tau", sizes), ("lag", &[0.05, 0.2, 0.6, 2.0])], 0.05, 1.0)),
        ("ship", Family::new(SHIP, 13, &[("tau", slow)], 0.75, 20.0)),
    ]
}

#[test]
#[ignore = "a study: some minutes in release"]
fn false_alarms() {
    let repeats = std::env::var("FDM_REPEATS").ok().and_then(|r| r.parse().ok()).unwrap_or(200);
    println!("| family | noise | runs | at 5 % | at 1 % |");
    for (name, family) in families() {
        for colour in [Colour::White, Colour::Pink, Colour::Resonant] {
            let mut normal = Normal::new(77);
            let (mut five, mut one) = (0, 0);
            for _ in 0..repeats {
                let records = family.noisy(colour, 0.05, &mut normal);
                let options = ScreeningOptions { draws: 200, ..ScreeningOptions::default() };
                let found = screen(&records, family.channels, &family.directions, &options).unwrap();
                five += usize::from(found.family_wise < 0.05);
                one += usize::from(found.family_wise < 0.01);
            }
            let share = |n: usize| n as f64 / repeats as f64;
            println!("| {name} | {colour:?} | {repeats} | {:.3} | {:.3} |", share(five), share(one));
        }
    }
}
