//! The figures and tables of Marchand and Fu (1985) and of Black, Murray-Smith and Padfield (1986), from simulated flights.
//!
//! `cargo test --release --manifest-path studies/Cargo.toml --test studies papers:: -- --ignored --nocapture`

use fdm::Model;
use fdm::documents::RegressionDocument;
use fdm::equation_error::{Components, by_cutoff, by_length, regress};
use fdm::estimate::{SpectralFit, SpectralOptions, Work, fit_spectra};
use fdm::frequency::EndTerms;
use fdm::record::Run;
use fdm::report::{dependence_table, prediction_table, regression_table};
use rayon::prelude::*;
use crate::bars::bars;
use support::papers::{bo105, deviation, errors, fitted, found, hfb320, mean, model, noisy, off_by, puma, truth, up_to};

const REPEATS: u64 = 200;

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |a: f64, v| a.max(*v))
}

/// Mean, scatter, mean printed error and worst error of every free parameter over repeats that converge.
fn repeated(model: &Model, fit: impl Fn(u64) -> SpectralFit + Sync) -> Vec<(String, f64, [f64; 4])> {
    let fits: Vec<SpectralFit> = (1..=REPEATS).into_par_iter().map(&fit).filter(|f| f.is_good()).collect();
    if fits.len() < REPEATS as usize {
        println!("({} of {REPEATS} repeats of {} have no minimum)", REPEATS as usize - fits.len(), model.name());
    }
    let one = |(name, want): &(String, f64)| {
        let values: Vec<f64> = fits.iter().map(|f| found(f, name).value).collect();
        let printed: Vec<f64> = fits.iter().map(|f| found(f, name).error().unwrap()).collect();
        let worst = largest(&values.iter().map(|v| (v - want).abs()).collect::<Vec<_>>());
        (name.clone(), *want, [mean(&values), deviation(&values), mean(&printed), worst])
    };
    truth(model).iter().map(one).collect()
}

fn print_repeated(rows: &[(String, f64, [f64; 4])]) {
    println!(
        "{:>8} {:>10} {:>11} {:>10} {:>10} {:>6} {:>8}",
        "", "true", "mean", "scatter", "printed", "ratio", "worst %"
    );
    for (name, want, [mean, scatter, printed, worst]) in rows {
        let (ratio, worst) = (scatter / printed, 100.0 * worst / want.abs());
        println!("{name:>8} {want:10.4} {mean:11.5} {scatter:10.2e} {printed:10.2e} {ratio:6.2} {worst:8.2}");
    }
}

