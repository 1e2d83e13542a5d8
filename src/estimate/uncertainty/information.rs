//! Fisher's information of runs about the parameters that they share, with what belongs to each run eliminated (Schur complement).
//!
//! Symmetric matrices of unknowns that some belong to one run alone: zero between the unknowns of different runs, so that these are eliminated run by
//! run, and only what all share is left (Schur complement).

use crate::iteration::evaluation::{NormalEquations, NotFinite};
use crate::problem::response::RunResponse;
use crate::problem::unknowns::{DerivedQuantities, Unknowns};
use crate::problem::{Problem, ProblemRun};
use crate::uncertainty::identifiability::{Direction, undetermined};
use fdm_numeric::quadratic::Inverse;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, StepOptions, UNSOUND, Unsuited, choose_steps};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Eigenvalues of what belongs to the runs, below this part of the largest, count as zero.
const RANK: f64 = 1e-12;

/// Why a run has no information.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NoInformation {
    /// It cannot be simulated with exact derivatives.
    #[error("run `{run}`: {reason}")]
    Unsuited {
        /// The run.
        run: String,
        /// Why.
        reason: Unsuited,
    },
    /// Its response leaves all bounds.
    #[error("run `{run}` runs away: its response is not finite from {time} on")]
    RunsAway {
        /// The run.
        run: String,
        /// When.
        time: f64,
    },
    /// No steps integrate it with an error that is small beside its response.
    #[error("run `{run}` is not integrated: the error is {error:.0e} of an output's range")]
    Inaccurate {
        /// The run.
        run: String,
        /// The error, as a part of an output's range.
        error: f64,
    },
    /// Its response is finite, its sensitivities are not.
    #[error("run `{run}` has no finite sensitivities")]
    NotFinite {
        /// The run.
        run: String,
    },
}

/// J'R^-1 J of the free shared parameters (P by P), in their units.
#[derive(Debug, Clone, PartialEq)]
pub struct Information {
    /// Names of the parameters.
    names: Vec<String>,
    matrix: DMatrix<f64>,
}

impl Information {
    /// Nothing but what the model's priors say.
    pub fn prior(model: &Model) -> Self {
        let params = model.definition().params.iter().filter(|p| !p.fixed && !p.per_run);
        let weights: Vec<f64> = params.clone().map(|p| p.prior.map_or(0.0, |p| p.deviation.powi(-2))).collect();
        let names = params.map(|p| p.quantity.name.clone()).collect();
        Self { names, matrix: DMatrix::from_diagonal(&DVector::from_vec(weights)) }
    }

    /// Of runs with all their parameters (p each), by white noise of these standard deviations (q). Only inputs and times are read of the
    /// runs, and which outputs were measured: the rest is in the model. Also the responses (N by q each).
    ///
    /// # Errors
    /// [`NoInformation`], where a run cannot be simulated to its end with finite sensitivities.
    pub fn of(
        model: &Model,
        runs: &[Run],
        thetas: &[Vec<f64>],
        deviations: &[f64],
    ) -> Result<(Self, Vec<Vec<f64>>), NoInformation> {
        let definition = model.definition();
        let (mut prepared, mut responses) = (Vec::with_capacity(runs.len()), Vec::with_capacity(runs.len()));
        for (run, theta) in runs.iter().zip(thetas) {
            let (run, response) = simulated(model, run, theta)?;
            prepared.push(run);
            responses.push(response);
        }
        let derived = DerivedQuantities::of(definition, model.dynamics());
        let mut problem = Problem::new(definition, prepared, derived);
        let free = |per_run: bool| {
            let of = move |p: &&fdm_grammar::model::Param| !p.fixed && p.per_run == per_run;
            definition.params.iter().filter(of).count()
        };
        let (shared, own) = (free(false), free(true));
        let mut values = Vec::with_capacity(shared + own * runs.len());
        let chosen = |per_run: bool, theta: &[f64]| -> Vec<f64> {
            let params = definition.params.iter().zip(theta);
            params.filter(|(p, _)| !p.fixed && p.per_run == per_run).map(|(_, v)| *v).collect()
        };
        values.extend(thetas.first().map_or(Vec::new(), |theta| chosen(false, theta)));
        thetas.iter().for_each(|theta| values.extend(chosen(true, theta)));
        // the parameters that runs share are read from the problem, not from a run
        for (param, value) in problem.params.iter_mut().zip(thetas.first().into_iter().flatten()) {
            param.value = if param.per_run { param.value } else { *value };
        }
        let mut equations = NormalEquations::new(&mut problem, deviations);
        let infinite = |e: NotFinite| NoInformation::NotFinite { run: runs[e.run].name.clone() };
        equations.evaluate(&values).map_err(infinite)?;
        let whole = DMatrix::from_row_slice(values.len(), values.len(), equations.information());
        Ok((Self { matrix: without(&whole, shared), ..Self::prior(model) }, responses))
    }

