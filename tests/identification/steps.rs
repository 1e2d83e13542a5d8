//! How steps are chosen, and whether the error that is claimed is the true one.

use fdm::record::Run;
use fdm::simulate::{Simulator, StepOptions, Steps, choose_steps, integration_error, output_range};
use support::model;

/// Samples of one input, or none, for a model with so many outputs.
fn run(time: Vec<f64>, input: Option<fn(f64) -> f64>, outputs: usize) -> Run {
    let inputs: Vec<f64> = time.iter().flat_map(|t| input.map(|u| u(*t))).collect();
    let count = usize::from(input.is_some());
    Run {
        name: "a".into(),
        inputs,
        held: vec![false; count],
        measured: vec![0.0; outputs * time.len()],
        input_gaps: vec![0; count],
        stated: Vec::new(),
        output_gaps: vec![0; outputs],
        time,
    }
}

/// z is the integral of a kink at c, which stands anywhere in its step: `(t - c)^2/2` behind it.
#[test]
fn a_kink_anywhere_in_a_step_costs_no_more_than_is_claimed() {
    let text =
        "model ramp { param c = 1; state x = 0; state z = 0; der(x) = 1; der(z) = max(0, x - c); output y = z; }";
    let model = model(text);
    let run = run((0..6).map(f64::from).collect(), None, 1);
    for per_interval in [1, 2, 3, 4, 8, 20] {
        for place in 0..97 {
            let c = 1.0 + 2.0 * (f64::from(place) + 0.013) / 97.0;
            let mut z = vec![0.0; run.len()];
            Simulator::new(model.dynamics(), &run, per_interval).unwrap().simulate(&[c], &mut z).unwrap();
            let exact = |t: &f64| 0.5 * (t - c).max(0.0).powi(2);
            let off = run.time.iter().zip(&z).map(|(t, z)| (z - exact(t)).abs()).fold(0.0, f64::max) / exact(&5.0);
            let claimed = integration_error(model.dynamics(), &run, &[c], per_interval).unwrap();
            let most = 4.5 * off.max(5e-3 / (per_interval as f64).powi(2));
            assert!(off <= 1.03 * claimed && claimed < most, "{per_interval} {c}: {off:e}, claimed {claimed:e}");
        }
    }
}

/// A smooth response is not claimed to be worse than twice its error, however few grids show the order of the method.
#[test]
fn the_error_of_a_smooth_response_is_claimed_within_a_factor_of_two() {
    let text = "model tank { state x = 1; der(x) = -x*x; output y = x; }";
    let model = model(text);
    let run = run((0..6).map(f64::from).collect(), None, 1);
    for per_interval in [3, 8] {
        let mut x = vec![0.0; run.len()];
        Simulator::new(model.dynamics(), &run, per_interval).unwrap().simulate(&[], &mut x).unwrap();
        let off = run.time.iter().zip(&x).map(|(t, x)| (x - 1.0 / (1.0 + t)).abs()).fold(0.0, f64::max);
        let claimed = integration_error(model.dynamics(), &run, &[], per_interval).unwrap() * (5.0 / 6.0);
        assert!(claimed > 0.9 * off && claimed < 2.1 * off, "{per_interval}: {off:e}, claimed {claimed:e}");
    }
}

/// Behind a jump at c the rate is 2, before it -1. Steps that are to be cut at kinks are none the worse for it, and do not hide it.
#[test]
fn a_jump_is_not_taken_for_a_kink() {
    let text = "model jump { param c = 1; state x = 0; state z = 0; der(x) = 1; der(z) = if x > c then 2 else -1; output y = z; }";
    let model = model(text);
    let run = run((0..6).map(f64::from).collect(), None, 1);
    for per_interval in [1, 3, 4, 8] {
        for place in 0..97 {
            let c = 1.0 + 2.0 * (f64::from(place) + 0.013) / 97.0;
            let (mut z, steps) = (vec![0.0; run.len()], Steps::from(per_interval).cut_at_kinks());
            Simulator::new(model.dynamics(), &run, steps.clone()).unwrap().simulate(&[c], &mut z).unwrap();
            let exact: Vec<f64> = run.time.iter().map(|t| 3.0 * (t - c).max(0.0) - t).collect();
            let off = exact.iter().zip(&z).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / output_range(exact.iter());
            let claimed = integration_error(model.dynamics(), &run, &[c], steps).unwrap();
            assert!(off <= 1.4 * claimed, "{per_interval} {c}: {off:e}, claimed {claimed:e}");
        }
    }
}

/// Where kinks cost the order, few steps that are cut there reach what many whole ones do not; where none is met, steps are whole.
#[test]
fn steps_are_cut_at_kinks_where_that_is_cheaper() {
    let text = "model servo { input u; param c = 0.2; state d; state z; der(d) = 2*u - d - 0.5*z; der(z) = clip(d, -c, c) - z; \
                output y = d; output w = z; }";
    let model = model(text);
    let run = run((0..40).map(|k| 0.1 * f64::from(k)).collect(), Some(|t| (1.7 * t).sin()), 2);
    let choose = |c: f64| choose_steps(model.dynamics(), &run, &[c], &StepOptions::default()).unwrap();
    let (met, missed) = (choose(0.2), choose(50.0));
    assert!(met.steps.are_cut() && met.steps.most() <= 16 && met.error <= 1e-8, "{met:?}");
    assert!(!missed.steps.are_cut() && missed.error <= 1e-8, "{missed:?}");
    let whole = integration_error(model.dynamics(), &run, &[0.2], 4 * met.steps.most()).unwrap();
    assert!(whole > 1e-8, "{whole:e}");
}
