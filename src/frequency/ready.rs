//! A program with the memory for one run: leaves filled, blocks worked off one after the other.

use super::delayed_input::DelayedInput;
use super::dense::Dense;
use super::ends::{Ends, turn};
use super::execution::{BLOCK, Execution, INVERSE, OMEGA, PLANE};
use super::program::{DATA, FLAGS};
use super::response::Prepared;
use crate::linear::Values;
use crate::simulate::Planes;
use crate::simulate::vectors::Aligned;
use num_complex::Complex64;
use std::sync::Arc;

/// A program and its memory.
pub(super) struct Ready {
    pub(super) prepared: Arc<Prepared>,
    /// Registers, planes of derivatives, then the leaves of all blocks.
    memory: Aligned,
    /// Planes before the derivatives, and before the leaves.
    registers: usize,
    leaves: usize,
    /// Outputs of a block.
    y: Vec<f64>,
    dense: Dense,
    /// Leaves at one frequency.
    at: Vec<Complex64>,
    /// exp(-j w tau) of one delay.
    turned: Vec<Complex64>,
    /// The delays for which the leaves stand.
    tau: Vec<f64>,
}

impl Ready {
    pub(super) fn new(prepared: Arc<Prepared>, omega: &[f64], inputs: &[Complex64], ends: &Ends) -> Self {
        let wiring = &prepared.wiring;
        let registers = prepared.program.as_ref().map_or(0, |p| p.registers);
        let (leaves, each, blocks) = (registers + wiring.planes(), wiring.leaves(), omega.len().div_ceil(BLOCK));
        let mut ready = Self {
            memory: Aligned::new((leaves + blocks * each) * PLANE),
            registers,
            leaves,
            y: vec![0.0; wiring.structure.outputs * PLANE],
            dense: Dense::new(wiring),
            at: vec![Complex64::default(); each],
            turned: Vec::new(),
            tau: vec![f64::NAN; wiring.structure.delayed.len()],
            prepared: prepared.clone(),
        };
        let last = omega.last().copied().unwrap_or(1.0);
        for k in 0..blocks * BLOCK {
            // lanes behind the last frequency repeat it, without inputs
            let w = omega.get(k).copied().unwrap_or(last);
            ready.put(INVERSE, k, Complex64::new(0.0, -1.0 / w));
            ready.put(OMEGA, k, Complex64::new(0.0, w));
        }
        for (j, plane) in inputs.chunks(omega.len().max(1)).enumerate() {
            ready.put_all(wiring.input_leaf(j, false), plane);
        }
        for (known, (_, plane)) in ends.known.iter().enumerate() {
            ready.put_all(wiring.end_leaf(known), plane);
        }
        for (input, plane) in ends.inputs.iter().enumerate() {
            ready.put_all(wiring.input_end_leaf(input), plane);
        }
        for (factor, plane) in ends.factors.iter().enumerate() {
            ready.put_all(wiring.factor_leaf(factor), plane);
        }
        ready
    }

    /// Where a leaf stands for a frequency.
    fn place(&self, leaf: u32, k: usize) -> usize {
        (self.leaves + k / BLOCK * self.at.len() + leaf as usize) * PLANE + k % BLOCK
    }

    fn put(&mut self, leaf: u32, k: usize, value: Complex64) {
        let place = self.place(leaf, k);
        (self.memory[place], self.memory[place + BLOCK]) = (value.re, value.im);
    }

    fn get(&self, leaf: u32, k: usize) -> Complex64 {
        let place = self.place(leaf, k);
        Complex64::new(self.memory[place], self.memory[place + BLOCK])
    }

    fn put_all(&mut self, leaf: u32, plane: &[Complex64]) {
        plane.iter().enumerate().for_each(|(k, value)| self.put(leaf, k, *value));
    }

    /// Prepares what all frequencies share where there is no program.
    pub(super) fn prepare(&mut self, values: &Values) {
        if self.prepared.program.is_none() {
            self.dense.prepare(&self.prepared.wiring, values);
        }
    }

