//! The residuals of all runs as one vector with its exact Jacobian, for optimisers and samplers other than those of this package.

use super::options::{Attempt, suited};
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::options::FitOptions;
use crate::methods::output_error::single::{chosen_steps, starts};
use crate::problem::response::RunResponse;
use crate::problem::unknowns::Changes;
use crate::problem::unknowns::DerivedQuantities;
use crate::problem::unknowns::{UnknownName, Unknowns};
use crate::problem::{Problem, ProblemRun};
use crate::work::Work;
use fdm_grammar::model::Prior;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Divergence, Steps};

/// Residuals (measured minus simulated) of every measured number, over the standard deviation of its output, and their derivatives.
///
/// Unknowns are the shared parameters that are estimated, in the model's order, then those of every run. Rows are runs, in these
/// samples, in these outputs; a number that was not measured has none. Integration steps are chosen at the start values, unless the
/// options give them, and kept, so that the Jacobian is exact.
pub struct ResidualVector<'a> {
    problem: Problem<'a>,
    unknowns: Unknowns,
    /// One over the standard deviation of each output (q).
    weights: Vec<f64>,
    /// The row of each number of each run (N by q); none of one that was not measured.
    rows: Vec<Vec<Option<usize>>>,
    count: usize,
    /// Memory: parameters of a run, and its outputs.
    theta: Vec<f64>,
    response: Vec<f64>,
}

impl<'a> ResidualVector<'a> {
    /// Residuals of a model (see [`changed`](crate::changed)) and runs, in units of the `deviations` of the outputs (q). Of the options
    /// those of integration have a part: far from the start values a stiff model wants `scheme` to be Radau.
    ///
    /// # Errors
    /// [`FitError::Unsuited`] when a run cannot be simulated.
    ///
    /// # Panics
    /// When there are not as many deviations as outputs.
    pub fn new(model: &'a Model, runs: &'a [Run], deviations: &[f64], options: &FitOptions) -> Result<Self, FitError> {
        assert_eq!(deviations.len(), model.definition().outputs.len(), "a deviation for each output");
        let starts = starts(model, runs, &Changes::default());
        let steps = match options.per_interval {
            Some(count) => vec![Steps::equal(options.scheme.unwrap_or_default(), count); runs.len()],
            None => chosen_steps(&Attempt { model, runs, starts: &starts, options, work: &Work::default() })?
                .into_iter()
                .map(|a| a.steps)
                .collect(),
        };
        let mut prepared = Vec::with_capacity(runs.len());
        for ((run, start), steps) in runs.iter().zip(&starts).zip(steps) {
            prepared.push(prepared_run(model, run, start, steps)?);
        }
        let derived = DerivedQuantities::none();
        let problem = Problem::new(model.definition(), prepared, derived);
        let mut count = 0;
        let row = |measured: &f64, count: &mut usize| {
            (!measured.is_nan()).then(|| {
                *count += 1;
                *count - 1
            })
        };
        let rows = problem.runs.iter().map(|run| run.measured.iter().map(|z| row(z, &mut count)).collect()).collect();
        let longest = problem.runs.iter().map(|run| run.measured.len()).max().unwrap_or_default();
        Ok(Self {
            unknowns: Unknowns::new(&problem),
            weights: deviations.iter().map(|d| 1.0 / d).collect(),
            rows,
            count,
            theta: vec![0.0; model.definition().params.len()],
            response: vec![0.0; longest],
            problem,
        })
    }

    /// Number of residuals R.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether nothing was measured.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// What the unknowns (U) are called.
    pub fn unknowns(&self) -> Vec<UnknownName> {
        self.unknowns.names(&self.problem)
    }

    /// Start values of the unknowns (U).
    pub fn start(&self) -> &[f64] {
        &self.unknowns.start
    }

    /// Least and greatest admissible values of the unknowns (U each).
    pub fn bounds(&self) -> (&[f64], &[f64]) {
        (&self.unknowns.lower, &self.unknowns.upper)
    }

