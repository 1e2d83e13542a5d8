//! Statements about vectors and matrices as statements about their elements.

use super::declared::Array;
use super::declared::{Dims, indexed};
use super::value::{Evaluator, Val, dims_of, shape_of, single};
use super::writer::{BROKEN, Item};
use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;
use crate::syntax::{
    Bounds, Declaration, Expr, ExprRef, Limited, Name, Role, Statement, StatementKind, Value, When, operands,
};

impl Evaluator<'_, '_> {
    /// A statement of the flattened model; names that lose their meaning are added to `suspended`.
    pub(super) fn statement(&mut self, statement: &Statement, suspended: &mut Vec<String>, into: &mut Vec<Statement>) {
        let mut keep = |kind| into.push(Statement { kind, span: statement.span });
        match &statement.kind {
            StatementKind::Declare(role, list) => {
                let mut elements = Vec::new();
                list.iter().for_each(|d| self.declaration(*role, d, &mut elements));
                keep(StatementKind::Declare(*role, elements));
            }
            StatementKind::Requirement(list) => {
                let list = list.iter().map(|d| self.single_declaration(d)).collect();
                keep(StatementKind::Requirement(list));
            }
            StatementKind::Equation(left, right) => {
                self.equation(*left, *right, suspended)
                    .into_iter()
                    .for_each(|(l, r)| keep(StatementKind::Equation(l, r)));
            }
            StatementKind::Prior(list) => keep(StatementKind::Prior(self.priors(list))),
            StatementKind::Noise(list) => keep(StatementKind::Noise(self.targets(list))),
            StatementKind::Process(list) => keep(StatementKind::Process(self.targets(list))),
            StatementKind::Trim(list) => keep(StatementKind::Trim(self.targets(list))),
            StatementKind::Tie(list) => keep(StatementKind::Tie(self.targets(list))),
            StatementKind::Limit(list) => keep(StatementKind::Limit(self.limits(list))),
            StatementKind::When(event) => {
                let condition = self.scalar(event.condition, "the condition of an event is made of");
                keep(StatementKind::When(When { condition, resets: self.targets(&event.resets) }));
            }
            StatementKind::Table(table) => match self.table(table) {
                Some((table, params)) => {
                    if !params.is_empty() {
                        keep(StatementKind::Declare(Role::Param, params));
                    }
                    keep(StatementKind::Table(table));
                }
                None => suspended.push(table.name.text.clone()),
            },
            StatementKind::Time(_)
            | StatementKind::Smooth(_)
            | StatementKind::Use(_)
            | StatementKind::Reactions(..) => keep(statement.kind.clone()),
        }
    }

    /// A value that must be a number.
    pub(super) fn scalar(&mut self, e: ExprRef, what: &str) -> ExprRef {
        match self.take(e) {
            Val::Array(dims, _) if dims.count() != 1 => {
                let shown = self.shown(e, "this");
                let message = format!("{what} numbers, and {shown} is {dims}");
                self.wrong(Code::WrongShape, self.span(e), message, "choose an element, such as `x[1]`");
                BROKEN
            }
            value => self.number_of(value, self.span(e)),
        }
    }

    /// A value for every element: of the same shape, or one number for all.
    fn filled(&mut self, value: Val, e: ExprRef, dims: Dims, subject: &str) -> Vec<Item> {
        match value {
            Val::Broken => vec![Some(BROKEN); dims.count()],
            Val::Array(own, items) if own.agrees(dims) => items,
            value if single(&value) => {
                let number = self.number_of(value, self.span(e));
                let mut items = vec![Some(number)];
                items.extend((1..dims.count()).map(|_| Some(self.out.copy(number))));
                items
            }
            value => {
                let message = format!("{subject} is {dims}, its value is {}", shape_of(&value));
                self.wrong(Code::WrongShape, self.span(e), message, "a number is the value of all elements");
                vec![Some(BROKEN); dims.count()]
            }
        }
    }

    fn declaration(&mut self, role: Role, d: &Declaration, into: &mut Vec<Declaration>) {
        let declared = self.out.declared;
        if declared.is_dropped(d.name.span) {
            return;
        }
        match (d.shape, declared.array(&d.name.text)) {
            (Some(_), Some(array)) => self.elements(role, d, array, into),
            _ => into.push(self.single_declaration(d)),
        }
    }

    fn single_declaration(&mut self, d: &Declaration) -> Declaration {
        let mut new = d.clone();
        if let Some(Value::Expr(e)) = d.value {
            let value = self.take(e);
            let number = if single(&value) {
                self.number_of(value, self.span(e))
            } else {
                let (name, dims) = (&d.name.text, dims_of(&value));
                let message = format!("`{name}` is a number, its value is {dims}");
                self.wrong(Code::WrongShape, self.span(e), message, format!("`{name}{dims}` behind its role"));
                BROKEN
            };
            new.value = Some(Value::Expr(number));
        }
        new.bounds = d.bounds.map(|b| {
            let what = "bounds of a number are";
            Bounds { lower: self.scalar(b.lower, what), upper: self.scalar(b.upper, what), span: b.span }
        });
        new
    }

