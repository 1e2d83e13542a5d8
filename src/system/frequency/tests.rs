//! Responses and sensitivities against dense solutions by nalgebra and differences of them.

use super::specimen::{Specimen, apart, evaluated};
use super::{EndTerms, FrequencyError, FrequencyResponse, Plans};
use crate::linear::{Structure, Term, Values};
use num_complex::Complex64;
use std::sync::Arc;

pub(super) const NONE: fn(usize, usize) -> Complex64 = |_, _| Complex64::new(0.0, 0.0);

/// Differences of the fourth order of what nalgebra finds.
pub(super) fn differences(
    specimen: &Specimen,
    param: usize,
    end: impl Fn(usize, usize) -> Complex64,
) -> Vec<Complex64> {
    let h = 1e-3;
    let at = |steps: f64| specimen.expected(&specimen.moved(param, steps * h), &end);
    let (a, b, c, d) = (at(-2.0), at(-1.0), at(1.0), at(2.0));
    (0..a.len()).map(|k| (a[k] - 8.0 * b[k] + 8.0 * c[k] - d[k]) / (12.0 * h)).collect()
}

fn check(specimen: &Specimen, what: &str) {
    let p = specimen.structure.params;
    let columns: Vec<usize> = (0..p).collect();
    let (y, jacobian) = evaluated(&mut specimen.response(), &specimen.values, &[], &columns).expect("finite");
    let wanted = specimen.expected(&specimen.values, NONE);
    let q = specimen.structure.outputs;
    let off = apart(&y, &wanted, q);
    assert!(off < 1e-11, "{what}: outputs off by {off}");
    for param in 0..p {
        let found: Vec<Complex64> = jacobian.iter().skip(param).step_by(p).copied().collect();
        let off = apart(&found, &differences(specimen, param, NONE), q);
        assert!(off < 2e-6, "{what}: derivatives by parameter {param} off by {off}");
    }
}

#[test]
fn sparse_and_full_models_agree_with_dense_solutions() {
    let mut seed = 0;
    for sizes in [[1, 1, 1, 0, 2], [2, 1, 2, 2, 3], [4, 2, 3, 2, 5], [7, 2, 3, 3, 9], [9, 3, 2, 0, 12], [5, 0, 2, 2, 3]]
    {
        for density in [0.15, 0.4, 1.0] {
            for frequencies in [1, 13, 64, 70] {
                seed += 1;
                check(&Specimen::new(sizes, density, frequencies, seed), &format!("{sizes:?} {density} {frequencies}"));
            }
        }
    }
}

#[test]
fn models_without_states_outputs_or_parameters() {
    check(&Specimen::new([0, 2, 2, 1, 3], 1.0, 9, 1), "no states");
    check(&Specimen::new([3, 1, 2, 1, 0], 0.7, 9, 2), "no parameters");
    check(&Specimen::new([3, 1, 0, 1, 2], 0.7, 9, 3), "no outputs");
    check(&Specimen::new([0, 0, 1, 0, 1], 1.0, 9, 3), "nothing");
    check(&Specimen::new([3, 1, 2, 1, 2], 0.7, 0, 3), "no frequencies");
}

#[test]
fn the_frequencies_need_not_be_even() {
    let mut specimen = Specimen::new([4, 1, 2, 3, 5], 0.5, 90, 8);
    specimen.spectrum.omega.iter_mut().for_each(|w| *w = w.powf(0.9));
    check(&specimen, "uneven");
    // delays of many turns
    specimen.values.tau.iter_mut().for_each(|tau| *tau *= 100.0);
    let columns: Vec<usize> = (0..5).collect();
    let (y, _) = evaluated(&mut specimen.response(), &specimen.values, &[], &columns).expect("finite");
    assert!(apart(&y, &specimen.expected(&specimen.values, NONE), 2) < 1e-11);
}

#[test]
fn some_columns_are_some_columns_of_all() {
    let specimen = Specimen::new([6, 2, 3, 2, 8], 0.4, 20, 5);
    let mut response = specimen.response();
    let (_, all) = evaluated(&mut response, &specimen.values, &[], &(0..8).collect::<Vec<_>>()).expect("finite");
    let (_, some) = evaluated(&mut response, &specimen.values, &[], &[1, 5, 6]).expect("finite");
    let picked = all.chunks(8).flat_map(|row| [row[1], row[5], row[6]]);
    assert!(apart(&some, &picked.collect::<Vec<_>>(), 3) < 1e-13);
}

