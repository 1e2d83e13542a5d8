//! First guesses of free initial states from the first measured sample.

use crate::problem::unobserved_states::unobserved_states;
use fdm_grammar::graph::Signal;
use fdm_grammar::model::{Origin, Param};
use fdm_system::dynamics::{Dynamics, Point, Workspace};
use fdm_system::record::Run;

/// Corrections before a nonlinear output is given up.
const CORRECTIONS: usize = 20;

/// Start values of all parameters (p) for one run: their own, except that a free initial state is guessed
/// from the first measured value of an output that shows this state and no other (`y = x`, `y = k x + c`, `y = tan(x)`).
/// Where some state is shown by no output so, all of them are found together from smoothed outputs and their slopes (`unobserved_states.rs`); what these
/// do not tell begins at rest.
pub fn initial_guess(params: &[Param], dynamics: &dyn Dynamics, run: &Run) -> Vec<f64> {
    let mut theta: Vec<f64> = params.iter().map(|p| p.value).collect();
    let layout = dynamics.layout();
    // what the run brings is no guess
    for (param, input) in &layout.first {
        theta[*param as usize] = run.inputs.get(*input as usize).copied().unwrap_or(f64::NAN);
    }
    let (mut work, mut known) = (Workspace::new(dynamics), vec![0.0; layout.known]);
    dynamics.prepare(&theta, &mut known, &mut work);
    let mut hidden = false;
    for (k, param) in params.iter().enumerate() {
        let Origin::FreeInitial(state) = param.origin else { continue };
        let guesses = (0..layout.outputs).filter(|o| shown(dynamics, *o) == Some(state as usize));
        let mut guesses = guesses.filter_map(|o| invert(dynamics, run, o, state as usize, &known, &mut work));
        match guesses.next() {
            Some(value) => theta[k] = value.max(param.lower).min(param.upper),
            None => hidden |= !param.fixed,
        }
    }
    if hidden {
        unobserved_states(params, dynamics, run, &mut theta);
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
    // a run without the records that drive the model is refused by whoever simulates it
    drive[..m].copy_from_slice(run.inputs.get(sample * m..(sample + 1) * m)?);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::specimen::param;
    use fdm_grammar::Pattern;
    use fdm_system::dynamics::{Layout, Patterns};

    /// y0 = 2 x0 + 3 + u, y1 = x0 + x1, y2 = tan(x1 delayed); x2 is not seen.
    struct Shown(Layout);

    impl Dynamics for Shown {
        fn layout(&self) -> &Layout {
            &self.0
        }
        fn prepare(&self, _: &[f64], _: &mut [f64], _: &mut Workspace) {}
        fn rates(&self, _: Point<'_>, _: &mut [f64], _: &mut Workspace) {}
        fn rates_and_partials(&self, _: Point<'_>, _: &mut [f64], _: &mut Workspace) {}
        fn outputs(&self, _: Point<'_>, _: &mut [f64], _: &mut Workspace) {}
        fn by_input(&self, _: Point<'_>, _: &mut [f64], _: &mut Workspace) {}
        fn outputs_and_partials(&self, at: Point<'_>, out: &mut [f64], _: &mut Workspace) {
            let (x, past) = (at.x, at.drive[1]);
            let values = [2.0 * x[0] + 3.0 + at.drive[0], x[0] + x[1], past.tan()];
            out.copy_from_slice(&[&values[..], &[2.0, 1.0, 1.0, 1.0 / past.cos().powi(2)]].concat());
        }
    }

    fn pattern(rows: &[&[u32]]) -> Pattern {
        let ends = rows.iter().scan(0, |end, r| {
            *end += r.len() as u32;
            Some(*end)
        });
        Pattern { rows: std::iter::once(0).chain(ends).collect(), columns: rows.concat() }
    }

    fn shown() -> Shown {
        let none = |rows: usize| pattern(&vec![&[][..]; rows]);
        let patterns = Patterns {
            rates_by_state: none(3),
            rates_by_delayed: none(3),
            rates_by_param: none(3),
            rates_by_input: none(3),
            outputs_by_state: pattern(&[&[0], &[0, 1], &[]]),
            outputs_by_delayed: pattern(&[&[], &[], &[0]]),
            outputs_by_param: none(3),
            outputs_by_input: pattern(&[&[0], &[], &[]]),
            initial_by_param: none(3),
            tau_by_param: none(1),
            limits_by_param: none(0),
            events_by_state: none(0),
            events_by_input: none(0),
            events_by_param: none(0),
            events_by_time: none(0),
        };
        Shown(Layout {
            states: 3,
            inputs: 1,
            params: 4,
            outputs: 3,
            first: Vec::new(),
            vanishing: Vec::new(),
            wraps: Vec::new(),
            delayed: vec![Signal::State(1)],
            known: 0,
            initial: 0..0,
            tau: 0..0,
            initial_by_param: 0..0,
            tau_by_param: 0..0,
            derived: 0..0,
            limited: Vec::new(),
            limits: 0..0,
            limits_by_param: 0..0,
            events: Vec::new(),
            kinks: 0,
            observed: Vec::new(),
            affine: Default::default(),
            stage: Default::default(),
            patterns,
        })
    }

    #[test]
    fn states_are_guessed_from_the_outputs_that_show_them() {
        let mut params = vec![param("a", 7.0), param("x0(0)", 0.0), param("x1(0)", 0.0), param("x2(0)", 0.0)];
        for (k, p) in params.iter_mut().skip(1).enumerate() {
            p.origin = Origin::FreeInitial(k as u32);
        }
        let run = Run {
            name: "r".into(),
            time: vec![0.0, 1.0],
            inputs: vec![10.0, 20.0],
            held: vec![false],
            measured: vec![14.0, 5.0, f64::NAN, 0.0, 0.0, 0.5],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0, 0, 1],
        };
        let guess = initial_guess(&params, &shown(), &run);
        assert_eq!((guess[0], guess[1], guess[3]), (7.0, 0.5, 0.0));
        assert!((guess[2] - 0.5f64.atan()).abs() < 1e-12, "the first sample that is not empty counts");
        params[1].upper = 0.25;
        assert_eq!(initial_guess(&params, &shown(), &run)[1], 0.25);
    }
}
