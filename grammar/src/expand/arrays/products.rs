//! Products and the functions of whole vectors and matrices.
//!
//! Rotations: `dcm` and `rotate`. A quaternion is `[w, x, y, z]`, its real part first; it turns vectors of the body into
//! those of the reference frame. Angles are those of Euler in the order yaw, pitch, roll (3-2-1).
//!
//! Stevens, Lewis, Johnson (2016): Aircraft Control and Simulation, 3rd edition, section 1.8.

use super::declared::{Dims, MOST_ELEMENTS};
use super::value::{Evaluator, Val, dims_of, shape_of};
use super::writer::{BROKEN, Item, Place};
use crate::diagnostic::Code;
use crate::source::Span;
use crate::syntax::{BinarySign, Expr, ExprRef, Name, UnarySign};

/// Largest matrix whose inverse is written out.
pub const MOST_INVERTED: usize = 3;

impl Evaluator<'_, '_> {
    /// `a*b`: a number times anything, a matrix times a vector or a matrix.
    pub(super) fn product(&mut self, (left, a): (ExprRef, Val), (right, b): (ExprRef, Val), place: Place) -> Val {
        match (a, b) {
            (Val::Scalar(s), Val::Array(dims, items)) => {
                let s = self.out.shared(s);
                let scaled = items.into_iter().map(|item| {
                    let item = item?;
                    let s = self.out.copy(s);
                    self.out.product(Some(s), Some(item), place)
                });
                Val::Array(dims, scaled.collect())
            }
            (Val::Array(dims, items), Val::Scalar(s)) => {
                let s = self.out.shared(s);
                let scaled = items.into_iter().map(|item| {
                    let item = item?;
                    let s = self.out.copy(s);
                    self.out.product(Some(item), Some(s), place)
                });
                Val::Array(dims, scaled.collect())
            }
            (Val::Array(m, x), Val::Array(n, y)) if m.width() == n.rows => self.matrices((m, x), (n, y), place),
            (Val::Array(m, x), Val::Array(n, y)) if m.count() == 1 => {
                let s = self.number_of(Val::Array(m, x), place.whole);
                self.product((left, Val::Scalar(s)), (right, Val::Array(n, y)), place)
            }
            (Val::Array(m, x), Val::Array(n, y)) if n.count() == 1 => {
                let s = self.number_of(Val::Array(n, y), place.whole);
                self.product((left, Val::Array(m, x)), (right, Val::Scalar(s)), place)
            }
            (a, b) => {
                let (m, n) = (dims_of(&a), dims_of(&b));
                let shown = (self.shown(left, "the left side"), self.shown(right, "the right side"));
                let (message, hint) = if m.columns.is_none() && n.columns.is_none() {
                    let message = format!("{} is {m}, {} is {n}: vectors have several products", shown.0, shown.1);
                    (message, "`dot(a, b)` or `cross(a, b)`; `a*transpose(b)` is a matrix")
                } else {
                    let message = format!(
                        "{} is {m}, {} is {n}: the columns on the left are not the rows on the right",
                        shown.0, shown.1
                    );
                    (message, "`A*x` with `A[n, m]` and `x[m]`")
                };
                self.wrong(Code::WrongShape, place.sign, message, hint)
            }
        }
    }

    fn matrices(&mut self, (m, mut x): (Dims, Vec<Item>), (n, mut y): (Dims, Vec<Item>), place: Place) -> Val {
        let dims = if n.columns.is_none() { Dims::vector(m.rows) } else { Dims::matrix(m.rows, n.width()) };
        if dims.count() > MOST_ELEMENTS {
            let message = format!(
                "this product is {dims}, more elements than the limit of {MOST_ELEMENTS} for a vector or matrix"
            );
            return self.wrong(Code::TooLarge, place.sign, message, "write the elements that are needed");
        }
        if n.width() > 1 {
            x.iter_mut().for_each(|item| *item = item.map(|e| self.out.shared(e)));
        }
        if m.rows > 1 {
            y.iter_mut().for_each(|item| *item = item.map(|e| self.out.shared(e)));
        }
        let mut items = Vec::with_capacity(dims.count());
        for i in 0..m.rows {
            let row = &x[i * m.width()..(i + 1) * m.width()];
            for j in 0..n.width() {
                if self.out.budget.is_spent() {
                    return Val::Broken;
                }
                let column = y[j..].iter().step_by(n.width());
                let pairs = row.iter().zip(column).filter_map(|(a, b)| Some(((*a)?, (*b)?)));
                items.push(self.sum_of_products(&pairs.collect::<Vec<_>>(), place));
            }
        }
        if dims.count() == 1 {
            let item = items[0];
            return Val::Scalar(self.out.item(item, place.whole));
        }
        Val::Array(dims, items)
    }

