//! Every partial that is not zero, as an expression.

use super::Shown;
use fdm_grammar::derive::{Jacobian, Partials, differentiate};
use fdm_grammar::graph::{Leaf, Names, show};
use fdm_results::documents::stages::{DerivativesStage, PartialText, StageDocument};
use fdm_system::Model;

/// A kind of leaf with its number.
type Kind = fn(u32) -> Leaf;

pub(super) fn derivatives(model: &Model) -> Shown {
    // nodes of derivatives are in the graph already: they are found again, not made
    let mut m = model.definition().clone();
    let d = differentiate(&mut m);
    let states: Vec<String> = m.states.iter().map(|s| s.quantity.name.clone()).collect();
    let rates: Vec<String> = states.iter().map(|s| format!("der({s})")).collect();
    let initial: Vec<String> = states.iter().map(|s| format!("{s}(0)")).collect();
    let tau: Vec<String> =
        (0..m.graph.delayed().len() as u32).map(|k| format!("tau of {}", m.leaf(Leaf::Delayed(k)))).collect();
    let outputs: Vec<String> = m.outputs.iter().map(|o| o.quantity.name.clone()).collect();
    let by = |p: Partials| -> Vec<(Jacobian, Kind)> {
        vec![(p.state, Leaf::State), (p.input, Leaf::Input), (p.delayed, Leaf::Delayed), (p.param, Leaf::Param)]
    };
    let groups = [
        (rates, by(d.rates)),
        (outputs, by(d.outputs)),
        (initial, vec![(d.initial, Leaf::Param as Kind)]),
        (tau, vec![(d.tau, Leaf::Param as Kind)]),
    ];
    let (mut text, mut list) = (String::new(), Vec::new());
    for (equations, jacobians) in &groups {
        for (i, equation) in equations.iter().enumerate() {
            let entries: Vec<(String, String)> = jacobians
                .iter()
                .flat_map(|(j, kind)| j.pattern.row(i).map(move |(k, leaf)| (kind(leaf as u32), j.entries[k])))
                .map(|(leaf, e)| (m.leaf(leaf), show(&m.graph, e, &m)))
                .collect();
            let widest = entries.iter().map(|(leaf, _)| leaf.chars().count()).max().unwrap_or(0);
            if !entries.is_empty() {
                text += &format!("{equation}\n");
            }
            for (leaf, partial) in entries {
                text += &format!("  by {leaf:widest$}  {partial}\n");
                list.push(PartialText { by: leaf, equation: equation.clone(), partial });
            }
        }
    }
    let stage = DerivativesStage { model: model.name().into(), partials: list };
    Shown { text, document: StageDocument::Derivatives(stage) }
}
