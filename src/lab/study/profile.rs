//! Profile likelihood: what the best fit costs when one parameter is held at other values and all others are fitted anew, and how far the
//! parameter may go until that costs more than chance explains. Such an interval needs no parabola: it may be lopsided, or open.

use super::bootstrap::reached;
use super::study_error::StudyError;
use fdm_estimate::{
    Changes, Estimate, Fit, FitOptions, Iteration, Keeper, MultiStart, ParameterEstimate, SharedSteps, Status,
    fit_from, quantile,
};
use fdm_results::documents::profile::{End, Point, Profile, reach};
use fdm_system::Model;
use fdm_system::record::Run;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// Most refits on one side until the end is found.
const SEARCH: usize = 14;
/// Refits between the estimate and an end, for the curve.
const BETWEEN: usize = 4;
/// How near to the wanted rise an end is taken, as part of its root.
const NEAR: f64 = 0.01;
/// Errors from the estimate beyond which an interval counts as open.
const FAR: f64 = 200.0;

/// A fit whose parameters are to be profiled.
pub struct Profiler<'a> {
    fit: &'a Fit,
    runs: &'a [Run],
    options: FitOptions,
    starts: Vec<Vec<f64>>,
    goes_on: &'a (dyn Fn() -> bool + Sync),
}

/// A side of a profile, as seen from the estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Values below the estimate.
    Below,
    /// Values above it.
    Above,
}

impl Side {
    /// Both, in the order of a profile.
    pub const BOTH: [Self; 2] = [Self::Below, Self::Above];

    /// The name under which this side of a parameter's profile is kept.
    pub fn of(self, parameter: &str) -> String {
        format!("{parameter} {}", if self == Self::Below { "below" } else { "above" })
    }
}

/// What one side of a profile holds.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
struct ProfileSide {
    end: End,
    points: Vec<Point>,
    refits: usize,
}

/// The parameter that is profiled.
struct Wanted<'a> {
    /// Its place among those of the model.
    place: usize,
    parameter: &'a ParameterEstimate,
    /// Its error to be trusted.
    error: f64,
    /// That over the Cramer-Rao error.
    factor: f64,
    /// What the cost may rise.
    rise: f64,
}

/// What a refit found.
struct Refit {
    rise: f64,
    starts: Vec<Vec<f64>>,
    others: Vec<(String, f64)>,
}

impl<'a> Profiler<'a> {
    /// Of a fit of these runs with these options; `goes_on` says whether to continue.
    ///
    /// # Errors
    /// [`StudyError::Astray`] when the fit has no minimum.
    pub fn new(
        fit: &'a Fit,
        runs: &'a [Run],
        options: &FitOptions,
        goes_on: &'a (dyn Fn() -> bool + Sync),
    ) -> Result<Self, StudyError> {
        if !fit.estimate.termination.is_good() {
            return Err(StudyError::Astray { reason: fit.estimate.termination.to_string() });
        }
        let mut options = FitOptions {
            changes: Changes::default(),
            shared_steps: SharedSteps::of(fit.integration.clone()),
            starts: MultiStart::default(),
            substitute: Vec::new(),
            shooting: None,
            confidence: false,
            reweight: false,
            bare: true,
            ..options.clone()
        }
        .with_declared_noise(&fit.model);
        options.options.colour = false;
        let starts = reached(&fit.model, runs, &fit.estimate);
        Ok(Self { fit, runs, options, starts, goes_on })
    }

    /// The profile of a parameter that all runs share, or of one that belongs to the only run.
    ///
    /// # Errors
    /// [`StudyError::NoProfile`] with the reason.
    pub fn of(&self, name: &str) -> Result<Profile, StudyError> {
        self.of_kept(name, None)
    }

