//! Effect, disturbance, unknown cause or nothing: what the evidence adds up to.
//!
//! Everything that the residuals of a fit say.

use super::localisation::{Localisation, localise};
use super::nonlinearity::{Curve, Nonlinearities, nonlinearities};
use super::null_model::NullModel;
use super::place::{BELIEVED, CLEAR, DisturbanceError, FittedRun, Place, PlaceEvidence, PlaceKind, rank};
use super::residual_analysis::{Coherence, ResidualAnalysis, residual_analysis};
use fdm_system::model::Model;
use serde::{Deserialize, Serialize};

/// What a parameter of an effect costs in log-likelihood: it was chosen among many.
const PENALTY: f64 = 3.0;
/// Evidence for a disturbance above which something is there, although no effect has a name for it.
const UNKNOWN: f64 = 10.0;
/// Evidence above which a nonlinearity is told of: of 112 records without an effect three had more, by a likelihood that had fewer kinds
/// of nonlinearities to choose from.
const NONLINEARITY: f64 = 1.5;
/// The part of that evidence that a named effect must explain.
const PART: f64 = 0.5;
/// The chance below which residuals are not noise.
const CHANCE: f64 = 0.01;

/// The best effect of a catalogue, fitted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Explained<'a> {
    /// What its residuals say.
    pub evidence: &'a ResidualEvidence,
    /// Parameters that it brought.
    pub params: usize,
}

/// What it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// The residuals are noise, or none that the sensors could not make by themselves.
    Nothing,
    /// The effect explains them, if the search finds it significant.
    Effect,
    /// A disturbance that does not repeat: gusts, waves.
    Disturbance,
    /// Something that no effect of the catalogue is.
    UnknownCause,
}

/// Origin and what it rests on.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Attribution {
    /// What it is.
    pub verdict: Origin,
    /// Gain in log-likelihood by the best effect beside noise of any smooth spectrum, less what its parameters cost; none
    /// where no effect was fitted.
    pub by_effect: Option<f64>,
    /// Gain in log-likelihood by a random disturbance at the best place, less what it costs.
    pub by_disturbance: f64,
    /// Gain in log-likelihood by a disturbance that is one function of states and inputs in all runs, less what it
    /// costs.
    pub by_nonlinearity: f64,
    /// Gain in log-likelihood by effect and random disturbance together, less what both cost.
    pub by_both: Option<f64>,
    /// What is still unexplained after the best effect, in words.
    pub warnings: Vec<String>,
    /// Where something enters that no effect explains, the likeliest first; empty where nothing is left.
    pub places: Vec<PlaceEvidence>,
    /// An unmodelled nonlinearity that is a function of one state or input; none where it takes several, or there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nonlinearity: Option<NonlinearityCurve>,
}

impl Attribution {
    /// Whether effects are believed beside the disturbance, penalties counted: they explain something beside it, or gain more than it by
    /// themselves, in the means of the runs above all.
    pub(crate) fn believes_beside(&self, gained: f64) -> bool {
        let beside = self.by_both.is_some_and(|both| both > self.by_disturbance + BELIEVED);
        beside || gained > self.by_disturbance + CLEAR
    }
}

/// An unmodelled nonlinearity drawn over the variable that it is a function of.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct NonlinearityCurve {
    /// Where it is added.
    pub place: Place,
    /// The function.
    #[serde(flatten)]
    pub curve: Curve,
}

