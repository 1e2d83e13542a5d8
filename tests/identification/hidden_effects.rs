//! Effects of coupled bodies, stops, propellers and sensors: hidden by an integrator of the test's own, found by the catalogue of their field.

use fdm::diagnose::{Diagnosis, DiagnosisOptions, Verdict, diagnose};
use fdm::effect::{Catalogue, Field};
use fdm::record::Run;
use fdm::simulate::Simulator;
use fdm::{Model, Work};
use support::Normal;

/// Steps of the truth's integrator in a sample.
const STEPS: usize = 25;

/// States at every sample by fourth-order Runge-Kutta.
fn motion<const N: usize>(
    begin: [f64; N],
    (samples, dt): (usize, f64),
    rates: impl Fn(f64, &[f64; N]) -> [f64; N],
) -> Vec<[f64; N]> {
    let h = dt / STEPS as f64;
    let moved = |x: &[f64; N], k: &[f64; N], by: f64| std::array::from_fn(|i| x[i] + by * k[i]);
    let mut x = begin;
    let mut all = Vec::with_capacity(samples);
    for sample in 0..samples {
        all.push(x);
        for step in 0..STEPS {
            let t = sample as f64 * dt + step as f64 * h;
            let a = rates(t, &x);
            let b = rates(t + h / 2.0, &moved(&x, &a, h / 2.0));
            let c = rates(t + h / 2.0, &moved(&x, &b, h / 2.0));
            let d = rates(t + h, &moved(&x, &c, h));
            x = std::array::from_fn(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        }
    }
    all
}

/// A record with white noise of these deviations.
fn record<const N: usize, const M: usize>(
    name: &str,
    dt: f64,
    (states, noise): (&[[f64; N]], [f64; N]),
    input: impl Fn(f64) -> [f64; M],
) -> Run {
    let time: Vec<f64> = (0..states.len()).map(|k| k as f64 * dt).collect();
    let mut normal = Normal(name.bytes().map(u64::from).sum());
    Run {
        name: name.into(),
        inputs: time.iter().flat_map(|t| input(*t)).collect(),
        held: vec![false; M],
        measured: states
            .iter()
            .flat_map(|x| std::array::from_fn::<f64, N, _>(|i| x[i] + noise[i] * normal.next()))
            .collect(),
        input_gaps: vec![0; M],
        stated: Vec::new(),
        output_gaps: vec![0; N],
        time,
    }
}

/// What is named with the effects of a field, of those with these names.
fn found(text: &str, runs: &[Run], validation: &[Run], field: Field, names: &[&str]) -> Diagnosis {
    let mut catalogue = Catalogue::standard();
    catalogue.restrict(&[field]);
    catalogue.retain(|name| names.contains(&name));
    let model = Model::from_text("model.fdm", text).unwrap();
    let found = diagnose(&model, runs, validation, &catalogue, &DiagnosisOptions::default(), &Work::default()).unwrap();
    assert_eq!(found.verdict, Verdict::EffectFound, "{found:#?}");
    found
}

/// The first parameter of a cause with its standard error.
fn size(found: &Diagnosis, place: &str) -> (f64, f64) {
    let cause = found.causes.iter().find(|c| c.place.to_string() == place);
    let cause = cause.unwrap_or_else(|| panic!("no {place}: {:#?}", found.causes));
    (cause.parameters[0].value, cause.parameters[0].standard_error.unwrap())
}

/// Two links with a motor each. Solved for the accelerations, each torque stands in both equations, and so does friction.
#[test]
#[ignore = "a minute and a half: cargo test --workspace --test identification -- --ignored hidden"]
fn friction_of_both_joints_of_a_double_pendulum() {
    const TEXT: &str = "model arm {
        input T1 [N*m], T2 [N*m];
        state q1 [rad] = 0, q2 [rad] = 0, w1 [rad/s] = 0, w2 [rad/s] = 0;
        param a1 = 0.12 in [0.01, 1] [kg*m^2], a2 = 0.022 in [0.002, 0.5] [kg*m^2], a3 = 0.03 in [0, 0.5] [kg*m^2];
        param g1 = 3 in [0, 20] [N*m], g2 = 1 in [0, 10] [N*m], d1 = 0.05 [N*m*s], d2 = 0.02 [N*m*s];
        let m11 = a1 + a2 + 2*a3*cos(q2);
        let m12 = a2 + a3*cos(q2);
        let f1 = T1 + a3*sin(q2)*(2*w1*w2 + w2^2) - g1*sin(q1) - g2*sin(q1 + q2) - d1*w1;
        let f2 = T2 - a3*sin(q2)*w1^2 - g2*sin(q1 + q2) - d2*w2;
        der(q1) = w1;
        der(q2) = w2;
        der(w1) = (a2*f1 - m12*f2)/(m11*a2 - m12^2);
        der(w2) = (m11*f2 - m12*f1)/(m11*a2 - m12^2);
        output q1_m [rad] = q1, q2_m [rad] = q2, w1_m [rad/s] = w1, w2_m [rad/s] = w2;
    }";
    let (dt, samples) = (0.025, 160);
    let torques = |run: f64| {
        move |t: f64| {
            let wave = |k: f64, phase: f64| ((1.1 + 0.83 * k) * t + phase * run).sin();
            [1.1 * wave(0.0, 1.0) + 0.8 * wave(2.3, 2.0), 0.35 * wave(1.2, 0.7) + 0.3 * wave(4.1, 1.9)]
        }
    };
    let run = |number: f64, name: &str| {
        let torques = torques(number);
        let states = motion([0.0; 4], (samples, dt), |t, [q1, q2, w1, w2]| {
            let (a1, a2, a3, g1, g2) = (0.11, 0.024, 0.033, 3.4, 1.1);
            let [t1, t2] = torques(t);
            let rubbed = |w: f64, coulomb: f64, viscous: f64| coulomb * (w / 0.02).tanh() + viscous * w;
            let f1 = t1 + a3 * q2.sin() * (2.0 * w1 * w2 + w2 * w2)
                - g1 * q1.sin()
                - g2 * (q1 + q2).sin()
                - rubbed(*w1, 0.12, 0.06);
            let f2 = t2 - a3 * q2.sin() * w1 * w1 - g2 * (q1 + q2).sin() - rubbed(*w2, 0.05, 0.015);
            let (m11, m12) = (a1 + a2 + 2.0 * a3 * q2.cos(), a2 + a3 * q2.cos());
            let determinant = m11 * a2 - m12 * m12;
            [*w1, *w2, (a2 * f1 - m12 * f2) / determinant, (m11 * f2 - m12 * f1) / determinant]
        });
        record(name, dt, (&states, [0.003, 0.003, 0.03, 0.03]), torques)
    };
    let names = ["joint_friction", "joint_damping", "coulomb_friction", "constant_force"];
    let found = found(TEXT, &[run(1.0, "one")], &[run(2.0, "two")], Field::Mechanism, &names);
    // a third may be named: the truth creeps in another way than the effect
    for (place, truth) in [("joint_friction(T1, w1)", 0.12), ("joint_friction(T2, w2)", 0.05)] {
        let (value, error) = size(&found, place);
        // the truth creeps at another speed than the effect
        assert!((value - truth).abs() < 4.0 * error + 0.06 * truth, "{place}: {value} +- {error}");
    }
}

