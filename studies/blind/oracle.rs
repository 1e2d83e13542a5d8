//! What someone who knows the true structure and the true noise would find: fits in the true metric, and the gain in
//! log-likelihood of one structure over another. Biases of every channel of every run are free in both.

use crate::noise::Noise;
use fdm::Model;
use fdm::record::Run;
use fdm::simulate::Simulator;
use nalgebra::{DMatrix, DVector};

/// Steps between samples with which truths are simulated and fitted.
pub(crate) const STEPS: usize = 6;

/// A structure with the numbers that fit best.
#[derive(Debug, Clone)]
pub(crate) struct Fitted {
    pub(crate) theta: Vec<f64>,
    /// Sum of squares of the whitened residuals, biases taken out.
    pub(crate) cost: f64,
}

/// Outputs, N by q; nothing when the simulation leaves the finite numbers.
pub(crate) fn response(model: &Model, run: &Run, theta: &[f64]) -> Option<Vec<f64>> {
    response_by(model, run, theta, STEPS)
}

pub(crate) fn response_by(model: &Model, run: &Run, theta: &[f64], steps: usize) -> Option<Vec<f64>> {
    let mut y = vec![f64::NAN; run.len() * model.layout().outputs];
    let mut simulator = Simulator::new(model.dynamics(), run, steps).ok()?;
    simulator.simulate(theta, &mut y).ok()?;
    // what is as large as this will not be a model of anything
    y.iter().all(|v| v.abs() < 1e9).then_some(y)
}

/// Parameters that are fitted.
pub(crate) fn free(model: &Model) -> Vec<usize> {
    let params = &model.definition().params;
    (0..params.len()).filter(|k| !params[*k].fixed && !params[*k].is_recorded()).collect()
}

/// Orthonormal directions of the channels' biases in whitened samples.
pub(crate) struct Biases(Vec<Vec<f64>>);

impl Biases {
    pub(crate) fn new(noise: &Noise, samples: usize) -> Self {
        let q = noise.sigma.len();
        let mut found: Vec<Vec<f64>> = Vec::new();
        for c in 0..q {
            let rows: Vec<f64> = (0..samples * q).map(|k| if k % q == c { noise.sigma[c] } else { 0.0 }).collect();
            let mut white = noise.whiten(&rows);
            found.iter().for_each(|b| remove(b, &mut white));
            let length = dot(&white, &white).sqrt();
            white.iter_mut().for_each(|v| *v /= length);
            found.push(white);
        }
        Self(found)
    }

    /// Whitened, without biases.
    pub(crate) fn whiten(&self, noise: &Noise, rows: &[f64]) -> Vec<f64> {
        let mut white = noise.whiten(rows);
        self.0.iter().for_each(|b| remove(b, &mut white));
        white
    }
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn remove(direction: &[f64], from: &mut [f64]) {
    let part = dot(direction, from);
    from.iter_mut().zip(direction).for_each(|(v, d)| *v -= part * d);
}

/// The judge of a case: its metric, and the runs that are looked at.
pub(crate) struct Oracle<'a> {
    pub(crate) noise: &'a Noise,
    pub(crate) biases: &'a Biases,
}

impl Oracle<'_> {
    fn white(&self, rows: &[f64]) -> Vec<f64> {
        self.biases.whiten(self.noise, rows)
    }

    /// Whitened residuals of all runs, one behind the other.
    pub(crate) fn residual(&self, model: &Model, runs: &[Run], theta: &[f64]) -> Option<Vec<f64>> {
        let mut all = Vec::new();
        for run in runs {
            let y = response(model, run, theta)?;
            let difference: Vec<f64> = run.measured.iter().zip(&y).map(|(z, y)| z - y).collect();
            all.extend(self.white(&difference));
        }
        Some(all)
    }

    /// Sum of squares of [`Self::residual`]; infinite where there is no response.
    pub(crate) fn cost(&self, model: &Model, runs: &[Run], theta: &[f64]) -> f64 {
        self.residual(model, runs, theta).map_or(f64::INFINITY, |r| dot(&r, &r))
    }

    /// Whitened residuals, and their negative derivatives by the parameters `columns`, one after the other.
    pub(crate) fn linearised(
        &self,
        model: &Model,
        runs: &[Run],
        theta: &[f64],
        columns: &[usize],
    ) -> Option<(Vec<f64>, Vec<Vec<f64>>)> {
        let q = model.layout().outputs;
        let (mut residual, mut jacobian) = (Vec::new(), vec![Vec::new(); columns.len()]);
        for run in runs {
            let (n, stride) = (run.len() * q, columns.len().next_multiple_of(8));
            let (mut y, mut rows) = (vec![0.0; n], vec![0.0; n * stride]);
            let mut simulator = Simulator::new(model.dynamics(), run, STEPS).ok()?;
            simulator.sensitivities(theta, columns, &mut y, &mut rows).ok()?;
            let difference: Vec<f64> = run.measured.iter().zip(&y).map(|(z, y)| z - y).collect();
            residual.extend(self.white(&difference));
            for (k, column) in jacobian.iter_mut().enumerate() {
                let one: Vec<f64> = (0..n).map(|row| rows[row * stride + k]).collect();
                column.extend(self.white(&one));
            }
        }
        let finite = |v: &Vec<f64>| v.iter().all(|x| x.is_finite());
        (finite(&residual) && jacobian.iter().all(finite)).then_some((residual, jacobian))
    }

    /// Levenberg and Marquardt from `theta`, inside the bounds.
    pub(crate) fn fit(&self, model: &Model, runs: &[Run], theta: &[f64]) -> Option<Fitted> {
        let params = &model.definition().params;
        let (mut theta, columns) = (theta.to_vec(), free(model));
        let mut cost = self.cost(model, runs, &theta);
        let mut damping = 1e-4;
        for _ in 0..40 {
            let (residual, jacobian) = self.linearised(model, runs, &theta, &columns)?;
            let slope: Vec<f64> = jacobian.iter().map(|c| dot(c, &residual)).collect();
            // what stands at a bound and would leave it stays
            let inner: Vec<usize> = (0..columns.len())
                .filter(|k| {
                    let (p, v) = (&params[columns[*k]], theta[columns[*k]]);
                    dot(&jacobian[*k], &jacobian[*k]) > 0.0
                        && !(v <= p.lower && slope[*k] < 0.0)
                        && !(v >= p.upper && slope[*k] > 0.0)
                })
                .collect();
            let lengths: Vec<f64> = inner.iter().map(|k| dot(&jacobian[*k], &jacobian[*k]).sqrt()).collect();
            let entry = |i: usize, j: usize| dot(&jacobian[inner[i]], &jacobian[inner[j]]) / (lengths[i] * lengths[j]);
            let information = DMatrix::from_fn(inner.len(), inner.len(), entry);
            let right = DVector::from_fn(inner.len(), |i, _| slope[inner[i]] / lengths[i]);
            let mut moved = None;
            for _ in 0..8 {
                let damped = &information + DMatrix::identity(inner.len(), inner.len()) * damping;
                let Some(factor) = damped.cholesky() else {
                    damping *= 10.0;
                    continue;
                };
                let step = factor.solve(&right);
                let mut trial = theta.clone();
                for (i, k) in inner.iter().enumerate() {
                    let p = &params[columns[*k]];
                    trial[columns[*k]] = (trial[columns[*k]] + step[i] / lengths[i]).clamp(p.lower, p.upper);
                }
                let found = self.cost(model, runs, &trial);
                if found < cost {
                    moved = Some((trial, found));
                    damping = (damping * 0.1).max(1e-10);
                    break;
                }
                damping *= 10.0;
            }
            let Some((next, found)) = moved else { break };
            let fall = cost - found;
            (theta, cost) = (next, found);
            if fall < 1e-4 {
                break;
            }
        }
        cost.is_finite().then_some(Fitted { theta, cost })
    }
}

