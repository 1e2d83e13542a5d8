//! Inputs that were held between samples: stated, taken where they move at samples, else told by the likelihood. Records in closed form, or by a
//! Runge-Kutta integrator of their own.

use support::Desk;
use support::command::{printed, said};

const LAG: &str = "model lag { input u; state x = free; param T = 1 in [0.01, 20] [s], k = 1, b = 0; der(x) = (k*u - x)/T; \
                   output y = x + b; }\n";
const STEP: f64 = 0.05;

/// Sums of uniform numbers: normal enough.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// A lag of 0.4 s and gain 2 behind an input that is held or straight between samples.
fn record(u: &[f64], held: bool, seed: u64) -> String {
    let (mut x, mut noise, decay) = (2.0 * u[0], Noise(seed), (-STEP / 0.4_f64).exp());
    let mut text = String::from("t [s],u,y\n");
    for (k, value) in u.iter().enumerate() {
        text += &format!("{},{value:.6},{:.6}\n", STEP * k as f64, x + 0.02 * noise.next());
        let rise = if held { 0.0 } else { u.get(k + 1).map_or(0.0, |next| next - value) };
        x = x * decay + 2.0 * (value * (1.0 - decay) + rise * (1.0 - 0.4 / STEP * (1.0 - decay)));
    }
    text
}

fn smooth() -> Vec<f64> {
    (0..600).map(|k| (0.11 * f64::from(k)).sin() + 0.6 * (0.037 * f64::from(k) + 1.0).sin()).collect()
}

fn three_two_one_one() -> Vec<f64> {
    let level = |k: u32| match k % 300 {
        40..=99 | 140..=159 => 1.0,
        100..=139 | 160..=179 => -1.0,
        _ => 0.0,
    };
    (0..600).map(level).collect()
}

/// What `fdm fit` prints and says.
fn fitted(desk: &Desk, words: &str) -> (String, String) {
    let output = desk.fdm(&format!("fit {words}"));
    assert_eq!(output.status.code(), Some(0), "{words}: {}", said(&output));
    (printed(&output), said(&output))
}

/// The value of a parameter in a table.
fn value(table: &str, name: &str) -> f64 {
    let row = |line: &str| {
        let mut words = line.split_whitespace();
        words.next().filter(|first| *first == name)?;
        words.next()?.parse().ok()
    };
    table.lines().find_map(row).expect("a row of its own with a number")
}

fn desk() -> Desk {
    let desk = Desk::with([("lag.fdm", LAG), ("said.fdm", &LAG.replace("input u;", "input u held;")[..])]);
    desk.write("held.csv", record(&smooth(), true, 3));
    desk.write("straight.csv", record(&smooth(), false, 4));
    desk.write("steps.csv", record(&three_two_one_one(), true, 5));
    desk.write("ramps.csv", record(&three_two_one_one(), false, 6));
    desk
}

#[test]
fn a_hold_that_nobody_stated_is_the_first_remark_with_its_repair() {
    let desk = desk();
    let (table, _) = fitted(&desk, "lag.fdm --data held.csv");
    let remark = table.lines().find(|l| l.contains("the record says")).expect("a remark");
    assert!(
        remark.contains("`u` went held between samples") && remark.contains("`--zoh u`, `input u held;`"),
        "{remark}"
    );
    let first =
        table.lines().skip_while(|l| !l.trim_start().starts_with("y ")).find(|l| l.contains(": ") || l.contains("; "));
    assert_eq!(first, Some(remark), "{table}");
    assert!((value(&table, "T") - 0.4).abs() > 0.01, "half a sample late: {table}");
    for words in ["lag.fdm --data held.csv --zoh u", "said.fdm --data held.csv"] {
        let (table, _) = fitted(&desk, words);
        assert!((value(&table, "T") - 0.4).abs() < 0.005 && !table.contains("the record says"), "{words}: {table}");
    }
    let json = printed(&desk.fdm("fit lag.fdm --data held.csv --json"));
    assert!(json.contains("\"interpolations\"") && json.contains("\"evidence\""), "{json}");
}

