//! Units of what an effect brings, from the equations it enters: solved for, line by line, until nothing more follows.

use super::subject::{Balance, Subject, derived, value_of_let};
use super::turnover::Turnover;
use crate::conditions::Effect;
use fdm_grammar::syntax::{BinarySign, EffectLine, Expr, ExprRef, StatementKind, SyntaxTree, Value};
use fdm_grammar::unit::Unit;
use std::collections::{BTreeMap, HashMap};

/// A unit times powers of units that are looked for.
#[derive(Debug, Clone, PartialEq)]
enum Measure {
    /// A number in the text: adapts to what stands beside it.
    Number,
    /// Nothing can be said.
    Unknown,
    /// `unit * product of wanted^exponent`
    Known(Unit, BTreeMap<String, i32>),
}

/// The units of the effect's own names that follow from the model's.
pub(super) fn infer(effect: &Effect, subject: &Subject, bound: &HashMap<String, String>) -> HashMap<String, Unit> {
    let mut solver =
        Solver { effect, subject, bound, found: HashMap::new(), in_model: false, depth: 0, lets: HashMap::new() };
    let own = effect.tree().lines.len() + 1;
    // every round that finds nothing new is the last one
    for _ in 0..=own {
        let before = solver.found.len();
        solver.lines();
        if solver.found.len() == before {
            break;
        }
    }
    solver.found
}

struct Solver<'a> {
    effect: &'a Effect,
    subject: &'a Subject,
    bound: &'a HashMap<String, String>,
    found: HashMap<String, Unit>,
    /// Whether an expression of the model is looked at, and not one of the effect; and how many lets deep.
    in_model: bool,
    depth: usize,
    /// What names of the model were found to be measured in.
    lets: HashMap<String, Measure>,
}

