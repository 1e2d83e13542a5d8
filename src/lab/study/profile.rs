//! Profile likelihood: what the best fit costs when one parameter is held at other values and all others are fitted anew, and how far the
//! parameter may go until that costs more than chance explains. Such an interval needs no parabola: it may be lopsided, or open.

use super::bootstrap::reached;
use super::series::StudyError;
use fdm_estimate::{
    Attempt, Changes, Continuation, Estimate, Fit, FitOptions, MultiStart, ParameterEstimate, SharedSteps, Status,
    Work, fit_from, quantile,
};
use fdm_numeric::parallel;
use fdm_results::documents::profile::{AtBound, End, Point, Profile, reach};
use fdm_system::Model;
use fdm_system::record::Run;
use serde::{Deserialize, Serialize};

/// Refits between the estimate and an end, for the curve.
const BETWEEN: usize = 4;
/// How near to the wanted rise an end is taken, as part of its root.
const NEAR: f64 = 0.01;
/// Errors from the estimate beyond which an interval counts as open.
const FAR: f64 = 200.0;
/// Part of the wanted rise by which a nearer value may cost more than a farther one, before it is fitted again from there.
const FALLS: f64 = 1e-3;

/// A fit whose parameters are to be profiled.
pub struct Profiler<'a> {
    fit: &'a Fit,
    runs: &'a [Run],
    options: FitOptions,
    starts: Vec<Vec<f64>>,
    rise: Option<f64>,
    work: Work<'a>,
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
    /// Both sides, in the order of a profile.
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
    /// Others at their bounds beside the end.
    held: Vec<AtBound>,
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
    /// Whether it is moved by its logarithm, as it is searched.
    logarithmic: bool,
    /// Whether the estimate stands at its bound.
    bound: bool,
}

impl Wanted<'_> {
    /// The value so many errors from the estimate on a side (its sign).
    fn value(&self, sign: f64, at: f64) -> f64 {
        let value = self.parameter.value;
        match self.logarithmic {
            true => value * (sign * at * self.error / value).exp(),
            false => value + sign * at * self.error,
        }
    }

    /// How many errors a value is from the estimate.
    fn at(&self, value: f64) -> f64 {
        let own = self.parameter.value;
        match self.logarithmic {
            true => ((value / own).ln() * own / self.error).abs(),
            false => ((value - own) / self.error).abs(),
        }
    }
}

/// What a refit found.
struct Refit {
    /// Errors from the estimate.
    at: f64,
    value: f64,
    rise: f64,
    starts: Vec<Vec<f64>>,
    others: Vec<(String, f64)>,
    held: Vec<AtBound>,
}

impl Refit {
    fn root(&self) -> f64 {
        self.rise.max(0.0).sqrt()
    }
}

impl<'a> Profiler<'a> {
    /// Of a fit of these runs with these options; sides that the work has kept are not made again.
    ///
    /// # Errors
    /// [`StudyError::Astray`] when the fit has no minimum.
    pub fn new(fit: &'a Fit, runs: &'a [Run], options: &FitOptions, work: &Work<'a>) -> Result<Self, StudyError> {
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
        // every refit begins beside one that ended: a fallback strategy would lead elsewhere, and costs a hundred times as much
        if options.continuation == Continuation::Auto {
            options.continuation = Continuation::Never;
        }
        let starts = reached(&fit.model, runs, &fit.estimate);
        Ok(Self { fit, runs, options, starts, rise: None, work: work.clone() })
    }

    /// This profiler, with intervals that end where the cost has risen by so much: 1.92 is what a likelihood ratio
    /// allows white residuals in 95 of 100 records. None for what the errors of the fit say.
    #[must_use]
    pub fn with_rise(self, rise: Option<f64>) -> Self {
        Self { rise, ..self }
    }

