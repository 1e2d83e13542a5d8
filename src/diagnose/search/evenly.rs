//! Runs on even grids: what noise has a spectrum for. Missing samples become empty ones.

use super::search_error::SearchError;
use crate::record::Run;
use crate::record::bridge;
use crate::record::even_grid::{EvenGrid, LONGEST_GAP};

/// Fewest samples of which a spectrum can be had.
const LEAST: usize = 32;
/// Part of the interval by which times may leave the grid over a whole record before its gaps are not believed.
const DRIFT: f64 = 0.05;

/// The run on an even grid.
///
/// # Errors
/// [`SearchError::TooShort`], [`SearchError::Uneven`], [`SearchError::LongGap`].
pub(super) fn evenly(run: &Run) -> Result<Run, SearchError> {
    let name = || run.name.clone();
    if run.len() < LEAST {
        return Err(SearchError::TooShort { run: name(), samples: run.len(), least: LEAST });
    }
    let grid = EvenGrid::of(&run.time).map_err(|_| SearchError::Uneven { run: name() })?;
    let length = grid.length();
    if length == run.len() {
        return Ok(run.clone());
    }
    let longest = grid.place.windows(2).map(|w| w[1] - w[0]).max().unwrap_or(1);
    let last = run.time.last().copied().unwrap_or_default();
    let drift = (grid.interval * (length - 1) as f64 - last).abs() / (grid.interval * length as f64);
    if longest >= LONGEST_GAP || drift > DRIFT {
        return Err(SearchError::LongGap { run: name(), intervals: longest });
    }
    Ok(spread(run, &grid))
}

/// Samples at their places; inputs are bridged, outputs stay empty.
fn spread(run: &Run, grid: &EvenGrid) -> Run {
    let (n, m) = (grid.length(), run.held.len());
    let q = run.output_gaps.len();
    let mut wide = Run {
        time: (0..n).map(|k| k as f64 * grid.interval).collect(),
        inputs: vec![f64::NAN; n * m],
        measured: vec![f64::NAN; n * q],
        ..run.clone()
    };
    for (k, place) in grid.place.iter().enumerate() {
        wide.inputs[place * m..][..m].copy_from_slice(&run.inputs[k * m..][..m]);
        wide.measured[place * q..][..q].copy_from_slice(&run.measured[k * q..][..q]);
    }
    for k in 0..m {
        bridge(&wide.time, &mut wide.inputs, m, k, run.held[k]);
    }
    wide
}

/// Time between samples.
pub(super) fn interval(run: &Run) -> f64 {
    let (first, last) = (run.time.first().copied().unwrap_or(0.0), run.time.last().copied().unwrap_or(1.0));
    (last - first) / (run.len().max(2) - 1) as f64
}

/// A held-out run must not be one of those that the model is learned from.
///
/// # Errors
/// [`SearchError::HeldOutTwice`]
pub(super) fn apart(runs: &[Run], held: &[Run]) -> Result<(), SearchError> {
    let bits = |values: &[f64]| -> Vec<u64> { values.iter().map(|v| v.to_bits()).collect() };
    for other in held {
        let same = |run: &&Run| bits(&run.measured) == bits(&other.measured) && bits(&run.inputs) == bits(&other.inputs);
        if let Some(run) = runs.iter().find(same) {
            return Err(SearchError::HeldOutTwice { held: other.name.clone(), run: run.name.clone() });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(time: Vec<f64>) -> Run {
        let n = time.len();
        Run {
            name: "r".into(),
            inputs: time.iter().map(|t| 2.0 * t).collect(),
            measured: (0..n).map(|k| k as f64).collect(),
            time,
            held: vec![false],
            input_gaps: vec![0],
            output_gaps: vec![0],
        }
    }

    #[test]
    fn missing_samples_become_empty_ones_and_inputs_are_bridged() {
        let time: Vec<f64> = (0..50).filter(|k| !(10..13).contains(k)).map(|k| 0.5 * f64::from(k)).collect();
        let even = evenly(&run(time)).expect("even with a gap");
        assert_eq!((even.len(), even.time[11]), (50, 5.5));
        assert!((even.inputs[11] - 11.0).abs() < 1e-12 && even.measured[11].is_nan() && even.measured[13] == 10.0);
    }

    #[test]
    fn what_has_no_spectrum_is_refused() {
        let short = evenly(&run((0..20).map(f64::from).collect()));
        assert!(matches!(short, Err(SearchError::TooShort { samples: 20, .. })));
        let uneven = evenly(&run((0..60).map(|k| f64::from(k * k)).collect()));
        assert!(matches!(uneven, Err(SearchError::Uneven { .. })));
        let torn = (0..60).map(|k| f64::from(if k < 30 { k } else { k + 5000 })).collect();
        assert!(matches!(evenly(&run(torn)), Err(SearchError::LongGap { .. })));
        let one = run((0..40).map(f64::from).collect());
        assert!(apart(std::slice::from_ref(&one), std::slice::from_ref(&one)).is_err());
    }
}
