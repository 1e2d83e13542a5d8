//! The model that effects are tried on: its text, what is written there, and what it depends on.

use crate::diagnostic::Diagnostic;
use crate::graph::{Graph, Leaf, Node, Signal};
use crate::model::{Model, Origin};
use crate::op::ExprId;
use crate::source::{Source, Span};
use crate::syntax::{Declaration, Expr, ExprRef, Role, SlotKind, StatementKind, SyntaxTree, Value, parse};
use crate::unit::Unit;
use std::collections::{BTreeMap, BTreeSet};

/// A model with its text.
#[derive(Debug, Clone)]
pub struct Subject {
    pub(super) source: Source,
    pub(super) tree: SyntaxTree,
    pub(super) model: Model,
    /// By name of a state or an output: what its rate or its value depends on.
    reached: BTreeMap<String, BTreeSet<Leaf>>,
}

/// Something of the model that an effect can be attached to.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Target {
    pub(super) name: String,
    pub(super) kind: SlotKind,
    /// Place among all declared names.
    pub(super) order: usize,
}

impl Subject {
    /// Takes a text that compiles, and the model that it compiled to.
    ///
    /// # Errors
    /// What is wrong with the text.
    pub fn new(source: &Source, model: &Model) -> Result<Self, Vec<Diagnostic>> {
        let tree = parse(source)?;
        let mut reached = BTreeMap::new();
        for state in &model.states {
            reached.insert(state.quantity.name.clone(), leaves(&model.graph, state.rate));
        }
        for output in &model.outputs {
            reached.insert(output.quantity.name.clone(), leaves(&model.graph, output.expr));
        }
        Ok(Self { source: source.clone(), tree, model: model.clone(), reached })
    }

    /// The text.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// The checked model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Everything of one kind, in the order of the text: what is declared with its own name in this text, no vectors, and states
    /// with an equation `der(x) = ...;` of their own.
    pub(super) fn targets(&self, kind: SlotKind) -> Vec<Target> {
        let mut found = Vec::new();
        let mut order = 0;
        for statement in &self.tree.statements {
            let StatementKind::Declare(role, list) = &statement.kind else { continue };
            for d in list {
                order += 1;
                let fits = match kind {
                    SlotKind::Input => *role == Role::Input,
                    SlotKind::State => *role == Role::State && self.equation(&d.name.text).is_some(),
                    SlotKind::Output => *role == Role::Output,
                    SlotKind::Param => *role == Role::Param && self.is_shared_param(&d.name.text),
                };
                if fits && d.shape.is_none() {
                    found.push(Target { name: d.name.text.clone(), kind, order });
                }
            }
        }
        found
    }

    /// A declared param with one value for all runs, on which a rate or an output depends, and no delay: a delay cannot
    /// change during a run.
    fn is_shared_param(&self, name: &str) -> bool {
        let Some(k) = self.model.param(name) else { return false };
        let param = &self.model.params[k];
        let used = self.reached.values().any(|leaves| leaves.contains(&Leaf::Param(k as u32)));
        let graph = &self.model.graph;
        let delays = graph.reachable(graph.delayed().iter().map(|d| d.tau));
        let delays = delays.into_iter().any(|e| graph.node(e) == Node::Leaf(Leaf::Param(k as u32)));
        used && !delays && param.origin == Origin::Declared && !param.per_run
    }

    /// Left and right side, and the place of the statement, of `der(name) = ...;`.
    pub(super) fn equation(&self, name: &str) -> Option<(ExprRef, Span)> {
        self.tree.statements.iter().find_map(|s| {
            let StatementKind::Equation(left, right) = s.kind else { return None };
            (derived(&self.tree, left) == Some(name)).then_some((right, s.span))
        })
    }

    /// The declaration of a name, with the place of its statement.
    pub(super) fn declaration(&self, name: &str) -> Option<(Role, &Declaration, Span)> {
        self.tree.statements.iter().find_map(|s| match &s.kind {
            StatementKind::Declare(role, list) => list.iter().find(|d| d.name.text == name).map(|d| (*role, d, s.span)),
            _ => None,
        })
    }

    /// What the rate of a state or the value of an output depends on.
    pub(super) fn reached(&self, name: &str) -> Option<&BTreeSet<Leaf>> {
        self.reached.get(name)
    }

