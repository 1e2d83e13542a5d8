//! In which order results are computed: what is waited for first, and little alive at a time.
//!
//! Cranelift computes a pure value when something with an effect asks for it, so the order of the stores is the order
//! of the code, and a value that is stored long after it was used occupies a register until then.

use fdm_grammar::schedule::{Operand, Placed, Program};

/// All results of a program: the first `urgent` ones in turn, each preceded by those that it is made of; then
/// the others as their instructions come; at last those that need no instruction.
pub(super) fn order(program: &Program, urgent: usize) -> Vec<Placed> {
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
    made.iter_mut().for_each(|s| order.append(s));
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
