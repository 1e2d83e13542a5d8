//! The hovering helicopter by recursive least squares: forgetting, the best iterate, output error from there.

use fdm::equation_error::{Detrend, Preprocessing, RecursiveOptions};
use fdm::estimate::{BestOptions, Changes, Criterion, FitOptions, Shooting, Work, best_iterate, fit};
use support::hovering::{helicopter, hovering, off};

fn with(forgetting: f64) -> RecursiveOptions {
    RecursiveOptions { forgetting, ..RecursiveOptions::default() }
}

/// As in the paper: forgetting, best iterate, output error from there; with noise, with smoothing and without.
#[test]
#[ignore = "a study: release build, a minute"]
fn study_of_the_hovering_helicopter() {
    let model = helicopter();
    println!(
        "{:>9} {:>6} {:>9} {:>7} {:>9} {:>9} {:>9} {:>8} {:>8} {:>8}",
        "noise",
        "forget",
        "low-pass",
        "best at",
        "sim best",
        "sim last",
        "sim batch",
        "off best",
        "off last",
        "off batch"
    );
    for deviation in [1e-4, 1e-3, 5e-3] {
        let run = hovering(&model, deviation, 7, 2000);
        for (forgetting, cutoff) in [(1.0, None), (0.995, None), (0.995, Some(4.0)), (0.98, Some(4.0))] {
            let preprocessing = Preprocessing { cutoff, points: cutoff.map(|_| 9), detrend: Detrend::None };
            let recursion = RecursiveOptions { forgetting, preprocessing };
            let options = BestOptions { recursion, criterion: Criterion::Simulation, restart: Some(4.0) };
            let found = best_iterate(&model, std::slice::from_ref(&run), &options).unwrap();
            let r = &found.recursion;
            let shown = |e: Option<f64>| e.map_or("lost".into(), |e| format!("{e:.2e}"));
            let last = r.iterates.len() - 1;
            println!(
                "{deviation:>9.0e} {forgetting:>6} {:>9} {:>7.1} {:>9} {:>9} {:>9} {:>8.4} {:>8.4} {:>8.4}",
                cutoff.map_or("none".into(), |c: f64| format!("{c} Hz")),
                r.iterates[found.best].time,
                shown(found.error_of(found.best)),
                shown(found.error_of(last)),
                shown(found.batch_error),
                off(&model, &found, &r.iterates[found.best].values),
                off(&model, &found, &r.iterates[last].values),
                off(&model, &found, &r.batch),
            );
        }
    }
    let run = hovering(&model, 1e-3, 7, 2000);
    let options = BestOptions { recursion: with(0.995), criterion: Criterion::Simulation, restart: Some(4.0) };
    let found = best_iterate(&model, std::slice::from_ref(&run), &options).unwrap();
    let options =
        FitOptions { shooting: Some(Shooting::Segments(10)), changes: Changes::default(), ..FitOptions::default() };
    let fitted = fit(&found.model, &[run], &options, &Work::default()).unwrap();
    let (mut worst, mut sum, mut count) = (0.0f64, 0.0, 0);
    for p in fitted.estimate.parameters.iter().filter(|p| !p.name.ends_with("(0)")) {
        if let (Some(error), Some(k)) = (p.error(), model.definition().param(&p.name)) {
            let far = (p.value - model.definition().params[k].value) / error;
            (worst, sum, count) = (worst.max(far.abs()), sum + far * far, count + 1);
        }
    }
    println!(
        "output error from there: {}, {count} parameters, worst {worst:.2} standard errors, root mean square {:.2}",
        fitted.estimate.termination,
        (sum / f64::from(count)).sqrt()
    );
}
