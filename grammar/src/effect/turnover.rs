//! Rate constants: parameters with which states are consumed and produced, as those of reactions, flows and dampers.
//!
//! Found by values: at random points at which all quantities are positive, more of the parameter always takes more of the state
//! away, and takes nothing where the state is zero.

use crate::graph::{Leaf, Node};
use crate::model::Model;

/// Points that are looked at.
const POINTS: u64 = 6;
/// Relative difference by rounding.
const ROUNDING: f64 = 1e-9;

/// What becomes of a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turnover {
    /// In proportion to a function of it that vanishes as it does.
    Consumed,
    /// Whatever from.
    Produced,
}

/// Parameters by states.
#[derive(Debug, Clone)]
pub(super) struct Turnovers {
    states: usize,
    list: Vec<Option<Turnover>>,
}

/// What a leaf is set to.
struct Point<'a> {
    model: &'a Model,
    seed: u64,
    /// A parameter and its factor.
    raised: Option<usize>,
    /// A state that is zero.
    absent: Option<usize>,
}

impl Turnovers {
    pub(super) fn new(model: &Model) -> Self {
        let states = model.states.len();
        let mut list = vec![None; model.params.len() * states];
        for (x, state) in model.states.iter().enumerate() {
            for e in model.graph.reachable([state.rate]) {
                if let Node::Leaf(Leaf::Param(p)) = model.graph.node(e) {
                    list[p as usize * states + x] = turnover(model, p as usize, x);
                }
            }
        }
        Self { states, list }
    }

    /// Of a parameter and a state, by their places.
    pub(super) fn of(&self, param: usize, state: usize) -> Option<Turnover> {
        *self.list.get(param * self.states + state)?
    }
}

fn turnover(model: &Model, param: usize, state: usize) -> Option<Turnover> {
    let graph = &model.graph;
    let rate = model.states[state].rate;
    let value = |raised: Option<usize>, absent: Option<usize>, seed: u64| {
        let point = Point { model, seed, raised, absent };
        graph.evaluate(rate, |leaf| point.value(leaf))
    };
    let change = |absent: Option<usize>, seed: u64| {
        let (with, without) = (value(Some(param), absent, seed), value(None, absent, seed));
        let size = with.abs() + without.abs();
        if (with - without).abs() <= ROUNDING * size { 0.0 } else { with - without }
    };
    let changes: Vec<f64> = (0..POINTS).map(|seed| change(None, seed)).collect();
    if changes.iter().all(|c| *c > 0.0) {
        return Some(Turnover::Produced);
    }
    let consumed = changes.iter().all(|c| *c < 0.0) && (0..POINTS).all(|seed| change(Some(state), seed) == 0.0);
    consumed.then_some(Turnover::Consumed)
}

impl Point<'_> {
    fn value(&self, leaf: Leaf) -> f64 {
        // the same leaf has the same value everywhere; all positive, between 0.5 and 1.5
        let own = |kind: u64, k: u32| 0.5 + fraction(self.seed ^ (kind << 40) ^ (u64::from(k) << 8));
        match leaf {
            Leaf::Time => own(1, 0),
            Leaf::State(k) if self.absent == Some(k as usize) => 0.0,
            Leaf::State(k) => own(2, k),
            Leaf::Input(k) => own(3, k),
            Leaf::Param(k) => {
                let factor = if self.raised == Some(k as usize) { 1.5 } else { 1.0 };
                factor * self.model.params[k as usize].value.abs().max(0.1) * own(4, k)
            }
            Leaf::Delayed(k) => own(5, k),
        }
    }
}

/// A number in [0, 1) (splitmix64).
fn fraction(seed: u64) -> f64 {
    let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}
