//! Fits in one frozen noise: by the estimator of the time domain, on whitened lines.

use super::metric::Metric;
use super::way::Way;
use crate::dynamics::Dynamics;
use crate::estimate::{DerivedQuantities, Estimate, Noise, Options, ParameterEstimate, Problem, estimate};
use crate::record::Run;
use fdm_grammar::model::Param;

/// Relative correction that ends a fit: costs are known to its square.
const TOLERANCE: f64 = 1e-6;

/// A model over runs, judged by one noise.
pub(super) struct Posed<'a> {
    /// Its parameters; what is fixed stays.
    pub(super) params: Vec<Param>,
    /// Its code.
    pub(super) dynamics: &'a dyn Dynamics,
    /// The runs.
    pub(super) runs: &'a [Run],
    /// How they are answered.
    pub(super) ways: &'a [Way],
    /// The noise.
    pub(super) metric: &'a Metric,
}

/// What a fit came to.
#[derive(Debug, Clone)]
pub(super) struct Fitting {
    /// Minus the log-likelihood, without its constant.
    pub(super) cost: f64,
    /// All parameters of each run.
    pub(super) theta: Vec<Vec<f64>>,
    /// With standard errors.
    pub(super) estimates: Vec<ParameterEstimate>,
}

impl Posed<'_> {
    /// Fits from these values (all parameters of each run); none where there is no response.
    pub(super) fn fit(&self, starts: &[Vec<f64>], iterations: usize) -> Option<Fitting> {
        let outputs = self.dynamics.layout().outputs;
        let mut runs = Vec::with_capacity(self.runs.len());
        for ((run, way), start) in self.runs.iter().zip(self.ways).zip(starts) {
            runs.push(way.posed(self.dynamics, run, self.metric, self.inside(start))?);
        }
        let mut params = self.ways.first()?.params(self.params.clone());
        let alone = (params.len() - self.params.len()) * runs.len();
        let first = self.inside(starts.first()?);
        params.iter_mut().zip(first).filter(|(p, _)| !p.per_run).for_each(|(p, v)| p.value = v);
        let names = (0..outputs).map(|o| o.to_string()).collect();
        let mut problem =
            Problem { params, outputs: names, runs, affine: Vec::new(), derived: DerivedQuantities::none() };
        let noise = Noise::Given(vec![Some(1.0); outputs]);
        let options = Options { noise, iterations, tolerance: TOLERANCE, colour: false, ..Options::default() };
        let mut found = estimate(&mut problem, &options, &mut ()).ok()?;
        // every value that a run has for itself takes half a unit of noise: a model gains nothing by having more of them
        let cost = found.cost.filter(|c| c.is_finite())? + 0.5 * alone as f64;
        found.parameters.retain(|e| self.params.iter().any(|p| p.quantity.name == e.name));
        let theta = self.runs.iter().zip(starts).map(|(run, start)| self.reached(&found, run, start)).collect();
        Some(Fitting { cost, theta, estimates: found.parameters })
    }

    /// Values within their bounds.
    fn inside(&self, theta: &[f64]) -> Vec<f64> {
        theta.iter().zip(&self.params).map(|(v, p)| if p.fixed { *v } else { v.max(p.lower).min(p.upper) }).collect()
    }

    /// All parameters of a run at the estimates.
    fn reached(&self, found: &Estimate, run: &Run, start: &[f64]) -> Vec<f64> {
        let value = |(p, start): (&Param, &f64)| {
            let owner = p.per_run.then_some(run.name.as_str());
            found.parameter(&p.quantity.name, owner).map_or(*start, |e| e.value)
        };
        self.params.iter().zip(start).map(value).collect()
    }

    /// The same with everything fixed that all runs share: what a held-out run still leaves open.
    pub(super) fn held(mut self) -> Self {
        self.params.iter_mut().filter(|p| !p.per_run).for_each(|p| p.fixed = true);
        self
    }
}

impl Fitting {
    /// An estimate by name; of a parameter that all runs share.
    pub(super) fn shared(&self, name: &str) -> Option<&ParameterEstimate> {
        self.estimates.iter().find(|e| e.name == name && e.run.is_none())
    }
}
