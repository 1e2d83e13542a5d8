//! Designs whose answers are known.

use super::*;
use fdm_estimate::{Halt, Work};
use fdm_system::Model;
use fdm_system::record::Run;

const TEXT: &str = "model m { input u, v; state x = 0; param k = 2 in [0, 50] [1/s], g = 3, h = 1, c = 0.5 fixed;
    der(x) = -k*x + g*u + h*v*c; output y = x; noise y = 0.01; }";

fn question(model: &Model) -> Question<'_> {
    Question {
        model,
        theta: model.definition().start(),
        deviations: vec![0.01],
        known: Vec::new(),
        rest: vec![0.0; 2],
        heights: vec![Some(1.0), Some(2.0)],
        rates: vec![None; model.definition().inputs.len()],
        limits: vec![None],
        duration: 10.0,
        dt: 0.05,
        runs: 2,
    }
}

#[test]
fn the_input_that_was_not_moved_is_the_next_one_to_move() {
    let model = Model::from_text("m.fdm", TEXT).unwrap();
    let n = 200;
    let run = Run {
        name: "one".into(),
        time: (0..n).map(|k| 0.05 * k as f64).collect(),
        inputs: (0..n).flat_map(|k| [f64::from(u8::from(k % 40 < 20)), 0.0]).collect(),
        held: vec![false; 2],
        measured: vec![0.0; n],
        input_gaps: vec![0; 2],
        stated: Vec::new(),
        output_gaps: vec![0],
    };
    let asked = question(&model);
    let known = vec![(run, asked.theta.clone())];
    let found = design(&Question { known, ..asked }, &Halt::default()).unwrap();
    let h = &found.outlook[2];
    assert_eq!((h.parameter.as_str(), h.now), ("h", None));
    assert!(found.undetermined_now[0].sentence.contains("`h`"));
    assert_eq!((found.steps[0].manoeuvre.input.as_str(), found.undetermined_then.len()), ("v", 0));
    let (best, error) = h.best.unwrap();
    assert_eq!(found.gains[best].manoeuvre.input, "v");
    assert!(h.then[0].unwrap() >= error && error < 0.05, "{h:?}");
    assert!(found.gains.windows(2).all(|pair| pair[0].bits >= pair[1].bits) && found.steps[0].bits > 3.0);
}

#[test]
fn what_no_input_moves_stays_unknown_and_is_said() {
    // only the product of both gains enters
    let text = "model m { input u; state x = 0; param a = 2, b = 3; der(x) = a*b*u - x; output y = x; }";
    let model = Model::from_text("m.fdm", text).unwrap();
    let asked = question(&model);
    let found = design(&Question { rest: vec![0.0], heights: vec![Some(1.0)], ..asked }, &Halt::default()).unwrap();
    assert!(found.undetermined_then[0].sentence.contains("`a`"), "{:?}", found.undetermined_then);
    assert!(found.outlook.iter().all(|o| o.best.is_none() && o.then == [None, None]));
}

#[test]
fn runs_that_leave_all_bounds_are_told_and_left_out() {
    let text = "model m { input u; state x = 0.1; param k = 1; der(x) = k*x^3 + u^2; output y = x; }";
    let model = Model::from_text("m.fdm", text).unwrap();
    let asked = question(&model);
    let found =
        design(&Question { rest: vec![0.0], heights: vec![Some(9.0)], duration: 2.0, ..asked }, &Halt::default())
            .unwrap();
    assert!(!found.lost.is_empty() && found.lost[0].1.contains("runs away"), "{:?}", found.lost.first());
}

#[test]
fn impossible_questions_are_refused_with_all_reasons() {
    let model = Model::from_text("m.fdm", TEXT).unwrap();
    let asked = question(&model);
    let heights = vec![None, None];
    let said =
        design(&Question { heights, dt: 9.0, deviations: vec![f64::NAN], ..asked }, &Halt::default()).unwrap_err();
    assert_eq!(said.len(), 3, "{said:?}");
    assert!(
        said[0].contains("--amplitude u=VALUE") && said[1].contains("2 samples") && said[2].contains("noise of `y`")
    );
}

