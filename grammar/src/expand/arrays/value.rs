//! What every expression of the text is worth: a number, a vector or a matrix of expressions.

use super::declared::Dims;
use super::writer::{BROKEN, Item, Place, Writer};
use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;
use crate::syntax::{
    BinarySign, Expr, ExprRef, Name, Nodes, Printer, Slice, StatementKind, SyntaxTree, Table, UnarySign,
};

/// The value of an expression.
#[derive(Debug, Clone)]
pub(super) enum Val {
    Scalar(ExprRef),
    Array(Dims, Vec<Item>),
    /// A mistake that has been told.
    Broken,
}

/// Functions of whole vectors and matrices.
pub(super) const FUNCTIONS: [&str; 9] = ["dot", "cross", "transpose", "sum", "norm", "inverse", "det", "dcm", "rotate"];

/// Finds the values of all expressions of a tree.
pub(super) struct Evaluator<'a, 'w> {
    pub(super) tree: &'a SyntaxTree,
    pub(super) out: &'w mut Writer<'a>,
    /// By expression of the tree, taken where it is used.
    values: Vec<Val>,
}

impl<'a, 'w> Evaluator<'a, 'w> {
    /// Operands come first: nothing recurses.
    pub(super) fn new(tree: &'a SyntaxTree, out: &'w mut Writer<'a>) -> Self {
        let mut evaluator = Self { tree, out, values: Vec::with_capacity(tree.expressions.len()) };
        // every table reads its own values
        let lists = lists_of_values(tree);
        for (k, is_list) in lists.into_iter().enumerate() {
            let value = if is_list { Val::Broken } else { evaluator.node(ExprRef(k as u32)) };
            evaluator.values.push(value);
        }
        evaluator
    }

    /// The value of an expression, which is used once.
    pub(super) fn take(&mut self, e: ExprRef) -> Val {
        std::mem::replace(&mut self.values[e.0 as usize], Val::Broken)
    }

    pub(super) fn span(&self, e: ExprRef) -> Span {
        self.tree.span(e)
    }

    pub(super) fn wrong(&mut self, code: Code, span: Span, message: String, hint: impl Into<String>) -> Val {
        self.out.tell(Diagnostic::new(code, span, message).hint(hint));
        Val::Broken
    }

    /// How messages call an expression: as it is written, or by its side.
    pub(super) fn shown(&self, e: ExprRef, otherwise: &str) -> String {
        // longest text of an expression that messages repeat, in bytes
        if self.span(e).range().len() > 60 {
            return otherwise.into();
        }
        format!("`{}`", Printer::new(self.tree).expression(e))
    }

    fn node(&mut self, e: ExprRef) -> Val {
        if self.out.budget.is_spent() {
            return Val::Broken;
        }
        let span = self.span(e);
        match self.tree.expr(e) {
            Expr::Number(value) => Val::Scalar(self.out.number(*value, span)),
            Expr::Name(name) => self.name(name, span),
            Expr::Element(name, slices) => self.element(name, slices, span),
            Expr::Unary(sign, a) => self.unary(*sign, *a, span),
            Expr::Binary(sign, a, b, place) => self.binary(*sign, *a, *b, Place { sign: *place, whole: span }),
            Expr::Call(name, arguments) => self.call(name, arguments, span),
            Expr::If(c, a, b) => self.choice(*c, *a, *b, span),
            // where a mistake has been told
            Expr::Vector(elements) if elements.is_empty() => Val::Broken,
            Expr::Vector(elements) => self.literal(elements, span),
        }
    }

    fn name(&mut self, name: &str, span: Span) -> Val {
        let declared = self.out.declared;
        let Some(array) = declared.array(name) else {
            return if declared.refused.contains(name) {
                Val::Broken
            } else {
                Val::Scalar(self.out.push(Expr::Name(name.into()), span))
            };
        };
        let items = (0..array.dims.count()).map(|at| self.declared_item(name, at, span)).collect();
        Val::Array(array.dims, items)
    }

    /// An element of a declared vector or matrix.
    fn declared_item(&mut self, name: &str, at: usize, span: Span) -> Item {
        let array = self.out.declared.array(name).filter(|a| !a.is_zero(at))?;
        Some(self.out.push(Expr::Name(array.dims.element(name, at)), span))
    }

