//! Requirements against closed forms, and every derivative against central differences.

use super::{Bench, By, Draws, Known, Plan, assess};
use fdm_system::Model;

fn model(text: &str) -> Model {
    Model::from_text("test.fdm", text).unwrap_or_else(|e| panic!("{e}"))
}

fn columns(model: &Model) -> Vec<usize> {
    let params = model.definition().params.iter().enumerate();
    params.filter(|(_, p)| !p.fixed && !p.is_recorded()).map(|(k, _)| k).collect()
}

/// Values by name, after every derivative was compared with a central difference.
fn measured(text: &str) -> Vec<(String, f64)> {
    let model = model(text);
    let theta = model.definition().start();
    let columns = columns(&model);
    let plan = Plan::new(&model, &theta, &columns).unwrap().expect("there are requirements");
    let mut bench = plan.bench().unwrap();
    let at = bench.measure(&theta, true);
    for (c, k) in columns.iter().enumerate() {
        let step = 2e-5 * theta[*k].abs().max(0.1);
        let mut side = |sign: f64| {
            let mut moved = theta.clone();
            moved[*k] += sign * step;
            bench.measure(&moved, false).iter().map(|m| m.value).collect::<Vec<f64>>()
        };
        let (above, below) = (side(1.0), side(-1.0));
        for (i, m) in at.iter().enumerate() {
            let name = &plan.requirements().list[i].quantity.name;
            let difference = (above[i] - below[i]) / (2.0 * step);
            let size =
                m.gradient.iter().zip(&columns).map(|(g, k)| (g * theta[*k].abs().max(0.1)).abs()).fold(0.0, f64::max);
            let scale = (size + 1e-9 * m.value.abs()) / theta[*k].abs().max(0.1);
            let off = (m.gradient[c] - difference).abs();
            assert!(off <= 2e-5 * scale + 1e-9, "{name} by parameter {k}: {} and {difference}", m.gradient[c]);
        }
    }
    let list = &plan.requirements().list;
    list.iter().zip(&at).map(|(r, m)| (r.quantity.name.clone(), m.value)).collect()
}

fn near(found: &[(String, f64)], name: &str, expected: f64, tolerance: f64) {
    let (_, value) = found.iter().find(|(n, _)| n == name).unwrap_or_else(|| panic!("no {name}"));
    assert!((value - expected).abs() <= tolerance * expected.abs().max(1.0), "{name}: {value}, not {expected}");
}

#[test]
fn an_oscillator_has_the_figures_of_its_closed_form() {
    let found = measured(
        "model m { input u; state x, v; param w = 2, z = 0.4, k = 3; const T = 12;
        der(x) = v; der(v) = k*u - 2*z*w*v - w^2*x; output y = x, a = der(v);
        requirement frequency = mode_frequency(v), damping = mode_damping(x), half = time_to_half(x), re = mode_real(x);
        requirement k_v = coefficient(v, u), stiffness = -coefficient(v, x), steady_y = steady(y, u);
        requirement g = gain(y, u, 2), lag = phase(y, u, 2), over = overshoot(y, T, step(u, 1)), top = maximum(y, T, step(u, 1));
        requirement end = at(y, T, step(u, 1)), first = when(y, 0.5, T, step(u, 1)), v_there = reached(v, y, 0.5, T, step(u, 1));
        requirement area = integral(v, T, step(u, 2)), bottom = minimum(y, T, pulse(u, 1, 2)), swing = maximum(v, T, doublet(u, 1, 1));
        requirement rise = rise_time(y, T, step(u, 1)), settled = settling_time(y, T, step(u, 1)), own = 2*w + mode_damping(x)^2;
        }",
    );
    let (w, z, k) = (2.0f64, 0.4f64, 3.0f64);
    let wd = w * (1.0 - z * z).sqrt();
    near(&found, "frequency", w, 1e-12);
    near(&found, "damping", z, 1e-12);
    near(&found, "re", -z * w, 1e-12);
    near(&found, "half", 2f64.ln() / (z * w), 1e-12);
    near(&found, "k_v", k, 1e-12);
    near(&found, "stiffness", w * w, 1e-12);
    near(&found, "steady_y", k / (w * w), 1e-12);
    near(&found, "g", k / (2.0 * z * w * w), 1e-12);
    near(&found, "lag", -90.0, 1e-12);
    let peak = (-std::f64::consts::PI * z / (1.0 - z * z).sqrt()).exp();
    near(&found, "top", k / (w * w) * (1.0 + peak), 1e-6);
    let y = |t: f64| k / (w * w) * (1.0 - (-z * w * t).exp() * ((wd * t).cos() + z * w / wd * (wd * t).sin()));
    near(&found, "end", y(12.0), 1e-6);
    near(&found, "over", (k / (w * w) * (1.0 + peak) - y(12.0)) / y(12.0), 1e-5);
    // the jump of the input takes a millionth of the manoeuvre
    near(&found, "area", 2.0 * y(12.0), 1e-5);
    let (mut a, mut b) = (0.0, 1.5);
    for _ in 0..100 {
        let t: f64 = 0.5 * (a + b);
        if y(t) < 0.5 { a = t } else { b = t }
    }
    near(&found, "first", a, 2e-5);
    near(&found, "own", 2.0 * w + z * z, 1e-12);
}

