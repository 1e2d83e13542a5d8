//! Flat bytecode over one array of numbers: the reference that machine code must equal to the bit.
//!
//! An interpreter spends more on finding out what to do than on doing it, and half of a linear model is products that one sum alone
//! reads: such a product is formed inside that sum. Product and sum are still rounded one after the other: the bits are those of two
//! instructions. Foreign code is called from here alone: machine code leaves programs that call it to the tape.

use crate::dynamics::{Dynamics, Point, Step, Workspace, runge_kutta};
use fdm_grammar::external::Function;
use fdm_grammar::op::Op;
use fdm_grammar::schedule::{Instruction, Layout, Operand, Program, Schedule};

/// The programs of a model as bytecode; any size, no recursion, no allocation while it runs.
#[derive(Debug, Clone)]
pub struct Tape {
    layout: Layout,
    prepare: Bytecode,
    rates: Bytecode,
    rates_and_partials: Bytecode,
    outputs: Bytecode,
    outputs_and_partials: Bytecode,
    by_input: Bytecode,
    events: Bytecode,
    events_and_partials: Bytecode,
    rates_by_time: Bytecode,
}

impl Tape {
    /// Resolves all operands of a schedule to places in one array.
    pub fn new(schedule: &Schedule) -> Self {
        let Schedule { layout, .. } = schedule;
        let body = |program: &Program| Bytecode::new(program, layout.states, layout.drive());
        Self {
            prepare: Bytecode::new(&schedule.prepare, 0, 0),
            rates: body(&schedule.rates),
            rates_and_partials: body(&schedule.rates_and_partials),
            outputs: body(&schedule.outputs),
            outputs_and_partials: body(&schedule.outputs_and_partials),
            by_input: body(&schedule.by_input),
            events: body(&schedule.events),
            events_and_partials: body(&schedule.events_and_partials),
            rates_by_time: body(&schedule.rates_by_time),
            layout: layout.clone(),
        }
    }
}

impl Dynamics for Tape {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn workspace(&self) -> usize {
        let programs = [
            &self.prepare,
            &self.rates,
            &self.rates_and_partials,
            &self.outputs,
            &self.outputs_and_partials,
            &self.by_input,
            &self.events,
            &self.events_and_partials,
            &self.rates_by_time,
        ];
        programs.map(|p| p.places).into_iter().max().unwrap_or(0)
    }

    fn prepare(&self, theta: &[f64], known: &mut [f64], work: &mut Workspace) {
        self.prepare.run(Point { t: 0.0, x: &[], drive: &[], known: theta }, known, work);
    }

    fn rates(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        self.rates.run(at, out, work);
    }

    fn rates_and_partials(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        self.rates_and_partials.run(at, out, work);
    }

    fn outputs(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        self.outputs.run(at, out, work);
    }

    fn outputs_and_partials(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        self.outputs_and_partials.run(at, out, work);
    }

    fn by_input(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        self.by_input.run(at, out, work);
    }

    fn events(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        self.events.run(at, out, work);
    }

    fn events_and_partials(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        self.events_and_partials.run(at, out, work);
    }

    fn rates_by_time(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        self.rates_by_time.run(at, out, work);
    }

    fn ready(&self) -> Result<(), String> {
        let programs = [&self.prepare, &self.rates, &self.outputs, &self.events];
        programs.into_iter().flat_map(|p| &p.calls).try_for_each(|(function, _)| function.code.ready())
    }

    fn step(&self, step: Step<'_>, next: &mut [f64], work: &mut Workspace) {
        let (n, width) = (self.layout.states, self.layout.drive());
        runge_kutta(step, n, width, next, work, |stage, at, out, work| self.rates.run_stage(stage, at, out, work));
    }

    fn step_with_partials(&self, step: Step<'_>, next: &mut [f64], stages: &mut [f64], work: &mut Workspace) {
        let (n, width, slots) = (self.layout.states, self.layout.drive(), self.layout.rate_slots());
        runge_kutta(step, n, width, next, work, |stage, at, out, work| {
            let row = &mut stages[stage * slots..(stage + 1) * slots];
            self.rates_and_partials.run_stage(stage, at, row, work);
            out.copy_from_slice(&row[..n]);
        });
    }
}

/// One operation on places of the array.
#[derive(Debug, Clone, Copy)]
struct Code {
    act: Act,
    to: u32,
    from: [u32; 3],
}