    fn element(&mut self, name: &Name, slices: &[Slice], span: Span) -> Val {
        match self.out.declared.select(&name.text, slices, span) {
            Ok(chosen) => {
                let mut items = chosen.places.iter().map(|at| self.declared_item(&name.text, *at, span));
                match chosen.dims {
                    Some(dims) => Val::Array(dims, items.collect()),
                    None => {
                        let item = items.next().flatten();
                        Val::Scalar(self.out.item(item, span))
                    }
                }
            }
            Err(finding) => {
                finding.into_iter().for_each(|f| self.out.tell(f));
                Val::Broken
            }
        }
    }

    fn unary(&mut self, sign: UnarySign, a: ExprRef, span: Span) -> Val {
        match self.take(a) {
            Val::Scalar(a) => Val::Scalar(self.out.push(Expr::Unary(sign, a), span)),
            Val::Array(dims, items) if sign != UnarySign::Not => {
                let items = items.into_iter().map(|item| item.map(|a| self.out.push(Expr::Unary(sign, a), span)));
                Val::Array(dims, items.collect())
            }
            Val::Array(dims, _) => self.wanted_number(a, dims, "`not` is said of"),
            Val::Broken => Val::Broken,
        }
    }

    fn wanted_number(&mut self, e: ExprRef, dims: Dims, what: &str) -> Val {
        let shown = self.shown(e, "this");
        let message = format!("{what} numbers, and {shown} is {dims}");
        self.wrong(Code::WrongShape, self.span(e), message, "choose an element, such as `x[1]`")
    }

    fn binary(&mut self, sign: BinarySign, left: ExprRef, right: ExprRef, place: Place) -> Val {
        use BinarySign::*;
        let (a, b) = (self.take(left), self.take(right));
        match (sign, a, b) {
            (_, Val::Broken, _) | (_, _, Val::Broken) => Val::Broken,
            (_, Val::Scalar(a), Val::Scalar(b)) => Val::Scalar(self.out.binary(sign, a, b, place)),
            (Multiply, a, b) => self.product((left, a), (right, b), place),
            (Add | Subtract, Val::Array(m, x), Val::Array(n, y)) if m.agrees(n) => {
                let minus = sign == Subtract;
                let items = x.into_iter().zip(y).map(|(x, y)| self.out.sum(x, y, minus, place)).collect();
                Val::Array(if m.columns.is_none() { m } else { n }, items)
            }
            (Divide, Val::Array(dims, items), Val::Scalar(b)) => {
                let b = self.out.shared(b);
                let mut divided = |a| {
                    let b = self.out.copy(b);
                    self.out.binary(Divide, a, b, place)
                };
                Val::Array(dims, items.into_iter().map(|item| item.map(&mut divided)).collect())
            }
            (_, a, b) if single(&a) && single(&b) => {
                let (a, b) = (self.number_of(a, place.whole), self.number_of(b, place.whole));
                Val::Scalar(self.out.binary(sign, a, b, place))
            }
            (Divide, _, Val::Array(dims, _)) => {
                self.unfit(right, dims, "by which nothing is divided", "`inverse(A)*b` solves `A*x = b`", place)
            }
            (Add | Subtract, a, b) => self.shapes_differ((left, &a), (right, &b), place.sign),
            (Power, a, b) => {
                let (e, dims) = if let Val::Array(dims, _) = a { (left, dims) } else { (right, dims_of(&b)) };
                self.unfit(e, dims, "and powers are of numbers", "`A*A` is a product, `dot(x, x)` a square", place)
            }
            (_, a, b) => {
                let (e, dims) = if let Val::Array(dims, _) = a { (left, dims) } else { (right, dims_of(&b)) };
                self.unfit(e, dims, "and comparisons are of numbers", "choose an element, such as `x[1]`", place)
            }
        }
    }

    fn unfit(&mut self, e: ExprRef, dims: Dims, why: &str, hint: &str, place: Place) -> Val {
        let shown = self.shown(e, "this");
        self.wrong(Code::WrongShape, place.sign, format!("{shown} is {dims}, {why}"), hint)
    }

