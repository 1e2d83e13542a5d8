//! What held-out runs hold beyond the noise of those that are learned from.
//!
//! The noise of a comparison is what the best model leaves of the runs that are learned from, where the fit has taken
//! what it could: slow motions above all. Another flight has another wind, and its slow lines may hold a hundred times as
//! much, whatever the model; by the first runs' noise they would decide alone which model holds. So a band in which every model that is
//! compared leaves far more than that noise is given what the best of them leaves there.

use super::contender::Contender;
use super::metric::Metric;
use super::refit::Fitting;
use super::round::Round;
use super::way::Way;
use crate::model::Model;
use crate::record::Run;

/// Least width of a band in log f, and the fewest lines in it.
const WIDTH: f64 = 0.3;
const FEWEST: usize = 6;
/// Deviations of the sum of squares beyond which it is no chance.
const CLEAR: f64 = 4.0;

/// By how much a held-out output's noise is larger, band by band.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Surplus {
    /// Upper end of each band in log f, and the factor of the variance there.
    bands: Vec<(f64, f64)>,
}

impl Surplus {
    /// Of squares that should be one on average, of several models over the same lines.
    fn of(models: &[Vec<(f64, f64)>]) -> Self {
        let Some(first) = models.first() else { return Self { bands: Vec::new() } };
        let mut order: Vec<usize> = (0..first.len()).collect();
        order.sort_by(|a, b| first[*a].0.total_cmp(&first[*b].0));
        let (mut bands, mut from) = (Vec::new(), 0);
        for to in 1..=order.len() {
            let (low, high) = (first[order[from]].0, first[order[to - 1]].0);
            let full = to - from >= FEWEST && high - low >= WIDTH;
            if !full && to < order.len() {
                continue;
            }
            let count = (to - from) as f64;
            let left = |model: &Vec<(f64, f64)>| order[from..to].iter().map(|k| model[*k].1).sum::<f64>();
            let least = models.iter().map(left).fold(f64::INFINITY, f64::min);
            let clear = least > count + CLEAR * (2.0 * count).sqrt();
            bands.push((high, if clear && least.is_finite() { least / count } else { 1.0 }));
            from = to;
        }
        Self { bands }
    }

    /// Whether there is none.
    pub(super) fn is_none(&self) -> bool {
        self.bands.iter().all(|(_, factor)| *factor == 1.0)
    }

    /// The factor at a frequency; that of the nearest band beyond them all.
    pub(super) fn at(&self, log_frequency: f64) -> f64 {
        let band = self.bands.partition_point(|(end, _)| *end < log_frequency);
        self.bands.get(band).or(self.bands.last()).map_or(1.0, |(_, factor)| *factor)
    }
}

/// A model on the held-out runs: its ways to them and all parameters there.
type OnHeld<'m> = (&'m Model, &'m [Way], &'m [Vec<f64>]);

impl Round<'_> {
    /// The noise with what the held-out runs hold beyond it, whichever of these models is right; none where they hold no more.
    pub(super) fn with_surplus(
        &self,
        metric: &Metric,
        base: Option<&Fitting>,
        contenders: &[Contender],
    ) -> Option<Metric> {
        let train = self.runs.train;
        let mut models: Vec<OnHeld<'_>> = Vec::new();
        models.push((&self.stage.model, &self.stage.ways[train..], &base?.theta));
        for contender in contenders {
            if let Some((gain, fitting)) = &contender.held
                && gain.is_finite()
            {
                models.push((&contender.model, &contender.ways[train..], &fitting.theta));
            }
        }
        let raised = surplus(metric, self.runs.held(), self.stage.outputs(), &models);
        raised.iter().any(|s| !s.is_none()).then(|| metric.with_surplus(raised))
    }
}

/// By output, what is beyond a noise in all models.
fn surplus(metric: &Metric, held: &[Run], outputs: usize, models: &[OnHeld<'_>]) -> Vec<Surplus> {
    let squares = |(model, ways, theta): &OnHeld<'_>| -> Option<Vec<Vec<(f64, f64)>>> {
        let mut all = vec![Vec::new(); outputs];
        for (run, (way, theta)) in held.iter().zip(ways.iter().zip(*theta)) {
            let response = way.answer(model.dynamics(), run, theta).ok()?;
            let residual: Vec<f64> = way.measured(run).iter().zip(&response).map(|(z, y)| z - y).collect();
            let mut lens = way.lens(run, outputs, metric);
            all.iter_mut().enumerate().for_each(|(o, all)| all.extend(lens.squares(o, &residual)));
        }
        Some(all)
    };
    let found: Vec<Vec<Vec<(f64, f64)>>> = models.iter().filter_map(squares).collect();
    let of = |o: usize| Surplus::of(&found.iter().map(|model| model[o].clone()).collect::<Vec<_>>());
    (0..outputs).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(power: impl Fn(usize) -> f64) -> Vec<(f64, f64)> {
        (1..200).map(|k| ((k as f64).ln(), power(k))).collect()
    }

    #[test]
    fn only_what_every_model_leaves_is_more_noise() {
        let (slow, right) = (|k: usize| if k < 8 { 300.0 } else { 1.0 }, lines(|_| 1.1));
        let found = Surplus::of(&[lines(slow), lines(|k| 2.0 * slow(k))]);
        assert!((found.at(2.0_f64.ln()) - 300.0).abs() < 1e-9 && found.at(0.0 - 3.0) > 200.0, "{found:?}");
        assert_eq!((found.at(100.0_f64.ln()), found.at(1e3)), (1.0, 1.0));
        assert!(Surplus::of(&[lines(slow), right]).is_none() && Surplus::of(&[]).is_none());
    }
}
