//! What is computed when an estimation starts: constants, derived params, initial values and delays must be finite
//! there, and delays not negative.

use super::expressions::Expressions;
use super::kinds::{Kinds, Level};
use super::scope::Scope;
use super::stated::Known;
use crate::diagnostic::{Code, Diagnostic};
use crate::graph::{Graph, Leaf, Node, Signal, above_calls};
use crate::op::ExprId;
use crate::source::Span;
use crate::syntax::{Role, Size, Value};

/// Tells constants that are not finite, and what goes wrong at the start values (by param of the model).
pub(super) fn check(
    scope: &Scope<'_>,
    kinds: &Kinds,
    expressions: &Expressions,
    known: &[Known],
    start: &[f64],
    findings: &mut Vec<Diagnostic>,
) {
    let infinite = singular(&expressions.graph);
    let mut told = vec![false; scope.tree.expressions.len()];
    for (e, root) in &expressions.singular {
        let present = infinite[expressions.of(*root).index()] && !kinds.of(*root).broken;
        if present && !std::mem::replace(&mut told[root.0 as usize], true) {
            let message = match expressions.constant(*e) {
                None => "this is divided by 0",
                Some(value) if value.is_nan() => "this value is not defined",
                Some(_) => "this value is infinite",
            };
            let finding = Diagnostic::new(Code::NotFinite, scope.tree.span(*e), message);
            findings.push(
                finding.hint("look for a division by zero, an overflow, or a root or logarithm of a negative number"),
            );
        }
    }
    at_start(scope, kinds, expressions, known, start, &infinite, findings);
    // a block that must not be given a zero has said so
    let blocks: Vec<Span> = findings.iter().filter(|f| f.code == Code::BadBlock).map(|f| f.span).collect();
    let inside = |f: &Diagnostic| blocks.iter().any(|b| f.span.start <= b.start && b.end <= f.span.end);
    findings.retain(|f| f.code != Code::NotFinite || !inside(f));
}

/// For each node whether it contains a constant that is not finite, or a division by zero.
fn singular(graph: &Graph) -> Vec<bool> {
    let mut flags: Vec<bool> = Vec::with_capacity(graph.nodes().len());
    for (k, node) in graph.nodes().iter().enumerate() {
        let own = graph.is_singular(ExprId(k as u32));
        flags.push(match node {
            Node::Apply(op, args) => own || args[..op.row().arity].iter().any(|a| flags[a.index()]),
            _ => own,
        });
    }
    flags
}

fn at_start(
    scope: &Scope<'_>,
    kinds: &Kinds,
    expressions: &Expressions,
    known: &[Known],
    start: &[f64],
    infinite: &[bool],
    findings: &mut Vec<Diagnostic>,
) {
    let graph = &expressions.graph;
    let values = values(graph, start);
    // a start value that is missing or infinite has been told
    let mut untold = graph.depends(|leaf| matches!(leaf, Leaf::Param(k) if !start[k as usize].is_finite()));
    // and what foreign code says is not asked here
    untold.iter_mut().zip(above_calls(graph)).for_each(|(untold, foreign)| *untold |= foreign);
    let declared = scope.valid().filter_map(|(s, symbol)| {
        let Some(Value::Expr(root)) = symbol.declaration.value else { return None };
        match symbol.role {
            Role::Param if kinds.derived[s] => Some((root, format!("the param `{}`", symbol.name()))),
            Role::State => Some((root, format!("the initial value of `{}`", symbol.name()))),
            _ => None,
        }
    });
    let known = known.iter().map(|k| (k.root, k.words(scope)));
    for (root, subject) in declared.chain(known) {
        let (e, fact) = (expressions.of(root).index(), kinds.of(root));
        let told = fact.broken || infinite[e] || untold[e];
        if fact.level == Level::Param && !told && !values[e].is_finite() {
            let message = format!("{subject} is not finite at the start values of the params");
            let finding = Diagnostic::new(Code::NotFinite, scope.tree.span(root), message);
            findings.push(finding.hint("choose other start values"));
        }
    }
    sizes(scope, kinds, expressions, &values, findings);
    for call in &expressions.delays {
        let e = expressions.of(call.tau);
        let single = matches!(graph.node(e), Node::Leaf(Leaf::Param(_)));
        if !single && values[e.index()] < 0.0 {
            let message = format!("this delay is {} at the start values of the params", values[e.index()]);
            let finding = Diagnostic::new(Code::BadDelay, scope.tree.span(call.tau), message);
            findings.push(finding.hint("a delay is 0 or more"));
        }
    }
}

