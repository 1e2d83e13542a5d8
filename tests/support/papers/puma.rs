//! The Puma of Black, Murray-Smith and Padfield (1986): records of 14 s, eight frequencies to 0.56 Hz.

use super::{doublet, flown, model, noisy, steps, three_two_one_one, with_values};
use fdm::Model;
use fdm::equation_error::{Components, Domain, RegressionOptions};
use fdm::record::Run;
use fdm::spectrum::Frequencies;

/// Transformed samples: 500 of them last 14.3 s, so that the frequencies are 0.07 Hz apart.
pub const SAMPLES: usize = 500;
pub const DT: f64 = 1.0 / 35.0;
/// The eight frequencies of a single run.
pub const HIGHEST: f64 = 0.565;

/// Standard deviations of measured V, alpha, q, theta, p, beta.
pub const NOISE: [f64; 6] = [0.5, 0.002, 0.002, 0.002, 0.002, 0.002];

/// The pitching moment that HELISTAB predicts, as the paper prints it.
pub const THEORY: [(&str, f64); 6] =
    [("Mu", 0.0024), ("Mw", -0.0051), ("Mq", -0.835), ("Mbeta", -0.0013 * 168.8), ("Mp", -0.210), ("Meta", -0.0376)];

pub fn flight() -> Model {
    model("puma/flight.fdm")
}

/// The flight with the pitching moment of the theory, and this delay of the rotor.
pub fn flight_of_theory(delay: f64) -> Model {
    let mut values = THEORY.to_vec();
    values.push(("tau", delay));
    with_values(&flight(), &values)
}

/// A doublet of the longitudinal cyclic with these halves, in seconds.
pub fn doublet_of(model: &Model, half: f64) -> Run {
    flown(model, "doublet", SAMPLES + 2, DT, |t| piloted(t, doublet(t, 1.0, 1.5, half)))
}

/// The same with nothing but the longitudinal cyclic moved, so that roll and sideslip follow pitch.
pub fn hands_off(model: &Model, half: f64) -> Run {
    flown(model, "doublet", SAMPLES + 2, DT, |t| vec![doublet(t, 1.0, 1.5, half), 0.0, 0.0, 0.0])
}

/// The DFVLR's 3211 with this unit.
pub fn three_two_one_one_of(model: &Model, unit: f64) -> Run {
    flown(model, "3211", SAMPLES + 2, DT, |t| piloted(t, three_two_one_one(t, 1.0, 1.5, unit)))
}

/// The longitudinal cyclic, and the small inputs by which the pilot holds roll and heading meanwhile.
fn piloted(t: f64, eta: f64) -> Vec<f64> {
    let lateral = steps(t, 2.2, &[(-0.3, 1.1), (0.35, 0.9), (0.0, 2.3), (0.25, 0.8), (-0.2, 1.4)]);
    let pedals = steps(t, 3.1, &[(0.5, 0.9), (-0.4, 1.2), (0.0, 2.0), (-0.3, 1.1), (0.3, 0.7)]);
    vec![eta, lateral, pedals, 0.0]
}

/// Four runs of the four controls, as in section 4.1.3: collective doublet, longitudinal 3211, pedal doublet, lateral step.
pub fn all_controls(model: &Model, samples: usize) -> Vec<Run> {
    let fly = |name: &str, controls: &dyn Fn(f64) -> Vec<f64>| flown(model, name, samples + 2, DT, controls);
    vec![
        fly("collective", &|t| vec![0.0, 0.0, 0.0, doublet(t, 1.0, 1.0, 2.0)]),
        fly("longitudinal", &|t| vec![three_two_one_one(t, 1.0, 1.5, 0.8), 0.0, 0.0, 0.0]),
        fly("pedals", &|t| vec![0.0, 0.0, doublet(t, 1.0, 2.0, 2.0), 0.0]),
        fly("lateral", &|t| vec![0.0, steps(t, 1.0, &[(0.6, 4.0)]), 0.0, 0.0]),
    ]
}

/// With this multiple of the noise.
pub fn with_noise(run: &Run, part: f64, seed: u64) -> Run {
    noisy(run, &NOISE.map(|n| part * n), seed)
}

/// As `model.fdm` and `no_delay.fdm` take it: roll rate and sideslip are inputs.
pub fn longitudinal(flight: &Run) -> Run {
    rearranged(flight, &[Channel::Control(0), Channel::Shown(4), Channel::Shown(5)], &[0, 1, 2, 3])
}

/// As `pitching_moment.fdm` takes it.
pub fn pitching_moment(flight: &Run) -> Run {
    let inputs = [0, 1, 4, 5].map(Channel::Shown);
    rearranged(flight, &[&[Channel::Control(0)], &inputs[..]].concat(), &[2])
}

#[derive(Clone, Copy)]
enum Channel {
    Control(usize),
    Shown(usize),
}

fn rearranged(flight: &Run, inputs: &[Channel], outputs: &[usize]) -> Run {
    let (m, q) = (flight.held.len(), flight.output_gaps.len());
    let value = |k: usize, channel: &Channel| match channel {
        Channel::Control(c) => flight.inputs[k * m + c],
        Channel::Shown(o) => flight.measured[k * q + o],
    };
    Run {
        name: flight.name.clone(),
        time: flight.time.clone(),
        inputs: (0..flight.len()).flat_map(|k| inputs.iter().map(move |c| value(k, c))).collect(),
        held: vec![false; inputs.len()],
        measured: (0..flight.len()).flat_map(|k| outputs.iter().map(move |o| value(k, &Channel::Shown(*o)))).collect(),
        input_gaps: vec![0; inputs.len()],
        stated: Vec::new(),
        output_gaps: vec![0; outputs.len()],
    }
}

/// Standard deviations of measured pitch rate and normal acceleration.
pub const SHORT_PERIOD_NOISE: [f64; 2] = [0.002, 0.1];

pub fn transfer_functions() -> Model {
    model("puma/transfer_functions.fdm")
}

/// A 3211 of the two transfer functions.
pub fn short_period(model: &Model) -> Run {
    flown(model, "3211", SAMPLES, DT, |t| vec![three_two_one_one(t, 1.0, 1.5, 0.8)])
}

/// The rule by which the paper chooses the number of components.
pub const PUBLISHED: Components = Components::Levelled;

pub fn at_frequencies(highest: f64, components: Components) -> RegressionOptions {
    let domain = Domain::Frequency(Frequencies::Grid { lowest: None, highest: Some(highest) });
    RegressionOptions { domain, components, ..RegressionOptions::default() }
}
