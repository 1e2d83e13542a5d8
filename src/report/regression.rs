//! Equation error: how well each measured rate is met, by what, the structures that a search found, and how the estimates depend on the data
//! that were used.

use super::section::{Part, Rows, Section, Trust, Verdict, capital};
use crate::page::figure::{Figure, Look, Mark, Panel, Shape};
use crate::page::number::bracketed;
use crate::page::subject::Subject;
use crate::text;
use fdm_estimate::equation_error::{
    Chosen, Component, Dependence, EquationErrorFit, EquationQuality, Regressed, Structure,
};
use fdm_results::documents::{KeptParameter, RegressionDocument, digits, with_run};
use std::fmt::Display;

/// A rate of which less is explained is named.
const LITTLE: f64 = 0.5;
/// Parameters whose dependence is drawn.
const DRAWN: usize = 24;

/// Tables of all regressions, then what was left out and why.
pub fn regression_table(found: &RegressionDocument) -> String {
    text::sections(&[regressions(found)])
}

/// The search for the structure of every measured rate.
pub fn structure_table(structures: &[Structure]) -> String {
    let of = |s: &Structure| {
        let explained = format!("{}: R^2 {}", s.equation, digits(s.found.r_squared, 5));
        let mut steps = Rows::over(&s.found.steps);
        steps.words("step", |step| if step.entered { "in" } else { "out" });
        steps.words("candidate", |step| step.candidate.clone());
        steps.number("partial F", |step| digits(step.partial_f, 3));
        steps.number("R^2", |step| digits(step.r_squared, 5));
        steps.number("PSE", |step| digits(step.pse, 4));
        steps.number("PRESS", |step| digits(step.press, 4));
        let terms =
            s.found.terms.iter().map(|t| {
                [t.candidate.clone(), digits(t.value, 6), digits(t.standard_error, 3), digits(t.partial_f, 3)]
            });
        let constant = s.found.constant.map(|v| ["constant".into(), digits(v, 6), String::new(), String::new()]);
        let mut table = Rows::over(terms.chain(constant));
        table.words("term", |cells| cells[0].clone());
        for (k, title) in [(1, "value"), (2, "std error"), (3, "partial F")] {
            table.number(title, |cells| cells[k].clone());
        }
        let found = match s.found.steps.is_empty() {
            true => vec![Part::Gap, Part::Line("no candidate explains enough of it".into())],
            false => vec![steps.into(), table.into()],
        };
        std::iter::once(Part::Line(explained)).chain(found).chain([Part::Gap]).collect::<Vec<_>>()
    };
    text::sections(&[Section::new("structures", "Structures").with_all(structures.iter().flat_map(of))])
}

/// Parameters over the highest frequency or the part of the record that was used; `at` heads the first column.
pub fn dependence_table(at: &str, rows: &[Dependence]) -> String {
    text::sections(&[Section::new("dependence", "Dependence on the data").with_all(depending(at, rows))])
}

fn depending(at: &str, rows: &[Dependence]) -> Vec<Part> {
    let Some(most) = rows.iter().max_by_key(|r| r.parameters.len()) else { return Vec::new() };
    let mut table = Rows::over(rows);
    table.words(at, |row| digits(row.at, 3));
    for p in &most.parameters {
        table.span(&name(p), |row| {
            let own = row.parameters.iter().find(|own| own.name == p.name && own.run == p.run);
            own.map_or(String::new(), |p| format!("{} +- {}", digits(p.value, 4), digits(p.standard_error, 2)))
        });
    }
    let reasons = rows.iter().filter_map(|row| Some(format!("{}: {}", digits(row.at, 3), row.reason.as_ref()?)));
    std::iter::once(table.into()).chain(reasons.map(Part::Line)).collect()
}

fn name(p: &Regressed) -> String {
    with_run(&p.name, p.run.as_deref())
}

