//! Reactions made equations: every species that is a state gets the balance of what the reactions make of it and take of it.
//!
//! **In** `A + 2*B -> C : k*A*B;`, or `n*B` with a param `n`. **Out** `der(A) = -(k*A*B);` and its like, in the order of the text, so that
//! numbers are those of the equations written by hand; `reaction(A)` in an equation of one's own; `arrhenius(k, E, T, T_ref)`. **Never** a balance that makes matter:
//! masses above zero must exist that every closed reaction keeps (stoichiometric consistency: Gevorgyan, Poolman, Fell,
//! Bioinformatics 24, 2008).

use super::maker::Maker;
use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::source::Span;
use crate::syntax::{
    BinarySign, Declaration, Expr, ExprRef, Made, Name, Reaction, Role, StatementKind, SyntaxTree, Value,
};
use crate::unit::Unit;

/// Molar gas constant, exact since 2019.
const GAS_CONSTANT: f64 = 8.314_462_618_153_24;

/// How far the start value of an estimated coefficient is moved before masses are sought: those that exist at one value only do not
/// count. As a part of the value; far above the rounding of the search.
const MOVED: f64 = 1e-3;

/// A share of a species in a balance.
struct Share {
    /// How many are made.
    count: f64,
    /// The param that tells how many, times the count.
    factor: Option<Name>,
    rate: ExprRef,
}

/// What a reaction makes of a species.
struct Net<'a> {
    species: &'a Name,
    count: f64,
    factor: Option<&'a Name>,
}

/// What the reactions say of one species.
struct Balance {
    name: Name,
    shares: Vec<Share>,
    /// The volume in which they happen, where amounts are counted.
    volume: Option<ExprRef>,
}

/// Rewrites all reactions of a text, and the functions that belong to them.
pub(super) fn reactions(tree: &mut SyntaxTree, findings: &mut Vec<Diagnostic>) {
    arrhenius(tree, findings);
    let statements = std::mem::take(&mut tree.statements);
    let (own, rest): (Vec<_>, Vec<_>) =
        statements.into_iter().partition(|s| matches!(s.kind, StatementKind::Reactions(..)));
    tree.statements = rest;
    let calls = calls(tree, "reaction");
    if own.is_empty() && calls.is_empty() {
        return;
    }
    let declared = declared(tree);
    let mut balances: Vec<Balance> = Vec::new();
    for statement in &own {
        let StatementKind::Reactions(volume, list) = &statement.kind else { continue };
        let wrong: Vec<Diagnostic> = list.iter().flat_map(|r| coefficients(r, &declared)).collect();
        if wrong.is_empty() {
            findings.extend(imbalance(tree, list, statement.span, &declared));
        }
        // what was told is left out of the balances, or its units would be told as theirs
        let told: Vec<Span> = wrong.iter().map(|finding| finding.span).collect();
        findings.extend(wrong);
        for reaction in list {
            let mut maker = Maker::new(tree);
            maker.begin(maker.tree.span(reaction.forward));
            let rate = match reaction.reverse {
                Some(reverse) => maker.binary(BinarySign::Subtract, reaction.forward, reverse),
                None => reaction.forward,
            };
            for Net { species: name, count, factor } in net(reaction) {
                if name.text.contains('[') {
                    let message =
                        format!("`{}` is an element of a vector, and a species has a name of its own", name.text);
                    let hint = "declare a state for each species: `state A, B;`";
                    findings.push(Diagnostic::new(Code::BadReaction, name.span, message).hint(hint));
                    continue;
                }
                let factor = factor.filter(|factor| !told.contains(&factor.span)).cloned();
                let own = Share { count, factor, rate };
                share(&mut balances, name, *volume, own, findings);
            }
        }
    }
    let mut named = Vec::new();
    for call in calls {
        match balance_of(tree, call, &balances) {
            Ok(k) => named.push((call, k)),
            Err(finding) => {
                findings.push(finding);
                let silent = Maker::new(tree).silent();
                tree.expressions[call.0 as usize].0 = silent;
            }
        }
    }
    for (k, balance) in balances.iter().enumerate() {
        let Balance { name, shares, volume } = balance;
        let role = declared.iter().find(|(_, d)| d.name.text == name.text).map(|(role, _)| *role);
        // inputs, params and numbers are held by something else
        if role.is_some_and(|role| role != Role::State) || shares.iter().all(|s| s.count == 0.0) && role.is_none() {
            continue;
        }
        let has_equation = equation_of(tree, &name.text);
        let mut maker = Maker::new(tree);
        maker.begin(name.span);
        let rate = sum(&mut maker, shares, *volume);
        let uses: Vec<ExprRef> = named.iter().filter(|(_, of)| *of == k).map(|(call, _)| *call).collect();
        if !uses.is_empty() {
            let wanted = maker.fresh_as(&format!("reaction_{}", name.text.replace(['[', ']', ',', '.'], "_")));
            let made = maker.define(&wanted, rate, Made::default());
            uses.iter().for_each(|call| maker.tree.expressions[call.0 as usize].0 = Expr::Name(made.clone()));
        } else if let Some(other) = has_equation {
            let message = format!("`{}` has an equation of its own beside the reactions", name.text);
            let hint = format!("write into it what the reactions do: `der({0}) = ... + reaction({0})`", name.text);
            findings.push(
                Diagnostic::new(Code::TwoEquations, other, message).label(name.span, "it reacts here").hint(hint),
            );
        } else {
            maker.equation(&name.text, rate);
        }
    }
}

