//! Intervals of requirements, and the probability that they hold.
//!
//! What a result knows of the parameters on which requirements depend, and the requirements of many results of one model.

use super::bench::{Bench, Plan};
use super::measured::{Measured, RequirementError};
use fdm_estimate::{ParameterEstimate, quantile};
use fdm_grammar::model::{Origin, Param};
use fdm_grammar::requirement::Requirement;
use fdm_numeric::elementary::exp;
use fdm_numeric::random::Stream;
use fdm_numeric::statistics::{Student, chi_squared_quantile, normal_cdf};
use fdm_results::documents::ResultDocument;
use fdm_results::documents::requirement::{Assessment, By, Part};
use fdm_results::documents::study::{Goal, Judged};
use fdm_system::Model;
use nalgebra::DMatrix;
use rayon::prelude::*;

/// What is known of the parameters.
#[derive(Debug, Clone, Copy)]
pub struct Known<'a> {
    /// Their values (p).
    pub theta: &'a [f64],
    /// Their covariance (p by p), zero for what was not estimated.
    pub covariance: &'a [f64],
    /// Degrees of freedom of each variance (p), where they are known.
    pub freedom: &'a [Option<f64>],
}

/// How many draws are made, and from which stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Draws {
    /// How many; none are made of 0.
    pub count: usize,
    /// Seed of the stream.
    pub seed: u64,
}

/// A linear law is believed as long as neither end of the interval of the draws is further from that of the linear law than this part of its half width.
const BENT: f64 = 0.15;
/// So many draws are made first. Where a requirement is linear by half of [`BENT`] at these, no more are needed.
const FIRST: usize = 250;
/// Draws are cut where more than this part of them was drawn again because of bounds: then the linear law, which knows no bounds, is another one.
const CUT: f64 = 0.01;

/// Assesses the requirements of a model; empty where it has none.
///
/// # Errors
/// [`RequirementError`].
pub fn assess(model: &Model, known: Known<'_>, draws: Draws) -> Result<Vec<Assessment>, RequirementError> {
    match Plan::new(model, known.theta, &columns(model, known))? {
        Some(plan) => assess_by(&plan, model, known, draws),
        None => Ok(Vec::new()),
    }
}

/// Parameters that are not known exactly, by index.
pub(super) fn columns(model: &Model, known: Known<'_>) -> Vec<usize> {
    let (p, params) = (known.theta.len(), &model.definition().params);
    (0..p).filter(|k| !params[*k].fixed && known.covariance[k * p + k] > 0.0).collect()
}

/// Assesses requirements with a plan of this model, made for the same columns.
///
/// # Errors
/// [`RequirementError`].
pub(super) fn assess_by(
    plan: &Plan,
    model: &Model,
    known: Known<'_>,
    draws: Draws,
) -> Result<Vec<Assessment>, RequirementError> {
    let (columns, params) = (plan.columns(), &model.definition().params);
    let at = plan.bench()?.measure(known.theta, true);
    let (points, cut) = points(columns, params, known, draws);
    let first = points.len().min(FIRST);
    let every = vec![true; at.len()];
    let mut values = measured(plan, &points[..first], &every)?;
    let straight = |values: &[f64], m: &Measured| {
        values.is_empty()
            || !cut && m.is_linear() && values.iter().all(|v| v.is_finite()) && bend(values, m, &points) < 0.5 * BENT
    };
    let open: Vec<bool> = at.iter().zip(&values).map(|(m, values)| !straight(values, m)).collect();
    if points.len() > first && open.contains(&true) {
        let more = measured(plan, &points[first..], &open)?;
        values.iter_mut().zip(more).for_each(|(values, more)| values.extend(more));
    }
    let one = |(k, m): (usize, &Measured)| {
        let drawn = Drawn { points: &points, values: &values[k], cut };
        assessment(&plan.requirements().list[k], m, (columns, params), known, &drawn)
    };
    Ok(at.iter().enumerate().map(one).collect())
}

