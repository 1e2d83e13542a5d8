//! What programs read: frequencies, inputs, delay factors and end terms of one run, in planes; behind them their registers.

use super::end_points::{DelayedInput, Ends, turn};
use super::program::{BLOCK, INVERSE, OMEGA, PLANE};
use super::wiring::Wiring;
use fdm_numeric::lanes::Aligned;
use num_complex::Complex64;

/// The memory of one run, which all programs for it share.
pub(super) struct Leaves {
    /// The leaves of all blocks, then registers and planes of derivatives.
    pub(super) memory: Aligned,
    /// Leaves of a block.
    each: usize,
    blocks: usize,
    /// exp(-j w tau) of one delay.
    turned: Vec<Complex64>,
    /// The delays for which the leaves stand.
    tau: Vec<f64>,
}

impl Leaves {
    /// The leaves of a run; they are the same for all columns that a wiring may ask for.
    pub(super) fn new(wiring: &Wiring, omega: &[f64], inputs: &[Complex64], ends: &Ends) -> Self {
        let (each, blocks) = (wiring.leaves(), omega.len().div_ceil(BLOCK));
        let mut leaves = Self {
            memory: Aligned::new(blocks * each * PLANE),
            each,
            blocks,
            turned: Vec::new(),
            tau: vec![f64::NAN; wiring.structure.delayed.len()],
        };
        let last = omega.last().copied().unwrap_or(1.0);
        for k in 0..blocks * BLOCK {
            // lanes behind the last frequency repeat it, without inputs
            let w = omega.get(k).copied().unwrap_or(last);
            leaves.put(INVERSE, k, Complex64::new(0.0, -1.0 / w));
            leaves.put(OMEGA, k, Complex64::new(0.0, w));
        }
        for (j, plane) in inputs.chunks(omega.len().max(1)).enumerate() {
            leaves.put_all(wiring.input_leaf(j, false), plane);
        }
        for (known, (_, plane)) in ends.known.iter().enumerate() {
            leaves.put_all(wiring.end_leaf(known), plane);
        }
        for (input, plane) in ends.inputs.iter().enumerate() {
            leaves.put_all(wiring.input_end_leaf(input), plane);
        }
        for (factor, plane) in ends.factors.iter().enumerate() {
            leaves.put_all(wiring.factor_leaf(factor), plane);
        }
        leaves
    }

    /// Makes room for so many planes behind the leaves.
    pub(super) fn reserve(&mut self, planes: usize) {
        let wanted = (self.behind() + planes) * PLANE;
        if self.memory.len() < wanted {
            let mut larger = Aligned::new(wanted);
            larger[..self.memory.len()].copy_from_slice(&self.memory);
            self.memory = larger;
        }
    }

    /// The first plane behind the leaves.
    pub(super) fn behind(&self) -> usize {
        self.blocks * self.each
    }

    /// The first leaf of a block.
    pub(super) fn block(&self, block: usize) -> usize {
        block * self.each
    }

    /// Where a leaf stands for a frequency.
    fn place(&self, leaf: u32, k: usize) -> usize {
        (k / BLOCK * self.each + leaf as usize) * PLANE + k % BLOCK
    }

    fn put(&mut self, leaf: u32, k: usize, value: Complex64) {
        let place = self.place(leaf, k);
        (self.memory[place], self.memory[place + BLOCK]) = (value.re, value.im);
    }

    /// A leaf at a frequency.
    pub(super) fn get(&self, leaf: u32, k: usize) -> Complex64 {
        let place = self.place(leaf, k);
        Complex64::new(self.memory[place], self.memory[place + BLOCK])
    }

    fn put_all(&mut self, leaf: u32, plane: &[Complex64]) {
        plane.iter().enumerate().for_each(|(k, value)| self.put(leaf, k, *value));
    }

    /// Fills the leaves of delays that have changed.
    pub(super) fn delay(
        &mut self,
        wiring: &Wiring,
        tau: &[f64],
        (omega, spacing): (&[f64], Option<f64>),
        inputs: &mut [Option<DelayedInput>],
    ) {
        for (d, tau) in tau.iter().copied().enumerate() {
            if self.tau[d] == tau {
                continue;
            }
            self.tau[d] = tau;
            let leaf = wiring.delay_leaf(d);
            self.turn_by(leaf, tau, omega, spacing);
            if !wiring.ended {
                continue;
            }
            let Some(input) = &mut inputs[d] else {
                let over = |v: Complex64, w: f64| Complex64::new(v.im / w, -v.re / w);
                for (k, w) in omega.iter().enumerate() {
                    let gap = over(self.get(leaf, k) - 1.0, *w);
                    self.put(wiring.gap_leaf(d), k, gap);
                    self.put(wiring.bow_leaf(d), k, over(gap + tau, *w));
                }
                continue;
            };
            let mut turned = std::mem::take(&mut self.turned);
            turned.clear();
            turned.extend((0..omega.len()).map(|k| self.get(leaf, k)));
            let leaves = [false, true].map(|shown| [wiring.delayed_leaf(d, shown), wiring.moved_leaf(d, shown)]);
            input.at(tau, omega, &turned, |k, delayed| {
                leaves.iter().flatten().zip(delayed).for_each(|(leaf, value)| self.put(*leaf, k, value));
            });
            self.turned = turned;
        }
    }

    /// Fills the leaf exp(-j w tau). On even frequencies each block turns one table, which is off by a few roundings; errors
    /// do not add up from block to block.
    fn turn_by(&mut self, leaf: u32, tau: f64, omega: &[f64], spacing: Option<f64>) {
        let Some(step) = spacing.filter(|_| omega.len() > 8) else {
            return omega.iter().enumerate().for_each(|(k, w)| self.put(leaf, k, turn(-w * tau)));
        };
        let mut table = [Complex64::new(1.0, 0.0); BLOCK];
        let mut filled = 1;
        while filled < BLOCK.min(omega.len()) {
            let doubling = turn(-(filled as f64) * step * tau);
            let (known, next) = table.split_at_mut(filled);
            next.iter_mut().zip(known).for_each(|(next, known)| *next = doubling * *known);
            filled *= 2;
        }
        for (block, omega) in omega.chunks(BLOCK).enumerate() {
            let (first, place) = (turn(-omega[0] * tau), self.place(leaf, block * BLOCK));
            let (re, im) = self.memory[place..][..PLANE].split_at_mut(BLOCK);
            for (k, turned) in table.iter().take(omega.len()).enumerate() {
                let value = first * turned;
                (re[k], im[k]) = (value.re, value.im);
            }
        }
    }
}