    /// The information of both together.
    pub fn plus(&self, other: &Self) -> Self {
        Self { names: self.names.clone(), matrix: &self.matrix + &other.matrix }
    }

    /// J'R^-1 J itself (P by P).
    pub fn matrix(&self) -> &DMatrix<f64> {
        &self.matrix
    }

    /// Names of the parameters.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The standard error of each parameter, were it estimated from this; none where it is not determined.
    pub fn errors(&self) -> Vec<Option<f64>> {
        let (scale, inverse, determined, _) = self.inverted();
        let mut errors = vec![None; self.names.len()];
        let n = inverse.chosen.len();
        for (k, j) in inverse.chosen.iter().enumerate().filter(|(k, _)| determined[*k]) {
            errors[*j] = Some(inverse.values[k * n + k].max(0.0).sqrt() / scale[*j]);
        }
        errors
    }

    /// The covariance of the parameters, were they estimated from this (P by P); none of those that are not determined.
    pub fn covariance(&self) -> Vec<Vec<Option<f64>>> {
        let (scale, inverse, determined, _) = self.inverted();
        let size = self.names.len();
        let known = |j: &usize| inverse.chosen.iter().position(|c| c == j).is_some_and(|k| determined[k]);
        let entry = |i: usize, j: usize| (known(&i) && known(&j)).then(|| inverse.covariance(&scale, (i, j)));
        (0..size).map(|i| (0..size).map(|j| entry(i, j)).collect()).collect()
    }

    /// Combinations that this does not determine, in words.
    pub fn undetermined(&self) -> Vec<Direction> {
        self.inverted().3
    }

    fn inverted(&self) -> (Vec<f64>, Inverse, Vec<bool>, Vec<Direction>) {
        let inside = vec![true; self.names.len()];
        let values: Vec<f64> = self.matrix.iter().copied().collect();
        let (scale, inverse) = Inverse::of_products(&values, &inside);
        let (determined, directions) =
            undetermined(&scale, &inside, &inverse, |j| self.names.get(j).cloned().unwrap_or_default());
        (scale, inverse, determined, directions)
    }

    /// Bits of information that this holds about parameters of which nothing but their size was known before (`sizes`, P): half the
    /// logarithm of the ratio by which their uncertain volume shrinks.
    pub fn bits(&self, sizes: &[f64]) -> f64 {
        let size = self.names.len();
        let scaled = DMatrix::from_fn(size, size, |i, j| {
            self.matrix[(i, j)] * sizes[i] * sizes[j] + if i == j { 1.0 } else { 0.0 }
        });
        let eigenvalues = scaled.symmetric_eigenvalues();
        0.5 * eigenvalues.iter().map(|v| v.max(1.0).log2()).sum::<f64>()
    }
}

