//! The page of several results beside each other: criteria, parameters and their averages, predictions.

use super::document::{Head, frame};
use super::headline::judgement;
use super::number::shown;
use super::section::{Section, Trust, quoted};
use super::subject::called;
use crate::comparison::{Verdict, edge, nesting, value, verdict, weighted_by};
use fdm_results::comparison::{Averaged, Candidate, Comparison};
use fdm_results::documents::{digits_by_error, digits_of_end};
use maud::{Markup, html};

/// A page of a comparison.
pub fn comparison_page(comparison: &Comparison) -> String {
    let all = &comparison.candidates;
    let mut sections = vec![Section::new("criteria", "Criteria", criteria(comparison))];
    sections.push(Section::new("parameters", "Parameters", parameters(all)));
    if let Some(averaged) = &comparison.averaged {
        sections.push(Section::new("average", "Averaged over the models", average(all, averaged)));
    }
    if !comparison.predictions.is_empty() {
        sections.push(Section::new("predictions", "Validation data", predictions(comparison)));
    }
    let points: Vec<(String, &'static str)> = comparison
        .edges
        .iter()
        .map(|e| (edge(e), "predictions"))
        .chain(comparison.nestings.iter().map(|n| (nesting(n), "criteria")))
        .chain(
            all.iter()
                .filter_map(|c| Some((format!("{}: no criteria: {}", c.name, c.incomparable.as_ref()?), "criteria"))),
        )
        .collect();
    let Verdict { settled, sentence } = verdict(comparison);
    let trust = if settled { Trust::Good } else { Trust::Reserved };
    let names: Vec<&str> = all.iter().map(|c| c.name.as_str()).collect();
    let head = judgement((trust, sentence, points), None, &["predictions", "criteria"]);
    frame(&Head { kind: "comparison", name: &names.join(", "), doc: None, verdict: head }, &sections)
}

fn criteria(comparison: &Comparison) -> Markup {
    let coloured = comparison.inflation.is_some();
    let difference = |v: Option<f64>| v.map_or("–".into(), |v| format!("{v:+.1}").replace('-', "\u{2212}"));
    html! {
        div.scroll { table {
            thead { tr {
                th { "result" } th { "model" } th.number { "parameters" } th.number { "cost" } th.number { "AIC" } th.number { "BIC" }
                @if coloured { th.number { "coloured AIC" } th.number { "coloured BIC" } }
            } }
            tbody { @for c in &comparison.candidates { tr {
                th scope="row" { code { (c.name) } } td { (c.model) } td.number { (c.unknowns) } td.number { (shown(c.cost, 8)) }
                @let own = c.criteria.as_ref();
                td.number { (difference(own.map(|c| c.aic))) } td.number { (difference(own.map(|c| c.bic))) }
                @if coloured {
                    td.number { (difference(own.and_then(|c| c.coloured_aic))) } td.number { (difference(own.and_then(|c| c.coloured_bic))) }
                }
            } } }
        } }
        p.note { "Criteria are differences to the least. Coloured ones allow for the colour of the residuals." }
    }
}

fn parameters(all: &[Candidate]) -> Markup {
    let mut known: Vec<(&str, Option<&str>)> = Vec::new();
    for p in all.iter().flat_map(|c| &c.parameters) {
        let name = (p.name.as_str(), p.run.as_deref());
        if !known.contains(&name) {
            known.push(name);
        }
    }
    html! {
        div.scroll { table {
            thead { tr { th { "parameter" } @for c in all { th.number { (c.name) } } th { "unit" } } }
            tbody { @for (name, run) in &known { tr {
                @let own = |c: &Candidate| c.parameters.iter().find(|p| p.name == *name && p.run.as_deref() == *run).cloned();
                th scope="row" { code { (called(name, *run)) } }
                @for c in all { td.number { (own(c).map_or("–".into(), |p| value(&p).replace('-', "\u{2212}"))) } }
                td { (all.iter().find_map(own).and_then(|p| p.unit).unwrap_or_default()) }
            } } }
        } }
    }
}

fn average(all: &[Candidate], averaged: &Averaged) -> Markup {
    html! {
        p { "Models, " (weighted_by(averaged)) ": "
            @for (k, (c, w)) in all.iter().zip(&averaged.weights).enumerate() { @if k > 0 { ", " } code { (c.name) } " " (format!("{:.1} %", 100.0 * w)) } "." }
        div.scroll { table {
            thead { tr { th { "parameter" } th.number { "value" } th.number { "error" } th.number { "95 % interval" } th.number { "in models of" } th { "unit" } } }
            tbody { @for p in &averaged.parameters {
                @let digits = digits_by_error(p.value, p.error, 3).unwrap_or(4);
                @let end = |v: f64| digits_of_end(v, p.error).replace('-', "\u{2212}");
                tr {
                    th scope="row" { code { (called(&p.name, p.run.as_deref())) } }
                    td.number { (shown(p.value, digits)) } td.number { (shown(p.error, 3)) }
                    td.number { (end(p.interval[0])) " to " (end(p.interval[1])) }
                    td.number { (format!("{:.0} %", 100.0 * p.weight)) } td { (p.unit.as_deref().unwrap_or_default()) }
                }
            } }
        } }
        p.note { "Errors hold the scatter between models: these intervals know that the structure was chosen." }
    }
}

fn predictions(comparison: &Comparison) -> Markup {
    let first = &comparison.predictions[0];
    let of = |p: &fdm_results::comparison::Prediction, run: &str, name: &str| {
        p.outputs.iter().find(|o| o.run == run && o.name == name).and_then(|o| o.rms)
    };
    let averaged = comparison.averaged.as_ref().map_or(&[][..], |a| &a.outputs);
    html! {
        div.scroll { table {
            thead { tr {
                th { "run" } th { "output" } @for p in &comparison.predictions { th.number { "RMS " (p.name) } }
                @if !averaged.is_empty() { th.number { "RMS averaged" } th.number { "95 % band ±" } th.number { "within" } }
            } }
            tbody { @for o in &first.outputs { tr {
                td { (o.run) } th scope="row" { code { (o.name) } }
                @for p in &comparison.predictions { td.number { (shown(of(p, &o.run, &o.name), 4)) } }
                @if let Some(a) = averaged.iter().find(|a| a.run == o.run && a.name == o.name) {
                    td.number { (shown(a.rms, 4)) } td.number { (shown(a.band, 3)) } td.number { (a.within.map_or("–".into(), |w| format!("{:.1} %", 100.0 * w))) }
                } @else if !averaged.is_empty() { td {} td {} td {} }
            } } }
        } }
        @if !comparison.edges.is_empty() { ul { @for e in &comparison.edges { li { (quoted(&edge(e))) } } } }
    }
}
