//! Texts that are long, deep or senseless: right or a clear mistake, quickly, and never a panic.

use super::{checked, told};
use crate::Span;
use crate::check::check;
use crate::stopwatch::timed;
use crate::syntax::*;
use std::time::Duration;

fn quickly<T>(what: &str, run: impl FnOnce() -> T) -> T {
    let (result, took) = timed(run);
    assert!(took < Duration::from_secs(10), "{what} took {took:?}");
    result
}

/// A tree of statements with all expressions in one array.
#[derive(Default)]
pub(super) struct Written {
    pub(super) statements: Vec<Statement>,
    pub(super) expressions: Vec<(Expr, Span)>,
}

impl Written {
    pub(super) fn expr(&mut self, expr: Expr) -> ExprRef {
        let k = self.expressions.len();
        self.expressions.push((expr, Span::new(k, k + 1)));
        ExprRef(k as u32)
    }

    pub(super) fn name(&mut self, text: &str) -> ExprRef {
        self.expr(Expr::Name(text.into()))
    }

    fn declare(&mut self, role: Role, name: &str, value: Option<ExprRef>) {
        let span = Span::new(self.statements.len(), self.statements.len() + 1);
        let mut d = Declaration::new(Name { text: name.into(), span }, span);
        d.value = value.map(Value::Expr);
        self.statements.push(Statement { kind: StatementKind::Declare(role, vec![d]), span });
    }

    pub(super) fn tree(self) -> SyntaxTree {
        SyntaxTree {
            name: Name { text: "m".into(), span: Span::default() },
            doc: None,
            statements: self.statements,
            expressions: self.expressions,
            suspended: Vec::new(),
        }
    }
}

#[test]
fn a_sum_of_200_000_terms() {
    let mut w = Written::default();
    w.declare(Role::Input, "u", None);
    w.declare(Role::Input, "v", None);
    let mut sum = w.name("u");
    for k in 0..200_000 {
        let number = w.expr(Expr::Number(f64::from(k)));
        let v = w.name("v");
        let term = w.expr(Expr::Binary(BinarySign::Multiply, number, v, Span::default()));
        sum = w.expr(Expr::Binary(BinarySign::Add, sum, term, Span::default()));
    }
    w.declare(Role::Output, "y", Some(sum));
    let tree = w.tree();
    let (model, warnings) = quickly("the sum", || check(&tree)).expect("a model");
    assert!(warnings.is_empty());
    assert_eq!(model.graph.evaluate(model.outputs[0].expr, |_| 1.0), 200_000.0 * 199_999.0 / 2.0 + 1.0);
}

#[test]
fn a_chain_of_10_000_lets_in_any_order() {
    for backwards in [false, true] {
        let lines = (0..10_000).map(|k| match k {
            0 => "let l0 = u;".to_string(),
            k => format!("let l{k} = l{} + 1;", k - 1),
        });
        let mut lines: Vec<String> = lines.collect();
        if backwards {
            lines.reverse();
        }
        let text = format!("model m {{ input u; {} output y = l9999; }}", lines.join("\n"));
        let (model, _) = quickly("the chain", || checked(&text)).expect("a model");
        assert_eq!(model.graph.evaluate(model.outputs[0].expr, |_| 0.5), 9999.5);
    }
}

#[test]
fn a_circle_of_10_000_lets_is_told_in_one_line() {
    let lines: String = (0..10_000).map(|k| format!("let l{k} = l{};\n", (k + 1) % 10_000)).collect();
    let findings = quickly("the circle", || told(&format!("model m {{ input u; {lines} output y = l0*u; }}")));
    assert_eq!(findings.len(), 1, "{findings:?}");
    assert!(findings[0].contains("(10000 names)") && findings[0].len() < 400, "{}", findings[0]);
}

#[test]
fn many_small_circles_and_many_unknown_names() {
    let lines: String = (0..5_000).map(|k| format!("let a{k} = b{k} + nowhere_{k}; let b{k} = a{k};\n")).collect();
    let findings = quickly("the circles", || told(&format!("model m {{ {lines} output y = 1; }}")));
    assert_eq!(findings.len(), 10_000);
}

#[test]
fn doubling_delays_and_squarings() {
    let delays: String = (1..60)
        .map(|k| format!("param p{k} = 1, q{k} = 2; let d{k} = delay(d{0}, p{k}) + delay(d{0}, q{k});", k - 1))
        .collect();
    let text = format!("model m {{ input u; let d0 = u; {delays} output y = d59; }}");
    let findings = quickly("the delays", || told(&text));
    let errors: Vec<_> = findings.iter().filter(|f| f.contains(" E")).collect();
    assert!(
        errors.len() == 1 && errors[0].contains("E0405 the delays of this model stand for more than"),
        "{errors:?}"
    );
    let squares: String = (1..60).map(|k| format!("let s{k} = s{0}*s{0};", k - 1)).collect();
    let text = format!("model m {{ input u [m]; let s0 = u; {squares} output y = s59; }}");
    let findings = quickly("the squarings", || told(&text));
    assert!(findings.len() == 1 && findings[0].contains("E0604"), "{findings:?}");
    assert!(quickly("pure squarings", || checked(&text.replace(" [m]", ""))).is_ok());
}

#[test]
fn findings_stand_in_the_order_of_the_text() {
    let text = "model m { output y = b; param a = 5 in [0, 1]; state x; let c = d; }";
    let findings = checked(text).expect_err("mistakes");
    assert!(findings.len() >= 4 && findings.is_sorted_by_key(|f| f.span), "{findings:?}");
}