#[test]
fn a_delayed_response_has_the_bandwidth_and_margins_of_its_formula() {
    let text = "model m { input u [rad]; state q [rad/s], theta [rad]; param M = -3 [1/s], K = 4 [1/s^2], tau = 0.12 in [0, 1] [s];
        der(q) = M*q + K*delay(u, tau); der(theta) = q; output th [rad] = theta;
        requirement turns = steady(q, u), wide [rad/s] = bandwidth(th, u), by_phase [rad/s] = phase_bandwidth(th, u), by_gain [rad/s] = gain_bandwidth(th, u);
        requirement late [s] = phase_delay(th, u) in [0, 0.2], gm = gain_margin(th, u), pm [deg] = phase_margin(th, u), wc [rad/s] = crossover(th, u); }";
    let found = measured(text);
    let phase = |w: f64| -90.0 - (w / 3.0).atan().to_degrees() - (0.12 * w).to_degrees();
    let gain = |w: f64| 4.0 / (w * w.hypot(3.0));
    let root = |of: &dyn Fn(f64) -> f64| {
        let (mut a, mut b) = (0.01, 100.0);
        for _ in 0..200 {
            let w: f64 = 0.5 * (a + b);
            if of(w) > 0.0 { a = w } else { b = w }
        }
        a
    };
    let w135 = root(&|w| phase(w) + 135.0);
    let w180 = root(&|w| phase(w) + 180.0);
    let w6 = root(&|w| gain(w) - 10f64.powf(0.3) * gain(w180));
    let wc = root(&|w| gain(w) - 1.0);
    // the attitude integrates, the rate does not see it
    near(&found, "turns", 4.0 / 3.0, 1e-12);
    near(&found, "by_phase", w135, 1e-9);
    near(&found, "by_gain", w6, 1e-9);
    near(&found, "wide", w135.min(w6), 1e-9);
    near(&found, "late", (-180.0 - phase(2.0 * w180)).to_radians() / (2.0 * w180), 1e-9);
    near(&found, "gm", -20.0 * gain(w180).log10(), 1e-9);
    near(&found, "wc", wc, 1e-9);
    near(&found, "pm", 180.0 + phase(wc), 1e-9);
}

#[test]
fn a_ship_turns_and_zigzags_as_its_equations_say() {
    // Nomoto's first-order model: r' = (K delta - r)/T
    let found = measured(
        "model ship { time [s]; input rudder [deg]; state r [deg/s], psi [deg], x [m], y [m]; const U = 6 [m/s];
        param K = 0.06 [1/s], T = 12 [s];
        der(r) = (K*rudder - r)/T; der(psi) = r; der(x) = U*cos(deg2rad(psi)); der(y) = U*sin(deg2rad(psi));
        output heading [deg] = psi; trim { psi = 0; r = 0; x = 0; y = 0; rudder = 0; }
        requirement advance [m] = reached(x, psi, 90, 200, step(rudder, 35)), diameter [m] = reached(y, psi, 180, 200, step(rudder, 35));
        requirement first [deg] = zigzag_overshoot(heading, rudder, 10, 10, 1, 200), second [deg] = zigzag_overshoot(heading, rudder, 10, 10, 2, 200); }",
    );
    let (k, t) = (0.06f64, 12.0f64);
    // advance and diameter by the closed course of the heading and Simpson's rule
    let psi = |s: f64| k * 35.0 * (s - t * (1.0 - (-s / t).exp()));
    let until = |to: f64| {
        let (mut a, mut b) = (0.0, 200.0);
        for _ in 0..200 {
            let s: f64 = 0.5 * (a + b);
            if psi(s) < to { a = s } else { b = s }
        }
        a
    };
    let along = |to: f64, of: fn(f64) -> f64| {
        let (end, n) = (until(to), 20_000);
        let h = end / f64::from(n);
        let sum = (0..=n).map(|i| {
            let weight = if i == 0 || i == n {
                1.0
            } else if i % 2 == 1 {
                4.0
            } else {
                2.0
            };
            weight * of(psi(h * f64::from(i)).to_radians())
        });
        6.0 * sum.sum::<f64>() * h / 3.0
    };
    near(&found, "advance", along(90.0, f64::cos), 1e-5);
    near(&found, "diameter", along(180.0, f64::sin), 1e-5);
    // r goes to K 10 until psi is 10, then to -K 10: the overshoot is where r is zero
    let (mut a, mut b) = (0.0, 200.0);
    let psi10 = |s: f64| k * 10.0 * (s - t * (1.0 - (-s / t).exp()));
    for _ in 0..200 {
        let s: f64 = 0.5 * (a + b);
        if psi10(s) < 10.0 { a = s } else { b = s }
    }
    let rate = k * 10.0 * (1.0 - (-a / t).exp());
    let further = t * (1.0 + rate / (k * 10.0)).ln();
    let overshoot = -k * 10.0 * further + (rate + k * 10.0) * t * (1.0 - (-further / t).exp());
    near(&found, "first", overshoot, 1e-4);
    assert!(found.iter().any(|(n, v)| n == "second" && *v > 0.0 && v.is_finite()), "{found:?}");
}

