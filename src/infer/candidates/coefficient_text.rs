//! Coefficients and signals of a model's text, and a coefficient written there as a table of a signal.
//!
//! `param CLa = 5;` becomes `let CLa = CLa_curve(alpha);` with a smooth table behind it: whatever stood before stays as it was written.

use fdm_effects::Subject;
use fdm_grammar::syntax::{Declaration, Role, StatementKind, SyntaxTree, parse};
use fdm_grammar::{Source, Span};

/// Digits of a node's start value, and of an abscissa beyond those that tell nodes apart.
const DIGITS: usize = 6;
const BEYOND: i32 = 3;
/// The last part of the name of a table.
const CURVE: &str = "curve";

/// A coefficient and the signal that it may depend on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Dependence {
    /// A param.
    pub(crate) coefficient: String,
    /// A state, an input or a `let`.
    pub(crate) signal: String,
}

/// A signal of the text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TextSignal {
    pub(crate) name: String,
    /// As it is declared; none where it is not.
    pub(crate) unit: Option<String>,
}

/// The nodes of a table: where they are, and what they are there.
#[derive(Debug, Clone)]
pub(crate) struct CurveNodes {
    pub(crate) at: Vec<f64>,
    pub(crate) values: Vec<f64>,
}

/// A text in which a coefficient is a table.
pub(crate) struct TabulatedText {
    pub(crate) source: Source,
    /// What its nodes are called.
    #[cfg(test)]
    nodes: Vec<String>,
}

/// Where a statement ends, without the semicolon that closes it.
fn before_semicolon(text: &str, statement: Span) -> usize {
    let own = &text[statement.range()];
    statement.start as usize + own.strip_suffix(';').unwrap_or(own).trim_end().len()
}

/// A model's text with its tree.
pub(crate) struct CoefficientText<'a> {
    subject: &'a Subject,
    tree: SyntaxTree,
}

impl<'a> CoefficientText<'a> {
    /// Of a text that compiles.
    pub(crate) fn new(subject: &'a Subject) -> Option<Self> {
        let tree = parse(subject.source()).ok()?;
        Some(Self { subject, tree })
    }

    fn declared(&self) -> impl Iterator<Item = (Role, &Declaration)> {
        self.tree.statements.iter().flat_map(|statement| match &statement.kind {
            StatementKind::Declare(role, list) => list.iter().map(|d| (*role, d)).collect::<Vec<_>>(),
            _ => Vec::new(),
        })
    }

    /// States, inputs and `let`s that are numbers.
    pub(crate) fn signals(&self) -> Vec<TextSignal> {
        let is = |role: Role| matches!(role, Role::State | Role::Input | Role::Let);
        let signals = self.declared().filter(|(role, d)| is(*role) && d.shape.is_none());
        let of = |(_, d): (Role, &Declaration)| TextSignal {
            name: d.name.text.clone(),
            unit: d.unit.as_ref().map(|u| u.text.clone()),
        };
        signals.map(of).collect()
    }

    /// The text with a table of the signal in the place of the coefficient's number.
    pub(crate) fn tabulated(
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
            // drawn towards a constant: a straight line is what other parameters of the model may do, and would be theirs and the table's
            format!("smooth {table} by order 1"),
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
        Some(TabulatedText {
            source: with_text(self.subject, text),
            #[cfg(test)]
            nodes: names,
        })
    }
}

/// Digits that tell even nodes apart, and a little more.
fn digits_of_axis(at: &[f64]) -> usize {
    let (low, high) = (at.first().copied().unwrap_or(0.0), at.last().copied().unwrap_or(0.0));
    let step = (high - low) / at.len().saturating_sub(1).max(1) as f64;
    ((low.abs().max(high.abs()) / step).log10().ceil() as i32 + BEYOND).clamp(3, 15) as usize
}

/// A number in a text.
fn number(v: f64, digits: usize) -> String {
    let short: f64 = format!("{v:.*e}", digits - 1).parse().unwrap_or(v);
    if short == 0.0 { "0".to_string() } else { short.to_string() }
}

/// A text with the files that the model was compiled with.
fn with_text(subject: &Subject, text: String) -> Source {
    let base = subject.source();
    let mut source = Source::new(base.name(), text).with_groups(base.groups().clone());
    fdm_grammar::gather(&mut source, &mut |name| {
        let text = base.find(name).map(|k| base.texts()[k].text().to_string());
        text.ok_or_else(|| "it was not there before".to_string())
    });
    source
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
    fn a_table_stands_where_a_number_did() {
        let subject = subject();
        let text = CoefficientText::new(&subject).unwrap();
        let nodes = CurveNodes { at: vec![-0.1, 0.05, 0.2, 0.35], values: vec![-6.0, -5.5, -3.0, -1.0] };
        let rad = TextSignal { name: "alpha".into(), unit: Some("rad".into()) };
        for coefficient in ["Za", "Ma", "Md", "Mq"] {
            let pair = Dependence { coefficient: coefficient.into(), signal: "alpha".into() };
            let found = text.tabulated(&pair, &rad, &nodes, "cubic").unwrap();
            let model =
                compile(&found.source).map(|c| c.model).unwrap_or_else(|e| panic!("{}: {e:?}", found.source.text()));
            assert!(model.param(coefficient).is_none() && found.nodes.iter().all(|n| model.param(n).is_some()));
            assert_eq!((model.params.len(), model.tables.len()), (7, 1), "{}", found.source.text());
            assert_eq!(model.tables[0].smooth, Some(2));
        }
        let pair = Dependence { coefficient: "Ma".into(), signal: "alpha".into() };
        let found = text.tabulated(&pair, &rad, &nodes, "cubic").unwrap();
        let wanted = "param Za = -1 [1/s], Md = -8 [1/s^2];\n      param Ma_1 = -6 in [-20, 0] [1/s^2], Ma_2 = -5.5 in [-20, 0] \
            [1/s^2], Ma_3 = -3 in [-20, 0] [1/s^2], Ma_4 = -1 in [-20, 0] [1/s^2];\n      table Ma_curve(alpha [rad]) \"stiffness\" \
            [1/s^2] = cubic { -0.1: Ma_1, 0.05: Ma_2, 0.2: Ma_3, 0.35: Ma_4 };\n      smooth Ma_curve by order 1;\n      \
            let Ma = Ma_curve(alpha) [1/s^2]; // all of them";
        assert!(found.source.text().contains(wanted), "{}", found.source.text());
    }
}