#[test]
fn a_diagnosis_mends_a_hold_before_it_asks_what_the_model_lacks() {
    let desk = desk();
    let diagnosed = |record: &str| -> serde_json::Value {
        serde_json::from_str(&printed(&desk.fdm(&format!("diagnose lag.fdm --data {record} --json")))).unwrap()
    };
    let held = diagnosed("held.csv");
    let fault = &held["mended"]["faults"][0];
    assert_eq!((&held["verdict"], &fault["fault"]), (&"record_fault".into(), &"hold".into()), "{held}");
    assert!(fault["repair"]["line"].as_str().unwrap().contains("hold = true"), "{fault}");
    // a delay of half an interval is nearly the same, and no record is without a prior for it
    let probability = held["mended"]["probability"].as_f64().unwrap();
    assert!(probability > 0.9 && held["causes"].as_array().unwrap().is_empty(), "{probability} {}", held["causes"]);
    let output = &held["mended"]["outputs"][0];
    assert!(output["after"].as_f64().unwrap() < 0.025 && output["before"].as_f64().unwrap() > 0.03, "{output}");
    let straight = diagnosed("straight.csv");
    assert!(straight["mended"].is_null() && straight["verdict"] == "no_effect_found", "{straight}");
}

/// How an input goes between samples where nobody said so is a guess of the reader, and no effect is to explain that it was wrong.
#[test]
fn two_inputs_in_straight_lines_that_were_taken_for_held_are_no_delays() {
    let desk = desk();
    let late: Vec<f64> = three_two_one_one().iter().cycle().skip(230).take(600).copied().collect();
    let columns = |text: &str| -> Vec<String> { text.lines().map(|l| l.split_once(',').unwrap().1.into()).collect() };
    let (u, v) = (record(&three_two_one_one(), false, 7), record(&late, false, 8));
    let mut text = String::from("t [s],u,y,v,z\n");
    for (k, (own, other)) in columns(&u).iter().zip(columns(&v)).enumerate().skip(1) {
        text += &format!("{},{own},{other}\n", STEP * (k - 1) as f64);
    }
    desk.write("two.csv", text);
    let two = "model two { input u, v; state x = free, w = free; param T = 1 in [0.01, 20] [s], S = 1 in [0.01, 20] [s], k = 1, l = 1; \
               der(x) = (k*u - x)/T; der(w) = (l*v - w)/S; output y = x, z = w; }";
    desk.write("two.fdm", two);
    let found: serde_json::Value =
        serde_json::from_str(&printed(&desk.fdm("diagnose two.fdm --data two.csv --json --write linear.fdm"))).unwrap();
    let holds = found["mended"]["faults"].as_array().unwrap().iter().filter(|f| f["fault"] == "hold").count();
    assert_eq!((&found["verdict"], holds), (&"record_fault".into(), 2), "{found}");
    let extended = desk.text("linear.fdm");
    assert!(extended.contains("input u linear, v linear;"), "{extended}");
    let (table, notes) = fitted(&desk, "linear.fdm --data two.csv");
    assert!((value(&table, "T") - 0.4).abs() < 0.005 && !notes.contains("taken for held"), "{table} {notes}");
    assert!(found["causes"].as_array().unwrap().is_empty(), "{}", found["causes"]);
}

/// One logger writes all runs: steps in one of them are no reason to hold what goes in straight lines in another.
#[test]
fn a_run_of_steps_beside_a_smooth_one_goes_as_that_does() {
    let desk = desk();
    let asked = desk.fdm("diagnose lag.fdm --data straight.csv --data ramps.csv --json");
    let found: serde_json::Value = serde_json::from_str(&printed(&asked)).unwrap();
    let what = found["mended"]["faults"][0]["what"].as_str().unwrap_or_default();
    assert!(found["verdict"] == "record_fault" && what.contains("where it was held in some runs"), "{found}");
}

