//! Whether an effect vanishes at its null values: rates, initial values and outputs of both models at random points.
//!
//! What an effect brings of its own (its states) may have any value when its size is null; where it may not, as in a lag
//! whose time constant is null, its states follow without delay and stand where their rates vanish: the limit.

use super::extension::NewParam;
use fdm_grammar::graph::{Leaf, Signal};
use fdm_grammar::model::Model;
use fdm_grammar::op::ExprId;
use std::collections::HashMap;

/// How an effect vanishes.
#[derive(Debug, Clone, PartialEq)]
pub enum Null {
    /// At its null values the extended model is the base model.
    Identity,
    /// Towards its null values it becomes the base model: a lag of no duration.
    Limit,
    /// It does not vanish: the rate of a state or an output (by name) differs, with both values.
    Differs {
        /// `der(x)` or the name of an output.
        place: String,
        /// Of the model without the effect.
        base: f64,
        /// Of the model with it, at its null values.
        extended: f64,
    },
    /// It changes nothing whatever its values are.
    Nothing,
    /// The models have no finite values at any of the points that were tried.
    Unclear,
}

/// Random points.
const POINTS: u64 = 24;
/// Points with finite values that make a judgement.
const ENOUGH: usize = 3;
/// Relative difference by rounding.
const ROUNDING: f64 = 1e-9;
/// Relative difference that is left near a limit.
const NEAR: f64 = 1e-3;

/// Compares a model with an extension of it.
pub(super) fn judge(base: &Model, extended: &Model, params: &[NewParam]) -> Null {
    let comparison = Comparison { base, extended, params };
    match comparison.at_null(false) {
        Null::Identity if comparison.is_idle() => Null::Nothing,
        Null::Identity => Null::Identity,
        other => match comparison.at_null(true) {
            Null::Identity => Null::Limit,
            _ => match other {
                Null::Unclear => comparison.at_null(true),
                differs => differs,
            },
        },
    }
}

struct Comparison<'a> {
    base: &'a Model,
    extended: &'a Model,
    params: &'a [NewParam],
}

/// Values of all names at one point.
struct Point {
    seed: u64,
    /// What is set.
    set: HashMap<String, f64>,
    /// How long ago: delayed signals are those of a point before this one.
    ago: f64,
    /// Whether the effect's own states are at rest there, too.
    limit: bool,
}

