//! How densely records must be sampled: what lies above the band of every column is noise, and says nothing of a cause.

use crate::candidates::fitted_model::FittedModel;
use crate::candidates::runs::Runs;
use crate::evidence::binning::Binning;

/// Part of a signal's square that may lie above its band.
const ABOVE: f64 = 1e-3;
/// Part of the square of a mean below which what moves is its rounding.
const ROUNDING: f64 = 1e-20;
/// Highest frequency that is kept, in that band: harmonics of what is not linear, and as much again, from which the noise is known.
const KEPT: f64 = 6.0;
/// Fewest samples that are left of a run.
const LEAST: usize = 400;

/// Every how many samples of all runs say all that a model does, and its derivatives by what all runs share and, where it is asked for, by what belongs to
/// each of them; 1 where that is not known.
pub(crate) fn decimation(first: &FittedModel, runs: Runs<'_>, of_runs: bool) -> usize {
    let binning = Binning::new(first, runs);
    let params = &first.model.definition().params;
    let free = |own: bool| -> Vec<usize> {
        (0..params.len()).filter(|k| !params[*k].fixed && params[*k].per_run == own && (!own || of_runs)).collect()
    };
    let (shared, own) = (free(false), free(true));
    let mut every = usize::MAX;
    for (r, run) in runs.all.iter().enumerate() {
        let predictor = &first.predictors[r];
        let even = predictor.steps().is_some() && run.measured.iter().all(|z| !z.is_nan());
        let linear = predictor.linearised(first.model.dynamics(), (run, &first.theta[r]), (&shared, &own));
        let (true, Ok(linear)) = (even, linear) else { return 1 };
        let (n, bins) = (run.len(), &binning.runs[r]);
        let columns = linear.columns.iter().chain([&first.response[r]]).map(|signal| bins.of(signal, false));
        let highest = columns.flat_map(|column| column.chunks_exact(n).map(band).collect::<Vec<usize>>()).max();
        let kept = (KEPT * highest.unwrap_or(n).max(1) as f64) as usize;
        every = every.min(n / kept.max(LEAST.min(n)).max(1));
    }
    every.clamp(1, 1 << 20)
}

/// The bin behind which hardly anything of a signal is left, its mean left out.
fn band(bins: &[f64]) -> usize {
    let square = |v: &f64| v * v;
    let whole: f64 = bins.iter().skip(1).map(square).sum();
    // the rounding of a constant is not a signal
    if bins.first().is_none_or(|mean| whole <= ROUNDING * square(mean)) {
        return 1;
    }
    let mut left = whole;
    for (k, v) in bins.iter().enumerate().skip(1) {
        left -= square(v);
        if left <= ABOVE * whole {
            return k;
        }
    }
    bins.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_band_of_a_signal_ends_behind_its_last_part() {
        let mut bins = vec![0.0; 100];
        (bins[0], bins[5], bins[30]) = (50.0, 3.0, 1.0);
        assert_eq!(band(&bins), 30);
        bins[80] = 0.05;
        assert_eq!(band(&bins), 30);
        assert_eq!(band(&[7.0, 1e-13, 1e-13]), 1);
    }
}
