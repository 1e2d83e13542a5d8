//! Delays beyond the reach of a search about 0: those of many samples, beside which the likelihood has other hills, and a turned sign may be the nearest.
//!
//! What an output would be is told by the others: the model is fitted without it, and its record is laid over that response at every lag.

use crate::hypothesis::{Edit, Slot};
use crate::kinematics::Kinematics;
use crate::likelihood::{Begin, Evidence, THOROUGH, Trial};
use fdm_numeric::parallel;
use fdm_system::record::Run;

/// Largest lag, as a part of the record.
const FARTHEST: f64 = 0.25;
/// Products of samples that are summed at most.
const WORK: usize = 20_000_000;

/// Outputs among the slots whose record is late or early by many samples ([`far_delay`]), and by how many.
pub(crate) fn far_delays(
    evidence: &Evidence<'_>,
    slots: &[Slot],
    accepted: &[Edit],
    current: &Trial,
) -> Vec<(Slot, i64)> {
    let one = |slot: &Slot| match *slot {
        Slot::Output(output) => Some((*slot, far_delay(evidence, output, accepted, current)?)),
        _ => None,
    };
    parallel::filter_map(slots.iter(), one)
}

/// The lag in samples at which the record of an output (by index) is most like what the model makes of the other outputs; none where it is
/// at most two samples, where the record is as like that as it is with another sign, and where there are no other outputs.
fn far_delay(evidence: &Evidence<'_>, output: usize, accepted: &[Edit], current: &Trial) -> Option<i64> {
    /// Lags that a search about 0 finds.
    const NEAR: i64 = 2;
    let model = evidence.model?;
    let q = model.layout().outputs;
    if q < 2 {
        return None;
    }
    let without = |run: &Run| {
        let mut run = run.clone();
        run.measured.iter_mut().skip(output).step_by(q).for_each(|v| *v = f64::NAN);
        run
    };
    let runs: Vec<Run> = evidence.runs.iter().map(without).collect();
    let others = Evidence { runs: &runs, kinematics: Kinematics::default(), ..*evidence };
    let fitted = others.trial(Begin { model: None, steps: Some(current) }, accepted, THOROUGH)?;
    let estimate = fitted.estimate.filter(|e| e.termination.is_good())?;
    let column = |values: &[f64]| values.iter().skip(output).step_by(q).copied().collect::<Vec<f64>>();
    let recorded = evidence.edited_runs(model, accepted)?;
    let pairs: Vec<(Vec<f64>, Vec<f64>)> =
        recorded.iter().zip(&estimate.runs).map(|(run, fit)| (column(&run.measured), column(&fit.response))).collect();
    let longest = pairs.iter().map(|(z, _)| z.len()).max()?;
    let all: usize = pairs.iter().map(|(z, _)| z.len()).sum();
    let most = ((FARTHEST * longest as f64) as i64).min((WORK / all.max(1)) as i64 / 2);
    let alike = |lag: i64| Some((lag, correlation(&pairs, lag)?));
    let (lag, best) = (-most..=most).filter_map(alike).max_by(|a, b| a.1.total_cmp(&b.1))?;
    (lag.abs() > NEAR && best > correlation(&pairs, 0)?.abs()).then_some(lag)
}

/// Correlation of records with responses so many samples before, over all runs; none where one of them does not move.
fn correlation(pairs: &[(Vec<f64>, Vec<f64>)], lag: i64) -> Option<f64> {
    let [mut n, mut z, mut y, mut zz, mut yy, mut zy] = [0.0; 6];
    for (recorded, response) in pairs {
        let (late, early) = (lag.max(0) as usize, (-lag).max(0) as usize);
        for (a, b) in recorded.iter().skip(late).zip(response.iter().skip(early)) {
            if a.is_finite() && b.is_finite() {
                (n, z, y) = (n + 1.0, z + a, y + b);
                (zz, yy, zy) = (zz + a * a, yy + b * b, zy + a * b);
            }
        }
    }
    let spread = (zz - z * z / n) * (yy - y * y / n);
    (spread > 0.0).then(|| (zy - z * y / n) / spread.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_that_are_late_are_most_like_what_was_before() {
        let wave = |k: i64| (0.21 * k as f64).sin() + 0.5 * (0.13 * k as f64 + 1.0).sin();
        let response: Vec<f64> = (0..300).map(wave).collect();
        for lag in [-17, 0, 24] {
            let recorded: Vec<f64> = (0..300).map(|k| 3.0 + 2.0 * wave(k - lag)).collect();
            let pairs = [(recorded, response.clone())];
            assert!((correlation(&pairs, lag).unwrap() - 1.0).abs() < 1e-9);
            assert!((-60..=60).filter(|l| *l != lag).all(|l| correlation(&pairs, l).unwrap() < 1.0 - 1e-4));
        }
        assert_eq!(correlation(&[(vec![1.0; 5], vec![2.0; 5])], 0), None);
    }
}