/// x1'' = -w0^2 x1 is damped only through x3: the leading pivots vanish at w0 though the model has no pole there.
#[test]
fn a_pivot_that_vanishes_is_no_pole() {
    let mut specimen = Specimen::new([3, 1, 2, 0, 3], 1.0, 8, 4);
    let w = specimen.spectrum.omega[4];
    let n = 3;
    for (term, a) in specimen.structure.terms.iter().zip(&mut specimen.values.terms) {
        let matrix = [[0.0, 1.0, 0.5], [-w * w, 0.0, -0.5], [0.3, 0.7, -1.0]];
        if (term.row as usize) < n && (term.signal as usize) < n {
            *a = matrix[term.row as usize][term.signal as usize];
        }
    }
    check(&specimen, "a pivot of zero");
}

#[test]
fn an_undamped_mode_on_a_frequency_is_an_error_that_names_it() {
    let terms = [(0, 1), (1, 0), (1, 2), (2, 0)].map(|(row, signal)| Term { row, signal });
    let structure = Structure { states: 2, inputs: 1, outputs: 1, terms: terms.to_vec(), ..Structure::default() };
    let mut specimen = Specimen::new([2, 1, 1, 0, 0], 1.0, 8, 4);
    let w = specimen.spectrum.omega[5];
    specimen.structure = Arc::new(structure);
    specimen.values = Values { terms: vec![1.0, -w * w, 1.0, 1.0], ..Values::default() };
    let failure = evaluated(&mut specimen.response(), &specimen.values, &[], &[]).expect_err("singular");
    assert!(matches!(failure, FrequencyError::Singular { frequency: 5, .. }), "{failure}");
    specimen.values.terms[1] *= 1.01;
    check(&specimen, "beside the pole");
}

/// y0 = 2 x0 + 3 u shows x0; y1 shows x1 with a coefficient that a parameter moves; nothing shows x2.
#[test]
fn end_values_of_shown_states_come_from_the_record() {
    let terms = [(0, 0), (0, 1), (1, 1), (1, 2), (1, 3), (2, 0), (2, 2), (3, 0), (3, 3), (4, 1), (4, 2)];
    let mut specimen = Specimen::new([3, 1, 2, 0, 1], 1.0, 12, 9);
    specimen.structure = Arc::new(Structure {
        states: 3,
        inputs: 1,
        outputs: 2,
        params: 1,
        terms: terms.map(|(row, signal)| Term { row, signal }).to_vec(),
        slopes: vec![crate::linear::Slope { term: 9, param: 0 }],
        ..Structure::default()
    });
    let coefficients = vec![-1.0, 0.4, -0.7, 0.2, 1.0, 0.6, -0.9, 2.0, 3.0, 1.5, 0.1];
    specimen.values = Values { terms: coefficients, slopes: vec![1.0], ..Values::default() };
    specimen.ends = EndTerms::Known;
    let mut response = specimen.response();
    let unknown: Vec<usize> = response.end_columns().iter().map(|e| e.state).collect();
    assert_eq!(unknown, [1, 2]);
    assert_eq!(response.end_columns()[0].name("v"), "end(v)");
    let s = &specimen.spectrum;
    let x = [0, 1].map(|end: usize| (s.output_ends[end][0] - 3.0 * s.input_ends[end][0]) / 2.0);
    let known: Vec<Complex64> =
        s.omega.iter().map(|w| (x[1] - x[0]) / s.duration() * Complex64::from_polar(1.0, w * s.dt / 2.0)).collect();
    let end = |i: usize, k: usize| if i == 0 { known[k] } else { Complex64::default() };
    let (y, _) = evaluated(&mut response, &specimen.values, &[0.0, 0.0], &[0]).expect("finite");
    assert!(apart(&y, &specimen.expected(&specimen.values, end), 2) < 1e-11);
    // the same when all are given
    let given = (0..3).flat_map(|i| (0..12).map(move |k| (i, k))).map(|(i, k)| end(i, k)).collect();
    specimen.ends = EndTerms::Given(given);
    let (same, _) = evaluated(&mut specimen.response(), &specimen.values, &[], &[0]).expect("finite");
    assert!(apart(&same, &y, 2) < 1e-11);
}

