//! A point at which a model is looked at, and what the tape says there.

use fdm_system::Model;
use fdm_system::code::Tape;
use fdm_system::dynamics::{Dynamics, Point, Workspace};

/// Names of arrays, each with its numbers.
pub(super) type Numbers = Vec<(&'static str, Vec<f64>)>;

/// A point.
pub(super) struct Site {
    pub(super) t: f64,
    pub(super) theta: Vec<f64>,
    pub(super) x: Vec<f64>,
    pub(super) drive: Vec<f64>,
}

/// Numbers between -1 and 1 (splitmix64).
pub(super) struct Noise(pub(super) u64);

impl Noise {
    pub(super) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (((z ^ (z >> 31)) >> 32) as f64) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    /// Near given values, and not zero.
    pub(super) fn around(&mut self, values: &[f64]) -> Vec<f64> {
        values.iter().map(|v| v + (0.05 * v.abs() + 0.001) * self.next()).collect()
    }
}

impl Site {
    /// The first one is that of the model's own values.
    pub(super) fn new(model: &Model, seed: u64) -> Self {
        let (layout, mut noise) = (model.layout(), Noise(seed));
        let start: Vec<f64> = model.definition().start();
        let theta = if seed == 0 { start } else { noise.around(&start) };
        let mut known = vec![0.0; layout.known];
        model.dynamics().prepare(&theta, &mut known, &mut Workspace::new(model.dynamics()));
        Self {
            t: noise.next().abs(),
            x: noise.around(&known[layout.initial.clone()]),
            drive: (0..layout.drive()).map(|_| noise.next()).collect(),
            theta,
        }
    }

    /// What the tape says: everything that generated source computes.
    pub(super) fn expected(&self, model: &Model) -> Numbers {
        let tape = Tape::new(model.schedule());
        let (layout, p) = (model.layout(), &model.layout().patterns);
        let (n, q, mut work) = (layout.states, layout.outputs, Workspace::new(&tape));
        let mut known = vec![0.0; layout.known];
        tape.prepare(&self.theta, &mut known, &mut work);
        let at = Point { t: self.t, x: &self.x, drive: &self.drive, known: &known };
        let mut row = vec![0.0; layout.rate_slots()];
        tape.rates_and_partials(at, &mut row, &mut work);
        let f_x = layout.stage.by_state.iter().map(|slot| row[*slot as usize]).collect();
        let f_delayed = row[layout.stage.by_delayed..][..p.rates_by_delayed.len()].to_vec();
        let f_theta = p.rates_by_param.entries().filter_map(|(_, i, j)| Some(row[layout.stage.by_param(i, j)?]));
        let mut out = vec![0.0; layout.output_slots()];
        tape.outputs_and_partials(at, &mut out, &mut work);
        let (y_x, rest) = out[q..].split_at(p.outputs_by_state.len());
        let (y_delayed, y_theta) = rest.split_at(p.outputs_by_delayed.len());
        let mut by_input = vec![0.0; layout.input_slots()];
        tape.by_input(at, &mut by_input, &mut work);
        let (f_u, y_u) = by_input.split_at(p.rates_by_input.len());
        vec![
            ("what parameters alone determine", known),
            ("derivatives of the states", row[..n].to_vec()),
            ("derivatives of the states", row[..n].to_vec()),
            ("their partials by states", f_x),
            ("their partials by delayed signals", f_delayed),
            ("their partials by parameters", f_theta.collect()),
            ("outputs", out[..q].to_vec()),
            ("outputs", out[..q].to_vec()),
            ("partials of outputs by states", y_x.to_vec()),
            ("partials of outputs by delayed signals", y_delayed.to_vec()),
            ("partials of outputs by parameters", y_theta.to_vec()),
            ("their partials by inputs", f_u.to_vec()),
            ("partials of outputs by inputs", y_u.to_vec()),
        ]
    }
}
