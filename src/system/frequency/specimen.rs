//! Linear models by chance for the tests, their solution by nalgebra, and derivatives by differences.

use super::{EndColumn, EndPoint, EndTerms, FrequencyError, FrequencyResponse, Plans};
use crate::linear::{Slope, Structure, TauSlope, Term, Values};
use crate::spectrum::Spectrum;
use fdm_grammar::graph::Signal;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use std::sync::Arc;

/// SplitMix64.
pub(super) struct Chance(pub(super) u64);

impl Chance {
    /// From 0 to 1.
    pub(super) fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// From -1 to 1.
    pub(super) fn number(&mut self) -> f64 {
        2.0 * self.share() - 1.0
    }

    pub(super) fn complex(&mut self) -> Complex64 {
        Complex64::new(self.number(), self.number())
    }
}

/// A model whose coefficients and delays are affine in its parameters.
pub(super) struct Specimen {
    pub(super) structure: Arc<Structure>,
    pub(super) values: Values,
    pub(super) spectrum: Spectrum,
    pub(super) ends: EndTerms,
}

/// Sizes of a model: states, inputs, outputs, delayed signals, parameters.
pub(super) type Sizes = [usize; 5];

impl Specimen {
    /// Each coefficient is there with probability `density`.
    pub(super) fn new([n, m, q, delays, p]: Sizes, density: f64, frequencies: usize, seed: u64) -> Self {
        let mut chance = Chance(seed);
        let delayed: Vec<Signal> = (0..delays)
            .map(|d| {
                if d % 2 == 0 && m > 0 || n == 0 {
                    Signal::Input((d % m) as u32)
                } else {
                    Signal::State((d % n) as u32)
                }
            })
            .collect();
        let mut structure = Structure { states: n, inputs: m, outputs: q, params: p, delayed, ..Structure::default() };
        let mut values = Values::default();
        for row in 0..n + q {
            for signal in 0..n + m + delays {
                if chance.share() < density || row == signal && row < n {
                    structure.terms.push(Term { row: row as u32, signal: signal as u32 });
                    let value = if chance.share() < 0.2 { chance.number().signum() } else { 2.0 * chance.number() };
                    values.terms.push(value);
                }
            }
        }
        for term in 0..structure.terms.len() as u32 {
            for param in 0..p as u32 {
                if chance.share() < 1.5 / p as f64 {
                    structure.slopes.push(Slope { term, param });
                    values.slopes.push(if chance.share() < 0.3 { 1.0 } else { chance.number() });
                }
            }
        }
        for delayed in 0..delays as u32 {
            values.tau.push(0.5 * chance.share());
            if p > 0 {
                structure.tau_slopes.push(TauSlope { delayed, param: delayed % p as u32 });
                values.tau_slopes.push(chance.number());
            }
        }
        let (dt, samples) = (0.05, 400);
        let omega = (1..=frequencies).map(|k| std::f64::consts::TAU * k as f64 / (dt * samples as f64)).collect();
        let spectrum = Spectrum {
            name: "chance".into(),
            omega,
            dt,
            samples,
            inputs: (0..m * frequencies).map(|_| chance.complex()).collect(),
            outputs: vec![Complex64::default(); q * frequencies],
            input_ends: [0, 1].map(|_| (0..m).map(|_| chance.number()).collect()),
            output_ends: [0, 1].map(|_| (0..q).map(|_| chance.number()).collect()),
            ..Spectrum::default()
        };
        Self { structure: Arc::new(structure), values, spectrum, ends: EndTerms::Omitted }
    }

    /// The values a step along one parameter further on.
    pub(super) fn moved(&self, param: usize, step: f64) -> Values {
        let mut values = self.values.clone();
        for (slope, by) in self.structure.slopes.iter().zip(&self.values.slopes) {
            if slope.param as usize == param {
                values.terms[slope.term as usize] += step * by;
            }
        }
        for (slope, by) in self.structure.tau_slopes.iter().zip(&self.values.tau_slopes) {
            if slope.param as usize == param {
                values.tau[slope.delayed as usize] += step * by;
            }
        }
        values
    }

