//! The matrices of an affine model, `x' = A x + B v + c` and `y = C x + D v + e`, with their derivatives by parameters.
//!
//! Entries are partials that the model's programs compute anyway. Derivatives of entries are read from f_theta, which is
//! affine as well: its value at a point where one signal is other than zero, less its value at zero.

use crate::dynamics::{Dynamics, Layout, Point, Workspace};

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

/// Results of the model's programs at zero, and with each signal in turn (states, then the drive).
pub(super) struct Equations {
    rates: Vec<f64>,
    outputs: Vec<f64>,
    by_input: Vec<f64>,
    x: Vec<f64>,
    drive: Vec<f64>,
}

impl Equations {
    pub(super) fn new(layout: &Layout) -> Self {
        let points = 1 + layout.states + layout.drive();
        Self {
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
        let Self { rates, outputs, by_input, x, drive } = self;
        for point in 0..1 + layout.states + layout.drive() {
            x.fill(0.0);
            drive.fill(0.0);
            if let Some(signal) = x.iter_mut().chain(drive.iter_mut()).nth(point.wrapping_sub(1)) {
                *signal = SIZE;
            }
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
        let (zero, one) =
            (self.by_param(layout, group, i, 0, param), self.by_param(layout, group, i, 1 + signal, param));
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

/// The position of an entry in its pattern.
fn entry(pattern: &fdm_grammar::Pattern, i: usize, j: usize) -> Option<usize> {
    pattern.row(i).find(|(_, column)| *column == j).map(|(k, _)| k)
}