    /// In the order in which people write it.
    fn sum_of_products(&mut self, pairs: &[(ExprRef, ExprRef)], place: Place) -> Item {
        let mut sum = None;
        for (a, b) in pairs {
            let (a, b) = (self.out.copy(*a), self.out.copy(*b));
            let term = self.out.product(Some(a), Some(b), place);
            sum = self.out.sum(sum, term, false, place);
        }
        sum
    }

    /// A function of whole vectors and matrices.
    pub(super) fn function(&mut self, name: &Name, arguments: &[ExprRef], span: Span) -> Val {
        let wanted = if matches!(name.text.as_str(), "dot" | "cross") { 2 } else { 1 };
        if arguments.len() != wanted {
            let message = format!(
                "`{}` takes {wanted} argument{}, {} given",
                name.text,
                if wanted == 1 { "" } else { "s" },
                arguments.len()
            );
            let form = if wanted == 1 { format!("`{}(x)`", name.text) } else { format!("`{}(a, b)`", name.text) };
            return self.wrong(Code::ArgumentCount, span, message, form);
        }
        let mut values = Vec::with_capacity(2);
        for e in arguments {
            match self.take(*e) {
                Val::Broken => return Val::Broken,
                Val::Array(dims, items) => values.push((dims, items)),
                Val::Scalar(item) => values.push((Dims::vector(1), vec![Some(item)])),
            }
        }
        let place = Place { sign: name.span, whole: span };
        let second = if wanted == 2 { values.pop() } else { None };
        let Some((dims, items)) = values.pop() else { return Val::Broken };
        match (name.text.as_str(), second) {
            ("transpose", _) => transposed(dims, &items),
            ("sum", _) => {
                let sum = items.into_iter().fold(None, |sum, item| self.out.sum(sum, item, false, place));
                Val::Scalar(self.out.item(sum, span))
            }
            ("norm", _) => self.norm(items, place),
            ("dot", Some((n, y))) if is_list(dims) && is_list(n) && dims.count() == n.count() => {
                let pairs: Vec<_> = items.into_iter().zip(y).filter_map(|(a, b)| Some((a?, b?))).collect();
                let sum = self.sum_of_products(&pairs, place);
                Val::Scalar(self.out.item(sum, span))
            }
            ("cross", Some((n, y))) if is_list(dims) && is_list(n) && dims.count() == 3 && n.count() == 3 => {
                self.cross(items, y, place)
            }
            ("dot" | "cross", Some((n, _))) => {
                let what = if name.text == "dot" { "two vectors of one length" } else { "two vectors of 3" };
                let shown = (self.shown(arguments[0], "the first"), self.shown(arguments[1], "the second"));
                let message = format!("`{}` takes {what}: {} is {dims}, {} is {n}", name.text, shown.0, shown.1);
                self.wrong(Code::WrongShape, span, message, format!("`{}(a, b)`", name.text))
            }
            _ => self.square(name, arguments[0], (dims, items), place),
        }
    }

    /// `inverse(A)`, `det(A)` of small square matrices.
    fn square(&mut self, name: &Name, argument: ExprRef, (dims, items): (Dims, Vec<Item>), place: Place) -> Val {
        let n = dims.rows;
        if n != dims.width() || n > MOST_INVERTED {
            let shown = self.shown(argument, "its argument");
            let shape = shape_of(&Val::Array(dims, Vec::new()));
            let message = format!(
                "`{}` takes a square matrix up to [{MOST_INVERTED}, {MOST_INVERTED}], {shown} is {shape}",
                name.text
            );
            return self.wrong(
                Code::WrongShape,
                place.whole,
                message,
                "larger systems are solved before they are modelled",
            );
        }
        let items: Vec<Item> = items.into_iter().map(|item| item.map(|e| self.out.shared(e))).collect();
        let det = self.determinant(&items, n, place);
        if name.text == "det" {
            return Val::Scalar(self.out.item(det, place.whole));
        }
        let Some(det) = det else {
            let message = "this matrix has no inverse: its zeros make it singular".to_string();
            return self.wrong(
                Code::NotFinite,
                place.whole,
                message,
                "a row or a column of it is 0, or follows from the others",
            );
        };
        let det = self.out.shared(det);
        let mut inverse = Vec::with_capacity(n * n);
        for at in 0..n * n {
            // the adjugate is the transpose of the cofactors
            let cofactor = self.cofactor(&items, n, (at % n, at / n), place);
            inverse.push(cofactor.map(|c| {
                let det = self.out.copy(det);
                self.out.binary(BinarySign::Divide, c, det, place)
            }));
        }
        match inverse[..] {
            [item] => Val::Scalar(self.out.item(item, place.whole)),
            _ => Val::Array(dims, inverse),
        }
    }

