//! Modes of published systems to the printed digits, of delayed ones by closed forms, and their standard errors.

use fdm::Model;
use fdm::linear::{LinearModel, Mode, Modes, Values};
use num_complex::Complex64;
use support::model;

fn modes(model: &Model, theta: &[f64]) -> Modes {
    modes_of(&mut LinearModel::new(model).unwrap(), theta)
}

fn modes_of(linear: &mut LinearModel, theta: &[f64]) -> Modes {
    let mut values = Values::default();
    linear.evaluate(theta, &mut values).unwrap();
    Modes::new(linear.structure(), &values).unwrap()
}

fn at_start(model: &Model) -> Modes {
    modes(model, &model.definition().start())
}

/// The mode next to a printed eigenvalue, which it must be to half of the last printed digits.
fn printed(modes: &Modes, re: f64, im: f64, digits: (f64, f64)) -> &Mode {
    let off = |m: &&Mode| (m.s - Complex64::new(re, im)).norm();
    let found = modes.modes.iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
    let near = (found.s.re - re).abs() <= 0.5001 * digits.0 && (found.s.im - im).abs() <= 0.5001 * digits.1;
    assert!(near, "{re} {im}: {}", found.s);
    found
}

fn names<'a>(model: &'a Model, mode: &Mode) -> Vec<&'a str> {
    mode.dominant().map(|k| model.definition().states[k].quantity.name.as_str()).collect()
}

#[test]
fn the_miniature_helicopter_has_the_published_modes_of_both_columns() {
    let m = support::shipped("miniature_helicopter/model.fdm");
    let found = at_start(&m);
    assert_eq!(found.modes.len(), 11);
    let lateral = printed(&found, -3.84, 31.6, (0.01, 0.1));
    assert!(names(&m, lateral).contains(&"p") && names(&m, lateral).contains(&"b"));
    let longitudinal = printed(&found, -3.17, 16.7, (0.01, 0.1));
    assert!(names(&m, longitudinal).contains(&"q") && names(&m, longitudinal).contains(&"a"));
    printed(&found, -0.88, 0.97, (0.01, 0.01));
    let unstable = printed(&found, 0.15, 1.06, (0.01, 0.01));
    assert!(unstable.damping().unwrap() < 0.0 && unstable.time_to_double().unwrap() > 4.0);
    assert_eq!(names(&m, printed(&found, -1.13, 0.0, (0.01, 0.0))), ["w"]);
    assert_eq!(names(&m, printed(&found, -13.7, 0.0, (0.1, 0.0))), ["r"]);
    assert_eq!(names(&m, printed(&found, -2.65, 0.0, (0.01, 0.0))), ["Omega"]);

    let m = support::shipped("miniature_helicopter/time_oe.fdm");
    let found = at_start(&m);
    for (re, im, digits) in [
        (-4.00, 39.5, (0.01, 0.1)),
        (-2.57, 15.5, (0.01, 0.1)),
        (-1.35, 0.67, (0.01, 0.01)),
        (0.11, 1.01, (0.01, 0.01)),
        (-2.01, 0.0, (0.01, 0.0)),
        (-13.5, 0.0, (0.1, 0.0)),
        (-2.95, 0.0, (0.01, 0.0)),
    ] {
        printed(&found, re, im, digits);
    }
}

/// Ren and Feng: a light helicopter in hover, nine states.
const HOVER: [(&str, [f64; 9]); 9] = [
    ("u", [-0.0200, -0.0011, -0.0002, 0.0, -9.8, 0.0, -0.2255, 0.2353, 0.0]),
    ("v", [0.0012, -0.0350, -0.0198, 9.8, 0.0, 0.0, -0.2449, -0.2255, 0.0391]),
    ("w", [-0.0500, -0.0366, -0.4518, -0.0046, 0.0055, 0.0, -0.0293, 0.0015, 0.0]),
    ("phi", [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -0.0006]),
    ("theta", [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, -0.0005]),
    ("psi", [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0005, 1.0]),
    ("p", [0.0109, -0.2775, -0.1782, 0.0, 0.0, 0.0, -2.2085, -2.0295, 0.3436]),
    ("q", [0.0383, 0.0015, -0.0148, 0.0, 0.0, 0.0, 0.4267, -0.5002, 0.0031]),
    ("r", [-0.0006, 0.1260, -0.0287, 0.0, 0.0, 0.0, 0.5650, 0.0097, -0.4800]),
];

