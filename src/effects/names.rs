//! Names of what an effect brings into a model: telling ones that the model does not have.

use fdm_grammar::check::function_form;
use fdm_grammar::syntax::{Expr, StatementKind, SyntaxTree, word_use};
use std::collections::HashSet;

/// Every name that a text uses for something, and those given since.
pub(super) struct Taken {
    names: HashSet<String>,
}

impl Taken {
    /// The names of a model.
    pub(super) fn of(tree: &SyntaxTree) -> Self {
        let mut names = HashSet::new();
        for statement in &tree.statements {
            match &statement.kind {
                StatementKind::Declare(_, list) => names.extend(list.iter().map(|d| d.name.text.clone())),
                StatementKind::Table(table) => drop(names.insert(table.name.text.clone())),
                StatementKind::Use(submodel) => drop(names.insert(submodel.alias.text.clone())),
                _ => {}
            }
        }
        // what is not declared here may come from elsewhere
        names.extend(tree.expressions.iter().filter_map(|(e, _)| match e {
            Expr::Name(name) => Some(name.clone()),
            Expr::Call(name, _) | Expr::Element(name, _) => Some(name.text.clone()),
            _ => None,
        }));
        Self { names }
    }

    /// A new name: the wanted one, with a number where it is taken.
    pub(super) fn give(&mut self, wanted: &str) -> String {
        let free = |name: &String| !self.names.contains(name) && !is_reserved(name);
        let numbered = (2..).map(|k: u32| format!("{wanted}_{k}"));
        let name = std::iter::once(wanted.to_string()).chain(numbered).find(free).unwrap_or_default();
        self.names.insert(name.clone());
        name
    }
}

/// Whether the language uses a name itself.
pub(super) fn is_reserved(name: &str) -> bool {
    word_use(name).is_some() || function_form(name).is_some()
}
