//! Profile likelihood: the interval of each parameter by the cost beside that by its error, and the rise of the cost over it.

use super::section::{Part, Report, Rows, Section, Trust, Verdict};
use crate::page::Paper;
use crate::page::drawing::stacked;
use crate::page::figure::{Figure, Look, Mark, Panel};
use crate::page::number::bracketed;
use crate::{html, regions, text};
use fdm_results::documents::profile::{AtBound, End, Profile};
use fdm_results::documents::{digits, digits_by_error, digits_of_end};

/// Remarks that are printed.
const REMARKS: usize = 5;
/// Intervals by the cost and by the error agree within this part of the latter.
const AGREE: f64 = 0.25;

/// Verdict, then one row for each parameter: the interval by the cost beside that by the error.
pub fn profile_table(profiles: &[Profile]) -> String {
    text::below(format!("{}\n", verdict(profiles).sentence), &[intervals(profiles)])
}

/// A page of profiles of a model's parameters.
pub fn profile_page(model: &str, profiles: &[Profile]) -> String {
    let rises = Section::new("profiles", "Rise of the cost")
        .line("Where the cost lies on the parabola, the interval by the error is right. The limit is what chance explains in 95 of 100 records.")
        .with(Part::Pair(figures(profiles)));
    let regions = regions::of_profiles(profiles).map(|picture| {
        let note = "Shaded: where both true values are in 95 of 100 records, from both profiles (Bates and Watts 1988). Lines: where the best fit \
                    goes as one of both is moved. Dashed: the interval of each by itself. Pairs with an open interval have no region.";
        Section::drawn("regions", "Joint confidence regions", picture.markup()).note(note)
    });
    html::page(&Report {
        kind: "profile likelihood".into(),
        name: model.into(),
        doc: None,
        verdict: verdict(profiles),
        sections: [intervals(profiles), rises].into_iter().chain(regions).collect(),
    })
}

/// A figure for each parameter: the cost beside the parabola of the printed error, and what it may rise.
pub fn profile_svg(profiles: &[Profile]) -> String {
    stacked(&figures(profiles), Paper::Light)
}

/// Whether every interval ends, and whether it is that by the error.
fn verdict(profiles: &[Profile]) -> Verdict {
    let is_loose = |p: &&Profile| p.ends.iter().any(|end| !matches!(end, End::At(_)));
    let off = |p: &Profile, end: End| ((end.value() - p.value).abs() / p.reach() - 1.0).abs();
    let is_bent = |p: &&Profile| !p.bound && p.ends.iter().any(|end| off(p, *end) > AGREE);
    let names = |list: Vec<&Profile>| list.iter().map(|p| p.name.as_str()).collect::<Vec<_>>().join(", ");
    let loose: Vec<&Profile> = profiles.iter().filter(is_loose).collect();
    let bent: Vec<&Profile> = profiles.iter().filter(|p| !is_loose(p)).filter(is_bent).collect();
    let bounded = loose.is_empty();
    let mut sentence = match (bounded, bent.is_empty()) {
        (true, true) => "Every interval ends, and agrees within a quarter with that by the error.".to_string(),
        (true, false) => "Every interval ends where the cost has risen by what chance explains.".to_string(),
        (false, _) => format!("Not bounded on both sides: {}.", names(loose)),
    };
    if !bent.is_empty() {
        sentence.push_str(&format!(
            " Those of {} differ from those by the error by more than a quarter: take those by the cost.",
            names(bent)
        ));
    }
    let trust = if bounded { Trust::Good } else { Trust::Reserved };
    Verdict::new(trust, sentence).with_points(profiles.iter().flat_map(remarks), "intervals")
}