#[test]
fn coefficients_that_stop_being_one_are_seen() {
    let specimen = Specimen::new([5, 2, 2, 1, 4], 0.6, 10, 33);
    let mut response = specimen.response();
    let columns: Vec<usize> = (0..4).collect();
    evaluated(&mut response, &specimen.values, &[], &columns).expect("finite");
    let moved = Values { terms: specimen.values.terms.iter().map(|a| 0.9 * a).collect(), ..specimen.values.clone() };
    let (y, _) = evaluated(&mut response, &moved, &[], &columns).expect("finite");
    assert!(apart(&y, &specimen.expected(&moved, NONE), 2) < 1e-11);
}

#[test]
fn what_is_not_finite_or_does_not_fit_is_named() {
    let specimen = Specimen::new([3, 1, 2, 1, 2], 0.7, 6, 2);
    let plans = Arc::new(Plans::default());
    let new =
        |spectrum| FrequencyResponse::new(&specimen.structure, &specimen.values, &spectrum, &EndTerms::Omitted, &plans);
    let mut spectrum = specimen.spectrum.clone();
    spectrum.omega[2] = spectrum.omega[1];
    assert!(matches!(new(spectrum).err(), Some(FrequencyError::Frequency { frequency: 2, .. })));
    let mut spectrum = specimen.spectrum.clone();
    spectrum.inputs[3].im = f64::NAN;
    assert!(matches!(new(spectrum).err(), Some(FrequencyError::Input { input: 0, .. })));
    let mut spectrum = specimen.spectrum.clone();
    spectrum.inputs.pop();
    assert!(matches!(new(spectrum).err(), Some(FrequencyError::Shape { found: 5, wanted: 6, .. })));
    let mut values = specimen.values.clone();
    values.terms[0] = f64::INFINITY;
    let failure = evaluated(&mut specimen.response(), &values, &[], &[0]).expect_err("not finite");
    assert_eq!(failure, FrequencyError::Coefficient { row: 0, signal: 0 });
}

/// Too full for a program: one reduction for all frequencies, elimination at each where states are delayed in equations.
#[test]
fn full_models_of_many_states_agree_with_dense_solutions() {
    for (delays, seed) in [(0, 51), (1, 52), (2, 53)] {
        let mut specimen = Specimen::new([46, 1, 2, delays, 3], 1.0, 5, seed);
        // units that are far apart, so that the matrix is badly scaled
        let unit = |k: usize| if k < 46 { 10f64.powi((k % 7) as i32 - 3) } else { 1.0 };
        let structure = specimen.structure.clone();
        for (term, a) in structure.terms.iter().zip(&mut specimen.values.terms) {
            *a *= 0.05 * unit(term.row as usize) / unit(term.signal as usize);
        }
        for (slope, a) in structure.slopes.iter().zip(&mut specimen.values.slopes) {
            let term = structure.terms[slope.term as usize];
            *a *= 0.05 * unit(term.row as usize) / unit(term.signal as usize);
        }
        check(&specimen, &format!("{delays} delays"));
    }
}

#[test]
fn a_full_model_with_a_pole_on_a_frequency_is_an_error() {
    let mut specimen = Specimen::new([45, 1, 1, 0, 0], 1.0, 6, 5);
    let w = specimen.spectrum.omega[2];
    for (term, a) in specimen.structure.terms.iter().zip(&mut specimen.values.terms) {
        let (row, signal) = (term.row as usize, term.signal as usize);
        if row < 45 && signal < 45 {
            // one undamped mode, the rest below it
            *a = match (row, signal) {
                (0, 1) => w,
                (1, 0) => -w,
                (0 | 1, _) => 0.0,
                _ if row == signal => -1.0 - 0.1 * row as f64,
                _ => 0.01 * *a,
            };
        }
    }
    let failure = evaluated(&mut specimen.response(), &specimen.values, &[], &[]).expect_err("singular");
    assert!(matches!(failure, FrequencyError::Singular { frequency: 2, .. }), "{failure}");
}