#[test]
#[ignore = "a study"]
fn bo105_figure_2() {
    let model = bo105::bo105();
    let clean = bo105::runs(&model);
    println!(
        "motion half an interval behind the last sample less that before the first: u, w [m/s], p, q, r [deg/s], phi [deg]"
    );
    for run in &clean {
        let q = run.output_gaps.len();
        let change = |o: usize| run.measured[run.measured.len() - q + o] - run.measured[o];
        let degrees = [6, 7, 8, 9].map(|o| change(o).to_degrees());
        println!("{:>14}: {:.2} {:.2} {degrees:.1?}", run.name, change(3), change(5));
    }
    let ways = [("known", EndTerms::Known), ("found", EndTerms::Unknown), ("left out", EndTerms::Omitted)];
    let rms = |seeds: u64, part: f64, ends: &EndTerms| {
        let one = |seed: u64| errors(&model, &bo105::fit(&model, &bo105::with_noise(&clean, part, seed), ends.clone()));
        let all: Vec<Vec<f64>> = (1..=seeds).into_par_iter().map(one).collect();
        let of = |k: usize| 100.0 * mean(&all.iter().map(|e| e[k].powi(2)).collect::<Vec<_>>()).sqrt();
        (0..all[0].len()).map(of).collect::<Vec<f64>>()
    };
    let exact: Vec<Vec<f64>> = ways.iter().map(|(_, ends)| rms(1, 0.0, ends)).collect();
    let noisy: Vec<Vec<f64>> = ways.iter().map(|(_, ends)| rms(REPEATS, 1.0, ends)).collect();
    println!("\nerrors of 21 derivatives in percent; with noise the root mean square of {REPEATS} repeats");
    println!("{:15} | {:^26} | {:^26}", ' ', "without noise", "with noise");
    println!("{:>15} | {ends} | {ends}", "true", ends = "   known    found left out");
    let row = |values: [f64; 3]| values.map(|v| format!("{v:8.3}")).join(" ");
    for (k, (name, want)) in truth(&model).iter().enumerate() {
        let of = |all: &[Vec<f64>]| row([all[0][k], all[1][k], all[2][k]]);
        println!("{name:>6} {want:8.3} | {} | {}", of(&exact), of(&noisy));
    }
    let summary = |all: &[Vec<f64>], of: &dyn Fn(&[f64]) -> f64| row([of(&all[0]), of(&all[1]), of(&all[2])]);
    println!("{:>15} | {} | {}", "mean", summary(&exact, &mean), summary(&noisy, &mean));
    println!("{:>15} | {} | {}", "largest", summary(&exact, &largest), summary(&noisy, &largest));

    let panel = |of: &dyn Fn(&[f64]) -> f64| {
        vec![("without", of(&noisy[2])), ("known", of(&noisy[0])), ("found", of(&noisy[1]))]
    };
    let panels = [("largest error of derivatives", panel(&largest)), ("mean error of derivatives", panel(&mean))];
    let title = "Bo 105, 21 derivatives: end terms left out, known from the records, found";
    std::fs::write(support::repository().join("docs/pictures/bo105_figure_2.svg"), bars(title, &panels, (-1, 3)))
        .unwrap();
    assert!(mean(&noisy[2]) > 20.0 && mean(&noisy[0]) < 2.0 && mean(&noisy[1]) < 2.0);
}

/// Misfit of time histories: of every output R^2, Theil's coefficient and the residual's root mean square.
fn print_histories(fit: &SpectralFit) {
    for q in fit.finish.iter().flat_map(|f| &f.quality) {
        let of = |v: Option<f64>| v.unwrap();
        println!("    {}: R^2 {:.4}, TIC {:.4}, RMS {:.4}", q.fit.name, of(q.fit.r2), of(q.fit.tic), of(q.fit.rms));
    }
}

#[test]
#[ignore = "a study"]
fn hfb320_figure_6() {
    let (with, without) = (hfb320::hfb320(), model("hfb320/no_delay.fdm"));
    for rest in [true, false] {
        let clean = hfb320::run(&with, rest);
        let run = hfb320::with_noise(&clean, 0.05, 1);
        println!("\n60 s that end {}, noise 5 % of the RMS of q", if rest { "at rest" } else { "in motion" });
        for m in [&with, &without] {
            let options =
                SpectralOptions { finish: true, changes: off_by(m, 0.2), ..hfb320::options(EndTerms::Unknown) };
            let fit = fitted(m, std::slice::from_ref(&run), &options);
            let values: Vec<String> = truth(m)
                .iter()
                .map(|(n, _)| format!("{n} {:.4} +- {:.4}", found(&fit, n).value, found(&fit, n).error().unwrap()))
                .collect();
            println!("  {}\n    {}", m.name(), values.join(", "));
            print_histories(&fit);
        }
        let exact = fitted(&with, std::slice::from_ref(&clean), &hfb320::options(EndTerms::Unknown));
        println!("  without noise: largest relative error {:.1e}", largest(&errors(&with, &exact)));
        let rows = repeated(&with, |seed| {
            fitted(&with, &[hfb320::with_noise(&clean, 0.05, seed)], &hfb320::options(EndTerms::Unknown))
        });
        println!("  {REPEATS} repeats");
        print_repeated(&rows);
        let tau = &rows[4];
        assert!((tau.2[0] / tau.1 - 1.0).abs() < 0.002 && tau.2[1] / tau.1 < 0.01 && tau.2[3] / tau.1 < 0.02);
    }
}

