//! First guesses of free initial states from the first measured sample.
//!
//! First guesses of free initial states that no output shows by itself: from the values of the outputs and their slopes at the beginning
//! of a run, both smoothed, through the model's own equations.
//!
//! The slope of an output is `h_x f(x) + h_u u'`: where positions and attitudes are measured these are the kinematic equations, solved for
//! velocities and rates of rotation. What outputs and slopes do not tell (the place of an actuator) begins at rest, where its own rate
//! is zero. Slopes are those of parabolas through the first samples, as many as noise alone explains what is left
//! (Klein and Morelli 2006, chapter 11, smooth local polynomials for the same purpose).

use fdm_grammar::graph::Signal;
use fdm_grammar::model::{Origin, Param};
use fdm_system::dynamics::{Dynamics, Layout, Point, Workspace};
use fdm_system::record::Run;
use nalgebra::{DMatrix, DVector};

/// Start values of all parameters (p) for one run: their own, except that a free initial state is guessed
/// from the first measured value of an output that shows this state and no other (`y = x`, `y = k x + c`, `y = tan(x)`).
/// Where some state is shown by no output so, all of them are found together from smoothed outputs and their slopes; what these
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
    // corrections before a nonlinear output is given up
    for _ in 0..20 {
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

/// Numbers of samples that parabolas are laid through.
const WINDOWS: [usize; 6] = [5, 9, 17, 33, 65, 129];
/// A longer window is taken while its residual variance is below this many times that of the noise.
const BENT: f64 = 1.5;
/// Gauss-Newton steps, and halvings of one.
const STEPS: usize = 30;
const HALVINGS: usize = 12;
/// Singular values below this part of the largest one tell nothing.
const UNTOLD: f64 = 1e-6;
/// A state of which less than this part lies in what is told begins at rest.
const TOLD: f64 = 0.5;

/// Replaces the free initial values among all parameters of a run (p), where some of them are `unobserved`: shown by no output by
/// itself. Without measured outputs, or where nothing better is found, they stay.
pub(crate) fn unobserved_states(params: &[Param], dynamics: &dyn Dynamics, run: &Run, theta: &mut [f64]) {
    let layout = dynamics.layout();
    let free: Vec<(usize, usize)> = params
        .iter()
        .enumerate()
        .filter_map(|(k, p)| match p.origin {
            Origin::FreeInitial(state) if !p.fixed => Some((k, state as usize)),
            _ => None,
        })
        .collect();
    let beginnings: Vec<Option<Beginning>> = (0..layout.outputs)
        .map(|o| Beginning::of(run, o, layout.outputs).filter(|_| !sees_the_past(layout, o)))
        .collect();
    if free.is_empty() || beginnings.iter().all(Option::is_none) {
        return;
    }
    let Some(mut search) = Search::new(dynamics, run, theta, &free, &beginnings) else { return };
    search.solve();
    search.rest();
    for ((k, state), before) in free.iter().zip(search.begun.clone()) {
        let value = search.x[*state];
        let inside = value.max(params[*k].lower).min(params[*k].upper);
        theta[*k] = if inside.is_finite() { inside } else { before };
    }
}

/// Whether an output sees a state at an earlier time: it has no slope then.
fn sees_the_past(layout: &Layout, output: usize) -> bool {
    layout.patterns.outputs_by_delayed.row(output).any(|(_, d)| matches!(layout.delayed[d], Signal::State(_)))
}

/// An output at the beginning of a run, smoothed: value and slope with their standard deviations.
#[derive(Debug, Clone, Copy)]
struct Beginning {
    value: f64,
    slope: f64,
    deviations: [f64; 2],
}

impl Beginning {
    fn of(run: &Run, output: usize, q: usize) -> Option<Self> {
        let begin = *run.time.first()?;
        let samples = run.time.iter().enumerate().map(|(k, t)| (t - begin, run.measured[k * q + output]));
        let samples: Vec<(f64, f64)> = samples.filter(|(_, z)| !z.is_nan()).take(WINDOWS[WINDOWS.len() - 1]).collect();
        // third differences leave noise alone
        let third = |w: &[(f64, f64)]| (w[3].1 - 3.0 * w[2].1 + 3.0 * w[1].1 - w[0].1).powi(2) / 20.0;
        let count = samples.len().checked_sub(3).filter(|n| *n > 1)?;
        let noise = samples.windows(4).map(third).sum::<f64>() / count as f64;
        let mut found = None;
        for window in WINDOWS.into_iter().filter(|w| *w <= samples.len()) {
            let Some((own, variance)) = Self::parabola(&samples[..window], noise) else { continue };
            if found.is_some() && variance > BENT * noise {
                break;
            }
            found = Some(own);
        }
        found
    }

    /// The parabola through these samples, and the variance of what is left.
    fn parabola(samples: &[(f64, f64)], noise: f64) -> Option<(Self, f64)> {
        let (n, span) = (samples.len(), samples[samples.len() - 1].0);
        let rows = DMatrix::from_fn(n, 3, |k, power| (samples[k].0 / span).powi(power as i32));
        let values = DVector::from_iterator(n, samples.iter().map(|(_, z)| *z));
        let inverse = (rows.transpose() * &rows).try_inverse()?;
        let found = &inverse * rows.transpose() * &values;
        let left = (values - rows * &found).norm_squared() / (n - 3) as f64;
        // without noise a value is known to its last digits
        let size = samples.iter().fold(f64::MIN_POSITIVE, |s, (_, z)| s.max(z.abs()));
        let variance = left.max(noise).max((1e-9 * size).powi(2));
        let deviations = [(variance * inverse[(0, 0)]).sqrt(), (variance * inverse[(1, 1)]).sqrt() / span];
        let own = Self { value: found[0], slope: found[1] / span, deviations };
        (own.value.is_finite() && own.slope.is_finite()).then_some((own, left))
    }
}

/// Residuals and their derivatives at some states, row by row; a row that is not finite there is left out.
struct Rows {
    residuals: Vec<Option<f64>>,
    derivatives: DMatrix<f64>,
}

struct Search<'a> {
    dynamics: &'a dyn Dynamics,
    known: Vec<f64>,
    t: f64,
    /// Drive at the first sample, and its slope.
    drive: Vec<f64>,
    slope: Vec<f64>,
    beginnings: &'a [Option<Beginning>],
    /// The states that are sought.
    sought: Vec<usize>,
    x: Vec<f64>,
    /// Where the search began.
    begun: Vec<f64>,
    /// Of each sought state the part that lies in what outputs and slopes tell.
    told: Vec<f64>,
    work: Workspace,
    rates: Vec<f64>,
    outputs: Vec<f64>,
    by_input: Vec<f64>,
}