/// Adds a share to the balance of a species.
fn share(
    balances: &mut Vec<Balance>,
    name: &Name,
    volume: Option<ExprRef>,
    share: Share,
    findings: &mut Vec<Diagnostic>,
) {
    match balances.iter_mut().find(|b| b.name.text == name.text) {
        Some(balance) if balance.volume == volume => balance.shares.push(share),
        Some(balance) => {
            let message = format!("`{}` reacts in two volumes", name.text);
            let hint =
                "name the species in each volume by itself, and say by a reaction what goes from one to the other";
            let finding = Diagnostic::new(Code::BadReaction, name.span, message).hint(hint);
            findings.push(finding.label(balance.name.span, "first here"));
        }
        None => balances.push(Balance { name: name.clone(), shares: vec![share], volume }),
    }
}

/// How many of each species a reaction makes, in the order in which they stand; by each param that tells how many for itself.
fn net(reaction: &Reaction) -> Vec<Net<'_>> {
    let mut net: Vec<Net<'_>> = Vec::new();
    for (side, sign) in [(&reaction.left, -1.0), (&reaction.right, 1.0)] {
        for one in side {
            let factor = one.factor.as_ref();
            let same = |n: &&mut Net<'_>| {
                n.species.text == one.name.text && n.factor.map(|f| &f.text) == factor.map(|f| &f.text)
            };
            match net.iter_mut().find(same) {
                Some(n) => n.count += sign * one.count,
                None => net.push(Net { species: &one.name, count: sign * one.count, factor }),
            }
        }
    }
    net
}

/// What is wrong with the coefficients of a reaction that are names.
fn coefficients(reaction: &Reaction, declared: &[(Role, Declaration)]) -> Vec<Diagnostic> {
    let factors = reaction.left.iter().chain(&reaction.right).filter_map(|species| species.factor.as_ref());
    let one = |factor: &Name| {
        // what is not declared, and what belongs to a submodel, is judged where names are
        let (role, own) = declared.iter().find(|(_, d)| d.name.text == factor.text)?;
        let name = &factor.text;
        if *role != Role::Param {
            let message =
                format!("`{name}` is {}, and a stoichiometric coefficient is a number or a param", role.with_article());
            let hint = format!("declare it with `param {name} = 2;`");
            return Some(
                Diagnostic::new(Code::WrongName, factor.span, message).label(own.name.span, "declared here").hint(hint),
            );
        }
        let unit = own.unit.as_ref()?;
        let wrong = Unit::parse(&unit.text).is_ok_and(|u| !u.is_one());
        let message = format!("`{name}` is in {}, and a stoichiometric coefficient has no unit", unit.text);
        wrong.then(|| {
            Diagnostic::new(Code::UnitMismatch, factor.span, message)
                .label(unit.span, "its unit")
                .hint(format!("write `param {name} [1]`"))
        })
    };
    factors.filter_map(one).collect()
}