/// Weighs the best effect, a random disturbance and an unknown cause against each other.
pub(crate) fn attribute(model: &Model, base: &ResidualEvidence, best: Option<Explained<'_>>) -> Attribution {
    let null = base.places.noise_alone;
    let by_disturbance = base.places.evidence().max(0.0);
    let by_nonlinearity = base.nonlinearities.evidence();
    let penalty = |e: &Explained<'_>| PENALTY * e.params as f64;
    let by_effect = best.map(|e| e.evidence.places.noise_alone - null - penalty(&e));
    let by_both = best.map(|e| e.evidence.places.with_disturbance - null - penalty(&e));
    let warnings = warnings(best.map_or(base, |e| e.evidence));
    let effect = by_effect.unwrap_or(0.0).max(0.0);
    let disturbance = by_disturbance > BELIEVED && by_disturbance > effect + CLEAR;
    let unexplained = |e: &Explained<'_>| {
        let left = e.evidence.repeats() || e.evidence.places.evidence() > UNKNOWN;
        left && effect < PART * (effect + e.evidence.rest())
    };
    // beside a strong disturbance that does not repeat, noise looks a little like inputs and nonlinearities as well; what is the same
    // in every run is an unmodelled nonlinearity, unless a disturbance is clearly likelier
    let repeated = by_nonlinearity.max(base.residual_analysis.evidence());
    let repeated = if by_nonlinearity > NONLINEARITY { repeated + CLEAR } else { repeated };
    let verdict = if disturbance && repeated < by_disturbance {
        Origin::Disturbance
    } else if disturbance || best.as_ref().map_or(base.repeats(), unexplained) {
        Origin::UnknownCause
    } else if effect > 0.0 {
        Origin::Effect
    } else {
        Origin::Nothing
    };
    let places = match verdict {
        Origin::Disturbance => base.places.disturbances.iter().filter(|s| s.evidence > 0.0).map(standing).collect(),
        Origin::UnknownCause => unknown_places(model, base, best),
        _ if !warnings.is_empty() => unknown_places(model, base, best),
        _ => Vec::new(),
    };
    let analysed = best.map_or(base, |e| e.evidence);
    let nonlinearity = matches!(verdict, Origin::UnknownCause | Origin::Disturbance)
        .then(|| analysed.nonlinearities.single().or_else(|| base.nonlinearities.single()))
        .flatten();
    Attribution { verdict, by_effect, by_disturbance, by_nonlinearity, by_both, warnings, places, nonlinearity }
}

impl Nonlinearities {
    /// The likeliest curve over one variable with the logarithm of its odds, where it is believed: functions of several may be likelier.
    pub(crate) fn curve(&self) -> Option<(NonlinearityCurve, f64)> {
        let first = self.curves.first().filter(|n| n.evidence > BELIEVED)?;
        Some((NonlinearityCurve { place: first.place.clone(), curve: first.curve.clone()? }, first.evidence))
    }

    /// The likeliest, where it is there and a function of one variable.
    fn single(&self) -> Option<NonlinearityCurve> {
        let first = self.list.first().filter(|n| n.evidence > NONLINEARITY)?;
        Some(NonlinearityCurve { place: first.place.clone(), curve: first.curve.clone()? })
    }
}

impl ResidualAnalysis {
    /// Whether something was found.
    fn found(&self) -> bool {
        self.repeatable < CHANCE
    }

    /// Logarithm of the odds, where something was found.
    fn evidence(&self) -> f64 {
        if self.found() { -self.repeatable.max(f64::MIN_POSITIVE).ln() } else { 0.0 }
    }

    /// What stands out most, where anything does.
    fn foremost(&self) -> Option<&Coherence> {
        self.coherences.first().filter(|_| self.found())
    }
}

impl ResidualEvidence {
    /// Whether something is left that is the same in every run.
    pub(crate) fn repeats(&self) -> bool {
        self.residual_analysis.found() || self.nonlinearities.evidence() > BELIEVED
    }

    /// Evidence for what is left, in log-likelihood: of a disturbance, or of the band that looks least like noise.
    fn rest(&self) -> f64 {
        let band = self.residual_analysis.foremost().map_or(0.0, |c| -c.chance.max(f64::MIN_POSITIVE).ln());
        self.places.evidence().max(self.nonlinearities.evidence()).max(band)
    }
}

fn standing(site: &super::localisation::Site) -> PlaceEvidence {
    PlaceEvidence { place: site.place.clone(), evidence: site.evidence }
}

