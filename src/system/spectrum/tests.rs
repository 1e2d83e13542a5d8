//! Transforms of runs against their definition, and the identity of derivatives.
//!
//! Frequency responses of known systems from simulated records.

use super::frequencies::Cycles;
use super::*;
use crate::record::Run;
use fdm_numeric::random::Normal;
use num_complex::Complex64;
use std::f64::consts::TAU;

fn run(dt: f64, inputs: &[Vec<f64>], held: bool, outputs: &[Vec<f64>]) -> Run {
    let n = inputs.iter().chain(outputs).map(Vec::len).max().unwrap_or(0);
    let rows = |channels: &[Vec<f64>]| (0..n).flat_map(|k| channels.iter().map(move |c| c[k])).collect();
    Run {
        name: "r".into(),
        time: (0..n).map(|k| k as f64 * dt).collect(),
        inputs: rows(inputs),
        held: vec![held; inputs.len()],
        measured: rows(outputs),
        input_gaps: vec![0; inputs.len()],
        stated: Vec::new(),
        output_gaps: vec![0; outputs.len()],
    }
}

fn noise(seed: u64, n: usize) -> Vec<f64> {
    let mut normal = Normal(seed);
    (0..n).map(|_| normal.next()).collect()
}

fn options(interpolant: Interpolant) -> SpectrumOptions {
    SpectrumOptions { interpolant, ..SpectrumOptions::default() }
}

const ALL: Frequencies = Frequencies::Grid { lowest: None, highest: None };
const BAND: Frequencies = Frequencies::Band { lowest: 0.7, highest: 4.3, spacing: Some(0.0137) };

/// The sum itself, compensated (Neumaier), with exact turns.
pub(super) fn direct(x: &[f64], cycles: Cycles) -> Complex64 {
    let mut sums = [(0.0, 0.0); 2];
    for (k, x) in x.iter().enumerate() {
        let turn = cycles.turned(k as f64);
        for (sum, term) in sums.iter_mut().zip([x * turn.re, x * turn.im]) {
            let total: f64 = sum.0 + term;
            sum.1 += if sum.0.abs() >= term.abs() { (sum.0 - total) + term } else { (term - total) + sum.0 };
            sum.0 = total;
        }
    }
    Complex64::new(sums[0].0 + sums[0].1, sums[1].0 + sums[1].1)
}

#[test]
fn every_length_agrees_with_the_sum_itself() {
    for n in [1usize, 2, 7, 31, 97, 128, 360, 1009] {
        let x = noise(n as u64, 3 * n);
        let size = x.iter().map(|v| v * v).sum::<f64>().sqrt();
        let choices = [ALL, Frequencies::Band { lowest: 1.0 / n as f64, highest: 0.41, spacing: Some(0.0051) }];
        for comb in choices.iter().filter_map(|c| c.of(n, 1.0, 3).ok()) {
            let sums = Transform::new(n, 3, &comb).apply(&x);
            for c in 0..3 {
                let channel: Vec<f64> = x.iter().skip(c).step_by(3).copied().collect();
                for (k, cycles) in comb.cycles.iter().enumerate() {
                    let apart = (sums[c * comb.len() + k] - direct(&channel, *cycles)).norm();
                    assert!(apart < 4e-15 * size * (n as f64).ln().max(1.0), "{n}: {apart:e} of {size}");
                }
            }
        }
    }
}

#[test]
fn every_way_gives_the_same_sums() {
    let (n, channels) = (1511, 5);
    let x = noise(4, n * channels);
    let size = x.iter().map(|v| v * v).sum::<f64>().sqrt();
    let bands = [(0.002, 0.011, 1e-4), (0.2, 0.21, 1.37e-4), (0.003, 0.009, 1.0 / 8400.0)];
    for (lowest, highest, spacing) in bands {
        let band = Frequencies::Band { lowest, highest, spacing: Some(spacing) };
        let comb = band.of(n, 1.0, channels).expect("a band");
        let exact: Vec<Complex64> = (0..channels)
            .flat_map(|c| {
                let channel: Vec<f64> = x.iter().skip(c).step_by(channels).copied().collect();
                comb.cycles.iter().map(move |v| direct(&channel, *v)).collect::<Vec<_>>()
            })
            .collect();
        let designs = decimation::Design::all(lowest, highest).filter(|d| [2, 5, 20].contains(&d.step));
        let designs: Vec<_> = std::iter::once(None).chain(designs.map(Some)).collect();
        assert!(designs.len() > 3);
        for design in designs {
            for sum in [transform::Kind::Direct, transform::Kind::Chirp] {
                let found = Transform::by(transform::Way { design, sum }, n, channels, &comb).apply(&x);
                let apart = found.iter().zip(&exact).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
                assert!(apart < 1e-13 * size / (channels as f64).sqrt(), "{design:?} {sum:?}: {apart:e} of {size}");
            }
        }
    }
}

