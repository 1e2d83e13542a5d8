//! The parameters: values, errors as numbers and as bars, intervals, what is to be said about each, and where it began.

use super::section::{Cell, Part, Rows, Section};
use crate::page::number::text as number;
use crate::page::subject::Subject;
use fdm_estimate::{ParameterEstimate, Status};
use fdm_grammar::syntax::StatementKind;
use fdm_results::documents::{
    CORRELATED, FitDocument, RELIABLE, digits, digits_by_error, limit_within_bounds, with_run,
};
use maud::{Markup, html};

/// One row for each parameter, per-run ones once for every run; `intervals` adds the interval that holds the true value in 95 of 100 cases.
pub(crate) fn table(parameters: &[ParameterEstimate], intervals: bool) -> Rows<(usize, &ParameterEstimate)> {
    let mut table = Rows::over(parameters.iter().enumerate());
    table.name("parameter", |(_, p)| p.name.clone());
    table.runs(|(_, p)| p.run.as_deref());
    table.number("value", |(_, p)| value(p));
    let bound = "the bound of Cramér and Rao for white residuals";
    match parameters.iter().any(|p| p.corrected_error.is_some()) {
        true => {
            table.number("Cramer-Rao", |(_, p)| error(p.standard_error)).hint(bound);
            table
                .number("corrected", |(_, p)| error(p.corrected_error))
                .hint("the standard error, corrected for the colour of the residuals");
        }
        false => _ = table.number("standard error", |(_, p)| error(p.standard_error)).hint(bound),
    }
    table.number("%", |(_, p)| percent(p)).hint("one standard error as a part of the value");
    if intervals {
        table.span("95 % interval", |(_, p)| interval(p));
    }
    table.unit(|(_, p)| p.unit.clone());
    table.words("status", |(_, p)| status(p));
    table
}

/// The parameters of a result, of work that goes on as far as they are known.
pub(crate) fn section(subject: &Subject) -> Option<Section> {
    let parameters = subject.parameters();
    let mut rows = table(&parameters, true);
    rows.words("−100 %    0    +100 %", |(_, p)| {
        let share = p.error().map(|e| e / p.value.abs()).filter(|s| s.is_finite());
        Cell::drawn(share.map(bar))
    });
    // regressions begin nowhere
    if parameters.iter().any(|p| p.start.is_some()) {
        rows.number("start", |(_, p)| p.start.map_or("-".into(), |v| digits(v, 4)));
    }
    let partners = subject.fit().map_or(Vec::new(), partners);
    rows.words("correlated with", |(k, _)| partners.get(*k).map_or(String::new(), |all| all.join("; ")));
    let mut table = rows.table();
    table.class = "parameters";
    for (cell, p) in table.columns.first_mut().into_iter().flat_map(|c| &mut c.cells).zip(&parameters) {
        cell.markup = doc(subject, &p.name).map(|doc| html! { span.doc { (doc) } });
    }
    let note = "Bars are two standard errors to either side, as parts of the value: a bar that reaches the left edge does not exclude zero.";
    let undetermined = subject.fit().into_iter().flat_map(|fit| &fit.undetermined);
    let deviations = subject.fit().and_then(|fit| fit.deviations.as_ref()).filter(|all| !all.is_empty());
    (!parameters.is_empty()).then(|| {
        Section::new("parameters", "Parameters")
            .with(table)
            .note(note)
            .with_all(undetermined.map(|direction| Part::Warning(format!("Not determined: {}", direction.sentence))))
            .with_all(deviations.map(|all| self::table(all, true).below("Measurement noise:")))
    })
}

fn error(error: Option<f64>) -> String {
    error.map_or(String::new(), |s| digits(s, 3))
}

fn value(p: &ParameterEstimate) -> String {
    if p.status == Status::Unvisited {
        return "unknown".into();
    }
    digits(p.value, p.error().and_then(|s| digits_by_error(p.value, s, 3)).unwrap_or(5))
}