    /// By the first row.
    fn determinant(&mut self, items: &[Item], n: usize, place: Place) -> Item {
        if n == 1 {
            return items[0].map(|e| self.out.copy(e));
        }
        let mut sum = None;
        for (j, item) in items.iter().enumerate().take(n) {
            let Some(item) = *item else { continue };
            let cofactor = self.cofactor(items, n, (0, j), place);
            let item = self.out.copy(item);
            let term = self.out.product(Some(item), cofactor, place);
            sum = self.out.sum(sum, term, false, place);
        }
        sum
    }

    /// The determinant without a row and a column, with its sign.
    fn cofactor(&mut self, items: &[Item], n: usize, (i, j): (usize, usize), place: Place) -> Item {
        let rest: Vec<Item> = (0..n * n).filter(|k| k / n != i && k % n != j).map(|k| items[k]).collect();
        let minor = match rest[..] {
            [] => Some(self.out.number(1.0, place.whole)),
            [a] => a.map(|e| self.out.copy(e)),
            [a, b, c, d] => {
                let [a, b, c, d] = [a, b, c, d].map(|item| item.map(|e| self.out.copy(e)));
                let (first, second) = (self.out.product(a, d, place), self.out.product(b, c, place));
                self.out.sum(first, second, true, place)
            }
            _ => Some(BROKEN),
        };
        if (i + j) % 2 == 0 {
            minor
        } else {
            minor.map(|e| self.out.push(Expr::Unary(UnarySign::Minus, e), place.whole))
        }
    }

    /// `hypot` of all, which is smooth where the square root of a sum of squares is not.
    fn norm(&mut self, items: Vec<Item>, place: Place) -> Val {
        let mut present = items.into_iter().flatten();
        let Some(first) = present.next() else { return Val::Scalar(self.out.number(0.0, place.whole)) };
        let mut norm = None;
        for item in present {
            norm = Some(self.out.call("hypot", vec![norm.unwrap_or(first), item], place));
        }
        Val::Scalar(norm.unwrap_or_else(|| self.out.call("abs", vec![first], place)))
    }

    fn cross(&mut self, a: Vec<Item>, b: Vec<Item>, place: Place) -> Val {
        let mut shared = |items: Vec<Item>| -> Vec<Item> {
            items.into_iter().map(|item| item.map(|e| self.out.shared(e))).collect()
        };
        let (a, b) = (shared(a), shared(b));
        let mut component = |i: usize, j: usize| {
            let [ai, bj, aj, bi] = [a[i], b[j], a[j], b[i]].map(|item| item.map(|e| self.out.copy(e)));
            let (first, second) = (self.out.product(ai, bj, place), self.out.product(aj, bi, place));
            self.out.sum(first, second, true, place)
        };
        let items = vec![component(1, 2), component(2, 0), component(0, 1)];
        Val::Array(Dims::vector(3), items)
    }
}

/// A vector, a row or a column.
fn is_list(dims: Dims) -> bool {
    dims.rows == 1 || dims.width() == 1
}

fn transposed(dims: Dims, items: &[Item]) -> Val {
    let (rows, columns) = (dims.rows, dims.width());
    let items = (0..columns).flat_map(|j| (0..rows).map(move |i| items[i * columns + j])).collect();
    Val::Array(Dims::matrix(columns, rows), items)
}

impl Evaluator<'_, '_> {
    /// `dcm(q)`, `dcm(phi, theta, psi)`, `rotate(q, v)`.
    pub(super) fn rotation(&mut self, name: &Name, arguments: &[ExprRef], span: Span) -> Val {
        let values: Vec<Val> = arguments.iter().map(|e| self.take(*e)).collect();
        if values.iter().any(|v| matches!(v, Val::Broken)) {
            return Val::Broken;
        }
        let shapes: Vec<usize> = values.iter().map(count_of).collect();
        let place = Place { sign: name.span, whole: span };
        let matrix = Dims::matrix(3, 3);
        let mut lists = values.into_iter().map(|value| match value {
            Val::Array(_, items) => items,
            Val::Scalar(e) => vec![Some(e)],
            Val::Broken => Vec::new(),
        });
        match (name.text.as_str(), &shapes[..]) {
            ("dcm", [4]) => {
                let q = lists.next().unwrap_or_default();
                Val::Array(matrix, self.of_quaternion(q, place))
            }
            ("dcm", [1, 1, 1]) => {
                let angles = lists.flatten().map(|item| self.out.item(item, span)).collect();
                Val::Array(matrix, self.of_angles(angles, place))
            }
            ("rotate", [4, 3]) => {
                let (q, v) = (lists.next().unwrap_or_default(), lists.next().unwrap_or_default());
                let turned = Val::Array(matrix, self.of_quaternion(q, place));
                self.product((arguments[0], turned), (arguments[1], Val::Array(Dims::vector(3), v)), place)
            }
            (function, _) => {
                let form = if function == "dcm" { "`dcm(q)` or `dcm(phi, theta, psi)`" } else { "`rotate(q, v)`" };
                let given: Vec<String> = shapes.iter().map(|n| format!("[{n}]").replace("[1]", "a number")).collect();
                let given = if given.is_empty() { "nothing".into() } else { given.join(", ") };
                let message = format!(
                    "`{function}` takes a quaternion [4]{}, given: {given}",
                    match function {
                        "dcm" => ", or three angles",
                        _ => " and a vector [3]",
                    }
                );
                self.wrong(Code::WrongShape, span, message, form)
            }
        }
    }

