//! The nodes that a model's equations are made of; what is used several times stands once.

use super::Shown;
use fdm_grammar::graph::{Leaf, Names, Node};
use fdm_grammar::op::{ExprId, Form};
use fdm_results::documents::stages::{EquationNode, GraphNode, GraphStage, StageDocument};
use fdm_system::Model;

/// The equations: name and root.
fn roots(model: &Model) -> Vec<(String, ExprId)> {
    let m = model.definition();
    let rates = m.states.iter().map(|s| (format!("der({})", s.quantity.name), s.rate));
    let initial = m.states.iter().map(|s| (format!("{}(0)", s.quantity.name), s.initial));
    let tau = m.graph.delayed().iter().enumerate();
    let tau = tau.map(|(k, d)| (format!("tau of {}", m.leaf(Leaf::Delayed(k as u32))), d.tau));
    let derived = m.derived.iter().map(|d| (d.quantity.name.clone(), d.expr));
    let outputs = m.outputs.iter().map(|o| (o.quantity.name.clone(), o.expr));
    rates.chain(initial).chain(tau).chain(derived).chain(outputs).collect()
}

/// Nodes below the equations in topological order, numbered from 0, with what they are and what they are made of.
fn nodes(model: &Model, roots: &[(String, ExprId)]) -> (Vec<(String, Vec<usize>)>, Vec<usize>) {
    let graph = &model.definition().graph;
    let below = graph.reachable(roots.iter().map(|(_, e)| *e));
    let mut number = vec![usize::MAX; graph.nodes().len()];
    below.iter().enumerate().for_each(|(k, e)| number[e.index()] = k);
    let one = |e: &ExprId| match graph.node(*e) {
        Node::Constant(bits) => (f64::from_bits(bits).to_string(), Vec::new()),
        Node::Leaf(leaf) => (model.definition().leaf(leaf), Vec::new()),
        Node::Apply(op, _) => (op.row().name.into(), graph.operands(*e).iter().map(|a| number[a.index()]).collect()),
    };
    (below.iter().map(one).collect(), roots.iter().map(|(_, e)| number[e.index()]).collect())
}

pub(super) fn graph(model: &Model) -> Shown {
    let roots = roots(model);
    let (nodes, ends) = nodes(model, &roots);
    let mut uses = vec![0; nodes.len()];
    nodes.iter().flat_map(|(_, operands)| operands).chain(&ends).for_each(|k| uses[*k] += 1);
    let mut text = String::new();
    for (k, (what, operands)) in nodes.iter().enumerate() {
        let shared =
            if uses[k] > 1 && !operands.is_empty() { format!("  (used {} times)", uses[k]) } else { String::new() };
        text += &format!("n{k} = {}{shared}\n", written(what, operands));
    }
    text.push('\n');
    roots.iter().zip(&ends).for_each(|((name, _), k)| text += &format!("{name} = n{k}\n"));
    let equations = roots.into_iter().zip(&ends).map(|((name, _), node)| EquationNode { name, node: *node }).collect();
    let nodes = nodes.into_iter().map(|(is, of)| GraphNode { is, of }).collect();
    Shown { text, document: StageDocument::Graph(GraphStage { equations, nodes }) }
}

/// A node in terms of others.
fn written(what: &str, operands: &[usize]) -> String {
    let of = |k: usize| format!("n{}", operands[k]);
    let row = fdm_grammar::op::ROWS.iter().find(|row| row.name == what && row.arity == operands.len());
    match row.map(|row| row.form) {
        Some(Form::Infix) => format!("{} {what} {}", of(0), of(1)),
        Some(Form::Prefix) => format!("{what}{}", of(0)),
        Some(Form::Choice) => format!("if {} then {} else {}", of(0), of(1), of(2)),
        Some(Form::Function | Form::External) => {
            format!("{what}({})", (0..operands.len()).map(of).collect::<Vec<_>>().join(", "))
        }
        None => what.to_string(),
    }
}

/// The graph in the language of Graphviz: operands point to what uses them.
pub fn dot(model: &Model) -> String {
    let roots = roots(model);
    let (nodes, ends) = nodes(model, &roots);
    let quoted = |text: &str| format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""));
    let mut text = format!("digraph {} {{\n  rankdir=LR;\n  node [shape=circle];\n", quoted(model.name()));
    for (k, (what, operands)) in nodes.iter().enumerate() {
        let shape = if operands.is_empty() { " shape=box" } else { "" };
        text += &format!("  n{k} [label={}{shape}];\n", quoted(what));
        let several = operands.len() > 1;
        for (place, from) in operands.iter().enumerate() {
            let label = if several { format!(" [label={}]", place + 1) } else { String::new() };
            text += &format!("  n{from} -> n{k}{label};\n");
        }
    }
    for (k, ((name, _), end)) in roots.iter().zip(&ends).enumerate() {
        text += &format!("  e{k} [label={} shape=plaintext];\n  n{end} -> e{k};\n", quoted(name));
    }
    text + "}\n"
}