impl Comparison<'_> {
    /// All points at the null values; near them, with the effect's states at rest, when `limit`.
    fn at_null(&self, limit: bool) -> Null {
        let mut finite = 0;
        for seed in 0..POINTS {
            let mut point = Point { seed, set: HashMap::new(), ago: 0.0, limit };
            for p in self.params.iter().filter(|p| !p.nuisance) {
                let away = if p.start == p.null || !p.null.is_finite() { 1.0 } else { p.start - p.null };
                point.set.insert(p.name.clone(), if limit { p.null + 1e-7 * away } else { p.null });
            }
            for p in self.params.iter().filter(|p| p.nuisance) {
                point.set.insert(p.name.clone(), p.start);
            }
            if limit && !self.rest(&mut point) {
                continue;
            }
            match self.difference(&point, if limit { NEAR } else { ROUNDING }) {
                Ok(true) => finite += 1,
                Ok(false) => {}
                Err(differs) => return differs,
            }
        }
        if finite >= ENOUGH { Null::Identity } else { Null::Unclear }
    }

    /// Compares all values; `Ok(false)` when the base model has none here.
    fn difference(&self, point: &Point, tolerance: f64) -> Result<bool, Null> {
        let pairs = self.pairs();
        let values: Vec<(f64, f64)> = pairs
            .iter()
            .map(|(_, b, e)| (self.value(self.base, *b, point), self.value(self.extended, *e, point)))
            .collect();
        if values.iter().any(|(b, _)| !b.is_finite()) {
            return Ok(false);
        }
        for ((place, ..), (b, e)) in pairs.into_iter().zip(values) {
            let near = (b - e).abs() <= tolerance * (1.0 + b.abs() + e.abs());
            if !near {
                return Err(Null::Differs { place, base: b, extended: e });
            }
        }
        Ok(true)
    }

    /// Name, base and extended expression of everything that both models have.
    fn pairs(&self) -> Vec<(String, ExprId, ExprId)> {
        let mut pairs = Vec::new();
        for state in &self.base.states {
            let name = &state.quantity.name;
            if let Some(other) = self.extended.states.iter().find(|s| s.quantity.name == *name) {
                pairs.push((format!("der({name})"), state.rate, other.rate));
                pairs.push((format!("the initial value of {name}"), state.initial, other.initial));
            }
        }
        for output in &self.base.outputs {
            let name = &output.quantity.name;
            if let Some(other) = self.extended.outputs.iter().find(|o| o.quantity.name == *name) {
                pairs.push((name.clone(), output.expr, other.expr));
            }
        }
        pairs
    }

    /// Whether no value of the params changes anything.
    fn is_idle(&self) -> bool {
        let mut seen = 0;
        for seed in 0..2 * POINTS {
            for size in [1.0, 30.0] {
                let mut point = Point { seed, set: HashMap::new(), ago: 0.0, limit: false };
                for p in self.params {
                    let away = if p.nuisance || p.start != p.null { p.start } else { p.null + size };
                    // what acts beyond a threshold acts once the threshold is small
                    let away = if p.null.is_infinite() && size > 1.0 { p.start / size } else { away };
                    point.set.insert(p.name.clone(), away);
                }
                match self.difference(&point, ROUNDING) {
                    Err(_) => return false,
                    Ok(finite) => seen += usize::from(finite),
                }
            }
        }
        seen >= ENOUGH
    }

    /// Brings the effect's own states to where their rates vanish, by Newton's method; whether they get there and are fast
    /// enough to stay.
    fn rest(&self, point: &mut Point) -> bool {
        let own: Vec<(String, ExprId)> = self
            .extended
            .states
            .iter()
            .filter(|s| self.is_own(&s.quantity.name))
            .map(|s| (s.quantity.name.clone(), s.rate))
            .collect();
        if own.is_empty() {
            return true;
        }
        let rates =
            |point: &Point| -> Vec<f64> { own.iter().map(|(_, e)| self.value(self.extended, *e, point)).collect() };
        for (name, _) in &own {
            let start = signal(name, point);
            point.set.insert(name.clone(), start);
        }
        for round in 0..20 {
            let now = rates(point);
            let mut jacobian: Vec<Vec<f64>> = vec![Vec::new(); own.len()];
            for (name, _) in &own {
                let x = point.set[name];
                let h = 1e-6 * (1.0 + x.abs());
                point.set.insert(name.clone(), x + h);
                let moved = rates(point);
                point.set.insert(name.clone(), x);
                for (row, (m, n)) in jacobian.iter_mut().zip(moved.iter().zip(&now)) {
                    row.push((m - n) / h);
                }
            }
            let fast = jacobian.iter().flatten().fold(0.0_f64, |m, v| m.max(v.abs()));
            let Some(step) = solved(jacobian, &now) else { return false };
            let size =
                step.iter().zip(&own).fold(0.0_f64, |m, (s, (n, _))| m.max(s.abs() / (1.0 + point.set[n].abs())));
            for ((name, _), s) in own.iter().zip(step) {
                *point.set.entry(name.clone()).or_insert(0.0) -= s;
            }
            if size < 1e-9 && round > 0 {
                return fast > 1e3;
            }
        }
        false
    }
}

