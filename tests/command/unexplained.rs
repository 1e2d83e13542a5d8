//! Records that do not belong to their model: the first line names the output, and what the doctor says of the record.

use support::command::{printed, said};
use support::{Desk, Normal};

/// A plant on a spring with two outputs, away from its true values.
const PLANT: &str = "model plant { input u [N]; state x [m] = free, v [m/s] = free;
param k = 2 in [0.1, 50] [1/s^2], d = 0.5 in [0, 20] [1/s], b = 1 in [-20, 20] [1/kg];
der(x) = v; der(v) = b*u - k*x - d*v; output place [m] = x, speed [m/s] = v; }\n";

/// Its record: place and speed as `of` makes them.
fn record(of: impl Fn(f64, f64) -> (f64, f64)) -> String {
    let (mut x, mut v, mut normal) = (0.1, 0.0, Normal(19));
    let mut text = String::from("t [s],u,place,speed\n");
    for k in 0..240 {
        let t = 0.05 * f64::from(k);
        let (place, speed) = of(x + 0.003 * normal.next(), v + 0.005 * normal.next());
        text += &format!("{t},{},{place},{speed}\n", force(t));
        let n = 40;
        for i in 0..n {
            // halved steps in the middle: error of second order, far below the noise
            let (h, t) = (0.05 / f64::from(n), t + 0.05 * f64::from(i) / f64::from(n));
            let rate = |x: f64, v: f64, t: f64| 1.4 * between(t) - 5.0 * x - 0.8 * v;
            let (xm, vm) = (x + 0.5 * h * v, v + 0.5 * h * rate(x, v, t));
            (x, v) = (x + h * vm, v + h * rate(xm, vm, t + 0.5 * h));
        }
    }
    text
}

fn force(t: f64) -> f64 {
    (1.1 * t).sin() + 0.7 * (2.7 * t).cos()
}

/// The force on the lines between samples, as the program takes it.
fn between(t: f64) -> f64 {
    let k = (t / 0.05).floor();
    let part = t / 0.05 - k;
    (1.0 - part) * force(0.05 * k) + part * force(0.05 * (k + 1.0))
}

fn fitted(desk: &Desk) -> String {
    let output = desk.fdm("fit plant.fdm --data run.csv");
    let all = printed(&output);
    assert!(output.status.code().is_some_and(|code| code < 2), "{all}{}", said(&output));
    all
}

#[test]
fn what_an_output_is_not_explained_by_stands_in_the_first_lines() {
    let desk = Desk::with([("plant.fdm", PLANT)]);
    type Plant = fn(f64, f64) -> (f64, f64);
    let planted: [(&str, Plant, &str); 3] = [
        ("`place` is not explained", |x, v| (x + 100.0, v), ""),
        ("`speed` is not explained", |x, v| (x, 57.29578 * v), "`speed`: "),
        ("`speed` runs against the model", |x, v| (x, -v), "`speed`: sign"),
    ];
    for (first, plant, cause) in planted {
        desk.write("run.csv", record(plant));
        let all = fitted(&desk);
        let head: Vec<&str> = all.lines().skip(1).take(2).collect();
        assert!(head[0].contains(first), "{all}");
        assert!(
            head[0].contains("response") || head.get(1).is_some_and(|line| line.starts_with("`fdm doctor` says")),
            "{all}"
        );
        assert!(head.get(1).is_some_and(|line| line.contains(cause)), "{all}");
    }
    let document = desk.json("fit plant.fdm --data run.csv --json");
    assert_eq!(document["first_cause"]["channels"][0], "speed");
    assert_eq!(document["remarks"][0]["about"], "unexplained");
}

#[test]
fn a_record_that_belongs_to_its_model_is_explained() {
    let desk = Desk::with([("plant.fdm", PLANT)]);
    desk.write("run.csv", record(|x, v| (x, v)));
    let all = fitted(&desk);
    assert!(!all.contains("explained") && !all.contains("fdm doctor"), "{all}");
}

#[test]
fn an_unused_input_and_an_output_of_another_scale_are_no_panic() {
    let text = "model m { input u; state A = 1, C; param k = 0.05 [1/s]; der(A) = -k*A; der(C) = k*A; output a = A, c = C; }\n";
    let desk = Desk::with([("m.fdm", text)]);
    let row = |i: u32| {
        let t = 4.0 * f64::from(i);
        let a = (-0.03 * t).exp();
        format!("{t},1,{:.4},{:.4}\n", a, 0.2 * (1.0 - a))
    };
    desk.write("run.csv", format!("t [s],u,a,c\n{}", (0..15).map(row).collect::<String>()));
    let output = desk.fdm("fit m.fdm --data run.csv");
    assert!(output.status.code().is_some_and(|code| code < 2), "{}", said(&output));
    assert!(printed(&output).contains("`c` is not explained"), "{}", printed(&output));
}
