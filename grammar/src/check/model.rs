//! The checked model from its parts, once no mistake is left.

use super::declarations::Range;
use super::expressions::{Expressions, Indices};
use super::kinds::Kinds;
use super::knowledge::Knowledge;
use super::limits;
use super::order::{Block, Blocks, Owner};
use super::scope::{Scope, Symbol, SymbolId};
use crate::graph::{Graph, Leaf, Node, Reference, Signal};
use crate::model::{
    Derived, Input, Model, Origin, Output, Param, Quantity, Slope, State, Table, TableArgument, TableCalls, TableNode,
    Tie,
};
use crate::op::{Build, ExprId};
use crate::syntax::{Argument, ExprRef, Name, Role, StatementKind, Value};
use crate::unit::Unit;

/// Parameters in the order of the model: the declared ones and the free initial values.
pub(super) fn params(scope: &Scope<'_>, kinds: &Kinds, indices: &Indices, ranges: &[Range]) -> Vec<Param> {
    let mut params = Vec::new();
    for (s, symbol) in scope.valid() {
        let declared = symbol.role == Role::Param && !kinds.derived[s];
        if declared {
            params.push(declared_param(symbol, ranges[s]));
        } else if indices.initial[s].is_some() {
            params.push(free_initial(symbol, indices.of[s]));
        }
    }
    params
}

fn declared_param(symbol: &Symbol<'_>, range: Range) -> Param {
    Param {
        quantity: quantity(symbol),
        origin: Origin::Declared,
        value: range.value,
        lower: range.lower,
        upper: range.upper,
        fixed: symbol.declaration.fixed.is_some(),
        per_run: symbol.declaration.per_run.is_some(),
        group: symbol.declaration.group.as_ref().map(|g| g.text.clone()),
        logarithmic: symbol.declaration.log.is_some(),
        prior: None,
    }
}

/// Adds the params that hold first samples of inputs.
pub(super) fn first_samples(scope: &Scope<'_>, indices: &Indices, expressions: &Expressions, params: &mut Vec<Param>) {
    for input in &expressions.initials.first {
        let is = |role: Role| scope.valid().find(|(s, symbol)| symbol.role == role && indices.of[*s] == *input);
        if let Some((_, symbol)) = is(Role::Known) {
            params.push(known(quantity(symbol), *input));
            continue;
        }
        let declared = is(Role::Input);
        let record = || scope.valid().find(|(s, _)| indices.record[*s] == Some(*input));
        let (name, unit) = match (declared, record()) {
            (Some((_, symbol)), _) => (symbol.name().to_string(), symbol.unit.clone()),
            (None, Some((_, symbol))) => (format!("measured({})", symbol.name()), symbol.unit.clone()),
            (None, None) => (String::new(), None),
        };
        let quantity = Quantity { name: format!("initial({name})"), doc: String::new(), unit };
        params.push(Param { fixed: true, ..Param::open(quantity, Origin::FirstSample(*input)) });
    }
}

/// A value that each run brings.
fn known(quantity: Quantity, input: u32) -> Param {
    Param { fixed: true, per_run: true, ..Param::open(quantity, Origin::FirstSample(input)) }
}

/// Start values; NaN for what the records say.
pub(super) fn start(params: &[Param]) -> Vec<f64> {
    let value = |p: &Param| if let Origin::FirstSample(_) = p.origin { f64::NAN } else { p.value };
    params.iter().map(value).collect()
}

fn free_initial(symbol: &Symbol<'_>, state: u32) -> Param {
    let own = quantity(symbol);
    let doc = if own.doc.is_empty() { String::new() } else { format!("initial value of {}", own.doc) };
    let quantity = Quantity { name: format!("{}(0)", own.name), doc, unit: own.unit };
    Param { per_run: true, ..Param::open(quantity, Origin::FreeInitial(state)) }
}

fn quantity(symbol: &Symbol<'_>) -> Quantity {
    Quantity { name: symbol.name().to_string(), doc: text(&symbol.declaration.doc), unit: symbol.unit.clone() }
}

fn text(doc: &Option<Name>) -> String {
    doc.as_ref().map_or(String::new(), |d| d.text.clone())
}

/// Ties in the order of definition.
pub(super) fn ties(blocks: &Blocks, indices: &Indices, expressions: &Expressions) -> Vec<Tie> {
    let tie = |block: &Block| match block.owner {
        Owner::Tie(s) => Some(Tie { param: indices.of[s], expr: expressions.of(block.root) }),
        _ => None,
    };
    blocks.list.iter().filter_map(tie).collect()
}

