//! Names of a text: where each is declared, where it stands, another name for it, and the outline of all.

use super::findings::changes;
use super::range;
use crate::language::document::{Declared, Document};
use fdm_grammar::Span;
use fdm_grammar::check::reserved;
use fdm_grammar::syntax::{self, Expr, ExprRef, Name, Nodes, Role, StatementKind, SyntaxTree, TokenKind};
use lsp_types::{DocumentSymbol, SymbolKind, TextEdit, Uri, WorkspaceEdit};

/// Where a name is declared.
pub(super) fn definition(document: &Document, offset: usize) -> Option<Span> {
    let (name, _) = document.name_at(offset)?;
    Some(document.find(name)?.name().span)
}

/// All places of a name, its declaration too, in the order of the text. Words of statements that cannot be read count
/// as well, so that a name keeps its meaning while one of them is being typed.
pub(super) fn places(document: &Document, name: &str) -> Vec<Span> {
    let Some(tree) = &document.tree else { return Vec::new() };
    let mut places = Places { name, found: Vec::new() };
    tree.statements.iter().for_each(|s| places.statement(tree, &s.kind));
    for (expr, span) in &tree.expressions {
        match expr {
            Expr::Name(text) => places.word(text, *span),
            Expr::Call(called, _) | Expr::Element(called, _) => places.name(called),
            _ => {}
        }
    }
    let mut read = tree.statements.iter().map(|s| s.span).peekable();
    for token in document.tokens.iter().filter(|t| t.kind == TokenKind::Name) {
        while read.next_if(|s| s.end <= token.span.start).is_some() {}
        let unread = read.peek().is_none_or(|s| token.span.start < s.start);
        if unread && token.span.start > tree.name.span.start {
            places.word(token.text(document.text()), token.span);
        }
    }
    let mut found = places.found;
    found.sort_unstable();
    found.dedup();
    found
}

struct Places<'a> {
    name: &'a str,
    found: Vec<Span>,
}

impl Places<'_> {
    fn statement(&mut self, _: &SyntaxTree, kind: &StatementKind) {
        match kind {
            StatementKind::Declare(_, list) | StatementKind::Requirement(list) => {
                list.iter().for_each(|d| self.name(&d.name));
            }
            StatementKind::Noise(list)
            | StatementKind::Process(list)
            | StatementKind::Trim(list)
            | StatementKind::Tie(list) => {
                list.iter().for_each(|(n, _): &(Name, ExprRef)| self.name(n));
            }
            StatementKind::Table(table) => {
                self.name(&table.name);
                // the names of arguments are no names of the model
                if let Nodes::Written(axes) = &table.nodes {
                    axes.iter().filter(|a| a.name.text == table.name.text).for_each(|a| self.name(&a.name));
                }
            }
            StatementKind::Smooth(smooth) => self.name(&smooth.table),
            StatementKind::Limit(list) => list.iter().for_each(|l| self.name(&l.state)),
            StatementKind::When(event) => event.resets.iter().for_each(|(name, _)| self.name(name)),
            // what stands left in its brackets are names of the submodel
            StatementKind::Use(submodel) => self.name(&submodel.alias),
            StatementKind::Reactions(_, list) => {
                let species = list.iter().flat_map(|r| r.left.iter().chain(&r.right));
                species.for_each(|s| self.name(&s.name));
            }
            StatementKind::Equation(..) | StatementKind::Time(_) | StatementKind::Prior(_) => {}
        }
    }

    fn name(&mut self, name: &Name) {
        self.word(&name.text, name.span);
    }

    /// A word, perhaps with parts (`act.y`) or an index (`x[2]`) behind the name.
    fn word(&mut self, text: &str, span: Span) {
        let own = text.split(['.', '[']).next().unwrap_or(text).trim_end();
        if own == self.name {
            let start = span.start as usize;
            self.found.push(Span::new(start, start + own.len()));
        }
    }
}

/// Another name at every place, or why not.
pub(super) fn rename(document: &Document, uri: &Uri, offset: usize, new: &str) -> Result<WorkspaceEdit, String> {
    let Some((name, _)) = document.name_at(offset) else { return Err("no name of the model stands here".into()) };
    if let Some(why) = reserved(new) {
        return Err(format!("`{new}` {why} and cannot be declared"));
    }
    let (words, comments) = syntax::tokens(new);
    match &words[..] {
        [word]
            if word.kind == TokenKind::Name && word.text(new) == new && !new.contains('.') && comments.is_empty() => {}
        _ => return Err(format!("`{new}` is not a name: letters, digits and `_`, not beginning with a digit")),
    }
    if new != name && (document.find(new).is_some() || !places(document, new).is_empty()) {
        return Err(format!("`{new}` is declared or used already"));
    }
    let edits = places(document, name).into_iter().map(|s| TextEdit::new(range(document, s), new.into()));
    Ok(changes(uri, edits.collect()))
}

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
        range: range(document, whole.to(own)),
        selection_range: range(document, own),
        children: (!children.is_empty()).then_some(children),
    }
}