/// A spring with a stop on one side that stiffens: a polynomial from a travel on.
#[test]
#[ignore = "a minute and a half: cargo test --workspace --test identification -- --ignored hidden"]
fn a_stop_that_stiffens_is_a_gate() {
    const TEXT: &str = "model leg { input F; state s = 0, v = 0; param k = 8, d = 0.8, b = 5;
        der(s) = v; der(v) = b*F - k*s - d*v; output s_m = s, v_m = v; }";
    let (dt, samples) = (0.04, 250);
    let run = |number: f64, name: &str| {
        let force = move |t: f64| [1.6 * (1.3 * t + number).sin() + 1.3 * (2.9 * t + 2.0 * number).sin()];
        let states = motion([0.0; 2], (samples, dt), |t, [s, v]| {
            let beyond = (s - 0.4).max(0.0);
            [*v, 5.0 * force(t)[0] - 8.0 * s - 0.8 * v - 6.0 * beyond - 40.0 * beyond.powi(2)]
        });
        record(name, dt, (&states, [0.01, 0.03]), force)
    };
    let names = ["gate", "hinge", "cubic_stiffness", "quadratic_term", "quadratic_damping"];
    let found = found(TEXT, &[run(1.0, "one")], &[run(2.0, "two")], Field::Mechanism, &names);
    assert_eq!(found.causes[0].place.to_string(), "gate(v, s)", "{found:#?}");
    let edge = found.causes[0].parameters.iter().find(|p| p.name.starts_with("edge")).unwrap();
    assert!((edge.value - 0.4).abs() < 0.1, "{edge:?}");
}