/// A run ready to be differentiated, and its response (N by q).
fn simulated<'a>(model: &'a Model, run: &'a Run, theta: &[f64]) -> Result<(ProblemRun<'a>, Vec<f64>), NoInformation> {
    let name = || run.name.clone();
    let unsuited = |reason| NoInformation::Unsuited { run: name(), reason };
    let steps = choose_steps(model.dynamics(), run, theta, &StepOptions::default()).map_err(unsuited)?;
    if steps.error.is_finite() && steps.error > UNSOUND {
        return Err(NoInformation::Inaccurate { run: name(), error: steps.error });
    }
    let mut simulator = Simulator::new(model.dynamics(), run, steps.steps).map_err(unsuited)?;
    simulator.suits(theta).map_err(unsuited)?;
    let mut response = vec![0.0; run.measured.len()];
    let simulated = simulator.simulate(theta, &mut response);
    simulated.map_err(|d| NoInformation::RunsAway { run: name(), time: d.time })?;
    let (measured, start) = (run.measured.clone(), theta.to_vec());
    Ok((ProblemRun { name: name(), response: RunResponse::in_time(simulator), measured, start }, response))
}

/// What each sample of a run tells, before it is known which of them are taken.
#[derive(Debug, Clone)]
pub struct SampleInformation {
    nothing: Information,
    /// J'R^-1 J of every sample by the shared parameters, then those of the run (U by U).
    samples: Vec<DMatrix<f64>>,
    /// The response (N by q).
    pub response: Vec<f64>,
}

impl SampleInformation {
    /// Of a run with all its parameters (p), by white noise of these standard deviations (q).
    ///
    /// # Errors
    /// As [`Information::of`].
    pub fn of(model: &Model, run: &Run, theta: &[f64], deviations: &[f64]) -> Result<Self, NoInformation> {
        let (prepared, response) = simulated(model, run, theta)?;
        let mut problem = Problem::new(model.definition(), vec![prepared], DerivedQuantities::none());
        let unknowns = Unknowns::new(&problem);
        let width = unknowns.columns.len();
        let mut samples = vec![DMatrix::zeros(width, width); run.len()];
        let mut lane = DVector::zeros(width);
        let sensitivities = problem.runs[0].response.sensitivities(theta, &unknowns.columns, &mut |block| {
            for sample in 0..block.samples() {
                for (o, output) in block.layout.outputs.iter().enumerate() {
                    lane.fill(0.0);
                    for (column, slope) in output.columns.iter().zip(block.row(sample, o)) {
                        lane[unknowns.position(0, *column as usize)] = slope / deviations[o];
                    }
                    samples[block.first + sample].ger(1.0, &lane, &lane, 1.0);
                }
            }
        });
        sensitivities.map_err(|d| NoInformation::RunsAway { run: run.name.clone(), time: d.time })?;
        if samples.iter().any(|m| m.iter().any(|v| !v.is_finite())) {
            return Err(NoInformation::NotFinite { run: run.name.clone() });
        }
        let nothing = Information::prior(model);
        let size = nothing.names.len();
        Ok(Self { nothing: Information { matrix: DMatrix::zeros(size, size), ..nothing }, samples, response })
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// What the run tells where only these samples are taken.
    ///
    /// # Panics
    /// When there is no such sample.
    pub fn taken(&self, samples: &[usize]) -> Information {
        let shared = self.nothing.names.len();
        let width = self.samples.first().map_or(shared, DMatrix::nrows);
        let sum = samples.iter().fold(DMatrix::zeros(width, width), |sum, k| sum + &self.samples[*k]);
        Information { matrix: without(&sum, shared), ..self.nothing.clone() }
    }
}

/// The first `shared` unknowns when the others are free: A - B D^-1 B'. What moves nothing takes nothing.
fn without(whole: &DMatrix<f64>, shared: usize) -> DMatrix<f64> {
    let own = whole.nrows() - shared;
    let first = whole.view((0, 0), (shared, shared)).clone_owned();
    if own == 0 {
        return first;
    }
    let scale: Vec<f64> = (shared..whole.nrows()).map(|k| whole[(k, k)].max(0.0).sqrt()).collect();
    let inverse = |k: usize| if scale[k] > 0.0 { 1.0 / scale[k] } else { 0.0 };
    let scaled = DMatrix::from_fn(own, own, |i, j| whole[(shared + i, shared + j)] * inverse(i) * inverse(j));
    let beside = DMatrix::from_fn(shared, own, |i, j| whole[(i, shared + j)] * inverse(j));
    let eigen = scaled.symmetric_eigen();
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let along = beside * &eigen.eigenvectors;
    let taken = DMatrix::from_fn(shared, own, |i, k| {
        let value = eigen.eigenvalues[k];
        if value > RANK * largest { along[(i, k)] / value.sqrt() } else { 0.0 }
    });
    first - &taken * taken.transpose()
}

/// Which unknowns (n) are shared, and which belong to one run alone.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Blocks {
    shared: Vec<usize>,
    own: Vec<Vec<usize>>,
}