#[test]
fn the_light_helicopter_has_the_published_modes() {
    let names = HOVER.map(|(name, _)| name);
    let rate = |(name, row): &(&str, [f64; 9])| {
        let terms: Vec<String> = names.iter().zip(row).map(|(n, a)| format!("({a:?})*{n}")).collect();
        format!("der({name}) = {};", terms.join(" + "))
    };
    let rates: String = HOVER.iter().map(rate).collect();
    let m = model(&format!("model hover {{ state {}; {rates} output y = u; }}", names.join(", ")));
    let found = at_start(&m);
    assert!(found.modes.iter().any(|mode| mode.s.norm() < 1e-15 && self::names(&m, mode) == ["psi"]), "heading");
    for (re, im, digits) in [
        (-2.38, 0.0, (0.01, 0.0)),
        (-1.03, 0.0, (0.01, 0.0)),
        (-0.473, 0.0, (0.001, 0.0)),
        (-0.310, 0.0, (0.001, 0.0)),
        (0.021, 1.035, (0.001, 0.001)),
        (0.231, 0.568, (0.001, 0.001)),
    ] {
        printed(&found, re, im, digits);
    }
}

#[test]
fn units_do_not_choose_the_dominant_states() {
    let text = |k: f64| {
        format!(
            "model m {{ state a, b, c; der(a) = {}*b; der(b) = -4*a/{k:?} - 0.1*b + c; der(c) = -9*c + 0.1*b; output y = a; }}",
            k
        )
    };
    let (one, other) = (model(&text(1.0)), model(&text(1e7)));
    for (a, b) in at_start(&one).modes.iter().zip(&at_start(&other).modes) {
        assert!((a.s - b.s).norm() < 1e-12 * (1.0 + a.s.norm()), "{} {}", a.s, b.s);
        assert_eq!(names(&one, a), names(&other, b));
    }
}

/// The branch of Lambert's W that begins at a guess: w exp(w) = z.
fn lambert(z: Complex64, mut w: Complex64) -> Complex64 {
    for _ in 0..60 {
        let e = w.exp();
        w -= (w * e - z) / (e * (w + 1.0));
    }
    w
}

#[test]
fn a_delayed_state_has_the_modes_of_lambert() {
    // s = -k exp(-s tau): s tau = W_j(-k tau)
    let m = model("model m { state x; param k = 0.9, tau = 1.3; der(x) = -k*delay(x, tau); output y = x; }");
    let found = at_start(&m);
    assert!(found.infinite && found.modes.len() >= 10, "{}", found.modes.len());
    let z = Complex64::from(-0.9 * 1.3);
    let pi = std::f64::consts::PI;
    for j in 0..5 {
        let angle = 2.0 * pi * f64::from(j);
        let guess = if j == 0 { Complex64::new(0.1, 1.0) } else { z.ln() + Complex64::new(0.0, angle) };
        let guess = if j == 0 { guess } else { guess - guess.ln() };
        let s = lambert(z, guess) / 1.3;
        let mode = &found.modes[2 * j as usize];
        assert!((mode.s - s).norm() < 1e-13 * (1.0 + s.norm()), "{j}: {} {s}", mode.s);
        assert_eq!(found.modes[2 * j as usize + 1].s, mode.s.conj());
    }
    let still = modes(&m, &[0.9, 0.0]);
    assert!(!still.infinite && still.modes.len() == 1 && (still.modes[0].s.re + 0.9).abs() < 1e-15);
}

