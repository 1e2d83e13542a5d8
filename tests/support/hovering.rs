//! The light helicopter in hover: unstable, flown under four loops, its coefficients found again.

use crate::model;
use crate::turbulence::Flight;
use fdm::Model;
use fdm::estimate::BestIterate;
use fdm::record::Run;

/// Four sines, others in each channel.
pub fn drive(t: f64, channel: usize) -> f64 {
    (1..5).map(|h| (t * (0.7 * h as f64 + 0.13 * channel as f64) + (h * channel) as f64).sin()).sum::<f64>() * 0.5
}

/// The linear light helicopter, flown under four loops.
pub fn hovering(model: &Model, deviation: f64, seed: u64, samples: usize) -> Run {
    let states = model.layout().states;
    let deviations = [1.0, 1.0, 0.5, 0.3, 0.15, 0.3, 0.5, 0.15, 0.3].map(|size| deviation * size).to_vec();
    let flight = Flight {
        model,
        theta: model.definition().start(),
        intensities: vec![0.0; states],
        deviations,
        samples,
        dt: 0.02,
    };
    flight.record("hover", seed, |t, y| {
        let [_, v, w, phi, theta, psi, p, q, r] = y[..9] else { unreachable!("nine outputs") };
        vec![
            0.15 * drive(t, 1) + 0.2 * w,
            0.15 * drive(t, 2) - 1.5 * phi - 0.5 * p - 0.02 * v,
            0.3 * drive(t, 3) + 5.0 * theta + 2.0 * q,
            0.3 * drive(t, 4) + 0.8 * psi + 1.0 * r,
        ]
    })
}

pub fn helicopter() -> Model {
    let text = std::fs::read_to_string(crate::repository().join("models/hover/linear.fdm")).unwrap();
    let free = text.replace(
        "state u, v, w, phi, theta, psi, p, q, r;",
        "state u = free, v = free, w = free, phi = free, theta = free, psi = free, p = free, q = free, r = free;",
    );
    assert_ne!(text, free);
    model(&free)
}

/// Part of the coefficients' sizes by which an iterate is off, on the average over those that matter.
pub fn off(model: &Model, found: &BestIterate, values: &[f64]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (j, p) in found.recursion.parameters.iter().enumerate() {
        let truth = model.definition().params[model.definition().param(&p.name).unwrap()].value;
        if truth.abs() > 0.1 {
            (sum, count) = (sum + ((values[j] - truth) / truth).abs(), count + 1.0);
        }
    }
    sum / count
}
