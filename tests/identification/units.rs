//! Functional mock-up units as parts of a model: beside the same part as text, whose derivatives are exact. The units are made here, by our own
//! export; foreign ones stand in docs/notebook/studies.csv.

use fdm::estimate::{FitOptions, Work, fit};
use fdm::linear::{LinearModel, Values};
use fdm::record::Run;
use fdm::simulate::{Scheme, Simulator, Steps};
use fdm::{Model, code};
use fdm_exchange::fmu::{Contents, Version, write};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use support::Normal;

/// A motor with friction that knows no sign change, a temperature that begins where its parameters say, and an output that depends on
/// its input directly.
const MOTOR: &str = "model motor {
    input u [V]; state w [rad/s] = 0.3, T = 2*T0;
    param k = 3.0 in [0.1, 20], c = 0.4 fixed, J = 0.8 fixed, T0 = 0.25 fixed, r = 0.2 fixed;
    der(w) = (k*u - c*w*sqrt(1 + w^2))/J;
    der(T) = r*w^2 - 0.5*(T - T0);
    output speed [rad/s] = w; output heat = T*w; output power = u*w + k;
}";

/// A delay inside, which a unit tells as an event.
const LATE: &str = "model late { input u; state x; der(x) = u - x; output y = delay(x, 0.13); }";
/// A state that stops at its limits: event indicators.
const STOP: &str = "model stop { input u; state x; der(x) = u - x; limit x in [-0.5, 0.5]; output y = x; }";

/// A controller around it: what the motor is given is computed from what it gives.
fn whole(part: &str) -> String {
    format!(
        "model drive {{
        input order; param gain = 0.9, k = 2.2, T0 = 0.4; state i;
        use {part} as m(u = gain*(order - m.speed) + 0.5*i, k = k, T0 = T0);
        der(i) = order - m.speed;
        output speed_m [rad/s] = m.speed; output heat_m = 2*m.heat - i; output power_m = m.power; output T_m = m.T;
    }}"
    )
}

/// The library that Cargo built for these tests.
fn library() -> Vec<u8> {
    let test = std::env::current_exe().unwrap();
    let name = format!("{}fdm_fmu{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    fs::read(test.parent().unwrap().join(name)).unwrap()
}

/// A folder with units and the same parts as text, made once.
fn desk() -> &'static Path {
    static MADE: OnceLock<PathBuf> = OnceLock::new();
    MADE.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("units");
        fs::create_dir_all(&folder).unwrap();
        let library = library();
        for (name, text, version, number) in [
            ("motor", MOTOR, Version::Two, 2),
            ("motor", MOTOR, Version::Three, 3),
            ("late", LATE, Version::Two, 2),
            ("stop", STOP, Version::Three, 3),
        ] {
            fs::write(folder.join(format!("{name}.fdm")), text).unwrap();
            let model = Model::from_text(format!("{name}.fdm"), text).unwrap();
            let contents = Contents { model: &model, version, library: &library, errors: &BTreeMap::new() };
            fs::write(folder.join(format!("{name}{number}.fmu")), write(&contents).unwrap()).unwrap();
        }
        folder
    })
}

/// A model of that folder; tests write files of their own.
fn read(name: &str, text: &str) -> Result<Model, String> {
    let path = desk().join(format!("{name}.fdm"));
    fs::write(&path, text).unwrap();
    Model::from_file(path).map_err(|e| e.to_string())
}

fn run(model: &Model, n: usize) -> Run {
    let (m, q) = (model.layout().inputs, model.layout().outputs);
    let time: Vec<f64> = (0..n).map(|k| 0.05 * k as f64).collect();
    Run {
        name: "made".into(),
        inputs: time
            .iter()
            .flat_map(|t| (0..m).map(move |_| (1.7 * t).sin() + f64::from(u8::from(*t > 1.0))))
            .collect(),
        measured: vec![f64::NAN; n * q],
        time,
        held: vec![false; m],
        input_gaps: vec![0; m],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    }
}

/// The response (N by q) and, column by column of the free parameters, its Jacobian.
fn linearised(model: &Model, run: &Run, scheme: Scheme, theta: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
    let free: Vec<usize> = (0..theta.len()).filter(|k| !model.definition().params[*k].fixed).collect();
    let (rows, stride) = (run.len() * model.layout().outputs, free.len().next_multiple_of(8));
    let (mut y, mut jacobian) = (vec![0.0; rows], vec![f64::NAN; rows * stride]);
    let steps = Steps::equal(scheme, 4);
    let mut simulator = Simulator::new(model.dynamics(), run, steps).unwrap();
    simulator.sensitivities(theta, &free, &mut y, &mut jacobian).unwrap();
    (y, (0..free.len()).map(|c| (0..rows).map(|r| jacobian[r * stride + c]).collect()).collect())
}

