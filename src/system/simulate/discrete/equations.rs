//! The matrices of an affine model, `x' = A x + B v + c` and `y = C x + D v + e`, with their derivatives by parameters, and the subsystems
//! that do not influence each other ([`Part`]), found in their sparsity.
//!
//! Entries are partials that the model's programs compute anyway. Derivatives of entries are read from f_theta, which is
//! affine as well: its value at a point where one signal is other than zero, less its value at zero.

use crate::dynamics::{Dynamics, Layout, Point, Workspace};
use std::collections::BTreeSet;

/// The signal's size while its coefficient is read: so large that the constant beside it costs no digits.
const SIZE: f64 = (1u64 << 40) as f64;

/// A group of equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Group {
    /// Rates, by index of the state.
    Rates,
    /// Outputs.
    Outputs,
}

/// Results of the model's programs at zero, and with the signals (states, then the drive) of each colour: signals that meet in no
/// equation are read together (Curtis, Powell and Reid 1974).
pub(super) struct Equations {
    /// The colour of each signal.
    colours: Vec<usize>,
    rates: Vec<f64>,
    outputs: Vec<f64>,
    by_input: Vec<f64>,
    x: Vec<f64>,
    drive: Vec<f64>,
}

impl Equations {
    pub(super) fn new(layout: &Layout) -> Self {
        let colours = colour(layout);
        let points = 1 + colours.iter().map(|colour| colour + 1).max().unwrap_or(0);
        Self {
            colours,
            rates: vec![0.0; points * layout.rate_slots()],
            outputs: vec![0.0; points * layout.output_slots()],
            by_input: vec![0.0; layout.input_slots()],
            x: vec![0.0; layout.states],
            drive: vec![0.0; layout.drive()],
        }
    }

    /// Evaluates for new parameters.
    pub(super) fn read(&mut self, dynamics: &dyn Dynamics, known: &[f64], work: &mut Workspace) {
        let layout = dynamics.layout();
        let Self { colours, rates, outputs, by_input, x, drive } = self;
        for point in 0..rates.len() / layout.rate_slots().max(1) {
            let signals = x.iter_mut().chain(drive.iter_mut()).zip(&*colours);
            signals.for_each(|(signal, colour)| *signal = if colour + 1 == point { SIZE } else { 0.0 });
            let at = Point { t: 0.0, x, drive, known };
            let row = point * layout.rate_slots()..(point + 1) * layout.rate_slots();
            dynamics.rates_and_partials(at, &mut rates[row], work);
            let row = point * layout.output_slots()..(point + 1) * layout.output_slots();
            dynamics.outputs_and_partials(at, &mut outputs[row], work);
            if point == 0 {
                dynamics.by_input(at, by_input, work);
            }
        }
    }

    /// The coefficient of a state in an equation.
    pub(super) fn by_state(&self, layout: &Layout, group: Group, i: usize, state: usize) -> f64 {
        let p = &layout.patterns;
        match group {
            Group::Rates => {
                entry(&p.rates_by_state, i, state).map_or(0.0, |k| self.rates[layout.stage.by_state[k] as usize])
            }
            Group::Outputs => entry(&p.outputs_by_state, i, state).map_or(0.0, |k| self.outputs[layout.outputs + k]),
        }
    }

    /// The coefficient of an input or delayed signal (a position in the drive) in an equation.
    pub(super) fn by_drive(&self, layout: &Layout, group: Group, i: usize, drive: usize) -> f64 {
        let p = &layout.patterns;
        match (group, drive.checked_sub(layout.inputs)) {
            (Group::Rates, None) => entry(&p.rates_by_input, i, drive).map_or(0.0, |k| self.by_input[k]),
            (Group::Rates, Some(d)) => {
                entry(&p.rates_by_delayed, i, d).map_or(0.0, |k| self.rates[layout.stage.by_delayed + k])
            }
            (Group::Outputs, None) => {
                entry(&p.outputs_by_input, i, drive).map_or(0.0, |k| self.by_input[p.rates_by_input.len() + k])
            }
            (Group::Outputs, Some(d)) => entry(&p.outputs_by_delayed, i, d)
                .map_or(0.0, |k| self.outputs[layout.outputs + p.outputs_by_state.len() + k]),
        }
    }

    /// The constant of an equation.
    pub(super) fn constant(&self, group: Group, i: usize) -> f64 {
        match group {
            Group::Rates => self.rates[i],
            Group::Outputs => self.outputs[i],
        }
    }