/// The value that a coefficient starts at, where it is written as a number, moved where it is estimated.
fn at_start(tree: &SyntaxTree, name: &str, declared: &[(Role, Declaration)]) -> Option<f64> {
    let place = declared.iter().position(|(_, d)| d.name.text == name)?;
    let own = &declared[place].1;
    let Some(Value::Expr(value)) = own.value else { return None };
    let Expr::Number(value) = *tree.expr(value) else { return None };
    // roots of different numbers: several coefficients are not moved together
    let moved = if own.fixed.is_some() { 0.0 } else { MOVED * (place as f64 + 2.0).sqrt() };
    Some(value * (1.0 + moved))
}

/// `V*(-r1 + 2*r2)`, in the order of the text.
fn sum(maker: &mut Maker<'_>, shares: &[Share], volume: Option<ExprRef>) -> ExprRef {
    let mut total: Option<ExprRef> = None;
    for Share { count, factor, rate } in shares.iter().filter(|s| s.count != 0.0) {
        let number = (count.abs() != 1.0).then(|| maker.number(count.abs()));
        let factor = factor.as_ref().map(|factor| maker.named(factor));
        let term = number
            .into_iter()
            .chain(factor)
            .chain([*rate])
            .reduce(|a, b| maker.binary(BinarySign::Multiply, a, b))
            .unwrap_or(*rate);
        total = Some(match (total, *count > 0.0) {
            (None, true) => term,
            (None, false) => maker.minus(term),
            (Some(before), true) => maker.binary(BinarySign::Add, before, term),
            (Some(before), false) => maker.binary(BinarySign::Subtract, before, term),
        });
    }
    match (total, volume) {
        (Some(total), Some(volume)) => maker.binary(BinarySign::Multiply, volume, total),
        (Some(total), None) => total,
        // a catalyst stays what it is: nothing of the unit of its rates
        (None, _) => {
            let rate = shares.first().map_or_else(|| maker.number(0.0), |s| s.rate);
            let zero = maker.number(0.0);
            let nothing = maker.binary(BinarySign::Multiply, zero, rate);
            volume.map_or(nothing, |volume| maker.binary(BinarySign::Multiply, volume, nothing))
        }
    }
}

/// The balance that `reaction(A)` means.
fn balance_of(tree: &SyntaxTree, call: ExprRef, balances: &[Balance]) -> Result<usize, Diagnostic> {
    let span = tree.span(call);
    let Expr::Call(_, arguments) = tree.expr(call) else { return Err(argument_count(span, 0)) };
    let [argument] = arguments[..] else { return Err(argument_count(span, arguments.len())) };
    let name = match tree.expr(argument) {
        Expr::Name(name) => name.clone(),
        _ => {
            let message = "`reaction` is what the reactions make of a species, taken by its name";
            return Err(Diagnostic::new(Code::WrongName, tree.span(argument), message).hint("`reaction(A)`"));
        }
    };
    balances.iter().position(|b| b.name.text == name).ok_or_else(|| {
        let finding =
            Diagnostic::new(Code::WrongName, tree.span(argument), format!("`{name}` takes part in no reaction"));
        match nearest(&name, balances.iter().map(|b| b.name.text.as_str())) {
            Some(near) => finding.hint(format!("did you mean `{near}`?")),
            None => finding.hint("species stand in `reactions { A + B -> C : k*A*B; }`"),
        }
    })
}

fn argument_count(span: Span, given: usize) -> Diagnostic {
    Diagnostic::new(Code::ArgumentCount, span, format!("`reaction` takes 1 argument, {given} given"))
        .hint("`reaction(A)`")
}

/// Where a state has an equation of its own.
fn equation_of(tree: &SyntaxTree, state: &str) -> Option<Span> {
    tree.statements.iter().find_map(|s| {
        let StatementKind::Equation(left, _) = s.kind else { return None };
        let Expr::Call(call, arguments) = tree.expr(left) else { return None };
        let is =
            call.text == "der" && matches!(arguments[..], [a] if matches!(tree.expr(a), Expr::Name(n) if n == state));
        is.then_some(s.span)
    })
}

/// What is declared, and as what.
fn declared(tree: &SyntaxTree) -> Vec<(Role, Declaration)> {
    let lists = tree.statements.iter().filter_map(|s| match &s.kind {
        StatementKind::Declare(role, list) => Some(list.iter().map(|d| (*role, d.clone()))),
        _ => None,
    });
    lists.flatten().collect()
}

