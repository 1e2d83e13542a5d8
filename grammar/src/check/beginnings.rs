//! Blocks of the text to expressions, those of initial values that need others in the order of their needs.
//!
//! `initial(x)`: an expression when a run begins. States have their initial values there, inputs their first samples (before
//! which they had them too, so that a delayed signal has its first value), time is 0.
//!
//! `measured(y)`: the record of an output in the place of what is simulated.

use super::expressions::{Expressions, Indices};
use super::functions::Function;
use super::kinds::Kinds;
use super::order::{Block, Blocks, Owner};
use super::scope::{Meaning, Scope, SymbolId};
use crate::diagnostic::{Code, Diagnostic};
use crate::graph::{Graph, Leaf, Node, Signal};
use crate::model::Model;
use crate::op::{Build, ExprId, Op};
use crate::source::Span;
use crate::syntax::{Expr, ExprRef, Role, Value};
use std::collections::HashMap;

/// What building needs to know.
pub(super) struct Builder<'a, 'b> {
    pub(super) scope: &'b Scope<'a>,
    pub(super) blocks: &'b Blocks,
    pub(super) meanings: &'b [Meaning],
    pub(super) kinds: &'b Kinds,
    pub(super) indices: &'b Indices,
    /// Whether a limit has been told.
    pub(super) too_many: bool,
    pub(super) findings: &'b mut Vec<Diagnostic>,
}

/// How far an initial value is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Progress {
    New,
    Open,
    Done,
}

impl Builder<'_, '_> {
    /// Builds all nodes of a block.
    pub(super) fn block(&mut self, expressions: &mut Expressions, block: &Block) {
        for e in self.blocks.nodes(block).iter().filter(|e| !self.kinds.of(**e).broken) {
            let built = match expressions.node(self.scope, *e, self.meanings, self.indices, self.findings) {
                Ok(built) => built,
                Err(finding) => {
                    if !std::mem::replace(&mut self.too_many, true) {
                        self.findings.push(finding);
                    }
                    expressions.graph.number(0.0)
                }
            };
            expressions.nodes[e.0 as usize] = built;
            expressions.watch(self.scope, block, *e);
        }
        if let Some(state) = self.state(block) {
            let broken = self.kinds.of(block.root).broken;
            let value = if broken { expressions.graph.number(0.0) } else { expressions.of(block.root) };
            expressions.beginnings[state as usize] = Some(value);
        }
    }

    /// The index of the state whose initial value a block is.
    fn state(&self, block: &Block) -> Option<u32> {
        match block.owner {
            Owner::Value(s) if self.scope.symbols[s].valid && self.scope.symbols[s].role == Role::State => {
                Some(self.indices.of[s])
            }
            _ => None,
        }
    }

    /// Whether a block is an initial value with `initial(.)` in it.
    pub(super) fn needs_beginnings(&self, block: &Block) -> bool {
        let initial = Meaning::Function(Function::Initial);
        let calls = || self.blocks.nodes(block).iter().any(|e| self.meanings[e.0 as usize] == initial);
        self.state(block).is_some() && calls() && !self.kinds.of(block.root).broken
    }

    /// Builds initial values, each behind those that it needs.
    pub(super) fn beginnings(&mut self, expressions: &mut Expressions, later: &[&Block]) {
        let mut of_state: Vec<Option<usize>> = vec![None; expressions.beginnings.len()];
        for (b, block) in later.iter().enumerate() {
            self.state(block).into_iter().for_each(|k| of_state[k as usize] = Some(b));
        }
        let mut progress = vec![Progress::New; later.len()];
        for b in 0..later.len() {
            let mut open = vec![b];
            while let Some(b) = open.last().copied() {
                let first = progress[b] == Progress::New;
                if progress[b] == Progress::Done {
                    open.pop();
                    continue;
                }
                progress[b] = Progress::Open;
                let missing = if first { self.missing(expressions, later[b]) } else { Vec::new() };
                let waiting: Vec<usize> = missing.iter().filter_map(|k| of_state[*k as usize]).collect();
                if let Some(again) = waiting.iter().find(|w| progress[**w] == Progress::Open) {
                    self.circle(later[*again]);
                    let zero = expressions.graph.number(0.0);
                    missing.iter().for_each(|k| expressions.beginnings[*k as usize] = Some(zero));
                } else {
                    open.extend(waiting.iter().filter(|w| progress[**w] == Progress::New));
                }
                if open.last() == Some(&b) {
                    self.block(expressions, later[b]);
                    progress[b] = Progress::Done;
                    open.pop();
                }
            }
        }
    }

