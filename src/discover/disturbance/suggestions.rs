//! What an unknown disturbance may be a function of: simple functions of states and inputs in every equation, tried through the dynamics, so
//! that nothing measured is differentiated (the terms of a sparse regression, each as the response that it would cause).
//!
//! What a residual may hang on: inputs, and what is not linear in states and inputs.

use super::forced_response::ForcedResponse;
use super::place::{DisturbanceError, FittedRun, Place, PlaceKind, places};
use crate::bins::Record;
use crate::screening::{Direction, Screening, ScreeningError, ScreeningOptions, Shape, screen};
use fdm_system::model::Model;
use serde::{Deserialize, Serialize};

/// Most directions that are tried.
const DIRECTIONS: usize = 240;
/// Draws of residuals by which the best is judged.
const DRAWS: usize = 200;

/// A function in an equation.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Suggestion {
    /// Where it stands.
    pub place: Place,
    /// The function of states and inputs, as it would be written in the model.
    pub function: String,
    /// Its factor there.
    pub coefficient: f64,
    /// Twice its predicted gain in log-likelihood.
    pub statistic: f64,
    /// The chance that noise gives it as much.
    pub chance: f64,
}

/// Functions of states and inputs that residuals look like, through the dynamics.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Suggestions {
    /// The likeliest first.
    pub list: Vec<Suggestion>,
    /// The chance that noise alone makes any of them look as good as the first.
    pub family_wise: f64,
}

