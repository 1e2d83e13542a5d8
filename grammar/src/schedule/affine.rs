//! Which equations are affine in states, inputs and delayed signals, with coefficients of parameters alone: proven on the
//! graph, never tried with numbers.

use crate::graph::{Graph, Leaf, Node};
use crate::model::Model;
use crate::op::{Args, Op};

/// What is affine; time must not occur in it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Affine {
    /// Whether all rates are.
    pub rates: bool,
    /// Which outputs are (q).
    pub outputs: Vec<bool>,
}

/// How an expression depends on what varies during a run; in this order, each includes those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Degree {
    /// Parameters and constants alone.
    Known,
    Affine,
    Other,
}

impl Affine {
    /// Looks at every equation of a model.
    pub fn of(model: &Model) -> Self {
        let degrees = degrees(&model.graph);
        let affine = |e: crate::op::ExprId| degrees[e.index()] <= Degree::Affine;
        Self {
            rates: model.states.iter().all(|s| affine(s.rate) && s.limits.is_none() && s.resets.is_empty()),
            outputs: model.outputs.iter().map(|o| affine(o.expr)).collect(),
        }
    }
}

/// For each node whether it is affine.
pub(crate) fn affine_nodes(graph: &Graph) -> Vec<bool> {
    degrees(graph).into_iter().map(|d| d <= Degree::Affine).collect()
}

fn degrees(graph: &Graph) -> Vec<Degree> {
    let mut degrees: Vec<Degree> = Vec::with_capacity(graph.nodes().len());
    for node in graph.nodes() {
        let degree = match node {
            Node::Constant(_) | Node::Leaf(Leaf::Param(_)) => Degree::Known,
            Node::Leaf(Leaf::Time) => Degree::Other,
            Node::Leaf(_) => Degree::Affine,
            Node::Apply(op, args) => combined(*op, args, &degrees),
        };
        degrees.push(degree);
    }
    degrees
}

fn combined(op: Op, args: &Args, degrees: &[Degree]) -> Degree {
    let of = |k: usize| degrees[args[k].index()];
    let highest = (0..op.row().arity).map(of).max().unwrap_or(Degree::Known);
    let affine = match op {
        Op::Add | Op::Sub | Op::Neg => highest == Degree::Affine,
        Op::Mul => highest == Degree::Affine && (of(0) == Degree::Known || of(1) == Degree::Known),
        Op::Div => of(0) == Degree::Affine && of(1) == Degree::Known,
        Op::Select => of(0) == Degree::Known && highest == Degree::Affine,
        _ => false,
    };
    match highest {
        Degree::Known => Degree::Known,
        _ if affine => Degree::Affine,
        _ => Degree::Other,
    }
}

#[cfg(test)]
mod tests {
    use crate::schedule::Schedule;
    use crate::source::Source;

    fn affine(equations: &str) -> (bool, Vec<bool>) {
        let text = format!("model m {{ input u; param a = 1, b = 2; state x, z; {equations} }}");
        let compiled = crate::compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}"));
        let schedule: &Schedule = &compiled.schedule;
        (schedule.layout.affine.rates, schedule.layout.affine.outputs.clone())
    }

    #[test]
    fn coefficients_may_be_any_function_of_parameters() {
        let (rates, outputs) = affine(
            "der(x) = sin(a)*x - z/(a^2 + 1) + (if a > b then u else 2*u); der(z) = -(x + delay(u, 0.1)) + exp(b); \
             output y1 = x*a + 3; output y2 = x*z; output y3 = abs(x); output y4 = u;",
        );
        assert!(rates);
        assert_eq!(outputs, [true, false, false, true]);
    }

    #[test]
    fn products_signs_decisions_and_time_are_not_affine() {
        for bad in ["x*u", "a/x", "sign(x)", "if x > 0 then 1 else 2", "t*a", "x^2", "min(x, 1)"] {
            let (rates, _) = affine(&format!("der(x) = -x + {bad}; der(z) = -z; output y = x;"));
            assert!(!rates, "{bad}");
        }
    }
}
