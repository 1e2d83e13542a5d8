//! Fits in one frozen noise, on whitened lines.

use super::metric::Metric;
use super::newton::{Newton, ProblemTable};
use super::whitened::{Lens, Whitened};
use crate::dynamics::Dynamics;
use crate::estimate::{DerivedQuantities, ParameterEstimate, Problem, ProblemRun};
use crate::record::Run;
use crate::simulate::{Simulator, Steps};
use fdm_grammar::model::Param;

/// What a correction must promise to gain in log-likelihood.
const NOTHING: f64 = 1e-3;

/// A model over runs, judged by one noise.
pub(super) struct Posed<'a> {
    /// Its parameters; what is fixed stays.
    pub(super) params: Vec<Param>,
    /// Its code.
    pub(super) dynamics: &'a dyn Dynamics,
    /// The runs.
    pub(super) runs: &'a [Run],
    /// How they are integrated.
    pub(super) steps: &'a [Steps],
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

impl<'a> Posed<'a> {
    /// Fits from these values (all parameters of each run); none where there is no response.
    pub(super) fn fit(&self, starts: &[Vec<f64>], iterations: usize) -> Option<Fitting> {
        self.bench()?.fit(starts, iterations, NOTHING)
    }

    /// What several fits of one model share.
    pub(super) fn bench(&self) -> Option<Bench<'a>> {
        let outputs = self.dynamics.layout().outputs;
        let mut runs = Vec::with_capacity(self.runs.len());
        for (run, steps) in self.runs.iter().zip(self.steps) {
            let simulator = Simulator::new(self.dynamics, run, steps.clone()).ok()?;
            let mut lens = Lens::new(run, outputs, self.metric);
            let measured = lens.seen(&run.measured);
            let response = Box::new(Whitened::new(simulator, lens));
            runs.push(ProblemRun { name: run.name.clone(), response, measured, start: Vec::new() });
        }
        let outputs = (0..outputs).map(|o| o.to_string()).collect();
        let params = self.params.clone();
        Some(Bench {
            problem: Problem { params, outputs, runs, affine: Vec::new(), derived: DerivedQuantities::none() },
        })
    }

    /// The same with everything fixed that all runs share: what a held-out run still leaves open.
    pub(super) fn held(mut self) -> Self {
        self.params.iter_mut().filter(|p| !p.per_run).for_each(|p| p.fixed = true);
        self
    }
}

/// A model over runs, ready to be fitted from several starts.
pub(super) struct Bench<'a> {
    problem: Problem<'a>,
}

impl Bench<'_> {
    /// The cost at these values (all parameters of each run), and they within their bounds; none where there is no response.
    pub(super) fn look(&mut self, starts: &[Vec<f64>]) -> Option<f64> {
        self.begin(starts)?;
        Newton::new(&mut self.problem).look()
    }

    /// Fits from these values with so many corrections, as long as one promises to gain more than `least`; none where there is
    /// no response.
    pub(super) fn fit(&mut self, starts: &[Vec<f64>], corrections: usize, least: f64) -> Option<Fitting> {
        self.begin(starts)?;
        let table = ProblemTable::of(&self.problem);
        let mut newton = Newton::new(&mut self.problem);
        newton.descend(corrections, least)?;
        let (cost, theta, estimates) = newton.reached(&table);
        Some(Fitting { cost, theta, estimates })
    }

    fn begin(&mut self, starts: &[Vec<f64>]) -> Option<()> {
        let params = &mut self.problem.params;
        let inside = |params: &[Param], theta: &[f64]| -> Vec<f64> {
            let each = theta.iter().zip(params);
            each.map(|(v, p)| if p.fixed { *v } else { v.max(p.lower).min(p.upper) }).collect()
        };
        let first = inside(params, starts.first()?);
        for (run, start) in self.problem.runs.iter_mut().zip(starts) {
            run.start = inside(params, start);
        }
        params.iter_mut().zip(first).filter(|(p, _)| !p.per_run).for_each(|(p, v)| p.value = v);
        Some(())
    }
}

impl Fitting {
    /// An estimate by name; of a parameter that all runs share.
    pub(super) fn shared(&self, name: &str) -> Option<&ParameterEstimate> {
        self.estimates.iter().find(|e| e.name == name && e.run.is_none())
    }
}
