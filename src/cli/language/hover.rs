//! What a name, a function or a word of the language is, in a few lines.

use super::document::{Declared, Document};
use fdm_grammar::Span;
use fdm_grammar::check::function_forms;
use fdm_grammar::syntax::{Expr, ExprRef, Printer, Role, StatementKind, SyntaxTree};

/// What the words of the language are for.
const ABOUT: &[(&str, &str)] = &[
    ("model", "`model name \"doc\" { ... }`"),
    ("input", "a recorded signal that drives the model"),
    ("state", "a quantity with an equation `der(x) = ...;`, and its value at the beginning of a run"),
    ("param", "a number to be estimated: start value, bounds `in [lower, upper]`, `fixed`, `per run`, `log`"),
    ("const", "a number that is known"),
    ("let", "a name for an expression"),
    ("output", "what a recorded channel should be"),
    ("time", "`time [min];`: the unit of `t` and of the time in `der`"),
    ("prior", "`prior a ~ normal(mean, deviation);`: what was known before these data"),
    ("noise", "`noise y = 0.02;`: the known standard deviation of the noise of an output"),
    ("trim", "`trim { u = 10; }`: where the model is linearised"),
    ("tie", "`tie a = b;`: an equality of params that a study may switch off"),
    ("reactions", "`reactions { A + 2*B -> C : k*A*B; X <-> Y : kf*X, kr*Y; }`: balances of the species"),
    ("table", "`table f(x) = linear { 0: 1, 1: 2 };`: interpolation between points"),
    ("use", "`use \"file.fdm\" as name(x = u);`: a submodel"),
    ("effect", "`effect name(...) { ... }`: what may be missing from a model"),
    ("in", "`in [lower, upper]`: bounds"),
    ("fixed", "known, not estimated"),
    ("held", "an input that keeps its value until the next sample (zero-order hold)"),
    ("linear", "an input that goes in straight lines between samples; a table that is interpolated by them"),
    ("per", "`per run`: a value of its own in every run"),
    ("run", "`per run`: a value of its own in every run"),
    ("free", "the initial value is estimated in every run"),
    ("if", "`if condition then a else b`"),
    ("then", "`if condition then a else b`"),
    ("else", "`if condition then a else b`"),
    ("and", "both conditions hold"),
    ("or", "one of the conditions holds"),
    ("not", "the condition does not hold"),
    ("t", "the time since the run began"),
    ("pi", "3.14159..."),
    ("inf", "infinity: a bound that does not bind"),
];

/// What a word of the language is for.
pub(crate) fn about(word: &str) -> Option<&'static str> {
    ABOUT.iter().find(|(w, _)| *w == word).map(|(_, about)| *about)
}

/// Equations longer than this are cut.
const LONGEST: usize = 400;

/// What stands at a byte, as Markdown, and its span.
pub(crate) fn hover(document: &Document, offset: usize) -> Option<(String, Span)> {
    if document.in_comment(offset) {
        return None;
    }
    if let Some((name, span)) = document.name_at(offset) {
        return Some((declared(document, document.find(name)?), span));
    }
    let word = document.word(offset)?;
    let text = word.text(document.text());
    let about = match function_forms().find(|(name, _)| *name == text) {
        Some((_, form)) => code(&form),
        None => about(text)?.to_string(),
    };
    Some((about, word.span))
}

