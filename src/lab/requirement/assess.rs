//! Intervals of requirements, and the probability that they hold.

use super::bench::{Bench, Plan};
use super::measured::{Measured, RequirementError};
use fdm_estimate::quantile;
use fdm_grammar::model::Param;
use fdm_grammar::requirement::Requirement;
use fdm_numeric::elementary::exp;
use fdm_numeric::random::Stream;
use fdm_numeric::statistics::{Student, chi_squared_quantile, normal_cdf};
use fdm_results::documents::requirement::{Assessment, By, Part};
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

/// Parameters that are named as those on which a requirement depends most.
const NAMED: usize = 3;
/// A linear law is believed as long as neither end of the interval of the draws is further from its own than this part of its half width. Of a
/// thousand draws chance moves an end by 0.04 of it.
const BENT: f64 = 0.15;

/// Assesses the requirements of a model; empty where it has none.
///
/// # Errors
/// [`RequirementError`].
pub fn assess(model: &Model, known: Known<'_>, draws: Draws) -> Result<Vec<Assessment>, RequirementError> {
    let p = known.theta.len();
    let params = &model.definition().params;
    let moves = |k: &usize| !params[*k].fixed && known.covariance[k * p + k] > 0.0;
    let columns: Vec<usize> = (0..p).filter(moves).collect();
    let Some(plan) = Plan::new(model, known.theta, &columns)? else { return Ok(Vec::new()) };
    let at = plan.bench()?.measure(known.theta, true);
    let drawn = drawn(&plan, params, known, draws)?;
    let one = |(k, measured): (usize, &Measured)| {
        let values: Vec<f64> = drawn.iter().map(|draw| draw[k]).collect();
        assessment(&plan.requirements().list[k], measured, (&columns, params), known, &values)
    };
    Ok(at.iter().enumerate().map(one).collect())
}

fn assessment(
    requirement: &Requirement,
    measured: &Measured,
    (columns, params): (&[usize], &[Param]),
    known: Known<'_>,
    drawn: &[f64],
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
    let linear = assessment.value.is_some() && g.iter().all(|g| g.is_finite());
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
        parts.truncate(NAMED);
        assessment.parts = parts;
    }
    if drawn.is_empty() {
        return assessment;
    }
    let mut there: Vec<f64> = drawn.iter().copied().filter(|v| v.is_finite()).collect();
    there.sort_by(f64::total_cmp);
    let missing = 1.0 - there.len() as f64 / drawn.len() as f64;
    assessment.missing = (missing > 0.0).then_some(missing);
    if there.len() < drawn.len() / 2 || there.len() < 40 {
        return assessment;
    }
    let ends = [0.025, 0.975].map(|share| at_share(&there, share));
    let far = |[low, high]: [f64; 2]| {
        let half = 0.5 * (high - low);
        (ends[0] - low).abs().max((ends[1] - high).abs()) > BENT * half
    };
    if missing > 0.0 || assessment.interval.is_none_or(far) {
        let holds = drawn.iter().filter(|v| requirement.holds(**v)).count();
        assessment.interval = Some(ends);
        let share = holds as f64 / drawn.len() as f64;
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

/// The requirements at draws of the parameters: normal ones, wider where the errors are not well known, within bounds, of a logarithm where that was
/// searched. Draw by draw; empty where none are wanted or nothing varies.
fn drawn(plan: &Plan, params: &[Param], known: Known<'_>, draws: Draws) -> Result<Vec<Vec<f64>>, RequirementError> {
    let columns = plan.columns();
    let Some(root) = root(columns, known).filter(|_| draws.count > 0) else { return Ok(Vec::new()) };
    let freedom = columns.iter().filter_map(|k| known.freedom[*k]).reduce(f64::min);
    let mut stream = Stream::named(draws.seed, &["requirements"]);
    let points: Vec<Vec<f64>> =
        (0..draws.count).map(|_| point(columns, params, known, &root, freedom, &mut stream)).collect();
    let measured: Result<Vec<Vec<Vec<f64>>>, RequirementError> = points
        .par_chunks(32)
        .map(|part| {
            let mut bench: Bench<'_> = plan.bench()?;
            let values = |theta: &Vec<f64>| bench.measure(theta, false).iter().map(|m| m.value).collect();
            Ok(part.iter().map(values).collect())
        })
        .collect();
    Ok(measured?.into_iter().flatten().collect())
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
) -> Vec<f64> {
    /// Draws until one lies within all bounds.
    const MOST: usize = 100;
    let mut theta = known.theta.to_vec();
    for attempt in 1..=MOST {
        let z: Vec<f64> = columns.iter().map(|_| stream.normal()).collect();
        let wider = freedom.map_or(1.0, |f| {
            let share = stream.uniform().clamp(1e-12, 1.0 - 1e-12);
            chi_squared_quantile(share, f).map_or(1.0, |q| (f / q).sqrt())
        });
        let mut inside = true;
        for (i, k) in columns.iter().enumerate() {
            let move_ = wider * z.iter().enumerate().map(|(j, z)| root[(i, j)] * z).sum::<f64>();
            let (value, param) = (known.theta[*k], &params[*k]);
            let drawn = if param.logarithmic && value > 0.0 { value * exp(move_ / value) } else { value + move_ };
            inside &= drawn >= param.lower && drawn <= param.upper;
            // the last one is put on its bounds
            theta[*k] = if attempt == MOST { drawn.clamp(param.lower, param.upper) } else { drawn };
        }
        if inside {
            break;
        }
    }
    theta
}
