//! A delayed input where samples stand at equal intervals: every step sees the record through the same few weights.
//!
//! The window of a step, moved back by the delay, lies in the same place among the samples around it whichever step it is, so
//! that its moments (`moments.rs`) are the same three weights of three neighbouring samples everywhere. They are found by giving
//! the general rule a record that is 1 at one sample and 0 at the others.

use super::moments::{Follower, Rule, StageValues};
use crate::record::{Place, Run};

/// Neighbouring samples that a step can touch.
pub(super) const TAPS: usize = 3;

/// Weights of neighbouring samples for what a step sees.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Weights {
    /// The first of the samples, from the one at the beginning of the interval.
    pub(super) first: i64,
    /// Stages by samples: values, and slopes.
    pub(super) value: [[f64; TAPS]; 3],
    pub(super) slope: [[f64; TAPS]; 3],
}

/// Finds the weights of delays on one even grid.
#[derive(Debug, Clone)]
pub(super) struct DelayFilter {
    interval: f64,
    /// Steps in every interval.
    pub(super) per: usize,
    samples: usize,
    rule: Rule,
    /// Unit samples as linear inputs, and as held ones, one apart.
    units: Run,
}

impl DelayFilter {
    /// None where the samples are not at equal intervals to rounding.
    pub(super) fn new(time: &[f64], per: usize, rule: Rule) -> Option<Self> {
        let (first, last) = (*time.first()?, *time.last()?);
        let interval = (last - first) / (time.len() - 1) as f64;
        let rounding = 8.0 * f64::EPSILON * first.abs().max(last.abs());
        let even = |(k, t): (usize, &f64)| (first + k as f64 * interval - t).abs() <= rounding;
        let suits = interval > 0.0 && interval.is_finite() && time.iter().enumerate().all(even);
        suits.then(|| Self { interval, per, samples: time.len(), rule, units: units() })
    }

    /// Weights for step j of every interval.
    pub(super) fn step(&self, tau: f64, j: usize, held: bool) -> Weights {
        let (first, part) = self.window(j as f64 / self.per as f64 - tau / self.interval);
        let mut weights = Weights { first, ..Weights::default() };
        for tap in 0..TAPS {
            let window = (part, 1.0 / self.per as f64);
            let StageValues { value, slope } =
                Follower::default().step(&self.units, self.unit(tap, held), window, &self.rule);
            for stage in 0..3 {
                weights.value[stage][tap] = value[stage];
                weights.slope[stage][tap] = slope[stage] / self.interval;
            }
        }
        weights
    }

    /// Weights at the samples: the first stage counts.
    pub(super) fn sample(&self, tau: f64, held: bool) -> Weights {
        let (first, part) = self.window(-tau / self.interval);
        let mut weights = Weights { first, ..Weights::default() };
        for tap in 0..TAPS {
            let (value, slope) = self.units.input(self.unit(tap, held), Place::after(&self.units.time, 1, part));
            (weights.value[0][tap], weights.slope[0][tap]) = (value, slope / self.interval);
        }
        weights
    }

    /// Sample and part of an interval at a distance in intervals; a sample that is missed by rounding is met.
    fn window(&self, distance: f64) -> (i64, f64) {
        let near = distance.round();
        let distance =
            if (distance - near).abs() <= 8.0 * f64::EPSILON * near.abs().max(1.0) { near } else { distance };
        // further back everything is the first sample, further ahead the last
        let farthest = self.samples as f64 + TAPS as f64;
        let distance = distance.clamp(-farthest, farthest);
        let first = distance.floor();
        (first as i64, distance - first)
    }

    fn unit(&self, tap: usize, held: bool) -> usize {
        tap + if held { TAPS } else { 0 }
    }
}

impl Weights {
    /// Value and slope at a stage of what stands in three neighbouring samples.
    #[inline(always)]
    pub(super) fn at(&self, stage: usize, u: [f64; TAPS]) -> (f64, f64) {
        let sum = |w: &[f64; TAPS]| w[0] * u[0] + w[1] * u[1] + w[2] * u[2];
        (sum(&self.value[stage]), sum(&self.slope[stage]))
    }
}

/// A record of three samples one apart; input k, linear, is 1 at sample k, the same held behind them.
fn units() -> Run {
    let inputs = (0..TAPS).flat_map(|sample| (0..2 * TAPS).map(move |unit| f64::from(u8::from(unit % TAPS == sample))));
    Run {
        name: String::new(),
        time: (0..TAPS).map(|k| k as f64).collect(),
        inputs: inputs.collect(),
        measured: Vec::new(),
        held: (0..2 * TAPS).map(|unit| unit >= TAPS).collect(),
        input_gaps: vec![0; 2 * TAPS],
        output_gaps: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Scheme;

    /// The general rule at a step, however it lies.
    fn general(run: &Run, (from, h): (f64, f64), rule: &Rule) -> StageValues {
        Follower::default().step(run, 0, (from, h), rule)
    }

    #[test]
    fn weights_give_what_the_general_rule_gives() {
        let n = 12;
        let values: Vec<f64> = (0..n).map(|k| f64::from(k * k % 7) - 2.0).collect();
        for (held, scheme, per) in [false, true].into_iter().flat_map(|held| {
            [Scheme::RungeKutta, Scheme::Radau].into_iter().flat_map(move |s| [1, 3].map(|per| (held, s, per)))
        }) {
            let time: Vec<f64> = (0..n).map(|k| 1.5 + 0.25 * f64::from(k)).collect();
            let run = Run {
                name: "r".into(),
                inputs: values.clone(),
                held: vec![held],
                measured: Vec::new(),
                input_gaps: vec![0],
                output_gaps: Vec::new(),
                time: time.clone(),
            };
            let rule = Rule::of(scheme);
            let filter = DelayFilter::new(&time, per, rule).expect("even");
            // on samples the slope of a held input is that of either side: only whole steps meet them exactly
            let aligned = [0.0, 0.25, 1.0].into_iter().filter(|_| per == 1);
            for tau in [0.03, 0.31, 0.7, 2.74, 50.0].into_iter().chain(aligned) {
                for (k, begin) in time.iter().enumerate().take(n as usize - 1) {
                    let at = |i: i64| values[i.clamp(0, i64::from(n) - 1) as usize];
                    let seen = |w: &Weights| [0, 1, 2].map(|tap| at(k as i64 + w.first + tap));
                    for j in 0..per {
                        let (h, w) = (0.25 / per as f64, filter.step(tau, j, held));
                        let want = general(&run, (begin + j as f64 * h - tau, h), &rule);
                        for stage in 0..3 {
                            let (value, slope) = w.at(stage, seen(&w));
                            assert!((value - want.value[stage]).abs() < 1e-12, "{held} {tau} {k} {j} {stage}");
                            assert!((slope - want.slope[stage]).abs() < 1e-10, "{held} {tau} {k} {j} {stage}");
                        }
                    }
                    let w = filter.sample(tau, held);
                    let (value, slope) = w.at(0, seen(&w));
                    let want = run.input_at(0, time[k] - tau);
                    assert!((value - want.0).abs() < 1e-12 && (slope - want.1).abs() < 1e-10, "{held} {tau} {k}");
                }
            }
        }
    }

    #[test]
    fn uneven_samples_have_no_common_weights() {
        let rule = Rule::of(Scheme::RungeKutta);
        assert!(DelayFilter::new(&[0.0, 1.0, 2.1], 1, rule).is_none());
        assert!(DelayFilter::new(&[0.0], 1, rule).is_none() && DelayFilter::new(&[], 1, rule).is_none());
    }
}