#[test]
fn a_reactor_converts_from_its_initial_state_and_a_trim_moves_with_the_parameters() {
    let found = measured(
        "model r { input T [K]; param k0 = 0.3 [1/min], A0 = 2 [mol/L] fixed, E = 4000 [K], T0 = 330 [K] fixed; time [min];
        state A [mol/L] = A0, B [mol/L]; let k = k0*exp(E*(1/T0 - 1/T)); der(A) = -k*A; der(B) = k*A;
        output a [mol/L] = A, b [mol/L] = B;
        requirement conversion = 1 - at(A, 5, hold(T, 340))/A0 in [0.8, inf], yield = at(B, 5, hold(T, 340))/A0; }",
    );
    let k = 0.3 * (4000.0f64 * (1.0 / 330.0 - 1.0 / 340.0)).exp();
    near(&found, "conversion", 1.0 - (-5.0 * k).exp(), 1e-7);
    near(&found, "yield", 1.0 - (-5.0 * k).exp(), 1e-7);
    // a boat: its throttle at the trim moves with the parameters; its speed rises from there
    let found = measured(
        "model b { input throttle; state u = 2; param drag = 0.3, push = 4, cruise = 3 fixed; der(u) = push*throttle - drag*u*abs(u);
        output y = u; trim { u = cruise; throttle = drag*cruise^2/push; }
        requirement after = at(u, 4, step(throttle, 0.2)), lag = time_to_half(u), top = steady(y, throttle); }",
    );
    near(&found, "lag", 2f64.ln() / (2.0 * 0.3 * 3.0), 1e-9);
    near(&found, "top", 4.0 / (2.0 * 0.3 * 3.0), 1e-9);
    // u' = 0.3 (9 + 0.8/0.3 - u^2) from u = 3
    let c = (9.0f64 + 0.8 / 0.3).sqrt();
    let (b, s) = ((3.0 / c).atanh(), 0.3 * c * 4.0);
    near(&found, "after", c * (s + b).tanh(), 1e-6);
}

#[test]
fn an_input_that_the_trim_leaves_open_has_the_value_that_keeps_it() {
    // no coefficient depends on the throttle: it is solved for all the same, and moves with the parameters
    let found = measured(
        "model b { input throttle; state u = 2; param drag = 0.3, push = 4, cruise = 3 fixed; der(u) = push*throttle - drag*u;
        output y = u; trim { u = cruise; } requirement after = at(u, 4, step(throttle, 0.2)), there = at(u, 4, step(throttle, 0)); }",
    );
    let far = 4.0 * 0.2 / 0.3;
    near(&found, "after", 3.0 + far * (1.0 - (-0.3f64 * 4.0).exp()), 1e-6);
    near(&found, "there", 3.0, 1e-9);
    // nothing is open that could keep it: the manoeuvres are refused in words, modes are not
    let m = model(
        "model b { input throttle; state u = 2, v = 1; param drag = 0.3, push = 4; der(u) = push*throttle - drag*u; der(v) = throttle - v;
        output y = u; trim { u = 3; v = 0; } requirement after = at(u, 4, step(throttle, 0.2)), lag = time_to_half(u); }",
    );
    let theta = m.definition().start();
    let plan = Plan::new(&m, &theta, &columns(&m)).unwrap().unwrap();
    let found = plan.bench().unwrap().measure(&theta, true);
    let why = found[0].missing.clone().unwrap_or_default();
    assert!(why.contains("begins at the trim; no trim was found: the rate") && why.contains("`throttle`"), "{why}");
    assert!((found[1].value - 2f64.ln() / 0.3).abs() < 1e-12 && found[1].gradient[0].is_finite());
}

