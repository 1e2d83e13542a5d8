//! Equation error as tables: parameters, principal components, structures, dependence on the data that were used.

use super::table::{aligned_right, plain, trimmed};
use fdm_estimate::equation_error::{Chosen, Dependence, EquationErrorFit, Regressed, Regression, Structure};
use fdm_results::documents::digits;

/// Tables of all regressions, then what was left out and why.
pub fn regression_table(regression: &Regression) -> String {
    let mut text: String = regression.fits.iter().map(|fit| format!("{}\n", fit_text(fit))).collect();
    if !regression.noise.is_empty() {
        let mut table = plain(&["noise of", "run", "deviation", "cut-off"]);
        for n in &regression.noise {
            table.add_row([n.state.clone(), n.run.clone(), digits(n.deviation, 3), digits(n.cutoff, 3)]);
        }
        text.push_str(&format!("{}\n", trimmed(&table)));
    }
    regression.refused.iter().for_each(|r| text.push_str(&format!("left out: {r}\n")));
    if !regression.kept.is_empty() {
        let names = regression.kept.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
        text.push_str(&format!("not estimated, so that their values stay: {names}\n"));
    }
    text
}

fn fit_text(fit: &EquationErrorFit) -> String {
    let mut text = String::new();
    for e in &fit.equations {
        if e.rows == 0 {
            text.push_str(&format!("{}: no parameter has an influence\n", e.equation));
            continue;
        }
        let (rms, r_squared) = (digits(e.rms, 4), digits(e.r_squared, 5));
        text.push_str(&format!("{}: R^2 {r_squared}, residual {rms} over {} rows\n", e.equation, e.rows));
    }
    text.push('\n');
    if !fit.parameters.is_empty() {
        text.push_str(&parameters(&fit.parameters));
    }
    if fit.components.len() > 1 {
        text.push_str(&format!("\n{}", components(fit)));
    }
    text.push_str(&reason(fit));
    for name in &fit.not_identifiable {
        text.push_str(&format!(
            "`{name}` is multiplied by nothing in these data (a constant has no part above zero frequency)\n"
        ));
    }
    text
}

fn parameters(all: &[Regressed]) -> String {
    let coloured = all.iter().any(|p| p.coloured_error.is_some());
    let mut header = vec!["parameter", "value", "std error"];
    if coloured {
        header.push("coloured");
    }
    header.extend(["%", "partial F", "part of rate", "unit", "multiplies"]);
    let mut table = plain(&header);
    for p in all {
        let name = p.run.as_ref().map_or(p.name.clone(), |run| format!("{} ({run})", p.name));
        let mut row = vec![name, digits(p.value, 6), digits(p.standard_error, 3)];
        if coloured {
            row.push(p.coloured_error.map_or(String::new(), |c| digits(c, 3)));
        }
        let error = p.coloured_error.map_or(p.standard_error, |c| c.max(p.standard_error));
        // of an exact zero there is no part
        let relative =
            Some(100.0 * error / p.value.abs()).filter(|r| r.is_finite()).map_or(String::new(), |r| digits(r, 2));
        row.extend([relative, digits(p.partial_f, 3), digits(p.significance, 2)]);
        row.extend([p.unit.clone().unwrap_or_default(), p.columns.join("; ")]);
        table.add_row(row);
    }
    (1..header.len() - 2).for_each(|k| aligned_right(&mut table, k));
    trimmed(&table)
}