impl<'a> Search<'a> {
    fn new(
        dynamics: &'a dyn Dynamics,
        run: &'a Run,
        theta: &[f64],
        free: &[(usize, usize)],
        beginnings: &'a [Option<Beginning>],
    ) -> Option<Self> {
        let layout = dynamics.layout();
        let (mut work, mut known, m) = (Workspace::new(dynamics), vec![0.0; layout.known], layout.inputs);
        dynamics.prepare(theta, &mut known, &mut work);
        let mut x = known[layout.initial.clone()].to_vec();
        free.iter().for_each(|(k, state)| x[*state] = theta[*k]);
        let mut drive = vec![0.0; layout.drive()];
        drive[..m].copy_from_slice(run.inputs.get(..m)?);
        let mut slope = vec![0.0; layout.drive()];
        if let (Some(next), [first, second, ..]) = (run.inputs.get(m..2 * m), &run.time[..]) {
            for input in (0..m).filter(|i| !run.held.get(*i).is_some_and(|held| *held)) {
                slope[input] = (next[input] - drive[input]) / (second - first);
            }
        }
        let sought: Vec<usize> = free.iter().map(|(_, state)| *state).collect();
        let begun = sought.iter().map(|s| x[*s]).collect();
        Some(Self {
            dynamics,
            known,
            t: *run.time.first()?,
            drive,
            slope,
            beginnings,
            told: vec![0.0; sought.len()],
            sought,
            x,
            begun,
            work,
            rates: vec![0.0; layout.rate_slots()],
            outputs: vec![0.0; layout.output_slots()],
            by_input: vec![0.0; layout.input_slots()],
        })
    }

