//! `fdm diagnose` as a user runs it: an effect of the user's own is hidden in records, found, written into the model's text with
//! its comments kept, and the extended model is one that `fdm fit` takes.

use fdm::Model;
use fdm::record::Run;
use fdm::simulate::Simulator;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde_json::Value;
use std::fmt::Write;
use support::Desk;

/// A boat's yaw; what the rudder does is felt less at high rates of turn, which no effect of the standard catalogue says.
const MODEL: &str = "// The yaw of a boat, as everybody writes it.
model yaw \"first order in the rudder\" {
  input rudder [1];
  state r \"rate of turn\" [1/s] = 0;

  param T = 0.5 [1/s]   \"damping\";  // never below zero
  param K = 0.8 [1/s^2] \"rudder\";

  der(r) = K*rudder - T*r;  // Nomoto

  output turn [1/s] = r;
}
";
const OWN: &str = "// What our boats do.
effect stall(x: state, i: input) when depends(der(x), i) \"{i} acts less on {x} where {x} is large\" {
  param loss = 0 [1];
  add der(x) += -loss*i*x^2;
}
";

fn desk() -> Desk {
    let desk = Desk::with([("yaw.fdm", MODEL), ("own.fdm", OWN)]);
    for (k, name) in ["one", "two", "kept"].into_iter().enumerate() {
        desk.write(&format!("{name}.csv"), record(k));
    }
    desk
}

/// A record of the truth, with one part in fifty of noise.
fn record(k: usize) -> String {
    let truth = MODEL.replace("- T*r;", "- T*r - 0.9*rudder*r^2;");
    let model = Model::from_text("truth.fdm", truth).unwrap();
    let (n, dt) = (240, 0.1);
    let time: Vec<f64> = (0..n).map(|i| i as f64 * dt).collect();
    let mut random = ChaCha8Rng::seed_from_u64(40 + k as u64);
    let mut level = 0.0;
    let mut inputs = Vec::with_capacity(n);
    for i in 0..n {
        if i % 17 == 5 {
            level = random.random_range(-1.0..1.0);
        }
        inputs.push(level);
    }
    let mut run = Run {
        name: "truth".into(),
        inputs,
        held: vec![false],
        measured: vec![f64::NAN; n],
        time,
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0],
    };
    let mut y = vec![0.0; n];
    Simulator::new(model.dynamics(), &run, 8).unwrap().simulate(&model.definition().start(), &mut y).unwrap();
    let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
    run.measured = y.iter().map(|y| y + 0.008 * normal()).collect();
    let mut text = "time,rudder,turn\n".to_string();
    for i in 0..n {
        writeln!(text, "{},{},{}", run.time[i], run.inputs[i], run.measured[i]).unwrap();
    }
    text
}

