//! A long program cut into pieces, and where values wait that a later piece reads.

use super::TooLong;
use crate::schedule::{Operand, Placed, Program};
use std::ops::Range;

/// Instructions and results of a piece; compilers take more than proportional time over longer functions.
const LONGEST: usize = 1_000;
/// Most values that wait at a time: half a mebibyte.
pub(super) const MOST_PLACES: u32 = 1 << 16;

/// A part of a program that becomes a function.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Piece {
    /// Which instructions.
    pub(super) instructions: Range<usize>,
    /// What it writes.
    pub(super) results: Vec<Placed>,
}

/// A program in pieces, in the order in which they are run.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Pieces {
    /// At least one.
    pub(super) pieces: Vec<Piece>,
    /// For each value the place where later pieces find it.
    pub(super) waits: Vec<Option<u32>>,
    /// Number of such places.
    pub(super) places: u32,
}

impl Pieces {
    pub(super) fn new(program: &Program) -> Result<Self, TooLong> {
        Self::of(program, LONGEST)
    }

    /// Every result is written where its value is computed; those that are no values stand at the end.
    pub(super) fn of(program: &Program, longest: usize) -> Result<Self, TooLong> {
        let length = program.instructions.len();
        let whole = length + program.results.len() <= longest;
        let cut = if whole { length.max(1) } else { (longest / 2).max(1) };
        let mut pieces: Vec<Piece> = (0..length.div_ceil(cut))
            .map(|p| Piece { instructions: p * cut..((p + 1) * cut).min(length), results: Vec::new() })
            .collect();
        let mut rest = Vec::new();
        for result in &program.results {
            match result.operand {
                Operand::Value(k) => pieces[k as usize / cut].results.push(*result),
                _ => rest.push(*result),
            }
        }
        match pieces.last_mut() {
            Some(last) if whole => last.results.append(&mut rest),
            _ => {
                pieces.extend(rest.chunks(cut.max(longest)).map(|r| Piece { results: r.to_vec(), ..Piece::default() }))
            }
        }
        if pieces.is_empty() {
            pieces.push(Piece::default());
        }
        let mut cut_up = Self { pieces, waits: vec![None; length], places: 0 };
        cut_up.settle(program, cut);
        if cut_up.places > MOST_PLACES { Err(TooLong { places: cut_up.places }) } else { Ok(cut_up) }
    }

    /// Gives a place to every value that a later piece reads; places are taken again behind the last such piece.
    fn settle(&mut self, program: &Program, cut: usize) {
        let mut last: Vec<usize> = (0..self.waits.len()).map(|k| k / cut).collect();
        for (k, instruction) in program.instructions.iter().enumerate() {
            for operand in &instruction.args[..instruction.op.row().arity] {
                if let Operand::Value(v) = operand {
                    last[*v as usize] = k / cut;
                }
            }
        }
        let mut free: Vec<u32> = Vec::new();
        let mut leaving: Vec<Vec<u32>> = vec![Vec::new(); self.pieces.len()];
        for p in 0..self.pieces.len() {
            for k in self.pieces[p].instructions.clone() {
                if last[k] > p {
                    let place = free.pop().unwrap_or_else(|| {
                        self.places += 1;
                        self.places - 1
                    });
                    self.waits[k] = Some(place);
                    leaving[last[k]].push(place);
                }
            }
            free.append(&mut leaving[p]);
        }
    }
}
