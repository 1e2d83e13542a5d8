//! The functions of a generated file: their programs, what they read and write, and where each result goes.
//!
//! A long program cut into pieces, and where values wait that a later piece reads.

use super::TooLong;
use super::notation::{Notation, function, operand, statements};
use crate::schedule::{Instruction, Layout, Operand, Placed, Program, Schedule};
use std::collections::BTreeSet;
use std::ops::Range;

/// An array that a function takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Array {
    /// Its name in the file.
    pub(super) name: &'static str,
    /// The constant that is its length.
    pub(super) length: &'static str,
}

const fn array(name: &'static str, length: &'static str) -> Array {
    Array { name, length }
}

pub(super) const X: Array = array("x", "STATES");
pub(super) const DRIVE: Array = array("drive", "DRIVE");
pub(super) const KNOWN: Array = array("known", "KNOWN");
pub(super) const THETA: Array = array("theta", "PARAMS");
pub(super) const F: Array = array("f", "STATES");
pub(super) const F_X: Array = array("f_x", "F_X_ENTRIES");
pub(super) const F_DELAYED: Array = array("f_delayed", "F_DELAYED_ENTRIES");
pub(super) const F_THETA: Array = array("f_theta", "F_THETA_ENTRIES");
pub(super) const F_U: Array = array("f_u", "F_U_ENTRIES");
pub(super) const Y: Array = array("y", "OUTPUTS");
pub(super) const Y_X: Array = array("y_x", "Y_X_ENTRIES");
pub(super) const Y_DELAYED: Array = array("y_delayed", "Y_DELAYED_ENTRIES");
pub(super) const Y_THETA: Array = array("y_theta", "Y_THETA_ENTRIES");
pub(super) const Y_U: Array = array("y_u", "Y_U_ENTRIES");

/// The results of a program that is none of the six.
const COLUMNS: Array = array("column", "COLUMNS");

/// A function of the file that runs a program.
pub(super) struct Entry<'a> {
    pub(super) name: &'static str,
    pub(super) about: &'static str,
    pub(super) program: &'a Program,
    /// Whether it takes the time in front of the arrays.
    pub(super) time: bool,
    pub(super) reads: &'static [Array],
    pub(super) writes: &'static [Array],
    /// For each slot of the program's result the array (by position in `writes`) and the place in it.
    slots: Vec<(usize, u32)>,
}

/// A function without its head: what it takes and its lines.
pub(super) struct Body {
    pub(super) name: String,
    /// Whether it reads the time, and which arrays it reads and writes.
    pub(super) time: bool,
    pub(super) reads: BTreeSet<Array>,
    pub(super) writes: BTreeSet<Array>,
    /// Whether it shares values with other pieces.
    pub(super) waits: bool,
    pub(super) lines: Vec<String>,
}

const POINT: &[Array] = &[X, DRIVE, KNOWN];

/// The six programs.
pub(super) fn entries(schedule: &Schedule) -> [Entry<'_>; 6] {
    let (layout, p) = (&schedule.layout, &schedule.layout.patterns);
    let in_order = |lengths: &[usize]| {
        let places = lengths.iter().enumerate().flat_map(|(a, length)| (0..*length as u32).map(move |k| (a, k)));
        places.collect::<Vec<_>>()
    };
    let entry =
        |name, about, program, time, reads, writes, slots| Entry { name, about, program, time, reads, writes, slots };
    [
        entry(
            "prepare",
            "Everything that depends on the parameters alone: call it once for each parameter vector.",
            &schedule.prepare,
            false,
            &[THETA],
            &[KNOWN],
            in_order(&[layout.known]),
        ),
        entry(
            "rates",
            "The derivatives of the states.",
            &schedule.rates,
            true,
            POINT,
            &[F],
            in_order(&[layout.states]),
        ),
        entry(
            "rates_and_partials",
            "The derivatives of the states and their partials by states, delayed signals and parameters.",
            &schedule.rates_and_partials,
            true,
            POINT,
            &[F, F_X, F_DELAYED, F_THETA],
            stage_slots(layout),
        ),
        entry("outputs", "The outputs.", &schedule.outputs, true, POINT, &[Y], in_order(&[layout.outputs])),
        entry(
            "outputs_and_partials",
            "The outputs and their partials by states, delayed signals and parameters.",
            &schedule.outputs_and_partials,
            true,
            POINT,
            &[Y, Y_X, Y_DELAYED, Y_THETA],
            in_order(&[layout.outputs, p.outputs_by_state.len(), p.outputs_by_delayed.len(), p.outputs_by_param.len()]),
        ),
        entry(
            "by_input",
            "The partials of rates and outputs by the inputs.",
            &schedule.by_input,
            true,
            POINT,
            &[F_U, Y_U],
            in_order(&[p.rates_by_input.len(), p.outputs_by_input.len()]),
        ),
    ]
}

