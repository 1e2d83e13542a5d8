//! Rate constants: parameters with which states are consumed and produced, as those of reactions, flows and dampers.
//!
//! Found by values: at random points at which all quantities are positive, more of the parameter always takes more of the state
//! away, and takes nothing where the state is zero; or always makes more of it.

use fdm_grammar::graph::{Leaf, Node};
use fdm_grammar::model::Model;

/// Points that are looked at, and most that are drawn for that.
const POINTS: u64 = 6;
const DRAWS: u64 = 400;
/// Powers of ten between which states and inputs are drawn.
const LOWEST: f64 = -1.0;
const HIGHEST: f64 = 3.0;

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
        // relative difference by rounding
        if (with - without).abs() <= 1e-9 * size { 0.0 } else { with - without }
    };
    let (mut found, mut sign, mut vanishes) = (0, 0.0, true);
    for seed in 0..DRAWS {
        let own = change(None, seed);
        // far from all that the model is made for an exponential is zero, or none
        if !own.is_finite() || own == 0.0 {
            continue;
        }
        if sign * own < 0.0 {
            return None;
        }
        (found, sign) = (found + 1, own.signum());
        vanishes &= change(Some(state), seed) == 0.0;
        if found == POINTS {
            break;
        }
    }
    match (found == POINTS, sign > 0.0) {
        (true, true) => Some(Turnover::Produced),
        (true, false) if vanishes => Some(Turnover::Consumed),
        _ => None,
    }
}

impl Point<'_> {
    fn value(&self, leaf: Leaf) -> f64 {
        // the same leaf has the same value everywhere; all positive, of concentrations, temperatures and speeds
        let drawn = |kind: u64, k: u32| {
            fraction(self.seed.wrapping_mul(0x5851_f42d_4c95_7f2d) ^ (kind << 40) ^ (u64::from(k) << 8))
        };
        let own = |kind: u64, k: u32| 10.0_f64.powf(drawn(kind, k) * (HIGHEST - LOWEST) + LOWEST);
        match leaf {
            Leaf::Time => own(1, 0),
            Leaf::State(k) if self.absent == Some(k as usize) => 0.0,
            Leaf::State(k) => own(2, k),
            Leaf::Input(k) => own(3, k),
            Leaf::Param(k) => {
                let factor = if self.raised == Some(k as usize) { 1.5 } else { 1.0 };
                factor * self.model.params[k as usize].value.abs().max(0.1) * (0.5 + drawn(4, k))
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

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_grammar::compile;
    use fdm_grammar::source::Source;

    #[test]
    fn rate_constants_are_found_through_arrhenius_terms_and_balances() {
        let text = "model m { input Tj; state A = 1, B = 0, T = 330; const Cp = 3, T0 = 330;
            param k1 = 0.04, E = 7000, k2 = 0.01, H = 40, UA = 0.4;
            let r1 = k1*exp(E*(1/T0 - 1/T))*A; let r2 = k2*B^2;
            der(A) = -r1; der(B) = r1 - r2; Cp*der(T) = H*r1 + UA*(Tj - T); output y = A, z = B, w = T; }";
        let model = compile(&Source::new("m", text)).expect("a model").model;
        let all = Turnovers::new(&model);
        let of = |param: &str, state: usize| all.of(model.param(param).expect("a parameter"), state);
        assert_eq!(
            [of("k1", 0), of("k1", 1), of("k1", 2)],
            [Some(Turnover::Consumed), Some(Turnover::Produced), Some(Turnover::Produced)]
        );
        assert_eq!([of("k2", 0), of("k2", 1), of("k2", 2)], [None, Some(Turnover::Consumed), None]);
        // an exponent and a jacket act both ways
        assert_eq!([of("E", 0), of("UA", 2), of("H", 2)], [None, None, Some(Turnover::Produced)]);
    }
}
