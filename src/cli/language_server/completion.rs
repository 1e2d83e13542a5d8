//! What can be typed at a place, and how a call that is being typed is written.

use super::document::{Declared, Document};
use super::hover;
use fdm_grammar::check::function_forms;
use fdm_grammar::syntax::{Role, TokenKind, WordUse, words_for};
use lsp_types::{
    CompletionItem, CompletionItemKind, Documentation, InsertTextFormat, MarkupContent, MarkupKind,
    ParameterInformation, ParameterLabel, SignatureHelp, SignatureInformation,
};

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
pub(super) fn items(document: &Document, offset: usize) -> Vec<CompletionItem> {
    match context(document, offset) {
        Context::Nothing => Vec::new(),
        Context::Unit => fdm_grammar::unit::symbols().map(|s| word(s, CompletionItemKind::UNIT)).collect(),
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

fn statements(document: &Document) -> Vec<CompletionItem> {
    let mut items: Vec<_> = words_for(&[WordUse::Statement]).map(keyword).collect();
    let states = document.declared().filter(|d| matches!(d, Declared::Quantity(Role::State, _)));
    items.extend(states.map(|d| {
        let form = format!("der({}) = ", d.name().text);
        let mut item = word(&form, CompletionItemKind::SNIPPET);
        item.detail = Some("the equation of this state".into());
        item
    }));
    items
}

fn word(label: &str, kind: CompletionItemKind) -> CompletionItem {
    CompletionItem { label: label.into(), kind: Some(kind), ..Default::default() }
}

fn keyword(text: &'static str) -> CompletionItem {
    let mut item = word(text, CompletionItemKind::KEYWORD);
    item.detail = hover::about(text.split(' ').next().unwrap_or(text)).map(String::from);
    item
}

fn name(document: &Document, declared: Declared<'_>) -> CompletionItem {
    let kind = match declared {
        Declared::Quantity(Role::Const, _) => CompletionItemKind::CONSTANT,
        Declared::Quantity(Role::Input | Role::Output, _) => CompletionItemKind::FIELD,
        Declared::Table(_) => CompletionItemKind::FUNCTION,
        Declared::Submodel(_) => CompletionItemKind::MODULE,
        Declared::Quantity(..) => CompletionItemKind::VARIABLE,
    };
    let mut item = word(&declared.name().text, kind);
    let unit = declared.unit().map_or(String::new(), |u| format!(" [{u}]"));
    item.detail = Some(format!("{}{unit}", declared.keyword()));
    item.documentation = Some(markdown(hover::declared(document, declared)));
    item
}

fn function(name: &str, form: &str) -> CompletionItem {
    let mut item = word(name, CompletionItemKind::FUNCTION);
    item.detail = Some(form.into());
    item.insert_text = Some(format!("{name}($0)"));
    item.insert_text_format = Some(InsertTextFormat::SNIPPET);
    item
}

fn markdown(value: String) -> Documentation {
    Documentation::MarkupContent(MarkupContent { kind: MarkupKind::Markdown, value })
}

/// The call around a byte, and which argument stands there.
pub(super) fn signature(document: &Document, offset: usize) -> Option<SignatureHelp> {
    let text = document.text();
    let end = document.tokens.partition_point(|t| (t.span.start as usize) < offset);
    let (mut closed, mut argument) = (0_usize, 0);
    for at in (0..end).rev() {
        let token = &document.tokens[at];
        match token.kind {
            TokenKind::Semicolon => return None,
            TokenKind::Close if token.span.end as usize <= offset => closed += 1,
            TokenKind::Open if closed > 0 => closed -= 1,
            TokenKind::Open => {
                let called = at.checked_sub(1).map(|k| document.tokens[k].text(text))?;
                let (_, form) = function_forms().find(|(name, _)| *name == called)?;
                return Some(help(form, argument));
            }
            TokenKind::Sign if closed == 0 && token.text(text) == "," => argument += 1,
            _ => {}
        }
    }
    None
}

fn help(form: String, argument: u32) -> SignatureHelp {
    let inside = form.split_once('(').map_or("", |(_, inside)| inside).trim_end_matches(')');
    let names: Vec<&str> = inside.split(", ").collect();
    let parameters =
        names.iter().map(|n| ParameterInformation { label: ParameterLabel::Simple((*n).into()), documentation: None });
    let parameters = Some(parameters.collect());
    let active_parameter = Some(argument.min(names.len() as u32 - 1));
    let signature = SignatureInformation { label: form, documentation: None, parameters, active_parameter };
    SignatureHelp { signatures: vec![signature], active_signature: Some(0), active_parameter }
}