#[test]
#[ignore = "a study"]
fn hfb320_two_delays() {
    let two = model("hfb320/two_channels.fdm");
    let clean = hfb320::two_channels(&two, true);
    let rows = repeated(&two, |seed| {
        let options = SpectralOptions { changes: off_by(&two, 0.2), ..hfb320::options(EndTerms::Unknown) };
        fitted(&two, &[hfb320::with_noise(&clean, 0.05, seed)], &options)
    });
    println!("two channels, noise 5 %, all starts off by 20 %, {REPEATS} repeats");
    print_repeated(&rows);
    for tau in rows.iter().filter(|r| r.0.starts_with("tau")) {
        assert!((tau.2[0] / tau.1 - 1.0).abs() < 0.002 && tau.2[1] / tau.1 < 0.01, "{}", tau.0);
    }
}

/// Tables 4 and 5 of the paper: without delay and with it, values and their printed errors.
const TABLES_4_5: [(&str, [f64; 4]); 11] = [
    ("Mu", [0.00319, 0.00021, 0.00419, 0.00040]),
    ("Mw", [-0.00252, 0.00070, -0.00022, 0.0012]),
    ("Mq", [-0.353, 0.092, -0.823, 0.18]),
    ("Mbeta", [-1.225, 0.090, -1.306, 0.10]),
    ("Mp", [-0.412, 0.069, -0.248, 0.086]),
    ("Meta", [-0.0308, 0.0017, -0.0396, 0.0034]),
    ("Zu", [0.0504, 0.022, 0.0362, 0.021]),
    ("Zw", [-0.805, 0.021, -0.796, 0.019]),
    ("Zeta", [0.699, 0.14, 0.520, 0.12]),
    ("Xu", [-0.0384, 0.037, -0.0319, 0.033]),
    ("Xeta", [0.599, 0.33, 0.969, 0.34]),
];

/// Seconds of each half of the doublet.
const HALF: f64 = 2.5;

/// Means and scatters of the longitudinal fits over repeats.
fn longitudinal(m: &Model, flights: &[Run], highest: f64) -> Vec<(String, f64, [f64; 4])> {
    repeated(m, |seed| {
        let runs: Vec<Run> = flights.iter().map(|f| puma::longitudinal(&puma::with_noise(f, 1.0, seed))).collect();
        fit_spectra(m, &runs, &up_to(highest, EndTerms::Unknown), &Work::default()).unwrap()
    })
}

