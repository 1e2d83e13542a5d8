//! Tables in whole studies: a lift curve with free ordinates, found from simulated flights.

use fdm::Model;
use fdm::code::{Nominal, verify};
use fdm::equation_error::{RegressionOptions, regress};
use fdm::estimate::{Changes, Fit, FitOptions, Nonlinear, SpectralOptions, Status, Work, fit, fit_spectra};
use fdm::record::Run;
use fdm::simulate::Simulator;
use fdm::spectrum::Frequencies;
use support::Normal;

const CURVE: [(&str, f64); 6] =
    [("CL0", -0.4), ("CL1", 0.25), ("CL2", 0.8), ("CL3", 1.15), ("CL4", 1.2), ("CL5", 0.95)];

/// An aeroplane in pitch whose lift curve bends over at the stall.
fn aeroplane(method: &str) -> Model {
    let text = format!(
        "model stall \"pitch and stall\" {{
          input  de    \"elevator\"        [rad];
          state  alpha \"angle of attack\" [rad] = 0.1, q \"pitch rate\" [rad/s];
          param  CL0 = -0.4 [1], CL1 = 0.25 [1], CL2 = 0.8 [1], CL3 = 1.15 [1], CL4 = 1.2 [1], CL5 = 0.95 [1];
          table  CL(alpha [rad]) \"lift\" [1] = {method} {{ -0.1: CL0, 0: CL1, 0.1: CL2, 0.2: CL3, 0.3: CL4, 0.45: CL5 }};
          param  Ma = -6 [1/s^2], Mq = -1.5 [1/s], Md = -8 [1/s^2];
          const  g = 9.81 [m/s^2], V = 60 [m/s], k = 12 [m/s^2];
          const  a0 = 0.1 [rad];
          der(alpha) = q + (g - k*CL(alpha))/V;
          der(q) = Ma*(alpha - a0) + Mq*q + Md*de;
          output az [m/s^2] = k*CL(alpha), alpha_m [rad] = alpha, q_m [rad/s] = q;
        }}"
    );
    Model::from_text("stall.fdm", text).unwrap()
}

/// Sweeps through the whole range of the table, with noise of a part of each output's size.
fn flight(model: &Model, part: f64, seed: u64) -> Run {
    let (n, dt, q) = (1500, 0.02, 3);
    let time: Vec<f64> = (0..n).map(|k| dt * k as f64).collect();
    let elevator = |t: f64| -0.055 - 0.13 * (0.5 * t + 0.3).sin() - 0.08 * (1.7 * t).sin() - 0.04 * (4.1 * t).cos();
    let mut run = Run {
        name: "flight".into(),
        inputs: time.iter().map(|t| elevator(*t)).collect(),
        measured: vec![0.0; n * q],
        time,
        held: vec![false],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    };
    let mut y = vec![0.0; n * q];
    Simulator::new(model.dynamics(), &run, 4).unwrap().simulate(&model.definition().start(), &mut y).unwrap();
    let (low, high) = y.iter().skip(1).step_by(q).fold((9.0f64, -9.0f64), |(a, b), v| (a.min(*v), b.max(*v)));
    assert!(low < -0.07 && high > 0.4, "the flight goes from {low} to {high}");
    let mut normal = Normal(seed);
    let size = [12.0, 0.3, 0.4].map(|s| part * s);
    run.measured = y.iter().enumerate().map(|(k, y)| y + size[k % q] * normal.next()).collect();
    run
}

fn found(fit: &Fit, worst: f64) {
    assert!(fit.estimate.is_good(), "{}", fit.estimate.termination);
    let off: Vec<f64> = CURVE
        .iter()
        .map(|(name, want)| {
            let p = fit.estimate.parameter(name, None).unwrap();
            let error = p.error().unwrap();
            assert!(error < worst, "{name}: {} ± {error}", p.value);
            (p.value - want) / error
        })
        .collect();
    assert!(off.iter().all(|z| z.abs() < 4.0), "{off:?}");
    let spread = (off.iter().map(|z| z * z).sum::<f64>() / off.len() as f64).sqrt();
    assert!((0.3..2.0).contains(&spread), "errors as large as they are said to be: {off:?}");
}

#[test]
fn a_lift_curve_with_free_ordinates_is_found_within_its_errors() {
    for method in ["linear", "cubic", "pchip"] {
        let model = aeroplane(method);
        assert!(model.warnings().is_empty());
        let set = CURVE.iter().map(|(n, v)| ((*n).to_string(), 0.8 * v + 0.05)).collect();
        let options = FitOptions { changes: Changes { set, ..Changes::default() }, ..FitOptions::default() };
        found(&fit(&model, &[flight(&model, 0.02, 5)], &options, &Work::default()).unwrap(), 0.05);
        let checked = verify(model.definition(), model.schedule(), &Nominal::start(model.definition()));
        assert!(checked.passed(), "{method}: {:?}", checked.failures);
    }
}

