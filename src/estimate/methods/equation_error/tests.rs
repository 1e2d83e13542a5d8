//! Known parameters found again from simulated records; refusals; structures.

use super::*;
use fdm_numeric::random::Normal;
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::Simulator;
use fdm_system::spectrum::Frequencies;

const SHIP: &str = "model ship { input d; state v, r, phi; \
    param a = -0.5, b = 0.8, c = -0.4, e = -0.9, f = 1.2, g = 0.6; \
    der(v) = a*v + b*r + c*v*abs(v); der(r) = e*r + f*d + g*v; der(phi) = r; \
    output v_m = v, r_m = r, phi_m = phi; }";
const TRUTH: [(&str, f64); 6] = [("a", -0.5), ("b", 0.8), ("c", -0.4), ("e", -0.9), ("f", 1.2), ("g", 0.6)];

fn model(text: &str) -> Model {
    Model::from_text("m.fdm", text).unwrap_or_else(|e| panic!("{e}"))
}

/// A record of the model at its start values, driven by a sweep and steps, with noise on every output.
fn record(model: &Model, samples: usize, dt: f64, noise: f64, seed: u64) -> Run {
    let layout = model.layout();
    let (m, q) = (layout.inputs, layout.outputs);
    let time: Vec<f64> = (0..samples).map(|k| dt * k as f64).collect();
    let input = |k: usize, t: f64| {
        let (t, k) = (t + seed as f64 % 7.0, k as f64);
        ((0.4 + 0.03 * t) * t + k).sin() + 0.5 * ((0.9 + 0.2 * k) * t).cos() + 0.3
    };
    let inputs = time.iter().flat_map(|t| (0..m).map(move |k| input(k, *t))).collect();
    let mut run = Run {
        name: format!("r{seed}"),
        time,
        inputs,
        held: vec![false; m],
        measured: vec![f64::NAN; samples * q],
        input_gaps: vec![0; m],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    };
    let mut y = vec![0.0; samples * q];
    Simulator::new(model.dynamics(), &run, 4).unwrap().simulate(&model.definition().start(), &mut y).unwrap();
    let mut normal = Normal(seed);
    run.measured = y.iter().map(|y| y + noise * normal.next()).collect();
    run
}

fn band(lowest: f64, highest: f64, spacing: f64) -> RegressionOptions {
    let choice = Frequencies::Band { lowest, highest, spacing: Some(spacing) };
    RegressionOptions { domain: Domain::Frequency(choice), ..Default::default() }
}

fn parameters(r: &Regression) -> Vec<&Regressed> {
    r.fits.iter().flat_map(|f| &f.parameters).collect()
}

#[track_caller]
fn near(found: &Regression, truth: &[(&str, f64)], tolerance: f64) {
    let all = parameters(found);
    assert_eq!(all.len(), truth.len());
    for (name, value) in truth {
        let p = all.iter().find(|p| p.name == *name).unwrap_or_else(|| panic!("{name} is missing"));
        assert!((p.value - value).abs() <= tolerance * value.abs(), "{name}: {} instead of {value}", p.value);
    }
}

#[test]
fn exact_records_give_the_parameters_back_in_both_domains() {
    let model = model(SHIP);
    let run = record(&model, 1200, 0.025, 0.0, 1);
    let time = regress(&model, std::slice::from_ref(&run), &RegressionOptions::default()).unwrap();
    // inputs have kinks at the samples, which cost a smooth polynomial (w dt)^2/12
    near(&time, &TRUTH, 2e-4);
    assert!(time.fits.iter().all(|f| f.equations[0].r_squared > 0.999_999 && f.reason == Chosen::All));
    assert_eq!((time.fits.len(), time.kept.len(), time.refused.len()), (2, 0, 0));
    let frequency = regress(&model, std::slice::from_ref(&run), &band(0.05, 1.0, 0.02)).unwrap();
    near(&frequency, &TRUTH, 1e-3);
    assert!(parameters(&frequency).iter().all(|p| p.coloured_error.is_none()));
    let fourier = RegressionOptions { smoothing: Smoothing::Fixed { cutoff: 5.0 }, ..Default::default() };
    near(&regress(&model, &[run], &fourier).unwrap(), &TRUTH, 0.02);
}

