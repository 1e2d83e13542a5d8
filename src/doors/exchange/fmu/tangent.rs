//! Exact derivatives of a unit's variables, from the model's compiled Jacobians.

use super::instance::{Instance, Mode, Refused, expect};
use super::variables::Kind;
use fdm_grammar::graph::Signal;
use fdm_system::dynamics::Point;

/// Directions of what is given, and what follows from them.
struct Directions {
    theta: Vec<f64>,
    inputs: Vec<f64>,
    states: Vec<f64>,
    rates: Vec<f64>,
    raw: Vec<f64>,
    outputs: Vec<f64>,
    limits: Vec<f64>,
}

impl Instance {
    /// The derivative of some variables in a direction of others: `sensitivity = J seed`. Unknown are state derivatives, outputs and
    /// event indicators, and while the unit is initialized states; known are inputs, states and parameters.
    ///
    /// # Errors
    /// [`Refused::NoDerivative`], [`Refused::NoVariable`], [`Refused::Count`].
    pub fn directional(
        &mut self,
        unknowns: &[u32],
        knowns: &[u32],
        seed: &[f64],
        sensitivity: &mut [f64],
    ) -> Result<(), Refused> {
        expect(seed.len(), knowns.len())?;
        expect(sensitivity.len(), unknowns.len())?;
        let layout = self.layout();
        let mut d = Directions {
            theta: vec![0.0; layout.params],
            inputs: vec![0.0; layout.inputs],
            states: vec![0.0; layout.states],
            rates: vec![0.0; layout.states],
            raw: vec![0.0; layout.states],
            outputs: vec![0.0; layout.outputs],
            limits: vec![0.0; layout.limits.len()],
        };
        let beginning = self.moving.mode == Mode::Beginning;
        for (known, seed) in knowns.iter().zip(seed) {
            match self.variables.get(*known).ok_or(Refused::NoVariable(*known))?.kind {
                Kind::Parameter(k) => d.theta[k] += seed,
                Kind::Input(k) | Kind::Known(k) => d.inputs[k] += seed,
                Kind::State(k) if !beginning => d.states[k] += seed,
                _ => return Err(self.no_derivative(unknowns.first().copied(), *known)),
            }
        }
        self.propagate(&mut d)?;
        for (unknown, out) in unknowns.iter().zip(sensitivity) {
            *out = match self.variables.get(*unknown).ok_or(Refused::NoVariable(*unknown))?.kind {
                Kind::Rate(k) => d.rates[k],
                Kind::Output(k) => d.outputs[k],
                Kind::State(k) if beginning => d.states[k],
                Kind::Indicator(k) => {
                    let state = self.layout().limited[k / 2] as usize;
                    match (k % 2, self.rests_at(k)) {
                        (0, true) => d.raw[state],
                        (_, true) => -d.raw[state],
                        (0, false) => d.states[state] - d.limits[k],
                        _ => d.limits[k] - d.states[state],
                    }
                }
                _ => return Err(self.no_derivative(Some(*unknown), knowns.first().copied().unwrap_or(0))),
            };
        }
        Ok(())
    }

    /// Derivatives from the side of the unknowns: `sensitivity = seed J`.
    ///
    /// # Errors
    /// As [`Self::directional`].
    pub fn adjoint(
        &mut self,
        unknowns: &[u32],
        knowns: &[u32],
        seed: &[f64],
        sensitivity: &mut [f64],
    ) -> Result<(), Refused> {
        expect(seed.len(), unknowns.len())?;
        expect(sensitivity.len(), knowns.len())?;
        let mut column = vec![0.0; unknowns.len()];
        for (known, out) in knowns.iter().zip(sensitivity) {
            self.directional(unknowns, std::slice::from_ref(known), &[1.0], &mut column)?;
            *out = column.iter().zip(seed).map(|(a, b)| a * b).sum();
        }
        Ok(())
    }

    fn no_derivative(&self, of: Option<u32>, by: u32) -> Refused {
        let name = |k: u32| self.variables.get(k).map(|v| v.name.clone()).unwrap_or_default();
        Refused::NoDerivative { of: of.map(name).unwrap_or_default(), by: name(by) }
    }

    fn propagate(&mut self, d: &mut Directions) -> Result<(), Refused> {
        self.prepare();
        self.fill_drive()?;
        let model = self.model.clone();
        let (layout, patterns) = (model.layout(), &model.layout().patterns);
        let beginning = self.moving.mode == Mode::Beginning;
        if beginning {
            for (param, input) in &layout.first {
                d.theta[*param as usize] = d.inputs[*input as usize];
            }
            for (k, i, j) in patterns.initial_by_param.entries() {
                d.states[i] += self.known[layout.initial_by_param.start + k] * d.theta[j];
            }
        }
        let mut tau = vec![0.0; layout.delayed.len()];
        for (k, i, j) in patterns.tau_by_param.entries() {
            tau[i] += self.known[layout.tau_by_param.start + k] * d.theta[j];
        }
        for (k, i, j) in patterns.limits_by_param.entries() {
            d.limits[i] += self.known[layout.limits_by_param.start + k] * d.theta[j];
        }
        let mut delayed = vec![0.0; layout.delayed.len()];
        for (k, out) in delayed.iter_mut().enumerate() {
            let seen = self.delayed(k)?;
            let signal = match layout.delayed[k] {
                Signal::Input(i) => d.inputs[i as usize],
                Signal::State(i) => d.states[i as usize],
            };
            *out = seen.now * signal - seen.slope * tau[k];
        }
        let at = Point {
            t: self.moving.time - self.moving.start,
            x: &self.moving.x,
            drive: &self.drive,
            known: &self.known,
        };
        let mut row = vec![0.0; layout.rate_slots()];
        model.dynamics().rates_and_partials(at, &mut row, &mut self.work);
        let mut by_input = vec![0.0; layout.input_slots()];
        model.dynamics().by_input(at, &mut by_input, &mut self.work);
        for ((_, i, j), slot) in patterns.rates_by_state.entries().zip(&layout.stage.by_state) {
            d.raw[i] += row[*slot as usize] * d.states[j];
        }
        for (k, i, j) in patterns.rates_by_delayed.entries() {
            d.raw[i] += row[layout.stage.by_delayed + k] * delayed[j];
        }
        for (_, i, j) in patterns.rates_by_param.entries() {
            if let Some(slot) = layout.stage.by_param(i, j) {
                d.raw[i] += row[slot] * d.theta[j];
            }
        }
        for (k, i, j) in patterns.rates_by_input.entries() {
            d.raw[i] += by_input[k] * d.inputs[j];
        }
        for (k, rate) in d.rates.iter_mut().enumerate() {
            *rate = if self.is_held(k) { 0.0 } else { d.raw[k] };
        }
        let mut out = vec![0.0; layout.output_slots()];
        model.dynamics().outputs_and_partials(at, &mut out, &mut self.work);
        let (by_state, rest) = out[layout.outputs..].split_at(patterns.outputs_by_state.len());
        let (by_delayed, by_param) = rest.split_at(patterns.outputs_by_delayed.len());
        let terms = [
            (&patterns.outputs_by_state, by_state, &d.states[..]),
            (&patterns.outputs_by_delayed, by_delayed, &delayed[..]),
            (&patterns.outputs_by_param, by_param, &d.theta[..]),
            (&patterns.outputs_by_input, &by_input[patterns.rates_by_input.len()..], &d.inputs[..]),
        ];
        for (pattern, entries, direction) in terms {
            for (k, i, j) in pattern.entries() {
                d.outputs[i] += entries[k] * direction[j];
            }
        }
        Ok(())
    }
}