/// The integrator's row undone: entries in the order of their patterns.
fn stage_slots(layout: &Layout) -> Vec<(usize, u32)> {
    let (stage, p) = (&layout.stage, &layout.patterns);
    let mut slots = vec![(0, 0); stage.width];
    (0..layout.states).for_each(|k| slots[k] = (0, k as u32));
    stage.by_state.iter().enumerate().for_each(|(k, slot)| slots[*slot as usize] = (1, k as u32));
    (0..p.rates_by_delayed.len()).for_each(|k| slots[stage.by_delayed + k] = (2, k as u32));
    for (k, i, j) in p.rates_by_param.entries() {
        if let Some(slot) = stage.by_param(i, j) {
            slots[slot] = (3, k as u32);
        }
    }
    slots
}

impl<'a> Entry<'a> {
    /// A program that is none of the six: the array `known` holds the parameters themselves.
    pub(super) fn alone(name: &'static str, program: &'a Program) -> Self {
        let slots = (0..program.width as u32).map(|k| (0, k)).collect();
        Self { name, about: "", program, time: true, reads: POINT, writes: &[COLUMNS], slots }
    }
    /// The pieces of the program and the number of places in which values wait between them; one piece waits for nothing.
    pub(super) fn bodies(&self, notation: &dyn Notation) -> Result<(Vec<Body>, u32), TooLong> {
        let pieces = Pieces::new(self.program)?;
        let alone = pieces.pieces.len() == 1;
        let bodies = pieces.pieces.iter().enumerate().map(|(number, piece)| {
            let name = if alone { self.name.to_string() } else { format!("{}_{number}", self.name) };
            self.body(name, piece, &pieces, notation)
        });
        Ok((bodies.collect(), pieces.places))
    }

    fn body(&self, name: String, piece: &Piece, pieces: &Pieces, notation: &dyn Notation) -> Body {
        let place = |o: Operand| match o {
            Operand::Value(k) if piece.instructions.contains(&(k as usize)) => format!("v{k}"),
            Operand::Value(k) => format!("w[{}]", pieces.waits[k as usize].unwrap_or_default()),
            Operand::Time => "t".into(),
            Operand::State(k) => format!("x[{k}]"),
            Operand::Drive(k) => format!("drive[{k}]"),
            Operand::Known(k) => format!("{}[{k}]", self.reads[self.reads.len() - 1].name),
            Operand::Constant(_) => String::new(),
        };
        let mut lines = Vec::new();
        let printed = statements(notation, self.program, piece.instructions.clone(), &place);
        for (k, line) in piece.instructions.clone().zip(printed) {
            lines.push(line);
            lines.extend(pieces.waits[k].map(|w| format!("w[{w}] = v{k};")));
        }
        let mut body = Body { name, time: false, reads: [].into(), writes: [].into(), waits: false, lines };
        for result in &piece.results {
            let (array, index) = self.slots[result.slot as usize];
            let value = operand(notation, self.program, result.operand, &place);
            body.lines.push(format!("{}[{index}] = {value};", self.writes[array].name));
            body.writes.insert(self.writes[array]);
        }
        let results = piece.results.iter().map(|r| r.operand);
        for read in self.program.instructions[piece.instructions.clone()].iter().flat_map(read).chain(results) {
            body.note(read, piece, self.reads);
        }
        body.waits |= piece.instructions.clone().any(|k| pieces.waits[k].is_some());
        body
    }
}

impl Body {
    /// Remembers what is read.
    fn note(&mut self, operand: Operand, piece: &Piece, reads: &[Array]) {
        match operand {
            Operand::Value(k) => self.waits |= !piece.instructions.contains(&(k as usize)),
            Operand::Constant(_) => {}
            Operand::Time => self.time = true,
            Operand::State(_) => drop(self.reads.insert(X)),
            Operand::Drive(_) => drop(self.reads.insert(DRIVE)),
            Operand::Known(_) => drop(self.reads.insert(reads[reads.len() - 1])),
        }
    }
}

fn read(instruction: &Instruction) -> impl Iterator<Item = Operand> + '_ {
    instruction.args[..instruction.op.row().arity].iter().copied()
}

/// The functions of [`crate::math`] that programs call, each once.
pub(super) fn functions<'p>(programs: impl IntoIterator<Item = &'p Program>) -> BTreeSet<&'static str> {
    let instructions = programs.into_iter().flat_map(|p| &p.instructions);
    instructions.map(|i| function(i.op)).filter(|name| !name.is_empty()).collect()
}

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
        // instructions and results of a piece; compilers take more than proportional time over longer functions
        Self::of(program, 1_000)
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