    /// Tells the shapes of two values that should be equal.
    pub(super) fn shapes_differ(&mut self, a: (ExprRef, &Val), b: (ExprRef, &Val), span: Span) -> Val {
        let left = format!("{} is {}", self.shown(a.0, "the left side"), shape_of(a.1));
        let right = format!("{} is {}", self.shown(b.0, "the right side"), shape_of(b.1));
        let hint = match (a.1, b.1) {
            (Val::Array(m, _), Val::Array(n, _)) if m.rows == n.width() && m.width() == n.rows => {
                "`transpose(...)` turns rows into columns"
            }
            (Val::Scalar(_), _) | (_, Val::Scalar(_)) => "a number is not added to every element; write them out",
            _ => "both must have the same shape",
        };
        self.wrong(Code::WrongShape, span, format!("{left}, {right}"), hint)
    }

    /// The only element.
    pub(super) fn number_of(&mut self, value: Val, span: Span) -> ExprRef {
        match value {
            Val::Scalar(e) => e,
            Val::Array(_, items) => {
                let item = items.first().copied().flatten();
                self.out.item(item, span)
            }
            Val::Broken => BROKEN,
        }
    }

    /// A function of numbers is one of each element.
    pub(super) fn call(&mut self, name: &Name, arguments: &[ExprRef], span: Span) -> Val {
        if matches!(name.text.as_str(), "dcm" | "rotate") {
            return self.rotation(name, arguments, span);
        }
        if FUNCTIONS.contains(&name.text.as_str()) {
            return self.function(name, arguments, span);
        }
        if name.text == "tf" {
            return self.transfer_function(name, arguments, span);
        }
        let values: Vec<Val> = arguments.iter().map(|e| self.take(*e)).collect();
        self.each(name, arguments, values, span)
    }

    fn each(&mut self, name: &Name, arguments: &[ExprRef], mut values: Vec<Val>, span: Span) -> Val {
        if values.iter().any(|v| matches!(v, Val::Broken)) {
            return Val::Broken;
        }
        let first = values.iter().position(|v| matches!(v, Val::Array(..)));
        let Some((at, dims)) = first.map(|k| (k, dims_of(&values[k]))) else {
            let arguments = values.into_iter().map(|v| self.number_of(v, span)).collect();
            return Val::Scalar(self.out.push(Expr::Call(name.clone(), arguments), span));
        };
        let differs = |v: &Val| matches!(v, Val::Array(other, _) if !other.agrees(dims));
        if let Some(k) = values.iter().position(differs) {
            let (a, b) =
                (std::mem::replace(&mut values[at], Val::Broken), std::mem::replace(&mut values[k], Val::Broken));
            return self.shapes_differ((arguments[at], &a), (arguments[k], &b), span);
        }
        for value in &mut values {
            if let Val::Scalar(e) = value {
                *e = self.out.shared(*e);
            }
        }
        let items = (0..dims.count()).map(|k| {
            let operands = values.iter().map(|value| match value {
                Val::Scalar(e) => self.out.copy(*e),
                Val::Array(_, items) => self.out.item(items[k], span),
                Val::Broken => BROKEN,
            });
            let operands = operands.collect();
            Some(self.out.push(Expr::Call(name.clone(), operands), span))
        });
        Val::Array(dims, items.collect())
    }

    /// The coefficients of a transfer function are lists of numbers, which later rooms read.
    fn transfer_function(&mut self, name: &Name, arguments: &[ExprRef], span: Span) -> Val {
        let mut lists: Vec<ExprRef> = Vec::new();
        for e in arguments.iter().skip(1) {
            let place = self.span(*e);
            lists.push(match self.take(*e) {
                Val::Array(_, items) => {
                    let items = items.into_iter().map(|item| self.out.item(item, place)).collect();
                    self.out.push(Expr::Vector(items), place)
                }
                value => self.number_of(value, place),
            });
        }
        match arguments.first().map(|e| self.take(*e)) {
            Some(Val::Broken) => Val::Broken,
            Some(Val::Array(dims, items)) => {
                let items = items.into_iter().map(|item| {
                    let mut operands = vec![self.out.item(item, span)];
                    operands.extend(lists.iter().map(|list| self.out.copy(*list)));
                    Some(self.out.push(Expr::Call(name.clone(), operands), span))
                });
                Val::Array(dims, items.collect())
            }
            signal => {
                let signal = signal.map(|value| self.number_of(value, span));
                let operands = signal.into_iter().chain(lists).collect();
                Val::Scalar(self.out.push(Expr::Call(name.clone(), operands), span))
            }
        }
    }

