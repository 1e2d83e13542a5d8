//! In which order results are computed: what is waited for first, and little alive at a time.
//!
//! Cranelift computes a pure value when something with an effect asks for it, so the order of the stores is the order
//! of the code, and a value that is stored long after it was used occupies a register until then.

use fdm_grammar::schedule::{Operand, Program};

/// All result slots of a program: the first `urgent` ones in turn, each preceded by those that it is made of; then
/// the others as their instructions come; at last those that need no instruction.
pub(super) fn order(program: &Program, urgent: usize) -> Vec<usize> {
    let mut slots: Vec<Vec<usize>> = vec![Vec::new(); program.instructions.len()];
    let mut copied = Vec::new();
    for (slot, result) in program.results.iter().enumerate() {
        match result {
            Operand::Value(k) => slots[*k as usize].push(slot),
            _ => copied.push(slot),
        }
    }
    let mut order = Vec::with_capacity(program.results.len());
    let mut seen = vec![false; program.instructions.len()];
    for root in &program.results[..urgent] {
        for k in needed(program, *root, &mut seen) {
            order.append(&mut slots[k as usize]);
        }
    }
    slots.iter_mut().for_each(|s| order.append(s));
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
