//! Experiments from text to outcome.

use super::*;
use fdm_grammar::Unit;
use fdm_numeric::random::Stream;
use fdm_system::Model;
use fdm_system::record::{ReadOptions, channels, read};
use fdm_system::simulate::Simulator;
use std::f64::consts::TAU;
use std::path::Path;

/// A folder with an experiment and its models.
fn folder(experiment: &str, models: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join(Experiment::FILE), experiment).expect("written");
    for (name, text) in models {
        std::fs::write(folder.path().join(name), text).expect("written");
    }
    folder
}

/// The experiment of such a folder, whose own name is another one every time and would decide the noise.
fn read_as_test(folder: &tempfile::TempDir) -> Experiment {
    Experiment { name: "test".into(), ..Experiment::read(folder.path()).expect("an experiment") }
}

fn signal(text: &str) -> Signal {
    #[derive(serde::Deserialize)]
    struct Holder {
        signal: Signal,
    }
    toml::from_str::<Holder>(&format!("signal = {text}")).expect("a signal").signal
}

fn sampled(text: &str, samples: usize, dt: f64, unit: &str) -> Vec<f64> {
    let unit = Unit::parse(unit).expect("a unit");
    signal(text)
        .sampled(samples, dt, Some(&unit), &Unit::second(), &mut Stream::named(1, &["s"]))
        .expect("its unit fits")
}

#[test]
fn inputs_have_their_forms_and_their_units() {
    let s = sampled("{ form = '3211', at = 1, height = 2, unit = 0.5 }", 60, 0.1, "deg");
    let at = |t: f64| s[(t * 10.0).round() as usize];
    assert_eq!(
        [0.9, 1.0, 2.4, 2.5, 3.4, 3.5, 3.9, 4.0, 4.4, 4.5].map(at),
        [0.0, 2.0, 2.0, -2.0, -2.0, 2.0, 2.0, -2.0, -2.0, 0.0]
    );
    let ramp = sampled("{ form = 'ramp', at = 1, height = '35 deg', rate = '2.32 deg/s' }", 60, 1.0, "rad");
    assert!(
        (ramp[11] - 23.2f64.to_radians()).abs() < 1e-12 && (ramp[40] - 35f64.to_radians()).abs() < 1e-12,
        "{ramp:?}"
    );
    assert_eq!(sampled("{ form = 'doublet', at = 0, height = 1, half = 1 }", 4, 1.0, "m"), [1.0, -1.0, 0.0, 0.0]);
    assert_eq!(sampled("{ form = 'pulse', at = 1, height = 3, length = 2 }", 5, 1.0, "m"), [0.0, 3.0, 3.0, 0.0, 0.0]);
    let sweep = sampled("{ form = 'sweep', at = 1, length = 10, band = [0.1, 2], height = 1 }", 1300, 0.01, "m");
    assert!(sweep[..100].iter().chain(&sweep[1101..]).all(|v| *v == 0.0));
    // the last turn takes half a second
    let crossings = sweep[1000..1100].windows(2).filter(|w| w[0] * w[1] < 0.0).count();
    assert!((3..=5).contains(&crossings), "{crossings}");
    let wrong = signal("{ form = 'step', at = 0, height = '3 kg' }");
    assert_eq!(wrong.sampled(3, 1.0, Some(&Unit::radian()), &Unit::second(), &mut Stream::named(1, &[])), None);
}

#[test]
fn an_input_is_a_column_of_a_record() {
    let text = "title = 't'\nsource = 's'\n[[record]]\nname = 'r'\ntruth = 'm.fdm'\ndt = 0.5\nduration = 3\n\
        inputs.u = [{ form = 'record', file = 'old.csv', column = 'stick' }, { form = 'step', at = 0, height = 10 }]\n";
    let model = "model m { input u [deg]; state x [deg]; param k = 2 [1/s]; der(x) = k*(u - x); output y [deg] = u; }";
    let old = "t [s],other,stick [rad]\n0,9,0\n1,9,0.1\n2,9,-0.1\n";
    let folder = folder(text, &[("m.fdm", model), ("old.csv", old)]);
    let made = tables(&read_as_test(&folder)).expect("records");
    let wanted = [0.0, 0.05, 0.1, 0.0, -0.1, -0.1, -0.1].map(|v: f64| v.to_degrees() + 10.0);
    assert!(made[0].columns[1].2.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9), "{made:?}");
}

