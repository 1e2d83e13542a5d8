//! Measures the requirements of a model at any parameters, with their derivatives.

use super::linear::Linear;
use super::measured::{Measured, RequirementError};
use super::standard::{Driven, Flight, Flown, Manoeuvre, Solved, Zigzag};
use fdm_grammar::requirement::{OfCourse, Requirements, Target, What};
use fdm_system::Model;
use fdm_system::dynamics::{Point, Workspace};
use fdm_system::linear::{LinearModel, Modes, Values};
use std::sync::Arc;

/// Where a measure is flown.
struct Place {
    manoeuvre: usize,
}

/// Everything that is prepared once: compiled expressions, the linear model, manoeuvres with their steps.
pub struct Plan {
    requirements: Arc<Requirements>,
    /// Parameters that have derivatives, by index.
    columns: Vec<usize>,
    /// Parameters of the model, by number.
    params: usize,
    /// The model of the requirements' own expressions, and for each of its parameters that of the model.
    expressions: Model,
    own: Vec<Option<usize>>,
    linear: Option<LinearModel>,
    /// (hidden input, input that it is the derivative of)
    slopes: Vec<(u32, u32)>,
    modes: bool,
    trimmed: bool,
    manoeuvres: Vec<Manoeuvre>,
    places: Vec<Option<Place>>,
    /// Why no manoeuvre is flown.
    grounded: Option<String>,
}

/// A plan at work: one for each thread.
pub struct Bench<'p> {
    plan: &'p Plan,
    linear: Option<LinearModel>,
    values: Values,
    flights: Vec<Flight<'p>>,
    known: Vec<f64>,
    work: Workspace,
}

impl Plan {
    /// Prepares the requirements of a model at its estimates: theta (p) are the values of its parameters, `columns` (indices into theta) those that
    /// are not known exactly. None where the model has no requirements.
    ///
    /// # Errors
    /// [`RequirementError`].
    pub fn new(model: &Model, theta: &[f64], columns: &[usize]) -> Result<Option<Self>, RequirementError> {
        let Some(requirements) = model.definition().requirements.clone() else { return Ok(None) };
        let definition = model.definition();
        let (expressions, own) = expressions(model, &requirements);
        let flown = |w: &What| matches!(w, What::Course { .. } | What::Zigzag { .. });
        let linear_needed = requirements.measures.iter().any(|m| !flown(&m.what));
        let modes = requirements.measures.iter().any(|m| matches!(m.what, What::Mode { .. } | What::Response { .. }));
        let flies = requirements.measures.iter().any(|m| flown(&m.what));
        // a manoeuvre begins at the trim where the text has one
        let trimmed = flies && !definition.trim.is_empty();
        let rest = if trimmed { Some(LinearModel::at_rest(model)) } else { None };
        let grounded = match &rest {
            Some(Err(e)) => Some(format!("a manoeuvre begins at the trim; {e}")),
            _ => None,
        };
        let trimmed = trimmed && grounded.is_none();
        let mut linear = match rest {
            Some(Ok(linear)) => Some(linear),
            _ if linear_needed => Some(LinearModel::new(model)?),
            _ => None,
        };
        let solved = match &mut linear {
            Some(linear) if trimmed => {
                linear.evaluate(theta, &mut Values::default())?;
                solved(linear, theta)
            }
            _ => Solved::default(),
        };
        let slopes = definition.inputs.iter().enumerate().filter_map(|(k, i)| Some((k as u32, i.slope?.of))).collect();
        let (mut groups, mut places) = (Vec::<Flown>::new(), Vec::new());
        for measure in &requirements.measures {
            if grounded.is_some() && flown(&measure.what) {
                places.push(None);
                continue;
            }
            let mut most = 0;
            let (duration, driven, targets) = match &measure.what {
                What::Course { signal, duration, drives, of } => {
                    let other = if let OfCourse::Reached(other, _) = of { Some(other.target) } else { None };
                    let targets: Vec<Target> = std::iter::once(signal.target).chain(other).collect();
                    (*duration, Driven::Standard(drives.clone()), targets)
                }
                What::Zigzag { signal, input, size, level, number, duration } => {
                    let (signal, input, size) = (*signal, *input, *size);
                    let zigzag = Zigzag { signal, input, size, level: *level };
                    most = *number;
                    (*duration, Driven::Zigzag(zigzag), vec![signal.target])
                }
                _ => {
                    places.push(None);
                    continue;
                }
            };
            let at = groups.iter().position(|g| g.duration == duration && g.driven == driven).unwrap_or_else(|| {
                groups.push(Flown { duration, driven, overshoots: 0, targets: Vec::new() });
                groups.len() - 1
            });
            let group = &mut groups[at];
            group.overshoots = group.overshoots.max(most);
            for target in targets {
                if !group.targets.contains(&target) {
                    group.targets.push(target);
                }
            }
            places.push(Some(Place { manoeuvre: at }));
        }
        let made = groups.into_iter().map(|flown| Manoeuvre::new(model, (theta, &solved), flown));
        let manoeuvres = made.collect::<Result<Vec<_>, _>>()?;
        Ok(Some(Self {
            columns: columns.to_vec(),
            params: theta.len(),
            expressions,
            own,
            linear,
            slopes,
            modes,
            trimmed,
            manoeuvres,
            places,
            grounded,
            requirements,
        }))
    }