/// A draw of the parameters.
struct Point {
    /// All of them (p).
    theta: Vec<f64>,
    /// How far the linear law has moved each column: without logarithms.
    moved: Vec<f64>,
}

/// A requirement at the draws; at the first of them only, where these were enough.
struct Drawn<'a> {
    points: &'a [Point],
    values: &'a [f64],
    cut: bool,
}

/// How far the ends of 95 % of the draws are from those of the linear law at the same draws, as a part of the latter's half width. Chance moves both
/// alike, so that few draws tell.
fn bend(values: &[f64], measured: &Measured, points: &[Point]) -> f64 {
    let by_slope = |p: &Point| measured.value + p.moved.iter().zip(&measured.gradient).map(|(m, g)| m * g).sum::<f64>();
    let mut linear: Vec<f64> = points.iter().take(values.len()).map(by_slope).collect();
    let mut values = values.to_vec();
    [&mut linear, &mut values].into_iter().for_each(|v| v.sort_by(f64::total_cmp));
    let [a, b] = [&values, &linear].map(|v| SHARES.map(|share| at_share(v, share)));
    let off = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
    // what no parameter moves is straight
    if off == 0.0 { 0.0 } else { off / (0.5 * (b[1] - b[0])) }
}

/// The ends of 95 %.
const SHARES: [f64; 2] = [0.025, 0.975];

fn assessment(
    requirement: &Requirement,
    measured: &Measured,
    (columns, params): (&[usize], &[Param]),
    known: Known<'_>,
    drawn: &Drawn<'_>,
) -> Assessment {
    let p = known.theta.len();
    let quantity = &requirement.quantity;
    let finite = |v: f64| v.is_finite().then_some(v);
    let mut assessment = Assessment {
        name: quantity.name.clone(),
        doc: quantity.doc.clone(),
        unit: quantity.unit.as_ref().map(ToString::to_string),
        expression: requirement.text.clone(),
        lower: finite(requirement.lower),
        upper: finite(requirement.upper),
        value: finite(measured.value),
        ..Assessment::default()
    };
    assessment.reason = measured.missing.clone();
    let g = &measured.gradient;
    let c = |i: usize, j: usize| known.covariance[columns[i] * p + columns[j]];
    let follows: Vec<f64> = (0..g.len()).map(|i| (0..g.len()).map(|j| c(i, j) * g[j]).sum()).collect();
    let variance: f64 = g.iter().zip(&follows).map(|(g, f)| g * f).sum();
    let linear = measured.is_linear();
    let moving = || columns.iter().zip(g).filter(|(_, g)| **g != 0.0).filter_map(|(k, _)| known.freedom[*k]);
    let freedom = moving().reduce(f64::min);
    if linear {
        let error = variance.max(0.0).sqrt();
        let half = error * quantile(freedom);
        assessment.error = Some(error);
        assessment.freedom = freedom;
        assessment.interval = Some([measured.value - half, measured.value + half]);
        let holds = probability(requirement, measured.value, error, freedom);
        assessment.probability = requirement.has_limits().then_some(holds);
        assessment.by = Some(By::Linear);
        let mut parts: Vec<Part> = (0..g.len())
            .map(|i| Part { parameter: params[columns[i]].quantity.name.clone(), share: g[i] * follows[i] / variance })
            .filter(|part| part.share.is_finite() && part.share.abs() > 0.01)
            .collect();
        parts.sort_by(|a, b| b.share.abs().total_cmp(&a.share.abs()));
        // parameters that are named as those on which a requirement depends most
        parts.truncate(3);
        assessment.parts = parts;
    }
    if drawn.values.is_empty() {
        return assessment;
    }
    let mut there: Vec<f64> = drawn.values.iter().copied().filter(|v| v.is_finite()).collect();
    there.sort_by(f64::total_cmp);
    let missing = 1.0 - there.len() as f64 / drawn.values.len() as f64;
    assessment.missing = (missing > 0.0).then_some(missing);
    if there.len() < drawn.values.len() / 2 || there.len() < 40 {
        return assessment;
    }
    let ends = SHARES.map(|share| at_share(&there, share));
    let far = |[low, high]: [f64; 2]| {
        let half = 0.5 * (high - low);
        (ends[0] - low).abs().max((ends[1] - high).abs()) > BENT * half
    };
    let other = |interval| bend(drawn.values, measured, drawn.points) > BENT || drawn.cut && far(interval);
    if missing > 0.0 || assessment.interval.is_none_or(other) {
        let holds = drawn.values.iter().filter(|v| requirement.holds(**v)).count();
        assessment.interval = Some(ends);
        let share = holds as f64 / drawn.values.len() as f64;
        assessment.probability = requirement.has_limits().then_some(share);
        assessment.by = Some(By::Draws);
    }
    assessment
}