/// A pendulum that swings itself out, of which friction and drag take parts. Each alone takes the other's as well, in some fits with a
/// sign that physics does not have: which of the two comes first depends on the noise.
#[test]
fn friction_and_drag_of_a_free_swing() {
    const STIFFNESS: f64 = 64.0;
    const VISCOUS: f64 = 0.02;
    const FRICTION: f64 = 0.2266;
    const DRAG: f64 = 0.0061;
    let dt = 0.05;
    let text = "model swing { state theta [rad] = free; state omega [rad/s] = free; \
                param w2 = 60 in [0, 1000] [1/s^2]; param c = 0.03 [1/s]; \
                der(theta) = omega; der(omega) = -w2*sin(theta) - c*omega; output angle [rad] = theta; }";
    let states = motion([1.5, 0.0], (1100, dt), |_, x| {
        let lost = VISCOUS * x[1] + DRAG * x[1] * x[1].abs() + FRICTION * (x[1] / 0.05).tanh();
        [x[1], -STIFFNESS * x[0].sin() - lost]
    });
    let angles: Vec<[f64; 1]> = states.iter().map(|x| [x[0]]).collect();
    // of nine draws of the noise the search ends with both in five; elsewhere its base fit is in another minimum, from which it sees friction alone
    let run = record("swing", dt, (&angles, [0.002]), |_| []);
    let names = ["coulomb_friction", "quadratic_damping", "cubic_damping"];
    // cubic damping, which may be told in the place of drag, is of that field
    let found = found(text, &[run], &[], Field::Ship, &names);
    let mut places: Vec<String> = found.causes.iter().map(|c| c.place.to_string()).collect();
    places.sort();
    assert_eq!(places, ["coulomb_friction(omega)", "quadratic_damping(omega)"], "{:#?}", found.front);
    for (place, truth) in [("coulomb_friction(omega)", FRICTION), ("quadratic_damping(omega)", DRAG)] {
        let (value, error) = size(&found, place);
        assert!((value - truth).abs() < 4.0 * error && error < 0.1 * truth, "{place}: {value} +- {error}");
    }
    let written = found.outputs.iter().find(|o| o.output == "angle").unwrap();
    assert!(written.rms_after.unwrap() < 0.0021, "{written:?}");
}

/// A rudder behind a propeller acts with the square of the speed of rotation.
#[test]
fn a_rudder_in_the_stream_of_a_propeller() {
    const TEXT: &str =
        "model yaw { input rudder, n; state r = 0; param T = 0.4, K = 0.5; der(r) = K*rudder - T*r; output r_m = r; }";
    let (dt, samples) = (0.1, 300);
    let run = |number: f64, name: &str| {
        let inputs = move |t: f64| {
            let wave = |pace: f64| (pace * t + number).sin();
            [0.5 * wave(0.9) + 0.4 * wave(2.1), 1.0 + 0.6 * wave(0.4)]
        };
        let states = motion([0.0], (samples, dt), |t, [r]| {
            let [rudder, n] = inputs(t);
            [0.5 * rudder + 0.4 * rudder * n * n - 0.4 * r]
        });
        record(name, dt, (&states, [0.01]), inputs)
    };
    let names = [
        "slipstream",
        "product_term",
        "input_curvature",
        "input_scale_asymmetry",
        "quadratic_damping",
        "missing_control",
        "signed_square",
        "actuator_lag",
    ];
    let found = found(TEXT, &[run(1.0, "one"), run(2.0, "two")], &[run(3.0, "three")], Field::Ship, &names);
    assert_eq!(found.causes.len(), 1, "{found:#?}");
    let (value, error) = size(&found, "slipstream(r, rudder, n)");
    assert!((value - 0.4).abs() < 4.0 * error, "{value} +- {error}");
}

