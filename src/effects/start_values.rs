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

    /// The text with `free` as the initial value of these states; none where one of them is no state that the text declares by itself, as those of submodels
    /// and of vectors.
    pub fn with_free_initials(&self, states: &[&str]) -> Option<Source> {
        let mut editor = Editor::new(self.source.text(), &self.tree);
        let mut missing = states.len();
        for statement in &self.tree.statements {
            let StatementKind::Declare(Role::State, list) = &statement.kind else { continue };
            for d in list.iter().filter(|d| d.shape.is_none() && states.contains(&d.name.text.as_str())) {
                missing -= 1;
                match d.value {
                    Some(Value::Expr(e)) => editor.replace(editor.value(d.span, e), "free"),
                    Some(Value::Free(_)) => (),
                    None => {
                        let end = d.name.span.range().end;
                        editor.replace(end..end, " = free");
                    }
                }
            }
        }
        (missing == 0).then(|| self.with_text(editor.finish()))
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

    #[test]
    fn an_initial_value_is_freed_and_nothing_else_changes() {
        let text = "model a { input u; state x = (1.5) /* m */ \"way\", v \"speed\"; param k = 1; // one\n\
            der(x) = v; der(v) = u - k*x; output y = x; }";
        let source = Source::new("a.fdm", text);
        let subject = Subject::new(&source, &compile(&source).unwrap().model).unwrap();
        let new = subject.with_free_initials(&["x", "v"]).unwrap();
        assert_eq!(new.text(), text.replace("= (1.5)", "= free").replace(", v ", ", v = free "));
        assert_eq!(compile(&new).unwrap().model.params.len(), 3);
        assert!(subject.with_free_initials(&["x", "z"]).is_none());
    }
}
