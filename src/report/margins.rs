//! Modes and requirements of a result, with intervals and the probability that each requirement holds.

use super::section::{Cell, Part, Rows, Section};
use crate::text;
use fdm_results::documents::requirement::{Assessment, By, MarginsDocument, ModeMargin};
use fdm_results::documents::{digits, digits_by_error};
use maud::{Markup, html};

/// Size of the line of an interval.
const WIDTH: f64 = 160.0;
const HEIGHT: f64 = 16.0;

/// Verdict, requirements, modes, and what is to be said of them.
pub fn margins_text(margins: &MarginsDocument) -> String {
    let run = margins.run.as_ref().map_or(String::new(), |run| format!(", run {run}"));
    let head = format!("{}: margins of the result in {}{run}", margins.model, margins.result);
    let said = remarks(margins);
    let more = said.len().saturating_sub(REMARKS);
    let more = (more > 0).then(|| format!("{more} more remarks: --json"));
    let none = margins.requirements.is_empty().then(|| {
        "the model has no requirements: --requirement 'NAME = EXPRESSION in [LOWER, UPPER]' asks for one".to_string()
    });
    let lines: Vec<String> = said.into_iter().take(REMARKS).chain(more).chain(none).collect();
    let requirements = Section::new("requirements", "Requirements")
        .lines(std::iter::once(head).chain(verdict(margins)))
        .with_all((!margins.requirements.is_empty()).then(|| table(&margins.requirements)))
        .with_all((!lines.is_empty()).then_some(Part::Gap))
        .lines(lines);
    let modes = (!margins.modes.is_empty()).then(|| {
        let heading = Part::Heading("modes, with 95 % intervals".into());
        [heading, modes_with_intervals(&margins.modes, &margins.time).into()]
    });
    let no_modes = margins.no_modes.iter().map(|why| Part::Heading(format!("no modes: {why}")));
    let modes = Section::new("modes", "Modes").with_all(modes.into_iter().flatten()).with_all(no_modes);
    text::sections(&[requirements, modes])
}

/// How many of the requirements hold; none where no probability is known.
fn verdict(margins: &MarginsDocument) -> Option<String> {
    let known: Vec<f64> = margins.requirements.iter().filter_map(|r| r.probability).collect();
    let sure = known.iter().filter(|p| **p >= 0.95).count();
    let broken = known.iter().filter(|p| **p <= 0.05).count();
    let (all, open) = (known.len(), known.len() - sure - broken);
    (all > 0).then(|| {
        format!("of {all} requirements {sure} hold with 95 % probability or more, {broken} with 5 % or less, {open} are open")
    })
}

/// Name with unit, value, interval, limits, probability, and how they were found.
fn table(requirements: &[Assessment]) -> Rows<&Assessment> {
    let shown = |r: &Assessment, v: f64| {
        let half = r.interval.map(|[low, high]| 0.25 * (high - low));
        digits(v, half.and_then(|half| digits_by_error(v, half, 2)).unwrap_or(4))
    };
    let mut table = Rows::over(requirements);
    table.label("requirement", |r| {
        let unit = r.unit.as_deref().filter(|u| *u != "1").map_or(String::new(), |u| format!(" [{u}]"));
        format!("{}{unit}", r.name)
    });
    table.number("value", |r| r.value.map_or("none".into(), |v| shown(r, v)));
    table.number("95 % interval", |r| {
        r.interval.map_or(String::new(), |[low, high]| format!("{} to {}", shown(r, low), shown(r, high)))
    });
    table.words("wanted", |r| match (r.lower, r.upper) {
        (Some(low), Some(high)) => format!("{low} to {high}"),
        (Some(low), None) => format!("at least {low}"),
        (None, Some(high)) => format!("at most {high}"),
        (None, None) => String::new(),
    });
    table.number("holds with", |r| r.probability.map_or(String::new(), percent));
    table.words("by", |r| match r.by {
        Some(By::Linear) => "delta method",
        Some(By::Draws) => "draws",
        None => "",
    });
    table
}

