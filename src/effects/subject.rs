//! The model that effects are tried on: its text, what is written there, and what it depends on.

use super::conditions::are_alike;
use super::turnover::{Turnover, Turnovers};
use fdm_grammar::check::equations::Matching;
use fdm_grammar::diagnostic::Diagnostic;
use fdm_grammar::gather;
use fdm_grammar::graph::{Graph, Leaf, Node, Signal};
use fdm_grammar::model::{Model, Origin};
use fdm_grammar::op::ExprId;
use fdm_grammar::source::{Source, Span};
use fdm_grammar::syntax::{
    BinarySign, Declaration, Expr, ExprRef, Role, Shape, SlotKind, StatementKind, SyntaxTree, UnarySign, Value,
    each_root, parse,
};
use fdm_grammar::unit::Unit;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::OnceLock;

/// A model with its text.
#[derive(Debug, Clone)]
pub struct Subject {
    pub(super) source: Source,
    pub(super) tree: SyntaxTree,
    pub(super) model: Model,
    /// By name of a state: where its derivative is determined.
    balances: BTreeMap<String, Balance>,
    /// By name of a state or an output: what its balance or its value depends on.
    reached: BTreeMap<String, BTreeSet<Leaf>>,
    /// What rate constants turn over: worked out when an effect asks for it, as few do.
    turnovers: OnceLock<Turnovers>,
}

/// Something of the model that an effect can be attached to.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Target {
    pub(super) name: String,
    pub(super) kind: SlotKind,
    /// Place among all declared names.
    pub(super) order: usize,
}

/// A name of the model to which no effect can be attached.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Untried {
    /// The name.
    pub name: String,
    /// Why, in words.
    pub reason: String,
}

impl std::fmt::Display for Untried {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "nothing is tried on `{}`: {}", self.name, self.reason)
    }
}

/// An element of a vector that this text declares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Element<'n> {
    /// The vector.
    pub(super) vector: &'n str,
    /// Which element, from 0.
    pub(super) index: usize,
    /// The length of the vector.
    pub(super) length: usize,
}

impl Element<'_> {
    /// A vector with this text in the element's place and another in the others'.
    pub(super) fn in_vector(&self, own: &str, other: impl Fn(usize) -> String) -> String {
        let text = |k| if k == self.index { own.to_string() } else { other(k) };
        format!("[{}]", (0..self.length).map(text).collect::<Vec<_>>().join(", "))
    }
}

/// What a state's derivative belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Balance {
    /// An equation of this text.
    Equation(BalanceEquation),
    /// What reactions make of a species: the statement in which they stand.
    Reactions(Span),
}

impl Balance {
    /// The equation where it is no plain `der(x) = ...`: a balance of forces.
    pub(super) fn of_forces(self) -> Option<BalanceEquation> {
        match self {
            Self::Equation(equation) if !equation.is_plain => Some(equation),
            _ => None,
        }
    }
}

