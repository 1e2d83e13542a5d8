//! Whether an effect vanishes at its null values: rates, initial values and outputs of both models at random points.
//!
//! What an effect brings of its own (its states) may have any value when its size is null; where it may not, as in a lag
//! whose time constant is null, its states follow without delay and stand where their rates vanish: the limit.
//!
//! An effect on a plain model that has what it attaches to: whether it compiles there, vanishes and does something.

use crate::candidate::{Candidate, Choice, NewParam};
use crate::conditions::{Effect, Kind};
use crate::scales::{Nominal, rounded};
use crate::subject::Subject;
use fdm_grammar::compile;
use fdm_grammar::diagnostic::{Code, Diagnostic};
use fdm_grammar::graph::{Leaf, Signal};
use fdm_grammar::model::Model;
use fdm_grammar::op::ExprId;
use fdm_grammar::source::Source;
use fdm_grammar::syntax::SlotKind;
use std::collections::HashMap;
use std::fmt::Write;
use std::sync::Arc;

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

/// Applies an effect, for every kind that its slots can be.
pub(super) fn check(effect: &Effect) -> Result<(), Diagnostic> {
    if effect.kind() == Kind::Variance {
        return Ok(());
    }
    let most = effect.tree().slots.iter().map(|s| s.kinds.len()).max().unwrap_or(1);
    for k in 0..most {
        let kinds = effect.tree().slots.iter().map(|s| s.kinds[k.min(s.kinds.len() - 1)]).collect();
        on(effect, kinds)?;
    }
    Ok(())
}

fn on(effect: &Effect, kinds: Vec<SlotKind>) -> Result<(), Diagnostic> {
    let place = effect.tree().name.span;
    let fault = |code: Code, message: String| Diagnostic::new(code, place, message);
    let source = Source::new("plain model", text(effect, &kinds));
    let plain = |findings: Vec<Diagnostic>| {
        let first = findings.into_iter().find(Diagnostic::is_error);
        let (message, hint) = first.map_or((String::new(), None), |f| (f.message, f.hint));
        let found = fault(Code::Misfit, format!("the effect `{}` makes no model: {message}", effect.name()));
        match hint {
            Some(hint) => found.hint(hint),
            None => found,
        }
    };
    let base = compile(&source).map_err(plain)?;
    let subject = Subject::new(&source, &base.model).map_err(plain)?;
    let targets = effect.tree().slots.iter().map(|s| s.name.text.clone()).collect();
    let candidate = Candidate::new(Arc::new(effect.clone()), targets, kinds);
    let extension = candidate.apply(&subject, &Nominal, &Choice::new())?;
    let extended = extension.compile().map_err(plain)?;
    let name = effect.name();
    match extension.null(&extended.model) {
        Null::Identity | Null::Limit => Ok(()),
        Null::Nothing => {
            Err(fault(Code::NoRewrite, format!("the effect `{name}` changes nothing, whatever its values are")))
        }
        Null::Unclear => {
            Err(fault(Code::NotVanishing, format!("the effect `{name}` has no finite values at its null values"))
                .hint("a null may be infinite, such as that of a limit: `param L = inf try ...;`"))
        }
        Null::Differs { place, base, extended } => {
            // the plain model's own names mean nothing to a reader
            let place = match place.strip_prefix("of_") {
                Some(slot) => format!("what is computed from `{slot}`"),
                None => format!("`{place}`"),
            };
            let (base, extended) = (rounded(base), rounded(extended));
            let nulls: Vec<String> = extension
                .params()
                .iter()
                .filter(|p| !p.nuisance)
                .map(|p| format!("{} = {}", p.local, p.null))
                .collect();
            let nulls = nulls.join(", ");
            let message = format!(
                "the effect `{name}` does not vanish at {nulls}: {place} is {extended} there, and {base} without it"
            );
            Err(fault(Code::NotVanishing, message)
                .hint("give the value at which it leaves the model as it is, or multiply what is added by a param that is null"))
        }
    }
}

/// A model without units in which every slot is something of its own, seen by an output.
fn text(effect: &Effect, kinds: &[SlotKind]) -> String {
    let mut text = String::from("model plain {\n");
    let slots = || effect.tree().slots.iter().map(|s| &s.name.text).zip(kinds);
    for (name, kind) in slots() {
        let _ = match kind {
            SlotKind::Input => writeln!(text, "  input {name};\n  output of_{name} = 1.5*{name};"),
            SlotKind::State => {
                writeln!(
                    text,
                    "  param p_{name} = 0.7;\n  state {name};\n  der({name}) = 0.3 - p_{name}*{name};\n  output of_{name} = {name};"
                )
            }
            SlotKind::Output => {
                writeln!(
                    text,
                    "  state s_{name};\n  param p_{name} = 0.6;\n  der(s_{name}) = 0.2 - p_{name}*s_{name};\n  output {name} = 2*s_{name};"
                )
            }
            SlotKind::Param => writeln!(text, "  param {name} = 1.3;\n  output of_{name} = {name};"),
        };
    }
    text + "}\n"
}