fn worst(a: &[f64], b: &[f64]) -> f64 {
    let size = b.iter().fold(1.0, |s: f64, v| s.max(v.abs()));
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs() / size)
        .fold(0.0, |w, d| if d.is_nan() { f64::INFINITY } else { w.max(d) })
}

/// The free parameters by name: a unit's text has parameters of its own besides.
fn free(model: &Model) -> Vec<String> {
    model.definition().params.iter().filter(|p| !p.fixed).map(|p| p.quantity.name.clone()).collect()
}

#[test]
fn a_unit_is_what_its_text_is() {
    let plain = read("plain_a", &whole("\"motor.fdm\"")).unwrap();
    let run = run(&plain, 80);
    for version in [2, 3] {
        let unit = read("unit_a", &whole(&format!("fmu \"motor{version}.fmu\""))).unwrap();
        assert_eq!(free(&unit), free(&plain));
        for scheme in [Scheme::RungeKutta, Scheme::Radau] {
            let (y, columns) = linearised(&unit, &run, scheme, &unit.definition().start());
            let (exact, exact_columns) = linearised(&plain, &run, scheme, &plain.definition().start());
            let off = columns.iter().zip(&exact_columns).map(|(a, b)| worst(a, b)).fold(0.0, f64::max);
            println!("FMI {version}, {scheme:?}: response off by {:.1e}, derivatives by {off:.1e}", worst(&y, &exact));
            assert!(worst(&y, &exact) < 1e-9 && off < 1e-9, "{off:e}");
            assert!(exact_columns.iter().all(|c| c.iter().any(|v| v.abs() > 1e-3)), "every parameter moves something");
        }
        // differences of the whole simulation
        let theta = unit.definition().start();
        let (_, columns) = linearised(&unit, &run, Scheme::RungeKutta, &theta);
        let places = (0..theta.len()).filter(|k| !unit.definition().params[*k].fixed);
        for (k, column) in places.zip(&columns) {
            let moved = |by: f64| {
                let mut theta = theta.clone();
                theta[k] += by;
                linearised(&unit, &run, Scheme::RungeKutta, &theta).0
            };
            let h = 1e-4;
            let (a, b, c, d) = (moved(-2.0 * h), moved(-h), moved(h), moved(2.0 * h));
            let difference: Vec<f64> =
                (0..a.len()).map(|r| (8.0 * (c[r] - b[r]) - (d[r] - a[r])) / (12.0 * h)).collect();
            assert!(worst(column, &difference) < 1e-7, "{k}: {:e}", worst(column, &difference));
        }
        let found = code::verify(unit.definition(), unit.schedule(), &code::Nominal::start(unit.definition()));
        assert!(found.passed(), "{found:#?}");
    }
}

#[test]
fn fits_find_the_same_whatever_the_threads() {
    let plain = read("plain_b", &whole("\"motor.fdm\"")).unwrap();
    let unit = read("unit_b", &whole("fmu \"motor2.fmu\"")).unwrap();
    let mut run = run(&plain, 160);
    let truth: Vec<f64> = plain.definition().params.iter().map(|p| p.value * if p.fixed { 1.0 } else { 1.2 }).collect();
    let (exact, _) = linearised(&plain, &run, Scheme::RungeKutta, &truth);
    let mut noise = Normal(3);
    run.measured = exact.iter().map(|y| y + 0.02 * noise.next()).collect();
    let options = FitOptions { per_interval: Some(4), ..FitOptions::default() };
    let runs = [run];
    let two = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let fitted = |model: &Model| fit(model, &runs, &options, &Work::default()).unwrap().estimate;
    let (own, again, other) = (one.install(|| fitted(&unit)), two.install(|| fitted(&unit)), fitted(&plain));
    assert!(own.termination.is_good(), "{}", own.termination);
    for name in ["gain", "k", "T0"] {
        let [a, b, c] = [&own, &again, &other].map(|e| e.parameter(name, None).unwrap());
        assert_eq!(a.value.to_bits(), b.value.to_bits(), "{name} on one and on two threads");
        let error = c.standard_error.unwrap();
        println!("{name}: unit {}, text {} +- {error}", a.value, c.value);
        assert!((a.value - c.value).abs() < 1e-5 * error, "{name}: {} {}", a.value, c.value);
        assert!((a.standard_error.unwrap() / error - 1.0).abs() < 1e-5);
    }
}