#[test]
fn energy_in_time_is_energy_in_frequency() {
    for n in [40usize, 41, 101, 350] {
        let spectrum = Spectrum::of(
            &run(0.01, &[], false, &[noise(9, n)]),
            &ALL,
            &SpectrumOptions { ends: Ends::Extrapolated, ..options(Interpolant::Samples) },
        )
        .expect("even");
        let x = noise(9, n);
        let mean = x.iter().sum::<f64>() / n as f64;
        let alternating: f64 =
            x.iter().enumerate().map(|(k, v)| if k % 2 == 0 { *v } else { -*v }).sum::<f64>() / n as f64;
        let nyquist = if n % 2 == 0 { alternating * alternating } else { 0.0 };
        let energy = 2.0 * spectrum.outputs.iter().map(|c| c.norm_sqr()).sum::<f64>() + nyquist;
        let variance = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64;
        assert!((energy / variance - 1.0).abs() < 1e-13, "{energy} {variance}");
    }
}

/// Integral of `f(t) exp(-j w t)` from 0.5 to N - 1.5 samples, by many points in every half interval; time from the second sample on.
fn integral(n: usize, dt: f64, w: f64, f: impl Fn(f64) -> f64) -> Complex64 {
    let mut sum = Complex64::ZERO;
    let root = 0.6f64.sqrt();
    for piece in 0..8 * (n - 2) {
        let (h, start) = (dt / 8.0, 0.5 * dt + piece as f64 * dt / 8.0);
        for (x, weight) in [(-root, 5.0 / 18.0), (0.0, 8.0 / 18.0), (root, 5.0 / 18.0)] {
            let t = start + 0.5 * h * (1.0 + x);
            sum += Complex64::cis(-w * (t - dt)) * (f(t) * weight * h);
        }
    }
    sum / ((n - 2) as f64 * dt)
}

#[test]
fn inputs_are_transformed_as_they_are_integrated() {
    let (n, dt) = (60, 0.1);
    let x = noise(3, n);
    for held in [true, false] {
        let value = |t: f64| {
            let k = ((t / dt) as usize).min(n - 2);
            let part = if held { 0.0 } else { t / dt - k as f64 };
            x[k] + part * (x[k + 1] - x[k])
        };
        let mean = integral(n, dt, 0.0, value).re;
        for choice in [ALL, BAND] {
            let found =
                Spectrum::of(&run(dt, std::slice::from_ref(&x), held, &[]), &choice, &SpectrumOptions::default())
                    .expect("even");
            for (w, found) in found.omega.iter().zip(&found.inputs) {
                let want = integral(n, dt, *w, |t| value(t) - mean);
                assert!((found - want).norm() < 1e-8, "{held} {w}: {found} {want}");
            }
        }
    }
}

/// Every sample of an output behind one another, and a command that changes at instants of its own.
fn commanded(n: usize, dt: f64, changes: &[(f64, f64)], missing: std::ops::Range<usize>) -> Run {
    let sampled = (0..n).filter(|k| !missing.contains(k)).map(|k| (k as f64 * dt, (0.7 * k as f64).sin()));
    let mut rows: Vec<(f64, f64)> = sampled.chain(changes.iter().map(|(t, _)| (*t, f64::NAN))).collect();
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    rows.dedup_by(|a, b| a.0 == b.0);
    let before = |t: f64| changes.iter().rev().find(|(at, _)| *at <= t).map_or(0.4, |(_, value)| *value);
    let (time, measured): (Vec<f64>, Vec<f64>) = rows.into_iter().unzip();
    let inputs = time.iter().map(|t| before(*t)).collect();
    let name = "r".into();
    Run {
        name,
        time,
        inputs,
        held: vec![true],
        measured,
        input_gaps: vec![0],
        stated: vec![true],
        output_gaps: vec![0],
    }
}

