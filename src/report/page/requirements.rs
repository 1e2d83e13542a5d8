//! Requirements of the model as it was found: a line of each interval beside what is wanted, and the probability that it holds.

use super::section::Section;
use super::subject::Subject;
use crate::margins::{REQUIREMENT_TITLES, requirement_cells};
use fdm_results::documents::requirement::{Assessment, By};
use maud::{Markup, html};

/// Size of the line of an interval.
const WIDTH: f64 = 160.0;
const HEIGHT: f64 = 16.0;

pub(super) fn section(subject: &Subject) -> Option<Section> {
    let requirements = subject.fit().map_or(&[][..], |fit| &fit.requirements);
    if requirements.is_empty() {
        return None;
    }
    let drawn = requirements.iter().any(|r| r.by == Some(By::Draws));
    let content = html! {
        div.scroll { table {
            thead { tr {
                @for (k, title) in REQUIREMENT_TITLES.iter().enumerate() {
                    @if [1, 2, 4].contains(&k) { th.number { (title) } } @else { th { (title) } }
                }
                th { "interval and limits" }
            } }
            tbody { @for r in requirements { tr title=(r.expression) {
                @for (k, cell) in requirement_cells(r).into_iter().enumerate() {
                    @if [1, 2, 4].contains(&k) { td.number { (cell) } } @else { td { (cell) } }
                }
                td { @if let Some(line) = line(r) { (line) } }
            } } }
        } }
        @for r in requirements {
            @if let Some(why) = &r.reason { p { (r.name) " has no value: " (why) "." } }
        }
        p.note {
            "Intervals hold the true value in 95 of 100 cases, by the covariance of the parameters."
            @if drawn { " Where a requirement is not linear in them, interval and probability come from draws." }
        }
    };
    Some(Section::new("requirements", "Requirements", content))
}

/// The interval as a line, the value as a point, the limits as strokes.
fn line(r: &Assessment) -> Option<Markup> {
    let (value, [low, high]) = (r.value?, r.interval?);
    let all = [low, high, value].into_iter().chain(r.lower).chain(r.upper);
    let least = all.clone().fold(f64::INFINITY, f64::min);
    let most = all.fold(f64::NEG_INFINITY, f64::max);
    let range = most - least;
    if !(range > 0.0 && range.is_finite()) {
        return None;
    }
    let at = |v: f64| format!("{:.1}", 6.0 + (WIDTH - 12.0) * (v - least) / range);
    let middle = HEIGHT / 2.0;
    Some(html! {
        svg width=(WIDTH) height=(HEIGHT) viewBox={ "0 0 " (WIDTH) " " (HEIGHT) } role="img" aria-label="interval and limits" {
            line.axis x1=(at(low)) x2=(at(high)) y1=(middle) y2=(middle) {}
            @for limit in r.lower.into_iter().chain(r.upper) {
                line.frame x1=(at(limit)) x2=(at(limit)) y1="1" y2=(HEIGHT - 1.0) {}
            }
            circle.point cx=(at(value)) cy=(middle) r="3" fill="currentColor" {}
        }
    })
}