    /// The profile of a parameter that all runs share, or of one that belongs to the only run.
    ///
    /// # Errors
    /// [`StudyError::NoProfile`] with the reason.
    pub fn of(&self, name: &str) -> Result<Profile, StudyError> {
        let subject = self.subject(name)?;
        let side = |side: &Side| {
            let kept = self.work.store().and_then(|k| k.find(&side.of(name)).ok().flatten());
            let kept = kept.and_then(|bytes| postcard::from_bytes(&bytes).ok());
            kept.unwrap_or_else(|| self.one_side(&subject, *side))
        };
        let mut sides: Vec<ProfileSide> = parallel::map(Side::BOTH.iter(), side);
        let Wanted { parameter, error, factor, rise, bound, .. } = subject;
        let (mut points, mut refits) = (vec![self.best(parameter)], 0);
        for side in &mut sides {
            points.append(&mut side.points);
            refits += side.refits;
        }
        points.sort_by(|a, b| a.value.total_cmp(&b.value));
        let (name, unit, value) = (parameter.name.clone(), parameter.unit.clone(), parameter.value);
        let (ends, reach) = ([sides[0].end, sides[1].end], reach(error, factor, rise));
        let held = [0, 1].map(|k| std::mem::take(&mut sides[k].held));
        let by_error = [value - reach, value + reach];
        Ok(Profile { name, unit, value, error, factor, rise, bound, ends, held, by_error, points, refits })
    }

