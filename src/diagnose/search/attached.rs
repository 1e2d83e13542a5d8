//! An effect written into the model of a stage: which parameter is which, and what values a run has.

use super::measured::Measured;
use super::stage::Stage;
use crate::record::Run;
use fdm_grammar::Model as Definition;
use fdm_grammar::effect::{Candidate, Choice, Extension, NewParam};
use fdm_grammar::model::Param;

/// An effect at its place.
#[derive(Clone)]
pub(super) struct Attached {
    /// The effect and its place.
    pub(super) candidate: Candidate,
    /// The text.
    pub(super) extension: Extension,
    /// What the text says.
    pub(super) definition: Definition,
    /// Where each new parameter stands in `definition`.
    pub(super) new: Vec<usize>,
    /// Where each parameter of the base model stands there.
    old: Vec<usize>,
    /// First values of what new states follow, run by run, of those parameters that are such.
    begins: Vec<Option<Vec<f64>>>,
    /// Whether such a value is recorded, and needs no estimate.
    recorded: Vec<bool>,
}

impl Attached {
    /// Writes an effect into the model of a stage.
    ///
    /// # Errors
    /// Why it does not fit, in words.
    pub(super) fn new(
        candidate: &Candidate,
        stage: &Stage,
        measured: &Measured,
        choice: &Choice,
    ) -> Result<Self, String> {
        let extension = candidate.apply(&stage.subject, measured, choice).map_err(|d| d.message)?;
        let first =
            |findings: Vec<fdm_grammar::Diagnostic>| findings.first().map_or(String::new(), |f| f.message.clone());
        let definition = extension.model().map_err(first)?;
        let place = |name: &str| definition.param(name).ok_or_else(|| format!("`{name}` is lost in the extended text"));
        let new = extension.params().iter().map(|p| place(&p.name)).collect::<Result<Vec<_>, _>>()?;
        let old = stage.params().iter().map(|p| place(&p.quantity.name)).collect::<Result<Vec<_>, _>>()?;
        let begin = |p: &NewParam| {
            let signal = p.begins_as.as_ref()?;
            Some((0..stage.theta.len()).map(|run| measured.first(signal, run)).collect())
        };
        let begins = extension.params().iter().map(begin).collect();
        let is_input = |p: &NewParam| {
            let input = |name: &String| stage.model.definition().inputs.iter().any(|i| i.quantity.name == *name);
            p.begins_as.as_ref().is_some_and(input)
        };
        let recorded = extension.params().iter().map(is_input).collect();
        Ok(Self { candidate: candidate.clone(), extension, definition, new, old, begins, recorded })
    }

    /// The new parameters.
    pub(super) fn params(&self) -> &[NewParam] {
        self.extension.params()
    }

    /// The first parameter that is no nuisance: the size of the effect.
    pub(super) fn size(&self) -> usize {
        self.params().iter().position(|p| !p.nuisance).unwrap_or(0)
    }

    /// Whether a new parameter is estimated when the extended model is fitted.
    pub(super) fn is_estimated(&self, k: usize) -> bool {
        !self.params()[k].fixed && !self.recorded[k]
    }

    /// How many parameters the effect costs: those that it adds for all runs.
    pub(super) fn cost(&self) -> usize {
        (0..self.new.len()).filter(|k| self.is_estimated(*k) && self.begins[*k].is_none()).count()
    }

    /// All parameters of a run, with these values of the new ones (in their order).
    pub(super) fn theta(&self, stage: &Stage, run: usize, values: &[f64]) -> Vec<f64> {
        self.theta_from(&stage.theta[run], run, values)
    }

    /// The same with these values of the base model's parameters.
    pub(super) fn theta_from(&self, base: &[f64], run: usize, values: &[f64]) -> Vec<f64> {
        let mut theta = self.definition.start();
        for (k, value) in self.old.iter().zip(base) {
            theta[*k] = *value;
        }
        for (k, (at, value)) in self.new.iter().zip(values).enumerate() {
            theta[*at] = self.begins[k].as_ref().map_or(*value, |of_run| of_run[run]);
        }
        theta
    }

    /// Of all parameters of a run, those of the base model.
    pub(super) fn base(&self, theta: &[f64]) -> Vec<f64> {
        self.old.iter().map(|k| theta[*k]).collect()
    }

    /// The parameters of the extended model as a fit wants them: those of the base model as they are there.
    pub(super) fn fitted_params(&self, stage: &Stage) -> Vec<Param> {
        let mut params = self.definition.params.clone();
        for (k, param) in self.old.iter().zip(stage.params()) {
            let origin = params[*k].origin;
            params[*k] = Param { origin, ..param.clone() };
        }
        for (k, at) in self.new.iter().enumerate() {
            params[*at].fixed = !self.is_estimated(k);
        }
        params
    }

    /// The runs as the extended model takes them; none where it needs a record that the others do not.
    pub(super) fn takes(&self, run: &Run) -> bool {
        self.definition.inputs.len() == run.held.len()
    }
}