    pub(super) fn response(&self) -> FrequencyResponse {
        let plans = Arc::new(Plans::default());
        FrequencyResponse::new(&self.structure, &self.values, &self.spectrum, &self.ends, &plans).expect("suited")
    }

    /// What a delayed input has besides the turned input where it is known at its ends only: with its mean taken off.
    fn held_input(&self, input: usize, k: usize, tau: f64) -> Complex64 {
        let (w, t, half) = (self.spectrum.omega[k], self.spectrum.duration(), 0.5 * self.spectrum.dt);
        let [before, behind] = [half, half - t].map(|at| Complex64::from_polar(1.0, w * at));
        let jw = Complex64::new(0.0, w);
        let [first, last] = [0, 1].map(|end: usize| self.spectrum.input_ends[end][input]);
        let gap = (Complex64::from_polar(1.0, -w * tau) - 1.0) / jw;
        gap * (last * behind - first * before) / t - tau * (first - last) / t * (before - behind) / (jw * t)
    }

    /// The end term of a state at a frequency, for values of the unknown ends.
    pub(super) fn end_term(&self, columns: &[EndColumn], values: &[f64], state: usize, k: usize) -> Complex64 {
        let [before, behind] = self.spectrum.end_factors(k);
        let own = columns.iter().zip(values).filter(|(e, _)| e.state == state);
        let term = own.map(|(e, z)| match e.point {
            EndPoint::First => -z * before,
            EndPoint::Last | EndPoint::Difference => z * behind,
        });
        term.sum()
    }

    /// The end term of the rate of a state at a frequency, by its equation.
    fn rate_end(&self, values: &Values, end: &impl Fn(usize, usize) -> Complex64, state: usize, k: usize) -> Complex64 {
        let s = &self.structure;
        let [before, behind] = self.spectrum.end_factors(k);
        let of_signal = |signal: Signal| match signal {
            Signal::State(j) => end(j as usize, k),
            Signal::Input(j) => {
                let [first, last] = [0, 1].map(|end: usize| self.spectrum.input_ends[end][j as usize]);
                last * behind - first * before
            }
        };
        let signal = |signal: usize| match signal.checked_sub(s.states + s.inputs) {
            None if signal < s.states => Signal::State(signal as u32),
            None => Signal::Input((signal - s.states) as u32),
            Some(d) => s.delayed[d],
        };
        let own = s.terms.iter().zip(&values.terms).filter(|(t, _)| t.row as usize == state);
        own.map(|(t, a)| a * of_signal(signal(t.signal as usize))).sum()
    }