/// Size of a line.
fn line(values: &[f64], dt: f64, frequency: f64) -> f64 {
    let part = |of: fn(f64) -> f64| {
        values.iter().enumerate().map(|(k, v)| v * of(TAU * frequency * dt * k as f64)).sum::<f64>()
    };
    2.0 * part(f64::cos).hypot(part(f64::sin)) / values.len() as f64
}

#[test]
fn combs_of_multisines_share_no_line() {
    for phases in ["schroeder", "random"] {
        let comb = |k: usize| {
            let text = format!(
                "{{ form = 'multisine', band = [0.1, 0.8], lines = 4, comb = [{k}, 2], rms = 3, phases = '{phases}' }}"
            );
            sampled(&text, 1000, 0.1, "m")
        };
        let (a, b) = (comb(0), comb(1));
        let rms = (a.iter().map(|v| v * v).sum::<f64>() / 1000.0).sqrt();
        assert!((rms - 3.0).abs() < 1e-9, "{rms}");
        for k in 1..=8 {
            let (mine, other) = (line(&a, 0.1, 0.1 * f64::from(k)), line(&b, 0.1, 0.1 * f64::from(k)));
            let wanted = 3.0 / 2f64.sqrt();
            assert!((mine - if k % 2 == 1 { wanted } else { 0.0 }).abs() < 1e-9, "{k}: {mine}");
            assert!((other - if k % 2 == 0 { wanted } else { 0.0 }).abs() < 1e-9, "{k}: {other}");
        }
    }
}

#[test]
fn noise_has_its_size_and_its_colour() {
    let n = 20_000;
    let drawn = |colour: Colour| {
        let mut values = vec![10.0; n];
        Noise { deviation: 0.5, colour, ..Noise::default() }.add(&mut values, 0.1, &mut Stream::named(3, &["a", "b"]));
        values.iter().map(|v| v - 10.0).collect::<Vec<_>>()
    };
    let product = |v: &[f64], lag: usize| v.iter().zip(&v[lag..]).map(|(a, b)| a * b).sum::<f64>() / (n - lag) as f64;
    let white = drawn(Colour::White);
    assert!((product(&white, 0) / 0.25 - 1.0).abs() < 0.05 && product(&white, 1).abs() < 0.01);
    let lagged = drawn(Colour::Lag(0.5));
    let kept = product(&lagged, 5) / product(&lagged, 0);
    assert!((kept - (-1f64).exp()).abs() < 0.05, "{kept}");
    let pink = drawn(Colour::Pink);
    let power = |low: usize| (low..2 * low).map(|k| line(&pink, 0.1, k as f64 / (0.1 * n as f64)).powi(2)).sum::<f64>();
    // equal power in every octave
    let ratio = power(1600) / power(100);
    assert!((0.4..2.5).contains(&ratio), "{ratio}");
    let mut relative = vec![4.0, -2.0, 0.0];
    Noise { deviation: 0.1, of: Of::Value, ..Noise::default() }.add(&mut relative, 1.0, &mut Stream::named(3, &[]));
    assert!(relative[2] == 0.0 && relative[0] != 4.0 && (relative[0] / 4.0 - 1.0).abs() < 0.5);
    let mut factor = vec![4.0; 1000];
    Noise { deviation: 2.0, logarithm: true, ..Noise::default() }.add(&mut factor, 1.0, &mut Stream::named(3, &[]));
    assert!(factor.iter().all(|v| *v > 0.0));
    assert_ne!(Stream::named(3, &["a", "b"]).uniform(), Stream::named(3, &["ab"]).uniform());
}

const PLANT: &str = "model plant { input u; state x, v; param a = -0.5, b = 2, k = 1.5; der(x) = v; der(v) = k*x + a*v + b*u; output y = x, rate = v; }";
const CONTROLLER: &str = "model pid { input y, rate, wanted; state sum; der(sum) = y - wanted; output u = -3*(y - wanted) - 1*sum - 1.2*rate; }";
const LOOP: &str = "title = 'loop'\nsource = 'ours'\n[[record]]\nname = 'flight'\ntruth = 'plant.fdm'\ncontroller = 'pid.fdm'\ndt = 0.05\nduration = 20\n\
    inputs.wanted = [{ form = 'multisine', band = [0.05, 1], lines = 20, rms = 1, phases = 'random' }]\nnoise.y = 0.02\n";

