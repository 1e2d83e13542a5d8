//! Instructions of the bytecode: a product that one sum alone reads is formed inside that sum.
//!
//! An interpreter spends more on finding out what to do than on doing it, and half of a linear model is such products. Product and sum
//! are still rounded one after the other: the bits are those of two instructions.

use fdm_grammar::op::Op;
use fdm_grammar::schedule::{Instruction, Operand, Program};

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
}

/// An instruction with what it reads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// The instruction of the program whose value this is.
    pub(super) value: usize,
    pub(super) act: Act,
    /// Places beyond those that are read repeat the first operand.
    pub(super) args: [Operand; 3],
    read: usize,
}

impl Step {
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

    /// The operands.
    pub(super) fn operands(&self) -> &[Operand] {
        &self.args[..self.read]
    }
}

/// The steps of a program, in its order.
pub(super) fn fused(program: &Program) -> Vec<Step> {
    let steps: Vec<Step> = program.instructions.iter().enumerate().map(|(k, i)| Step::alone(k, i)).collect();
    let mut readers = vec![0_u32; steps.len()];
    let results = program.results.iter().map(|r| &r.operand);
    for operand in steps.iter().flat_map(Step::operands).chain(results) {
        if let Operand::Value(v) = operand {
            readers[*v as usize] += 1;
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
                Step { act, args: [a, b, rest], read: 3, ..*step }
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
    use fdm_grammar::op::Build;

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
