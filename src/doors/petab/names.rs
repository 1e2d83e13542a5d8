//! Names of SBML and PEtab as the language may declare them.

use fdm_grammar::check::reserved;
use std::collections::{BTreeMap, BTreeSet};

/// Names that are taken, and what became of those that could not be kept.
#[derive(Debug, Default)]
pub(crate) struct Names {
    taken: BTreeSet<String>,
    /// Names of the problem that are called differently in the model.
    pub(crate) renamed: BTreeMap<String, String>,
}

impl Names {
    /// A name of the problem: kept where the language allows it.
    pub(crate) fn keep(&mut self, id: &str) {
        let own = self.fresh(id);
        if own != id {
            self.renamed.insert(id.into(), own);
        }
    }

    /// What a name of the problem is called in the model.
    pub(crate) fn called<'a>(&'a self, id: &'a str) -> &'a str {
        self.renamed.get(id).map_or(id, String::as_str)
    }

    /// A name that nothing has yet, near to a wanted one.
    pub(crate) fn fresh(&mut self, wanted: &str) -> String {
        let mut plain: String =
            wanted.chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '_' }).collect();
        if !plain.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') {
            plain.insert(0, '_');
        }
        let free = |name: &str, taken: &BTreeSet<String>| reserved(name).is_none() && !taken.contains(name);
        let mut found = plain.clone();
        let mut k = 0;
        while !free(&found, &self.taken) {
            k += 1;
            found = if k == 1 { format!("{plain}_") } else { format!("{plain}_{k}") };
        }
        self.taken.insert(found.clone());
        found
    }
}