fn components(fit: &EquationErrorFit) -> String {
    let mut header = vec!["components".to_string(), "singular value".into(), "R^2".into(), "F".into()];
    let names =
        fit.parameters.iter().map(|p| p.run.as_ref().map_or(p.name.clone(), |run| format!("{} ({run})", p.name)));
    header.extend(names.map(|n| format!("{n} +- error (F)")));
    let mut table = plain(&header.iter().map(String::as_str).collect::<Vec<_>>());
    for c in &fit.components {
        let mark = if c.count == fit.chosen { "*" } else { "" };
        let mut row = vec![
            format!("{}{mark}", c.count),
            digits(c.singular_value, 3),
            digits(c.r_squared, 5),
            digits(c.total_f, 3),
        ];
        let values = c.values.iter().zip(&c.standard_errors).zip(&c.partial_f);
        row.extend(values.map(|((v, e), f)| format!("{} +- {} ({})", digits(*v, 4), digits(*e, 2), digits(*f, 2))));
        table.add_row(row);
    }
    (1..4).for_each(|k| aligned_right(&mut table, k));
    trimmed(&table)
}

fn reason(fit: &EquationErrorFit) -> String {
    match &fit.reason {
        Chosen::All => String::new(),
        Chosen::Asked => format!("{} components, as asked for\n", fit.chosen),
        Chosen::Collinear(directions) => {
            let together = directions.iter().map(|names| names.join(" with ")).collect::<Vec<_>>().join("; ");
            format!(
                "{} of {} components: the data hardly tell apart {together}; the other directions explain next to nothing and \
                 would cost larger errors\n",
                fit.chosen,
                fit.parameters.len()
            )
        }
    }
}

/// The search for the structure of every measured rate.
pub fn structure_table(structures: &[Structure]) -> String {
    let mut text = String::new();
    for s in structures {
        text.push_str(&format!("der({}): R^2 {}\n\n", s.state, digits(s.found.r_squared, 5)));
        let mut steps = plain(&["step", "candidate", "partial F", "R^2", "PSE", "PRESS"]);
        for step in &s.found.steps {
            let what = if step.entered { "in" } else { "out" };
            let numbers = [(step.partial_f, 3), (step.r_squared, 5), (step.pse, 4), (step.press, 4)];
            let numbers = numbers.map(|(v, n)| digits(v, n));
            steps.add_row([what.to_string(), step.candidate.clone()].into_iter().chain(numbers));
        }
        (2..6).for_each(|k| aligned_right(&mut steps, k));
        let mut terms = plain(&["term", "value", "std error", "partial F"]);
        for t in &s.found.terms {
            terms.add_row([
                t.candidate.clone(),
                digits(t.value, 6),
                digits(t.standard_error, 3),
                digits(t.partial_f, 3),
            ]);
        }
        if let Some(constant) = s.found.constant {
            terms.add_row(["constant".to_string(), digits(constant, 6), String::new(), String::new()]);
        }
        (1..4).for_each(|k| aligned_right(&mut terms, k));
        if s.found.steps.is_empty() {
            text.push_str("no candidate explains enough of it\n\n");
        } else {
            text.push_str(&format!("{}\n{}\n", trimmed(&steps), trimmed(&terms)));
        }
    }
    text
}

/// Parameters over the highest frequency or the part of the record that was used; `at` heads the first column.
pub fn dependence_table(at: &str, rows: &[Dependence]) -> String {
    let Some(most) = rows.iter().max_by_key(|r| r.parameters.len()) else { return String::new() };
    let label = |p: &Regressed| p.run.as_ref().map_or(p.name.clone(), |run| format!("{} ({run})", p.name));
    let header: Vec<String> = std::iter::once(at.to_string()).chain(most.parameters.iter().map(label)).collect();
    let mut table = plain(&header.iter().map(String::as_str).collect::<Vec<_>>());
    let mut reasons = String::new();
    for row in rows {
        let cell = |name: &String| {
            let found = row.parameters.iter().find(|p| label(p) == *name);
            found.map_or(String::new(), |p| format!("{} +- {}", digits(p.value, 4), digits(p.standard_error, 2)))
        };
        let cells = header[1..].iter().map(cell);
        table.add_row(std::iter::once(digits(row.at, 3)).chain(cells).collect::<Vec<_>>());
        if let Some(reason) = &row.reason {
            reasons.push_str(&format!("{}: {reason}\n", digits(row.at, 3)));
        }
    }
    trimmed(&table) + &reasons
}