    /// The requirements.
    pub fn requirements(&self) -> &Requirements {
        &self.requirements
    }

    /// Parameters that have derivatives, by index.
    pub fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// A bench.
    ///
    /// # Errors
    /// [`RequirementError::Simulation`].
    pub fn bench(&self) -> Result<Bench<'_>, RequirementError> {
        let flights = self.manoeuvres.iter().map(Flight::new).collect::<Result<_, _>>()?;
        let known = vec![0.0; self.expressions.layout().known];
        let work = Workspace::new(self.expressions.dynamics());
        Ok(Bench { plan: self, linear: self.linear.clone(), values: Values::default(), flights, known, work })
    }
}

/// Values of the trim that follow from the equations, where the linear model was evaluated last.
fn solved(linear: &mut LinearModel, theta: &[f64]) -> Solved {
    let signals = linear.trim(theta).solved;
    let (values, slopes) = linear.unknowns();
    Solved { signals, values: values.to_vec(), slopes: slopes.to_vec() }
}

/// The compiled expressions, and for each of their parameters that of the model.
fn expressions(model: &Model, requirements: &Requirements) -> (Model, Vec<Option<usize>>) {
    let open = model.open_ties();
    let open: Vec<&str> = open.iter().map(String::as_str).collect();
    let mut definition = requirements.model.tied(&open);
    let params = &model.definition().params;
    let place = |name: &str| params.iter().position(|p| p.quantity.name == name);
    let own: Vec<Option<usize>> = definition.params.iter().map(|p| place(&p.quantity.name)).collect();
    for (param, place) in definition.params.iter_mut().zip(&own) {
        param.fixed = place.is_none_or(|k| params[k].fixed);
    }
    (model.altered(definition), own)
}