/// What can be said in a sentence, and what speaks against the estimates.
pub(crate) fn verdict(found: &RegressionDocument) -> Verdict {
    let refused = left_out(&found.refused).map(|said| capital(&said));
    let equations: Vec<&EquationQuality> = found.fits.iter().flat_map(|f| &f.equations).collect();
    let Some(worst) = equations.iter().min_by(|a, b| a.r_squared.total_cmp(&b.r_squared)) else {
        return Verdict::new(Trust::Bad, "No equation is a regression.").with_points(refused, "regressions");
    };
    let many = if equations.len() == 1 { "The regression" } else { "Of the regressions the worst" };
    let percent = |e: &EquationQuality, count: usize| digits(100.0 * e.r_squared, count);
    let little = equations.iter().filter(|e| e.r_squared < LITTLE);
    let little = little.map(|e| format!("Little is explained of `{}`: {} %", e.equation, percent(e, 3)));
    let of_fit = |fit: &EquationErrorFit| {
        let together = match &fit.reason {
            Chosen::Collinear(directions) => &directions[..],
            _ => &[],
        };
        let together = together.iter().map(|names| {
            format!("The data hardly tell apart `{}`; they share what is known of them", names.join("`, `"))
        });
        together.chain(unseen(fit)).collect::<Vec<_>>()
    };
    let kept = not_estimated(&found.kept).map(|said| capital(&said));
    let mut verdict =
        Verdict::new(Trust::Good, format!("{many} explains {} % of {}.", percent(worst, 4), worst.equation))
            .with_points(little.chain(found.fits.iter().flat_map(of_fit)).chain(refused), "regressions")
            .with_points(kept, "parameters");
    if !verdict.points.is_empty() {
        verdict.trust = Trust::Reserved;
    }
    verdict
}

/// Every regression with its parameters, what its components explain, and what was left out.
fn regressions(found: &RegressionDocument) -> Section {
    let mut noise = Rows::over(&found.noise);
    noise.name("noise of", |n| n.state.clone());
    noise.words("run", |n| n.run.clone());
    noise.span("deviation", |n| digits(n.deviation, 3));
    noise.span("cut-off", |n| digits(n.cutoff, 3));
    let noise = (!found.noise.is_empty()).then(|| [noise.into(), Part::Gap]);
    Section::new("regressions", "Regressions")
        .with_all(found.fits.iter().flat_map(fitted))
        .with_all(noise.into_iter().flatten())
        .lines(left_out(&found.refused).chain(not_estimated(&found.kept)))
}

/// Equations that are no regressions.
pub(crate) fn left_out(refused: &[impl Display]) -> impl Iterator<Item = String> {
    refused.iter().map(|refusal| format!("left out: {refusal}"))
}

/// Free parameters that none of the regressions gives.
pub(crate) fn not_estimated(names: &[String]) -> Option<String> {
    let list = names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    (!names.is_empty()).then(|| format!("not estimated, so that their values stay: {list}"))
}

/// What the data say nothing of.
fn unseen(fit: &EquationErrorFit) -> impl Iterator<Item = String> {
    fit.not_identifiable.iter().map(|name| {
        format!("`{name}` is multiplied by nothing in these data (a constant has no part above zero frequency)")
    })
}

fn fitted(fit: &EquationErrorFit) -> Vec<Part> {
    let explained = fit.equations.iter().map(|e| match e.rows {
        0 => format!("{}: no parameter has an influence", e.equation),
        rows => {
            let (r_squared, rms) = (digits(e.r_squared, 5), digits(e.rms, 4));
            format!("{}: R^2 {r_squared}, residual {rms} over {rows} rows", e.equation)
        }
    });
    let mut parts: Vec<Part> = explained.map(Part::Line).chain([Part::Gap]).collect();
    let all: Vec<&Regressed> = fit.parameters.iter().chain(&fit.biases).collect();
    if !all.is_empty() {
        parts.push(parameters(&all).into());
    }
    if fit.components.len() > 1 {
        parts.push(Part::folded("principal components", vec![components(fit, &all).into()]));
    }
    parts.extend(reason(fit).into_iter().chain(unseen(fit)).map(Part::Line).chain([Part::Gap]));
    parts
}

/// What each parameter multiplies, and what it is worth.
fn parameters<'a>(all: &[&'a Regressed]) -> Rows<&'a Regressed> {
    let mut table = Rows::over(all.iter().copied());
    table.name("parameter", |p| name(p));
    table.number("value", |p| digits(p.value, 6));
    table.number("std error", |p| digits(p.standard_error, 3));
    if all.iter().any(|p| p.coloured_error.is_some()) {
        table.number("coloured", |p| p.coloured_error.map_or(String::new(), |c| digits(c, 3)));
    }
    table.number("%", |p| {
        let error = p.coloured_error.map_or(p.standard_error, |c| c.max(p.standard_error));
        // of an exact zero there is no part
        let part = Some(100.0 * error / p.value.abs()).filter(|r| r.is_finite());
        part.map_or(String::new(), |r| digits(r, 2))
    });
    table
        .number("partial F", |p| digits(p.partial_f, 3))
        .hint("the square of value over error: how much worse the regression is without the term");
    table.number("part of rate", |p| digits(p.significance, 2)).hint("the term's mean size over the rate's");
    table.unit(|p| p.unit.clone());
    table.words("multiplies", |p| p.columns.join("; "));
    table
}

