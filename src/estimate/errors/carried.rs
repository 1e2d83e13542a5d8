//! What the noise of records adds to the errors where the records stand in the equations.
//!
//! Residuals are then more than the noise of the outputs: noise of one record comes through the model into others. How much of each there is follows from how
//! large all residuals are: `R(o,o) = sum of f(k) T(o,k)`, T what noise of output k, as large as its residuals, does to the residuals of o, and f at least 0
//! (found by the multiplicative corrections of Richardson and Lucy). The score has then the covariance `sum of f(k) <(s + c)(s + c)'>`, s what is seen and
//! c what is carried: of noise that is a part f of the residuals, and `sum of f(k) <c c' + c s' + s c'>` besides.

use super::coloured_spectra::SpectralRows;
use super::sandwich::Sandwich;
use crate::estimate::noise::Weights;
use crate::estimate::problem::{NoiseShift, Problem};
use rayon::prelude::*;

/// Corrections of the parts.
const CORRECTIONS: usize = 300;

/// What one draw of the noise of one output does, all runs together.
#[derive(Clone)]
struct Drawn {
    /// The score of each chosen unknown through what is seen, and through what is carried (n).
    scores: [Vec<f64>; 2],
    /// Squares of the residuals of each output (q).
    squares: Vec<f64>,
}

/// What noise in the equations does.
pub(super) struct Carried {
    /// For each output the part of its residuals' variance that is its own noise (q).
    pub(super) parts: Vec<f64>,
    /// What is added to the middle (n by n).
    pub(super) middle: Vec<f64>,
}

impl Carried {
    /// None where no record stands in the equations, or it cannot be told.
    pub(super) fn of(
        problem: &Problem<'_>,
        runs: &[SpectralRows],
        sandwich: &Sandwich<'_>,
        values: &[f64],
        noise: &Weights,
    ) -> Option<Self> {
        let carried = problem.carried_noise.as_ref()?;
        let (q, n) = (problem.outputs.len(), sandwich.conclusion.inverse.chosen.len());
        let inverse_noise = noise.inverse();
        let of_run = |(r, rows): (usize, &SpectralRows)| {
            let mut theta = sandwich.unknowns.theta[r].clone();
            sandwich.unknowns.assemble(r, values, &mut theta);
            let places = sandwich.places(r);
            let drawn = |shift: &NoiseShift| {
                let score = |change: &[f64]| {
                    let mut score = vec![0.0; n];
                    for (place, s) in places.iter().zip(rows.score(change, &inverse_noise)) {
                        place.iter().for_each(|place| score[*place] += s);
                    }
                    score
                };
                let mut squares = vec![0.0; q];
                for (k, (s, c)) in shift.seen.iter().zip(&shift.carried).enumerate() {
                    squares[k % q] += if s.is_nan() { 0.0 } else { (s + c).powi(2) };
                }
                Drawn { scores: [score(&shift.seen), score(&shift.carried)], squares }
            };
            let shifts = carried.shifts(r, &theta, &noise.covariance)?;
            Some(shifts.iter().map(|of_output| of_output.iter().map(drawn).collect()).collect())
        };
        let all: Vec<Vec<Vec<Drawn>>> = runs.par_iter().enumerate().map(of_run).collect::<Option<_>>()?;
        let draws: Vec<Vec<Drawn>> = (0..q).map(|k| together(all.iter().map(|r| &r[k]))).collect();
        if draws.iter().all(Vec::is_empty) {
            return None;
        }
        let cells = |o: usize| -> f64 {
            let compared = |r: &&crate::estimate::problem::ProblemRun<'_>| {
                r.measured.iter().skip(o).step_by(q).filter(|z| !z.is_nan()).count() as f64
            };
            problem.runs.iter().map(|r| compared(&r)).sum()
        };
        let size = |o: usize, k: usize| {
            let mean = draws[k].iter().map(|d| d.squares[o]).sum::<f64>() / draws[k].len() as f64 / cells(o);
            match draws[k].is_empty() {
                true => f64::from(u8::from(o == k)),
                false => mean / noise.covariance[o * q + o],
            }
        };
        let sizes: Vec<Vec<f64>> = (0..q).map(|o| (0..q).map(|k| size(o, k)).collect()).collect();
        let parts = parts(&sizes);
        let mut middle = vec![0.0; n * n];
        for (draws, part) in draws.iter().zip(&parts) {
            let share = part / draws.len().max(1) as f64;
            for Drawn { scores: [s, c], .. } in draws {
                for (k, sum) in middle.iter_mut().enumerate() {
                    let (i, j) = (k / n, k % n);
                    *sum += share * (c[i] * c[j] + c[i] * s[j] + s[i] * c[j]);
                }
            }
        }
        middle.iter().all(|v| v.is_finite()).then_some(Self { parts, middle })
    }
}

/// Draws of all runs as one: they are independent.
fn together<'d>(runs: impl Iterator<Item = &'d Vec<Drawn>>) -> Vec<Drawn> {
    let mut sum: Vec<Drawn> = Vec::new();
    for run in runs.filter(|run| !run.is_empty()) {
        if sum.is_empty() {
            sum.clone_from(run);
            continue;
        }
        for (sum, own) in sum.iter_mut().zip(run) {
            let add = |to: &mut Vec<f64>, from: &Vec<f64>| to.iter_mut().zip(from).for_each(|(t, f)| *t += f);
            sum.scores.iter_mut().zip(&own.scores).for_each(|(to, from)| add(to, from));
            add(&mut sum.squares, &own.squares);
        }
    }
    sum
}

/// Parts f, none below 0, with `sum of sizes(o,k) f(k)` as near to 1 as they come.
fn parts(sizes: &[Vec<f64>]) -> Vec<f64> {
    let q = sizes.len();
    let mut parts = vec![1.0; q];
    for _ in 0..CORRECTIONS {
        let sums: Vec<f64> = sizes.iter().map(|row| row.iter().zip(&parts).map(|(s, f)| s * f).sum()).collect();
        for (k, part) in parts.iter_mut().enumerate() {
            let (wanted, all) = (0..q)
                .filter(|o| sums[*o] > 0.0 && sizes[*o][k].is_finite())
                .fold((0.0, 0.0), |(w, a), o| (w + sizes[o][k] / sums[o], a + sizes[o][k]));
            if all > 0.0 {
                *part *= wanted / all;
            }
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_found_from_sums() {
        // the first is carried into the second and third, the third alone is heard alone
        let truth = [0.8, 0.1, 0.5];
        let raw = [[1.0, 0.0, 0.0], [6.0, 1.0, 0.2], [0.4, 0.0, 1.0]];
        let sums: Vec<f64> = raw.iter().map(|row| row.iter().zip(truth).map(|(s, f)| s * f).sum()).collect();
        // in units of what is found there
        let sizes: Vec<Vec<f64>> =
            raw.iter().zip(&sums).map(|(row, sum)| row.iter().map(|s| s / sum).collect()).collect();
        for (found, want) in parts(&sizes).iter().zip(truth) {
            assert!((found - want).abs() < 0.02, "{found} {want}");
        }
    }
}