/// Two masses as a vector: the drag of one stands in its own row.
#[test]
fn drag_of_one_element_of_a_vector() {
    const TEXT: &str = "model masses {
        input u[2] [N];
        state s[2] [m] = 0, v[2] [m/s] = 0;
        param k = 4 [N/m], c = 0.4 [N*s/m];
        const m = 1 [kg];
        der(s) = v;
        der(v) = (u - k*s - c*v)/m;
        output s_m[2] [m] = s;
    }";
    let (dt, samples) = (0.08, 150);
    let run = |number: f64, name: &str| {
        let force = move |t: f64| [2.0 * (1.1 * t + number).sin() + (3.0 * t).sin(), 1.5 * (1.7 * t + number).sin()];
        let states = motion([0.0; 4], (samples, dt), |t, [s1, s2, v1, v2]| {
            let [f1, f2] = force(t);
            [*v1, *v2, f1 - 4.0 * s1 - 0.4 * v1, f2 - 4.0 * s2 - 0.4 * v2 - 0.3 * v2 * v2.abs()]
        });
        let positions: Vec<[f64; 2]> = states.iter().map(|x| [x[0], x[1]]).collect();
        record(name, dt, (&positions, [0.01; 2]), force)
    };
    let names = ["quadratic_damping", "coulomb_friction", "cubic_stiffness", "output_scale"];
    let found = found(TEXT, &[run(1.0, "one")], &[run(2.0, "two")], Field::Mechanism, &names);
    assert_eq!(found.causes.len(), 1, "{found:#?}");
    let (value, error) = size(&found, "quadratic_damping(v[2])");
    assert!((value - 0.3).abs() < 4.0 * error, "{value} +- {error}");
    let text = found.extended.as_ref().unwrap();
    assert!(text.contains("(u - k*s - c*v)/m + [0, -drag_v2*v[2]*abs(v[2])];"), "{text}");
}

/// A pump whose flow ripples with its speed: no effect of the catalogue, so its curve is written into the text as a table.
#[test]
fn a_law_without_a_name_is_a_table_in_the_text() {
    const TEXT: &str =
        "model tank { input u [V]; state h [m] = 0; param T = 0.8 in [0.1, 20] [s], K = 0.9 [m/V], u0 = 0.1 [V];
        der(h) = (K*(u - u0) - h)/T;
        output h_m [m] = h; }";
    let (dt, samples) = (0.05, 400);
    let run = |number: f64, name: &str| {
        let speed = move |t: f64| [0.7 * (0.61 * t + number).sin() + 0.3 * (1.7 * t + 2.0 * number).sin()];
        let flow = |u: f64| u + 0.12 * (11.0 * u).sin();
        let states = motion([0.0], (samples, dt), |t, [h]| [(flow(speed(t)[0]) - h) / 0.7]);
        record(name, dt, (&states, [0.004]), speed)
    };
    let (runs, validation) = ([run(1.0, "one"), run(2.0, "two")], [run(3.0, "three")]);
    let model = Model::from_text("model.fdm", TEXT).unwrap();
    let names = ["coulomb_friction", "input_delay", "input_curvature", "quadratic_damping", "input_dead_zone"];
    let mut catalogue = Catalogue::standard();
    catalogue.retain(|name| names.contains(&name));
    let options = DiagnosisOptions::default();
    let found = diagnose(&model, &runs, &validation, &catalogue, &options, &Work::default()).unwrap();
    assert_eq!(found.verdict, Verdict::Law, "{found:#?}");
    let law = found.front.iter().find(|model| model.recommended).unwrap();
    let told = law.effects[0].effect.as_str();
    assert!(["law_curve", "coefficient_table"].contains(&told), "{:#?}", found.front);
    assert_eq!(law.effects[0].targets.last().unwrap(), "u");
    assert!(law.error_validation.is_some_and(|error| error < 0.2), "{law:#?}");
    // the curve itself, beside the model's own constant and coefficient
    let text = found.extended.as_ref().unwrap();
    assert!(text.contains("smooth") && text.contains("= cubic {"), "{text}");
    let written = Model::from_text("written.fdm", text.as_str()).unwrap();
    let start = written.definition().start();
    let printed = law.outputs[0].rms_validation.unwrap();
    let mut y = vec![0.0; samples];
    Simulator::new(written.dynamics(), &validation[0], 8).unwrap().simulate(&start, &mut y).unwrap();
    let squares: f64 = validation[0].measured.iter().zip(&y).map(|(z, y)| (z - y).powi(2)).sum();
    let rms = (squares / y.len() as f64).sqrt();
    assert!((rms / printed - 1.0).abs() < 1e-3, "{rms} {printed}");
}

