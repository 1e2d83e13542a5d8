//! Nonlinear models with known parameters, and their estimates by three ways: output error in the time domain, and in the frequency
//! domain linearised at the trim or with nonlinear terms carried in as known inputs.

use crate::Normal;
use fdm::Model;
use fdm::estimate::{
    Changes, FitOptions, Nonlinear, ParameterEstimate, SpectralFit, SpectralOptions, Work, fit, fit_spectra,
};
use fdm::frequency::EndTerms;
use fdm::record::Run;
use fdm::simulate::Simulator;
use fdm::spectrum::Frequencies;
use std::f64::consts::PI;

/// Steps between samples with which data are made and fitted.
const STEPS: usize = 4;

/// A model, its true parameters and a run without noise.
pub struct System {
    pub name: &'static str,
    pub model: Model,
    /// Names and true values.
    pub truth: Vec<(&'static str, f64)>,
    pub clean: Run,
    /// Parameters that a linear model does not have; they are known in both ways that are compared.
    nonlinear: Vec<&'static str>,
    /// Highest frequency that is used, in cycles per unit of time.
    highest: f64,
}

/// A value, its standard error (corrected where there is one).
#[derive(Clone, Copy)]
pub struct Found {
    pub value: f64,
    pub error: f64,
}

impl System {
    /// `inputs` by time; the truth holds initial values `x(0)` too.
    fn new(
        name: &'static str,
        file: &str,
        truth: &[(&'static str, f64)],
        (samples, dt, highest): (usize, f64, f64),
        input: impl Fn(f64) -> Vec<f64>,
    ) -> Self {
        let model = crate::shipped(file);
        let (m, q) = (model.layout().inputs, model.layout().outputs);
        let time: Vec<f64> = (0..samples).map(|k| dt * k as f64).collect();
        let mut clean = Run {
            name: "run".into(),
            inputs: time.iter().flat_map(|t| input(*t)).collect(),
            time,
            held: vec![false; m],
            measured: Vec::new(),
            input_gaps: vec![0; m],
            stated: Vec::new(),
            output_gaps: vec![0; q],
        };
        let mut theta = model.definition().start();
        for (name, value) in truth {
            theta[model.definition().param(name).unwrap()] = *value;
        }
        clean.measured = vec![0.0; samples * q];
        let mut y = clean.measured.clone();
        Simulator::new(model.dynamics(), &clean, 8 * STEPS).unwrap().simulate(&theta, &mut y).unwrap();
        clean.measured = y;
        Self { name, model, truth: truth.to_vec(), clean, nonlinear: Vec::new(), highest }
    }

    /// With white noise of this part of each output's root mean square about its mean.
    pub fn noisy(&self, part: f64, seed: u64) -> Run {
        let q = self.model.layout().outputs;
        let size: Vec<f64> = (0..q)
            .map(|o| {
                let y: Vec<f64> = self.clean.measured.iter().skip(o).step_by(q).copied().collect();
                let mean = y.iter().sum::<f64>() / y.len() as f64;
                part * (y.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / y.len() as f64).sqrt()
            })
            .collect();
        let mut normal = Normal(seed.wrapping_mul(0xD129_0D3B_3C86_5D21));
        let measured = self.clean.measured.iter().enumerate().map(|(k, y)| y + size[k % q] * normal.next()).collect();
        Run { measured, ..self.clean.clone() }
    }

    /// Parameters of the equations, without initial values.
    pub fn params(&self) -> impl Iterator<Item = (&'static str, f64)> + '_ {
        self.truth.iter().filter(|(name, _)| !name.ends_with("(0)")).copied()
    }

    /// The same with what a linear model does not have held at the truth.
    fn of_small_motions(self, nonlinear: &[&'static str]) -> Self {
        Self { nonlinear: nonlinear.to_vec(), ..self }
    }

    /// Parameters that are zero are known to be.
    fn changes(&self) -> Changes {
        let known = || self.params().filter(|(n, v)| *v == 0.0 || self.nonlinear.contains(n));
        Changes {
            set: known().map(|(n, v)| (n.to_string(), v)).collect(),
            fix: known().map(|(n, _)| n.to_string()).collect(),
            ..Changes::default()
        }
    }

    /// Output error in the time domain.
    pub fn in_time(&self, run: &Run) -> Vec<Option<Found>> {
        let options = FitOptions { changes: self.changes(), per_interval: Some(STEPS), ..FitOptions::default() };
        let found = fit(&self.model, std::slice::from_ref(run), &options, &Work::default()).unwrap();
        assert!(found.estimate.is_good(), "{}: {}", self.name, found.estimate.termination);
        self.params().map(|(name, _)| of(found.estimate.parameter(name, None))).collect()
    }

    /// Output error in the frequency domain.
    pub fn spectral(&self, run: &Run, nonlinear: Nonlinear) -> SpectralFit {
        let options = SpectralOptions {
            changes: self.changes(),
            frequencies: Frequencies::Grid { lowest: None, highest: Some(self.highest) },
            nonlinear,
            // noise of end values that are read off the record is in no error
            ends: EndTerms::Unknown,
            finish: false,
            ..SpectralOptions::default()
        };
        fit_spectra(&self.model, std::slice::from_ref(run), &options, &Work::default()).unwrap()
    }

    /// The same, of parameters that the linear model sees.
    pub fn in_frequency(&self, run: &Run, nonlinear: Nonlinear) -> Vec<Option<Found>> {
        let found = self.spectral(run, nonlinear);
        assert!(found.is_good(), "{}: {}", self.name, found.estimate.termination);
        let seen = |name: &str| !found.not_identifiable.iter().any(|u| u == name);
        let parameters = found.parameters();
        let one = |name: &str| parameters.iter().find(|p| p.name == name).filter(|_| seen(name));
        self.params().map(|(name, _)| of(one(name))).collect()
    }
}

fn of(parameter: Option<&ParameterEstimate>) -> Option<Found> {
    let p = parameter?;
    Some(Found { value: p.value, error: p.corrected_error.or(p.standard_error)? })
}

/// A zig-zag of the rudder whose halves have different lengths, turned at the rate of a steering gear.
fn zig_zag(t: f64, size: f64) -> f64 {
    const TURNS: [f64; 14] =
        [10.0, 40.0, 85.0, 105.0, 130.0, 190.0, 240.0, 265.0, 285.0, 345.0, 370.0, 430.0, 460.0, 500.0];
    let ramp = |at: f64| ((t - at) / 4.0).clamp(0.0, 1.0);
    let turned = |(k, at): (usize, &f64)| (if k == 0 { 1.0 } else { 2.0 }) * (1.0 - 2.0 * (k % 2) as f64) * ramp(*at);
    size * TURNS.iter().enumerate().map(turned).sum::<f64>()
}

/// The ship on a zig-zag with this rudder angle (rad), 600 s.
pub fn ship(name: &'static str, rudder: f64) -> System {
    let truth = [
        ("C1", -1.0e-2),
        ("C2", -3.0),
        ("C3", -1.5e-3),
        ("C4", -1.0e-2),
        ("C5", -0.35),
        ("C6", 1.0e-3),
        ("C7", -1.0e-2),
        ("C8", -3.0e-4),
        ("C9", -2.0e-2),
        ("C10", -1.2e-4),
        ("C11", -0.5),
        ("u(0)", 7.7),
        ("v(0)", 0.0),
        ("r(0)", 0.0),
    ];
    let input = |t: f64| vec![zig_zag(t, rudder)];
    let small = if rudder < 0.05 { &["C1", "C2", "C3", "C7", "C11"][..] } else { &[] };
    System::new(name, "manoeuvring_ship/model.fdm", &truth, (3000, 0.2, 0.08), input).of_small_motions(small)
}

/// The driven pendulum; `torque` scales it, `coulomb` is the friction of the bearing.
pub fn pendulum(name: &'static str, torque: f64, coulomb: f64) -> System {
    let truth = [("w2", 64.0), ("c", 0.3), ("F", coulomb), ("b", 1.0), ("x(0)", 0.0), ("omega(0)", 0.0)];
    let waves = [(0.31, 0.0), (0.67, 1.3), (1.03, 2.9), (1.21, 0.4), (1.49, 4.1), (1.9, 5.3)];
    let input = move |t: f64| vec![torque * waves.iter().map(|(f, p)| (2.0 * PI * f * t + p).sin()).sum::<f64>()];
    System::new(name, "pendulum_free_swing/driven.fdm", &truth, (2400, 0.005, 4.0), input)
}

/// The roll decay from this angle (rad), its rate measured too.
pub fn roll_decay(name: &'static str, from: f64) -> System {
    let truth = [
        ("omega2", 6.2),
        ("d1", 0.03),
        ("d2", if from < 0.05 { 0.0 } else { 0.12 }),
        ("k3", -1.5),
        ("phi(0)", from),
        ("p(0)", 0.0),
    ];
    let small = if from < 0.05 { &["d2", "k3"][..] } else { &[] };
    System::new(name, "ship_roll_decay/with_rate.fdm", &truth, (3200, 0.0125, 1.5), |_| Vec::new())
        .of_small_motions(small)
}