    /// Rates, outputs and partials at `x`.
    fn evaluate(&mut self, x: &[f64]) {
        let layout = self.dynamics.layout();
        for (d, signal) in layout.delayed.iter().enumerate() {
            // before the run a signal has its first value
            self.drive[layout.inputs + d] = match *signal {
                Signal::State(k) => x[k as usize],
                Signal::Input(k) => self.drive[k as usize],
            };
        }
        let at = Point { t: self.t, x, drive: &self.drive, known: &self.known };
        self.dynamics.rates_and_partials(at, &mut self.rates, &mut self.work);
        self.dynamics.outputs_and_partials(at, &mut self.outputs, &mut self.work);
        self.dynamics.by_input(at, &mut self.by_input, &mut self.work);
    }

    /// What outputs and slopes miss at `x`, in their deviations: two rows for each output.
    fn rows(&mut self, x: &[f64]) -> Rows {
        self.evaluate(x);
        let layout = self.dynamics.layout();
        let (patterns, q, n) = (&layout.patterns, layout.outputs, self.sought.len());
        let place = |state: usize| self.sought.iter().position(|s| *s == state);
        let mut derivatives = DMatrix::<f64>::zeros(2 * q, n);
        let mut residuals = vec![None; 2 * q];
        for (o, beginning) in self.beginnings.iter().enumerate() {
            let Some(beginning) = beginning else { continue };
            let (mut slope, first) = (0.0, patterns.rates_by_input.len());
            for (k, input) in patterns.outputs_by_input.row(o) {
                slope += self.by_input[first + k] * self.slope[input];
            }
            for (k, state) in patterns.outputs_by_state.row(o) {
                let along = self.outputs[q + k];
                slope += along * self.rates[state];
                place(state).into_iter().for_each(|j| derivatives[(2 * o, j)] += along);
                for (entry, other) in patterns.rates_by_state.row(state) {
                    let through = along * self.rates[layout.stage.by_state[entry] as usize];
                    place(other).into_iter().for_each(|j| derivatives[(2 * o + 1, j)] += through);
                }
            }
            let off = [beginning.value - self.outputs[o], beginning.slope - slope];
            for (side, (off, deviation)) in off.into_iter().zip(beginning.deviations).enumerate() {
                let row = 2 * o + side;
                derivatives.row_mut(row).iter_mut().for_each(|d| *d /= deviation);
                let finite = off.is_finite() && derivatives.row(row).iter().all(|d| d.is_finite());
                residuals[row] = finite.then_some(off / deviation);
            }
        }
        Rows { residuals, derivatives }
    }

    /// Gauss-Newton steps in the directions that the rows tell anything of.
    fn solve(&mut self) {
        for _ in 0..STEPS {
            let x = self.x.clone();
            let rows = self.rows(&x);
            let finite: Vec<usize> = (0..rows.residuals.len()).filter(|r| rows.residuals[*r].is_some()).collect();
            if finite.is_empty() {
                return;
            }
            let residual = |rows: &Rows, r: &usize| rows.residuals[*r].unwrap_or(f64::INFINITY);
            let off = DVector::from_iterator(finite.len(), finite.iter().map(|r| residual(&rows, r)));
            let mut slopes = rows.derivatives.select_rows(&finite);
            let scale: Vec<f64> = slopes.column_iter().map(|c| c.norm()).collect();
            for (mut column, scale) in slopes.column_iter_mut().zip(&scale).filter(|(_, s)| **s > 0.0) {
                column /= *scale;
            }
            let svd = slopes.svd(true, true);
            let (Some(left), Some(right)) = (&svd.u, &svd.v_t) else { return };
            let least = UNTOLD * svd.singular_values.iter().copied().fold(0.0, f64::max);
            let mut step = DVector::zeros(scale.len());
            self.told.fill(0.0);
            for (k, singular) in svd.singular_values.iter().enumerate().filter(|(_, s)| **s > least) {
                step += right.row(k).transpose() * (left.column(k).dot(&off) / singular);
                self.told.iter_mut().zip(right.row(k).iter()).for_each(|(told, v)| *told += v * v);
            }
            let before = off.norm_squared();
            let mut part = 1.0;
            let accepted = (0..HALVINGS).any(|_| {
                let mut trial = x.clone();
                for ((state, step), scale) in self.sought.iter().zip(step.iter()).zip(&scale) {
                    trial[*state] += if *scale > 0.0 { part * step / scale } else { 0.0 };
                }
                let next = self.rows(&trial);
                let cost: f64 = finite.iter().map(|r| residual(&next, r).powi(2)).sum();
                let better = cost < before;
                if better {
                    self.x = trial;
                }
                part *= 0.5;
                better
            });
            let small = |(state, before): (&usize, &f64)| {
                let moved = (self.x[*state] - before).abs();
                moved <= 1e-9 * self.x[*state].abs()
            };
            let old: Vec<f64> = self.sought.iter().map(|s| x[*s]).collect();
            if !accepted || self.sought.iter().zip(&old).all(small) {
                return;
            }
        }
    }

