//! The same linear model by time and by frequency domain: the same estimates within one standard error.

use fdm::Model;
use fdm::estimate::{FitOptions, SpectralOptions, Work, fit, fit_spectra};
use fdm::frequency::EndTerms;
use fdm::record::Run;
use fdm::simulate::Simulator;
use fdm::spectrum::Frequencies;
use support::Normal;

/// Records from rest with lines in all inputs, and noise of a part of each output's deviation.
fn records(model: &Model, runs: usize, (n, dt): (usize, f64), part: f64) -> Vec<Run> {
    let (m, q) = (model.layout().inputs, model.layout().outputs);
    let mut normal = Normal(11);
    let record = |r: usize| {
        let time: Vec<f64> = (0..n).map(|k| dt * k as f64).collect();
        let input = |t: f64, i: usize| {
            let line = |h: usize| ((0.7 + 0.61 * (h * m + i) as f64) * t + (h * h + 2 * i + 5 * r) as f64).sin();
            0.2 * (0..5).map(line).sum::<f64>()
        };
        let run = Run {
            name: format!("run {}", r + 1),
            inputs: time.iter().flat_map(|t| (0..m).map(move |i| input(*t, i))).collect(),
            measured: vec![0.0; n * q],
            time,
            held: vec![false; m],
            input_gaps: vec![0; m],
            stated: Vec::new(),
            output_gaps: vec![0; q],
        };
        let mut run = run.with_measured(model.definition()).unwrap();
        let mut y = vec![0.0; n * q];
        Simulator::new(model.dynamics(), &run, 4).unwrap().simulate(&model.definition().start(), &mut y).unwrap();
        let squares = |o: usize| y.iter().skip(o).step_by(q).map(|v| v * v).sum::<f64>();
        let size: Vec<f64> = (0..q).map(|o| part * (squares(o) / n as f64).sqrt()).collect();
        run.measured = y.iter().enumerate().map(|(k, y)| y + size[k % q] * normal.next()).collect();
        run
    };
    (0..runs).map(record).collect()
}

fn options(frequencies: Frequencies) -> SpectralOptions {
    SpectralOptions { frequencies, ends: EndTerms::Unknown, finish: false, ..SpectralOptions::default() }
}

/// Fits both ways and compares.
fn agree(model: &Model, runs: &[Run], frequencies: Frequencies) {
    let time =
        fit(model, runs, &FitOptions { bare: true, per_interval: Some(4), ..FitOptions::default() }, &Work::default())
            .unwrap();
    let spectra = fit_spectra(model, runs, &options(frequencies), &Work::default()).unwrap();
    assert!(
        time.estimate.is_good() && spectra.is_good(),
        "{} {}",
        time.estimate.termination,
        spectra.estimate.termination
    );
    for p in &time.estimate.parameters {
        let other = spectra.estimate.parameter(&p.name, None).unwrap();
        let (a, b) = (p.standard_error.unwrap(), other.corrected_error.unwrap());
        let apart = (p.value - other.value).abs() / b;
        assert!(apart < 1.0, "{}: {} ± {a} by time, {} ± {b} by frequency", p.name, p.value, other.value);
        // the same information, less what the end values take
        assert!(b / a > 0.7 && b / a < 2.0, "{}: errors {a} by time, {b} by frequency", p.name);
    }
}

#[test]
fn the_pitch_model_of_a_business_jet() {
    let model = support::shipped("hfb320/no_delay.fdm");
    let runs = records(&model, 2, (1200, 0.025), 0.05);
    agree(&model, &runs, Frequencies::Grid { lowest: None, highest: Some(18.0) });
}

#[test]
fn an_unstable_helicopter_in_short_records() {
    let model = support::shipped("helicopter_benchmark/model.fdm");
    let runs = records(&model, 4, (500, 0.02), 0.05);
    agree(&model, &runs, Frequencies::Grid { lowest: None, highest: Some(24.0) });
}

/// Without noise, records that begin and end in motion tell the parameters at any frequencies.
#[test]
fn records_cut_out_of_a_motion_on_the_grid_and_off_it() {
    let model = support::shipped("hfb320/no_delay.fdm");
    let mut runs = records(&model, 1, (4000, 0.01), 0.0);
    let run = &mut runs[0];
    let begin = 1300;
    run.time = run.time[..4000 - begin].to_vec();
    run.inputs.drain(..begin);
    run.measured.drain(..begin);
    let band = |spacing| Frequencies::Band { lowest: 0.1, highest: 1.0, spacing: Some(spacing) };
    for frequencies in [Frequencies::Grid { lowest: Some(0.1), highest: Some(1.0) }, band(0.0437), band(0.005)] {
        let found = fit_spectra(&model, &runs, &options(frequencies.clone()), &Work::default()).unwrap();
        for p in model.definition().params.iter() {
            let value = found.estimate.parameter(&p.quantity.name, None).unwrap().value;
            let off = (value / p.value - 1.0).abs();
            assert!(off < 1e-4, "{} {value} instead of {} at {frequencies:?}", p.quantity.name, p.value);
        }
    }
}