#[test]
fn held_inputs_keep_edges_of_another_clock() {
    let (n, dt) = (60, 0.1);
    let values = noise(8, 40);
    // two in one interval, some at samples, some in the first and the last half interval; all of them in the middle of intervals
    let own: Vec<(f64, f64)> = (0..40).map(|k| (0.013 + 0.149 * k as f64, values[k])).filter(|c| c.0 < 5.9).collect();
    let close = [&own[..], &[(2.31, 7.0), (2.36, 8.0), (5.83, 2.0)]].concat();
    let halves: Vec<(f64, f64)> = (0..29).map(|k| (0.15 + 0.2 * k as f64, values[k])).collect();
    for (mut changes, missing) in [(own, 0..0), (close, 30..31), (halves, 0..0)] {
        changes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let run = commanded(n, dt, &changes, missing);
        for (ends, outer) in [(Ends::Interpolated, 1), (Ends::Extrapolated, 0)] {
            // from half an interval before the first sample to half a one behind the last, where it is what it is there
            let (zero, from) = (outer as f64 * dt, (outer as f64 - 0.5) * dt);
            let to = (n - outer) as f64 * dt - 0.5 * dt;
            let inside = changes.iter().filter(|(t, _)| (from..to).contains(t)).map(|(t, _)| *t);
            let corners: Vec<f64> = std::iter::once(from).chain(inside).chain([to]).collect();
            let value = |t: f64| changes.iter().rev().find(|(at, _)| *at <= t).map_or(0.4, |(_, value)| *value);
            let pieces = || corners.windows(2).map(|w| (w[0], w[1], value(w[0])));
            let mean = pieces().map(|(a, b, u)| u * (b - a)).sum::<f64>() / (to - from);
            for choice in [ALL, BAND] {
                let options = SpectrumOptions { ends, ..SpectrumOptions::default() };
                let found = Spectrum::of(&run, &choice, &options).expect("even where compared");
                assert_eq!((found.samples, found.dt), (n - 2 * outer, run.time[run.len() - 1] / (n - 1) as f64));
                for (w, found) in found.omega.iter().zip(&found.inputs) {
                    let turn = |t: f64| Complex64::cis(-w * (t - zero));
                    let piece = |(a, b, u): (f64, f64, f64)| (turn(a) - turn(b)) * (u - mean) / Complex64::new(0.0, *w);
                    let want = pieces().map(piece).sum::<Complex64>() / (to - from);
                    assert!((found - want).norm() < 1e-12, "{ends:?} {w}: {found} {want}");
                }
                assert!((found.input_ends[1][0] - (value(to) - mean)).abs() < 1e-12, "{ends:?}");
            }
        }
    }
}

/// What is left of `x' - (j w x + ends)` at the worst frequency, for values and slopes at the samples.
fn derivative_error(
    interpolant: Interpolant,
    choice: &Frequencies,
    x: impl Fn(f64) -> f64,
    slope: impl Fn(f64) -> f64,
) -> f64 {
    let (n, dt) = (82, 0.1);
    let times: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
    let channels = [times.iter().map(|t| x(*t)).collect(), times.iter().map(|t| slope(*t)).collect()];
    let found = Spectrum::of(&run(dt, &[], false, &channels), choice, &options(interpolant)).expect("even");
    let count = found.omega.len();
    (0..count).fold(0.0, |worst: f64, k| {
        let [before, behind] = found.end_factors(k);
        let rate = Complex64::new(0.0, found.omega[k]) * found.outputs[k] + behind * found.output_ends[1][0]
            - before * found.output_ends[0][0];
        worst.max((rate - found.outputs[count + k]).norm())
    })
}

