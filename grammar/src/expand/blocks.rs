//! Blocks made states: `lag`, `leadlag`, `washout`, `second_order`, `tf` become states with equations of the core language.
//!
//! A block is at rest when a run begins, as if its input had always had its first value. Calls that read the same share their states.
//!
//! `tf(x, [b1, b0], [1, a1, a0])`: a transfer function in the observer form, whose states are the output and what feeds its rates.

use super::maker::{Atom, Maker};
use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;
use crate::syntax::{
    Asked, BinarySign, Expr, ExprRef, Made, Name, Printer, Size, StatementKind, SyntaxTree, Want, each_root,
};
use BinarySign::{Add, Divide, Multiply, Power, Subtract};
use std::collections::{HashMap, HashSet};

/// A block of the language.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Block {
    /// `lag(x, T)`: `1/(T s + 1)`
    Lag,
    /// `leadlag(x, T1, T2)`: `(T1 s + 1)/(T2 s + 1)`
    LeadLag,
    /// `washout(x, T)`: `T s/(T s + 1)`
    Washout,
    /// `second_order(x, omega, zeta)`: `omega^2/(s^2 + 2 zeta omega s + omega^2)`
    SecondOrder,
    /// `tf(x, [b1, b0], [1, a1, a0])`
    Transfer,
}

impl Block {
    const ALL: [(&str, Block, &str); 5] = [
        ("lag", Self::Lag, "lag(x, T)"),
        ("leadlag", Self::LeadLag, "leadlag(x, T1, T2)"),
        ("washout", Self::Washout, "washout(x, T)"),
        ("second_order", Self::SecondOrder, "second_order(x, omega, zeta)"),
        ("tf", Self::Transfer, "tf(x, [b1, b0], [1, a1, a0])"),
    ];

    fn find(name: &str) -> Option<(Self, &'static str)> {
        Self::ALL.iter().find(|(n, ..)| *n == name).map(|(_, block, form)| (*block, *form))
    }

    fn arguments(self) -> usize {
        if matches!(self, Self::Lag | Self::Washout) { 2 } else { 3 }
    }
}

/// Rewrites every call of a block; states, lets and equations join the end of the tree.
pub(super) fn blocks(tree: &mut SyntaxTree, findings: &mut Vec<Diagnostic>) {
    let calls = calls(tree);
    if calls.is_empty() {
        return;
    }
    let quoted = quoted(tree);
    let mut done: HashMap<String, String> = HashMap::new();
    let mut maker = Maker::new(tree);
    for (e, block, form) in calls {
        let Expr::Call(name, arguments) = maker.tree.expr(e).clone() else { continue };
        let made = if quoted.contains(&e) {
            Err(recorded(&name, maker.tree.span(e)))
        } else if arguments.len() != block.arguments() {
            Err(argument_count(&name, block, form, arguments.len(), maker.tree.span(e)))
        } else {
            expanded(&mut maker, &mut done, block, &name, &arguments, e)
        };
        maker.tree.expressions[e.0 as usize].0 = match made {
            Ok(name) => Expr::Name(name),
            Err(finding) => {
                findings.push(finding);
                maker.silent()
            }
        };
    }
}

/// The calls of blocks that a statement needs, inner ones first.
fn calls(tree: &SyntaxTree) -> Vec<(ExprRef, Block, &'static str)> {
    let tables: HashSet<&str> = tree
        .statements
        .iter()
        .filter_map(|s| match &s.kind {
            StatementKind::Table(table) => Some(table.name.text.as_str()),
            _ => None,
        })
        .collect();
    let found = |e: &Expr| match e {
        Expr::Call(name, _) if !tables.contains(name.text.as_str()) => Block::find(&name.text),
        _ => None,
    };
    if !tree.expressions.iter().any(|(e, _)| found(e).is_some()) {
        return Vec::new();
    }
    let mut wanted = vec![false; tree.expressions.len()];
    tree.statements.iter().for_each(|s| each_root(&s.kind, |root| wanted[root.0 as usize] = true));
    for k in (0..wanted.len()).rev() {
        if wanted[k] {
            tree.expressions[k].0.each_operand(|operand| wanted[operand.0 as usize] = true);
        }
    }
    let all = tree.expressions.iter().enumerate().filter(|(k, _)| wanted[*k]);
    all.filter_map(|(k, (e, _))| found(e).map(|(block, form)| (ExprRef(k as u32), block, form))).collect()
}

