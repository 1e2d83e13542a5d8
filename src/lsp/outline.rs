//! The declarations of a model as editors list them.

use super::document::{Declared, Document};
use fdm_grammar::Span;
use fdm_grammar::syntax::Role;
use lsp_types::{DocumentSymbol, SymbolKind};

/// The model with everything that it declares.
pub(super) fn symbols(document: &Document) -> Vec<DocumentSymbol> {
    let Some(tree) = &document.tree else { return Vec::new() };
    let children: Vec<_> = document.declared().map(|d| declared(document, d)).collect();
    if tree.name.text.is_empty() {
        return children;
    }
    let end = document.tokens.last().map_or(tree.name.span, |t| t.span);
    let doc = tree.doc.as_ref().map_or(String::new(), |d| d.text.clone());
    vec![symbol(
        document,
        (&tree.name.text, doc),
        SymbolKind::MODULE,
        (tree.name.span.to(end), tree.name.span),
        children,
    )]
}

fn declared(document: &Document, declared: Declared<'_>) -> DocumentSymbol {
    let kind = match declared {
        Declared::Quantity(Role::Input, _) => SymbolKind::EVENT,
        Declared::Quantity(Role::Output, _) => SymbolKind::FIELD,
        Declared::Quantity(Role::Const, _) => SymbolKind::CONSTANT,
        Declared::Quantity(Role::Param, _) => SymbolKind::PROPERTY,
        Declared::Table(_) => SymbolKind::FUNCTION,
        Declared::Submodel(_) => SymbolKind::MODULE,
        Declared::Quantity(..) => SymbolKind::VARIABLE,
    };
    let name = declared.name();
    let whole = match declared {
        Declared::Quantity(_, d) => d.span,
        _ => name.span,
    };
    let unit = declared.unit().map_or(String::new(), |u| format!(" [{u}]"));
    let detail = format!("{}{unit}", declared.keyword());
    symbol(document, (&name.text, detail), kind, (whole, name.span), Vec::new())
}

fn symbol(
    document: &Document,
    (name, detail): (&str, String),
    kind: SymbolKind,
    (whole, own): (Span, Span),
    children: Vec<DocumentSymbol>,
) -> DocumentSymbol {
    #[allow(deprecated, reason = "the protocol's type has no other way to be made")]
    DocumentSymbol {
        name: name.into(),
        detail: Some(detail),
        kind,
        tags: None,
        deprecated: None,
        range: document.range(whole.to(own)),
        selection_range: document.range(own),
        children: (!children.is_empty()).then_some(children),
    }
}