/// What so many principal components say.
fn components<'a>(fit: &'a EquationErrorFit, all: &[&Regressed]) -> Rows<&'a Component> {
    let mut table = Rows::over(&fit.components);
    table.words("components", |c| format!("{}{}", c.count, if c.count == fit.chosen { "*" } else { "" }));
    table.number("singular value", |c| digits(c.singular_value, 3));
    table.number("R^2", |c| digits(c.r_squared, 5));
    table.number("F", |c| digits(c.total_f, 3));
    for (j, p) in all.iter().enumerate() {
        table.span(&format!("{} +- error (F)", name(p)), |c| {
            let (value, error, f) =
                (digits(c.values[j], 4), digits(c.standard_errors[j], 2), digits(c.partial_f[j], 2));
            format!("{value} +- {error} ({f})")
        });
    }
    table
}

fn reason(fit: &EquationErrorFit) -> Option<String> {
    match &fit.reason {
        Chosen::All => None,
        Chosen::Asked => Some(format!("{} components, as asked for", fit.chosen)),
        Chosen::Collinear(directions) => {
            let together = directions.iter().map(|names| names.join(" with ")).collect::<Vec<_>>().join("; ");
            Some(format!(
                "{} of {} components: the data hardly tell apart {together}; the other directions explain next to nothing and \
                 would cost larger errors",
                fit.chosen,
                fit.parameters.len()
            ))
        }
    }
}

/// Of regressions, where there are any.
pub(crate) fn sections(subject: &Subject) -> Vec<Section> {
    let Some(found) = subject.regression().filter(|found| !found.fits.is_empty()) else { return Vec::new() };
    let note = "Noise of measured states enters the columns of a regression, which biases its estimates towards zero; output error does not suffer from that.";
    let regressions = regressions(found).note(note).with(Part::Pair(component_figures(found)));
    let drawn = dependence_figures(found, &subject.frequency());
    let tables = [("highest", &found.by_cutoff), ("part", &found.by_length)];
    let tables = tables.into_iter().flat_map(|(at, rows)| depending(at, rows.as_deref().unwrap_or_default())).collect();
    let said = "Every estimate, with two standard errors, over the highest frequency and over the part of the records that is used.";
    let dependence = (!drawn.is_empty()).then(|| {
        Section::new("dependence", "Dependence on the data")
            .line(said)
            .with(Part::Pair(drawn))
            .with(Part::folded("as a table", tables))
    });
    std::iter::once(regressions).chain(dependence).collect()
}

/// All of their figures.
pub(crate) fn figures(subject: &Subject) -> Vec<Figure> {
    let Some(found) = subject.regression() else { return Vec::new() };
    component_figures(found).into_iter().chain(dependence_figures(found, &subject.frequency())).collect()
}

/// What the principal components explain, one after the other.
fn component_figures(found: &RegressionDocument) -> Vec<Figure> {
    let one = |(k, fit): (usize, &EquationErrorFit)| {
        let all = &fit.components;
        let column = |of: fn(&Component) -> f64| all.iter().map(of).collect::<Vec<f64>>();
        let equations: Vec<&str> = fit.equations.iter().map(|e| e.equation.as_str()).collect();
        let panel = |label: &str, logarithmic: bool, look: Look, values: Vec<f64>| {
            Panel::new(label, 90, vec![Mark::line("", look, values.clone()), Mark::dots(label, look, values)])
                .scaled(logarithmic)
        };
        (all.len() > 1).then(|| {
            Figure::new(
                format!("components-{}", k + 1),
                format!("principal components of {}: {} were taken", equations.join(", "), fit.chosen),
                "components",
                column(|c| c.count as f64),
            )
            .named(all.iter().map(|c| format!("{} of {}", c.count, all.len())).collect())
            .with(panel("R²", false, Look::Model, column(|c| c.r_squared)))
            .with(panel("total error", true, Look::Residual, column(|c| c.total_error)))
            .half()
        })
    };
    found.fits.iter().enumerate().filter_map(one).collect()
}

/// Every parameter over the highest frequency, and over the part of the records.
fn dependence_figures(found: &RegressionDocument, unit: &str) -> Vec<Figure> {
    let kinds = [
        (&found.by_cutoff, "cutoff", format!("highest frequency [{unit}]")),
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
    Some(
        Figure::new(id, with_run(&of.name, of.run.as_deref()), label, rows.iter().map(|row| row.at).collect())
            .with(Panel::new(
                format!("{}{}", of.name, bracketed(of.unit.as_deref())),
                130,
                vec![
                    Mark::between("± 2σ", Look::Other, Shape::Bars, edge(-1.0), edge(1.0)),
                    Mark::dots("estimate", Look::Model, values),
                ],
            ))
            .half(),
    )
}
