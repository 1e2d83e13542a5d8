//! The tables of a model at the estimates: curves and surfaces with their errors, as far as any run has visited them.

use super::section::{Part, Section};
use crate::correlations::shade;
use crate::page::figure::{Figure, Look, Mark, Panel, Shape};
use crate::page::number::{behind, bracketed, text, written};
use crate::page::subject::Subject;
use fdm_estimate::{NodeEstimate, TableAxis, TableEstimate};
use fdm_results::documents::{digits_by_error, smoothness};
use maud::{Markup, html};

/// Tables that are shown.
const MOST: usize = 20;
/// Nodes along an axis beyond which a surface has no map: nobody could read it.
const MOST_NODES: usize = 40;

/// Tables with a node that is estimated.
fn estimated(subject: &Subject) -> Vec<&TableEstimate> {
    let tables = subject.fit().into_iter().flat_map(|fit| &fit.tables);
    tables.filter(|t| t.nodes.iter().any(|n| n.parameter.is_some())).take(MOST).collect()
}

pub(crate) fn section(subject: &Subject) -> Option<Section> {
    let tables = estimated(subject);
    if tables.is_empty() {
        return None;
    }
    let smoothing = |name: &str| subject.fit()?.smoothing.iter().find(|s| s.table == name);
    let parts_of = |(k, table): (usize, &&TableEstimate)| {
        let doc = if table.doc.is_empty() { String::new() } else { format!(" {}", table.doc) };
        let unknown = table.unknown().count();
        let (few, all) = (unknown, table.nodes.len());
        let unknown =
            (unknown > 0).then(|| format!("{few} of {all} nodes are unknown: no sample of any run lies beside them."));
        std::iter::once(Part::Heading(format!("`{}`{doc}", called(table))))
            .chain(smoothing(&table.table).map(smoothness).into_iter().chain(unknown).map(Part::Line))
            .chain(maps(table).iter().map(|one| Part::Markup(map(table, one))))
            .chain(figure(k, table).map(Part::from))
            .collect::<Vec<_>>()
    };
    let note = "Orange is above zero, blue below; a node without a number was not visited by any run. Pointed at, a node tells its standard error.";
    let section = Section::new("tables", "Tables").with_all(tables.iter().enumerate().flat_map(parts_of));
    Some(section.note(note))
}

pub(crate) fn figures(subject: &Subject) -> Vec<Figure> {
    estimated(subject).into_iter().enumerate().filter_map(|(k, table)| figure(k, table)).collect()
}

fn called(table: &TableEstimate) -> String {
    let arguments: Vec<&str> = table.arguments.iter().map(|a| a.name.as_str()).collect();
    format!("{}({}){}", table.table, arguments.join(", "), bracketed(table.unit.as_deref()))
}

/// A map: what holds of the argument before the last two, and where its nodes begin.
struct Map {
    title: Option<String>,
    from: usize,
}

/// A surface is one map, a table of three arguments one for each value of the first; a curve has none.
fn maps(table: &TableEstimate) -> Vec<Map> {
    let readable = table.arguments.iter().all(|a| a.axis.len() <= MOST_NODES);
    match &table.arguments[..] {
        [_, _] if readable => vec![Map { title: None, from: 0 }],
        [first, second, third] if readable => {
            let size = second.axis.len() * third.axis.len();
            let part = |(k, x): (usize, &f64)| Map { title: Some(at(first, *x)), from: k * size };
            first.axis.iter().enumerate().map(part).collect()
        }
        _ => Vec::new(),
    }
}

/// `alpha = 0.1 rad`
fn at(axis: &TableAxis, x: f64) -> String {
    format!("{} = {}{}", axis.name, written(x), behind(axis.unit.as_deref()))
}

fn map(table: &TableEstimate, part: &Map) -> Markup {
    let [rows, columns] = [2, 1].map(|k| &table.arguments[table.arguments.len() - k]);
    let size = table.nodes.iter().filter_map(|n| n.value).fold(0.0_f64, |most, v| most.max(v.abs()));
    html! {
        @if let Some(title) = &part.title { p { (title) } }
        div.scroll { table.map.nodes {
            thead { tr { th { (rows.name) " \\ " (columns.name) } @for x in &columns.axis { th { span { (written(*x)) } } } } }
            tbody { @for (i, x) in rows.axis.iter().enumerate() { tr {
                th scope="row" { (written(*x)) }
                @for node in &table.nodes[part.from + i * columns.axis.len()..][..columns.axis.len()] {
                    td class=(shade(node.value.map_or(f64::NAN, |v| v / size.max(f64::MIN_POSITIVE)), false)) title=(title(node)) {
                        (value(node))
                    }
                }
            } } }
        } }
    }
}

fn value(node: &NodeEstimate) -> String {
    node.value.map_or(String::new(), |v| text(v, node.error.and_then(|e| digits_by_error(v, e, 2)).unwrap_or(3)))
}

fn title(node: &NodeEstimate) -> String {
    let name = node.parameter.as_deref().unwrap_or("known");
    match (node.value, node.error) {
        (None, _) => format!("{name}: unknown"),
        (Some(v), Some(e)) => format!("{name}: {} \u{b1} {}", text(v, 4), text(e, 2)),
        (Some(v), None) => format!("{name}: {}", text(v, 4)),
    }
}

/// Nodes over the first argument: a curve with two standard errors to either side; of a surface a line for each value of the second argument.
fn figure(k: usize, table: &TableEstimate) -> Option<Figure> {
    const LOOKS: [Look; 5] = [Look::Model, Look::Measured, Look::Residual, Look::Input, Look::Other];
    let (first, others) = table.arguments.split_first()?;
    let number = |v: Option<f64>| v.unwrap_or(f64::NAN);
    let marks = match others {
        [] => {
            let edge =
                |side: f64| table.nodes.iter().map(|n| number(n.value) + side * 2.0 * n.error.unwrap_or(0.0)).collect();
            let values: Vec<f64> = table.nodes.iter().map(|n| number(n.value)).collect();
            vec![
                Mark::between("two standard errors", Look::Bound, Shape::Bars, edge(-1.0), edge(1.0)),
                Mark::line("nodes", Look::Model, values.clone()),
                Mark::dots("nodes", Look::Model, values),
            ]
        }
        [second] => {
            // few enough to be distinguished
            let step = second.axis.len().div_ceil(LOOKS.len());
            let line = |(mark, j): (usize, usize)| {
                let values = table.nodes[j..].iter().step_by(second.axis.len()).map(|n| number(n.value)).collect();
                Mark::line(&at(second, second.axis[j]), LOOKS[mark % LOOKS.len()], values)
            };
            (0..second.axis.len()).step_by(step).enumerate().map(line).collect()
        }
        _ => return None,
    };
    let unit = bracketed(first.unit.as_deref());
    Some(
        Figure::new(format!("table-{}", k + 1), called(table), format!("{}{unit}", first.name), first.axis.clone())
            .with(Panel::new(table.table.clone(), 200, marks)),
    )
}
