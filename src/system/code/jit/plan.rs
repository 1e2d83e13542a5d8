//! In which order a program is written down, and which values wait in memory.
//!
//! What is waited for comes first, and what is stored comes as soon as it can be, so that little is alive at a time.
//! Cranelift's register allocator takes far more than linear time over values that live long: those wait in the
//! function's frame, from where they are operands of the arithmetic.

use fdm_grammar::schedule::{Operand, Placed, Program};

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
mod tests {
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
