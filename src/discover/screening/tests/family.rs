//! Families of systems whose models hold effects as parameters at zero: runs, fitted sensitivities, directions.

use super::colour::Colour;
use crate::screening::*;
use fdm_numeric::fourier::CosineTransform;
use fdm_numeric::random::Stream;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::Simulator;
use nalgebra::{DMatrix, SymmetricEigen};

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

/// A helicopter in hover with its attitude held: 8 states, 4 inputs, 8 outputs.
const HOVER: &str = "model hover {
  input lat, lon, ped, col;
  state u, v, w, p, q, r, ph, th;
  param Xu = -0.05, Xq = 0.6, Yv = -0.1, Yp = -0.6, Zw = -0.4, Zc = -9, Zq = 0.3, Lv = -0.06, Lp = -4, Lq = 1.2, La = 12, Lc = 1.5;
  param Mu = 0.03, Mp = -0.8, Mq = -2.2, Mo = 6, Mw = 0.02, Nv = 0.05, Nr = -0.9, Np = -0.2, Nd = 5, Nc = -1.5;
  param bu = 0, bv = 0, bw = 0, bp = 0, bq = 0, br = 0, bph = 0, bth = 0;
  param c1 = 0, c2 = 0, c3 = 0, c4 = 0, c5 = 0, c6 = 0, c7 = 0, c8 = 0, c9 = 0, c10 = 0, c11 = 0, c12 = 0, c13 = 0, c14 = 0;
  param c15 = 0, c16 = 0, c17 = 0, c18 = 0, c19 = 0, c20 = 0, c21 = 0, c22 = 0, c23 = 0, c24 = 0, c25 = 0, c26 = 0, c27 = 0, c28 = 0;
  param tau = 0 in [0, 1], tal = 0 in [0, 1];
  let o = delay(lon, tau) - 0.5*th;
  let a = delay(lat, tal) - 0.5*ph;
  der(u) = Xu*u + Xq*q - 9.81*th + c1*v + c2*u*abs(u);
  der(v) = Yv*v + Yp*p + 9.81*ph + c3*u + c4*v*abs(v) + c5*ped;
  der(w) = Zw*w + Zc*col + Zq*q + c6*w*abs(w) + c7*u + c8*col*abs(col) + c9;
  der(p) = Lv*v + Lp*p + Lq*q + La*a + Lc*col + c10*p*abs(p) + c11*ped + c12*q*r + c13*w + c14*a^3 + c15;
  der(q) = Mu*u + Mp*p + Mq*q + Mo*o + Mw*w + c16*q*abs(q) + c17*col + c18*p*r + c19*o^3 + c20*v;
  der(r) = Nv*v + Nr*r + Np*p + Nd*ped + Nc*col + c21*r*abs(r) + c22*p*q + c23*lat + c24*w;
  der(ph) = p;
  der(th) = q;
  output um = (1 + c25)*u + bu;
  output vm = v + bv;
  output wm = w + bw;
  output pm = (1 + c26)*p + bp;
  output qm = (1 + c27)*q + bq;
  output rm = r + br + c28*(t/20 - 0.5);
  output phm = ph + bph;
  output thm = th + bth;
}";

/// Runs of a family, its directions, and where noise is added.
pub(super) struct Family {
    pub(super) records: Vec<Record>,
    pub(super) directions: Vec<Direction>,
    pub(super) channels: usize,
    /// Root mean square of each output's response.
    size: Vec<f64>,
}

/// How a family is flown.
pub(super) struct Plan {
    samples: usize,
    interval: f64,
    /// Unit of the steps of the inputs.
    scale: f64,
    runs: usize,
    /// All runs have the inputs of the first.
    repeated: bool,
    /// Whether the zeros of the outputs are fitted; they are candidates otherwise.
    biases: bool,
}