/// An aeroplane in pitch whose lift bends over at 11 degrees: the model's lift is a straight line.
#[test]
fn a_coefficient_that_bends_is_a_smooth_table_in_the_text() {
    const TEXT: &str = "model wing \"an aeroplane in pitch\" {
        input elevator [rad];
        state alpha \"angle of attack\" [rad] = 0.09, q \"pitch rate\" [rad/s];
        const g = 9.81 [m/s^2], V = 60 [m/s], k = 14 [m/s^2];
        param CL0 = 0.2 [1], CLa = 4 [1/rad] \"slope of the lift\", Ma = -4 [1/s^2], Mq = -1.5 [1/s], Md = -8 [1/s^2], M0 = 0.3 [1/s^2];
        let CL = CL0 + CLa*alpha [1];
        der(alpha) = q + (g - k*CL)/V;
        der(q) = M0 + Ma*alpha + Mq*q + Md*elevator;
        output alpha_m [rad] = alpha, q_m [rad/s] = q, az [m/s^2] = -k*CL;
    }";
    let bend = 0.192;
    let lift = move |alpha: f64| 0.25 + 5.0 * alpha.min(bend) + 0.6 * (alpha - bend).max(0.0);
    let (dt, samples) = (0.05, 500);
    let run = |number: f64, name: &str| {
        let elevator = move |t: f64| [0.09 * (0.7 * t + number).sin() + 0.07 * (1.9 * t + 2.0 * number).sin() - 0.02];
        let states = motion([0.09, 0.0], (samples, dt), |t, [alpha, q]| {
            let [de] = elevator(t);
            [q + (9.81 - 14.0 * lift(*alpha)) / 60.0, 0.4 - 5.0 * alpha - 1.8 * q - 9.0 * de]
        });
        let shown: Vec<[f64; 3]> = states.iter().map(|[alpha, q]| [*alpha, *q, -14.0 * lift(*alpha)]).collect();
        let most = states.iter().map(|x| x[0]).fold(f64::MIN, f64::max);
        println!("{name}: angles of attack up to {most:.3} rad");
        record(name, dt, (&shown, [0.002, 0.004, 0.1]), elevator)
    };
    let (runs, validation) = ([run(1.0, "one"), run(2.0, "two")], [run(3.3, "three")]);
    let model = Model::from_text("model.fdm", TEXT).unwrap();
    let names = ["quadratic_damping", "cubic_stiffness", "coulomb_friction", "quadratic_term", "input_delay", "hinge"];
    let mut catalogue = Catalogue::standard();
    catalogue.retain(|name| names.contains(&name));
    let found =
        diagnose(&model, &runs, &validation, &catalogue, &DiagnosisOptions::default(), &Work::default()).unwrap();
    assert_eq!(found.verdict, Verdict::Law, "{found:#?}");
    let proposed = found.front.iter().find(|m| m.recommended).unwrap_or_else(|| panic!("{found:#?}"));
    // a constant that depends on alpha is the same curve as a slope that does
    let told = proposed.effects.last().unwrap().to_string();
    let coefficient = ["CLa", "CL0"].into_iter().find(|name| told == format!("coefficient_table({name}, alpha)"));
    let coefficient = coefficient.unwrap_or_else(|| panic!("{told}"));
    let text = found.extended.as_ref().unwrap();
    let written =
        [format!("table {coefficient}_curve(alpha [rad])"), format!("smooth {coefficient}_curve by order 2;")];
    assert!(written.iter().all(|part| text.contains(part)), "{text}");
    // the written text, its nodes beside the truth, flies the run that it has not seen
    let written = Model::from_text("written.fdm", text.as_str()).unwrap();
    let start = written.definition().start();
    let mut y = vec![0.0; 3 * samples];
    Simulator::new(written.dynamics(), &validation[0], 8).unwrap().simulate(&start, &mut y).unwrap();
    for (o, noise) in [0.002, 0.004, 0.1].into_iter().enumerate() {
        let cells = validation[0].measured.iter().zip(&y).skip(o).step_by(3);
        let rms = (cells.map(|(z, y)| (z - y).powi(2)).sum::<f64>() / samples as f64).sqrt();
        println!("output {o}: {rms:.5} beside a noise of {noise}");
        assert!(rms < 1.6 * noise, "{o}: {rms}");
    }
}

