//! Blocks made states: `lag`, `leadlag`, `washout`, `second_order`, `tf` become states with equations of the core language.
//!
//! A block is at rest when a run begins, as if its input had always had its first value. Calls that read the same share their states.

use super::maker::{Atom, Maker};
use super::transfer;
use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;
use crate::syntax::{
    Asked, BinarySign, Expr, ExprRef, Made, Name, Printer, Size, StatementKind, SyntaxTree, Want, each_root,
};
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
            let value = maker.binary(BinarySign::Subtract, x_now, slow);
            let name = maker.fresh("washout", &x);
            let like = maker.put(&x);
            maker.define(&name, value, Made { like: Some(like), wants: Vec::new() })
        }
        Block::LeadLag => leadlag(maker, done, &x, [arguments[1], arguments[2]]),
        Block::SecondOrder => second_order(maker, &x, [arguments[1], arguments[2]]),
        Block::Transfer => transfer::transfer(maker, &x, [arguments[1], arguments[2]])?,
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
    let above = maker.binary(BinarySign::Subtract, x_now, own);
    let rate = maker.binary(BinarySign::Divide, above, constant);
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
