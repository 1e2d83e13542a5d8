//! Coefficients and signals of a model's text, and a coefficient written there as a table of a signal.
//!
//! `param CLa = 5;` becomes `let CLa = CLa_curve(alpha);` with a smooth table behind it: whatever stood before stays as it was written.

use super::law_curve::{digits_of_axis, number, with_text};
use fdm_effects::Subject;
use fdm_grammar::syntax::{BinarySign, Declaration, Expr, ExprRef, Role, StatementKind, SyntaxTree, Value, parse};
use fdm_grammar::{Source, Span};
use std::collections::BTreeSet;

/// Digits of a node's start value.
const DIGITS: usize = 6;
/// The last part of the name of a table.
const CURVE: &str = "curve";

/// A coefficient and the signal that it may depend on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Dependence {
    /// A param.
    pub(super) coefficient: String,
    /// A state, an input or a `let`.
    pub(super) signal: String,
    /// Whether the text multiplies one by the other: then the curve is that of their product.
    pub(super) is_product: bool,
}

/// A signal of the text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct TextSignal {
    pub(super) name: String,
    /// As it is declared; none where it is not.
    pub(super) unit: Option<String>,
}

/// The nodes of a table: where they are, and what they are there.
#[derive(Debug, Clone)]
pub(super) struct CurveNodes {
    pub(super) at: Vec<f64>,
    pub(super) values: Vec<f64>,
}

/// A text in which a coefficient is a table.
pub(super) struct TabulatedText {
    pub(super) source: Source,
    /// What the table is called.
    pub(super) table: String,
    /// What its nodes are called.
    pub(super) nodes: Vec<String>,
}

/// What the output that shows a signal is called, by the signal's place.
pub(super) fn shown(place: usize) -> String {
    format!("signal_shown_{place}")
}

/// Where a statement ends, without the semicolon that closes it.
fn before_semicolon(text: &str, statement: Span) -> usize {
    let own = &text[statement.range()];
    statement.start as usize + own.strip_suffix(';').unwrap_or(own).trim_end().len()
}

/// A model's text with its tree.
pub(super) struct CoefficientText<'a> {
    subject: &'a Subject,
    tree: SyntaxTree,
}

impl<'a> CoefficientText<'a> {
    /// Of a text that compiles.
    pub(super) fn new(subject: &'a Subject) -> Option<Self> {
        let tree = parse(subject.source()).ok()?;
        Some(Self { subject, tree })
    }

    fn declared(&self) -> impl Iterator<Item = (Role, &Declaration)> {
        self.tree.statements.iter().flat_map(|statement| match &statement.kind {
            StatementKind::Declare(role, list) => list.iter().map(|d| (*role, d)).collect::<Vec<_>>(),
            _ => Vec::new(),
        })
    }

    /// Params with one value for all runs whose declaration is a number, an element of nothing.
    fn coefficients(&self) -> Vec<&str> {
        let plain = |d: &&Declaration| {
            let own = d.shape.is_none() && d.fixed.is_none() && d.per_run.is_none() && d.group.is_none();
            own && d.log.is_none() && matches!(d.value, Some(Value::Expr(_)))
        };
        let params = self.declared().filter(|(role, _)| *role == Role::Param).map(|(_, d)| d);
        params.filter(plain).map(|d| d.name.text.as_str()).collect()
    }

    /// States, inputs and `let`s that are numbers.
    pub(super) fn signals(&self) -> Vec<TextSignal> {
        let is = |role: Role| matches!(role, Role::State | Role::Input | Role::Let);
        let signals = self.declared().filter(|(role, d)| is(*role) && d.shape.is_none());
        let of = |(_, d): (Role, &Declaration)| TextSignal {
            name: d.name.text.clone(),
            unit: d.unit.as_ref().map(|u| u.text.clone()),
        };
        signals.map(of).collect()
    }

    /// Coefficients of `free` beside the signals of `moving`: products of the text first; others too where there are at most `most` in all.
    pub(super) fn dependences(&self, free: &BTreeSet<String>, moving: &[String], most: usize) -> Vec<Dependence> {
        let coefficients: Vec<&str> = self.coefficients().into_iter().filter(|p| free.contains(*p)).collect();
        let products = self.products();
        let mut found = Vec::new();
        for coefficient in &coefficients {
            for signal in moving {
                let together =
                    |factors: &BTreeSet<&str>| factors.contains(coefficient) && factors.contains(signal.as_str());
                let is_product = products.iter().any(together);
                found.push(Dependence { coefficient: (*coefficient).to_string(), signal: signal.clone(), is_product });
            }
        }
        if found.len() > most {
            found.retain(|pair| pair.is_product);
        }
        // the sort keeps the order of the text
        found.sort_by_key(|pair| !pair.is_product);
        found.truncate(most);
        found
    }