/// One program. Its array is [constants | time | states | drive | entries of `known` that it reads | registers | operands of a call];
/// everything but the registers is copied in front of each evaluation, so that instructions read without asking where.
#[derive(Debug, Clone)]
pub(crate) struct Bytecode {
    constants: Vec<f64>,
    states: usize,
    drive: usize,
    known: Vec<u32>,
    codes: Vec<Code>,
    /// (slot, where its value stands)
    results: Vec<(u32, u32)>,
    width: usize,
    /// Functions of foreign code, and where their operands stand.
    calls: Vec<(Function, Vec<u32>)>,
    places: usize,
}

impl Bytecode {
    /// A program that reads this many states and entries of the drive.
    pub(crate) fn new(program: &Program, states: usize, drive: usize) -> Self {
        let mut steps = fused(program);
        let operands = steps.iter().flat_map(|s| s.reads(program)).chain(program.results.iter().map(|r| r.operand));
        let mut known: Vec<u32> =
            operands.filter_map(|o| if let Operand::Known(k) = o { Some(k) } else { None }).collect();
        known.sort_unstable();
        known.dedup();
        let registers = Registers::assign(program, &steps);
        let time = program.constants.len();
        let base = time + 1 + states + drive + known.len();
        let place = |operand: Operand| match operand {
            Operand::Constant(k) => k,
            Operand::Time => time as u32,
            Operand::State(k) => time as u32 + 1 + k,
            Operand::Drive(k) => (time + 1 + states) as u32 + k,
            Operand::Known(k) => (time + 1 + states + drive + known.partition_point(|l| *l < k)) as u32,
            Operand::Value(k) => base as u32 + registers.of[k as usize],
        };
        let mut calls = Vec::new();
        for step in steps.iter_mut().filter(|s| matches!(s.act, Act::Other(op) if op.is_external())) {
            if let (Act::Other(op), Some((function, operands))) = (step.act, program.call(step.value)) {
                step.act = Act::Call(op, calls.len() as u32);
                calls.push((function, operands.iter().map(|o| place(*o)).collect::<Vec<u32>>()));
            }
        }
        let longest = calls.iter().map(|(_, places)| places.len()).max().unwrap_or(0);
        let code = |s: &Fused| Code { act: s.act, to: base as u32 + registers.of[s.value], from: s.args.map(place) };
        Self {
            codes: steps.iter().map(code).collect(),
            results: program.results.iter().map(|r| (r.slot, place(r.operand))).collect(),
            width: program.width,
            constants: program.constants.clone(),
            states,
            drive,
            places: base + registers.count as usize + longest,
            calls,
            known,
        }
    }

    /// Evaluates the program; nothing is allocated once `work` has served it.
    pub(crate) fn run(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        if work.values.len() < self.places {
            // memory that was made for another model
            work.values.resize(self.places, 0.0);
        }
        self.load(at, &mut work.values[..self.places]);
        self.evaluate(at, out, work);
    }

    /// Evaluates the program at a stage of a step, of which constants and what is known stay from the first stage.
    #[inline]
    fn run_stage(&self, stage: usize, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        if stage == 0 { self.run(at, out, work) } else { self.evaluate(at, out, work) }
    }

    fn evaluate(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        let values = &mut work.values[..self.places];
        self.move_to(at, values);
        for code in &self.codes {
            let [a, b, c] = code.from.map(|k| values[k as usize]);
            values[code.to as usize] = match code.act {
                // most of every model; the rest is far enough from one cycle not to mind the call
                Act::Add => a + b,
                Act::Sub => a - b,
                Act::Mul => a * b,
                Act::Div => a / b,
                Act::MulAdd => a * b + c,
                Act::MulSub => a * b - c,
                Act::SubMul => c - a * b,
                Act::Other(op) => (op.row().value)(a, b, c),
                Act::Call(op, k) => self.call(op, k, values),
            };
        }
        let out = &mut out[..self.width];
        for (slot, k) in &self.results {
            out[*slot as usize] = values[*k as usize];
        }
    }

    #[cold]
    fn call(&self, op: Op, call: u32, values: &mut [f64]) -> f64 {
        let (function, places) = &self.calls[call as usize];
        let (values, operands) = values.split_at_mut(values.len() - places.len());
        operands.iter_mut().zip(places).for_each(|(o, k)| *o = values[*k as usize]);
        function.compute(op, operands)
    }

