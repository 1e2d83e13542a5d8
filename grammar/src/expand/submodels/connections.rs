//! What the whole gives to the inputs and params of a part.

use super::part::Part;
use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::syntax::{ExprRef, Role, Use};
use std::collections::HashMap;

/// Names that a hint lists.
const MOST_NAMES: usize = 8;

/// By name in the part: the expression of the whole.
pub(super) struct Connections {
    given: HashMap<String, ExprRef>,
}

impl Connections {
    /// Reads the brackets of a `use` and tells what is wrong with them.
    pub(super) fn read(submodel: &Use, part: &Part, findings: &mut Vec<Diagnostic>) -> Self {
        let mut given = HashMap::new();
        let mut places = HashMap::new();
        let mut misspelt = Vec::new();
        let alias = &submodel.alias.text;
        for (name, value) in &submodel.connections {
            let text = &name.text;
            if let Some(first) = places.insert(text.clone(), name.span) {
                let message = format!("`{text}` of `{alias}` is connected a second time");
                let finding = Diagnostic::new(Code::DeclaredTwice, name.span, message);
                findings.push(finding.label(first, "first connected here").hint("remove one of them"));
                continue;
            }
            match part.role(text) {
                Some(Some(Role::Input | Role::Param)) => drop(given.insert(text.clone(), *value)),
                Some(role) => {
                    let what = role.map_or("table", Role::keyword);
                    let article = if what == "output" { "an" } else { "a" };
                    let message = format!("`{text}` is {article} {what} of `{alias}`; inputs and params are connected");
                    let finding = Diagnostic::new(Code::WrongName, name.span, message);
                    findings.push(finding.hint(format!("its value is `{alias}.{text}`")));
                }
                None => {
                    let message = format!("`{alias}` has no input or param `{text}`");
                    let finding = Diagnostic::new(Code::UnknownName, name.span, message);
                    findings.push(finding.hint(meant(text, part)));
                    misspelt.extend(nearest(text, part.connectable()));
                }
            }
        }
        let connections = Self { given };
        for input in part.inputs().filter(|d| !places.contains_key(&d.name.text)) {
            let text = &input.name.text;
            if misspelt.contains(&text.as_str()) {
                continue;
            }
            let message = format!("nothing is connected to the input `{text}` of `{alias}`");
            let finding = Diagnostic::new(Code::NotConnected, submodel.alias.span, message);
            let finding = finding.label(input.name.span, "declared here");
            findings.push(finding.hint(format!("`as {alias}({text} = ...)`, with an expression of this model")));
        }
        connections
    }

    /// What is given to a name.
    pub(super) fn get(&self, name: &str) -> Option<ExprRef> {
        self.given.get(name).copied()
    }
}

fn meant(name: &str, part: &Part) -> String {
    let names: Vec<&str> = part.connectable().collect();
    if let Some(near) = nearest(name, names.iter().copied()) {
        return format!("did you mean `{near}`?");
    }
    let listed: Vec<String> = names.iter().take(MOST_NAMES).map(|n| format!("`{n}`")).collect();
    match (listed.is_empty(), names.len() > MOST_NAMES) {
        (true, _) => "it has neither inputs nor params".into(),
        (false, more) => format!("it has {}{}", listed.join(", "), if more { ", ..." } else { "" }),
    }
}
