//! Noise of measured regressors: records that are compared and stand in the equations as well (errors in variables).
//!
//! Their noise is in the residuals of several outputs. How much of each there is follows from how large all residuals are,
//! `R(o,o) = sum of f(k) T(o,k)`, T what noise of output k, as large as its residuals, does to the residuals of o, and f at least 0 (Richardson and Lucy's
//! multiplicative iteration). Inputs whose noise is known stand behind the outputs, with f = 1. The score has then the covariance
//! `sum of f(k) <(s + c)(s + c)'>`, s from what is measured and c through the regressors: that of the residuals, and `sum of f(k) <c c' + c s' + s c'>` besides.
//!
//! The bias is removed by simulation extrapolation (SIMEX, Cook and Stefanski 1994). Each draw d and its mirror image -d change the sensitivities by dS and the
//! residuals by de, and a fit would answer `(S + dS)' W (S + dS)` solved for `(S + dS)' W (e + de)`. The mean at once and twice the noise is extrapolated
//! to none by a parabola, `3 x(0) - 3 x(1) + x(2)`; mirror images cancel what is of first order, so that few draws suffice.

use super::sandwich::Sandwich;
use super::spectral_rows::SpectralRows;
use crate::problem::noise::Weights;
use crate::problem::{NoiseShift, Problem, RegressorNoise, Slopes};
use fdm_numeric::quadratic::Inverse;
use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

/// The effect of one simulation of the noise of one output, all runs together.
struct Draw {
    /// The score of each chosen unknown through the measurement, and through the regressors (n).
    scores: [Vec<f64>; 2],
    /// What it would do to estimates.
    simex: SimexDraw,
    /// Mean squares of what is left of it in the residuals of each output (q).
    left: Vec<f64>,
}

/// What noise of measured regressors does.
pub(super) struct RegressorEffect {
    /// For each output the part of its residuals' variance that is its own noise (q).
    pub(super) parts: Vec<f64>,
    /// What is added to the middle (n by n).
    pub(super) middle: Vec<f64>,
    /// The way to estimates without it.
    pub(super) simex: Option<Simex>,
}

/// The fit whose noise is simulated.
struct Drawing<'f> {
    noise: &'f dyn RegressorNoise,
    runs: &'f [SpectralRows],
    sandwich: &'f Sandwich<'f>,
    values: &'f [f64],
    /// Weights of the residuals (q by q).
    weights: Vec<f64>,
    /// Mean squares of the residuals (q).
    found: Vec<f64>,
}

/// Simulations of each record's noise, and the part of it that agrees with the residuals.
struct Draws {
    of_records: Vec<Vec<Draw>>,
    parts: Vec<f64>,
}

impl RegressorEffect {
    /// None where there is no measured regressor, or its noise is not known.
    pub(super) fn of(
        problem: &Problem<'_>,
        runs: &[SpectralRows],
        sandwich: &Sandwich<'_>,
        values: &[f64],
        noise: &Weights,
    ) -> Option<Self> {
        let simulated = problem.regressor_noise.as_deref()?;
        let (q, n) = (problem.outputs.len(), sandwich.bound.inverse.chosen.len());
        let found = left(runs.iter().map(|run| run.residuals(q)), q);
        let drawing = Drawing { noise: simulated, runs, sandwich, values, weights: noise.inverse(), found };
        let residuals: Vec<f64> = (0..q).map(|o| noise.covariance[o * q + o]).collect();
        let first = drawing.draw(&residuals, None)?.parts;
        // what is weaker than the residuals has another colour
        let levels: Vec<f64> = first.iter().zip(&residuals).map(|(part, level)| part * level).collect();
        let slopes = Slopes { columns: &sandwich.unknowns.columns, weights: &drawing.weights };
        let Draws { of_records, parts } = drawing.draw(&levels, Some(slopes))?;
        let mut middle = vec![0.0; n * n];
        for (draws, part) in of_records.iter().zip(&parts) {
            let share = part / draws.len() as f64;
            for Draw { scores: [s, c], .. } in draws {
                for (k, sum) in middle.iter_mut().enumerate() {
                    let (i, j) = (k / n, k % n);
                    *sum += share * (c[i] * c[j] + c[i] * s[j] + s[i] * c[j]);
                }
            }
        }
        let draws = of_records.iter().zip(&parts).map(|(own, part)| (*part, own.iter().map(|d| &d.simex)));
        let simex = Simex::of(&sandwich.bound.inverse, draws);
        let parts = first[..q].iter().zip(&parts).map(|(first, then)| first * then).collect();
        middle.iter().all(|v| v.is_finite()).then_some(Self { parts, middle, simex })
    }
}