#[test]
fn inputs_of_a_closed_loop_are_what_the_unstable_plant_saw() {
    let folder = folder(LOOP, &[("plant.fdm", PLANT), ("pid.fdm", CONTROLLER)]);
    let experiment = read_as_test(&folder);
    let made = tables(&experiment).expect("records");
    let names: Vec<&str> = made[0].columns.iter().map(|c| c.0.as_str()).collect();
    assert_eq!(names, ["t", "u", "y", "rate", "wanted"]);
    let path = made[0].write(folder.path()).expect("written");
    let plant = Model::from_file(folder.path().join("plant.fdm")).expect("a model");
    let (run, _) = read(&path, &channels(plant.definition()), &ReadOptions::default()).expect("a run");
    let mut y = vec![0.0; run.measured.len()];
    Simulator::new(plant.dynamics(), &run, 8)
        .expect("suited")
        .simulate(&plant.definition().start(), &mut y)
        .expect("finite");
    let mut noise = 0.0;
    for (k, (simulated, recorded)) in y.chunks(2).zip(run.measured.chunks(2)).enumerate() {
        // the rate is recorded without noise, and an instability of e^18 leaves no room for inputs that were otherwise
        assert!(
            (simulated[1] - recorded[1]).abs() < 1e-9 * (0.95 * 0.05 * k as f64).exp().max(1.0),
            "sample {k}: {simulated:?} {recorded:?}"
        );
        noise += (simulated[0] - recorded[0]).powi(2) / 401.0;
    }
    assert!((noise.sqrt() / 0.02 - 1.0).abs() < 0.2, "{noise}");
    let moved = made[0].columns[1].2.iter().fold(0.0, |a: f64, u| a.max(u.abs()));
    assert!((0.5..50.0).contains(&moved), "the loop holds it: {moved}");
}

#[test]
fn an_experiment_finds_its_truth_and_says_when_it_does_not() {
    let steps = "[[step]]\nname = 'open'\nmodel = 'plant.fdm'\noff = 0.1\n\
        [[step]]\nname = 'held'\nmodel = 'plant.fdm'\nheld = { open = ['a'] }\nexpected.b = { value = 3 }\nexpected.'rms(y)' = { most = 0.03 }\n\
        [[step]]\nname = 'long'\nmodel = 'plant.fdm'\nlong = true\n";
    // the plant alone grows by a factor of 2,000
    let noisy = LOOP.replace("noise.y", "noise.all").replace("duration = 20", "duration = 8");
    let folder = folder(&format!("{noisy}{steps}"), &[("plant.fdm", PLANT), ("pid.fdm", CONTROLLER)]);
    let experiment = read_as_test(&folder);
    let outcome = reproduce(&experiment, true).expect("an outcome");
    let of = |step: &str, what: &str| outcome.checks.iter().find(|c| c.step == step && c.what == what);
    for name in ["a", "b", "k"] {
        let check = of("open", name).expect("compared");
        assert!(check.passed && check.off.is_some_and(|z| z.abs() < 4.0), "{check:?}");
    }
    assert!(of("held", "a").is_none(), "what is held is not compared");
    assert!(of("held", "k").is_some() && of("held", "rms(y)").expect("a figure").passed);
    let wrong = of("held", "b").expect("compared");
    assert!(!wrong.passed && wrong.off.is_some_and(|z| z < -100.0), "{wrong:?}");
    assert!(!outcome.passed && outcome.parameters == 3);
    assert!(outcome.checks.iter().all(|c| c.step != "long"), "thinned");
    let threads = |count: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().expect("threads");
        pool.install(|| reproduce(&experiment, true).expect("an outcome"))
    };
    assert_eq!(threads(1), threads(3));
    assert_eq!(threads(1), outcome);
}

#[test]
fn statements_are_judged_by_errors() {
    let text = "title = 't'\nsource = 's'\n[[record]]\nname = 'r'\ntruth = 'm.fdm'\ndt = 0.1\nduration = 10\nnoise.y = 0.05\n\
        inputs.u = [{ form = 'step', at = 1, height = 1 }]\n[[step]]\nname = 's'\nmodel = 'm.fdm'\nexcept = ['none']\n\
        says = { undetermined = ['none', 'k'], determined = ['k', 'none'], weak = [['none']] }\n\
        [[step]]\nname = 'double'\nmodel = 'double.fdm'\nsays.not_identifiable = [['a', 'b']]\n";
    let model = "model m { input u; state x; param k = 2, none = 0; der(x) = u - k*x; output y = x + none*u^2*t/100; }";
    let double = "model d { input u; state x; param k = 2, a = 1, b = 1; der(x) = a*b*u - k*x; output y = x; }";
    let folder = folder(text, &[("m.fdm", model), ("double.fdm", double)]);
    let outcome = reproduce(&read_as_test(&folder), false).expect("an outcome");
    let passed = |expected: &str, what: &str| {
        let found = outcome.checks.iter().find(|c| c.expected.starts_with(expected) && c.what == what);
        found.unwrap_or_else(|| panic!("{expected} {what}: {outcome:#?}")).passed
    };
    assert!(passed("not determined by", "none") && !passed("not determined by", "k"));
    assert!(passed("determined", "k"), "{outcome:#?}");
    let both: Vec<bool> =
        outcome.checks.iter().filter(|c| c.what == "none" && c.expected == "determined").map(|c| c.passed).collect();
    assert_eq!(both, [false]);
    assert!(passed("a combination of a, b", "what is not identifiable"));
}