/// Requirements of the model as it was found; none where it has none.
pub(crate) fn section(requirements: &[Assessment]) -> Option<Section> {
    let mut table = table(requirements);
    table.words("interval and limits", |r| Cell::drawn(line(r))).on_page();
    let valueless =
        requirements.iter().filter_map(|r| Some(format!("{} has no value: {}.", r.name, r.reason.as_ref()?)));
    let mut note = "Intervals hold the true value in 95 of 100 cases, by the covariance of the parameters.".to_string();
    if requirements.iter().any(|r| r.by == Some(By::Draws)) {
        note.push_str(" Where a requirement is not linear in them, interval and probability come from draws.");
    }
    let section = Section::new("requirements", "Requirements").with(table).lines(valueless);
    (!requirements.is_empty()).then(|| section.note(note))
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

/// A probability in percent, never rounded to certainty.
fn percent(p: f64) -> String {
    match 100.0 * p {
        p if p >= 99.95 => "over 99.9 %".into(),
        p if p < 0.05 => "under 0.1 %".into(),
        p if !(5.0..=95.0).contains(&p) => format!("{p:.1} %"),
        p => format!("{p:.0} %"),
    }
}

/// Remarks that are printed.
const REMARKS: usize = 5;

/// What is to be said of requirements: those without a value first, then those that are open.
fn remarks(margins: &MarginsDocument) -> Vec<String> {
    let all = || margins.requirements.iter();
    let mut said: Vec<String> =
        all().filter_map(|r| Some(format!("{}: no value, {}", r.name, r.reason.as_ref()?))).collect();
    for r in all().filter(|r| r.probability.is_some_and(|p| p > 0.05 && p < 0.95) && !r.parts.is_empty()) {
        let parts: Vec<String> =
            r.parts.iter().map(|part| format!("{} {:.0} %", part.parameter, 100.0 * part.share)).collect();
        said.push(format!("{}: open; its variance is that of {}", r.name, parts.join(", ")));
    }
    let draws = margins.draws;
    said.extend(all().filter_map(|r| {
        let missing = 100.0 * r.missing?;
        Some(format!("{}: of {draws} draws {missing:.1} % have no value; they count as not held", r.name))
    }));
    let bent: Vec<&str> =
        all().filter(|r| r.by == Some(By::Draws) && r.missing.is_none()).map(|r| r.name.as_str()).collect();
    if !bent.is_empty() {
        said.push(format!(
            "not linear in the parameters within their errors, so by {draws} draws: {}",
            bent.join(", ")
        ));
    }
    said
}

/// One row for each mode, a pair in one.
fn modes_with_intervals<'a>(modes: &'a [ModeMargin], time: &str) -> Rows<&'a ModeMargin> {
    let number = |v: f64, interval: Option<[f64; 2]>| match interval {
        Some([low, high]) => {
            let significant = digits_by_error(v, 0.25 * (high - low), 2).unwrap_or(4);
            format!("{} ({} to {})", digits(v, significant), digits(low, significant), digits(high, significant))
        }
        None => digits(v, 4),
    };
    let open = |v: Option<f64>, interval: Option<[Option<f64>; 2]>| match (v, interval) {
        (None, _) => String::new(),
        (Some(v), Some([Some(low), Some(high)])) => number(v, Some([low, high])),
        // a rate that may be zero: the time of a rate that nearly is says nothing
        (Some(v), Some([Some(low), None])) if v > 100.0 * low => format!("above {}", digits(low, 3)),
        (Some(v), Some([Some(low), None])) => format!("{} (above {})", digits(v, 3), digits(low, 3)),
        (Some(v), _) => digits(v, 4),
    };
    let mut table = Rows::over(modes);
    table.words("mode", |m| m.states.join(", "));
    table.number(&format!("frequency [rad/{time}]"), |m| number(m.frequency, m.frequency_interval));
    // on the real axis it is one, and says nothing
    table.number("damping", |m| {
        m.damping.filter(|_| m.im > 0.0).map_or(String::new(), |z| number(z, m.damping_interval))
    });
    table.number(&format!("time to half [{time}]"), |m| open(m.time_to_half, m.time_to_half_interval));
    table.number(&format!("time to double [{time}]"), |m| open(m.time_to_double, m.time_to_double_interval));
    table
}