    /// The leaf that a name is.
    pub(super) fn leaf(&self, name: &str) -> Option<Leaf> {
        let at = |k: usize| k as u32;
        let model = &self.model;
        let input = model.inputs.iter().position(|i| i.is_declared() && i.quantity.name == name);
        let state = model.states.iter().position(|s| s.quantity.name == name);
        let leaf = input.map(|k| Leaf::Input(at(k))).or(state.map(|k| Leaf::State(at(k))));
        leaf.or(model.param(name).map(|k| Leaf::Param(at(k))))
    }

    /// The unit of a declared quantity, when it was given.
    pub(super) fn unit(&self, name: &str) -> Option<Unit> {
        let model = &self.model;
        let inputs = model.inputs.iter().map(|i| &i.quantity);
        let states = model.states.iter().map(|s| &s.quantity);
        let outputs = model.outputs.iter().map(|o| &o.quantity);
        let mut all = inputs.chain(states).chain(outputs).chain(model.params.iter().map(|p| &p.quantity));
        all.find(|q| q.name == name).and_then(|q| q.unit.clone())
    }

    /// Whether any unit is written in the text.
    pub(super) fn has_units(&self) -> bool {
        self.tree.statements.iter().any(|s| match &s.kind {
            StatementKind::Declare(_, list) => list.iter().any(|d| d.unit.is_some()),
            StatementKind::Time(_) => true,
            _ => false,
        })
    }

    /// Every use of a name: in right sides of equations, in values of lets and outputs, in what a submodel is connected
    /// to; the whole equation of `besides` is left out.
    pub(super) fn uses(&self, name: &str, besides: Option<&str>) -> Vec<(Span, Span)> {
        let tree = &self.tree;
        let mut found = Vec::new();
        for statement in &tree.statements {
            let mut roots: Vec<ExprRef> = Vec::new();
            match &statement.kind {
                StatementKind::Equation(left, _) if besides.is_some() && derived(tree, *left) == besides => {}
                StatementKind::Equation(left, right) => roots.extend([*left, *right]),
                StatementKind::Declare(Role::Let | Role::Output, list) => {
                    roots.extend(list.iter().filter_map(|d| match d.value {
                        Some(Value::Expr(e)) => Some(e),
                        _ => None,
                    }));
                }
                StatementKind::Use(submodel) => roots.extend(submodel.connections.iter().map(|(_, e)| *e)),
                _ => {}
            }
            while let Some(e) = roots.pop() {
                match tree.expr(e) {
                    Expr::Name(n) if n == name => found.push((tree.span(e), statement.span)),
                    // the record is not changed, and a derivative of a state is no use of it
                    Expr::Call(call, _) if call.text == "measured" => {}
                    Expr::Call(call, _) if call.text == "der" && self.is_state(name) => {}
                    expr => expr.each_operand(|o| roots.push(o)),
                }
            }
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    fn is_state(&self, name: &str) -> bool {
        self.model.states.iter().any(|s| s.quantity.name == name)
    }
}

/// The name of the state in `der(state)`.
pub(super) fn derived(tree: &SyntaxTree, left: ExprRef) -> Option<&str> {
    match tree.expr(left) {
        Expr::Call(name, arguments) if name.text == "der" && arguments.len() == 1 => match tree.expr(arguments[0]) {
            Expr::Name(state) => Some(state),
            _ => None,
        },
        _ => None,
    }
}

/// The leaves below a root; a delayed signal counts as the signal itself, with what its delay depends on.
fn leaves(graph: &Graph, root: ExprId) -> BTreeSet<Leaf> {
    let mut found = BTreeSet::new();
    let mut seen = BTreeSet::new();
    let mut open = vec![root];
    while let Some(e) = open.pop() {
        if !seen.insert(e) {
            continue;
        }
        match graph.node(e) {
            Node::Leaf(Leaf::Delayed(k)) => {
                let delayed = graph.delayed()[k as usize];
                found.insert(match delayed.signal {
                    Signal::State(i) => Leaf::State(i),
                    Signal::Input(i) => Leaf::Input(i),
                });
                open.push(delayed.tau);
            }
            Node::Leaf(leaf) => drop(found.insert(leaf)),
            _ => open.extend_from_slice(graph.operands(e)),
        }
    }
    found
}