/// What stands directly inside `measured(.)`, which takes names only.
fn quoted(tree: &SyntaxTree) -> HashSet<ExprRef> {
    let arguments = tree.expressions.iter().filter_map(|(e, _)| match e {
        Expr::Call(name, arguments) if name.text == "measured" => arguments.first().copied(),
        _ => None,
    });
    arguments.collect()
}

fn recorded(name: &Name, span: Span) -> Diagnostic {
    let message = "`measured` is the record of an output, taken by its name";
    let hint = format!("a record through a block is written the other way round: `{}(measured(y), ...)`", name.text);
    Diagnostic::new(Code::WrongName, span, message).hint(hint)
}

fn argument_count(name: &Name, block: Block, form: &str, given: usize, span: Span) -> Diagnostic {
    let message = format!("`{}` takes {} arguments, {given} given", name.text, block.arguments());
    Diagnostic::new(Code::ArgumentCount, span, message).hint(format!("`{form}`"))
}

/// The name that stands for a block, made when no call has read the same before.
fn expanded(
    maker: &mut Maker<'_>,
    done: &mut HashMap<String, String>,
    block: Block,
    name: &Name,
    arguments: &[ExprRef],
    call: ExprRef,
) -> Result<String, Diagnostic> {
    let key = Printer::new(maker.tree).expression(call);
    if let Some(name) = done.get(&key) {
        return Ok(name.clone());
    }
    maker.begin(maker.tree.span(call));
    let x = maker.atom(arguments[0], &name.text, "in");
    let made = match block {
        Block::Lag => lag(maker, done, "lag", &x, arguments[1]),
        Block::Washout => {
            let lag = lag(maker, done, "washout", &x, arguments[1]);
            let (x_now, slow) = (maker.put(&x), maker.name(&lag));
            let value = maker.binary(Subtract, x_now, slow);
            let name = maker.fresh("washout", &x);
            let like = maker.put(&x);
            maker.define(&name, value, Made { like: Some(like), wants: Vec::new() })
        }
        Block::LeadLag => leadlag(maker, done, &x, [arguments[1], arguments[2]]),
        Block::SecondOrder => second_order(maker, &x, [arguments[1], arguments[2]]),
        Block::Transfer => transfer(maker, &x, [arguments[1], arguments[2]])?,
    };
    done.insert(key, made.clone());
    Ok(made)
}

/// `der(s) = (x - s)/T`, shared by all blocks with the same `x` and `T`.
fn lag(maker: &mut Maker<'_>, done: &mut HashMap<String, String>, block: &str, x: &Atom, constant: ExprRef) -> String {
    let constant = maker.atom(constant, block, "T");
    let key = format!("lag({x}, {constant})");
    if let Some(name) = done.get(&key) {
        return name.clone();
    }
    let state = maker.fresh("lag", x);
    let what = format!("the time constant of `{block}`");
    let wants = vec![Want { what, argument: maker.put(&constant), unit: Asked::Time, size: Size::Positive }];
    let like = maker.put(x);
    let x_first = maker.put(x);
    let initial = maker.call("initial", vec![x_first]);
    maker.state(&state, Some(initial), Made { like: Some(like), wants });
    let (x_now, own, constant) = (maker.put(x), maker.name(&state), maker.put(&constant));
    let above = maker.binary(Subtract, x_now, own);
    let rate = maker.binary(Divide, above, constant);
    maker.equation(&state, rate);
    done.insert(key, state.clone());
    state
}