/// The value below which a share of sorted values lies, between neighbours in proportion.
fn at_share(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len() - 1) as f64;
    let (k, rest) = (place.floor() as usize, place.fract());
    let next = sorted.get(k + 1).copied().unwrap_or(sorted[k]);
    sorted[k] + rest * (next - sorted[k])
}

/// That a value lies between the limits, by Student's law or the normal one.
fn probability(requirement: &Requirement, value: f64, error: f64, freedom: Option<f64>) -> f64 {
    if error == 0.0 {
        return if requirement.holds(value) { 1.0 } else { 0.0 };
    }
    let law = freedom.and_then(|f| Student::new(f.max(1.0)));
    let below = |limit: f64| {
        let z = (limit - value) / error;
        match (z, &law) {
            (z, _) if z == f64::INFINITY => 1.0,
            (z, _) if z == f64::NEG_INFINITY => 0.0,
            (z, Some(law)) => law.cdf(z),
            (z, None) => normal_cdf(z),
        }
    };
    (below(requirement.upper) - below(requirement.lower)).clamp(0.0, 1.0)
}

/// Draws of the parameters: normal ones, wider where the errors are not well known, within bounds, of a logarithm where that was searched; and whether
/// bounds have cut many of them. Empty where none are wanted or nothing varies.
fn points(columns: &[usize], params: &[Param], known: Known<'_>, draws: Draws) -> (Vec<Point>, bool) {
    let Some(root) = root(columns, known).filter(|_| draws.count > 0) else { return (Vec::new(), false) };
    let freedom = columns.iter().filter_map(|k| known.freedom[*k]).reduce(f64::min);
    let mut stream = Stream::named(draws.seed, &["requirements"]);
    let mut again = 0;
    let mut points = Vec::with_capacity(draws.count);
    for _ in 0..draws.count {
        let (point, attempts) = point(columns, params, known, &root, freedom, &mut stream);
        again += usize::from(attempts > 1);
        points.push(point);
    }
    (points, again as f64 > CUT * draws.count as f64)
}

/// The requirements that are wanted at every draw, requirement by requirement; of the others there are no values.
fn measured(plan: &Plan, points: &[Point], wanted: &[bool]) -> Result<Vec<Vec<f64>>, RequirementError> {
    let measured: Result<Vec<Vec<Vec<f64>>>, RequirementError> = points
        .par_chunks(32)
        .map(|part| {
            let mut bench: Bench<'_> = plan.bench()?;
            let values = |p: &Point| bench.measure_some(&p.theta, wanted).iter().map(|m| m.value).collect();
            Ok(part.iter().map(values).collect())
        })
        .collect();
    let draws: Vec<Vec<f64>> = measured?.into_iter().flatten().collect();
    let of = |k: usize| draws.iter().map(|draw| draw[k]).collect();
    Ok((0..wanted.len()).map(|k| if wanted[k] { of(k) } else { Vec::new() }).collect())
}