#[test]
fn noisy_records_give_them_within_their_errors() {
    let model = model(SHIP);
    let runs = [record(&model, 1500, 0.02, 2e-3, 2), record(&model, 1500, 0.02, 2e-3, 3)];
    let optimal = RegressionOptions { smoothing: Smoothing::Optimal, ..Default::default() };
    for options in [RegressionOptions::default(), optimal, band(0.05, 0.8, 0.03)] {
        let found = regress(&model, &runs, &options).unwrap();
        for (name, value) in TRUTH {
            let p = *parameters(&found).iter().find(|p| p.name == name).unwrap();
            let error = p.coloured_error.map_or(p.standard_error, |c| c.max(p.standard_error));
            let off = (p.value - value).abs();
            assert!(off < 4.0 * error + 0.01 * value.abs(), "{options:?}: {name} {} +- {error}", p.value);
            assert!(error < 0.1 * value.abs(), "{options:?}: {name} +- {error}");
            assert!(p.significance > 0.02 && p.significance < 5.0, "{name}: {}", p.significance);
        }
        for noise in &found.noise {
            assert!((noise.deviation / 2e-3 - 1.0).abs() < 0.15, "{noise:?}");
        }
        assert_eq!(found.noise.len(), if options.smoothing == Smoothing::Optimal { 6 } else { 0 });
    }
}

#[test]
fn shared_and_derived_parameters_make_one_problem() {
    let model = model(
        "model m { input u; state x, z; param a = -0.6, k = 0.8, s = 2 fixed; param b = 1 - 2*a; \
         param bias = 0.2 per run; \
         der(x) = a*x + s*k*u + bias; der(z) = b*x - z*s + 100*k*u*abs(x); output x_m = 2*x - s, z_m = z; }",
    );
    let runs = [record(&model, 900, 0.02, 0.0, 4), record(&model, 900, 0.02, 0.0, 5)];
    let found = regress(&model, &runs, &RegressionOptions::default()).unwrap();
    assert_eq!(found.fits.len(), 1);
    assert_eq!(found.fits[0].equations.iter().map(|e| e.equation.as_str()).collect::<Vec<_>>(), ["der(x)", "der(z)"]);
    let values: Vec<_> = parameters(&found).iter().map(|p| (p.name.clone(), p.run.clone(), p.value)).collect();
    let wanted = [("a", None, -0.6), ("k", None, 0.8), ("bias", Some("r4"), 0.2), ("bias", Some("r5"), 0.2)];
    assert_eq!(values.len(), wanted.len());
    for ((name, run, value), (n, r, v)) in values.iter().zip(wanted) {
        assert_eq!((name.as_str(), run.as_deref()), (n, r));
        assert!((value - v).abs() < 1e-3, "{name}: {value}");
    }
    // a constant has no part at frequencies above zero
    let frequency = regress(&model, &runs, &band(0.1, 1.0, 0.06)).unwrap();
    assert_eq!(frequency.fits[0].not_identifiable, ["bias (r4)", "bias (r5)"]);
    assert_eq!(frequency.kept, ["bias"]);
    // a mean that is taken off takes the bias along, and nothing else
    let mean = RegressionOptions { detrend: Detrend::Mean, ..Default::default() };
    let found = regress(&model, &runs, &mean).unwrap();
    assert!((parameters(&found)[0].value + 0.6).abs() < 1e-3);
}