    /// One side of the profile of a parameter, as bytes for [`Self::of`]; none when it was interrupted.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn side_of(&self, name: &str, side: Side) -> Result<Option<Vec<u8>>, StudyError> {
        let found = self.one_side(&self.subject(name)?, side);
        let whole = !matches!(found.end, End::Interrupted(_)) && self.work.goes_on();
        Ok(postcard::to_allocvec(&found).ok().filter(|_| whole))
    }

    fn one_side(&self, wanted: &Wanted<'_>, side: Side) -> ProfileSide {
        self.side(wanted, if side == Side::Below { -1.0 } else { 1.0 })
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
        let param = &definition.params[place];
        let (lower, upper, value) = (param.lower, param.upper, parameter.value);
        let logarithmic = param.logarithmic && value > 0.0;
        match (parameter.status, parameter.error().filter(|e| e.is_finite() && *e > 0.0)) {
            (Status::Estimated, Some(error)) => {
                let factor = error / parameter.standard_error.unwrap_or(error);
                let freedom = parameter.degrees_of_freedom.filter(|_| parameter.corrected_error.is_some());
                // chi-squared of one degree of freedom is the square of a normal deviate
                let rise = self.rise.unwrap_or(0.5 * (factor * quantile(freedom)).powi(2));
                Ok(Wanted { place, parameter, error, factor, rise, logarithmic, bound: false })
            }
            (Status::NotDetermined, _) => {
                Err(refused("the data do not determine it: its interval is open on both sides"))
            }
            (Status::AtLowerBound | Status::AtUpperBound, _) => {
                // a guess at its error, from which the search begins; colour counts as for the others
                let reached = parameter.limit.map(|limit| (limit - value).abs() / quantile(None));
                let range = [upper - lower, value.abs(), 1.0].into_iter().find(|r| *r > 0.0 && r.is_finite());
                let guess = if logarithmic { value } else { 0.1 * range.unwrap_or(1.0) };
                let error = reached.filter(|e| e.is_finite() && *e > 0.0).unwrap_or(guess);
                let ratios = self.fit.estimate.parameters.iter().filter_map(|p| Some(p.error()? / p.standard_error?));
                let (sum, count) = ratios.fold((0.0, 0.0), |(sum, count), r| (sum + r * r, count + 1.0));
                let factor = if count > 0.0 { f64::max((sum / count).sqrt(), 1.0) } else { 1.0 };
                let rise = self.rise.unwrap_or(0.5 * (factor * quantile(None)).powi(2));
                Ok(Wanted { place, parameter, error, factor, rise, logarithmic, bound: true })
            }
            _ => Err(refused("it was not estimated")),
        }
    }

    /// The estimate itself.
    fn best(&self, parameter: &ParameterEstimate) -> Point {
        Point { value: parameter.value, rise: 0.0, others: others(&self.fit.estimate, parameter) }
    }

    /// One side: its end, then the curve on the way. A value that costs more than one farther off was fitted into another minimum, and is fitted again
    /// from there; the end is looked for again where that shows that it lies elsewhere.
    fn side(&self, wanted: &Wanted<'_>, sign: f64) -> ProfileSide {
        let root = wanted.rise.sqrt();
        let (mut found, mut refits) = (Vec::new(), 0);
        let (mut below, mut above) = ((0.0, 0.0), None);
        let mut end = End::Interrupted(wanted.parameter.value);
        // searches for an end, where a refit has shown that it lies elsewhere
        for round in 0..3 {
            end = self.end((wanted, sign), (below, above), &mut found, &mut refits);
            if round == 0 {
                self.curve((wanted, sign), end, &mut found, &mut refits);
            }
            self.mend(wanted, &mut found, &mut refits);
            // what was found at the end may have become cheaper, what lies before it not
            let at = wanted.at(end.value());
            let past = found.iter().position(|f: &Refit| f.root() > (1.0 + NEAR) * root);
            let before = found[..past.unwrap_or(found.len())].last();
            below = before.map_or((0.0, 0.0), |f| (f.at, f.root()));
            above = past.map(|k| (found[k].at, found[k].root()));
            let stands = match (end, above) {
                (End::Interrupted(_), _) => true,
                (End::At(_), Some((first, _))) => at <= first && (at >= below.0 || below.1 >= (1.0 - NEAR) * root),
                (End::At(_), None) => below.1 >= (1.0 - NEAR) * root,
                (_, Some((first, _))) => at <= first,
                (_, None) => true,
            };
            if stands {
                break;
            }
        }
        let held = held_beside(&found, wanted.at(end.value()));
        let points = found.into_iter().map(|f| Point { value: f.value, rise: f.rise, others: f.others }).collect();
        ProfileSide { end, held, points, refits }
    }

    /// The end by secants on the root of the rise, which is straight where the cost is a parabola, between a value below the limit and perhaps one above.
    fn end(
        &self,
        (wanted, sign): (&Wanted<'_>, f64),
        (mut below, mut above): ((f64, f64), Option<(f64, f64)>),
        found: &mut Vec<Refit>,
        refits: &mut usize,
    ) -> End {
        let param = &self.fit.model.definition().params[wanted.place];
        let limit = wanted.rise.sqrt();
        let bound = if sign < 0.0 { param.lower } else { param.upper };
        let farthest = wanted.at(bound);
        let next = |below: (f64, f64), above: Option<(f64, f64)>, at: f64| match above {
            Some(above) => within(below, above, limit),
            None if below.1 > 0.0 => below.0 * (limit / below.1).clamp(1.2, 4.0),
            None => 4.0 * at,
        };
        // in errors; a first guess as the parabola has it
        let cramer_rao = wanted.parameter.standard_error.unwrap_or(wanted.error);
        let mut at = limit * std::f64::consts::SQRT_2 * cramer_rao / wanted.error;
        if below.0 > 0.0 || above.is_some() {
            at = next(below, above, at);
        }
        let mut starts = found.iter().find(|f| f.at == below.0).map_or(self.starts.clone(), |f| f.starts.clone());
        // most refits on one side until the end is found
        let last = *refits + 14;
        let mut tried_bound = above.is_some_and(|above| above.0 >= farthest);
        while *refits < last {
            if !self.work.goes_on() {
                return End::Interrupted(wanted.value(sign, below.0));
            }
            // an end is known to this part, and no parameter goes beyond its bound
            let next_to_it = farthest - below.0 <= NEAR * farthest;
            if next_to_it && above.is_none_or(|above| above.0 >= farthest) && tried_bound {
                return End::Bound(bound);
            }
            at = at.min(farthest).min(FAR);
            tried_bound |= at >= farthest;
            let value = if at >= farthest { bound } else { wanted.value(sign, at) };
            *refits += 1;
            let Some(refit) = self.refit(wanted, (at, value), &starts) else {
                if self.work.goes_on() && (*refits >= last || at - below.0 < 1e-3 * at) {
                    // where the cost has risen enough behind it the end lies between them
                    match above {
                        Some(_) => break,
                        None => return End::Astray(wanted.value(sign, below.0)),
                    }
                }
                at = below.0 + 0.5 * (at - below.0);
                continue;
            };
            let root = refit.root();
            if root < limit {
                starts.clone_from(&refit.starts);
            }
            found.push(refit);
            if (root - limit).abs() <= NEAR * limit {
                return End::At(value);
            } else if root < limit {
                if at >= farthest {
                    return End::Bound(bound);
                } else if at >= FAR {
                    return End::Open(value);
                }
                below = (at, root);
            } else {
                above = Some((at, root));
            }
            at = next(below, above, at);
        }
        // so near that a secant between them is as good
        match above {
            Some(above) => End::At(wanted.value(sign, within(below, above, limit))),
            None => End::Open(wanted.value(sign, below.0)),
        }
    }

    /// Points between the estimate and an end, each begun where the one before it ended.
    fn curve(&self, (wanted, sign): (&Wanted<'_>, f64), end: End, found: &mut Vec<Refit>, refits: &mut usize) {
        let mut starts = self.starts.clone();
        let whole = wanted.at(end.value());
        for k in 1..=BETWEEN {
            let at = whole * k as f64 / (BETWEEN + 1) as f64;
            if at == 0.0 || !at.is_finite() || !self.work.goes_on() {
                continue;
            }
            *refits += 1;
            if let Some(refit) = self.refit(wanted, (at, wanted.value(sign, at)), &starts) {
                starts.clone_from(&refit.starts);
                found.push(refit);
            }
        }
    }

    /// Sorts what was found from the estimate outward, and fits again what costs more than something farther off, from there.
    fn mend(&self, wanted: &Wanted<'_>, found: &mut [Refit], refits: &mut usize) {
        found.sort_by(|a, b| a.at.total_cmp(&b.at));
        for k in (1..found.len()).rev() {
            let (nearer, farther) = (&found[k - 1], &found[k]);
            if nearer.rise <= farther.rise + FALLS * wanted.rise || !self.work.goes_on() {
                continue;
            }
            *refits += 1;
            let again = self.refit(wanted, (nearer.at, nearer.value), &farther.starts);
            if let Some(again) = again.filter(|again| again.rise < nearer.rise) {
                found[k - 1] = again;
            }
        }
    }

    /// The best fit with the parameter held; none when there is none.
    fn refit(&self, wanted: &Wanted<'_>, (at, value): (f64, f64), starts: &[Vec<f64>]) -> Option<Refit> {
        let mut params = self.fit.model.definition().params.clone();
        (params[wanted.place].value, params[wanted.place].fixed) = (value, true);
        let model: Model = self.fit.model.with_params(params);
        let mut starts = starts.to_vec();
        starts.iter_mut().for_each(|theta| theta[wanted.place] = value);
        let found = fit_from(&Attempt {
            model: &model,
            runs: self.runs,
            starts: &starts,
            options: &self.options,
            work: &self.work.quiet(),
        })
        .ok()?;
        let known = found.estimate.termination.is_good();
        let rise = found.estimate.cost.filter(|c| c.is_finite())? - self.fit.estimate.cost?;
        // what is not at its minimum costs too much: where that is allowed all the same, the value belongs to the interval
        (known || rise <= wanted.rise).then_some(())?;
        let others = others(&found.estimate, wanted.parameter);
        let held = at_bounds(&found.estimate);
        Some(Refit { at, value, rise, starts: reached(&model, self.runs, &found.estimate), others, held })
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
    other.map(|p| (called(p), p.value)).collect()
}

fn called(p: &ParameterEstimate) -> String {
    p.run.as_ref().map_or(p.name.clone(), |run| format!("{} of {run}", p.name))
}

/// Parameters that a refit left at their bounds.
fn at_bounds(estimate: &Estimate) -> Vec<AtBound> {
    let held = estimate.parameters.iter().filter(|p| matches!(p.status, Status::AtLowerBound | Status::AtUpperBound));
    held.map(|p| AtBound { name: called(p), bound: p.value }).collect()
}

/// What stands at its bound in the nearest refits before and behind a place (in errors); refits by their places.
fn held_beside(found: &[Refit], place: f64) -> Vec<AtBound> {
    let past = found.partition_point(|f| f.at < place);
    let beside = found[..past].last().into_iter().chain(found.get(past));
    let mut held: Vec<AtBound> = Vec::new();
    for own in beside.flat_map(|f| &f.held) {
        if !held.contains(own) {
            held.push(own.clone());
        }
    }
    held
}

#[cfg(test)]
#[path = "profile_tests.rs"]
mod tests;
