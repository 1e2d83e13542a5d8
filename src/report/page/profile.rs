//! The page of profiles: the interval of each parameter by the cost beside that by its error, and the rise of the cost over it.

use super::document::{Head, frame};
use super::headline::judgement;
use super::number::shown;
use super::section::{Section, Trust};
use crate::profile::{Verdict, figure, remarks, told, verdict};
use fdm_results::documents::profile::{End, Profile};
use fdm_results::documents::{digits_by_error, digits_of_end};
use maud::{Markup, html};

/// A page of profiles of a model's parameters.
pub fn profile_page(model: &str, profiles: &[Profile]) -> String {
    let figures: Vec<_> = profiles.iter().enumerate().map(|(k, profile)| figure(k, profile)).collect();
    let sections = vec![
        Section::new("intervals", "Intervals", table(profiles)),
        Section::new(
            "profiles",
            "Rise of the cost",
            html! {
                p { "Where the cost lies on the parabola, the interval by the error is right. The limit is what chance explains in 95 of 100 records." }
                div.pair { @for figure in &figures { (figure.markup()) } }
            },
        ),
    ];
    let said = profiles.iter().flat_map(remarks);
    let points = said.map(|said| (said.trim_end().to_string(), "intervals")).collect();
    let Verdict { bounded, sentence } = verdict(profiles);
    let trust = if bounded { Trust::Good } else { Trust::Reserved };
    let verdict = judgement((trust, sentence, points), None, &["intervals"]);
    frame(&Head { kind: "profile likelihood", name: model, doc: None, verdict }, &sections)
}

fn table(profiles: &[Profile]) -> Markup {
    let reach = |p: &Profile, end: End| (end.value() - p.value).abs() / p.reach();
    html! {
        div.scroll { table {
            thead { tr {
                th { "parameter" } th.number { "value" } th.number { "error" } th.number { "95 % by error" } th.number { "95 % by cost" }
                th.number { "below" } th.number { "above" } th { "unit" }
            } }
            tbody { @for p in profiles {
                @let digits = if p.bound { 4 } else { digits_by_error(p.value, p.error, 3).unwrap_or(3) };
                @let signed = |text: String| text.replace('-', "\u{2212}");
                @let end = |v: f64| signed(digits_of_end(v, p.error));
                @let by_error = |text: String| if p.bound { "–".to_string() } else { text };
                tr {
                    th scope="row" { code { (p.name) } }
                    td.number { (shown(p.value, digits)) } td.number { (by_error(shown(p.error, 3))) }
                    td.number { (by_error(format!("{} to {}", end(p.value - p.reach()), end(p.value + p.reach())))) }
                    td.number { (signed(told(p, p.ends[0]))) " to " (signed(told(p, p.ends[1]))) }
                    td.number { (by_error(format!("{:.2}", reach(p, p.ends[0])))) } td.number { (by_error(format!("{:.2}", reach(p, p.ends[1])))) }
                    td { (p.unit.as_deref().unwrap_or_default()) }
                }
            } }
        } }
        p.note { "Below and above: how far the interval by the cost reaches, over that by the error." }
    }
}
