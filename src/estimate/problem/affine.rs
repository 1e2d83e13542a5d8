//! Parameters in which the whole response is affine: the best values of these are known as soon as the others are.

use fdm_grammar::graph::{Graph, Leaf, Node, Signal};
use fdm_grammar::model::Model;
use fdm_grammar::op::{ExprId, Op};

/// How an expression depends on the chosen parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Degree {
    /// Not at all.
    Constant,
    /// As a sum of constants times parameters.
    Affine,
    /// In any other way.
    Curved,
}

/// Visits of expressions after which no further parameter is tried: giant models are not worth more.
const MOST_VISITS: usize = 20_000_000;

/// A set of free parameters, gathered in their order, in which all outputs are jointly affine. A state is affine when
/// its equation and its initial value are: the states of linear equations are affine in what multiplies their inputs,
/// not in what multiplies their states.
pub(crate) fn affine(model: &Model) -> Vec<usize> {
    let mut chosen = vec![false; model.params.len()];
    let mut visits = 0;
    for k in (0..chosen.len()).filter(|k| !model.params[*k].fixed) {
        if visits > MOST_VISITS {
            break;
        }
        chosen[k] = true;
        chosen[k] = outputs_are_affine(model, &chosen, &mut visits);
    }
    (0..chosen.len()).filter(|k| chosen[*k]).collect()
}

fn outputs_are_affine(model: &Model, chosen: &[bool], visits: &mut usize) -> bool {
    let mut states = vec![Degree::Constant; model.states.len()];
    loop {
        let degrees = degrees(&model.graph, chosen, &states);
        *visits += degrees.len();
        let of = |e: ExprId| degrees[e.index()];
        if model.outputs.iter().any(|o| of(o.expr) == Degree::Curved) {
            return false;
        }
        // degrees only rise, so this ends
        let raised = model.states.iter().zip(&states).map(|(s, d)| of(s.rate).max(of(s.initial)).max(*d)).collect();
        if raised == states {
            return true;
        }
        states = raised;
    }
}

/// The degree of every expression, for the given degrees of the states.
fn degrees(graph: &Graph, chosen: &[bool], states: &[Degree]) -> Vec<Degree> {
    let mut degrees: Vec<Degree> = Vec::with_capacity(graph.nodes().len());
    for node in graph.nodes() {
        let degree = match node {
            Node::Constant(_) => Degree::Constant,
            Node::Leaf(leaf) => of_leaf(graph, *leaf, chosen, states, &degrees),
            Node::Apply(op, args) => of_operation(*op, args.map(|a| degrees.get(a.index()).copied())),
        };
        degrees.push(degree);
    }
    degrees
}

fn of_leaf(graph: &Graph, leaf: Leaf, chosen: &[bool], states: &[Degree], degrees: &[Degree]) -> Degree {
    match leaf {
        Leaf::Param(k) if chosen[k as usize] => Degree::Affine,
        Leaf::Time | Leaf::Input(_) | Leaf::Param(_) => Degree::Constant,
        Leaf::State(k) => states[k as usize],
        Leaf::Delayed(k) => {
            let delayed = graph.delayed()[k as usize];
            match (degrees.get(delayed.tau.index()), delayed.signal) {
                (Some(Degree::Constant), Signal::State(k)) => states[k as usize],
                (Some(Degree::Constant), Signal::Input(_)) => Degree::Constant,
                _ => Degree::Curved,
            }
        }
    }
}

/// Operands that an operation does not have are none.
fn of_operation(op: Op, args: [Option<Degree>; 3]) -> Degree {
    use Degree::{Constant, Curved};
    let [a, b, c] = args.map(|d| d.unwrap_or(Constant));
    match op {
        _ if a.max(b).max(c) == Constant => Constant,
        Op::Add | Op::Sub | Op::Neg => a.max(b),
        Op::Mul if a == Constant || b == Constant => a.max(b),
        Op::Div if b == Constant => a,
        Op::Select if a == Constant => b.max(c),
        _ => Curved,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_system::Model;

    fn names(text: &str) -> Vec<String> {
        let model = Model::from_text("test.fdm", text).expect("a model");
        let definition = model.definition();
        affine(definition).into_iter().map(|k| definition.params[k].quantity.name.clone()).collect()
    }

    #[test]
    fn factors_of_curved_terms_are_affine_together() {
        let text = "model m { input x; param a = 1, b = 1, c = 1, d = 1, e = 1 fixed, f = 1;
            output y = a + b*exp(-x*c) + (d*b)*x + e; output z = if x > 0 then f*x else 2*f; }";
        assert_eq!(names(text), ["a", "b", "f"]);
        let ratio = "model m { input x; param a = 1, b = 1, c = 1; output y = (a + b*x)/(1 + c*x); }";
        assert_eq!(names(ratio), ["a", "b"]);
        assert!(names("model m { input x; param a = 1; output y = sin(a*x) + a^2; }").is_empty());
    }

    #[test]
    fn linear_equations_are_affine_in_their_inputs_effectiveness_and_initial_values() {
        let text = "model m { input u; state x = x0, v; param x0 = 1, k = 1, b = 1, g = 1, tau = 0.1 in [0, 1], s = 1;
            der(x) = v; der(v) = -k*x + b*u + g; output y = x + s*t; output w = delay(v, tau); }";
        assert_eq!(names(text), ["x0", "b", "g", "s"]);
        let curved =
            "model m { input u; state x = x0; param x0 = 1, k = 1, b = 1; der(x) = -k*x*abs(x) + b*u; output y = x; }";
        assert!(names(curved).is_empty());
        let decay = "model m { state x = x0; param k = 1, x0 = 1; der(x) = -k*x; output y = x; }";
        assert!(names(decay) == ["x0"], "{:?}", names(decay));
    }
}
