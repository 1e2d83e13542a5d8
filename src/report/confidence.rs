//! What speaks for and against the parameters of a fit: how they settle with the length of the record, and how they move with the weights
//! of the outputs.

use super::section::{Cell, Part, Rows, Section};
use crate::page::figure::{Figure, Look, Mark, Panel, Shape};
use crate::page::number::bracketed;
use crate::page::subject::Subject;
use crate::text;
use fdm_estimate::{LengthFit, LengthSensitivity, ParameterEstimate, Weight};
use fdm_results::documents::{FitDocument, digits, with_run};

/// Changes in standard errors beyond which a parameter hangs on the weights.
const MUCH: f64 = 2.0;
/// Doubt beyond which a parameter is of little worth.
const DOUBTFUL: f64 = 0.2;
/// Doubt beyond which the records hardly distinguish a parameter from zero.
const MINOR: f64 = 0.5;
/// Parameters whose course is drawn.
const DRAWN: usize = 24;

/// Estimates by length of the record with the parameters in order of confidence, and how they move with the weights of the
/// outputs; empty when nothing was asked.
pub fn confidence(fit: &FitDocument) -> String {
    let tables = [lengths(fit), weights(fit)].into_iter().flatten().flatten();
    let text = text::sections(&[Section::new("lengths", "").with_all(tables)]);
    if text.is_empty() { text } else { format!("\n{text}\n") }
}

/// Estimates from the first part of the record to the whole, and with other weights.
pub(crate) fn section(subject: &Subject) -> Option<Section> {
    let (fit, figures) = (subject.fit()?, figures(subject));
    let more = fit.confidence.as_ref().map_or(0, Vec::len).saturating_sub(figures.len());
    let by_length = lengths(fit);
    let (said, more) = match by_length {
        None => (None, 0),
        Some(_) => (
            Some(
                "Every estimate from the first part of the records to the whole, with two standard errors; the parameters stand in the order of \
                  the confidence that they deserve.",
            ),
            more,
        ),
    };
    let section = Section::new("lengths", "By length of the record")
        .with_all(said.map(|said| Part::Line(said.into())))
        .with_all((!figures.is_empty()).then_some(Part::Pair(figures)))
        .notes((more > 0).then(|| format!("{more} more are in the result's JSON.")))
        .with_all([by_length, weights(fit)].into_iter().flatten().flatten());
    (!section.parts.is_empty()).then_some(section)
}

/// Parameters in order of confidence; their values by length; how far they wander. None of one length.
fn lengths(fit: &FitDocument) -> Option<Vec<Part>> {
    let lengths = fit.by_length.as_ref().filter(|lengths| lengths.len() > 1)?;
    let confidence = fit.confidence.as_deref().unwrap_or_default();
    let shown = |l: &LengthFit| digits(l.length, 3);
    let name = |s: &LengthSensitivity| with_run(&s.name, s.run.as_deref());
    let mut table = Rows::over(confidence);
    table.name("by confidence", |s| name(s));
    for l in lengths {
        table.number(&format!("to {}", shown(l)), |s| match find(l, s) {
            Some(p) if p.standard_error.is_some() => digits(p.value, 4),
            _ => "-".into(),
        });
    }
    table.number("standard error", |s| s.standard_error.map_or("-".into(), |e| digits(e, 3)));
    table.number("wander", |s| digits(s.wander, 3));
    table.number("doubt", |s| match s.doubt.is_finite() {
        true => Cell::warned(format!("{}%", digits(100.0 * s.doubt, 2)), s.doubt > DOUBTFUL),
        false => Cell::warned("all".into(), true),
    });
    // a doubt without bound is null in a document
    let minor: Vec<String> = confidence.iter().filter(|s| s.doubt > MINOR || s.doubt.is_nan()).map(name).collect();
    let minor = (!minor.is_empty())
        .then(|| format!("of minor importance in these records, known to their size only: {}", minor.join(", ")));
    let bad: Vec<String> = lengths.iter().filter(|l| !l.termination.is_good()).map(shown).collect();
    let bad = (!bad.is_empty()).then(|| format!("not converged: up to {}", bad.join(", ")));
    Some(std::iter::once(table.into()).chain(minor.into_iter().chain(bad).map(Part::Note)).collect())
}