/// The calls of a function that the text does not declare itself.
fn calls(tree: &SyntaxTree, function: &str) -> Vec<ExprRef> {
    let is_table = |s: &crate::syntax::Statement| matches!(&s.kind, StatementKind::Table(t) if t.name.text == function);
    if tree.statements.iter().any(is_table) {
        return Vec::new();
    }
    let all = tree.expressions.iter().enumerate();
    let calls = all.filter(|(_, (e, _))| matches!(e, Expr::Call(name, _) if name.text == function));
    calls.map(|(k, _)| ExprRef(k as u32)).collect()
}

/// `arrhenius(k, E, T, T_ref)` is `k*exp(E/R*(1/T_ref - 1/T))`, with the gas constant as a const with its unit.
fn arrhenius(tree: &mut SyntaxTree, findings: &mut Vec<Diagnostic>) {
    let calls = calls(tree, "arrhenius");
    if calls.is_empty() {
        return;
    }
    let mut maker = Maker::new(tree);
    let constant = maker.fresh_as("molar_gas_constant");
    let mut any = false;
    for call in calls {
        let span = maker.tree.span(call);
        let Expr::Call(_, arguments) = maker.tree.expr(call).clone() else { continue };
        let [k, energy, temperature, reference] = arguments[..] else {
            let message = format!("`arrhenius` takes 4 arguments, {} given", arguments.len());
            findings.push(Diagnostic::new(Code::ArgumentCount, span, message).hint("`arrhenius(k_ref, E, T, T_ref)`"));
            maker.tree.expressions[call.0 as usize].0 = maker.silent();
            continue;
        };
        maker.begin(span);
        any = true;
        let gas = maker.name(&constant);
        let scaled = maker.binary(BinarySign::Divide, energy, gas);
        let one = maker.number(1.0);
        let cold = maker.binary(BinarySign::Divide, one, reference);
        let hot = maker.binary(BinarySign::Divide, one, temperature);
        let between = maker.binary(BinarySign::Subtract, cold, hot);
        let exponent = maker.binary(BinarySign::Multiply, scaled, between);
        let factor = maker.call("exp", vec![exponent]);
        let value = maker.binary(BinarySign::Multiply, k, factor);
        // operands stand before what they are in: the call becomes a name
        let name = maker.fresh_as("arrhenius_1");
        let name = maker.define(&name, value, Made::default());
        maker.tree.expressions[call.0 as usize].0 = Expr::Name(name);
    }
    if any {
        maker.begin(Span::default());
        let value = maker.number(GAS_CONSTANT);
        maker.constant(&constant, value, "J/(mol*K)");
    }
}

/// Whether closed reactions make matter: there are no masses above zero that all of them keep.
fn imbalance(tree: &SyntaxTree, list: &[Reaction], span: Span, declared: &[(Role, Declaration)]) -> Option<Diagnostic> {
    let counted = |r| -> Option<Vec<(&str, f64)>> {
        let one = |Net { species, count, factor }| {
            let factor = factor.map_or(Some(1.0), |factor: &Name| at_start(tree, &factor.text, declared))?;
            Some((species.text.as_str(), count * factor))
        };
        // what is not a number yet may keep any mass
        net(r).into_iter().map(one).collect()
    };
    let (closed, nets): (Vec<&Reaction>, Vec<_>) =
        list.iter().filter(|r| !r.is_open).filter_map(|r| Some((r, counted(r)?))).unzip();
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in nets.iter().flatten() {
        if !names.contains(name) {
            names.push(name);
        }
    }
    if names.is_empty() || names.len() * closed.len() > 1 << 16 {
        return None;
    }
    let rows: Vec<Vec<f64>> = nets
        .iter()
        .map(|net| {
            let count = |name: &&str| net.iter().filter(|(n, _)| n == name).map(|(_, count)| count).sum::<f64>();
            names.iter().map(count).collect()
        })
        .collect();
    if has_masses(&rows, names.len()) {
        return None;
    }
    // the first reaction with which the ones before it no longer agree
    let first = (1..=rows.len()).find(|n| !has_masses(&rows[..*n], names.len())).unwrap_or(rows.len()) - 1;
    let at = closed.get(first).map_or(span, |r| r.span);
    let message = "no masses above zero are kept by this reaction and those before it: matter would come from nothing";
    let hint = "mend the numbers of the species, or write `0` on a side where something takes part that is not modelled: `0 + X -> 2*X : mu*X;`";
    Some(Diagnostic::new(Code::BadReaction, at, message).hint(hint))
}