    /// `[[1 - 2*(y^2 + z^2), 2*(x*y - w*z), 2*(x*z + w*y)], ...]` of a quaternion of length 1.
    fn of_quaternion(&mut self, q: Vec<Item>, place: Place) -> Vec<Item> {
        let q: Vec<Item> = q.into_iter().map(|item| item.map(|e| self.out.shared(e))).collect();
        let [w, x, y, z] = [0, 1, 2, 3];
        let mut turned = Vec::with_capacity(9);
        for i in 0..3 {
            for j in 0..3 {
                // what is left of x, y, z beside i and j
                let (first, second, minus) = match (i, j) {
                    (0, 0) => ((y, y), (z, z), false),
                    (1, 1) => ((x, x), (z, z), false),
                    (2, 2) => ((x, x), (y, y), false),
                    (0, 1) => ((x, y), (w, z), true),
                    (1, 0) => ((x, y), (w, z), false),
                    (0, 2) => ((x, z), (w, y), false),
                    (2, 0) => ((x, z), (w, y), true),
                    (1, 2) => ((y, z), (w, x), true),
                    _ => ((y, z), (w, x), false),
                };
                let mut of = |(a, b): (usize, usize)| {
                    let (a, b) = (q[a].map(|e| self.out.copy(e)), q[b].map(|e| self.out.copy(e)));
                    self.out.product(a, b, place)
                };
                let (first, second) = (of(first), of(second));
                let sum = self.out.sum(first, second, minus, place);
                let two = self.out.number(2.0, place.whole);
                let doubled = sum.map(|e| self.out.binary(BinarySign::Multiply, two, e, place));
                turned.push(if i == j {
                    let one = Some(self.out.number(1.0, place.whole));
                    self.out.sum(one, doubled, true, place)
                } else {
                    doubled
                });
            }
        }
        turned
    }

    /// Of roll, pitch and yaw.
    fn of_angles(&mut self, angles: Vec<ExprRef>, place: Place) -> Vec<Item> {
        let mut parts = Vec::with_capacity(6);
        for angle in angles {
            let angle = self.out.shared(angle);
            for function in ["sin", "cos"] {
                let angle = self.out.copy(angle);
                let call = self.out.call(function, vec![angle], place);
                parts.push(self.out.shared(call));
            }
        }
        let [sin_phi, cos_phi, sin_theta, cos_theta, sin_psi, cos_psi] = [0, 1, 2, 3, 4, 5];
        let mut of = |factors: &[usize]| {
            let mut product = None;
            for k in factors {
                let factor = Some(self.out.copy(parts[*k]));
                product = if product.is_none() { factor } else { self.out.product(product, factor, place) };
            }
            product
        };
        let single = [
            of(&[cos_theta, cos_psi]),
            of(&[cos_theta, sin_psi]),
            of(&[sin_theta]),
            of(&[sin_phi, cos_theta]),
            of(&[cos_phi, cos_theta]),
        ];
        let pairs = [
            (of(&[sin_phi, sin_theta, cos_psi]), of(&[cos_phi, sin_psi]), true),
            (of(&[cos_phi, sin_theta, cos_psi]), of(&[sin_phi, sin_psi]), false),
            (of(&[sin_phi, sin_theta, sin_psi]), of(&[cos_phi, cos_psi]), false),
            (of(&[cos_phi, sin_theta, sin_psi]), of(&[sin_phi, cos_psi]), true),
        ];
        let [a, b, c, d] = pairs.map(|(first, second, minus)| self.out.sum(first, second, minus, place));
        let down = self.out.sum(None, single[2], true, place);
        vec![single[0], a, b, single[1], c, d, down, single[3], single[4]]
    }
}

/// How many numbers a value has.
fn count_of(value: &Val) -> usize {
    dims_of(value).count()
}