/// The estimate by a part of the record.
fn find<'a>(fit: &'a LengthFit, of: &LengthSensitivity) -> Option<&'a ParameterEstimate> {
    fit.parameters.iter().find(|p| p.name == of.name && p.run == of.run)
}

/// Changes of the parameters in standard errors, one column for each variation.
fn weights(fit: &FitDocument) -> Option<Vec<Part>> {
    let reweighting = fit.weights.as_ref()?.as_ref()?;
    let mut table = Rows::over(reweighting.parameters.iter().enumerate());
    table.name("by weights", |(_, p)| with_run(&p.name, p.run.as_deref()));
    for v in &reweighting.variations {
        let title = match v.weight {
            Weight::NoiseHalved => format!("{} / 2", v.output),
            Weight::NoiseDoubled => format!("{} * 2", v.output),
            Weight::LeftOut => format!("without {}", v.output),
        };
        table.number(&title, |(k, _)| v.changes[*k].map_or("lost".into(), |c| format!("{c:+.2}")));
    }
    table.number("largest", |(k, _)| match reweighting.largest(*k) {
        largest if largest.is_finite() => Cell::warned(format!("{largest:.2}"), largest > MUCH),
        _ => Cell::warned("lost".into(), true),
    });
    let note =
        "changes in standard errors when the noise of an output counts for half or twice, or the output is left out";
    Some(vec![table.into(), Part::Note(note.into())])
}

pub(crate) fn figures(subject: &Subject) -> Vec<Figure> {
    let Some(fit) = subject.fit() else { return Vec::new() };
    let (Some(lengths), Some(confidence)) = (&fit.by_length, &fit.confidence) else { return Vec::new() };
    if lengths.len() < 2 {
        return Vec::new();
    }
    let time = subject.time();
    confidence.iter().take(DRAWN).enumerate().map(|(k, c)| course(k, c, lengths, &time)).collect()
}

fn course(k: usize, of: &LengthSensitivity, lengths: &[LengthFit], time: &str) -> Figure {
    let same = |p: &&ParameterEstimate| p.name == of.name && p.run == of.run;
    let found: Vec<Option<&ParameterEstimate>> = lengths.iter().map(|l| l.parameters.iter().find(same)).collect();
    let number = |of: fn(&ParameterEstimate) -> Option<f64>| -> Vec<f64> {
        found.iter().map(|p| p.and_then(of).unwrap_or(f64::NAN)).collect()
    };
    let (values, errors) = (number(|p| Some(p.value)), number(|p| p.standard_error));
    let unit = found.iter().flatten().find_map(|p| p.unit.clone());
    let edge = |sign: f64| values.iter().zip(&errors).map(|(v, e)| v + sign * 2.0 * e).collect::<Vec<f64>>();
    let marks = vec![
        Mark::between("± 2σ", Look::Other, Shape::Bars, edge(-1.0), edge(1.0)),
        Mark::dots("estimate", Look::Model, values.clone()),
    ];
    let doubt = Some(of.doubt).filter(|d| d.is_finite());
    let doubt = doubt.map_or(String::new(), |d| format!(": in doubt by {} %", digits(100.0 * d, 2)));
    Figure::new(
        format!("length-{}", k + 1),
        format!("{}{doubt}", with_run(&of.name, of.run.as_deref())),
        format!("length [{time}]"),
        lengths.iter().map(|l| l.length).collect(),
    )
    .in_group("lengths")
    .with(Panel::new(format!("{}{}", of.name, bracketed(unit.as_deref())), 130, marks))
    .half()
}