impl Drawing<'_> {
    /// Noise of these levels (q). None where none of it comes through the model.
    fn draw(&self, levels: &[f64], slopes: Option<Slopes<'_>>) -> Option<Draws> {
        let theta = |r: usize| self.sandwich.unknowns.assembled(r, self.values);
        let of_run = |r: usize| self.noise.shifts(r, &theta(r), levels, slopes);
        let runs = (0..self.runs.len()).into_par_iter();
        let shifts: Vec<Vec<Vec<NoiseShift>>> = runs.map(of_run).collect::<Option<_>>()?;
        let comes_through = |shift: &NoiseShift| shift.regressed.iter().any(|v| *v != 0.0);
        if !shifts.iter().flatten().flatten().any(comes_through) {
            return None;
        }
        let draws = shifts.iter().flatten().map(Vec::len).min()?;
        let one = |k: usize, draw: usize| {
            let own: Vec<&NoiseShift> = shifts.iter().map(|of_run| &of_run[k][draw]).collect();
            Draw::new(&own, self.runs, self.sandwich, &self.weights)
        };
        let of_record = |k: usize| (0..draws).map(|draw| one(k, draw)).collect();
        let of_records: Vec<Vec<Draw>> = (0..shifts[0].len()).into_par_iter().map(of_record).collect();
        let size = |o: usize, own: &[Draw]| own.iter().map(|d| d.left[o]).sum::<f64>() / draws as f64 / self.found[o];
        let sizes = (0..self.found.len()).map(|o| of_records.iter().map(|own| size(o, own)).collect());
        let parts = parts(&sizes.collect::<Vec<Vec<f64>>>());
        Some(Draws { of_records, parts })
    }
}

impl Draw {
    fn new(own: &[&NoiseShift], runs: &[SpectralRows], sandwich: &Sandwich<'_>, weights: &[f64]) -> Self {
        let (n, q) = (sandwich.bound.inverse.chosen.len(), weights.len().isqrt());
        let score = |of: fn(&NoiseShift) -> &Vec<f64>| {
            let mut score = vec![0.0; n];
            for (r, (shift, run)) in own.iter().zip(runs).enumerate() {
                for (place, s) in sandwich.places(r).iter().zip(run.score(of(shift), weights)) {
                    place.iter().for_each(|place| score[*place] += s);
                }
            }
            score
        };
        let scores = [score(|shift| &shift.measured), score(|shift| &shift.regressed)];
        let mut simex = SimexDraw::new(n);
        for (r, shift) in own.iter().enumerate().filter(|(_, shift)| !shift.pull.is_empty()) {
            simex.add(shift, &sandwich.places(r), &sandwich.scale(r));
        }
        // the fit takes of it what it can
        let inverse = &sandwich.bound.inverse.values;
        let whole: Vec<f64> = scores[0].iter().zip(&scores[1]).map(|(s, c)| s + c).collect();
        simex.score.clone_from(&whole);
        let moved: Vec<f64> =
            inverse.chunks(n.max(1)).map(|row| row.iter().zip(&whole).map(|(d, s)| d * s).sum()).collect();
        let rest = |(r, (shift, run)): (usize, (&&NoiseShift, &SpectralRows))| -> Vec<f64> {
            let places = sandwich.places(r);
            let step: Vec<f64> = places.iter().map(|place| place.map_or(0.0, |k| moved[k])).collect();
            let explained = run.explained(&step, q);
            let changes = shift.measured.iter().zip(&shift.regressed);
            changes.zip(explained).map(|((s, c), e)| s + c - e).collect()
        };
        let left = left(own.iter().zip(runs).enumerate().map(rest), q);
        Self { scores, simex, left }
    }
}

/// Mean squares by output of signals of all runs (2 M by q each), where they are numbers.
fn left(signals: impl Iterator<Item = Vec<f64>>, q: usize) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); q];
    for signal in signals {
        for (k, value) in signal.iter().enumerate().filter(|(_, v)| !v.is_nan()) {
            let (sum, count) = &mut sums[k % q];
            *sum += value * value;
            *count += 1.0;
        }
    }
    sums.iter().map(|(sum, count)| if *count > 0.0 { sum / count } else { 1.0 }).collect()
}

