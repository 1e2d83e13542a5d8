//! Records of vehicles in turbulence: a model with noise in its equations, integrated with many small steps, measured with noise,
//! and flown by a pilot where it needs one.

use crate::noise::Normal;
use fdm::Model;
use fdm::dynamics::{Point, Workspace};
use fdm::record::Run;

/// Steps of the integration between samples.
const STEPS: usize = 20;

/// What is flown.
pub(crate) struct Flight<'a> {
    pub(crate) model: &'a Model,
    /// True values of all parameters, noises included.
    pub(crate) theta: Vec<f64>,
    /// By state the intensity of the noise in its equation.
    pub(crate) intensities: Vec<f64>,
    /// By output the deviation of the measurement noise.
    pub(crate) deviations: Vec<f64>,
    pub(crate) samples: usize,
    pub(crate) dt: f64,
}

impl Flight<'_> {
    /// A record; `control` says the inputs from time and the last measurement, and they keep their values until the next sample.
    pub(crate) fn record(&self, name: &str, seed: u64, control: impl Fn(f64, &[f64]) -> Vec<f64>) -> Run {
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
            output_gaps: vec![0; q],
            time,
            inputs,
            measured,
        }
    }
}
