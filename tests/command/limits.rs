//! Limits that bind everything a command does, and numbers that are never printed as if they were results.

use std::fs;
use std::time::Instant;
use support::Desk;
use support::command::{printed, said};

const SWING: &str = "model swing {
  input u;
  state x = 1;
  state v = 0;
  param w = 1;
  der(x) = v;
  der(v) = u - w*w*sin(x);
  output y = x;
}
";

/// A swing at w = 1, every 1.2 s, by very short steps, with a ripple that stands for noise.
fn desk() -> Desk {
    let desk = Desk::with([("swing.fdm", SWING)]);
    let (mut x, mut v, h) = (1.0_f64, 0.0_f64, 1e-3);
    let mut rows = String::from("t,u,y\n");
    for k in 0..40 {
        let ripple = 1e-3 * (f64::from(k * k) * 0.7).sin();
        rows.push_str(&format!("{},0,{}\n", 1.2 * f64::from(k), x + ripple));
        for _ in 0..1200 {
            let middle = v - 0.5 * h * x.sin();
            x += h * middle;
            v = middle - 0.5 * h * x.sin();
        }
    }
    desk.write("run.csv", rows);
    desk
}

#[test]
fn integration_errors_above_a_thousandth_of_the_range_are_no_success() {
    let desk = desk();
    let rough = desk.fdm("simulate swing.fdm --data run.csv --steps 1");
    assert_eq!(rough.status.code(), Some(1));
    assert!(printed(&rough).lines().count() == 41, "what was computed is printed");
    let text = said(&rough);
    assert!(text.contains("is not integrated") && text.contains("`y` at time") && text.contains("state `"), "{text}");
    assert_eq!(desk.fdm("simulate swing.fdm --data run.csv").status.code(), Some(0));
    assert_eq!(desk.fdm("simulate swing.fdm --data run.csv --steps 32").status.code(), Some(0));

    let fitted = desk.fdm("fit swing.fdm --data run.csv --steps 1 --out result");
    assert_eq!(fitted.status.code(), Some(1), "{}", said(&fitted));
    assert!(said(&fitted).contains("the estimates are those of the steps, not of the model"), "{}", said(&fitted));
    assert!(desk.path("result/result.json").exists(), "the result is kept");
    assert!(fs::read_to_string(desk.path("result/result.txt")).unwrap().contains("integration error"));
    desk.good("fit swing.fdm --data run.csv -q");

    // predictions from sample to sample, and segments, are integrated too
    desk.write("noisy.fdm", SWING.replace("output", "param q = 0.01 in [0, 1];\n  noise der(v) = q;\n  output"));
    for words in ["noisy.fdm --method filter-error", "swing.fdm --shooting 8 --iterations 3"] {
        let fitted = desk.fdm(&format!("fit {words} --data run.csv --steps 1 -q"));
        assert_eq!(fitted.status.code(), Some(1), "{words}: {}", said(&fitted));
        assert!(said(&fitted).contains("not of the model"), "{words}: {}", said(&fitted));
    }
}

#[test]
fn a_response_that_is_finite_on_long_steps_only_is_none() {
    // the solution ends at t = 1
    let desk = Desk::with([("escape.fdm", "model escape { state x = 1; der(x) = x*x; output y = x; }\n")]);
    desk.write("run.csv", "t,y\n0,1\n0.6,2.5\n1.2,3\n1.8,4\n");
    let outcome = desk.fdm("simulate escape.fdm --data run.csv --steps 1");
    assert_eq!(outcome.status.code(), Some(1), "{}", said(&outcome));
    assert!(said(&outcome).contains("not finite at time"), "{}", said(&outcome));
}

#[test]
fn the_accuracy_of_the_integration_is_a_choice() {
    let desk = desk();
    let steps = |words: &str| {
        let result = desk.json(&format!("simulate swing.fdm --data run.csv --json {words}"));
        (result[0]["steps"].as_u64().unwrap(), result[0]["integration_error"].as_f64().unwrap())
    };
    let (usual, rough) = (steps(""), steps("--integration-accuracy 1e-3"));
    assert!(rough.0 < usual.0 && rough.1 <= 1e-3, "{usual:?} {rough:?}");
    let fitted = |words: &str| desk.json(&format!("fit swing.fdm --data run.csv -q --json {words}"));
    assert!(fitted("--integration-accuracy 1e-4")["integration"][0]["error"].as_f64().is_some_and(|e| e <= 1e-3));
    let text = desk.refused("fit swing.fdm --data run.csv --integration-accuracy 0.5");
    assert!(text.contains("1e-13 to 1e-3"), "{text}");
}

#[test]
fn no_iterations_judge_the_start_values_at_once() {
    let desk = desk();
    let start = desk.fdm("fit swing.fdm --data run.csv --set w=4 --iterations 0 --json");
    assert_eq!(start.status.code(), Some(1), "{}", said(&start));
    let result: serde_json::Value = serde_json::from_slice(&start.stdout).unwrap();
    assert_eq!(result["parameters"][0]["value"].as_f64(), Some(4.0));
    assert_eq!((result["iterations"].as_u64(), result["fallback"].is_null()), (Some(0), true));
    assert_eq!(said(&start).matches("iteration   0").count(), 1, "one evaluation: {}", said(&start));
}

