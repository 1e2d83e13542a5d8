//! The model's equations, typeset; beside each what the text says of it.

use super::document::Section;
use super::subject::Subject;
use fdm_grammar::Source;
use fdm_grammar::syntax::{Declaration, Role, StatementKind, SyntaxTree, Typesetter, Value};
use maud::{Markup, PreEscaped, html};

/// Expressions of more parts than this are not set: nobody reads them, and browsers choke.
const LONGEST: usize = 20_000;

/// One line of mathematics.
pub(super) struct Line {
    /// MathML.
    pub(super) set: String,
    /// What the text says of it.
    pub(super) says: String,
}

pub(super) fn section(subject: &Subject) -> Option<Section> {
    let tree = subject.tree.as_ref()?;
    let lines = lines(tree, &subject.source);
    if lines.is_empty() {
        return None;
    }
    let content = html! { div.equations { @for line in &lines { (shown(line, "")) } } };
    Some(Section::new("equations", "Equations", content))
}

/// One line in a class of its own.
pub(super) fn shown(line: &Line, class: &str) -> Markup {
    html! {
        div class=(class) { (PreEscaped(&line.set)) @if !line.says.is_empty() { span.says { (line.says) } } }
    }
}

/// Equations, what they are made of, and outputs, in the order of the text.
pub(super) fn lines(tree: &SyntaxTree, source: &Source) -> Vec<Line> {
    if tree.expressions.len() > LONGEST {
        return Vec::new();
    }
    let typesetter = Typesetter::new(tree, source);
    let mut lines = Vec::new();
    for statement in &tree.statements {
        match &statement.kind {
            StatementKind::Equation(left, right) => {
                lines.push(Line { set: typesetter.equation(*left, *right), says: String::new() });
            }
            StatementKind::Declare(Role::Let | Role::Output, list) => {
                lines.extend(list.iter().filter_map(|d| declared(&typesetter, d)));
            }
            StatementKind::Tie(list) => {
                let tie = |(name, right): &(fdm_grammar::syntax::Name, _)| Line {
                    set: typesetter.definition(&name.text, *right),
                    says: "tied".into(),
                };
                lines.extend(list.iter().map(tie));
            }
            _ => {}
        }
    }
    lines
}

fn declared(typesetter: &Typesetter<'_>, d: &Declaration) -> Option<Line> {
    let Some(Value::Expr(right)) = d.value else { return None };
    let unit = d.unit.as_ref().map_or(String::new(), |u| format!("[{}] ", u.text));
    let doc = d.doc.as_ref().map_or("", |d| d.text.as_str());
    Some(Line { set: typesetter.definition(&d.name.text, right), says: format!("{unit}{doc}").trim().to_string() })
}
