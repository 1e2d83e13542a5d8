//! Pages of results without a browser: the same from memory and from the folder, figures by name, the server of one machine.

use crate::pixels::Pixels;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::Stdio;
use support::Desk;

const MODEL: &str = "model decay \"first order with an offset\" {
  input u [deg];
  state x = free;
  param k = 1 in [0, 50] [1/s] \"damping\", g_u = 1;
  param bias = 0 per run;
  der(x) = -k*x + g_u*u;
  output y = x + bias;
}
";

/// A folder with a model, two runs and a result.
fn desk() -> Desk {
    let desk = Desk::with([("model.fdm", MODEL.to_string()), ("one.csv", record(0.7)), ("two.csv", record(-0.4))]);
    desk.good("fit model.fdm --data one.csv --zoh u -q --out result --report page.html");
    desk
}

/// x' = -2 x + 3 u under a held square wave, exactly, with a ripple that stands for noise.
fn record(start: f64) -> String {
    let (k, g, dt) = (2.0, 3.0, 0.05);
    let mut x: f64 = start;
    let mut rows = String::from("t [s],u [deg],y\n");
    for n in 0..160 {
        let u = if (0.11 * f64::from(n)).sin() > 0.0 { 1.0 } else { -1.0 };
        let ripple = 0.01 * (f64::from(n * n) * 0.7).sin();
        rows.push_str(&format!("{:.2},{u},{}\n", dt * f64::from(n), x + 0.3 + ripple));
        x = (x - g / k * u) * (-k * dt).exp() + g / k * u;
    }
    rows
}

#[test]
fn memory_and_folder_give_the_same_page() {
    let desk = desk();
    assert!(desk.good("report result").ends_with("report.html\n"));
    let page = desk.text("page.html");
    assert!(page == desk.text("result/report.html") && page == desk.good("report result -o -"));
    for expected in
        ["<math ", "<msub><mi>g</mi>", "id=\"modes\"", "id=\"history-1-1\"", "damping", "result --report page.html"]
    {
        assert!(page.contains(expected), "{expected}");
    }
    // names of vocabularies, which no browser asks for
    assert_eq!(page.matches("http://").count(), page.matches("http://www.w3.org/").count());
    assert!(!page.contains("https://"));
    // a page in the folder does not make it another result, nor does it stand in the way of the next
    desk.good("fit model.fdm --data one.csv --zoh u -q --out result");
    desk.write("result/model.fdm", "model other { output y = 1; }");
    assert!(
        desk.refused("report result")
            .contains("changed or missing since it was written, and not to be trusted: model.fdm")
    );
    assert!(desk.refused("report none").contains("none"));
    assert!(desk.refused("fit model.fdm --data one.csv --report none/page.html -q").contains("none/page.html"));
}

#[test]
fn what_the_page_tells_the_result_has_for_programs_too() {
    let desk = desk();
    let result: Value = serde_json::from_str(&desk.text("result/result.json")).unwrap();
    let mode = &result["modes"]["modes"][0];
    let k = result["parameters"].as_array().unwrap().iter().find(|p| p["name"] == "k").unwrap();
    let close = |a: &Value, b: f64| (a.as_f64().unwrap() - b).abs() < 1e-9 * b.abs();
    assert!(close(&mode["re"], -k["value"].as_f64().unwrap()), "{mode}");
    let error = k["corrected_error"].as_f64().or(k["standard_error"].as_f64()).unwrap();
    assert!(close(&mode["standard_errors"]["re"], error), "{mode} {error}");
    assert!(result["remarks"].as_array().unwrap().iter().all(|r| r["about"].is_string() && r["sentence"].is_string()));
}

#[test]
fn validations_have_pages_and_say_so() {
    let desk = desk();
    desk.good("validate --from-result result --data two.csv --zoh u -q --report valid.html");
    let page = desk.text("valid.html");
    assert!(page.contains("decay: validation") && page.contains("The validation converged") && page.contains("two"));
}