    fn elements(&mut self, role: Role, d: &Declaration, array: &Array, into: &mut Vec<Declaration>) {
        let (dims, subject) = (array.dims, format!("`{}`", d.name.text));
        let values = match d.value {
            Some(Value::Expr(e)) => {
                let value = self.take(e);
                Some(self.filled(value, e, dims, &subject))
            }
            _ => None,
        };
        let bounds = d.bounds.map(|b| {
            let mut limit = |e: ExprRef| {
                let value = self.take(e);
                self.filled(value, e, dims, &subject)
            };
            (limit(b.lower), limit(b.upper), b.span)
        });
        let derived = self.derived(role, values.as_deref());
        let some = derived.iter().any(|d| *d) && !derived.iter().all(|d| *d);
        let bytes =
            [&d.doc, &d.unit].into_iter().flatten().map(|n| n.text.len()).sum::<usize>() + d.name.text.len() + 8;
        for at in (0..dims.count()).filter(|at| !array.is_zero(*at)) {
            if !self.out.budget.spend(1, bytes) {
                let finding = self.out.budget.finding(d.name.span);
                self.out.findings.extend(finding);
                return;
            }
            let name = Name { text: dims.element(&d.name.text, at), span: d.name.span };
            let mut element = Declaration { name, shape: None, ..d.clone() };
            let mut item = |items: &[Item]| items.get(at).map_or(BROKEN, |item| self.out.item(*item, d.name.span));
            if let Some(values) = &values {
                // 0 by the structure of an expression is no start value
                if values[at].is_none() && role == Role::Param {
                    (element.fixed, element.per_run, element.log) = (Some(d.name.span), None, None);
                }
                element.value = Some(Value::Expr(item(values)));
            }
            element.bounds = bounds.as_ref().map(|(l, u, span)| Bounds { lower: item(l), upper: item(u), span: *span });
            // entries that others define have no attributes; those of the other entries are meant
            if some && derived[at] {
                (element.bounds, element.fixed, element.per_run, element.log) = (None, None, None, None);
            }
            into.push(element);
        }
    }

    /// By element: whether it is a param that others define.
    fn derived(&self, role: Role, values: Option<&[Item]>) -> Vec<bool> {
        let Some(values) = values.filter(|_| role == Role::Param) else { return Vec::new() };
        values.iter().map(|item| item.is_some_and(|e| !self.out.is_constant(e))).collect()
    }

    fn equation(&mut self, left: ExprRef, right: ExprRef, suspended: &mut Vec<String>) -> Vec<(ExprRef, ExprRef)> {
        let (l, r) = (self.take(left), self.take(right));
        match (l, r) {
            (Val::Broken, _) => {
                self.suspend(left, suspended);
                Vec::new()
            }
            (Val::Scalar(l), Val::Broken) => vec![(l, BROKEN)],
            (Val::Array(_, items), Val::Broken) => self.sides(items, Vec::new(), left, right),
            (Val::Scalar(l), Val::Scalar(r)) => vec![(l, r)],
            (Val::Array(m, x), Val::Array(n, y)) if m.agrees(n) => self.sides(x, y, left, right),
            (l, r) if single(&l) && single(&r) => {
                vec![(self.number_of(l, self.span(left)), self.number_of(r, self.span(right)))]
            }
            (l, r) => {
                self.shapes_differ((left, &l), (right, &r), self.span(right));
                match l {
                    Val::Array(_, items) => self.sides(items, Vec::new(), left, right),
                    l => vec![(self.number_of(l, self.span(left)), BROKEN)],
                }
            }
        }
    }

    /// An equation for each element; the right side is broken where it is missing.
    fn sides(&mut self, x: Vec<Item>, y: Vec<Item>, left: ExprRef, right: ExprRef) -> Vec<(ExprRef, ExprRef)> {
        let (l, r) = (self.span(left), self.span(right));
        let mut sides = Vec::with_capacity(x.len());
        for (k, item) in x.into_iter().enumerate() {
            let value = y.get(k).map_or(BROKEN, |item| self.out.item(*item, r));
            sides.push((self.out.item(item, l), value));
        }
        sides
    }

    /// What a refused left side mentions may well have its equation.
    fn suspend(&self, root: ExprRef, suspended: &mut Vec<String>) {
        let mut open = vec![root];
        while let Some(e) = open.pop() {
            match self.tree.expr(e) {
                Expr::Name(name) | Expr::Element(Name { text: name, .. }, _) => suspended.push(name.clone()),
                expr => operands(expr, |operand| open.push(operand)),
            }
        }
    }

