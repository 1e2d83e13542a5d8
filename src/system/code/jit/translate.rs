//! One program to Cranelift's notation: what each operation is in machine code; and one whole Runge-Kutta step as one function, four stages in
//! line, the states in registers between them.
//!
//! Loads stand beside their use, not at the entry: so they become operands of the arithmetic instead of occupying
//! registers. A choice becomes a jump over a move on x86; conditions of a simulation seldom change from one step to
//! the next, so the jump is predicted and nothing waits for the condition.
//!
//! In a step the order of operations is that of `dynamics::runge_kutta`, so that the results are the same bits. Each stage
//! computes its rates first: the next stage waits for them, and for nothing else. On x86 a number that goes through
//! memory is some ten cycles late, so rates stay in registers until the next stage has begun (unless the program is so
//! long that this does not matter); for the sum at the end they are read back from the rows.
//!
//! In which order a program is written down, and which values wait in memory.
//!
//! What is waited for comes first, and what is stored comes as soon as it can be, so that little is alive at a time.
//! Cranelift's register allocator takes far more than linear time over values that live long: those wait in the
//! function's frame, from where they are operands of the arithmetic.

use super::Callees;
use cranelift_codegen::ir::condcodes::FloatCC;
use cranelift_codegen::ir::{InstBuilder, MemFlagsData, StackSlotData, StackSlotKind, Type, Value, types};
use cranelift_frontend::FunctionBuilder;
use fdm_grammar::op::Op;
use fdm_grammar::schedule::{Instruction, Layout, Operand, Placed, Program};

/// Where leaves are found at one point.
pub(super) struct Leaves<'a> {
    pub(super) time: Value,
    pub(super) states: States<'a>,
    /// Address of the drive, and the numbers to skip.
    pub(super) drive: (Value, usize),
    /// Address of what `prepare` computed.
    pub(super) known: Value,
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
    /// It was made for the point before, and stays in its register.
    inherited: bool,
}

/// A program while it is translated, as often as it has points.
pub(super) struct Translator<'a, 'f, 'm> {
    pub(super) builder: &'a mut FunctionBuilder<'f>,
    callees: &'a mut Callees<'m>,
    program: &'a Program,
    plan: &'a Plan,
    /// Instructions that depend on a state.
    varies: Vec<bool>,
    done: Vec<Option<Translated>>,
    /// Address of the program's constants.
    constants: Value,
    /// Address of the values that wait, and behind them the states.
    frame: Value,
}

impl<'a, 'f, 'm> Translator<'a, 'f, 'm> {
    /// Opens the function that evaluates a program as planned, with `states` states in registers; also its parameters.
    pub(super) fn new<const N: usize>(
        program: &'a Program,
        plan: &'a Plan,
        states: usize,
        builder: &'a mut FunctionBuilder<'f>,
        callees: &'a mut Callees<'m>,
    ) -> (Self, [Value; N]) {
        let block = builder.create_block();
        builder.append_block_params_for_function_params(block);
        builder.switch_to_block(block);
        builder.seal_block(block);
        let params = std::array::from_fn(|k| builder.block_params(block)[k]);
        let bytes = 8 * (plan.frame + states as u32);
        let slot = StackSlotData::new(StackSlotKind::ExplicitSlot, bytes, 3);
        let slot = builder.create_sized_stack_slot(slot);
        let pointer = callees.pointer();
        let frame = builder.ins().stack_addr(pointer, slot, 0);
        let constants = callees.constants(builder);
        let done = vec![None; program.instructions.len()];
        (Self { builder, callees, program, varies: varying(program), plan, done, constants, frame }, params)
    }

    /// Whether the program is so long that nothing stays in a register from its beginning to its end.
    pub(super) fn is_long(&self) -> bool {
        self.plan.tasks.len() > 4 * FAR
    }

