//! A program with what it needs besides the leaves of a run: blocks worked off one after the other.

use super::dense::Dense;
use super::execution::{BLOCK, Execution, PLANE};
use super::leaves::Leaves;
use super::program::{DATA, FLAGS};
use super::response::Prepared;
use crate::linear::Values;
use crate::simulate::Planes;
use num_complex::Complex64;
use std::ops::Range;
use std::sync::Arc;

/// A program and its memory.
pub(super) struct Ready {
    pub(super) prepared: Arc<Prepared>,
    /// Registers of the program.
    registers: usize,
    /// Outputs of a block.
    y: Vec<f64>,
    /// What solves by numbers, once it was needed.
    dense: Option<Dense>,
    /// Leaves at one frequency.
    at: Vec<Complex64>,
}

impl Ready {
    /// A program that works in the memory of `leaves`.
    pub(super) fn new(prepared: Arc<Prepared>, leaves: &mut Leaves) -> Self {
        let registers = prepared.program.as_ref().map_or(0, |p| p.registers);
        leaves.reserve(registers + prepared.wiring.planes());
        let y = vec![0.0; prepared.wiring.structure.outputs * PLANE];
        Self { registers, y, dense: None, at: Vec::new(), prepared }
    }

    /// Prepares what all frequencies share where there is no program.
    pub(super) fn prepare(&mut self, values: &Values) {
        if self.prepared.program.is_none() {
            let Self { dense, prepared, .. } = self;
            dense.get_or_insert_with(|| Dense::new(&prepared.wiring)).prepare(&prepared.wiring, values);
        }
    }

    /// Where the planes of derivatives stand.
    fn derivatives(&self, leaves: &Leaves) -> Range<usize> {
        let first = leaves.behind() + self.registers;
        first * PLANE..(first + self.prepared.wiring.planes()) * PLANE
    }

    /// Solves one block of frequencies.
    ///
    /// # Errors
    /// The first frequency, counted in the block, at which there is no solution.
    pub(super) fn solve(
        &mut self,
        leaves: &mut Leaves,
        (block, omega): (usize, &[f64]),
        values: &Values,
        (ends, scalars): (&[f64], &[f64]),
    ) -> Result<(), usize> {
        let Some(program) = &self.prepared.program else { return self.repair(leaves, (block, omega), values, ends) };
        let (first, registers) = (leaves.block(block), leaves.behind());
        let (lanes, memory) = (omega.len().next_multiple_of(8), &mut leaves.memory);
        Execution { program, scalars, memory, leaves: first, registers, lanes }.run();
        for (output, y) in program.outputs.iter().zip(self.y.chunks_exact_mut(PLANE)) {
            let plane = match output {
                Some(plane) if plane & DATA == 0 => registers + *plane as usize,
                Some(leaf) => first + (leaf & !DATA) as usize,
                None => {
                    y.fill(0.0);
                    continue;
                }
            };
            y.copy_from_slice(&leaves.memory[plane * PLANE..][..PLANE]);
        }
        let flags = &leaves.memory[(registers + FLAGS as usize) * PLANE + BLOCK..][..omega.len()];
        if flags.iter().all(|flag| *flag == 0.0) { Ok(()) } else { self.repair(leaves, (block, omega), values, ends) }
    }

    /// Solves flagged frequencies, without a program all, by numbers.
    fn repair(
        &mut self,
        leaves: &mut Leaves,
        (block, omega): (usize, &[f64]),
        values: &Values,
        ends: &[f64],
    ) -> Result<(), usize> {
        let derivatives = self.derivatives(leaves);
        let Self { prepared, dense, at, y, .. } = self;
        let dense = dense.get_or_insert_with(|| Dense::new(&prepared.wiring));
        at.resize(prepared.wiring.leaves(), Complex64::default());
        for (k, w) in omega.iter().enumerate() {
            let program = prepared.program.is_some();
            let flags = (leaves.behind() + FLAGS as usize) * PLANE + k;
            if program && leaves.memory[flags + BLOCK] == 0.0 {
                continue;
            }
            // outputs have the same bits whatever else is asked for
            let outputs = if program && leaves.memory[flags] == 0.0 { 0 } else { dense.y.len() };
            at.iter_mut().enumerate().for_each(|(leaf, at)| *at = leaves.get(leaf as u32, block * BLOCK + k));
            dense.solve(&prepared.wiring, values, ends, *w, at).map_err(|_| k)?;
            let planes = leaves.memory[derivatives.clone()].chunks_exact_mut(PLANE).zip(&dense.derivatives);
            for (plane, value) in planes.chain(y.chunks_exact_mut(PLANE).zip(&dense.y[..outputs])) {
                (plane[k], plane[BLOCK + k]) = (value.re, value.im);
            }
        }
        // what is behind the last frequency repeats it without inputs, and zero times infinity is not zero
        for plane in leaves.memory[derivatives].chunks_exact_mut(PLANE).chain(y.chunks_exact_mut(PLANE)) {
            plane[omega.len()..BLOCK].fill(0.0);
            plane[BLOCK + omega.len()..].fill(0.0);
        }
        Ok(())
    }

    /// The block that was solved last.
    pub(super) fn planes<'p>(&'p self, leaves: &'p mut Leaves, first: usize, count: usize) -> Planes<'p> {
        let derivatives = self.derivatives(leaves);
        let (derivatives, layout) = (&mut leaves.memory[derivatives], &self.prepared.wiring.layout);
        Planes { first, count, lanes: count.next_multiple_of(8), y: &self.y, derivatives, layout }
    }
}