/// The same aeroplane without the bend, pushed as far: nothing is a table.
#[test]
fn a_straight_lift_is_no_table() {
    const TEXT: &str = "model wing { input elevator [rad]; state alpha [rad] = 0.09, q [rad/s];
        const g = 9.81 [m/s^2], V = 60 [m/s], k = 14 [m/s^2];
        param CL0 = 0.2 [1], CLa = 4 [1/rad], Ma = -4 [1/s^2], Mq = -1.5 [1/s], Md = -8 [1/s^2], M0 = 0.3 [1/s^2];
        let CL = CL0 + CLa*alpha [1];
        der(alpha) = q + (g - k*CL)/V;
        der(q) = M0 + Ma*alpha + Mq*q + Md*elevator;
        output alpha_m [rad] = alpha, q_m [rad/s] = q, az [m/s^2] = -k*CL; }";
    let (dt, samples) = (0.05, 400);
    let run = |number: f64, name: &str| {
        let elevator = move |t: f64| [0.09 * (0.7 * t + number).sin() + 0.07 * (1.9 * t + 2.0 * number).sin() - 0.02];
        let states = motion([0.09, 0.0], (samples, dt), |t, [alpha, q]| {
            let [de] = elevator(t);
            [q + (9.81 - 14.0 * (0.25 + 5.0 * alpha)) / 60.0, 0.4 - 5.0 * alpha - 1.8 * q - 9.0 * de]
        });
        let shown: Vec<[f64; 3]> = states.iter().map(|[alpha, q]| [*alpha, *q, -14.0 * (0.25 + 5.0 * alpha)]).collect();
        record(name, dt, (&shown, [0.002, 0.004, 0.1]), elevator)
    };
    let (runs, validation) = ([run(1.0, "one"), run(2.0, "two")], [run(3.3, "three")]);
    let names = ["quadratic_damping", "cubic_stiffness", "coulomb_friction", "quadratic_term", "input_delay", "hinge"];
    let mut catalogue = Catalogue::standard();
    catalogue.retain(|name| names.contains(&name));
    let model = Model::from_text("model.fdm", TEXT).unwrap();
    let found =
        diagnose(&model, &runs, &validation, &catalogue, &DiagnosisOptions::default(), &Work::default()).unwrap();
    assert_eq!(found.verdict, Verdict::NoEffectFound, "{found:#?}");
    assert!(found.extended.is_none());
}

/// A zero that is off by nine tenths of the noise, which is slow. Of so many candidates those that are taken out of a residual at first leave
/// its mean, and that is no noise that wanders.
#[test]
fn a_zero_in_slow_noise() {
    const ZERO: f64 = 0.0022;
    const TEXT: &str = "model aircraft { input elevator; state alpha = 0, q = 0, theta = 0; \
        param Za = -2.5, Zd = -0.3, Ma = -34, Mq = -8, Md = -55; \
        der(alpha) = Za*alpha + q + Zd*elevator; der(q) = (Ma*alpha + Mq*q + Md*elevator)/3.1; der(theta) = q; \
        output vane = alpha; output gyro = q; output attitude = theta; }";
    // correlation of neighbours, deviation
    const NOISE: [(f64, f64); 3] = [(0.94, 0.0007), (0.92, 0.0009), (0.72, 0.0025)];
    let dt = 0.04;
    let mut normal = Normal(39);
    let mut run = |name: &str, number: f64| {
        let elevator =
            move |t: f64| 0.05 * ((1.3 + 0.4 * number) * t).sin() + 0.03 * ((4.1 - 0.7 * number) * t + number).sin();
        let mut states = motion([0.0; 3], (400, dt), |t, x| {
            let e = elevator(t);
            [-2.6 * x[0] + x[1] - 0.28 * e, (-36.0 * x[0] - 8.5 * x[1] - 58.0 * e) / 3.1, x[1]]
        });
        let mut error: [f64; 3] = std::array::from_fn(|_| normal.next());
        for (k, x) in states.iter_mut().enumerate() {
            for (o, (rho, size)) in NOISE.iter().enumerate() {
                if k > 0 {
                    error[o] = rho * error[o] + (1.0 - rho * rho).sqrt() * normal.next();
                }
                x[o] += size * error[o];
            }
            x[2] += ZERO;
        }
        record(name, dt, (&states, [0.0; 3]), |t| [elevator(t)])
    };
    let model = Model::from_text("aircraft.fdm", TEXT).unwrap();
    let runs = [run("one", 1.0), run("two", 2.0)];
    let found =
        diagnose(&model, &runs, &[], &Catalogue::standard(), &DiagnosisOptions::default(), &Work::default()).unwrap();
    assert_eq!(found.verdict, Verdict::EffectFound, "{found:#?}");
    assert_eq!(found.causes.len(), 1, "{:#?}", found.causes);
    let (value, error) = size(&found, "output_bias(attitude)");
    assert!((value - ZERO).abs() < 4.0 * error && error < 0.2 * ZERO, "{value} +- {error}");
}