/// Of the error to be trusted.
fn percent(p: &ParameterEstimate) -> Cell {
    let Some(error) = p.error().filter(|_| p.value != 0.0) else { return Cell::default() };
    let part = error / p.value.abs();
    Cell::warned(if part >= 10.0 { ">1000".into() } else { digits(100.0 * part, 2) }, part > RELIABLE)
}

fn interval(p: &ParameterEstimate) -> String {
    let at_bound = matches!(p.status, Status::AtLowerBound | Status::AtUpperBound);
    let Some([low, high]) = p.interval().filter(|_| !at_bound || limit_within_bounds(p).is_some()) else {
        return String::new();
    };
    let error = p.error().unwrap_or(high - low);
    let shown = |v: f64| digits(v, digits_by_error(v, error, 2).unwrap_or(5));
    format!("{} to {}", shown(low), shown(high))
}

fn status(p: &ParameterEstimate) -> Cell {
    let bound = |b: Option<f64>| b.map_or(String::new(), |b| digits(b, 4));
    let limit =
        |sign: &str, limit: Option<f64>| limit.map_or(String::new(), |l| format!(", 95 % {sign} {}", digits(l, 3)));
    let said = match p.status {
        Status::Estimated => String::new(),
        Status::AtLowerBound => format!("at its lower bound {}{}", bound(p.lower), limit("<", limit_within_bounds(p))),
        Status::AtUpperBound => format!("at its upper bound {}{}", bound(p.upper), limit(">", limit_within_bounds(p))),
        Status::NotDetermined => "not determined".into(),
        Status::Unvisited => "no run visits it".into(),
        Status::Fixed => "fixed".into(),
        Status::Derived => "derived".into(),
        Status::Tied => "tied".into(),
        Status::NotEstimated => "not estimated".into(),
    };
    let against = [Status::AtLowerBound, Status::AtUpperBound, Status::NotDetermined, Status::Unvisited];
    Cell::coloured(said, against.contains(&p.status))
}

/// Two standard errors to either side, as parts of the value; the frame ends at zero and at twice the value.
fn bar(share: f64) -> Markup {
    let half = 120.0 * share.min(1.0);
    let place = |v: f64| format!("{v:.1}");
    html! {
        svg.interval viewBox="0 0 124 14" width="124" height="14" role="img" aria-label={ "two standard errors are " (digits(200.0 * share, 2)) " percent" } {
            line.rail x1="2" x2="122" y1="7" y2="7" {}
            @let (from, to) = ((62.0 - half).max(2.0), (62.0 + half).min(122.0));
            line class={ "reach" @if share > 0.5 { " wide" } } x1=(place(from)) x2=(place(to.max(from + 0.5))) y1="7" y2="7" {}
            line.here x1="62" x2="62" y1="2" y2="12" {}
        }
    }
}

/// For every parameter the others that the data hardly separate from it.
fn partners(fit: &FitDocument) -> Vec<Vec<String>> {
    let (parameters, covered) = (&fit.parameters, &fit.correlations.parameters);
    let mut found = vec![Vec::new(); parameters.len()];
    for (i, row) in fit.correlations.values.iter().enumerate() {
        for (j, r) in row.iter().enumerate().filter(|(j, r)| i != *j && r.abs() > CORRELATED) {
            let other = covered.get(j).and_then(|k| parameters.get(*k));
            let own = covered.get(i).and_then(|k| found.get_mut(*k));
            if let (Some(list), Some(other)) = (own, other) {
                list.push(format!("{} {}", with_run(&other.name, other.run.as_deref()), number(*r, 3)));
            }
        }
    }
    found
}

/// What the model's text says about a parameter or a state.
fn doc<'a>(subject: &'a Subject, name: &str) -> Option<&'a str> {
    let name = name.strip_suffix("(0)").unwrap_or(name);
    let declared = subject.tree.as_ref()?.statements.iter().filter_map(|s| match &s.kind {
        StatementKind::Declare(_, list) => Some(list),
        _ => None,
    });
    declared.flatten().find(|d| d.name.text == name)?.doc.as_ref().map(|d| d.text.as_str())
}