    /// Outputs (M by q) with what the end terms are (n by M), by nalgebra.
    pub(super) fn expected(&self, values: &Values, end: impl Fn(usize, usize) -> Complex64) -> Vec<Complex64> {
        let s = &self.structure;
        let (n, m, q, count) = (s.states, s.inputs, s.outputs, self.spectrum.omega.len());
        let mut y = Vec::new();
        for (k, w) in self.spectrum.omega.iter().enumerate() {
            let mut matrix = DMatrix::from_diagonal_element(n, n, Complex64::new(0.0, *w));
            let mut right = DVector::from_fn(n, |i, _| -end(i, k));
            let mut shown = DMatrix::from_element(q, n, Complex64::default());
            let mut direct = vec![Complex64::default(); q];
            for (term, a) in s.terms.iter().zip(&values.terms) {
                let (row, signal) = (term.row as usize, term.signal as usize);
                let ended = !matches!(self.ends, EndTerms::Omitted | EndTerms::Given(_));
                let gap = |tau: f64| (Complex64::from_polar(1.0, -w * tau) - 1.0) / Complex64::new(0.0, *w);
                // what stays what it was outside of the record
                let held = match signal.checked_sub(n + m).map(|d| (values.tau[d], s.delayed[d])) {
                    Some((tau, Signal::State(j))) if ended => {
                        let bow = (gap(tau) + tau) / Complex64::new(0.0, *w);
                        a * (gap(tau) * end(j as usize, k) + bow * self.rate_end(values, &end, j as usize, k))
                    }
                    Some((tau, Signal::Input(j))) if ended => a * self.held_input(j as usize, k, tau),
                    _ => Complex64::default(),
                };
                match row < n {
                    true => right[row] += held,
                    false => direct[row - n] += held,
                }
                let (state, factor) = match signal.checked_sub(n + m) {
                    None if signal < n => (Some(signal), Complex64::new(1.0, 0.0)),
                    None => (None, self.spectrum.inputs[(signal - n) * count + k]),
                    Some(d) => {
                        let delay = Complex64::from_polar(1.0, -w * values.tau[d]);
                        match s.delayed[d] {
                            Signal::State(j) => (Some(j as usize), delay),
                            Signal::Input(j) => (None, delay * self.spectrum.inputs[j as usize * count + k]),
                        }
                    }
                };
                match (row < n, state) {
                    (true, Some(j)) => matrix[(row, j)] -= a * factor,
                    (true, None) => right[row] += a * factor,
                    (false, Some(j)) => shown[(row - n, j)] += a * factor,
                    (false, None) => direct[row - n] += a * factor,
                }
            }
            let x = if n == 0 { right } else { matrix.lu().solve(&right).expect("not singular") };
            y.extend((shown * x).iter().zip(&direct).map(|(a, b)| a + b));
        }
        y
    }
}

/// Outputs (M by q) and derivatives (M by q by columns).
pub(super) fn evaluated(
    response: &mut FrequencyResponse,
    values: &Values,
    ends: &[f64],
    columns: &[usize],
) -> Result<(Vec<Complex64>, Vec<Complex64>), FrequencyError> {
    let (count, q, p) = (response.frequencies(), response.outputs(), columns.len());
    let stride = p.next_multiple_of(8).max(8);
    let (mut y, mut jacobian) = (vec![0.0; 2 * count * q], vec![f64::NAN; 2 * count * q * stride]);
    response.sensitivities(values, ends, columns, &mut |block| block.copy_to(&mut y, &mut jacobian, stride))?;
    let complex = |numbers: &[f64], width: usize, used: usize| -> Vec<Complex64> {
        let frequency = |rows: &[f64]| -> Vec<Complex64> {
            let (re, im) = rows.split_at(width);
            (0..width).filter(|k| k % stride.min(width) < used).map(|k| Complex64::new(re[k], im[k])).collect()
        };
        numbers.chunks(2 * width).flat_map(frequency).collect()
    };
    let mut alone = vec![0.0; 2 * count * q];
    response.simulate(values, ends, &mut alone)?;
    assert!(alone.iter().zip(&y).all(|(a, b)| a.to_bits() == b.to_bits()), "the same bits without sensitivities");
    if q == 0 {
        return Ok((Vec::new(), Vec::new()));
    }
    Ok((complex(&y, q, q), if q * p == 0 { Vec::new() } else { complex(&jacobian, q * stride, p) }))
}

/// The largest difference, relative to the largest of its kind (numbers `count` apart are of one kind).
pub(super) fn apart(found: &[Complex64], wanted: &[Complex64], count: usize) -> f64 {
    assert_eq!(found.len(), wanted.len());
    let mut worst = 0.0f64;
    for kind in 0..count {
        let pairs = || found.iter().zip(wanted).skip(kind).step_by(count);
        let size = pairs().map(|(_, w)| w.norm()).fold(0.0, f64::max);
        let difference =
            pairs().map(|(f, w)| (f - w).norm()).fold(0.0, |a: f64, b| if b.is_nan() { b } else { a.max(b) });
        worst = if difference.is_nan() { f64::INFINITY } else { worst.max(difference / size.max(1e-3)) };
    }
    worst
}