    fn priors(&mut self, list: &[(ExprRef, ExprRef)]) -> Vec<(ExprRef, ExprRef)> {
        let mut beliefs = Vec::new();
        for (subject, value) in list {
            let (subjects, dims) = match self.subjects(*subject) {
                Val::Broken => continue,
                Val::Scalar(e) => (vec![Some(e)], Dims::vector(1)),
                Val::Array(dims, items) => (items, dims),
            };
            let given = self.take(*value);
            let values = self.filled(given, *value, dims, "what the prior is about");
            for (subject, value) in subjects.into_iter().zip(values) {
                // entries that are 0 by structure are not estimated
                if let (Some(subject), Some(value)) = (subject, value) {
                    beliefs.push((subject, value));
                }
            }
        }
        beliefs
    }

    /// What a prior is about: names, or `x(0)` of every element.
    fn subjects(&mut self, subject: ExprRef) -> Val {
        let span = self.span(subject);
        let (tree, declared) = (self.tree, self.out.declared);
        match tree.expr(subject) {
            Expr::Call(name, arguments) => {
                let own = indexed(&name.text);
                let Some(array) = declared.array(own.0) else { return self.take(subject) };
                let Some(places) = self.places(name, array) else { return Val::Broken };
                let items = places.iter().map(|at| {
                    let arguments = arguments.iter().map(|a| self.out.push(tree.expr(*a).clone(), span)).collect();
                    let name = Name { text: array.dims.element(own.0, *at), span: name.span };
                    Some(self.out.push(Expr::Call(name, arguments), span))
                });
                let items: Vec<Item> = items.collect();
                Val::Array(Dims::vector(items.len()), items)
            }
            Expr::Element(name, slices) => {
                let zero = declared.array(&name.text).zip(declared.select(&name.text, slices, span).ok());
                if let Some((array, chosen)) = zero
                    && let [at] = chosen.places[..]
                    && array.is_zero(at)
                {
                    return self.structural(&name.text, array, at, span);
                }
                self.take(subject)
            }
            _ => self.take(subject),
        }
    }

    fn structural(&mut self, name: &str, array: &Array, at: usize, span: Span) -> Val {
        let message = format!("`{}` is 0 by the structure of `{name}`, not estimated", array.dims.element(name, at));
        let finding = Diagnostic::new(Code::WrongName, span, message).label(array.span, "declared here");
        self.out.tell(finding.hint("a small start value in its place makes it a parameter: `1e-9`"));
        Val::Broken
    }

    /// Elements that a target names; `None` when what is wrong has been told.
    fn places(&mut self, target: &Name, array: &Array) -> Option<Vec<usize>> {
        let (name, slices) = indexed(&target.text);
        let Some(slices) = slices else { return Some((0..array.dims.count()).collect()) };
        match self.out.declared.select(name, &slices, target.span) {
            Ok(chosen) => Some(chosen.places),
            Err(finding) => {
                finding.into_iter().for_each(|f| self.out.tell(f));
                None
            }
        }
    }

    /// `y = 0.1`, `x[2] = 3`, `x = [1, 2, 3]`
    fn limits(&mut self, list: &[Limited]) -> Vec<Limited> {
        let mut limits = Vec::new();
        for limited in list {
            // each part by itself, element by element
            let part = |e: ExprRef| (limited.state.clone(), e);
            let lower = self.targets(&[part(limited.bounds.lower)]);
            let upper = self.targets(&[part(limited.bounds.upper)]);
            let smooth = limited.smooth.map(|w| self.targets(&[part(w)]));
            for (k, ((state, lower), (_, upper))) in lower.into_iter().zip(upper).enumerate() {
                let smooth = smooth.as_ref().and_then(|list| Some(list.get(k)?.1));
                limits.push(Limited { state, bounds: Bounds { lower, upper, ..limited.bounds }, smooth });
            }
        }
        limits
    }

    fn targets(&mut self, list: &[(Name, ExprRef)]) -> Vec<(Name, ExprRef)> {
        let mut named = Vec::new();
        let declared = self.out.declared;
        for (target, e) in list {
            let (name, slices) = indexed(&target.text);
            if declared.refused.contains(name) {
                continue;
            }
            let Some(array) = declared.array(name) else {
                if let Some(slices) = slices {
                    let finding = declared.select(name, &slices, target.span).err().flatten();
                    finding.into_iter().for_each(|f| self.out.tell(f));
                    continue;
                }
                named.push((target.clone(), self.scalar(*e, "the value of a number is made of")));
                continue;
            };
            let Some(places) = self.places(target, array) else { continue };
            if let [at] = places[..]
                && array.is_zero(at)
            {
                self.structural(name, array, at, target.span);
                continue;
            }
            let whole = places.len() == array.dims.count();
            let dims = if whole { array.dims } else { Dims::vector(places.len()) };
            let value = self.take(*e);
            let values = self.filled(value, *e, dims, &format!("`{}`", target.text));
            for (at, value) in places.into_iter().zip(values).filter(|(at, _)| !array.is_zero(*at)) {
                let element = Name { text: array.dims.element(name, at), span: target.span };
                named.push((element, self.out.item(value, self.tree.span(*e))));
            }
        }
        named
    }
}
