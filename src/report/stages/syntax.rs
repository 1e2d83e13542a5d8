//! The tree of a text, written back in normal form.

use super::Shown;
use fdm_grammar::syntax::{Printer, parse_recovering};
use fdm_system::Model;
use serde_json::json;

pub(super) fn syntax(model: &Model) -> Shown {
    let source = model.source();
    let (tree, _) = parse_recovering(source);
    let Some(tree) = tree else { return Shown { text: String::new(), json: json!(null) } };
    let printer = Printer::with_source(&tree, source);
    let place = |s: &fdm_grammar::syntax::Statement| source.position(s.span.start).line;
    let statements = tree.statements.iter().map(|s| json!({ "line": place(s), "text": printer.statement(s) }));
    let json = json!({ "model": tree.name.text, "statements": statements.collect::<Vec<_>>() });
    Shown { text: format!("{}\n", printer.model().trim_end()), json }
}