impl Bench<'_> {
    /// Every requirement at theta (p), with its derivatives by the plan's columns where `slopes` says so.
    pub fn measure(&mut self, theta: &[f64], slopes: bool) -> Vec<Measured> {
        let measures = self.measures(theta, slopes, None);
        self.of_measures(&measures, theta, slopes)
    }

    /// The values of some requirements at theta (p): what nobody wants is not flown, and what is made of it is no number.
    pub(super) fn measure_some(&mut self, theta: &[f64], wanted: &[bool]) -> Vec<Measured> {
        let measures = self.measures(theta, false, Some(&self.plan.needed(wanted)));
        self.of_measures(&measures, theta, false)
    }

    /// Requirements, of what was measured.
    fn of_measures(&mut self, measures: &[Measured], theta: &[f64], slopes: bool) -> Vec<Measured> {
        let plan = self.plan;
        let layout = plan.expressions.layout();
        let count = plan.requirements.list.len();
        let mut known = std::mem::take(&mut self.known);
        let own: Vec<f64> = plan.own.iter().map(|k| k.map_or(f64::NAN, |k| theta[k])).collect();
        plan.expressions.dynamics().prepare(&own, &mut known, &mut self.work);
        let mut drive = vec![0.0; layout.drive()];
        drive.iter_mut().zip(measures).for_each(|(d, m)| *d = m.value);
        let at = Point { t: 0.0, x: &[], drive: &drive, known: &known };
        let mut out = vec![0.0; layout.output_slots()];
        plan.expressions.dynamics().outputs_and_partials(at, &mut out, &mut self.work);
        let mut by_input = vec![0.0; layout.input_slots()];
        plan.expressions.dynamics().by_input(at, &mut by_input, &mut self.work);
        self.known = known;
        let patterns = &layout.patterns;
        let mut all: Vec<Measured> = out[..count].iter().map(|v| Measured::of(*v, Vec::new())).collect();
        // a measure that does not exist makes what is made of it not exist
        for (_, i, j) in patterns.outputs_by_input.entries().filter(|(_, i, _)| *i < count) {
            let missing = measures.get(j).and_then(|m| m.missing.as_ref());
            if let (Some(why), true) = (missing, all[i].value.is_nan()) {
                let text = &plan.requirements.measures[j].text;
                all[i].missing.get_or_insert_with(|| format!("`{text}`: {why}"));
            }
        }
        for measured in all.iter_mut().filter(|m| !m.value.is_finite()) {
            measured.value = f64::NAN;
            measured.missing.get_or_insert_with(|| "its expression has no finite value".into());
        }
        if slopes {
            let first = layout.outputs + patterns.outputs_by_state.len() + patterns.outputs_by_delayed.len();
            let width = plan.columns.len();
            all.iter_mut().for_each(|m| m.gradient = vec![0.0; width]);
            let column = |k: usize| plan.columns.iter().position(|c| *c == k);
            for (k, i, j) in patterns.outputs_by_param.entries().filter(|(_, i, _)| *i < count) {
                if let Some(c) = plan.own[j].and_then(column) {
                    all[i].gradient[c] += out[first + k];
                }
            }
            for (k, i, j) in patterns.outputs_by_input.entries().filter(|(_, i, _)| *i < count) {
                let Some(measure) = measures.get(j) else { continue };
                let by = by_input[patterns.rates_by_input.len() + k];
                // what has no part in a branch that is not taken adds nothing
                if by != 0.0 {
                    let own = &measure.gradient;
                    all[i]
                        .gradient
                        .iter_mut()
                        .enumerate()
                        .for_each(|(c, g)| *g += by * own.get(c).unwrap_or(&f64::NAN));
                }
            }
        }
        all
    }

    /// The measures, with derivatives by the plan's columns; all of them, or those that are needed.
    fn measures(&mut self, theta: &[f64], slopes: bool, needed: Option<&[bool]>) -> Vec<Measured> {
        let plan = self.plan;
        let columns: &[usize] = if slopes { &plan.columns } else { &[] };
        let evaluated = self.linear.as_mut().map(|linear| linear.evaluate(theta, &mut self.values));
        let lost = if let Some(Err(e)) = &evaluated { Some(e.to_string()) } else { None };
        let linear = self.linear.as_ref().filter(|_| lost.is_none());
        let structure = linear.map(|l| l.structure().clone());
        let modes = match &structure {
            Some(structure) if plan.modes => Some(Modes::new(structure, &self.values)),
            _ => None,
        };
        let solved = match &mut self.linear {
            Some(linear) if plan.trimmed && lost.is_none() => solved(linear, theta),
            _ => Solved::default(),
        };
        let picked = |mut measured: Measured| {
            if measured.missing.is_none() {
                let all = std::mem::take(&mut measured.gradient);
                measured.gradient = columns.iter().map(|k| all.get(*k).copied().unwrap_or(0.0)).collect();
            }
            measured
        };
        let mut list = Vec::with_capacity(plan.requirements.measures.len());
        for (k, (measure, place)) in plan.requirements.measures.iter().zip(&plan.places).enumerate() {
            if needed.is_some_and(|needed| !needed[k]) {
                list.push(Measured::missing("nobody asked"));
                continue;
            }
            let lost = || Measured::missing(lost.clone().unwrap_or_else(|| "there is no linear model".into()));
            if let Some(place) = place {
                if plan.trimmed && structure.is_none() {
                    list.push(lost());
                    continue;
                }
                let flight = &mut self.flights[place.manoeuvre];
                list.push(flown(flight, &measure.what, (theta, &solved), columns));
                continue;
            }
            if let (What::Course { .. } | What::Zigzag { .. }, Some(why)) = (&measure.what, &plan.grounded) {
                list.push(Measured::missing(why.clone()));
                continue;
            }
            let Some(structure) = &structure else {
                list.push(lost());
                continue;
            };
            let linear = Linear { structure, values: &self.values, slopes: &plan.slopes };
            let found = modes.as_ref().and_then(|m| m.as_ref().ok());
            list.push(picked(match &measure.what {
                What::Mode { state, of } => match &modes {
                    Some(Ok(modes)) => linear.mode(modes, *state, *of),
                    Some(Err(e)) => Measured::missing(e.to_string()),
                    None => Measured::missing("there are no modes"),
                },
                What::Coefficient { row, column } => linear.coefficient(*row, *column),
                What::Response { signal, input, of } => linear.of_response(found, *signal, *input, *of),
                What::Course { .. } | What::Zigzag { .. } => Measured::missing("it is flown"),
            }));
        }
        list
    }
}

/// What is asked of a flight.
fn flown(flight: &mut Flight<'_>, what: &What, at: (&[f64], &Solved), columns: &[usize]) -> Measured {
    match what {
        What::Course { signal, of, .. } => {
            let found = flight.standard(at, columns, |samples| {
                let own = samples(*signal);
                let other = if let OfCourse::Reached(other, _) = of { Some(samples(*other)) } else { None };
                own.course().of(*of, other.as_ref().map(|o| o.course()).as_ref())
            });
            found.unwrap_or_else(|| Measured::missing("the response diverges"))
        }
        What::Zigzag { signal, input, size, level, number, .. } => {
            let (signal, input, size) = (*signal, *input, *size);
            let zigzag = Zigzag { signal, input, size, level: *level };
            flight.zigzag(&zigzag, *number, at, columns)
        }
        _ => Measured::missing("it is not flown"),
    }
}

impl Plan {
    /// Parameters of the model.
    pub fn params(&self) -> usize {
        self.params
    }

    /// Which measures some requirements are made of.
    fn needed(&self, wanted: &[bool]) -> Vec<bool> {
        let mut needed = vec![false; self.requirements.measures.len()];
        let made = self.expressions.layout().patterns.outputs_by_input.entries();
        for (_, _, j) in made.filter(|(_, i, _)| wanted.get(*i) == Some(&true)) {
            if let Some(needed) = needed.get_mut(j) {
                *needed = true;
            }
        }
        needed
    }
}
