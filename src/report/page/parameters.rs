//! The table of parameters: values, errors as numbers and as bars, where they began, and what is to be said about each.

use super::number::{shown, text};
use super::section::Section;
use super::subject::{Subject, called};
use fdm_estimate::{ParameterEstimate, Status};
use fdm_grammar::syntax::StatementKind;
use fdm_results::documents::{FitDocument, digits_by_error};
use maud::{Markup, html};

/// Correlations beyond this are named.
const CORRELATED: f64 = 0.9;
/// Standard errors beyond this part of a value are marked.
const LARGE: f64 = 0.2;

pub(super) fn section(subject: &Subject) -> Option<Section> {
    let parameters = subject.parameters();
    if parameters.is_empty() {
        return None;
    }
    let several = parameters.iter().any(|p| p.run.is_some());
    let partners = subject.fit().map_or(vec![Vec::new(); parameters.len()], partners);
    let content = html! {
        div.scroll {
            table.parameters {
                thead { tr {
                    th { "parameter" }
                    @if several { th { "run" } }
                    th.number { "value" }
                    th.number title="two standard errors, corrected for the colour of the residuals where that is known" { "± 2σ" }
                    th { "−100 %" span.zero { "0" } "+100 %" }
                    th.number title="one standard error as a part of the value" { "σ %" }
                    th.number title="the bound of Cramér and Rao for white residuals" { "Cramér–Rao σ" }
                    th.number { "start" }
                    th { "unit" }
                    th { "remarks" }
                } }
                tbody {
                    @for (k, p) in parameters.iter().enumerate() { (row(subject, p, &partners[k], several)) }
                }
            }
        }
        p.note { "Bars are two standard errors to either side, as parts of the value: a bar that reaches the left edge does not exclude zero." }
        @for direction in subject.fit().into_iter().flat_map(|fit| &fit.undetermined) {
            p.warning { "Not determined: " (direction.sentence) }
        }
    };
    Some(Section::new("parameters", "Parameters", content))
}

fn row(subject: &Subject, p: &ParameterEstimate, partners: &[String], several: bool) -> Markup {
    let (name, value, error) = (&p.name, p.value, p.error());
    let share = error.map(|e| e / value.abs()).filter(|s| s.is_finite());
    html! {
        tr {
            th scope="row" { code { (name) } @if let Some(doc) = doc(subject, name) { span.doc { (doc) } } }
            @if several { td { (p.run.as_deref().unwrap_or_default()) } }
            td.number { @if p.status == Status::Unvisited { "unknown" } @else { (value_with(value, error)) } }
            td.number { @if let Some(e) = error { (text(2.0 * e, 2)) } }
            td.bar { @if let Some(share) = share { (bar(share)) } }
            td.number.large[share.is_some_and(|s| s > LARGE)] { @if let Some(s) = share { (text(100.0 * s, 2)) } }
            td.number { @if p.standard_error.is_some() { (shown(p.standard_error, 3)) } }
            td.number { (shown(p.start, 4)) }
            td { (p.unit.as_deref().unwrap_or_default()) }
            td.remarks { (flags(p, partners)) }
        }
    }
}

/// A value with digits down to two of its standard error.
fn value_with(value: f64, error: Option<f64>) -> String {
    text(value, error.and_then(|e| digits_by_error(value, e, 4)).unwrap_or(5))
}

/// Two standard errors to either side, as parts of the value; the frame ends at zero and at twice the value.
fn bar(share: f64) -> Markup {
    let half = 120.0 * share.min(1.0);
    let place = |v: f64| format!("{v:.1}");
    html! {
        svg.interval viewBox="0 0 124 14" width="124" height="14" role="img" aria-label={ "two standard errors are " (text(200.0 * share, 2)) " percent" } {
            line.rail x1="2" x2="122" y1="7" y2="7" {}
            @let (from, to) = ((62.0 - half).max(2.0), (62.0 + half).min(122.0));
            line class={ "reach" @if share > 0.5 { " wide" } } x1=(place(from)) x2=(place(to.max(from + 0.5))) y1="7" y2="7" {}
            line.here x1="62" x2="62" y1="2" y2="12" {}
        }
    }
}

fn flags(p: &ParameterEstimate, partners: &[String]) -> Markup {
    let limit = |side| p.limit.map_or(String::new(), |l| format!(", with 95 % probability {side} {}", text(l, 3)));
    let status = match p.status {
        Status::Estimated => None,
        Status::AtLowerBound => Some(("flag", format!("at its lower bound {}{}", shown(p.lower, 4), limit("below")))),
        Status::AtUpperBound => Some(("flag", format!("at its upper bound {}{}", shown(p.upper, 4), limit("above")))),
        Status::NotDetermined => Some(("flag", "not determined by the data".to_string())),
        Status::Unvisited => Some(("flag", "no run visits it: not known".to_string())),
        other => Some(("quiet", other.to_string())),
    };
    html! {
        @if let Some((class, said)) = status { span class=(class) { (said) } }
        @for partner in partners { span.mild { (partner) } }
    }
}

/// For every parameter the others that it cannot be told from well.
fn partners(fit: &FitDocument) -> Vec<Vec<String>> {
    let (parameters, covered) = (&fit.parameters, &fit.correlations.parameters);
    let mut found = vec![Vec::new(); parameters.len()];
    for (i, row) in fit.correlations.values.iter().enumerate() {
        for (j, r) in row.iter().enumerate().filter(|(j, r)| i != *j && r.abs() > CORRELATED) {
            let other = covered.get(j).and_then(|k| parameters.get(*k));
            let own = covered.get(i).and_then(|k| found.get_mut(*k));
            if let (Some(list), Some(other)) = (own, other) {
                list.push(format!("with {} {}", called(&other.name, other.run.as_deref()), text(*r, 3)));
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