impl Solver<'_> {
    fn lines(&mut self) {
        let effect = self.effect;
        let tree = effect.tree();
        for (line, _) in &tree.lines {
            match line {
                EffectLine::Add(place, term) => {
                    let value = self.value(*term);
                    let own = match place.derivative {
                        true => self.balance(&place.name.text),
                        false => self.name(&place.name.text),
                    };
                    self.unify(&own, &value);
                }
                EffectLine::Replace(name, with) => {
                    let (own, value) = (self.name(&name.text), self.value(*with));
                    self.unify(&own, &value);
                }
                EffectLine::Equation(left, right) => {
                    let value = self.value(*right);
                    let own = derived(&tree.pool, *left).map_or(Measure::Unknown, |s| self.name(s));
                    let own = self.rate(own);
                    self.unify(&own, &value);
                }
                EffectLine::Own(_, list) => {
                    for d in list {
                        if let Some(Value::Expr(e)) = d.value {
                            let (own, value) = (self.name(&d.name.text), self.value(e));
                            self.unify(&own, &value);
                        }
                    }
                }
                EffectLine::Tunable(t) => {
                    let own = self.name(&t.declaration.name.text);
                    for e in &t.trials {
                        let value = self.value(*e);
                        self.unify(&own, &value);
                    }
                }
                EffectLine::Noise(place, intensity) => {
                    // an intensity is the deviation of a white noise: unit of the rate times the root of time
                    let _ = (place, self.value(*intensity));
                }
            }
        }
    }

    fn time(&self) -> Measure {
        known(self.subject.model().time.clone())
    }

    fn rate(&self, of: Measure) -> Measure {
        product(&of, &self.time(), true)
    }

    /// What is added to the balance of a state: its rate, or what Newton's form balances.
    fn balance(&mut self, slot: &str) -> Measure {
        let balance = self.bound.get(slot).and_then(|state| self.subject.balance(state));
        match balance.and_then(Balance::of_forces) {
            Some(balance) => {
                self.in_model = true;
                let statement = self.subject.tree.statements.iter().find(|s| s.span == balance.statement);
                let sides = match statement.map(|s| &s.kind) {
                    Some(StatementKind::Equation(left, right)) => [*left, *right],
                    _ => [balance.side; 2],
                };
                // a side may be a number, or hold names of other texts
                let sides = sides.map(|side| self.value(side));
                self.in_model = false;
                sides.into_iter().find(|side| matches!(side, Measure::Known(..))).unwrap_or(Measure::Unknown)
            }
            None => self.rate(self.name(slot)),
        }
    }

    /// What a name of the model is measured in; a `let` without a unit is looked through, once.
    fn name_of_model(&mut self, name: &str) -> Measure {
        match name {
            "t" => return self.time(),
            "pi" | "inf" => return Measure::Number,
            _ => {}
        }
        if let Some(known) = self.lets.get(name) {
            return known.clone();
        }
        let declaration = self.subject.declaration(name).map(|(_, declaration, _)| declaration);
        let value = match declaration.filter(|d| d.unit.is_none()).and_then(|_| value_of_let(&self.subject.tree, name))
        {
            // lets that stand in each other more deeply have no unit here
            // lets that are looked through, one in the other
            Some(value) if self.depth < 16 => {
                self.depth += 1;
                let found = self.value(value);
                self.depth -= 1;
                found
            }
            _ => self.subject.unit(name).map_or(Measure::Unknown, known),
        };
        self.lets.insert(name.to_string(), value.clone());
        value
    }

    /// What a name is measured in.
    fn name(&self, name: &str) -> Measure {
        match name {
            "t" => return self.time(),
            "pi" | "inf" => return Measure::Number,
            _ => {}
        }
        if let Some(target) = self.bound.get(name) {
            return self.subject.unit(target).map_or(Measure::Unknown, known);
        }
        match (self.found.get(name), name) {
            (Some(unit), _) => known(unit.clone()),
            (None, "step" | "duration") if !self.is_own(name) => self.time(),
            (None, _) => Measure::Known(Unit::one(), BTreeMap::from([(name.to_string(), 1)])),
        }
    }

    fn is_own(&self, name: &str) -> bool {
        self.effect.tree().lines.iter().any(|(line, _)| match line {
            EffectLine::Tunable(t) => t.declaration.name.text == name,
            EffectLine::Own(_, list) => list.iter().any(|d| d.name.text == name),
            _ => false,
        })
    }

    fn value(&mut self, root: ExprRef) -> Measure {
        let (effect, subject) = (self.effect, self.subject);
        let pool = if self.in_model { &subject.tree } else { &effect.tree().pool };
        // only what the root needs: other expressions of the pool say things of their own
        let mut wanted = vec![false; root.0 as usize + 1];
        wanted[root.0 as usize] = true;
        for k in (0..=root.0).rev() {
            if wanted[k as usize] {
                pool.expr(ExprRef(k)).each_operand(|o| wanted[o.0 as usize] = true);
            }
        }
        let mut values = vec![Measure::Unknown; root.0 as usize + 1];
        for k in (0..=root.0).filter(|k| wanted[*k as usize]) {
            values[k as usize] = self.node(pool, ExprRef(k), &values);
        }
        values.swap_remove(root.0 as usize)
    }

    fn node(&mut self, pool: &SyntaxTree, e: ExprRef, values: &[Measure]) -> Measure {
        let at = |e: &ExprRef| values[e.0 as usize].clone();
        match pool.expr(e) {
            Expr::Number(_) => Measure::Number,
            Expr::Name(name) if self.in_model => self.name_of_model(name),
            Expr::Name(name) => self.name(name),
            Expr::Unary(_, a) => at(a),
            Expr::Binary(sign, a, b, _) => match sign {
                BinarySign::Multiply => product(&at(a), &at(b), false),
                BinarySign::Divide => product(&at(a), &at(b), true),
                BinarySign::Power => match pool.expr(*b) {
                    Expr::Number(n) if n.fract() == 0.0 && n.abs() < 100.0 => power(&at(a), *n as i32),
                    // pure numbers, both
                    _ => {
                        let one = known(Unit::one());
                        self.unify(&one, &at(b));
                        self.unify(&one, &at(a))
                    }
                },
                BinarySign::And | BinarySign::Or => Measure::Number,
                _ => self.unify(&at(a), &at(b)),
            },
            Expr::If(_, a, b) => self.unify(&at(a), &at(b)),
            Expr::Call(name, arguments) if matches!(name.text.as_str(), "consumed" | "made") && !self.in_model => {
                let turnover = if name.text == "made" { Turnover::Produced } else { Turnover::Consumed };
                let param = arguments.first().map(|a| pool.expr(*a));
                let Some(Expr::Name(slot)) = param else { return Measure::Unknown };
                let species = self.bound.get(slot).map_or(Vec::new(), |p| self.subject.species(p, turnover));
                species.into_iter().fold(known(Unit::one()), |all, x| {
                    product(&all, &self.subject.unit(x).map_or(Measure::Unknown, known), false)
                })
            }
            Expr::Call(name, arguments) => {
                let list: Vec<Measure> = arguments.iter().map(at).collect();
                self.call(&name.text, &list)
            }
            Expr::Vector(_) | Expr::Element(..) => Measure::Unknown,
        }
    }

    fn call(&mut self, name: &str, list: &[Measure]) -> Measure {
        let first = list.first().cloned().unwrap_or(Measure::Unknown);
        let one = known(Unit::one());
        match name {
            "abs" | "measured" | "scale" | "size" | "quantile" | "level" | "positive" | "absolute_zero" | "start" => {
                first
            }
            "sign" => one,
            "der" | "speed" => self.rate(first),
            "min" | "max" | "hypot" | "clip" | "deadzone" => {
                list.iter().skip(1).fold(first, |all, next| self.unify(&all, next))
            }
            "grid" => list.iter().take(2).skip(1).fold(first, |all, next| self.unify(&all, next)),
            "atan2" => {
                list.iter().skip(1).fold(first, |all, next| self.unify(&all, next));
                known(Unit::radian())
            }
            "sqrt" => match first {
                Measure::Known(unit, wanted) if wanted.is_empty() => unit.root(2).map_or(Measure::Unknown, known),
                _ => Measure::Unknown,
            },
            "delay" | "lag" | "leadlag" | "washout" => {
                let time = self.time();
                list.iter().skip(1).for_each(|tau| drop(self.unify(&time, tau)));
                first
            }
            "second_order" => {
                let frequency = product(&one, &self.time(), true);
                let wanted = [frequency, one];
                list.iter().skip(1).zip(&wanted).for_each(|(own, wanted)| drop(self.unify(wanted, own)));
                first
            }
            "sin" | "cos" | "tan" | "asin" | "acos" | "atan" | "sinh" | "cosh" | "tanh" | "exp" | "log" | "log10" => {
                self.unify(&one, &first);
                one
            }
            _ => Measure::Unknown,
        }
    }

    /// Two things of one unit: what is looked for in one of them follows from the other.
    fn unify(&mut self, a: &Measure, b: &Measure) -> Measure {
        match (a, b) {
            (Measure::Number, other) | (other, Measure::Number) => other.clone(),
            (Measure::Unknown, other) | (other, Measure::Unknown) => other.clone(),
            (Measure::Known(u, x), Measure::Known(v, y)) => {
                let (fixed, open, wanted) = if x.is_empty() { (u, v, y) } else { (v, u, x) };
                if (x.is_empty() || y.is_empty())
                    && let Some((name, exponent)) = wanted.iter().next().filter(|_| wanted.len() == 1)
                    && !self.found.contains_key(name)
                {
                    let power = fixed.quotient(open);
                    let unit = match exponent {
                        0 => None,
                        e if *e > 0 => power.and_then(|u| if *e == 1 { Some(u) } else { u.root(*e) }),
                        e => power.and_then(|u| if *e == -1 { u.power(-1) } else { u.power(-1)?.root(-*e) }),
                    };
                    if let Some(unit) = unit {
                        self.found.insert(name.clone(), unit);
                    }
                }
                Measure::Known(fixed.clone(), if x.is_empty() { x.clone() } else { y.clone() })
            }
        }
    }
}