#[test]
fn delayed_feedback_of_many_states_has_exact_roots() {
    let m = model(
        "model m { state a, b, c, d; param k = 2, tau = 0.4, lag = 0.15, g = 0.5;
        der(a) = b; der(b) = -k*a - 0.3*b + g*delay(c, tau); der(c) = -3*c + delay(a, 2*lag) + d; der(d) = -g*delay(d, lag) - a; output y = a; }",
    );
    let found = at_start(&m);
    let root = |s: Complex64| {
        // by hand: (s^2 + 0.3 s + 2)(s + 3)(s + g e_lag) = g e_tau (e_2lag (s + g e_lag) - 1)
        let e = |t: f64| (-s * t).exp();
        let late = s + 0.5 * e(0.15);
        (s * s + 0.3 * s + 2.0) * (s + 3.0) * late - 0.5 * e(0.4) * (e(0.3) * late - 1.0)
    };
    for mode in &found.modes {
        let h = 1e-6 * (1.0 + mode.s.norm());
        let slope = (root(mode.s + h) - root(mode.s - h)) / (2.0 * h);
        let off = (root(mode.s) / slope).norm();
        assert!(off < 1e-12 * (1.0 + mode.s.norm()), "{}: {off}", mode.s);
    }
    assert!(found.modes.windows(2).all(|w| w[0].s.re >= w[1].s.re));
}

/// Every derivative of every eigenvalue against differences of fourth order.
fn slopes_agree(m: &Model, theta: &[f64]) {
    let mut linear = LinearModel::new(m).unwrap();
    let found = modes_of(&mut linear, theta);
    for (param, declared) in m.definition().params.iter().enumerate().filter(|(_, p)| !p.fixed) {
        let h = 1e-4 * theta[param].abs();
        let moved = [-2.0, -1.0, 1.0, 2.0].map(|k| {
            let mut theta = theta.to_vec();
            theta[param] += k * h;
            modes_of(&mut linear, &theta)
        });
        for mode in &found.modes {
            let near = |all: &Modes| {
                let off = |other: &&Mode| (other.s - mode.s).norm();
                all.modes.iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap().s
            };
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| near(&moved[k]));
            let wanted = (a - 8.0 * b + 8.0 * c - d) / (12.0 * h);
            let got = mode.slopes.as_ref().unwrap()[param];
            let allowed = 1e-7 * wanted.norm() + 1e-13 * (1.0 + mode.s.norm()) / h;
            assert!((got - wanted).norm() < allowed, "{} by {}: {got} {wanted}", mode.s, declared.quantity.name);
        }
    }
}

#[test]
fn eigenvalues_have_exact_derivatives() {
    let m = support::shipped("miniature_helicopter/model.fdm");
    slopes_agree(&m, &m.definition().start());
    let late = model(
        "model m { state a, b; param k = 2, tau = 0.4, c = 0.3; der(a) = b; der(b) = -k*a - c*delay(b, tau*c) - 0.2*delay(a, tau); output y = a; }",
    );
    slopes_agree(&late, &late.definition().start());
    let turning = std::fs::read_to_string(support::repository().join("models/goodman_ship/model.fdm")).unwrap();
    let turning =
        turning.replace("  output u_m", "  param angle = 0.3 [rad];\n  trim { rudder = angle; }\n  output u_m");
    let ship = model(&turning);
    slopes_agree(&ship, &ship.definition().start());
}

#[test]
fn standard_errors_follow_the_covariance() {
    let m = model("model m { state x, v; param w = 3, z = 0.2; der(x) = v; der(v) = -w^2*x - 2*z*w*v; output y = x; }");
    let found = at_start(&m);
    let covariance = [[0.04, 0.003], [0.003, 0.0025]];
    let errors = found.modes[0].errors(|i, j| covariance[i][j]).unwrap();
    assert!((errors.frequency - 0.2).abs() < 1e-14 && (errors.damping - 0.05).abs() < 1e-14, "{errors:?}");
    // re = -z w
    let re = (0.2_f64.powi(2) * 0.04 + 9.0 * 0.0025 + 2.0 * 0.2 * 3.0 * 0.003_f64).sqrt();
    assert!((errors.re - re).abs() < 1e-14);
    let double = model("model m { state x, v; param a = 1; der(x) = v - a*x; der(v) = -a*v; output y = x; }");
    assert!(at_start(&double).modes.iter().all(|m| (m.s.re + 1.0).abs() < 1e-7 && m.slopes.is_none()));
}

fn fdm(words: &[&str], folder: &std::path::Path) -> std::process::Output {
    let mut command = support::fdm();
    command.args(words).current_dir(folder).output().unwrap()
}