#[test]
fn the_transform_of_a_derivative_needs_its_ends() {
    let low = Frequencies::Band { lowest: 0.3, highest: 1.0, spacing: Some(0.013) };
    let grid = Frequencies::Grid { lowest: None, highest: Some(1.0) };
    for choice in [&low, &grid] {
        // a constant and a ramp have the transforms of nothing and of a constant
        for (x, slope) in [(3.0, 0.0), (3.0, 0.7)] {
            let error = |i| derivative_error(i, choice, |t| x + slope * t, |_| slope);
            // w dt is up to 0.63: what is left of the midpoint rule is (w dt)^4 of the ramp's jump
            assert!(error(Interpolant::AsIntegrated) < 1e-15 + slope * 2e-3, "{:e}", error(Interpolant::AsIntegrated));
            assert!(error(Interpolant::Samples) < 1e-15 + slope * 2e-2);
            assert!(error(Interpolant::Linear) < 1e-13, "{:e}", error(Interpolant::Linear));
        }
        let curved = |i| derivative_error(i, choice, |t| (0.4 * t).exp(), |t| 0.4 * (0.4 * t).exp());
        let size = 0.4 * (0.4f64 * 8.2).exp();
        assert!(curved(Interpolant::AsIntegrated) < 2e-3 * size, "{:e}", curved(Interpolant::AsIntegrated) / size);
    }
}

#[test]
fn a_linear_model_has_the_same_response_in_both_domains() {
    // x' = a x + b u, y = x + d u, by the exact recursion of inputs held or linear
    let (a, b, d, dt, n): (f64, f64, f64, f64, usize) = (-1.3, 2.0, 0.8, 0.02, 900);
    let u: Vec<f64> =
        (0..n).map(|k| k as f64 * dt).map(|t| (0.8 * t).sin() + 0.4 * (3.1 * t).cos() + 0.05 * t + 1.0).collect();
    let f = (a * dt).exp();
    let phi1 = (f - 1.0) / (a * dt);
    let phi2 = (phi1 - 1.0) / (a * dt);
    for held in [false, true] {
        let mut x = vec![0.3];
        for k in 0..n - 1 {
            let slope = if held { 0.0 } else { u[k + 1] - u[k] };
            x.push(f * x[k] + b * dt * (phi1 * u[k] + phi2 * slope));
        }
        let y: Vec<f64> = x.iter().zip(&u).map(|(x, u)| x + d * u).collect();
        let record = run(dt, std::slice::from_ref(&u), held, &[x, y]);
        for choice in [Frequencies::Grid { lowest: None, highest: Some(2.0) }, BAND] {
            let found = Spectrum::of(&record, &choice, &SpectrumOptions::default()).expect("even");
            let count = found.omega.len();
            for k in 0..count {
                let w = found.omega[k];
                let [before, behind] = found.end_factors(k);
                let ends = behind * found.output_ends[1][0] - before * found.output_ends[0][0];
                let x = (found.inputs[k] * b - ends) / Complex64::new(-a, w);
                let size = found.outputs[k].norm() + found.inputs[k].norm();
                // what is left are the end values, interpolated by a line
                assert!(
                    (x - found.outputs[k]).norm() < 3e-4 * size,
                    "{held} {w}: {:e}",
                    (x - found.outputs[k]).norm() / size
                );
                let y = found.outputs[k] + found.sampled_inputs[k] * d;
                assert!(
                    (y - found.outputs[count + k]).norm() < 3e-4 * size,
                    "{held} {w}: {:e}",
                    (y - found.outputs[count + k]).norm() / size
                );
            }
        }
    }
}

/// A slow signal with noise, and the same with gaps of so many samples.
fn with_gaps(n: usize, gaps: &[(usize, usize)]) -> [Run; 2] {
    let x: Vec<f64> = noise(5, n)
        .iter()
        .enumerate()
        .map(|(k, v)| (0.021 * k as f64).sin() + 0.4 * (0.0613 * k as f64 + 1.0).cos() + 0.02 * v)
        .collect();
    let whole = run(0.05, &[], false, &[x]);
    let mut gappy = whole.clone();
    gaps.iter().for_each(|(first, count)| gappy.measured[*first..first + count].fill(f64::NAN));
    [whole, gappy]
}