/// `lag + T1/T2*(x - lag)`
fn leadlag(maker: &mut Maker<'_>, done: &mut HashMap<String, String>, x: &Atom, times: [ExprRef; 2]) -> String {
    use BinarySign::{Add, Divide, Multiply, Subtract};
    let lead = maker.atom(times[0], "leadlag", "T1");
    let trail = maker.atom(times[1], "leadlag", "T2");
    let place = maker.put(&trail);
    let slow = lag(maker, done, "leadlag", x, place);
    let what = "the lead time of `leadlag`".to_string();
    let wants = vec![Want { what, argument: maker.put(&lead), unit: Asked::Time, size: Size::Any }];
    let (over, under) = (maker.put(&lead), maker.put(&trail));
    let ratio = maker.binary(Divide, over, under);
    let (x_now, own) = (maker.put(x), maker.name(&slow));
    let fast = maker.binary(Subtract, x_now, own);
    let part = maker.binary(Multiply, ratio, fast);
    let own = maker.name(&slow);
    let value = maker.binary(Add, own, part);
    let name = maker.fresh("leadlag", x);
    let like = Some(maker.put(x));
    maker.define(&name, value, Made { like, wants })
}

/// `der(y) = v`, `der(v) = omega^2*(x - y) - 2*zeta*omega*v`
fn second_order(maker: &mut Maker<'_>, x: &Atom, [omega, zeta]: [ExprRef; 2]) -> String {
    use BinarySign::{Divide, Multiply, Power, Subtract};
    let omega = maker.atom(omega, "second_order", "omega");
    let zeta = maker.atom(zeta, "second_order", "zeta");
    let y = maker.fresh("second_order", x);
    let v = maker.fresh_as(&format!("{y}_rate"));
    let wants = vec![
        Want {
            what: "the frequency of `second_order`".into(),
            argument: maker.put(&omega),
            unit: Asked::Rate,
            size: Size::Positive,
        },
        Want {
            what: "the damping of `second_order`".into(),
            argument: maker.put(&zeta),
            unit: Asked::Number,
            size: Size::Any,
        },
    ];
    let (like, x_first) = (maker.put(x), maker.put(x));
    let initial = maker.call("initial", vec![x_first]);
    maker.state(&y, Some(initial), Made { like: Some(like), wants });
    let (over, t) = (maker.put(x), maker.name("t"));
    let like = maker.binary(Divide, over, t);
    maker.state(&v, None, Made { like: Some(like), wants: Vec::new() });
    let rate = maker.name(&v);
    maker.equation(&y, rate);
    let (base, two) = (maker.put(&omega), maker.number(2.0));
    let square = maker.binary(Power, base, two);
    let (x_now, y_now) = (maker.put(x), maker.name(&y));
    let above = maker.binary(Subtract, x_now, y_now);
    let spring = maker.binary(Multiply, square, above);
    let (two, zeta, omega, speed) = (maker.number(2.0), maker.put(&zeta), maker.put(&omega), maker.name(&v));
    let damping = [zeta, omega, speed].into_iter().fold(two, |a, b| maker.binary(Multiply, a, b));
    let rate = maker.binary(Subtract, spring, damping);
    maker.equation(&v, rate);
    y
}

/// Highest degree of a denominator.
const MOST_DEGREE: usize = 32;

/// Coefficients by power, the lowest first.
struct Ratio {
    over: Vec<Atom>,
    under: Vec<Atom>,
}

/// The name that stands for the output.
pub(super) fn transfer(maker: &mut Maker<'_>, x: &Atom, lists: [ExprRef; 2]) -> Result<String, Diagnostic> {
    let ratio = Ratio::read(maker, lists)?;
    let n = ratio.degree();
    if n == 0 {
        let name = maker.fresh("tf", x);
        let value = ratio.direct(maker, x).unwrap_or_else(|| maker.number(0.0));
        let made = Made { like: Some(ratio.unit(maker, x, 0)), wants: ratio.wants(maker) };
        return Ok(maker.define(&name, value, made));
    }
    let name = maker.fresh("tf", x);
    let proper = ratio.over.len() <= n;
    let states: Vec<String> =
        (1..=n).map(|j| if proper && j == 1 { name.clone() } else { maker.fresh_as(&format!("{name}_{j}")) }).collect();
    for (j, state) in states.iter().enumerate() {
        let wants = if j == 0 { ratio.wants(maker) } else { Vec::new() };
        let like = Some(ratio.unit(maker, x, j));
        let initial = ratio.rest(maker, x, j);
        maker.state(state, initial, Made { like, wants });
    }
    if !proper {
        let first = maker.name(&states[0]);
        let value = match ratio.direct(maker, x) {
            Some(direct) => maker.binary(Add, first, direct),
            None => first,
        };
        let like = Some(ratio.unit(maker, x, 0));
        maker.define(&name, value, Made { like, wants: Vec::new() });
    }
    for (j, state) in states.iter().enumerate() {
        let power = n - 1 - j;
        let input = ratio.over.get(power).and_then(|b| product(maker, b, x));
        let output = ratio.feedback(maker, power, &name);
        let fed = difference(maker, input, output);
        let fed = ratio.over_leading(maker, fed);
        let next = states.get(j + 1).map(|next| maker.name(next));
        let rate = match (next, fed) {
            (Some(next), Some(fed)) => maker.binary(Add, next, fed),
            (one, other) => one.or(other).unwrap_or_else(|| maker.number(0.0)),
        };
        maker.equation(state, rate);
    }
    Ok(name)
}

