//! `table CL(alpha) = linear { -0.2: -0.9, 0: CL0 };`: what is wrong with its nodes, and its values as expressions.

use super::expressions::Expressions;
use super::kinds::Kinds;
use super::scope::{Scope, Symbol, SymbolId};
use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::graph::Graph;
use crate::op::ExprId;
use crate::source::Span;
use crate::syntax::{Declaration, Expr, ExprRef, Role, StatementKind, SyntaxTree, Table};
use std::collections::HashMap;

use super::interpolation::Interpolant;
pub(super) use super::interpolation::Method;

/// Most points of one table, and values of one axis.
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
    let arguments = symbol.table.map_or(Vec::new(), |t| t.arguments.iter().map(|a| a.name.text.as_str()).collect());
    format!("`{}({})`", symbol.name(), arguments.join(", "))
}

/// The complaint about the name of a table that stands alone.
pub(super) fn without_argument(symbol: &Symbol<'_>, span: Span) -> Diagnostic {
    let several = symbol.table.is_some_and(|t| t.arguments.len() > 1);
    let arguments = if several { "arguments" } else { "argument" };
    let message = format!("`{}` is a table, and stands here without its {arguments}", symbol.name());
    Diagnostic::new(Code::WrongName, span, message).hint(form(symbol))
}

/// The complaint about a table with too few or too many arguments.
pub(super) fn argument_count(symbol: &Symbol<'_>, given: usize, span: Span) -> Diagnostic {
    let wanted = match symbol.table.map_or(1, |t| t.arguments.len()) {
        1 => "1 argument".to_string(),
        n => format!("{n} arguments"),
    };
    let message = format!("the table `{}` takes {wanted}, {given} given", symbol.name());
    Diagnostic::new(Code::ArgumentCount, span, message).hint(form(symbol))
}

/// Tells methods that do not exist, too few or too many nodes, and axes that do not increase.
pub(super) fn check(scope: &Scope<'_>, kinds: &Kinds, expressions: &Expressions, findings: &mut Vec<Diagnostic>) {
    for symbol in &scope.symbols {
        let Some(table) = symbol.table else { continue };
        if Method::find(&table.method.text).is_none() {
            findings.push(unknown_method(table));
        }
        let (axes, _) = table.nodes.grid();
        for (k, axis) in axes.iter().enumerate() {
            let names = AxisNames::new(table, k);
            if axis.len() < 2 {
                let message = format!("{} has a single {}", names.axis, names.one);
                let finding = Diagnostic::new(Code::BadTable, table.name.span, message);
                findings.push(finding.hint(match axes.len() {
                    1 => "a table has two points or more; a constant is a `const` or a `param`",
                    _ => "an axis has two values or more; what does not change is no argument",
                }));
            }
            if axis.len() > MOST_POINTS {
                let message =
                    format!("{} has {} {}s, more than the limit of {MOST_POINTS}", names.axis, axis.len(), names.one);
                let finding = Diagnostic::new(Code::TooLarge, table.name.span, message);
                findings.push(finding.hint("thin it out; a signal of time is an `input`"));
            }
            increasing(scope, kinds, expressions, axis, &names, findings);
        }
    }
}

/// How messages call an axis of a table and one of its values.
struct AxisNames {
    axis: String,
    increase: String,
    one: &'static str,
}

impl AxisNames {
    fn new(table: &Table, k: usize) -> Self {
        let name = &table.name.text;
        if table.arguments.len() == 1 {
            let increase = format!("the abscissae of the table `{name}` increase");
            return Self { axis: format!("the table `{name}`"), increase, one: "point" };
        }
        let axis = format!("the axis `{}` of the table `{name}`", table.arguments[k].name.text);
        Self { increase: format!("the values of {axis} increase"), axis, one: "value" }
    }
}

/// Tells the first value of an axis that is not greater than the one before it.
fn increasing(
    scope: &Scope<'_>,
    kinds: &Kinds,
    expressions: &Expressions,
    axis: &[ExprRef],
    names: &AxisNames,
    findings: &mut Vec<Diagnostic>,
) {
    let value = |e: ExprRef| expressions.constant(e).filter(|_| !kinds.of(e).broken);
    for pair in axis.windows(2) {
        let (Some(before), Some(here)) = (value(pair[0]), value(pair[1])) else { continue };
        // what is not finite has been told
        if here > before || !before.is_finite() || !here.is_finite() {
            continue;
        }
        let message = format!("{}, and {here} follows {before}", names.increase);
        let finding = Diagnostic::new(Code::BadTable, scope.tree.span(pair[1]), message);
        findings.push(match (here == before, names.one) {
            (true, "point") => finding.hint("a table has one value at each point; a jump is steep between two points"),
            (true, _) => finding.hint("each value stands there once; a jump is steep between two of them"),
            (false, "point") => finding.hint("sort the points from the least to the greatest abscissa"),
            (false, _) => {
                finding.hint("sort them from the least to the greatest, with the rows or columns behind them")
            }
        });
        return;
    }
}