/// Coefficients of the linear model, and their derivatives by parameters, by row, signal and name.
fn coefficients(model: &Model) -> BTreeMap<(u32, u32, String), f64> {
    let (mut linear, mut values) = (LinearModel::new(model).unwrap(), Values::default());
    linear.evaluate(&model.definition().start(), &mut values).unwrap();
    let structure = linear.structure();
    let terms = structure.terms.iter().zip(&values.terms).map(|(t, v)| ((t.row, t.signal, String::new()), *v));
    let slopes = structure.slopes.iter().zip(&values.slopes).map(|(s, v)| {
        let (term, param) = (&structure.terms[s.term as usize], &model.definition().params[s.param as usize]);
        ((term.row, term.signal, param.quantity.name.clone()), *v)
    });
    terms.chain(slopes).collect()
}

/// Derivatives of coefficients are second derivatives of a unit, also through the trim.
#[test]
fn a_unit_is_linearised_with_its_second_derivatives() {
    let text = |part: &str| whole(part).replace("order - m.speed", "order + 0.3 - m.speed");
    let exact = coefficients(&read("plain_c", &text("\"motor.fdm\"")).unwrap());
    let found = coefficients(&read("unit_c", &text("fmu \"motor3.fmu\"")).unwrap());
    let (mut compared, mut worst) = (0, 0.0_f64);
    for key in exact.keys().chain(found.keys()) {
        let [a, b] = [&found, &exact].map(|of| of.get(key).copied().unwrap_or(0.0));
        worst = worst.max((a - b).abs() / b.abs().max(1.0));
        compared += usize::from(b != 0.0);
        assert!((a - b).abs() < 1e-7 * b.abs().max(1.0), "{key:?}: {a} instead of {b}");
    }
    println!("{compared} coefficients and slopes, off by {worst:.1e} at most");
    assert!(compared > 30 && exact.keys().any(|(_, _, name)| name == "T0"), "{compared} {exact:?}");
}

#[test]
fn what_no_model_can_have_as_a_part_is_said() {
    let refused = |text: &str| read("refused", text).map(|_| String::new()).unwrap_or_else(|said| said);
    let word = refused("model m { input u; use \"late2.fmu\" as p(u = u); output y = p.y; }");
    assert!(word.contains("E0801") && word.contains("write `use fmu \"late2.fmu\" as p`"), "{word}");
    let word = refused("model m { input u; use fmu \"late.fdm\" as p(u = u); output y = p.y; }");
    assert!(word.contains("their names end in `.fmu`"), "{word}");
    fs::write(desk().join("no.fmu"), "no archive").unwrap();
    let word = refused("model m { input u; use fmu \"no.fmu\" as p(u = u); output y = p.y; }");
    assert!(word.contains("the archive:"), "{word}");
    let word = refused("model m { input u; use fmu \"stop3.fmu\" as p; output y = p.y + u; }");
    assert!(word.contains("E0802"), "an input needs a connection: {word}");

    let text = |file: &str| format!("model m {{ input u; use fmu \"{file}\" as p(u = u); output y = p.y; }}");
    let late = read("with_late", &text("late2.fmu")).unwrap();
    let record = run(&late, 20);
    let said = Simulator::new(late.dynamics(), &record, 2).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("late2.fmu") && said.contains("it has an event at time 0.13"), "{said}");

    let stop = read("with_stop", &text("stop3.fmu")).unwrap();
    let mut record = run(&stop, 60);
    let mut y = vec![0.0; 60];
    let ended = Simulator::new(stop.dynamics(), &record, 2).unwrap().simulate(&stop.definition().start(), &mut y);
    let told = fdm_grammar::external::complaints().join("\n");
    assert!(ended.is_err() && told.contains("event indicator") && told.contains("`when`, `limit`, `if`"), "{told}");
    // within its limits it is a part like any other
    record.inputs.iter_mut().for_each(|u| *u *= 0.1);
    Simulator::new(stop.dynamics(), &record, 2).unwrap().simulate(&stop.definition().start(), &mut y).unwrap();
    assert!(y.iter().any(|y| y.abs() > 0.01));
}
