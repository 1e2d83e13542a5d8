//! Which parameters the data hardly separate: the correlations of all estimates as a map, and the worst as a list.

use super::section::{Part, Section};
use crate::page::number::text;
use crate::page::subject::Subject;
use crate::regions;
use fdm_results::documents::{CORRELATED, with_run};
use maud::{Markup, html};

/// More parameters than this have no map: nobody could read it.
const MOST: usize = 60;

pub(crate) fn section(subject: &Subject) -> Option<Section> {
    let fit = subject.fit()?;
    let name = |k: &usize| fit.parameters.get(*k).map_or(String::new(), |p| with_run(&p.name, p.run.as_deref()));
    let names: Vec<String> = fit.correlations.parameters.iter().map(name).collect();
    let rows = &fit.correlations.values;
    if names.len() < 2 || rows.len() != names.len() || rows.iter().any(|r| r.len() != names.len()) {
        return None;
    }
    let mut pairs: Vec<(usize, usize, f64)> = Vec::new();
    for (i, row) in rows.iter().enumerate() {
        pairs.extend(row[..i].iter().enumerate().filter(|(_, r)| r.abs() > CORRELATED).map(|(j, r)| (j, i, *r)));
    }
    pairs.sort_by(|a, b| b.2.abs().total_cmp(&a.2.abs()));
    let map = (names.len() <= MOST).then(|| {
        [
            Part::Markup(map(&names, rows)),
            Part::Note("In hundredths. Orange rises together, blue against each other.".into()),
        ]
    });
    let said = match pairs.is_empty() {
        true => format!("No two parameters correlate by more than {CORRELATED}."),
        false => format!("Correlated by more than {CORRELATED}, so that one can make up for the other:"),
    };
    let pairs = pairs.iter().map(|(j, i, r)| format!("`{}` and `{}`: {}", names[*j], names[*i], text(*r, 4)));
    let condition =
        fit.condition.map(|v| format!("Condition number of the scaled information matrix: {}.", text(v, 3)));
    let section = Section::new("correlations", "Correlations").with_all(map.into_iter().flatten()).line(said);
    let regions = regions::of_fit(fit).map(|picture| {
        let note = "Dashed: the interval of 95 % of each parameter by itself. A narrow slanted region: one parameter makes up for the other.";
        [Part::Markup(picture.markup()), Part::Note(note.into())]
    });
    Some(section.with(Part::List(pairs.collect())).notes(condition).with_all(regions.into_iter().flatten()))
}

/// Every correlation in the colour of its sign and size.
fn map(names: &[String], rows: &[Vec<f64>]) -> Markup {
    html! {
        div.scroll { table.map {
            thead { tr { th {} @for name in names { th { span { (name) } } } } }
            tbody { @for (i, row) in rows.iter().enumerate() { tr {
                th scope="row" { (names[i]) }
                @for (j, r) in row.iter().enumerate() {
                    td class=(shade(*r, i == j)) title={ (names[i]) ", " (names[j]) ": " (text(*r, 3)) } {
                        @if i != j && r.is_finite() { (format!("{:.0}", 100.0 * r).replace('-', "\u{2212}")) }
                    }
                }
            } } }
        } }
    }
}

/// One of ten steps of the colour of a sign.
pub(crate) fn shade(r: f64, own: bool) -> String {
    if own || !r.is_finite() {
        return "own".into();
    }
    let step = (r.abs() * 10.0).floor().min(9.0);
    format!("{}{step}", if r < 0.0 { "n" } else { "p" })
}