/// The symmetric root of the covariance of the columns; none where nothing varies.
fn root(columns: &[usize], known: Known<'_>) -> Option<DMatrix<f64>> {
    let p = known.theta.len();
    let scale: Vec<f64> = columns.iter().map(|k| known.covariance[k * p + k].sqrt()).collect();
    let n = columns.len();
    if n == 0 {
        return None;
    }
    let correlation =
        DMatrix::from_fn(n, n, |i, j| known.covariance[columns[i] * p + columns[j]] / (scale[i] * scale[j]));
    let eigen = correlation.symmetric_eigen();
    let half =
        DMatrix::from_fn(n, n, |i, j| scale[i] * eigen.eigenvectors[(i, j)] * eigen.eigenvalues[j].max(0.0).sqrt());
    Some(half)
}

fn point(
    columns: &[usize],
    params: &[Param],
    known: Known<'_>,
    root: &DMatrix<f64>,
    freedom: Option<f64>,
    stream: &mut Stream,
) -> (Point, usize) {
    /// Draws until one lies within all bounds.
    const MOST: usize = 100;
    let (mut theta, mut moved) = (known.theta.to_vec(), vec![0.0; columns.len()]);
    let mut attempts = 0;
    loop {
        attempts += 1;
        let z: Vec<f64> = columns.iter().map(|_| stream.normal()).collect();
        let wider = freedom.map_or(1.0, |f| {
            let share = stream.uniform().clamp(1e-12, 1.0 - 1e-12);
            chi_squared_quantile(share, f).map_or(1.0, |q| (f / q).sqrt())
        });
        let mut inside = true;
        for (i, k) in columns.iter().enumerate() {
            moved[i] = wider * z.iter().enumerate().map(|(j, z)| root[(i, j)] * z).sum::<f64>();
            let (value, param) = (known.theta[*k], &params[*k]);
            let drawn = if param.logarithmic && value > 0.0 { value * exp(moved[i] / value) } else { value + moved[i] };
            inside &= drawn >= param.lower && drawn <= param.upper;
            // the last one is put on its bounds
            theta[*k] = if attempts == MOST { drawn.clamp(param.lower, param.upper) } else { drawn };
        }
        if inside || attempts == MOST {
            return (Point { theta, moved }, attempts);
        }
    }
}

/// The model with values as they were found: theta (p), covariance (p by p).
pub fn with_estimates(model: &Model, theta: &[f64], covariance: Option<&[f64]>) -> Model {
    let mut params = model.definition().params.clone();
    for (k, param) in params.iter_mut().enumerate() {
        param.value = theta[k];
        // what the fit estimated has derivatives, whatever the model's text says of it
        param.fixed &= covariance.is_none_or(|c| c[k * theta.len() + k] == 0.0);
    }
    model.with_params(params)
}

/// Degrees of freedom of each parameter's error (p), where they are known.
pub fn freedom(result: &ResultDocument, model: &Model, run: &str) -> Vec<Option<f64>> {
    let found: &[ParameterEstimate] = result.fit().map_or(&[], |fit| &fit.parameters);
    let own = |p: &ParameterEstimate| p.run.as_deref().is_none_or(|r| r == run);
    let params = model.definition().params.iter();
    params
        .map(|p| {
            let found = found.iter().find(|e| e.name == p.quantity.name && own(e))?;
            found.degrees_of_freedom.filter(|_| found.corrected_error.is_some())
        })
        .collect()
}

/// Parameters as a result has them in one run, with what is known of their errors.
struct Found {
    theta: Vec<f64>,
    covariance: Vec<f64>,
    freedom: Vec<Option<f64>>,
}

impl Found {
    /// None where nothing is known of the errors.
    fn of(model: &Model, result: &ResultDocument, run: &str) -> Option<Self> {
        let covariance = result.covariance(model, run).filter(|c| c.iter().any(|v| *v != 0.0))?;
        let mut theta = result.theta(model, run);
        let params = &model.definition().params;
        theta.iter_mut().zip(params).filter(|(_, p)| p.is_recorded()).for_each(|(v, _)| *v = 0.0);
        Some(Self { freedom: freedom(result, model, run), theta, covariance })
    }