/// `der(x) = ...`, or in Newton's form a balance of forces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BalanceEquation {
    /// The side to which terms are added: the one without the derivative.
    pub(super) side: ExprRef,
    /// The equation.
    pub(super) statement: Span,
    /// Whether the other side is the derivative alone.
    pub(super) is_plain: bool,
    /// Whether the derivative stands there with a minus sign, so that terms are subtracted.
    pub(super) is_turned: bool,
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
        let balances = balances(&tree, model);
        let mut subject =
            Self { source: source.clone(), tree, model: model.clone(), balances, reached, turnovers: OnceLock::new() };
        // a balance of forces is its own: through the masses every rate depends on everything
        let own: Vec<(String, BTreeSet<Leaf>)> = subject
            .balances
            .iter()
            .filter_map(|(name, balance)| Some((name.clone(), subject.written_in(balance.of_forces()?.statement)?)))
            .collect();
        subject.reached.extend(own);
        Ok(subject)
    }

    /// What is written in an equation, lets looked through; none where that is not all in this text.
    fn written_in(&self, statement: Span) -> Option<BTreeSet<Leaf>> {
        let statement = self.tree.statements.iter().find(|s| s.span == statement)?;
        let StatementKind::Equation(left, right) = statement.kind else { return None };
        let (mut found, mut seen, mut open) = (BTreeSet::new(), BTreeSet::new(), vec![left, right]);
        while let Some(e) = open.pop() {
            match self.tree.expr(e) {
                Expr::Name(name) => match (self.leaf(name), value_of_let(&self.tree, name)) {
                    (Some(leaf), _) => drop(found.insert(leaf)),
                    (None, Some(value)) if seen.insert(value.0) => open.push(value),
                    (None, Some(_)) => {}
                    _ if self.is_number(name) => {}
                    _ => return None,
                },
                Expr::Call(call, _) if call.text == "der" => {}
                Expr::Element(..) => return None,
                expr => expr.each_operand(|o| open.push(o)),
            }
        }
        Some(found)
    }

    /// Whether a name is a number, or the time.
    fn is_number(&self, name: &str) -> bool {
        matches!(name, "t" | "pi" | "inf") || self.declaration(name).is_some_and(|(role, ..)| role == Role::Const)
    }

    /// The text.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// Another text in the place of this one, with the files that the model was compiled with.
    pub(super) fn with_text(&self, text: String) -> Source {
        let base = &self.source;
        let mut source = Source::new(base.name(), text).with_groups(base.groups().clone());
        gather(&mut source, &mut |name| {
            let text = base.find(name).map(|k| base.texts()[k].text().to_string());
            text.ok_or_else(|| "it was not there before".to_string())
        });
        source
    }

    /// The checked model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Everything of one kind, in the order of the text: what is declared in this text, vectors element by element, and states
    /// whose derivative an equation of this text determines.
    pub(super) fn targets(&self, kind: SlotKind) -> Vec<Target> {
        let mut found = Vec::new();
        let mut order = 0;
        for statement in &self.tree.statements {
            let StatementKind::Declare(role, list) = &statement.kind else { continue };
            for d in list {
                let is_param = kind == SlotKind::Param;
                let names = match d.shape {
                    None => vec![d.name.text.clone()],
                    Some(Shape { rows, columns: None, .. }) if !is_param => {
                        (1..=rows).map(|k| format!("{}[{k}]", d.name.text)).collect()
                    }
                    Some(_) => Vec::new(),
                };
                for name in names {
                    order += 1;
                    let fits = match kind {
                        SlotKind::Input => *role == Role::Input,
                        SlotKind::State => *role == Role::State && self.balance(&name).is_some(),
                        SlotKind::Output => *role == Role::Output,
                        SlotKind::Param => *role == Role::Param && self.is_shared_param(&name),
                    };
                    if fits {
                        found.push(Target { name, kind, order });
                    }
                }
            }
        }
        found
    }

    /// What no effect can be attached to, with the reason.
    pub(super) fn untried(&self) -> Vec<Untried> {
        let model = &self.model;
        let mut found = Vec::new();
        let mut tell = |name: &str, reason: &str| found.push(Untried { name: name.into(), reason: reason.into() });
        let submodel =
            "it belongs to a submodel: write its equations into this text, or diagnose the submodel by itself";
        for state in model.states.iter().map(|s| s.quantity.name.as_str()) {
            let declared = self.declaration(vector_of(state)).map(|(_, declaration, _)| declaration);
            match declared.map(|d| d.shape) {
                _ if self.balance(state).is_some() => {}
                None if state.contains('.') => tell(state, submodel),
                // of a block that was written out
                None => {}
                Some(Some(Shape { columns: Some(_), .. })) => tell(state, "it is part of a matrix"),
                Some(_) => tell(state, "no equation of this text is that of its derivative"),
            }
        }
        let inputs = model.inputs.iter().filter(|i| i.is_declared()).map(|i| &i.quantity.name);
        for name in inputs.chain(model.outputs.iter().map(|o| &o.quantity.name)) {
            if self.declaration(vector_of(name)).is_some_and(|(_, d, _)| d.shape.is_some_and(|s| s.columns.is_some())) {
                tell(name, "it is part of a matrix");
            }
        }
        for param in model.params.iter().filter(|p| p.origin == Origin::Declared && !p.fixed && !p.per_run) {
            let name = param.quantity.name.as_str();
            match self.declaration(vector_of(name)) {
                None if name.contains('.') => tell(name, submodel),
                Some((_, declaration, _)) if declaration.shape.is_some() => {
                    tell(name, "no effect replaces a param that is part of a vector or matrix")
                }
                Some(_) if self.delays(name) => tell(name, "a delay depends on it, which cannot change during a run"),
                _ => {}
            }
        }
        found
    }

    /// The element of a vector that a name is, such as `x[2]`.
    pub(super) fn element<'n>(&self, name: &'n str) -> Option<Element<'n>> {
        let (vector, index) = name.strip_suffix(']')?.split_once('[')?;
        let shape = self.declaration(vector)?.1.shape.filter(|shape| shape.columns.is_none())?;
        let index: usize = index.parse().ok()?;
        Some(Element { vector, index: index.checked_sub(1)?, length: shape.rows as usize })
    }

    /// A declared param with one value for all runs, on which a rate or an output depends, and no delay: a delay cannot
    /// change during a run.
    fn is_shared_param(&self, name: &str) -> bool {
        let Some(k) = self.model.param(name) else { return false };
        let param = &self.model.params[k];
        let used = self.reached.values().any(|leaves| leaves.contains(&Leaf::Param(k as u32)));
        used && !self.delays(name) && param.origin == Origin::Declared && !param.per_run
    }

    /// Whether a delay depends on a param.
    fn delays(&self, name: &str) -> bool {
        let Some(k) = self.model.param(name) else { return false };
        let graph = &self.model.graph;
        let delays = graph.reachable(graph.delayed().iter().map(|d| d.tau));
        delays.into_iter().any(|e| graph.node(e) == Node::Leaf(Leaf::Param(k as u32)))
    }

    /// Where the derivative of a state is determined.
    pub(super) fn balance(&self, name: &str) -> Option<Balance> {
        self.balances.get(name).copied()
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

    /// What a parameter does to a state, where it is the constant of a rate.
    pub(super) fn turnover(&self, param: &str, state: &str) -> Option<Turnover> {
        let model = &self.model;
        let state = model.states.iter().position(|s| s.quantity.name == state)?;
        self.turnovers.get_or_init(|| Turnovers::new(model)).of(model.param(param)?, state)
    }

    /// Species that the constant of a rate turns over in one way, in the order of the states. What it makes and does not measure as what it consumes, such as
    /// the temperature that heat of a reaction raises, is no species.
    pub(super) fn species(&self, param: &str, turnover: Turnover) -> Vec<&str> {
        let states =
            || self.model.states.iter().map(|s| s.quantity.name.as_str()).filter(|x| self.balance(x).is_some());
        let consumed = states().find(|x| self.turnover(param, x) == Some(Turnover::Consumed));
        let alike = |x: &&str| turnover == Turnover::Consumed || consumed.is_none_or(|c| are_alike(self, c, x));
        states().filter(|x| self.turnover(param, x) == Some(turnover)).filter(alike).collect()
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

    /// Every use of a name: in right sides of equations, in rates of reactions, in values of lets and outputs, in what a submodel is
    /// connected to; the whole equation of `besides` is left out. Of an element of a vector, every use of the vector.
    pub(super) fn uses(&self, name: &str, besides: Option<&str>) -> Vec<(Span, Span)> {
        let tree = &self.tree;
        let name = vector_of(name);
        let besides = besides.and_then(|state| match self.balance(state)? {
            Balance::Equation(equation) => Some(equation.statement),
            Balance::Reactions(_) => None,
        });
        let mut found = Vec::new();
        for statement in &tree.statements {
            let mut roots: Vec<ExprRef> = Vec::new();
            match &statement.kind {
                StatementKind::Equation(..) if besides == Some(statement.span) => {}
                StatementKind::Equation(left, right) => roots.extend([*left, *right]),
                StatementKind::Declare(Role::Let | Role::Output, list) => {
                    roots.extend(list.iter().filter_map(|d| match d.value {
                        Some(Value::Expr(e)) => Some(e),
                        _ => None,
                    }));
                }
                StatementKind::Use(submodel) => roots.extend(submodel.connections.iter().map(|(_, e)| *e)),
                StatementKind::Reactions(..) => each_root(&statement.kind, |e| roots.push(e)),
                _ => {}
            }
            while let Some(e) = roots.pop() {
                match tree.expr(e) {
                    Expr::Name(n) if n == name => found.push((tree.span(e), statement.span)),
                    Expr::Element(n, _) if n.text == name => found.push((n.span, statement.span)),
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
        self.model.states.iter().any(|s| vector_of(&s.quantity.name) == name)
    }
}

/// `x` for `x[2]`, and a name itself where it is no element.
pub(super) fn vector_of(name: &str) -> &str {
    name.split_once('[').map_or(name, |(vector, _)| vector)
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

/// The balance of every state of the text that has one: its own equation, or else one of those in which derivatives stand, in the
/// order of the text as far as that leaves one for each, or else the reactions in which it stands. The equation of a vector is that of each of its elements.
fn balances(tree: &SyntaxTree, model: &Model) -> BTreeMap<String, Balance> {
    let mut places: BTreeMap<&str, usize> = BTreeMap::new();
    let mut names: Vec<Vec<&str>> = Vec::new();
    for name in model.states.iter().map(|s| s.quantity.name.as_str()) {
        let place = *places.entry(vector_of(name)).or_insert(names.len());
        if place == names.len() {
            names.push(Vec::new());
        }
        names[place].push(name);
    }
    let (mut incidence, mut preferred, mut found) = (Vec::new(), Vec::new(), Vec::new());
    for statement in &tree.statements {
        let StatementKind::Equation(left, right) = statement.kind else { continue };
        let own = derived(tree, left).and_then(|state| places.get(state).copied());
        let occurrences = match own {
            Some(place) => vec![Occurrence { place, side: 0, is_turned: false }],
            None => [left, right].into_iter().enumerate().flat_map(|side| occurrences(tree, side, &places)).collect(),
        };
        incidence.push(occurrences.iter().map(|o| o.place).collect());
        preferred.push(own);
        found.push((statement.span, [left, right], occurrences));
    }
    let pairs = Matching::new(&incidence, places.len(), &preferred);
    let mut balances = BTreeMap::new();
    for ((statement, sides, occurrences), (state, own)) in found.iter().zip(pairs.of_equation.iter().zip(&preferred)) {
        // of a derivative on both sides the left one counts
        let Some(first) = occurrences.iter().find(|o| Some(o.place) == *state) else { continue };
        let balance = BalanceEquation {
            side: sides[1 - first.side],
            statement: *statement,
            is_plain: own.is_some(),
            is_turned: first.is_turned,
        };
        balances.extend(names[first.place].iter().map(|name| ((*name).to_string(), Balance::Equation(balance))));
    }
    for statement in &tree.statements {
        let StatementKind::Reactions(_, reactions) = &statement.kind else { continue };
        let species = reactions.iter().flat_map(|r| r.left.iter().chain(&r.right)).map(|s| s.name.text.as_str());
        for name in species.filter(|name| places.contains_key(name)) {
            balances.entry(name.to_string()).or_insert(Balance::Reactions(statement.span));
        }
    }
    balances
}

/// A derivative in an equation.
struct Occurrence {
    /// Which state's.
    place: usize,
    /// 0 on the left, 1 on the right.
    side: usize,
    /// Behind a minus sign.
    is_turned: bool,
}

/// The derivatives on one side of an equation, in the order of the text, each let looked through once.
fn occurrences(tree: &SyntaxTree, (side, root): (usize, ExprRef), places: &BTreeMap<&str, usize>) -> Vec<Occurrence> {
    let negative = |e: ExprRef| match tree.expr(e) {
        Expr::Unary(UnarySign::Minus, _) => true,
        Expr::Number(n) => *n < 0.0,
        _ => false,
    };
    let (mut found, mut seen, mut open) = (Vec::new(), BTreeSet::new(), vec![(root, false)]);
    while let Some((e, is_turned)) = open.pop() {
        match tree.expr(e) {
            Expr::Call(call, arguments) if call.text == "der" => {
                let state = arguments.first().map(|argument| tree.expr(*argument));
                if let Some(Expr::Name(state)) = state
                    && let Some(place) = places.get(state.as_str())
                {
                    found.push(Occurrence { place: *place, side, is_turned });
                }
            }
            Expr::Name(name) if seen.insert(name.as_str()) => {
                open.extend(value_of_let(tree, name).map(|value| (value, is_turned)));
            }
            Expr::Name(_) => {}
            Expr::Unary(UnarySign::Minus, a) => open.push((*a, !is_turned)),
            Expr::Binary(BinarySign::Subtract, a, b, _) => open.extend([(*b, !is_turned), (*a, is_turned)]),
            Expr::Binary(BinarySign::Multiply | BinarySign::Divide, a, b, _) => {
                open.extend([(*b, is_turned != negative(*a)), (*a, is_turned != negative(*b))]);
            }
            expr => {
                let first = open.len();
                expr.each_operand(|o| open.push((o, is_turned)));
                open[first..].reverse();
            }
        }
    }
    found
}

/// What a `let` of the text stands for.
pub(super) fn value_of_let(tree: &SyntaxTree, name: &str) -> Option<ExprRef> {
    tree.statements.iter().find_map(|s| match &s.kind {
        StatementKind::Declare(Role::Let, list) => match list.iter().find(|d| d.name.text == name)?.value {
            Some(Value::Expr(e)) => Some(e),
            _ => None,
        },
        _ => None,
    })
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