impl Comparison<'_> {
    /// Whether a state is the effect's.
    fn is_own(&self, state: &str) -> bool {
        self.base.states.iter().all(|s| s.quantity.name != state)
    }

    /// An expression at a point; a delayed signal is the signal at a point before it.
    fn value(&self, model: &Model, e: ExprId, point: &Point) -> f64 {
        let graph = &model.graph;
        graph.evaluate(e, |leaf| match leaf {
            Leaf::Delayed(k) => {
                let delayed = graph.delayed()[k as usize];
                let tau = graph.evaluate(delayed.tau, |leaf| plain(model, leaf, point));
                let name = match delayed.signal {
                    Signal::State(k) => &model.states[k as usize].quantity.name,
                    Signal::Input(k) => &model.inputs[k as usize].quantity.name,
                };
                if tau == 0.0 { signal(name, point) } else { self.before(name, tau, point) }
            }
            leaf => plain(model, leaf, point),
        })
    }

    /// A signal some time before a point.
    fn before(&self, name: &str, tau: f64, point: &Point) -> f64 {
        let own = |name: &String| self.is_own(name) && self.extended.states.iter().any(|s| s.quantity.name == *name);
        let mut set = point.set.clone();
        set.retain(|name, _| !own(name));
        let mut before = Point { set, ago: point.ago + tau, ..*point };
        // an own state that looks back at itself is left alone
        if point.limit && own(&name.to_string()) {
            before.limit = false;
            if !self.rest(&mut before) {
                return f64::NAN;
            }
        }
        signal(name, &before)
    }
}

/// Solves a small system by elimination with the largest pivot; `None` when it is singular.
fn solved(mut a: Vec<Vec<f64>>, b: &[f64]) -> Option<Vec<f64>> {
    let n = b.len();
    let mut x: Vec<f64> = b.to_vec();
    for k in 0..n {
        let pivot = (k..n).max_by(|i, j| a[*i][k].abs().total_cmp(&a[*j][k].abs()))?;
        a.swap(k, pivot);
        x.swap(k, pivot);
        if a[k][k] == 0.0 || !a[k][k].is_finite() {
            return None;
        }
        let row = a[k].clone();
        for i in k + 1..n {
            let factor = a[i][k] / row[k];
            a[i].iter_mut().zip(&row).skip(k).for_each(|(a, r)| *a -= factor * r);
            x[i] -= factor * x[k];
        }
    }
    for k in (0..n).rev() {
        let sum: f64 = (k + 1..n).map(|j| a[k][j] * x[j]).sum();
        x[k] = (x[k] - sum) / a[k][k];
    }
    x.iter().all(|v| v.is_finite()).then_some(x)
}

/// A leaf that is not delayed.
fn plain(model: &Model, leaf: Leaf, point: &Point) -> f64 {
    match leaf {
        Leaf::Time => signal("t", point).abs(),
        Leaf::State(k) => signal(&model.states[k as usize].quantity.name, point),
        Leaf::Input(k) => signal(&model.inputs[k as usize].quantity.name, point),
        Leaf::Param(k) => {
            let param = &model.params[k as usize];
            let name = &param.quantity.name;
            let moved = param.value + 0.03 * (0.1 + param.value.abs()) * random(name, point.seed);
            point.set.get(name).copied().unwrap_or(moved.clamp(param.lower, param.upper.max(param.lower)))
        }
        Leaf::Delayed(_) => f64::NAN,
    }
}

/// The value of a signal: of either sign at one point, positive at the next, of several sizes.
fn signal(name: &str, point: &Point) -> f64 {
    if let Some(set) = point.set.get(name) {
        return *set;
    }
    let size = [1.0, 0.1, 20.0][(point.seed / 2 % 3) as usize];
    let value = random(name, point.seed);
    let now = size * if point.seed.is_multiple_of(2) { 0.05 + value.abs() } else { value };
    now + point.ago * random(name, !point.seed)
}

/// A number in [-1, 1] that a name has at a point (splitmix64 over FNV-1a).
fn random(name: &str, seed: u64) -> f64 {
    let hash = name.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
    let mut z = hash.wrapping_add(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15)).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}