    /// Translates the program for one point. Results are stored at `out` (address and numbers to skip); those in the
    /// first slots are also returned in `first`. `same_drive`: only the states differ from the point before.
    pub(super) fn point(
        &mut self,
        leaves: &Leaves<'_>,
        same_drive: bool,
        out: Option<(Value, usize)>,
        first: &mut [Value],
    ) {
        self.forget(same_drive && !self.is_long());
        self.put_states_aside(leaves);
        for position in 0..self.plan.tasks.len() {
            match self.plan.tasks[position] {
                Task::Compute(k) if self.done[k as usize].is_some() => {}
                Task::Compute(k) => {
                    let made = self.instruction(self.program.instructions[k as usize], leaves, position);
                    self.done[k as usize] = Some(made);
                    if let Some(place) = self.plan.waits[k as usize] {
                        store(self.builder, made.number, self.frame, place as usize);
                    }
                }
                Task::Write(result) => {
                    let value = self.operand(result.operand, leaves, position);
                    if let Some((address, skipped)) = out {
                        store(self.builder, value, address, skipped + result.slot as usize);
                    }
                    if let Some(kept) = first.get_mut(result.slot as usize) {
                        *kept = value;
                    }
                }
            }
        }
    }

    fn forget(&mut self, same_drive: bool) {
        for (done, varies) in self.done.iter_mut().zip(&self.varies) {
            *done = done.filter(|_| same_drive && !varies).map(|d| Translated { inherited: true, ..d });
        }
    }

    /// States in registers are wanted again when those are long taken by others.
    fn put_states_aside(&mut self, leaves: &Leaves<'_>) {
        if let States::Registers(states) = leaves.states
            && self.plan.tasks.len() > FAR
        {
            for (k, state) in states.iter().enumerate() {
                store(self.builder, *state, self.frame, self.plan.frame as usize + k);
            }
        }
    }

    fn operand(&mut self, operand: Operand, leaves: &Leaves<'_>, position: usize) -> Value {
        match operand {
            Operand::Value(k) => match (self.done[k as usize], self.plan.waits[k as usize]) {
                (Some(made), Some(place)) if !made.inherited && self.plan.is_far(k, position) => {
                    load(self.builder, self.frame, place as usize)
                }
                (Some(made), _) => made.number,
                // the plan computes operands first
                (None, _) => leaves.time,
            },
            Operand::Constant(k) => load(self.builder, self.constants, k as usize),
            Operand::Time => leaves.time,
            Operand::State(k) => match leaves.states {
                States::Memory(address) => load(self.builder, address, k as usize),
                States::Registers(_) if position > FAR => {
                    load(self.builder, self.frame, self.plan.frame as usize + k as usize)
                }
                States::Registers(values) => values[k as usize],
            },
            Operand::Drive(k) => load(self.builder, leaves.drive.0, leaves.drive.1 + k as usize),
            Operand::Known(k) => load(self.builder, leaves.known, k as usize),
        }
    }

    fn instruction(&mut self, instruction: Instruction, leaves: &Leaves<'_>, position: usize) -> Translated {
        let (op, args) = (instruction.op, instruction.args);
        let plain = |number| Translated { number, flag: None, inherited: false };
        if op == Op::Select {
            let flag = self.flag(args[0], leaves, position);
            let [a, b] = [args[1], args[2]].map(|o| self.operand(o, leaves, position));
            return plain(self.builder.ins().select(flag, a, b));
        }
        if op == Op::Mul
            && let Some(other) = self.doubled(&instruction)
        {
            let a = self.operand(other, leaves, position);
            return plain(self.builder.ins().fadd(a, a));
        }
        let arity = op.row().arity;
        let a = self.operand(args[0], leaves, position);
        let b = if arity > 1 { self.operand(args[1], leaves, position) } else { a };
        if op.is_condition() {
            return condition(op, a, b, self.builder);
        }
        plain(match self.callees.of(op, self.builder.func) {
            Some(function) => {
                let call = self.builder.ins().call(function, &[a, b][..arity]);
                self.builder.inst_results(call)[0]
            }
            None => inline(op, a, b, self.builder),
        })
    }

