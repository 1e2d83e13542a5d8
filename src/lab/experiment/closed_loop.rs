//! A plant under a digital controller: what the controller makes of the noisy measurements of one sample moves the plant from the next sample
//! on, linearly in between, so that the recorded inputs are exactly what the plant saw.

use super::experiment_error::{ExperimentError, Fault};
use super::flight::{Flight, names, rounded, unit};
use super::signal::Of;
use fdm_grammar::model::Quantity;
use fdm_system::Model;
use fdm_system::dynamics::{Point, Step, Workspace};
use fdm_system::simulate::Divergence;

/// What was recorded.
pub(super) struct Loop {
    pub(super) time: Vec<f64>,
    /// Name, unit and values of each column.
    pub(super) columns: Vec<(String, Option<String>, Vec<f64>)>,
}

/// Where an input comes from.
enum Feed {
    /// An output of the other one.
    Other(usize),
    /// A signal.
    Signal(Vec<f64>),
}

/// Flies the loop. Commands, inputs of the plant and its measured outputs are recorded.
///
/// # Errors
/// [`ExperimentError`], for names and signals that do not fit, and for a loop that runs away.
pub(super) fn closed(flight: &Flight<'_>, controller: &Model) -> Result<Loop, ExperimentError> {
    let plant = flight.truth;
    let quantities = |model: &Model| -> (Vec<Quantity>, Vec<Quantity>) {
        let d = model.definition();
        (d.inputs.iter().map(|i| i.quantity.clone()).collect(), d.outputs.iter().map(|o| o.quantity.clone()).collect())
    };
    let ((plant_in, plant_out), (loop_in, loop_out)) = (quantities(plant), quantities(controller));
    let all: Vec<&Quantity> = plant_in.iter().chain(&loop_in).collect();
    flight.known(&names(&all), &names(&plant_out.iter().collect::<Vec<_>>()))?;
    let plant_feeds = feeds(flight, &plant_in, &loop_out)?;
    let loop_feeds = feeds(flight, &loop_in, &plant_out)?;

    let (n, dt) = (flight.samples(), flight.record.dt);
    let mut drawn = Vec::new();
    for output in &plant_out {
        let Some((noise, mut chance)) = flight.noise(&output.name) else {
            drawn.push(vec![0.0; n]);
            continue;
        };
        if noise.of != Of::Unit || noise.logarithm {
            return Err(flight.fault(Fault::NoiseOfRecord { output: output.name.clone() }));
        }
        drawn.push(noise.drawn(n, dt, &mut chance).iter().map(|z| noise.deviation * z).collect::<Vec<f64>>());
    }

    // Runge-Kutta steps between samples
    let steps = flight.record.steps.unwrap_or(8).max(1);
    // at the first sample the controller has not spoken yet
    let first: Vec<f64> = plant_feeds.iter().map(|f| if let Feed::Signal(s) = f { s[0] } else { 0.0 }).collect();
    let mut body = Motion::new(flight, plant, flight.theta()?, &first, steps)?;
    let mut measured = body.outputs(0.0, &first);
    measured.iter_mut().zip(&drawn).for_each(|(y, z)| *y += z[0]);
    let digit = |y: f64| flight.record.digits.map_or(y, |digits| rounded(y, digits));
    let sensed = |measured: &[f64], k: usize| -> Vec<f64> {
        loop_feeds
            .iter()
            .map(|f| match f {
                Feed::Other(o) => digit(measured[*o]),
                Feed::Signal(s) => s[k],
            })
            .collect()
    };
    let mut seen = sensed(&measured, 0);
    let mut pilot = Motion::new(flight, controller, controller.definition().start(), &seen, steps)?;
    let mut moved = first;
    let mut rows: Vec<Vec<f64>> = vec![Vec::with_capacity(n); plant_in.len() + plant_out.len()];
    for k in 0..n {
        let t = dt * k as f64;
        let row = moved.iter().copied().chain(measured.iter().map(|y| digit(*y)));
        rows.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
        if k + 1 == n {
            break;
        }
        let said = pilot.outputs(t, &seen);
        let next: Vec<f64> = plant_feeds
            .iter()
            .map(|f| match f {
                Feed::Other(o) => said[*o],
                Feed::Signal(s) => s[k + 1],
            })
            .collect();
        body.advance(t, dt, &moved, &next);
        moved = next;
        measured = body.outputs(t + dt, &moved);
        if let Some(state) = body.x.iter().position(|x| !x.is_finite()) {
            let reason = Divergence { time: t + dt, state: Some(state), sample: k, event: None };
            return Err(ExperimentError::Diverged { record: flight.record.name.clone(), reason });
        }
        measured.iter_mut().zip(&drawn).for_each(|(y, z)| *y += z[k + 1]);
        let now = sensed(&measured, k + 1);
        pilot.advance(t, dt, &seen, &now);
        seen = now;
    }

    let channels = plant_in.iter().chain(&plant_out).zip(rows);
    let mut columns: Vec<_> = channels.map(|(q, values)| (q.name.clone(), unit(q), values)).collect();
    for (command, feed) in loop_in.iter().zip(loop_feeds) {
        if let Feed::Signal(values) = feed {
            columns.push((command.name.clone(), unit(command), values));
        }
    }
    Ok(Loop { time: (0..n).map(|k| dt * k as f64).collect(), columns })
}

