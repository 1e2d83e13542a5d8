//! Equation error: how well each measured rate is met, by what, and how the estimates depend on the data that were used.

use super::figure::{Figure, Look, Mark, Panel, Shape};
use super::number::{bracketed, shown, text};
use super::subject::{Subject, called};
use crate::section::{Point, Section, Trust, Verdict};
use fdm_estimate::equation_error::{Chosen, Component, Dependence, EquationErrorFit, EquationQuality, Regressed};
use fdm_results::documents::{KeptParameter, RegressionDocument};
use maud::{Markup, html};

/// A rate of which less is explained is named.
const LITTLE: f64 = 0.5;
/// Parameters whose dependence is drawn.
const DRAWN: usize = 24;

/// What can be said in a sentence, and what speaks against the estimates.
pub(crate) fn verdict(found: &RegressionDocument) -> Verdict {
    let equations: Vec<&EquationQuality> = found.fits.iter().flat_map(|f| &f.equations).collect();
    let Some(worst) = equations.iter().min_by(|a, b| a.r_squared.total_cmp(&b.r_squared)) else {
        return Verdict::new(Trust::Bad, "No equation is a regression.")
            .with_points(refusals(found).map(|(said, _)| said), "regressions");
    };
    let many = if equations.len() == 1 { "The regression" } else { "Of the regressions the worst" };
    let sentence = format!("{many} explains {} % of {}.", text(100.0 * worst.r_squared, 4), worst.equation);
    let mut points: Vec<(String, &'static str)> = Vec::new();
    let little = equations.iter().filter(|e| e.r_squared < LITTLE);
    points.extend(little.map(|e| {
        let said = format!("Little is explained of `{}`: {} %", e.equation, text(100.0 * e.r_squared, 3));
        (said, "regressions")
    }));
    for fit in &found.fits {
        if let Chosen::Collinear(directions) = &fit.reason {
            points.extend(directions.iter().map(|names| {
                let names = names.join("`, `");
                (format!("The data hardly tell apart `{names}`; they share what is known of them"), "regressions")
            }));
        }
        let unseen = fit.not_identifiable.iter();
        points.extend(unseen.map(|u| (format!("`{u}` is multiplied by nothing in these data"), "regressions")));
    }
    points.extend(refusals(found));
    if !found.kept.is_empty() {
        let kept = found.kept.join("`, `");
        points.push((format!("Not estimated, so that their values stay: `{kept}`"), "parameters"));
    }
    let trust = if points.is_empty() { Trust::Good } else { Trust::Reserved };
    Verdict {
        trust,
        sentence,
        facts: None,
        points: points.into_iter().map(|(sentence, anchor)| Point { sentence, anchor }).collect(),
    }
}

fn refusals(found: &RegressionDocument) -> impl Iterator<Item = (String, &'static str)> {
    found.refused.iter().map(|r| (format!("Left out: {}", r.reason), "regressions"))
}

pub(crate) fn sections(subject: &Subject) -> Vec<Section> {
    let Some(found) = subject.regression().filter(|found| !found.fits.is_empty()) else { return Vec::new() };
    let content = html! {
        div.scroll { table {
            thead { tr { th { "rate" } th.number { "R²" } th.number { "RMS of the residual" } th.number { "rows" } } }
            tbody { @for e in found.fits.iter().flat_map(|f| &f.equations) { tr {
                th scope="row" { code { (e.equation) } }
                td.number { (shown(e.r_squared, 5)) } td.number { (shown(e.rms, 4)) } td.number { (e.rows) }
            } } }
        } }
        @for fit in &found.fits { (terms(fit)) }
        p.note {
            "A partial F is the square of value over error: how much worse the regression is without the term. The part of the rate is the term's mean size over the rate's. "
            "Noise of measured states enters the columns of a regression, which draws its estimates towards zero; output error does not suffer from that."
        }
        @for figure in components(found) { (figure.markup()) }
    };
    let mut sections = vec![Section::drawn("regressions", "Regressions", content)];
    let depend = dependence(subject, found);
    if !depend.is_empty() {
        sections.push(Section::drawn(
            "dependence",
            "Dependence on the data",
            html! {
                p { "Every estimate, with two standard errors, over the highest frequency and over the part of the records that is used." }
                div.pair { @for figure in &depend { (figure.markup()) } }
            },
        ));
    }
    sections
}

/// What each parameter of a regression multiplies, and what it is worth.
fn terms(fit: &EquationErrorFit) -> Markup {
    html! {
        div.scroll { table {
            thead { tr { th { "parameter" } th { "multiplies" } th.number { "value" } th.number { "σ" } th.number { "coloured σ" } th.number { "partial F" } th.number { "part of the rate" } } }
            tbody { @for p in &fit.parameters { tr {
                th scope="row" { code { (called(&p.name, p.run.as_deref())) } }
                td { (p.columns.join("; ")) }
                td.number { (shown(p.value, 5)) } td.number { (shown(p.standard_error, 3)) } td.number { (shown(p.coloured_error, 3)) }
                td.number { (shown(p.partial_f, 3)) } td.number { (shown(p.significance, 2)) }
            } } }
        } }
    }
}

/// All of them.
pub(crate) fn figures(subject: &Subject) -> Vec<Figure> {
    let Some(found) = subject.regression() else { return Vec::new() };
    components(found).into_iter().chain(dependence(subject, found)).collect()
}

/// What the principal components explain, one after the other.
fn components(found: &RegressionDocument) -> Vec<Figure> {
    let one = |(k, fit): (usize, &EquationErrorFit)| {
        let all = &fit.components;
        let column = |of: fn(&Component) -> f64| all.iter().map(of).collect::<Vec<f64>>();
        let equations: Vec<&str> = fit.equations.iter().map(|e| e.equation.as_str()).collect();
        let panel = |label: &str, logarithmic: bool, look: Look, values: Vec<f64>| Panel {
            label: label.into(),
            height: 90,
            logarithmic,
            marks: vec![Mark::line("", look, values.clone()), Mark::dots(label, look, values)],
        };
        (all.len() > 1).then(|| Figure {
            id: format!("components-{}", k + 1),
            group: format!("components-{}", k + 1),
            caption: format!("principal components of {}: {} were taken", equations.join(", "), fit.chosen),
            label: "components".into(),
            logarithmic: false,
            at: column(|c| c.count as f64),
            panels: vec![
                panel("R²", false, Look::Model, column(|c| c.r_squared)),
                panel("total error", true, Look::Residual, column(|c| c.total_error)),
            ],
            names: Vec::new(),
            half: false,
            samples: None,
        })
    };
    found.fits.iter().enumerate().filter_map(one).collect()
}

/// Every parameter over the highest frequency, and over the part of the records.
fn dependence(subject: &Subject, found: &RegressionDocument) -> Vec<Figure> {
    let kinds = [
        (&found.by_cutoff, "cutoff", format!("highest frequency [{}]", subject.frequency())),
        (&found.by_length, "part", "part of the records".to_string()),
    ];
    let both = |(k, p): (usize, &KeptParameter)| {
        let drawn =
            kinds.iter().filter_map(|(rows, id, label)| course(rows.as_ref()?, p, format!("{id}-{}", k + 1), label));
        drawn.collect::<Vec<_>>()
    };
    found.parameters.iter().take(DRAWN).enumerate().flat_map(both).collect()
}

fn course(rows: &[Dependence], of: &KeptParameter, id: String, label: &str) -> Option<Figure> {
    let same = |p: &&Regressed| p.name == of.name && p.run == of.run;
    let found: Vec<Option<&Regressed>> = rows.iter().map(|row| row.parameters.iter().find(same)).collect();
    let column = |of: fn(&Regressed) -> Option<f64>| -> Vec<f64> {
        found.iter().map(|p| p.and_then(of).unwrap_or(f64::NAN)).collect()
    };
    let (values, errors) = (column(|p| Some(p.value)), column(|p| Some(p.standard_error)));
    let coloured = column(|p| p.coloured_error);
    if values.iter().filter(|v| v.is_finite()).count() < 2 {
        return None;
    }
    let error = |k: usize| if coloured[k].is_finite() { coloured[k] } else { errors[k] };
    let edge = |sign: f64| values.iter().enumerate().map(|(k, v)| v + sign * 2.0 * error(k)).collect::<Vec<f64>>();
    Some(Figure {
        group: id.clone(),
        id,
        caption: called(&of.name, of.run.as_deref()),
        label: label.into(),
        logarithmic: false,
        at: rows.iter().map(|row| row.at).collect(),
        panels: vec![Panel {
            label: format!("{}{}", of.name, bracketed(of.unit.as_deref())),
            height: 130,
            logarithmic: false,
            marks: vec![
                Mark::between("± 2σ", Look::Other, Shape::Bars, edge(-1.0), edge(1.0)),
                Mark::dots("estimate", Look::Model, values),
            ],
        }],
        names: Vec::new(),
        half: true,
        samples: None,
    })
}