/// `b*x`; nothing when the coefficient is zero.
fn product(maker: &mut Maker<'_>, b: &Atom, x: &Atom) -> Option<ExprRef> {
    if b.is(0.0) {
        return None;
    }
    let x = maker.put(x);
    if b.is(1.0) {
        return Some(x);
    }
    let b = maker.put(b);
    Some(maker.binary(Multiply, b, x))
}

/// `a - b`, where either may be missing.
fn difference(maker: &mut Maker<'_>, a: Option<ExprRef>, b: Option<ExprRef>) -> Option<ExprRef> {
    match (a, b) {
        (Some(a), Some(b)) => Some(maker.binary(Subtract, a, b)),
        (None, Some(b)) => Some(maker.minus(b)),
        (a, None) => a,
    }
}

impl Ratio {
    fn read(maker: &mut Maker<'_>, [over, under]: [ExprRef; 2]) -> Result<Self, Diagnostic> {
        let (at, place) = (maker.tree.span(over), maker.tree.span(under));
        let mut over = coefficients(maker, over, "b")?;
        let under = coefficients(maker, under, "a")?;
        while over.len() > 1 && over.last().is_some_and(|b| b.is(0.0)) {
            over.pop();
        }
        let refuse = |span: Span, message: String, hint: &str| {
            Err(Diagnostic::new(Code::BadBlock, span, message).hint(hint.to_string()))
        };
        if under.last().is_some_and(|a| a.is(0.0)) {
            let hint = "leave it out: the first coefficient is that of the highest power";
            return refuse(place, "the leading coefficient of the denominator is 0".into(), hint);
        }
        if over.len() > under.len() {
            let (m, n) = (over.len() - 1, under.len() - 1);
            let message = format!(
                "the numerator has degree {m}, the denominator {n}: such a transfer function differentiates its input"
            );
            let hint = "coefficients stand from the highest power down; the degree of the numerator is at most that of the denominator";
            return refuse(at, message, hint);
        }
        if under.len() > MOST_DEGREE + 1 {
            let message = format!("a denominator of degree {} is beyond the limit of {MOST_DEGREE}", under.len() - 1);
            return refuse(place, message, "write it as a chain of transfer functions");
        }
        Ok(Self { over, under })
    }

    fn degree(&self) -> usize {
        self.under.len() - 1
    }

    fn leading(&self) -> &Atom {
        &self.under[self.degree()]
    }

    /// Divided by the leading coefficient of the denominator.
    fn over_leading(&self, maker: &mut Maker<'_>, e: Option<ExprRef>) -> Option<ExprRef> {
        let e = e?;
        if self.leading().is(1.0) {
            return Some(e);
        }
        let leading = maker.put(self.leading());
        Some(maker.binary(Divide, e, leading))
    }

    /// What of the input goes straight to the output.
    fn direct(&self, maker: &mut Maker<'_>, x: &Atom) -> Option<ExprRef> {
        let direct = self.over.get(self.degree()).and_then(|b| product(maker, b, x));
        self.over_leading(maker, direct)
    }

    /// `a*y`
    fn feedback(&self, maker: &mut Maker<'_>, power: usize, y: &str) -> Option<ExprRef> {
        let a = &self.under[power];
        if a.is(0.0) {
            return None;
        }
        let y = maker.name(y);
        if a.is(1.0) {
            return Some(y);
        }
        let a = maker.put(a);
        Some(maker.binary(Multiply, a, y))
    }