fn json(words: &[&str], folder: &std::path::Path) -> serde_json::Value {
    let output = fdm(words, folder);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn the_command_line_prints_modes_as_table_and_json() {
    let here = support::repository();
    let found = json(&["modes", "models/miniature_helicopter/model.fdm", "--json", "--set", "Zw=-2.5"], here);
    let all = found["modes"].as_array().unwrap();
    assert_eq!(all.len(), 11);
    for mode in all {
        assert!(["re", "im", "damping", "frequency"].iter().all(|k| mode[k].is_f64()), "{mode}");
        assert!(!mode["states"].as_array().unwrap().is_empty());
    }
    let heave = all.iter().find(|m| m["states"] == serde_json::json!(["w"])).unwrap();
    assert!((heave["re"].as_f64().unwrap() + 2.5).abs() < 1e-12);
    let table = fdm(&["modes", "models/goodman_ship/model.fdm"], here);
    let table = String::from_utf8(table.stdout).unwrap();
    assert!(table.contains("frequency [rad/s]") && table.contains("linearised at the initial values"), "{table}");

    let folder = tempfile::tempdir().unwrap();
    let wrong = |text: &str, words: &[&str]| {
        std::fs::write(folder.path().join("m.fdm"), text).unwrap();
        let output = fdm(&[&["modes", "m.fdm"], words].concat(), folder.path());
        assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0));
        String::from_utf8(output.stderr).unwrap()
    };
    let said = wrong("model m { input u; param a = 1; output y = a*u; }", &[]);
    assert_eq!(said, "error: the model has no states, and so no modes\n");
    let said = wrong("model m { state x; param a = 1; der(x) = a + x^2; output y = x; }", &[]);
    assert!(said.contains("the rate of `x` cannot be made zero"), "{said}");
    let late =
        "model m { state x; param a = 1, tau = 1 in [-1, 2]; der(x) = -a*delay(x, tau*tau - 0.5); output y = x; }";
    assert!(wrong(late, &["--set", "tau=0.1"]).contains("a delay of a state is negative"));
    assert!(wrong(late, &["--set", "nothing=1"]).contains("nothing"));
}

#[test]
fn modes_of_a_result_have_its_standard_errors() {
    let folder = tempfile::tempdir().unwrap();
    let text = "model m { input u; state x = free; param k = 1 in [0, 9] [1/s], g = 2 fixed [1/s], bias = 0 per run; \
                der(x) = g*u - k*x; output y = x + bias; }";
    std::fs::write(folder.path().join("m.fdm"), text).unwrap();
    for (name, phase) in [("one", 0.0), ("two", 1.0)] {
        let mut record = String::from("t [s], u, y\n");
        let (mut x, mut noise) = (0.3_f64, 0x2545_F491_u32);
        for k in 0..200 {
            let t = f64::from(k) * 0.05;
            let u = (1.7 * t + phase).sin();
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            record.push_str(&format!("{t},{u},{}\n", x + 0.02 * (f64::from(noise >> 8) / 16_777_216.0 - 0.5)));
            x += 0.05 * (2.0 * u - 1.5 * x);
        }
        std::fs::write(folder.path().join(format!("{name}.csv")), record).unwrap();
    }
    let fit = ["fit", "m.fdm", "--data", "one.csv", "--data", "two.csv", "--free", "g", "--out", "result", "--json"];
    let fitted = json(&fit, folder.path());
    let k = fitted["parameters"].as_array().unwrap().iter().find(|p| p["name"] == "k").unwrap();
    let found = json(&["modes", "--from-result", "result", "--json"], folder.path());
    let mode = &found["modes"][0];
    assert_eq!(mode["re"].as_f64().unwrap(), -k["value"].as_f64().unwrap());
    let error = k["corrected_error"].as_f64().unwrap_or_else(|| k["standard_error"].as_f64().unwrap());
    let got = mode["standard_errors"]["re"].as_f64().unwrap();
    assert!((got / error - 1.0).abs() < 1e-9, "{got} {error}");
    assert_eq!(mode["standard_errors"]["im"], 0.0);
    let table = fdm(&["modes", "m.fdm", "--from-result", "result"], folder.path());
    assert!(String::from_utf8(table.stdout).unwrap().contains("standard error"));
}