#[test]
fn what_does_not_exist_is_said_and_the_rest_stays() {
    let m = model(
        "model m { input u; state x; param a = 1, k = 2; der(x) = -a*x + k*u; output y = x;
        requirement margin = gain_margin(y, u), grows = time_to_double(x), never = when(y, 5, 10, step(u, 1)), lag = 1/a in [0.5, 2]; }",
    );
    let theta = m.definition().start();
    let covariance = [0.01, 0.0, 0.0, 0.01];
    let known = Known { theta: &theta, covariance: &covariance, freedom: &[None, None] };
    let found = assess(&m, known, Draws { count: 200, seed: 1 }).unwrap();
    let reason = |k: usize| found[k].reason.clone().unwrap_or_default();
    assert!(reason(0).contains("does not reach -180 deg"), "{}", reason(0));
    assert!(reason(1).contains("does not grow") && reason(2).contains("does not pass"), "{found:?}");
    let lag = &found[3];
    assert!(
        lag.reason.is_none() && (lag.value.unwrap() - 1.0).abs() < 1e-15 && (lag.error.unwrap() - 0.1).abs() < 1e-12
    );
    assert!(lag.probability.unwrap() > 0.99 && lag.parts[0].parameter == "a" && lag.parts.len() == 1);
}

#[test]
fn draws_take_the_place_of_the_delta_method_where_a_requirement_bends() {
    let m = model(
        "model m { param a = 1, b = 1; input u; output y = a*u + b; requirement straight = 2*a in [1, inf], bent = 1/a in [0, 4], square = (b - 1)^2; }",
    );
    let theta = [1.0, 1.0];
    let covariance = [0.09, 0.0, 0.0, 0.04];
    let assessed = |count: usize| {
        assess(&m, Known { theta: &theta, covariance: &covariance, freedom: &[None, None] }, Draws { count, seed: 3 })
            .unwrap()
    };
    let found = assessed(4000);
    assert_eq!([found[0].by, found[1].by, found[2].by], [Some(By::Linear), Some(By::Draws), Some(By::Draws)]);
    // quantiles of one over a normal variate, of a square of one
    let [low, high] = found[1].interval.unwrap();
    assert!((low - 1.0 / 1.588).abs() < 0.02 && (high - 1.0 / 0.412).abs() < 0.15, "{low} {high}");
    let [low, high] = found[2].interval.unwrap();
    assert!(low < 1e-3 && (high - 0.04 * 5.02).abs() < 0.02, "{low} {high}");
    assert_eq!(assessed(4000), found, "the same bits");
    assert!(assessed(0).iter().all(|a| a.by == Some(By::Linear)));
}

#[test]
fn few_draws_tell_a_straight_requirement_and_all_are_made_of_a_bent_one() {
    let m = model(
        "model m { param a = 1, b = 1 in [0, inf]; input u; output y = a*u + b; requirement straight = 2*a - b, bent = exp(2*a) in [0, 9], nearly = a + 0.001*a^2; }",
    );
    let (theta, covariance) = ([1.0, 1.0], [0.09, 0.05, 0.05, 0.04]);
    let assessed = |count: usize, freedom: [Option<f64>; 2]| {
        assess(&m, Known { theta: &theta, covariance: &covariance, freedom: &freedom }, Draws { count, seed: 3 })
            .unwrap()
    };
    // heavy tails are no bend: the draws have them as well
    for freedom in [[None, None], [Some(4.0), Some(40.0)]] {
        let found = assessed(4000, freedom);
        assert_eq!([found[0].by, found[1].by, found[2].by], [Some(By::Linear), Some(By::Draws), Some(By::Linear)]);
    }
    // all draws of it: the ends are those of the logarithm, to the chance of 4000 draws
    let [low, high] = assessed(4000, [None, None])[1].interval.unwrap();
    let end = |z: f64| (2.0 * (1.0 + 0.3 * z)).exp();
    assert!((low / end(-1.96) - 1.0).abs() < 0.06 && (high / end(1.96) - 1.0).abs() < 0.06, "{low} {high}");
    // a bound within the errors cuts the law
    let near = [1.0, 0.1];
    let known = Known { theta: &near, covariance: &covariance, freedom: &[None, None] };
    let cut = assess(&m, known, Draws { count: 4000, seed: 3 }).unwrap();
    assert_eq!(cut[0].by, Some(By::Draws), "{:?}", cut[0]);
}