/// Arguments of blocks that are too small to begin with.
fn sizes(scope: &Scope<'_>, kinds: &Kinds, expressions: &Expressions, values: &[f64], findings: &mut Vec<Diagnostic>) {
    let wants = scope.symbols.iter().filter_map(|s| s.declaration.made.as_ref()).flat_map(|m| &m.wants);
    for want in wants {
        let (fact, value) = (kinds.of(want.argument), values[expressions.of(want.argument).index()]);
        let fits = match want.size {
            Size::Any => true,
            Size::Positive => value > 0.0,
            Size::NotZero => value != 0.0,
        };
        if fits || fact.broken || fact.level == Level::Varying || value.is_nan() {
            continue;
        }
        let least = if want.size == Size::Positive { "above 0" } else { "other than 0" };
        let start = if fact.level == Level::Param { " at the start values of the params" } else { "" };
        let message = format!("{} is {value}{start}, and must be {least}", want.what);
        let finding = Diagnostic::new(Code::BadBlock, scope.tree.span(want.argument), message);
        findings.push(match want.size {
            Size::Positive => finding.hint("start above 0, and bound it from below: `param T = 0.1 in [0.01, 1];`"),
            _ => finding.hint("leave the highest power out, or start elsewhere"),
        });
    }
}

/// Values of a graph that grows, where a run begins: parameters at their start values, states at their initial ones. NaN for
/// what is not known there: inputs, free initial values.
pub(super) struct Start<'a> {
    params: &'a [f64],
    /// Initial values of the states.
    states: Vec<f64>,
    values: Vec<f64>,
    varies: Vec<bool>,
}

impl<'a> Start<'a> {
    /// Initial values are not known yet.
    pub(super) fn new(params: &'a [f64], states: usize) -> Self {
        Self { params, states: vec![f64::NAN; states], values: Vec::new(), varies: Vec::new() }
    }

    /// Says what the states are at the beginning of a run, before expressions of them are looked at.
    pub(super) fn begin(&mut self, states: Vec<f64>) {
        self.states = states;
    }

    /// Learns about the nodes that have joined the graph.
    pub(super) fn look(&mut self, graph: &Graph) {
        for k in self.values.len()..graph.nodes().len() {
            let state = |k: u32| self.states.get(k as usize).copied().unwrap_or(f64::NAN);
            let (value, varies) = match &graph.nodes()[k] {
                Node::Constant(bits) => (f64::from_bits(*bits), false),
                Node::Leaf(Leaf::Param(k)) => (self.params[*k as usize], false),
                Node::Leaf(Leaf::State(k)) => (state(*k), true),
                Node::Leaf(Leaf::Time) => (0.0, true),
                Node::Leaf(Leaf::Input(_)) => (f64::NAN, true),
                Node::Leaf(Leaf::Delayed(d)) => match graph.delayed()[*d as usize].signal {
                    Signal::State(k) => (state(k), true),
                    Signal::Input(_) => (f64::NAN, true),
                },
                Node::Apply(op, args) => {
                    let at = |i: usize| self.values.get(args[i].index()).copied().unwrap_or(f64::NAN);
                    let varies = args[..op.row().arity].iter().any(|a| self.varies[a.index()]);
                    ((op.row().value)(at(0), at(1), at(2)), varies)
                }
            };
            self.values.push(value);
            self.varies.push(varies);
        }
    }

    /// The value of a node that was looked at.
    pub(super) fn value(&self, e: ExprId) -> f64 {
        self.values.get(e.index()).copied().unwrap_or(f64::NAN)
    }

    /// Whether a node depends on more than parameters.
    pub(super) fn varies(&self, e: ExprId) -> bool {
        self.varies.get(e.index()).copied().unwrap_or(true)
    }
}

/// The values of all nodes at the start values of the parameters; NaN for what varies.
pub(super) fn values(graph: &Graph, start: &[f64]) -> Vec<f64> {
    let mut values: Vec<f64> = Vec::with_capacity(graph.nodes().len());
    for node in graph.nodes() {
        values.push(match node {
            Node::Constant(bits) => f64::from_bits(*bits),
            Node::Leaf(Leaf::Param(k)) => start[*k as usize],
            Node::Leaf(_) => f64::NAN,
            Node::Apply(op, args) => {
                let at = |i: usize| values.get(args[i].index()).copied().unwrap_or(f64::NAN);
                (op.row().value)(at(0), at(1), at(2))
            }
        });
    }
    values
}
