//! How likely a residual is as noise of any smooth spectrum: what tells of an effect where nothing else tells of the noise.
//!
//! A drift lies in the lowest lines, where candidates leave nothing by which noise is known: it promises little, whatever its size. But it is in every
//! other line only, and alike in all runs, which noise of a smooth spectrum is not: without it the residual is likelier, each by the noise that
//! suits it best (marginal likelihood over all spectra).

use super::beside::{Added, Beside};
use super::metric::Metric;
use super::round::Round;
use crate::diagnose::screen::{Left, LogSpectrum};
use rayon::prelude::*;

/// Candidates that are asked: those that promise most.
const ASKED: usize = 24;

/// The candidate without which a residual is likelier as noise.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unlikely {
    /// Its trace.
    pub(super) trace: usize,
    /// By how much likelier, its price taken off.
    pub(super) nats: f64,
    /// The chance that noise gives so much to any candidate: to one, a likelihood ratio of e^n comes with a chance below e^-n.
    pub(super) chance: f64,
}

impl Round<'_> {
    /// The candidate without which the residual is likelier by most; by what small steps do.
    pub(super) fn unlikely_as_noise(&self, beside: &Beside) -> Option<Unlikely> {
        let ranked = self.ranked_by_promise(beside);
        let residual: Vec<&[f64]> = self.records.iter().map(|r| &r.residual[..]).collect();
        let base = self.less(&residual, None, (1.0, &beside.added(&residual)));
        let likelihood = self.likelihood(&base);
        let gained = |(_, t): &(f64, usize)| -> Option<(f64, usize)> {
            let promises = self.promises(*t, beside);
            let best = promises.first()?;
            let direction: Vec<&[f64]> = self.records.iter().map(|r| &r.directions[best.direction][..]).collect();
            let base: Vec<&[f64]> = base.iter().map(Vec::as_slice).collect();
            let without = self.less(&base, Some(&direction), (best.amount, &best.added));
            Some((self.likelihood(&without) - likelihood - self.price(*t), *t))
        };
        let all: Vec<(f64, usize)> = ranked[..ranked.len().min(ASKED)].par_iter().filter_map(gained).collect();
        let (nats, trace) = all.into_iter().max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
        Some(Unlikely { trace, nats, chance: (self.traces.len() as f64 * (-nats).exp()).min(1.0) })
    }

    /// Signals less a multiple of a direction, of which the fitted columns take what they can; of the signals themselves where there is none.
    fn less(&self, signals: &[&[f64]], direction: Option<&[&[f64]]>, (amount, added): (f64, &Added)) -> Vec<Vec<f64>> {
        let one = |(r, signal): (usize, &&[f64])| {
            let mut left = signal.to_vec();
            if let Some(direction) = direction {
                left.iter_mut().zip(direction[r]).for_each(|(left, d)| *left -= amount * d);
            }
            let sign = if direction.is_some() { amount } else { -amount };
            for (column, multiple) in self.records[r].fitted.iter().zip(&added.compensation) {
                if let Some(column) = column.as_ref().filter(|_| *multiple != 0.0) {
                    left.iter_mut().zip(column).for_each(|(left, c)| *left += sign * multiple * c);
                }
            }
            left
        };
        signals.iter().enumerate().map(one).collect()
    }

    /// Marginal log-likelihood of residuals (one for each run) as noise.
    pub(super) fn likelihood(&self, residuals: &[Vec<f64>]) -> f64 {
        let outputs = self.stage.outputs();
        let flat = Metric::new(&vec![LogSpectrum::flat(1.0); outputs], 0);
        let mut lines: Vec<Vec<Left>> = vec![Vec::new(); outputs];
        for ((run, way), residual) in self.runs.train().iter().zip(&self.stage.ways).zip(residuals) {
            let mut lens = way.lens(run, outputs, &flat);
            for (o, lines) in lines.iter_mut().enumerate() {
                let squares = lens.squares(o, residual).into_iter();
                lines.extend(squares.map(|(log_frequency, power)| Left { log_frequency, power, freedom: 1.0 }));
            }
        }
        lines.iter().map(|lines| LogSpectrum::fit(lines, 1.0).evidence()).sum()
    }
}
