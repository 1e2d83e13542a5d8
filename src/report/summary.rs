//! A model at a glance: what it declares, how sparse its derivatives are, and whether they were confirmed.

use super::section::Rows;
use crate::text;
use fdm_grammar::graph::show;
use fdm_grammar::model::{Param, Quantity};
use fdm_results::documents::digits;
use fdm_system::Model;
use fdm_system::code::{TOLERANCE, Verification};

/// Declarations as a table, then a line on the programs and one on the derivatives.
pub fn check_text(model: &Model, verification: &Verification) -> String {
    let definition = model.definition();
    let title = if definition.doc.is_empty() { String::new() } else { format!(": {}", definition.doc) };
    let mut text = format!("{}{title}\n\n{}\n", model.name(), declarations(model));
    let (layout, schedule) = (model.layout(), model.schedule());
    let p = &layout.patterns;
    if layout.states > 0 {
        text.push_str(&format!(
            "f_x has {} structural nonzeros of {}, f_theta {} of {}; ",
            p.rates_by_state.len(),
            layout.states * layout.states,
            p.rates_by_param.len(),
            layout.states * layout.params,
        ));
    }
    text.push_str(&format!(
        "{} operations for rates with partials, {} for outputs with partials\n",
        schedule.rates_and_partials.instructions.len(),
        schedule.outputs_and_partials.instructions.len(),
    ));
    text.push_str(&verdict(verification));
    text
}

fn declarations(model: &Model) -> String {
    let definition = model.definition();
    let mut rows: Vec<(String, &Quantity, String, String)> = Vec::new();
    let mut add = |role: &str, q, start: String, known: String| rows.push((role.into(), q, start, known));
    for i in &definition.inputs {
        let role = match (i.is_declared(), i.slope) {
            (true, _) if i.known => "known",
            (true, _) if i.held == Some(true) => "input, held",
            (true, _) if i.held == Some(false) => "input, linear",
            (true, _) => "input",
            (_, Some(_)) => "derivative",
            _ => "record",
        };
        add(role, &i.quantity, String::new(), String::new());
    }
    definition.states.iter().for_each(|s| add("state", &s.quantity, String::new(), String::new()));
    for p in definition.params.iter().filter(|p| !p.is_recorded()) {
        let role = match (p.fixed, p.per_run, &p.group) {
            (true, ..) => "param, fixed".to_string(),
            (_, true, _) => "param, per run".to_string(),
            (.., Some(group)) => format!("param, per group {group}"),
            _ => "param".to_string(),
        };
        let prior = p.prior.map(|k| format!("~ normal({}, {})", digits(k.mean, 6), digits(k.deviation, 6)));
        let known: Vec<String> = [bounds(p)].into_iter().chain(prior).filter(|text| !text.is_empty()).collect();
        add(&role, &p.quantity, digits(p.value, 6), known.join(" "));
    }
    definition
        .derived
        .iter()
        .for_each(|d| add(if d.tied { "tied" } else { "derived" }, &d.quantity, String::new(), String::new()));
    for o in &definition.outputs {
        let expression = o.noise_model.map(|e| format!("noise {}", show(&definition.graph, e, definition)));
        let number = o.noise.map(|deviation| format!("noise {}", digits(deviation, 6)));
        let wrap = o.wrap.map(|period| format!("wrap {}", digits(period, 6)));
        let known: Vec<String> = expression.or(number).into_iter().chain(wrap).collect();
        add("output", &o.quantity, String::new(), known.join(", "));
    }
    let mut table = Rows::over(rows);
    table.words("", |row| row.0.clone());
    table.name("name", |row| row.1.name.clone());
    table.unit(|row| row.1.unit.as_ref().map(ToString::to_string));
    table.number("start", |row| row.2.clone());
    table.words("known", |row| row.3.clone());
    table.words("meaning", |row| row.1.doc.clone());
    text::table(table)
}

fn bounds(p: &Param) -> String {
    if p.lower == f64::NEG_INFINITY && p.upper == f64::INFINITY {
        return String::new();
    }
    format!("[{}, {}]", p.lower, p.upper)
}

fn verdict(v: &Verification) -> String {
    let skipped = if v.skipped > 0 { format!(" ({} more had no finite value)", v.skipped) } else { String::new() };
    if v.points == 0 {
        return format!(
            "the derivatives could not be checked: no point around the start values has finite values{skipped}\n"
        );
    }
    let way = match v.directions {
        0 => "compared with complex steps".to_string(),
        count => format!("summed along {count} random directions of all variables, compared with complex steps"),
    };
    let mut text = format!(
        "derivatives: {} entries, structural zeros included, {way} at {} points{skipped}: ",
        v.compared, v.points
    );
    match (&v.failures[..], &v.worst) {
        ([], None) => text.push_str("all equal\n"),
        ([], Some(worst)) => {
            text.push_str(&format!(
                "all agree, largest relative difference {:.1e} in {}\n",
                worst.relative,
                name(worst)
            ));
        }
        (failures, _) => {
            text.push_str(&format!("{} differ by more than {TOLERANCE:.0e}:\n", failures.len()));
            for d in failures.iter().take(20) {
                text.push_str(&format!("  {}: {} instead of {}\n", name(d), d.symbolic, d.numeric));
            }
        }
    }
    text
}

fn name(d: &fdm_system::code::Discrepancy) -> String {
    d.by.as_ref().map_or_else(|| d.equation.clone(), |by| format!("d {} / d {by}", d.equation))
}
