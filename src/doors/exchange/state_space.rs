//! A model, linear or linearised at its trim, as matrices for other programs: `x' = A x + B u`, `y = C x + D u` ([`StateSpace`]).

use crate::Stamp;
use fdm_grammar::graph::Signal;
use fdm_grammar::model::Quantity;
use fdm_system::Model;
use fdm_system::linear::{LinearModel, TrimError, Values};
use serde::Serialize;

/// Matrices with the names of their rows and columns.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StateSpace {
    /// What wrote it, and the [`Stamp`] of the model.
    pub generator: String,
    /// The model's name.
    pub model: String,
    /// Unit of time.
    pub time: String,
    /// States (n), inputs (m) and outputs (q), and where they stand in the trim.
    pub states: Vec<Channel>,
    /// Inputs, hidden ones included.
    pub inputs: Vec<Channel>,
    /// Outputs.
    pub outputs: Vec<Channel>,
    /// n by n, row by row.
    #[serde(rename = "A")]
    pub a: Vec<Vec<f64>>,
    /// n by m.
    #[serde(rename = "B")]
    pub b: Vec<Vec<f64>>,
    /// q by n.
    #[serde(rename = "C")]
    pub c: Vec<Vec<f64>>,
    /// q by m.
    #[serde(rename = "D")]
    pub d: Vec<Vec<f64>>,
    /// Signals that are seen delayed, with their columns beside those of the matrices.
    pub delays: Vec<Delay>,
}

/// A row or a column.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Channel {
    /// Its name.
    pub name: String,
    /// Its unit, empty when there is none.
    pub unit: String,
    /// Its value in the trim; none for outputs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trim: Option<f64>,
}

/// A delayed signal: it adds `to_states s(t - tau)` to x' and `to_outputs s(t - tau)` to y.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Delay {
    /// The state or input.
    pub of: String,
    /// The delay, in the unit of time.
    pub tau: f64,
    /// Column of the rates (n).
    pub to_states: Vec<f64>,
    /// Column of the outputs (q).
    pub to_outputs: Vec<f64>,
}

impl StateSpace {
    /// Of a model at the values of its parameters.
    ///
    /// # Errors
    /// [`TrimError`] where it cannot be linearised.
    pub fn of(model: &Model) -> Result<Self, TrimError> {
        let definition = model.definition();
        let theta = definition.start();
        let mut linear = LinearModel::new(model)?;
        let mut values = Values::default();
        linear.evaluate(&theta, &mut values)?;
        let (trim, s) = (linear.trim(&theta), linear.structure().clone());
        let (n, m, q) = (s.states, s.inputs, s.outputs);
        let zeros = |rows: usize, columns: usize| vec![vec![0.0; columns]; rows];
        let (mut rates, mut outputs) = (zeros(n, n + m), zeros(q, n + m));
        let mut delayed = vec![(vec![0.0; n], vec![0.0; q]); s.delayed.len()];
        for (term, value) in s.terms.iter().zip(&values.terms) {
            let (row, signal) = (term.row as usize, term.signal as usize);
            match (row.checked_sub(n), signal.checked_sub(n + m)) {
                (None, None) => rates[row][signal] = *value,
                (Some(row), None) => outputs[row][signal] = *value,
                (None, Some(d)) => delayed[d].0[row] = *value,
                (Some(row), Some(d)) => delayed[d].1[row] = *value,
            }
        }
        let channel = |quantity: &Quantity, trim: Option<f64>| Channel {
            name: quantity.name.clone(),
            unit: quantity.unit.as_ref().map_or_else(String::new, |u| u.text().into()),
            trim,
        };
        let states = definition.states.iter().zip(&trim.states).map(|(s, x)| channel(&s.quantity, Some(*x)));
        let inputs = definition.inputs.iter().zip(&trim.inputs).map(|(i, u)| channel(&i.quantity, Some(*u)));
        let of = |signal: &Signal| match *signal {
            Signal::State(k) => definition.states[k as usize].quantity.name.clone(),
            Signal::Input(k) => definition.inputs[k as usize].quantity.name.clone(),
        };
        let delays = s.delayed.iter().zip(&values.tau).zip(delayed);
        let delays = delays.map(|((signal, tau), (to_states, to_outputs))| Delay {
            of: of(signal),
            tau: *tau,
            to_states,
            to_outputs,
        });
        let split = |rows: Vec<Vec<f64>>| -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
            rows.into_iter().map(|row| (row[..n].to_vec(), row[n..].to_vec())).unzip()
        };
        let ((a, b), (c, d)) = (split(rates), split(outputs));
        Ok(Self {
            generator: format!("Written by fdm {}; {}", env!("CARGO_PKG_VERSION"), Stamp::of(model)),
            model: model.name().into(),
            time: definition.time.text().into(),
            states: states.collect(),
            inputs: inputs.collect(),
            outputs: definition.outputs.iter().map(|o| channel(&o.quantity, None)).collect(),
            a,
            b,
            c,
            d,
            delays: delays.collect(),
        })
    }

    /// As JSON, which `control.ss` and `scipy.signal.StateSpace` take matrix by matrix.
    ///
    /// # Errors
    /// That of the writer of JSON.
    pub fn json(&self) -> serde_json::Result<String> {
        serde_json::to_string_pretty(self)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn matrices_are_those_of_the_equations() {
        let text = "model m { input u; param tau = 0.3; state x = 0; state v = 0; der(x) = v; \
                    der(v) = -4*x - 0.5*v + 3*delay(u, tau); output y = x + 2*v; output z = u; }";
        let found = StateSpace::of(&Model::from_text("m.fdm", text).unwrap()).unwrap();
        assert_eq!((found.a, found.b), (vec![vec![0.0, 1.0], vec![-4.0, -0.5]], vec![vec![0.0], vec![0.0]]));
        assert_eq!((found.c, found.d), (vec![vec![1.0, 2.0], vec![0.0, 0.0]], vec![vec![0.0], vec![1.0]]));
        let delay = &found.delays[0];
        assert_eq!((&delay.of[..], delay.tau, &delay.to_states), ("u", 0.3, &vec![0.0, 3.0]));
        assert!(found.generator.contains("Written by fdm "));
    }
}