#[test]
fn straight_lines_are_not_doubted() {
    let desk = desk();
    let (table, said) = fitted(&desk, "lag.fdm --data straight.csv --verbose");
    assert!((value(&table, "T") - 0.4).abs() < 0.005, "{table}");
    assert!(!table.contains("held") && !said.contains("held"), "{table} {said}");
}

#[test]
fn what_moves_at_samples_is_taken_for_held_and_doubted_all_the_same() {
    let desk = desk();
    let (table, notes) = fitted(&desk, "lag.fdm --data steps.csv");
    assert!(notes.contains("`u` moves only at samples, all at once") && notes.contains("`--linear u`"), "{notes}");
    assert!((value(&table, "T") - 0.4).abs() < 0.005 && !table.contains("the record says"), "{table}");
    let (table, notes) = fitted(&desk, "lag.fdm --data ramps.csv");
    assert!(notes.contains("taken for held"), "{notes}");
    assert!(
        table.contains("`u` went in straight lines, not held") && table.contains("say so: `--linear u`"),
        "{table}"
    );
    let (table, notes) = fitted(&desk, "lag.fdm --data ramps.csv --linear u");
    assert!((value(&table, "T") - 0.4).abs() < 0.005 && !notes.contains("taken for held"), "{table} {notes}");
    desk.write("map.toml", "[channel.u]\nfrom = \"u\"\nhold = false\n[channel.y]\nfrom = \"y\"\n");
    let (table, notes) = fitted(&desk, "lag.fdm --data ramps.csv --map-file map.toml");
    assert!((value(&table, "T") - 0.4).abs() < 0.005 && !notes.contains("taken for held"), "{table} {notes}");
}