#[test]
fn what_is_no_regression_is_refused_for_itself() {
    let text = "model m { input u; state v, w, x, z, y; param a = -1, b = 2, c = 0.5, v0 = 3, tau = 0.2, k = 1; \
        der(v) = a*v + u; der(w) = -b*tanh(w/v0); der(x) = -x*a*b + k*u; der(y) = k*y + z; \
        der(z) = c*delay(u, tau) - z; output v_m = v, w_m = w, x_m = x, z_m = z^2, y_m = y; }";
    let model = model(text);
    let run = record(&model, 300, 0.05, 0.0, 6);
    let found = regress(&model, std::slice::from_ref(&run), &RegressionOptions::default()).unwrap();
    assert_eq!(parameters(&found).iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["a"]);
    assert_eq!(found.kept, ["b", "c", "v0", "tau", "k"]);
    let said: Vec<String> = found.refused.iter().map(ToString::to_string).collect();
    let wanted = [
        "`der(w)` is not linear in its parameters: `v0` inside the term `tanh(w/v0)`; fix it to estimate the rest",
        "`der(x)` is not linear in its parameters: the factor `-a*b` of `x`; fix all but one",
        "`der(z)`: no output shows the state `z`, so that its rate is not known",
        "`der(y)`: the state `z` in the term `z` is not shown by any output",
    ];
    for w in wanted {
        assert!(said.iter().any(|s| s.starts_with(w)), "{said:#?}");
    }
    let scaled = text.replace("z_m = z^2", "z_m = k*z + 2");
    let refused =
        regress(&self::model(&scaled), std::slice::from_ref(&run), &RegressionOptions::default()).unwrap().refused;
    let why = "since `z_m` shows the state `z` only together with `k`, which is to be estimated";
    for w in [format!("`der(z)`: its rate is not known, {why}"), format!("`der(y)`: the term `z` is not known, {why}")]
    {
        assert!(refused.iter().any(|r| r.to_string() == w), "{refused:#?}");
    }
    let delayed = text.replace("z_m = z^2", "z_m = z");
    let found = regress(&self::model(&delayed), std::slice::from_ref(&run), &RegressionOptions::default()).unwrap();
    assert!(found.refused.iter().any(|r| r.to_string().contains("is delayed by `tau`")), "{:?}", found.refused);
    let none = self::model("model m { state x; param a = 1; der(x) = sin(a*x); output x_m = x; }");
    let run = record(&none, 50, 0.1, 0.0, 7);
    let error = regress(&none, std::slice::from_ref(&run), &RegressionOptions::default()).unwrap_err().to_string();
    assert!(error.starts_with("no equation of the model is a regression:\n`der(x)`"), "{error}");
    assert_eq!(regress(&none, &[], &RegressionOptions::default()).unwrap_err(), RegressionError::NoRuns);
    let linear = self::model("model m { input u; state x; param a = -1, b = 1; der(x) = a*x + b*u; output x_m = x; }");
    let run = record(&linear, 300, 0.1, 0.0, 7);
    let wide = regress(&linear, std::slice::from_ref(&run), &band(0.1, 6.0, 0.1)).unwrap_err().to_string();
    assert!(wide.contains("Nyquist"), "{wide}");
    let few = regress(&linear, std::slice::from_ref(&run), &band(0.1, 0.1, 0.1)).unwrap_err().to_string();
    assert!(few.contains("too few"), "{few}");
    let window = RegressionOptions { smoothing: Smoothing::Local { points: 4 }, ..Default::default() };
    assert_eq!(regress(&linear, &[run], &window).unwrap_err(), RegressionError::Window(4));
}

#[test]
fn columns_that_move_together_take_fewer_components() {
    // two inputs that the pilot moves together
    let model = model(
        "model m { input u, w; state x; param a = -0.8, b = 0.7, c = 0.7; der(x) = a*x + b*u + c*w; output x_m = x; }",
    );
    let mut run = record(&model, 800, 0.05, 0.0, 8);
    let mut normal = Normal(9);
    for row in run.inputs.chunks_mut(2) {
        row[1] = row[0] + 1e-3 * normal.next();
    }
    let mut y = vec![0.0; 800];
    Simulator::new(model.dynamics(), &run, 4).unwrap().simulate(&model.definition().start(), &mut y).unwrap();
    run.measured = y.iter().map(|y| y + 2e-3 * normal.next()).collect();
    let found = regress(&model, std::slice::from_ref(&run), &RegressionOptions::default()).unwrap();
    let fit = &found.fits[0];
    assert_eq!((fit.chosen, fit.components.len()), (2, 3));
    assert_eq!(fit.reason, Chosen::Collinear(vec![vec!["b".into(), "c".into()]]));
    near(&found, &[("a", -0.8), ("b", 0.7), ("c", 0.7)], 0.03);
    let full = &fit.components[2];
    assert!(full.standard_errors[1] > 20.0 * fit.components[1].standard_errors[1]);
    assert!(full.r_squared - fit.components[1].r_squared < 0.005);
    // the same columns without noise: the small difference of the inputs is seen, and nothing is left out
    run.measured = y;
    let exact = regress(&model, std::slice::from_ref(&run), &RegressionOptions::default()).unwrap();
    assert_eq!((exact.fits[0].chosen, &exact.fits[0].reason), (3, &Chosen::All));
    // one more column that is the sum of others has no component at all
    let twice = self::model(
        "model m { input u, w; state x; param a = -0.8, b = 0.7, c = 0.7, e = 0; \
         der(x) = a*x + b*u + c*w + e*(u + w); output x_m = x; }",
    );
    let found = regress(&twice, std::slice::from_ref(&run), &RegressionOptions::default()).unwrap();
    assert_eq!(found.fits[0].components.len(), 3, "of four columns");
    let asked = RegressionOptions { components: Components::Count(4), ..Default::default() };
    let found = regress(&twice, &[run], &asked).unwrap();
    assert_eq!((found.fits[0].chosen, &found.fits[0].reason), (3, &Chosen::Asked));
}