#[test]
fn an_effect_of_the_users_own_is_found_and_written_into_the_users_text() {
    let desk = desk();
    let said = desk.good(
        "diagnose yaw.fdm --data one.csv --data two.csv --validation kept.csv --linear rudder --effects own.fdm --write better.fdm --out result --json -q",
    );
    let found: Value = serde_json::from_str(&said).unwrap();
    assert_eq!((&found["verdict"], &found["extended_model"]), (&"effect_found".into(), &"better.fdm".into()), "{said}");
    let cause = &found["causes"][0];
    assert_eq!((&cause["effect"], &cause["targets"]), (&"stall".into(), &serde_json::json!(["r", "rudder"])), "{said}");
    let loss = cause["parameters"][0]["value"].as_f64().unwrap();
    assert!((loss - 0.9).abs() < 0.15 && cause["loss"].as_f64().unwrap() > 10.0, "{cause}");
    assert_eq!(found["causes"].as_array().unwrap().len(), 1, "{said}");

    // the user's own lines stay as they are, to the byte; estimates take the place of start values
    let better = desk.text("better.fdm");
    let kept = MODEL.lines().filter(|line| !line.contains("der(r)") && !line.contains("param"));
    assert!(better.contains(r#" [1/s]   "damping";  // never below zero"#) && !better.contains("T = 0.5 "), "{better}");
    kept.for_each(|line| assert!(better.contains(line), "`{line}` is lost:\n{better}"));
    assert!(better.contains("// Nomoto") && better.contains("*rudder*r^2"), "{better}");
    let json: Value = serde_json::from_str(&desk.text("result/diagnosis.json")).unwrap();
    assert_eq!(json, found);
    assert!(desk.text("result/diagnosis.txt").contains("stall(r, rudder)"));
    assert_eq!(desk.text("result/extended.fdm"), better);
    assert!(desk.text("result/extended.diff").lines().any(|line| line.starts_with("+  der(r)")));

    // the folder has what its page needs
    desk.good("report result -o page.html");
    let page = desk.text("page.html");
    for expected in [
        "Something is missing from the model",
        "class=\"added\"",
        "class=\"removed\"",
        "kept (validation)",
        "overlay-1-1",
        "// Nomoto",
    ] {
        assert!(page.contains(expected), "{expected}");
    }

    // and it is a model that a fit takes
    let fit = desk.json("fit better.fdm --data one.csv --data two.csv --json -q");
    assert!(fit.to_string().contains("loss"), "{fit}");
}

/// The boat under an autopilot that turns the rudder against the rate of turn it reads, with a command that is hardly there.
fn steered(seed: u64) -> String {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (dt, damping, gain) = (0.1, 0.5_f64, 0.8);
    let decay = (-damping * dt).exp();
    let (mut r, mut command) = (1.0, 0.0);
    let mut text = "time,rudder,turn\n".to_string();
    for i in 0..240 {
        if i % 40 == 20 {
            command = random.random_range(-0.02..0.02);
        }
        let turn = r + 0.004 * random.random_range(-1.0..1.0);
        let rudder = command - 0.4 * turn;
        writeln!(text, "{},{rudder},{turn}", f64::from(i) * dt).unwrap();
        r = decay * r + (1.0 - decay) / damping * gain * rudder;
    }
    text
}

#[test]
fn an_input_that_follows_the_states_is_told() {
    let desk = desk();
    desk.write("held.fdm", MODEL.replace("[1/s] = 0;", "[1/s] = 1;"));
    desk.write("loop.csv", steered(3));
    let of = |words: &str| desk.json(words);
    let found = of("diagnose held.fdm --data loop.csv --zoh rudder --json -q");
    let input = &found["feedback"]["inputs"][0];
    assert!(input["input"] == "rudder" && input["explained"].as_f64().unwrap() > 0.8, "{input}");
    // what the rudder does and what the damping does is one thing in such a record: what the rudder does cannot be seen to change
    let hidden: Vec<String> = found["feedback"]["hidden"]
        .as_array()
        .unwrap()
        .iter()
        .map(|p| {
            let targets: Vec<&str> = p["targets"].as_array().unwrap().iter().map(|t| t.as_str().unwrap()).collect();
            format!("{}({})", p["effect"].as_str().unwrap(), targets.join(", "))
        })
        .collect();
    for parameter in ["time_varying_parameter(K)", "input_scale(rudder)"] {
        assert!(hidden.iter().any(|place| place == parameter), "{hidden:?}");
    }
    let said = desk.good("diagnose held.fdm --data loop.csv --zoh rudder -q --verbose");
    assert!(said.contains("rudder follows the states"), "{said}");
    let brief = desk.good("diagnose held.fdm --data loop.csv --zoh rudder -q");
    assert!(brief.contains("rudder follows the states") && !brief.contains("what these records hide"), "{brief}");
    assert!(
        said.contains(&format!(
            "what these records hide, as the fitted parameters make up for nearly all of it: {}",
            hidden.join(", ")
        )),
        "{said}"
    );
    let open = of("diagnose yaw.fdm --data one.csv --only sensor_lag,output_delay --json -q");
    assert!(open["feedback"].is_null(), "{}", open["feedback"]);
}

#[test]
fn effects_are_chosen_by_name() {
    let desk = desk();
    let all = desk.good("effects yaw.fdm");
    let some = desk.good("effects yaw.fdm --only input_delay,sensor_lag");
    assert!(
        all.contains("product_term") && some.contains("sensor_lag(turn)") && !some.contains("product_term"),
        "{some}"
    );
    assert!(!desk.good("effects yaw.fdm --without product_term").contains("product_term"));
    let said = desk.refused("diagnose yaw.fdm --data one.csv --only input_delai");
    assert!(said.contains("did you mean `input_delay`?"), "{said}");
}