fn input(plan: &Plan, first: usize) -> Vec<f64> {
    let steps = [3.0, 2.0, 1.0, 1.0, 0.5, 2.5, 1.5];
    let mut u = Vec::new();
    let (mut k, mut sign) = (first, 1.0);
    while u.len() < plan.samples {
        let width = (steps[k % steps.len()] * plan.scale / plan.interval) as usize;
        u.extend(std::iter::repeat_n(0.05 * sign, width));
        (k, sign) = (k + 1, -sign);
    }
    u.truncate(plan.samples);
    u
}

impl Family {
    fn new(text: &str, effects: usize, finite: &[(&str, &[f64])], plan: &Plan) -> Self {
        let model = Model::from_text("family.fdm", text).unwrap();
        let (samples, inputs, q) = (plan.samples, model.layout().inputs, model.layout().outputs);
        let first = model.definition().param("c1").unwrap();
        let theta = model.definition().start();
        let columns: Vec<usize> = (0..first + effects).collect();
        let mut family = Self { records: Vec::new(), directions: Vec::new(), channels: q, size: vec![0.0; q] };
        let bias = |p: &usize| !plan.biases && model.definition().params[*p].quantity.name.starts_with('b');
        let (open, fitted): (Vec<usize>, Vec<usize>) = (0..first).partition(bias);
        let linear: Vec<usize> = open.into_iter().chain(first..first + effects).collect();
        let effects = linear.len();
        for k in 0..effects {
            family.directions.push(Direction { candidate: k, size: 1.0, shape: Shape::Linear });
        }
        for (k, (_, sizes)) in finite.iter().enumerate() {
            for (i, size) in sizes.iter().enumerate() {
                let shape = if i == 0 { Shape::Smallest } else { Shape::Finite };
                family.directions.push(Direction { candidate: effects + k, size: *size, shape });
            }
        }
        for run in 0..plan.runs {
            let moves: Vec<Vec<f64>> =
                (0..inputs).map(|i| input(plan, 3 * if plan.repeated { 0 } else { run } + 2 * i)).collect();
            let record = Run {
                name: format!("run {run}"),
                time: (0..samples).map(|k| k as f64 * plan.interval).collect(),
                inputs: (0..samples * inputs).map(|k| moves[k % inputs][k / inputs]).collect(),
                held: vec![false; inputs],
                measured: vec![0.0; samples * q],
                input_gaps: vec![0; inputs],
                stated: Vec::new(),
                output_gaps: vec![0; q],
            };
            let mut simulator = Simulator::new(model.dynamics(), &record, 4).unwrap();
            let stride = columns.len().next_multiple_of(8);
            let (mut y, mut jacobian) = (vec![0.0; samples * q], vec![0.0; samples * q * stride]);
            simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).unwrap();
            let column = |c: usize| -> Vec<f64> { jacobian.chunks_exact(stride).map(|row| row[c]).collect() };
            let mut directions: Vec<Signals> = linear.iter().map(|p| column(*p)).collect();
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
                family.size[k % q] += value * value / (plan.runs * samples) as f64;
            }
            let fitted = fitted.iter().map(|c| Some(column(*c))).collect();
            family.records.push(Record {
                interval: plan.interval,
                residual: y,
                fitted,
                directions,
                rows: None,
                deviations: None,
            });
        }
        family.size.iter_mut().for_each(|s| *s = s.sqrt());
        family
    }

    /// The runs with noise in the place of residuals.
    pub(super) fn noisy(&self, colour: Colour, share: f64, normal: &mut Stream) -> Vec<Record> {
        let mut records = self.records.clone();
        for record in &mut records {
            let noise = colour.noise(record.residual.len() / self.channels, self.channels, normal);
            for (k, value) in record.residual.iter_mut().enumerate() {
                let (n, c) = (k / self.channels, k % self.channels);
                *value = share * self.size[c] * noise[c][n];
            }
        }
        records
    }

    /// Energy of every direction beside the fitted columns, by the true spectrum of the noise: twice the gain of an effect of
    /// that size.
    pub(super) fn energies(&self, colour: Colour, share: f64) -> Vec<f64> {
        let (n, q) = (self.records[0].residual.len() / self.channels, self.channels);
        let (repeats, mut normal) = (300, Stream::seeded(5));
        let mut spectrum = vec![0.0; n * q];
        for _ in 0..repeats {
            for (c, noise) in colour.noise(n, q, &mut normal).iter().enumerate() {
                for (k, bin) in cosines(noise).iter().enumerate() {
                    spectrum[c * n + k] += (share * self.size[c] * bin).powi(2) / repeats as f64;
                }
            }
        }
        let count = self.records[0].fitted.len() + self.directions.len();
        let dropped = ScreeningOptions::default().dropped;
        let mut products = DMatrix::zeros(count, count);
        for record in &self.records {
            let signals = record.fitted.iter().flatten().chain(&record.directions);
            let mut bins = DMatrix::zeros(n * q, count);
            for (mut column, signal) in bins.column_iter_mut().zip(signals) {
                for c in 0..q {
                    let own: Vec<f64> = (0..n).map(|k| signal[k * q + c]).collect();
                    for (k, bin) in cosines(&own).iter().enumerate().skip(dropped) {
                        column[c * n + k] = bin / spectrum[c * n + k].sqrt();
                    }
                }
            }
            products += bins.tr_mul(&bins);
        }
        let p = self.records[0].fitted.len();
        let scale = products.diagonal().map(|v| if v > 0.0 { 1.0 / v.sqrt() } else { 0.0 });
        let unit = DMatrix::from_fn(p, p, |i, j| products[(i, j)] * scale[i] * scale[j]);
        let eigen = SymmetricEigen::new(unit);
        let of = |k: usize| {
            let cross = products.view((0, p + k), (p, 1)).component_mul(&scale.rows(0, p));
            let absorbed: f64 = (0..p)
                .filter(|i| eigen.eigenvalues[*i] > 1e-9)
                .map(|i| eigen.eigenvectors.column(i).dot(&cross).powi(2) / eigen.eigenvalues[i])
                .sum();
            products[(p + k, p + k)] - absorbed
        };
        (0..self.directions.len()).map(of).collect()
    }
}