#[test]
fn the_structure_of_a_rate_is_found_among_its_candidates() {
    let model = model(SHIP);
    let runs = [record(&model, 2000, 0.02, 5e-4, 10), record(&model, 2000, 0.02, 5e-4, 11)];
    let limits = Limits::default();
    for options in [RegressionOptions { smoothing: Smoothing::Optimal, ..Default::default() }, band(0.05, 0.8, 0.025)] {
        let found = structure(&model, &runs, &options, &Search::Stepwise(limits)).unwrap();
        let names = |k: usize| found[k].found.terms.iter().map(|t| t.candidate.as_str()).collect::<Vec<_>>();
        assert_eq!(names(1), ["v", "r", "d"], "{:#?}", found[1].found.steps);
        assert_eq!(found[1].found.constant.is_some(), options.domain == Domain::Time);
        assert_eq!(names(2), ["r"]);
        assert!(found[1].found.steps.windows(2).all(|w| w[1].r_squared > w[0].r_squared || !w[1].entered));
        assert_eq!(found[1].found.outside.len() + 3, 4 + 4 + 10);
    }
}

#[test]
fn ten_candidates_of_which_three_are_true() {
    let mut normal = Normal(12);
    let candidates: Vec<(String, Vec<f64>)> =
        (0..10).map(|k| (format!("c{k}"), (0..400).map(|_| normal.next() + k as f64).collect())).collect();
    let left: Vec<f64> = (0..400)
        .map(|i| 2.0 * candidates[1].1[i] - candidates[4].1[i] + 0.5 * candidates[7].1[i] + 3.0 + 0.3 * normal.next())
        .collect();
    let found = stepwise(&left, &candidates, true, &Limits::default());
    let terms: Vec<_> = found.terms.iter().map(|t| t.candidate.as_str()).collect();
    assert_eq!(terms, ["c1", "c4", "c7"]);
    for (term, value) in found.terms.iter().zip([2.0, -1.0, 0.5]) {
        assert!((term.value - value).abs() < 4.0 * term.standard_error, "{term:?}");
    }
    assert!((found.constant.unwrap() - 3.0).abs() < 0.5);
    assert!(found.steps.windows(2).all(|w| w[1].pse < w[0].pse && w[1].press < w[0].press));
    // a candidate that stood in for two others goes when they have come
    let mut with_sum = candidates.clone();
    let sum = (0..400).map(|i| 2.0 * candidates[1].1[i] - candidates[4].1[i] + normal.next()).collect();
    with_sum[0] = ("sum".into(), sum);
    let found = stepwise(&left, &with_sum, true, &Limits::default());
    assert!(found.steps[0].candidate == "sum" && found.steps.iter().any(|s| s.candidate == "sum" && !s.entered));
    assert_eq!(found.terms.iter().map(|t| t.candidate.as_str()).collect::<Vec<_>>(), ["c1", "c4", "c7"]);
    let noise: Vec<f64> = (0..400).map(|_| normal.next()).collect();
    let nothing = stepwise(&noise, &candidates, true, &Limits::default());
    assert!(nothing.terms.is_empty() && nothing.steps.is_empty());
    assert!(stepwise(&[], &[], true, &Limits::default()).terms.is_empty());
}

