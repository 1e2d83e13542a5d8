//! Subsystems that do not influence each other, found in the sparsity of the equations.

use crate::dynamics::Layout;

/// States and outputs that belong together, and what moves them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Part {
    /// States, rising.
    pub(super) states: Vec<usize>,
    /// Outputs that are a state: (output, position of the state in `states`).
    pub(super) shown: Vec<(usize, usize)>,
    /// Other outputs.
    pub(super) outputs: Vec<usize>,
    /// Positions in the drive of what drives the states, and what enters the outputs.
    pub(super) drive: Vec<usize>,
    pub(super) output_drive: Vec<usize>,
    /// Parameters that matter to any of these, not fixed.
    pub(super) params: Vec<usize>,
}

/// Divides a model; outputs are left out when the model observes in general (`observed` false).
pub(super) fn partition(layout: &Layout, observed: bool) -> Vec<Part> {
    let (n, q) = (layout.states, if observed { layout.outputs } else { 0 });
    let p = &layout.patterns;
    let mut root: Vec<usize> = (0..n + q).collect();
    p.rates_by_state.entries().for_each(|(_, i, j)| unite(&mut root, i, j));
    p.outputs_by_state.entries().filter(|(_, o, _)| *o < q).for_each(|(_, o, j)| unite(&mut root, n + o, j));
    let mut parts: Vec<(usize, Part)> = Vec::new();
    for member in 0..n + q {
        let root = find(&root, member);
        let at = parts.iter().position(|(r, _)| *r == root).unwrap_or_else(|| {
            parts.push((root, Part::default()));
            parts.len() - 1
        });
        let part = &mut parts[at].1;
        match member.checked_sub(n) {
            None => part.states.push(member),
            Some(o) => match layout.observed[o].and_then(|s| part.states.iter().position(|x| *x == s as usize)) {
                Some(state) => part.shown.push((o, state)),
                None => part.outputs.push(o),
            },
        }
    }
    parts.into_iter().map(|(_, part)| complete(part, layout)).collect()
}

fn complete(mut part: Part, layout: &Layout) -> Part {
    let p = &layout.patterns;
    let (mut moved, mut shown) = (vec![false; layout.drive()], vec![false; layout.drive()]);
    let mut matters = vec![false; layout.params];
    for i in &part.states {
        p.rates_by_input.row(*i).for_each(|(_, m)| moved[m] = true);
        p.rates_by_delayed.row(*i).for_each(|(_, d)| moved[layout.inputs + d] = true);
        p.rates_by_param.row(*i).chain(p.initial_by_param.row(*i)).for_each(|(_, k)| matters[k] = true);
    }
    for o in &part.outputs {
        p.outputs_by_input.row(*o).for_each(|(_, m)| shown[m] = true);
        p.outputs_by_delayed.row(*o).for_each(|(_, d)| shown[layout.inputs + d] = true);
        p.outputs_by_param.row(*o).for_each(|(_, k)| matters[k] = true);
    }
    for d in (0..layout.delayed.len()).filter(|d| moved[layout.inputs + d] || shown[layout.inputs + d]) {
        p.tau_by_param.row(d).for_each(|(_, k)| matters[k] = true);
    }
    let chosen = |of: &[bool]| of.iter().enumerate().filter(|(_, yes)| **yes).map(|(k, _)| k).collect::<Vec<usize>>();
    (part.drive, part.output_drive, part.params) = (chosen(&moved), chosen(&shown), chosen(&matters));
    part
}

fn find(root: &[usize], mut member: usize) -> usize {
    while root[member] != member {
        member = root[member];
    }
    member
}

fn unite(root: &mut [usize], a: usize, b: usize) {
    let (a, b) = (find(root, a), find(root, b));
    let (low, high) = (a.min(b), a.max(b));
    root[high] = low;
}