    /// Names that stand as factors of one product, for every product of the text.
    fn products(&self) -> Vec<BTreeSet<&str>> {
        let expressions = (0..self.tree.expressions.len()).map(|k| ExprRef(k as u32));
        expressions.filter_map(|e| Some(self.factors(e)).filter(|factors| factors.len() > 1)).collect()
    }

    /// Names among the factors of an expression; of a quotient those of its numerator.
    fn factors(&self, root: ExprRef) -> BTreeSet<&str> {
        let (mut found, mut open) = (BTreeSet::new(), vec![root]);
        while let Some(e) = open.pop() {
            match self.tree.expr(e) {
                Expr::Name(name) => drop(found.insert(name.as_str())),
                Expr::Unary(_, a) | Expr::Binary(BinarySign::Divide, a, ..) => open.push(*a),
                Expr::Binary(BinarySign::Multiply, a, b, _) => open.extend([*a, *b]),
                _ => (),
            }
        }
        found
    }

    /// The text with these signals as outputs behind all others.
    pub(super) fn showing(&self, signals: &[&str]) -> Option<Source> {
        let text = self.subject.source().text();
        let outputs: Vec<String> =
            signals.iter().enumerate().map(|(k, signal)| format!("{} = {signal}", shown(k))).collect();
        let own = self.tree.statements.iter().filter(|s| matches!(s.kind, StatementKind::Declare(Role::Output, _)));
        let at = own.map(|s| before_semicolon(text, s.span)).next_back()?;
        let shown = format!("{}; output {}{}", &text[..at], outputs.join(", "), &text[at..]);
        Some(with_text(self.subject, shown))
    }

    /// The text with a table of the signal in the place of the coefficient's number.
    pub(super) fn tabulated(
        &self,
        pair: &Dependence,
        signal: &TextSignal,
        nodes: &CurveNodes,
        method: &str,
    ) -> Option<TabulatedText> {
        let text = self.subject.source().text();
        let (statement, list, place) = self.tree.statements.iter().find_map(|statement| match &statement.kind {
            StatementKind::Declare(Role::Param, list) => {
                Some((statement, list, list.iter().position(|d| d.name.text == pair.coefficient)?))
            }
            _ => None,
        })?;
        let d = &list[place];
        let part = |from: u32, to: u32| text.get(from as usize..to as usize);
        let name = &pair.coefficient;
        let bracket = |unit: Option<&String>| unit.map_or(String::new(), |unit| format!(" [{unit}]"));
        let (unit, over) = (bracket(d.unit.as_ref().map(|u| &u.text)), bracket(signal.unit.as_ref()));
        let bounds = match d.bounds {
            Some(bounds) => format!(" {}", part(bounds.span.start, bounds.span.end)?.trim()),
            None => String::new(),
        };
        let doc = d.doc.as_ref().map_or(String::new(), |doc| format!(" \"{}\"", doc.text));
        let digits = digits_of_axis(&nodes.at);
        let names: Vec<String> = (1..=nodes.at.len()).map(|k| format!("{name}_{k}")).collect();
        let params: Vec<String> = names
            .iter()
            .zip(&nodes.values)
            .map(|(n, v)| format!("{n} = {}{bounds}{unit}", number(*v, DIGITS)))
            .collect();
        let points: Vec<String> =
            nodes.at.iter().zip(&names).map(|(at, n)| format!("{}: {n}", number(*at, digits))).collect();
        let table = format!("{name}_{CURVE}");
        let (start, end) = (statement.span.start as usize, before_semicolon(text, statement.span));
        let indent: String = text[..start].chars().rev().take_while(|c| matches!(c, ' ' | '\t')).collect();
        let lines = [
            format!("param {}", params.join(", ")),
            format!("table {table}({}{over}){doc}{unit} = {method} {{ {} }}", pair.signal, points.join(", ")),
            format!("smooth {table} by order 2"),
            format!("let {name} = {table}({}){unit}", pair.signal),
        ];
        let mut written = lines.join(&format!(";\n{indent}"));
        if list.len() > 1 {
            // the others stay, without one of the commas around it
            let (from, to) = match list.get(place + 1) {
                Some(next) => (d.span.start, next.span.start),
                None => (list[place - 1].span.end, d.span.end),
            };
            let kept = format!("{}{}", part(statement.span.start, from)?, part(to, end as u32)?);
            written = format!("{};\n{indent}{written}", kept.trim_end());
        }
        let text = format!("{}{written}{}", &text[..start], &text[end..]);
        Some(TabulatedText { source: with_text(self.subject, text), table, nodes: names })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_grammar::compile;

    const WING: &str = "model wing { input de [rad]; state alpha [rad], q [rad/s];
      param Za = -1 [1/s], Ma = -6 in [-20, 0] \"stiffness\" [1/s^2], Md = -8 [1/s^2]; // all of them
      param Mq = -2 [1/s];
      let twice = 2*alpha [rad];
      der(alpha) = q + Za*alpha;
      der(q) = Ma*(1 + 0*de)*alpha + Mq*q - (Md*de)/2;
      output q_m [rad/s] = q; }";