#[test]
fn tables_over_cut_off_and_length() {
    let model = model(SHIP);
    let runs = [record(&model, 1200, 0.025, 1e-3, 13)];
    let by = by_cutoff(&model, &runs, &band(0.05, 1.0, 0.03), &[0.3, 0.6, 0.9, 40.0]);
    assert_eq!(by.iter().map(|d| d.parameters.len()).collect::<Vec<_>>(), [6, 6, 6, 0]);
    assert!(by[3].reason.as_ref().unwrap().contains("Nyquist"));
    let by = by_length(&model, &runs, &RegressionOptions::default(), &[0.0, 0.25, 0.5, 1.0]);
    assert_eq!(by.iter().map(|d| d.parameters.len()).collect::<Vec<_>>(), [0, 6, 6, 6]);
    let error = |k: usize| by[k].parameters[0].standard_error;
    assert!(error(1) > error(2) && error(2) > error(3));
    let time = by_cutoff(&model, &runs, &RegressionOptions::default(), &[1.0, 3.0]);
    assert!(time.iter().all(|d| d.parameters.len() == 6));
}

#[test]
fn gaps_are_left_out_and_do_not_bend_the_rest() {
    let model = model(SHIP);
    let mut run = record(&model, 1200, 0.025, 0.0, 14);
    for k in [100, 101, 400, 777] {
        run.measured[3 * k] = f64::NAN;
    }
    let found = regress(&model, &[run], &RegressionOptions::default()).unwrap();
    near(&found, &TRUTH, 2e-4);
    assert!(found.fits.iter().all(|f| f.rows == 1196));
}

/// A short period whose sensors have biases, and an accelerometer beside them.
const SENSORS: &str = "model sensors { input d; state a, q; param Za = -0.8, Zd = -0.1, Ma = -4, Mq = -1.2, Md = -6; \
    param ba = BIAS, bq = BIAS per run, bz = 0.3; const V = 60; \
    der(a) = q + Za*a + Zd*d; der(q) = Ma*a + Mq*q + Md*d; \
    output a_m = 2*(a + ba), q_m = q + bq, az = V*(Za*a + Zd*d) + bz; }";

/// Biases of sensors are constants of the equations, and accelerations tell of the parameters in them: the numbers are those of least
/// squares on the columns that Klein and Morelli write down.
#[test]
fn biases_of_outputs_are_constants_of_equations_and_outputs_are_equations() {
    let truth = model(&SENSORS.replace("BIAS", "0.05"));
    let runs = [record(&truth, 1200, 0.02, 0.0, 8), record(&truth, 1200, 0.02, 0.0, 9)];
    let model = model(&SENSORS.replace("BIAS", "0"));
    let found = regress(&model, &runs, &RegressionOptions::default()).unwrap();
    assert!(found.refused.is_empty() && found.kept == ["ba", "bq"], "{:?} {:?}", found.refused, found.kept);
    let names = |fit: &EquationErrorFit| fit.equations.iter().map(|e| e.equation.clone()).collect::<Vec<_>>();
    let [first, second] = &found.fits[..] else { panic!("{:?}", found.fits.iter().map(names).collect::<Vec<_>>()) };
    assert_eq!((names(first), names(second)), (vec!["der(a)".to_string(), "az".into()], vec!["der(q)".to_string()]));
    let near = |p: &Regressed, value: f64| assert!((p.value - value).abs() < 2e-3 * value.abs(), "{p:?} for {value}");
    let of = |fit: &EquationErrorFit, name: &str| fit.parameters.iter().find(|p| p.name == name).cloned().unwrap();
    for (name, value) in [("Za", -0.8), ("Zd", -0.1), ("bz", 0.3 + 60.0 * 0.8 * 0.05)] {
        near(&of(first, name), value);
    }
    for (name, value) in [("Ma", -4.0), ("Mq", -1.2), ("Md", -6.0)] {
        near(&of(second, name), value);
    }
    // one of each run, as the biases of its signals are: -(Ma ba + Mq bq)
    let biases: Vec<(&str, Option<&str>)> = second.biases.iter().map(|b| (b.name.as_str(), b.run.as_deref())).collect();
    assert_eq!(biases, [("bias of der(q)", Some("r8")), ("bias of der(q)", Some("r9"))]);
    second.biases.iter().for_each(|b| near(b, (4.0 + 1.2) * 0.05));
    assert_eq!(second.components[second.chosen - 1].values.len(), 5, "three parameters, two biases");
    // q + Za a in the rate: -(bq + Za ba)
    first.biases.iter().for_each(|b| near(b, -(0.05 - 0.8 * 0.05)));
    // in the frequency domain constants have no part, and nothing is said of them
    let frequency = regress(&model, &runs, &band(0.05, 1.0, 0.02)).unwrap();
    assert!(frequency.fits.iter().all(|f| f.biases.is_empty()));
    assert_eq!(frequency.fits[0].not_identifiable, ["bz"]);
    near(&of(&frequency.fits[1], "Ma"), -4.0);
}