#[test]
fn overshoots_of_one_zigzag_share_its_flights() {
    let text = |asked: &str| {
        model(&format!("model m {{ input u; state x, v; param w = 2, z = 0.4; der(x) = v; der(v) = u - 2*z*w*v - w^2*x*abs(x); output y = x;
            trim {{ x = 0; v = 0; u = 0; }} requirement {asked}; }}"))
    };
    let overshoot = |k: u32| format!("o{k} = zigzag_overshoot(y, u, 1, 0.2, {k}, 60)");
    let measured = |m: &Model, theta: &[f64]| {
        let plan = Plan::new(m, &m.definition().start(), &columns(m)).unwrap().unwrap();
        let mut bench = plan.bench().unwrap();
        bench.measure(&m.definition().start(), true);
        bench.measure(theta, true)
    };
    let all = text(&[3, 1, 2].map(overshoot).join(", "));
    for theta in [[2.0, 0.4], [2.3, 0.3]] {
        let together = measured(&all, &theta);
        for (k, found) in [3, 1, 2].into_iter().zip(&together) {
            let alone = &measured(&text(&overshoot(k)), &theta)[0];
            assert!(alone.value.is_finite() && (found.value - alone.value).abs() < 1e-12, "{k}: {found:?} {alone:?}");
            for (a, b) in found.gradient.iter().zip(&alone.gradient) {
                assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{k}: {found:?} {alone:?}");
            }
        }
    }
    // an overshoot behind a level that is not passed is missing, those before it stay
    let m = text("o1 = zigzag_overshoot(y, u, 1, 0.2, 1, 2), o9 = zigzag_overshoot(y, u, 1, 0.2, 9, 2)");
    let found = measured(&m, &[2.0, 0.4]);
    assert!(found[0].value.is_finite() && found[1].missing.as_ref().unwrap().contains("does not pass"), "{found:?}");
}

#[test]
fn what_varies_is_no_requirement_and_slips_are_named() {
    let said = |statement: &str| {
        let text = format!(
            "model m {{ input u [m]; state x [m]; param a = 1 [1/s]; let b = 2*x; der(x) = a*(u - x); output y [m] = x + b; {statement} }}"
        );
        Model::from_text("m.fdm", text).expect_err(statement).to_string()
    };
    assert!(said("requirement r = x in [0, 1];").contains("varies with time"));
    assert!(said("requirement r = b;").contains("varies with time"));
    assert!(said("requirement r = mode_dampin(x);").contains("did you mean `mode_damping(x)`"));
    assert!(
        said("requirement r = mode_damping(y);").contains("wants a state here, and `y` is a output")
            || said("requirement r = mode_damping(y);").contains("`y` is")
    );
    assert!(said("requirement r = mode_damping(z);").contains("`z` is not declared"));
    assert!(said("requirement r = at(x, 5);").contains("takes at least 3 arguments"));
    assert!(said("requirement r = at(x, 0, step(u, 1));").contains("must be above 0"));
    assert!(said("requirement r = at(x, 5, stp(u, 1));").contains("did you mean `step`"));
    assert!(
        said("requirement r = at(x, a, step(u, 1));").contains("must not depend on params")
            || said("requirement r = at(x, a, step(u, 1));").contains("E060")
    );
    assert!(said("requirement r = a in [2, 1];").contains("reversed"));
    assert!(said("requirement r [s] = a;").contains("E0602"), "{}", said("requirement r [s] = a;"));
    assert!(said("requirement r = a; requirement r = 2*a;").contains("a second time"));
    assert!(said("requirement r;").contains("has no expression"));
    assert!(said("requirement r = a fixed;").contains("nothing else"));
}

#[test]
fn benches_of_one_plan_agree_to_the_bit() {
    let m = model("model m { input u; state x, v; param w = 2, z = 0.4; der(x) = v; der(v) = u - 2*z*w*v - w^2*x*abs(x); output y = x;
        trim { x = 0; v = 0; u = 0; } requirement top = maximum(y, 9, step(u, 1)), zig = zigzag_overshoot(y, u, 1, 0.2, 2, 60); }");
    let theta = m.definition().start();
    let plan = Plan::new(&m, &theta, &columns(&m)).unwrap().unwrap();
    let mut benches: Vec<Bench<'_>> = (0..2).map(|_| plan.bench().unwrap()).collect();
    let other = [2.3, 0.2];
    let first = benches[0].measure(&theta, true);
    benches[1].measure(&other, false);
    assert_eq!(benches[1].measure(&theta, true), first);
}
