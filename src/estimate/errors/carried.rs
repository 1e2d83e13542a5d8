//! What the noise of records does to estimates and their errors where the records stand in the equations.
//!
//! Residuals are then more than the noise of the outputs: noise of one record comes through the model into others. How much of each there is follows from how
//! large all residuals are: `R(o,o) = sum of f(k) T(o,k)`, T what noise of output k, as large as its residuals, does to the residuals of o, and f at least 0
//! (found by the multiplicative corrections of Richardson and Lucy). Inputs whose noise is known stand behind the outputs, with f = 1.
//!
//! The score has then the covariance `sum of f(k) <(s + c)(s + c)'>`, s what is seen and c what is carried: of noise that is a part f of the residuals, and
//! `sum of f(k) <c c' + c s' + s c'>` besides.
//!
//! Noise draws the estimates too ([`Undone`]).

use super::sandwich::Sandwich;
use super::spectral_rows::SpectralRows;
use super::undone::{Again, Undone};
use crate::estimate::noise::Weights;
use crate::estimate::problem::{CarriedNoise, NoiseShift, Problem, Slopes};
use rayon::prelude::*;

/// Corrections of the parts.
const CORRECTIONS: usize = 300;

/// What one draw of the noise of one output does, all runs together.
struct Draw {
    /// The score of each chosen unknown through what is seen, and through what is carried (n).
    scores: [Vec<f64>; 2],
    /// What it would do to estimates.
    again: Again,
    /// Mean squares of what is left of it in the residuals of each output (q).
    left: Vec<f64>,
}

/// What noise in the equations does.
pub(super) struct Carried {
    /// For each output the part of its residuals' variance that is its own noise (q).
    pub(super) parts: Vec<f64>,
    /// What is added to the middle (n by n).
    pub(super) middle: Vec<f64>,
    /// The way to estimates without it.
    pub(super) undone: Option<Undone>,
}

/// What is drawn for.
struct Drawing<'f> {
    carried: &'f dyn CarriedNoise,
    runs: &'f [SpectralRows],
    sandwich: &'f Sandwich<'f>,
    values: &'f [f64],
    /// Weights of the residuals (q by q).
    weights: Vec<f64>,
    /// Mean squares of the residuals (q).
    found: Vec<f64>,
}

/// Draws of each record, and what part of what was drawn goes with the residuals that are found.
struct Draws {
    of_records: Vec<Vec<Draw>>,
    parts: Vec<f64>,
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
        let carried = problem.carried_noise.as_deref()?;
        let (q, n) = (problem.outputs.len(), sandwich.conclusion.inverse.chosen.len());
        let found = left(runs.iter().map(|run| run.residuals(q)), q);
        let drawing = Drawing { carried, runs, sandwich, values, weights: noise.inverse(), found };
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
        let again = of_records.iter().zip(&parts).map(|(own, part)| (*part, own.iter().map(|d| &d.again)));
        let undone = Undone::of(&sandwich.conclusion.inverse, again);
        let parts = first[..q].iter().zip(&parts).map(|(first, then)| first * then).collect();
        middle.iter().all(|v| v.is_finite()).then_some(Self { parts, middle, undone })
    }
}

impl Drawing<'_> {
    /// Noise of these levels (q). None where none of it comes through the model.
    fn draw(&self, levels: &[f64], slopes: Option<Slopes<'_>>) -> Option<Draws> {
        let theta = |r: usize| self.sandwich.unknowns.assembled(r, self.values);
        let of_run = |r: usize| self.carried.shifts(r, &theta(r), levels, slopes);
        let runs = (0..self.runs.len()).into_par_iter();
        let shifts: Vec<Vec<Vec<NoiseShift>>> = runs.map(of_run).collect::<Option<_>>()?;
        let heard = |shift: &NoiseShift| shift.carried.iter().any(|v| *v != 0.0);
        if !shifts.iter().flatten().flatten().any(heard) {
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
        let (n, q) = (sandwich.conclusion.inverse.chosen.len(), weights.len().isqrt());
        let score = |of: fn(&NoiseShift) -> &Vec<f64>| {
            let mut score = vec![0.0; n];
            for (r, (shift, run)) in own.iter().zip(runs).enumerate() {
                for (place, s) in sandwich.places(r).iter().zip(run.score(of(shift), weights)) {
                    place.iter().for_each(|place| score[*place] += s);
                }
            }
            score
        };
        let scores = [score(|shift| &shift.seen), score(|shift| &shift.carried)];
        let mut again = Again::new(n);
        for (r, shift) in own.iter().enumerate().filter(|(_, shift)| !shift.pull.is_empty()) {
            again.add(shift, &sandwich.places(r), &sandwich.scale(r));
        }
        // the fit takes of it what it can
        let inverse = &sandwich.conclusion.inverse.values;
        let whole: Vec<f64> = scores[0].iter().zip(&scores[1]).map(|(s, c)| s + c).collect();
        again.score.clone_from(&whole);
        let moved: Vec<f64> =
            inverse.chunks(n.max(1)).map(|row| row.iter().zip(&whole).map(|(d, s)| d * s).sum()).collect();
        let rest = |(r, (shift, run)): (usize, (&&NoiseShift, &SpectralRows))| -> Vec<f64> {
            let places = sandwich.places(r);
            let step: Vec<f64> = places.iter().map(|place| place.map_or(0.0, |k| moved[k])).collect();
            let explained = run.explained(&step, q);
            let changes = shift.seen.iter().zip(&shift.carried);
            changes.zip(explained).map(|((s, c), e)| s + c - e).collect()
        };
        let left = left(own.iter().zip(runs).enumerate().map(rest), q);
        Self { scores, again, left }
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
    for _ in 0..CORRECTIONS {
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
