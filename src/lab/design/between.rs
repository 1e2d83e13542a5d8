//! The manoeuvre that separates two models: where their responses differ most once the wrong one has adapted its parameters.
//!
//! Each is fitted, linearly about its values, to what the other would make of the manoeuvre, with the information of the runs so far in
//! front (Atkinson and Fedorov 1975; Box and Hill 1967). Half of the squared distance that is left, in units of the noise, is the
//! logarithm of the odds that the manoeuvre is expected to give for the true one.

use super::plan::{Asked, Question};
use super::plan::{Kept, run, survey, within_limits};
use super::plan::{STOPPED, excursions, known};
use fdm_estimate::{Changes, FitOptions, Halt, ResidualVector, changed};
use fdm_numeric::parallel;
use fdm_results::documents::design::{Distinction, Manoeuvre, Separation};
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, StepOptions, choose_steps};
use nalgebra::{DMatrix, DVector};

/// Two models and what is asked of the next run: inputs, lengths and limits are those of the first question.
#[derive(Debug, Clone)]
pub struct Rivals<'a> {
    /// The first model.
    pub first: Question<'a>,
    /// The second: its own parameters, and the runs so far with them.
    pub second: Question<'a>,
}

/// What a manoeuvre leaves of the distance when a model follows the other, its own values of the run eliminated.
#[derive(Debug, Clone)]
struct Distance {
    squared: f64,
    gradient: DVector<f64>,
    information: DMatrix<f64>,
}

/// The distances if the first, and if the second model is true.
type Told = Kept<[Distance; 2]>;

/// The best manoeuvres one after the other, and all of them.
///
/// # Errors
/// Everything that makes it impossible, one sentence each.
pub fn between(rivals: &Rivals<'_>, halt: &Halt) -> Result<Distinction, Vec<String>> {
    let question = &rivals.first;
    let mut wrong: Vec<String> = Vec::new();
    for one in [question, &rivals.second] {
        wrong.extend(
            one.examine()
                .err()
                .into_iter()
                .flatten()
                .filter(|a| !matches!(a, Asked::NothingFree { .. }))
                .map(|a| a.to_string()),
        );
    }
    wrong.extend(alike(question.model, rivals.second.model));
    wrong.dedup();
    if !wrong.is_empty() {
        return Err(wrong);
    }
    let before = |q: &Question<'_>| known(q).map(|i| i.matrix().clone()).map_err(|e| vec![e.to_string()]);
    // who follows, by who is true
    let before = [before(&rivals.second)?, before(question)?];
    let one = |m: &Manoeuvre| match halt.goes_on() {
        true => within_limits(question, m, |m| tell(rivals, m)),
        false => Err(STOPPED.into()),
    };
    let manoeuvres = survey(question);
    let answers: Vec<_> = parallel::map(manoeuvres.iter(), one);
    let (mut told, mut lost) = (Vec::new(), Vec::new());
    for (manoeuvre, answer) in manoeuvres.into_iter().zip(answers) {
        match answer {
            Ok(kept) => told.push(kept),
            Err(reason) => lost.push((manoeuvre, reason)),
        }
    }
    let separation = |t: &Told, sum: &[Distance; 2]| {
        let odds = [0, 1].map(|k| sum[k].plus(&t.told[k]).log_odds(&before[k]));
        Separation { manoeuvre: t.manoeuvre.clone(), log_odds: odds, excursions: t.excursions.clone() }
    };
    let nothing = [0, 1].map(|k| Distance::none(before[k].nrows()));
    let mut separations: Vec<Separation> = parallel::map(told.iter(), |t| separation(t, &nothing));
    let (mut steps, mut sum) = (Vec::new(), nothing);
    for _ in 0..question.runs {
        let with: Vec<Separation> = parallel::map(told.iter(), |t| separation(t, &sum));
        let best = (0..told.len()).rev().max_by(|a, b| with[*a].mean().total_cmp(&with[*b].mean()));
        let Some(best) = best else { break };
        sum = [0, 1].map(|k| sum[k].plus(&told[best].told[k]));
        steps.push(with[best].clone());
    }
    // equal ones stay in the order of the survey
    separations.sort_by(|a, b| b.mean().total_cmp(&a.mean()));
    let models = [question, &rivals.second].map(|q| q.model.definition().name.clone());
    Ok(Distinction { models, steps, separations, lost })
}

/// Inputs and outputs that only one of them has, or in another unit.
fn alike(first: &Model, second: &Model) -> Vec<String> {
    let named = |m: &Model| {
        let d = m.definition();
        let unit = |q: &fdm_grammar::model::Quantity| q.unit.as_ref().map_or(String::new(), |u| format!(" [{u}]"));
        let inputs = d.inputs.iter().map(|i| format!("input {}{}", i.quantity.name, unit(&i.quantity)));
        let outputs = d.outputs.iter().map(|o| format!("output {}{}", o.quantity.name, unit(&o.quantity)));
        inputs.chain(outputs).collect::<Vec<String>>()
    };
    let (a, b) = (named(first), named(second));
    if a == b {
        return Vec::new();
    }
    vec![format!(
        "models can be told apart by what both show: `{}` has {}; `{}` has {}",
        first.definition().name,
        a.join(", "),
        second.definition().name,
        b.join(", ")
    )]
}

