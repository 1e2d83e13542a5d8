//! Records, models and options from which nothing can be learned: told with a remedy, and never a result with exit code 0.

use support::Desk;
use support::command::{printed, said};

const LIN: &str = "model lin { input u; state x = 0; param a = -1, b = 1; der(x) = a*x + b*u; output y = x; }\n";
const GAIN: &str = "model gain { input u; param a = 1; output y = a*u; }\n";

/// A gain, a lag, and a record of 60 samples a tenth apart that suits both.
fn desk() -> Desk {
    let desk = Desk::with([("lin.fdm", LIN), ("gain.fdm", GAIN)]);
    record(&desk, "run.csv", |k| Some((1.0 + f64::from(k % 3), 2.1 * f64::from(1 + k % 3) + rough(k))));
    record(&desk, "zero.csv", |_| Some((0.0, 0.0)));
    record(&desk, "constant.csv", |_| Some((1.0, 1.0)));
    record(&desk, "three.csv", |k| [5, 20, 50].contains(&k).then_some((1.0, 0.1 * f64::from(k))));
    desk
}

/// What stands for noise.
fn rough(k: u32) -> f64 {
    0.05 * (f64::from(k * k) * 0.7).sin()
}

/// Input and output of 60 samples; without an output where there are none.
fn record(desk: &Desk, name: &str, of: impl Fn(u32) -> Option<(f64, f64)>) {
    let row = |k: u32| {
        let t = f64::from(k) / 10.0;
        of(k).map_or_else(|| format!("{t},1,\n"), |(u, y)| format!("{t},{u},{y}\n"))
    };
    desk.write(name, format!("t [s],u,y\n{}", (0..60).map(row).collect::<String>()));
}

/// Exit code 1, and all that was said and printed.
fn went_wrong(desk: &Desk, words: &str) -> String {
    let output = desk.fdm(words);
    let all = printed(&output) + &said(&output);
    assert_eq!(output.status.code(), Some(1), "{words}: {all}");
    all
}

#[test]
fn regressions_that_determine_nothing_are_no_success() {
    let desk = desk();
    for words in [
        "regress lin.fdm --data zero.csv",
        "regress lin.fdm --data constant.csv",
        "regress lin.fdm --data zero.csv --recursive",
        "regress lin.fdm --data constant.csv --recursive",
        "regress lin.fdm --data three.csv --recursive",
        "fit lin.fdm --data zero.csv --method equation-error",
    ] {
        let all = went_wrong(&desk, &format!("{words} -q"));
        assert!(all.contains("nothing was determined") && !all.contains("over 0 rows"), "{words}: {all}");
    }
    for (more, told) in [
        ("--data three.csv", "no sample has all values"),
        ("--data three.csv --smooth fourier", "run `three` (three.csv): `x` has values at 3 of 60 samples"),
        ("--data run.csv --smooth fourier:1e9", "is not between 0.0847"),
        ("--data run.csv --smooth fourier:0.001", "and 5.0000 (half the sampling rate)"),
        ("--data run.csv --components 100", "der(x) has 2 parameters, so that 2 are the most"),
    ] {
        let said = desk.refused(&format!("regress lin.fdm {more} -q"));
        assert!(said.contains(told), "{more}: {said}");
    }
    desk.good("regress lin.fdm --data run.csv --smooth fourier:2 --components 2 -q");
}

#[test]
fn records_that_stand_still_are_not_diagnosed() {
    let said = desk().refused("diagnose lin.fdm --data constant.csv -q");
    assert!(said.contains("no output ever changes in any run"), "{said}");
}

#[test]
fn numbers_whose_squares_are_none_are_refused_with_their_channel() {
    let desk = desk();
    for (name, size) in [("huge.csv", 1e200), ("tiny.csv", 1e-200)] {
        record(&desk, name, |k| Some((size * (1.0 + f64::from(k % 3)), 2.0 * size)));
        for verb in ["fit gain.fdm", "spectra gain.fdm", "regress lin.fdm"] {
            let said = desk.refused(&format!("{verb} --data {name} -q"));
            assert!(said.contains(&format!("{name}: the output `y` reaches 2e")), "{verb}: {said}");
        }
    }
}