    fn subject() -> Subject {
        let source = Source::new("wing.fdm", WING);
        let model = compile(&source).unwrap().model;
        Subject::new(&source, &model).unwrap()
    }

    #[test]
    fn what_is_multiplied_comes_first() {
        let subject = subject();
        let text = CoefficientText::new(&subject).unwrap();
        let free: BTreeSet<String> = ["Za", "Ma", "Md", "Mq"].map(String::from).into();
        let moving = ["de", "alpha", "q", "twice"].map(String::from);
        let names = |pairs: &[Dependence]| -> Vec<String> {
            pairs.iter().filter(|p| p.is_product).map(|p| format!("{}({})", p.coefficient, p.signal)).collect()
        };
        let all = text.dependences(&free, &moving, 60);
        assert_eq!(
            (all.len(), names(&all)),
            (16, ["Za(alpha)", "Ma(alpha)", "Md(de)", "Mq(q)"].map(String::from).into())
        );
        assert!(all[..4].iter().all(|pair| pair.is_product));
        assert_eq!(text.dependences(&free, &moving, 15).len(), 4);
        assert_eq!(text.dependences(&free, &moving, 3).len(), 3);
    }

    #[test]
    fn a_table_stands_where_a_number_did() {
        let subject = subject();
        let text = CoefficientText::new(&subject).unwrap();
        let nodes = CurveNodes { at: vec![-0.1, 0.05, 0.2, 0.35], values: vec![-6.0, -5.5, -3.0, -1.0] };
        let rad = TextSignal { name: "alpha".into(), unit: Some("rad".into()) };
        for coefficient in ["Za", "Ma", "Md", "Mq"] {
            let pair = Dependence { coefficient: coefficient.into(), signal: "alpha".into(), is_product: true };
            let found = text.tabulated(&pair, &rad, &nodes, "cubic").unwrap();
            let model =
                compile(&found.source).map(|c| c.model).unwrap_or_else(|e| panic!("{}: {e:?}", found.source.text()));
            assert!(model.param(coefficient).is_none() && found.nodes.iter().all(|n| model.param(n).is_some()));
            assert_eq!((model.params.len(), model.tables.len()), (7, 1), "{}", found.source.text());
            assert_eq!(model.tables[0].smooth, Some(2));
        }
        let pair = Dependence { coefficient: "Ma".into(), signal: "alpha".into(), is_product: true };
        let found = text.tabulated(&pair, &rad, &nodes, "cubic").unwrap();
        let wanted = "param Za = -1 [1/s], Md = -8 [1/s^2];\n      param Ma_1 = -6 in [-20, 0] [1/s^2], Ma_2 = -5.5 in [-20, 0] \
            [1/s^2], Ma_3 = -3 in [-20, 0] [1/s^2], Ma_4 = -1 in [-20, 0] [1/s^2];\n      table Ma_curve(alpha [rad]) \"stiffness\" \
            [1/s^2] = cubic { -0.1: Ma_1, 0.05: Ma_2, 0.2: Ma_3, 0.35: Ma_4 };\n      smooth Ma_curve by order 2;\n      \
            let Ma = Ma_curve(alpha) [1/s^2]; // all of them";
        assert!(found.source.text().contains(wanted), "{}", found.source.text());
    }

    #[test]
    fn signals_are_shown_as_outputs() {
        let subject = subject();
        let text = CoefficientText::new(&subject).unwrap();
        let signals = text.signals();
        let names: Vec<&str> = signals.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(names, ["de", "alpha", "q", "twice"]);
        let model = compile(&text.showing(&names).unwrap()).unwrap().model;
        assert_eq!(model.outputs.len(), 5);
        assert_eq!(model.outputs[0].quantity.name, "q_m");
    }
}