    /// What the points of a step share.
    fn load(&self, at: Point<'_>, values: &mut [f64]) {
        let constants = self.constants.len();
        values[..constants].copy_from_slice(&self.constants);
        for (place, k) in values[constants + 1 + self.states + self.drive..].iter_mut().zip(&self.known) {
            *place = at.known[*k as usize];
        }
    }

    /// Time, states and drive.
    fn move_to(&self, at: Point<'_>, values: &mut [f64]) {
        let (time, rest) = values[self.constants.len()..].split_at_mut(1);
        let (states, rest) = rest.split_at_mut(self.states);
        time[0] = at.t;
        states.copy_from_slice(&at.x[..self.states]);
        rest[..self.drive].copy_from_slice(&at.drive[..self.drive]);
    }
}

/// Registers of values, taken again as soon as the last reader is done.
struct Registers {
    /// Of each instruction of the program; those inside another have none.
    of: Vec<u32>,
    count: u32,
}

impl Registers {
    fn assign(program: &Program, steps: &[Fused]) -> Self {
        const KEPT: usize = usize::MAX;
        let mut last: Vec<usize> = (0..program.instructions.len()).collect();
        for step in steps {
            for operand in step.reads(program) {
                if let Operand::Value(v) = operand {
                    last[v as usize] = step.value;
                }
            }
        }
        for result in program.results.iter().map(|r| &r.operand) {
            if let Operand::Value(v) = result {
                last[*v as usize] = KEPT;
            }
        }
        let mut registers = Self { of: vec![u32::MAX; last.len()], count: 0 };
        let mut free: Vec<u32> = Vec::new();
        for step in steps {
            let k = step.value;
            for operand in step.reads(program) {
                if let Operand::Value(v) = operand
                    && last[v as usize] == k
                {
                    // an operand that stands twice is given back once
                    last[v as usize] = KEPT;
                    free.push(registers.of[v as usize]);
                }
            }
            let register = free.pop().unwrap_or_else(|| {
                registers.count += 1;
                registers.count - 1
            });
            registers.of[k] = register;
            if last[k] == k {
                free.push(register);
            }
        }
        registers
    }
}

/// What an instruction does with its operands a, b, c.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Act {
    /// a + b
    Add,
    /// a - b
    Sub,
    /// a b
    Mul,
    /// a / b
    Div,
    /// a b + c
    MulAdd,
    /// a b - c
    MulSub,
    /// c - a b
    SubMul,
    /// Whatever the table of operations says.
    Other(Op),
    /// Foreign code, by the number of the call.
    Call(Op, u32),
}

/// An instruction with what it reads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fused {
    /// The instruction of the program whose value this is.
    pub(super) value: usize,
    pub(super) act: Act,
    /// Places beyond those that are read repeat the first operand.
    pub(super) args: [Operand; 3],
    read: usize,
}

impl Fused {
    fn alone(value: usize, instruction: &Instruction) -> Self {
        let act = match instruction.op {
            Op::Add => Act::Add,
            Op::Sub => Act::Sub,
            Op::Mul => Act::Mul,
            Op::Div => Act::Div,
            op => Act::Other(op),
        };
        Self { value, act, args: instruction.args, read: instruction.op.row().arity }
    }

    /// Everything that it reads.
    fn reads<'a>(&'a self, program: &'a Program) -> impl Iterator<Item = Operand> + 'a {
        let call = program.calls.binary_search_by_key(&self.value, |c| c.instruction as usize);
        let call = call.map_or(&[][..], |k| &program.calls[k].operands);
        self.args[..self.read].iter().chain(call).copied()
    }
}