#[test]
fn a_bridge_makes_the_error_that_is_stated() {
    for gaps in [&[(300, 20)][..], &[(200, 20), (700, 12), (900, 12)], &[(0, 9), (500, 30)]] {
        let [whole, gappy] =
            with_gaps(1200, gaps).map(|r| Spectrum::of(&r, &ALL, &SpectrumOptions::default()).expect("a spectrum"));
        let [bridge] = &gappy.bridged[..] else { panic!("{:?}", gappy.bridged) };
        assert!(whole.bridged.is_empty());
        assert_eq!(bridge.missing, gaps.iter().map(|g| g.1).sum::<usize>());
        let pairs = || whole.outputs.iter().zip(&gappy.outputs).filter(|(_, g)| !g.is_nan());
        assert_eq!(pairs().count() + bridge.left_out, whole.omega.len());
        let off: f64 = pairs().map(|(w, g)| (w - g).norm_sqr()).sum();
        let size: f64 = pairs().map(|(_, g)| g.norm_sqr()).sum();
        let (made, stated) = ((off / size).sqrt(), bridge.error.expect("some are kept"));
        assert!(
            made < 3.0 * stated && stated < 5.0 * made && stated < 0.02,
            "{gaps:?}: {made} {stated} {}",
            bridge.left_out
        );
        assert!(bridge.left_out < whole.omega.len() / 2, "{bridge:?}");
    }
    let [_, lost] = with_gaps(1200, &[(400, 300)]);
    let message = Spectrum::of(&lost, &ALL, &SpectrumOptions::default()).expect_err("nothing is left").to_string();
    assert!(message.contains("300"), "{message}");
}

#[test]
fn offsets_and_gaps_change_nothing_that_matters() {
    let (n, dt) = (400, 0.05);
    let x: Vec<f64> = (0..n).map(|k| k as f64 * dt).map(|t| (1.1 * t).sin() + 0.1 * t).collect();
    let plain =
        Spectrum::of(&run(dt, &[], false, std::slice::from_ref(&x)), &BAND, &SpectrumOptions::default()).expect("even");
    let far = x.iter().map(|v| v + 1e6).collect();
    let shifted = Spectrum::of(&run(dt, &[], false, &[far]), &BAND, &SpectrumOptions::default()).expect("even");
    let mut gappy = run(dt, &[], false, &[x]);
    gappy.measured[37] = f64::NAN;
    gappy.time.remove(200);
    gappy.measured.remove(200);
    let bridged = Spectrum::of(&gappy, &BAND, &SpectrumOptions::default()).expect("two single gaps");
    assert_eq!(bridged.samples, plain.samples);
    for ((a, b), c) in plain.outputs.iter().zip(&shifted.outputs).zip(&bridged.outputs) {
        assert!((a - b).norm() < 1e-9 && (a - c).norm() < 1e-4, "{a} {b} {c}");
    }
    assert!((plain.end_factors(3)[0] + plain.end_factors(3)[1]).norm() > 0.0);
}

#[test]
fn what_cannot_be_transformed_is_told() {
    let told = |run: &Run, choice: &Frequencies| {
        let named = SpectrumOptions { outputs: vec!["q".into()], ..SpectrumOptions::default() };
        Spectrum::of(run, choice, &named).unwrap_err().to_string()
    };
    let good = run(0.1, &[], false, &[noise(1, 100)]);
    assert!(told(&good.part(0..5), &ALL).starts_with("5 samples are too few: a spectrum needs at least 8"));
    assert!(told(&good.part(0..0), &ALL).contains("0 samples are too few"));
    let beyond = Frequencies::Band { lowest: 1.0, highest: 6.0, spacing: None };
    assert!(told(&good, &beyond).contains("reaches to 6 cycles per unit of time, but samples 0.1"));
    let slow = Frequencies::Band { lowest: 0.01, highest: 3.0, spacing: None };
    assert!(told(&good, &slow).contains("the record is 9.8 long, less than one period"), "{}", told(&good, &slow));
    let mut uneven = good.clone();
    uneven.time.iter_mut().for_each(|t| *t = t.powf(1.7));
    assert!(told(&uneven, &ALL).contains("not at equal intervals"));
    let mut gap = good.clone();
    gap.measured[30..50].fill(f64::NAN);
    let message = told(&gap, &Frequencies::Grid { lowest: None, highest: Some(2.0) });
    assert!(
        message.starts_with("output `q`: 20 samples in a row are missing at time 3, and a line across at most 1"),
        "{message}"
    );
    let mut empty = good.clone();
    empty.measured.fill(f64::NAN);
    assert!(told(&empty, &ALL).starts_with("output `q` has no values in this run"));
    let allowed = SpectrumOptions { allow_unmeasured: true, ..SpectrumOptions::default() };
    let found = Spectrum::of(&empty, &ALL, &allowed).expect("allowed");
    assert!(found.outputs.iter().all(|c| c.re.is_nan()));
}

