//! Builds the graph: the nodes of the text in order of definition, each name replaced by what it stands for.

use super::beginnings;
use super::beginnings::Builder;
use super::beginnings::Initials;
use super::delays::{Delays, MOST_DELAYED};
use super::delays::{Derivatives, Twice};
use super::functions::Function;
use super::kinds::Kinds;
use super::order::{Block, Blocks, Owner};
use super::scope::{Meaning, Scope, SymbolId};
use super::substitution::{Obstacle, Substitution};
use super::tables::{Method, Tables};
use crate::diagnostic::{Code, Diagnostic};
use crate::graph::{Graph, Leaf, Node, Signal};
use crate::op::{Build, ExprId, Op};
use crate::syntax::{BinarySign, Expr, ExprRef, Role, UnarySign, Value};

/// The index of each symbol among those of its kind in the model.
pub(super) struct Indices {
    /// By symbol; among inputs, states, params or derived params, and outputs.
    pub(super) of: Vec<u32>,
    /// By symbol: the parameter that is the free initial value of a state.
    pub(super) initial: Vec<Option<u32>>,
    /// By symbol: the hidden input that is the record of an output.
    pub(super) record: Vec<Option<u32>>,
    /// How many params there are.
    pub(super) params: u32,
    /// Number of states.
    states: u32,
    /// Number of inputs, records included.
    pub(super) inputs: u32,
}

impl Indices {
    /// Counts in the order of the text.
    pub(super) fn new(scope: &Scope<'_>, meanings: &[Meaning], kinds: &Kinds) -> Self {
        let count = scope.symbols.len();
        let mut indices = Self {
            of: vec![0; count],
            initial: vec![None; count],
            record: vec![None; count],
            params: 0,
            states: 0,
            inputs: 0,
        };
        let (mut inputs, mut states, mut params, mut derived, mut outputs) = (0, 0, 0, 0, 0);
        let next = |count: &mut u32| {
            *count += 1;
            *count - 1
        };
        for (s, symbol) in scope.valid() {
            indices.of[s] = match symbol.role {
                Role::Input | Role::Known => next(&mut inputs),
                Role::State => next(&mut states),
                Role::Param if kinds.derived[s] => next(&mut derived),
                Role::Param => next(&mut params),
                Role::Output => next(&mut outputs),
                Role::Const | Role::Let | Role::Table => 0,
            };
            if symbol.role == Role::State && matches!(symbol.declaration.value, Some(Value::Free(_))) {
                indices.initial[s] = Some(next(&mut params));
            }
        }
        indices.params = params;
        // hidden inputs stand behind the declared ones
        beginnings::taken(meanings).into_iter().for_each(|s| indices.record[s] = Some(next(&mut inputs)));
        (indices.states, indices.inputs) = (states, inputs);
        indices
    }
}

/// A delay in the text.
pub(super) struct DelayCall {
    /// Its second argument.
    pub(super) tau: ExprRef,
}

/// The graph and where the nodes and names of the text are in it.
pub(super) struct Expressions {
    /// All expressions.
    pub(super) graph: Graph,
    /// By node of the text; meaningless for broken ones.
    pub(super) nodes: Vec<ExprId>,
    /// By symbol: what its name stands for.
    symbols: Vec<ExprId>,
    /// Constants that are not finite although their operands are, and quotients by zero, with the roots that contain them.
    pub(super) singular: Vec<(ExprRef, ExprRef)>,
    /// Every delay.
    pub(super) delays: Vec<DelayCall>,
    /// Derivatives that were taken.
    pub(super) derivatives: Derivatives,
    /// The number 0.
    pub(super) nothing: ExprId,
    pushed: Delays,
    pub(super) tables: Tables,
    /// Expressions at the beginning of a run.
    pub(super) initials: Initials,
    /// By state: its initial value, as far as it is known.
    pub(super) beginnings: Vec<Option<ExprId>>,
}

