//! What an estimate says of runs that took no part in it.

use super::fit::{Fit, FitOptions, fit};
use super::fit_error::FitError;
use crate::estimate::changes::Changes;
use crate::estimate::problem::Options;
use crate::estimate::progress::Observer;
use crate::record::Run;
use fdm_grammar::model::Origin;

impl Fit {
    /// What the estimates predict of runs that took no part: what all runs share is held, initial states and biases are
    /// each run's own.
    ///
    /// # Errors
    /// [`FitError`], as any fit.
    pub fn predict(&self, runs: &[Run], observer: &mut dyn Observer) -> Result<Fit, FitError> {
        let params = self.model.definition().params.iter();
        let shared = params.filter(|p| !p.per_run && !p.fixed && p.origin == Origin::Declared);
        let names: Vec<String> = shared.map(|p| p.quantity.name.clone()).collect();
        let value = |name: &String| Some((name.clone(), self.estimate.parameter(name, None)?.value));
        let changes = Changes { set: names.iter().filter_map(value).collect(), fix: names, ..Changes::default() };
        let options = Options { colour: false, ..Options::default() };
        fit(&self.model, runs, &FitOptions { changes, options, ..FitOptions::default() }, observer)
    }
}
