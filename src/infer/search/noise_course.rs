//! How the size of the noise goes over the records: hypotheses as any other, judged by the evidence.
//!
//! Noise may grow with its signal (asked before anything is searched for), and it may be larger in parts of the records than in others: after a
//! release, in a gust, in one run. An effect that only takes up what one part has beyond the others is then not needed any more.

use super::sets::Fitted;
use super::state::{Ground, State};
use crate::candidates::predictor::responses;
use crate::evidence::climb::Climb;
use crate::evidence::noise::ROUGHNESS;
use fdm_numeric::statistics::log_gamma;
use std::ops::Range;

/// Rates at which noise may grow with its signal.
const RATES: [f64; 3] = [0.7, 2.0, 6.0];
/// Log prior odds of noise of more than one size.
const UNEVEN: f64 = -3.0;
/// Parts of a run in which noise may have its own size, and samples that each has at least.
const PARTS: usize = 10;
const LEAST: usize = 16;

/// The samples of a part with the squares of their residuals, whitened.
struct Part {
    run: usize,
    samples: Range<usize>,
    squares: f64,
    count: f64,
}

impl Part {
    /// Log evidence beside noise of one size (1): its variance is of an inverse gamma law about 1, as powers are in rough spectra.
    fn gained(&self) -> f64 {
        let (a, half) = (ROUGHNESS, 0.5 * self.count);
        log_gamma(a + half) - log_gamma(a) + a * a.ln() - (a + half) * (a + 0.5 * self.squares).ln()
            + 0.5 * self.squares
    }

    /// Its deviation.
    fn size(&self) -> f64 {
        ((ROUGHNESS + 0.5 * self.squares) / (ROUGHNESS + 0.5 * self.count)).sqrt()
    }

    /// What it costs that the deviation was not known.
    fn cost(&self) -> f64 {
        let size = self.size();
        self.gained() - 0.5 * self.squares + self.count * size.ln() + 0.5 * self.squares / size.powi(2)
    }
}

impl Ground<'_> {
    fn is_in_time(&self, state: &State) -> bool {
        self.runs.all.iter().zip(&state.text.predictors).all(|(_, p)| p.frequencies().is_none())
    }

    /// The ground on which the noise of each output grows with its signal where a state's residuals say so, and the state fitted there; none where it has
    /// no response.
    pub(crate) fn with_growing_noise(mut self, base: State) -> Option<(Self, Fitted)> {
        let mut fitted = self.refit(base, None)?;
        if !self.is_in_time(&fitted.0) {
            return Some((self, fitted));
        }
        let mut changed = false;
        for output in 0..self.binning.outputs {
            let state = &fitted.0;
            let answers = responses(&state.text.model, self.runs.all, &state.text.predictors, &state.theta)?;
            let tried = |rate: &f64| {
                let grown = |y: &Vec<f64>| {
                    let own = || y.iter().skip(output).step_by(self.binning.outputs);
                    let mean = own().sum::<f64>() / own().count().max(1) as f64;
                    own().map(|y| 1.0 + rate * (y - mean).abs() / self.deviations[output]).collect()
                };
                let sizes: Vec<Vec<f64>> = answers.iter().map(grown).collect();
                let ground = Ground { binning: self.binning.shaped(output, &sizes), ..self.clone() };
                let judged = ground.judge(state, None)?;
                Some((ground, judged))
            };
            let best = RATES.iter().filter_map(tried).max_by(|a, b| a.1.log.total_cmp(&b.1.log));
            if let Some((ground, judged)) = best.filter(|(_, judged)| judged.log + UNEVEN > fitted.1.log) {
                (self, changed) = (ground, true);
                fitted.1 = judged;
            }
        }
        if changed {
            fitted = self.refit(fitted.0, Some(&fitted.1.evidence.weights.clone()))?;
        }
        Some((self, fitted))
    }

    /// The ground on which parts of the records have noise of their own size, where what a state leaves says so.
    pub(crate) fn with_uneven_noise(&self, (state, judged): &Fitted) -> Option<Self> {
        if !self.is_in_time(state) {
            return None;
        }
        let weights = &judged.evidence.weights;
        let own = state.text.own.len();
        let mut parts: Vec<Vec<Part>> = (0..self.binning.outputs).map(|_| Vec::new()).collect();
        for (r, (run, columns)) in self.binning.runs.iter().zip(&judged.linear.columns).enumerate() {
            for (output, samples, white) in run.whitened(&columns[own], weights) {
                let count = (samples.len() / LEAST).clamp(1, PARTS);
                let edge = |k: usize| k * samples.len() / count;
                parts[output].extend((0..count).map(|k| Part {
                    run: r,
                    samples: samples[edge(k)]..samples.get(edge(k + 1)).map_or(usize::MAX, |s| *s),
                    squares: white[edge(k)..edge(k + 1)].iter().map(|v| v * v).sum(),
                    count: (edge(k + 1) - edge(k)) as f64,
                }));
            }
        }
        let (mut ground, mut cost) = (self.clone(), 0.0);
        for (output, parts) in parts.iter().enumerate() {
            if parts.iter().map(Part::gained).sum::<f64>() + UNEVEN <= 0.0 {
                continue;
            }
            let mut sizes: Vec<Vec<f64>> = self.runs.all.iter().map(|run| vec![1.0; run.len()]).collect();
            for part in parts {
                let end = part.samples.end.min(sizes[part.run].len());
                sizes[part.run][part.samples.start..end].fill(part.size());
            }
            ground.binning = ground.binning.shaped(output, &sizes);
            cost += parts.iter().map(Part::cost).sum::<f64>() + UNEVEN;
        }
        let found = (cost < 0.0).then(|| ground.judge(state, Some(weights))).flatten()?;
        (found.log + cost > judged.log).then_some(ground)
    }
}