#[test]
#[ignore = "a study"]
fn puma_tables_4_and_5() {
    let flight = puma::flight();
    let (with, without) = (model("puma/model.fdm"), model("puma/no_delay.fdm"));
    let doublet = puma::doublet_of(&flight, HALF);
    let run = puma::longitudinal(&puma::with_noise(&doublet, 1.0, 1));
    let one =
        [&without, &with].map(|m| fitted(m, std::slice::from_ref(&run), &up_to(puma::HIGHEST, EndTerms::Unknown)));
    let many = [&without, &with].map(|m| longitudinal(m, std::slice::from_ref(&doublet), puma::HIGHEST));
    println!(
        "doublet of 2 x {HALF} s, 14.3 s, eight frequencies; mean and scatter of {REPEATS} repeats (printed error of one)"
    );
    println!(
        "{:>6} | {:^19} {:^32} | {:^19} {:^32}",
        "", "paper, no delay", "here, no delay", "paper, with delay", "here, with delay"
    );
    for (k, (name, paper)) in TABLES_4_5.iter().enumerate() {
        let here = |w: usize| {
            let [mean, scatter, ..] = many[w][k].2;
            format!("{mean:9.5} +- {scatter:7.5} ({:7.5})", found(&one[w], name).error().unwrap())
        };
        let of = |value: f64, error: f64| format!("{value:8} +- {error:7}");
        println!("{name:>6} | {} {} | {} {}", of(paper[0], paper[1]), here(0), of(paper[2], paper[3]), here(1));
    }
    let tau = many[1][11].2;
    println!("   tau | paper 0.134 +- 0.037, here {:.4} +- {:.4}", tau[0], tau[1]);
    let cost = |f: &SpectralFit| f.estimate.cost.unwrap();
    println!("\nwith delay: scatter and printed error, end values found, and known from the record");
    let known = repeated(&with, |seed| {
        let run = puma::longitudinal(&puma::with_noise(&doublet, 1.0, seed));
        fit_spectra(&with, &[run], &up_to(puma::HIGHEST, EndTerms::Known), &Work::default()).unwrap()
    });
    for ((name, _, [_, scatter, printed, _]), (_, _, [_, other, of_other, _])) in many[1].iter().zip(&known) {
        println!("{name:>6} {scatter:9.2e} {printed:9.2e}   {other:9.2e} {of_other:9.2e}");
    }
    println!("minus log likelihood without and with delay: {:.2}, {:.2}", cost(&one[0]), cost(&one[1]));

    println!("\nMq with the delay left out, by input (true -0.823, paper -0.353), mean and scatter; with it");
    let mut inputs: Vec<(String, Vec<Run>, f64)> = Vec::new();
    for half in [0.5, 1.0, 1.5, 2.0, 2.5, 3.0] {
        inputs.push((format!("doublet 2 x {half} s"), vec![puma::doublet_of(&flight, half)], puma::HIGHEST));
    }
    for unit in [0.5, 0.8, 1.0] {
        inputs.push((format!("3211 of {unit} s"), vec![puma::three_two_one_one_of(&flight, unit)], puma::HIGHEST));
    }
    let several = puma::all_controls(&flight, 630).split_off(1);
    inputs.push(("3211, pedals, lateral to 0.5 Hz".into(), several, 0.5));
    for highest in [0.425, 0.705, 1.0] {
        inputs.push((format!("doublet 2 x {HALF} s to {highest} Hz"), vec![doublet.clone()], highest));
    }
    for (name, flights, highest) in &inputs {
        let [a, b] = [&without, &with].map(|m| longitudinal(m, flights, *highest).swap_remove(2).2);
        println!("{name:>32} {:7.3} +- {:.3}   {:7.3} +- {:.3}", a[0], a[1], b[0], b[1]);
    }
    assert!(many[0][2].2[0].abs() < 0.5 * 0.823 && (many[1][2].2[0] / -0.823 - 1.0).abs() < 0.1);

    let other = puma::longitudinal(&puma::with_noise(&puma::three_two_one_one_of(&flight, 0.8), 1.0, 2));
    for (what, fit) in ["without delay", "with delay"].iter().zip(&one) {
        let predicted = fit.predict(std::slice::from_ref(&other), &Work::default()).unwrap();
        println!("\n3211 predicted from the doublet, {what}\n{}", prediction_table(&predicted.quality));
    }
}

#[test]
#[ignore = "a study"]
fn puma_table_6() {
    let paper = [("a0", 0.45), ("a1", 0.29), ("Mrate", 0.014), ("Meta", 0.007), ("Zeta", 1.63), ("tau", 0.08)];
    let m = puma::transfer_functions();
    let clean = puma::short_period(&m);
    let rows = repeated(&m, |seed| {
        let run = noisy(&clean, &puma::SHORT_PERIOD_NOISE, seed);
        let options = SpectralOptions { changes: off_by(&m, 0.2), ..up_to(puma::HIGHEST, EndTerms::Unknown) };
        fitted(&m, &[run], &options)
    });
    println!("two transfer functions with one denominator, 3211 of 0.8 s, all starts off by 20 %, {REPEATS} repeats");
    print_repeated(&rows);
    println!("error bounds of the paper: {paper:?}");
    for (name, want, [mean, scatter, printed, _]) in &rows {
        assert!((mean - want).abs() < 0.5 * scatter, "{name} {mean}");
        assert!((scatter / printed - 1.0).abs() < 0.35, "{name}: {scatter} {printed}");
    }
}

