//! What noise may be of which too little is known to choose: white, or forgetting (at a dozen rates), or swinging while it forgets (a dozen periods,
//! narrow and wide), each of these rough or smooth, with parts that are white.

use super::combination::Member;
use super::forgetful::{Clock, Forgetful};
use std::f64::consts::TAU;

/// Belief, before anything is measured, that all noise is white.
const WHITE: f64 = 0.85;
/// What is left of it: for rough noise that forgets, for smooth noise that forgets, and for noise that swings.
const SHARES: [f64; 3] = [0.7, 0.1, 0.2];
/// White parts of rough noise that forgets, and of all others.
const PARTS: [f64; 3] = [0.0, 0.3, 0.6];
const OTHER_PARTS: [f64; 2] = [0.0, 0.4];
/// Angles by which swinging noise turns until it has forgotten.
const TURNS: [f64; 2] = [2.0, 6.0];
/// Factor from one period to the next, at most.
const PERIOD_STEP: f64 = 1.4;
/// Shortest time in which noise forgets, in intervals.
const SHORTEST: f64 = 0.4;
/// Longest, in lengths of the longest record; smooth noise remembers for more than twice its time, and longer ones are trends.
const LONGEST: f64 = 2.0;
const LONGEST_SMOOTH: f64 = 0.25;
/// Longest period, in the same.
const LONGEST_PERIOD: f64 = 0.25;
/// Factor from one time to the next, at most.
const STEP: f64 = 1.7;

/// The middle one of all intervals.
pub(super) fn interval(members: &[Member<'_>]) -> f64 {
    let steps = |m: &Member<'_>| m.rows.moments.windows(2).map(|t| t[1] - t[0]).collect::<Vec<f64>>();
    let mut all: Vec<f64> = members.iter().flat_map(steps).collect();
    let middle = all.len() / 2;
    let interval = if all.is_empty() { 0.0 } else { *all.select_nth_unstable_by(middle, f64::total_cmp).1 };
    if interval > 0.0 { interval } else { 1.0 }
}

/// All beliefs, white noise the first, and what each of the others has of the belief that the noise is not white.
pub(super) fn beliefs(members: &[Member<'_>], interval: f64) -> (Vec<Forgetful>, Vec<f64>) {
    let span = |m: &Member<'_>| m.rows.moments.last().unwrap_or(&0.0) - m.rows.moments.first().unwrap_or(&0.0);
    let length = members.iter().map(span).fold(interval, f64::max);
    let count = members.iter().map(|m| m.rows.moments.len()).max().unwrap_or(2) as f64;
    let uneven = members.iter().any(|m| !m.rows.even);
    let clocks = [(Clock::Time, interval, length), (Clock::Count, 1.0, count)];
    let (mut rough, mut smooth, mut swinging) = (Vec::new(), Vec::new(), Vec::new());
    for (clock, interval, length) in clocks.into_iter().take(1 + usize::from(uneven)) {
        for constant in spaced(SHORTEST * interval, LONGEST * length, STEP) {
            let noise = |smooth, white| Forgetful { constant, turning: 0.0, smooth, white, clock };
            rough.extend(PARTS.map(|white| noise(false, white)));
            if constant < LONGEST_SMOOTH * length {
                smooth.extend(OTHER_PARTS.map(|white| noise(true, white)));
            }
        }
    }
    for turning in spaced(2.0 * interval, LONGEST_PERIOD * length, PERIOD_STEP).map(|period| TAU / period) {
        for (turns, smooth) in TURNS.into_iter().flat_map(|t| [(t, false), (t, true)]) {
            let constant = turns / turning;
            let noise = |white| Forgetful { constant, turning, smooth, white, clock: Clock::Time };
            swinging.extend(OTHER_PARTS.map(noise));
        }
    }
    let (mut all, mut shares) = (vec![Forgetful::WHITE], Vec::new());
    for (beliefs, share) in [rough, smooth, swinging].into_iter().zip(SHARES) {
        shares.extend(beliefs.iter().map(|_| share / beliefs.len() as f64));
        all.extend(beliefs);
    }
    (all, shares)
}

/// Logarithm of how likely each belief is before anything is measured, where so many outputs have each its own.
pub(super) fn before(shares: &[f64], outputs: usize) -> Vec<f64> {
    let white = WHITE.powf(1.0 / outputs as f64);
    std::iter::once(white.ln()).chain(shares.iter().map(|share| ((1.0 - white) * share).ln())).collect()
}

/// From one number to the other in equal factors that are at most `step`.
fn spaced(from: f64, to: f64, step: f64) -> impl Iterator<Item = f64> {
    let to = to.max(from);
    let steps = ((to / from).ln() / step.ln()).ceil().max(1.0);
    (0..=steps as usize).map(move |k| from * (to / from).powf(k as f64 / steps))
}