/// One row for each parameter, and what is to be said of ends.
fn intervals(profiles: &[Profile]) -> Section {
    // at a bound the error is a guess
    let by_error = |p: &Profile, text: String| if p.bound { "-".to_string() } else { text };
    let mut table = Rows::over(profiles);
    table.name("parameter", |p| p.name.clone());
    table.number("value", |p| {
        digits(p.value, if p.bound { 4 } else { digits_by_error(p.value, p.error, 3).unwrap_or(3) })
    });
    table.number("error", |p| by_error(p, digits(p.error, 3)));
    table.span("95 % by error", |p| {
        let end = |side: f64| digits_of_end(p.value + side * p.reach(), p.error);
        by_error(p, format!("{} to {}", end(-1.0), end(1.0)))
    });
    table.span("95 % by cost", |p| format!("{} to {}", end_cell(p, p.ends[0]), end_cell(p, p.ends[1])));
    table.number("below", |p| by_error(p, format!("{:.2}", (p.value - p.ends[0].value()) / p.reach())));
    table.number("above", |p| by_error(p, format!("{:.2}", (p.ends[1].value() - p.value) / p.reach())));
    table.number("refits", |p| p.refits);
    table.unit(|p| p.unit.clone());
    let said: Vec<String> = profiles.iter().flat_map(remarks).collect();
    let more = said.len().saturating_sub(REMARKS);
    // pages have them below the verdict
    let said = said.into_iter().take(REMARKS).map(|line| Part::Line(line).in_text());
    let more =
        (more > 0).then(|| Part::Line(format!("{more} more lines about ends of intervals: --json has them")).in_text());
    Section::new("intervals", "Intervals")
        .with(table)
        .with(Part::Gap)
        .note("below, above: how far the interval by the cost reaches, over that by the error")
        .with_all(said)
        .with_all(more)
        .with_all(colour(profiles))
}

/// How much further the cost may rise where residuals are coloured.
fn colour(profiles: &[Profile]) -> Option<Part> {
    let rises = || profiles.iter().map(|p| p.factor * p.factor).filter(|rise| *rise > 1.1);
    let (least, most) = (rises().reduce(f64::min)?, rises().reduce(f64::max)?);
    let range = if most > 1.05 * least { format!("{least:.1} to {most:.1}") } else { format!("{most:.1}") };
    Some(Part::Note(format!(
        "the residuals are coloured; the cost may rise {range} times as far as under white noise (`--rise 1.92`: as there)"
    )))
}

/// What is to be said of both ends.
fn remarks(p: &Profile) -> impl Iterator<Item = String> + '_ {
    let ends = p.ends.iter().zip(["left", "right"]).map(|(end, side)| remark(p, *end, side));
    let held =
        p.held.iter().zip(["left", "right"]).zip(&p.ends).map(|((held, side), end)| held_there(p, held, (side, *end)));
    ends.chain(held).filter(|said| !said.is_empty())
}

/// Others that have no way left where an interval ends.
fn held_there(p: &Profile, held: &[AtBound], (side, end): (&str, End)) -> String {
    let list: Vec<String> = held.iter().map(|h| format!("{} at its bound {}", h.name, digits(h.bound, 4))).collect();
    match list.is_empty() {
        true => String::new(),
        false => format!(
            "{}: about its end to the {side}, {}, the fit has {}",
            p.name,
            digits(end.value(), 4),
            list.join(", ")
        ),
    }
}

/// An end of the interval by the cost.
fn end_cell(p: &Profile, end: End) -> String {
    // at a bound the error is a guess
    let value = if p.bound { digits(end.value(), 4) } else { digits_of_end(end.value(), p.error) };
    match end {
        End::At(_) => value,
        End::Bound(_) => format!("{value} (bound)"),
        End::Open(_) => "open".into(),
        End::Astray(_) | End::Interrupted(_) => format!("{value} or further"),
    }
}

fn remark(p: &Profile, end: End, side: &str) -> String {
    let (name, value) = (&p.name, digits(end.value(), 4));
    match end {
        End::At(_) => String::new(),
        End::Open(_) => format!("{name} is open to the {side}: the cost has not risen enough at {value}"),
        End::Bound(_) => format!(
            "{name}: its bound {value} closes the interval: before it the cost rises by less than chance explains"
        ),
        End::Astray(_) => format!("{name}: no minimum is found to the {side} of {value}"),
        End::Interrupted(_) => format!("{name}: interrupted at {value}, to the {side}"),
    }
}

fn figures(profiles: &[Profile]) -> Vec<Figure> {
    profiles.iter().enumerate().map(|(k, profile)| figure(k, profile)).collect()
}