    /// The other factor of a product with two: their sum is the same to the bit, and on most machines the adders have
    /// less to do than the multipliers.
    fn doubled(&self, instruction: &Instruction) -> Option<Operand> {
        let two = |o: Operand| matches!(o, Operand::Constant(k) if self.program.constants[k as usize] == 2.0);
        let [a, b, _] = instruction.args;
        if two(a) { Some(b) } else { two(b).then_some(a) }
    }

    /// Whether a condition holds: is not zero, as in [`fdm_grammar::math::select`].
    fn flag(&mut self, operand: Operand, leaves: &Leaves<'_>, position: usize) -> Value {
        if let Operand::Value(k) = operand
            && let Some(Translated { flag: Some(flag), inherited, .. }) = self.done[k as usize]
            && (inherited || !self.plan.is_far(k, position))
        {
            return flag;
        }
        let number = self.operand(operand, leaves, position);
        let zero = self.builder.ins().f64const(0.0);
        self.builder.ins().fcmp(FloatCC::NotEqual, number, zero)
    }
}

/// For each instruction whether it depends on a state.
fn varying(program: &Program) -> Vec<bool> {
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
    varies
}

fn condition(op: Op, a: Value, b: Value, builder: &mut FunctionBuilder<'_>) -> Translated {
    let relation = match op {
        Op::Less => FloatCC::LessThan,
        Op::LessEqual => FloatCC::LessThanOrEqual,
        _ => FloatCC::Equal,
    };
    let flag = builder.ins().fcmp(relation, a, b);
    let (one, zero) = (builder.ins().f64const(1.0), builder.ins().f64const(0.0));
    Translated { number: builder.ins().select(flag, one, zero), flag: Some(flag), inherited: false }
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

/// Address of a compiled step: t, h, x, drive, known, next, rows.
pub(super) type Advance = unsafe extern "C" fn(f64, f64, *const f64, *const f64, *const f64, *mut f64, *mut f64);

/// The parameters of [`Advance`].
pub(super) fn step_params(pointer: Type) -> [Type; 7] {
    [types::F64, types::F64, pointer, pointer, pointer, pointer, pointer]
}

/// Translates a step of a program whose first results are the rates; with `rows` the results of each stage are stored
/// as one row of `rows`.
pub(super) fn step(
    program: &Program,
    plan: &Plan,
    layout: &Layout,
    rows: bool,
    builder: &mut FunctionBuilder<'_>,
    callees: &mut Callees<'_>,
) {
    let (n, width) = (layout.states, program.width);
    let (mut translator, params) = Translator::new(program, plan, n, builder, callees);
    let [t, h, x, drive, known, next, out] = params;
    let half = translator.builder.ins().f64const(0.5);
    let half = translator.builder.ins().fmul(half, h);
    let middle = translator.builder.ins().fadd(t, half);
    let end = translator.builder.ins().fadd(t, h);

    let mut slopes: Vec<Vec<Value>> = Vec::with_capacity(4);
    // time, row of the drive, reach from the step's beginning
    let stages = [(t, 0, None), (middle, 1, Some(half)), (middle, 1, Some(half)), (end, 2, Some(h))];
    for (stage, (time, row, reach)) in stages.into_iter().enumerate() {
        if rows
            && translator.is_long()
            && let Some(last) = slopes.last_mut()
        {
            *last = (0..n).map(|i| load(translator.builder, out, (stage - 1) * width + i)).collect();
        }
        let states = states(x, reach.zip(slopes.last()), n, translator.builder);
        let drive = (drive, row * layout.drive());
        let leaves = Leaves { time, states: States::Registers(&states), drive, known };
        let mut rates = vec![time; n];
        // the third stage stands where the second stood, but for the states
        translator.point(&leaves, stage == 2, rows.then_some((out, stage * width)), &mut rates);
        slopes.push(rates);
    }
    let again = |builder: &mut FunctionBuilder<'_>, stage: usize, i: usize| match rows && stage < 3 {
        true => load(builder, out, stage * width + i),
        false => slopes[stage][i],
    };
    finish(h, x, next, n, again, translator.builder);
    translator.builder.ins().return_(&[]);
}

