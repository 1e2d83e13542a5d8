//! What a truth does in the three manoeuvres: alone, under its controller, or in a gust.

use crate::chance::Chance;
use crate::experiment::{self, MANOEUVRES};
use crate::families::Family;
use crate::oracle::response;
use fdm::Model;
use fdm::record::Run;

/// How the plant is driven.
pub(crate) enum Drives<'a> {
    /// Inputs of each manoeuvre are given.
    Open(Vec<Run>),
    /// A controller computes one from a reference and from what noisy sensors say: excitation and noise of each manoeuvre.
    Closed { family: &'a Family, excitation: &'a [Vec<f64>; 3], noise: &'a [Vec<f64>] },
}

impl Drives<'_> {
    /// Runs whose `measured` are the true outputs without noise; nothing where the simulation fails.
    pub(crate) fn clean(&self, model: &Model, theta: &[f64]) -> Option<Vec<Run>> {
        let driven = match self {
            Self::Open(runs) => runs.clone(),
            Self::Closed { family, excitation, noise } => closed(family, model, theta, excitation, noise)?,
        };
        let answer = |run: Run| Some(Run { measured: response(model, &run, theta)?, ..run });
        driven.into_iter().map(answer).collect()
    }
}

/// The plant with its controller is one model; what the controller says at the samples is then the record of the input, and what
/// the plant does with exactly that record, linear between samples, is measured.
fn closed(
    family: &Family,
    model: &Model,
    theta: &[f64],
    excitation: &[Vec<f64>; 3],
    noise: &[Vec<f64>],
) -> Option<Vec<Run>> {
    let control = family.control.as_ref()?;
    let outputs: Vec<&str> = model.definition().outputs.iter().map(|o| o.quantity.name.as_str()).collect();
    let felt: Vec<usize> =
        control.felt.iter().map(|n| outputs.iter().position(|o| o == n).expect("an output")).collect();
    let both =
        Model::from_text("loop", with_controller(model, control)).unwrap_or_else(|e| panic!("{}: {e}", family.name));
    let recorded = both.layout().outputs - 1;
    let mut numbers = both.definition().start();
    for (param, value) in model.definition().params.iter().zip(theta) {
        numbers[both.definition().param(&param.quantity.name)?] = *value;
    }
    let q = outputs.len();
    MANOEUVRES
        .iter()
        .zip(excitation)
        .zip(noise)
        .map(|((name, moved), noise)| {
            let row = |t: usize| {
                let reference = control.amplitude * moved[t];
                std::iter::once(reference).chain(felt.iter().map(move |c| noise[t * q + c])).collect::<Vec<_>>()
            };
            let driven = experiment::run(&both, name, family.step, (0..family.samples).flat_map(row).collect());
            let y = response(&both, &driven, &numbers)?;
            let width = both.layout().outputs;
            let inputs = y.iter().skip(recorded).step_by(width).copied().collect();
            Some(experiment::run(model, name, family.step, inputs))
        })
        .collect()
}

/// The text with the controller in the place of its input.
fn with_controller(model: &Model, control: &crate::families::Loop) -> String {
    let (text, definition) = (model.source().text(), model.definition());
    let outputs = definition.outputs.iter().map(|o| &o.quantity);
    let quantities = definition.inputs.iter().map(|i| &i.quantity).chain(outputs);
    let unit = |name: &str| {
        let quantity = quantities.clone().find(|q| q.name == name).expect("a name of the family");
        quantity.unit.as_ref().map_or(String::new(), |u| format!(" [{u}]"))
    };
    let declared = format!("  input {} ", control.input);
    let mut made = String::new();
    for line in text.lines() {
        if line.starts_with(&declared) {
            let of_reference = unit(if control.of_input { control.input } else { control.felt[0] });
            made.push_str(&format!("  input reference{of_reference};\n"));
            control.felt.iter().for_each(|y| made.push_str(&format!("  input noise_{y}{};\n", unit(y))));
            made.push_str(&format!("  {}\n", control.lines));
        } else {
            made.push_str(line);
            made.push('\n');
        }
    }
    let end = made.rfind('}').expect("a model");
    made.truncate(end);
    format!("{made}  output recorded = {};\n}}\n", control.input)
}

/// The text with a random force in the equation of a state.
pub(crate) fn with_gust(text: &str, state: &str) -> String {
    let mark = format!("der({state}) =");
    let at = text.find(&mark).expect("the equation of the state");
    let end = at + text[at..].find(';').expect("the end of the equation");
    let first = text.find('{').expect("a model") + 1;
    format!("{}\n  input gust;{} + gust{}", &text[..first], &text[first..end], &text[end..])
}

/// A force that forgets what it was within `memory` (in samples), of standard deviation 1, begun at rest.
pub(crate) fn gust(samples: usize, memory: f64, chance: &mut Chance) -> Vec<f64> {
    let keep = (-1.0 / memory).exp();
    let mut force = 0.0;
    let mut next = || {
        let now = force;
        force = keep * force + (1.0 - keep * keep).sqrt() * chance.normal();
        now
    };
    (0..samples).map(|_| next()).collect()
}
