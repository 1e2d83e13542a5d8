//! Errors where the size of the noise varies: whole estimations against the truth.

use crate::residuals::NoiseVariation;
use crate::specimen::{Normal, Sample, grid, param, problem, run};
use crate::*;

/// A swing that dies out: a exp(-b x) cos(c x) + d, and its slope in x.
const SWING: Sample = |x, theta, y, d| {
    let [a, b, c, offset] = [theta[0], theta[1], theta[2], theta[3]];
    let (e, s, k) = ((-b * x).exp(), (c * x).sin(), (c * x).cos());
    y[0] = a * e * k + offset;
    d[..4].copy_from_slice(&[e * k, -x * a * e * k, -x * a * e * s, 1.0]);
    if y.len() > 1 {
        y[1] = -a * e * (b * k + c * s);
        let by_b = -a * e * k + x * a * e * (b * k + c * s);
        d[4..].copy_from_slice(&[y[1] / a, by_b, -a * e * (s + x * (c * k - b * s)), 0.0]);
    }
};
const TRUTH: [f64; 4] = [2.0, 0.15, 1.3, 0.1];

/// Share of the intervals of all parameters that hold the truth, and of repeats with a remark.
fn held(
    repeats: u64,
    runs: usize,
    n: usize,
    q: usize,
    noise: impl Fn(f64, &mut Normal, &mut f64) -> f64,
) -> (f64, f64) {
    let (mut held, mut all, mut told) = (0, 0, 0);
    for seed in 0..repeats {
        let mut normal = Normal(17 + 7919 * seed);
        let data = (0..runs).map(|r| {
            let x = grid(n, 12.0 + r as f64);
            let (mut y, mut d, mut state) = (vec![0.0; q], vec![0.0; 4 * q], 0.0);
            for _ in 0..200 {
                noise(0.0, &mut normal, &mut state);
            }
            run(&format!("r{r}"), x.clone(), q, SWING, &TRUTH, |k, o| {
                SWING(x[k], &TRUTH, &mut y, &mut d);
                noise(y[o], &mut normal, &mut state)
            })
        });
        let params = ["a", "b", "c", "d"].iter().zip(TRUTH).map(|(name, value)| param(name, value)).collect();
        let fit =
            estimate(&mut problem(params, data.collect()), &Options::default(), &Work::default()).expect("a problem");
        assert!(fit.is_good(), "{}", fit.termination);
        told += usize::from(fit.noise_variation.iter().any(NoiseVariation::is_significant));
        for (p, truth) in fit.parameters.iter().zip(TRUTH) {
            let [low, high] = p.interval().expect("an interval");
            held += usize::from(low <= truth && truth <= high);
            all += 1;
        }
    }
    (held as f64 / all as f64, told as f64 / repeats as f64)
}

fn growing(y: f64, normal: &mut Normal, _: &mut f64) -> f64 {
    (0.005 + 0.1 * y.abs()) * normal.next()
}

#[test]
fn intervals_hold_under_noise_that_grows_with_the_signal_and_it_is_told() {
    for (repeats, runs, n, q) in [(50, 1, 120, 1), (25, 1, 600, 1), (12, 2, 80, 2)] {
        let (held, told) = held(repeats, runs, n, q, growing);
        assert!((0.87..=0.995).contains(&held), "{held} of {runs} runs of {n} samples");
        assert!(told > 0.95, "{told}");
    }
}

#[test]
fn and_where_it_is_coloured_too() {
    let noise = |y: f64, normal: &mut Normal, state: &mut f64| {
        *state = 0.7 * *state + 0.71 * normal.next();
        (0.005 + 0.1 * y.abs()) * *state
    };
    let (held, told) = held(25, 1, 700, 1, noise);
    assert!((0.86..=0.995).contains(&held) && told > 0.95, "{held} {told}");
}

#[test]
fn noise_of_one_size_is_not_told_and_changes_nothing() {
    let white = |_: f64, normal: &mut Normal, _: &mut f64| 0.1 * normal.next();
    let coloured = |_: f64, normal: &mut Normal, state: &mut f64| {
        *state = 0.8 * *state + 0.06 * normal.next();
        *state
    };
    let all = [held(40, 1, 60, 1, white), held(20, 1, 600, 1, coloured)];
    assert!(all.iter().all(|(_, told)| *told <= 0.05), "{all:?}");
}
