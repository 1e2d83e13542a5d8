//! The rate of every state: right sides as they stand, and equations solved for the derivatives in them.
//!
//! Structure first: which equation determines which derivative, and which equations hang together (block triangular form).
//! An equation `der(x) = ...` that needs no other stays as it is; sets that are coupled are solved together, and must be
//! linear in their derivatives.
//!
//! Why equations cannot be solved for their derivatives, in words.

use super::elimination;
use super::elimination::{Entry, MOST_WORK, Row, Singular};
use super::equations::{Equation, Matching, no_equation};
use super::expressions::{Expressions, Indices};
use super::kinds::Kinds;
use super::limits::Limit;
use super::order::components;
use super::scope::{Scope, SymbolId};
use super::start::Start;
use super::substitution::{Form, Obstacle, Substitution, equated};
use crate::diagnostic::{Code, Diagnostic};
use crate::model::{Origin, Param};
use crate::op::{Build, ExprId};
use crate::source::Span;
use crate::syntax::{Role, Value};
use std::collections::BTreeMap;

/// Most equations that are solved together.
const MOST_COUPLED: usize = 256;
/// Most derivatives that the equations of a model may mention, each counted in each.
const MOST_MENTIONS: usize = 4_000_000;

/// By state of the model its rate, `None` for those without; the expressions hold no derivatives afterwards, unless a mistake is
/// told or was told before.
pub(super) fn solve(
    scope: &Scope<'_>,
    equations: &[Equation],
    kinds: &Kinds,
    indices: &Indices,
    expressions: &mut Expressions,
    (params, limits): (&[Param], &[Option<Limit>]),
    findings: &mut Vec<Diagnostic>,
) -> Vec<Option<ExprId>> {
    let states: Vec<SymbolId> = scope.valid().filter(|(_, s)| s.role == Role::State).map(|(s, _)| s).collect();
    let mut rates = vec![None; states.len()];
    let plain = !equations.iter().any(|e| e.implicit) && !expressions.holds_derivatives();
    if plain {
        for equation in equations {
            if let Some(s) = equation.state {
                let (k, rate) = (indices.of[s], expressions.of(equation.right));
                let faded = |l: &Limit| l.faded(&mut expressions.graph, k, rate);
                rates[k as usize] = Some(limits[k as usize].as_ref().map_or(rate, faded));
            }
        }
        return rates;
    }
    let known = |e: &Equation| {
        let left = e.state.is_some() || e.implicit && !kinds.of(e.left).broken;
        left && !kinds.of(e.right).broken
    };
    if scope.is_partial() || !equations.iter().all(known) {
        return rates;
    }
    let old = std::mem::take(&mut expressions.graph);
    let derivatives = expressions.derivatives.clone();
    let mut solver = Solver {
        scope,
        equations,
        sides: equations.iter().map(|e| (expressions.of(e.left), expressions.of(e.right))).collect(),
        own: equations.iter().map(|e| e.state.map(|s| indices.of[s] as usize)).collect(),
        own_rates: vec![None; states.len()],
        limits,
        states,
        into: Substitution::new(&old, &derivatives),
        findings,
    };
    let begin: Vec<Option<ExprId>> = solver
        .states
        .iter()
        .map(|s| match scope.symbols[*s].declaration.value {
            Some(Value::Expr(root)) if !kinds.of(root).broken => Some(expressions.of(root)),
            Some(_) => None,
            None => Some(expressions.nothing),
        })
        .collect();
    if solver.run(params, &begin).is_some() {
        match expressions.transfer(&mut solver.into) {
            Ok(()) => {
                rates = std::mem::take(&mut solver.into.rates);
                // elsewhere `der(x)` of a limited state is what it has, here what moves it
                rates.iter_mut().zip(&solver.own_rates).for_each(|(rate, own)| *rate = own.or(*rate));
                expressions.graph = std::mem::take(&mut solver.into.graph);
                return rates;
            }
            Err(obstacle) => {
                let finding = solver.obstacle(obstacle, scope.tree.name.span, &[]);
                solver.findings.push(finding);
            }
        }
    }
    expressions.graph = old;
    rates
}

/// The equations on their way to rates.
pub(super) struct Solver<'a, 'b> {
    pub(super) scope: &'b Scope<'a>,
    pub(super) equations: &'b [Equation],
    /// Left and right sides in the old graph.
    sides: Vec<(ExprId, ExprId)>,
    /// By equation: the state whose derivative is the left side.
    own: Vec<Option<usize>>,
    /// The symbols of the states.
    pub(super) states: Vec<SymbolId>,
    /// By state: the rates of those whose derivative elsewhere is another.
    own_rates: Vec<Option<ExprId>>,
    limits: &'b [Option<Limit>],
    into: Substitution<'b>,
    findings: &'b mut Vec<Diagnostic>,
}

