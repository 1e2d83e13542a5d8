//! What is known beyond the estimates: `fdm margins`, bands of `simulate` and `validate`, `fdm sample`.

use serde_json::Value;
use support::command::said;
use support::{Desk, Normal};

const MODEL: &str = "model decay \"first order with an offset of the gauge\" {
  input u [1];
  state x [1];
  param k = 1 in [0, 50] [1/s], g = 1 in [-10, 10] [1/s];
  param bias = 0 [1] per run;
  der(x) = -k*x + g*u;
  output y [1] = x + bias;
  requirement half [s] \"time to half\" = time_to_half(x) in [0.2, 0.5];
  requirement steady_gain = g/k in [1.6, inf];
}
";

/// x' = -2 x + 3 u under a held square wave, exactly, with noise of 0.05.
fn record(seed: u64, bias: f64, samples: usize) -> String {
    moved_by(|n| (0.11 * n).sin(), seed, bias, samples)
}

/// The same under the sign of another input, of the number of the sample.
fn moved_by(input: fn(f64) -> f64, seed: u64, bias: f64, samples: usize) -> String {
    let (k, g, dt) = (2.0, 3.0, 0.05);
    let (mut x, mut noise) = (0.0_f64, Normal(seed));
    let mut rows = String::from("t [s],u,y\n");
    for n in 0..samples {
        let u = if input(n as f64) > 0.0 { 1.0 } else { -1.0 };
        rows.push_str(&format!("{},{u},{}\n", dt * n as f64, x + bias + 0.05 * noise.next()));
        x = (x - g / k * u) * (-k * dt).exp() + g / k * u;
    }
    rows
}

