//! What can be typed at a place.

use super::document::{Declared, Document};
use super::hover;
use fdm_grammar::check::function_forms;
use fdm_grammar::syntax::{Role, TokenKind, WordUse, words_for};

/// What can be typed.
#[derive(Debug, Clone)]
pub(crate) struct Item {
    pub(crate) label: String,
    pub(crate) kind: Kind,
    /// In a few words.
    pub(crate) detail: Option<String>,
    /// What is declared under the name; none of what the language has.
    pub(crate) declared: Option<String>,
}

/// What it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Unit,
    Keyword,
    /// The left side of an equation.
    Equation,
    Constant,
    /// An input or an output.
    Signal,
    /// Called with arguments; the language's own.
    Function,
    Table,
    Submodel,
    Variable,
}

/// What is expected at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Context {
    /// Inside a string, a comment, or a name that is being invented.
    Nothing,
    /// A unit.
    Unit,
    /// The beginning of a statement.
    Statement,
    /// What may be said of a declared name.
    Attribute,
    /// An operand.
    Operand,
    /// What may follow an operand.
    Operator,
}

/// What can be typed at a byte.
pub(crate) fn items(document: &Document, offset: usize) -> Vec<Item> {
    match context(document, offset) {
        Context::Nothing => Vec::new(),
        Context::Unit => fdm_grammar::unit::symbols().map(|s| word(s, Kind::Unit)).collect(),
        Context::Statement => statements(document),
        Context::Attribute => ["in", "fixed", "per run", "log", "held", "linear"].into_iter().map(keyword).collect(),
        Context::Operator => ["and", "or", "then", "else"].into_iter().map(keyword).collect(),
        Context::Operand => {
            let mut items: Vec<_> = document.declared().map(|d| name(document, d)).collect();
            items.extend(function_forms().map(|(name, form)| function(name, &form)));
            items.extend(["if", "not", "t", "pi", "inf", "free"].into_iter().map(keyword));
            items
        }
    }
}

fn context(document: &Document, offset: usize) -> Context {
    if document.in_comment(offset) {
        return Context::Nothing;
    }
    let text = document.text();
    // the word being typed does not count
    let mut before = document.token_at(offset);
    if document.tokens.get(before).is_some_and(|t| (t.span.end as usize) < offset || (t.span.start as usize) < offset) {
        let token = &document.tokens[before];
        match token.kind {
            TokenKind::Text | TokenKind::OpenText | TokenKind::OpenComment if (token.span.end as usize) > offset => {
                return Context::Nothing;
            }
            TokenKind::OpenText | TokenKind::OpenComment | TokenKind::Number | TokenKind::Malformed => {
                return Context::Nothing;
            }
            TokenKind::Unit if (token.span.end as usize) > offset => return Context::Unit,
            TokenKind::Name | TokenKind::Keyword => {}
            _ => before += 1,
        }
    }
    if in_open_unit(document, before, offset) {
        return Context::Unit;
    }
    let Some(previous) = before.checked_sub(1).map(|k| &document.tokens[k]) else { return Context::Statement };
    let first = document.tokens[..before].iter().rposition(|t| ends_statement(t, text)).map_or(0, |k| k + 1);
    if first == before {
        return Context::Statement;
    }
    let role = Role::ALL.iter().any(|r| r.keyword() == document.tokens[first].text(text));
    match (previous.kind, previous.text(text)) {
        (TokenKind::Sign, ",") if role && depth(document, first, before) == 0 => Context::Nothing,
        (TokenKind::Sign | TokenKind::Open, _) => Context::Operand,
        (TokenKind::Keyword, "if" | "then" | "else" | "and" | "or" | "not") => Context::Operand,
        (TokenKind::Keyword, "prior" | "noise" | "tie") => Context::Operand,
        (TokenKind::Keyword, "free" | "fixed" | "run") => Context::Attribute,
        (TokenKind::Keyword, "per") => Context::Attribute,
        (TokenKind::Keyword, _) => Context::Nothing,
        _ if role && depth(document, first, before) == 0 => Context::Attribute,
        _ => Context::Operator,
    }
}

/// Whether a `[` that is not closed on its line stands before a byte, where a unit may stand.
fn in_open_unit(document: &Document, before: usize, offset: usize) -> bool {
    let text = document.text();
    let line = text[..offset].rfind(['\n', '\r']).map_or(0, |k| k + 1);
    let own = document.tokens[..before].iter().enumerate().rev();
    let mut own = own.take_while(|(_, t)| t.span.start as usize >= line);
    let open = own.find(|(_, t)| matches!(t.kind, TokenKind::Open | TokenKind::Close | TokenKind::Semicolon));
    let Some((at, token)) = open else { return false };
    let previous = at.checked_sub(1).map(|k| &document.tokens[k]);
    let owner = previous.is_some_and(|p| {
        let word = matches!(p.kind, TokenKind::Name | TokenKind::Number | TokenKind::Text | TokenKind::Close);
        word || p.kind == TokenKind::Keyword && matches!(p.text(text), "free" | "fixed" | "run" | "time")
    });
    token.text(text) == "[" && owner
}

fn ends_statement(token: &fdm_grammar::syntax::Token, text: &str) -> bool {
    token.kind == TokenKind::Semicolon || matches!(token.text(text), "{" | "}")
}

/// Brackets that are open between two tokens.
fn depth(document: &Document, from: usize, to: usize) -> usize {
    document.tokens[from..to].iter().fold(0, |depth: usize, t| match t.kind {
        TokenKind::Open => depth + 1,
        TokenKind::Close => depth.saturating_sub(1),
        _ => depth,
    })
}

fn statements(document: &Document) -> Vec<Item> {
    let mut items: Vec<_> = words_for(&[WordUse::Statement]).map(keyword).collect();
    let states = document.declared().filter(|d| matches!(d, Declared::Quantity(Role::State, _)));
    items.extend(states.map(|d| {
        let form = format!("der({}) = ", d.name().text);
        let mut item = word(&form, Kind::Equation);
        item.detail = Some("the equation of this state".into());
        item
    }));
    items
}

fn word(label: &str, kind: Kind) -> Item {
    Item { label: label.into(), kind, detail: None, declared: None }
}

fn keyword(text: &'static str) -> Item {
    let detail = hover::about(text.split(' ').next().unwrap_or(text)).map(String::from);
    Item { detail, ..word(text, Kind::Keyword) }
}

fn name(document: &Document, declared: Declared<'_>) -> Item {
    let kind = match declared {
        Declared::Quantity(Role::Const, _) => Kind::Constant,
        Declared::Quantity(Role::Input | Role::Output, _) => Kind::Signal,
        Declared::Table(_) => Kind::Table,
        Declared::Submodel(_) => Kind::Submodel,
        Declared::Quantity(..) => Kind::Variable,
    };
    let unit = declared.unit().map_or(String::new(), |u| format!(" [{u}]"));
    Item {
        detail: Some(format!("{}{unit}", declared.keyword())),
        declared: Some(hover::declared(document, declared)),
        ..word(&declared.name().text, kind)
    }
}

fn function(name: &str, form: &str) -> Item {
    Item { detail: Some(form.into()), ..word(name, Kind::Function) }
}