#[test]
fn courses_are_what_was_measured_and_what_is_explained() {
    let model = model(SHIP);
    let mut run = record(&model, 600, 0.025, 0.0, 1);
    run.measured[3 * 100] = f64::NAN;
    let runs = [run];
    let found = regress(&model, &runs, &RegressionOptions::default()).unwrap();
    assert_eq!(found.courses.iter().map(|c| c.equation.as_str()).collect::<Vec<_>>(), ["der(v)", "der(r)"]);
    let quality = found.quality(&model, &runs);
    for (course, (fit, quality)) in found.courses.iter().zip(found.fits.iter().zip(&quality)) {
        let Along::Time { measured, explained } = &course.along else { panic!("in time") };
        assert!(measured.len() == 600 && measured[100].is_nan() && explained[100].is_nan());
        let squares: f64 =
            measured.iter().zip(explained).map(|(z, y)| z - y).filter(|v| v.is_finite()).map(|v| v * v).sum();
        let rms = (squares / fit.rows as f64).sqrt();
        assert!((rms / fit.equations[0].rms - 1.0).abs() < 1e-9);
        assert!((quality.fit.rms.unwrap() / rms - 1.0).abs() < 1e-9 && quality.fit.compared == fit.rows);
    }
    let found = regress(&model, &runs, &band(0.1, 1.0, 0.02)).unwrap();
    let Along::Frequency { frequency, measured, explained } = &found.courses[0].along else { panic!("frequencies") };
    assert!(
        (frequency[0] - 0.1).abs() < 1e-9 && measured.len() == 2 * frequency.len() && explained.len() == measured.len()
    );
    assert!(found.quality(&model, &runs).is_empty());
}

/// The true terms of a polynomial in the order of what they explain, and no other, in a small part of a second.
#[test]
fn orthogonal_functions_find_a_polynomial_among_a_hundred_products() {
    let mut normal = Normal(5);
    let n = 2000;
    let series = |f: f64| {
        (0..n)
            .map(|k| (f * 0.01 * f64::from(k)).sin() + 0.3 * (0.7 * f * 0.013 * f64::from(k)).cos())
            .collect::<Vec<f64>>()
    };
    let signals: Vec<(String, Vec<f64>)> = [("a", 1.0), ("b", 2.3), ("c", 4.1), ("d", 6.7), ("e", 9.3)]
        .map(|(name, f)| (name.to_string(), series(f)))
        .into();
    let at = |s: usize, k: usize| signals[s].1[k];
    let truth = |k: usize| 1.0 + 2.0 * at(0, k) - 0.8 * at(0, k) * at(1, k) + 0.4 * at(2, k).powi(3);
    let left: Vec<f64> = (0..n as usize).map(|k| truth(k) + 0.02 * normal.next()).collect();
    let all = structure::products(&signals, 3);
    assert_eq!(all.len(), 55, "8 over 3, less the constant");
    let found = orthogonal(&left, &all, true);
    let terms: Vec<&str> = found.terms.iter().map(|t| t.candidate.as_str()).collect();
    assert_eq!(terms, ["a", "a*b", "c^3"]);
    for (term, value) in found.terms.iter().zip([2.0, -0.8, 0.4]) {
        assert!((term.value - value).abs() < 4.0 * term.standard_error && term.standard_error < 0.01, "{term:?}");
    }
    assert!((found.constant.unwrap() - 1.0).abs() < 0.01);
    assert!(found.steps.windows(2).all(|s| s[1].pse < s[0].pse));
    assert!(found.steps.iter().all(|s| s.partial_f > 20.0));
}
