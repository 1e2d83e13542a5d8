//! Whether an effect is sound as written.
//!
//! **In** an effect's tree. **Out** everything that is wrong with it. **Never** looks at a model: where an effect fits is a
//! matter of its conditions. **Start** at [`mistakes`]: names, lines (`lines`), expressions (`expressions`), conditions and purpose (`purpose`).

mod lines;

use fdm_grammar::diagnostic::{Code, Diagnostic, nearest};
use fdm_grammar::source::Span;
use fdm_grammar::syntax::{EffectTree, Name, Place, Role, SlotKind};
use std::collections::BTreeMap;

/// Everything that is wrong with an effect.
pub(super) fn mistakes(tree: &EffectTree) -> Vec<Diagnostic> {
    let mut check = Check { tree, names: BTreeMap::new(), findings: Vec::new() };
    check.declared();
    check.lines();
    check.conditions();
    check.purpose();
    check.findings
}

/// What a name is in an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum What {
    Slot(usize),
    Tunable,
    Own(Role),
}

struct Check<'a> {
    tree: &'a EffectTree,
    names: BTreeMap<&'a str, (What, Span)>,
    findings: Vec<Diagnostic>,
}
impl<'a> Check<'a> {
    fn tell(&mut self, code: Code, span: Span, message: String, hint: impl Into<String>) {
        let hint = hint.into();
        let found = Diagnostic::new(code, span, message);
        self.findings.push(if hint.is_empty() { found } else { found.hint(hint) });
    }

    /// The slot that a name is; what it is instead is told.
    fn target(&mut self, name: &Name) -> Option<&'a [SlotKind]> {
        match self.names.get(name.text.as_str()).map(|(what, _)| *what) {
            Some(What::Slot(k)) => Some(&self.tree.slots[k].kinds),
            Some(_) => {
                let message = format!("`{}` is the effect's own; what is changed belongs to the model", name.text);
                self.tell(Code::WrongName, name.span, message, "");
                None
            }
            None => {
                self.unknown(&name.text, name.span);
                None
            }
        }
    }

    fn place(&mut self, place: &Place, outputs: bool) -> bool {
        let Some(kinds) = self.target(&place.name) else { return false };
        let name = &place.name.text;
        let wanted = if place.derivative { SlotKind::State } else { SlotKind::Output };
        if kinds.iter().all(|k| *k == wanted) && (place.derivative || outputs) {
            return true;
        }
        let (message, hint) = if place.derivative {
            (format!("`{name}` is not always a state"), format!("declare it as `{name}: state`"))
        } else if kinds.contains(&SlotKind::State) || !outputs {
            (format!("`{name}` is not a place for this"), format!("write `der({name})` for its equation"))
        } else {
            (format!("`{name}` is not always an output"), format!("`replace {name} with ...;` changes its uses"))
        };
        self.tell(Code::WrongName, place.name.span, message, hint);
        false
    }

    fn unknown(&mut self, name: &str, span: Span) {
        let near = nearest(name, self.names.keys().copied());
        let hint = match near {
            Some(near) => format!("did you mean `{near}`?"),
            None => "an effect knows its slots and what it declares itself".into(),
        };
        self.tell(Code::UnknownName, span, format!("`{name}` is not declared"), hint);
    }
}