/// Parts f (of as many outputs as there are rows, none below 0; 1 of the inputs behind them, whose noise is known) with `sum of sizes(o,k) f(k)` as near to
/// 1 as they come.
fn parts(sizes: &[Vec<f64>]) -> Vec<f64> {
    let q = sizes.len();
    let mut parts = vec![1.0; sizes.first().map_or(0, Vec::len)];
    // multiplicative iterations for the parts
    for _ in 0..300 {
        let sums: Vec<f64> = sizes.iter().map(|row| row.iter().zip(&parts).map(|(s, f)| s * f).sum()).collect();
        for (k, part) in parts[..q].iter_mut().enumerate() {
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

/// The change of the normal equations of the chosen unknowns by one simulation.
pub(super) struct SimexDraw {
    /// `S' W de` (n).
    pub(super) score: Vec<f64>,
    /// `dS' W e` (n).
    tilt: Vec<f64>,
    /// `dS' W de` (n).
    pull: Vec<f64>,
    /// `S' W dS` (n by n).
    cross: Vec<f64>,
    /// `dS' W dS` (n by n).
    added: Vec<f64>,
}

impl SimexDraw {
    pub(super) fn new(n: usize) -> Self {
        let (vector, matrix) = (vec![0.0; n], vec![0.0; n * n]);
        Self { score: vector.clone(), tilt: vector.clone(), pull: vector, cross: matrix.clone(), added: matrix }
    }

    /// Adds what it does in one run, whose columns stand at these places and have these norms.
    pub(super) fn add(&mut self, shift: &NoiseShift, places: &[Option<usize>], scale: &[f64]) {
        let n = self.pull.len();
        let chosen = |(c, place): (usize, &Option<usize>)| place.map(|place| (c, place, scale[c]));
        let columns: Vec<(usize, usize, f64)> = places.iter().enumerate().filter_map(chosen).collect();
        for (c, i, norm) in &columns {
            self.tilt[*i] += shift.tilt[*c] / norm;
            self.pull[*i] += shift.pull[*c] / norm;
            for (d, j, other) in &columns {
                let (from, to) = (c * places.len() + d, i * n + j);
                self.cross[to] += shift.cross[from] / (norm * other);
                self.added[to] += shift.added[from] / (norm * other);
            }
        }
    }
}

/// The way to estimates without noise in the equations.
pub(super) struct Simex {
    /// The step of each chosen unknown (n).
    pub(super) step: Vec<f64>,
    /// What stands in the place of the inverse information in their covariance (n by n).
    pub(super) inverse: Vec<f64>,
}

impl Simex {
    /// From the simulations of each record, each with the part of them that the noise is. None where something is not determined.
    pub(super) fn of<'d, D>(inverse: &Inverse, records: impl Iterator<Item = (f64, D)>) -> Option<Self>
    where
        D: ExactSizeIterator<Item = &'d SimexDraw>,
    {
        let n = inverse.chosen.len();
        let known = DMatrix::from_row_slice(n, n, &inverse.values);
        let information = Cholesky::new(known.clone()).filter(|_| inverse.null.is_empty())?.inverse();
        let (mut step, mut turned) = (DVector::zeros(n), DMatrix::zeros(n, n));
        for (part, draws) in records {
            let count = draws.len() as f64;
            for draw in draws.filter(|draw| draw.added.iter().any(|v| *v != 0.0)) {
                let matrix = |values: &[f64]| DMatrix::from_row_slice(n, n, values);
                let (cross, added) = (matrix(&draw.cross), matrix(&draw.added));
                let first = DVector::from_column_slice(&draw.score) + DVector::from_column_slice(&draw.tilt);
                let second = DVector::from_column_slice(&draw.pull);
                for (times, sign) in [(1.0, 1.0), (1.0, -1.0), (2.0, 1.0), (2.0, -1.0)] {
                    let power: f64 = part * times;
                    let size = sign * power.sqrt();
                    let normal = &information + size * (&cross + cross.transpose()) + power * &added;
                    let answer = Cholesky::new(0.5 * (&normal + normal.transpose()))?;
                    // of 3 x(0) - 3 x(1) + x(2), half by each sign
                    let weight = 0.5 * if times == 1.0 { -3.0 } else { 1.0 } / count;
                    step += weight * answer.solve(&(size * &first + power * &second));
                    // residuals change by -dS x
                    turned -= weight * answer.solve(&(size * &cross + power * &added));
                }
            }
        }
        let grown = turned * &known;
        // symmetric but for chance
        let inverse = &known + 0.5 * (&grown + grown.transpose());
        let finite = inverse.iter().chain(step.iter()).all(|v| v.is_finite());
        finite.then(|| Self { step: step.as_slice().to_vec(), inverse: inverse.as_slice().to_vec() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_inputs_do_is_no_part_of_an_outputs_noise() {
        // a known input makes a third of what is found in the first
        let found = parts(&[vec![1.0, 0.0, 1.0 / 3.0], vec![0.0, 2.0, 0.0]]);
        assert!((found[0] - 2.0 / 3.0).abs() < 1e-3 && (found[1] - 0.5).abs() < 1e-3 && found[2] == 1.0, "{found:?}");
    }

    #[test]
    fn parts_are_found_from_sums() {
        // the first comes through the model into the second and third, the third alone is in no other
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