/// Ordinates are linear in every method, so that they need neither start values nor corrections.
#[test]
fn a_lift_curve_is_regressed_in_one_step() {
    let model = aeroplane("pchip");
    let regression = regress(&model, &[flight(&model, 0.0, 1)], &RegressionOptions::default());
    assert!(
        regression.is_err() || !regression.unwrap().refused.is_empty(),
        "slopes of pchip are no multiples of its ordinates"
    );
    for method in ["linear", "cubic"] {
        let model = aeroplane(method);
        let regression = regress(&model, &[flight(&model, 0.001, 1)], &RegressionOptions::default()).unwrap();
        assert!(regression.refused.is_empty() && regression.kept.is_empty(), "{:?}", regression.refused);
        for (name, want) in CURVE {
            let own = regression.fits.iter().flat_map(|f| &f.parameters).find(|p| p.name == name).unwrap();
            assert!((own.value - want).abs() < 0.05, "{method}: {name} is {} instead of {want}", own.value);
        }
    }
}

/// In the frequency domain what is not linear is carried as a known input, computed from records.
#[test]
fn tables_are_carried_as_known_inputs() {
    let (carried, terms) = aeroplane("linear").carried().unwrap();
    assert!(carried.layout().affine.rates && terms.len() >= 5, "{}", terms.len());
    assert!(CURVE.iter().all(|(name, _)| carried.definition().param(name).is_some()));
    let (model, flights) = (aeroplane("linear"), [flight(&aeroplane("linear"), 0.001, 2)]);
    let options = |fix: &[&str]| SpectralOptions {
        nonlinear: Nonlinear::MeasuredRegressors,
        frequencies: Frequencies::Grid { lowest: None, highest: Some(20.0) },
        finish: false,
        changes: Changes { fix: fix.iter().map(|n| (*n).into()).collect(), ..Changes::default() },
        ..SpectralOptions::default()
    };
    // without the line at zero the level of the curve cannot be seen, and that is said
    let open = fit_spectra(&model, &flights, &options(&[]), &Work::default()).unwrap().estimate.undetermined;
    let names: Vec<&str> = open.iter().flat_map(|d| d.moves.iter().map(|(name, _)| name.as_str())).collect();
    assert!(open.len() == 1 && CURVE.iter().all(|(name, _)| names.contains(name)), "{open:?}");
    let fit = fit_spectra(&model, &flights, &options(&["CL1"]), &Work::default()).unwrap();
    assert!(fit.is_good(), "{}", fit.estimate.termination);
    for (name, want) in CURVE.iter().filter(|(name, _)| *name != "CL1") {
        let p = fit.estimate.parameter(name, None).unwrap();
        let error = p.error().unwrap();
        assert!(error < 0.02, "{name}: {} ± {error}", p.value);
        assert!((p.value - want).abs() < 4.0 * error, "{name}: {} ± {error} instead of {want}", p.value);
    }
}

#[test]
fn ordinates_that_no_flight_visits_are_said_to_be_open() {
    let text = "model gentle {
        input u [rad]; param y0 = 1 [1], y1 = 2 [1], y2 = 2.5 [1], y3 = 2.6 [1];
        table C(x [rad]) [1] = linear { 0: y0, 1: y1, 2: y2, 3: y3 };
        output y [1] = C(u);
    }";
    let model = Model::from_text("gentle", text).unwrap();
    let time: Vec<f64> = (0..200).map(|k| 0.1 * f64::from(k)).collect();
    let mut normal = Normal(3);
    let run = Run {
        name: "gentle".into(),
        inputs: time.iter().map(|t| 0.9 + 0.9 * t.sin()).collect(),
        measured: time
            .iter()
            .map(|t| {
                let u = 0.9 + 0.9 * t.sin();
                (if u < 1.0 { 1.0 + u } else { 2.0 + 0.5 * (u - 1.0) }) + 0.01 * normal.next()
            })
            .collect(),
        time,
        held: vec![false],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0],
    };
    let fit = fit(&model, &[run], &FitOptions::default(), &Work::default()).unwrap();
    let status = |name: &str| fit.estimate.parameter(name, None).unwrap().status;
    assert_eq!(
        ["y0", "y1", "y2", "y3"].map(status),
        [Status::Estimated, Status::Estimated, Status::Estimated, Status::NotDetermined]
    );
}

#[test]
fn both_doors_have_the_same_tables() {
    let by_macro = fdm::model! {
        model curve {
            input u [deg];
            param a = 1 [m], b = -2 [m];
            table C(x [deg]) "a curve" [m] = cubic { -3: a, -1: b, 0: a + b, 2.5: 1, 4: 2*a, };
            table D(x [m]) [1] = pchip { -1: 0, 0: 1, 1: 1.5, 3: 1 };
            output y [1] = D(C(u));
        }
    };
    let text = Model::from_text("curve", by_macro.source().text()).unwrap();
    let time: Vec<f64> = (0..400).map(|k| 0.05 * f64::from(k)).collect();
    let run = Run {
        name: "r".into(),
        inputs: time.iter().map(|t| t - 8.0).collect(),
        measured: vec![0.0; time.len()],
        time,
        held: vec![false],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0],
    };
    let response = |model: &Model| {
        let (mut y, mut jacobian) = (vec![0.0; run.len()], vec![0.0; 8 * run.len()]);
        let theta = model.definition().start();
        Simulator::new(model.dynamics(), &run, 1)
            .unwrap()
            .sensitivities(&theta, &[0, 1], &mut y, &mut jacobian)
            .unwrap();
        (y, jacobian)
    };
    assert_eq!(response(&by_macro), response(&text));
}
