//! Start values of a text: what was estimated takes their place, and nothing else is touched.

use super::edit::Editor;
use super::subject::Subject;
use fdm_grammar::source::Source;
use fdm_grammar::syntax::{Role, StatementKind, Value};

impl Subject {
    /// The text with these values behind the `=` of params that it declares itself; params of submodels and vectors
    /// stay as they are.
    pub fn with_start_values(&self, values: &[(String, f64)]) -> Source {
        let mut editor = Editor::new(self.source.text(), &self.tree);
        for statement in &self.tree.statements {
            let StatementKind::Declare(Role::Param, list) = &statement.kind else { continue };
            for d in list.iter().filter(|d| d.shape.is_none()) {
                let (Some(Value::Expr(e)), Some((_, value))) =
                    (&d.value, values.iter().find(|(name, _)| *name == d.name.text))
                else {
                    continue;
                };
                let range = editor.value(d.span, *e);
                editor.replace(range, written(*value));
            }
        }
        self.with_text(editor.finish())
    }
}

/// A number as a person writes it, read back as the same.
fn written(value: f64) -> String {
    let plain = value == 0.0 || (1e-4..1e7).contains(&value.abs());
    if plain { format!("{value}") } else { format!("{value:e}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_grammar::compile;

    #[test]
    fn only_the_values_change() {
        let text = "model a { input u; state x = free; // one\n param k = (1) in [0, 9] /* two */, b=-2 , c = 3 fixed;\n\
            der(x) = u - k*x + b + c; output y = x; }";
        let source = Source::new("a.fdm", text);
        let subject = Subject::new(&source, &compile(&source).unwrap().model).unwrap();
        let values = [("k", 2.5), ("b", -1.25e-9), ("x", 7.0)].map(|(name, value)| (name.to_string(), value));
        let new = subject.with_start_values(&values);
        let wanted = text.replace("k = (1)", "k = 2.5").replace("b=-2", "b=-1.25e-9");
        assert_eq!(new.text(), wanted);
        let model = compile(&new).unwrap().model;
        assert_eq!(model.params[model.param("b").unwrap()].value, -1.25e-9);
    }
}
