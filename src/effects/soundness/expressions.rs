//! Names and functions in the expressions of an effect.

use super::Check;
use crate::scales::{NAMED_REQUESTS, REQUESTS, SPECIES};
use fdm_grammar::check::{function_form, function_names};
use fdm_grammar::diagnostic::{Code, nearest};
use fdm_grammar::source::Span;
use fdm_grammar::syntax::{Expr, ExprRef, Name};

impl<'a> Check<'a> {
    /// Names and functions below a root; `asked` where numbers and requests stand, not an equation.
    pub(super) fn expression(&mut self, root: ExprRef, asked: bool) {
        let pool = &self.tree.pool;
        let mut open = vec![root];
        while let Some(e) = open.pop() {
            let span = pool.span(e);
            match pool.expr(e) {
                Expr::Name(name) => self.name(name, span, asked),
                Expr::Call(name, arguments) => {
                    self.call(name, arguments, span, asked);
                    open.extend(arguments);
                }
                Expr::Unary(_, a) => open.push(*a),
                Expr::Binary(_, a, b, _) => open.extend([*b, *a]),
                Expr::If(c, a, b) => open.extend([*b, *a, *c]),
                Expr::Vector(_) | Expr::Element(..) => {
                    self.tell(Code::Unsupported, span, "an effect has no vectors".into(), "");
                }
                Expr::Number(_) => {}
            }
        }
    }

    pub(super) fn name(&mut self, name: &str, span: Span, asked: bool) {
        let known = self.names.contains_key(name)
            || matches!(name, "t" | "pi" | "inf")
            || asked && NAMED_REQUESTS.contains(&name);
        if known {
            return;
        }
        if NAMED_REQUESTS.contains(&name) {
            let message = format!("`{name}` is asked of the data, and is no part of an equation");
            return self.tell(
                Code::WrongName,
                span,
                message,
                format!("`const {name}_0 = {name};` makes a number of it"),
            );
        }
        self.unknown(name, span);
    }

    pub(super) fn call(&mut self, name: &Name, arguments: &[ExprRef], span: Span, asked: bool) {
        let given = arguments.len();
        if let Some((_, count, form)) = REQUESTS.iter().find(|(n, ..)| *n == name.text) {
            if !asked {
                let message = format!("`{}` is asked of the data, and is no part of an equation", name.text);
                let hint = format!("`const k = {form};` makes a number of it");
                self.tell(Code::WrongName, name.span, message, hint);
            } else if given != *count {
                let message = format!("`{}` takes {count} arguments, not {given}", name.text);
                self.tell(Code::ArgumentCount, span, message, format!("`{form}`"));
            }
            return;
        }
        let species =
            SPECIES.iter().find(|(n, ..)| *n == name.text).map(|(_, count, form)| (*count, false, (*form).to_string()));
        match species.or_else(|| function_form(&name.text)) {
            Some((least, more, form)) if given < least || given > least && !more => {
                let message = format!("`{}` takes {least} arguments, not {given}", name.text);
                self.tell(Code::ArgumentCount, span, message, format!("`{form}`"));
            }
            Some(_) => {}
            None => {
                let own = SPECIES.iter().chain(REQUESTS.iter().filter(|_| asked)).map(|(n, ..)| *n);
                let names = function_names().chain(own);
                let hint = match nearest(&name.text, names) {
                    Some(near) => format!("did you mean `{near}`?"),
                    None if self.names.contains_key(name.text.as_str()) => "a product is written with `*`".into(),
                    None => String::new(),
                };
                self.tell(
                    Code::UnknownFunction,
                    name.span,
                    format!("the function `{}` does not exist", name.text),
                    hint,
                );
            }
        }
    }
}