#[test]
fn a_tone_has_the_phase_of_the_first_transformed_sample() {
    let (n, dt) = (102, 0.1);
    let w = TAU * 0.5;
    let x: Vec<f64> = (0..n).map(|k| (w * (k as f64 - 1.0) * dt).cos()).collect();
    let found = Spectrum::of(&run(dt, &[], false, &[x]), &ALL, &options(Interpolant::Samples)).expect("even");
    let at = found.omega.iter().position(|o| (o - w).abs() < 1e-12).expect("five cycles in ten");
    assert!((found.outputs[at] - 0.5).norm() < 1e-14);
}

#[test]
fn inputs_that_do_not_move_are_found_and_close_frequencies_counted() {
    let (n, dt) = (402, 0.05);
    let tone = |f: f64| (0..n).map(|k| (TAU * f * k as f64 * dt).sin()).collect::<Vec<f64>>();
    let still = vec![7.3; n];
    let made = |inputs: [Vec<f64>; 2]| {
        Spectrum::of(&run(dt, &inputs, false, &[]), &BAND, &SpectrumOptions::default()).expect("even")
    };
    let (one, other) = (made([tone(1.3), still.clone()]), made([still.clone(), tone(2.0)]));
    assert_eq!((one.inputs_without_power(), other.inputs_without_power()), (vec![1], vec![0]));
    // 20 long: 3.6 cycles per unit of time hold 72 independent frequencies, and the first
    assert!((one.independent() - 72.9).abs() < 0.3, "{}", one.independent());
    let grid = Spectrum::of(&run(dt, &[tone(1.0)], false, &[]), &ALL, &SpectrumOptions::default()).expect("even");
    assert!((grid.independent() / grid.omega.len() as f64 - 1.0).abs() < 1e-9);
}

const DT: f64 = 0.05;

/// Two outputs of two first-order systems each, `y_o = sum_i g_oi/(z - a_oi) u_i`, plus noise; the second input follows the first in part.
fn two_by_two(samples: usize, noise: f64, seed: u64) -> Run {
    let mut normal = Normal(seed);
    let mut state = [[0.0; 2]; 2];
    let (mut inputs, mut measured) = (Vec::new(), Vec::new());
    let mut slow = 0.0;
    for _ in 0..samples {
        let first = normal.next();
        slow = 0.7 * slow + first;
        let u = [first, 0.6 * slow + normal.next()];
        inputs.extend(u);
        for o in 0..2 {
            measured.push(state[o].iter().sum::<f64>() + noise * normal.next());
            for i in 0..2 {
                state[o][i] = POLES[o][i] * state[o][i] + GAINS[o][i] * u[i];
            }
        }
    }
    Run {
        name: format!("{seed}"),
        time: (0..samples).map(|k| k as f64 * DT).collect(),
        inputs,
        held: vec![true; 2],
        measured,
        input_gaps: vec![0; 2],
        stated: Vec::new(),
        output_gaps: vec![0; 2],
    }
}

const POLES: [[f64; 2]; 2] = [[0.8, 0.5], [0.3, 0.9]];
const GAINS: [[f64; 2]; 2] = [[0.4, -1.0], [2.0, 0.3]];

fn truth(output: usize, input: usize, omega: f64) -> Complex64 {
    GAINS[output][input] / (Complex64::cis(omega * DT) - POLES[output][input])
}

fn plain() -> SpectrumOptions {
    SpectrumOptions { interpolant: Interpolant::Samples, ..SpectrumOptions::default() }
}

