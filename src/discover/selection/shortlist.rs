//! Which candidates are worth a fit.
//!
//! Screening knows what a small step predicts. Where much is missing the fitted parameters have moved far to make up for it, and a
//! backlash that gains a hundred nats may have a predicted gain of five: those that come next are then looked at by an iteration or two of a joint fit.
//!
//! How likely a residual is as noise of any smooth spectrum: what tells of an effect where nothing else tells of the noise.
//!
//! A drift lies in the lowest bins, where candidates leave nothing by which noise is known: it predicts little, whatever its size. But it is in every
//! other bin only, and alike in all runs, which noise of a smooth spectrum is not: without it the residual is likelier, each by the noise that
//! suits it best (marginal likelihood over all spectra).

use super::fitted_model::FittedModel;
use super::fitting::Fitting;
use super::forward_step::{ForwardStep, PENALTY, prior};
use super::projection::{Projected, Projection};
use super::whitening::CommonNoise;
use crate::noise::{Growth, LogSpectrum, ResidualPower};
use fdm_numeric::parallel;
use fdm_system::record::Run;
use std::ops::RangeInclusive;
use std::sync::Arc;

/// Part of the best predicted gain from which a candidate is fitted in any case.
const REACH: f64 = 0.6;
/// Promise, less the penalty, from which others are glanced at; how many, and how many of these are fitted.
const LARGE: f64 = 5.0;
const GLANCED: usize = 16;
const BEST: usize = 4;

impl ForwardStep<'_> {
    /// Candidates to be fitted, between so many, all of them ranked by what they predict; all that can be where everything is asked for.
    pub(super) fn chosen(
        &self,
        count: RangeInclusive<usize>,
        mut ranked: Vec<(f64, usize)>,
        (projection, noise, base): (&Projection, &CommonNoise, &Fitting),
    ) -> Vec<usize> {
        let mut chosen = self.promising(&count);
        if *count.start() >= self.simulated.len() {
            return chosen;
        }
        let best = ranked.first().map_or(0.0, |(prediction, _)| *prediction);
        ranked.retain(|(_, t)| !chosen.contains(t));
        if best > LARGE {
            ranked.truncate(GLANCED);
            let glance =
                |(_, t): &(f64, usize)| Some((self.glance(*t, projection, noise, base)? - self.penalty(*t), *t));
            ranked = parallel::filter_map(ranked.iter(), glance);
            sort(&mut ranked);
        }
        chosen.extend(ranked.into_iter().take(BEST).map(|(_, t)| t));
        chosen
    }

    /// All candidates by what they are predicted to gain in a metric, less their penalty.
    pub(super) fn ranked_by_predicted_gain(&self, projection: &Projection) -> Vec<(f64, usize)> {
        let prediction =
            |t: usize| (self.predictions(t, projection).first().map_or(0.0, |p| p.gain) - self.penalty(t), t);
        let mut ranked: Vec<(f64, usize)> = parallel::map(0..self.simulated.len(), prediction);
        sort(&mut ranked);
        ranked
    }

    /// What a candidate's parameters and its kind cost.
    pub(super) fn penalty(&self, t: usize) -> f64 {
        let attached = &self.simulated[t].attached;
        PENALTY * attached.cost() as f64 + prior(attached.candidate.effect().class())
    }

    /// The best by lead, and then by predicted gain, penalties taken off, all whose predicted gain is within reach of the best: where the
    /// noise under an effect is known by few bins, its chance is discounted, but what it gains is not.
    fn promising(&self, count: &RangeInclusive<usize>) -> Vec<usize> {
        let candidates = &self.screening.candidates;
        let usable = |t: &&usize| candidates[**t].direction.is_some() && candidates[**t].statistic > 0.0;
        let mut ranked: Vec<usize> = self.screening.ranking.iter().filter(usable).copied().collect();
        let best = ranked.iter().map(|t| candidates[*t].statistic).fold(0.0, f64::max);
        let first = ranked.len().min(*count.start());
        let promised = |t: &usize| candidates[*t].gain() - self.penalty(*t);
        ranked[first..].sort_by(|a, b| promised(b).total_cmp(&promised(a)).then(a.cmp(b)));
        let near = |(k, t): (usize, usize)| (k < *count.start() || candidates[t].statistic > REACH * best).then_some(t);
        ranked.into_iter().enumerate().filter_map(near).take(*count.end()).collect()
    }
}