    /// States that nothing tells begin where their own rates vanish, one after the other.
    fn rest(&mut self) {
        for j in (0..self.sought.len()).filter(|j| self.told[*j] < TOLD).collect::<Vec<_>>() {
            let state = self.sought[j];
            for _ in 0..STEPS {
                let x = self.x.clone();
                self.evaluate(&x);
                let layout = self.dynamics.layout();
                let own = layout.patterns.rates_by_state.row(state).find(|(_, other)| *other == state);
                let Some((entry, _)) = own else { break };
                let step = self.rates[state] / self.rates[layout.stage.by_state[entry] as usize];
                if !step.is_finite() {
                    break;
                }
                self.x[state] -= step;
                if step.abs() <= 1e-12 * self.x[state].abs() {
                    break;
                }
            }
        }
    }
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

#[cfg(test)]
mod unobserved_states_tests {
    use crate::problem::initial::initial_guess;
    use fdm_system::model::Model;
    use fdm_system::record::Run;
    use fdm_system::simulate::Simulator;

    /// A body that turns and moves in the plane: only place and heading are measured; an actuator follows its command.
    #[test]
    fn velocities_come_from_positions_and_attitudes_and_actuators_rest() {
        let text = "model m { input u; param a = -0.5, Nr = -1, Nd = 2, T = 0.1;
            state x = free, y = free, psi = free, V = free, w = free, r = free, d = free;
            der(x) = V*cos(psi) - w*sin(psi); der(y) = V*sin(psi) + w*cos(psi); der(psi) = r;
            der(V) = a*(V - 12); der(w) = -2*w - 0.1*V*r; der(r) = Nr*r + Nd*d/hypot(V, w); der(d) = (u - d)/T;
            output xm = x, ym = y, heading = psi, fast = hypot(V, w); }";
        let model = Model::from_text("m.fdm", text).unwrap();
        let n = 400;
        let time: Vec<f64> = (0..n).map(|k| 0.02 * f64::from(k)).collect();
        let inputs = time.iter().map(|t| 0.3 + 0.2 * (1.3 * t).sin()).collect();
        let gaps = vec![0; 4];
        let mut run = Run {
            name: "r".into(),
            inputs,
            held: vec![false],
            measured: vec![0.0; 4 * time.len()],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: gaps,
            time,
        };
        let truth = [3.0, -2.0, 0.8, 10.0, 0.7, 0.4, 0.3];
        let params = &model.definition().params;
        let place = |state: &str| params.iter().position(|p| p.quantity.name == format!("{state}(0)")).unwrap();
        let mut theta = model.definition().start();
        let names = ["x", "y", "psi", "V", "w", "r", "d"];
        names.iter().zip(truth).for_each(|(name, value)| theta[place(name)] = value);
        let mut y = vec![0.0; 4 * run.len()];
        Simulator::new(model.dynamics(), &run, 4).unwrap().simulate(&theta, &mut y).unwrap();
        let mut normal = fdm_numeric::random::Normal(11);
        let deviations = [0.003, 0.003, 0.003, 0.05];
        run.measured = y.iter().enumerate().map(|(k, y)| y + deviations[k % 4] * normal.next()).collect();
        // positions alone: the airspeed is a column without values
        let mut blind = run.clone();
        blind.measured.iter_mut().skip(3).step_by(4).for_each(|z| *z = f64::NAN);
        for run in [&run, &blind] {
            let guess = initial_guess(params, model.dynamics(), run);
            for (name, (value, near)) in names.iter().zip(truth.iter().zip([0.01, 0.01, 0.01, 0.2, 0.2, 0.1, 1e-9])) {
                let off = (guess[place(name)] - value).abs();
                assert!(off < near, "{name}: {} and {value}", guess[place(name)]);
            }
        }
    }
}
