//! The order in which places are told.

use super::localise::CLEAR;
use super::place::{Kind, Place};
use crate::model::Model;
use fdm_grammar::graph::{Leaf, Node, Signal};
use serde::Serialize;

/// A place with what speaks for it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Standing {
    /// The place.
    #[serde(flatten)]
    pub place: Place,
    /// Logarithm of the odds that something enters there.
    pub evidence: f64,
}

/// Sorts places by their evidence, the likeliest first; but a force on an input is one in the equation that the input moves, in
/// another name: where both are as likely the equation stands first.
pub(super) fn rank<T>(model: &Model, list: &mut [T], of: impl Fn(&T) -> (&Place, f64)) {
    list.sort_by(|a, b| of(b).1.total_cmp(&of(a).1));
    for at in 0..list.len() {
        let (place, evidence) = of(&list[at]);
        if place.kind != Kind::Input {
            continue;
        }
        let same = |other: &T| {
            let (other, own) = of(other);
            other.kind == Kind::Equation && own > evidence - CLEAR && moves(model, place.index, other.index)
        };
        if let Some(behind) = list[at + 1..].iter().position(same) {
            list[at..=at + 1 + behind].rotate_right(1);
        }
    }
}

/// Whether the equation of a state contains an input, delayed or not.
fn moves(model: &Model, input: usize, state: usize) -> bool {
    let definition = model.definition();
    let graph = &definition.graph;
    let is_it = |node: Node| match node {
        Node::Leaf(Leaf::Input(k)) => k as usize == input,
        Node::Leaf(Leaf::Delayed(k)) => {
            matches!(graph.delayed()[k as usize].signal, Signal::Input(k) if k as usize == input)
        }
        _ => false,
    };
    graph.reachable([definition.states[state].rate]).into_iter().any(|e| is_it(graph.node(e)))
}
