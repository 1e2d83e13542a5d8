//! Frequency responses of known systems from simulated records.

use super::*;
use crate::quality::specimen::Normal;
use crate::record::Run;
use num_complex::Complex64;
use std::f64::consts::TAU;

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

const BAND: Frequencies = Frequencies::Band { lowest: 0.4, highest: 6.0, spacing: Some(0.7) };
const HALF: Segmentation = Segmentation::Equal { length: 25.6, overlap: 0.5 };

fn estimate(run: Run) -> FrequencyResponseEstimate {
    let spectra = CrossSpectra::of(&[run], &BAND, &HALF, Window::Hann, &plain()).expect("even");
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
    let spectra = CrossSpectra::of(std::slice::from_ref(&run), &BAND, &HALF, Window::Hann, &plain()).expect("even");
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
    let spectra = CrossSpectra::of(&[run], &BAND, &HALF, Window::Hann, &plain()).expect("even");
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
                CrossSpectra::of(std::slice::from_ref(&run), &BAND, &segmentation, window, &plain()).expect("even");
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
        let spectra = CrossSpectra::of(std::slice::from_ref(run), &BAND, segmentation, Window::Hann, &named);
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
    assert!(told(&good, &short).contains("the record is 2 long, less than one period of the band's lower end 0.4"));
}
