//! Filter error beside output error over many records: vehicles in turbulence, and an unstable one under feedback.

use support::model;
use support::turbulence::{CALM, TRUTH, UNSTABLE_TRUTH, filtered, gusty, held, of, open_loop};

/// Repeats, thinned by `FDM_REPEATS`.
fn wanted(most: u64) -> u64 {
    std::env::var("FDM_REPEATS").ok().and_then(|n| n.parse().ok()).unwrap_or(most)
}

/// Mean and deviation of (value - truth)/error over repeats, and the mean error in units of the scatter.
struct Repeats {
    bias: f64,
    scatter: f64,
    error: f64,
    covered: f64,
}

fn repeats(found: &[(f64, f64)], truth: f64) -> Repeats {
    let n = found.len() as f64;
    let mean = found.iter().map(|f| f.0).sum::<f64>() / n;
    let scatter = (found.iter().map(|f| (f.0 - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let error = (found.iter().map(|f| f.1 * f.1).sum::<f64>() / n).sqrt();
    let covered = found.iter().filter(|f| (f.0 - truth).abs() < 1.96 * f.1).count() as f64 / n;
    Repeats { bias: mean - truth, scatter, error, covered }
}

fn table(title: &str, names: &[(&str, f64)], found: &[Vec<(f64, f64)>]) {
    println!("\n{title}: {} repeats", found.len());
    println!(
        "{:>10} {:>9} {:>9} {:>9} {:>9} {:>12} {:>8}",
        "", "truth", "mean", "scatter", "error", "bias/scatter", "covered"
    );
    for (k, (name, truth)) in names.iter().enumerate() {
        let own: Vec<(f64, f64)> = found.iter().map(|f| f[k]).collect();
        let r = repeats(&own, *truth);
        let mean = truth + r.bias;
        println!(
            "{name:>10} {truth:>9.4} {mean:>9.4} {:>9.4} {:>9.4} {:>12.2} {:>8.3}",
            r.scatter,
            r.error,
            r.bias / r.scatter,
            r.covered
        );
    }
}

/// Turbulence: output error is biased and overrates itself, filter error is not and does not.
#[test]
#[ignore = "a study: release build, a minute"]
fn study_of_turbulence() {
    let calm = model(CALM);
    for s in [0.003, 0.01, 0.03] {
        let (mut filter, mut open) = (Vec::new(), Vec::new());
        for seed in 0..wanted(100) {
            let (model, run) = gusty(1000 + seed, s, 600);
            let found = filtered(&model, std::slice::from_ref(&run));
            filter.push(TRUTH.map(|(name, _)| of(&found.fit, name)).to_vec());
            let plain = open_loop(&calm, &[run]);
            open.push(TRUTH[..4].iter().map(|(name, _)| of(&plain, name)).collect::<Vec<_>>());
        }
        let mut truth = TRUTH;
        truth[5].1 = s;
        table(&format!("filter error, turbulence {s}"), &truth, &filter);
        table(&format!("output error, turbulence {s}"), &truth[..4], &open);
        if s == 0.03 {
            for (k, (name, truth)) in truth.iter().enumerate() {
                let r = repeats(&filter.iter().map(|f| f[k]).collect::<Vec<_>>(), *truth);
                assert!((r.error / r.scatter - 1.0).abs() < 0.25, "{name}: error {} scatter {}", r.error, r.scatter);
                assert!(r.covered > 0.88, "{name}: {}", r.covered);
            }
        }
    }
}

/// An unstable vehicle under feedback: open loop the response diverges, the filter follows.
#[test]
#[ignore = "a study: release build, half a minute"]
fn study_of_an_unstable_vehicle() {
    let (mut filter, mut open, mut lost) = (Vec::new(), Vec::new(), 0);
    for seed in 0..wanted(40) {
        let (model, run) = held(2000 + seed, 600);
        let found = filtered(&model, std::slice::from_ref(&run));
        filter.push(UNSTABLE_TRUTH.map(|(name, _)| of(&found.fit, name)).to_vec());
        let plain = open_loop(&model, &[run]);
        match plain.estimate.is_good() {
            true => open.push(UNSTABLE_TRUTH[..3].iter().map(|(name, _)| of(&plain, name)).collect::<Vec<_>>()),
            false => lost += 1,
        }
    }
    table("filter error", &UNSTABLE_TRUTH, &filter);
    table("output error", &UNSTABLE_TRUTH[..3], &open);
    println!("output error did not converge in {lost} records");
}