    /// The states without which a block cannot be built. Their expressions are built on the way.
    fn missing(&mut self, expressions: &mut Expressions, block: &Block) -> Vec<u32> {
        let mut missing = Vec::new();
        for e in self.blocks.nodes(block) {
            if self.meanings[e.0 as usize] == Meaning::Function(Function::Initial)
                && let Expr::Call(_, arguments) = self.scope.tree.expr(*e)
            {
                let argument = expressions.of(arguments[0]);
                missing.extend(expressions.initials.missing(&expressions.graph, argument, &expressions.beginnings));
                continue;
            }
            if let Ok(built) = expressions.node(self.scope, *e, self.meanings, self.indices, &mut Vec::new()) {
                expressions.nodes[e.0 as usize] = built;
            }
        }
        missing.sort_unstable();
        missing.dedup();
        missing
    }

    fn circle(&mut self, block: &Block) {
        let Owner::Value(s) = block.owner else { return };
        let s: SymbolId = s;
        let symbol = &self.scope.symbols[s];
        let span = self.scope.tree.span(block.root);
        let finding = if symbol.declaration.made.is_some() {
            let message = "what this block has at rest depends on itself";
            let hint = "write one block of the circle as a `state` with an initial value and an equation of its own";
            Diagnostic::new(Code::Cycle, span, message).hint(hint)
        } else {
            let message = format!("the initial value of `{}` depends on itself", symbol.name());
            Diagnostic::new(Code::Cycle, span, message).hint("give one of the initial values a number or a param")
        };
        self.findings.push(finding);
    }
}

/// Expressions at the beginning, in a graph that only grows.
#[derive(Default)]
pub(super) struct Initials {
    done: HashMap<ExprId, ExprId>,
    /// Inputs whose first sample is needed, in the order of their params.
    pub(super) first: Vec<u32>,
    /// Index of the first param that holds such a sample.
    from: u32,
    /// Inputs; what has a greater index is a derivative.
    inputs: u32,
}

/// What a node needs of the state whose value it is, or is made of.
fn signal(graph: &Graph, leaf: Leaf) -> Option<Signal> {
    match leaf {
        Leaf::State(k) => Some(Signal::State(k)),
        Leaf::Input(k) => Some(Signal::Input(k)),
        Leaf::Delayed(k) => Some(graph.delayed()[k as usize].signal),
        Leaf::Time | Leaf::Param(_) => None,
    }
}

impl Initials {
    /// Nothing yet; `from` is the first index that no param has.
    pub(super) fn new(from: u32, inputs: u32) -> Self {
        Self { from, inputs, ..Self::default() }
    }

    /// The nodes below `e` that have not been looked at, operands first.
    fn pending(&self, graph: &Graph, e: ExprId) -> Vec<ExprId> {
        let (mut order, mut seen, mut open) = (Vec::new(), HashMap::new(), vec![e]);
        while let Some(k) = open.pop() {
            if !self.done.contains_key(&k) && seen.insert(k, ()).is_none() {
                order.push(k);
                open.extend_from_slice(graph.operands(k));
            }
        }
        order.sort_unstable();
        order
    }

    /// States (by index) whose initial values `e` needs and which are not known yet.
    pub(super) fn missing(&self, graph: &Graph, e: ExprId, states: &[Option<ExprId>]) -> Vec<u32> {
        let state = |k: &ExprId| match graph.node(*k) {
            Node::Leaf(leaf) => match signal(graph, leaf) {
                Some(Signal::State(k)) if states.get(k as usize) == Some(&None) => Some(k),
                _ => None,
            },
            _ => None,
        };
        self.pending(graph, e).iter().filter_map(state).collect()
    }

    /// `e` at the beginning; all states that it needs are known.
    pub(super) fn of(&mut self, graph: &mut Graph, e: ExprId, states: &[Option<ExprId>]) -> ExprId {
        for k in self.pending(graph, e) {
            let value = match graph.node(k) {
                Node::Constant(_) | Node::Leaf(Leaf::Param(_)) => k,
                Node::Leaf(leaf) => match signal(graph, leaf) {
                    Some(Signal::State(state)) if (state as usize) < states.len() => {
                        states[state as usize].unwrap_or(k)
                    }
                    Some(Signal::Input(input)) if input < self.inputs => self.sample(graph, input),
                    // time, and derivatives at rest
                    _ => graph.number(0.0),
                },
                Node::Apply(op, args) => self.applied(graph, op, &args[..op.row().arity]),
            };
            self.done.insert(k, value);
        }
        self.done.get(&e).copied().unwrap_or(e)
    }

    fn applied(&self, graph: &mut Graph, op: Op, args: &[ExprId]) -> ExprId {
        let args: Vec<ExprId> = args.iter().map(|a| self.done.get(a).copied().unwrap_or(*a)).collect();
        graph.apply(op, &args)
    }

