//! `table CL(alpha) = linear { -0.2: -0.9, 0: CL0 };`: what is wrong with its points, and its values as expressions.

use super::expressions::Expressions;
use super::kinds::Kinds;
use super::names::{Scope, Symbol, SymbolId};
use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::graph::Graph;
use crate::op::ExprId;
use crate::source::Span;
use crate::syntax::{Declaration, StatementKind, SyntaxTree, Table};
use std::collections::HashMap;

pub(super) use super::interpolation::Method;
use super::interpolation::{Pieces, pieces};

/// Most points of one table.
pub(super) const MOST_POINTS: usize = 1000;

/// Most pieces of all tables in all places where they are called, each counted once more for every param that moves it: a
/// piece costs about ten operations, and as many for each of these params.
const MOST_PIECES: usize = 100_000;

/// The tables of a text as declarations, in its order.
pub(super) fn declarations(tree: &SyntaxTree) -> Vec<Declaration> {
    let tables = tree.statements.iter().filter_map(|s| match &s.kind {
        StatementKind::Table(table) => Some((table, s.span)),
        _ => None,
    });
    let declaration = |(table, span): (&Table, Span)| {
        let (doc, unit) = (table.doc.clone(), table.unit.clone());
        Declaration { doc, unit, ..Declaration::new(table.name.clone(), span) }
    };
    tables.map(declaration).collect()
}

/// How a table is called.
fn form(symbol: &Symbol<'_>) -> String {
    let argument = symbol.table.map_or("x", |t| &t.argument.text);
    format!("`{}({argument})`", symbol.name())
}

/// The complaint about the name of a table that stands alone.
pub(super) fn without_argument(symbol: &Symbol<'_>, span: Span) -> Diagnostic {
    let message = format!("`{}` is a table, and stands here without its argument", symbol.name());
    Diagnostic::new(Code::WrongName, span, message).hint(form(symbol))
}

/// The complaint about a table with none or several arguments.
pub(super) fn argument_count(symbol: &Symbol<'_>, given: usize, span: Span) -> Diagnostic {
    let message = format!("the table `{}` takes 1 argument, {given} given", symbol.name());
    Diagnostic::new(Code::ArgumentCount, span, message).hint(form(symbol))
}

/// Tells methods that do not exist, too few or too many points, and abscissae that do not increase.
pub(super) fn check(scope: &Scope<'_>, kinds: &Kinds, expressions: &Expressions, findings: &mut Vec<Diagnostic>) {
    for symbol in &scope.symbols {
        let Some(table) = symbol.table else { continue };
        if Method::find(&table.method.text).is_none() {
            findings.push(unknown_method(table));
        }
        let (name, count) = (&table.name, table.points.len());
        if count < 2 {
            let message = format!("the table `{}` has a single point", name.text);
            let finding = Diagnostic::new(Code::BadTable, name.span, message);
            findings.push(finding.hint("a table has two points or more; a constant is a `const` or a `param`"));
        }
        if count > MOST_POINTS {
            let message = format!("the table `{}` has {count} points, more than the limit of {MOST_POINTS}", name.text);
            let finding = Diagnostic::new(Code::TooLarge, name.span, message);
            findings.push(finding.hint("thin it out; a signal of time is an `input`"));
        }
        increasing(scope, kinds, expressions, table, findings);
    }
}

/// Tells the first abscissa that is not greater than the one before it.
fn increasing(
    scope: &Scope<'_>,
    kinds: &Kinds,
    expressions: &Expressions,
    table: &Table,
    findings: &mut Vec<Diagnostic>,
) {
    let value = |k: usize| expressions.constant(table.points[k].0).filter(|_| !kinds.of(table.points[k].0).broken);
    for k in 1..table.points.len() {
        let (Some(before), Some(here)) = (value(k - 1), value(k)) else { continue };
        // what is not finite has been told
        if here > before || !before.is_finite() || !here.is_finite() {
            continue;
        }
        let message = format!("the abscissae of the table `{}` increase, and {here} follows {before}", table.name.text);
        let finding = Diagnostic::new(Code::BadTable, scope.tree.span(table.points[k].0), message);
        findings.push(match here == before {
            true => finding.hint("a table has one value at each point; a jump is steep between two points"),
            false => finding.hint("sort the points from the least to the greatest abscissa"),
        });
        return;
    }
}

fn unknown_method(table: &Table) -> Diagnostic {
    let text = &table.method.text;
    let finding = Diagnostic::new(Code::UnknownFunction, table.method.span, format!("`{text}` is not a kind of table"));
    let lower = text.to_lowercase();
    let hint = match lower.as_str() {
        "spline" | "cubicspline" | "not_a_knot" | "natural" => "a spline through the points is `cubic`".to_string(),
        "akima" | "makima" | "hermite" | "monotone" => "a curve that does not overshoot is `pchip`".to_string(),
        _ => match nearest(&lower, Method::NAMES) {
            Some(near) => format!("did you mean `{near}`?"),
            None => "a table is `linear`, `cubic` or `pchip`".to_string(),
        },
    };
    finding.hint(hint)
}

/// More pieces than [`MOST_PIECES`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TooManyPieces;

impl TooManyPieces {
    /// In the user's words.
    pub(super) fn told(self, scope: &Scope<'_>, s: SymbolId, call: Span) -> Diagnostic {
        let name = scope.symbols[s].name();
        let message = format!("with this use of `{name}` the tables of this model have more than {MOST_PIECES} pieces");
        let finding = Diagnostic::new(Code::TooLarge, call, message);
        finding.hint("give the value a name with `let`, take fewer points, or `linear` or `pchip` in place of `cubic`")
    }
}

/// The tables of a model as far as they were looked up.
#[derive(Default)]
pub(super) struct Tables {
    pieces: HashMap<SymbolId, Option<Pieces>>,
    values: HashMap<(SymbolId, ExprId), ExprId>,
    count: usize,
}

impl Tables {
    /// The value of a table; that of its argument where its points are faulty, which is told elsewhere.
    pub(super) fn value(
        &mut self,
        graph: &mut Graph,
        table: SymbolId,
        method: Option<Method>,
        points: impl Fn() -> Vec<(ExprId, ExprId)>,
        argument: ExprId,
    ) -> Result<ExprId, TooManyPieces> {
        if let Some(value) = self.values.get(&(table, argument)) {
            return Ok(*value);
        }
        let known = self.pieces.entry(table).or_insert_with(|| {
            let points = points();
            let sound = points.len() <= MOST_POINTS;
            method.filter(|_| sound).and_then(|method| pieces(graph, method, &points))
        });
        let Some(pieces) = known else { return Ok(argument) };
        self.count += pieces.weight();
        if self.count > MOST_PIECES {
            return Err(TooManyPieces);
        }
        let value = pieces.at(graph, argument);
        self.values.insert((table, argument), value);
        Ok(value)
    }
}
