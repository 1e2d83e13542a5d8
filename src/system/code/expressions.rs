//! Expressions beside a model, evaluated at one point after the other, for records; and programs in complex numbers, for what a step into
//! the imaginary direction makes of their results.

use super::tape::Bytecode;
use super::verification::Rounding;
use crate::dynamics::{Point, Workspace};
use fdm_grammar::external::Function;
use fdm_grammar::graph::Graph;
use fdm_grammar::op::{ExprId, Op};
use fdm_grammar::schedule::{Operand, Program, program};
use num_complex::Complex64;

/// Some expressions of one graph, ready to be evaluated.
#[derive(Debug, Clone)]
pub struct Expressions {
    code: Bytecode,
    work: Workspace,
}

impl Expressions {
    /// Expressions over `states` states, `inputs` inputs and the delayed signals of the graph.
    pub fn new(graph: &Graph, roots: &[ExprId], states: usize, inputs: usize) -> Self {
        let code = Bytecode::new(&program(graph, roots, inputs), states, inputs + graph.delayed().len());
        Self { code, work: Workspace::default() }
    }

    /// Their values, to the front of `out`; `at.known` are the parameters themselves, in the model's order.
    pub fn evaluate(&mut self, at: Point<'_>, out: &mut [f64]) {
        self.code.run(at, out, &mut self.work);
    }
}

/// Where a program is evaluated; the slices are as in [`crate::dynamics::Point`].
#[derive(Debug, Clone, Copy)]
pub(super) struct ComplexPoint<'a> {
    pub(super) t: f64,
    pub(super) x: &'a [Complex64],
    pub(super) drive: &'a [Complex64],
    pub(super) known: &'a [Complex64],
}

/// Evaluates a program; `values` is memory that evaluations reuse. Slots that the program does not write stay zero.
pub(super) fn evaluate(
    program: &Program,
    at: ComplexPoint<'_>,
    values: &mut Vec<Complex64>,
    rounding: &mut Rounding,
) -> Vec<Complex64> {
    let operand = |operand: Operand, values: &[Complex64]| match operand {
        Operand::Value(k) => values[k as usize],
        Operand::Constant(k) => program.constants[k as usize].into(),
        Operand::Time => at.t.into(),
        Operand::State(k) => at.x[k as usize],
        Operand::Drive(k) => at.drive[k as usize],
        Operand::Known(k) => at.known[k as usize],
    };
    values.clear();
    for (k, instruction) in program.instructions.iter().enumerate() {
        if let Some((function, operands)) = program.call(k) {
            let operands: Vec<Complex64> = operands.iter().map(|o| operand(*o, values)).collect();
            values.push(called(instruction.op, &function, &operands));
            continue;
        }
        let [a, b, c] = instruction.args.map(|o| operand(o, values));
        // decisions must be those of the real program, also where the continuation has a value and the function none
        let re = (instruction.op.row().value)(a.re, b.re, c.re);
        let im = (instruction.op.row().complex)(a, b, c).im;
        let rounded = |rounding: &mut Rounding| Complex64::new(rounding.round(re), rounding.round(im));
        values.push(match re {
            re if re.is_nan() => Complex64::new(re, re),
            re if instruction.op.is_condition() => Complex64::new(re, im),
            _ => rounded(rounding),
        });
    }
    let mut results = vec![Complex64::ZERO; program.width];
    for result in &program.results {
        results[result.slot as usize] = operand(result.operand, values);
    }
    results
}

/// Foreign code knows no complex numbers: its part of the step is made of differences of its values.
fn called(op: Op, function: &Function, operands: &[Complex64]) -> Complex64 {
    let real: Vec<f64> = operands.iter().map(|o| o.re).collect();
    let moved = operands.iter().enumerate().filter(|(_, o)| o.im != 0.0);
    let im = match op {
        Op::External => moved.map(|(k, o)| o.im * function.code.difference(function.function, &real, k)).sum(),
        // second derivatives are not looked at
        _ => 0.0,
    };
    Complex64::new(function.compute(op, &real), im)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::code::Tape;
    use crate::code::specimen::ship;
    use crate::dynamics::{Dynamics, Point, Workspace};
    use fdm_grammar::Schedule;

    #[test]
    fn real_arguments_give_the_real_values() {
        let schedule = Schedule::new(&mut ship());
        let (x, drive, known) = ([7.0, -0.2, 0.01], [0.3], vec![0.4; schedule.layout.known]);
        let mut rates = [0.0; 3];
        let tape = Tape::new(&schedule);
        tape.rates(Point { t: 0.0, x: &x, drive: &drive, known: &known }, &mut rates, &mut Workspace::new(&tape));
        let complex = |values: &[f64]| values.iter().map(|v| Complex64::from(*v)).collect::<Vec<_>>();
        let (x, drive, known) = (complex(&x), complex(&drive), complex(&known));
        let at = ComplexPoint { t: 0.0, x: &x, drive: &drive, known: &known };
        assert_eq!(evaluate(&schedule.rates, at, &mut Vec::new(), &mut Rounding::exact()), complex(&rates));
    }
}