/// As the language's design writes it: the derivative of the input, and a delay of all.
const EQUIVALENT: &str = "model equivalent {
    input stick [deg]; state q [deg/s], z [deg/s^2];
    param omega = 2 in [0.1, 20] [rad/s], zeta = 0.6 in [0, 2] [1], K = 2.2 [1/s^3], Ts = 0.6 [s], tau = 0.13 in [0, 0.5] [s];
    der(q) = z;
    der(z) = -2*zeta*omega*z - omega^2*q + delay(K*(stick + Ts*der(stick)), tau);
    output q_m [deg/s] = q; }";

#[test]
fn a_zero_by_the_derivative_of_the_input() {
    let model = Model::from_text("equivalent.fdm", EQUIVALENT).unwrap();
    let runs = records(&model, 2, (1200, 0.025), 0.05);
    agree(&model, &runs, Frequencies::Grid { lowest: None, highest: Some(18.0) });
}

/// Coupled inertias, with an accelerometer that shows a derivative and another that shows that of an input.
#[test]
fn coupled_inertias_and_accelerometers() {
    let text = "model coupled {
        input aileron, rudder; state p, r;
        const Ixx = 1.8, Izz = 3.1; param Ixz = 0.4, Lp = -2, La = 3, Nr = -1.2, Nd = -2, c = 0.3;
        Ixx*der(p) - Ixz*der(r) = Lp*p + La*aileron; Izz*der(r) - Ixz*der(p) = Nr*r + Nd*rudder;
        output p_m = p, r_m = r, ay = der(r) + c*der(rudder); }";
    let model = Model::from_text("coupled.fdm", text).unwrap();
    let runs = records(&model, 2, (900, 0.02), 0.05);
    agree(&model, &runs, Frequencies::Grid { lowest: None, highest: Some(6.0) });
}

/// Blocks become states that rest at the beginning: a filter before the elevator, a sensor behind the rate, a washout.
#[test]
fn blocks_before_and_behind_the_equations() {
    let text = "model filtered {
        input stick; state q, z;
        param omega = 2 in [0.1, 20], zeta = 0.6 in [0, 2], K = 2.2, lead = 0.5 in [0, 5], sensor = 0.2 in [0.01, 2], T = 1.4 in [0.05, 20];
        let moved = leadlag(stick, lead, 0.1);
        der(q) = z;
        der(z) = K*tf(moved, [1], [0.02, 1]) - 2*zeta*omega*z - omega^2*q;
        output q_m = lag(q, sensor), z_m = z, w_m = washout(q, T), s_m = second_order(stick, 8, 0.7) + q; }";
    let model = Model::from_text("filtered.fdm", text).unwrap();
    let runs = records(&model, 2, (1200, 0.025), 0.05);
    agree(&model, &runs, Frequencies::Grid { lowest: None, highest: Some(18.0) });
}

/// How many of the product a reaction makes, by which an output of its own is reached: the rate shows on the feed, the number on the product.
#[test]
fn a_stoichiometric_coefficient() {
    let text = "model yields {
        input feed; state A, B; param k = 1.3 in [0, 20], n = 2.4 in [0, 10], d = 0.7 in [0, 20];
        reactions { A -> n*B : k*A; B -> 0 : d*B; }
        der(A) = feed + reaction(A);
        output A_m = A, B_m = B; }";
    let model = Model::from_text("yields.fdm", text).unwrap();
    let runs = records(&model, 2, (1200, 0.025), 0.05);
    agree(&model, &runs, Frequencies::Grid { lowest: None, highest: Some(18.0) });
}

/// Without noise, on the grid and off it, the delay within the record's first seconds too.
#[test]
fn derivatives_of_inputs_are_exact_in_the_frequency_domain() {
    let model = Model::from_text("equivalent.fdm", EQUIVALENT).unwrap();
    let runs = records(&model, 1, (8000, 0.005), 0.0);
    let band = |spacing| Frequencies::Band { lowest: 0.1, highest: 1.5, spacing: Some(spacing) };
    for frequencies in [Frequencies::Grid { lowest: Some(0.1), highest: Some(1.5) }, band(0.0437)] {
        let known = SpectralOptions { ends: EndTerms::Known, ..options(frequencies.clone()) };
        for options in [options(frequencies.clone()), known] {
            let found = fit_spectra(&model, &runs, &options, &Work::default()).unwrap();
            for p in &model.definition().params {
                let value = found.estimate.parameter(&p.quantity.name, None).unwrap().value;
                let off = (value / p.value - 1.0).abs();
                assert!(
                    off < 1e-5,
                    "{} {value} instead of {} at {frequencies:?}, {:?}",
                    p.quantity.name,
                    p.value,
                    options.ends
                );
            }
        }
    }
}
