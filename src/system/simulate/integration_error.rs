//! The integration error of a response: what halving its steps says.
//!
//! Halving the steps of a method of order p leaves `2^-p` of the error of a smooth response, and the differences of halved steps are a
//! geometric series of that ratio. Where a response is not smooth (a kink of `max`, a jump of `if`, a root at zero) the order is lost. So
//! the ratio is observed, from three or four grids, and bounds what is left (Roache, Verification and validation in computational
//! science and engineering, 1998, chapter 5; Hairer, Norsett & Wanner, Solving ordinary differential equations I, II.4).

use super::error::{Divergence, Unsuited};
use super::simulator::Simulator;
use super::steps::{Scheme, Steps};
use crate::dynamics::Dynamics;
use crate::record::Run;

/// Integration errors below this part of an output's range are of no consequence to any estimate.
pub(super) const TOLERANCE: f64 = 1e-8;
/// Integration error, as a part of an output's range, that is good enough for a response that is looked at only, and
/// for estimates from records with hardly any noise.
pub const SOUND: f64 = 1e-6;
/// A response with an integration error above this part of an output's range is none.
pub const UNSOUND: f64 = 1e-3;

/// The slowest ratio that is expected: first order, of jumps. It bounds kinks as well, although halving leaves a quarter of their error in
/// the mean: a kink at the part s of a step costs `s/6 - s^2/2` (Simpson's rule at `max(0, t - s)`), halving moves s, and the error is
/// at most twice the difference, where the kink stands next to a node.
const SLOWEST: f64 = 0.5;

/// The error of a response that is a difference away from that of half the steps; `ratios` are those of differences of halved steps that were
/// seen, of each to the one before. The largest counts: where kinks stand in their steps changes with every halving, and one ratio may
/// be small by chance.
pub(super) fn remaining(scheme: Scheme, difference: f64, ratios: &[f64]) -> f64 {
    let smooth = 1.0 / f64::from(1_u32 << scheme.order());
    difference / (1.0 - ratios.iter().fold(smooth, |ratio, seen| ratio.max(*seen)).min(SLOWEST))
}

/// Where a response is farthest from that with half of its steps.
#[derive(Debug, Clone, PartialEq)]
pub struct WorstError {
    /// The output, by its place.
    pub output: usize,
    /// The sample.
    pub sample: usize,
    /// The integration error there, in the output's unit.
    pub error: f64,
    /// The integration error there, as a part of the output's range.
    pub part: f64,
    /// Root of the sum of the squares of the errors at all samples, in the output's unit.
    pub norm: f64,
    /// The state that is farthest off at that sample beside its own size; none where that is not known.
    pub state: Option<usize>,
}

impl WorstError {
    /// Where two responses (N by q each) are farthest apart that were computed with these steps and with half of them, output by output
    /// as far as that is above `least` of their ranges; the worst first.
    pub fn between(coarse: &[f64], fine: &[f64], outputs: usize, steps: &Steps, least: f64) -> Vec<Self> {
        Self::apart((coarse, fine), outputs, remaining(steps.scheme(), 1.0, &[]), least)
    }

    /// Errors of each output where the error is `grown` times the difference between both responses.
    fn apart((coarse, fine): (&[f64], &[f64]), outputs: usize, grown: f64, least: f64) -> Vec<Self> {
        let mut found = Vec::new();
        for output in 0..outputs {
            let range = output_range(fine.iter().skip(output).step_by(outputs));
            let pairs = coarse.iter().zip(fine).skip(output).step_by(outputs).map(|(a, b)| (a - b).abs());
            let worst = pairs.clone().enumerate().max_by(|(i, a), (j, b)| a.total_cmp(b).then(j.cmp(i)));
            let Some((sample, off)) = worst else { continue };
            let error = off * grown;
            if error > least * range {
                let norm = grown * pairs.map(|off| off * off).sum::<f64>().sqrt();
                found.push(Self { output, sample, error, part: error / range, norm, state: None });
            }
        }
        found.sort_by(|a, b| b.part.total_cmp(&a.part));
        found
    }

    /// Where the response with half of the steps is lost.
    fn lost(place: Divergence, outputs: usize) -> Vec<Self> {
        let Divergence { sample, state, .. } = place;
        let lost = Self { output: 0, sample, error: f64::INFINITY, part: f64::INFINITY, norm: f64::INFINITY, state };
        if outputs > 0 { vec![lost] } else { Vec::new() }
    }
}