impl Blocks {
    /// Of runs with their unknowns, beside a matrix (n by n): where that couples the unknowns of different runs there is but one block.
    pub(super) fn new(runs: &[Vec<usize>], beside: &DMatrix<f64>) -> Self {
        let n = beside.nrows();
        let mut owner: Vec<Option<usize>> = vec![None; n];
        let mut uses = vec![0; n];
        for (r, places) in runs.iter().enumerate() {
            for place in places {
                uses[*place] += 1;
                owner[*place] = Some(r);
            }
        }
        // what no run has is shared, as far as anybody knows
        let owner: Vec<Option<usize>> = owner.into_iter().zip(uses).map(|(o, uses)| o.filter(|_| uses == 1)).collect();
        let apart = |i: usize, j: usize| matches!((owner[i], owner[j]), (Some(a), Some(b)) if a != b);
        if (0..n).any(|i| (0..i).any(|j| apart(i, j) && beside[(i, j)] != 0.0)) {
            return Self::one(n);
        }
        let of = |who: Option<usize>| (0..n).filter(|i| owner[*i] == who).collect();
        Self { shared: of(None), own: (0..runs.len()).map(|r| of(Some(r))).collect() }
    }

    /// All in one.
    pub(super) fn one(n: usize) -> Self {
        Self { shared: Vec::new(), own: vec![(0..n).collect()] }
    }

    /// Number of unknowns n.
    pub(super) fn len(&self) -> usize {
        self.shared.len() + self.own.iter().map(Vec::len).sum::<usize>()
    }

    /// A vector (n) by blocks.
    pub(super) fn parts(&self, vector: &DVector<f64>) -> Parts {
        let pick = |places: &Vec<usize>| DVector::from_iterator(places.len(), places.iter().map(|i| vector[*i]));
        Parts { shared: pick(&self.shared), own: self.own.iter().map(pick).collect() }
    }
}

/// A vector by blocks.
#[derive(Debug, Clone)]
pub(super) struct Parts {
    shared: DVector<f64>,
    own: Vec<DVector<f64>>,
}

impl Parts {
    /// Adds another over a divisor.
    pub(super) fn add_over(&mut self, divisor: f64, other: &Self) {
        for (to, from) in std::iter::once((&mut self.shared, &other.shared)).chain(self.own.iter_mut().zip(&other.own))
        {
            to.iter_mut().zip(from.iter()).for_each(|(to, from)| *to += from / divisor);
        }
    }

    /// The scalar product.
    pub(super) fn dot(&self, other: &Self) -> f64 {
        self.own.iter().zip(&other.own).map(|(a, b)| a.dot(b)).sum::<f64>() + self.shared.dot(&other.shared)
    }
}

/// A symmetric matrix by blocks.
#[derive(Debug, Clone)]
pub(super) struct Arrow {
    shared: DMatrix<f64>,
    /// Own by shared, for each run.
    coupling: Vec<DMatrix<f64>>,
    own: Vec<DMatrix<f64>>,
}

impl Arrow {
    /// The blocks of a matrix (n by n) that is zero elsewhere.
    pub(super) fn of(blocks: &Blocks, matrix: &DMatrix<f64>) -> Self {
        let pick = |rows: &[usize], columns: &[usize]| {
            DMatrix::from_fn(rows.len(), columns.len(), |i, j| matrix[(rows[i], columns[j])])
        };
        Self {
            shared: pick(&blocks.shared, &blocks.shared),
            coupling: blocks.own.iter().map(|own| pick(own, &blocks.shared)).collect(),
            own: blocks.own.iter().map(|own| pick(own, own)).collect(),
        }
    }