    /// What is known beforehand of each unknown (U).
    pub fn priors(&self) -> Vec<Option<Prior>> {
        (0..self.unknowns.len()).map(|g| self.problem.params[self.unknowns.owner(g).1].prior).collect()
    }

    /// The output of each residual (R), as its number among the outputs.
    pub fn outputs(&self) -> impl Iterator<Item = usize> {
        let q = self.weights.len().max(1);
        self.rows
            .iter()
            .flat_map(move |rows| rows.iter().enumerate().filter(|(_, r)| r.is_some()).map(move |(k, _)| k % q))
    }

    /// Residuals (R) at these values of the unknowns (U).
    ///
    /// # Errors
    /// [`Divergence`] when a run cannot be simulated to its end; `residuals` is then of no use.
    ///
    /// # Panics
    /// When the lengths are not those.
    pub fn residuals(&mut self, values: &[f64], residuals: &mut [f64]) -> Result<(), Divergence> {
        assert_eq!((values.len(), residuals.len()), (self.unknowns.len(), self.count), "unknowns and residuals");
        let q = self.weights.len();
        for (r, run) in self.problem.runs.iter_mut().enumerate() {
            self.theta.copy_from_slice(&self.unknowns.theta[r]);
            self.unknowns.assemble(r, values, &mut self.theta);
            let response = &mut self.response[..run.measured.len()];
            run.response.simulate(&self.theta, response)?;
            for (k, row) in self.rows[r].iter().enumerate() {
                if let Some(row) = *row {
                    residuals[row] = (run.measured[k] - response[k]) * self.weights[k % q];
                }
            }
        }
        Ok(())
    }

    /// Residuals (R) and their derivatives by the unknowns (R by U, row-major) at these values (U). Nothing of the size of the Jacobian
    /// is kept beside it.
    ///
    /// # Errors
    /// As [`Self::residuals`].
    ///
    /// # Panics
    /// When the lengths are not those.
    pub fn jacobian(&mut self, values: &[f64], residuals: &mut [f64], jacobian: &mut [f64]) -> Result<(), Divergence> {
        let width = self.unknowns.len();
        let sizes = (values.len(), residuals.len(), jacobian.len());
        assert_eq!(sizes, (width, self.count, self.count * width), "unknowns, residuals and Jacobian");
        let (q, unknowns, weights) = (self.weights.len(), &self.unknowns, &self.weights);
        jacobian.fill(0.0);
        for (r, run) in self.problem.runs.iter_mut().enumerate() {
            self.theta.copy_from_slice(&unknowns.theta[r]);
            unknowns.assemble(r, values, &mut self.theta);
            let (rows, measured) = (&self.rows[r], &run.measured);
            run.response.sensitivities(&self.theta, &unknowns.columns, &mut |block| {
                for sample in 0..block.samples() {
                    for (o, output) in block.layout.outputs.iter().enumerate() {
                        let k = (block.first + sample) * q + o;
                        let Some(row) = rows[k] else { continue };
                        residuals[row] = block.residual(measured, sample, o) * weights[o];
                        let line = &mut jacobian[row * width..][..width];
                        for (column, slope) in output.columns.iter().zip(block.row(sample, o)) {
                            line[unknowns.position(r, *column as usize)] = -slope * weights[o];
                        }
                    }
                }
            })?;
        }
        Ok(())
    }
}

