//! What a result knows of the parameters on which requirements depend, and the requirements of many results of one model.

use super::assess::{Draws, Known, assess, assess_by, columns};
use super::bench::Plan;
use super::measured::{Measured, RequirementError};
use fdm_estimate::ParameterEstimate;
use fdm_grammar::model::Origin;
use fdm_grammar::requirement::Requirement;
use fdm_results::documents::ResultDocument;
use fdm_results::documents::requirement::Assessment;
use fdm_results::documents::study::{Goal, Judged};
use fdm_system::Model;

/// The model with values as they were found: theta (p), covariance (p by p).
pub fn with_estimates(model: &Model, theta: &[f64], covariance: Option<&[f64]>) -> Model {
    let mut params = model.definition().params.clone();
    for (k, param) in params.iter_mut().enumerate() {
        param.value = theta[k];
        // what the fit estimated has derivatives, whatever the model's text says of it
        param.fixed &= covariance.is_none_or(|c| c[k * theta.len() + k] == 0.0);
    }
    model.with_params(params)
}

/// Degrees of freedom of each parameter's error (p), where they are known.
pub fn freedom(result: &ResultDocument, model: &Model, run: &str) -> Vec<Option<f64>> {
    let found: &[ParameterEstimate] = result.fit().map_or(&[], |fit| &fit.parameters);
    let own = |p: &ParameterEstimate| p.run.as_deref().is_none_or(|r| r == run);
    let params = model.definition().params.iter();
    params
        .map(|p| {
            let found = found.iter().find(|e| e.name == p.quantity.name && own(e))?;
            found.degrees_of_freedom.filter(|_| found.corrected_error.is_some())
        })
        .collect()
}

/// Parameters as a result has them in one run, with what is known of their errors.
struct Found {
    theta: Vec<f64>,
    covariance: Vec<f64>,
    freedom: Vec<Option<f64>>,
}

impl Found {
    /// None where nothing is known of the errors.
    fn of(model: &Model, result: &ResultDocument, run: &str) -> Option<Self> {
        let covariance = result.covariance(model, run).filter(|c| c.iter().any(|v| *v != 0.0))?;
        let mut theta = result.theta(model, run);
        let params = &model.definition().params;
        theta.iter_mut().zip(params).filter(|(_, p)| p.is_recorded()).for_each(|(v, _)| *v = 0.0);
        Some(Self { freedom: freedom(result, model, run), theta, covariance })
    }

    fn known(&self) -> Known<'_> {
        Known { theta: &self.theta, covariance: &self.covariance, freedom: &self.freedom }
    }
}

/// Whether the requirements of a model can be measured of a result of so many runs without asking for more.
fn decided(model: &Model, runs: usize) -> Result<(), RequirementError> {
    let definition = model.definition();
    let own = definition.params.iter().any(|p| p.per_run && !matches!(p.origin, Origin::FreeInitial(_)));
    if runs > 1 && own {
        return Err(RequirementError::Runs);
    }
    let brought = definition.inputs.iter().find(|i| i.known);
    brought.map_or(Ok(()), |i| Err(RequirementError::Known { name: i.quantity.name.clone() }))
}

/// The requirements of a fit as part of its result: none where the text has none, where values of single runs must be chosen, or where they cannot be
/// measured; `fdm margins` says why.
pub fn assess_result(model: &Model, result: &ResultDocument, runs: &[String], draws: Draws) -> Option<Vec<Assessment>> {
    let run = runs.first().filter(|_| model.definition().requirements.is_some())?;
    decided(model, runs.len()).ok()?;
    let found = Found::of(model, result, run)?;
    let model = with_estimates(model, &found.theta, Some(&found.covariance));
    assess(&model, found.known(), draws).ok()
}

/// Assesses the requirements of many results of one model, as a study makes them. Manoeuvres are prepared once, with the steps of the first result.
pub struct Judge {
    model: Model,
    plan: Plan,
    run: String,
    draws: Draws,
    goals: Vec<Goal>,
}

impl Judge {
    /// Of the result that is repeated: its values are the truth. None where the text has no requirements.
    ///
    /// # Errors
    /// [`RequirementError`], where they cannot be measured.
    pub fn new(
        model: &Model,
        result: &ResultDocument,
        runs: &[String],
        draws: Draws,
    ) -> Result<Option<Self>, RequirementError> {
        if model.definition().requirements.is_none() {
            return Ok(None);
        }
        decided(model, runs.len())?;
        let run = runs.first().cloned().unwrap_or_default();
        let found = Found::of(model, result, &run).ok_or(RequirementError::NoCovariance)?;
        let model = with_estimates(model, &found.theta, Some(&found.covariance));
        let plan = Plan::new(&model, &found.theta, &columns(&model, found.known()))?;
        let Some(plan) = plan else { return Ok(None) };
        let truth = plan.bench()?.measure(&found.theta, false);
        let goal = |(r, m): (&Requirement, &Measured)| Goal {
            name: r.quantity.name.clone(),
            unit: r.quantity.unit.as_ref().map(ToString::to_string),
            truth: Some(m.value).filter(|v| v.is_finite()),
        };
        let goals = plan.requirements().list.iter().zip(&truth).map(goal).collect();
        Ok(Some(Self { model, plan, run, draws, goals }))
    }

    /// The requirements, with their values at the parameters that records are made with.
    pub fn goals(&self) -> &[Goal] {
        &self.goals
    }

    /// What a repeat says of each; nothing where it knows no errors.
    pub fn judged(&self, result: &ResultDocument) -> Vec<Judged> {
        let none = || vec![Judged::NONE; self.goals.len()];
        let Some(found) = Found::of(&self.model, result, &self.run) else { return none() };
        let model = with_estimates(&self.model, &found.theta, Some(&found.covariance));
        let (known, own) = (found.known(), columns(&model, found.known()));
        let assessed = match own == self.plan.columns() {
            true => assess_by(&self.plan, &model, known, self.draws),
            // a parameter at its bound is known exactly here and was not there, or the other way round
            false => assess(&model, known, self.draws),
        };
        assessed.map_or_else(|_| none(), |list| list.iter().map(Judged::of).collect())
    }
}