#[test]
fn segments_too_short_for_a_band_name_the_run_that_makes_them_short() {
    let desk = desk();
    let short: String = desk.text("run.csv").lines().take(10).map(|line| format!("{line}\n")).collect();
    desk.write("nine.csv", short);
    let said = desk.refused("spectra lin.fdm --data run.csv --data nine.csv --band 0.5:2 -q");
    assert!(said.contains("segments 0.8 long") && said.contains("run `nine` (nine.csv) is 0.8 long"), "{said}");
}

#[test]
fn deviations_that_are_not_above_zero_are_refused_with_their_place() {
    let desk = desk();
    for (start, noise, value) in [("-0.1", "s", "-0.1"), ("0", "s", "0"), ("-0.1", "s*u", "-0.1")] {
        desk.write(
            "own.fdm",
            format!("model own {{ input u; param a = 1, s = {start}; output y = a*u; noise y = {noise}; }}"),
        );
        let said = desk.refused("fit own.fdm --data run.csv -q");
        let told = format!("is {value} at time 0 with the start values");
        assert!(said.contains("run `run` (run.csv): the noise of `y`") && said.contains(&told), "{noise}: {said}");
    }
    // from far above the size stays above zero
    desk.write("own.fdm", "model own { input u; param a = 1, s = 10; output y = a*u; noise y = s; }");
    let found = desk.json("fit own.fdm --data run.csv -q --json");
    let size = found["parameters"][1]["value"].as_f64().unwrap();
    assert!(size > 0.01 && size < 0.1, "{size}");
}

#[test]
fn what_is_said_of_parameters_that_are_held_is_true() {
    let desk = desk();
    // the logarithm of 3 and back is beside 3
    desk.write("bound.fdm", "model bound { input u; param k = 0.5 in [1e-5, 3] log; output y = u + 1/k; }");
    record(&desk, "same.csv", |k| Some((f64::from(k % 3), f64::from(k % 3) + rough(k))));
    let printed = desk.good("fit bound.fdm --data same.csv -q");
    assert!(printed.contains("at its upper bound 3.000"), "{printed}");
    // nothing is free, so that no error was to be corrected; nothing has bounds
    let fixed = desk.good("fit gain.fdm --data run.csv --fix a -q");
    assert!(!fixed.contains("no more data than parameters"), "{fixed}");
    let still = went_wrong(&desk, "fit gain.fdm --data zero.csv -q");
    assert!(still.contains("at a bound, or has no influence"), "{still}");
}

#[test]
fn numbers_of_losses_have_sensible_ranges() {
    let desk = desk();
    for loss in ["huber:1e-300", "huber:1e300", "student:1e300"] {
        let said = desk.refused(&format!("fit gain.fdm --data run.csv --loss {loss} -q"));
        assert!(said.contains("from 0.01 to 100") && said.contains("from 1 to 1e6"), "{loss}: {said}");
    }
    desk.good("fit gain.fdm --data run.csv --loss huber:2 -q");
}

#[test]
fn two_values_for_one_name_are_refused() {
    let desk = desk();
    for (words, told) in
        [("--set a=1 --set a=2", "`a` is set to 1 and to 2"), ("--noise y=1 --noise y=2", "give one deviation of `y`")]
    {
        let said = desk.refused(&format!("fit gain.fdm --data run.csv {words} -q"));
        assert!(said.contains(told), "{words}: {said}");
    }
    let said = desk.refused("simulate gain.fdm --data run.csv --set a=1 --set a=2");
    assert!(said.contains("`a` is set to 1 and to 2"), "{said}");
    desk.good("fit gain.fdm --data run.csv --set a=1 --set a=1 -q");
}

/// Nobody writes to them, so that reading would wait for ever.
#[cfg(unix)]
#[test]
fn named_pipes_are_refused() {
    let desk = desk();
    for name in ["pipe.fdm", "pipe.csv"] {
        let made = std::process::Command::new("mkfifo").arg(desk.path(name)).status().unwrap();
        assert!(made.success());
    }
    desk.write("uses.fdm", "model uses { input u; use \"pipe.fdm\" as p; output y = u*p.one; }");
    for words in [
        "fit gain.fdm --data pipe.csv",
        "check pipe.fdm",
        "check uses.fdm",
        "fit pipe.fdm --data run.csv --plot new.svg",
        "fit gain.fdm --data run.csv --data pipe.csv",
    ] {
        let said = desk.refused(words);
        assert!(said.contains("a named pipe"), "{words}: {said}");
    }
}