fn prepared_run<'a>(model: &'a Model, run: &'a Run, start: &[f64], steps: Steps) -> Result<ProblemRun<'a>, FitError> {
    let simulator = suited(model, run, start, steps)?;
    let (name, measured, start) = (run.name.clone(), run.measured.clone(), start.to_vec());
    Ok(ProblemRun { name, response: RunResponse::in_time(simulator), measured, start })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Noise, Options, fit};

    /// Two outputs with gaps in two runs, a shared rate and a bias per run.
    fn specimen() -> (Model, Vec<Run>) {
        let text = "model pair { input u; state x = free; param k = 0.7, b = 0.1 per run; der(x) = u - k*x; \
                    output y = x + b; noise y = 0.1; output z = x*x; noise z = 0.2; }";
        let model = Model::from_text("pair.fdm", text).expect("a model");
        let run = |name: &str, phase: f64| {
            let times: Vec<f64> = (0..60).map(|k| 0.1 * f64::from(k)).collect();
            let wave = |f: f64| times.iter().map(|t| (f * t + phase).sin()).collect::<Vec<f64>>();
            let (u, mut y, mut z) = (wave(1.3), wave(0.9), wave(0.4));
            (y[3], z[7], z[8]) = (f64::NAN, f64::NAN, f64::NAN);
            model.run(name).times(times.clone()).samples("u", u).samples("y", y).samples("z", z).build().expect("a run")
        };
        let runs = vec![run("a", 0.0), run("b", 0.8)];
        (model, runs)
    }

    #[test]
    fn residuals_are_those_of_the_fit_and_vanish_with_their_gradient_at_its_minimum() {
        let (model, runs) = specimen();
        let options = Options { noise: Noise::Given(vec![Some(0.1), Some(0.2)]), ..Options::default() };
        let found =
            fit(&model, &runs, &FitOptions { options, ..FitOptions::default() }, &Work::default()).expect("a fit");
        let mut vector = ResidualVector::new(&model, &runs, &[0.1, 0.2], &FitOptions::default()).expect("residuals");
        let names = vector.unknowns();
        assert_eq!((vector.len(), names.len()), (2 * (120 - 3), 1 + 2 * 2));
        let value = |n: &UnknownName| found.estimate.parameter(&n.name, n.run.as_deref()).expect("a parameter").value;
        let values: Vec<f64> = names.iter().map(value).collect();
        let (mut alone, mut residuals) = (vec![0.0; vector.len()], vec![0.0; vector.len()]);
        let mut jacobian = vec![0.0; vector.len() * names.len()];
        vector.residuals(&values, &mut alone).expect("a response");
        vector.jacobian(&values, &mut residuals, &mut jacobian).expect("a response");
        let of_fit = found.estimate.runs.iter().flat_map(|run| run.residuals.iter().enumerate());
        let of_fit: Vec<f64> = of_fit.filter(|(_, r)| !r.is_nan()).map(|(k, r)| r / [0.1, 0.2][k % 2]).collect();
        let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6 * (1.0 + b.abs()));
        assert!(alone.len() == of_fit.len() && close(&alone, &of_fit) && close(&residuals, &alone));
        let gradient = |g: usize| -> f64 { residuals.iter().zip(jacobian.chunks(5)).map(|(r, row)| r * row[g]).sum() };
        let size =
            |g: usize| -> f64 { residuals.iter().zip(jacobian.chunks(5)).map(|(r, row)| (r * row[g]).abs()).sum() };
        assert!((0..5).all(|g| gradient(g).abs() < 1e-6 * size(g)));
        assert_eq!(vector.outputs().filter(|o| *o == 1).count(), 2 * 58);
    }

    #[test]
    fn the_jacobian_is_the_derivative() {
        let (model, runs) = specimen();
        let mut vector = ResidualVector::new(&model, &runs, &[0.1, 0.2], &FitOptions::default()).expect("residuals");
        let (count, at) = (vector.len(), vector.start().to_vec());
        let (mut residuals, mut jacobian) = (vec![0.0; count], vec![0.0; count * at.len()]);
        vector.jacobian(&at, &mut residuals, &mut jacobian).expect("a response");
        for g in 0..at.len() {
            let mut moved = |by: f64| {
                let (mut values, mut residuals) = (at.clone(), vec![0.0; count]);
                values[g] += by;
                vector.residuals(&values, &mut residuals).expect("a response");
                residuals
            };
            let (up, down) = (moved(1e-5), moved(-1e-5));
            for row in 0..count {
                let difference = (up[row] - down[row]) / 2e-5;
                let exact = jacobian[row * at.len() + g];
                assert!((difference - exact).abs() < 1e-6 * (1.0 + exact.abs()), "{row} {g}: {difference} {exact}");
            }
        }
    }
}