#[test]
fn figures_have_names_and_become_files() {
    let desk = desk();
    let list = desk.good("plot result");
    assert!(list.lines().any(|l| l.starts_with("history-1-1 ")) && list.contains("autocorrelation-1"), "{list}");
    desk.good("plot result --figure history-1-1 -o y.svg");
    let svg = desk.text("y.svg");
    assert!(svg.starts_with("<svg xmlns=") && svg.trim_end().ends_with("</svg>") && svg.contains("measured"));
    assert_eq!(svg, desk.good("plot result --figure history-1-1"));
    assert!(desk.refused("plot result --figure history-1-2").contains("did you mean `history-1-1`?"));
    assert!(desk.refused("plot result --figure history-1-1 -o y.jpg").contains(".svg or .png"));
    assert!(desk.refused("plot result --figure history-1-1 -o y.svg --width 100").contains("belongs to PNG"));
    for figure in ["residual-spectrum-1", "residual-histogram-1", "eigenvalues", "convergence-1"] {
        assert!(list.lines().any(|l| l.split(' ').next() == Some(figure)), "{figure}: {list}");
        assert!(desk.text("page.html").contains(&format!("id=\"{figure}\"")), "{figure}");
        assert!(desk.good(&format!("plot result --figure {figure}")).contains("<svg xmlns="));
    }
}

#[test]
fn pixels_are_as_many_as_asked_and_the_same_every_time() {
    let desk = desk();
    let drawn = |words: &str| {
        desk.good(&format!("plot result {words} -o y.png"));
        let bytes = std::fs::read(desk.path("y.png")).unwrap();
        (Pixels::read(&desk.path("y.png")), bytes)
    };
    let figure = "--figure history-1-1 --width 760";
    let (light, bytes) = drawn(figure);
    assert_eq!(drawn(figure).1, bytes);
    // the drawing is 760 wide, its head 44, its panels 210 and 90, with 8, 16 and 40 around them
    assert_eq!((light.width, light.height), (760, 408));
    assert_eq!(drawn("--figure history-1-1").0.width, 1520);
    let (dark, _) = drawn(&format!("{figure} --dark"));
    assert_eq!((light.at(1, 1), dark.at(1, 1)), ([255, 255, 255], [0x14, 0x17, 0x1a]));
    // letters in the caption, lines of the measurement and of the model in the first panel
    let inked = |p: &Pixels, area: [usize; 4], is: fn(u8, u8, u8) -> bool| {
        let rows = area[2]..area[3];
        rows.flat_map(|y| (area[0]..area[1]).map(move |x| (x, y)))
            .filter(|(x, y)| {
                let [r, g, b] = p.at(*x, *y);
                is(r, g, b)
            })
            .count()
    };
    let caption = [66, 700, 5, 22];
    assert!(inked(&light, caption, |r, g, b| r.max(g).max(b) < 120) > 300, "the caption is drawn");
    assert!(inked(&dark, caption, |r, g, b| r.min(g).min(b) > 150) > 300, "the caption is drawn in the dark");
    let panel = [70, 740, 55, 260];
    assert!(inked(&light, panel, |r, g, b| r > 180 && g < 140 && b < 80) > 200, "the model is drawn");
    assert!(desk.refused("plot result --figure history-1-1 -o y.png --width 5").contains("--width"));
}

