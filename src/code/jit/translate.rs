//! One program to Cranelift's notation: what each operation is in machine code.
//!
//! Loads stand beside their use, not at the entry: so they become operands of the arithmetic instead of occupying
//! registers.

use super::module::Callees;
use cranelift_codegen::ir::condcodes::FloatCC;
use cranelift_codegen::ir::{InstBuilder, MemFlagsData, Value, types};
use cranelift_frontend::FunctionBuilder;
use fdm_grammar::op::Op;
use fdm_grammar::schedule::{Instruction, Operand, Program};

/// Where leaves are found.
#[derive(Clone, Copy)]
pub(super) struct Leaves<'a> {
    pub(super) time: Value,
    pub(super) states: States<'a>,
    /// Address of the drive, and the bytes to skip.
    pub(super) drive: (Value, usize),
    /// Address of what `prepare` computed.
    pub(super) known: Value,
    /// Address of the program's constants.
    pub(super) constants: Value,
}

/// Where states are found.
#[derive(Clone, Copy)]
pub(super) enum States<'a> {
    /// At an address.
    Memory(Value),
    /// In registers, as results of the stage before.
    Registers(&'a [Value]),
}

/// A number, and the flag that it was made of when it is a condition.
#[derive(Clone, Copy)]
struct Translated {
    number: Value,
    flag: Option<Value>,
}

/// A program while it is translated.
pub(super) struct Translator<'p> {
    program: &'p Program,
    /// Instructions that depend on a state.
    varies: Vec<bool>,
    done: Vec<Option<Translated>>,
    pending: Vec<u32>,
}

impl<'p> Translator<'p> {
    pub(super) fn new(program: &'p Program) -> Self {
        let mut varies: Vec<bool> = Vec::with_capacity(program.instructions.len());
        for instruction in &program.instructions {
            let moves = |o: &Operand| match o {
                Operand::State(_) => true,
                Operand::Value(k) => varies[*k as usize],
                _ => false,
            };
            let v = instruction.args.iter().any(moves);
            varies.push(v);
        }
        Self { program, varies, done: vec![None; program.instructions.len()], pending: Vec::new() }
    }

    /// Forgets what was translated for one point, before the next; time and drive may stay the same.
    pub(super) fn forget(&mut self, same_drive: bool) {
        for (done, varies) in self.done.iter_mut().zip(&self.varies) {
            if *varies || !same_drive {
                *done = None;
            }
        }
    }

    /// Translates a result and everything that it needs and that is not there yet.
    pub(super) fn value(
        &mut self,
        operand: Operand,
        leaves: Leaves<'_>,
        builder: &mut FunctionBuilder<'_>,
        callees: &mut Callees<'_>,
    ) -> Value {
        if let Operand::Value(k) = operand {
            self.pending.push(k);
        }
        while let Some(k) = self.pending.last().copied() {
            let instruction = self.program.instructions[k as usize];
            let missing = |o: &Operand| matches!(o, Operand::Value(v) if self.done[*v as usize].is_none());
            if self.done[k as usize].is_some() {
                self.pending.pop();
            } else if let Some(Operand::Value(v)) = instruction.args.iter().find(|o| missing(o)) {
                self.pending.push(*v);
            } else {
                self.done[k as usize] = Some(self.instruction(instruction, leaves, builder, callees));
                self.pending.pop();
            }
        }
        self.operand(operand, leaves, builder)
    }

    fn operand(&self, operand: Operand, leaves: Leaves<'_>, builder: &mut FunctionBuilder<'_>) -> Value {
        match operand {
            Operand::Value(k) => self.done[k as usize].map_or(leaves.time, |t| t.number),
            Operand::Constant(k) => load(builder, leaves.constants, k as usize),
            Operand::Time => leaves.time,
            Operand::State(k) => match leaves.states {
                States::Memory(address) => load(builder, address, k as usize),
                States::Registers(values) => values[k as usize],
            },
            Operand::Drive(k) => load(builder, leaves.drive.0, leaves.drive.1 + k as usize),
            Operand::Known(k) => load(builder, leaves.known, k as usize),
        }
    }

    fn instruction(
        &self,
        instruction: Instruction,
        leaves: Leaves<'_>,
        builder: &mut FunctionBuilder<'_>,
        callees: &mut Callees<'_>,
    ) -> Translated {
        let (op, arity) = (instruction.op, instruction.op.row().arity);
        if op == Op::Select {
            let flag = self.flag(instruction.args[0], leaves, builder);
            let [a, b] = [1, 2].map(|k| self.operand(instruction.args[k], leaves, builder));
            return Translated { number: builder.ins().select(flag, a, b), flag: None };
        }
        if op == Op::Mul
            && let Some(other) = self.doubled(&instruction)
        {
            let a = self.operand(other, leaves, builder);
            return Translated { number: builder.ins().fadd(a, a), flag: None };
        }
        let a = self.operand(instruction.args[0], leaves, builder);
        let b = if arity > 1 { self.operand(instruction.args[1], leaves, builder) } else { a };
        if op.is_condition() {
            return condition(op, a, b, builder);
        }
        let number = match callees.of(op, builder.func) {
            Some(function) => {
                let call = builder.ins().call(function, &[a, b][..arity]);
                builder.inst_results(call)[0]
            }
            None => inline(op, a, b, builder),
        };
        Translated { number, flag: None }
    }