/// The steps of a program, in its order.
pub(super) fn fused(program: &Program) -> Vec<Fused> {
    let steps: Vec<Fused> = program.instructions.iter().enumerate().map(|(k, i)| Fused::alone(k, i)).collect();
    let mut readers = vec![0_u32; steps.len()];
    let results = program.results.iter().map(|r| r.operand);
    for operand in steps.iter().flat_map(|s| s.reads(program)).chain(results) {
        if let Operand::Value(v) = operand {
            readers[v as usize] += 1;
        }
    }
    let product = |operand: Operand| match operand {
        Operand::Value(v) if readers[v as usize] == 1 && steps[v as usize].act == Act::Mul => Some(v as usize),
        _ => None,
    };
    let mut inside = vec![false; steps.len()];
    let mut found = Vec::with_capacity(steps.len());
    for step in &steps {
        let [first, second, _] = step.args;
        let choice = match step.act {
            Act::Add => {
                product(second).map(|v| (Act::MulAdd, v, first)).or(product(first).map(|v| (Act::MulAdd, v, second)))
            }
            Act::Sub => {
                product(second).map(|v| (Act::SubMul, v, first)).or(product(first).map(|v| (Act::MulSub, v, second)))
            }
            _ => None,
        };
        found.push(match choice {
            Some((act, v, rest)) => {
                inside[v] = true;
                let [a, b, _] = steps[v].args;
                Fused { act, args: [a, b, rest], read: 3, ..*step }
            }
            None => *step,
        });
    }
    found.retain(|step| !inside[step.value]);
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::code::Tape;
    use crate::code::specimen::blank;
    use crate::dynamics::{Dynamics, Point, Workspace};
    use fdm_grammar::Schedule;
    use fdm_grammar::graph::Leaf;
    use fdm_grammar::op::{Build, Op};

    #[test]
    fn registers_are_taken_again() {
        let mut model = blank(1, 0, &[]);
        let mut e = model.graph.leaf(Leaf::State(0));
        for _ in 0..50_000 {
            let square = model.graph.apply(Op::Mul, &[e, e]);
            let sine = model.graph.apply(Op::Sin, &[square]);
            e = model.graph.apply(Op::Add, &[sine, square]);
        }
        model.states[0].rate = e;
        let tape = Tape::new(&Schedule::new(&mut model));
        assert_eq!(tape.rates.codes.len(), 150_000);
        assert!(tape.rates.places < 10, "{} places", tape.rates.places);
    }

    #[test]
    fn memory_of_another_model_is_made_to_fit() {
        let tape = Tape::new(&Schedule::new(&mut blank(3, 0, &[])));
        let mut rates = [1.0; 3];
        let at = Point { t: 0.0, x: &[1.0; 3], drive: &[], known: &[] };
        tape.rates(at, &mut rates, &mut Workspace::default());
        assert_eq!(rates, [0.0; 3]);
    }

    /// Sums and differences of products, on either side; one product is read twice.
    #[test]
    fn products_go_into_the_sums_that_read_them_with_both_roundings() {
        let mut model = blank(4, 0, &[]);
        let x: Vec<_> = (0..4).map(|k| model.graph.leaf(Leaf::State(k))).collect();
        let g = &mut model.graph;
        let shared = g.apply(Op::Mul, &[x[0], x[1]]);
        let other = g.apply(Op::Mul, &[x[2], x[3]]);
        let rates = [
            g.apply(Op::Sub, &[other, x[0]]),
            g.apply(Op::Add, &[x[3], shared]),
            {
                let square = g.apply(Op::Mul, &[x[1], x[1]]);
                g.apply(Op::Sub, &[x[2], square])
            },
            {
                let (a, b) = (g.apply(Op::Mul, &[x[0], x[2]]), g.apply(Op::Mul, &[x[1], x[3]]));
                let sum = g.apply(Op::Add, &[a, b]);
                g.apply(Op::Sub, &[sum, shared])
            },
        ];
        model.states.iter_mut().zip(rates).for_each(|(state, rate)| state.rate = rate);
        let schedule = Schedule::new(&mut model);
        let acts: Vec<Act> = fused(&schedule.rates).iter().map(|step| step.act).collect();
        let count = |act: Act| acts.iter().filter(|a| **a == act).count();
        assert_eq!(count(Act::Mul), 2, "the product that is read twice, and one of two in a sum: {acts:?}");
        assert_eq!((count(Act::MulSub), count(Act::SubMul), count(Act::MulAdd)), (1, 1, 1), "{acts:?}");

        let x = [1.0 / 3.0, 0.1, 7.0 / 11.0, -0.3];
        let mut found = [0.0; 4];
        Tape::new(&schedule).rates(
            Point { t: 0.0, x: &x, drive: &[], known: &[] },
            &mut found,
            &mut Workspace::default(),
        );
        let [a, b, c, d] = x;
        let expected = [c * d - a, d + a * b, c - b * b, (a * c + b * d) - a * b];
        assert_eq!(found.map(f64::to_bits), expected.map(f64::to_bits));
    }
}