/// Removes from vectors what others explain.
pub(crate) struct Projection(Vec<Vec<f64>>);

impl Projection {
    /// From columns that may depend on each other.
    pub(crate) fn new(columns: &[Vec<f64>]) -> Self {
        let mut kept: Vec<Vec<f64>> = Vec::new();
        for column in columns {
            let length = dot(column, column).sqrt();
            let mut rest = column.clone();
            // twice is enough
            for _ in 0..2 {
                kept.iter().for_each(|k| remove(k, &mut rest));
            }
            let left = dot(&rest, &rest).sqrt();
            if left > 1e-9 * length && left > 0.0 {
                rest.iter_mut().for_each(|v| *v /= left);
                kept.push(rest);
            }
        }
        Self(kept)
    }

    pub(crate) fn apply(&self, mut vector: Vec<f64>) -> Vec<f64> {
        self.0.iter().for_each(|k| remove(k, &mut vector));
        vector
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chance::Chance;
    use crate::experiment;
    use crate::families::FAMILIES;
    use crate::noise::Colour;

    #[test]
    fn truths_are_integrated_well_enough() {
        for family in FAMILIES.iter().filter(|f| !f.apart) {
            let model = Model::from_text(family.name, family.text).unwrap();
            let mut chance = Chance::new(family.name);
            let moved = experiment::excitation(family, &mut chance);
            for (name, moved) in experiment::MANOEUVRES.iter().zip(&moved) {
                let run = experiment::run(&model, name, family.step, experiment::inputs(family, moved));
                let theta = model.definition().start();
                let (rough, fine) =
                    (response(&model, &run, &theta).unwrap(), response_by(&model, &run, &theta, 8 * STEPS).unwrap());
                let q = model.layout().outputs;
                for c in 0..q {
                    let (mut off, mut size) = (0.0_f64, 0.0_f64);
                    for (a, b) in rough.iter().zip(&fine).skip(c).step_by(q) {
                        off = off.max((a - b).abs());
                        size = size.max((b - fine[c]).abs());
                    }
                    assert!(size > 0.0 && off < 1e-4 * size, "{} {name}, output {c}: {off} of {size}", family.name);
                }
            }
        }
    }

    #[test]
    fn a_fit_returns_to_the_numbers_that_made_the_data() {
        let family = &FAMILIES[0];
        let model = Model::from_text(family.name, family.text).unwrap();
        let mut chance = Chance::new("return");
        let moved = experiment::excitation(family, &mut chance);
        let mut run = experiment::run(&model, "run1", family.step, experiment::inputs(family, &moved[0]));
        let truth: Vec<f64> = model.definition().start().iter().map(|v| 1.1 * v).collect();
        run.measured = response(&model, &run, &truth).unwrap();
        run.measured.chunks_exact_mut(3).for_each(|row| row[1] += 0.3); // a bias
        let noise = Noise::new(Colour::Pink, vec![0.01, 0.01, 0.1], run.len(), &mut chance);
        let biases = Biases::new(&noise, run.len());
        let oracle = Oracle { noise: &noise, biases: &biases };
        let found = oracle.fit(&model, &[run], &model.definition().start()).unwrap();
        assert!(found.cost < 1e-6, "{}", found.cost);
        assert!(found.theta.iter().zip(&truth).all(|(a, b)| (a / b - 1.0).abs() < 1e-4), "{found:?} {truth:?}");
    }
}