    /// The output at rest, `b0/a0*x`.
    fn settled(&self, maker: &mut Maker<'_>, x: &Atom) -> Option<ExprRef> {
        let above = product(maker, &self.over[0], x)?;
        if self.under[0].is(1.0) {
            return Some(above);
        }
        let below = maker.put(&self.under[0]);
        Some(maker.binary(Divide, above, below))
    }

    /// State j at rest; an integrator has no rest, and all its states begin at zero.
    fn rest(&self, maker: &mut Maker<'_>, x: &Atom, j: usize) -> Option<ExprRef> {
        if self.under[0].is(0.0) {
            return None;
        }
        let settled = self.settled(maker, x);
        let n = self.degree();
        let value = if j == 0 {
            let direct = self.direct(maker, x);
            difference(maker, settled, direct)
        } else {
            // from the equation of the state before it, whose rate is zero
            let a = &self.under[n - j];
            let fed = match settled.filter(|_| !a.is(0.0)) {
                Some(settled) if a.is(1.0) => Some(settled),
                Some(settled) => {
                    let a = maker.put(a);
                    Some(maker.binary(Multiply, a, settled))
                }
                None => None,
            };
            let input = self.over.get(n - j).and_then(|b| product(maker, b, x));
            let sum = difference(maker, fed, input);
            self.over_leading(maker, sum)
        };
        value.map(|value| maker.call("initial", vec![value]))
    }

    /// An expression in the unit of state j: that of the output, by the coefficients of one power where there are such, over time^j.
    fn unit(&self, maker: &mut Maker<'_>, x: &Atom, j: usize) -> ExprRef {
        let there = |list: &[Atom], k: usize| list.get(k).is_some_and(|c| !c.is(0.0));
        let lowest = |list: &[Atom]| (0..list.len()).find(|k| there(list, *k)).unwrap_or(0);
        let common = (0..self.over.len()).find(|k| there(&self.over, *k) && there(&self.under, *k));
        let (i, k) = common.map_or_else(|| (lowest(&self.over), lowest(&self.under)), |k| (k, k));
        let (b, input, a) = (maker.put(&self.over[i]), maker.put(x), maker.put(&self.under[k]));
        let above = maker.binary(Multiply, b, input);
        let output = maker.binary(Divide, above, a);
        let power = k as i32 - i as i32 - j as i32;
        if power == 0 {
            return output;
        }
        let (t, n) = (maker.name("t"), maker.number(f64::from(power.unsigned_abs())));
        let time = maker.binary(Power, t, n);
        maker.binary(if power > 0 { Multiply } else { Divide }, output, time)
    }

    fn wants(&self, maker: &mut Maker<'_>) -> Vec<Want> {
        let mut wants = Vec::new();
        let all = [("numerator", &self.over), ("denominator", &self.under)];
        for (part, list) in all {
            for (power, atom) in list.iter().enumerate().rev() {
                let size = if part == "denominator" && power == self.degree() { Size::NotZero } else { Size::Any };
                wants.push(Want {
                    what: format!("this coefficient of the {part} of `tf`"),
                    argument: maker.put(atom),
                    unit: Asked::Coefficient { power: power as u32, denominator: part == "denominator" },
                    size,
                });
            }
        }
        wants
    }
}

/// The coefficients of a list, or a single one, the lowest power first.
fn coefficients(maker: &mut Maker<'_>, list: ExprRef, role: &str) -> Result<Vec<Atom>, Diagnostic> {
    let elements = match maker.tree.expr(list) {
        Expr::Vector(elements) => elements.clone(),
        _ => vec![list],
    };
    if let Some(inner) = elements.iter().find(|e| matches!(maker.tree.expr(**e), Expr::Vector(_))) {
        let finding = Diagnostic::new(Code::BadBlock, maker.tree.span(*inner), "a coefficient of `tf` is a number");
        return Err(finding.hint("`tf(x, [b1, b0], [1, a1, a0])`: coefficients from the highest power down"));
    }
    // brackets hold something where the text is read: without elements is only what was told to be no number
    if elements.is_empty() {
        let one = maker.number(1.0);
        return Ok(vec![maker.atom(one, "tf", role)]);
    }
    Ok(elements.into_iter().rev().map(|e| maker.atom(e, "tf", role)).collect())
}