impl Solver<'_, '_> {
    /// Finds all rates; `None` when a mistake was told.
    fn run(&mut self, params: &[Param], begin: &[Option<ExprId>]) -> Option<()> {
        let (now, all) = self.mentions()?;
        let pairs = Matching::new(&now, self.states.len(), &self.own);
        if !self.complete(&pairs, &now) {
            return None;
        }
        let equation_of = |rate: &usize| pairs.of_rate[*rate];
        let needs: Vec<Vec<usize>> = all
            .iter()
            .enumerate()
            .map(|(k, rates)| rates.iter().filter_map(equation_of).filter(|other| *other != k).collect())
            .collect();
        let values: Vec<f64> = params
            .iter()
            .map(|p| if matches!(p.origin, Origin::FreeInitial(_)) { f64::NAN } else { p.value })
            .collect();
        let mut start = Start::new(&values, self.states.len());
        let mut initial = Vec::with_capacity(begin.len());
        for e in begin {
            initial.push(e.and_then(|e| self.into.moved(e).ok()));
        }
        start.look(&self.into.graph);
        start.begin(initial.into_iter().map(|e| e.map_or(f64::NAN, |e| start.value(e))).collect());
        let mut sound = true;
        for group in components(&needs) {
            let explicit = match group[..] {
                [k] => self.own[k].filter(|own| pairs.of_equation[k] == Some(*own) && !self.mentions_itself(k, *own)),
                _ => None,
            };
            let solved = match explicit {
                Some(state) => self.explicit(group[0], state),
                None => self.coupled(&group, &pairs, &mut start),
            };
            if let Err(finding) = solved {
                sound = false;
                self.findings.push(*finding);
                // consequences are not told
                let nothing = self.into.graph.number(f64::NAN);
                group.iter().filter_map(|k| pairs.of_equation[*k]).for_each(|s| self.into.rates[s] = Some(nothing));
            }
        }
        sound.then_some(())
    }

    fn mentions_itself(&self, k: usize, state: usize) -> bool {
        let (now, earlier) = self.into.rates_in(self.sides[k].1);
        now.contains(&state) || earlier.contains(&state)
    }

    /// By equation: the derivatives in it, and those with derivatives at earlier times.
    #[expect(clippy::type_complexity, reason = "two lists of the same shape")]
    fn mentions(&mut self) -> Option<(Vec<Vec<usize>>, Vec<Vec<usize>>)> {
        let (mut now, mut all, mut count) = (Vec::new(), Vec::new(), 0);
        for (k, (left, right)) in self.sides.clone().into_iter().enumerate() {
            let (mut own, mut earlier) = (Vec::new(), Vec::new());
            if self.equations[k].implicit {
                (own, earlier) = self.into.rates_in(left);
            }
            own.extend(self.own[k]);
            let (more, more_earlier) = self.into.rates_in(right);
            own.extend(more);
            earlier.extend(more_earlier);
            own.sort_unstable();
            own.dedup();
            let mut both = [&own[..], &earlier].concat();
            both.sort_unstable();
            both.dedup();
            count += both.len();
            if count > MOST_MENTIONS {
                let span = self.place(k);
                let message = format!("the equations mention more than {MOST_MENTIONS} derivatives");
                self.findings.push(Diagnostic::new(Code::TooLarge, span, message));
                return None;
            }
            now.push(own);
            all.push(both);
        }
        Some((now, all))
    }

    /// Tells of equations and derivatives that have no counterpart.
    fn complete(&mut self, pairs: &Matching, incidence: &[Vec<usize>]) -> bool {
        let before = self.findings.len();
        let mut told = vec![false; self.equations.len()];
        for k in (0..self.equations.len()).filter(|k| pairs.of_equation[*k].is_none()) {
            if told[k] {
                continue;
            }
            let (equations, rates) = pairs.too_many(incidence, k);
            equations.iter().for_each(|k| told[*k] = true);
            let finding = self.too_many(k, &equations, &rates);
            self.findings.push(finding);
        }
        let mut told = vec![false; self.states.len()];
        for rate in (0..self.states.len()).filter(|r| pairs.of_rate[*r].is_none()) {
            if told[rate] {
                continue;
            }
            let (equations, rates) = pairs.too_few(incidence, rate);
            rates.iter().for_each(|r| told[*r] = true);
            let finding = self.too_few(rate, &equations, &rates);
            self.findings.push(finding);
        }
        self.findings.len() == before
    }

