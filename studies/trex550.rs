//! The structure of the model helicopter's equations, chosen inside the first half of the record and judged once on the second.
//!
//! `cargo test --release --manifest-path studies/Cargo.toml --test studies trex550:: -- --ignored --nocapture`

use fdm::Model;
use fdm::estimate::{Changes, SpectralFit, SpectralOptions, Work, changed, fit_spectra};
use fdm::frequency::EndTerms;
use fdm::record::{ReadOptions, Run, channels, read};
use fdm::spectrum::Frequencies;
use rayon::prelude::*;

const FOLDER: &str = "models/trex550";
/// Parts of the first half, each predicted by a fit of the others.
const FOLDS: usize = 4;
/// What is free or zero: every set of these is a structure.
const OPTIONS: [&str; 5] = ["skew", "Mlat", "Llon", "Lq", "Mp"];

fn half(file: &str) -> Run {
    let model = Model::from_file(support::repository().join(FOLDER).join("coupled.fdm")).unwrap();
    let options = ReadOptions { require_outputs: true, ..ReadOptions::default() };
    read(support::repository().join(FOLDER).join(file).as_path(), &channels(model.definition()), &options).unwrap().0
}

/// Samples of a run, time beginning at zero.
fn part(run: &Run, number: usize, range: std::ops::Range<usize>) -> Run {
    let (m, q) = (run.held.len(), run.output_gaps.len());
    let begin = run.time[range.start];
    Run {
        name: format!("part {}", number + 1),
        time: run.time[range.clone()].iter().map(|t| t - begin).collect(),
        inputs: run.inputs[range.start * m..range.end * m].to_vec(),
        measured: run.measured[range.start * q..range.end * q].to_vec(),
        ..run.clone()
    }
}

/// The model with every coupling, all but the chosen ones of [`OPTIONS`] held at zero.
fn structure(free: &[&str]) -> Model {
    let model = Model::from_file(support::repository().join(FOLDER).join("coupled.fdm")).unwrap();
    let held = || OPTIONS.iter().filter(|name| !free.contains(name)).map(|name| name.to_string());
    let changes =
        Changes { set: held().map(|name| (name, 0.0)).collect(), fix: held().collect(), ..Changes::default() };
    changed(&model, &changes).unwrap()
}

/// In the band of coherence; of parts from one cycle in each of them on.
fn fitted(model: &Model, runs: &[Run]) -> SpectralFit {
    let options = SpectralOptions {
        frequencies: Frequencies::Grid { lowest: (runs.len() == 1).then_some(0.05), highest: Some(1.2) },
        ends: EndTerms::Unknown,
        finish: false,
        ..SpectralOptions::default()
    };
    fit_spectra(model, runs, &options, &Work::default()).unwrap()
}

/// What became of a structure inside the first half.
struct Judged {
    name: String,
    model: Model,
    /// Root mean square of the errors of predictions, of both rates.
    predicted: [f64; 2],
    /// Mean of the logarithms of these: what is to be least.
    score: f64,
    /// Fits of the folds that are good: converged and determined.
    good: usize,
}

fn judged(name: String, model: Model, parts: &[Run]) -> Judged {
    let (mut squares, mut compared, mut good) = ([0.0; 2], [0.0; 2], 0);
    for fold in 0..parts.len() {
        let others: Vec<Run> = parts.iter().enumerate().filter(|(k, _)| *k != fold).map(|(_, p)| p.clone()).collect();
        let fit = fitted(&model, &others);
        good += usize::from(fit.is_good());
        match fit.predict(&parts[fold..=fold], &Work::default()) {
            Ok(behind) => behind.quality.iter().enumerate().for_each(|(o, q)| {
                let n = q.fit.compared as f64;
                squares[o] += n * q.fit.rms.unwrap_or(f64::INFINITY).powi(2);
                compared[o] += n;
            }),
            Err(_) => squares = [f64::INFINITY; 2],
        }
    }
    let predicted = [0, 1].map(|o| (squares[o] / compared[o]).sqrt());
    Judged { name, model, predicted, score: predicted.iter().map(|p| 0.5 * p.ln()).sum(), good }
}

/// Theil's coefficients of both rates in a run that the fit has not seen.
fn tic(fit: &SpectralFit, run: &Run) -> [f64; 2] {
    let behind = fit.predict(std::slice::from_ref(run), &Work::default()).unwrap();
    [0, 1].map(|o| behind.quality[o].fit.tic.unwrap())
}

#[test]
#[ignore = "a study"]
fn structure_chosen_inside_the_first_half_and_judged_once_on_the_second() {
    let [first, second] = ["first_half.csv", "second_half.csv"].map(half);
    let n = first.len();
    let parts: Vec<Run> = (0..FOLDS).map(|k| part(&first, k, k * n / FOLDS..(k + 1) * n / FOLDS)).collect();
    let sets: Vec<Vec<&str>> = (0..1 << OPTIONS.len())
        .map(|set: usize| (0..OPTIONS.len()).filter(|k| set >> k & 1 == 1).map(|k| OPTIONS[k]).collect())
        .collect();
    let mut all: Vec<Judged> = sets.par_iter().map(|free| judged(free.join(" "), structure(free), &parts)).collect();
    let flap = Model::from_file(support::repository().join(FOLDER).join("flap.fdm")).unwrap();
    let free = Changes { free: vec!["skew".into()], ..Changes::default() };
    all.push(judged("flap.fdm with skew".into(), changed(&flap, &free).unwrap(), &parts));
    all.push(judged("flap.fdm".into(), flap, &parts));
    all.sort_by(|a, b| a.score.total_cmp(&b.score));
    println!("\nfirst half in {FOLDS} parts, each predicted by a fit of the others: errors in rad/s, the best first");
    println!("{:32} {:>8} {:>8} {:>8} good fits", "free besides Lp Llat Mq Mlon", "p", "q", "score");
    for j in &all {
        println!("{:32} {:8.4} {:8.4} {:8.4} {} of {FOLDS}", j.name, j.predicted[0], j.predicted[1], j.score, j.good);
    }
    let believed = || all.iter().filter(|j| j.good == FOLDS);
    let best = believed().next().unwrap();
    let rigid = believed().find(|j| !j.name.contains("skew") && !j.name.contains("flap"));
    println!("\nchosen: {}; of the rigid bodies: {:?}", best.name, rigid.map(|j| &j.name));
    let bodies = [
        ("chosen", &best.model),
        ("rigid_body.fdm", &structure(&["Mlat"])),
        ("model.fdm", &structure(&["skew", "Mlat"])),
    ];
    let others = rigid.map(|j| ("best rigid body", &j.model));
    println!("{:18} {:>22} {:>22}", "TIC of p, q", "first, then second", "second, then first");
    for (name, model) in bodies.into_iter().chain(others) {
        let [there, back] = [(&first, &second), (&second, &first)].map(|(from, to)| {
            let fit = fitted(model, std::slice::from_ref(from));
            let [p, q] = tic(&fit, to);
            format!("{p:.3} {q:.3}{}", if fit.is_good() { "" } else { " (not good)" })
        });
        println!("{name:18} {there:>22} {back:>22}");
        let fit = fitted(model, std::slice::from_ref(&first));
        for p in &fit.estimate.parameters {
            if let Some(e) = p.error() {
                println!("    {} = {:.3} ± {:.3}", p.name, p.value, e);
            } else {
                println!("    {} = {:.3} {:?}", p.name, p.value, p.status);
            }
        }
    }
}