impl Expressions {
    /// Translates all blocks.
    pub(super) fn new(
        scope: &Scope<'_>,
        blocks: &Blocks,
        meanings: &[Meaning],
        kinds: &Kinds,
        indices: &Indices,
        findings: &mut Vec<Diagnostic>,
    ) -> Self {
        let mut graph = Graph::default();
        let nothing = graph.number(0.0);
        let mut expressions = Self {
            nodes: vec![nothing; scope.tree.expressions.len()],
            symbols: vec![nothing; scope.symbols.len()],
            singular: Vec::new(),
            delays: Vec::new(),
            derivatives: Derivatives::new(indices.states, indices.inputs),
            nothing,
            pushed: Delays::default(),
            tables: Tables::default(),
            initials: Initials::new(indices.params, indices.inputs),
            beginnings: Vec::new(),
            graph,
        };
        // what a run brings is the first sample of an input that never changes
        for (s, _) in scope.valid().filter(|(_, symbol)| symbol.role == Role::Known) {
            expressions.symbols[s] = expressions.initials.sample(&mut expressions.graph, indices.of[s]);
        }
        for (s, symbol) in scope.valid().filter(|(s, _)| !kinds.derived[*s]) {
            let leaf = match symbol.role {
                Role::Input => Leaf::Input(indices.of[s]),
                Role::State => Leaf::State(indices.of[s]),
                Role::Param => Leaf::Param(indices.of[s]),
                _ => continue,
            };
            expressions.symbols[s] = expressions.graph.leaf(leaf);
        }
        expressions.known_beginnings(scope, indices);
        let mut builder = Builder { scope, blocks, meanings, kinds, indices, too_many: false, findings };
        let (later, now): (Vec<&Block>, Vec<&Block>) = blocks.list.iter().partition(|b| builder.needs_beginnings(b));
        for block in now {
            builder.block(&mut expressions, block);
            if let Owner::Value(s) = block.owner
                && (matches!(scope.symbols[s].role, Role::Let | Role::Const | Role::Output) || kinds.derived[s])
            {
                expressions.symbols[s] = expressions.nodes[block.root.0 as usize];
            }
        }
        builder.beginnings(&mut expressions, &later);
        expressions
    }

    /// Initial values that no expression gives.
    fn known_beginnings(&mut self, scope: &Scope<'_>, indices: &Indices) {
        for (s, symbol) in scope.valid().filter(|(_, symbol)| symbol.role == Role::State) {
            let value = match (indices.initial[s], symbol.declaration.value) {
                (Some(k), _) => Some(self.graph.leaf(Leaf::Param(k))),
                (None, Some(Value::Expr(_))) => None,
                (None, _) => Some(self.graph.number(0.0)),
            };
            self.beginnings.push(value);
        }
    }

    /// The expression of a node.
    pub(super) fn of(&self, e: ExprRef) -> ExprId {
        self.nodes[e.0 as usize]
    }

    /// The value of a node that depends on numbers and consts only.
    pub(super) fn constant(&self, e: ExprRef) -> Option<f64> {
        self.graph.constant(self.of(e))
    }

    pub(super) fn node(
        &mut self,
        scope: &Scope<'_>,
        e: ExprRef,
        meanings: &[Meaning],
        indices: &Indices,
        findings: &mut Vec<Diagnostic>,
    ) -> Result<ExprId, Diagnostic> {
        let meaning = meanings[e.0 as usize];
        Ok(match scope.tree.expr(e) {
            Expr::Number(value) => self.graph.number(*value),
            Expr::Name(_) => match meaning {
                Meaning::Symbol(s) => self.symbols[s],
                Meaning::Time => self.graph.leaf(Leaf::Time),
                Meaning::Infinity => self.graph.number(f64::INFINITY),
                _ => self.graph.number(std::f64::consts::PI),
            },
            Expr::Unary(UnarySign::Plus, a) => self.of(*a),
            Expr::Unary(UnarySign::Minus, a) => self.graph.apply(Op::Neg, &[self.nodes[a.0 as usize]]),
            Expr::Unary(UnarySign::Not, a) => not(&mut self.graph, self.nodes[a.0 as usize]),
            Expr::Binary(sign, a, b, _) => {
                binary(&mut self.graph, *sign, self.nodes[a.0 as usize], self.nodes[b.0 as usize])
            }
            Expr::If(c, a, b) => {
                let args = [self.of(*c), self.of(*a), self.of(*b)];
                self.graph.apply(Op::Select, &args)
            }
            Expr::Call(_, arguments) => match meaning {
                Meaning::Record(s) => match indices.record[s] {
                    Some(k) => self.graph.leaf(Leaf::Input(k)),
                    None => self.of(e),
                },
                Meaning::Table(s) => self.look_up(scope, s, arguments, e)?,
                Meaning::Function(Function::Delay) => self.delay(scope, e, arguments[0], arguments[1], findings)?,
                Meaning::Function(Function::Initial) => {
                    let argument = self.of(arguments[0]);
                    self.initials.of(&mut self.graph, argument, &self.beginnings)
                }
                Meaning::Function(Function::Der) => self.derivative(scope, e, arguments[0], findings),
                Meaning::Function(function) => {
                    let args: Vec<ExprId> = arguments.iter().map(|a| self.of(*a)).collect();
                    call(&mut self.graph, function, &args)
                }
                _ => self.of(e),
            },
            Expr::Vector(_) | Expr::Element(..) => self.of(e),
        })
    }