/// Where an unknown cause enters: what the model as it was given lacks, and what the effects leave.
fn unknown_places(model: &Model, base: &ResidualEvidence, best: Option<Explained<'_>>) -> Vec<PlaceEvidence> {
    let mut places: Vec<PlaceEvidence> = Vec::new();
    let mut add = |place: Place, evidence: f64| match places.iter_mut().find(|p| p.place == place) {
        Some(known) => known.evidence = known.evidence.max(evidence),
        None => places.push(PlaceEvidence { place, evidence }),
    };
    for nonlinearity in base.nonlinearities.list.iter().filter(|nonlinearity| nonlinearity.evidence > 0.0) {
        add(nonlinearity.place.clone(), nonlinearity.evidence);
    }
    for site in base.places.disturbances.iter().filter(|s| s.evidence > 0.0) {
        add(site.place.clone(), site.evidence);
    }
    let definition = model.definition();
    for evidence in [Some(base), best.map(|e| e.evidence)].into_iter().flatten() {
        let Some(found) = evidence.residual_analysis.foremost() else { continue };
        let own = evidence.residual_analysis.evidence();
        let output = definition.outputs.iter().position(|o| o.quantity.name == found.output);
        let input = definition.inputs.iter().position(|i| i.quantity.name == found.partner.input());
        if let (Some(output), Some(input)) = (output, input) {
            add(Place { kind: PlaceKind::Output, index: output, name: found.output.clone() }, own);
            add(Place { kind: PlaceKind::Input, index: input, name: found.partner.input().into() }, own);
        }
    }
    rank(model, &mut places, |p| (&p.place, p.evidence));
    places
}

/// What says that residuals are not noise.
fn warnings(evidence: &ResidualEvidence) -> Vec<String> {
    let ResidualEvidence { places, nonlinearities, residual_analysis } = evidence;
    let mut said = Vec::new();
    let or = |names: Vec<String>| names.join(" or ");
    if places.evidence() > CLEAR {
        let names = or(places.group().map(|s| s.place.to_string()).collect());
        let odds = places.evidence();
        said.push(format!("a disturbance still acts on {names}: its odds are e^{odds:.0} to 1"));
    }
    if nonlinearities.evidence() > NONLINEARITY {
        let names = or(nonlinearities.group().map(|l| l.place.to_string()).collect());
        let odds = nonlinearities.evidence();
        let of =
            nonlinearities.single().map_or(String::new(), |n| format!(", a function of {} alone,", n.curve.variable));
        said.push(format!(
            "the residuals follow states and inputs alike in all runs, as an unmodelled nonlinearity in {names}{of} would: its odds are e^{odds:.0} to 1"
        ));
    }
    said.extend(residual_analysis.foremost().map(ToString::to_string));
    said
}

/// What the residuals of a fit say.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ResidualEvidence {
    /// Where a disturbance that does not repeat would enter.
    pub places: Localisation,
    /// Where one that is the same function of states and inputs in every run would.
    pub nonlinearities: Nonlinearities,
    /// Whether the residuals follow the inputs.
    pub residual_analysis: ResidualAnalysis,
}

/// Asks residuals for disturbances, nonlinearities, and for what follows the inputs.
///
/// # Errors
/// [`DisturbanceError`]
pub(crate) fn residual_evidence(
    model: &Model,
    fitted_runs: &[FittedRun<'_>],
) -> Result<ResidualEvidence, DisturbanceError> {
    let null_model = NullModel::new(fitted_runs, model.layout().outputs)?;
    Ok(ResidualEvidence {
        places: localise(model, fitted_runs, &null_model)?,
        nonlinearities: nonlinearities(model, fitted_runs, &null_model)?,
        residual_analysis: residual_analysis(model, fitted_runs, &null_model),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Disturbances are sought without means, in which a constant force has all it gains.
    #[test]
    fn an_effect_stands_beside_a_disturbance_if_it_adds_or_gains_more() {
        let stands = |by_disturbance: f64, by_both: Option<f64>, gained: f64| {
            let (verdict, by_effect, by_nonlinearity) = (Origin::Disturbance, None, 0.0);
            let (warnings, places, nonlinearity) = (Vec::new(), Vec::new(), None);
            let of = Attribution {
                verdict,
                by_effect,
                by_disturbance,
                by_nonlinearity,
                by_both,
                warnings,
                places,
                nonlinearity,
            };
            of.believes_beside(gained)
        };
        assert!(stands(7.0, None, 583.0) && !stands(7.0, None, 8.0));
        assert!(!stands(157.0, Some(158.7), 2.7) && stands(157.0, Some(172.0), 2.7));
    }
}