const LOW_BAND: Frequencies = Frequencies::Band { lowest: 0.4, highest: 6.0, spacing: Some(0.7) };
const HALF: Segmentation = Segmentation::Equal { length: 25.6, overlap: 0.5 };

fn estimate(run: Run) -> FrequencyResponseEstimate {
    let spectra = CrossSpectra::of(&[run], &LOW_BAND, &HALF, Window::Hann, &plain()).expect("even");
    FrequencyResponseEstimate::of(&spectra, &plain()).expect("two inputs that move")
}

#[test]
fn correlated_inputs_are_told_apart_within_the_printed_errors() {
    let (mut squares, mut count, mut beyond) = (0.0, 0, 0);
    for seed in 0..24 {
        let found = estimate(two_by_two(4096, 1.0, 100 + seed));
        for (output, input) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            for (at, omega) in found.pair(output, input).zip(&found.omega) {
                let want = truth(output, input, *omega);
                // both parts of the difference, in standard deviations
                let apart = (found.response[at] / want - 1.0) / (found.error[at] * (found.response[at] / want).norm());
                for part in [apart.re, apart.im] {
                    squares += part * part;
                    count += 1;
                    beyond += usize::from(part.abs() > 2.0);
                }
            }
        }
    }
    let (scatter, share) = ((squares / f64::from(count)).sqrt(), beyond as f64 / f64::from(count));
    assert!((0.9..1.12).contains(&scatter), "scatter is {scatter} of what is printed");
    assert!((0.03..0.08).contains(&share), "{share} beyond two standard deviations");
}

#[test]
fn one_input_at_a_time_would_be_wrong() {
    let run = two_by_two(40_000, 0.1, 7);
    let spectra = CrossSpectra::of(std::slice::from_ref(&run), &LOW_BAND, &HALF, Window::Hann, &plain()).expect("even");
    let found = FrequencyResponseEstimate::of(&spectra, &plain()).expect("two inputs that move");
    let want = truth(0, 0, found.omega[0]);
    let alone = spectra.density(0, 2, 0) / spectra.density(0, 0, 0);
    assert!((alone / want - 1.0).norm() > 0.5, "{alone} {want}");
    assert!((found.response[0] / want - 1.0).norm() < 0.03, "{} {want}", found.response[0]);
    assert!(found.coherence[0] > 0.99 && found.partial_coherence[0] > 0.9);
}

#[test]
fn coherence_is_the_part_of_the_output_that_is_no_noise() {
    // white input, first order: power of the response over power with noise
    let mut run = two_by_two(30_000, 0.0, 3);
    let mut normal = Normal(5);
    run.measured.iter_mut().step_by(2).for_each(|y| *y += 2.0 * normal.next());
    let spectra = CrossSpectra::of(&[run], &LOW_BAND, &HALF, Window::Hann, &plain()).expect("even");
    let found = FrequencyResponseEstimate::of(&spectra, &plain()).expect("moves");
    for (k, omega) in found.omega.iter().enumerate() {
        let u = |i: usize, j: usize| spectra.density(i, j, k);
        let h = [truth(0, 0, *omega), truth(0, 1, *omega)];
        let clean = (0..2).map(|i| (0..2).map(|j| (h[i].conj() * u(i, j) * h[j]).re).sum::<f64>()).sum::<f64>();
        let want = clean / (clean + 4.0 * 2.0 * DT);
        // Bendat and Piersol: the deviation of an estimated coherence, and what two inputs explain of any noise
        let deviation = (2.0 * want).sqrt() * (1.0 - want) / spectra.averages.sqrt();
        let apart = found.coherence[k] - want - (1.0 - want) * 2.0 / spectra.averages;
        assert!(apart.abs() < 3.0 * deviation, "{k}: {} {want} {deviation}", found.coherence[k]);
        assert!(found.coherence[found.omega.len() + k] > 0.995);
    }
}