/// What is declared under a name: role, unit, doc, its text, the equation of a state, what a parameter is estimated from.
pub(crate) fn declared(document: &Document, declared: Declared<'_>) -> String {
    let Some(tree) = &document.tree else { return String::new() };
    let printer = Printer::with_source(tree, &document.source);
    let name = &declared.name().text;
    let unit = declared.unit().map_or(String::new(), |u| format!(" in `{u}`"));
    let mut text = format!("{} **{name}**{unit}", role(declared));
    if let Some(doc) = declared.doc().filter(|d| !d.is_empty()) {
        text.push_str(&format!("\n\n{doc}"));
    }
    let mut lines = match declared {
        Declared::Quantity(role, d) => vec![format!("{} {};", role.keyword(), printer.declaration(d))],
        Declared::Table(_) | Declared::Submodel(_) => {
            let own = |k: &StatementKind| match (k, declared) {
                (StatementKind::Table(t), Declared::Table(own)) => t.name.span == own.name.span,
                (StatementKind::Use(u), Declared::Submodel(own)) => u.alias.span == own.alias.span,
                _ => false,
            };
            tree.statements.iter().filter(|s| own(&s.kind)).map(|s| printer.statement(s)).collect()
        }
    };
    let about = tree.statements.iter().filter(|s| concerns(tree, &s.kind, name));
    lines.extend(about.map(|s| printer.statement(s)));
    let short = |line: String| match line.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{} ...", &line[..end]),
        None => line,
    };
    let lines: Vec<String> = lines.into_iter().map(short).collect();
    text.push_str(&format!("\n\n{}", code(&lines.join("\n"))));
    text.push_str(&known(document, declared));
    text
}

fn role(declared: Declared<'_>) -> &'static str {
    match declared {
        Declared::Quantity(Role::Param, d) if d.fixed.is_some() => "known parameter",
        Declared::Quantity(Role::Param, d) if d.per_run.is_some() => "parameter of each run",
        Declared::Quantity(Role::Param, _) => "parameter",
        Declared::Quantity(Role::Const, _) => "constant",
        Declared::Quantity(Role::Let, _) => "abbreviation",
        _ => declared.keyword(),
    }
}

/// What the checked model knows beside the text.
fn known(document: &Document, declared: Declared<'_>) -> String {
    let Some(model) = &document.model else { return String::new() };
    let name = &declared.name().text;
    match declared {
        Declared::Quantity(Role::Param, _) => match model.param(name).map(|k| &model.params[k]) {
            Some(p) if p.fixed => "\n\nnot estimated".into(),
            Some(_) => "\n\nestimated".into(),
            None if model.derived.iter().any(|d| d.quantity.name == *name) => {
                "\n\nfollows from other parameters, not estimated".into()
            }
            None => String::new(),
        },
        _ => String::new(),
    }
}

/// Whether a statement says something about a name: its equation, its noise, its prior, its trim, a tie, its smoothness.
fn concerns(tree: &SyntaxTree, kind: &StatementKind, name: &str) -> bool {
    match kind {
        StatementKind::Equation(left, _) => derivatives(tree, *left).any(|state| state == name),
        StatementKind::Smooth(smooth) => smooth.table.text == name,
        StatementKind::Limit(list) => list.iter().any(|l| l.state.text == name),
        StatementKind::When(event) => event.resets.iter().any(|(n, _)| n.text == name),
        StatementKind::Noise(list) | StatementKind::Process(list) | StatementKind::Tie(list) => {
            list.iter().any(|(n, _)| n.text == name)
        }
        StatementKind::Prior(list) => list.iter().any(|(subject, _)| match tree.expr(*subject) {
            Expr::Name(n) => n == name,
            Expr::Call(n, _) => n.text == name,
            _ => false,
        }),
        _ => false,
    }
}

/// The states whose derivatives stand in an expression.
fn derivatives(tree: &SyntaxTree, root: ExprRef) -> impl Iterator<Item = &str> {
    let inside = tree.span(root);
    // operands have smaller indices, and lie inside the span of what uses them
    let nodes = tree.expressions[..=root.0 as usize].iter().rev();
    nodes.take_while(move |(_, span)| inside.start <= span.start).filter_map(|(expr, _)| match expr {
        Expr::Call(called, arguments) if called.text == "der" => match arguments[..] {
            [argument] => match tree.expr(argument) {
                Expr::Name(state) => Some(state.as_str()),
                Expr::Element(state, _) => Some(&state.text),
                _ => None,
            },
            _ => None,
        },
        _ => None,
    })
}

pub(crate) fn code(text: &str) -> String {
    format!("```fdm\n{text}\n```")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_word_is_explained() {
        for (word, _) in fdm_grammar::syntax::WORDS {
            assert!(about(word).is_some(), "{word}");
        }
    }
}