/// Experiments of one sample or two, at rest.
fn space<'a>(model: &'a Model, range: Option<[f64; 2]>, runs: usize, samples: usize) -> DesignSpace<'a> {
    let inputs = model.definition().inputs.len();
    let question = Question {
        rest: vec![0.0; inputs],
        heights: vec![None; inputs],
        deviations: vec![0.001],
        duration: 6.0,
        dt: 0.02,
        runs,
        ..question(model)
    };
    let factor = |range| Factor { name: "S".into(), unit: None, place: Place::Input(0), range };
    DesignSpace { question, factors: range.into_iter().map(factor).collect(), samples: Some(samples) }
}

fn levels(found: &Experiments) -> Vec<f64> {
    let mut levels: Vec<f64> = found.experiments.iter().map(|one| one.levels[0].value).collect();
    levels.sort_by(f64::total_cmp);
    levels
}

/// Two times of a decay (Box and Lucas 1959), two concentrations of an enzyme (Duggleby 1979).
#[test]
fn experiments_are_at_optima_known_in_closed_form() {
    let decay = "model decay { param a = 2, k = 0.5; state y = a; der(y) = -k*y; output z = y; noise z = 0.001; }";
    let model = Model::from_text("d.fdm", decay).unwrap();
    let found = experiments(&space(&model, None, 1, 2), &Halt::default()).unwrap().0;
    let times = &found.experiments[0].times;
    assert!(times[0] == 0.0 && (times[1] / 2.0 - 1.0).abs() < 0.01, "{times:?}");
    assert!(found.undetermined_now.len() == 2 && found.undetermined_then.is_empty());

    let law = "model law { known S per run; param V = 3, Km = 0.5; output v = V*S/(Km + S); noise v = 0.001; }";
    let model = Model::from_text("l.fdm", law).unwrap();
    let asked = space(&model, Some([0.0, 5.0]), 2, 1);
    let found = experiments(&asked, &Halt::default()).unwrap().0;
    let half = 0.5 * 5.0 / (2.0 * 0.5 + 5.0);
    let both = levels(&found);
    assert!((both[0] / half - 1.0).abs() < 0.01 && both[1] == 5.0, "{both:?}");
    assert!(found.outlook.iter().all(|o| o.now.is_none() && o.then[1].is_some()));
    // a run that was made counts: only the other one is planned
    let run = asked.question.resting("earlier", &[5.0]);
    let known = vec![(run, asked.question.theta.clone())];
    let question = Question { known, runs: 1, ..asked.question.clone() };
    let next = experiments(&DesignSpace { question, ..asked }, &Halt::default()).unwrap().0;
    assert!((levels(&next)[0] / half - 1.0).abs() < 0.01 && next.undetermined_now.len() == 1, "{:?}", next.experiments);
}

/// The best three are not the best one and what suits it: each is sought beside the others.
#[test]
fn experiments_are_exchanged_until_none_gets_better() {
    let text =
        "model curve { known S per run; param a = 1, b = 1, c = 1; output y = a + b*S + c*S^2; noise y = 0.001; }";
    let model = Model::from_text("t.fdm", text).unwrap();
    let asked = space(&model, Some([-1.0, 1.0]), 3, 1);
    let three = levels(&experiments(&asked, &Halt::default()).unwrap().0);
    // of a parabola: both ends and the middle
    assert!(three[0] == -1.0 && three[1].abs() < 0.01 && three[2] == 1.0, "{three:?}");
    let said = experiments(&DesignSpace { samples: Some(999), ..asked }, &Halt::default()).unwrap_err();
    assert!(said[0].contains("999 samples") && said[0].contains("301 times"), "{said:?}");
}

const LINEAR: &str =
    "model linear { input u; state x = 0; param k = 2, g = 3; der(x) = -k*x + g*u; output y = x; noise y = 0.01; }";
