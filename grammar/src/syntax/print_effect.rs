//! An effect back to text, as people write it: a line for the header, a line for each statement.

use super::effects::{Class, EffectLine, EffectTree, Place, Tunable};
use super::print::Printer;
use std::fmt::Write;

/// The whole effect.
pub fn print_effect(effect: &EffectTree) -> String {
    let printer = Printer::new(&effect.pool);
    let slots: Vec<String> = effect
        .slots
        .iter()
        .map(|s| {
            let kinds: Vec<_> = s.kinds.iter().map(|k| k.word()).collect();
            format!("{}: {}", s.name.text, kinds.join(" | "))
        })
        .collect();
    let mut out = format!("effect {}({})", effect.name.text, slots.join(", "));
    for condition in &effect.conditions {
        let word = if condition.unless { "unless" } else { "when" };
        let _ = write!(out, " {word} {}", printer.expression(condition.test));
    }
    if effect.class != Class::Mechanism {
        let _ = write!(out, " as {}", effect.class.word());
    }
    if !effect.fields.is_empty() {
        let fields: Vec<_> = effect.fields.iter().map(|f| f.word()).collect();
        let _ = write!(out, " for {}", fields.join(", "));
    }
    if let Some(doc) = &effect.doc {
        let _ = write!(out, " \"{}\"", doc.text);
    }
    out.push_str(" {\n");
    for (line, _) in &effect.lines {
        let _ = writeln!(out, "  {};", statement(&printer, line));
    }
    out + "}\n"
}

fn statement(printer: &Printer<'_>, line: &EffectLine) -> String {
    let place = |p: &Place| if p.derivative { format!("der({})", p.name.text) } else { p.name.text.clone() };
    match line {
        EffectLine::Tunable(t) => tunable(printer, t),
        EffectLine::Own(role, list) => {
            let parts: Vec<_> = list.iter().map(|d| printer.declaration(d)).collect();
            format!("{} {}", role.keyword(), parts.join(", "))
        }
        EffectLine::Equation(left, right) => {
            format!("{} = {}", printer.expression(*left), printer.expression(*right))
        }
        EffectLine::Add(p, term) => format!("add {} += {}", place(p), printer.expression(*term)),
        EffectLine::Replace(name, with) => format!("replace {} with {}", name.text, printer.expression(*with)),
        EffectLine::Noise(p, intensity) => format!("noise {} = {}", place(p), printer.expression(*intensity)),
    }
}

fn tunable(printer: &Printer<'_>, tunable: &Tunable) -> String {
    let word = if tunable.nuisance { "nuisance" } else { "param" };
    let mut out = format!("{word} {}", printer.declaration(&tunable.declaration));
    if tunable.positive {
        out.push_str(" positive");
    }
    if !tunable.trials.is_empty() {
        let trials: Vec<_> = tunable.trials.iter().map(|e| printer.expression(*e)).collect();
        let _ = write!(out, " try {}", trials.join(", "));
    }
    out
}
