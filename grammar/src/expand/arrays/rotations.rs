//! Rotations: `dcm` and `rotate`. A quaternion is `[w, x, y, z]`, its real part first; it turns vectors of the body into
//! those of the reference frame. Angles are those of Euler in the order yaw, pitch, roll (3-2-1).
//!
//! Stevens, Lewis, Johnson (2016): Aircraft Control and Simulation, 3rd edition, section 1.8.

use super::shape::Dims;
use super::value::{Evaluator, Val};
use super::writer::{Item, Place};
use crate::diagnostic::Code;
use crate::source::Span;
use crate::syntax::{BinarySign, ExprRef, Name};

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
    super::value::dims_of(value).count()
}