/// Where the response (N by q) with these steps is farthest from that with half of them, output by output as far as they are
/// above `least` of their ranges; the worst first. Where the response with half of them is not finite, that place alone, with an
/// infinite error.
///
/// # Errors
/// [`Unsuited`] as for [`Simulator::new`].
pub fn worst_errors(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    steps: &Steps,
    least: f64,
) -> Result<Vec<WorstError>, Unsuited> {
    let (n, q) = (dynamics.layout().states, dynamics.layout().outputs);
    let finer = steps.halved();
    let Ok(coarse) = response(dynamics, run, theta, steps)? else { return Ok(Vec::new()) };
    let fine = match response(dynamics, run, theta, &finer)? {
        Ok(fine) => fine,
        Err(lost) => return Ok(WorstError::lost(lost, q)),
    };
    let states = |steps: &Steps| -> Result<Option<Vec<f64>>, Unsuited> {
        let mut x = vec![0.0; run.len() * n];
        let known = Simulator::new(dynamics, run, steps.clone())?.states(theta, &mut x);
        Ok((known == Ok(true)).then_some(x))
    };
    let ratios = ratios(dynamics, run, theta, steps, (&coarse, &fine))?;
    let mut found = WorstError::apart((&coarse, &fine), q, remaining(steps.scheme(), 1.0, &ratios), least);
    if !found.is_empty()
        && let (Some(a), Some(b)) = (states(steps)?, states(&finer)?)
    {
        let size = |j: usize| b.iter().skip(j).step_by(n).fold(f64::MIN_POSITIVE, |s, x| s.max(x.abs()));
        let sizes: Vec<f64> = (0..n).map(size).collect();
        for worst in &mut found {
            let off = |j: usize| (a[worst.sample * n + j] - b[worst.sample * n + j]).abs() / sizes[j];
            worst.state = (0..n).max_by(|i, j| off(*i).total_cmp(&off(*j)).then(j.cmp(i)));
        }
    }
    Ok(found)
}

/// Between the least and the greatest value of an output; of what does not move its size, or 1.
pub fn output_range<'v>(values: impl Iterator<Item = &'v f64> + Clone) -> f64 {
    let high = values.clone().copied().fold(f64::NEG_INFINITY, f64::max);
    let low = values.copied().fold(f64::INFINITY, f64::min);
    if high > low { high - low } else { high.abs().max(1.0) }
}

/// Integration error of a response with these steps, measured as in [`Accuracy::error`](super::Accuracy::error); infinite when it, or that with half the
/// steps, is not finite.
///
/// # Errors
/// [`Unsuited`] as for [`Simulator::new`].
pub fn integration_error(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    steps: impl Into<Steps>,
) -> Result<f64, Unsuited> {
    let steps = steps.into();
    if is_exact(dynamics, run, &steps) {
        return Ok(0.0);
    }
    match response(dynamics, run, theta, &steps)? {
        Ok(coarse) => error_of(dynamics, run, theta, &steps, &coarse),
        Err(_) => Ok(f64::INFINITY),
    }
}

/// Estimated integration error of a response (N by q) that is known.
///
/// # Errors
/// As [`integration_error`].
pub fn error_of(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    steps: &Steps,
    coarse: &[f64],
) -> Result<f64, Unsuited> {
    if is_exact(dynamics, run, steps) {
        return Ok(0.0);
    }
    let Ok(fine) = response(dynamics, run, theta, &steps.halved())? else { return Ok(f64::INFINITY) };
    let off = difference(coarse, &fine, dynamics.layout().outputs);
    // of no consequence whatever the order is
    let ratios = if off > (1.0 - SLOWEST) * TOLERANCE {
        ratios(dynamics, run, theta, steps, (coarse, &fine))?
    } else {
        Vec::new()
    };
    Ok(remaining(steps.scheme(), off, &ratios))
}

/// Ratios of the differences of halved steps about these, of which two responses are known: by steps of twice and four times their length
/// where these can be joined, and by a quarter elsewhere.
fn ratios(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    steps: &Steps,
    (coarse, fine): (&[f64], &[f64]),
) -> Result<Vec<f64>, Unsuited> {
    let apart = |a: &[f64], b: &[f64]| difference(a, b, dynamics.layout().outputs);
    let off = apart(coarse, fine);
    if let Some(twice) = steps.joined()
        && let Some(fourfold) = twice.joined()
        && let Ok(first) = response(dynamics, run, theta, &fourfold)?
        && let Ok(second) = response(dynamics, run, theta, &twice)?
    {
        let before = apart(&second, coarse);
        return Ok(vec![before / apart(&first, &second), off / before]);
    }
    let finest = response(dynamics, run, theta, &steps.halved().halved())?;
    Ok(vec![finest.map_or(SLOWEST, |finest| apart(fine, &finest) / off)])
}

/// Whether halving the steps changes nothing.
fn is_exact(dynamics: &dyn Dynamics, run: &Run, steps: &Steps) -> bool {
    let layout = dynamics.layout();
    let exact = matches!(steps.scheme(), Scheme::ExactDiscretisation { .. }) && layout.delayed.is_empty();
    exact || layout.states == 0 || run.len() < 2
}

/// The response (N by q), or where it is lost.
pub(super) fn response(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    steps: &Steps,
) -> Result<Result<Vec<f64>, Divergence>, Unsuited> {
    let mut simulator = Simulator::new(dynamics, run, steps.clone())?;
    simulator.suits(theta)?;
    let mut y = vec![0.0; simulator.samples() * simulator.outputs()];
    Ok(simulator.simulate(theta, &mut y).map(|()| y))
}

/// Largest difference of two responses, each output as a part of its range.
pub(super) fn difference(a: &[f64], b: &[f64], outputs: usize) -> f64 {
    let mut worst = 0.0_f64;
    for i in 0..outputs {
        let column = |y: &'_ [f64]| y.iter().skip(i).step_by(outputs).copied().collect::<Vec<f64>>();
        let (a, b) = (column(a), column(b));
        let range = output_range(b.iter());
        worst = a.iter().zip(&b).map(|(a, b)| (a - b).abs() / range).fold(worst, f64::max);
    }
    worst
}