/// A single-track car, steered and driven by inputs that a controller holds for 20 ms.
#[test]
fn the_inertia_of_a_car_whose_steering_was_held() {
    let (cf, cr, iz, h) = (8.5e4, 1.2e5, 2500.0, 0.02);
    let rates = |x: [f64; 2], v: f64, d: f64| {
        let (front, rear) = (d - (x[0] + 1.2 * x[1]) / v, -(x[0] - 1.5 * x[1]) / v);
        let side = cf * front + cr * rear;
        ([side / 1600.0 - v * x[1], (1.2 * cf * front - 1.5 * cr * rear) / iz], side / 1600.0)
    };
    let (mut x, mut noise) = ([0.0; 2], Noise(11));
    let mut text = String::from("t [s],d [rad],v [m/s],r_m [rad/s],a_m [m/s^2]\n");
    for k in 0..1500 {
        let t = h * f64::from(k);
        let (v, d) = (21.0 + 1.5 * (0.2 * t).sin(), 0.04 * (std::f64::consts::TAU * (0.2 + 0.03 * t) * t).sin());
        let (_, a) = rates(x, v, d);
        text += &format!("{t:.2},{d:.7},{v:.5},{:.7},{:.6}\n", x[1] + 0.002 * noise.next(), a + 0.05 * noise.next());
        for _ in 0..8 {
            let s = h / 8.0;
            let moved = |by: [f64; 2], s: f64| [x[0] + s * by[0], x[1] + s * by[1]];
            let k1 = rates(x, v, d).0;
            let k2 = rates(moved(k1, s / 2.0), v, d).0;
            let k3 = rates(moved(k2, s / 2.0), v, d).0;
            let k4 = rates(moved(k3, s), v, d).0;
            (0..2).for_each(|i| x[i] += s / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        }
    }
    let model = "model car { input d [rad], v [m/s]; state vy = free [m/s], r = free [rad/s]; \
                 param Cf = 6e4 [N/rad], Cr = 6e4 [N/rad], Iz = 2000 [kg*m^2]; const m = 1600 [kg], lf = 1.2 [m], lr = 1.5 [m]; \
                 let af = d - (vy + lf*r)/v; let ar = -(vy - lr*r)/v; der(vy) = (Cf*af + Cr*ar)/m - v*r; \
                 der(r) = (lf*Cf*af - lr*Cr*ar)/Iz; output r_m [rad/s] = r, a_m [m/s^2] = (Cf*af + Cr*ar)/m; }\n";
    let desk = Desk::with([("car.fdm", model)]);
    desk.write("run.csv", text);
    let (table, _) = fitted(&desk, "car.fdm --data run.csv");
    assert!(table.contains("the record says that `d` went held between samples"), "{table}");
    assert!(!table.contains("`v` went held"), "{table}");
    let (table, _) = fitted(&desk, "car.fdm --data run.csv --zoh d");
    for (name, truth) in [("Cf", cf), ("Cr", cr), ("Iz", iz)] {
        assert!((value(&table, name) / truth - 1.0).abs() < 0.01, "{name}: {table}");
    }
}

#[test]
fn a_hold_is_said_of_inputs_once_and_shown() {
    let desk = desk();
    let refused = |words: &str| {
        let output = desk.fdm(words);
        assert_eq!(output.status.code(), Some(2), "{words}");
        said(&output)
    };
    let both = refused("fit lag.fdm --data held.csv --zoh u --linear u");
    assert!(both.contains("leave one of them out"), "{both}");
    assert!(refused("fit lag.fdm --data held.csv --linear y").contains("--linear `y`: only inputs"));
    desk.write("wrong.fdm", LAG.replace("k = 1,", "k = 1 held,"));
    assert!(refused("check wrong.fdm").contains("only inputs go between samples"));
    desk.write("slope.fdm", LAG.replace("input u;", "input u held;").replace("(k*u", "(k*u + 0*der(u)"));
    assert!(refused("fit slope.fdm --data held.csv").contains("takes its derivative"));
    assert!(printed(&desk.fdm("show said.fdm")).contains("input, held"));
}

/// A command of the instants `k STEP` that arrives 0.03 s late at a lag, and an output that was sampled 0.02 s before each; its stamps say otherwise.
fn of_another_clock(seed: u64) -> String {
    let (late, early, tau) = (0.03, 0.02, 0.4);
    let mut noise = Noise(seed);
    let levels: Vec<f64> = (0..200).map(|_| noise.next()).collect();
    let command = |k: usize| levels[k / 4];
    let mut text = String::from("t [s],u,y\n");
    // the command has arrived at `k STEP + late`: from the sample of row k on to there x goes on, and from there to the sample of row k + 1
    let (mut x, past) = (0.0, |k: usize| if k == 0 { 0.0 } else { command(k - 1) });
    for k in 0..800 {
        text += &format!("{},{:.6},{:.6}\n", STEP * k as f64, command(k), x + 0.01 * noise.next());
        let towards = |x: f64, goal: f64, time: f64| goal + (x - goal) * f64::exp(-time / tau);
        x = towards(x, 2.0 * past(k), early + late);
        x = towards(x, 2.0 * command(k), STEP - early - late);
    }
    text
}

#[test]
fn commands_of_another_clock_keep_their_edges_in_both_domains() {
    let desk = Desk::with([(
        "late.fdm",
        "model late { input u; state x = free; param T = 1 in [0.01, 20] [s], k = 1, late = 0.01 in [0, 0.5] [s]; \
         der(x) = (k*delay(u, late) - x)/T; output y = x; }\n",
    )]);
    desk.write("run.csv", of_another_clock(9));
    desk.write("map.toml", "[channel.u]\nfrom = \"u\"\nhold = true\n[channel.y]\nfrom = \"y\"\ndelay = 0.02\n");
    for domain in ["", " --domain frequency --band 0.05:3"] {
        let (table, said) = fitted(&desk, &format!("late.fdm --data run.csv --map-file map.toml{domain}"));
        for (name, truth, most) in [("T", 0.4, 0.02), ("k", 2.0, 0.04), ("late", 0.03, 0.004)] {
            let off = value(&table, name) - truth;
            assert!(off.abs() < most, "{name} is {off} off{domain}:\n{table}");
        }
        // nothing is missing where a command changes
        assert!(said.contains("commands change at") && !said.contains("missing values"), "{said}");
    }
}