    /// A table's value; what is wrong with its nodes is told elsewhere.
    fn look_up(
        &mut self,
        scope: &Scope<'_>,
        s: SymbolId,
        arguments: &[ExprRef],
        call: ExprRef,
    ) -> Result<ExprId, Diagnostic> {
        let nodes = &self.nodes;
        let of = |list: &[ExprRef]| list.iter().map(|e| nodes[e.0 as usize]).collect::<Vec<_>>();
        let grid = || {
            let (axes, values) = scope.symbols[s].table.map_or_else(Default::default, |t| t.nodes.grid());
            (axes.iter().map(|axis| of(axis)).collect(), of(&values))
        };
        let method = scope.symbols[s].table.and_then(|t| Method::find(&t.method.text));
        let (graph, arguments) = (&mut self.graph, of(arguments));
        let value = self.tables.value(graph, s, method, grid, &arguments);
        value.map_err(|error| error.told(scope, s, scope.tree.span(call)))
    }

    fn derivative(
        &mut self,
        scope: &Scope<'_>,
        call: ExprRef,
        argument: ExprRef,
        findings: &mut Vec<Diagnostic>,
    ) -> ExprId {
        let e = self.of(argument);
        self.derivatives.of(&mut self.graph, e).unwrap_or_else(|Twice| {
            let message = "this is the derivative of something that contains a derivative already";
            let finding = Diagnostic::new(Code::Unsupported, scope.tree.span(call), message);
            findings.push(finding.hint("make the first derivative a `state` of its own"));
            e
        })
    }

    /// Whether a derivative of a state is in the graph.
    pub(super) fn holds_derivatives(&self) -> bool {
        let rate = |signal| matches!(signal, Signal::State(k) if k >= self.derivatives.states());
        let nodes = self.graph.nodes().iter();
        let mut leaves = nodes.filter_map(|n| if let Node::Leaf(leaf) = n { Some(*leaf) } else { None });
        leaves.any(|leaf| self.derivatives.rate(leaf).is_some()) || self.graph.delayed().iter().any(|d| rate(d.signal))
    }

    /// Brings every node of the text into the new graph, in which all derivatives are known.
    pub(super) fn transfer(&mut self, into: &mut Substitution<'_>) -> Result<(), Obstacle> {
        let calls = || self.tables.calls.iter().flat_map(|(_, arguments)| arguments);
        let all = || self.nodes.iter().chain(&self.symbols).chain([&self.nothing]).chain(calls());
        let moved: Vec<ExprId> = all().map(|e| into.moved(*e)).collect::<Result<_, _>>()?;
        let calls = self.tables.calls.iter_mut().flat_map(|(_, arguments)| arguments);
        let all = self.nodes.iter_mut().chain(&mut self.symbols).chain([&mut self.nothing]).chain(calls);
        all.zip(moved).for_each(|(e, new)| *e = new);
        Ok(())
    }

    fn delay(
        &mut self,
        scope: &Scope<'_>,
        call: ExprRef,
        argument: ExprRef,
        tau: ExprRef,
        findings: &mut Vec<Diagnostic>,
    ) -> Result<ExprId, Diagnostic> {
        if let Some(value) = self.constant(tau)
            && value < 0.0
        {
            let message = format!("a delay of {value} would look into the future");
            findings.push(Diagnostic::new(Code::BadDelay, scope.tree.span(tau), message).hint("a delay is 0 or more"));
            return Ok(self.of(argument));
        }
        self.delays.push(DelayCall { tau });
        let (e, tau) = (self.of(argument), self.of(tau));
        self.pushed.delay(&mut self.graph, e, tau).map_err(|_| {
            let message = format!("the delays of this model stand for more than {MOST_DELAYED} delayed signals");
            let finding = Diagnostic::new(Code::Unsupported, scope.tree.span(call), message);
            finding.hint("delay the signals once, with `let`, and build sums of them")
        })
    }