const CUBIC: &str = "model cubic { input u; state x = 0; param k = 2, g = 3, c = 0.05; der(x) = -k*x - c*x^3 + g*u;
    output y = x; noise y = 0.01; }";

fn single(model: &Model) -> Question<'_> {
    Question { rest: vec![0.0], heights: vec![Some(1.0)], ..question(model) }
}

#[test]
fn expected_odds_are_those_of_the_fit_of_the_wrong_model() {
    let (linear, cubic) = (Model::from_text("l.fdm", LINEAR).unwrap(), Model::from_text("c.fdm", CUBIC).unwrap());
    let rivals = Rivals { first: single(&linear), second: single(&cubic) };
    let found = between(&rivals, &Halt::default()).unwrap();
    assert_eq!(found.models, ["linear", "cubic"]);
    let best = &found.separations[0];
    // the linear one, inside the cubic one, can always be followed
    // by the cubic one, but for what is not linear about its own values
    assert!(best.log_odds[0] < 0.02 * best.log_odds[1] && best.log_odds[1] > 1.0, "{best:?}");
    // what the cubic one does, without noise, fitted by the linear one
    let mut run = plan::run(&rivals.first, &best.manoeuvre).unwrap();
    let steps = fdm_system::simulate::choose_steps(cubic.dynamics(), &run, &rivals.second.theta, &Default::default())
        .unwrap()
        .steps;
    let mut simulator = fdm_system::simulate::Simulator::new(cubic.dynamics(), &run, steps).unwrap();
    let mut response = vec![0.0; run.measured.len()];
    simulator.simulate(&rivals.second.theta, &mut response).unwrap();
    run.measured = response;
    let options = fdm_estimate::FitOptions::default().with_declared_noise(&linear);
    let fit = fdm_estimate::fit(&linear, &[run], &options, &Work::default()).unwrap();
    let residuals = &fit.estimate.runs[0].residuals;
    let half: f64 = residuals.iter().map(|r| 0.5 * (r / 0.01_f64).powi(2)).sum();
    assert!((half - best.log_odds[1]).abs() < 0.1 * half, "{half} {best:?}");
    // later runs add to the odds
    assert!(found.steps[1].log_odds[1] > found.steps[0].log_odds[1]);
}

#[test]
fn limits_make_manoeuvres_smaller_and_rates_make_ramps() {
    let (linear, cubic) = (Model::from_text("l.fdm", LINEAR).unwrap(), Model::from_text("c.fdm", CUBIC).unwrap());
    let limited = Question { limits: vec![Some(0.8)], rates: vec![Some(0.5)], ..single(&linear) };
    let found = between(&Rivals { first: limited.clone(), second: single(&cubic) }, &Halt::default()).unwrap();
    assert!(found.separations.iter().all(|s| s.excursions[0] <= 0.8));
    let step = design(&limited, &Halt::default()).unwrap();
    assert!(step.gains.iter().all(|g| g.excursions[0] <= 0.8) && step.gains.iter().any(|g| g.manoeuvre.height < 1.0));
    let run = plan::run(&limited, &found.separations[0].manoeuvre).unwrap();
    let fastest = run.inputs.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
    assert!(fastest <= 0.5 * 0.05 + 1e-12, "{fastest}");
    let hopeless = Question { limits: vec![Some(1e-6)], ..single(&linear) };
    let found = design(&hopeless, &Halt::default()).unwrap();
    assert!(found.gains.is_empty() && found.lost[0].1.contains("and may by"), "{:?}", found.lost[0]);
}

#[test]
fn models_that_show_other_things_cannot_be_told_apart() {
    let other = "model other { input w; state x = 0; param k = 2; der(x) = w - k*x; output y = x; noise y = 0.01; }";
    let (linear, other) = (Model::from_text("l.fdm", LINEAR).unwrap(), Model::from_text("o.fdm", other).unwrap());
    let said = between(&Rivals { first: single(&linear), second: single(&other) }, &Halt::default()).unwrap_err();
    assert!(said[0].contains("input u") && said[0].contains("input w"), "{said:?}");
}