/// The states of a stage: those of the step's beginning, moved by reach times slope.
fn states(x: Value, moved: Option<(Value, &Vec<Value>)>, n: usize, builder: &mut FunctionBuilder<'_>) -> Vec<Value> {
    let state = |i| {
        let from = load(builder, x, i);
        match moved {
            Some((reach, slopes)) => {
                let way = builder.ins().fmul(reach, slopes[i]);
                builder.ins().fadd(from, way)
            }
            None => from,
        }
    };
    (0..n).map(state).collect()
}

/// The weighted sum of the slopes.
fn finish(
    h: Value,
    x: Value,
    next: Value,
    n: usize,
    slope: impl Fn(&mut FunctionBuilder<'_>, usize, usize) -> Value,
    builder: &mut FunctionBuilder<'_>,
) {
    let (six, three) = (builder.ins().f64const(6.0), builder.ins().f64const(3.0));
    let (sixth, third) = (builder.ins().fdiv(h, six), builder.ins().fdiv(h, three));
    for i in 0..n {
        let [k1, k2, k3, k4] = std::array::from_fn(|stage| slope(builder, stage, i));
        let from = load(builder, x, i);
        let first = builder.ins().fmul(sixth, k1);
        let first = builder.ins().fadd(from, first);
        let inner = builder.ins().fadd(k2, k3);
        let inner = builder.ins().fmul(third, inner);
        let sum = builder.ins().fadd(first, inner);
        let last = builder.ins().fmul(sixth, k4);
        let sum = builder.ins().fadd(sum, last);
        store(builder, sum, next, i);
    }
}

/// Tasks between a value and a use of it that are too many for a register.
pub(super) const FAR: usize = 64;

/// One thing to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Task {
    /// An instruction.
    Compute(u32),
    /// A result.
    Write(Placed),
}

/// A program in the order of its code.
pub(super) struct Plan {
    pub(super) tasks: Vec<Task>,
    /// For each instruction its task.
    pub(super) at: Vec<usize>,
    /// For each instruction the place in the frame where it waits for far uses.
    pub(super) waits: Vec<Option<u32>>,
    /// Places in the frame.
    pub(super) frame: u32,
}

impl Plan {
    /// The first `urgent` results in turn, each preceded by those that it is made of; then the others as their
    /// instructions come in the program; at last those that need no instruction.
    pub(super) fn new(program: &Program, urgent: usize) -> Self {
        let mut tasks = Vec::with_capacity(program.instructions.len() + program.results.len());
        let mut done = vec![false; program.instructions.len()];
        for result in order(program, urgent) {
            compute(program, result.operand, &mut done, &mut tasks);
            tasks.push(Task::Write(result));
        }
        let mut at = vec![0; program.instructions.len()];
        for (position, task) in tasks.iter().enumerate() {
            if let Task::Compute(k) = task {
                at[*k as usize] = position;
            }
        }
        let mut plan = Self { tasks, at, waits: vec![None; program.instructions.len()], frame: 0 };
        plan.settle(program);
        plan
    }

    /// Whether a value has left its register when this task asks for it.
    pub(super) fn is_far(&self, value: u32, task: usize) -> bool {
        task - self.at[value as usize] > FAR
    }

    /// Gives a place in the frame to every value that is used far away; places are taken again.
    fn settle(&mut self, program: &Program) {
        let mut last = vec![0; program.instructions.len()];
        for (position, task) in self.tasks.iter().enumerate() {
            for_values(program, *task, |v| last[v as usize] = position);
        }
        let mut free: Vec<u32> = Vec::new();
        for (position, task) in self.tasks.iter().enumerate() {
            for_values(program, *task, |v| {
                if last[v as usize] == position
                    && let Some(place) = self.waits[v as usize]
                {
                    // an operand that stands twice gives its place back once
                    last[v as usize] = usize::MAX;
                    free.push(place);
                }
            });
            if let Task::Compute(k) = task
                && last[*k as usize] > position + FAR
            {
                let place = free.pop().unwrap_or_else(|| {
                    self.frame += 1;
                    self.frame - 1
                });
                self.waits[*k as usize] = Some(place);
            }
        }
    }
}