    /// The other factor of a product with two: their sum is the same to the bit, and on most machines the adders have
    /// less to do than the multipliers.
    fn doubled(&self, instruction: &Instruction) -> Option<Operand> {
        let two = |o: Operand| matches!(o, Operand::Constant(k) if self.program.constants[k as usize] == 2.0);
        let [a, b, _] = instruction.args;
        if two(a) { Some(b) } else { two(b).then_some(a) }
    }

    /// Whether a condition holds: is not zero, as in [`fdm_grammar::math::select`].
    fn flag(&self, operand: Operand, leaves: Leaves<'_>, builder: &mut FunctionBuilder<'_>) -> Value {
        let known = if let Operand::Value(k) = operand { self.done[k as usize].and_then(|t| t.flag) } else { None };
        known.unwrap_or_else(|| {
            let number = self.operand(operand, leaves, builder);
            let zero = builder.ins().f64const(0.0);
            builder.ins().fcmp(FloatCC::NotEqual, number, zero)
        })
    }
}

fn condition(op: Op, a: Value, b: Value, builder: &mut FunctionBuilder<'_>) -> Translated {
    let relation = match op {
        Op::Less => FloatCC::LessThan,
        Op::LessEqual => FloatCC::LessThanOrEqual,
        _ => FloatCC::Equal,
    };
    let flag = builder.ins().fcmp(relation, a, b);
    let (one, zero) = (builder.ins().f64const(1.0), builder.ins().f64const(0.0));
    Translated { number: builder.ins().select(flag, one, zero), flag: Some(flag) }
}

/// What hardware computes; equal to [`fdm_grammar::math`] to the bit, NaN for NaN.
fn inline(op: Op, a: Value, b: Value, builder: &mut FunctionBuilder<'_>) -> Value {
    match op {
        Op::Add => builder.ins().fadd(a, b),
        Op::Sub => builder.ins().fsub(a, b),
        Op::Mul => builder.ins().fmul(a, b),
        Op::Div => builder.ins().fdiv(a, b),
        Op::Neg => builder.ins().fneg(a),
        Op::Sqrt => builder.ins().sqrt(a),
        Op::Abs => builder.ins().fabs(a),
        Op::Sign => sign(a, builder),
        Op::Min => extremum(b, a, a, b, builder),
        Op::Max => extremum(a, b, a, b, builder),
        // everything else is called
        _ => builder.ins().f64const(f64::NAN),
    }
}

/// `b` where `p < q`, else `a`; the sum, which is NaN, where there is no order. On x86 the choice is one `minsd`, and
/// the test for NaN a branch that is never taken.
fn extremum(p: Value, q: Value, a: Value, b: Value, builder: &mut FunctionBuilder<'_>) -> Value {
    let less = builder.ins().fcmp(FloatCC::LessThan, p, q);
    let chosen = builder.ins().select(less, b, a);
    let sum = builder.ins().fadd(a, b);
    let unordered = builder.ins().fcmp(FloatCC::Unordered, a, b);
    builder.ins().select(unordered, sum, chosen)
}

/// One with the sign of `a`; `a * 0`, which is zero or NaN, where `a` is neither above nor below zero.
fn sign(a: Value, builder: &mut FunctionBuilder<'_>) -> Value {
    let (zero, one) = (builder.ins().f64const(0.0), builder.ins().f64const(1.0));
    let signed = builder.ins().fcopysign(one, a);
    let rest = builder.ins().fmul(a, zero);
    let beside = builder.ins().fcmp(FloatCC::OrderedNotEqual, a, zero);
    builder.ins().select(beside, signed, rest)
}

/// Element `k` at an address.
pub(super) fn load(builder: &mut FunctionBuilder<'_>, address: Value, k: usize) -> Value {
    builder.ins().load(types::F64, MemFlagsData::trusted(), address, offset(k))
}

/// Writes element `k` at an address.
pub(super) fn store(builder: &mut FunctionBuilder<'_>, value: Value, address: Value, k: usize) {
    builder.ins().store(MemFlagsData::trusted(), value, address, offset(k));
}

/// In bytes; arrays of programs that are compiled are far below 2 GiB.
fn offset(k: usize) -> i32 {
    i32::try_from(8 * k).unwrap_or(i32::MAX)
}