/// Each input from the output of the same name, or from its signal.
fn feeds(flight: &Flight<'_>, inputs: &[Quantity], outputs: &[Quantity]) -> Result<Vec<Feed>, ExperimentError> {
    let one = |input: &Quantity| match outputs.iter().position(|o| o.name == input.name) {
        Some(k) => Ok(Feed::Other(k)),
        None => {
            let values = flight.input(input)?;
            values.map(Feed::Signal).ok_or_else(|| flight.fault(Fault::Unfed { input: input.name.clone() }))
        }
    };
    inputs.iter().map(one).collect()
}

/// A model on its way from sample to sample.
struct Motion<'m> {
    model: &'m Model,
    known: Vec<f64>,
    x: Vec<f64>,
    work: Workspace,
    steps: usize,
}

impl<'m> Motion<'m> {
    fn new(
        flight: &Flight<'_>,
        model: &'m Model,
        mut theta: Vec<f64>,
        first: &[f64],
        steps: usize,
    ) -> Result<Self, ExperimentError> {
        let (layout, dynamics) = (model.layout(), model.dynamics());
        if !layout.delayed.is_empty()
            || !layout.vanishing.is_empty()
            || model.definition().inputs.iter().any(|i| !i.is_declared())
        {
            return Err(flight.fault(Fault::NotInLoop { name: model.name().into() }));
        }
        layout.first.iter().for_each(|(param, input)| theta[*param as usize] = first[*input as usize]);
        let (mut work, mut known) = (Workspace::new(dynamics), vec![0.0; layout.known]);
        dynamics.prepare(&theta, &mut known, &mut work);
        let x = known[layout.initial.clone()].to_vec();
        Ok(Self { model, known, x, work, steps })
    }

    fn outputs(&mut self, t: f64, drive: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; self.model.layout().outputs];
        let at = Point { t, x: &self.x, drive, known: &self.known };
        self.model.dynamics().outputs(at, &mut y, &mut self.work);
        y
    }

    /// From one sample to the next, inputs linear from `from` to `to`.
    fn advance(&mut self, t: f64, dt: f64, from: &[f64], to: &[f64]) {
        let h = dt / self.steps as f64;
        let mut next = vec![0.0; self.x.len()];
        let mut drive = Vec::with_capacity(3 * from.len());
        for k in 0..self.steps {
            drive.clear();
            for part in [0.0, 0.5, 1.0] {
                let share = (k as f64 + part) / self.steps as f64;
                drive.extend(from.iter().zip(to).map(|(a, b)| a + (b - a) * share));
            }
            let step = Step { t: t + h * k as f64, h, x: &self.x, drive: &drive, known: &self.known };
            self.model.dynamics().step(step, &mut next, &mut self.work);
            self.x.copy_from_slice(&next);
        }
    }
}
