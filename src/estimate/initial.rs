//! First guesses of free initial states from the first measured sample.

use crate::dynamics::{Dynamics, Point, Workspace};
use crate::record::Run;
use fdm_grammar::graph::Signal;
use fdm_grammar::model::{Model, Origin};

/// Corrections before a nonlinear output is given up.
const CORRECTIONS: usize = 20;

/// Start values of all parameters (p) for one run: those of the model, except that a free initial state is guessed
/// from the first measured value of an output that shows this state and no other (`y = x`, `y = k x + c`, `y = tan(x)`).
/// A state that no output shows so keeps the model's value.
pub fn initial_guess(model: &Model, dynamics: &dyn Dynamics, run: &Run) -> Vec<f64> {
    let mut theta = model.start();
    let layout = dynamics.layout();
    let (mut work, mut known) = (Workspace::new(dynamics), vec![0.0; layout.known]);
    dynamics.prepare(&theta, &mut known, &mut work);
    for (k, param) in model.params.iter().enumerate() {
        let Origin::FreeInitial(state) = param.origin else { continue };
        let guesses = (0..layout.outputs).filter(|o| shown(dynamics, *o) == Some(state as usize));
        let mut guesses = guesses.filter_map(|o| invert(dynamics, run, o, state as usize, &known, &mut work));
        if let Some(value) = guesses.next() {
            theta[k] = value.max(param.lower).min(param.upper);
        }
    }
    theta
}

/// The one state that an output depends on, directly or delayed (before the run a state has its initial value).
fn shown(dynamics: &dyn Dynamics, output: usize) -> Option<usize> {
    let layout = dynamics.layout();
    let delayed = layout.patterns.outputs_by_delayed.row(output).filter_map(|(_, d)| match layout.delayed[d] {
        Signal::State(k) => Some(k as usize),
        Signal::Input(_) => None,
    });
    let mut states = layout.patterns.outputs_by_state.row(output).map(|(_, j)| j).chain(delayed);
    let first = states.next()?;
    states.all(|s| s == first).then_some(first)
}

/// Solves h(x) = z for one state at the first sample where the output was measured, by Newton's method: one step when h
/// is affine.
fn invert(
    dynamics: &dyn Dynamics,
    run: &Run,
    output: usize,
    state: usize,
    known: &[f64],
    work: &mut Workspace,
) -> Option<f64> {
    let layout = dynamics.layout();
    let (q, m) = (layout.outputs, layout.inputs);
    let sample = (0..run.len()).find(|k| !run.measured[k * q + output].is_nan())?;
    let z = run.measured[sample * q + output];
    let mut x = vec![0.0; layout.states];
    let mut drive = vec![0.0; layout.drive()];
    drive[..m].copy_from_slice(&run.inputs[sample * m..(sample + 1) * m]);
    let mut out = vec![0.0; layout.output_slots()];
    for _ in 0..CORRECTIONS {
        for (d, signal) in layout.delayed.iter().enumerate() {
            drive[m + d] = match *signal {
                Signal::State(k) => x[k as usize],
                Signal::Input(k) => drive[k as usize],
            };
        }
        dynamics.outputs_and_partials(Point { t: run.time[sample], x: &x, drive: &drive, known }, &mut out, work);
        let states = &layout.patterns.outputs_by_state;
        let delayed = &layout.patterns.outputs_by_delayed;
        let direct: f64 = states.row(output).map(|(k, _)| out[q + k]).sum();
        let through = delayed.row(output).filter(|(_, d)| layout.delayed[*d] == Signal::State(state as u32));
        let slope = direct + through.map(|(k, _)| out[q + states.len() + k]).sum::<f64>();
        let residual = z - out[output];
        if residual.abs() <= 1e-12 * z.abs().max(slope.abs() * x[state].abs()) {
            return Some(x[state]);
        }
        let next = x[state] + residual / slope;
        if !next.is_finite() {
            return None;
        }
        x[state] = next;
    }
    None
}
