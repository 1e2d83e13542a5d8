//! Zeros of outputs that move once, in one run: where the residuals before and behind differ most, and at once.

use super::ground::{Ground, Point};
use fdm_doctor::{Estimated, Fault, Record, Role, Slot, Tail};

/// Fewest samples before and behind.
const FEWEST: usize = 20;
/// Samples on each side of a jump.
const SIDE: usize = 8;

/// Where the zero of each output may move.
pub(crate) fn shifts_of_zero(ground: &Ground<'_>, point: &Point) -> Vec<Estimated> {
    let [record] = ground.records else { return Vec::new() };
    let edits = point.edits();
    let Some(responses) = ground.responses(&point.theta, &edits, &[]) else { return Vec::new() };
    let (left, time) = ground.left(0, &responses, &edits);
    let q = ground.deviations.len();
    let of = |output: usize| -> Option<Estimated> {
        let all = (0..time.len()).map(|k| (k, left[k * q + output]));
        let e: Vec<(usize, f64)> = all.filter(|(_, v)| v.is_finite()).collect();
        let n = e.len();
        if n < 4 * FEWEST {
            return None;
        }
        let total: f64 = e.iter().map(|(_, v)| v).sum();
        let (mut before, mut best) = (0.0, (0.0, 0, 0.0));
        for k in 1..=n - FEWEST {
            before += e[k - 1].1;
            let (a, b) = (k as f64, (n - k) as f64);
            let jump = (total - before) / b - before / a;
            if k >= FEWEST && jump * jump * a * b > best.0 {
                best = (jump * jump * a * b, k, jump);
            }
        }
        // model error wanders; a zero that moves does so from one sample to the next, and not where an input jumps
        let (k, at_once) = jump_near(&e, best.1)?;
        let here = e[k].0;
        if at_once / best.2 < 0.5 || input_jumps(record, here * ground.every, ground.every) {
            return None;
        }
        Some(Estimated { fault: Fault::ZeroShift, slot: Slot::Output(output), at: time[here] })
    };
    (0..q).filter_map(of).collect()
}

/// How far lines through the samples before and behind each sample are apart halfway to the sample before it.
fn jumps(e: &[(usize, f64)]) -> Vec<f64> {
    // a line through SIDE samples, read half an interval beyond its end
    let n = SIDE as f64;
    let middle = 0.5 * (n - 1.0);
    let spread = n * (n * n - 1.0) / 12.0;
    let weight = |i: usize| 1.0 / n + (n - 0.5 - middle) * (i as f64 - middle) / spread;
    let at = |k: usize| {
        let before: f64 = (0..SIDE).map(|i| weight(i) * e[k - SIDE + i].1).sum();
        let behind: f64 = (0..SIDE).map(|i| weight(SIDE - 1 - i) * e[k + i].1).sum();
        behind - before
    };
    (SIDE..e.len().saturating_sub(SIDE - 1)).map(at).collect()
}

/// The sample near this one before which residuals jump, and how far, where that is far beyond all other places.
fn jump_near(e: &[(usize, f64)], k: usize) -> Option<(usize, f64)> {
    /// Of a jump as large by chance at any sample.
    const CHANCE: f64 = 0.01;
    let all = jumps(e);
    let places = k.saturating_sub(3).max(SIDE)..(k + 4).min(SIDE + all.len());
    let at = places.max_by(|a, b| all[a - SIDE].abs().total_cmp(&all[b - SIDE].abs()))?;
    // the jump itself is seen by all that are near
    let others = all.iter().enumerate().filter(|(i, _)| (i + SIDE).abs_diff(at) > 2 * SIDE);
    let mut sizes: Vec<f64> = others.map(|(_, v)| v.abs()).collect();
    let jump = all[at - SIDE];
    (Tail::new(&mut sizes)?.exceeded(jump.abs()) < CHANCE).then_some((at, jump))
}

/// Whether an input jumps within two samples of this one, beside what it does usually.
fn input_jumps(record: &Record, sample: usize, every: usize) -> bool {
    record.channels.iter().filter(|c| c.role == Role::Input).any(|c| {
        let mut steps: Vec<f64> = c.values.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
        let near = sample.saturating_sub(3 * every).min(steps.len())..(sample + 2 * every).min(steps.len());
        let largest = steps[near].iter().copied().fold(0.0, f64::max);
        let at = steps.len() * 9 / 10;
        let usual = if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(at, f64::total_cmp).1 };
        largest > 2.0 * usual
    })
}
