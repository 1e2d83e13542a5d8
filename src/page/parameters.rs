//! The table of parameters: values, errors as numbers and as bars, where they began, and what is to be said about each.

use super::document::Section;
use super::number::{shown, text};
use super::subject::{Subject, called, list};
use fdm_grammar::syntax::StatementKind;
use maud::{Markup, html};
use serde_json::Value;

/// Correlations beyond this are named.
const CORRELATED: f64 = 0.9;
/// Standard errors beyond this part of a value are marked.
const LARGE: f64 = 0.2;

pub(super) fn section(subject: &Subject) -> Option<Section> {
    let parameters = subject.list("parameters");
    if parameters.is_empty() {
        return None;
    }
    let several = parameters.iter().any(|p| p["run"].is_string());
    let partners = partners(&subject.result);
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
        @for direction in subject.list("undetermined") {
            p.warning { "Not determined: " (direction["sentence"].as_str().unwrap_or_default()) }
        }
    };
    Some(Section::new("parameters", "Parameters", content))
}

fn row(subject: &Subject, p: &Value, partners: &[String], several: bool) -> Markup {
    let value = p["value"].as_f64().unwrap_or(f64::NAN);
    let error = p["corrected_error"].as_f64().or(p["standard_error"].as_f64());
    let share = error.map(|e| e / value.abs()).filter(|s| s.is_finite());
    let name = p["name"].as_str().unwrap_or_default();
    html! {
        tr {
            th scope="row" { code { (name) } @if let Some(doc) = doc(subject, name) { span.doc { (doc) } } }
            @if several { td { (p["run"].as_str().unwrap_or_default()) } }
            td.number { (value_with(value, error)) }
            td.number { @if let Some(e) = error { (text(2.0 * e, 2)) } }
            td.bar { @if let Some(share) = share { (bar(share)) } }
            td.number.large[share.is_some_and(|s| s > LARGE)] { @if let Some(s) = share { (text(100.0 * s, 2)) } }
            td.number { @if p["standard_error"].is_number() { (shown(&p["standard_error"], 3)) } }
            td.number { (shown(&p["start"], 4)) }
            td { (p["unit"].as_str().unwrap_or_default()) }
            td.remarks { (flags(p, partners)) }
        }
    }
}

/// A value with digits down to two of its standard error.
fn value_with(value: f64, error: Option<f64>) -> String {
    let settled = error.filter(|e| *e > 0.0 && value != 0.0).map(|e| (value.abs() / e).log10().floor() + 3.0);
    text(value, settled.map_or(5, |s| s.clamp(4.0, 12.0) as usize))
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

fn flags(p: &Value, partners: &[String]) -> Markup {
    let bound = |name: &str| shown(&p[name], 4);
    let status = match p["status"].as_str().unwrap_or_default() {
        "estimated" => None,
        "at_lower_bound" => Some(("flag", format!("at its lower bound {}", bound("lower")))),
        "at_upper_bound" => Some(("flag", format!("at its upper bound {}", bound("upper")))),
        "not_determined" => Some(("flag", "not determined by the data".to_string())),
        other => Some(("quiet", other.replace('_', " "))),
    };
    html! {
        @if let Some((class, said)) = status { span class=(class) { (said) } }
        @for partner in partners { span.mild { (partner) } }
    }
}

/// For every parameter the others that it cannot be told from well.
fn partners(result: &Value) -> Vec<Vec<String>> {
    let parameters = list(&result["parameters"]);
    let mut found = vec![Vec::new(); parameters.len()];
    let covered: Vec<usize> =
        list(&result["correlations"]["parameters"]).iter().filter_map(|k| Some(k.as_u64()? as usize)).collect();
    for (i, row) in list(&result["correlations"]["values"]).iter().enumerate() {
        for (j, r) in list(row).iter().enumerate() {
            let Some(r) = r.as_f64().filter(|r| i != j && r.abs() > CORRELATED) else { continue };
            let other = covered.get(j).and_then(|k| parameters.get(*k));
            let own = covered.get(i).and_then(|k| found.get_mut(*k));
            if let (Some(list), Some(other)) = (own, other) {
                list.push(format!("with {} {}", called(other), text(r, 3)));
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
