//! The one door between language and numerics: a model as functions on slices of numbers.
//!
//! **In** points (time, states, drive, prepared parameters). **Out** rates, outputs and the structural nonzeros of their
//! partials, in the order that [`Layout`] describes. **Never** names, units or text.
//! **Start** at [`Dynamics`]; it is implemented by the tape, by machine code and by every `model!`.

pub use fdm_grammar::schedule::{EventRow, Layout, Patterns, StageRow};

/// Where a model is evaluated.
#[derive(Debug, Clone, Copy)]
pub struct Point<'a> {
    /// Time since the run began, in the model's time unit.
    pub t: f64,
    /// States (n).
    pub x: &'a [f64],
    /// Inputs (m), then delayed signals.
    pub drive: &'a [f64],
    /// What [`Dynamics::prepare`] computed from the parameters.
    pub known: &'a [f64],
}

/// One step of the classical Runge-Kutta method.
#[derive(Debug, Clone, Copy)]
pub struct Step<'a> {
    /// Time at the beginning.
    pub t: f64,
    /// Length of the step.
    pub h: f64,
    /// States at the beginning (n).
    pub x: &'a [f64],
    /// Drive at the beginning, in the middle and at the end of the step, one row each (3 by drive).
    pub drive: &'a [f64],
    /// What [`Dynamics::prepare`] computed.
    pub known: &'a [f64],
}

/// Memory that evaluations reuse, so that no solve allocates.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    /// Values of an interpreter.
    pub values: Vec<f64>,
    /// Slopes and states inside a step (5 n).
    pub stage: Vec<f64>,
}

impl Workspace {
    /// Memory enough for one model.
    pub fn new(dynamics: &dyn Dynamics) -> Self {
        let n = dynamics.layout().states;
        Self { values: vec![0.0; dynamics.workspace()], stage: vec![0.0; 5 * n] }
    }
}

/// A compiled model. All results are written to the front of the given slices; nothing allocates.
pub trait Dynamics: Send + Sync {
    /// Sizes, patterns and positions.
    fn layout(&self) -> &Layout;

    /// How many numbers an evaluation needs in [`Workspace::values`].
    fn workspace(&self) -> usize {
        0
    }

    /// Parameters (p, in the model's order) to everything that depends on them alone (`layout.known`).
    fn prepare(&self, theta: &[f64], known: &mut [f64], work: &mut Workspace);

    /// Rates f (n).
    fn rates(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace);

    /// Rates, f_x, f_delay and f_theta as [`StageRow`] arranges them (`layout.rate_slots()`). Structural zeros are not
    /// written: `out` must hold zeros there.
    fn rates_and_partials(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace);

    /// Outputs h (q).
    fn outputs(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace);

    /// Outputs and the entries of h_x, h_delay, h_theta (`layout.output_slots()`).
    fn outputs_and_partials(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace);

    /// The entries of f_u and h_u (`layout.input_slots()`).
    fn by_input(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace);

    /// Guards of all events, which pass zero upwards when they happen, then the values that they set; of a model without events the
    /// switching functions of its rates (`layout.event_rows()`).
    fn events(&self, _at: Point<'_>, _out: &mut [f64], _work: &mut Workspace) {}

    /// Guards of all events and the values that they set, then the entries of their partials by states, inputs,
    /// parameters and time (`layout.event_slots()`).
    fn events_and_partials(&self, _at: Point<'_>, _out: &mut [f64], _work: &mut Workspace) {}

    /// Where the model has events, hard limits or kinks, f_t (n). Structural zeros are not written: `out` must hold zeros there.
    fn rates_by_time(&self, _at: Point<'_>, _out: &mut [f64], _work: &mut Workspace) {}

    /// Loads the foreign code that programs call, and tries it.
    ///
    /// # Errors
    /// Why nothing can be computed.
    fn ready(&self) -> Result<(), String> {
        Ok(())
    }

    /// The states after one Runge-Kutta step (n).
    fn step(&self, step: Step<'_>, next: &mut [f64], work: &mut Workspace) {
        by_stages(self, step, next, work);
    }

    /// The states of [`Self::step`] (to the bit), and the results of `rates_and_partials` at the four stages, one row
    /// each.
    fn step_with_partials(&self, step: Step<'_>, next: &mut [f64], stages: &mut [f64], work: &mut Workspace) {
        by_stages_with_partials(self, step, next, stages, work);
    }
}

/// [`Dynamics::step`] by four calls of `rates`.
pub(crate) fn by_stages<D: Dynamics + ?Sized>(dynamics: &D, step: Step<'_>, next: &mut [f64], work: &mut Workspace) {
    let (n, width) = (dynamics.layout().states, dynamics.layout().drive());
    runge_kutta(step, n, width, next, work, |_, at, out, work| dynamics.rates(at, out, work));
}

/// [`Dynamics::step_with_partials`] by four calls of `rates_and_partials`.
pub(crate) fn by_stages_with_partials<D: Dynamics + ?Sized>(
    dynamics: &D,
    step: Step<'_>,
    next: &mut [f64],
    stages: &mut [f64],
    work: &mut Workspace,
) {
    let layout = dynamics.layout();
    let (n, width, slots) = (layout.states, layout.drive(), layout.rate_slots());
    runge_kutta(step, n, width, next, work, |k, at, out, work| {
        let row = &mut stages[k * slots..(k + 1) * slots];
        dynamics.rates_and_partials(at, row, work);
        out.copy_from_slice(&row[..n]);
    });
}

/// The order of these operations is part of the contract: machine code repeats it to the bit.
#[inline(always)]
pub(crate) fn runge_kutta(
    step: Step<'_>,
    n: usize,
    width: usize,
    next: &mut [f64],
    work: &mut Workspace,
    mut rates: impl FnMut(usize, Point<'_>, &mut [f64], &mut Workspace),
) {
    let Step { t, h, x, drive, known } = step;
    let mut stage = std::mem::take(&mut work.stage);
    let (slopes, states) = stage.split_at_mut(4 * n);
    let half = 0.5 * h;
    // stage: time, row of the drive, reach from the step's beginning
    for (k, (at, row, reach)) in
        [(t, 0, 0.0), (t + half, 1, half), (t + half, 1, half), (t + h, 2, h)].into_iter().enumerate()
    {
        if k > 0 {
            let slope = &slopes[(k - 1) * n..k * n];
            for i in 0..n {
                states[i] = x[i] + reach * slope[i];
            }
        } else {
            states[..n].copy_from_slice(&x[..n]);
        }
        let point = Point { t: at, x: &states[..n], drive: &drive[row * width..(row + 1) * width], known };
        rates(k, point, &mut slopes[k * n..(k + 1) * n], work);
    }
    let (sixth, third) = (h / 6.0, h / 3.0);
    for i in 0..n {
        let (k1, k2, k3, k4) = (slopes[i], slopes[n + i], slopes[2 * n + i], slopes[3 * n + i]);
        // the last slope enters last: it is the one that the next step waits for
        next[i] = ((x[i] + sixth * k1) + third * (k2 + k3)) + sixth * k4;
    }
    work.stage = stage;
}
