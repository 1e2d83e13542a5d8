//! Functions and weighing by themselves.
#![allow(clippy::unwrap_used)]

use super::likelihood::{BandProducts, Banded, Singles, settle};
use super::regressors::{Variable, functions};
use crate::noise::SmoothSpectrum;
use fdm_numeric::random::Stream;
use nalgebra::DMatrix;

fn variable(rate: f64, phase: f64, state: bool) -> Variable {
    let run = |r: usize| (0..60).map(|k| (rate * k as f64 + phase + r as f64).sin()).collect::<Vec<f64>>();
    let runs = vec![run(0), run(2)];
    Variable { name: "x".into(), values: runs.clone(), centred: runs.clone(), signed: runs, state }
}

#[test]
fn principal_courses_are_not_correlated_and_hold_the_simple_functions() {
    let (x, u) = (variable(0.2, 0.3, true), variable(0.37, 1.0, false));
    let product: Vec<f64> = x.centred.concat().iter().zip(u.centred.concat()).map(|(a, b)| a * b).collect();
    let found = functions(&[x, u], 24).unwrap().courses;
    assert!(found.len() == 2 && found[0].len() == 24 && found[0][0].len() == 60);
    let columns: Vec<Vec<f64>> = (0..24).map(|k| found.iter().flat_map(|run| run[k].clone()).collect()).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut left = product.clone();
    for (k, column) in columns.iter().enumerate() {
        for other in &columns[..k] {
            assert!(dot(column, other).abs() < 1e-6 * dot(column, column).sqrt() * dot(other, other).sqrt());
        }
        let part = dot(column, &product) / dot(column, column);
        left.iter_mut().zip(column).for_each(|(l, c)| *l -= part * c);
    }
    assert!(dot(&left, &left) < 1e-3 * dot(&product, &product), "{}", dot(&left, &left) / dot(&product, &product));
}

fn singles(combinations: &DMatrix<f64>) -> Singles<'_> {
    Singles { combinations, alike: 1 }
}

/// Cells of one output with one fitted column and so many responses, the first of them with this amount in the residual.
fn made(amount: f64, responses: usize, seed: u64) -> Vec<BandProducts> {
    let mut normal = Stream::seeded(seed);
    let cell = |k: usize| {
        let (bins, width) = (12, responses + 2);
        let mut columns = DMatrix::from_fn(bins, width, |_, _| normal.normal_of_pair());
        let signal = columns.column(1) * amount;
        columns.column_mut(width - 1).zip_apply(&signal, |r, s| *r = 3.0 * *r + s);
        let products = columns.tr_mul(&columns);
        BandProducts { channel: 0, log_frequency: 0.25 * k as f64, bins: bins as f64, products }
    };
    (0..14).map(cell).collect()
}

#[test]
fn a_law_is_weighed_against_noise_that_is_found_with_it() {
    let gain = |amount: f64, seed: u64| {
        let cells = made(amount, 10, seed);
        let start = [SmoothSpectrum::white(4.0)];
        // without responses: the same bands with only the fitted column and the residual
        let bare = |c: &BandProducts| {
            let keep = [0, 11];
            let products = DMatrix::from_fn(2, 2, |i, j| c.products[(keep[i], keep[j])]);
            BandProducts { products, channel: 0, log_frequency: c.log_frequency, bins: c.bins }
        };
        let highest = (0.25_f64 * 13.0).exp();
        let alone = Banded { cells: cells.iter().map(bare).collect(), highest, narrow: false };
        settle(&Banded { cells, highest, narrow: false }, 1, singles(&DMatrix::identity(10, 10)), &start).score
            - settle(&alone, 1, singles(&DMatrix::zeros(0, 0)), &start).score
    };
    // of 168 bins: a gain of 168/2 log(1 + 2^2/3^2) = 31, less (1 + log 62)/2 + log 10 + log 3 for the best of ten functions
    let found = (0..10).map(|seed| gain(2.0, seed)).sum::<f64>() / 10.0;
    assert!((found - 25.0).abs() < 6.0, "{found}");
    let nothing: Vec<f64> = (0..20).map(|seed| gain(0.0, 100 + seed)).collect();
    assert!(nothing.iter().all(|g| *g < 4.0), "{nothing:?}");
}
