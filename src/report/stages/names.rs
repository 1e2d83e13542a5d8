//! What every name of a model is, and its equations after everything was put in its place.

use super::Shown;
use crate::section::Rows;
use crate::text;
use fdm_grammar::graph::{Leaf, Names, Signal, show};
use fdm_grammar::model::{Input, Origin, Param, Quantity};
use fdm_grammar::syntax::{Printer, Role, StatementKind, parse_recovering};
use fdm_results::documents::stages::{DeclaredName, EquationText, NamesStage, StageDocument};
use fdm_system::Model;

/// What is said of a declaration.
struct Declared {
    name: String,
    role: &'static str,
    unit: Option<String>,
    value: Option<f64>,
    more: String,
    doc: String,
}

pub(super) fn names(model: &Model) -> Shown {
    let declared = declared(model);
    let definition = model.definition();
    let mut table = Rows::over(&declared);
    table.name("name", |d| d.name.clone());
    table.words("is a", |d| d.role);
    table.words("unit", |d| d.unit.clone().unwrap_or_default());
    table.number("value", |d| d.value.map(|v| v.to_string()).unwrap_or_default());
    table.words("", |d| d.more.clone());
    table.words("meaning", |d| d.doc.clone());
    let table = text::table(table);
    let doc = if definition.doc.is_empty() { String::new() } else { format!(": {}", definition.doc) };
    let mut text = format!("{}{doc}\ntimes are in {}\n\n{}", model.name(), definition.time, table);
    let equations = equations(model);
    let widest = equations.iter().map(|(left, _)| left.chars().count()).max().unwrap_or(0);
    text.push('\n');
    equations.iter().for_each(|(left, right)| text += &format!("{left:widest$} = {right}\n"));
    Shown { text, document: document(model, declared, equations) }
}

fn document(model: &Model, declared: Vec<Declared>, equations: Vec<(String, String)>) -> StageDocument {
    let name = |d: Declared| {
        let Declared { name, role, unit, value, more, doc } = d;
        DeclaredName { attributes: more, doc, name, role: role.into(), unit, value }
    };
    StageDocument::Names(NamesStage {
        equations: equations.into_iter().map(|(left, right)| EquationText { left, right }).collect(),
        model: model.name().into(),
        names: declared.into_iter().map(name).collect(),
        time: model.definition().time.to_string(),
    })
}

fn declared(model: &Model) -> Vec<Declared> {
    let m = model.definition();
    let row = |role, q: &Quantity, value, more| {
        let unit = q.unit.as_ref().map(ToString::to_string);
        Declared { name: q.name.clone(), role, unit, value, more, doc: q.doc.clone() }
    };
    let from = |input: &Input| match (input.measured, &input.computed) {
        (Some(o), _) => format!("the record of {}", m.outputs[o as usize].quantity.name),
        (None, Some(c)) => format!("computed: {}", show(&c.graph, c.expr, m)),
        (None, None) => String::new(),
    };
    let role = |i: &Input| match (i.known, i.held) {
        (true, _) => "known",
        (_, Some(true)) => "input, held",
        (_, Some(false)) => "input, linear",
        _ => "input",
    };
    let inputs = m.inputs.iter().map(|i| row(role(i), &i.quantity, None, from(i)));
    let states = m.states.iter().map(|s| row("state", &s.quantity, None, String::new()));
    let params = m.params.iter().map(|p| match p.origin {
        Origin::Declared => row("param", &p.quantity, Some(p.value), attributes(p)),
        Origin::FreeInitial(_) => row("free initial value", &p.quantity, Some(p.value), attributes(p)),
        Origin::FirstSample(_) => row("first sample", &p.quantity, None, String::new()),
    });
    let derived = m.derived.iter().map(|d| match d.tied {
        true => row("tied param", &d.quantity, None, format!("= {}", show(&m.graph, d.expr, m))),
        false => row("derived param", &d.quantity, None, String::new()),
    });
    let noise = |noise: Option<f64>| noise.map(|n| format!("noise {n}")).unwrap_or_default();
    let angle = |said: String, wrap: Option<f64>| match wrap {
        Some(period) => format!("{said} wrap {period}").trim_start().to_string(),
        None => said,
    };
    let outputs = m.outputs.iter().map(|o| row("output", &o.quantity, None, angle(noise(o.noise), o.wrap)));
    let written = definitions(model);
    inputs.chain(states).chain(params).chain(derived).chain(written).chain(outputs).collect()
}

