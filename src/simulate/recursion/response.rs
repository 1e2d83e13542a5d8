//! The response alone: with no parameters to fill them, the lanes hold the states.
//!
//! The sums have the terms of [`LinearMap`] in the same order, so that the response has the same bits with and without its
//! sensitivities.

use super::map::LinearMap;
use crate::simulate::vectors::{Aligned, VECTOR};
use pulp::Simd;

/// The maps of one subsystem, columns of their matrices in lanes.
pub(super) struct Response {
    states: usize,
    /// Lanes of the states, whole vectors.
    pub(super) width: usize,
    /// For each length of a step the coefficients of the feed and then of the states, by width.
    columns: Vec<Aligned>,
}

impl Response {
    pub(super) fn new(states: usize, terms: usize, kinds: usize) -> Self {
        let width = states.next_multiple_of(VECTOR);
        let columns = (0..kinds).map(|_| Aligned::new((terms + states) * width)).collect();
        Self { states, width, columns }
    }

    /// Takes over the coefficients of one length.
    pub(super) fn fill(&mut self, kind: usize, map: &mut LinearMap) {
        let (states, width, lane, terms) = (self.states, self.width, map.lane, map.terms);
        let columns = &mut self.columns[kind];
        for i in 0..states {
            for m in 0..terms {
                columns[m * width + i] = map.forcing_of(m, i)[lane];
            }
            for j in 0..states {
                columns[(terms + j) * width + i] = map.flow[j * states + i];
            }
        }
    }

    /// Steps of one length: `slots` holds the states before the first and takes those after each, `feed` has one row of
    /// `terms` numbers for every step.
    #[inline(always)]
    pub(super) fn march<S: Simd>(
        &self,
        simd: S,
        kind: usize,
        slots: &mut [f64],
        (feed, terms): (&[f64], usize),
        count: usize,
    ) {
        for k in 0..count {
            self.step(simd, kind, &mut slots[k * self.width..(k + 2) * self.width], &feed[k * terms..][..terms]);
        }
    }

    /// One of these steps: the states before it and after it stand in `slots`.
    #[inline(always)]
    pub(super) fn step<S: Simd>(&self, simd: S, kind: usize, slots: &mut [f64], feed: &[f64]) {
        match self.width / S::F64_LANES {
            1 => self.vectors::<S, 1>(simd, kind, 0, slots, feed),
            across => {
                for v in 0..across {
                    self.vectors::<S, 0>(simd, kind, v, slots, feed);
                }
            }
        }
    }

    /// One vector of states, of W in all (any number when that is 0).
    #[inline(always)]
    fn vectors<S: Simd, const W: usize>(&self, simd: S, kind: usize, v: usize, slots: &mut [f64], feed: &[f64]) {
        let across = if W > 0 { W } else { self.width / S::F64_LANES };
        let (before, after) = slots.split_at_mut(self.width);
        let (by_feed, by_state) = S::as_simd_f64s(&self.columns[kind]).0.split_at(feed.len() * across);
        let (before, by_state) = (&before[..self.states], &by_state[..self.states * across]);
        let mut sum = simd.splat_f64s(0.0);
        for m in 0..feed.len() {
            sum = simd.mul_add_f64s(simd.splat_f64s(feed[m]), by_feed[m * across + v], sum);
        }
        for j in 0..before.len() {
            sum = simd.mul_add_f64s(simd.splat_f64s(before[j]), by_state[j * across + v], sum);
        }
        S::as_mut_simd_f64s(after).0[v] = sum;
    }
}