    /// The same; sides that `keeper` has are not made again.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn of_kept(&self, name: &str, keeper: Option<&dyn Keeper>) -> Result<Profile, StudyError> {
        let subject = self.subject(name)?;
        let side = |side: &Side| {
            let kept = keeper.and_then(|k| k.find(&side.of(name)).ok().flatten());
            let kept = kept.and_then(|bytes| postcard::from_bytes(&bytes).ok());
            kept.unwrap_or_else(|| self.one_side(&subject, *side))
        };
        let mut sides: Vec<ProfileSide> = Side::BOTH.par_iter().map(side).collect();
        let Wanted { parameter, error, factor, rise, .. } = subject;
        let (mut points, mut refits) = (vec![self.best(parameter)], 0);
        for side in &mut sides {
            points.append(&mut side.points);
            refits += side.refits;
        }
        points.sort_by(|a, b| a.value.total_cmp(&b.value));
        let (name, unit, value) = (parameter.name.clone(), parameter.unit.clone(), parameter.value);
        let (ends, reach) = ([sides[0].end, sides[1].end], reach(error, factor, rise));
        let by_error = [value - reach, value + reach];
        Ok(Profile { name, unit, value, error, factor, rise, ends, by_error, points, refits })
    }

    /// One side of the profile of a parameter, as bytes for [`Self::of_kept`]; none when it was interrupted.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn side_of(&self, name: &str, side: Side) -> Result<Option<Vec<u8>>, StudyError> {
        let found = self.one_side(&self.subject(name)?, side);
        let whole = !matches!(found.end, End::Interrupted(_)) && (self.goes_on)();
        Ok(postcard::to_allocvec(&found).ok().filter(|_| whole))
    }

    fn one_side(&self, wanted: &Wanted<'_>, side: Side) -> ProfileSide {
        let sign = if side == Side::Below { -1.0 } else { 1.0 };
        let (end, points, refits) = self.side(wanted.place, wanted.parameter, (sign * wanted.error, wanted.rise));
        ProfileSide { end, points, refits }
    }

    fn subject(&self, name: &str) -> Result<Wanted<'_>, StudyError> {
        let definition = self.fit.model.definition();
        let refused = |reason: &str| StudyError::NoProfile { parameter: name.into(), reason: reason.into() };
        let Some(place) = definition.params.iter().position(|p| p.quantity.name == name && !p.is_recorded()) else {
            let known = definition.params.iter().filter(|p| !p.is_recorded()).map(|p| p.quantity.name.as_str());
            let near = fdm_grammar::diagnostic::nearest(name, known);
            let hint = near.map_or(String::new(), |near| format!("; did you mean `{near}`?"));
            return Err(refused(&format!("the model has no such parameter{hint}")));
        };
        if definition.params[place].per_run && self.runs.len() > 1 {
            return Err(refused("it has a value of its own in each run; profile it with one run at a time"));
        }
        let run = definition.params[place].per_run.then(|| self.runs[0].name.as_str());
        let parameter = self.fit.estimate.parameter(name, run).ok_or_else(|| refused("it was not estimated"))?;
        match (parameter.status, parameter.error().filter(|e| e.is_finite() && *e > 0.0)) {
            (Status::Estimated, Some(error)) => {
                let factor = error / parameter.standard_error.unwrap_or(error);
                let freedom = parameter.degrees_of_freedom.filter(|_| parameter.corrected_error.is_some());
                // chi-squared of one degree of freedom is the square of a normal deviate
                let rise = 0.5 * (factor * quantile(freedom)).powi(2);
                Ok(Wanted { place, parameter, error, factor, rise })
            }
            (Status::NotDetermined, _) => {
                Err(refused("the data do not determine it: its interval is open on both sides"))
            }
            (Status::AtLowerBound | Status::AtUpperBound, _) => {
                Err(refused("it stands at its bound; widen the bound first"))
            }
            _ => Err(refused("it was not estimated")),
        }
    }

    /// The estimate itself.
    fn best(&self, parameter: &ParameterEstimate) -> Point {
        Point { value: parameter.value, rise: 0.0, others: others(&self.fit.estimate, parameter) }
    }

    /// One side: the end by secants on the root of the rise, which is straight where the cost is a parabola; then the curve on the way.
    fn side(&self, place: usize, parameter: &ParameterEstimate, (step, rise): (f64, f64)) -> (End, Vec<Point>, usize) {
        let param = &self.fit.model.definition().params[place];
        let (centre, wanted) = (parameter.value, rise.sqrt());
        let bound = if step < 0.0 { param.lower } else { param.upper };
        let (mut starts, mut points, mut refits) = (self.starts.clone(), Vec::new(), 0);
        let (mut below, mut above) = ((0.0, 0.0), None::<(f64, f64)>);
        // in errors; a first guess as the parabola has it
        let mut at = wanted * std::f64::consts::SQRT_2 * parameter.standard_error.unwrap_or(step.abs()) / step.abs();
        let farthest = ((bound - centre) / step).abs();
        let mut end = None;
        while end.is_none() && refits < SEARCH {
            if !(self.goes_on)() {
                end = Some(End::Interrupted(centre + step * below.0));
                break;
            }
            at = at.min(farthest).min(FAR);
            let value = if at >= farthest { bound } else { centre + step * at };
            refits += 1;
            let Some(found) = self.refit((place, value), &starts, parameter) else {
                if (self.goes_on)() && (refits >= SEARCH || at - below.0 < 1e-3 * at) {
                    end = Some(End::Astray(centre + step * below.0));
                }
                at = below.0 + 0.5 * (at - below.0);
                continue;
            };
            let root = found.rise.max(0.0).sqrt();
            points.push(Point { value, rise: found.rise, others: found.others });
            if (root - wanted).abs() <= NEAR * wanted {
                end = Some(End::At(value));
            } else if root < wanted {
                starts = found.starts;
                if at >= farthest {
                    end = Some(End::Bound(bound));
                } else if at >= FAR {
                    end = Some(End::Open(value));
                }
                below = (at, root);
            } else {
                above = Some((at, root));
            }
            at = match above {
                Some(above) => within(below, above, wanted),
                None if below.1 > 0.0 => below.0 * (wanted / below.1).clamp(1.2, 4.0),
                None => 4.0 * at,
            };
        }
        // so near that a secant between them is as good
        let end = end.unwrap_or_else(|| match above {
            Some(above) => End::At(centre + step * within(below, above, wanted)),
            None => End::Open(centre + step * below.0),
        });
        refits += self.curve(place, parameter, end, &mut points);
        (end, points, refits)
    }

    /// Points between the estimate and an end, each begun where the one before it ended.
    fn curve(&self, place: usize, parameter: &ParameterEstimate, end: End, points: &mut Vec<Point>) -> usize {
        let (mut starts, mut refits) = (self.starts.clone(), 0);
        for k in 1..=BETWEEN {
            let value = parameter.value + (end.value() - parameter.value) * k as f64 / (BETWEEN + 1) as f64;
            if value == parameter.value || !(self.goes_on)() {
                continue;
            }
            refits += 1;
            if let Some(found) = self.refit((place, value), &starts, parameter) {
                points.push(Point { value, rise: found.rise, others: found.others });
                starts = found.starts;
            }
        }
        refits
    }

    /// The best fit with the parameter held; none when there is none.
    fn refit(&self, (place, value): (usize, f64), starts: &[Vec<f64>], parameter: &ParameterEstimate) -> Option<Refit> {
        let mut params = self.fit.model.definition().params.clone();
        (params[place].value, params[place].fixed) = (value, true);
        let model: Model = self.fit.model.with_params(params);
        let mut starts = starts.to_vec();
        starts.iter_mut().for_each(|theta| theta[place] = value);
        let mut observer = |_: &Iteration| match (self.goes_on)() {
            true => ControlFlow::Continue(()),
            false => ControlFlow::Break(()),
        };
        let found = fit_from(&model, self.runs, &starts, &self.options, &mut observer).ok()?;
        let known = found.estimate.termination.is_good();
        let rise = found.estimate.cost.filter(|c| known && c.is_finite())? - self.fit.estimate.cost?;
        let others = others(&found.estimate, parameter);
        Some(Refit { rise, starts: reached(&model, self.runs, &found.estimate), others })
    }
}

/// Between two places with their roots: by the secant, but never nearer to one of them than a tenth.
fn within(below: (f64, f64), above: (f64, f64), wanted: f64) -> f64 {
    let part = (wanted - below.1) / (above.1 - below.1);
    let part = if part.is_finite() { part.clamp(0.1, 0.9) } else { 0.5 };
    below.0 + (above.0 - below.0) * part
}

fn others(estimate: &Estimate, parameter: &ParameterEstimate) -> Vec<(String, f64)> {
    let free =
        estimate.parameters.iter().filter(|p| !matches!(p.status, Status::Fixed | Status::Derived | Status::Tied));
    let other = free.filter(|p| p.name != parameter.name);
    other.map(|p| (p.run.as_ref().map_or(p.name.clone(), |run| format!("{} of {run}", p.name)), p.value)).collect()
}
