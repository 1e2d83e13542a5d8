//! What a residual may hang on: inputs, and what is not linear in states and inputs.

use super::driven::Driven;
use super::place::{ForceError, Passage};
use crate::model::Model;
use serde::Serialize;

/// Most products that are looked at.
const MOST: usize = 40;

/// A function of the model's states and inputs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Function {
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
    pub(super) fn new(model: &Model, driven: &Driven, passages: &[Passage<'_>]) -> Result<Self, ForceError> {
        let definition = model.definition();
        let (n, m) = (definition.states.len(), definition.inputs.len());
        let declared = definition.inputs.iter().take_while(|i| i.is_declared()).count();
        let states = definition.states.iter().map(|s| s.quantity.name.clone());
        let inputs = definition.inputs[..declared].iter().map(|i| i.quantity.name.clone());
        let names: Vec<String> = states.chain(inputs).collect();
        let mut rows: Vec<Vec<f64>> = Vec::new();
        for (run, passage) in passages.iter().enumerate() {
            let states = driven.states(run, *passage)?;
            let samples = passage.run.len();
            let row = |k: usize| {
                let own = states[k * n..(k + 1) * n].iter();
                own.chain(&passage.run.inputs[k * m..k * m + declared]).copied().collect::<Vec<f64>>()
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
        let functions =
            forms.iter().map(|f| Function { text: f.text(&names), input: matches!(f, Form::Itself(a) if *a >= n) }).collect();
        let factors = forms.iter().map(|f| f.factor(&size)).collect();
        let courses = rows.iter().map(|rows| forms.iter().map(|f| course(*f, rows)).collect()).collect();
        Ok(Self { functions, courses, factors })
    }
}

fn forms(alive: &[usize], states: usize) -> Vec<Form> {
    let each = |form: fn(usize) -> Form| alive.iter().map(move |k| form(*k));
    let (moved, driven): (Vec<usize>, Vec<usize>) = alive.iter().partition(|k| **k < states);
    let mut forms: Vec<Form> = driven.into_iter().chain(moved).map(Form::Itself).collect();
    let linear = forms.len();
    forms.extend(each(Form::Sided).chain(each(Form::Square)).chain(each(Form::Cube)).chain(each(Form::Sign)));
    for (i, a) in alive.iter().enumerate() {
        forms.extend(alive[i + 1..].iter().map(|b| Form::Product(*a, *b)));
    }
    forms.truncate(linear + MOST);
    forms
}