fn cosines(signal: &[f64]) -> Vec<f64> {
    let mut bins = signal.to_vec();
    CosineTransform::new(bins.len()).forward(&mut bins);
    let scale = (2.0 / bins.len() as f64).sqrt();
    bins.iter_mut().for_each(|l| *l *= scale);
    bins[0] *= 0.5_f64.sqrt();
    bins
}

const DELAYS: &[f64] = &[0.025, 0.075, 0.2, 0.5];
const LAGS: &[f64] = &[0.05, 0.2, 0.6, 2.0];
const SLOW: &[f64] = &[0.5, 1.5, 4.0, 10.0];

pub(super) fn short_period(runs: usize, repeated: bool, biases: bool) -> Family {
    let plan = Plan { samples: 400, interval: 0.05, scale: 1.0, runs, repeated, biases };
    Family::new(SHORT_PERIOD, 13, &[("tau", DELAYS), ("lag", LAGS)], &plan)
}

/// A ship on records of a length: 300 s hold some turns, 75 s are short beside its time constants.
pub(super) fn ship(length: f64, runs: usize, repeated: bool, biases: bool) -> Family {
    let plan = Plan { samples: 400, interval: length / 400.0, scale: length / 15.0, runs, repeated, biases };
    Family::new(SHIP, 13, &[("tau", SLOW)], &plan)
}

pub(super) fn hover() -> Family {
    let plan = Plan { samples: 400, interval: 0.05, scale: 0.8, runs: 2, repeated: false, biases: true };
    Family::new(HOVER, 28, &[("tau", DELAYS), ("tal", DELAYS)], &plan)
}

/// A family by its name: made when it is wanted.
pub(super) type Made = (&'static str, fn() -> Family);

pub(super) const FAMILIES: [Made; 7] = [
    ("short period", || short_period(2, false, true)),
    ("ship", || ship(300.0, 2, false, true)),
    ("short ship", || ship(75.0, 2, false, true)),
    ("short period without biases", || short_period(2, false, false)),
    ("short period without biases, one run", || short_period(1, false, false)),
    ("ship without biases", || ship(300.0, 2, false, false)),
    ("hover", hover),
];
