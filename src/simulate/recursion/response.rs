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
        let (width, across) = (self.width, self.width / S::F64_LANES);
        let columns = S::as_simd_f64s(&self.columns[kind]).0;
        let (by_feed, by_state) = columns.split_at(terms * across);
        for k in 0..count {
            let (before, after) = slots[k * width..(k + 2) * width].split_at_mut(width);
            let (before, feed) = (&before[..self.states], &feed[k * terms..][..terms]);
            let after = S::as_mut_simd_f64s(after).0;
            for v in 0..across {
                let mut sum = simd.splat_f64s(0.0);
                for m in 0..terms {
                    sum = simd.mul_add_f64s(simd.splat_f64s(feed[m]), by_feed[m * across + v], sum);
                }
                for j in 0..before.len() {
                    sum = simd.mul_add_f64s(simd.splat_f64s(before[j]), by_state[j * across + v], sum);
                }
                after[v] = sum;
            }
        }
    }
}