    fn explicit(&mut self, k: usize, state: usize) -> Result<(), Box<Diagnostic>> {
        let rate = self.into.moved(self.sides[k].1);
        let mut rate = rate.map_err(|obstacle| Box::new(self.obstacle(obstacle, self.place(k), &[k])))?;
        if let Some(limit) = self.limits[state] {
            let limit = limit.moved(|e| self.into.moved(e));
            let limit = limit.map_err(|obstacle| Box::new(self.obstacle(obstacle, self.place(k), &[k])))?;
            let own = limit.faded(&mut self.into.graph, state as u32, rate);
            self.own_rates[state] = Some(own);
            rate = limit.held(&mut self.into.graph, state as u32, own);
        }
        self.into.rates[state] = Some(rate);
        Ok(())
    }

    fn coupled(&mut self, group: &[usize], pairs: &Matching, start: &mut Start<'_>) -> Result<(), Box<Diagnostic>> {
        let mut group = group.to_vec();
        group.sort_unstable();
        let mut unknown: Vec<usize> = group.iter().filter_map(|k| pairs.of_equation[*k]).collect();
        unknown.sort_unstable();
        if let Some(state) = unknown.iter().find(|s| self.limits[**s].is_some()) {
            return Err(Box::new(self.limited(&group, *state)));
        }
        if group.len() > MOST_COUPLED {
            let limit = format!("{MOST_COUPLED} is the limit");
            return Err(Box::new(self.too_large(&group, &unknown, &limit)));
        }
        let mut rows = Vec::with_capacity(group.len());
        for k in &group {
            rows.push(self.row(*k).map_err(|obstacle| Box::new(self.obstacle(obstacle, self.place(*k), &group)))?);
        }
        start.look(&self.into.graph);
        for entry in rows.iter_mut().flat_map(|r| r.terms.values_mut()) {
            entry.scale = start.value(entry.expr).abs();
        }
        match elimination::solve(&mut self.into.graph, rows, start) {
            Ok(solved) => {
                solved.into_iter().for_each(|(state, rate)| self.into.rates[state] = Some(rate));
                Ok(())
            }
            Err(Singular::TooLong(leaves)) => {
                let limit = format!(
                    "solving them takes more than {} products, each with derivatives by {leaves} names, while \
                     {MOST_WORK} is the limit of both together",
                    MOST_WORK / leaves.max(1)
                );
                Err(Box::new(self.too_large(&group, &unknown, &limit)))
            }
            Err(Singular::Always(rows)) => Err(Box::new(self.singular(&group, &rows, &unknown, ""))),
            Err(Singular::AtStart(rows)) => {
                Err(Box::new(self.singular(&group, &rows, &unknown, " at the start values")))
            }
        }
    }

    /// An equation as a sum over the derivatives of its set.
    fn row(&mut self, k: usize) -> Result<Row, Obstacle> {
        let (left, right) = self.sides[k];
        let right = self.into.form(right)?;
        let left = match self.own[k] {
            Some(state) => {
                let one = self.into.graph.number(1.0);
                let zero = self.into.graph.number(0.0);
                Form { rest: zero, terms: BTreeMap::from([(state, one)]) }
            }
            None => self.into.form(left)?,
        };
        let form = equated(&mut self.into.graph, &left, &right);
        let terms = form.terms.into_iter().map(|(s, expr)| (s, Entry { expr, scale: 0.0 })).collect();
        Ok(Row { terms, rest: form.rest })
    }
}

/// Equations and derivatives that a message shows.
const MOST_SHOWN: usize = 8;

impl Solver<'_, '_> {
    /// Equations that are more than the derivatives in them.
    pub(super) fn too_many(&self, k: usize, equations: &[usize], rates: &[usize]) -> Diagnostic {
        let span = self.place(k);
        let (message, code) = match rates {
            [] => ("no derivative is left in this equation".to_string(), Code::SingularRates),
            [rate] => {
                (format!("{} equations determine {}", equations.len(), self.derivative(*rate)), Code::TwoEquations)
            }
            _ => {
                let names = self.list(rates);
                let counts = format!("{} equations determine {} derivatives", equations.len(), rates.len());
                (format!("{counts}: {names}"), Code::SingularRates)
            }
        };
        let finding = Diagnostic::new(code, span, message);
        self.labelled(finding, equations, span).hint("as many equations as derivatives are needed: remove one")
    }