#[test]
fn white_noise_has_the_density_of_its_variance() {
    let run = two_by_two(20_000, 1.0, 11);
    for window in [Window::Rectangular, Window::Hann, Window::Hamming] {
        let unequal = Segmentation::Between(
            (0..70).map(|k| (f64::from(k) * 14.0, f64::from(k) * 14.0 + 7.0 + f64::from(k % 7))).collect(),
        );
        for segmentation in [HALF, unequal] {
            let spectra =
                CrossSpectra::of(std::slice::from_ref(&run), &LOW_BAND, &segmentation, window, &plain()).expect("even");
            let mean = spectra.power(0).iter().sum::<f64>() / spectra.omega.len() as f64;
            assert!((mean / (2.0 * DT) - 1.0).abs() < 0.1, "{window:?}: {mean}");
        }
    }
}

#[test]
fn a_sweep_shows_a_mode() {
    // x'' + 1.2 x' + 9 x = u, u held, from 0.1 to 1.6 cycles: exact recursion
    let (n, dt) = (6000, 0.05);
    let (sigma, rho): (f64, f64) = (0.6, (9.0f64 - 0.36).sqrt());
    let (decay, c, s) = ((-sigma * dt).exp(), (rho * dt).cos(), (rho * dt).sin());
    let (mut x, mut v) = (0.0, 0.0);
    let (mut inputs, mut measured, mut phase) = (Vec::new(), Vec::new(), 0.0f64);
    for k in 0..n {
        let u = phase.sin();
        phase += TAU * dt * (0.05 + 1.8 * (k as f64 / n as f64));
        inputs.push(u);
        measured.push(x);
        let z = x - u / 9.0;
        x = u / 9.0 + decay * (z * (c + sigma / rho * s) + v / rho * s);
        v = decay * (v * (c - sigma / rho * s) - z * 9.0 / rho * s);
    }
    let time = (0..n).map(|k| k as f64 * dt).collect();
    let run = Run {
        name: "sweep".into(),
        time,
        inputs,
        held: vec![true],
        measured,
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0],
    };
    let band = Frequencies::Band { lowest: 0.1, highest: 1.5, spacing: Some(0.02) };
    let options = SpectrumOptions::default();
    let found = FrequencyResponseEstimate::composite(&[run], &band, &[100.0, 60.0, 30.0], 0.5, Window::Hann, &options)
        .expect("a sweep");
    for (h, w) in found.response.iter().zip(&found.omega) {
        let want = 1.0 / Complex64::new(9.0 - w * w, 1.2 * w);
        assert!((h / want - 1.0).norm() < 0.1, "{}: {h} {want}", w / TAU);
    }
    let flat = found.omega.iter().position(|w| *w > TAU * 1.0).expect("in the band");
    assert!(found.coherence[flat] > 0.99 && found.averages[flat] > found.averages[0]);
}

#[test]
fn what_cannot_be_told_is_said() {
    let named = SpectrumOptions { inputs: vec!["lon".into(), "lat".into()], ..plain() };
    let told = |run: &Run, segmentation: &Segmentation| {
        let spectra = CrossSpectra::of(std::slice::from_ref(run), &LOW_BAND, segmentation, Window::Hann, &named);
        spectra.and_then(|s| FrequencyResponseEstimate::of(&s, &named)).unwrap_err().to_string()
    };
    let good = two_by_two(2000, 1.0, 1);
    let mut quiet = good.clone();
    quiet.inputs.iter_mut().skip(1).step_by(2).for_each(|v| *v = 3.0);
    assert!(told(&quiet, &HALF).starts_with("input `lat` has no power between 0.4 and 6"), "{}", told(&quiet, &HALF));
    let mut together = good.clone();
    together.inputs.chunks_exact_mut(2).for_each(|u| u[1] = -2.0 * u[0]);
    assert!(told(&together, &HALF).starts_with("input `lat` is a combination of the other inputs"));
    let whole = Segmentation::Equal { length: 100.0, overlap: 0.5 };
    assert!(
        told(&good, &whole).starts_with("1 segments are worth 1.0 independent averages"),
        "{}",
        told(&good, &whole)
    );
    let longer = Segmentation::Equal { length: 101.0, overlap: 0.5 };
    assert!(told(&good, &longer).starts_with("no run holds a segment 101 long"));
    let short = Segmentation::Equal { length: 2.0, overlap: 0.5 };
    assert!(told(&good, &short).contains("segments 2 long hold less than one period of the band's lower end 0.4"));
}
