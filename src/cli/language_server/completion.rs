//! What can be typed at a place in the protocol's words, and how a call that is being typed is written.

use crate::language::completion::{self, Item, Kind};
use crate::language::document::Document;
use fdm_grammar::check::function_forms;
use fdm_grammar::syntax::TokenKind;
use lsp_types::{
    CompletionItem, CompletionItemKind, Documentation, InsertTextFormat, MarkupContent, MarkupKind,
    ParameterInformation, ParameterLabel, SignatureHelp, SignatureInformation,
};

/// What can be typed at a byte.
pub(super) fn items(document: &Document, offset: usize) -> Vec<CompletionItem> {
    completion::items(document, offset).into_iter().map(item).collect()
}

fn item(own: Item) -> CompletionItem {
    let kind = match own.kind {
        Kind::Unit => CompletionItemKind::UNIT,
        Kind::Keyword => CompletionItemKind::KEYWORD,
        Kind::Equation => CompletionItemKind::SNIPPET,
        Kind::Constant => CompletionItemKind::CONSTANT,
        Kind::Signal => CompletionItemKind::FIELD,
        Kind::Function | Kind::Table => CompletionItemKind::FUNCTION,
        Kind::Submodel => CompletionItemKind::MODULE,
        Kind::Variable => CompletionItemKind::VARIABLE,
    };
    let called = own.kind == Kind::Function;
    let markdown = |value| Documentation::MarkupContent(MarkupContent { kind: MarkupKind::Markdown, value });
    CompletionItem {
        insert_text: called.then(|| format!("{}($0)", own.label)),
        insert_text_format: called.then_some(InsertTextFormat::SNIPPET),
        label: own.label,
        kind: Some(kind),
        detail: own.detail,
        documentation: own.declared.map(markdown),
        ..Default::default()
    }
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