    /// Notes constants that stop being finite here.
    pub(super) fn watch(&mut self, scope: &Scope<'_>, block: &Block, e: ExprRef) {
        if matches!(block.owner, Owner::Lower(_) | Owner::Upper(_) | Owner::Like(_) | Owner::Limit(_)) {
            return;
        }
        let expr = scope.tree.expr(e);
        // a sign may have been taken out of a quotient
        let infinite = |e: ExprRef| match *scope.tree.expr(e) {
            Expr::Binary(BinarySign::Divide, _, under, _) if self.constant(under) == Some(0.0) => true,
            _ => self.graph.is_singular(self.of(e)),
        };
        let own = match expr {
            Expr::Name(name) => name == "inf",
            _ => true,
        };
        if own && infinite(e) {
            let mut inherited = false;
            super::order::each_operand(expr, |operand| inherited |= infinite(operand));
            if !inherited {
                self.singular.push((e, block.root));
            }
        }
    }
}

fn not(graph: &mut Graph, a: ExprId) -> ExprId {
    let zero = graph.number(0.0);
    graph.apply(Op::Equal, &[a, zero])
}

fn binary(graph: &mut Graph, sign: BinarySign, a: ExprId, b: ExprId) -> ExprId {
    let op = match sign {
        BinarySign::Add => Op::Add,
        BinarySign::Subtract => Op::Sub,
        BinarySign::Multiply => Op::Mul,
        BinarySign::Divide => Op::Div,
        BinarySign::Power => Op::Pow,
        BinarySign::Less => Op::Less,
        BinarySign::LessEqual => Op::LessEqual,
        BinarySign::Equal => Op::Equal,
        BinarySign::Greater => return graph.apply(Op::Less, &[b, a]),
        BinarySign::GreaterEqual => return graph.apply(Op::LessEqual, &[b, a]),
        BinarySign::NotEqual => {
            let equal = graph.apply(Op::Equal, &[a, b]);
            return not(graph, equal);
        }
        BinarySign::And => {
            let no = graph.number(0.0);
            return graph.apply(Op::Select, &[a, b, no]);
        }
        BinarySign::Or => {
            let yes = graph.number(1.0);
            return graph.apply(Op::Select, &[a, yes, b]);
        }
    };
    graph.apply(op, &[a, b])
}

fn call(graph: &mut Graph, function: Function, args: &[ExprId]) -> ExprId {
    if let Function::External(number) = function {
        let (number, nothing) = (graph.number(f64::from(number)), graph.number(0.0));
        let list = args.iter().fold(nothing, |list, e| graph.apply(Op::List, &[list, *e]));
        return graph.apply(Op::External, &[number, list]);
    }
    const DEGREE: f64 = std::f64::consts::PI / 180.0;
    match function {
        Function::Op(op) if args.len() > op.row().arity => {
            args.iter().copied().reduce(|a, b| graph.apply(op, &[a, b])).unwrap_or(args[0])
        }
        Function::Op(op) => graph.apply(op, args),
        Function::Clip => {
            let above = graph.apply(Op::Max, &[args[0], args[1]]);
            graph.apply(Op::Min, &[above, args[2]])
        }
        // max(x - w, 0) + min(x + w, 0): unlike a choice it lets a NaN through
        Function::Deadzone => {
            let zero = graph.number(0.0);
            let (over, under) = (graph.apply(Op::Sub, &[args[0], args[1]]), graph.apply(Op::Add, &[args[0], args[1]]));
            let (over, under) = (graph.apply(Op::Max, &[over, zero]), graph.apply(Op::Min, &[under, zero]));
            graph.apply(Op::Add, &[over, under])
        }
        Function::DegToRad => {
            let k = graph.number(DEGREE);
            graph.apply(Op::Mul, &[k, args[0]])
        }
        Function::RadToDeg => {
            let k = graph.number(1.0 / DEGREE);
            graph.apply(Op::Mul, &[k, args[0]])
        }
        // delays and records are leaves of the graph, derivatives stand on left sides
        Function::Delay | Function::Der | Function::Measured | Function::Initial | Function::External(_) => args[0],
    }
}