/// Puts the parts together; the model has passed every check.
pub(super) fn assemble(
    scope: &Scope<'_>,
    rates: &[Option<ExprId>],
    kinds: &Kinds,
    indices: &Indices,
    expressions: Expressions,
    (params, ties): (Vec<Param>, Vec<Tie>),
    knowledge: Knowledge,
) -> Model {
    let value = |symbol: &Symbol<'_>| match symbol.declaration.value {
        Some(Value::Expr(root)) => Some(expressions.of(root)),
        _ => None,
    };
    let mut graph = expressions.graph.clone();
    let zero = graph.number(0.0);
    let initial = |graph: &mut Graph, s: SymbolId, symbol: &Symbol<'_>| match indices.initial[s] {
        Some(k) => graph.leaf(Leaf::Param(k)),
        None => value(symbol).unwrap_or(zero),
    };
    let mut model = Model {
        name: scope.tree.name.text.clone(),
        doc: text(&scope.tree.doc),
        time: scope.time.clone(),
        inputs: Vec::new(),
        states: Vec::new(),
        params,
        derived: Vec::new(),
        ties,
        outputs: Vec::new(),
        trim: Vec::new(),
        tables: tables(scope, kinds, indices, &expressions),
        requirements: None,
        graph: Default::default(),
    };
    for (s, symbol) in scope.valid() {
        let (quantity, expr) = (quantity(symbol), value(symbol).unwrap_or(zero));
        match symbol.role {
            Role::Input | Role::Known => {
                let known = symbol.role == Role::Known;
                let (held, membership) =
                    (symbol.declaration.hold.map(|hold| hold.held), symbol.declaration.membership.clone());
                model.inputs.push(Input { known, membership, held, ..Input::new(quantity) });
            }
            Role::State => {
                let initial = initial(&mut graph, s, symbol);
                model.states.push(State {
                    quantity,
                    rate: rates[indices.of[s] as usize].unwrap_or(zero),
                    initial,
                    noise: None,
                    limits: None,
                    resets: Vec::new(),
                });
            }
            Role::Param if kinds.derived[s] => model.derived.push(Derived { quantity, expr, tied: false }),
            Role::Output => {
                let wrap = symbol.declaration.wrap.as_ref().map(|w| w.period);
                model.outputs.push(Output { wrap, ..Output::new(quantity, expr) });
            }
            Role::Param | Role::Const | Role::Let | Role::Table => {}
        }
    }
    for (s, symbol) in scope.valid().filter(|(s, _)| indices.record[*s].is_some()) {
        model.inputs.push(Input::measured(indices.of[s], &quantity(symbol)));
    }
    for of in expressions.derivatives.slopes() {
        let slope = slope(&model, *of, false);
        model.inputs.push(slope);
    }
    model.graph = graph;
    learn(&mut model, knowledge);
    limits::stop(&mut model);
    show_slopes(&mut model, indices.inputs as usize);
    drop_unused_delays(&mut model);
    model
}

/// The tables of a model that has passed every check.
fn tables(scope: &Scope<'_>, kinds: &Kinds, indices: &Indices, expressions: &Expressions) -> Vec<Table> {
    let mut tables = Vec::new();
    for (s, symbol) in scope.valid() {
        let Some(table) = symbol.table else { continue };
        let (axes, values) = table.nodes.grid();
        let argument = |(argument, axis): (&Argument, &Vec<ExprRef>)| TableArgument {
            name: argument.name.text.clone(),
            unit: argument.unit.as_ref().and_then(|u| Unit::parse(&u.text).ok()),
            axis: axis.iter().filter_map(|e| expressions.constant(*e)).collect(),
        };
        let node = |e: &ExprRef| match (expressions.constant(*e), expressions.graph.node(expressions.of(*e))) {
            (Some(value), _) => TableNode::Number(value),
            (None, Node::Leaf(Leaf::Param(k))) => {
                let own = |s: SymbolId| !kinds.derived[s] && indices.of[s] == k;
                match scope.valid().find(|(s, d)| d.role == Role::Param && own(*s)) {
                    Some((_, symbol)) => TableNode::Param(symbol.name().into()),
                    None => TableNode::Expression,
                }
            }
            _ => TableNode::Expression,
        };
        let calls = expressions.tables.calls.iter().filter(|(of, _)| *of == s);
        let calls: Vec<&Vec<ExprId>> = calls.map(|(_, arguments)| arguments).collect();
        let all: Vec<ExprId> = calls.iter().flat_map(|arguments| arguments.iter().copied()).collect();
        let mut graph = Graph::default();
        let moved = expressions.graph.rebuild(&all, &mut graph, Graph::reference);
        let arguments = moved.chunks_exact(table.arguments.len()).map(<[ExprId]>::to_vec).collect();
        let smooth = scope.tree.statements.iter().find_map(|statement| match &statement.kind {
            StatementKind::Smooth(smooth) if smooth.table.text == table.name.text => Some(smooth.order),
            _ => None,
        });
        tables.push(Table {
            quantity: quantity(symbol),
            method: table.method.text.clone(),
            arguments: table.arguments.iter().zip(&axes).map(argument).collect(),
            nodes: values.iter().map(node).collect(),
            calls: TableCalls { graph, arguments },
            smooth,
        });
    }
    tables
}

