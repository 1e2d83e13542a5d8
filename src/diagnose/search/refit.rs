//! Fits in one frozen noise, on whitened lines.

use super::metric::Metric;
use super::newton::{Newton, ProblemTable};
use super::way::Way;
use crate::dynamics::Dynamics;
use crate::estimate::{DerivedQuantities, LineResponse, ParameterEstimate, Problem};
use crate::record::Run;
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

impl<'a> Posed<'a> {
    /// Fits from these values (all parameters of each run); none where there is no response.
    pub(super) fn fit(&self, starts: &[Vec<f64>], iterations: usize) -> Option<Fitting> {
        self.bench()?.fit(starts, iterations, NOTHING)
    }

    /// What several fits of one model share.
    pub(super) fn bench(&self) -> Option<Bench<'a>> {
        let posed = self.runs.iter().zip(self.ways).map(|(run, way)| way.posed(self.dynamics, run, self.metric));
        let (runs, settlers): (Vec<_>, Vec<_>) = posed.collect::<Option<Vec<_>>>()?.into_iter().unzip();
        let outputs = (0..self.dynamics.layout().outputs).map(|o| o.to_string()).collect();
        let params = self.ways.first().map_or_else(|| self.params.clone(), |way| way.params(self.params.clone()));
        Some(Bench {
            problem: Problem {
                params,
                outputs,
                runs,
                affine: Vec::new(),
                derived: DerivedQuantities::none(),
                carried_noise: None,
            },
            settlers,
            own: self.params.len(),
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
    /// What finds the values of each run that are no parameters of the model; none in time.
    settlers: Vec<Option<LineResponse>>,
    /// Parameters of the model.
    own: usize,
}

impl Bench<'_> {
    /// The cost at these values (all parameters of each run), and they within their bounds; none where there is no response.
    pub(super) fn look(&mut self, starts: &[Vec<f64>]) -> Option<f64> {
        self.begin(starts)?;
        Some(Newton::new(&mut self.problem).look()? + self.price())
    }

    /// Fits from these values with so many corrections, as long as one promises to gain more than `least`; none where there is
    /// no response.
    pub(super) fn fit(&mut self, starts: &[Vec<f64>], corrections: usize, least: f64) -> Option<Fitting> {
        self.begin(starts)?;
        let table = ProblemTable::of(&self.problem);
        let mut newton = Newton::new(&mut self.problem);
        newton.descend(corrections, least)?;
        let (cost, mut theta, mut estimates) = newton.reached(&table);
        theta.iter_mut().for_each(|own| own.truncate(self.own));
        let alone: Vec<&str> = self.problem.params[self.own..].iter().map(|p| p.quantity.name.as_str()).collect();
        estimates.retain(|e| !alone.contains(&e.name.as_str()));
        Some(Fitting { cost: cost + self.price(), theta, estimates })
    }

    /// Every value that a run has for itself takes half a unit of noise: a model gains nothing by having more of them.
    fn price(&self) -> f64 {
        0.5 * ((self.problem.params.len() - self.own) * self.problem.runs.len()) as f64
    }

    fn begin(&mut self, starts: &[Vec<f64>]) -> Option<()> {
        let params = &mut self.problem.params;
        let inside = |params: &[Param], theta: &[f64]| -> Vec<f64> {
            let each = theta.iter().zip(params);
            each.map(|(v, p)| if p.fixed { *v } else { v.max(p.lower).min(p.upper) }).collect()
        };
        let first = inside(params, starts.first()?);
        for ((run, start), settler) in self.problem.runs.iter_mut().zip(starts).zip(&mut self.settlers) {
            run.start = inside(params, start);
            if let Some(settler) = settler {
                run.start.extend(settler.settle(&run.start, &run.measured).ok()?);
            }
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