    fn blocks(&self) -> impl Iterator<Item = &DMatrix<f64>> {
        std::iter::once(&self.shared).chain(&self.coupling).chain(&self.own)
    }

    /// Adds another over a divisor.
    pub(super) fn add_over(&mut self, divisor: f64, other: &Self) {
        let blocks = std::iter::once(&mut self.shared).chain(&mut self.coupling).chain(&mut self.own);
        for (to, from) in blocks.zip(other.blocks()) {
            to.iter_mut().zip(from.iter()).for_each(|(to, from)| *to += from / divisor);
        }
    }

    /// Raises the diagonal by a part of its largest number.
    pub(super) fn raise(&mut self, part: f64) {
        let square = || std::iter::once(&self.shared).chain(&self.own);
        let largest = square().flat_map(|m| (0..m.nrows()).map(|i| m[(i, i)].abs())).fold(0.0, f64::max);
        for m in std::iter::once(&mut self.shared).chain(&mut self.own) {
            (0..m.nrows()).for_each(|i| m[(i, i)] += part * largest);
        }
    }

    /// `x' A x`.
    pub(super) fn square(&self, x: &Parts) -> f64 {
        let mut sum = x.shared.dot(&(&self.shared * &x.shared));
        for ((own, coupling), x_own) in self.own.iter().zip(&self.coupling).zip(&x.own) {
            sum += x_own.dot(&(own * x_own)) + 2.0 * x_own.dot(&(coupling * &x.shared));
        }
        sum
    }

    /// The sum of the products of all entries: the trace of the product.
    pub(super) fn dot(&self, other: &Self) -> f64 {
        let pairs = |a: &[DMatrix<f64>], b: &[DMatrix<f64>]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
        pairs(&self.own, &other.own) + self.shared.dot(&other.shared) + 2.0 * pairs(&self.coupling, &other.coupling)
    }

    /// Its factors; none where it is not positive definite.
    pub(super) fn factor(self) -> Option<Factors> {
        let own: Vec<Cholesky<f64, Dyn>> = self.own.into_iter().map(Cholesky::new).collect::<Option<_>>()?;
        let gains: Vec<DMatrix<f64>> = own.iter().zip(&self.coupling).map(|(own, c)| own.solve(c)).collect();
        let mut rest = self.shared;
        self.coupling.iter().zip(&gains).for_each(|(c, gain)| rest.gemm_tr(-1.0, c, gain, 1.0));
        Some(Factors { own, gains, rest: Cholesky::new(rest)? })
    }
}

/// Factors of a matrix by blocks.
pub(super) struct Factors {
    own: Vec<Cholesky<f64, Dyn>>,
    /// What the own unknowns follow the shared ones by (own by shared).
    gains: Vec<DMatrix<f64>>,
    /// Of what is left of the shared block.
    rest: Cholesky<f64, Dyn>,
}

impl Factors {
    /// Logarithm of the determinant.
    pub(super) fn logarithm(&self) -> f64 {
        let of = |c: &Cholesky<f64, Dyn>| c.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum::<f64>();
        self.own.iter().map(of).sum::<f64>() + of(&self.rest)
    }

    /// Solves for a vector.
    pub(super) fn solve(&self, vector: &Parts) -> Parts {
        let mut shared = vector.shared.clone();
        self.gains.iter().zip(&vector.own).for_each(|(gain, own)| shared.gemv_tr(-1.0, gain, own, 1.0));
        let shared = self.rest.solve(&shared);
        let mut own = Vec::with_capacity(self.own.len());
        for ((factor, gain), v) in self.own.iter().zip(&self.gains).zip(&vector.own) {
            let mut x = factor.solve(v);
            x.gemv(-1.0, gain, &shared, 1.0);
            own.push(x);
        }
        Parts { shared, own }
    }