/// Adds what is known beside the equations.
fn learn(model: &mut Model, knowledge: Knowledge) {
    for (k, prior) in knowledge.priors {
        model.params[k as usize].prior = Some(prior);
    }
    for (k, deviation) in knowledge.noise {
        model.outputs[k as usize].noise = Some(deviation);
    }
    for (k, deviation) in knowledge.noise_models {
        model.outputs[k as usize].noise_model = Some(deviation);
    }
    for (k, intensity) in knowledge.process {
        model.states[k as usize].noise = Some(intensity);
    }
    model.trim = knowledge.trim;
    for (k, limits) in knowledge.limits {
        model.states[k as usize].limits = Some(limits);
    }
    for (k, reset) in knowledge.resets {
        model.states[k as usize].resets.push(reset);
    }
}

/// The hidden input for the derivative of an input.
fn slope(model: &Model, of: u32, shown: bool) -> Input {
    let own = &model.inputs[of as usize].quantity;
    let where_ = if shown { " at samples" } else { "" };
    let unit = own.unit.as_ref().and_then(|u| u.quotient(&model.time));
    let quantity = Quantity { name: format!("der({}){where_}", own.name), doc: String::new(), unit };
    Input { slope: Some(Slope { of, shown }), ..Input::new(quantity) }
}

/// Derivatives of inputs that outputs show are taken at the samples; `first` is the first hidden input for a derivative.
fn show_slopes(model: &mut Model, first: usize) {
    let used = |model: &Model, roots: Vec<ExprId>| {
        let mut used = vec![false; model.inputs.len()];
        for e in model.graph.reachable(roots) {
            match model.graph.node(e) {
                Node::Leaf(Leaf::Input(k)) => used[k as usize] = true,
                Node::Leaf(Leaf::Delayed(d)) => {
                    if let Signal::Input(k) = model.graph.delayed()[d as usize].signal {
                        used[k as usize] = true;
                    }
                }
                _ => {}
            }
        }
        used
    };
    let resets = model.states.iter().flat_map(State::of_events);
    let driving = used(model, model.states.iter().map(|s| s.rate).chain(resets).collect());
    let shown = used(model, model.outputs.iter().flat_map(Output::expressions).collect());
    let mut at_samples: Vec<u32> = (0..model.inputs.len() as u32).collect();
    for k in (first..driving.len()).filter(|k| shown[*k]) {
        let Some(own) = model.inputs[k].slope else { continue };
        let taken = slope(model, own.of, true);
        match driving[k] {
            false => model.inputs[k] = taken,
            true => {
                at_samples[k] = model.inputs.len() as u32;
                model.inputs.push(taken);
            }
        }
    }
    if model.inputs.len() == driving.len() {
        return;
    }
    let others = model.states.iter().flat_map(State::expressions).chain(model.derived.iter().map(|d| d.expr));
    let others: Vec<ExprId> = others.chain(model.trim.iter().map(|(_, e)| *e)).collect();
    let outputs: Vec<ExprId> = model.outputs.iter().flat_map(Output::expressions).collect();
    let mut graph = Graph::default();
    let others = model.graph.rebuild(&others, &mut graph, Graph::reference);
    let outputs = model.graph.rebuild(&outputs, &mut graph, |g, reference| {
        let now = |k: u32| at_samples.get(k as usize).copied().unwrap_or(k);
        g.reference(match reference {
            Reference::Now(Leaf::Input(k)) => Reference::Now(Leaf::Input(now(k))),
            Reference::Earlier(Signal::Input(k), tau) => Reference::Earlier(Signal::Input(now(k)), tau),
            other => other,
        })
    });
    let states = model.states.iter_mut().flat_map(State::expressions_mut);
    let places = states.chain(model.derived.iter_mut().map(|d| &mut d.expr));
    let places = places.chain(model.trim.iter_mut().map(|(_, e)| e));
    places.zip(others).for_each(|(e, new)| *e = new);
    model.outputs.iter_mut().flat_map(Output::expressions_mut).zip(outputs).for_each(|(e, new)| *e = new);
    model.graph = graph;
}

/// Delays of delays leave signals behind that no expression uses and every simulation would compute: when there are
/// such, the graph is built anew without them.
fn drop_unused_delays(model: &mut Model) {
    let states = model.states.iter().flat_map(State::expressions);
    let outputs = model.outputs.iter().flat_map(Output::expressions);
    let trim = model.trim.iter().map(|(_, e)| *e);
    let params = model.derived.iter().map(|d| d.expr).chain(model.ties.iter().map(|t| t.expr));
    let roots: Vec<ExprId> = states.chain(outputs).chain(params).chain(trim).collect();
    if model.graph.delays_of(&roots).len() == model.graph.delayed().len() {
        return;
    }
    let mut graph = Graph::default();
    let mut moved = model.graph.rebuild(&roots, &mut graph, Graph::reference).into_iter();
    let states = model.states.iter_mut().flat_map(State::expressions_mut);
    let outputs = model.outputs.iter_mut().flat_map(Output::expressions_mut);
    let expressions = states.chain(outputs).chain(model.derived.iter_mut().map(|d| &mut d.expr));
    let expressions = expressions.chain(model.ties.iter_mut().map(|t| &mut t.expr));
    let expressions = expressions.chain(model.trim.iter_mut().map(|(_, e)| e));
    expressions.zip(&mut moved).for_each(|(e, new)| *e = new);
    model.graph = graph;
}