#[test]
fn a_study_has_a_page_and_figures() {
    let desk = desk();
    desk.good("study model.fdm --data one.csv --zoh u --repeats 60 -q --out kept --report study.html");
    let page = desk.text("study.html");
    assert!(page == desk.good("report kept -o -"));
    let expected = [
        "decay: study",
        "Nominal 95 % intervals hold the truth in ",
        "over 60 repeats with white noise",
        "id=\"coverage-1\"",
        "id=\"scatter-1\"",
        "id=\"estimates-3\"",
        "What became of the repeats",
        "id=\"history-1-1\"",
    ];
    for words in expected {
        assert!(page.contains(words), "{words}");
    }
    let list = desk.good("plot kept");
    assert!(list.starts_with("coverage-1 ") && list.contains("estimates-1 "), "{list}");
    // every repeat is in a column of the histogram or counted beside it
    let block = |id: &str| -> Value {
        let figure = page.split(&format!("id=\"{id}\"")).nth(1).unwrap();
        let data = figure.split("application/json\">").nth(1).unwrap().split("</script>").next().unwrap();
        serde_json::from_str(data).unwrap()
    };
    let counts = &block("estimates-2")["panels"][0]["marks"][0]["values"];
    let sum: f64 = counts.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).sum();
    assert_eq!(sum, 60.0, "none is beyond four errors");
    // what the figure shows is what the result says
    let study: Value = serde_json::from_str(&desk.text("kept/study.json")).unwrap();
    let share = study["parameters"][1]["intervals"][1]["coverage"]["share"].as_f64().unwrap();
    let figure = block("coverage-1");
    let place = figure["names"]
        .as_array()
        .unwrap()
        .iter()
        .position(|n| n.as_str().unwrap().starts_with("k of one, ") || n == "k, corrected");
    let dots = figure["panels"][0]["marks"].as_array().unwrap().iter().find(|m| m["name"] == "corrected").unwrap();
    // figures keep eight digits
    let dot = dots["values"][place.unwrap()].as_f64().unwrap();
    assert!((dot - 100.0 * share).abs() < 1e-5, "{dot} {share}");
}

#[test]
fn regressions_have_a_folder_and_a_page() {
    let desk = desk();
    let text = MODEL.replace("  param bias = 0 per run;\n", "").replace("x + bias", "x");
    desk.write("plain.fdm", text);
    desk.good("regress plain.fdm --data one.csv --zoh u -q --dependence --out kept --report rates.html");
    let page = desk.text("rates.html");
    assert!(page == desk.good("report kept -o -"));
    for words in [
        "decay: equation error",
        "The regression explains ",
        "id=\"components-1\"",
        "id=\"cutoff-1\"",
        "id=\"part-2\"",
        "multiplies",
    ] {
        assert!(page.contains(words), "{words}");
    }
    assert!(desk.good("plot kept").contains("components-1 "));
    // its parameters simulate, and its modes claim no errors that nobody computed
    assert!(desk.good("simulate --from-result kept --data one.csv --zoh u").starts_with("t"));
    let result: Value = serde_json::from_str(&desk.text("kept/result.json")).unwrap();
    let k =
        result["parameters"].as_array().unwrap().iter().find(|p| p["name"] == "k").unwrap()["value"].as_f64().unwrap();
    let mode = &result["modes"]["modes"][0];
    assert!((mode["re"].as_f64().unwrap() + k).abs() < 1e-12 && mode["standard_errors"].is_null(), "{mode}");
    assert!(!desk.good("modes --from-result kept").contains("standard error"));
    let said = desk.refused("regress plain.fdm --data one.csv --zoh u -q --recursive --out other");
    assert!(said.contains("--out"), "{said}");
}

#[test]
fn many_starts_have_a_waterfall() {
    let desk = desk();
    desk.good("fit model.fdm --data one.csv --zoh u --starts 6 -q --out many");
    let list = desk.good("plot many");
    assert!(list.lines().any(|l| l.starts_with("starts-1 ")), "{list}");
    let page = desk.good("report many -o -");
    assert!(page.contains("6 starts: ") && page.contains("cost above the best"));
}