fn figure(k: usize, profile: &Profile) -> Figure {
    let values = profile.points.iter().map(|p| p.value);
    let (low, high) = values.fold((profile.value, profile.value), |(a, b), v| (a.min(v), b.max(v)));
    let top = 1.6 * profile.rise;
    let unit = bracketed(profile.unit.as_deref());
    // the parabola at even places, the cost where it was computed: one axis holds both
    let mut at: Vec<(f64, Option<f64>)> = profile.points.iter().map(|p| (p.value, Some(p.rise.max(0.0)))).collect();
    at.extend((0..=100).map(|k| (low + (high - low) * f64::from(k) / 100.0, None)));
    at.sort_by(|a, b| a.0.total_cmp(&b.0));
    let shown = |rise: f64| if rise <= top { rise } else { f64::NAN };
    let parabola = if profile.bound {
        vec![f64::NAN; at.len()]
    } else {
        at.iter().map(|(v, _)| shown(profile.rise * ((v - profile.value) / profile.reach()).powi(2))).collect()
    };
    let cost = between(&at).into_iter().map(shown).collect();
    let marks = vec![
        Mark::line("parabola of the standard error", Look::Measured, parabola),
        Mark::line("limit", Look::Residual, vec![profile.rise; at.len()]),
        Mark::line("cost", Look::Model, cost),
    ];
    Figure::new(
        format!("profile-{}", k + 1),
        format!("{}{unit}", profile.name),
        format!("{}{unit}", profile.name),
        at.iter().map(|(v, _)| *v).collect(),
    )
    .in_group("profiles")
    .with(Panel::new("rise of the cost", 220, marks))
}

/// Straight lines between the places that have a value; NaN outside them.
fn between(at: &[(f64, Option<f64>)]) -> Vec<f64> {
    let known: Vec<(f64, f64)> = at.iter().filter_map(|(x, y)| Some((*x, (*y)?))).collect();
    let value = |x: f64| {
        let k = known.partition_point(|(place, _)| *place < x);
        match (k.checked_sub(1).and_then(|k| known.get(k)), known.get(k)) {
            (_, Some((place, y))) if *place == x => *y,
            (Some((a, ya)), Some((b, yb))) => ya + (yb - ya) * (x - a) / (b - a),
            _ => f64::NAN,
        }
    };
    at.iter().map(|(x, _)| value(*x)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_verdict_names_what_is_open_and_what_is_lopsided() {
        let profile = |name: &str, ends: [End; 2], factor: f64| Profile {
            name: name.into(),
            unit: None,
            value: 1.0,
            error: 0.1 * factor,
            factor,
            rise: 1.92 * factor * factor,
            bound: false,
            ends,
            held: Default::default(),
            by_error: [0.8, 1.2],
            points: Vec::new(),
            refits: 3,
        };
        let even = profile("a", [End::At(0.8), End::At(1.2)], 1.0);
        let said = |all: &[Profile]| verdict(all).sentence;
        assert!(said(std::slice::from_ref(&even)).contains("agrees within a quarter"));
        let far = profile("b", [End::At(0.8), End::At(1.6)], 1.0);
        let text = said(&[even.clone(), far.clone()]);
        assert!(text.starts_with("Every interval ends") && text.contains("Those of b differ"), "{text}");
        let mut held = even.clone();
        held.held[0] = vec![AtBound { name: "d".into(), bound: 0.0 }];
        let text = profile_table(&[held]);
        assert!(text.contains("a: about its end to the left, 0.8000, the fit has d at its bound 0\n"), "{text}");
        let open = profile("c", [End::Open(-5.0), End::At(1.2)], 2.0);
        assert!(verdict(&[even.clone(), open.clone()]).trust == Trust::Reserved);
        let text = profile_table(&[open, far, even]);
        assert!(text.starts_with("Not bounded on both sides: c. Those of b differ"), "{text}");
        assert!(text.contains("the cost may rise 4.0 times as far"), "{text}");
    }

    #[test]
    fn a_cost_is_drawn_straight_between_its_points_and_nowhere_else() {
        let at = [(0.0, None), (1.0, Some(2.0)), (1.5, None), (2.0, Some(4.0)), (3.0, None)];
        let drawn = between(&at);
        assert_eq!(drawn[1..4], [2.0, 3.0, 4.0]);
        assert!(drawn[0].is_nan() && drawn[4].is_nan());
    }
}