#[test]
fn mistakes_are_told_with_their_place_and_the_nearest_name() {
    let told = |text: &str| {
        let folder = folder(text, &[("plant.fdm", PLANT), ("pid.fdm", CONTROLLER)]);
        match Experiment::read(folder.path()).map(|e| reproduce(&e, false)) {
            Err(e) | Ok(Err(e)) => e.to_string(),
            Ok(Ok(outcome)) => panic!("{outcome:?}"),
        }
    };
    let said = told("title = 't'\nsource = 's'\n[[record]]\nnmae = 'a'\n");
    assert!(said.contains("line 4") && said.contains("nmae"), "{said}");
    let step = |text: &str| told(&format!("{LOOP}[[step]]\nname = 's'\nmodel = 'plant.fdm'\n{text}"));
    assert!(step("records = ['fligth']").contains("did you mean `flight`?"));
    assert!(step("from = 't'").contains("earlier step"));
    let other = "model other { input u; state v; param c = -1, b = 2; der(v) = c*v + b*u; output rate = v; }";
    let held = folder(
        &format!(
            "{LOOP}[[step]]\nname = 'first'\nmodel = 'other.fdm'\nmethod = 'equation-error'\n[[step]]\nname = 's'\nmodel = 'plant.fdm'\nheld = {{ first = ['a', 'b'] }}\n"
        ),
        &[("plant.fdm", PLANT), ("pid.fdm", CONTROLLER), ("other.fdm", other)],
    );
    let said = reproduce(&read_as_test(&held), false).expect_err("nothing to hold");
    assert!(said.to_string().contains("there is no earlier parameter `a`"), "{said}");
    assert!(step("fix = ['aa']").contains("did you mean `a`?"));
    assert!(step("domain = 'frequency'\nend_points = 'fre'").contains("`free`, `known`, `none`"));
    assert!(step("method = 'filter-error'\ndomain = 'time'").contains("it belongs to `output-error`"));
    let flown =
        |from: &str, to: &str| told(&format!("{}[[step]]\nname = 's'\nmodel = 'plant.fdm'\n", LOOP.replace(from, to)));
    assert!(flown("noise.y ", "noise.raet ").contains("did you mean `rate`?"));
    assert!(flown("noise.y = 0.02", "noise.y = { deviation = 0.1, of = 'rms' }").contains("in its own unit"));
    assert!(flown("inputs.wanted", "inputs.wandet").contains("did you mean `wanted`?"));
    assert!(flown("inputs.wanted = ", "inputs.u = ").contains("nothing moves the input `wanted`"));
    assert!(told(&LOOP.replace("dt = 0.05", "dt = 0")).contains("needs `dt`"));
    assert!(told("title = 't'\nsource = 's'\n[[record]]\nname = 'a'\n").contains("neither"));
}

#[test]
fn a_name_that_nothing_has_is_told_with_the_nearest() {
    let root = tempfile::tempdir().expect("a folder");
    for name in ["hover", "puma"] {
        let place = root.path().join(name);
        std::fs::create_dir(&place).expect("a folder");
        std::fs::write(place.join(Experiment::FILE), "title = 't'\nsource = 's'\nalso = ['other']\n").expect("written");
    }
    let catalogue = Catalogue::open(root.path()).expect("a catalogue");
    assert_eq!(catalogue.find("PUMA").expect("found").name, "puma");
    assert_eq!(catalogue.find("other").expect("found").name, "hover");
    let said = catalogue.find("hovr").expect_err("unknown").to_string();
    assert!(said.contains("did you mean `hover`?") && said.contains("hover, puma"), "{said}");
    assert!(Catalogue::open(Path::new("nowhere")).is_err());
}