    fn choice(&mut self, c: ExprRef, a: ExprRef, b: ExprRef, span: Span) -> Val {
        let condition = match self.take(c) {
            Val::Array(dims, _) => return self.wanted_number(c, dims, "a condition is made of"),
            value => self.number_of(value, span),
        };
        match (self.take(a), self.take(b)) {
            (Val::Broken, _) | (_, Val::Broken) => Val::Broken,
            (Val::Scalar(a), Val::Scalar(b)) => Val::Scalar(self.out.push(Expr::If(condition, a, b), span)),
            (Val::Array(m, x), Val::Array(n, y)) if m.agrees(n) => {
                let items = x.into_iter().zip(y).map(|(x, y)| {
                    let (x, y) = match (x, y) {
                        (None, None) => return None,
                        (x, y) => (self.out.item(x, span), self.out.item(y, span)),
                    };
                    let c = self.out.copy(condition);
                    Some(self.out.push(Expr::If(c, x, y), span))
                });
                Val::Array(m, items.collect())
            }
            (x, y) => self.shapes_differ((a, &x), (b, &y), span),
        }
    }

    /// `[a, b]`, and of such rows a matrix.
    fn literal(&mut self, elements: &[ExprRef], span: Span) -> Val {
        let values: Vec<Val> = elements.iter().map(|e| self.take(*e)).collect();
        if values.iter().any(|v| matches!(v, Val::Broken)) {
            return Val::Broken;
        }
        if values.iter().all(|v| matches!(v, Val::Scalar(_))) {
            let items = values.into_iter().zip(elements).map(|(value, e)| {
                let zero = *self.tree.expr(*e) == Expr::Number(0.0);
                (!zero).then(|| self.number_of(value, span))
            });
            let items: Vec<Item> = items.collect();
            return Val::Array(Dims::vector(items.len()), items);
        }
        let width = values.iter().map(|v| dims_of(v).count()).next().unwrap_or(0);
        let row = |v: &Val| matches!(v, Val::Array(d, _) if d.count() == width && (d.columns.is_none() || d.rows == 1));
        if let Some(k) = values.iter().position(|v| !row(v)) {
            let (first, other) = (self.shown(elements[0], "the first row"), self.shown(elements[k], "this row"));
            let message = match (&values[0], &values[k]) {
                (Val::Array(m, _), Val::Array(n, _)) if k > 0 => {
                    format!("the rows of a matrix are of one length: {first} is {m}, {other} is {n}")
                }
                _ => "the elements are neither all numbers nor all rows".into(),
            };
            return self.wrong(Code::WrongShape, self.span(elements[k]), message, "`[[a, b], [c, d]]` is a matrix");
        }
        let dims = Dims::matrix(values.len(), width);
        let items = values.into_iter().flat_map(|v| if let Val::Array(_, items) = v { items } else { Vec::new() });
        Val::Array(dims, items.collect())
    }
}

/// Shape of a value in messages.
pub(super) fn shape_of(value: &Val) -> String {
    match value {
        Val::Array(dims, _) => dims.to_string(),
        _ => "a number".into(),
    }
}

/// Shape of a value; that of a vector of one for numbers.
pub(super) fn dims_of(value: &Val) -> Dims {
    match value {
        Val::Array(dims, _) => *dims,
        _ => Dims::vector(1),
    }
}

/// Whether a value has one element.
pub(super) fn single(value: &Val) -> bool {
    dims_of(value).count() == 1
}

/// For each expression whether it is a list that holds the values of a table: nested to any depth, it is no matrix.
fn lists_of_values(tree: &SyntaxTree) -> Vec<bool> {
    let mut lists = vec![false; tree.expressions.len()];
    for statement in &tree.statements {
        let StatementKind::Table(Table { name, nodes: Nodes::Written(axes), arguments, .. }) = &statement.kind else {
            continue;
        };
        let roots = axes.iter().filter(|a| a.name.text == name.text).filter_map(|a| a.values);
        let mut open: Vec<(ExprRef, usize)> = roots.map(|e| (e, 0)).collect();
        while let Some((e, depth)) = open.pop() {
            if let Expr::Vector(list) = tree.expr(e)
                && depth < arguments.len()
                && !list.is_empty()
            {
                lists[e.0 as usize] = true;
                open.extend(list.iter().map(|e| (*e, depth + 1)));
            }
        }
    }
    lists
}