    /// Derivatives that are more than the equations for them.
    pub(super) fn too_few(&self, rate: usize, equations: &[usize], rates: &[usize]) -> Diagnostic {
        if equations.is_empty() {
            return no_equation(self.scope, self.states[rate]);
        }
        let name = &self.scope.symbols[self.states[rate]].declaration.name;
        let (equation, verb) =
            if equations.len() == 1 { ("equation", "determines") } else { ("equations", "determine") };
        let counts = format!("{} {equation} {verb} {} derivatives", equations.len(), rates.len());
        let finding = Diagnostic::new(Code::SingularRates, name.span, format!("{counts}: {}", self.list(rates)));
        self.labelled(finding, equations, name.span).hint("one equation is needed for each state")
    }

    fn labelled(&self, mut finding: Diagnostic, equations: &[usize], but: Span) -> Diagnostic {
        for place in equations.iter().map(|k| self.place(*k)).filter(|place| *place != but).take(MOST_SHOWN) {
            finding = finding.label(place, "one of these equations");
        }
        finding
    }

    fn derivative(&self, rate: usize) -> String {
        format!("`der({})`", self.scope.symbols[self.states[rate]].name())
    }

    fn list(&self, rates: &[usize]) -> String {
        let mut names: Vec<String> = rates.iter().take(MOST_SHOWN).map(|r| self.derivative(*r)).collect();
        if rates.len() > MOST_SHOWN {
            names.push("...".into());
        }
        names.join(", ")
    }

    /// A set that is too large to be solved.
    pub(super) fn too_large(&self, group: &[usize], unknown: &[usize], limit: &str) -> Diagnostic {
        let span = self.place(group[0]);
        let message = format!("{} equations are coupled by {}, and {limit}", group.len(), self.list(unknown));
        let finding = Diagnostic::new(Code::TooLarge, span, message);
        finding.hint("solve some of them by hand, so that `der(x) = ...;` holds no derivative on its right side")
    }

    /// A state with a limit whose derivative is coupled with others.
    pub(super) fn limited(&self, group: &[usize], state: usize) -> Diagnostic {
        let name = self.scope.symbols[self.states[state]].name();
        let span = self.place(group[0]);
        let message = format!("`{name}` has a limit, but its derivative is not given by an equation of its own");
        let finding = self.labelled(Diagnostic::new(Code::SingularRates, span, message), group, span);
        finding.hint(format!("write `der({name}) = ...;` without other derivatives that depend on it"))
    }

    /// A set whose determinant is zero; `rows` are those that are left of it.
    pub(super) fn singular(&self, group: &[usize], rows: &[usize], states: &[usize], when: &str) -> Diagnostic {
        let left: Vec<usize> = rows.iter().filter_map(|r| group.get(*r).copied()).collect();
        let k = left.first().or(group.first()).copied().unwrap_or(0);
        let span = self.place(k);
        let message = match group {
            [_] => format!("{} is multiplied with zero in its equation{when}", self.list(states)),
            _ => format!(
                "the equations for {} do not determine them{when}: their determinant is zero",
                self.list(states)
            ),
        };
        let finding = self.labelled(Diagnostic::new(Code::SingularRates, span, message), group, span);
        finding.hint(if when.is_empty() {
            "an equation is a multiple of others"
        } else {
            "choose other start values of params and states"
        })
    }

    /// Where an equation begins.
    pub(super) fn place(&self, k: usize) -> Span {
        self.scope.tree.span(self.equations[k].left)
    }

    /// What stands in an expression.
    pub(super) fn obstacle(&self, obstacle: Obstacle, span: Span, group: &[usize]) -> Diagnostic {
        match obstacle {
            Obstacle::Nonlinear(states) => {
                let message = format!("this equation is not linear in {}", self.list(&states));
                let finding = self.labelled(Diagnostic::new(Code::NonlinearRate, span, message), group, span);
                finding.hint(
                    "derivatives that are solved for stand in sums, each times or divided by what holds none of them",
                )
            }
            Obstacle::Earlier(state) => {
                let name = self.derivative(state);
                let message = format!("{name} depends on derivatives at earlier times, which depend on {name}");
                let finding = Diagnostic::new(Code::Unsupported, span, message);
                finding.hint("such an equation (a neutral delay equation) cannot be simulated; delay states instead")
            }
            Obstacle::Delays => {
                let message = "the delays of this equation stand for too many delayed signals";
                Diagnostic::new(Code::TooLarge, span, message).hint("delay states instead of derivatives")
            }
            Obstacle::TooLong => {
                let message = "the sums of derivatives in these equations are too long";
                Diagnostic::new(Code::TooLarge, span, message).hint("solve some of the equations by hand")
            }
        }
    }
}