/// The distances of a manoeuvre, and how far the outputs move at most by either model.
fn tell(rivals: &Rivals<'_>, manoeuvre: &Manoeuvre) -> Result<([Distance; 2], Vec<f64>), String> {
    let run = run(&rivals.first, manoeuvre).ok_or("it cannot be sampled")?;
    let both = [&rivals.first, &rivals.second];
    let responses = [response(both[0], &run)?, response(both[1], &run)?];
    let q = both[0].deviations.len();
    let moved = responses.each_ref().map(|r| excursions(r, q));
    let excursions = moved[0].iter().zip(&moved[1]).map(|(a, b)| a.max(*b)).collect();
    let [of_first, of_second] = responses;
    let followed = [distance(both[1], &run, of_first)?, distance(both[0], &run, of_second)?];
    Ok((followed, excursions))
}

/// What the model makes of the inputs (N by q).
fn response(question: &Question<'_>, run: &Run) -> Result<Vec<f64>, String> {
    let dynamics = question.model.dynamics();
    let chosen = choose_steps(dynamics, run, &question.theta, &StepOptions::default()).map_err(|e| e.to_string())?;
    let mut simulator = Simulator::new(dynamics, run, chosen.steps).map_err(|e| e.to_string())?;
    let mut response = vec![0.0; run.measured.len()];
    simulator
        .simulate(&question.theta, &mut response)
        .map_err(|d| format!("its response is not finite from {} on", d.time))?;
    Ok(response)
}

/// What is left of the other's response when this model follows it.
fn distance(question: &Question<'_>, run: &Run, other: Vec<f64>) -> Result<Distance, String> {
    let definition = question.model.definition();
    let mut params = definition.params.clone();
    params.iter_mut().zip(&question.theta).for_each(|(p, value)| p.value = *value);
    let model = changed(&question.model.with_params(params), &Changes::default()).map_err(|e| e.to_string())?;
    let runs = [Run { measured: other, ..run.clone() }];
    let mut vector =
        ResidualVector::new(&model, &runs, &question.deviations, &FitOptions::default()).map_err(|e| e.to_string())?;
    let start = vector.start().to_vec();
    let (rows, unknowns) = (vector.len(), start.len());
    let (mut residuals, mut jacobian) = (vec![0.0; rows], vec![0.0; rows * unknowns]);
    vector
        .jacobian(&start, &mut residuals, &mut jacobian)
        .map_err(|d| format!("its response is not finite from {} on", d.time))?;
    let own = definition.params.iter().filter(|p| !p.fixed && p.per_run).count();
    let shared = unknowns - own;
    let j = DMatrix::from_row_slice(rows, unknowns, &jacobian);
    // residuals are measured minus simulated, and j their derivatives
    let r = DVector::from_vec(residuals);
    let (gram, gradient) = (j.tr_mul(&j), j.tr_mul(&r));
    let whole = Distance { squared: r.norm_squared(), gradient, information: gram };
    Ok(whole.without(shared))
}

/// Eigenvalues below this part of the largest count as zero.
const RANK: f64 = 1e-12;

/// Solves a symmetric system in the space that it determines.
fn solved(matrix: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    // scaled: parameters have units
    let scale: Vec<f64> = matrix.diagonal().iter().map(|d| if *d > 0.0 { d.sqrt().recip() } else { 0.0 }).collect();
    let scaled = DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, k| scale[i] * matrix[(i, k)] * scale[k]);
    let eigen = scaled.symmetric_eigen();
    let largest = eigen.eigenvalues.iter().fold(0.0_f64, |a, b| a.max(*b));
    let turned =
        eigen.eigenvectors.tr_mul(&DMatrix::from_fn(right.nrows(), right.ncols(), |i, k| scale[i] * right[(i, k)]));
    let divided = DMatrix::from_fn(turned.nrows(), turned.ncols(), |i, k| match eigen.eigenvalues[i] {
        v if v > RANK * largest => turned[(i, k)] / v,
        _ => 0.0,
    });
    let found = &eigen.eigenvectors * divided;
    DMatrix::from_fn(found.nrows(), found.ncols(), |i, k| scale[i] * found[(i, k)])
}

impl Distance {
    fn none(shared: usize) -> Self {
        Self { squared: 0.0, gradient: DVector::zeros(shared), information: DMatrix::zeros(shared, shared) }
    }

    /// Eliminates what stands behind the first `shared` unknowns: values of this run alone.
    fn without(self, shared: usize) -> Self {
        let own = self.information.nrows() - shared;
        if own == 0 {
            return self;
        }
        let corner = self.information.view((shared, shared), (own, own)).into_owned();
        let cross = self.information.view((0, shared), (shared, own)).into_owned();
        let tail = DMatrix::from_column_slice(own, 1, self.gradient.rows(shared, own).as_slice());
        let (by_tail, by_cross) = (solved(&corner, &tail), solved(&corner, &cross.transpose()));
        Self {
            squared: self.squared - tail.dot(&by_tail),
            gradient: self.gradient.rows(0, shared) - (&cross * &by_tail).column(0),
            information: self.information.view((0, 0), (shared, shared)) - &cross * by_cross,
        }
    }

    fn plus(&self, other: &Self) -> Self {
        Self {
            squared: self.squared + other.squared,
            gradient: &self.gradient + &other.gradient,
            information: &self.information + &other.information,
        }
    }

    /// Half of the squared distance that is left, where `before` is what runs so far say of the parameters.
    fn log_odds(&self, before: &DMatrix<f64>) -> f64 {
        let right = DMatrix::from_column_slice(self.gradient.len(), 1, self.gradient.as_slice());
        let followed = solved(&(&self.information + before), &right).dot(&right);
        (0.5 * (self.squared - followed)).max(0.0)
    }
}