fn for_values(program: &Program, task: Task, mut visit: impl FnMut(u32)) {
    let mut operand = |o: Operand| {
        if let Operand::Value(v) = o {
            visit(v);
        }
    };
    match task {
        Task::Compute(k) => program.instructions[k as usize].args.into_iter().for_each(operand),
        Task::Write(result) => operand(result.operand),
    }
}

/// Appends an operand's instruction and all that it needs and that is not there yet, operands first.
fn compute(program: &Program, root: Operand, done: &mut [bool], tasks: &mut Vec<Task>) {
    let mut pending = vec![root];
    while let Some(operand) = pending.last().copied() {
        let Operand::Value(k) = operand else {
            pending.pop();
            continue;
        };
        let missing = |o: &&Operand| matches!(o, Operand::Value(v) if !done[*v as usize]);
        if done[k as usize] {
            pending.pop();
        } else if let Some(operand) = program.instructions[k as usize].args.iter().find(missing) {
            pending.push(*operand);
        } else {
            done[k as usize] = true;
            tasks.push(Task::Compute(k));
            pending.pop();
        }
    }
}

fn order(program: &Program, urgent: usize) -> Vec<Placed> {
    let mut made: Vec<Vec<Placed>> = vec![Vec::new(); program.instructions.len()];
    let mut copied = Vec::new();
    for result in &program.results {
        match result.operand {
            Operand::Value(k) => made[k as usize].push(*result),
            _ => copied.push(*result),
        }
    }
    let mut order = Vec::with_capacity(program.results.len());
    let mut seen = vec![false; program.instructions.len()];
    for root in &program.results[..urgent] {
        for k in needed(program, root.operand, &mut seen) {
            order.append(&mut made[k as usize]);
        }
    }
    made.iter_mut().for_each(|m| order.append(m));
    order.append(&mut copied);
    order
}

/// Instructions below an operand that were not seen before, in the order of the program.
fn needed(program: &Program, root: Operand, seen: &mut [bool]) -> Vec<u32> {
    let mut found = Vec::new();
    let mut pending = vec![root];
    while let Some(operand) = pending.pop() {
        if let Operand::Value(k) = operand
            && !std::mem::replace(&mut seen[k as usize], true)
        {
            found.push(k);
            pending.extend(program.instructions[k as usize].args);
        }
    }
    found.sort_unstable();
    found
}

#[cfg(test)]
mod plan_tests {
    use super::*;
    use crate::code::specimen::{random, ship};
    use fdm_grammar::Schedule;

    #[test]
    fn everything_is_done_once_and_after_what_it_needs() {
        for mut model in (0..40).map(|seed| random(seed, true)).chain([ship()]) {
            let schedule = Schedule::new(&mut model);
            let program = &schedule.rates_and_partials;
            let plan = Plan::new(program, schedule.layout.states);
            let mut done = vec![false; program.instructions.len()];
            let mut written = 0;
            for task in &plan.tasks {
                for_values(program, *task, |v| assert!(done[v as usize]));
                match task {
                    Task::Compute(k) => assert!(!std::mem::replace(&mut done[*k as usize], true)),
                    Task::Write(_) => written += 1,
                }
            }
            assert_eq!(written, program.results.len());
        }
    }

    #[test]
    fn rates_of_the_ship_come_before_what_only_partials_need() {
        let schedule = Schedule::new(&mut ship());
        let plan = Plan::new(&schedule.rates_and_partials, 3);
        let rate = |t: &Task| matches!(t, Task::Write(r) if r.slot < 3);
        let last = plan.tasks.iter().rposition(rate).unwrap_or_default();
        let before = plan.tasks[..last].iter().filter(|t| matches!(t, Task::Compute(_))).count();
        assert_eq!(before, schedule.rates.instructions.len());
    }
}