/// The statements `smooth` with the tables that they are about; what is wrong with them is told.
pub(super) fn smoothness(scope: &Scope<'_>, kinds: &Kinds, findings: &mut Vec<Diagnostic>) {
    let mut first: HashMap<SymbolId, Span> = HashMap::new();
    for statement in &scope.tree.statements {
        let StatementKind::Smooth(smooth) = &statement.kind else { continue };
        let (name, span) = (&smooth.table.text, smooth.table.span);
        let Some(s) = scope.find(name) else {
            if !scope.is_suspended(name) {
                let finding = Diagnostic::new(Code::UnknownName, span, format!("`{name}` is not declared"));
                let near = scope.nearest(name, findings.len(), |s| s.role == Role::Table);
                findings.push(near.into_iter().fold(finding, Diagnostic::hint));
            }
            continue;
        };
        let symbol = &scope.symbols[s];
        let Some(table) = symbol.table else {
            let message = format!("`{name}` is a {}; smoothness is of tables", symbol.role.keyword());
            let finding = Diagnostic::new(Code::WrongName, span, message);
            findings.push(finding.hint("`smooth CL by order 2;` where `CL` is a table"));
            continue;
        };
        if let Some(earlier) = first.insert(s, span) {
            let message = format!("the smoothness of `{name}` is given a second time");
            let finding = Diagnostic::new(Code::DeclaredTwice, span, message).label(earlier, "first given here");
            findings.push(finding.hint("remove one of them"));
        }
        let (axes, values) = table.nodes.grid();
        let order = smooth.order as usize;
        if axes.iter().all(|axis| axis.len() <= order) {
            let message = format!("differences of order {order} need {} values of an axis of `{name}`", order + 1);
            let finding = Diagnostic::new(Code::BadTable, smooth.order_span, message);
            findings.push(finding.label(table.name.span, "the table is here").hint("take a lower order or more nodes"));
        }
        let params = values.iter().filter_map(|e| param(scope, kinds, *e)).count();
        let made = values.iter().find(|e| {
            !kinds.of(**e).broken
                && kinds.of(**e).level > super::kinds::Level::Constant
                && param(scope, kinds, **e).is_none()
        });
        if let Some(e) = made {
            let message = format!("this node of `{name}` is made of params, so that its smoothness cannot be chosen");
            let finding = Diagnostic::new(Code::BadTable, scope.tree.span(*e), message).label(span, "smooth here");
            findings.push(
                finding.hint(
                    "the nodes of a smooth table are numbers, or params without `log`, `per run` and `per group`",
                ),
            );
        } else if params == 0 && !values.iter().any(|e| kinds.of(*e).broken) {
            let message = format!("no node of `{name}` is estimated");
            let finding = Diagnostic::new(Code::BadTable, span, message).label(table.name.span, "the table is here");
            findings.push(finding.hint(format!("`{name}: free` estimates all of them")));
        }
    }
}

/// The param that a node is, when it has one value for all runs.
fn param(scope: &Scope<'_>, kinds: &Kinds, e: ExprRef) -> Option<SymbolId> {
    let Expr::Name(name) = scope.tree.expr(e) else { return None };
    let s = scope.find(name).filter(|s| !kinds.derived[*s])?;
    let d = scope.symbols[s].declaration;
    let shared = d.per_run.is_none() && d.group.is_none();
    (scope.symbols[s].role == Role::Param && d.log.is_none() && shared).then_some(s)
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
    known: HashMap<SymbolId, Option<Interpolant>>,
    values: HashMap<(SymbolId, Vec<ExprId>), ExprId>,
    /// Each table and the arguments that it is called with, in the order of definition.
    pub(super) calls: Vec<(SymbolId, Vec<ExprId>)>,
    count: usize,
}

impl Tables {
    /// The value of a table; that of its first argument where its nodes are faulty, which is told elsewhere.
    pub(super) fn value(
        &mut self,
        graph: &mut Graph,
        table: SymbolId,
        method: Option<Method>,
        grid: impl Fn() -> (Vec<Vec<ExprId>>, Vec<ExprId>),
        arguments: &[ExprId],
    ) -> Result<ExprId, TooManyPieces> {
        let key = (table, arguments.to_vec());
        if let Some(value) = self.values.get(&key) {
            return Ok(*value);
        }
        let known = self.known.entry(table).or_insert_with(|| {
            let (axes, values) = grid();
            let sound = axes.iter().all(|axis| axis.len() <= MOST_POINTS) && axes.len() == arguments.len();
            method.filter(|_| sound).and_then(|method| Interpolant::new(graph, method, &axes, values))
        });
        let Some(interpolant) = known else { return Ok(arguments[0]) };
        self.count += interpolant.weight();
        if self.count > MOST_PIECES {
            return Err(TooManyPieces);
        }
        let value = interpolant.at(graph, arguments);
        self.calls.push(key.clone());
        self.values.insert(key, value);
        Ok(value)
    }
}
