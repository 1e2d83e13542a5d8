//! The tree of a text, written back in normal form.

use super::Shown;
use fdm_grammar::syntax::{Printer, parse_recovering};
use fdm_results::documents::stages::{StageDocument, StatementText, SyntaxStage};
use fdm_system::Model;

pub(super) fn syntax(model: &Model) -> Shown {
    let source = model.source();
    let (tree, _) = parse_recovering(source);
    let Some(tree) = tree else { return Shown { text: String::new(), document: StageDocument::Syntax(None) } };
    let printer = Printer::with_source(&tree, source);
    let place = |s: &fdm_grammar::syntax::Statement| source.position(s.span.start).line;
    let statements = tree.statements.iter().map(|s| StatementText { line: place(s), text: printer.statement(s) });
    let stage = SyntaxStage { model: tree.name.text.clone(), statements: statements.collect() };
    Shown { text: format!("{}\n", printer.model().trim_end()), document: StageDocument::Syntax(Some(stage)) }
}