    /// The param that holds the first sample of an input.
    pub(super) fn sample(&mut self, graph: &mut Graph, input: u32) -> ExprId {
        let place = self.first.iter().position(|k| *k == input).unwrap_or_else(|| {
            self.first.push(input);
            self.first.len() - 1
        });
        graph.leaf(Leaf::Param(self.from + place as u32))
    }
}

/// The output whose record `measured(argument)` is: the output itself, or the only one that is the named state.
pub(super) fn output(scope: &Scope<'_>, argument: ExprRef, span: Span) -> Result<SymbolId, Option<Diagnostic>> {
    let Expr::Name(name) = scope.tree.expr(argument) else {
        let message = "`measured` is the record of an output, taken by its name";
        let finding = Diagnostic::new(Code::WrongName, span, message);
        return Err(Some(finding.hint("`output y = ...;` names the expression, `measured(y)` is its record")));
    };
    // what is not declared has been told
    let symbol = scope.find(name).ok_or(None)?;
    let told = |message: String, hint: String| Some(Diagnostic::new(Code::WrongName, span, message).hint(hint));
    match scope.symbols[symbol].role {
        Role::Output => Ok(symbol),
        Role::State => match &showing(scope, symbol)[..] {
            [output] => Ok(*output),
            [] => {
                let message = format!("no output is the state `{name}` itself, so that its record is not known");
                Err(told(message, format!("name an output, or add `output {name}_m = {name};`")))
            }
            several => {
                let names: Vec<String> =
                    // names that a hint lists
                    several.iter().take(4).map(|s| format!("`{}`", scope.symbols[*s].name())).collect();
                let message = format!("the state `{name}` is measured by several outputs: {}", names.join(", "));
                Err(told(message, format!("name one: `measured({})`", scope.symbols[several[0]].name())))
            }
        },
        Role::Input => Err(told(format!("`{name}` is an input, which is recorded anyway"), format!("write `{name}`"))),
        role => {
            let message = format!("`{name}` is a {}; only outputs have a record", role.keyword());
            Err(told(message, "`measured(y)` is the record of the output `y`".into()))
        }
    }
}

/// The outputs that are a state and nothing else, also by way of `let`.
fn showing(scope: &Scope<'_>, state: SymbolId) -> Vec<SymbolId> {
    let outputs = scope.valid().filter(|(_, symbol)| symbol.role == Role::Output);
    outputs.map(|(s, _)| s).filter(|s| state_shown(scope, *s) == Some(state)).collect()
}

/// The state that an output is, when it is one and nothing else.
pub(super) fn state_shown(scope: &Scope<'_>, output: SymbolId) -> Option<SymbolId> {
    let mut at = output;
    // a circle of definitions has no end
    for _ in 0..=scope.symbols.len() {
        let Some(Value::Expr(root)) = scope.symbols[at].declaration.value else { return None };
        let Expr::Name(name) = scope.tree.expr(root) else { return None };
        at = scope.find(name)?;
        match scope.symbols[at].role {
            Role::State => return Some(at),
            Role::Let | Role::Output => {}
            _ => return None,
        }
    }
    None
}

/// The outputs of which the text takes the record, in the order of their declaration.
pub(super) fn taken(meanings: &[Meaning]) -> Vec<SymbolId> {
    let taken = meanings.iter().filter_map(|m| if let Meaning::Record(s) = m { Some(*s) } else { None });
    let mut outputs: Vec<SymbolId> = taken.collect();
    outputs.sort_unstable();
    outputs.dedup();
    outputs
}

/// Warns of outputs that their own record enters without delay: what is compared would be compared with itself.
pub(super) fn circular(scope: &Scope<'_>, model: &Model, findings: &mut Vec<Diagnostic>) {
    use crate::graph::Leaf;
    for (k, input) in model.inputs.iter().enumerate() {
        // the record itself, or its derivative
        let source = input.slope.map_or(input, |slope| &model.inputs[slope.of as usize]);
        let Some(output) = source.measured else { continue };
        let own = &model.outputs[output as usize];
        let leaf = Leaf::Input(k as u32);
        let nodes = model.graph.reachable([own.expr]);
        let enters = nodes.iter().any(|e| model.graph.node(*e) == Node::Leaf(leaf));
        if let Some(s) = scope.find(&own.quantity.name).filter(|_| enters) {
            let name = &scope.symbols[s].declaration.name;
            let message =
                format!("the output `{}` contains its own record, so that it is compared with itself", name.text);
            let finding = Diagnostic::new(Code::OwnRecord, name.span, message);
            findings.push(finding.hint("use the simulated value there, or the record of another output"));
        }
    }
}