/// Whether `N m = 0` has a solution with every mass at least 1 (rows: reactions, columns: species): the first phase of the simplex
/// method, by Bland's rule, which ends.
fn has_masses(rows: &[Vec<f64>], species: usize) -> bool {
    const ROUNDING: f64 = 1e-9;
    let count = rows.len();
    // m = 1 + s, s >= 0: N s = -N 1, signs turned so that the right side is not negative; an artificial variable each
    let mut tableau: Vec<Vec<f64>> = Vec::with_capacity(count + 1);
    for (k, row) in rows.iter().enumerate() {
        let right: f64 = -row.iter().sum::<f64>();
        let sign = if right < 0.0 { -1.0 } else { 1.0 };
        let mut line: Vec<f64> = row.iter().map(|v| sign * v).collect();
        line.extend((0..count).map(|j| f64::from(u8::from(j == k))));
        line.push(sign * right);
        tableau.push(line);
    }
    let width = species + count + 1;
    let mut cost = vec![0.0; width];
    for line in &tableau {
        cost.iter_mut()
            .zip(line)
            .enumerate()
            .for_each(|(j, (c, v))| *c -= if (species..species + count).contains(&j) { 0.0 } else { *v });
    }
    let mut basis: Vec<usize> = (species..species + count).collect();
    // by Bland's rule no basis comes twice; rounding may break that, hence an end
    for _ in 0..50 * (species + count) {
        let Some(enter) = (0..species).find(|j| cost[*j] < -ROUNDING) else { break };
        let ratio = |i: &usize| tableau[*i][width - 1] / tableau[*i][enter];
        let rows = (0..count).filter(|i| tableau[*i][enter] > ROUNDING);
        let leave = rows.min_by(|a, b| ratio(a).total_cmp(&ratio(b)).then(basis[*a].cmp(&basis[*b])));
        let Some(leave) = leave else { break };
        let pivot = tableau[leave][enter];
        tableau[leave].iter_mut().for_each(|v| *v /= pivot);
        let line = tableau[leave].clone();
        let reduce = |other: &mut Vec<f64>| {
            let factor = other[enter];
            other.iter_mut().zip(&line).for_each(|(v, own)| *v -= factor * own);
        };
        tableau.iter_mut().enumerate().filter(|(i, _)| *i != leave).for_each(|(_, other)| reduce(other));
        reduce(&mut cost);
        basis[leave] = enter;
    }
    // what the artificial variables still hold
    let scale: f64 = rows.iter().flatten().fold(1.0, |m: f64, v| m.max(v.abs()));
    -cost[width - 1] <= ROUNDING * scale * (species + count) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::graph::Leaf;
    use crate::source::Source;

    fn rates(text: &str) -> Vec<(String, u64)> {
        let source = Source::new("test.fdm", text);
        let compiled = crate::compile(&source)
            .unwrap_or_else(|found| panic!("{}", found.iter().map(|f| f.line(&source)).collect::<Vec<_>>().join("\n")));
        let model = compiled.model;
        let value = |leaf| match leaf {
            Leaf::Time => 0.7,
            Leaf::Input(k) => 311.3 + f64::from(k),
            Leaf::State(k) => (1.1 + f64::from(k)).sqrt(),
            Leaf::Param(k) => 0.3 / (1.7 + f64::from(k)),
            Leaf::Delayed(_) => f64::NAN,
        };
        let rate = |s: &crate::model::State| (s.quantity.name.clone(), model.graph.evaluate(s.rate, value).to_bits());
        model.states.iter().map(rate).collect()
    }

    const DECLARED: &str = "model m {
      state A [mol/l] = 1, B [mol/l], C [mol/l], X [mol/l];
      param k1 [l/(mol*s)] = 1, kf [1/s] = 2, kr [1/s] = 3, kd [1/s] = 0.1, E [J/mol] = 5e4;
      input T [K], q [1/s];
      const T0 = 330 [K];
      output y [mol/l] = A;";

    #[test]
    fn balances_are_those_written_by_hand_to_the_bit() {
        let made = rates(&format!(
            "{DECLARED} reactions {{ A + 2*B -> C : k1*A*B; C <-> 2 X : kf*C, kr*X; X -> 0 : kd*X; }} }}"
        ));
        let hand = rates(&format!(
            "{DECLARED} der(A) = -(k1*A*B); der(B) = -(2*(k1*A*B));
             der(C) = k1*A*B - (kf*C - kr*X); der(X) = 2*(kf*C - kr*X) - kd*X; }}"
        ));
        assert_eq!(made, hand);
        let made = rates(&format!(
            "{DECLARED} let k = arrhenius(kf, E, T, T0);
             reactions {{ A + X -> B + X : k*A; 0 -> C : kd*A; }}
             der(A) = q*(1 - A) + reaction(A); }}"
        ));
        let hand = rates(&format!(
            "{DECLARED} const R = 8.31446261815324 [J/(mol*K)];
             let k = kf*exp(E/R*(1/T0 - 1/T));
             der(A) = q*(1 - A) + -(k*A); der(B) = k*A; der(C) = kd*A; der(X) = 0; }}"
        ));
        assert_eq!(made, hand);
    }

    #[test]
    fn a_param_may_tell_how_many_react() {
        let declared = format!("{DECLARED} param n = 2, m = 1 in [0, 3];");
        let made = rates(&format!("{declared} reactions {{ A + n*B -> C : k1*A*B; C + 2*m*X -> 3*m*X : kf*C; }} }}"));
        let hand = rates(&format!(
            "{declared} der(A) = -(k1*A*B); der(B) = -(n*(k1*A*B)); der(C) = k1*A*B - kf*C;
             der(X) = m*(kf*C); }}"
        ));
        assert_eq!(made, hand);
        let refused = |reactions: &str, n: &str| {
            let text = format!(
                "model m {{ state A = 1, B, C; param k = 1, n = {n}; reactions {{ {reactions} }} output y = B; }}"
            );
            let said = crate::compile(&Source::new("test.fdm", &text)).err().unwrap_or_default();
            said.iter().any(|d| d.code == Code::BadReaction)
        };
        // masses exist for n = 2 only: an estimate would leave it, a fixed number does not
        let twice = "A -> 2*B : k*A; A -> n*B : k*A;";
        assert_eq!([refused(twice, "2"), refused(twice, "2 fixed"), refused(twice, "3 fixed")], [true, false, true]);
        // growth by a yield below one makes nothing
        let growth = "A + B -> n*B : k*A;";
        assert_eq!(
            [refused(growth, "1.4"), refused(growth, "0.4"), refused("A + n*B -> C : k*A;", "0.4")],
            [false, true, false]
        );
    }

    #[test]
    fn amounts_react_in_a_volume() {
        let declared = "model m {
          input V [l];
          state nA [mol] = 1, nB [mol];
          param k [1/s] = 1;
          let A = nA/V;
          output y [mol] = nB;";
        let made = rates(&format!("{declared} reactions in V {{ nA -> 2*nB : k*A; }} }}"));
        let hand = rates(&format!("{declared} der(nA) = V*(-(k*A)); der(nB) = V*(2*(k*A)); }}"));
        assert_eq!(made, hand);
    }

    #[test]
    fn masses_exist_where_matter_is_kept() {
        let yes = |rows: &[&[f64]]| {
            let rows: Vec<Vec<f64>> = rows.iter().map(|r| r.to_vec()).collect();
            has_masses(&rows, rows[0].len())
        };
        // A + B -> C, 2 C -> D
        assert!(yes(&[&[-1.0, -1.0, 1.0, 0.0], &[0.0, 0.0, -2.0, 1.0]]));
        // A -> B and A -> 2 B
        assert!(!yes(&[&[-1.0, 1.0], &[-1.0, 2.0]]));
        // A -> B + C and B -> A: C would weigh nothing
        assert!(!yes(&[&[-1.0, 1.0, 1.0], &[1.0, -1.0, 0.0]]));
        // a cycle, and one that grows
        assert!(yes(&[&[-1.0, 1.0, 0.0], &[0.0, -1.0, 1.0], &[1.0, 0.0, -1.0]]));
        assert!(!yes(&[&[1.0]]));
        // halves: A + 0.5 O2 -> B
        assert!(yes(&[&[-1.0, -0.5, 1.0]]));
    }
}