    /// Fills the leaves of delays that have changed.
    pub(super) fn delay(
        &mut self,
        tau: &[f64],
        (omega, spacing): (&[f64], Option<f64>),
        inputs: &mut [Option<DelayedInput>],
    ) {
        for (d, tau) in tau.iter().copied().enumerate() {
            if self.tau[d] == tau {
                continue;
            }
            self.tau[d] = tau;
            self.turn_by(d, tau, omega, spacing);
            let prepared = self.prepared.clone();
            let wiring = &prepared.wiring;
            if !wiring.ended {
                continue;
            }
            let leaf = wiring.delay_leaf(d);
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
    fn turn_by(&mut self, d: usize, tau: f64, omega: &[f64], spacing: Option<f64>) {
        let leaf = self.prepared.wiring.delay_leaf(d);
        let Some(step) = spacing.filter(|_| omega.len() > 8) else {
            return omega.iter().enumerate().for_each(|(k, w)| self.put(leaf, k, turn(-w * tau)));
        };
        let mut table = [Complex64::new(1.0, 0.0); BLOCK];
        let mut filled = 1;
        while filled < BLOCK.min(omega.len()) {
            let doubling = turn(-(filled as f64) * step * tau);
            (0..filled).for_each(|i| table[filled + i] = doubling * table[i]);
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

    /// Solves one block of frequencies.
    ///
    /// # Errors
    /// The first frequency, counted in the block, at which there is no solution.
    pub(super) fn solve(
        &mut self,
        block: usize,
        omega: &[f64],
        values: &Values,
        (ends, scalars): (&[f64], &[f64]),
    ) -> Result<(), usize> {
        let prepared = self.prepared.clone();
        let leaves = self.leaves + block * self.at.len();
        let mut flagged = true;
        if let Some(program) = &prepared.program {
            let lanes = omega.len().next_multiple_of(8);
            Execution { program, scalars, memory: &mut self.memory, leaves, lanes }.run();
            for (o, output) in program.outputs.iter().enumerate() {
                let y = &mut self.y[o * PLANE..][..PLANE];
                match output {
                    Some(plane) if plane & DATA == 0 => {
                        y.copy_from_slice(&self.memory[*plane as usize * PLANE..][..PLANE])
                    }
                    Some(leaf) => {
                        let place = (leaves + (leaf & !DATA) as usize) * PLANE;
                        y.copy_from_slice(&self.memory[place..][..PLANE]);
                    }
                    None => y.fill(0.0),
                }
            }
            flagged = self.memory[FLAGS as usize * PLANE + BLOCK..][..omega.len()].iter().any(|flag| *flag != 0.0);
        }
        if flagged { self.repair(block, omega, values, ends) } else { Ok(()) }
    }

    /// Solves flagged frequencies, without a program all, by numbers.
    fn repair(&mut self, block: usize, omega: &[f64], values: &Values, ends: &[f64]) -> Result<(), usize> {
        let prepared = self.prepared.clone();
        let derivatives = self.registers * PLANE..self.leaves * PLANE;
        for (k, w) in omega.iter().enumerate() {
            let program = prepared.program.is_some();
            let flags = FLAGS as usize * PLANE + k;
            if program && self.memory[flags + BLOCK] == 0.0 {
                continue;
            }
            // outputs have the same bits whatever else is asked for
            let outputs = if program && self.memory[flags] == 0.0 { 0 } else { self.dense.y.len() };
            (0..self.at.len()).for_each(|leaf| self.at[leaf] = self.get(leaf as u32, block * BLOCK + k));
            self.dense.solve(&prepared.wiring, values, ends, *w, &self.at).map_err(|_| k)?;
            let planes = self.memory[derivatives.clone()].chunks_exact_mut(PLANE).zip(&self.dense.derivatives);
            for (plane, value) in planes.chain(self.y.chunks_exact_mut(PLANE).zip(&self.dense.y[..outputs])) {
                (plane[k], plane[BLOCK + k]) = (value.re, value.im);
            }
        }
        // what is behind the last frequency repeats it without inputs, and zero times infinity is not zero
        for plane in self.memory[derivatives].chunks_exact_mut(PLANE).chain(self.y.chunks_exact_mut(PLANE)) {
            plane[omega.len()..BLOCK].fill(0.0);
            plane[BLOCK + omega.len()..].fill(0.0);
        }
        Ok(())
    }

    /// The block that was solved last.
    pub(super) fn planes(&mut self, first: usize, count: usize) -> Planes<'_> {
        let derivatives = &mut self.memory[self.registers * PLANE..self.leaves * PLANE];
        let layout = &self.prepared.wiring.layout;
        Planes { first, count, lanes: count.next_multiple_of(8), y: &self.y, derivatives, layout }
    }
}
