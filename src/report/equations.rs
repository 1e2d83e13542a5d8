//! The model's equations, typeset; beside each what the text says of it.

use super::section::Section;
use crate::page::number::bracketed;
use crate::page::subject::Subject;
use fdm_grammar::Source;
use fdm_grammar::expand::expand;
use fdm_grammar::syntax::{Declaration, Role, StatementKind, SyntaxTree, Typesetter, Value};
use maud::{Markup, PreEscaped, html};

/// Expressions of more parts than this are not set: nobody reads them, and browsers choke.
const LONGEST: usize = 20_000;

/// One line of mathematics.
pub(crate) struct Line {
    /// MathML.
    pub(crate) set: String,
    /// What the text says of it.
    pub(crate) says: String,
}

pub(crate) fn section(subject: &Subject) -> Option<Section> {
    let tree = subject.tree.as_ref()?;
    let lines = lines(tree, &subject.source);
    if lines.is_empty() {
        return None;
    }
    let content = html! { div.equations { @for line in &lines { (shown(line, "")) } } };
    Some(Section::drawn("equations", "Equations", content))
}

/// One line in a class of its own.
pub(crate) fn shown(line: &Line, class: &str) -> Markup {
    html! {
        div class=(class) { (PreEscaped(broken(&line.set))) @if !line.says.is_empty() { span.says { (line.says) } } }
    }
}

/// Formulas of more signs than this may be broken.
const SHORT: usize = 20;

/// A long formula in several, each a summand that begins with its sign: browsers break text between formulas, and never one within.
fn broken(set: &str) -> String {
    let (open, close) = ("<mrow>", "</mrow></math>");
    let inside = set.split_once(open).and_then(|(head, rest)| Some((head, rest.strip_suffix(close)?)));
    let Some((head, inside)) = inside.filter(|_| signs(set) > SHORT) else { return set.to_string() };
    let mut edges = vec![0];
    edges.extend(summands(inside));
    edges.push(inside.len());
    let part = |edge: &[usize]| {
        let own = &inside[edge[0]..edge[1]];
        // a sign that begins a formula would stand close to what it binds
        let signed = own.strip_prefix("<mo>").filter(|_| edge[0] > 0);
        let own = signed.map_or(own.to_string(), |rest| format!("<mo form=\"infix\">{rest}"));
        format!("{head}{open}{own}{close}")
    };
    edges.windows(2).map(part).collect::<Vec<_>>().join(" ")
}

/// What is seen of a formula.
fn signs(set: &str) -> usize {
    set.split('<').map(|part| part.split_once('>').map_or(0, |(_, shown)| shown.chars().count())).sum()
}

/// Where summands begin that stand within nothing else.
fn summands(inside: &str) -> Vec<usize> {
    let (mut found, mut depth, mut after_sign) = (Vec::new(), 0_i32, true);
    for (at, _) in inside.match_indices('<') {
        let tag = &inside[at + 1..];
        if tag.starts_with('/') {
            depth -= 1;
            continue;
        }
        if depth == 0 {
            let sign = tag.starts_with("mo>+<") || tag.starts_with("mo>−<");
            // one that follows another belongs to a number
            if sign && !after_sign {
                found.push(at);
            }
            after_sign = tag.starts_with("mo");
        }
        depth += 1;
    }
    found
}

/// Equations, what they are made of, and outputs, in the order of the text.
pub(crate) fn lines(tree: &SyntaxTree, source: &Source) -> Vec<Line> {
    if tree.expressions.len() > LONGEST {
        return Vec::new();
    }
    let reacts = tree.statements.iter().any(|s| matches!(s.kind, StatementKind::Reactions(..)));
    // balances are shown as they are solved
    let balances = reacts.then(|| expand(source, tree.clone(), &|_| Vec::new()).tree);
    let tree = balances.as_ref().unwrap_or(tree);
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
    let unit = bracketed(d.unit.as_ref().map(|u| u.text.as_str()));
    let doc = d.doc.as_ref().map_or("", |d| d.text.as_str());
    Some(Line { set: typesetter.definition(&d.name.text, right), says: format!("{unit} {doc}").trim().to_string() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(right: &str) -> String {
        let text = format!("model m {{ state x; param a = 1, b = 2, c = 3; der(x) = {right}; output y = x; }}");
        let source = Source::new("m.fdm", text);
        lines(&fdm_grammar::syntax::parse(&source).unwrap(), &source).remove(0).set
    }

    #[test]
    fn long_formulas_are_broken_between_summands_and_lose_nothing() {
        let short = set("-a*x + b");
        assert_eq!(broken(&short), short);
        let long = set("-a*x - (b + c)*x/(a - b) + ".repeat(6).trim_end_matches("+ "));
        let parts = broken(&long);
        assert_eq!(parts.matches("<math ").count(), 12, "one begins with the equation's left side");
        assert_eq!(parts.matches("<math ").count(), parts.matches("</math>").count());
        assert_eq!(signs(&parts) - 11, signs(&long), "what is seen is the same but for the spaces between");
        assert_eq!(parts.matches("<mrow>").count(), parts.matches("</mrow>").count());
        assert!(parts.contains("<mrow><mo form=\"infix\">−</mo>"));
    }
}