fn desk() -> Desk {
    let desk = Desk::with([("model.fdm", MODEL)]);
    desk.write("one.csv", record(1, 0.3, 200));
    desk.write("two.csv", record(2, -0.2, 200));
    desk.good("fit model.fdm --data one.csv --zoh u --out result -q");
    desk
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

/// Exit code, what was printed, and what was said beside it.
fn ran(desk: &Desk, words: &[&str]) -> (i32, String, String) {
    let output = desk.command_of(words).output().unwrap();
    let printed = String::from_utf8(output.stdout.clone()).unwrap();
    (output.status.code().unwrap(), printed, said(&output))
}

fn split(words: &str) -> Vec<&str> {
    words.split(' ').collect()
}

#[test]
fn margins_tell_requirements_with_their_probability() {
    let desk = desk();
    let found = json(&desk.good("margins result --json"));
    let requirement = |k: usize| &found["requirements"][k];
    let half = requirement(0);
    let (value, interval) = (half["value"].as_f64().unwrap(), &half["interval"]);
    assert!((value - 2f64.ln() / 2.0).abs() < 0.02, "{half}");
    let ends = [interval[0].as_f64().unwrap(), interval[1].as_f64().unwrap()];
    assert!(ends[0] < 2f64.ln() / 2.0 && 2f64.ln() / 2.0 < ends[1] && ends[1] - ends[0] < 0.1, "{half}");
    assert!(half["probability"].as_f64().unwrap() > 0.999 && half["unit"] == "s", "{half}");
    // 1.5 is not above 1.6
    assert!(requirement(1)["probability"].as_f64().unwrap() < 0.05);
    assert!((found["modes"][0]["re"].as_f64().unwrap() + 2.0).abs() < 0.15);
    // the fit has them in its own result, to the bit
    assert_eq!(json(&desk.text("result/result.json"))["requirements"], found["requirements"]);
    let text = desk.good("margins result");
    assert!(
        text.contains("of 2 requirements 1 hold with 95 % probability or more, 1 with 5 % or less, 0 are open"),
        "{text}"
    );
    assert_eq!(desk.good("margins result --threads 1 --json"), desk.good("margins result --threads 2 --json"));
    // asked for at the command line, units and all
    let asked = "top [1] = maximum(y, 5, step(u, 1)) in [1, 2]";
    let found = json(&ran(&desk, &["margins", "result", "--json", "--draws", "0", "--requirement", asked]).1);
    let top = &found["requirements"][2];
    // the offset belongs to the gauge of that run
    assert!((top["value"].as_f64().unwrap() - 1.8).abs() < 0.05 && top["by"] == "linear", "{top}");
    desk.good("report result -o page.html");
    assert!(desk.text("page.html").contains("Requirements"));
}

#[test]
fn what_is_wrong_with_a_requirement_is_told_with_its_place() {
    let desk = desk();
    let asked = |requirement: &str| ran(&desk, &["margins", "result", "--requirement", requirement]);
    let (code, _, error) = asked("r = mode_dampin(x)");
    assert!(code == 2 && error.contains("did you mean `mode_damping(x)`"), "{error}");
    let (code, _, error) = asked("r [s] = k");
    assert!(code == 2 && error.contains("E0602"), "{error}");
    let (code, _, error) = ran(&desk, &["margins", "nothing"]);
    assert!(code == 2, "{error}");
    // a value that does not exist: numbers went wrong
    let (code, printed, error) = asked("r = time_to_double(x)");
    assert!(code == 1 && printed.contains("does not grow"), "{printed}{error}");
}

#[test]
fn bands_lie_around_the_response_and_hold() {
    let desk = desk();
    let table = desk.good("simulate --from-result result --data two.csv --zoh u --like one --bands");
    let mut lines = table.lines();
    assert_eq!(lines.next(), Some("t [s],y [1],y_low [1],y_high [1],y_measured_low [1],y_measured_high [1]"));
    for line in lines {
        let row: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
        assert!(row[4] < row[2] && row[2] <= row[1] && row[1] <= row[3] && row[3] < row[5], "{line}");
        assert!((0.05..0.16).contains(&(row[5] - row[1])), "{line}");
    }
    let found = json(&desk.good("validate --from-result result --data two.csv --zoh u --json -q"));
    let band = &found["validation"]["bands"][0];
    let within = band["within"].as_f64().unwrap();
    assert!((0.88..=1.0).contains(&within), "{band}");
    desk.good("validate --from-result result --data two.csv --zoh u --out validated -q");
    let table = desk.text("validated/run_1_two.csv");
    assert!(
        table.starts_with("t [s],u [1],y [1],y_model [1],y_residual [1],y_low [1],y_high [1],y_measured_low [1]"),
        "{table}"
    );
    let (code, _, error) = ran(&desk, &split("simulate model.fdm --data two.csv --bands"));
    assert!(code == 2 && error.contains("--from-result"), "{error}");
}

#[test]
fn draws_agree_with_the_fit_where_that_is_normal_and_arviz_reads_them() {
    let desk = desk();
    let words = "sample result --chains 2 --draws 1000 --warmup 200 --seed 5 --arviz draws.json --bands --json -q";
    let (code, text, error) = ran(&desk, &split(words));
    assert!(code == 0, "{error}");
    let found = json(&text);
    let fitted = json(&desk.text("result/result.json"));
    for name in ["k", "g", "bias"] {
        let all = fitted["parameters"].as_array().unwrap();
        let fit = all.iter().find(|p| p["name"] == name).unwrap();
        let drawn = found["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap();
        let number = |v: &Value| v.as_f64().unwrap();
        let error = number(&fit["standard_error"]);
        assert!((number(&drawn["mean"]) - number(&fit["value"])).abs() < 0.3 * error, "{drawn} {fit}");
        assert!((number(&drawn["deviation"]) / error - 1.0).abs() < 0.2, "{drawn} {fit}");
    }
    assert_eq!(found["bands"][0]["response"][0].as_array().unwrap().len(), 200);
    let draws = json(&desk.text("draws.json"));
    assert_eq!(draws["posterior"]["k"].as_array().unwrap().len(), 2);
    assert_eq!(draws["posterior"]["bias[one]"][0].as_array().unwrap().len(), 1000);
    assert_eq!(draws["sample_stats"]["diverging"][1].as_array().unwrap().len(), 1000);
    let again = "sample result --chains 2 --draws 50 --warmup 50 --seed 5 --json -q";
    let with = |threads: &str| ran(&desk, &split(&format!("{again} --threads {threads}"))).1;
    assert_eq!(with("1"), with("2"));
    let (code, _, error) = ran(&desk, &split("sample result --arviz draws.json"));
    assert!(code == 2 && error.contains("exists already"), "{error}");
    let page = "sample result --chains 2 --draws 1000 --warmup 200 --seed 5 --report page.html";
    let (_, text, _) = ran(&desk, &split(page));
    assert!(text.lines().nth(1).unwrap().starts_with("the chains agree"), "{text}");
    let page = desk.text("page.html");
    for part in ["Traces and ranks", "id=\"trace-1\"", "id=\"ranks-2\"", "id=\"prediction-1\"", "95 % of measurements"]
    {
        assert!(page.contains(part), "{part}");
    }
}

#[test]
fn draws_are_as_wide_as_the_corrected_errors_where_residuals_are_coloured() {
    let desk = Desk::with([("model.fdm", MODEL)]);
    // the same motion in noise of first order, rho = 0.9
    let (mut noise, mut e) = (Normal(8), 0.0);
    let clean = record(1, 0.3, 600).replace('\r', "");
    let rows = clean.lines().skip(1).map(|row| {
        e = 0.9 * e + 0.19_f64.sqrt() * noise.next();
        let (head, y) = row.rsplit_once(',').unwrap();
        format!("{head},{}\n", y.parse::<f64>().unwrap() + 0.2 * e)
    });
    let rows: String = rows.collect();
    desk.write("one.csv", format!("t [s],u,y\n{rows}"));
    desk.good("fit model.fdm --data one.csv --zoh u --out result -q");
    let fit = json(&desk.text("result/result.json"));
    let words = "sample result --chains 2 --draws 250 --warmup 150 --seed 2 --json -q";
    let (_, wide, said) = ran(&desk, &split(words));
    assert!(said.contains("the likelihood is widened to the corrected errors"), "{said}");
    let (_, white, said) = ran(&desk, &split(&format!("{words} --white")));
    assert!(said.contains("draws take them for that"), "{said}");
    let [wide, white] = [wide, white].map(|text| json(&text));
    assert!(wide["widened"][1].as_f64().unwrap() > 1.5 && white["widened"].is_null(), "{}", wide["widened"]);
    let deviation = |found: &Value, name: &str| {
        let all = found["parameters"].as_array().unwrap();
        all.iter().find(|p| p["name"] == name).unwrap()["deviation"].as_f64().unwrap()
    };
    for p in fit["parameters"].as_array().unwrap() {
        let (name, corrected) = (p["name"].as_str().unwrap(), p["corrected_error"].as_f64().unwrap());
        let cramer_rao = p["standard_error"].as_f64().unwrap();
        assert!((deviation(&wide, name) / corrected - 1.0).abs() < 0.25, "{p} {}", wide["parameters"]);
        assert!((deviation(&white, name) / cramer_rao - 1.0).abs() < 0.25, "{p} {}", white["parameters"]);
    }
    assert!(deviation(&wide, "noise y") > 1.5 * deviation(&white, "noise y"));
}

#[test]
fn ranks_of_a_calibration_are_uniform_and_depend_on_the_seed_alone() {
    let desk = Desk::with([("model.fdm", MODEL)]);
    desk.write("one.csv", record(1, 0.3, 30));
    let words = "study model.fdm --data one.csv --zoh u --calibration --repeats 20 --seed 3 --warmup 100 -q";
    let with = |more: &str| ran(&desk, &split(&format!("{words} {more}")));
    let (code, text, error) = with("--json --report ranks.html --threads 2");
    assert!(code == 0, "{text}{error}");
    let found = json(&text);
    assert_eq!(found["done"], 20);
    // k, g, bias, noise; every repeat has a rank
    let parameters = found["parameters"].as_array().unwrap();
    assert_eq!(parameters.len(), 4, "{found}");
    for p in parameters {
        let counts = p["counts"].as_array().unwrap();
        assert_eq!(counts.iter().filter_map(Value::as_u64).sum::<u64>(), 20, "{p}");
        assert!(p["p"].as_f64().unwrap() > 1e-3, "{p}");
    }
    assert_eq!(with("--json --threads 1").1, text);
    assert!(desk.text("ranks.html").contains("The ranks are uniform"));
    let (code, _, error) = with("--out folder");
    assert!(code == 2 && error.contains("--report and --json keep it"), "{error}");
}

#[test]
fn results_are_averaged_by_their_predictions() {
    let desk = desk();
    let richer = MODEL.replace("+ g*u;", "+ g*u - c*x*abs(x);").replace("param bias", "param c = 0 [1/s]; param bias");
    desk.write("richer.fdm", richer);
    desk.good("fit richer.fdm --data one.csv --zoh u --out richer -q");
    let found = json(&desk.good("compare result richer --data two.csv --zoh u --json --report page.html -q"));
    let averaged = &found["averaged"];
    assert_eq!(averaged["by"], "validation", "{averaged}");
    let weights: Vec<f64> = averaged["weights"].as_array().unwrap().iter().filter_map(Value::as_f64).collect();
    assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-9 && weights.iter().all(|w| *w > 0.01), "{weights:?}");
    let of =
        |name: &str| averaged["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).cloned().unwrap();
    let number = |v: &Value| v.as_f64().unwrap();
    let [k, c] = ["k", "c"].map(of);
    assert!((number(&k["weight"]) - 1.0).abs() < 1e-9 && (number(&c["weight"]) - weights[1]).abs() < 1e-9);
    assert!(number(&k["interval"][0]) < 2.0 && 2.0 < number(&k["interval"][1]), "{k}");
    // wider than where the structure is taken for certain
    let chosen = json(&desk.text("result/result.json"));
    let alone = chosen["parameters"].as_array().unwrap().iter().find(|p| p["name"] == "k").cloned().unwrap();
    let error = alone["corrected_error"].as_f64().unwrap_or_else(|| number(&alone["standard_error"]));
    assert!(number(&k["error"]) > error, "{k} {alone}");
    let output = &averaged["outputs"][0];
    assert!(number(&output["within"]) > 0.88 && (0.03..0.08).contains(&number(&output["rms"])), "{output}");
    let page = desk.text("page.html");
    assert!(page.contains("Averaged over the models") && page.contains("Validation data"), "{}", page.len());
    let found = json(&desk.good("compare result richer --json -q"));
    assert_eq!(found["averaged"]["by"], "criterion", "{}", found["averaged"]);
    let text = desk.good("compare result richer -q");
    assert!(text.contains("averaged over the models, weighted by AIC"), "{text}");
}

#[test]
fn the_terminal_tells_the_verdict_first_and_pages_show_responses() {
    let desk = desk();
    let text = desk.good("fit model.fdm --data one.csv --zoh u -q");
    assert!(text.lines().nth(1).unwrap().starts_with("The fit converged"), "{text}");
    assert!(desk.good("fit model.fdm --data one.csv --zoh u -q --verbose").len() >= text.len());
    // a square wave whose frequency rises
    desk.write("sweep.csv", moved_by(|n| (n * (0.02 + 4e-5 * n)).sin(), 3, 0.1, 3000));
    desk.good("fit model.fdm --data sweep.csv --zoh u --out swept -q");
    desk.good("report swept -o page.html");
    let page = desk.text("page.html");
    assert!(page.contains("Frequency responses") && page.contains("id=\"response-1\""));
    let bode = json(&desk.text("swept/result.json"))["bode"].clone();
    let pair = &bode[0];
    assert!(pair["output"] == "y" && pair["input"] == "u", "{bode}");
    // 3/(s + 2), where it is coherent
    let column = |name: &str| pair[name].as_array().unwrap().iter().filter_map(Value::as_f64).collect::<Vec<f64>>();
    let [frequency, decibels, model, coherence] = ["frequency", "decibels", "model_decibels", "coherence"].map(column);
    let mut seen = 0;
    for k in (0..frequency.len()).filter(|k| coherence[*k] > 0.95) {
        let w = std::f64::consts::TAU * frequency[k];
        let truth = 20.0 * (3.0 / (w * w + 4.0).sqrt()).log10();
        assert!(
            (decibels[k] - truth).abs() < 2.0 && (model[k] - truth).abs() < 2.0,
            "{w}: {} {} {truth}",
            decibels[k],
            model[k]
        );
        seen += 1;
    }
    assert!(seen >= 3, "{coherence:?}");
    desk.good("profile model.fdm --data one.csv --zoh u --parameter k --report profile.html -q");
    assert!(desk.text("profile.html").contains("id=\"profile-1\""));
    desk.good("spectra model.fdm --data one.csv --report spectra.html -q");
    assert!(desk.text("spectra.html").contains("id=\"response-1\""));
}

#[test]
fn the_best_models_of_a_diagnosis_are_averaged() {
    let desk = Desk::with([("model.fdm", MODEL)]);
    // what the model lacks is a lag of the actuator; one run is for validation
    for (name, seed) in [("one", 1), ("two", 2), ("three", 3)] {
        let mut noise = Normal(seed);
        let (dt, mut x, mut v) = (0.05, 0.0_f64, 0.0_f64);
        let mut rows = String::from("t [s],u,y\n");
        for n in 0..200 {
            let u = if (0.11 * f64::from(n) + seed as f64).sin() > 0.0 { 1.0 } else { -1.0 };
            rows.push_str(&format!("{},{u},{}\n", dt * f64::from(n), x + 0.1 + 0.03 * noise.next()));
            // the lag, in fifty steps
            let (k, a) = (2.0, 5.0_f64);
            for _ in 0..50 {
                v += dt / 50.0 * a * (u - v);
                x += dt / 50.0 * (3.0 * v - k * x);
            }
        }
        desk.write(&format!("{name}.csv"), rows);
    }
    let words = "diagnose model.fdm --data one.csv --data two.csv --validation three.csv --zoh u --only actuator_lag --only input_delay --out diagnosis -q";
    desk.good(words);
    let front = json(&desk.text("diagnosis/diagnosis.json"))["front"].as_array().unwrap().len();
    assert!(front >= 2, "{front}");
    let found = json(&desk.good("compare diagnosis --json -q --report page.html"));
    let candidates = found["candidates"].as_array().unwrap();
    assert!(candidates.len() >= front && candidates[0]["name"] != candidates[1]["name"], "{candidates:?}");
    let averaged = &found["averaged"];
    assert_eq!(averaged["by"], "validation", "{averaged}");
    let weights: Vec<f64> = averaged["weights"].as_array().unwrap().iter().filter_map(Value::as_f64).collect();
    // the model as it was given has none
    let given = candidates.iter().position(|c| c["name"] == "as given").unwrap();
    assert!(weights[given] < 0.01 && (weights.iter().sum::<f64>() - 1.0).abs() < 1e-9, "{weights:?}");
    let k = averaged["parameters"].as_array().unwrap().iter().find(|p| p["name"] == "k").unwrap();
    let [low, high] = [0, 1].map(|end| k["interval"][end].as_f64().unwrap());
    assert!(low < 2.0 && 2.0 < high, "{k}");
    assert!(!averaged["outputs"].as_array().unwrap().is_empty(), "{averaged}");
    let text = desk.good("compare diagnosis -q");
    assert!(text.lines().next().unwrap().contains("predict"), "{text}");
    assert!(desk.refused("compare diagnosis/../diagnosis --effects nothing.fdm").contains("nothing.fdm"));
}