#[test]
fn modes_that_are_left_out_are_told() {
    let desk = desk();
    let chain = |n: usize| {
        let states: Vec<String> = (1..=n).map(|k| format!("x{k} = 0")).collect();
        let mut text = format!("model chain {{ input u; state {}; param k = 5 in [1, 50];\n", states.join(", "));
        for k in 1..=n {
            let before = if k == 1 { "u".to_string() } else { format!("x{}", k - 1) };
            text.push_str(&format!("der(x{k}) = k*({before} - x{k});\n"));
        }
        text + &format!("output y = x{n}; }}\n")
    };
    desk.write("chain.fdm", chain(41));
    let mut rows = String::from("t [s],u,y\n");
    for n in 0..120_u32 {
        // the step through 41 lags of a fifth of a second comes after eight seconds
        let (t, ripple) = (0.1 * f64::from(n), 0.01 * (f64::from(n * n) * 0.7).sin());
        rows.push_str(&format!("{t:.1},1,{}\n", ripple + 1.0 / (1.0 + (-2.0 * (t - 8.2)).exp())));
    }
    desk.write("chain.csv", rows);
    desk.fdm("fit chain.fdm --data chain.csv -q --out large --report large.html");
    let page = desk.text("large.html");
    let said = "There is no map of the modes here: the model has 41 states, more than 40: <code>fdm modes --from-result DIR</code> shows its modes";
    assert!(page.contains(said), "{page:.3000}");
    let result: Value = serde_json::from_str(&desk.text("large/result.json")).unwrap();
    assert_eq!(result["modes"]["modes"], Value::Array(Vec::new()));
    let all: Value = desk.json("modes --from-result large --json");
    assert_eq!(all["modes"].as_array().unwrap().len(), 41);
}

#[test]
fn shapes_are_those_of_the_equations() {
    let desk = desk();
    let text =
        "model spring { input u [N]; state x = 0 [m], v = 0 [m/s]; param a = 4 [1/s^2], d = 0.4 [1/s], b = 1 [1/kg];
        der(x) = v; der(v) = -a*x - d*v + b*u; output y = x [m]; }";
    desk.write("spring.fdm", text);
    let modes: Value = desk.json("modes spring.fdm --json");
    for mode in modes["modes"].as_array().unwrap() {
        let (re, im) = (mode["re"].as_f64().unwrap(), mode["im"].as_f64().unwrap());
        let shape = mode["shape"].as_array().unwrap();
        let of = |name: &str, key: &str| shape.iter().find(|c| c["state"] == name).unwrap()[key].as_f64().unwrap();
        // v is the derivative of x: s times as large, and ahead by the angle of s
        assert!((of("v", "magnitude") / of("x", "magnitude") - re.hypot(im)).abs() < 1e-12, "{mode}");
        let ahead = (of("v", "phase") - of("x", "phase") - im.atan2(re).to_degrees()).rem_euclid(360.0);
        assert!(ahead.min(360.0 - ahead) < 1e-9, "{mode}");
        assert_eq!(of("v", "magnitude"), 1.0);
        assert_eq!(shape[1]["unit"], "m/s");
    }
}

#[test]
fn the_server_shows_the_page_to_this_machine_only() {
    let desk = desk();
    let mut server = desk.command("serve result").stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let address = line.trim().trim_start_matches("http://").trim_end_matches('/').to_string();
    let asked = |path: &str, host: &str| {
        let mut stream = TcpStream::connect(&address).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    };
    let page = asked("/page", &address);
    let state = asked("/state", &address);
    let (watch, foreign, nothing) =
        (asked("/", &address), asked("/page", "elsewhere.example"), asked("/../model.fdm", &address));
    desk.good("fit model.fdm --data two.csv --zoh u -q --out result");
    let later = asked("/state", &address);
    server.kill().unwrap();
    server.wait().unwrap();
    assert!(address.starts_with("127.0.0.1:"), "{line}");
    assert!(page.starts_with("HTTP/1.1 200") && page.ends_with(&desk.text("page.html")));
    assert!(watch.contains("iframe") && foreign.starts_with("HTTP/1.1 403") && nothing.starts_with("HTTP/1.1 404"));
    assert_ne!(state, later);
}