fn known(unit: Unit) -> Measure {
    Measure::Known(unit, BTreeMap::new())
}

fn product(a: &Measure, b: &Measure, divide: bool) -> Measure {
    let sign = if divide { -1 } else { 1 };
    match (a, b) {
        (Measure::Unknown, _) | (_, Measure::Unknown) => Measure::Unknown,
        (a, Measure::Number) => a.clone(),
        (Measure::Number, b) if !divide => b.clone(),
        (Measure::Number, b) => power(b, -1),
        (Measure::Known(u, x), Measure::Known(v, y)) => {
            let unit = if divide { u.quotient(v) } else { u.product(v) };
            let mut wanted = x.clone();
            for (name, exponent) in y {
                *wanted.entry(name.clone()).or_insert(0) += sign * exponent;
            }
            wanted.retain(|_, e| *e != 0);
            unit.map_or(Measure::Unknown, |u| Measure::Known(u, wanted))
        }
    }
}

fn power(a: &Measure, n: i32) -> Measure {
    match a {
        Measure::Known(unit, wanted) => match unit.power(n) {
            Some(unit) => Measure::Known(unit, wanted.iter().map(|(k, e)| (k.clone(), e * n)).collect()),
            None => Measure::Unknown,
        },
        other => other.clone(),
    }
}