    /// The blocks of the inverse.
    pub(super) fn inverse(&self) -> Arrow {
        let shared = self.rest.inverse();
        let coupling: Vec<DMatrix<f64>> = self.gains.iter().map(|gain| -(gain * &shared)).collect();
        let mut own = Vec::with_capacity(self.own.len());
        for ((factor, gain), coupling) in self.own.iter().zip(&self.gains).zip(&coupling) {
            own.push(factor.inverse() - coupling * gain.transpose());
        }
        Arrow { shared, coupling, own }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::work::Work;
    use crate::{FitOptions, Noise, Options, fit};

    const TEXT: &str =
        "model m { input u, v; state x = free; param k = 2 in [0, 50] [1/s], g = 3, h = 1; param b = 0.1 per run;
        der(x) = -k*x + g*u + h*v; output y = x + b; output z = 2*x; }";

    fn run(name: &str, v: f64) -> Run {
        let n = 60;
        let inputs = |k: usize| [f64::from(u8::from(k % 20 < 10)), v * f64::from(u8::from(k % 14 < 7))];
        Run {
            name: name.into(),
            time: (0..n).map(|k| 0.05 * k as f64).collect(),
            inputs: (0..n).flat_map(inputs).collect(),
            held: vec![true; 2],
            measured: vec![0.0; 2 * n],
            input_gaps: vec![0; 2],
            stated: Vec::new(),
            output_gaps: vec![0; 2],
        }
    }

    #[test]
    fn errors_are_those_of_a_fit_by_the_same_noise() {
        let model = Model::from_text("m.fdm", TEXT).unwrap();
        let mut runs = [run("a", 1.0), run("b", -2.0)];
        let theta = model.definition().start();
        let thetas = vec![theta.clone(), theta];
        let (told, responses) = Information::of(&model, &runs, &thetas, &[0.1, 0.2]).unwrap();
        runs.iter_mut().zip(responses).for_each(|(run, response)| run.measured = response);
        let options = Options { noise: Noise::Given(vec![Some(0.1), Some(0.2)]), ..Options::default() };
        let fitted = fit(&model, &runs, &FitOptions { options, ..FitOptions::default() }, &Work::default()).unwrap();
        for (name, error) in told.names().iter().zip(told.errors()) {
            let other = fitted.estimate.parameter(name, None).unwrap().standard_error.unwrap();
            let own = error.unwrap();
            assert!((own / other - 1.0).abs() < 1e-6, "{name}: {own} and {other}");
        }
        assert!(told.undetermined().is_empty());
    }

    #[test]
    fn samples_together_tell_what_the_run_does() {
        let model = Model::from_text("m.fdm", TEXT).unwrap();
        let (run, theta) = (run("a", 1.0), model.definition().start());
        let whole =
            Information::of(&model, std::slice::from_ref(&run), std::slice::from_ref(&theta), &[0.1, 0.2]).unwrap().0;
        let samples = SampleInformation::of(&model, &run, &theta, &[0.1, 0.2]).unwrap();
        let all = samples.taken(&(0..samples.len()).collect::<Vec<_>>());
        assert!((all.matrix() - whole.matrix()).norm() < 1e-9 * whole.matrix().norm());
        for (row, error) in all.covariance().iter().enumerate().map(|(k, row)| (row[k], all.errors()[k])) {
            assert!((row.unwrap().sqrt() / error.unwrap() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn what_an_unmoved_input_does_is_not_determined_until_it_moves() {
        let model = Model::from_text("m.fdm", TEXT).unwrap();
        let theta = vec![model.definition().start()];
        let of = |v: f64| Information::of(&model, &[run("a", v)], &theta, &[0.1, 0.1]).unwrap().0;
        let still = of(0.0);
        let errors = still.errors();
        assert!(errors[0].is_some() && errors[1].is_some() && errors[2].is_none(), "{errors:?}");
        assert!(still.undetermined()[0].sentence.contains("`h`"), "{:?}", still.undetermined());
        let both = still.plus(&of(1.0));
        assert!(both.errors()[2].is_some());
        assert!(both.bits(&[1.0; 3]) > still.bits(&[1.0; 3]) + 1.0);
    }
}
