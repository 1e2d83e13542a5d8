//! Quantities that follow from the parameters, with standard errors by the delta method.

use fdm_grammar::graph::Leaf;
use fdm_grammar::model::Model;
use fdm_system::dynamics::{Dynamics, Workspace};

/// Name and kind of a derived quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct DerivedName {
    /// Its name.
    pub name: String,
    /// Its unit, as text.
    pub unit: Option<String>,
    /// Whether it depends on a per-run parameter and so has a value in every run.
    pub per_run: bool,
    /// Whether it is a declared parameter that is tied to others.
    pub tied: bool,
}

type Evaluate<'a> = Box<dyn FnMut(&[f64], &mut [f64]) + Send + 'a>;

/// The derived quantities of a model, as a function of all its parameters.
pub struct DerivedQuantities<'a> {
    /// What they are called.
    pub names: Vec<DerivedName>,
    /// Parameters (p) to values (one for each name).
    pub evaluate: Evaluate<'a>,
}

impl<'a> DerivedQuantities<'a> {
    /// No derived quantity.
    pub fn none() -> Self {
        Self { names: Vec::new(), evaluate: Box::new(|_, _| ()) }
    }

    /// Derived quantities that the model declares, computed by its programs.
    pub fn of(model: &Model, dynamics: &'a dyn Dynamics) -> Self {
        let per_run = model.graph.depends(|leaf| matches!(leaf, Leaf::Param(k) if model.params[k as usize].per_run));
        let name = |d: &fdm_grammar::model::Derived| DerivedName {
            name: d.quantity.name.clone(),
            unit: d.quantity.unit.as_ref().map(ToString::to_string),
            per_run: per_run[d.expr.index()],
            tied: d.tied,
        };
        let (mut work, mut known) = (Workspace::new(dynamics), vec![0.0; dynamics.layout().known]);
        let range = dynamics.layout().derived.clone();
        let evaluate = move |theta: &[f64], out: &mut [f64]| {
            dynamics.prepare(theta, &mut known, &mut work);
            out.copy_from_slice(&known[range.clone()]);
        };
        Self { names: model.derived.iter().map(name).collect(), evaluate: Box::new(evaluate) }
    }

    /// Values at `theta` and their gradients by the parameters `columns` (one row for each quantity), by central
    /// differences over a step that balances truncation against rounding (relative error about 1e-10); `size` is the
    /// size of a parameter whose value is zero.
    pub(crate) fn linearise(&mut self, theta: &[f64], columns: &[usize], size: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let count = self.names.len();
        let mut at = |theta: &[f64]| {
            let mut out = vec![0.0; count];
            (self.evaluate)(theta, &mut out);
            out
        };
        let values = at(theta);
        let mut gradients = vec![vec![0.0; columns.len()]; count];
        let mut moved = theta.to_vec();
        for (c, k) in columns.iter().enumerate() {
            let reach = theta[*k].abs().max(size[c]);
            let step = f64::EPSILON.cbrt() * if reach > 0.0 { reach } else { 1.0 };
            let (low, high) = (theta[*k] - step, theta[*k] + step);
            moved[*k] = high;
            let above = at(&moved);
            moved[*k] = low;
            let below = at(&moved);
            moved[*k] = theta[*k];
            for (i, row) in gradients.iter_mut().enumerate() {
                row[c] = (above[i] - below[i]) / (high - low);
            }
        }
        (values, gradients)
    }
}
