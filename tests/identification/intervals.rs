//! Intervals where the likelihood is curved: two rates that the record hardly tells apart, in white and in coloured noise. What is said of their profile is
//! compared with a search over closed forms.

use fdm::estimate::{Curvature, Fit, FitOptions, Work, fit, quantile};
use fdm::record::Run;
use support::Normal;

/// Two stages in series after a unit step: the response is the same with p and s exchanged, so that where they are equal it says nothing of their difference
/// to first order.
const STAGES: &str = "model stages {
  state a = 0, b = 0;
  param K = 1, p = 1.5 in [0, 100] [1/s], s = 0.7 in [0, 100] [1/s];
  der(a) = s*(1 - a);
  der(b) = p*(K*a - b);
  output y = b;
NOISE}";

/// Deviation of the noise.
const DEVIATION: f64 = 0.02;

fn response(t: f64, p: f64, s: f64) -> f64 {
    if (p - s).abs() < 1e-6 * p {
        return 1.0 - (1.0 + p * t) * (-p * t).exp();
    }
    1.0 - (p * (-s * t).exp() - s * (-p * t).exp()) / (p - s)
}

/// Noise of deviation 1 whose neighbours correlate by `rho`.
fn noise(seed: u64, count: usize, rho: f64) -> Vec<f64> {
    let mut normal = Normal(seed);
    let mut last = normal.next();
    (0..count)
        .map(|_| {
            last = rho * last + (1.0 - rho * rho).sqrt() * normal.next();
            last
        })
        .collect()
}

fn record(count: usize, dt: f64, noise: &[f64]) -> Run {
    let time: Vec<f64> = (0..count).map(|k| dt * k as f64).collect();
    let measured = time.iter().zip(noise).map(|(t, v)| 1.3 * response(*t, 1.25, 1.15) + DEVIATION * v).collect();
    let (name, inputs, held) = ("step".into(), Vec::new(), Vec::new());
    Run { name, time, inputs, measured, held, input_gaps: vec![], stated: Vec::new(), output_gaps: vec![0] }
}

fn fitted(noise: &str, run: &Run) -> Fit {
    let model = support::model(&STAGES.replace("NOISE", noise));
    fit(&model, std::slice::from_ref(run), &FitOptions::default(), &Work::default()).unwrap()
}

/// The least sum of squares with one rate held, over the other and K.
fn squares(run: &Run, p: f64) -> f64 {
    let of = |s: f64| {
        let y: Vec<f64> = run.time.iter().map(|t| response(*t, p, s)).collect();
        let k = y.iter().zip(&run.measured).map(|(y, z)| y * z).sum::<f64>() / y.iter().map(|y| y * y).sum::<f64>();
        y.iter().zip(&run.measured).map(|(y, z)| (z - k * y).powi(2)).sum::<f64>()
    };
    // from the best of a grid on: there may be a minimum on each side of p
    let grid = (0..90).map(|k| 0.05 * 1.07_f64.powi(k));
    let best = grid.min_by(|a, b| of(*a).total_cmp(&of(*b))).unwrap();
    let (mut low, mut high) = (best / 1.07, best * 1.07);
    let part = 0.5 * (5.0_f64.sqrt() - 1.0);
    while high - low > 1e-6 {
        let (a, b) = (high - part * (high - low), low + part * (high - low));
        if of(a) < of(b) { high = b } else { low = a }
    }
    of(0.5 * (low + high))
}

fn least(run: &Run) -> f64 {
    (0..400).map(|k| squares(run, 0.4 + 0.01 * f64::from(k))).fold(f64::INFINITY, f64::min)
}

/// What is said of the profile of a rate, with both ends.
fn said(found: &Fit) -> Option<(&Curvature, [f64; 2])> {
    let told = found.estimate.curvature.iter().find(|c| c.parameter != "K")?;
    let [Some(low), Some(high)] = told.interval else { panic!("{told:?}") };
    Some((told, [low, high]))
}

/// Corrected over Cramer-Rao error, and the degrees of freedom of the former.
fn corrected(found: &Fit, name: &str) -> (f64, Option<f64>) {
    let p = found.estimate.parameter(name, None).unwrap();
    (p.corrected_error.unwrap() / p.standard_error.unwrap(), p.degrees_of_freedom)
}

/// Whether the error of a rate is larger than the rate.
fn is_lost(found: &Fit) -> bool {
    let p = found.estimate.parameter("p", None).unwrap();
    found.estimate.termination.is_good() && p.error().is_some_and(|error| error > p.value)
}

#[test]
fn rates_that_are_equal_to_first_order_get_the_interval_of_their_profile() {
    let (mut lost, mut judged) = (0, 0);
    for seed in 0..8 {
        let run = record(60, 0.1, &noise(900 + seed, 60, 0.0));
        let found = fitted(&format!("  noise y = {DEVIATION};\n"), &run);
        if !is_lost(&found) {
            continue;
        }
        lost += 1;
        let (told, ends) = said(&found).unwrap_or_else(|| panic!("nothing is said: {:?}", found.estimate.parameters));
        assert!(!told.is_narrow() && ends[0] > 0.3 && ends[1] < 4.0, "{told:?}");
        // where the residuals look coloured by chance the errors are others
        let (factor, freedom) = corrected(&found, &told.parameter);
        if (factor, freedom) != (1.0, None) {
            continue;
        }
        judged += 1;
        let (base, wanted) = (least(&run), 0.5 * quantile(None).powi(2));
        for end in ends {
            let rise = 0.5 * (squares(&run, end) - base) / DEVIATION.powi(2);
            // an end is taken where the root of the rise is right to two parts in a hundred
            assert!((rise / wanted - 1.0).abs() < 0.15, "{rise} for {wanted} at {end}: {told:?}");
        }
    }
    assert!(lost >= 2 && judged >= 1, "{lost} of 8 fits say nothing of the rates to first order, {judged} judged");
}

#[test]
fn their_profile_is_that_of_errors_corrected_for_colour() {
    let mut told_of = 0;
    for seed in 0..4 {
        let count = 600;
        let run = record(count, 0.01, &noise(70 + seed, count, 0.8));
        let found = fitted("", &run);
        let Some((told, ends)) = said(&found) else { continue };
        told_of += 1;
        let (factor, freedom) = corrected(&found, &told.parameter);
        let other = corrected(&found, "K").0;
        assert!(factor > 1.5 && (factor / other - 1.0).abs() < 0.3, "{factor} {other}");
        let (base, left) = (least(&run), (count - 3) as f64);
        for end in ends {
            let errors = (left * (squares(&run, end) / base - 1.0)).sqrt() / factor;
            assert!((errors / quantile(freedom) - 1.0).abs() < 0.1, "{errors} at {end}: {told:?}, {freedom:?}");
        }
    }
    assert!(told_of >= 1, "nothing is said in 4 fits");
}
