//! How the iteration came to its end, and how the estimates settle with the length of the record.

use super::figure::{Figure, Look, Mark, Panel, Shape};
use super::number::{bracketed, shown, text};
use super::section::Section;
use super::subject::{Subject, called};
use fdm_estimate::{Iteration, LengthFit, LengthSensitivity, ParameterEstimate};
use maud::html;

/// Parameters whose course is drawn.
const DRAWN: usize = 24;

/// Both kinds.
pub(super) fn figures(subject: &Subject) -> Vec<Figure> {
    iteration(subject).into_iter().chain(courses(subject)).collect()
}

/// Cost and step, iteration by iteration.
fn iteration(subject: &Subject) -> Option<Figure> {
    let history = subject.history();
    if history.len() < 2 {
        return None;
    }
    let column = |of: fn(&Iteration) -> f64| history.iter().map(of).collect::<Vec<f64>>();
    let (cost, step) = (column(|h| h.cost), column(|h| h.step));
    let positive = |values: Vec<f64>| values.into_iter().map(|v| if v > 0.0 { v } else { f64::NAN }).collect();
    let panel = |label: &str, logarithmic: bool, look: Look, values: Vec<f64>| Panel {
        label: label.into(),
        height: 110,
        logarithmic,
        marks: vec![
            Mark::line(label, look, values.clone()),
            Mark { name: String::new(), look, shape: Shape::Dots, values, low: Vec::new() },
        ],
    };
    Some(Figure {
        id: "convergence-1".into(),
        group: "convergence".into(),
        caption: format!(
            "{} {} iterations",
            subject.fit().map_or("so far".to_string(), |fit| format!("{} after", fit.message)),
            subject.fit().map_or_else(|| history.last().map_or(0, |h| h.number), |fit| fit.iterations)
        ),
        label: "iteration".into(),
        logarithmic: false,
        at: column(|h| h.number as f64),
        panels: vec![
            panel("cost", false, Look::Model, cost),
            panel("size of the step", true, Look::Other, positive(step)),
        ],
        names: Vec::new(),
        half: false,
        samples: None,
    })
}

pub(super) fn section(subject: &Subject) -> Option<Section> {
    let (figure, history) = (iteration(subject)?, subject.history());
    let content = html! {
        (figure.markup())
        details {
            summary { "as a table" }
            div.scroll { table {
                thead { tr { th.number { "iteration" } th.number { "cost" } th.number { "change" } th.number { "step" } th.number { "damping" } th.number { "refused" } } }
                tbody { @for h in history { tr {
                    td.number { (h.number) } td.number { (shown(h.cost, 10)) } td.number { (shown(h.change, 3)) }
                    td.number { (shown(h.step, 3)) } td.number { (shown(h.damping, 3)) } td.number { (h.refused) }
                } } }
            } }
        }
    };
    Some(Section::new("convergence", "Convergence", content))
}

/// Estimates from the first part of the record to the whole.
pub(super) fn lengths(subject: &Subject) -> Option<Section> {
    let courses = courses(subject);
    let all = subject.fit().and_then(|fit| fit.confidence.as_ref()).map_or(0, Vec::len);
    if courses.is_empty() {
        return None;
    }
    let content = html! {
        p { "Every estimate from the first part of the records to the whole, with two standard errors; the parameters stand in the order of "
            "the confidence that they deserve." }
        div.pair { @for figure in &courses { (figure.markup()) } }
        @if all > courses.len() { p.note { (all - courses.len()) " more are in the result's JSON." } }
    };
    Some(Section::new("lengths", "By length of the record", content))
}

fn courses(subject: &Subject) -> Vec<Figure> {
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
        Mark {
            name: "estimate".into(),
            look: Look::Model,
            shape: Shape::Dots,
            values: values.clone(),
            low: Vec::new(),
        },
    ];
    let doubt = Some(of.doubt).filter(|d| d.is_finite());
    let doubt = doubt.map_or(String::new(), |d| format!(": in doubt by {} %", text(100.0 * d, 2)));
    Figure {
        id: format!("length-{}", k + 1),
        group: "lengths".into(),
        caption: format!("{}{doubt}", called(&of.name, of.run.as_deref())),
        label: format!("length [{time}]"),
        logarithmic: false,
        at: lengths.iter().map(|l| l.length).collect(),
        panels: vec![Panel {
            label: format!("{}{}", of.name, bracketed(unit.as_deref())),
            height: 130,
            logarithmic: false,
            marks,
        }],
        names: Vec::new(),
        half: true,
        samples: None,
    }
}