/// A limit that cuts a hundredth of the largest input. Limits at quantiles cut so much more that they are worse than none, and one beyond
/// the largest input has no derivative.
#[test]
fn a_limit_that_cuts_the_peaks_alone() {
    const TEXT: &str = "model filter { input d [V]; state i [A] = 0; param R = 1 [ohm], L = 0.3 [H];
        der(i) = (d - R*i)/L; output current [A] = i; }";
    let (dt, samples) = (0.02, 400);
    let input = |run: f64| move |t: f64| [0.45 + 0.135 * ((0.8 + 0.02 * run) * t + 0.18 * t * t).sin()];
    let run = |number: f64, name: &str| {
        let input = input(number);
        let states = motion([0.0], (samples, dt), |t, [i]| {
            let [d] = input(t);
            [(d.min(0.579) - 0.9 * i) / 0.26]
        });
        record(name, dt, (&states, [0.0003]), input)
    };
    let runs = [run(0.0, "first"), run(1.0, "second")];
    let found = found(TEXT, &runs, &[run(2.0, "third")], Field::Process, &["input_saturation", "input_curvature"]);
    let (limit, error) = size(&found, "input_saturation(d)");
    assert!((limit - 0.579).abs() < 4.0 * error && error < 1e-3, "{limit} +- {error}");
}

#[test]
fn heat_radiated_to_a_room() {
    // in degrees Celsius, whose fourth power means nothing
    const TEXT: &str = "model block { input power [W], room [degC]; state T [degC] = free; const C = 90 [J/K];
        param L = 0.6 [W/K], g = 1 [1]; C*der(T) = g*power - L*(T - room); output sensor [degC] = T; }";
    let (dt, samples) = (5.0, 400);
    let inputs = |run: f64| {
        move |t: f64| {
            let power = |sample: f64| {
                let t = dt * sample;
                let on = ((0.004 * (1.0 + 0.2 * run) * t + 0.7 * run).sin() + (0.0131 * t).sin()) > -0.4;
                if on { 45.0 } else { 5.0 }
            };
            // what is switched between two samples goes over in a straight line, as a record says that does not hold its inputs
            let (before, part) = ((t / dt).floor(), (t / dt).fract());
            let power = (1.0 - part) * power(before) + part * power(before + 1.0);
            [power, 21.0 + 2.0 * (0.003 * t + run).sin()]
        }
    };
    let run = |number: f64, name: &str| {
        let inputs = inputs(number);
        let fourth = |celsius: f64| (celsius + 273.15).powi(4);
        let states = motion([24.0], (samples, dt), |t, [warm]| {
            let [power, room] = inputs(t);
            [(power - 0.5 * (warm - room) - 1e-9 * (fourth(*warm) - fourth(room))) / 90.0]
        });
        record(name, dt, (&states, [0.05]), inputs)
    };
    let names = [
        "radiation",
        "curvature",
        "constant_force",
        "input_square",
        "input_cube",
        "product_term",
        "overflow",
        "output_bias",
        "input_bias",
    ];
    let found = found(TEXT, &[run(0.0, "one"), run(1.0, "two")], &[run(2.0, "three")], Field::Process, &names);
    assert_eq!(found.causes.len(), 1, "{found:#?}");
    let (value, error) = size(&found, "radiation(T, room)");
    // in parts of the fourth power of the hottest, which the text names
    let text = found.extended.as_ref().unwrap();
    let top = text.split("top_T = ").nth(1).and_then(|rest| rest.split([' ', ';']).next()).unwrap();
    let truth = 1e-9 * (top.parse::<f64>().unwrap() + 273.15).powi(4);
    assert!((value - truth).abs() < 4.0 * error, "{value} +- {error}, {truth}");
}

