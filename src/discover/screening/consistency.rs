//! Whether an effect is of the same size in every run: its amount is fitted run by run, beside what was fitted to all.

use super::basis::Basis;
use super::projection::Frame;
use fdm_numeric::parallel;
use fdm_numeric::statistics::chi_squared_tail;
use nalgebra::{DMatrix, DVector};

/// Information about an amount, relative to all runs together, below which a run says nothing of it.
const SILENT: f64 = 1e-6;

/// Amounts of a candidate's direction run by run.
#[derive(Debug, Clone, PartialEq)]
pub struct Consistency {
    /// Multiple of the direction and its standard error; none where the run says nothing of it.
    pub amounts: Vec<Option<(f64, f64)>>,
    /// Q: squared distances of the amounts from their mean, in standard errors.
    pub statistic: f64,
    /// Runs that speak, less one.
    pub freedom: usize,
    /// The chance of a larger Q where the effect is the same in all runs.
    pub chance: f64,
}

/// Sums over the bins of one run.
struct OfRun {
    run: usize,
    /// Products of the absorbed axes with each direction (k by c).
    absorbed: DMatrix<f64>,
    /// Each direction's energy.
    own: DVector<f64>,
    /// Its product with the residual.
    residual: DVector<f64>,
}

/// Judges directions (columns of `chosen` in coordinates beside what was fitted); `absorbed` are products of the residual with the
/// axes of what was fitted, and `density` is S by output and frequency.
pub(super) fn consistencies(
    shared: &Basis,
    frame: &Frame,
    chosen: &DMatrix<f64>,
    absorbed: &DVector<f64>,
    density: impl Fn(usize, f64) -> f64 + Sync,
) -> Vec<Option<Consistency>> {
    let directions = frame.axes.columns(frame.absorbed, chosen.nrows()) * chosen;
    let mut signals = DMatrix::zeros(shared.width(), frame.absorbed + directions.ncols());
    signals.columns_mut(0, frame.absorbed).copy_from(&frame.axes.columns(0, frame.absorbed));
    signals.columns_mut(frame.absorbed, directions.ncols()).copy_from(&directions);
    let of = |part: &super::basis::OutputPart| {
        let weights: Vec<f64> = part.frequency.iter().map(|f| density(part.channel, *f).sqrt().recip()).collect();
        let mut bins = &part.basis * &signals;
        for mut column in bins.column_iter_mut() {
            column.iter_mut().zip(&weights).for_each(|(v, w)| *v *= w);
        }
        let residual = DVector::from_iterator(weights.len(), part.residual.iter().zip(&weights).map(|(r, w)| r * w));
        let (fitted, own) = (bins.columns(0, frame.absorbed), bins.columns(frame.absorbed, chosen.ncols()));
        OfRun {
            run: part.run,
            absorbed: fitted.transpose() * own,
            own: DVector::from_iterator(own.ncols(), own.column_iter().map(|c| c.norm_squared())),
            residual: own.tr_mul(&residual),
        }
    };
    let parts: Vec<OfRun> = parallel::map(shared.parts.iter(), of);
    let mut runs: Vec<OfRun> = Vec::new();
    for part in parts {
        match runs.iter_mut().find(|r| r.run == part.run) {
            Some(run) => {
                run.absorbed += part.absorbed;
                run.own += part.own;
                run.residual += part.residual;
            }
            None => runs.push(part),
        }
    }
    runs.sort_by_key(|r| r.run);
    (0..chosen.ncols()).map(|k| judged(&runs, k, absorbed)).collect()
}

/// Direction k.
fn judged(runs: &[OfRun], k: usize, absorbed: &DVector<f64>) -> Option<Consistency> {
    let total: f64 = runs.iter().map(|r| r.own[k]).sum();
    let speaks: Vec<usize> = (0..runs.len()).filter(|i| runs[*i].own[k] > SILENT * total).collect();
    let count = speaks.len();
    if count < 2 {
        return None;
    }
    let column = |i: usize| runs[speaks[i]].absorbed.column(k);
    let information = DMatrix::from_fn(count, count, |i, j| {
        let own = if i == j { runs[speaks[i]].own[k] } else { 0.0 };
        own - column(i).dot(&column(j))
    });
    let z =
        DVector::from_fn(count, |i, _| runs[speaks[i]].residual[k] - column(i).dot(&absorbed.rows(0, column(i).len())));
    let covariance = information.clone().cholesky()?.inverse();
    let amounts = &covariance * &z;
    let mean = z.sum() / information.sum();
    let away = amounts.add_scalar(-mean);
    let statistic = (&information * &away).dot(&away).max(0.0);
    let chance = chi_squared_tail(statistic, (count - 1) as f64)?;
    let mut all = vec![None; runs.len()];
    speaks.iter().enumerate().for_each(|(i, run)| all[*run] = Some((amounts[i], covariance[(i, i)].sqrt())));
    Some(Consistency { amounts: all, statistic, freedom: count - 1, chance })
}