    /// The derivative by a parameter of the coefficient of a signal (states, then the drive).
    pub(super) fn slope(&self, layout: &Layout, group: Group, i: usize, signal: usize, param: usize) -> f64 {
        if !enters(layout, group, i, signal) {
            return 0.0;
        }
        let point = 1 + self.colours[signal];
        let (zero, one) = (self.by_param(layout, group, i, 0, param), self.by_param(layout, group, i, point, param));
        (one - zero) / SIZE
    }

    /// The derivative by a parameter of the constant.
    pub(super) fn constant_slope(&self, layout: &Layout, group: Group, i: usize, param: usize) -> f64 {
        self.by_param(layout, group, i, 0, param)
    }

    fn by_param(&self, layout: &Layout, group: Group, i: usize, point: usize, param: usize) -> f64 {
        let p = &layout.patterns;
        match group {
            Group::Rates => {
                let slot = entry(&p.rates_by_param, i, param).and_then(|_| layout.stage.by_param(i, param));
                slot.map_or(0.0, |slot| self.rates[point * layout.rate_slots() + slot])
            }
            Group::Outputs => {
                let first = layout.outputs + p.outputs_by_state.len() + p.outputs_by_delayed.len();
                let slot = entry(&p.outputs_by_param, i, param);
                slot.map_or(0.0, |k| self.outputs[point * layout.output_slots() + first + k])
            }
        }
    }
}

/// Whether a signal enters an equation.
fn enters(layout: &Layout, group: Group, i: usize, signal: usize) -> bool {
    let (p, n, m) = (&layout.patterns, layout.states, layout.inputs);
    let [by_state, by_input, by_delayed] = match group {
        Group::Rates => [&p.rates_by_state, &p.rates_by_input, &p.rates_by_delayed],
        Group::Outputs => [&p.outputs_by_state, &p.outputs_by_input, &p.outputs_by_delayed],
    };
    let (pattern, column) = match signal {
        state if state < n => (by_state, state),
        input if input < n + m => (by_input, input - n),
        delayed => (by_delayed, delayed - n - m),
    };
    entry(pattern, i, column).is_some()
}

/// The smallest colour for each signal that no other signal of one of its equations has.
fn colour(layout: &Layout) -> Vec<usize> {
    let (p, n, m) = (&layout.patterns, layout.states, layout.inputs);
    let rates = [&p.rates_by_state, &p.rates_by_input, &p.rates_by_delayed];
    let outputs = [&p.outputs_by_state, &p.outputs_by_input, &p.outputs_by_delayed];
    let groups = [(rates, layout.states), (outputs, layout.outputs)];
    let mut equations = Vec::new();
    for (patterns, rows) in groups {
        let columns = |i: usize| {
            let own = patterns.iter().zip([0, n, n + m]);
            own.flat_map(move |(pattern, first)| pattern.row(i).map(move |(_, j)| first + j)).collect::<Vec<usize>>()
        };
        equations.extend((0..rows).map(columns));
    }
    let signals = n + layout.drive();
    let mut met = vec![Vec::new(); signals];
    for (e, signals) in equations.iter().enumerate() {
        signals.iter().for_each(|signal| met[*signal].push(e));
    }
    let mut colours: Vec<Option<usize>> = vec![None; signals];
    for signal in 0..signals {
        let others = met[signal].iter().flat_map(|e| &equations[*e]);
        let taken: BTreeSet<usize> = others.filter_map(|other| colours[*other]).collect();
        colours[signal] = (0..).find(|colour| !taken.contains(colour));
    }
    colours.into_iter().flatten().collect()
}

/// The position of an entry in its pattern.
fn entry(pattern: &fdm_grammar::Pattern, i: usize, j: usize) -> Option<usize> {
    pattern.row(i).find(|(_, column)| *column == j).map(|(k, _)| k)
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Model;

    fn colours(text: &str) -> Vec<usize> {
        colour(Model::from_text("m.fdm", text).expect("compiles").layout())
    }

    #[test]
    fn signals_that_meet_nowhere_share_a_colour() {
        let apart =
            "model m { input u, v; state x, z; param k = 1, h = 2; der(x) = u - k*x; der(z) = v - h*z; output y = x;
            output w = z; }";
        assert_eq!(colours(apart), [0, 0, 1, 1]);
        let together = apart.replace("output w = z", "output w = x + k*z");
        assert_eq!(colours(&together), [0, 1, 1, 0]);
    }
}
