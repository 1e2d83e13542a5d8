//! Fits in one frozen noise, on whitened bins.

use super::newton::{Newton, ProblemTable};
use super::predictor::Predictor;
use super::whitening::CommonNoise;
use fdm_estimate::{BinResponse, DerivedQuantities, ParameterEstimate, Problem};
use fdm_grammar::model::Param;
use fdm_system::dynamics::Dynamics;
use fdm_system::record::Run;

/// What an iteration must be predicted to gain in log-likelihood.
pub(super) const NOTHING: f64 = 1e-3;

/// A model over runs, judged by one noise.
pub(super) struct FitProblem<'a> {
    /// Its parameters; what is fixed stays.
    pub(super) params: Vec<Param>,
    /// Its code.
    pub(super) dynamics: &'a dyn Dynamics,
    /// The runs.
    pub(super) runs: &'a [Run],
    /// How they are answered.
    pub(super) predictors: &'a [Predictor],
    /// The noise.
    pub(super) noise: &'a CommonNoise,
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

impl<'a> FitProblem<'a> {
    /// Fits from these values (all parameters of each run); none where there is no response.
    pub(super) fn fit(&self, starts: &[Vec<f64>], iterations: usize) -> Option<Fitting> {
        self.prepared()?.fit(starts, iterations, NOTHING)
    }

    /// What several fits of one model share.
    pub(super) fn prepared(&self) -> Option<PreparedFit<'a>> {
        let posed = self
            .runs
            .iter()
            .zip(self.predictors)
            .map(|(run, predictor)| predictor.posed(self.dynamics, run, self.noise));
        let (runs, settlers): (Vec<_>, Vec<_>) = posed.collect::<Option<Vec<_>>>()?.into_iter().unzip();
        let outputs = (0..self.dynamics.layout().outputs).map(|o| o.to_string()).collect();
        let params = self
            .predictors
            .first()
            .map_or_else(|| self.params.clone(), |predictor| predictor.params(self.params.clone()));
        Some(PreparedFit {
            problem: Problem::of(params, outputs, runs, DerivedQuantities::none()),
            settlers,
            own: self.params.len(),
        })
    }

    /// This fitting with everything fixed that all runs share: what a validation run still leaves open.
    pub(super) fn validation(mut self) -> Self {
        self.params.iter_mut().filter(|p| !p.per_run).for_each(|p| p.fixed = true);
        self
    }
}

/// A model over runs, ready to be fitted from several starts.
pub(super) struct PreparedFit<'a> {
    problem: Problem<'a>,
    /// What finds the values of each run that are no parameters of the model; none in time.
    settlers: Vec<Option<BinResponse>>,
    /// Parameters of the model.
    own: usize,
}

impl PreparedFit<'_> {
    /// The cost at these values (all parameters of each run), and they within their bounds; none where there is no response.
    pub(super) fn look(&mut self, starts: &[Vec<f64>]) -> Option<f64> {
        self.begin(starts)?;
        Some(Newton::new(&mut self.problem).look()? + self.penalty())
    }

    /// Fits from these values with so many iterations, as long as one predicts to gain more than `least`; none where there is
    /// no response.
    pub(super) fn fit(&mut self, starts: &[Vec<f64>], iterations: usize, least: f64) -> Option<Fitting> {
        self.begin(starts)?;
        let table = ProblemTable::of(&self.problem);
        let mut newton = Newton::new(&mut self.problem);
        newton.descend(iterations, least)?;
        let (cost, mut theta, mut estimates) = newton.reached(&table);
        theta.iter_mut().for_each(|own| own.truncate(self.own));
        let alone: Vec<&str> = self.problem.params[self.own..].iter().map(|p| p.quantity.name.as_str()).collect();
        estimates.retain(|e| !alone.contains(&e.name.as_str()));
        Some(Fitting { cost: cost + self.penalty(), theta, estimates })
    }

    /// Every value that a run has for itself takes half a unit of noise: a model gains nothing by having more of them.
    fn penalty(&self) -> f64 {
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