/// Names for numbers and expressions: they are put in their places, and only the text knows them.
fn definitions(model: &Model) -> Vec<Declared> {
    let (Some(tree), _) = parse_recovering(model.source()) else { return Vec::new() };
    let printer = Printer::with_source(&tree, model.source());
    let text = |name: &Option<fdm_grammar::syntax::Name>| name.as_ref().map(|n| n.text.clone());
    let mut found = Vec::new();
    for statement in &tree.statements {
        if let StatementKind::Table(table) = &statement.kind {
            let (name, doc, unit) = (table.name.text.clone(), text(&table.doc).unwrap_or_default(), text(&table.unit));
            let written = printer.statement(statement);
            let more = written.split_once(" = ").map_or(String::new(), |(_, curve)| format!("= {curve}"));
            let more = more.trim_end_matches(';').to_string();
            found.push(Declared { name, role: Role::Table.keyword(), unit, value: None, more, doc });
            continue;
        }
        let StatementKind::Declare(role @ (Role::Const | Role::Let), declarations) = &statement.kind else { continue };
        for d in declarations {
            let Some(fdm_grammar::syntax::Value::Expr(e)) = d.value else { continue };
            let (name, doc) = (d.name.text.clone(), text(&d.doc).unwrap_or_default());
            let more = format!("= {}", printer.expression(e));
            found.push(Declared { name, role: role.keyword(), unit: text(&d.unit), value: None, more, doc });
        }
    }
    found
}

fn attributes(p: &Param) -> String {
    let bounds =
        (p.lower > f64::NEG_INFINITY || p.upper < f64::INFINITY).then(|| format!("in [{}, {}]", p.lower, p.upper));
    let fixed = p.fixed.then(|| "fixed".to_string());
    let per_run = p.per_run.then(|| "per run".to_string());
    let per_group = p.group.as_ref().map(|group| format!("per group {group}"));
    let log = p.logarithmic.then(|| "log".to_string());
    let prior = p.prior.map(|prior| format!("~ normal({}, {})", prior.mean, prior.deviation));
    [bounds, fixed, per_run, per_group, log, prior].into_iter().flatten().collect::<Vec<_>>().join(" ")
}

/// Left and right sides: rates, initial values that are not free, derived parameters, outputs, the trim.
fn equations(model: &Model) -> Vec<(String, String)> {
    let m = model.definition();
    let shown = |e| show(&m.graph, e, m);
    let free = |k: usize| m.params.iter().any(|p| p.origin == Origin::FreeInitial(k as u32));
    let rates = m.states.iter().map(|s| (format!("der({})", s.quantity.name), shown(s.rate)));
    let initial = m.states.iter().enumerate().filter(|(k, _)| !free(*k));
    let initial = initial.map(|(_, s)| (format!("{}(0)", s.quantity.name), shown(s.initial)));
    let derived = m.derived.iter().map(|d| (d.quantity.name.clone(), shown(d.expr)));
    let outputs = m.outputs.iter().map(|o| (o.quantity.name.clone(), shown(o.expr)));
    let signal = |s: &Signal| match *s {
        Signal::State(k) => m.leaf(Leaf::State(k)),
        Signal::Input(k) => m.leaf(Leaf::Input(k)),
    };
    let trim = m.trim.iter().map(|(s, e)| (format!("{} at the trim", signal(s)), shown(*e)));
    let noise = |s: &fdm_grammar::model::State| Some((format!("noise of der({})", s.quantity.name), shown(s.noise?)));
    let measured =
        |o: &fdm_grammar::model::Output| Some((format!("noise of {}", o.quantity.name), shown(o.noise_model?)));
    let trim = trim.chain(m.states.iter().filter_map(noise)).chain(m.outputs.iter().filter_map(measured));
    rates.chain(initial).chain(derived).chain(outputs).chain(trim).collect()
}