#[test]
#[ignore = "a study"]
fn puma_pitching_moment() {
    let equation = model("puma/pitching_moment.fdm");
    for delay in [0.134, 0.0] {
        let flight = puma::flight_of_theory(delay);
        let run = puma::pitching_moment(&puma::with_noise(&puma::doublet_of(&flight, 2.0), 1.0, 1));
        let runs = std::slice::from_ref(&run);
        let options = puma::at_frequencies(puma::HIGHEST, puma::PUBLISHED);
        println!("\ntheory of HELISTAB flown with a delay of {delay} s; the published rule\n");
        let found = regress(&equation, runs, &options).unwrap();
        println!("{}", regression_table(&RegressionDocument::of(equation.name(), &found)));
        let auto = regress(&equation, runs, &puma::at_frequencies(puma::HIGHEST, Components::Auto)).unwrap();
        println!("chosen by condition index: {} of 6", auto.fits[0].chosen);
        let scores: Vec<usize> = (1..=REPEATS)
            .map(|seed| {
                let run = puma::pitching_moment(&puma::with_noise(&puma::doublet_of(&flight, 2.0), 1.0, seed));
                regress(&equation, &[run], &options).unwrap().fits[0].chosen
            })
            .collect();
        let count = |n: usize| scores.iter().filter(|s| **s == n).count();
        assert!(if delay > 0.0 { count(5) } else { count(6) } > scores.len() * 4 / 5);
        println!(
            "the published rule in {REPEATS} repeats: five {}, six {}, fewer {}",
            count(5),
            count(6),
            scores.len() - count(5) - count(6)
        );

        println!("\nsignificance (part of the rate) by number of components");
        for k in 1..=6 {
            let found = regress(&equation, runs, &puma::at_frequencies(puma::HIGHEST, Components::Count(k))).unwrap();
            let parts: Vec<String> =
                found.fits[0].parameters.iter().map(|p| format!("{} {:.3}", p.name, p.significance)).collect();
            println!("  {k}: {}", parts.join(", "));
        }
        let cutoffs = [0.285, 0.425, 0.565, 0.705, 1.0, 2.0, 5.0];
        println!("\n{}", dependence_table("cut-off [Hz]", &by_cutoff(&equation, runs, &options, &cutoffs)));
        println!("R^2 by cut-off and number of components");
        for cutoff in cutoffs {
            let found = regress(&equation, runs, &puma::at_frequencies(cutoff, puma::PUBLISHED)).unwrap();
            let levels: Vec<String> = found.fits[0].components.iter().map(|c| format!("{:.3}", c.r_squared)).collect();
            println!("  {cutoff:5} {}", levels.join(" "));
        }
        let lengths = [0.5, 0.6, 0.7, 0.8, 0.9, 1.0];
        println!("\n{}", dependence_table("part of 14.3 s", &by_length(&equation, runs, &options, &lengths)));
    }
    let flight = puma::flight_of_theory(0.134);
    let flights: Vec<Run> = puma::all_controls(&flight, 630)
        .into_iter()
        .skip(1)
        .map(|f| puma::pitching_moment(&puma::with_noise(&f, 1.0, 1)))
        .collect();
    let found = regress(&equation, &flights, &puma::at_frequencies(0.5, puma::PUBLISHED)).unwrap();
    println!("\nthree runs of three controls to 0.5 Hz\n{}", regression_table(&RegressionDocument::of(equation.name(), &found)));
}