/// The largest first.
fn sort(ranked: &mut [(f64, usize)]) {
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
}

/// Candidates that are asked: those that are predicted to gain most.
const ASKED: usize = 24;

/// The candidate without which a residual is likelier as noise.
#[derive(Debug, Clone, Copy)]
pub(super) struct UnlikelyNoise {
    /// Its trace.
    pub(super) candidate: usize,
    /// By how much likelier, its penalty taken off.
    pub(super) nats: f64,
    /// The chance that noise gives so much to any candidate: to one, a likelihood ratio of e^n comes with a chance below e^-n.
    pub(super) chance: f64,
}

impl ForwardStep<'_> {
    /// The candidate, of all that are ranked by what they predict, without which the residual is likelier by most; by what small steps do.
    pub(super) fn unlikely_as_noise(&self, projection: &Projection, ranked: &[(f64, usize)]) -> Option<UnlikelyNoise> {
        let residual: Vec<&[f64]> = self.records.iter().map(|r| &r.residual[..]).collect();
        let base = self.less(&residual, None, (1.0, &projection.added(&residual)));
        let likelihood = self.likelihood(&base);
        let gained = |(_, t): &(f64, usize)| -> Option<(f64, usize)> {
            let predictions = self.predictions(*t, projection);
            let best = predictions.first()?;
            let base: Vec<&[f64]> = base.iter().map(Vec::as_slice).collect();
            let less = |direction: &[&[f64]]| self.less(&base, Some(direction), (best.amount, &best.added));
            let without = self.with_direction(best.direction, less);
            Some((self.likelihood(&without) - likelihood - self.penalty(*t), *t))
        };
        let all: Vec<(f64, usize)> = parallel::filter_map(ranked[..ranked.len().min(ASKED)].iter(), gained);
        let (nats, candidate) = all.into_iter().max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
        Some(UnlikelyNoise { candidate, nats, chance: (self.simulated.len() as f64 * (-nats).exp()).min(1.0) })
    }

    /// Signals less a multiple of a direction, of which the fitted columns take what they can; of the signals themselves where there is none.
    fn less(
        &self,
        signals: &[&[f64]],
        direction: Option<&[&[f64]]>,
        (amount, added): (f64, &Projected),
    ) -> Vec<Vec<f64>> {
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
        likelihood_as_noise(&self.current, self.runs.train(), &self.growth, residuals)
    }
}

/// Marginal log-likelihood of residuals of a model (N by q for each run) as noise of any smooth spectrum, which grows with the response as was
/// found (an entry for each output).
pub(super) fn likelihood_as_noise(
    model: &FittedModel,
    runs: &[Run],
    growth: &Arc<[Option<Growth>]>,
    residuals: &[Vec<f64>],
) -> f64 {
    let outputs = model.outputs();
    let flat = CommonNoise::new(&vec![LogSpectrum::flat(1.0); outputs], 0).growing(growth);
    let mut bins: Vec<Vec<ResidualPower>> = vec![Vec::new(); outputs];
    for ((run, predictor), residual) in runs.iter().zip(&model.predictors).zip(residuals) {
        let mut whitener = predictor.whitener(run, outputs, &flat);
        for (o, bins) in bins.iter_mut().enumerate() {
            let squares = whitener.squares(o, residual).into_iter();
            bins.extend(squares.map(|(log_frequency, power)| ResidualPower { log_frequency, power, freedom: 1.0 }));
        }
    }
    bins.iter().map(|bins| LogSpectrum::fit(bins, 1.0).evidence()).sum()
}