/// Why nothing can be suggested.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum SuggestionError {
    /// No response to a disturbance.
    #[error(transparent)]
    Disturbance(#[from] DisturbanceError),
    /// The runs cannot be screened.
    #[error(transparent)]
    Screening(#[from] ScreeningError),
}

/// Tries simple functions of states and inputs in every equation in which something was left to be found.
///
/// # Errors
/// [`SuggestionError`]
pub(crate) fn suggestions(model: &Model, fitted_runs: &[FittedRun<'_>]) -> Result<Suggestions, SuggestionError> {
    let q = model.layout().outputs;
    if fitted_runs.is_empty() || q == 0 {
        return Err(DisturbanceError::Nothing.into());
    }
    let places: Vec<Place> = places(model).into_iter().filter(|p| p.kind == PlaceKind::Equation).collect();
    let forced_response = ForcedResponse::new(model, &places);
    let signals = Signals::new(model, &forced_response, fitted_runs)?;
    let functions = signals.functions.len().min(DIRECTIONS / places.len().max(1));
    let mut records: Vec<Record> = Vec::new();
    for (run, fitted_run) in fitted_runs.iter().enumerate() {
        let mut directions = vec![Vec::new(); functions * places.len()];
        forced_response.respond(
            run,
            *fitted_run,
            &signals.courses[run][..functions],
            &mut |place, function, response| {
                directions[place * functions + function] = response;
            },
        )?;
        let Record { interval, residual, fitted, .. } = fitted_run.record;
        records.push(Record {
            interval: *interval,
            residual: residual.clone(),
            fitted: fitted.clone(),
            directions,
            rows: None,
            deviations: fitted_run.record.deviations.clone(),
        });
    }
    let directions: Vec<Direction> = (0..functions * places.len())
        .map(|candidate| Direction { candidate, size: 1.0, shape: Shape::Linear })
        .collect();
    let options = ScreeningOptions { draws: DRAWS, ..ScreeningOptions::default() };
    let Screening { candidates, ranking, family_wise, .. } = screen(&records, q, &directions, &options)?;
    let one = |k: &usize| {
        let (candidate, function) = (&candidates[*k], &signals.functions[k % functions]);
        candidate.direction.map(|_| Suggestion {
            place: places[k / functions].clone(),
            function: function.text.clone(),
            coefficient: candidate.amount * signals.factors[k % functions],
            statistic: candidate.statistic,
            chance: candidate.chance,
        })
    };
    Ok(Suggestions { list: ranking.iter().filter_map(one).collect(), family_wise })
}

/// Most products that are looked at.
const PRODUCTS: usize = 40;

/// A function of the model's states and inputs.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
pub(super) struct Function {
    /// As it would be written in the model: `q*abs(q)`.
    pub text: String,
    /// Whether it is an input as it is.
    pub input: bool,
}

/// Courses of functions in every run (runs, functions, N).
pub(super) struct Signals {
    pub(super) functions: Vec<Function>,
    pub(super) courses: Vec<Vec<Vec<f64>>>,
    /// A course is its factor times the function: variables are divided by their largest values.
    pub(super) factors: Vec<f64>,
}

/// How a function follows from its variables.
#[derive(Debug, Clone, Copy)]
enum Form {
    Itself(usize),
    Square(usize),
    Sided(usize),
    Cube(usize),
    Sign(usize),
    Product(usize, usize),
}

impl Form {
    fn text(self, names: &[String]) -> String {
        match self {
            Self::Itself(a) => names[a].clone(),
            Self::Square(a) => format!("{}^2", names[a]),
            Self::Sided(a) => format!("{0}*abs({0})", names[a]),
            Self::Cube(a) => format!("{}^3", names[a]),
            Self::Sign(a) => format!("sign({})", names[a]),
            Self::Product(a, b) => format!("{}*{}", names[a], names[b]),
        }
    }

    /// By what dividing every variable by its size multiplies it.
    fn factor(self, size: &[f64]) -> f64 {
        match self {
            Self::Itself(a) => 1.0 / size[a],
            Self::Square(a) | Self::Sided(a) => size[a].powi(-2),
            Self::Cube(a) => size[a].powi(-3),
            Self::Sign(_) => 1.0,
            Self::Product(a, b) => 1.0 / (size[a] * size[b]),
        }
    }

    /// From values that are divided by their sizes.
    fn value(self, z: &[f64]) -> f64 {
        match self {
            Self::Itself(a) => z[a],
            Self::Square(a) => z[a] * z[a],
            Self::Sided(a) => z[a] * z[a].abs(),
            Self::Cube(a) => z[a] * z[a] * z[a],
            // a jump that no sampling resolves is no function of time
            Self::Sign(a) => fdm_grammar::math::tanh(20.0 * z[a]),
            Self::Product(a, b) => z[a] * z[b],
        }
    }
}

impl Signals {
    /// Inputs first, then functions of states and inputs, simple ones first.
    pub(super) fn new(
        model: &Model,
        forced_response: &ForcedResponse,
        fitted_runs: &[FittedRun<'_>],
    ) -> Result<Self, DisturbanceError> {
        let definition = model.definition();
        let (n, m) = (definition.states.len(), definition.inputs.len());
        let declared = definition.inputs.iter().take_while(|i| i.is_declared()).count();
        let states = definition.states.iter().map(|s| s.quantity.name.clone());
        let inputs = definition.inputs[..declared].iter().map(|i| i.quantity.name.clone());
        let names: Vec<String> = states.chain(inputs).collect();
        let mut rows: Vec<Vec<f64>> = Vec::new();
        for (run, fitted_run) in fitted_runs.iter().enumerate() {
            let states = forced_response.states(run, *fitted_run)?;
            let samples = fitted_run.run.len();
            let row = |k: usize| {
                let own = states[k * n..(k + 1) * n].iter();
                own.chain(&fitted_run.run.inputs[k * m..k * m + declared]).copied().collect::<Vec<f64>>()
            };
            rows.push((0..samples).flat_map(row).collect());
        }
        let width = names.len();
        let mut size = vec![0.0_f64; width];
        for (k, value) in rows.iter().flat_map(|r| r.iter().enumerate()) {
            size[k % width] = size[k % width].max(value.abs());
        }
        let alive: Vec<usize> = (0..width).filter(|k| size[*k] > 0.0 && size[*k].is_finite()).collect();
        let forms = forms(&alive, n);
        let course = |form: Form, rows: &[f64]| -> Vec<f64> {
            let mut z = vec![0.0; width];
            rows.chunks_exact(width.max(1))
                .map(|row| {
                    z.iter_mut().zip(row).zip(&size).for_each(|((z, v), s)| *z = if *s > 0.0 { v / s } else { 0.0 });
                    form.value(&z)
                })
                .collect()
        };
        let functions = forms
            .iter()
            .map(|f| Function { text: f.text(&names), input: matches!(f, Form::Itself(a) if *a >= n) })
            .collect();
        let factors = forms.iter().map(|f| f.factor(&size)).collect();
        let courses = rows.iter().map(|rows| forms.iter().map(|f| course(*f, rows)).collect()).collect();
        Ok(Self { functions, courses, factors })
    }
}

fn forms(alive: &[usize], states: usize) -> Vec<Form> {
    let each = |form: fn(usize) -> Form| alive.iter().map(move |k| form(*k));
    let (moved, forced_response): (Vec<usize>, Vec<usize>) = alive.iter().partition(|k| **k < states);
    let mut forms: Vec<Form> = forced_response.into_iter().chain(moved).map(Form::Itself).collect();
    let linear = forms.len();
    forms.extend(each(Form::Sided).chain(each(Form::Square)).chain(each(Form::Cube)).chain(each(Form::Sign)));
    for (i, a) in alive.iter().enumerate() {
        forms.extend(alive[i + 1..].iter().map(|b| Form::Product(*a, *b)));
    }
    forms.truncate(linear + PRODUCTS);
    forms
}
