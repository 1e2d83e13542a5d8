//! Records of vehicles in turbulence: a model with noise in its equations, integrated with many small steps, measured with noise,
//! and flown by a pilot where it needs one.

use crate::{Normal, model};
use fdm::Model;
use fdm::dynamics::{Point, Workspace};
use fdm::estimate::{FilterFit, Fit, FitOptions, Work, fit, fit_filter};
use fdm::record::Run;

/// Steps of the integration between samples.
const STEPS: usize = 20;

/// What is flown.
pub struct Flight<'a> {
    pub model: &'a Model,
    /// True values of all parameters, noises included.
    pub theta: Vec<f64>,
    /// By state the intensity of the noise in its equation.
    pub intensities: Vec<f64>,
    /// By output the deviation of the measurement noise.
    pub deviations: Vec<f64>,
    pub samples: usize,
    pub dt: f64,
}

impl Flight<'_> {
    /// A record; `control` says the inputs from time and the last measurement, and they keep their values until the next sample.
    pub fn record(&self, name: &str, seed: u64, control: impl Fn(f64, &[f64]) -> Vec<f64>) -> Run {
        let (dynamics, mut noise) = (self.model.dynamics(), Normal(seed));
        let layout = dynamics.layout();
        let (n, q) = (layout.states, layout.outputs);
        let (mut work, mut known) = (Workspace::new(dynamics), vec![0.0; layout.known]);
        dynamics.prepare(&self.theta, &mut known, &mut work);
        let mut x = known[layout.initial.clone()].to_vec();
        let (mut time, mut inputs, mut measured) = (Vec::new(), Vec::new(), Vec::new());
        let (mut rate, mut y) = (vec![0.0; n], vec![0.0; q]);
        let h = self.dt / STEPS as f64;
        let mut u = vec![0.0; layout.inputs];
        for k in 0..self.samples {
            let t = self.dt * k as f64;
            dynamics.outputs(Point { t, x: &x, drive: &u, known: &known }, &mut y, &mut work);
            y.iter_mut().zip(&self.deviations).for_each(|(y, s)| *y += s * noise.next());
            u = control(t, &y);
            time.push(t);
            inputs.extend(&u);
            measured.extend(&y);
            for step in 0..STEPS {
                // Heun's method for the drift, which is of second order where the noise is added
                let at = t + step as f64 * h;
                let kick: Vec<f64> = self.intensities.iter().map(|q| q * h.sqrt() * noise.next()).collect();
                dynamics.rates(Point { t: at, x: &x, drive: &u, known: &known }, &mut rate, &mut work);
                let first = rate.clone();
                let there: Vec<f64> = (0..n).map(|i| x[i] + h * first[i] + kick[i]).collect();
                dynamics.rates(Point { t: at + h, x: &there, drive: &u, known: &known }, &mut rate, &mut work);
                (0..n).for_each(|i| x[i] += 0.5 * h * (first[i] + rate[i]) + kick[i]);
            }
        }
        Run {
            name: name.into(),
            held: vec![true; layout.inputs],
            input_gaps: vec![0; layout.inputs],
            stated: Vec::new(),
            output_gaps: vec![0; q],
            time,
            inputs,
            measured,
        }
    }
}

/// Short period of an aircraft in vertical turbulence that is not measured (Dryden's spectrum of first order).
pub const AIRCRAFT: &str = "model short_period {
  input delta;
  state alpha = 0, q = 0, gust = 0;
  param Za = -1.2, Ma = -6, Mq = -1.8, Md = -8, L = 0.8 in [0.05, 10], s = 0.02;
  let seen = alpha + gust;
  der(alpha) = Za*seen + q;
  der(q)     = Ma*seen + Mq*q + Md*delta;
  der(gust)  = -gust/L;
  noise der(gust) = sqrt(2*s^2/L);
  output rate = q;
  output acceleration = Za*seen;
}";

/// The same without turbulence: what output error can do.
pub const CALM: &str = "model short_period {
  input delta;
  state alpha = 0, q = 0;
  param Za = -1.2, Ma = -6, Mq = -1.8, Md = -8;
  der(alpha) = Za*alpha + q;
  der(q)     = Ma*alpha + Mq*q + Md*delta;
  output rate = q;
  output acceleration = Za*alpha;
}";

/// Divergent pitch of a vehicle that a controller holds.
pub const UNSTABLE: &str = "model unstable {
  input command;
  state theta = 0, q = 0;
  param Mu = 2, Mq = 0.3, Md = 4, w = 0.05;
  der(theta) = q;
  der(q)     = Mu*theta + Mq*q + Md*command;
  noise der(q) = w;
  output attitude = theta;
  output rate = q;
}";

pub const TRUTH: [(&str, f64); 6] = [("Za", -0.95), ("Ma", -4.2), ("Mq", -1.1), ("Md", -6.1), ("L", 0.5), ("s", 0.03)];

pub fn theta(model: &Model, truth: &[(&str, f64)]) -> Vec<f64> {
    let mut theta = model.definition().start();
    truth.iter().for_each(|(name, value)| theta[model.definition().param(name).unwrap()] = *value);
    theta
}

/// A 3-2-1-1 of the elevator, there and back.
pub fn multistep(t: f64) -> f64 {
    let sign = match t % 14.0 {
        t if t < 3.0 => 1.0,
        t if t < 5.0 => -1.0,
        t if t < 6.0 => 1.0,
        t if t < 7.0 => -1.0,
        _ => 0.0,
    };
    0.02 * sign
}

/// Flights through turbulence of deviation `s`.
pub fn gusty(seed: u64, s: f64, samples: usize) -> (Model, Run) {
    let model = model(AIRCRAFT);
    let mut truth = TRUTH;
    truth[5].1 = s;
    let intensities = vec![0.0, 0.0, (2.0 * s * s / truth[4].1).sqrt()];
    let theta = theta(&model, &truth);
    let flight = Flight { model: &model, theta, intensities, deviations: vec![0.002, 0.003], samples, dt: 0.05 };
    let run = flight.record("flight", seed, |t, _| vec![multistep(t)]);
    (model, run)
}

pub fn held(seed: u64, samples: usize) -> (Model, Run) {
    let model = model(UNSTABLE);
    let theta = theta(&model, &UNSTABLE_TRUTH);
    let (intensities, deviations) = (vec![0.0, 0.1], vec![0.005, 0.01]);
    let flight = Flight { model: &model, theta, intensities, deviations, samples, dt: 0.05 };
    let run = flight.record("held", seed, |t, y| vec![10.0 * multistep(t) - 1.2 * y[0] - 0.5 * y[1]]);
    (model, run)
}

pub const UNSTABLE_TRUTH: [(&str, f64); 4] = [("Mu", 2.5), ("Mq", 0.4), ("Md", 5.0), ("w", 0.1)];

pub fn filtered(model: &Model, runs: &[Run]) -> FilterFit {
    let found = fit_filter(model, runs, &FitOptions::default(), &Work::default()).unwrap_or_else(|e| panic!("{e}"));
    assert!(found.fit.estimate.is_good(), "{}", found.fit.estimate.termination);
    found
}

pub fn open_loop(model: &Model, runs: &[Run]) -> Fit {
    fit(model, runs, &FitOptions::default(), &Work::default()).unwrap_or_else(|e| panic!("{e}"))
}

/// Value and error to be trusted.
pub fn of(fit: &Fit, name: &str) -> (f64, f64) {
    let p = fit.estimate.parameter(name, None).unwrap();
    (p.value, p.error().unwrap_or(f64::NAN))
}
