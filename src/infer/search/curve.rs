//! A law in the model's text: a table with nodes as params, smooth, fitted as any other model. Written down it is a model that can be simulated: a
//! stand-in for physics that has no name yet.

use super::random_effect::Unnamed;
use super::state::State;
use crate::candidates::coefficient_text::{CoefficientText, CurveNodes, Dependence};
use crate::candidates::extended_model::SignalScales;
use crate::candidates::fitted_model::{FittedModel, shared_from};
use crate::candidates::place::PlaceKind;
use crate::candidates::runs::{DiagnosisOptions, Runs};
use crate::candidates::written_model::{WrittenModel, at_values, written_model};
use crate::diagnosis::EffectAt;
use fdm_effects::{Catalogue, Choice, Subject};
use fdm_estimate::Work;
use fdm_grammar::Source;
use fdm_grammar::model::Param;
use fdm_system::model::Model;

/// Share of the squares of a law that its table need not follow: between two nodes to a half wave a cubic is as near as that.
const LEFT: f64 = 0.01;
/// Fewest intervals between nodes: the curve of one half wave, and its ends.
const FEWEST: usize = 8;

/// A law in a text.
pub(crate) struct Curve {
    /// What it is called in results.
    pub(crate) place: EffectAt,
    /// Nodes that are estimated.
    pub(crate) parameters: usize,
    pub(crate) written: WrittenModel,
}

/// A law beside a model at its fit, as a table in its text; none where it cannot be written or is no better. `runs` are split into training and validation
/// runs.
pub(crate) fn curve(
    law: &Unnamed,
    state: &State,
    (runs, options, work): (Runs<'_>, &DiagnosisOptions, &Work<'_>),
) -> Option<Curve> {
    let signal = law.signal.as_ref()?;
    let waves = law.curve.as_ref()?;
    let (low, high) = waves.ends;
    let first = state.fitted(runs)?;
    let (subject, coefficient) = match law.place.kind {
        PlaceKind::Coefficient => (first.subject.clone(), law.place.name.clone()),
        _ => with_constant(&first, &law.place.name, runs)?,
    };
    let value = first.model.definition().param(&coefficient).map_or(0.0, |k| first.theta[0][k]);
    let text = CoefficientText::new(&subject)?;
    let over = text.signals().into_iter().find(|s| s.name == *signal)?;
    let pair = Dependence { coefficient: coefficient.clone(), signal: signal.clone() };
    // as many nodes as the law has waves: a table that is asked for anew with more of them costs a fit each time
    let intervals = FEWEST.max(2 * waves.half_waves(LEFT));
    let at: Vec<f64> = (0..=intervals).map(|k| low + (high - low) * k as f64 / intervals as f64).collect();
    let values = at.iter().map(|v| value + waves.at(*v)).collect();
    let nodes = CurveNodes { values, at };
    let tabulated = text.tabulated(&pair, &over, &nodes, "cubic")?;
    let model = Model::from_source(tabulated.source).ok()?;
    let current = begun(&first, &model, runs)?;
    let naive = &first.response;
    let written = written_model(&current, &current.theta, naive, (runs, options, work)).ok();
    let written = written.or_else(|| at_values(&current, &current.theta, naive, runs))?;
    if written.training >= 1.0 || written.ratio() >= 1.0 {
        return None;
    }
    let effect = if law.place.kind == PlaceKind::Coefficient { "coefficient_table" } else { "law_curve" };
    let place = EffectAt { effect: effect.into(), targets: vec![law.place.name.clone(), signal.clone()] };
    Some(Curve { place, parameters: intervals + 1, written })
}

/// The text with a constant in an equation, and what it is called.
fn with_constant(first: &FittedModel, state: &str, runs: Runs<'_>) -> Option<(Subject, String)> {
    let (catalogue, _) =
        Catalogue::read(&Source::new("law", "effect law(x: state) { param law = 0; add der(x) += law; }"));
    let places = catalogue.places(&first.subject);
    let candidate = places.find(&format!("law({state})"))?;
    let extension = candidate.apply(&first.subject, &SignalScales::new(first, runs), &Choice::new()).ok()?;
    let name = extension.params().first()?.name.clone();
    let model = extension.model().ok()?;
    Some((Subject::new(extension.source(), &model).ok()?, name))
}

/// A text with a table at its start values, and at those of the model without it.
fn begun(first: &FittedModel, model: &Model, runs: Runs<'_>) -> Option<FittedModel> {
    let known = |name: &str| first.model.definition().param(name);
    // what is free and fixed there is so here
    let params: Vec<Param> = model
        .definition()
        .params
        .iter()
        .map(|p| match known(&p.quantity.name) {
            Some(k) => Param { origin: p.origin, ..first.params()[k].clone() },
            None => p.clone(),
        })
        .collect();
    let of = |own: &Vec<f64>| -> Vec<f64> {
        params.iter().map(|p| known(&p.quantity.name).map_or(p.value, |k| own[k])).collect()
    };
    let theta: Vec<Vec<f64>> = first.theta.iter().map(of).collect();
    let theta = shared_from(&params, &theta[0].clone(), &theta);
    FittedModel::new(model.with_params(params), runs, theta).ok()
}