    fn known(&self) -> Known<'_> {
        Known { theta: &self.theta, covariance: &self.covariance, freedom: &self.freedom }
    }
}

/// Whether the requirements of a model can be measured of a result of so many runs without asking for more.
fn decided(model: &Model, runs: usize) -> Result<(), RequirementError> {
    let definition = model.definition();
    let own = definition.params.iter().any(|p| p.per_run && !matches!(p.origin, Origin::FreeInitial(_)));
    if runs > 1 && own {
        return Err(RequirementError::Runs);
    }
    let brought = definition.inputs.iter().find(|i| i.known);
    brought.map_or(Ok(()), |i| Err(RequirementError::Known { name: i.quantity.name.clone() }))
}

/// The requirements of a fit as part of its result: none where the text has none, where values of single runs must be chosen, or where they cannot be
/// measured; `fdm margins` says why.
pub fn assess_result(model: &Model, result: &ResultDocument, runs: &[String], draws: Draws) -> Option<Vec<Assessment>> {
    let run = runs.first().filter(|_| model.definition().requirements.is_some())?;
    decided(model, runs.len()).ok()?;
    let found = Found::of(model, result, run)?;
    let model = with_estimates(model, &found.theta, Some(&found.covariance));
    assess(&model, found.known(), draws).ok()
}

/// Assesses the requirements of many results of one model, as a study makes them. Manoeuvres are prepared once, with the steps of the first result.
pub struct Judge {
    model: Model,
    plan: Plan,
    run: String,
    draws: Draws,
    goals: Vec<Goal>,
}

impl Judge {
    /// Of the result that is repeated: its values are the truth. None where the text has no requirements.
    ///
    /// # Errors
    /// [`RequirementError`], where they cannot be measured.
    pub fn new(
        model: &Model,
        result: &ResultDocument,
        runs: &[String],
        draws: Draws,
    ) -> Result<Option<Self>, RequirementError> {
        if model.definition().requirements.is_none() {
            return Ok(None);
        }
        decided(model, runs.len())?;
        let run = runs.first().cloned().unwrap_or_default();
        let found = Found::of(model, result, &run).ok_or(RequirementError::NoCovariance)?;
        let model = with_estimates(model, &found.theta, Some(&found.covariance));
        let plan = Plan::new(&model, &found.theta, &columns(&model, found.known()))?;
        let Some(plan) = plan else { return Ok(None) };
        let truth = plan.bench()?.measure(&found.theta, false);
        let goal = |(r, m): (&Requirement, &Measured)| Goal {
            name: r.quantity.name.clone(),
            unit: r.quantity.unit.as_ref().map(ToString::to_string),
            truth: Some(m.value).filter(|v| v.is_finite()),
        };
        let goals = plan.requirements().list.iter().zip(&truth).map(goal).collect();
        Ok(Some(Self { model, plan, run, draws, goals }))
    }

    /// The requirements, with their values at the parameters that records are made with.
    pub fn goals(&self) -> &[Goal] {
        &self.goals
    }

    /// What a repeat says of each; nothing where it knows no errors.
    pub fn judged(&self, result: &ResultDocument) -> Vec<Judged> {
        let none = || vec![Judged::NONE; self.goals.len()];
        let Some(found) = Found::of(&self.model, result, &self.run) else { return none() };
        let model = with_estimates(&self.model, &found.theta, Some(&found.covariance));
        let (known, own) = (found.known(), columns(&model, found.known()));
        let assessed = match own == self.plan.columns() {
            true => assess_by(&self.plan, &model, known, self.draws),
            // a parameter at its bound is known exactly here and was not there, or the other way round
            false => assess(&model, known, self.draws),
        };
        assessed.map_or_else(|_| none(), |list| list.iter().map(Judged::of).collect())
    }
}
