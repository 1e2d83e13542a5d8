//! How often verdicts are right, in tables.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use super::*;
use rayon::prelude::*;

/// What is left of the model and of the best extended one, the evidence for a disturbance, and what they come to.
type Row = (ResidualEvidence, ResidualEvidence, f64, Attribution);

#[test]
#[ignore = "a study: some minutes in release"]
fn places_of_forces() {
    let repeats: u64 = std::env::var("FDM_REPEATS").ok().and_then(|r| r.parse().ok()).unwrap_or(40);
    println!(
        "| family | hidden | noise | colour | runs | evidence > 3 | right | in group | median evidence | group | largest sensor |"
    );
    for family in &FAMILIES {
        let hidden = [
            (Hidden::Nothing, 0.0),
            (Hidden::Gust(0), 0.1),
            (Hidden::Gust(1), 0.1),
            (Hidden::Gust(0), 0.03),
            (Hidden::Gust(1), 0.03),
            (Hidden::Wander(0), 0.1),
            (Hidden::Wander(1), 0.1),
            (Hidden::Effect, 0.0),
        ];
        for (hidden, strength) in hidden {
            for pinkish in [false, true] {
                let rows: Vec<(f64, bool, bool, usize, String)> = (0..repeats)
                    .into_par_iter()
                    .map(|seed| {
                        let case = Case::new(family, hidden, pinkish, 0.03, strength, 400, seed);
                        let found = residual_evidence(&case.model, &case.fitted_runs()).unwrap().places;
                        let wanted = match hidden {
                            Hidden::Gust(k) => family.states[k],
                            Hidden::Effect => family.effect.0,
                            _ => "",
                        };
                        let right = found.disturbances[0].place.name == wanted;
                        let within = found.group().any(|s| s.place.name == wanted);
                        let sensor = format!("{} {:.0}", found.sensors[0].place.name, found.sensors[0].evidence);
                        (found.evidence(), right, within, found.group().count(), sensor)
                    })
                    .collect();
                let clear = |r: &&(f64, bool, bool, usize, String)| r.0 > 3.0;
                let count = rows.iter().filter(clear).count();
                let right = rows.iter().filter(clear).filter(|r| r.1).count();
                let within = rows.iter().filter(clear).filter(|r| r.2).count();
                let group = rows.iter().filter(clear).map(|r| r.3).sum::<usize>() as f64 / count.max(1) as f64;
                let mut evidence: Vec<f64> = rows.iter().map(|r| r.0).collect();
                evidence.sort_by(f64::total_cmp);
                let middle = evidence[evidence.len() / 2];
                let colour = if pinkish { "1/f" } else { "white" };
                println!(
                    "| {} | {hidden:?} {strength} | 0.03 | {colour} | {repeats} | {count} | {right} | {within} | {middle:.1} | {group:.2} | {} |",
                    family.name, rows[0].4
                );
            }
        }
    }
}

#[test]
#[ignore = "a study: some minutes in release"]
fn verdicts() {
    let repeats: u64 = std::env::var("FDM_REPEATS").ok().and_then(|r| r.parse().ok()).unwrap_or(40);
    println!(
        "| family | hidden | colour | runs | follows < 1 % | law > 3 | follows < 5 % | law > 1 | with the effect: follows < 1 %, law > 3, force > 3 | nothing | effect | disturbance | unknown | warned |"
    );
    for family in &FAMILIES {
        let hidden = [
            (Hidden::Nothing, 0.0),
            (Hidden::Gust(0), 0.1),
            (Hidden::Gust(1), 0.1),
            (Hidden::Wander(1), 0.1),
            (Hidden::Effect, 0.0),
            (Hidden::Strange, 0.0),
            (Hidden::Mode, 0.0),
        ];
        for (hidden, strength) in hidden {
            for pinkish in [false, true] {
                let count = if hidden == Hidden::Nothing { 3 * repeats } else { repeats };
                let rows: Vec<Row> = (0..count)
                    .into_par_iter()
                    .map(|seed| {
                        let base = Case::new(family, hidden, pinkish, 0.03, strength, 400, 1000 + seed);
                        let state = family.effect.0;
                        let with = format!("param c = 0; der({state}) = c*{state}*abs({state}) + ");
                        let best = base.refitted(family.text.replace(&format!("der({state}) = "), &with));
                        let asked = |case: &Case| residual_evidence(&case.model, &case.fitted_runs()).unwrap();
                        let (model, base, best) = (base.model.clone(), asked(&base), asked(&best));
                        let explained = Explained { evidence: &best, params: 1 };
                        let verdict = attribute(&model, &base, Some(explained));
                        let disturbance = best.places.evidence();
                        (base, best, disturbance, verdict)
                    })
                    .collect();
                let share = |test: &dyn Fn(&Row) -> bool| rows.iter().filter(|r| test(r)).count();
                let verdict = |v: Origin| share(&move |r| r.3.verdict == v);
                println!(
                    "| {} | {hidden:?} | {} | {count} | {} | {} | {} | {} | {}, {}, {} | {} | {} | {} | {} | {} |",
                    family.name,
                    if pinkish { "1/f" } else { "white" },
                    share(&|r| r.0.residual_analysis.repeatable < 0.01),
                    share(&|r| r.0.nonlinearities.evidence() > 3.0),
                    share(&|r| r.0.residual_analysis.repeatable < 0.05),
                    share(&|r| r.0.nonlinearities.evidence() > 1.0),
                    share(&|r| r.1.residual_analysis.repeatable < 0.01),
                    share(&|r| r.1.nonlinearities.evidence() > 3.0),
                    share(&|r| r.2 > 3.0),
                    verdict(Origin::Nothing),
                    verdict(Origin::Effect),
                    verdict(Origin::Disturbance),
                    verdict(Origin::UnknownCause),
                    share(&|r| r.3.verdict == Origin::UnknownCause || !r.3.warnings.is_empty()),
                );
                if let Some((_, _, _, verdict)) = rows.first() {
                    println!(
                        "  e.g. {:?} {:?} {:?} {:?}",
                        verdict.by_effect, verdict.by_disturbance, verdict.by_both, verdict.warnings
                    );
                }
            }
        }
    }
}

#[test]
#[ignore = "a study: how long it takes"]
fn pace() {
    let case = Case::new(&FAMILIES[0], Hidden::Gust(1), true, 0.03, 0.1, 400, 5);
    for _ in 0..2 {
        let begun = std::time::Instant::now();
        let found = residual_evidence(&case.model, &case.fitted_runs()).unwrap();
        println!(
            "{:?} {} {} {}",
            begun.elapsed(),
            found.places.evidence(),
            found.nonlinearities.evidence(),
            found.residual_analysis.repeatable
        );
    }
}
