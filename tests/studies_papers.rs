//! The figures and tables of Marchand and Fu (1985) and of Black, Murray-Smith and Padfield (1986), from simulated flights.
//!
//! `cargo test --release --test studies_papers -- --ignored --nocapture`
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stdout, reason = "studies print their figures")]

mod noise;
mod papers;

use fdm::frequency::EndTerms;
use papers::{bo105, errors, truth};

#[test]
#[ignore = "a study"]
fn bo105_figure_2() {
    let model = bo105::bo105();
    let clean = bo105::runs(&model);
    for run in &clean {
        let q = run.output_gaps.len();
        let last = &run.measured[run.measured.len() - q..];
        let largest: Vec<f64> = (0..q).map(|o| run.measured.iter().skip(o).step_by(q).fold(0.0f64, |a, b| a.max(b.abs()))).collect();
        println!("{}: last {last:.3?}\n largest {largest:.3?}", run.name);
    }
    for part in [0.0, 0.2, 1.0] {
        let runs = bo105::with_noise(&clean, part, 1);
        for ends in [EndTerms::Known, EndTerms::Unknown, EndTerms::Omitted] {
            let t0 = std::time::Instant::now();
            let fit = bo105::fit(&model, &runs, ends.clone());
            let e = errors(&model, &fit);
            println!("{part} {ends:?} {:?}", t0.elapsed());
            for ((n, w), e) in truth(&model).iter().zip(&e) {
                print!(" {n} {w} {:.2}%;", 100.0 * e);
            }
            println!("\nmean {:.3} max {:.3}", 100.0 * papers::mean(&e), 100.0 * e.iter().fold(0.0f64, |a, b| a.max(*b)));
        }
    }
}

#[test]
#[ignore = "a study"]
fn puma_try() {
    use papers::{fitted, found, model, puma, up_to};
    let flight = puma::flight();
    let (with, without) = (model("puma/model.fdm"), model("puma/no_delay.fdm"));
    let mut flights = Vec::new();
    for half in [0.5, 1.0, 2.0, 3.0] {
        flights.push((format!("doublet {half}"), puma::doublet_of(&flight, half)));
    }
    for unit in [0.8, 1.0] {
        flights.push((format!("3211 {unit}"), puma::three_two_one_one_of(&flight, unit)));
    }
    for (name, clean) in &flights {
        let largest: Vec<f64> = (0..6).map(|o| clean.measured.iter().skip(o).step_by(6).fold(0.0f64, |a, b| a.max(b.abs()))).collect();
        println!("{name}: largest {largest:.3?}");
        for part in [0.0, 1.0, 3.0] {
            let run = puma::longitudinal(&puma::with_noise(clean, part, 1));
            for (what, m) in [("with", &with), ("without", &without)] {
                let fit = fitted(m, std::slice::from_ref(&run), &up_to(puma::HIGHEST, EndTerms::Known));
                print!("  {part} {what}:");
                for (n, _) in truth(m) {
                    let p = found(&fit, &n);
                    print!(" {n} {:.4}+-{:.4}", p.value, p.standard_error.unwrap_or(f64::NAN));
                }
                println!();
            }
        }
    }
}

#[test]
#[ignore = "a study"]
fn hfb_try() {
    use papers::{fitted, found, hfb320, model};
    let m = hfb320::hfb320();
    for rest in [true, false] {
        let clean = hfb320::run(&m, rest);
        for part in [0.0, 0.05] {
            let run = hfb320::with_noise(&clean, part, 1);
            for file in ["model", "no_delay"] {
                let m = model(&format!("hfb320/{file}.fdm"));
                let mut o = hfb320::options(EndTerms::Unknown);
                o.finish = true;
                let fit = fitted(&m, std::slice::from_ref(&run), &o);
                println!("rest {rest} noise {part} {file}");
                for (n, w) in truth(&m) {
                    let p = found(&fit, &n);
                    print!(" {n} {w} {:.5}+-{:.5}", p.value, p.standard_error.unwrap_or(f64::NAN));
                }
                println!();
                for q in fit.finish.iter().flat_map(|f| &f.quality) {
                    println!("{:?}", q.fit);
                }
            }
        }
        let m = model("hfb320/two_channels.fdm");
        let run = hfb320::with_noise(&hfb320::two_channels(&m, rest), 0.05, 1);
        let fit = fitted(&m, std::slice::from_ref(&run), &hfb320::options(EndTerms::Unknown));
        for (n, w) in truth(&m) {
            let p = found(&fit, &n);
            print!(" {n} {w} {:.5}+-{:.5}", p.value, p.standard_error.unwrap_or(f64::NAN));
        }
        println!();
    }
}

#[test]
#[ignore = "a study"]
fn pitch_try() {
    use fdm::regression::*;
    use fdm::spectrum::Frequencies;
    use papers::{model, puma};
    let equation = model("puma/pitching_moment.fdm");
    let options = |h: f64| RegressionOptions { domain: Domain::Frequency(Frequencies::Grid { lowest: None, highest: Some(h) }), ..RegressionOptions::default() };
    for delay in [0.0, 0.134] {
        let flight = puma::flight_of_theory(delay);
        for (half, part) in [(1.0, 0.0), (1.0, 1.0), (2.0, 1.0), (2.0, 3.0), (1.0, 3.0)] {
            let run = puma::pitching_moment(&puma::with_noise(&puma::doublet_of(&flight, half), part, 1));
            let found = regress(&equation, std::slice::from_ref(&run), &options(puma::HIGHEST)).unwrap();
            println!("delay {delay} half {half} noise {part}\n{}", fdm::report::regression_table(&found));
            if half == 2.0 {
                println!("{}", fdm::report::dependence_table("cut-off", &by_cutoff(&equation, std::slice::from_ref(&run), &options(0.5), &[0.3, 0.565, 1.0, 2.0, 5.0])));
                println!("{}", fdm::report::dependence_table("length", &by_length(&equation, std::slice::from_ref(&run), &options(0.565), &[0.4, 0.6, 0.8, 1.0])));
            }
        }
    }
}