/// Two blocks that touch: what one gives the other takes, so both equations lack the same conductance.
#[test]
fn heat_that_two_blocks_exchange() {
    const CONDUCTANCE: f64 = 0.18;
    const TEXT: &str = "model blocks { input left [W], right [W]; const room = 21 [degC], A = 90 [J/K], B = 60 [J/K];
        state S [degC] = free, T [degC] = free; param GS = 0.6 [W/K], GT = 0.5 [W/K], e = 1 [1];
        A*der(S) = e*left - GS*(S - room); B*der(T) = e*right - GT*(T - room);
        output first [degC] = S, second [degC] = T; }";
    let (dt, samples) = (5.0, 400);
    let powers = |run: f64| {
        move |t: f64| {
            let on = |pace: f64, phase: f64| if (pace * t + phase * run).sin() > -0.2 { 30.0 } else { 2.0 };
            [on(0.0071, 0.9), on(0.0113, 2.1)]
        }
    };
    let run = |number: f64, name: &str| {
        let powers = powers(number);
        let states = motion([24.0, 23.0], (samples, dt), |t, [s, w]| {
            let [left, right] = powers(t);
            let over = CONDUCTANCE * (s - w);
            [(left - 0.5 * (s - 21.0) - over) / 90.0, (right - 0.4 * (w - 21.0) + over) / 60.0]
        });
        record(name, dt, (&states, [0.05; 2]), powers)
    };
    let names = [
        "heat_exchange",
        "missing_coupling",
        "missing_control",
        "radiation",
        "constant_force",
        "curvature",
        "input_bias",
        "output_bias",
        "temperature_scale",
        "thermometer_position",
    ];
    let found = found(TEXT, &[run(0.0, "one"), run(1.0, "two")], &[run(2.0, "three")], Field::Process, &names);
    assert_eq!(found.causes.len(), 2, "{found:#?}");
    // in the units of equations that are not solved for their derivatives, both are the conductance
    for place in ["heat_exchange(S, T)", "heat_exchange(T, S)"] {
        let (value, error) = size(&found, place);
        assert!((value - CONDUCTANCE).abs() < 4.0 * error && error < 0.1 * CONDUCTANCE, "{place}: {value} +- {error}");
    }
}

#[test]
fn a_rudder_that_acts_as_the_sine_of_its_angle() {
    const TEXT: &str = "model yaw { input rudder [rad]; state r [rad/s] = 0; param N = 0.4 [1/s^2], d = 0.5 [1/s];
        der(r) = N*rudder - d*r; output gyro [rad/s] = r; }";
    let (dt, samples) = (0.1, 500);
    let input = |run: f64| move |t: f64| [0.6 * (0.31 * (1.0 + 0.1 * run) * t).sin() + 0.3 * (1.1 * t + run).sin()];
    let run = |number: f64, name: &str| {
        let input = input(number);
        let states = motion([0.0], (samples, dt), |t, [r]| [0.45 * input(t)[0].sin() - 0.5 * r]);
        record(name, dt, (&states, [0.004]), input)
    };
    let names =
        ["input_square", "input_cube", "input_curvature", "signed_square", "quadratic_damping", "input_dead_zone"];
    let found = found(TEXT, &[run(0.0, "one"), run(1.0, "two")], &[run(2.0, "three")], Field::Ship, &names);
    assert_eq!(found.causes.len(), 1, "{found:#?}");
    // the cube nearest to the sine over these angles has 0.160 (least squares), and less than 1/6 by any weights; the rate of yaw
    // weighs them otherwise, which is what 0.006 is for
    let (value, error) = size(&found, "input_cube(rudder)");
    assert!((value + 0.157).abs() < 4.0 * error + 0.006, "{value} +- {error}");
}