#[test]
fn a_time_limit_ends_every_long_command_with_what_it_has() {
    let desk = desk();
    desk.good("fit swing.fdm --data run.csv --out result -q");
    let long = ["study swing.fdm --data run.csv --repeats 1000000", "fit swing.fdm --data run.csv --starts 1000000"];
    for words in long {
        let begun = Instant::now();
        let output = desk.fdm(&format!("{words} -q --time-limit 2s"));
        assert_eq!(output.status.code(), Some(1), "{words}: {}", said(&output));
        assert!(said(&output).contains("stopped by --time-limit"), "{words}: {}", said(&output));
        assert!(!printed(&output).is_empty(), "{words}");
        // machines under load are slow to begin and to end
        assert!(begun.elapsed().as_secs() < 120, "{words}");
    }
    // where nothing is known yet, that is said
    let none = desk.fdm("diagnose swing.fdm --data run.csv -q --time-limit 0.001s");
    assert_eq!(none.status.code(), Some(1), "{}", said(&none));
    assert!(said(&none).contains("nothing was found yet") && printed(&none).is_empty(), "{}", said(&none));
    // a limit that is not reached changes nothing
    let whole = desk.good("fit swing.fdm --data run.csv -q");
    assert_eq!(desk.good("fit swing.fdm --data run.csv -q --time-limit 1h"), whole);
    for words in ["fit swing.fdm", "study swing.fdm", "profile swing.fdm", "regress swing.fdm", "diagnose swing.fdm"] {
        let text = desk.refused(&format!("{words} --data run.csv --time-limit soon"));
        assert!(text.contains("60s, 5m or 1h"), "{text}");
    }
}

#[test]
fn numbers_that_cannot_be_held_are_refused_with_their_place() {
    let desk = desk();
    let said = desk.refused("simulate swing.fdm --data run.csv --set w=1e-400");
    assert!(said.contains("`1e-400` is too small"), "{said}");
    let said = desk.refused("fit swing.fdm --data run.csv --tolerance 1e400");
    assert!(said.contains("`1e400` is too large"), "{said}");
    desk.write("small.fdm", SWING.replace("w = 1", "w = 1e-400"));
    let said = desk.refused("check small.fdm");
    assert!(said.contains("the number `1e-400` is too small") && said.contains("small.fdm:5"), "{said}");
    desk.write("small.csv", "t,u,y\n0,0,1\n1,1e-400,1\n2,0,1\n");
    let said = desk.refused("simulate swing.fdm --data small.csv");
    assert!(said.contains("line 3") && said.contains("1e-400"), "{said}");
}

/// Ten units of time between two samples, and events: a fit chooses its steps by the response, as a simulation does.
#[test]
fn a_fit_between_two_samples_takes_the_steps_of_a_simulation() {
    let text = "model pulse {
      param k1 = 0.9 in [0, 10], k2 = 0.5 in [0, 10]; state a = 1, b = 1;
      reactions { a -> b : k1*a; b -> a : k2*b; } when t >= 6 { a = a + 4; } output y = a; noise y = 0.5; }";
    let desk = Desk::with([("pulse.fdm", text), ("run.csv", "t,y\n0,0.7\n10,0.1\n")]);
    let fitted = printed(&desk.fdm("fit pulse.fdm --data run.csv --iterations 0"));
    // two amounts that turn into each other relax with k1 + k2 to their share of the sum
    let (rate, share): (f64, f64) = (1.4, 0.5 / 1.4);
    let at_6 = 2.0 * share + (1.0 - 2.0 * share) * (-rate * 6.0).exp();
    let y = 6.0 * share + (at_6 + 4.0 - 6.0 * share) * (-rate * 4.0).exp();
    let misfit = |z: f64, y: f64| -0.5 * ((z - y) / 0.5).powi(2) - (0.5 * (2.0 * std::f64::consts::PI).sqrt()).ln();
    let right = misfit(0.7, 1.0) + misfit(0.1, y);
    let found = fitted.split("log-likelihood ").nth(1).and_then(|rest| rest.split_whitespace().next());
    let found: f64 = found.unwrap().trim_end_matches([',', ';']).parse().unwrap();
    assert!((found - right).abs() < 1e-5, "{found} for {right}");
}

/// Start and end of a reaction whose middle becomes fast: steps chosen at the start values are too coarse for what is reached.
#[test]
fn steps_are_chosen_again_until_the_estimates_are_those_of_the_model() {
    let text = "model conv { known x0 per run; state X = x0, Y = 0;
      param k1 = 1e-5 in [0, 1], k2 = 1e-5 in [0, 100], k3 = 1e-3 in [0, 10];
      der(X) = -k1*X^2 + k2*X*Y; der(Y) = k1*X^2 - k2*X*Y - k3*Y; output x = X; }";
    let desk = Desk::with([("conv.fdm", text)]);
    desk.write("runs.csv", "file,x0\na.csv,68.1\nb.csv,71.9\nc.csv,36.2\nd.csv,39.3\n");
    for (name, x0, end) in [("a", 68.1, 45.1), ("b", 71.9, 46.6), ("c", 36.2, 24.3), ("d", 39.3, 29.2)] {
        desk.write(&format!("{name}.csv"), format!("t,x\n0,{x0}\n720,{end}\n"));
    }
    let chosen = desk.fdm("fit conv.fdm --runs runs.csv --json");
    assert!(!said(&chosen).contains("leave both to be chosen"), "{}", said(&chosen));
    let implicit = desk.fdm("fit conv.fdm --runs runs.csv --integrator radau --json");
    let cost = |run: &std::process::Output| {
        let document: serde_json::Value = serde_json::from_str(&printed(run)).unwrap();
        document["cost"].as_f64().unwrap()
    };
    assert!((cost(&chosen) - cost(&implicit)).abs() < 1e-2, "{} {}", cost(&chosen), cost(&implicit));
}
